//! The solution as an MCAP file that the common viewers open with no further work.

mod decimation;
mod diagnostics;
mod orientation;
mod states;
mod values;

pub use orientation::{OrientationEpoch, OrientationSink, OrientationSinkOptions};
pub use states::StateSink;
pub(crate) use values::fix_message;

use crate::error::LogError;
use crate::frames::{MapState, moved_to};
use crate::log::METADATA_NAME;
use crate::mcap_writer::{ChannelHandle, Compression, McapWriter};
use crate::ros2::{
    DiagnosticArray, DiagnosticStatus, Header, NavSatFix, Odometry, Pose, PoseStamped, State,
    TfMessage, TransformStamped, Twist, UpdateMessage,
};
use insnav_core::earth::{Geodetic, LocalFrame};
use insnav_core::filter::{Update, Verdict};
use insnav_core::sample::GnssPosition;
use insnav_core::solution::{Epoch, Sink};
use insnav_core::time::Time;
use nalgebra::{Matrix6, UnitQuaternion};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use decimation::Decimation;
use diagnostics::Diagnostics;
use values::state_message;

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
            // Numbers in double precision hardly shrink: a tenth more bytes than with zstd, a quarter of its time.
            compression: Compression::Lz4,
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

/// What a sink carries from one file to the next, so that both together are what one would have been.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SinkState {
    map: Option<LocalFrame>,
    decimation: Decimation,
    diagnostics: Diagnostics,
    sequences: Vec<u32>,
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

    /// What the sink of the next file has to know.
    pub fn state(&self) -> SinkState {
        SinkState {
            map: self.map,
            decimation: self.decimation.clone(),
            diagnostics: self.diagnostics.clone(),
            sequences: self.writer.sequences().to_vec(),
        }
    }

    /// Go on where the sink of the file before stopped: before anything is written.
    pub fn resume(&mut self, state: &SinkState) {
        self.map = state.map;
        self.decimation = state.decimation.clone();
        self.diagnostics = state.diagnostics.clone();
        self.writer.continue_sequences(&state.sequences);
    }

    /// The error that has ended the writing, if any.
    pub(crate) fn take_failure(&mut self) -> Option<LogError> {
        self.failure.take()
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
                Verdict::Reset => 3,
                Verdict::Frozen => 4,
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

fn xyzw(q: &UnitQuaternion<f64>) -> [f64; 4] {
    [q.i, q.j, q.k, q.w]
}

fn row_by_row(matrix: &Matrix6<f64>) -> [f64; 36] {
    std::array::from_fn(|k| matrix[(k / 6, k % 6)])
}
