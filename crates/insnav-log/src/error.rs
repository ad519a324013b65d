//! The one error type of logs and files: every variant names the file, and where there is one the topic and the instant.

use crate::topics::Role;
use crate::wire::DecodeError;
use insnav_core::time::Time;
use std::io;
use std::path::{Path, PathBuf};

/// Why a file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LogError {
    /// There is no such file.
    #[error("{}: no such file", path.display())]
    NoSuchFile {
        /// The path as given.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The path as given.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Something else than MCAP.
    #[error("{}: not an MCAP file: {found}", path.display())]
    NotAnMcap {
        /// The path as given.
        path: PathBuf,
        /// What it looks like instead.
        found: &'static str,
    },
    /// The file ends too early.
    #[error("{}: truncated: the {what} at byte {offset} is cut off by the end of the file ({length} bytes)", path.display())]
    Truncated {
        /// The path as given.
        path: PathBuf,
        /// What is cut off.
        what: &'static str,
        /// Where it begins.
        offset: u64,
        /// Length of the file.
        length: u64,
    },
    /// A checksum does not match.
    #[error("{}: checksum of the {what} at byte {offset} does not match (stored {stored:08x}, computed {computed:08x})", path.display())]
    Crc {
        /// The path as given.
        path: PathBuf,
        /// Chunk, data section or summary.
        what: &'static str,
        /// Where it begins.
        offset: u64,
        /// The checksum in the file.
        stored: u32,
        /// The checksum of what is in the file.
        computed: u32,
    },
    /// The structure of the file makes no sense.
    #[error("{}: damaged at byte {offset}: {reason}", path.display())]
    Damaged {
        /// The path as given.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What is wrong.
        reason: String,
    },
    /// A chunk compressed by a method that is not read here.
    #[error("{}: chunk at byte {offset} is compressed with {compression:?}, which is not supported", path.display())]
    Compression {
        /// The path as given.
        path: PathBuf,
        /// Where the chunk begins.
        offset: u64,
        /// Name of the method.
        compression: String,
    },
    /// No topic for a role.
    #[error("{}: no {role} topic; the log has: {}", path.display(), list(topics))]
    NoTopic {
        /// The path as given.
        path: PathBuf,
        /// What was looked for.
        role: Role,
        /// Every topic of the log with type, count and rate.
        topics: Vec<String>,
    },
    /// More than one topic for a role.
    #[error("{}: {} topics could be the {role}: {}", path.display(), candidates.len(), candidates.join(", "))]
    AmbiguousTopic {
        /// The path as given.
        path: PathBuf,
        /// What was looked for.
        role: Role,
        /// Names of the candidates.
        candidates: Vec<String>,
    },
    /// A topic that was asked for by name is not there.
    #[error("{}: topic {topic:?} (wanted as {role}) is not in the log, which has: {}", path.display(), list(topics))]
    UnknownTopic {
        /// The path as given.
        path: PathBuf,
        /// What it was wanted for.
        role: Role,
        /// The name asked for.
        topic: String,
        /// Every topic of the log with type, count and rate.
        topics: Vec<String>,
    },
    /// A topic that was asked for has a type that cannot serve.
    #[error("{}: topic {topic:?} is {schema:?} in encoding {encoding:?} and cannot be the {role}{}", path.display(), because(problem))]
    WrongType {
        /// The path as given.
        path: PathBuf,
        /// What it was wanted for.
        role: Role,
        /// Its name.
        topic: String,
        /// Its type.
        schema: String,
        /// Its encoding.
        encoding: String,
        /// Why its messages cannot be read, where they could serve.
        problem: Option<Box<str>>,
    },
    /// A topic whose messages cannot be read at all.
    #[error("{}: the messages of {topic} cannot be read", path.display())]
    NotUnderstood {
        /// The path as given.
        path: PathBuf,
        /// The topic, with type and encoding.
        topic: String,
    },
    /// A message without a field that the user's map names.
    #[error("{}: {topic} at {time} (log time): {key} = {field:?} of its map: {}", path.display(), instead(found))]
    NotMapped {
        /// The path as given.
        path: PathBuf,
        /// Topic of the message.
        topic: Box<str>,
        /// Log time of the message.
        time: Time,
        /// Key of the map.
        key: &'static str,
        /// Path of the field.
        field: Box<str>,
        /// What the field is instead of a number.
        found: Option<&'static str>,
        /// Paths of the message's numbers.
        fields: Box<[String]>,
    },
    /// A message whose bytes are not what its type says.
    #[error("{}: {topic} at {time} (log time): not a valid {schema}: {source}", path.display())]
    Decode {
        /// The path as given.
        path: PathBuf,
        /// Topic of the message.
        topic: String,
        /// Log time of the message.
        time: Time,
        /// Type of the message.
        schema: String,
        /// What is wrong with the bytes.
        source: Box<DecodeError>,
    },
    /// Inertial stamps that go backward by more than the reorder window.
    #[error("{}: {topic}: stamp {time} comes after {previous} in the log, beyond the reorder window of {window_s} s", path.display())]
    StampBackward {
        /// The path as given.
        path: PathBuf,
        /// Topic of the message.
        topic: String,
        /// Stamp already passed on.
        previous: Time,
        /// The late stamp.
        time: Time,
        /// Length of the window, s.
        window_s: f64,
    },
    /// The output is there already.
    #[error("{}: exists already", path.display())]
    OutputExists {
        /// The path as given.
        path: PathBuf,
    },
    /// The output cannot be made.
    #[error("{}: cannot be written", path.display())]
    OutputNotWritable {
        /// The path as given.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Binary data for a terminal.
    #[error("standard output is a terminal, and the output is binary")]
    OutputIsTerminal,
    /// The MCAP writer failed.
    #[error("{}: writing failed", path.display())]
    Write {
        /// The path as given.
        path: PathBuf,
        /// What the writer said.
        source: Box<mcap::McapError>,
    },
    /// A line of a text table that cannot be understood.
    #[error("{}:{line}: column {column:?}: {reason}", path.display())]
    Cell {
        /// The path as given.
        path: PathBuf,
        /// Line, counted from 1.
        line: usize,
        /// Name (or number) of the column.
        column: String,
        /// What is wrong.
        reason: String,
    },
    /// A text table without a column that is needed.
    #[error("{}: no column {}; the header is {header:?}", path.display(), missing.join(" or "))]
    MissingColumn {
        /// The path as given.
        path: PathBuf,
        /// The names that would do.
        missing: Vec<String>,
        /// The header line.
        header: String,
    },
    /// A file of a receiver without a position.
    #[error("{}: no positions: {reason}", path.display())]
    NoFixes {
        /// The path as given.
        path: PathBuf,
        /// What is there instead.
        reason: String,
    },
    /// Sentences with the time of day only.
    #[error("{}: the sentences tell the time of day, but none of them the date", path.display())]
    NoDate {
        /// The path as given.
        path: PathBuf,
    },
    /// A file that holds no solution.
    #[error("{}: not a solution: {reason}", path.display())]
    NotASolution {
        /// The path as given.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// A sample that the file format cannot hold.
    #[error("{}: {what} cannot be written: {reason}", path.display())]
    Unwritable {
        /// The path as given.
        path: PathBuf,
        /// Which kind of sample.
        what: &'static str,
        /// Why not.
        reason: &'static str,
    },
    /// A setting that needs another one.
    #[error("{key}: {reason}")]
    Option {
        /// Which setting.
        key: &'static str,
        /// Why it cannot be done.
        reason: &'static str,
        /// What to do instead.
        remedy: &'static str,
    },
}

fn instead(found: &Option<&'static str>) -> String {
    found.map_or_else(
        || "there is no such field".to_owned(),
        |found| format!("the field is {found}"),
    )
}

fn because(problem: &Option<Box<str>>) -> String {
    problem
        .as_ref()
        .map_or_else(String::new, |problem| format!(": {problem}"))
}

/// A folder was given for a log: name the logs in it.
fn folder_remedy(folder: &Path) -> String {
    let mut logs: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|e| e == "mcap"))
        .map(|path| path.display().to_string())
        .collect();
    logs.sort();
    match logs.as_slice() {
        [] => "this is a folder without MCAP files; give a log, or make one of a folder of tables with `insnav convert`".into(),
        [one] => format!("this is a folder; give the log in it: {one}"),
        [first, .., last] => format!(
            "this is a folder; give one of the {} logs in it: {first} … {last}",
            logs.len()
        ),
    }
}

fn list(topics: &[String]) -> String {
    if topics.is_empty() {
        "no topics".to_owned()
    } else {
        topics.join("; ")
    }
}

impl LogError {
    /// A short name for programs, which stays the same when the text is improved.
    pub fn code(&self) -> &'static str {
        match self {
            LogError::NoSuchFile { .. } => "no_such_file",
            LogError::Read { .. } => "not_readable",
            LogError::NotAnMcap { .. } => "not_an_mcap",
            LogError::Truncated { .. } => "truncated",
            LogError::Crc { .. } => "crc",
            LogError::Damaged { .. } => "damaged",
            LogError::Compression { .. } => "unsupported_compression",
            LogError::NoTopic {
                role: Role::Imu, ..
            } => "no_imu_topic",
            LogError::NoTopic {
                role: Role::GnssPosition | Role::GnssVelocity,
                ..
            } => "no_gnss_topic",
            LogError::NoTopic { .. } => "no_topic",
            LogError::AmbiguousTopic { .. } => "ambiguous_topic",
            LogError::UnknownTopic { .. } => "unknown_topic",
            LogError::WrongType { .. } => "wrong_type",
            LogError::NotUnderstood { .. } => "not_understood",
            LogError::NotMapped { .. } => "field_not_in_message",
            LogError::Decode { .. } => "bad_message",
            LogError::StampBackward { .. } => "backward_stamps",
            LogError::OutputExists { .. } => "output_exists",
            LogError::OutputNotWritable { .. } | LogError::Write { .. } => "output_not_writable",
            LogError::OutputIsTerminal => "output_is_terminal",
            LogError::Cell { .. } => "bad_cell",
            LogError::MissingColumn { .. } => "missing_column",
            LogError::NoFixes { .. } => "no_fixes",
            LogError::NoDate { .. } => "no_date",
            LogError::NotASolution { .. } => "not_a_solution",
            LogError::Unwritable { .. } => "unwritable_sample",
            LogError::Option { .. } => "bad_option",
        }
    }

    /// What the user can do about it.
    pub fn remedy(&self) -> String {
        match self {
            LogError::NoSuchFile { .. } => "check the path".into(),
            LogError::Read { path, .. } if path.is_dir() => folder_remedy(path),
            LogError::Read { .. } => "check the permissions and that it is a file".into(),
            LogError::NotAnMcap { .. } => {
                "give an MCAP file; common CSV becomes one with `insnav convert`, a ROS 1 bag with `mcap convert`".into()
            }
            LogError::Truncated { length: 0..=8, .. } => {
                "record again: there is nothing in it".into()
            }
            LogError::Truncated { .. } => {
                "the recording was cut short: `--recover` keeps what is readable and tells what was lost".into()
            }
            LogError::Crc { .. } | LogError::Damaged { .. } => {
                "copy the file again from its origin, or keep what is readable with `--recover`, which tells what was lost".into()
            }
            LogError::Compression { path, .. } => {
                format!("recompress it with `mcap compress --compression zstd {} -o recompressed.mcap`", path.display())
            }
            LogError::NoTopic { role: role @ Role::GnssPosition, .. } => format!(
                "name the topic with `--topic {}=/its/name`, or navigate without GNSS, from rest: `--imu-only`",
                role.key()
            ),
            LogError::NoTopic { role, .. } => format!("name the topic with `--topic {}=/its/name`", role.key()),
            LogError::AmbiguousTopic { role, candidates, .. } => {
                let flags: Vec<_> = candidates.iter().map(|topic| format!("`--topic {}={topic}`", role.key())).collect();
                format!("choose one: {}", flags.join(" or "))
            }
            LogError::UnknownTopic { .. } => "take one of the names listed, with its leading slash".into(),
            LogError::WrongType { role, .. } => {
                let kinds: Vec<_> = role.kinds().iter().map(ToString::to_string).collect();
                let own = if *role == Role::Standing {
                    "; of messages of other types a `[[map]]` in the settings tells `standing` or `speed_m_per_s`"
                } else {
                    ""
                };
                format!("this role needs {}, in CDR, ROS 1 or JSON{own}", kinds.join(" or "))
            }
            LogError::NotUnderstood { .. } => "choose another topic, or record it with its definition (ros2msg)".into(),
            LogError::NotMapped { fields, .. } if fields.is_empty() => "check the encoding of the topic".into(),
            LogError::NotMapped { fields, .. } => {
                format!("take one of its numbers in the `[[map]]` of the settings: {}", fields.join(", "))
            }
            LogError::Decode { .. } => "check that the recorder's message definitions match the publisher's".into(),
            LogError::StampBackward { .. } => {
                "if the sensor's clock jumped, use the recorder's clock with `--time log`".into()
            }
            LogError::OutputExists { .. } => "choose another name with `-o`, or overwrite with `--force`".into(),
            LogError::OutputIsTerminal => "send it into a file or a program: `-o - > out.mcap`".into(),
            LogError::OutputNotWritable { source, .. } if source.kind() == io::ErrorKind::IsADirectory => {
                "name a file in that folder with `-o`".into()
            }
            LogError::OutputNotWritable { source, .. }
                if matches!(source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::FileTooLarge | io::ErrorKind::QuotaExceeded) =>
            {
                "make room there, or choose another place with `-o`; nothing half-written is left behind".into()
            }
            LogError::OutputNotWritable { .. } | LogError::Write { .. } => {
                "choose a folder that exists, can be written and has room, with `-o`".into()
            }
            LogError::Cell { .. } => "write numbers with a decimal point, and nan where a value is not known".into(),
            LogError::MissingColumn { .. } => {
                "the first line of a CSV names its columns, such as t_s,lat_deg,lon_deg,h_m".into()
            }
            LogError::NoFixes { .. } => "record GGA (or GNS), RMC and GST sentences".into(),
            LogError::NoDate { .. } => {
                "record RMC or ZDA sentences too, or say with `--t0` when the recording began".into()
            }
            LogError::NotASolution { .. } => "give an MCAP written by `insnav run`, a CSV with t_s, or a TUM file".into(),
            LogError::Unwritable { .. } => "leave these samples out".into(),
            LogError::Option { remedy, .. } => (*remedy).into(),
        }
    }

    /// The right error for a file that could not be opened.
    pub(crate) fn opening(path: &Path, source: io::Error) -> Self {
        if source.kind() == io::ErrorKind::NotFound {
            LogError::NoSuchFile { path: path.into() }
        } else {
            LogError::Read {
                path: path.into(),
                source,
            }
        }
    }
}
