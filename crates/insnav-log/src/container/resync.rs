//! Whether bytes are a record, and where the next one is.

use super::records::{Fields, MAGIC, PREFIX, Record, Records, opcode};
use super::section::Compression;
use super::typed::McapRecord;

/// Bytes behind the last known field of a record; `None` when it is not what its opcode says. Of a record with an unknown
/// opcode nothing can be said.
pub(super) fn rest(record: &Record<'_>) -> Option<usize> {
    let mut fields = Fields(record.body);
    match record.opcode {
        0 => None,
        opcode::CHUNK => {
            fields.u64().and(fields.u64()).and(fields.u64())?;
            fields.u32()?;
            Compression::by_name(fields.string()?)?;
            fields.long_bytes()?;
            Some(fields.0.len())
        }
        opcode::MESSAGE_INDEX => {
            fields.u16()?;
            let entries = fields.bytes()?;
            entries.len().is_multiple_of(16).then_some(fields.0.len())
        }
        // Readers find it by its length from the end of the file.
        opcode::FOOTER => (record.body.len() == 20).then_some(0),
        op if op > opcode::DATA_END => Some(usize::MAX),
        _ => McapRecord::parse_with_rest(record).map(|(_, rest)| rest),
    }
}

/// Whether a record may begin at `at`, or the file ends there.
pub(super) fn plausible(bytes: &[u8], at: usize) -> bool {
    match bytes.get(at..) {
        None => return false,
        Some(rest) if MAGIC.starts_with(rest) => return true,
        Some(_) => {}
    }
    match Records::new(bytes, at).next() {
        Some(Ok(record)) => record.opcode <= opcode::DATA_END && rest(&record).is_some(),
        Some(Err(cut)) => cut
            .prefix
            .is_none_or(|(op, length)| (1..=opcode::DATA_END).contains(&op) && length < 1 << 40),
        None => true,
    }
}

/// How many records must follow each other to be believed after damage.
const CHAIN: usize = 3;

/// The next place from which records follow each other.
pub(super) fn resync(bytes: &[u8], from: usize) -> Option<usize> {
    (from..bytes.len()).find(|&at| {
        let mut next = at;
        for _ in 0..CHAIN {
            let Some(Ok(record)) = Records::new(bytes, next).next() else {
                return next > at && plausible(bytes, next);
            };
            if record.opcode > opcode::DATA_END || rest(&record).is_none() {
                return false;
            }
            next += PREFIX + record.body.len();
            if bytes[next..] == *MAGIC {
                return true;
            }
        }
        true
    })
}
