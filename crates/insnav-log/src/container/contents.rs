//! What is in a file: schemas, channels, and the stretches of it that hold messages.

use super::account::Recovery;
use super::integrity::{
    check_data, check_end, check_start, cut_in_chunk, cut_off, record_name, truncated,
};
use super::messages::Unpacker;
use super::records::{Fields, MAGIC, MessageRecord, PREFIX, Record, Records, opcode};
use super::section::{Section, SectionKind, chunk_section};
use super::typed::McapRecord;
use crate::error::LogError;
use std::collections::BTreeMap;
use std::path::Path;

/// A message definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Schema {
    pub(crate) name: String,
    pub(crate) encoding: String,
    /// The definition itself.
    pub(crate) text: Vec<u8>,
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
    /// How many bytes the data section's checksum covers, and its value, once computed.
    pub(crate) data_crc: Option<(usize, u32)>,
    /// Whether damage to messages would be noticed.
    pub(crate) checksums: Checksums,
    /// What recovery did; absent when it was not asked for.
    pub(crate) recovery: Option<Recovery>,
}

/// Whether damage to a log's messages can be noticed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Checksums {
    /// Every message is covered by a checksum.
    #[default]
    All,
    /// Some are.
    Some,
    /// None is: damage goes unnoticed unless it breaks the structure.
    None,
}

/// What the summary says, to be compared with what was found.
#[derive(Default)]
struct Summary<'a> {
    statistics: Option<McapRecord<'a>>,
    /// Offset, length, first and last log time of every chunk that it lists.
    chunks: Vec<[u64; 4]>,
}

impl Contents {
    /// Walk over the whole file, from record to record.
    pub(crate) fn read(bytes: &[u8], path: &Path, size_limit: usize) -> Result<Self, LogError> {
        check_start(bytes, path)?;
        let mut contents = Contents::default();
        let mut summary = Summary::default();
        let mut data_end = None;
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
                opcode::CHUNK | opcode::MESSAGE if data_end.is_some() => {
                    return Err(LogError::Damaged {
                        path: path.into(),
                        offset: record.offset as u64,
                        reason: format!("{} behind the end of data", record_name(record.opcode)),
                    });
                }
                opcode::HEADER => {
                    let mut fields = Fields(record.body);
                    contents.profile = fields.string().ok_or_else(malformed)?.to_owned();
                    contents.library = fields.string().ok_or_else(malformed)?.to_owned();
                }
                opcode::SCHEMA | opcode::CHANNEL => contents.define(&record, path)?,
                opcode::CHUNK => {
                    let section = chunk_section(&record, path, size_limit)?;
                    contents.sections.push(section);
                }
                opcode::MESSAGE => {
                    let message = MessageRecord::parse(record.body).ok_or_else(malformed)?;
                    *contents.counts.entry(message.channel).or_default() += 1;
                    contents.extend_plain(&record, message.log_time, false);
                }
                opcode::METADATA => {
                    let mut fields = Fields(record.body);
                    let name = fields.string().ok_or_else(malformed)?.to_owned();
                    contents
                        .metadata
                        .insert(name, fields.string_map().ok_or_else(malformed)?);
                }
                opcode::STATISTICS => {
                    summary.statistics = Some(McapRecord::parse(&record).ok_or_else(malformed)?)
                }
                opcode::CHUNK_INDEX => {
                    let index = McapRecord::parse(&record).ok_or_else(malformed)?;
                    summary.chunks.extend(place_of_chunk(&index));
                }
                opcode::DATA_END => {
                    let crc = Fields(record.body).u32().ok_or_else(malformed)?;
                    data_end = Some((record.offset, crc));
                }
                opcode::FOOTER => break record,
                _ => {}
            }
        };
        let stated_crc = check_end(bytes, path, &footer, records.position(), data_end)?;
        contents.data_crc = check_data(bytes, path, &contents.sections, stated_crc)?;
        contents.checksums = contents.covered(stated_crc.1 != 0);
        let plain = std::mem::take(&mut contents.counts);
        match contents.agreed_counts(&summary) {
            Some(counts) => {
                contents.counts = counts;
                contents.indexed = true;
            }
            None => {
                contents.counts = plain;
                contents.look_into_chunks(bytes, path)?;
                contents.compare_counts(&summary, path, footer.offset)?;
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

    /// The summary's counts, if the definitions outside chunks are all there are and what it says of chunks is true.
    fn agreed_counts(&self, summary: &Summary<'_>) -> Option<BTreeMap<u16, u64>> {
        let Some(McapRecord::Statistics {
            message_count,
            schema_count,
            channel_count,
            chunk_count,
            channel_message_counts: counts,
            ..
        }) = &summary.statistics
        else {
            return None;
        };
        let is_chunk = |s: &&Section| matches!(s.kind, SectionKind::Chunk { .. });
        let chunks = || self.sections.iter().filter(is_chunk);
        let listed = summary.chunks.is_empty()
            || chunks()
                .map(place_of_section)
                .eq(summary.chunks.iter().copied());
        let complete = listed
            && *chunk_count as usize == chunks().count()
            && *channel_count as usize == self.channels.len()
            && usize::from(*schema_count) <= self.schemas.len()
            && self
                .channels
                .values()
                .all(|c| c.schema == 0 || self.schemas.contains_key(&c.schema))
            && counts.keys().all(|id| self.channels.contains_key(id))
            && counts.values().try_fold(0u64, |sum, n| sum.checked_add(*n)) == Some(*message_count);
        complete.then(|| counts.clone())
    }

    /// A summary that counts other messages than were found: a chunk went missing where no checksum could tell.
    fn compare_counts(
        &self,
        summary: &Summary<'_>,
        path: &Path,
        footer: usize,
    ) -> Result<(), LogError> {
        let found: u64 = self.counts.values().sum();
        match &summary.statistics {
            Some(McapRecord::Statistics { message_count, .. }) if *message_count != found => {
                Err(LogError::Damaged {
                    path: path.into(),
                    offset: footer as u64,
                    reason: format!(
                        "the summary before the footer counts {message_count} messages, the file holds {found}"
                    ),
                })
            }
            _ => Ok(()),
        }
    }

    /// What checksums there are.
    pub(super) fn covered(&self, data_section: bool) -> Checksums {
        let covered = |section: &Section| match section.kind {
            SectionKind::Chunk { crc, .. } => crc != 0,
            SectionKind::Plain(_) => false,
        };
        let count = self.sections.iter().filter(|s| covered(s)).count();
        match count {
            _ if data_section || count == self.sections.len() => Checksums::All,
            0 => Checksums::None,
            _ => Checksums::Some,
        }
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

    pub(super) fn define(&mut self, record: &Record<'_>, path: &Path) -> Result<(), LogError> {
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
                text: text.to_vec(),
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

    /// Add a message outside chunks to the section before it, unless a chunk is between them or a new one has to begin.
    pub(super) fn extend_plain(&mut self, record: &Record<'_>, time: u64, begin: bool) {
        let end = record.offset + PREFIX + record.body.len();
        if let Some(Section {
            start,
            end: last,
            kind: SectionKind::Plain(range),
            ..
        }) = self.sections.last_mut().filter(|_| !begin)
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
                Some("std_msgs/Header" | "std_msgs/msg/Header" | "Header")
            )
        })
}

fn place_of_chunk(index: &McapRecord<'_>) -> Option<[u64; 4]> {
    match *index {
        McapRecord::ChunkIndex {
            message_start_time,
            message_end_time,
            chunk_start_offset,
            chunk_length,
            ..
        } => Some([
            chunk_start_offset,
            chunk_length,
            message_start_time,
            message_end_time,
        ]),
        _ => None,
    }
}

fn place_of_section(section: &Section) -> [u64; 4] {
    let end = match &section.kind {
        SectionKind::Chunk { data, .. } | SectionKind::Plain(data) => data.end,
    };
    [
        section.offset as u64,
        (end - section.offset) as u64,
        section.start,
        section.end,
    ]
}
