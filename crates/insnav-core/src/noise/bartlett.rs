//! Covariance of lag covariances, by which they are weighted.

use super::lag_covariance::cross_sums_into;
use nalgebra::DMatrix;
use std::vec::Vec;

/// An element of a lag covariance: (lag, a, b).
pub(super) type Row = (usize, usize, usize);

/// Elements of the lag covariances that are not the same as another by symmetry.
pub(super) fn independent_rows(lags: usize, channels: usize) -> Vec<Row> {
    (0..lags)
        .flat_map(|lag| (0..channels).flat_map(move |b| (0..channels).map(move |a| (lag, a, b))))
        .filter(|(lag, a, b)| *lag > 0 || a >= b)
        .collect()
}

/// Covariance of the estimated Ĉ for Gaussian innovations whose true covariances are `model` (p × p by columns, lag 0 first).
///
/// Bartlett's formula (\[Bartlett46\]; for vectors \[Hannan70\]), the sums over all lags:
///
/// ```text
/// N cov(Cⱼ[ab], Cₖ[cd]) = Σₘ g(m + j − k)[ac] g(m)[bd] + g(m + j)[ad] g(m − k)[bc]
/// ```
///
/// Of one channel this is a Toeplitz and a Hankel matrix of one sequence. Ends of the record are neglected: right to J/N.
pub(super) fn covariance(
    model: &[f64],
    channels: usize,
    rows: &[Row],
    counts: &[f64],
) -> DMatrix<f64> {
    let p = channels;
    let elements = p * p;
    let known = model.len() / elements;
    let lags = rows.iter().map(|r| r.0 + 1).max().unwrap_or(0);
    let reach = 2 * lags;
    // g over negative and positive lags, element by element.
    let length = 2 * known - 1;
    let mut both = Vec::with_capacity(elements * length);
    for element in 0..elements {
        let (b, a) = (element / p, element % p);
        let earlier = (1..known).rev().map(|t| model[t * elements + a * p + b]);
        both.extend(earlier);
        both.extend((0..known).map(|t| model[t * elements + b * p + a]));
    }
    // sums[(e, f)][m] = Σₜ g(t + m)[e] g(t)[f], of which g(−t)[ab] = g(t)[ba] makes half those of other pairs.
    let swapped = |e: usize| (e % p) * p + e / p;
    let mut sums = vec![0.0; elements * elements * reach];
    for e in 0..elements {
        for f in 0..elements {
            let (here, there) = (e * elements + f, swapped(f) * elements + swapped(e));
            let at = here * reach..(here + 1) * reach;
            if there < here {
                sums.copy_within(there * reach..(there + 1) * reach, at.start);
            } else {
                let of = |element: usize| &both[element * length..(element + 1) * length];
                cross_sums_into(of(e), of(f), &mut sums[at]);
            }
        }
    }
    let at = |m: isize, e: (usize, usize), f: (usize, usize)| {
        let (e, f) = (e.1 * p + e.0, f.1 * p + f.0);
        let pair = if m >= 0 {
            e * elements + f
        } else {
            f * elements + e
        };
        sums[pair * reach + m.unsigned_abs()]
    };
    let mut w = DMatrix::zeros(rows.len(), rows.len());
    for (column, &(k, c, d)) in rows.iter().enumerate() {
        for (row, &(j, a, b)) in rows.iter().enumerate().skip(column) {
            let value =
                at(j as isize - k as isize, (a, c), (b, d)) + at((j + k) as isize, (a, d), (b, c));
            let value = value / counts[j].max(counts[k]);
            w[(row, column)] = value;
            w[(column, row)] = value;
        }
    }
    w
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Σ over all pairs of samples, with nothing rearranged.
    #[test]
    fn table_of_sums_equals_the_double_sum() {
        let (p, n, lags) = (2, 400, 3);
        // A moving average has covariances that end: two channels, three lags.
        let model: Vec<f64> = vec![
            2.0, 0.3, 0.3, 1.0, //
            0.7, -0.2, 0.1, 0.4, //
            0.1, 0.2, 0.0, -0.1,
        ];
        let g = |m: isize, a: usize, b: usize| -> f64 {
            let (a, b) = if m < 0 { (b, a) } else { (a, b) };
            model
                .get(m.unsigned_abs() * 4 + b * 2 + a)
                .copied()
                .unwrap_or(0.0)
        };
        let rows = independent_rows(lags, p);
        assert_eq!(rows.len(), 11);
        let counts: Vec<f64> = (0..lags).map(|j| (n - j) as f64).collect();
        let w = covariance(&model, p, &rows, &counts);
        for (column, &(k, c, d)) in rows.iter().enumerate() {
            for (row, &(j, a, b)) in rows.iter().enumerate() {
                let mut sum = 0.0;
                for t in 0..(n - j) as isize {
                    for s in 0..(n - k) as isize {
                        let m = t - s;
                        let (j, k) = (j as isize, k as isize);
                        sum += g(m + j - k, a, c) * g(m, b, d) + g(m + j, a, d) * g(m - k, b, c);
                    }
                }
                let exact = sum / (counts[j] * counts[k]);
                // Ends: five lags of four hundred.
                assert!(
                    (w[(row, column)] - exact).abs() < 0.015 * w[(0, 0)],
                    "{row} {column}"
                );
            }
        }
    }
}
