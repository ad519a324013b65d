//! Nanoseconds a sample of a navigator that is stepped in Rust: what `python/benchmarks/step_overhead.py` holds Python against.
//!
//! `cargo run --release --example step_loop -- samples.f64 [rounds]`: rows of time (s), rates (rad/s) and forces (m/s²), 8 bytes each,
//! little-endian. One number a round.

use insnav::attitude::Euler;
use insnav::earth::Geodetic;
use insnav::imu::ImuGrade;
use insnav::log::{KnownStart, SinkOptions, StateSink, parse_config};
use insnav::sample::{ImuSample, Sample};
use insnav::time::Time;
use nalgebra::Vector3;
use std::time::Instant;

// As in the script; vehicles that stand are another path.
const SETTINGS: &str = r#"
imu.grade = "industrial"
gnss.lever_arm_b_m = [0.0, 0.0, 0.0]
stationary.mode = "off"
output.rate_hz = 1.0
"#;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let path = arguments
        .next()
        .ok_or("usage: step_loop SAMPLES [ROUNDS]")?;
    let rounds = arguments
        .next()
        .map_or(Ok(1), |n| n.to_string_lossy().parse())?;
    let samples: Vec<Sample> = std::fs::read(path)?
        .chunks_exact(7 * 8)
        .map(|row| {
            let number =
                |i: usize| f64::from_le_bytes(row[8 * i..][..8].try_into().expect("eight bytes"));
            Sample::Imu(ImuSample {
                time: Time::default().plus(number(0)),
                angular_rate_b: Vector3::new(number(1), number(2), number(3)),
                specific_force_b: Vector3::new(number(4), number(5), number(6)),
            })
        })
        .collect();
    let config = parse_config(SETTINGS, "settings", &[])?;
    let start = KnownStart {
        time_s: Some(0.0),
        position: Geodetic::from_degrees(50.0, 14.0, 300.0),
        velocity_n: Vector3::new(10.0, 0.0, 0.0),
        q_nb: Euler::from_degrees(0.0, 0.0, 0.0).to_quaternion(),
        position_sigma: Vector3::repeat(1.0),
        velocity_sigma: Vector3::repeat(0.1),
        attitude_sigma: Vector3::new(0.1, 0.1, 0.5).map(f64::to_radians),
    };
    for _ in 0..rounds {
        let mut navigator = start.navigator(
            &config,
            config.noise.over(ImuGrade::Industrial),
            Time::default(),
        )?;
        let mut sink = StateSink::new(&SinkOptions {
            rate_hz: config.output.rate_hz,
            ..SinkOptions::default()
        });
        let begin = Instant::now();
        for sample in &samples {
            navigator.step(sample, &mut sink)?;
        }
        println!(
            "{}",
            begin.elapsed().as_nanos() as f64 / samples.len() as f64
        );
    }
    Ok(())
}
