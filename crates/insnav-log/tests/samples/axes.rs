//! Axes and mounting of the IMU.

use crate::recorder::{Recorder, T0, samples};
use crate::recordings::recording;
use insnav_core::sample::Sample;
use insnav_log::{ImuAxes, Log, ReadOptions, csv};
use nalgebra::Vector3;

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
    let options = ReadOptions {
        imu_mounting_rpy_deg: Some([90.0, 0.0, -90.0]),
        ..ReadOptions::default()
    };
    let samples = samples(&Log::open(&bag, options).unwrap());
    let imu: Vec<_> = samples
        .iter()
        .filter_map(|sample| match sample {
            Sample::Imu(sample) => Some(sample),
            _ => None,
        })
        .collect();
    assert_eq!((imu.len(), table.t_s.len()), (11865, 11865));
    for (i, sample) in imu.iter().enumerate() {
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
