//! An output that appears whole or not at all.

use crate::error::LogError;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A file written under a temporary name beside its target; dropped without [`OutputFile::commit`], it leaves nothing.
#[derive(Debug)]
pub(crate) struct OutputFile {
    target: PathBuf,
    temporary: PathBuf,
    writer: Option<BufWriter<File>>,
    overwrite: bool,
}

impl OutputFile {
    /// Refuses an existing target unless `overwrite`, before any work is done.
    pub(crate) fn create(target: &Path, overwrite: bool) -> Result<Self, LogError> {
        let unwritable = |source| LogError::OutputNotWritable {
            path: target.into(),
            source,
        };
        if !overwrite && target.exists() {
            return Err(LogError::OutputExists {
                path: target.into(),
            });
        }
        let Some(name) = target.file_name() else {
            return Err(unwritable(io::Error::from(io::ErrorKind::IsADirectory)));
        };
        if target.is_dir() {
            return Err(unwritable(io::Error::from(io::ErrorKind::IsADirectory)));
        }
        let mut temporary_name = std::ffi::OsString::from(".");
        temporary_name.push(name);
        temporary_name.push(format!(".{}.partial", std::process::id()));
        let temporary = target.with_file_name(temporary_name);
        let mut open = OpenOptions::new();
        let file = open
            .read(true)
            .write(true)
            .create(true)
            .truncate(true)
            .open(&temporary)
            .map_err(unwritable)?;
        Ok(OutputFile {
            target: target.into(),
            temporary,
            writer: Some(BufWriter::with_capacity(1 << 16, file)),
            overwrite,
        })
    }

    /// Give the file its name. Returns its length.
    pub(crate) fn commit(mut self) -> Result<u64, LogError> {
        let target = self.target.clone();
        let unwritable = |source| LogError::OutputNotWritable {
            path: target.clone(),
            source,
        };
        let mut length = 0;
        if let Some(mut writer) = self.writer.take() {
            writer.flush().map_err(unwritable)?;
            length = writer.get_ref().metadata().map_err(unwritable)?.len();
        }
        if !self.overwrite && self.target.exists() {
            // It appeared while we were writing.
            return Err(LogError::OutputExists { path: target });
        }
        fs::rename(&self.temporary, &self.target).map_err(unwritable)?;
        Ok(length)
    }

    fn writer(&mut self) -> io::Result<&mut BufWriter<File>> {
        self.writer
            .as_mut()
            .ok_or_else(|| io::Error::from(io::ErrorKind::BrokenPipe))
    }
}

impl Write for OutputFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer()?.flush()
    }
}

impl Seek for OutputFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.writer()?.seek(to)
    }

    fn stream_position(&mut self) -> io::Result<u64> {
        // Unlike `seek`, this does not flush the buffer; the MCAP writer asks often.
        self.writer()?.stream_position()
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        // After a commit there is nothing under this name any more, and that is as good.
        let _ = fs::remove_file(&self.temporary);
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
