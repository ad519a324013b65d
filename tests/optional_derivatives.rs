//! The optional states against numerical derivatives through `retract`: their columns of F, their columns of every H, and
//! what a closed block leaves behind.

use insnav::attitude::exp;
use insnav::config::{GnssConfig, VehicleConfig};
use insnav::earth::Geodetic;
use insnav::filter::{
    ACCEL_SCALE, AXLE, CAPACITY, CLOCK_OFFSET, Calibration, Eskf, GNSS_COLOUR, GYRO_SCALE,
    InitialSigma, LEVER_ARM, Layout, MOUNTING, Measurement, Nominal, Process, Transition,
    fill_base, fill_optional,
};
use insnav::imu::{ImuErrors, ImuGrade};
use insnav::measurement::{
    GnssPositionAid, GnssPositionModel, GnssVelocityModel, LateralModel, NonholonomicAid,
    NonholonomicModel,
};
use insnav::mechanization::{Increment, NavState};
use insnav::sample::GnssPosition;
use insnav::sim::{Source, Stream};
use insnav::time::Time;
use nalgebra::{Matrix2, Matrix3, UnitQuaternion, Vector2, Vector3};

const STATES: u64 = 200;

fn zero_sigma() -> InitialSigma {
    let zero = Vector3::zeros();
    InitialSigma {
        position: zero,
        velocity: zero,
        attitude: zero,
        gyro_bias: zero,
        accel_bias: zero,
    }
}

fn random_nominal(source: &mut Source) -> Nominal {
    Nominal {
        held_q_nb: UnitQuaternion::identity(),
        nav: NavState {
            time: Time(1_700_000_000_000_000_000),
            position: Geodetic::from_degrees(
                source.between(-80.0, 80.0),
                source.between(-180.0, 180.0),
                source.between(-100.0, 10_000.0),
            ),
            velocity_n: source.normal3().normalize() * source.between(1.0, 50.0),
            q_nb: exp(&(source.normal3() * 2.0)),
        },
        rate_b: source.normal3(),
        acceleration_n: source.normal3() * 3.0,
        imu_errors: ImuErrors {
            gyro_bias: source.normal3() * 0.01,
            accel_bias: source.normal3() * 0.3,
            gyro_scale: source.normal3() * 0.02,
            accel_scale: source.normal3() * 0.02,
        },
        calibration: Calibration {
            gnss_colour_n: source.normal3(),
            lever_arm_b: source.normal3(),
            mounting: Vector2::new(source.between(-0.5, 0.5), source.between(-1.5, 1.5)),
            axle_forward: source.between(-2.0, 2.0),
            odometer_scale: 0.0,
            clock_offset: source.between(-0.2, 0.2),
        },
    }
}

/// A filter with every optional block that has a model, at a nominal state.
fn open_filter(at: &Nominal) -> Eskf {
    let mut filter = Eskf::new(
        at.nav,
        at.imu_errors,
        &zero_sigma(),
        ImuGrade::Consumer.noise(),
    );
    filter.set_calibration(at.calibration);
    let constant = Process::constant(1.0);
    filter.open(GYRO_SCALE, constant).unwrap();
    filter.open(ACCEL_SCALE, constant).unwrap();
    filter.open(LEVER_ARM, constant).unwrap();
    filter.open(MOUNTING, constant).unwrap();
    filter.open(AXLE, constant).unwrap();
    filter.open(CLOCK_OFFSET, constant).unwrap();
    let colour = Process {
        sigma: Vector3::new(1.0, 1.0, 2.0),
        tau: 30.0,
    };
    filter.open(GNSS_COLOUR, colour).unwrap();
    filter
}

fn layout() -> Layout {
    let mut source = Source::new(0, Stream::Initial);
    *open_filter(&random_nominal(&mut source))
        .covariance()
        .layout()
}

/// There and back: what `retract` adds, `local` finds, for every state.
#[test]
fn retract_and_local_are_inverse() {
    let layout = layout();
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let at = random_nominal(&mut source);
        let mut dx = [0.0; CAPACITY];
        for x in dx.iter_mut().take(layout.len()) {
            *x = source.normal() * 1e-3;
        }
        let back = at.local(&layout, &at.retract(&layout, &dx));
        for i in 0..layout.len() {
            // Longitude in radians resolves 4e-9 m.
            assert!(
                (back[i] - dx[i]).abs() < 1e-8,
                "seed {seed} state {i}: {} {}",
                back[i],
                dx[i]
            );
        }
    }
}

/// What the gyro measured stays whatever is believed of its errors.
#[test]
fn a_correction_leaves_the_measured_rate() {
    let layout = layout();
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let at = random_nominal(&mut source);
        let mut dx = [0.0; CAPACITY];
        for x in dx.iter_mut().take(layout.len()) {
            *x = source.normal() * 1e-2;
        }
        let measured = |n: &Nominal| {
            n.rate_b
                .component_mul(&n.imu_errors.gyro_scale.add_scalar(1.0))
                + n.imu_errors.gyro_bias
        };
        let end = at.retract(&layout, &dx);
        assert!((measured(&end) - measured(&at)).norm() < 1e-14);
    }
}

/// Columns of (Φ − I)/dt of biases and scale factors by central differences of the filter's own motion.
#[test]
fn scale_factors_move_attitude_and_velocity_as_their_columns_say() {
    const DT: f64 = 1e-3;
    let layout = layout();
    let columns: Vec<usize> = (9..15)
        .chain(layout.range(GYRO_SCALE).unwrap())
        .chain(layout.range(ACCEL_SCALE).unwrap())
        .collect();
    let mut largest_without: f64 = 0.0;
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let at = random_nominal(&mut source);
        let increment = Increment {
            time: at.nav.time.plus(DT),
            dt: DT,
            rotation_b: source.normal3() * 2.0 * DT,
            velocity_b: source.normal3() * 10.0 * DT,
        };
        let step = |from: &Nominal| {
            let mut filter = open_filter(from);
            filter.propagate(&increment);
            *filter.nominal()
        };
        let corrected = increment.corrected(&at.imu_errors);
        let interval = at.nav.clone().advance(&corrected);
        let mut phi = Transition::default();
        let filter = open_filter(&at);
        fill_base(&mut phi, &layout, &interval, filter.noise());
        let mut without = phi;
        fill_optional(
            &mut phi,
            &layout,
            &interval,
            &corrected,
            &at.imu_errors,
            filter.processes(),
        );
        // Control: without what belongs to the optional states the columns are wrong.
        without.decay = phi.decay;
        let end = step(&at);
        for &j in &columns {
            let moved = |by: f64| {
                let mut dx = [0.0; CAPACITY];
                dx[j] = by;
                end.local(&layout, &step(&at.retract(&layout, &dx)))
            };
            let h = 1e-2;
            let (plus, minus) = (moved(h), moved(-h));
            let mut unit = [0.0; CAPACITY];
            unit[j] = 1.0;
            let (by_phi, bare) = (phi.times(&unit), without.times(&unit));
            for i in 3..9 {
                let numerical = (plus[i] - minus[i]) / (2.0 * h * DT);
                let analytic = by_phi[i] / DT;
                // Half a step of rotation (2 rad/s × 0.5 ms) between axes of middle and begin, of 40 m/s² at most; second
                // order of the difference: (1e-2)² of it.
                assert!(
                    (numerical - analytic).abs() < 40.0 * 2e-3,
                    "seed {seed} ({i}, {j}): {numerical} {analytic}"
                );
                largest_without = largest_without.max((numerical - bare[i] / DT).abs());
            }
        }
    }
    assert!(largest_without > 5.0, "{largest_without}");
}

/// Every H over every open state.
fn check<const M: usize>(model: &impl Measurement<M>, at: &Nominal, layout: &Layout) {
    let h = model.linearize(at, layout).h;
    for j in 0..layout.len() {
        // Steps over which positions are resolved to 1e-9 and nothing bends.
        let step = if j < 3 { 1.0 } else { 1e-4 };
        let residual = |by: f64| {
            let mut dx = [0.0; CAPACITY];
            dx[j] = by;
            model.linearize(&at.retract(layout, &dx), layout).residual
        };
        // The residual falls by what the prediction rises.
        let numerical = (residual(-step) - residual(step)) / (2.0 * step);
        let mut unit = [0.0; CAPACITY];
        unit[j] = 1.0;
        let analytic = h.times(&unit);
        for i in 0..M {
            // Rounding of longitude 4e-9 m over a step of 1e-4; bending of the step squared; north changes by 2 m / R a metre.
            let tolerance = 2e-4 + 1e-6 * analytic[i].abs();
            assert!(
                (numerical[i] - analytic[i]).abs() < tolerance,
                "{} row {i} state {j}: {} {}",
                model.name(),
                numerical[i],
                analytic[i]
            );
        }
    }
}

#[test]
fn every_model_has_the_derivatives_of_its_residual() {
    let layout = layout();
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let at = random_nominal(&mut source);
        let lever_arm_b = source.normal3() * 2.0;
        let r = Matrix3::identity();
        let position = at.nav.position.offset(&source.normal3());
        check(
            &GnssPositionModel {
                position,
                lever_arm_b,
                r,
                dependence: 1.0,
                position_alone: false,
            },
            &at,
            &layout,
        );
        check(
            &GnssVelocityModel {
                velocity_n: source.normal3(),
                lever_arm_b,
                r,
            },
            &at,
            &layout,
        );
        let wheels = NonholonomicModel {
            axle_b: source.normal3(),
            r: Matrix2::identity(),
        };
        check(&wheels, &at, &layout);
        check(&LateralModel(wheels), &at, &layout);
    }
}

/// Who drives straight ahead, turned in its vehicle as the mounting says, fulfils the constraint; turned the other way, not.
#[test]
fn a_vehicle_that_follows_its_nose_has_no_residual() {
    let mounting = Vector2::new(-0.12, 0.09);
    // u_vehicle = Rz(yaw) Ry(pitch) u_b
    let q_vb = UnitQuaternion::from_euler_angles(0.0, mounting.x, mounting.y);
    let q_nv = UnitQuaternion::from_euler_angles(0.01, 0.05, 2.0);
    let nominal = |mounting| Nominal {
        held_q_nb: UnitQuaternion::identity(),
        nav: NavState {
            time: Time(0),
            position: Geodetic::from_degrees(50.0, 14.0, 200.0),
            velocity_n: q_nv * Vector3::new(15.0, 0.0, 0.0),
            q_nb: q_nv * q_vb,
        },
        rate_b: Vector3::zeros(),
        acceleration_n: Vector3::zeros(),
        imu_errors: ImuErrors::default(),
        calibration: Calibration {
            mounting,
            ..Calibration::default()
        },
    };
    let aid = NonholonomicAid::new(&VehicleConfig::default());
    let residual = |mounting| {
        let at = nominal(mounting);
        aid.model(&at).linearize(&at, &Layout::default()).residual
    };
    assert!(residual(mounting).norm() < 1e-12);
    assert!(residual(-mounting).norm() > 3.0);
}

/// With states of its own the time-correlated part is not weighed down a second time.
#[test]
fn colour_states_take_the_place_of_the_weight_for_dependence() {
    use insnav::config::ColourConfig;
    // A fix that is used: one that is refused takes no weight from the next.
    let at = random_nominal(&mut Source::new(1, Stream::Initial));
    let fix = |t: f64| GnssPosition {
        time: Time::from_seconds(t),
        position: at.nav.position,
        covariance_n: Some(Matrix3::identity()),
    };
    let variance = |colour| {
        let config = GnssConfig {
            colour,
            ..GnssConfig::default()
        };
        let mut aid = GnssPositionAid::new(&config);
        let mut filter = open_filter(&at);
        aid.observe(&fix(0.0), None, &mut filter).unwrap();
        let model = aid.model(&fix(0.1), false);
        model.r[(0, 0)] * model.dependence
    };
    assert_eq!(variance(None), 10.0);
    let colour = ColourConfig {
        sigma_m: 1.0,
        vertical_sigma_m: None,
        tau_s: 60.0,
    };
    assert_eq!(variance(Some(colour)), 1.0);
}

/// What was found stays in use when its block closes; the momentary error of GNSS does not.
#[test]
fn closing_keeps_constants() {
    let at = random_nominal(&mut Source::new(2, Stream::Initial));
    let mut filter = open_filter(&at);
    filter.close(LEVER_ARM);
    filter.close(GNSS_COLOUR);
    let calibration = filter.nominal().calibration;
    assert_eq!(calibration.lever_arm_b, at.calibration.lever_arm_b);
    assert_eq!(calibration.gnss_colour_n, Vector3::zeros());
    let left: Vec<_> = filter.optional_states().map(|(b, ..)| b.name).collect();
    let expected = [
        "gyro_scale",
        "accel_scale",
        "mounting",
        "clock_offset",
        "axle",
    ];
    assert_eq!(left, expected);
}
