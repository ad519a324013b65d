//! Whether a file is whole: its marks, its pointers, its checksums, and the errors that name what is not.

use super::messages::Unpacker;
use super::records::{Cut, Fields, MAGIC, PREFIX, Record, opcode};
use super::section::Section;
use crate::error::LogError;
use std::path::Path;

pub(super) fn check_start(bytes: &[u8], path: &Path) -> Result<(), LogError> {
    if bytes.starts_with(MAGIC) {
        return Ok(());
    }
    if !bytes.is_empty() && MAGIC.starts_with(bytes) {
        return Err(truncated(bytes, path, "start mark", 0));
    }
    let found = match bytes {
        [] => "the file is empty",
        _ if bytes.starts_with(b"#ROSBAG") => "it is a ROS 1 bag",
        _ if bytes.starts_with(b"SQLite format 3") => "it is a ROS 2 bag in SQLite storage (.db3)",
        _ if bytes.starts_with(&[0x1f, 0x8b]) => "it is gzip data",
        _ if bytes
            .iter()
            .take(256)
            .all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace()) =>
        {
            "it is a text file"
        }
        _ => "its first bytes are not the MCAP mark",
    };
    Err(LogError::NotAnMcap {
        path: path.into(),
        found,
    })
}

/// What follows the footer, what the footer points to, and the checksum of the summary. Returns the length of the data
/// section and its stored checksum.
pub(super) fn check_end(
    bytes: &[u8],
    path: &Path,
    footer: &Record<'_>,
    after: usize,
    data_end: Option<(usize, u32)>,
) -> Result<(usize, u32), LogError> {
    let damaged = |offset: usize, reason: String| LogError::Damaged {
        path: path.into(),
        offset: offset as u64,
        reason,
    };
    match bytes.get(after..) {
        Some(rest) if rest == MAGIC => {}
        Some(rest) if rest.len() < MAGIC.len() && MAGIC.starts_with(rest) => {
            return Err(truncated(bytes, path, "end mark", after));
        }
        _ => {
            return Err(damaged(
                after,
                "the footer is not followed by the end mark".into(),
            ));
        }
    }
    let mut fields = Fields(footer.body);
    let mut numbers = || Some((fields.u64()?, fields.u64()?, fields.u32()?));
    let Some((summary_start, _, crc)) = numbers() else {
        return Err(damaged(footer.offset, "footer does not parse".into()));
    };
    let Some((data_end, data_crc)) = data_end else {
        return Err(damaged(
            footer.offset,
            "there is no end of data before the footer".into(),
        ));
    };
    let start = summary_start_checked(summary_start, data_end, footer.offset).ok_or_else(|| {
        let reason = format!(
            "the footer puts the summary at byte {summary_start} of a file of {} bytes",
            bytes.len()
        );
        damaged(footer.offset, reason)
    })?;
    check_crc(
        path,
        "summary",
        start,
        crc,
        &bytes[start..footer.offset + PREFIX + 16],
    )?;
    Ok((data_end, data_crc))
}

/// Where the summary's checksum begins: at the footer if there is no summary; `None` for a pointer to elsewhere. It covers
/// the footer up to its own field.
pub(super) fn summary_start_checked(stated: u64, data_end: usize, footer: usize) -> Option<usize> {
    match stated {
        0 => Some(footer),
        _ => usize::try_from(stated)
            .ok()
            .filter(|s| (data_end..=footer).contains(s)),
    }
}

/// The checksum of the data section: chunks have their own, but not for where they are, when they begin and how long they
/// are. Returns what was computed, if it was.
pub(super) fn check_data(
    bytes: &[u8],
    path: &Path,
    sections: &[Section],
    (length, stored): (usize, u32),
) -> Result<Option<(usize, u32)>, LogError> {
    if stored == 0 {
        return Ok(None);
    }
    let computed = crc32fast::hash(&bytes[..length]);
    if computed == stored {
        return Ok(Some((length, computed)));
    }
    // A chunk's own checksum tells the place better.
    let (mut unpacker, mut buffer) = (Unpacker::default(), Vec::new());
    for section in sections {
        unpacker.unpack(section, bytes, &mut buffer, path)?;
    }
    Err(LogError::Crc {
        path: path.into(),
        what: "data section",
        offset: 0,
        stored,
        computed,
    })
}

/// Compare a stored checksum (0: none) with that of the bytes.
pub(super) fn check_crc(
    path: &Path,
    what: &'static str,
    offset: usize,
    stored: u32,
    bytes: &[u8],
) -> Result<(), LogError> {
    if stored == 0 {
        return Ok(());
    }
    let computed = crc32fast::hash(bytes);
    if computed == stored {
        return Ok(());
    }
    Err(LogError::Crc {
        path: path.into(),
        what,
        offset: offset as u64,
        stored,
        computed,
    })
}

pub(super) fn cut_in_chunk(section: &Section, path: &Path) -> LogError {
    LogError::Damaged {
        path: path.into(),
        offset: section.offset as u64,
        reason: "a record inside the chunk is cut off by its end".into(),
    }
}

pub(super) fn truncated(bytes: &[u8], path: &Path, what: &'static str, offset: usize) -> LogError {
    LogError::Truncated {
        path: path.into(),
        what,
        offset: offset as u64,
        length: bytes.len() as u64,
    }
}

/// A file that still has its end mark was not cut short: then the length of the record is what is wrong.
pub(super) fn cut_off(bytes: &[u8], path: &Path, cut: Cut) -> LogError {
    match cut.prefix {
        Some((op, length)) if bytes.ends_with(MAGIC) => LogError::Damaged {
            path: path.into(),
            offset: cut.offset as u64,
            reason: format!(
                "{} states a length of {length} bytes, but the file ends after {}",
                record_name(op),
                bytes.len() - cut.offset - PREFIX
            ),
        },
        prefix => truncated(
            bytes,
            path,
            prefix.map_or("record", |(op, _)| record_name(op)),
            cut.offset,
        ),
    }
}

pub(super) fn record_name(op: u8) -> &'static str {
    match op {
        opcode::HEADER => "header",
        opcode::FOOTER => "footer",
        opcode::SCHEMA => "schema",
        opcode::CHANNEL => "channel",
        opcode::MESSAGE => "message",
        opcode::CHUNK => "chunk",
        opcode::STATISTICS => "statistics record",
        opcode::METADATA => "metadata record",
        opcode::DATA_END => "end of data",
        _ => "record",
    }
}
