//! Stops that somebody declares: intervals of the settings, a topic.

use super::evidence::Witness;
use super::speed::contradicted;
use super::{Belief, LOOK_AHEAD};
use crate::config::Intervals;
use crate::sample::Standstill;
use crate::solution::Event;
use crate::time::Time;
use heapless::Deque;
use serde::{Deserialize, Serialize};

/// Nobody stops and starts again in less, s.
const LEAST_STOP: f64 = 0.5;

/// Something about a declared stop that is worth telling.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Notice {
    /// The filter's own velocity contradicts a declaration: it is not used.
    Contradicted {
        /// Begin of what was declared, or of what of it lies in the data.
        time: Time,
        /// v̂ᵀ (P_vv + 0.1² I)⁻¹ v̂.
        nis: f64,
    },
    /// Standing was declared for less than half a second: it is not used.
    Flaps {
        /// When it ended.
        time: Time,
    },
}

impl From<Notice> for Event {
    fn from(notice: Notice) -> Event {
        match notice {
            Notice::Contradicted { time, nis } => Event::StandstillContradicted { time, nis },
            Notice::Flaps { time } => Event::StandstillFlaps { time },
        }
    }
}

/// A declared stop; without an end until it is taken back.
///
/// What a topic takes back ends [`LOOK_AHEAD`] before the stamp: whoever says "moving" has seen motion first, and half a second less
/// of standing costs nothing, while a filter that holds a body which drives off takes its speed and its turn for errors. Intervals
/// of the settings are exact.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Span {
    begin: Time,
    end: Option<Time>,
    /// From when on the filter has agreed.
    from: Option<Time>,
    /// Whether it was told that the filter contradicts.
    told: bool,
}

impl Span {
    fn holds_at(&self, at: Time) -> bool {
        self.from.is_some_and(|from| from <= at) && self.end.is_none_or(|end| at < end)
    }

    /// Ask the filter, which has come to `at`, until it agrees: a stop that is declared too early holds as soon as the
    /// body stands. That it contradicts is told once.
    fn judge(&mut self, at: Time, belief: impl Fn() -> Belief) -> Option<Notice> {
        if self.from.is_some() || at < self.begin || self.end.is_some_and(|end| end <= at) {
            return None;
        }
        let Some(nis) = contradicted(&belief()) else {
            self.from = Some(if self.told { at } else { self.begin });
            return None;
        };
        (!core::mem::replace(&mut self.told, true)).then_some(Notice::Contradicted {
            time: self.begin,
            nis,
        })
    }
}

/// Keeps what is declared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Declared {
    intervals: Intervals,
    origin: Option<Time>,
    /// The interval that the filter is in, or was in last.
    interval: Option<Span>,
    /// The topic's last two stops: while the filter is in one, a look ahead may see the next.
    topic: [Option<Span>; 2],
    notices: Deque<Notice, 4>,
}

impl Declared {
    pub(super) fn new(intervals: Intervals) -> Self {
        Declared {
            intervals,
            origin: None,
            interval: None,
            topic: [None; 2],
            notices: Deque::new(),
        }
    }

    pub(super) fn set_origin(&mut self, origin: Time) {
        self.origin = Some(origin);
    }

    /// The first inertial stamp: the zero of intervals unless another one was set.
    pub(super) fn begin_at(&mut self, first: Time) {
        self.origin.get_or_insert(first);
    }

    /// What the topic says.
    pub(super) fn observe(&mut self, said: &Standstill) {
        let open = self.topic[1].filter(|span| span.end.is_none());
        match (said.standing, open) {
            (true, None) => {
                self.topic = [
                    self.topic[1],
                    Some(Span {
                        begin: said.time,
                        end: None,
                        from: None,
                        told: false,
                    }),
                ];
            }
            (false, Some(span)) if said.time.since(span.begin) < LEAST_STOP => {
                self.topic = [None, self.topic[0]];
                self.tell(Notice::Flaps { time: said.time });
            }
            (false, Some(span)) => {
                self.topic[1] = Some(Span {
                    end: Some(said.time.plus(-LOOK_AHEAD)),
                    ..span
                });
            }
            _ => {}
        }
    }

    /// The filter has come to `at`, or nearly, and believes this.
    pub(super) fn judge(&mut self, at: Time, belief: &impl Fn() -> Belief) {
        let origin = self.origin.unwrap_or(at);
        let covering = self
            .intervals
            .as_slice()
            .iter()
            .map(|i| (origin.plus(i[0]), origin.plus(i[1])))
            .find(|(begin, end)| *begin <= at && at <= *end);
        if let Some((begin, end)) = covering
            && self.interval.is_none_or(|span| span.begin != begin)
        {
            self.interval = Some(Span {
                begin,
                end: Some(end),
                from: None,
                told: false,
            });
        }
        let mut spans = [self.interval, self.topic[0], self.topic[1]];
        for span in spans.iter_mut().flatten() {
            if let Some(notice) = span.judge(at, belief) {
                self.tell(notice);
            }
        }
        [self.interval, self.topic[0], self.topic[1]] = spans;
    }

    /// Who declares that the body stands at an instant, and since when.
    pub(super) fn standing_at(&self, at: Time) -> Option<(Time, Witness)> {
        let holds = |span: &&Span| span.holds_at(at);
        let interval = self.interval.as_ref().filter(holds);
        let topic = self.topic.iter().flatten().find(holds);
        match (interval, topic) {
            (Some(span), _) => Some((span.from?, Witness::Interval)),
            (None, Some(span)) => Some((span.from?, Witness::Declared)),
            (None, None) => None,
        }
    }

    pub(super) fn take_notice(&mut self) -> Option<Notice> {
        self.notices.pop_front()
    }

    fn tell(&mut self, notice: Notice) {
        // A topic that flaps for ever is told of often enough.
        let _ = self.notices.push_back(notice);
    }
}
