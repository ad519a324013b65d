//! Which method, for which unit and stops.

use super::options::{AlignmentOptions, StopWindow};
use super::place::Place;
use super::record::{Record, Span};
use super::task::Task;
use super::{AlignmentMethod, AlignmentResult, Refusal};
use crate::error::Result;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

/// Nearer to the pole there is no north to find, rad (89°).
const HIGHEST_LATITUDE: f64 = 1.553_343;
/// And from there on no heading is to be told, rad (89.99°).
const POLE: f64 = 1.570_621;

/// Attitude and sensor errors from one or more stops.
///
/// Levelling, two vectors, coarse, gyrocompass and fine use the last stop alone, all others use every stop. A method that is asked
/// for gives a heading as good as [`AlignmentOptions::largest_azimuth_sigma`] or none; the automatic choice levels where it
/// expects worse, and gives what there is where only the fit shows it ([`AlignmentResult::observable`]).
///
/// # Errors
/// `Alignment` with a [`Refusal`]: windows outside the data or too short, motion inside them, holes, positions that do not tell
/// the unknowns apart, a unit that cannot do what is asked.
pub fn align(
    record: &Record,
    stops: &[StopWindow],
    options: &AlignmentOptions,
) -> Result<AlignmentResult> {
    options.check()?;
    let spans = spans(record, stops)?;
    if options.heading.is_some() && options.position.latitude.abs() > POLE {
        return Err(Refusal::AtPole {
            latitude_deg: options.position.latitude.to_degrees(),
        }
        .into());
    }
    let place = Place::new(&options.position);
    let task = Task {
        record,
        place,
        spans,
        options,
    };
    task.require_gravity()?;
    if options.method == AlignmentMethod::Fine && task.spans.len() > 1 {
        let own = AlignmentOptions {
            heading: task.told_at_last()?,
            ..*options
        };
        return align(record, &stops[stops.len() - 1..], &own);
    }
    if options.method == AlignmentMethod::Levelling {
        return task.levelling("asked for".to_string(), None);
    }
    let polar = options.position.latitude.abs() > HIGHEST_LATITUDE;
    let predicted = task.predicted_azimuth_sigma();
    let limit = options.largest_azimuth_sigma;
    let auto = options.method == AlignmentMethod::Auto;
    let finds_north = !polar && predicted <= limit;
    if auto && !finds_north {
        let reason = if polar {
            "so near a pole there is no north to find".to_string()
        } else {
            format!(
                "the azimuth of this unit in these stops would have a sigma of {}, {:.1}° are allowed",
                in_a_circle(predicted),
                limit.to_degrees()
            )
        };
        return task.levelling(reason, Some(predicted));
    }
    if let (Some((heading, _)), true) = (
        options.heading,
        matches!(
            options.method,
            AlignmentMethod::Coarse | AlignmentMethod::TwoVector | AlignmentMethod::Gyrocompass
        ),
    ) {
        return Err(Refusal::Option {
            key: "heading",
            value: heading,
            expected: "left out with a method that finds it from one stop without any: use auto, fine, joint, kalman or zupt2 with it",
        }
        .into());
    }
    let keeps = matches!(
        options.method,
        AlignmentMethod::Zupt2 | AlignmentMethod::Paper
    );
    if polar {
        return Err(Refusal::AzimuthUnobservable {
            latitude_deg: options.position.latitude.to_degrees(),
        }
        .into());
    }
    if predicted > limit && !(keeps && options.heading.is_some()) {
        return Err(Refusal::LowGrade {
            sigma_azimuth_deg: predicted.to_degrees(),
            limit_deg: limit.to_degrees(),
        }
        .into());
    }
    task.require_long()?;
    record.require_whole(task.whole())?;
    // A heading that is known better than the stops will tell it is kept; another is one more piece of knowledge.
    let better = options.heading.is_some_and(|(_, sigma)| sigma < predicted);
    let method = if auto && better {
        AlignmentMethod::Zupt2
    } else {
        options.method
    };
    let result = match method {
        AlignmentMethod::Coarse | AlignmentMethod::TwoVector | AlignmentMethod::Gyrocompass => {
            task.single(method)
        }
        AlignmentMethod::Paper => task.paper(),
        _ => task.fitted(method),
    }?;
    if auto && options.heading.is_none() && result.azimuth_sigma > limit {
        let reason = format!(
            "the azimuth of this unit in these stops has a sigma of {}, {:.1}° are allowed",
            in_a_circle(result.azimuth_sigma),
            limit.to_degrees()
        );
        return task.levelling(reason, Some(result.azimuth_sigma));
    }
    if !auto && options.heading.is_none() && result.azimuth_sigma > limit {
        return Err(Refusal::LowGrade {
            sigma_azimuth_deg: result.azimuth_sigma.to_degrees(),
            limit_deg: limit.to_degrees(),
        }
        .into());
    }
    Ok(result)
}

fn spans(record: &Record, stops: &[StopWindow]) -> Result<Vec<Span>> {
    if stops.is_empty() {
        return Err(Refusal::NoStop.into());
    }
    for pair in stops.windows(2) {
        if pair[1].begin < pair[0].end {
            return Err(Refusal::StopsOverlap {
                begin_s: pair[1].begin.seconds(),
                previous_end_s: pair[0].end.seconds(),
            }
            .into());
        }
    }
    stops.iter().map(|s| record.span(s.begin, s.end)).collect()
}

/// An angle's sigma in words: more than half a circle is no sigma.
fn in_a_circle(sigma: f64) -> String {
    if sigma < core::f64::consts::PI {
        format!("{:.1}°", sigma.to_degrees())
    } else {
        "more than 180°".to_string()
    }
}
