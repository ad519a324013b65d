//! How errors change while the body stands, against numerical derivatives of what the filter does to its estimate: columns of F
//! of a held heading or attitude, `stay` and `turn`.

use insnav::attitude::exp;
use insnav::config::{Bookkeeping, StandingForce};
use insnav::earth::{Geodetic, LocalEarth};
use insnav::filter::{
    ACCEL_BIAS, ATTITUDE, BASE, CAPACITY, Eskf, GNSS_COLOUR, GYRO_BIAS, GYRO_SCALE, HELD_ATTITUDE,
    HELD_HEADING, InitialSigma, Nominal, POSITION, Process, Settling, States, VELOCITY,
};
use insnav::imu::{ImuErrors, ImuGrade, ImuNoise};
use insnav::mechanization::{Increment, NavState};
use insnav::sim::{Source, Stream};
use insnav::time::Time;
use nalgebra::{Matrix1, Matrix3, SMatrix, Vector3};

const SEEDS: u64 = 50;

fn noise() -> ImuNoise {
    // Correlation times of the order of a step, so that what decays shows.
    ImuNoise {
        gyro_bias_tau: 20.0,
        accel_bias_tau: 30.0,
        ..ImuGrade::Automotive.noise()
    }
}

fn nav(source: &mut Source) -> NavState {
    NavState {
        time: Time(1_700_000_000_000_000_000),
        position: Geodetic::from_degrees(source.between(-80.0, 80.0), 20.0, 100.0),
        velocity_n: source.normal3() * 0.1,
        q_nb: exp(&(source.normal3() * 2.0)),
    }
}

fn errors(source: &mut Source) -> ImuErrors {
    ImuErrors {
        gyro_bias: source.normal3() * 0.01,
        accel_bias: source.normal3() * 0.3,
        ..ImuErrors::default()
    }
}

/// What is open in a filter beside the base.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Open {
    Heading,
    Attitude,
    Colour,
    GyroScale,
}

/// A filter that knows everything.
fn certain(nav: NavState, errors: ImuErrors, open: Open) -> Eskf {
    let zero = Vector3::zeros();
    let sigma = InitialSigma {
        position: zero,
        velocity: zero,
        attitude: zero,
        gyro_bias: zero,
        accel_bias: zero,
    };
    let mut filter = Eskf::new(nav, errors, &sigma, noise());
    match open {
        Open::Heading => filter.hold_heading(Bookkeeping::Exact),
        Open::Attitude => filter.hold_attitude(),
        Open::Colour => filter.open(
            GNSS_COLOUR,
            Process {
                sigma: zero,
                tau: 15.0,
            },
        ),
        Open::GyroScale => filter.open(GYRO_SCALE, Process::constant(0.0)),
    }
    .expect("there is room");
    filter
}

/// Let one state, and no other, be uncertain by one unit.
fn doubt(filter: &mut Eskf, state: usize) {
    let layout = *filter.covariance().layout();
    let one = |axis: usize| Matrix3::from_fn(|i, j| f64::from(u8::from(i == axis && j == axis)));
    for block in [
        POSITION,
        VELOCITY,
        ATTITUDE,
        GYRO_BIAS,
        ACCEL_BIAS,
        GNSS_COLOUR,
        HELD_ATTITUDE,
        GYRO_SCALE,
    ] {
        if let Some(range) = layout.range(block).filter(|r| r.contains(&state)) {
            filter
                .covariance_mut()
                .set_prior(block, &one(state - range.start));
        }
    }
    if layout.range(HELD_HEADING).is_some_and(|r| r.start == state) {
        filter
            .covariance_mut()
            .set_prior(HELD_HEADING, &Matrix1::new(1.0));
    }
}

/// The state's column of Φ as the filter itself has it: what its uncertainty becomes, less what a certain one gains.
fn column(from: &Eskf, state: usize, step: &impl Fn(&mut Eskf)) -> States {
    let (mut doubtful, mut sure) = (from.clone(), from.clone());
    doubt(&mut doubtful, state);
    step(&mut doubtful);
    step(&mut sure);
    let p: SMatrix<f64, CAPACITY, CAPACITY> =
        doubtful.covariance().dense::<CAPACITY>() - sure.covariance().dense::<CAPACITY>();
    // φ φᵀ with a positive element at the state itself.
    core::array::from_fn(|i| p[(i, state)] / p[(state, state)].sqrt())
}

/// The same from what the step does to estimates that differ in the state by a little.
fn derivative(from: &Eskf, open: Open, state: usize, step: &impl Fn(&mut Eskf)) -> States {
    let layout = *from.covariance().layout();
    let h = if state < 3 { 1.0 } else { 1e-3 };
    let ended = |by: f64| -> Nominal {
        let mut dx = [0.0; CAPACITY];
        dx[state] = by;
        let at = from.nominal().retract(&layout, &dx);
        let mut filter = certain(at.nav, at.imu_errors, open);
        filter.set_calibration(at.calibration);
        step(&mut filter);
        // Nothing but a correction moves what is held.
        Nominal {
            held_q_nb: at.held_q_nb,
            ..*filter.nominal()
        }
    };
    let end = ended(0.0);
    let (plus, minus) = (
        end.local(&layout, &ended(h)),
        end.local(&layout, &ended(-h)),
    );
    core::array::from_fn(|i| (plus[i] - minus[i]) / (2.0 * h))
}

/// Largest difference of Φ over all columns but those of `without`.
fn misfit(
    from: &Eskf,
    open: Open,
    without: core::ops::Range<usize>,
    step: impl Fn(&mut Eskf),
) -> f64 {
    let count = from.covariance().layout().len();
    let mut worst = 0.0_f64;
    for state in (0..count).filter(|s| !without.contains(s)) {
        let (by_filter, by_motion) = (
            column(from, state, &step),
            derivative(from, open, state, &step),
        );
        for i in 0..count {
            worst = worst.max((by_filter[i] - by_motion[i]).abs());
        }
    }
    worst
}

/// A step of a body at rest as its unit measures it.
fn at_rest(filter: &Eskf, dt: f64) -> Increment {
    let Nominal {
        nav, imu_errors, ..
    } = filter.nominal();
    let earth = LocalEarth::at(&nav.position);
    let to_b = nav.q_nb.inverse();
    let rate = to_b * earth.earth_rate_n() + imu_errors.gyro_bias;
    let force = to_b * Vector3::new(0.0, 0.0, -earth.gravity()) + imu_errors.accel_bias;
    Increment {
        time: nav.time.plus(dt),
        dt,
        rotation_b: rate * dt,
        velocity_b: force * dt,
    }
}

/// All columns, those of the held states among them, with −g and with the measured force in the dynamics.
#[test]
fn a_held_error_acts_as_the_one_that_it_was_taken_from() {
    const DT: f64 = 0.01;
    for open in [Open::Heading, Open::Attitude] {
        let mut worst = 0.0_f64;
        for seed in 0..SEEDS {
            let mut source = Source::new(seed, Stream::Initial);
            let (nav, errors) = (nav(&mut source), errors(&mut source));
            let filter = certain(nav, errors, open);
            let raw = at_rest(&filter, DT);
            for force in [StandingForce::Gravity, StandingForce::Measured] {
                worst = worst.max(misfit(&filter, open, 0..0, |f| {
                    f.propagate_standing(&raw, force)
                }));
            }
        }
        println!("{open:?}: {worst:.1e}");
        // Second order of the step, in the position by the tilt: ½ g dt², which the strapdown makes at once and the shears with
        // the next step. Everything else is smaller.
        assert!(worst < 1.01 * 0.5 * 9.84 * DT * DT, "{open:?}: {worst:e}");
    }
    // The control: with the held error's columns left out 0.1 would be missing, 10 m/s² over 0.01 s.
    let mut source = Source::new(0, Stream::Initial);
    let filter = certain(nav(&mut source), errors(&mut source), Open::Heading);
    let raw = at_rest(&filter, DT);
    let held = filter.covariance().layout().range(HELD_HEADING).unwrap();
    let level = |x: States| x[3].hypot(x[4]);
    let step = |f: &mut Eskf| f.propagate_standing(&raw, StandingForce::Gravity);
    let vertical = derivative(&filter, Open::Heading, held.start, &step);
    let tilting = derivative(&filter, Open::Heading, 6, &step);
    // A rotation about Down does not turn a vertical force; one about north does.
    assert!(level(vertical) < 1e-3 && level(tilting) > 0.09);
    let attitude = certain(filter.nominal().nav, ImuErrors::default(), Open::Attitude);
    let held = attitude.covariance().layout().range(HELD_ATTITUDE).unwrap();
    let raw = at_rest(&attitude, DT);
    let step = |f: &mut Eskf| f.propagate_standing(&raw, StandingForce::Gravity);
    assert!(level(column(&attitude, held.start, &step)) > 0.09);
}

/// While it stays, position and attitude are constants, biases and colour decay, and what settles is a random walk.
#[test]
fn staying_keeps_what_is_constant_and_lets_decay_what_decays() {
    let settling = Settling {
        attitude: 1e-4,
        position: 1e-3,
    };
    for seed in 0..SEEDS {
        let mut source = Source::new(seed, Stream::Initial);
        let (nav, errors) = (nav(&mut source), errors(&mut source));
        for open in [Open::Colour, Open::Heading] {
            let filter = certain(nav, errors, open);
            let dt = source.between(0.1, 1.0);
            let stay = |f: &mut Eskf| f.stay(nav.time.plus(dt), dt, &settling);
            // The velocity is zero by definition: what its covariance says is what a body that starts may have.
            let off = misfit(&filter, open, 3..6, stay);
            // Rounding of 1e-9 m in a position of radians, over steps of 1e-3.
            assert!(off < 1e-6, "seed {seed} {open:?}: {off:e}");
            let mut after = filter.clone();
            stay(&mut after);
            let end = after.nominal();
            assert_eq!((end.nav.position, end.nav.q_nb), (nav.position, nav.q_nb));
            assert_eq!(end.nav.velocity_n, Vector3::zeros());
            // What a certain filter gains: nothing anywhere but on the diagonal.
            let p: SMatrix<f64, BASE, BASE> = after.covariance().dense();
            let gauss_markov = |sigma: f64, tau: f64| sigma * sigma * -(-2.0 * dt / tau).exp_m1();
            let unit = noise();
            for i in 0..BASE {
                let expected = match i {
                    0..3 => settling.position.powi(2) * dt,
                    3..6 => 0.0,
                    6..9 => settling.attitude.powi(2) * dt,
                    9..12 => gauss_markov(unit.gyro_bias_sigma, unit.gyro_bias_tau),
                    _ => gauss_markov(unit.accel_bias_sigma, unit.accel_bias_tau),
                };
                assert!(
                    (p[(i, i)] - expected).abs() <= 1e-12 * expected,
                    "{i}: {} {expected}",
                    p[(i, i)]
                );
                assert!((0..BASE).all(|j| i == j || p[(i, j)] == 0.0), "{i}");
            }
        }
    }
}

/// A turn that the gyros saw: their biases and scale factors turn the attitude, nothing else changes.
#[test]
fn a_turn_is_wrong_by_the_gyros_errors() {
    const DT: f64 = 1.0;
    let mut largest = 0.0_f64;
    for seed in 0..SEEDS {
        let mut source = Source::new(seed, Stream::Initial);
        let (nav, errors) = (nav(&mut source), errors(&mut source));
        for open in [Open::Colour, Open::GyroScale] {
            let filter = certain(nav, errors, open);
            // Two degrees.
            let mut raw = at_rest(&filter, DT);
            raw.rotation_b += source.normal3().normalize() * 0.035;
            let turn = |f: &mut Eskf| {
                let seen = raw.corrected(&f.nominal().imu_errors).rotation_b;
                f.turn(&seen, DT);
            };
            let off = misfit(&filter, open, 0..0, turn);
            largest = largest.max(off);
            // Half of the rotation, between the axes at its begin and those on the way, over the second.
            assert!(off < 0.55 * 0.035 * DT, "seed {seed} {open:?}: {off:e}");
            let mut after = filter.clone();
            turn(&mut after);
            let p = after.attitude_covariance_n();
            let expected = noise().gyro_white.powi(2) * DT;
            assert!((p - Matrix3::identity() * expected).amax() < 1e-12 * expected);
            assert_eq!(after.nominal().nav.position, nav.position);
        }
    }
    println!("largest {largest:.1e}, where a bias has 1 and a scale factor 0.035");
}
