//! Lag covariances of whole records.

use super::{LagAccumulator, Refusal};
use std::format;
use std::vec::Vec;

/// Lags whose sums are gathered in one pass: as many as keep the accumulators in registers.
const LANES: usize = 8;

/// Ĉⱼ = mean of νₖ₊ⱼ νₖᵀ for j = 0 … J − 1, and how many products each is the mean of.
#[derive(Clone, Debug, PartialEq)]
pub struct LagCovariance {
    channels: usize,
    /// Element (a, b) of lag j at j p² + b p + a.
    values: Vec<f64>,
    counts: Vec<f64>,
}

impl LagCovariance {
    /// From values in the order lag, column, row (element (a, b) of lag j at j p² + b p + a) and counts by lag.
    ///
    /// # Errors
    /// [`Refusal::Shape`] when the sizes differ, [`Refusal::NotFinite`].
    pub fn new(channels: usize, values: Vec<f64>, counts: Vec<f64>) -> Result<Self, Refusal> {
        if channels == 0 || values.len() != counts.len() * channels * channels || counts.is_empty()
        {
            return Err(Refusal::Shape {
                what: "values of the lag covariances",
                found: format!("{}", values.len()),
                expected: format!("{} lags x {channels} x {channels}", counts.len()),
            });
        }
        if values.iter().chain(&counts).any(|v| !v.is_finite()) {
            return Err(Refusal::NotFinite {
                what: "lag covariances",
            });
        }
        Ok(LagCovariance {
            channels,
            values,
            counts,
        })
    }

    /// Number of components of the innovation, p.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Number of lags, J.
    pub fn lags(&self) -> usize {
        self.counts.len()
    }

    /// All values, in the order of the rows of [`Design::columns`](super::Design::columns).
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Number of products at each lag.
    pub fn counts(&self) -> &[f64] {
        &self.counts
    }

    /// Element (a, b) of Ĉⱼ.
    pub fn at(&self, lag: usize, a: usize, b: usize) -> f64 {
        self.values[(lag * self.channels + b) * self.channels + a]
    }

    /// Correlation time of a channel in samples, 1 + 2 Σ (Ĉⱼ/Ĉ₀)²: of so many products of neighbouring samples one is independent.
    pub fn correlation_time(&self, channel: usize) -> f64 {
        let variance = self.at(0, channel, channel);
        1.0 + (1..self.lags())
            .map(|j| 2.0 * (self.at(j, channel, channel) / variance).powi(2))
            .filter(|v| v.is_finite())
            .sum::<f64>()
    }
}

impl<const P: usize, const J: usize> From<&LagAccumulator<P, J>> for LagCovariance {
    fn from(lags: &LagAccumulator<P, J>) -> Self {
        LagCovariance {
            channels: P,
            values: (0..J)
                .flat_map(|j| lags.covariance(j).as_slice().to_vec())
                .collect(),
            counts: (0..J).map(|j| lags.count(j)).collect(),
        }
    }
}

/// Lag covariances of innovations, sums over several runs added up.
///
/// Each run is a contiguous piece after the filter's transient, sample by sample with its `channels` components side by side.
/// The mean is taken to be zero, as it is of innovations; a mean that is not shows at every lag.
///
/// # Errors
/// [`Refusal::Shape`] for a run that is no whole number of samples or when no run is longer than the lags,
/// [`Refusal::NotFinite`].
pub fn lag_covariance(
    runs: &[&[f64]],
    channels: usize,
    lags: usize,
) -> Result<LagCovariance, Refusal> {
    if channels == 0 || lags == 0 || runs.iter().any(|run| run.len() % channels != 0) {
        return Err(Refusal::Shape {
            what: "number of values of a run",
            found: runs
                .iter()
                .map(|r| format!("{}", r.len()))
                .collect::<Vec<_>>()
                .join(", "),
            expected: format!("a multiple of {channels}, with at least one channel and one lag"),
        });
    }
    if !runs.iter().any(|run| run.len() / channels > lags) {
        return Err(Refusal::Shape {
            what: "longest run",
            found: format!(
                "{} samples",
                runs.iter().map(|r| r.len() / channels).max().unwrap_or(0)
            ),
            expected: format!("more than {lags}, the number of lags"),
        });
    }
    if runs.iter().any(|run| run.iter().any(|v| !v.is_finite())) {
        return Err(Refusal::NotFinite { what: "innovation" });
    }
    let mut sums = vec![0.0; lags * channels * channels];
    let mut counts = vec![0.0; lags];
    let mut of_pair = vec![0.0; lags];
    for run in runs {
        let samples = run.len() / channels;
        for (lag, count) in counts.iter_mut().enumerate() {
            *count += samples.saturating_sub(lag) as f64;
        }
        let axes: Vec<Vec<f64>> = (0..channels)
            .map(|a| run.iter().skip(a).step_by(channels).copied().collect())
            .collect();
        for (b, earlier) in axes.iter().enumerate() {
            for (a, later) in axes.iter().enumerate() {
                cross_sums_into(later, earlier, &mut of_pair);
                for (lag, sum) in of_pair.iter().enumerate() {
                    sums[(lag * channels + b) * channels + a] += sum;
                }
            }
        }
    }
    for (lag, count) in counts.iter().enumerate() {
        for sum in &mut sums[lag * channels * channels..(lag + 1) * channels * channels] {
            *sum /= count.max(1.0);
        }
    }
    LagCovariance::new(channels, sums, counts)
}

/// Σₖ later[k + j] earlier[k] for j below `lags`.
pub(super) fn cross_sums(later: &[f64], earlier: &[f64], lags: usize) -> Vec<f64> {
    let mut sums = vec![0.0; lags];
    cross_sums_into(later, earlier, &mut sums);
    sums
}

/// The same into `sums[j]`, several lags at a time.
pub(super) fn cross_sums_into(later: &[f64], earlier: &[f64], sums: &mut [f64]) {
    for (block, sums) in sums.chunks_mut(LANES).enumerate() {
        sums.fill(0.0);
        let Some(shifted) = later.get(block * LANES..) else {
            continue;
        };
        let mut lanes = [0.0; LANES];
        let whole = (shifted.len() + 1).saturating_sub(LANES);
        for (ahead, now) in shifted.windows(LANES).zip(earlier) {
            for (lane, value) in lanes.iter_mut().zip(ahead) {
                *lane += value * now;
            }
        }
        for (k, now) in earlier.iter().enumerate().take(shifted.len()).skip(whole) {
            for (lane, value) in lanes.iter_mut().zip(&shifted[k..]) {
                *lane += value * now;
            }
        }
        sums.copy_from_slice(&lanes[..sums.len()]);
    }
}

/// The two outermost values of a range and how often each occurs.
#[derive(Clone, Copy)]
struct End {
    last: (f64, usize),
    beside: (f64, usize),
}

impl End {
    /// `side` is 1 for the upper end, −1 for the lower one.
    fn of(values: impl Iterator<Item = f64>, side: f64) -> Self {
        let nothing = (-side * f64::INFINITY, 0);
        let mut end = End {
            last: nothing,
            beside: nothing,
        };
        for value in values {
            let beyond = |other: f64| side * value > side * other;
            if beyond(end.beside.0) {
                if beyond(end.last.0) {
                    end.beside = end.last;
                    end.last = (value, 1);
                } else if value == end.last.0 {
                    end.last.1 += 1;
                } else {
                    end.beside = (value, 1);
                }
            } else if value == end.beside.0 {
                end.beside.1 += 1;
            }
        }
        end
    }
}

/// Refuse channels that do not show their noise: switched off, coarser than their noise, or at the end of their range.
pub(super) fn screen(runs: &[&[f64]], channels: usize) -> Result<(), Refusal> {
    for channel in 0..channels {
        let values = || {
            runs.iter()
                .flat_map(move |run| run.iter().skip(channel).step_by(channels).copied())
        };
        let count = values().count();
        if count < 20 {
            continue;
        }
        let ends = [End::of(values(), -1.0), End::of(values(), 1.0)];
        if ends[0].last.1 + ends[0].beside.1 == count {
            return Err(Refusal::Flat {
                channel,
                distinct: if ends[0].beside.1 == 0 { 1 } else { 2 },
            });
        }
        // A rounded value is rarer at the ends of its range than beside them, or 2.4 times as frequent if it is a sine; one that
        // is cut off is far more frequent there.
        for End { last, beside } in ends {
            let (value, at_end) = last;
            if at_end >= 10 && at_end * 200 >= count && at_end > 4 * beside.1 {
                return Err(Refusal::Saturated {
                    channel,
                    value,
                    percent: 100.0 * at_end as f64 / count as f64,
                });
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;

    fn record(samples: usize) -> Vec<f64> {
        (0..2 * samples)
            .map(|i| ((i * i) as f64 * 0.37).sin())
            .collect()
    }

    #[test]
    fn batch_equals_stream() {
        let (long, short) = (record(100), record(17));
        let batch = lag_covariance(&[&long, &short[6..]], 2, 19).expect("long enough");
        let mut stream = LagAccumulator::<2, 19>::new();
        for run in [&long[..], &short[6..]] {
            run.chunks(2)
                .for_each(|v| stream.push(&Vector2::new(v[0], v[1])));
            stream.end_run();
        }
        let stream = LagCovariance::from(&stream);
        assert_eq!(batch.counts(), stream.counts());
        for (a, b) in batch.values().iter().zip(stream.values()) {
            // A hundred rounded products of numbers below one.
            assert!((a - b).abs() < 1e-14);
        }
    }

    #[test]
    fn what_cannot_be_summed_is_refused() {
        assert!(matches!(
            lag_covariance(&[&[1.0; 9]], 2, 2),
            Err(Refusal::Shape { .. })
        ));
        assert!(matches!(
            lag_covariance(&[&[1.0; 4]], 2, 2),
            Err(Refusal::Shape { .. })
        ));
        assert!(matches!(
            lag_covariance(&[&[f64::NAN; 40]], 2, 2),
            Err(Refusal::NotFinite { .. })
        ));
    }

    #[test]
    fn flat_and_saturated_channels_are_named() {
        let sine = |scale: f64| -> Vec<f64> { record(500).iter().map(|v| v * scale).collect() };
        assert_eq!(screen(&[&sine(1.0)], 2), Ok(()));
        let rounded: Vec<f64> = sine(2.4).iter().map(|v| v.round()).collect();
        assert_eq!(screen(&[&rounded], 2), Ok(()));
        let mut flat = sine(1.0);
        flat.iter_mut().skip(1).step_by(2).for_each(|v| *v = 3.0);
        assert_eq!(
            screen(&[&flat], 2),
            Err(Refusal::Flat {
                channel: 1,
                distinct: 1
            })
        );
        let cut: Vec<f64> = sine(1.0).iter().map(|v| v.min(0.9)).collect();
        assert!(matches!(
            screen(&[&cut], 2),
            Err(Refusal::Saturated {
                channel: 0,
                value: 0.9,
                ..
            })
        ));
    }
}
