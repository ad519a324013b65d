//! One run into a file (if wanted) and into memory.

use insnav_core::filter::Update;
use insnav_core::sample::GnssPosition;
use insnav_core::solution::{Epoch, Event, Sink};
use insnav_core::time::Time;
use insnav_log::ros2::State;
use insnav_log::{LogError, McapSink, RunError, SinkOptions, SolutionSink, StateSink};
use std::path::Path;

/// Gives everything to both. They thin out alike, so that what one wants the other wants.
pub(crate) struct FileAndMemory {
    file: Option<McapSink>,
    memory: StateSink,
}

impl FileAndMemory {
    pub(crate) fn new(path: Option<&Path>, options: SinkOptions) -> Result<Self, LogError> {
        let memory = StateSink::new(&options);
        let file = path.map(|p| McapSink::create(p, options)).transpose()?;
        Ok(FileAndMemory { file, memory })
    }

    /// Complete the file, or say why it could not be written.
    pub(crate) fn finish_file(&mut self) -> Result<(), LogError> {
        self.file
            .take()
            .map_or(Ok(()), |file| file.finish().map(drop))
    }

    pub(crate) fn into_states(self) -> Vec<State<'static>> {
        self.memory.into_states()
    }
}

impl Sink for FileAndMemory {
    fn wants_epoch(&mut self, time: Time) -> bool {
        if let Some(file) = &mut self.file {
            file.wants_epoch(time);
        }
        self.memory.wants_epoch(time)
    }

    fn epoch(&mut self, epoch: &Epoch) {
        if let Some(file) = &mut self.file {
            file.epoch(epoch);
        }
        self.memory.epoch(epoch);
    }

    fn update(&mut self, update: &Update) {
        if let Some(file) = &mut self.file {
            file.update(update);
        }
    }

    fn event(&mut self, event: &Event) {
        if let Some(file) = &mut self.file {
            file.event(event);
        }
    }
}

impl SolutionSink for FileAndMemory {
    fn withheld(&mut self, fix: &GnssPosition) {
        if let Some(file) = &mut self.file {
            file.withheld(fix);
        }
    }

    fn failure(&mut self) -> Option<RunError> {
        self.file.as_mut().and_then(SolutionSink::failure)
    }
}
