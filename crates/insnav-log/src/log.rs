//! A log: an MCAP file, opened for reading.

use crate::container::{
    Checksums, Contents, McapRecord, Message, Messages, Recovery, Source, each_record,
};
use crate::content::{Format, MessageReader, Stamp};
use crate::error::LogError;
use crate::imu_units::ImuUnits;
use crate::message::MessageKind;
use crate::samples::{Samples, gnss_position};
use crate::topic_map::TopicMap;
use crate::topics::{Choice, NO_TOPIC, Role, Selection, TopicInfo, mean_rate};
use crate::transforms::Mounting;
use crate::velocity_axes::VelocityAxes;
use crate::wire::DecodeError;
use insnav_core::config::Config;
use insnav_core::sample::GnssPosition;
use insnav_core::time::Time;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Axes of the IMU's messages, before any mounting rotation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ImuAxes {
    /// Forward, left, up: what ROS prescribes ([REP-103]).
    #[default]
    Flu,
    /// Forward, right, down: what many drivers publish all the same.
    Frd,
}

/// Which stamp of a message counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TimeSource {
    /// The stamp in the message's header; the log time where that is zero.
    #[default]
    Header,
    /// When the message was recorded.
    Log,
    /// When the message was published.
    Publish,
}

/// How to read a log.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// Topics by role; `none` leaves a role empty. A role that is not named here is filled by the only topic that can serve.
    pub topics: Vec<(Role, String)>,
    /// Axes of the IMU's messages.
    pub imu_axes: ImuAxes,
    /// Roll, pitch, yaw of the IMU's axes in those of the body, degrees: `v_body = Rz(yaw) Ry(pitch) Rx(roll) v_imu`, both
    /// forward-left-up or both forward-right-down as `imu_axes` says. The angles of a URDF or of `/tf_static`.
    pub imu_mounting_rpy_deg: Option<[f64; 3]>,
    /// Which stamp counts.
    pub time_source: TimeSource,
    /// How long a sample waits for earlier ones, s of log time.
    pub reorder_window_s: f64,
    /// Height of the geoid above the ellipsoid, m, added to every altitude: for receivers that publish height above sea level.
    pub geoid_height_m: f64,
    /// Units of the IMU's messages.
    pub imu_units: ImuUnits,
    /// Axes of GNSS velocity messages.
    pub gnss_velocity_axes: VelocityAxes,
    /// What fields of messages are, of types that are not known here; a map goes before what is known.
    pub maps: Vec<TopicMap>,
    /// Largest uncompressed size of a chunk, bytes: a damaged size is refused before memory is reserved for it.
    pub chunk_size_limit: usize,
    /// Keep what is readable of a damaged file instead of refusing it; [`Log::recovery`] then tells what was lost.
    pub recover: bool,
}

impl Default for ReadOptions {
    fn default() -> Self {
        ReadOptions {
            topics: Vec::new(),
            imu_axes: ImuAxes::Flu,
            imu_mounting_rpy_deg: None,
            time_source: TimeSource::Header,
            reorder_window_s: 1.0,
            geoid_height_m: 0.0,
            imu_units: ImuUnits::default(),
            gnss_velocity_axes: VelocityAxes::default(),
            maps: Vec::new(),
            chunk_size_limit: 1 << 30,
            recover: false,
        }
    }
}

impl ReadOptions {
    /// Whether no topic is wanted for a role.
    pub(crate) fn leaves_out(&self, role: Role) -> bool {
        let last = self.topics.iter().rev().find(|(r, _)| *r == role);
        last.is_some_and(|(_, name)| name == NO_TOPIC)
    }

    /// With what the settings say of the reading: the mounting, unless one is given already, and whether GNSS is read at all.
    #[must_use]
    pub fn with_settings_of(mut self, config: &Config) -> Self {
        if !config.gnss.used {
            for role in [Role::GnssPosition, Role::GnssVelocity] {
                self.topics.push((role, NO_TOPIC.into()));
            }
        }
        let [roll, pitch, yaw] = config.imu.mounting_rpy_deg;
        if self.imu_mounting_rpy_deg.is_none() && [roll, pitch, yaw] != [0.0; 3] {
            // The settings are forward-right-down; in forward-left-up the same rotation has pitch and yaw reversed.
            self.imu_mounting_rpy_deg = Some(match self.imu_axes {
                ImuAxes::Frd => [roll, pitch, yaw],
                ImuAxes::Flu => [roll, -pitch, -yaw],
            });
        }
        self
    }
}

/// Name of the metadata record of our own files.
pub const METADATA_NAME: &str = "insnav";
/// Key in that record: the instant, in ns, from which every `*_s` of the user interface counts.
pub const METADATA_T0: &str = "t0_ns";

/// An MCAP log, its topics found and chosen.
#[derive(Debug)]
pub struct Log {
    path: PathBuf,
    source: Source,
    contents: Contents,
    topics: Vec<TopicInfo>,
    /// How to read each of them.
    formats: Vec<Option<Format>>,
    selection: Selection,
    options: ReadOptions,
    /// What is added to the own clocks of sensors, ns, by topic.
    clock_shifts: OnceLock<BTreeMap<usize, i64>>,
    /// How the IMU is mounted by the static transforms.
    pub(crate) mounting: OnceLock<Option<Mounting>>,
}

impl Log {
    /// Open a file (`-`: standard input), check its structure and find its topics. The messages are not read yet.
    ///
    /// A log without IMU or GNSS opens all the same, so that its topics can be listed: [`Log::require`] is where a missing
    /// or ambiguous topic becomes an error.
    pub fn open(path: &Path, options: ReadOptions) -> Result<Log, LogError> {
        Log::new(path, Source::open(path)?, options)
    }

    /// As [`Log::open`], for the bytes of a file that is already in memory; the path is for messages only.
    pub fn from_bytes(path: &Path, bytes: Vec<u8>, options: ReadOptions) -> Result<Log, LogError> {
        Log::new(path, Source::Memory(bytes), options)
    }

    /// The same bytes with other options: standard input cannot be opened twice.
    pub fn read_anew(self, options: ReadOptions) -> Result<Log, LogError> {
        Log::new(&self.path, self.source, options)
    }

    fn new(path: &Path, source: Source, options: ReadOptions) -> Result<Log, LogError> {
        let (bytes, limit) = (source.bytes(), options.chunk_size_limit);
        let contents = if options.recover {
            Contents::recover(bytes, path, limit)?
        } else {
            Contents::read(bytes, path, limit)?
        };
        let (topics, formats) = list_topics(&contents, &options.maps, bytes, path)?;
        let selection = Selection::find(&topics, &options.topics, path)?;
        Ok(Log {
            path: path.into(),
            source,
            contents,
            topics,
            formats,
            selection,
            options,
            clock_shifts: OnceLock::new(),
            mounting: OnceLock::new(),
        })
    }

    /// The path it was opened with.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The whole file.
    pub fn bytes(&self) -> &[u8] {
        self.source.bytes()
    }

    /// CRC-32 of the whole file, to tell later which file a result came from.
    pub fn crc32(&self) -> u32 {
        // The checksum of the data section covers all but the summary.
        let (length, crc) = self.contents.data_crc.unwrap_or_default();
        let mut hasher = crc32fast::Hasher::new_with_initial_len(crc, length as u64);
        hasher.update(&self.source.bytes()[length..]);
        hasher.finalize()
    }

    /// What was lost of a damaged file; `None` unless it was opened with [`ReadOptions::recover`].
    pub fn recovery(&self) -> Option<&Recovery> {
        self.contents.recovery.as_ref()
    }

    /// Whether the file has checksums by which damage to its messages would be noticed.
    pub fn checksums(&self) -> Checksums {
        self.contents.checksums
    }

    /// Call `each` with every record of the file in order, those inside a chunk where the chunk is: for programs that look at
    /// the container itself. Damage is an error here, with or without recovery.
    pub fn each_record<E: From<LogError>>(
        &self,
        each: impl FnMut(&McapRecord<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        each_record(self.source.bytes(), &self.path, each)
    }

    /// How it is being read.
    pub fn options(&self) -> &ReadOptions {
        &self.options
    }

    /// Every topic, by name.
    pub fn topics(&self) -> &[TopicInfo] {
        &self.topics
    }

    /// Which topic plays which part.
    pub fn selected(&self) -> &Selection {
        &self.selection
    }

    /// The topic of a role, or the error that lists what there is.
    pub fn require(&self, role: Role) -> Result<&TopicInfo, LogError> {
        match self.selection.choice(role) {
            Choice::Topic(index) => Ok(&self.topics[*index]),
            Choice::None => Err(LogError::NoTopic {
                path: self.path.clone(),
                role,
                topics: self.topics.iter().map(TopicInfo::to_string).collect(),
            }),
            Choice::Ambiguous(candidates) => Err(LogError::AmbiguousTopic {
                path: self.path.clone(),
                role,
                candidates: candidates
                    .iter()
                    .map(|&i| self.topics[i].name.clone())
                    .collect(),
            }),
        }
    }

    /// The topic of a role, or `None` when there is none; ambiguity is an error.
    pub fn optional(&self, role: Role) -> Result<Option<&TopicInfo>, LogError> {
        match self.selection.choice(role) {
            Choice::None => Ok(None),
            _ => self.require(role).map(Some),
        }
    }

    /// A metadata record by name.
    pub fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.contents.metadata.get(name)
    }

    /// Profile and library of the file's header.
    pub fn written_by(&self) -> (&str, &str) {
        (&self.contents.profile, &self.contents.library)
    }

    /// True when the topics were known from the file's summary, without reading the messages.
    pub fn is_indexed(&self) -> bool {
        self.contents.indexed
    }

    /// Earliest and latest log time.
    pub fn time_range(&self) -> Option<(Time, Time)> {
        self.contents
            .time_range()
            .map(|(first, last)| (Time(first as i64), Time(last as i64)))
    }

    /// The instant from which `*_s` counts: as the metadata say, else the first IMU stamp.
    pub fn t0(&self) -> Result<Option<Time>, LogError> {
        let stated = self
            .metadata(METADATA_NAME)
            .and_then(|pairs| pairs.get(METADATA_T0))
            .and_then(|t| t.parse().ok());
        if let Some(t0) = stated {
            return Ok(Some(Time(t0)));
        }
        let Some(imu) = self.selection.topic(Role::Imu) else {
            return Ok(None);
        };
        let mut messages = self.messages(&[imu]);
        messages
            .next()
            .transpose()?
            .map(|message| self.stamp(imu, &message))
            .transpose()
    }

    /// The first GNSS position that can be used.
    pub fn first_fix(&self) -> Result<Option<GnssPosition>, LogError> {
        let Some(topic) = self.selection.topic(Role::GnssPosition) else {
            return Ok(None);
        };
        let mut messages = self.messages(&[topic]);
        let mut reader = self.reader(topic)?;
        while let Some(message) = messages.next() {
            let message = message?;
            let content = reader
                .content(message.data)
                .map_err(|e| self.undecodable(topic, &message, e))?;
            let time = self.choose_stamp(content.stamp, topic, &message)?;
            if let Some(fix) = &content.position
                && let Ok(fix) = gnss_position(fix, time, self.options.geoid_height_m)
            {
                return Ok(Some(fix));
            }
        }
        Ok(None)
    }

    /// The samples in time order, ready for the navigator.
    pub fn samples(&self) -> Result<Samples<'_>, LogError> {
        Samples::new(self)
    }

    /// The messages of some topics (indices into [`Log::topics`]) in order of log time.
    pub(crate) fn messages(&self, topics: &[usize]) -> Messages<'_> {
        let channels: Vec<u16> = topics
            .iter()
            .flat_map(|&i| self.topics[i].channels.iter().copied())
            .collect();
        Messages::new(self.source.bytes(), &self.path, &self.contents, &channels)
    }

    /// Call `each` with every message of a topic in order of log time: for readers of message types of their own.
    pub fn each_message<E: From<LogError>>(
        &self,
        topic: &TopicInfo,
        mut each: impl FnMut(&Message<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut messages = Messages::new(
            self.source.bytes(),
            &self.path,
            &self.contents,
            &topic.channels,
        );
        while let Some(message) = messages.next() {
            each(&message?)?;
        }
        Ok(())
    }

    /// The topic that declares standing, where one is taken and no map of the settings names it already.
    pub(crate) fn standing_topic(&self) -> Option<&str> {
        let index = self.selection.topic(Role::Standing)?;
        let topic = &self.topics[index];
        (topic.kind != Some(MessageKind::Mapped)).then_some(&*topic.name)
    }

    /// The user's map of a topic.
    fn map_of(&self, topic: usize) -> Option<&TopicMap> {
        let name = &self.topics[topic].name;
        self.options.maps.iter().find(|map| map.topic == *name)
    }

    /// A reader of a topic's messages.
    pub(crate) fn reader(&self, topic: usize) -> Result<MessageReader, LogError> {
        match (self.topics[topic].kind, &self.formats[topic]) {
            (Some(kind), Some(format)) => {
                let map = self.map_of(topic).cloned().map(Arc::new);
                Ok(MessageReader::new(kind, format.clone(), map))
            }
            _ => Err(LogError::NotUnderstood {
                path: self.path.clone(),
                topic: self.topics[topic].to_string(),
            }),
        }
    }

    fn stamp(&self, topic: usize, message: &Message<'_>) -> Result<Time, LogError> {
        let mut reader = self.reader(topic)?;
        let content = reader
            .content(message.data)
            .map_err(|e| self.undecodable(topic, message, e))?;
        self.choose_stamp(content.stamp, topic, message)
    }

    /// The stamp that counts. A stamp of zero is one that the driver never set.
    #[inline]
    pub(crate) fn choose_stamp(
        &self,
        stamp: Stamp,
        topic: usize,
        message: &Message<'_>,
    ) -> Result<Time, LogError> {
        Ok(match (self.options.time_source, stamp) {
            (TimeSource::Header, Stamp::Host(time)) if time.0 != 0 => time,
            (TimeSource::Header, Stamp::Own(time)) => {
                Time(time.0.saturating_add(self.clock_shift(topic)?))
            }
            (TimeSource::Header | TimeSource::Log, _) => message.log_time,
            (TimeSource::Publish, _) => message.publish_time,
        })
    }

    /// What is added to stamps on a topic's own clock (a sensor's power-on, a receiver's UTC), ns.
    ///
    /// Such clocks are put onto the recorder's by one constant: the least difference between log time and stamp, which is that
    /// of the message with the least delay. A difference of less than half a second is taken for the delay itself, and the
    /// stamps stay as they are. The topics of an autopilot share its clock, and the constant. Drift between the clocks stays.
    pub(crate) fn clock_shift(&self, topic: usize) -> Result<i64, LogError> {
        if self.clock_shifts.get().is_none() {
            let shifts = self.find_clock_shifts()?;
            // Whoever was first: the values are the same.
            let _ = self.clock_shifts.set(shifts);
        }
        let shifts = self.clock_shifts.get();
        Ok(shifts
            .and_then(|shifts| shifts.get(&topic))
            .copied()
            .unwrap_or(0))
    }

    fn find_clock_shifts(&self) -> Result<BTreeMap<usize, i64>, LogError> {
        /// Enough for a message without a queue before it.
        const LOOKED_AT: usize = 2000;
        const DELAY_NS: i64 = 500_000_000;
        /// A stamp that is off from the others by more is wrong, and no message with little delay.
        const SPREAD_NS: i64 = 1_000_000_000;
        let mut differences: BTreeMap<usize, Vec<i64>> = BTreeMap::new();
        let clock_of = |topic: usize| match self.topics[topic].kind {
            // One clock for all: that of the first of them.
            Some(MessageKind::SensorCombined | MessageKind::SensorGps) => self
                .topics
                .iter()
                .position(|t| {
                    matches!(
                        t.kind,
                        Some(MessageKind::SensorCombined | MessageKind::SensorGps)
                    )
                })
                .unwrap_or(topic),
            _ => topic,
        };
        let has_own_clock = |topic: &usize| {
            matches!(
                self.topics[*topic].kind,
                Some(
                    MessageKind::SensorCombined
                        | MessageKind::SensorGps
                        | MessageKind::NavPvt
                        | MessageKind::Mapped
                )
            ) && self.formats[*topic].is_some()
        };
        let topics: Vec<usize> = (0..self.topics.len()).filter(has_own_clock).collect();
        for &topic in &topics {
            let mut reader = self.reader(topic)?;
            let mut messages = self.messages(&[topic]);
            for _ in 0..LOOKED_AT {
                let Some(message) = messages.next() else {
                    break;
                };
                let message = message?;
                // What cannot be read is told where it is used.
                if let Ok(content) = reader.content(message.data)
                    && let Stamp::Own(stamp) = content.stamp
                {
                    let difference = message.log_time.0.saturating_sub(stamp.0);
                    differences
                        .entry(clock_of(topic))
                        .or_default()
                        .push(difference);
                }
            }
        }
        let least: BTreeMap<usize, i64> = differences
            .into_iter()
            .filter_map(|(clock, mut all)| {
                let middle = all.len() / 2;
                let median = *all.select_nth_unstable(middle).1;
                let believed = all
                    .into_iter()
                    .filter(|d| median.saturating_sub(*d) < SPREAD_NS);
                Some((clock, believed.min()?))
            })
            .collect();
        Ok(topics
            .into_iter()
            .filter_map(|topic| Some((topic, *least.get(&clock_of(topic))?)))
            .filter(|(_, shift)| shift.abs() >= DELAY_NS)
            .collect())
    }

    pub(crate) fn undecodable(
        &self,
        topic: usize,
        message: &Message<'_>,
        source: DecodeError,
    ) -> LogError {
        if let DecodeError::NotMapped { key, index, found } = source
            && let Some(map) = self.map_of(topic)
        {
            let mut reader = self.reader(topic).ok();
            let fields = reader
                .as_mut()
                .and_then(|reader| Some(reader.fields(message.data).ok()?.number_paths()));
            return LogError::NotMapped {
                path: self.path.clone(),
                topic: self.topics[topic].name.as_str().into(),
                time: message.log_time,
                key,
                field: map.field(key, index).unwrap_or_default().into(),
                found,
                fields: fields.unwrap_or_default().into(),
            };
        }
        let topic = &self.topics[topic];
        LogError::Decode {
            path: self.path.clone(),
            topic: topic.name.clone(),
            time: message.log_time,
            schema: match topic.kind {
                Some(kind) => kind.to_string(),
                None => topic.schema.clone(),
            },
            source: Box::new(source),
        }
    }
}

/// Topics by name, and how to read them. Channels of one topic and type count as one topic; a topic with two types is
/// listed twice.
fn list_topics(
    contents: &Contents,
    maps: &[TopicMap],
    bytes: &[u8],
    path: &Path,
) -> Result<(Vec<TopicInfo>, Vec<Option<Format>>), LogError> {
    type Key<'a> = (&'a str, &'a str, &'a str);
    let mut topics: BTreeMap<Key<'_>, (TopicInfo, &[u8], bool)> = BTreeMap::new();
    let range = contents.time_range();
    for (id, channel) in &contents.channels {
        let schema = contents.schemas.get(&channel.schema);
        let name = schema.map_or("", |s| s.name.as_str());
        let (topic, ..) = topics
            .entry((&channel.topic, name, &channel.encoding))
            .or_insert_with(|| {
                let topic = TopicInfo {
                    name: channel.topic.clone(),
                    schema: name.to_owned(),
                    schema_encoding: schema.map_or_else(String::new, |s| s.encoding.clone()),
                    encoding: channel.encoding.clone(),
                    kind: MessageKind::of_schema(name),
                    problem: None,
                    mapped: Vec::new(),
                    count: 0,
                    rate_hz: None,
                    channels: Vec::new(),
                };
                let definition = schema.map_or(&[][..], |s| &s.text);
                (topic, definition, schema.is_some_and(|s| s.stamped))
            });
        topic.count += contents.counts.get(id).copied().unwrap_or(0);
        topic.channels.push(*id);
    }
    let mut formats = Vec::new();
    let mut list = Vec::new();
    for (mut topic, definition, stamped) in topics.into_values() {
        if topic.kind.is_none() && topic.encoding == "json" && topic.count > 0 {
            topic.kind = kind_by_first_message(&topic, contents, bytes, path)?;
        }
        if topic.kind.is_none() && stamped && matches!(topic.encoding.as_str(), "cdr" | "ros1") {
            topic.kind = Some(MessageKind::Stamped);
        }
        if let Some(map) = maps.iter().find(|map| map.topic == topic.name) {
            topic.kind = Some(MessageKind::Mapped);
            topic.mapped = map.roles();
        }
        let format = topic
            .kind
            .and_then(|kind| Format::of(kind, &topic.encoding, &topic.schema_encoding, definition));
        let format = match format {
            Some(Ok(format)) => Some(format),
            Some(Err(error)) => {
                topic.problem = Some(error.to_string());
                None
            }
            None => {
                topic.kind = None;
                None
            }
        };
        if let Some((first, last)) = range {
            topic.rate_hz = mean_rate(topic.count, Time(first as i64), Time(last as i64));
        }
        formats.push(format);
        list.push(topic);
    }
    Ok((list, formats))
}

/// What the messages of a topic in JSON are, whose type's name says nothing: by the fields of the first one.
fn kind_by_first_message(
    topic: &TopicInfo,
    contents: &Contents,
    bytes: &[u8],
    path: &Path,
) -> Result<Option<MessageKind>, LogError> {
    let mut messages = Messages::new(bytes, path, contents, &topic.channels);
    let Some(message) = messages.next() else {
        return Ok(None);
    };
    let mut reader = MessageReader::new(MessageKind::Mapped, Format::Json, None);
    let fields = reader.fields(message?.data);
    Ok(fields.ok().and_then(|f| MessageKind::of_fields(&f)))
}
