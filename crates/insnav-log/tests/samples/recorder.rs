//! Logs made message by message.

use insnav_core::sample::Sample;
use insnav_core::time::Time;
use insnav_log::cdr::{CdrWriter, Endian};
use insnav_log::ros2::*;
use insnav_log::{Log, LogError, ReadOptions};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::path::Path;

pub(crate) const SECOND: i64 = 1_000_000_000;
pub(crate) const T0: i64 = 1_600_000_000 * SECOND;

/// A log made message by message, so that it can be as odd as real ones are.
pub(crate) struct Recorder {
    pub(crate) writer: mcap::Writer<std::io::Cursor<Vec<u8>>>,
    pub(crate) channels: BTreeMap<String, u16>,
    pub(crate) endian: Endian,
}

impl Recorder {
    pub(crate) fn new() -> Self {
        let file = std::io::Cursor::new(Vec::new());
        let writer = mcap::WriteOptions::new()
            .profile("ros2")
            .compression(None)
            .create(file)
            .unwrap();
        Recorder {
            writer,
            channels: BTreeMap::new(),
            endian: Endian::Little,
        }
    }

    pub(crate) fn put<M: Encode>(&mut self, topic: &str, log_time: i64, message: &M) {
        if !self.channels.contains_key(topic) {
            let text = schema_text(M::SCHEMA).unwrap();
            let schema = self
                .writer
                .add_schema(M::SCHEMA, "ros2msg", text.as_bytes())
                .unwrap();
            let id = self
                .writer
                .add_channel(schema, topic, "cdr", &BTreeMap::new())
                .unwrap();
            self.channels.insert(topic.into(), id);
        }
        let mut cdr = CdrWriter::new(self.endian);
        message.write(&mut cdr);
        self.raw(topic, log_time, cdr.bytes());
    }

    pub(crate) fn raw(&mut self, topic: &str, log_time: i64, bytes: &[u8]) {
        let header = mcap::records::MessageHeader {
            channel_id: self.channels[topic],
            sequence: 0,
            log_time: log_time as u64,
            publish_time: log_time as u64 + 7,
        };
        self.writer.write_to_known_channel(&header, bytes).unwrap();
    }

    /// A message that another program wrote, with its type's name, the language and text of its definition, and its encoding.
    pub(crate) fn foreign(
        &mut self,
        topic: &str,
        log_time: i64,
        kind: [&str; 3],
        definition: &[u8],
        bytes: &[u8],
    ) {
        let [name, language, encoding] = kind;
        if !self.channels.contains_key(topic) {
            let schema = self.writer.add_schema(name, language, definition).unwrap();
            let id = self
                .writer
                .add_channel(schema, topic, encoding, &BTreeMap::new())
                .unwrap();
            self.channels.insert(topic.into(), id);
        }
        self.raw(topic, log_time, bytes);
    }

    pub(crate) fn imu(&mut self, topic: &str, log_time: i64, stamp: i64) {
        let message = Imu {
            header: Header {
                stamp: Time(stamp),
                frame_id: "imu",
            },
            angular_velocity: Vector3::new(0.1, 0.2, 0.3),
            linear_acceleration: Vector3::new(1.0, 2.0, 9.8),
            ..Imu::default()
        };
        self.put(topic, log_time, &message);
    }

    pub(crate) fn fix(&mut self, time: i64, change: impl FnOnce(&mut NavSatFix<'_>)) {
        let mut message = NavSatFix {
            header: Header {
                stamp: Time(time),
                frame_id: "gps",
            },
            latitude_deg: 59.0,
            longitude_deg: 18.0,
            altitude_m: 30.0,
            ..NavSatFix::default()
        };
        change(&mut message);
        self.put("/fix", time, &message);
    }

    pub(crate) fn open(mut self, options: ReadOptions) -> Result<Log, LogError> {
        self.writer.finish().unwrap();
        Log::from_bytes(
            Path::new("made.mcap"),
            self.writer.into_inner().into_inner(),
            options,
        )
    }
}

pub(crate) fn samples(log: &Log) -> Vec<Sample> {
    log.samples().unwrap().map(Result::unwrap).collect()
}

pub(crate) fn times(log: &Log) -> Vec<i64> {
    samples(log).iter().map(|s| s.time().0).collect()
}
