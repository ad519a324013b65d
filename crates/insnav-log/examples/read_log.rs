//! Lists the topics of a log and reads its samples: `cargo run --release --example read_log -- LOG.mcap`.

use insnav_log::{Log, LogError, ReadOptions};
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(path) = std::env::args_os().nth(1) else {
        eprintln!("usage: read_log LOG.mcap");
        return ExitCode::from(2);
    };
    match read(Path::new(&path)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error} [{}]\n  {}", error.code(), error.remedy());
            ExitCode::FAILURE
        }
    }
}

fn read(path: &Path) -> Result<(), LogError> {
    let log = Log::open(path, ReadOptions::default())?;
    for topic in log.topics() {
        println!("{topic}");
    }
    let begin = std::time::Instant::now();
    let mut samples = log.samples()?;
    let mut count = 0u32;
    for sample in &mut samples {
        sample?;
        count += 1;
    }
    let elapsed = begin.elapsed().as_secs_f64();
    println!(
        "{count} samples in {elapsed:.3} s, {:.2} M/s",
        f64::from(count) / elapsed * 1e-6
    );
    println!("{:?}", samples.counts());
    Ok(())
}
