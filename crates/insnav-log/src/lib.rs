//! Logs in, solutions out.
//!
//! [`Log`] opens an MCAP file of ROS 2, ROS 1, JSON or protobuf messages, finds its topics and gives [`Samples`] in time order;
//! [`McapSink`] takes what the navigator produces and writes a file that the common viewers open.
//!
//! In the order data flows: [`topics`] decides which topic is the IMU, [`ros2`] describes messages,
//! [`wire`] (with [`cdr`] for ROS 2) reads them by that description, [`Samples`]
//! turns them into SI and forward-right-down, [`McapSink`] writes the solution, [`SolutionTable`] reads it back.
//! [`Plan`] is the main job from a log to a solution, whoever asks for it.
//! [`csv`] and [`tum`] read and write text tables, [`GnssTrack`] reads what receivers write, [`export`] writes solutions for
//! maps and spreadsheets, [`mod@convert`] goes between tables and MCAP.

mod calendar;
pub mod cdr;
mod compared;
mod config_file;
mod container;
mod content;
pub mod convert;
pub mod csv;
mod device;
mod error;
mod export;
mod findings;
mod frames;
mod gnss_file;
mod imu_units;
mod log;
mod log_writer;
mod mcap_writer;
mod message;
mod orientation;
mod output_file;
mod problem;
mod reorder;
pub mod ros2;
mod run;
mod samples;
mod scenario_file;
mod simulated;
mod sink;
mod solution;
mod stamps;
mod stats;
mod topic_map;
pub mod topics;
mod transforms;
pub mod tum;
mod velocity_axes;
pub mod wire;

pub use compared::{ComparedReference, ComparedSolution, JudgeRequest, Judged, judge};
pub use config_file::{
    ConfigError, LogSettings, config_text, config_text_with, load_config, nearest, parse_config,
    parse_maps,
};
pub use container::{Checksums, Loss, McapRecord, Message, Recovery};
pub use error::LogError;
pub use export::{ExportFormat, export};
pub use findings::{Finding, Severity, SourceFacts, why_no_place};
pub use gnss_file::{GnssFileOptions, GnssFormat, GnssTrack};
pub use imu_units::ImuUnits;
pub use log::{ImuAxes, Log, METADATA_NAME, METADATA_T0, ReadOptions, TimeSource};
pub use log_writer::{LogWriter, LogWriterOptions};
pub use mcap_writer::Compression;
pub use message::MessageKind;
pub use orientation::OrientationTable;
pub use output_file::{
    abandon_outputs_of, check_output, is_standard_stream, remove_unfinished_outputs, write_output,
};
pub use problem::Problem;
pub use run::{
    AccelDeviation, AccelFit, Allan, Als, AlsHeading, AlsWindow, Fits, GyroDeviation, GyroFit,
    Identified, LogNoise, NoiseReadings, NoiseRequest, VarianceErrors, WithError,
    identify_log_noise, noise_readings,
};
pub use run::{
    AdaptedReport, AidingReport, AlignNoise, AlignReport, AlignRequest, AlignedStop,
    AlignmentReport, Clocks, Estimate, FinalReport, ImuOnlyReport, KnownStart, LatitudeSource,
    NoiseReport, Plan, ResetReport, RunError, RunOptions, RunReport, SavedRun, ScaleReport,
    SolutionSink, Source, StateError, StopReport, Stoppable, Stream, Survey, Warning, Withhold,
    align_by_stops, find,
};
pub use run::{
    FinalOrientation, GyroRange, HeadingReference, OrientationNoise, OrientationNoiseReport,
    OrientationPlan, OrientationReport, OrientationRequest, ahrs_settings,
};
pub use samples::{ReaderState, SampleCounts, Samples, imu_to_body};
pub use scenario_file::{SCENARIO_EXAMPLE, ScenarioFile};
pub use simulated::{simulated_truth, write_simulated};
pub use sink::{McapSink, SinkOptions, SinkState, SinkSummary, StateSink};
pub use sink::{OrientationEpoch, OrientationSink, OrientationSinkOptions};
pub use solution::{
    SolutionTable, UpdateRow, read_solution_states, read_solution_updates, read_solution_withheld,
};
pub use stats::{ClockDrift, ClockStep, Spread, TopicStatistics};
pub use topic_map::{Expression, MapClock, MapGnssAxes, MapImuAxes, TopicMap};
pub use topics::{Choice, Role, Selection, TopicInfo};
pub use transforms::{Mounting, StaticTransform};
pub use velocity_axes::VelocityAxes;
