//! An orientation over time, read back from its file, and as a table of quaternions.

use crate::csv::{Cell, Table, write_text};
use crate::error::LogError;
use crate::frames::ENU_NED;
use crate::log::{Log, METADATA_NAME, METADATA_T0};
use crate::ros2::{Decode, Imu};
use insnav_core::metrics::to_enu_flu;
use insnav_core::time::Time;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

/// Topic of the orientation in a solution of `insnav ahrs`.
pub(crate) const ORIENTATION_TOPIC: &str = "/insnav/imu";

/// An orientation: one entry per epoch in every column.
///
/// Files have it as the sensor (forward-left-up) against east, north and up; here it is turned to the axes that are used inside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OrientationTable {
    /// Stamps.
    pub time: Vec<Time>,
    /// Rotation from body (forward-right-down) to NED.
    pub q_nb: Vec<UnitQuaternion<f64>>,
    /// Covariance as a small rotation in NED, rad²; `None` where the file states none.
    pub covariance_n: Vec<Option<Matrix3<f64>>>,
    /// Metadata of the run; empty for text files.
    pub metadata: BTreeMap<String, String>,
}

/// Columns of the standard deviations, as rotations about north, east and down.
const SIGMAS: [&str; 3] = [
    "sigma_rotation_north_deg",
    "sigma_rotation_east_deg",
    "sigma_heading_deg",
];

impl OrientationTable {
    /// Whether a log is the orientation that `insnav ahrs` writes.
    pub fn is_in(log: &Log) -> bool {
        topic(log).is_some()
    }

    /// From an MCAP of `insnav ahrs`: `/insnav/imu`, sensor_msgs/Imu with orientation and covariance.
    pub fn from_mcap(log: &Log) -> Result<Self, LogError> {
        let Some(topic) = topic(log) else {
            return Err(LogError::NotASolution {
                path: log.path().into(),
                reason: format!("no topic /insnav/state and no {ORIENTATION_TOPIC}"),
            });
        };
        let mut table = OrientationTable {
            metadata: log.metadata(METADATA_NAME).cloned().unwrap_or_default(),
            ..OrientationTable::default()
        };
        let mut messages = log.messages(&[topic]);
        while let Some(message) = messages.next() {
            let message = message?;
            let imu = Imu::decode(message.data).map_err(|e| log.undecodable(topic, &message, e))?;
            let [x, y, z, w] = imu.orientation;
            let covariance = Matrix3::from_row_slice(&imu.orientation_covariance);
            // -1: there is no orientation. Zeros: its covariance is unknown.
            if covariance[(0, 0)] >= 0.0 {
                let stated = covariance.diagonal().iter().all(|v| *v > 0.0);
                table.push(
                    imu.header.stamp,
                    Quaternion::new(w, x, y, z),
                    stated.then(|| ENU_NED * covariance * ENU_NED),
                );
            }
        }
        Ok(table)
    }

    /// Whether a table has quaternions and no positions.
    pub(crate) fn is_csv(table: &Table) -> bool {
        ["qw", "qx", "qy", "qz"]
            .iter()
            .all(|name| table.column(&[name]).is_some())
            && table.column(&["lat_deg", "latitude_deg"]).is_none()
    }

    /// From a table `t_s,qw,qx,qy,qz`, perhaps with standard deviations; rows with NaN are left out.
    pub(crate) fn from_csv(table: &Table, t0: Time) -> Result<Self, LogError> {
        let t_s = table.require(&["t_s"])?;
        let [w, x, y, z] = [
            table.require(&["qw"])?,
            table.require(&["qx"])?,
            table.require(&["qy"])?,
            table.require(&["qz"])?,
        ];
        let sigmas = SIGMAS.map(|name| table.column(&[name]));
        let mut orientation = OrientationTable::default();
        for i in (0..table.rows()).filter(|&i| t_s[i].is_finite()) {
            let sigma = Vector3::from(sigmas.map(|c| c.map_or(f64::NAN, |c| c[i].to_radians())));
            let stated = sigma.iter().all(|s| s.is_finite() && *s > 0.0);
            orientation.push(
                t0.plus(t_s[i]),
                Quaternion::new(w[i], x[i], y[i], z[i]),
                stated.then(|| Matrix3::from_diagonal(&sigma.component_mul(&sigma))),
            );
        }
        Ok(orientation)
    }

    /// A sensor (forward-left-up) against ENU with the covariance in NED; what is no rotation is left out.
    fn push(&mut self, time: Time, q: Quaternion<f64>, covariance_n: Option<Matrix3<f64>>) {
        let norm = q.norm();
        if norm.is_finite() && norm > 0.5 {
            self.time.push(time);
            self.q_nb
                .push(to_enu_flu(&UnitQuaternion::new_normalize(q)));
            self.covariance_n.push(covariance_n);
        }
    }

    /// Write as a table of quaternions (gzip if the name ends in `.gz`): sensor (forward-left-up) against ENU, standard deviations
    /// of a small rotation about north, east and down. `t_s` counts from the zero in the metadata, else from the first epoch.
    pub fn write_csv(&self, path: &Path, force: bool) -> Result<(), LogError> {
        let t0 = self.t0().or(self.time.first().copied()).unwrap_or_default();
        write_text(path, force, |out| {
            writeln!(out, "t_s,qw,qx,qy,qz,{}", SIGMAS.join(","))?;
            for ((time, q_nb), covariance) in
                self.time.iter().zip(&self.q_nb).zip(&self.covariance_n)
            {
                let q = to_enu_flu(q_nb);
                let sigma = covariance.map_or(Vector3::repeat(f64::NAN), |p| {
                    p.diagonal().map(|v| v.sqrt().to_degrees())
                });
                writeln!(
                    out,
                    "{:.9},{:.9},{:.9},{:.9},{:.9},{},{},{}",
                    time.since(t0),
                    q.w,
                    q.i,
                    q.j,
                    q.k,
                    Cell(sigma.x),
                    Cell(sigma.y),
                    Cell(sigma.z)
                )?;
            }
            Ok(())
        })
    }

    /// The instant from which `*_s` counts, as the metadata say.
    pub fn t0(&self) -> Option<Time> {
        self.metadata
            .get(METADATA_T0)
            .and_then(|t| t.parse().ok())
            .map(Time)
    }
}

fn topic(log: &Log) -> Option<usize> {
    log.topics()
        .iter()
        .position(|topic| topic.name == ORIENTATION_TOPIC && topic.encoding == "cdr")
}

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::attitude::Euler;

    #[test]
    fn a_table_is_read_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv.gz");
        let mut table = OrientationTable::default();
        for i in 0..3 {
            table.time.push(Time::from_seconds(100.0 + f64::from(i)));
            table.q_nb.push(
                Euler::from_degrees(10.0, -20.0, 170.0 + 10.0 * f64::from(i)).to_quaternion(),
            );
            let sigma = Vector3::new(0.01, 0.02, 0.05);
            table
                .covariance_n
                .push((i > 0).then(|| Matrix3::from_diagonal(&sigma.component_mul(&sigma))));
        }
        table
            .metadata
            .insert(METADATA_T0.into(), Time::from_seconds(90.0).0.to_string());
        table.write_csv(&path, false).unwrap();
        let text = Table::read(&path).unwrap();
        assert_eq!(text.column(&["t_s"]).unwrap()[0], 10.0);
        assert!(OrientationTable::is_csv(&text));
        let back = OrientationTable::from_csv(&text, Time::from_seconds(90.0)).unwrap();
        assert_eq!(back.time, table.time);
        for (a, b) in table.q_nb.iter().zip(&back.q_nb) {
            // Nine decimals of a quaternion.
            assert!(a.angle_to(b) < 1e-8);
        }
        assert_eq!(back.covariance_n[0], None);
        let off = back.covariance_n[1].unwrap() - table.covariance_n[1].unwrap();
        assert!(off.norm() < 1e-15, "{off}");
    }

    #[test]
    fn rows_without_a_rotation_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        std::fs::write(
            &path,
            "t_s,qw,qx,qy,qz\n1,nan,nan,nan,nan\n2,1,0,0,0\n3,0,0,0,0\n",
        )
        .unwrap();
        let table = OrientationTable::from_csv(&Table::read(&path).unwrap(), Time(0)).unwrap();
        assert_eq!(table.time, [Time::from_seconds(2.0)]);
        // Sensor axes east, north, up: forward looks east.
        let heading = Euler::from_quaternion(&table.q_nb[0]).heading_deg();
        assert!((heading - 90.0).abs() < 1e-9, "{heading}");
    }
}
