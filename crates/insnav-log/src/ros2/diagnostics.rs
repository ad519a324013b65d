//! `diagnostic_msgs/msg/DiagnosticArray`.

use super::{Encode, Header};
use crate::cdr::CdrWriter;

/// State of one component.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiagnosticStatus<'a> {
    /// 0 ok, 1 warning, 2 error, 3 stale.
    pub level: u8,
    /// Component.
    pub name: &'a str,
    /// One line for a person.
    pub message: &'a str,
    /// Identifier of the hardware.
    pub hardware_id: &'a str,
    /// Keys and values.
    pub values: &'a [(&'a str, String)],
}

/// States of components at an instant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiagnosticArray<'a> {
    /// Stamp and frame.
    pub header: Header<'a>,
    /// The states.
    pub status: &'a [DiagnosticStatus<'a>],
}

impl Encode for DiagnosticArray<'_> {
    const SCHEMA: &'static str = "diagnostic_msgs/msg/DiagnosticArray";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        to.sequence(self.status.len());
        for status in self.status {
            to.u8(status.level);
            to.string(status.name);
            to.string(status.message);
            to.string(status.hardware_id);
            to.sequence(status.values.len());
            for (key, value) in status.values {
                to.string(key);
                to.string(value);
            }
        }
    }
}
