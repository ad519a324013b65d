//! `std_msgs/msg/Bool`, `Float32` and `Float64`: one value, no header.

use super::{Decode, Encode};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};

/// True or false.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bool(pub bool);

/// A number of 32 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Float32(pub f32);

/// A number of 64 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Float64(pub f64);

impl<'a> Decode<'a> for Bool {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        from.bool("data").map(Bool)
    }
}

impl<'a> Decode<'a> for Float32 {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        from.f32("data").map(Float32)
    }
}

impl<'a> Decode<'a> for Float64 {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        from.f64("data").map(Float64)
    }
}

impl Encode for Bool {
    const SCHEMA: &'static str = "std_msgs/msg/Bool";

    fn write(&self, to: &mut CdrWriter) {
        to.u8(u8::from(self.0));
    }
}

impl Encode for Float32 {
    const SCHEMA: &'static str = "std_msgs/msg/Float32";

    fn write(&self, to: &mut CdrWriter) {
        to.f32(self.0);
    }
}

impl Encode for Float64 {
    const SCHEMA: &'static str = "std_msgs/msg/Float64";

    fn write(&self, to: &mut CdrWriter) {
        to.f64(self.0);
    }
}
