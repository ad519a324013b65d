//! `insnav demo`: the whole way once, without any data: simulate, navigate, compare with the truth.

use super::run::{Outcome, execute};
use super::run_inputs::Job;
use crate::failure::Failure;
use crate::output::Output;
use crate::text;
use clap::Args;
use insnav_core::attitude::Euler;
use insnav_core::config::Config;
use insnav_core::imu::ImuGrade;
use insnav_core::metrics::{CompareOptions, Comparison, Withheld, compare};
use insnav_core::sim::{Scenario, Simulation};
use insnav_core::time::Time;
use insnav_log::{
    ComparedReference, ComparedSolution, Log, LogWriter, LogWriterOptions, ReadOptions, RunOptions,
    config_text,
};
use nalgebra::Vector3;
use serde::Serialize;
use std::fmt::Write as _;
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
    pub(crate) run: Outcome,
    /// Against the truth; `withheld` is inside the outages.
    pub(crate) comparison: Comparison,
}

/// Truth is written at this rate, Hz.
const TRUTH_RATE_HZ: f64 = 10.0;

impl Demo {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let report = self.report()?;
        output.warnings(&report.run.report.warnings);
        output.result(&report, || text::demo_report(&report));
        Ok(0)
    }

    fn report(&self) -> Result<DemoReport, Failure> {
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
        let lever_arm = Vector3::from(scenario.gnss.lever_arm_b_m);
        write_log(&log_path, &simulation, t0, lever_arm)?;
        write_file(
            &truth_path,
            &truth_csv(&simulation, t0, scenario.duration_s),
        )?;
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

fn write_log(
    path: &Path,
    simulation: &Simulation,
    t0: Time,
    lever_arm: Vector3<f64>,
) -> Result<(), Failure> {
    let options = LogWriterOptions {
        force: true,
        t0: Some(t0),
        lever_arm_b: Some(lever_arm),
        ..LogWriterOptions::default()
    };
    let mut writer = LogWriter::create(path, options)?;
    for sample in &simulation.samples {
        writer.write(sample)?;
    }
    writer.finish()?;
    Ok(())
}

fn truth_csv(simulation: &Simulation, t0: Time, duration_s: f64) -> String {
    let mut text = String::from("t_s,lat_deg,lon_deg,h_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg\n");
    for i in 0..=(duration_s * TRUTH_RATE_HZ) as u32 {
        let t = f64::from(i) / TRUTH_RATE_HZ;
        let nav = simulation.truth_at(t0.plus(t)).nav;
        let (p, v, e) = (
            nav.position,
            nav.velocity_n,
            Euler::from_quaternion(&nav.q_nb),
        );
        let _ = writeln!(
            text,
            "{t:.3},{:.11},{:.11},{:.5},{:.6},{:.6},{:.6},{:.7},{:.7},{:.7}",
            p.latitude_deg(),
            p.longitude_deg(),
            p.height,
            v.x,
            v.y,
            v.z,
            e.roll.to_degrees(),
            e.pitch.to_degrees(),
            e.heading_deg()
        );
    }
    text
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
