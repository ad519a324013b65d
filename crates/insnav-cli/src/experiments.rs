//! The published experiments of `insnav reproduce` for other programs: the JSON that the command prints.

use crate::command::{belokurov2018, kozadaev2017, lobusov2014};
use crate::reproduce::Reproduced;
use insnav_log::Problem;
use std::path::Path;

/// Which experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paper {
    /// Noise of an attitude filter from its own innovations.
    Belokurov2018,
    /// What a filter makes of a stop.
    Kozadaev2017 {
        /// Four stops with drives between them.
        multi_stop: bool,
    },
    /// Drifts and azimuth from stops.
    Lobusov2014 {
        /// The drive between them in place of the stops alone.
        drive: bool,
    },
}

/// How much of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Order<'a> {
    /// Number of runs, 2 to 1 000 000; `None`: as many as the command makes.
    pub runs: Option<u32>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// A record of a real unit at rest, in place of or beside the simulated one; not for every experiment.
    pub imu: Option<&'a Path>,
    /// Number of threads; `None`: as many as there are cores. It changes nothing but the time.
    pub jobs: Option<u16>,
}

/// Make an experiment; the table as JSON, that of `insnav reproduce PAPER --format json`.
pub fn reproduce(paper: Paper, order: Order<'_>) -> Result<String, Problem> {
    let wrong = |message: &str| Problem::new("usage", message, "see `insnav reproduce --help`");
    if order
        .runs
        .is_some_and(|runs| !(2..=1_000_000).contains(&runs))
    {
        return Err(wrong("runs: at least 2 and at most 1000000 can be made"));
    }
    if order.jobs == Some(0) {
        return Err(wrong("jobs: at least one thread is needed"));
    }
    let report: Reproduced = match paper {
        Paper::Belokurov2018 => belokurov2018(order),
        Paper::Kozadaev2017 { multi_stop } if multi_stop && order.imu.is_some() => {
            return Err(wrong("imu: a unit at rest does not drive between stops"));
        }
        Paper::Kozadaev2017 { multi_stop } => kozadaev2017(order, multi_stop),
        Paper::Lobusov2014 { .. } if order.imu.is_some() => {
            return Err(wrong("imu: this experiment is simulated throughout"));
        }
        Paper::Lobusov2014 { drive } => lobusov2014(order, drive),
    }
    .map_err(|failure| failure.problem)?;
    serde_json::to_string(&report).map_err(|e| wrong(&e.to_string()))
}
