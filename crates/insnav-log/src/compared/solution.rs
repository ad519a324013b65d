//! A solution to be judged.

use super::{is_mcap, is_tum};
use crate::convert::is_solution;
use crate::csv::Table;
use crate::log::{Log, METADATA_T0, ReadOptions};
use crate::orientation::OrientationTable;
use crate::run::Withhold;
use crate::tum::Trajectory;
use crate::{LogError, SolutionTable, parse_config};
use insnav_core::earth::Geodetic;
use insnav_core::metrics::{ReferencePoint, SolutionPoint, Track, Withheld};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

/// A solution, and what its file says about how it was made.
#[derive(Clone, Debug, Default)]
pub struct ComparedSolution {
    /// Its points.
    pub track: Track,
    /// Zero of all seconds.
    pub origin: Time,
    /// Antenna from the solution's point, forward-right-down, m.
    pub lever_arm_b: Vector3<f64>,
    /// How far the stamp of a GNSS velocity is behind its instant, s.
    pub velocity_lag: f64,
    /// What was added to the IMU's stamps to meet the solution's clock, s.
    pub time_offset: f64,
    /// What was withheld from the navigator.
    pub withheld: Withheld,
    /// Where a trajectory in metres (TUM) has its zero.
    pub map_origin: Option<Geodetic>,
}

impl ComparedSolution {
    /// Read an MCAP of [`crate::McapSink`], an orientation (an MCAP of `insnav ahrs`, or a table of quaternions), a common CSV (also
    /// a `gnss.csv`), or a TUM trajectory.
    ///
    /// A TUM trajectory lies around `map_origin`, which another file has to tell.
    pub fn read(path: &Path, map_origin: Option<Geodetic>) -> Result<Self, LogError> {
        if !is_mcap(path)? && is_tum(path)? {
            let origin = map_origin.ok_or_else(|| LogError::NotASolution {
                path: path.into(),
                reason: "a TUM trajectory does not say where on the Earth its zero is, and neither does the other file".into(),
            })?;
            let table = SolutionTable::from_trajectory(&Trajectory::read(path)?, origin);
            return Ok(ComparedSolution {
                map_origin,
                ..ComparedSolution::of(&table)
            });
        }
        if is_mcap(path)? {
            let log = Log::open(path, ReadOptions::default())?;
            if !is_solution(&log) {
                return Ok(of_orientation(&OrientationTable::from_mcap(&log)?));
            }
        } else {
            let table = Table::read(path)?;
            if OrientationTable::is_csv(&table) {
                return Ok(of_orientation(&OrientationTable::from_csv(
                    &table,
                    Time(0),
                )?));
            }
        }
        Ok(ComparedSolution::of(&SolutionTable::read(path)?))
    }

    /// Of a solution in memory; its metadata say how it was made.
    pub fn of(table: &SolutionTable) -> Self {
        let origin = table
            .metadata
            .get(METADATA_T0)
            .and_then(|t| t.parse().ok())
            .map_or(Time(0), Time);
        let config = table
            .metadata
            .get("config")
            .and_then(|text| parse_config(text, "metadata", &[]).ok())
            .unwrap_or_default();
        let arm = Vector3::from(config.gnss.lever_arm_b_m.unwrap_or_default())
            - Vector3::from(config.output.lever_arm_b_m);
        ComparedSolution {
            track: track(table),
            origin,
            lever_arm_b: arm,
            velocity_lag: config.gnss.velocity_lag_s,
            time_offset: config.gnss.time_offset_s,
            withheld: withheld(table, origin),
            map_origin: table
                .metadata
                .get("origin_lat_lon_deg_h_m")
                .and_then(|text| map_origin(text)),
        }
    }
}

impl ComparedSolution {
    /// Judge these stretches apart, whatever the file says: `120:150,300:330`, seconds from the origin.
    pub fn set_withheld(&mut self, rule: &str) -> Result<(), String> {
        let origin = self.origin;
        match rule.parse()? {
            Withhold::Intervals(intervals) => {
                self.withheld = Withheld::Intervals(
                    intervals
                        .iter()
                        .map(|(a, b)| (origin.plus(*a), origin.plus(*b)))
                        .collect(),
                );
                Ok(())
            }
            other => Err(format!(
                "{other} names fixes, not intervals: which they are only the file of the solution says"
            )),
        }
    }
}

/// What turns, wherever it is.
fn of_orientation(table: &OrientationTable) -> ComparedSolution {
    let points = (0..table.time.len()).map(|i| SolutionPoint {
        time: table.time[i],
        q_nb: Some(table.q_nb[i]),
        attitude_covariance_n: table.covariance_n[i],
        ..SolutionPoint::default()
    });
    ComparedSolution {
        track: Track::new(points.collect()),
        origin: table.t0().unwrap_or(Time(0)),
        ..ComparedSolution::default()
    }
}

fn withheld(table: &SolutionTable, origin: Time) -> Withheld {
    match table
        .metadata
        .get("withhold")
        .and_then(|rule| rule.parse().ok())
    {
        Some(Withhold::Intervals(intervals)) => Withheld::Intervals(
            intervals
                .iter()
                .map(|(a, b)| (origin.plus(*a), origin.plus(*b)))
                .collect(),
        ),
        Some(Withhold::Every(_)) => Withheld::Fixes(
            table
                .withheld
                .iter()
                .map(|fix| ReferencePoint {
                    time: fix.time,
                    position: Some(fix.position),
                    position_sigma_n: fix
                        .covariance_n
                        .map(|c| c.diagonal().map(f64::sqrt))
                        .unwrap_or_default(),
                    ..ReferencePoint::default()
                })
                .collect(),
        ),
        _ => Withheld::Nothing,
    }
}

/// `[lat, lon, h]`, degrees and metres.
fn map_origin(text: &str) -> Option<Geodetic> {
    let numbers: Vec<f64> = text
        .trim_matches(['[', ']'])
        .split(',')
        .filter_map(|x| x.trim().parse().ok())
        .collect();
    match numbers[..] {
        [latitude, longitude, height] => Some(Geodetic::from_degrees(latitude, longitude, height)),
        _ => None,
    }
}

fn track(table: &SolutionTable) -> Track {
    let finite = |v: Vector3<f64>| v.iter().all(|x| x.is_finite()).then_some(v);
    // A covariance that the file does not state is NaN, or zero where only its diagonal was known.
    let stated = |p: Matrix3<f64>| {
        p.diagonal()
            .iter()
            .all(|x| x.is_finite() && *x > 0.0)
            .then_some(p)
    };
    let points = (0..table.len()).map(|i| SolutionPoint {
        time: table.time[i],
        position: table.position[i].is_valid().then_some(table.position[i]),
        velocity_n: finite(table.velocity_n[i]),
        q_nb: table.has_attitude.then_some(table.q_nb[i]),
        rate_b: finite(table.rate_b[i]),
        position_covariance_n: stated(table.position_covariance_n[i]),
        velocity_covariance_n: stated(table.velocity_covariance_n[i]),
        attitude_covariance_n: stated(table.attitude_covariance_n[i]),
        position_attitude_covariance_n: None,
        stationary: table.has_standing.then_some(table.stationary[i]),
        standing_since: table.stationary[i].then(|| table.time[i].plus(-table.standing_s[i])),
    });
    Track::new(points.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn map_origins() {
        let at = map_origin("[59.5, 18.25, 30.0]").expect("three numbers");
        assert!((at.latitude_deg() - 59.5).abs() < 1e-12 && at.height == 30.0);
        assert_eq!(map_origin("[59.5, 18.25]"), None);
    }
}
