//! The ROS messages that are read and written, one file per message; ROS 1 has the same under shorter names.
//!
//! Each is described once and read from CDR, ROS 1 and JSON by that description. A decoded message borrows its strings from the bytes it was read from. Values are as on the wire: ROS axes (ENU,
//! forward-left-up) and units; what they mean to the navigator is decided by [`crate::Samples`] and [`crate::McapSink`].

mod diagnostics;
mod header;
mod imu;
mod magnetic_field;
mod nav_sat_fix;
mod odometry;
mod pose;
mod schema;
mod single_value;
mod state;
mod transform;
mod twist;
mod update;

pub use diagnostics::{DiagnosticArray, DiagnosticStatus};
pub use header::Header;
pub use imu::Imu;
pub use magnetic_field::MagneticField;
pub use nav_sat_fix::{CovarianceType, NavSatFix};
pub use odometry::Odometry;
pub use pose::{Pose, PoseStamped};
pub use schema::schema_text;
pub use single_value::{Bool, Float32, Float64};
pub use state::State;
pub use transform::{TfMessage, TransformStamped, Transforms};
pub use twist::{Twist, TwistStamped, TwistWithCovarianceStamped};
pub use update::UpdateMessage;

use crate::cdr::{CdrReader, CdrWriter};
use crate::wire::{DecodeError, Wire};

/// A message that can be read, from any wire that has its fields.
pub trait Decode<'a>: Sized {
    /// Read the fields in order.
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError>;

    /// Read a whole message from CDR. Bytes after its last field are padding of the writer, and allowed.
    fn decode(message: &'a [u8]) -> Result<Self, DecodeError> {
        Self::read(&mut CdrReader::new(message)?)
    }
}

/// A message that can be written as CDR.
pub trait Encode {
    /// Full name of its type, such as `sensor_msgs/msg/Imu`.
    const SCHEMA: &'static str;

    /// Write the fields in order.
    fn write(&self, to: &mut CdrWriter);
}
