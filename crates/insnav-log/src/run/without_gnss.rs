//! A run without GNSS: what it begins with, and what cannot be asked of it.

use super::RunError;
use super::plan::RunOptions;
use super::report::ImuOnlyReport;
use super::source::Source;
use super::withhold::Withhold;
use insnav_core::alignment::Startup;
use insnav_core::config::Config;
use insnav_core::error::Error as CoreError;
use insnav_core::imu::ImuGrade;

/// Rest is looked for in so much of the begin, s of samples: four seconds, and what a unit may need to come alive.
const LOOK_S: f64 = 5.0;

/// What only makes sense with fixes.
pub(super) fn refuse_what_needs_it(options: &RunOptions) -> Result<(), RunError> {
    let option = match (&options.withhold, options.time_offset_auto) {
        (Withhold::Nothing, false) => return Ok(()),
        (Withhold::Nothing, true) => "--time-offset auto",
        _ => "--withhold",
    };
    Err(RunError::NeedsGnss { option })
}

/// Refuse a source that does not begin at rest before it is read to its end.
pub(super) fn look_for_rest(
    source: &(impl Source + ?Sized),
    config: &Config,
) -> Result<(), RunError> {
    // Whether there is rest does not depend on the unit's class.
    let mut startup = Startup::new(config, ImuGrade::Consumer.noise());
    let mut first = None;
    for sample in source.samples()? {
        let sample = sample?;
        // The navigator tells what nobody can use, and leaves it out.
        if sample.check().is_err() {
            continue;
        }
        if sample.is_inertial() {
            let first = *first.get_or_insert(sample.time());
            if sample.time().since(first) > LOOK_S {
                break;
            }
        }
        startup.push(sample);
    }
    match startup.align_with_what_there_is() {
        Err(CoreError::NotStarted { missing }) if first.is_some() => {
            Err(RunError::NoRest { missing })
        }
        _ => Ok(()),
    }
}

impl ImuOnlyReport {
    /// `None` for a run with GNSS.
    pub(super) fn of(config: &Config, gnss_in_arrays: bool, topics: Vec<String>) -> Option<Self> {
        let (place, told) = config.place_without_gnss()?;
        let mut gnss_left_out = topics;
        if gnss_in_arrays {
            gnss_left_out.push("GNSS arrays".into());
        }
        Some(ImuOnlyReport {
            latitude_deg: place.latitude_deg(),
            latitude_assumed: !told,
            gnss_left_out,
        })
    }
}
