//! What all benches work on: a driving car, its filter a minute into the drive, and the naive product beside it.

use insnav::earth::Geodetic;
use insnav::filter::{
    ACCEL_SCALE, BASE, Columns, Covariance, Eskf, GYRO_SCALE, InitialSigma, Layout, Process,
    Processes, Transition, VELOCITY, fill_base, fill_optional,
};
use insnav::imu::{ImuErrors, ImuGrade, ImuNoise};
use insnav::measurement::GnssPositionModel;
use insnav::mechanization::{Increment, Interval, NavState};
use insnav::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Length of a step, s.
pub(crate) const DT: f64 = 0.01;

/// Noise of the unit.
pub(crate) fn noise() -> ImuNoise {
    ImuGrade::Automotive.noise()
}

/// A car at 15 m/s in a gentle bend.
pub(crate) fn nav() -> NavState {
    NavState {
        time: Time(0),
        position: Geodetic::from_degrees(50.1, 14.4, 250.0),
        velocity_n: Vector3::new(11.0, 10.0, -0.3),
        q_nb: UnitQuaternion::from_euler_angles(0.02, -0.03, 0.74),
    }
}

/// What its sensors say over one step.
pub(crate) fn increment(time: Time) -> Increment {
    Increment {
        time: time.plus(DT),
        dt: DT,
        rotation_b: Vector3::new(0.01, -0.02, 0.15) * DT,
        velocity_b: Vector3::new(0.4, 2.1, -9.75) * DT,
    }
}

/// A filter whose states are all correlated: the base states, or with scale factors, 21.
pub(crate) fn filter_of(states: usize) -> Eskf {
    let sigma = InitialSigma {
        position: Vector3::repeat(1.0),
        velocity: Vector3::repeat(0.1),
        attitude: Vector3::new(0.005, 0.005, 0.02),
        gyro_bias: Vector3::repeat(noise().gyro_bias_sigma),
        accel_bias: Vector3::repeat(noise().accel_bias_sigma),
    };
    let mut filter = Eskf::new(nav(), ImuErrors::default(), &sigma, noise());
    if states == 21 {
        let scale = Process::constant(1e-3);
        filter.open(GYRO_SCALE, scale).expect("there is room");
        filter.open(ACCEL_SCALE, scale).expect("there is room");
    }
    assert_eq!(filter.covariance().layout().len(), states);
    for _ in 0..1000 {
        filter.propagate(&increment(filter.nominal().nav.time));
    }
    filter
}

/// The filter with the base states alone.
pub(crate) fn filter() -> Eskf {
    filter_of(BASE)
}

/// One interval as the dynamics see it.
pub(crate) fn interval() -> Interval {
    nav().advance(&increment(Time(0)))
}

/// The covariance of the filter with 15 states, or with scale factors open: 21.
pub(crate) fn covariance(states: usize) -> Covariance {
    filter_of(states).covariance().clone()
}

/// Φ and Q of one step over all open states.
pub(crate) fn transition(layout: &Layout) -> Transition {
    let mut phi = Transition::default();
    let interval = interval();
    fill_base(&mut phi, layout, &interval, &noise());
    let (increment, errors) = (increment(Time(0)), ImuErrors::default());
    let processes = Processes::default();
    fill_optional(&mut phi, layout, &interval, &increment, &errors, &processes);
    phi
}

/// A fix at the estimate, antenna on a lever arm, errors correlated.
pub(crate) fn fix(filter: &Eskf) -> GnssPositionModel {
    let at = filter.nominal().nav;
    let lever_arm_b = Vector3::new(0.8, -0.4, -1.2);
    GnssPositionModel {
        position: at.position.offset(&(at.q_nb * lever_arm_b)),
        lever_arm_b,
        r: Matrix3::new(1.0, 0.2, 0.1, 0.2, 1.2, -0.3, 0.1, -0.3, 4.0),
        dependence: 1.0,
        position_alone: false,
    }
}

/// Rows of a zero-velocity update.
pub(crate) fn velocity_rows(layout: &Layout) -> Columns<3> {
    let mut h = Columns::default();
    h.put(layout, VELOCITY, &Matrix3::identity());
    h
}
