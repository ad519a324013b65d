//! The noise floor of real units, beside what is known of them.

use insnav::imu::ImuGrade;
use insnav::noise_floor::{NoiseFloor, NoiseMeter};
use insnav::sample::{ImuSample, Sample};
use insnav::time::Time;
use nalgebra::Vector3;
use std::io::Read;
use std::path::PathBuf;

/// The noise floor of a recording in the common CSV; `None`, said visibly, where it is absent.
fn floor_of(name: &str) -> Option<NoiseFloor> {
    let root = std::env::var_os("INSNAV_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")),
        PathBuf::from,
    );
    let file = root.join(name).join("imu.csv.gz");
    if !file.exists() {
        println!("SKIPPED: {} is absent", file.display());
        return None;
    }
    let mut text = String::new();
    let compressed = std::fs::File::open(file).expect("readable");
    flate2::read::GzDecoder::new(compressed)
        .read_to_string(&mut text)
        .expect("gzip text");
    let mut meter = NoiseMeter::default();
    for line in text.lines().skip(1) {
        let r: Vec<f64> = line
            .split(',')
            .map(|x| x.parse().expect("a number"))
            .collect();
        meter.push(&Sample::Imu(ImuSample {
            time: Time::from_seconds(1e3 + r[0]),
            angular_rate_b: Vector3::new(r[1], r[2], r[3]),
            specific_force_b: Vector3::new(r[4], r[5], r[6]),
        }));
    }
    let floor = meter.floor().expect("long enough");
    let deg = |v: Vector3<f64>, unit: f64| {
        let v = v.map(|x| x.to_degrees() * unit);
        format!("{:8.3} {:8.3} {:8.3}", v.x, v.y, v.z)
    };
    println!(
        "{name:24} {:6.1} Hz  gyro {} °/√h  accelerometer {:6.3} {:6.3} {:6.3} m/s/√h  mean rate {} °/h  |f| {:.3}  steps {:.2e} rad/s {:.2e} m/s²  → {}",
        floor.rate,
        deg(floor.gyro_white, 60.0),
        floor.accel_white.x * 60.0,
        floor.accel_white.y * 60.0,
        floor.accel_white.z * 60.0,
        deg(floor.gyro_mean, 3600.0),
        floor.force,
        floor.gyro_step.amax(),
        floor.accel_step.amax(),
        floor.grade().name()
    );
    Some(floor)
}

/// Its Allan deviation at 1 s, as stated with the recording, is 147, 155 and 140 °/h: angle random walk of 2.45, 2.58 and
/// 2.33 °/√h. Its counts are 0.05 °/s and 3.33 mg.
#[test]
fn a_static_unit_shows_the_random_walk_of_its_allan_deviation() {
    let Some(floor) = floor_of("adis16405_static_imu1") else {
        return;
    };
    for (found, stated) in floor.gyro_white.iter().zip([147.0, 155.0, 140.0]) {
        let stated = f64::to_radians(stated / 3600.0);
        // The unit's own low-pass filter takes some of the noise between samples of 10 ms.
        assert!((0.8..1.2).contains(&(found / stated)), "{found} {stated}");
    }
    // 0.05 °/s is a seventh of the noise of a sample: too fine to matter.
    assert_eq!(floor.gyro_step, Vector3::zeros());
    let count = 3.33e-3 * insnav::imu::STANDARD_GRAVITY;
    assert!(
        floor
            .accel_step
            .iter()
            .all(|s| (s - count).abs() < 1e-3 * count),
        "{floor:?}"
    );
}

/// All of these are MEMS: none may be taken for better than it is.
#[test]
fn cheap_units_are_not_taken_for_good_ones() {
    for name in [
        "rtkexp_drive_0708",
        "hipnuc_20220504",
        "kth_skog_car",
        "comma2k19_example1",
        "husky_rl_test1",
        "vn100_static_12min",
        "openshoe_2",
        "openshoe_30",
        "openshoe_31",
    ] {
        let Some(floor) = floor_of(name) else {
            continue;
        };
        assert!(floor.grade() <= ImuGrade::Automotive, "{name}: {floor:?}");
    }
}
