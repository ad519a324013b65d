//! What receivers write in, what maps and spreadsheets read out.

use crate::fixture::{Folder, drive, insnav_json};
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use insnav_log::csv::{self, ImuTable};
use std::fmt::Write;

/// The drive's inertial table, its zero, and its fixes as an RTKLIB file in UTC and as NMEA sentences.
fn tables(folder: &Folder) -> (String, usize) {
    let samples = &drive().samples;
    let zero = samples[0].time();
    let mut imu = ImuTable::default();
    let mut pos = String::from(
        "% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n\
         %  UTC latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m)\n",
    );
    let mut nmea = String::new();
    let mut fixes = 0;
    for sample in samples {
        match sample {
            Sample::Imu(s) => {
                imu.t_s.push(s.time.since(zero));
                imu.angular_rate.push(s.angular_rate_b);
                imu.specific_force.push(s.specific_force_b);
            }
            Sample::GnssPosition(fix) => {
                fixes += 1;
                let s = fix.time.since(Time(DAY * 1_000_000_000));
                let (h, m, s) = ((s / 3600.0) as u32, (s / 60.0) as u32 % 60, s % 60.0);
                let at = fix.position;
                let c = fix.covariance_n.unwrap();
                let root = |v: f64| v.signum() * v.abs().sqrt();
                writeln!(
                    pos,
                    "2024/01/01 {h:02}:{m:02}:{s:012.9} {:.11} {:.11} {:.5} 1 12 {:.6} {:.6} {:.6} {:.6} {:.6} {:.6}",
                    at.latitude_deg(),
                    at.longitude_deg(),
                    at.height,
                    root(c[(0, 0)]),
                    root(c[(1, 1)]),
                    root(c[(2, 2)]),
                    root(c[(0, 1)]),
                    root(-c[(1, 2)]),
                    root(-c[(0, 2)]),
                )
                .unwrap();
                let minutes = |degrees: f64| 60.0 * degrees.fract();
                let (lat, lon) = (at.latitude_deg(), at.longitude_deg());
                let body = format!(
                    "GNGGA,{h:02}{m:02}{s:012.9},{:02}{:011.8},N,{:03}{:011.8},E,4,12,0.7,{:.4},M,45.0,M,,",
                    lat as u32,
                    minutes(lat),
                    lon as u32,
                    minutes(lon),
                    at.height - 45.0
                );
                let sum = body.bytes().fold(0, |sum, b| sum ^ b);
                writeln!(nmea, "${body}*{sum:02X}").unwrap();
            }
            _ => {}
        }
    }
    csv::write_imu(&folder.path("imu.csv"), &imu, false).unwrap();
    std::fs::write(folder.path("fixes.pos"), pos).unwrap();
    std::fs::write(folder.path("fixes.nmea"), nmea).unwrap();
    (format!("{}", zero.0 / 1_000_000_000), fixes)
}

/// 2024-01-01, on which the drive is.
const DAY: i64 = 1_704_067_200;

#[test]
fn receivers_files_become_logs_and_references() {
    let folder = Folder::with_drive();
    let (t0, fixes) = tables(&folder);
    let imu = folder.text("imu.csv");
    for name in ["fixes.pos", "fixes.nmea"] {
        let log = folder.text(&format!("{name}.mcap"));
        let gnss = folder.text(name);
        let done = insnav_json(["convert", &imu, "--gnss", &gnss, "--t0", &t0, "-o", &log]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let json = done.json();
        assert_eq!(json["gnss_positions"], fixes, "{json:#}");
        assert_eq!(json["gnss_quality"]["fixed"], fixes);
        assert!(json["warnings"].as_array().unwrap().is_empty(), "{json:#}");
    }

    // The same fixes, so the same comparison, from whichever file.
    let solution = folder.text("s.mcap");
    let done = insnav_json([
        "run",
        &folder.text("drive.mcap"),
        "-o",
        &solution,
        "--time-offset",
        "0",
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let judged = |reference: &str| {
        let done = insnav_json(["compare", &solution, &folder.text(reference)]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let json = done.json();
        assert_eq!(json["reference_at_antenna"], true);
        let all = &json["all"];
        (
            all["count"].as_u64().unwrap(),
            all["horizontal_rms_m"].as_f64().unwrap(),
            all["height_rms_m"].as_f64().unwrap(),
        )
    };
    let drive = folder.text("drive.mcap");
    let done = insnav_json(["convert", &drive, "-o", &folder.text("tables")]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let (count, horizontal, height) = judged("tables/gnss.csv.gz");
    assert!(count as usize > fixes * 9 / 10, "{count}");
    for file in ["fixes.pos", "fixes.nmea"] {
        let other = judged(file);
        assert_eq!(other.0, count, "{file}");
        // Eight decimals of a minute are 0.02 mm, four of a metre of height 0.1 mm.
        assert!((other.1 - horizontal).abs() < 1e-3, "{file}: {other:?}");
        assert!((other.2 - height).abs() < 1e-3, "{file}: {other:?}");
    }
}

#[test]
fn dated_fixes_call_for_the_date_of_the_table() {
    let folder = Folder::new();
    tables(&folder);
    let (imu, pos) = (folder.text("imu.csv"), folder.text("fixes.pos"));
    let log = folder.text("x.mcap");
    let done = insnav_json(["convert", &imu, "--gnss", &pos, "-o", &log]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let warning = &done.json()["warnings"][0];
    assert_eq!(warning["code"], "no_overlap");
    assert!(warning["remedy"].as_str().unwrap().contains("--t0"));
    assert!(warning["message"].as_str().unwrap().contains("2024-01-01T"));
    let nmea = folder.text("fixes.nmea");
    let done = insnav_json(["convert", &imu, "--gnss", &nmea, "-o", &log, "--force"]);
    let (_, remedy) = done.failed(1, "no_date");
    assert!(remedy.contains("--t0"), "{remedy}");
}

#[test]
fn a_run_writes_other_formats_too() {
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    let run = |more: &[&str]| {
        let arguments = ["run", &log, "--time-offset", "0"];
        insnav_json(arguments.iter().chain(more).copied())
    };
    let done = run(&["--also", "csv,kml", "--also", "geojson", "--also", "tum"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(done.json()["also"].as_array().unwrap().len(), 4);
    assert_eq!(
        folder.names(),
        [
            "drive.insnav.csv",
            "drive.insnav.geojson",
            "drive.insnav.kml",
            "drive.insnav.mcap",
            "drive.insnav.tum",
            "drive.mcap"
        ]
    );
    // `convert` says the same of the same solution.
    for ending in ["csv", "geojson", "kml", "tum"] {
        let solution = folder.text("drive.insnav.mcap");
        let copy = Folder::new();
        let to = copy.text(&format!("copy.{ending}"));
        let done = insnav_json(["convert", &solution, "-o", &to]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let (a, b) = (
            std::fs::read(to).unwrap(),
            std::fs::read(folder.path(&format!("drive.insnav.{ending}"))).unwrap(),
        );
        assert!(a == b && a.len() > 1000, "{ending}");
    }
    // Nothing is overwritten unasked, and that is said before the run.
    std::fs::remove_file(folder.path("drive.insnav.mcap")).unwrap();
    run(&["--also", "kml"]).failed(1, "output_exists");
    assert!(!folder.path("drive.insnav.mcap").exists());
    run(&["--also", "shp"]).failed(2, "usage");
}
