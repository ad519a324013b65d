//! Which topics are taken.

use crate::recorder::{Recorder, SECOND, T0, samples};
use insnav_log::{Choice, Log, ReadOptions, Role};
use std::path::Path;

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
fn messages_that_are_not_read_are_listed_as_they_are() {
    let mut recorder = Recorder::new();
    for (topic, schema, language, encoding, text) in [
        ("/imu", "sensor_msgs/msg/Imu", "omgidl", "avro", ""),
        ("/pvt", "ublox_msgs/msg/NavPVT", "ros2idl", "cdr", "struct"),
    ] {
        let writer = &mut recorder.writer;
        let schema = writer
            .add_schema(schema, language, text.as_bytes())
            .unwrap();
        let id = writer
            .add_channel(schema, topic, encoding, &Default::default())
            .unwrap();
        recorder.channels.insert(topic.into(), id);
        recorder.raw(topic, T0, &[1, 2, 3]);
    }
    let log = recorder.open(ReadOptions::default()).unwrap();
    let error = log.require(Role::Imu).unwrap_err();
    assert_eq!(error.code(), "no_imu_topic");
    let text = error.to_string();
    assert!(
        text.contains("/imu (sensor_msgs/msg/Imu in avro, 1 messages)"),
        "{text}"
    );
    assert!(
        text.contains(
            "/pvt (ublox_msgs/msg/NavPVT in cdr, 1 messages; the definition is in \"ros2idl\""
        ),
        "{text}"
    );
    let options = ReadOptions {
        topics: vec![(Role::GnssPosition, "/pvt".into())],
        ..ReadOptions::default()
    };
    let error = Log::from_bytes(Path::new("x"), log.bytes().to_vec(), options).unwrap_err();
    assert_eq!(error.code(), "wrong_type");
    assert!(
        error
            .to_string()
            .contains("only ros2msg and ros1msg are read"),
        "{error}"
    );
}
