//! What the filter makes of a stop: the way in, what it is told meanwhile, the way out, and the record of it.

#[cfg(feature = "std")]
use super::batch::Batch;
use super::resting::Resting;
use crate::attitude::{Euler, wrap_angle};
use crate::config::{StationaryConfig, StationaryMode};
use crate::error::Result;
use crate::filter::{Eskf, GYRO_BIAS, POSITION, Update, VELOCITY};
use crate::imu::ImuNoise;
use crate::measurement::{HeldAid, ZeroHeadingRateAid, ZeroVelocityAid};
use crate::mechanization::Increment;
#[cfg(feature = "std")]
use crate::solution::NotFused;
use crate::solution::{Event, Motion, Sink};
use crate::stationary::{
    Evidence, HeadingLedger, LOOK_AHEAD, Rounding, StopEnd, StopRecord, Witness,
};
use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix2, Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Zero velocities, or attitudes held, that do not fit over so long, s, end a stop.
const MISFIT: f64 = 0.2;
/// Mean NIS of three degrees of freedom that does not fit: one in a thousand for a single one.
const MISFIT_NIS: f64 = 16.3;
/// So long must the mean rate contradict a declared stop, s: people who move in it make it do so for less.
const TURNING: f64 = 1.0;
/// What a body may have gained while its unit's means did not fit, m/s: 0.3 m/s² over the three seconds.
const MISFIT_SPEED: f64 = 1.0;
/// What GNSS may say of the speed of a body that stands on top of its sigma, m/s: receivers filter, so that they stop late.
const HEARD_FLOOR: f64 = 0.2;
/// After a stop that what was measured contradicts, none is believed for so long, s.
const DISTRUST: f64 = 3.0;

/// A heading known no better than this is an unknown one, rad: beyond, the Earth's rate about an axis that is off by so much is
/// no linear matter any more (its cosine is off by an eighth).
const UNKNOWN_HEADING: f64 = 0.5;

/// Leads the filter through stops.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Standing {
    config: StationaryConfig,
    #[cfg(feature = "std")]
    noise: ImuNoise,
    zero_velocity: ZeroVelocityAid,
    zero_heading_rate: ZeroHeadingRateAid,
    held: HeldAid,
    resting: Resting,
    stop: Option<Stop>,
    distrusted_until: Option<Time>,
    /// Whether what was declared has been contradicted and not been taken back since.
    disbelieved: bool,
    /// Nothing stands before here: the begin of the run, the end of the last stop.
    earliest: Option<Time>,
    /// Whether it is declared, and not only seen, that the body stands.
    declared: bool,
    /// GNSS velocities in a row that contradict what was declared.
    heard_moving: u32,
    /// Since when the mean rate says that a body that was declared to stand turns.
    turning_since: Option<Time>,
    /// Up to here nobody knows whether the gyros show their biases or a slow turn.
    doubtful_until: Option<Time>,
    /// Whether the body rocks at its stops: constant position and attitude then do not fit.
    rocks: bool,
    /// Whether stops are stances of a foot: they are over before the Earth has turned.
    stances: bool,
    /// Whether headings count from the start, north being unknown.
    #[cfg(feature = "std")]
    relative: bool,
}

/// The stop that lasts.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Stop {
    mode: StationaryMode,
    record: StopRecord,
    ledger: HeadingLedger,
    /// Time since the last sample, s.
    elapsed: f64,
    /// Of the zero velocity.
    misfit: Misfit,
    /// Of a held attitude.
    turned: Misfit,
    /// What rounding may do to the bias learnt meanwhile, rad/s.
    rounding: Vector3<f64>,
    /// In batch mode, what is looked at in the end.
    #[cfg(feature = "std")]
    batch: Option<Batch>,
    /// Whether a piece of it has been.
    #[cfg(feature = "std")]
    is_fused: bool,
}

/// NIS of late of what is told while standing.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Misfit {
    sum: f64,
    count: u32,
    time: f64,
}

impl Standing {
    pub(super) fn new(config: &StationaryConfig, noise: &ImuNoise) -> Self {
        Standing {
            config: *config,
            #[cfg(feature = "std")]
            noise: *noise,
            zero_velocity: ZeroVelocityAid::new(config),
            zero_heading_rate: ZeroHeadingRateAid::new(config),
            held: HeldAid::new(config),
            resting: Resting::new(config, noise),
            stop: None,
            distrusted_until: None,
            disbelieved: false,
            earliest: None,
            declared: false,
            heard_moving: 0,
            turning_since: None,
            doubtful_until: None,
            rocks: false,
            #[cfg(feature = "std")]
            relative: false,
            stances: config.window_s.is_some_and(|window| window < LOOK_AHEAD),
        }
    }

    /// Headings count from the start: nobody knows about which axis the Earth turns.
    #[cfg(feature = "std")]
    pub(super) fn heading_is_relative(&mut self, relative: bool) {
        self.relative = relative;
    }

    /// Take no mean rate for a bias before this instant.
    #[cfg(feature = "std")]
    pub(super) fn doubt_rates(&mut self, until: Option<Time>) {
        self.doubtful_until = until;
    }

    /// Since when the body stands, as far as the solution is concerned.
    pub(super) fn motion(&self) -> Motion {
        match &self.stop {
            Some(stop) => Motion::Stationary {
                since: stop.record.begin,
            },
            None => Motion::Moving,
        }
    }

    /// Whether the filter is told that the body stands: GNSS velocities and the wheels' constraint then say nothing new.
    pub(super) fn is_held(&self) -> bool {
        self.stop
            .as_ref()
            .is_some_and(|stop| stop.mode != StationaryMode::Off)
    }

    /// Follow the detector, at the begin of an interval. `rocks`: a body that stands is not at rest.
    pub(super) fn follow(
        &mut self,
        detected: Motion,
        evidence: Evidence,
        rocks: bool,
        filter: &mut Eskf,
        sink: &mut impl Sink,
    ) -> Result<()> {
        let now = filter.nominal().nav.time;
        let earliest = *self.earliest.get_or_insert(now);
        let was_declared = core::mem::replace(&mut self.declared, is_declared(&evidence));
        self.disbelieved &= self.declared;
        if self.is_turning(&evidence, now) {
            let nis = MISFIT_NIS * evidence.mean_rate;
            return self.contradict(nis, 0.0, filter, sink);
        }
        if self.doubtful_until.is_some_and(|until| now >= until) {
            self.doubtful_until = None;
            self.enter_anew(filter, sink)?;
        }
        if core::mem::replace(&mut self.rocks, rocks) != rocks {
            self.rest_or_rock(filter, sink)?;
        }
        match (detected, &self.stop) {
            (Motion::Moving, Some(_)) => {
                let ended_by = if was_declared {
                    StopEnd::Withdrawn
                } else {
                    StopEnd::Motion
                };
                self.end(ended_by, filter, sink)
            }
            // Seen ahead: what begins later than here is not entered yet.
            (Motion::Stationary { since }, None)
                if since <= now
                    && self.distrusted_until.is_none_or(|until| now >= until)
                    && (!self.disbelieved || evidence.agrees()) =>
            {
                self.begin(since.max(earliest), evidence, filter, sink)
            }
            _ => Ok(()),
        }
    }

    /// Whether a body that is declared to stand has turned for a second: a held heading would take that for a bias.
    fn is_turning(&mut self, evidence: &Evidence, now: Time) -> bool {
        let turns = self.declared && self.is_held() && evidence.mean_rate > 1.0;
        if !turns {
            self.turning_since = None;
            return false;
        }
        let since = *self.turning_since.get_or_insert(now);
        now.since(since) >= TURNING
    }

    /// Enter a stop.
    fn begin(
        &mut self,
        begin: Time,
        evidence: Evidence,
        filter: &mut Eskf,
        sink: &mut impl Sink,
    ) -> Result<()> {
        let now = filter.nominal().nav.time;
        sink.event(&Event::StopBegan {
            begin,
            held_from: now,
            evidence,
        });
        let (before, sigma_before) = (heading(filter), heading_sigma(filter));
        let (mode, outcome) = self.enter(filter, sink);
        self.stop = Some(Stop {
            mode,
            record: StopRecord {
                begin,
                held_from: now,
                end: now,
                ended_by: StopEnd::End,
                mode,
                evidence,
                heading_before: before,
                sigma_heading_before: sigma_before,
                heading_at_entry: wrap_angle(heading(filter) - before),
                heading_growth: 0.0,
                heading_corrections: 0.0,
                heading_after: before,
                sigma_heading_after: 0.0,
                gyro_bias: Vector3::zeros(),
                sigma_gyro_bias: Vector3::zeros(),
                gyro_step: Vector3::zeros(),
                gyro_repeats: [false; 3],
            },
            ledger: HeadingLedger::open(heading(filter)),
            elapsed: 0.0,
            misfit: Misfit::default(),
            turned: Misfit::default(),
            rounding: Vector3::zeros(),
            #[cfg(feature = "std")]
            batch: None,
            #[cfg(feature = "std")]
            is_fused: false,
        });
        #[cfg(feature = "std")]
        self.open_batch(filter);
        outcome
    }

    /// Begin to hold what the mode says.
    fn enter(&mut self, filter: &mut Eskf, sink: &mut impl Sink) -> (StationaryMode, Result<()>) {
        let mode = self.mode_now(filter);
        let outcome = match mode {
            StationaryMode::Off
            | StationaryMode::Zupt
            | StationaryMode::Zihr
            | StationaryMode::Batch => Ok(()),
            StationaryMode::HeadingHold => filter.hold_heading(self.config.bookkeeping),
            StationaryMode::AttitudeHold => filter.hold_attitude(),
            StationaryMode::Auto | StationaryMode::Static => told(self.resting.enter(filter), sink),
        };
        // Without room for another state the velocity is still zero.
        match outcome {
            Ok(()) => (mode, outcome),
            Err(_) => (StationaryMode::Zupt, outcome),
        }
    }

    /// The mode of the settings, as far as what is known of gyros and heading bears it.
    fn mode_now(&self, filter: &Eskf) -> StationaryMode {
        let set = self.config.mode;
        if set == StationaryMode::Off || self.stances {
            set
        } else if self.doubtful_until.is_some() {
            StationaryMode::Zupt
        } else if heading_sigma(filter) > UNKNOWN_HEADING {
            StationaryMode::Static
        } else if self.rocks && matches!(set, StationaryMode::Auto | StationaryMode::Static) {
            StationaryMode::Zupt
        } else {
            set
        }
    }

    /// The body has begun to rock, or has come to rest: a stop that lasts is held accordingly.
    fn rest_or_rock(&mut self, filter: &mut Eskf, sink: &mut impl Sink) -> Result<()> {
        let now = self.mode_now(filter);
        let Some(stop) = &mut self.stop else {
            return Ok(());
        };
        match (stop.mode, now) {
            (StationaryMode::Static, StationaryMode::Zupt) => {
                (stop.mode, stop.record.mode) = (now, now);
                self.resting.leave(filter, sink)
            }
            (StationaryMode::Zupt, StationaryMode::Static) => self.enter_anew(filter, sink),
            _ => Ok(()),
        }
    }

    /// The gyros are doubted no longer: a stop that lasts goes on as set.
    fn enter_anew(&mut self, filter: &mut Eskf, sink: &mut impl Sink) -> Result<()> {
        let Some(mut stop) = self.stop.take() else {
            return Ok(());
        };
        let mut outcome = Ok(());
        // What else it was held by before has states of its own; it was not doubted then.
        if stop.mode == StationaryMode::Zupt {
            (stop.mode, outcome) = self.enter(filter, sink);
            stop.record.mode = stop.mode;
        }
        self.stop = Some(stop);
        #[cfg(feature = "std")]
        self.open_batch(filter);
        outcome
    }

    /// Move over one raw increment.
    pub(super) fn propagate(
        &mut self,
        raw: &Increment,
        filter: &mut Eskf,
        sink: &mut impl Sink,
    ) -> Result<()> {
        let Some(stop) = &mut self.stop else {
            filter.propagate_in_steps(raw);
            return Ok(());
        };
        // What lies before a known start has no part in the run: nothing is left of it but its time.
        if raw.dt <= 0.0 {
            return Ok(());
        }
        stop.elapsed += raw.dt;
        #[cfg(feature = "std")]
        if let Some(batch) = &mut stop.batch {
            batch.keep(raw);
        }
        // What measurements from outside have done since.
        stop.book_updates(filter);
        match stop.mode {
            StationaryMode::Off => filter.propagate(raw),
            StationaryMode::Auto | StationaryMode::Static => self.resting.pass(raw, filter),
            StationaryMode::Zupt
            | StationaryMode::Zihr
            | StationaryMode::HeadingHold
            | StationaryMode::AttitudeHold
            | StationaryMode::Batch => {
                filter.propagate_standing(raw, self.config.force);
            }
        }
        let mut outcome = Ok(());
        if stop.mode == StationaryMode::Zihr {
            // Before anything else is told: the noise that is in both has to be there still.
            outcome = told(self.zero_heading_rate.observe(raw.dt, filter), sink);
        }
        stop.ledger.grown(heading(filter));
        #[cfg(feature = "std")]
        if stop.batch.as_ref().is_some_and(Batch::is_full) {
            outcome = outcome.and(self.fuse(false, filter, sink));
            self.open_batch(filter);
        }
        outcome
    }

    /// Before a measurement from outside: the errors are brought up to the instant.
    pub(super) fn catch_up(&mut self, filter: &mut Eskf) {
        filter.settle();
        if self
            .stop
            .as_ref()
            .is_some_and(|stop| matches!(stop.mode, StationaryMode::Auto | StationaryMode::Static))
        {
            self.resting.catch_up(filter);
        }
    }

    /// At an inertial sample: what standing says. `rounding`: what the gyros' steps do to their means.
    pub(super) fn observe(
        &mut self,
        rounding: &Rounding,
        filter: &mut Eskf,
        sink: &mut impl Sink,
    ) -> Result<()> {
        let Some(stop) = &mut self.stop else {
            return Ok(());
        };
        stop.rounding = stop.rounding.sup(&rounding.sigma);
        let record = &mut stop.record;
        record.gyro_step = record.gyro_step.sup(&rounding.step);
        for (told, repeats) in record.gyro_repeats.iter_mut().zip(rounding.repeats) {
            *told |= repeats;
        }
        let dt = core::mem::take(&mut stop.elapsed);
        if dt <= 0.0 {
            return Ok(());
        }
        let mut outcome = Ok(());
        let contradicted = match stop.mode {
            StationaryMode::Off => None,
            StationaryMode::Auto | StationaryMode::Static => {
                stop.book_updates(filter);
                outcome = self.resting.observe(rounding, filter, sink);
                if self.resting.took_back() {
                    // The body did turn.
                    stop.ledger.grown(heading(filter));
                }
                self.resting.contradiction()
            }
            mode => {
                let zero = self.zero_velocity.observe(dt, filter);
                let mut misfit = match &zero {
                    Ok(update) => stop.misfit.takes(update.nis, dt),
                    Err(_) => None,
                };
                outcome = told(zero, sink);
                let held = match mode {
                    StationaryMode::HeadingHold => Some(self.held.observe_heading(dt, filter)),
                    StationaryMode::AttitudeHold => Some(self.held.observe_attitude(dt, filter)),
                    _ => None,
                };
                // A body that was tilted must not be led back to what it was.
                if mode == StationaryMode::AttitudeHold
                    && let Some(Ok(update)) = &held
                {
                    misfit = misfit.or(stop.turned.takes(update.nis, dt));
                }
                if let Some(held) = held {
                    outcome = outcome.and(told(held, sink));
                }
                misfit
            }
        };
        if let Some(nis) = contradicted {
            outcome = outcome.and(self.contradict(nis, MISFIT_SPEED, filter, sink));
        }
        outcome
    }

    /// A GNSS velocity that a filter which is held does not use: r is its covariance, m²/s². Two in a row end a stop that was
    /// declared; those that the detector sees it ends itself.
    pub(super) fn hear(
        &mut self,
        velocity_n: &Vector3<f64>,
        r: &Matrix3<f64>,
        filter: &mut Eskf,
        sink: &mut impl Sink,
    ) -> Result<()> {
        let v = velocity_n.xy();
        let spread = r.fixed_view::<2, 2>(0, 0) + Matrix2::identity() * (HEARD_FLOOR * HEARD_FLOOR);
        let nis = spread.cholesky().map_or(0.0, |c| v.dot(&c.solve(&v)));
        if !self.declared || nis <= MISFIT_NIS {
            self.heard_moving = 0;
            return Ok(());
        }
        self.heard_moving += 1;
        if self.heard_moving < 2 {
            return Ok(());
        }
        self.contradict(nis, v.norm(), filter, sink)
    }

    /// A measurement of something else than standing is about to be used.
    pub(super) fn disturb(&mut self) {
        #[cfg(feature = "std")]
        if let Some(batch) = self.stop.as_mut().and_then(|stop| stop.batch.as_mut()) {
            batch.disturb();
        }
    }

    /// Begin to keep what is looked at in the end, in batch mode.
    #[cfg(feature = "std")]
    fn open_batch(&mut self, filter: &Eskf) {
        if let Some(stop) = &mut self.stop
            && stop.mode == StationaryMode::Batch
            && stop.batch.is_none()
        {
            stop.batch = Some(Batch::enter(&self.config, &self.noise, filter));
        }
    }

    /// Look at what was kept, in batch mode: a stop that does not bear it has been one of zero velocities.
    #[cfg(feature = "std")]
    fn fuse(&mut self, contradicted: bool, filter: &mut Eskf, sink: &mut impl Sink) -> Result<()> {
        let Some(stop) = &mut self.stop else {
            return Ok(());
        };
        let Some(batch) = stop.batch.take() else {
            return Ok(());
        };
        stop.book_updates(filter);
        let reason = if contradicted {
            Some(NotFused::Contradicted)
        } else if self.relative {
            Some(NotFused::RelativeHeading)
        } else {
            batch.fuse(filter)?
        };
        stop.is_fused |= reason.is_none();
        // What is left of a long stop is led through by zero velocities as well, from where its pieces ended.
        if let Some(reason) = reason.filter(|_| !stop.is_fused) {
            (stop.mode, stop.record.mode) = (StationaryMode::Zupt, StationaryMode::Zupt);
            let begin = stop.record.begin;
            sink.event(&Event::StopNotFused { begin, reason });
        }
        Ok(())
    }

    /// What was measured says that the body does not stand, but may move at this speed, m/s.
    fn contradict(
        &mut self,
        nis: f64,
        speed: f64,
        filter: &mut Eskf,
        sink: &mut impl Sink,
    ) -> Result<()> {
        let now = filter.nominal().nav.time;
        self.distrusted_until = Some(now.plus(DISTRUST));
        if self.declared {
            self.disbelieved = true;
            sink.event(&Event::StandstillContradicted { time: now, nis });
        }
        let outcome = self.end(StopEnd::Contradicted, filter, sink);
        // It has moved for about a second without anybody noticing.
        let moved = Matrix3::from_diagonal_element(speed * speed);
        filter.widen(VELOCITY, &moved);
        filter.widen(POSITION, &moved);
        outcome
    }

    /// Leave the stop, if there is one.
    pub(super) fn end(
        &mut self,
        ended_by: StopEnd,
        filter: &mut Eskf,
        sink: &mut impl Sink,
    ) -> Result<()> {
        #[cfg(feature = "std")]
        let fused = self.fuse(ended_by == StopEnd::Contradicted, filter, sink);
        #[cfg(not(feature = "std"))]
        let fused = Ok(());
        let Some(mut stop) = self.stop.take() else {
            return fused;
        };
        stop.book_updates(filter);
        let outcome = fused.and(match stop.mode {
            StationaryMode::Auto | StationaryMode::Static => {
                let outcome = self.resting.leave(filter, sink);
                if self.resting.took_back() {
                    stop.ledger.grown(heading(filter));
                }
                stop.book_updates(filter);
                outcome
            }
            StationaryMode::HeadingHold => {
                filter.release_heading(self.config.bookkeeping);
                Ok(())
            }
            StationaryMode::AttitudeHold => {
                filter.release_attitude();
                Ok(())
            }
            StationaryMode::Off
            | StationaryMode::Zupt
            | StationaryMode::Zihr
            | StationaryMode::Batch => Ok(()),
        });
        if !self.stances
            && matches!(
                stop.mode,
                StationaryMode::Zupt
                    | StationaryMode::Zihr
                    | StationaryMode::HeadingHold
                    | StationaryMode::AttitudeHold
                    | StationaryMode::Batch
            )
        {
            widen_bias(&stop.rounding, filter);
        }
        let (after, mut record) = (heading(filter), stop.record);
        record.end = filter.nominal().nav.time;
        self.earliest = Some(record.end);
        self.turning_since = None;
        self.heard_moving = 0;
        record.ended_by = ended_by;
        record.heading_growth = stop.ledger.growth();
        record.heading_corrections = stop.ledger.corrections();
        record.heading_after = after;
        record.sigma_heading_after = heading_sigma(filter);
        record.gyro_bias = filter.nominal().imu_errors.gyro_bias;
        if let Some(p) = filter.covariance().block(GYRO_BIAS, GYRO_BIAS) {
            record.sigma_gyro_bias = p.diagonal().map(|v| v.max(0.0).sqrt());
        }
        sink.event(&Event::StopEnded(record));
        outcome
    }
}

/// What was learnt as bias was the rounded rate: under way, where noise and motion round off differently, it is another.
fn widen_bias(rounding: &Vector3<f64>, filter: &mut Eskf) {
    let Some(p) = filter.covariance().block(GYRO_BIAS, GYRO_BIAS) else {
        return;
    };
    let lacks = |k: usize| (rounding[k].powi(2) - p[(k, k)]).max(0.0);
    let extra = Matrix3::from_diagonal(&Vector3::from_fn(|k, _| lacks(k)));
    filter.widen(GYRO_BIAS, &extra);
}

impl Stop {
    /// What was measured since the last booking, from outside or by the hold itself.
    fn book_updates(&mut self, filter: &Eskf) {
        let held = match self.mode {
            StationaryMode::HeadingHold | StationaryMode::AttitudeHold => {
                Some(Euler::from_quaternion(&filter.nominal().held_q_nb).heading)
            }
            _ => None,
        };
        self.ledger.learnt(heading(filter), held);
    }
}

impl Misfit {
    /// Take a NIS; their mean when those of the last stretch do not fit.
    fn takes(&mut self, nis: f64, dt: f64) -> Option<f64> {
        self.sum += nis;
        self.count += 1;
        self.time += dt;
        if self.time < MISFIT {
            return None;
        }
        let mean = self.sum / f64::from(self.count);
        *self = Misfit::default();
        (mean > MISFIT_NIS).then_some(mean)
    }
}

/// Hand an update to the sink.
pub(super) fn told(update: Result<Update>, sink: &mut impl Sink) -> Result<()> {
    update.map(|update| sink.update(&update))
}

fn is_declared(evidence: &Evidence) -> bool {
    matches!(evidence.witness, Witness::Declared | Witness::Interval)
}

fn heading(filter: &Eskf) -> f64 {
    Euler::from_quaternion(&filter.nominal().nav.q_nb).heading
}

fn heading_sigma(filter: &Eskf) -> f64 {
    filter.attitude_covariance_n()[(2, 2)].max(0.0).sqrt()
}
