//! What a filter is told while the body stands: every H against numerical derivatives, and the held heading as an exact map.

use insnav::attitude::{Euler, exp, log_level};
use insnav::config::{
    Bookkeeping, GnssConfig, HeadingRateGain, HeadingRow, SigmaScale, StandingForce,
    StationaryConfig,
};
use insnav::earth::{Geodetic, LocalEarth, earth_rate_n};
use insnav::filter::{
    ACCEL_SCALE, ATTITUDE, BASE, CAPACITY, Calibration, Eskf, GNSS_COLOUR, GYRO_BIAS, GYRO_SCALE,
    Gate, HELD_HEADING, InitialSigma, LEVER_ARM, Layout, Measurement, Nominal, Process,
};
use insnav::imu::{ImuErrors, ImuGrade};
use insnav::measurement::{
    GnssPositionAid, HeldAttitudeModel, HeldHeadingModel, StandingForceModel, StandingRateModel,
    ZeroHeadingRateModel, ZeroVelocityModel,
};
use insnav::mechanization::{Increment, NavState};
use insnav::sample::GnssPosition;
use insnav::sim::{Source, Stream};
use insnav::time::Time;
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};
use std::ops::Range;

const STATES: u64 = 200;

fn sigma() -> InitialSigma {
    let each = Vector3::from_element;
    InitialSigma {
        position: each(2.0),
        velocity: each(0.1),
        attitude: Vector3::new(0.002, 0.003, 0.02),
        gyro_bias: each(7e-4),
        accel_bias: each(0.08),
    }
}

fn random_nominal(source: &mut Source) -> Nominal {
    let q_nb = exp(&(source.normal3() * 2.0));
    Nominal {
        nav: NavState {
            time: Time(1_700_000_000_000_000_000),
            position: Geodetic::from_degrees(
                source.between(-80.0, 80.0),
                source.between(-180.0, 180.0),
                source.between(-100.0, 10_000.0),
            ),
            velocity_n: source.normal3(),
            q_nb,
        },
        rate_b: source.normal3() * 0.1,
        acceleration_n: source.normal3(),
        imu_errors: ImuErrors {
            gyro_bias: source.normal3() * 0.01,
            accel_bias: source.normal3() * 0.3,
            gyro_scale: source.normal3() * 0.02,
            accel_scale: source.normal3() * 0.02,
        },
        calibration: Calibration::default(),
        held_q_nb: exp(&(source.normal3() * 1e-3)) * q_nb,
    }
}

fn filter_at(at: &Nominal) -> Eskf {
    Eskf::new(
        at.nav,
        at.imu_errors,
        &sigma(),
        ImuGrade::Automotive.noise(),
    )
}

/// Largest difference between H and what the residual does when the truth is moved.
fn misfit<const M: usize>(model: &impl Measurement<M>, at: &Nominal, layout: &Layout) -> f64 {
    misfit_by(model, at, layout, 0..layout.len())
}

/// The same over some of the states.
fn misfit_by<const M: usize>(
    model: &impl Measurement<M>,
    at: &Nominal,
    layout: &Layout,
    states: Range<usize>,
) -> f64 {
    let h = model.linearize(at, layout).h;
    let mut worst = 0.0_f64;
    for j in states {
        let step = if j < 3 { 1.0 } else { 1e-5 };
        let residual = |by: f64| {
            let mut dx = [0.0; CAPACITY];
            dx[j] = by;
            model.linearize(&at.retract(layout, &dx), layout).residual
        };
        let numerical = (residual(-step) - residual(step)) / (2.0 * step);
        let mut unit = [0.0; CAPACITY];
        unit[j] = 1.0;
        let analytic = h.times(&unit);
        for i in 0..M {
            worst = worst.max((numerical[i] - analytic[i]).abs() / (1.0 + analytic[i].abs()));
        }
    }
    worst
}

/// Rounding of a residual of 10 m/s² over a step of 1e-5; gravity changes by 3e-6 m/s² a metre.
const TOLERANCE: f64 = 4e-6;

#[test]
fn every_model_has_the_derivatives_of_its_residual() {
    let mut bare = filter_at(&random_nominal(&mut Source::new(0, Stream::Initial)));
    bare.open(GYRO_SCALE, Process::constant(0.01)).unwrap();
    bare.open(ACCEL_SCALE, Process::constant(0.01)).unwrap();
    let layout = *bare.covariance().layout();
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let at = random_nominal(&mut source);
        let zero = misfit(&ZeroVelocityModel { sigma: 0.02 }, &at, &layout);
        let rate = ZeroHeadingRateModel {
            sigma: 0.01,
            dt: 0.01,
            gain: HeadingRateGain::Correlated,
        };
        // Its H is that of a body at rest: the noise of a rate is no rate.
        let earth = earth_rate_n(at.nav.position.latitude);
        let resting = Nominal {
            rate_b: at.nav.q_nb.inverse_transform_vector(&earth),
            ..at
        };
        let means = StandingForceModel {
            specific_force_b: source.normal3() * 10.0,
            variance: 1e-4,
        };
        let rates = StandingRateModel {
            angular_rate_b: source.normal3() * 0.01,
            variance: Vector3::from_element(1e-8),
            earth_rate_tells: true,
            by_heading: Vector3::zeros(),
        };
        let all = [
            zero,
            misfit(&rate, &resting, &layout),
            misfit(&means, &at, &layout),
            misfit(&rates, &at, &layout),
        ];
        assert!(all.iter().all(|x| *x < TOLERANCE), "seed {seed}: {all:?}");
    }
}

/// The held models, with the constant part open: a move of Ψ moves both sides and leaves the residual, a move of φ does not.
#[test]
fn held_heading_and_attitude_have_the_derivatives_of_their_residuals() {
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let at = random_nominal(&mut source);
        let mut filter = filter_at(&at);
        filter.hold_heading(Bookkeeping::Exact).unwrap();
        let layout = *filter.covariance().layout();
        let down = HeldHeadingModel {
            row: HeadingRow::Down,
            sigma: 1e-3,
        };
        // Log C_held Ĉᵀ of a milliradian has derivatives off the identity by half of it; φ itself is as small in use.
        let close = Nominal {
            held_q_nb: at.nav.q_nb,
            ..at
        };
        assert!(misfit(&down, &close, &layout) < TOLERANCE, "seed {seed}");
        filter.release_heading(Bookkeeping::Exact);
        filter.hold_attitude().unwrap();
        let layout = *filter.covariance().layout();
        let whole = HeldAttitudeModel { sigma: 1e-3 };
        assert!(misfit(&whole, &close, &layout) < TOLERANCE, "seed {seed}");
    }
}

/// The row of the paper knows φ, but a rotation about Down of what is held changes both headings by the same.
#[test]
fn the_euler_row_has_the_derivatives_of_headings_away_from_the_zenith() {
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let mut at = random_nominal(&mut source);
        let pitch = source.between(-80.0, 80.0);
        at.nav.q_nb =
            Euler::from_degrees(source.between(-180.0, 180.0), pitch, 77.0).to_quaternion();
        at.held_q_nb = at.nav.q_nb;
        let mut filter = filter_at(&at);
        filter.hold_heading(Bookkeeping::Exact).unwrap();
        let layout = *filter.covariance().layout();
        let row = HeldHeadingModel {
            row: HeadingRow::Euler,
            sigma: 1e-3,
        };
        // The second derivative of a heading grows with the square of tan(pitch): 32 at 80°, over a step of 1e-5.
        assert!(
            misfit(&row, &at, &layout) < 1e-5,
            "seed {seed}, pitch {pitch}"
        );
    }
}

/// Without a heading, north is in the mean rate by the part with which the biases were found: all of it after a start that found
/// them at rest, nothing of it in biases that are independent. Both have the derivative of that by the heading.
#[test]
fn a_mean_rate_has_north_in_it_as_its_biases_have() {
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let mut at = random_nominal(&mut source);
        at.imu_errors.gyro_scale = Vector3::zeros();
        let layout = *filter_at(&at).covariance().layout();
        let north_b = at
            .nav
            .q_nb
            .inverse_transform_vector(&earth_rate_n(at.nav.position.latitude).cross(&Vector3::z()));
        let rates = |by_heading| StandingRateModel {
            angular_rate_b: source.normal3() * 0.01,
            variance: Vector3::from_element(1e-8),
            earth_rate_tells: false,
            by_heading,
        };
        let [tied, independent, reversed] = [north_b, Vector3::zeros(), -north_b]
            .map(rates)
            .map(|r| misfit_by(&r, &at, &layout, 8..9));
        // Of 7e-5 rad/s, by differences over 2e-5 rad of what is a hundredth.
        assert!(
            tied < 1e-10 && independent < 1e-10,
            "seed {seed}: {tied}, {independent}"
        );
        // The control: a tie of the wrong sign.
        assert!(reversed > 0.5 * north_b.amax(), "seed {seed}: {reversed}");
    }
}

/// Biases that were found with a vague heading are measured without a word of it, whatever part of the tie is left.
#[test]
fn a_mean_rate_leaves_a_vague_heading_alone() {
    const HEADING: f64 = 1.8;
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let at = random_nominal(&mut source);
        let tie = source.normal3() * 5e-5;
        let mut joint = SMatrix::<f64, 9, 9>::from_diagonal_element(1e-6);
        joint[(2, 2)] = HEADING * HEADING;
        for i in 0..3 {
            joint[(3 + i, 2)] = -tie[i] * HEADING * HEADING;
            joint[(2, 3 + i)] = joint[(3 + i, 2)];
        }
        let biases =
            Matrix3::from_diagonal_element(1e-8) + tie * tie.transpose() * HEADING * HEADING;
        joint.fixed_view_mut::<3, 3>(3, 3).copy_from(&biases);
        let after = |by_heading| {
            let mut filter = filter_at(&at);
            filter.set_joint_prior(&joint);
            let model = StandingRateModel {
                angular_rate_b: at.imu_errors.gyro_bias + Vector3::new(3e-4, -2e-4, 1e-4),
                variance: Vector3::from_element(1e-9),
                earth_rate_tells: false,
                by_heading,
            };
            filter
                .update(&model, at.nav.time, &mut Gate::lenient())
                .unwrap();
            let turned = log_level(&(filter.nominal().nav.q_nb * at.nav.q_nb.inverse())).z;
            (turned, filter.attitude_covariance_n()[(2, 2)].sqrt())
        };
        let (turned, sigma) = after(tie);
        assert!(turned.abs() < 1e-9, "seed {seed}: {turned}");
        assert!((sigma - HEADING).abs() < 1e-9, "seed {seed}: {sigma}");
        // The control: a measurement that does not know of the tie.
        let (turned, sigma) = after(Vector3::zeros());
        assert!(
            turned.abs() > 1e-4 && sigma < HEADING - 1e-3,
            "seed {seed}: {turned}, {sigma}"
        );
    }
}

fn relative_difference(a: &SMatrix<f64, BASE, BASE>, b: &SMatrix<f64, BASE, BASE>) -> f64 {
    let mut worst = 0.0_f64;
    for i in 0..BASE {
        for j in 0..BASE {
            let scale = (a[(i, i)] * a[(j, j)]).sqrt();
            worst = worst.max((a[(i, j)] - b[(i, j)]).abs() / scale);
        }
    }
    worst
}

/// What a body at rest measures over `dt`, with some noise.
fn at_rest(nav: &NavState, errors: &ImuErrors, dt: f64, source: &mut Source) -> Increment {
    let earth = LocalEarth::at(&nav.position);
    let to_b = nav.q_nb.inverse();
    let rotation_b = to_b * earth.earth_rate_n() + errors.gyro_bias + source.normal3() * 1e-3;
    let force_b = to_b * Vector3::new(0.0, 0.0, -earth.gravity()) + errors.accel_bias;
    Increment {
        time: nav.time.plus(dt),
        dt,
        rotation_b: rotation_b * dt,
        velocity_b: (force_b + source.normal3() * 0.05) * dt,
    }
}

/// A filter that has driven: cross-covariances everywhere.
fn driven(seed: u64) -> (Eskf, Source) {
    let mut source = Source::new(seed, Stream::Initial);
    let mut at = random_nominal(&mut source);
    at.imu_errors = ImuErrors::default();
    at.nav.position = Geodetic::from_degrees(source.between(-70.0, 70.0), 20.0, 100.0);
    let mut filter = filter_at(&at);
    for _ in 0..200 {
        let (nav, errors) = (filter.nominal().nav, filter.nominal().imu_errors);
        let mut raw = at_rest(&nav, &errors, 0.01, &mut source);
        raw.velocity_b += source.normal3() * 0.02;
        raw.rotation_b += source.normal3() * 0.002;
        filter.propagate(&raw);
    }
    filter.open(LEVER_ARM, Process::constant(0.1)).unwrap();
    filter
        .open(
            GNSS_COLOUR,
            Process {
                sigma: Vector3::repeat(1.0),
                tau: 30.0,
            },
        )
        .unwrap();
    fix(&mut filter, &mut source);
    (filter, source)
}

fn fix(filter: &mut Eskf, source: &mut Source) {
    let config = GnssConfig {
        lever_arm_b_m: Some([1.0, -0.5, -1.2]),
        sigma_scale: SigmaScale::Fixed(1.0),
        ..GnssConfig::default()
    };
    let nav = filter.nominal().nav;
    let fix = GnssPosition {
        time: nav.time,
        position: nav.position.offset(&(source.normal3() * 0.5)),
        covariance_n: Some(Matrix3::identity()),
    };
    let model = GnssPositionAid::new(&config).model(&fix, false);
    filter
        .update(&model, nav.time, &mut Gate::lenient())
        .unwrap();
}

/// In and out with nothing between changes nothing (S T = 1), to rounding.
#[test]
fn holding_and_releasing_changes_nothing() {
    for seed in 0..20 {
        let (mut filter, _) = driven(seed);
        let before = filter.covariance().clone();
        filter.hold_heading(Bookkeeping::Exact).unwrap();
        assert_eq!(
            filter.covariance().layout().len(),
            before.layout().len() + 1
        );
        filter.release_heading(Bookkeeping::Exact);
        assert_eq!(&before, filter.covariance(), "seed {seed}");
        filter.hold_attitude().unwrap();
        filter.release_attitude();
        assert_eq!(&before, filter.covariance(), "seed {seed}");
        // The control: to the letter of the paper something is lost.
        filter.hold_heading(Bookkeeping::VarianceOnly).unwrap();
        filter.release_heading(Bookkeeping::VarianceOnly);
        let lost = relative_difference(&before.dense(), &filter.base_covariance());
        assert!(lost > 1e-3, "seed {seed}: {lost:e}");
        let sigma = |p: SMatrix<f64, BASE, BASE>| p[(8, 8)];
        assert!((sigma(before.dense()) / sigma(filter.base_covariance()) - 1.0).abs() < 1e-14);
    }
}

/// The total of a held and a walking part obeys the model of the one error: with nothing told of the held heading, a filter
/// that holds it goes the same way as one that does not, in estimate and covariance, through propagation, zero velocities and
/// GNSS with a lever arm.
#[test]
fn a_held_heading_of_which_nothing_is_told_is_no_difference() {
    for seed in 0..10 {
        let (plain, source) = driven(seed);
        let run = |mut filter: Eskf, mut source: Source| {
            for k in 0..300 {
                let (nav, errors) = (filter.nominal().nav, filter.nominal().imu_errors);
                let raw = at_rest(&nav, &errors, 0.01, &mut source);
                filter.propagate_standing(&raw, StandingForce::Gravity);
                let now = filter.nominal().nav.time;
                let zero = ZeroVelocityModel { sigma: 0.02 };
                filter.update(&zero, now, &mut Gate::lenient()).unwrap();
                if k % 100 == 0 {
                    fix(&mut filter, &mut source);
                }
            }
            filter
        };
        let (mut heading, mut attitude) = (plain.clone(), plain.clone());
        heading.hold_heading(Bookkeeping::Exact).unwrap();
        attitude.hold_attitude().unwrap();
        let plain = run(plain, source.clone());
        for held in [run(heading, source.clone()), run(attitude, source.clone())] {
            let off = relative_difference(&plain.base_covariance(), &held.base_covariance());
            assert!(off < 1e-10, "seed {seed}: {off:e}");
            let turn = plain.nominal().nav.q_nb.angle_to(&held.nominal().nav.q_nb);
            // angle_to resolves 2e-8 only.
            assert!(turn < 1e-7, "seed {seed}: {turn:e}");
        }
    }
}

/// P stays positive semidefinite through a stop, though it is singular by design.
#[test]
fn the_covariance_stays_positive_through_a_stop() {
    for seed in 0..5 {
        let (mut filter, mut source) = driven(seed);
        filter.hold_heading(Bookkeeping::Exact).unwrap();
        let model = HeldHeadingModel {
            row: HeadingRow::Down,
            sigma: 1.7e-3,
        };
        for _ in 0..500 {
            let (nav, errors) = (filter.nominal().nav, filter.nominal().imu_errors);
            let raw = at_rest(&nav, &errors, 0.01, &mut source);
            filter.propagate_standing(&raw, StandingForce::Gravity);
            let now = filter.nominal().nav.time;
            let zero = ZeroVelocityModel { sigma: 0.02 };
            filter.update(&zero, now, &mut Gate::lenient()).unwrap();
            filter.update(&model, now, &mut Gate::lenient()).unwrap();
        }
        // Held heading, lever arm and colour are among the first 22.
        let p: SMatrix<f64, 22, 22> = filter.covariance().dense();
        let scale = SMatrix::<f64, 22, 22>::from_fn(|i, j| {
            let product = p[(i, i)] * p[(j, j)];
            if product > 0.0 {
                p[(i, j)] / product.sqrt()
            } else {
                0.0
            }
        });
        let least = scale.symmetric_eigenvalues().min();
        assert!(least > -1e-12, "seed {seed}: {least:e}");
    }
}

/// Feedback reaches the held reference: a correction of the constant part turns estimate and reference alike.
#[test]
fn a_correction_of_the_constant_part_turns_the_reference_too() {
    let (mut filter, _) = driven(3);
    filter.hold_heading(Bookkeeping::Exact).unwrap();
    let layout = *filter.covariance().layout();
    let mut dx = [0.0; CAPACITY];
    dx[layout.range(HELD_HEADING).unwrap().start] = 0.01;
    let turned = filter.nominal().retract(&layout, &dx);
    let residual = |at: &Nominal| {
        let model = HeldHeadingModel {
            row: HeadingRow::Down,
            sigma: 1.0,
        };
        model.linearize(at, &layout).residual.x
    };
    assert!(residual(&turned).abs() < 1e-12);
    let heading = |at: &Nominal| Euler::from_quaternion(&at.nav.q_nb).heading;
    assert!((heading(&turned) - heading(filter.nominal())).abs() > 5e-3);
}

/// The noise of the rate is in the heading as well: with it accounted for, what a step of noise did is undone.
#[test]
fn the_correlated_zero_rate_undoes_the_noise_of_its_own_step() {
    let level = UnitQuaternion::identity();
    let mut at = random_nominal(&mut Source::new(5, Stream::Initial));
    (at.nav.q_nb, at.nav.velocity_n) = (level, Vector3::zeros());
    at.imu_errors = ImuErrors::default();
    at.nav.position = Geodetic::from_degrees(45.0, 10.0, 0.0);
    let mut known = sigma();
    // Nothing else may be at fault.
    known.gyro_bias = Vector3::from_element(1e-12);
    let dt = 0.01;
    let heading_sigma = |gain: HeadingRateGain| {
        let mut filter = Eskf::new(at.nav, at.imu_errors, &known, ImuGrade::Consumer.noise());
        let mut source = Source::new(1, Stream::Initial);
        for _ in 0..1000 {
            let raw = at_rest(
                &filter.nominal().nav,
                &ImuErrors::default(),
                dt,
                &mut source,
            );
            filter.propagate_standing(&raw, StandingForce::Gravity);
            let model = ZeroHeadingRateModel {
                sigma: filter.noise().gyro_white / dt.sqrt(),
                dt,
                gain,
            };
            let now = filter.nominal().nav.time;
            filter.update(&model, now, &mut Gate::lenient()).unwrap();
        }
        let p = filter.covariance().block(ATTITUDE, ATTITUDE).unwrap();
        let bias = filter.covariance().block(GYRO_BIAS, GYRO_BIAS).unwrap();
        assert!(bias[(2, 2)] > 0.0);
        p[(2, 2)].sqrt()
    };
    let start = known.attitude.z;
    let exact = heading_sigma(HeadingRateGain::Correlated);
    assert!((exact / start - 1.0).abs() < 2e-3, "{exact} {start}");
    // The control: 10 s of 2 °/√h are 0.11° that never were.
    let naive = heading_sigma(HeadingRateGain::Naive);
    assert!(naive > exact + 1e-5, "{naive} {exact}");
}

#[test]
fn settings_out_of_range_are_named() {
    for (key, broken) in [
        (
            "threshold_scale",
            StationaryConfig {
                threshold_scale: 0.0,
                ..StationaryConfig::default()
            },
        ),
        (
            "window_s",
            StationaryConfig {
                window_s: Some(-1.0),
                ..StationaryConfig::default()
            },
        ),
        (
            "velocity_sigma",
            StationaryConfig {
                velocity_sigma_m_per_s: f64::NAN,
                ..StationaryConfig::default()
            },
        ),
    ] {
        let config = insnav::config::Config {
            stationary: broken,
            ..insnav::config::Config::default()
        };
        let error = config.validate().unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}
