//! `insnav.earth`.

use super::rows::{Rows, by_rows, over, vector};
use crate::failure::{Failure, fail};
use insnav_core::attitude::wrap_angle;
use insnav_core::earth::{self, Geodetic};
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

type Array<'py> = PyResult<Bound<'py, PyAny>>;

/// Numbers of the module.
pub(crate) const CONSTANTS: [(&str, f64); 5] = [
    ("EARTH_RATE", earth::EARTH_RATE),
    ("ECCENTRICITY_SQUARED", earth::ECCENTRICITY_SQUARED),
    ("FLATTENING", earth::FLATTENING),
    ("SEMI_MAJOR_AXIS", earth::SEMI_MAJOR_AXIS),
    ("SEMI_MINOR_AXIS", earth::SEMI_MINOR_AXIS),
];

/// Latitude and longitude in radians, height in metres.
pub(super) fn positions<'py>(name: &str, object: &Bound<'py, PyAny>) -> Result<Rows<'py>, Failure> {
    let rows = Rows::vectors(name, object)?;
    rows.check(
        |row| geodetic(row).is_valid(),
        "latitude (up to π/2) and longitude in radians, height in metres",
    )?;
    Ok(rows)
}

fn latitudes<'py>(object: &Bound<'py, PyAny>) -> Result<Rows<'py>, Failure> {
    let rows = Rows::scalars("latitude", object)?;
    rows.check(
        |row| row[0].abs() <= std::f64::consts::FRAC_PI_2,
        "radians, up to π/2",
    )?;
    Ok(rows)
}

pub(super) fn geodetic(row: &[f64]) -> Geodetic {
    Geodetic {
        latitude: row[0],
        longitude: row[1],
        height: row[2],
    }
}

pub(super) fn of_geodetic(at: &Geodetic) -> [f64; 3] {
    [at.latitude, at.longitude, at.height]
}

/// Radius of curvature in the meridian, M ([Groves13] eq. 2.105).
///
/// Parameters
/// ----------
/// latitude : (...)
///     Geodetic latitude, rad.
///
/// Returns
/// -------
/// (...)
///     M, m.
#[pyfunction]
pub(crate) fn meridian_radius<'py>(latitude: &Bound<'py, PyAny>) -> Array<'py> {
    let py = latitude.py();
    let l = latitudes(latitude).map_err(fail(py))?;
    over(py, [&l], &[], |[l]| [earth::meridian_radius(l[0])])
}

/// Radius of curvature in the prime vertical, N ([Groves13] eq. 2.106).
///
/// Parameters
/// ----------
/// latitude : (...)
///     Geodetic latitude, rad.
///
/// Returns
/// -------
/// (...)
///     N, m.
#[pyfunction]
pub(crate) fn transverse_radius<'py>(latitude: &Bound<'py, PyAny>) -> Array<'py> {
    let py = latitude.py();
    let l = latitudes(latitude).map_err(fail(py))?;
    over(py, [&l], &[], |[l]| [earth::transverse_radius(l[0])])
}

/// Magnitude of normal gravity, along Down ([WGS84] eq. 4-1 and 4-3).
///
/// Off from the closed form of the normal field by 0.7 µm/s² at 10 km and 1.5 µm/s² at 20 km; real gravity differs from normal gravity
/// by up to about 1 mm/s².
///
/// Parameters
/// ----------
/// latitude : (...)
///     Geodetic latitude, rad.
/// height : (...), default 0
///     Height above the ellipsoid, m.
///
/// Returns
/// -------
/// (...)
///     Gravity, m/s².
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav import earth
/// >>> round(earth.gravity(np.pi / 2), 9)
/// 9.832184938
#[pyfunction]
#[pyo3(signature = (latitude, height=None), text_signature = "(latitude, height=0.0)")]
pub(crate) fn gravity<'py>(
    latitude: &Bound<'py, PyAny>,
    height: Option<&Bound<'py, PyAny>>,
) -> Array<'py> {
    let py = latitude.py();
    let (l, h) = latitude_and_height(latitude, height)?;
    over(py, [&l, &h], &[], |[l, h]| [earth::gravity(&at(l, h))])
}

/// Derivatives of :func:`gravity`.
///
/// Parameters
/// ----------
/// latitude : (...)
///     Geodetic latitude, rad.
/// height : (...), default 0
///     Height above the ellipsoid, m.
///
/// Returns
/// -------
/// by_latitude : (...)
///     m/s² per rad.
/// by_height : (...)
///     m/s² per m.
#[pyfunction]
#[pyo3(signature = (latitude, height=None), text_signature = "(latitude, height=0.0)")]
pub(crate) fn gravity_gradient<'py>(
    latitude: &Bound<'py, PyAny>,
    height: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyTuple>> {
    let py = latitude.py();
    let (l, h) = latitude_and_height(latitude, height)?;
    let by_latitude = over(py, [&l, &h], &[], |[l, h]| {
        [earth::gravity_gradient(&at(l, h)).0]
    })?;
    let by_height = over(py, [&l, &h], &[], |[l, h]| {
        [earth::gravity_gradient(&at(l, h)).1]
    })?;
    PyTuple::new(py, [by_latitude, by_height])
}

fn at(latitude: &[f64], height: &[f64]) -> Geodetic {
    Geodetic {
        latitude: latitude[0],
        longitude: 0.0,
        height: height[0],
    }
}

fn latitude_and_height<'py>(
    latitude: &Bound<'py, PyAny>,
    height: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Rows<'py>, Rows<'py>)> {
    let py = latitude.py();
    let zero = pyo3::types::PyFloat::new(py, 0.0).into_any();
    let l = latitudes(latitude).map_err(fail(py))?;
    let h = Rows::scalars("height", height.unwrap_or(&zero)).map_err(fail(py))?;
    h.finite().map_err(fail(py))?;
    Ok((l, h))
}

/// Rate of the Earth against inertial space, resolved in n ([Groves13] eq. 2.123).
///
/// Parameters
/// ----------
/// latitude : (...)
///     Geodetic latitude, rad.
///
/// Returns
/// -------
/// (..., 3)
///     ω_ie, north-east-down, rad/s.
#[pyfunction]
pub(crate) fn earth_rate_n<'py>(latitude: &Bound<'py, PyAny>) -> Array<'py> {
    let py = latitude.py();
    let l = latitudes(latitude).map_err(fail(py))?;
    over(py, [&l], &[3], |[l]| earth::earth_rate_n(l[0]).into())
}

/// Turn rate of the navigation frame as a body moves over the Earth, resolved in n ([Groves13] eq. 5.44).
///
/// Grows without bound towards the poles; stay below 89°.
///
/// Parameters
/// ----------
/// position : (..., 3)
///     Latitude and longitude, rad, and height, m.
/// velocity_n : (..., 3)
///     Velocity over ground, north-east-down, m/s.
///
/// Returns
/// -------
/// (..., 3)
///     ω_en, north-east-down, rad/s.
#[pyfunction]
pub(crate) fn transport_rate_n<'py>(
    position: &Bound<'py, PyAny>,
    velocity_n: &Bound<'py, PyAny>,
) -> Array<'py> {
    let py = position.py();
    let p = positions("position", position).map_err(fail(py))?;
    let v = Rows::vectors("velocity_n", velocity_n).map_err(fail(py))?;
    over(py, [&p, &v], &[3], |[p, v]| {
        earth::transport_rate_n(&geodetic(p), &vector(v)).into()
    })
}

/// Earth-centred Earth-fixed positions ([Groves13] eq. 2.112).
///
/// Parameters
/// ----------
/// position : (..., 3)
///     Latitude and longitude, rad, and height above the ellipsoid, m.
///
/// Returns
/// -------
/// (..., 3)
///     Positions, m.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav import earth
/// >>> position = [np.radians(50.0), np.radians(14.0), 300.0]
/// >>> bool(np.allclose(earth.from_ecef(earth.to_ecef(position)), position, rtol=0, atol=1e-8))
/// True
#[pyfunction]
pub(crate) fn to_ecef<'py>(position: &Bound<'py, PyAny>) -> Array<'py> {
    let py = position.py();
    let p = positions("position", position).map_err(fail(py))?;
    over(py, [&p], &[3], |[p]| geodetic(p).to_ecef().into())
}

/// Geodetic positions of Earth-centred Earth-fixed ones ([Bowring76], repeated twice).
///
/// Good to some nanometres from -10 km to 10 000 km of height.
///
/// Parameters
/// ----------
/// r_e : (..., 3)
///     Positions, m.
///
/// Returns
/// -------
/// (..., 3)
///     Latitude and longitude, rad, and height above the ellipsoid, m.
///
/// Raises
/// ------
/// ArgumentError
///     ``bad_value``: a row within 50 km of the Earth's centre, where more than one latitude fits: that of a receiver without a fix.
#[pyfunction]
pub(crate) fn from_ecef<'py>(r_e: &Bound<'py, PyAny>) -> Array<'py> {
    let py = r_e.py();
    let r = Rows::vectors("r_e", r_e).map_err(fail(py))?;
    r.finite().map_err(fail(py))?;
    r.check_or(
        |row| vector(row).norm() >= earth::NO_LATITUDE_WITHIN,
        "positions 50 km and more from the Earth's centre",
        "drop the rows without a fix, for which receivers give zeros",
    )
    .map_err(fail(py))?;
    over(py, [&r], &[3], |[r]| {
        of_geodetic(&Geodetic::from_ecef(&vector(r)))
    })
}

/// Rotation from north-east-down at a position to Earth-centred axes, C_en.
///
/// Parameters
/// ----------
/// position : (..., 3)
///     Latitude and longitude, rad, and height, m.
///
/// Returns
/// -------
/// (..., 3, 3)
///     Matrices.
#[pyfunction]
pub(crate) fn ned_to_ecef<'py>(position: &Bound<'py, PyAny>) -> Array<'py> {
    let py = position.py();
    let p = positions("position", position).map_err(fail(py))?;
    over(py, [&p], &[3, 3], |[p]| by_rows(&geodetic(p).ned_to_ecef()))
}

/// The position some metres away: the ⊞ of positions, which defines what an error in metres means.
///
/// First order in the size of the Earth, so use it for errors and lever arms; :class:`LocalFrame` is exact at any distance.
///
/// Parameters
/// ----------
/// position : (..., 3)
///     Latitude and longitude, rad, and height, m.
/// dp_n : (..., 3)
///     North-east-down, m.
///
/// Returns
/// -------
/// (..., 3)
///     Latitude and longitude, rad, and height, m. Beyond the date line longitude goes on from the other side.
#[pyfunction]
pub(crate) fn offset<'py>(position: &Bound<'py, PyAny>, dp_n: &Bound<'py, PyAny>) -> Array<'py> {
    let py = position.py();
    let p = positions("position", position).map_err(fail(py))?;
    let d = Rows::vectors("dp_n", dp_n).map_err(fail(py))?;
    over(py, [&p, &d], &[3], |[p, d]| {
        let mut there = geodetic(p).offset(&vector(d));
        // What is on the map already keeps its bits.
        if there.longitude.abs() > std::f64::consts::PI {
            there.longitude = wrap_angle(there.longitude);
        }
        of_geodetic(&there)
    })
}

/// Metres north-east-down from one position to another: ⊟, the inverse of :func:`offset`.
///
/// Parameters
/// ----------
/// position, other : (..., 3)
///     Latitude and longitude, rad, and height, m.
///
/// Returns
/// -------
/// (..., 3)
///     North-east-down, m.
#[pyfunction]
pub(crate) fn offset_to<'py>(
    position: &Bound<'py, PyAny>,
    other: &Bound<'py, PyAny>,
) -> Array<'py> {
    let py = position.py();
    let p = positions("position", position).map_err(fail(py))?;
    let o = positions("other", other).map_err(fail(py))?;
    over(py, [&p, &o], &[3], |[p, o]| {
        geodetic(p).offset_to(&geodetic(o)).into()
    })
}

/// A flat map around an origin: exact conversion between geodetic positions and metres in the plane tangent there.
///
/// Parameters
/// ----------
/// origin : (3,)
///     Latitude and longitude, rad, and height, m: where the frame touches the Earth.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav.earth import LocalFrame
/// >>> frame = LocalFrame([np.radians(50.0), np.radians(14.0), 300.0])
/// >>> np.round(frame.to_ned(frame.to_geodetic([1000.0, 2000.0, -5.0])), 6)
/// array([1000., 2000.,   -5.])
#[pyclass(frozen, module = "insnav.earth")]
pub(crate) struct LocalFrame(earth::LocalFrame);

#[pymethods]
impl LocalFrame {
    #[new]
    fn new(origin: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = origin.py();
        let origin = super::nav_state::one_position("origin", origin).map_err(fail(py))?;
        Ok(LocalFrame(earth::LocalFrame::new(origin)))
    }

    /// Where the frame touches the Earth: latitude and longitude, rad, and height, m, shape (3,).
    #[getter]
    fn origin<'py>(&self, py: Python<'py>) -> Array<'py> {
        super::rows::shaped(py, of_geodetic(self.0.origin()).to_vec(), &[], &[3])
    }

    /// Metres along the origin's axes.
    ///
    /// Parameters
    /// ----------
    /// position : (..., 3)
    ///     Latitude and longitude, rad, and height, m.
    ///
    /// Returns
    /// -------
    /// (..., 3)
    ///     From the origin, north-east-down, m.
    fn to_ned<'py>(&self, position: &Bound<'py, PyAny>) -> Array<'py> {
        let py = position.py();
        let p = positions("position", position).map_err(fail(py))?;
        over(py, [&p], &[3], |[p]| self.0.to_ned(&geodetic(p)).into())
    }

    /// Positions of places on the map.
    ///
    /// Parameters
    /// ----------
    /// ned : (..., 3)
    ///     From the origin along its axes, north-east-down, m.
    ///
    /// Returns
    /// -------
    /// (..., 3)
    ///     Latitude and longitude, rad, and height, m.
    fn to_geodetic<'py>(&self, ned: &Bound<'py, PyAny>) -> Array<'py> {
        let py = ned.py();
        let d = Rows::vectors("ned", ned).map_err(fail(py))?;
        d.finite().map_err(fail(py))?;
        d.check(
            |row| self.0.to_geodetic(&vector(row)).is_valid(),
            "places 50 km and more from the Earth's centre",
        )
        .map_err(fail(py))?;
        over(py, [&d], &[3], |[d]| {
            of_geodetic(&self.0.to_geodetic(&Vector3::from_column_slice(d)))
        })
    }

    /// Rotation from north-east-down at positions to the axes of the origin.
    ///
    /// Parameters
    /// ----------
    /// position : (..., 3)
    ///     Latitude and longitude, rad, and height, m.
    ///
    /// Returns
    /// -------
    /// (..., 3, 3)
    ///     Matrices.
    fn rotation_from<'py>(&self, position: &Bound<'py, PyAny>) -> Array<'py> {
        let py = position.py();
        let p = positions("position", position).map_err(fail(py))?;
        over(py, [&p], &[3, 3], |[p]| {
            by_rows(&self.0.rotation_from(&geodetic(p)))
        })
    }

    fn __repr__(&self) -> String {
        let at = self.0.origin();
        format!(
            "<insnav.earth.LocalFrame: origin {:.7} deg, {:.7} deg, {:.3} m>",
            at.latitude_deg(),
            at.longitude_deg(),
            at.height
        )
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyAny>,))> {
        let origin = slf.get().origin(slf.py())?;
        Ok((slf.get_type().into_any(), (origin,)))
    }
}
