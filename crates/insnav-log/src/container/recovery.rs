//! What can be kept of a damaged file, and the account of what cannot.
//!
//! A chunk counts as intact when it decompresses to the stated size and its checksum matches; of a chunk that the end of the
//! file cuts off, the whole messages before the cut are kept. Behind a record that makes no sense the next one that does is
//! searched for, byte by byte. Definitions are believed first where a checksum covers them (inside chunks, in an intact
//! summary), then elsewhere. Messages outside chunks have no checksum but that of the whole data section.

use super::account::{Loss, Recovery};
use super::contents::Contents;
use super::integrity::{check_start, record_name, summary_start_checked};
use super::messages::{Unpacker, decompress_start};
use super::records::{Fields, MAGIC, MessageRecord, PREFIX, Record, Records, opcode};
use super::resync::{plausible, rest, resync};
use super::section::{Compression, Section, SectionKind, chunk_section};
use super::typed::McapRecord;
use crate::error::LogError;
use insnav_core::time::Time;
use std::path::Path;

impl Contents {
    /// As [`Contents::read`], for a file that may be damaged.
    pub(crate) fn recover(bytes: &[u8], path: &Path, size_limit: usize) -> Result<Self, LogError> {
        let mut salvage = Salvage {
            bytes,
            path,
            size_limit,
            unpacker: Unpacker::default(),
            buffer: Vec::new(),
            contents: Contents::default(),
            account: Recovery::default(),
            definitions: Vec::new(),
            stated_messages: None,
            data_end: None,
            footer: None,
            ended: false,
            broken: false,
        };
        let start = check_start(bytes, path);
        if start.is_err() {
            salvage.remark("the start mark is damaged");
        }
        salvage.walk();
        let contents = salvage.finish();
        match start {
            Err(error) if contents.sections.is_empty() => Err(error),
            _ => Ok(contents),
        }
    }
}

struct Salvage<'a> {
    bytes: &'a [u8],
    path: &'a Path,
    size_limit: usize,
    unpacker: Unpacker,
    buffer: Vec<u8>,
    contents: Contents,
    account: Recovery,
    /// Schemas and channels outside chunks.
    definitions: Vec<Record<'a>>,
    stated_messages: Option<u64>,
    data_end: Option<(usize, u32)>,
    footer: Option<Record<'a>>,
    ended: bool,
    /// Something was lost since the last record.
    broken: bool,
}

/// What is in a chunk that was opened.
#[derive(Default)]
struct Inside {
    counts: std::collections::BTreeMap<u16, u64>,
    first: Option<u64>,
    last: u64,
    /// Length of the whole records.
    whole: usize,
}

impl<'a> Salvage<'a> {
    fn remark(&mut self, text: impl Into<String>) {
        self.account.remarks.push(text.into());
    }

    fn lose(&mut self, from: usize, to: usize, what: String, kept: u64) {
        self.account.losses.push(Loss {
            offset: from as u64,
            length: (to - from) as u64,
            what,
            kept,
            after: None,
            before: None,
        });
        self.broken = true;
    }

    fn walk(&mut self) {
        let length = self.bytes.len();
        let mut at = MAGIC.len();
        while at < length {
            if self.bytes[at..] == *MAGIC {
                self.ended = true;
                return;
            }
            at = match self.take(at) {
                Ok(next) => next,
                Err(what) => {
                    let next = resync(self.bytes, at + 1).unwrap_or(length);
                    // What remains of the end mark is no loss.
                    if !MAGIC.starts_with(&self.bytes[at..next]) {
                        self.lose(at, next, what, 0);
                    }
                    next
                }
            };
        }
    }

    /// Take the record at `at`; returns where the next one begins, or what is wrong.
    fn take(&mut self, at: usize) -> Result<usize, String> {
        let record = match Records::new(self.bytes, at).next() {
            Some(Ok(record)) => record,
            Some(Err(cut)) => {
                let Some((op, _)) = cut.prefix else {
                    return Err("a record is cut off by the end of the file".into());
                };
                if op == opcode::CHUNK {
                    return self
                        .take_chunk_by_own_length(at)
                        .or_else(|| self.take_cut_chunk(at))
                        .ok_or_else(|| "a chunk is cut off by the end of the file".into());
                }
                return Err(format!(
                    "{} is cut off by the end of the file",
                    record_name(op)
                ));
            }
            None => return Ok(self.bytes.len()),
        };
        let end = at + PREFIX + record.body.len();
        if record.opcode == opcode::CHUNK {
            return self.take_chunk(&record, end);
        }
        // A record that fills its length exactly speaks for itself; otherwise another one must follow.
        let fits = match rest(&record) {
            // Behind the end of data there are none.
            Some(_) if record.opcode == opcode::MESSAGE && self.data_end.is_some() => false,
            Some(0) if record.opcode != opcode::MESSAGE => true,
            Some(_) => plausible(self.bytes, end),
            None => false,
        };
        if !fits {
            return Err(format!(
                "{} that makes no sense",
                record_name(record.opcode)
            ));
        }
        self.keep(record);
        self.broken = false;
        Ok(end)
    }

    fn keep(&mut self, record: Record<'a>) {
        match McapRecord::parse(&record) {
            Some(McapRecord::Header { profile, library }) => {
                self.contents.profile = profile.to_owned();
                self.contents.library = library.to_owned();
            }
            Some(McapRecord::Schema { .. } | McapRecord::Channel { .. }) => {
                self.definitions.push(record);
            }
            Some(McapRecord::Message {
                channel_id,
                log_time,
                ..
            }) => {
                *self.contents.counts.entry(channel_id).or_default() += 1;
                self.contents.extend_plain(&record, log_time, self.broken);
            }
            Some(McapRecord::Metadata { name, metadata }) => {
                self.contents.metadata.insert(name.to_owned(), metadata);
            }
            Some(McapRecord::Statistics { message_count, .. }) => {
                self.stated_messages = Some(message_count);
            }
            Some(McapRecord::DataEnd { data_section_crc }) => {
                self.data_end = Some((record.offset, data_section_crc));
            }
            Some(McapRecord::Footer { .. }) => self.footer = Some(record),
            _ => {}
        }
    }

    fn take_chunk(&mut self, record: &Record<'a>, end: usize) -> Result<usize, String> {
        let section = match chunk_section(record, self.path, self.size_limit) {
            Ok(section) => section,
            Err(error) => {
                return match self.take_chunk_by_own_length(record.offset) {
                    Some(next) => Ok(next),
                    None => self.lose_chunk(record.offset, end, reason(&error)),
                };
            }
        };
        let fills = matches!(&section.kind, SectionKind::Chunk { data, .. } if data.end == end);
        if !fills && !plausible(self.bytes, end) {
            // The record's length is wrong; the chunk's own length of its records tells where it ends.
            return self
                .take_chunk_by_own_length(record.offset)
                .ok_or_else(|| "a chunk whose lengths contradict each other".into());
        }
        match self.open(&section) {
            Ok(inside) => {
                self.accept(section, inside);
                Ok(end)
            }
            Err(what) => self.lose_chunk(record.offset, end, what),
        }
    }

    /// Leave a chunk out, if its end is where another record begins.
    fn lose_chunk(&mut self, from: usize, to: usize, what: String) -> Result<usize, String> {
        self.account.chunks_lost += 1;
        if !plausible(self.bytes, to) {
            return Err(format!("chunk: {what}"));
        }
        self.lose(from, to, format!("chunk: {what}"), 0);
        Ok(to)
    }

    /// A chunk whose record states a wrong length.
    fn take_chunk_by_own_length(&mut self, at: usize) -> Option<usize> {
        let record = Record {
            opcode: opcode::CHUNK,
            offset: at,
            body: self.bytes.get(at + PREFIX..)?,
        };
        let section = chunk_section(&record, self.path, self.size_limit).ok()?;
        let SectionKind::Chunk { data, .. } = &section.kind else {
            return None;
        };
        let end = data.end;
        if !plausible(self.bytes, end) {
            return None;
        }
        let inside = self.open(&section).ok()?;
        self.remark(format!("the chunk at byte {at} states a wrong length"));
        self.accept(section, inside);
        Some(end)
    }

    /// The whole messages of a chunk that the file's end cuts off.
    fn take_cut_chunk(&mut self, at: usize) -> Option<usize> {
        let length = self.bytes.len();
        let body = self.bytes.get(at + PREFIX..)?;
        let mut section = cut_section(body, at, self.size_limit)?;
        let SectionKind::Chunk {
            compression,
            data,
            size,
            ..
        } = &mut section.kind
        else {
            return None;
        };
        decompress_start(
            *compression,
            &self.bytes[data.clone()],
            *size,
            &mut self.buffer,
        );
        let inside = look_inside(&self.buffer, &mut self.contents);
        *size = inside.whole;
        if matches!(compression, Compression::None) {
            data.end = data.start + inside.whole;
        }
        let kept = inside.counts.values().sum();
        self.account.chunks_lost += 1;
        if kept > 0 {
            self.accept(section, inside);
            // It was counted as whole.
            self.account.chunks_kept -= 1;
        }
        let what = "chunk cut off by the end of the file".to_owned();
        self.lose(at, length, what, kept);
        Some(length)
    }

    fn open(&mut self, section: &Section) -> Result<Inside, String> {
        let records = self
            .unpacker
            .unpack(section, self.bytes, &mut self.buffer, self.path)
            .map_err(|error| reason(&error))?;
        let whole = Records::new(records, 0).all(|r| {
            r.is_ok_and(|r| r.opcode != opcode::MESSAGE || MessageRecord::parse(r.body).is_some())
        });
        if !whole {
            return Err("a record inside is cut off by its end".into());
        }
        Ok(look_inside(records, &mut self.contents))
    }

    fn accept(&mut self, mut section: Section, inside: Inside) {
        for (id, count) in inside.counts {
            *self.contents.counts.entry(id).or_default() += count;
        }
        if let Some(first) = inside.first {
            (section.start, section.end) = (first, inside.last);
        }
        self.account.chunks_kept += 1;
        self.contents.sections.push(section);
        self.broken = false;
    }

    fn finish(mut self) -> Contents {
        let summary_is_intact = self.check_footer();
        let data_end = self.data_end.map_or(self.bytes.len(), |(at, _)| at);
        self.check_data_section();
        // Definitions that a checksum covers go first.
        let (mut first, second): (Vec<_>, Vec<_>) = std::mem::take(&mut self.definitions)
            .into_iter()
            .partition(|d| summary_is_intact && d.offset > data_end);
        first.extend(second);
        for definition in first {
            define_if_new(&mut self.contents, &definition);
        }
        let channels = &self.contents.channels;
        let described = |id: &u16| channels.contains_key(id);
        let counts = &self.contents.counts;
        let undescribed: u64 = counts
            .iter()
            .filter(|(id, _)| !described(id))
            .map(|(_, n)| n)
            .sum();
        let kept = counts.values().sum::<u64>() - undescribed;
        if undescribed > 0 {
            self.remark(format!(
                "{undescribed} messages are on channels whose description is lost"
            ));
        }
        if summary_is_intact {
            self.account.messages_missing = self.stated_messages.map(|n| n.saturating_sub(kept));
        }
        self.account.messages_kept = kept;
        self.date_losses();
        self.contents.recovery = Some(self.account);
        self.contents
    }

    /// Marks, pointers and checksum at the end. True when the summary is what its writer wrote.
    fn check_footer(&mut self) -> bool {
        let Some(footer) = self.footer else {
            self.remark("the end of the file, with its summary, is missing");
            return false;
        };
        if !self.ended {
            self.remark("the end mark is missing");
        }
        let mut fields = Fields(footer.body);
        let numbers = (|| Some((fields.u64()?, fields.u64()?, fields.u32()?)))();
        let Some(((start, _, crc), (data_end, _))) = numbers.zip(self.data_end) else {
            self.remark("the end of the data is not marked");
            return false;
        };
        let Some(start) = summary_start_checked(start, data_end, footer.offset) else {
            self.remark(format!(
                "the footer puts the summary at byte {start}, which is outside"
            ));
            return false;
        };
        let covered = &self.bytes[start..footer.offset + PREFIX + 16];
        if crc != 0 && crc32fast::hash(covered) != crc {
            self.remark("the checksum of the summary does not match");
            return false;
        }
        // Without a checksum the counts are as good as nothing to blame a loss on.
        crc != 0
    }

    fn check_data_section(&mut self) {
        let stored = self.data_end.map_or(0, |(_, crc)| crc);
        self.contents.checksums = self.contents.covered(stored != 0);
        let Some((length, _)) = self.data_end.filter(|_| stored != 0) else {
            return;
        };
        if crc32fast::hash(&self.bytes[..length]) == stored {
            self.contents.data_crc = Some((length, stored));
            return;
        }
        let is_plain = |s: &Section| matches!(s.kind, SectionKind::Plain(_));
        let plain = self
            .contents
            .sections
            .iter()
            .filter(|s| is_plain(s))
            .count();
        if plain == self.contents.sections.len() && plain > 0 {
            self.remark(
                "the checksum of the data section does not match: some of the messages may be wrong, and there is no telling which",
            );
            return;
        }
        if self.account.losses.is_empty() && self.account.remarks.is_empty() {
            self.remark(
                "the checksum of the data section does not match, but those of all chunks do: the damage is between them",
            );
        }
        if plain > 0 {
            self.drop_plain();
        }
    }

    /// Messages outside chunks cannot be told from damage that looks like messages.
    fn drop_plain(&mut self) {
        let sections = std::mem::take(&mut self.contents.sections);
        for section in sections {
            let SectionKind::Plain(range) = &section.kind else {
                self.contents.sections.push(section);
                continue;
            };
            for record in Records::new(&self.bytes[range.clone()], 0).flatten() {
                let message = MessageRecord::parse(record.body);
                if record.opcode == opcode::MESSAGE
                    && let Some(message) = message
                    && let Some(count) = self.contents.counts.get_mut(&message.channel)
                {
                    *count = count.saturating_sub(1);
                }
            }
            self.lose(
                range.start,
                range.end,
                "messages outside chunks that no checksum confirms".into(),
                0,
            );
        }
        self.account.losses.sort_by_key(|loss| loss.offset);
    }

    /// Log times around each loss: of the messages before and behind it in the file.
    fn date_losses(&mut self) {
        let sections = &self.contents.sections;
        let before = |offset: u64| {
            let earlier = sections.iter().filter(|s| s.offset as u64 <= offset);
            earlier.map(|s| s.end).max()
        };
        let behind = |offset: u64| {
            let later = sections.iter().filter(|s| s.offset as u64 > offset);
            later.map(|s| s.start).min()
        };
        for loss in &mut self.account.losses {
            let time = |t: u64| Time(t as i64);
            loss.after = before(loss.offset).map(time);
            loss.before = behind(loss.offset).map(time);
        }
    }
}

/// Note definitions, count messages, up to the first record that is cut off.
fn look_inside(records: &[u8], contents: &mut Contents) -> Inside {
    let mut inside = Inside::default();
    for record in Records::new(records, 0) {
        let Ok(record) = record else { break };
        match record.opcode {
            opcode::SCHEMA | opcode::CHANNEL => define_if_new(contents, &record),
            opcode::MESSAGE => {
                let Some(message) = MessageRecord::parse(record.body) else {
                    break;
                };
                *inside.counts.entry(message.channel).or_default() += 1;
                inside.first = Some(
                    inside
                        .first
                        .map_or(message.log_time, |t| t.min(message.log_time)),
                );
                inside.last = inside.last.max(message.log_time);
            }
            _ => {}
        }
        inside.whole = record.offset + PREFIX + record.body.len();
    }
    inside
}

fn define_if_new(contents: &mut Contents, record: &Record<'_>) {
    let new = match McapRecord::parse(record) {
        Some(McapRecord::Schema { id, .. }) => !contents.schemas.contains_key(&id),
        Some(McapRecord::Channel { id, .. }) => !contents.channels.contains_key(&id),
        _ => false,
    };
    if new {
        // A reserved identifier is the only complaint left, and then there is nothing to keep.
        let _ = contents.define(record, Path::new(""));
    }
}

/// What is wrong, without the place.
fn reason(error: &LogError) -> String {
    match error {
        LogError::Crc { .. } => "checksum does not match".into(),
        LogError::Damaged { reason, .. } => reason.clone(),
        LogError::Compression { compression, .. } => {
            format!("compressed with {compression:?}, which is not supported")
        }
        other => other.to_string(),
    }
}

/// The section of a chunk whose records the file's end cuts off.
fn cut_section(body: &[u8], at: usize, size_limit: usize) -> Option<Section> {
    let mut fields = Fields(body);
    let (start, end, size) = (fields.u64()?, fields.u64()?, fields.u64()?);
    fields.u32()?;
    let compression = Compression::by_name(fields.string()?)?;
    fields.u64()?;
    let begin = at + PREFIX + (body.len() - fields.0.len());
    Some(Section {
        offset: at,
        start,
        end,
        kind: SectionKind::Chunk {
            compression,
            data: begin..at + PREFIX + body.len(),
            size: usize::try_from(size)
                .ok()
                .filter(|size| *size <= size_limit)?,
            crc: 0,
            cut: true,
        },
    })
}
