//! The bytes of a file: mapped where possible, read where not.

use crate::error::LogError;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::Path;

/// The bytes of a log.
#[derive(Debug)]
pub(crate) enum Source {
    Map(memmap2::Mmap),
    Memory(Vec<u8>),
}

impl Source {
    /// Map a regular file; read anything else (a pipe, `-` for standard input) to its end, into memory or, when it is long,
    /// into an unnamed temporary file: a run looks at its log more than once.
    pub(crate) fn open(path: &Path) -> Result<Self, LogError> {
        if path.as_os_str() == "-" {
            return read(std::io::stdin().lock(), path);
        }
        let file = File::open(path).map_err(|e| LogError::opening(path, e))?;
        let about = file.metadata().map_err(|e| LogError::opening(path, e))?;
        if !about.is_file() || about.len() == 0 {
            return read(file, path);
        }
        map(&file)
            .map(Source::Map)
            .map_err(|e| LogError::opening(path, e))
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        match self {
            Source::Map(map) => map,
            Source::Memory(bytes) => bytes,
        }
    }
}

/// A stream of at most this many bytes is kept in memory.
const IN_MEMORY: u64 = 64 << 20;

fn read(from: impl Read, path: &Path) -> Result<Source, LogError> {
    keep(from, IN_MEMORY).map_err(|e| LogError::opening(path, e))
}

fn keep(mut from: impl Read, in_memory: u64) -> io::Result<Source> {
    let mut bytes = Vec::new();
    from.by_ref().take(in_memory).read_to_end(&mut bytes)?;
    if (bytes.len() as u64) < in_memory {
        return Ok(Source::Memory(bytes));
    }
    let fault = |e: io::Error| {
        let folder = std::env::temp_dir();
        let text = format!("no room to keep the stream in {}: {e}", folder.display());
        io::Error::new(e.kind(), text)
    };
    let mut file = tempfile::tempfile().map_err(fault)?;
    file.write_all(&bytes).map_err(fault)?;
    drop(bytes);
    io::copy(&mut from, &mut file).map_err(fault)?;
    map(&file).map(Source::Map)
}

/// Logs are finished files: one that is cut while it is mapped ends the program with SIGBUS, as with every mapping reader.
#[allow(unsafe_code)]
fn map(file: &File) -> std::io::Result<memmap2::Mmap> {
    // SAFETY: the map is only ever read as plain bytes, each access is bounds-checked, and nothing in this program writes
    // to a log that it reads.
    unsafe { memmap2::Mmap::map(file) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_is_the_same_in_memory_and_in_a_file() {
        let bytes: Vec<u8> = (0..100_000_u32).flat_map(u32::to_le_bytes).collect();
        for (in_memory, mapped) in [(1 << 20, false), (400_000, true), (1000, true), (0, true)] {
            let source = keep(bytes.as_slice(), in_memory).unwrap();
            assert_eq!(source.bytes(), bytes, "{in_memory}");
            assert_eq!(matches!(source, Source::Map(_)), mapped, "{in_memory}");
        }
        assert!(keep([].as_slice(), 10).unwrap().bytes().is_empty());
    }
}
