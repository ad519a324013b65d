//! CDR, the wire format of ROS 2 messages ([OMG-DDSI] section 10, plain CDR of XCDR version 1).
//!
//! Four bytes of encapsulation header, then the fields in order, each aligned to its own size *counted from after that
//! header*; strings are a length (with their NUL), the bytes, the NUL. A cursor of our own instead of a generic
//! deserialiser: no allocation, both byte orders, and no panic on any bytes.

mod reader;
mod writer;

pub use reader::CdrReader;
pub use writer::{CdrWriter, Endian};
