//! The noise of a log's sensors: Allan deviation at rest, autocovariance least squares over all of it, and a block of settings.

use super::noise_block::{Told, block};
use super::noise_readings::{NoiseReadings, noise_readings};
use super::plan::{Plan, RunOptions};
use super::report::Warning;
use super::source::Source;
use super::survey::Survey;
use super::{RunError, oddities};
use crate::findings;
use insnav_core::config::Config;
use insnav_core::imu::ImuGrade;
use insnav_core::noise::{
    AllanTerm, AxisStability, IdentifyOptions, Known, LARGEST_CHI2_PER_DOF, NoiseReading,
    RecordNoise, Refusal, RestStability, identify_noise, rest_stability,
};
use insnav_core::noise_floor::NoiseFloor;
use serde::Serialize;

/// Rest shorter than this has no Allan deviation that is worth the name, s.
const LEAST_REST: f64 = 20.0;
/// Breaks of a rest up to this are looked at, s, against so much on both sides; what stays within so many sigmas is nothing.
const SHORT_BREAK: f64 = 4.0;
const AROUND: f64 = 5.0;
const QUIET_SIGMAS: f64 = 6.0;
/// Averaging times up to this tell flicker noise and random walk of common units, s.
const TELLING_TAU: f64 = 100.0;
/// An averaging time needs so many times itself.
const TAUS_OF_RECORD: f64 = 4.0;

/// What is asked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoiseRequest {
    /// A part of the log that is looked at alone, and that counts as rest, s after the log's zero.
    pub part: Option<[f64; 2]>,
    /// Length of a window for least squares, s.
    pub window_s: Option<f64>,
}

/// The noise of a log.
#[derive(Clone, Debug, Serialize)]
pub struct LogNoise {
    /// Inertial samples that were looked at.
    pub samples: usize,
    /// The usual step between them, s.
    pub step_s: f64,
    /// Class that what is not seen is taken from.
    pub grade: &'static str,
    /// Deviations by averaging time.
    pub allan: Allan,
    /// Fits to them.
    pub fit: Option<Fits>,
    /// Least squares.
    pub als: Als,
    /// `[noise]` for the settings.
    pub config: String,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

/// Allan deviations over a stretch at rest.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Allan {
    /// Begin of the stretch, s after the log's zero.
    pub begin_s: Option<f64>,
    /// Its end.
    pub end_s: Option<f64>,
    /// Why there is none, or which averaging times are missing.
    pub missing: Option<String>,
    /// Gyros.
    pub gyro: Vec<GyroDeviation>,
    /// Accelerometers.
    pub accel: Vec<AccelDeviation>,
}

/// Of the gyros, at one averaging time, by axis.
#[derive(Clone, Debug, Serialize)]
pub struct GyroDeviation {
    /// Averaging time.
    pub tau_s: f64,
    /// Deviation.
    pub deviation_rad_per_s: [f64; 3],
    /// Lower end of its interval of two sigmas.
    pub lower_rad_per_s: [f64; 3],
    /// Upper end.
    pub upper_rad_per_s: [f64; 3],
    /// Deviation of the fit.
    pub fit_rad_per_s: [f64; 3],
}

/// Of the accelerometers.
#[derive(Clone, Debug, Serialize)]
pub struct AccelDeviation {
    /// Averaging time.
    pub tau_s: f64,
    /// Deviation.
    pub deviation_m_per_s2: [f64; 3],
    /// Lower end of its interval of two sigmas.
    pub lower_m_per_s2: [f64; 3],
    /// Upper end.
    pub upper_m_per_s2: [f64; 3],
    /// Deviation of the fit.
    pub fit_m_per_s2: [f64; 3],
}

/// A number and its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WithError {
    /// The number.
    pub value: f64,
    /// One sigma; of a number that is zero an upper limit.
    pub standard_error: f64,
}

impl From<AllanTerm> for WithError {
    fn from(t: AllanTerm) -> Self {
        WithError {
            value: t.value,
            standard_error: t.standard_error,
        }
    }
}

/// Fits to the Allan deviations, by axis.
#[derive(Clone, Debug, Serialize)]
pub struct Fits {
    /// Gyros, x, y, z.
    pub gyro: Vec<GyroFit>,
    /// Accelerometers.
    pub accel: Vec<AccelFit>,
}

/// Of a gyro.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct GyroFit {
    /// N, angle random walk.
    pub white_rad_per_sqrt_s: WithError,
    /// B, bias instability.
    pub flicker_rad_per_s: WithError,
    /// K, rate random walk.
    pub random_walk_rad_per_s_per_sqrt_s: WithError,
    /// What the fit leaves.
    pub chi2: f64,
    /// Averaging times less coefficients.
    pub dof: usize,
    /// The shortest averaging time that was used.
    pub from_tau_s: f64,
}

/// Of an accelerometer.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct AccelFit {
    /// N, velocity random walk.
    pub white_m_per_s_per_sqrt_s: WithError,
    /// B, bias instability.
    pub flicker_m_per_s2: WithError,
    /// K, acceleration random walk.
    pub random_walk_m_per_s2_per_sqrt_s: WithError,
    /// What the fit leaves.
    pub chi2: f64,
    /// Averaging times less coefficients.
    pub dof: usize,
    /// The shortest averaging time that was used.
    pub from_tau_s: f64,
}

/// A number as identified, or as known before.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identified {
    /// The number.
    pub value: f64,
    /// One sigma.
    pub standard_error: Option<f64>,
    /// Whether the log tells it; else it is what was known before.
    pub accepted: bool,
    /// Why, or why not.
    pub reason: String,
}

impl From<&Known> for Identified {
    fn from(k: &Known) -> Self {
        Identified {
            value: k.value,
            standard_error: k.standard_error.is_finite().then_some(k.standard_error),
            accepted: k.accepted,
            reason: k.reason.clone(),
        }
    }
}

/// Standard errors of the variances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct VarianceErrors {
    /// Of `q`.
    pub q: Option<f64>,
    /// Of `r`.
    pub r: Option<f64>,
}

/// Noise by least squares.
#[derive(Clone, Debug, Serialize)]
pub struct Als {
    /// Variance that an attitude angle gains in a step by the gyros' noise, rad².
    pub q: f64,
    /// Variance of one angle that the accelerometers tell, rad².
    pub r: f64,
    /// Their standard errors.
    pub standard_error: VarianceErrors,
    /// What the model leaves of the lag covariances.
    pub chi2: Option<f64>,
    /// Lag covariances less unknowns.
    pub dof: usize,
    /// Whether both q and r are told by the log.
    pub accepted: bool,
    /// Why, or why not.
    pub reason: String,
    /// White noise of the gyros.
    pub gyro_white_rad_per_sqrt_s: Identified,
    /// White noise of the tilt that accelerometers tell.
    pub tilt_white_rad_sqrt_s: Identified,
    /// The same as noise of the accelerometers.
    pub accel_white_m_per_s_per_sqrt_s: Identified,
    /// How far each body axis was horizontal in the windows that were used: only then its noise is seen.
    pub axes_seen: [f64; 3],
    /// Random walk of the gyro bias.
    pub gyro_bias_walk_rad_per_s_per_sqrt_s: Identified,
    /// Magnetometer.
    pub heading: Option<AlsHeading>,
    /// Length of a window, s.
    pub window_s: f64,
    /// Samples averaged into one.
    pub averaged: usize,
    /// Lags.
    pub lags: usize,
    /// Lines in the spectrum of the accelerometers that were taken out, Hz.
    pub tones_hz: Vec<f64>,
    /// Windows that were used, joined, s after the log's zero.
    pub accepted_intervals_s: Vec<[f64; 2]>,
    /// All windows.
    pub windows: Vec<AlsWindow>,
}

/// Noise of the magnetometer by least squares.
#[derive(Clone, Debug, Serialize)]
pub struct AlsHeading {
    /// White noise of the magnetic heading.
    pub heading_white_rad_sqrt_s: Identified,
    /// White noise of one sample of the magnetometer.
    pub magnetometer_microtesla: Identified,
    /// What the model leaves.
    pub chi2: Option<f64>,
    /// Lag covariances less unknowns.
    pub dof: usize,
    /// Windows that were used.
    pub windows: usize,
}

/// A window.
#[derive(Clone, Debug, Serialize)]
pub struct AlsWindow {
    /// Begin, s after the log's zero.
    pub begin_s: f64,
    /// End.
    pub end_s: f64,
    /// White noise of the gyros in this window.
    pub gyro_white_rad_per_sqrt_s: Option<f64>,
    /// White noise of the tilt.
    pub tilt_white_rad_sqrt_s: Option<f64>,
    /// χ² by degree of freedom.
    pub chi2_per_dof: Option<f64>,
    /// Whether it was used.
    pub accepted: bool,
    /// Why, or why not.
    pub reason: String,
}

/// Identify the noise of a log's gyros, accelerometers and magnetometer.
///
/// # Errors
/// Those of reading, `NoImu`, and `Noise` with the core's refusal.
pub fn identify_log_noise(
    source: &(impl Source + ?Sized),
    config: &Config,
    request: &NoiseRequest,
) -> Result<LogNoise, RunError> {
    source.check()?;
    let survey = Survey::of(source)?;
    let mut config = *config;
    config.gnss.used &= !survey.positions.is_empty();
    config.validate().map_err(RunError::from)?;
    let (first, last) = survey.imu_span.ok_or(RunError::NoImu)?;
    let origin = source.origin()?.unwrap_or(first);
    let facts = source.facts()?;
    oddities::refuse_fatal(&findings::of_topics(&facts, origin))?;
    let mut warnings: Vec<Warning> = facts.recovered.into_iter().collect();
    if let Some([from, to]) = request.part
        && !(from < last.since(origin) && to > first.since(origin))
    {
        return Err(RunError::PartOutside {
            from,
            to,
            imu_begin: first.since(origin),
            imu_end: last.since(origin),
        });
    }
    let NoiseReadings {
        readings,
        dropped,
        fields_dropped,
    } = noise_readings(source, origin, request.part)?;
    if dropped > 0 {
        warnings.push(Warning {
            code: "samples_left_out",
            message: format!("{dropped} inertial samples are not finite or not in the order of time, and left out"),
            remedy: "check the driver that gives them, and with `insnav info` the clocks".into(),
        });
    }
    if fields_dropped > 0 {
        warnings.push(Warning {
            code: "fields_left_out",
            message: format!("{fields_dropped} magnetic fields are not finite or belong to no inertial sample, and are left out"),
            remedy: "a magnetometer faster than the inertial unit is used at the unit's rate; else check the clocks with `insnav info`".into(),
        });
    }
    if readings.is_empty() {
        return Err(RunError::NoImu);
    }
    let grade = config.imu.grade.unwrap_or_else(|| {
        survey
            .noise_floor
            .as_ref()
            .map_or(ImuGrade::Consumer, NoiseFloor::grade)
    });
    let prior = config.noise.over(grade);
    let options = IdentifyOptions {
        window_s: request.window_s,
        ..IdentifyOptions::new(prior)
    };
    let found = identify_noise(&readings, &options).map_err(RunError::Noise)?;
    let rest = at_rest(source, &config, request, &readings, &mut warnings);
    let (allan, stability) = allan(&readings, rest);
    let told = Told {
        prior: &prior,
        grade: grade.name(),
        stated: config.noise,
        rest: stability.as_ref(),
        found: &found,
    };
    let config = block(&told);
    Ok(LogNoise {
        samples: found.samples,
        step_s: found.step_s,
        grade: grade.name(),
        fit: stability.as_ref().map(fits),
        allan,
        als: als(&found),
        config,
        warnings,
    })
}

/// The longest stretch at rest: as asked for, else as a run finds it.
fn at_rest(
    source: &(impl Source + ?Sized),
    config: &Config,
    request: &NoiseRequest,
    readings: &[NoiseReading],
    warnings: &mut Vec<Warning>,
) -> Result<[f64; 2], String> {
    if let Some(part) = request.part {
        return Ok(part);
    }
    let heard = config.gnss.used;
    let options = RunOptions {
        ignore_clocks: true,
        ..RunOptions::default()
    };
    let run = Plan::make(source, config, &options).and_then(|plan| plan.execute(source, &mut ()));
    let run = match run {
        Ok(run) => run,
        Err(error) => return Err(format!("no rest was found: {error}")),
    };
    let mut rests: Vec<[f64; 2]> = Vec::new();
    for stop in &run.stops {
        match rests.last_mut() {
            Some(last) if quiet_between(readings, last[1], stop.begin_s) => last[1] = stop.end_s,
            _ => rests.push([stop.begin_s, stop.end_s]),
        }
    }
    let length = |rest: &[f64; 2]| rest[1] - rest[0];
    let longest = rests
        .into_iter()
        .max_by(|a, b| length(a).total_cmp(&length(b)));
    let span = match readings {
        [first, .., last] => last.time.since(first.time),
        _ => 0.0,
    };
    match longest {
        None => Err("the log has no rest".into()),
        Some(rest) if length(&rest) < LEAST_REST => Err(format!(
            "the longest rest lasts {:.1} s, from {:.1} s on, and {LEAST_REST} s are needed",
            length(&rest),
            rest[0]
        )),
        Some(rest) => {
            if !heard && length(&rest) < 0.5 * span {
                warnings.push(Warning {
                    code: "unconfirmed_stops",
                    message: "the rest is found by inertial data alone, which cannot tell it from steady speed on a smooth way".into(),
                    remedy: "check it, and give it with `--from` and `--to`".into(),
                });
            }
            Ok(rest)
        }
    }
}

/// Whether a short break between two stops shows nothing that they do not: detectors let go of a noisy unit now and then.
fn quiet_between(readings: &[NoiseReading], end: f64, begin: f64) -> bool {
    if begin - end > SHORT_BREAK {
        return false;
    }
    let at = |t: f64| readings.partition_point(|r| r.time.seconds() < t);
    let of = |r: &NoiseReading| {
        let (w, f) = (r.angular_rate_b, r.specific_force_b);
        [w.x, w.y, w.z, f.x, f.y, f.z]
    };
    let (before, after) = (at(end - AROUND)..at(end), at(begin)..at(begin + AROUND));
    let around: Vec<[f64; 6]> = before.chain(after).map(|i| of(&readings[i])).collect();
    let inside = &readings[at(end)..at(begin)];
    let count = around.len() as f64;
    (0..6).all(|k| {
        let mean = around.iter().map(|v| v[k]).sum::<f64>() / count;
        let variance = around.iter().map(|v| (v[k] - mean).powi(2)).sum::<f64>() / count;
        inside
            .iter()
            .all(|r| (of(r)[k] - mean).abs() <= QUIET_SIGMAS * variance.sqrt())
    })
}

fn allan(
    readings: &[NoiseReading],
    rest: Result<[f64; 2], String>,
) -> (Allan, Option<RestStability>) {
    let without = |missing: String| {
        let missing = Some(missing);
        (
            Allan {
                missing,
                ..Allan::default()
            },
            None,
        )
    };
    let [begin, end] = match rest {
        Ok(rest) => rest,
        Err(why) => return without(format!("{why}: no averaging time is told")),
    };
    let inside = |t: f64| (begin..=end).contains(&t);
    let at_rest: Vec<NoiseReading> = readings
        .iter()
        .copied()
        .filter(|r| inside(r.time.seconds()))
        .collect();
    let stability = match rest_stability(&at_rest) {
        Ok(stability) => stability,
        Err(refusal) => {
            return without(format!("the rest from {begin:.1} to {end:.1} s: {refusal}"));
        }
    };
    let span = stability.end.since(stability.begin);
    let longest = span / TAUS_OF_RECORD;
    let missing = (longest < TELLING_TAU).then(|| {
        format!(
            "averaging times from {longest:.0} to {TELLING_TAU:.0} s, which tell flicker noise and random walk: they need {:.0} s at rest",
            TELLING_TAU * TAUS_OF_RECORD
        )
    });
    let rows = |axes: &[AxisStability; 3]| -> Vec<(f64, [[f64; 3]; 4])> {
        (0..axes[0].points.len())
            .map(|i| {
                let mut row = [[0.0; 3]; 4];
                for (k, axis) in axes.iter().enumerate() {
                    let point = &axis.points[i];
                    let (lower, upper) = point.interval(&axis.fit, 2.0);
                    row[0][k] = point.deviation;
                    row[1][k] = lower;
                    row[2][k] = upper;
                    row[3][k] = axis.fit.deviation(point.tau_s);
                }
                (axes[0].points[i].tau_s, row)
            })
            .collect()
    };
    let allan = Allan {
        begin_s: Some(stability.begin.seconds()),
        end_s: Some(stability.end.seconds()),
        missing,
        gyro: rows(&stability.gyro)
            .into_iter()
            .map(|(tau_s, [deviation, lower, upper, fit])| GyroDeviation {
                tau_s,
                deviation_rad_per_s: deviation,
                lower_rad_per_s: lower,
                upper_rad_per_s: upper,
                fit_rad_per_s: fit,
            })
            .collect(),
        accel: rows(&stability.accel)
            .into_iter()
            .map(|(tau_s, [deviation, lower, upper, fit])| AccelDeviation {
                tau_s,
                deviation_m_per_s2: deviation,
                lower_m_per_s2: lower,
                upper_m_per_s2: upper,
                fit_m_per_s2: fit,
            })
            .collect(),
    };
    (allan, Some(stability))
}

fn fits(stability: &RestStability) -> Fits {
    Fits {
        gyro: stability
            .gyro
            .iter()
            .map(|axis| GyroFit {
                white_rad_per_sqrt_s: axis.fit.white.into(),
                flicker_rad_per_s: axis.fit.flicker.into(),
                random_walk_rad_per_s_per_sqrt_s: axis.fit.random_walk.into(),
                chi2: axis.fit.chi2,
                dof: axis.fit.dof,
                from_tau_s: axis.fit.from_tau_s,
            })
            .collect(),
        accel: stability
            .accel
            .iter()
            .map(|axis| AccelFit {
                white_m_per_s_per_sqrt_s: axis.fit.white.into(),
                flicker_m_per_s2: axis.fit.flicker.into(),
                random_walk_m_per_s2_per_sqrt_s: axis.fit.random_walk.into(),
                chi2: axis.fit.chi2,
                dof: axis.fit.dof,
                from_tau_s: axis.fit.from_tau_s,
            })
            .collect(),
    }
}

fn als(found: &RecordNoise) -> Als {
    let step = found.step_s;
    let tilt = &found.tilt;
    let (q, r) = (
        tilt.gyro_white.value.powi(2) * step,
        tilt.tilt_white.value.powi(2) / step,
    );
    // d(σ²) = 2 σ dσ
    let error = |known: &Known, scale: f64| {
        known
            .accepted
            .then_some(2.0 * known.value * known.standard_error * scale)
    };
    let finite = |x: f64| x.is_finite().then_some(x);
    let reason = if tilt.gyro_white.accepted {
        &tilt.tilt_white.reason
    } else {
        &tilt.gyro_white.reason
    };
    let microtesla = |known: &Known| {
        let mut identified = Identified::from(known);
        identified.value *= 1e6;
        identified.standard_error = identified.standard_error.map(|e| e * 1e6);
        identified
    };
    Als {
        q,
        r,
        standard_error: VarianceErrors {
            q: error(&tilt.gyro_white, step),
            r: error(&tilt.tilt_white, 1.0 / step),
        },
        chi2: finite(tilt.chi2),
        dof: tilt.dof,
        accepted: tilt.gyro_white.accepted && tilt.tilt_white.accepted,
        reason: reason.clone(),
        gyro_white_rad_per_sqrt_s: (&tilt.gyro_white).into(),
        tilt_white_rad_sqrt_s: (&tilt.tilt_white).into(),
        accel_white_m_per_s_per_sqrt_s: (&tilt.accel_white).into(),
        axes_seen: tilt.axes_seen,
        gyro_bias_walk_rad_per_s_per_sqrt_s: (&found.gyro_bias.wander).into(),
        heading: found.heading.as_ref().map(|h| AlsHeading {
            heading_white_rad_sqrt_s: (&h.heading_white).into(),
            magnetometer_microtesla: microtesla(&h.magnetometer),
            chi2: finite(h.chi2),
            dof: h.dof,
            windows: h.windows,
        }),
        window_s: found.window_s,
        averaged: found.averaged,
        lags: found.lags,
        tones_hz: found.tones_hz.clone(),
        accepted_intervals_s: found
            .accepted_intervals()
            .into_iter()
            .map(|(begin, end)| [begin.seconds(), end.seconds()])
            .collect(),
        windows: found
            .windows
            .iter()
            .map(|w| AlsWindow {
                begin_s: w.begin.seconds(),
                end_s: w.end.seconds(),
                gyro_white_rad_per_sqrt_s: finite(w.gyro_white[0]),
                tilt_white_rad_sqrt_s: finite(w.tilt_white[0]),
                chi2_per_dof: finite(w.chi2_per_dof),
                accepted: w.accepted,
                reason: w.reason.clone(),
            })
            .collect(),
    }
}

/// Whether an Allan fit can be believed.
pub(super) fn fits_well(axis: &AxisStability) -> bool {
    axis.fit.chi2 <= LARGEST_CHI2_PER_DOF * axis.fit.dof.max(1) as f64
}

/// A short name of a refusal, for programs.
pub(super) fn code(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::UnevenSteps { .. } => "uneven_steps",
        Refusal::Axis { why, .. } => code(why),
        Refusal::Flat { .. } | Refusal::Repeats { .. } => "flat_channel",
        Refusal::Saturated { .. } => "saturated_channel",
        Refusal::NotFinite { .. } => "not_finite",
        Refusal::Unstable { .. } | Refusal::NoStationaryFilter { .. } => "unstable_filter",
        Refusal::RankDeficient { .. } => "rank_deficient",
        Refusal::TooShort { .. } | Refusal::Shape { .. } => "too_short",
        _ => "noise_not_identifiable",
    }
}

/// What to do about a refusal.
pub(super) fn remedy(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::UnevenSteps { .. } => {
            "take the recorder's clock with `--time log`, or let the driver stamp with the sensor's; a part with even steps: `--from`, `--to`"
        }
        Refusal::Axis { why, .. } => remedy(why),
        Refusal::Flat { .. } | Refusal::Repeats { .. } => {
            "let the driver give full resolution and its own rate for each sensor, or choose another topic with `--topic imu=…`"
        }
        Refusal::Saturated { .. } => {
            "choose a larger range of the sensor, or leave these stretches out: `--from`, `--to`"
        }
        Refusal::TooShort { .. } | Refusal::Shape { .. } => {
            "give a longer recording or part, or a shorter `--window`"
        }
        _ => "give another part of the log with `--from` and `--to`, or a longer recording",
    }
}
