//! The inertial samples of a source as readings for the identification of noise.

use super::RunError;
use super::source::Source;
use insnav_core::noise::NoiseReading;
use insnav_core::sample::{MagneticField, Sample};
use insnav_core::time::Time;

/// A record and what was not usable of it.
#[derive(Clone, Debug, Default)]
pub struct NoiseReadings {
    /// Inertial samples with the magnetic fields nearest to them, stamped from `origin` on.
    pub readings: Vec<NoiseReading>,
    /// Samples that are not finite, or whose stamps do not advance.
    pub dropped: usize,
    /// Fields that belong to no sample.
    pub fields_dropped: usize,
}

/// Read rates, forces and fields from `from_s` to `to_s` after `origin`. Increments are turned into rates over their intervals.
///
/// # Errors
/// Those of the source.
pub fn noise_readings(
    source: &(impl Source + ?Sized),
    origin: Time,
    span: Option<[f64; 2]>,
) -> Result<NoiseReadings, RunError> {
    let [from, to] = span.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
    let mut found = NoiseReadings::default();
    let mut fields: Vec<MagneticField> = Vec::new();
    let mut last: Option<Time> = None;
    for sample in source.samples()? {
        let sample = sample?;
        if let Sample::Magnetic(field) = sample {
            if field.field_b.iter().all(|v| v.is_finite()) {
                fields.push(field);
            } else {
                found.fields_dropped += 1;
            }
            continue;
        }
        if !sample.is_inertial() {
            continue;
        }
        let time = Time(sample.time().0 - origin.0);
        let step = last.map(|last| time.since(last));
        if sample.check().is_err() || step.is_some_and(|step| step <= 0.0) {
            found.dropped += usize::from((from..=to).contains(&time.seconds()));
            continue;
        }
        last = Some(time);
        let (angular_rate_b, specific_force_b) = match sample {
            Sample::Imu(s) => (s.angular_rate_b, s.specific_force_b),
            // The first one's interval is not known.
            Sample::ImuIncrement(s) => match step {
                Some(step) => (s.angle_b / step, s.velocity_b / step),
                None => continue,
            },
            _ => continue,
        };
        if (from..=to).contains(&time.seconds()) {
            found.readings.push(NoiseReading {
                time,
                angular_rate_b,
                specific_force_b,
                magnetic_field_b: None,
            });
        }
    }
    attach(&mut found, &fields, origin);
    Ok(found)
}

/// Each field to the sample nearest in time, if it is no further than the next one.
fn attach(found: &mut NoiseReadings, fields: &[MagneticField], origin: Time) {
    let readings = &mut found.readings;
    for field in fields {
        let time = Time(field.time.0 - origin.0);
        let after = readings.partition_point(|r| r.time < time);
        let nearest = [after.checked_sub(1), Some(after)]
            .into_iter()
            .flatten()
            .filter(|i| *i < readings.len())
            .min_by_key(|i| (readings[*i].time.0 - time.0).abs());
        let Some(i) = nearest else { continue };
        let step = match readings.get(i + 1) {
            Some(next) => next.time.since(readings[i].time),
            None if i > 0 => readings[i].time.since(readings[i - 1].time),
            None => 0.0,
        };
        let reading = &mut readings[i];
        if reading.magnetic_field_b.is_none() && time.since(reading.time).abs() <= step {
            reading.magnetic_field_b = Some(field.field_b);
        } else {
            found.fields_dropped += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::sample::{ImuIncrement, ImuSample};
    use nalgebra::Vector3;

    fn imu(t: f64, rate: f64) -> Sample {
        Sample::Imu(ImuSample {
            time: Time::from_seconds(100.0 + t),
            angular_rate_b: Vector3::repeat(rate),
            specific_force_b: Vector3::z(),
        })
    }

    fn field(t: f64) -> Sample {
        Sample::Magnetic(MagneticField {
            time: Time::from_seconds(100.0 + t),
            field_b: Vector3::repeat(t),
        })
    }

    #[test]
    fn fields_go_to_the_nearest_sample_and_bad_ones_are_counted() {
        let source = vec![
            imu(0.0, 1.0),
            field(0.004),
            imu(0.01, f64::NAN),
            imu(0.01, 2.0),
            field(0.012),
            imu(0.01, 3.0),
            imu(0.02, 4.0),
            field(5.0),
        ];
        let found = noise_readings(&source, Time::from_seconds(100.0), None).expect("reads");
        let rates: Vec<f64> = found.readings.iter().map(|r| r.angular_rate_b.x).collect();
        assert_eq!((rates, found.dropped), (vec![1.0, 2.0, 4.0], 2));
        let fields: Vec<Option<f64>> = found
            .readings
            .iter()
            .map(|r| r.magnetic_field_b.map(|f| f.x))
            .collect();
        assert_eq!(fields, [Some(0.004), Some(0.012), None]);
        assert_eq!(found.fields_dropped, 1);
    }

    #[test]
    fn increments_are_rates_and_spans_are_kept() {
        let source: Vec<Sample> = (0..5)
            .map(|i| {
                Sample::ImuIncrement(ImuIncrement {
                    time: Time::from_seconds(0.5 * f64::from(i)),
                    angle_b: Vector3::repeat(0.1),
                    velocity_b: Vector3::repeat(5.0),
                })
            })
            .collect();
        let found = noise_readings(&source, Time(0), Some([0.9, 1.6])).expect("reads");
        assert_eq!(found.readings.len(), 2);
        assert_eq!(found.readings[0].angular_rate_b.x, 0.2);
        assert_eq!(found.readings[0].specific_force_b.y, 10.0);
    }
}
