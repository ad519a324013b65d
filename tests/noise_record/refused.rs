//! Records that are refused, with the place or the axis.

use crate::simulated::{Motion, Unit, record};
use insnav::imu::ImuGrade;
use insnav::noise::{IdentifyOptions, NoiseReading, Refusal, identify_noise, rest_stability};
use insnav::time::Time;

fn readings() -> Vec<NoiseReading> {
    record(&Unit::adis(), Motion::Rest, None, 60.0, 1)
}

fn refused(readings: &[NoiseReading]) -> Refusal {
    let options = IdentifyOptions::new(ImuGrade::Consumer.noise());
    identify_noise(readings, &options).expect_err("refused")
}

#[test]
fn uneven_stamps() {
    let mut uneven = readings();
    for (i, r) in uneven.iter_mut().enumerate() {
        if i >= 500 && i % 4 == 0 {
            r.time = r.time.plus(0.015);
        }
    }
    let Refusal::UnevenSteps { at_s, step_s, .. } = refused(&uneven) else {
        panic!("even");
    };
    assert!((at_s - (500.0 * 0.032 + 0.015)).abs() < 1e-6, "{at_s}");
    assert!((step_s - 0.032).abs() < 1e-6, "{step_s}");
    assert!(rest_stability(&uneven).is_err());
    // Jitter of a tenth of a step is none.
    let mut jitter = readings();
    for (i, r) in jitter.iter_mut().enumerate() {
        r.time = r.time.plus(0.003 * f64::from(u8::from(i % 2 == 0)));
    }
    let options = IdentifyOptions::new(ImuGrade::Consumer.noise());
    assert!(identify_noise(&jitter, &options).is_ok());
}

#[test]
fn axes_by_name() {
    let of = |change: &dyn Fn(usize, &mut NoiseReading)| {
        let mut changed = readings();
        changed
            .iter_mut()
            .enumerate()
            .for_each(|(i, r)| change(i, r));
        match refused(&changed) {
            Refusal::Axis { axis, why } => (axis, *why),
            other => panic!("{other:?}"),
        }
    };
    let (axis, why) = of(&|_, r| r.specific_force_b.y = 0.1);
    assert!(axis == "accelerometer y" && matches!(why, Refusal::Flat { .. }));
    // Steps of four times the noise: nearly every value is the same.
    let (axis, why) = of(&|_, r| {
        let step = 4.0 * 5.8e-4 / 0.032f64.sqrt();
        r.angular_rate_b.z = ((r.angular_rate_b.z - 4e-3) / step).round() * step;
    });
    assert_eq!(axis, "gyro z");
    assert!(
        matches!(why, Refusal::Repeats { .. } | Refusal::Flat { .. }),
        "{why:?}"
    );
    let (axis, why) = of(&|_, r| r.angular_rate_b.x = r.angular_rate_b.x.min(8e-3));
    assert!(
        axis == "gyro x" && matches!(why, Refusal::Saturated { .. }),
        "{why:?}"
    );
    let (axis, why) = of(&|i, r| {
        if i == 700 {
            r.specific_force_b.z = f64::NAN;
        }
    });
    assert!(axis == "accelerometer z" && matches!(why, Refusal::NotFinite { .. }));
}

#[test]
fn too_little() {
    assert!(matches!(refused(&readings()[..40]), Refusal::Shape { .. }));
    assert!(matches!(refused(&readings()[..1]), Refusal::Setting { .. }));
    let mut same = readings();
    same.iter_mut().for_each(|r| r.time = Time(0));
    assert!(matches!(refused(&same), Refusal::Setting { .. }));
    let options = IdentifyOptions {
        window_s: Some(1.0),
        ..IdentifyOptions::new(ImuGrade::Consumer.noise())
    };
    assert!(matches!(
        identify_noise(&readings(), &options),
        Err(Refusal::Setting { .. })
    ));
}

/// A magnetometer that is switched off does not keep the rest from being told.
#[test]
fn a_flat_magnetometer_is_told_and_nothing_else_suffers() {
    let mut flat = readings();
    flat.iter_mut().for_each(|r| {
        if let Some(field) = &mut r.magnetic_field_b {
            field.z = 1e-5;
        }
    });
    let options = IdentifyOptions::new(ImuGrade::Consumer.noise());
    let noise = identify_noise(&flat, &options).expect("gyros and accelerometers are good");
    let heading = noise.heading.expect("it was there");
    assert!(!heading.magnetometer.accepted, "{heading:?}");
    assert!(
        heading.magnetometer.reason.contains("magnetometer z"),
        "{heading:?}"
    );
    assert!(noise.tilt.accel_white.accepted);
}
