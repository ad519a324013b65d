//! Heading from two antennas, carried back to the first sample by the gyros.

use super::HeadingSource;
use super::course::{Course, Tilt};
use super::track::Track;
use crate::attitude::wrap_angle;
use crate::sample::Heading;

/// A heading worse than this is none to begin with, rad (10°).
const LARGEST_SIGMA: f64 = 0.17;
/// Two headings agree within so many standard deviations of their difference, and this besides, rad (1°): what flexing of the
/// mast and scale factors of the gyros add in a turn.
const AGREE: f64 = 3.0;
const SLACK: f64 = 0.017;

/// The heading at the first sample by the first heading from outside that the next one confirms: a wrong ambiguity of the
/// carrier phases gives headings that are off by tens of degrees, each for itself.
pub(super) fn by_antenna(headings: &[Heading], track: &Track, tilt: &Tilt) -> Option<Course> {
    let back = |h: &Heading| Some(wrap_angle(h.heading - track.at(h.time)?.turn));
    let mut good = headings.iter().filter(|h| h.sigma <= LARGEST_SIGMA);
    let mut first = good.next()?;
    for next in good {
        let apart = tilt.rate_sigma * next.time.since(first.time).abs();
        let sigma = first.sigma.hypot(next.sigma).hypot(apart);
        if let (Some(a), Some(b)) = (back(first), back(next))
            && wrap_angle(a - b).abs() <= AGREE * sigma + SLACK
        {
            return Some(Course {
                heading: a,
                sigma: first.sigma,
                at: first.time,
                source: HeadingSource::Antenna,
                reversing: false,
            });
        }
        first = next;
    }
    None
}
