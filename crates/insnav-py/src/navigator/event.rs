//! Events of a navigator, by kind, with their numbers.

use insnav_core::attitude::Euler;
use insnav_core::solution::Event;
use insnav_core::time::Time;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

/// One event until it is taken.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Told {
    time_s: f64,
    kind: String,
    /// JSON.
    details: String,
}

impl Told {
    /// Seconds count from `zero`.
    pub(super) fn new(event: &Event, zero: Time) -> Self {
        let seconds = |time: Time| time.since(zero);
        let (time, kind, details) = match event {
            Event::Started(start) => (
                start.nav.time,
                "started",
                json!({
                    "heading_source": start.heading_source,
                    "heading_at_s": seconds(start.heading_at),
                    "heading_deg": Euler::from_quaternion(&start.nav.q_nb).heading_deg(),
                    "sigma_heading_deg": start.sigma.attitude.z.to_degrees(),
                    "standing_s": start.standing_s,
                    "reversing": start.reversing,
                }),
            ),
            Event::ImuGap { from, to } => (
                *to,
                "imu_gap",
                json!({"from_s": seconds(*from), "to_s": seconds(*to)}),
            ),
            Event::TooLate { time, filter } => {
                (*time, "too_late", json!({"filter_s": seconds(*filter)}))
            }
            Event::AfterEnd { time } => (*time, "after_end", json!({})),
            Event::DuplicateImu { time } => (*time, "duplicate_imu", json!({})),
            Event::PositionReset { time, offset_n } => (
                *time,
                "position_reset",
                json!({"offset_n_m": offset_n.as_slice()}),
            ),
            Event::StopBegan {
                begin,
                held_from,
                evidence,
            } => (
                *begin,
                "stop_began",
                json!({"held_from_s": seconds(*held_from), "evidence": evidence}),
            ),
            Event::StopNotFused { begin, reason } => (
                *begin,
                "stop_not_fused",
                json!({"reason": reason.to_string()}),
            ),
            Event::StopEnded(stop) => (
                stop.end,
                "stop_ended",
                json!({
                    "begin_s": seconds(stop.begin),
                    "end_s": seconds(stop.end),
                    "held_from_s": seconds(stop.held_from),
                    "ended_by": stop.ended_by,
                    "mode": stop.mode,
                    "heading_growth_deg": stop.heading_growth.to_degrees(),
                    "heading_corrections_deg": stop.heading_corrections.to_degrees(),
                    "sigma_heading_deg": stop.sigma_heading_after.to_degrees(),
                }),
            ),
            Event::StandstillContradicted { time, nis } => {
                (*time, "standstill_contradicted", json!({"nis": nis}))
            }
            Event::StandstillFlaps { time } => (*time, "standstill_flaps", json!({})),
            Event::NotFinite { time, what } => (*time, "not_finite", json!({"what": what})),
            Event::Impossible { time, what, why } => {
                (*time, "impossible", json!({"what": what, "why": why}))
            }
            // More kinds may come.
            other => (zero, "other", json!({"text": format!("{other:?}")})),
        };
        let details = match details {
            Value::Object(map) => map,
            _ => Map::new(),
        };
        Told {
            time_s: seconds(time),
            kind: kind.to_owned(),
            details: Value::Object(details).to_string(),
        }
    }

    /// `insnav.Event`.
    pub(super) fn object<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let fields = PyDict::new(py);
        fields.set_item("time_s", self.time_s)?;
        fields.set_item("kind", &self.kind)?;
        let details = py
            .import("json")?
            .call_method1("loads", (self.details.as_str(),))?;
        fields.set_item("details", details)?;
        py.import("insnav._navigator")?
            .getattr("Event")?
            .call((), Some(&fields))
    }
}
