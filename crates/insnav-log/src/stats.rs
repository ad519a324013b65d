//! How regular the topics of a log are: rate, jitter, gaps, duplicates, backward steps, header stamp against log time.

use crate::content::{Content, MessageReader, Stamp};
use crate::error::LogError;
use crate::findings::step_of;
use crate::log::{Log, TimeSource};
use crate::samples::{Unusable, gnss_position};
use crate::stamps::Stamps;
use crate::wire::DecodeError;
use insnav_core::time::Time;

/// An interval is a gap when it is longer than this many median intervals: beyond what jitter and one lost sample make.
const GAP_FACTOR: f64 = 5.0;

/// Regularity of one topic. Times are those that [`crate::ReadOptions`] choose: header stamps unless told otherwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TopicStatistics {
    /// Name of the topic.
    pub topic: String,
    /// Type of its messages.
    pub schema: String,
    /// Number of messages.
    pub count: u64,
    /// Earliest stamp.
    pub first: Option<Time>,
    /// Latest stamp.
    pub last: Option<Time>,
    /// Messages per second: one over the median interval.
    pub rate_hz: Option<f64>,
    /// Median interval, s.
    pub interval_median_s: Option<f64>,
    /// Longest interval, s.
    pub interval_max_s: Option<f64>,
    /// Standard deviation of the intervals that are no gaps, s.
    pub jitter_s: Option<f64>,
    /// Intervals longer than five medians: last stamp before, first after.
    pub gaps: Vec<(Time, Time)>,
    /// Messages with the stamp of their predecessor.
    pub duplicates: u64,
    /// Messages with an earlier stamp than their predecessor.
    pub backward_steps: u64,
    /// Header stamp minus log time, s: mean, least, greatest; `None` when there are no header stamps.
    pub header_minus_log_s: Option<Spread>,
    /// Messages whose header stamp is zero: the driver never set it.
    pub unstamped: u64,
    /// Messages whose bytes are not what their type says.
    pub undecodable: u64,
    /// Messages with NaN or infinity where a sensor's numbers are, or with a place that is none.
    pub not_finite: u64,
    /// Of these, positions with a latitude beyond ±90°.
    pub no_place: u64,
    /// Latitude and longitude of the first of them, degrees.
    pub first_no_place_deg: Option<[f64; 2]>,
    /// Positions for which the receiver says that it has no fix.
    pub no_fix: u64,
    /// Positions whose latitude and longitude are exactly zero.
    pub zero_position: u64,
    /// Messages that should be between others: intervals of two to five medians, counted by how many would fit.
    pub missing: u64,
    /// Where the stamps jump against the recorder's clock for good.
    pub clock_step: Option<ClockStep>,
    /// How the stamps drift against the recorder's clock, where that is more than good oscillators do.
    pub clock_drift: Option<ClockDrift>,
}

/// A jump of a topic's stamps against the recorder's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockStep {
    /// When, on the recorder's clock.
    pub at: Time,
    /// By how much the stamps jump ahead, s.
    pub size_s: f64,
}

/// A drift of a topic's stamps against the recorder's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockDrift {
    /// Seconds per second that the stamps gain.
    pub rate: f64,
    /// Over the whole log, s.
    pub total_s: f64,
}

/// Middle and range of a quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Arithmetic mean.
    pub mean: f64,
    /// Median of the greatest value of each second: delays, which only make values less, are mostly not in it.
    pub median: f64,
    /// Least value.
    pub min: f64,
    /// Greatest value.
    pub max: f64,
}

#[derive(Default)]
struct Collected {
    reader: Option<MessageReader>,
    /// What is added to stamps on the sensor's own clock, ns.
    clock_shift: i64,
    stamps: Stamps,
    offset_sum: f64,
    offset_min: f64,
    offset_max: f64,
    offsets: u64,
    /// Second of log time, and the greatest stamp minus log time in it.
    levels: Vec<(Time, f64)>,
    statistics: TopicStatistics,
}

impl Log {
    /// Regularity of every topic, in the order of [`Log::topics`]: one pass over the whole log.
    pub fn statistics(&self) -> Result<Vec<TopicStatistics>, LogError> {
        let mut by_channel = Vec::new();
        let mut topics: Vec<Collected> = Vec::new();
        for (index, topic) in self.topics().iter().enumerate() {
            for id in &topic.channels {
                let id = usize::from(*id);
                if by_channel.len() <= id {
                    by_channel.resize(id + 1, 0);
                }
                by_channel[id] = index;
            }
            topics.push(Collected {
                reader: topic.kind.and_then(|_| self.reader(index).ok()),
                clock_shift: self.clock_shift(index)?,
                statistics: TopicStatistics {
                    topic: topic.name.clone(),
                    schema: topic.schema.clone(),
                    ..TopicStatistics::default()
                },
                ..Collected::default()
            });
        }
        let all: Vec<usize> = (0..topics.len()).collect();
        let mut messages = self.messages(&all);
        while let Some(message) = messages.next() {
            let message = message?;
            let index = by_channel[usize::from(message.channel)];
            let topic = &mut topics[index];
            let used = match self.options().time_source {
                TimeSource::Header => None,
                TimeSource::Log => Some(message.log_time),
                TimeSource::Publish => Some(message.publish_time),
            };
            if topic.add(message.data, message.log_time, used).is_err() {
                topic.statistics.undecodable += 1;
            }
        }
        Ok(topics.into_iter().map(Collected::finish).collect())
    }
}

impl Collected {
    /// Take a message; `used` is the time that the options choose where they do not choose its own stamp.
    fn add(&mut self, data: &[u8], log_time: Time, used: Option<Time>) -> Result<(), DecodeError> {
        let without_stamp = used.unwrap_or(log_time);
        let Some(reader) = &mut self.reader else {
            self.stamps.push(without_stamp.0);
            return Ok(());
        };
        let content = match reader.content(data) {
            Ok(content) => content,
            Err(error) => {
                self.stamps.push(without_stamp.0);
                return Err(error);
            }
        };
        let stamp = Time(match content.stamp {
            Stamp::Absent => {
                self.stamps.push(without_stamp.0);
                self.statistics.add(&content, without_stamp);
                return Ok(());
            }
            Stamp::Host(time) => time.0,
            Stamp::Own(time) => time.0.saturating_add(self.clock_shift),
        });
        let time = match used {
            Some(used) => used,
            None if stamp.0 == 0 => log_time,
            None => stamp,
        };
        self.stamps.push(time.0);
        if stamp.0 == 0 {
            self.statistics.unstamped += 1;
        } else {
            let offset = stamp.since(log_time);
            (self.offset_min, self.offset_max) = if self.offsets == 0 {
                (offset, offset)
            } else {
                (self.offset_min.min(offset), self.offset_max.max(offset))
            };
            self.offset_sum += offset;
            self.offsets += 1;
            let same_second = |last: &&mut (Time, f64)| {
                last.0.0.div_euclid(1_000_000_000) == log_time.0.div_euclid(1_000_000_000)
            };
            match self.levels.last_mut().filter(same_second) {
                Some(level) => level.1 = level.1.max(offset),
                None => self.levels.push((log_time, offset)),
            }
        }
        self.statistics.add(&content, time);
        Ok(())
    }

    fn finish(self) -> TopicStatistics {
        let mut statistics = self.statistics;
        let stamps = &self.stamps;
        statistics.count = stamps.len() as u64;
        if let Some((first, last)) = stamps.span() {
            (statistics.first, statistics.last) = (Some(Time(first)), Some(Time(last)));
        }
        if self.offsets > 0 {
            let mean = self.offset_sum / self.offsets as f64;
            let mut levels: Vec<f64> = self.levels.iter().map(|l| l.1).collect();
            let middle = levels.len() / 2;
            let median = *levels.select_nth_unstable_by(middle, f64::total_cmp).1;
            statistics.clock_step =
                step_of(&self.levels).map(|(at, size_s)| ClockStep { at, size_s });
            statistics.clock_drift = match statistics.clock_step {
                Some(_) => None,
                None => drift_of(&self.levels),
            };
            statistics.header_minus_log_s = Some(Spread {
                mean,
                median,
                min: self.offset_min,
                max: self.offset_max,
            });
        }
        let count = |counted: fn(i64) -> bool| {
            let steps = stamps.steps().filter(|(step, _)| counted(*step));
            steps.count() as u64
        };
        statistics.duplicates = count(|step| step == 0);
        statistics.backward_steps = count(|step| step < 0);
        let forward = stamps.forward();
        let Some(median) = forward.median() else {
            return statistics;
        };
        let median_s = median as f64 * 1e-9;
        let longest_regular = (median as f64 * GAP_FACTOR) as i64;
        statistics.gaps = stamps
            .steps()
            .filter(|(step, _)| *step > longest_regular)
            .map(|(_, pair)| (Time(pair[0]), Time(pair[1])))
            .collect();
        let regular = || {
            let steps = forward.iter().take_while(|step| *step <= longest_regular);
            steps.map(|step| step as f64 * 1e-9)
        };
        let count = regular().count() as f64;
        let mean = regular().sum::<f64>() / count;
        let variance = regular().map(|step| (step - mean).powi(2)).sum::<f64>() / count;
        statistics.missing = stamps
            .steps()
            .map(|(step, _)| step as f64 / median as f64)
            .filter(|steps| (1.6..=GAP_FACTOR).contains(steps))
            .map(|steps| steps.round() as u64 - 1)
            .sum();
        statistics.rate_hz = Some(1.0 / median_s);
        statistics.interval_median_s = Some(median_s);
        statistics.interval_max_s = forward.longest().map(|step| step as f64 * 1e-9);
        statistics.jitter_s = Some(variance.sqrt());
        statistics
    }
}

impl TopicStatistics {
    /// Count what is wrong with a message's content.
    fn add(&mut self, content: &Content<'_>, time: Time) {
        self.not_finite += u64::from(!content.is_finite());
        if let Some(fix) = &content.position {
            match gnss_position(fix, time, 0.0) {
                Ok(_) => {}
                Err(Unusable::NoFix) => self.no_fix += 1,
                Err(Unusable::NotFinite) => {
                    self.not_finite += 1;
                    let at = [fix.latitude_deg, fix.longitude_deg];
                    if at.iter().all(|x| x.is_finite()) && fix.height_m.is_finite() {
                        self.no_place += 1;
                        self.first_no_place_deg.get_or_insert(at);
                    }
                }
                Err(Unusable::ZeroPosition) => self.zero_position += 1,
            }
        }
    }
}

/// A straight line through the levels, where it is steeper than an oscillator's tolerance and holds throughout.
fn drift_of(levels: &[(Time, f64)]) -> Option<ClockDrift> {
    /// Crystals keep within 50 to 100 parts in a million.
    const TOLERANCE: f64 = 150e-6;
    /// What a drift must come to, s: twice what is worth a word as an offset.
    const LEAST: f64 = 0.02;
    let (first, last) = (levels.first()?, levels.last()?);
    let length = last.0.since(first.0);
    let n = levels.len() as f64;
    let points = || levels.iter().map(|l| (l.0.since(first.0), l.1));
    let (mt, ml) = points().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let (tt, tl) = points().fold((0.0, 0.0), |s, p| {
        (s.0 + (p.0 - mt).powi(2), s.1 + (p.0 - mt) * (p.1 - ml))
    });
    let rate = tl / tt;
    let residual = (points()
        .map(|p| (p.1 - ml - rate * (p.0 - mt)).powi(2))
        .sum::<f64>()
        / n)
        .sqrt();
    let total_s = rate * length;
    (levels.len() >= 20 && rate.abs() > TOLERANCE && total_s.abs() > LEAST.max(10.0 * residual))
        .then_some(ClockDrift { rate, total_s })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn collected(stamps: impl IntoIterator<Item = i64>) -> TopicStatistics {
        let mut collected = Collected::default();
        for stamp in stamps {
            collected.stamps.push(stamp);
        }
        collected.finish()
    }

    #[test]
    fn gaps_duplicates_and_backward_steps_are_told_apart() {
        let ms = 1_000_000;
        let mut times: Vec<i64> = (0..100).map(|i| i * 10 * ms).collect();
        times.push(times[99]); // a duplicate
        times.push(times[99] - 5 * ms); // a step back
        times.push(times[99] + 10 * ms);
        times.push(times[99] + 310 * ms); // a gap of 300 ms
        let statistics = collected(times);
        assert_eq!(
            (
                statistics.count,
                statistics.duplicates,
                statistics.backward_steps
            ),
            (104, 1, 1)
        );
        assert_eq!(statistics.gaps, [(Time(1000 * ms), Time(1300 * ms))]);
        assert_eq!(statistics.rate_hz, Some(100.0));
        assert!((statistics.interval_max_s.unwrap() - 0.3).abs() < 1e-12);
        // 99 intervals of 10 ms and one of 15 ms.
        let mean: f64 = (99.0 * 0.010 + 0.015) / 100.0;
        let variance = (99.0 * (0.010 - mean).powi(2) + (0.015 - mean).powi(2)) / 100.0;
        assert!((statistics.jitter_s.unwrap() - variance.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_topic_without_two_messages_has_no_rate() {
        let statistics = collected([5]);
        assert_eq!(
            (statistics.count, statistics.rate_hz, statistics.first),
            (1, None, Some(Time(5)))
        );
        assert_eq!(Collected::default().finish().first, None);
    }
}
