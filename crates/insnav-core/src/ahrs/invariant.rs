//! The invariant scheme of \[Belokurov18\], in its corrected form.

use crate::attitude::{exp, skew};
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Matrix6, Quaternion, SMatrix, UnitQuaternion, Vector3};

/// The axes in which the error of attitude is resolved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorAxes {
    /// Body: true = q̂ ⊗ (1, e), as in the paper. Ω is in the transition, and noise that is the same in n turns with the body.
    Body,
    /// Navigation: true = (1, e) ⊗ q̂. No Ω: the transition depends on the attitude only by where a gyro's bias points, and what
    /// is the same on all axes stays so while the body turns, as autocovariance least squares needs it.
    Navigation,
}

/// White noise of the scheme, by states: covariance of one step, and of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InvariantNoise {
    /// Of the whole state in a step, G Q Gᵀ: (half angles, gyro biases), rad², rad²/s and (rad/s)².
    pub process: Matrix6<f64>,
    /// Of the measured half angles, rad².
    pub measured: Matrix3<f64>,
}

impl InvariantNoise {
    /// From variances of angles: of attitude in a step (rad²) and as measured (rad²), along the axes of the error, and of a gyro's
    /// bias in a step, (rad/s)². Half an angle has a quarter of its variance.
    pub fn of_angles(attitude: &Vector3<f64>, bias: f64, measured: &Vector3<f64>) -> Self {
        let mut process = Matrix6::zeros();
        for i in 0..3 {
            process[(i, i)] = 0.25 * attitude[i];
            process[(i + 3, i + 3)] = bias;
        }
        InvariantNoise {
            process,
            measured: Matrix3::from_diagonal(&(measured * 0.25)),
        }
    }
}

/// Transition of (e, δb) over a step of `step_s`, at a constant rate (body, rad/s), from an attitude q_nb at its begin.
///
/// ```text
/// body:        ė = −ω × e − ½ δb        F = [ Exp(−ω T)   −½ ∫ Exp(−ω t) dt ]
///                                           [     0               φ I       ]
/// navigation:  ė = −½ C δb              F = [ I   −½ C ∫ Exp(ω t) dt ]        φ = e^(−T/τ)
///                                           [ 0          φ I         ]
/// ```
///
/// δb = true − estimate of the gyro's bias, which is subtracted from the rate. The integrals are to third order in ω T, and φ
/// in them is one: T/τ of a bias' part, below 1e-3. The paper's F has identity at the lower left, a bias driven by attitude;
/// half of each element of the upper row; and + ω ×, which is no kinematics of either error.
pub fn error_transition(
    axes: ErrorAxes,
    rate_b: &Vector3<f64>,
    q_nb: &UnitQuaternion<f64>,
    step_s: f64,
    bias_time_s: f64,
) -> Matrix6<f64> {
    let turn = rate_b * step_s;
    let k = skew(&turn);
    let (attitude, by_bias) = match axes {
        ErrorAxes::Body => (
            exp(&-turn).to_rotation_matrix().into_inner(),
            Matrix3::identity() - k * 0.5 + k * k / 6.0,
        ),
        ErrorAxes::Navigation => (
            Matrix3::identity(),
            q_nb.to_rotation_matrix().into_inner() * (Matrix3::identity() + k * 0.5 + k * k / 6.0),
        ),
    };
    let mut f = Matrix6::identity();
    f.fixed_view_mut::<3, 3>(0, 0).copy_from(&attitude);
    f.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(by_bias * (-0.5 * step_s)));
    f.fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(Matrix3::identity() * (-step_s / bias_time_s).exp()));
    f
}

/// Gyros integrated to a quaternion, corrected by the quaternion of accelerometer and magnetometer through a filter of six error
/// states: vector part of the error quaternion (half angles), and gyro biases.
///
/// The state is taken into attitude and bias after each update (closed loop), so that only its covariance is kept: the paper
/// adds up its estimates beside the quaternion, which is the same to first order.
///
/// ```
/// use insnav_core::ahrs::{ErrorAxes, InvariantFilter, InvariantNoise, measured_attitude};
/// use nalgebra::Vector3;
/// let (force, field) = (Vector3::new(0.0, 0.0, -9.81), Vector3::new(2e-5, 0.0, 4.5e-5));
/// let start = measured_attitude(&force, &field).expect("both have a direction");
/// let noise = InvariantNoise::of_angles(&Vector3::repeat(1e-8), 1e-12, &Vector3::repeat(4e-6));
/// let mut filter = InvariantFilter::new(ErrorAxes::Navigation, start, 4e-6, 1e-4);
/// for _ in 0..1000 {
///     // A gyro that is off by 0.01 rad/s about the forward axis, at rest.
///     filter.propagate(&Vector3::new(0.01, 0.0, 0.0), 0.032, &noise.process);
///     let measured = measured_attitude(&force, &field).expect("both have a direction");
///     filter.update(&filter.error_of(&measured), [true; 3], &noise.measured);
/// }
/// assert!((filter.gyro_bias_b.x - 0.01).abs() < 1e-4 && filter.q_nb.angle() < 1e-3);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct InvariantFilter {
    /// Body to navigation.
    pub q_nb: UnitQuaternion<f64>,
    /// Bias of the gyros, rad/s: measured = true + bias.
    pub gyro_bias_b: Vector3<f64>,
    /// Of (e, δb).
    pub covariance: Matrix6<f64>,
    /// Gain of the last update.
    pub gain: SMatrix<f64, 6, 3>,
    /// τ of the Gauss–Markov biases, s; infinite for a random walk. Finite only for gyros whose bias is about zero.
    pub bias_time_s: f64,
    axes: ErrorAxes,
}

impl InvariantFilter {
    /// A filter at an attitude whose angles have the variance `attitude` (rad²), with biases about zero of variance `bias`
    /// ((rad/s)²) that walk at random.
    pub fn new(axes: ErrorAxes, q_nb: UnitQuaternion<f64>, attitude: f64, bias: f64) -> Self {
        let mut covariance = Matrix6::zeros();
        for i in 0..3 {
            covariance[(i, i)] = 0.25 * attitude;
            covariance[(i + 3, i + 3)] = bias;
        }
        InvariantFilter {
            q_nb,
            gyro_bias_b: Vector3::zeros(),
            covariance,
            gain: SMatrix::zeros(),
            bias_time_s: f64::INFINITY,
            axes,
        }
    }

    /// Move on by a step of `step_s` at the measured rate (mean of the step, rad/s), with the noise `process` of the state.
    pub fn propagate(&mut self, rate_b: &Vector3<f64>, step_s: f64, process: &Matrix6<f64>) {
        let rate = rate_b - self.gyro_bias_b;
        let f = error_transition(self.axes, &rate, &self.q_nb, step_s, self.bias_time_s);
        self.q_nb *= exp(&(rate * step_s));
        self.gyro_bias_b *= (-step_s / self.bias_time_s).exp();
        let p = f * self.covariance * f.transpose() + process;
        self.covariance = (p + p.transpose()) * 0.5;
    }

    /// e of a measured attitude: vector part of q̂* ⊗ q_AS (body) or q_AS ⊗ q̂* (navigation), of the half with positive scalar.
    pub fn error_of(&self, measured_q_nb: &UnitQuaternion<f64>) -> Vector3<f64> {
        let error = match self.axes {
            ErrorAxes::Body => self.q_nb.inverse() * measured_q_nb,
            ErrorAxes::Navigation => measured_q_nb * self.q_nb.inverse(),
        };
        error.imag() * if error.w < 0.0 { -1.0 } else { 1.0 }
    }

    /// Covariance of an innovation in half angles.
    pub fn innovation_covariance(&self, measured: &Matrix3<f64>) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0) + measured
    }

    /// Correct by measured half angles e (rad); what is not `used` changes nothing, whatever it is.
    ///
    /// With navigation axes the first two are the tilt and the third is the heading; with body axes all go together.
    /// An innovation covariance that is not positive definite corrects nothing.
    pub fn update(&mut self, error: &Vector3<f64>, used: [bool; 3], measured: &Matrix3<f64>) {
        let mut s = self.innovation_covariance(measured);
        let mut across: SMatrix<f64, 6, 3> = self.covariance.fixed_view::<6, 3>(0, 0).into_owned();
        let mut seen = *error;
        for i in (0..3).filter(|i| !used[*i]) {
            s.row_mut(i).fill(0.0);
            s.column_mut(i).fill(0.0);
            s[(i, i)] = 1.0;
            across.column_mut(i).fill(0.0);
            seen[i] = 0.0;
        }
        let Some(factor) = s.cholesky() else {
            return;
        };
        self.gain = factor.solve(&across.transpose()).transpose();
        let correction = self.gain * seen;
        let p = self.covariance - self.gain * across.transpose();
        self.covariance = (p + p.transpose()) * 0.5;
        let e: Vector3<f64> = correction.fixed_rows::<3>(0).into_owned();
        // (√(1 − e²), e): exactly the inverse of `error_of`.
        let scalar = (1.0 - e.norm_squared()).max(0.0).sqrt();
        let turn = UnitQuaternion::new_normalize(Quaternion::from_parts(scalar, e));
        self.q_nb = match self.axes {
            ErrorAxes::Body => self.q_nb * turn,
            ErrorAxes::Navigation => turn * self.q_nb,
        };
        self.q_nb.renormalize_fast();
        self.gyro_bias_b += correction.fixed_rows::<3>(3);
    }

    /// One sigma of roll and pitch taken together: root of half the trace over the two axes that tilt, rad. Navigation axes.
    pub fn tilt_sigma(&self) -> f64 {
        // Half angles: twice.
        2.0 * (0.5 * (self.covariance[(0, 0)] + self.covariance[(1, 1)])).sqrt()
    }

    /// One sigma of the bias of the gyros about the axes that tilt (north and east), root of the mean of both, rad/s. That about the
    /// vertical is known by the heading alone.
    pub fn tilt_rate_sigma(&self) -> f64 {
        let c = self.q_nb.to_rotation_matrix();
        let bias = c.matrix() * self.covariance.fixed_view::<3, 3>(3, 3) * c.matrix().transpose();
        (0.5 * (bias[(0, 0)] + bias[(1, 1)])).sqrt()
    }

    /// Doubt attitude and bias: add variances of tilt and heading (angles, rad²) and of the biases ((rad/s)²). Navigation axes.
    pub fn doubt(&mut self, tilt: f64, heading: f64, bias: f64) {
        for (i, variance) in [tilt, tilt, heading].into_iter().enumerate() {
            self.covariance[(i, i)] += 0.25 * variance;
            self.covariance[(i + 3, i + 3)] += bias;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Euler, log};

    const AXES: [ErrorAxes; 2] = [ErrorAxes::Body, ErrorAxes::Navigation];
    const RATE: Vector3<f64> = Vector3::new(0.3, -0.5, 0.7);

    fn attitude() -> UnitQuaternion<f64> {
        Euler::from_degrees(20.0, -30.0, 110.0).to_quaternion()
    }

    fn turned(axes: ErrorAxes, q: UnitQuaternion<f64>, half: &Vector3<f64>) -> UnitQuaternion<f64> {
        match axes {
            ErrorAxes::Body => q * exp(&(half * 2.0)),
            ErrorAxes::Navigation => exp(&(half * 2.0)) * q,
        }
    }

    /// E2, E3, E4: F is the derivative of what attitude and bias do, in both axes.
    #[test]
    fn transition_is_the_derivative_of_the_kinematics() {
        let (step, tau, small) = (0.032, 50.0f64, 1e-5);
        let decay = (-step / tau).exp();
        for axes in AXES {
            let q = attitude();
            let next = q * exp(&(RATE * step));
            let f = error_transition(axes, &RATE, &q, step, tau);
            for i in 0..6 {
                // Central differences of truth about an estimate whose errors are nought.
                let moved = |sign: f64| {
                    let mut x = nalgebra::Vector6::zeros();
                    x[i] = sign * small;
                    let (e, b) = (x.fixed_rows::<3>(0).into_owned(), x.fixed_rows::<3>(3));
                    let truth = turned(axes, q, &e) * exp(&((RATE - b) * step));
                    let error = match axes {
                        ErrorAxes::Body => next.inverse() * truth,
                        ErrorAxes::Navigation => truth * next.inverse(),
                    };
                    let half = log(&error) * 0.5;
                    let b = b * decay;
                    nalgebra::Vector6::new(half.x, half.y, half.z, b.x, b.y, b.z)
                };
                let column = (moved(1.0) - moved(-1.0)) / (2.0 * small);
                // Fourth order of ω T = 0.03, and the differences' own 1e-10.
                assert!(
                    (column - f.column(i)).amax() < 1e-7,
                    "{axes:?} {i}: {column} {}",
                    f.column(i)
                );
            }
        }
    }

    /// E1: no bias is driven by an attitude.
    #[test]
    fn lower_left_block_is_zero() {
        for axes in AXES {
            let f = error_transition(axes, &RATE, &attitude(), 0.032, 50.0);
            assert_eq!(f.fixed_view::<3, 3>(3, 0), Matrix3::zeros());
        }
    }

    /// E2, E3: the paper's F as printed is another one: half in each element, and of the wrong sign.
    #[test]
    fn printed_transition_is_not_the_derivative() {
        let (step, tau) = (0.032, 50.0);
        let f = error_transition(ErrorAxes::Body, &RATE, &attitude(), step, tau);
        let first_order =
            |s: f64, share: f64| Matrix3::identity() + skew(&RATE) * (s * step * share);
        let block = f.fixed_view::<3, 3>(0, 0).into_owned();
        let second = (RATE.norm() * step).powi(2);
        assert!((block - first_order(-1.0, 1.0)).amax() < second);
        assert!((block - first_order(1.0, 0.5)).amax() > 10.0 * second);
        // −T/2 and φ = 1 − T/τ, where the paper has T/4 and 1 − T/(2τ).
        assert!((f[(0, 3)] + step / 2.0).abs() < 1e-2 * step);
        assert!((f[(3, 3)] - (1.0 - step / tau)).abs() < 1e-6);
    }

    /// E2, E4: a bias of +1 °/s about x that is not known turns the truth by −1° about body x in one second, and e is half of it.
    #[test]
    fn one_degree_a_second_for_a_second_is_one_degree() {
        let bias = Vector3::new(1f64.to_radians(), 0.0, 0.0);
        for axes in AXES {
            let truth = attitude();
            let mut filter = InvariantFilter::new(axes, truth, 1e-6, 1e-4);
            for _ in 0..100 {
                // At rest: the gyro says its bias.
                filter.propagate(&bias, 0.01, &Matrix6::zeros());
            }
            let e = filter.error_of(&truth);
            let expected = match axes {
                ErrorAxes::Body => Vector3::new(-0.5f64.to_radians(), 0.0, 0.0),
                ErrorAxes::Navigation => truth * Vector3::new(-0.5f64.to_radians(), 0.0, 0.0),
            };
            // Vector part of half a degree for the half degree itself: 1e-5 of it.
            assert!(
                (e - expected).norm() < 2e-5 * expected.norm(),
                "{axes:?} {e}"
            );
            // The same through F: δb = true − estimate = bias.
            let mut x = nalgebra::Vector6::zeros();
            x.fixed_rows_mut::<3>(3).copy_from(&bias);
            for _ in 0..100 {
                x = error_transition(axes, &Vector3::zeros(), &truth, 0.01, f64::INFINITY) * x;
            }
            assert!((x.fixed_rows::<3>(0) - expected).norm() < 1e-12, "{axes:?}");
        }
    }

    /// E5: the exponential keeps the norm and the angle; the paper's I + Ω T/2 neither.
    #[test]
    fn attitude_is_integrated_exactly_at_a_constant_rate() {
        let rate = Vector3::new(0.0, 0.0, 40f64.to_radians());
        let mut filter = InvariantFilter::new(ErrorAxes::Body, attitude(), 1e-6, 0.0);
        let mut printed = attitude().into_inner();
        for _ in 0..1000 {
            filter.propagate(&rate, 0.032, &Matrix6::zeros());
            printed += printed * Quaternion::from_parts(0.0, rate * 0.016);
        }
        let exact = attitude() * exp(&(rate * 32.0));
        assert!(log(&(filter.q_nb * exact.inverse())).norm() < 1e-12);
        assert!(printed.norm() > 1.05, "{}", printed.norm());
    }

    /// Both forms are one filter to first order where noise is the same on all axes.
    #[test]
    fn body_and_navigation_axes_are_the_same_filter() {
        let noise =
            InvariantNoise::of_angles(&Vector3::repeat(1e-8), 1e-12, &Vector3::repeat(4e-6));
        let bias = Vector3::new(0.01, -0.02, 0.005);
        let mut filters = AXES.map(|axes| InvariantFilter::new(axes, attitude(), 4e-6, 1e-4));
        let mut truth = attitude();
        for k in 0..2000 {
            let t = f64::from(k) * 0.032;
            let rate = RATE * (0.7 * t).sin();
            truth *= exp(&(rate * 0.032));
            let wobble = Vector3::new((3.1 * t).sin(), (2.3 * t).cos(), (5.0 * t).sin()) * 2e-3;
            let measured = exp(&wobble) * truth;
            for filter in &mut filters {
                filter.propagate(&(rate + bias), 0.032, &noise.process);
                filter.update(&filter.error_of(&measured), [true; 3], &noise.measured);
            }
        }
        let apart = log(&(filters[0].q_nb * filters[1].q_nb.inverse())).norm();
        let error = log(&(filters[1].q_nb * truth.inverse())).norm();
        assert!(apart < 1e-3 * error, "{apart} {error}");
        for filter in &filters {
            assert!(
                (filter.gyro_bias_b - bias).norm() < 1e-3,
                "{}",
                filter.gyro_bias_b
            );
        }
    }

    #[test]
    fn what_is_not_used_changes_nothing() {
        let noise =
            InvariantNoise::of_angles(&Vector3::repeat(1e-8), 1e-12, &Vector3::repeat(4e-6));
        let start = InvariantFilter::new(ErrorAxes::Navigation, attitude(), 4e-6, 1e-4);
        let (mut one, mut other) = (start.clone(), start.clone());
        one.update(
            &Vector3::new(1e-3, 2e-3, 0.5),
            [true, true, false],
            &noise.measured,
        );
        other.update(
            &Vector3::new(1e-3, 2e-3, f64::NAN),
            [true, true, false],
            &noise.measured,
        );
        assert_eq!(one, other);
        assert_eq!(one.covariance[(2, 2)], start.covariance[(2, 2)]);
        assert!(one.covariance[(0, 0)] < start.covariance[(0, 0)]);
        // Heading alone leaves the tilt.
        let mut heading = start.clone();
        heading.update(
            &Vector3::new(1.0, 1.0, 1e-3),
            [false, false, true],
            &noise.measured,
        );
        let turn = log(&(heading.q_nb * start.q_nb.inverse()));
        assert!(turn.xy().norm() < 1e-15 && turn.z > 0.0);
    }

    /// E8, and what the covariance claims: NEES of six states over runs of the model itself.
    #[test]
    fn covariance_is_that_of_the_errors() {
        use crate::sim::{Source, Stream};
        let (q, r, qb) = (1e-8f64, 4e-6f64, 1e-12f64);
        let noise = InvariantNoise::of_angles(&Vector3::repeat(q), qb, &Vector3::repeat(r));
        for axes in AXES {
            let (mut sum, runs) = (0.0, 400);
            for seed in 0..runs {
                let mut gyro = Source::new(seed, Stream::GyroWhite);
                let mut wander = Source::new(seed, Stream::GyroBias);
                let mut white = Source::new(seed, Stream::AccelWhite);
                let mut truth = attitude();
                let mut bias = wander.normal3() * 1e-2;
                let start = exp(&(white.normal3() * r.sqrt())) * truth;
                let mut filter = InvariantFilter::new(axes, start, r, 1e-4);
                for _ in 0..200 {
                    truth *= exp(&(RATE * 0.032));
                    let measured_rate = RATE + bias + gyro.normal3() * (q.sqrt() / 0.032);
                    filter.propagate(&measured_rate, 0.032, &noise.process);
                    bias += wander.normal3() * qb.sqrt();
                    let seen = exp(&(white.normal3() * r.sqrt())) * truth;
                    filter.update(&filter.error_of(&seen), [true; 3], &noise.measured);
                }
                let e = filter.error_of(&truth);
                let b = bias - filter.gyro_bias_b;
                let x = nalgebra::Vector6::new(e.x, e.y, e.z, b.x, b.y, b.z);
                let inverse = filter.covariance.cholesky().expect("positive definite");
                sum += x.dot(&inverse.solve(&x)) / 6.0;
            }
            let nees = sum / runs as f64;
            // Mean of 2400 squares: ± 4 √(2/2400).
            assert!((nees - 1.0).abs() < 0.116, "{axes:?} {nees}");
        }
    }
}
