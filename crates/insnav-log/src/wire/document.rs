//! A message as a tree of named values, however it was written, and the fields of it by name.

use super::{DecodeError, FieldName, Wire};
use crate::calendar;
use insnav_core::time::Time;

/// A stretch of some text.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Span {
    pub(super) start: u32,
    pub(super) end: u32,
}

impl Span {
    /// Texts of 4 GiB do not occur: MCAP's own lengths are 32 bits, and a longer definition is refused.
    pub(super) fn new(start: usize, end: usize) -> Self {
        Span {
            start: start as u32,
            end: end as u32,
        }
    }

    fn of(self, text: &[u8]) -> &[u8] {
        text.get(self.start as usize..self.end as usize)
            .unwrap_or_default()
    }
}

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value {
    Null,
    Bool(bool),
    Integer(i64),
    Float(f64),
    /// Nanoseconds since the epoch of the clock.
    Instant(i64),
    /// Bytes of the message.
    Text(Span),
    /// Text that is not in the message as such, because it had escapes in it.
    Unescaped(Span),
    /// The fields follow.
    Object,
    /// The elements follow.
    Array,
}

impl Value {
    fn kind(self) -> &'static str {
        match self {
            Value::Null => "null",
            Value::Bool(_) => "true or false",
            Value::Integer(_) | Value::Float(_) => "a number",
            Value::Instant(_) => "an instant",
            Value::Text(_) | Value::Unescaped(_) => "text",
            Value::Object => "an object",
            Value::Array => "a list",
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node {
    /// Name of the field; empty for elements of a list.
    pub(super) key: Span,
    pub(super) value: Value,
    /// Index after the last node inside this one.
    pub(super) end: u32,
}

/// More fields than any message with a sensor's data has.
const MOST_NODES: usize = 1 << 20;

/// A message as a tree of named values. Its memory is kept from message to message.
#[derive(Clone, Debug, Default)]
pub struct Document {
    nodes: Vec<Node>,
    unescaped: String,
}

impl Document {
    pub(super) fn clear(&mut self) {
        self.nodes.clear();
        self.unescaped.clear();
    }

    /// Add a value; returns its index, for [`Document::close`].
    pub(super) fn push(&mut self, key: Span, value: Value) -> Result<usize, DecodeError> {
        let index = self.nodes.len();
        if index == MOST_NODES {
            return Err(DecodeError::TooMuch("a million fields"));
        }
        let end = index as u32 + 1;
        self.nodes.push(Node { key, value, end });
        Ok(index)
    }

    /// Everything that was added since the object or list at `index` is inside it.
    pub(super) fn close(&mut self, index: usize) {
        let end = self.nodes.len() as u32;
        if let Some(node) = self.nodes.get_mut(index) {
            node.end = end;
        }
    }

    pub(super) fn unescaped(&mut self) -> &mut String {
        &mut self.unescaped
    }

    pub(super) fn fields<'a>(&'a self, keys: &'a [u8], message: &'a [u8]) -> Fields<'a> {
        Fields {
            nodes: &self.nodes,
            unescaped: self.unescaped.as_bytes(),
            keys,
            message,
            at: 0,
            cursor: 1,
            parent: "",
        }
    }
}

/// The fields of a message, or of a message inside it, by name.
///
/// Names are compared without case and underscores: `fix_type`, `fixType` and `FixType` are the same field.
#[derive(Clone, Copy, Debug)]
pub struct Fields<'a> {
    nodes: &'a [Node],
    unescaped: &'a [u8],
    keys: &'a [u8],
    message: &'a [u8],
    /// The object.
    at: usize,
    /// Where the next field is expected.
    cursor: usize,
    parent: &'static str,
}

impl<'a> Fields<'a> {
    /// Whether there is a field of this name.
    pub fn has(&mut self, name: &str) -> bool {
        self.find(name).is_some()
    }

    /// The number at a path such as `gyro.x` or `rates.0`; `None` when there is none there.
    pub fn number_at(&self, path: &str) -> Option<f64> {
        as_f64(self.value_at(path)?, |v| self.text_of(v))
    }

    /// The whole number at a path; `None` when there is none there.
    pub fn integer_at(&self, path: &str) -> Option<i64> {
        as_i64(self.value_at(path)?, |v| self.text_of(v))
    }

    /// The instant at a path; `None` when there is none there.
    pub fn time_at(&self, path: &str) -> Option<Time> {
        let index = self.index_at(path)?;
        self.time_of(index)
    }

    /// What is at a path, in words; `None` when there is nothing.
    pub fn kind_at(&self, path: &str) -> Option<&'static str> {
        self.value_at(path).map(Value::kind)
    }

    /// Paths of all numbers, for messages to the user; of long lists only the first elements.
    pub fn number_paths(&self) -> Vec<String> {
        let mut paths = Vec::new();
        self.collect_paths(self.at, "", &mut paths);
        paths
    }

    fn collect_paths(&self, at: usize, prefix: &str, paths: &mut Vec<String>) {
        for (position, index) in self.children(at).enumerate() {
            if paths.len() >= 40 || position >= 24 {
                return;
            }
            let node = &self.nodes[index];
            let name = match self.nodes[at].value {
                Value::Array => position.to_string(),
                _ => String::from_utf8_lossy(node.key.of(self.keys)).into_owned(),
            };
            let path = match prefix {
                "" => name,
                _ => format!("{prefix}.{name}"),
            };
            match node.value {
                Value::Bool(_) | Value::Integer(_) | Value::Float(_) => paths.push(path),
                Value::Object | Value::Array => self.collect_paths(index, &path, paths),
                _ => {}
            }
        }
    }

    fn children(&self, at: usize) -> impl Iterator<Item = usize> + use<'a> {
        let nodes = self.nodes;
        let end = nodes.get(at).map_or(0, |node| node.end as usize);
        let mut next = at + 1;
        std::iter::from_fn(move || {
            let index = (next < end).then_some(next)?;
            // A node ends after itself, so that this advances.
            next = nodes[index].end as usize;
            Some(index)
        })
    }

    fn index_at(&self, path: &str) -> Option<usize> {
        let mut at = self.at;
        for name in path.split('.') {
            at = match self.nodes.get(at)?.value {
                Value::Array => self.children(at).nth(name.parse().ok()?)?,
                _ => self
                    .children(at)
                    .find(|&i| same_name(self.nodes[i].key.of(self.keys), name.as_bytes()))?,
            };
        }
        Some(at)
    }

    fn value_at(&self, path: &str) -> Option<Value> {
        Some(self.nodes[self.index_at(path)?].value)
    }

    fn text_of(&self, value: Value) -> Option<&'a str> {
        let bytes = match value {
            Value::Text(span) => span.of(self.message),
            Value::Unescaped(span) => span.of(self.unescaped),
            _ => return None,
        };
        core::str::from_utf8(bytes).ok()
    }

    fn name(&self, name: &'static str) -> FieldName {
        FieldName {
            parent: self.parent,
            name,
        }
    }

    fn wrong(&self, name: &'static str, index: usize, expected: &'static str) -> DecodeError {
        DecodeError::Kind {
            field: self.name(name),
            expected,
            found: self.nodes[index].value.kind(),
        }
    }

    /// The field of this name. Messages keep their order of fields, so that the next one is nearly always the right one.
    #[inline]
    fn find(&mut self, name: &str) -> Option<usize> {
        let end = self.nodes.get(self.at)?.end as usize;
        let is = |index: usize| same_name(self.nodes[index].key.of(self.keys), name.as_bytes());
        if self.nodes[self.at].value != Value::Object {
            return None;
        }
        let found = if self.cursor < end && is(self.cursor) {
            self.cursor
        } else {
            self.children(self.at).find(|&index| is(index))?
        };
        self.cursor = self.nodes[found].end as usize;
        Some(found)
    }

    #[inline]
    fn require(&mut self, name: &'static str) -> Result<usize, DecodeError> {
        self.find(name).ok_or(DecodeError::Missing(self.name(name)))
    }

    fn integer<T: TryFrom<i64>>(
        &mut self,
        name: &'static str,
        expected: &'static str,
    ) -> Result<T, DecodeError> {
        let index = self.require(name)?;
        as_i64(self.nodes[index].value, |v| self.text_of(v))
            .and_then(|number| T::try_from(number).ok())
            .ok_or(self.wrong(name, index, expected))
    }

    fn float(&self, name: &'static str, index: usize) -> Result<f64, DecodeError> {
        as_f64(self.nodes[index].value, |v| self.text_of(v))
            .ok_or(self.wrong(name, index, "a number"))
    }

    fn inside(&self, index: usize, parent: &'static str) -> Self {
        Fields {
            at: index,
            cursor: index + 1,
            parent,
            ..*self
        }
    }

    /// `{sec, nanosec}` under any of the names in use, seconds as a number, or RFC 3339.
    fn time_of(&self, index: usize) -> Option<Time> {
        let number = |name: &str| {
            let mut fields = self.inside(index, "");
            let found = fields.find(name)?;
            as_i64(self.nodes[found].value, |v| self.text_of(v))
        };
        match self.nodes[index].value {
            Value::Instant(ns) => Some(Time(ns)),
            Value::Object => {
                let seconds = ["sec", "secs", "seconds"].iter().find_map(|n| number(n))?;
                let nanos = ["nanosec", "nsec", "nsecs", "nanos", "nanoseconds"]
                    .iter()
                    .find_map(|n| number(n))
                    .unwrap_or(0);
                Some(Time(
                    seconds.checked_mul(1_000_000_000)?.checked_add(nanos)?,
                ))
            }
            // Later than the year 5000, it is no number of seconds.
            Value::Integer(s) if s.abs() < 100_000_000_000 => Some(Time(s * 1_000_000_000)),
            Value::Float(s) if s.abs() < 1e11 => Some(seconds_to_time(s)),
            value => rfc_3339(self.text_of(value)?),
        }
    }
}

/// Whole seconds and their fraction apart, so that the product does not round the double a second time.
fn seconds_to_time(seconds: f64) -> Time {
    let whole = seconds.floor();
    Time(whole as i64 * 1_000_000_000 + ((seconds - whole) * 1e9).round() as i64)
}

/// `2020-09-13T12:26:40.5Z`, the way protobuf writes a time in JSON; other offsets than Z are not in use there.
fn rfc_3339(text: &str) -> Option<Time> {
    let (date, time) = text.strip_suffix(['Z', 'z'])?.split_once(['T', 't'])?;
    let mut date = date.splitn(3, '-').map(|part| part.parse::<u32>().ok());
    let (year, month, day) = (date.next()??, date.next()??, date.next()??);
    let year = i64::from(year);
    let mut time = time.splitn(3, ':');
    let (hour, minute) = (
        time.next()?.parse::<i64>().ok()?,
        time.next()?.parse::<i64>().ok()?,
    );
    let second = time.next()?;
    let (second, fraction) = second.split_once('.').unwrap_or((second, ""));
    let second = second.parse::<i64>().ok()?;
    if fraction.len() > 9 || !fraction.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let nanos = format!("{fraction:0<9}").parse::<i64>().ok()?;
    let clock = (0..24).contains(&hour) && (0..60).contains(&minute) && (0..=60).contains(&second);
    let day = calendar::day_of(year, month, day).filter(|_| clock)?;
    let seconds = hour * 3600 + minute * 60 + second;
    calendar::at(day, seconds * 1_000_000_000 + nanos)
}

/// Whether two names are the same but for case and underscores.
#[inline]
fn same_name(a: &[u8], b: &[u8]) -> bool {
    if a == b {
        return true;
    }
    letters(a).eq(letters(b))
}

fn letters(name: &[u8]) -> impl Iterator<Item = u8> {
    name.iter()
        .filter(|letter| **letter != b'_')
        .map(u8::to_ascii_lowercase)
}

fn as_i64<'a>(value: Value, text: impl Fn(Value) -> Option<&'a str>) -> Option<i64> {
    match value {
        Value::Integer(i) => Some(i),
        Value::Bool(b) => Some(i64::from(b)),
        Value::Float(x) if x.fract() == 0.0 && x.abs() < 9e15 => Some(x as i64),
        // Protobuf writes 64-bit numbers as text in JSON.
        _ => text(value)?.parse().ok(),
    }
}

fn as_f64<'a>(value: Value, text: impl Fn(Value) -> Option<&'a str>) -> Option<f64> {
    match value {
        Value::Integer(i) => Some(i as f64),
        Value::Float(x) => Some(x),
        Value::Bool(b) => Some(f64::from(u8::from(b))),
        // The way out for writers whose JSON has no NaN.
        Value::Null => Some(f64::NAN),
        _ => text(value)?.parse().ok(),
    }
}

impl<'a> Wire<'a> for Fields<'a> {
    fn i8(&mut self, field: &'static str) -> Result<i8, DecodeError> {
        self.integer(field, "a whole number from -128 to 127")
    }

    fn u8(&mut self, field: &'static str) -> Result<u8, DecodeError> {
        self.integer(field, "a whole number from 0 to 255")
    }

    fn u16(&mut self, field: &'static str) -> Result<u16, DecodeError> {
        self.integer(field, "a whole number from 0 to 65535")
    }

    fn f32(&mut self, field: &'static str) -> Result<f32, DecodeError> {
        Ok(self.f64(field)? as f32)
    }

    fn f64(&mut self, field: &'static str) -> Result<f64, DecodeError> {
        let index = self.require(field)?;
        self.float(field, index)
    }

    fn f64_array<const N: usize>(&mut self, field: &'static str) -> Result<[f64; N], DecodeError> {
        let index = self.require(field)?;
        // A typed array of JavaScript becomes an object with the keys "0", "1" and so on.
        if !matches!(self.nodes[index].value, Value::Array | Value::Object) {
            return Err(self.wrong(field, index, "a list of numbers"));
        }
        let mut values = [0.0; N];
        let mut count = 0;
        for child in self.children(index) {
            let value = self.float(field, child)?;
            if let Some(place) = values.get_mut(count) {
                *place = value;
            }
            count += 1;
        }
        if count == N {
            Ok(values)
        } else {
            Err(DecodeError::Kind {
                field: self.name(field),
                expected: match N {
                    3 => "a list of 3 numbers",
                    9 => "a list of 9 numbers",
                    36 => "a list of 36 numbers",
                    _ => "a list of that many numbers",
                },
                found: "of another length",
            })
        }
    }

    fn components<const N: usize>(
        &mut self,
        field: &'static str,
        names: [&'static str; N],
    ) -> Result<[f64; N], DecodeError> {
        let index = self.require(field)?;
        match self.nodes[index].value {
            Value::Object => {
                let mut inside = self.inside(index, field);
                let mut values = [0.0; N];
                for (value, name) in values.iter_mut().zip(names) {
                    *value = inside.f64(name)?;
                }
                Ok(values)
            }
            Value::Array => self.f64_array(field),
            _ => Err(self.wrong(field, index, "an object with x, y, z")),
        }
    }

    fn string(&mut self, field: &'static str) -> Result<&'a str, DecodeError> {
        let index = self.require(field)?;
        self.text_of(self.nodes[index].value)
            .ok_or(self.wrong(field, index, "text"))
    }

    fn time(&mut self, field: &'static str) -> Result<Time, DecodeError> {
        let index = self.require(field)?;
        self.time_of(index)
            .ok_or(self.wrong(field, index, "an instant {sec, nanosec}"))
    }

    fn nested<T>(
        &mut self,
        field: &'static str,
        read: impl FnOnce(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<T, DecodeError> {
        let index = self.require(field)?;
        if self.nodes[index].value != Value::Object {
            return Err(self.wrong(field, index, "an object"));
        }
        read(&mut self.inside(index, field))
    }

    fn elements<T>(
        &mut self,
        field: &'static str,
        _: usize,
        mut read: impl FnMut(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<Vec<T>, DecodeError> {
        let index = self.require(field)?;
        if self.nodes[index].value != Value::Array {
            return Err(self.wrong(field, index, "a list"));
        }
        self.children(index)
            .map(|child| read(&mut self.inside(child, field)))
            .collect()
    }

    fn or_absent<T>(
        &mut self,
        absent: T,
        read: impl FnOnce(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<T, DecodeError> {
        match read(self) {
            Err(DecodeError::Missing(_)) => Ok(absent),
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::read_json;
    use super::*;

    fn with<T>(text: &str, read: impl FnOnce(Fields<'_>) -> T) -> T {
        let mut document = Document::default();
        read(read_json(&mut document, text.as_bytes()).unwrap())
    }

    #[test]
    fn names_are_the_same_in_every_style() {
        with(r#"{"fix_type": 3, "velN": 5, "h_acc": 7}"#, |mut f| {
            assert_eq!(f.u8("fixType"), Ok(3));
            assert_eq!(f.f64("vel_n"), Ok(5.0));
            assert_eq!(f.u16("hAcc"), Ok(7));
            assert_eq!(
                f.f64("velE").unwrap_err().to_string(),
                "there is no field velE"
            );
        });
    }

    #[test]
    fn errors_name_the_field_where_it_is() {
        with(
            r#"{"a": {"x": 1, "y": "up", "z": 3}, "l": [1, 2]}"#,
            |mut f| {
                let error = f.components("a", ["x", "y", "z"]).unwrap_err();
                assert_eq!(
                    error.to_string(),
                    "field a.y is text, where a number is expected"
                );
                assert!(f.f64_array::<3>("l").is_err());
                assert_eq!(f.f64_array::<2>("l"), Ok([1.0, 2.0]));
                assert!(f.u8("a").is_err());
            },
        );
    }

    #[test]
    fn instants_in_all_their_clothes() {
        for (text, ns) in [
            (r#"{"t": {"sec": 5, "nanosec": 7}}"#, 5_000_000_007),
            (r#"{"t": {"secs": 5, "nsecs": 7}}"#, 5_000_000_007),
            (r#"{"t": {"seconds": "5", "nanos": 7}}"#, 5_000_000_007),
            (r#"{"t": 5}"#, 5_000_000_000),
            (r#"{"t": 5.25}"#, 5_250_000_000),
            (r#"{"t": "1970-01-01T00:00:05.000000007Z"}"#, 5_000_000_007),
            (
                r#"{"t": "2020-09-13T12:26:40Z"}"#,
                1_600_000_000_000_000_000,
            ),
            (
                r#"{"t": "2024-02-29T23:59:60.5Z"}"#,
                1_709_251_200_500_000_000,
            ),
        ] {
            with(text, |mut f| {
                assert_eq!(f.time("t"), Ok(Time(ns)), "{text}")
            });
        }
        for text in [
            r#"{"t": "yesterday"}"#,
            r#"{"t": 1600000000000000000}"#,
            r#"{"t": [1]}"#,
            r#"{"t": {"x": 1}}"#,
            r#"{"t": "2020-13-13T12:26:40Z"}"#,
        ] {
            with(text, |mut f| assert!(f.time("t").is_err(), "{text}"));
        }
    }

    #[test]
    fn paths_lead_through_objects_and_lists() {
        with(
            r#"{"a": [{"b": 1.5}, {"b": 2.5}], "c": null, "d": "4"}"#,
            |f| {
                assert_eq!(f.number_at("a.1.b"), Some(2.5));
                assert_eq!(f.number_at("a.2.b"), None);
                assert!(f.number_at("c").unwrap().is_nan());
                assert_eq!(f.integer_at("d"), Some(4));
                assert_eq!(f.number_paths(), ["a.0.b", "a.1.b"]);
            },
        );
    }
}
