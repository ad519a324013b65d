//! Small logs, and the command run on them.

use insnav_core::attitude::Euler;
use insnav_core::sample::Sample;
use insnav_core::sim::{Scenario, Simulation};
use insnav_log::{LogWriter, LogWriterOptions};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use tempfile::TempDir;

/// What the command left behind.
pub(crate) struct Done {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Done {
    /// The one JSON object on standard output.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.stdout)
            .unwrap_or_else(|e| panic!("{e}\nstdout: {}\nstderr: {}", self.stdout, self.stderr))
    }

    /// Check a failure in JSON mode, and return its message and remedy.
    pub(crate) fn failed(&self, exit: i32, code: &str) -> (String, String) {
        assert_eq!(
            self.code, exit,
            "stdout: {}\nstderr: {}",
            self.stdout, self.stderr
        );
        let json = self.json();
        let error = &json["error"];
        assert_eq!(error["code"], code, "{json:#}");
        assert_eq!(json.as_object().map(|o| o.len()), Some(1), "{json:#}");
        let text = |key: &str| {
            error[key]
                .as_str()
                .filter(|t| !t.is_empty())
                .expect("not empty")
                .to_owned()
        };
        let (message, remedy) = (text("message"), text("remedy"));
        assert!(
            self.stderr.contains(&message),
            "the human text is on standard error: {}",
            self.stderr
        );
        (message, remedy)
    }
}

/// Run the command and let it end as it will.
pub(crate) fn insnav<A: AsRef<std::ffi::OsStr>>(arguments: impl IntoIterator<Item = A>) -> Done {
    let output = Command::new(env!("CARGO_BIN_EXE_insnav"))
        .args(arguments)
        .output()
        .expect("the command starts");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
    let done = Done {
        code: output.status.code().unwrap_or(-1),
        stdout: text(output.stdout),
        stderr: text(output.stderr),
    };
    assert!(!done.stderr.contains("panicked"), "{}", done.stderr);
    done
}

/// Run with `--format json`.
pub(crate) fn insnav_json<A: AsRef<std::ffi::OsStr>>(
    arguments: impl IntoIterator<Item = A>,
) -> Done {
    let mut all: Vec<std::ffi::OsString> = arguments
        .into_iter()
        .map(|a| a.as_ref().to_owned())
        .collect();
    all.extend(["--format", "json"].map(Into::into));
    insnav(all)
}

/// Two minutes of a car that stands for half a minute, then drives; GNSS at 5 Hz.
pub(crate) fn drive() -> &'static Simulation {
    static DRIVE: OnceLock<Simulation> = OnceLock::new();
    DRIVE.get_or_init(|| {
        let mut scenario = Scenario::demo();
        scenario.duration_s = 120.0;
        scenario.gnss.position_colour_sigma_m = [0.0; 3];
        // Quieter than the threshold of standing, 0.1 m/s.
        scenario.gnss.velocity_sigma_m_per_s = [0.03, 0.03, 0.06];
        scenario.simulate(7).expect("a valid scenario")
    })
}

/// The truth of the drive as a table, with `north_m` added.
pub(crate) fn truth_table(north_m: f64) -> String {
    truth_of(drive(), north_m, 600)
}

/// The truth of a simulation as a table of so many rows, 0.2 s apart, with `north_m` added.
pub(crate) fn truth_of(drive: &Simulation, north_m: f64, rows: u32) -> String {
    let start = drive.trajectory.start();
    let mut text = String::from("t_s,lat_deg,lon_deg,h_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg\n");
    for i in 0..rows {
        let t = 0.2 * f64::from(i);
        let nav = drive.truth_at(start.plus(t)).nav;
        let at = nav
            .position
            .offset(&nalgebra::Vector3::new(north_m, 0.0, 0.0));
        let (v, e) = (nav.velocity_n, Euler::from_quaternion(&nav.q_nb));
        writeln!(
            text,
            "{t},{},{},{},{},{},{},{},{},{}",
            at.latitude_deg(),
            at.longitude_deg(),
            at.height,
            v.x,
            v.y,
            v.z,
            e.roll.to_degrees(),
            e.pitch.to_degrees(),
            e.heading_deg()
        )
        .unwrap();
    }
    text
}

/// A folder that vanishes, with the drive's log in it.
pub(crate) struct Folder {
    dir: TempDir,
}

impl Folder {
    pub(crate) fn new() -> Self {
        Folder {
            dir: TempDir::new().expect("a temporary folder"),
        }
    }

    /// With `drive.mcap`.
    pub(crate) fn with_drive() -> Self {
        let folder = Folder::new();
        write_log(&folder.path("drive.mcap"), &drive().samples);
        folder
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub(crate) fn text(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    /// Names of the files in it.
    pub(crate) fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.dir.path()).expect("readable");
        let mut names: Vec<String> = entries
            .map(|e| {
                e.expect("an entry")
                    .file_name()
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        names.sort();
        names
    }
}

/// With the demonstration's lever arm as a static transform.
pub(crate) fn lever_arm() -> LogWriterOptions {
    LogWriterOptions {
        lever_arm_b: Some(nalgebra::Vector3::from(Scenario::demo().gnss.lever_arm_b_m)),
        ..LogWriterOptions::default()
    }
}

/// A log with the demonstration's lever arm as a static transform.
pub(crate) fn write_log(path: &Path, samples: &[Sample]) {
    write_log_with(path, samples, lever_arm());
}

/// A log of these samples.
pub(crate) fn write_log_with(path: &Path, samples: &[Sample], options: LogWriterOptions) {
    let mut writer = LogWriter::create(path, options).expect("writable");
    for sample in samples {
        writer
            .write(sample)
            .expect("rates and fixes can be written");
    }
    writer.finish().expect("writable");
}

/// One message on its way from log to log.
pub(crate) struct Raw {
    pub(crate) topic: String,
    pub(crate) log_time: u64,
    pub(crate) data: Vec<u8>,
}

/// Copy a log message by message, each as what `change` makes of it.
pub(crate) fn rewrite(from: &Path, to: &Path, mut change: impl FnMut(Raw) -> Vec<Raw>) {
    let bytes = std::fs::read(from).expect("readable");
    let mut writer = mcap::Writer::new(std::io::BufWriter::new(
        std::fs::File::create(to).expect("writable"),
    ))
    .expect("writable");
    for message in mcap::MessageStream::new(&bytes).expect("a log") {
        let message = message.expect("a message");
        let raw = Raw {
            topic: message.channel.topic.clone(),
            log_time: message.log_time,
            data: message.data.to_vec(),
        };
        for raw in change(raw) {
            let schema = message
                .channel
                .schema
                .as_ref()
                .expect("ROS 2 topics have one");
            let schema = writer
                .add_schema(&schema.name, &schema.encoding, &schema.data)
                .expect("a schema");
            let channel = writer
                .add_channel(
                    schema,
                    &raw.topic,
                    &message.channel.message_encoding,
                    &message.channel.metadata,
                )
                .expect("a channel");
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: message.sequence,
                log_time: raw.log_time,
                publish_time: raw.log_time,
            };
            writer
                .write_to_known_channel(&header, &raw.data)
                .expect("writable");
        }
    }
    writer.finish().expect("writable");
}

/// Shift the stamp in the header of a little-endian CDR message.
pub(crate) fn shift_stamp(data: &mut [u8], seconds: i32) {
    // Four bytes of encapsulation, then the stamp's seconds.
    let stamp = i32::from_le_bytes(data[4..8].try_into().expect("four bytes"));
    data[4..8].copy_from_slice(&(stamp + seconds).to_le_bytes());
}

/// The recordings, or a line that says that they are not there.
pub(crate) fn recordings(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("INSNAV_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let path = root.join(name);
    if !path.exists() {
        println!("SKIPPED: {} is absent", path.display());
        return None;
    }
    Some(path)
}

/// Messages of an MCAP, each as channel, log time, sequence number and bytes, in the order of the file.
pub(crate) fn messages(path: &Path) -> Vec<(String, u64, u32, Vec<u8>)> {
    let bytes = std::fs::read(path).expect("readable");
    let stream = mcap::MessageStream::new(&bytes).expect("a log");
    stream
        .map(|m| {
            let m = m.expect("a message");
            let topic = m.channel.topic.clone();
            (topic, m.log_time, m.sequence, m.data.to_vec())
        })
        .collect()
}
