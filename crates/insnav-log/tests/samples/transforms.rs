//! Static transforms.

use crate::recorder::{Recorder, T0, samples};
use insnav_core::time::Time;
use insnav_log::ros2::*;
use insnav_log::{Log, LogWriter, LogWriterOptions, ReadOptions};
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
