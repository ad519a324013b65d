//! What a run tells, with the keys of the command's JSON.

use crate::Mounting;
use insnav_core::alignment::HeadingSource;
use insnav_core::attitude::wrap_angle;
use insnav_core::config::StationaryMode;
use insnav_core::filter::BlockInfo;
use insnav_core::imu::ImuGrade;
use insnav_core::noise_floor::NoiseFloor;
use insnav_core::stationary::{Evidence, StopEnd, StopRecord};
use insnav_core::time::Time;
use insnav_core::wheeled::WheelReport;
use serde::{Deserialize, Serialize};

/// Something in the data or the settings that the user should know, with what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// A short name for programs.
    pub code: &'static str,
    /// What was found.
    pub message: String,
    /// What to do about it.
    pub remedy: String,
}

/// A number and its standard deviation; no sigma when it was given and not estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The number.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: Option<f64>,
}

/// An optional block of states as it was estimated: scale factors, lever arm, mounting and the like.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Calibrated {
    /// Name of the block.
    pub name: &'static str,
    /// Unit of its numbers: m, deg, ppm, s.
    pub unit: &'static str,
    /// What is to be added to the settings.
    pub value: Vec<f64>,
    /// Standard deviations.
    pub sigma: Vec<f64>,
}

impl Calibrated {
    pub(super) fn of((block, value, sigma): (BlockInfo, [f64; 3], [f64; 3])) -> Self {
        let (unit, factor) = match block.unit {
            "rad" => ("deg", 1.0_f64.to_degrees()),
            "1" => ("ppm", 1e6),
            other => (other, 1.0),
        };
        let in_unit = |x: [f64; 3]| x[..block.size].iter().map(|x| x * factor).collect();
        Calibrated {
            name: block.name,
            unit,
            value: in_unit(value),
            sigma: in_unit(sigma),
        }
    }
}

/// Noise of the inertial unit as its own log shows it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct NoiseReport {
    /// Samples per second.
    pub rate_hz: f64,
    /// White noise of the gyros in the quietest stretches, °/√h, per axis.
    pub gyro_quiet_deg_per_sqrt_hour: [f64; 3],
    /// White noise of the accelerometers in the quietest stretches, m/s/√h, per axis.
    pub accel_quiet_m_per_s_per_sqrt_hour: [f64; 3],
    /// White noise of the gyros under way, vibration included, °/√h.
    pub gyro_under_way_deg_per_sqrt_hour: f64,
    /// White noise of the accelerometers under way, vibration included, m/s/√h.
    pub accel_under_way_m_per_s_per_sqrt_hour: f64,
    /// Mean rate while quiet (bias and Earth rate), °/h.
    pub gyro_mean_deg_per_hour: [f64; 3],
    /// Size of the mean specific force while quiet, m/s².
    pub force_m_per_s2: f64,
    /// Steps in which the gyros' values come, °/s; 0 where they are fine against the noise.
    pub gyro_step_deg_per_s: [f64; 3],
    /// Steps of the accelerometers, m/s², likewise.
    pub accel_step_m_per_s2: [f64; 3],
}

impl From<&NoiseFloor> for NoiseReport {
    fn from(floor: &NoiseFloor) -> Self {
        let per_sqrt_hour = |x: f64| x.to_degrees() * 60.0;
        NoiseReport {
            rate_hz: floor.rate,
            gyro_quiet_deg_per_sqrt_hour: floor.gyro_white.map(per_sqrt_hour).into(),
            accel_quiet_m_per_s_per_sqrt_hour: (floor.accel_white * 60.0).into(),
            gyro_under_way_deg_per_sqrt_hour: per_sqrt_hour(floor.gyro_shaken),
            accel_under_way_m_per_s_per_sqrt_hour: floor.accel_shaken * 60.0,
            gyro_mean_deg_per_hour: floor.gyro_mean.map(|w| w.to_degrees() * 3600.0).into(),
            force_m_per_s2: floor.force,
            gyro_step_deg_per_s: floor.gyro_step.map(f64::to_degrees).into(),
            accel_step_m_per_s2: floor.accel_step.into(),
        }
    }
}

/// A noise that was to be adapted to what the innovations of the run itself show.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AdaptedReport {
    /// The key of the settings with its unit: `gyro_arw_deg_per_sqrt_hour`, `accel_vrw_m_per_s_per_sqrt_hour`,
    /// `gnss_sigma_scale`, `gnss_velocity_sigma_scale`.
    pub name: &'static str,
    /// What it was before.
    pub prior: f64,
    /// What the innovations say; absent where they were too few.
    pub estimate: Option<f64>,
    /// Standard error of the estimate.
    pub standard_error: Option<f64>,
    /// Misfit of the lag covariances of all innovations at the estimate: the model fits below three times `dof`.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub dof: usize,
    /// `accepted`: the run uses the estimate. `held`, `on_bound`: it uses what it would without adaptation.
    pub verdict: &'static str,
    /// Why it was held.
    pub reason: Option<String>,
}

/// How the run began.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlignmentReport {
    /// Roll at the first sample, degrees.
    pub roll_deg: f64,
    /// Pitch, degrees.
    pub pitch_deg: f64,
    /// Heading, degrees clockwise from true north.
    pub heading_deg: f64,
    /// Standard deviation of the levelling (the larger of both axes), degrees.
    pub sigma_level_deg: f64,
    /// Standard deviation of the heading, degrees.
    pub sigma_heading_deg: f64,
    /// Seconds of standing data that levelled the start; 0 when it was levelled in motion.
    pub standing_s: f64,
    /// Before this, s, nothing says whether the gyros' means are biases or a slow turn; `None` where they were steady.
    pub rates_doubtful_until_s: Option<f64>,
    /// Whether the vehicle drove backwards where its course was taken.
    pub reversing: bool,
    /// Where the heading came from.
    pub heading_source: HeadingSource,
    /// When the heading became known, s.
    pub heading_at_s: f64,
}

/// A stop of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StopReport {
    /// Begin, s.
    pub begin_s: f64,
    /// From when on the filter made use of it, s: a stop is believed only after a while.
    pub held_from_s: f64,
    /// End, s.
    pub end_s: f64,
    /// Stretches in which it was held: more than one where people moved in a vehicle that stood, as receiver or wheels say.
    pub pieces: usize,
    /// Why it ended.
    pub ended_by: StopEnd,
    /// How it was held at its end; not always as set.
    pub mode: StationaryMode,
    /// Who said that the vehicle stood, and what the detector saw then.
    pub evidence: Evidence,
    /// Heading just before the filter made use of the stop, degrees.
    pub heading_before_deg: f64,
    /// Its standard deviation, degrees.
    pub sigma_heading_before_deg: f64,
    /// Correction of the heading when the stop was entered, degrees. With the next three it makes the heading after of the one
    /// before.
    pub heading_at_entry_deg: f64,
    /// By how much the heading left the one that was held (propagation, less what the hold took back), degrees.
    pub heading_growth_deg: f64,
    /// By how much the held heading was moved by what was learnt during the stop, degrees.
    pub heading_corrections_deg: f64,
    /// By how much the heading changed between pieces, where nothing was held, degrees.
    pub heading_between_deg: f64,
    /// Heading at the end, degrees.
    pub heading_after_deg: f64,
    /// Standard deviation of the heading at the end, degrees.
    pub sigma_heading_deg: f64,
    /// Gyro bias at the end, degrees per hour, body axes.
    pub gyro_bias_deg_per_hour: [f64; 3],
    /// Its standard deviation, degrees per hour.
    pub sigma_gyro_bias_deg_per_hour: [f64; 3],
    /// Steps in which the gyros' values come, degrees per second, where these are coarser than their noise; else 0.
    pub gyro_step_deg_per_s: [f64; 3],
    /// Whether a gyro repeated one value: nothing is then learnt of its bias.
    pub gyro_repeats: [bool; 3],
}

impl StopReport {
    pub(super) fn new(stop: &StopRecord, origin: Time) -> Self {
        let compass = |heading: f64| heading.to_degrees().rem_euclid(360.0);
        let difference = |angle: f64| wrap_angle(angle).to_degrees();
        let per_hour = |rate: f64| rate.to_degrees() * 3600.0;
        StopReport {
            begin_s: stop.begin.since(origin),
            held_from_s: stop.held_from.since(origin),
            end_s: stop.end.since(origin),
            pieces: 1,
            ended_by: stop.ended_by,
            mode: stop.mode,
            evidence: stop.evidence,
            heading_before_deg: compass(stop.heading_before),
            sigma_heading_before_deg: stop.sigma_heading_before.to_degrees(),
            heading_at_entry_deg: difference(stop.heading_at_entry),
            heading_growth_deg: difference(stop.heading_growth),
            heading_corrections_deg: difference(stop.heading_corrections),
            heading_between_deg: 0.0,
            heading_after_deg: compass(stop.heading_after),
            sigma_heading_deg: stop.sigma_heading_after.to_degrees(),
            gyro_bias_deg_per_hour: stop.gyro_bias.map(per_hour).into(),
            sigma_gyro_bias_deg_per_hour: stop.sigma_gyro_bias.map(per_hour).into(),
            gyro_step_deg_per_s: stop.gyro_step.map(f64::to_degrees).into(),
            gyro_repeats: stop.gyro_repeats,
        }
    }

    /// From the heading at the end of this stop to the one before another, degrees.
    pub(super) fn turn_until_deg(&self, next: &StopReport) -> f64 {
        wrap_angle((next.heading_before_deg - self.heading_after_deg).to_radians()).to_degrees()
    }

    /// Go on with another piece of the same stop.
    pub(super) fn join(&mut self, next: &StopReport) {
        let steps = |i: usize| self.gyro_step_deg_per_s[i].max(next.gyro_step_deg_per_s[i]);
        *self = StopReport {
            begin_s: self.begin_s,
            held_from_s: self.held_from_s,
            pieces: self.pieces + next.pieces,
            evidence: self.evidence,
            heading_before_deg: self.heading_before_deg,
            sigma_heading_before_deg: self.sigma_heading_before_deg,
            heading_at_entry_deg: self.heading_at_entry_deg,
            heading_growth_deg: self.heading_growth_deg + next.heading_growth_deg,
            heading_between_deg: self.heading_between_deg
                + self.turn_until_deg(next)
                + next.heading_between_deg,
            heading_corrections_deg: self.heading_corrections_deg
                + next.heading_at_entry_deg
                + next.heading_corrections_deg,
            gyro_step_deg_per_s: [0, 1, 2].map(steps),
            gyro_repeats: [0, 1, 2].map(|i| self.gyro_repeats[i] || next.gyro_repeats[i]),
            ..*next
        };
    }

    /// Heading at the end less the one before, between -180° and 180°.
    pub fn heading_change_deg(&self) -> f64 {
        wrap_angle((self.heading_after_deg - self.heading_before_deg).to_radians()).to_degrees()
    }
}

/// What became of one kind of measurement.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AidingReport {
    /// Name of the measurement.
    pub name: String,
    /// Components of one, at most.
    pub dof: usize,
    /// Used as they stood.
    pub used: usize,
    /// Refused by the gate.
    pub rejected: usize,
    /// Used with a widened covariance.
    pub inflated: usize,
    /// Used after the filter was widened until they fitted: one for each time that it went over to refused measurements.
    pub reset: usize,
    /// Not used, being the position before once more while the body moved.
    pub frozen: usize,
    /// Mean normalised innovation squared per component of those that were used as they stood: 1 when the noise is right. With
    /// the gate at 1e-4 it cannot exceed 4.2 by much; then many are refused.
    pub nis_mean: Option<f64>,
    /// The longest stretch in which they cannot be true if the solution is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub misfit: Option<MisfitReport>,
}

/// A stretch of ten seconds or more in which every measurement of a kind has a NIS of 20 per component, or more.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct MisfitReport {
    /// Begin, s.
    pub begin_s: f64,
    /// End, s.
    pub end_s: f64,
    /// How many there are.
    pub count: usize,
}

impl AidingReport {
    /// All that were offered.
    pub fn count(&self) -> usize {
        self.used + self.rejected + self.inflated + self.reset + self.frozen
    }
}

/// The filter went over to positions that it had refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResetReport {
    /// When, s.
    pub time_s: f64,
    /// How far, north, east, down, m.
    pub offset_ned_m: [f64; 3],
}

/// Factors on the sigmas that a receiver states, at the end of the run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ScaleReport {
    /// On north and east.
    pub horizontal: f64,
    /// On down.
    pub vertical: f64,
    /// Whether learnt from the residuals; else as set.
    pub learnt: bool,
}

/// What a run without GNSS begins with.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImuOnlyReport {
    /// Latitude of the start, degrees.
    pub latitude_deg: f64,
    /// Whether nobody told it.
    pub latitude_assumed: bool,
    /// Topics of GNSS that the log has and that were not used.
    pub gnss_left_out: Vec<String>,
}

/// The last epoch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FinalReport {
    /// Instant, s.
    pub time_s: f64,
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// Longitude, degrees.
    pub longitude_deg: f64,
    /// Ellipsoidal height, m.
    pub height_m: f64,
    /// Without GNSS: horizontal distance from the start, m. A way that ends where it began closes by this.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closure_horizontal_m: Option<f64>,
    /// Without GNSS: height above the start, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub closure_height_m: Option<f64>,
    /// Velocity north, east, down, m/s.
    pub velocity_ned_m_per_s: [f64; 3],
    /// Roll, degrees.
    pub roll_deg: f64,
    /// Pitch, degrees.
    pub pitch_deg: f64,
    /// Heading, degrees clockwise from true north.
    pub heading_deg: f64,
    /// Gyro bias, degrees per hour, body axes.
    pub gyro_bias_deg_per_hour: [f64; 3],
    /// Accelerometer bias, mg, body axes.
    pub accel_bias_mg: [f64; 3],
    /// Standard deviation of the horizontal position (root of the sum of both variances), m.
    pub sigma_horizontal_m: f64,
    /// Of the height, m.
    pub sigma_height_m: f64,
    /// Of the horizontal velocity, m/s.
    pub sigma_velocity_m_per_s: f64,
    /// Of roll and pitch (the larger), degrees.
    pub sigma_level_deg: f64,
    /// Of the heading, degrees.
    pub sigma_heading_deg: f64,
    /// Of the gyro biases, degrees per hour.
    pub sigma_gyro_bias_deg_per_hour: [f64; 3],
    /// Of the accelerometer biases, mg.
    pub sigma_accel_bias_mg: [f64; 3],
}

/// Everything a run has to say.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunReport {
    /// Inertial samples taken.
    pub imu_samples: usize,
    /// Time between the first and the last epoch, s.
    pub duration_s: f64,
    /// Time the computer needed, s.
    pub elapsed_s: f64,
    /// Way over ground, m.
    pub distance_m: f64,
    /// Added to IMU stamps to meet the clock of GNSS positions.
    pub time_offset_s: Estimate,
    /// How much later than its position a velocity is stamped.
    pub gnss_velocity_lag_s: Estimate,
    /// What a search for the offset found, where it was not used.
    pub time_offset_found_s: Option<Estimate>,
    /// What a search for the lag found, where it was not used.
    pub gnss_velocity_lag_found_s: Option<Estimate>,
    /// Class of the inertial unit.
    pub imu_grade: ImuGrade,
    /// Whether it was picked from the log's own noise.
    pub imu_grade_picked: bool,
    /// White noise of the gyros that the run used, °/√h.
    pub gyro_arw_deg_per_sqrt_hour: f64,
    /// White noise of the accelerometers that the run used, m/s/√h.
    pub accel_vrw_m_per_s_per_sqrt_hour: f64,
    /// White noise of the gyros at rest, by which stops are told, °/√h; absent: that of the run.
    pub rest_gyro_arw_deg_per_sqrt_hour: Option<f64>,
    /// Of the accelerometers, m/s/√h, likewise.
    pub rest_accel_vrw_m_per_s_per_sqrt_hour: Option<f64>,
    /// What the log's own noise is; absent for logs of a few seconds.
    pub imu_noise: Option<NoiseReport>,
    /// What became of each noise that was to be adapted (`noise.adapt`); empty where nothing was.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub noise_adaptation: Vec<AdaptedReport>,
    /// Lever arm used, forward-right-down, m.
    pub lever_arm_b_m: [f64; 3],
    /// How the IMU is mounted, where the log's static transforms were taken for it.
    pub imu_mounting: Option<Mounting>,
    /// Of a run without GNSS, what it begins with.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub imu_only: Option<ImuOnlyReport>,
    /// The start.
    pub alignment: Option<AlignmentReport>,
    /// Stops, in order of time.
    pub stops: Vec<StopReport>,
    /// On a foot: how many stops were shorter than a second, which are not listed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stances: Option<usize>,
    /// Measurements.
    pub aiding: Vec<AidingReport>,
    /// Factors on stated position sigmas.
    pub gnss_sigma_scale: ScaleReport,
    /// Factors on stated velocity sigmas.
    pub gnss_velocity_sigma_scale: ScaleReport,
    /// When the filter went over to positions that it had refused; the first hundred.
    pub position_resets: Vec<ResetReport>,
    /// Samples that could not be used for what was in them, the reason of the first with its time.
    pub unusable: usize,
    /// Fixes withheld.
    pub withheld: usize,
    /// Which they were, as the user said it: `120:150,300:330` or `every:2`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub withhold: Option<String>,
    /// The end.
    #[serde(rename = "final")]
    pub last: Option<FinalReport>,
    /// Where the vehicle moves against its body, if that was looked at.
    pub wheels: Option<WheelReport>,
    /// What was found of the optional states, at the end.
    pub calibration: Vec<Calibrated>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The settings as they were used, TOML.
    pub config: String,
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn headings_of_a_stop_are_those_of_a_compass_and_their_differences_the_short_way() {
        let deg = f64::to_radians;
        let stop = StopRecord {
            begin: Time::from_seconds(110.0),
            held_from: Time::from_seconds(112.5),
            end: Time::from_seconds(150.0),
            ended_by: StopEnd::Motion,
            mode: StationaryMode::Static,
            evidence: Evidence::default(),
            heading_before: deg(-0.5),
            sigma_heading_before: deg(0.4),
            heading_at_entry: deg(359.9),
            heading_growth: deg(0.01),
            heading_corrections: deg(-360.2),
            heading_after: deg(1.0),
            sigma_heading_after: deg(0.3),
            gyro_bias: Vector3::new(0.0, 0.0, deg(10.0 / 3600.0)),
            sigma_gyro_bias: Vector3::repeat(deg(1.0 / 3600.0)),
            gyro_step: Vector3::zeros(),
            gyro_repeats: [false; 3],
        };
        let told = StopReport::new(&stop, Time::from_seconds(100.0));
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert_eq!(
            (told.begin_s, told.held_from_s, told.end_s),
            (10.0, 12.5, 50.0)
        );
        assert!(near(told.heading_before_deg, 359.5) && near(told.heading_after_deg, 1.0));
        assert!(near(told.heading_change_deg(), 1.5));
        assert!(near(told.heading_at_entry_deg, -0.1) && near(told.heading_corrections_deg, -0.2));
        assert!(near(told.gyro_bias_deg_per_hour[2], 10.0));
        let json = serde_json::to_value(told).unwrap();
        assert_eq!(json["ended_by"], "motion");
        assert_eq!(json["evidence"]["witness"], "nobody");
        assert!(json["evidence"]["mean_rate_ratio"].is_null(), "{json}");
    }
}
