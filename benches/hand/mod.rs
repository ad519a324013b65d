//! A unit in a hand: what the benches of the orientation filter work on.

use insnav::ahrs::{Ahrs, AhrsSettings, smooth};
use insnav::attitude::exp;
use insnav::sample::{ImuSample, MagneticField};
use insnav::sim::{Source, Stream};
use insnav::time::Time;
use nalgebra::{UnitQuaternion, Vector3};

/// Length of a step, s: that of the BROAD recordings.
const STEP: f64 = 0.0035;

/// So many seconds of turning about all axes, with noise, and a field at every sample.
pub(crate) fn record(seconds: f64) -> (Vec<ImuSample>, Vec<MagneticField>) {
    let mut noise = Source::new(1, Stream::GyroWhite);
    let mut vector =
        |sigma: f64| Vector3::new(noise.normal(), noise.normal(), noise.normal()) * sigma;
    let mut attitude = UnitQuaternion::identity();
    (0..(seconds / STEP) as i64)
        .map(|i| {
            let t = i as f64 * STEP;
            let rate = Vector3::new(
                1.5 * (2.1 * t).sin(),
                -(1.3 * t).cos(),
                2.0 * (0.9 * t).sin(),
            );
            attitude *= exp(&(rate * STEP));
            let time = Time::from_seconds(t);
            let sample = ImuSample {
                time,
                angular_rate_b: rate + vector(3e-3),
                specific_force_b: attitude.inverse() * Vector3::new(0.0, 0.0, -9.81) + vector(0.05),
            };
            let field = MagneticField {
                time,
                field_b: attitude.inverse() * Vector3::new(18e-6, 0.0, 45e-6) + vector(0.7e-6),
            };
            (sample, field)
        })
        .unzip()
}

/// The filter over a record; what comes out in the end.
pub(crate) fn filtered(samples: &[ImuSample], fields: &[MagneticField]) -> f64 {
    let mut filter = Ahrs::new(AhrsSettings::default()).expect("defaults are in their ranges");
    let mut sum = 0.0;
    for (i, sample) in samples.iter().enumerate() {
        if let Some(field) = fields.get(i) {
            filter.field(field).expect("finite");
        }
        if let Some(epoch) = filter.step(sample).expect("in order of time") {
            sum += epoch.attitude.w;
        }
    }
    sum
}

/// As [`filtered`], from both ends.
#[allow(dead_code)] // Not every bench needs it.
pub(crate) fn smoothed(samples: &[ImuSample], fields: &[MagneticField]) -> f64 {
    smooth(samples, fields, AhrsSettings::default())
        .expect("in order of time")
        .iter()
        .map(|epoch| epoch.attitude.w)
        .sum()
}
