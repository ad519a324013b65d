//! Two states, one measurement: autocovariance least squares in closed form.

use crate::error::{Error, Result};
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix2, Matrix3, RowVector2, Vector2, Vector3};
#[cfg(feature = "std")]
use serde::{Deserialize, Serialize};

/// Pivot of the scaled normal matrix below which unknowns cannot be told apart: the rounding of J products each.
const LEAST_PIVOT: f64 = 1e-12;

/// Lag covariances C₀ … C_J₋₁ of a channel with two states, for the unknowns (q₁, q₂, r): noise of each state, per step, and of
/// the measurement.
///
/// Like an attitude angle and its gyro bias, F = \[\[1, −T\], \[0, φ\]\], H = \[1, 0\]. The same as
/// [`als_design`](super::als_design) (see there for the equations), with the Lyapunov equation as three linear equations in
/// p₁₁, p₁₂, p₂₂. Allocates nothing, needs no `std`; a solve takes less than half a microsecond.
///
/// ```
/// use insnav_core::noise::ChannelDesign;
/// use nalgebra::{Matrix2, RowVector2, Vector2};
/// let design = ChannelDesign::<16>::new(
///     &Matrix2::new(1.0, -0.032, 0.0, 0.999),
///     &RowVector2::new(1.0, 0.0),
///     &Vector2::new(0.2, -0.05),
/// )?;
/// let covariances = design.covariances([4e-9, 1e-12, 3e-6]);
/// let found = design.solve(&covariances, [None, Some(1e-12), None])?;
/// assert!((found[0] / 4e-9 - 1.0).abs() < 1e-9 && (found[2] / 3e-6 - 1.0).abs() < 1e-9);
/// # Ok::<(), insnav_core::error::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelDesign<const J: usize> {
    columns: [[f64; J]; 3],
}

impl<const J: usize> ChannelDesign<J> {
    /// The design for a fixed gain, which corrects the predicted state.
    ///
    /// # Errors
    /// [`Error::NotObservable`] when F − F L H is not stable: there are no stationary covariances.
    pub fn new(f: &Matrix2<f64>, h: &RowVector2<f64>, gain: &Vector2<f64>) -> Result<Self> {
        const { assert!(J >= 3, "three unknowns need three lags") };
        let mut columns = [[0.0; J]; 3];
        let [first, second, third] = &mut columns;
        fill(f, h, gain, [first, second, third])?;
        Ok(ChannelDesign { columns })
    }

    /// The design matrix, one array for each unknown.
    pub fn columns(&self) -> &[[f64; J]; 3] {
        &self.columns
    }

    /// Lag covariances of the innovations for (q₁, q₂, r).
    pub fn covariances(&self, theta: [f64; 3]) -> [f64; J] {
        core::array::from_fn(|j| (0..3).map(|i| self.columns[i][j] * theta[i]).sum())
    }

    /// (q₁, q₂, r), none negative, that come nearest to measured lag covariances; all lags weigh alike.
    ///
    /// `known` values are taken as given.
    ///
    /// # Errors
    /// [`Error::NotObservable`] when the lags cannot tell the unknowns apart.
    pub fn solve(&self, covariances: &[f64; J], known: [Option<f64>; 3]) -> Result<[f64; 3]> {
        let [first, second, third] = &self.columns;
        solve([first, second, third], covariances, known)
    }
}

/// [`ChannelDesign`] with its number of lags at run time.
#[cfg(feature = "std")]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelColumns {
    columns: [std::vec::Vec<f64>; 3],
}

#[cfg(feature = "std")]
impl ChannelColumns {
    /// As [`ChannelDesign::new`].
    ///
    /// # Errors
    /// Those of [`ChannelDesign::new`], and [`Error::NotObservable`] for fewer than three lags.
    pub fn new(
        f: &Matrix2<f64>,
        h: &RowVector2<f64>,
        gain: &Vector2<f64>,
        lags: usize,
    ) -> Result<Self> {
        if lags < 3 {
            return Err(Error::NotObservable {
                what: "noise of a channel",
                reason: "three unknowns need three lags",
            });
        }
        let mut columns = core::array::from_fn(|_| std::vec![0.0; lags]);
        let [first, second, third] = &mut columns;
        fill(f, h, gain, [first, second, third])?;
        Ok(ChannelColumns { columns })
    }

    /// Number of lags.
    pub fn lags(&self) -> usize {
        self.columns[0].len()
    }

    /// The design matrix, one column for each unknown.
    pub fn columns(&self) -> [&[f64]; 3] {
        let [first, second, third] = &self.columns;
        [first, second, third]
    }

    /// As [`ChannelDesign::covariances`].
    pub fn covariances(&self, theta: [f64; 3]) -> std::vec::Vec<f64> {
        let at = |j: usize| (0..3).map(|i| self.columns[i][j] * theta[i]).sum();
        (0..self.lags()).map(at).collect()
    }

    /// As [`ChannelDesign::solve`]; covariances beyond the number of lags are left out, missing ones are zero.
    ///
    /// # Errors
    /// Those of [`ChannelDesign::solve`].
    pub fn solve(&self, covariances: &[f64], known: [Option<f64>; 3]) -> Result<[f64; 3]> {
        solve(self.columns(), covariances, known)
    }
}

/// The columns of the three unknowns, at least three lags each.
#[inline(always)]
fn fill(
    f: &Matrix2<f64>,
    h: &RowVector2<f64>,
    gain: &Vector2<f64>,
    columns: [&mut [f64]; 3],
) -> Result<()> {
    let lags = columns[0].len();
    let fl = f * gain;
    let closed = f - fl * h;
    let (trace, determinant) = (closed.trace(), closed.determinant());
    // Jury; written so that NaN fails.
    if !(determinant.abs() < 1.0 && trace.abs() < 1.0 + determinant) {
        return Err(Error::NotObservable {
            what: "noise of a channel",
            reason: "its closed loop F (I - L H) is not stable",
        });
    }
    let (a, b, c, d) = (closed.m11, closed.m12, closed.m21, closed.m22);
    let lyapunov = Matrix3::identity()
        - Matrix3::new(
            a * a,
            2.0 * a * b,
            b * b,
            a * c,
            a * d + b * c,
            b * d,
            c * c,
            2.0 * c * d,
            d * d,
        );
    let Some(inverse) = lyapunov.try_inverse() else {
        return Err(Error::NotObservable {
            what: "noise of a channel",
            reason: "its closed loop F (I - L H) is at the limit of stability",
        });
    };
    let enters = [
        Vector3::x(),
        Vector3::z(),
        Vector3::new(fl.x * fl.x, fl.x * fl.y, fl.y * fl.y),
    ];
    let mut columns = columns;
    let mut shares = [Vector2::zeros(); 3];
    for (i, enters) in enters.iter().enumerate() {
        let p = inverse * enters;
        let across = Matrix2::new(p.x, p.y, p.y, p.z) * h.transpose();
        columns[i][0] = (h * across).x;
        shares[i] = closed * across;
    }
    columns[2][0] += 1.0;
    shares[2] -= fl;
    // Two chains, for even and odd lags: one would wait for its own products.
    let square = closed * closed;
    let (mut odd, mut even) = (*h, h * closed);
    let mut j = 1;
    while j < lags {
        for (column, share) in columns.iter_mut().zip(&shares) {
            column[j] = odd.x * share.x + odd.y * share.y;
            if j + 1 < lags {
                column[j + 1] = even.x * share.x + even.y * share.y;
            }
        }
        odd *= square;
        even *= square;
        j += 2;
    }
    Ok(())
}

/// Least squares over columns of the same length, none negative.
#[inline(always)]
fn solve(columns: [&[f64]; 3], covariances: &[f64], known: [Option<f64>; 3]) -> Result<[f64; 3]> {
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for i in 0..3 {
        for j in 0..=i {
            normal[(i, j)] = dot(columns[i], columns[j]);
            normal[(j, i)] = normal[(i, j)];
        }
        right[i] = dot(columns[i], covariances);
    }
    let given = Vector3::from_fn(|i, _| known[i].unwrap_or(0.0));
    right -= normal * given;
    let lengths = Vector3::from_fn(|i, _| normal[(i, i)].sqrt());
    let scaled = Matrix3::from_fn(|i, j| normal[(i, j)] / (lengths[i] * lengths[j]));
    let right = right.component_div(&lengths);
    let free = known.map(|value| value.is_none());
    let all = solve_free(&scaled, &right, free).ok_or(Error::NotObservable {
        what: "noise of a channel",
        reason: "the lags cannot tell its unknowns apart: give one of them",
    })?;
    // Of the combinations of bounds, the one whose minimum is inside and lowest.
    let mut best = all;
    if all.min() < 0.0 {
        let mut lowest = f64::INFINITY;
        for bounds in 0..8u8 {
            let kept = core::array::from_fn(|i| free[i] && bounds & (1 << i) == 0);
            let Some(theta) = solve_free(&scaled, &right, kept) else {
                continue;
            };
            let value = 0.5 * theta.dot(&(scaled * theta)) - right.dot(&theta);
            if theta.min() >= 0.0 && value < lowest {
                lowest = value;
                best = theta;
            }
        }
    }
    Ok(core::array::from_fn(|i| {
        known[i].unwrap_or(best[i] / lengths[i])
    }))
}

/// Minimum with the others at zero; `None` for a matrix that is singular among those that are free.
fn solve_free(
    normal: &Matrix3<f64>,
    right: &Vector3<f64>,
    free: [bool; 3],
) -> Option<Vector3<f64>> {
    let m = Matrix3::from_fn(|i, j| match (free[i] && free[j], i == j) {
        (true, _) => normal[(i, j)],
        (false, true) => 1.0,
        (false, false) => 0.0,
    });
    let r = Vector3::from_fn(|i, _| if free[i] { right[i] } else { 0.0 });
    let d1 = m.m11;
    let (l21, l31) = (m.m21 / d1, m.m31 / d1);
    let d2 = m.m22 - l21 * m.m21;
    let e32 = m.m32 - l31 * m.m21;
    let l32 = e32 / d2;
    let d3 = m.m33 - l31 * m.m31 - l32 * e32;
    // Written so that NaN fails.
    if !(d1 > LEAST_PIVOT && d2 > LEAST_PIVOT && d3 > LEAST_PIVOT) {
        return None;
    }
    let y2 = r.y - l21 * r.x;
    let y3 = r.z - l31 * r.x - l32 * y2;
    let z = y3 / d3;
    let y = y2 / d2 - l32 * z;
    Some(Vector3::new(r.x / d1 - l21 * y - l31 * z, y, z))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn design() -> ChannelDesign<40> {
        ChannelDesign::new(
            &Matrix2::new(1.0, -0.032, 0.0, 0.99),
            &RowVector2::new(1.0, 0.0),
            &Vector2::new(0.2, -0.1),
        )
        .expect("stable")
    }

    #[test]
    fn covariances_are_those_of_the_recursion() {
        // P by iteration, lags by products of matrices.
        let (f, h, l) = (
            Matrix2::new(1.0, -0.032, 0.0, 0.99),
            RowVector2::new(1.0, 0.0),
            Vector2::new(0.2, -0.1),
        );
        let theta = [2e-3, 3e-4, 0.5];
        let closed = f - f * l * h;
        let mut p = Matrix2::zeros();
        for _ in 0..20_000 {
            p = closed * p * closed.transpose()
                + Matrix2::from_diagonal(&Vector2::new(theta[0], theta[1]))
                + f * l * theta[2] * (f * l).transpose();
        }
        let found = design().covariances(theta);
        let mut share = closed * p * h.transpose() - f * l * theta[2];
        let mut expected = (h * p * h.transpose()).x + theta[2];
        for (j, value) in found.iter().enumerate() {
            assert!((value - expected).abs() < 1e-12, "{j}: {value} {expected}");
            expected = (h * share).x;
            share = closed * share;
        }
    }

    #[test]
    fn a_number_of_lags_at_run_time_changes_nothing() {
        let (f, h) = (
            Matrix2::new(1.0, -0.032, 0.0, 0.99),
            RowVector2::new(1.0, 0.0),
        );
        let gain = Vector2::new(0.3, -0.05);
        let fixed = ChannelDesign::<13>::new(&f, &h, &gain).expect("stable");
        let columns = ChannelColumns::new(&f, &h, &gain, 13).expect("stable");
        for i in 0..3 {
            assert_eq!(columns.columns()[i], fixed.columns()[i]);
        }
        let theta = [2e-3, 3e-4, 0.5];
        let covariances = fixed.covariances(theta);
        assert_eq!(columns.covariances(theta), covariances);
        for known in [[None; 3], [None, Some(1e-4), None]] {
            let found = columns.solve(&covariances, known).expect("identified");
            assert_eq!(found, fixed.solve(&covariances, known).expect("identified"));
        }
        assert!(ChannelColumns::new(&f, &h, &Vector2::zeros(), 13).is_err());
        assert!(ChannelColumns::new(&f, &h, &gain, 2).is_err());
    }

    #[test]
    fn exact_covariances_give_the_noise_back() {
        let theta = [2e-3, 3e-4, 0.5];
        let covariances = design().covariances(theta);
        for known in [
            [None; 3],
            [None, Some(theta[1]), None],
            [Some(theta[0]), None, None],
        ] {
            let found = design().solve(&covariances, known).expect("identified");
            for (a, b) in found.iter().zip(&theta) {
                assert!((a / b - 1.0).abs() < 1e-9, "{known:?}: {a} {b}");
            }
        }
    }

    #[test]
    fn variances_are_not_negative() {
        let covariances = design().covariances([-2e-3, 3e-4, 0.5]);
        let found = design().solve(&covariances, [None; 3]).expect("identified");
        assert!(
            found[0] == 0.0 && found[1] >= 0.0 && found[2] > 0.0,
            "{found:?}"
        );
    }

    #[test]
    fn unstable_loops_and_unknowns_alike_are_refused() {
        let f = Matrix2::new(1.0, -0.032, 0.0, 0.99);
        let h = RowVector2::new(1.0, 0.0);
        assert!(ChannelDesign::<8>::new(&f, &h, &Vector2::zeros()).is_err());
        assert!(ChannelDesign::<8>::new(&f, &h, &Vector2::new(f64::NAN, 0.0)).is_err());
        // No measurement of the second state, and no way from it to the first.
        let apart = Matrix2::new(0.5, 0.0, 0.0, 0.5);
        let design = ChannelDesign::<8>::new(&apart, &h, &Vector2::zeros()).expect("stable");
        assert!(design.solve(&[1.0; 8], [None; 3]).is_err());
    }
}
