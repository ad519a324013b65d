//! `std_msgs/msg/Header`.

use super::Decode;
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};
use insnav_core::time::Time;

/// When and in which frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header<'a> {
    /// Stamp, since the Unix epoch where the driver is well behaved; zero where it sets none.
    pub stamp: Time,
    /// Name of the frame.
    pub frame_id: &'a str,
}

impl<'a> Decode<'a> for Header<'a> {
    #[inline]
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        from.sequence_number()?;
        Ok(Header {
            stamp: from.time("stamp")?,
            frame_id: from.or_absent("", |from| from.string("frame_id"))?,
        })
    }
}

impl<'a> Header<'a> {
    /// The header at the begin of a message; empty where a wire may leave it out and does.
    #[inline]
    pub(crate) fn of<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        from.or_absent(Header::default(), |from| {
            from.nested("header", Header::read)
        })
    }
}

impl Header<'_> {
    pub(crate) fn write(&self, to: &mut CdrWriter) {
        write_time(self.stamp, to);
        to.string(self.frame_id);
    }
}

/// `builtin_interfaces/msg/Time`. Stamps beyond the years 1901 to 2038 do not fit its 32 bits and stop at their ends.
fn write_time(time: Time, to: &mut CdrWriter) {
    let seconds = time.0.div_euclid(1_000_000_000);
    let clamped = seconds.clamp(i64::from(i32::MIN), i64::from(i32::MAX));
    to.i32(clamped as i32);
    to.u32(if clamped == seconds {
        time.0.rem_euclid(1_000_000_000) as u32
    } else {
        0
    });
}
