//! The level rates that a stop shows, their sigmas, and whether its halves agree.

use super::free_run::FreeRun;
use super::place::Place;
use super::standing::{Standing, Taper, derivative_row, once_summed, twice_summed};
use super::sway::{PERIODS, Spectrum};
use crate::imu::ImuNoise;
use nalgebra::{Matrix3, Vector3};
use std::vec::Vec;

/// Rates that a free run has not accounted for, n, rad/s, and their standard deviations by the unit's noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rates {
    pub(super) rate_n: Vector3<f64>,
    pub(super) sigma: Vector3<f64>,
}

/// Rates over nodes `from..=to` of a stop (counted from its begin), with tilt and velocity at the begin free.
///
/// A residual rate δ about north bends the east velocity by g δ, one about east the north velocity by −g δ (\[Lobusov14\], the
/// Schuler branch of eq. (3)); about Down it is the slope of the yaw.
pub(super) fn rates(
    standing: &Standing,
    run: &FreeRun,
    place: &Place,
    noise: &ImuNoise,
    taper: Taper,
    (from, to): (usize, usize),
) -> Rates {
    let begin = standing.t[from];
    let t: Vec<f64> = standing.t[from..=to].iter().map(|t| t - begin).collect();
    let weights = taper.weights(&t);
    let bend = derivative_row::<3>(&t, &weights);
    let slope = derivative_row::<2>(&t, &weights);
    let first = run.at(standing.span.begin) + from;
    let (mut bent, mut yaw) = (Vector3::zeros(), 0.0);
    for (i, (b, s)) in bend.iter().zip(&slope).enumerate() {
        bent += run.velocity_n[first + i] * *b;
        yaw += standing.rocking[from + i].z * s;
    }
    // What each node's noise does: rate noise through tilt to velocity, force noise to velocity, drifting accelerometers likewise.
    let (twice, once, yaw_once) = (
        twice_summed(&t, &bend),
        once_summed(&bend),
        once_summed(&slope),
    );
    let gyro = noise.gyro_white.powi(2);
    let accel = noise.accel_white.powi(2) / place.gravity.powi(2);
    let drift = 2.0 * noise.accel_bias_sigma.powi(2) / noise.accel_bias_tau / place.gravity.powi(2);
    let (mut horizontal, mut vertical) = (0.0, 0.0);
    for (i, pair) in t.windows(2).enumerate() {
        let dt = pair[1] - pair[0];
        horizontal += dt * (twice[i].powi(2) * (gyro + drift) + once[i].powi(2) * accel);
        vertical += dt * yaw_once[i].powi(2) * gyro;
    }
    Rates {
        rate_n: Vector3::new(bent.y / place.gravity, -bent.x / place.gravity, yaw),
        sigma: Vector3::new(horizontal.sqrt(), horizontal.sqrt(), vertical.sqrt()),
    }
}

/// How much of a step of the rate at each node the rate of a fit takes: horizontal and vertical, with the node's length.
fn reach(t: &[f64], taper: Taper) -> Vec<([f64; 2], f64)> {
    let weights = taper.weights(t);
    let twice = twice_summed(t, &derivative_row::<3>(t, &weights));
    let once = once_summed(&derivative_row::<2>(t, &weights));
    let mut sums = [0.0; 2];
    let mut out: Vec<([f64; 2], f64)> = (0..t.len() - 1)
        .rev()
        .map(|k| {
            let dt = t[k + 1] - t[k];
            sums[0] += twice[k] * dt;
            sums[1] += once[k] * dt;
            (sums, dt)
        })
        .collect();
    out.reverse();
    out
}

/// Difference between the rates of the two halves of a stop, in its sigmas; `rocking`: the spectrum of the
/// fit's residuals, when the base rocks.
pub(super) fn disagreement(
    standing: &Standing,
    run: &FreeRun,
    place: &Place,
    noise: &ImuNoise,
    taper: Taper,
    rocking: Option<&Spectrum>,
) -> Vector3<f64> {
    let (middle, end) = (standing.t.len() / 2, standing.t.len() - 1);
    let first = rates(standing, run, place, noise, taper, (0, middle));
    let second = rates(standing, run, place, noise, taper, (middle, end));
    let difference = first.rate_n - second.rate_n;
    let mut variance =
        first.sigma.component_mul(&first.sigma) + second.sigma.component_mul(&second.sigma);
    let drift = 2.0 * noise.gyro_bias_sigma.powi(2) / noise.gyro_bias_tau;
    for (from, to, whole) in [(0, middle, 1.0), (middle, end, 0.0)] {
        let t: Vec<f64> = standing.t[from..=to]
            .iter()
            .map(|x| x - standing.t[from])
            .collect();
        // A gyro that wanders in the first half is another one in the whole second half.
        for ([horizontal, vertical], dt) in reach(&t, taper) {
            let step = [whole - horizontal, whole - vertical].map(|s: f64| s * s * drift * dt);
            variance += Vector3::new(step[0], step[0], step[1]);
        }
        // Rocking leaks into the halves, whose tapers hold half as many of its periods, more than into the whole.
        if let Some(spectrum) = rocking {
            variance += leak(standing, spectrum, place, taper, (from, to));
        }
    }
    difference.component_div(&variance.map(f64::sqrt))
}

/// Variances that rocking of [`PERIODS`] periods per stop and more leaves in the rates over nodes `from..=to` of a stop.
pub(super) fn leak(
    standing: &Standing,
    spectrum: &Spectrum,
    place: &Place,
    taper: Taper,
    (from, to): (usize, usize),
) -> Vector3<f64> {
    let begin = standing.t[from];
    let t: Vec<f64> = standing.t[from..=to].iter().map(|t| t - begin).collect();
    let weights = taper.weights(&t);
    let bend = derivative_row::<3>(&t, &weights);
    let slope = derivative_row::<2>(&t, &weights);
    let mut gains = std::vec![Matrix3::zeros(); standing.t.len()];
    for ((gain, b), s) in gains[from..=to].iter_mut().zip(&bend).zip(&slope) {
        gain[(0, 1)] = b / place.gravity;
        gain[(1, 0)] = -b / place.gravity;
        gain[(2, 2)] = *s;
    }
    spectrum.through(&gains, PERIODS).diagonal()
}

/// Standard deviation (rad/s) of a level rate by one stop of `length` s, tilt and velocity free: the Cramér–Rao limit
/// σ² = (N²/T)/(1 − tanh u/u), u = T/2λ, λ = N_v/(g N).
pub fn rate_limit(noise: &ImuNoise, gravity: f64, length: f64) -> f64 {
    let lambda = noise.accel_white / (gravity * noise.gyro_white);
    let u = 0.5 * length / lambda;
    // 1 − tanh u/u → u²/3 for small u.
    let share = if u < 1e-3 {
        u * u / 3.0
    } else {
        1.0 - u.tanh() / u
    };
    noise.gyro_white / (length * share).sqrt()
}
