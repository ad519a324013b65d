//! Blocks of error states by their names.

use crate::failure::Failure;
use insnav_core::filter::{BLOCKS, CAPACITY, Eskf};
use nalgebra::SMatrix;
use std::ops::Range;

/// Do something with the handle of a block, whose size is in its type; `None` for a name that none has.
macro_rules! with_block {
    ($name:expr, $block:ident => $body:expr) => {{
        use insnav_core::filter as f;
        macro_rules! of {
            ($handle:ident) => {{
                let $block = f::$handle;
                Some($body)
            }};
        }
        match $name {
            "position" => of!(POSITION),
            "velocity" => of!(VELOCITY),
            "attitude" => of!(ATTITUDE),
            "gyro_bias" => of!(GYRO_BIAS),
            "accel_bias" => of!(ACCEL_BIAS),
            "held_heading" => of!(HELD_HEADING),
            "held_attitude" => of!(HELD_ATTITUDE),
            "gnss_colour" => of!(GNSS_COLOUR),
            "gyro_scale" => of!(GYRO_SCALE),
            "accel_scale" => of!(ACCEL_SCALE),
            "lever_arm" => of!(LEVER_ARM),
            "mounting" => of!(MOUNTING),
            "odometer_scale" => of!(ODOMETER_SCALE),
            "clock_offset" => of!(CLOCK_OFFSET),
            "axle" => of!(AXLE),
            _ => None,
        }
    }};
}
pub(super) use with_block;

/// Where an open block stands among the states.
pub(super) fn range(filter: &Eskf, argument: &str, name: &str) -> Result<Range<usize>, Failure> {
    let layout = filter.covariance().layout();
    let found = layout.names().find(|(info, _)| info.name == name);
    found.map(|(_, range)| range).ok_or_else(|| {
        let open: Vec<&str> = layout.names().map(|(info, _)| info.name).collect();
        let closed = BLOCKS.iter().any(|info| info.name == name);
        Failure::argument(
            "bad_option",
            argument,
            format!("{name:?}"),
            format!("one of the open blocks {}", open.join(", ")),
            if closed {
                "open it first"
            } else {
                "blocks have the names of `insnav.filter.BLOCKS`"
            },
        )
    })
}

/// The covariance of the open states in the leading rows and columns.
pub(super) fn dense(filter: &Eskf) -> SMatrix<f64, CAPACITY, CAPACITY> {
    filter.covariance().dense()
}

/// Every block there can be: name, number of states, unit.
pub(crate) fn known_blocks() -> Vec<(&'static str, usize, &'static str)> {
    BLOCKS.iter().map(|b| (b.name, b.size, b.unit)).collect()
}
