//! `insnav reproduce`: published experiments, made again.

use crate::experiments::Order;
use crate::failure::Failure;
use crate::output::Output;
use crate::reproduce::{
    AttitudeExperiment, AttitudeRequest, DriftExperiment, DriftRequest, DriveExperiment,
    Experiment, Reproduced, Request, SLICE_S,
};
use crate::text;
use clap::{Args, Subcommand};
use insnav_core::sample::Sample;
use insnav_core::sim::{AttitudeRecord, StaticRecord, StopSetting};
use insnav_core::time::Time;
use insnav_log::{
    Log, ReadOptions, check_output, convert::CsvInputs, csv::read_imu, is_standard_stream,
    write_output,
};
use std::path::{Path, PathBuf};

/// Make a published experiment again: the paper's numbers beside ours, with their standard errors and the best possible
///
/// Simulations follow from a seed; the number of threads changes nothing.
#[derive(Args, Debug)]
pub(crate) struct Reproduce {
    #[command(subcommand)]
    paper: Paper,
}

#[derive(Subcommand, Debug)]
enum Paper {
    Belokurov2018(Belokurov2018),
    Kozadaev2017(Kozadaev2017),
    Lobusov2014(Lobusov2014),
}

/// Belokurov 2018: Q and R of an attitude filter (gyros, accelerometers, magnetometer) from its own innovations
///
/// The paper's scheme with its errors corrected, on a simulated ADIS16405: at rest, turning, shaken, pushed, beside iron. Rows differ
/// in how Q and R are set: data sheet, Mohamed-Schwarz for Q and for R, the paper's recursion, autocovariance least squares as
/// printed, constrained, over all data, and by monitors with a test of fit; raw angles and the best possible filter beside them.
/// Scatter about the mean, as the paper has it, and errors against the truth.
#[derive(Args, Debug)]
struct Belokurov2018 {
    /// Number of runs of each case; all variants see the same
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    runs: u32,

    /// Seed of all random numbers
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,

    /// A real ADIS16405 that lay still, besides the simulated one: a log, a folder with imu.csv, or an imu.csv[.gz]; at least 180 s.
    /// Resampled to 32 ms, roll and pitch, in slices of 180 s (case real_imu)
    #[arg(long, value_name = "LOG")]
    imu: Option<PathBuf>,

    /// Draw pitch and roll by the paper's two methods and by the monitors (figures 2 and 3), SVG
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,

    /// Overwrite the drawing
    #[arg(long)]
    force: bool,

    /// Number of threads [default: as many as there are cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
}

/// Lobusov & Fomichev 2014: drifts and azimuth of a navigation-grade unit from stops in two positions
///
/// The paper's equations as we read them beside the joint regression and the Kalman filter of `insnav align`: still, rocking,
/// quantised, with an accelerometer bias, with realistic noise, from one stop with the azimuth known, and an hour of free run
/// after compensation. Both sets of drifts: the paper's has no part along east and leaves the azimuth nothing to correct.
#[derive(Args, Debug)]
struct Lobusov2014 {
    /// Number of runs of the noisy case; all others are made once [default: 100, with --drive 10]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    runs: Option<u32>,

    /// Seed of all random numbers
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,

    /// In place of the stops alone the drive between them: an hour without GNSS with a stop every five minutes, and what it comes to
    /// with different uses of the stops
    #[arg(long, conflicts_with = "plot")]
    drive: bool,

    /// Draw drifts, attitude and Schuler oscillation before and after compensation (figures 1–4), and our own rocking stop in place of
    /// figure 5, SVG
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,

    /// Overwrite the drawing
    #[arg(long)]
    force: bool,

    /// Number of threads [default: as many as there are cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
}

/// Kozadaev & Makarenko 2017: what a filter makes of a stop of 300 s, its heading above all
///
/// Ten variants on the same samples: basic, zero velocity, zero rate with three gains, the paper's held heading with its
/// covariances moved exactly or its variance alone, held attitude, constant pose, and constant pose with states for the
/// receiver's time-correlated errors; two negative controls beside them. The paper gives three of these.
#[derive(Args, Debug)]
struct Kozadaev2017 {
    /// Number of runs; all variants see the same
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    runs: u32,

    /// Seed of all random numbers
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,

    /// A real unit that stood still, in place of the simulated one: a log, a folder with imu.csv, or an imu.csv[.gz]; at least
    /// 300 s. Runs are slices of it, which overlap where it is short: standard errors count those that do not. The receiver stays simulated. Not together with --multi-stop, as such a unit does not drive
    #[arg(long, value_name = "LOG", conflicts_with = "multi_stop")]
    imu: Option<PathBuf>,

    /// Four stops with three drives of a minute between them, simulated throughout: not together with --imu
    #[arg(long)]
    multi_stop: bool,

    /// Draw the heading errors of the first run with their stated sigmas, SVG
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,

    /// Overwrite the drawing
    #[arg(long)]
    force: bool,

    /// Number of threads [default: as many as there are cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
}

impl Reproduce {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        match &self.paper {
            Paper::Belokurov2018(paper) => paper.run(output),
            Paper::Kozadaev2017(paper) => paper.run(output),
            Paper::Lobusov2014(paper) => paper.run(output),
        }
    }
}

impl Belokurov2018 {
    fn run(&self, output: &Output) -> Result<u8, Failure> {
        check_plot(self.plot.as_deref(), self.force, output)?;
        let experiment = self.experiment()?;
        if let Some(plot) = &self.plot {
            write_output(plot, experiment.figure()?.as_bytes(), self.force)
                .map_err(|e| of_plot(e.into()))?;
        }
        let report = experiment.report();
        output.result(&report, || text::reproduced(&report));
        Ok(0)
    }
}

impl Kozadaev2017 {
    fn run(&self, output: &Output) -> Result<u8, Failure> {
        check_plot(self.plot.as_deref(), self.force, output)?;
        let experiment = self.experiment()?;
        if let Some(plot) = &self.plot {
            write_output(plot, experiment.figure().as_bytes(), self.force)
                .map_err(|e| of_plot(e.into()))?;
        }
        let report = experiment.report();
        output.result(&report, || text::reproduced(&report));
        Ok(0)
    }
}

impl Lobusov2014 {
    fn run(&self, output: &Output) -> Result<u8, Failure> {
        check_plot(self.plot.as_deref(), self.force, output)?;
        let report = self.report()?;
        if let Some(plot) = &self.plot {
            write_output(plot, DriftExperiment::figure()?.as_bytes(), self.force)
                .map_err(|e| of_plot(e.into()))?;
        }
        output.result(&report, || text::reproduced(&report));
        Ok(0)
    }
}

impl Belokurov2018 {
    fn experiment(&self) -> Result<AttitudeExperiment, Failure> {
        AttitudeExperiment::run(AttitudeRequest {
            runs: self.runs as usize,
            seed: self.seed,
            jobs: threads(self.jobs),
            real: self.imu.as_deref().map(attitude_record).transpose()?,
        })
    }
}

impl Kozadaev2017 {
    fn experiment(&self) -> Result<Experiment, Failure> {
        Experiment::run(Request {
            runs: self.runs as usize,
            seed: self.seed,
            jobs: threads(self.jobs),
            multi_stop: self.multi_stop,
            record: self.imu.as_deref().map(record).transpose()?,
        })
    }
}

impl Lobusov2014 {
    fn report(&self) -> Result<Reproduced, Failure> {
        let usual = if self.drive { 10 } else { 100 };
        let request = DriftRequest {
            runs: self.runs.unwrap_or(usual) as usize,
            seed: self.seed,
            jobs: threads(self.jobs),
        };
        Ok(if self.drive {
            DriveExperiment::run(request)?.report()
        } else {
            DriftExperiment::run(request)?.report()
        })
    }
}

fn threads(jobs: Option<u16>) -> usize {
    let all = || std::thread::available_parallelism().map_or(1, usize::from);
    jobs.map_or_else(all, usize::from)
}

/// The table of `reproduce belokurov2018`.
pub(crate) fn belokurov2018(order: Order<'_>) -> Result<Reproduced, Failure> {
    let paper = Belokurov2018 {
        runs: order.runs.unwrap_or(100),
        seed: order.seed,
        imu: order.imu.map(Path::to_path_buf),
        plot: None,
        force: false,
        jobs: order.jobs,
    };
    Ok(paper.experiment()?.report())
}

/// The table of `reproduce kozadaev2017`.
pub(crate) fn kozadaev2017(order: Order<'_>, multi_stop: bool) -> Result<Reproduced, Failure> {
    let paper = Kozadaev2017 {
        runs: order.runs.unwrap_or(100),
        seed: order.seed,
        imu: order.imu.map(Path::to_path_buf),
        multi_stop,
        plot: None,
        force: false,
        jobs: order.jobs,
    };
    Ok(paper.experiment()?.report())
}

/// The table of `reproduce lobusov2014`.
pub(crate) fn lobusov2014(order: Order<'_>, drive: bool) -> Result<Reproduced, Failure> {
    let paper = Lobusov2014 {
        runs: order.runs,
        seed: order.seed,
        drive,
        plot: None,
        force: false,
        jobs: order.jobs,
    };
    paper.report()
}

/// Nothing is computed for a drawing that cannot be written.
fn check_plot(plot: Option<&Path>, force: bool, output: &Output) -> Result<(), Failure> {
    let Some(plot) = plot else { return Ok(()) };
    check_ending(plot)?;
    check_output(plot, force).map_err(|e| of_plot(e.into()))?;
    if is_standard_stream(plot) {
        output.leave_stdout_to_a_file();
    }
    Ok(())
}

/// A drawing is SVG, whatever its name: so its name says so.
fn check_ending(plot: &Path) -> Result<(), Failure> {
    let ending = plot.extension().map(|e| e.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        None | Some("svg") => Ok(()),
        Some(other) => Err(Failure::usage(
            format!(
                "--plot {}: the drawing is SVG, not {}",
                plot.display(),
                other.to_uppercase()
            ),
            format!(
                "name it {}; a browser shows it, and Inkscape or ImageMagick make other formats of it",
                plot.with_extension("svg").display()
            ),
        )),
    }
}

/// The same failure about the file of `--plot`: its remedies name that flag.
fn of_plot(mut failure: Failure) -> Failure {
    let remedy = &mut failure.problem.remedy;
    *remedy = remedy.replace("`-o`", "`--plot`");
    failure
}

/// The inertial samples of a log or a table, as those of a unit at rest.
fn record(path: &Path) -> Result<StaticRecord, Failure> {
    let samples = at_rest(path, StopSetting::paper().stop_s)?;
    StaticRecord::new(samples).map_err(|error| {
        refused(
            path,
            "not_at_rest",
            error.to_string(),
            StopSetting::paper().stop_s,
        )
    })
}

/// The same in steps of 32 ms.
fn attitude_record(path: &Path) -> Result<AttitudeRecord, Failure> {
    let samples = at_rest(path, SLICE_S)?;
    let begin = samples.first().map_or(Time(0), Sample::time);
    let imu: Vec<_> = samples
        .iter()
        .filter_map(|sample| match sample {
            Sample::Imu(s) => Some((s.time.since(begin), s.angular_rate_b, s.specific_force_b)),
            _ => None,
        })
        .collect();
    let record = AttitudeRecord::resample(&imu);
    let long = record.samples.len() as f64 * record.step_s;
    if long < SLICE_S {
        let what = format!(
            "the first {long:.1} s alone can be resampled to {:.0} ms: what follows is a gap, or samples are too rare",
            1e3 * record.step_s
        );
        return Err(refused(path, "record_too_short", what, SLICE_S));
    }
    Ok(record)
}

fn refused(path: &Path, code: &'static str, what: String, least: f64) -> Failure {
    Failure::new(
        code,
        format!("{}: {what}", path.display()),
        format!("give `--imu` a record of a unit that stood still for at least {least:.0} s"),
    )
}

/// All samples of a record that is at least `least` seconds long, and of a unit at rest as far as its rates tell.
fn at_rest(path: &Path, least: f64) -> Result<Vec<Sample>, Failure> {
    let table = if path.is_dir() {
        Some(CsvInputs::in_folder(path)?.imu)
    } else {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        (name.ends_with(".csv") || name.ends_with(".csv.gz")).then(|| path.to_owned())
    };
    let samples: Vec<Sample> = match table {
        Some(table) => read_imu(&table)?
            .samples(Time(0))
            .map(Sample::Imu)
            .collect(),
        None => {
            let log = Log::open(path, ReadOptions::default())?;
            log.samples()?.collect::<Result<_, _>>()?
        }
    };
    let refuse = |code, what| refused(path, code, what, least);
    if !samples.iter().any(Sample::is_inertial) {
        return Err(refuse(
            "no_imu_samples",
            "no inertial samples are in it".into(),
        ));
    }
    if let Some(leap) = StaticRecord::leap(&samples) {
        return Err(refuse(
            "not_one_record",
            format!(
                "the stamps leap by {:.1} s after {:.1} s of the record",
                leap.by_s, leap.after_s
            ),
        ));
    }
    let mut inertial = samples.iter().filter(|s| s.is_inertial()).map(Sample::time);
    let (first, last) = (inertial.next(), inertial.next_back());
    let long = first.zip(last).map_or(0.0, |(a, b)| b.since(a));
    if long < least {
        return Err(refuse(
            "record_too_short",
            format!("the record lasts {long:.1} s, and the stop {least:.0} s"),
        ));
    }
    if let Some(turn) = StaticRecord::turning(&samples) {
        return Err(refuse(
            "not_at_rest",
            format!(
                "the mean rate changed by {:.2} °/s at {:.0} s of the record: the unit did not stand still",
                turn.rate_change.to_degrees(),
                turn.after_s
            ),
        ));
    }
    Ok(samples)
}
