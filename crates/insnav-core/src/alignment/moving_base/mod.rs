//! Moving-base alignment: attitude from GNSS velocities, whichever way the vehicle looks.
//!
//! Specific force turned by the gyros into the body axes of the first sample and summed up is compared with what the receiver's
//! velocities, the turning Earth and gravity give in the navigation axes of that instant. Both frames stand still against
//! inertial space, so that one constant rotation lies between them (velocity integration formula of \[WuPan13\]). A first
//! guess by Davenport's q-method (\[Shuster81\]) knows nothing of biases; a Kalman filter about it does, and its covariance is
//! the result's. It is not the acceleration alone that is judged but the filter's own sigma: who does not accelerate is told so
//! by that.

mod filter;
mod gains;

use super::stops::{correlate, rotation};
use super::track::Inertial;
use crate::attitude::{Euler, wrap_angle};
use crate::earth::Geodetic;
use crate::imu::ImuNoise;
use crate::measurement::UNSTATED_VELOCITY_SIGMA;
use crate::sample::GnssVelocity;
use crate::time::Time;
use filter::{Fit, fit};
use gains::Gains;
use nalgebra::{Matrix3, Matrix4, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::vec::Vec;

/// Velocities are used this far apart at least, s: no receiver's are independent within a second.
const APART: f64 = 0.95;
/// Fewest velocities that are judged.
pub(super) const FEWEST: usize = 8;
/// A heading is believed below this standard deviation, rad (3°).
pub(super) const BELIEVED: f64 = 0.052;
/// The mean normalised square of the innovations that is still believed (sigmas stated at half their size). What is above one
/// widens the covariance.
const LARGEST_MISFIT: f64 = 4.0;
/// Two headings that fit are told apart by this difference of the sums of squares, about 4.5 standard deviations.
const TOLD_APART: f64 = 20.0;
/// Solutions further apart than this are two, rad.
const ANOTHER: f64 = 0.3;

/// What is known of the unit beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Known {
    /// Gyro bias, rad/s, and its standard deviation.
    pub(super) gyro_bias: Vector3<f64>,
    pub(super) gyro_sigma: f64,
    /// Antenna from the IMU, m.
    pub(super) lever_arm_b: Vector3<f64>,
    /// Least standard deviation of a velocity that is believed, m/s.
    pub(super) velocity_floor: f64,
}

/// Attitude at the first sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingBase {
    /// Body to NED.
    pub q_nb: UnitQuaternion<f64>,
    /// Covariance of a small rotation in n, rad².
    pub covariance_n: Matrix3<f64>,
    /// Standard deviation of the heading, rad.
    pub heading_sigma: f64,
    /// Gyro bias, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Its standard deviations, rad/s.
    pub gyro_bias_sigma: Vector3<f64>,
    /// The last velocity used.
    pub at: Time,
}

/// A velocity and its variances, north, east and down; the last infinite where it is not measured.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fix {
    time: Time,
    velocity_n: Vector3<f64>,
    variance: Vector3<f64>,
}

/// Velocities between two instants, thinned out.
fn fixes(velocities: &[GnssVelocity], from: Time, to: Time, floor: f64) -> Vec<Fix> {
    let mut all: Vec<Fix> = Vec::new();
    for v in velocities {
        let near = all.last().is_some_and(|l| v.time.since(l.time) < APART);
        if v.time < from || v.time > to || near {
            continue;
        }
        let stated = v.covariance_n.map_or_else(
            || Vector3::repeat(UNSTATED_VELOCITY_SIGMA.powi(2)),
            |c| c.diagonal(),
        );
        let mut fix = Fix {
            time: v.time,
            velocity_n: v.velocity_n,
            variance: stated.map(|x| x.max(floor * floor)),
        };
        if v.velocity_n.z.is_nan() {
            fix.velocity_n.z = 0.0;
            fix.variance.z = f64::INFINITY;
        }
        all.push(fix);
    }
    all
}

/// How many velocities would be used if these alone could tell a heading: their spread bounds what they know of it.
pub(super) fn promising(velocities: &[GnssVelocity], from: Time, floor: f64) -> Option<usize> {
    let to = velocities.last()?.time;
    let all = fixes(velocities, from, to, floor);
    let count = all.len() as f64;
    let mean = all.iter().map(|f| f.velocity_n).sum::<Vector3<f64>>() / count;
    let information: f64 = all
        .iter()
        .map(|f| (f.velocity_n - mean).xy().norm_squared() / f.variance.x.max(f.variance.y))
        .sum();
    (all.len() >= FEWEST && information * BELIEVED * BELIEVED >= 1.0).then_some(all.len())
}

/// Attitude at the first of the inertial samples, at `place`; `None` where the velocities do not tell it, or contradict it.
pub(super) fn moving_base(
    imu: &[Inertial],
    velocities: &[GnssVelocity],
    place: &Geodetic,
    noise: &ImuNoise,
    known: &Known,
) -> Option<MovingBase> {
    let (begin, end) = (imu.first()?.time, imu.last()?.time);
    let fixes = fixes(velocities, begin, end, known.velocity_floor);
    if fixes.len() < FEWEST {
        return None;
    }
    let first = Gains::new(imu, &fixes, place, known, &Vector3::zeros())?;
    let guess = guess(&first);
    // Gyro drift tilts gravity into the guess: its heading may be anything. Every quarter is tried.
    let mut found: Vec<Fit> = Vec::new();
    for turn in [0.0, FRAC_PI_2, PI, -FRAC_PI_2] {
        let from = UnitQuaternion::from_scaled_axis(Vector3::z() * turn) * guess;
        found.extend(fit(imu, &fixes, place, noise, known, &first, from));
    }
    found.sort_by(|a, b| a.squares.total_cmp(&b.squares));
    let best = found.first()?;
    let heading = |f: &Fit| Euler::from_quaternion(&f.q_nb).heading;
    let ambiguous = found.iter().any(|other| {
        wrap_angle(heading(other) - heading(best)).abs() > ANOTHER
            && other.squares < best.squares + TOLD_APART
    });
    let misfit = best.squares / best.freedom;
    if ambiguous || misfit > LARGEST_MISFIT {
        return None;
    }
    let covariance_n = best.covariance_n * misfit.max(1.0);
    let euler = Euler::from_quaternion(&best.q_nb);
    let (s, c) = euler.heading.sin_cos();
    let row = Vector3::new(c * euler.pitch.tan(), s * euler.pitch.tan(), 1.0);
    let heading_sigma = row.dot(&(covariance_n * row)).sqrt();
    (heading_sigma <= BELIEVED).then(|| MovingBase {
        q_nb: best.q_nb,
        covariance_n,
        heading_sigma,
        gyro_bias: best.gyro_bias,
        gyro_bias_sigma: best.gyro_bias_sigma * misfit.max(1.0).sqrt(),
        at: fixes[fixes.len() - 1].time,
    })
}

/// The rotation that turns the sums of force onto those of the velocities, all alike.
fn guess(gains: &Gains) -> UnitQuaternion<f64> {
    let count = gains.nodes.len() as f64;
    let (mut from, mut onto) = (Vector3::zeros(), Vector3::zeros());
    for node in &gains.nodes {
        from += node.sum_b() / count;
        onto += node.sum_n() / count;
    }
    let mut k = Matrix4::zeros();
    for node in &gains.nodes {
        k += correlate(&(node.sum_n() - onto), &(node.sum_b() - from));
    }
    rotation(&k)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::alignment::track::inertial;
    use crate::attitude::log;
    use crate::imu::ImuGrade;
    use crate::sample::Sample;
    use crate::sim::{ImuErrorModel, Leg, Scenario, Simulation};

    /// The body looks this much to the right of where it goes, rad.
    const CRAB: f64 = 2.2;
    const LEVER: [f64; 3] = [0.3, -0.2, -0.5];

    fn leg(duration_s: f64, speed_m_per_s: f64, turn_deg: f64, slope_deg: f64) -> Leg {
        Leg {
            duration_s,
            speed_m_per_s,
            turn_deg,
            slope_deg,
        }
    }

    /// A drone that does some manoeuvres, with a consumer's unit and the velocities of a plain receiver.
    fn drone(begin_speed: f64, legs: Vec<Leg>) -> Scenario {
        let mut scenario = Scenario::standing(0.0, 70.0);
        scenario.duration_s = legs.iter().map(|l| l.duration_s).sum();
        scenario.drive.speed_m_per_s = begin_speed;
        scenario.drive.legs = legs;
        scenario.drive.body.tilt_deg = [4.0, -3.0];
        scenario.drive.body.squat_deg_per_m_per_s2 = -3.0;
        scenario.imu.rate_hz = 100.0;
        scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Consumer.noise());
        scenario.gnss.velocity_rate_hz = 5.0;
        scenario.gnss.velocity_sigma_m_per_s = [0.1, 0.1, 0.15];
        scenario.gnss.lever_arm_b_m = LEVER;
        scenario
    }

    fn manoeuvres() -> Vec<Leg> {
        std::vec![
            leg(5.0, 3.0, 0.0, 0.0),
            leg(5.0, 8.0, 60.0, 20.0),
            leg(6.0, 8.0, -100.0, 0.0),
            leg(5.0, 2.0, 0.0, -20.0),
            leg(6.0, 7.0, 80.0, 0.0),
            leg(4.0, 3.0, 0.0, 0.0),
        ]
    }

    fn crab() -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(Vector3::z() * CRAB)
    }

    /// What a unit turned against its way gives, and the velocities.
    fn seen(simulation: &Simulation) -> (Vec<Inertial>, Vec<GnssVelocity>) {
        let mut imu = inertial(&simulation.samples);
        for s in &mut imu {
            s.rate_b = crab().inverse() * s.rate_b;
            s.force_b = crab().inverse() * s.force_b;
        }
        let velocities = simulation.samples.iter().filter_map(|s| match s {
            Sample::GnssVelocity(v) => Some(*v),
            _ => None,
        });
        (imu, velocities.collect())
    }

    fn known(gyro_sigma: f64) -> Known {
        Known {
            gyro_bias: Vector3::zeros(),
            gyro_sigma,
            lever_arm_b: crab().inverse() * Vector3::from(LEVER),
            velocity_floor: 0.02,
        }
    }

    /// Errors of attitude in n, and of the gyro bias, with the result.
    fn solve(scenario: &Scenario, seed: u64) -> Option<(Vector3<f64>, Vector3<f64>, MovingBase)> {
        let simulation = scenario.simulate(seed).expect("a scenario in range");
        let (imu, velocities) = seen(&simulation);
        let noise = scenario.imu.errors.noise.expect("noise");
        let truth = simulation.truth_at(imu[0].time);
        let place = truth.nav.position;
        let sigma = noise.gyro_bias_sigma;
        let found = moving_base(&imu, &velocities, &place, &noise, &known(sigma))?;
        let error = log(&(truth.nav.q_nb * crab() * found.q_nb.inverse()));
        let bias = crab().inverse() * truth.imu_errors.gyro_bias - found.gyro_bias;
        Some((error, bias, found))
    }

    /// 40 seeds: a mean normalised square of one degree of freedom lies in [0.50, 1.68] in 99 % of cases, of three in
    /// [0.70, 1.35].
    fn check(scenario: &Scenario) {
        let (mut heading, mut attitude, mut gyro, mut largest) = (0.0, 0.0, 0.0, 0.0_f64);
        let runs = 40;
        for seed in 0..runs {
            let (error, bias, found) = solve(scenario, seed).expect("told by the velocities");
            let euler = Euler::from_quaternion(&found.q_nb);
            let (s, c) = euler.heading.sin_cos();
            let off = error.z + euler.pitch.tan() * (c * error.x + s * error.y);
            heading += (off / found.heading_sigma).powi(2) / runs as f64;
            let inverse = found.covariance_n.try_inverse().expect("positive");
            attitude += error.dot(&(inverse * error)) / (3 * runs) as f64;
            gyro += bias.component_div(&found.gyro_bias_sigma).norm_squared() / (3 * runs) as f64;
            largest = largest.max(found.heading_sigma.to_degrees());
        }
        std::eprintln!(
            "NEES of heading {heading:.2}, attitude {attitude:.2}, gyro bias {gyro:.2}; largest sigma {largest:.2}°"
        );
        assert!((0.5..1.68).contains(&heading), "{heading}");
        assert!((0.7..1.35).contains(&attitude), "{attitude}");
        assert!((0.7..1.35).contains(&gyro), "{gyro}");
    }

    #[test]
    fn a_drone_in_flight_is_aligned_whichever_way_it_looks() {
        check(&drone(5.0, manoeuvres()));
    }

    #[test]
    fn horizontal_velocities_are_enough() {
        let mut scenario = drone(5.0, manoeuvres());
        scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Industrial.noise());
        let simulation = scenario.simulate(1).expect("in range");
        let (imu, mut velocities) = seen(&simulation);
        for v in &mut velocities {
            v.velocity_n.z = f64::NAN;
        }
        let noise = ImuGrade::Industrial.noise();
        let truth = simulation.truth_at(imu[0].time).nav;
        let known = known(noise.gyro_bias_sigma);
        let found = moving_base(&imu, &velocities, &truth.position, &noise, &known)
            .expect("told by the velocities");
        let error = log(&(truth.q_nb * crab() * found.q_nb.inverse()));
        // Three sigmas on each axis.
        let sigma = found.covariance_n.diagonal().map(f64::sqrt);
        assert!(error.component_div(&sigma).amax() < 3.5, "{error} {sigma}");
    }

    /// The antenna's own velocity in turns counts: without the lever arm the result is wrong, or refused.
    #[test]
    fn a_lever_arm_left_out_is_seen() {
        let mut scenario = drone(5.0, manoeuvres());
        scenario.gnss.lever_arm_b_m = [3.0, 2.0, 0.0];
        scenario.gnss.velocity_sigma_m_per_s = [0.02; 3];
        for seed in 0..5 {
            let simulation = scenario.simulate(seed).expect("in range");
            let (imu, velocities) = seen(&simulation);
            let noise = ImuGrade::Consumer.noise();
            let place = simulation.truth_at(imu[0].time).nav.position;
            let mut known = known(noise.gyro_bias_sigma);
            known.velocity_floor = 0.02;
            let lever = Vector3::new(3.0, 2.0, 0.0);
            known.lever_arm_b = crab().inverse() * lever;
            let with = moving_base(&imu, &velocities, &place, &noise, &known);
            known.lever_arm_b = Vector3::zeros();
            let without = moving_base(&imu, &velocities, &place, &noise, &known);
            assert!(with.is_some() && without.is_none(), "{with:?} {without:?}");
        }
    }

    /// Negative control: at steady velocity, and standing, nothing tells the heading.
    #[test]
    fn without_acceleration_there_is_no_heading() {
        for (speed, slope) in [(0.0, 0.0), (6.0, 0.0), (6.0, 5.0)] {
            let scenario = drone(speed, std::vec![leg(60.0, speed, 0.0, slope)]);
            for seed in 0..20 {
                assert!(solve(&scenario, seed).is_none(), "{speed} m/s, seed {seed}");
            }
        }
    }

    /// A fix in fifty is off by metres a second.
    #[test]
    fn outliers_are_left_out() {
        let mut scenario = drone(5.0, manoeuvres());
        scenario.gnss.outlier_probability = 0.02;
        let (mut told, mut worst) = (0, 0.0_f64);
        for seed in 0..20 {
            if let Some((error, _, found)) = solve(&scenario, seed) {
                told += 1;
                worst = worst.max((error.z / found.heading_sigma).abs());
            }
        }
        // 20 draws of a unit normal stay below 3.5 in 99 %.
        assert!(told >= 16 && worst < 3.5, "{told} {worst}");
    }
}
