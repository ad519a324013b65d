//! Runs of a [`NavigationDrive`] without GNSS, from its begin, with different uses of its stops.

use super::navigation_drive::NavigationDrive;
use super::simulation::Simulation;
use crate::attitude::{Euler, wrap_angle};
use crate::config::{Config, DetectorKind, Intervals, StationaryMode};
use crate::error::Result;
use crate::imu::ImuGrade;
use crate::navigator::Navigator;
use crate::solution::{Epoch, Event, Sink};
use crate::stationary::StopRecord;
use crate::time::Time;
use nalgebra::Vector3;
use serde::Serialize;
use std::vec::Vec;

/// What is made of the stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum StopUse {
    /// Nothing, but for the first: in that the gyros find north.
    None,
    /// The velocity is set to zero at every inertial sample of a stop, live.
    ZeroVelocity,
    /// Pose held, means of a second as measurements, live.
    Static,
    /// Each stop as a whole, once it is over (\[Lobusov14\]): ZUPT-1 by the two positions at the begin, ZUPT-2 and velocity reset
    /// at the later stops.
    Batch,
}

impl StopUse {
    /// All, as a table has them.
    pub const ALL: [StopUse; 4] = [
        StopUse::None,
        StopUse::ZeroVelocity,
        StopUse::Static,
        StopUse::Batch,
    ];

    /// Name as in reports.
    pub fn name(self) -> &'static str {
        match self {
            StopUse::None => "none",
            StopUse::ZeroVelocity => "zero_velocity",
            StopUse::Static => "static",
            StopUse::Batch => "batch",
        }
    }

    fn mode(self) -> StationaryMode {
        match self {
            StopUse::ZeroVelocity => StationaryMode::Zupt,
            StopUse::Static => StationaryMode::Static,
            StopUse::None | StopUse::Batch => StationaryMode::Batch,
        }
    }
}

/// Errors at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorAt {
    /// s after the start of the drive.
    pub time_s: f64,
    /// Horizontal position error, m.
    pub horizontal_m: f64,
    /// And its standard deviation: root of the sum of both variances, m.
    pub sigma_horizontal_m: f64,
    /// Horizontal position error squared over its covariance, over two.
    pub horizontal_nees: f64,
    /// Heading error, rad.
    pub heading: f64,
    /// And its standard deviation, rad.
    pub sigma_heading: f64,
}

/// What one run came to.
#[derive(Clone, Debug, PartialEq)]
pub struct NavigationOutcome {
    /// When each leg ends, as its stop begins.
    pub legs: Vec<ErrorAt>,
    /// Stops as the run found and used them.
    pub stops: Vec<StopRecord>,
    /// Stops that batch mode refused.
    pub not_fused: usize,
}

impl NavigationDrive {
    /// Run it with a seed of the noise.
    ///
    /// # Errors
    /// As [`Navigator::step`], and of the scenario's settings.
    pub fn run(&self, uses: StopUse, seed: u64) -> Result<NavigationOutcome> {
        let simulation = self.scenario().simulate(seed)?;
        let mut config = Config::default();
        config.gnss.used = false;
        config.stationary.mode = uses.mode();
        let start = simulation.trajectory.start();
        let place = simulation.truth_at(start).nav.position;
        config.output.origin = Some([
            place.latitude_deg(),
            place.longitude.to_degrees(),
            place.height,
        ]);
        if uses == StopUse::None {
            let first = self.stops()[0];
            config.stationary.detector = DetectorKind::None;
            config.stationary.intervals_s =
                Intervals::new(&[[first.begin_s, first.end_s]]).unwrap_or_default();
        }
        let noise = self.errors.noise.unwrap_or(ImuGrade::Navigation.noise());
        let mut watcher = Watcher {
            simulation: &simulation,
            start,
            arrivals: self.stops()[2..].iter().map(|stop| stop.begin_s).collect(),
            outcome: NavigationOutcome {
                legs: Vec::new(),
                stops: Vec::new(),
                not_fused: 0,
            },
        };
        let mut navigator = Navigator::new(&config, noise)?;
        for sample in simulation.samples.iter().filter(|s| s.is_inertial()) {
            navigator.step(sample, &mut watcher)?;
        }
        navigator.finish(&mut watcher)?;
        Ok(watcher.outcome)
    }
}

struct Watcher<'a> {
    simulation: &'a Simulation,
    start: Time,
    arrivals: Vec<f64>,
    outcome: NavigationOutcome,
}

impl Sink for Watcher<'_> {
    fn wants_epoch(&mut self, time: Time) -> bool {
        let next = self.arrivals.get(self.outcome.legs.len());
        next.is_some_and(|next| time.since(self.start) >= *next)
    }

    fn epoch(&mut self, epoch: &Epoch) {
        let truth = self.simulation.truth_at(epoch.nav.time).nav;
        let error: Vector3<f64> = truth.position.offset_to(&epoch.nav.position);
        let p = epoch.position_covariance_n();
        let square = p.fixed_view::<2, 2>(0, 0).into_owned();
        let nees = square
            .cholesky()
            .map_or(f64::NAN, |c| error.xy().dot(&c.solve(&error.xy())) / 2.0);
        let heading = Euler::from_quaternion(&truth.q_nb).heading;
        self.outcome.legs.push(ErrorAt {
            time_s: epoch.nav.time.since(self.start),
            horizontal_m: error.xy().norm(),
            sigma_horizontal_m: square.trace().sqrt(),
            horizontal_nees: nees,
            heading: wrap_angle(epoch.euler().heading - heading),
            sigma_heading: epoch.heading_sigma(),
        });
    }

    fn event(&mut self, event: &Event) {
        match event {
            Event::StopEnded(stop) => self.outcome.stops.push(*stop),
            Event::StopNotFused { .. } => self.outcome.not_fused += 1,
            _ => {}
        }
    }
}
