//! Magnetic fields: from every message that has them, and the start of a run that they give.

use crate::recorder::{Recorder, SECOND, T0, samples};
use insnav_core::alignment::HeadingSource;
use insnav_core::attitude::Euler;
use insnav_core::config::Config;
use insnav_core::imu::ImuGrade;
use insnav_core::sample::{MagneticField, Sample};
use insnav_core::sim::{ImuErrorModel, Scenario};
use insnav_core::time::Time;
use insnav_log::ros2;
use insnav_log::{
    Log, LogWriter, LogWriterOptions, Plan, ReadOptions, Role, RunOptions, RunReport,
};
use nalgebra::Vector3;
use std::path::Path;

fn message(stamp: i64) -> ros2::MagneticField<'static> {
    ros2::MagneticField {
        header: ros2::Header {
            stamp: Time(stamp),
            frame_id: "imu_link",
        },
        magnetic_field: Vector3::new(20e-6, 1e-6, -45e-6),
        magnetic_field_covariance: [0.0; 9],
    }
}

fn only_field(log: &Log) -> MagneticField {
    match samples(log).as_slice() {
        [Sample::Magnetic(field)] => *field,
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_field_is_turned_like_the_imu() {
    let expected = Vector3::new(20e-6, -1e-6, 45e-6);
    let mut recorder = Recorder::new();
    recorder.put("/imu/mag", T0, &message(T0 - SECOND / 4));
    let log = recorder.open(ReadOptions::default()).unwrap();
    let field = only_field(&log);
    assert_eq!(
        (field.time, field.field_b),
        (Time(T0 - SECOND / 4), expected)
    );
    // A unit mounted a quarter turn to the left.
    let mut recorder = Recorder::new();
    recorder.put("/imu/mag", T0, &message(T0));
    let turned = ReadOptions {
        imu_mounting_rpy_deg: Some([0.0, 0.0, 90.0]),
        ..ReadOptions::default()
    };
    let field = only_field(&recorder.open(turned).unwrap()).field_b;
    assert!(
        (field - Vector3::new(-1e-6, -20e-6, 45e-6)).norm() < 1e-18,
        "{field}"
    );
    // JSON, and ROS 1: a sequence number before the stamp, and no alignment.
    let mut recorder = Recorder::new();
    let json = r#"{"header": {"stamp": {"sec": 1600000000, "nanosec": 0}, "frame_id": "imu"},
        "magnetic_field": {"x": 20e-6, "y": 1e-6, "z": -45e-6}}"#;
    recorder.foreign(
        "/mag",
        T0,
        ["sensor_msgs/msg/MagneticField", "", "json"],
        b"",
        json.as_bytes(),
    );
    let log = recorder.open(ReadOptions::default()).unwrap();
    assert_eq!(only_field(&log).field_b, expected);
    let mut bytes = Vec::new();
    for word in [7u32, 1_600_000_000, 0, 3] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(b"imu");
    for number in [20e-6, 1e-6, -45e-6].into_iter().chain([0.0; 9]) {
        bytes.extend(f64::to_le_bytes(number));
    }
    let mut recorder = Recorder::new();
    let kind = ["sensor_msgs/MagneticField", "ros1msg", "ros1"];
    recorder.foreign("/mag", T0, kind, b"Header header", &bytes);
    let log = recorder.open(ReadOptions::default()).unwrap();
    assert_eq!(only_field(&log).field_b, expected);
}

#[test]
fn px4_gives_gauss_in_its_own_axes() {
    let mut recorder = Recorder::new();
    let json = r#"{"timestamp": 1600000000000000, "magnetometer_ga": [0.2, -0.01, 0.45]}"#;
    let kind = ["px4_msgs/msg/VehicleMagnetometer", "", "json"];
    recorder.foreign(
        "/fmu/out/vehicle_magnetometer",
        T0,
        kind,
        b"",
        json.as_bytes(),
    );
    let field = only_field(&recorder.open(ReadOptions::default()).unwrap()).field_b;
    assert!(
        (field - Vector3::new(20e-6, -1e-6, 45e-6)).norm() < 1e-18,
        "{field}"
    );
}

#[test]
fn of_two_topics_one_has_to_be_named() {
    let log = |options: ReadOptions| {
        let mut recorder = Recorder::new();
        recorder.put("/mag/a", T0, &message(T0));
        recorder.put("/mag/b", T0 + 1, &message(T0 + 1));
        recorder.open(options).unwrap()
    };
    assert_eq!(samples(&log(ReadOptions::default())), []);
    let named = ReadOptions {
        topics: vec![(Role::Magnetometer, "/mag/b".into())],
        ..ReadOptions::default()
    };
    assert_eq!(only_field(&log(named)).time, Time(T0 + 1));
}

const HEADING_DEG: f64 = 40.0;
const DECLINATION_DEG: f64 = 5.0;

/// A minute at rest with GNSS and a field of so many times the Earth's in tesla.
fn standing(path: &Path, factor: f64) {
    let mut scenario = Scenario::standing(60.0, HEADING_DEG);
    scenario.imu.rate_hz = 50.0;
    scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Consumer.noise());
    let simulation = scenario.simulate(1).unwrap();
    let (s, c) = DECLINATION_DEG.to_radians().sin_cos();
    let field_n = Vector3::new(20e-6 * c, 20e-6 * s, 45e-6) * factor;
    let mut writer = LogWriter::create(path, LogWriterOptions::default()).unwrap();
    for sample in &simulation.samples {
        writer.write(sample).unwrap();
        if let Sample::Imu(imu) = sample {
            let q_nb = Euler::from_degrees(0.0, 0.0, HEADING_DEG).to_quaternion();
            let field_b = q_nb.inverse() * field_n;
            let time = imu.time;
            writer
                .write(&Sample::Magnetic(MagneticField { time, field_b }))
                .unwrap();
        }
    }
    writer.finish().unwrap();
}

fn run(path: &Path, config: &Config, options: ReadOptions) -> RunReport {
    let log = Log::open(path, options).unwrap();
    let plan = Plan::make(&log, config, &RunOptions::default()).unwrap();
    plan.execute(&log, &mut ()).unwrap()
}

fn warned(report: &RunReport, code: &str) -> bool {
    report.warnings.iter().any(|w| w.code == code)
}

#[test]
fn a_run_that_learns_no_heading_starts_by_the_magnetometer() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    standing(&path, 1.0);
    let report = run(&path, &Config::default(), ReadOptions::default());
    let start = report.alignment.unwrap();
    assert_eq!(start.heading_source, HeadingSource::Magnetic);
    // Exact but for the declination and for the tilt by the biases of the accelerometers, which the dip makes more of.
    let off = start.heading_deg - (HEADING_DEG - DECLINATION_DEG);
    assert!(
        off.abs() < 9.0 && start.sigma_heading_deg > 15.0,
        "{start:?}"
    );
    assert!(warned(&report, "declination_unknown"));
    let mut config = Config::default();
    config.alignment.declination_deg = Some(DECLINATION_DEG);
    config.alignment.magnetic_sigma_deg = Some(3.0);
    let told = run(&path, &config, ReadOptions::default());
    let turned = told.alignment.unwrap();
    assert!((turned.heading_deg - start.heading_deg - DECLINATION_DEG).abs() < 1e-9);
    assert!(
        turned.sigma_heading_deg < start.sigma_heading_deg && !warned(&told, "declination_unknown")
    );
    // Without GNSS likewise, at rest.
    config.gnss.used = false;
    let alone = run(&path, &config, ReadOptions::default())
        .alignment
        .unwrap();
    assert_eq!(alone.heading_source, HeadingSource::Magnetic);
    assert!((alone.heading_deg - HEADING_DEG).abs() < 9.0, "{alone:?}");
    // What is given goes before, and who wants none gets none.
    config.alignment.heading_deg = Some(10.0);
    let given = run(&path, &config, ReadOptions::default())
        .alignment
        .unwrap();
    assert_eq!(given.heading_source, HeadingSource::Given);
    let none = ReadOptions {
        topics: vec![(Role::Magnetometer, "none".into())],
        ..ReadOptions::default()
    };
    let none = run(&path, &Config::default(), none);
    assert_eq!(
        none.alignment.unwrap().heading_source,
        HeadingSource::Unknown
    );
}

#[test]
fn a_field_in_gauss_or_microtesla_is_refused_with_a_remedy() {
    for (factor, unit) in [(1e4, "gauss"), (1e6, "microtesla")] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        standing(&path, factor);
        let report = run(&path, &Config::default(), ReadOptions::default());
        let start = report.alignment.unwrap();
        assert_eq!(start.heading_source, HeadingSource::Unknown);
        let told = report
            .warnings
            .iter()
            .find(|w| w.code == "magnetic_units")
            .unwrap();
        assert!(told.message.contains(unit), "{}", told.message);
    }
}
