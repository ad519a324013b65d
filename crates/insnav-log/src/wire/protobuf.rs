//! Protobuf (\[Protobuf\]): fields by number, of which one message type is known here.
//!
//! `foxglove.LocationFix` has kept its numbers since it was published; where the log has the type's descriptor, they are
//! checked against it.

use super::DecodeError;
use super::definition::DefinitionError;
use super::document::{Document, Fields, Span, Value};

/// Bytes of one message, field by field.
#[derive(Clone, Debug)]
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Where the bytes begin in the whole message.
    origin: usize,
}

/// The content of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Content<'a> {
    Varint(u64),
    Fixed64([u8; 8]),
    /// Where it begins in the whole message, and the bytes.
    Bytes(usize, &'a [u8]),
    Fixed32([u8; 4]),
}

impl<'a> Cursor<'a> {
    fn new(bytes: &'a [u8], origin: usize) -> Self {
        Cursor {
            bytes,
            at: 0,
            origin,
        }
    }

    fn fault(&self, reason: &'static str) -> DecodeError {
        DecodeError::Protobuf {
            at: self.origin + self.at,
            reason,
        }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        let bytes = self
            .bytes
            .get(self.at..)
            .and_then(|rest| rest.get(..count))
            .ok_or(self.fault("it ends too early"))?;
        self.at += count;
        Ok(bytes)
    }

    fn varint(&mut self) -> Result<u64, DecodeError> {
        let mut value = 0u64;
        for shift in (0..64).step_by(7) {
            let byte = self.take(1)?[0];
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(self.fault("a number of more than ten bytes"))
    }

    /// Number and content of the next field; `None` at the end.
    fn next(&mut self) -> Result<Option<(u32, Content<'a>)>, DecodeError> {
        if self.at == self.bytes.len() {
            return Ok(None);
        }
        let key = self.varint()?;
        let number = u32::try_from(key >> 3)
            .ok()
            .filter(|number| *number > 0)
            .ok_or(self.fault("a field number that cannot be"))?;
        let content = match key & 7 {
            0 => Content::Varint(self.varint()?),
            1 => Content::Fixed64(self.fixed()?),
            2 => {
                let length = usize::try_from(self.varint()?)
                    .map_err(|_| self.fault("a length that cannot be"))?;
                let origin = self.origin + self.at;
                Content::Bytes(origin, self.take(length)?)
            }
            5 => Content::Fixed32(self.fixed()?),
            _ => return Err(self.fault("a kind of field that is not in use")),
        };
        Ok(Some((number, content)))
    }

    fn fixed<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        let mut fixed = [0; N];
        fixed.copy_from_slice(self.take(N)?);
        Ok(fixed)
    }
}

/// Names of the fields that are read; a field's place here is how it is known below.
const NAMES: [(&str, u32, u64); 7] = [
    // Name, number, type: 1 double, 9 text, 11 message, 14 enumeration.
    ("latitude", 1, 1),
    ("longitude", 2, 1),
    ("altitude", 3, 1),
    ("position_covariance", 4, 1),
    ("position_covariance_type", 5, 14),
    ("timestamp", 6, 11),
    ("frame_id", 7, 9),
];
/// The same names, one after the other, as keys of a document.
const KEYS: &[u8] =
    b"latitudelongitudealtitudeposition_covarianceposition_covariance_typetimestampframe_id";

fn key(number: u32) -> Span {
    let mut start = 0;
    for (name, known, _) in NAMES {
        if known == number {
            return Span::new(start, start + name.len());
        }
        start += name.len();
    }
    Span::default()
}

/// Proof that a log's descriptor has the fields of `foxglove.LocationFix` under their published numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LocationFixLayout(());

impl LocationFixLayout {
    /// Check a `FileDescriptorSet`; a log without one is taken at its word.
    pub fn check(descriptor_set: &[u8]) -> Result<Self, DefinitionError> {
        let unread = |e: DecodeError| {
            DefinitionError::Mismatch(format!("the log's descriptor cannot be read: {e}"))
        };
        let fields = location_fix_fields(descriptor_set).map_err(unread)?;
        if descriptor_set.is_empty() {
            return Ok(LocationFixLayout(()));
        }
        if fields.is_empty() {
            return Err(DefinitionError::Mismatch(
                "the log's descriptor does not describe foxglove.LocationFix".into(),
            ));
        }
        for (name, number, kind) in NAMES {
            match fields.iter().find(|(other, ..)| *other == name.as_bytes()) {
                Some((_, n, k)) if (*n, *k) != (u64::from(number), kind) => {
                    return Err(DefinitionError::Mismatch(format!(
                        "in the log's descriptor, {name} is field {n} of type {k}, and in the published message field \
                         {number} of type {kind}"
                    )));
                }
                // Older versions of the message lack some; they have the position.
                None if number <= 2 => {
                    return Err(DefinitionError::Mismatch(format!(
                        "the log's descriptor has no field {name}"
                    )));
                }
                _ => {}
            }
        }
        Ok(LocationFixLayout(()))
    }
}

/// Name, number and type of a field.
type FieldLayout<'a> = (&'a [u8], u64, u64);

/// Every field of the message named `LocationFix` in a set of file descriptors.
fn location_fix_fields(set: &[u8]) -> Result<Vec<FieldLayout<'_>>, DecodeError> {
    let mut fields = Vec::new();
    let mut files = Cursor::new(set, 0);
    while let Some((number, content)) = files.next()? {
        let (1, Content::Bytes(origin, file)) = (number, content) else {
            continue;
        };
        let mut parts = Cursor::new(file, origin);
        while let Some((number, content)) = parts.next()? {
            let (4, Content::Bytes(origin, message)) = (number, content) else {
                continue;
            };
            let (mut name, mut of_message) = (&b""[..], Vec::new());
            let mut parts = Cursor::new(message, origin);
            while let Some((number, content)) = parts.next()? {
                match (number, content) {
                    (1, Content::Bytes(_, text)) => name = text,
                    (2, Content::Bytes(origin, field)) => {
                        of_message.push(descriptor_of_field(field, origin)?)
                    }
                    _ => {}
                }
            }
            if name == b"LocationFix" {
                fields = of_message;
            }
        }
    }
    Ok(fields)
}

fn descriptor_of_field(field: &[u8], origin: usize) -> Result<(&[u8], u64, u64), DecodeError> {
    let mut found = (&b""[..], 0, 0);
    let mut parts = Cursor::new(field, origin);
    while let Some((number, content)) = parts.next()? {
        match (number, content) {
            (1, Content::Bytes(_, text)) => found.0 = text,
            (3, Content::Varint(value)) => found.1 = value,
            (5, Content::Varint(value)) => found.2 = value,
            _ => {}
        }
    }
    Ok(found)
}

/// The fields of a `foxglove.LocationFix`. What the writer left out has the value zero, as protobuf has it.
pub fn read_location_fix<'a>(
    _: LocationFixLayout,
    document: &'a mut Document,
    message: &'a [u8],
) -> Result<Fields<'a>, DecodeError> {
    document.clear();
    let root = document.push(Span::default(), Value::Object)?;
    let mut cursor = Cursor::new(message, 0);
    let mut numbers = [0.0; 3];
    let mut covariance = [0.0; 9];
    let mut covariance_count = 0;
    let mut covariance_type = 0;
    let mut stamp = 0i64;
    let mut frame = Span::default();
    while let Some((number, content)) = cursor.next()? {
        match (number, content) {
            (1..=3, Content::Fixed64(bytes)) => {
                numbers[number as usize - 1] = f64::from_le_bytes(bytes)
            }
            (4, Content::Fixed64(bytes)) => keep(
                &mut covariance,
                &mut covariance_count,
                f64::from_le_bytes(bytes),
            ),
            (4, Content::Bytes(_, packed)) => {
                let (words, rest) = packed.as_chunks::<8>();
                if !rest.is_empty() {
                    return Err(cursor.fault("a list of doubles that is cut off"));
                }
                for word in words {
                    keep(
                        &mut covariance,
                        &mut covariance_count,
                        f64::from_le_bytes(*word),
                    );
                }
            }
            (5, Content::Varint(value)) => covariance_type = value.min(255) as i64,
            (6, Content::Bytes(origin, bytes)) => stamp = timestamp(bytes, origin)?,
            (7, Content::Bytes(origin, bytes)) => frame = Span::new(origin, origin + bytes.len()),
            (1..=7, _) => return Err(cursor.fault("a field of another kind than published")),
            _ => {}
        }
    }
    for (number, value) in [1, 2, 3].into_iter().zip(numbers) {
        document.push(key(number), Value::Float(value))?;
    }
    // None, or one that is no 3 × 3: there is none.
    if covariance_count == 9 {
        let list = document.push(key(4), Value::Array)?;
        for value in covariance {
            document.push(Span::default(), Value::Float(value))?;
        }
        document.close(list);
        document.push(key(5), Value::Integer(covariance_type))?;
    }
    document.push(key(6), Value::Instant(stamp))?;
    document.push(key(7), Value::Text(frame))?;
    document.close(root);
    Ok(document.fields(KEYS, message))
}

fn keep(covariance: &mut [f64; 9], count: &mut usize, value: f64) {
    if let Some(place) = covariance.get_mut(*count) {
        *place = value;
    }
    *count += 1;
}

/// `google.protobuf.Timestamp`: seconds and nanoseconds.
fn timestamp(bytes: &[u8], origin: usize) -> Result<i64, DecodeError> {
    let mut cursor = Cursor::new(bytes, origin);
    let (mut seconds, mut nanos) = (0i64, 0i64);
    while let Some((number, content)) = cursor.next()? {
        match (number, content) {
            // Negative numbers are written as their 64-bit complement.
            (1, Content::Varint(value)) => seconds = value as i64,
            (2, Content::Varint(value)) => nanos = value as i64,
            (1 | 2, _) => return Err(cursor.fault("a field of another kind than published")),
            _ => {}
        }
    }
    seconds
        .checked_mul(1_000_000_000)
        .and_then(|ns| ns.checked_add(nanos))
        .ok_or(cursor.fault("an instant that cannot be"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Wire;
    use proptest::prelude::*;

    #[test]
    fn keys_are_the_names() {
        for (name, number, _) in NAMES {
            let mut document = Document::default();
            let root = document.push(Span::default(), Value::Object).unwrap();
            document.push(key(number), Value::Integer(1)).unwrap();
            document.close(root);
            assert!(document.fields(KEYS, &[]).has(name), "{name}");
        }
    }

    #[test]
    fn an_empty_message_is_all_zeros() {
        let mut document = Document::default();
        let layout = LocationFixLayout::check(&[]).unwrap();
        let mut fields = read_location_fix(layout, &mut document, &[]).unwrap();
        assert_eq!(fields.f64("latitude"), Ok(0.0));
        assert_eq!(fields.string("frame_id"), Ok(""));
        assert!(!fields.has("position_covariance"));
    }

    #[test]
    fn numbers_that_cannot_be_are_refused() {
        let mut document = Document::default();
        let layout = LocationFixLayout(());
        for bytes in [
            &[0x08, 1][..],                      // latitude as a whole number
            &[0x09, 1, 2, 3],                    // a double of three bytes
            &[0x22, 3, 0, 0, 0],                 // doubles of three bytes
            &[0x00],                             // field number zero
            &[0x0b],                             // a group
            &[0x80; 11],                         // a number without end
            &[0x32, 0xff, 0xff, 0xff, 0xff, 15], // 4 GB of instant
        ] {
            assert!(
                read_location_fix(layout, &mut document, bytes).is_err(),
                "{bytes:x?}"
            );
        }
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in proptest::collection::vec(any::<u8>(), 0..100)) {
            let mut document = Document::default();
            let _ = read_location_fix(LocationFixLayout(()), &mut document, &bytes);
            let _ = LocationFixLayout::check(&bytes);
        }
    }
}
