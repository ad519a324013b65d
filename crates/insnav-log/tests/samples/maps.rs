//! Messages of unknown types, read by the user's map.

use crate::recorder::{Recorder, SECOND, T0};
use insnav_core::earth::Geodetic;
use insnav_core::sample::{GnssPosition, GnssVelocity, ImuSample, Sample};
use insnav_core::time::Time;
use insnav_log::cdr::{CdrWriter, Endian};
use insnav_log::{Log, LogError, ReadOptions, parse_maps};
use nalgebra::{Matrix3, Vector3};

const MAP: &str = r#"
[[map]]
topic = "/state"
time_s = "t_ms / 1000"
angular_rate_rad_per_s = ["gyro.x * 0.5", "gyro.y * 0.5", "-gyro.z * 0.5"]
specific_force_m_per_s2 = ["acc.0", "acc.1", "acc.2"]
imu_axes = "frd"
latitude_deg = "gps.lat * 1e-7"
longitude_deg = "gps.lon * 1e-7"
height_m = "gps.alt / 1000"
position_sigma_m = ["gps.h_acc", "gps.h_acc", "gps.v_acc"]
velocity_m_per_s = ["gps.v.n", "gps.v.e", "gps.v.d"]
gnss_axes = "ned"
fix = "gps.fix"
fix_from = 3
"#;

const JSON: &str = r#"{"t_ms": 1600000000250, "gyro": {"x": 1, "y": 2, "z": 3}, "acc": [0.5, 0.25, -9.75],
    "gps": {"lat": 590000000, "lon": 180000000, "alt": 30000, "h_acc": 2, "v_acc": 3, "v": {"n": 1, "e": 2, "d": 0.5}, "fix": 3}}"#;

/// The same in ROS 2, by a definition of its own; widths and order are its own too.
const DEFINITION: &str = "float32[] acc\nmy_msgs/Gps gps\nint64 t_ms\ngeometry_msgs/Vector3 gyro\n===\nMSG: my_msgs/Gps\n\
    int32 lat\nint32 lon\nint32 alt\nuint8 fix\nfloat32 h_acc\nfloat32 v_acc\nVelocity v\n===\nMSG: my_msgs/Velocity\n\
    float64 n\nfloat64 e\nfloat64 d\n===\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n";

fn cdr() -> Vec<u8> {
    let mut w = CdrWriter::new(Endian::Big);
    w.sequence(3);
    for x in [0.5f32, 0.25, -9.75] {
        w.u32(x.to_bits());
    }
    for x in [590_000_000, 180_000_000, 30_000] {
        w.i32(x);
    }
    w.u8(3);
    for x in [2f32, 3.0] {
        w.u32(x.to_bits());
    }
    w.f64_array(&[1.0, 2.0, 0.5]);
    // A 64-bit whole number lies as a double does.
    w.f64(f64::from_bits(1_600_000_000_250));
    w.f64_array(&[1.0, 2.0, 3.0]);
    w.bytes().to_vec()
}

fn open(map: &str, kind: [&str; 3], definition: &str, message: &[u8]) -> Log {
    let mut recorder = Recorder::new();
    recorder.foreign("/state", T0, kind, definition.as_bytes(), message);
    let options = ReadOptions {
        maps: parse_maps(map, "car.toml").unwrap(),
        ..ReadOptions::default()
    };
    recorder.open(options).unwrap()
}

#[test]
fn a_map_reads_all_sensors_of_one_message_in_any_encoding() {
    let json = open(
        MAP,
        ["VehicleState", "jsonschema", "json"],
        "{}",
        JSON.as_bytes(),
    );
    let ros = open(
        MAP,
        ["my_msgs/msg/State", "ros2msg", "cdr"],
        DEFINITION,
        &cdr(),
    );
    for log in [json, ros] {
        let samples: Vec<Sample> = log.samples().unwrap().map(Result::unwrap).collect();
        let time = Time(T0 + SECOND / 4);
        let sigmas = Matrix3::from_diagonal(&Vector3::new(4.0, 4.0, 9.0));
        assert_eq!(
            samples,
            [
                Sample::Imu(ImuSample {
                    time,
                    angular_rate_b: Vector3::new(0.5, 1.0, -1.5),
                    specific_force_b: Vector3::new(0.5, 0.25, -9.75),
                }),
                Sample::GnssPosition(GnssPosition {
                    time,
                    position: Geodetic::from_degrees(
                        590_000_000.0 * 1e-7,
                        180_000_000.0 * 1e-7,
                        30.0
                    ),
                    covariance_n: Some(sigmas),
                }),
                Sample::GnssVelocity(GnssVelocity {
                    time,
                    velocity_n: Vector3::new(1.0, 2.0, 0.5),
                    covariance_n: None,
                }),
            ]
        );
    }
    let no_fix = JSON.replace("\"fix\": 3", "\"fix\": 2");
    let log = open(MAP, ["", "", "json"], "", no_fix.as_bytes());
    let mut samples = log.samples().unwrap();
    assert_eq!(samples.by_ref().count(), 1);
    let counts = samples.counts();
    assert_eq!(
        (counts.dropped_no_fix, counts.dropped_velocity_no_fix),
        (1, 1)
    );
}

#[test]
fn a_field_that_is_not_there_is_named_with_what_is() {
    let fails = |map: &str| -> LogError {
        let log = open(map, ["", "", "json"], "", JSON.as_bytes());
        log.samples().unwrap().find_map(Result::err).unwrap()
    };
    let error = fails(&MAP.replace("gyro.y", "gyro.w"));
    assert_eq!(error.code(), "field_not_in_message");
    assert!(
        error.to_string().ends_with(
            "/state at 1600000000.000000 s (log time): angular_rate_rad_per_s = \"gyro.w\" of its map: there is no such field"
        ),
        "{error}"
    );
    let remedy = error.remedy();
    assert!(
        remedy.contains("t_ms, gyro.x, gyro.y, gyro.z, acc.0") && remedy.contains("gps.v.d"),
        "{remedy}"
    );
    let error = fails(&MAP.replace("t_ms / 1000", "gps"));
    assert!(
        error
            .to_string()
            .contains("time_s = \"gps\" of its map: the field is an object"),
        "{error}"
    );
}

#[test]
fn a_map_without_a_definition_says_so() {
    let log = open(
        MAP,
        ["my_msgs/msg/State", "ros2idl", "cdr"],
        "struct",
        &[0, 1, 0, 0],
    );
    let text = log.require(insnav_log::Role::Imu).unwrap_err().to_string();
    assert!(text.contains("the definition is in \"ros2idl\""), "{text}");
}
