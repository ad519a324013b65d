//! Noise of a record before anything is fitted: first differences, differences over spans, lines in the spectrum.

use super::NoiseReading;
use super::regress::Channel;
use super::tones;
use super::turned::{self, Turned};
use super::window::Window;
use crate::noise::attitude_differences;
use std::vec;
use std::vec::Vec;

/// Samples are averaged until the filter's time constant is so many steps: averages are exact, and lags reach further.
const STEPS_OF_TIME_CONSTANT: f64 = 10.0;
/// But a window keeps so many.
const LEAST_STEPS: usize = 240;

/// Steps after which the best filter has forgotten a sample.
pub(super) fn time_constant([q, r]: &[f64; 2]) -> f64 {
    (r / q.max(f64::MIN_POSITIVE)).sqrt().clamp(1.0, 1e6)
}

pub(super) fn averaging(start: &[f64; 2], shortest: usize) -> usize {
    let wanted = time_constant(start) / STEPS_OF_TIME_CONSTANT;
    (wanted as usize).clamp(1, (shortest / LEAST_STEPS).max(1))
}

/// Half the mean square of first differences: the measurement's noise, nearly all of it.
pub(super) fn measured_noise(series: &[Vec<f64>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for pair in series.iter().flat_map(|s| s.windows(2)) {
        let d = pair[1] - pair[0];
        if d.is_finite() {
            sum += d * d;
            count += 1.0;
        }
    }
    0.5 * sum / f64::max(count, 1.0)
}

/// Noise per sample by differences over several spans, of the quieter windows: (q, r).
pub(super) fn differences(
    windows: &[Window],
    record: &[NoiseReading],
    step: f64,
    prior_q: f64,
    tones_hz: &[f64],
) -> [f64; 2] {
    let mut found: Vec<[f64; 2]> = windows
        .iter()
        .filter(|w| w.reason.is_none())
        .filter_map(|w| {
            let mut data = turned::tilts(&record[w.range.clone()], &w.start);
            tones::add(&mut data, &per_sample(tones_hz, step));
            by_differences(&data, prior_q, step)
        })
        .collect();
    if found.is_empty() {
        return [prior_q, 1e-4];
    }
    let quarter = found.len() / 4;
    found.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    let q = found[quarter][0];
    found.sort_unstable_by(|a, b| a[1].total_cmp(&b[1]));
    // Nothing seen is no zero: a hundredth of what is known, in variance.
    [q.max(0.01 * prior_q), found[quarter][1]]
}

fn by_differences(data: &Turned, prior_q: f64, step: f64) -> Option<[f64; 2]> {
    let r = measured_noise(&data.channels).max(f64::MIN_POSITIVE);
    let theta = [prior_q, 1e-9 * prior_q, r];
    let channel = Channel::new(step, 4, 1);
    let filter = channel.filter(&theta).ok()?;
    let residuals = channel.residuals(data, &theta, &filter);
    let mut sum = [0.0; 2];
    for (c, series) in data.channels.iter().enumerate() {
        let mut clean = series.clone();
        for (index, _, value) in &residuals.constants {
            let column = &data.responses[*index].channels[c];
            clean
                .iter_mut()
                .zip(column)
                .for_each(|(y, h)| *y -= value * h);
        }
        let n = clean.len();
        // Neighbouring samples share the sensor's low-pass: spans from four steps on, where there are enough.
        let spans: Vec<usize> = (if n < 400 { 0 } else { 2 }..)
            .map(|k| 1 << k)
            .take_while(|s| s * 20 <= n)
            .collect();
        let (q, r) = attitude_differences(&clean, &vec![0.0; n], &spans).ok()?;
        sum[0] += q;
        sum[1] += r;
    }
    Some(sum.map(|s| s / data.channels.len() as f64))
}

/// Lines in the spectrum of the tilts' innovations that most windows show, Hz.
pub(super) fn lines(
    windows: &[Window],
    record: &[NoiseReading],
    step: f64,
    start: &[f64; 2],
    known_hz: &[f64],
) -> Vec<f64> {
    let shortest = windows.iter().map(|w| w.range.len()).min().unwrap_or(0);
    let averaged = averaging(start, shortest);
    let [q, r] = *start;
    let theta = [q * averaged as f64, 1e-9 * q, r / averaged as f64];
    let channel = Channel::new(averaged as f64 * step, 4, 1);
    let Ok(filter) = channel.filter(&theta) else {
        return Vec::new();
    };
    let innovations: Vec<Vec<Vec<f64>>> = windows
        .iter()
        .filter(|w| w.reason.is_none())
        .filter_map(|w| {
            let turned = turned::tilts(&record[w.range.clone()], &w.start);
            let mut data = turned::average(&turned, averaged)?;
            tones::add(&mut data, &per_sample(known_hz, averaged as f64 * step));
            let left = channel.residuals(&data, &theta, &filter).left;
            let length = left.len() / data.channels.len();
            Some(left.chunks_exact(length).map(<[f64]>::to_vec).collect())
        })
        .collect();
    let per_radian = 1.0 / (core::f64::consts::TAU * averaged as f64 * step);
    // What was fitted is not found again beside itself.
    let apart = |f: &f64| {
        let resolution = 2.0 / (shortest as f64 * step);
        known_hz.iter().all(|k| (f - k).abs() > resolution)
    };
    tones::find(&innovations)
        .into_iter()
        .map(|f| f * per_radian)
        .filter(apart)
        .collect()
}

/// Angular frequencies per step; what lies beyond half the rate is no line there.
pub(super) fn per_sample(tones_hz: &[f64], step: f64) -> Vec<f64> {
    tones_hz
        .iter()
        .map(|f| core::f64::consts::TAU * f * step)
        .filter(|f| *f < 0.9 * core::f64::consts::PI)
        .collect()
}
