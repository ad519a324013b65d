//! Every record of the MCAP project's own conformance files, as its JSON expectations say, read strictly and by recovery.

mod recordings;

use insnav_log::{Log, LogError, McapRecord, ReadOptions};
use recordings::recording;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Pairs of file and expectation.
fn files(folder: &Path) -> Vec<(PathBuf, Value)> {
    let mut files = Vec::new();
    for group in std::fs::read_dir(folder).unwrap() {
        let group = group.unwrap().path();
        if !group.is_dir() {
            continue;
        }
        for entry in std::fs::read_dir(group).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "json") {
                let text = std::fs::read(&path).unwrap();
                files.push((
                    path.with_extension("mcap"),
                    serde_json::from_slice(&text).unwrap(),
                ));
            }
        }
    }
    files.sort_by(|a, b| a.0.cmp(&b.0));
    files
}

/// A record as the expectations write it: fields in order of their names, numbers and bytes as text.
fn as_json(record: &McapRecord<'_>) -> Option<Value> {
    let text = |n: u64| json!(n.to_string());
    let bytes = |data: &[u8]| json!(data.iter().map(u8::to_string).collect::<Vec<_>>());
    let counts = |map: &BTreeMap<u16, u64>| {
        let pairs = map.iter().map(|(k, v)| (k.to_string(), v.to_string()));
        json!(pairs.collect::<BTreeMap<_, _>>())
    };
    let (name, mut fields) = match record {
        McapRecord::Header { profile, library } => (
            "Header",
            vec![("library", json!(library)), ("profile", json!(profile))],
        ),
        McapRecord::Footer {
            summary_start,
            summary_offset_start,
            summary_crc,
        } => (
            "Footer",
            vec![
                ("summary_start", text(*summary_start)),
                ("summary_offset_start", text(*summary_offset_start)),
                ("summary_crc", text(u64::from(*summary_crc))),
            ],
        ),
        McapRecord::Schema {
            id,
            name,
            encoding,
            data,
        } => (
            "Schema",
            vec![
                ("id", text(u64::from(*id))),
                ("name", json!(name)),
                ("encoding", json!(encoding)),
                ("data", bytes(data)),
            ],
        ),
        McapRecord::Channel {
            id,
            schema_id,
            topic,
            message_encoding,
            metadata,
        } => (
            "Channel",
            vec![
                ("id", text(u64::from(*id))),
                ("schema_id", text(u64::from(*schema_id))),
                ("topic", json!(topic)),
                ("message_encoding", json!(message_encoding)),
                ("metadata", json!(metadata)),
            ],
        ),
        McapRecord::Message {
            channel_id,
            sequence,
            log_time,
            publish_time,
            data,
        } => (
            "Message",
            vec![
                ("channel_id", text(u64::from(*channel_id))),
                ("sequence", text(u64::from(*sequence))),
                ("log_time", text(*log_time)),
                ("publish_time", text(*publish_time)),
                ("data", bytes(data)),
            ],
        ),
        McapRecord::Attachment {
            log_time,
            create_time,
            name,
            media_type,
            data,
            crc,
        } => {
            // The expectations leave the checksum out; it covers everything before itself.
            let mut covered = Vec::new();
            covered.extend(log_time.to_le_bytes());
            covered.extend(create_time.to_le_bytes());
            for string in [name, media_type] {
                covered.extend((string.len() as u32).to_le_bytes());
                covered.extend(string.as_bytes());
            }
            covered.extend((data.len() as u64).to_le_bytes());
            covered.extend(*data);
            assert!(*crc == 0 || *crc == crc32fast::hash(&covered));
            (
                "Attachment",
                vec![
                    ("log_time", text(*log_time)),
                    ("create_time", text(*create_time)),
                    ("name", json!(name)),
                    ("media_type", json!(media_type)),
                    ("data", bytes(data)),
                ],
            )
        }
        McapRecord::AttachmentIndex {
            offset,
            length,
            log_time,
            create_time,
            data_size,
            name,
            media_type,
        } => (
            "AttachmentIndex",
            vec![
                ("offset", text(*offset)),
                ("length", text(*length)),
                ("log_time", text(*log_time)),
                ("create_time", text(*create_time)),
                ("data_size", text(*data_size)),
                ("name", json!(name)),
                ("media_type", json!(media_type)),
            ],
        ),
        McapRecord::ChunkIndex {
            message_start_time,
            message_end_time,
            chunk_start_offset,
            chunk_length,
            message_index_offsets,
            message_index_length,
            compression,
            compressed_size,
            uncompressed_size,
        } => (
            "ChunkIndex",
            vec![
                ("message_start_time", text(*message_start_time)),
                ("message_end_time", text(*message_end_time)),
                ("chunk_start_offset", text(*chunk_start_offset)),
                ("chunk_length", text(*chunk_length)),
                ("message_index_offsets", counts(message_index_offsets)),
                ("message_index_length", text(*message_index_length)),
                ("compression", json!(compression)),
                ("compressed_size", text(*compressed_size)),
                ("uncompressed_size", text(*uncompressed_size)),
            ],
        ),
        McapRecord::Statistics {
            message_count,
            schema_count,
            channel_count,
            attachment_count,
            metadata_count,
            chunk_count,
            message_start_time,
            message_end_time,
            channel_message_counts,
        } => (
            "Statistics",
            vec![
                ("message_count", text(*message_count)),
                ("schema_count", text(u64::from(*schema_count))),
                ("channel_count", text(u64::from(*channel_count))),
                ("attachment_count", text(u64::from(*attachment_count))),
                ("metadata_count", text(u64::from(*metadata_count))),
                ("chunk_count", text(u64::from(*chunk_count))),
                ("message_start_time", text(*message_start_time)),
                ("message_end_time", text(*message_end_time)),
                ("channel_message_counts", counts(channel_message_counts)),
            ],
        ),
        McapRecord::Metadata { name, metadata } => (
            "Metadata",
            vec![("name", json!(name)), ("metadata", json!(metadata))],
        ),
        McapRecord::MetadataIndex {
            offset,
            length,
            name,
        } => (
            "MetadataIndex",
            vec![
                ("offset", text(*offset)),
                ("length", text(*length)),
                ("name", json!(name)),
            ],
        ),
        McapRecord::SummaryOffset {
            group_opcode,
            group_start,
            group_length,
        } => (
            "SummaryOffset",
            vec![
                ("group_opcode", text(u64::from(*group_opcode))),
                ("group_start", text(*group_start)),
                ("group_length", text(*group_length)),
            ],
        ),
        McapRecord::DataEnd { data_section_crc } => (
            "DataEnd",
            vec![("data_section_crc", text(u64::from(*data_section_crc)))],
        ),
        // Message indexes, and nothing else: the expectations are of a stream.
        McapRecord::Other { opcode: 0x07, .. } => return None,
        other => panic!("unexpected {other:?}"),
    };
    fields.sort_by_key(|(name, _)| *name);
    Some(json!({ "type": name, "fields": fields }))
}

fn open(path: &Path, recover: bool) -> Log {
    let options = ReadOptions {
        recover,
        ..ReadOptions::default()
    };
    Log::open(path, options).unwrap_or_else(|e| panic!("{e}"))
}

/// Topic, log time, publish time, bytes of every message, as the navigator's reader gives them: in order of time.
type Messages = Vec<(String, u64, u64, Vec<u8>)>;

fn messages_read(log: &Log) -> Messages {
    let mut all = Vec::new();
    for topic in log.topics() {
        let mut latest = 0;
        log.each_message(topic, |m| -> Result<(), LogError> {
            assert!(latest <= m.log_time.0);
            latest = m.log_time.0;
            let times = (m.log_time.0 as u64, m.publish_time.0 as u64);
            all.push((topic.name.clone(), times.0, times.1, m.data.to_vec()));
            Ok(())
        })
        .unwrap();
    }
    all.sort();
    all
}

fn messages_stated(expected: &Value) -> Messages {
    let mut topics = BTreeMap::new();
    let mut all = Vec::new();
    for record in expected["records"].as_array().unwrap() {
        let fields: BTreeMap<&str, &Value> = record["fields"]
            .as_array()
            .unwrap()
            .iter()
            .map(|f| (f[0].as_str().unwrap(), &f[1]))
            .collect();
        let number = |name: &str| fields[name].as_str().unwrap().parse::<u64>().unwrap();
        match record["type"].as_str().unwrap() {
            "Channel" => {
                topics.insert(number("id"), fields["topic"].as_str().unwrap().to_owned());
            }
            "Message" => all.push((
                topics[&number("channel_id")].clone(),
                number("log_time"),
                number("publish_time"),
                fields["data"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|b| b.as_str().unwrap().parse().unwrap())
                    .collect(),
            )),
            _ => {}
        }
    }
    all.sort();
    all
}

#[test]
fn every_record_of_every_file_is_as_its_project_says() {
    let Some(folder) = recording("mcap_conformance") else {
        return;
    };
    let files = files(&folder);
    assert_eq!(files.len(), 502);
    for (path, expected) in files {
        let mut records = Vec::new();
        open(&path, false)
            .each_record(|record| -> Result<(), LogError> {
                records.extend(as_json(record));
                Ok(())
            })
            .unwrap();
        assert_eq!(json!(records), expected["records"], "{}", path.display());
    }
}

#[test]
fn messages_are_the_same_by_index_as_stream_and_by_recovery() {
    let Some(folder) = recording("mcap_conformance") else {
        return;
    };
    let (mut indexed, mut with_index) = (0, 0);
    for (path, expected) in files(&folder) {
        let stated = messages_stated(&expected);
        let log = open(&path, false);
        assert_eq!(messages_read(&log), stated, "{}", path.display());
        let count: u64 = log.topics().iter().map(|t| t.count).sum();
        assert_eq!(count, stated.len() as u64, "{}", path.display());

        // The index serves where it is complete: statistics, and every definition that a channel needs, in the summary or
        // outside chunks.
        let features = expected["meta"]["variant"]["features"].as_array().unwrap();
        let has = |feature: &str| features.iter().any(|f| f == feature);
        let complete = has("st") && (stated.is_empty() || !has("ch") || (has("rsh") && has("rch")));
        assert_eq!(log.is_indexed(), complete, "{}", path.display());
        indexed += usize::from(log.is_indexed());
        with_index += usize::from(has("chx"));

        // Recovery opens every chunk and takes nothing from the summary but definitions.
        let stream = open(&path, true);
        assert!(!stream.is_indexed());
        let recovery = stream.recovery().unwrap();
        assert!(recovery.is_clean(), "{}: {recovery:?}", path.display());
        assert_eq!(recovery.messages_kept, stated.len() as u64);
        assert_eq!(messages_read(&stream), stated, "{}", path.display());
    }
    assert!(indexed > 100 && with_index > 100, "{indexed} {with_index}");
}
