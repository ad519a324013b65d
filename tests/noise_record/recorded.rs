//! A recorded unit at rest: least squares from a tenth of the data against the Allan deviation of all of it.

use insnav::imu::ImuGrade;
use insnav::noise::{IdentifyOptions, NoiseReading, identify_noise, rest_stability};
use insnav::time::Time;
use nalgebra::Vector3;
use std::io::{BufRead, BufReader};

fn adis() -> Option<Vec<NoiseReading>> {
    let data = std::env::var("INSNAV_DATA").unwrap_or_else(|_| "../shared/data".into());
    let path = std::path::Path::new(&data).join("adis16405_static_imu1/imu.csv.gz");
    let Ok(file) = std::fs::File::open(&path) else {
        println!("SKIPPED: no adis16405_static_imu1 in {data}");
        return None;
    };
    let lines = BufReader::new(flate2::read::GzDecoder::new(file)).lines();
    Some(
        lines
            .skip(1)
            .map(|line| {
                let line = line.expect("readable");
                let v: Vec<f64> = line
                    .split(',')
                    .map(|x| x.parse().expect("a number"))
                    .collect();
                NoiseReading {
                    time: Time::from_seconds(v[0]),
                    angular_rate_b: Vector3::new(v[1], v[2], v[3]),
                    specific_force_b: Vector3::new(v[4], v[5], v[6]),
                    magnetic_field_b: None,
                }
            })
            .collect(),
    )
}

/// The aim is 10 % of Allan's white noise from a tenth of the data. This record misses it: its accelerometers have a tone of 0.57 Hz with
/// harmonics (taken out) and flicker noise of 0.2 to 0.4 mg, which at the filter's time constant of 0.6 s looks like a random walk of the
/// angle. Coarse steps are not the reason: of 3.3 mg, less than the noise of a sample, they are white.
#[test]
fn a_tenth_of_the_data_tells_the_gyros_white_noise() {
    let Some(readings) = adis() else { return };
    let stability = rest_stability(&readings).expect("at rest");
    // Lying flat, least squares see x and y.
    let [x, y] = [0, 1].map(|k| stability.gyro[k].fit.white.value);
    let allan = (0.5 * (x * x + y * y)).sqrt();
    let per_root_hour = |x: f64| x.to_degrees() * 60.0;
    let options = IdentifyOptions::new(ImuGrade::Consumer.noise());
    let mut ratios = Vec::new();
    for part in 0..10 {
        let noise = identify_noise(&readings[part * 50_000..][..50_000], &options).expect("good");
        let gyro = &noise.tilt.gyro_white;
        println!(
            "part {part}: tones {:.3?} Hz, {:.3} ± {:.3} °/√h by least squares, {:.3} by Allan deviation, ratio {:.3}; {} of {} windows, {} samples averaged, χ²/dof {:.1}; {}",
            noise.tones_hz,
            per_root_hour(gyro.value),
            per_root_hour(gyro.standard_error),
            per_root_hour(allan),
            gyro.value / allan,
            noise.windows.iter().filter(|w| w.accepted).count(),
            noise.windows.len(),
            noise.averaged,
            noise.tilt.chi2 / noise.tilt.dof as f64,
            gyro.reason,
        );
        assert!(
            noise.tones_hz.iter().any(|f| (f - 0.565).abs() < 0.015),
            "{:?}",
            noise.tones_hz
        );
        // What it is, never below: see above for the rest.
        let ratio = gyro.value / allan;
        assert!(
            gyro.accepted && (0.95..1.25).contains(&ratio),
            "{ratio} {gyro:?}"
        );
        ratios.push(ratio);
    }
    ratios.sort_by(f64::total_cmp);
    println!("median ratio {:.3}", ratios[ratios.len() / 2]);
}
