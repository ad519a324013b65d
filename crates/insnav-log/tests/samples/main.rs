//! Messages become samples: units, axes, order, encodings, and what is dropped and counted on the way.

mod axes;
mod declared;
mod devices;
mod encodings;
mod foreign_bytes;
mod gnss;
mod magnetic;
mod maps;
mod recorder;
#[path = "../recordings/mod.rs"]
mod recordings;
mod stamps;
mod tables;
mod topics;
mod transforms;
