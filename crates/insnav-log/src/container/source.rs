//! The bytes of a file: mapped where possible, read where not.

use crate::error::LogError;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// The bytes of a log.
#[derive(Debug)]
pub(crate) enum Source {
    Map(memmap2::Mmap),
    Memory(Vec<u8>),
}

impl Source {
    /// Map a regular file; read anything else (a pipe, `-` for standard input) into memory.
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

fn read(mut from: impl Read, path: &Path) -> Result<Source, LogError> {
    let mut bytes = Vec::new();
    from.read_to_end(&mut bytes)
        .map_err(|e| LogError::opening(path, e))?;
    Ok(Source::Memory(bytes))
}

/// Logs are finished files: one that is cut while it is mapped ends the program with SIGBUS, as with every mapping reader.
#[allow(unsafe_code)]
fn map(file: &File) -> std::io::Result<memmap2::Mmap> {
    // SAFETY: the map is only ever read as plain bytes, each access is bounds-checked, and nothing in this program writes
    // to a log that it reads.
    unsafe { memmap2::Mmap::map(file) }
}
