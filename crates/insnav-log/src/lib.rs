//! Logs in, solutions out.
//!
//! [`Log`] opens an MCAP file of ROS 2 messages, finds its topics and gives [`Samples`] in time order;
//! [`McapSink`] takes what the navigator produces and writes a file that the common viewers open.
//!
//! In the order data flows: [`topics`] decides which topic is the IMU, [`ros2`] decodes messages with [`cdr`], [`Samples`]
//! turns them into SI and forward-right-down, [`McapSink`] writes the solution, [`SolutionTable`] reads it back.
//! [`csv`] and [`tum`] read and write text tables, [`convert`] goes between them and MCAP.

pub mod cdr;
mod container;
mod error;
mod log;
mod reorder;
pub mod ros2;
mod samples;
pub mod topics;

pub use container::Message;
pub use error::LogError;
pub use log::{ImuAxes, Log, METADATA_NAME, METADATA_T0, ReadOptions, TimeSource};
pub use samples::{SampleCounts, Samples};
pub use topics::{Choice, Role, Selection, TopicInfo};
