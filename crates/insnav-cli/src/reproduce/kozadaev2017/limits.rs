//! The least errors that the data allow.

use super::{Case, Experiment, finite, variants};
use insnav_core::metrics::Estimate;
use insnav_core::sim::{StopErrors, StopVariant};

/// The least errors that the data allow: standard deviations that the filter with states for all that is correlated states.
/// One stop of the simulated unit is a linear problem whose covariances that filter knows, so that these are the least of any
/// linear estimate. Nowhere else: under way nothing estimates the correlated error of velocities, and of a real unit nobody knows
/// the covariances.
#[derive(Clone, Copy)]
pub(super) struct Limits {
    pub(super) horizontal: Option<f64>,
    pub(super) height: Option<f64>,
    pub(super) roll_pitch: Option<f64>,
    pub(super) heading: Option<f64>,
}

impl Limits {
    pub(super) fn of(experiment: &Experiment) -> Self {
        let index = variants().position(|v| v == StopVariant::StaticColouredGnss);
        let index = index.filter(|_| experiment.case == Case::Stop);
        let root = |of: &dyn Fn(&StopErrors) -> f64| {
            let all: Vec<f64> = experiment.of(index?).map(of).collect();
            finite(Estimate::root_mean_square(&all).value)
        };
        let deg = 1f64.to_degrees();
        Limits {
            horizontal: root(&|e| e.standing_stated.horizontal),
            height: root(&|e| e.standing_stated.height),
            roll_pitch: root(&|e| e.standing_stated.roll_pitch * deg * deg),
            heading: root(&|e| (e.ends[0].heading_sigma * deg).powi(2)),
        }
    }

    /// What a scaled receiver shows over the whole run is fixed by the scaling: its positions have another limit. Tilt and heading
    /// of a body that stands have nothing to do with a receiver.
    pub(super) fn of_variant(self, variant: StopVariant) -> Self {
        if !variant.receiver_is_scaled() {
            return self;
        }
        Limits {
            horizontal: None,
            height: None,
            ..self
        }
    }
}
