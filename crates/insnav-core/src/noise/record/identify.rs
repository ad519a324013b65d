//! Which windows show the noise of the sensors, and what they show together.

use super::regress::{ANGLE, BIAS, Channel, Fitted, MEASURED};
use super::steps::{ACCEL_AXES, GYRO_AXES, MAGNETIC_AXES, screen_axes, screen_series, steps};
use super::tones;
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
/// When so many of the windows are used and fit together, no other scale is tried; one that is must bring the error down to this.
const ENOUGH_USED: f64 = 0.8;
const WORTH_IT: f64 = 0.8;
/// Steps of a long window at the first of the coarser scales.
const COARSE_STEPS: usize = 480;
/// The coarsest scale leaves a window so many steps.
const FEWEST_STEPS: usize = 100;
/// The mean specific force of a window without acceleration is gravity, to this share.
const GRAVITY_OFF: f64 = 0.1;
/// Innovations with more excess kurtosis than this, plus so many of its standard errors, come in bursts.
const MOST_KURTOSIS: f64 = 1.0;
const KURTOSIS_SIGMAS: f64 = 4.0;
/// Share of windows with unmodelled acceleration that fits by chance.
const BY_CHANCE: f64 = 0.05;
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
#[derive(Clone)]
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
    let mut start = differences(&windows, record, step, prior_q, &[]);
    let level = windows.iter().filter(|w| w.reason.is_none()).count();
    if options.window_s.is_none() && 2 * level > windows.len() {
        let wanted = (WINDOW_TIME_CONSTANTS * time_constant(&start) * step).min(LONGEST_WINDOW);
        if wanted > 1.2 * length {
            length = wanted;
            let longer = cut(&steps.pieces, length / step);
            if !longer.is_empty() {
                windows = longer;
                windows
                    .iter_mut()
                    .for_each(|w| linearise(w, record, step, prior_q));
                start = differences(&windows, record, step, prior_q, &[]);
            }
        }
    }
    let shortest = windows.iter().map(|w| w.range.len()).min().unwrap_or(0);
    let wander = prior.gyro_bias_sigma * (2.0 / prior.gyro_bias_tau).sqrt();
    let mut tones_hz = Vec::new();
    // A strong line hides weaker ones: as often as there are new ones.
    while 2 * level > windows.len() && tones_hz.len() < tones::MOST {
        let more = lines(&windows, record, step, &start, &tones_hz);
        if more.is_empty() {
            break;
        }
        tones_hz.extend(more);
        tones_hz.truncate(tones::MOST);
    }
    if !tones_hz.is_empty() {
        start = differences(&windows, record, step, prior_q, &tones_hz);
    }
    let at_scales = |windows: &[Window], first: usize| {
        let shortest = windows.iter().map(|w| w.range.len()).min().unwrap_or(0);
        best_scale(
            first,
            shortest,
            windows,
            |averaged| Scale::new(averaged, step, shortest, wander, &start, options),
            |w, averaged| {
                let turned = turned::tilts(&record[w.range.clone()], &w.start);
                let mut turned = turned::average(&turned, averaged)?;
                tones::add(&mut turned, &per_sample(&tones_hz, averaged as f64 * step));
                Some(turned)
            },
        )
    };
    let mut scaled = at_scales(&windows, averaging(&start, shortest));
    if !scaled.is_good()
        && options.window_s.is_none()
        && length < LONGEST_WINDOW
        && 2 * level > windows.len()
    {
        // Coarser scales, at which less of the noise is coloured, need longer windows.
        let mut longer = cut(&steps.pieces, LONGEST_WINDOW / step);
        longer
            .iter_mut()
            .for_each(|w| linearise(w, record, step, prior_q));
        let shortest = longer.iter().map(|w| w.range.len()).min().unwrap_or(0);
        if shortest > 0 {
            let coarse = (shortest / COARSE_STEPS).max(1);
            let next = at_scales(&longer, coarse);
            if next.is_better_than(&scaled) {
                scaled = next;
                length = LONGEST_WINDOW;
            }
        }
    }
    let count = scaled.used().count();
    let gravity = scaled.used().map(|w| w.start.gravity).sum::<f64>() / count.max(1) as f64;
    let (gyro_white, tilt_white, chi2, dof) = noises(&scaled, "tilt");
    let tilt_prior = prior.accel_white / STANDARD_GRAVITY;
    let tilt = TiltNoise {
        gyro_white: gyro_white.or(prior.gyro_white),
        accel_white: tilt_white.clone().scaled(gravity).or(prior.accel_white),
        tilt_white: tilt_white.or(tilt_prior),
        axes_seen: axes_seen(record, scaled.used()),
        chi2,
        dof,
    };
    let gyro_bias = BiasNoise {
        prior: wander,
        wander: bias_noise(&scaled).or(wander),
    };
    let heading = heading(record, &scaled.windows, options, step, &tilt);
    let block = scaled.scale.block;
    let windows = scaled
        .windows
        .iter()
        .zip(&scaled.reasons)
        .map(|(window, reason)| describe(window, reason, record, block))
        .collect();
    Ok(RecordNoise {
        step_s: step,
        samples: record.len(),
        pieces: steps.pieces.len(),
        window_s: length,
        averaged: scaled.scale.averaged,
        lags: scaled.scale.channel.lags,
        tones_hz,
        tilt,
        heading,
        gyro_bias,
        windows,
    })
}

impl Window {
    fn of(range: Range<usize>) -> Self {
        Window {
            range,
            start: Start {
                attitude: nalgebra::UnitQuaternion::identity(),
                gyro_bias: Vector3::zeros(),
                gravity: f64::NAN,
                field: None,
            },
            data: None,
            fitted: None,
            reason: None,
        }
    }
}

/// What depends on how many samples are averaged.
struct Scale {
    averaged: usize,
    block: f64,
    channel: Channel,
    /// Start values, per block.
    begin: [f64; 3],
}

impl Scale {
    fn new(
        averaged: usize,
        step: f64,
        shortest: usize,
        wander: f64,
        [q, r]: &[f64; 2],
        options: &IdentifyOptions,
    ) -> Self {
        let block = averaged as f64 * step;
        let lags = options.lags.min(shortest / averaged / 4).max(4);
        Scale {
            averaged,
            block,
            channel: Channel::new(block, lags, options.rounds.max(1)),
            begin: [
                q * averaged as f64,
                wander * wander * block,
                r / averaged as f64,
            ],
        }
    }
}

/// Windows as they were judged at one scale.
struct Scaled {
    scale: Scale,
    windows: Vec<Window>,
    reasons: Vec<Option<String>>,
    pooled: Option<Result<Fitted, Refusal>>,
}

impl Scaled {
    fn used(&self) -> impl Iterator<Item = &Window> {
        let pairs = self.windows.iter().zip(&self.reasons);
        pairs.filter(|(_, r)| r.is_none()).map(|(w, _)| w)
    }

    /// Standard error of the gyros' variance over itself, with what the windows together show beyond it.
    fn relative_error(&self) -> f64 {
        match &self.pooled {
            Some(Ok(fitted)) => {
                let (q, error) = (
                    fitted.estimate.theta[ANGLE],
                    fitted.estimate.standard_errors[ANGLE],
                );
                self.widening(fitted)[ANGLE] * error / q.max(0.1 * error)
            }
            _ => f64::INFINITY,
        }
    }

    /// Of the covariances that windows together leave, by degree of freedom.
    fn left(&self) -> f64 {
        match &self.pooled {
            Some(Ok(f)) => f.estimate.chi2 / f.estimate.dof as f64,
            _ => f64::INFINITY,
        }
    }

    fn fits(&self) -> bool {
        self.left() <= LARGEST_CHI2_PER_DOF
    }

    fn share(&self) -> f64 {
        self.used().count() as f64 / self.windows.len().max(1) as f64
    }

    /// Nothing to be gained by another scale.
    fn is_good(&self) -> bool {
        self.fits() && self.share() > ENOUGH_USED
    }

    /// What fits is better than what does not; then the surer one, or, of what does not, what is nearer to it.
    fn is_better_than(&self, other: &Self) -> bool {
        match (self.fits(), other.fits()) {
            (true, false) => 2.0 * self.share() > other.share(),
            (false, true) => false,
            (true, true) => self.relative_error() < WORTH_IT * other.relative_error(),
            (false, false) => self.left() * other.share() < WORTH_IT * other.left() * self.share(),
        }
    }

    /// By how much the stated errors of the three unknowns are too small: for what the windows together leave beyond chance, and for
    /// what they scatter among each other beyond it.
    fn widening(&self, pooled: &Fitted) -> [f64; 3] {
        let estimate = &pooled.estimate;
        let left = estimate.chi2 / estimate.dof as f64;
        let count = self.used().count() as f64;
        let beyond = |ratio: f64, of: f64| {
            let chance = 1.0 + 3.0 * (2.0 / of).sqrt();
            if ratio > chance { ratio } else { 1.0 }
        };
        let left = beyond(left, estimate.dof as f64);
        core::array::from_fn(|i| {
            // Of windows of one length, errors by the noise that all have: that of a window alone is small where its noise is.
            let error = estimate.standard_errors[i] * count.sqrt();
            let squares: f64 = self
                .used()
                .filter_map(|w| w.fitted.as_ref())
                .map(|f| ((f.estimate.theta[i] - estimate.theta[i]) / error).powi(2))
                .sum();
            let scatter = squares / (count - 1.0).max(1.0);
            left.max(beyond(scatter, count)).sqrt()
        })
    }
}

/// Judge all windows, with more and more samples averaged as long as that makes the result surer: what colours the noise of
/// neighbouring samples (a low-pass, coarse steps, an engine) is gone in averages.
fn best_scale(
    first: usize,
    shortest: usize,
    windows: &[Window],
    scale: impl Fn(usize) -> Scale,
    data: impl Fn(&Window, usize) -> Option<Turned>,
) -> Scaled {
    let judged_at = |averaged: usize| {
        let scale = scale(averaged);
        let mut windows = windows.to_vec();
        for window in &mut windows {
            if window.reason.is_none() {
                window.data = data(window, averaged);
                judge(window, &scale.channel, scale.begin);
            }
        }
        let mut reasons: Vec<Option<String>> = windows.iter().map(|w| w.reason.clone()).collect();
        keep_the_quietest(&windows, &mut reasons);
        leave_chance_out(&mut reasons);
        let mut scaled = Scaled {
            scale,
            windows,
            reasons,
            pooled: None,
        };
        let data: Vec<&Turned> = scaled.used().filter_map(|w| w.data.as_ref()).collect();
        let Scale { channel, begin, .. } = &scaled.scale;
        scaled.pooled =
            (!data.is_empty()).then(|| channel.estimate(&data, *begin, Some(begin[BIAS])));
        scaled
    };
    let mut best = judged_at(first);
    let mut averaged = 2 * first;
    while !best.is_good() && shortest / averaged >= FEWEST_STEPS {
        let next = judged_at(averaged);
        if next.is_better_than(&best) {
            best = next;
        }
        averaged *= 2;
    }
    best
}

/// How far each body axis was horizontal in these windows: 1 all the time, 0 never.
fn axes_seen<'a>(record: &[NoiseReading], windows: impl Iterator<Item = &'a Window>) -> [f64; 3] {
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for window in windows {
        for attitude in turned::attitudes(&record[window.range.clone()], &window.start) {
            let up = attitude.inverse() * Vector3::z();
            sum += up.map(|c| 1.0 - c * c);
            count += 1.0;
        }
    }
    (sum / f64::max(count, 1.0)).into()
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
            let at = |k: usize| piece.start + k * n / count;
            windows.push(Window::of(at(k)..at(k + 1)));
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
    let off = (start.gravity / STANDARD_GRAVITY - 1.0).abs();
    if off > GRAVITY_OFF || off.is_nan() {
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
        for (_, what, value) in residuals.constants {
            match what {
                Constant::Begin(k) => tilt[k] = value,
                Constant::GyroBias(k) => bias[k] = value,
                Constant::OtherBias(_) | Constant::Delay | Constant::Tone => {}
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
    if last >= SETTLED || last.is_nan() {
        window.reason = Some("the attitude that the gyros carry does not stay level: acceleration, or a gyro that saturates".to_string());
    }
    window.start = start;
}

/// Lines in the spectrum of the tilts' innovations that most windows show, Hz.
fn lines(
    windows: &[Window],
    record: &[NoiseReading],
    step: f64,
    start: &[f64; 2],
    known_hz: &[f64],
) -> Vec<f64> {
    let shortest = windows.iter().map(|w| w.range.len()).min().unwrap_or(0);
    let averaged = averaging(start, shortest);
    let [q, r] = *start;
    let theta = [q * averaged as f64, 1e-9 * q, r / averaged as f64];
    let channel = Channel::new(averaged as f64 * step, 4, 1);
    let Ok(filter) = channel.filter(&theta) else {
        return Vec::new();
    };
    let innovations: Vec<Vec<Vec<f64>>> = windows
        .iter()
        .filter(|w| w.reason.is_none())
        .filter_map(|w| {
            let turned = turned::tilts(&record[w.range.clone()], &w.start);
            let mut data = turned::average(&turned, averaged)?;
            tones::add(&mut data, &per_sample(known_hz, averaged as f64 * step));
            let left = channel.residuals(&data, &theta, &filter).left;
            let length = left.len() / data.channels.len();
            Some(left.chunks_exact(length).map(<[f64]>::to_vec).collect())
        })
        .collect();
    let per_radian = 1.0 / (core::f64::consts::TAU * averaged as f64 * step);
    // What was fitted is not found again beside itself.
    let apart = |f: &f64| {
        let resolution = 2.0 / (shortest as f64 * step);
        known_hz.iter().all(|k| (f - k).abs() > resolution)
    };
    tones::find(&innovations)
        .into_iter()
        .map(|f| f * per_radian)
        .filter(apart)
        .collect()
}

/// Angular frequencies per step; what lies beyond half the rate is no line there.
fn per_sample(tones_hz: &[f64], step: f64) -> Vec<f64> {
    tones_hz
        .iter()
        .map(|f| core::f64::consts::TAU * f * step)
        .filter(|f| *f < 0.9 * core::f64::consts::PI)
        .collect()
}

/// Noise per sample by differences over several spans, of the quieter windows: (q, r).
fn differences(
    windows: &[Window],
    record: &[NoiseReading],
    step: f64,
    prior_q: f64,
    tones_hz: &[f64],
) -> [f64; 2] {
    let mut found: Vec<[f64; 2]> = windows
        .iter()
        .filter(|w| w.reason.is_none())
        .filter_map(|w| {
            let mut data = turned::tilts(&record[w.range.clone()], &w.start);
            tones::add(&mut data, &per_sample(tones_hz, step));
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
        for (index, _, value) in &residuals.constants {
            let column = &data.responses[*index].channels[c];
            clean
                .iter_mut()
                .zip(column)
                .for_each(|(y, h)| *y -= value * h);
        }
        let n = clean.len();
        // Neighbouring samples share the sensor's low-pass: spans from four steps on, where there are enough.
        let spans: Vec<usize> = (if n < 400 { 0 } else { 2 }..)
            .map(|k| 1 << k)
            .take_while(|s| s * 20 <= n)
            .collect();
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

/// Of windows that accelerate one in twenty may fit all the same: as few as that are none.
fn leave_chance_out(reasons: &mut [Option<String>]) {
    let expected = BY_CHANCE * reasons.len() as f64;
    let used = reasons.iter().filter(|r| r.is_none()).count() as f64;
    if used <= expected + 2.0 * expected.sqrt() {
        for reason in reasons.iter_mut().filter(|r| r.is_none()) {
            *reason = Some("fits, but so few windows do that it may be by chance".to_string());
        }
    }
}

/// Leave out what shows more gyro noise than the quietest windows: slow acceleration, or errors of the gyros' scale, that pass for it.
fn keep_the_quietest(windows: &[Window], reasons: &mut [Option<String>]) {
    let q = |f: &Fitted| (f.estimate.theta[ANGLE], f.estimate.standard_errors[ANGLE]);
    let usable = |i: &usize| reasons[*i].is_none();
    let all: Vec<(usize, f64, f64)> = (0..windows.len())
        .filter(usable)
        .filter_map(|i| windows[i].fitted.as_ref().map(|f| (i, q(f).0, q(f).1)))
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
        "none of {} windows can be used (mostly: {commonest}): let the unit rest, or turn it slowly by hand, for a minute, or look at such a part of the record alone",
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
fn noises(scaled: &Scaled, what: &str) -> (Known, Known, f64, usize) {
    let block = scaled.scale.block;
    let nothing = |why: String| {
        let not = Known::not(why);
        (not.clone(), not, f64::NAN, 0)
    };
    let fitted = match &scaled.pooled {
        None => return nothing(why_none(&scaled.reasons)),
        Some(Err(refusal)) => return nothing(refusal.to_string()),
        Some(Ok(fitted)) => fitted,
    };
    let estimate = &fitted.estimate;
    let widening = scaled.widening(fitted);
    let told = |by: f64| {
        if by <= 1.0 {
            "fits".to_string()
        } else {
            format!(
                "fits (errors {by:.1} times those of one white noise: it changes between windows, or is not quite white)"
            )
        }
    };
    if !estimate.fits() {
        let not = Known::not(format!(
            "the windows do not fit together (χ²/dof {:.1}, at most {LARGEST_CHI2_PER_DOF}): the {what} noise is not white",
            estimate.chi2 / estimate.dof as f64
        ));
        return (not.clone(), not, estimate.chi2, estimate.dof);
    }
    let q = estimate.theta[ANGLE];
    let q_error = estimate.standard_errors[ANGLE] * widening[ANGLE];
    // The mean over a block: see `turned::average`.
    let r = estimate.theta[MEASURED] + q / 6.0;
    let r_error = estimate.standard_errors[MEASURED] * widening[MEASURED];
    let gyro = if q <= 0.0 {
        Known::not(format!(
            "the estimate is on its bound, zero (less than {:.1e} rad/√s cannot be seen beside this {what} noise): record longer",
            (2.0 * q_error / block).sqrt()
        ))
    } else if q_error >= q {
        Known::not(format!(
            "not identifiable (the standard error exceeds the value, less than {:.1e} rad/√s): record longer",
            ((q + 2.0 * q_error) / block).sqrt()
        ))
    } else {
        Known::root(q, q_error, block, &told(widening[ANGLE]))
    };
    let angle = if r > 0.0 && r_error < r {
        Known::root(r, r_error, 1.0 / block, &told(widening[MEASURED]))
    } else {
        Known::not(format!(
            "the {what} noise is not identifiable beside that of the gyros (the standard error exceeds the value)"
        ))
    };
    (gyro, angle, estimate.chi2, estimate.dof)
}

/// The wander of the bias as a free unknown, to say whether the record tells it.
fn bias_noise(scaled: &Scaled) -> Known {
    let Some(Ok(fitted)) = &scaled.pooled else {
        return Known::not("no window can be used".to_string());
    };
    let Scale {
        channel,
        begin,
        block,
        ..
    } = &scaled.scale;
    let data: Vec<&Turned> = scaled.used().filter_map(|w| w.data.as_ref()).collect();
    let theta = &fitted.estimate.theta;
    let start = [
        theta[ANGLE].max(0.01 * begin[ANGLE]),
        begin[BIAS],
        theta[MEASURED].max(0.01 * begin[MEASURED]),
    ];
    match channel.estimate(&data, start, None) {
        Err(refusal) => Known::not(refusal.to_string()),
        Ok(free) => {
            let value = free.estimate.theta[BIAS];
            let error = free.estimate.standard_errors[BIAS] * scaled.widening(&free)[ANGLE];
            let limit = ((value + 2.0 * error) / block).sqrt();
            if value > 3.0 * error {
                Known::root(value, error, *block, "fits")
            } else {
                Known::not(format!(
                    "not identifiable from windows of this length (less than {limit:.1e} rad/s/√s)"
                ))
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
) -> Option<HeadingNoise> {
    let fields: Vec<Vector3<f64>> = record.iter().filter_map(|r| r.magnetic_field_b).collect();
    if fields.len() < LEAST_SAMPLES {
        return None;
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
    if let Err(refusal) = screen_series(&fields, MAGNETIC_AXES) {
        return Some(not(refusal.to_string()));
    }
    if noise.is_empty() {
        return Some(not("no window has a horizontal field".to_string()));
    }
    noise.sort_unstable_by(f64::total_cmp);
    let start = [q, noise[noise.len() / 4].max(f64::MIN_POSITIVE)];
    let shortest = starts.iter().map(|(r, _)| r.len()).min().unwrap_or(0);
    let wander = prior.gyro_bias_sigma * (2.0 / prior.gyro_bias_tau).sqrt();
    let fresh: Vec<Window> = starts
        .iter()
        .map(|(range, start)| Window {
            start: *start,
            ..Window::of(range.clone())
        })
        .collect();
    let scaled = best_scale(
        averaging(&start, shortest).max(sparse),
        shortest,
        &fresh,
        |averaged| Scale::new(averaged, step, shortest, wander, &start, options),
        |w, averaged| turned(&(w.range.clone(), w.start), averaged),
    );
    let (gyro, angle, chi2, dof) = noises(&scaled, "heading");
    let used = scaled.used().count();
    let mean = |of: &dyn Fn(&Vector3<f64>) -> f64| {
        let fields = scaled.used().filter_map(|w| w.start.field);
        fields.map(|f| of(&f)).sum::<f64>() / used.max(1) as f64
    };
    let (horizontal, dip) = (mean(&|f| f.x), mean(&|f| f.z / f.x));
    // One sample of the magnetometer: the density over the root of its own step.
    let own_step = step * record.len() as f64 / fields.len() as f64;
    Some(HeadingNoise {
        magnetometer: angle.clone().scaled(horizontal / own_step.sqrt()),
        heading_white: angle,
        // The tilt that dip adds has gyro noise of its own.
        gyro_white: gyro
            .scaled(1.0 / (1.0 + dip * dip).sqrt())
            .or(prior.gyro_white),
        chi2,
        dof,
        windows: used,
    })
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
