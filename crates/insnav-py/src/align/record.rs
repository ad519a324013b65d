//! Alignment of a record of inertial data, with all that the core lets one ask.

use super::found;
use crate::arrays::{Argument, MOST_SECONDS, too_far};
use crate::failure::{Failure, fail};
use crate::interrupt::{Stop, interruptible};
use crate::pickle;
use crate::settings;
use insnav_core::alignment::{self, AlignmentMethod, AlignmentOptions, StopWindow, Taper};
use insnav_core::earth::Geodetic;
use insnav_core::imu::ImuNoise;
use insnav_core::mechanization::{Increment, IncrementBuilder};
use insnav_core::sample::{ImuIncrement, ImuSample};
use insnav_core::time::Time;
use insnav_log::RunError;
use pyo3::prelude::*;
use pyo3::types::{PyTuple, PyType};

/// Inertial data summed up over nodes of a tenth of a second, for any number of alignments.
///
/// Parameters
/// ----------
/// t : (n,)
///     Seconds, or ``datetime64``.
/// gyro : (n, 3)
///     Angular rate, body axes (forward-right-down), rad/s; with ``increments`` the angle gained since the row before, rad.
/// accel : (n, 3)
///     Specific force, body axes, m/s²; with ``increments`` the velocity gained since the row before, m/s.
/// increments : bool, default False
///     Rows are what was gained since the row before. Coning and sculling are taken into account in both cases.
///
/// Raises
/// ------
/// InsnavError
///     Shapes, stamps and numbers that cannot be used; name the argument.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav import align
/// >>> t = np.arange(0, 60, 0.01)
/// >>> record = align.Record(t, np.zeros((6000, 3)), np.tile([0.0, 0.0, -9.81], (6000, 1)))
/// >>> record
/// <insnav.align.Record: 0.000 s to 59.900 s>
#[pyclass(frozen, module = "insnav.align")]
pub(crate) struct Record(pub(super) alignment::Record);

#[pymethods]
impl Record {
    #[new]
    #[pyo3(signature = (t, gyro, accel, *, increments=false))]
    fn new(
        t: &Bound<'_, PyAny>,
        gyro: &Bound<'_, PyAny>,
        accel: &Bound<'_, PyAny>,
        increments: bool,
    ) -> PyResult<Self> {
        let py = t.py();
        let fail = fail(py);
        let times = Argument::new("t", t).times().map_err(fail)?;
        let gyro = Argument::new("gyro", gyro)
            .finite_vectors(times.len())
            .map_err(fail)?;
        let accel = Argument::new("accel", accel)
            .finite_vectors(times.len())
            .map_err(fail)?;
        let record = interruptible(py, move |stop| {
            let mut builder = IncrementBuilder::default();
            let rows = times.iter().zip(gyro).zip(accel);
            let rows = rows.take_while(|_| stop.proceed());
            alignment::Record::new(rows.filter_map(|((&time, gyro), accel)| {
                // Two rows at one instant are one.
                if builder.time().is_some_and(|last| time <= last) {
                    return None;
                }
                let increment: Option<Increment> = if increments {
                    builder.push_increment(&ImuIncrement {
                        time,
                        angle_b: gyro,
                        velocity_b: accel,
                    })
                } else {
                    builder.push(&ImuSample {
                        time,
                        angular_rate_b: gyro,
                        specific_force_b: accel,
                    })
                };
                increment
            }))
        })?;
        Ok(Record(record))
    }

    /// Begin and end of the data, s, or None without any.
    #[getter]
    fn span_s(&self) -> Option<(f64, f64)> {
        let (begin, end) = self.0.range()?;
        Some((begin.seconds(), end.seconds()))
    }

    fn __repr__(&self) -> String {
        match self.span_s() {
            Some((begin, end)) => format!("<insnav.align.Record: {begin:.3} s to {end:.3} s>"),
            None => "<insnav.align.Record: no data>".to_owned(),
        }
    }

    #[classmethod]
    fn _from_state(_class: &Bound<'_, PyType>, state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(Record)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.get().0)
    }
}

/// Attitude and sensor errors from one or more stops of a record, by any of the core's methods.
///
/// Nothing is taken from the record but what the methods need: neither stops nor noise. Levelling, two vectors, coarse, gyrocompass and
/// fine use the last stop alone, all others every stop.
///
/// Parameters
/// ----------
/// record : Record
///     Inertial data.
/// stops : (k, 2)
///     Begin and end of each stop, s, on the scale of the record's stamps.
/// latitude_deg : float
///     Geodetic latitude, north positive.
/// config : mapping or path
///     Settings as of :func:`insnav.run`; ``imu.grade`` and ``noise`` say what the unit is worth. The bias sigmas are what is known of the
///     biases beforehand.
/// method : str, default "auto"
///     See the functions of this module that have these names.
/// height_m : float, default 0
///     Height above the ellipsoid: gravity follows from it.
/// heading_deg, heading_sigma_deg : float, optional
///     Heading of the forward axis at the first stop's begin, where it is known, and its standard deviation.
/// max_azimuth_sigma_deg : float, default 5
///     The azimuth is called unobservable when its standard deviation would be larger.
/// gyro_scale_sigma_ppm : float, default 10
///     Standard deviation of the gyros' scale factors; acts in turns between stops.
/// taper : {"none", "hann_squared"}, optional
///     Weights of the joint regression; without it by what the stops show.
/// paper_vertical : bool, default True
///     Whether the paper's method uses its vertical equation (5); without it the quadratic (9).
///
/// Returns
/// -------
/// Alignment
///     Its ``summary`` is None.
///
/// Raises
/// ------
/// AlignmentError
///     The refusal, with what shows it and the remedy; ``time_s`` is the begin of the stop that it is about.
///
/// Notes
/// -----
/// The methods: [Lobusov14] and what became of it, [Wu11], [Shuster81]; see ``docs/references.md``.
#[pyfunction]
#[pyo3(signature = (
    record, stops, *, latitude_deg, config, method="auto", height_m=0.0, heading_deg=None, heading_sigma_deg=None,
    max_azimuth_sigma_deg=5.0, gyro_scale_sigma_ppm=10.0, taper=None, paper_vertical=true
))]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn align_stops<'py>(
    py: Python<'py>,
    record: &Bound<'py, Record>,
    stops: &Bound<'py, PyAny>,
    latitude_deg: f64,
    config: &Bound<'py, PyAny>,
    method: &str,
    height_m: f64,
    heading_deg: Option<f64>,
    heading_sigma_deg: Option<f64>,
    max_azimuth_sigma_deg: f64,
    gyro_scale_sigma_ppm: f64,
    taper: Option<&str>,
    paper_vertical: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let fail = fail(py);
    let noise = stated_noise(config)?;
    let windows: Vec<StopWindow> = windows(stops)
        .map_err(fail)?
        .into_iter()
        .map(|[begin, end]| StopWindow {
            begin: Time::from_seconds(begin),
            end: Time::from_seconds(end),
        })
        .collect();
    let heading = heading_and_sigma(heading_deg, heading_sigma_deg).map_err(fail)?;
    let position = Geodetic::from_degrees(latitude_deg, 0.0, height_m);
    let options = AlignmentOptions {
        method: self::method(method, heading_deg).map_err(fail)?,
        heading: heading.map(|[heading, sigma]| (heading.to_radians(), sigma.to_radians())),
        largest_azimuth_sigma: max_azimuth_sigma_deg.to_radians(),
        gyro_scale_sigma: gyro_scale_sigma_ppm * 1e-6,
        taper: match taper {
            None => None,
            Some("none") => Some(Taper::None),
            Some("hann_squared") => Some(Taper::HannSquared),
            Some(other) => {
                return Err(fail(Failure::unknown_word(
                    "taper",
                    other,
                    "none, hann_squared",
                )));
            }
        },
        paper_vertical,
        ..AlignmentOptions::new(position, noise)
    };
    let record = record.clone().unbind();
    let work = move |_: &Stop| alignment::align(&record.get().0, &windows, &options);
    let found = interruptible(py, work)?.map_err(|e| fail(RunError::from(e).into()))?;
    found::alignment(py, &found, None)
}

/// Noise of a unit that the settings state: no record tells it here.
pub(super) fn stated_noise(config: &Bound<'_, PyAny>) -> PyResult<ImuNoise> {
    let stated = settings::config(Some(config))?;
    match stated.imu.grade {
        Some(grade) => Ok(stated.noise.over(grade)),
        None => Err(Failure::new(
            "bad_option",
            "config: does not say what the unit is",
            "give its class, such as {\"imu\": {\"grade\": \"navigation\"}}, and in `noise` what is known better",
        )
        .about("config", "no imu.grade", "imu.grade")
        .into_py_err(config.py())),
    }
}

/// Shape (k, 2): begin and end of each stop, s.
pub(super) fn windows(stops: &Bound<'_, PyAny>) -> Result<Vec<[f64; 2]>, Failure> {
    let pairs = Argument::new("stops", stops).pairs()?;
    for (row, pair) in pairs.iter().enumerate() {
        if let Some(seconds) = pair.iter().find(|s| s.abs() > MOST_SECONDS) {
            return Err(too_far("stops", &format!("[{row}]"), *seconds));
        }
    }
    Ok(pairs)
}

/// A heading has a sigma, or there is none of both.
pub(super) fn heading_and_sigma(
    heading_deg: Option<f64>,
    sigma_deg: Option<f64>,
) -> Result<Option<[f64; 2]>, Failure> {
    match (heading_deg, sigma_deg) {
        (None, None) => Ok(None),
        (Some(heading), Some(sigma)) if heading.abs() <= 360.0 && sigma > 0.0 && sigma <= 180.0 => {
            Ok(Some([heading, sigma]))
        }
        (Some(heading), Some(sigma)) => Err(Failure::new(
            "bad_option",
            format!("heading_deg = {heading}, heading_sigma_deg = {sigma}"),
            "a heading from -360 to 360 degrees, a sigma above 0, at most 180 degrees",
        )
        .about(
            "heading_sigma_deg",
            format!("{heading}, {sigma}"),
            "-360 to 360, above 0 to 180",
        )),
        _ => Err(Failure::new(
            "bad_option",
            "heading_deg and heading_sigma_deg: one is given without the other",
            "give both: a heading without a sigma would be exact, or none",
        )
        .about("heading_sigma_deg", "one of two", "both, or none")),
    }
}

/// The method of a name.
pub(super) fn method(name: &str, heading_deg: Option<f64>) -> Result<AlignmentMethod, Failure> {
    let found = match name {
        "two_position" => Some(AlignmentMethod::MultiPosition),
        _ => AlignmentMethod::ALL.into_iter().find(|m| m.name() == name),
    };
    match found {
        Some(AlignmentMethod::Zupt2) if heading_deg.is_none() => Err(Failure::new(
            "bad_option",
            "method: zupt2 needs the heading of the first stop",
            "give heading_deg and heading_sigma_deg",
        )
        .about("heading_deg", "None", "degrees from true north")),
        Some(method) => Ok(method),
        None => Err(Failure::unknown_word(
            "method",
            name,
            &AlignmentMethod::ALL.map(AlignmentMethod::name).join(", "),
        )),
    }
}
