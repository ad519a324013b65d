//! Units of the IMU: the force that it feels is gravity most of the time, and turns seen by the receiver are turns of its gyros.

use super::fit::{Slope, slope};
use super::{Facts, Finding, Severity};
use crate::ImuUnits;
use insnav_core::imu::STANDARD_GRAVITY;
use nalgebra::Vector3;

/// Fewest blocks of 0.1 s that tell a unit.
const FEWEST_BLOCKS: usize = 10;
/// Length of the force, in g, that needs no word: a bad accelerometer is off by 5 %.
const USUAL_FORCE: std::ops::Range<f64> = 0.9..1.1;
/// Beyond this, no vehicle could be levelled: 70 % of gravity is a tilt of 45° unseen.
const BEARABLE_FORCE: std::ops::Range<f64> = 0.7..1.4;
/// Below this steadiness the force does not always point the same way, as gravity does.
const STEADY: f64 = 0.8;
/// Below this spread of its lengths the force has one length.
const ONE_LENGTH: f64 = 0.1;
/// A name for a factor must meet it as closely as this.
const NEAR: f64 = 0.1;
/// No gyro of a vehicle measures more, rad/s: 2000 °/s is the widest range on the market but for rockets.
const FASTEST: f64 = 35.0;

/// What is wrong with the accelerations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Force {
    Right,
    /// In a unit that has a name, so much in m/s².
    Unit(&'static str, f64),
    /// Increments over the interval of the samples.
    Increments,
    /// Gravity taken out.
    NoGravity,
    /// Some factor.
    Factor(f64),
    /// Too little data.
    Unknown,
}

/// Judge the length of the force.
pub(super) fn force(length: f64, spread: f64, steadiness: f64, interval: f64) -> Force {
    let near = |value: f64| (length / value - 1.0).abs() < NEAR;
    let of_a_name = || {
        [("g", STANDARD_GRAVITY), ("mg", 1e-3 * STANDARD_GRAVITY)]
            .into_iter()
            .find(|(_, size)| near(STANDARD_GRAVITY / size))
            .map(|(name, size)| Force::Unit(name, size))
    };
    if USUAL_FORCE.contains(&(length / STANDARD_GRAVITY)) {
        return Force::Right;
    }
    if steadiness < STEADY {
        // Tumbled in the hand, or gravity taken out: only the latter is small, and what is left then has any length.
        let tumbled = of_a_name().filter(|_| spread < ONE_LENGTH);
        return if let Some(unit) = tumbled {
            unit
        } else if length < 0.5 * STANDARD_GRAVITY {
            Force::NoGravity
        } else {
            Force::Unknown
        };
    }
    if let Some(unit) = of_a_name() {
        unit
    } else if near(STANDARD_GRAVITY * interval) {
        Force::Increments
    } else if length < 0.3 {
        // The bias that is left over always points the same way.
        Force::NoGravity
    } else {
        Force::Factor(STANDARD_GRAVITY / length)
    }
}

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let mut found = Vec::new();
    let blocks = &facts.survey.imu_blocks;
    if blocks.blocks.len() < FEWEST_BLOCKS {
        return found;
    }
    let m = &facts.motion;
    let force = force(
        m.force_length,
        m.force_spread,
        m.steadiness,
        blocks.interval,
    );
    let rate = rate_factor(facts);
    let units = facts.options().imu_units;
    // One argument for both, or mending one would leave the other.
    let mended = ImuUnits {
        force: units.force
            * match force {
                Force::Unit(_, size) => size,
                Force::Factor(factor) => rounded(factor),
                _ => 1.0,
            },
        rate: units.rate
            * match rate {
                Some((Rate::DegPerS, _)) => 1f64.to_radians(),
                Some((Rate::Factor(f), _)) if force != Force::Increments => rounded(f),
                _ => 1.0,
            },
        increments: units.increments || force == Force::Increments,
    };
    let flag = format!("--imu-units={mended}");
    let length = m.force_length;
    let level = "levelling and every velocity would be wrong from the first second";
    match force {
        Force::Right | Force::Unknown => {}
        Force::Unit(name, _) => found.push(
            Finding::new(
                if name == "g" { "imu_in_g" } else { "imu_in_mg" },
                Severity::Fatal,
                format!(
                    "the specific force is {length:.3} most of the time and {}: gravity in {name}, not in m/s²",
                    if m.steadiness < STEADY {
                        "of that length whichever way the unit is turned"
                    } else {
                        "always points the same way"
                    }
                ),
                format!("{level}: gravity would be taken for {:.0} % of what it is", 100.0 * length / STANDARD_GRAVITY),
            )
            .flag(flag.clone()),
        ),
        Force::Increments => found.push(
            Finding::new(
                "imu_increments",
                Severity::Fatal,
                format!(
                    "the specific force is {length:.4} most of the time, which is gravity times the interval of the samples \
                     ({:.4} m/s in {:.2} ms): these are increments, not rates",
                    STANDARD_GRAVITY * blocks.interval,
                    1e3 * blocks.interval
                ),
                format!("{level}, and turns would be {:.0} times too small", 1.0 / blocks.interval),
            )
            .flag(flag.clone()),
        ),
        Force::NoGravity => found.push(no_gravity(facts)),
        Force::Factor(factor) => found.push(
            Finding::new(
                "imu_force_scale",
                if BEARABLE_FORCE.contains(&(1.0 / factor)) { Severity::Warning } else { Severity::Fatal },
                format!("the specific force is {length:.4} m/s² while the unit turns least, where gravity is {STANDARD_GRAVITY:.2}"),
                "accelerations are off by that factor: the height and every change of speed would be wrong",
            )
            .flag(flag.clone()),
        ),
    }
    match rate {
        Some((Rate::DegPerS, evidence)) => found.push(
            Finding::new(
                "imu_in_deg_per_s",
                Severity::Fatal,
                evidence,
                "attitude would turn 57 times too far",
            )
            .flag(flag),
        ),
        Some((Rate::Factor(factor), evidence)) if force != Force::Increments => found.push(
            Finding::new(
                "imu_rate_scale",
                if (0.5..2.0).contains(&factor) {
                    Severity::Warning
                } else {
                    Severity::Fatal
                },
                evidence,
                "attitude would turn too far or not far enough in every corner",
            )
            .flag(flag),
        ),
        _ => {}
    }
    found
}

/// Four digits: what is found is good to a per cent.
fn rounded(factor: f64) -> f64 {
    format!("{factor:.3e}").parse().unwrap_or(factor)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Rate {
    DegPerS,
    Factor(f64),
}

/// Turn of the course against turn about the vertical of the gyros, with the vertical from gravity.
pub(super) fn turn_slope(facts: &Facts<'_>, down: &Vector3<f64>) -> Option<Slope> {
    any_turn_slope(facts, down).filter(|s| s.sigma < 0.1 * s.value.abs() && s.explained > 0.5)
}

fn any_turn_slope(facts: &Facts<'_>, down: &Vector3<f64>) -> Option<Slope> {
    let points: Vec<(f64, f64, f64)> = facts
        .motion
        .stretches
        .iter()
        .filter_map(|s| {
            let [_, across] = s.along_and_across()?;
            let speed = s.speed();
            // The course's rate has the noise of the acceleration over the speed.
            Some((s.imu?.rate.dot(down), across / speed, speed * speed))
        })
        .collect();
    slope(&points)
}

/// The factor on rates, if they need one, with the evidence for it.
fn rate_factor(facts: &Facts<'_>) -> Option<(Rate, String)> {
    let m = &facts.motion;
    if m.steadiness > STEADY {
        let down = -m.mean_force.normalize();
        let seen = |s: &Slope| {
            format!(
                "the course turns {:.4} ± {:.4} times as far as the gyros say",
                s.value.abs(),
                s.sigma
            )
        };
        if let Some(s) = any_turn_slope(facts, &down) {
            let (factor, sigma) = (s.value.abs(), s.sigma);
            // Degrees are 57 times away from radians: a rough slope will do.
            let off = (factor - 1f64.to_radians()).abs();
            if sigma < 0.25 * factor && off < (3.0 * sigma).max(0.2 * factor) && off < 0.6 * factor
            {
                return Some((
                    Rate::DegPerS,
                    format!("{}: they give degrees per second, not radians", seen(&s)),
                ));
            }
        }
        if let Some(s) = turn_slope(facts, &down) {
            let factor = s.value.abs();
            let evidence = seen(&s);
            return (!(0.75..1.3).contains(&factor)).then_some((Rate::Factor(factor), evidence));
        }
    }
    // Without a turn that the receiver sees, only what no vehicle can do tells.
    let most = facts
        .survey
        .imu_blocks
        .blocks
        .iter()
        .map(|b| b.rate().amax())
        .fold(0.0, f64::max);
    (most > FASTEST).then(|| {
        (
            Rate::DegPerS,
            format!("the gyros turn at {most:.0} rad/s over a tenth of a second, which is {:.0} turns a second: they seem to give degrees per second", most / std::f64::consts::TAU),
        )
    })
}

fn no_gravity(facts: &Facts<'_>) -> Finding {
    let finding = Finding::new(
        "gravity_removed",
        Severity::Fatal,
        format!(
            "the specific force is {:.2} m/s² most of the time, where gravity alone is {STANDARD_GRAVITY:.2}: the driver has taken it out",
            facts.motion.force_length
        ),
        "the vertical is lost, and with it levelling; no flag can bring back what was subtracted with an attitude that is not known",
    );
    match facts.source.other_imu_topics.as_slice() {
        [] => finding.remedy(
            "record the raw acceleration, with gravity: another topic of the driver, or its setting",
        ),
        others => {
            let flags: Vec<String> = others.iter().map(|t| format!("`--topic imu={t}`")).collect();
            let mut finding = finding.remedy(format!(
                "try the other IMU topics of this log ({}), or record the raw acceleration, with gravity",
                flags.join(", ")
            ));
            finding.flag = Some(format!("--topic imu={}", others[0]));
            finding
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_of_the_force_and_their_names() {
        let g = STANDARD_GRAVITY;
        // The sizes that the recordings show at rest: 9.75 to 9.98.
        for real in [9.75, 9.98, 0.95 * g, 1.05 * g] {
            assert_eq!(force(real, 0.02, 0.99, 0.01), Force::Right);
        }
        assert_eq!(force(1.01, 0.02, 0.99, 0.01), Force::Unit("g", g));
        assert_eq!(force(995.0, 0.02, 0.99, 0.01), Force::Unit("mg", 1e-3 * g));
        assert_eq!(force(g / 100.0, 0.02, 0.99, 0.01), Force::Increments);
        assert_eq!(force(g / 200.0, 0.02, 0.99, 0.005), Force::Increments);
        assert_eq!(force(0.05, 0.6, 0.95, 0.01), Force::NoGravity);
        assert_eq!(force(0.9, 0.6, 0.2, 0.01), Force::NoGravity);
        assert_eq!(force(2048.0, 0.02, 0.99, 0.01), Force::Factor(g / 2048.0));
        // In the hand.
        assert_eq!(force(12.0, 0.3, 0.3, 0.01), Force::Unknown);
        // In the hand too, but of one length: gravity in g. The 0.9 above, which is as near to 1, has all lengths.
        assert_eq!(force(1.0, 0.02, 0.2, 0.01), Force::Unit("g", g));
        assert_eq!(force(1000.0, 0.02, 0.2, 0.01), Force::Unit("mg", 1e-3 * g));
        assert_eq!(rounded(9.80665 / 2048.0), 4.788e-3);
    }
}
