//! Order and stamps of samples, and numbers that are none.

use crate::recorder::{Recorder, SECOND, T0, samples, times};
use insnav_core::time::Time;
use insnav_log::ros2::*;
use insnav_log::{Log, ReadOptions, TimeSource};
use nalgebra::Vector3;
use std::path::Path;

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
