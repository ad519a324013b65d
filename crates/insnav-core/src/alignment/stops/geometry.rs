//! Which combinations of azimuth and drift the attitudes of the stops can tell apart.

use nalgebra::{DMatrix, Matrix3, Vector4};

/// Where the stops leave the unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Geometry {
    /// Least singular value of the Jacobian of all level rates by azimuth and drift, drifts scaled by Ω cos L.
    pub(super) ratio: f64,
    /// The unit combination that it belongs to: azimuth, drift north, east, down (axes of the first stop).
    pub(super) weakest: Vector4<f64>,
}

/// Of the mean attitudes (C, n) of all stops, at any scale of the rates.
///
/// A stop shows the level rate Ω(azimuth) + C w: azimuth turns Ω cos L towards east, the drift comes through the attitude.
pub(super) fn geometry(axes_n: &[Matrix3<f64>]) -> Geometry {
    let first = axes_n[0].transpose();
    let mut jacobian = DMatrix::<f64>::zeros(3 * axes_n.len(), 4);
    for (i, axes) in axes_n.iter().enumerate() {
        // The sign of the azimuth's column is that of a heading error: computed axes turned by it see the rate turned back.
        jacobian[(3 * i + 1, 0)] = -1.0;
        jacobian
            .fixed_view_mut::<3, 3>(3 * i, 1)
            .copy_from(&(axes * first));
    }
    let eigen = (jacobian.transpose() * &jacobian).symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let weakest = Vector4::from_fn(|i, _| eigen.eigenvectors[(i, least)]);
    // The sign is free: the largest component is positive.
    let sign = weakest[weakest.iamax()].signum();
    Geometry {
        ratio: eigen.eigenvalues[least].max(0.0).sqrt(),
        weakest: weakest * sign,
    }
}
