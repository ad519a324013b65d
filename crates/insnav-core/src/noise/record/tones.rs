//! Lines in the spectrum of the innovations: machines, mains and aliases of them, which are no noise.

use super::turned::{Constant, Response, Turned};
use std::vec::Vec;

/// Most lines that are taken out.
pub(super) const MOST: usize = 6;
/// A line stands out of its neighbourhood by this factor, and by so many sigmas of a median over the windows.
const FACTOR: f64 = 2.0;
const SIGMAS: f64 = 10.0;
/// Neighbourhood on either side, in steps of the frequency.
const NEIGHBOURS: usize = 20;
/// Steps of the frequency to a period over the window.
const FINENESS: f64 = 2.0;
/// A line has so many periods in a window.
const LEAST_PERIODS: f64 = 8.0;
/// Windows that are looked at.
const MOST_WINDOWS: usize = 40;

/// Angular frequencies (rad per sample) of lines that most windows show. Each window is one series for each channel.
pub(super) fn find(windows: &[Vec<Vec<f64>>]) -> Vec<f64> {
    let every = windows.len().div_ceil(MOST_WINDOWS).max(1);
    let windows: Vec<&Vec<Vec<f64>>> = windows.iter().step_by(every).collect();
    let Some(length) = windows.iter().flat_map(|w| w.iter().map(Vec::len)).min() else {
        return Vec::new();
    };
    let step = core::f64::consts::TAU / (FINENESS * length as f64);
    let bins = (core::f64::consts::PI / step) as usize;
    if windows.len() < 3 || bins < 4 * NEIGHBOURS {
        return Vec::new();
    }
    let channels = windows[0].len();
    // Of most windows: what only some of them have is motion.
    let power = |channel: usize, frequency: f64| {
        let mut all: Vec<f64> = windows
            .iter()
            .map(|w| periodogram(&w[channel], frequency))
            .collect();
        median(&mut all)
    };
    let least = FACTOR.max(1.0 + SIGMAS / (windows.len() as f64).sqrt());
    let mut lines: Vec<(f64, usize, f64)> = Vec::new();
    for channel in 0..channels {
        let spectrum: Vec<f64> = (0..bins)
            .map(|k| power(channel, (k as f64 + 1.0) * step))
            .collect();
        // What takes longer is motion.
        for k in (FINENESS * LEAST_PERIODS) as usize..bins - 1 {
            let around = k.saturating_sub(NEIGHBOURS)..(k + NEIGHBOURS + 1).min(bins);
            let ratio = spectrum[k] / median(&mut spectrum[around].to_vec());
            let peak = spectrum[k] >= spectrum[k - 1] && spectrum[k] > spectrum[k + 1];
            if peak && ratio > least {
                lines.push((ratio, channel, (k as f64 + 1.0) * step));
            }
        }
    }
    lines.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut found: Vec<f64> = Vec::new();
    for (_, channel, near) in lines {
        // Side lobes of a line are none of their own.
        if found.len() == MOST || found.iter().any(|f| (f - near).abs() < 4.0 * step) {
            continue;
        }
        let finer = (-8..=8).map(|i| near + f64::from(i) * step / 8.0);
        let best = finer
            .map(|f| (power(channel, f), f))
            .max_by(|a, b| a.0.total_cmp(&b.0));
        found.extend(best.map(|(_, f)| f));
    }
    found
}

/// Sine and cosine of each line in each channel, to be fitted with what else is constant in a window.
pub(super) fn add(turned: &mut Turned, per_sample: &[f64]) {
    let channels = turned.channels.len();
    let length = turned.channels.first().map_or(0, Vec::len);
    for frequency in per_sample {
        for channel in 0..channels {
            for phase in [0.0, core::f64::consts::FRAC_PI_2] {
                let mut series = vec![vec![0.0; length]; channels];
                for (k, value) in series[channel].iter_mut().enumerate() {
                    *value = (frequency * k as f64 + phase).sin();
                }
                turned.responses.push(Response {
                    what: Constant::Tone,
                    size: f64::INFINITY,
                    channels: series,
                });
            }
        }
    }
}

fn periodogram(series: &[f64], frequency: f64) -> f64 {
    // A rotating pointer: its rounding after a thousand steps is far below any noise.
    let (turn_sin, turn_cos) = frequency.sin_cos();
    let (mut s, mut c) = (0.0, 1.0);
    let (mut a, mut b) = (0.0, 0.0);
    for value in series {
        a += value * c;
        b += value * s;
        (s, c) = (s * turn_cos + c * turn_sin, c * turn_cos - s * turn_sin);
    }
    (a * a + b * b) / series.len() as f64
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Source, Stream};

    fn windows(amplitude: f64, of: usize) -> Vec<Vec<Vec<f64>>> {
        let mut noise = Source::new(1, Stream::GyroWhite);
        (0..of)
            .map(|w| {
                (0..2)
                    .map(|channel| {
                        (0..400)
                            .map(|k| {
                                let tone = if channel == 1 {
                                    amplitude * (0.37 * k as f64 + w as f64).sin()
                                } else {
                                    0.0
                                };
                                noise.normal() + tone
                            })
                            .collect()
                    })
                    .collect()
            })
            .collect()
    }

    #[test]
    fn a_line_is_found_and_noise_has_none() {
        let found = find(&windows(0.6, 12));
        // Half a fine step, and three sigmas of the median of twelve windows: the Cramér–Rao bound of one is √(24/(A² N³)).
        let half = core::f64::consts::TAU / 400.0 / 32.0;
        let sigma = (24.0 / (0.36 * 400.0f64.powi(3)) / 12.0 * core::f64::consts::FRAC_PI_2).sqrt();
        assert!(
            found.len() == 1 && (found[0] - 0.37).abs() < half + 3.0 * sigma,
            "{found:?}"
        );
        for count in [3, 6, 12, 100] {
            assert!(find(&windows(0.0, count)).is_empty(), "{count}");
        }
    }

    #[test]
    fn what_only_some_windows_have_is_no_line() {
        let mut some = windows(0.0, 12);
        some.extend(windows(3.0, 8));
        assert!(find(&some).is_empty());
    }
}
