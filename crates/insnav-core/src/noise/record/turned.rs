//! A window of a record in axes that stand still.

use super::NoiseReading;
use crate::attitude::exp;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::vec::Vec;

/// What is constant in a window and no noise, as it is likely to be: gyro bias, rad/s; accelerometer bias over gravity; iron over
/// the horizontal field; delay, s. Columns are left out where even this would not show: at rest a bias cannot be told from gravity or
/// field, and its column, which the noise of the gyros turns, would take that noise away.
const GYRO_BIAS: f64 = 0.02;
const ACCEL_BIAS: f64 = 0.05;
const IRON: f64 = 0.05;
const DELAY: f64 = 0.005;

/// What the window is linearised about.
#[derive(Clone, Copy, Debug)]
pub(super) struct Start {
    /// Body to axes that stand still, the third one along the specific force of a body at rest.
    pub(super) attitude: UnitQuaternion<f64>,
    pub(super) gyro_bias: Vector3<f64>,
    /// Size of gravity as this unit measures it, m/s².
    pub(super) gravity: f64,
    /// The field in these axes, turned so that its horizontal part is along x, T.
    pub(super) field: Option<Vector3<f64>>,
}

/// Measured angles and the responses to what is constant.
#[derive(Clone, Debug, Default)]
pub(super) struct Turned {
    /// One series for each channel, rad; NaN where there is no measurement.
    pub(super) channels: Vec<Vec<f64>>,
    /// Responses, each with one series for each channel, and what the constant is likely to be.
    pub(super) responses: Vec<Response>,
}

#[derive(Clone, Debug)]
pub(super) struct Response {
    pub(super) what: Constant,
    pub(super) size: f64,
    pub(super) channels: Vec<Vec<f64>>,
}

/// A constant that is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Constant {
    /// Angle of a channel at the begin.
    Begin(usize),
    /// Gyro bias about a body axis.
    GyroBias(usize),
    /// Accelerometer bias, or iron, along a body axis.
    OtherBias(usize),
    /// Delay of the gyros against the other sensor.
    Delay,
    /// Sine or cosine of a line in the spectrum.
    Tone,
}

/// Level by the mean force of the first samples.
pub(super) fn level(readings: &[NoiseReading]) -> Start {
    let count = (readings.len() / 20).clamp(1, 20);
    let force: Vector3<f64> = readings[..count].iter().map(|r| r.specific_force_b).sum();
    let attitude = UnitQuaternion::rotation_between(&force, &Vector3::z()).unwrap_or_else(|| {
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), core::f64::consts::PI)
    });
    let norms: f64 = readings.iter().map(|r| r.specific_force_b.norm()).sum();
    Start {
        attitude,
        gyro_bias: Vector3::zeros(),
        gravity: norms / readings.len() as f64,
        field: None,
    }
}

/// The attitudes of all samples, by the gyros alone.
pub(super) fn attitudes(readings: &[NoiseReading], start: &Start) -> Vec<UnitQuaternion<f64>> {
    let mut attitude = start.attitude;
    let mut all = Vec::with_capacity(readings.len());
    all.push(attitude);
    for pair in readings.windows(2) {
        let step = pair[1].time.since(pair[0].time);
        let rate = 0.5 * (pair[0].angular_rate_b + pair[1].angular_rate_b) - start.gyro_bias;
        attitude = UnitQuaternion::new_normalize((attitude * exp(&(rate * step))).into_inner());
        all.push(attitude);
    }
    all
}

/// Turn the specific force into axes that stand still: tilt about x and y.
///
/// C_true = (1 + θ×) C, f_true = (0, 0, g): C f = (−g θ_y, g θ_x, g). A bias b of the gyros leaves θ − ∫C dt b.
pub(super) fn tilts(readings: &[NoiseReading], start: &Start) -> Turned {
    let all = attitudes(readings, start);
    let g = start.gravity;
    build(readings, &all, start, 2, ACCEL_BIAS, |c, reading| {
        let force = c * reading.specific_force_b;
        let rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Vector3::from);
        let other = [c.row(1).transpose(), -c.row(0).transpose()];
        (
            vec![force.y / g, -force.x / g],
            rows.to_vec(),
            other.to_vec(),
        )
    })
}

/// Turn the magnetic field: heading, with the tilt that its dip adds.
///
/// C m = m − θ × m with m = (h, 0, v): the y component over −h is θ_z − θ_x v/h.
pub(super) fn headings(readings: &[NoiseReading], start: &Start) -> Option<Turned> {
    let field = start.field?;
    let h = field.x;
    if h <= 0.0 || h.is_nan() {
        return None;
    }
    let all = attitudes(readings, start);
    Some(build(readings, &all, start, 1, IRON, |c, reading| {
        let angle = reading
            .magnetic_field_b
            .map_or(f64::NAN, |m| -(c * m).y / h);
        let row = Vector3::new(-field.z / h, 0.0, 1.0);
        (vec![angle], vec![row], vec![-c.row(1).transpose()])
    }))
}

/// Mean field over a window in the axes of a start that is turned by it: the horizontal part along x.
pub(super) fn with_field(readings: &[NoiseReading], start: &Start) -> Start {
    let all = attitudes(readings, start);
    let mut sum = Vector3::zeros();
    let mut count = 0;
    for (reading, attitude) in readings.iter().zip(&all) {
        if let Some(field) = reading.magnetic_field_b {
            sum += attitude * field;
            count += 1;
        }
    }
    if count == 0 {
        return *start;
    }
    let mean = sum / f64::from(count);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -mean.y.atan2(mean.x));
    Start {
        attitude: turn * start.attitude,
        field: Some(turn * mean),
        ..*start
    }
}

/// Angles, the row of (θ_x, θ_y, θ_z) that each channel sees, and the row of the sensor's own bias.
type Seen = (Vec<f64>, Vec<Vector3<f64>>, Vec<Vector3<f64>>);

fn build(
    readings: &[NoiseReading],
    attitudes: &[UnitQuaternion<f64>],
    start: &Start,
    channels: usize,
    other_size: f64,
    see: impl Fn(&Matrix3<f64>, &NoiseReading) -> Seen,
) -> Turned {
    let n = readings.len();
    let series = || vec![vec![0.0; n]; channels];
    let response = |what, size| Response {
        what,
        size,
        channels: series(),
    };
    let mut turned = Turned {
        channels: series(),
        responses: Vec::new(),
    };
    for channel in 0..channels {
        turned
            .responses
            .push(response(Constant::Begin(channel), f64::INFINITY));
    }
    turned
        .responses
        .extend((0..3).map(|k| response(Constant::GyroBias(k), GYRO_BIAS)));
    turned.responses.push(response(Constant::Delay, DELAY));
    turned
        .responses
        .extend((0..3).map(|k| response(Constant::OtherBias(k), other_size)));
    let mut integral = Matrix3::<f64>::zeros();
    let mut before: Option<Matrix3<f64>> = None;
    for (i, (reading, attitude)) in readings.iter().zip(attitudes).enumerate() {
        let c = attitude.to_rotation_matrix().into_inner();
        if let Some(before) = before {
            let step = reading.time.since(readings[i - 1].time);
            integral += (before + c) * (0.5 * step);
        }
        before = Some(c);
        let rate = c * (reading.angular_rate_b - start.gyro_bias);
        let (angles, rows, other) = see(&c, reading);
        for channel in 0..channels {
            turned.channels[channel][i] = angles[channel];
            turned.responses[channel].channels[channel][i] = 1.0;
            let biased = integral.transpose() * rows[channel];
            for k in 0..3 {
                turned.responses[channels + k].channels[channel][i] = -biased[k];
                turned.responses[channels + 4 + k].channels[channel][i] = other[channel][k];
            }
            turned.responses[channels + 3].channels[channel][i] = rows[channel].dot(&rate);
        }
    }
    // A bias of the magnetometer is in units of the horizontal field, one of the accelerometer in those of gravity: rows as they are.
    turned
}

/// Means over `averaged` samples each, of what is measured. `None` where a mean would be of nothing.
///
/// Exact for this model: the mean of a random walk over a block is that of blocks as steps, with q of a block, and r less a
/// sixth of that.
pub(super) fn average(turned: &Turned, averaged: usize) -> Option<Turned> {
    let mean = |series: &[f64], by: &[f64]| -> Option<Vec<f64>> {
        series
            .chunks_exact(averaged)
            .zip(by.chunks_exact(averaged))
            .map(|(chunk, by)| {
                let mut sum = 0.0;
                let mut count = 0;
                for (value, by) in chunk.iter().zip(by) {
                    if by.is_finite() {
                        sum += value;
                        count += 1;
                    }
                }
                (count > 0).then(|| sum / f64::from(count))
            })
            .collect()
    };
    let each = |series: &[Vec<f64>]| -> Option<Vec<Vec<f64>>> {
        series
            .iter()
            .zip(&turned.channels)
            .map(|(s, by)| mean(s, by))
            .collect()
    };
    Some(Turned {
        channels: each(&turned.channels)?,
        responses: turned
            .responses
            .iter()
            .map(|r| {
                Some(Response {
                    what: r.what,
                    size: r.size,
                    channels: each(&r.channels)?,
                })
            })
            .collect::<Option<_>>()?,
    })
}
