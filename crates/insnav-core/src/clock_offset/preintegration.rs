//! Inertial samples summed up before attitude, velocity and position are known.

use crate::attitude::{exp, skew};
use crate::sample::Sample;
use crate::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Spacing of the nodes that keep the sensitivities to biases, s. In between these go on with an even acceleration.
const SENSITIVITY_SPACING: f64 = 0.1;

/// Inertial samples of either kind as steps between stamps: angle and mean specific force over each.
pub(super) struct Steps {
    /// Stamps, s, ascending; one more than steps.
    pub(super) t: Vec<f64>,
    angle_b: Vec<Vector3<f64>>,
    force_b: Vec<Vector3<f64>>,
}

impl Steps {
    pub(super) fn new(samples: &[Sample], zero: Time) -> Self {
        let mut steps = Steps {
            t: Vec::new(),
            angle_b: Vec::new(),
            force_b: Vec::new(),
        };
        let mut previous: Option<(Vector3<f64>, Vector3<f64>)> = None;
        for sample in samples {
            let t = sample.time().since(zero);
            let dt = steps.t.last().map_or(f64::INFINITY, |last| t - last);
            // Duplicates and backward stamps: the earlier sample stands.
            if dt <= 0.0 {
                continue;
            }
            let (rate, force, is_increment) = match sample {
                Sample::Imu(s) => (s.angular_rate_b, s.specific_force_b, false),
                Sample::ImuIncrement(s) => (s.angle_b / dt, s.velocity_b / dt, true),
                _ => continue,
            };
            if !(rate.iter().chain(force.iter()).all(|x| x.is_finite())) {
                continue;
            }
            if let Some((rate0, force0)) = previous {
                let (mean_rate, mean_force) = if is_increment {
                    (rate, force)
                } else {
                    (0.5 * (rate + rate0), 0.5 * (force + force0))
                };
                steps.angle_b.push(mean_rate * dt);
                steps.force_b.push(mean_force);
            }
            steps.t.push(t);
            previous = Some((rate, force));
        }
        steps
    }

    /// How much the motion changes from `from` to `to`: summed squares of the specific force's second-long means about
    /// the mean of all, (m/s²)² s. Vibration averages out of it.
    pub(super) fn liveliness(&self, from: f64, to: f64) -> f64 {
        let (first, last) = self.range(from, to);
        let mut means = Vec::new();
        let mut sum = Vector3::zeros();
        let (mut count, mut begin) = (0, from);
        for i in first..last {
            sum += self.force_b[i];
            count += 1;
            if self.t[i + 1] - begin >= 1.0 {
                means.push(sum / f64::from(count));
                (sum, count, begin) = (Vector3::zeros(), 0, self.t[i + 1]);
            }
        }
        let mean = means.iter().sum::<Vector3<f64>>() / means.len().max(1) as f64;
        means.iter().map(|m| (m - mean).norm_squared()).sum()
    }

    /// The steps that cover `from` to `to`; an empty range when they do not.
    fn range(&self, from: f64, to: f64) -> (usize, usize) {
        let first = self.t.partition_point(|&t| t <= from);
        let last = self.t.partition_point(|&t| t < to);
        if first == 0 || last >= self.t.len() {
            (0, 0)
        } else {
            (first - 1, last)
        }
    }

    /// Longest step from `from` to `to`, s; infinite when the steps do not cover them.
    pub(super) fn longest(&self, from: f64, to: f64) -> f64 {
        let (first, last) = self.range(from, to);
        if first == last {
            return f64::INFINITY;
        }
        (first..last)
            .map(|i| self.t[i + 1] - self.t[i])
            .fold(0.0, f64::max)
    }
}

/// Attitude, velocity and displacement of a point of the body relative to the axes in which the body began, by inertial
/// samples alone: with gravity g and the initial state p, v, C it is p(t) = p + v t + C S(t) + ½ g t² (\[Forster17\] sec. VI,
/// with the bias sensitivities to first order).
pub(super) struct Preintegrated {
    t: Vec<f64>,
    /// Displacement S of the point, m, and its rate, m/s.
    s: Vec<Vector3<f64>>,
    rate: Vec<Vector3<f64>>,
    /// Specific force in the initial axes over the step that follows, m/s².
    force: Vec<Vector3<f64>>,
    sensitivity: Vec<Sensitivity>,
}

/// Derivative of the displacement by the biases.
#[derive(Clone, Copy)]
pub(super) struct Sensitivity {
    t: f64,
    /// By the gyro bias, m per rad/s.
    pub(super) gyro_bias: Matrix3<f64>,
    /// By the accelerometer bias, m per m/s².
    pub(super) accel_bias: Matrix3<f64>,
    /// How fast they grow.
    pub(super) gyro_bias_rate: Matrix3<f64>,
    pub(super) accel_bias_rate: Matrix3<f64>,
}

impl Preintegrated {
    /// From `from` to `to` for the point `lever_arm_b` of the body; the steps must cover the interval.
    ///
    /// The point's swing about the inertial unit comes from the first sample on, so its own displacement starts at C l.
    pub(super) fn new(steps: &Steps, from: f64, to: f64, lever_arm_b: &Vector3<f64>) -> Self {
        let (first, last) = steps.range(from, to);
        let mut out = Preintegrated {
            t: Vec::with_capacity(last - first),
            s: Vec::with_capacity(last - first),
            rate: Vec::with_capacity(last - first),
            force: Vec::with_capacity(last - first),
            sensitivity: Vec::new(),
        };
        let mut q = UnitQuaternion::identity();
        let (mut s, mut v) = (Vector3::zeros(), Vector3::zeros());
        // Integrals of the rotation and of [f×] times the first, once and twice.
        let (mut r1, mut r2) = (Matrix3::zeros(), Matrix3::zeros());
        let (mut b1, mut b2) = (Matrix3::zeros(), Matrix3::zeros());
        for i in first..last {
            let t = steps.t[i];
            let h = steps.t[i + 1] - t;
            let turn = exp(&steps.angle_b[i]);
            let next = q * turn;
            let middle = q * exp(&(0.5 * steps.angle_b[i]));
            let force = middle * steps.force_b[i];
            let arm = q * lever_arm_b;
            out.t.push(t);
            out.s.push(s + arm);
            out.rate.push(v + (next * lever_arm_b - arm) / h);
            out.force.push(force);
            if out
                .sensitivity
                .last()
                .is_none_or(|last| t - last.t >= SENSITIVITY_SPACING)
            {
                out.sensitivity.push(Sensitivity {
                    t,
                    gyro_bias: b2,
                    accel_bias: -r2,
                    gyro_bias_rate: b1,
                    accel_bias_rate: -r1,
                });
            }
            s += v * h + force * (0.5 * h * h);
            v += force * h;
            let rotation = middle.to_rotation_matrix().into_inner();
            let bend = skew(&force) * (r1 + rotation * (0.5 * h));
            b2 += b1 * h + bend * (0.5 * h * h);
            b1 += bend * h;
            r2 += r1 * h + rotation * (0.5 * h * h);
            r1 += rotation * h;
            q = next;
        }
        out.sensitivity.push(Sensitivity {
            t: steps.t[last],
            gyro_bias: b2,
            accel_bias: -r2,
            gyro_bias_rate: b1,
            accel_bias_rate: -r1,
        });
        out
    }

    /// Displacement of the point and its rate.
    pub(super) fn at(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let i = self.t.partition_point(|&x| x <= t).max(1) - 1;
        let u = t - self.t[i];
        (
            self.s[i] + self.rate[i] * u + self.force[i] * (0.5 * u * u),
            self.rate[i] + self.force[i] * u,
        )
    }

    /// Its derivatives by the biases.
    pub(super) fn sensitivity_at(&self, t: f64) -> Sensitivity {
        let i = self
            .sensitivity
            .partition_point(|s| s.t <= t)
            .clamp(1, self.sensitivity.len() - 1);
        let (a, b) = (&self.sensitivity[i - 1], &self.sensitivity[i]);
        let (u, k) = (t - a.t, 1.0 / (b.t - a.t));
        let go_on = |value: &Matrix3<f64>, rate: &Matrix3<f64>, next: &Matrix3<f64>| {
            let bend = (next - rate) * k;
            (value + (rate + bend * (0.5 * u)) * u, rate + bend * u)
        };
        let (gyro_bias, gyro_bias_rate) = go_on(&a.gyro_bias, &a.gyro_bias_rate, &b.gyro_bias_rate);
        let (accel_bias, accel_bias_rate) =
            go_on(&a.accel_bias, &a.accel_bias_rate, &b.accel_bias_rate);
        Sensitivity {
            t,
            gyro_bias,
            gyro_bias_rate,
            accel_bias,
            accel_bias_rate,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::ImuSample;

    /// Samples of a body that turns and is pushed about, with biases.
    fn samples(gyro_bias: &Vector3<f64>, accel_bias: &Vector3<f64>) -> Vec<Sample> {
        (0..1001)
            .map(|i| {
                let t = f64::from(i) * 0.01;
                Sample::Imu(ImuSample {
                    time: Time::from_seconds(t),
                    angular_rate_b: Vector3::new(
                        0.05 * (1.3 * t).sin(),
                        0.04 * t.cos(),
                        0.3 * (0.7 * t).sin(),
                    ) + gyro_bias,
                    specific_force_b: Vector3::new(
                        1.5 * (0.5 * t).cos(),
                        2.0 * (0.8 * t).sin(),
                        -9.8,
                    ) + accel_bias,
                })
            })
            .collect()
    }

    fn end(gyro_bias: Vector3<f64>, accel_bias: Vector3<f64>) -> (Vector3<f64>, Sensitivity) {
        let steps = Steps::new(&samples(&gyro_bias, &accel_bias), Time(0));
        let lever_arm = Vector3::zeros();
        let p = Preintegrated::new(&steps, 0.0, 9.99, &lever_arm);
        (p.at(9.0).0, p.sensitivity_at(9.0))
    }

    #[test]
    fn sensitivities_are_derivatives() {
        let zero = Vector3::zeros();
        let sensitivity = end(zero, zero).1;
        for k in 0..3 {
            let step: Vector3<f64> = 1e-5 * Vector3::ith(k, 1.0);
            // The estimate subtracts a bias, so that its displacement moves against it.
            let gyro = (end(-step, zero).0 - end(step, zero).0) / 2e-5;
            let accel = (end(zero, -step).0 - end(zero, step).0) / 2e-5;
            // Steps of 10 ms at 0.3 rad/s: the sums differ from each other's exact derivative by some (0.3·0.01)² of them.
            let tolerance = 1e-3;
            assert!(
                (gyro - sensitivity.gyro_bias.column(k)).norm() < tolerance * gyro.norm(),
                "{k}: {gyro}"
            );
            assert!(
                (accel - sensitivity.accel_bias.column(k)).norm() < tolerance * accel.norm(),
                "{k}: {accel}"
            );
        }
    }

    #[test]
    fn rate_is_the_derivative_of_the_displacement() {
        let steps = Steps::new(&samples(&Vector3::zeros(), &Vector3::zeros()), Time(0));
        let p = Preintegrated::new(&steps, 0.5, 9.5, &Vector3::new(0.4, -0.3, -1.2));
        for t in [1.003, 3.337, 7.77] {
            let slope = (p.at(t + 1e-4).0 - p.at(t - 1e-4).0) / 2e-4;
            assert!((slope - p.at(t).1).norm() < 1e-3, "{t}");
        }
    }
}
