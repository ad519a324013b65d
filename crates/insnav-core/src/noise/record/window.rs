//! Stretches of a record that are looked at one by one, and where the body was turned when each began.

use super::NoiseReading;
use super::guess::measured_noise;
use super::regress::{Channel, Fitted};
use super::turned::{self, Constant, Start, Turned};
use crate::attitude::exp;
use crate::imu::STANDARD_GRAVITY;
use nalgebra::Vector3;
use std::format;
use std::ops::Range;
use std::string::{String, ToString};
use std::vec::Vec;

/// Samples without which there is no window.
pub(super) const LEAST_SAMPLES: usize = 60;
/// The mean specific force of a window without acceleration is gravity, to this share.
const GRAVITY_OFF: f64 = 0.1;
/// The first stretch of a window that is linearised, s; then twice as much each time.
const FIRST_STRETCH: f64 = 5.0;
/// A window whose start still changes by more than this with the last fit is not understood, rad.
const SETTLED: f64 = 0.01;

/// A window on its way.
#[derive(Clone)]
pub(super) struct Window {
    pub(super) range: Range<usize>,
    pub(super) start: Start,
    pub(super) data: Option<Turned>,
    pub(super) fitted: Option<Fitted>,
    pub(super) reason: Option<String>,
}

impl Window {
    pub(super) fn of(range: Range<usize>) -> Self {
        Window {
            range,
            start: Start {
                attitude: nalgebra::UnitQuaternion::identity(),
                gyro_bias: Vector3::zeros(),
                gravity: f64::NAN,
                field: None,
            },
            data: None,
            fitted: None,
            reason: None,
        }
    }
}

/// Windows of about so many samples that fill the pieces.
pub(super) fn cut(pieces: &[Range<usize>], samples: f64) -> Vec<Window> {
    let mut windows = Vec::new();
    for piece in pieces {
        let n = piece.len();
        if n < LEAST_SAMPLES || (n as f64) < 0.5 * samples {
            continue;
        }
        let count = ((n as f64 / samples) as usize).max(1);
        for k in 0..count {
            let at = |k: usize| piece.start + k * n / count;
            windows.push(Window::of(at(k)..at(k + 1)));
        }
    }
    windows
}

/// Find attitude and gyro bias of a window's begin, in stretches that grow.
pub(super) fn linearise(window: &mut Window, record: &[NoiseReading], step: f64, prior_q: f64) {
    let readings = &record[window.range.clone()];
    let mut start = turned::level(readings);
    let off = (start.gravity / STANDARD_GRAVITY - 1.0).abs();
    if off > GRAVITY_OFF || off.is_nan() {
        window.reason = Some(format!(
            "the mean specific force is {:.2} m/s², not gravity",
            start.gravity
        ));
        window.start = start;
        return;
    }
    let mut stretch =
        ((FIRST_STRETCH / step) as usize).clamp(LEAST_SAMPLES, readings.len().max(LEAST_SAMPLES));
    let mut last = f64::INFINITY;
    let mut repeated = 0;
    loop {
        let part = &readings[..stretch.min(readings.len())];
        let averaged = (part.len() / 200).max(1);
        let Some(data) = turned::average(&turned::tilts(part, &start), averaged) else {
            break;
        };
        let noise = measured_noise(&data.channels).max(f64::MIN_POSITIVE);
        let theta = [prior_q * averaged as f64, 1e-9 * prior_q, noise];
        let channel = Channel::new(averaged as f64 * step, 4, 1);
        let Ok(filter) = channel.filter(&theta) else {
            break;
        };
        let residuals = channel.residuals(&data, &theta, &filter);
        let mut tilt = Vector3::zeros();
        let mut bias = Vector3::zeros();
        for (_, what, value) in residuals.constants {
            match what {
                Constant::Begin(k) => tilt[k] = value,
                Constant::GyroBias(k) => bias[k] = value,
                Constant::OtherBias(_) | Constant::Delay | Constant::Tone => {}
            }
        }
        // Further than this no linear fit is to be believed at once.
        let limited = |v: Vector3<f64>, most: f64| v * (most / v.norm().max(most));
        start.attitude = exp(&limited(tilt, 0.5)) * start.attitude;
        start.gyro_bias += limited(bias, 0.1);
        last = tilt.norm().max(bias.norm() * part.len() as f64 * step);
        if stretch < readings.len() {
            stretch *= 2;
        } else {
            repeated += 1;
            if last < 0.1 * SETTLED || repeated >= 4 {
                break;
            }
        }
    }
    if last >= SETTLED || last.is_nan() {
        window.reason = Some("the attitude that the gyros carry does not stay level: acceleration, or a gyro that saturates".to_string());
    }
    window.start = start;
}
