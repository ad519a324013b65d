//! Which windows show the noise of the sensors, and what they show together.

use super::guess::{averaging, differences, lines, per_sample, time_constant};
use super::heading::heading;
use super::scales::{Scale, best_scale};
use super::steps::{ACCEL_AXES, GYRO_AXES, screen_axes, steps};
use super::told::{bias_noise, describe, noises};
use super::window::{LEAST_SAMPLES, Window, cut, linearise};
use super::{BiasNoise, NoiseReading, RecordNoise, TiltNoise, tones, turned};
use crate::imu::{ImuNoise, STANDARD_GRAVITY};
use crate::noise::Refusal;
use nalgebra::Vector3;
use std::format;
use std::ops::Range;
use std::vec::Vec;

/// Length of a window where nothing else is asked for, s: shorter ones tell little, longer ones are seldom free of acceleration.
const WINDOW: f64 = 20.0;
/// Or so many time constants of the best filter, up to so long: below, a window tells no more of the gyros than an upper limit.
const WINDOW_TIME_CONSTANTS: f64 = 40.0;
const LONGEST_WINDOW: f64 = 60.0;
/// Steps of a long window at the first of the coarser scales.
const COARSE_STEPS: usize = 480;

/// Settings of [`identify_noise`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdentifyOptions {
    /// What is known of the unit: kept where the record tells nothing, and used for the wander of its gyro bias.
    pub prior: ImuNoise,
    /// Length of a window, s; `None`: by the noise itself, 20 to 60 s.
    pub window_s: Option<f64>,
    /// Most lags, J.
    pub lags: usize,
    /// How often a window is filtered, each time with the gain of the estimate before.
    pub rounds: usize,
}

impl IdentifyOptions {
    /// Usual settings for a unit of which this is known beforehand.
    pub fn new(prior: ImuNoise) -> Self {
        IdentifyOptions {
            prior,
            window_s: None,
            lags: 64,
            rounds: 3,
        }
    }
}

/// Identify the noise of gyros, accelerometers and magnetometer from a record at rest or on the move.
///
/// White noise of the gyros (q) and of the angles that the other sensors tell (r), by autocovariance least squares over windows in
/// axes that stand still. A window goes into the estimate if the model fits its lag covariances (χ² at most
/// [`crate::noise::LARGEST_CHI2_PER_DOF`] by degree of freedom, innovations without bursts) and if it does not show more gyro noise than the
/// quietest windows do: unmodelled acceleration is left out, not taken up. Where no window does, what was known is kept and the reason is told.
///
/// # Errors
/// [`Refusal::UnevenSteps`], [`Refusal::Axis`] for an axis that is flat, too coarse, at the end of its range or not finite,
/// [`Refusal::Shape`] for a record without a window, [`Refusal::Setting`].
pub fn identify_noise(
    record: &[NoiseReading],
    options: &IdentifyOptions,
) -> Result<RecordNoise, Refusal> {
    let steps = steps(record)?;
    screen_axes(record, |r| r.angular_rate_b, GYRO_AXES)?;
    screen_axes(record, |r| r.specific_force_b, ACCEL_AXES)?;
    let step = steps.step_s;
    if let Some(window) = options.window_s
        && !(window.is_finite() && window >= LEAST_SAMPLES as f64 * step)
    {
        return Err(Refusal::Setting {
            what: "window, s",
            value: window,
            expected: "at least sixty samples long",
        });
    }
    let mut length = options.window_s.unwrap_or(WINDOW);
    let mut windows = cut(&steps.pieces, length / step);
    if windows.is_empty() {
        let longest = steps.pieces.iter().map(Range::len).max().unwrap_or(0);
        return Err(Refusal::Shape {
            what: "longest piece without a gap",
            found: format!("{longest} samples"),
            expected: format!("at least {}, half a window", (0.5 * length / step).ceil()),
        });
    }
    let prior = options.prior;
    let prior_q = prior.gyro_white.powi(2) * step;
    windows
        .iter_mut()
        .for_each(|w| linearise(w, record, step, prior_q));
    let mut start = differences(&windows, record, step, prior_q, &[]);
    let level = windows.iter().filter(|w| w.reason.is_none()).count();
    if options.window_s.is_none() && 2 * level > windows.len() {
        let wanted = (WINDOW_TIME_CONSTANTS * time_constant(&start) * step).min(LONGEST_WINDOW);
        if wanted > 1.2 * length {
            length = wanted;
            let longer = cut(&steps.pieces, length / step);
            if !longer.is_empty() {
                windows = longer;
                windows
                    .iter_mut()
                    .for_each(|w| linearise(w, record, step, prior_q));
                start = differences(&windows, record, step, prior_q, &[]);
            }
        }
    }
    let shortest = windows.iter().map(|w| w.range.len()).min().unwrap_or(0);
    let wander = prior.gyro_bias_sigma * (2.0 / prior.gyro_bias_tau).sqrt();
    let mut tones_hz = Vec::new();
    // A strong line hides weaker ones: as often as there are new ones.
    while 2 * level > windows.len() && tones_hz.len() < tones::MOST {
        let more = lines(&windows, record, step, &start, &tones_hz);
        if more.is_empty() {
            break;
        }
        tones_hz.extend(more);
        tones_hz.truncate(tones::MOST);
    }
    if !tones_hz.is_empty() {
        start = differences(&windows, record, step, prior_q, &tones_hz);
    }
    let at_scales = |windows: &[Window], first: usize| {
        let shortest = windows.iter().map(|w| w.range.len()).min().unwrap_or(0);
        best_scale(
            first,
            shortest,
            windows,
            |averaged| Scale::new(averaged, step, shortest, wander, &start, options),
            |w, averaged| {
                let turned = turned::tilts(&record[w.range.clone()], &w.start);
                let mut turned = turned::average(&turned, averaged)?;
                tones::add(&mut turned, &per_sample(&tones_hz, averaged as f64 * step));
                Some(turned)
            },
        )
    };
    let mut scaled = at_scales(&windows, averaging(&start, shortest));
    if !scaled.is_good()
        && options.window_s.is_none()
        && length < LONGEST_WINDOW
        && 2 * level > windows.len()
    {
        // Coarser scales, at which less of the noise is coloured, need longer windows.
        let mut longer = cut(&steps.pieces, LONGEST_WINDOW / step);
        longer
            .iter_mut()
            .for_each(|w| linearise(w, record, step, prior_q));
        let shortest = longer.iter().map(|w| w.range.len()).min().unwrap_or(0);
        if shortest > 0 {
            let coarse = (shortest / COARSE_STEPS).max(1);
            let next = at_scales(&longer, coarse);
            if next.is_better_than(&scaled) {
                scaled = next;
                length = LONGEST_WINDOW;
            }
        }
    }
    let count = scaled.used().count();
    let gravity = scaled.used().map(|w| w.start.gravity).sum::<f64>() / count.max(1) as f64;
    let (gyro_white, tilt_white, chi2, dof) = noises(&scaled, "tilt");
    let tilt_prior = prior.accel_white / STANDARD_GRAVITY;
    let tilt = TiltNoise {
        gyro_white: gyro_white.or(prior.gyro_white),
        accel_white: tilt_white.clone().scaled(gravity).or(prior.accel_white),
        tilt_white: tilt_white.or(tilt_prior),
        axes_seen: axes_seen(record, scaled.used()),
        chi2,
        dof,
    };
    let gyro_bias = BiasNoise {
        prior: wander,
        wander: bias_noise(&scaled).or(wander),
    };
    let heading = heading(record, &scaled.windows, options, step, &tilt);
    let block = scaled.scale.block;
    let windows = scaled
        .windows
        .iter()
        .zip(&scaled.reasons)
        .map(|(window, reason)| describe(window, reason, record, block))
        .collect();
    Ok(RecordNoise {
        step_s: step,
        samples: record.len(),
        pieces: steps.pieces.len(),
        window_s: length,
        averaged: scaled.scale.averaged,
        lags: scaled.scale.channel.lags,
        tones_hz,
        tilt,
        heading,
        gyro_bias,
        windows,
    })
}

/// How far each body axis was horizontal in these windows: 1 all the time, 0 never.
fn axes_seen<'a>(record: &[NoiseReading], windows: impl Iterator<Item = &'a Window>) -> [f64; 3] {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for window in windows {
        for attitude in turned::attitudes(&record[window.range.clone()], &window.start) {
            let up = attitude.inverse() * Vector3::z();
            sum += up.map(|c| 1.0 - c * c);
            count += 1.0;
        }
    }
    (sum / f64::max(count, 1.0)).into()
}
