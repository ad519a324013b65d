//! What rocking does to a fit: its spectrum from the fit's residuals, through the fit's own gains.

use nalgebra::{SMatrix, SVector, Vector3};
use std::vec::Vec;

/// Rocking is looked at up to this frequency, Hz: above, a fit over minutes averages it out.
const HIGHEST: f64 = 1.0;

/// A fit tells rocking from drift when the stop holds so many of its periods.
///
/// Slower rocking is not in the covariance: what the fit leaves of it cannot be told from the unit's own noise, which is red
/// there. The test of the two halves stands against it: a half holds half as many of its periods, and feels it tens of times
/// as much as the whole.
pub(super) const PERIODS: usize = 8;

/// A tone is seen in lines up to two periods away (the main lobe of a Hann window).
const LOBE: usize = 2;

/// Rocking of one stop.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sway<const R: usize> {
    /// What it does to what is told of the fit, as a covariance.
    pub(super) covariance: SMatrix<f64, R, R>,
    pub(super) spectrum: Spectrum,
}

/// Lines of a residual's spectrum, half a period per stop apart.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spectrum {
    /// Period of the strongest horizontal line, s.
    pub(super) period_s: f64,
    length: f64,
    lines: Vec<Line>,
    /// Middle of each block of nodes, s, and how many nodes a block has.
    times: Vec<f64>,
    merge: usize,
}

/// One line: cosine and sine parts of the three rows, whose squares are variances.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Line {
    /// rad/s.
    rate: f64,
    seen: [Vector3<f64>; 2],
}

/// From residuals at times `t` (s, evenly spaced but for jitter) and the gains of what is told on their rows (v north, v east,
/// yaw).
pub(super) fn sway<const R: usize>(
    t: &[f64],
    residuals: &[Vector3<f64>],
    gains: &[SMatrix<f64, R, 3>],
) -> Sway<R> {
    let spectrum = Spectrum::of(t, residuals);
    Sway {
        covariance: spectrum.through(gains, PERIODS - LOBE),
        spectrum,
    }
}

impl Spectrum {
    fn of(t: &[f64], residuals: &[Vector3<f64>]) -> Self {
        let length = t[t.len() - 1] - t[0];
        let spacing = length / (t.len() - 1) as f64;
        // Two samples a cycle of the highest frequency are enough, with some to spare.
        let merge = ((0.2 / HIGHEST / spacing) as usize).max(1);
        let times: Vec<f64> = t
            .chunks(merge)
            .map(|t| 0.5 * (t[0] + t[t.len() - 1]))
            .collect();
        let windowed: Vec<Vector3<f64>> = residuals
            .chunks(merge)
            .zip(&times)
            .map(|(r, t)| {
                let mean = r.iter().sum::<Vector3<f64>>() / r.len() as f64;
                mean * hann(t / length)
            })
            .collect();
        let power: f64 = times.iter().map(|t| hann(t / length).powi(2)).sum();
        let scale = (2.0 / (times.len() as f64 * power)).sqrt();
        let mut lines = Vec::new();
        let (mut strongest, mut period_s) = (0.0, length);
        for half in 3..=(2.0 * HIGHEST * length) as usize {
            let rate = core::f64::consts::PI * half as f64 / length;
            let mut seen = [Vector3::<f64>::zeros(); 2];
            for (t, r) in times.iter().zip(&windowed) {
                let (s, c) = (rate * t).sin_cos();
                seen[0] += r * c;
                seen[1] += r * s;
            }
            let seen = seen.map(|v| v * scale);
            // One period in the whole stop is what is left of drift.
            let horizontal: f64 = seen.iter().map(|v| v.xy().norm_squared()).sum();
            if horizontal > strongest {
                (strongest, period_s) = (horizontal, 2.0 * length / half as f64);
            }
            if half >= 2 * (PERIODS - LOBE) {
                lines.push(Line { rate, seen });
            }
        }
        Spectrum {
            period_s,
            length,
            lines,
            times,
            merge,
        }
    }

    /// What rocking of `periods` periods per stop and more does through gains on the rows of every node, as a covariance.
    ///
    /// The three rows rock together, so they go through their gains with the phases that they have to each other; the common phase
    /// is taken for random. A gain's spectrum has its nulls and peaks half a period per stop apart, and a tone between two lines
    /// is seen in both: every line counts as a whole, which gives the envelope of the side lobes. A tone at a peak does what is
    /// said, a tone anywhere 0.7 of it on average.
    pub(super) fn through<const R: usize>(
        &self,
        gains: &[SMatrix<f64, R, 3>],
        periods: usize,
    ) -> SMatrix<f64, R, R> {
        let blocks: Vec<SMatrix<f64, R, 3>> =
            gains.chunks(self.merge).map(|g| g.iter().sum()).collect();
        let mut covariance = SMatrix::<f64, R, R>::zeros();
        let slowest = core::f64::consts::TAU * (periods as f64 - 0.25) / self.length;
        for Line { rate, seen } in self.lines.iter().filter(|l| l.rate > slowest) {
            let mut felt = [SMatrix::<f64, R, 3>::zeros(); 2];
            for (t, g) in self.times.iter().zip(&blocks) {
                let (s, c) = (rate * t).sin_cos();
                felt[0] += g * c;
                felt[1] += g * s;
            }
            let [cos, sin] = felt;
            let parts: [SVector<f64, R>; 2] =
                [cos * seen[0] + sin * seen[1], sin * seen[0] - cos * seen[1]];
            for part in &parts {
                covariance += part * part.transpose();
            }
        }
        covariance
    }
}

fn hann(share: f64) -> f64 {
    (core::f64::consts::PI * share).sin().powi(2)
}

#[cfg(test)]
mod tests {
    use super::super::standing::{Taper, derivative_row};
    use super::*;

    /// A tone of any frequency and phase, through the kernel of a tapered fit: what it does against what is said, by frequency.
    #[test]
    fn a_tone_between_two_lines_does_what_is_said() {
        let length = 160.0;
        let t: Vec<f64> = (0..=1600).map(|k| f64::from(k) * 0.1).collect();
        for taper in [Taper::None, Taper::HannSquared] {
            let weights = taper.weights(&t);
            let bend = derivative_row::<3>(&t, &weights);
            let slope = derivative_row::<2>(&t, &weights);
            // The bend of the north velocity, and a sum in which two rows of one tone cancel but for a tenth.
            let gains: Vec<SMatrix<f64, 2, 3>> = bend
                .iter()
                .zip(&slope)
                .map(|(b, s)| SMatrix::<f64, 2, 3>::new(*b, 0.0, 0.0, *s, -0.9 * s, 0.0))
                .collect();
            let mut means = [0.0f64; 2];
            let mut worst = [0f64; 2];
            let tones = 24;
            for i in 0..tones {
                // From nine periods to forty, at steps that are no halves; two phases make up a mean over all.
                let periods = 9.0 + 1.317 * f64::from(i);
                let rate = core::f64::consts::TAU * periods / length;
                let mut squares = [0.0; 2];
                let phases = 2;
                for k in 0..phases {
                    let phase = core::f64::consts::FRAC_PI_2 * f64::from(k);
                    let residuals: Vec<Vector3<f64>> = t
                        .iter()
                        .map(|t| {
                            let x = (rate * t + phase).cos();
                            Vector3::new(x, x, 0.0)
                        })
                        .collect();
                    let spectrum = Spectrum::of(&t, &residuals);
                    assert!((length / spectrum.period_s - periods).abs() < 0.3);
                    let said = spectrum.through(&gains, PERIODS - LOBE);
                    let done: SVector<f64, 2> =
                        gains.iter().zip(&residuals).map(|(g, r)| g * r).sum();
                    for c in 0..2 {
                        squares[c] += done[c] * done[c] / said[(c, c)] / f64::from(phases);
                    }
                }
                for c in 0..2 {
                    means[c] += squares[c] / f64::from(tones);
                    worst[c] = worst[c].max(squares[c]);
                }
            }
            println!(
                "{taper:?}: squares over variances {means:.2?}, at the worst frequency {worst:.2?}"
            );
            // Half on average by the envelope (24 frequencies: a tenth of scatter), one at its peaks.
            for c in 0..2 {
                assert!((0.35..0.65).contains(&means[c]), "{taper:?} {means:?}");
                assert!((0.9..1.1).contains(&worst[c]), "{taper:?} {worst:?}");
            }
        }
    }
}
