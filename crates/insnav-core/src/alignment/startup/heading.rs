//! The sources of a heading for a start with GNSS.

use super::{Fixes, GIVEN_SIGMA, Startup, UNKNOWN_SIGMA};
use crate::alignment::HeadingSource;
use crate::alignment::course::{self, Course, Tilt};
use crate::alignment::track::Track;

impl Startup {
    pub(super) fn heading(&self, fixes: Option<usize>, track: &Track, tilt: &Tilt) -> Course {
        let other = |heading, sigma, source| Course {
            heading,
            sigma,
            at: tilt.begin,
            source,
            reversing: false,
        };
        if let Some(heading) = self.settings.heading_deg {
            let sigma = self
                .settings
                .heading_sigma_deg
                .map_or(GIVEN_SIGMA, f64::to_radians);
            return other(heading.to_radians(), sigma, HeadingSource::Given);
        }
        let found = fixes.and_then(|count| match self.fixes() {
            Fixes::Velocities(all) => course::by_velocity(&all[..count], track, tilt),
            Fixes::Positions(all) => course::by_position(&all[..count], track),
        });
        found.unwrap_or_else(|| other(0.0, UNKNOWN_SIGMA, HeadingSource::Unknown))
    }
}
