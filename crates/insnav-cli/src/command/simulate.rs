//! `insnav simulate`: a log of a vehicle that never drove, and what really was.

use super::run_inputs::not_the_input;
use crate::failure::Failure;
use crate::output::Output;
use crate::progress::Progress;
use crate::text;
use clap::Args;
use insnav_core::imu::ImuGrade;
use insnav_core::sample::Sample;
use insnav_core::sim::{GnssModel, Scenario, Simulation};
use insnav_log::csv::write_truth;
use insnav_log::{
    SCENARIO_EXAMPLE, ScenarioFile, check_output, is_standard_stream, simulated_truth,
    write_simulated,
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Simulate a drive: a log of an IMU and a GNSS receiver with their errors, and the truth
///
/// A scenario is TOML: a start, a route of legs (straights, turns, slopes, stops), the errors of IMU and receiver. Start with
/// `insnav simulate --example > drive.toml`. The same scenario and seed give the same log.
#[derive(Args, Debug)]
pub(crate) struct Simulate {
    /// The scenario, TOML
    #[arg(value_name = "SCENARIO", required_unless_present = "example")]
    scenario: Option<PathBuf>,

    /// Where to write the log
    #[arg(short, long, value_name = "LOG", required_unless_present = "example")]
    output: Option<PathBuf>,

    /// Where to write the truth as CSV, gzip if it ends in .gz; on the clock of GNSS positions, as solutions are
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,

    /// Seed of all random numbers [default: that of the scenario, else 1]
    #[arg(long, value_name = "N")]
    seed: Option<u64>,

    /// Class of the IMU, in place of the scenario's
    #[arg(long, value_name = "GRADE", value_parser = grade)]
    imu_grade: Option<ImuGrade>,

    /// Overwrite the outputs
    #[arg(long)]
    force: bool,

    /// Print a scenario with every key explained
    #[arg(long, exclusive = true)]
    example: bool,
}

fn grade(text: &str) -> Result<ImuGrade, String> {
    let found = ImuGrade::ALL.into_iter().find(|g| g.name() == text);
    found.ok_or_else(|| {
        format!(
            "expected one of {}",
            ImuGrade::ALL.map(ImuGrade::name).join(", ")
        )
    })
}

/// What was simulated.
#[derive(Debug, Serialize)]
pub(crate) struct Simulated {
    pub(crate) input: PathBuf,
    pub(crate) output: PathBuf,
    pub(crate) truth: Option<PathBuf>,
    pub(crate) seed: u64,
    pub(crate) imu_grade: ImuGrade,
    pub(crate) duration_s: f64,
    pub(crate) distance_m: f64,
    pub(crate) imu_samples: usize,
    pub(crate) gnss_positions: usize,
    pub(crate) gnss_velocities: usize,
    pub(crate) scenario: Scenario,
}

impl Simulate {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let (Some(scenario), Some(to)) = (&self.scenario, &self.output) else {
            let json = serde_json::json!({ "scenario": SCENARIO_EXAMPLE });
            output.result(&json, || SCENARIO_EXAMPLE.to_owned());
            return Ok(0);
        };
        let outputs = [Some(to), self.truth.as_ref()];
        if outputs.into_iter().flatten().any(|p| is_standard_stream(p)) {
            output.leave_stdout_to_a_file();
        }
        let simulated = self.simulate(scenario, to)?;
        output.result(&simulated, || text::simulated(&simulated));
        Ok(0)
    }

    fn simulate(&self, from: &Path, to: &Path) -> Result<Simulated, Failure> {
        let file = ScenarioFile::load(from, self.imu_grade)?;
        if self.truth.as_deref() == Some(to) {
            return Err(Failure::usage(
                format!("{}: log and truth cannot share a file", to.display()),
                "give the truth another name",
            ));
        }
        for path in [Some(to), self.truth.as_deref()].into_iter().flatten() {
            not_the_input(from, path)?;
            check_output(path, self.force)?;
        }
        let seed = self.seed.or(file.seed).unwrap_or(1);
        let simulation = {
            let _progress = Progress::new(&format!("simulating {}", from.display()), None);
            file.simulate(seed)?
        };
        let scenario = file.scenario;
        let start = simulation.trajectory.start();
        write_log(to, &simulation, &scenario.gnss, self.force)?;
        if let Some(path) = &self.truth {
            write_truth(path, truth(&simulation, &scenario), self.force)?;
        }
        let count =
            |kind: fn(&Sample) -> bool| simulation.samples.iter().filter(|s| kind(s)).count();
        let duration_s = scenario.duration_s.min(simulation.trajectory.duration());
        let steps = (duration_s / WAY_STEP_S) as u32;
        let speed = |i: u32| {
            let at = start.plus((f64::from(i) + 0.5) * WAY_STEP_S);
            simulation.truth_at(at).nav.velocity_n.norm()
        };
        Ok(Simulated {
            input: from.into(),
            output: to.into(),
            truth: self.truth.clone(),
            seed,
            imu_grade: file.grade,
            duration_s,
            distance_m: (0..steps).map(speed).sum::<f64>() * WAY_STEP_S,
            imu_samples: count(Sample::is_inertial),
            gnss_positions: count(|s| matches!(s, Sample::GnssPosition(_))),
            gnss_velocities: count(|s| matches!(s, Sample::GnssVelocity(_))),
            scenario,
        })
    }
}

/// The way is summed in steps of this length, s.
const WAY_STEP_S: f64 = 0.1;
/// Truth is written at this rate, Hz.
const TRUTH_RATE_HZ: f64 = 10.0;

/// The log, with its progress on the terminal.
pub(super) fn write_log(
    path: &Path,
    simulation: &Simulation,
    gnss: &GnssModel,
    force: bool,
) -> Result<(), Failure> {
    let all = simulation.samples.len() as u64;
    let progress = Progress::new(&path.display().to_string(), Some(all));
    write_simulated(path, simulation, gnss, force, |i| {
        if i % 4096 == 0 {
            progress.at(i as u64);
        }
        Ok(())
    })
}

/// What really was, in seconds from the start on the clock of GNSS positions.
pub(super) fn truth<'a>(
    simulation: &'a Simulation,
    scenario: &'a Scenario,
) -> impl Iterator<Item = (f64, insnav_core::mechanization::NavState)> + 'a {
    simulated_truth(simulation, scenario, TRUTH_RATE_HZ).map(|(t, truth)| (t, truth.nav))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grades_by_name() {
        assert_eq!(grade("tactical"), Ok(ImuGrade::Tactical));
        assert!(grade("best").unwrap_err().contains("navigation"));
    }
}
