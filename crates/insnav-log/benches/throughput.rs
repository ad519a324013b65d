//! From a log to samples, to a solution, to a file: inertial messages per second of one core's time.
//!
//! The log is a simulated drive of 1 M inertial messages at 100 Hz with fixes and velocities at 1 Hz, zstd, in a temporary
//! folder; it is opened anew each time, with the checks that belong to it. Time is that of the processor (`schedstat` of the
//! thread), since the machine may be shared; where there is none, the clock's.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use insnav_core::config::Config;
use insnav_core::imu::ImuGrade;
use insnav_core::navigator::Navigator;
use insnav_core::sim::Scenario;
use insnav_core::solution::Sink;
use insnav_log::{Log, LogWriter, LogWriterOptions, McapSink, ReadOptions, SinkOptions};
use std::hint::black_box;
use std::path::Path;
use std::time::{Duration, Instant};

const MESSAGES: u64 = 1_000_000;
const RATE_HZ: f64 = 100.0;

fn write_log(path: &Path) {
    let mut scenario = Scenario::car_drive(MESSAGES as f64 / RATE_HZ);
    scenario.imu.rate_hz = RATE_HZ;
    let simulation = scenario.simulate(1).expect("a ready scenario");
    let mut writer = LogWriter::create(path, LogWriterOptions::default()).expect("a new file");
    for sample in &simulation.samples {
        writer.write(sample).expect("room on the disk");
    }
    writer.finish().expect("room on the disk");
}

/// Processor time of this thread so far, or time itself.
fn now() -> Duration {
    static BEGIN: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    let begin = BEGIN.get_or_init(Instant::now);
    std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split(' ').next()?.parse().ok())
        .map_or_else(|| begin.elapsed(), Duration::from_nanos)
}

fn config() -> Config {
    let mut config = Config::default();
    config.imu.grade = Some(ImuGrade::Automotive);
    config.gnss.lever_arm_b_m = Some([0.0; 3]);
    config
}

fn read(path: &Path) -> u64 {
    let log = Log::open(path, ReadOptions::default()).expect("a log");
    log.samples()
        .expect("topics")
        .map(|sample| black_box(sample.expect("a sample")))
        .filter(insnav_core::sample::Sample::is_inertial)
        .count() as u64
}

fn navigate(path: &Path, sink: &mut impl Sink) {
    let config = config();
    let log = Log::open(path, ReadOptions::default()).expect("a log");
    let mut navigator =
        Navigator::new(&config, config.noise.over(ImuGrade::Automotive)).expect("settings");
    for sample in log.samples().expect("topics") {
        navigator
            .step(&sample.expect("a sample"), sink)
            .expect("a step");
    }
    navigator.finish(sink).expect("an end");
}

fn throughput(c: &mut Criterion) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let log = folder.path().join("drive.mcap");
    write_log(&log);
    // The sample at the end is one more.
    let messages = read(&log);
    assert!(messages.abs_diff(MESSAGES) <= 1, "{messages}");
    let timed = |work: &mut dyn FnMut()| {
        let begin = now();
        work();
        now() - begin
    };
    let mut group = c.benchmark_group("log");
    group.throughput(Throughput::Elements(messages));
    group.sample_size(10);
    group.bench_function("read", |b| {
        b.iter_custom(|n| {
            (0..n)
                .map(|_| timed(&mut || assert_eq!(read(&log), messages)))
                .sum()
        });
    });
    group.bench_function("read_and_filter", |b| {
        b.iter_custom(|n| (0..n).map(|_| timed(&mut || navigate(&log, &mut ()))).sum());
    });
    group.bench_function("read_filter_and_write_50_hz", |b| {
        b.iter_custom(|n| {
            (0..n)
                .map(|_| {
                    timed(&mut || {
                        let output = folder.path().join("solution.mcap");
                        let options = SinkOptions {
                            force: true,
                            ..SinkOptions::default()
                        };
                        let mut sink = McapSink::create(&output, options).expect("a new file");
                        navigate(&log, &mut sink);
                        sink.finish().expect("room on the disk");
                    })
                })
                .sum()
        });
    });
    group.finish();
}

criterion_group!(benches, throughput);
criterion_main!(benches);
