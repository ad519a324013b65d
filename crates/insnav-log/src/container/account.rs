//! The account of what recovery kept and what it did not.

use insnav_core::time::Time;

/// A stretch of a file that could not be kept, or not as a whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Loss {
    /// Where it begins, bytes.
    pub offset: u64,
    /// How long it is, bytes.
    pub length: u64,
    /// What is wrong there.
    pub what: String,
    /// Messages of it that were kept.
    pub kept: u64,
    /// Log time of the last message that was kept before it; `None` when there is none.
    pub after: Option<Time>,
    /// Log time of the first message that was kept behind it; `None` when there is none.
    pub before: Option<Time>,
}

/// What recovery kept and what it did not.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recovery {
    /// Stretches that were lost, in order.
    pub losses: Vec<Loss>,
    /// What else is wrong with the file, without loss of messages as far as can be told.
    pub remarks: Vec<String>,
    /// Messages kept.
    pub messages_kept: u64,
    /// Messages that an intact summary counts and that are not there; `None` when there is no such summary.
    pub messages_missing: Option<u64>,
    /// Chunks kept, those cut off by the end of the file not counted.
    pub chunks_kept: u64,
    /// Chunks known to be lost or cut off.
    pub chunks_lost: u64,
}

impl Recovery {
    /// True when the file is whole.
    pub fn is_clean(&self) -> bool {
        self.losses.is_empty()
            && self.remarks.is_empty()
            && self.messages_missing.is_none_or(|n| n == 0)
    }

    /// Bytes in stretches that were lost.
    pub fn bytes_lost(&self) -> u64 {
        self.losses.iter().map(|loss| loss.length).sum()
    }

    /// The account in words, seconds counted from `zero`.
    pub fn account(&self, zero: Time) -> String {
        let mut parts = Vec::new();
        for loss in &self.losses {
            let kept = match loss.kept {
                0 => String::new(),
                n => format!(", {n} messages of it kept"),
            };
            let seconds = |t: Time| format!("{:.2} s", t.since(zero));
            let span = match (loss.after, loss.before) {
                (Some(a), Some(b)) => format!(", between {} and {}", seconds(a), seconds(b)),
                (Some(a), None) => format!(", after {}", seconds(a)),
                (None, Some(b)) => format!(", before {}", seconds(b)),
                (None, None) => String::new(),
            };
            parts.push(format!(
                "{} bytes at byte {} ({}{kept}{span})",
                loss.length, loss.offset, loss.what
            ));
        }
        let lost = if parts.is_empty() {
            "no message lost".to_owned()
        } else {
            format!("lost: {}", parts.join("; "))
        };
        let missing = match self.messages_missing {
            Some(n) if n > 0 => {
                format!("; {n} of the messages that the summary counts are missing")
            }
            _ => String::new(),
        };
        let remarks: String = self.remarks.iter().map(|r| format!("; {r}")).collect();
        format!(
            "{} messages kept in {} whole chunks, {} chunks damaged; {lost}{missing}{remarks}",
            self.messages_kept, self.chunks_kept, self.chunks_lost
        )
    }
}
