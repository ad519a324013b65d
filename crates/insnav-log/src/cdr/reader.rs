//! The reading cursor.

use crate::wire::{DecodeError, Wire};
use insnav_core::time::Time;

/// Reads fields one after the other from the bytes of one message.
#[derive(Clone, Debug)]
pub struct CdrReader<'a> {
    /// The message without its encapsulation header, so that offsets here are what alignment counts.
    body: &'a [u8],
    at: usize,
    big_endian: bool,
}

macro_rules! scalar {
    ($(#[$doc:meta])* $name:ident, $type:ty) => {
        $(#[$doc])*
        #[inline]
        pub fn $name(&mut self) -> Result<$type, DecodeError> {
            self.align(size_of::<$type>());
            let bytes = *self.take_array()?;
            Ok(if self.big_endian { <$type>::from_be_bytes(bytes) } else { <$type>::from_le_bytes(bytes) })
        }
    };
}

impl<'a> CdrReader<'a> {
    /// A cursor at the first field of a message, which begins with the encapsulation header.
    pub fn new(message: &'a [u8]) -> Result<Self, DecodeError> {
        let Some((header, body)) = message.split_first_chunk::<4>() else {
            return Err(DecodeError::TooShort {
                at: 0,
                missing: 4 - message.len(),
                length: message.len(),
            });
        };
        match u16::from_be_bytes([header[0], header[1]]) {
            0x0000 => Ok(CdrReader {
                body,
                at: 0,
                big_endian: true,
            }),
            0x0001 => Ok(CdrReader {
                body,
                at: 0,
                big_endian: false,
            }),
            other => Err(DecodeError::Encapsulation(other)),
        }
    }

    #[inline]
    fn align(&mut self, size: usize) {
        self.at = self.at.next_multiple_of(size);
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
    fn take_array<const N: usize>(&mut self) -> Result<&'a [u8; N], DecodeError> {
        match self
            .body
            .get(self.at..)
            .and_then(|rest| rest.first_chunk::<N>())
        {
            Some(bytes) => {
                self.at += N;
                Ok(bytes)
            }
            None => Err(self.too_short(N)),
        }
    }

    #[cold]
    fn too_short(&self, count: usize) -> DecodeError {
        let available = self.body.len().saturating_sub(self.at);
        DecodeError::TooShort {
            at: self.at + 4,
            missing: count - available,
            length: self.body.len() + 4,
        }
    }

    scalar!(
        /// An unsigned byte.
        u8, u8
    );
    scalar!(
        /// A signed byte.
        i8, i8
    );
    scalar!(
        /// A 16-bit unsigned number.
        u16, u16
    );
    scalar!(
        /// A 32-bit signed number.
        i32, i32
    );
    scalar!(
        /// A 32-bit unsigned number.
        u32, u32
    );
    scalar!(
        /// A 32-bit floating-point number.
        f32, f32
    );
    scalar!(
        /// A 64-bit floating-point number.
        f64, f64
    );

    /// `N` consecutive numbers, checked once for all of them.
    #[inline]
    pub fn f64_array<const N: usize>(&mut self) -> Result<[f64; N], DecodeError> {
        self.align(8);
        let bytes = self.take(8 * N)?;
        let (words, _) = bytes.as_chunks::<8>();
        let mut values = [0.0; N];
        for (value, word) in values.iter_mut().zip(words) {
            *value = if self.big_endian {
                f64::from_be_bytes(*word)
            } else {
                f64::from_le_bytes(*word)
            };
        }
        Ok(values)
    }

    /// A string, without its NUL. A length of zero, which some writers use for the empty string, is read as such.
    #[inline]
    pub fn string(&mut self) -> Result<&'a str, DecodeError> {
        let length = self.u32()? as usize;
        let at = self.at + 4;
        match self.take(length)? {
            [] => Ok(""),
            [text @ .., 0] => core::str::from_utf8(text).map_err(|_| DecodeError::BadString { at }),
            _ => Err(DecodeError::BadString { at }),
        }
    }

    /// The number of elements of a sequence whose elements take at least `smallest` bytes each.
    ///
    /// A count that cannot fit into what is left is refused here, so that no caller reserves memory for it.
    pub fn sequence(&mut self, smallest: usize) -> Result<usize, DecodeError> {
        let count = self.u32()? as usize;
        let needed = count.saturating_mul(smallest);
        if needed > self.body.len() - self.at {
            Err(self.too_short(needed))
        } else {
            Ok(count)
        }
    }
}

/// The fields in order; their names are for wires that have them.
impl<'a> Wire<'a> for CdrReader<'a> {
    #[inline]
    fn i8(&mut self, _: &'static str) -> Result<i8, DecodeError> {
        CdrReader::i8(self)
    }

    #[inline]
    fn u8(&mut self, _: &'static str) -> Result<u8, DecodeError> {
        CdrReader::u8(self)
    }

    #[inline]
    fn u16(&mut self, _: &'static str) -> Result<u16, DecodeError> {
        CdrReader::u16(self)
    }

    #[inline]
    fn f32(&mut self, _: &'static str) -> Result<f32, DecodeError> {
        CdrReader::f32(self)
    }

    #[inline]
    fn f64(&mut self, _: &'static str) -> Result<f64, DecodeError> {
        CdrReader::f64(self)
    }

    #[inline]
    fn f64_array<const N: usize>(&mut self, _: &'static str) -> Result<[f64; N], DecodeError> {
        CdrReader::f64_array(self)
    }

    #[inline]
    fn components<const N: usize>(
        &mut self,
        _: &'static str,
        _: [&'static str; N],
    ) -> Result<[f64; N], DecodeError> {
        CdrReader::f64_array(self)
    }

    #[inline]
    fn string(&mut self, _: &'static str) -> Result<&'a str, DecodeError> {
        CdrReader::string(self)
    }

    #[inline]
    fn time(&mut self, _: &'static str) -> Result<Time, DecodeError> {
        let seconds = self.i32()?;
        let nanos = self.u32()?;
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
        let count = self.sequence(smallest)?;
        (0..count).map(|_| read(self)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CdrWriter, Endian};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn alignment_counts_from_after_the_header() {
        // u8, then f64: seven bytes of padding after the u8, although the f64 then sits at 12 of the message.
        let mut message = vec![0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
        message.extend_from_slice(&1.5f64.to_le_bytes());
        let mut reader = CdrReader::new(&message).unwrap();
        assert_eq!((reader.u8().unwrap(), reader.f64().unwrap()), (7, 1.5));
    }

    #[test]
    fn says_where_and_how_much_is_missing() {
        let mut reader = CdrReader::new(&[0, 1, 0, 0, 1, 2]).unwrap();
        assert_eq!(
            reader.u32(),
            Err(DecodeError::TooShort {
                at: 4,
                missing: 2,
                length: 6
            })
        );
        assert_eq!(
            CdrReader::new(&[0, 3, 0, 0]).unwrap_err(),
            DecodeError::Encapsulation(3)
        );
        assert_eq!(
            CdrReader::new(&[0]).unwrap_err(),
            DecodeError::TooShort {
                at: 0,
                missing: 3,
                length: 1
            }
        );
    }

    #[test]
    fn a_string_needs_its_nul() {
        let mut reader = CdrReader::new(&[0, 0, 0, 0, 0, 0, 0, 2, b'a', b'b']).unwrap();
        assert_eq!(reader.string(), Err(DecodeError::BadString { at: 8 }));
    }

    proptest! {
        #[test]
        fn every_kind_of_field_there_and_back(
            big in any::<bool>(), a in any::<u8>(), text in "\\PC{0,20}", b in any::<i32>(), c in any::<f64>(),
            d in any::<u16>(), e in any::<[f64; 3]>(), f in any::<i8>(), g in any::<u32>(),
        ) {
            let mut writer = CdrWriter::new(if big { Endian::Big } else { Endian::Little });
            writer.u8(a);
            writer.string(&text);
            writer.i32(b);
            writer.f64(c);
            writer.u16(d);
            writer.f64_array(&e);
            writer.i8(f);
            writer.u32(g);
            let mut reader = CdrReader::new(writer.bytes()).unwrap();
            prop_assert_eq!(reader.u8().unwrap(), a);
            prop_assert_eq!(reader.string().unwrap(), text);
            prop_assert_eq!(reader.i32().unwrap(), b);
            prop_assert_eq!(reader.f64().unwrap().to_bits(), c.to_bits());
            prop_assert_eq!(reader.u16().unwrap(), d);
            prop_assert_eq!(reader.f64_array::<3>().unwrap().map(f64::to_bits), e.map(f64::to_bits));
            prop_assert_eq!(reader.i8().unwrap(), f);
            prop_assert_eq!(reader.u32().unwrap(), g);
            prop_assert!(reader.u8().is_err());
        }

        #[test]
        fn no_bytes_make_it_panic(message in proptest::collection::vec(any::<u8>(), 0..64), fields in any::<[u8; 12]>()) {
            if let Ok(mut reader) = CdrReader::new(&message) {
                for field in fields {
                    let _ = match field % 6 {
                        0 => reader.u8().map(drop),
                        1 => reader.u32().map(drop),
                        2 => reader.f64().map(drop),
                        3 => reader.string().map(drop),
                        4 => reader.f64_array::<3>().map(drop),
                        _ => reader.sequence(4).map(drop),
                    };
                }
            }
        }
    }
}
