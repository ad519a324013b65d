//! Watches a run on its way to the sink: counts measurements, adds up the way, notes headings at stops.

use super::doubts::Unusable;
use super::report::{
    AidingReport, AlignmentReport, FinalReport, MisfitReport, ResetReport, StopReport,
};
use super::stop_pieces::{self, SlowStretches};
use insnav_core::alignment::Alignment;
use insnav_core::attitude::Euler;
use insnav_core::earth::Geodetic;
use insnav_core::filter::{Update, Verdict};
use insnav_core::imu::STANDARD_GRAVITY;
use insnav_core::solution::{Epoch, Event, Motion, Sink};
use insnav_core::time::Time;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// What is shorter on a foot is the stance of a step, s.
const STANCE: f64 = 1.0;
/// Epochs per second that the tally looks at, whatever the sink wants: enough for way and stops.
const PERIOD: f64 = 0.1;

/// Totals of one kind of measurement.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Aid {
    dof: usize,
    used: usize,
    rejected: usize,
    inflated: usize,
    reset: usize,
    frozen: usize,
    nis: f64,
    components: usize,
    misfit: Misfit,
}

/// Measurements in a row that cannot be true if the filter is.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Misfit {
    begin: Option<Time>,
    count: usize,
    /// The longest row so far: its ends and how many it has.
    longest: Option<(Time, Time, usize)>,
}

/// NIS per component that no measurement has by chance: the gate of three components is at 7.
const CANNOT_BE: f64 = 20.0;
/// A row of so many, over so many seconds, is told: a filter that refuses what is right goes over to it within three.
const ROW_LEAST: usize = 10;
const ROW_LASTS: f64 = 10.0;

impl Misfit {
    fn takes(&mut self, update: &Update) {
        if update.nis < CANNOT_BE * update.dof as f64 {
            (self.begin, self.count) = (None, 0);
            return;
        }
        let begin = *self.begin.get_or_insert(update.time);
        self.count += 1;
        let lasts = update.time.since(begin);
        let before = self.longest.map_or(0.0, |(a, b, _)| b.since(a));
        if self.count >= ROW_LEAST && lasts >= ROW_LASTS && lasts > before {
            self.longest = Some((begin, update.time, self.count));
        }
    }
}

/// Counts of what the navigator had to tell besides epochs and updates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct EventCounts {
    pub(super) imu_gaps: usize,
    pub(super) longest_gap_s: f64,
    pub(super) too_late: usize,
    pub(super) duplicates: usize,
    pub(super) not_finite: usize,
    pub(super) first_not_finite_s: f64,
    /// Samples with a finite value that cannot be.
    pub(super) impossible: usize,
    pub(super) first_impossible_s: f64,
    pub(super) flaps: usize,
    pub(super) first_flap_s: f64,
    /// Stops that batch mode did not look at as a whole.
    pub(super) not_fused: usize,
    pub(super) first_not_fused_s: f64,
    pub(super) contradicted: usize,
    pub(super) first_contradicted_s: f64,
}

/// So many are told one by one.
const MOST_RESETS: usize = 100;
/// Stops are believed later than they begin, by less than this, s: what seemed way until then is taken back.
const BELIEVED_WITHIN: f64 = 60.0;

/// All that is counted: what a resumed run takes over.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Totals {
    next_own: Option<Time>,
    stops: Vec<StopReport>,
    stances: usize,
    pub(super) slow: SlowStretches,
    /// Of the last minute: instants, and the way up to each from the one before.
    recent_way: VecDeque<(Time, f64)>,
    aids: Vec<(String, Aid)>,
    first: Option<Time>,
    begin: Option<Geodetic>,
    last: Option<Epoch>,
    pub(super) distance_m: f64,
    pub(super) alignment: Option<AlignmentReport>,
    pub(super) events: EventCounts,
    /// What the first sample was that is not finite.
    pub(super) first_not_finite: String,
    /// What the first impossible value was, and what is wrong with it.
    pub(super) first_impossible: String,
    /// Why the first stop that was to be looked at as a whole was not.
    pub(super) first_not_fused: String,
    pub(super) resets: Vec<ResetReport>,
    pub(super) unusable: Unusable,
    pub(super) imu_samples: usize,
    pub(super) withheld: usize,
}

/// A sink in front of another.
pub(super) struct Tally<'a, S> {
    sink: &'a mut S,
    wanted_by_sink: bool,
    on_foot: bool,
    origin: Time,
    pub(super) totals: Totals,
}

impl<'a, S: Sink> Tally<'a, S> {
    /// `before`: what a run that is resumed has counted. On a foot, short stops are counted and not told.
    pub(super) fn new(sink: &'a mut S, origin: Time, on_foot: bool, before: Totals) -> Self {
        Tally {
            sink,
            on_foot,
            wanted_by_sink: false,
            origin,
            totals: before,
        }
    }

    pub(super) fn sink(&mut self) -> &mut S {
        self.sink
    }

    pub(super) fn duration_s(&self) -> f64 {
        self.totals
            .first
            .zip(self.totals.last)
            .map_or(0.0, |(first, last)| last.nav.time.since(first))
    }

    /// Stops that were too short to be told; `None` but on a foot.
    pub(super) fn stances(&self) -> Option<usize> {
        self.on_foot.then_some(self.totals.stances)
    }

    pub(super) fn stops(&self) -> Vec<StopReport> {
        self.totals.stops.clone()
    }

    pub(super) fn aiding(&self) -> Vec<AidingReport> {
        let report = |(name, a): &(String, Aid)| AidingReport {
            name: name.clone(),
            dof: a.dof,
            used: a.used,
            rejected: a.rejected,
            inflated: a.inflated,
            reset: a.reset,
            frozen: a.frozen,
            nis_mean: (a.components > 0).then(|| a.nis / a.components as f64),
            misfit: a.misfit.longest.map(|(begin, end, count)| MisfitReport {
                begin_s: begin.since(self.origin),
                end_s: end.since(self.origin),
                count,
            }),
        };
        self.totals.aids.iter().map(report).collect()
    }

    pub(super) fn last(&self) -> Option<FinalReport> {
        self.totals
            .last
            .as_ref()
            .map(|epoch| last(epoch, self.origin))
    }

    /// North, east, down from the first epoch to the last, m.
    pub(super) fn since_start(&self) -> Option<Vector3<f64>> {
        let last = self.totals.last.as_ref()?;
        Some(self.totals.begin?.offset_to(&last.nav.position))
    }

    fn observe(&mut self, epoch: &Epoch) {
        let time = epoch.nav.time;
        let totals = &mut self.totals;
        totals.first.get_or_insert(time);
        totals.begin.get_or_insert(epoch.nav.position);
        if let Some(before) = &totals.last {
            let speed =
                0.5 * (before.nav.velocity_n.xy().norm() + epoch.nav.velocity_n.xy().norm());
            // The noise of a standing solution's velocity is no way.
            if epoch.motion == Motion::Moving {
                let way = speed * time.since(before.nav.time);
                totals.distance_m += way;
                totals.recent_way.push_back((time, way));
            }
            let old = |(t, _): &(Time, f64)| time.since(*t) > BELIEVED_WITHIN;
            while totals.recent_way.front().is_some_and(old) {
                totals.recent_way.pop_front();
            }
        }
        totals.last = Some(*epoch);
    }
}

impl<S: Sink> Sink for Tally<'_, S> {
    fn is_over(&mut self) -> bool {
        self.sink.is_over()
    }

    fn wants_epoch(&mut self, time: Time) -> bool {
        self.wanted_by_sink = self.sink.wants_epoch(time);
        let own = self.totals.next_own.is_none_or(|next| time >= next);
        if own {
            self.totals.next_own = Some(time.plus(PERIOD));
        }
        own || self.wanted_by_sink
    }

    fn epoch(&mut self, epoch: &Epoch) {
        if std::mem::take(&mut self.wanted_by_sink) {
            self.sink.epoch(epoch);
        }
        self.observe(epoch);
    }

    fn update(&mut self, update: &Update) {
        let aids = &mut self.totals.aids;
        let at = aids
            .iter()
            .position(|(name, _)| name == update.measurement)
            .unwrap_or_else(|| {
                aids.push((update.measurement.to_owned(), Aid::default()));
                aids.len() - 1
            });
        let aid = &mut aids[at].1;
        aid.dof = aid.dof.max(update.dof);
        if update.verdict != Verdict::Frozen {
            aid.misfit.takes(update);
        }
        match update.verdict {
            Verdict::Accepted => {
                aid.used += 1;
                // Of the others it is known that they do not fit.
                aid.nis += update.nis;
                aid.components += update.dof;
            }
            Verdict::Inflated => aid.inflated += 1,
            Verdict::Rejected => aid.rejected += 1,
            Verdict::Reset => aid.reset += 1,
            Verdict::Frozen => aid.frozen += 1,
        }
        self.sink.update(update);
    }

    fn event(&mut self, event: &Event) {
        let totals = &mut self.totals;
        match event {
            Event::Started(a) => {
                // A start after a long gap is told as the gap: the report is on how the run began.
                totals.alignment.get_or_insert(alignment(a, self.origin));
            }
            Event::ImuGap { from, to } => {
                totals.events.imu_gaps += 1;
                totals.events.longest_gap_s = totals.events.longest_gap_s.max(to.since(*from));
            }
            Event::TooLate { .. } => totals.events.too_late += 1,
            Event::DuplicateImu { .. } => totals.events.duplicates += 1,
            Event::NotFinite { time, what } => {
                if totals.events.not_finite == 0 {
                    totals.events.first_not_finite_s = time.since(self.origin);
                    totals.first_not_finite = (*what).to_owned();
                }
                totals.events.not_finite += 1;
            }
            Event::Impossible { time, what, why } => {
                if totals.events.impossible == 0 {
                    totals.events.first_impossible_s = time.since(self.origin);
                    totals.first_impossible = format!("{what} {why}");
                }
                totals.events.impossible += 1;
            }
            Event::StopBegan { begin, .. } => {
                let recent = &mut totals.recent_way;
                let before = recent.partition_point(|(t, _)| t <= begin);
                let taken: f64 = recent.drain(before..).map(|(_, way)| way).sum();
                totals.distance_m -= taken;
            }
            Event::StopEnded(stop) if self.on_foot && stop.end.since(stop.begin) < STANCE => {
                totals.stances += 1;
            }
            Event::StopEnded(stop) => stop_pieces::put(
                &mut totals.stops,
                StopReport::new(stop, self.origin),
                &totals.slow,
                self.origin,
            ),
            Event::StopNotFused { begin, reason } => {
                if totals.events.not_fused == 0 {
                    totals.events.first_not_fused_s = begin.since(self.origin);
                    totals.first_not_fused = reason.to_string();
                }
                totals.events.not_fused += 1;
            }
            Event::StandstillFlaps { time } => {
                let counts = &mut totals.events;
                if counts.flaps == 0 {
                    counts.first_flap_s = time.since(self.origin);
                }
                counts.flaps += 1;
            }
            Event::StandstillContradicted { time, .. } => {
                let counts = &mut totals.events;
                if counts.contradicted == 0 {
                    counts.first_contradicted_s = time.since(self.origin);
                }
                counts.contradicted += 1;
            }
            Event::PositionReset { time, offset_n } if totals.resets.len() < MOST_RESETS => {
                totals.resets.push(ResetReport {
                    time_s: time.since(self.origin),
                    offset_ned_m: (*offset_n).into(),
                });
            }
            _ => {}
        }
        self.sink.event(event);
    }
}

fn alignment(a: &Alignment, origin: Time) -> AlignmentReport {
    let e = Euler::from_quaternion(&a.nav.q_nb);
    AlignmentReport {
        roll_deg: e.roll.to_degrees(),
        pitch_deg: e.pitch.to_degrees(),
        heading_deg: e.heading_deg(),
        sigma_level_deg: a.sigma.attitude.x.max(a.sigma.attitude.y).to_degrees(),
        sigma_heading_deg: a.sigma.attitude.z.to_degrees(),
        standing_s: a.standing_s,
        rates_doubtful_until_s: a.rates_doubtful_until.map(|until| until.since(origin)),
        reversing: a.reversing,
        heading_source: a.heading_source,
        heading_at_s: a.heading_at.since(origin),
    }
}

fn last(epoch: &Epoch, origin: Time) -> FinalReport {
    let e = epoch.euler();
    let sigma = |i: usize| epoch.covariance[(i, i)].max(0.0).sqrt();
    let per_hour = |rate: f64| rate.to_degrees() * 3600.0;
    let mg = |force: f64| force / STANDARD_GRAVITY * 1e3;
    FinalReport {
        time_s: epoch.nav.time.since(origin),
        latitude_deg: epoch.nav.position.latitude_deg(),
        longitude_deg: epoch.nav.position.longitude_deg(),
        height_m: epoch.nav.position.height,
        closure_horizontal_m: None,
        closure_height_m: None,
        velocity_ned_m_per_s: epoch.nav.velocity_n.into(),
        roll_deg: e.roll.to_degrees(),
        pitch_deg: e.pitch.to_degrees(),
        heading_deg: e.heading_deg(),
        gyro_bias_deg_per_hour: epoch.imu_errors.gyro_bias.map(per_hour).into(),
        accel_bias_mg: epoch.imu_errors.accel_bias.map(mg).into(),
        sigma_horizontal_m: sigma(0).hypot(sigma(1)),
        sigma_height_m: sigma(2),
        sigma_velocity_m_per_s: sigma(3).hypot(sigma(4)),
        sigma_level_deg: sigma(6).max(sigma(7)).to_degrees(),
        sigma_heading_deg: sigma(8).to_degrees(),
        sigma_gyro_bias_deg_per_hour: [9, 10, 11].map(|i| per_hour(sigma(i))),
        sigma_accel_bias_mg: [12, 13, 14].map(|i| mg(sigma(i))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Updates every half second, those of `bad` seconds with a NIS per component of `nis`.
    fn longest(nis: f64, bad: &[std::ops::Range<f64>]) -> Option<(f64, f64, usize)> {
        let mut misfit = Misfit::default();
        let zero = Time::from_seconds(1000.0);
        for i in 0..200 {
            let t = 0.5 * f64::from(i);
            let inside = bad.iter().any(|span| span.contains(&t));
            misfit.takes(&Update {
                time: zero.plus(t),
                measurement: "gnss_position",
                dof: 3,
                residual: [0.0; 3],
                sigma: [1.0; 3],
                nis: if inside { 3.0 * nis } else { 3.0 },
                verdict: Verdict::Accepted,
            });
        }
        let longest = misfit.longest?;
        let tenths = |t: Time| (10.0 * t.since(zero)).round() / 10.0;
        Some((tenths(longest.0), tenths(longest.1), longest.2))
    }

    #[test]
    fn a_row_that_cannot_be_counts_when_it_is_long() {
        assert_eq!(longest(25.0, &[10.0..30.0]), Some((10.0, 29.5, 40)));
        // Outliers, however many, with good ones between them.
        let single: Vec<_> = (0..50)
            .map(|i| f64::from(2 * i)..f64::from(2 * i) + 1.2)
            .collect();
        assert_eq!(longest(1e6, &single), None);
        assert_eq!(longest(25.0, &[10.0..19.0]), None, "nine seconds");
        assert_eq!(
            longest(15.0, &[10.0..90.0]),
            None,
            "it may be chance and a wrong sigma"
        );
        assert_eq!(
            longest(25.0, &[10.0..22.0, 40.0..65.0, 70.0..81.0]),
            Some((40.0, 64.5, 50))
        );
    }
}
