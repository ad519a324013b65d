//! The main job on real recordings: every bar is on what was kept from the filter, or on what it never saw.
//!
//! Needs the recordings in `$INSNAV_DATA` or `../shared/data`; says SKIPPED without them. Settings are those of the
//! receivers and units, each with its reason beside it; everything else is what `run` chooses by itself.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// Starts of the 15 s outages every 45 s, four schedules, s.
const SCHEDULES: [f64; 4] = [60.0, 71.0, 82.0, 93.0];

struct Recording {
    folder: PathBuf,
    work: TempDir,
    log: PathBuf,
    /// Settings given, `key=value`.
    settings: Vec<&'static str>,
    length_s: f64,
}

fn insnav(arguments: &[&str]) -> Value {
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

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

impl Recording {
    fn open(name: &str, length_s: f64, settings: &[&'static str]) -> Option<Recording> {
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
            folder,
            work,
            log,
            settings: settings.to_vec(),
            length_s,
        })
    }

    /// The same drive, one fix in four replaced by the position of a second before with sigma 0. Errors are still against the
    /// recording's own fixes.
    fn with_late_rows(&self) -> Recording {
        let work = TempDir::new().expect("a temporary folder");
        let tables = work.path().join("tables");
        insnav(&["convert", text(&self.log), "-o", text(&tables)]);
        let path = tables.join("gnss.csv.gz");
        let mut content = String::new();
        let file = std::fs::File::open(&path).expect("just written");
        std::io::Read::read_to_string(&mut flate2::read::GzDecoder::new(file), &mut content)
            .expect("gzip");
        let rows: Vec<Vec<&str>> = content.lines().map(|l| l.split(',').collect()).collect();
        let time = |row: &[&str]| row[0].parse::<f64>().expect("a time");
        let mut out = String::new();
        for (i, row) in rows.iter().enumerate() {
            let mut row = row.clone();
            if i >= 5 && i % 4 == 1 && (time(&row) - time(&rows[i - 4]) - 1.0).abs() < 0.01 {
                row[1..4].copy_from_slice(&rows[i - 4][1..4]);
                row[7..10].fill("0");
            }
            out.push_str(&row.join(","));
            out.push('\n');
        }
        let file = std::fs::File::create(&path).expect("just read");
        let mut to = flate2::write::GzEncoder::new(file, flate2::Compression::fast());
        std::io::Write::write_all(&mut to, out.as_bytes()).expect("room on the disk");
        to.finish().expect("room on the disk");
        let log = work.path().join("late.mcap");
        insnav(&["convert", text(&tables), "-o", text(&log)]);
        Recording {
            folder: self.folder.clone(),
            work,
            log,
            settings: self.settings.clone(),
            length_s: self.length_s,
        }
    }

    fn run(&self, flags: &[&str]) -> (Value, PathBuf) {
        let out = self.work.path().join("solution.mcap");
        let mut arguments = vec!["run", text(&self.log), "-o", text(&out), "--force"];
        arguments.extend(["--time-offset", "auto"]);
        for setting in &self.settings {
            arguments.extend(["--set", setting]);
        }
        arguments.extend(flags);
        (insnav(&arguments), out)
    }

    fn compare(&self, solution: &Path, reference: &str, flags: &[&str]) -> Value {
        let reference = self.folder.join(reference);
        let mut arguments = vec!["compare", text(solution), text(&reference)];
        arguments.extend(flags);
        insnav(&arguments)
    }

    /// Errors at every second fix, kept from the filter.
    fn half(&self) -> f64 {
        let (_, out) = self.run(&["--withhold", "every:2"]);
        let withheld = &self.compare(&out, "gnss.csv.gz", &[])["withheld"];
        assert!(number(&withheld["count"]) > 100.0, "{withheld}");
        number(&withheld["horizontal_rms_m"])
    }

    /// Pooled horizontal error inside the outages of the four schedules.
    fn outages(&self) -> f64 {
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

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("a number, not {value}"))
}

/// The estimates of an optional block, in the unit of the report.
fn calibrated(report: &Value, name: &str) -> Vec<f64> {
    let blocks = report["calibration"].as_array().expect("a list");
    let block = blocks.iter().find(|b| b["name"] == name);
    let values = block.and_then(|b| b["value"].as_array());
    let values = values.unwrap_or_else(|| panic!("{name} in {blocks:?}"));
    values.iter().map(number).collect()
}

fn course_std(comparison: &Value) -> f64 {
    number(&comparison["course"]["heading_minus_course_std_deg"])
}

/// A bar with what was measured, on standard output for the record.
fn at_most(what: &str, measured: f64, bar: f64) {
    println!("{what}: {measured:.4} (at most {bar})");
    assert!(measured <= bar, "{what}: {measured} > {bar}");
}

/// Car with a vibrating roof unit and carrier-phase fixes of 1 cm; only the lever arm is set.
#[test]
fn rtkexp_drive() {
    // The lever arm of the recording's notes, (0, −0.05, 0) m, is what a user would measure.
    let lever_arm = ["gnss.lever_arm_b_m=[0.0, -0.05, 0.0]"];
    let Some(drive) = Recording::open("rtkexp_drive_0708", 548.0, &lever_arm) else {
        return;
    };
    let (report, _) = drive.run(&[]);
    let offset = number(&report["time_offset_s"]["value"]);
    let lag = number(&report["gnss_velocity_lag_s"]["value"]);
    println!("IMU against position {offset:.4} s, velocity behind position {lag:.4} s");
    assert!((offset + 0.21).abs() <= 0.03, "{offset}");
    assert!((lag - 0.128).abs() <= 0.02, "{lag}");
    at_most(
        "rtkexp, every second fix withheld, horizontal m",
        drive.half(),
        0.03,
    );
    at_most("rtkexp, 15 s outages, horizontal m", drive.outages(), 2.1);
    // The author of the recording found pitch −6.8° and yaw 5.35°.
    let mounting = calibrated(&report, "mounting");
    println!("mounting {mounting:.2?} deg");
    assert!((mounting[0] + 6.8).abs() <= 1.0, "{mounting:?}");
    assert!((mounting[1] - 5.4).abs() <= 1.0, "{mounting:?}");
}

/// Car under a poor sky; the receiver states 2.7 m where its fixes follow each other to centimetres.
#[test]
fn hipnuc_drive() {
    // Fixes 0.1 s apart scatter by 0.03 m about a smooth track, a hundredth of what is stated: with the default factor they
    // would hardly be used at all. 0.05 leaves 0.13 m, what the position wanders within a second.
    let Some(drive) = Recording::open("hipnuc_20220504", 773.0, &["gnss.sigma_scale=0.05"]) else {
        return;
    };
    at_most(
        "hipnuc, every second fix withheld, horizontal m",
        drive.half(),
        0.25,
    );
    at_most("hipnuc, 15 s outages, horizontal m", drive.outages(), 1.9);
    let (_, out) = drive.run(&[]);
    let comparison = drive.compare(&out, "gnss.csv.gz", &["--course"]);
    at_most(
        "hipnuc, heading minus course, std deg",
        course_std(&comparison),
        0.8,
    );
}

/// The same without a word about its sigmas: what fixes scatter by is learnt. The bars are those of the factor by hand.
#[test]
fn hipnuc_drive_without_a_factor() {
    let Some(drive) = Recording::open("hipnuc_20220504", 773.0, &[]) else {
        return;
    };
    let (report, out) = drive.run(&[]);
    let aiding = report["aiding"].as_array().expect("a list");
    let positions = aiding
        .iter()
        .find(|a| a["name"] == "gnss_position")
        .expect("positions were used");
    let nis = number(&positions["nis_mean"]);
    println!(
        "hipnuc, NIS/dof {nis:.3}, sigmas {}",
        report["gnss_sigma_scale"]
    );
    assert!((nis - 1.0).abs() <= 0.3, "{nis}");
    // What residuals cannot show stays: the receiver states 2 m and more.
    assert!(number(&report["final"]["sigma_horizontal_m"]) > 2.0);
    assert!(number(&report["gnss_sigma_scale"]["horizontal"]) < 0.2);
    let comparison = drive.compare(&out, "gnss.csv.gz", &["--course"]);
    at_most(
        "hipnuc, heading minus course, std deg, learnt",
        course_std(&comparison),
        0.82,
    );
    at_most(
        "hipnuc, every second fix withheld, horizontal m, learnt",
        drive.half(),
        0.25,
    );
    at_most(
        "hipnuc, 15 s outages, horizontal m, learnt",
        drive.outages(),
        1.56,
    );
    // Negative control: as stated.
    let (report, _) = drive.run(&["--set", "gnss.sigma_scale=1"]);
    let aiding = report["aiding"].as_array().expect("a list");
    let nis = aiding
        .iter()
        .find(|a| a["name"] == "gnss_position")
        .map(|a| number(&a["nis_mean"]));
    assert!(nis.expect("positions were used") < 0.1, "{nis:?}");
}

/// One fix in four is that of a second ago with a sigma of zero, as some receivers give between their own.
#[test]
fn rtkexp_with_late_rows() {
    let lever_arm = ["gnss.lever_arm_b_m=[0.0, -0.05, 0.0]"];
    let Some(clean) = Recording::open("rtkexp_drive_0708", 548.0, &lever_arm) else {
        return;
    };
    let late = clean.with_late_rows();
    // Every second fix withheld would leave one good fix a second here: a comparison of rates, not of robustness.
    at_most(
        "rtkexp with late rows over clean, 15 s outages",
        late.outages() / clean.outages(),
        1.3,
    );
}

/// One minute of a car at speed with a phone's unit; the reference pose is stamped by the phone, as the IMU is.
#[test]
fn comma2k19_drive() {
    let Some(drive) = Recording::open("comma2k19_example1", 60.0, &[]) else {
        return;
    };
    let (_, out) = drive.run(&[]);
    let course = drive.compare(&out, "gnss.csv.gz", &["--course"]);
    at_most(
        "comma2k19, heading minus course, std deg",
        course_std(&course),
        0.4,
    );
    let pose = drive.compare(&out, "truth.csv.gz", &["--reference-clock", "imu"]);
    at_most(
        "comma2k19, against its pose, horizontal m",
        number(&pose["all"]["horizontal_rms_m"]),
        0.8,
    );
}

/// Car with positions at 1 Hz alone.
#[test]
fn kth_drive() {
    let Some(drive) = Recording::open("kth_skog_car", 299.0, &[]) else {
        return;
    };
    let with = drive.half();
    at_most("kth, every second fix withheld, horizontal m", with, 2.5);
    let with_in_outages = drive.outages();
    let mut free = drive;
    free.settings.push("vehicle.nonholonomic='off'");
    at_most("kth, the same against no constraint, m", with, free.half());
    at_most(
        "kth, 15 s outages against no constraint, m",
        with_in_outages,
        free.outages(),
    );
    // Heights of this recording count downwards: the vehicle would climb with its nose down.
    let (report, _) = free.run(&["--set", "vehicle.nonholonomic='auto'"]);
    let told = report["warnings"].as_array().expect("a list");
    assert!(told.iter().any(|w| w["code"] == "height_sign"), "{told:?}");
}

/// A slow robot: its heading is barely observable, and a confident wrong one would be the failure.
///
/// The reference is wheel speed and gyro alone: the path they describe, turned until it fits the positions.
#[test]
fn husky_heading_is_within_its_sigmas() {
    let Some(drive) = Recording::open("husky_rl_test1", 395.0, &[]) else {
        return;
    };
    let wheels = table(&drive.folder.join("wheel_odom.csv"));
    let fixes = csv_of(&drive, "gnss.csv.gz");
    let turns = turns_of(&csv_of(&drive, "imu.csv.gz"));
    let heading_at_start = fit_heading(&wheels, &turns, &fixes);

    let (_, out) = drive.run(&["--rate", "1"]);
    let csv = drive.work.path().join("solution.csv");
    insnav(&["convert", text(&out), "-o", text(&csv)]);
    let (mut worst, mut least_sigma): (f64, f64) = (0.0, f64::INFINITY);
    let solution = table(&csv);
    assert!(solution.len() > 300);
    for row in &solution {
        let (t, heading, sigma) = (row[0], row[9], row[18]);
        let reference = heading_at_start + at(&turns, t).to_degrees();
        let error = (heading - reference + 180.0).rem_euclid(360.0) - 180.0;
        worst = worst.max(error.abs() / sigma);
        least_sigma = least_sigma.min(sigma);
    }
    // A heading declared unknown (104°) would pass any bar on its own sigma.
    at_most("husky, least heading sigma deg", least_sigma, 30.0);
    at_most("husky, heading error over its sigma, largest", worst, 3.0);
}

fn csv_of(drive: &Recording, name: &str) -> Vec<Vec<f64>> {
    // `convert` unpacks: the log's own tables, not the recording's.
    let folder = drive.work.path().join("tables");
    if !folder.exists() {
        insnav(&["convert", text(&drive.log), "-o", text(&folder)]);
    }
    let path = folder.join(name);
    let mut content = String::new();
    let file = std::fs::File::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    std::io::Read::read_to_string(&mut flate2::read::GzDecoder::new(file), &mut content)
        .expect("gzip");
    rows(&content)
}

fn table(path: &Path) -> Vec<Vec<f64>> {
    rows(&std::fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display())))
}

fn rows(content: &str) -> Vec<Vec<f64>> {
    let cells = |line: &str| {
        line.split(',')
            .map(|x| x.trim().parse().unwrap_or(f64::NAN))
            .collect()
    };
    content.lines().skip(1).map(cells).collect()
}

/// (time, turn since the begin) by the Down gyro, rad.
fn turns_of(imu: &[Vec<f64>]) -> Vec<(f64, f64)> {
    let mut turn = 0.0;
    let mut out = vec![(imu[0][0], 0.0)];
    for pair in imu.windows(2) {
        turn += pair[1][3] * (pair[1][0] - pair[0][0]);
        out.push((pair[1][0], turn));
    }
    out
}

fn at(series: &[(f64, f64)], t: f64) -> f64 {
    let i = series
        .partition_point(|p| p.0 < t)
        .clamp(1, series.len() - 1);
    let (a, b) = (series[i - 1], series[i]);
    a.1 + (b.1 - a.1) * ((t - a.0) / (b.0 - a.0)).clamp(0.0, 1.0)
}

/// Heading at the begin, degrees: chords of 20 s of the path by wheels and gyro against the same chords of the positions.
fn fit_heading(wheels: &[Vec<f64>], turns: &[(f64, f64)], fixes: &[Vec<f64>]) -> f64 {
    let (mut north, mut east) = (vec![(wheels[0][0], 0.0)], vec![(wheels[0][0], 0.0)]);
    for pair in wheels.windows(2) {
        let step = pair[1][1] * (pair[1][0] - pair[0][0]);
        let turn = at(turns, pair[1][0]);
        north.push((pair[1][0], north[north.len() - 1].1 + step * turn.cos()));
        east.push((pair[1][0], east[east.len() - 1].1 + step * turn.sin()));
    }
    const METRES_PER_DEGREE: f64 = 111_000.0;
    let shrink = fixes[0][1].to_radians().cos();
    let (mut real, mut imaginary) = (0.0, 0.0);
    for a in fixes {
        let Some(b) = fixes.iter().find(|b| b[0] >= a[0] + 20.0) else {
            break;
        };
        let (n, e) = (
            (b[1] - a[1]) * METRES_PER_DEGREE,
            (b[2] - a[2]) * METRES_PER_DEGREE * shrink,
        );
        let (x, y) = (
            at(&north, b[0]) - at(&north, a[0]),
            at(&east, b[0]) - at(&east, a[0]),
        );
        // (n + i e) times the conjugate of (x + i y): its argument is the turn between the two.
        real += n * x + e * y;
        imaginary += e * x - n * y;
    }
    imaginary.atan2(real).to_degrees()
}

/// Stops of a run's report as (begin, end), s.
fn told_stops(report: &Value) -> Vec<(f64, f64)> {
    let stops = report["stops"].as_array().expect("a list");
    stops
        .iter()
        .map(|s| (number(&s["begin_s"]), number(&s["end_s"])))
        .collect()
}

/// Every stop that the receiver's speed shows (below 0.1 m/s for two seconds and more) is declared in time and begins when
/// it says; nothing that moves is called standing. The filter is half a second behind its detector, and a solution says
/// "standing" where the filter makes use of it.
fn stops_are_found(drive: &Recording, expected: usize, least_length_s: f64) {
    let (report, out) = drive.run(&[]);
    let comparison = drive.compare(&out, "gnss.csv.gz", &[]);
    let told = told_stops(&report);
    let references = comparison["stops"].as_array().expect("a list");
    assert_eq!(references.len(), expected, "{references:?}");
    for reference in references {
        let begin = number(&reference["reference_begin_s"]);
        at_most("stop declared after s", number(&reference["delay_s"]), 3.5);
        // One that began before the log has no begin in it.
        let nearest = told.iter().map(|s| (s.0 - begin.max(0.0)).abs());
        let off = nearest.fold(f64::INFINITY, f64::min);
        let length = told
            .iter()
            .filter(|s| (s.0 - begin).abs() < 5.0)
            .map(|s| s.1 - s.0)
            .fold(0.0, f64::max);
        println!("stop at {begin:.2} s: begin off by {off:.2} s, first piece {length:.1} s");
        if length >= least_length_s {
            at_most(
                "begin of the stop against the receiver's speed, s",
                off,
                1.0,
            );
        }
    }
    // A fix of the slower receiver: above 0.1 m/s, let alone above 0.3.
    at_most(
        "s above 0.1 m/s called standing",
        number(&comparison["false_standing_s"]),
        0.25,
    );
}

#[test]
fn rtkexp_stops_are_found() {
    let lever_arm = ["gnss.lever_arm_b_m=[0.0, -0.05, 0.0]"];
    if let Some(drive) = Recording::open("rtkexp_drive_0708", 548.0, &lever_arm) {
        stops_are_found(&drive, 4, 0.0);
    }
}

/// The receiver sets its speed to exactly 0 when it is below half a metre per second: it says too early that the car stands.
/// The bar on the begin is that of the long stops; engines are switched off and people move in them.
#[test]
fn hipnuc_stops_are_found() {
    if let Some(drive) = Recording::open("hipnuc_20220504", 773.0, &[]) {
        stops_are_found(&drive, 9, 30.0);
        let (report, _) = drive.run(&[]);
        let told = told_stops(&report);
        for begin in [103.0, 201.5] {
            let off = told.iter().map(|s| (s.0 - begin).abs());
            let off = off.fold(f64::INFINITY, f64::min);
            at_most("hipnuc, begin of a long stop, s", off, 1.0);
        }
    }
}

/// Without a GNSS velocity the filter's own speed decides. No second above 0.3 m/s by the car's speedometer or the robot's
/// wheels, which the run does not see, is called standing.
#[test]
fn nothing_that_moves_is_called_standing() {
    for (name, length_s, reference) in [
        ("kth_skog_car", 299.0, "speedometer.csv"),
        ("husky_rl_test1", 395.0, "wheel_odom.csv"),
    ] {
        let Some(drive) = Recording::open(name, length_s, &[]) else {
            return;
        };
        let (report, _) = drive.run(&[]);
        let speeds = table(&drive.folder.join(reference));
        let told = told_stops(&report);
        println!("{name}: {told:.1?}");
        for (begin, end) in told {
            for second in begin as i32..=end as i32 {
                let from = f64::from(second).max(begin);
                let within = |row: &&Vec<f64>| row[0] >= from && row[0] < (from + 1.0).min(end);
                let seen: Vec<f64> = speeds.iter().filter(within).map(|r| r[1].abs()).collect();
                let mean = seen.iter().sum::<f64>() / seen.len().max(1) as f64;
                at_most("speed of a second that is called standing, m/s", mean, 0.3);
            }
        }
    }
}
