//! The wire format of ROS 1: fields packed one after the other, least significant byte first, no alignment, no header.
//!
//! Strings and sequences are a 32-bit count and their contents; a string has no NUL. A `Header` begins with a sequence
//! number that ROS 2 dropped; seconds of a stamp are unsigned.

use super::{DecodeError, Wire};
use insnav_core::time::Time;

/// Reads fields one after the other from the bytes of one message.
#[derive(Clone, Debug)]
pub struct Ros1Reader<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Ros1Reader<'a> {
    /// A cursor at the first field of a message.
    pub fn new(message: &'a [u8]) -> Self {
        Ros1Reader {
            body: message,
            at: 0,
        }
    }

    #[inline]
    fn take(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        match self.body.get(self.at..).and_then(|rest| rest.get(..count)) {
            Some(bytes) => {
                self.at += count;
                Ok(bytes)
            }
            None => Err(self.too_short(count)),
        }
    }

    #[inline]
    fn array<const N: usize>(&mut self) -> Result<[u8; N], DecodeError> {
        match self
            .body
            .get(self.at..)
            .and_then(|rest| rest.first_chunk::<N>())
        {
            Some(bytes) => {
                self.at += N;
                Ok(*bytes)
            }
            None => Err(self.too_short(N)),
        }
    }

    #[cold]
    fn too_short(&self, count: usize) -> DecodeError {
        DecodeError::TooShort {
            at: self.at,
            missing: count.saturating_sub(self.body.len() - self.at),
            length: self.body.len(),
        }
    }

    #[inline]
    fn count(&mut self) -> Result<usize, DecodeError> {
        Ok(u32::from_le_bytes(self.array()?) as usize)
    }
}

impl<'a> Wire<'a> for Ros1Reader<'a> {
    #[inline]
    fn i8(&mut self, _: &'static str) -> Result<i8, DecodeError> {
        Ok(i8::from_le_bytes(self.array()?))
    }

    #[inline]
    fn u8(&mut self, _: &'static str) -> Result<u8, DecodeError> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    #[inline]
    fn u16(&mut self, _: &'static str) -> Result<u16, DecodeError> {
        Ok(u16::from_le_bytes(self.array()?))
    }

    #[inline]
    fn f32(&mut self, _: &'static str) -> Result<f32, DecodeError> {
        Ok(f32::from_le_bytes(self.array()?))
    }

    #[inline]
    fn f64(&mut self, _: &'static str) -> Result<f64, DecodeError> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    #[inline]
    fn f64_array<const N: usize>(&mut self, _: &'static str) -> Result<[f64; N], DecodeError> {
        let (words, _) = self.take(8 * N)?.as_chunks::<8>();
        let mut values = [0.0; N];
        for (value, word) in values.iter_mut().zip(words) {
            *value = f64::from_le_bytes(*word);
        }
        Ok(values)
    }

    #[inline]
    fn components<const N: usize>(
        &mut self,
        field: &'static str,
        _: [&'static str; N],
    ) -> Result<[f64; N], DecodeError> {
        self.f64_array(field)
    }

    #[inline]
    fn string(&mut self, _: &'static str) -> Result<&'a str, DecodeError> {
        let count = self.count()?;
        let at = self.at;
        core::str::from_utf8(self.take(count)?).map_err(|_| DecodeError::BadString { at })
    }

    #[inline]
    fn time(&mut self, _: &'static str) -> Result<Time, DecodeError> {
        let seconds = u32::from_le_bytes(self.array()?);
        let nanos = u32::from_le_bytes(self.array()?);
        Ok(Time(i64::from(seconds) * 1_000_000_000 + i64::from(nanos)))
    }

    #[inline]
    fn nested<T>(
        &mut self,
        _: &'static str,
        read: impl FnOnce(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<T, DecodeError> {
        read(self)
    }

    fn elements<T>(
        &mut self,
        _: &'static str,
        smallest: usize,
        mut read: impl FnMut(&mut Self) -> Result<T, DecodeError>,
    ) -> Result<Vec<T>, DecodeError> {
        let count = self.count()?;
        let needed = count.saturating_mul(smallest);
        if needed > self.body.len() - self.at {
            return Err(self.too_short(needed));
        }
        (0..count).map(|_| read(self)).collect()
    }

    #[inline]
    fn sequence_number(&mut self) -> Result<(), DecodeError> {
        self.array::<4>().map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::{Decode, Header};

    #[test]
    fn nothing_is_aligned_and_strings_have_no_nul() {
        let mut message = vec![7, 2, 0, 0, 0, b'a', b'b'];
        message.extend_from_slice(&1.5f64.to_le_bytes());
        let mut reader = Ros1Reader::new(&message);
        assert_eq!(reader.u8("").unwrap(), 7);
        assert_eq!(reader.string("").unwrap(), "ab");
        assert_eq!(reader.f64("").unwrap(), 1.5);
        assert_eq!(
            reader.u16(""),
            Err(DecodeError::TooShort {
                at: 15,
                missing: 2,
                length: 15
            })
        );
    }

    #[test]
    fn a_header_begins_with_its_number() {
        let message = [9, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 1, 0, 0, 0, b'x'];
        let header = Header::read(&mut Ros1Reader::new(&message)).unwrap();
        assert_eq!(
            header,
            Header {
                stamp: Time(2_000_000_003),
                frame_id: "x"
            }
        );
    }

    #[test]
    fn a_count_beyond_the_message_reserves_nothing() {
        let message = [255, 255, 255, 255, 0];
        assert!(Ros1Reader::new(&message).string("").is_err());
        let mut reader = Ros1Reader::new(&message);
        assert!(reader.elements("", 1, |w| w.u8("")).is_err());
        let mut reader = Ros1Reader::new(&message);
        assert!(reader.elements("", usize::MAX, |w| w.u8("")).is_err());
    }
}
