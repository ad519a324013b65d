//! The navigator: samples in, solution out. The one loop of the project.

// Without `std` there is one stage only.
#![cfg_attr(not(feature = "std"), allow(irrefutable_let_patterns))]

#[cfg(feature = "std")]
mod batch;
mod gap;
mod horizon;
mod optional_states;
mod resting;
mod standing;

pub use horizon::HORIZON_CAPACITY;

#[cfg(feature = "std")]
use crate::alignment::{Alignment, AlignmentResult, HeadingSource, Startup};
use crate::config::{Config, VehicleKind};
#[cfg(feature = "std")]
use crate::earth::Geodetic;
use crate::earth::earth_rate_n;
use crate::error::{Error, Result};
#[cfg(doc)]
use crate::filter::COVARIANCE_STEP;
use crate::filter::{Eskf, GYRO_BIAS, InitialSigma, VELOCITY, Verdict};
use crate::imu::{ImuErrors, ImuNoise};
use crate::measurement::{GnssPositionAid, GnssVelocityAid, HeadingAid, NonholonomicAid};
use crate::mechanization::{Increment, IncrementBuilder, NavState};
#[cfg(feature = "std")]
use crate::noise::InnovationSums;
use crate::sample::Sample;
use crate::solution::{Epoch, Event, Motion, Sink};
use crate::stationary::{Belief, Evidence, GAP, GnssSpeed, LOOK_AHEAD, StopDetector, StopEnd};
use crate::time::Time;
pub use gap::longest_bridged;
use gap::{Gap, held_over_gap};
use horizon::{Horizon, NotTaken};
use nalgebra::{Matrix3, Vector3};
use optional_states::OptionalStates;
use serde::{Deserialize, Serialize};
use standing::Standing;

/// Between the head and the tail, s, on top of what the clocks differ by: room for late samples before the look ahead.
const DELAY: f64 = 0.5 + LOOK_AHEAD;

/// So much of what was kept at a start does the detector see before the run begins, s: its window and what it waits beyond.
#[cfg(feature = "std")]
const SCOUT: f64 = 3.5;

/// Turns samples into a navigation solution: start, delayed horizon, strapdown, filter, aiding.
///
/// ```
/// use insnav_core::{config::Config, imu::ImuGrade, navigator::Navigator, solution::{Epoch, Sink}};
///
/// struct Last(Option<Epoch>);
/// impl Sink for Last {
///     fn epoch(&mut self, epoch: &Epoch) { self.0 = Some(epoch.clone()); }
/// }
/// # fn main() -> insnav_core::error::Result<()> {
/// # let samples: Vec<insnav_core::sample::Sample> = Vec::new();
/// let mut navigator = Navigator::new(&Config::default(), ImuGrade::Consumer.noise())?;
/// let mut last = Last(None);
/// for sample in &samples {
///     navigator.step(sample, &mut last)?;
/// }
/// # if samples.is_empty() { return Ok(()); }
/// navigator.finish(&mut last)?; // the last second is still in the horizon
/// # Ok(()) }
/// ```
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Navigator {
    /// Whether positions and velocities of a receiver are used.
    gnss: bool,
    time_offset: f64,
    velocity_lag: f64,
    noise: ImuNoise,
    /// What a start after a long gap begins with.
    #[cfg(feature = "std")]
    afresh: Startup,
    stage: Stage,
    horizon: Horizon,
    builder: IncrementBuilder,
    position: GnssPositionAid,
    velocity: GnssVelocityAid,
    heading: HeadingAid,
    nonholonomic: Option<NonholonomicAid>,
    optional: OptionalStates,
    speed: GnssSpeed,
    detector: StopDetector,
    /// Up to here the detector has seen what was kept at the start.
    scouted: Option<Time>,
    standing: Standing,
    /// What runs before this one have said of the noise, while it is watched.
    #[cfg(feature = "std")]
    #[serde(skip)]
    watched: Option<InnovationSums>,
}

/// Before and after the start.
// The filter stands inside, not behind a pointer: there is one navigator, and no allocator to rely on.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, Serialize, Deserialize)]
enum Stage {
    #[cfg(feature = "std")]
    Starting(Startup),
    Running(Eskf),
}

impl Navigator {
    /// Wait for a start: samples are kept until attitude and position are known, then the run begins at the first of them.
    ///
    /// # Errors
    /// `Config` for a setting outside its range.
    #[cfg(feature = "std")]
    pub fn new(config: &Config, noise: ImuNoise) -> Result<Self> {
        let startup = Startup::new(config, noise);
        Self::at_stage(config, noise, Stage::Starting(startup))
    }

    /// Start at a known state, without waiting. Inertial samples before its time only prepare the first interval; one at or
    /// before its time must be among them, or the way from the start to the first sample is not made.
    ///
    /// # Errors
    /// `Config` for a setting outside its range.
    pub fn aligned(
        config: &Config,
        noise: ImuNoise,
        nav: NavState,
        imu_errors: ImuErrors,
        sigma: &InitialSigma,
    ) -> Result<Self> {
        let mut filter = Eskf::new(nav, imu_errors, sigma, noise);
        OptionalStates::of(config).open(&mut filter)?;
        Self::at_stage(config, noise, Stage::Running(filter))
    }

    /// Start at rest where an alignment from stops ended, with its whole covariance: the heading's error and the drift along east
    /// that made it stay tied. Position errors start with `position_sigma` (NED, m), velocity is zero to `velocity_sigma` (m/s).
    ///
    /// The stops' data are in the alignment already: give the navigator only what came after [`AlignmentResult::at`], and the
    /// last sample before.
    ///
    /// # Errors
    /// `Config` for a setting outside its range.
    #[cfg(feature = "std")]
    pub fn after_alignment(
        config: &Config,
        noise: ImuNoise,
        alignment: &AlignmentResult,
        position: Geodetic,
        position_sigma: Vector3<f64>,
        velocity_sigma: f64,
    ) -> Result<Self> {
        let nav = NavState {
            time: alignment.at,
            position,
            velocity_n: Vector3::zeros(),
            q_nb: alignment.q_nb,
        };
        let imu_errors = ImuErrors {
            gyro_bias: alignment.gyro_bias,
            accel_bias: alignment.accel_bias,
            ..ImuErrors::default()
        };
        let sigma = InitialSigma {
            position: position_sigma,
            velocity: Vector3::repeat(velocity_sigma),
            attitude: Vector3::zeros(),
            gyro_bias: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
        };
        let mut filter = Eskf::new(nav, imu_errors, &sigma, noise);
        filter.set_joint_prior(&alignment.covariance);
        OptionalStates::of(config).open(&mut filter)?;
        Self::at_stage(config, noise, Stage::Running(filter))
    }

    fn at_stage(config: &Config, noise: ImuNoise, stage: Stage) -> Result<Self> {
        config.validate()?;
        let gnss = &config.gnss;
        let stationary = config.stationary.for_vehicle(config.vehicle.kind);
        let mut detector = StopDetector::new(&stationary, &noise);
        if !gnss.used {
            detector.never_by_gnss(config.vehicle.kind == VehicleKind::Car);
        }
        // The clocks' differences push aiding back against the IMU: the horizon must be longer by as much.
        let delay = DELAY + gnss.time_offset_s.max(0.0) + gnss.velocity_lag_s.max(0.0);
        Ok(Navigator {
            gnss: gnss.used,
            time_offset: gnss.time_offset_s,
            velocity_lag: gnss.velocity_lag_s,
            noise,
            #[cfg(feature = "std")]
            afresh: Startup::new(config, noise).later(),
            stage,
            horizon: Horizon::new(delay),
            builder: IncrementBuilder::default(),
            position: GnssPositionAid::new(gnss),
            velocity: GnssVelocityAid::new(gnss),
            heading: HeadingAid::default(),
            nonholonomic: config
                .vehicle
                .nonholonomic
                .is_used()
                .then(|| NonholonomicAid::new(&config.vehicle)),
            optional: OptionalStates::of(config),
            speed: GnssSpeed::default(),
            detector,
            scouted: None,
            standing: Standing::new(&stationary, &noise),
            #[cfg(feature = "std")]
            watched: None,
        })
    }

    /// The zero of the seconds in `stationary.intervals_s`; else the first inertial stamp.
    pub fn set_origin(&mut self, origin: Time) {
        self.detector.set_origin(origin);
    }

    /// The filter, once the run has begun. Under way its covariance may be up to [`COVARIANCE_STEP`] behind: [`Eskf::settle`]
    /// carries that of a copy on.
    pub fn filter(&self) -> Option<&Eskf> {
        match &self.stage {
            Stage::Running(filter) => Some(filter),
            #[cfg(feature = "std")]
            Stage::Starting(_) => None,
        }
    }

    /// Sum up what the innovations say of the noise: call it before the first sample.
    #[cfg(feature = "std")]
    pub fn watch_noise(&mut self) {
        match &mut self.stage {
            Stage::Running(filter) => filter.watch_noise(InnovationSums::default()),
            Stage::Starting(_) => self.watched = Some(InnovationSums::default()),
        }
    }

    /// What the innovations have said of the noise since [`Navigator::watch_noise`]; `None` if it was not asked.
    #[cfg(feature = "std")]
    pub fn take_noise(&mut self) -> Option<InnovationSums> {
        match &mut self.stage {
            Stage::Running(filter) => filter.take_noise(),
            Stage::Starting(_) => self.watched.take(),
        }
    }

    /// Factors on the stated position sigmas as used now, horizontal and vertical: learnt, or as set.
    pub fn gnss_sigma_scale(&self) -> [f64; 2] {
        self.position.scale()
    }

    /// Factors on the stated velocity sigmas as used now, horizontal and vertical.
    pub fn gnss_velocity_sigma_scale(&self) -> [f64; 2] {
        self.velocity.scale()
    }

    /// Position, velocity and attitude at the newest inertial sample: the state at the tail, predicted to the head.
    pub fn latest(&self) -> Option<NavState> {
        let filter = self.filter()?;
        let (mut nav, errors) = (filter.nominal().nav, filter.nominal().imu_errors);
        let mut builder = self.builder;
        for sample in self.horizon.iter() {
            if let Some(whole) = build(&mut builder, sample) {
                // As in the run itself: what lies before the start, or has been moved over, has no part.
                let (_, increment) = whole.split_at(nav.time);
                nav.advance(&increment.corrected(&errors));
            }
        }
        Some(nav)
    }

    /// Take one sample, in about the order of time; what it lets through comes out at the sink.
    ///
    /// # Errors
    /// `ImuBackward` for an inertial stamp older than the horizon; errors of the measurement models. The navigator stays
    /// usable.
    pub fn step(&mut self, sample: &Sample, sink: &mut impl Sink) -> Result<()> {
        let sample = match sample {
            Sample::Imu(_) | Sample::ImuIncrement(_) | Sample::Magnetic(_) => {
                sample.delayed(self.time_offset)
            }
            Sample::GnssVelocity(_) => sample.delayed(-self.velocity_lag),
            Sample::GnssPosition(_)
            | Sample::Heading(_)
            | Sample::Standstill(_)
            | Sample::Speed(_) => *sample,
        };
        if !self.gnss && matches!(sample, Sample::GnssPosition(_) | Sample::GnssVelocity(_)) {
            return Ok(());
        }
        if let Err(unfit) = sample.check() {
            sink.event(&Event::unfit(sample.time(), unfit));
            return Ok(());
        }
        #[cfg(feature = "std")]
        if let Stage::Starting(startup) = &mut self.stage {
            startup.push(sample);
            let Some(alignment) = startup.try_align() else {
                return Ok(());
            };
            return self.begin(alignment, sink);
        }
        // It serves a start only.
        if matches!(sample, Sample::Magnetic(_)) {
            return Ok(());
        }
        self.admit(sample, sink)
    }

    /// Use everything that still waits. Call it once, after the last sample.
    ///
    /// # Errors
    /// `NotStarted` when the log ended before a position was known; errors of the measurement models, the first of them, when all
    /// other samples have been used.
    pub fn finish(&mut self, sink: &mut impl Sink) -> Result<()> {
        let mut outcome = Ok(());
        #[cfg(feature = "std")]
        if let Stage::Starting(startup) = &mut self.stage {
            let alignment = startup.align_with_what_there_is()?;
            // A run that begins only now has its last second in the horizon, whatever a measurement before it was.
            outcome = self.begin(alignment, sink);
        }
        outcome = outcome.and(self.drain(true, sink));
        if let Stage::Running(filter) = &mut self.stage {
            outcome = outcome.and(self.standing.end(StopEnd::End, filter, sink));
        }
        // A long gap shortly before the end leaves a start behind that may lack a position: the run before it stands.
        #[cfg(feature = "std")]
        if let Stage::Starting(startup) = &mut self.stage
            && let Ok(alignment) = startup.align_with_what_there_is()
        {
            outcome = outcome
                .and(self.begin(alignment, sink))
                .and(self.drain(true, sink));
            if let Stage::Running(filter) = &mut self.stage {
                outcome = outcome.and(self.standing.end(StopEnd::End, filter, sink));
            }
            return outcome;
        }
        while let Some(aid) = self.horizon.pop_aiding() {
            sink.event(&Event::AfterEnd { time: aid.time() });
        }
        outcome
    }

    /// Begin the run at the first sample and catch up with all that was kept.
    #[cfg(feature = "std")]
    fn begin(&mut self, alignment: Alignment, sink: &mut impl Sink) -> Result<()> {
        let Alignment {
            nav,
            imu_errors,
            sigma,
            covariance,
            ..
        } = alignment;
        let mut filter = Eskf::new(nav, imu_errors, &sigma, self.noise);
        filter.set_joint_prior(&covariance);
        self.optional.open(&mut filter)?;
        if let Some(sums) = self.watched.take() {
            filter.watch_noise(sums);
        }
        let Stage::Starting(startup) = core::mem::replace(&mut self.stage, Stage::Running(filter))
        else {
            return Ok(());
        };
        self.standing.doubt_rates(alignment.rates_doubtful_until);
        let relative = alignment.heading_source == HeadingSource::Relative;
        self.standing.heading_is_relative(relative);
        sink.event(&Event::Started(alignment));
        let mut samples = startup.into_samples();
        // What came before the first inertial sample has served the alignment.
        samples.retain(|sample| sample.time() >= alignment.nav.time);
        self.scout(&samples);
        let mut outcome = Ok(());
        for sample in samples {
            if sink.is_over() {
                break;
            }
            // One bad measurement must not cost the samples behind it.
            outcome = outcome.and(self.admit(sample, sink));
        }
        outcome
    }

    /// Look for a stop in what was kept before the run begins: one that it begins with would else be seen only seconds later,
    /// and a heading of which nothing is known must not be lost to the noise of those.
    #[cfg(feature = "std")]
    fn scout(&mut self, samples: &[Sample]) {
        let (Stage::Running(filter), Some(first)) = (&self.stage, samples.first()) else {
            return;
        };
        let belief = || belief(filter);
        let until = first.time().plus(SCOUT);
        for sample in samples.iter().take_while(|s| s.time() <= until) {
            self.detector.observe_asking(sample, belief);
            self.scouted = Some(sample.time());
        }
    }

    fn admit(&mut self, sample: Sample, sink: &mut impl Sink) -> Result<()> {
        // Room first: it may move the tail past the sample.
        let mut outcome = Ok(());
        while self.horizon.is_full() {
            if self.horizon.next_inertial(true).is_some() {
                outcome = outcome.and(self.use_next(sink));
            } else if let (Some(lost), Some(filter)) = (self.horizon.pop(), self.filter()) {
                // Aiding alone fills the ring: nothing will ever use the oldest.
                sink.event(&Event::TooLate {
                    time: lost.time(),
                    filter: filter.nominal().nav.time,
                });
            }
        }
        // A hole among what was kept for a start has begun another.
        #[cfg(feature = "std")]
        if let Stage::Starting(startup) = &mut self.stage {
            startup.push(sample);
            return match startup.try_align() {
                Some(alignment) => outcome.and(self.begin(alignment, sink)),
                None => outcome,
            };
        }
        let Stage::Running(filter) = &self.stage else {
            return outcome;
        };
        let (time, now) = (sample.time(), filter.nominal().nav.time);
        if sample.is_inertial() {
            match self.builder.time() {
                Some(last) if time == last => {
                    sink.event(&Event::DuplicateImu { time });
                    return outcome;
                }
                Some(previous) if time < previous => {
                    return outcome.and(Err(Error::ImuBackward { previous, time }));
                }
                _ => {}
            }
        } else if time < now {
            sink.event(&Event::TooLate { time, filter: now });
            return outcome;
        }
        if self.horizon.push(sample) == Err(NotTaken::Duplicate) {
            sink.event(&Event::DuplicateImu { time });
        }
        outcome.and(self.drain(false, sink))
    }

    fn drain(&mut self, flush: bool, sink: &mut impl Sink) -> Result<()> {
        let mut outcome = Ok(());
        while self.horizon.next_inertial(flush).is_some() {
            outcome = outcome.and(self.use_next(sink));
        }
        outcome
    }

    /// Move over one inertial interval, stopping at the aiding inside it.
    fn use_next(&mut self, sink: &mut impl Sink) -> Result<()> {
        let Stage::Running(filter) = &mut self.stage else {
            return Ok(());
        };
        let Some(&next) = self.horizon.next_inertial(true) else {
            return Ok(());
        };
        let belief = || belief(filter);
        while let Some(sample) = self.horizon.look_ahead(next.time().plus(LOOK_AHEAD)) {
            if self.scouted.is_none_or(|until| sample.time() > until) {
                self.detector.observe_asking(sample, belief);
            }
        }
        while let Some(notice) = self.detector.take_notice() {
            sink.event(&notice.into());
        }
        let last = self.builder.time();
        #[cfg(feature = "std")]
        if let Some(from) = last
            && next.time().since(from) > longest_bridged(self.afresh.vehicle())
            // Without GNSS nothing would say where: the gap is bridged, whatever it costs.
            && self.gnss
        {
            sink.event(&Event::ImuGap {
                from,
                to: next.time(),
            });
            let outcome = self.standing.end(StopEnd::Gap, filter, sink);
            self.start_afresh();
            return outcome;
        }
        let mut failed = None;
        let mut rest = build(&mut self.builder, &next);
        // A start between two samples: what lies before it has no part in the run.
        let now = filter.nominal().nav.time;
        if last.is_some_and(|last| last < now) {
            rest = rest.map(|whole| whole.split_at(now).1);
        }
        let mut gap = None;
        if let (Some(from), Some(increment)) = (last, &rest)
            && increment.dt > GAP
        {
            sink.event(&Event::ImuGap {
                from,
                to: next.time(),
            });
            failed = self.standing.end(StopEnd::Gap, filter, sink).err();
            gap = Some(Gap::over(increment));
            if matches!(next, Sample::ImuIncrement(_)) {
                rest = Some(held_over_gap(increment));
            }
        }
        let motion = self.detector.advance(filter.nominal().nav.time);
        let evidence = self.detector.evidence();
        let followed = self
            .standing
            .follow(motion, evidence, self.detector.rocks(), filter, sink);
        failed = failed.or(followed.err());
        while let Some(aid) = self.horizon.pop_aiding() {
            if let Some(whole) = rest {
                let (head, tail) = whole.split_at(aid.time());
                failed = failed.or(pass(&head, &mut gap, &mut self.standing, filter, sink).err());
                rest = Some(tail);
            }
            self.standing.catch_up(filter);
            let outcome = match &aid {
                Sample::GnssPosition(fix) => {
                    self.standing.disturb();
                    let heard = self.speed.heard_at(fix.time);
                    self.position.observe(fix, heard, filter)
                }
                Sample::GnssVelocity(fix) => {
                    self.speed.observe(fix);
                    if self.standing.is_held() {
                        let r = self.velocity.model(fix).r;
                        let heard = self.standing.hear(&fix.velocity_n, &r, filter, sink);
                        failed = failed.or(heard.err());
                        continue;
                    }
                    self.velocity.observe(fix, filter)
                }
                Sample::Heading(fix) => {
                    self.standing.disturb();
                    self.heading.observe(fix, filter)
                }
                Sample::Imu(_)
                | Sample::ImuIncrement(_)
                | Sample::Standstill(_)
                | Sample::Speed(_)
                | Sample::Magnetic(_) => continue,
            };
            match outcome {
                Ok(update) => {
                    sink.update(&update);
                    if update.verdict == Verdict::Reset {
                        sink.event(&Event::PositionReset {
                            time: update.time,
                            offset_n: Vector3::from(update.residual),
                        });
                    }
                }
                // The interval is finished first: one bad measurement must not cost an increment.
                Err(error) => failed = Some(error),
            }
        }
        self.horizon.pop();
        if let Some(increment) = rest {
            failed = failed.or(pass(&increment, &mut gap, &mut self.standing, filter, sink).err());
        }
        let observed = self
            .standing
            .observe(&self.detector.rounding(), filter, sink);
        failed = failed.or(observed.err());
        if let Some(outcome) = self
            .nonholonomic
            .as_mut()
            .filter(|_| !self.standing.is_held())
            .and_then(|aid| aid.observe(filter))
        {
            match outcome {
                Ok(update) => sink.update(&update),
                Err(error) => failed = Some(error),
            }
        }
        if next.time() >= now && sink.wants_epoch(next.time()) {
            let mut epoch = epoch(filter, self.standing.motion(), evidence);
            let beyond = self.position.beyond_filter(filter.covariance().layout());
            let mut position = epoch.covariance.fixed_view_mut::<3, 3>(0, 0);
            position += beyond;
            sink.epoch(&epoch);
        }
        failed.map_or(Ok(()), Err)
    }
}

#[cfg(feature = "std")]
impl Navigator {
    /// Go back to the start with all that waits in the horizon.
    fn start_afresh(&mut self) {
        if let Stage::Running(filter) = &mut self.stage {
            self.optional.keep(filter);
            self.watched = filter.take_noise();
        }
        self.position.start_afresh();
        let mut startup = self.afresh.clone();
        while let Some(sample) = self.horizon.pop() {
            startup.push(sample);
        }
        self.horizon.forget_head();
        self.builder.reset();
        self.stage = Stage::Starting(startup);
    }
}

/// Move over an increment, in a gap step by step.
fn pass(
    increment: &Increment,
    gap: &mut Option<Gap>,
    standing: &mut Standing,
    filter: &mut Eskf,
    sink: &mut impl Sink,
) -> Result<()> {
    let Some(gap) = gap else {
        return standing.propagate(increment, filter, sink);
    };
    let (mut rest, mut outcome) = (*increment, Ok(()));
    while rest.dt > 0.0 {
        let (step, after) = gap.split(&rest);
        gap.widen(&step, filter);
        outcome = outcome.and(standing.propagate(&step, filter, sink));
        rest = after;
    }
    outcome
}

fn build(builder: &mut IncrementBuilder, sample: &Sample) -> Option<Increment> {
    match sample {
        Sample::Imu(s) => builder.push(s),
        Sample::ImuIncrement(s) => builder.push_increment(s),
        _ => None,
    }
}

/// What the detector of stops may know of the filter; the covariance is that of the last step, 12 ms ago at most.
fn belief(filter: &Eskf) -> Belief {
    let (nominal, covariance) = (filter.nominal(), filter.covariance());
    let of = |block| {
        covariance
            .block(block, block)
            .unwrap_or_else(Matrix3::zeros)
    };
    let earth_rate_n = earth_rate_n(nominal.nav.position.latitude);
    Belief {
        rate_b: nominal.imu_errors.gyro_bias
            + nominal.nav.q_nb.inverse_transform_vector(&earth_rate_n),
        rate_covariance_b: of(GYRO_BIAS),
        velocity_n: nominal.nav.velocity_n,
        velocity_covariance_n: of(VELOCITY),
    }
}

/// The solution as the filter has it.
fn epoch(filter: &Eskf, motion: Motion, evidence: Evidence) -> Epoch {
    let nominal = filter.nominal();
    let earth = crate::earth::LocalEarth::at(&nominal.nav.position);
    let frame_rate_n = earth.earth_rate_n() + earth.transport_rate_n(&nominal.nav.velocity_n);
    let rate_b: Vector3<f64> =
        nominal.rate_b - nominal.nav.q_nb.inverse_transform_vector(&frame_rate_n);
    Epoch {
        nav: nominal.nav,
        rate_b,
        imu_errors: nominal.imu_errors,
        motion,
        evidence,
        covariance: filter.base_covariance(),
    }
}
