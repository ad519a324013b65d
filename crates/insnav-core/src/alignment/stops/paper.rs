//! The equations of \[Lobusov14\] as they stand, for comparison: explicit, one stop after the other, without accelerometer
//! biases, cross-couplings and covariance.
//!
//! Level frame L: the body's heading at the first stop is its azimuth, x forward, y right, z down (the paper's axes are
//! right, forward, up). Drift w is added to the true rate; M_i takes body to L in stop i; the level rates are
//! B_i = (Ω cos L cos a, −Ω cos L sin a, −Ω sin L) + M_i w.

use super::Refusal;
use super::free_run::{FreeRun, Start};
use super::geometry::Geometry;
use super::gyrocompass::levelling_loop;
use super::place::Place;
use super::record::{Record, Span};
use super::standing::{Standing, Taper, derivative_row};
use crate::attitude::exp;
use crate::error::Result;
use nalgebra::{Matrix2, Matrix3, UnitQuaternion, Vector2, Vector3};

/// The level rates of two stops need positions that are far enough apart: least |det| of the paper's system, 4 sin²(ψ/2) for a
/// turn ψ about the vertical (2° here).
const SINGULAR: f64 = 1e-3;

/// The roots of eq. (9) merge where the axis between the positions points east; least square of its north component.
const TANGENT: f64 = 2.5e-3;

/// Drift and azimuth by eq. (6)–(8), from the level rates of two stops; horizontal Ω cos L of the place.
pub(super) fn linear(
    rates: [&Vector3<f64>; 2],
    axes: [&Matrix3<f64>; 2],
    place: &Place,
) -> Result<(Vector3<f64>, f64)> {
    let difference = axes[1] - axes[0];
    let mut system = Matrix3::zeros();
    system.set_row(0, &difference.row(0));
    system.set_row(1, &difference.row(1));
    system.set_row(2, &axes[0].row(2));
    let right = Vector3::new(
        rates[1].x - rates[0].x,
        rates[1].y - rates[0].y,
        rates[0].z - place.earth_n.z,
    );
    let drift = system
        .try_inverse()
        .filter(|_| system.determinant().abs() > SINGULAR)
        .map(|inverse| inverse * right)
        .ok_or_else(|| singular(&super::geometry::geometry(&[*axes[0], *axes[1]])))?;
    Ok((drift, azimuth(rates[0], axes[0], &drift)))
}

/// Drift and azimuth by eq. (9), without the vertical rate: two components of the drift by the third, and that one by
/// sin² + cos² = 1; the root nearer to zero.
pub(super) fn quadratic(
    rates: [&Vector3<f64>; 2],
    axes: [&Matrix3<f64>; 2],
    place: &Place,
) -> Result<(Vector3<f64>, f64)> {
    let scale = place.horizontal_rate();
    let difference = axes[1] - axes[0];
    let rows = [difference.row(0).transpose(), difference.row(1).transpose()];
    // The direction that the differences do not see, its largest component one.
    let free = rows[0].cross(&rows[1]);
    if free.norm() < SINGULAR {
        return Err(singular(&super::geometry::geometry(&[*axes[0], *axes[1]])));
    }
    let s = free.iamax();
    let q = free / free[s];
    let others: [usize; 2] = [[1, 2], [0, 2], [0, 1]][s];
    let system = Matrix2::from_fn(|i, j| rows[i][others[j]]);
    let right = Vector2::new(rates[1].x - rates[0].x, rates[1].y - rates[0].y);
    let solved = system
        .try_inverse()
        .map(|inverse| inverse * right)
        .ok_or_else(|| singular(&super::geometry::geometry(&[*axes[0], *axes[1]])))?;
    let mut p = Vector3::zeros();
    (p[others[0]], p[others[1]]) = (solved.x, solved.y);
    let horizontal = |v: &Vector3<f64>| {
        let turned = axes[0] * v;
        Vector2::new(turned.x, turned.y)
    };
    let h0 = (Vector2::new(rates[0].x, rates[0].y) - horizontal(&p)) / scale;
    let h1 = -horizontal(&q) / scale;
    let (a, b, c) = (h1.norm_squared(), h0.dot(&h1), h0.norm_squared() - 1.0);
    // Without a horizontal part the free direction is vertical: the equation says nothing of it.
    if q.xy().norm_squared() < SINGULAR * q.norm_squared() {
        return Err(singular(&super::geometry::geometry(&[*axes[0], *axes[1]])));
    }
    let discriminant = b * b - a * c;
    // Scaled, it is the square of the north component of the axis between the positions over its horizontal one.
    let scaled = discriminant / a;
    if scaled < TANGENT {
        return Err(Refusal::NegativeDiscriminant {
            discriminant: scaled,
        }
        .into());
    }
    // The root of smaller size, without cancellation.
    let root = c / (-b - b.signum() * discriminant.sqrt());
    let drift = p + q * root;
    Ok((drift, azimuth(rates[0], axes[0], &drift)))
}

fn azimuth(rate: &Vector3<f64>, axes: &Matrix3<f64>, drift: &Vector3<f64>) -> f64 {
    let left = rate - axes * drift;
    (-left.y).atan2(left.x)
}

pub(super) fn singular(geometry: &Geometry) -> crate::error::Error {
    let [x, y, z, w]: [f64; 4] = geometry.weakest.into();
    let advice = if x.abs() > 0.3 && z.abs() > 0.3 {
        "azimuth and the drift about east look alike: turn the body about the vertical (180° is best) between stops"
    } else {
        "turn the body about the vertical (180° is best) between stops"
    };
    Refusal::SingularGeometry {
        azimuth: x,
        north: y,
        east: z,
        down: w,
        ratio: geometry.ratio,
        advice,
    }
    .into()
}

/// What the paper's procedure makes of two stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PaperResult {
    pub(super) drift: Vector3<f64>,
    /// Of the level frame, rad.
    pub(super) azimuth: f64,
    /// Body to NED at the end of the last stop, with that azimuth.
    pub(super) q_nb: UnitQuaternion<f64>,
}

/// ZUPT-1: the levelling loop in the first stop, a free run into the second.
pub(super) fn zupt1(
    record: &Record,
    spans: [Span; 2],
    place: &Place,
    start: &Start,
    vertical: bool,
) -> Result<PaperResult> {
    // A level frame whose x is along the body's: heading zero in it.
    let heading = crate::attitude::Euler::from_quaternion(&start.q_nb).heading;
    let q_level = exp(&Vector3::new(0.0, 0.0, -heading)) * start.q_nb;
    let settling = ((40.0 / record.nodes[0].dt) as usize).min(spans[0].begin);
    let first = levelling_loop(record, spans[0].begin - settling, spans[0], place, q_level);
    let azimuth = first.azimuth();
    let standing = |attitudes: &[UnitQuaternion<f64>]| {
        let sum: Matrix3<f64> = attitudes
            .iter()
            .map(|q| q.to_rotation_matrix().into_inner())
            .sum();
        sum / attitudes.len() as f64
    };
    let axes1 = standing(&first.attitudes);
    // The yaw of the level frame's attitude over the stop (eq. (5)): what turns it besides Ω sin L is drift.
    let t: std::vec::Vec<f64> = (spans[0].begin..=spans[0].end)
        .map(|k| record.seconds(spans[0].begin, k))
        .collect();
    let slope = derivative_row::<2>(&t, &Taper::None.weights(&t));
    let reference = first.attitudes[0].inverse();
    let yaw: f64 = slope
        .iter()
        .zip(&first.attitudes)
        .map(|(s, q)| s * crate::attitude::log(&(q * reference)).z)
        .sum();
    let rate1 = Vector3::new(first.rate.x, first.rate.y, place.earth_n.z + yaw);

    // Navigation mode with the azimuth set; the level frame stays the one whose azimuth that is.
    let turned = exp(&Vector3::new(0.0, 0.0, azimuth));
    let navigation = Start {
        q_nb: turned * first.q_level,
        gyro_bias: Vector3::zeros(),
        accel_bias: Vector3::zeros(),
        velocity_n: Vector3::zeros(),
    };
    let whole = Span {
        begin: first.window.end,
        end: spans[1].end,
    };
    let run = FreeRun::new(record, whole, place, &navigation);
    let second = Standing::new(record, &run, spans[1], Taper::None);
    let bend = derivative_row::<3>(&second.t, &second.weights);
    let from = run.at(spans[1].begin);
    let bent: Vector3<f64> = bend
        .iter()
        .zip(&run.velocity_n[from..])
        .map(|(c, v)| v * *c)
        .sum();
    let residual_n = Vector3::new(bent.y / place.gravity, -bent.x / place.gravity, 0.0);
    let to_level = turned.inverse();
    let rate2 = to_level * (place.earth_n + residual_n);
    let axes2 = to_level.to_rotation_matrix().into_inner()
        * standing(&run.q_nb[from..=run.at(spans[1].end)]);

    let (drift, found) = if vertical {
        linear([&rate1, &rate2], [&axes1, &axes2], place)?
    } else {
        quadratic([&rate1, &rate2], [&axes1, &axes2], place)?
    };
    let end = run.q_nb[run.q_nb.len() - 1];
    Ok(PaperResult {
        drift,
        azimuth: found,
        q_nb: exp(&Vector3::new(0.0, 0.0, found - azimuth)) * end,
    })
}

/// The repeated correction, eq. (10)–(13): two stops in navigation mode, the azimuth known from before to about a degree. The level
/// frame is the computed one, and what is found of its azimuth is the error of the one before.
pub(super) fn repeat(
    record: &Record,
    spans: [Span; 2],
    place: &Place,
    start: &Start,
    vertical: bool,
) -> Result<PaperResult> {
    let whole = Span {
        begin: spans[0].begin,
        end: spans[1].end,
    };
    let run = FreeRun::new(record, whole, place, start);
    let stops = spans.map(|span| Standing::new(record, &run, span, Taper::None));
    let [rate1, rate2] = [0, 1].map(|i| place.earth_n + residual_rate(&stops[i], &run, place));
    let axes = [&stops[0].axes_n, &stops[1].axes_n];
    let (drift, wrong_by) = if vertical {
        linear([&rate1, &rate2], axes, place)?
    } else {
        quadratic([&rate1, &rate2], axes, place)?
    };
    let before = crate::attitude::Euler::from_quaternion(&start.q_nb).heading;
    let end = run.q_nb[run.q_nb.len() - 1];
    Ok(PaperResult {
        drift,
        azimuth: before + wrong_by,
        q_nb: exp(&Vector3::new(0.0, 0.0, wrong_by)) * end,
    })
}

/// ZUPT-2, eq. (14)–(15): drift from one stop in navigation mode with the azimuth known.
pub(super) fn zupt2(record: &Record, span: Span, place: &Place, start: &Start) -> Vector3<f64> {
    let run = FreeRun::new(record, span, place, start);
    let standing = Standing::new(record, &run, span, Taper::None);
    standing.q_nb.inverse() * residual_rate(&standing, &run, place)
}

/// What turns the computed level frame in a stop, by the bend of the velocity and the slope of the yaw.
fn residual_rate(standing: &Standing, run: &FreeRun, place: &Place) -> Vector3<f64> {
    let bend = derivative_row::<3>(&standing.t, &standing.weights);
    let slope = derivative_row::<2>(&standing.t, &standing.weights);
    let from = run.at(standing.span.begin);
    let mut bent = Vector3::zeros();
    let mut yaw = 0.0;
    for (i, (b, s)) in bend.iter().zip(&slope).enumerate() {
        bent += run.velocity_n[from + i] * *b;
        yaw += standing.rocking[i].z * s;
    }
    Vector3::new(bent.y / place.gravity, -bent.x / place.gravity, yaw)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;
    use crate::error::Error;

    fn place() -> Place {
        Place::new(&Geodetic::from_degrees(60.0, 0.0, 0.0))
    }

    /// Exact level rates of two positions at an azimuth, the second turned from the first by a rotation in the level frame.
    fn positions(
        azimuth: f64,
        turn: Vector3<f64>,
        drift: Vector3<f64>,
    ) -> ([Vector3<f64>; 2], [Matrix3<f64>; 2]) {
        let earth = exp(&Vector3::new(0.0, 0.0, -azimuth)) * place().earth_n;
        let axes = [Vector3::zeros(), turn].map(|t| exp(&t).to_rotation_matrix().into_inner());
        (axes.map(|m| earth + m * drift), axes)
    }

    const DRIFT: Vector3<f64> = Vector3::new(1e-7, 1e-7, 1e-7);

    #[test]
    fn exact_rates_give_exact_drifts() {
        for (turn, azimuth) in [
            (Vector3::new(0.0, 0.0, core::f64::consts::PI), 0.8),
            (Vector3::new(0.3, 0.4, 1.5), 4.0),
        ] {
            let ([r0, r1], [m0, m1]) = positions(azimuth, turn, DRIFT);
            let (drift, found) = linear([&r0, &r1], [&m0, &m1], &place()).expect("solved");
            assert!((drift - DRIFT).norm() < 1e-15, "{drift}");
            assert!(crate::attitude::wrap_angle(found - azimuth).abs() < 1e-9);
        }
        // Eq. (9) needs an axis with a horizontal part.
        let ([r0, r1], [m0, m1]) = positions(0.3, Vector3::new(0.9, 0.2, 1.5), DRIFT);
        let (drift, found) = quadratic([&r0, &r1], [&m0, &m1], &place()).expect("solved");
        assert!((drift - DRIFT).norm() < 1e-13, "{drift}");
        assert!((found - 0.3).abs() < 1e-8, "{found}");
    }

    #[test]
    fn an_axis_along_east_has_no_root_and_a_vertical_one_no_equation() {
        // East in level axes whose x points to the azimuth.
        let azimuth = core::f64::consts::FRAC_PI_4;
        let east = Vector3::new(azimuth.sin(), azimuth.cos(), 0.0);
        for size in [1.0, 2.0] {
            let turn = (east * 0.3 + Vector3::z()) * size;
            let ([r0, r1], [m0, m1]) = positions(azimuth, turn, DRIFT);
            let refused = quadratic([&r0, &r1], [&m0, &m1], &place());
            assert!(
                matches!(
                    refused,
                    Err(Error::Alignment(Refusal::NegativeDiscriminant { .. }))
                ),
                "{refused:?}"
            );
        }
        let ([r0, r1], [m0, m1]) = positions(azimuth, Vector3::z() * 2.0, DRIFT);
        let refused = quadratic([&r0, &r1], [&m0, &m1], &place());
        assert!(
            matches!(
                refused,
                Err(Error::Alignment(Refusal::SingularGeometry { .. }))
            ),
            "{refused:?}"
        );
    }
}
