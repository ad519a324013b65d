//! The stamps and axes of a record: pieces at equal steps, channels that show their noise.

use super::NoiseReading;
use crate::noise::Refusal;
use crate::noise::lag_covariance::screen;
use nalgebra::Vector3;
use std::boxed::Box;
use std::ops::Range;
use std::vec::Vec;

/// A step this much longer than the usual one is a gap.
const GAP: f64 = 1.5;
/// Steps off by more than this share of the usual one are no jitter, and of these there may be this share.
const JITTER: f64 = 0.25;
const MOST_UNEVEN: f64 = 0.05;
/// A channel that repeats itself this often is coarser than its noise (less than a quarter of a step), or comes at a lower rate.
const MOST_REPEATED: f64 = 0.9;

pub(super) const GYRO_AXES: [&str; 3] = ["gyro x", "gyro y", "gyro z"];
pub(super) const MAGNETIC_AXES: [&str; 3] = ["magnetometer x", "magnetometer y", "magnetometer z"];
pub(super) const ACCEL_AXES: [&str; 3] = ["accelerometer x", "accelerometer y", "accelerometer z"];

/// The usual step and the pieces of a record between its gaps.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Steps {
    pub(super) step_s: f64,
    pub(super) pieces: Vec<Range<usize>>,
}

/// Find them; uneven stamps are refused with the first place.
pub(super) fn steps(record: &[NoiseReading]) -> Result<Steps, Refusal> {
    let mut sorted: Vec<f64> = record
        .windows(2)
        .map(|pair| pair[1].time.since(pair[0].time))
        .collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let step_s = sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN);
    if step_s <= 0.0 || step_s.is_nan() {
        return Err(Refusal::Setting {
            what: "usual step between samples, s",
            value: step_s,
            expected: "positive: at least two samples in the order of time",
        });
    }
    let mut pieces = Vec::new();
    let mut begin = 0;
    let mut uneven = 0;
    let mut first = None;
    for (i, pair) in record.windows(2).enumerate() {
        let step = pair[1].time.since(pair[0].time);
        if step > GAP * step_s || step <= 0.0 {
            pieces.push(begin..i + 1);
            begin = i + 1;
        }
        if (step - step_s).abs() > JITTER * step_s {
            uneven += 1;
            first.get_or_insert((pair[1].time.seconds(), step));
        }
    }
    pieces.push(begin..record.len());
    let share = uneven as f64 / (record.len() - 1) as f64;
    match first {
        Some((at_s, found_s)) if share > MOST_UNEVEN => Err(Refusal::UnevenSteps {
            at_s,
            found_s,
            step_s,
            percent: 100.0 * share,
        }),
        _ => Ok(Steps { step_s, pieces }),
    }
}

/// Refuse axes that do not show their noise, by name.
pub(super) fn screen_axes(
    record: &[NoiseReading],
    of: impl Fn(&NoiseReading) -> Vector3<f64>,
    names: [&'static str; 3],
) -> Result<(), Refusal> {
    let series: Vec<Vector3<f64>> = record.iter().map(of).collect();
    screen_series(&series, names)
}

/// The same of vectors.
pub(super) fn screen_series(
    series: &[Vector3<f64>],
    names: [&'static str; 3],
) -> Result<(), Refusal> {
    for (k, axis) in names.into_iter().enumerate() {
        let values: Vec<f64> = series.iter().map(|v| v[k]).collect();
        let named = |why: Refusal| Refusal::Axis {
            axis,
            why: Box::new(why),
        };
        if values.iter().any(|v| !v.is_finite()) {
            return Err(named(Refusal::NotFinite { what: "record" }));
        }
        screen(&[&values], 1).map_err(named)?;
        let repeats = values.windows(2).filter(|pair| pair[0] == pair[1]).count();
        if values.len() > 20 && repeats as f64 > MOST_REPEATED * values.len() as f64 {
            return Err(named(Refusal::Repeats {
                percent: 100.0 * repeats as f64 / (values.len() - 1) as f64,
            }));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Time;

    fn at(times: impl IntoIterator<Item = f64>) -> Vec<NoiseReading> {
        times
            .into_iter()
            .map(|t| NoiseReading {
                time: Time::from_seconds(t),
                angular_rate_b: Vector3::zeros(),
                specific_force_b: Vector3::zeros(),
                magnetic_field_b: None,
            })
            .collect()
    }

    #[test]
    fn a_gap_splits_and_jitter_does_not() {
        let record = at((0..100).map(|i| {
            let jitter = if i % 2 == 0 { 0.0 } else { 1e-3 };
            0.01 * f64::from(i) + jitter + if i < 40 { 0.0 } else { 5.0 }
        }));
        let found = steps(&record).expect("jitter only");
        assert_eq!(found.pieces, [0..40, 40..100]);
        assert!((found.step_s - 0.01).abs() < 1.1e-3);
    }

    #[test]
    fn uneven_stamps_are_named() {
        let record =
            at((0..100).map(|i| 0.01 * f64::from(i) + if i % 10 == 7 { 4e-3 } else { 0.0 }));
        let Err(Refusal::UnevenSteps { at_s, percent, .. }) = steps(&record) else {
            panic!("even");
        };
        assert!((at_s - 0.074).abs() < 1e-9 && (percent - 20.2).abs() < 0.1);
        assert!(steps(&at([1.0])).is_err());
    }

    #[test]
    fn axes_without_noise_are_named() {
        let mut record = at((0..200).map(f64::from));
        let noisy = |i: usize| Vector3::from_fn(|k, _| ((i * (k + 3)) as f64 * 1.3).sin());
        for (i, r) in record.iter_mut().enumerate() {
            r.angular_rate_b = noisy(i);
            r.specific_force_b = noisy(i * i);
        }
        let gyro = |r: &NoiseReading| r.angular_rate_b;
        assert_eq!(screen_axes(&record, gyro, GYRO_AXES), Ok(()));
        let named = |record: &[NoiseReading]| match screen_axes(record, gyro, GYRO_AXES) {
            Err(Refusal::Axis { axis, why }) => (axis, *why),
            other => panic!("{other:?}"),
        };
        let mut flat = record.clone();
        flat.iter_mut().for_each(|r| r.angular_rate_b.y = 0.2);
        assert!(matches!(
            named(&flat),
            ("gyro y", Refusal::Flat { distinct: 1, .. })
        ));
        // A step so coarse that one sample in fifty is not the usual one.
        let mut coarse = record.clone();
        for (i, r) in coarse.iter_mut().enumerate() {
            r.angular_rate_b.z = match i % 50 {
                10 => 0.1,
                30 => -0.1,
                _ => 0.0,
            };
        }
        assert!(matches!(
            named(&coarse),
            ("gyro z", Refusal::Repeats { .. })
        ));
        let mut cut = record.clone();
        cut.iter_mut()
            .for_each(|r| r.angular_rate_b.x = r.angular_rate_b.x.min(0.8));
        assert!(matches!(named(&cut), ("gyro x", Refusal::Saturated { .. })));
    }
}
