//! Samples as a ROS 2 log: what `convert` and `demo` write, and tests read.

use crate::error::LogError;
use crate::frames::{ENU_NED, FLU_FRD};
use crate::log::{METADATA_NAME, METADATA_T0};
use crate::mcap_writer::{ChannelHandle, Compression, McapWriter};
use crate::ros2::{
    Bool, Float64, Header, Imu, MagneticField, NavSatFix, TfMessage, TransformStamped, Twist,
    TwistWithCovarianceStamped,
};
use crate::sink::fix_message;
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// How to write a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LogWriterOptions {
    /// Replace a file that is already there.
    pub force: bool,
    /// How chunks are compressed.
    pub compression: Compression,
    /// Topic of the IMU.
    pub imu_topic: String,
    /// Topic of GNSS positions.
    pub fix_topic: String,
    /// Topic of GNSS velocities.
    pub velocity_topic: String,
    /// Topic of declarations of standing.
    pub standing_topic: String,
    /// Topic of the speed of wheels.
    pub speed_topic: String,
    /// Topic of magnetic fields.
    pub magnetic_topic: String,
    /// The instant from which `*_s` counts, stored as metadata.
    pub t0: Option<Time>,
    /// Antenna from the IMU, forward-right-down, m, written as a static transform.
    pub lever_arm_b: Option<Vector3<f64>>,
    /// More metadata.
    pub metadata: BTreeMap<String, String>,
}

impl Default for LogWriterOptions {
    fn default() -> Self {
        LogWriterOptions {
            force: false,
            compression: Compression::Zstd,
            imu_topic: "/imu/data".into(),
            fix_topic: "/gps/fix".into(),
            velocity_topic: "/gps/vel".into(),
            standing_topic: "/vehicle/standing".into(),
            speed_topic: "/vehicle/speed".into(),
            magnetic_topic: "/imu/mag".into(),
            t0: None,
            lever_arm_b: None,
            metadata: BTreeMap::new(),
        }
    }
}

const IMU_FRAME: &str = "imu_link";
const GNSS_FRAME: &str = "gps";

/// Writes samples as `Imu`, `NavSatFix` and `TwistWithCovarianceStamped` in the axes that ROS prescribes, standstills as `Bool`
/// and speeds of wheels as `Float64`: the stamps of these two are the log times.
///
/// Topics appear with their first sample. Dropped without [`LogWriter::finish`], it leaves no file.
pub struct LogWriter {
    path: PathBuf,
    writer: McapWriter,
    options: LogWriterOptions,
    imu: Option<ChannelHandle>,
    fix: Option<ChannelHandle>,
    velocity: Option<ChannelHandle>,
    standing: Option<ChannelHandle>,
    speed: Option<ChannelHandle>,
    magnetic: Option<ChannelHandle>,
    first: Option<Time>,
}

impl LogWriter {
    /// Begin a log.
    pub fn create(path: &Path, options: LogWriterOptions) -> Result<Self, LogError> {
        let writer = McapWriter::create(path, options.force, options.compression)?;
        Ok(LogWriter {
            path: path.into(),
            writer,
            options,
            imu: None,
            fix: None,
            velocity: None,
            standing: None,
            speed: None,
            magnetic: None,
            first: None,
        })
    }

    /// Write one sample, recorded at its stamp. Increments and headings have no ROS message of their own and are refused.
    pub fn write(&mut self, sample: &Sample) -> Result<(), LogError> {
        self.write_recorded(sample, sample.time())
    }

    /// As [`LogWriter::write`], recorded at another instant than its stamp: when it arrived.
    pub fn write_recorded(&mut self, sample: &Sample, log_time: Time) -> Result<(), LogError> {
        let time = sample.time();
        if self.first.is_none() {
            self.first = Some(time);
            self.write_lever_arm(log_time)?;
        }
        match sample {
            Sample::Imu(sample) => {
                let channel = match self.imu {
                    Some(channel) => channel,
                    None => *self
                        .imu
                        .insert(self.writer.channel::<Imu<'_>>(&self.options.imu_topic)?),
                };
                let message = Imu {
                    header: Header {
                        stamp: time,
                        frame_id: IMU_FRAME,
                    },
                    orientation: [0.0, 0.0, 0.0, 1.0],
                    // −1: there is no orientation.
                    orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                    angular_velocity: FLU_FRD * sample.angular_rate_b,
                    linear_acceleration: FLU_FRD * sample.specific_force_b,
                    ..Imu::default()
                };
                self.writer.write(channel, log_time, &message)
            }
            Sample::GnssPosition(sample) => {
                let channel = match self.fix {
                    Some(channel) => channel,
                    None => *self.fix.insert(
                        self.writer
                            .channel::<NavSatFix<'_>>(&self.options.fix_topic)?,
                    ),
                };
                let message = NavSatFix {
                    header: Header {
                        stamp: time,
                        frame_id: GNSS_FRAME,
                    },
                    service: 1,
                    ..fix_message(&sample.position, sample.covariance_n.as_ref())
                };
                self.writer.write(channel, log_time, &message)
            }
            Sample::GnssVelocity(sample) => {
                let channel = match self.velocity {
                    Some(channel) => channel,
                    None => {
                        let topic = &self.options.velocity_topic;
                        *self.velocity.insert(
                            self.writer
                                .channel::<TwistWithCovarianceStamped<'_>>(topic)?,
                        )
                    }
                };
                let mut covariance = [0.0; 36];
                if let Some(p) = sample.covariance_n {
                    let enu = ENU_NED * p * ENU_NED;
                    for i in 0..3 {
                        for j in 0..3 {
                            covariance[6 * i + j] = enu[(i, j)];
                        }
                    }
                }
                let message = TwistWithCovarianceStamped {
                    header: Header {
                        stamp: time,
                        frame_id: GNSS_FRAME,
                    },
                    // Component by component: a product would spread a NaN of the vertical over all three.
                    twist: Twist {
                        linear: Vector3::new(
                            sample.velocity_n.y,
                            sample.velocity_n.x,
                            -sample.velocity_n.z,
                        ),
                        angular: Vector3::zeros(),
                    },
                    covariance,
                };
                self.writer.write(channel, log_time, &message)
            }
            Sample::ImuIncrement(_) => Err(LogError::Unwritable {
                path: self.path.clone(),
                what: "an inertial increment",
                reason: "sensor_msgs/msg/Imu holds rates at an instant",
            }),
            Sample::Heading(_) => Err(LogError::Unwritable {
                path: self.path.clone(),
                what: "a heading",
                reason: "there is no standard message for it",
            }),
            Sample::Standstill(sample) => {
                let channel = match self.standing {
                    Some(channel) => channel,
                    None => *self
                        .standing
                        .insert(self.writer.channel::<Bool>(&self.options.standing_topic)?),
                };
                self.writer.write(channel, log_time, &Bool(sample.standing))
            }
            Sample::Speed(sample) => {
                let channel = match self.speed {
                    Some(channel) => channel,
                    None => *self
                        .speed
                        .insert(self.writer.channel::<Float64>(&self.options.speed_topic)?),
                };
                self.writer.write(channel, log_time, &Float64(sample.speed))
            }
            Sample::Magnetic(sample) => {
                let channel = match self.magnetic {
                    Some(channel) => channel,
                    None => *self.magnetic.insert(
                        self.writer
                            .channel::<MagneticField<'_>>(&self.options.magnetic_topic)?,
                    ),
                };
                let message = MagneticField {
                    header: Header {
                        stamp: sample.time,
                        frame_id: IMU_FRAME,
                    },
                    magnetic_field: FLU_FRD * sample.field_b,
                    magnetic_field_covariance: [0.0; 9],
                };
                self.writer.write(channel, log_time, &message)
            }
        }
    }

    fn write_lever_arm(&mut self, time: Time) -> Result<(), LogError> {
        let Some(lever_b) = self.options.lever_arm_b else {
            return Ok(());
        };
        let channel = self.writer.channel::<TfMessage<'_>>("/tf_static")?;
        let transform = TransformStamped {
            header: Header {
                stamp: time,
                frame_id: IMU_FRAME,
            },
            child_frame_id: GNSS_FRAME,
            translation: FLU_FRD * lever_b,
            rotation: [0.0, 0.0, 0.0, 1.0],
        };
        self.writer.write(
            channel,
            time,
            &TfMessage {
                transforms: &[transform],
            },
        )
    }

    /// Complete the log and give it its name. Returns its length in bytes.
    pub fn finish(mut self) -> Result<u64, LogError> {
        let mut metadata = std::mem::take(&mut self.options.metadata);
        metadata.insert("version".into(), env!("CARGO_PKG_VERSION").into());
        if let Some(t0) = self.options.t0 {
            metadata.insert(METADATA_T0.into(), t0.0.to_string());
        }
        self.writer.write_metadata(METADATA_NAME, metadata)?;
        self.writer.finish()
    }
}
