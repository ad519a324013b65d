//! Clock offsets on real recordings, against what is known of them.

use insnav::clock_offset::{Search, velocity_lag};
use insnav::earth::Geodetic;
use insnav::sample::{GnssPosition, GnssVelocity, ImuSample, Sample};
use insnav::time::Time;
use nalgebra::Vector3;
use std::io::Read;
use std::path::PathBuf;

/// Samples of a recording in the common CSV, in the order of their stamps; `None`, said visibly, where it is absent.
fn recording(name: &str) -> Option<Vec<Sample>> {
    let root = std::env::var_os("INSNAV_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")),
        PathBuf::from,
    );
    let folder = root.join(name);
    if !folder.exists() {
        println!("SKIPPED: {} is absent", folder.display());
        return None;
    }
    let rows = |file: &str| {
        let mut text = String::new();
        let compressed = std::fs::File::open(folder.join(file)).expect("the recording is complete");
        flate2::read::GzDecoder::new(compressed)
            .read_to_string(&mut text)
            .expect("gzip text");
        text.lines()
            .skip(1)
            .map(|line| {
                line.split(',')
                    .map(|x| x.parse().expect("a number"))
                    .collect()
            })
            .collect::<Vec<Vec<f64>>>()
    };
    let mut samples = Vec::new();
    for r in rows("imu.csv.gz") {
        samples.push(Sample::Imu(ImuSample {
            time: Time::from_seconds(1e3 + r[0]),
            angular_rate_b: Vector3::new(r[1], r[2], r[3]),
            specific_force_b: Vector3::new(r[4], r[5], r[6]),
        }));
    }
    for r in rows("gnss.csv.gz") {
        let time = Time::from_seconds(1e3 + r[0]);
        let position = Geodetic::from_degrees(r[1], r[2], r[3]);
        samples.push(Sample::GnssPosition(GnssPosition {
            time,
            position,
            covariance_n: None,
        }));
        if r[4].is_finite() {
            let velocity_n = Vector3::new(r[4], r[5], r[6]);
            samples.push(Sample::GnssVelocity(GnssVelocity {
                time,
                velocity_n,
                covariance_n: None,
            }));
        }
    }
    samples.sort_by_key(Sample::time);
    Some(samples)
}

/// The receiver's own velocity output is 0.128 s late (found with another program, and known to be so for this receiver).
#[test]
fn velocity_lag_of_the_rtk_drive() {
    let Some(samples) = recording("rtkexp_drive_0708") else {
        return;
    };
    let found = velocity_lag(&samples, &Search::default()).expect("observable");
    println!("rtkexp_drive_0708: velocity lag {found:?}");
    assert!((found.value - 0.128).abs() < 0.02, "{found:?}");
    assert!(found.sigma < 0.005, "{found:?}");
}

/// Both halves of a recording must tell the same lag, within their sigmas: nothing outside the recording is needed for that.
#[test]
fn velocity_lag_agrees_between_halves() {
    for name in ["rtkexp_drive_0708", "hipnuc_20220504", "comma2k19_example1"] {
        let Some(samples) = recording(name) else {
            continue;
        };
        let whole = velocity_lag(&samples, &Search::default()).expect("observable");
        let (a, b) = samples.split_at(samples.len() / 2);
        let [a, b] = [a, b].map(|half| velocity_lag(half, &Search::default()).expect("observable"));
        println!("{name}: velocity lag {whole:?}, first half {a:?}, second half {b:?}");
        let sigma = a.sigma.hypot(b.sigma);
        assert!(
            (a.value - b.value).abs() < 4.0 * sigma,
            "{name}: {a:?} {b:?}"
        );
    }
}

#[test]
fn a_position_only_receiver_has_no_velocity_lag() {
    let Some(samples) = recording("kth_skog_car") else {
        return;
    };
    assert!(velocity_lag(&samples, &Search::default()).is_err());
}
