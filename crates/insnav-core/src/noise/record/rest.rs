//! Allan deviation of every axis over a stretch at rest.

use super::NoiseReading;
use super::steps::{ACCEL_AXES, GYRO_AXES, screen_axes, steps};
use crate::noise::{
    AllanFit, AllanPoint, Refusal, averaging_samples, fit_allan, overlapping_allan,
};
use crate::time::Time;
use nalgebra::Vector3;
use std::format;
use std::vec::Vec;

/// Averaging times to a doubling.
const PER_OCTAVE: usize = 2;
/// Less rest than this tells nothing by averaging, s.
const LEAST_REST: f64 = 10.0;

/// Allan deviation and its fit on one axis.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisStability {
    /// The deviation at each averaging time.
    pub points: Vec<AllanPoint>,
    /// White noise, flicker noise and random walk.
    pub fit: AllanFit,
}

/// What a unit at rest shows by averaging time, in body axes.
#[derive(Clone, Debug, PartialEq)]
pub struct RestStability {
    /// Begin of the stretch.
    pub begin: Time,
    /// Its end.
    pub end: Time,
    /// Step between samples, s.
    pub step_s: f64,
    /// Gyros: rad/s.
    pub gyro: [AxisStability; 3],
    /// Accelerometers: m/s².
    pub accel: [AxisStability; 3],
}

/// Allan deviations of a record at rest, over its longest piece without a gap.
///
/// # Errors
/// [`Refusal::UnevenSteps`], [`Refusal::Axis`], and [`Refusal::Shape`] for less than ten seconds.
pub fn rest_stability(record: &[NoiseReading]) -> Result<RestStability, Refusal> {
    let steps = steps(record)?;
    let longest = steps
        .pieces
        .into_iter()
        .max_by_key(std::ops::Range::len)
        .unwrap_or(0..0);
    let readings = &record[longest];
    if (readings.len() as f64) * steps.step_s < LEAST_REST {
        return Err(Refusal::Shape {
            what: "longest stretch at rest without a gap",
            found: format!("{:.1} s", readings.len() as f64 * steps.step_s),
            expected: format!("at least {LEAST_REST} s"),
        });
    }
    screen_axes(readings, |r| r.angular_rate_b, GYRO_AXES)?;
    screen_axes(readings, |r| r.specific_force_b, ACCEL_AXES)?;
    // Jitter of the stamps is none of the samples: the mean step is theirs.
    let span = readings[readings.len() - 1].time.since(readings[0].time);
    let step_s = span / (readings.len() - 1) as f64;
    let mut averaged = averaging_samples(readings.len(), PER_OCTAVE);
    // Round averaging times are what people compare.
    let decades = (-1..5).map(|k| (10f64.powi(k) / step_s).round() as usize);
    averaged.extend(decades.filter(|m| *m > 0 && *m <= readings.len() / 4));
    averaged.sort_unstable();
    averaged.dedup();
    let axis = |of: &dyn Fn(&NoiseReading) -> Vector3<f64>, k: usize| {
        let record: Vec<f64> = readings.iter().map(|r| of(r)[k]).collect();
        let points = overlapping_allan(&record, step_s, &averaged)?;
        let fit = fit_allan(&points)?;
        Ok::<_, Refusal>(AxisStability { points, fit })
    };
    let three = |of: &dyn Fn(&NoiseReading) -> Vector3<f64>| -> Result<_, Refusal> {
        Ok([axis(of, 0)?, axis(of, 1)?, axis(of, 2)?])
    };
    Ok(RestStability {
        begin: readings[0].time,
        end: readings[readings.len() - 1].time,
        step_s,
        gyro: three(&|r| r.angular_rate_b)?,
        accel: three(&|r| r.specific_force_b)?,
    })
}
