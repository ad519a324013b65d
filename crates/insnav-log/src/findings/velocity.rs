//! Axes and unit of the receiver's velocity, by its own positions.

use super::fit::{Pair, Turn, slope, turn};
use super::{Facts, Finding, Severity};
use crate::velocity_axes::VelocityAxes;
use nalgebra::Vector3;
use std::f64::consts::FRAC_PI_2;

/// Fewest stretches that tell.
const FEWEST: usize = 20;
/// A turn of the axes must explain the positions as well as this.
const COHERENT: f64 = 0.97;
/// And be within this of a right angle to have a name, rad.
const NEAR: f64 = 0.26;
/// Speeds that differ by less than this factor need no word: at standstill and in bends, smoothing makes some.
const USUAL_SCALE: std::ops::Range<f64> = 0.8..1.25;

pub(super) fn find(facts: &Facts<'_>) -> Option<Finding> {
    let both: Vec<(Vector3<f64>, Vector3<f64>)> = facts
        .motion
        .stretches
        .iter()
        .filter_map(|s| Some((s.gnss_velocity_n?, s.velocity_n)))
        .filter(|(v, p)| v.xy().norm().max(p.xy().norm()) > 0.5)
        .collect();
    if both.len() < FEWEST {
        return None;
    }
    let pair = |v: &Vector3<f64>| Pair { re: v.x, im: v.y };
    let pairs: Vec<(Pair, Pair)> = both.iter().map(|(v, p)| (pair(v), pair(p))).collect();
    let direct = turn(&pairs, false)?;
    let mirrored = turn(&pairs, true)?;
    let best = if mirrored.coherence > direct.coherence {
        mirrored
    } else {
        direct
    };
    let consequence = "the filter would be pulled to the wrong side, or reject every velocity";
    if best.coherence < COHERENT {
        return in_body_axes(&both, best, consequence);
    }
    let quarter = (best.angle / FRAC_PI_2).round();
    let off = (best.angle - quarter * FRAC_PI_2).abs();
    let is_mirrored = mirrored.coherence > direct.coherence;
    let evidence = |what: &str| {
        format!(
            "{what} (coherence {:.3}; as declared {:.3}, turned by {:.0}°; {} stretches under way)",
            best.coherence,
            direct.coherence,
            direct.angle.to_degrees(),
            both.len()
        )
    };
    let turned = is_mirrored || quarter != 0.0;
    let vertical = vertical_sign(&both);
    let downward = vertical.is_some_and(|s| s < 0.0);
    if off > NEAR || off > 0.1 && !turned {
        return Some(
            Finding::new(
                "velocity_turned",
                Severity::Warning,
                evidence(&format!(
                    "GNSS velocity is turned by {:.1}° against the way that the positions go",
                    best.angle.to_degrees()
                )),
                consequence,
            )
            .remedy("do without it: `--topic gnss-velocity=none`; or let the driver give east, north, up")
            .flag_only("--topic gnss-velocity=none"),
        );
    }
    if !USUAL_SCALE.contains(&best.scale) {
        let unit = [
            ("km/h", 3.6),
            ("knots", 1.943_844),
            ("mm/s", 1e3),
            ("cm/s", 1e2),
        ]
        .into_iter()
        .find(|(_, size)| (best.scale * size - 1.0).abs() < 0.1)
        .map_or(String::new(), |(name, _)| {
            format!(": it seems to be in {name}")
        });
        return Some(
            Finding::new(
                "velocity_scale",
                Severity::Warning,
                format!(
                    "positions move {:.3} times as fast as GNSS velocity says{unit}",
                    best.scale
                ),
                consequence,
            )
            .remedy("do without it: `--topic gnss-velocity=none`; or let the driver give m/s")
            .flag_only("--topic gnss-velocity=none"),
        );
    }
    if !turned && !downward {
        return None;
    }
    // North, east and down of the truth in terms of what was taken for them; a swap of the horizontal axes without a vertical
    // that tells is the usual one, north, east, down.
    let down_reversed = vertical.map_or(is_mirrored, |s| s < 0.0);
    let axes = turned_axes(is_mirrored, quarter as i32, down_reversed);
    // Arrays are north, east, down by definition, and no flag turns them.
    let read_as = match facts.source.options {
        Some(_) => facts.options().gnss_velocity_axes,
        None => VelocityAxes::NED,
    };
    let name = read_as.turned(axes);
    let what = if turned {
        format!("GNSS velocity fits the positions only when it is taken as {name}")
    } else {
        format!(
            "the vertical GNSS velocity has the sign of its height reversed: it fits the positions as {name}"
        )
    };
    let finding = Finding::new(
        "velocity_axes",
        Severity::Warning,
        evidence(&what),
        consequence,
    );
    Some(match facts.source.options {
        Some(_) => finding.flag(format!("--gnss-velocity-axes {name}")),
        None => finding.remedy(format!(
            "give the columns of `gnss_velocity` as north, east, down: these look like {name}"
        )),
    })
}

impl Finding {
    /// The argument without changing the remedy's text.
    fn flag_only(mut self, flag: &str) -> Self {
        self.flag = Some(flag.into());
        self
    }
}

/// Where what is taken for east, north and up really points: axis (0 east, 1 north, 2 up) and whether reversed.
///
/// A turn by `quarter` right angles from north to east takes the velocity, or its image with east reversed, to the truth.
fn turned_axes(mirrored: bool, quarter: i32, up_reversed: bool) -> [(usize, bool); 3] {
    // Taken for north (1, 0) and for east (0, 1), or (0, −1) in the mirror, as quarters from north.
    let direction = |quarters: i32| match quarters.rem_euclid(4) {
        0 => (1, false),
        1 => (0, false),
        2 => (1, true),
        _ => (0, true),
    };
    let east = if mirrored { -1 } else { 1 };
    [
        direction(east + quarter),
        direction(quarter),
        (2, up_reversed),
    ]
}

/// Sign of the vertical velocity against the height, where there is enough of both.
fn vertical_sign(both: &[(Vector3<f64>, Vector3<f64>)]) -> Option<f64> {
    let points: Vec<(f64, f64, f64)> = both
        .iter()
        .filter(|(v, _)| v.z.is_finite())
        .map(|(v, p)| (v.z, p.z, 1.0))
        .collect();
    let s = slope(&points).filter(|_| points.len() >= FEWEST)?;
    let sure = s.value.abs() > 8.0 * s.sigma && (0.5..2.0).contains(&s.value.abs());
    (sure && s.explained > 0.5).then_some(s.value.signum())
}

/// A speed that always points along x while the positions go all ways.
fn in_body_axes(
    both: &[(Vector3<f64>, Vector3<f64>)],
    best: Turn,
    consequence: &str,
) -> Option<Finding> {
    let n = both.len() as f64;
    let lengths =
        |of: fn(&(Vector3<f64>, Vector3<f64>)) -> f64| both.iter().map(of).sum::<f64>() / n;
    let (v, p) = (lengths(|b| b.0.xy().norm()), lengths(|b| b.1.xy().norm()));
    let mean_v = both
        .iter()
        .map(|b| b.0.xy())
        .sum::<nalgebra::Vector2<f64>>()
        / n;
    let mean_p = both
        .iter()
        .map(|b| b.1.xy())
        .sum::<nalgebra::Vector2<f64>>()
        / n;
    let same_speed = USUAL_SCALE.contains(&(v / p));
    let points_one_way = mean_v.norm() > 0.97 * v && mean_p.norm() < 0.8 * p;
    (same_speed && points_one_way).then(|| {
        Finding::new(
            "velocity_in_body_axes",
            Severity::Warning,
            format!(
                "GNSS velocity always points the same way while the positions go all ways, at the same speed ({v:.1} and {p:.1} m/s; \
                 coherence {:.2}): it is along the vehicle, not east, north, up",
                best.coherence
            ),
            consequence,
        )
        .remedy("do without it: `--topic gnss-velocity=none`; or let the driver give east, north, up")
        .flag_only("--topic gnss-velocity=none")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VelocityAxes;

    /// Whatever axes a message has, the name that is found is that of its axes.
    #[test]
    fn axes_are_named_by_the_turn_that_mends_them() {
        for text in ["enu", "ned", "nwu", "wsu", "seu", "end", "esd", "wnd"] {
            let axes: VelocityAxes = text.parse().unwrap();
            // The message of a velocity, and what reading it as enu makes of it: the inverse and the identity.
            let pairs: Vec<(Pair, Pair)> = (0..40)
                .map(|i| {
                    let a = f64::from(i) * 0.37;
                    let enu = Vector3::new(5.0 * a.cos(), 7.0 * a.sin(), 0.0);
                    let message = Vector3::from_fn(|k, _| {
                        (0..3)
                            .map(|j| {
                                let mut unit = Vector3::zeros();
                                unit[k] = 1.0;
                                axes.to_enu(&unit)[j] * enu[j]
                            })
                            .sum()
                    });
                    let pair = |enu: &Vector3<f64>| Pair {
                        re: enu.y,
                        im: enu.x,
                    };
                    (pair(&message), pair(&enu))
                })
                .collect();
            let (direct, mirrored) = (turn(&pairs, false).unwrap(), turn(&pairs, true).unwrap());
            let is_mirrored = mirrored.coherence > direct.coherence;
            let best = if is_mirrored { mirrored } else { direct };
            assert!(best.coherence > 0.999_999, "{text}");
            let quarter = (best.angle / FRAC_PI_2).round() as i32;
            let down = text.contains('d');
            let found = VelocityAxes::default().turned(turned_axes(is_mirrored, quarter, down));
            assert_eq!(found.to_string(), text);
        }
    }
}
