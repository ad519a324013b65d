//! Named blocks of error states, and where each one stands: the only place with an offset.

use crate::error::{Error, Result};
use core::ops::Range;
use serde::{Deserialize, Serialize};

/// A handle to `N` error states: identity in the value, size in the type, no offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Block<const N: usize>(usize);

impl<const N: usize> Block<N> {
    /// Its number in [`BLOCKS`].
    pub(super) fn id(self) -> usize {
        self.0
    }
}

/// What is known of a block without its size in a type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockInfo {
    /// Name in reports and in Python.
    pub name: &'static str,
    /// Number of states.
    pub size: usize,
    /// Unit of each state.
    pub unit: &'static str,
}

macro_rules! blocks {
    ($($(#[$doc:meta])* $index:literal $handle:ident: $size:literal, $name:literal, $unit:literal;)*) => {
        $($(#[$doc])* pub const $handle: Block<$size> = Block($index);)*

        /// Every block there can be, base blocks first.
        pub const BLOCKS: [BlockInfo; [$($index),*].len()] =
            [$(BlockInfo { name: $name, size: $size, unit: $unit }),*];
    };
}

/// The most states that can be open at once: the kernel's lanes and masks are made for a power of two.
pub const CAPACITY: usize = 32;

blocks! {
    /// Position error, metres NED.
    0 POSITION: 3, "position", "m";
    /// Velocity error, NED.
    1 VELOCITY: 3, "velocity", "m/s";
    /// Attitude error φ in n: `C = Exp(φ_D) Exp(φ_N, φ_E) Ĉ`, to first order `Exp(φ) Ĉ`.
    2 ATTITUDE: 3, "attitude", "rad";
    /// Gyro bias error, body axes.
    3 GYRO_BIAS: 3, "gyro_bias", "rad/s";
    /// Accelerometer bias error, body axes.
    4 ACCEL_BIAS: 3, "accel_bias", "m/s²";
    /// The constant part of the heading error while a heading is held.
    5 HELD_HEADING: 1, "held_heading", "rad";
    /// Time-correlated part of the GNSS position error, NED.
    6 GNSS_COLOUR: 3, "gnss_colour", "m";
    /// Gyro scale factor errors.
    7 GYRO_SCALE: 3, "gyro_scale", "1";
    /// Accelerometer scale factor errors.
    8 ACCEL_SCALE: 3, "accel_scale", "1";
    /// Error of the GNSS lever arm, body axes.
    9 LEVER_ARM: 3, "lever_arm", "m";
    /// Pitch and yaw of the IMU against the vehicle.
    10 MOUNTING: 2, "mounting", "rad";
    /// Scale factor error of the odometer.
    11 ODOMETER_SCALE: 1, "odometer_scale", "1";
    /// Error of the offset between the IMU's and the GNSS clock.
    12 CLOCK_OFFSET: 1, "clock_offset", "s";
    /// How much further forward the unsteered axle is than the settings say, body axes.
    13 AXLE: 1, "axle", "m";
    /// The constant part of the attitude error while an attitude is held, NED.
    14 HELD_ATTITUDE: 3, "held_attitude", "rad";
}

/// The number of states of the base blocks, which are always open.
pub const BASE: usize = 15;

const BASE_BLOCKS: usize = 5;
const CLOSED: u8 = u8::MAX;

/// Which blocks are open, and where: base blocks first, the others in order of arrival.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layout {
    at: [u8; BLOCKS.len()],
    n: u8,
}

impl Default for Layout {
    fn default() -> Self {
        let mut at = [CLOSED; BLOCKS.len()];
        for (i, slot) in at.iter_mut().enumerate().take(BASE_BLOCKS) {
            *slot = 3 * i as u8;
        }
        Layout { at, n: BASE as u8 }
    }
}

impl Layout {
    /// Number of states open.
    // `is_empty` would never be true.
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        usize::from(self.n)
    }

    /// Whether a block is open.
    pub fn has<const N: usize>(&self, block: Block<N>) -> bool {
        self.at[block.0] != CLOSED
    }

    /// Where an open block stands.
    pub fn range<const N: usize>(&self, block: Block<N>) -> Option<Range<usize>> {
        self.offset(block).map(|at| at..at + N)
    }

    /// Name and place of every open block, in the order of the states.
    pub fn names(&self) -> impl Iterator<Item = (BlockInfo, Range<usize>)> + '_ {
        let mut next = 0;
        core::iter::from_fn(move || {
            let id = self
                .at
                .iter()
                .position(|&at| usize::from(at) == next && at != CLOSED)?;
            let range = next..next + BLOCKS[id].size;
            next = range.end;
            Some((BLOCKS[id], range))
        })
    }

    /// Number, name and place of every optional block that is open, in the order of [`BLOCKS`].
    pub(super) fn optional(
        &self,
    ) -> impl Iterator<Item = (usize, BlockInfo, Range<usize>)> + use<> {
        self.optional_ranges()
            .map(|(id, range)| (id, BLOCKS[id], range))
    }

    /// Number and place alone: what every step asks for.
    #[inline]
    pub(super) fn optional_ranges(&self) -> impl Iterator<Item = (usize, Range<usize>)> + use<> {
        let at = self.at;
        (BASE_BLOCKS..BLOCKS.len()).filter_map(move |id| {
            let start = usize::from(at[id]);
            (at[id] != CLOSED).then(|| (id, start..start + BLOCKS[id].size))
        })
    }

    pub(super) fn offset<const N: usize>(&self, block: Block<N>) -> Option<usize> {
        let at = self.at[block.0];
        (at != CLOSED).then_some(usize::from(at))
    }

    /// Give a closed block its place behind all others; an open one keeps its own.
    pub(super) fn open<const N: usize>(&mut self, block: Block<N>) -> Result<usize> {
        if let Some(at) = self.offset(block) {
            return Ok(at);
        }
        let (at, name) = (self.len(), BLOCKS[block.0].name);
        if at + N > CAPACITY {
            return Err(Error::Capacity {
                name,
                active: at,
                capacity: CAPACITY,
            });
        }
        self.at[block.0] = at as u8;
        self.n += N as u8;
        Ok(at)
    }

    /// Take an optional block away; what stood behind it moves up. Base blocks cannot be closed.
    pub(super) fn close<const N: usize>(&mut self, block: Block<N>) -> Option<usize> {
        if block.0 < BASE_BLOCKS {
            return None;
        }
        let gone = self.offset(block)?;
        self.at[block.0] = CLOSED;
        for at in &mut self.at {
            if *at != CLOSED && usize::from(*at) > gone {
                *at -= N as u8;
            }
        }
        self.n -= N as u8;
        Some(gone)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_blocks_stand_in_the_order_of_the_shears() {
        let layout = Layout::default();
        assert_eq!(layout.len(), BASE);
        let expected = [
            "position",
            "velocity",
            "attitude",
            "gyro_bias",
            "accel_bias",
        ];
        assert!(layout.names().map(|(b, _)| b.name).eq(expected));
        assert_eq!(layout.range(ATTITUDE), Some(6..9));
        assert_eq!(layout.range(HELD_HEADING), None);
    }

    #[test]
    fn closing_moves_the_rest_up() {
        let mut layout = Layout::default();
        layout.open(GYRO_SCALE).unwrap();
        layout.open(HELD_HEADING).unwrap();
        layout.open(MOUNTING).unwrap();
        assert_eq!(layout.range(MOUNTING), Some(19..21));
        assert_eq!(layout.close(GYRO_SCALE), Some(15));
        assert_eq!(
            (layout.range(HELD_HEADING), layout.range(MOUNTING)),
            (Some(15..16), Some(16..18))
        );
        assert_eq!(layout.close(GYRO_SCALE), None);
        assert_eq!(layout.close(POSITION), None, "base blocks stay");
        assert_eq!(
            layout.names().map(|(b, r)| b.size - r.len()).sum::<usize>(),
            0
        );
    }

    #[test]
    fn all_but_the_axle_fit_at_once() {
        let mut layout = Layout::default();
        layout.open(HELD_HEADING).unwrap();
        layout.open(GNSS_COLOUR).unwrap();
        layout.open(GYRO_SCALE).unwrap();
        layout.open(ACCEL_SCALE).unwrap();
        layout.open(LEVER_ARM).unwrap();
        layout.open(MOUNTING).unwrap();
        layout.open(ODOMETER_SCALE).unwrap();
        assert_eq!(layout.open(CLOCK_OFFSET), Ok(31));
        assert_eq!(layout.len(), CAPACITY);
        let full = layout.open(AXLE).unwrap_err();
        assert!(full.to_string().contains("axle"), "{full}");
        layout.close(ODOMETER_SCALE);
        assert_eq!(layout.open(AXLE), Ok(31));
    }
}
