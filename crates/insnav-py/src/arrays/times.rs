//! Arguments that are instants: seconds, or dates, which keep stamps of today exact.

use super::{Argument, shape_of};
use crate::failure::Failure;
use insnav_core::time::Time;
use numpy::{PyArray1, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyList};

/// What 64 bits of nanoseconds hold, s.
pub(crate) const MOST_SECONDS: f64 = 9.2e9;

/// Seconds that no stamp holds. `place`: the row, where there are many.
pub(crate) fn too_far(name: &str, place: &str, seconds: f64) -> Failure {
    Failure::new(
        "bad_time",
        format!("{name}{place} = {seconds:e} s: more than 290 years"),
        "give seconds (milliseconds / 1e3, nanoseconds / 1e9), or datetime64[ns]",
    )
    .about(name, format!("{seconds:e}"), "seconds")
}

/// An instant whose seconds count from `zero`, on the clock on which that is.
#[inline]
pub(crate) fn counted_from(zero: Time, name: &str, time: Time) -> Result<Time, Failure> {
    match time.0.checked_add(zero.0) {
        Some(sum) => Ok(Time(sum)),
        None => Err(past_the_clock(zero, name, time)),
    }
}

#[cold]
fn past_the_clock(zero: Time, name: &str, time: Time) -> Failure {
    let (seconds, zero) = (time.0 as f64 / 1e9, zero.0);
    Failure::new(
        "bad_time",
        format!("{name} = {seconds:e} s from t0_ns = {zero}: beyond the years 1677 to 2262, which stamps hold"),
        "count seconds from t0_ns, or leave t0_ns out",
    )
    .about(name, format!("{seconds:e}"), "seconds from t0_ns")
}

impl<'py> Argument<'py> {
    /// One instant: seconds, or a date (`datetime64`, pandas's, Python's own), which keeps stamps of today exact.
    pub(crate) fn instant(&self) -> Result<Time, Failure> {
        let seconds = match self.object.cast::<PyFloat>() {
            Ok(seconds) => Some(seconds.value()),
            Err(_) => {
                let array = self.asarray(None)?;
                if let Some(dates) = self.as_dates(&array)? {
                    let row = dates.call_method1("reshape", (1,)).map_err(|_| {
                        self.wrong_shape(&shape_of(&dates), "()", "give one instant")
                    })?;
                    let time = self
                        .dates(&row, "datetime64[ns]")?
                        .into_iter()
                        .flatten()
                        .next();
                    return time.ok_or_else(|| self.no_time());
                }
                self.object.extract::<f64>().ok()
            }
        };
        match seconds.filter(|s| s.is_finite()) {
            None => Err(self.no_time()),
            Some(s) if s.abs() > MOST_SECONDS => Err(too_far(&self.name, "", s)),
            Some(s) => Ok(Time::from_seconds(s)),
        }
    }

    #[cold]
    fn no_time(&self) -> Failure {
        let received = self
            .object
            .repr()
            .map_or_else(|_| "that".to_owned(), |r| r.to_string());
        Failure::new(
            "not_finite",
            format!("{}: {received}, expected a finite time", self.name),
            "give seconds, or a datetime64",
        )
        .about(&self.name, "no finite time", "a finite time")
    }

    /// Shape (n,): stamps, as seconds or as dates, in an order that does not go backward.
    pub(crate) fn times(&self) -> Result<Vec<Time>, Failure> {
        let array = self.asarray(None)?;
        let times = match self.as_dates(&array)? {
            Some(dates) => self.dates(&dates, "datetime64[ns]")?,
            None if kind(&array) == b'm' => self.dates(&array, "timedelta64[ns]")?,
            None => self.seconds()?,
        };
        let mut checked: Vec<Time> = Vec::with_capacity(times.len());
        for (row, time) in times.into_iter().enumerate() {
            let time = time.ok_or_else(|| {
                Failure::new(
                    "not_finite",
                    format!("{}[{row}]: no finite time", self.name),
                    "drop the rows without a stamp",
                )
                .about(&self.name, "no finite time", "finite times")
            })?;
            if let Some(&previous) = checked.last()
                && time < previous
            {
                return Err(Failure::new(
                    "backward_stamps",
                    format!(
                        "{}[{row}] = {time} is before {previous} in the row above",
                        self.name
                    ),
                    "sort the rows by time",
                )
                .about(
                    &self.name,
                    format!("{time} after {previous}"),
                    "stamps that do not go backward",
                )
                .at(time));
            }
            checked.push(time);
        }
        Ok(checked)
    }

    /// Whether it holds dates, which are instants whatever seconds count from: `datetime64`, pandas's or Python's own.
    pub(crate) fn is_dates(&self) -> Result<bool, Failure> {
        Ok(holds_dates(&self.asarray(None)?))
    }

    /// Whether it holds dates or durations of any kind.
    pub(crate) fn is_dated(&self) -> Result<bool, Failure> {
        let array = self.asarray(None)?;
        Ok(holds_dates(&array) || kind(&array) == b'm')
    }

    /// What numpy makes of it as `datetime64`, which has no zones: UTC. `None`: these are no dates.
    fn as_dates(&self, array: &Bound<'py, PyAny>) -> Result<Option<Bound<'py, PyAny>>, Failure> {
        if !holds_dates(array) {
            return Ok(None);
        }
        if kind(array) == b'M' {
            return Ok(Some(array.clone()));
        }
        // A column of pandas with a zone knows its nanoseconds.
        let of_pandas = self
            .object
            .getattr("dtype")
            .and_then(|dtype| dtype.getattr("kind")?.extract::<String>())
            .is_ok_and(|kind| kind == "M");
        if of_pandas {
            return self.asarray(Some("datetime64[ns]")).map(Some);
        }
        without_zones(array).map(Some).map_err(|raised| {
            Failure::raised(array.py(), raised, |e| self.no_dates(&e.to_string()))
        })
    }

    #[cold]
    fn no_dates(&self, why: &str) -> Failure {
        Failure::new(
            "not_numbers",
            format!("{}: cannot be read as times: {why}", self.name),
            "give seconds, or datetime64[ns]",
        )
        .about(&self.name, self.type_name(), "seconds, or datetime64[ns]")
    }

    /// Seconds that a stamp can hold.
    fn seconds(&self) -> Result<Vec<Option<Time>>, Failure> {
        let seconds = self.column(None)?;
        if let Some(row) = seconds.iter().position(|s| s.abs() > MOST_SECONDS) {
            return Err(too_far(&self.name, &format!("[{row}]"), seconds[row]));
        }
        Ok(seconds
            .iter()
            .map(|&s| s.is_finite().then(|| Time::from_seconds(s)))
            .collect())
    }

    /// Nanoseconds, exactly; `None` for not-a-time. `unit`: dates, or durations since the zero of the data.
    fn dates(&self, array: &Bound<'py, PyAny>, unit: &str) -> Result<Vec<Option<Time>>, Failure> {
        let nanos = || {
            array
                .call_method1("astype", (unit,))?
                .call_method1("astype", ("int64",))
        };
        let nanos = nanos().map_err(|raised: PyErr| {
            Failure::raised(array.py(), raised, |e| self.no_dates(&e.to_string()))
        })?;
        let nanos = nanos
            .cast::<PyArray1<i64>>()
            .map_err(|_| self.wrong(&shape_of(array), "(n,)"))?
            .readonly();
        let nanos = nanos
            .as_slice()
            .map_err(|e| self.no_dates(&e.to_string()))?;
        Ok(nanos
            .iter()
            .map(|&t| (t != i64::MIN).then_some(Time(t)))
            .collect())
    }
}

/// The letter that numpy has for the kind of elements.
fn kind(array: &Bound<'_, PyAny>) -> u8 {
    array
        .cast::<PyUntypedArray>()
        .map_or(b'f', |a| a.dtype().kind())
}

/// Whether these are `datetime64`, or Python's or pandas's own dates: those with a zone, and lists, come as objects.
fn holds_dates(array: &Bound<'_, PyAny>) -> bool {
    let first = || -> PyResult<bool> {
        let date = array.py().import("datetime")?.getattr("datetime")?;
        array.getattr("flat")?.get_item(0)?.is_instance(&date)
    };
    match kind(array) {
        b'M' => true,
        b'O' => first().unwrap_or(false),
        _ => false,
    }
}

/// Dates as objects → `datetime64[ns]` in UTC. numpy itself warns of every zone, and leaves out the nanoseconds of pandas.
fn without_zones<'py>(array: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = array.py();
    let utc = py.import("datetime")?.getattr("timezone")?.getattr("utc")?;
    let no_zone = PyDict::new(py);
    no_zone.set_item("tzinfo", py.None())?;
    let dates = PyList::empty(py);
    for date in array.getattr("flat")?.try_iter()? {
        let date = date?;
        let has_zone = |date: &Bound<'py, PyAny>| -> PyResult<bool> {
            Ok(date
                .getattr_opt("tzinfo")?
                .is_some_and(|zone| !zone.is_none()))
        };
        dates.append(match date.getattr_opt("to_datetime64")? {
            Some(exact) => exact.call0()?,
            None if has_zone(&date)? => date.call_method1("astimezone", (&utc,))?.call_method(
                "replace",
                (),
                Some(&no_zone),
            )?,
            None => date,
        })?;
    }
    py.import("numpy")?
        .call_method1("array", (dates, "datetime64[ns]"))?
        .call_method1("reshape", (array.getattr("shape")?,))
}
