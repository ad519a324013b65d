//! The IMU's clock offset by the navigator itself: the offset with which its predictions fit the fixes best.

use super::{ClockOffset, Search};
use crate::config::{Config, SigmaScale};
use crate::error::{Error, Result};
use crate::filter::Update;
use crate::imu::ImuNoise;
use crate::navigator::Navigator;
use crate::sample::Sample;
use crate::solution::Sink;
use crate::time::Time;
use std::vec::Vec;

/// Spacing of the offsets that are tried, s.
const GRID: f64 = 0.05;
/// Misfits are summed over spans of this length, s: long against what correlates them.
const SPAN: f64 = 5.0;
/// A single misfit counts at most this much: outliers say nothing of clocks.
const MOST: f64 = 16.0;
/// Fixes closer to the ends of the log than the range and this are not counted, s.
const MARGIN: f64 = 0.5;
/// The log is used to this length, s: where the motion tells anything at all, that is enough.
const LENGTH: f64 = 600.0;

/// Seconds to add to IMU stamps so that they meet the clock of GNSS positions, by runs of the navigator with offsets over the
/// whole range.
///
/// The misfit is that of all innovations (NIS, clipped). Its parabola through the three best points gives the offset; the
/// scatter of its slope between spans of 5 s against its curvature gives the sigma (sandwich estimate, \[White82\]). Unlike
/// [`super::imu_offset`] it carries attitude and biases through the whole log, which helps where motion is gentle and the
/// log short; it takes 21 runs, and trusts the noise that it is given. The velocity lag must be in `config`.
///
/// # Errors
/// [`Error::NotObservable`] when the best offset is at the end of the range or the sigma exceeds half of what not knowing
/// would be; errors of the navigator.
pub fn estimate(
    samples: &[Sample],
    config: &Config,
    noise: &ImuNoise,
    search: &Search,
) -> Result<ClockOffset> {
    let begin = samples.first().map_or(Time(0), Sample::time);
    let part = &samples[..samples.partition_point(|s| s.time().since(begin) < LENGTH)];
    let half = (search.range / GRID).round() as i32;
    let mut misfits = Vec::new();
    for k in -half..=half {
        let mut config = *config;
        config.gnss.time_offset_s = f64::from(k) * GRID;
        // Learnt noise would take the misfit upon itself, which is what is looked for.
        for scale in [
            &mut config.gnss.sigma_scale,
            &mut config.gnss.velocity_sigma_scale,
        ] {
            *scale = SigmaScale::Fixed(scale.fixed().unwrap_or(1.0));
        }
        misfits.push(run(part, &config, noise, search)?);
    }
    let total: Vec<f64> = misfits.iter().map(|m| m.iter().sum()).collect();
    let best = (0..total.len())
        .min_by(|&a, &b| total[a].total_cmp(&total[b]))
        .unwrap_or(0);
    if best == 0 || best + 1 == total.len() {
        return Err(not_observable("no best value within the searched range"));
    }
    let (before, here, after) = (&misfits[best - 1], &misfits[best], &misfits[best + 1]);
    // In units of the grid: slope and curvature of half the misfit at the best point.
    let curvature = 0.5 * (total[best - 1] - 2.0 * total[best] + total[best + 1]);
    let slope = |a: f64, b: f64| 0.25 * (b - a);
    let step = -slope(total[best - 1], total[best + 1]) / curvature;
    // Slopes of the spans at the minimum itself.
    let at_minimum = (0..here.len()).map(|i| {
        let bend = 0.5 * (before[i] - 2.0 * here[i] + after[i]);
        slope(before[i], after[i]) + bend * step
    });
    let scatter: f64 = at_minimum.map(|g| g * g).sum();
    let sigma = GRID * scatter.sqrt() / curvature;
    if !(curvature > 0.0 && sigma < 0.5 * search.uniform_sigma()) {
        return Err(not_observable(
            "the motion is too gentle for the noise of fixes and IMU",
        ));
    }
    Ok(ClockOffset {
        value: GRID * (f64::from(best as i32 - half) + step),
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

/// Clipped NIS, summed by spans.
fn run(samples: &[Sample], config: &Config, noise: &ImuNoise, search: &Search) -> Result<Vec<f64>> {
    let begin = samples.first().map_or(Time(0), Sample::time);
    let mut navigator = Navigator::new(config, *noise)?;
    let end = samples.last().map_or(begin, Sample::time);
    let margin = search.range + MARGIN;
    let mut spans = Spans {
        begin,
        counted: (begin.plus(margin), end.plus(-margin)),
        sums: vec![0.0; (LENGTH / SPAN) as usize + 1],
    };
    for sample in samples {
        navigator.step(sample, &mut spans)?;
    }
    navigator.finish(&mut spans)?;
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
