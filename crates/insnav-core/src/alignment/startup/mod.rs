//! The start of a run: keeps samples until attitude, position and heading are known at the first of them.

mod assemble;
mod at_rest;
mod gyrocompass;
mod heading;

use super::{Alignment, HeadingSource, course};
use crate::attitude::Euler;
use crate::config::{AlignmentConfig, Config, StationaryMode, VehicleKind};
use crate::earth::Geodetic;
use crate::error::{Error, Result};
use crate::imu::ImuNoise;
use crate::sample::{GnssPosition, GnssVelocity, Sample};
use crate::time::Time;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// After so long without a course the run begins with an unknown heading, s.
const PATIENCE: f64 = 3600.0;
/// Inertial data needed for a start whose heading is given, s.
const LEAST_DATA: f64 = 10.0;
/// Standard deviation of a given heading without one of its own, rad (5°).
const GIVEN_SIGMA: f64 = 0.087;
/// A uniform distribution over the circle: π/√3.
const UNKNOWN_SIGMA: f64 = 1.813_8;
/// Without GNSS, rest is looked at anew after so long, s.
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
            judged: 0,
        }
    }

    /// Keep a sample.
    pub fn push(&mut self, sample: Sample) {
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
            Sample::Heading(_) | Sample::Standstill(_) | Sample::Speed(_) => {}
        }
    }

    /// Everything kept, in the order of time.
    pub fn into_samples(mut self) -> Vec<Sample> {
        self.sort();
        self.samples
    }

    fn sort(&mut self) {
        self.samples.sort_by_key(|s| (s.time(), s.is_inertial()));
        self.positions.sort_by_key(|p| p.time);
        self.velocities.sort_by_key(|v| v.time);
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
                self.align(None)
            } else {
                None
            };
        }
        if waited > PATIENCE {
            return self.align(None);
        }
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
            self.align(Some(count))
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
        self.align(None).ok_or(Error::NotStarted {
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
