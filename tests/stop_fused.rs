//! A stop's inertial data as one measurement of a running filter: what it says of attitude, biases and everything tied to them.

use insnav::alignment::{Record, fuse_stop};
use insnav::attitude::{Euler, exp, log};
use insnav::config::{StandingForce, StationaryConfig};
use insnav::earth::Geodetic;
use insnav::filter::{Eskf, InitialSigma, Settling};
use insnav::imu::{ImuErrors, ImuNoise};
use insnav::measurement::ZeroVelocityAid;
use insnav::mechanization::{Increment, NavState};
use insnav::sim::{BodyTurn, Rocking, RockingErrors, RockingTone, Source, Stream, to_increments};
use insnav::time::Time;
use nalgebra::{SMatrix, SVector, Vector3};
use std::f64::consts::PI;

const UG: f64 = 9.806_65e-6;
const ARCMIN: f64 = PI / 180.0 / 60.0;
/// The body stands all the time, but the filter is told so from here on only: until then its errors grow together, s.
const FREE_S: f64 = 60.0;
const STOP_S: f64 = 160.0;
const TURN_S: f64 = 20.0;
const LENGTH: f64 = FREE_S + 2.0 * STOP_S + TURN_S;
/// Horizontal position, attitude, gyro bias, accelerometer bias.
const KEPT: [usize; 11] = [0, 1, 6, 7, 8, 9, 10, 11, 12, 13, 14];

type State = SVector<f64, 11>;
type Square = SMatrix<f64, 11, 11>;

/// 0.001 °/√h, 5 µg/√Hz; drifts of 1e-7 rad/s and 50 µg that do not wander.
fn noise() -> ImuNoise {
    ImuNoise {
        gyro_white: 0.001f64.to_radians() / 60.0,
        accel_white: 5.0 * UG,
        gyro_bias_sigma: 1e-7,
        accel_bias_sigma: 50.0 * UG,
        gyro_bias_tau: 1e12,
        accel_bias_tau: 1e12,
    }
}

fn place() -> Geodetic {
    Geodetic::from_degrees(60.0, 30.0, 0.0)
}

/// Known beforehand: level to 0.06°, heading to 3°.
fn prior() -> InitialSigma {
    InitialSigma {
        position: Vector3::repeat(1.0),
        velocity: Vector3::new(0.05, 0.05, 0.0),
        attitude: Vector3::new(1e-3, 1e-3, 0.05),
        gyro_bias: Vector3::repeat(noise().gyro_bias_sigma),
        accel_bias: Vector3::repeat(noise().accel_bias_sigma),
    }
}

/// A body, its unit's data, and a filter whose errors are drawn from what it says of them.
struct Case {
    body: Rocking,
    errors: ImuErrors,
    increments: Vec<Increment>,
    filter: Eskf,
}

fn case(seed: u64, rocks: bool) -> Case {
    let mut source = Source::new(seed, Stream::Initial);
    let mut body = Rocking::standing(place(), Euler::from_degrees(1.0, -2.0, 130.0));
    body.turns = vec![BodyTurn {
        begin_s: FREE_S + STOP_S,
        duration_s: TURN_S,
        rotation_b: Vector3::new(0.0, 0.0, PI),
    }];
    if rocks {
        let mut tone = |axis, amplitude, period_s| RockingTone {
            axis,
            amplitude,
            period_s,
            phase: PI * (source.normal() % 1.0),
        };
        body.tones = vec![
            tone(0, 3e-3, 1.3),
            tone(1, 2e-3, 2.1),
            tone(0, 1e-3, 7.0),
            tone(2, 2e-4, 3.7),
        ];
        body.lever_b = Vector3::new(0.5, 0.5, -1.0);
    }
    let noise = noise();
    let errors = ImuErrors {
        gyro_bias: source.normal3() * noise.gyro_bias_sigma,
        accel_bias: source.normal3() * noise.accel_bias_sigma,
        ..ImuErrors::default()
    };
    let unit = RockingErrors {
        constant: errors,
        white: [noise.gyro_white, noise.accel_white],
        quantum: [0.0; 2],
    };
    let increments = to_increments(&unit.apply(&body.increments(LENGTH, 50.0), seed));
    let sigma = prior();
    let mut drawn = |sigma: &Vector3<f64>| source.normal3().component_mul(sigma);
    let nav = NavState {
        time: Time::from_seconds(0.0),
        position: place().offset(&drawn(&sigma.position)),
        velocity_n: drawn(&sigma.velocity),
        q_nb: exp(&drawn(&sigma.attitude)) * body.attitude_at(0.0),
    };
    let filter = Eskf::new(nav, ImuErrors::default(), &sigma, noise);
    Case {
        body,
        errors,
        increments,
        filter,
    }
}

impl Case {
    fn between(&self, begin: f64, end: f64) -> impl Iterator<Item = &Increment> {
        let inside = move |i: &&Increment| {
            let middle = i.time.seconds() - 0.5 * i.dt;
            begin <= middle && middle < end
        };
        self.increments.iter().filter(inside)
    }

    fn drive(&mut self, begin: f64, end: f64) {
        let all: Vec<Increment> = self.between(begin, end).copied().collect();
        for increment in &all {
            self.filter.propagate(increment);
        }
    }

    fn record(&self, begin: f64, end: f64) -> Record {
        Record::new(self.between(begin, end).copied())
    }

    /// Stand, and look at all of it; `times` more than once is what nobody may do.
    fn stand(&mut self, begin: f64, end: f64, times: usize) {
        let aid = ZeroVelocityAid::new(&StationaryConfig::default());
        let at = aid.interval_for(0.02);
        aid.observe(at, &mut self.filter).expect("taken");
        self.filter.forget_velocity(0.02);
        let record = self.record(begin, end);
        for _ in 0..times {
            let stop = fuse_stop(&record, &self.filter.before_stop(), &noise()).expect("standing");
            assert!(
                self.filter.pass_stop(&stop, &Settling::default()),
                "a covariance with an inverse"
            );
        }
        self.is_positive();
    }

    fn covariance(&self) -> Square {
        let p = self.filter.base_covariance();
        Square::from_fn(|i, j| p[(KEPT[i], KEPT[j])])
    }

    fn is_positive(&self) {
        let p = self.covariance();
        let scale = p.map_diagonal(|v| v.sqrt().recip());
        let scaled = Square::from_fn(|i, j| p[(i, j)] * scale[i] * scale[j]);
        let least = scaled.symmetric_eigenvalues().min();
        assert!(least > -1e-9, "{least}");
    }

    /// What is true less what is estimated.
    fn error(&self) -> State {
        let nominal = self.filter.nominal();
        let t = nominal.nav.time.seconds();
        let position = nominal.nav.position.offset_to(&place());
        let attitude = log(&(self.body.attitude_at(t) * nominal.nav.q_nb.inverse()));
        let gyro = self.errors.gyro_bias - nominal.imu_errors.gyro_bias;
        let accel = self.errors.accel_bias - nominal.imu_errors.accel_bias;
        let all = position
            .xy()
            .iter()
            .chain(attitude.iter())
            .chain(gyro.iter())
            .chain(accel.iter())
            .copied()
            .collect::<Vec<f64>>();
        State::from_vec(all)
    }

    fn nees(&self) -> f64 {
        let (p, e) = (self.covariance(), self.error());
        e.dot(&p.cholesky().expect("positive").solve(&e)) / 11.0
    }

    /// Of the gyro biases alone, which the stop's own data decide.
    fn gyro_nees(&self) -> f64 {
        let p = self.covariance().fixed_view::<3, 3>(5, 5).into_owned();
        let e = self.error().fixed_rows::<3>(5).into_owned();
        e.dot(&p.cholesky().expect("positive").solve(&e)) / 3.0
    }

    /// Of the drift along north, which every stop shows.
    fn north_drift_nees(&self) -> f64 {
        let p = self.covariance().fixed_view::<3, 3>(5, 5).into_owned();
        let e = self.error().fixed_rows::<3>(5).into_owned();
        let north_b = self.filter.nominal().nav.q_nb.inverse() * Vector3::x();
        north_b.dot(&e).powi(2) / north_b.dot(&(p * north_b))
    }

    fn heading_sigma(&self) -> f64 {
        self.covariance()[(4, 4)].sqrt()
    }
}

/// Mean NEES over its degrees of freedom after the second stop: of everything, and of the gyro biases.
fn consistency(rocks: bool, times: usize, runs: u64) -> [f64; 2] {
    let mut sum = [0.0; 2];
    for seed in 0..runs {
        let mut case = case(seed, rocks);
        case.drive(0.0, FREE_S);
        case.stand(FREE_S, FREE_S + STOP_S, times);
        case.drive(FREE_S + STOP_S, FREE_S + STOP_S + TURN_S);
        case.stand(FREE_S + STOP_S + TURN_S, LENGTH, times);
        sum[0] += case.nees() / runs as f64;
        sum[1] += case.gyro_nees() / runs as f64;
    }
    sum
}

/// Of a filter that has been wrong as it says: position, attitude and biases after two stops and a turn between. Rocking is
/// nothing that a sigma knows; it is taken out by the taper, and what may be left of it is in the covariance.
#[test]
fn fused_stops_are_as_uncertain_as_they_say_and_used_twice_they_are_not() {
    let runs = 60;
    let (quiet, rocking) = (consistency(false, 1, runs), consistency(true, 1, runs));
    let twice = consistency(false, 2, runs);
    println!(
        "NEES/dof of everything and of the gyros: quiet {quiet:.2?}, rocking {rocking:.2?}; the same data twice {twice:.2?}"
    );
    // 660 and 180 degrees of freedom: standard errors of 0.055 and 0.105.
    for [all, gyros] in [quiet, rocking] {
        assert!((all - 1.0).abs() < 0.17 && (gyros - 1.0).abs() < 0.32);
    }
    assert!(twice[1] > 1.4, "{twice:?}");
}

/// Live updates of a stop, and then all of it on top: the same data twice.
#[test]
fn live_updates_and_the_whole_stop_together_promise_too_much() {
    let runs = 80;
    let (mut once, mut both) = (0.0, 0.0);
    // Zero velocities as fine as the unit bears, so that they teach the biases.
    let aid = ZeroVelocityAid::new(&StationaryConfig {
        zero_velocity_m_per_s_per_sqrt_hz: Some(3e-5),
        ..StationaryConfig::default()
    });
    for seed in 0..runs {
        let mut case = case(seed, false);
        case.drive(0.0, FREE_S);
        let record = case.record(FREE_S, FREE_S + STOP_S);
        let increments: Vec<Increment> = case.between(FREE_S, FREE_S + STOP_S).copied().collect();
        aid.observe(increments[0].dt, &mut case.filter)
            .expect("taken");
        for increment in &increments {
            case.filter
                .propagate_standing(increment, StandingForce::Gravity);
            aid.observe(increment.dt, &mut case.filter).expect("taken");
        }
        once += case.north_drift_nees() / runs as f64;
        let stop = fuse_stop(&record, &case.filter.before_stop(), &noise()).expect("standing");
        case.filter.pass_stop(&stop, &Settling::default());
        both += case.north_drift_nees() / runs as f64;
    }
    println!("NEES of the north drift: live {once:.2}, live and whole {both:.2}");
    // 80 degrees of freedom: a standard error of 0.16.
    assert!((once - 1.0).abs() < 0.47, "{once}");
    // Of the same errors: half the variance is claimed where the two tell the same, a little less where the live filter tells less.
    assert!(both > 1.4 * once, "{once} {both}");
}

/// ZUPT-1 by parts: one stop leaves azimuth and east drift undecided, the second, half a turn later, decides.
#[test]
fn the_second_position_tells_azimuth_from_drift() {
    let mut case = case(3, false);
    case.drive(0.0, FREE_S);
    let position = case.covariance()[(0, 0)].sqrt();
    case.stand(FREE_S, FREE_S + STOP_S, 1);
    let first = case.heading_sigma() / ARCMIN;
    assert!(
        case.covariance()[(0, 0)].sqrt() < position,
        "position follows"
    );
    case.drive(FREE_S + STOP_S, FREE_S + STOP_S + TURN_S);
    case.stand(FREE_S + STOP_S + TURN_S, LENGTH, 1);
    let second = case.heading_sigma() / ARCMIN;
    println!("azimuth sigma {first:.2}′, then {second:.2}′");
    // 1e-7 rad/s over Ω cos 60° is 9.4′; the Kalman filter over both stops together has 1.75′ by the design's study.
    assert!((first - 9.6).abs() < 0.5, "{first}");
    assert!((second - 1.75).abs() < 0.12, "{second}");
}
