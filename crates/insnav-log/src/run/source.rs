//! Where samples come from and where a solution goes.

use super::RunError;
use super::oddities::oddities_of_log;
use super::report::Warning;
use crate::{Log, McapSink, Role};
use insnav_core::sample::{GnssPosition, Sample};
use insnav_core::solution::Sink;
use insnav_core::time::Time;
use nalgebra::Vector3;

/// Samples that can be read more than once: a log, or arrays in memory.
pub trait Source {
    /// The samples from the beginning, in about the order of time.
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError>;

    /// Instant from which seconds count; `None`: the first inertial stamp.
    fn origin(&self) -> Result<Option<Time>, RunError> {
        Ok(None)
    }

    /// Antenna from the IMU, forward-right-down, m, where the source knows it.
    fn lever_arm_b(&self) -> Result<Option<Vector3<f64>>, RunError> {
        Ok(None)
    }

    /// What is odd about the data before they become samples.
    fn oddities(&self) -> Result<Vec<Warning>, RunError> {
        Ok(Vec::new())
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

    fn origin(&self) -> Result<Option<Time>, RunError> {
        Ok(self.t0()?)
    }

    fn lever_arm_b(&self) -> Result<Option<Vector3<f64>>, RunError> {
        Ok(Log::lever_arm_b(self)?)
    }

    fn oddities(&self) -> Result<Vec<Warning>, RunError> {
        oddities_of_log(self)
    }

    fn check(&self) -> Result<(), RunError> {
        self.require(Role::Imu)?;
        self.require(Role::GnssPosition)?;
        self.optional(Role::GnssVelocity)?;
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

    /// Why the solution could not be kept, if so: asked now and then, so that a full disk ends a run.
    fn failure(&mut self) -> Option<RunError> {
        None
    }
}

impl SolutionSink for () {}

impl SolutionSink for McapSink {
    fn withheld(&mut self, fix: &GnssPosition) {
        McapSink::withheld(self, fix);
    }
}
