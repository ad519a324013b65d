//! Messages become samples: units, axes, order, encodings, and what is dropped and counted on the way.

mod axes;
mod encodings;
mod gnss;
mod recorder;
#[path = "../recordings/mod.rs"]
mod recordings;
mod stamps;
mod tables;
mod topics;
mod transforms;
