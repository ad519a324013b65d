//! Recordings with optical truth (BROAD \[Laidig21\], RepoIMU): one set of settings for all of them, noise as each shows it.

use insnav::ahrs::{AhrsEpoch, AhrsSettings, Smoother, gyro_range};
use insnav::imu::ImuNoise;
use insnav::log::csv::{read_imu, read_truth_quat};
use insnav::metrics::{OrientationErrors, OrientationPair, orientation_errors, to_enu_flu};
use insnav::noise::{IdentifyOptions, NoiseReading, identify_noise};
use insnav::sample::{ImuSample, MagneticField};
use insnav::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};

fn folders(prefix: &str) -> Vec<PathBuf> {
    let root = std::env::var("INSNAV_DATA").map_or_else(
        |_| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let Ok(entries) = std::fs::read_dir(root.join("ahrs")) else {
        println!(
            "SKIPPED: no recordings with optical truth at {}",
            root.display()
        );
        return Vec::new();
    };
    let name = |p: &Path| p.file_name().map(|n| n.to_string_lossy().into_owned());
    let mut folders: Vec<PathBuf> = entries
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| name(p).is_some_and(|n| n.starts_with(prefix)))
        .collect();
    folders.sort();
    folders
}

/// East, north, up from north, east, down, and the other way.
const ENU_NED: Matrix3<f64> = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);

struct Scores {
    causal: OrientationErrors,
    smoothed: OrientationErrors,
    saturates: bool,
}

/// White noise as the recording itself shows it; of the class where it does not.
fn own_noise(samples: &[ImuSample]) -> ImuNoise {
    let class = AhrsSettings::default().noise;
    let readings: Vec<NoiseReading> = samples
        .iter()
        .map(|s| NoiseReading {
            time: s.time,
            angular_rate_b: s.angular_rate_b,
            specific_force_b: s.specific_force_b,
            magnetic_field_b: None,
        })
        .collect();
    let options = IdentifyOptions::new(class);
    identify_noise(&readings, &options).map_or(class, |found| ImuNoise {
        gyro_white: found.tilt.gyro_white.value,
        accel_white: found.tilt.accel_white.value,
        ..class
    })
}

/// The filter and the smoother on one recording; sensor axes are forward-left-up.
fn scores(folder: &Path, change: impl Fn(&mut AhrsSettings)) -> Scores {
    let imu = read_imu(&folder.join("imu.csv.gz")).expect("a table");
    let truth = read_truth_quat(&folder.join("truth_quat.csv.gz")).expect("a table");
    assert_eq!(imu.t_s, truth.t_s);
    let frd = |v: &Vector3<f64>| Vector3::new(v.x, -v.y, -v.z);
    let time = |i: usize| Time::from_seconds(imu.t_s[i]);
    let samples: Vec<ImuSample> = (0..imu.t_s.len())
        .map(|i| ImuSample {
            time: time(i),
            angular_rate_b: frd(&imu.angular_rate[i]),
            specific_force_b: frd(&imu.specific_force[i]),
        })
        .collect();
    let range = gyro_range(&samples);
    let mut settings = AhrsSettings {
        gyro_range: range,
        noise: own_noise(&samples),
        ..AhrsSettings::default()
    };
    change(&mut settings);
    let mut smoother = Smoother::new(settings).expect("settings");
    let mut causal: Vec<(usize, AhrsEpoch)> = Vec::new();
    for (i, sample) in samples.iter().enumerate() {
        let field_b = frd(&imu.magnetic_field[i]);
        let field = MagneticField {
            time: time(i),
            field_b,
        };
        smoother.field(&field).expect("finite");
        if let Some(epoch) = smoother.step(sample).expect("sorted") {
            causal.push((i, epoch));
        }
    }
    let smoothed = smoother.finish();
    let pair = |(i, epoch): (usize, &AhrsEpoch)| -> Option<OrientationPair> {
        let scored = truth.moving.get(i).is_none_or(|m| *m);
        Some(OrientationPair {
            estimate: to_enu_flu(&epoch.attitude),
            truth: UnitQuaternion::clone(truth.orientation[i].as_ref().filter(|_| scored)?),
            covariance: Some(ENU_NED * epoch.covariance * ENU_NED.transpose()),
        })
    };
    let of = |epochs: &[&AhrsEpoch]| {
        let indices = causal.iter().map(|(i, _)| *i);
        let pairs: Vec<_> = indices
            .zip(epochs.iter().copied())
            .filter_map(pair)
            .collect();
        orientation_errors(&pairs)
    };
    Scores {
        causal: of(&causal.iter().map(|(_, e)| e).collect::<Vec<_>>()),
        smoothed: of(&smoothed.iter().collect::<Vec<_>>()),
        saturates: range.is_some(),
    }
}

/// Mean total RMSE below that of vqf 2.1.2 (2.54° causal) and below 0.85 of its offline form (2.27°), both with their defaults on
/// the same seven files; 95 % ellipsoids that hold 88 to 99 % of all errors, 70 % in every trial.
#[test]
fn broad() {
    let folders = folders("broad_");
    if folders.is_empty() {
        return;
    }
    assert_eq!(folders.len(), 7);
    let mut sums = [0.0; 4];
    println!(
        "{:<50} causal total heading incl. inside | smoothed",
        "trial"
    );
    for folder in &folders {
        let s = scores(folder, |_| ());
        assert!(!s.saturates, "{}", folder.display());
        let row = [s.causal, s.smoothed].map(|e| {
            [
                e.total_rmse_deg,
                e.heading_rmse_deg,
                e.inclination_rmse_deg,
                e.coverage_95,
            ]
            .map(|v| v.expect("scored"))
        });
        let name = folder.file_name().unwrap().to_string_lossy();
        println!("{name:<50} {:.2?} | {:.2?}", row[0], row[1]);
        for (i, r) in row.iter().enumerate() {
            sums[i] += r[0] / 7.0;
            sums[2 + i] += r[3] / 7.0;
            assert!(r[3] > 0.7, "{name}: {:.2} inside", r[3]);
        }
    }
    println!(
        "mean total {:.3}° causal, {:.3}° smoothed; inside {:.3}, {:.3}",
        sums[0], sums[1], sums[2], sums[3]
    );
    assert!(sums[0] <= 2.54 && sums[1] <= 0.85 * 2.27);
    for inside in &sums[2..] {
        assert!((0.88..=0.99).contains(inside), "{inside}");
    }
}

/// The truth of RepoIMU is turned about the vertical by an unknown constant, so that the inclination is scored. In the third trial the
/// gyros saturate at 421 °/s (vqf 2.1.2: 58.7° causal, 37.9° offline).
#[test]
fn repoimu() {
    for folder in folders("repoimu_") {
        let s = scores(&folder, |_| ());
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        let (Some(causal), Some(smoothed)) = (
            s.causal.inclination_rmse_deg,
            s.smoothed.inclination_rmse_deg,
        ) else {
            println!("{name}: no truth in it");
            continue;
        };
        println!(
            "{name}: inclination {causal:.2}° causal, {smoothed:.2}° smoothed, saturates: {}",
            s.saturates
        );
        assert_eq!(s.saturates, name.contains("Test05"));
        // Truth is levelled to 1.3° only: the mean force in its axes leans by that much.
        assert!(smoothed < 3.0 && causal < 5.0);
        if s.saturates {
            let blind = scores(&folder, |s| s.gyro_range = None)
                .causal
                .inclination_rmse_deg
                .unwrap();
            println!("{name}: {blind:.1}° if nobody knew that they saturate");
            assert!(blind > 5.0 * causal);
        }
    }
}

/// What each part of the model is worth: mean total RMSE of the seven trials without it.
#[test]
fn broad_without_each_part() {
    let folders = folders("broad_");
    if folders.is_empty() {
        return;
    }
    if !std::env::var("INSNAV_LONG").is_ok_and(|v| v == "1") {
        println!("SKIPPED: ablation on the BROAD trials: set INSNAV_LONG=1");
        return;
    }
    type Change = fn(&mut AhrsSettings);
    let parts: [(&str, Change); 7] = [
        ("all", |_| ()),
        ("delay of the magnetometer", |s| s.field.delay_sigma = 0.0),
        ("field of the body", |s| {
            s.field.offset_sigma = 0.0;
            s.field.offset_wander = 0.0;
            s.field.change_offset_sigma = 0.0;
        }),
        ("field of the surroundings", |s| {
            s.field.disturbance_sigma = 0.0;
            s.field.change_disturbance_sigma = 0.0;
        }),
        ("changes of the field", |s| s.field.change_ratio = 1e12),
        ("noise by turning", |s| s.rate_noise = 0.0),
        ("velocity about its mean", |s| s.velocity_sigma = 30.0),
    ];
    let mut all = None;
    for (name, change) in parts {
        let scores: Vec<Scores> = folders.iter().map(|f| scores(f, change)).collect();
        let mean = |of: &dyn Fn(&Scores) -> Option<f64>| {
            scores.iter().map(|s| of(s).expect("scored")).sum::<f64>() / scores.len() as f64
        };
        let total = [
            mean(&|s| s.causal.total_rmse_deg),
            mean(&|s| s.smoothed.total_rmse_deg),
        ];
        let inside = [
            mean(&|s| s.causal.coverage_95),
            mean(&|s| s.smoothed.coverage_95),
        ];
        println!("without {name:<28} total {total:.2?}°, inside {inside:.2?}");
        let [causal, smoothed] = *all.get_or_insert(total);
        assert!(
            total[0] > 0.95 * causal && total[1] > 0.95 * smoothed,
            "{name} does harm"
        );
    }
}
