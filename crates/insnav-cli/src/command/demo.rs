//! `insnav demo`: the whole way once, without any data: simulate, navigate, compare with the truth.

use super::run::{Outcome, execute};
use super::run_inputs::Job;
use super::simulate::{truth, write_log};
use crate::failure::Failure;
use crate::output::Output;
use crate::text;
use clap::Args;
use insnav_core::config::Config;
use insnav_core::imu::ImuGrade;
use insnav_core::metrics::{CompareOptions, Comparison, Withheld, compare};
use insnav_core::sim::Scenario;
use insnav_log::csv::write_truth;
use insnav_log::{
    ComparedReference, ComparedSolution, Log, ReadOptions, RunOptions, config_text,
    is_standard_stream,
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// See it work without any data: simulate a drive, navigate it, compare the solution with the truth
#[derive(Args, Debug)]
pub(crate) struct Demo {
    /// Folder for the files
    #[arg(long, value_name = "DIR", default_value = "insnav-demo")]
    dir: PathBuf,

    /// Seed of the simulated errors
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// What the demonstration tells.
#[derive(Debug, Serialize)]
pub(crate) struct DemoReport {
    pub(crate) scenario: Scenario,
    pub(crate) seed: u64,
    pub(crate) log: PathBuf,
    pub(crate) config: PathBuf,
    pub(crate) truth: PathBuf,
    pub(crate) dir: PathBuf,
    /// What the files of the folder take together.
    pub(crate) bytes: u64,
    pub(crate) run: Outcome,
    /// Against the truth; `withheld` is inside the outages.
    pub(crate) comparison: Comparison,
}

impl Demo {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let report = self.report()?;
        output.warnings(&report.run.report.warnings);
        output.result(&report, || text::demo_report(&report));
        Ok(0)
    }

    fn report(&self) -> Result<DemoReport, Failure> {
        if is_standard_stream(&self.dir) {
            return Err(Failure::usage(
                "--dir -: several files are written, and standard output is one",
                "name a folder",
            ));
        }
        std::fs::create_dir_all(&self.dir).map_err(|e| Failure::not_writable(&self.dir, e))?;
        let file = |name: &str| self.dir.join(name);
        let (log_path, truth_path, config_path) = (
            file("drive.mcap"),
            file("drive.truth.csv"),
            file("car.toml"),
        );

        let scenario = scenario();
        let simulation = scenario
            .simulate(self.seed)
            .map_err(insnav_log::RunError::from)?;
        let t0 = simulation.trajectory.start();
        write_log(&log_path, &simulation, &scenario.gnss, true)?;
        write_truth(&truth_path, truth(&simulation, &scenario), true)?;
        let mut config = Config::default();
        config.imu.grade = Some(ImuGrade::Consumer);
        // The errors of the simulated fixes are independent, those of real receivers are not.
        config.gnss.correlation_time_s = 0.0;
        write_file(&config_path, &config_text(&config))?;

        let log = Log::open(&log_path, ReadOptions::default())?;
        let solution_path = file("drive.insnav.mcap");
        let run = execute(
            &log,
            &Job {
                input: log_path.clone(),
                output: solution_path.clone(),
            },
            &config,
            &RunOptions::default(),
            true,
        )?;

        let solution = ComparedSolution::read(&solution_path, None)?;
        let reference = ComparedReference::read(&truth_path, &solution)?;
        let outages = scenario
            .gnss
            .outages
            .iter()
            .map(|o| (t0.plus(o.begin_s), t0.plus(o.end_s)))
            .collect();
        let options = CompareOptions {
            origin: t0,
            withheld: Withheld::Intervals(outages),
            ..CompareOptions::default()
        };
        let comparison = compare(&solution.track, &reference.points, &options);
        Ok(DemoReport {
            scenario,
            seed: self.seed,
            log: log_path,
            config: config_path,
            truth: truth_path,
            bytes: size_of(&self.dir),
            dir: self.dir.clone(),
            run,
            comparison,
        })
    }
}

/// The ready scenario, changed where this program does not follow yet: without a coloured position error, since the filter
/// takes the errors of fixes as independent and would state too small an uncertainty; and with a velocity quieter than
/// 0.1 m/s, the GNSS speed by which it sees stops.
fn scenario() -> Scenario {
    let mut scenario = Scenario::demo();
    scenario.gnss.position_colour_sigma_m = [0.0; 3];
    scenario.gnss.velocity_sigma_m_per_s = [0.03, 0.03, 0.06];
    scenario
}

/// Bytes of the files in a folder.
fn size_of(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .filter_map(|e| e.metadata().ok())
        .filter(std::fs::Metadata::is_file)
        .map(|m| m.len())
        .sum()
}

/// Written under another name first, so that a file is whole or not there.
fn write_file(path: &Path, text: &str) -> Result<(), Failure> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".part");
    let part = path.with_file_name(name);
    std::fs::write(&part, text)
        .and_then(|()| std::fs::rename(&part, path))
        .map_err(|e| Failure::not_writable(path, e))
}
