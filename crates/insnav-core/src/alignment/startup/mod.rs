//! The start of a run: keeps samples until attitude, position and heading are known at the first of them.

mod assemble;
mod at_rest;
mod gyrocompass;
mod heading;

use super::{Alignment, HeadingSource, course, moving_base};
use crate::attitude::Euler;
use crate::config::{AlignmentConfig, Config, StationaryMode, VehicleKind};
use crate::earth::Geodetic;
use crate::error::{Error, Result};
use crate::imu::ImuNoise;
use crate::sample::{GnssPosition, GnssVelocity, Heading, MagneticField, Sample};
use crate::time::Time;
use heading::Ask;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// After so long without a course the run begins with an unknown heading, s.
const PATIENCE: f64 = 3600.0;
/// Before this, a car is expected to show a course, s.
const COURSE_PATIENCE: f64 = 120.0;
/// Inertial data needed for a start whose heading is given or from antennas, s.
const LEAST_DATA: f64 = 10.0;
/// Standard deviation of a given heading without one of its own, rad (5°).
const GIVEN_SIGMA: f64 = 0.087;
/// A uniform distribution over the circle: π/√3.
const UNKNOWN_SIGMA: f64 = 1.813_8;
/// Rest is looked at anew after so long, s.
const REST_AGAIN: f64 = 1.0;

/// Why a run without GNSS cannot begin.
const NO_REST: &str = "the inertial data do not begin with rest: a second without any motion, or four of a vehicle that stands with its engine on";

/// Samples since the first, and the search for a start.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Startup {
    settings: AlignmentConfig,
    vehicle: VehicleKind,
    noise: ImuNoise,
    lever_arm_b: Vector3<f64>,
    /// Where the run begins, when no GNSS is to tell.
    place: Option<Geodetic>,
    /// Whether that latitude is one that somebody told.
    place_is_told: bool,
    /// Whether the filter will be told that the body stands.
    stops_are_used: bool,
    samples: Vec<Sample>,
    first_inertial: Option<Time>,
    positions: Vec<GnssPosition>,
    velocities: Vec<GnssVelocity>,
    headings: Vec<Heading>,
    fields: Vec<MagneticField>,
    /// The one that made the start, which is not used again.
    used_heading: Option<Time>,
    /// Least standard deviation of a velocity that is believed, m/s.
    velocity_floor: f64,
    /// How many headings, and velocities of a moving base, had been seen when they were judged last.
    judged_headings: usize,
    judged_base: usize,
    /// How often rest was looked at for north in a run with GNSS, and whether that has come to an end.
    judged_rest: usize,
    north_is_decided: bool,
    /// How many fixes (velocities if there are any, else positions) have been judged for a course, or seconds for rest.
    judged: usize,
}

/// What gives the course.
enum Fixes<'a> {
    Velocities(&'a [GnssVelocity]),
    Positions(&'a [GnssPosition]),
}

impl Fixes<'_> {
    fn time(&self, i: usize) -> Option<Time> {
        match self {
            Fixes::Velocities(all) => all.get(i).map(|v| v.time),
            Fixes::Positions(all) => all.get(i).map(|p| p.time),
        }
    }
}

impl Startup {
    /// With no sample yet.
    pub fn new(config: &Config, noise: ImuNoise) -> Self {
        Startup {
            settings: config.alignment,
            vehicle: config.vehicle.kind,
            noise,
            lever_arm_b: Vector3::from(config.gnss.lever_arm_b_m.unwrap_or_default()),
            place: config.place_without_gnss().map(|(place, _)| place),
            place_is_told: config.place_without_gnss().is_some_and(|(_, told)| told),
            stops_are_used: config.stationary.mode != StationaryMode::Off,
            samples: Vec::new(),
            first_inertial: None,
            positions: Vec::new(),
            velocities: Vec::new(),
            headings: Vec::new(),
            fields: Vec::new(),
            used_heading: None,
            velocity_floor: config.gnss.velocity_sigma_floor_m_per_s,
            judged_headings: 0,
            judged_base: 0,
            judged_rest: 0,
            north_is_decided: false,
            judged: 0,
        }
    }

    /// In the middle of a drive: what is told of the heading is told of its begin.
    #[must_use]
    pub fn later(mut self) -> Self {
        self.settings.heading_deg = None;
        self.settings.heading_sigma_deg = None;
        self
    }

    /// What is navigated.
    pub fn vehicle(&self) -> VehicleKind {
        self.vehicle
    }

    /// Keep a sample.
    pub fn push(&mut self, sample: Sample) {
        if let Sample::Magnetic(field) = sample {
            self.fields.push(field);
            return;
        }
        self.samples.push(sample);
        match sample {
            Sample::GnssPosition(p) => self.positions.push(p),
            Sample::GnssVelocity(v) => {
                if self.velocities.is_empty() {
                    // From now on it is velocities that are judged, from the first one.
                    self.judged = 0;
                }
                self.velocities.push(v);
            }
            Sample::Imu(_) | Sample::ImuIncrement(_) => {
                let first = self.first_inertial.get_or_insert(sample.time());
                *first = sample.time().min(*first);
            }
            Sample::Heading(h) => self.headings.push(h),
            Sample::Standstill(_) | Sample::Speed(_) | Sample::Magnetic(_) => {}
        }
    }

    /// Everything kept, in the order of time, but for a heading that made the start and for magnetic fields.
    pub fn into_samples(mut self) -> Vec<Sample> {
        self.sort();
        let used =
            |s: &Sample| matches!(s, Sample::Heading(h) if Some(h.time) == self.used_heading);
        self.samples.retain(|s| !used(s));
        self.samples
    }

    fn sort(&mut self) {
        self.samples.sort_by_key(|s| (s.time(), s.is_inertial()));
        self.positions.sort_by_key(|p| p.time);
        self.velocities.sort_by_key(|v| v.time);
        self.headings.sort_by_key(|h| h.time);
        self.fields.sort_by_key(|f| f.time);
    }

    /// A start, if the newest sample has made one possible. Cheap unless it has a chance.
    pub fn try_align(&mut self) -> Option<Alignment> {
        let newest = self.samples.last().filter(|s| s.is_inertial())?.time();
        let waited = newest.since(self.first_inertial?);
        if let Some(place) = self.place {
            if waited < REST_AGAIN * (self.judged + 1) as f64 {
                return None;
            }
            self.judged += 1;
            return self.at_rest(place, false);
        }
        self.positions.first()?;
        if self.settings.heading_deg.is_some() {
            return if waited >= LEAST_DATA {
                self.align(Ask::Sure)
            } else {
                None
            };
        }
        if waited > PATIENCE {
            return self.align(Ask::Anything);
        }
        if waited >= LEAST_DATA && self.more_headings(newest) {
            let found = self.align(Ask::Sure);
            if found.is_some_and(|a| a.heading_source != HeadingSource::Unknown) {
                return found;
            }
        }
        let by_gyros = self.by_gyros(waited);
        if by_gyros.is_some() {
            return by_gyros;
        }
        let by_course = self.try_course(newest);
        if by_course.is_some() {
            return by_course;
        }
        if (self.vehicle != VehicleKind::Car || waited >= COURSE_PATIENCE)
            && self.more_of_a_base(newest)
        {
            return self
                .align(Ask::MovingBase)
                .filter(|a| a.heading_source != HeadingSource::Unknown);
        }
        None
    }

    /// Whether there are new headings from antennas: two or more, and every tenth time later on.
    fn more_headings(&mut self, newest: Time) -> bool {
        let count = self.headings.len();
        let more = count > 1 && count > self.judged_headings + self.judged_headings / 10;
        if !more || self.headings[count - 1].time > newest {
            return false;
        }
        self.judged_headings = count;
        true
    }

    /// Whether velocities may tell a heading that they did not a tenth earlier.
    fn more_of_a_base(&mut self, newest: Time) -> bool {
        let (Some(begin), Some(last)) = (self.first_inertial, self.velocities.last()) else {
            return false;
        };
        let count = self.velocities.len();
        if last.time > newest || count <= self.judged_base + self.judged_base / 10 {
            return false;
        }
        self.judged_base = count;
        moving_base::promising(&self.velocities, begin, self.velocity_floor).is_some()
    }

    /// A start by the course, of a vehicle that moves where it looks.
    fn try_course(&mut self, newest: Time) -> Option<Alignment> {
        if self.vehicle != VehicleKind::Car {
            return None;
        }
        // A fix is judged once the gyros have come past it, since it is they who carry its course back to the start.
        if self.fixes().time(self.judged)? > newest {
            return None;
        }
        self.judged += 1;
        let count = self.judged;
        let promising = match self.fixes() {
            Fixes::Velocities(all) => course::fast_enough(&all[count - 1]),
            Fixes::Positions(all) => course::far_enough(&all[..count]).is_some(),
        };
        if promising {
            self.align(Ask::Course(count))
                .filter(|a| a.heading_source != HeadingSource::Unknown)
        } else {
            None
        }
    }

    /// Receivers that give velocities are judged by them; chords are for those that give none.
    fn fixes(&self) -> Fixes<'_> {
        if self.velocities.is_empty() {
            Fixes::Positions(&self.positions)
        } else {
            Fixes::Velocities(&self.velocities)
        }
    }

    /// A start with whatever is there, at the end of a log.
    ///
    /// # Errors
    /// `NotStarted` without inertial samples; without a position; or, when GNSS is not used, without a second of rest.
    pub fn align_with_what_there_is(&mut self) -> Result<Alignment> {
        if self.first_inertial.is_none() {
            return Err(Error::NotStarted {
                missing: "no inertial sample",
            });
        }
        if let Some(place) = self.place {
            return self
                .at_rest(place, true)
                .ok_or(Error::NotStarted { missing: NO_REST });
        }
        if self.positions.is_empty() {
            return Err(Error::NotStarted {
                missing: "no valid GNSS position",
            });
        }
        self.align(Ask::Anything).ok_or(Error::NotStarted {
            missing: "fewer than two inertial samples",
        })
    }
}

impl Alignment {
    /// Roll, pitch and heading at the first sample.
    pub fn euler(&self) -> Euler {
        Euler::from_quaternion(&self.nav.q_nb)
    }
}
