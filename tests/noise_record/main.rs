//! Noise of inertial records: of known size at rest and on the move, with accelerations that nobody models, and of a recorded unit.

mod recorded;
mod refused;
mod simulated;

use insnav::imu::ImuNoise;
use insnav::noise::{IdentifyOptions, Known, NoiseReading, RecordNoise, identify_noise};
use simulated::{Bursts, Motion, Unit, record};

fn long() -> bool {
    std::env::var("INSNAV_LONG").is_ok_and(|v| v == "1")
}

/// What is known beforehand: three times the truth in both densities.
fn prior() -> ImuNoise {
    ImuNoise::from_data_sheet(6.0, 0.6, 200.0, 10.0, 20_000.0, 20_000.0)
}

fn identified(readings: &[NoiseReading]) -> RecordNoise {
    identify_noise(readings, &IdentifyOptions::new(prior())).expect("a good record")
}

fn z(known: &Known, truth: f64) -> f64 {
    assert!(known.accepted, "{known:?}");
    (known.value - truth) / known.standard_error
}

/// Three minutes of a unit like that of [Belokurov18]: all three noises within three of their stated errors, whatever the motion.
#[test]
fn noise_is_told_at_rest_and_in_motion() {
    let unit = Unit::adis();
    for motion in [Motion::Rest, Motion::Turning(6.0), Motion::Turning(40.0)] {
        let mut all = [vec![], vec![], vec![]];
        for seed in 0..if long() { 100 } else { 6 } {
            let noise = identified(&record(&unit, motion, None, 180.0, seed));
            let heading = noise.heading.as_ref().expect("a magnetometer");
            all[0].push(z(&noise.tilt.gyro_white, unit.gyro_white));
            all[1].push(z(&noise.tilt.accel_white, unit.accel_white));
            all[2].push(z(&heading.magnetometer, unit.magnetometer));
            let used = noise.windows.iter().filter(|w| w.accepted).count();
            assert!(used * 10 >= noise.windows.len() * 9, "{:#?}", noise.windows);
            // Of 180 s: about 150 time constants of the best filter on two axes.
            assert!(noise.tilt.gyro_white.standard_error < 0.12 * unit.gyro_white);
            assert!(noise.tilt.accel_white.standard_error < 0.02 * unit.accel_white);
        }
        for (z, what) in all.iter().zip(["gyro", "accelerometer", "magnetometer"]) {
            let mean = z.iter().sum::<f64>() / z.len() as f64;
            let rms = (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt();
            let outside = z.iter().filter(|z| z.abs() > 3.0).count();
            println!(
                "{motion:?}, {what}: z mean {mean:.2}, rms {rms:.2}, {outside} of {} beyond 3",
                z.len()
            );
            assert!(outside * 50 <= z.len(), "{z:?}");
            assert!(rms < 1.6, "{z:?}");
        }
    }
}

/// Horizontal accelerations of a third of the gravity's noise: no window with them is used, and what the others tell is not inflated.
#[test]
fn unmodelled_acceleration_is_left_out() {
    let unit = Unit::adis();
    let mut spoilt = (0, 0);
    for size in [0.3, 1.0] {
        for seed in 0..if long() { 50 } else { 4 } {
            let bursts = Bursts {
                size,
                from_s: 60.0,
                to_s: 120.0,
            };
            let noise = identified(&record(
                &unit,
                Motion::Turning(6.0),
                Some(bursts),
                240.0,
                seed,
            ));
            for w in &noise.windows {
                if w.begin.seconds() < 119.0 && w.end.seconds() > 61.0 {
                    spoilt.0 += usize::from(w.accepted);
                    spoilt.1 += 1;
                    assert!(w.accepted || w.reason.contains("acceleration"), "{w:?}");
                }
            }
            assert!(z(&noise.tilt.gyro_white, unit.gyro_white) < 3.0);
            let intervals = noise.accepted_intervals();
            assert!(!intervals.is_empty());
        }
    }
    println!("{} of {} windows with bursts were used", spoilt.0, spoilt.1);
    assert!(spoilt.1 > 0 && spoilt.0 * 20 <= spoilt.1, "{spoilt:?}");
}

/// Where every window is spoilt, what was known is kept, and the reason says what to do.
#[test]
fn nothing_is_told_by_a_record_that_always_accelerates() {
    let bursts = Bursts {
        size: 0.3,
        from_s: 0.0,
        to_s: 1e9,
    };
    let noise = identified(&record(&Unit::adis(), Motion::Rest, Some(bursts), 180.0, 1));
    let gyro = &noise.tilt.gyro_white;
    assert!(
        !gyro.accepted && gyro.value == prior().gyro_white,
        "{gyro:?}"
    );
    assert_eq!(noise.tilt.accel_white.value, prior().accel_white);
    assert!(
        gyro.reason.contains("none of") && gyro.reason.contains("rest"),
        "{gyro:?}"
    );
    assert!(noise.accepted_intervals().is_empty());
}

/// Vibration makes the accelerometer five times as noisy for a while: that is its noise then, and the scatter is in the error.
#[test]
fn noise_that_changes_has_wider_errors() {
    let quiet = Unit::adis();
    let steady = identified(&record(&quiet, Motion::Rest, None, 360.0, 3));
    let mut readings = record(&quiet, Motion::Rest, None, 180.0, 3);
    let shaken = Unit {
        accel_white: 5.0 * quiet.accel_white,
        ..quiet
    };
    let shift = readings[readings.len() - 1].time.seconds() + quiet.step_s;
    readings.extend(
        record(&shaken, Motion::Rest, None, 180.0, 4)
            .into_iter()
            .map(|mut r| {
                r.time = r.time.plus(shift);
                r
            }),
    );
    let changed = identified(&readings);
    let (a, b) = (&steady.tilt.accel_white, &changed.tilt.accel_white);
    println!("{a:?}\n{b:?}");
    assert!(b.accepted && b.value > 2.0 * a.value && b.value < 5.0 * quiet.accel_white);
    assert!(b.standard_error / b.value > 4.0 * a.standard_error / a.value);
}

/// Minutes do not tell how the bias wanders; what was known of it is kept. Nor do they tell gyros a thousand times better than the accelerometers.
#[test]
fn what_is_not_identifiable_is_kept() {
    let unit = Unit {
        gyro_white: 1e-9,
        ..Unit::adis()
    };
    let noise = identified(&record(&unit, Motion::Rest, None, 120.0, 2));
    let gyro = &noise.tilt.gyro_white;
    assert!(
        !gyro.accepted && gyro.value == prior().gyro_white,
        "{gyro:?}"
    );
    assert!(
        gyro.reason.contains("bound") || gyro.reason.contains("not identifiable"),
        "{gyro:?}"
    );
    assert!(noise.tilt.accel_white.accepted, "{:?}", noise.tilt);
    let ordinary = identified(&record(&Unit::adis(), Motion::Rest, None, 180.0, 2));
    let bias = &ordinary.gyro_bias;
    assert!(
        !bias.wander.accepted && bias.wander.value == bias.prior,
        "{bias:?}"
    );
    assert!(bias.wander.reason.contains("not identifiable"), "{bias:?}");
}

/// A gap parts the record: no window lies across it, and what is told is the same.
#[test]
fn gaps_part_the_record() {
    let unit = Unit::adis();
    let mut readings = record(&unit, Motion::Turning(6.0), None, 180.0, 5);
    let cut = readings.len() / 3;
    // Ten seconds are lost, the motion goes on.
    readings.drain(cut..cut + 312);
    let (before, after) = (readings[cut - 1].time, readings[cut].time);
    let noise = identified(&readings);
    assert_eq!(noise.pieces, 2);
    assert!(
        noise
            .windows
            .iter()
            .all(|w| w.end <= before || w.begin >= after)
    );
    assert!(z(&noise.tilt.gyro_white, unit.gyro_white).abs() < 3.0);
}
