//! The IMU's clock offset by the navigator itself: the offset with which its predictions fit the fixes best.

use super::{ClockOffset, Search};
use crate::config::{Config, SigmaScale, StationaryMode};
use crate::error::{Error, Result};
use crate::filter::Update;
use crate::imu::ImuNoise;
use crate::navigator::Navigator;
use crate::sample::{ImuSample, Sample};
use crate::solution::Sink;
use crate::time::Time;
use nalgebra::Vector3;
use std::vec::Vec;

/// Misfits are compared at the offset and so far to either side of it, s.
const STEP: f64 = 0.05;
/// Misfits are summed over spans of this length, s: long against what correlates them.
const SPAN: f64 = 5.0;
/// A single misfit counts at most this much: outliers say nothing of clocks.
const MOST: f64 = 16.0;
/// Fixes closer to the ends of the log than the range and this are not counted, s.
const MARGIN: f64 = 0.5;
/// The log is used to this length, s: where the motion tells anything at all, that is enough.
const LENGTH: f64 = 600.0;
/// Inertial samples are averaged over so long, s: what decides is in motions of a second.
const BLOCK: f64 = 0.02;
/// Runs with the state open. From a second away the third moves by less than a sigma.
const MOST_RUNS: usize = 6;
/// The state has settled when a run moves it by less, s: the parabola tells the rest.
const SETTLED: f64 = 0.01;
/// Sigma with which the state opens, s: that it is wide keeps the linear filter from being drawn to where it began.
const OPEN: f64 = 0.5;

/// Seconds to add to IMU stamps so that they meet the clock of GNSS positions, by runs of the navigator.
///
/// First the clock offset is a state of the filter, which runs again from what it found until nothing moves: a filter that is
/// linear about an offset of 0.3 s is wrong by 0.01 s. Then it runs with the offset fixed, there and a twentieth of a second to either side. The
/// misfit is that of all innovations (NIS, clipped); its parabola through the three gives the offset, and the scatter of its slope
/// between spans of 5 s against its curvature the sigma (sandwich estimate, \[White82\]). Unlike [`super::imu_offset`] it carries
/// attitude and biases through the whole log and uses velocities, which helps where motion is gentle, the log short or positions
/// are poor; it trusts the noise that it is given to weigh the fixes.
///
/// Velocities tell the sum of this offset and their own lag: the latter must be in `config`, and what it is wrong by, the offset is.
///
/// # Errors
/// [`Error::NotObservable`] when the state does not settle within the range, when the misfit has no minimum where it did or is
/// there no less than at the offset of `config`, or when the sigma exceeds half of what not knowing would be; errors of the
/// navigator.
pub fn estimate(
    samples: &[Sample],
    config: &Config,
    noise: &ImuNoise,
    search: &Search,
) -> Result<ClockOffset> {
    let begin = samples.first().map_or(Time(0), Sample::time);
    let part = &samples[..samples.partition_point(|s| s.time().since(begin) < LENGTH)];
    let part = &thinned(part);
    let mut config = *config;
    // A zero velocity is told a moment after the body has begun to move: with it, gentle starts made the IMU 0.02 s late.
    config.stationary.mode = StationaryMode::Off;
    // Learnt noise would take the misfit upon itself, which is what is looked for.
    for scale in [
        &mut config.gnss.sigma_scale,
        &mut config.gnss.velocity_sigma_scale,
    ] {
        *scale = SigmaScale::Fixed(scale.fixed().unwrap_or(1.0));
    }
    let middle = settle(part, &config, noise, search)?;
    let misfit_at = |offset: f64| {
        let mut config = config;
        config.gnss.time_offset_s = offset;
        config.gnss.time_offset_sigma_s = None;
        misfits(part, &config, noise, search)
    };
    let (before, here, after) = (
        misfit_at(middle - STEP)?,
        misfit_at(middle)?,
        misfit_at(middle + STEP)?,
    );
    let sum = |misfits: &[f64]| misfits.iter().sum::<f64>();
    // In units of the step: slope and curvature of half the misfit.
    let slope = |a: f64, b: f64| 0.25 * (b - a);
    let curvature = 0.5 * (sum(&before) - 2.0 * sum(&here) + sum(&after));
    let step = -slope(sum(&before), sum(&after)) / curvature;
    if !(curvature > 0.0 && step.abs() < 1.0) {
        return Err(not_observable("the misfit has no clear minimum"));
    }
    // Slopes of the spans at the minimum itself, each as if its span had been left out of the estimate (\[MacKinnonWhite85\], HC3): on
    // gentle drives the first acceleration tells half of all.
    let at_minimum = (0..here.len()).map(|i| {
        let bend = 0.5 * (before[i] - 2.0 * here[i] + after[i]);
        (slope(before[i], after[i]) + bend * step) / (1.0 - bend / curvature).clamp(0.1, 1.0)
    });
    let scatter: f64 = at_minimum.map(|g| g * g).sum();
    // Where a few spans tell all, their scatter may be small by chance: what the stated noise leaves is claimed at least.
    let sigma = STEP * scatter.max(curvature).sqrt() / curvature;
    // A wider search makes no vaguer estimate good.
    let nothing_known = search
        .uniform_sigma()
        .min(Search::default().uniform_sigma());
    if sigma.is_nan() || sigma > 0.5 * nothing_known {
        return Err(not_observable(
            "the motion is too gentle for the noise of fixes and IMU",
        ));
    }
    let value = middle + STEP * step;
    let set = config.gnss.time_offset_s;
    if (value - set).abs() > STEP && sum(&misfit_at(set)?) < sum(&here) {
        return Err(not_observable("the misfit has more than one minimum"));
    }
    Ok(ClockOffset {
        value,
        sigma,
        stretches: here.len(),
    })
}

fn not_observable(reason: &'static str) -> Error {
    Error::NotObservable {
        what: "the IMU's clock offset",
        reason,
    }
}

/// Where the filter's own state of the clock ends, run again from there until it stays.
fn settle(samples: &[Sample], config: &Config, noise: &ImuNoise, search: &Search) -> Result<f64> {
    let mut config = *config;
    config.gnss.time_offset_sigma_s = Some(OPEN);
    for _ in 0..MOST_RUNS {
        let mut navigator = Navigator::new(&config, *noise)?;
        run(&mut navigator, samples, &mut ())?;
        let moved = navigator
            .filter()
            .map_or(f64::NAN, |f| f.nominal().calibration.clock_offset);
        config.gnss.time_offset_s += moved;
        if moved.is_nan() || config.gnss.time_offset_s.abs() > search.range {
            return Err(not_observable("no best value within the searched range"));
        }
        if moved.abs() < SETTLED {
            return Ok(config.gnss.time_offset_s);
        }
    }
    Err(not_observable("the filter's own estimate does not settle"))
}

/// Inertial samples averaged over blocks of [`BLOCK`], stamped at the middle; all others as they are. No block holds a gap.
fn thinned(samples: &[Sample]) -> Vec<Sample> {
    let mut out = Vec::new();
    let mut block: Vec<ImuSample> = Vec::new();
    for sample in samples {
        match sample {
            Sample::Imu(s) => {
                let full = |b: &[ImuSample]| s.time.since(b[0].time) > BLOCK - 1e-4;
                if !block.is_empty() && full(&block) {
                    out.push(mean(&block));
                    block.clear();
                }
                block.push(*s);
            }
            other => out.push(*other),
        }
    }
    if !block.is_empty() {
        out.push(mean(&block));
    }
    out.sort_by_key(Sample::time);
    out
}

fn mean(block: &[ImuSample]) -> Sample {
    let n = block.len() as f64;
    let of =
        |part: fn(&ImuSample) -> Vector3<f64>| block.iter().map(part).sum::<Vector3<f64>>() / n;
    let first = block[0].time;
    Sample::Imu(ImuSample {
        time: first.plus(block.iter().map(|s| s.time.since(first)).sum::<f64>() / n),
        angular_rate_b: of(|s| s.angular_rate_b),
        specific_force_b: of(|s| s.specific_force_b),
    })
}

fn run(navigator: &mut Navigator, samples: &[Sample], sink: &mut impl Sink) -> Result<()> {
    for sample in samples {
        navigator.step(sample, sink)?;
    }
    navigator.finish(sink)
}

/// Clipped NIS, summed by spans.
fn misfits(
    samples: &[Sample],
    config: &Config,
    noise: &ImuNoise,
    search: &Search,
) -> Result<Vec<f64>> {
    let begin = samples.first().map_or(Time(0), Sample::time);
    let mut navigator = Navigator::new(config, *noise)?;
    let end = samples.last().map_or(begin, Sample::time);
    let margin = search.range + MARGIN;
    let mut spans = Spans {
        begin,
        counted: (begin.plus(margin), end.plus(-margin)),
        sums: vec![0.0; (LENGTH / SPAN) as usize + 1],
    };
    run(&mut navigator, samples, &mut spans)?;
    Ok(spans.sums)
}

struct Spans {
    begin: Time,
    /// Fixes that every offset leaves between inertial samples: what only some runs use must not tell.
    counted: (Time, Time),
    sums: Vec<f64>,
}

impl Sink for Spans {
    fn wants_epoch(&mut self, _: Time) -> bool {
        false
    }

    fn update(&mut self, update: &Update) {
        if update.time < self.counted.0 || update.time > self.counted.1 {
            return;
        }
        // By the GNSS clock, which no offset moves: every run sorts the same fix into the same span.
        let span = (update.time.since(self.begin) / SPAN).max(0.0) as usize;
        if let Some(sum) = self.sums.get_mut(span) {
            *sum += update.nis.min(MOST);
        }
    }
}
