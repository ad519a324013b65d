//! A solution read back from its file, as columns.

use crate::content::Fix;
use crate::csv::{self, Table};
use crate::error::LogError;
use crate::frames::ENU_NED;
use crate::log::{Log, METADATA_NAME, METADATA_T0, ReadOptions};
use crate::ros2::{Decode, NavSatFix, State, UpdateMessage};
use crate::samples::gnss_position;
use crate::tum::Trajectory;
use insnav_core::attitude::Euler;
use insnav_core::earth::{Geodetic, LocalFrame};
use insnav_core::filter::{Update, Verdict};
use insnav_core::imu::STANDARD_GRAVITY;
use insnav_core::sample::GnssPosition;
use insnav_core::stationary::{Evidence, Witness};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// One measurement as the filter saw it, read back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UpdateRow {
    /// Instant.
    pub time: Time,
    /// Name of the measurement.
    pub measurement: String,
    /// Number of components.
    pub dof: usize,
    /// Measured minus predicted.
    pub residual: [f64; 3],
    /// Predicted standard deviation of the residual.
    pub sigma: [f64; 3],
    /// Normalised innovation squared.
    pub nis: f64,
    /// What became of it.
    pub verdict: Verdict,
}

impl From<&Update> for UpdateRow {
    fn from(update: &Update) -> Self {
        UpdateRow {
            time: update.time,
            measurement: update.measurement.to_owned(),
            dof: update.dof,
            residual: update.residual,
            sigma: update.sigma,
            nis: update.nis,
            verdict: update.verdict,
        }
    }
}

/// A solution: one entry per epoch in every column. NaN where the file does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SolutionTable {
    /// Stamps.
    pub time: Vec<Time>,
    /// Position.
    pub position: Vec<Geodetic>,
    /// Velocity NED, m/s.
    pub velocity_n: Vec<Vector3<f64>>,
    /// Rotation from body (forward-right-down) to NED; identity if `has_attitude` is false.
    pub q_nb: Vec<UnitQuaternion<f64>>,
    /// Turn rate, body, rad/s.
    pub rate_b: Vec<Vector3<f64>>,
    /// Gyro bias, body, rad/s.
    pub gyro_bias: Vec<Vector3<f64>>,
    /// Accelerometer bias, body, m/s².
    pub accel_bias: Vec<Vector3<f64>>,
    /// Standard deviation of the position NED, m.
    pub position_sigma_n: Vec<Vector3<f64>>,
    /// Standard deviation of the velocity NED, m/s.
    pub velocity_sigma_n: Vec<Vector3<f64>>,
    /// Standard deviation of the attitude as a small rotation about north, east, down, rad.
    pub attitude_sigma_n: Vec<Vector3<f64>>,
    /// Standard deviation of the gyro bias, rad/s.
    pub gyro_bias_sigma: Vec<Vector3<f64>>,
    /// Standard deviation of the accelerometer bias, m/s².
    pub accel_bias_sigma: Vec<Vector3<f64>>,
    /// Covariance of the position NED, m².
    pub position_covariance_n: Vec<Matrix3<f64>>,
    /// Covariance of the velocity NED, m²/s².
    pub velocity_covariance_n: Vec<Matrix3<f64>>,
    /// Covariance of the attitude as a small rotation in NED, rad².
    pub attitude_covariance_n: Vec<Matrix3<f64>>,
    /// Whether the body stands.
    pub stationary: Vec<bool>,
    /// For how long it has been standing, s; 0 when it moves.
    pub standing_s: Vec<f64>,
    /// What the detector of stops saw; NaN, and nobody, where the file does not say.
    pub stop_evidence: Vec<Evidence>,
    /// True if the file says whether the body stands.
    pub has_standing: bool,
    /// True if the file has velocities.
    pub has_velocity: bool,
    /// True if the file has an attitude.
    pub has_attitude: bool,
    /// Measurements as the filter saw them.
    pub updates: Vec<UpdateRow>,
    /// Fixes that the navigator did not get.
    pub withheld: Vec<GnssPosition>,
    /// Metadata of the run; empty for text files.
    pub metadata: BTreeMap<String, String>,
}

impl SolutionTable {
    /// Read a solution: an MCAP written by [`crate::McapSink`], or a CSV with `t_s` and positions (its times count from 0).
    pub fn read(path: &Path) -> Result<Self, LogError> {
        Self::read_counting_from(path, Time(0))
    }

    /// As [`SolutionTable::read`]; the times of a CSV count from `t0`.
    pub fn read_counting_from(path: &Path, t0: Time) -> Result<Self, LogError> {
        let mut start = [0; 8];
        let file = File::open(path).map_err(|e| LogError::opening(path, e))?;
        let mut length = 0;
        let mut head = file.take(8);
        while length < 8 {
            match head
                .read(&mut start[length..])
                .map_err(|e| LogError::opening(path, e))?
            {
                0 => break,
                n => length += n,
            }
        }
        // A text file begins with printable characters or is gzip; everything else is for the MCAP reader to name.
        let text = length > 0
            && start[..length]
                .iter()
                .all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace());
        if text || start.starts_with(&[0x1f, 0x8b]) {
            Self::from_csv(path, t0)
        } else {
            Self::from_mcap(&Log::open(path, ReadOptions::default())?)
        }
    }

    /// The epochs of a solution in an MCAP in blocks of some thousand, in order: for solutions longer than memory. Metadata
    /// are in every block, updates and withheld fixes in none.
    pub(crate) fn each_block(
        log: &Log,
        mut each: impl FnMut(&SolutionTable) -> Result<(), LogError>,
    ) -> Result<(), LogError> {
        const BLOCK: usize = 4096;
        let state = topic(log, "/insnav/state").ok_or_else(|| LogError::NotASolution {
            path: log.path().into(),
            reason: "no topic /insnav/state".into(),
        })?;
        let empty = || SolutionTable {
            has_velocity: true,
            has_attitude: true,
            has_standing: true,
            metadata: log.metadata(METADATA_NAME).cloned().unwrap_or_default(),
            ..SolutionTable::default()
        };
        let mut block = empty();
        let mut messages = log.messages(&[state]);
        while let Some(message) = messages.next() {
            let message = message?;
            let row =
                State::decode(message.data).map_err(|e| log.undecodable(state, &message, e))?;
            block.push(&row);
            if block.len() == BLOCK {
                each(&block)?;
                block = empty();
            }
        }
        if block.is_empty() {
            Ok(())
        } else {
            each(&block)
        }
    }

    fn from_mcap(log: &Log) -> Result<Self, LogError> {
        let mut table = SolutionTable {
            has_velocity: true,
            has_attitude: true,
            has_standing: true,
            ..SolutionTable::default()
        };
        read_solution_states(log, |row| table.push(row))?;
        table.updates = read_solution_updates(log)?;
        table.withheld = read_solution_withheld(log)?;
        table.metadata = log.metadata(METADATA_NAME).cloned().unwrap_or_default();
        Ok(table)
    }

    fn push(&mut self, row: &State<'_>) {
        const RAD_PER_S: f64 = std::f64::consts::PI / 180.0 / 3600.0;
        const M_PER_S2: f64 = STANDARD_GRAVITY * 1e-3;
        let v = Vector3::new;
        self.time.push(row.header.stamp);
        self.position.push(Geodetic::from_degrees(
            row.latitude_deg,
            row.longitude_deg,
            row.height_m,
        ));
        self.velocity_n.push(v(
            row.velocity_north_m_per_s,
            row.velocity_east_m_per_s,
            row.velocity_down_m_per_s,
        ));
        let q = Quaternion::new(row.q_nb_w, row.q_nb_x, row.q_nb_y, row.q_nb_z);
        self.q_nb.push(UnitQuaternion::new_normalize(q));
        self.rate_b.push(
            v(
                row.rate_x_deg_per_s,
                row.rate_y_deg_per_s,
                row.rate_z_deg_per_s,
            )
            .map(f64::to_radians),
        );
        self.gyro_bias.push(
            v(
                row.gyro_bias_x_deg_per_hour,
                row.gyro_bias_y_deg_per_hour,
                row.gyro_bias_z_deg_per_hour,
            ) * RAD_PER_S,
        );
        self.accel_bias.push(
            v(
                row.accel_bias_x_mg,
                row.accel_bias_y_mg,
                row.accel_bias_z_mg,
            ) * M_PER_S2,
        );
        self.gyro_bias_sigma.push(
            v(
                row.sigma_gyro_bias_x_deg_per_hour,
                row.sigma_gyro_bias_y_deg_per_hour,
                row.sigma_gyro_bias_z_deg_per_hour,
            ) * RAD_PER_S,
        );
        self.accel_bias_sigma.push(
            v(
                row.sigma_accel_bias_x_mg,
                row.sigma_accel_bias_y_mg,
                row.sigma_accel_bias_z_mg,
            ) * M_PER_S2,
        );
        self.push_covariances(
            symmetric([
                row.position_covariance_nn_m2,
                row.position_covariance_ne_m2,
                row.position_covariance_nd_m2,
                row.position_covariance_ee_m2,
                row.position_covariance_ed_m2,
                row.position_covariance_dd_m2,
            ]),
            symmetric([
                row.velocity_covariance_nn_m2_per_s2,
                row.velocity_covariance_ne_m2_per_s2,
                row.velocity_covariance_nd_m2_per_s2,
                row.velocity_covariance_ee_m2_per_s2,
                row.velocity_covariance_ed_m2_per_s2,
                row.velocity_covariance_dd_m2_per_s2,
            ]),
            symmetric([
                row.attitude_covariance_nn_rad2,
                row.attitude_covariance_ne_rad2,
                row.attitude_covariance_nd_rad2,
                row.attitude_covariance_ee_rad2,
                row.attitude_covariance_ed_rad2,
                row.attitude_covariance_dd_rad2,
            ]),
        );
        self.stationary.push(row.motion != 0);
        self.standing_s.push(row.standing_s);
        self.stop_evidence.push(Evidence {
            witness: match row.stop_witness {
                1 => Witness::Detector,
                2 => Witness::Declared,
                3 => Witness::Interval,
                _ => Witness::Nobody,
            },
            specific_force: row.stop_specific_force_ratio,
            angular_rate: row.stop_angular_rate_ratio,
            mean_rate: row.stop_mean_rate_ratio,
            speed: row.stop_speed_ratio,
        });
    }

    fn push_covariances(
        &mut self,
        position: Matrix3<f64>,
        velocity: Matrix3<f64>,
        attitude: Matrix3<f64>,
    ) {
        let sigma = |p: &Matrix3<f64>| p.diagonal().map(|v| if v < 0.0 { 0.0 } else { v.sqrt() });
        self.position_sigma_n.push(sigma(&position));
        self.velocity_sigma_n.push(sigma(&velocity));
        self.attitude_sigma_n.push(sigma(&attitude));
        self.position_covariance_n.push(position);
        self.velocity_covariance_n.push(velocity);
        self.attitude_covariance_n.push(attitude);
    }

    fn from_csv(path: &Path, t0: Time) -> Result<Self, LogError> {
        let truth = csv::read_truth(path)?;
        let table = Table::read(path)?;
        let sigmas = |names: [&str; 3]| -> Vec<Vector3<f64>> {
            let columns = names.map(|name| table.column(&[name]));
            let cell = |c: usize, i: usize| columns[c].map_or(f64::NAN, |column| column[i]);
            (0..table.rows())
                .map(|i| Vector3::new(cell(0, i), cell(1, i), cell(2, i)))
                .collect()
        };
        let velocity_sigma = sigmas(["svn", "sve", "svd"]);
        let attitude_sigma = sigmas([
            "sigma_rotation_north_deg",
            "sigma_rotation_east_deg",
            "sigma_heading_deg",
        ]);
        let standing = table.column(&["standing_s"]);
        let mut solution = SolutionTable {
            has_velocity: truth.has_velocity,
            has_attitude: truth.has_attitude,
            has_standing: standing.is_some(),
            ..SolutionTable::default()
        };
        for i in 0..truth.t_s.len() {
            // A receiver's gaps are rows of NaN.
            if !truth.position[i].is_valid() {
                continue;
            }
            let euler = truth.euler_deg[i];
            let attitude = Euler::from_degrees(euler.x, euler.y, euler.z).to_quaternion();
            let known = euler.iter().all(|angle| angle.is_finite());
            solution.push_bare(
                t0.plus(truth.t_s[i]),
                truth.position[i],
                truth.velocity_n[i],
                if known {
                    attitude
                } else {
                    UnitQuaternion::identity()
                },
            );
            if let (Some(standing), Some(for_s), Some(stands)) = (
                standing,
                solution.standing_s.last_mut(),
                solution.stationary.last_mut(),
            ) {
                *for_s = standing[i];
                *stands = standing[i] > 0.0;
            }
            let squared = |s: &Vector3<f64>| Matrix3::from_diagonal(&s.component_mul(s));
            solution.push_covariances(
                squared(&truth.position_sigma_n[i]),
                squared(&velocity_sigma[i]),
                squared(&attitude_sigma[i].map(f64::to_radians)),
            );
        }
        Ok(solution)
    }

    /// A trajectory in the map around `origin`: positions and attitudes, nothing else known.
    pub fn from_trajectory(trajectory: &Trajectory, origin: Geodetic) -> Self {
        let map = LocalFrame::new(origin);
        let mut solution = SolutionTable {
            has_attitude: true,
            ..SolutionTable::default()
        };
        let unknown = Matrix3::from_element(f64::NAN);
        for i in 0..trajectory.time.len() {
            let at = map.to_geodetic(&(ENU_NED * trajectory.position[i]));
            let c_map = trajectory.orientation[i].to_rotation_matrix().into_inner();
            let c_nb =
                map.rotation_from(&at).transpose() * ENU_NED * c_map * crate::frames::FLU_FRD;
            let q_nb =
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(c_nb));
            solution.push_bare(trajectory.time[i], at, Vector3::repeat(f64::NAN), q_nb);
            solution.push_covariances(unknown, unknown, unknown);
        }
        solution
    }

    fn push_bare(
        &mut self,
        time: Time,
        at: Geodetic,
        velocity_n: Vector3<f64>,
        q_nb: UnitQuaternion<f64>,
    ) {
        let unknown = Vector3::repeat(f64::NAN);
        self.time.push(time);
        self.position.push(at);
        self.velocity_n.push(velocity_n);
        self.q_nb.push(q_nb);
        self.rate_b.push(unknown);
        self.gyro_bias.push(unknown);
        self.accel_bias.push(unknown);
        self.gyro_bias_sigma.push(unknown);
        self.accel_bias_sigma.push(unknown);
        self.stationary.push(false);
        self.standing_s.push(0.0);
        self.stop_evidence.push(Evidence::default());
    }

    /// Number of epochs.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// True if there is no epoch.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// The instant from which `*_s` counts, as the metadata say, else the first epoch.
    pub fn t0(&self) -> Option<Time> {
        let stated = self
            .metadata
            .get(METADATA_T0)
            .and_then(|t| t.parse().ok())
            .map(Time);
        stated.or_else(|| self.time.first().copied())
    }

    /// Origin of the map, as the metadata say, else the first epoch.
    pub fn origin(&self) -> Option<Geodetic> {
        let stated = self
            .metadata
            .get("origin_lat_lon_deg_h_m")
            .and_then(|text| parse_triple(text));
        stated
            .map(|[lat, lon, h]| Geodetic::from_degrees(lat, lon, h))
            .or_else(|| self.position.first().copied())
    }

    /// The antenna from the point of the solution, forward-right-down, m, as the metadata `lever_arm_b_m` say.
    pub fn lever_arm_b(&self) -> Option<Vector3<f64>> {
        self.metadata
            .get("lever_arm_b_m")
            .and_then(|text| parse_triple(text))
            .map(Vector3::from)
    }
}

/// The epochs of a solution in an MCAP as they were written, in order.
pub fn read_solution_states(log: &Log, mut each: impl FnMut(&State<'_>)) -> Result<(), LogError> {
    let state = topic(log, "/insnav/state").ok_or_else(|| LogError::NotASolution {
        path: log.path().into(),
        reason: "no topic /insnav/state".into(),
    })?;
    let mut messages = log.messages(&[state]);
    while let Some(message) = messages.next() {
        let message = message?;
        let row = State::decode(message.data).map_err(|e| log.undecodable(state, &message, e))?;
        each(&row);
    }
    Ok(())
}

/// Its measurements as the filter saw them; none where the file has none.
pub fn read_solution_updates(log: &Log) -> Result<Vec<UpdateRow>, LogError> {
    let mut rows = Vec::new();
    let Some(updates) = topic(log, "/insnav/updates") else {
        return Ok(rows);
    };
    let mut messages = log.messages(&[updates]);
    while let Some(message) = messages.next() {
        let message = message?;
        let update = UpdateMessage::decode(message.data)
            .map_err(|e| log.undecodable(updates, &message, e))?;
        rows.push(UpdateRow::new(&update));
    }
    Ok(rows)
}

/// Fixes that were withheld from the run that wrote a log; none if it has no such topic.
pub fn read_solution_withheld(log: &Log) -> Result<Vec<GnssPosition>, LogError> {
    let mut fixes = Vec::new();
    let Some(withheld) = topic(log, "/insnav/withheld") else {
        return Ok(fixes);
    };
    let mut messages = log.messages(&[withheld]);
    while let Some(message) = messages.next() {
        let message = message?;
        let fix =
            NavSatFix::decode(message.data).map_err(|e| log.undecodable(withheld, &message, e))?;
        fixes.extend(gnss_position(&Fix::from(&fix), fix.header.stamp, 0.0));
    }
    Ok(fixes)
}

/// The first topic of this name that can be read.
fn topic(log: &Log, name: &str) -> Option<usize> {
    log.topics()
        .iter()
        .position(|topic| topic.name == name && topic.encoding == "cdr")
}

impl UpdateRow {
    fn new(update: &UpdateMessage<'_>) -> Self {
        UpdateRow {
            time: update.header.stamp,
            measurement: update.measurement.to_owned(),
            dof: usize::from(update.dof),
            residual: update.residual,
            sigma: update.sigma,
            nis: update.nis,
            verdict: match update.verdict {
                0 => Verdict::Accepted,
                1 => Verdict::Inflated,
                3 => Verdict::Reset,
                4 => Verdict::Frozen,
                _ => Verdict::Rejected,
            },
        }
    }
}

fn symmetric([a, b, c, d, e, f]: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(a, b, c, b, d, e, c, e, f)
}

/// Three numbers in brackets.
fn parse_triple(text: &str) -> Option<[f64; 3]> {
    let mut numbers = text
        .trim()
        .strip_prefix('[')?
        .strip_suffix(']')?
        .split(',')
        .map(|n| n.trim().parse().ok());
    let triple = [numbers.next()??, numbers.next()??, numbers.next()??];
    numbers.next().is_none().then_some(triple)
}
