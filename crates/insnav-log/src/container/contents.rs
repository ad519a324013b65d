//! What is in a file: schemas, channels, and the stretches of it that hold messages.

use super::integrity::{check_end, check_start, cut_in_chunk, cut_off, record_name, truncated};
use super::messages::Unpacker;
use super::records::{Fields, MAGIC, MessageRecord, PREFIX, Record, Records, opcode};
use crate::error::LogError;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

/// A message definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Schema {
    pub(crate) name: String,
    pub(crate) encoding: String,
    /// True when the first field of the definition is a `std_msgs/Header`, so that a message begins with its stamp.
    pub(crate) stamped: bool,
}

/// A stream of messages of one type on one topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Channel {
    pub(crate) schema: u16,
    pub(crate) topic: String,
    pub(crate) encoding: String,
}

/// How a chunk is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Zstd,
    Lz4,
}

/// A stretch of the file with messages in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Section {
    /// Where it begins in the file.
    pub(crate) offset: usize,
    /// Earliest log time in it, ns.
    pub(crate) start: u64,
    /// Latest log time in it, ns.
    pub(crate) end: u64,
    pub(crate) kind: SectionKind,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum SectionKind {
    /// A chunk: its (compressed) records, their uncompressed size and checksum (0: none).
    Chunk {
        compression: Compression,
        data: Range<usize>,
        size: usize,
        crc: u32,
    },
    /// Messages outside chunks, with other records between them.
    Plain(Range<usize>),
}

/// What a walk over the file found.
#[derive(Clone, Debug, Default)]
pub(crate) struct Contents {
    pub(crate) profile: String,
    pub(crate) library: String,
    pub(crate) schemas: BTreeMap<u16, Schema>,
    pub(crate) channels: BTreeMap<u16, Channel>,
    /// Messages by channel.
    pub(crate) counts: BTreeMap<u16, u64>,
    pub(crate) sections: Vec<Section>,
    pub(crate) metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// True when the channels were known from the summary, without decompressing anything.
    pub(crate) indexed: bool,
}

/// The summary's own numbers, to be compared with what was found.
struct Statistics {
    messages: u64,
    schemas: u16,
    channels: u32,
    chunks: u32,
    counts: BTreeMap<u16, u64>,
}

impl Contents {
    /// Walk over the whole file, from record to record.
    pub(crate) fn read(bytes: &[u8], path: &Path, size_limit: usize) -> Result<Self, LogError> {
        check_start(bytes, path)?;
        let mut contents = Contents::default();
        let mut statistics = None;
        let mut data_end = None;
        let mut has_chunks = false;
        let mut records = Records::new(bytes, MAGIC.len());
        let footer = loop {
            let record = match records.next() {
                Some(Ok(record)) => record,
                Some(Err(cut)) => return Err(cut_off(bytes, path, cut)),
                None => return Err(truncated(bytes, path, "footer", bytes.len())),
            };
            let malformed = || LogError::Damaged {
                path: path.into(),
                offset: record.offset as u64,
                reason: format!("{} does not parse", record_name(record.opcode)),
            };
            match record.opcode {
                opcode::HEADER => {
                    let mut fields = Fields(record.body);
                    contents.profile = fields.string().ok_or_else(malformed)?.to_owned();
                    contents.library = fields.string().ok_or_else(malformed)?.to_owned();
                }
                opcode::SCHEMA | opcode::CHANNEL => contents.define(&record, path)?,
                opcode::CHUNK => {
                    has_chunks = true;
                    let section = chunk_section(&record, path, size_limit)?;
                    contents.sections.push(section);
                }
                opcode::MESSAGE => {
                    let message = MessageRecord::parse(record.body).ok_or_else(malformed)?;
                    *contents.counts.entry(message.channel).or_default() += 1;
                    contents.extend_plain(&record, message.log_time);
                }
                opcode::METADATA => {
                    let mut fields = Fields(record.body);
                    let name = fields.string().ok_or_else(malformed)?.to_owned();
                    contents
                        .metadata
                        .insert(name, fields.string_map().ok_or_else(malformed)?);
                }
                opcode::STATISTICS => {
                    statistics = Some(parse_statistics(record.body).ok_or_else(malformed)?)
                }
                opcode::DATA_END => {
                    let crc = Fields(record.body).u32().ok_or_else(malformed)?;
                    data_end = Some((record.offset, crc));
                }
                opcode::FOOTER => break record,
                _ => {}
            }
        };
        check_end(
            bytes,
            path,
            &footer,
            records.position(),
            data_end,
            has_chunks,
        )?;
        let plain = std::mem::take(&mut contents.counts);
        match statistics {
            Some(statistics) if contents.agrees_with(&statistics) => {
                contents.counts = statistics.counts;
                contents.indexed = true;
            }
            _ => {
                contents.counts = plain;
                contents.look_into_chunks(bytes, path)?;
            }
        }
        Ok(contents)
    }

    /// Earliest and latest log time, ns.
    pub(crate) fn time_range(&self) -> Option<(u64, u64)> {
        let with_messages = || self.sections.iter().filter(|section| section.end > 0);
        Some((
            with_messages().map(|s| s.start).min()?,
            with_messages().map(|s| s.end).max()?,
        ))
    }

    /// Whether the definitions found outside chunks are all there are.
    fn agrees_with(&self, statistics: &Statistics) -> bool {
        let chunks = self
            .sections
            .iter()
            .filter(|s| matches!(s.kind, SectionKind::Chunk { .. }))
            .count();
        statistics.chunks as usize == chunks
            && statistics.channels as usize == self.channels.len()
            && usize::from(statistics.schemas) <= self.schemas.len()
            && self
                .channels
                .values()
                .all(|c| c.schema == 0 || self.schemas.contains_key(&c.schema))
            && statistics
                .counts
                .keys()
                .all(|id| self.channels.contains_key(id))
            && statistics
                .counts
                .values()
                .try_fold(0u64, |sum, n| sum.checked_add(*n))
                == Some(statistics.messages)
    }

    fn look_into_chunks(&mut self, bytes: &[u8], path: &Path) -> Result<(), LogError> {
        let mut unpacker = Unpacker::default();
        let mut buffer = Vec::new();
        for index in 0..self.sections.len() {
            let section = self.sections[index].clone();
            if let SectionKind::Plain(_) = section.kind {
                continue;
            }
            let (mut first, mut last) = (u64::MAX, 0);
            for record in Records::new(unpacker.unpack(&section, bytes, &mut buffer, path)?, 0) {
                let record = record.map_err(|_| cut_in_chunk(&section, path))?;
                match record.opcode {
                    opcode::SCHEMA | opcode::CHANNEL => self.define(
                        &Record {
                            offset: section.offset,
                            ..record
                        },
                        path,
                    )?,
                    opcode::MESSAGE => {
                        let message = MessageRecord::parse(record.body)
                            .ok_or_else(|| cut_in_chunk(&section, path))?;
                        *self.counts.entry(message.channel).or_default() += 1;
                        first = first.min(message.log_time);
                        last = last.max(message.log_time);
                    }
                    _ => {}
                }
            }
            if first <= last {
                (self.sections[index].start, self.sections[index].end) = (first, last);
            }
        }
        Ok(())
    }

    fn define(&mut self, record: &Record<'_>, path: &Path) -> Result<(), LogError> {
        let damaged = |reason: &str| LogError::Damaged {
            path: path.into(),
            offset: record.offset as u64,
            reason: format!("{} {reason}", record_name(record.opcode)),
        };
        let unparsed = || damaged("does not parse");
        let mut fields = Fields(record.body);
        let id = fields.u16().ok_or_else(unparsed)?;
        let changed = if record.opcode == opcode::SCHEMA {
            let name = fields.string().ok_or_else(unparsed)?.to_owned();
            let encoding = fields.string().ok_or_else(unparsed)?.to_owned();
            let text = fields.bytes().ok_or_else(unparsed)?;
            if id == 0 {
                return Err(damaged("has the reserved identifier 0"));
            }
            let schema = Schema {
                name,
                encoding,
                stamped: begins_with_header(text),
            };
            self.schemas
                .insert(id, schema.clone())
                .is_some_and(|old| old != schema)
        } else {
            let schema = fields.u16().ok_or_else(unparsed)?;
            let topic = fields.string().ok_or_else(unparsed)?.to_owned();
            let encoding = fields.string().ok_or_else(unparsed)?.to_owned();
            let channel = Channel {
                schema,
                topic,
                encoding,
            };
            self.channels
                .insert(id, channel.clone())
                .is_some_and(|old| old != channel)
        };
        if changed {
            Err(damaged(&format!("{id} contradicts an earlier one")))
        } else {
            Ok(())
        }
    }

    /// Add a message outside chunks to the section before it, unless a chunk is between them.
    fn extend_plain(&mut self, record: &Record<'_>, time: u64) {
        let end = record.offset + PREFIX + record.body.len();
        if let Some(Section {
            start,
            end: last,
            kind: SectionKind::Plain(range),
            ..
        }) = self.sections.last_mut()
        {
            range.end = end;
            *start = (*start).min(time);
            *last = (*last).max(time);
        } else {
            let kind = SectionKind::Plain(record.offset..end);
            self.sections.push(Section {
                offset: record.offset,
                start: time,
                end: time,
                kind,
            });
        }
    }
}

/// Whether the first line of a definition that is neither blank nor a comment declares a `std_msgs` header.
fn begins_with_header(text: &[u8]) -> bool {
    let Ok(text) = core::str::from_utf8(text) else {
        return false;
    };
    text.lines()
        .map(str::trim)
        .find(|line| !line.is_empty() && !line.starts_with('#'))
        .is_some_and(|line| {
            matches!(
                line.split_whitespace().next(),
                Some("std_msgs/Header" | "std_msgs/msg/Header")
            )
        })
}

fn chunk_section(record: &Record<'_>, path: &Path, size_limit: usize) -> Result<Section, LogError> {
    let offset = record.offset as u64;
    let damaged = |reason: String| LogError::Damaged {
        path: path.into(),
        offset,
        reason,
    };
    let mut fields = Fields(record.body);
    let mut head = || {
        Some((
            fields.u64()?,
            fields.u64()?,
            fields.u64()?,
            fields.u32()?,
            fields.string()?,
            fields.u64()?,
        ))
    };
    let (start, end, size, crc, compression, length) =
        head().ok_or_else(|| damaged("chunk does not parse".into()))?;
    let begin = record.offset + PREFIX + (record.body.len() - fields.0.len());
    let Some(length) = usize::try_from(length)
        .ok()
        .filter(|length| *length <= fields.0.len())
    else {
        return Err(damaged(format!(
            "chunk states {length} bytes of records and has {}",
            fields.0.len()
        )));
    };
    let Some(size) = usize::try_from(size)
        .ok()
        .filter(|size| *size <= size_limit)
    else {
        return Err(damaged(format!(
            "chunk states an uncompressed size of {size} bytes, above the limit of {size_limit}"
        )));
    };
    let compression = match compression {
        "" => Compression::None,
        "zstd" => Compression::Zstd,
        "lz4" => Compression::Lz4,
        other => {
            return Err(LogError::Compression {
                path: path.into(),
                offset,
                compression: other.into(),
            });
        }
    };
    if compression == Compression::None && size != length {
        return Err(damaged(format!(
            "uncompressed chunk states {size} bytes and has {length}"
        )));
    }
    let kind = SectionKind::Chunk {
        compression,
        data: begin..begin + length,
        size,
        crc,
    };
    Ok(Section {
        offset: record.offset,
        start,
        end,
        kind,
    })
}

fn parse_statistics(body: &[u8]) -> Option<Statistics> {
    let mut fields = Fields(body);
    let messages = fields.u64()?;
    let schemas = fields.u16()?;
    let channels = fields.u32()?;
    let _attachments = fields.u32()?;
    let _metadata = fields.u32()?;
    let chunks = fields.u32()?;
    let (_first, _last) = (fields.u64()?, fields.u64()?);
    Some(Statistics {
        messages,
        schemas,
        channels,
        chunks,
        counts: fields.count_map()?,
    })
}
