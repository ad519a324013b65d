//! Devices' own messages, as other programs write them.

use crate::foreign_bytes::*;
use crate::recorder::{Recorder, SECOND, T0, samples};
use insnav_core::earth::Geodetic;
use insnav_core::sample::{GnssPosition, GnssVelocity, ImuSample, Sample};
use insnav_core::time::Time;
use insnav_log::{ReadOptions, Role, SampleCounts};
use nalgebra::{Matrix3, Vector3};

fn bytes(hex: &str) -> Vec<u8> {
    let digits = hex.as_bytes().chunks(2);
    digits
        .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
        .collect()
}

/// Name, language of the definition, encoding; definition; message.
type Foreign = ([&'static str; 3], &'static str, &'static str);

const NAV_PVT_ROS2: Foreign = (
    ["ublox_msgs/msg/NavPVT", "ros2msg", "cdr"],
    NAV_PVT,
    NAV_PVT_CDR,
);
const NAV_PVT_OF_ROS1: Foreign = (
    ["ublox_msgs/NavPVT", "ros1msg", "ros1"],
    NAV_PVT,
    NAV_PVT_ROS1,
);
const GPS_FIX_ROS2: Foreign = (
    ["gps_msgs/msg/GPSFix", "ros2msg", "cdr"],
    GPS_FIX,
    GPS_FIX_CDR,
);
const GPS_FIX_OF_ROS1: Foreign = (
    ["gps_common/GPSFix", "ros1msg", "ros1"],
    GPS_FIX_1,
    GPS_FIX_ROS1,
);
const REL_POS: Foreign = (
    ["ublox_msgs/msg/NavRELPOSNED9", "ros2msg", "cdr"],
    REL_POS_NED,
    REL_POS_NED_CDR,
);
const COMBINED: Foreign = (
    ["px4_msgs/msg/SensorCombined", "ros2msg", "cdr"],
    SENSOR_COMBINED,
    SENSOR_COMBINED_CDR,
);
const PX4_GPS: Foreign = (
    ["px4_msgs/msg/SensorGps", "ros2msg", "cdr"],
    SENSOR_GPS,
    SENSOR_GPS_CDR,
);
const PX4_GPS_2021: Foreign = (
    ["px4_msgs/msg/VehicleGpsPosition", "ros2msg", "cdr"],
    VEHICLE_GPS_POSITION,
    VEHICLE_GPS_POSITION_CDR,
);
const LOCATION_FIX: Foreign = (
    ["foxglove.LocationFix", "protobuf", "protobuf"],
    "",
    LOCATION_FIX_PROTOBUF,
);
const IMU: Foreign = (
    ["sensor_msgs/Imu", "ros1msg", "ros1"],
    "Header header",
    IMU_ROS1,
);
const NAV_SAT_FIX: Foreign = (
    ["sensor_msgs/NavSatFix", "ros1msg", "ros1"],
    "Header header",
    NAV_SAT_FIX_ROS1,
);
const TF_OF_ROS1: Foreign = (["tf2_msgs/TFMessage", "ros1msg", "ros1"], "", TF_ROS1);
const ODOMETRY: Foreign = (
    ["nav_msgs/Odometry", "ros1msg", "ros1"],
    "Header header",
    ODOMETRY_ROS1,
);

fn put(recorder: &mut Recorder, topic: &str, log_time: i64, message: Foreign) {
    let (kind, definition, hex) = message;
    recorder.foreign(topic, log_time, kind, definition.as_bytes(), &bytes(hex));
}

fn read(message: Foreign, log_time: i64, options: ReadOptions) -> (Vec<Sample>, SampleCounts) {
    let mut recorder = Recorder::new();
    put(&mut recorder, "/x", log_time, message);
    let log = recorder.open(options).unwrap();
    let mut samples = log.samples().unwrap();
    (
        samples.by_ref().map(Result::unwrap).collect(),
        samples.counts(),
    )
}

fn diagonal(n: f64, e: f64, d: f64) -> Option<Matrix3<f64>> {
    Some(Matrix3::from_diagonal(&Vector3::new(n, e, d)))
}

/// The stamps and headers of the messages: 2020-09-13 12:26:40.25 UTC.
const STAMP: i64 = T0 + SECOND / 4;

#[test]
fn nav_pvt_is_position_and_velocity_on_the_receivers_utc() {
    for message in [NAV_PVT_ROS2, NAV_PVT_OF_ROS1] {
        // Above sea level or not is for messages that leave it open: this one states both heights.
        let options = ReadOptions {
            geoid_height_m: 25.0,
            ..ReadOptions::default()
        };
        // Second 40 minus 0.25 s, recorded 0.1 s later: a delay, the clocks agree.
        let stamp = T0 - SECOND / 4;
        let (samples, _) = read(message, stamp + SECOND / 10, options);
        let [Sample::GnssPosition(p), Sample::GnssVelocity(v)] = samples.as_slice() else {
            panic!("{samples:?}")
        };
        assert_eq!(
            *p,
            GnssPosition {
                time: Time(stamp),
                position: Geodetic::from_degrees(590123456.0 * 1e-7, 180123456.0 * 1e-7, 30.5),
                covariance_n: diagonal(2.25, 2.25, 6.25),
            }
        );
        let expected = GnssVelocity {
            time: Time(stamp),
            velocity_n: Vector3::new(1.0, -2.0, 0.3),
            covariance_n: diagonal(0.15 * 0.15, 0.15 * 0.15, 0.15 * 0.15),
        };
        assert!((v.velocity_n - expected.velocity_n).norm() < 1e-15 && v.time == expected.time);
        assert_eq!(v.covariance_n, expected.covariance_n);
    }
}

#[test]
fn clocks_of_sensors_come_onto_the_recorders_by_one_constant() {
    let ms = 1_000_000;
    let mut recorder = Recorder::new();
    let boot = |us: u64, hex: &str| {
        // The stamp is the first field, after the encapsulation header.
        let mut message = bytes(hex);
        message[4..12].copy_from_slice(&us.to_le_bytes());
        message
    };
    // Power-on was at T0; every message is 5 ms late, one is not.
    for k in 0..100u64 {
        let us = 1_000_000 + 4000 * k;
        let late = if k == 50 { 0 } else { 5 * ms };
        let (kind, definition, hex) = COMBINED;
        let at = T0 + us as i64 * 1000 + late;
        recorder.foreign("/imu", at, kind, definition.as_bytes(), &boot(us, hex));
    }
    // The same clock, and always 80 ms late: that must not move it.
    let (kind, definition, hex) = PX4_GPS;
    let at = T0 + 1_200 * ms + 80 * ms;
    recorder.foreign(
        "/gps",
        at,
        kind,
        definition.as_bytes(),
        &boot(1_200_000, hex),
    );
    let log = recorder.open(ReadOptions::default()).unwrap();
    let samples = samples(&log);
    // The message without delay says where the clock is, by the middle of its interval of 4 ms: 2 ms before its stamp.
    assert_eq!(samples[0].time(), Time(T0 + 1000 * ms));
    let fix = samples
        .iter()
        .find(|s| matches!(s, Sample::GnssPosition(_)));
    assert_eq!(fix.unwrap().time(), Time(T0 + 1202 * ms));
    let offset = log.statistics().unwrap()[1].header_minus_log_s.unwrap();
    assert!(
        offset.max.abs() < 1e-9 && (offset.min + 0.005).abs() < 1e-9,
        "{offset:?}"
    );

    // A receiver whose UTC is a day off the recorder's clock comes onto the recorder's; by log time if asked.
    let day = 86_400 * SECOND;
    let (samples, _) = read(NAV_PVT_ROS2, T0 + day, ReadOptions::default());
    assert_eq!(samples[0].time(), Time(T0 + day));
}

#[test]
fn gps_fix_is_position_and_velocity() {
    for message in [GPS_FIX_ROS2, GPS_FIX_OF_ROS1] {
        let (samples, _) = read(message, T0, ReadOptions::default());
        let [Sample::GnssPosition(p), Sample::GnssVelocity(v)] = samples.as_slice() else {
            panic!("{samples:?}")
        };
        assert_eq!((p.time, v.time), (Time(STAMP), Time(STAMP)));
        assert_eq!(p.position, Geodetic::from_degrees(59.0, 18.0, 30.0));
        // Bounds of 95 %: 1 m in the plane, 2 m in height, 0.1 m/s.
        let close = |a: Option<Matrix3<f64>>, b: Option<Matrix3<f64>>| {
            assert!((a.unwrap() - b.unwrap()).norm() < 1e-12)
        };
        close(p.covariance_n, diagonal(1.0, 1.0, 4.0));
        close(v.covariance_n, diagonal(0.01, 0.01, 0.01));
        assert!((v.velocity_n - Vector3::new(0.0, 2.0, -0.5)).norm() < 1e-15);
    }
}

#[test]
fn px4_is_forward_right_down_whatever_the_flag_says_and_north_east_down() {
    for message in [PX4_GPS, PX4_GPS_2021] {
        let (samples, _) = read(message, T0, ReadOptions::default());
        let [Sample::GnssPosition(p), Sample::GnssVelocity(v)] = samples.as_slice() else {
            panic!("{samples:?}")
        };
        assert!(
            p.position
                .offset_to(&Geodetic::from_degrees(59.0, 18.0, 30.0))
                .norm()
                < 1e-8
        );
        assert_eq!(p.covariance_n, diagonal(2.25, 2.25, 6.25));
        assert_eq!(v.velocity_n, Vector3::new(1.0, -2.0, 0.5));
        assert_eq!(v.covariance_n, diagonal(0.0625, 0.0625, 0.0625));
    }
    for axes in [insnav_log::ImuAxes::Flu, insnav_log::ImuAxes::Frd] {
        let options = ReadOptions {
            imu_axes: axes,
            ..ReadOptions::default()
        };
        let (samples, _) = read(COMBINED, T0, options);
        let expected = ImuSample {
            // Its clock comes onto the recorder's.
            time: Time(T0),
            angular_rate_b: Vector3::new(0.125, -0.25, 0.5),
            specific_force_b: Vector3::new(1.0, 2.0, -9.75),
        };
        assert_eq!(samples, [Sample::Imu(expected)]);
    }
}

#[test]
fn the_heading_between_two_antennas_is_taken_when_it_is_named() {
    let (samples, _) = read(REL_POS, T0, ReadOptions::default());
    assert_eq!(samples, []);
    let options = ReadOptions {
        topics: vec![(Role::Heading, "/x".into())],
        ..ReadOptions::default()
    };
    let (samples, counts) = read(REL_POS, T0, options);
    let [Sample::Heading(heading)] = samples.as_slice() else {
        panic!("{samples:?}")
    };
    assert_eq!(heading.time, Time(T0));
    assert!((heading.heading.to_degrees() - 90.0).abs() < 1e-12);
    assert!((heading.sigma.to_degrees() - 0.5).abs() < 1e-12);
    assert_eq!((counts.heading, counts.unstamped), (1, 1));
}

#[test]
fn foxglove_in_protobuf_is_a_position() {
    let expected = Sample::GnssPosition(GnssPosition {
        time: Time(STAMP),
        position: Geodetic::from_degrees(59.0, 18.0, 30.0),
        covariance_n: Some(Matrix3::new(
            9.0, 1.0, -3.0, 1.0, 4.0, -2.0, -3.0, -2.0, 16.0,
        )),
    });
    let (samples, _) = read(LOCATION_FIX, T0, ReadOptions::default());
    assert_eq!(samples, [expected]);
    // With the descriptor; and with one in which a field has another number.
    let descriptors = bytes(LOCATION_FIX_DESCRIPTORS);
    let with = |descriptors: &[u8]| {
        let mut recorder = Recorder::new();
        let message = bytes(LOCATION_FIX_PROTOBUF);
        recorder.foreign("/x", T0, LOCATION_FIX.0, descriptors, &message);
        recorder.open(ReadOptions::default()).unwrap()
    };
    assert_eq!(
        with(&descriptors)
            .require(Role::GnssPosition)
            .unwrap()
            .problem,
        None
    );
    // Field "latitude": name, number 1 (key 0x18), label.
    let name = b"\x0a\x08latitude\x18\x01";
    let at = descriptors
        .windows(name.len())
        .position(|w| w == name)
        .unwrap();
    let mut other = descriptors.clone();
    other[at + name.len() - 1] = 12;
    let error = with(&other).require(Role::GnssPosition).unwrap_err();
    assert!(
        error.to_string().contains("latitude is field 12 of type 1"),
        "{error}"
    );
    for length in 0..descriptors.len() {
        let _ = with(&descriptors[..length]).topics();
    }
}

#[test]
fn ros1_messages_read_as_their_writer_meant_them() {
    let mut recorder = Recorder::new();
    put(&mut recorder, "/imu", T0, IMU);
    put(&mut recorder, "/fix", T0, NAV_SAT_FIX);
    put(&mut recorder, "/odom", T0, ODOMETRY);
    put(&mut recorder, "/tf_static", T0, TF_OF_ROS1);
    let options = ReadOptions {
        // Against the mounting of the transforms.
        imu_mounting_rpy_deg: Some([0.0; 3]),
        ..ReadOptions::default()
    };
    let log = recorder.open(options).unwrap();
    let expected = ImuSample {
        time: Time(STAMP),
        angular_rate_b: Vector3::new(0.1, 0.2, -0.3),
        specific_force_b: Vector3::new(1.0, -2.0, -9.75),
    };
    let samples = samples(&log);
    assert_eq!(samples[0], Sample::Imu(expected));
    let Sample::GnssPosition(fix) = samples[1] else {
        panic!("{samples:?}")
    };
    assert_eq!(
        (fix.time, fix.position),
        (Time(STAMP), Geodetic::from_degrees(59.0, 18.0, 30.0))
    );
    let transforms = log.static_transforms().unwrap();
    assert_eq!(
        transforms[0].pose.translation.vector,
        Vector3::new(0.5, 0.25, -0.125)
    );
    for statistics in log.statistics().unwrap() {
        assert_eq!(statistics.undecodable, 0, "{}", statistics.topic);
    }
}

/// Every message cut off at every length: an error that names the topic, or fewer fields, but no panic.
#[test]
fn messages_that_are_cut_off_are_errors() {
    let fixed = [
        NAV_PVT_ROS2,
        NAV_PVT_OF_ROS1,
        GPS_FIX_ROS2,
        GPS_FIX_OF_ROS1,
        COMBINED,
        PX4_GPS,
        PX4_GPS_2021,
        IMU,
        NAV_SAT_FIX,
    ];
    for (message, all) in fixed
        .iter()
        .map(|m| (m, true))
        .chain([(&LOCATION_FIX, false)])
    {
        let (kind, definition, hex) = *message;
        let whole = bytes(hex);
        for length in 0..whole.len() {
            let mut recorder = Recorder::new();
            recorder.foreign("/x", T0, kind, definition.as_bytes(), &whole[..length]);
            let log = recorder.open(ReadOptions::default()).unwrap();
            let error = log.samples().unwrap().find_map(Result::err);
            // Protobuf has no fixed length: what is left may be whole fields.
            if all || error.is_some() {
                let error = error.unwrap_or_else(|| panic!("{} of {length} bytes", kind[0]));
                assert_eq!(error.code(), "bad_message");
                assert!(error.to_string().contains("/x at"), "{error}");
            }
            assert_eq!(log.statistics().unwrap()[0].count, 1);
        }
    }
}

#[test]
fn no_fix_and_absent_numbers() {
    // No fix in each message's own words.
    let fix_type = |message: Foreign, at: usize, value: u8| {
        let (kind, definition, hex) = message;
        let mut data = bytes(hex);
        data[at] = value;
        let mut recorder = Recorder::new();
        recorder.foreign("/x", T0, kind, definition.as_bytes(), &data);
        let log = recorder.open(ReadOptions::default()).unwrap();
        let mut samples = log.samples().unwrap();
        let left = samples.by_ref().count();
        (
            left,
            samples.counts().dropped_no_fix,
            samples.counts().dropped_velocity_no_fix,
        )
    };
    // Encapsulation, then i_tow 4, year 2, five times 1, valid, t_acc and nano aligned to 4.
    assert_eq!(fix_type(NAV_PVT_ROS2, 4 + 20, 0), (0, 1, 1));
    assert_eq!(fix_type(NAV_PVT_ROS2, 4 + 20, 5), (0, 1, 1));
    assert_eq!(fix_type(NAV_PVT_ROS2, 4 + 21, 0), (0, 1, 1));
    assert_eq!(fix_type(NAV_PVT_ROS2, 4 + 20, 4), (2, 0, 0));
    // Two times and an identifier, four doubles aligned to 8, two floats.
    assert_eq!(fix_type(PX4_GPS, 4 + 64, 1), (0, 1, 1));
    assert_eq!(fix_type(PX4_GPS, 4 + 64, 2), (2, 0, 0));
    let json = |text: &str| {
        let mut recorder = Recorder::new();
        recorder.foreign("/x", T0, ["", "", "json"], b"", text.as_bytes());
        let log = recorder.open(ReadOptions::default()).unwrap();
        let mut samples = log.samples().unwrap();
        let all: Vec<_> = samples.by_ref().map(Result::unwrap).collect();
        (all, samples.counts())
    };
    let (all, counts) = json(
        r#"{"timestamp": {"sec": 5, "nsec": 0}, "latitude": NaN, "longitude": 18, "altitude": 3}"#,
    );
    assert_eq!((all.len(), counts.dropped_not_finite), (0, 1));
    let (all, _) = json(
        r#"{"header": {"stamp": {"sec": 5, "nanosec": 0}, "frame_id": "a"}, "latitude": 59, "longitude": 18, "altitude": 3,
            "status": {"status": 0}, "position_covariance": [-1, 0, 0, 0, 0, 0, 0, 0, 0], "position_covariance_type": 2}"#,
    );
    assert!(
        matches!(all[0], Sample::GnssPosition(p) if p.covariance_n.is_none() && p.time == Time(5 * SECOND))
    );
    let (all, _) = json(
        r#"{"header": {"stamp": {"sec": 5, "nanosec": 0}}, "latitude": 59, "longitude": 18, "altitude": 3, "track": 0, "speed": 0,
            "climb": 0, "err_speed": 0}"#,
    );
    assert_eq!(
        all.len(),
        1,
        "a velocity that the driver never set: {all:?}"
    );
}
