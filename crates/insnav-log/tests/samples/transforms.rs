//! Static transforms.

use crate::recorder::{Recorder, T0, samples};
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use insnav_log::ros2::*;
use insnav_log::{ImuAxes, Log, LogWriter, LogWriterOptions, ReadOptions};
use nalgebra::Vector3;

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
fn the_mounting_comes_from_static_transforms_unless_it_is_given() {
    let log = |options: ReadOptions| {
        let mut recorder = Recorder::new();
        recorder.imu("/imu", T0, T0);
        // The quaternion of roll 90, yaw -90.
        let transform = TransformStamped {
            header: Header {
                stamp: Time(T0),
                frame_id: "base_link",
            },
            child_frame_id: "imu",
            translation: Vector3::new(0.5, 0.0, 0.0),
            rotation: [0.5, -0.5, -0.5, 0.5],
        };
        recorder.put(
            "/tf_static",
            T0,
            &TfMessage {
                transforms: &[transform],
            },
        );
        recorder.open(options).unwrap()
    };
    let angles = Some([90.0, 0.0, -90.0]);
    let by_transforms = log(ReadOptions::default());
    let mounting = by_transforms.mounting().unwrap().unwrap();
    assert_eq!(
        (mounting.base_frame.as_str(), mounting.imu_frame.as_str()),
        ("base_link", "imu")
    );
    let given = log(ReadOptions {
        imu_mounting_rpy_deg: angles,
        ..ReadOptions::default()
    });
    assert_eq!(given.mounting().unwrap(), None);
    let vectors = |log: &Log| match samples(log)[0] {
        Sample::Imu(s) => (s.angular_rate_b, s.specific_force_b),
        other => panic!("{other:?}"),
    };
    let (a, b) = (vectors(&by_transforms), vectors(&given));
    assert!(
        (a.0 - b.0).norm() < 1e-14 && (a.1 - b.1).norm() < 1e-14,
        "{a:?} {b:?}"
    );
    let not = log(ReadOptions {
        imu_mounting_rpy_deg: Some([0.0; 3]),
        ..ReadOptions::default()
    });
    assert!((vectors(&not).1 - b.1).norm() > 1.0);
    // Messages said to be forward-right-down are not turned by transforms of forward-left-up frames.
    let frd = log(ReadOptions {
        imu_axes: ImuAxes::Frd,
        ..ReadOptions::default()
    });
    assert_eq!(frd.mounting().unwrap(), None);
}
