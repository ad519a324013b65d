//! What the errors of a start have to do with each other: one covariance of attitude and biases.
//!
//! Levelling (\[Groves13\] section 5.6.2) looks for the attitude Ĉ in which the mean specific force points up, Ĉ f̃ ∥ −g. With
//! f̃ = −Cᵀ g + M b_a + ν, where M is the mean rotation from the body while forces were averaged to that of the first sample (1 at
//! rest), and C = Exp(φ) Ĉ, this is to first order
//!
//! ```text
//! 0 = (φ × g + Ĉ (M b_a + ν))_level        φ_N = (Ĉ (M b_a + ν))_E / g        φ_E = −(Ĉ (M b_a + ν))_N / g
//! ```
//!
//! The bias that tilts the level is the very one that the filter estimates: tilt and bias are one error, but for ν. To a filter that
//! holds them for independent, the first velocity that stays zero is two looks at gravity, and its level becomes √2 too sure. A tilt
//! also turns the axis whose course the heading is, φ_D = ψ − tan θ (cos ψ₀ φ_N + sin ψ₀ φ_E) (attitude: Euler angles by φ).
//!
//! The mean rate at rest, w̃ = Cᵀ ω_ie + b_g + η, is used in one of two ways: the bias is what is left of it in the attitude that is
//! known, b̂_g = w̃ − Ĉᵀ ω_ie, or the heading is that in which it has no east component (\[Groves13\] section 5.6.2, gyrocompassing):
//!
//! ```text
//! δb_g = −Ĉᵀ [ω_ie ×] φ + η                 φ_D = ((Ĉ b_g)_E + φ_N ω_D) / ω_N + η'
//! ```

use crate::attitude::{Euler, skew};
use crate::earth::{Geodetic, LocalEarth};
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

/// Covariance of attitude (φ, n), gyro bias and accelerometer bias (b), in this order.
pub(super) type Joint = SMatrix<f64, 9, 9>;

/// The force that levels a start is used again by what tells that the body stands, or how fast it is: the noise of its mean is
/// widened by so much that its first use counts for a tenth. What the biases do to it is the same error both times, and is not widened.
pub(super) const USED_AGAIN: f64 = 3.0;
/// So long before a stop is held does a start at rest drift by rates that are rounded, s: the level must not tell that for a bias.
pub(super) const ROUNDED: f64 = 1.0;
/// A heading known no better than this, rad, is not turned by the level.
const VAGUE_HEADING: f64 = 0.5;
/// A body that points up more than this has no course that a tilt could turn (cosine of the pitch).
const UPRIGHT: f64 = 0.1;

/// What a mean rate at rest was used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rates {
    /// Nothing.
    Unused,
    /// The gyros' biases.
    Biases,
    /// The heading.
    North,
}

/// Where the errors of a start come from; what is named a sigma is independent of everything else.
#[derive(Clone, Copy, Debug)]
pub(super) struct Errors {
    /// Mean rotation by which accelerometer biases went into the level, to the body of the first sample; zero: they did not.
    pub(super) turned: Matrix3<f64>,
    /// Of the level, beside those biases, rad.
    pub(super) level_sigma: f64,
    /// Of the heading, beside what levels and gyros make of it, rad.
    pub(super) heading_sigma: f64,
    /// Of the gyro biases, beside what the attitude makes of them, rad/s.
    pub(super) gyro_sigma: Vector3<f64>,
    /// Of the accelerometer biases, m/s².
    pub(super) accel_sigma: f64,
    /// What the rates at rest have served.
    pub(super) rates: Rates,
}

impl Errors {
    /// The covariance of a start with this attitude at this place: L D Lᵀ with the independent sources in D, positive by construction.
    pub(super) fn joint(&self, q_nb: &UnitQuaternion<f64>, place: &Geodetic) -> Joint {
        let earth = LocalEarth::at(place);
        let (to_n, rate) = (q_nb.to_rotation_matrix().into_inner(), earth.earth_rate_n());
        let by_heading = Vector3::z();
        let sure = ties(self.heading_sigma);
        // Attitude by a tilt about north and east.
        let mut by_tilt = SMatrix::<f64, 3, 2>::identity();
        let mut by_gyro = Matrix3::zeros();
        match self.rates {
            Rates::North => {
                by_tilt[(2, 0)] = rate.z / rate.x;
                by_gyro.set_row(2, &(to_n.row(1) / rate.x));
            }
            // A heading that is unknown, or zero by definition, is that of the body's turn.
            Rates::Unused | Rates::Biases if sure => {
                let euler = Euler::from_quaternion(q_nb);
                let (s, c) = euler.heading.sin_cos();
                let tan = Some(euler.pitch.tan()).filter(|_| euler.pitch.cos() > UPRIGHT);
                let tan = tan.unwrap_or_default();
                (by_tilt[(2, 0)], by_tilt[(2, 1)]) = (-tan * c, -tan * s);
            }
            Rates::Unused | Rates::Biases => {}
        }
        // Tilts by a force that is wrong by a little, n.
        let leaning = SMatrix::<f64, 2, 3>::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0) / earth.gravity();
        let by_accel = by_tilt * leaning * to_n * self.turned;
        let bias_by_attitude = match self.rates {
            // A heading of zero is a definition: nothing is wrong by it.
            Rates::Biases if self.heading_sigma > 0.0 => -(to_n.transpose() * skew(&rate)),
            _ => Matrix3::zeros(),
        };

        // Sources: two tilts, heading, gyros, accelerometers.
        let mut l = Joint::zeros();
        l.fixed_view_mut::<3, 2>(0, 0).copy_from(&by_tilt);
        l.fixed_view_mut::<3, 1>(0, 2).copy_from(&by_heading);
        l.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_gyro);
        l.fixed_view_mut::<3, 3>(0, 6).copy_from(&by_accel);
        let attitude = l.fixed_view::<3, 9>(0, 0).into_owned();
        l.fixed_view_mut::<3, 9>(3, 0)
            .copy_from(&(bias_by_attitude * attitude));
        for i in 3..9 {
            l[(i, i)] += 1.0;
        }
        let sigma = SMatrix::<f64, 9, 1>::from_fn(|i, _| match i {
            0 | 1 => self.level_sigma,
            2 => self.heading_sigma,
            3..6 => self.gyro_sigma[i - 3],
            _ => self.accel_sigma,
        });
        let scaled = l * Joint::from_diagonal(&sigma);
        scaled * scaled.transpose()
    }
}

/// Standard deviation of what a heading of this standard deviation s, rad, leaves of the Earth's rate in gyro biases found at rest beyond the
/// tie to it, in parts of that rate: the larger of √E(θ − sin θ)² and √E(1 − cos θ)² over θ of N(0, s²).
///
/// The tie is the linear one however vague the heading: at rest, bias and heading are wrong by amounts that cancel, so that a level that
/// stays tells nothing of north. What it is wrong by shows when a heading is found at last.
pub(super) fn untied(heading_sigma: f64) -> f64 {
    let s = heading_sigma * heading_sigma;
    let (half, twice) = ((-0.5 * s).exp(), (-2.0 * s).exp());
    let across = s - 2.0 * s * half + 0.5 * (1.0 - twice);
    let along = 1.0 - 2.0 * half + 0.5 * (1.0 + twice);
    across.max(along).max(0.0).sqrt()
}

/// Whether a heading is known well enough for the level to be tied to it. One of zero is a definition.
fn ties(heading_sigma: f64) -> bool {
    heading_sigma > 0.0 && heading_sigma < VAGUE_HEADING
}

/// Standard deviations of attitude and gyro bias in such a covariance.
pub(super) fn sigmas(joint: &Joint) -> [Vector3<f64>; 2] {
    [0, 3].map(|at| Vector3::from_fn(|i, _| joint[(at + i, at + i)].max(0.0).sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::alignment::levelling::from_force;
    use crate::attitude::log_level;
    use crate::sim::{Source, Stream};

    fn place() -> Geodetic {
        Geodetic::from_degrees(57.0, 14.0, 300.0)
    }

    fn errors(rates: Rates) -> Errors {
        Errors {
            turned: Matrix3::identity(),
            level_sigma: 3e-4,
            heading_sigma: 2e-2,
            gyro_sigma: Vector3::new(1e-7, 2e-7, 1.5e-7),
            accel_sigma: 1e-2,
            rates,
        }
    }

    type Draw = SMatrix<f64, 9, 1>;

    /// A start as it is made: force and rate measured at rest with the errors drawn, attitude and bias found from them. What comes back is
    /// the error of all of it, true ⊟ found.
    fn made(truth: &UnitQuaternion<f64>, e: &Errors, draw: &Draw) -> Draw {
        let earth = LocalEarth::at(&place());
        let part = |at: usize| draw.fixed_rows::<3>(at).into_owned();
        let accel_bias = part(6) * e.accel_sigma;
        let gyro = part(3).component_mul(&e.gyro_sigma);
        let to_b = truth.inverse();
        let up = to_b * Vector3::new(0.0, 0.0, -earth.gravity());
        // Noise of the mean force that tilts by as much as is stated, about axes of the level.
        let noise_n = Vector3::new(-draw[1], draw[0], 0.0) * (e.level_sigma * earth.gravity());
        let force = up + e.turned * accel_bias + to_b * noise_n;
        let level = from_force(&force);
        let rate = to_b * earth.earth_rate_n() + gyro;
        let heading = match e.rates {
            Rates::North => {
                let east = level * rate;
                // Rounded to where the east component vanishes, and wrong by what else there is.
                (-east.y).atan2(east.x) - draw[2] * e.heading_sigma
            }
            Rates::Unused | Rates::Biases => {
                Euler::from_quaternion(truth).heading - draw[2] * e.heading_sigma
            }
        };
        let found = UnitQuaternion::from_scaled_axis(Vector3::z() * heading) * level;
        let phi = log_level(&(truth * found.inverse()));
        let gyro_error = match e.rates {
            // b_g is zero but for what was drawn; found is what is left of the mean rate.
            Rates::Biases => -(rate - found.inverse() * earth.earth_rate_n()),
            Rates::North | Rates::Unused => gyro,
        };
        let mut out = Draw::zeros();
        out.fixed_rows_mut::<3>(0).copy_from(&phi);
        out.fixed_rows_mut::<3>(3).copy_from(&gyro_error);
        out.fixed_rows_mut::<3>(6).copy_from(&accel_bias);
        out
    }

    fn attitudes() -> [UnitQuaternion<f64>; 3] {
        [[0.0, 0.0, 10.0], [8.0, -15.0, 130.0], [-40.0, 25.0, -70.0]]
            .map(|[r, p, h]| Euler::from_degrees(r, p, h).to_quaternion())
    }

    /// The covariance is that of the derivatives of the start itself by all that it is made of, taken numerically.
    #[test]
    fn it_is_what_the_start_does_with_small_errors() {
        for rates in [Rates::Unused, Rates::Biases, Rates::North] {
            for q_nb in attitudes() {
                let mut turned = errors(rates);
                turned.turned = Euler::from_degrees(2.0, 5.0, 50.0)
                    .to_quaternion()
                    .to_rotation_matrix()
                    .into_inner()
                    * 0.8;
                for e in [errors(rates), turned] {
                    let step = 1e-3;
                    let columns: [Draw; 9] = core::array::from_fn(|k| {
                        let mut draw = Draw::zeros();
                        draw[k] = step;
                        (made(&q_nb, &e, &draw) - made(&q_nb, &e, &-draw)) / (2.0 * step)
                    });
                    let l = Joint::from_columns(&columns);
                    let (numerical, stated) = (l * l.transpose(), e.joint(&q_nb, &place()));
                    let scale = stated.map_diagonal(|v| v.sqrt().recip());
                    let misfit = Joint::from_fn(|i, j| {
                        (numerical[(i, j)] - stated[(i, j)]) * scale[i] * scale[j]
                    });
                    // Where to turn for north depends on the level that the noise of the force makes, and gravity of a biased force is not
                    // quite g: both are of the second order.
                    assert!(
                        misfit.amax() < 2e-4,
                        "{rates:?} {}: {misfit}",
                        misfit.amax()
                    );
                }
            }
        }
    }

    /// Over 3000 starts the errors have that covariance; without its ties, level and bias are off by their whole correlation.
    #[test]
    fn errors_of_starts_are_tied_as_stated() {
        let runs = 3000;
        for rates in [Rates::Unused, Rates::Biases, Rates::North] {
            let (e, q_nb) = (errors(rates), attitudes()[1]);
            let joint = e.joint(&q_nb, &place());
            let scale = joint.map_diagonal(|v| v.sqrt().recip());
            let scaled = Joint::from_fn(|i, j| joint[(i, j)] * scale[i] * scale[j]);
            let factor = scaled.cholesky().expect("positive");
            let mut source = Source::new(7, Stream::Initial);
            let (mut tied, mut loose) = (Joint::zeros(), Joint::zeros());
            for _ in 0..runs {
                let mut draw = Draw::zeros();
                for k in 0..9 {
                    draw[k] = source.normal();
                }
                let error = made(&q_nb, &e, &draw).component_mul(&scale);
                let white = factor.l().solve_lower_triangular(&error).expect("positive");
                tied += white * white.transpose() / f64::from(runs);
                loose += error * error.transpose() / f64::from(runs);
            }
            let off = |m: &Joint| (m - Joint::identity()).amax();
            // An element of a sample covariance scatters by √(2/3000) at most; five of those, over 45 elements.
            assert!(
                off(&tied) < 5.0 * (2.0 / f64::from(runs)).sqrt(),
                "{rates:?} {tied}"
            );
            assert!(off(&loose) > 0.5, "{rates:?} {loose}");
        }
    }

    #[test]
    fn a_bias_tilts_by_its_share_of_gravity_and_no_more() {
        let e = errors(Rates::Unused);
        let level = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.7);
        let joint = e.joint(&level, &place());
        let [attitude, _] = sigmas(&joint);
        let tilt = e
            .level_sigma
            .hypot(e.accel_sigma / LocalEarth::at(&place()).gravity());
        assert!((attitude.x / tilt - 1.0).abs() < 1e-12 && (attitude.y / tilt - 1.0).abs() < 1e-12);
        assert!((attitude.z / e.heading_sigma - 1.0).abs() < 1e-12);
        // No level turns a heading that is unknown, or zero by definition; gyro biases are tied to the first.
        for heading_sigma in [0.0, 1.8] {
            let e = Errors {
                heading_sigma,
                ..errors(Rates::Biases)
            };
            let joint = e.joint(&attitudes()[2], &place());
            assert_eq!(joint.fixed_view::<1, 3>(2, 6).amax(), 0.0);
            assert_eq!(joint[(2, 2)], heading_sigma * heading_sigma);
            let tied = joint.fixed_view::<1, 3>(2, 3).norm();
            let north = LocalEarth::at(&place()).earth_rate_n().x;
            assert!((tied - heading_sigma * heading_sigma * north).abs() < 1e-15);
        }
    }

    /// What a linear tie leaves, by drawing headings.
    #[test]
    fn a_vague_heading_leaves_what_it_leaves() {
        let mut source = Source::new(3, Stream::Initial);
        for sigma in [0.1, 0.5, 1.0, 1.8] {
            let runs = 20_000;
            let (mut across, mut along) = (0.0, 0.0);
            for _ in 0..runs {
                let theta = sigma * source.normal();
                across += (theta - theta.sin()).powi(2) / f64::from(runs);
                along += (1.0 - theta.cos()).powi(2) / f64::from(runs);
            }
            let drawn = across.max(along).sqrt();
            // Of the square of a heavy-tailed square, 20 000 draws leave some per cent.
            assert!((untied(sigma) / drawn - 1.0).abs() < 0.1, "{sigma} {drawn}");
        }
        assert!(untied(0.02) < 1e-3);
    }
}
