//! Who says that the vehicle stands: by a Bool, by the speed of its wheels, by a field of any message.

use crate::recorder::{Recorder, SECOND, T0, samples};
use insnav_core::sample::{ImuSample, Sample, Speed, Standstill};
use insnav_core::time::Time;
use insnav_log::cdr::Endian;
use insnav_log::ros2::*;
use insnav_log::{
    Log, LogError, LogWriter, LogWriterOptions, ReadOptions, Role, TimeSource, parse_maps,
};
use nalgebra::Vector3;

fn named(topic: &str) -> ReadOptions {
    ReadOptions {
        topics: vec![(Role::Standing, topic.into())],
        ..ReadOptions::default()
    }
}

fn standing(time: i64, standing: bool) -> Sample {
    Sample::Standstill(Standstill {
        time: Time(time),
        standing,
    })
}

fn speed(time: i64, speed: f64) -> Sample {
    Sample::Speed(Speed {
        time: Time(time),
        speed,
    })
}

/// A message in ROS 1 and in JSON.
fn foreign(kind: &str, [ros1, json]: [&[u8]; 2], encoding: &str) -> Log {
    let mut recorder = Recorder::new();
    let (kind, bytes) = match encoding {
        "ros1" => ([kind, "ros1msg", "ros1"], ros1),
        _ => ([kind, "jsonschema", "json"], json),
    };
    recorder.foreign("/x", T0, kind, b"", bytes);
    recorder.open(named("/x")).unwrap()
}

#[test]
fn one_value_in_every_encoding_counts_at_the_log_time() {
    for endian in [Endian::Little, Endian::Big] {
        let mut recorder = Recorder {
            endian,
            ..Recorder::new()
        };
        recorder.put("/x", T0, &Bool(true));
        recorder.put("/x", T0 + SECOND, &Bool(false));
        recorder.put("/y", T0, &Float32(1.5));
        recorder.put("/z", T0, &Float64(-0.25));
        let log = recorder.open(named("/x")).unwrap();
        assert_eq!(
            samples(&log),
            [standing(T0, true), standing(T0 + SECOND, false)]
        );
        let mut read = log.samples().unwrap();
        assert_eq!(read.by_ref().count(), 2);
        // They have no stamp that a driver could have forgotten.
        assert_eq!((read.counts().standstill, read.counts().unstamped), (2, 0));
        assert_eq!(log.statistics().unwrap()[0].unstamped, 0);
        let again = |topic: &str| {
            let path = std::path::Path::new("x.mcap");
            samples(&Log::from_bytes(path, log.bytes().to_vec(), named(topic)).unwrap())
        };
        assert_eq!(again("/y"), [speed(T0, 1.5)]);
        assert_eq!(again("/z"), [speed(T0, -0.25)]);
    }
    for encoding in ["ros1", "json"] {
        let log = foreign("std_msgs/Bool", [&[1], br#"{"data": true}"#], encoding);
        assert_eq!(samples(&log), [standing(T0, true)], "{encoding}");
        let number = 1.5f32.to_le_bytes();
        let log = foreign("std_msgs/Float32", [&number, br#"{"data": 1.5}"#], encoding);
        assert_eq!(samples(&log), [speed(T0, 1.5)], "{encoding}");
        let number = 2.5f64.to_le_bytes();
        let log = foreign("std_msgs/Float64", [&number, br#"{"data": 2.5}"#], encoding);
        assert_eq!(samples(&log), [speed(T0, 2.5)], "{encoding}");
    }
}

#[test]
fn nothing_declares_standing_unless_it_is_named() {
    let mut recorder = Recorder::new();
    recorder.put("/brake", T0, &Bool(true));
    recorder.put("/wheels", T0, &Float64(0.0));
    recorder.fix(T0, |_| ());
    let log = recorder.open(ReadOptions::default()).unwrap();
    assert!(matches!(samples(&log)[..], [Sample::GnssPosition(_)]));
}

#[test]
fn wheels_count_at_their_stamp_and_what_is_no_number_is_dropped() {
    let header = Header {
        stamp: Time(T0 + 7),
        frame_id: "odom",
    };
    let twist = |x: f64| Twist {
        linear: Vector3::new(x, 0.0, 9.0),
        angular: Vector3::zeros(),
    };
    let odometry = |x: f64| Odometry {
        header,
        child_frame_id: "base_link",
        pose: Pose {
            position: Vector3::zeros(),
            orientation: [0.0, 0.0, 0.0, 1.0],
        },
        pose_covariance: [0.0; 36],
        twist: twist(x),
        twist_covariance: [0.0; 36],
    };
    let mut recorder = Recorder::new();
    recorder.put("/odom", T0, &odometry(-2.5));
    recorder.put("/odom", T0, &odometry(f64::NAN));
    let log = recorder.open(named("/odom")).unwrap();
    // Backward is as fast as forward.
    assert_eq!(samples(&log), [speed(T0 + 7, 2.5)]);
    let mut read = log.samples().unwrap();
    assert_eq!(read.by_ref().count(), 1);
    let counts = read.counts();
    assert_eq!((counts.speed, counts.dropped_speed_not_finite), (1, 1));

    let mut recorder = Recorder::new();
    let message = TwistStamped {
        header,
        twist: twist(0.5),
    };
    recorder.put("/wheels", T0 + 9, &message);
    // As wheels it is no velocity of a receiver.
    let options = ReadOptions {
        topics: vec![
            (Role::Standing, "/wheels".into()),
            (Role::GnssVelocity, "none".into()),
        ],
        ..ReadOptions::default()
    };
    let log = recorder.open(options.clone()).unwrap();
    assert_eq!(samples(&log), [speed(T0 + 7, 0.5)]);
    let by_log = ReadOptions {
        time_source: TimeSource::Log,
        ..options
    };
    let path = std::path::Path::new("x.mcap");
    let log = Log::from_bytes(path, log.bytes().to_vec(), by_log).unwrap();
    assert_eq!(samples(&log), [speed(T0 + 9, 0.5)]);
}

#[test]
fn a_map_names_the_field() {
    let open = |map: &str, json: &str| -> Result<Vec<Sample>, LogError> {
        let mut recorder = Recorder::new();
        recorder.foreign("/car", T0, ["", "", "json"], b"", json.as_bytes());
        let maps = parse_maps(&format!("[[map]]\ntopic = \"/car\"\n{map}"), "car.toml").unwrap();
        let options = ReadOptions {
            maps,
            ..ReadOptions::default()
        };
        recorder.open(options)?.samples()?.collect()
    };
    let json = r#"{"t_ms": 1600000001000, "gear": {"parked": true, "code": 0}, "kmh": -36}"#;
    let parked = "time_s = \"t_ms / 1000\"\nstanding = \"gear.parked\"";
    assert_eq!(open(parked, json).unwrap(), [standing(T0 + SECOND, true)]);
    assert_eq!(
        open("standing = \"gear.code\"", json).unwrap(),
        [standing(T0, false)]
    );
    assert_eq!(
        open("speed_m_per_s = \"kmh / 3.6\"", json).unwrap(),
        [speed(T0, -10.0)]
    );
    let error = open("standing = \"gear.stopped\"", json).unwrap_err();
    assert!(
        error.to_string().contains("standing = \"gear.stopped\""),
        "{error}"
    );
    assert!(error.remedy().contains("gear.parked"), "{}", error.remedy());
    let both = "[[map]]\ntopic = \"/car\"\nstanding = \"a\"\nspeed_m_per_s = \"b\"";
    let error = parse_maps(both, "car.toml").unwrap_err().to_string();
    assert!(error.contains("standing and speed_m_per_s"), "{error}");
}

#[test]
fn what_is_written_reads_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    let imu = |time: i64| {
        Sample::Imu(ImuSample {
            time: Time(time),
            angular_rate_b: Vector3::new(0.5, 0.25, 0.125),
            specific_force_b: Vector3::new(0.0, 0.0, -9.75),
        })
    };
    let write = |samples: &[Sample]| {
        let options = LogWriterOptions {
            force: true,
            ..LogWriterOptions::default()
        };
        let mut writer = LogWriter::create(&path, options).unwrap();
        samples.iter().for_each(|s| writer.write(s).unwrap());
        writer.finish().unwrap();
    };
    let declared = [
        imu(T0),
        standing(T0 + 5, true),
        imu(T0 + 10),
        standing(T0 + 15, false),
    ];
    write(&declared);
    let log = Log::open(&path, named("/vehicle/standing")).unwrap();
    assert_eq!(samples(&log), declared);
    let heard = [imu(T0), speed(T0 + 5, 0.75), imu(T0 + 10)];
    write(&heard);
    let log = Log::open(&path, named("/vehicle/speed")).unwrap();
    assert_eq!(samples(&log), heard);
}
