//! Inertial samples to increments with coning and sculling.

use crate::imu::ImuErrors;
use crate::sample::{ImuIncrement, ImuSample};
use crate::time::Time;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// What the body did over one interval, as constant rate and constant body-frame force.
///
/// Coning and sculling are already inside, so that `Exp(rotation_b)` is the whole rotation and
/// `left_jacobian(rotation_b) * velocity_b` the whole velocity gain in the axes at the interval's begin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Increment {
    /// End of the interval.
    pub time: Time,
    /// Length of the interval, s.
    pub dt: f64,
    /// Rotation vector of the body against inertial space, rad.
    pub rotation_b: Vector3<f64>,
    /// Velocity increment of specific force, m/s, in the axes of the turning body (rotation not yet applied).
    pub velocity_b: Vector3<f64>,
}

impl Increment {
    /// Cut at an instant inside the interval: (up to `time`, the rest).
    ///
    /// Head and tail together move a [`super::NavState`] to where the whole moves it, up to the Earth's own motion within
    /// the interval. An instant outside is clamped to the interval.
    pub fn split_at(&self, time: Time) -> (Increment, Increment) {
        let tail_dt = self.time.since(time).clamp(0.0, self.dt);
        let head_dt = self.dt - tail_dt;
        let part = |end: Time, dt: f64| {
            let share = if self.dt > 0.0 { dt / self.dt } else { 0.0 };
            Increment {
                time: end,
                dt,
                rotation_b: self.rotation_b * share,
                velocity_b: self.velocity_b * share,
            }
        };
        (
            part(self.time.plus(-tail_dt), head_dt),
            part(self.time, tail_dt),
        )
    }

    /// The same interval with constant sensor errors taken out.
    #[must_use]
    pub fn corrected(&self, errors: &ImuErrors) -> Self {
        let mut rotation_b = self.rotation_b - errors.gyro_bias * self.dt;
        let mut velocity_b = self.velocity_b - errors.accel_bias * self.dt;
        if errors.has_scale() {
            rotation_b.component_div_assign(&errors.gyro_scale.add_scalar(1.0));
            velocity_b.component_div_assign(&errors.accel_scale.add_scalar(1.0));
        }
        Increment {
            rotation_b,
            velocity_b,
            ..*self
        }
    }
}

/// Turns inertial samples, one after the other, into [`Increment`]s.
///
/// Rates are taken as instantaneous and linear in between. The corrections are the two-sample ones: coning
/// ½∫α×dα (\[Savage98a\] eq. 47 and following) and sculling ½∫(α×dν − dα×ν) (\[Savage98b\] eq. 21 and following), each exact
/// for motion that is linear in time over the two intervals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct IncrementBuilder {
    last: Option<Last>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Last {
    time: Time,
    /// Rate and force at the end, when they are what is measured.
    rates: Option<(Vector3<f64>, Vector3<f64>)>,
    /// The last interval's raw increments and length, when these are what is measured.
    increments: Option<(Vector3<f64>, Vector3<f64>, f64)>,
}

impl IncrementBuilder {
    /// Stamp of the newest sample taken.
    pub fn time(&self) -> Option<Time> {
        self.last.map(|l| l.time)
    }

    /// Take a sample of rates; the increment since the previous sample, if there was one.
    pub fn push(&mut self, sample: &ImuSample) -> Option<Increment> {
        let (w1, f1) = (sample.angular_rate_b, sample.specific_force_b);
        let last = self.last.replace(Last {
            time: sample.time,
            rates: Some((w1, f1)),
            increments: None,
        })?;
        let dt = sample.time.since(last.time);
        let Some((w0, f0)) = last.rates else {
            // The source changed from increments to rates: no rate at the begin.
            return Some(Increment {
                time: sample.time,
                dt,
                rotation_b: w1 * dt,
                velocity_b: f1 * dt,
            });
        };
        // Trapezoid, and the exact second-order terms of linear rate and force: dt²/12 (ω₀×ω₁), dt²/12 (ω₀×f₁ + f₀×ω₁).
        let k = dt * dt / 12.0;
        Some(Increment {
            time: sample.time,
            dt,
            rotation_b: (w0 + w1) * (0.5 * dt) + w0.cross(&w1) * k,
            velocity_b: (f0 + f1) * (0.5 * dt) + (w0.cross(&f1) + f0.cross(&w1)) * k,
        })
    }

    /// Take a sample of increments; with the first one only its stamp is used, since its length is not known.
    pub fn push_increment(&mut self, sample: &ImuIncrement) -> Option<Increment> {
        let (a1, v1) = (sample.angle_b, sample.velocity_b);
        let last = self.last.take();
        let dt = last.map(|l| sample.time.since(l.time));
        self.last = Some(Last {
            time: sample.time,
            rates: None,
            increments: dt.map(|dt| (a1, v1, dt)),
        });
        let dt = dt?;
        let mut increment = Increment {
            time: sample.time,
            dt,
            rotation_b: a1,
            velocity_b: v1,
        };
        if let Some((a0, v0, dt0)) = last.and_then(|l| l.increments) {
            // Rates linear through both intervals; lengths may differ: for equal ones the factor is 1/12.
            let k = dt / (6.0 * (dt0 + dt)) * (dt / dt0);
            increment.rotation_b += a0.cross(&a1) * k;
            increment.velocity_b += (a0.cross(&v1) + v0.cross(&a1)) * k;
        }
        Some(increment)
    }

    /// Forget what came before, as after a gap: the next sample only begins an interval.
    pub fn reset(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{exp, left_jacobian, log};
    use nalgebra::UnitQuaternion;

    const W: [Vector3<f64>; 2] = [Vector3::new(0.4, -0.3, 0.5), Vector3::new(-0.9, 2.1, 0.7)];
    const F: [Vector3<f64>; 2] = [Vector3::new(1.0, -2.0, -9.8), Vector3::new(5.0, 3.0, -4.0)];

    fn rate(t: f64) -> Vector3<f64> {
        W[0] + W[1] * t
    }
    fn force(t: f64) -> Vector3<f64> {
        F[0] + F[1] * t
    }

    /// Rotation and velocity in the axes at the begin, by many small midpoint steps.
    fn truth(from: f64, dt: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let n = 20_000;
        let h = dt / f64::from(n);
        let (mut q, mut v) = (UnitQuaternion::identity(), Vector3::zeros());
        for i in 0..n {
            let t = from + h * (f64::from(i) + 0.5);
            v += q * (exp(&(rate(t) * (0.5 * h))) * force(t)) * h;
            q *= exp(&(rate(t) * h));
        }
        (q, v)
    }

    fn errors(inc: &Increment, from: f64) -> (f64, f64) {
        let (q, v) = truth(from, inc.dt);
        let gain = left_jacobian(&inc.rotation_b) * inc.velocity_b;
        (
            log(&(q.inverse() * exp(&inc.rotation_b))).norm(),
            (gain - v).norm(),
        )
    }

    fn from_rates(dt: f64) -> Increment {
        let sample = |t: f64| ImuSample {
            time: Time::from_seconds(t),
            angular_rate_b: rate(t),
            specific_force_b: force(t),
        };
        let mut builder = IncrementBuilder::default();
        assert!(builder.push(&sample(1.0)).is_none());
        builder
            .push(&sample(1.0 + dt))
            .expect("second sample ends an interval")
    }

    fn from_increments(dt0: f64, dt: f64) -> Increment {
        let integral =
            |c: [Vector3<f64>; 2], a: f64, b: f64| c[0] * (b - a) + c[1] * (0.5 * (b * b - a * a));
        let (t0, t1, t2) = (1.0 - dt0, 1.0, 1.0 + dt);
        let sample = |a: f64, b: f64| ImuIncrement {
            time: Time::from_seconds(b),
            angle_b: integral(W, a, b),
            velocity_b: integral(F, a, b),
        };
        let mut builder = IncrementBuilder::default();
        assert!(builder.push_increment(&sample(t0 - 0.01, t0)).is_none());
        builder.push_increment(&sample(t0, t1));
        builder
            .push_increment(&sample(t1, t2))
            .expect("third sample has a predecessor with a length")
    }

    /// What is left is of fourth order or higher in dt: halving dt divides it by about 16 and more (8 would be third order).
    #[test]
    fn coning_and_sculling_remove_the_second_order_error() {
        type Make = fn(f64) -> Increment;
        let makes: [Make; 3] = [
            from_rates,
            |dt| from_increments(dt, dt),
            |dt| from_increments(0.7 * dt, dt),
        ];
        for make in makes {
            let (coarse, fine) = (errors(&make(0.08), 1.0), errors(&make(0.04), 1.0));
            assert!(coarse.0 / fine.0 > 12.0, "rotation {coarse:?} {fine:?}");
            assert!(coarse.1 / fine.1 > 12.0, "velocity {coarse:?} {fine:?}");
            // Negative control: without the corrections the error is far larger.
            let mut bare = make(0.04);
            let plain = |c: [Vector3<f64>; 2]| c[0] * 0.04 + c[1] * (0.5 * (1.04f64.powi(2) - 1.0));
            (bare.rotation_b, bare.velocity_b) = (plain(W), plain(F));
            let naive = errors(&bare, 1.0);
            assert!(
                naive.0 > 20.0 * fine.0 && naive.1 > 20.0 * fine.1,
                "{naive:?} {fine:?}"
            );
        }
    }

    #[test]
    fn parts_add_up_to_the_whole() {
        let whole = from_rates(0.04);
        for share in [0.0, 0.01, 0.3, 0.5, 1.0, 1.7, -0.4] {
            let at = Time::from_seconds(1.0 + 0.04 * share);
            let (head, tail) = whole.split_at(at);
            assert_eq!(tail.time, whole.time);
            assert!((head.dt + tail.dt - whole.dt).abs() < 1e-15);
            let q = exp(&head.rotation_b) * exp(&tail.rotation_b);
            assert!(
                q.angle_to(&exp(&whole.rotation_b)) < 1e-7,
                "angle_to resolves 1e-8"
            );
            assert!(log(&(q.inverse() * exp(&whole.rotation_b))).norm() < 1e-15);
            let v = left_jacobian(&head.rotation_b) * head.velocity_b
                + exp(&head.rotation_b) * (left_jacobian(&tail.rotation_b) * tail.velocity_b);
            assert!((v - left_jacobian(&whole.rotation_b) * whole.velocity_b).norm() < 1e-15);
        }
    }
}
