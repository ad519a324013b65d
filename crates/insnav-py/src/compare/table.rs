//! A solution or a reference as the user has it: a file, or columns by name.

use super::known;
use crate::arrays::Argument;
use crate::failure::{Failure, fail};
use crate::withheld::judged_apart;
use insnav_core::attitude::{Euler, wrap_angle};
use insnav_core::earth::Geodetic;
use insnav_core::metrics::{AttitudeReference, ReferencePoint, Withheld};
use insnav_core::time::Time;
use insnav_log::{ComparedReference, ComparedSolution, METADATA_T0, SolutionTable, Withhold};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use std::path::PathBuf;

/// One of the two, as the user has it.
pub(super) enum Given<'py> {
    File(PathBuf),
    Columns(Table<'py>),
}

impl<'py> Given<'py> {
    pub(super) fn new(object: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Self> {
        if let Ok(path) = object.extract::<PathBuf>() {
            return Ok(Given::File(path));
        }
        let py = object.py();
        // Data frames and their like as mappings, columns as those of solutions.
        let mapping = py
            .import("insnav._compare")?
            .getattr("columns_of")?
            .call1((object,))?;
        let table = Table {
            mapping: mapping.cast::<PyMapping>().ok().cloned(),
            object: object.clone(),
            name,
        };
        if let Some(mapping) = &table.mapping {
            let names: PyResult<Vec<String>> = mapping
                .keys()?
                .iter()
                .map(|key| Ok(key.str()?.to_string()))
                .collect();
            known::check(py, name, &names?)?;
        }
        if table.mapping.is_none() && !object.hasattr("time_s")? {
            return Err(PyTypeError::new_err(format!(
                "{name}: expected a solution, a path or a mapping of columns, not {}",
                object.get_type()
            )));
        }
        Ok(Given::Columns(table))
    }

    pub(super) fn name(&self) -> String {
        match self {
            Given::File(path) => path.display().to_string(),
            Given::Columns(table) => table.name.to_owned(),
        }
    }
}

/// Columns by name: the keys of a mapping, or the attributes of a solution or a truth.
pub(super) struct Table<'py> {
    object: Bound<'py, PyAny>,
    mapping: Option<Bound<'py, PyMapping>>,
    name: &'static str,
}

impl<'py> Table<'py> {
    fn item(&self, key: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let found = match &self.mapping {
            Some(mapping) if mapping.contains(key)? => mapping.get_item(key)?,
            None if self.object.hasattr(key)? => self.object.getattr(key)?,
            _ => return Ok(None),
        };
        Ok((!found.is_none()).then_some(found))
    }

    fn column(&self, key: &str) -> PyResult<Option<Argument<'py>>> {
        let name = match self.mapping {
            Some(_) => format!("{}[{key:?}]", self.name),
            None => format!("{}.{key}", self.name),
        };
        Ok(self.item(key)?.map(|object| Argument { name, object }))
    }

    /// Whether it has what only solutions have: a covariance.
    pub(super) fn is_solution(&self) -> PyResult<bool> {
        Ok(self.item("position_covariance_n_m2")?.is_some() && self.item("t0_ns")?.is_some())
    }

    fn fail(&self, failure: Failure) -> PyErr {
        fail(self.object.py())(failure)
    }

    fn numbers(&self, key: &str, shape: &[usize]) -> PyResult<Option<Vec<f64>>> {
        let Some(column) = self.column(key)? else {
            return Ok(None);
        };
        column.shaped(shape).map(Some).map_err(|e| self.fail(e))
    }

    fn scalars(&self, key: &str, n: usize) -> PyResult<Option<Vec<f64>>> {
        self.numbers(key, &[n])
    }

    fn vectors(&self, key: &str, n: usize) -> PyResult<Option<Vec<Vector3<f64>>>> {
        let Some(column) = self.column(key)? else {
            return Ok(None);
        };
        let vectors = column.vectors_or_one(n).map_err(|e| self.fail(e))?;
        Ok(Some(vectors))
    }

    /// Covariances, or what standard deviations say of them.
    fn covariances(
        &self,
        key: &str,
        sigma_key: &str,
        factor: f64,
        n: usize,
    ) -> PyResult<Vec<Matrix3<f64>>> {
        if let Some(values) = self.numbers(key, &[n, 3, 3])? {
            return Ok(values
                .chunks_exact(9)
                .map(Matrix3::from_row_slice)
                .collect());
        }
        let unknown = Matrix3::from_element(f64::NAN);
        let Some(sigmas) = self.vectors(sigma_key, n)? else {
            return Ok(vec![unknown; n]);
        };
        let squared = |s: &Vector3<f64>| {
            let s = s * factor;
            Matrix3::from_diagonal(&s.component_mul(&s))
        };
        Ok(sigmas.iter().map(squared).collect())
    }

    /// Stamps; seconds count from `origin`.
    fn times(&self, origin: Time) -> PyResult<Vec<Time>> {
        if let Some(column) = self.column("time_ns")? {
            let stamps = column.integers().map_err(|e| self.fail(e))?;
            return Ok(stamps.into_iter().map(Time).collect());
        }
        let Some(column) = self.column("time_s")? else {
            return Err(self.fail(Failure::new(
                "missing_column",
                format!("{}: there is no column `time_s`", self.name),
                "give the stamps, s or datetime64",
            )));
        };
        let absolute = column.is_dates().map_err(|e| self.fail(e))?;
        let times = column.times().map_err(|e| self.fail(e))?;
        Ok(match absolute {
            true => times,
            false => times.iter().map(|t| Time(t.0 + origin.0)).collect(),
        })
    }

    /// Roll, pitch and heading, rad; `None` when there is none of them.
    fn angles(&self, n: usize) -> PyResult<Option<Vec<Vector3<f64>>>> {
        let mut any = false;
        let mut angles = vec![Vector3::repeat(f64::NAN); n];
        for (i, key) in ["roll_deg", "pitch_deg", "heading_deg"]
            .into_iter()
            .enumerate()
        {
            if let Some(column) = self.scalars(key, n)? {
                any = true;
                for (angle, degrees) in angles.iter_mut().zip(column) {
                    angle[i] = degrees.to_radians();
                }
            }
        }
        Ok(any.then_some(angles))
    }

    fn quaternions(&self, n: usize) -> PyResult<Option<Vec<Option<UnitQuaternion<f64>>>>> {
        let values = self.numbers("quaternion_nb_wxyz", &[n, 4])?;
        let unit = |q: &[f64]| {
            let q = Quaternion::new(q[0], q[1], q[2], q[3]);
            let norm = q.norm();
            (norm.is_finite() && norm > 0.5).then(|| UnitQuaternion::new_normalize(q))
        };
        Ok(values.map(|v| v.chunks_exact(4).map(unit).collect()))
    }

    fn positions(&self, n: usize) -> PyResult<Option<Vec<Geodetic>>> {
        let latitude = self.scalars("latitude_deg", n)?;
        let longitude = self.scalars("longitude_deg", n)?;
        let height = self.scalars("height_m", n)?;
        let (latitude, longitude, height) = match (latitude, longitude, height) {
            (Some(latitude), Some(longitude), Some(height)) => (latitude, longitude, height),
            (None, None, None) => return Ok(None),
            (latitude, longitude, _) => {
                let missing = match (latitude, longitude) {
                    (None, _) => "latitude_deg",
                    (_, None) => "longitude_deg",
                    _ => "height_m",
                };
                return Err(self.fail(
                    Failure::new(
                        "missing_column",
                        format!(
                            "{}: part of a position, without the column `{missing}`",
                            self.name
                        ),
                        "give latitude_deg, longitude_deg and height_m, or none of them",
                    )
                    .about(self.name, "part of a position", missing),
                ));
            }
        };
        for (key, values, most) in [
            ("latitude_deg", &latitude, 90.0),
            ("longitude_deg", &longitude, 360.0),
        ] {
            // What is not finite is nothing to compare with.
            let impossible = |v: &f64| v.is_finite() && v.abs() > most;
            if let Some(row) = values.iter().position(impossible) {
                return Err(self.fail(Failure::argument(
                    "bad_value",
                    &format!("{}[{key:?}][{row}]", self.name),
                    values[row].to_string(),
                    format!("-{most} to {most} degrees"),
                    "check that latitude and longitude are in their columns, in degrees; NaN where there is no position",
                )));
            }
        }
        let at = |i: usize| Geodetic::from_degrees(latitude[i], longitude[i], height[i]);
        Ok(Some((0..n).map(at).collect()))
    }

    pub(super) fn solution(&self) -> PyResult<ComparedSolution> {
        let t0 = match self.item("t0_ns")? {
            Some(t0) => t0.extract()?,
            None => 0,
        };
        let time = self.times(Time(t0))?;
        let n = time.len();
        let unknown = Vector3::repeat(f64::NAN);
        let mut table = SolutionTable {
            position: self
                .positions(n)?
                .unwrap_or_else(|| vec![Geodetic::from_degrees(f64::NAN, f64::NAN, f64::NAN); n]),
            velocity_n: self
                .vectors("velocity_n_m_per_s", n)?
                .unwrap_or_else(|| vec![unknown; n]),
            rate_b: self.vectors("rate_b_deg_per_s", n)?.map_or_else(
                || vec![unknown; n],
                |rates| rates.iter().map(|w| w.map(f64::to_radians)).collect(),
            ),
            position_covariance_n: self.covariances(
                "position_covariance_n_m2",
                "sigma_position_n_m",
                1.0,
                n,
            )?,
            velocity_covariance_n: self.covariances(
                "velocity_covariance_n_m2_per_s2",
                "sigma_velocity_n_m_per_s",
                1.0,
                n,
            )?,
            attitude_covariance_n: self.covariances(
                "attitude_covariance_n_rad2",
                "sigma_attitude_n_deg",
                1f64.to_radians(),
                n,
            )?,
            has_velocity: true,
            ..SolutionTable::default()
        };
        let attitudes = match self.quaternions(n)? {
            Some(q) => Some(q),
            None => self.angles(n)?.map(|angles| {
                angles
                    .iter()
                    .map(|a| {
                        a.iter().all(|x| x.is_finite()).then(|| {
                            Euler {
                                roll: a.x,
                                pitch: a.y,
                                heading: a.z,
                            }
                            .to_quaternion()
                        })
                    })
                    .collect()
            }),
        };
        table.has_attitude = attitudes.is_some();
        table.q_nb = match attitudes {
            None => vec![UnitQuaternion::identity(); n],
            Some(all) => {
                if let Some(row) = all.iter().position(Option::is_none) {
                    return Err(self.fail(Failure::new(
                        "not_finite",
                        format!("{}: no attitude in row {row}", self.name),
                        "drop the rows without an attitude, or the columns of attitude",
                    )));
                }
                all.into_iter().flatten().collect()
            }
        };
        let standing = self.scalars("standing", n)?;
        table.has_standing = standing.is_some();
        table.stationary = standing.map_or_else(
            || vec![false; n],
            |s| s.iter().map(|v| *v != 0.0 && v.is_finite()).collect(),
        );
        table.standing_s = self
            .scalars("standing_s", n)?
            .unwrap_or_else(|| vec![0.0; n]);
        table.time = time;
        table.metadata.insert(METADATA_T0.into(), t0.to_string());
        // The lever arm and the clocks, and what is judged apart.
        for key in ["config", "withhold"] {
            if let Some(text) = self.told(key)? {
                table.metadata.insert(key.into(), text);
            }
        }
        Ok(ComparedSolution::of(&table))
    }

    /// What the summary of the run says under a key.
    fn told(&self, key: &str) -> PyResult<Option<String>> {
        let Some(summary) = self.item("summary")? else {
            return Ok(None);
        };
        let Ok(summary) = summary.cast_into::<PyMapping>() else {
            return Ok(None);
        };
        match summary.contains(key)? {
            true => Ok(summary.get_item(key)?.extract().ok()),
            false => Ok(None),
        }
    }

    /// Fixes that were withheld one in so many, as the run was told.
    pub(super) fn withheld_singly(&self) -> PyResult<Option<String>> {
        Ok(self
            .told("withhold")?
            .filter(|rule| matches!(rule.parse(), Ok(Withhold::Every(_)))))
    }

    /// Which they were, where the solution has kept them.
    pub(super) fn withheld_fixes(&self) -> PyResult<Option<Withheld>> {
        match self.item("withheld")? {
            Some(fixes) if fixes.hasattr("time_ns")? && fixes.len()? > 0 => {
                judged_apart(&fixes).map(Some)
            }
            _ => Ok(None),
        }
    }

    pub(super) fn reference(
        &self,
        origin: Time,
        at_antenna: Option<bool>,
    ) -> PyResult<ComparedReference> {
        let time = self.times(origin)?;
        let n = time.len();
        let positions = self.positions(n)?;
        let velocities = self.vectors("velocity_n_m_per_s", n)?;
        let position_sigmas = self.vectors("sigma_position_n_m", n)?;
        let velocity_sigmas = self.vectors("sigma_velocity_n_m_per_s", n)?;
        let angles = self.angles(n)?;
        let quaternions = match angles {
            Some(_) => None,
            None => self.quaternions(n)?,
        };
        let moving = match self.scalars("moving", n)? {
            Some(moving) => Some(moving.iter().map(|m| *m != 0.0).collect::<Vec<_>>()),
            None => self
                .scalars("standing", n)?
                .map(|s| s.iter().map(|s| *s == 0.0).collect()),
        };
        if positions.is_none() && velocities.is_none() && angles.is_none() && quaternions.is_none()
        {
            return Err(self.fail(Failure::new(
                "missing_column",
                format!("{}: there is nothing to compare with", self.name),
                "give latitude_deg and longitude_deg, velocity_n_m_per_s, heading_deg or quaternion_nb_wxyz",
            )));
        }
        let known = |sigmas: &Option<Vec<Vector3<f64>>>, i: usize| {
            sigmas.as_ref().map_or(Vector3::zeros(), |s| {
                s[i].map(|s| if s.is_finite() { s } else { 0.0 })
            })
        };
        let attitude = |i: usize| {
            let of = |a: Vector3<f64>| AttitudeReference::Angles {
                roll: a.x,
                pitch: a.y,
                heading: wrap_angle(a.z),
            };
            if let Some(angles) = &angles {
                return of(angles[i]);
            }
            match quaternions.as_ref().and_then(|q| q[i]) {
                // What turns and goes nowhere is scored as orientations are.
                Some(q) if positions.is_none() => AttitudeReference::Quaternion(q),
                Some(q) => {
                    let e = Euler::from_quaternion(&q);
                    of(Vector3::new(e.roll, e.pitch, e.heading))
                }
                None => AttitudeReference::None,
            }
        };
        let mut points: Vec<ReferencePoint> = (0..n)
            .map(|i| ReferencePoint {
                time: time[i],
                position: positions.as_ref().map(|p| p[i]).filter(Geodetic::is_valid),
                position_sigma_n: known(&position_sigmas, i),
                velocity_n: velocities
                    .as_ref()
                    .map(|v| v[i])
                    .filter(|v| v.x.is_finite() && v.y.is_finite()),
                velocity_sigma_n: known(&velocity_sigmas, i),
                attitude: attitude(i),
                moving: moving.as_ref().map(|m| m[i]),
            })
            .collect();
        points.sort_by_key(|p| p.time);
        let bare = positions.is_some() && angles.is_none() && quaternions.is_none();
        Ok(ComparedReference {
            points,
            at_antenna: at_antenna.unwrap_or(bare),
            warnings: Vec::new(),
        })
    }
}
