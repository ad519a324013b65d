//! An output that appears whole or not at all.

use crate::error::LogError;
use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, IsTerminal, Seek, SeekFrom, Stdout, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Temporary files that are being written, of the whole process: what an interruption has to remove.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn unfinished() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    // A set of paths is whole whatever a panic interrupted.
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Remove what has been begun and not finished, then `end` the process: for handlers of signals.
///
/// Until the end no output can begin or get its name, so that nothing half-written is left behind.
pub fn remove_unfinished_outputs(end: impl FnOnce()) {
    let paths = unfinished();
    for path in paths.iter() {
        let _ = fs::remove_file(path);
    }
    end();
}

/// Whether a path means standard output.
pub fn is_standard_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Find out, before the work that goes into it, whether an output can be written (`-`: standard output).
///
/// # Errors
/// It exists and `overwrite` is not set, is a folder, lies in a folder that is missing or not writable, or is a terminal.
pub fn check_output(target: &Path, overwrite: bool) -> Result<(), LogError> {
    OutputFile::create(target, overwrite).map(drop)
}

/// Write an output as a whole (`-`: standard output): it appears complete or not at all.
///
/// # Errors
/// As [`check_output`], and when there is no room.
pub fn write_output(target: &Path, bytes: &[u8], overwrite: bool) -> Result<(), LogError> {
    let mut file = OutputFile::create(target, overwrite)?;
    let written = file.write_all(bytes);
    written.map_err(|source| LogError::OutputNotWritable {
        path: target.into(),
        source,
    })?;
    file.commit().map(drop)
}

/// Where the bytes go.
#[derive(Debug)]
enum Stream {
    File(File),
    Standard(Stdout),
}

impl Write for Stream {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Stream::File(file) => file.write(bytes),
            Stream::Standard(out) => out.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Stream::File(file) => file.flush(),
            Stream::Standard(out) => out.flush(),
        }
    }
}

/// A file written under a temporary name beside its target; dropped without [`OutputFile::commit`], it leaves nothing.
///
/// The target `-` is standard output, to which bytes go as they come.
#[derive(Debug)]
pub(crate) struct OutputFile {
    target: PathBuf,
    /// `None`: standard output.
    temporary: Option<PathBuf>,
    writer: BufWriter<Stream>,
    overwrite: bool,
    /// Bytes written so far.
    length: u64,
}

impl OutputFile {
    /// Refuses an existing target unless `overwrite`, before any work is done.
    pub(crate) fn create(target: &Path, overwrite: bool) -> Result<Self, LogError> {
        let unwritable = |source| LogError::OutputNotWritable {
            path: target.into(),
            source,
        };
        if is_standard_stream(target) {
            let out = io::stdout();
            if out.is_terminal() {
                return Err(LogError::OutputIsTerminal);
            }
            return Ok(OutputFile {
                target: target.into(),
                temporary: None,
                writer: BufWriter::with_capacity(1 << 16, Stream::Standard(out)),
                overwrite,
                length: 0,
            });
        }
        let name = target.file_name().filter(|_| !target.is_dir());
        let Some(name) = name else {
            return Err(unwritable(io::Error::from(io::ErrorKind::IsADirectory)));
        };
        if !overwrite && target.exists() {
            return Err(LogError::OutputExists {
                path: target.into(),
            });
        }
        // A rename would put a file in the place of a device or a pipe.
        if fs::metadata(target).is_ok_and(|m| !m.is_file()) {
            return Err(unwritable(io::Error::new(
                io::ErrorKind::InvalidInput,
                "not a file but a device or a pipe",
            )));
        }
        let mut temporary_name = std::ffi::OsString::from(".");
        temporary_name.push(name);
        temporary_name.push(format!(".{}.partial", std::process::id()));
        let temporary = target.with_file_name(temporary_name);
        let mut open = OpenOptions::new();
        let mut paths = unfinished();
        let file = open
            .write(true)
            .create(true)
            .truncate(true)
            .open(&temporary)
            .map_err(unwritable)?;
        paths.insert(temporary.clone());
        Ok(OutputFile {
            target: target.into(),
            temporary: Some(temporary),
            writer: BufWriter::with_capacity(1 << 16, Stream::File(file)),
            overwrite,
            length: 0,
        })
    }

    /// Give the file its name. Returns its length.
    pub(crate) fn commit(mut self) -> Result<u64, LogError> {
        let target = self.target.clone();
        let unwritable = |source| LogError::OutputNotWritable {
            path: target.clone(),
            source,
        };
        self.writer.flush().map_err(unwritable)?;
        let Some(temporary) = &self.temporary else {
            return Ok(self.length);
        };
        // Held until the name is given: an interruption comes before or after, not in between.
        let mut paths = unfinished();
        if !self.overwrite && self.target.exists() {
            // It appeared while we were writing.
            return Err(LogError::OutputExists { path: target });
        }
        fs::rename(temporary, &self.target).map_err(unwritable)?;
        paths.remove(temporary);
        self.temporary = None;
        Ok(self.length)
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.writer.write(bytes)?;
        self.length += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

/// Tells where it is, and goes nowhere else: a pipe cannot, so nothing here may rely on it.
impl Seek for OutputFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) | SeekFrom::End(0) => Ok(self.length),
            SeekFrom::Start(at) if at == self.length => Ok(at),
            _ => Err(io::Error::from(io::ErrorKind::NotSeekable)),
        }
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        if let Some(temporary) = self.temporary.take() {
            let mut paths = unfinished();
            let _ = fs::remove_file(&temporary);
            paths.remove(&temporary);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn appears_on_commit_only_and_is_not_overwritten_unasked() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out.txt");
        let count = || fs::read_dir(folder.path()).unwrap().count();

        let mut file = OutputFile::create(&target, false).unwrap();
        file.write_all(b"half").unwrap();
        assert!(!target.exists());
        drop(file);
        assert_eq!(count(), 0);

        let mut file = OutputFile::create(&target, false).unwrap();
        file.write_all(b"whole").unwrap();
        assert_eq!(file.commit().unwrap(), 5);
        assert_eq!(fs::read(&target).unwrap(), b"whole");
        assert_eq!(
            OutputFile::create(&target, false).unwrap_err().code(),
            "output_exists"
        );

        let mut file = OutputFile::create(&target, true).unwrap();
        file.write_all(b"new").unwrap();
        file.commit().unwrap();
        assert_eq!(
            (fs::read(&target).unwrap().as_slice(), count()),
            (b"new".as_slice(), 1)
        );
    }

    #[test]
    fn a_folder_that_is_not_there_is_not_writable() {
        let folder = tempfile::tempdir().unwrap();
        let error = OutputFile::create(&folder.path().join("no/such/out.mcap"), false).unwrap_err();
        assert_eq!(error.code(), "output_not_writable");
        assert_eq!(
            OutputFile::create(folder.path(), true).unwrap_err().code(),
            "output_not_writable"
        );
    }
}
