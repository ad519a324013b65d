//! Which windows show the noise of the sensors, and what they show together.

use super::regress::{ANGLE, BIAS, Channel, Fitted, MEASURED};
use super::steps::{ACCEL_AXES, GYRO_AXES, screen_axes, steps};
use super::turned::{self, Constant, Start, Turned};
use super::{BiasNoise, HeadingNoise, Known, NoiseReading, RecordNoise, TiltNoise, WindowNoise};
use crate::attitude::exp;
use crate::imu::{ImuNoise, STANDARD_GRAVITY};
use crate::noise::{LARGEST_CHI2_PER_DOF, Refusal, attitude_differences};
use nalgebra::Vector3;
use std::format;
use std::ops::Range;
use std::string::{String, ToString};
use std::vec::Vec;

/// Length of a window where nothing else is asked for, s: shorter ones tell little, longer ones are seldom free of acceleration.
const WINDOW: f64 = 20.0;
/// Or so many time constants of the best filter, up to so long: below, a window tells no more of the gyros than an upper limit.
const WINDOW_TIME_CONSTANTS: f64 = 40.0;
const LONGEST_WINDOW: f64 = 60.0;
/// Samples are averaged until the filter's time constant is so many steps: averages are exact, and lags reach further.
const STEPS_OF_TIME_CONSTANT: f64 = 10.0;
/// But a window keeps so many.
const LEAST_STEPS: usize = 240;
/// Samples without which there is no window.
const LEAST_SAMPLES: usize = 60;
/// The mean specific force of a window without acceleration is gravity, to this share.
const GRAVITY_OFF: f64 = 0.1;
/// Innovations with more excess kurtosis than this, plus so many of its standard errors, come in bursts.
const MOST_KURTOSIS: f64 = 1.0;
const KURTOSIS_SIGMAS: f64 = 4.0;
/// A window shows more gyro noise than the quietest ones by more than this many sigmas: motion.
const CONSISTENT: f64 = 3.0;
/// The first stretch of a window that is linearised, s; then twice as much each time.
const FIRST_STRETCH: f64 = 5.0;
/// A window whose start still changes by more than this with the last fit is not understood, rad.
const SETTLED: f64 = 0.01;

/// Settings of [`identify_noise`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdentifyOptions {
    /// What is known of the unit: kept where the record tells nothing, and used for the wander of its gyro bias.
    pub prior: ImuNoise,
    /// Length of a window, s; `None`: by the noise itself, 20 to 60 s.
    pub window_s: Option<f64>,
    /// Most lags, J.
    pub lags: usize,
    /// How often a window is filtered, each time with the gain of the estimate before.
    pub rounds: usize,
}

impl IdentifyOptions {
    /// Usual settings for a unit of which this is known beforehand.
    pub fn new(prior: ImuNoise) -> Self {
        IdentifyOptions {
            prior,
            window_s: None,
            lags: 64,
            rounds: 3,
        }
    }
}

/// A window on its way.
struct Window {
    range: Range<usize>,
    start: Start,
    data: Option<Turned>,
    fitted: Option<Fitted>,
    reason: Option<String>,
}

/// Identify the noise of gyros, accelerometers and magnetometer from a record at rest or on the move.
///
/// White noise of the gyros (q) and of the angles that the other sensors tell (r), by autocovariance least squares over windows in
/// axes that stand still. A window goes into the estimate if the model fits its lag covariances (χ² at most
/// [`LARGEST_CHI2_PER_DOF`] by degree of freedom, innovations without bursts) and if it does not show more gyro noise than the
/// quietest windows do: unmodelled acceleration is left out, not taken up. Where no window does, what was known is kept and the reason is told.
///
/// # Errors
/// [`Refusal::UnevenSteps`], [`Refusal::Axis`] for an axis that is flat, too coarse, at the end of its range or not finite,
/// [`Refusal::Shape`] for a record without a window, [`Refusal::Setting`].
pub fn identify_noise(
    record: &[NoiseReading],
    options: &IdentifyOptions,
) -> Result<RecordNoise, Refusal> {
    let steps = steps(record)?;
    screen_axes(record, |r| r.angular_rate_b, GYRO_AXES)?;
    screen_axes(record, |r| r.specific_force_b, ACCEL_AXES)?;
    let step = steps.step_s;
    if let Some(window) = options.window_s
        && !(window.is_finite() && window >= LEAST_SAMPLES as f64 * step)
    {
        return Err(Refusal::Setting {
            what: "window, s",
            value: window,
            expected: "at least sixty samples long",
        });
    }
    let mut length = options.window_s.unwrap_or(WINDOW);
    let mut windows = cut(&steps.pieces, length / step);
    if windows.is_empty() {
        let longest = steps.pieces.iter().map(Range::len).max().unwrap_or(0);
        return Err(Refusal::Shape {
            what: "longest piece without a gap",
            found: format!("{longest} samples"),
            expected: format!("at least {}, half a window", (0.5 * length / step).ceil()),
        });
    }
    let prior = options.prior;
    let prior_q = prior.gyro_white.powi(2) * step;
    windows
        .iter_mut()
        .for_each(|w| linearise(w, record, step, prior_q));
    let mut start = differences(&windows, record, step, prior_q);
    if options.window_s.is_none() {
        let wanted = (WINDOW_TIME_CONSTANTS * time_constant(&start) * step).min(LONGEST_WINDOW);
        if wanted > 1.2 * length {
            length = wanted;
            let longer = cut(&steps.pieces, length / step);
            if !longer.is_empty() {
                windows = longer;
                windows
                    .iter_mut()
                    .for_each(|w| linearise(w, record, step, prior_q));
                start = differences(&windows, record, step, prior_q);
            }
        }
    }
    let shortest = windows.iter().map(|w| w.range.len()).min().unwrap_or(0);
    let averaged = averaging(&start, shortest);
    let block = averaged as f64 * step;
    let lags = options.lags.min(shortest / averaged / 4).max(4);
    let channel = Channel::new(block, lags, options.rounds.max(1));
    let wander = prior.gyro_bias_sigma * (2.0 / prior.gyro_bias_tau).sqrt();
    let begin = [
        start[0] * averaged as f64,
        wander * wander * block,
        start[1] / averaged as f64,
    ];
    for window in &mut windows {
        if window.reason.is_none() {
            let turned = turned::tilts(&record[window.range.clone()], &window.start);
            window.data = turned::average(&turned, averaged);
            judge(window, &channel, begin);
        }
    }
    let mut reasons: Vec<Option<String>> = windows.iter().map(|w| w.reason.clone()).collect();
    let fits: Vec<Option<&Fitted>> = windows.iter().map(|w| w.fitted.as_ref()).collect();
    keep_the_quietest(&fits, &mut reasons);
    let used: Vec<usize> = (0..windows.len())
        .filter(|i| reasons[*i].is_none())
        .collect();
    let data: Vec<&Turned> = used
        .iter()
        .filter_map(|i| windows[*i].data.as_ref())
        .collect();
    let pooled = pool(&channel, &data, begin);
    let gravity =
        used.iter().map(|i| windows[*i].start.gravity).sum::<f64>() / used.len().max(1) as f64;
    let (gyro_white, tilt_white, chi2, dof) = noises(&pooled, block, &why_none(&reasons), "tilt");
    let tilt_prior = prior.accel_white / STANDARD_GRAVITY;
    let tilt = TiltNoise {
        gyro_white: gyro_white.or(prior.gyro_white),
        accel_white: tilt_white.clone().scaled(gravity).or(prior.accel_white),
        tilt_white: tilt_white.or(tilt_prior),
        chi2,
        dof,
    };
    let gyro_bias = BiasNoise {
        prior: wander,
        wander: bias_noise(&channel, &data, &pooled, begin, block).or(wander),
    };
    let heading = heading(record, &windows, options, step, &tilt)?;
    let windows = windows
        .iter()
        .zip(&reasons)
        .map(|(window, reason)| describe(window, reason, record, block))
        .collect();
    Ok(RecordNoise {
        step_s: step,
        samples: record.len(),
        pieces: steps.pieces.len(),
        window_s: length,
        averaged,
        lags,
        tilt,
        heading,
        gyro_bias,
        windows,
    })
}

/// Windows of about so many samples that fill the pieces.
fn cut(pieces: &[Range<usize>], samples: f64) -> Vec<Window> {
    let mut windows = Vec::new();
    for piece in pieces {
        let n = piece.len();
        if n < LEAST_SAMPLES || (n as f64) < 0.5 * samples {
            continue;
        }
        let count = ((n as f64 / samples) as usize).max(1);
        for k in 0..count {
            windows.push(Window {
                range: piece.start + k * n / count..piece.start + (k + 1) * n / count,
                start: Start {
                    attitude: nalgebra::UnitQuaternion::identity(),
                    gyro_bias: Vector3::zeros(),
                    gravity: f64::NAN,
                    field: None,
                },
                data: None,
                fitted: None,
                reason: None,
            });
        }
    }
    windows
}

/// Steps after which the best filter has forgotten a sample.
fn time_constant([q, r]: &[f64; 2]) -> f64 {
    (r / q.max(f64::MIN_POSITIVE)).sqrt().clamp(1.0, 1e6)
}

fn averaging(start: &[f64; 2], shortest: usize) -> usize {
    let wanted = time_constant(start) / STEPS_OF_TIME_CONSTANT;
    (wanted as usize).clamp(1, (shortest / LEAST_STEPS).max(1))
}

/// Half the mean square of first differences: the measurement's noise, nearly all of it.
fn measured_noise(series: &[Vec<f64>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for pair in series.iter().flat_map(|s| s.windows(2)) {
        let d = pair[1] - pair[0];
        if d.is_finite() {
            sum += d * d;
            count += 1.0;
        }
    }
    0.5 * sum / f64::max(count, 1.0)
}

/// Find attitude and gyro bias of a window's begin, in stretches that grow.
fn linearise(window: &mut Window, record: &[NoiseReading], step: f64, prior_q: f64) {
    let readings = &record[window.range.clone()];
    let mut start = turned::level(readings);
    if !((start.gravity / STANDARD_GRAVITY - 1.0).abs() <= GRAVITY_OFF) {
        window.reason = Some(format!(
            "the mean specific force is {:.2} m/s², not gravity",
            start.gravity
        ));
        window.start = start;
        return;
    }
    let mut stretch =
        ((FIRST_STRETCH / step) as usize).clamp(LEAST_SAMPLES, readings.len().max(LEAST_SAMPLES));
    let mut last = f64::INFINITY;
    let mut repeated = 0;
    loop {
        let part = &readings[..stretch.min(readings.len())];
        let averaged = (part.len() / 200).max(1);
        let Some(data) = turned::average(&turned::tilts(part, &start), averaged) else {
            break;
        };
        let noise = measured_noise(&data.channels).max(f64::MIN_POSITIVE);
        let theta = [prior_q * averaged as f64, 1e-9 * prior_q, noise];
        let channel = Channel::new(averaged as f64 * step, 4, 1);
        let Ok(filter) = channel.filter(&theta) else {
            break;
        };
        let residuals = channel.residuals(&data, &theta, &filter);
        let mut tilt = Vector3::zeros();
        let mut bias = Vector3::zeros();
        for (what, value) in residuals.constants {
            match what {
                Constant::Begin(k) => tilt[k] = value,
                Constant::GyroBias(k) => bias[k] = value,
                Constant::OtherBias(_) | Constant::Delay => {}
            }
        }
        // Further than this no linear fit is to be believed at once.
        let limited = |v: Vector3<f64>, most: f64| v * (most / v.norm().max(most));
        start.attitude = exp(&limited(tilt, 0.5)) * start.attitude;
        start.gyro_bias += limited(bias, 0.1);
        last = tilt.norm().max(bias.norm() * part.len() as f64 * step);
        if stretch < readings.len() {
            stretch *= 2;
        } else {
            repeated += 1;
            if last < 0.1 * SETTLED || repeated >= 4 {
                break;
            }
        }
    }
    if !(last < SETTLED) {
        window.reason = Some("the attitude that the gyros carry does not stay level: acceleration, or a gyro that saturates".to_string());
    }
    window.start = start;
}

/// Noise per sample by differences over several spans, of the quieter windows: (q, r).
fn differences(windows: &[Window], record: &[NoiseReading], step: f64, prior_q: f64) -> [f64; 2] {
    let mut found: Vec<[f64; 2]> = windows
        .iter()
        .filter(|w| w.reason.is_none())
        .filter_map(|w| {
            let data = turned::tilts(&record[w.range.clone()], &w.start);
            by_differences(&data, prior_q, step)
        })
        .collect();
    if found.is_empty() {
        return [prior_q, 1e-4];
    }
    let quarter = found.len() / 4;
    found.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
    let q = found[quarter][0];
    found.sort_unstable_by(|a, b| a[1].total_cmp(&b[1]));
    // Nothing seen is no zero: a hundredth of what is known, in variance.
    [q.max(0.01 * prior_q), found[quarter][1]]
}

fn by_differences(data: &Turned, prior_q: f64, step: f64) -> Option<[f64; 2]> {
    let r = measured_noise(&data.channels).max(f64::MIN_POSITIVE);
    let theta = [prior_q, 1e-9 * prior_q, r];
    let channel = Channel::new(step, 4, 1);
    let filter = channel.filter(&theta).ok()?;
    let residuals = channel.residuals(data, &theta, &filter);
    let mut sum = [0.0; 2];
    for (c, series) in data.channels.iter().enumerate() {
        let mut clean = series.clone();
        for (what, value) in &residuals.constants {
            let response = data.responses.iter().find(|r| r.what == *what)?;
            let column = &response.channels[c];
            clean
                .iter_mut()
                .zip(column)
                .for_each(|(y, h)| *y -= value * h);
        }
        let n = clean.len();
        let spans: Vec<usize> = (0..).map(|k| 1 << k).take_while(|s| s * 20 <= n).collect();
        let (q, r) = attitude_differences(&clean, &vec![0.0; n], &spans).ok()?;
        sum[0] += q;
        sum[1] += r;
    }
    Some(sum.map(|s| s / data.channels.len() as f64))
}

/// Fit one window and say what speaks against it.
fn judge(window: &mut Window, channel: &Channel, begin: [f64; 3]) {
    let Some(data) = &window.data else {
        window.reason = Some("too few measurements".to_string());
        return;
    };
    match channel.estimate(&[data], begin, Some(begin[BIAS])) {
        Err(refusal) => window.reason = Some(refusal.to_string()),
        Ok(fitted) => {
            let estimate = &fitted.estimate;
            let (kurtosis, error) = fitted.kurtosis;
            if !estimate.fits() {
                window.reason = Some(format!(
                    "the model does not fit (χ²/dof {:.1}): acceleration, or noise that is not white",
                    estimate.chi2 / estimate.dof as f64
                ));
            } else if kurtosis > MOST_KURTOSIS + KURTOSIS_SIGMAS * error {
                window.reason = Some(format!(
                    "the innovations come in bursts (excess kurtosis {kurtosis:.1}): knocks or short accelerations"
                ));
            }
            window.fitted = Some(fitted);
        }
    }
}

/// Leave out what shows more gyro noise than the quietest windows: slow acceleration, or errors of the gyros' scale, that pass for it.
fn keep_the_quietest(fits: &[Option<&Fitted>], reasons: &mut [Option<String>]) {
    let q = |f: &Fitted| (f.estimate.theta[ANGLE], f.estimate.standard_errors[ANGLE]);
    let usable = |i: &usize| reasons[*i].is_none();
    let all: Vec<(usize, f64, f64)> = (0..fits.len())
        .filter(usable)
        .filter_map(|i| fits[i].map(|f| (i, q(f).0, q(f).1)))
        .collect();
    let Some(&(_, least, error)) = all
        .iter()
        .min_by(|a, b| (a.1 + 2.0 * a.2).total_cmp(&(b.1 + 2.0 * b.2)))
    else {
        return;
    };
    // The standard error of a window follows its own q: that of the quietest ones, were they all alike, is that of their mean.
    let alike: Vec<f64> = all
        .iter()
        .filter(|(_, q, e)| q - least <= CONSISTENT * error.hypot(*e))
        .map(|(_, q, _)| *q)
        .collect();
    let mean = alike.iter().sum::<f64>() / alike.len() as f64;
    for (i, q, e) in all {
        if q - least > CONSISTENT * error.hypot(e) && q > 2.0 * mean {
            reasons[i] = Some(format!(
                "shows {:.2} times the gyro noise of the quietest windows: slow acceleration or motion that passes for it",
                (q / mean.max(1e-30)).sqrt()
            ));
        }
    }
}

fn pool(channel: &Channel, data: &[&Turned], begin: [f64; 3]) -> Option<Result<Fitted, Refusal>> {
    (!data.is_empty()).then(|| channel.estimate(data, begin, Some(begin[BIAS])))
}

/// Why no window is used: the commonest reason.
fn why_none(reasons: &[Option<String>]) -> String {
    let mut kinds: Vec<&str> = reasons
        .iter()
        .flatten()
        .map(|r| r.split(" (").next().unwrap_or(r))
        .collect();
    kinds.sort_unstable();
    let commonest = kinds
        .chunk_by(|a, b| a == b)
        .max_by_key(|c| c.len())
        .map_or("", |c| c[0]);
    format!(
        "none of {} windows can be used (mostly: {commonest}): let the unit rest, or turn it slowly by hand, for a minute",
        reasons.len()
    )
}

impl Known {
    fn not(reason: String) -> Self {
        Known {
            value: f64::NAN,
            standard_error: f64::NAN,
            accepted: false,
            reason,
        }
    }

    fn or(mut self, before: f64) -> Self {
        if !self.accepted {
            self.value = before;
        }
        self
    }

    fn scaled(mut self, factor: f64) -> Self {
        self.value *= factor;
        self.standard_error *= factor;
        self
    }

    /// The root of a variance with its standard error, per root of `unit`.
    fn root(variance: f64, error: f64, unit: f64, reason: &str) -> Self {
        let value = (variance / unit).sqrt();
        Known {
            value,
            standard_error: 0.5 * error / unit / value,
            accepted: true,
            reason: reason.to_string(),
        }
    }
}

/// Gyro noise, angle noise, χ² and degrees of freedom.
fn noises(
    pooled: &Option<Result<Fitted, Refusal>>,
    block: f64,
    none: &str,
    what: &str,
) -> (Known, Known, f64, usize) {
    let estimate = match pooled {
        None => {
            let not = Known::not(none.to_string());
            return (not.clone(), not, f64::NAN, 0);
        }
        Some(Err(refusal)) => {
            let not = Known::not(refusal.to_string());
            return (not.clone(), not, f64::NAN, 0);
        }
        Some(Ok(fitted)) => &fitted.estimate,
    };
    let ratio = estimate.chi2 / estimate.dof as f64;
    // Each window fits by itself; what they show together beyond that widens the errors, as is usual for a scatter beyond the stated.
    let widened = ratio.max(1.0).sqrt();
    let q = estimate.theta[ANGLE];
    let q_error = estimate.standard_errors[ANGLE] * widened;
    // The mean over a block: see `turned::average`.
    let r = estimate.theta[MEASURED] + q / 6.0;
    let r_error = estimate.standard_errors[MEASURED] * widened;
    if !estimate.fits() {
        let not = Known::not(format!(
            "the windows do not fit together (χ²/dof {ratio:.1}, at most {LARGEST_CHI2_PER_DOF}): the noise changes, or is not white"
        ));
        return (not.clone(), not, estimate.chi2, estimate.dof);
    }
    let gyro = if q <= 0.0 {
        Known::not(format!(
            "the estimate is on its bound, zero: less than {:.2e} rad/√s (two sigmas) cannot be seen beside this {what} noise; record longer",
            (2.0 * q_error / block).sqrt()
        ))
    } else if q_error >= q {
        Known::not(format!(
            "not identifiable: standard error above the value, less than {:.2e} rad/√s (two sigmas); record longer",
            ((q + 2.0 * q_error) / block).sqrt()
        ))
    } else {
        Known::root(q, q_error, block, "fits")
    };
    let angle = if r > 0.0 && r_error < r {
        Known::root(r, r_error, 1.0 / block, "fits")
    } else {
        Known::not(format!(
            "the estimate of the {what} noise is on its bound, zero: the gyros hide it"
        ))
    };
    (gyro, angle, estimate.chi2, estimate.dof)
}

/// The wander of the bias as a free unknown, to say whether the record tells it.
fn bias_noise(
    channel: &Channel,
    data: &[&Turned],
    pooled: &Option<Result<Fitted, Refusal>>,
    begin: [f64; 3],
    block: f64,
) -> Known {
    let Some(Ok(fitted)) = pooled else {
        return Known::not("no window can be used".to_string());
    };
    let theta = &fitted.estimate.theta;
    let start = [
        theta[ANGLE].max(0.01 * begin[ANGLE]),
        begin[BIAS],
        theta[MEASURED].max(0.01 * begin[MEASURED]),
    ];
    match channel.estimate(data, start, None) {
        Err(refusal) => Known::not(refusal.to_string()),
        Ok(free) => {
            let (value, error) = (
                free.estimate.theta[BIAS],
                free.estimate.standard_errors[BIAS],
            );
            let limit = ((value + 2.0 * error) / block).sqrt();
            if value <= 2.0 * error || !free.estimate.fits() {
                Known {
                    standard_error: limit,
                    ..Known::not(format!(
                        "not identifiable from windows of this length: standard error {error:.1e} of {value:.1e} rad²/s² per step; less than {limit:.2e} rad/s/√s"
                    ))
                }
            } else {
                Known::root(value, error, block, "fits")
            }
        }
    }
}

fn heading(
    record: &[NoiseReading],
    windows: &[Window],
    options: &IdentifyOptions,
    step: f64,
    tilt: &TiltNoise,
) -> Result<Option<HeadingNoise>, Refusal> {
    let fields: Vec<Vector3<f64>> = record.iter().filter_map(|r| r.magnetic_field_b).collect();
    if fields.len() < LEAST_SAMPLES {
        return Ok(None);
    }
    let prior = options.prior;
    // Averages need a sample each, at whatever rate the magnetometer comes.
    let sparse = (1.5 * record.len() as f64 / fields.len() as f64)
        .ceil()
        .max(1.0) as usize;
    let sparse = if sparse <= 2 && fields.len() == record.len() {
        1
    } else {
        sparse
    };
    let q = tilt.gyro_white.value.powi(2) * step;
    let starts: Vec<(Range<usize>, Start)> = windows
        .iter()
        .filter(|w| {
            w.start.gravity.is_finite() && w.reason.as_ref().is_none_or(|_| w.data.is_some())
        })
        .map(|w| {
            let readings = &record[w.range.clone()];
            (w.range.clone(), turned::with_field(readings, &w.start))
        })
        .filter(|(_, start)| start.field.is_some_and(|f| f.x > 0.1 * f.norm()))
        .collect();
    let turned = |(range, start): &(Range<usize>, Start), averaged: usize| {
        turned::headings(&record[range.clone()], start).and_then(|t| turned::average(&t, averaged))
    };
    let mut noise: Vec<f64> = starts
        .iter()
        .filter_map(|s| turned(s, sparse))
        .map(|t| measured_noise(&t.channels) * sparse as f64)
        .collect();
    let not = |reason: String| HeadingNoise {
        heading_white: Known::not(reason.clone()),
        magnetometer: Known::not(reason.clone()),
        gyro_white: Known::not(reason).or(prior.gyro_white),
        chi2: f64::NAN,
        dof: 0,
        windows: 0,
    };
    if noise.is_empty() {
        return Ok(Some(not("no window has a horizontal field".to_string())));
    }
    noise.sort_unstable_by(f64::total_cmp);
    let begin = [q, noise[noise.len() / 4].max(f64::MIN_POSITIVE)];
    let shortest = starts.iter().map(|(r, _)| r.len()).min().unwrap_or(0);
    let averaged = averaging(&begin, shortest).max(sparse);
    let block = averaged as f64 * step;
    let lags = options.lags.min(shortest / averaged / 4).max(4);
    let channel = Channel::new(block, lags, options.rounds.max(1));
    let wander = prior.gyro_bias_sigma * (2.0 / prior.gyro_bias_tau).sqrt();
    let theta = [
        begin[0] * averaged as f64,
        wander * wander * block,
        begin[1] / averaged as f64,
    ];
    let mut judged: Vec<Window> = starts
        .iter()
        .map(|s| {
            let mut window = Window {
                range: s.0.clone(),
                start: s.1,
                data: turned(s, averaged),
                fitted: None,
                reason: None,
            };
            judge(&mut window, &channel, theta);
            window
        })
        .collect();
    let mut reasons: Vec<Option<String>> = judged.iter_mut().map(|w| w.reason.take()).collect();
    let fits: Vec<Option<&Fitted>> = judged.iter().map(|w| w.fitted.as_ref()).collect();
    keep_the_quietest(&fits, &mut reasons);
    let used: Vec<usize> = (0..judged.len())
        .filter(|i| reasons[*i].is_none())
        .collect();
    let data: Vec<&Turned> = used
        .iter()
        .filter_map(|i| judged[*i].data.as_ref())
        .collect();
    let pooled = pool(&channel, &data, theta);
    let (gyro, angle, chi2, dof) = noises(&pooled, block, &why_none(&reasons), "heading");
    let mean = |of: &dyn Fn(&Vector3<f64>) -> f64| {
        used.iter()
            .filter_map(|i| judged[*i].start.field.as_ref().map(of))
            .sum::<f64>()
            / used.len().max(1) as f64
    };
    let (horizontal, dip) = (mean(&|f| f.x), mean(&|f| f.z / f.x));
    // One sample of the magnetometer: the density over the root of its own step.
    let own_step = step * record.len() as f64 / fields.len() as f64;
    Ok(Some(HeadingNoise {
        magnetometer: angle.clone().scaled(horizontal / own_step.sqrt()),
        heading_white: angle,
        // The tilt that dip adds has gyro noise of its own.
        gyro_white: gyro
            .scaled(1.0 / (1.0 + dip * dip).sqrt())
            .or(prior.gyro_white),
        chi2,
        dof,
        windows: used.len(),
    }))
}

fn describe(
    window: &Window,
    reason: &Option<String>,
    record: &[NoiseReading],
    block: f64,
) -> WindowNoise {
    let nothing = [f64::NAN; 2];
    let (gyro_white, tilt_white, chi2_per_dof) = match &window.fitted {
        None => (nothing, nothing, f64::NAN),
        Some(fitted) => {
            let estimate = &fitted.estimate;
            let pair = |known: Known| [known.value, known.standard_error];
            let q = estimate.theta[ANGLE];
            (
                pair(Known::root(q, estimate.standard_errors[ANGLE], block, "")),
                pair(Known::root(
                    estimate.theta[MEASURED] + q / 6.0,
                    estimate.standard_errors[MEASURED],
                    1.0 / block,
                    "",
                )),
                estimate.chi2 / estimate.dof as f64,
            )
        }
    };
    WindowNoise {
        begin: record[window.range.start].time,
        end: record[window.range.end - 1].time,
        gyro_white,
        tilt_white,
        chi2_per_dof,
        accepted: reason.is_none(),
        reason: reason.clone().unwrap_or_else(|| "fits".to_string()),
    }
}
