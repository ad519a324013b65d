//! Overlapping Allan deviation of a sensor's record.

use super::Refusal;
use super::stability::{Spectrum, too_few};
use std::vec::Vec;

/// Allan deviation at one averaging time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AllanPoint {
    /// Averaging time τ, s.
    pub tau_s: f64,
    /// The same in samples, m.
    pub samples: usize,
    /// Overlapping Allan deviation, in units of the record (rad/s of a gyro, m/s² of an accelerometer).
    pub deviation: f64,
    /// Number of overlapping second differences it is the mean of.
    pub differences: usize,
}

/// Averaging times for a record of so many samples: `per_octave` to a doubling, from one sample to a quarter of the record.
pub fn averaging_samples(samples: usize, per_octave: usize) -> Vec<usize> {
    let most = samples / 4;
    let per_octave = per_octave.max(1);
    let mut list: Vec<usize> = (0..)
        .map(|i| 2f64.powf(f64::from(i) / per_octave as f64).round() as usize)
        .take_while(|m| *m <= most)
        .collect();
    list.dedup();
    list
}

/// Overlapping Allan deviation of samples at equal steps of `step_s` seconds, for averages over `averaged` samples each.
///
/// σ²(τ) = ⟨(x(t + 2τ) − 2 x(t + τ) + x(t))²⟩ / 2τ², x the integral of the record (\[Riley08\]). One pass over the record for
/// each τ.
///
/// # Errors
/// [`Refusal::NotFinite`], [`Refusal::Setting`] for a step that is not positive or an average over none, or over more than half
/// the record, [`Refusal::Flat`] for a record of one value.
pub fn overlapping_allan(
    record: &[f64],
    step_s: f64,
    averaged: &[usize],
) -> Result<Vec<AllanPoint>, Refusal> {
    // Written so that NaN fails.
    if !(step_s > 0.0 && step_s.is_finite()) {
        return Err(Refusal::Setting {
            what: "step between samples, s",
            value: step_s,
            expected: "positive",
        });
    }
    if record.iter().any(|v| !v.is_finite()) {
        return Err(Refusal::NotFinite { what: "record" });
    }
    if let Some(m) = averaged.iter().find(|m| **m == 0 || **m > record.len() / 2) {
        return Err(Refusal::Setting {
            what: "samples to average over",
            value: *m as f64,
            expected: "at least one, and at most half the record",
        });
    }
    if record.windows(2).all(|pair| pair[0] == pair[1]) {
        return Err(Refusal::Flat {
            channel: 0,
            distinct: record.len().min(1),
        });
    }
    // Second differences do not see the mean; without it the integral keeps its digits.
    let mean = record.iter().sum::<f64>() / record.len() as f64;
    let mut sum = 0.0;
    let mut integral = Vec::with_capacity(record.len() + 1);
    integral.push(0.0);
    for value in record {
        sum += value - mean;
        integral.push(sum);
    }
    Ok(averaged
        .iter()
        .map(|&m| {
            let (near, far) = (&integral[m..], &integral[2 * m..]);
            let squares: f64 = far
                .iter()
                .zip(near)
                .zip(&integral)
                .map(|((c, b), a)| (c - 2.0 * b + a).powi(2))
                .sum();
            // The integral is in steps: of its unit, τ is m.
            let variance = squares / (2.0 * (m * m * far.len()) as f64);
            AllanPoint {
                tau_s: m as f64 * step_s,
                samples: m,
                deviation: variance.sqrt(),
                differences: far.len(),
            }
        })
        .collect())
}

impl AllanPoint {
    /// Equivalent degrees of freedom of the variance, if the noise is that of `fit`.
    ///
    /// 2 σ⁴ / var(σ²), with the variance of a mean of correlated second differences (\[Greenhall03\]).
    pub fn degrees_of_freedom(&self, fit: &AllanFit) -> f64 {
        let spectrum = fit.spectrum();
        2.0 * spectrum.variance(self.tau_s).powi(2) / spectrum.covariance(self, self)
    }

    /// Confidence interval of the deviation at `sigmas` of a normal distribution, if the noise is that of `fit`.
    ///
    /// Quantiles of χ² by \[Wilson31\], good to a percent from three degrees of freedom on.
    pub fn interval(&self, fit: &AllanFit, sigmas: f64) -> (f64, f64) {
        let edf = self.degrees_of_freedom(fit).max(1.0);
        let quantile = |z: f64| {
            (1.0 - 2.0 / (9.0 * edf) + z * (2.0 / (9.0 * edf)).sqrt())
                .max(0.05)
                .powi(3)
        };
        (
            self.deviation / quantile(sigmas).sqrt(),
            self.deviation / quantile(-sigmas).sqrt(),
        )
    }
}

/// A coefficient with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AllanTerm {
    /// The coefficient; 0 where the record shows none of it.
    pub value: f64,
    /// One sigma. Of a coefficient that is not seen, the square root of that of its square: an upper limit.
    pub standard_error: f64,
}

/// Noise of a sensor by its Allan variance: σ²(τ) = N²/τ + (2 ln 2/π) B² + K² τ/3 (\[IEEE952\] annex C).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AllanFit {
    /// N: white noise (angle or velocity random walk), unit of the record times √s.
    pub white: AllanTerm,
    /// B: flicker noise (bias instability), unit of the record. The flat floor of the deviation is 0.664 B.
    pub flicker: AllanTerm,
    /// K: random walk of the value (rate random walk), unit of the record by √s.
    pub random_walk: AllanTerm,
    /// Weighted sum of squares of what the fit leaves.
    pub chi2: f64,
    /// Averaging times less coefficients.
    pub dof: usize,
    /// The shortest averaging time that was used, s.
    pub from_tau_s: f64,
    step_s: f64,
}

impl AllanFit {
    fn spectrum(&self) -> Spectrum {
        Spectrum::new(
            [self.white.value, self.flicker.value, self.random_walk.value].map(|c| c * c),
            self.step_s,
        )
    }

    /// Deviation of the fit at an averaging time.
    pub fn deviation(&self, tau_s: f64) -> f64 {
        self.spectrum().variance(tau_s).sqrt()
    }

    /// Deviations of white noise, flicker noise and random walk alone: the root of the sum of their squares is that of the fit.
    pub fn parts(&self, tau_s: f64) -> [f64; 3] {
        self.spectrum().variances(tau_s).map(f64::sqrt)
    }
}

/// Fit white noise, flicker noise and random walk to Allan deviations.
///
/// Generalised least squares of the variances, none negative: neighbouring averaging times share their data, so that they are
/// weighted by their whole covariance under the fit, which is found with the fit. At most two of them to a doubling are used, in
/// rising order. Averages over a few samples see the sensor's low-pass and its steps: the shortest times are left out until χ² is
/// at most three times its degrees of freedom, and where it never is, the best fit there is comes back. Stated errors are
/// honest if the noise is of these three kinds; χ² tells when it is not (temperature, motion).
///
/// # Errors
/// [`Refusal::Shape`] for less than five averaging times, [`Refusal::NotPositiveDefinite`] for points that are not of one record.
pub fn fit_allan(points: &[AllanPoint]) -> Result<AllanFit, Refusal> {
    if points.len() < 5 || points.iter().any(|p| !(p.deviation > 0.0 && p.tau_s > 0.0)) {
        return Err(too_few(points.len()));
    }
    // Averages over a few samples see the sensor's own low-pass and steps: left out until the rest fits.
    let mut best = super::stability::fit(points)?;
    let mut from = 0;
    for start in 1..points.len() {
        if best.fits() {
            break;
        }
        match super::stability::fit(&points[start..]) {
            Ok(found) if found.chi2 * (best.dof() as f64) < best.chi2 * found.dof() as f64 => {
                best = found;
                from = start;
            }
            Ok(_) => {}
            Err(_) => break,
        }
    }
    let squares = best;
    let term = |i: usize| {
        let value = squares.values[i].max(0.0).sqrt();
        AllanTerm {
            value,
            standard_error: if squares.values[i] > squares.errors[i] {
                squares.errors[i] / (2.0 * value)
            } else {
                squares.errors[i].sqrt()
            },
        }
    };
    Ok(AllanFit {
        white: term(0),
        flicker: term(1),
        random_walk: term(2),
        chi2: squares.chi2,
        dof: squares.dof(),
        from_tau_s: points[from].tau_s,
        step_s: points[0].tau_s / points[0].samples as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviation_is_that_of_the_definition() {
        let record: Vec<f64> = (0..200).map(|i| (f64::from(i * i) * 0.3).sin()).collect();
        for point in overlapping_allan(&record, 0.5, &[1, 3, 50]).expect("long enough") {
            let m = point.samples;
            // Differences of neighbouring averages over m samples, from every sample on.
            let average = |k: usize| record[k..k + m].iter().sum::<f64>() / m as f64;
            let count = 200 - 2 * m + 1;
            let sum: f64 = (0..count)
                .map(|k| (average(k + m) - average(k)).powi(2))
                .sum();
            assert_eq!((point.differences, point.tau_s), (count, 0.5 * m as f64));
            assert!((point.deviation - (sum / (2 * count) as f64).sqrt()).abs() < 1e-13);
        }
    }

    #[test]
    fn averaging_times_are_spread_evenly() {
        assert_eq!(averaging_samples(64, 1), [1, 2, 4, 8, 16]);
        let list = averaging_samples(100_000, 4);
        assert!(list.windows(2).all(|w| w[1] > w[0]) && list[list.len() - 1] <= 25_000);
    }

    #[test]
    fn what_has_no_deviation_is_refused() {
        assert!(overlapping_allan(&[1.0; 50], 0.1, &[1]).is_err());
        assert!(overlapping_allan(&[1.0, 2.0, f64::NAN, 3.0], 0.1, &[1]).is_err());
        assert!(overlapping_allan(&[1.0, 2.0, 3.0], 0.1, &[2]).is_err());
        assert!(overlapping_allan(&[1.0, 2.0, 3.0], 0.0, &[1]).is_err());
        assert!(fit_allan(&[]).is_err());
    }
}
