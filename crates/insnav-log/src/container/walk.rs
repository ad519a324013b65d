//! Every record of a file in order, those inside chunks where their chunk is.

use super::integrity::{cut_in_chunk, cut_off, record_name};
use super::messages::Unpacker;
use super::records::{MAGIC, Record, Records, opcode};
use super::section::chunk_section;
use super::typed::McapRecord;
use crate::error::LogError;
use std::path::Path;

/// Call `each` with every record of a file that is whole.
pub(crate) fn each_record<E: From<LogError>>(
    bytes: &[u8],
    path: &Path,
    mut each: impl FnMut(&McapRecord<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let (mut unpacker, mut buffer) = (Unpacker::default(), Vec::new());
    for record in Records::new(bytes, MAGIC.len()) {
        let record = record.map_err(|cut| cut_off(bytes, path, cut))?;
        if record.opcode == opcode::CHUNK {
            let section = chunk_section(&record, path, usize::MAX)?;
            for inner in Records::new(unpacker.unpack(&section, bytes, &mut buffer, path)?, 0) {
                let inner = inner.map_err(|_| cut_in_chunk(&section, path))?;
                each(&named(&inner, path)?)?;
            }
            continue;
        }
        each(&named(&record, path)?)?;
        if record.opcode == opcode::FOOTER {
            break;
        }
    }
    Ok(())
}

fn named<'a>(record: &Record<'a>, path: &Path) -> Result<McapRecord<'a>, LogError> {
    McapRecord::parse(record).ok_or_else(|| LogError::Damaged {
        path: path.into(),
        offset: record.offset as u64,
        reason: format!("{} does not parse", record_name(record.opcode)),
    })
}
