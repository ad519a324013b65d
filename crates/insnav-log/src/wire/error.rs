//! Why some bytes are no message of the expected type.

use std::fmt;

/// Where a named field was looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldName {
    /// The message inside the message, if it is in one.
    pub parent: &'static str,
    /// Its own name.
    pub name: &'static str,
}

impl fmt::Display for FieldName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.parent.is_empty() {
            write!(f, "{}.", self.parent)?;
        }
        f.write_str(self.name)
    }
}

/// Why some bytes are no message of the expected type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// The message ends too early.
    #[error("{missing} bytes are missing at byte {at} of {length}")]
    TooShort {
        /// Where the field would begin.
        at: usize,
        /// How many bytes it lacks.
        missing: usize,
        /// Bytes of the message.
        length: usize,
    },
    /// An encapsulation other than plain CDR.
    #[error("encapsulation {0:#06x} is not plain CDR (0x0000 or 0x0001)")]
    Encapsulation(u16),
    /// A string that does not end as it should, or is not UTF-8.
    #[error("no valid string at byte {at}")]
    BadString {
        /// Where its bytes begin.
        at: usize,
    },
    /// A field that has to be there.
    #[error("there is no field {0}")]
    Missing(FieldName),
    /// A field of another kind.
    #[error("field {field} is {found}, where {expected} is expected")]
    Kind {
        /// Which one.
        field: FieldName,
        /// What it should be.
        expected: &'static str,
        /// What it is.
        found: &'static str,
    },
    /// Not JSON.
    #[error("not JSON at byte {at}: {expected} is expected")]
    Json {
        /// Where.
        at: usize,
        /// What should be there.
        expected: &'static str,
    },
    /// Not protobuf, or not of this type.
    #[error("not protobuf of this type at byte {at}: {reason}")]
    Protobuf {
        /// Where.
        at: usize,
        /// What is wrong.
        reason: &'static str,
    },
    /// A field that the user's map names and the message does not have.
    #[error("nothing that {key} can be read from")]
    NotMapped {
        /// Key of the map.
        key: &'static str,
        /// Which of its fields.
        index: usize,
        /// What the field is instead of a number, if it is there.
        found: Option<&'static str>,
    },
    /// A message that is deeper or longer than any real one.
    #[error("the message has more than {0}")]
    TooMuch(&'static str),
}
