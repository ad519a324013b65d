//! An ADIS16405 in one's hand: gyros, accelerometers and magnetometers every 32 ms, as \[Belokurov18\] recorded them.

use super::{Source, Stream};
use crate::ahrs::{AttitudeChannelNoise, innovation_n};
use crate::attitude::{Euler, exp};
use crate::imu::STANDARD_GRAVITY;
use crate::noise::{ChannelNoise, bias_noise_per_step};
use core::f64::consts::TAU;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// Period of the samples, s.
pub const ADIS16405_STEP_S: f64 = 0.032;
/// Angle random walk, 2 °/√h, rad/√s: white noise of the rate (the paper has it as a drift of zero).
const ANGLE_RANDOM_WALK: f64 = 2.0 / 60.0 * TAU / 360.0;
/// Velocity random walk, 0.2 m/s/√h, m/s/√s (the paper has 0.2 mg/√h, mixed up with the bias stability of 0.2 mg).
const VELOCITY_RANDOM_WALK: f64 = 0.2 / 60.0;
/// In-run bias stability of the gyros, 0.007 °/s, rad/s.
const BIAS_STABILITY: f64 = 0.007 * TAU / 360.0;
/// Time over which it wanders so far, s. The data sheet has none; the lowest point of its Allan curve is near.
const BIAS_TIME_S: f64 = 100.0;
/// Bias at power-on, one sigma, rad/s: a sixth of the ±3 °/s of the data sheet, as the recorded unit has it.
const BIAS_AT_START: f64 = 0.5 * TAU / 360.0;
/// Magnetometer noise, 0.066 mG/√Hz, T/√Hz.
const FIELD_NOISE: f64 = 0.066e-7;
/// Counts: 0.05 °/s, 3.33 mg, 0.5 mG.
const RATE_COUNT: f64 = 0.05 * TAU / 360.0;
const FORCE_COUNT: f64 = 3.33e-3 * STANDARD_GRAVITY;
const FIELD_COUNT: f64 = 0.5e-7;
/// Ryazan: 20 µT northward, 45 µT down; north is magnetic.
const FIELD_N: Vector3<f64> = Vector3::new(20e-6, 0.0, 45e-6);
/// What a tilt about north adds to the heading: the tangent of the dip.
const HEADING_BY_TILT: f64 = 45.0 / 20.0;
const DURATION_S: f64 = 180.0;
/// Turning to and fro about the three axes, Hz.
const TURNING_HZ: [f64; 3] = [0.31, 0.27, 0.23];
/// Vibration: from, to (s), factor on the accelerometers' noise; it has a longer record.
const VIBRATION: [f64; 3] = [100.0, 200.0, 5.0];
const VIBRATION_RECORD_S: f64 = 250.0;
/// A field of iron: from, to (s), share of the Earth's.
const IRON: [f64; 3] = [80.0, 110.0, 0.1];
/// Pushes last so long, and come after so long, s. The first one comes within three seconds, before a filter has converged.
const PUSH_S: [f64; 2] = [0.5, 2.0];
const BETWEEN_PUSHES_S: [f64; 2] = [3.0, 9.0];

/// What happens in three minutes, with vibration in four.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AttitudeCase {
    /// At rest, values not rounded.
    Static,
    /// At rest, rounded to counts: 3.33 mg are 0.19°.
    StaticQuantised,
    /// Turning to and fro about all axes, 6 °/s root mean square.
    Motion6Dps,
    /// Likewise, 40 °/s.
    Motion40Dps,
    /// At rest, five times the accelerometer noise for 100 s.
    Vibration,
    /// Pushes of 0.3 m/s² in any horizontal direction.
    Bursts0p3,
    /// Pushes of 1 m/s².
    Bursts1p0,
    /// A tenth of the Earth's field in any direction, for 30 s.
    MagneticStep,
}

impl AttitudeCase {
    /// All of them.
    pub const ALL: [AttitudeCase; 8] = [
        AttitudeCase::Static,
        AttitudeCase::StaticQuantised,
        AttitudeCase::Motion6Dps,
        AttitudeCase::Motion40Dps,
        AttitudeCase::Vibration,
        AttitudeCase::Bursts0p3,
        AttitudeCase::Bursts1p0,
        AttitudeCase::MagneticStep,
    ];

    /// Whether the noise is the same all the time, and nothing else disturbs: then a filter that knows it is the best there is.
    pub fn is_stationary(self) -> bool {
        use AttitudeCase::*;
        matches!(self, Static | StaticQuantised | Motion6Dps | Motion40Dps)
    }

    fn rate_rms(self) -> f64 {
        match self {
            AttitudeCase::Motion6Dps => 6f64.to_radians(),
            AttitudeCase::Motion40Dps => 40f64.to_radians(),
            _ => 0.0,
        }
    }

    fn push(self) -> Option<f64> {
        match self {
            AttitudeCase::Bursts0p3 => Some(0.3),
            AttitudeCase::Bursts1p0 => Some(1.0),
            _ => None,
        }
    }
}

/// One sample, and what is true of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSample {
    /// Mean over the step before, rad/s.
    pub rate_b: Vector3<f64>,
    /// At the end of the step, m/s².
    pub specific_force_b: Vector3<f64>,
    /// At the end of the step, T; `None` without a magnetometer.
    pub field_b: Option<Vector3<f64>>,
    /// The attitude then; `None` of a real unit.
    pub truth_q_nb: Option<UnitQuaternion<f64>>,
    /// Factor on the accelerometer noise.
    pub vibration: f64,
    /// A push or a field of iron is there.
    pub disturbed: [bool; 2],
}

/// Samples every [`step_s`](Self::step_s) of one unit.
#[derive(Clone, Debug, PartialEq)]
pub struct AttitudeRecord {
    /// Period, s.
    pub step_s: f64,
    /// In the order of time.
    pub samples: Vec<AttitudeSample>,
    /// Noise by the data sheet, without rounding.
    pub datasheet: AttitudeChannelNoise,
    /// Noise as it is, vibration apart.
    pub truth: AttitudeChannelNoise,
    /// Covariance of measured heading and tilt about north at rest, rad².
    pub heading_with_tilt: f64,
    /// Driving noise of a gyro's bias, (rad/s)² per step.
    pub bias_noise: f64,
    /// One sigma of a gyro's bias at the begin, rad/s.
    pub initial_bias: f64,
}

impl AttitudeRecord {
    /// A record of a simulated unit, body axes forward-right-down.
    ///
    /// The body turns at a constant rate within each step, so that the truth is exact; gyro biases are drawn at power-on and walk
    /// at random with the driving noise that the bias stability has. Accelerometer biases are left out: gravity alone does not
    /// show them, and they are in every variant's error alike.
    pub fn simulate(case: AttitudeCase, seed: u64) -> Self {
        let quantised = case == AttitudeCase::StaticQuantised;
        let step = ADIS16405_STEP_S;
        let mut route = Source::new(seed, Stream::Route);
        let [mut gyro, mut wander, mut accel, mut magnetic] = [
            Stream::GyroWhite,
            Stream::GyroBias,
            Stream::AccelWhite,
            Stream::FieldWhite,
        ]
        .map(|stream| Source::new(seed, stream));
        let bias_noise = bias_noise_per_step(BIAS_STABILITY, BIAS_TIME_S, step);
        let mut q_nb = Euler {
            roll: route.between(-0.1, 0.1),
            pitch: route.between(-0.1, 0.1),
            heading: route.between(0.0, TAU),
        }
        .to_quaternion();
        // Cosines: the angles go to and fro about the first attitude.
        let signs = [(); 3].map(|()| if route.uniform() < 0.5 { -1.0 } else { 1.0 });
        let pushes = Pushes::draw(&mut route);
        let iron_n = direction(&mut route) * (IRON[2] * FIELD_N.norm());
        // Root mean square of the whole from three cosines.
        let amplitude = case.rate_rms() * (2.0f64 / 3.0).sqrt();
        let mut bias = wander.normal3() * BIAS_AT_START;
        let duration = if case == AttitudeCase::Vibration {
            VIBRATION_RECORD_S
        } else {
            DURATION_S
        };
        let count = (duration / step) as usize;
        let samples = (1..=count)
            .map(|k| {
                let time = k as f64 * step;
                let rate = Vector3::from_fn(|i, _| {
                    amplitude * signs[i] * (TAU * TURNING_HZ[i] * time).cos()
                });
                q_nb *= exp(&(rate * step));
                q_nb.renormalize_fast();
                let rate_b = rate + bias + gyro.normal3() * (ANGLE_RANDOM_WALK / step.sqrt());
                bias += wander.normal3() * bias_noise.sqrt();
                let shaken =
                    case == AttitudeCase::Vibration && (VIBRATION[0]..VIBRATION[1]).contains(&time);
                let vibration = if shaken { VIBRATION[2] } else { 1.0 };
                let push_n = case.push().and_then(|size| Some(pushes.at(time)? * size));
                let force_n =
                    Vector3::new(0.0, 0.0, -STANDARD_GRAVITY) + push_n.unwrap_or_default();
                let near_iron =
                    case == AttitudeCase::MagneticStep && (IRON[0]..IRON[1]).contains(&time);
                let field_n = FIELD_N + iron_n * f64::from(u8::from(near_iron));
                let force_noise =
                    accel.normal3() * (vibration * VELOCITY_RANDOM_WALK / step.sqrt());
                let field_noise = magnetic.normal3() * (FIELD_NOISE / step.sqrt());
                let round = |v: Vector3<f64>, count: f64| {
                    if quantised {
                        v.map(|x| (x / count).round() * count)
                    } else {
                        v
                    }
                };
                AttitudeSample {
                    rate_b: round(rate_b, RATE_COUNT),
                    specific_force_b: round(q_nb.inverse() * force_n + force_noise, FORCE_COUNT),
                    field_b: Some(round(q_nb.inverse() * field_n + field_noise, FIELD_COUNT)),
                    truth_q_nb: Some(q_nb),
                    vibration,
                    disturbed: [push_n.is_some(), near_iron],
                }
            })
            .collect();
        let rounding = f64::from(u8::from(quantised)) / 12.0;
        AttitudeRecord {
            step_s: step,
            samples,
            datasheet: noise(0.0),
            truth: noise(rounding),
            heading_with_tilt: HEADING_BY_TILT * noise(rounding).tilt[0].measured,
            bias_noise,
            initial_bias: BIAS_AT_START,
        }
    }

    /// A real unit at rest: samples of rate and specific force (body, SI; time in s) put into steps of 32 ms, without a truth.
    ///
    /// Its magnetometer is simulated, level by the mean force and looking north: the six states of the scheme are not observable
    /// without one, and methods that make Q of gains then drift away with the heading.
    /// Each sample stands until the next; a step has the mean over it. Of a unit at rest the tilt's own variance is measured, from
    /// the differences of neighbouring steps. A gap longer than a step ends the record.
    pub fn resample(samples: &[(f64, Vector3<f64>, Vector3<f64>)]) -> Self {
        let step = ADIS16405_STEP_S;
        let mut found: Vec<AttitudeSample> = Vec::new();
        let (mut rate, mut force, mut filled) = (Vector3::zeros(), Vector3::zeros(), 0.0);
        'record: for pair in samples.windows(2) {
            let (_, w, f) = pair[0];
            let mut left = pair[1].0 - pair[0].0;
            if !(left > 0.0 && left <= step) {
                break 'record;
            }
            while left > 0.0 {
                let part = left.min(step - filled);
                rate += w * part;
                force += f * part;
                filled += part;
                left -= part;
                // What rounding leaves of a step is no step.
                if step - filled > 1e-9 {
                    continue;
                }
                found.push(AttitudeSample {
                    rate_b: rate / filled,
                    specific_force_b: force / filled,
                    field_b: None,
                    truth_q_nb: None,
                    vibration: 1.0,
                    disturbed: [false; 2],
                });
                (rate, force, filled) = (Vector3::zeros(), Vector3::zeros(), 0.0);
            }
        }
        let mean: Vector3<f64> = found.iter().map(|s| s.specific_force_b).sum();
        let level = innovation_n(&UnitQuaternion::identity(), Some(&mean), None)
            .levelling()
            .unwrap_or_default();
        let mut magnetic = Source::new(0, Stream::FieldWhite);
        for sample in &mut found {
            let noise = magnetic.normal3() * (FIELD_NOISE / step.sqrt());
            sample.field_b = Some(level.inverse() * FIELD_N + noise);
        }
        let mut truth = noise(0.0);
        let axis = |i: usize| {
            let differences = found
                .windows(2)
                .map(|pair| (pair[1].specific_force_b[i] - pair[0].specific_force_b[i]).powi(2));
            let mean = differences.sum::<f64>() / (2.0 * found.len().max(2) as f64);
            mean / STANDARD_GRAVITY.powi(2)
        };
        let measured = 0.5 * (axis(0) + axis(1));
        truth.heading.measured += HEADING_BY_TILT.powi(2) * (measured - truth.tilt[0].measured);
        for tilt in &mut truth.tilt {
            tilt.measured = measured;
        }
        AttitudeRecord {
            step_s: step,
            samples: found,
            datasheet: noise(0.0),
            truth,
            heading_with_tilt: HEADING_BY_TILT * measured,
            bias_noise: bias_noise_per_step(BIAS_STABILITY, BIAS_TIME_S, step),
            initial_bias: BIAS_AT_START,
        }
    }

    /// Whole pieces of so many seconds, one after the other.
    pub fn slices(&self, seconds: f64) -> Vec<AttitudeRecord> {
        let length = ((seconds / self.step_s) as usize).max(1);
        let slice = |samples: &[AttitudeSample]| AttitudeRecord {
            samples: samples.to_vec(),
            ..*self
        };
        self.samples.chunks_exact(length).map(slice).collect()
    }
}

/// Noise of the angles; `rounding`: variance of it in squared counts.
fn noise(rounding: f64) -> AttitudeChannelNoise {
    let step = ADIS16405_STEP_S;
    let process = ANGLE_RANDOM_WALK.powi(2) * step + rounding * (RATE_COUNT * step).powi(2);
    let tilt = (VELOCITY_RANDOM_WALK.powi(2) / step + rounding * FORCE_COUNT.powi(2))
        / STANDARD_GRAVITY.powi(2);
    let field = FIELD_NOISE.powi(2) / step + rounding * FIELD_COUNT.powi(2);
    // A tilt about north turns the vertical part of the field into the horizontal plane.
    let heading = field / FIELD_N.x.powi(2) + HEADING_BY_TILT.powi(2) * tilt;
    let of = |measured| ChannelNoise { process, measured };
    AttitudeChannelNoise {
        tilt: [of(tilt); 2],
        heading: of(heading),
    }
}

/// Horizontal pushes: begin, end, direction.
struct Pushes(Vec<(f64, f64, Vector3<f64>)>);

impl Pushes {
    fn draw(source: &mut Source) -> Self {
        let mut pushes = Vec::new();
        let mut begin = source.between(0.1, BETWEEN_PUSHES_S[0]);
        while begin < DURATION_S {
            let end = begin + source.between(PUSH_S[0], PUSH_S[1]);
            let (east, north) = source.between(0.0, TAU).sin_cos();
            pushes.push((begin, end, Vector3::new(north, east, 0.0)));
            begin = end + source.between(BETWEEN_PUSHES_S[0], BETWEEN_PUSHES_S[1]);
        }
        Pushes(pushes)
    }

    fn at(&self, time: f64) -> Option<Vector3<f64>> {
        let within = |p: &&(f64, f64, Vector3<f64>)| (p.0..p.1).contains(&time);
        self.0.iter().find(within).map(|p| p.2)
    }
}

/// Any direction in space alike.
fn direction(source: &mut Source) -> Vector3<f64> {
    let v = source.normal3();
    v / v.norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::log;

    /// E17, E20: noise of the angles as the data sheet has it, from the samples themselves; with rounding and without.
    #[test]
    fn angles_have_the_noise_of_the_data_sheet() {
        for (case, tilt_deg) in [
            (AttitudeCase::Static, 0.1088),
            // 1.900 mg and 3.33/√12 mg: 2.129 mg.
            (AttitudeCase::StaticQuantised, 0.1220),
            (AttitudeCase::Motion40Dps, 0.1088),
        ] {
            let record = AttitudeRecord::simulate(case, 1);
            let mut squares = [0.0; 3];
            let mut turned = 0.0;
            for pair in record.samples.windows(2) {
                let (before, s) = (pair[0].truth_q_nb, &pair[1]);
                let truth = s.truth_q_nb.expect("simulated");
                let seen = innovation_n(&truth, Some(&s.specific_force_b), s.field_b.as_ref());
                let [north, east] = seen.tilt.expect("a force");
                for (sum, angle) in
                    squares
                        .iter_mut()
                        .zip([north, east, seen.heading.expect("a field")])
                {
                    *sum += angle * angle;
                }
                let moved = exp(&(s.rate_b * record.step_s)).inverse()
                    * (before.expect("simulated").inverse() * truth);
                turned += log(&moved).norm_squared() / 3.0;
            }
            let n = (record.samples.len() - 1) as f64;
            let truth = record.truth;
            for (sum, noise) in squares
                .iter()
                .zip([truth.tilt[0], truth.tilt[1], truth.heading])
            {
                // 5600 squares: ± 4 √(2/n) = 7.6 %.
                assert!((sum / n / noise.measured - 1.0).abs() < 0.076, "{case:?}");
            }
            let sigma = truth.tilt[0].measured.sqrt().to_degrees();
            assert!((sigma - tilt_deg).abs() < 1e-4, "{case:?} {sigma}");
            // Its bias, too: 0.5 °/s is a few times the noise of a step, squared.
            assert!(turned / n > 0.9 * truth.tilt[0].process, "{case:?}");
        }
    }

    #[test]
    fn what_happens_is_what_the_case_says() {
        for case in AttitudeCase::ALL {
            let record = AttitudeRecord::simulate(case, 2);
            let share = |of: &dyn Fn(&AttitudeSample) -> bool| {
                record.samples.iter().filter(|s| of(s)).count() as f64 / record.samples.len() as f64
            };
            let pushed = share(&|s| s.disturbed[0]);
            assert_eq!(
                case.push().is_some(),
                (0.1..0.3).contains(&pushed),
                "{case:?}"
            );
            let iron = share(&|s| s.disturbed[1]);
            let expected = if case == AttitudeCase::MagneticStep {
                1.0 / 6.0
            } else {
                0.0
            };
            assert!((iron - expected).abs() < 1e-3, "{case:?}");
            let pairs = record.samples.windows(2);
            let squares = pairs.map(|p| {
                let [a, b] = [p[0].truth_q_nb, p[1].truth_q_nb].map(|q| q.expect("simulated"));
                log(&(a.inverse() * b)).norm_squared() / ADIS16405_STEP_S.powi(2)
            });
            let rms = (squares.sum::<f64>() / record.samples.len() as f64).sqrt();
            assert!(
                (rms - case.rate_rms()).abs() < 0.02 * case.rate_rms() + 1e-9,
                "{case:?}"
            );
        }
    }

    #[test]
    fn means_over_steps_keep_the_integral() {
        let at = |i: u32| {
            let t = f64::from(i) * 0.01;
            (
                t,
                Vector3::new(t.sin(), 1.0, t),
                Vector3::new(0.0, 0.0, -9.8),
            )
        };
        let samples: Vec<_> = (0..=1000).map(at).collect();
        let record = AttitudeRecord::resample(&samples);
        assert_eq!(record.samples.len(), 312);
        let sum: Vector3<f64> = record.samples.iter().map(|s| s.rate_b * 0.032).sum();
        let expected: Vector3<f64> =
            (0..998).map(|i| at(i).1 * 0.01).sum::<Vector3<f64>>() + at(998).1 * 0.004;
        assert!((sum - expected).amax() < 1e-9, "{sum} {expected}");
        let mut gap = samples.clone();
        gap.drain(500..510);
        assert_eq!(AttitudeRecord::resample(&gap).samples.len(), 155);
        assert!(AttitudeRecord::resample(&[]).samples.is_empty());
    }
}
