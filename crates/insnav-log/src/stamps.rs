//! The stamps of a topic, kept in four bytes each: a log of ten hours has millions.

/// Stamps in the order in which they came, ns: the first, and the steps between them.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stamps {
    first: Option<i64>,
    last: i64,
    /// A step of more than two seconds, forward or back, stands in `long`.
    steps: Vec<i32>,
    long: Vec<i64>,
}

/// Stands for the next step of `long`.
const LONG: i32 = i32::MIN;

impl Stamps {
    pub(crate) fn push(&mut self, stamp: i64) {
        if self.first.is_none() {
            self.first = Some(stamp);
        } else {
            let step = stamp.saturating_sub(self.last);
            match i32::try_from(step) {
                Ok(step) if step != LONG => self.steps.push(step),
                _ => {
                    self.steps.push(LONG);
                    self.long.push(step);
                }
            }
        }
        self.last = stamp;
    }

    pub(crate) fn len(&self) -> usize {
        self.steps.len() + usize::from(self.first.is_some())
    }

    /// Every step, with the stamps before and after it.
    pub(crate) fn steps(&self) -> impl Iterator<Item = (i64, [i64; 2])> + '_ {
        let mut stamp = self.first.unwrap_or_default();
        let mut long = self.long.iter();
        self.steps.iter().map(move |&step| {
            let step = match step {
                LONG => long.next().copied().unwrap_or_default(),
                step => i64::from(step),
            };
            let before = stamp;
            stamp = stamp.saturating_add(step);
            (step, [before, stamp])
        })
    }

    /// Earliest and latest.
    pub(crate) fn span(&self) -> Option<(i64, i64)> {
        let first = self.first?;
        Some(
            self.steps()
                .fold((first, first), |(min, max), (_, [_, to])| {
                    (min.min(to), max.max(to))
                }),
        )
    }

    /// The steps forward, by length.
    pub(crate) fn forward(&self) -> Forward {
        let mut short: Vec<i32> = self.steps.iter().copied().filter(|s| *s > 0).collect();
        let mut long: Vec<i64> = self.long.iter().copied().filter(|s| *s > 0).collect();
        short.sort_unstable();
        long.sort_unstable();
        Forward { short, long }
    }
}

/// Steps forward in the order of their length, ns.
pub(crate) struct Forward {
    short: Vec<i32>,
    /// All longer than any of `short`.
    long: Vec<i64>,
}

impl Forward {
    pub(crate) fn iter(&self) -> impl Iterator<Item = i64> + '_ {
        let short = self.short.iter().map(|s| i64::from(*s));
        short.chain(self.long.iter().copied())
    }

    /// The middle one, the upper of two.
    pub(crate) fn median(&self) -> Option<i64> {
        let middle = (self.short.len() + self.long.len()) / 2;
        match self.short.get(middle) {
            Some(short) => Some(i64::from(*short)),
            None => self.long.get(middle - self.short.len()).copied(),
        }
    }

    pub(crate) fn longest(&self) -> Option<i64> {
        let short = self.short.last().map(|s| i64::from(*s));
        self.long.last().copied().or(short)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_come_back_as_they_were() {
        let second = 1_000_000_000_i64;
        let stamps = [
            1_700_000_000 * second,
            1_700_000_000 * second + 5,
            1_700_000_000 * second + 5,
            1_700_000_000 * second - 7,
            // More than an i32 of nanoseconds, there and back; and the one step that stands for others.
            1_700_000_009 * second,
            1_700_000_000 * second,
            1_700_000_000 * second + i64::from(i32::MIN),
            0,
        ];
        let mut kept = Stamps::default();
        for stamp in stamps {
            kept.push(stamp);
        }
        assert_eq!(kept.len(), stamps.len());
        let pairs: Vec<[i64; 2]> = kept.steps().map(|(_, pair)| pair).collect();
        let expected: Vec<[i64; 2]> = stamps.windows(2).map(|w| [w[0], w[1]]).collect();
        assert_eq!(pairs, expected);
        assert!(kept.steps().all(|(step, [a, b])| step == b - a));
        assert_eq!(kept.span(), Some((0, 1_700_000_009 * second)));

        let forward = kept.forward();
        let mut sorted: Vec<i64> = kept.steps().map(|s| s.0).filter(|s| *s > 0).collect();
        sorted.sort_unstable();
        assert!(forward.iter().eq(sorted.iter().copied()));
        assert_eq!(forward.median(), sorted.get(sorted.len() / 2).copied());
        assert_eq!(forward.longest(), sorted.last().copied());
    }

    #[test]
    fn nothing_and_one_have_no_steps() {
        let mut kept = Stamps::default();
        assert_eq!((kept.len(), kept.span()), (0, None));
        kept.push(3);
        assert_eq!((kept.len(), kept.span()), (1, Some((3, 3))));
        assert_eq!(kept.forward().median(), None);
        assert_eq!(kept.forward().longest(), None);
    }
}
