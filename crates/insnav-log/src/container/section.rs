//! Stretches of a file that hold messages.

use super::records::{Fields, PREFIX, Record};
use crate::error::LogError;
use std::ops::Range;
use std::path::Path;

/// How a chunk is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Zstd,
    Lz4,
}

impl Compression {
    /// By its name in a chunk record.
    pub(super) fn by_name(name: &str) -> Option<Self> {
        match name {
            "" => Some(Compression::None),
            "zstd" => Some(Compression::Zstd),
            "lz4" => Some(Compression::Lz4),
            _ => None,
        }
    }
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
        /// The file ends inside it: `size` bytes are what comes out of the rest.
        cut: bool,
    },
    /// Messages outside chunks, with other records between them.
    Plain(Range<usize>),
}

/// The section that a chunk record is.
pub(super) fn chunk_section(
    record: &Record<'_>,
    path: &Path,
    size_limit: usize,
) -> Result<Section, LogError> {
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
    let compression = Compression::by_name(compression).ok_or_else(|| LogError::Compression {
        path: path.into(),
        offset,
        compression: compression.into(),
    })?;
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
        cut: false,
    };
    Ok(Section {
        offset: record.offset,
        start,
        end,
        kind,
    })
}
