//! What has come out of a navigator and was not taken yet.

use super::event::Told;
use insnav_core::filter::Update;
use insnav_core::solution::{Epoch, Event, Sink};
use insnav_core::time::Time;
use insnav_log::ros2::State;
use insnav_log::{SinkOptions, StateSink, UpdateRow};
use serde::{Deserialize, Serialize};

/// Keeps epochs at the rate of the settings, measurements and events; or the newest epoch alone.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Pending {
    states: StateSink<Vec<State<'static>>>,
    updates: Vec<UpdateRow>,
    events: Vec<Told>,
    newest: Option<State<'static>>,
    keep: bool,
    /// From when the seconds of events count.
    zero: Time,
}

impl Pending {
    pub(super) fn new(options: &SinkOptions, keep: bool, zero: Time) -> Self {
        Pending {
            states: StateSink::new(options),
            updates: Vec::new(),
            events: Vec::new(),
            newest: None,
            keep,
            zero,
        }
    }

    pub(super) fn take(&mut self) -> (Vec<State<'static>>, Vec<UpdateRow>) {
        let states = core::mem::take(self.states.kept_mut());
        // Of what is given away the newest stays known.
        self.newest = states.last().copied().or(self.newest);
        (states, core::mem::take(&mut self.updates))
    }

    pub(super) fn take_events(&mut self) -> Vec<Told> {
        core::mem::take(&mut self.events)
    }

    /// A copy to go on with that has nothing to take yet.
    pub(super) fn emptied(&mut self) -> Self {
        let states = core::mem::take(self.states.kept_mut());
        let updates = core::mem::take(&mut self.updates);
        let events = core::mem::take(&mut self.events);
        let emptied = self.clone();
        *self.states.kept_mut() = states;
        (self.updates, self.events) = (updates, events);
        emptied
    }

    /// Go on from such a copy, with what it has to take behind what is here.
    pub(super) fn follow(&mut self, mut later: Self) {
        let before = self.states.kept_mut();
        let after = later.states.kept_mut();
        if self.keep || after.is_empty() {
            before.append(after);
            core::mem::swap(before, after);
        }
        self.updates.append(&mut later.updates);
        self.events.append(&mut later.events);
        core::mem::swap(&mut self.updates, &mut later.updates);
        core::mem::swap(&mut self.events, &mut later.events);
        *self = later;
    }

    pub(super) fn newest(&self) -> Option<&State<'static>> {
        self.states.kept().last().or(self.newest.as_ref())
    }
}

impl Sink for Pending {
    fn wants_epoch(&mut self, time: Time) -> bool {
        self.states.wants_epoch(time)
    }

    fn epoch(&mut self, epoch: &Epoch) {
        if !self.keep {
            self.states.kept_mut().clear();
        }
        self.states.epoch(epoch);
    }

    fn update(&mut self, update: &Update) {
        if self.keep {
            self.updates.push(UpdateRow::from(update));
        }
    }

    fn event(&mut self, event: &Event) {
        if self.keep {
            self.events.push(Told::new(event, self.zero));
        }
    }
}
