//! What the positions say of the motion, beside what the inertial unit says of the same seconds.

use super::fit::quantile;
use crate::Survey;
use insnav_core::sample::GnssPosition;
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};

/// Shortest stretch of positions that a parabola is laid through, s.
const SHORTEST: f64 = 3.0;
/// And least number of intervals of the fixes in it.
const INTERVALS: f64 = 6.0;
/// The share of the log, by how fast the unit turns, in which the force is taken for gravity.
const CALM: f64 = 0.2;
/// Below this speed a course says little, m/s.
const SLOWEST: f64 = 0.5;

/// A few seconds: velocity and acceleration of a parabola through the positions, and the inertial data weighed alike.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch {
    pub(super) time: Time,
    /// North, east, down, m/s.
    pub(super) velocity_n: Vector3<f64>,
    /// North, east, down, m/s².
    pub(super) acceleration_n: Vector3<f64>,
    /// Mean inertial data, when there are any.
    pub(super) imu: Option<Inertial>,
    /// Mean of the receiver's velocity, NED, when there is any.
    pub(super) gnss_velocity_n: Option<Vector3<f64>>,
    /// Scatter of the positions about the parabola, horizontal, per axis, m.
    pub(super) scatter: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Inertial {
    pub(super) rate: Vector3<f64>,
    pub(super) force: Vector3<f64>,
}

/// All stretches of a log that can be used.
#[derive(Clone, Debug, Default)]
pub(super) struct Motion {
    pub(super) stretches: Vec<Stretch>,
    /// Mean specific force of the whole log.
    pub(super) mean_force: Vector3<f64>,
    /// Middle one of the lengths of the specific force while the unit turns least, m/s².
    pub(super) force_length: f64,
    /// Half of what the middle two thirds of these lengths span, by the middle one: gravity has one length, whichever way it points.
    pub(super) force_spread: f64,
    /// Length of the mean force by the mean length: 1 when the force always points the same way.
    pub(super) steadiness: f64,
}

impl Stretch {
    /// Horizontal speed, m/s.
    pub(super) fn speed(&self) -> f64 {
        self.velocity_n.xy().norm()
    }

    /// Acceleration along and across the course (to the right), m/s²; `None` when too slow for a course.
    pub(super) fn along_and_across(&self) -> Option<[f64; 2]> {
        let speed = self.speed();
        let (v, a) = (&self.velocity_n, &self.acceleration_n);
        (speed > SLOWEST).then(|| {
            [
                (v.x * a.x + v.y * a.y) / speed,
                (v.x * a.y - v.y * a.x) / speed,
            ]
        })
    }
}

impl Motion {
    pub(super) fn new(survey: &Survey, time_offset: f64) -> Self {
        let blocks = &survey.imu_blocks.blocks;
        let mut motion = Motion::default();
        if !blocks.is_empty() {
            let mean_length =
                blocks.iter().map(|b| b.force().norm()).sum::<f64>() / blocks.len() as f64;
            // A foot feels more than gravity most of the time, but not while it turns least.
            let mut rates: Vec<f64> = blocks.iter().map(|b| b.rate().norm()).collect();
            let calm = quantile(&mut rates, CALM);
            let mut lengths: Vec<f64> = blocks
                .iter()
                .filter(|b| b.rate().norm() <= calm)
                .map(|b| b.force().norm())
                .collect();
            motion.mean_force = blocks
                .iter()
                .map(super::blocks::Block::force)
                .sum::<Vector3<f64>>()
                / blocks.len() as f64;
            motion.force_length = quantile(&mut lengths, 0.5);
            let [low, high] = [1.0 / 6.0, 5.0 / 6.0].map(|share| quantile(&mut lengths, share));
            motion.force_spread = 0.5 * (high - low) / motion.force_length.max(1e-300);
            motion.steadiness = motion.mean_force.norm() / mean_length.max(1e-300);
        }
        let fixes = &survey.positions;
        let mut steps: Vec<f64> = fixes
            .windows(2)
            .map(|w| w[1].time.since(w[0].time))
            .filter(|dt| *dt > 0.0)
            .collect();
        if steps.len() < 5 {
            return motion;
        }
        let interval = quantile(&mut steps, 0.5);
        let length = SHORTEST.max(INTERVALS * interval);
        let mut begin = 0;
        while let Some(first) = fixes.get(begin) {
            let end = fixes.partition_point(|f| f.time.since(first.time) <= length);
            if let Some(mut s) = parabola(&fixes[begin..end], length, interval) {
                s.imu = inertial(survey, s.time.plus(-time_offset), length);
                s.gnss_velocity_n = gnss_velocity(survey, s.time, length);
                motion.stretches.push(s);
            }
            // Half overlapping.
            let next = fixes.partition_point(|f| f.time.since(first.time) < 0.5 * length);
            begin = next.max(begin + 1);
        }
        // An outlier spoils its stretch.
        let mut scatters: Vec<f64> = motion.stretches.iter().map(|s| s.scatter).collect();
        let usual = quantile(&mut scatters, 0.5);
        motion.stretches.retain(|s| s.scatter < 4.0 * usual + 0.02);
        motion
    }
}

/// Least squares of p + v t + a t²/2 about the middle.
fn parabola(fixes: &[GnssPosition], length: f64, interval: f64) -> Option<Stretch> {
    let (first, last) = (fixes.first()?, fixes.last()?);
    let whole = last.time.since(first.time) > length - 1.5 * interval;
    let holes = fixes
        .windows(2)
        .any(|w| w[1].time.since(w[0].time) > 2.5 * interval);
    if !whole || holes || fixes.len() < 5 {
        return None;
    }
    let middle = first.time.plus(0.5 * last.time.since(first.time));
    let mut normal = Matrix3::zeros();
    let mut right = Matrix3::zeros();
    let points: Vec<(Vector3<f64>, Vector3<f64>)> = fixes
        .iter()
        .map(|f| {
            let t = f.time.since(middle);
            let row = Vector3::new(1.0, t, 0.5 * t * t);
            (row, first.position.offset_to(&f.position))
        })
        .collect();
    for (row, p) in &points {
        normal += row * row.transpose();
        right += row * p.transpose();
    }
    let solution = normal.cholesky()?.solve(&right);
    let squares: f64 = points
        .iter()
        .map(|(row, p)| (p - solution.transpose() * row).xy().norm_squared())
        .sum();
    Some(Stretch {
        time: middle,
        velocity_n: solution.row(1).transpose(),
        acceleration_n: solution.row(2).transpose(),
        imu: None,
        gnss_velocity_n: None,
        scatter: (squares / (2.0 * (points.len() - 3) as f64)).sqrt(),
    })
}

/// Mean inertial data with the weight that a parabola's curvature gives to acceleration, (1 − u²)².
fn inertial(survey: &Survey, middle: Time, length: f64) -> Option<Inertial> {
    let blocks = &survey.imu_blocks.blocks;
    let half = 0.5 * length;
    let begin = blocks.partition_point(|b| b.time < middle.plus(-half));
    let (mut rate, mut force, mut total, mut count) = (Vector3::zeros(), Vector3::zeros(), 0.0, 0);
    for block in &blocks[begin..] {
        let u = block.time.since(middle) / half;
        if u > 1.0 {
            break;
        }
        let w = (1.0 - u * u).powi(2);
        rate += block.rate() * w;
        force += block.force() * w;
        total += w;
        count += 1;
    }
    // A block is a tenth of a second, or one sample of a slow unit.
    let expected = length / survey.imu_blocks.interval.max(0.1);
    (f64::from(count) > 0.7 * expected && total > 0.0).then(|| Inertial {
        rate: rate / total,
        force: force / total,
    })
}

/// Mean velocity of the receiver with the weight that a parabola's slope gives to velocity, 1 − u².
fn gnss_velocity(survey: &Survey, middle: Time, length: f64) -> Option<Vector3<f64>> {
    let fixes = &survey.velocities;
    let half = 0.5 * length;
    let begin = fixes.partition_point(|v| v.time < middle.plus(-half));
    let (mut sum, mut total, mut count) = (Vector3::zeros(), 0.0, 0);
    for fix in &fixes[begin..] {
        let u = fix.time.since(middle) / half;
        if u > 1.0 {
            break;
        }
        let w = 1.0 - u * u;
        sum += fix.velocity_n * w;
        total += w;
        count += 1;
    }
    (count >= 3 && total > 0.0).then(|| sum / total)
}
