//! An output that appears whole or not at all.

use crate::error::LogError;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, IsTerminal, Seek, SeekFrom, Stdout, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

/// Who writes a temporary file.
#[derive(Debug)]
struct Writer {
    /// That has begun it.
    thread: ThreadId,
    /// Nobody wants it any more: it is removed already, and does not get its name.
    abandoned: bool,
}

/// Temporary files that are being written, of the whole process: what an interruption has to remove.
static UNFINISHED: Mutex<BTreeMap<PathBuf, Writer>> = Mutex::new(BTreeMap::new());

fn unfinished() -> MutexGuard<'static, BTreeMap<PathBuf, Writer>> {
    // A map of paths is whole whatever a panic interrupted.
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Remove what has been begun and not finished, then `end` the process: for handlers of signals.
///
/// Until the end no output can begin or get its name, so that nothing half-written is left behind.
pub fn remove_unfinished_outputs(end: impl FnOnce()) {
    let writers = unfinished();
    for path in writers.keys() {
        let _ = fs::remove_file(path);
    }
    end();
}

/// Give up the outputs that a thread has begun and not finished, for one who waits for that thread no longer: what there is of them is
/// removed, and whatever the thread still does, they do not appear. Returns how many there were.
pub fn abandon_outputs_of(thread: ThreadId) -> usize {
    let mut writers = unfinished();
    let mut count = 0;
    for (path, writer) in writers.iter_mut() {
        // Where an open file cannot be removed, it stays with its writer; one that somebody else has removed is gone.
        let removed = || match fs::remove_file(path) {
            Ok(()) => true,
            Err(e) => e.kind() == io::ErrorKind::NotFound,
        };
        if writer.thread == thread && !writer.abandoned && removed() {
            writer.abandoned = true;
            count += 1;
        }
    }
    count
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
        if target.file_name().is_none() || target.is_dir() {
            return Err(unwritable(io::Error::from(io::ErrorKind::IsADirectory)));
        }
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
        let mut open = OpenOptions::new();
        let mut writers = unfinished();
        let mut temporary = temporary_name(target, 0);
        let mut others = 0;
        while writers.contains_key(&temporary) {
            others += 1;
            temporary = temporary_name(target, others);
        }
        let file = open
            .write(true)
            .create(true)
            .truncate(true)
            .open(&temporary)
            .map_err(unwritable)?;
        writers.insert(
            temporary.clone(),
            Writer {
                thread: thread::current().id(),
                abandoned: false,
            },
        );
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
        let mut writers = unfinished();
        if writers.get(temporary).is_none_or(|w| w.abandoned) {
            return Err(unwritable(io::Error::from(io::ErrorKind::Interrupted)));
        }
        if !self.overwrite && self.target.exists() {
            // It appeared while we were writing.
            return Err(LogError::OutputExists { path: target });
        }
        fs::rename(temporary, &self.target).map_err(unwritable)?;
        writers.remove(temporary);
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
            let mut writers = unfinished();
            if writers.remove(&temporary).is_some_and(|w| !w.abandoned) {
                let _ = fs::remove_file(&temporary);
            }
        }
    }
}

/// Beside the target, of this process; `others` writers of it have that target too.
fn temporary_name(target: &Path, others: usize) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(format!(".{}", std::process::id()));
    if others > 0 {
        name.push(format!(".{others}"));
    }
    name.push(".partial");
    target.with_file_name(name)
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

    /// Whoever writes it goes on unheard, and is in nobody's way.
    #[test]
    fn an_abandoned_output_is_gone_at_once_and_does_not_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out.txt");
        let names = || fs::read_dir(folder.path()).unwrap().count();
        let begin = |text: &str| {
            let mut file = OutputFile::create(&target, true).unwrap();
            file.write_all(text.as_bytes()).unwrap();
            file
        };
        let own = begin("own");
        let worker = thread::scope(|scope| {
            let worker = scope.spawn(|| (thread::current().id(), [begin("one"), begin("two")]));
            worker.join().unwrap()
        });
        let (thread, [one, two]) = worker;
        assert_eq!(names(), 3);
        assert_eq!((abandon_outputs_of(thread), names()), (2, 1));
        assert_eq!(abandon_outputs_of(thread), 0);

        let next = begin("next");
        let refused = one.commit().unwrap_err();
        assert_eq!(refused.code(), "output_not_writable");
        drop(two);
        assert_eq!((names(), target.exists()), (2, false));
        // The control: those of other threads.
        next.commit().unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"next");
        own.commit().unwrap();
        assert_eq!(fs::read(&target).unwrap(), b"own");
        assert_eq!(names(), 1);
    }

    /// One who gives up waits for it to be gone, and so it is.
    #[test]
    fn an_output_that_somebody_else_has_removed_is_given_up() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("out.txt");
        let file = OutputFile::create(&target, true).unwrap();
        let own = thread::current().id();
        fs::remove_file(file.temporary.as_ref().unwrap()).unwrap();
        assert_eq!(abandon_outputs_of(own), 1);
        assert_eq!(abandon_outputs_of(own), 0);
        assert_eq!(file.commit().unwrap_err().code(), "output_not_writable");
        assert!(!target.exists());
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
