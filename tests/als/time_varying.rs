//! Models and gains that change from step to step.

use crate::unit::{matrix, mean_and_deviation, seeds};
use insnav::noise::{
    Basis, Constraint, LinearModel, SolveOptions, Step, Weight, als_design, als_estimate_ltv,
    als_solve, lag_covariance,
};
use insnav::sim::{Source, Stream};
use nalgebra::{DMatrix, DVector};

const Q: [f64; 2] = [0.04, 0.0004];
const R: f64 = 0.5;

/// A transition that turns and a measurement that sees now this and now that state; the gain of the real Kalman filter for a
/// noise that is wrong by `factor`.
fn steps(count: usize, factor: f64) -> Vec<Step> {
    let mut p = DMatrix::identity(2, 2);
    (0..count)
        .map(|k| {
            let t = k as f64;
            let turn = 0.3 * (0.01 * t).sin();
            let f = matrix(2, 2, &[0.98, -turn, turn, 0.95]);
            let h = matrix(1, 2, &[1.0, (0.05 * t).cos()]);
            let g = DMatrix::identity(2, 2) * (1.0 + 0.5 * (0.003 * t).sin());
            let s = (&h * &p * h.transpose())[0] + R;
            let gain = &p * h.transpose() / s;
            let updated = &p - &gain * &h * &p;
            p = &f * updated * f.transpose()
                + &g * matrix(2, 2, &[factor * Q[0], 0.0, 0.0, factor * Q[1]]) * g.transpose();
            Step { h, gain, f, g }
        })
        .collect()
}

/// Innovations of a simulation that begins with an error of zero.
fn innovations(steps: &[Step], seed: u64) -> Vec<f64> {
    let mut process = Source::new(seed, Stream::GyroWhite);
    let mut measurement = Source::new(seed, Stream::AccelWhite);
    let mut error = DVector::zeros(2);
    steps
        .iter()
        .map(|step| {
            let nu = (&step.h * &error)[0] + R.sqrt() * measurement.normal();
            let w = DVector::from_vec(Q.iter().map(|q| q.sqrt() * process.normal()).collect());
            error = &step.f * (&error - &step.gain * nu) + &step.g * w;
            nu
        })
        .collect()
}

/// A constant model is the stationary case, but for the begin.
#[test]
fn constant_model_gives_the_stationary_design() {
    let model = LinearModel {
        f: matrix(2, 2, &[0.9, 0.3, -0.2, 0.8]),
        g: DMatrix::identity(2, 2),
        h: matrix(1, 2, &[1.0, 0.5]),
    };
    let filter = model
        .stationary_filter(
            &matrix(2, 2, &[0.1, 0.0, 0.0, 0.1]),
            &DMatrix::identity(1, 1),
        )
        .expect("stable");
    let steps: Vec<Step> = (0..4000)
        .map(|_| Step {
            h: model.h.clone(),
            gain: filter.gain.clone(),
            f: model.f.clone(),
            g: model.g.clone(),
        })
        .collect();
    let nu = innovations(&steps, 1);
    let basis = Basis::diagonal(2, 1);
    let options = SolveOptions {
        weight: Weight::Identity,
        constraint: Constraint::None,
        ..Default::default()
    };
    let zero = DMatrix::zeros(2, 2);
    let varying = als_estimate_ltv(&steps, &nu, &zero, &basis, 10, &options).expect("found");
    let design = als_design(&model, &filter.gain, &basis, 10).expect("stable");
    let measured = lag_covariance(&[&nu], 1, 10).expect("long");
    let constant = als_solve(&design, &measured, &options).expect("found");
    for (a, b) in varying.theta.iter().zip(&constant.theta) {
        // A transient of some ten steps in four thousand.
        assert!((a - b).abs() < 0.01 * R, "{a} {b}");
    }
}

/// The same unknowns from a filter that never is stationary; with the average of its model taken for constant they are not.
#[test]
fn noise_of_a_changing_model_is_found() {
    let basis = Basis::diagonal(2, 1);
    let (mut q, mut r, mut z) = (vec![], vec![], vec![]);
    let runs = seeds(6, 40);
    for seed in 0..runs {
        let steps = steps(4000, 10.0);
        let nu = innovations(&steps, seed);
        let options = SolveOptions {
            known: vec![None, Some(Q[1]), None],
            ..Default::default()
        };
        // The simulation's first error is zero.
        let found = als_estimate_ltv(&steps, &nu, &DMatrix::zeros(2, 2), &basis, 20, &options)
            .expect("found");
        q.push(found.theta[0]);
        r.push(found.theta[2]);
        z.push((found.theta[0] - Q[0]) / found.standard_errors[0]);
        assert!(found.fits(), "{} of {}", found.chi2, found.dof);
    }
    let ((mq, sq), (mr, sr)) = (mean_and_deviation(&q), mean_and_deviation(&r));
    println!(
        "q {mq:.4} +- {sq:.4} ({}), r {mr:.4} +- {sr:.4} ({R}), z {:?}",
        Q[0],
        mean_and_deviation(&z)
    );
    let few = 4.0 / (runs as f64).sqrt();
    assert!((mq - Q[0]).abs() < few * sq && (mr - R).abs() < few * sr);
    // What four thousand samples allow: of r, were it alone, 2 %.
    assert!(sq < 0.3 * Q[0] && sr < 0.1 * R);
    // Standard errors are nearly right, though the weight is that of an average.
    assert!((0.5..2.0).contains(&mean_and_deviation(&z).1) || runs < 10);
}
