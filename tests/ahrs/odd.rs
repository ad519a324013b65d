//! Gaps, gyros that saturate, fields that change, late magnetometers, bad samples.

use super::carried::{FIELD, Record, Unit, error, estimate, record};
use insnav::ahrs::{Ahrs, AhrsSettings, gyro_range};
use insnav::error::Error;
use insnav::sample::{ImuSample, MagneticField};
use insnav::time::Time;
use nalgebra::Vector3;

/// Root mean square of tilt and heading errors over some epochs, degrees.
fn rms(
    record: &Record,
    epochs: &[(usize, insnav::ahrs::AhrsEpoch)],
    from: f64,
    to: f64,
) -> [f64; 2] {
    let errors: Vec<Vector3<f64>> = epochs
        .iter()
        .filter(|(k, _)| (from..to).contains(&(0.01 * *k as f64)))
        .map(|e| error(record, e))
        .collect();
    let mean =
        |f: fn(&Vector3<f64>) -> f64| errors.iter().map(f).sum::<f64>() / errors.len() as f64;
    [mean(|e| e.xy().norm_squared()), mean(|e| e.z * e.z)].map(|m| m.sqrt().to_degrees())
}

#[test]
fn a_gap_begins_anew_and_keeps_what_is_known_of_the_sensors() {
    let whole = record(&Unit::new(5));
    let mut cut = record(&Unit::new(5));
    // In the middle of a block, so that epochs follow the last correction.
    let out = |t: Time| (40.025..45.0).contains(&t.seconds());
    cut.samples.retain(|s| !out(s.time));
    cut.fields.retain(|f| !out(f.time));
    let truth: Vec<_> = whole
        .samples
        .iter()
        .zip(&whole.truth)
        .filter(|(s, _)| !out(s.time))
        .map(|(_, q)| *q)
        .collect();
    cut.truth = truth;
    let estimates = estimate(&cut, AhrsSettings::default(), true);
    let after = |epochs: &[(usize, insnav::ahrs::AhrsEpoch)]| {
        epochs
            .iter()
            .filter(|(_, e)| (46.0..70.0).contains(&e.time.seconds()))
            .map(|e| error(&cut, e).norm())
            .fold(0.0, f64::max)
            .to_degrees()
    };
    // The last epochs before the gap have nothing after them.
    let last = |epochs: &[(usize, insnav::ahrs::AhrsEpoch)]| {
        let before = epochs
            .iter()
            .filter(|(_, e)| (39.9..40.1).contains(&e.time.seconds()));
        before
            .map(|e| error(&cut, e).norm())
            .fold(0.0, f64::max)
            .to_degrees()
    };
    assert!(last(&estimates.smoothed) < last(&estimates.causal) + 0.1);
    // No epoch in the gap or before the new level, then as good as before.
    assert!(
        estimates
            .causal
            .iter()
            .all(|(_, e)| !(40.03..45.25).contains(&e.time.seconds()))
    );
    assert!(
        after(&estimates.causal) < 15.0,
        "{}",
        after(&estimates.causal)
    );
    assert!(
        after(&estimates.smoothed) < 12.0,
        "{}",
        after(&estimates.smoothed)
    );
    let bias = |e: &insnav::ahrs::AhrsEpoch| e.gyro_bias;
    let before = estimates
        .causal
        .iter()
        .rev()
        .find(|(_, e)| e.time.seconds() < 40.0)
        .unwrap();
    let again = estimates
        .causal
        .iter()
        .find(|(_, e)| e.time.seconds() > 45.0)
        .unwrap();
    assert!((bias(&before.1) - bias(&again.1)).norm() < 1e-4);
    let sigmas = [before, again].map(|(_, e)| e.covariance[(2, 2)].sqrt());
    assert!(sigmas[1] > sigmas[0]);
}

/// Fast turns beyond the range: with the range known the tilt comes back, without it it is lost.
#[test]
fn gyros_that_saturate() {
    let mut unit = Unit::new(3);
    unit.turns = 1.2;
    let mut record = record(&unit);
    let range = 2.5;
    for sample in &mut record.samples {
        sample.angular_rate_b = sample.angular_rate_b.map(|r| r.clamp(-range, range));
    }
    assert!((gyro_range(&record.samples).expect("seen") - range).abs() < 1e-12);
    let known = AhrsSettings {
        gyro_range: Some(range),
        ..AhrsSettings::default()
    };
    let with = estimate(&record, known, true);
    let without = estimate(&record, AhrsSettings::default(), true);
    let (a, b) = (
        rms(&record, &with.causal, 12.0, 70.0),
        rms(&record, &without.causal, 12.0, 70.0),
    );
    println!("saturating gyros, tilt and heading: range known {a:.1?}°, not known {b:.1?}°");
    assert!(with.causal.iter().any(|(_, e)| e.saturated));
    assert!(a[0] < 0.5 * b[0], "{a:?} {b:?}");
}

/// A magnet is put on the sensor, then taken off: the heading follows the gyros until it is known as part of the body.
#[test]
fn a_magnet_on_the_body() {
    let mut record = record(&Unit::new(8));
    let magnet = Vector3::new(3.0, -4.0, 8.0);
    for field in &mut record.fields {
        if (25.0..55.0).contains(&field.time.seconds()) {
            field.field_b += magnet;
        }
    }
    let with = estimate(&record, AhrsSettings::default(), true);
    let mut fixed = AhrsSettings::default();
    fixed.field.change_ratio = 1e12;
    let without = estimate(&record, fixed, true);
    let (a, b) = (
        rms(&record, &with.causal, 25.0, 70.0),
        rms(&record, &without.causal, 25.0, 70.0),
    );
    println!("magnet on the body, tilt and heading: change seen {a:.1?}°, not seen {b:.1?}°");
    assert!(a[1] < 6.0 && a[1] < 0.6 * b[1], "{a:?} {b:?}");
}

/// A strong field nearby for ten seconds turns no tilt: 0.3 of the Earth's, in every seed.
#[test]
fn a_magnetic_step_leaves_the_tilt() {
    for seed in 0..12 {
        let clean = record(&Unit::new(seed));
        let mut disturbed = record(&Unit::new(seed));
        for (k, field) in disturbed.fields.iter_mut().enumerate() {
            if (30.0..40.0).contains(&field.time.seconds()) {
                field.field_b += clean.truth[k].conjugate() * Vector3::new(-8.0, 12.0, 5.0);
            }
        }
        let tilt = |r: &Record| {
            rms(
                r,
                &estimate(r, AhrsSettings::default(), true).causal,
                30.0,
                50.0,
            )
        };
        let (a, b) = (tilt(&clean), tilt(&disturbed));
        assert!(b[0] < 1.5 * a[0] + 0.2, "seed {seed}: {a:?} {b:?}");
    }
}

/// Pushes there and back again every three seconds until 30 s, small ones from the first sample on: ten seconds after the last the tilt
/// is as good as without them, in every seed.
#[test]
fn bursts_are_over_in_ten_seconds_in_every_seed() {
    for (size, from) in [(0.3, 0.0), (3.0, 6.0)] {
        let (mut during, mut after) = (0.0_f64, 0.0_f64);
        for seed in 0..20 {
            let quiet = record(&Unit::new(seed));
            let mut pushed = record(&Unit::new(seed));
            for (k, sample) in pushed.samples.iter_mut().enumerate() {
                let t = sample.time.seconds();
                let there = if t % 3.0 < 0.5 { size } else { -size };
                if (from..30.0).contains(&t) && t % 3.0 < 1.0 {
                    let push = Vector3::new((seed as f64).sin(), (seed as f64).cos(), 0.0) * there;
                    sample.specific_force_b += pushed.truth[k].conjugate() * push;
                }
            }
            let with = estimate(&pushed, AhrsSettings::default(), true).causal;
            let without = estimate(&quiet, AhrsSettings::default(), true).causal;
            during = during.max(rms(&pushed, &with, 10.0, 30.0)[0]);
            let late =
                [(&pushed, &with), (&quiet, &without)].map(|(r, e)| rms(r, e, 40.0, 72.0)[0]);
            after = after.max(late[0] / late[1]);
        }
        println!(
            "bursts of {size} m/s²: tilt {during:.2}° at most, ten seconds after {after:.2} of that without"
        );
        assert!(during < 3.0 && after < 1.5, "{during} {after}");
    }
}

/// A magnetometer that comes 20 s late turns the heading to north once.
#[test]
fn a_late_magnetometer() {
    let mut record = record(&Unit::new(2));
    record.fields.retain(|f| f.time.seconds() > 20.0);
    let estimates = estimate(&record, AhrsSettings::default(), true);
    assert!(
        estimates
            .causal
            .iter()
            .all(|(_, e)| e.magnetic == (e.time.seconds() > 20.0))
    );
    for epochs in [&estimates.causal, &estimates.smoothed] {
        assert!(rms(&record, epochs, 40.0, 72.0)[1] < 5.0);
        // Before, heading counts from the begin, and tilt is as always.
        assert!(rms(&record, epochs, 1.0, 19.0)[0] < 2.0);
    }
}

/// Zeros are no field, and a slow unit whose magnetometer comes late has an attitude all the same.
#[test]
fn fields_of_zero_and_slow_samples() {
    let mut zeros = record(&Unit::new(6));
    for field in &mut zeros.fields {
        field.field_b = Vector3::zeros();
    }
    let with = estimate(&zeros, AhrsSettings::default(), true).causal;
    let without = estimate(&zeros, AhrsSettings::default(), false).causal;
    assert_eq!(with, without);

    let mut slow = record(&Unit::new(6));
    let mut k = 0;
    slow.samples.retain(|_| {
        k += 1;
        k % 20 == 0
    });
    slow.samples.truncate(40);
    slow.fields.retain(|f| f.time.seconds() > 5.0);
    let estimates = estimate(&slow, AhrsSettings::default(), true);
    for (_, epoch) in estimates.causal.iter().chain(&estimates.smoothed) {
        assert!(epoch.attitude.coords.iter().all(|x| x.is_finite()));
        assert!(epoch.covariance.cholesky().is_some());
    }
}

/// A magnet on the body that is known stays known through gaps: headings after them are within their sigmas.
#[test]
fn gaps_with_a_magnet_that_is_known() {
    let mut cut = record(&Unit::new(11));
    for field in &mut cut.fields {
        field.field_b += Vector3::new(4.0, -5.0, 9.0);
    }
    let out = |t: Time| t.seconds() > 40.0 && t.seconds() < 70.0 && t.seconds() % 3.0 < 0.9;
    let kept: Vec<usize> = (0..cut.samples.len())
        .filter(|k| !out(cut.samples[*k].time))
        .collect();
    cut.truth = kept.iter().map(|k| cut.truth[*k]).collect();
    cut.samples.retain(|s| !out(s.time));
    cut.fields.retain(|f| !out(f.time));
    let estimates = estimate(&cut, AhrsSettings::default(), true);
    let squares: Vec<f64> = estimates
        .causal
        .windows(2)
        .filter(|w| w[1].1.time.since(w[0].1.time) > 0.5)
        .map(|w| error(&cut, &w[1]).z.powi(2) / w[1].1.covariance[(2, 2)])
        .collect();
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    println!("heading after {} gaps: NEES {mean:.2}", squares.len());
    assert!(squares.len() == 10 && mean < 2.0, "{squares:?}");
}

/// The unit of the field is of no importance: tesla, microtesla, and shares of it give the same attitude.
#[test]
fn any_unit_of_the_field() {
    let attitudes = |unit: f64| {
        let mut record = record(&Unit::new(4));
        for field in &mut record.fields {
            field.field_b *= unit;
        }
        estimate(&record, AhrsSettings::default(), true).smoothed
    };
    let reference = attitudes(1.0);
    for unit in [1e-6, 1.0 / FIELD.norm()] {
        for (a, b) in reference.iter().zip(attitudes(unit)) {
            assert!(a.1.attitude.angle_to(&b.1.attitude) < 1e-6);
        }
    }
}

#[test]
fn bad_samples_are_named_and_change_nothing() {
    let record = record(&Unit::new(1));
    let mut ahrs = Ahrs::new(AhrsSettings::default()).unwrap();
    for (sample, field) in record.samples.iter().zip(&record.fields).take(500) {
        ahrs.field(field).unwrap();
        ahrs.step(sample).unwrap();
    }
    let before = format!("{ahrs:?}");
    let last = record.samples[499];
    let nan = ImuSample {
        angular_rate_b: Vector3::new(f64::NAN, 0.0, 0.0),
        time: last.time.plus(0.01),
        ..last
    };
    assert!(matches!(
        ahrs.step(&nan),
        Err(Error::NotFinite {
            what: "angular rate",
            ..
        })
    ));
    assert!(matches!(ahrs.step(&last), Err(Error::ImuBackward { .. })));
    let infinite = MagneticField {
        time: last.time,
        field_b: Vector3::repeat(f64::INFINITY),
    };
    assert!(matches!(
        ahrs.field(&infinite),
        Err(Error::NotFinite { .. })
    ));
    assert_eq!(before, format!("{ahrs:?}"));
    let mut wrong = AhrsSettings::default();
    wrong.field.sigma = -1.0;
    assert!(matches!(
        Ahrs::new(wrong),
        Err(Error::Config {
            key: "ahrs.field.sigma",
            ..
        })
    ));
}
