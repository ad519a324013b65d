//! Does the body stand? Everything that speaks for a stop or against it, in one place.

use super::declared::{Declared, Notice};
use super::inertial::InertialTests;
use super::learnt::Learnt;
use super::quantised::Rounding;
use super::rest_noise::RestNoise;
use super::speed::{Said, SpeedWitness};
use super::{Evidence, Witness};
use crate::config::{DetectorKind, StationaryConfig, VehicleKind};
use crate::imu::ImuNoise;
use crate::sample::Sample;
use crate::solution::Motion;
use crate::time::Time;
use heapless::Deque;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// So far ahead of the filter are stops looked for, s: motion is seen before the filter comes to it.
pub const LOOK_AHEAD: f64 = 0.5;
/// A longer interval between inertial samples is a gap, and ends a stop, s.
pub const GAP: f64 = 0.2;
/// A stop begins only with a mean rate this much below its threshold, a ratio: one at the edge would begin and end it for ever.
const SURELY_STEADY: f64 = 0.6;
/// While GNSS or wheels confirm a stop, LPMV and LPGV may be this much above their thresholds before it is believed (five
/// times the amplitude): an engine that starts to idle roughly shakes a car by several times the noise at rest, also below
/// 5 Hz, and what is left to be kept out is creeping below half the speed limit.
const LENIENT: f64 = 25.0;
/// A declaration is held against the filter's velocity this much before the filter is there, s: less would cost the first
/// sample of the stop where stamps do not meet.
const JUDGED_EARLY: f64 = 0.05;

/// What the filter believes, about half a second before the sample that the detector looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    /// What the gyros would measure at rest: bias and Earth rate, body axes, rad/s.
    pub rate_b: Vector3<f64>,
    /// Covariance of that (of the gyro bias), rad²/s².
    pub rate_covariance_b: Matrix3<f64>,
    /// Velocity, NED, m/s.
    pub velocity_n: Vector3<f64>,
    /// Its covariance, m²/s².
    pub velocity_covariance_n: Matrix3<f64>,
}

/// Factor on the threshold of a window's mean rate that is allowed a body that stands and of which GNSS measures that it does:
/// two and a half times the rate. Not before a stop is believed, nor to the slow mean: what rocks comes back.
const ROCKING: f64 = 6.0;
/// What rocks beyond the unit's noise while nobody measures the speed is looked at for so much longer, s: what is left of braking
/// is gone then, and what does not rock is found without this leave before.
const ROCKING_FOR: f64 = 2.0;
/// Below this share of the speed limit GNSS measures that a body stands.
const SURELY: f64 = 0.3;

/// A stop that the detector sees.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Standing {
    since: Time,
    /// Those of LPMV and LPGV by which it was found: what was learnt then holds to the end, also without GNSS.
    thresholds: [f64; 2],
    /// Whether it rocks, beyond the unit's noise.
    rocking: bool,
}

/// A stretch of standing as the filter may use it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Stretch {
    begin: Time,
    /// `None` while it lasts.
    end: Option<Time>,
}

/// Takes all samples in the order of time, ahead of the filter, and says whether the body stands.
///
/// A stop is believed when the test of the settings agrees for a window and [`StationaryConfig::entry_s`] more, and nothing
/// that knows the speed objects: GNSS, wheels, or, where neither speaks, the filter itself. Where GNSS or wheels confirm it, the
/// body may shake more. It then began where the first agreeing window began, or when it was last heard to be fast. It ends at
/// the first violation, also of a window of 0.2 s; at a hole in the inertial data; when GNSS or wheels say so.
///
/// A window shorter than the look ahead is taken to be that of a foot on the ground: its noise is that of a stance, it is older than the filter's velocity by the time that it is
/// judged, and the foot stands while its wearer walks: such windows ask nobody about the speed.
///
/// Declarations count beside it, and what the detector sees does not end them: people who get in shake a body that stands. A topic
/// that says "moving" ends what it declared [`LOOK_AHEAD`] before its stamp, and forbids the detector nothing: a parking brake that is
/// released does not start a car. Wheels that turn do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StopDetector {
    kind: DetectorKind,
    entry: f64,
    adaptive: bool,
    speed_limit: f64,
    asks_speed: bool,
    tests: InertialTests,
    speed: SpeedWitness,
    learnt: Learnt,
    declared: Declared,
    /// When the last stop ended: what moved then is no part of the next.
    moved_at: Option<Time>,
    /// Begin of the first window of those whose variances agree without a break.
    quiet_since: Option<Time>,
    /// The same with what a confirmed speed allows.
    lenient_since: Option<Time>,
    /// The same with what is allowed a vehicle that rocks.
    rocking_since: Option<Time>,
    /// Since when mean rate and speed agree.
    agreed_since: Option<Time>,
    /// Since when the mean rate agrees and GNSS or wheels confirm.
    confirmed_since: Option<Time>,
    standing: Option<Standing>,
    /// Stretches that the filter has not passed yet.
    stretches: Deque<Stretch, 8>,
    /// The last hole, and the inertial sample before the next.
    gap: Option<(Time, Time)>,
    now: Option<Time>,
    held: Option<(Time, Witness)>,
    evidence: Evidence,
}

impl StopDetector {
    /// From the settings; `noise` is that of the inertial unit at rest where the settings do not say it. What is left open in
    /// the settings is as on a car.
    pub fn new(config: &StationaryConfig, noise: &ImuNoise) -> Self {
        let config = config.for_vehicle(VehicleKind::Car);
        let kind = config.detector;
        let window = config.window_s.unwrap_or(2.0);
        let stance = window < LOOK_AHEAD;
        let rest = RestNoise::new(&config, stance, noise);
        StopDetector {
            kind,
            entry: config.entry_s.unwrap_or_default(),
            adaptive: config.adaptive && kind == DetectorKind::Composite,
            speed_limit: config.speed_m_per_s,
            asks_speed: !stance,
            tests: InertialTests::new(kind, window, config.threshold_scale, rest),
            speed: SpeedWitness::default(),
            learnt: Learnt::default(),
            declared: Declared::new(config.intervals_s),
            moved_at: None,
            quiet_since: None,
            lenient_since: None,
            rocking_since: None,
            agreed_since: None,
            confirmed_since: None,
            standing: None,
            stretches: Deque::new(),
            gap: None,
            now: None,
            held: None,
            evidence: Evidence::default(),
        }
    }

    /// There is no receiver in this run: a stop is believed unless the filter's velocity contradicts it, however large its sigma.
    ///
    /// What moves as evenly as it stands (a train, a ferry) is then taken to stand, once the filter has drifted far enough. Of what
    /// is `on_wheels` it is known how much it shakes under way: what shakes less stands, however little noise the unit has.
    pub fn never_by_gnss(&mut self, on_wheels: bool) {
        self.speed.never_by_gnss();
        if on_wheels && self.asks_speed {
            self.tests.be_on_wheels();
        }
    }

    /// Zero of the seconds of intervals; else the first inertial stamp.
    pub fn set_origin(&mut self, origin: Time) {
        self.declared.set_origin(origin);
    }

    /// Take a sample. Stamps must not run backward.
    pub fn observe(&mut self, sample: &Sample, belief: &Belief) {
        self.observe_asking(sample, || *belief);
    }

    /// As [`observe`](Self::observe), asking for the belief only when it matters.
    pub(crate) fn observe_asking(&mut self, sample: &Sample, belief: impl Fn() -> Belief) {
        match sample {
            Sample::Imu(s) => {
                self.inertial(s.time, belief, |_| (s.specific_force_b, s.angular_rate_b));
            }
            Sample::ImuIncrement(s) => {
                self.inertial(s.time, belief, |dt| (s.velocity_b / dt, s.angle_b / dt));
            }
            Sample::GnssVelocity(fix) => self.speed.observe_gnss(fix, self.speed_limit),
            Sample::Speed(speed) => self.speed.observe_wheels(speed, self.speed_limit),
            Sample::Standstill(said) => self.declared.observe(said),
            Sample::GnssPosition(_) | Sample::Heading(_) | Sample::Magnetic(_) => {}
        }
    }

    /// Whether the body stands where the filter is now, at `at`, and since when.
    ///
    /// Exact at the ends of intervals of the settings, which the look ahead alone cannot be.
    pub fn advance(&mut self, at: Time) -> Motion {
        while let Some(oldest) = self.stretches.front()
            && oldest.end.is_some_and(|end| end <= at)
        {
            self.stretches.pop_front();
        }
        let seen = self
            .stretches
            .iter()
            .find(|s| s.begin <= at && s.end.is_none_or(|end| at < end))
            .map(|s| (s.begin, Witness::Detector));
        let wheels_turn = self.speed.wheels(at).is_some_and(|v| v > self.speed_limit);
        let declared = self
            .declared
            .standing_at(at)
            .filter(|(_, witness)| *witness == Witness::Interval || !wheels_turn);
        let said = declared.or(seen);
        self.held = match (self.held, said, self.gap) {
            // A hole separates two stops.
            (_, _, Some((from, to))) if from < at && at <= to => None,
            (Some((since, _)), Some((_, witness)), _) => Some((since, witness)),
            (None, Some((since, witness)), Some((_, to))) => Some((since.max(to), witness)),
            (None, said, _) => said,
            (_, None, _) => None,
        };
        self.evidence.witness = self.held.map_or(Witness::Nobody, |(_, witness)| witness);
        self.motion()
    }

    /// What [`advance`](Self::advance) said last, or would have said half a second before the last sample.
    pub fn motion(&self) -> Motion {
        self.held
            .map_or(Motion::Moving, |(since, _)| Motion::Stationary { since })
    }

    /// What speaks for it, as of the last sample.
    pub fn evidence(&self) -> Evidence {
        self.evidence
    }

    /// What the steps in which the gyros' values come do to their means, where these are coarser than their noise.
    pub fn rounding(&self) -> Rounding {
        self.tests.rounding()
    }

    /// Whether the body that stands rocks beyond its unit's noise: it is then no body at rest to a good unit, though it stays where it
    /// is.
    pub fn rocks(&self) -> bool {
        self.standing.is_some_and(|standing| standing.rocking)
    }

    /// Something about declared stops that is worth telling, once.
    pub fn take_notice(&mut self) -> Option<Notice> {
        self.declared.take_notice()
    }

    fn inertial(
        &mut self,
        now: Time,
        belief: impl Fn() -> Belief,
        reading: impl Fn(f64) -> (Vector3<f64>, Vector3<f64>),
    ) {
        // After a start anew what waited is shown once more.
        if self.now.is_some_and(|last| now <= last) {
            return;
        }
        let Some(last) = self.now.replace(now) else {
            self.declared.begin_at(now);
            return;
        };
        let dt = now.since(last);
        if dt > GAP {
            self.gap = Some((last, now));
            self.end(last);
            self.tests.clear();
        } else if self.kind == DetectorKind::None {
            self.tests.watch(dt, &reading(dt).1);
        } else {
            let (force, rate) = reading(dt);
            let moved = self.tests.push(dt, &force, &rate);
            if moved.anew {
                self.end(last);
            } else if moved.long || moved.short {
                self.judge(now, &belief(), moved.long);
            }
        }
        let early = JUDGED_EARLY.max(1.5 * dt).min(LOOK_AHEAD);
        self.declared.judge(now.plus(early - LOOK_AHEAD), &belief);
        self.advance(now.plus(-LOOK_AHEAD));
    }

    fn judge(&mut self, now: Time, belief: &Belief, long_moved: bool) {
        let said = if self.asks_speed {
            self.speed
                .said(now, self.speed_limit, belief, self.quiet_since)
        } else {
            Said::NOT_ASKED
        };
        let surely = said.confirmed && said.moving.is_some_and(|m| m < SURELY);
        let rocking = self.standing.is_some_and(|standing| standing.rocking);
        if self.standing.is_some()
            && (said.moving.is_some_and(|m| m > 1.0) || self.tests.short(belief, rocking) > 1.0)
        {
            self.end(now);
        }
        if !long_moved {
            return;
        }
        let fixed = self.tests.fixed();
        let thresholds = match self.standing {
            Some(standing) => {
                let [force, rate] = self.tests.level();
                let of = |threshold: f64, level: f64| threshold.max(fixed * level);
                [
                    of(standing.thresholds[0], force),
                    of(standing.thresholds[1], rate),
                ]
            }
            None if self.adaptive && said.moving.is_some() => self.learnt.raise(fixed),
            None => [fixed; 2],
        };
        let thresholds = match self.standing {
            Some(standing) if standing.rocking => self.tests.rocking_on_wheels(thresholds),
            _ => thresholds,
        };
        // The short window, which sees a start, has no such leave.
        let thresholds = match surely {
            true => self.tests.rocking(thresholds),
            false => thresholds,
        };
        let rocking = match self.standing {
            Some(_) if surely => ROCKING,
            _ => 1.0,
        };
        let Some(ratios) = self.tests.long(belief, thresholds, rocking) else {
            return;
        };
        if self.adaptive {
            self.learnt.observe(now, said.confirmed, ratios.variances);
        }
        // Once it stands the filter's own velocity is that of a standing body.
        let speed = match self.standing {
            Some(_) => said.moving.unwrap_or(0.0),
            None => said.before_entry,
        };
        self.evidence = Evidence {
            witness: self.evidence.witness,
            specific_force: ratios.specific_force,
            angular_rate: ratios.angular_rate,
            mean_rate: ratios.mean_rate,
            speed,
        };
        let lenient = ratios.variances.iter().all(|v| *v < LENIENT * fixed);
        // An engine that sampling has brought down into the band: a tone, and nothing else. Where nobody measures the speed a
        // road might be so.
        let only_a_tone = || {
            let left = self.tests.without_tone();
            self.kind == DetectorKind::Composite && left.iter().all(|v| *v < fixed)
        };
        let quiet = ratios.specific_force.max(ratios.angular_rate) < 1.0
            || (self.standing.is_none() && lenient && said.measured && only_a_tone());
        if self.standing.is_some() {
            if ratios.largest() >= 1.0 || ratios.turns() {
                self.end(now);
            } else {
                self.tests.learn_level(ratios.variances, false);
                self.tests.rock(&ratios);
                if !self.tests.rocks()
                    && let Some(standing) = &mut self.standing
                {
                    standing.rocking = false;
                }
            }
            return;
        }
        let may_rock = self.tests.may_rock(&ratios);
        match may_rock {
            true => self.tests.rock(&ratios),
            false => self.tests.forget_rocking(),
        }
        if speed >= 1.0 || !(quiet || may_rock || (lenient && said.confirmed)) {
            self.tests.forget_mean();
        }
        // Speed and mean rate are means already: a single objection must not cost another window.
        let window = now.plus(-ratios.span);
        let begin = self.moved_at.map_or(window, |moved| window.max(moved));
        let steady = ratios.mean_rate.max(0.0) < SURELY_STEADY;
        for (since, from, agrees) in [
            (&mut self.quiet_since, begin, quiet),
            (&mut self.lenient_since, begin, lenient),
            (&mut self.rocking_since, begin, may_rock),
            (&mut self.agreed_since, now, steady && speed < 1.0),
            (&mut self.confirmed_since, now, steady && said.confirmed),
        ] {
            match agrees {
                true => _ = since.get_or_insert(from),
                false => *since = None,
            }
        }
        // Stamps are whole nanoseconds.
        let lasted = |since: Option<Time>, least: f64| {
            since.filter(|since| now.since(*since) + 1e-6 >= least)
        };
        let window = ratios.span + self.entry;
        let plainly = lasted(self.quiet_since, window).filter(|_| {
            let agreed = lasted(self.agreed_since, self.entry);
            agreed.is_some()
        });
        let leniently = lasted(self.lenient_since, window).filter(|_| {
            let confirmed = lasted(self.confirmed_since, self.entry);
            confirmed.is_some()
        });
        let rocking = lasted(self.rocking_since, window + ROCKING_FOR).and_then(|since| {
            // A slow turn may pass for rocking too: the middle of the first window that did not turn.
            let steady = |agreed: Time| since.max(agreed.plus(-0.5 * ratios.span));
            lasted(self.agreed_since, self.entry).map(steady)
        });
        let Some(mut since) = plainly.or(leniently).or(rocking) else {
            return;
        };
        if let Some(fast) = said.fast_until {
            // A receiver's noise must not keep a stop from the filter that is believed.
            since = since.max(fast.min(now.plus(-LOOK_AHEAD)));
        }
        self.tests.learn_level(ratios.variances, true);
        self.standing = Some(Standing {
            since,
            thresholds,
            rocking: plainly.or(leniently).is_none(),
        });
        if self.stretches.is_full() {
            self.stretches.pop_front();
        }
        let _ = self.stretches.push_back(Stretch {
            begin: since,
            end: None,
        });
    }

    /// The stop ends, if there is one: for the filter where it is now, so that it never sees the start; behind a short window
    /// as of now, since such stops are over before the filter comes to them.
    fn end(&mut self, now: Time) {
        self.quiet_since = None;
        self.lenient_since = None;
        self.rocking_since = None;
        self.tests.forget_rocking();
        if self.standing.take().is_none() {
            return;
        }
        // A window of the length of a stance forgets by itself before the next.
        self.moved_at = self.asks_speed.then_some(now);
        let lead = if self.asks_speed { LOOK_AHEAD } else { 0.0 };
        if let Some(last) = self.stretches.back_mut() {
            last.end = Some(now.plus(-lead));
        }
    }
}
