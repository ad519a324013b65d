//! Samples → arrays as `insnav.run` takes them.

use crate::arrays::scalars;
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// How fixes are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fixes {
    /// With standard deviations, (n, 3): what is not on the diagonal is left out.
    Sigmas,
    /// To the last bit: with covariances, (n, 3, 3), and positions in degrees that give the same radians again.
    Exact,
}

/// One kind of data: its stamps, and columns with so many numbers a row.
#[derive(Default)]
struct Kind {
    time_s: Vec<f64>,
    columns: Vec<(usize, Vec<f64>)>,
    /// Of fixes: whether any row states an uncertainty.
    stated: bool,
}

impl Kind {
    fn push(&mut self, time_s: f64, row: &[&[f64]]) {
        self.time_s.push(time_s);
        if self.columns.is_empty() {
            self.columns = row.iter().map(|c| (c.len(), Vec::new())).collect();
        }
        for ((_, column), values) in self.columns.iter_mut().zip(row) {
            column.extend_from_slice(values);
        }
    }

    fn into_tuple(self, py: Python<'_>) -> PyResult<Bound<'_, PyTuple>> {
        let rows = self.time_s.len();
        let mut columns = vec![scalars(py, self.time_s)?];
        for (width, values) in self.columns {
            let array = PyArray1::from_vec(py, values);
            columns.push(match width {
                1 => array.into_bound_py_any(py)?,
                9 => array.reshape([rows, 3, 3])?.into_bound_py_any(py)?,
                _ => array.reshape([rows, width])?.into_bound_py_any(py)?,
            });
        }
        PyTuple::new(py, columns)
    }
}

/// Arrays by their keys, filled sample by sample. The rows of a kind come in the order of their stamps.
pub(crate) struct Columns {
    kinds: Vec<(&'static str, Kind)>,
    origin: Time,
    fixes: Fixes,
}

impl Columns {
    /// Seconds count from `origin`.
    pub(crate) fn new(origin: Time, fixes: Fixes) -> Self {
        Columns {
            kinds: Vec::new(),
            origin,
            fixes,
        }
    }

    pub(crate) fn push(&mut self, sample: &Sample) {
        let t = sample.time().since(self.origin);
        match sample {
            Sample::Imu(s) => self.of("imu").push(
                t,
                &[s.angular_rate_b.as_slice(), s.specific_force_b.as_slice()],
            ),
            Sample::ImuIncrement(s) => self
                .of("imu_increment")
                .push(t, &[s.angle_b.as_slice(), s.velocity_b.as_slice()]),
            Sample::GnssPosition(s) => {
                let p = &s.position;
                let degrees: fn(f64) -> f64 = match self.fixes {
                    Fixes::Sigmas => f64::to_degrees,
                    Fixes::Exact => exact_degrees,
                };
                let at = [degrees(p.latitude), degrees(p.longitude), p.height];
                self.fix("gnss_position", t, &at, s.covariance_n);
            }
            Sample::GnssVelocity(s) => {
                self.fix("gnss_velocity", t, &s.velocity_n.into(), s.covariance_n);
            }
            Sample::Heading(s) => {
                let (heading, sigma) = (exact_degrees(s.heading), exact_degrees(s.sigma));
                self.of("heading").push(t, &[&[heading], &[sigma]]);
            }
            Sample::Standstill(s) => {
                let standing = if s.standing { 1.0 } else { 0.0 };
                self.of("standstill").push(t, &[&[standing]]);
            }
            Sample::Speed(s) => self.of("speed").push(t, &[&[s.speed]]),
            Sample::Magnetic(s) => self.of("magnetic_field").push(t, &[s.field_b.as_slice()]),
        }
    }

    /// NaN where nothing is stated; where nothing is stated anywhere there is no column for it.
    fn fix(
        &mut self,
        key: &'static str,
        t: f64,
        values: &[f64; 3],
        covariance: Option<Matrix3<f64>>,
    ) {
        let fixes = self.fixes;
        let kind = self.of(key);
        kind.stated |= covariance.is_some();
        let p = covariance.unwrap_or(Matrix3::from_element(f64::NAN));
        match fixes {
            Fixes::Sigmas => {
                let sigma: Vector3<f64> = p.diagonal().map(f64::sqrt);
                kind.push(t, &[values, sigma.as_slice()]);
            }
            // Numbers lie by columns there, by rows here.
            Fixes::Exact => kind.push(t, &[values, p.transpose().as_slice()]),
        }
    }

    fn of(&mut self, key: &'static str) -> &mut Kind {
        let at = match self.kinds.iter().position(|(k, _)| *k == key) {
            Some(at) => at,
            None => {
                self.kinds.push((key, Kind::default()));
                self.kinds.len() - 1
            }
        };
        &mut self.kinds[at].1
    }

    /// Whether nothing came.
    pub(crate) fn is_empty(&self) -> bool {
        self.kinds.is_empty()
    }

    /// The mapping, in the order in which the kinds came, with the antenna's place where it is known.
    pub(crate) fn into_mapping(
        self,
        py: Python<'_>,
        lever_arm_b: Option<Vector3<f64>>,
    ) -> PyResult<Bound<'_, PyDict>> {
        let mapping = PyDict::new(py);
        for (key, mut kind) in self.kinds {
            if key.starts_with("gnss") && !kind.stated {
                kind.columns.pop();
            }
            mapping.set_item(key, kind.into_tuple(py)?)?;
        }
        if let Some(arm) = lever_arm_b {
            mapping.set_item("lever_arm_b_m", scalars(py, <[f64; 3]>::from(arm))?)?;
        }
        Ok(mapping)
    }
}

/// Degrees that give these radians again, to the last bit, where there are such.
///
/// What once was degrees has them within a step or two of what is computed; of other radians every other one has none.
fn exact_degrees(radians: f64) -> f64 {
    let near = radians.to_degrees();
    let (up, down) = (near.next_up(), near.next_down());
    [near, up, down, up.next_up(), down.next_down()]
        .into_iter()
        .find(|d| d.to_radians() == radians)
        .unwrap_or(near)
}
