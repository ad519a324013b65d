//! `insnav.attitude`.

use super::rows::{Rows, by_rows, over, quaternion, vector, wxyz};
use crate::failure::fail;
use insnav_core::attitude::{self, Euler};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use pyo3::prelude::*;

type Array<'py> = PyResult<Bound<'py, PyAny>>;

/// The rotation by a rotation vector: Exp, exact for any size.
///
/// Parameters
/// ----------
/// rotation : (..., 3)
///     Rotation vectors, rad.
///
/// Returns
/// -------
/// (..., 4)
///     Unit quaternions (w, x, y, z).
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav import attitude
/// >>> quarter_turn = attitude.exp([0.0, 0.0, np.pi / 2])
/// >>> np.round(attitude.rotate(quarter_turn, [1.0, 0.0, 0.0]), 12)
/// array([0., 1., 0.])
#[pyfunction]
pub(crate) fn exp<'py>(rotation: &Bound<'py, PyAny>) -> Array<'py> {
    let py = rotation.py();
    let r = Rows::vectors("rotation", rotation).map_err(fail(py))?;
    over(py, [&r], &[4], |[r]| wxyz(&attitude::exp(&vector(r))))
}

/// The rotation vector of a rotation: Log, the inverse of :func:`exp`.
///
/// Parameters
/// ----------
/// q : (..., 4)
///     Quaternions (w, x, y, z).
///
/// Returns
/// -------
/// (..., 3)
///     Rotation vectors no longer than π, rad.
#[pyfunction]
pub(crate) fn log<'py>(q: &Bound<'py, PyAny>) -> Array<'py> {
    let py = q.py();
    let q = Rows::quaternions("q", q).map_err(fail(py))?;
    over(py, [&q], &[3], |[q]| attitude::log(&quaternion(q)).into())
}

/// Left Jacobian of Exp: the mean of the rotations on the way, ∫₀¹ Exp(s r) ds.
///
/// Turns what a body gained at constant force in its own turning axes into the axes of the begin.
///
/// Parameters
/// ----------
/// rotation : (..., 3)
///     Rotation vectors, rad.
///
/// Returns
/// -------
/// (..., 3, 3)
///     Matrices.
#[pyfunction]
pub(crate) fn left_jacobian<'py>(rotation: &Bound<'py, PyAny>) -> Array<'py> {
    let py = rotation.py();
    let r = Rows::vectors("rotation", rotation).map_err(fail(py))?;
    over(py, [&r], &[3, 3], |[r]| {
        by_rows(&attitude::left_jacobian(&vector(r)))
    })
}

/// The matrix of a cross product: ``skew(a) @ b`` is a × b.
///
/// Parameters
/// ----------
/// v : (..., 3)
///     Vectors.
///
/// Returns
/// -------
/// (..., 3, 3)
///     Skew-symmetric matrices.
#[pyfunction]
pub(crate) fn skew<'py>(v: &Bound<'py, PyAny>) -> Array<'py> {
    let py = v.py();
    let v = Rows::vectors("v", v).map_err(fail(py))?;
    over(py, [&v], &[3, 3], |[v]| {
        by_rows(&attitude::skew(&vector(v)))
    })
}

/// The quaternion of roll, pitch and heading ([Groves13] eq. 2.22).
///
/// Parameters
/// ----------
/// euler : (..., 3)
///     Roll (right side down positive), pitch (nose up positive), heading (clockwise from north), rad: 3-2-1 sequence.
///
/// Returns
/// -------
/// (..., 4)
///     Unit quaternions q_nb (w, x, y, z), which take vectors from b to n.
#[pyfunction]
pub(crate) fn from_euler<'py>(euler: &Bound<'py, PyAny>) -> Array<'py> {
    let py = euler.py();
    let e = Rows::vectors("euler", euler).map_err(fail(py))?;
    over(py, [&e], &[4], |[e]| {
        let euler = Euler {
            roll: e[0],
            pitch: e[1],
            heading: e[2],
        };
        wxyz(&euler.to_quaternion())
    })
}

/// Roll, pitch and heading of a quaternion ([Groves13] eq. 2.23).
///
/// Parameters
/// ----------
/// q : (..., 4)
///     Quaternions q_nb (w, x, y, z).
///
/// Returns
/// -------
/// (..., 3)
///     Roll, pitch, heading, rad, the heading in (-π, π]. At a pitch of ±90° only the sum or the difference of roll and heading is
///     defined: roll is 0 there.
#[pyfunction]
pub(crate) fn to_euler<'py>(q: &Bound<'py, PyAny>) -> Array<'py> {
    let py = q.py();
    let q = Rows::quaternions("q", q).map_err(fail(py))?;
    over(py, [&q], &[3], |[q]| {
        let e = Euler::from_quaternion(&quaternion(q));
        [e.roll, e.pitch, e.heading]
    })
}

/// The quaternion of a rotation matrix.
///
/// Parameters
/// ----------
/// dcm : (..., 3, 3)
///     Direction cosine matrices C_nb, orthogonal to 1e-6 and right-handed.
///
/// Returns
/// -------
/// (..., 4)
///     Unit quaternions q_nb (w, x, y, z).
#[pyfunction]
pub(crate) fn from_dcm<'py>(dcm: &Bound<'py, PyAny>) -> Array<'py> {
    let py = dcm.py();
    let matrix = |row: &[f64]| Matrix3::from_row_slice(row);
    let c = Rows::new("dcm", dcm, &[3, 3]).map_err(fail(py))?;
    c.check(
        |row| {
            let c = matrix(row);
            (c * c.transpose() - Matrix3::identity()).amax() < 1e-6 && c.determinant() > 0.0
        },
        "rotations: orthogonal to 1e-6, of determinant 1",
    )
    .map_err(fail(py))?;
    over(py, [&c], &[4], |[c]| {
        let rotation = Rotation3::from_matrix_unchecked(matrix(c));
        wxyz(&UnitQuaternion::from_rotation_matrix(&rotation))
    })
}

/// The rotation matrix of a quaternion.
///
/// Parameters
/// ----------
/// q : (..., 4)
///     Quaternions q_nb (w, x, y, z).
///
/// Returns
/// -------
/// (..., 3, 3)
///     Direction cosine matrices C_nb: ``C_nb @ v_b`` is v_n.
#[pyfunction]
pub(crate) fn to_dcm<'py>(q: &Bound<'py, PyAny>) -> Array<'py> {
    let py = q.py();
    let q = Rows::quaternions("q", q).map_err(fail(py))?;
    over(py, [&q], &[3, 3], |[q]| {
        by_rows(quaternion(q).to_rotation_matrix().matrix())
    })
}

/// One rotation after the other: letters cancel, ``multiply(q_nb, q_bc)`` is q_nc.
///
/// Parameters
/// ----------
/// a, b : (..., 4)
///     Quaternions (w, x, y, z), as many, or one for all.
///
/// Returns
/// -------
/// (..., 4)
///     Unit quaternions.
#[pyfunction]
pub(crate) fn multiply<'py>(a: &Bound<'py, PyAny>, b: &Bound<'py, PyAny>) -> Array<'py> {
    let py = a.py();
    let a = Rows::quaternions("a", a).map_err(fail(py))?;
    let b = Rows::quaternions("b", b).map_err(fail(py))?;
    over(py, [&a, &b], &[4], |[a, b]| {
        wxyz(&(quaternion(a) * quaternion(b)))
    })
}

/// The rotation back.
///
/// Parameters
/// ----------
/// q : (..., 4)
///     Quaternions (w, x, y, z).
///
/// Returns
/// -------
/// (..., 4)
///     Unit quaternions: of q_nb they are q_bn.
#[pyfunction]
pub(crate) fn inverse<'py>(q: &Bound<'py, PyAny>) -> Array<'py> {
    let py = q.py();
    let q = Rows::quaternions("q", q).map_err(fail(py))?;
    over(py, [&q], &[4], |[q]| wxyz(&quaternion(q).inverse()))
}

/// Vectors in other axes: ``rotate(q_nb, v_b)`` is v_n.
///
/// Parameters
/// ----------
/// q : (..., 4)
///     Quaternions (w, x, y, z).
/// v : (..., 3)
///     Vectors, as many, or one for all.
///
/// Returns
/// -------
/// (..., 3)
///     Vectors.
#[pyfunction]
pub(crate) fn rotate<'py>(q: &Bound<'py, PyAny>, v: &Bound<'py, PyAny>) -> Array<'py> {
    let py = q.py();
    let q = Rows::quaternions("q", q).map_err(fail(py))?;
    let v = Rows::vectors("v", v).map_err(fail(py))?;
    over(py, [&q, &v], &[3], |[q, v]| {
        (quaternion(q) * vector(v)).into()
    })
}

/// The angle in (-π, π] that differs by whole turns.
///
/// Parameters
/// ----------
/// angle : (...)
///     Angles, rad.
///
/// Returns
/// -------
/// (...)
///     Angles, rad.
#[pyfunction]
pub(crate) fn wrap_angle<'py>(angle: &Bound<'py, PyAny>) -> Array<'py> {
    let py = angle.py();
    let a = Rows::scalars("angle", angle).map_err(fail(py))?;
    over(py, [&a], &[], |[a]| [attitude::wrap_angle(a[0])])
}
