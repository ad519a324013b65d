//! How late a receiver's velocity is against its own position, from GNSS alone.

use super::gnss_track::{Path, Track, median_interval};
use super::{ClockOffset, Search, median};
use crate::error::{Error, Result};
use crate::sample::Sample;

/// Time over which displacements are compared, s, and at least two position intervals.
///
/// Short spans drown in position noise, long ones in the drift of the integrated velocity. On three real receivers (4 and
/// 10 Hz, RTK, differential and stand-alone) the estimate moves by less than its sigma between 0.5 and 4 s.
const BASELINE: f64 = 1.0;
/// The lags that the variance of the score takes in (Bartlett window, \[NeweyWest87\]), s: coloured noise correlates spans.
const CORRELATION_SPAN: f64 = 6.0;
/// [Huber64]: 95 % efficient on normal noise.
const HUBER: f64 = 1.345;
/// Fewest spans that allow a sigma.
const MIN_SPANS: usize = 40;
/// Most spans looked at while searching coarsely.
const COARSE_SPANS: usize = 2000;

/// Lag of GNSS velocity, s: a velocity stamped t + lag is valid when a position stamped t is. Positive: velocity is late.
///
/// Least squares over τ (Huber loss, Gauss–Newton from a coarse grid) on p(t₂) − p(t₁) = ∫ v(t + τ) dt for all spans of
/// about a second, North and East; a constant velocity error is taken out. v is interpolated by cubics, and the sigma is
/// that of the score's autocovariance over its slope, so it holds for coloured noise too.
///
/// Height takes no part: receivers smooth it differently (0.30 s against 0.13 s on one of the real logs). Velocities of
/// exactly zero count as missing, since some receivers clamp when slow.
///
/// # Errors
/// [`Error::NotObservable`] without both kinds of fix, or when speed and course change too little to tell.
pub fn estimate(samples: &[Sample], search: &Search) -> Result<ClockOffset> {
    let Some(zero) = samples
        .iter()
        .find(|s| matches!(s, Sample::GnssVelocity(_)))
        .map(Sample::time)
    else {
        return Err(not_observable("the log has no GNSS velocity"));
    };
    let path = Path::new(samples, zero);
    let track = Track::new(samples, zero);
    let spans = spans(&path, &track, search.range);
    if spans.len() < MIN_SPANS {
        return Err(not_observable(
            "too few stretches with both position and velocity, without gaps",
        ));
    }

    let stride = spans.len().div_ceil(COARSE_SPANS);
    let some: Vec<Span> = spans.iter().copied().step_by(stride).collect();
    let steps = (search.range / 0.1).ceil().max(1.0) as i32;
    let cost = |k: i32| {
        Fit::new(
            &track,
            &some,
            search.range * f64::from(k) / f64::from(steps),
        )
        .log_spread()
    };
    let best = (-steps..=steps)
        .map(|k| (cost(k), k))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(0, |b| b.1);

    let mut lag = search.range * f64::from(best) / f64::from(steps);
    for _ in 0..20 {
        let fit = Fit::new(&track, &spans, lag);
        let step = (fit.score.iter().sum::<f64>() / fit.information).clamp(-0.1, 0.1);
        lag += step;
        if lag.abs() > search.range {
            return Err(not_observable(
                "the best lag lies outside the searched range",
            ));
        }
        if step.is_nan() || step.abs() <= 1e-7 {
            break;
        }
    }

    let fit = Fit::new(&track, &spans, lag);
    // Noise of the velocities inflates `information`, and adds to the slope of the score a ripple of one interval's period
    // (interpolated noise is smaller between the fixes). Across a whole interval both average out; the slope on the spot
    // says how far the ripple lets the estimate slide. The smaller of the two is claimed.
    let slope_across = |h: f64| {
        (fit.score_at(&track, &spans, lag - h) - fit.score_at(&track, &spans, lag + h)) / (2.0 * h)
    };
    let slope = slope_across(0.5 * track.interval).min(slope_across(0.1 * track.interval));
    if slope.is_nan() || slope <= 0.25 * fit.information {
        return Err(not_observable(
            "speed and course change too little against the noise",
        ));
    }
    // What Huber's loss clips does not bend: [Huber64], variance E ψ² / (E ψ')².
    let sigma =
        long_run_variance(&fit.score, &spans).sqrt() / (slope * fit.unclipped / fit.information);
    if sigma.is_nan() || sigma >= search.uniform_sigma() {
        return Err(not_observable(
            "speed and course change too little against the noise",
        ));
    }
    Ok(ClockOffset {
        value: lag,
        sigma,
        stretches: spans.len(),
    })
}

fn not_observable(reason: &'static str) -> Error {
    Error::NotObservable {
        what: "the lag of GNSS velocity",
        reason,
    }
}

/// A displacement between two position fixes.
#[derive(Clone, Copy)]
struct Span {
    from: f64,
    to: f64,
    moved: [f64; 2],
}

fn spans(path: &Path, track: &Track, range: f64) -> Vec<Span> {
    let baseline = BASELINE.max(2.0 * path.interval);
    // Half an interval more than the range: the slope of the score is taken across one.
    let margin = range + 0.5 * track.interval;
    let mut out = Vec::new();
    let mut j = 0;
    for i in 0..path.t.len() {
        // A millisecond of grace, so that jitter of stamps does not lengthen the span by an interval.
        while j < path.t.len() && path.t[j] - path.t[i] < baseline - 1e-3 {
            j += 1;
        }
        if j == path.t.len() {
            break;
        }
        let (from, to) = (path.t[i], path.t[j]);
        if to - from < 1.5 * baseline + path.interval && track.covers(from - margin, to + margin) {
            let moved = path.p[j] - path.p[i];
            out.push(Span {
                from,
                to,
                moved: [moved.x, moved.y],
            });
        }
    }
    out
}

/// The linearised problem at one lag.
struct Fit {
    /// Constant velocity error and robust spread of the residuals, per component.
    bias: [f64; 2],
    spread: [f64; 2],
    /// Gradient of the loss, per span.
    score: Vec<f64>,
    /// Weight of each component of each span.
    weight: Vec<[f64; 2]>,
    information: f64,
    /// The part of the information that comes from residuals which Huber's loss does not clip.
    unclipped: f64,
}

impl Fit {
    fn new(track: &Track, spans: &[Span], lag: f64) -> Self {
        let rows: Vec<_> = spans.iter().map(|s| residual(track, s, lag)).collect();
        let mut fit = Fit {
            bias: [0.0; 2],
            spread: [0.0; 2],
            score: Vec::new(),
            weight: Vec::new(),
            information: 0.0,
            unclipped: 0.0,
        };
        for k in 0..2 {
            let mut r: Vec<f64> = rows.iter().map(|row| row.0[k]).collect();
            fit.bias[k] = median(&mut r);
            r.iter_mut().for_each(|x| *x = (*x - fit.bias[k]).abs());
            // A floor of 0.1 mm keeps noise-free data finite.
            fit.spread[k] = (1.4826 * median(&mut r)).max(1e-4);
        }
        for (r, g) in &rows {
            let (mut score, mut weight) = (0.0, [0.0; 2]);
            for k in 0..2 {
                let u = (r[k] - fit.bias[k]).abs() / fit.spread[k];
                weight[k] = 1.0 / (fit.spread[k] * fit.spread[k] * (u / HUBER).max(1.0));
                score += weight[k] * g[k] * (r[k] - fit.bias[k]);
                let information = weight[k] * g[k] * g[k];
                fit.information += information;
                if u < HUBER {
                    fit.unclipped += information;
                }
            }
            fit.score.push(score);
            fit.weight.push(weight);
        }
        fit
    }

    /// What the coarse search minimises.
    fn log_spread(&self) -> f64 {
        self.spread[0].ln() + self.spread[1].ln()
    }

    /// The whole score at another lag, with the weights and the bias of this one.
    fn score_at(&self, track: &Track, spans: &[Span], lag: f64) -> f64 {
        let at = |(s, w): (&Span, &[f64; 2])| {
            let (r, g) = residual(track, s, lag);
            (0..2)
                .map(|k| w[k] * g[k] * (r[k] - self.bias[k]))
                .sum::<f64>()
        };
        spans.iter().zip(&self.weight).map(at).sum()
    }
}

/// Displacement minus integrated velocity, and the derivative of the latter by the lag.
fn residual(track: &Track, span: &Span, lag: f64) -> ([f64; 2], [f64; 2]) {
    let (v1, i1) = track.at(span.from + lag);
    let (v2, i2) = track.at(span.to + lag);
    (
        [
            span.moved[0] - (i2[0] - i1[0]),
            span.moved[1] - (i2[1] - i1[1]),
        ],
        [v2[0] - v1[0], v2[1] - v1[1]],
    )
}

/// Variance of the sum of the scores, with their autocovariance (\[NeweyWest87\] eq. 5), spans being in the order of time.
fn long_run_variance(score: &[f64], spans: &[Span]) -> f64 {
    let interval = median_interval(spans.iter().map(|s| s.from)).max(1e-3);
    let lags = ((CORRELATION_SPAN / interval) as usize).clamp(1, score.len() / 4);
    let product = |k: usize| {
        score
            .iter()
            .zip(&score[k..])
            .map(|(a, b)| a * b)
            .sum::<f64>()
    };
    // Bartlett's weights keep this positive.
    (1..=lags).fold(product(0), |s, k| {
        s + 2.0 * (1.0 - k as f64 / (lags + 1) as f64) * product(k)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::{Geodetic, LocalFrame};
    use crate::sample::{GnssPosition, GnssVelocity};
    use crate::time::Time;
    use nalgebra::Vector3;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;
    use rand_pcg::rand_core::SeedableRng;

    /// A receiver to simulate: velocity true to a sum of sines, position its exact integral.
    struct Receiver {
        lag: f64,
        sway: f64,
        position_sigma: f64,
        velocity_sigma: f64,
        /// Correlation of successive noise values, positions and velocities.
        colour: f64,
        interval: f64,
        duration: f64,
    }

    const GOOD: Receiver = Receiver {
        lag: 0.128,
        sway: 1.0,
        position_sigma: 0.01,
        velocity_sigma: 0.05,
        colour: 0.0,
        interval: 0.25,
        duration: 300.0,
    };

    // Amplitude (m/s), angular rate (rad/s), phase of the parts of the velocity: periods of 7 to 60 s.
    const PARTS: [[(f64, f64, f64); 3]; 2] = [
        [(6.0, 0.105, 0.3), (2.0, 0.41, 1.0), (0.6, 0.9, 2.0)],
        [(6.0, 0.131, 1.9), (1.5, 0.37, 0.2), (0.7, 0.8, 4.0)],
    ];

    fn simulate(receiver: &Receiver, seed: u64) -> Vec<Sample> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut coloured = [0.0; 5];
        let frame = LocalFrame::new(Geodetic::from_degrees(40.0, -105.0, 1600.0));
        let steps = (receiver.duration / receiver.interval) as i32;
        let mut out = Vec::new();
        for i in 0..steps {
            let t = f64::from(i) * receiver.interval;
            for c in &mut coloured {
                let n: f64 = StandardNormal.sample(&mut rng);
                *c = receiver.colour * *c + (1.0 - receiver.colour * receiver.colour).sqrt() * n;
            }
            let (mut p, mut v) = ([0.0; 2], [0.0; 2]);
            for k in 0..2 {
                let steady = [3.0, 8.0][k];
                p[k] = steady * t + receiver.position_sigma * coloured[k];
                v[k] = steady + receiver.velocity_sigma * coloured[k + 2];
                for (a, w, phase) in PARTS[k] {
                    p[k] -= receiver.sway * a / w * (w * t + phase).cos();
                    v[k] += receiver.sway * a * (w * (t - receiver.lag) + phase).sin();
                }
            }
            let time = Time::from_seconds(1000.0 + t);
            let position = frame.to_geodetic(&Vector3::new(p[0], p[1], coloured[4]));
            out.push(Sample::GnssPosition(GnssPosition {
                time,
                position,
                covariance_n: None,
            }));
            let velocity_n = Vector3::new(v[0], v[1], f64::NAN);
            out.push(Sample::GnssVelocity(GnssVelocity {
                time,
                velocity_n,
                covariance_n: None,
            }));
        }
        out
    }

    #[test]
    fn finds_the_lag_without_noise_from_anywhere_in_the_range() {
        for lag in [-0.45, -0.2, 0.0, 0.05, 0.128, 0.3, 0.45] {
            let samples = simulate(
                &Receiver {
                    lag,
                    position_sigma: 0.0,
                    velocity_sigma: 0.0,
                    ..GOOD
                },
                1,
            );
            let found = estimate(&samples, &Search::default()).expect("observable");
            // What is left is the curvature of the Earth over the 2 km of the path and the cubic's interpolation error.
            assert!((found.value - lag).abs() < 1e-3, "{lag}: {found:?}");
        }
    }

    /// The mean of the squared errors in sigmas over independent runs is 1 for an honest sigma, ± √(2/runs).
    fn mean_square_in_sigmas(receiver: &Receiver, runs: u64) -> f64 {
        let sum: f64 = (0..runs)
            .map(|seed| {
                let found =
                    estimate(&simulate(receiver, seed), &Search::default()).expect("observable");
                ((found.value - receiver.lag) / found.sigma).powi(2)
            })
            .sum();
        sum / runs as f64
    }

    #[test]
    fn sigma_is_honest() {
        let cases = [
            ("good", GOOD),
            (
                "coloured",
                Receiver {
                    colour: 0.8,
                    ..GOOD
                },
            ),
            (
                "poor positions",
                Receiver {
                    position_sigma: 0.5,
                    ..GOOD
                },
            ),
            (
                "10 Hz, coloured",
                Receiver {
                    colour: 0.95,
                    interval: 0.1,
                    position_sigma: 0.3,
                    ..GOOD
                },
            ),
            (
                "1 Hz",
                Receiver {
                    interval: 1.0,
                    duration: 900.0,
                    position_sigma: 0.1,
                    ..GOOD
                },
            ),
            ("little motion", Receiver { sway: 0.1, ..GOOD }),
        ];
        for (name, receiver) in cases {
            let ratio = mean_square_in_sigmas(&receiver, 100);
            // 0.42 is three standard errors of the mean square of 100 normal values. The window of the autocovariance
            // makes the sigma of overlapping spans of white positions too large by a third (0.56 over 200 runs), and
            // where noise rivals motion it is a fifth too small (1.63 over 200 runs).
            assert!(
                (0.56 - 0.24..1.63 + 0.69).contains(&ratio),
                "{name}: {ratio}"
            );
        }
    }
    #[test]
    fn spoiled_data_do_not_mislead() {
        let clean = estimate(&simulate(&GOOD, 7), &Search::default()).expect("observable");
        let mut samples = simulate(&GOOD, 7);
        // A gap, repeated stamps, a swap, missing values, wild fixes and a clamped stop.
        samples.drain(600..680);
        for i in [100, 900, 1500] {
            let copy = samples[i];
            samples.insert(i + 1, copy);
        }
        samples.swap(1000, 1003);
        for (i, sample) in samples.iter_mut().enumerate() {
            match sample {
                Sample::GnssPosition(p) if i % 97 == 0 => {
                    p.position = p.position.offset(&Vector3::new(30.0, -50.0, 9.0))
                }
                Sample::GnssPosition(p) if i % 301 == 0 => p.position.latitude = f64::NAN,
                Sample::GnssVelocity(v) if i % 89 == 0 => {
                    v.velocity_n = Vector3::new(12.0, -9.0, 0.0)
                }
                Sample::GnssVelocity(v) if i % 211 == 0 => v.velocity_n.y = f64::NAN,
                Sample::GnssVelocity(v) if (1800..1830).contains(&i) => {
                    v.velocity_n = Vector3::zeros()
                }
                _ => {}
            }
        }
        let spoiled = estimate(&samples, &Search::default()).expect("observable");
        assert!(
            (spoiled.value - GOOD.lag).abs() < 4.0 * spoiled.sigma,
            "{spoiled:?}"
        );
        assert!(spoiled.sigma < 6.0 * clean.sigma, "{spoiled:?}");
    }

    #[test]
    fn steady_straight_motion_is_declared_unobservable() {
        for seed in 0..20 {
            let found = estimate(
                &simulate(&Receiver { sway: 0.0, ..GOOD }, seed),
                &Search::default(),
            );
            assert!(
                matches!(found, Err(Error::NotObservable { .. })),
                "{found:?}"
            );
        }
    }

    #[test]
    fn nothing_and_little_are_errors() {
        let samples = simulate(&GOOD, 1);
        for few in [&samples[..0], &samples[..1], &samples[..2], &samples[..30]] {
            assert!(matches!(
                estimate(few, &Search::default()),
                Err(Error::NotObservable { .. })
            ));
        }
    }
}
