//! `insnav.mechanization`: increments of samples, and the way they lead.

use super::earth::of_geodetic;
use super::nav_state::NavState;
use super::rows::{Rows, shaped, vector, wxyz};
use crate::arrays::{Argument, scalars};
use crate::failure::{Failure, fail};
use crate::interrupt::Signals;
use insnav_core::mechanization::{Increment, IncrementBuilder};
use insnav_core::sample::{ImuIncrement, ImuSample};
use insnav_core::time::Time;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Increments between samples of rates, with coning and sculling inside.
///
/// Rates are instantaneous and linear in between; the second-order terms are the two-sample ones ([Savage98a] eq. 47 and following,
/// [Savage98b] eq. 21 and following).
///
/// Parameters
/// ----------
/// time_s : (n,)
///     Seconds, or ``datetime64``, not going backward.
/// angular_rate_b : (n, 3)
///     Angular rate of the body against inertial space, rad/s.
/// specific_force_b : (n, 3)
///     Specific force, m/s²; (0, 0, -g) at rest and level.
///
/// Returns
/// -------
/// Increments
///     n - 1 rows, each over the interval that ends at its ``time_s``.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav.mechanization import increments
/// >>> t = np.arange(3) * 0.01
/// >>> made = increments(t, np.zeros((3, 3)), np.tile([0.0, 0.0, -9.81], (3, 1)))
/// >>> made.velocity_b
/// array([[ 0.    ,  0.    , -0.0981],
///        [ 0.    ,  0.    , -0.0981]])
#[pyfunction]
pub(crate) fn increments<'py>(
    time_s: &Bound<'py, PyAny>,
    angular_rate_b: &Bound<'py, PyAny>,
    specific_force_b: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let push = |builder: &mut IncrementBuilder, time, w: &[f64], f: &[f64]| {
        builder.push(&ImuSample {
            time,
            angular_rate_b: vector(w),
            specific_force_b: vector(f),
        })
    };
    build(
        time_s,
        ("angular_rate_b", angular_rate_b),
        ("specific_force_b", specific_force_b),
        push,
    )
}

/// Increments of a unit that integrates by itself, with coning and sculling put in.
///
/// Rates are taken as linear through two intervals ([Savage98a], [Savage98b]); their lengths may differ.
///
/// Parameters
/// ----------
/// time_s : (n,)
///     Ends of the intervals: seconds, or ``datetime64``.
/// angle_b : (n, 3)
///     Integral of the angular rate since the row before, in the axes of the turning body, rad.
/// velocity_b : (n, 3)
///     Integral of the specific force, likewise, m/s.
///
/// Returns
/// -------
/// Increments
///     n - 1 rows: of the first sample only the stamp is used, since its length is not known.
#[pyfunction]
pub(crate) fn increments_of_sums<'py>(
    time_s: &Bound<'py, PyAny>,
    angle_b: &Bound<'py, PyAny>,
    velocity_b: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let push = |builder: &mut IncrementBuilder, time, a: &[f64], v: &[f64]| {
        builder.push_increment(&ImuIncrement {
            time,
            angle_b: vector(a),
            velocity_b: vector(v),
        })
    };
    build(
        time_s,
        ("angle_b", angle_b),
        ("velocity_b", velocity_b),
        push,
    )
}

fn build<'py>(
    time_s: &Bound<'py, PyAny>,
    a: (&str, &Bound<'py, PyAny>),
    b: (&str, &Bound<'py, PyAny>),
    push: impl Fn(&mut IncrementBuilder, Time, &[f64], &[f64]) -> Option<Increment> + Send + Sync,
) -> PyResult<Bound<'py, PyAny>> {
    let py = time_s.py();
    let read = |(name, object): (&str, &Bound<'py, PyAny>), rows: usize| {
        let read = Rows::vectors(name, object)?;
        if read.lead != [rows] {
            return Err(Failure::argument(
                "wrong_shape",
                name,
                format!("{:?} rows", read.lead),
                format!("({rows}, 3), one row per stamp"),
                "",
            ));
        }
        Ok(read)
    };
    let given = || {
        let times = Argument::new("time_s", time_s).times()?;
        let (names, a, b) = ([a.0, b.0], read(a, times.len())?, read(b, times.len())?);
        for (name, rows) in names.into_iter().zip([a.values(), b.values()]) {
            if let Some(at) = rows.iter().position(|v| !v.is_finite()) {
                return Err(Failure::new(
                    "not_finite",
                    format!("{name}[{}]: is not finite", at / 3),
                    "drop that row of all columns",
                )
                .about(name, "not finite", "finite")
                .at(times[at / 3]));
            }
        }
        Ok((times, a, b))
    };
    let (times, a, b) = given().map_err(fail(py))?;
    let rows = (a.values(), b.values());
    let made: Vec<Increment> = py.detach(|| -> PyResult<_> {
        let mut builder = IncrementBuilder::default();
        let mut signals = Signals::new();
        let mut made = Vec::with_capacity(times.len());
        let rows = rows.0.chunks_exact(3).zip(rows.1.chunks_exact(3));
        for (time, (a, b)) in times.iter().zip(rows) {
            signals.look()?;
            made.extend(push(&mut builder, *time, a, b));
        }
        Ok(made)
    })?;
    let fields = PyDict::new(py);
    let seconds = made.iter().map(|i| i.time.since(Time(0)));
    fields.set_item("time_s", scalars(py, seconds)?)?;
    fields.set_item("dt", scalars(py, made.iter().map(|i| i.dt))?)?;
    let flat = |get: fn(&Increment) -> &Vector3<f64>| {
        let values = made.iter().flat_map(|i| get(i).iter().copied()).collect();
        shaped(py, values, &[made.len()], &[3])
    };
    fields.set_item("rotation_b", flat(|i| &i.rotation_b)?)?;
    fields.set_item("velocity_b", flat(|i| &i.velocity_b)?)?;
    py.import("insnav._mechanization")?
        .getattr("Increments")?
        .call((), Some(&fields))
}

/// Rows of increments: lengths, and what was gained.
pub(crate) struct Steps<'py> {
    pub(crate) count: usize,
    dt: Rows<'py>,
    rotation_b: Rows<'py>,
    velocity_b: Rows<'py>,
}

impl<'py> Steps<'py> {
    /// One increment, or n of them with one length for all or one each.
    pub(crate) fn new(
        dt: &Bound<'py, PyAny>,
        rotation_b: &Bound<'py, PyAny>,
        velocity_b: &Bound<'py, PyAny>,
    ) -> Result<Self, Failure> {
        let steps = Steps {
            count: 1,
            dt: Rows::scalars("dt", dt)?,
            rotation_b: Rows::vectors("rotation_b", rotation_b)?,
            velocity_b: Rows::vectors("velocity_b", velocity_b)?,
        };
        steps.dt.check(
            |dt| dt[0].is_finite() && dt[0] >= 0.0,
            "seconds, finite and not negative",
        )?;
        steps.rotation_b.finite()?;
        steps.velocity_b.finite()?;
        let all = [&steps.dt, &steps.rotation_b, &steps.velocity_b];
        let lead = super::rows::common_lead(&all)?;
        if lead.len() > 1 {
            return Err(Failure::argument(
                "wrong_shape",
                "rotation_b",
                format!("{} axes", lead.len() + 1),
                "(n, 3) or (3,)",
                "increments come one after the other",
            ));
        }
        let count = lead.first().copied().unwrap_or(1);
        Ok(Steps { count, ..steps })
    }

    /// The numbers, without what belongs to Python.
    pub(crate) fn numbers(&self) -> Numbers<'_> {
        let of = |rows: &'_ Rows<'py>, width| if rows.lead.is_empty() { 0 } else { width };
        Numbers {
            dt: (self.dt.values(), of(&self.dt, 1)),
            rotation_b: (self.rotation_b.values(), of(&self.rotation_b, 3)),
            velocity_b: (self.velocity_b.values(), of(&self.velocity_b, 3)),
        }
    }
}

/// Values, and how far it is from one row to the next.
#[derive(Clone, Copy)]
pub(crate) struct Numbers<'a> {
    dt: (&'a [f64], usize),
    rotation_b: (&'a [f64], usize),
    velocity_b: (&'a [f64], usize),
}

impl Numbers<'_> {
    /// The increment of a row, which begins at `from`.
    pub(crate) fn increment(&self, row: usize, from: Time) -> Increment {
        let three = |(values, step): (&[f64], usize)| vector(&values[row * step..row * step + 3]);
        let (dt, step) = self.dt;
        let dt = dt[row * step];
        Increment {
            time: from.plus(dt),
            dt,
            rotation_b: three(self.rotation_b),
            velocity_b: three(self.velocity_b),
        }
    }
}

/// Follow increments from a start: strapdown navigation without any aiding.
///
/// The same as :meth:`NavState.advance` row by row, to the last bit. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// start : NavState
///     State at the begin of the first interval.
/// dt : (n,) or float
///     Lengths of the intervals, s.
/// rotation_b : (n, 3)
///     Rotation vectors of the body against inertial space, rad.
/// velocity_b : (n, 3)
///     Velocity increments of specific force in the axes of the turning body, m/s.
///
/// Returns
/// -------
/// Trajectory
///     n rows, each at the end of its interval.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav import earth
/// >>> from insnav.mechanization import NavState, mechanize
/// >>> start = NavState.from_degrees(0.0, 0.0, 0.0)
/// >>> up = np.tile([0.0, 0.0, -(earth.gravity(0.0) + 1.0) * 0.01], (100, 1))
/// >>> way = mechanize(start, 0.01, np.tile(earth.earth_rate_n(0.0) * 0.01, (100, 1)), up)
/// >>> float(np.round(way.height[-1], 4)), len(way)
/// (0.5, 100)
#[pyfunction]
pub(crate) fn mechanize<'py>(
    start: &Bound<'py, NavState>,
    dt: &Bound<'py, PyAny>,
    rotation_b: &Bound<'py, PyAny>,
    velocity_b: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = start.py();
    let steps = Steps::new(dt, rotation_b, velocity_b).map_err(fail(py))?;
    let mut nav = start.get().0;
    let (count, numbers) = (steps.count, steps.numbers());
    let way = py.detach(|| -> PyResult<_> {
        let mut way = Vec::with_capacity(count);
        let mut signals = Signals::new();
        for row in 0..count {
            signals.look()?;
            nav.advance(&numbers.increment(row, nav.time));
            way.push(nav);
        }
        Ok(way)
    })?;
    let n = [way.len()];
    let fields = PyDict::new(py);
    let seconds = way.iter().map(|s| s.time.since(Time(0)));
    fields.set_item("time_s", scalars(py, seconds)?)?;
    fields.set_item("time_ns", scalars(py, way.iter().map(|s| s.time.0))?)?;
    let positions = way.iter().flat_map(|s| of_geodetic(&s.position)).collect();
    fields.set_item("position", shaped(py, positions, &n, &[3])?)?;
    let velocities = way
        .iter()
        .flat_map(|s| s.velocity_n.iter().copied())
        .collect();
    fields.set_item("velocity_n", shaped(py, velocities, &n, &[3])?)?;
    let attitudes = way.iter().flat_map(|s| wxyz(&s.q_nb)).collect();
    fields.set_item("q_nb", shaped(py, attitudes, &n, &[4])?)?;
    fields.set_item("end", Bound::new(py, NavState(nav))?)?;
    py.import("insnav._mechanization")?
        .getattr("Trajectory")?
        .call((), Some(&fields))
}
