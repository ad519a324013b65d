//! Is a record one of a unit that stood still, and one record at all?

use super::record::StaticRecord;
use crate::sample::Sample;
use nalgebra::Vector3;

/// Length of the means by which a turn is seen, s.
const STRETCH_S: f64 = 10.0;
/// The mean rate of a unit at rest changes less from stretch to stretch, rad/s: 0.1 °/s, where the bias of a phone's gyro
/// changes by a hundredth of it in 10 s, and a vehicle that drives turns by degrees a second.
const MOST_CHANGE: f64 = 0.1 * core::f64::consts::PI / 180.0;
/// Neighbouring samples of one record are closer, s: after more a run begins anew.
const MOST_LEAP: f64 = 5.0;

/// Where a record that should be of a unit at rest turned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    /// Since the first inertial sample, s: where the stretch begins whose mean rate is another.
    pub after_s: f64,
    /// Change of the mean rate from one stretch to the next, rad/s.
    pub rate_change: f64,
}

/// Where the stamps of a record are not those of one stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leap {
    /// Since the first inertial sample, s: the last stamp before it.
    pub after_s: f64,
    /// From that stamp to the next, s; negative where they run backward.
    pub by_s: f64,
}

impl StaticRecord {
    /// The first place at which the stamps leap by more than 5 s, or run backward.
    pub fn leap(samples: &[Sample]) -> Option<Leap> {
        let mut stamps = samples.iter().filter(|s| s.is_inertial()).map(Sample::time);
        let first = stamps.next()?;
        let mut last = first;
        stamps.find_map(|stamp| {
            let by_s = stamp.since(core::mem::replace(&mut last, stamp));
            (!(0.0..=MOST_LEAP).contains(&by_s)).then(|| Leap {
                after_s: stamp.since(first) - by_s,
                by_s,
            })
        })
    }

    /// The first change of the mean rate between neighbouring stretches of 10 s that is larger than a unit at rest can have.
    /// Increments and aiding samples are passed over.
    pub fn turning(samples: &[Sample]) -> Option<Turning> {
        let rates = samples.iter().filter_map(|sample| match sample {
            Sample::Imu(s) => Some((s.time, s.angular_rate_b)),
            _ => None,
        });
        let mut first = None;
        let mut sums: Vec<(usize, Vector3<f64>, f64)> = Vec::new();
        for (time, rate) in rates {
            let since = time.since(*first.get_or_insert(time));
            let stretch = (since / STRETCH_S) as usize;
            match sums.last_mut() {
                Some(last) if last.0 == stretch => {
                    last.1 += rate;
                    last.2 += 1.0;
                }
                _ => sums.push((stretch, rate, 1.0)),
            }
        }
        // Of a stretch that is not whole the mean has more noise.
        let whole = sums.iter().map(|s| s.2).fold(0.0, f64::max);
        sums.retain(|s| s.2 > 0.5 * whole);
        sums.windows(2).find_map(|pair| {
            let rate_change = (pair[1].1 / pair[1].2 - pair[0].1 / pair[0].2).norm();
            (rate_change > MOST_CHANGE).then(|| Turning {
                after_s: pair[1].0 as f64 * STRETCH_S,
                rate_change,
            })
        })
    }
}
