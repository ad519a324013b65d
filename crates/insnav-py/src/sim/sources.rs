//! Seeded random sources, those of which a simulation is made.

use crate::arrays::{Argument, counts};
use crate::failure::{Failure, fail};
use crate::geometry::rows::shaped;
use crate::interrupt::Signals;
use insnav_core::sim::{GaussMarkov, Source, Stream};
use nalgebra::Vector3;
use pyo3::exceptions::PyMemoryError;
use pyo3::prelude::*;

const STREAMS: [(&str, Stream); 12] = [
    ("gyro_white", Stream::GyroWhite),
    ("accel_white", Stream::AccelWhite),
    ("gyro_bias", Stream::GyroBias),
    ("accel_bias", Stream::AccelBias),
    ("position_white", Stream::PositionWhite),
    ("position_colour", Stream::PositionColour),
    ("velocity_white", Stream::VelocityWhite),
    ("velocity_colour", Stream::VelocityColour),
    ("field_white", Stream::FieldWhite),
    ("outliers", Stream::Outliers),
    ("route", Stream::Route),
    ("initial", Stream::Initial),
];

fn source(seed: u64, stream: &str) -> Result<Source, Failure> {
    let found = STREAMS.iter().find(|(name, _)| *name == stream);
    let (_, stream) = found.ok_or_else(|| {
        let known: Vec<&str> = STREAMS.iter().map(|(name, _)| *name).collect();
        Failure::unknown_word("stream", stream, &known.join(", "))
    })?;
    Ok(Source::new(seed, *stream))
}

/// White noise: independent standard normal numbers, three a row.
///
/// The same on every platform: PCG-64-MCG behind a hash of seed and stream, normal numbers by the ziggurat.
///
/// Parameters
/// ----------
/// count : int
///     Number of rows.
/// seed : int
///     Seed, 0 to 2⁶⁴ − 1.
/// stream : str, default "initial"
///     Which of the sequences of that seed: ``"gyro_white"``, ``"accel_white"``, ``"gyro_bias"``, ``"accel_bias"``,
///     ``"position_white"``, ``"position_colour"``, ``"velocity_white"``, ``"velocity_colour"``, ``"field_white"``, ``"outliers"``,
///     ``"route"`` are those that a simulation draws from, ``"initial"`` is free for what a user adds.
///
/// Returns
/// -------
/// (count, 3)
///     To have noise of a density N (unit·√s) in samples of step dt, times ``N / sqrt(dt)``.
///
/// Examples
/// --------
/// >>> import insnav
/// >>> insnav.sim.white_noise(2, seed=1).shape
/// (2, 3)
#[pyfunction]
#[pyo3(signature = (count, seed, *, stream="initial"))]
pub(crate) fn white_noise<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = counts::count)] count: usize,
    #[pyo3(from_py_with = seed)] seed: u64,
    stream: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let mut source = source(seed, stream).map_err(fail(py))?;
    vectors(py, count, |_| source.normal3())
}

/// Three independent first-order Gauss–Markov processes: ẋ = −x/τ + noise, stepped exactly.
///
/// Parameters
/// ----------
/// count : int
///     Number of rows; the first is at time 0.
/// step_s : float
///     Time between rows, s.
/// sigma : float or (3,)
///     Steady standard deviation, in the unit of the result.
/// tau_s : float
///     Correlation time, s.
/// seed : int
///     Seed, 0 to 2⁶⁴ − 1.
/// initial_sigma : float or (3,), optional
///     Standard deviation of the first row. Absent: that of ``sigma``, a stationary process.
/// stream : str, default "initial"
///     As of :func:`white_noise`.
///
/// Returns
/// -------
/// (count, 3)
///
/// Raises
/// ------
/// ArgumentError
///     A number outside its range, with its name.
///
/// Examples
/// --------
/// >>> import insnav
/// >>> x = insnav.sim.gauss_markov(1000, 1.0, sigma=2.0, tau_s=50.0, seed=1)
/// >>> x.shape
/// (1000, 3)
#[pyfunction]
#[pyo3(signature = (count, step_s, *, sigma, tau_s, seed, initial_sigma=None, stream="initial"))]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn gauss_markov<'py>(
    py: Python<'py>,
    #[pyo3(from_py_with = counts::count)] count: usize,
    step_s: f64,
    sigma: &Bound<'py, PyAny>,
    tau_s: f64,
    #[pyo3(from_py_with = seed)] seed: u64,
    initial_sigma: Option<&Bound<'py, PyAny>>,
    stream: &str,
) -> PyResult<Bound<'py, PyAny>> {
    let fail = fail(py);
    for (name, value) in [("step_s", step_s), ("tau_s", tau_s)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(fail(Failure::argument(
                "bad_option",
                name,
                value.to_string(),
                "a positive number of seconds",
                "",
            )));
        }
    }
    let sigma = not_negative("sigma", sigma).map_err(fail)?;
    let first = match initial_sigma {
        Some(given) => not_negative("initial_sigma", given).map_err(fail)?,
        None => sigma,
    };
    let mut process = GaussMarkov::new(sigma, first, tau_s, source(seed, stream).map_err(fail)?);
    vectors(py, count, |i| {
        if i > 0 {
            process.step(step_s);
        }
        process.value
    })
}

/// `next` of 0 to `count` - 1, shape (count, 3); other threads run meanwhile.
fn vectors(
    py: Python<'_>,
    count: usize,
    mut next: impl FnMut(usize) -> Vector3<f64> + Send,
) -> PyResult<Bound<'_, PyAny>> {
    let values = py.detach(|| -> PyResult<_> {
        let mut values: Vec<f64> = Vec::new();
        values
            .try_reserve_exact(count.saturating_mul(3))
            .map_err(|_| PyMemoryError::new_err(format!("count: no memory for {count} rows")))?;
        let mut signals = Signals::new();
        for i in 0..count {
            signals.look()?;
            values.extend_from_slice(next(i).as_slice());
        }
        Ok(values)
    })?;
    shaped(py, values, &[count], &[3])
}

/// A seed, refused by name.
pub(super) fn seed(given: &Bound<'_, PyAny>) -> PyResult<u64> {
    given.extract().map_err(|_| {
        Failure::argument(
            "bad_option",
            "seed",
            given
                .repr()
                .map_or_else(|_| "something else".to_owned(), |text| text.to_string()),
            "an integer, 0 to 2**64 - 1",
            "",
        )
        .into_py_err(given.py())
    })
}

/// The same where there need not be one.
pub(super) fn seed_or_none(given: &Bound<'_, PyAny>) -> PyResult<Option<u64>> {
    (!given.is_none()).then(|| seed(given)).transpose()
}

/// One number for all three, or three.
pub(super) fn not_negative(name: &str, given: &Bound<'_, PyAny>) -> Result<Vector3<f64>, Failure> {
    let vector = match given.extract::<f64>() {
        Ok(one) => Vector3::repeat(one),
        Err(_) => Vector3::from_column_slice(&Argument::new(name, given).column(Some(3))?),
    };
    if vector.iter().all(|v| v.is_finite() && *v >= 0.0) {
        return Ok(vector);
    }
    Err(Failure::argument(
        "bad_option",
        name,
        format!("{:?}", vector.as_slice()),
        "finite numbers that are not negative",
        "",
    ))
}
