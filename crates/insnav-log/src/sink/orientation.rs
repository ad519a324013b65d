//! An orientation over time as an MCAP file: `/insnav/imu` and `/tf`.

use super::decimation::Decimation;
use crate::error::LogError;
use crate::frames::{ENU_NED, FLU_FRD};
use crate::log::METADATA_NAME;
use crate::mcap_writer::{ChannelHandle, Compression, McapWriter};
use crate::orientation::ORIENTATION_TOPIC;
use crate::ros2::{Header, Imu, TfMessage, TransformStamped};
use insnav_core::metrics::to_enu_flu;
use insnav_core::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

/// One instant of an orientation, with what was measured then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientationEpoch {
    /// The instant.
    pub time: Time,
    /// Rotation from body (forward-right-down) to NED.
    pub q_nb: UnitQuaternion<f64>,
    /// Covariance as a small rotation in NED, rad².
    pub covariance_n: Matrix3<f64>,
    /// Angular rate as measured, body, rad/s.
    pub angular_rate_b: Vector3<f64>,
    /// Specific force as measured, body, m/s².
    pub specific_force_b: Vector3<f64>,
}

/// How to write an orientation.
#[derive(Clone, Debug, PartialEq)]
pub struct OrientationSinkOptions {
    /// Replace a file that is already there.
    pub force: bool,
    /// Epochs per second; 0: all.
    pub rate_hz: f64,
    /// How chunks are compressed.
    pub compression: Compression,
    /// Name of the earth frame, east-north-up.
    pub map_frame: String,
    /// Name of the body frame, forward-left-up.
    pub base_frame: String,
    /// What goes into the metadata record `insnav` besides version and rate.
    pub metadata: BTreeMap<String, String>,
}

impl Default for OrientationSinkOptions {
    fn default() -> Self {
        OrientationSinkOptions {
            force: false,
            rate_hz: 0.0,
            compression: Compression::Lz4,
            map_frame: "map".into(),
            base_frame: "base_link".into(),
            metadata: BTreeMap::new(),
        }
    }
}

/// Writes an orientation: `/insnav/imu`, sensor_msgs/Imu with the measured rate and force, the orientation of the body
/// (forward-left-up) in the earth frame (ENU) and its covariance as a rotation about the earth's axes; and `/tf` from the one to the other.
///
/// The file appears under its name when [`OrientationSink::finish`] succeeds; dropped before, it leaves nothing.
pub struct OrientationSink {
    writer: McapWriter,
    imu: ChannelHandle,
    tf: ChannelHandle,
    options: OrientationSinkOptions,
    decimation: Decimation,
    epochs: u64,
}

impl OrientationSink {
    /// Begin a file. Fails at once when it exists (without `force`) or cannot be written.
    pub fn create(path: &Path, options: OrientationSinkOptions) -> Result<Self, LogError> {
        let mut writer = McapWriter::create(path, options.force, options.compression)?;
        Ok(OrientationSink {
            imu: writer.channel::<Imu<'_>>(ORIENTATION_TOPIC)?,
            tf: writer.channel::<TfMessage<'_>>("/tf")?,
            writer,
            decimation: Decimation::new(options.rate_hz),
            options,
            epochs: 0,
        })
    }

    /// Write an epoch, if it is its turn.
    pub fn write(&mut self, epoch: &OrientationEpoch) -> Result<(), LogError> {
        if !self.decimation.wants(epoch.time) {
            return Ok(());
        }
        let q = to_enu_flu(&epoch.q_nb);
        let orientation = [q.i, q.j, q.k, q.w];
        let covariance = ENU_NED * epoch.covariance_n * ENU_NED;
        let message = Imu {
            header: Header {
                stamp: epoch.time,
                frame_id: &self.options.base_frame,
            },
            orientation,
            orientation_covariance: std::array::from_fn(|k| covariance[(k / 3, k % 3)]),
            angular_velocity: FLU_FRD * epoch.angular_rate_b,
            linear_acceleration: FLU_FRD * epoch.specific_force_b,
            ..Imu::default()
        };
        self.writer.write(self.imu, epoch.time, &message)?;
        let transform = TransformStamped {
            header: Header {
                stamp: epoch.time,
                frame_id: &self.options.map_frame,
            },
            child_frame_id: &self.options.base_frame,
            translation: Vector3::zeros(),
            rotation: orientation,
        };
        self.writer.write(
            self.tf,
            epoch.time,
            &TfMessage {
                transforms: &[transform],
            },
        )?;
        self.epochs += 1;
        Ok(())
    }

    /// Complete the file. Returns the number of epochs in it.
    pub fn finish(mut self) -> Result<u64, LogError> {
        let mut metadata = std::mem::take(&mut self.options.metadata);
        metadata.insert("version".into(), env!("CARGO_PKG_VERSION").into());
        metadata.insert("rate_hz".into(), self.options.rate_hz.to_string());
        self.writer.write_metadata(METADATA_NAME, metadata)?;
        self.writer.finish()?;
        Ok(self.epochs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::log::{Log, METADATA_T0, ReadOptions};
    use crate::orientation::OrientationTable;
    use insnav_core::attitude::Euler;

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ahrs.mcap");
        let covariance_n = Matrix3::new(4.0, 0.5, 0.1, 0.5, 5.0, -0.2, 0.1, -0.2, 9.0) * 1e-4;
        let epoch = |i: i64| OrientationEpoch {
            time: Time(1_600_000_000_000_000_000 + 10_000_000 * i),
            q_nb: Euler::from_degrees(10.0, -20.0, 170.0 + i as f64).to_quaternion(),
            covariance_n,
            angular_rate_b: Vector3::new(0.1, 0.2, 0.3),
            specific_force_b: Vector3::new(1.0, 2.0, -9.8),
        };
        let t0 = epoch(-100).time;
        let mut options = OrientationSinkOptions::default();
        options
            .metadata
            .insert(METADATA_T0.into(), t0.0.to_string());
        let mut sink = OrientationSink::create(&path, options).unwrap();
        (0..5).for_each(|i| sink.write(&epoch(i)).unwrap());
        assert_eq!(sink.finish().unwrap(), 5);
        let log = Log::open(&path, ReadOptions::default()).unwrap();
        assert!(OrientationTable::is_in(&log));
        let table = OrientationTable::from_mcap(&log).unwrap();
        assert_eq!(table.t0(), Some(t0));
        for i in 0..5 {
            let wanted = epoch(i);
            let i = i as usize;
            assert_eq!(table.time[i], wanted.time);
            assert!(table.q_nb[i].angle_to(&wanted.q_nb) < 1e-12);
            let off = table.covariance_n[i].unwrap() - covariance_n;
            assert!(off.norm() < 1e-18, "{off}");
        }
        // A recording, too, for whom names it: its rates are those of the body.
        let named = ReadOptions {
            topics: vec![(crate::topics::Role::Imu, "/insnav/imu".into())],
            ..ReadOptions::default()
        };
        let log = Log::open(&path, named).unwrap();
        let sample = log.samples().unwrap().next().unwrap().unwrap();
        let insnav_core::sample::Sample::Imu(imu) = sample else {
            panic!("{sample:?}");
        };
        assert_eq!(imu.specific_force_b, Vector3::new(1.0, 2.0, -9.8));
    }
}
