//! No allocation per message in steady state: a log of twice the length allocates once more per chunk at most.
//!
//! A binary of its own, since the allocator counts everything that happens in it.

// The counter below is the only unsafe code.
#![allow(unsafe_code)]

use insnav_core::config::Config;
use insnav_core::earth::Geodetic;
use insnav_core::imu::ImuGrade;
use insnav_core::navigator::Navigator;
use insnav_core::sample::{GnssPosition, ImuSample, Sample};
use insnav_core::solution::Sink;
use insnav_core::time::Time;
use insnav_log::{
    Compression, Log, LogWriter, LogWriterOptions, McapSink, ReadOptions, SinkOptions,
};
use nalgebra::{Matrix3, Vector3};
use std::alloc::{GlobalAlloc, Layout, System};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

// SAFETY: every call is passed on as it is to the system's allocator; counting touches no memory but the counter.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        unsafe { System.dealloc(memory, layout) }
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.realloc(memory, layout, size) }
    }
}

#[global_allocator]
static COUNTER: Counting = Counting;

/// A standing vehicle: IMU at 100 Hz, a fix every second.
fn write_log(path: &Path, messages: i64, compression: Compression) {
    let options = LogWriterOptions {
        compression,
        ..LogWriterOptions::default()
    };
    let mut writer = LogWriter::create(path, options).unwrap();
    for i in 0..messages {
        let time = Time(1_600_000_000_000_000_000 + 10_000_000 * i);
        // Not quite constant, so that chunks are as large as those of recordings.
        let wobble = 1e-3 * (i as f64 * 1.7).sin();
        let sample = ImuSample {
            time,
            angular_rate_b: Vector3::new(wobble, -wobble, 1e-4),
            specific_force_b: Vector3::new(10.0 * wobble, wobble, -9.81 + wobble),
        };
        writer.write(&Sample::Imu(sample)).unwrap();
        if i % 100 == 0 {
            let fix = GnssPosition {
                time,
                position: Geodetic::from_degrees(59.3, 18.0, 30.0 + wobble),
                covariance_n: Some(Matrix3::identity()),
            };
            writer.write(&Sample::GnssPosition(fix)).unwrap();
        }
    }
    writer.finish().unwrap();
}

fn chunks(log: &Log) -> u64 {
    let mut chunks = 0;
    log.each_record(|record| -> Result<(), insnav_log::LogError> {
        chunks += u64::from(matches!(record, insnav_log::McapRecord::ChunkIndex { .. }));
        Ok(())
    })
    .unwrap();
    chunks
}

/// Allocations of a piece of work.
fn counted(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    work();
    ALLOCATIONS.load(Ordering::Relaxed) - before
}

fn read(path: &Path) {
    let log = Log::open(path, ReadOptions::default()).unwrap();
    assert!(log.samples().unwrap().all(|sample| sample.is_ok()));
}

fn navigate(path: &Path, sink: &mut impl Sink) {
    let mut config = Config::default();
    config.gnss.lever_arm_b_m = Some([0.0; 3]);
    config.alignment.heading_deg = Some(0.0);
    let log = Log::open(path, ReadOptions::default()).unwrap();
    let noise = ImuGrade::Automotive.noise();
    let mut navigator = Navigator::new(&config, noise).unwrap();
    for sample in log.samples().unwrap() {
        navigator.step(&sample.unwrap(), sink).unwrap();
    }
    navigator.finish(sink).unwrap();
}

fn solve(path: &Path, output: PathBuf) {
    let options = SinkOptions {
        force: true,
        ..SinkOptions::default()
    };
    let mut sink = McapSink::create(&output, options).unwrap();
    navigate(path, &mut sink);
    sink.finish().unwrap();
}

/// One test function: the count is of the whole process.
#[test]
fn twice_the_messages_are_not_twice_the_allocations() {
    const MESSAGES: i64 = 40_000;
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::Zstd, Compression::Lz4, Compression::None] {
        let paths = [1, 2, 4].map(|times| {
            let path = folder.path().join(format!("{times}.mcap"));
            let _ = std::fs::remove_file(&path);
            write_log(&path, times * MESSAGES, compression);
            path
        });
        let chunks = paths
            .each_ref()
            .map(|path| chunks(&Log::open(path, ReadOptions::default()).unwrap()));
        let more_chunks = chunks[2] - chunks[1];
        assert!(more_chunks > 10, "{chunks:?}");
        let seconds = (2 * MESSAGES / 100) as u64;
        let check = |what: &str, allowed: u64, count: &dyn Fn(&PathBuf) -> u64| {
            let [once, twice, fourfold] = paths.each_ref().map(count);
            eprintln!(
                "{compression:?}, {what}: {once}, {twice}, {fourfold} allocations for {MESSAGES} messages and twice and four times as many"
            );
            let more = fourfold.saturating_sub(twice);
            assert!(
                more <= allowed,
                "{compression:?}, {what}: {more} more for {} messages in {more_chunks} chunks",
                2 * MESSAGES
            );
        };
        // What grows with the number of chunks: the list of them, and a decompressor's own buffers for LZ4.
        let of_chunks = 8 * more_chunks;
        check("read", of_chunks, &|path| counted(|| read(path)));
        check("filter", of_chunks, &|path| {
            counted(|| navigate(path, &mut ()))
        });
        // A solution is written at 50 Hz into five topics, with a line of diagnostics every second: its dozen texts are
        // allocated, not the 250 messages.
        check("write", of_chunks + 20 * seconds, &|path| {
            counted(|| solve(path, folder.path().join("solution.mcap")))
        });
    }
}
