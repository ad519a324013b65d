//! A recording, the command run on it, and what it wrote as tables.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// Starts of the 15 s outages every 45 s, four schedules, s.
const SCHEDULES: [f64; 4] = [60.0, 71.0, 82.0, 93.0];

pub(crate) struct Recording {
    pub(crate) name: String,
    pub(crate) folder: PathBuf,
    pub(crate) work: TempDir,
    pub(crate) log: PathBuf,
    /// Settings given, `key=value`.
    pub(crate) settings: Vec<&'static str>,
    length_s: f64,
}

pub(crate) fn insnav(arguments: &[&str]) -> Value {
    let output = Command::new(env!("CARGO_BIN_EXE_insnav"))
        .args(arguments)
        .args(["--format", "json"])
        .output()
        .expect("the command starts");
    assert!(
        output.status.success(),
        "insnav {arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).expect("one JSON object on standard output")
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

impl Recording {
    pub(crate) fn open(name: &str, length_s: f64, settings: &[&'static str]) -> Option<Recording> {
        let data = std::env::var_os("INSNAV_DATA").map_or_else(
            || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
            PathBuf::from,
        );
        let folder = data.join(name);
        if !folder.exists() {
            eprintln!("SKIPPED: {name}: no recording at {}", folder.display());
            return None;
        }
        let work = TempDir::new().expect("a temporary folder");
        let log = work.path().join("drive.mcap");
        insnav(&["convert", text(&folder), "-o", text(&log)]);
        Some(Recording {
            name: name.to_owned(),
            folder,
            work,
            log,
            settings: settings.to_vec(),
            length_s,
        })
    }

    /// The same drive with one of its tables written anew. Errors are still against the recording's own fixes.
    fn rewritten(&self, table: &str, change: impl FnOnce(&mut Vec<Vec<String>>)) -> Recording {
        let work = TempDir::new().expect("a temporary folder");
        let tables = work.path().join("changed");
        insnav(&["convert", text(&self.log), "-o", text(&tables)]);
        let path = tables.join(table);
        let content = unpacked(&path);
        let mut rows: Vec<Vec<String>> = content
            .lines()
            .map(|l| l.split(',').map(str::to_owned).collect())
            .collect();
        change(&mut rows);
        let file = std::fs::File::create(&path).expect("just read");
        let mut to = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
        for row in &rows {
            let line = row.join(",") + "\n";
            std::io::Write::write_all(&mut to, line.as_bytes()).expect("room on the disk");
        }
        to.finish().expect("room on the disk");
        let log = work.path().join("changed.mcap");
        insnav(&["convert", text(&tables), "-o", text(&log)]);
        Recording {
            name: self.name.clone(),
            folder: self.folder.clone(),
            work,
            log,
            settings: self.settings.clone(),
            length_s: self.length_s,
        }
    }

    /// One fix in four replaced by the position of a second before with sigma 0.
    pub(crate) fn with_late_rows(&self) -> Recording {
        self.rewritten("gnss.csv.gz", |rows| {
            let original = rows.clone();
            let time = |row: &[String]| row[0].parse::<f64>().expect("a time");
            for i in (5..rows.len()).filter(|i| i % 4 == 1) {
                let before = &original[i - 4];
                if (time(&rows[i]) - time(before) - 1.0).abs() < 0.01 {
                    rows[i][1..4].clone_from_slice(&before[1..4]);
                    rows[i][7..10].fill("0".into());
                }
            }
        })
    }

    /// A rate (rad/s, body axes) added to what the gyros measured, by the time of the log.
    pub(crate) fn with_rate_added(&self, rate_b: impl Fn(f64) -> [f64; 3]) -> Recording {
        self.rewritten("imu.csv.gz", |rows| {
            for row in rows.iter_mut().skip(1) {
                let added = rate_b(row[0].parse().expect("a time"));
                for (cell, added) in row[1..4].iter_mut().zip(added) {
                    let rate: f64 = cell.parse().expect("a rate");
                    *cell = format!("{:.12}", rate + added);
                }
            }
        })
    }

    pub(crate) fn run(&self, flags: &[&str]) -> (Value, PathBuf) {
        let out = self.work.path().join("solution.mcap");
        let mut arguments = vec!["run", text(&self.log), "-o", text(&out), "--force"];
        arguments.extend(["--time-offset", "auto"]);
        for setting in &self.settings {
            arguments.extend(["--set", setting]);
        }
        arguments.extend(flags);
        (insnav(&arguments), out)
    }

    pub(crate) fn compare(&self, solution: &Path, reference: &str, flags: &[&str]) -> Value {
        let reference = self.folder.join(reference);
        let mut arguments = vec!["compare", text(solution), text(&reference)];
        arguments.extend(flags);
        insnav(&arguments)
    }

    /// Errors at every second fix, kept from the filter.
    pub(crate) fn half(&self) -> f64 {
        let (_, out) = self.run(&["--withhold", "every:2"]);
        let withheld = &self.compare(&out, "gnss.csv.gz", &[])["withheld"];
        assert!(number(&withheld["count"]) > 100.0, "{withheld}");
        number(&withheld["horizontal_rms_m"])
    }

    /// Pooled horizontal error inside the outages of the four schedules.
    pub(crate) fn outages(&self) -> f64 {
        let (mut squares, mut count) = (0.0, 0.0);
        for start in SCHEDULES {
            let spans: Vec<String> = (0..)
                .map(|k| start + 45.0 * f64::from(k))
                .take_while(|begin| *begin < self.length_s)
                .map(|begin| format!("{begin}:{}", begin + 15.0))
                .collect();
            let (_, out) = self.run(&["--withhold", &spans.join(",")]);
            let withheld = &self.compare(&out, "gnss.csv.gz", &[])["withheld"];
            let points = number(&withheld["count"]);
            squares += points * number(&withheld["horizontal_rms_m"]).powi(2);
            count += points;
        }
        // Four schedules of five outages at 1 Hz are the fewest.
        assert!(count > 250.0, "{count} fixes inside the outages");
        (squares / count).sqrt()
    }
}

pub(crate) fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("a number, not {value}"))
}

/// A bar with what was measured, on standard output for the record.
pub(crate) fn at_most(what: &str, measured: f64, bar: f64) {
    println!("{what}: {measured:.4} (at most {bar})");
    assert!(measured <= bar, "{what}: {measured} > {bar}");
}

/// A table of the log itself.
pub(crate) fn csv_of(drive: &Recording, name: &str) -> Vec<Vec<f64>> {
    let folder = drive.work.path().join("tables");
    if !folder.exists() {
        insnav(&["convert", text(&drive.log), "-o", text(&folder)]);
    }
    rows(&unpacked(&folder.join(name)))
}

/// An epoch of a solution; degrees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose {
    pub(crate) t: f64,
    pub(crate) roll: f64,
    pub(crate) pitch: f64,
    pub(crate) heading: f64,
    pub(crate) sigma: f64,
    pub(crate) standing: bool,
}

/// The epochs of a solution.
pub(crate) fn solution_of(drive: &Recording, solution: &Path) -> Vec<Pose> {
    let csv = drive.work.path().join("solution.csv");
    insnav(&["convert", text(solution), "-o", text(&csv), "--force"]);
    let content = std::fs::read_to_string(&csv).expect("just written");
    let header: Vec<&str> = content
        .lines()
        .next()
        .expect("a header")
        .split(',')
        .collect();
    let column = |name: &str| {
        let at = header.iter().position(|h| *h == name);
        at.unwrap_or_else(|| panic!("{name} in {header:?}"))
    };
    let (heading, sigma) = (column("yaw_deg"), column("sigma_heading_deg"));
    let (roll, pitch, standing) = (
        column("roll_deg"),
        column("pitch_deg"),
        column("standing_s"),
    );
    let pose = |row: &Vec<f64>| Pose {
        t: row[0],
        roll: row[roll],
        pitch: row[pitch],
        heading: row[heading],
        sigma: row[sigma],
        standing: row[standing] > 0.0,
    };
    rows(&content).iter().map(pose).collect()
}

fn unpacked(path: &Path) -> String {
    let mut content = String::new();
    let file = std::fs::File::open(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    std::io::Read::read_to_string(&mut flate2::read::GzDecoder::new(file), &mut content)
        .expect("gzip");
    content
}

pub(crate) fn table(path: &Path) -> Vec<Vec<f64>> {
    rows(&std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())))
}

pub(crate) fn rows(content: &str) -> Vec<Vec<f64>> {
    let cells = |line: &str| {
        line.split(',')
            .map(|x| x.trim().parse().unwrap_or(f64::NAN))
            .collect()
    };
    content.lines().skip(1).map(cells).collect()
}

/// Between −180° and 180°.
pub(crate) fn wrapped(degrees: f64) -> f64 {
    (degrees + 180.0).rem_euclid(360.0) - 180.0
}

/// A receiver's velocities: instant (by the clock of its positions), north, east, m/s.
pub(crate) fn velocities_of(drive: &Recording, lag: f64) -> Vec<[f64; 3]> {
    let fixes = csv_of(drive, "gnss.csv.gz");
    let told = fixes.iter().filter(|r| r[4].is_finite());
    let told: Vec<[f64; 3]> = told.map(|r| [r[0] - lag, r[4], r[5]]).collect();
    if !told.is_empty() {
        return told;
    }
    // Where it tells none: of positions two fixes apart.
    const METRES_PER_DEGREE: f64 = 111_195.0;
    let between = |w: &[Vec<f64>]| {
        let (a, b) = (&w[0], &w[2]);
        let per_s = METRES_PER_DEGREE / (b[0] - a[0]);
        let shrink = a[1].to_radians().cos();
        [
            w[1][0],
            (b[1] - a[1]) * per_s,
            (b[2] - a[2]) * per_s * shrink,
        ]
    };
    fixes.windows(3).map(between).collect()
}

/// Stretches of at least two seconds in which the receiver's speed is below 0.1 m/s, but for a second: (begin, end).
pub(crate) fn seen_stops(velocities: &[[f64; 3]]) -> Vec<(f64, f64)> {
    let mut stops: Vec<(f64, f64)> = Vec::new();
    for [t, north, east] in velocities {
        if north.hypot(*east) >= 0.1 {
            continue;
        }
        match stops.last_mut() {
            Some((_, end)) if t - *end <= 1.0 => *end = *t,
            _ => stops.push((*t, *t)),
        }
    }
    stops.retain(|(begin, end)| end - begin >= 2.0);
    stops
}

/// The longest of them.
pub(crate) fn longest_stop(velocities: &[[f64; 3]]) -> (f64, f64) {
    let seen = seen_stops(velocities);
    let longest = seen
        .iter()
        .max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)));
    *longest.expect("a stop")
}
