//! Which way the IMU is mounted: down by gravity, forward by accelerations that the receiver sees, handedness by the turns.

use super::fit::{Pair, Turn, turn};
use super::imu_units::{Force, force, turn_slope};
use super::{Facts, Finding, Severity};
use crate::{ImuAxes, imu_to_body};
use insnav_core::config::VehicleKind;
use nalgebra::{Matrix3, Rotation3, Vector3};

/// An angle that slopes, suspension and a careless bracket explain needs no word, rad.
const TOLERATED: f64 = 25.0 / 180.0 * std::f64::consts::PI;
/// Mountings are first looked for among the 24 of right angles, this near, rad.
const NEAR: f64 = 22.0 / 180.0 * std::f64::consts::PI;
/// A forward axis must be known as well as this, rad.
const KNOWN: f64 = 6.0 / 180.0 * std::f64::consts::PI;
/// This well will do to tell right angles apart, rad: they are four sigmas from the middle between two.
const ROUGHLY: f64 = 10.0 / 180.0 * std::f64::consts::PI;
/// And motion explain this much of the forces, or it is no vehicle that moves where it points.
const COHERENT: f64 = 0.5;

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let m = &facts.motion;
    let blocks = &facts.survey.imu_blocks;
    let judged = force(
        m.force_length,
        m.force_spread,
        m.steadiness,
        blocks.interval,
    );
    let points_one_way = m.steadiness > 0.8 && blocks.blocks.len() >= 10;
    if !points_one_way || matches!(judged, Force::NoGravity | Force::Unknown) {
        return Vec::new();
    }
    let up_force = m.mean_force.normalize();
    let mut down = -up_force;
    let seen = Seen::new(facts, &down);
    let slope = turn_slope(facts, &down);
    let mut found = Vec::new();
    let backward = seen.forward(false).is_some_and(|(f, _)| f.x < -0.7);
    // Upside down and backward is what a wrong sign looks like on a straight road; there only the turns can tell.
    let looks_inverted = seen.fits_both() && down.z < -0.7 && backward;
    if looks_inverted && slope.is_none() {
        found.push(either_sign());
        return found;
    }
    let mirrored = seen.is_mirrored() || looks_inverted && slope.is_some_and(|s| s.value < 0.0);
    if mirrored {
        // The force points down where it should point up: the vertical is the other one.
        down = up_force;
    }
    // The turns decide which of both sensors has the wrong sign; without them, it is left open.
    let turns_agree = slope.map(|s| (s.value > 0.0) != mirrored);
    let units = facts.options().imu_units;
    if mirrored {
        let mut mended = units;
        mended.force = -mended.force;
        found.push(
            Finding::new(
                "imu_force_sign",
                Severity::Fatal,
                format!(
                    "forces to the sides are the mirror image of what the turns of {} need (coherence {:.2} mirrored, {:.2} as given): \
                     the accelerometers give gravity, which points down, where specific force points up",
                    count(seen.pairs.len()),
                    seen.mirrored.map_or(0.0, |t| t.coherence),
                    seen.direct.map_or(0.0, |t| t.coherence)
                ),
                "levelling would turn the vehicle over, and braking would be taken for accelerating",
            )
            .flag(format!("--imu-units={mended}")),
        );
    }
    if turns_agree == Some(false) && !seen.tells() {
        // Too few changes of speed to say which.
        found.push(either_sign());
        return found;
    }
    if turns_agree == Some(false) {
        let mut mended = units;
        mended.rate = -mended.rate;
        let s = slope.map_or(0.0, |s| s.value);
        found.push(
            Finding::new(
                "imu_rate_sign",
                Severity::Fatal,
                format!("the course turns {s:.2} times as far as the gyros say about the axis that gravity and forces call down: their sign is wrong"),
                "every corner would be taken to the wrong side",
            )
            .flag(format!("--imu-units={mended}")),
        );
    }
    found.extend(mounting(facts, &down, &seen, mirrored));
    found
}

/// One of both sensors has the wrong sign, and the motion does not tell which.
fn either_sign() -> Finding {
    Finding::new(
        "imu_sign",
        Severity::Fatal,
        "gravity, changes of speed and turns do not fit together: accelerometers or gyros have the wrong sign, or the unit is \
         mounted upside down and backward",
        "every corner would be taken to the wrong side, or braking for accelerating",
    )
    .remedy(
        "drive with turns and changes of speed to tell which, or try `--imu-units=-1m/s2` (accelerometers that give gravity), \
         `--imu-units=-1rad/s`, and `--imu-mounting-deg pitch=180`",
    )
}

/// Forces that the unit felt beside accelerations that the receiver saw.
struct Seen {
    /// Directions in the body's axes as declared: two horizontal ones, the second to the right of the first.
    first: Vector3<f64>,
    second: Vector3<f64>,
    pairs: Vec<(Pair, Pair)>,
    direct: Option<Turn>,
    mirrored: Option<Turn>,
    /// By speed times turn alone, as the gyros have it: for slow vehicles, whose accelerations the positions hardly show.
    by_turns: Option<Turn>,
}

impl Seen {
    fn new(facts: &Facts<'_>, down: &Vector3<f64>) -> Self {
        // From whichever axis lies most level.
        let reference = if down.x.abs() < 0.7 {
            Vector3::x()
        } else {
            Vector3::y()
        };
        let first = (reference - down * reference.dot(down)).normalize();
        let second = down.cross(&first);
        let mut pairs: Vec<(Pair, Pair)> = facts
            .motion
            .stretches
            .iter()
            .filter_map(|s| {
                let imu = s.imu?;
                let [re, im] = s.along_and_across()?;
                let felt = Pair {
                    re: imu.force.dot(&first),
                    im: imu.force.dot(&second),
                };
                Some((felt, Pair { re, im }))
            })
            .collect();
        // Biases and the tilt left over are the same in all.
        let n = pairs.len().max(1) as f64;
        let mean = |of: fn(&(Pair, Pair)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let (xr, xi) = (mean(|p| p.0.re), mean(|p| p.0.im));
        let (yr, yi) = (mean(|p| p.1.re), mean(|p| p.1.im));
        for (x, y) in &mut pairs {
            *x = Pair {
                re: x.re - xr,
                im: x.im - xi,
            };
            *y = Pair {
                re: y.re - yr,
                im: y.im - yi,
            };
        }
        Seen {
            first,
            second,
            by_turns: by_turns(facts, down, &first, &second),
            direct: turn(&pairs, false),
            mirrored: turn(&pairs, true),
            pairs,
        }
    }

    /// Whether the forces fit the motion at all.
    fn tells(&self) -> bool {
        let of = |t: &Option<Turn>| t.map_or(0.0, |t| t.coherence);
        self.pairs.len() >= 20 && of(&self.direct).max(of(&self.mirrored)) > COHERENT
    }

    /// Whether the motion was so straight that the mirror image fits about as well.
    fn fits_both(&self) -> bool {
        let of = |t: &Option<Turn>| t.map_or(0.0, |t| t.coherence);
        let (direct, mirrored) = (of(&self.direct), of(&self.mirrored));
        direct.min(mirrored) > COHERENT && (direct - mirrored).abs() < 0.3
    }

    /// Whether the forces fit the motion only as their mirror image.
    fn is_mirrored(&self) -> bool {
        let of = |t: &Option<Turn>| t.map_or(0.0, |t| t.coherence);
        let (direct, mirrored) = (of(&self.direct), of(&self.mirrored));
        self.pairs.len() >= 20 && mirrored > 0.6 && mirrored > direct + 0.3
    }

    /// Forward, in the body's axes as declared, and how well it is known.
    fn forward(&self, mirrored: bool) -> Option<(Vector3<f64>, Turn)> {
        let known = |t: &Turn| t.sigma < KNOWN && t.coherence > COHERENT && self.pairs.len() >= 20;
        let t = if mirrored {
            self.mirrored.filter(known)
        } else {
            self.direct.filter(known).or(self.by_turns)
        }?;
        // Mirrored, the second axis points the other way; and the force itself.
        let (second, sign) = if mirrored {
            (-self.second, -1.0)
        } else {
            (self.second, 1.0)
        };
        let forward = sign * (self.first * t.angle.cos() - second * t.angle.sin());
        Some((forward, t))
    }
}

/// Forward by the force to the right in turns: speed times the rate of the gyros about the vertical.
///
/// The size of the force must be right as well, which neither chance nor gyros in another unit achieve.
fn by_turns(
    facts: &Facts<'_>,
    down: &Vector3<f64>,
    first: &Vector3<f64>,
    second: &Vector3<f64>,
) -> Option<Turn> {
    let points: Vec<(f64, f64, f64)> = facts
        .motion
        .stretches
        .iter()
        .filter_map(|s| {
            let imu = s.imu?;
            let across = s.speed() * imu.rate.dot(down);
            Some((across, imu.force.dot(first), imu.force.dot(second)))
        })
        .collect();
    let n = points.len() as f64;
    let mean = |of: fn(&(f64, f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / n;
    let (mx, mre, mim) = (mean(|p| p.0), mean(|p| p.1), mean(|p| p.2));
    let (mut xx, mut re, mut im, mut ff) = (0.0, 0.0, 0.0, 0.0);
    for p in &points {
        let (x, a, b) = (p.0 - mx, p.1 - mre, p.2 - mim);
        xx += x * x;
        re += x * a;
        im += x * b;
        ff += a * a + b * b;
    }
    let explained = (re * re + im * im) / xx;
    let scale = re.hypot(im) / xx;
    let sigma = ((ff - explained) / (2.0 * (n - 2.0)) / xx).sqrt() / scale;
    let turn = Turn {
        // Force to the right is a quarter turn from forward.
        angle: std::f64::consts::FRAC_PI_2 - im.atan2(re),
        sigma,
        scale,
        coherence: (explained / ff).sqrt(),
    };
    let sure = n >= 50.0 && (0.6..1.6).contains(&scale) && sigma < ROUGHLY;
    sure.then_some(turn)
}

fn mounting(
    facts: &Facts<'_>,
    down: &Vector3<f64>,
    seen: &Seen,
    mirrored: bool,
) -> Option<Finding> {
    let tilt = down.z.clamp(-1.0, 1.0).acos();
    let force = facts.motion.mean_force;
    let gravity = format!(
        "the mean specific force is ({:.1}, {:.1}, {:.1}) forward, right, down as declared, where (0, 0, −9.8) is due",
        force.x, force.y, force.z
    );
    let consequence = "roll, pitch and heading of the solution are those of the unit's axes, not of the vehicle; lever arms point the wrong \
                       way, and a heading from the course is given to an axis that does not point forward";
    let Some((forward, known)) = seen.forward(mirrored) else {
        return (tilt > TOLERATED).then(|| tilted(facts, down, &gravity, consequence));
    };
    let right = down.cross(&forward);
    // Rows: forward, right and down of the vehicle in the axes as declared.
    let found = Matrix3::from_rows(&[forward.transpose(), right.transpose(), down.transpose()]);
    let rotation = Rotation3::from_matrix_unchecked(found);
    let yaw_tells = rotation.angle() > TOLERATED && rotation.angle() > 3.0 * known.sigma;
    if !yaw_tells || facts.config.vehicle.kind == VehicleKind::Any && tilt < TOLERATED {
        return None;
    }
    let (nearest, off) = nearest_right_angled(&rotation);
    let snapped = off < NEAR;
    if !snapped && known.sigma > KNOWN {
        return (tilt > TOLERATED).then(|| tilted(facts, down, &gravity, consequence));
    }
    let rotation = if snapped { nearest } else { rotation };
    if rotation.angle() < 1e-6 {
        return None;
    }
    let evidence = format!(
        "{gravity}; {} of motion put forward along ({:.2}, {:.2}, {:.2}) of the axes as declared, ± {:.1}°{}",
        count(seen.pairs.len()),
        forward.x,
        forward.y,
        forward.z,
        known.sigma.to_degrees(),
        if snapped {
            format!(", {:.0}° from a mounting of right angles", off.to_degrees())
        } else {
            String::new()
        }
    );
    Some(if is_half_turn_about_forward(&rotation) {
        Finding::new("imu_axes", Severity::Warning, evidence, consequence).flag(other_axes(facts))
    } else {
        Finding::new("imu_mounting", Severity::Warning, evidence, consequence)
            .flag(mounting_flag(facts, &rotation))
    })
}

/// Gravity alone: down is known, forward is not.
fn tilted(facts: &Facts<'_>, down: &Vector3<f64>, gravity: &str, consequence: &str) -> Finding {
    if down.z < -0.9 {
        return Finding::new(
            "imu_axes",
            Severity::Warning,
            format!("{gravity}: the axes are upside down"),
            consequence,
        )
        .flag(other_axes(facts))
        .and("; where forward is, this log does not tell");
    }
    Finding::new(
        "imu_mounting",
        Severity::Warning,
        format!("{gravity}: the unit is not mounted level, and too little motion shows which axis points forward"),
        consequence,
    )
    .remedy("give the mounting: `--imu-mounting-deg roll=…,pitch=…,yaw=…`")
}

/// The rotation by multiples of right angles that is nearest, and how far it is, rad.
fn nearest_right_angled(rotation: &Rotation3<f64>) -> (Rotation3<f64>, f64) {
    let mut best = (Rotation3::identity(), f64::INFINITY);
    for x in 0..3_usize {
        for y in (0..3).filter(|y| *y != x) {
            for signs in 0..4_u8 {
                let sign = |bit: u8| if signs >> bit & 1 == 1 { -1.0 } else { 1.0 };
                let mut first = Vector3::zeros();
                let mut second = Vector3::zeros();
                first[x] = sign(0);
                second[y] = sign(1);
                let third = first.cross(&second);
                let candidate = Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
                    first.transpose(),
                    second.transpose(),
                    third.transpose(),
                ]));
                let off = candidate.angle_to(rotation);
                if off < best.1 {
                    best = (candidate, off);
                }
            }
        }
    }
    best
}

fn is_half_turn_about_forward(rotation: &Rotation3<f64>) -> bool {
    let half_turn = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    (rotation.matrix() - half_turn).norm() < 1e-6
}

fn other_axes(facts: &Facts<'_>) -> String {
    match facts.options().imu_axes {
        ImuAxes::Flu => "--imu-axes frd",
        ImuAxes::Frd => "--imu-axes flu",
    }
    .into()
}

/// The mounting that replaces the one in use: that of the unit's own axes.
fn mounting_flag(facts: &Facts<'_>, rotation: &Rotation3<f64>) -> String {
    let options = facts.options();
    let axes = imu_to_body(options.imu_axes, None);
    let in_use = imu_to_body(options.imu_axes, options.imu_mounting_rpy_deg);
    // What is due is rotation · in_use = axes · mounting.
    let mounting = axes.transpose() * rotation.matrix() * in_use;
    let (roll, pitch, yaw) = Rotation3::from_matrix_unchecked(mounting).euler_angles();
    let parts: Vec<String> = [("roll", roll), ("pitch", pitch), ("yaw", yaw)]
        .into_iter()
        .map(|(name, angle)| (name, angle.to_degrees().round()))
        .filter(|(_, angle)| *angle != 0.0)
        .map(|(name, angle)| format!("{name}={angle}"))
        .collect();
    if parts.is_empty() {
        return "--imu-mounting-deg roll=0".into();
    }
    format!("--imu-mounting-deg {}", parts.join(","))
}

fn count(stretches: usize) -> String {
    format!("{stretches} stretches of some seconds")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_24_are_24_and_each_is_its_own_nearest() {
        let mut seen = Vec::new();
        for roll in [0.0, 90.0, 180.0, 270.0_f64] {
            for pitch in [-90.0, 0.0, 90.0_f64] {
                for yaw in [0.0, 90.0, 180.0, 270.0_f64] {
                    let r = Rotation3::from_euler_angles(
                        roll.to_radians(),
                        pitch.to_radians(),
                        yaw.to_radians(),
                    );
                    let (nearest, off) = nearest_right_angled(&r);
                    assert!(off < 1e-6);
                    let tilted = Rotation3::from_euler_angles(0.1, -0.15, 0.2) * r;
                    assert!(
                        (nearest_right_angled(&tilted).0.matrix() - nearest.matrix()).norm() < 1e-9
                    );
                    let key = nearest.matrix().map(|x| x.round() as i8);
                    if !seen.contains(&key) {
                        seen.push(key);
                    }
                }
            }
        }
        assert_eq!(seen.len(), 24);
    }
}
