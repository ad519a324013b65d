//! Fourth-order Butterworth low-pass for the six channels of an inertial unit.

use core::f64::consts::PI;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::Vector6;
use serde::{Deserialize, Serialize};

/// Corner, Hz: above what a body at rest on its springs does, below what an engine does.
pub(super) const CORNER: f64 = 5.0;
/// An impulse has gone to a thousandth after so long, s: the slower pair of poles falls as exp(−2π 5 Hz · 0.383 t).
const SETTLES: f64 = 0.6;
/// Below this sampling rate there is nothing to take away, Hz.
const LEAST_RATE: f64 = 15.0;
/// Quality of the two sections of a Butterworth filter of fourth order: 1/(2 cos π/8), 1/(2 cos 3π/8).
const QUALITY: [f64; 2] = [0.541_196_100_146_197, 1.306_562_964_876_377];

/// A section of second order, transposed direct form II.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Section {
    b0: f64,
    a1: f64,
    a2: f64,
    z1: Vector6<f64>,
    z2: Vector6<f64>,
}

impl Section {
    /// By the bilinear transform with the corner in its place ([Oppenheim10] section 7.2).
    fn new(warped: f64, quality: f64) -> Self {
        let k2 = warped * warped;
        let norm = 1.0 / (1.0 + warped / quality + k2);
        Section {
            b0: k2 * norm,
            a1: 2.0 * (k2 - 1.0) * norm,
            a2: (1.0 - warped / quality + k2) * norm,
            z1: Vector6::zeros(),
            z2: Vector6::zeros(),
        }
    }

    /// As if the input had always been this.
    fn settle(&mut self, x: &Vector6<f64>) {
        self.z1 = x * (1.0 - self.b0);
        self.z2 = x * (self.b0 - self.a2);
    }

    fn push(&mut self, x: &Vector6<f64>) -> Vector6<f64> {
        let y = x * self.b0 + self.z1;
        self.z1 = x * (2.0 * self.b0) - y * self.a1 + self.z2;
        self.z2 = x * self.b0 - y * self.a2;
        y
    }
}

/// The filter, and what it leaves of white noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct LowPass {
    /// `None` where the sampling is too slow for it.
    sections: Option<[Section; 2]>,
    /// Samples since the first.
    age: u32,
    rate: f64,
    noise_bandwidth: f64,
    freedom: f64,
    /// Of white noise behind it: between neighbours, and one further.
    correlations: [f64; 2],
}

impl LowPass {
    /// For this sampling rate, Hz.
    pub(super) fn new(rate: f64) -> Self {
        if rate < LEAST_RATE {
            return LowPass {
                sections: None,
                age: 0,
                rate,
                noise_bandwidth: 0.5 * rate,
                freedom: rate,
                correlations: [0.0; 2],
            };
        }
        let warped = (PI * CORNER / rate).tan();
        // |H|² and |H|⁴ over the frequency, midpoints; both are smooth, and flat at the ends. Eight corners up, 6e-8 is left.
        const STEPS: usize = 400;
        let df = (0.5 * rate).min(8.0 * CORNER) / STEPS as f64;
        let (mut power, mut square, mut lagged) = (0.0, 0.0, [0.0; 2]);
        for i in 0..STEPS {
            let f = (i as f64 + 0.5) * df;
            let gain = 1.0 / (1.0 + ((PI * f / rate).tan() / warped).powi(8));
            power += gain * df;
            square += gain * gain * df;
            for (lagged, lag) in lagged.iter_mut().zip([1.0, 2.0]) {
                *lagged += gain * (2.0 * PI * f * lag / rate).cos() * df;
            }
        }
        LowPass {
            sections: Some(QUALITY.map(|q| Section::new(warped, q))),
            age: 0,
            rate,
            noise_bandwidth: power,
            freedom: 2.0 * power * power / square,
            correlations: lagged.map(|l| l / power),
        }
    }

    /// The sampling rate that it is for, Hz.
    pub(super) fn rate(&self) -> f64 {
        self.rate
    }

    /// One-sided noise bandwidth, Hz: white noise of density d leaves with the variance 2 B d².
    pub(super) fn noise_bandwidth(&self) -> f64 {
        self.noise_bandwidth
    }

    /// Correlation of that noise between neighbouring samples, and one further; `None` where nothing is taken away.
    pub(super) fn correlations(&self) -> Option<[f64; 2]> {
        self.sections.is_some().then_some(self.correlations)
    }

    /// Degrees of freedom of that variance per second of window: 2 (∫|H|²)² / ∫|H|⁴.
    pub(super) fn freedom(&self) -> f64 {
        self.freedom
    }

    /// Whether what the first sample had of noise and vibration has gone.
    pub(super) fn has_settled(&self) -> bool {
        self.sections.is_none() || f64::from(self.age) >= SETTLES * self.rate
    }

    /// The next sample is the first.
    pub(super) fn reset(&mut self) {
        self.age = 0;
    }

    /// One sample.
    pub(super) fn push(&mut self, x: &Vector6<f64>) -> Vector6<f64> {
        let first = self.age == 0;
        self.age = self.age.saturating_add(1);
        let Some(sections) = &mut self.sections else {
            return *x;
        };
        if first {
            for section in sections.iter_mut() {
                section.settle(x);
            }
        }
        sections.iter_mut().fold(*x, |x, section| section.push(&x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gain of a sine, from the amplitude after settling.
    fn gain(rate: f64, frequency: f64) -> f64 {
        let mut filter = LowPass::new(rate);
        let (mut sine, mut cosine, mut n) = (0.0, 0.0, 0.0);
        for i in 0..(20.0 * rate) as i32 {
            let phase = 2.0 * PI * frequency * f64::from(i) / rate;
            let y = filter.push(&Vector6::repeat(phase.sin()))[3];
            // Whole periods from 10 s on: frequencies in the test are multiples of 0.1 Hz.
            if f64::from(i) >= 10.0 * rate {
                sine += y * phase.sin();
                cosine += y * phase.cos();
                n += 0.5;
            }
        }
        f64::hypot(sine, cosine) / n
    }

    /// |H|² = 1/(1 + (tan πf/f_s / tan πf_c/f_s)⁸): half the power at the corner at any rate.
    #[test]
    fn gain_is_butterworth_at_any_rate() {
        for rate in [30.0, 100.0, 200.0, 1000.0] {
            assert!((gain(rate, 5.0) - 0.5f64.sqrt()).abs() < 1e-6, "{rate}");
            for f in [0.5, 2.0, 4.0, 8.0, 12.0] {
                let ratio = (PI * f / rate).tan() / (PI * 5.0 / rate).tan();
                let expected = (1.0 / (1.0 + ratio.powi(8))).sqrt();
                assert!((gain(rate, f) - expected).abs() < 1e-6, "{rate} {f}");
            }
        }
    }

    /// Energy of the impulse response (Parseval) against the integral over frequency; 1.026 times the corner where the
    /// sampling is fast: (π/8)/sin(π/8).
    #[test]
    fn noise_bandwidth_is_the_energy_of_the_impulse_response() {
        for rate in [15.0, 30.0, 77.0, 100.0, 1000.0] {
            let mut filter = LowPass::new(rate);
            filter.push(&Vector6::zeros());
            let mut energy = 0.0;
            for i in 0..(5.0 * rate) as i32 {
                let x = if i == 0 { 1.0 } else { 0.0 };
                energy += filter.push(&Vector6::repeat(x))[0].powi(2);
            }
            let direct = 0.5 * rate * energy;
            assert!(
                (filter.noise_bandwidth() / direct - 1.0).abs() < 1e-4,
                "{rate}: {direct} {}",
                filter.noise_bandwidth()
            );
        }
        let limit = CORNER * (PI / 8.0) / (PI / 8.0).sin();
        assert!((LowPass::new(1e4).noise_bandwidth() / limit - 1.0).abs() < 1e-3);
    }

    #[test]
    fn a_constant_passes_from_the_first_sample_on() {
        let mut filter = LowPass::new(100.0);
        let x = Vector6::new(0.1, -9.8, 3.0, 1e-3, 0.0, 2.0);
        for _ in 0..500 {
            assert!((filter.push(&x) - x).amax() < 1e-12);
        }
        filter.reset();
        assert!((filter.push(&(x * 2.0)) - x * 2.0).amax() < 1e-12);
    }

    #[test]
    fn slow_sampling_passes_through() {
        let mut filter = LowPass::new(10.0);
        assert_eq!(filter.push(&Vector6::repeat(3.0)), Vector6::repeat(3.0));
        assert_eq!(filter.noise_bandwidth(), 5.0);
    }
}
