//! The container reader against other programs' files and other programs' readings of them.

mod recordings;

use insnav_log::{Log, LogError, ReadOptions};
use recordings::recording;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

type Messages = Vec<(String, i64, i64, Vec<u8>)>;

fn messages_of(log: &Log) -> Result<Messages, LogError> {
    let mut all = Vec::new();
    for topic in log.topics() {
        log.each_message(topic, |message| -> Result<(), LogError> {
            all.push((
                topic.name.clone(),
                message.log_time.0,
                message.publish_time.0,
                message.data.to_vec(),
            ));
            Ok(())
        })?;
    }
    all.sort();
    Ok(all)
}

fn read(path: &Path) -> Result<Messages, LogError> {
    messages_of(&Log::open(path, ReadOptions::default())?)
}

fn files_below(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_below(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            files.push(path);
        }
    }
    files.sort();
    files
}

#[test]
fn files_of_other_recorders_read_as_with_the_reference_crate() {
    let folders = ["mcap_real", "mcap_rosbag2", "mcap_evo"];
    let Some(folders) = folders
        .into_iter()
        .map(recording)
        .collect::<Option<Vec<_>>>()
    else {
        return;
    };
    let files: Vec<_> = folders
        .iter()
        .flat_map(|folder| files_below(folder, "mcap"))
        .collect();
    let mut compared = 0;
    for file in files
        .iter()
        .filter(|file| !file.to_string_lossy().contains("broken"))
    {
        let bytes = std::fs::read(file).unwrap();
        let mut reference: Messages = mcap::MessageStream::new(&bytes)
            .unwrap()
            .map(|message| {
                let m = message.unwrap();
                (
                    m.channel.topic.clone(),
                    m.log_time as i64,
                    m.publish_time as i64,
                    m.data.into_owned(),
                )
            })
            .collect();
        reference.sort();
        assert!(read(file).unwrap() == reference, "{}", file.display());
        compared += reference.len();
    }
    assert!(compared > 80_000, "{compared} messages compared");
}

#[test]
fn with_and_without_summary_the_same_messages_come() {
    let Some(folder) = recording("mcap_real") else {
        return;
    };
    let indexed = Log::open(
        &folder.join("comma2k19_ros2_lz4.mcap"),
        ReadOptions::default(),
    )
    .unwrap();
    let streamed = Log::open(
        &folder.join("broken/no_summary.mcap"),
        ReadOptions::default(),
    )
    .unwrap();
    assert!(indexed.is_indexed() && !streamed.is_indexed());
    assert_eq!(indexed.topics(), streamed.topics());
    let messages = messages_of(&indexed).unwrap();
    assert_eq!(messages.len(), 6256 + 2 * 579);
    assert!(messages == messages_of(&streamed).unwrap());
    assert!(messages == read(&folder.join("comma2k19_ros2_none.mcap")).unwrap());
}

#[test]
fn messages_come_in_order_of_log_time_from_overlapping_chunks() {
    let mut file = std::io::Cursor::new(Vec::new());
    {
        let mut writer = mcap::WriteOptions::new()
            .chunk_size(Some(400))
            .create(&mut file)
            .unwrap();
        let channel = writer
            .add_channel(0, "/a", "raw", &BTreeMap::new())
            .unwrap();
        // Neither ordered within chunks nor between them: 7 is coprime to 101, so every time occurs once.
        for i in 0..101u64 {
            let time = i * 7 % 101;
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: 0,
                log_time: time,
                publish_time: time,
            };
            writer
                .write_to_known_channel(&header, &time.to_le_bytes())
                .unwrap();
        }
        writer.finish().unwrap();
    }
    let log = Log::from_bytes(
        Path::new("overlap.mcap"),
        file.into_inner(),
        ReadOptions::default(),
    )
    .unwrap();
    let mut times = Vec::new();
    log.each_message(&log.topics()[0], |message| -> Result<(), LogError> {
        assert_eq!(message.data, message.log_time.0.to_le_bytes());
        times.push(message.log_time.0);
        Ok(())
    })
    .unwrap();
    assert_eq!(times, (0..101).collect::<Vec<_>>());
}

#[test]
fn each_damage_has_its_own_error() {
    let Some(folder) = recording("mcap_real/broken") else {
        return;
    };
    for (name, code, says) in [
        (
            "bad_start_magic.mcap",
            "not_an_mcap",
            "first bytes are not the MCAP mark",
        ),
        ("empty.mcap", "not_an_mcap", "the file is empty"),
        (
            "flipped_byte_in_chunk.mcap",
            "crc",
            "checksum of the chunk at byte",
        ),
        (
            "huge_record_length.mcap",
            "damaged",
            "states a length of 4611686018427387904 bytes",
        ),
        ("no_end_magic.mcap", "truncated", "end mark at byte 490641"),
        (
            "summary_start_past_eof.mcap",
            "damaged",
            "the footer puts the summary at byte 1962596",
        ),
        (
            "truncated_60pct.mcap",
            "truncated",
            "chunk at byte 202386 is cut off",
        ),
        ("truncated_in_magic.mcap", "truncated", "start mark"),
    ] {
        let error = read(&folder.join(name)).unwrap_err();
        assert_eq!(error.code(), code, "{error}");
        assert!(
            error.to_string().contains(says) && error.to_string().contains(name),
            "{error}"
        );
        assert!(!error.remedy().is_empty());
    }
}

#[test]
fn recovery_keeps_what_is_readable_and_says_what_is_not() {
    let Some(folder) = recording("mcap_real/broken") else {
        return;
    };
    let whole = read(&folder.join("../comma2k19_ros2_lz4.mcap")).unwrap();
    let open = |name: &str| {
        let options = ReadOptions {
            recover: true,
            ..ReadOptions::default()
        };
        Log::open(&folder.join(name), options)
    };
    // All are of one recording of three chunks: how many of them are damaged, and what is said.
    for (name, lost_chunks, says) in [
        ("no_summary.mcap", 0, ""),
        ("bad_start_magic.mcap", 0, "the start mark is damaged"),
        (
            "flipped_byte_in_chunk.mcap",
            1,
            "chunk: checksum does not match",
        ),
        ("huge_record_length.mcap", 0, "states a wrong length"),
        ("no_end_magic.mcap", 0, "the end mark is missing"),
        (
            "summary_start_past_eof.mcap",
            0,
            "puts the summary at byte 1962596, which is outside",
        ),
        (
            "truncated_60pct.mcap",
            1,
            "chunk cut off by the end of the file",
        ),
    ] {
        let log = open(name).unwrap();
        let kept = messages_of(&log).unwrap();
        let recovery = log.recovery().unwrap();
        let account = recovery.account(insnav_core::time::Time(0));
        eprintln!("{name}: {account}");
        assert_eq!(recovery.chunks_lost, lost_chunks, "{name}: {account}");
        assert!(account.contains(says), "{name}: {account}");
        assert_eq!(recovery.is_clean(), name == "no_summary.mcap");
        assert_eq!(recovery.messages_kept, kept.len() as u64);
        if lost_chunks == 0 {
            assert!(kept == whole, "{name}: {account}");
        } else {
            let mut all = whole.iter();
            assert!(kept.iter().all(|m| all.any(|other| other == m)), "{name}");
            assert!(kept.len() > whole.len() / 3 && kept.len() < whole.len());
        }
        if let Some(missing) = recovery.messages_missing {
            assert_eq!(missing as usize, whole.len() - kept.len(), "{name}");
        }
    }
    for name in ["empty.mcap", "truncated_in_magic.mcap"] {
        let error = open(name).unwrap_err();
        assert!(!error.remedy().contains("--recover"), "{}", error.remedy());
    }
}

#[test]
fn other_files_are_named_for_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    for (bytes, says) in [
        (b"#ROSBAG V2.0\n".as_slice(), "ROS 1 bag"),
        (b"SQLite format 3\0..............", ".db3"),
        (b"t_s,gx,gy,gz\n0,0,0,0\n", "text file"),
        (&[0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 0], "gzip"),
    ] {
        let path = folder.path().join("x.mcap");
        std::fs::write(&path, bytes).unwrap();
        let error = read(&path).unwrap_err();
        assert_eq!(error.code(), "not_an_mcap");
        assert!(error.to_string().contains(says), "{error}");
    }
    assert_eq!(
        read(&folder.path().join("none.mcap")).unwrap_err().code(),
        "no_such_file"
    );
    assert_eq!(read(folder.path()).unwrap_err().code(), "not_readable");
}

mod damage {
    use super::*;
    use proptest::prelude::*;

    /// A small file with compressed and plain chunks' worth of structure: two topics, metadata, summary.
    fn small_file(compression: Option<mcap::Compression>, checksums: bool) -> Vec<u8> {
        let mut file = std::io::Cursor::new(Vec::new());
        {
            let mut writer = mcap::WriteOptions::new()
                .compression(compression)
                .compression_threads(0)
                .chunk_size(Some(300))
                .calculate_chunk_crcs(checksums)
                .calculate_data_section_crc(checksums)
                .calculate_summary_section_crc(checksums)
                .create(&mut file)
                .unwrap();
            let schema = writer
                .add_schema("std_msgs/msg/Header", "ros2msg", b"std_msgs/Header header")
                .unwrap();
            let a = writer
                .add_channel(schema, "/a", "cdr", &BTreeMap::new())
                .unwrap();
            let b = writer
                .add_channel(0, "/b", "raw", &BTreeMap::new())
                .unwrap();
            for i in 0..20u64 {
                let channel_id = if i % 2 == 0 { a } else { b };
                let header = mcap::records::MessageHeader {
                    channel_id,
                    sequence: 0,
                    log_time: i,
                    publish_time: i,
                };
                writer
                    .write_to_known_channel(
                        &header,
                        &[0, 1, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 1, 0, 0, 0, 0],
                    )
                    .unwrap();
            }
            writer.finish().unwrap();
        }
        file.into_inner()
    }

    fn survives(bytes: Vec<u8>) {
        if let Ok(log) = Log::from_bytes(Path::new("damaged.mcap"), bytes, ReadOptions::default()) {
            let _ = messages_of(&log);
            let _ = log.statistics();
        }
    }

    #[test]
    fn no_prefix_is_taken_for_a_whole_file() {
        for compression in [
            None,
            Some(mcap::Compression::Zstd),
            Some(mcap::Compression::Lz4),
        ] {
            let whole = small_file(compression, true);
            for length in 0..whole.len() {
                let prefix = whole[..length].to_vec();
                assert!(
                    Log::from_bytes(Path::new("p.mcap"), prefix, ReadOptions::default()).is_err(),
                    "{length}"
                );
            }
            assert!(Log::from_bytes(Path::new("p.mcap"), whole, ReadOptions::default()).is_ok());
        }
    }

    proptest! {
        #[test]
        fn no_corruption_makes_it_panic(
            kind in 0usize..3, checksums in any::<bool>(), places in proptest::collection::vec((any::<proptest::sample::Index>(), any::<u8>()), 1..8)
        ) {
            let mut bytes = small_file([None, Some(mcap::Compression::Zstd), Some(mcap::Compression::Lz4)][kind], checksums);
            for (place, value) in places {
                let at = place.index(bytes.len());
                bytes[at] = value;
            }
            survives(bytes);
        }
    }
}
