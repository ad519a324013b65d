//! The last stretch of inertial data, as a ring of sums: fixed memory at any sampling rate.

use crate::imu::STANDARD_GRAVITY;
use heapless::Deque;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Sums over a stretch of inertial samples: all that the detectors need.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// Samples.
    pub count: f64,
    /// Time that they stand for, s.
    pub span: f64,
    /// Σf, m/s².
    pub force: Vector3<f64>,
    /// Σ|f|².
    pub force_square: f64,
    /// Σ(|f| − g)².
    pub force_excess_square: f64,
    /// Σω, rad/s.
    pub rate: Vector3<f64>,
    /// Σ|ω|².
    pub rate_square: f64,
}

impl Moments {
    /// Take a reading of specific force and rate that stands for `dt` seconds.
    pub fn push(&mut self, dt: f64, force: &Vector3<f64>, rate: &Vector3<f64>) {
        let square = force.norm_squared();
        self.count += 1.0;
        self.span += dt;
        self.force += force;
        self.force_square += square;
        self.force_excess_square += (square.sqrt() - STANDARD_GRAVITY).powi(2);
        self.rate += rate;
        self.rate_square += rate.norm_squared();
    }

    /// Of one reading.
    pub(super) fn of(dt: f64, force: &Vector3<f64>, rate: &Vector3<f64>) -> Self {
        let mut one = Moments::default();
        one.push(dt, force, rate);
        one
    }

    /// Sums of both.
    pub(super) fn add(&mut self, other: &Moments) {
        self.count += other.count;
        self.span += other.span;
        self.force += other.force;
        self.force_square += other.force_square;
        self.force_excess_square += other.force_excess_square;
        self.rate += other.rate;
        self.rate_square += other.rate_square;
    }

    /// Mean interval, s.
    pub fn dt(&self) -> f64 {
        self.span / self.count.max(1.0)
    }

    /// Mean specific force, m/s².
    pub fn mean_force(&self) -> Vector3<f64> {
        self.force / self.count.max(1.0)
    }

    /// Mean rate, rad/s.
    pub fn mean_rate(&self) -> Vector3<f64> {
        self.rate / self.count.max(1.0)
    }

    /// Mean of |f − `about`|², all axes together.
    pub fn force_spread(&self, about: &Vector3<f64>) -> f64 {
        let n = self.count.max(1.0);
        spread(n, self.force_square, &self.force, about)
    }

    /// Mean of |ω − `about`|², likewise.
    pub fn rate_spread(&self, about: &Vector3<f64>) -> f64 {
        let n = self.count.max(1.0);
        spread(n, self.rate_square, &self.rate, about)
    }
}

/// About the mean first, so that no more than one cancellation meets what is left.
fn spread(n: f64, square: f64, sum: &Vector3<f64>, about: &Vector3<f64>) -> f64 {
    let mean = sum / n;
    (square / n - mean.norm_squared()).max(0.0) + (mean - about).norm_squared()
}

/// A window moves on by one part in this many.
pub(super) const PARTS: f64 = 20.0;
/// Room for intervals that do not divide a part.
const CAPACITY: usize = 32;

/// The last stretch of a given length.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Window {
    length: f64,
    parts: Deque<Moments, CAPACITY>,
    open: Moments,
}

impl Window {
    /// Of this many seconds.
    pub(super) fn new(length: f64) -> Self {
        Window {
            length,
            parts: Deque::new(),
            open: Moments::default(),
        }
    }

    /// Start anew.
    pub(super) fn clear(&mut self) {
        self.parts.clear();
        self.open = Moments::default();
    }

    /// Take the sums over one reading, which two windows share; true when the window has moved on by a part.
    pub(super) fn push(&mut self, one: &Moments) -> bool {
        let dt = one.span;
        self.open.add(one);
        if self.open.span + 0.5 * dt < self.length / PARTS {
            return false;
        }
        let part = core::mem::take(&mut self.open);
        let mut span = part.span + self.parts.iter().map(|p| p.span).sum::<f64>();
        while let Some(oldest) = self.parts.front()
            && (self.parts.is_full() || span - oldest.span >= self.length - 0.5 * dt)
        {
            span -= oldest.span;
            self.parts.pop_front();
        }
        // There is room: a full ring has just lost its oldest part.
        let _ = self.parts.push_back(part);
        true
    }

    /// The part that was added last.
    pub(super) fn parts(&self) -> usize {
        self.parts.len()
    }

    pub(super) fn newest(&self) -> Option<&Moments> {
        self.parts.back()
    }

    /// The sums, once the window is full.
    pub(super) fn moments(&self) -> Option<Moments> {
        let mut sum = Moments::default();
        for part in &self.parts {
            sum.add(part);
        }
        // A part more or less than the length is of no importance to what is made of it.
        (sum.span >= self.length * (1.0 - 1.5 / PARTS)).then_some(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(i: i32) -> (Vector3<f64>, Vector3<f64>) {
        let t = f64::from(i);
        (
            Vector3::new(
                (0.7 * t).sin(),
                (1.1 * t).cos(),
                -9.8 + 0.3 * (0.3 * t).sin(),
            ),
            Vector3::new((0.9 * t).cos(), 0.2, (0.2 * t).sin()) * 0.01,
        )
    }

    /// Against sums over the raw samples themselves, at rates from 10 Hz to 1 kHz.
    #[test]
    fn sums_are_those_of_the_last_samples_at_any_rate() {
        for (rate, length) in [
            (10.0, 2.0),
            (30.0, 2.0),
            (77.0, 0.2),
            (100.0, 1.0),
            (250.0, 0.1),
            (1000.0, 2.0),
        ] {
            let dt = 1.0 / rate;
            let mut window = Window::new(length);
            let mut moved = 0;
            for i in 0..5000 {
                let (force, rate_b) = reading(i);
                if !window.push(&Moments::of(dt, &force, &rate_b)) {
                    continue;
                }
                moved += 1;
                let Some(m) = window.moments() else {
                    continue;
                };
                assert!(
                    (m.span - length).abs() <= length / PARTS + 1.01 * dt,
                    "{rate}: {}",
                    m.span
                );
                let mut direct = Moments::default();
                for j in i + 1 - m.count as i32..=i {
                    let (force, rate_b) = reading(j);
                    direct.push(dt, &force, &rate_b);
                }
                assert!((m.force - direct.force).amax() < 1e-9);
                let mean = direct.mean_force();
                assert!((m.force_spread(&mean) - direct.force_spread(&mean)).abs() < 1e-9);
                assert!((m.rate_square - direct.rate_square).abs() < 1e-12);
                assert!((m.force_excess_square - direct.force_excess_square).abs() < 1e-9);
            }
            assert!(moved >= 50, "{rate}");
            window.clear();
            assert!(window.moments().is_none());
        }
    }

    /// The identity behind both: Σ|x − c|² = Σ|x − x̄|² + N|x̄ − c|².
    #[test]
    fn spread_about_any_point_is_that_of_the_samples() {
        let mut m = Moments::default();
        let about = Vector3::new(0.1, -0.2, -9.0);
        let mut direct = 0.0;
        for i in 0..50 {
            let (force, rate) = reading(i);
            m.push(0.01, &force, &rate);
            direct += (force - about).norm_squared() / 50.0;
        }
        assert!((m.force_spread(&about) - direct).abs() < 1e-12);
    }
}
