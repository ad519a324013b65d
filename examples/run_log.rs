//! A log navigated in Rust, in one page: `cargo run --release --example run_log -- drive.mcap > drive.csv`.
//!
//! The same plan and loop as the command's and Python's; numbers are printed with as many digits as tell them apart, so that
//! the three can be compared to the last bit. `run_log drive.mcap json` prints all that there is: every number of every epoch, and every
//! measurement, one a line.

use insnav::config::Config;
use insnav::filter::Update;
use insnav::log::{Log, Plan, ReadOptions, RunOptions, SolutionSink, StateSink, UpdateRow};
use insnav::solution::{Epoch, Sink};
use insnav::time::Time;
use std::io::{BufWriter, Write};
use std::path::Path;

/// What comes out of a run: epochs as they go into a file, and measurements.
struct Everything {
    epochs: StateSink,
    updates: Vec<UpdateRow>,
}

impl Sink for Everything {
    fn wants_epoch(&mut self, time: Time) -> bool {
        self.epochs.wants_epoch(time)
    }

    fn epoch(&mut self, epoch: &Epoch) {
        self.epochs.epoch(epoch);
    }

    fn update(&mut self, update: &Update) {
        self.updates.push(UpdateRow::from(update));
    }
}

impl SolutionSink for Everything {}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args_os()
        .nth(1)
        .ok_or("usage: run_log LOG [json]")?;
    let all = std::env::args_os()
        .nth(2)
        .is_some_and(|word| word == "json");
    let log = Log::open(Path::new(&path), ReadOptions::default())?;
    // Decides from the data what the settings leave open.
    let plan = Plan::make(&log, &Config::default(), &RunOptions::default())?;
    let mut sink = Everything {
        epochs: StateSink::new(&plan.sink_options()),
        updates: Vec::new(),
    };
    plan.execute(&log, &mut sink)?;

    let mut out = BufWriter::new(std::io::stdout().lock());
    if all {
        for update in &sink.updates {
            writeln!(out, "{}", serde_json::to_string(update)?)?;
        }
        for state in sink.epochs.into_states() {
            writeln!(out, "{}", serde_json::to_string(&state)?)?;
        }
        out.flush()?;
        return Ok(());
    }
    writeln!(
        out,
        "time_ns,latitude_deg,longitude_deg,height_m,velocity_north_m_per_s,velocity_east_m_per_s,velocity_down_m_per_s,\
         roll_deg,pitch_deg,heading_deg,sigma_north_m,sigma_east_m,sigma_down_m,sigma_heading_deg"
    )?;
    for s in sink.epochs.into_states() {
        write!(out, "{}", s.header.stamp.0)?;
        for value in [
            s.latitude_deg,
            s.longitude_deg,
            s.height_m,
            s.velocity_north_m_per_s,
            s.velocity_east_m_per_s,
            s.velocity_down_m_per_s,
            s.roll_deg,
            s.pitch_deg,
            s.heading_deg,
            s.sigma_north_m,
            s.sigma_east_m,
            s.sigma_down_m,
            s.sigma_heading_deg,
        ] {
            write!(out, ",{value:?}")?;
        }
        writeln!(out)?;
    }
    out.flush()?;
    Ok(())
}
