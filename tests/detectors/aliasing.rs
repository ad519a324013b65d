//! An engine above half the sampling rate, seen at instants.

use crate::unit::{Output, Unit, detector, idle, imu, knows_nothing};
use insnav::sample::{GnssVelocity, Sample};
use insnav::sim::{Source, Stream};
use insnav::solution::Motion;
use insnav::time::Time;
use nalgebra::Vector3;

/// Vibration above half the sampling rate comes down into the pass band. Where GNSS or wheels have confirmed a stop for long
/// enough, its level is learnt, and later stops are found; the first is not.
#[test]
fn an_engine_that_aliases_is_learnt_from_confirmed_stops() {
    let shaking = idle(0.3, 0.3);
    let (mut first, mut later) = (0, 0);
    let runs = 50;
    for seed in 0..runs {
        let mut detector = detector();
        let mut unit = Unit::new(seed, 30.0, shaking);
        let mut gnss = Source::new(seed, Stream::VelocityWhite);
        // GNSS of 0.03 m/s: stands until 40 s, drives until 60 s, stands.
        let (mut fixes, mut stood) = (0, [false; 2]);
        loop {
            let (t, force, rate_b) = unit.next();
            if t > 70.0 {
                break;
            }
            let driving = (40.0..60.0).contains(&t);
            while f64::from(fixes) <= t {
                let fix = GnssVelocity {
                    time: Time::from_seconds(f64::from(fixes)),
                    velocity_n: Vector3::x() * if driving { 10.0 } else { 0.0 }
                        + gnss.normal3() * 0.03,
                    covariance_n: None,
                };
                detector.observe(&Sample::GnssVelocity(fix), &knows_nothing());
                fixes += 1;
            }
            detector.observe(&imu(t, force, rate_b), &knows_nothing());
            let stands = detector.motion() != Motion::Moving;
            assert!(
                !(stands && (42.0..60.0).contains(&t)),
                "standing under way at {t}"
            );
            stood[0] |= stands && t < 10.0;
            stood[1] |= stands && t > 60.0;
        }
        first += u64::from(stood[0]);
        later += u64::from(stood[1]);
    }
    println!(
        "30 Hz, idle 0.3 m/s2 + 0.3 deg/s: found at once in {first}, after learning in {later} of {runs}"
    );
    assert!(later >= runs - 1);
}

/// Why such an engine is not let through as a stop: its means over a second, by which a stop is used, are as far off as a tilt of
/// half a degree, where a unit that averages shows less than it scatters by itself.
#[test]
fn what_comes_down_into_the_band_spoils_the_means_of_a_stop_too() {
    let scatter = |output, rate: f64| {
        let (runs, mut sum) = (200, 0.0);
        for seed in 0..runs {
            let mut unit = Unit::without_noise(seed, rate, idle(2.0, 2.0)).giving(output);
            let mut mean = Vector3::zeros();
            for _ in 0..rate as u32 {
                mean += unit.next().1 / rate;
            }
            mean.z += insnav::imu::STANDARD_GRAVITY;
            sum += mean.norm_squared() / 3.0;
        }
        (sum / f64::from(runs as u32)).sqrt()
    };
    let white = crate::unit::ACCEL_WHITE;
    for (output, rate) in [
        (Output::Instants, 30.0),
        (Output::LowPassed, 30.0),
        (Output::Means, 30.0),
        (Output::Instants, 100.0),
        (Output::Instants, 200.0),
    ] {
        let found = scatter(output, rate);
        println!(
            "idle 2 m/s2, {rate} Hz, {output:?}: means of 1 s off by {found:.4} m/s2, {:.1} of their noise",
            found / white
        );
        let spoilt = rate == 30.0 && output == Output::Instants;
        assert_eq!(found > 10.0 * white, spoilt, "{found}");
    }
}
