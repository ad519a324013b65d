//! The solution as an MCAP file that the common viewers open with no further work.

use crate::error::LogError;
use crate::frames::{ENU_NED, MapState, moved_to};
use crate::log::METADATA_NAME;
use crate::mcap_writer::{ChannelHandle, Compression, McapWriter};
use crate::ros2::{
    CovarianceType, DiagnosticArray, DiagnosticStatus, Header, NavSatFix, Odometry, Pose,
    PoseStamped, State, TfMessage, TransformStamped, Twist, UpdateMessage,
};
use insnav_core::earth::{Geodetic, LocalFrame};
use insnav_core::filter::{Update, Verdict};
use insnav_core::imu::STANDARD_GRAVITY;
use insnav_core::sample::GnssPosition;
use insnav_core::solution::{Epoch, Motion, Sink};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// How to write a solution.
#[derive(Clone, Debug, PartialEq)]
pub struct SinkOptions {
    /// Replace a file that is already there.
    pub force: bool,
    /// Epochs per second; 0: one at every inertial sample.
    pub rate_hz: f64,
    /// Origin of the map; absent: the first epoch. Give the first fix to have the map where ROS users expect it.
    pub origin: Option<Geodetic>,
    /// The point that is written, from the IMU, forward-right-down, m.
    pub lever_arm_b_m: [f64; 3],
    /// How chunks are compressed.
    pub compression: Compression,
    /// Name of the map frame.
    pub map_frame: String,
    /// Name of the body frame.
    pub base_frame: String,
    /// What goes into the metadata record `insnav` besides version, origin and rate: configuration, hash of the input, ….
    pub metadata: BTreeMap<String, String>,
}

impl Default for SinkOptions {
    fn default() -> Self {
        SinkOptions {
            force: false,
            rate_hz: 50.0,
            origin: None,
            lever_arm_b_m: [0.0; 3],
            compression: Compression::Zstd,
            map_frame: "map".into(),
            base_frame: "base_link".into(),
            metadata: BTreeMap::new(),
        }
    }
}

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct SinkSummary {
    /// The file.
    pub path: PathBuf,
    /// Its length, bytes.
    pub bytes: u64,
    /// Epochs in it.
    pub epochs: u64,
    /// Updates in it.
    pub updates: u64,
    /// Withheld fixes in it.
    pub withheld: u64,
    /// Origin of the map; `None` if there was no epoch.
    pub origin: Option<Geodetic>,
}

/// Writes what a navigator produces into an MCAP file: `/insnav/odometry`, `/tf`, `/insnav/pose`, `/insnav/fix`,
/// `/insnav/state`, `/insnav/updates`, `/insnav/withheld`, `/diagnostics`, and the metadata record `insnav`.
///
/// The file appears under its name when [`McapSink::finish`] succeeds; dropped before, it leaves nothing. An error met while
/// the navigator runs is kept and returned by `finish`, since the methods of [`Sink`] return nothing.
pub struct McapSink {
    writer: McapWriter,
    channels: Channels,
    options: SinkOptions,
    map: Option<LocalFrame>,
    decimation: Decimation,
    diagnostics: Diagnostics,
    failure: Option<LogError>,
    epochs: u64,
    updates: u64,
    withheld: u64,
    path: PathBuf,
}

struct Channels {
    odometry: ChannelHandle,
    tf: ChannelHandle,
    pose: ChannelHandle,
    fix: ChannelHandle,
    state: ChannelHandle,
    updates: ChannelHandle,
    withheld: ChannelHandle,
    diagnostics: ChannelHandle,
}

impl McapSink {
    /// Begin a file. Fails at once when it exists (without `force`) or cannot be written.
    pub fn create(path: &Path, options: SinkOptions) -> Result<Self, LogError> {
        let mut writer = McapWriter::create(path, options.force, options.compression)?;
        let channels = Channels {
            odometry: writer.channel::<Odometry<'_>>("/insnav/odometry")?,
            tf: writer.channel::<TfMessage<'_>>("/tf")?,
            pose: writer.channel::<PoseStamped<'_>>("/insnav/pose")?,
            fix: writer.channel::<NavSatFix<'_>>("/insnav/fix")?,
            state: writer.channel::<State<'_>>("/insnav/state")?,
            updates: writer.channel::<UpdateMessage<'_>>("/insnav/updates")?,
            withheld: writer.channel::<NavSatFix<'_>>("/insnav/withheld")?,
            diagnostics: writer.channel::<DiagnosticArray<'_>>("/diagnostics")?,
        };
        Ok(McapSink {
            writer,
            channels,
            map: options.origin.map(LocalFrame::new),
            decimation: Decimation::new(options.rate_hz),
            options,
            diagnostics: Diagnostics::default(),
            failure: None,
            epochs: 0,
            updates: 0,
            withheld: 0,
            path: path.into(),
        })
    }

    /// Metadata to be written at the end: for what is known only after the run.
    pub fn metadata_mut(&mut self) -> &mut BTreeMap<String, String> {
        &mut self.options.metadata
    }

    /// Keep a fix that the navigator did not get, so that the solution can be compared with it.
    pub fn withheld(&mut self, fix: &GnssPosition) {
        let message = NavSatFix {
            header: Header {
                stamp: fix.time,
                frame_id: "gnss",
            },
            ..fix_message(&fix.position, fix.covariance_n.as_ref())
        };
        let written = self
            .writer
            .write(self.channels.withheld, fix.time, &message);
        self.withheld += 1;
        self.keep(written);
    }

    /// Complete the file, or return the first error of the run.
    pub fn finish(mut self) -> Result<SinkSummary, LogError> {
        if let Some(error) = self.failure.take() {
            return Err(error);
        }
        let origin = self.map.as_ref().map(|map| *map.origin());
        let mut metadata = std::mem::take(&mut self.options.metadata);
        metadata.insert("version".into(), env!("CARGO_PKG_VERSION").into());
        metadata.insert("rate_hz".into(), self.options.rate_hz.to_string());
        metadata.insert(
            "output_lever_arm_b_m".into(),
            format!("{:?}", self.options.lever_arm_b_m),
        );
        if let Some(at) = origin {
            let origin = [at.latitude_deg(), at.longitude_deg(), at.height];
            metadata.insert("origin_lat_lon_deg_h_m".into(), format!("{origin:?}"));
        }
        self.writer.write_metadata(METADATA_NAME, metadata)?;
        let bytes = self.writer.finish()?;
        Ok(SinkSummary {
            path: self.path,
            bytes,
            epochs: self.epochs,
            updates: self.updates,
            withheld: self.withheld,
            origin,
        })
    }

    fn keep(&mut self, result: Result<(), LogError>) {
        if let Err(error) = result {
            self.failure.get_or_insert(error);
        }
    }

    fn write_epoch(&mut self, epoch: &Epoch) -> Result<(), LogError> {
        let moved;
        let epoch = if self.options.lever_arm_b_m == [0.0; 3] {
            epoch
        } else {
            moved = moved_to(epoch, &self.options.lever_arm_b_m.into());
            &moved
        };
        let map = self
            .map
            .get_or_insert_with(|| LocalFrame::new(epoch.nav.position));
        let time = epoch.nav.time;
        let state = MapState::new(epoch, map);
        let pose = Pose {
            position: state.position,
            orientation: xyzw(&state.orientation),
        };
        let (map_frame, base_frame) = (
            self.options.map_frame.as_str(),
            self.options.base_frame.as_str(),
        );
        let header = Header {
            stamp: time,
            frame_id: map_frame,
        };
        let odometry = Odometry {
            header,
            child_frame_id: base_frame,
            pose,
            pose_covariance: row_by_row(&state.pose_covariance),
            twist: Twist {
                linear: state.linear,
                angular: state.angular,
            },
            twist_covariance: row_by_row(&state.twist_covariance),
        };
        self.writer.write(self.channels.odometry, time, &odometry)?;
        let transform = TransformStamped {
            header,
            child_frame_id: base_frame,
            translation: pose.position,
            rotation: pose.orientation,
        };
        self.writer.write(
            self.channels.tf,
            time,
            &TfMessage {
                transforms: &[transform],
            },
        )?;
        self.writer
            .write(self.channels.pose, time, &PoseStamped { header, pose })?;
        let fix = NavSatFix {
            header: Header {
                stamp: time,
                frame_id: base_frame,
            },
            ..fix_message(&epoch.nav.position, Some(&epoch.position_covariance_n()))
        };
        self.writer.write(self.channels.fix, time, &fix)?;
        self.writer
            .write(self.channels.state, time, &state_message(epoch, header))?;
        if let Some(values) = self.diagnostics.due(epoch) {
            let status = DiagnosticStatus {
                level: values.level,
                name: "insnav: navigation",
                message: &values.message,
                hardware_id: "insnav",
                values: &values.values,
            };
            let array = DiagnosticArray {
                header: Header {
                    stamp: time,
                    frame_id: "",
                },
                status: &[status],
            };
            self.writer.write(self.channels.diagnostics, time, &array)?;
        }
        self.epochs += 1;
        Ok(())
    }

    fn write_update(&mut self, update: &Update) -> Result<(), LogError> {
        let message = UpdateMessage {
            header: Header {
                stamp: update.time,
                frame_id: &self.options.map_frame,
            },
            measurement: update.measurement,
            dof: update.dof as u8,
            residual: update.residual,
            sigma: update.sigma,
            nis: update.nis,
            verdict: match update.verdict {
                Verdict::Accepted => 0,
                Verdict::Inflated => 1,
                Verdict::Rejected => 2,
            },
        };
        self.updates += 1;
        self.writer
            .write(self.channels.updates, update.time, &message)
    }
}

impl Sink for McapSink {
    fn wants_epoch(&mut self, time: Time) -> bool {
        self.failure.is_none() && self.decimation.wants(time)
    }

    fn epoch(&mut self, epoch: &Epoch) {
        let written = self.write_epoch(epoch);
        self.keep(written);
    }

    fn update(&mut self, update: &Update) {
        if self.failure.is_none() {
            self.diagnostics.count(update);
            let written = self.write_update(update);
            self.keep(written);
        }
    }
}

/// Picks, at a rate, the samples nearest to an even grid.
#[derive(Clone, Debug)]
struct Decimation {
    period_ns: i64,
    due: Option<Time>,
    last: Option<Time>,
}

impl Decimation {
    fn new(rate_hz: f64) -> Self {
        let period_ns = if rate_hz > 0.0 {
            (1e9 / rate_hz) as i64
        } else {
            0
        };
        Decimation {
            period_ns,
            due: None,
            last: None,
        }
    }

    fn wants(&mut self, time: Time) -> bool {
        if self.period_ns == 0 {
            return true;
        }
        let Some(due) = self.due else {
            self.due = Some(Time(time.0.saturating_add(self.period_ns)));
            self.last = Some(time);
            return true;
        };
        // A sample just short of its place counts: the next one would be further off.
        let step = self.last.map_or(0, |last| time.0 - last.0);
        self.last = Some(time);
        if time.0.saturating_add(step / 2) < due.0 {
            return false;
        }
        let late = (time.0 - due.0).max(0) / self.period_ns;
        self.due = Some(Time(
            due.0
                .saturating_add(self.period_ns.saturating_mul(1 + late)),
        ));
        true
    }
}

/// Counts what happened since the last report, and makes one every second.
#[derive(Clone, Debug, Default)]
struct Diagnostics {
    next: Option<Time>,
    accepted: u32,
    inflated: u32,
    rejected: u32,
    last_aided: Option<Time>,
}

struct Report {
    level: u8,
    message: String,
    values: Vec<(&'static str, String)>,
}

impl Diagnostics {
    fn count(&mut self, update: &Update) {
        match update.verdict {
            Verdict::Accepted => self.accepted += 1,
            Verdict::Inflated => self.inflated += 1,
            Verdict::Rejected => self.rejected += 1,
        }
        if update.verdict != Verdict::Rejected && update.measurement.starts_with("gnss") {
            self.last_aided = Some(update.time);
        }
    }

    fn due(&mut self, epoch: &Epoch) -> Option<Report> {
        let time = epoch.nav.time;
        if self.next.is_some_and(|next| time < next) {
            return None;
        }
        self.next = Some(Time((time.0.div_euclid(1_000_000_000) + 1) * 1_000_000_000));
        let p = epoch.covariance.diagonal();
        let horizontal = (p[0] + p[1]).max(0.0).sqrt();
        let unaided = self.last_aided.map(|last| time.since(last));
        // Receivers report at 1 Hz or faster: three seconds without one is an outage, not a slow receiver.
        let (level, message) = match unaided {
            Some(gap) if gap < 3.0 => (0, "aided by GNSS".to_owned()),
            Some(gap) => (1, format!("no GNSS for {gap:.0} s, dead reckoning")),
            None => (1, "no GNSS yet".to_owned()),
        };
        let values = vec![
            ("sigma_horizontal_m", format!("{horizontal:.3}")),
            ("sigma_height_m", format!("{:.3}", p[2].max(0.0).sqrt())),
            (
                "sigma_heading_deg",
                format!("{:.3}", epoch.heading_sigma().to_degrees()),
            ),
            (
                "motion",
                if epoch.motion == Motion::Moving {
                    "moving"
                } else {
                    "stationary"
                }
                .to_owned(),
            ),
            ("updates_accepted", self.accepted.to_string()),
            ("updates_inflated", self.inflated.to_string()),
            ("updates_rejected", self.rejected.to_string()),
        ];
        (self.accepted, self.inflated, self.rejected) = (0, 0, 0);
        Some(Report {
            level,
            message,
            values,
        })
    }
}

fn xyzw(q: &UnitQuaternion<f64>) -> [f64; 4] {
    [q.i, q.j, q.k, q.w]
}

fn row_by_row(matrix: &Matrix6<f64>) -> [f64; 36] {
    std::array::from_fn(|k| matrix[(k / 6, k % 6)])
}

/// A position and its NED covariance as a message.
pub(crate) fn fix_message<'a>(at: &Geodetic, covariance_n: Option<&Matrix3<f64>>) -> NavSatFix<'a> {
    let enu = covariance_n.map(|p| ENU_NED * p * ENU_NED);
    NavSatFix {
        header: Header::default(),
        status: 0,
        service: 0,
        latitude_deg: at.latitude_deg(),
        longitude_deg: at.longitude_deg(),
        altitude_m: at.height,
        position_covariance: enu.map_or([0.0; 9], |p| std::array::from_fn(|k| p[(k / 3, k % 3)])),
        position_covariance_type: if enu.is_some() {
            CovarianceType::Known
        } else {
            CovarianceType::Unknown
        },
    }
}

fn state_message<'a>(epoch: &Epoch, header: Header<'a>) -> State<'a> {
    const DEG_PER_HOUR: f64 = 180.0 / std::f64::consts::PI * 3600.0;
    const MG: f64 = 1e3 / STANDARD_GRAVITY;
    let nav = &epoch.nav;
    let euler = epoch.euler();
    let p = &epoch.covariance;
    let sigma = |i: usize| p[(i, i)].max(0.0).sqrt();
    let rate: Vector3<f64> = epoch.rate_b.map(f64::to_degrees);
    let gyro = epoch.imu_errors.gyro_bias * DEG_PER_HOUR;
    let accel = epoch.imu_errors.accel_bias * MG;
    State {
        header,
        latitude_deg: nav.position.latitude_deg(),
        longitude_deg: nav.position.longitude_deg(),
        height_m: nav.position.height,
        velocity_north_m_per_s: nav.velocity_n.x,
        velocity_east_m_per_s: nav.velocity_n.y,
        velocity_down_m_per_s: nav.velocity_n.z,
        q_nb_w: nav.q_nb.w,
        q_nb_x: nav.q_nb.i,
        q_nb_y: nav.q_nb.j,
        q_nb_z: nav.q_nb.k,
        roll_deg: euler.roll.to_degrees(),
        pitch_deg: euler.pitch.to_degrees(),
        heading_deg: euler.heading_deg(),
        rate_x_deg_per_s: rate.x,
        rate_y_deg_per_s: rate.y,
        rate_z_deg_per_s: rate.z,
        gyro_bias_x_deg_per_hour: gyro.x,
        gyro_bias_y_deg_per_hour: gyro.y,
        gyro_bias_z_deg_per_hour: gyro.z,
        accel_bias_x_mg: accel.x,
        accel_bias_y_mg: accel.y,
        accel_bias_z_mg: accel.z,
        sigma_north_m: sigma(0),
        sigma_east_m: sigma(1),
        sigma_down_m: sigma(2),
        sigma_velocity_north_m_per_s: sigma(3),
        sigma_velocity_east_m_per_s: sigma(4),
        sigma_velocity_down_m_per_s: sigma(5),
        sigma_rotation_north_deg: sigma(6).to_degrees(),
        sigma_rotation_east_deg: sigma(7).to_degrees(),
        sigma_heading_deg: sigma(8).to_degrees(),
        sigma_gyro_bias_x_deg_per_hour: sigma(9) * DEG_PER_HOUR,
        sigma_gyro_bias_y_deg_per_hour: sigma(10) * DEG_PER_HOUR,
        sigma_gyro_bias_z_deg_per_hour: sigma(11) * DEG_PER_HOUR,
        sigma_accel_bias_x_mg: sigma(12) * MG,
        sigma_accel_bias_y_mg: sigma(13) * MG,
        sigma_accel_bias_z_mg: sigma(14) * MG,
        position_covariance_nn_m2: p[(0, 0)],
        position_covariance_ne_m2: p[(0, 1)],
        position_covariance_nd_m2: p[(0, 2)],
        position_covariance_ee_m2: p[(1, 1)],
        position_covariance_ed_m2: p[(1, 2)],
        position_covariance_dd_m2: p[(2, 2)],
        velocity_covariance_nn_m2_per_s2: p[(3, 3)],
        velocity_covariance_ne_m2_per_s2: p[(3, 4)],
        velocity_covariance_nd_m2_per_s2: p[(3, 5)],
        velocity_covariance_ee_m2_per_s2: p[(4, 4)],
        velocity_covariance_ed_m2_per_s2: p[(4, 5)],
        velocity_covariance_dd_m2_per_s2: p[(5, 5)],
        attitude_covariance_nn_rad2: p[(6, 6)],
        attitude_covariance_ne_rad2: p[(6, 7)],
        attitude_covariance_nd_rad2: p[(6, 8)],
        attitude_covariance_ee_rad2: p[(7, 7)],
        attitude_covariance_ed_rad2: p[(7, 8)],
        attitude_covariance_dd_rad2: p[(8, 8)],
        standing_s: match epoch.motion {
            Motion::Moving => 0.0,
            Motion::Stationary { since } => nav.time.since(since),
        },
        motion: u8::from(epoch.motion != Motion::Moving),
    }
}
