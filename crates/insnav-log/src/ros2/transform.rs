//! `tf2_msgs/msg/TFMessage`.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};
use nalgebra::Vector3;

/// Where the frame `child_frame_id` is in the frame of the header.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TransformStamped<'a> {
    /// Stamp and parent frame.
    pub header: Header<'a>,
    /// The frame that is described.
    pub child_frame_id: &'a str,
    /// Its origin in the parent, m.
    pub translation: Vector3<f64>,
    /// Rotation x, y, z, w that takes a vector from child axes to parent axes.
    pub rotation: [f64; 4],
}

impl<'a> Decode<'a> for TransformStamped<'a> {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        let header = Header::of(from)?;
        let child_frame_id = from.string("child_frame_id")?;
        from.nested("transform", |from| {
            Ok(TransformStamped {
                header,
                child_frame_id,
                translation: from.components("translation", ["x", "y", "z"])?.into(),
                rotation: from.components("rotation", ["x", "y", "z", "w"])?,
            })
        })
    }
}

/// A list of transforms to be written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TfMessage<'a> {
    /// The transforms.
    pub transforms: &'a [TransformStamped<'a>],
}

impl Encode for TfMessage<'_> {
    const SCHEMA: &'static str = "tf2_msgs/msg/TFMessage";

    fn write(&self, to: &mut CdrWriter) {
        to.sequence(self.transforms.len());
        for transform in self.transforms {
            transform.header.write(to);
            to.string(transform.child_frame_id);
            to.f64_array(transform.translation.as_slice());
            to.f64_array(&transform.rotation);
        }
    }
}

/// The transforms of a message.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Transforms<'a>(pub Vec<TransformStamped<'a>>);

impl<'a> Decode<'a> for Transforms<'a> {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        // Stamp, two empty strings, seven numbers: no transform is shorter.
        let smallest = 8 + 4 + 4 + 56;
        from.elements("transforms", smallest, TransformStamped::read)
            .map(Transforms)
    }
}
