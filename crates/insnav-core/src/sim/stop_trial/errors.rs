//! Errors of one run of a trial, and what the filter said of them.

use super::trial::StopTrial;
use crate::attitude::log;
use crate::error::{Error, Result};
use crate::solution::{Epoch, Sink};
use crate::time::Time;
use nalgebra::{Matrix3, Vector3};

/// Between two looks at the solution, s.
const INTERVAL_S: f64 = 0.1;
/// A stop that a drive follows is judged this long before its end: the navigator takes it as ended as soon as its detector,
/// which looks ahead, sees the drive.
const BEFORE_END_S: f64 = 1.0;
/// From here on a stop tells of the gyro bias all that it will, s.
const SETTLED_S: f64 = 100.0;

/// Mean squares over a span of a run, of the errors or of what the filter states.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MeanSquares {
    /// North and east together, m².
    pub horizontal: f64,
    /// Height, m².
    pub height: f64,
    /// Velocity, all three components together, m²/s².
    pub velocity: f64,
    /// Rotations about north and about east, the mean of both, rad².
    pub roll_pitch: f64,
}

/// Sums on the way to [`MeanSquares`].
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    count: f64,
    errors: MeanSquares,
    stated: MeanSquares,
}

impl Sums {
    fn means(&self) -> (MeanSquares, MeanSquares) {
        let n = self.count.max(1.0);
        let mean = |m: &MeanSquares| MeanSquares {
            horizontal: m.horizontal / n,
            height: m.height / n,
            velocity: m.velocity / n,
            roll_pitch: m.roll_pitch / n,
        };
        (mean(&self.errors), mean(&self.stated))
    }
}

impl MeanSquares {
    /// Add squares: three components each of position, velocity and attitude.
    fn add(&mut self, position: Vector3<f64>, velocity: Vector3<f64>, attitude: Vector3<f64>) {
        self.horizontal += position.x + position.y;
        self.height += position.z;
        self.velocity += velocity.sum();
        self.roll_pitch += 0.5 * (attitude.x + attitude.y);
    }
}

/// The state at the end of a stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StopEndErrors {
    /// Truth less estimate, as a rotation about Down, rad.
    pub heading_error: f64,
    /// What the filter says of it, rad.
    pub heading_sigma: f64,
    /// How much the heading error has changed since the first epoch of the stop, rad.
    pub heading_growth: f64,
    /// Normalised squared error of the attitude; 3 on average.
    pub attitude_nees: f64,
    /// Of the position, likewise.
    pub position_nees: f64,
    /// Of the gyro bias, likewise.
    pub gyro_bias_nees: f64,
    /// Stated variances of the position, NED, m².
    pub position_variance: Vector3<f64>,
    /// Stated variance of the gyro bias about the body's z axis, rad²/s².
    pub gyro_bias_z_variance: f64,
}

/// Heading error and its stated sigma at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingPoint {
    /// Since the start, s.
    pub t: f64,
    /// Estimate less truth, rad: the sign in which such errors are drawn.
    pub error: f64,
    /// What the filter says of it, rad.
    pub sigma: f64,
}

/// Errors of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct StopErrors {
    /// Over the stops.
    pub standing: MeanSquares,
    /// What the filter says of them.
    pub standing_stated: MeanSquares,
    /// Over the drives; zero where there are none.
    pub driving: MeanSquares,
    /// Mean normalised squared error of the attitude over the drives; NaN where there are none.
    pub driving_attitude_nees: f64,
    /// Mean square of the gyro bias error about the body's z axis from 100 s of a stop on, rad²/s²; NaN if none is so long.
    pub gyro_bias_z: f64,
    /// At the end of each stop.
    pub ends: Vec<StopEndErrors>,
    /// Once a second over the first stop.
    pub heading: Vec<HeadingPoint>,
}

/// Looks at the solution ten times a second.
pub(super) struct StopSink<'a> {
    trial: &'a StopTrial,
    start: Time,
    due: f64,
    standing: Sums,
    driving: Sums,
    driving_nees: f64,
    bias: (f64, f64),
    /// The stop that comes next or is on, its heading error at the begin, and what was last seen in it.
    stop: usize,
    begin: Option<f64>,
    last: Option<StopEndErrors>,
    ends: Vec<StopEndErrors>,
    heading: Vec<HeadingPoint>,
}

impl<'a> StopSink<'a> {
    pub(super) fn new(trial: &'a StopTrial) -> Self {
        StopSink {
            trial,
            start: trial.simulation.trajectory.start(),
            due: 0.0,
            standing: Sums::default(),
            driving: Sums::default(),
            driving_nees: 0.0,
            bias: (0.0, 0.0),
            stop: 0,
            begin: None,
            last: None,
            ends: Vec::new(),
            heading: Vec::new(),
        }
    }

    fn end_stop(&mut self) {
        self.ends.extend(self.last.take());
        self.begin = None;
        self.stop += 1;
    }

    pub(super) fn finish(mut self) -> Result<StopErrors> {
        if self.last.is_some() {
            self.end_stop();
        }
        if self.ends.len() < self.trial.stops.len() {
            return Err(Error::NotObservable {
                what: "the errors over the stops",
                reason: "the solution ended before them",
            });
        }
        let (standing, standing_stated) = self.standing.means();
        Ok(StopErrors {
            standing,
            standing_stated,
            driving: self.driving.means().0,
            driving_attitude_nees: self.driving_nees / self.driving.count,
            gyro_bias_z: self.bias.1 / self.bias.0,
            ends: self.ends,
            heading: self.heading,
        })
    }
}

/// Normalised squared error; NaN where the covariance has no inverse.
fn nees(error: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    covariance
        .try_inverse()
        .map_or(f64::NAN, |inverse| error.dot(&(inverse * error)))
}

fn squares(v: &Vector3<f64>) -> Vector3<f64> {
    v.component_mul(v)
}

impl Sink for StopSink<'_> {
    fn wants_epoch(&mut self, time: Time) -> bool {
        let t = time.since(self.start);
        if t < self.due - 1e-6 {
            return false;
        }
        self.due = ((t + 1e-6) / INTERVAL_S).floor() * INTERVAL_S + INTERVAL_S;
        true
    }

    fn epoch(&mut self, epoch: &Epoch) {
        let t = epoch.nav.time.since(self.start);
        let truth = self.trial.simulation.truth_at(epoch.nav.time);
        let position = epoch.nav.position.offset_to(&truth.nav.position);
        let velocity = truth.nav.velocity_n - epoch.nav.velocity_n;
        let attitude = log(&(truth.nav.q_nb * epoch.nav.q_nb.inverse()));
        let bias = truth.imu_errors.gyro_bias - epoch.imu_errors.gyro_bias;
        let attitude_nees = nees(&attitude, &epoch.attitude_covariance_n());
        let stops = &self.trial.stops;
        if stops.get(self.stop).is_some_and(|s| t > s.end_s + 1e-6) {
            self.end_stop();
        }
        let stop = stops
            .get(self.stop)
            .filter(|s| t >= s.begin_s - 1e-6)
            .copied();
        let variances = |i: usize| epoch.covariance.diagonal().fixed_rows::<3>(i).into_owned();
        if stop.is_some() {
            self.begin.get_or_insert(attitude.z);
            if self.stop == 0 && t >= self.heading.len() as f64 - 1e-6 {
                self.heading.push(HeadingPoint {
                    t,
                    error: -attitude.z,
                    sigma: epoch.heading_sigma(),
                });
            }
        }
        // The first epoch is the start itself, in which no filter has had a say.
        if t < 0.5 * INTERVAL_S {
            return;
        }
        let sums = if stop.is_some() {
            &mut self.standing
        } else {
            &mut self.driving
        };
        sums.count += 1.0;
        sums.errors
            .add(squares(&position), squares(&velocity), squares(&attitude));
        sums.stated.add(variances(0), variances(3), variances(6));
        let (Some(stop), Some(begin)) = (stop, self.begin) else {
            self.driving_nees += attitude_nees;
            return;
        };
        if t >= stop.begin_s + SETTLED_S {
            self.bias.0 += 1.0;
            self.bias.1 += bias.z * bias.z;
        }
        let followed = self.stop + 1 < stops.len();
        if followed && t > stop.end_s - BEFORE_END_S + 1e-6 {
            return;
        }
        self.last = Some(StopEndErrors {
            heading_error: attitude.z,
            heading_sigma: epoch.heading_sigma(),
            heading_growth: attitude.z - begin,
            attitude_nees,
            position_nees: nees(&position, &epoch.position_covariance_n()),
            gyro_bias_nees: nees(
                &bias,
                &epoch.covariance.fixed_view::<3, 3>(9, 9).into_owned(),
            ),
            position_variance: variances(0),
            gyro_bias_z_variance: epoch.covariance[(11, 11)],
        });
    }
}
