//! Messages become samples: units, axes, order, and what is dropped and counted on the way.

mod recordings;

use insnav_core::earth::Geodetic;
use insnav_core::sample::{GnssPosition, GnssVelocity, ImuSample, Sample};
use insnav_core::time::Time;
use insnav_log::cdr::{CdrWriter, Endian};
use insnav_log::ros2::*;
use insnav_log::{
    Choice, ImuAxes, Log, LogError, LogWriter, LogWriterOptions, ReadOptions, Role, TimeSource,
    convert, csv,
};
use nalgebra::{Matrix3, Vector3};
use recordings::recording;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const SECOND: i64 = 1_000_000_000;
const T0: i64 = 1_600_000_000 * SECOND;

/// A log made message by message, so that it can be as odd as real ones are.
struct Recorder {
    writer: mcap::Writer<std::io::Cursor<Vec<u8>>>,
    channels: BTreeMap<String, u16>,
    endian: Endian,
}

impl Recorder {
    fn new() -> Self {
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

    fn put<M: Encode>(&mut self, topic: &str, log_time: i64, message: &M) {
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

    fn raw(&mut self, topic: &str, log_time: i64, bytes: &[u8]) {
        let header = mcap::records::MessageHeader {
            channel_id: self.channels[topic],
            sequence: 0,
            log_time: log_time as u64,
            publish_time: log_time as u64 + 7,
        };
        self.writer.write_to_known_channel(&header, bytes).unwrap();
    }

    fn imu(&mut self, topic: &str, log_time: i64, stamp: i64) {
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

    fn fix(&mut self, time: i64, change: impl FnOnce(&mut NavSatFix<'_>)) {
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

    fn open(mut self, options: ReadOptions) -> Result<Log, LogError> {
        self.writer.finish().unwrap();
        Log::from_bytes(
            Path::new("made.mcap"),
            self.writer.into_inner().into_inner(),
            options,
        )
    }
}

fn samples(log: &Log) -> Vec<Sample> {
    log.samples().unwrap().map(Result::unwrap).collect()
}

fn times(log: &Log) -> Vec<i64> {
    samples(log).iter().map(|s| s.time().0).collect()
}

#[test]
fn real_logs_give_the_samples_of_the_tables_they_were_made_from() {
    for (file, folder, imu_count, gnss_count) in [
        (
            "rtkexp_drive_ros2_zstd.mcap",
            "rtkexp_drive_0708",
            54858,
            2197,
        ),
        ("comma2k19_ros2_lz4.mcap", "comma2k19_example1", 6256, 579),
        ("comma2k19_ros2_none.mcap", "comma2k19_example1", 6256, 579),
    ] {
        let (Some(log), Some(folder)) = (
            recording("mcap_real").map(|f| f.join(file)),
            recording(folder),
        ) else {
            return;
        };
        let log = Log::open(&log, ReadOptions::default()).unwrap();
        let imu = csv::read_imu(&folder.join("imu.csv.gz")).unwrap();
        let gnss = csv::read_gnss(&folder.join("gnss.csv.gz")).unwrap();
        assert_eq!((imu.t_s.len(), gnss.t_s.len()), (imu_count, gnss_count));
        let t0 = log.t0().unwrap().unwrap();
        let (mut at_imu, mut at_position, mut at_velocity) = (0, 0, 0);
        let mut last = Time(i64::MIN);
        for sample in samples(&log) {
            assert!(sample.time() >= last);
            last = sample.time();
            match sample {
                Sample::Imu(s) => {
                    assert_eq!(s.angular_rate_b, imu.angular_rate[at_imu]);
                    assert_eq!(s.specific_force_b, imu.specific_force[at_imu]);
                    // Both were rounded: the table to 10 µs, the log's maker to a double's 0.2 µs.
                    assert!((s.time.since(t0) - imu.t_s[at_imu]).abs() < 1.1e-5);
                    at_imu += 1;
                }
                Sample::GnssPosition(s) => {
                    assert_eq!(s.position, gnss.position[at_position]);
                    assert!((s.time.since(t0) - gnss.t_s[at_position]).abs() < 1.1e-5);
                    let sigma = gnss.position_sigma_n[at_position];
                    match s.covariance_n {
                        None => assert!(sigma.x.is_nan()),
                        Some(p) => assert!((p.diagonal().map(f64::sqrt) - sigma).norm() < 1e-12),
                    }
                    at_position += 1;
                }
                Sample::GnssVelocity(s) => {
                    let expected = gnss.velocity_n[at_velocity];
                    assert_eq!(s.velocity_n.xy(), expected.xy());
                    // comma2k19 has no vertical velocity: its log says 0, which must come out as "not measured".
                    assert!(
                        s.velocity_n.z == expected.z
                            || (s.velocity_n.z.is_nan() && expected.z.is_nan()),
                        "{s:?}"
                    );
                    at_velocity += 1;
                }
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(
            (at_imu, at_position, at_velocity),
            (imu_count, gnss_count, gnss_count),
            "{file}"
        );
    }
}

#[test]
fn axes_and_mounting_turn_the_imu_into_the_body() {
    let read = |imu_axes, imu_mounting_rpy_deg| {
        let mut recorder = Recorder::new();
        recorder.imu("/imu", T0, T0);
        let options = ReadOptions {
            imu_axes,
            imu_mounting_rpy_deg,
            ..ReadOptions::default()
        };
        match samples(&recorder.open(options).unwrap())[0] {
            Sample::Imu(s) => (s.angular_rate_b, s.specific_force_b),
            other => panic!("{other:?}"),
        }
    };
    let (w, f) = read(ImuAxes::Flu, None);
    assert_eq!(
        (w, f),
        (Vector3::new(0.1, -0.2, -0.3), Vector3::new(1.0, -2.0, -9.8))
    );
    let (w, f) = read(ImuAxes::Frd, None);
    assert_eq!(
        (w, f),
        (Vector3::new(0.1, 0.2, 0.3), Vector3::new(1.0, 2.0, 9.8))
    );
    // The unit looks left (yaw 90° to the left in forward-left-up): its x is the body's left.
    let (w, f) = read(ImuAxes::Flu, Some([0.0, 0.0, 90.0]));
    assert!((w - Vector3::new(-0.2, -0.1, -0.3)).norm() < 1e-15);
    assert!((f - Vector3::new(-2.0, -1.0, -9.8)).norm() < 1e-14);
    // In forward-right-down, yaw 90° is to the right: its x is the body's right.
    let (w, _) = read(ImuAxes::Frd, Some([0.0, 0.0, 90.0]));
    assert!((w - Vector3::new(-0.2, 0.1, 0.3)).norm() < 1e-15);
}

/// The husky's raw IMU with the mounting its README states must give the table that was rotated by the robot's own tf.
#[test]
fn the_mounting_of_the_husky_is_that_of_its_transform() {
    let (Some(bag), Some(table)) = (
        recording("mcap_real/husky_ros1.mcap"),
        recording("husky_rl_test1/imu.csv.gz"),
    ) else {
        return;
    };
    let table = csv::read_imu(&table).unwrap();
    let log = Log::open(&bag, ReadOptions::default()).unwrap();
    let topic = log.topics().iter().find(|t| t.name == "/imu/data").unwrap();
    let mut recorder = Recorder::new();
    log.each_message(topic, |message| -> Result<(), LogError> {
        // ROS 1: sequence number, stamp, frame with its length, then 37 packed doubles.
        let frame = u32::from_le_bytes(message.data[12..16].try_into().unwrap()) as usize;
        let number = |i: usize| {
            let at = 16 + frame + 8 * i;
            f64::from_le_bytes(message.data[at..at + 8].try_into().unwrap())
        };
        let imu = Imu {
            header: Header {
                stamp: message.log_time,
                frame_id: "imu",
            },
            angular_velocity: Vector3::new(number(13), number(14), number(15)),
            linear_acceleration: Vector3::new(number(25), number(26), number(27)),
            ..Imu::default()
        };
        recorder.put("/imu", message.log_time.0, &imu);
        Ok(())
    })
    .unwrap();
    let options = ReadOptions {
        imu_mounting_rpy_deg: Some([90.0, 0.0, -90.0]),
        ..ReadOptions::default()
    };
    let samples = samples(&recorder.open(options).unwrap());
    assert_eq!(samples.len(), table.t_s.len());
    for (i, sample) in samples.iter().enumerate() {
        let Sample::Imu(sample) = sample else {
            panic!()
        };
        // The table has five decimals of force and seven of rate.
        assert!(
            (sample.specific_force_b - table.specific_force[i]).amax() < 6e-6,
            "{i}"
        );
        assert!(
            (sample.angular_rate_b - table.angular_rate[i]).amax() < 6e-8,
            "{i}"
        );
    }
}

#[test]
fn big_endian_messages_read_the_same() {
    let make = |endian| {
        let mut recorder = Recorder {
            endian,
            ..Recorder::new()
        };
        recorder.imu("/imu", T0, T0);
        recorder.fix(T0, |_| ());
        samples(&recorder.open(ReadOptions::default()).unwrap())
    };
    assert_eq!(make(Endian::Big), make(Endian::Little));
}

#[test]
fn definitions_in_idl_serve_as_well() {
    let mut recorder = Recorder::new();
    let idl = b"================\nIDL: sensor_msgs/msg/Imu\nmodule sensor_msgs { module msg { struct Imu {}; }; };";
    let schema = recorder
        .writer
        .add_schema("sensor_msgs/msg/Imu", "ros2idl", idl)
        .unwrap();
    let id = recorder
        .writer
        .add_channel(schema, "/imu", "cdr", &BTreeMap::new())
        .unwrap();
    recorder.channels.insert("/imu".into(), id);
    recorder.imu("/imu", T0 + 5, T0);
    let log = recorder.open(ReadOptions::default()).unwrap();
    assert_eq!(times(&log), [T0]);
    let offset = log.statistics().unwrap()[0].header_minus_log_s.unwrap();
    assert_eq!((offset.mean, offset.min, offset.max), (-5e-9, -5e-9, -5e-9));
}

#[test]
fn fixes_that_are_none_are_dropped_and_counted() {
    let mut recorder = Recorder::new();
    recorder.imu("/imu", T0, T0);
    recorder.fix(T0 + 1, |fix| fix.status = -1);
    recorder.fix(T0 + 2, |fix| fix.latitude_deg = f64::NAN);
    recorder.fix(T0 + 3, |fix| {
        (fix.latitude_deg, fix.longitude_deg) = (0.0, 0.0)
    });
    recorder.fix(T0 + 4, |fix| fix.latitude_deg = 91.0);
    recorder.fix(T0 + 5, |fix| {
        fix.status = -2; // Not set by the driver: no reason to drop.
        fix.position_covariance = [1.0; 9]; // Type "unknown": numbers without meaning.
    });
    recorder.fix(T0 + 6, |fix| {
        fix.position_covariance_type = CovarianceType::Known;
        fix.position_covariance = [4.0, 1.0, 2.0, 1.0, 9.0, 3.0, 2.0, 3.0, 16.0];
    });
    recorder.fix(T0 + 7, |fix| {
        fix.position_covariance_type = CovarianceType::DiagonalKnown
    }); // All zero: not known.
    let log = recorder
        .open(ReadOptions {
            geoid_height_m: 22.5,
            ..ReadOptions::default()
        })
        .unwrap();
    assert_eq!(log.first_fix().unwrap().unwrap().time, Time(T0 + 5));
    let mut samples = log.samples().unwrap();
    let all: Vec<Sample> = samples.by_ref().map(Result::unwrap).collect();
    let counts = samples.counts();
    assert_eq!(
        (
            counts.dropped_no_fix,
            counts.dropped_not_finite,
            counts.dropped_zero_position
        ),
        (1, 2, 1)
    );
    assert_eq!((counts.gnss_position, counts.imu), (3, 1));
    let [
        Sample::Imu(_),
        Sample::GnssPosition(a),
        Sample::GnssPosition(b),
        Sample::GnssPosition(c),
    ] = all.as_slice()
    else {
        panic!("{all:?}")
    };
    assert_eq!((a.covariance_n, c.covariance_n), (None, None));
    // ENU (ee, en, eu, nn, nu, uu) = (4, 1, 2, 9, 3, 16) in NED.
    assert_eq!(
        b.covariance_n,
        Some(Matrix3::new(
            9.0, 1.0, -3.0, 1.0, 4.0, -2.0, -3.0, -2.0, 16.0
        ))
    );
    assert_eq!(a.position, Geodetic::from_degrees(59.0, 18.0, 52.5));

    let statistics = log.statistics().unwrap();
    let fix = statistics.iter().find(|s| s.topic == "/fix").unwrap();
    assert_eq!(
        (fix.count, fix.no_fix, fix.not_finite, fix.zero_position),
        (7, 1, 2, 1)
    );
}

#[test]
fn velocities_keep_what_was_measured() {
    let mut covariance = [0.0; 36];
    (covariance[0], covariance[7], covariance[14]) = (0.04, 0.09, 0.16);
    let mut absent = covariance;
    absent[0] = -1.0;
    let put = |linear: [f64; 3], covariance: [f64; 36]| {
        let mut recorder = Recorder::new();
        recorder.imu("/imu", T0, T0);
        let header = Header {
            stamp: Time(T0 + 1),
            frame_id: "gps",
        };
        let twist = Twist {
            linear: linear.into(),
            angular: Vector3::zeros(),
        };
        recorder.put(
            "/vel",
            T0 + 1,
            &TwistWithCovarianceStamped {
                header,
                twist,
                covariance,
            },
        );
        let log = recorder.open(ReadOptions::default()).unwrap();
        let mut samples = log.samples().unwrap();
        let velocity = samples.by_ref().find_map(|s| match s.unwrap() {
            Sample::GnssVelocity(v) => Some((v.velocity_n, v.covariance_n.map(|p| p.diagonal()))),
            _ => None,
        });
        velocity.ok_or(samples.counts().dropped_velocity_not_finite)
    };
    let ned = Vector3::new(0.09, 0.04, 0.16);
    assert_eq!(
        put([1.0, 2.0, 3.0], covariance),
        Ok((Vector3::new(2.0, 1.0, -3.0), Some(ned)))
    );
    assert_eq!(
        put([1.0, 2.0, 3.0], absent),
        Ok((Vector3::new(2.0, 1.0, -3.0), None))
    );
    assert_eq!(
        put([1.0, 2.0, 3.0], [0.0; 36]),
        Ok((Vector3::new(2.0, 1.0, -3.0), None))
    );
    // A vertical of exactly zero is a measurement only if it has a variance, or if nothing moves.
    assert_eq!(put([1.0, 2.0, 0.0], covariance).unwrap().0.z, 0.0);
    assert!(put([1.0, 2.0, 0.0], [0.0; 36]).unwrap().0.z.is_nan());
    assert_eq!(put([0.0, 0.0, 0.0], [0.0; 36]).unwrap().0, Vector3::zeros());
    let (horizontal, variances) = put([1.0, 2.0, f64::NAN], covariance).unwrap();
    assert!(horizontal.z.is_nan() && horizontal.xy() == nalgebra::Vector2::new(2.0, 1.0));
    assert_eq!(variances, Some(Vector3::new(0.09, 0.04, 0.09)));
    assert_eq!(put([f64::NAN, 2.0, 0.0], covariance), Err(1));
}

#[test]
fn samples_come_in_order_of_their_stamps() {
    let mut recorder = Recorder::new();
    for k in 0..300 {
        let time = T0 + k * SECOND / 100;
        recorder.imu("/imu", time, time);
        if k % 20 == 0 {
            // Recorded 0.3 s after it was valid.
            let stamp = time - 3 * SECOND / 10;
            let header = Header {
                stamp: Time(stamp),
                frame_id: "gps",
            };
            recorder.put(
                "/fix",
                time,
                &NavSatFix {
                    header,
                    latitude_deg: 59.0,
                    longitude_deg: 18.0,
                    ..NavSatFix::default()
                },
            );
        }
    }
    let log = recorder.open(ReadOptions::default()).unwrap();
    let times = times(&log);
    assert!(times.is_sorted());
    assert_eq!(times.len(), 315);
    let by_log_time = ReadOptions {
        time_source: TimeSource::Log,
        ..ReadOptions::default()
    };
    let log = Log::from_bytes(Path::new("x"), log.bytes().to_vec(), by_log_time).unwrap();
    assert!(
        samples(&log)
            .iter()
            .all(|s| (s.time().0 - T0) % (SECOND / 100) == 0)
    );
    let published = ReadOptions {
        time_source: TimeSource::Publish,
        ..ReadOptions::default()
    };
    let log = Log::from_bytes(Path::new("x"), log.bytes().to_vec(), published).unwrap();
    assert_eq!(samples(&log)[0].time(), Time(T0 + 7));
}

#[test]
fn a_clock_that_jumps_back_is_an_error_that_names_both_times() {
    let mut recorder = Recorder::new();
    for k in 0..400 {
        let time = T0 + k * SECOND / 100;
        recorder.imu(
            "/imu",
            time,
            if k < 300 { time } else { time - 10 * SECOND },
        );
    }
    let log = recorder.open(ReadOptions::default()).unwrap();
    let error = log.samples().unwrap().find_map(Result::err).unwrap();
    assert_eq!(error.code(), "backward_stamps");
    assert!(
        error
            .to_string()
            .contains("/imu: stamp 1599999993.000000 s comes after 160000000"),
        "{error}"
    );
    assert!(error.remedy().contains("--time log"));
    let statistics = &log.statistics().unwrap()[0];
    assert_eq!((statistics.backward_steps, statistics.duplicates), (1, 0));
    // The remedy works.
    let options = ReadOptions {
        time_source: TimeSource::Log,
        ..ReadOptions::default()
    };
    let log = Log::from_bytes(Path::new("x"), log.bytes().to_vec(), options).unwrap();
    assert_eq!(samples(&log).len(), 400);
}

#[test]
fn a_message_without_stamp_takes_the_log_time() {
    let mut recorder = Recorder::new();
    recorder.imu("/imu", T0, 0);
    recorder.imu("/imu", T0 + SECOND, 0);
    let log = recorder.open(ReadOptions::default()).unwrap();
    assert_eq!(log.t0().unwrap(), Some(Time(T0)));
    assert_eq!(times(&log), [T0, T0 + SECOND]);
    let mut samples = log.samples().unwrap();
    assert_eq!(samples.by_ref().count(), 2);
    assert_eq!(samples.counts().unstamped, 2);
    assert_eq!(log.statistics().unwrap()[0].unstamped, 2);
}

#[test]
fn nan_samples_are_passed_on_and_counted() {
    let mut recorder = Recorder::new();
    let header = Header {
        stamp: Time(T0),
        frame_id: "imu",
    };
    let angular_velocity = Vector3::new(0.0, f64::NAN, 0.0);
    recorder.put(
        "/imu",
        T0,
        &Imu {
            header,
            angular_velocity,
            ..Imu::default()
        },
    );
    recorder.imu("/imu", T0 + 1, T0 + 1);
    let log = recorder.open(ReadOptions::default()).unwrap();
    let mut samples = log.samples().unwrap();
    assert_eq!(samples.by_ref().count(), 2);
    assert_eq!(samples.counts().imu_not_finite, 1);
    assert_eq!(log.statistics().unwrap()[0].not_finite, 1);
}

#[test]
fn a_damaged_message_is_named_by_file_topic_and_time() {
    let mut recorder = Recorder::new();
    recorder.imu("/imu", T0, T0);
    recorder.raw("/imu", T0 + SECOND, &[0, 1, 0, 0, 1, 2, 3]);
    let log = recorder.open(ReadOptions::default()).unwrap();
    let error = log.samples().unwrap().find_map(Result::err).unwrap();
    assert_eq!(error.code(), "bad_message");
    // The statistics go on: they are what one looks at to find out.
    let statistics = &log.statistics().unwrap()[0];
    assert_eq!((statistics.count, statistics.undecodable), (2, 1));
    let text = error.to_string();
    assert!(
        text.starts_with(
            "made.mcap: /imu at 1600000001.000000 s (log time): not a valid sensor_msgs/msg/Imu"
        ),
        "{text}"
    );
}

#[test]
fn missing_and_ambiguous_topics_say_what_to_do() {
    let mut recorder = Recorder::new();
    recorder.fix(T0, |_| ());
    recorder.fix(T0 + SECOND, |_| ());
    let log = recorder.open(ReadOptions::default()).unwrap();
    let error = log.require(Role::Imu).unwrap_err();
    assert_eq!(error.code(), "no_imu_topic");
    assert!(
        error
            .to_string()
            .contains("/fix (sensor_msgs/msg/NavSatFix in cdr, 2 messages, 1.0 Hz)"),
        "{error}"
    );

    let mut recorder = Recorder::new();
    recorder.imu("/front/imu", T0, T0);
    recorder.imu("/rear/imu", T0, T0);
    let log = recorder.open(ReadOptions::default()).unwrap();
    assert_eq!(
        log.require(Role::GnssPosition).unwrap_err().code(),
        "no_gnss_topic"
    );
    assert_eq!(
        *log.selected().choice(Role::Imu),
        Choice::Ambiguous(vec![0, 1])
    );
    let error = log.samples().err().unwrap();
    assert_eq!(error.code(), "ambiguous_topic");
    assert_eq!(
        error.remedy(),
        "choose one: `--topic imu=/front/imu` or `--topic imu=/rear/imu`"
    );
    let options = ReadOptions {
        topics: vec![(Role::Imu, "/rear/imu".into())],
        ..ReadOptions::default()
    };
    let log = Log::from_bytes(Path::new("x"), log.bytes().to_vec(), options).unwrap();
    assert_eq!(samples(&log).len(), 1);
}

#[test]
fn encodings_that_are_not_read_are_listed_as_they_are() {
    let Some(folder) = recording("mcap_real") else {
        return;
    };
    for (file, says) in [
        ("comma2k19_json_zstd.mcap", "/imu/data (Imu in json"),
        ("husky_ros1.mcap", "sensor_msgs/Imu in ros1"),
    ] {
        let log = Log::open(&folder.join(file), ReadOptions::default()).unwrap();
        let error = log.require(Role::Imu).unwrap_err();
        assert_eq!(error.code(), "no_imu_topic");
        assert!(error.to_string().contains(says), "{error}");
    }
}

#[test]
fn the_lever_arm_comes_from_static_transforms() {
    let mut recorder = Recorder::new();
    recorder.imu("/imu", T0, T0);
    recorder.fix(T0, |_| ());
    let at = |parent, child, translation: [f64; 3]| TransformStamped {
        header: Header {
            stamp: Time(T0),
            frame_id: parent,
        },
        child_frame_id: child,
        translation: translation.into(),
        rotation: [0.0, 0.0, 0.0, 1.0],
    };
    let transforms = [
        at("base_link", "imu", [0.2, 0.0, 0.1]),
        at("/base_link", "/gps", [1.2, 0.5, 1.1]),
    ];
    recorder.put(
        "/tf_static",
        T0,
        &TfMessage {
            transforms: &transforms,
        },
    );
    let log = recorder.open(ReadOptions::default()).unwrap();
    assert_eq!(log.static_transforms().unwrap().len(), 2);
    let lever = log.lever_arm_b().unwrap().unwrap();
    assert!(
        (lever - Vector3::new(1.0, -0.5, -1.0)).norm() < 1e-12,
        "{lever}"
    );

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let options = LogWriterOptions {
        lever_arm_b: Some(lever),
        ..LogWriterOptions::default()
    };
    let mut writer = LogWriter::create(&path, options).unwrap();
    for sample in samples(&log) {
        writer.write(&sample).unwrap();
    }
    writer.finish().unwrap();
    let back = Log::open(&path, ReadOptions::default())
        .unwrap()
        .lever_arm_b()
        .unwrap()
        .unwrap();
    assert!((back - lever).norm() < 1e-12);
}

#[test]
fn written_samples_are_read_back_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let v = Vector3::new;
    let covariance = Some(Matrix3::new(4.0, 0.5, 0.1, 0.5, 5.0, -0.2, 0.1, -0.2, 9.0));
    let written = [
        Sample::Imu(ImuSample {
            time: Time(T0),
            angular_rate_b: v(0.1, 0.2, 0.3),
            specific_force_b: v(1.0, 2.0, -9.8),
        }),
        Sample::GnssPosition(GnssPosition {
            time: Time(T0 + 1),
            position: Geodetic::from_degrees(59.0, 18.0, 30.0),
            covariance_n: covariance,
        }),
        Sample::GnssVelocity(GnssVelocity {
            time: Time(T0 + 1),
            velocity_n: v(1.0, 2.0, 3.0),
            covariance_n: covariance,
        }),
        Sample::GnssVelocity(GnssVelocity {
            time: Time(T0 + 2),
            velocity_n: v(1.0, 2.0, 3.0),
            covariance_n: None,
        }),
    ];
    let options = LogWriterOptions {
        t0: Some(Time(T0 - 5)),
        ..LogWriterOptions::default()
    };
    let mut writer = LogWriter::create(&path, options).unwrap();
    for sample in &written {
        writer.write(sample).unwrap();
    }
    let heading = insnav_core::sample::Heading {
        time: Time(T0),
        heading: 0.0,
        sigma: 1.0,
    };
    assert_eq!(
        writer.write(&Sample::Heading(heading)).unwrap_err().code(),
        "unwritable_sample"
    );
    writer.finish().unwrap();
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    assert_eq!(samples(&log), written);
    assert_eq!(log.t0().unwrap(), Some(Time(T0 - 5)));
    assert_eq!(
        log.frame_of(Role::GnssPosition).unwrap().as_deref(),
        Some("gps")
    );
}

fn convert(inputs: &convert::CsvInputs, output: &Path, axes: ImuAxes) -> convert::ConvertSummary {
    let options = convert::ConvertOptions {
        axes,
        ..Default::default()
    };
    convert::csv_to_mcap(inputs, output, &options).unwrap()
}

#[test]
fn tables_become_logs_and_tables_again() {
    for name in [
        "hipnuc_20220504",
        "kth_skog_car",
        "rtkexp_drive_0708",
        "comma2k19_example1",
    ] {
        let Some(source) = recording(name) else {
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let inputs = convert::CsvInputs::in_folder(&source).unwrap();
        let path = folder.path().join("a.mcap");
        let summary = convert(&inputs, &path, ImuAxes::Frd);
        let log = Log::open(&path, ReadOptions::default()).unwrap();
        assert_eq!(log.t0().unwrap(), Some(convert::DEFAULT_T0));
        convert::mcap_to_csv(&log, &folder.path().join("csv"), false).unwrap();
        let back = convert::CsvInputs::in_folder(&folder.path().join("csv")).unwrap();

        let (a, b) = (
            csv::read_imu(&inputs.imu).unwrap(),
            csv::read_imu(&back.imu).unwrap(),
        );
        assert_eq!(
            (a.t_s.len() as u64, &a.angular_rate, &a.specific_force),
            (summary.imu, &b.angular_rate, &b.specific_force)
        );
        assert!(
            a.t_s.iter().zip(&b.t_s).all(|(a, b)| (a - b).abs() < 1e-9),
            "{name}"
        );
        let [a, b] =
            [inputs.gnss.unwrap(), back.gnss.unwrap()].map(|path| csv::read_gnss(&path).unwrap());
        assert_eq!(a.t_s.len(), b.t_s.len());
        let same = |a: f64, b: f64, tolerance: f64| {
            (a - b).abs() <= tolerance || (a.is_nan() && b.is_nan())
        };
        for i in 0..a.t_s.len() {
            assert!((a.t_s[i] - b.t_s[i]).abs() < 1e-9);
            // Eleven decimals of a degree are a micrometre.
            assert!(a.position[i].offset_to(&b.position[i]).norm() < 2e-6);
            for k in 0..3 {
                assert!(
                    same(a.velocity_n[i][k], b.velocity_n[i][k], 0.0),
                    "{name} {i}"
                );
                assert!(
                    same(a.position_sigma_n[i][k], b.position_sigma_n[i][k], 1e-12),
                    "{name} {i}"
                );
            }
        }
    }
}

#[test]
fn flu_tables_are_the_same_log_as_their_frd_twins() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, rows: &str| -> PathBuf {
        let path = folder.path().join(name);
        std::fs::write(&path, format!("t_s,gx,gy,gz,ax,ay,az\n{rows}\n")).unwrap();
        path
    };
    let read = |imu: PathBuf, axes| {
        let path = imu.with_extension("mcap");
        convert(&convert::CsvInputs { imu, gnss: None }, &path, axes);
        samples(&Log::open(&path, ReadOptions::default()).unwrap())
    };
    let frd = read(write("frd.csv", "0.5,0.1,0.2,0.3,1,2,-9.8"), ImuAxes::Frd);
    assert_eq!(
        frd,
        read(write("flu.csv", "0.5,0.1,-0.2,-0.3,1,-2,9.8"), ImuAxes::Flu)
    );
    assert_eq!(frd[0].time(), Time(T0 + SECOND / 2));
}

#[test]
fn every_recording_has_readable_tables() {
    let Some(root) = recording("README.md") else {
        return;
    };
    let (mut read, mut with_truth) = (0, 0);
    let mut folders = vec![root.parent().unwrap().to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let rows = match name.as_str() {
                _ if path.is_dir() => {
                    folders.push(path);
                    continue;
                }
                "imu.csv.gz" => csv::read_imu(&path).unwrap().t_s.len(),
                "gnss.csv.gz" => csv::read_gnss(&path).unwrap().t_s.len(),
                "truth.csv.gz" => csv::read_truth(&path).unwrap().t_s.len(),
                "truth_quat.csv.gz" => {
                    let table = csv::read_truth_quat(&path).unwrap();
                    with_truth += usize::from(table.orientation.iter().any(Option::is_some));
                    table.t_s.len()
                }
                "speedometer.csv" | "wheel_odom.csv" => csv::read_speed(&path).unwrap().t_s.len(),
                _ => continue,
            };
            assert!(rows > 100, "{}: {rows} rows", path.display());
            read += 1;
        }
    }
    assert!(read >= 34, "{read} tables");
    // Of the ten with a reference, repoimu_TStick_Test01_Static has NaN in every row.
    assert_eq!(with_truth, 9);
}
