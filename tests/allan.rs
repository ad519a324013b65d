//! Allan deviation: against allantools, against noise of known size, and of a recorded unit.

use insnav::noise::{AllanFit, AllanTerm, averaging_samples, fit_allan, overlapping_allan};
use insnav::sim::{Source, Stream};
use serde_json::Value;
use std::io::Read;

fn long() -> bool {
    std::env::var("INSNAV_LONG").is_ok_and(|v| v == "1")
}

/// The generator of `tests/foreign/make_noise_values.py`: twelve uniform numbers less six.
struct Twelve(u64);

impl Twelve {
    fn next(&mut self) -> f64 {
        let mut total = 0.0;
        for _ in 0..12 {
            self.0 = self
                .0
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            total += (self.0 >> 11) as f64 / (1u64 << 53) as f64;
        }
        total - 6.0
    }
}

#[test]
fn agrees_with_allantools() {
    let text = include_str!("foreign/noise_values.json");
    let values: Value = serde_json::from_str(text).expect("the file is JSON");
    let rows = values["allan"].as_array().expect("rows");
    assert_eq!(rows.len(), 3);
    for row in rows {
        let number = |key: &str| row[key].as_f64().expect("a number");
        let mut noise = Twelve(row["seed"].as_u64().expect("a seed"));
        let mut level = 0.0;
        let record: Vec<f64> = (0..number("count") as usize)
            .map(|_| {
                level += number("walk") * noise.next();
                level + noise.next()
            })
            .collect();
        let list = |key: &str| -> Vec<f64> {
            let list = row[key].as_array().expect("a list");
            list.iter().map(|v| v.as_f64().expect("a number")).collect()
        };
        let averaged: Vec<usize> = list("averaged").iter().map(|m| *m as usize).collect();
        assert!(averaged.len() >= 8);
        let points = overlapping_allan(&record, 1.0 / number("rate"), &averaged).expect("long");
        for (point, expected) in points.iter().zip(list("deviation")) {
            let error = point.deviation / expected - 1.0;
            assert!(error.abs() < 1e-9, "m = {}: {error:e}", point.samples);
        }
    }
}

/// A record with N, B, K at `step` seconds: flicker noise by fractional integration of half an order ([Kasdin95]).
fn simulate(n: f64, b: f64, k: f64, step: f64, count: usize, seed: u64) -> Vec<f64> {
    let mut white = Source::new(seed, Stream::GyroWhite);
    let mut walk = Source::new(seed, Stream::GyroBias);
    let mut pink = Source::new(seed, Stream::AccelBias);
    let mut weights = vec![1.0; count];
    for i in 1..count {
        weights[i] = weights[i - 1] * (i as f64 - 0.5) / i as f64;
    }
    let noise: Vec<f64> = (0..count).map(|_| b * pink.normal()).collect();
    let mut level = 0.0;
    (0..count)
        .map(|i| {
            let flicker: f64 = if b > 0.0 {
                weights[..=i]
                    .iter()
                    .zip(noise[..=i].iter().rev())
                    .map(|(w, v)| w * v)
                    .sum()
            } else {
                0.0
            };
            level += k * step.sqrt() * walk.normal();
            n / step.sqrt() * white.normal() + flicker + level
        })
        .collect()
}

fn fit(record: &[f64], step: f64) -> AllanFit {
    let averaged = averaging_samples(record.len(), 4);
    let points = overlapping_allan(record, step, &averaged).expect("long");
    fit_allan(&points).expect("a fit")
}

/// z of a coefficient; of one that is not seen, the truth by its upper limit.
fn sigmas(term: AllanTerm, truth: f64) -> f64 {
    (term.value - truth) / term.standard_error
}

#[test]
fn coefficients_of_simulated_noise_are_found() {
    let runs = if long() { 100 } else { 12 };
    // Sampled flicker noise has a fifth of B² too much white noise in it, which must be little against N²/step. A random walk
    // is seen from hardly more independent pieces than the record is long by the time at which it takes over: half an hour.
    for (n, b, k, step) in [
        (1e-3, 0.0, 0.0, 0.01),
        (1e-3, 1e-3, 0.0, 0.01),
        (1e-3, 0.0, 1e-3, 0.1),
        (1e-3, 5e-4, 1e-4, 0.1),
    ] {
        let mut z = [vec![], vec![], vec![]];
        let mut chi2 = vec![];
        for seed in 0..runs {
            let fit = fit(&simulate(n, b, k, step, 18_000, seed), step);
            chi2.push(fit.chi2 / fit.dof as f64);
            for (list, (term, truth)) in
                z.iter_mut()
                    .zip([(fit.white, n), (fit.flicker, b), (fit.random_walk, k)])
            {
                if truth > 0.0 {
                    list.push(sigmas(term, truth));
                } else {
                    // What is not there is not found beyond chance: its square has the error of that of the limit.
                    assert!(
                        term.value <= 3.0 * term.standard_error
                            || term.value < 3.0 * (2.0 * term.value * term.standard_error).sqrt(),
                        "{term:?}"
                    );
                }
            }
        }
        let mean_chi2 = chi2.iter().sum::<f64>() / chi2.len() as f64;
        print!("N {n} B {b} K {k}: chi2/dof {mean_chi2:.2}");
        for list in z.iter().filter(|l| !l.is_empty()) {
            let mean = list.iter().sum::<f64>() / list.len() as f64;
            let rms = (list.iter().map(|v| v * v).sum::<f64>() / list.len() as f64).sqrt();
            let worst = list.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let outside = list.iter().filter(|v| v.abs() > 3.0).count();
            print!(", z mean {mean:.2} rms {rms:.2} worst {worst:.1}");
            // Within three stated sigmas; of a hundred runs one or two may be beyond by chance and the skewness of χ².
            assert!(outside * 50 <= list.len(), "{outside} of {}", list.len());
            assert!((0.5..1.5).contains(&rms), "{rms}");
        }
        println!();
    }
}

/// The chance that the interval at two sigmas holds the true deviation is 95 %.
#[test]
fn confidence_intervals_hold() {
    let (n, k, step) = (1e-3, 1e-3, 0.01);
    let (mut inside, mut all) = (0, 0);
    for seed in 0..if long() { 400 } else { 60 } {
        let record = simulate(n, 0.0, k, step, 4000, seed);
        let fit = fit(&record, step);
        for point in overlapping_allan(&record, step, &[1, 10, 100, 400]).expect("long") {
            let (low, high) = point.interval(&fit, 2.0);
            let truth = (n * n / point.tau_s + k * k * point.tau_s / 3.0).sqrt();
            inside += u32::from((low..high).contains(&truth));
            all += 1;
        }
    }
    let share = f64::from(inside) / f64::from(all);
    println!("{share:.3} of {all} intervals");
    assert!((0.9..0.99).contains(&share), "{share}");
}

/// ADIS16405 at rest, a record of others: what its Allan curve is known to be.
#[test]
fn recorded_unit_has_its_known_deviations() {
    let data = std::env::var("INSNAV_DATA").unwrap_or_else(|_| "../shared/data".into());
    let path = std::path::Path::new(&data).join("adis16405_static_imu1/counts.npz");
    if !path.exists() {
        println!(
            "SKIPPED: recorded_unit_has_its_known_deviations: no adis16405_static_imu1 in {data}"
        );
        return;
    }
    // A zip archive whose first member is an array of 16-bit counts, six columns one after the other.
    let archive = std::fs::read(&path).expect("it exists");
    let length =
        |bytes: &[u8], at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let begin = 30 + length(&archive, 26) + length(&archive, 28);
    let mut array = Vec::new();
    flate2::read::DeflateDecoder::new(&archive[begin..])
        .read_to_end(&mut array)
        .expect("deflated");
    let values = &array[10 + length(&array, 8)..];
    let samples = values.len() / 12;
    assert_eq!(samples, 1_000_000);
    let gyro: Vec<Vec<f64>> = values
        .chunks_exact(2 * samples)
        .take(3)
        .map(|column| {
            let counts = column
                .chunks_exact(2)
                .map(|c| i16::from_le_bytes([c[0], c[1]]));
            counts.map(|c| (f64::from(c) * 0.05).to_radians()).collect()
        })
        .collect();
    let per_hour = |rate: f64| rate.to_degrees() * 3600.0;
    // Known to a degree an hour at 1 s, and at 100 s between 24 and 30.
    for (axis, (record, expected)) in gyro.iter().zip([147.0, 155.0, 140.0]).enumerate() {
        let points = overlapping_allan(record, 0.01, &[100, 10_000]).expect("long");
        let [second, hundred] = [0, 1].map(|i| per_hour(points[i].deviation));
        let fit = fit(record, 0.01);
        println!(
            "axis {axis}: {second:.1} deg/h at 1 s, {hundred:.1} at 100 s; N {:.3} +- {:.3} deg/sqrt(h), B {:.1} +- {:.1} deg/h, K {:.0} +- {:.0} deg/h/sqrt(h), chi2 {:.0} of {} from {} s",
            per_hour(fit.white.value) / 60.0,
            per_hour(fit.white.standard_error) / 60.0,
            per_hour(fit.flicker.value),
            per_hour(fit.flicker.standard_error),
            per_hour(fit.random_walk.value) * 60.0,
            per_hour(fit.random_walk.standard_error) * 60.0,
            fit.chi2,
            fit.dof,
            fit.from_tau_s
        );
        assert!((second - expected).abs() < 1.0, "{second}");
        assert!((23.5..30.5).contains(&hundred), "{hundred}");
    }
}
