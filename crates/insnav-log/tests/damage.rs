//! Every prefix and every single-bit flip of small logs: never a panic, never a silent difference where there are checksums.

use insnav_core::earth::Geodetic;
use insnav_core::sample::{GnssPosition, ImuSample, Sample};
use insnav_core::time::Time;
use insnav_log::{Checksums, Compression, Log, LogError, LogWriter, LogWriterOptions, ReadOptions};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

type Messages = Vec<(String, i64, i64, Vec<u8>)>;

/// All that a log says.
#[derive(Debug, PartialEq)]
struct Said {
    messages: Messages,
    topics: Vec<String>,
    metadata: Option<BTreeMap<String, String>>,
}

fn open(bytes: &[u8], recover: bool) -> Result<Log, LogError> {
    let options = ReadOptions {
        recover,
        // A flipped size is refused before memory is taken for it.
        chunk_size_limit: 1 << 20,
        ..ReadOptions::default()
    };
    Log::from_bytes(Path::new("damaged.mcap"), bytes.to_vec(), options)
}

fn said(log: &Log) -> Result<Said, LogError> {
    let mut messages = Vec::new();
    for topic in log.topics() {
        log.each_message(topic, |m| -> Result<(), LogError> {
            let name = topic.name.clone();
            messages.push((name, m.log_time.0, m.publish_time.0, m.data.to_vec()));
            Ok(())
        })?;
    }
    messages.sort();
    Ok(Said {
        messages,
        topics: log.topics().iter().map(ToString::to_string).collect(),
        metadata: log.metadata("insnav").cloned(),
    })
}

/// Several chunks, two topics, metadata, summary, by the writer that the program's outputs are written with.
fn chunked(compression: Option<mcap::Compression>, checksums: bool) -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    let mut writer = mcap::WriteOptions::new()
        .compression(compression)
        .compression_threads(0)
        .chunk_size(Some(160))
        .calculate_chunk_crcs(checksums)
        .calculate_data_section_crc(checksums)
        .calculate_summary_section_crc(checksums)
        .create(&mut file)
        .unwrap();
    let text = b"std_msgs/Header header";
    let schema = writer
        .add_schema("std_msgs/msg/Header", "ros2msg", text)
        .unwrap();
    let none = BTreeMap::new();
    let a = writer.add_channel(schema, "/a", "cdr", &none).unwrap();
    let b = writer.add_channel(0, "/b", "raw", &none).unwrap();
    writer
        .write_metadata(&mcap::records::Metadata {
            name: "insnav".into(),
            metadata: BTreeMap::from([("t0_ns".into(), "1600000000000000000".into())]),
        })
        .unwrap();
    for i in 0..12u64 {
        let time = 1_600_000_000_000_000_000 + 10_000_000 * i;
        let header = mcap::records::MessageHeader {
            channel_id: if i % 3 == 0 { b } else { a },
            sequence: i as u32,
            log_time: time,
            publish_time: time,
        };
        let data = [&[0, 1, 0, 0][..], &time.to_le_bytes()].concat();
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    file.into_inner()
}

/// As `convert` and `demo` write.
fn own() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("own.mcap");
    let options = LogWriterOptions {
        compression: Compression::Zstd,
        t0: Some(Time(1_600_000_000_000_000_000)),
        ..LogWriterOptions::default()
    };
    let mut writer = LogWriter::create(&path, options).unwrap();
    for i in 0..5 {
        let time = Time(1_600_000_000_000_000_000 + 10_000_000 * i);
        let sample = ImuSample {
            time,
            angular_rate_b: Vector3::new(0.01, 0.02, i as f64),
            specific_force_b: Vector3::new(0.0, 0.1, -9.8),
        };
        writer.write(&Sample::Imu(sample)).unwrap();
        let fix = GnssPosition {
            time,
            position: Geodetic::from_degrees(59.3, 18.0, 30.0),
            covariance_n: Some(Matrix3::identity()),
        };
        writer.write(&Sample::GnssPosition(fix)).unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

fn logs() -> [(&'static str, Vec<u8>); 4] {
    [
        ("zstd", chunked(Some(mcap::Compression::Zstd), true)),
        ("lz4", chunked(Some(mcap::Compression::Lz4), true)),
        ("none", chunked(None, true)),
        ("own", own()),
    ]
}

fn is_subset(part: &Messages, all: &Messages) -> bool {
    let mut all = all.iter();
    part.iter().all(|m| all.any(|other| other == m))
}

/// Recovery gives true messages only, and says so when it gives fewer. Returns how many it gave.
fn recovered(damaged: &[u8], whole: &Said, place: &str) -> usize {
    let Ok(log) = open(damaged, true) else {
        return 0;
    };
    let got = said(&log).unwrap_or_else(|e| panic!("{place}: {e}"));
    assert!(
        is_subset(&got.messages, &whole.messages),
        "{place}: {:?}",
        got.topics
    );
    let recovery = log.recovery().unwrap();
    assert_eq!(recovery.messages_kept, got.messages.len() as u64, "{place}");
    assert!(!recovery.is_clean(), "{place}: the damage is not told");
    // Nor do the account, the statistics and the samples panic.
    let _ = (recovery.account(Time(0)), log.statistics(), log.checksums());
    let _ = log.samples().map(Iterator::count);
    got.messages.len()
}

#[test]
fn every_prefix() {
    for (name, bytes) in logs() {
        let whole = said(&open(&bytes, false).unwrap()).unwrap();
        let mut most = 0;
        for length in 0..bytes.len() {
            let prefix = &bytes[..length];
            let error = open(prefix, false).expect_err("a prefix is no whole file");
            assert!(
                ["truncated", "not_an_mcap"].contains(&error.code()),
                "{name} {length}: {error}"
            );
            assert!(length <= 8 || error.remedy().contains("--recover"));
            let got = recovered(prefix, &whole, &format!("{name}, {length} bytes"));
            assert!(
                got >= most,
                "{name}: more bytes, fewer messages at {length}"
            );
            most = got;
        }
        assert_eq!(most, whole.messages.len(), "{name}");
    }
}

#[test]
fn every_single_bit_flip() {
    for (name, bytes) in logs() {
        assert!(bytes.len() < 8192, "{name} has {} bytes", bytes.len());
        let whole = said(&open(&bytes, false).unwrap()).unwrap();
        let (mut noticed, mut kept, mut flips) = (0, 0, 0);
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << bit;
                let place = format!("{name}, bit {bit} of byte {at}");
                flips += 1;
                match open(&damaged, false).and_then(|log| said(&log)) {
                    Ok(same) => assert_eq!(same, whole, "{place}"),
                    Err(error) => {
                        noticed += 1;
                        assert!(!error.to_string().is_empty() && !error.remedy().is_empty());
                        kept += recovered(&damaged, &whole, &place);
                    }
                }
            }
        }
        // Every byte is under some checksum or mark.
        assert_eq!(noticed, flips, "{name}");
        // One flipped bit costs at most its chunk, here a third or less of the messages, and mostly nothing.
        let share = kept as f64 / (noticed * whole.messages.len()) as f64;
        eprintln!(
            "{name}: {} bytes, {flips} flips, {:.1} % of the messages kept on average",
            bytes.len(),
            100.0 * share
        );
        let expected = if name == "own" { 0.5 } else { 0.85 };
        assert!(share > expected, "{name}: {share}");
    }
}

#[test]
fn without_checksums_nothing_panics_and_the_log_says_that_it_has_none() {
    for compression in [
        None,
        Some(mcap::Compression::Zstd),
        Some(mcap::Compression::Lz4),
    ] {
        let bytes = chunked(compression, false);
        assert_eq!(open(&bytes, false).unwrap().checksums(), Checksums::None);
        let with = chunked(compression, true);
        assert_eq!(open(&with, false).unwrap().checksums(), Checksums::All);
        for at in 0..bytes.len() {
            for bit in 0..8 {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << bit;
                for recover in [false, true] {
                    if let Ok(log) = open(&damaged, recover) {
                        let _ = said(&log);
                        let _ = log.statistics();
                        let _ = log.samples().map(Iterator::count);
                    }
                }
            }
        }
    }
}

#[test]
fn recovery_of_a_whole_file_has_nothing_to_tell() {
    for (name, bytes) in logs() {
        let log = open(&bytes, true).unwrap();
        assert!(log.recovery().unwrap().is_clean(), "{name}");
        assert!(log.recovery_warning().is_none());
        let whole = open(&bytes, false).unwrap();
        assert!(whole.recovery().is_none());
        assert_eq!(said(&log).unwrap(), said(&whole).unwrap(), "{name}");
        assert_eq!(log.crc32(), crc32fast::hash(&bytes));
        assert_eq!(whole.crc32(), crc32fast::hash(&bytes));
    }
}
