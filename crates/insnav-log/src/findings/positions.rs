//! Positions that are not what they are taken for: radians, or longitude before latitude.

use super::fit::quantile;
use super::{Facts, Finding, Severity};
use nalgebra::Vector2;
use std::f64::consts::{FRAC_PI_2, PI};

/// Fewest stretches under way that tell.
const FEWEST: usize = 10;
/// Under way is who is faster than this by the receiver's velocity, m/s.
const UNDER_WAY: f64 = 1.0;
/// The middle difference between the way of the positions and the velocity, by the speed: positions that are right are within a fifth ...
const FITS: f64 = 0.2;
/// ... of two readings the one is right that fits so many times better ...
const SURELY: f64 = 3.0;
/// ... and nothing is said of those that are not off by more than this.
const OFF: f64 = 0.5;

/// What latitude and longitude may have been meant for, that are no place on Earth: what the message adds. Degrees.
pub fn why_no_place(latitude_deg: f64, longitude_deg: f64) -> &'static str {
    let (latitude, longitude) = (latitude_deg.abs(), longitude_deg.abs());
    if latitude <= 180.0 && longitude <= 90.0 {
        "they seem to be the other way round: latitude comes first, then longitude"
    } else if latitude <= 90e7 && longitude <= 180e7 && latitude > 1000.0 {
        "they seem to be in 1e-7 degrees, as receivers have them: divide by 1e7"
    } else {
        "a latitude is between -90 and 90 degrees"
    }
}

/// How the positions of a log are to be read instead.
struct Reading {
    code: &'static str,
    what: &'static str,
    remedy: &'static str,
    /// Velocity north and east by what is taken for it, with latitude and longitude in the units that they are taken for.
    velocity: fn(Vector2<f64>, Vector2<f64>) -> Option<Vector2<f64>>,
    /// What looks like it on some roads: another velocity than the receiver's, and the remedy for that.
    lookalike: Option<Lookalike>,
}

/// The way of the positions as they are taken, as what is wrong instead makes it, and what to do then.
type Lookalike = (fn(Vector2<f64>) -> Vector2<f64>, &'static str);

const READINGS: [Reading; 2] = [
    Reading {
        code: "positions_in_radians",
        what: "latitude and longitude in radians, not in degrees",
        remedy: "give degrees",
        velocity: |v, at| {
            let inside = at.x.abs() <= FRAC_PI_2 && at.y.abs() <= PI;
            let east = at.x.cos() / at.x.to_radians().cos();
            inside.then(|| Vector2::new(v.x, v.y * east) * 1f64.to_degrees())
        },
        lookalike: None,
    },
    Reading {
        code: "positions_swapped",
        what: "longitude and latitude, not latitude and longitude",
        remedy: "give latitude first, then longitude",
        velocity: |v, at| {
            let inside = at.y.abs() <= 90.0;
            let (as_given, as_meant) = (at.x.to_radians().cos(), at.y.to_radians().cos());
            inside.then(|| Vector2::new(v.y / as_given, v.x * as_meant))
        },
        // Near the equator, and on roads to the north.
        lookalike: Some((
            |p| Vector2::new(p.y, p.x),
            "if the positions are right, give the velocity north first, then east",
        )),
    },
];

/// Read otherwise, the positions go the way of the receiver's velocity; as they are read, they do not.
pub(super) fn find(facts: &Facts<'_>) -> Option<Finding> {
    let first = facts
        .survey
        .positions
        .iter()
        .find(|p| p.position.is_valid())?;
    // Of the whole log: in a hundred kilometres the length of a degree changes by a few per cent.
    let at = Vector2::new(
        first.position.latitude.to_degrees(),
        first.position.longitude.to_degrees(),
    );
    let both: Vec<(Vector2<f64>, Vector2<f64>)> = facts
        .motion
        .stretches
        .iter()
        .filter_map(|s| Some((s.velocity_n.xy(), s.gnss_velocity_n?.xy())))
        .filter(|(_, v)| v.norm() > UNDER_WAY)
        .collect();
    if both.len() < FEWEST {
        return near_zero(facts);
    }
    let off = |reading: &dyn Fn(Vector2<f64>) -> Option<Vector2<f64>>| {
        let all: Option<Vec<f64>> = both
            .iter()
            .map(|(p, v)| Some((reading(*p)? - v).norm() / v.norm()))
            .collect();
        all.map(|mut all| quantile(&mut all, 0.5))
    };
    let as_given = off(&|p| Some(p))?;
    if as_given < OFF {
        return None;
    }
    READINGS.iter().find_map(|reading| {
        let otherwise = off(&|p| (reading.velocity)(p, at)).filter(|off| *off < FITS)?;
        let lookalike = reading
            .lookalike
            .and_then(|(way, remedy)| Some((off(&|p| Some(way(p)))?, remedy)));
        if lookalike.is_some_and(|(alike, _)| otherwise > SURELY * alike) {
            return None;
        }
        let rival = lookalike.filter(|(alike, _)| *alike <= SURELY * otherwise);
        let finding = Finding::new(
            reading.code,
            if rival.is_none() {
                Severity::Fatal
            } else {
                Severity::Warning
            },
            format!(
                "the positions ({:.6}, {:.6} first) go another way than GNSS velocity (off by {:.0} % of the speed in the middle of {} \
                 stretches), but the same (within {:.0} %) if they are {}",
                at.x,
                at.y,
                100.0 * as_given,
                both.len(),
                100.0 * otherwise,
                reading.what
            ),
            "the solution would be somewhere else on the Earth, and the filter would reject one or the other",
        );
        Some(match rival {
            None => finding.remedy(reading.remedy),
            Some((_, instead)) => finding.remedy(format!("{}; or, {instead}", reading.remedy)),
        })
    })
}

/// Without a velocity to compare with: radians are all near the zeros of latitude and longitude, where few vehicles are.
fn near_zero(facts: &Facts<'_>) -> Option<Finding> {
    let radians = |x: f64, most: f64| x.abs().to_degrees() <= most && x != 0.0;
    let mut places = facts.survey.positions.iter().map(|p| &p.position);
    let all = places.all(|p| radians(p.latitude, FRAC_PI_2) && radians(p.longitude, PI));
    (all && facts.motion.stretches.len() >= FEWEST).then(|| {
        Finding::new(
            "positions_near_zero",
            Severity::Warning,
            "all positions are within 1.6° of the equator and 3.2° of the zero meridian, off the coast of Africa",
            "if they are in radians, all ways are 57 times too short",
        )
        .remedy("give degrees")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::earth::Geodetic;

    /// Steps of a metre north and east, read wrongly and then as they are meant, are a metre again (to the Earth's flattening, 0.7 %).
    #[test]
    fn other_readings_undo_what_was_done() {
        let meant = Geodetic::from_degrees(48.2, 16.4, 200.0);
        for step in [
            Vector2::new(1.0, 0.0),
            Vector2::new(0.0, 1.0),
            Vector2::new(-0.6, 0.8),
        ] {
            let next = meant.offset(&nalgebra::Vector3::new(step.x, step.y, 0.0));
            let degrees = |p: &Geodetic| [p.latitude.to_degrees(), p.longitude.to_degrees()];
            let wrong: [fn([f64; 2]) -> [f64; 2]; 2] =
                [|[a, b]| [a.to_radians(), b.to_radians()], |[a, b]| [b, a]];
            for (reading, wrong) in READINGS.iter().zip(wrong) {
                let [p, q] = [&meant, &next].map(|at| {
                    let [latitude, longitude] = wrong(degrees(at));
                    Geodetic::from_degrees(latitude, longitude, 200.0)
                });
                let at = Vector2::from(degrees(&p));
                let taken = p.offset_to(&q).xy();
                let found = (reading.velocity)(taken, at).expect("within the range");
                assert!((found - step).norm() < 0.01, "{}: {found}", reading.code);
                // The negative control: as it is taken, it is another step.
                assert!((taken - step).norm() > 0.3, "{}: {taken}", reading.code);
            }
        }
    }

    #[test]
    fn what_is_no_place_has_a_likely_cause() {
        assert!(why_no_place(139.7, 35.6).contains("other way round"));
        assert!(why_no_place(481234567.0, 164321000.0).contains("1e-7"));
        assert!(why_no_place(95.0, 100.0).contains("between -90 and 90"));
    }
}
