//! Message definitions of ROS (`ros2msg`, `ros1msg`) and the reading of messages by them.
//!
//! Drivers' own messages differ from version to version: fields are added, renamed, widened. A log carries the definition
//! that its messages were written by, so that is what tells where a field is. The grammar is that of the ROS interface
//! language: one `type name [default]` or `type NAME=constant` a line, `#` comments, dependencies behind lines of `=` signs
//! under `MSG: package/Name`.

use super::DecodeError;
use super::document::{Document, Fields, Span, Value};

/// Why a definition cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DefinitionError {
    /// No definition is stored with the messages.
    #[error("the log holds no definition of the message")]
    Empty,
    /// Another language than ROS message definitions.
    #[error("the definition is in {0:?}, of which only ros2msg and ros1msg are read")]
    Language(String),
    /// A line that is no field.
    #[error("line {line} of the definition is no field: {text:?}")]
    Line {
        /// Counted from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// A type that is nowhere defined.
    #[error("the definition uses {0:?} and does not define it")]
    UnknownType(String),
    /// Types inside types without end.
    #[error("the definition of {0:?} holds itself")]
    Recursive(String),
    /// A file descriptor that says something else than the published message.
    #[error("{0}")]
    Mismatch(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Primitive {
    Bool,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
    String,
    WideString,
    /// Two 32-bit numbers; seconds are signed but for ROS 1 stamps.
    Time,
    Duration,
}

impl Primitive {
    fn of(name: &str) -> Option<Self> {
        Some(match name {
            "bool" | "boolean" => Primitive::Bool,
            "int8" => Primitive::I8,
            "uint8" | "byte" | "char" | "octet" => Primitive::U8,
            "int16" => Primitive::I16,
            "uint16" => Primitive::U16,
            "int32" => Primitive::I32,
            "uint32" => Primitive::U32,
            "int64" => Primitive::I64,
            "uint64" => Primitive::U64,
            "float32" => Primitive::F32,
            "float64" => Primitive::F64,
            "string" => Primitive::String,
            "wstring" => Primitive::WideString,
            "time" => Primitive::Time,
            "duration" => Primitive::Duration,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Primitive::Bool | Primitive::I8 | Primitive::U8 => 1,
            Primitive::I16 | Primitive::U16 => 2,
            Primitive::I32 | Primitive::U32 | Primitive::F32 => 4,
            Primitive::I64 | Primitive::U64 | Primitive::F64 => 8,
            // The count that comes first, or the seconds.
            Primitive::String | Primitive::WideString => 4,
            Primitive::Time | Primitive::Duration => 4,
        }
    }

    /// Bytes of one, where all have the same.
    fn fixed_size(self) -> Option<usize> {
        match self {
            Primitive::String | Primitive::WideString => None,
            Primitive::Time | Primitive::Duration => Some(8),
            other => Some(other.size()),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Primitive(Primitive),
    /// Index into the types.
    Message(usize),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Count {
    One,
    Fixed(usize),
    Sequence,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Field {
    name: Span,
    kind: Kind,
    count: Count,
}

/// The layout of a message type, by its definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Definition {
    /// Fields of every type; the message itself is the first.
    types: Vec<Vec<Field>>,
    names: String,
}

/// Of longer lists only this many elements are kept: no sensor's numbers are in longer ones.
const KEPT_ELEMENTS: usize = 64;

impl Definition {
    /// Read a definition with its dependencies. `language` is what the log says it is written in.
    pub fn parse(language: &str, text: &[u8]) -> Result<Self, DefinitionError> {
        if !matches!(language, "ros2msg" | "ros1msg") {
            return Err(DefinitionError::Language(language.into()));
        }
        let text = String::from_utf8_lossy(text);
        let blocks = blocks(&text);
        if text.trim().is_empty() || text.len() > u32::MAX as usize {
            return Err(DefinitionError::Empty);
        }
        let mut definition = Definition {
            types: Vec::new(),
            names: String::new(),
        };
        for (_, lines) in &blocks {
            let mut fields = Vec::new();
            for (number, line) in lines {
                if let Some((kind, count, name)) = field(line, *number)? {
                    let start = definition.names.len();
                    definition.names.push_str(name);
                    fields.push(Field {
                        name: Span::new(start, definition.names.len()),
                        kind: resolve(kind, &blocks)?,
                        count,
                    });
                }
            }
            definition.types.push(fields);
        }
        definition.check_depth(0, &mut Vec::new(), &blocks)?;
        Ok(definition)
    }

    fn check_depth(
        &self,
        index: usize,
        above: &mut Vec<usize>,
        blocks: &[Block<'_>],
    ) -> Result<(), DefinitionError> {
        if above.contains(&index) {
            return Err(DefinitionError::Recursive(blocks[index].0.into()));
        }
        above.push(index);
        for field in &self.types[index] {
            if let Kind::Message(inner) = field.kind {
                self.check_depth(inner, above, blocks)?;
            }
        }
        above.pop();
        Ok(())
    }

    /// The fields of a message in CDR, with its encapsulation header.
    pub fn read_cdr<'a>(
        &'a self,
        document: &'a mut Document,
        message: &'a [u8],
    ) -> Result<Fields<'a>, DecodeError> {
        let Some((header, _)) = message.split_first_chunk::<4>() else {
            return Err(DecodeError::TooShort {
                at: 0,
                missing: 4 - message.len(),
                length: message.len(),
            });
        };
        let big_endian = match u16::from_be_bytes([header[0], header[1]]) {
            0x0000 => true,
            0x0001 => false,
            other => return Err(DecodeError::Encapsulation(other)),
        };
        self.read(document, message, Some(4), big_endian)
    }

    /// The fields of a message in ROS 1's encoding.
    pub fn read_ros1<'a>(
        &'a self,
        document: &'a mut Document,
        message: &'a [u8],
    ) -> Result<Fields<'a>, DecodeError> {
        self.read(document, message, None, false)
    }

    fn read<'a>(
        &'a self,
        document: &'a mut Document,
        message: &'a [u8],
        aligned_from: Option<usize>,
        big_endian: bool,
    ) -> Result<Fields<'a>, DecodeError> {
        document.clear();
        let root = document.push(Span::default(), Value::Object)?;
        let mut walk = Walk {
            types: &self.types,
            message,
            at: aligned_from.unwrap_or(0),
            aligned_from,
            big_endian,
            document,
        };
        walk.fields(0, true)?;
        document.close(root);
        Ok(document.fields(self.names.as_bytes(), message))
    }
}

/// Name of a type, and its lines with their numbers.
type Block<'a> = (&'a str, Vec<(usize, &'a str)>);

fn blocks(text: &str) -> Vec<Block<'_>> {
    let mut blocks: Vec<Block<'_>> = vec![("", Vec::new())];
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.len() >= 3 && line.bytes().all(|b| b == b'=') {
            continue;
        }
        if let Some(name) = line.strip_prefix("MSG:") {
            blocks.push((name.trim(), Vec::new()));
        } else if let Some((_, lines)) = blocks.last_mut() {
            lines.push((index + 1, line));
        }
    }
    blocks
}

/// Type, count and name of the field in a line; `None` for comments and constants.
fn field(line: &str, number: usize) -> Result<Option<(&str, Count, &str)>, DefinitionError> {
    let wrong = || DefinitionError::Line {
        line: number,
        text: line.chars().take(80).collect(),
    };
    if line.is_empty() || line.starts_with('#') {
        return Ok(None);
    }
    let (kind, rest) = line.split_once(char::is_whitespace).ok_or_else(wrong)?;
    let rest = rest.trim_start();
    let name_end = rest
        .find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'))
        .unwrap_or(rest.len());
    let (name, after) = rest.split_at(name_end);
    if name.is_empty() {
        return Err(wrong());
    }
    if after.trim_start().starts_with('=') {
        return Ok(None);
    }
    let (kind, count) = match kind.split_once('[') {
        None => (kind, Count::One),
        Some((kind, bound)) => {
            let bound = bound.strip_suffix(']').ok_or_else(wrong)?;
            if bound.is_empty() || bound.starts_with("<=") {
                (kind, Count::Sequence)
            } else {
                (kind, Count::Fixed(bound.parse().map_err(|_| wrong())?))
            }
        }
    };
    // A bound of a string changes nothing on the wire.
    let kind = kind.split_once("<=").map_or(kind, |(kind, _)| kind);
    Ok(Some((kind, count, name)))
}

fn resolve(kind: &str, blocks: &[Block<'_>]) -> Result<Kind, DefinitionError> {
    if let Some(primitive) = Primitive::of(kind) {
        return Ok(Kind::Primitive(primitive));
    }
    let short = kind.replace("/msg/", "/");
    match short.as_str() {
        "builtin_interfaces/Time" => return Ok(Kind::Primitive(Primitive::Time)),
        "builtin_interfaces/Duration" => return Ok(Kind::Primitive(Primitive::Duration)),
        _ => {}
    }
    let known = |wanted: &str| {
        blocks
            .iter()
            .position(|(name, _)| !name.is_empty() && name.replace("/msg/", "/") == wanted)
    };
    known(&short)
        // Without its package: `Header` of ROS 1, or a message of the same package.
        .or_else(|| {
            (!short.contains('/')).then(|| {
                blocks
                    .iter()
                    .position(|(name, _)| name.rsplit('/').next() == Some(&short))
            })?
        })
        .map(Kind::Message)
        .ok_or_else(|| DefinitionError::UnknownType(kind.into()))
}

struct Walk<'d, 'a> {
    types: &'d [Vec<Field>],
    message: &'a [u8],
    at: usize,
    /// Where alignment counts from; `None`: nothing is aligned (ROS 1).
    aligned_from: Option<usize>,
    big_endian: bool,
    document: &'d mut Document,
}

impl Walk<'_, '_> {
    fn take(&mut self, count: usize) -> Result<usize, DecodeError> {
        let left = self.message.len().saturating_sub(self.at);
        if count > left {
            return Err(DecodeError::TooShort {
                at: self.at,
                missing: count - left,
                length: self.message.len(),
            });
        }
        let start = self.at;
        self.at += count;
        Ok(start)
    }

    fn align(&mut self, size: usize) {
        if let Some(origin) = self.aligned_from {
            self.at = origin + (self.at - origin).next_multiple_of(size);
        }
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        self.align(N);
        let start = self.take(N)?;
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.message[start..start + N]);
        if !self.big_endian {
            bytes.reverse();
        }
        // Most significant first from here on.
        Ok(bytes)
    }

    fn count(&mut self) -> Result<usize, DecodeError> {
        Ok(u32::from_be_bytes(self.array()?) as usize)
    }

    fn fields(&mut self, index: usize, keep: bool) -> Result<(), DecodeError> {
        let types = self.types;
        for field in &types[index] {
            match field.count {
                Count::One => self.one(field.kind, field.name, keep)?,
                Count::Fixed(count) => self.list(field, count, keep)?,
                Count::Sequence => {
                    let count = self.count()?;
                    self.list(field, count, keep)?;
                }
            }
        }
        Ok(())
    }

    fn list(&mut self, field: &Field, count: usize, keep: bool) -> Result<(), DecodeError> {
        let list = match keep {
            true => Some(self.document.push(field.name, Value::Array)?),
            false => None,
        };
        let kept = if keep { count.min(KEPT_ELEMENTS) } else { 0 };
        for _ in 0..kept {
            self.one(field.kind, Span::default(), true)?;
        }
        let rest = count - kept;
        match field.kind {
            Kind::Primitive(primitive) if primitive.fixed_size().is_some() => {
                if rest > 0 {
                    self.align(primitive.size());
                    let size = primitive.fixed_size().unwrap_or(1);
                    self.take(rest.saturating_mul(size))?;
                }
            }
            kind => {
                for _ in 0..rest {
                    let before = self.at;
                    self.one(kind, Span::default(), false)?;
                    if self.at == before {
                        // Elements without content: their number means nothing.
                        break;
                    }
                }
            }
        }
        if let Some(list) = list {
            self.document.close(list);
        }
        Ok(())
    }

    fn one(&mut self, kind: Kind, name: Span, keep: bool) -> Result<(), DecodeError> {
        match kind {
            Kind::Message(inner) if keep => {
                let object = self.document.push(name, Value::Object)?;
                self.fields(inner, true)?;
                self.document.close(object);
                Ok(())
            }
            Kind::Message(inner) => self.fields(inner, false),
            Kind::Primitive(primitive) => {
                let value = self.primitive(primitive)?;
                if keep {
                    self.document.push(name, value)?;
                }
                Ok(())
            }
        }
    }

    fn primitive(&mut self, primitive: Primitive) -> Result<Value, DecodeError> {
        Ok(match primitive {
            Primitive::Bool => Value::Bool(self.array::<1>()?[0] != 0),
            Primitive::I8 => Value::Integer(i8::from_be_bytes(self.array()?).into()),
            Primitive::U8 => Value::Integer(u8::from_be_bytes(self.array()?).into()),
            Primitive::I16 => Value::Integer(i16::from_be_bytes(self.array()?).into()),
            Primitive::U16 => Value::Integer(u16::from_be_bytes(self.array()?).into()),
            Primitive::I32 => Value::Integer(i32::from_be_bytes(self.array()?).into()),
            Primitive::U32 => Value::Integer(u32::from_be_bytes(self.array()?).into()),
            Primitive::I64 => Value::Integer(i64::from_be_bytes(self.array()?)),
            Primitive::U64 => {
                let number = u64::from_be_bytes(self.array()?);
                i64::try_from(number).map_or(Value::Float(number as f64), Value::Integer)
            }
            Primitive::F32 => Value::Float(f32::from_be_bytes(self.array()?).into()),
            Primitive::F64 => Value::Float(f64::from_be_bytes(self.array()?)),
            Primitive::String => {
                let count = self.count()?;
                let start = self.take(count)?;
                // CDR counts a NUL at the end, ROS 1 has none.
                let nul = usize::from(
                    self.aligned_from.is_some() && self.message[start..self.at].last() == Some(&0),
                );
                Value::Text(Span::new(start, self.at - nul))
            }
            Primitive::WideString => {
                let count = self.count()?;
                let start = self.take(count.saturating_mul(4))?;
                Value::Text(Span::new(start, start))
            }
            Primitive::Time | Primitive::Duration => {
                let bytes = self.array()?;
                // Unsigned in the stamps of ROS 1, signed everywhere else.
                let unsigned = self.aligned_from.is_none() && primitive == Primitive::Time;
                let seconds = match unsigned {
                    true => i64::from(u32::from_be_bytes(bytes)),
                    false => i64::from(i32::from_be_bytes(bytes)),
                };
                let nanos: u32 = u32::from_be_bytes(self.array()?);
                Value::Instant(seconds * 1_000_000_000 + i64::from(nanos))
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Wire;
    use insnav_core::time::Time;
    use proptest::prelude::*;

    const TEXT: &str = "\
# A comment
std_msgs/Header header
uint8 ONE = 1
string NAME=a # b
uint8 kind 3
float32[3] rates
Point[] points   # trailing
int16[<=4] some
string<=10 note \"x=y\"
bool ok
uint64 big
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: test_msgs/Point
float64 x
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

    fn cdr() -> Vec<u8> {
        let mut w = crate::cdr::CdrWriter::new(crate::cdr::Endian::Little);
        w.i32(-5);
        w.u32(7);
        w.string("imu");
        w.u8(2);
        for rate in [1.5f32, -2.0, 0.25] {
            w.u32(rate.to_bits());
        }
        w.sequence(2);
        w.f64(10.0);
        w.f64(20.0);
        w.sequence(1);
        w.u16(-3i16 as u16);
        w.string("hello");
        w.u8(1);
        // An unsigned 64-bit number has a double's size and alignment.
        w.f64(f64::from_bits(12_345_678_901));
        w.bytes().to_vec()
    }

    #[test]
    fn fields_are_found_by_the_definition() {
        let definition = Definition::parse("ros2msg", TEXT.as_bytes()).unwrap();
        let message = cdr();
        let mut document = Document::default();
        let mut f = definition.read_cdr(&mut document, &message).unwrap();
        f.nested("header", |f| {
            assert_eq!(f.time("stamp"), Ok(Time(-4_999_999_993)));
            assert_eq!(f.string("frame_id"), Ok("imu"));
            Ok(())
        })
        .unwrap();
        assert_eq!(f.u8("kind"), Ok(2));
        assert_eq!(f.f64_array("rates"), Ok([1.5, -2.0, 0.25]));
        assert_eq!(f.number_at("points.1.x"), Some(20.0));
        assert_eq!(f.number_at("some.0"), Some(-3.0));
        assert_eq!(f.string("note"), Ok("hello"));
        assert_eq!(f.u8("ok"), Ok(1));
        assert_eq!(f.integer_at("big"), Some(12_345_678_901));
        assert!(!f.has("ONE") && !f.has("NAME"));
        for length in 0..message.len() {
            assert!(
                definition
                    .read_cdr(&mut document, &message[..length])
                    .is_err(),
                "{length}"
            );
        }
    }

    #[test]
    fn long_lists_are_passed_over() {
        let definition =
            Definition::parse("ros1msg", b"uint8[] image\ntime[] t\nfloat32 x").unwrap();
        let mut message = 1000u32.to_le_bytes().to_vec();
        message.extend([7; 1000]);
        message.extend(100u32.to_le_bytes());
        message.extend([0; 800]);
        message.extend(2.5f32.to_le_bytes());
        let mut document = Document::default();
        let mut f = definition.read_ros1(&mut document, &message).unwrap();
        assert_eq!(f.f64("x"), Ok(2.5));
        assert_eq!(f.number_at("image.63"), Some(7.0));
        assert_eq!(f.number_at("image.64"), None);
    }

    #[test]
    fn definitions_that_cannot_be_used_say_why() {
        let parse = |text: &str| Definition::parse("ros2msg", text.as_bytes()).unwrap_err();
        assert_eq!(parse(" \n"), DefinitionError::Empty);
        assert_eq!(
            parse("Thing x"),
            DefinitionError::UnknownType("Thing".into())
        );
        assert_eq!(
            parse("uint8[x] a"),
            DefinitionError::Line {
                line: 1,
                text: "uint8[x] a".into()
            }
        );
        assert_eq!(
            parse("A a\n===\nMSG: p/A\nA a"),
            DefinitionError::Recursive("p/A".into())
        );
        assert_eq!(
            Definition::parse("ros2idl", b"struct").unwrap_err(),
            DefinitionError::Language("ros2idl".into())
        );
    }

    #[test]
    fn a_count_of_nothings_ends() {
        let definition = Definition::parse("ros1msg", b"E[] e\n===\nMSG: p/E\n# empty").unwrap();
        let mut document = Document::default();
        assert!(
            definition
                .read_ros1(&mut document, &[255, 255, 255, 255])
                .is_ok()
        );
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(mut bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let definition = Definition::parse("ros2msg", TEXT.as_bytes()).unwrap();
            let mut document = Document::default();
            let _ = definition.read_ros1(&mut document, &bytes);
            if bytes.len() > 4 {
                bytes[..4].copy_from_slice(&[0, 1, 0, 0]);
            }
            let _ = definition.read_cdr(&mut document, &bytes);
        }

        #[test]
        fn no_text_makes_it_panic(text in "(uint8|A|string|=|#|MSG: p/A|\\[|\\]|<=|3| |\n){0,30}") {
            let _ = Definition::parse("ros2msg", text.as_bytes());
        }
    }
}
