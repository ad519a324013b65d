//! Offsets between clocks, found in the data: IMU against GNSS position, and GNSS velocity against GNSS position.
//!
//! Logs commonly carry 0.05 to 0.4 s of them, which matters more than any choice of filter: at 15 m/s, 0.1 s is 1.5 m.
//! The first two estimators need neither an alignment nor a configuration, and look at the whole log rather than running with
//! it; the third, the sharpest where there are velocities, is the navigator itself.
//! They take an offset as constant: a clock that drifts by more than the sigma over the log is told by nothing here.

mod by_filter;
mod gnss_track;
mod imu_offset;
mod preintegration;
mod velocity_lag;
mod window;

pub use by_filter::estimate as imu_offset_by_filter;
pub use imu_offset::estimate as imu_offset;
pub use velocity_lag::estimate as velocity_lag;

use serde::{Deserialize, Serialize};

/// An offset between two clocks, s, with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClockOffset {
    /// The offset, s; which clock is late is stated by the function that returns it.
    pub value: f64,
    /// Standard deviation, s, from the scatter of the data themselves (noise levels are not assumed).
    pub sigma: f64,
    /// Number of stretches of the log that took part.
    pub stretches: usize,
}

/// Where to look for an offset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Search {
    /// Largest offset looked for, to either side, s.
    pub range: f64,
}

impl Default for Search {
    fn default() -> Self {
        // Beyond half a second a log has a wrong clock source, which wants naming rather than compensating.
        Search { range: 0.5 }
    }
}

impl Search {
    /// Sigma of knowing nothing but the range, s.
    fn uniform_sigma(&self) -> f64 {
        self.range / 3f64.sqrt()
    }
}

/// Median of the values, which are reordered; 0 when there are none.
fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
