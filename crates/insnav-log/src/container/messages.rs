//! Messages in order of log time, borrowed from the file or from one reused buffer per open chunk.

use super::contents::Contents;
use super::integrity::{check_crc, cut_in_chunk};
use super::records::{MessageRecord, Records, opcode};
use super::section::{Compression, Section, SectionKind};
use crate::error::LogError;
use insnav_core::time::Time;
use std::io::Read;
use std::path::Path;

/// One message.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// Identifier of its channel.
    pub channel: u16,
    /// When it was recorded.
    pub log_time: Time,
    /// When it was published.
    pub publish_time: Time,
    /// Its bytes.
    pub data: &'a [u8],
}

/// Gets at the records of a chunk.
#[derive(Default)]
pub(crate) struct Unpacker {
    zstd: Option<zstd::bulk::Decompressor<'static>>,
}

impl Unpacker {
    /// The records of a chunk, verified against its checksum: in the file itself if it is not compressed, else in `buffer`.
    pub(crate) fn unpack<'a>(
        &mut self,
        section: &Section,
        file: &'a [u8],
        buffer: &'a mut Vec<u8>,
        path: &Path,
    ) -> Result<&'a [u8], LogError> {
        let (compression, data, size, crc, cut) = match &section.kind {
            SectionKind::Plain(range) => return Ok(&file[range.clone()]),
            SectionKind::Chunk {
                compression,
                data,
                size,
                crc,
                cut,
            } => (*compression, &file[data.clone()], *size, *crc, *cut),
        };
        let records = if compression == Compression::None {
            data
        } else if cut {
            decompress_start(compression, data, size, buffer);
            buffer
        } else {
            self.decompress(compression, data, size, buffer)
                .map_err(|source| LogError::Damaged {
                    path: path.into(),
                    offset: section.offset as u64,
                    reason: format!("chunk does not decompress: {source}"),
                })?;
            buffer
        };
        check_crc(path, "chunk", section.offset, crc, records)?;
        Ok(records)
    }

    fn decompress(
        &mut self,
        compression: Compression,
        data: &[u8],
        size: usize,
        buffer: &mut Vec<u8>,
    ) -> std::io::Result<()> {
        buffer.clear();
        buffer
            .try_reserve_exact(size)
            .map_err(std::io::Error::other)?;
        if compression == Compression::Lz4 {
            // One byte more than stated, to notice a chunk that is longer.
            lz4::Decoder::new(data)?
                .take(size as u64 + 1)
                .read_to_end(buffer)?;
        } else {
            let zstd = match &mut self.zstd {
                Some(zstd) => zstd,
                None => self.zstd.insert(zstd::bulk::Decompressor::new()?),
            };
            zstd.decompress_to_buffer(data, buffer)?;
        }
        if buffer.len() == size {
            Ok(())
        } else {
            Err(std::io::Error::other(format!(
                "{size} bytes are stated, {} came out",
                buffer.len()
            )))
        }
    }
}

/// As much of the beginning of a chunk as comes out of it, at most `size` bytes.
pub(super) fn decompress_start(
    compression: Compression,
    data: &[u8],
    size: usize,
    buffer: &mut Vec<u8>,
) {
    buffer.clear();
    let from: Option<Box<dyn Read + '_>> = match compression {
        Compression::None => Some(Box::new(data)),
        Compression::Zstd => zstd::stream::read::Decoder::new(data)
            .ok()
            .map(|d| Box::new(d) as _),
        Compression::Lz4 => lz4::Decoder::new(data).ok().map(|d| Box::new(d) as _),
    };
    // The error at the end of what is there is the reason for being here.
    let _ = from.map(|from| from.take(size as u64).read_to_end(buffer));
}

/// An open section: where its records are, and where each wanted message begins, by log time.
struct Open<'a> {
    /// `None`: in `buffer`.
    in_file: Option<&'a [u8]>,
    buffer: Vec<u8>,
    order: Vec<(u64, usize)>,
    next: usize,
    section: usize,
}

/// Messages of some channels in order of log time; equal times keep the order of the file.
pub(crate) struct Messages<'a> {
    file: &'a [u8],
    path: &'a Path,
    contents: &'a Contents,
    wanted: Vec<bool>,
    /// Sections by start time, and how many of them have been opened.
    pending: Vec<usize>,
    opened: usize,
    open: Vec<Open<'a>>,
    spare: Vec<Open<'a>>,
    unpacker: Unpacker,
    failed: bool,
}

impl<'a> Messages<'a> {
    pub(crate) fn new(
        file: &'a [u8],
        path: &'a Path,
        contents: &'a Contents,
        channels: &[u16],
    ) -> Self {
        let mut wanted = vec![false; channels.iter().max().map_or(0, |max| usize::from(*max) + 1)];
        for channel in channels {
            wanted[usize::from(*channel)] = true;
        }
        let mut pending: Vec<usize> = (0..contents.sections.len()).collect();
        pending.sort_by_key(|&i| contents.sections[i].start);
        Messages {
            file,
            path,
            contents,
            wanted,
            pending,
            opened: 0,
            open: Vec::new(),
            spare: Vec::new(),
            unpacker: Unpacker::default(),
            failed: false,
        }
    }

    /// The next message. Not an `Iterator`, since the message borrows from this reader.
    pub(crate) fn next(&mut self) -> Option<Result<Message<'_>, LogError>> {
        if self.failed {
            return None;
        }
        if let Err(error) = self.open_due() {
            self.failed = true;
            return Some(Err(error));
        }
        let earliest = (0..self.open.len()).min_by_key(|&i| {
            let open = &self.open[i];
            (open.order[open.next].0, open.section)
        })?;
        // The list stays short: only sections that overlap in time are open together.
        let open = &mut self.open[earliest];
        let (_, at) = open.order[open.next];
        open.next += 1;
        let open = &self.open[earliest];
        let bytes = open.in_file.unwrap_or(&open.buffer);
        let message = Records::new(bytes, at)
            .next()
            .and_then(Result::ok)
            .and_then(|r| MessageRecord::parse(r.body))?;
        Some(Ok(Message {
            channel: message.channel,
            log_time: Time(message.log_time as i64),
            publish_time: Time(message.publish_time as i64),
            data: message.data,
        }))
    }

    /// Close what is used up, and open every section that may hold something earlier than what is at hand.
    fn open_due(&mut self) -> Result<(), LogError> {
        let mut i = 0;
        while i < self.open.len() {
            if self.open[i].next == self.open[i].order.len() {
                let done = self.open.swap_remove(i);
                self.spare.push(done);
            } else {
                i += 1;
            }
        }
        while let Some(&index) = self.pending.get(self.opened) {
            let start = self.contents.sections[index].start;
            let earliest = self.open.iter().map(|open| open.order[open.next].0).min();
            if earliest.is_some_and(|earliest| earliest < start) {
                break;
            }
            self.opened += 1;
            self.open_section(index)?;
        }
        Ok(())
    }

    fn open_section(&mut self, index: usize) -> Result<(), LogError> {
        let contents: &'a Contents = self.contents;
        let section = &contents.sections[index];
        let mut open = self.spare.pop().unwrap_or(Open {
            in_file: None,
            buffer: Vec::new(),
            order: Vec::new(),
            next: 0,
            section: index,
        });
        (open.section, open.next, open.in_file) = (index, 0, None);
        open.order.clear();
        let compressed = matches!(
            section.kind,
            SectionKind::Chunk {
                compression: Compression::Zstd | Compression::Lz4,
                ..
            }
        );
        if !compressed {
            let range = match &section.kind {
                SectionKind::Plain(range) | SectionKind::Chunk { data: range, .. } => range.clone(),
            };
            open.in_file = Some(&self.file[range]);
        }
        let bytes = self
            .unpacker
            .unpack(section, self.file, &mut open.buffer, self.path)?;
        let mut sorted = true;
        let mut latest = 0;
        for record in Records::new(bytes, 0) {
            let record = record.map_err(|_| cut_in_chunk(section, self.path))?;
            if record.opcode != opcode::MESSAGE {
                continue;
            }
            let message = MessageRecord::parse(record.body)
                .ok_or_else(|| cut_in_chunk(section, self.path))?;
            if !contents.channels.contains_key(&message.channel) {
                if contents.recovery.is_some() {
                    continue;
                }
                return Err(LogError::Damaged {
                    path: self.path.into(),
                    offset: section.offset as u64,
                    reason: format!(
                        "a message is on channel {}, which is not described",
                        message.channel
                    ),
                });
            }
            if message.log_time < section.start {
                return Err(LogError::Damaged {
                    path: self.path.into(),
                    offset: section.offset as u64,
                    reason: "a message is earlier than its chunk says to begin".into(),
                });
            }
            if self
                .wanted
                .get(usize::from(message.channel))
                .copied()
                .unwrap_or(false)
            {
                sorted &= latest <= message.log_time;
                latest = message.log_time;
                open.order.push((message.log_time, record.offset));
            }
        }
        if !sorted {
            open.order.sort_by_key(|(time, _)| *time);
        }
        if open.order.is_empty() {
            self.spare.push(open);
        } else {
            self.open.push(open);
        }
        Ok(())
    }
}
