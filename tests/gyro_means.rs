//! The mean of a gyro at rest is its bias where nothing says otherwise: not where its values come in coarse steps, and not where
//! the body may have turned slowly.

mod at_rest;

use at_rest::{AtRest, Record, declared, gyro_bias_sigma, sigma};
use insnav::config::{Config, StationaryMode};
use insnav::filter::InitialSigma;
use insnav::imu::{ImuErrors, ImuGrade, ImuNoise};
use insnav::navigator::Navigator;
use insnav::sample::Sample;
use insnav::sim::{Source, Stream};
use insnav::solution::Motion;
use nalgebra::Vector3;

const SEEDS: u64 = 20;
/// The issue's: 0.01 rad/s.
const STEP: f64 = 0.01;
/// Of a sample at 100 Hz: nine of ten lie within half a step.
const NINE_IN_TEN: f64 = 0.5 * STEP / 1.645;

/// What becomes of the rates of the gyros on their way into the log.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Output {
    Fine,
    Steps,
    /// In steps, with less than a millionth of one added: the steps cannot be seen, and are there.
    HiddenSteps,
}

/// Gyro biases after a minute in a declared stop: sum over axes and seeds of squared errors in sigmas, over their number.
fn bias_nees(mode: StationaryMode, noise: ImuNoise, output: Output) -> f64 {
    let mut sum = 0.0;
    for seed in 0..SEEDS {
        let mut source = Source::new(seed, Stream::GyroBias);
        let body = AtRest {
            attitude_deg: |_| [1.0, -2.0, 130.0],
            errors: ImuErrors {
                gyro_bias: source.normal3() * noise.gyro_bias_sigma,
                ..ImuErrors::default()
            },
            noise,
            gyro_step: if output == Output::Fine { 0.0 } else { STEP },
            seed,
        };
        let known = InitialSigma {
            gyro_bias: Vector3::repeat(noise.gyro_bias_sigma),
            accel_bias: Vector3::repeat(noise.accel_bias_sigma),
            ..sigma(1.0)
        };
        let config = declared(mode, &[[1.0, 59.0]]);
        let mut navigator =
            Navigator::aligned(&config, noise, body.nav(), ImuErrors::default(), &known)
                .expect("good settings");
        let mut record = Record::default();
        for sample in body.samples(60.0, 1.0) {
            let sample = match sample {
                Sample::Imu(mut imu) if output == Output::HiddenSteps => {
                    imu.angular_rate_b += source.normal3() * 1e-7;
                    Sample::Imu(imu)
                }
                other => other,
            };
            navigator.step(&sample, &mut record).expect("good samples");
        }
        navigator.finish(&mut record).expect("good samples");
        let stop = record.stops[0];
        let off = (stop.gyro_bias - body.errors.gyro_bias).component_div(&stop.sigma_gyro_bias);
        sum += off.norm_squared();
        for axis in 0..3 {
            // A gyro shows its steps, or repeats one value for all of the minute.
            let seen = stop.gyro_step[axis] > 0.0 || stop.gyro_repeats[axis];
            assert_eq!(seen, output == Output::Steps, "seed {seed}: {stop:?}");
            if stop.gyro_step[axis] > 0.0 {
                assert!((stop.gyro_step[axis] / STEP - 1.0).abs() < 1e-6);
            }
        }
    }
    sum / (3 * SEEDS) as f64
}

/// Of 60 degrees of freedom, at one in a thousand on either side.
const BAND: core::ops::Range<f64> = 0.54..1.66;

/// A unit of the consumer class, whose bias is within half a step, and one whose bias is two steps: rounding then is uniform over
/// a step, and many axes repeat one value that is not zero.
#[test]
fn the_mean_of_coarse_steps_is_not_taken_for_the_bias() {
    let consumer = ImuNoise {
        gyro_white: NINE_IN_TEN / at_rest::RATE.sqrt(),
        // The simulated biases are constants.
        gyro_bias_tau: 1e12,
        ..ImuGrade::Consumer.noise()
    };
    let hobby = ImuNoise {
        gyro_white: 1e-4,
        gyro_bias_sigma: 2.0 * STEP,
        ..consumer
    };
    let quiet = ImuNoise {
        gyro_white: 1e-4,
        ..consumer
    };
    for (name, noise) in [("consumer", consumer), ("quiet", quiet), ("hobby", hobby)] {
        let nees = |output| bias_nees(StationaryMode::Static, noise, output);
        let (fine, coarse, hidden) = (
            nees(Output::Fine),
            nees(Output::Steps),
            nees(Output::HiddenSteps),
        );
        println!(
            "{name}: NEES of the bias {fine:.2}, in steps {coarse:.2}, steps unseen {hidden:.1}"
        );
        assert!(BAND.contains(&fine), "{name}: {fine}");
        assert!(BAND.contains(&coarse), "{name}: {coarse}");
        // The control: a filter that takes the mean for the bias.
        assert!(hidden > 5.0, "{name}: {hidden}");
    }
}

/// The other modes hold with what the gyros show, which is right as long as the body stands, and widen what they have learnt when it
/// rises. Rounding is no normal error and the least that a step brings is told: the NEES may be low.
#[test]
fn no_mode_keeps_a_rounded_rate_for_a_bias() {
    let noise = ImuNoise {
        gyro_white: NINE_IN_TEN / at_rest::RATE.sqrt(),
        ..ImuGrade::Consumer.noise()
    };
    for mode in [StationaryMode::HeadingHold, StationaryMode::AttitudeHold] {
        let nees = bias_nees(mode, noise, Output::Steps);
        println!("{mode:?}: NEES of the bias {nees:.2}");
        assert!(nees < BAND.end, "{mode:?}: {nees}");
    }
}

/// Degrees of turn about Down by `t` at this rate between two instants.
fn turned(t: f64, rate: f64, [from, to]: [f64; 2]) -> f64 {
    rate * (t.clamp(from, to) - from)
}

/// What a run without GNSS has at its end, after two minutes.
struct End {
    /// Error of the heading, which counts from the start, and of the gyro bias about Down, in sigmas.
    heading: f64,
    bias: f64,
    sigma_heading_deg: f64,
    doubted: bool,
}

/// At rest for two minutes, but for a slow turn.
fn from_rest(noise: ImuNoise, rate: f64, between: [f64; 2], seed: u64) -> End {
    let mut source = Source::new(seed, Stream::GyroBias);
    let body = AtRest {
        attitude_deg: |t: f64| [0.0, 0.0, turned(t, rate, between)],
        errors: ImuErrors {
            gyro_bias: source.normal3() * noise.gyro_bias_sigma,
            ..ImuErrors::default()
        },
        noise,
        gyro_step: 0.0,
        seed,
    };
    let mut config = Config::default();
    config.gnss.used = false;
    config.alignment.latitude_deg = Some(55.0);
    let mut navigator = Navigator::new(&config, noise).expect("good settings");
    let mut record = Record::default();
    for sample in body.samples(120.0, 1.0) {
        navigator.step(&sample, &mut record).expect("good samples");
    }
    navigator.finish(&mut record).expect("a start at rest");
    let last = record.epochs[record.epochs.len() - 1];
    let error = (last.nav.q_nb * body.q_nb(120.0).inverse()).scaled_axis().z;
    let sigma = last.heading_sigma();
    let bias = (last.imu_errors.gyro_bias - body.errors.gyro_bias).z;
    let doubted = record
        .stops
        .iter()
        .any(|stop| stop.held_from.since(at_rest::BEGIN) < 1.0)
        && record
            .epochs
            .iter()
            .filter(|e| e.motion != Motion::Moving)
            .any(|e| e.heading_sigma() > 1_f64.to_radians());
    End {
        heading: error / sigma,
        bias: bias / gyro_bias_sigma(&last).z,
        sigma_heading_deg: sigma.to_degrees(),
        doubted,
    }
}

/// 3° in 15 s, and 0.1 °/s for half a minute, at the start: neither the heading nor the bias is falsely known. At true rest both
/// are, and well.
#[test]
fn a_slow_turn_at_the_start_does_not_become_a_bias() {
    let consumer = ImuGrade::Consumer.noise();
    for (rate, between) in [
        (0.0, [0.0, 1.0]),
        (0.2, [0.0, 15.0]),
        (0.2, [10.0, 25.0]),
        (0.1, [0.0, 30.0]),
    ] {
        let ends: Vec<End> = (0..SEEDS)
            .map(|seed| from_rest(consumer, rate, between, seed))
            .collect();
        let mean = |of: &dyn Fn(&End) -> f64| ends.iter().map(of).sum::<f64>() / SEEDS as f64;
        let heading = mean(&|e| e.heading * e.heading);
        let bias = mean(&|e| e.bias * e.bias);
        let sigma = mean(&|e| e.sigma_heading_deg);
        let doubted = ends.iter().filter(|e| e.doubted).count();
        println!(
            "{rate} °/s in {between:?}: NEES of heading {heading:.2} (sigma {sigma:.3}°), of the bias {bias:.2}; doubted {doubted} of {SEEDS}"
        );
        // Of 20 degrees of freedom, one in a thousand. Low values are no falsehood.
        assert!(heading < 2.27 && bias < 2.27, "{rate} in {between:?}");
        assert_eq!(doubted > 0, rate > 0.0, "{rate} in {between:?}");
    }
}
