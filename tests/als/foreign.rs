//! Values of another program: `tests/foreign/make_noise_values.py`, which writes every Kronecker product and double sum out.

use crate::unit::{innovations, matrix};
use insnav::noise::{
    Basis, Constraint, LinearModel, SolveOptions, Weight, als_design, als_solve, lag_covariance,
};
use nalgebra::{DMatrix, DVector};
use serde_json::Value;

/// The generator of the script: twelve uniform numbers less six.
struct Noise(u64);

impl Noise {
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

fn numbers(row: &Value, key: &str) -> Vec<f64> {
    let list = row[key]
        .as_array()
        .unwrap_or_else(|| panic!("{key} in {row}"));
    list.iter().map(|v| v.as_f64().expect("a number")).collect()
}

fn simulate(model: &LinearModel, q: &[f64], r: &[f64], count: usize, seed: u64) -> Vec<f64> {
    let mut noise = Noise(seed);
    let mut x = DVector::zeros(model.f.nrows());
    let mut y = Vec::new();
    for k in 0..count + 200 {
        if k >= 200 {
            y.extend(
                (&model.h * &x)
                    .iter()
                    .zip(r)
                    .map(|(c, r)| c + r.sqrt() * noise.next()),
            );
        }
        let w = DVector::from_iterator(q.len(), q.iter().map(|q| q.sqrt() * noise.next()));
        x = &model.f * &x + &model.g * w;
    }
    y
}

/// Six digits of what is estimated; the solution of the Riccati equation to ten.
#[test]
fn agrees_with_an_independent_implementation() {
    let text = include_str!("../foreign/noise_values.json");
    let values: Value = serde_json::from_str(text).expect("the file is JSON");
    let rows = values["als"].as_array().expect("rows");
    assert!(rows.len() >= 10);
    for row in rows {
        let (q, r) = (numbers(row, "q"), numbers(row, "r"));
        let (f, g, h) = (numbers(row, "f"), numbers(row, "g"), numbers(row, "h"));
        let n = h.len() / r.len();
        let model = LinearModel {
            f: matrix(n, n, &f),
            g: matrix(n, q.len(), &g),
            h: matrix(r.len(), n, &h),
        };
        let guess = numbers(row, "guess");
        let filter = model
            .stationary_filter(
                &(DMatrix::identity(q.len(), q.len()) * guess[0]),
                &(DMatrix::identity(r.len(), r.len()) * guess[1]),
            )
            .expect("stable");
        let gain = matrix(n, r.len(), &numbers(row, "gain"));
        assert!((&filter.gain - &gain).amax() < 1e-10, "{}", filter.gain);
        let count = |key: &str| row[key].as_u64().expect("a count");
        let y = simulate(&model, &q, &r, count("count") as usize, count("seed"));
        let lags = count("lags") as usize;
        let nu = innovations(&model, &gain, &y);
        let measured = lag_covariance(&[&nu], r.len(), lags).expect("long");
        let design =
            als_design(&model, &gain, &Basis::diagonal(q.len(), r.len()), lags).expect("stable");
        let solve = |weight| {
            let options = SolveOptions {
                weight,
                constraint: Constraint::NonNegative,
                ..Default::default()
            };
            als_solve(&design, &measured, &options).expect("identified")
        };
        let (plain, weighted) = (solve(Weight::Identity), solve(Weight::Bartlett));
        for (found, key) in [
            (&plain.theta, "identity"),
            (&weighted.theta, "bartlett"),
            (&weighted.standard_errors, "standard_errors"),
            (&vec![weighted.chi2], "chi2"),
        ] {
            let expected = if key == "chi2" {
                vec![row[key].as_f64().expect("a number")]
            } else {
                numbers(row, key)
            };
            for (a, b) in found.iter().zip(&expected) {
                assert!(
                    (a - b).abs() < 5e-7 * b.abs().max(1e-3),
                    "{} {key}: {a} {b}",
                    row["name"]
                );
            }
        }
    }
}
