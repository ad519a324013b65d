//! The filter: attitude at every sample, corrections every twentieth of a second.

use super::block::Block;
use super::correction::Correction;
use super::history::History;
use super::propagation::{Propagation, Variances};
use super::rest::Rest;
use super::settings::AhrsSettings;
use super::start::{Level, Start};
use super::state::{
    ACCEL_BIAS, ATTITUDE, Covariance, DISTURBANCE, Errors, FIELD, GYRO_BIAS, OFFSET, SIZE, State,
    VELOCITY,
};
use crate::attitude::{Euler, exp};
use crate::error::{Error, Result};
use crate::sample::{ImuSample, MagneticField};
use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::{ComplexField, RealField};
use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// A longer time without samples is not bridged: levelling begins anew, biases and calibration stay, s.
const LONGEST_GAP: f64 = 0.5;
/// Fields that may wait for an inertial sample.
const MOST_FIELDS: usize = 16;
/// Share of the range at which a gyro saturates: calibration moves the limit by a few hundredths.
const SATURATED: f64 = 0.97;
/// What a saturated gyro may read too little, as a share of its range.
const UNSEEN_RATE: f64 = 0.5;
/// For how long that stays the same, s.
const UNSEEN_TIME: f64 = 0.3;
/// Velocity error at the start, m/s.
const START_VELOCITY: f64 = 0.3;
/// Correlation time of a body's velocity at rest (wind, a hand), s.
const REST_VELOCITY_TAU: f64 = 0.1;
/// Time over which the carrier's velocity is looked at, s.
const VELOCITY_MEMORY: f64 = 10.0;
/// Time over which the residuals of fields are looked at, s.
const FIELD_MEMORY: f64 = 0.5;
/// Heading by one sample of a field, rad.
const FIRST_NORTH: f64 = 0.3;
/// Heading that is counted from the begin: zero but for rounding, rad.
const HEADING_BEGIN: f64 = 1e-5;
/// Heading after a gap without a magnetometer: none is known, rad.
const HEADING_UNKNOWN: f64 = 1.81;

/// Orientation at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AhrsEpoch {
    /// Stamp of the inertial sample.
    pub time: Time,
    /// Rotation from the body (forward-right-down) to magnetic north, east, down; without a field north is where it began.
    pub attitude: UnitQuaternion<f64>,
    /// Covariance of the attitude error θ, true = Exp(θ) ∘ estimate, level axes, rad²: that of the last correction, which is no
    /// older than `update_interval`, and what saturated gyros did not see since.
    pub covariance: Matrix3<f64>,
    /// Gyro bias, body, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Whether the body rests.
    pub rests: bool,
    /// Whether a gyro saturates now.
    pub saturated: bool,
    /// Whether the heading comes from a magnetometer; before, and after a gap until a field comes, north is where it began.
    pub magnetic: bool,
}

/// What a correction did, for the smoother.
#[cfg(feature = "std")]
#[derive(Clone, Debug)]
pub(super) struct Corrected {
    /// Dynamics from the correction before; `None` where a start lies between.
    pub(super) propagation: Option<Propagation>,
    pub(super) predicted: State,
    pub(super) corrected: State,
    pub(super) covariance: Covariance,
}

/// Attitude and heading reference: gyro and accelerometer, and a magnetometer where there is one.
///
/// Errors are in the level frame, so that no rate stands in their dynamics. Acceleration is the derivative of a velocity that stays about
/// its mean (a coloured acceleration without a constant part), which tells a tilt from it in a second. The magnetometer's delay behind
/// the gyros, the field that turns with the body and the field of the surroundings are states: on a body that turns at 5 rad/s a delay of
/// 10 ms alone is 3° (`docs/ahrs.md`).
///
/// Give fields before the first inertial sample that is later. Needs no heap. Saved and read again (serde), it goes on bit for bit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Ahrs {
    settings: AhrsSettings,
    phase: Phase,
    last: Option<ImuSample>,
    fields: [MagneticField; MOST_FIELDS],
    waiting: usize,
    state: State,
    covariance: Covariance,
    block: Block,
    history: History,
    rest: Rest,
    /// Length of the first field; 0 as long as none was seen.
    scale: f64,
    /// Whether the heading of this stretch comes from a field.
    magnetic: bool,
    /// When biases were corrected last.
    corrected_at: Option<Time>,
    field_ratio: f64,
    field_changed: bool,
    changes: u32,
    saturated: bool,
    /// Mean square of the velocity per axis, as estimated, m²/s².
    velocity_squared: f64,
    /// Of the last sample; the smoother takes it at once.
    #[cfg(feature = "std")]
    #[serde(skip)]
    pub(super) corrected: Option<Corrected>,
    /// Whether a start lies before the next correction.
    #[cfg(feature = "std")]
    begins: bool,
    /// Whether the last epoch is the first of a stretch; the smoother takes it.
    #[cfg(feature = "std")]
    pub(super) began: bool,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
enum Phase {
    Starting(Start),
    Running,
}

impl Ahrs {
    /// A filter that will begin with its first samples.
    ///
    /// # Errors
    /// [`Error::Config`] names the setting that is outside its range.
    pub fn new(settings: AhrsSettings) -> Result<Self> {
        settings.check()?;
        let nothing = MagneticField {
            time: Time::from_seconds(0.0),
            field_b: Vector3::zeros(),
        };
        Ok(Ahrs {
            settings,
            phase: Phase::Starting(Start::new()),
            last: None,
            fields: [nothing; MOST_FIELDS],
            waiting: 0,
            state: State::at(UnitQuaternion::identity()),
            covariance: Self::unknown(&settings),
            block: Block::default(),
            history: History::new(),
            rest: Rest::default(),
            scale: 0.0,
            magnetic: false,
            corrected_at: None,
            field_ratio: 0.0,
            field_changed: false,
            changes: 0,
            saturated: false,
            velocity_squared: 0.0,
            #[cfg(feature = "std")]
            corrected: None,
            #[cfg(feature = "std")]
            begins: true,
            #[cfg(feature = "std")]
            began: false,
        })
    }

    /// Covariance before anything is known; the field's parts have the unit of the field's length.
    fn unknown(settings: &AhrsSettings) -> Covariance {
        let field = &settings.field;
        Covariance::from_diagonal(
            &Variances {
                attitude: 0.0,
                gyro_bias: settings.gyro_bias_sigma().powi(2),
                velocity: START_VELOCITY * START_VELOCITY,
                accel_bias: settings.accel_bias_sigma.powi(2),
                field: field.length_sigma.powi(2),
                offset: field.offset_sigma.powi(2),
                disturbance: field.disturbance_sigma.powi(2),
                delay: field.delay_sigma.powi(2),
            }
            .all(),
        )
    }

    /// Settings it was made with.
    pub fn settings(&self) -> &AhrsSettings {
        &self.settings
    }

    /// Estimates of all states: attitude and magnetometer at the last sample, the others at the last correction.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Covariance of their errors at the last correction, in the order of [`AHRS_BLOCKS`](super::AHRS_BLOCKS).
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// Delay of the magnetometer behind the gyros with its standard deviation, s; `None` without a field.
    pub fn magnetometer_delay(&self) -> Option<(f64, f64)> {
        let at = super::state::DELAY;
        (self.scale > 0.0).then(|| (self.state.delay, self.covariance[(at, at)].sqrt()))
    }

    /// Field that turns with the body (hard iron), in the magnetometer's unit; `None` without a field.
    pub fn magnetometer_offset(&self) -> Option<Vector3<f64>> {
        (self.scale > 0.0).then_some(self.state.offset)
    }

    /// Length of that field as a share of the first one's; `None` without a field.
    pub fn magnetometer_offset_share(&self) -> Option<f64> {
        (self.scale > 0.0).then(|| self.state.offset.norm() / self.scale)
    }

    /// How often the field became another one: iron that was put on or came near.
    pub fn field_changes(&self) -> u32 {
        self.changes
    }

    /// Takes a field; it waits for the first inertial sample that is not earlier. One of length zero says nothing and is left out.
    ///
    /// # Errors
    /// [`Error::NotFinite`]. The filter is as before.
    pub fn field(&mut self, field: &MagneticField) -> Result<()> {
        if !field.field_b.iter().all(|x| x.is_finite()) {
            return Err(Error::NotFinite {
                what: "magnetic field",
                time: field.time,
            });
        }
        if field.field_b == Vector3::zeros() {
            return Ok(());
        }
        if self.waiting == MOST_FIELDS {
            // Inertial samples are missing; the oldest field is of least use.
            self.fields.rotate_left(1);
            self.waiting -= 1;
        }
        self.fields[self.waiting] = *field;
        self.waiting += 1;
        Ok(())
    }

    /// Takes an inertial sample: rate and force over the interval that ends at its stamp. `None` until the first attitude is known.
    ///
    /// # Errors
    /// [`Error::ImuBackward`] names both stamps, [`Error::NotFinite`] the quantity. The filter is as before.
    pub fn step(&mut self, sample: &ImuSample) -> Result<Option<AhrsEpoch>> {
        for (what, value) in [
            ("angular rate", &sample.angular_rate_b),
            ("specific force", &sample.specific_force_b),
        ] {
            if !value.iter().all(|x| x.is_finite()) {
                let time = sample.time;
                return Err(Error::NotFinite { what, time });
            }
        }
        let Some(last) = self.last.replace(*sample) else {
            return Ok(None);
        };
        let interval = sample.time.since(last.time);
        if interval <= 0.0 {
            self.last = Some(last);
            return Err(Error::ImuBackward {
                previous: last.time,
                time: sample.time,
            });
        }
        #[cfg(feature = "std")]
        {
            self.corrected = None;
        }
        if interval > LONGEST_GAP {
            self.begin_anew();
            return Ok(None);
        }
        match self.phase {
            Phase::Starting(_) => {
                if !self.started(sample, interval) {
                    return Ok(None);
                }
            }
            Phase::Running => self.run(sample, interval),
        }
        Ok(Some(self.epoch(sample.time)))
    }

    fn epoch(&self, time: Time) -> AhrsEpoch {
        AhrsEpoch {
            time,
            attitude: self.state.attitude,
            covariance: self
                .covariance
                .fixed_view::<3, 3>(ATTITUDE, ATTITUDE)
                .into_owned()
                + self.block.unseen_turn,
            gyro_bias: self.state.gyro_bias,
            rests: self.rest.rests(&self.settings.rest),
            saturated: self.saturated,
            magnetic: self.magnetic,
        }
    }

    /// Levelling starts again; what is known of the sensors stays.
    fn begin_anew(&mut self) {
        self.phase = Phase::Starting(Start::new());
        self.block = Block::default();
        self.history = History::new();
        self.rest = Rest::default();
        self.waiting = 0;
        #[cfg(feature = "std")]
        {
            self.begins = true;
        }
        self.saturated = false;
    }

    /// Whether the first attitude is known with this sample.
    fn started(&mut self, sample: &ImuSample, interval: f64) -> bool {
        let Phase::Starting(start) = &mut self.phase else {
            return true;
        };
        let rate = sample.angular_rate_b - self.state.gyro_bias;
        let force = sample.specific_force_b - self.state.accel_bias;
        start.inertial(&rate, &force, interval);
        let known = self.fields[..self.waiting]
            .iter()
            .take_while(|f| f.time <= sample.time)
            .count();
        for field in &self.fields[..known] {
            start.field(&(field.field_b - self.state.offset));
        }
        self.fields.rotate_left(known);
        self.waiting -= known;
        let heading = Euler::from_quaternion(&self.state.attitude).heading;
        // What the field may be off by, as a share of its length.
        let scale = if self.scale > 0.0 { self.scale } else { 1.0 };
        let offset = self.covariance[(OFFSET, OFFSET)].sqrt() / scale;
        let off = offset.hypot(self.settings.field.disturbance_sigma);
        let Some(level) = start.level(&self.settings, heading, off) else {
            return false;
        };
        if let Some(at) = self.corrected_at.replace(sample.time) {
            self.wander(sample.time.since(at));
        }
        self.level(&level);
        true
    }

    /// What biases and the body's field may have become in a time without corrections, never worse than before anything was known.
    fn wander(&mut self, time: f64) {
        let noise = self.variances(time).all();
        let squared = self.scale * self.scale;
        let unknown = Self::unknown(&self.settings);
        for at in [GYRO_BIAS, ACCEL_BIAS, OFFSET] {
            let most = unknown[(at, at)] * if at == OFFSET { squared } else { 1.0 };
            for i in at..at + 3 {
                let now = self.covariance[(i, i)];
                self.covariance[(i, i)] = (now + noise[i]).min(now.max(most));
            }
        }
    }

    fn level(&mut self, level: &Level) {
        self.phase = Phase::Running;
        self.magnetic = level.field.is_some();
        self.begin_stretch();
        // A force at rest that is not as long as gravity is shows a bias, along that axis; others are as likely.
        let bias = level.length_off * level.length_off;
        for i in ACCEL_BIAS..ACCEL_BIAS + 3 {
            self.covariance[(i, i)] = self.covariance[(i, i)].max(bias);
        }
        self.state.attitude = level.attitude;
        self.state.velocity = Vector3::zeros();
        self.state.disturbance = Vector3::zeros();
        let tilt = level.tilt_sigma * level.tilt_sigma;
        // Without a field the heading is zero by definition, or was lost in a gap.
        let heading = match level.field {
            Some((_, sigma)) => sigma * sigma,
            None if self.begins_first() => HEADING_BEGIN * HEADING_BEGIN,
            None => HEADING_UNKNOWN * HEADING_UNKNOWN,
        };
        self.forget(ATTITUDE, &[tilt, tilt, heading]);
        self.forget(VELOCITY, &[START_VELOCITY * START_VELOCITY; 3]);
        if let Some((field, _)) = level.field {
            self.field_known(&field);
        }
        let scale = if self.scale > 0.0 { self.scale } else { 1.0 };
        let sigma = self.settings.field.disturbance_sigma * scale;
        self.forget(DISTURBANCE, &[sigma * sigma; 3]);
    }

    /// What came before has its heading from elsewhere.
    fn begin_stretch(&mut self) {
        #[cfg(feature = "std")]
        {
            self.begins = true;
            self.began = true;
        }
    }

    fn begins_first(&self) -> bool {
        self.scale == 0.0 && self.covariance[(ATTITUDE, ATTITUDE)] == 0.0
    }

    /// Sets the scale of all that is magnetic at the first field.
    fn field_known(&mut self, field: &Vector3<f64>) {
        if self.scale > 0.0 {
            return;
        }
        self.scale = field.norm();
        self.state.field = Vector2::new(field.xy().norm(), field.z);
        let squared = self.scale * self.scale;
        for at in FIELD..DISTURBANCE + 3 {
            self.covariance[(at, at)] *= squared;
        }
    }

    /// New variances, and no covariance with anything.
    fn forget(&mut self, at: usize, variances: &[f64; 3]) {
        for (i, variance) in variances.iter().enumerate() {
            self.covariance.row_mut(at + i).fill(0.0);
            self.covariance.column_mut(at + i).fill(0.0);
            self.covariance[(at + i, at + i)] = *variance;
        }
    }

    fn run(&mut self, sample: &ImuSample, interval: f64) {
        let settings = self.settings;
        let rate = sample.angular_rate_b - self.state.gyro_bias;
        let force = sample.specific_force_b - self.state.accel_bias;
        let before = self.state.attitude;
        let turn = exp(&(rate * interval));
        let middle = (before * exp(&(rate * (0.5 * interval))))
            .to_rotation_matrix()
            .into_inner();
        self.state.attitude = before * turn;
        self.history.push(&turn, rate, interval);
        let force_n = middle * force;
        let acceleration = force_n + Vector3::new(0.0, 0.0, settings.gravity);
        let block = &mut self.block;
        block.time += interval;
        block.turned += middle * interval;
        block.pushed += force_n * interval;
        block.measured_rate += sample.angular_rate_b * interval;
        block.rate_squared += rate.norm_squared() * interval;
        block.force_squared += acceleration.norm_squared() * interval;
        self.saturated = false;
        if let Some(range) = settings.gyro_range {
            for axis in 0..3 {
                if sample.angular_rate_b[axis].abs() >= SATURATED * range {
                    self.saturated = true;
                    let about = middle.column(axis);
                    let unseen = UNSEEN_RATE * range;
                    block.unseen_turn +=
                        about * about.transpose() * (unseen * unseen * UNSEEN_TIME * interval);
                }
            }
        }
        let root = interval.sqrt();
        self.rest.push(
            (&sample.angular_rate_b, &sample.specific_force_b, interval),
            &self.state.gyro_bias,
            (
                settings.noise.gyro_white / root,
                settings.noise.accel_white / root,
            ),
            &settings.rest,
        );
        self.take_fields(sample.time);
        if self.block.time > settings.update_interval - 0.5 * interval {
            self.correct();
            self.corrected_at = Some(sample.time);
        }
    }

    /// Fields up to now, turned into level axes by the attitude that they were measured at.
    fn take_fields(&mut self, now: Time) {
        let mut taken = 0;
        for i in 0..self.waiting {
            let field = self.fields[i];
            let age = now.since(field.time);
            if age < 0.0 {
                break;
            }
            taken += 1;
            let (turn, rate) = self.history.since(age + self.state.delay);
            if !self.magnetic {
                self.find_north(
                    &(self.state.attitude * turn * (field.field_b - self.state.offset)),
                );
            }
            if !self.magnetic {
                continue;
            }
            let attitude = (self.state.attitude * turn)
                .to_rotation_matrix()
                .into_inner();
            let block = &mut self.block;
            block.fields += 1;
            block.field += attitude * field.field_b;
            block.attitudes += attitude;
            block.per_delay += (attitude * rate).cross(&self.state.outer_field());
            block.per_stamp_squared += rate.cross(&field.field_b).norm_squared() / 3.0;
        }
        self.fields.rotate_left(taken);
        self.waiting -= taken;
    }

    /// The first field after a start without one: the heading turns to it. A field of zero, or along gravity, tells no north.
    fn find_north(&mut self, field_n: &Vector3<f64>) {
        let horizontal = field_n.xy().norm();
        if horizontal.is_nan() || horizontal <= 1e-3 * field_n.norm() {
            return;
        }
        let to_north = exp(&Vector3::new(0.0, 0.0, -field_n.y.atan2(field_n.x)));
        self.state.attitude = to_north * self.state.attitude;
        self.state.velocity = to_north * self.state.velocity;
        self.block.turn(&to_north.to_rotation_matrix().into_inner());
        let tilt = [0, 1].map(|i| self.covariance[(ATTITUDE + i, ATTITUDE + i)]);
        let tilt = tilt[0].max(tilt[1]);
        self.forget(ATTITUDE, &[tilt, tilt, FIRST_NORTH * FIRST_NORTH]);
        self.forget(VELOCITY, &[START_VELOCITY * START_VELOCITY; 3]);
        self.field_known(&(to_north * field_n));
        self.magnetic = true;
        self.begin_stretch();
    }

    fn correct(&mut self) {
        let block = core::mem::take(&mut self.block);
        let settings = self.settings;
        let propagation = self.propagation(&block);
        let time = block.time;
        self.state.velocity += block.pushed + Vector3::new(0.0, 0.0, settings.gravity * time);
        self.state.disturbance *= propagation.disturbance_left;
        propagation.apply(&mut self.covariance);
        #[cfg(feature = "std")]
        let predicted = self.state;

        let rests = self.rest.rests(&settings.rest);
        // What the filter itself may be off by is no speed of the carrier.
        let own: f64 = (0..3)
            .map(|i| self.covariance[(VELOCITY + i, VELOCITY + i)])
            .sum();
        let seen = ((self.state.velocity.norm_squared() - own) / 3.0).max(0.0);
        self.velocity_squared += (seen - self.velocity_squared) * (time / VELOCITY_MEMORY).min(1.0);
        let (sigma, tau) = if rests {
            (settings.rest.velocity_sigma, REST_VELOCITY_TAU)
        } else {
            // A vehicle is faster than a hand: what the force adds up to shows it.
            let seen = self.velocity_squared.sqrt();
            (settings.velocity_sigma.max(seen), settings.velocity_tau)
        };
        let mut correction = Correction::new(&mut self.covariance);
        // A velocity of this correlation time says as much as white measurements of this variance.
        let variance = sigma * sigma * (2.0 * tau / time).max(1.0);
        for axis in 0..3 {
            correction.state(VELOCITY + axis, -self.state.velocity[axis], variance);
        }
        if rests {
            let white = settings.noise.gyro_white;
            let variance =
                white * white / time + settings.rest.rate_sigma.powi(2) * (1.0 / time).max(1.0);
            let bias = block.measured_rate / time - self.state.gyro_bias;
            for axis in 0..3 {
                correction.state(GYRO_BIAS + axis, bias[axis], variance);
            }
        }
        if block.fields > 0 {
            let field = correction.field(&self.state, &block, self.scale, &settings.field);
            if let Some(field) = field {
                self.field_ratio +=
                    (field.ratio - self.field_ratio) * (time / FIELD_MEMORY).min(1.0);
                if self.field_ratio > settings.field.change_ratio {
                    self.field_changed = true;
                    self.changes = self.changes.saturating_add(1);
                    self.field_ratio = 0.0;
                } else {
                    correction.take(&field);
                }
            }
        }
        let errors: Errors = correction.errors;
        self.state = self.state.corrected(&errors);
        #[cfg(feature = "std")]
        {
            let begins = core::mem::take(&mut self.begins);
            self.corrected = Some(Corrected {
                propagation: (!begins).then_some(propagation),
                predicted,
                corrected: self.state,
                covariance: self.covariance,
            });
        }
    }

    fn propagation(&mut self, block: &Block) -> Propagation {
        let time = block.time;
        let (s, squared) = (&self.settings, self.scale * self.scale);
        let mut noise = self.variances(time);
        noise.attitude += s.rate_noise.powi(2) * block.rate_squared;
        noise.velocity += s.force_noise.powi(2) * block.force_squared;
        if core::mem::take(&mut self.field_changed) {
            noise.offset += s.field.change_offset_sigma.powi(2) * squared;
            noise.disturbance += s.field.change_disturbance_sigma.powi(2) * squared;
        }
        Propagation {
            turned: block.turned,
            pushed: Vector3::new(0.0, 0.0, -s.gravity * time),
            disturbance_left: (-time / s.field.disturbance_tau).exp(),
            unseen_turn: block.unseen_turn,
            noise: noise.all(),
        }
    }

    /// What a time adds at rest.
    fn variances(&self, time: f64) -> Variances {
        let (s, noise) = (&self.settings, &self.settings.noise);
        let squared = self.scale * self.scale;
        let left = (-time / s.field.disturbance_tau).exp();
        let wander = |sigma: f64, tau: f64| 2.0 * sigma * sigma / tau * time;
        Variances {
            attitude: noise.gyro_white.powi(2) * time,
            gyro_bias: wander(noise.gyro_bias_sigma, noise.gyro_bias_tau),
            velocity: noise.accel_white.powi(2) * time,
            accel_bias: wander(noise.accel_bias_sigma, noise.accel_bias_tau),
            field: 0.0,
            offset: s.field.offset_wander.powi(2) * time * squared,
            disturbance: s.field.disturbance_sigma.powi(2) * (1.0 - left * left) * squared,
            delay: 0.0,
        }
    }
}

const _: () = assert!(OFFSET + 3 == DISTURBANCE && SIZE == DISTURBANCE + 4);
