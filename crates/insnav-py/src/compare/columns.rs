//! The columns of a solution or a reference, out of Python's hands: what is made of them needs no interpreter.

use crate::failure::Failure;
use insnav_core::attitude::{Euler, wrap_angle};
use insnav_core::earth::Geodetic;
use insnav_core::metrics::{AttitudeReference, ReferencePoint};
use insnav_core::time::Time;
use insnav_log::{ComparedReference, ComparedSolution, METADATA_T0, SolutionTable};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// Columns by name, one entry a stamp in each.
pub(super) struct Columns {
    /// What the user calls them.
    pub(super) name: &'static str,
    pub(super) time: Vec<Time>,
    /// Whether the stamps are instants already.
    pub(super) absolute: bool,
    pub(super) t0_ns: i64,
    /// Numbers, row by row.
    pub(super) numbers: BTreeMap<&'static str, Vec<f64>>,
    pub(super) vectors: BTreeMap<&'static str, Vec<Vector3<f64>>>,
    /// What the summary of the run says: the lever arm and the clocks, and what is judged apart.
    pub(super) told: BTreeMap<&'static str, String>,
}

impl Columns {
    /// Stamps; seconds count from `origin`.
    fn since(&self, origin: Time) -> Vec<Time> {
        match self.absolute {
            true => self.time.clone(),
            false => self
                .time
                .iter()
                .map(|t| Time(t.0.saturating_add(origin.0)))
                .collect(),
        }
    }

    /// Covariances, or what standard deviations say of them.
    fn covariances(&mut self, key: &str, sigma_key: &str, factor: f64) -> Vec<Matrix3<f64>> {
        if let Some(values) = self.numbers.remove(key) {
            return values
                .chunks_exact(9)
                .map(Matrix3::from_row_slice)
                .collect();
        }
        let Some(sigmas) = self.vectors.remove(sigma_key) else {
            return vec![Matrix3::from_element(f64::NAN); self.time.len()];
        };
        let squared = |s: &Vector3<f64>| {
            let s = s * factor;
            Matrix3::from_diagonal(&s.component_mul(&s))
        };
        sigmas.iter().map(squared).collect()
    }

    /// Roll, pitch and heading, rad; `None` when there is none of them.
    fn angles(&mut self) -> Option<Vec<Vector3<f64>>> {
        let n = self.time.len();
        let mut any = false;
        let mut angles = vec![Vector3::repeat(f64::NAN); n];
        for (i, key) in ["roll_deg", "pitch_deg", "heading_deg"]
            .into_iter()
            .enumerate()
        {
            if let Some(column) = self.numbers.remove(key) {
                any = true;
                for (angle, degrees) in angles.iter_mut().zip(column) {
                    angle[i] = degrees.to_radians();
                }
            }
        }
        any.then_some(angles)
    }

    fn quaternions(&mut self) -> Option<Vec<Option<UnitQuaternion<f64>>>> {
        let values = self.numbers.remove("quaternion_nb_wxyz")?;
        let unit = |q: &[f64]| {
            let q = Quaternion::new(q[0], q[1], q[2], q[3]);
            let norm = q.norm();
            (norm.is_finite() && norm > 0.5).then(|| UnitQuaternion::new_normalize(q))
        };
        Some(values.chunks_exact(4).map(unit).collect())
    }

    fn positions(&mut self) -> Result<Option<Vec<Geodetic>>, Failure> {
        let latitude = self.numbers.remove("latitude_deg");
        let longitude = self.numbers.remove("longitude_deg");
        let height = self.numbers.remove("height_m");
        let (latitude, longitude, height) = match (latitude, longitude, height) {
            (Some(latitude), Some(longitude), Some(height)) => (latitude, longitude, height),
            (None, None, None) => return Ok(None),
            (latitude, longitude, _) => {
                let missing = match (latitude, longitude) {
                    (None, _) => "latitude_deg",
                    (_, None) => "longitude_deg",
                    _ => "height_m",
                };
                return Err(Failure::new(
                    "missing_column",
                    format!(
                        "{}: part of a position, without the column `{missing}`",
                        self.name
                    ),
                    "give latitude_deg, longitude_deg and height_m, or none of them",
                )
                .about(self.name, "part of a position", missing));
            }
        };
        for (key, values, most) in [
            ("latitude_deg", &latitude, 90.0),
            ("longitude_deg", &longitude, 360.0),
        ] {
            // What is not finite is nothing to compare with.
            let impossible = |v: &f64| v.is_finite() && v.abs() > most;
            if let Some(row) = values.iter().position(impossible) {
                return Err(Failure::argument(
                    "bad_value",
                    &format!("{}[{key:?}][{row}]", self.name),
                    values[row].to_string(),
                    format!("-{most} to {most} degrees"),
                    "check that latitude and longitude are in their columns, in degrees; NaN where there is no position",
                ));
            }
        }
        let at = |i: usize| Geodetic::from_degrees(latitude[i], longitude[i], height[i]);
        Ok(Some((0..latitude.len()).map(at).collect()))
    }

    /// A solution of them.
    ///
    /// # Errors
    /// A row without an attitude, a position that is none.
    pub(super) fn solution(mut self) -> Result<ComparedSolution, Failure> {
        let zero = Time(self.t0_ns);
        let n = self.time.len();
        let unknown = Vector3::repeat(f64::NAN);
        let mut table = SolutionTable {
            position: self
                .positions()?
                .unwrap_or_else(|| vec![Geodetic::from_degrees(f64::NAN, f64::NAN, f64::NAN); n]),
            velocity_n: self
                .vectors
                .remove("velocity_n_m_per_s")
                .unwrap_or_else(|| vec![unknown; n]),
            rate_b: self.vectors.remove("rate_b_deg_per_s").map_or_else(
                || vec![unknown; n],
                |rates| rates.iter().map(|w| w.map(f64::to_radians)).collect(),
            ),
            position_covariance_n: self.covariances(
                "position_covariance_n_m2",
                "sigma_position_n_m",
                1.0,
            ),
            velocity_covariance_n: self.covariances(
                "velocity_covariance_n_m2_per_s2",
                "sigma_velocity_n_m_per_s",
                1.0,
            ),
            attitude_covariance_n: self.covariances(
                "attitude_covariance_n_rad2",
                "sigma_attitude_n_deg",
                1f64.to_radians(),
            ),
            has_velocity: true,
            ..SolutionTable::default()
        };
        let attitudes = match self.quaternions() {
            Some(q) => Some(q),
            None => self.angles().map(|angles| {
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
                    return Err(Failure::new(
                        "not_finite",
                        format!("{}: no attitude in row {row}", self.name),
                        "drop the rows without an attitude, or the columns of attitude",
                    ));
                }
                all.into_iter().flatten().collect()
            }
        };
        let standing = self.numbers.remove("standing");
        table.has_standing = standing.is_some();
        table.stationary = standing.map_or_else(
            || vec![false; n],
            |s| s.iter().map(|v| *v != 0.0 && v.is_finite()).collect(),
        );
        table.standing_s = self
            .numbers
            .remove("standing_s")
            .unwrap_or_else(|| vec![0.0; n]);
        table.time = self.since(zero);
        table
            .metadata
            .insert(METADATA_T0.into(), self.t0_ns.to_string());
        for (key, text) in self.told {
            table.metadata.insert(key.into(), text);
        }
        Ok(ComparedSolution::of(&table))
    }

    /// A reference of them; seconds count from `origin`.
    ///
    /// # Errors
    /// There is nothing to compare with, a position that is none.
    pub(super) fn reference(
        mut self,
        origin: Time,
        at_antenna: Option<bool>,
    ) -> Result<ComparedReference, Failure> {
        let time = self.since(origin);
        let n = time.len();
        let positions = self.positions()?;
        let velocities = self.vectors.remove("velocity_n_m_per_s");
        let position_sigmas = self.vectors.remove("sigma_position_n_m");
        let velocity_sigmas = self.vectors.remove("sigma_velocity_n_m_per_s");
        let angles = self.angles();
        let quaternions = match angles {
            Some(_) => None,
            None => self.quaternions(),
        };
        let moving = match self.numbers.remove("moving") {
            Some(moving) => Some(moving.iter().map(|m| *m != 0.0).collect::<Vec<_>>()),
            None => self
                .numbers
                .remove("standing")
                .map(|s| s.iter().map(|s| *s == 0.0).collect()),
        };
        if positions.is_none() && velocities.is_none() && angles.is_none() && quaternions.is_none()
        {
            return Err(Failure::new(
                "missing_column",
                format!("{}: there is nothing to compare with", self.name),
                "give latitude_deg and longitude_deg, velocity_n_m_per_s, heading_deg or quaternion_nb_wxyz",
            ));
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
