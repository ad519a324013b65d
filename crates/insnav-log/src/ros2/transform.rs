//! `tf2_msgs/msg/TFMessage`.

use super::{Decode, Encode, Header};
use crate::cdr::{CdrError, CdrReader, CdrWriter};
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
    fn read(from: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        Ok(TransformStamped {
            header: Header::read(from)?,
            child_frame_id: from.string()?,
            translation: from.f64_array()?.into(),
            rotation: from.f64_array()?,
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

/// The transforms of a message, read one at a time without a list.
#[derive(Clone, Debug)]
pub struct Transforms<'a> {
    from: CdrReader<'a>,
    left: usize,
}

impl<'a> Transforms<'a> {
    /// The transforms of this message.
    pub fn decode(message: &'a [u8]) -> Result<Self, CdrError> {
        let mut from = CdrReader::new(message)?;
        // Stamp, two empty strings, seven numbers: no transform is shorter.
        let left = from.sequence(8 + 4 + 4 + 56)?;
        Ok(Transforms { from, left })
    }
}

impl<'a> Iterator for Transforms<'a> {
    type Item = Result<TransformStamped<'a>, CdrError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.left = self.left.checked_sub(1)?;
        let transform = TransformStamped::read(&mut self.from);
        if transform.is_err() {
            self.left = 0;
        }
        Some(transform)
    }
}
