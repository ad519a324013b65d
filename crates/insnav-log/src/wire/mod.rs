//! What a message is written in: one description of a message, read from every encoding.
//!
//! A message type lists its fields once, in order and by name ([`crate::ros2::Decode`]), over a [`Wire`]. The wires of ROS
//! ([`crate::cdr::CdrReader`], [`Ros1Reader`]) take the fields in order and never look at the names; [`Fields`] finds them by
//! name in a [`Document`], which is made from JSON, from protobuf, or from ROS bytes and their definition
//! ([`Definition`]), for message types whose fields differ from version to version.

mod definition;
mod document;
mod error;
mod json;
mod protobuf;
mod ros1;

pub use definition::{Definition, DefinitionError};
pub use document::{Document, Fields};
pub use error::{DecodeError, FieldName};
pub use json::read_json;
pub use protobuf::{LocationFixLayout, read_location_fix};
pub use ros1::Ros1Reader;

use insnav_core::time::Time;

/// A message's fields, one after the other. `'a` is the life of its bytes.
pub trait Wire<'a>: Sized {
    /// A signed byte.
    fn i8(&mut self, field: &'static str) -> Result<i8, DecodeError>;
    /// An unsigned byte.
    fn u8(&mut self, field: &'static str) -> Result<u8, DecodeError>;
    /// A 16-bit unsigned number.
    fn u16(&mut self, field: &'static str) -> Result<u16, DecodeError>;
    /// A 32-bit floating-point number.
    fn f32(&mut self, field: &'static str) -> Result<f32, DecodeError>;
    /// A 64-bit floating-point number.
    fn f64(&mut self, field: &'static str) -> Result<f64, DecodeError>;
    /// A fixed-size array of numbers.
    fn f64_array<const N: usize>(&mut self, field: &'static str) -> Result<[f64; N], DecodeError>;
    /// A message of nothing but numbers, such as a vector.
    fn components<const N: usize>(
        &mut self,
        field: &'static str,
        names: [&'static str; N],
    ) -> Result<[f64; N], DecodeError>;
    /// Text.
    fn string(&mut self, field: &'static str) -> Result<&'a str, DecodeError>;
    /// An instant.
    fn time(&mut self, field: &'static str) -> Result<Time, DecodeError>;

    /// A message inside the message.
    fn nested<T>(
        &mut self,
        field: &'static str,
        read: impl FnOnce(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<T, DecodeError>;

    /// A sequence of messages, each of `smallest` bytes at least.
    fn elements<T>(
        &mut self,
        field: &'static str,
        smallest: usize,
        read: impl FnMut(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<Vec<T>, DecodeError>;

    /// True or false: a byte where there are bytes.
    #[inline]
    fn bool(&mut self, field: &'static str) -> Result<bool, DecodeError> {
        Ok(self.u8(field)? != 0)
    }

    /// What `read` gives, or `absent` on a wire that may leave a field out and does.
    #[inline]
    fn or_absent<T>(
        &mut self,
        absent: T,
        read: impl FnOnce(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<T, DecodeError> {
        let _ = absent;
        read(self)
    }

    /// Pass over the sequence number that only ROS 1 has at the begin of a header.
    #[inline]
    fn sequence_number(&mut self) -> Result<(), DecodeError> {
        Ok(())
    }
}
