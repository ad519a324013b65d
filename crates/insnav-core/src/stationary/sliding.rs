//! Sums over a window that slides by one sample: what the detectors of \[Skog10\] are defined on.

use super::window::Moments;
use nalgebra::Vector3;
use std::vec::Vec;

/// Moments of the last `window` samples at each sample from the `window`-th on, so that there are n − `window` + 1.
///
/// `dt` is the time that a sample stands for, s. Every sum is a sum of at most twice `window` terms without any subtraction (suffixes
/// of one block and prefixes of the next, as van Herk does it for maxima), so that nothing is lost on a long record; time is
/// proportional to the record, not to the window.
///
/// # Panics
/// Never; unequal lengths count up to the shorter one, a window of no samples gives nothing.
pub fn sliding_moments(
    dt: f64,
    force_b: &[Vector3<f64>],
    rate_b: &[Vector3<f64>],
    window: usize,
) -> Vec<Moments> {
    let n = force_b.len().min(rate_b.len());
    if window == 0 || n < window {
        return Vec::new();
    }
    let mut out = Vec::with_capacity(n + 1 - window);
    let mut suffixes = std::vec![Moments::default(); window];
    let mut prefix = Moments::default();
    for last in window - 1..n {
        // Blocks of the length of the window: one that begins with a block is that block.
        let first = last + 1 - window;
        if first.is_multiple_of(window) {
            let mut sum = Moments::default();
            for (i, suffix) in suffixes.iter_mut().enumerate().rev() {
                sum.push(dt, &force_b[first + i], &rate_b[first + i]);
                *suffix = sum;
            }
            prefix = Moments::default();
            out.push(suffixes[0]);
            continue;
        }
        prefix.push(dt, &force_b[last], &rate_b[last]);
        let mut sum = suffixes[first % window];
        sum.add(&prefix);
        out.push(sum);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn readings(n: usize) -> (Vec<Vector3<f64>>, Vec<Vector3<f64>>) {
        let at = |i: usize, k: f64| Vector3::new((0.7 * k * i as f64).sin(), k, (i as f64).cos());
        (
            (0..n).map(|i| at(i, 0.3) + Vector3::z() * -9.8).collect(),
            (0..n).map(|i| at(i, 1.9) * 0.01).collect(),
        )
    }

    #[test]
    fn every_window_is_the_sum_of_its_samples() {
        let (force, rate) = readings(53);
        for window in [1, 2, 7, 26, 52, 53] {
            let found = sliding_moments(0.01, &force, &rate, window);
            assert_eq!(found.len(), 54 - window);
            for (first, m) in found.iter().enumerate() {
                let mut direct = Moments::default();
                for i in first..first + window {
                    direct.push(0.01, &force[i], &rate[i]);
                }
                assert_eq!(m.count, window as f64);
                // Sums of 53 terms in another order.
                assert!((m.force_square - direct.force_square).abs() < 1e-11 * direct.force_square);
                assert!((m.force - direct.force).amax() < 1e-11);
                assert!((m.rate - direct.rate).amax() < 1e-13);
                assert!((m.rate_square - direct.rate_square).abs() < 1e-13);
                let excess = (m.force_excess_square - direct.force_excess_square).abs();
                assert!(excess < 1e-11, "{window} {first}: {excess}");
                assert!((m.span - direct.span).abs() < 1e-12);
            }
        }
        assert!(sliding_moments(0.01, &force, &rate, 0).is_empty());
        assert!(sliding_moments(0.01, &force, &rate, 54).is_empty());
    }

    /// A running sum from which old samples are subtracted would have the rounding of a force a thousand times as large.
    #[test]
    fn nothing_is_lost_on_a_long_record() {
        let n = 200_000;
        let mut force = std::vec![Vector3::new(0.0, 0.0, -1e4); n];
        let (quiet, rate) = readings(100);
        force.extend(&quiet);
        let all = std::vec![Vector3::zeros(); n + 100];
        let found = sliding_moments(0.01, &force, &all, 100);
        let direct = sliding_moments(0.01, &quiet, &rate, 100);
        let last = found.last().expect("windows");
        assert!((last.force_square - direct[0].force_square).abs() < 1e-11 * last.force_square);
    }
}
