//! Writes ROS 2 messages into an MCAP file.

use crate::cdr::{CdrWriter, Endian};
use crate::error::LogError;
use crate::output_file::OutputFile;
use crate::ros2::{Encode, schema_text};
use insnav_core::time::Time;
use mcap::records::{MessageHeader, Metadata};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// How chunks are compressed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None,
    /// LZ4: fast.
    Lz4,
    /// Zstandard: small.
    #[default]
    Zstd,
}

impl Compression {
    /// By the name used on the command line.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "none" => Some(Compression::None),
            "lz4" => Some(Compression::Lz4),
            "zstd" => Some(Compression::Zstd),
            _ => None,
        }
    }
}

/// One topic of the file being written.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ChannelHandle {
    id: u16,
}

/// An MCAP file of profile `ros2` in the making.
pub(crate) struct McapWriter {
    path: PathBuf,
    writer: mcap::Writer<OutputFile>,
    cdr: CdrWriter,
    /// Messages written, by channel: their sequence numbers.
    sequences: Vec<u32>,
}

impl McapWriter {
    pub(crate) fn create(
        path: &Path,
        force: bool,
        compression: Compression,
    ) -> Result<Self, LogError> {
        let file = OutputFile::create(path, force)?;
        let options = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("insnav ", env!("CARGO_PKG_VERSION")))
            .compression(match compression {
                Compression::None => None,
                Compression::Lz4 => Some(mcap::Compression::Lz4),
                Compression::Zstd => Some(mcap::Compression::Zstd),
            })
            // One thread: the navigator leaves the other cores to further logs.
            .compression_threads(0)
            // Chunks are put together in memory: a pipe cannot go back to fill in their lengths.
            .disable_seeking(true)
            .calculate_chunk_crcs(true);
        let writer = options.create(file).map_err(|e| failed(path, e))?;
        Ok(McapWriter {
            path: path.into(),
            writer,
            cdr: CdrWriter::new(Endian::Little),
            sequences: Vec::new(),
        })
    }

    /// Add a topic of the type `M`.
    pub(crate) fn channel<M: Encode>(&mut self, topic: &str) -> Result<ChannelHandle, LogError> {
        let text = schema_text(M::SCHEMA).unwrap_or_default();
        let schema = self
            .writer
            .add_schema(M::SCHEMA, "ros2msg", text.as_bytes())
            .map_err(|e| failed(&self.path, e))?;
        // rosbag2 and its readers look for this key; empty means "not known".
        let metadata = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
        let id = self
            .writer
            .add_channel(schema, topic, "cdr", &metadata)
            .map_err(|e| failed(&self.path, e))?;
        let id_index = usize::from(id);
        if self.sequences.len() <= id_index {
            self.sequences.resize(id_index + 1, 0);
        }
        Ok(ChannelHandle { id })
    }

    /// Write a message, recorded and published at `time`. Times before 1970 cannot be stored and become 1970.
    pub(crate) fn write<M: Encode>(
        &mut self,
        channel: ChannelHandle,
        time: Time,
        message: &M,
    ) -> Result<(), LogError> {
        self.cdr.clear();
        message.write(&mut self.cdr);
        let sequence = &mut self.sequences[usize::from(channel.id)];
        let log_time = time.0.max(0) as u64;
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: *sequence,
            log_time,
            publish_time: log_time,
        };
        *sequence = sequence.wrapping_add(1);
        self.writer
            .write_to_known_channel(&header, self.cdr.bytes())
            .map_err(|e| failed(&self.path, e))
    }

    /// How many messages each channel has, and the channels before the first.
    pub(crate) fn sequences(&self) -> &[u32] {
        &self.sequences
    }

    /// Count on from another file's numbers.
    pub(crate) fn continue_sequences(&mut self, sequences: &[u32]) {
        for (own, other) in self.sequences.iter_mut().zip(sequences) {
            *own = *other;
        }
    }

    pub(crate) fn write_metadata(
        &mut self,
        name: &str,
        metadata: BTreeMap<String, String>,
    ) -> Result<(), LogError> {
        let record = Metadata {
            name: name.to_owned(),
            metadata,
        };
        self.writer
            .write_metadata(&record)
            .map_err(|e| failed(&self.path, e))
    }

    /// Complete the file and give it its name. Returns its length in bytes.
    pub(crate) fn finish(mut self) -> Result<u64, LogError> {
        self.writer.finish().map_err(|e| failed(&self.path, e))?;
        self.writer.into_inner().commit()
    }
}

fn failed(path: &Path, error: mcap::McapError) -> LogError {
    match error {
        mcap::McapError::Io(source) => LogError::OutputNotWritable {
            path: path.into(),
            source,
        },
        other => LogError::Write {
            path: path.into(),
            source: Box::new(other),
        },
    }
}
