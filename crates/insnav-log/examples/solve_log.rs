//! The shortest program that turns a log into a solution:
//! `cargo run --release -p insnav-log --example solve_log -- LOG.mcap SOLUTION.mcap`.

use insnav_core::config::Config;
use insnav_core::imu::ImuGrade;
use insnav_core::navigator::Navigator;
use insnav_log::{Log, McapSink, ReadOptions, SinkOptions};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let [input, output] = std::env::args_os()
        .skip(1)
        .collect::<Vec<_>>()
        .try_into()
        .map_err(|_| "usage: solve_log LOG SOLUTION")?;
    let log = Log::open(Path::new(&input), ReadOptions::default())?;
    let origin = log.first_fix()?.map(|fix| fix.position);
    let options = SinkOptions {
        force: true,
        origin,
        ..SinkOptions::default()
    };
    let mut sink = McapSink::create(Path::new(&output), options)?;
    let mut navigator = Navigator::new(&Config::default(), ImuGrade::Consumer.noise())?;
    for sample in log.samples()? {
        navigator.step(&sample?, &mut sink)?;
    }
    navigator.finish(&mut sink)?;
    println!("{:?}", sink.finish()?);
    Ok(())
}
