//! The MCAP container: records, chunks, and messages in order of log time, read from a map of the file.
//!
//! Reading is our own, writing is the `mcap` crate's. The reasons: messages stay borrowed from one reused buffer per chunk,
//! a chunk's checksum is verified before its first message is used, and no index is believed (files exist whose summary
//! lists channels without their schemas, or points nowhere): one pass over the record *headers* finds every chunk, and the
//! summary only saves decompressing them to learn the channels, and only if it agrees with what is there.
//!
//! A damaged file is an error, unless recovery is asked for: then every chunk is opened, and what cannot be verified is left
//! out and told.

mod account;
mod contents;
mod integrity;
mod messages;
mod records;
mod recovery;
mod resync;
mod section;
mod source;
mod typed;
mod walk;

pub use account::{Loss, Recovery};
pub use contents::Checksums;
pub(crate) use contents::Contents;
pub use messages::Message;
pub(crate) use messages::Messages;
pub(crate) use source::Source;
pub use typed::McapRecord;
pub(crate) use walk::each_record;
