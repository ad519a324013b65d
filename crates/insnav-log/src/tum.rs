//! The TUM trajectory format: `time x y z qx qy qz qw`, separated by blanks, no header.
//!
//! Written in the map of the solution (east, north, up from the origin; body forward-left-up), which is what evo and the
//! ROS tools take it for.

use crate::csv::{open_text, read_line, write_text};
use crate::error::LogError;
use crate::frames::{ENU_NED, FLU_FRD};
use crate::solution::SolutionTable;
use insnav_core::earth::{Geodetic, LocalFrame};
use insnav_core::time::Time;
use nalgebra::{Quaternion, Rotation3, UnitQuaternion, Vector3};
use std::io::{self, Write};
use std::path::Path;

/// A trajectory in a map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trajectory {
    /// Stamps.
    pub time: Vec<Time>,
    /// East, north, up from the map's origin, m.
    pub position: Vec<Vector3<f64>>,
    /// Body (forward-left-up) to map.
    pub orientation: Vec<UnitQuaternion<f64>>,
}

impl Trajectory {
    /// A solution in the map around `origin`.
    pub fn from_solution(solution: &SolutionTable, origin: Geodetic) -> Self {
        let map = LocalFrame::new(origin);
        let mut trajectory = Trajectory {
            time: solution.time.clone(),
            ..Trajectory::default()
        };
        for (at, q_nb) in solution.position.iter().zip(&solution.q_nb) {
            let c_nb = q_nb.to_rotation_matrix().into_inner();
            let c = ENU_NED * map.rotation_from(at) * c_nb * FLU_FRD;
            trajectory.position.push(ENU_NED * map.to_ned(at));
            trajectory
                .orientation
                .push(UnitQuaternion::from_rotation_matrix(
                    &Rotation3::from_matrix_unchecked(c),
                ));
        }
        trajectory
    }

    /// Read a TUM file.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let mut lines = open_text(path)?;
        let mut line = String::new();
        let mut number = 0;
        let mut trajectory = Trajectory::default();
        while read_line(&mut *lines, &mut line, path)? {
            number += 1;
            let text = line.trim();
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let bad = |column: &str, reason: String| LogError::Cell {
                path: path.into(),
                line: number,
                column: column.into(),
                reason,
            };
            let mut cells = text.split_whitespace();
            let time = cells
                .next()
                .and_then(parse_time)
                .ok_or_else(|| bad("time", "no number of seconds".into()))?;
            let mut values = [0.0; 7];
            for (value, name) in values
                .iter_mut()
                .zip(["x", "y", "z", "qx", "qy", "qz", "qw"])
            {
                let cell = cells
                    .next()
                    .ok_or_else(|| bad(name, "the line ends before this column".into()))?;
                *value = cell
                    .parse()
                    .map_err(|_| bad(name, format!("{cell:?} is no number")))?;
            }
            let [x, y, z, i, j, k, w] = values;
            let q = Quaternion::new(w, i, j, k);
            if !(q.norm() > 0.5 && q.norm() < 2.0) {
                return Err(bad("qw", format!("a quaternion of norm {}", q.norm())));
            }
            trajectory.time.push(time);
            trajectory.position.push(Vector3::new(x, y, z));
            trajectory
                .orientation
                .push(UnitQuaternion::new_normalize(q));
        }
        Ok(trajectory)
    }

    /// Write a TUM file. Times are exact to the nanosecond.
    pub fn write(&self, path: &Path, force: bool) -> Result<(), LogError> {
        write_text(path, force, |out| self.write_poses(out))
    }

    pub(crate) fn write_poses(&self, out: &mut dyn Write) -> io::Result<()> {
        for ((time, p), q) in self.time.iter().zip(&self.position).zip(&self.orientation) {
            let (sign, nanos) = (if time.0 < 0 { "-" } else { "" }, time.0.unsigned_abs());
            let (seconds, nanos) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
            write!(
                out,
                "{sign}{seconds}.{nanos:09} {:.6} {:.6} {:.6}",
                p.x, p.y, p.z
            )?;
            writeln!(out, " {:.12} {:.12} {:.12} {:.12}", q.i, q.j, q.k, q.w)?;
        }
        Ok(())
    }
}

/// Decimal seconds to nanoseconds without going through a `f64`, which holds today's time to 0.2 µs only.
fn parse_time(text: &str) -> Option<Time> {
    let (negative, digits) = text
        .strip_prefix('-')
        .map_or((false, text), |rest| (true, rest));
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let plain = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    if whole.is_empty() || !plain(whole) || !plain(fraction) {
        // Exponents and the like.
        return text
            .parse()
            .ok()
            .filter(|t: &f64| t.is_finite())
            .map(Time::from_seconds);
    }
    let mut nanos = 0i64;
    for i in 0..9 {
        nanos = nanos * 10
            + fraction
                .as_bytes()
                .get(i)
                .map_or(0, |digit| i64::from(digit - b'0'));
    }
    let total = whole
        .parse::<i64>()
        .ok()?
        .checked_mul(1_000_000_000)?
        .checked_add(nanos)?;
    Some(Time(if negative { -total } else { total }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn there_and_back(
            rows in proptest::collection::vec((any::<i32>(), 0u32..1_000_000_000, any::<[i16; 3]>(), any::<[i8; 3]>()), 1..20)
        ) {
            let mut trajectory = Trajectory::default();
            for (seconds, nanos, position, turn) in rows {
                trajectory.time.push(Time(i64::from(seconds) * 1_000_000_000 + i64::from(nanos)));
                trajectory.position.push(Vector3::from(position.map(|v| f64::from(v) * 0.125)));
                trajectory.orientation.push(UnitQuaternion::from_scaled_axis(Vector3::from(turn.map(|v| f64::from(v) * 0.02))));
            }
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("a.tum");
            trajectory.write(&path, false).unwrap();
            let back = Trajectory::read(&path).unwrap();
            prop_assert_eq!(&back.time, &trajectory.time);
            for (a, b) in back.position.iter().zip(&trajectory.position) {
                // Six decimals are written.
                prop_assert!((a - b).norm() < 1e-6);
            }
            for (a, b) in back.orientation.iter().zip(&trajectory.orientation) {
                prop_assert!(a.angle_to(b) < 1e-6);
            }
        }
    }

    #[test]
    fn times_are_exact() {
        assert_eq!(
            parse_time("1600000000.123456789"),
            Some(Time(1_600_000_000_123_456_789))
        );
        assert_eq!(parse_time("-0.5"), Some(Time(-500_000_000)));
        assert_eq!(parse_time("1.6e9"), Some(Time(1_600_000_000_000_000_000)));
        assert_eq!(parse_time("1.5.2"), None);
    }
}
