//! One trial: samples, start and truth, and what a navigator makes of them.

use super::errors::{StopErrors, StopSink};
use super::variant::StopVariant;
use crate::attitude::exp;
use crate::config::Intervals;
use crate::error::{Error, Result};
use crate::filter::InitialSigma;
use crate::imu::{ImuErrors, ImuNoise};
use crate::mechanization::NavState;
use crate::navigator::Navigator;
use crate::sample::{Sample, Standstill};
use crate::sim::{Simulation, Source, Span, Stream};

/// How the navigator learns of the stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StopFlags {
    /// Beforehand and exactly.
    Exact,
    /// As samples of a topic that say so, stamped this many seconds after the truth, at both ends.
    Late(f64),
    /// Beforehand, as intervals that are this many seconds late at both ends: taken as they are, so that no look ahead helps.
    LateIntervals(f64),
}

/// Samples, a start and the truth of one trial.
#[derive(Clone, Debug)]
pub struct StopTrial {
    inertial: Vec<Sample>,
    /// Fixes scaled to their sigmas over the run, and as they came.
    fixes: [Vec<Sample>; 2],
    pub(super) simulation: Simulation,
    pub(super) stops: Vec<Span>,
    start: NavState,
    sigma: InitialSigma,
    noise: ImuNoise,
}

impl StopTrial {
    /// `simulation` has the inertial samples and the scaled fixes, `unscaled` the others among whatever else.
    pub(super) fn new(
        mut simulation: Simulation,
        unscaled: Vec<Sample>,
        stops: Vec<Span>,
        sigma: InitialSigma,
        noise: ImuNoise,
        seed: u64,
    ) -> Self {
        let truth = simulation.trajectory.after(0.0).nav;
        let mut source = Source::new(seed, Stream::Initial);
        let mut draw = |s: &nalgebra::Vector3<f64>| source.normal3().component_mul(s);
        // truth = estimate ⊞ dx: the estimate is wrong by −dx, which is as likely as dx.
        let start = NavState {
            time: simulation.trajectory.start(),
            position: truth.position.offset(&draw(&sigma.position)),
            velocity_n: truth.velocity_n + draw(&sigma.velocity),
            q_nb: exp(&draw(&sigma.attitude)) * truth.q_nb,
        };
        let samples = core::mem::take(&mut simulation.samples);
        let (inertial, scaled) = samples.into_iter().partition(Sample::is_inertial);
        let unscaled = unscaled.into_iter().filter(|s| !s.is_inertial());
        StopTrial {
            inertial,
            fixes: [scaled, unscaled.collect()],
            simulation,
            stops,
            start,
            sigma,
            noise,
        }
    }

    /// The stops, s from the start.
    pub fn stops(&self) -> &[Span] {
        &self.stops
    }

    /// Give everything to a navigator with the settings of a variant, and compare what comes out with the truth.
    ///
    /// # Errors
    /// Those of the navigator; `NotObservable` when nothing came out.
    pub fn run(&self, variant: StopVariant, flags: StopFlags) -> Result<StopErrors> {
        let zero = self.simulation.trajectory.start();
        let mut config = variant.config();
        let mut others = self.fixes[usize::from(!variant.receiver_is_scaled())].clone();
        let last = self.stops.len() - 1;
        match flags {
            StopFlags::Exact | StopFlags::LateIntervals(_) => {
                let late = match flags {
                    StopFlags::LateIntervals(by) => by,
                    StopFlags::Exact | StopFlags::Late(_) => 0.0,
                };
                let interval = |s: &Span| [s.begin_s + late, s.end_s + late];
                let mut list: Vec<[f64; 2]> = self.stops.iter().map(interval).collect();
                // Nobody drives off at the end of the data.
                list[last][1] += 10.0;
                config.stationary.intervals_s =
                    Intervals::new(&list).ok_or(Error::NotObservable {
                        what: "the errors over the stops",
                        reason: "there are more stops than intervals can be declared",
                    })?;
            }
            StopFlags::Late(by) => {
                for (i, stop) in self.stops.iter().enumerate() {
                    let mut declare = |seconds: f64, standing| {
                        let time = zero.plus(seconds + by);
                        others.push(Sample::Standstill(Standstill { time, standing }));
                    };
                    declare(stop.begin_s, true);
                    if i < last {
                        declare(stop.end_s, false);
                    }
                }
                others.sort_by_key(Sample::time);
            }
        }
        let mut navigator = Navigator::aligned(
            &config,
            self.noise,
            self.start,
            ImuErrors::default(),
            &self.sigma,
        )?;
        navigator.set_origin(zero);
        let mut sink = StopSink::new(self);
        let mut others = others.iter().peekable();
        for sample in &self.inertial {
            while let Some(other) = others.next_if(|o| o.time() < sample.time()) {
                navigator.step(other, &mut sink)?;
            }
            navigator.step(sample, &mut sink)?;
        }
        for other in others {
            navigator.step(other, &mut sink)?;
        }
        navigator.finish(&mut sink)?;
        sink.finish()
    }
}
