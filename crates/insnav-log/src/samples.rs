//! Messages become samples: SI, radians, NED and forward-right-down, in order of their stamps.

use crate::container::Messages;
use crate::content::{Axes, Declared, Fix, MessageReader, Stamp, Velocity};
use crate::error::LogError;
use crate::frames::{ENU_NED, FLU_FRD};
use crate::imu_units::ImuUnits;
use crate::log::{ImuAxes, Log, TimeSource};
use crate::reorder::{Reorder, Waiting};
use crate::topics::{Choice, Role};
use insnav_core::earth::Geodetic;
use insnav_core::sample::{
    GnssPosition, GnssVelocity, Heading, MagneticField, Sample, Speed, Standstill,
};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::{Deserialize, Serialize};

/// What became of the messages that were read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct SampleCounts {
    /// Inertial samples passed on.
    pub imu: u64,
    /// Inertial samples with NaN or infinity in them, passed on for the navigator to report.
    pub imu_not_finite: u64,
    /// GNSS positions passed on.
    pub gnss_position: u64,
    /// GNSS velocities passed on.
    pub gnss_velocity: u64,
    /// Headings passed on.
    pub heading: u64,
    /// Declarations of standing passed on, whichever way.
    pub standstill: u64,
    /// Speeds of wheels passed on.
    pub speed: u64,
    /// Magnetic fields passed on.
    pub magnetic: u64,
    /// Positions dropped: the receiver says that it has no fix.
    pub dropped_no_fix: u64,
    /// Positions dropped: NaN, infinite, or not on the Earth.
    pub dropped_not_finite: u64,
    /// Positions dropped: latitude and longitude both exactly zero, which is a driver's way to say nothing.
    pub dropped_zero_position: u64,
    /// Velocities dropped: NaN or infinite horizontally.
    pub dropped_velocity_not_finite: u64,
    /// Velocities dropped: the receiver says that it has no fix.
    pub dropped_velocity_no_fix: u64,
    /// Speeds of wheels dropped: NaN or infinite.
    pub dropped_speed_not_finite: u64,
    /// The stamp of the first of them.
    pub first_speed_not_finite: Option<Time>,
    /// Aiding samples dropped: later than the reorder window allows.
    pub dropped_late: u64,
    /// Messages without a stamp of their own, for which the log time was taken.
    pub unstamped: u64,
    /// Samples that came after one with a later stamp, and were put into their place.
    pub reordered: u64,
}

/// Why a position is not passed on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unusable {
    NoFix,
    NotFinite,
    ZeroPosition,
}

/// What a reader carries from the end of one log to the begin of the next.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct ReaderState {
    waiting: Waiting<Sample>,
    last_imu: Option<Time>,
    last: Option<Time>,
    counts: SampleCounts,
}

impl ReaderState {
    /// What became of the messages so far.
    pub fn counts(&self) -> &SampleCounts {
        &self.counts
    }
}

/// Samples of a log in time order: an iterator.
pub struct Samples<'a> {
    log: &'a Log,
    messages: Messages<'a>,
    inputs: Vec<Input>,
    /// By channel: index of its input.
    by_channel: Vec<Option<usize>>,
    /// Turns vectors of IMU messages into body axes, by the axes that a message states ([`Axes`]).
    to_body: [Matrix3<f64>; 3],
    reorder: Reorder<Sample>,
    last_imu: Option<Time>,
    last: Option<Time>,
    counts: SampleCounts,
    exhausted: bool,
    /// At the end of the log, keep what still waits for earlier samples.
    hold: bool,
    failed: bool,
}

/// A topic that is read: its messages, and what of them is wanted.
struct Input {
    topic: usize,
    reader: MessageReader,
    roles: [bool; Role::ALL.len()],
}

impl<'a> Samples<'a> {
    pub(crate) fn new(log: &'a Log) -> Result<Self, LogError> {
        let mut inputs: Vec<Input> = Vec::new();
        let mut by_channel = Vec::new();
        for role in [
            Role::Imu,
            Role::GnssPosition,
            Role::GnssVelocity,
            Role::Standing,
            Role::Heading,
            Role::Magnetometer,
        ] {
            let several = matches!(log.selected().choice(role), Choice::Ambiguous(_));
            if role == Role::Magnetometer && several {
                continue;
            }
            let Some(info) = log.optional(role)? else {
                continue;
            };
            let topic = log.selected().topic(role).unwrap_or_default();
            // A receiver's message may hold position and velocity.
            if let Some(input) = inputs.iter_mut().find(|input| input.topic == topic) {
                input.roles[role as usize] = true;
                continue;
            }
            for id in &info.channels {
                let id = usize::from(*id);
                if by_channel.len() <= id {
                    by_channel.resize(id + 1, None);
                }
                by_channel[id] = Some(inputs.len());
            }
            inputs.push(Input {
                topic,
                reader: log.reader(topic)?,
                roles: Role::ALL.map(|other| other == role),
            });
        }
        let topics: Vec<usize> = inputs.iter().map(|input| input.topic).collect();
        let mounting_rpy_deg = log.mounting_rpy_deg()?;
        let turn = |axes| {
            let to_body = imu_to_body(log.options().imu_axes, mounting_rpy_deg);
            match (axes, log.options().imu_axes) {
                // The mounting is given in the axes that the options name.
                (Axes::Flu, ImuAxes::Frd) | (Axes::Frd, ImuAxes::Flu) => to_body * FLU_FRD,
                _ => to_body,
            }
        };
        Ok(Samples {
            log,
            messages: log.messages(&topics),
            inputs,
            by_channel,
            to_body: [turn(Axes::AsRead), turn(Axes::Flu), turn(Axes::Frd)],
            reorder: Reorder::new(log.options().reorder_window_s),
            last_imu: None,
            last: None,
            counts: SampleCounts::default(),
            exhausted: false,
            hold: false,
            failed: false,
        })
    }

    /// Go on where the reader of the log before stopped.
    pub(crate) fn resume(&mut self, state: &ReaderState) {
        self.reorder.restore(&state.waiting);
        (self.last_imu, self.last) = (state.last_imu, state.last);
        self.counts = state.counts;
    }

    /// At the end of the log, keep what still waits in the window: earlier samples may be in the next log.
    pub(crate) fn hold_at_end(&mut self) {
        self.hold = true;
    }

    /// What the reader of the next log has to know.
    pub(crate) fn state(&self) -> ReaderState {
        ReaderState {
            waiting: self.reorder.waiting(),
            last_imu: self.last_imu,
            last: self.last,
            counts: self.counts,
        }
    }

    /// What became of the messages so far.
    pub fn counts(&self) -> SampleCounts {
        SampleCounts {
            reordered: self.reorder.reordered(),
            ..self.counts
        }
    }

    /// Read one message into the window; `false` at the end of the log.
    fn read_one(&mut self) -> Result<bool, LogError> {
        let Some(message) = self.messages.next() else {
            return Ok(false);
        };
        let message = message?;
        let Some(Some(index)) = self.by_channel.get(usize::from(message.channel)).copied() else {
            return Ok(true);
        };
        let input = &mut self.inputs[index];
        let topic = input.topic;
        let roles = input.roles;
        let plays = |role: Role| roles[role as usize];
        let content = input
            .reader
            .content(message.data)
            .map_err(|source| self.log.undecodable(topic, &message, source))?;
        let options = self.log.options();
        let counts = &mut self.counts;
        let time = self.log.choose_stamp(content.stamp, topic, &message)?;
        counts.unstamped += u64::from(
            content.stamp == Stamp::Host(Time(0)) && options.time_source == TimeSource::Header,
        );
        let log_time = message.log_time;
        if let Some(rates) = &content.rates
            && plays(Role::Imu)
        {
            let sum = rates.angular_rate.sum() + rates.specific_force.sum();
            counts.imu_not_finite += u64::from(!sum.is_finite());
            // Other messages than the common one state their units.
            let units = match rates.axes {
                Axes::AsRead => options.imu_units,
                _ => ImuUnits::default(),
            };
            let to_body = &self.to_body[rates.axes as usize];
            let sample = units.sample(time, to_body, &rates.angular_rate, &rates.specific_force);
            self.reorder.push(time, log_time, sample);
        }
        if let Some(fix) = &content.position
            && plays(Role::GnssPosition)
        {
            match gnss_position(fix, time, options.geoid_height_m) {
                Ok(position) => {
                    let sample = Sample::GnssPosition(position);
                    self.reorder.push(time, log_time, sample);
                }
                Err(Unusable::NoFix) => counts.dropped_no_fix += 1,
                Err(Unusable::NotFinite) => counts.dropped_not_finite += 1,
                Err(Unusable::ZeroPosition) => counts.dropped_zero_position += 1,
            }
        }
        if let Some(velocity) = &content.velocity
            && plays(Role::GnssVelocity)
        {
            match gnss_velocity(time, &velocity.read_with(options.gnss_velocity_axes)) {
                _ if velocity.no_fix => counts.dropped_velocity_no_fix += 1,
                Some(velocity) => {
                    let sample = Sample::GnssVelocity(velocity);
                    self.reorder.push(time, log_time, sample);
                }
                None => counts.dropped_velocity_not_finite += 1,
            }
        }
        if let Some(fix) = &content.heading
            && plays(Role::Heading)
            && fix.heading.is_finite()
            && fix.sigma > 0.0
        {
            let heading = Heading {
                time,
                heading: fix.heading,
                sigma: fix.sigma,
            };
            self.reorder.push(time, log_time, Sample::Heading(heading));
        }
        if let Some((field, axes)) = &content.field
            && plays(Role::Magnetometer)
            && field.sum().is_finite()
        {
            let field_b = self.to_body[*axes as usize] * field;
            let sample = Sample::Magnetic(MagneticField { time, field_b });
            self.reorder.push(time, log_time, sample);
        }
        if let Some(declared) = content.standing
            && plays(Role::Standing)
        {
            match declared {
                Declared::Standing(standing) => {
                    let sample = Sample::Standstill(Standstill { time, standing });
                    self.reorder.push(time, log_time, sample);
                }
                Declared::Speed(speed) if speed.is_finite() => {
                    let sample = Sample::Speed(Speed { time, speed });
                    self.reorder.push(time, log_time, sample);
                }
                Declared::Speed(_) => {
                    counts.dropped_speed_not_finite += 1;
                    counts.first_speed_not_finite.get_or_insert(time);
                }
            }
        }
        Ok(true)
    }

    /// Check a sample that leaves the window; `None`: it is dropped.
    fn release(&mut self, sample: Sample) -> Result<Option<Sample>, LogError> {
        let time = sample.time();
        match &sample {
            Sample::Imu(_) | Sample::ImuIncrement(_) => {
                if let Some(previous) = self.last_imu.filter(|previous| time < *previous) {
                    return Err(LogError::StampBackward {
                        path: self.log.path().into(),
                        topic: self.log.require(Role::Imu)?.name.clone(),
                        previous,
                        time,
                        window_s: self.log.options().reorder_window_s,
                    });
                }
                self.last_imu = Some(time);
                self.counts.imu += 1;
            }
            // What is wrong with its clock must not make others late.
            Sample::Magnetic(_) => {
                self.counts.magnetic += 1;
                return Ok(Some(sample));
            }
            _ if self.last.is_some_and(|last| time < last) => {
                self.counts.dropped_late += 1;
                return Ok(None);
            }
            Sample::GnssPosition(_) => self.counts.gnss_position += 1,
            Sample::GnssVelocity(_) => self.counts.gnss_velocity += 1,
            Sample::Heading(_) => self.counts.heading += 1,
            Sample::Standstill(_) => self.counts.standstill += 1,
            Sample::Speed(_) => self.counts.speed += 1,
        }
        self.last = self.last.max(Some(time));
        Ok(Some(sample))
    }

    fn advance(&mut self) -> Result<Option<Sample>, LogError> {
        loop {
            while let Some(sample) = self.reorder.pop(self.exhausted && !self.hold) {
                if let Some(sample) = self.release(sample)? {
                    return Ok(Some(sample));
                }
            }
            if self.exhausted {
                return Ok(None);
            }
            self.exhausted = !self.read_one()?;
        }
    }
}

impl Iterator for Samples<'_> {
    type Item = Result<Sample, LogError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.failed {
            return None;
        }
        let sample = self.advance().transpose();
        self.failed = matches!(sample, Some(Err(_)));
        sample
    }
}

/// Rotation from the axes of IMU messages to the body (forward-right-down), for a mounting given in those axes.
pub fn imu_to_body(axes: ImuAxes, mounting_rpy_deg: Option<[f64; 3]>) -> Matrix3<f64> {
    let mounting = mounting_rpy_deg.map_or_else(Matrix3::identity, |angles| {
        let [roll, pitch, yaw] = angles.map(f64::to_radians);
        Rotation3::from_euler_angles(roll, pitch, yaw).into_inner()
    });
    match axes {
        ImuAxes::Flu => FLU_FRD * mounting,
        ImuAxes::Frd => mounting,
    }
}

/// A GNSS position from its message: degrees to radians, covariance from ENU to NED.
pub(crate) fn gnss_position(
    fix: &Fix,
    time: Time,
    geoid_height_m: f64,
) -> Result<GnssPosition, Unusable> {
    if fix.no_fix {
        return Err(Unusable::NoFix);
    }
    let geoid_height_m = if fix.ellipsoidal { 0.0 } else { geoid_height_m };
    let position = Geodetic::from_degrees(
        fix.latitude_deg,
        fix.longitude_deg,
        fix.height_m + geoid_height_m,
    );
    if !position.is_valid() {
        return Err(Unusable::NotFinite);
    }
    if position.latitude == 0.0 && position.longitude == 0.0 {
        return Err(Unusable::ZeroPosition);
    }
    let covariance_n = fix.covariance_enu.as_ref().and_then(known_covariance);
    Ok(GnssPosition {
        time,
        position,
        covariance_n,
    })
}

/// A GNSS velocity from its message: ENU to NED. `None` when it is not finite horizontally.
///
/// A vertical velocity of exactly zero beside a horizontal one that is not, without a variance, is that of a receiver that
/// measures horizontally only: it becomes NaN, "not measured", rather than a measured zero.
fn gnss_velocity(time: Time, velocity: &Velocity) -> Option<GnssVelocity> {
    let (linear_enu, covariance_enu) = (&velocity.enu, velocity.covariance_enu);
    let mut velocity_n = ENU_NED * Vector3::new(linear_enu.x, linear_enu.y, 0.0);
    if !(velocity_n.x.is_finite() && velocity_n.y.is_finite()) {
        return None;
    }
    let vertical_variance = covariance_enu.map_or(0.0, |p| p[(2, 2)]);
    let moving = velocity_n.x != 0.0 || velocity_n.y != 0.0;
    let vertical_unknown = !linear_enu.z.is_finite()
        || vertical_variance.is_nan()
        || vertical_variance < 0.0
        || (linear_enu.z == 0.0 && vertical_variance == 0.0 && moving);
    velocity_n.z = if vertical_unknown {
        f64::NAN
    } else {
        -linear_enu.z
    };
    let covariance_n = covariance_enu.and_then(|mut p| {
        if vertical_unknown {
            // The row must not spoil the other two; its own value is never used.
            let horizontal = p[(0, 0)].max(p[(1, 1)]);
            for i in 0..3 {
                p[(2, i)] = 0.0;
                p[(i, 2)] = 0.0;
            }
            p[(2, 2)] = horizontal;
        }
        known_covariance(&p)
    });
    Some(GnssVelocity {
        time,
        velocity_n,
        covariance_n,
    })
}

/// A covariance from ENU to NED; `None` when it has no variance or one that cannot be: for "unknown" drivers write zeros, or the -1
/// that sensor_msgs/Imu has for it.
fn known_covariance(covariance_enu: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let p = ENU_NED * covariance_enu * ENU_NED;
    let known = p.iter().all(|v| v.is_finite()) && p.diagonal().iter().all(|v| *v > 0.0);
    known.then(|| (p + p.transpose()) * 0.5)
}
