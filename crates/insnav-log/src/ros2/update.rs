//! `insnav_msgs/msg/Update`: one measurement as the filter saw it.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};

/// One measurement: residual, its predicted standard deviation, normalised innovation squared, verdict.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct UpdateMessage<'a> {
    /// Instant of the measurement.
    pub header: Header<'a>,
    /// Name of the measurement model.
    pub measurement: &'a str,
    /// Number of components, 1 to 3.
    pub dof: u8,
    /// Measured minus predicted; 0 beyond `dof`.
    pub residual: [f64; 3],
    /// Standard deviation of the residual as predicted; 0 beyond `dof`.
    pub sigma: [f64; 3],
    /// Normalised innovation squared; its mean over a consistent run is `dof`.
    pub nis: f64,
    /// 0 accepted, 1 inflated, 2 rejected, 3 reset (used after the filter was widened), 4 frozen (a repeated position).
    pub verdict: u8,
}

impl<'a> Decode<'a> for UpdateMessage<'a> {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        Ok(UpdateMessage {
            header: Header::of(from)?,
            measurement: from.string("measurement")?,
            dof: from.u8("dof")?,
            residual: from.f64_array("residual")?,
            sigma: from.f64_array("sigma")?,
            nis: from.f64("nis")?,
            verdict: from.u8("verdict")?,
        })
    }
}

impl Encode for UpdateMessage<'_> {
    const SCHEMA: &'static str = "insnav_msgs/msg/Update";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        to.string(self.measurement);
        to.u8(self.dof);
        to.f64_array(&self.residual);
        to.f64_array(&self.sigma);
        to.f64(self.nis);
        to.u8(self.verdict);
    }
}

/// Definition of the message in the ROS 2 interface language, without dependencies.
pub(super) const DEFINITION: &str = "std_msgs/Header header
string measurement
uint8 dof
float64[3] residual
float64[3] sigma
float64 nis
uint8 ACCEPTED=0
uint8 INFLATED=1
uint8 REJECTED=2
uint8 RESET=3
uint8 FROZEN=4
uint8 verdict
";
