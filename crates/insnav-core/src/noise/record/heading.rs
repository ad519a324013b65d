//! Noise of the magnetometer, by the heading that it tells.

use super::guess::{averaging, measured_noise};
use super::scales::{Scale, best_scale};
use super::steps::{MAGNETIC_AXES, screen_series};
use super::told::noises;
use super::turned::{self, Start};
use super::window::{LEAST_SAMPLES, Window};
use super::{HeadingNoise, IdentifyOptions, Known, NoiseReading, TiltNoise};
use nalgebra::Vector3;
use std::ops::Range;
use std::string::{String, ToString};
use std::vec::Vec;

pub(super) fn heading(
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
