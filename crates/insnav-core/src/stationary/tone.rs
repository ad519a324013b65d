//! What of a window a single tone explains: an engine that sampling has brought down into the pass band.
//!
//! For a tone of ω and a mean μ, x₊ + x₋ − 2μ = 2 cos ω (x − μ) without a rest. The cosine that leaves the least over the six
//! channels, each over its noise, is a quotient of sums, and so is what it leaves: no sample is kept. A shake above 2.5 Hz which
//! leaves as little as noise does moves a body by its amplitude over (2π 2.5 Hz)² at most, millimetres; what travels on wheels has
//! no single tone. Slower sway loses a part of its variance, and is judged by the rest.

use super::low_pass::LowPass;
use super::rest_noise::RestNoise;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Slower tones are sway, Hz.
const SLOWEST: f64 = 2.5;
/// As many as a window has parts at most.
const CAPACITY: usize = 32;

/// Sums of one kind of reading, x, and of the pairs around it, s = x₊ + x₋.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Sums {
    x: Vector3<f64>,
    s: Vector3<f64>,
    xx: f64,
    ss: f64,
    sx: f64,
}

impl Sums {
    fn push(&mut self, x: &Vector3<f64>, s: &Vector3<f64>) {
        self.x += x;
        self.s += s;
        self.xx += x.norm_squared();
        self.ss += s.norm_squared();
        self.sx += s.dot(x);
    }

    fn add(&mut self, other: &Sums) {
        self.x += other.x;
        self.s += other.s;
        self.xx += other.xx;
        self.ss += other.ss;
        self.sx += other.sx;
    }

    /// Mean squares and product of u = s − 2μ and v = x − μ: u², u·v, v².
    fn about_the_mean(&self, n: f64) -> [f64; 3] {
        let (mean, pair) = (self.x / n, self.s / n);
        [
            (self.ss / n - 4.0 * mean.dot(&pair) + 4.0 * mean.norm_squared()).max(0.0),
            self.sx / n - mean.dot(&pair),
            (self.xx / n - mean.norm_squared()).max(0.0),
        ]
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Part {
    count: f64,
    force: Sums,
    rate: Sums,
}

/// The sums over the parts of a window of low-passed samples.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct ToneWindow {
    parts: heapless::Deque<Part, CAPACITY>,
    open: Part,
    /// The last two samples, the newer first.
    last: [Option<[Vector3<f64>; 2]>; 2],
}

impl ToneWindow {
    pub(super) fn clear(&mut self) {
        *self = ToneWindow::default();
    }

    pub(super) fn push(&mut self, force: &Vector3<f64>, rate: &Vector3<f64>) {
        if let [Some([force0, rate0]), Some([force1, rate1])] = self.last {
            self.open.count += 1.0;
            self.open.force.push(&force0, &(force + force1));
            self.open.rate.push(&rate0, &(rate + rate1));
        }
        self.last = [Some([*force, *rate]), self.last[0]];
    }

    /// A part of the window is whole; the window has so many.
    pub(super) fn close(&mut self, parts: usize) {
        while self.parts.is_full() || self.parts.len() >= parts.max(1) {
            self.parts.pop_front();
        }
        let _ = self.parts.push_back(core::mem::take(&mut self.open));
    }

    /// LPMV and LPGV of what the tone that explains most leaves, in the measure of those without one: the same at rest.
    pub(super) fn variances(
        &self,
        dt: f64,
        noise: &RestNoise,
        low_pass: &LowPass,
    ) -> Option<[f64; 2]> {
        let [near, far] = low_pass.correlations()?;
        let mut sum = Part::default();
        for part in &self.parts {
            sum.count += part.count;
            sum.force.add(&part.force);
            sum.rate.add(&part.rate);
        }
        if sum.count < 10.0 {
            return None;
        }
        let two_b = 2.0 * low_pass.noise_bandwidth();
        let over_noise = |sums: &Sums, white: f64| {
            sums.about_the_mean(sum.count)
                .map(|x| x / (two_b * white * white))
        };
        let kinds = [
            over_noise(&sum.force, noise.accel_white),
            over_noise(&sum.rate, noise.gyro_white),
        ];
        let [uv, vv] = [1, 2].map(|i| kinds[0][i] + kinds[1][i]);
        let slowest = 2.0 * (core::f64::consts::TAU * SLOWEST * dt).cos();
        // Of a window without any variance nothing is left either.
        let k = if vv > 0.0 {
            (uv / vv).clamp(-2.0, slowest)
        } else {
            0.0
        };
        // What s − k x has of the noise, against x alone.
        let gain = 2.0 + 2.0 * far - 4.0 * k * near + k * k;
        Some(kinds.map(|[uu, uv, vv]| (uu - 2.0 * k * uv + k * k * vv).max(0.0) / gain.max(1e-6)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::StationaryConfig;
    use nalgebra::Vector6;

    /// LPMV and LPGV of two seconds: plain, and of what a tone leaves.
    fn of(rate: f64, signal: impl Fn(f64) -> f64, white: f64) -> ([f64; 2], [f64; 2]) {
        let imu = crate::sim::StopSetting::noise();
        let noise = RestNoise::new(&StationaryConfig::default(), false, &imu);
        let mut low_pass = LowPass::new(rate);
        let mut tone = ToneWindow::default();
        let mut plain = super::super::Moments::default();
        let mut source = crate::sim::Source::new(3, crate::sim::Stream::AccelWhite);
        let mut open = 0;
        for i in 0..(4.0 * rate) as u32 {
            let t = f64::from(i) / rate;
            let mut draw = |density: f64, shake: f64| {
                source.normal3() * (density * rate.sqrt() * white) + Vector3::repeat(shake)
            };
            let force = draw(imu.accel_white, signal(t)) + Vector3::z() * -9.8;
            let rate_b = draw(imu.gyro_white, 0.01 * signal(t));
            let x = Vector6::from_iterator(force.iter().chain(rate_b.iter()).copied());
            let y = low_pass.push(&x);
            if t < 2.0 {
                continue;
            }
            let (force, rate_b) = (
                y.fixed_rows::<3>(0).into_owned(),
                y.fixed_rows::<3>(3).into_owned(),
            );
            tone.push(&force, &rate_b);
            plain.push(1.0 / rate, &force, &rate_b);
            open += 1;
            if open == (0.1 * rate) as u32 {
                tone.close(20);
                open = 0;
            }
        }
        let left = tone
            .variances(1.0 / rate, &noise, &low_pass)
            .expect("it is full");
        let plain = super::super::composite::variances(&plain, None, &noise, &low_pass);
        (plain, left)
    }

    /// Noise alone is left as it is, in the mean over axes and windows; a tone of many times its size is gone; what is slow, or
    /// two tones, is not.
    #[test]
    fn a_tone_is_gone_and_nothing_else_is() {
        use core::f64::consts::TAU;
        for rate in [30.0, 100.0, 200.0] {
            let (plain, left) = of(rate, |_| 0.0, 1.0);
            for (plain, left) in plain.iter().zip(left) {
                // A fitted cosine takes a few of some sixty degrees of freedom.
                assert!(
                    (0.6..1.4).contains(&(left / plain)),
                    "{rate}: {plain} {left}"
                );
            }
            for hertz in [2.7, 3.3, 4.5] {
                let (plain, left) = of(rate, |t| 0.5 * (TAU * hertz * t + 1.0).sin(), 1.0);
                assert!(plain[0] > 300.0, "{plain:?}");
                assert!(left[0] < 8.0, "{rate} {hertz}: {plain:?} {left:?}");
            }
            let (plain, left) = of(rate, |t| 0.5 * (TAU * 1.0 * t).sin(), 1.0);
            // Ten times what is let through (at rest 5 once in 10⁴). The slowest tone that is looked for takes a part of it.
            assert!(left[0] > 50.0, "{rate} sway: {plain:?} {left:?}");
            let (plain, left) = of(rate, |t| (TAU * 2.7 * t).sin() + (TAU * 4.5 * t).sin(), 1.0);
            assert!(left[0] > 50.0, "{rate} two: {plain:?} {left:?}");
        }
    }
}
