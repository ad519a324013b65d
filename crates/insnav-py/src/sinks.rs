//! One run into a file (if wanted) and into memory.

use crate::epochs::EpochColumns;
use crate::interrupt::Stop;
use insnav_core::filter::Update;
use insnav_core::sample::GnssPosition;
use insnav_core::solution::{Epoch, Event, Sink};
use insnav_core::time::Time;
use insnav_log::{LogError, McapSink, RunError, SinkOptions, SolutionSink, StateSink, UpdateRow};
use std::path::Path;

/// Gives everything to both. They thin out alike, so that what one wants the other wants.
pub(crate) struct FileAndMemory<'a> {
    stop: &'a Stop,
    file: Option<McapSink>,
    memory: StateSink<EpochColumns>,
    updates: Vec<UpdateRow>,
    withheld: Vec<GnssPosition>,
}

impl<'a> FileAndMemory<'a> {
    /// `stop`: whether somebody waits for the result still. `epochs`: how many there will be, about.
    pub(crate) fn new(
        path: Option<&Path>,
        options: SinkOptions,
        epochs: usize,
        stop: &'a Stop,
    ) -> Result<Self, LogError> {
        let memory = StateSink::keeping(EpochColumns::with_capacity(epochs), &options);
        let file = path.map(|p| McapSink::create(p, options)).transpose()?;
        Ok(FileAndMemory {
            stop,
            file,
            memory,
            updates: Vec::new(),
            withheld: Vec::new(),
        })
    }

    /// Complete the file, or say why it could not be written.
    pub(crate) fn finish_file(&mut self) -> Result<(), LogError> {
        self.file
            .take()
            .map_or(Ok(()), |file| file.finish().map(drop))
    }

    /// Epochs, measurements and withheld fixes, in the order in which they came.
    pub(crate) fn into_solution(self) -> (EpochColumns, Vec<UpdateRow>, Vec<GnssPosition>) {
        (self.memory.into_kept(), self.updates, self.withheld)
    }
}

impl Sink for FileAndMemory<'_> {
    fn is_over(&mut self) -> bool {
        !self.stop.proceed()
    }

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
        self.updates.push(UpdateRow::from(update));
    }

    fn event(&mut self, event: &Event) {
        if let Some(file) = &mut self.file {
            file.event(event);
        }
    }
}

impl SolutionSink for FileAndMemory<'_> {
    fn withheld(&mut self, fix: &GnssPosition) {
        if let Some(file) = &mut self.file {
            file.withheld(fix);
        }
        self.withheld.push(*fix);
    }

    fn failure(&mut self) -> Option<RunError> {
        self.file.as_mut().and_then(SolutionSink::failure)
    }
}
