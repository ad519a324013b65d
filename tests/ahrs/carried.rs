//! A sensor in somebody's hand: smooth random turns and moves with rest at both ends, and errors of known size.

use insnav::ahrs::{AhrsEpoch, AhrsSettings, Smoother};
use insnav::attitude::{Euler, exp, log};
use insnav::sample::{ImuSample, MagneticField};
use insnav::sim::{Source, Stream};
use insnav::time::Time;
use nalgebra::{UnitQuaternion, Vector3};

/// Field of Berlin, µT: north and down.
pub(crate) const FIELD: Vector3<f64> = Vector3::new(19.0, 0.0, 46.0);
const STEP: f64 = 0.01;
const TONES: usize = 6;

/// What is wrong with the sensor and the room.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Unit {
    pub(crate) seed: u64,
    /// Length of the record, s; 8 s of rest at both ends.
    pub(crate) duration: f64,
    /// Amplitude of the turns, rad, and of the velocity, m/s.
    pub(crate) turns: f64,
    pub(crate) velocity: f64,
    /// One sigma of the constant errors: °/s, m/s², share of the field, s.
    pub(crate) gyro_bias_deg_per_s: f64,
    pub(crate) accel_bias: f64,
    pub(crate) offset: f64,
    pub(crate) delay: f64,
    /// Sigma of the room's field, share of the Earth's.
    pub(crate) disturbance: f64,
}

impl Unit {
    pub(crate) fn new(seed: u64) -> Self {
        Unit {
            seed,
            duration: 80.0,
            turns: 0.6,
            velocity: 0.7,
            gyro_bias_deg_per_s: 0.5,
            accel_bias: 0.02,
            offset: 0.015,
            delay: 0.01,
            disturbance: 0.02,
        }
    }
}

/// Samples, fields and the truth at each sample; errors as drawn.
pub(crate) struct Record {
    pub(crate) samples: Vec<ImuSample>,
    pub(crate) fields: Vec<MagneticField>,
    pub(crate) truth: Vec<UnitQuaternion<f64>>,
    pub(crate) moving: Vec<bool>,
    pub(crate) offset: Vector3<f64>,
    pub(crate) delay: f64,
}

/// Sum of tones, zero at rest.
struct Wave([(f64, f64, f64); TONES]);

impl Wave {
    fn new(source: &mut Source, rms: f64, slowest: f64, fastest: f64) -> Self {
        Wave(core::array::from_fn(|i| {
            let at = (i as f64 + source.uniform()) / TONES as f64;
            let hertz = slowest * (fastest / slowest).powf(at);
            let amplitude = rms * (2.0 / TONES as f64).sqrt();
            (
                amplitude,
                hertz * std::f64::consts::TAU,
                source.uniform() * std::f64::consts::TAU,
            )
        }))
    }

    fn at(&self, t: f64) -> f64 {
        self.0
            .iter()
            .map(|(a, w, phase)| a * (w * t + phase).sin())
            .sum()
    }
}

/// Rises from rest and falls to it over two seconds.
fn envelope(t: f64, duration: f64) -> f64 {
    let ramp = |x: f64| {
        let x = x.clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
    };
    ramp((t - 8.0) / 2.0) * ramp((duration - 8.0 - t) / 2.0)
}

pub(crate) fn record(unit: &Unit) -> Record {
    let mut draw = Source::new(unit.seed, Stream::Initial);
    let mut route = Source::new(unit.seed, Stream::Route);
    let mut gyro = Source::new(unit.seed, Stream::GyroWhite);
    let mut accel = Source::new(unit.seed, Stream::AccelWhite);
    let mut mag = Source::new(unit.seed, Stream::PositionWhite);
    let mut room = Source::new(unit.seed, Stream::PositionColour);
    let settings = AhrsSettings::default();
    let noise = settings.noise;
    let gyro_bias = draw.normal3() * unit.gyro_bias_deg_per_s.to_radians();
    let accel_bias = draw.normal3() * unit.accel_bias;
    let offset = draw.normal3() * (unit.offset * FIELD.norm());
    let delay = draw.normal().abs() * unit.delay;
    let from = Euler::from_degrees(
        20.0 * draw.normal(),
        20.0 * draw.normal(),
        360.0 * draw.uniform(),
    );
    let turns: [Wave; 3] = core::array::from_fn(|_| Wave::new(&mut route, unit.turns, 0.1, 0.8));
    let moves: [Wave; 3] = core::array::from_fn(|_| Wave::new(&mut route, unit.velocity, 0.2, 2.0));
    let e = |t: f64| envelope(t, unit.duration);
    let attitude = |t: f64| {
        let angles = Vector3::from_fn(|i, _| turns[i].at(t)) * e(t);
        from.to_quaternion() * exp(&angles)
    };
    let velocity = |t: f64| Vector3::from_fn(|i, _| moves[i].at(t)) * e(t);
    let gravity = Vector3::new(0.0, 0.0, settings.gravity);
    let scale = FIELD.norm();
    let left = (-STEP / settings.field.disturbance_tau).exp();
    let drive = unit.disturbance * scale * (1.0 - left * left).sqrt();
    let mut disturbance = room.normal3() * unit.disturbance * scale;
    let mut out = Record {
        samples: Vec::new(),
        fields: Vec::new(),
        truth: Vec::new(),
        moving: Vec::new(),
        offset,
        delay,
    };
    for k in 0..(unit.duration / STEP) as u32 {
        let (t0, t) = (f64::from(k) * STEP, f64::from(k + 1) * STEP);
        let turn = log(&(attitude(t0).conjugate() * attitude(t)));
        let middle = attitude(0.5 * (t0 + t));
        let force = (velocity(t) - velocity(t0)) / STEP - gravity;
        let root = STEP.sqrt();
        let time = Time::from_seconds(t);
        out.samples.push(ImuSample {
            time,
            angular_rate_b: turn / STEP + gyro_bias + gyro.normal3() * (noise.gyro_white / root),
            specific_force_b: middle.conjugate() * force
                + accel_bias
                + accel.normal3() * (noise.accel_white / root),
        });
        // Its room changes as it is carried about.
        disturbance = disturbance * left + room.normal3() * drive;
        out.fields.push(MagneticField {
            time,
            field_b: attitude(t - delay).conjugate() * (FIELD + disturbance)
                + offset
                + mag.normal3() * (settings.field.sigma * scale),
        });
        out.truth.push(attitude(t));
        out.moving.push(e(t) > 0.5);
    }
    out
}

/// Causal and smoothed epochs, each with the index of its sample.
pub(crate) struct Estimates {
    pub(crate) causal: Vec<(usize, AhrsEpoch)>,
    pub(crate) smoothed: Vec<(usize, AhrsEpoch)>,
    pub(crate) delay: Option<(f64, f64)>,
    pub(crate) offset: Option<Vector3<f64>>,
}

pub(crate) fn estimate(record: &Record, settings: AhrsSettings, with_fields: bool) -> Estimates {
    let mut smoother = Smoother::new(settings).expect("settings");
    let mut causal = Vec::new();
    let mut fields = record.fields.iter().peekable();
    for (k, sample) in record.samples.iter().enumerate() {
        while let Some(field) = fields.next_if(|f| f.time <= sample.time) {
            if with_fields {
                smoother.field(field).expect("finite");
            }
        }
        if let Some(epoch) = smoother.step(sample).expect("sorted") {
            causal.push((k, epoch));
        }
    }
    let (delay, offset) = {
        let filter = smoother.filter();
        (filter.magnetometer_delay(), filter.magnetometer_offset())
    };
    let indices: Vec<usize> = causal.iter().map(|(k, _)| *k).collect();
    Estimates {
        causal,
        smoothed: indices.into_iter().zip(smoother.finish()).collect(),
        delay,
        offset,
    }
}

/// Error of an epoch as a small rotation in level axes, rad.
pub(crate) fn error(record: &Record, (k, epoch): &(usize, AhrsEpoch)) -> Vector3<f64> {
    log(&(record.truth[*k] * epoch.attitude.conjugate()))
}

/// Normalised error squared of an attitude, three degrees of freedom.
pub(crate) fn nees(record: &Record, epoch: &(usize, AhrsEpoch)) -> f64 {
    let error = error(record, epoch);
    let root = epoch.1.covariance.cholesky().expect("positive");
    error.dot(&root.solve(&error))
}
