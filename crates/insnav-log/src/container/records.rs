//! MCAP records: an opcode, a length, a body (\[MCAP\] "Records").

use std::collections::BTreeMap;

pub(crate) const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";

/// Opcodes of the records that matter here (\[MCAP\] "Opcodes").
pub(crate) mod opcode {
    pub(crate) const HEADER: u8 = 0x01;
    pub(crate) const FOOTER: u8 = 0x02;
    pub(crate) const SCHEMA: u8 = 0x03;
    pub(crate) const CHANNEL: u8 = 0x04;
    pub(crate) const MESSAGE: u8 = 0x05;
    pub(crate) const CHUNK: u8 = 0x06;
    pub(crate) const MESSAGE_INDEX: u8 = 0x07;
    pub(crate) const CHUNK_INDEX: u8 = 0x08;
    pub(crate) const ATTACHMENT: u8 = 0x09;
    pub(crate) const ATTACHMENT_INDEX: u8 = 0x0a;
    pub(crate) const STATISTICS: u8 = 0x0b;
    pub(crate) const METADATA: u8 = 0x0c;
    pub(crate) const METADATA_INDEX: u8 = 0x0d;
    pub(crate) const SUMMARY_OFFSET: u8 = 0x0e;
    pub(crate) const DATA_END: u8 = 0x0f;
}

/// Bytes of the opcode and the length in front of a body.
pub(crate) const PREFIX: usize = 9;

/// One record.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Record<'a> {
    pub(crate) opcode: u8,
    /// Where the record begins in the bytes that are walked.
    pub(crate) offset: usize,
    pub(crate) body: &'a [u8],
}

/// A record that goes on past the end of the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Cut {
    pub(crate) offset: usize,
    /// Opcode and stated length, if at least these are there.
    pub(crate) prefix: Option<(u8, u64)>,
}

/// Walks over records without copying.
#[derive(Clone, Debug)]
pub(crate) struct Records<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Records<'a> {
    pub(crate) fn new(bytes: &'a [u8], at: usize) -> Self {
        Records { bytes, at }
    }

    /// Where the next record begins.
    pub(crate) fn position(&self) -> usize {
        self.at
    }
}

impl<'a> Iterator for Records<'a> {
    type Item = Result<Record<'a>, Cut>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        let offset = self.at;
        let rest = self.bytes.get(offset..)?;
        if rest.is_empty() {
            return None;
        }
        let Some((prefix, rest)) = rest.split_first_chunk::<PREFIX>() else {
            self.at = self.bytes.len();
            return Some(Err(Cut {
                offset,
                prefix: None,
            }));
        };
        let [opcode, length @ ..] = *prefix;
        let length = u64::from_le_bytes(length);
        match usize::try_from(length)
            .ok()
            .and_then(|length| rest.get(..length))
        {
            Some(body) => {
                self.at = offset + PREFIX + body.len();
                Some(Ok(Record {
                    opcode,
                    offset,
                    body,
                }))
            }
            None => {
                self.at = self.bytes.len();
                Some(Err(Cut {
                    offset,
                    prefix: Some((opcode, length)),
                }))
            }
        }
    }
}

/// Reads the fields of a record's body; `None` once it is too short.
#[derive(Clone, Debug)]
pub(crate) struct Fields<'a>(pub(crate) &'a [u8]);

impl<'a> Fields<'a> {
    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (bytes, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*bytes)
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes behind their 32-bit length.
    pub(crate) fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()? as usize;
        let bytes = self.0.get(..length)?;
        self.0 = &self.0[length..];
        Some(bytes)
    }

    /// Bytes behind their 64-bit length.
    pub(crate) fn long_bytes(&mut self) -> Option<&'a [u8]> {
        let length = usize::try_from(self.u64()?).ok()?;
        let bytes = self.0.get(..length)?;
        self.0 = &self.0[length..];
        Some(bytes)
    }

    pub(crate) fn string(&mut self) -> Option<&'a str> {
        core::str::from_utf8(self.bytes()?).ok()
    }

    pub(crate) fn string_map(&mut self) -> Option<BTreeMap<String, String>> {
        let mut pairs = Fields(self.bytes()?);
        let mut map = BTreeMap::new();
        while !pairs.0.is_empty() {
            let key = pairs.string()?;
            map.insert(key.to_owned(), pairs.string()?.to_owned());
        }
        Some(map)
    }

    /// A map from channel to count.
    pub(crate) fn count_map(&mut self) -> Option<BTreeMap<u16, u64>> {
        let mut pairs = Fields(self.bytes()?);
        let mut map = BTreeMap::new();
        while !pairs.0.is_empty() {
            let key = pairs.u16()?;
            map.insert(key, pairs.u64()?);
        }
        Some(map)
    }
}

/// Head of a message record: channel, log time, publish time, then the data.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MessageRecord<'a> {
    pub(crate) channel: u16,
    pub(crate) log_time: u64,
    pub(crate) publish_time: u64,
    pub(crate) data: &'a [u8],
}

impl<'a> MessageRecord<'a> {
    #[inline]
    pub(crate) fn parse(body: &'a [u8]) -> Option<Self> {
        let (head, data) = body.split_first_chunk::<22>()?;
        let word = |at: usize| {
            head[at..]
                .first_chunk::<8>()
                .map(|bytes| u64::from_le_bytes(*bytes))
        };
        Some(MessageRecord {
            channel: u16::from_le_bytes([head[0], head[1]]),
            log_time: word(6)?,
            publish_time: word(14)?,
            data,
        })
    }
}
