//! What speaks for a stop.

use serde::{Deserialize, Serialize};

/// Who says that the body stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Witness {
    /// Nobody: it moves.
    #[default]
    Nobody,
    /// The detector, from the inertial data and whatever speed was heard.
    Detector,
    /// A sample that says so.
    Declared,
    /// An interval of the settings.
    Interval,
}

/// The detector's statistics, each over its threshold: all below 1 speak for a stop. NaN where there is nothing to judge.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Evidence {
    /// Who says so.
    pub witness: Witness,
    /// Of the specific force.
    #[serde(rename = "specific_force_ratio")]
    pub specific_force: f64,
    /// Of the angular rate's variation.
    #[serde(rename = "angular_rate_ratio")]
    pub angular_rate: f64,
    /// Of the mean angular rate against the gyro bias.
    #[serde(rename = "mean_rate_ratio")]
    pub mean_rate: f64,
    /// Of the speed that GNSS or wheels tell, or of the filter's own where nobody does.
    #[serde(rename = "speed_ratio")]
    pub speed: f64,
}

impl Default for Evidence {
    fn default() -> Self {
        Evidence {
            witness: Witness::Nobody,
            specific_force: f64::NAN,
            angular_rate: f64::NAN,
            mean_rate: f64::NAN,
            speed: f64::NAN,
        }
    }
}

impl Evidence {
    /// Whether everything that can be judged speaks for a stop.
    pub fn agrees(&self) -> bool {
        let ratios = [
            self.specific_force,
            self.angular_rate,
            self.mean_rate,
            self.speed,
        ];
        ratios.iter().any(|ratio| ratio.is_finite())
            && ratios.iter().all(|ratio| ratio.is_nan() || *ratio < 1.0)
    }
}

/// Nothing to judge is the same as nothing to judge.
impl PartialEq for Evidence {
    fn eq(&self, other: &Self) -> bool {
        let bits = |e: &Evidence| {
            [e.specific_force, e.angular_rate, e.mean_rate, e.speed].map(f64::to_bits)
        };
        self.witness == other.witness && bits(self) == bits(other)
    }
}
