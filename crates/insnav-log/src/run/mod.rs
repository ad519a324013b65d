//! The main job, whoever asks for it: look at the data, choose what is left open, drive the one loop.
//!
//! ```no_run
//! use insnav_log::{Log, Plan, ReadOptions, RunOptions};
//! # fn main() -> Result<(), insnav_log::RunError> {
//! let log = Log::open("drive.mcap".as_ref(), ReadOptions::default())?;
//! let plan = Plan::make(&log, &Default::default(), &RunOptions::default())?;
//! let report = plan.execute(&log, &mut ())?; // any sink
//! println!("{:.0} m in {:.0} s", report.distance_m, report.duration_s);
//! # Ok(()) }
//! ```

mod adapt;
mod alignment;
mod clocks;
mod compass;
mod doubts;
mod error;
mod execute;
mod known_start;
mod noise;
mod noise_block;
mod noise_readings;
mod oddities;
mod orientation;
mod plan;
mod report;
mod saved;
mod source;
mod standing;
mod stop_pieces;
mod stoppable;
mod survey;
mod tally;
mod wheels;
mod withhold;
mod without_gnss;

pub use alignment::{
    AlignNoise, AlignReport, AlignRequest, AlignedStop, LatitudeSource, align_by_stops,
};
pub use clocks::Clocks;
pub use error::RunError;
pub use known_start::KnownStart;
pub use noise::{
    AccelDeviation, AccelFit, Allan, Als, AlsHeading, AlsWindow, Fits, GyroDeviation, GyroFit,
    Identified, LogNoise, NoiseRequest, VarianceErrors, WithError, identify_log_noise,
};
pub use noise_readings::{NoiseReadings, noise_readings};
pub use oddities::find;
pub use orientation::{
    FinalOrientation, GyroRange, HeadingReference, OrientationNoise, OrientationNoiseReport,
    OrientationPlan, OrientationReport, OrientationRequest, ahrs_settings,
};
pub use plan::{Plan, RunOptions};
pub use report::{
    AdaptedReport, AidingReport, AlignmentReport, Estimate, FinalReport, ImuOnlyReport,
    NoiseReport, ResetReport, RunReport, ScaleReport, StopReport, Warning,
};
pub use saved::{SavedRun, StateError};
pub use source::{SolutionSink, Source, Stream};
pub use stoppable::Stoppable;
pub use survey::Survey;
pub use withhold::Withhold;
