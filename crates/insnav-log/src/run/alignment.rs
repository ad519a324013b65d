//! Alignment from the stops of a log: attitude, azimuth and drifts, as [`insnav_core::alignment::align`] finds them.

use super::plan::{Plan, RunOptions};
use super::report::{StopReport, Warning};
use super::source::Source;
use super::standing::state_noise_at_rest;
use super::stop_pieces::TURNED_DEG;
use super::survey::Survey;
use super::{RunError, oddities};
use crate::findings;
use insnav_core::alignment::{
    AlignmentMethod, AlignmentOptions, AlignmentResult, Record, StopReport as CoreStop, StopWindow,
    Taper, align,
};
use insnav_core::config::Config;
use insnav_core::earth::Geodetic;
use insnav_core::error::Error as CoreError;
use insnav_core::imu::{ImuGrade, STANDARD_GRAVITY};
use insnav_core::mechanization::IncrementBuilder;
use insnav_core::noise_floor::NoiseFloor;
use insnav_core::sample::Sample;
use insnav_core::stationary::StopEnd;
use insnav_core::time::Time;
use serde::Serialize;

/// Stops that the detector proposes are cut at both ends: settling is over there, s.
const TRIM: f64 = 3.0;
/// Unless less than [`LEAST_PROPOSAL`] would be left, but never by less, s.
const LEAST_TRIM: f64 = 0.5;
/// No vehicle drives off and comes to rest again in so short a break, s.
const SHORT_BREAK: f64 = 4.0;
/// Shorter proposals say nothing of north, s.
const LEAST_PROPOSAL: f64 = 40.0;
/// Shorter proposals do not even level, s.
const LEAST_LEVEL: f64 = 5.0;

/// What is asked, and what is known that the log does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlignRequest {
    /// How; automatic by default.
    pub method: AlignmentMethod,
    /// Begin and end of each stop, s after the log's zero; none: those that a run finds.
    pub stops: Vec<[f64; 2]>,
    /// Where the latitude is not to come from settings or fixes, degrees.
    pub latitude_deg: Option<f64>,
    /// Heading of the body's x axis at the first stop's begin and its standard deviation, degrees.
    pub heading_deg: Option<[f64; 2]>,
    /// The azimuth is called unobservable when its sigma would be larger, degrees; `None`: 5°.
    pub largest_azimuth_sigma_deg: Option<f64>,
}

/// Where the latitude came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LatitudeSource {
    /// Given with the request.
    Given,
    /// `output.origin` of the settings.
    Settings,
    /// The median of the log's fixes.
    Fixes,
}

/// An alignment, with what went into it.
#[derive(Clone, Debug, Serialize)]
pub struct AlignReport {
    /// Which method.
    pub method: &'static str,
    /// Why that one.
    pub reason: String,
    /// Whether the log has rates or increments.
    pub input: &'static str,
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// And who said so.
    pub latitude_source: LatitudeSource,
    /// Noise of the unit as it was used.
    pub noise: AlignNoise,
    /// The instant for which everything holds, s after the log's zero: the end of the last stop.
    pub at_s: f64,
    /// Roll then, degrees.
    pub roll_deg: f64,
    /// Its standard deviation.
    pub sigma_roll_deg: f64,
    /// Pitch then, degrees.
    pub pitch_deg: f64,
    /// Its standard deviation.
    pub sigma_pitch_deg: f64,
    /// Heading of the body's x axis then, degrees from true north; `None` where it is not found.
    pub heading_deg: Option<f64>,
    /// Its standard deviation, degrees; where it is not found, what it would be.
    pub sigma_heading_deg: f64,
    /// Heading of the body's x axis at the begin of the first stop that is used: the azimuth of the level frame.
    pub azimuth_deg: Option<f64>,
    /// That begin, s after the log's zero.
    pub azimuth_at_s: Option<f64>,
    /// Gyro bias, body axes, rad/s: measured minus true.
    pub gyro_bias_rad_per_s: [f64; 3],
    /// Its standard deviations.
    pub sigma_gyro_bias_rad_per_s: [f64; 3],
    /// Accelerometer bias, body axes, m/s².
    pub accel_bias_m_per_s2: [f64; 3],
    /// Its standard deviations.
    pub sigma_accel_bias_m_per_s2: [f64; 3],
    /// Covariance of attitude (north, east, down, rad), gyro bias and accelerometer bias.
    pub covariance: [[f64; 9]; 9],
    /// Which of these nine the stops said something of.
    pub observable: Observable,
    /// The combination that the positions tell least.
    pub weakest_direction: WeakestDirection,
    /// How well they tell it: 0 not at all, 1.4 the best that two positions can do.
    pub geometry_ratio: f64,
    /// The horizontal Earth rate found over that of the latitude, minus one, and its sigma.
    pub norm_residual: Option<[f64; 2]>,
    /// Normalised innovations squared of the Kalman filter over their number.
    pub nis_ratio: Option<f64>,
    /// The stops, in the order of time.
    pub stops: Vec<AlignedStop>,
    /// Whether a run proposed them.
    pub stops_proposed: bool,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The same as the core gives it: attitude as a rotation, angles in radians.
    #[serde(skip)]
    pub result: AlignmentResult,
}

/// Noise of a unit in the units of data sheets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct AlignNoise {
    /// Class of the unit.
    pub grade: &'static str,
    /// White noise of the gyros.
    pub gyro_arw_deg_per_sqrt_hour: f64,
    /// White noise of the accelerometers.
    pub accel_vrw_m_per_s_per_sqrt_hour: f64,
    /// Standard deviation of the gyro bias beforehand.
    pub gyro_bias_deg_per_hour: f64,
    /// Likewise of the accelerometers.
    pub accel_bias_mg: f64,
}

/// Nine answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Observable {
    /// North, east (tilt), down (heading).
    pub attitude: [bool; 3],
    /// Body axes.
    pub gyro_bias: [bool; 3],
    /// Body axes.
    pub accel_bias: [bool; 3],
}

/// A unit vector over azimuth and drift, drifts over Ω cos L.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WeakestDirection {
    /// Azimuth.
    pub azimuth: f64,
    /// Drift along north, east and down at the first stop.
    pub drift_ned: [f64; 3],
}

/// A stop, and what it showed where a fit went through it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AlignedStop {
    /// Begin, s after the log's zero.
    pub begin_s: f64,
    /// End.
    pub end_s: f64,
    /// What the fit saw.
    #[serde(flatten)]
    pub seen: Option<SeenStop>,
}

/// What a fit saw of a stop.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SeenStop {
    /// What the fit leaves of the stop's rate, north, east, down.
    pub residual_rate_ned_rad_per_s: [f64; 3],
    /// Standard deviation of that by the unit's noise.
    pub sigma_rate_rad_per_s: [f64; 3],
    /// Scatter of the attitude, rms.
    pub rocking_rms_deg: [f64; 3],
    /// Period of the strongest rocking.
    pub rocking_period_s: Option<f64>,
    /// Scatter of the computed velocity about the fit, rms.
    pub velocity_rms_m_per_s: f64,
    /// Weights.
    pub taper: &'static str,
    /// Largest difference of the two halves' rates, in sigmas.
    pub half_disagreement_sigma: f64,
}

/// Align by the stops of a log.
///
/// # Errors
/// Those of a run; `Navigator` with the core's refusal; `NoLatitude` and `NoStops` where neither the request nor the log has any.
pub fn align_by_stops(
    source: &(impl Source + ?Sized),
    config: &Config,
    request: &AlignRequest,
) -> Result<AlignReport, RunError> {
    source.check()?;
    let survey = Survey::of(source)?;
    // A log without fixes is one without GNSS: what the settings say for that is allowed.
    let mut without_fixes = *config;
    without_fixes.gnss.used &= !survey.positions.is_empty();
    let config = &without_fixes;
    config.validate().map_err(RunError::from)?;
    let (first, last) = survey.imu_span.ok_or(RunError::NoImu)?;
    let origin = source.origin()?.unwrap_or(first);
    let facts = source.facts()?;
    let found = findings::of_topics(&facts, origin);
    oddities::refuse_fatal(&found)?;
    let mut warnings: Vec<Warning> = facts.recovered.into_iter().collect();

    let (position, latitude_source) = place(config, &survey, request)?;
    let (stops, proposed) = if request.stops.is_empty() {
        (
            proposals(source, config, &position, &survey, &mut warnings)?,
            true,
        )
    } else {
        (request.stops.clone(), false)
    };

    let floor = survey.noise_floor.as_ref();
    let grade = config
        .imu
        .grade
        .unwrap_or_else(|| floor.map_or(ImuGrade::Consumer, NoiseFloor::grade));
    let mut settled = *config;
    let class = config.noise.over(grade);
    if let Some(floor) = floor {
        let standing = stops.iter().map(|[a, b]| b - a).sum();
        state_noise_at_rest(&mut settled, &class, floor, last.since(first), standing);
    }
    let mut noise = settled.stationary.noise_at_rest(&class);
    // What the settings say of the unit counts: what the log shows has the vehicle's rocking in it.
    if config.imu.grade.is_some() {
        noise = class;
    }
    if config.noise.gyro_arw_deg_per_sqrt_hour.is_some() {
        noise.gyro_white = class.gyro_white;
    }
    if config.noise.accel_vrw_m_per_s_per_sqrt_hour.is_some() {
        noise.accel_white = class.accel_white;
    }

    let mut options = AlignmentOptions {
        method: request.method,
        heading: request
            .heading_deg
            .map(|[heading, sigma]| (heading.to_radians(), sigma.to_radians())),
        ..AlignmentOptions::new(position, noise)
    };
    if let Some(limit) = request.largest_azimuth_sigma_deg {
        options.largest_azimuth_sigma = limit.to_radians();
    }
    let (record, input) = record(source, origin)?;
    let windows: Vec<StopWindow> = stops
        .iter()
        .map(|[begin, end]| StopWindow {
            begin: Time::from_seconds(*begin),
            end: Time::from_seconds(*end),
        })
        .collect();
    let result = align(&record, &windows, &options)?;
    let levelled = result.method == AlignmentMethod::Levelling;
    if levelled && request.method == AlignmentMethod::Auto && request.heading_deg.is_none() {
        warnings.push(Warning {
            code: "azimuth_unobservable",
            message: format!("the heading is not found: {}", result.reason),
            remedy: "stand longer, turn the unit between stops, use better gyros, or give the heading (`--heading-deg` with `--heading-sigma-deg`); on a vehicle that rocks the log shows more noise than the unit has: state its class (`--set imu.grade=navigation`)"
                .into(),
        });
    }
    if !levelled && !result.observable[2] {
        warnings.push(Warning {
            code: "azimuth_unobservable",
            message: format!(
                "the heading has a standard deviation of {:.1}°",
                result.azimuth_sigma.to_degrees()
            ),
            remedy: "stand longer, turn the unit between stops, or use better gyros".into(),
        });
    }
    let given = Given {
        input,
        latitude_deg: position.latitude_deg(),
        latitude_source,
        noise: AlignNoise {
            grade: grade.name(),
            gyro_arw_deg_per_sqrt_hour: noise.gyro_white.to_degrees() * 60.0,
            accel_vrw_m_per_s_per_sqrt_hour: noise.accel_white * 60.0,
            gyro_bias_deg_per_hour: rounded(noise.gyro_bias_sigma.to_degrees() * 3600.0),
            accel_bias_mg: rounded(noise.accel_bias_sigma / STANDARD_GRAVITY * 1e3),
        },
        stops_proposed: proposed,
        warnings,
    };
    Ok(report(&result, &stops, given))
}

/// What was seen of the stop with this begin and end, if the method used it.
fn seen_in(result: &AlignmentResult, begin_s: f64, end_s: f64) -> Option<&CoreStop> {
    let middle = |stop: &&CoreStop| 0.5 * (stop.begin.seconds() + stop.end.seconds());
    let inside = |stop: &&CoreStop| (begin_s..=end_s).contains(&middle(stop));
    result.stops.iter().find(inside)
}

/// To ten digits: numbers of data sheets come back as they were stated.
fn rounded(x: f64) -> f64 {
    let scale = 10f64.powf(9.0 - x.abs().max(1e-300).log10().floor());
    (x * scale).round() / scale
}

/// Latitude and height: as given, of the settings, or of the fixes.
fn place(
    config: &Config,
    survey: &Survey,
    request: &AlignRequest,
) -> Result<(Geodetic, LatitudeSource), RunError> {
    let origin = config.output.origin;
    let height = origin.map_or(0.0, |[_, _, height]| height);
    if let Some(latitude) = request.latitude_deg {
        let place = Geodetic::from_degrees(latitude, 0.0, height);
        return Ok((place, LatitudeSource::Given));
    }
    if let Some([latitude, longitude, height]) = origin {
        let place = Geodetic::from_degrees(latitude, longitude, height);
        return Ok((place, LatitudeSource::Settings));
    }
    if let Some(latitude) = config.alignment.latitude_deg {
        let place = Geodetic::from_degrees(latitude, 0.0, height);
        return Ok((place, LatitudeSource::Settings));
    }
    let mut fixes: Vec<Geodetic> = survey.positions.iter().map(|p| p.position).collect();
    fixes.sort_by(|a, b| a.latitude.total_cmp(&b.latitude));
    match fixes.get(fixes.len() / 2) {
        Some(median) => Ok((*median, LatitudeSource::Fixes)),
        None => Err(RunError::NoLatitude),
    }
}

/// Stops that a run finds, cut to what has settled; the longest kind that there is.
fn proposals(
    source: &(impl Source + ?Sized),
    config: &Config,
    position: &Geodetic,
    survey: &Survey,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<[f64; 2]>, RunError> {
    let mut config = *config;
    let heard = !survey.positions.is_empty();
    if !config.gnss.used {
        // Gyros that feel the Earth turn are asked about the right place.
        config.output.origin = None;
        config.alignment.latitude_deg = Some(position.latitude_deg());
    }
    let options = RunOptions {
        ignore_clocks: true,
        ..RunOptions::default()
    };
    // Who can give the windows need not let a log begin with rest.
    let no_start = |error| match error {
        RunError::NoRest { .. } | RunError::Navigator(CoreError::NotStarted { .. }) => {
            RunError::NoStops { found: 0 }
        }
        other => other,
    };
    let plan = Plan::make(source, &config, &options).map_err(no_start)?;
    let run = plan.execute(source, &mut ()).map_err(no_start)?;
    let found = one_for_one(run.stops, heard);
    let trimmed = |stop: &StopReport| {
        let spare = 0.5 * (stop.end_s - stop.begin_s - LEAST_PROPOSAL);
        let trim = spare.clamp(LEAST_TRIM, TRIM);
        [stop.begin_s + trim, stop.end_s - trim]
    };
    let of = |least: f64| -> Vec<[f64; 2]> {
        let long = |s: &[f64; 2]| s[1] - s[0] >= least;
        found.iter().map(trimmed).filter(long).collect()
    };
    let mut stops = of(LEAST_PROPOSAL);
    if stops.is_empty() {
        stops = of(LEAST_LEVEL);
    }
    if stops.is_empty() {
        return Err(RunError::NoStops { found: found.len() });
    }
    let left = found.len() - stops.len();
    if left > 0 {
        warnings.push(Warning {
            code: "short_stops_left_out",
            message: format!("{left} of {} stops are too short to be used", found.len()),
            remedy: "give the windows yourself with `--stop` if they are one stop".into(),
        });
    }
    if !heard {
        warnings.push(Warning {
            code: "unconfirmed_stops",
            message: "stops are found by inertial data alone, which cannot tell standing from steady speed on a smooth way"
                .into(),
            remedy: "check them, and give them with `--stop`".into(),
        });
    }
    Ok(stops)
}

/// Pieces of one stop as one: a door, or somebody who gets in, breaks what the filter holds. Where receiver or wheels speak, the run
/// has judged that already; where nobody does, what has turned by less than half a degree and held again at once has not driven
/// off, and the fit tests it as a whole.
fn one_for_one(found: Vec<StopReport>, heard: bool) -> Vec<StopReport> {
    let mut stops: Vec<StopReport> = Vec::with_capacity(found.len());
    for next in found {
        match stops.last_mut() {
            Some(last)
                if !heard
                    && matches!(last.ended_by, StopEnd::Motion | StopEnd::Contradicted)
                    && next.begin_s - last.end_s < SHORT_BREAK
                    && last.turn_until_deg(&next).abs() < TURNED_DEG =>
            {
                last.join(&next);
            }
            _ => stops.push(next),
        }
    }
    stops
}

/// The inertial data, stamped from the log's zero on.
fn record(
    source: &(impl Source + ?Sized),
    origin: Time,
) -> Result<(Record, &'static str), RunError> {
    let mut builder = IncrementBuilder::default();
    let mut increments = Vec::new();
    let mut input = "rates";
    for sample in source.samples()? {
        let sample = sample?;
        if sample.check().is_err() {
            continue;
        }
        let later = builder
            .time()
            .is_none_or(|last| Time(sample.time().0 - origin.0) > last);
        let increment = match sample {
            Sample::Imu(mut s) if later => {
                s.time = Time(s.time.0 - origin.0);
                builder.push(&s)
            }
            Sample::ImuIncrement(mut s) if later => {
                input = "increments";
                s.time = Time(s.time.0 - origin.0);
                builder.push_increment(&s)
            }
            _ => None,
        };
        increments.extend(increment);
    }
    Ok((Record::new(increments), input))
}

/// What went into an alignment.
struct Given {
    input: &'static str,
    latitude_deg: f64,
    latitude_source: LatitudeSource,
    noise: AlignNoise,
    stops_proposed: bool,
    warnings: Vec<Warning>,
}

fn report(result: &AlignmentResult, stops: &[[f64; 2]], given: Given) -> AlignReport {
    let euler = result.euler();
    let sigma = result.sigma();
    let found = result.method != AlignmentMethod::Levelling || result.azimuth.is_some();
    let three = |i: usize| [sigma[i], sigma[i + 1], sigma[i + 2]];
    let (sin, cos) = euler.heading.sin_cos();
    // Tilt errors about north and east as errors of roll and pitch (small pitch).
    let covariance = &result.covariance;
    let along = |a: f64, b: f64| {
        let variance = a * a * covariance[(0, 0)]
            + b * b * covariance[(1, 1)]
            + 2.0 * a * b * covariance[(0, 1)];
        variance.max(0.0).sqrt().to_degrees()
    };
    let level = euler.pitch.cos().abs().max(1e-3);
    let turns = |angle: f64| angle.to_degrees().rem_euclid(360.0);
    let [azimuth, north, east, down]: [f64; 4] = result.weakest.into();
    AlignReport {
        method: result.method.name(),
        reason: result.reason.clone(),
        input: given.input,
        latitude_deg: given.latitude_deg,
        latitude_source: given.latitude_source,
        noise: given.noise,
        at_s: result.at.seconds(),
        roll_deg: euler.roll.to_degrees(),
        sigma_roll_deg: along(cos, sin) / level,
        pitch_deg: euler.pitch.to_degrees(),
        sigma_pitch_deg: along(-sin, cos),
        heading_deg: found.then(|| turns(euler.heading)),
        sigma_heading_deg: result.azimuth_sigma.to_degrees().min(180.0),
        azimuth_deg: result.azimuth.map(turns),
        azimuth_at_s: result
            .azimuth
            .and(result.stops.first())
            .map(|stop| stop.begin.seconds()),
        gyro_bias_rad_per_s: result.gyro_bias.into(),
        sigma_gyro_bias_rad_per_s: three(3),
        accel_bias_m_per_s2: result.accel_bias.into(),
        sigma_accel_bias_m_per_s2: three(6),
        covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])),
        observable: {
            let o = result.observable;
            Observable {
                attitude: [o[0], o[1], o[2]],
                gyro_bias: [o[3], o[4], o[5]],
                accel_bias: [o[6], o[7], o[8]],
            }
        },
        weakest_direction: WeakestDirection {
            azimuth,
            drift_ned: [north, east, down],
        },
        geometry_ratio: result.geometry_ratio,
        norm_residual: result.norm_residual,
        nis_ratio: result.nis_ratio,
        stops: stops
            .iter()
            .map(|[begin_s, end_s]| AlignedStop {
                begin_s: *begin_s,
                end_s: *end_s,
                seen: seen_in(result, *begin_s, *end_s).map(|stop| SeenStop {
                    residual_rate_ned_rad_per_s: stop.residual_rate_n.into(),
                    sigma_rate_rad_per_s: stop.sigma_rate.into(),
                    rocking_rms_deg: stop.rocking_rms.map(f64::to_degrees).into(),
                    rocking_period_s: stop.rocking_period_s,
                    velocity_rms_m_per_s: stop.velocity_rms,
                    taper: match stop.taper {
                        Taper::None => "none",
                        Taper::HannSquared => "hann_squared",
                    },
                    half_disagreement_sigma: stop.half_disagreement,
                }),
            })
            .collect(),
        stops_proposed: given.stops_proposed,
        warnings: given.warnings,
        result: result.clone(),
    }
}
