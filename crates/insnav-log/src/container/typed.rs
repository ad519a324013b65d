//! Records with their fields named, for whoever looks at the container itself.

use super::records::{Fields, MessageRecord, Record, opcode};
use std::collections::BTreeMap;

/// A record of an MCAP file (\[MCAP\] "Records"). Times are nanoseconds, offsets and lengths bytes.
///
/// Fields beyond those of the specification's version 0 are skipped, as it asks for.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs)] // Names and meanings are those of the specification, one by one.
#[non_exhaustive]
pub enum McapRecord<'a> {
    Header {
        profile: &'a str,
        library: &'a str,
    },
    Footer {
        summary_start: u64,
        summary_offset_start: u64,
        summary_crc: u32,
    },
    Schema {
        id: u16,
        name: &'a str,
        encoding: &'a str,
        data: &'a [u8],
    },
    Channel {
        id: u16,
        schema_id: u16,
        topic: &'a str,
        message_encoding: &'a str,
        metadata: BTreeMap<String, String>,
    },
    Message {
        channel_id: u16,
        sequence: u32,
        log_time: u64,
        publish_time: u64,
        data: &'a [u8],
    },
    Attachment {
        log_time: u64,
        create_time: u64,
        name: &'a str,
        media_type: &'a str,
        data: &'a [u8],
        crc: u32,
    },
    AttachmentIndex {
        offset: u64,
        length: u64,
        log_time: u64,
        create_time: u64,
        data_size: u64,
        name: &'a str,
        media_type: &'a str,
    },
    ChunkIndex {
        message_start_time: u64,
        message_end_time: u64,
        chunk_start_offset: u64,
        chunk_length: u64,
        message_index_offsets: BTreeMap<u16, u64>,
        message_index_length: u64,
        compression: &'a str,
        compressed_size: u64,
        uncompressed_size: u64,
    },
    Statistics {
        message_count: u64,
        schema_count: u16,
        channel_count: u32,
        attachment_count: u32,
        metadata_count: u32,
        chunk_count: u32,
        message_start_time: u64,
        message_end_time: u64,
        channel_message_counts: BTreeMap<u16, u64>,
    },
    Metadata {
        name: &'a str,
        metadata: BTreeMap<String, String>,
    },
    MetadataIndex {
        offset: u64,
        length: u64,
        name: &'a str,
    },
    SummaryOffset {
        group_opcode: u8,
        group_start: u64,
        group_length: u64,
    },
    DataEnd {
        data_section_crc: u32,
    },
    /// A chunk, a message index, or a record of an opcode that version 0 does not know.
    Other {
        opcode: u8,
        body: &'a [u8],
    },
}

impl<'a> McapRecord<'a> {
    /// Name the fields; `None` when the body is too short or a string no UTF-8.
    pub(crate) fn parse(record: &Record<'a>) -> Option<Self> {
        parse(record).map(|(record, _)| record)
    }

    /// As [`McapRecord::parse`], with the number of bytes behind the last known field.
    pub(crate) fn parse_with_rest(record: &Record<'a>) -> Option<(Self, usize)> {
        parse(record)
    }
}

fn parse<'a>(record: &Record<'a>) -> Option<(McapRecord<'a>, usize)> {
    let mut f = Fields(record.body);
    let named = match record.opcode {
        opcode::HEADER => McapRecord::Header {
            profile: f.string()?,
            library: f.string()?,
        },
        opcode::FOOTER => McapRecord::Footer {
            summary_start: f.u64()?,
            summary_offset_start: f.u64()?,
            summary_crc: f.u32()?,
        },
        opcode::SCHEMA => McapRecord::Schema {
            id: f.u16()?,
            name: f.string()?,
            encoding: f.string()?,
            data: f.bytes()?,
        },
        opcode::CHANNEL => McapRecord::Channel {
            id: f.u16()?,
            schema_id: f.u16()?,
            topic: f.string()?,
            message_encoding: f.string()?,
            metadata: f.string_map()?,
        },
        opcode::MESSAGE => {
            let message = MessageRecord::parse(record.body)?;
            f.u16()?;
            let sequence = f.u32()?;
            f.0 = &[];
            McapRecord::Message {
                channel_id: message.channel,
                sequence,
                log_time: message.log_time,
                publish_time: message.publish_time,
                data: message.data,
            }
        }
        opcode::ATTACHMENT => McapRecord::Attachment {
            log_time: f.u64()?,
            create_time: f.u64()?,
            name: f.string()?,
            media_type: f.string()?,
            data: f.long_bytes()?,
            crc: f.u32()?,
        },
        opcode::ATTACHMENT_INDEX => McapRecord::AttachmentIndex {
            offset: f.u64()?,
            length: f.u64()?,
            log_time: f.u64()?,
            create_time: f.u64()?,
            data_size: f.u64()?,
            name: f.string()?,
            media_type: f.string()?,
        },
        opcode::CHUNK_INDEX => McapRecord::ChunkIndex {
            message_start_time: f.u64()?,
            message_end_time: f.u64()?,
            chunk_start_offset: f.u64()?,
            chunk_length: f.u64()?,
            message_index_offsets: f.count_map()?,
            message_index_length: f.u64()?,
            compression: f.string()?,
            compressed_size: f.u64()?,
            uncompressed_size: f.u64()?,
        },
        opcode::STATISTICS => McapRecord::Statistics {
            message_count: f.u64()?,
            schema_count: f.u16()?,
            channel_count: f.u32()?,
            attachment_count: f.u32()?,
            metadata_count: f.u32()?,
            chunk_count: f.u32()?,
            message_start_time: f.u64()?,
            message_end_time: f.u64()?,
            channel_message_counts: f.count_map()?,
        },
        opcode::METADATA => McapRecord::Metadata {
            name: f.string()?,
            metadata: f.string_map()?,
        },
        opcode::METADATA_INDEX => McapRecord::MetadataIndex {
            offset: f.u64()?,
            length: f.u64()?,
            name: f.string()?,
        },
        opcode::SUMMARY_OFFSET => McapRecord::SummaryOffset {
            group_opcode: f.u8()?,
            group_start: f.u64()?,
            group_length: f.u64()?,
        },
        opcode::DATA_END => McapRecord::DataEnd {
            data_section_crc: f.u32()?,
        },
        opcode => {
            f.0 = &[];
            McapRecord::Other {
                opcode,
                body: record.body,
            }
        }
    };
    Some((named, f.0.len()))
}
