//! Positions: geodetic, Earth-centred, and metres around a point.

use super::ellipsoid::{ECCENTRICITY_SQUARED, FLATTENING, SEMI_MAJOR_AXIS, SEMI_MINOR_AXIS};
use super::ellipsoid::{meridian_radius, transverse_radius};
use crate::attitude::wrap_angle;
#[cfg(not(feature = "std"))]
use nalgebra::{ComplexField, RealField};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// So near the Earth's centre more than one latitude fits, m: the centres of curvature of the meridian reach out to 43 km.
pub const NO_LATITUDE_WITHIN: f64 = 50e3;

/// A position on WGS-84: latitude and longitude in radians, ellipsoidal height in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    /// Geodetic latitude, rad, north positive.
    pub latitude: f64,
    /// Longitude, rad, east positive.
    pub longitude: f64,
    /// Height above the ellipsoid, m (not above sea level).
    pub height: f64,
}

impl Geodetic {
    /// From degrees and metres.
    pub fn from_degrees(latitude_deg: f64, longitude_deg: f64, height_m: f64) -> Self {
        Geodetic {
            latitude: latitude_deg.to_radians(),
            longitude: longitude_deg.to_radians(),
            height: height_m,
        }
    }

    /// Latitude in degrees.
    pub fn latitude_deg(&self) -> f64 {
        self.latitude.to_degrees()
    }

    /// Longitude in degrees, in (−180, 180]: inside, a way across the date line simply goes on beyond ±π.
    pub fn longitude_deg(&self) -> f64 {
        wrap_angle(self.longitude).to_degrees()
    }

    /// Earth-centred Earth-fixed position, m (\[Groves13\] eq. 2.112).
    pub fn to_ecef(&self) -> Vector3<f64> {
        let (sl, cl) = self.latitude.sin_cos();
        let (so, co) = self.longitude.sin_cos();
        let n = transverse_radius(self.latitude);
        let r = (n + self.height) * cl;
        Vector3::new(
            r * co,
            r * so,
            (n * (1.0 - ECCENTRICITY_SQUARED) + self.height) * sl,
        )
    }

    /// From an Earth-centred Earth-fixed position, m: Bowring's formula, repeated twice (\[Bowring76\]).
    ///
    /// Good to some nanometres from −10 km to 10 000 km of height. Within [`NO_LATITUDE_WITHIN`] of the Earth's centre, where a
    /// receiver without a fix often is, latitude and height are NaN, and [`Geodetic::is_valid`] fails.
    pub fn from_ecef(r_e: &Vector3<f64>) -> Self {
        if r_e.norm_squared() < NO_LATITUDE_WITHIN * NO_LATITUDE_WITHIN {
            return Geodetic {
                latitude: f64::NAN,
                longitude: r_e.y.atan2(r_e.x),
                height: f64::NAN,
            };
        }
        let p = (r_e.x * r_e.x + r_e.y * r_e.y).sqrt();
        let second_eccentricity_squared = ECCENTRICITY_SQUARED / (1.0 - ECCENTRICITY_SQUARED);
        // Parametric (reduced) latitude first, then latitude from it; the second round removes what is left at great height.
        let mut beta = (r_e.z * SEMI_MAJOR_AXIS).atan2(p * SEMI_MINOR_AXIS);
        let mut latitude = 0.0;
        for _ in 0..3 {
            let (s, c) = beta.sin_cos();
            latitude = (r_e.z + second_eccentricity_squared * SEMI_MINOR_AXIS * s * s * s)
                .atan2(p - ECCENTRICITY_SQUARED * SEMI_MAJOR_AXIS * c * c * c);
            beta = ((1.0 - FLATTENING) * latitude.sin()).atan2(latitude.cos());
        }
        let (s, c) = latitude.sin_cos();
        let n = transverse_radius(latitude);
        // This form of the height has no singularity at the poles.
        let height = p * c + r_e.z * s - SEMI_MAJOR_AXIS * SEMI_MAJOR_AXIS / n;
        Geodetic {
            latitude,
            longitude: r_e.y.atan2(r_e.x),
            height,
        }
    }

    /// Rotation C_n^e from local NED to Earth-centred axes.
    pub fn ned_to_ecef(&self) -> Matrix3<f64> {
        let (sl, cl) = self.latitude.sin_cos();
        let (so, co) = self.longitude.sin_cos();
        Matrix3::new(
            -sl * co,
            -so,
            -cl * co,
            -sl * so,
            co,
            -cl * so,
            cl,
            0.0,
            -sl,
        )
    }

    /// The position `dp_n` metres away, NED, measured with the radii of curvature at `self`.
    ///
    /// This is the ⊞ of positions: it *defines* what an error of position in metres means. First order in the size of the
    /// Earth, so use it for errors and lever arms (metres); [`LocalFrame`] is exact at any distance.
    #[must_use]
    pub fn offset(&self, dp_n: &Vector3<f64>) -> Self {
        Geodetic {
            latitude: self.latitude + dp_n.x / (meridian_radius(self.latitude) + self.height),
            longitude: self.longitude
                + dp_n.y / ((transverse_radius(self.latitude) + self.height) * self.latitude.cos()),
            height: self.height - dp_n.z,
        }
    }

    /// Metres NED from `self` to `other`: the inverse of [`Geodetic::offset`] (⊟).
    pub fn offset_to(&self, other: &Geodetic) -> Vector3<f64> {
        let turn = core::f64::consts::TAU;
        let mut d_longitude = other.longitude - self.longitude;
        // The short way round the date line; a comparison chain, since `rem_euclid` would cost accuracy in the common case.
        if d_longitude > 0.5 * turn {
            d_longitude -= turn;
        } else if d_longitude < -0.5 * turn {
            d_longitude += turn;
        }
        Vector3::new(
            (other.latitude - self.latitude) * (meridian_radius(self.latitude) + self.height),
            d_longitude * (transverse_radius(self.latitude) + self.height) * self.latitude.cos(),
            self.height - other.height,
        )
    }

    /// True when all three numbers are finite and the latitude is one.
    pub fn is_valid(&self) -> bool {
        self.latitude.abs() <= core::f64::consts::FRAC_PI_2
            && self.longitude.is_finite()
            && self.height.is_finite()
    }
}

/// A flat map around an origin: exact conversion between geodetic positions and metres NED in the plane tangent there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LocalFrame {
    origin: Geodetic,
    origin_e: Vector3<f64>,
    ned_to_ecef: Matrix3<f64>,
}

impl LocalFrame {
    /// The frame tangent to the ellipsoid at `origin`.
    pub fn new(origin: Geodetic) -> Self {
        LocalFrame {
            origin,
            origin_e: origin.to_ecef(),
            ned_to_ecef: origin.ned_to_ecef(),
        }
    }

    /// Where the frame touches the Earth.
    pub fn origin(&self) -> &Geodetic {
        &self.origin
    }

    /// Metres NED (axes of the origin) from the origin to `at`.
    pub fn to_ned(&self, at: &Geodetic) -> Vector3<f64> {
        self.ned_to_ecef.tr_mul(&(at.to_ecef() - self.origin_e))
    }

    /// The position `ned` metres from the origin along the origin's axes.
    pub fn to_geodetic(&self, ned: &Vector3<f64>) -> Geodetic {
        Geodetic::from_ecef(&(self.origin_e + self.ned_to_ecef * ned))
    }

    /// Rotation from the NED axes at `at` to the NED axes of the origin.
    pub fn rotation_from(&self, at: &Geodetic) -> Matrix3<f64> {
        self.ned_to_ecef.tr_mul(&at.ned_to_ecef())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn anywhere() -> impl Strategy<Value = Geodetic> {
        (-89.9..89.9f64, -180.0..180.0f64, -5e3..5e5f64)
            .prop_map(|(a, b, h)| Geodetic::from_degrees(a, b, h))
    }

    proptest! {
        #[test]
        fn ecef_there_and_back(at in anywhere()) {
            let back = Geodetic::from_ecef(&at.to_ecef());
            // 1e-9 m is what a f64 holds at the Earth's radius.
            prop_assert!((back.latitude - at.latitude).abs() * SEMI_MAJOR_AXIS < 1e-8);
            prop_assert!((back.longitude - at.longitude).abs() * SEMI_MAJOR_AXIS < 1e-8);
            prop_assert!((back.height - at.height).abs() < 1e-8);
        }

        /// Wherever there is one latitude, it is one.
        #[test]
        fn latitudes_are_within_a_right_angle(x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64, r in 50.001e3..7e6f64) {
            let direction = Vector3::new(x, y, z);
            prop_assume!(direction.norm() > 1e-3);
            prop_assert!(Geodetic::from_ecef(&(direction.normalize() * r)).is_valid());
        }

        #[test]
        fn the_middle_of_the_earth_is_no_place(x in -2.8e4..2.8e4f64, y in -2.8e4..2.8e4f64, z in -2.8e4..2.8e4f64) {
            prop_assert!(!Geodetic::from_ecef(&Vector3::new(x, y, z)).is_valid());
        }

        #[test]
        fn offset_there_and_back(at in anywhere(), n in -50.0..50.0f64, e in -50.0..50.0f64, d in -50.0..50.0f64) {
            let dp = Vector3::new(n, e, d);
            let back = at.offset_to(&at.offset(&dp));
            prop_assert!((back - dp).norm() < 2e-8, "{back}");
        }

        #[test]
        fn offset_agrees_with_the_tangent_plane_to_first_order(at in anywhere(), n in -1.0..1.0f64, e in -1.0..1.0f64, d in -1.0..1.0f64) {
            prop_assume!(at.latitude.abs() < 1.4);
            let dp = Vector3::new(n, e, d);
            let exact = LocalFrame::new(at).to_ned(&at.offset(&dp));
            // The second-order remainder is about |dp|² tan(L) / R.
            prop_assert!((exact - dp).norm() < 4e-6, "{exact} {dp}");
        }

        #[test]
        fn local_frame_there_and_back(at in anywhere(), n in -5e4..5e4f64, e in -5e4..5e4f64, d in -5e3..5e3f64) {
            let frame = LocalFrame::new(at);
            let ned = Vector3::new(n, e, d);
            prop_assert!((frame.to_ned(&frame.to_geodetic(&ned)) - ned).norm() < 1e-7);
        }
    }

    #[test]
    fn longitude_in_degrees_stays_on_the_map() {
        let at = |longitude_deg| Geodetic::from_degrees(10.0, longitude_deg, 0.0).longitude_deg();
        assert!((at(180.25) + 179.75).abs() < 1e-12);
        assert!((at(-190.0) - 170.0).abs() < 1e-12);
        // What is on it already is not touched.
        assert_eq!(at(14.4), 14.4f64.to_radians().to_degrees());
        assert_eq!(at(180.0), 180.0);
    }

    #[test]
    fn no_fix_is_no_place() {
        // What receivers give for it, and near it.
        for r_e in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1000.0, 0.0, 1000.0]] {
            let at = Geodetic::from_ecef(&Vector3::from(r_e));
            assert!(at.latitude.is_nan() && at.height.is_nan(), "{at:?}");
        }
        // The axis is no exception: a pole has any longitude.
        let pole = Geodetic::from_ecef(&Vector3::new(0.0, 0.0, -SEMI_MINOR_AXIS));
        assert!((pole.latitude_deg() + 90.0).abs() < 1e-12 && pole.height.abs() < 1e-8);
    }

    #[test]
    fn offset_crosses_the_date_line() {
        let west = Geodetic::from_degrees(10.0, 179.9999, 0.0);
        let east = Geodetic::from_degrees(10.0, -179.9999, 0.0);
        let d = west.offset_to(&east);
        assert!((d.y - 21.926).abs() < 0.01, "{d}");
    }
}
