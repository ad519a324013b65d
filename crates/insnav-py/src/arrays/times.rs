//! Arguments that are instants: seconds, or dates, which keep stamps of today exact.

use super::{Argument, shape_of};
use crate::failure::Failure;
use insnav_core::time::Time;
use numpy::{PyArray1, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyFloat;

/// What 64 bits of nanoseconds hold, s.
const MOST_SECONDS: f64 = 9.2e9;

impl<'py> Argument<'py> {
    /// One instant: seconds, or a `datetime64`, which keeps stamps of today exact.
    pub(crate) fn instant(&self) -> Result<Time, Failure> {
        let seconds = match self.object.cast::<PyFloat>() {
            Ok(seconds) => Some(seconds.value()),
            Err(_) => {
                let array = self.asarray(None)?;
                let is_date = array
                    .cast::<PyUntypedArray>()
                    .is_ok_and(|a| a.dtype().kind() == b'M');
                if is_date {
                    let row = array.call_method1("reshape", (1,)).map_err(|_| {
                        self.wrong_shape(&shape_of(&array), "()", "give one instant")
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
        seconds
            .filter(|s| s.is_finite())
            .map(Time::from_seconds)
            .ok_or_else(|| self.no_time())
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

    /// Shape (n,): stamps, as seconds or as `datetime64`, in an order that does not go backward.
    pub(crate) fn times(&self) -> Result<Vec<Time>, Failure> {
        let array = self.asarray(None)?;
        let kind = array
            .cast::<PyUntypedArray>()
            .map_or(b'f', |a| a.dtype().kind());
        let times = match kind {
            b'M' => self.dates(&array, "datetime64[ns]")?,
            b'm' => self.dates(&array, "timedelta64[ns]")?,
            // Dates with a zone come as objects; numbers of them would count nanoseconds.
            b'O' if self.holds_dates(&array) => {
                let dates = self.asarray(Some("datetime64[ns]"))?;
                self.dates(&dates, "datetime64[ns]")?
            }
            _ => self.seconds()?,
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

    /// Whether it holds `datetime64`.
    pub(crate) fn is_dates(&self) -> Result<bool, Failure> {
        let array = self.asarray(None)?;
        Ok(array
            .cast::<PyUntypedArray>()
            .is_ok_and(|a| a.dtype().kind() == b'M'))
    }

    /// Whether it holds dates or durations of any kind.
    pub(crate) fn is_dated(&self) -> Result<bool, Failure> {
        let array = self.asarray(None)?;
        let kind = array
            .cast::<PyUntypedArray>()
            .map_or(b'f', |a| a.dtype().kind());
        Ok(match kind {
            b'M' | b'm' => true,
            b'O' => self.holds_dates(&array),
            _ => false,
        })
    }

    /// Whether these are Python's or pandas's own dates.
    fn holds_dates(&self, array: &Bound<'py, PyAny>) -> bool {
        let first = || -> PyResult<bool> {
            let date = array.py().import("datetime")?.getattr("datetime")?;
            array.getattr("flat")?.get_item(0)?.is_instance(&date)
        };
        first().unwrap_or(false)
    }

    /// Seconds that a stamp can hold.
    fn seconds(&self) -> Result<Vec<Option<Time>>, Failure> {
        let seconds = self.column(None)?;
        if let Some(row) = seconds.iter().position(|s| s.abs() > MOST_SECONDS) {
            let (name, given) = (&self.name, seconds[row]);
            return Err(Failure::new(
                "bad_time",
                format!("{name}[{row}] = {given:e} s: more than 290 years"),
                "give seconds (milliseconds / 1e3, nanoseconds / 1e9), or datetime64[ns]",
            )
            .about(name, format!("{given:e}"), "seconds"));
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
        let failed = |e: String| {
            Failure::new(
                "not_numbers",
                format!("{}: cannot be read as times: {e}", self.name),
                "give seconds, or datetime64[ns]",
            )
            .about(&self.name, self.type_name(), "seconds, or datetime64[ns]")
        };
        let nanos = nanos().map_err(|raised: PyErr| {
            Failure::raised(array.py(), raised, |e| failed(e.to_string()))
        })?;
        let nanos = nanos
            .cast::<PyArray1<i64>>()
            .map_err(|_| self.wrong(&shape_of(array), "(n,)"))?
            .readonly();
        let nanos = nanos.as_slice().map_err(|e| failed(e.to_string()))?;
        Ok(nanos
            .iter()
            .map(|&t| (t != i64::MIN).then_some(Time(t)))
            .collect())
    }
}
