//! Messages that belong to one device or tool, whose fields differ from version to version: they are read by name.

mod gps_fix;
mod location_fix;
mod px4;
mod ublox;

pub(crate) use gps_fix::gps_fix;
pub(crate) use location_fix::location_fix;
pub(crate) use px4::{sensor_combined, sensor_gps, vehicle_magnetometer};
pub(crate) use ublox::{nav_pvt, nav_rel_pos_ned};

use nalgebra::{Matrix3, Vector3};

/// A diagonal covariance from standard deviations east, north and up; `None` when one of them is not known.
fn from_sigmas(horizontal: f64, vertical: f64) -> Option<Matrix3<f64>> {
    let known = |sigma: f64| sigma.is_finite() && sigma > 0.0;
    (known(horizontal) && known(vertical)).then(|| {
        let variances = Vector3::new(horizontal, horizontal, vertical).map(|s| s * s);
        Matrix3::from_diagonal(&variances)
    })
}
