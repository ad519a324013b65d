//! A body at rest does not show its heading to units like these: whatever mode holds a stop, a heading of which nothing is known
//! stays unknown, and the gyro biases are told with what the Earth's rate, whose direction is unknown, leaves in them.

mod at_rest;

use at_rest::{AtRest, declared, gyro_bias_sigma, run, sigma};
use insnav::attitude::wrap_angle;
use insnav::config::{StandingForce, StationaryMode};
use insnav::earth::{Geodetic, LocalEarth};
use insnav::filter::{Eskf, Gate, InitialSigma};
use insnav::imu::{ImuErrors, ImuGrade, ImuNoise};
use insnav::measurement::ZeroVelocityModel;
use insnav::mechanization::{Increment, NavState};
use insnav::sim::{Source, Stream};
use insnav::time::Time;
use nalgebra::{SMatrix, UnitQuaternion, Vector3};

const SEEDS: u64 = 20;

/// Squared errors in sigmas at the end of two minutes, means over seeds: heading, and gyro bias per axis; and the least sigma of
/// the heading, degrees, with the largest error in sigmas.
fn nees(mode: StationaryMode, noise: ImuNoise, known: f64) -> (f64, f64, f64, f64) {
    let (mut heading, mut bias, mut least, mut worst) = (0.0, 0.0, f64::INFINITY, 0.0_f64);
    for seed in 0..SEEDS {
        let mut source = Source::new(seed, Stream::GyroBias);
        // Uniform over the circle, from a normal number of many turns; or normal, where it is roughly known.
        let truth = if known > 100.0 {
            wrap_angle(100.0 * source.normal()).to_degrees()
        } else {
            known * source.normal()
        };
        let body = AtRest {
            attitude_deg: move |_| [1.0, -2.0, truth],
            errors: ImuErrors {
                gyro_bias: source.normal3() * noise.gyro_bias_sigma,
                accel_bias: source.normal3() * noise.accel_bias_sigma,
                ..ImuErrors::default()
            },
            noise,
            gyro_step: 0.0,
            seed,
        };
        let mut nav = body.nav();
        nav.q_nb = insnav::attitude::Euler::from_degrees(1.0, -2.0, 0.0).to_quaternion();
        let prior = InitialSigma {
            gyro_bias: Vector3::repeat(noise.gyro_bias_sigma),
            accel_bias: Vector3::repeat(noise.accel_bias_sigma),
            ..sigma(known)
        };
        let config = declared(mode, &[[0.0, 120.0]]);
        let record = run(&config, nav, &prior, &body.samples(120.0, 1.0));
        let last = record.epochs[record.epochs.len() - 1];
        let sigma = last.heading_sigma();
        let off = wrap_angle(last.euler().heading - truth.to_radians()) / sigma;
        heading += off * off / SEEDS as f64;
        worst = worst.max(off.abs());
        least = least.min(sigma.to_degrees());
        let off = (last.imu_errors.gyro_bias - body.errors.gyro_bias)
            .component_div(&gyro_bias_sigma(&last));
        bias += off.norm_squared() / (3 * SEEDS) as f64;
        if mode != StationaryMode::Off {
            let held = record.stops[0].mode;
            let expected = if known > 28.6 {
                StationaryMode::Static
            } else {
                mode
            };
            assert_eq!(held, expected, "{mode:?}");
        }
    }
    (heading, bias, least, worst)
}

#[test]
fn no_mode_grows_sure_of_an_unknown_heading() {
    let industrial = ImuGrade::Industrial.noise();
    for mode in [
        StationaryMode::Zupt,
        StationaryMode::Zihr,
        StationaryMode::HeadingHold,
        StationaryMode::AttitudeHold,
        StationaryMode::Static,
    ] {
        for known in [104.0, 40.0, 20.0] {
            let (heading, bias, least, worst) = nees(mode, industrial, known);
            println!(
                "{mode:?}, heading known to {known}°: NEES of heading {heading:.2}, of gyro bias {bias:.2}; sigma at least {least:.1}°, error at most {worst:.1} sigmas"
            );
            // 20 degrees of freedom at one in a thousand; a uniform error has lighter tails. 60 of the biases.
            assert!(
                (0.3..2.27).contains(&heading),
                "{mode:?}, {known}: {heading}"
            );
            assert!((0.5..1.66).contains(&bias), "{mode:?}, {known}: {bias}");
            assert!(known < 100.0 || least > 95.0, "{mode:?}: {least}°");
        }
    }
    // The control: a filter that is told nothing of the stop sees the heading in the noise of the specific force.
    let (heading, _, least, _) = nees(StationaryMode::Off, industrial, 104.0);
    println!("off: NEES of heading {heading:.2}, sigma at least {least:.1}°");
    assert!(least < 80.0, "{least}°");
}

/// Standard deviation of the heading, rad, of a level body that looks north, after ten minutes of zero velocities.
fn after_standing(gyro_bias_sigma: Vector3<f64>, tied: bool) -> f64 {
    let nav = NavState {
        time: Time(0),
        position: Geodetic::from_degrees(50.0, 14.0, 250.0),
        velocity_n: Vector3::zeros(),
        q_nb: UnitQuaternion::identity(),
    };
    let sigma = InitialSigma {
        gyro_bias: gyro_bias_sigma,
        attitude: Vector3::new(1e-2, 1e-2, 1.0),
        ..sigma(57.3)
    };
    let mut noise = ImuGrade::Navigation.noise();
    // Biases that stay, so that what is left of them can be told beforehand.
    (noise.gyro_bias_tau, noise.gyro_bias_sigma) = (1e9, 1e-9);
    let mut filter = Eskf::new(nav, ImuErrors::default(), &sigma, noise);
    let earth = LocalEarth::at(&nav.position);
    if tied {
        // A bias found at rest: wrong by what the heading makes of the Earth's rate, and by what it was.
        let bias_by_attitude = -insnav::attitude::skew(&earth.earth_rate_n());
        let mut l = SMatrix::<f64, 9, 9>::identity();
        l.fixed_view_mut::<3, 3>(3, 0).copy_from(&bias_by_attitude);
        let scale = SMatrix::<f64, 9, 1>::from_fn(|i, _| match i {
            0..3 => sigma.attitude[i],
            3..6 => gyro_bias_sigma[i - 3],
            _ => sigma.accel_bias[i - 6],
        });
        let scaled = l * SMatrix::<f64, 9, 9>::from_diagonal(&scale);
        filter.set_joint_prior(&(scaled * scaled.transpose()));
    }
    let (dt, model) = (0.1, ZeroVelocityModel { sigma: 1e-3 });
    for k in 1..=6000 {
        let raw = Increment {
            time: Time(100_000_000 * k),
            dt,
            rotation_b: earth.earth_rate_n() * dt,
            velocity_b: Vector3::new(0.0, 0.0, -earth.gravity() * dt),
        };
        filter.propagate_standing(&raw, StandingForce::Gravity);
        filter
            .update(&model, raw.time, &mut Gate::lenient())
            .expect("a covariance");
    }
    filter.base_covariance()[(8, 8)].sqrt()
}

/// What a level that stays tells of north: the heading turns the Earth's rate into a drift about east, and so does the gyro bias there. Which
/// of both it is, their priors say, 1/√(1 + (Ω_N/σ_b)²); nothing, where the bias was found at rest. The gyro about Down has no part in it.
#[test]
fn a_level_that_stays_tells_of_north_what_the_biases_leave() {
    let rate = 15.0 * std::f64::consts::PI / 180.0 / 3600.0;
    let north = LocalEarth::at(&Geodetic::from_degrees(50.0, 14.0, 250.0))
        .earth_rate_n()
        .x;
    for level in [15.0, 4.0] {
        for down in [15.0, 1.0] {
            let bias = Vector3::new(level, level, down) * (rate / 15.0);
            let expected = (1.0 + (north / bias.x).powi(2)).sqrt().recip();
            let (loose, tied) = (after_standing(bias, false), after_standing(bias, true));
            println!(
                "{level} and {down} °/h: {loose:.4} rad (expected {expected:.4}), tied {tied:.4} rad"
            );
            assert!((loose / expected - 1.0).abs() < 0.01, "{loose} {expected}");
            assert!((tied - 1.0).abs() < 0.01, "{tied}");
        }
    }
}
