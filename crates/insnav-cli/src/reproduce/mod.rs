//! Published experiments, made again: one file a paper.

mod belokurov2018;
mod figure;
mod kozadaev2017;
mod lobusov2014;
mod navigation_drive;
mod spread;

pub(crate) use belokurov2018::{AttitudeExperiment, AttitudeRequest, SLICE_S};
pub(crate) use kozadaev2017::{Experiment, Request};
pub(crate) use lobusov2014::{DriftExperiment, DriftRequest};
pub(crate) use navigation_drive::DriveExperiment;

use serde::Serialize;

/// What came out, beside what was published.
#[derive(Debug, Serialize)]
pub(crate) struct Reproduced {
    pub(crate) paper: &'static str,
    pub(crate) runs: usize,
    /// So many of them share no inertial sample: standard errors are those of so few.
    pub(crate) independent_runs: usize,
    pub(crate) seed: u64,
    /// What a reader must know of the experiment beyond the paper.
    pub(crate) assumptions: Vec<String>,
    pub(crate) rows: Vec<Row>,
}

/// One number.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) case: &'static str,
    pub(crate) variant: &'static str,
    pub(crate) quantity: &'static str,
    /// By the paper; `None` where it says nothing.
    pub(crate) published: Option<f64>,
    /// `None` where the number has no meaning.
    pub(crate) ours: Option<f64>,
    /// Of ours, over repetitions of the whole experiment with other seeds; `None` where one run is independent.
    pub(crate) standard_error: Option<f64>,
    /// What the filter itself states of this error, root mean square over the runs.
    pub(crate) stated: Option<f64>,
    /// No linear estimate from the same data is better than this, and none at all were all errors Gaussian (Cramér–Rao); `None` where
    /// it is not known.
    pub(crate) limit: Option<f64>,
    pub(crate) note: Option<String>,
}
