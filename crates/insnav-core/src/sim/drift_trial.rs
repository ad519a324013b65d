//! The experiment of \[Lobusov14\]: drifts and azimuth of a navigation-grade unit from two stops, and what is left of them.
//!
//! 200 Hz increments, latitude 60°, azimuth 45°, drifts of 1e-7 rad/s, stops at 40–200 s and 220–380 s. The paper does not tell its
//! second position, its loop or its rocking: the unit is turned by 180° about the vertical here, and rocks by 0.04 rad in roll
//! and pitch (7 s and 11 s) with a lever arm of (0.5, 0.5, −1.0) m.

use super::rocking::{BodyTurn, Rocking, RockingErrors, RockingTone, to_increments};
use crate::alignment::{
    AlignmentMethod, AlignmentOptions, AlignmentResult, Record, StopWindow, Taper, align,
    rate_limit,
};
use crate::attitude::{Euler, exp, log};
use crate::earth::{EARTH_RATE, Geodetic, gravity};
use crate::error::Result;
use crate::imu::{ImuErrors, ImuNoise, STANDARD_GRAVITY};
use crate::mechanization::{Increment, NavState};
use crate::sample::ImuIncrement;
use crate::time::Time;
use core::f64::consts::PI;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// One micro-g, m/s².
const UG: f64 = 1e-6 * STANDARD_GRAVITY;
const RATE_HZ: f64 = 200.0;
/// Both stops, s.
const STOPS: [[f64; 2]; 2] = [[40.0, 200.0], [220.0, 380.0]];
/// Four shorter ones, a quarter turn apart, s.
const FOUR_STOPS: [[f64; 2]; 4] = [
    [40.0, 120.0],
    [140.0, 220.0],
    [240.0, 320.0],
    [340.0, 420.0],
];
/// Free run after the last stop, s.
const HOUR: f64 = 3600.0;
/// A drift, rad/s.
const DRIFT: f64 = 1e-7;
/// The azimuth that the stops begin with.
const AZIMUTH_DEG: f64 = 45.0;

/// What is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriftCase {
    /// Still, without noise.
    StaticNoiseFree,
    /// Rocking, without noise, with 50 µg of accelerometer bias.
    SwayNoiseFree,
    /// Still, increments of 1″ and 1 mm/s.
    Quantised,
    /// Still, 500 µg of accelerometer bias on every axis.
    AccelBias,
    /// Still, 0.001 °/√h, 5 µg/√Hz, 50 µg, drifts and biases by chance.
    RealisticNoise,
    /// One stop whose azimuth is known.
    Zupt2,
    /// An hour of free run after the stops.
    FreeRun,
    /// Still, without noise, 50 µg of accelerometer bias, four stops of 80 s a quarter turn apart.
    FourPositions,
    /// The same with the noise, drifts and biases of `RealisticNoise`.
    FourPositionsNoise,
}

/// Which estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriftVariant {
    /// Our reading of the paper's equations.
    Paper,
    /// The joint tapered regression.
    Joint,
    /// The batch Kalman filter.
    Kalman,
    /// No compensation: the azimuth of a gyrocompass and no drift.
    None,
}

/// What one estimator left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriftErrors {
    /// Estimate minus truth, body axes, rad/s.
    pub drift: Vector3<f64>,
    /// Its stated standard deviations.
    pub drift_sigma: Vector3<f64>,
    /// Heading error at the last stop's end, rad, and its stated standard deviation.
    pub azimuth: f64,
    /// Likewise.
    pub azimuth_sigma: f64,
    /// Largest horizontal velocity in an hour of free run, m/s, where one was made.
    pub velocity_max: Option<f64>,
    /// Largest change of its heading error, rad, likewise.
    pub yaw_max: Option<f64>,
}

/// One point of the paper's figures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriftPoint {
    /// Seconds since the begin.
    pub time_s: f64,
    /// Drifts along the level axes (forward, right) by ZUPT-2 with the data so far, rad/s; 0 until 80 s.
    pub level_drift: [f64; 2],
    /// Change of attitude since the begin of navigation, rotation vector, n, rad.
    pub turned_n: Vector3<f64>,
    /// Horizontal velocity, north and east, m/s.
    pub velocity_n: [f64; 2],
}

/// One point of our own rocking stop, in place of the paper's figure 5.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwayPoint {
    /// Seconds since the begin.
    pub time_s: f64,
    /// Roll and pitch, rad.
    pub level: [f64; 2],
    /// Velocity of the unit as it swings, north and east, m/s.
    pub velocity_n: [f64; 2],
    /// Largest component of the drift's error by ZUPT-2 with the data so far, with the taper and without, rad/s; NaN until the stop
    /// is long enough, and where the method refuses.
    pub drift_error: [f64; 2],
}

impl DriftCase {
    /// All, in the order of the table.
    pub const ALL: [DriftCase; 9] = [
        DriftCase::StaticNoiseFree,
        DriftCase::SwayNoiseFree,
        DriftCase::Quantised,
        DriftCase::AccelBias,
        DriftCase::RealisticNoise,
        DriftCase::Zupt2,
        DriftCase::FreeRun,
        DriftCase::FourPositions,
        DriftCase::FourPositionsNoise,
    ];

    /// Whether chance enters.
    pub fn is_random(self) -> bool {
        matches!(
            self,
            DriftCase::RealisticNoise | DriftCase::FourPositionsNoise
        )
    }

    /// The estimators that are compared.
    pub fn variants(self) -> &'static [DriftVariant] {
        use DriftVariant::{Joint, Kalman, None, Paper};
        match self {
            // Its prior pulls a drift of one sigma by some per cent: without noise it has nothing to show.
            DriftCase::RealisticNoise => &[Paper, Joint, Kalman],
            DriftCase::FreeRun => &[None, Paper, Joint],
            // The paper's equations are of two positions.
            DriftCase::FourPositions => &[Joint],
            DriftCase::FourPositionsNoise => &[Joint, Kalman],
            _ => &[Paper, Joint],
        }
    }

    /// Begin and end of its stops, s.
    fn stops(self) -> &'static [[f64; 2]] {
        match self {
            DriftCase::Zupt2 => &STOPS[..1],
            DriftCase::FourPositions | DriftCase::FourPositionsNoise => &FOUR_STOPS,
            _ => &STOPS,
        }
    }
}

/// The experiment with one set of drifts.
#[derive(Clone, Debug)]
pub struct DriftTrial {
    case: DriftCase,
    body: Rocking,
    exact: Vec<ImuIncrement>,
    drift: Vector3<f64>,
}

impl DriftTrial {
    /// Of a case. Without a part along east, drifts are the paper's (1, −1, 1)·1e-7 rad/s along right, forward and up: at an azimuth
    /// of 45° they leave the azimuth nothing to correct. With one they are (1, 1, 1)·1e-7 along forward, right and down.
    pub fn new(case: DriftCase, east: bool) -> Self {
        let mut body = Rocking::standing(
            Geodetic::from_degrees(60.0, 30.0, 0.0),
            Euler::from_degrees(0.0, 0.0, AZIMUTH_DEG),
        );
        let stops = case.stops();
        for pair in stops.windows(2) {
            body.turns.push(BodyTurn {
                begin_s: pair[0][1],
                duration_s: pair[1][0] - pair[0][1],
                rotation_b: Vector3::z() * (2.0 * PI / stops.len() as f64),
            });
        }
        if case == DriftCase::SwayNoiseFree {
            rock(&mut body);
        }
        let end = stops[stops.len() - 1][1];
        let length = match case {
            DriftCase::FreeRun => end + HOUR,
            _ => end,
        };
        DriftTrial {
            case,
            exact: body.increments(length, RATE_HZ),
            body,
            // Right, forward, up are y, x and −z.
            drift: if east {
                Vector3::repeat(DRIFT)
            } else {
                Vector3::new(-DRIFT, DRIFT, -DRIFT)
            },
        }
    }

    /// The unit of the noisy case: what the filters are told in all cases.
    pub fn noise() -> ImuNoise {
        ImuNoise {
            gyro_white: 0.001f64.to_radians() / 60.0,
            accel_white: 5.0 * UG,
            gyro_bias_sigma: DRIFT,
            accel_bias_sigma: 50.0 * UG,
            gyro_bias_tau: f64::INFINITY,
            accel_bias_tau: f64::INFINITY,
        }
    }

    /// Standard deviations that no unbiased estimator goes below with that noise: horizontal drift, rad/s, and azimuth, rad.
    pub fn limits(&self) -> [f64; 2] {
        let length = STOPS[0][1] - STOPS[0][0];
        let rate = rate_limit(&Self::noise(), gravity(&self.body.position), length);
        let horizontal = EARTH_RATE * self.body.position.latitude.cos();
        [rate / 2f64.sqrt(), rate / (2f64.sqrt() * horizontal)]
    }

    fn errors(&self, seed: u64) -> RockingErrors {
        let mut errors = RockingErrors {
            constant: ImuErrors {
                gyro_bias: self.drift,
                ..ImuErrors::default()
            },
            ..RockingErrors::default()
        };
        match self.case {
            DriftCase::SwayNoiseFree | DriftCase::FourPositions => {
                errors.constant.accel_bias = Vector3::repeat(50.0 * UG);
            }
            DriftCase::AccelBias => errors.constant.accel_bias = Vector3::repeat(500.0 * UG),
            DriftCase::Quantised => errors.quantum = [1f64.to_radians() / 3600.0, 1e-3],
            DriftCase::RealisticNoise | DriftCase::FourPositionsNoise => {
                let noise = Self::noise();
                let mut source = super::Source::new(seed, super::Stream::Initial);
                errors.constant.gyro_bias = source.normal3() * noise.gyro_bias_sigma;
                errors.constant.accel_bias = source.normal3() * noise.accel_bias_sigma;
                errors.white = [noise.gyro_white, noise.accel_white];
            }
            _ => {}
        }
        errors
    }

    /// What the estimators of the case leave, in the order of [`DriftCase::variants`].
    ///
    /// # Errors
    /// Those of [`align`].
    pub fn run(&self, seed: u64) -> Result<Vec<DriftErrors>> {
        let errors = self.errors(seed);
        let samples = errors.apply(&self.exact, seed);
        let increments = to_increments(&samples);
        let record = Record::new(increments.iter().copied());
        self.case
            .variants()
            .iter()
            .map(|variant| self.estimate(*variant, &record, &increments, &errors.constant))
            .collect()
    }

    fn estimate(
        &self,
        variant: DriftVariant,
        record: &Record,
        increments: &[Increment],
        truth: &ImuErrors,
    ) -> Result<DriftErrors> {
        let window = |[begin, end]: [f64; 2]| StopWindow {
            begin: Time::from_seconds(begin),
            end: Time::from_seconds(end),
        };
        let one = self.case == DriftCase::Zupt2;
        let stops: Vec<StopWindow> = self.case.stops().iter().copied().map(window).collect();
        let mut options = AlignmentOptions::new(self.body.position, Self::noise());
        options.gyro_scale_sigma = 0.0;
        if one {
            options.heading = Some((AZIMUTH_DEG.to_radians(), 1e-9));
        }
        options.method = match variant {
            DriftVariant::Paper => AlignmentMethod::Paper,
            DriftVariant::Kalman => AlignmentMethod::Kalman,
            DriftVariant::Joint if one => AlignmentMethod::Zupt2,
            DriftVariant::Joint => AlignmentMethod::Joint,
            DriftVariant::None => AlignmentMethod::Coarse,
        };
        if self.case.is_random() {
            options.taper = Some(Taper::None);
        }
        let found = if variant == DriftVariant::None {
            options.largest_azimuth_sigma = PI;
            let mut first = align(record, &stops[..1], &options)?;
            // The gyros carry it to the second stop.
            let turned =
                self.body.attitude_at(STOPS[1][1]) * self.body.attitude_at(STOPS[0][1]).inverse();
            first.q_nb = turned * first.q_nb;
            first.at = stops[1].end;
            first
        } else {
            align(record, &stops, &options)?
        };
        let free = (self.case == DriftCase::FreeRun).then(|| self.free_run(&found, increments));
        let sigma = found.sigma();
        let truth_nb = self.body.attitude_at(found.at.seconds());
        Ok(DriftErrors {
            drift: found.gyro_bias - truth.gyro_bias,
            drift_sigma: Vector3::new(sigma[3], sigma[4], sigma[5]),
            azimuth: log(&(found.q_nb * truth_nb.inverse())).z,
            azimuth_sigma: sigma[2],
            velocity_max: free.map(|f| f[0]),
            yaw_max: free.map(|f| f[1]),
        })
    }

    /// Largest horizontal velocity and largest change of the heading error in a free run, the height held, with what was found
    /// taken out.
    fn free_run(&self, found: &AlignmentResult, increments: &[Increment]) -> [f64; 2] {
        let corrections = ImuErrors {
            gyro_bias: found.gyro_bias,
            accel_bias: found.accel_bias,
            ..ImuErrors::default()
        };
        let mut nav = self.at_rest(found.at, found.q_nb);
        let stands = self.body.attitude_at(found.at.seconds()).inverse();
        let heading = |nav: &NavState| log(&(nav.q_nb * stands)).z;
        let begin = heading(&nav);
        let mut largest = [0f64; 2];
        for increment in increments.iter().filter(|i| i.time > found.at) {
            advance(&mut nav, &increment.corrected(&corrections));
            let here = [nav.velocity_n.xy().norm(), (heading(&nav) - begin).abs()];
            largest = [largest[0].max(here[0]), largest[1].max(here[1])];
        }
        largest
    }

    fn at_rest(&self, time: Time, q_nb: UnitQuaternion<f64>) -> NavState {
        NavState {
            time,
            position: self.body.position,
            velocity_n: Vector3::zeros(),
            q_nb,
        }
    }

    /// A rocking stop without noise, as that of `SwayNoiseFree` in one position with its azimuth known: how the body moves, and what
    /// ZUPT-2 makes of the data so far. A point each half second.
    pub fn sway_figure(east: bool) -> Vec<SwayPoint> {
        let mut trial = DriftTrial::new(DriftCase::Zupt2, east);
        rock(&mut trial.body);
        trial.exact = trial.body.increments(STOPS[0][1], RATE_HZ);
        let mut errors = trial.errors(0);
        errors.constant.accel_bias = Vector3::repeat(50.0 * UG);
        let increments = to_increments(&errors.apply(&trial.exact, 0));
        let record = Record::new(increments.iter().copied());
        let mut options = AlignmentOptions::new(trial.body.position, Self::noise());
        options.method = AlignmentMethod::Zupt2;
        options.heading = Some((AZIMUTH_DEG.to_radians(), 1e-9));
        options.gyro_scale_sigma = 0.0;
        let begin = STOPS[0][0];
        (0..=(2.0 * STOPS[0][1]) as u32)
            .map(|i| {
                let t = 0.5 * f64::from(i);
                let stop = StopWindow {
                    begin: Time::from_seconds(begin),
                    end: Time::from_seconds(t),
                };
                let miss = |taper| {
                    if t < begin + 40.0 {
                        return f64::NAN;
                    }
                    let mut options = options;
                    options.taper = Some(taper);
                    align(&record, &[stop], &options).map_or(f64::NAN, |found| {
                        (found.gyro_bias - errors.constant.gyro_bias).amax()
                    })
                };
                let level = Euler::from_quaternion(&trial.body.attitude_at(t));
                let swing = trial.body.swing_at(t);
                SwayPoint {
                    time_s: t,
                    level: [level.roll, level.pitch],
                    velocity_n: [swing.x, swing.y],
                    drift_error: [miss(Taper::HannSquared), miss(Taper::None)],
                }
            })
            .collect()
    }

    /// The paper's figures 1–4 in one position without a turn: drifts by ZUPT-2 from 40 s on with the data so far, and a free run
    /// of 250 s from the true attitude that is compensated and set to rest at 200 s. A point a second.
    ///
    /// # Errors
    /// Those of [`align`].
    pub fn figures(east: bool) -> Result<Vec<DriftPoint>> {
        let mut trial = DriftTrial::new(DriftCase::Zupt2, east);
        trial.exact = trial.body.increments(250.0, RATE_HZ);
        let errors = trial.errors(0);
        let increments = to_increments(&errors.apply(&trial.exact, 0));
        let record = Record::new(increments.iter().copied());
        let mut options = AlignmentOptions::new(trial.body.position, Self::noise());
        options.method = AlignmentMethod::Zupt2;
        options.heading = Some((AZIMUTH_DEG.to_radians(), 1e-9));
        options.gyro_scale_sigma = 0.0;
        let window = |begin: f64, end: f64| StopWindow {
            begin: Time::from_seconds(begin),
            end: Time::from_seconds(end),
        };
        let found = align(&record, &[window(STOPS[0][0], STOPS[0][1])], &options)?;
        let compensated = ImuErrors {
            gyro_bias: found.gyro_bias,
            accel_bias: found.accel_bias,
            ..ImuErrors::default()
        };
        let begin = trial.body.attitude_at(0.0);
        let mut nav = trial.at_rest(Time(0), begin);
        let mut points = Vec::new();
        let mut drift = [0.0; 2];
        for increment in &increments {
            let t = increment.time.seconds();
            let after = t > STOPS[0][1];
            let said = if after {
                increment.corrected(&compensated)
            } else {
                *increment
            };
            advance(&mut nav, &said);
            let whole = t.fract() < 0.5 / RATE_HZ || t.fract() > 1.0 - 0.5 / RATE_HZ;
            if !whole {
                continue;
            }
            if (STOPS[0][0] + 40.0..=STOPS[0][1]).contains(&t.round()) {
                let so_far = align(&record, &[window(STOPS[0][0], t.round())], &options)?;
                let level = exp(&Vector3::new(0.0, 0.0, -AZIMUTH_DEG.to_radians())) * begin;
                let level_rate = level * so_far.gyro_bias;
                drift = [level_rate.x, level_rate.y];
            }
            points.push(DriftPoint {
                time_s: t,
                level_drift: drift,
                turned_n: log(&(nav.q_nb * begin.inverse())),
                velocity_n: [nav.velocity_n.x, nav.velocity_n.y],
            });
            if (t - STOPS[0][1]).abs() < 0.5 / RATE_HZ {
                nav.velocity_n = Vector3::zeros();
                nav.q_nb = found.q_nb;
            }
        }
        Ok(points)
    }
}

/// Roll and pitch of 0.04 rad, the unit beside what they are about.
fn rock(body: &mut Rocking) {
    let tone = |axis, period_s, phase| RockingTone {
        axis,
        amplitude: 0.04,
        period_s,
        phase,
    };
    body.tones = std::vec![tone(0, 7.0, 0.3), tone(1, 11.0, 1.0)];
    body.lever_b = Vector3::new(0.5, 0.5, -1.0);
}

/// One increment on, the height held.
fn advance(nav: &mut NavState, increment: &Increment) {
    nav.advance(increment);
    nav.velocity_n.z = 0.0;
    nav.position.height = 0.0;
}
