//! Where samples come from and where a solution goes.

use super::RunError;
use super::oddities::facts_of_log;
use crate::samples::{ReaderState, Samples};
use crate::sink::SinkState;
use crate::{Log, McapSink, Mounting, Role, SourceFacts};
use insnav_core::sample::{GnssPosition, Sample};
use insnav_core::solution::Sink;
use insnav_core::time::Time;
use nalgebra::Vector3;

/// Samples on their way to the navigator, and what still waits behind them.
pub trait Stream: Iterator<Item = Result<Sample, RunError>> {
    /// What the stream of the next log has to know, after the last sample.
    fn state(&self) -> ReaderState;
}

/// Of a source that keeps nothing back.
struct Plain<I>(I);

impl<I: Iterator> Iterator for Plain<I> {
    type Item = I::Item;

    fn next(&mut self) -> Option<I::Item> {
        self.0.next()
    }
}

impl<I: Iterator<Item = Result<Sample, RunError>>> Stream for Plain<I> {
    fn state(&self) -> ReaderState {
        ReaderState::default()
    }
}

/// Of a log.
struct LogStream<'a>(Samples<'a>);

impl Iterator for LogStream<'_> {
    type Item = Result<Sample, RunError>;

    fn next(&mut self) -> Option<Self::Item> {
        Some(self.0.next()?.map_err(RunError::from))
    }
}

impl Stream for LogStream<'_> {
    fn state(&self) -> ReaderState {
        self.0.state()
    }
}

/// Samples that can be read more than once: a log, or arrays in memory.
pub trait Source {
    /// The samples from the beginning, in about the order of time.
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError>;

    /// The samples once more, from where another source of the same drive stopped if `from` is given; with `hold`, what may
    /// have to wait for samples of the next source is kept for it.
    fn stream(
        &self,
        from: Option<&ReaderState>,
        hold: bool,
    ) -> Result<Box<dyn Stream + '_>, RunError> {
        // Without a window of its own a source has nothing to take over or to keep.
        let _ = (from, hold);
        Ok(Box::new(Plain(self.samples()?)))
    }

    /// How the source is read, where that changes its samples: a run is resumed with the same only.
    fn reading(&self) -> String {
        String::new()
    }

    /// Instant from which seconds count; `None`: the first inertial stamp.
    fn origin(&self) -> Result<Option<Time>, RunError> {
        Ok(None)
    }

    /// Antenna from the IMU, forward-right-down, m, where the source knows it.
    fn lever_arm_b(&self) -> Result<Option<Vector3<f64>>, RunError> {
        Ok(None)
    }

    /// The topic that declares standing, if the user names one.
    fn standing_topic(&self) -> Option<String> {
        None
    }

    /// How the IMU is mounted, where the source says it and the user does not. The samples are turned by it already.
    fn mounting(&self) -> Result<Option<Mounting>, RunError> {
        Ok(None)
    }

    /// What the source tells besides its samples, for findings.
    fn facts(&self) -> Result<SourceFacts, RunError> {
        Ok(SourceFacts::default())
    }

    /// Refuse a source that has no inertial data or no positions, if that can be told without reading it.
    fn check(&self) -> Result<(), RunError> {
        Ok(())
    }
}

impl Source for Log {
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError> {
        Ok(Box::new(
            Log::samples(self)?.map(|s| s.map_err(RunError::from)),
        ))
    }

    fn stream(
        &self,
        from: Option<&ReaderState>,
        hold: bool,
    ) -> Result<Box<dyn Stream + '_>, RunError> {
        let mut samples = Log::samples(self)?;
        if let Some(state) = from {
            samples.resume(state);
        }
        if hold {
            samples.hold_at_end();
        }
        Ok(Box::new(LogStream(samples)))
    }

    fn reading(&self) -> String {
        let o = self.options();
        // A log that cannot be read says so where it is.
        let mounting = self.mounting_rpy_deg().unwrap_or_default();
        format!(
            "axes {:?}, mounting {:?}, units {:?}, velocity {:?}, stamps {:?}, window {} s, geoid {} m, standing by {}",
            o.imu_axes,
            mounting,
            o.imu_units,
            o.gnss_velocity_axes,
            o.time_source,
            o.reorder_window_s,
            o.geoid_height_m,
            self.standing_topic().unwrap_or("no topic")
        )
    }

    fn origin(&self) -> Result<Option<Time>, RunError> {
        Ok(self.t0()?)
    }

    fn lever_arm_b(&self) -> Result<Option<Vector3<f64>>, RunError> {
        Ok(Log::lever_arm_b(self)?)
    }

    fn standing_topic(&self) -> Option<String> {
        Log::standing_topic(self).map(str::to_owned)
    }

    fn mounting(&self) -> Result<Option<Mounting>, RunError> {
        Ok(Log::mounting(self)?.cloned())
    }

    fn facts(&self) -> Result<SourceFacts, RunError> {
        facts_of_log(self)
    }

    fn check(&self) -> Result<(), RunError> {
        self.require(Role::Imu)?;
        if !self.options().leaves_out(Role::GnssPosition) {
            self.require(Role::GnssPosition)?;
        }
        self.optional(Role::GnssVelocity)?;
        self.optional(Role::Standing)?;
        Ok(())
    }
}

impl Source for [Sample] {
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError> {
        Ok(Box::new(self.iter().copied().map(Ok)))
    }
}

impl Source for Vec<Sample> {
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError> {
        self.as_slice().samples()
    }
}

/// A sink that also wants to know what the navigator did not get.
pub trait SolutionSink: Sink {
    /// A position was withheld.
    fn withheld(&mut self, _fix: &GnssPosition) {}

    /// Why the solution could not be kept, if so: asked all the time, so that a full disk ends a run soon.
    fn failure(&mut self) -> Option<RunError> {
        None
    }

    /// What the sink of the next part of a drive has to know.
    fn state(&self) -> Option<SinkState> {
        None
    }

    /// Go on where the sink of the part before stopped.
    fn resume(&mut self, _state: &SinkState) {}
}

impl SolutionSink for () {}

impl SolutionSink for McapSink {
    fn withheld(&mut self, fix: &GnssPosition) {
        McapSink::withheld(self, fix);
    }

    fn failure(&mut self) -> Option<RunError> {
        self.take_failure().map(RunError::Log)
    }

    fn state(&self) -> Option<SinkState> {
        Some(McapSink::state(self))
    }

    fn resume(&mut self, state: &SinkState) {
        McapSink::resume(self, state);
    }
}
