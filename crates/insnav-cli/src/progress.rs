//! How far a job is: a line on standard error, when that is a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use insnav_log::{Log, Mounting, ReaderState, Role, RunError, Source, SourceFacts, Stream};
use nalgebra::Vector3;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

/// One line that goes away when the job is done. It has no colour, and is not there when nobody looks.
pub(crate) struct Progress {
    bar: ProgressBar,
}

impl Progress {
    /// A job of `total` steps; `None`: nobody knows how many.
    pub(crate) fn new(what: &str, total: Option<u64>) -> Self {
        if !std::io::stderr().is_terminal() {
            return Progress {
                bar: ProgressBar::hidden(),
            };
        }
        let bar = ProgressBar::with_draw_target(total, ProgressDrawTarget::stderr_with_hz(10));
        let template = if total.is_some() {
            "{msg} {wide_bar} {percent:>3} % {eta}"
        } else {
            "{spinner} {msg} {elapsed}"
        };
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_message(what.to_owned());
        if total.is_none() {
            bar.enable_steady_tick(Duration::from_millis(100));
        }
        Progress { bar }
    }

    /// So many steps are done.
    pub(crate) fn at(&self, done: u64) {
        self.bar.set_position(done);
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// A log that shows how far its reader is.
pub(crate) struct Watched<'a> {
    log: &'a Log,
    name: String,
    messages: u64,
    passes: AtomicU32,
}

/// Between two looks at the terminal, samples.
const STEP: u64 = 4096;

impl<'a> Watched<'a> {
    pub(crate) fn new(log: &'a Log) -> Self {
        let roles = [
            Role::Imu,
            Role::GnssPosition,
            Role::GnssVelocity,
            Role::Standing,
        ];
        let topics = roles.iter().filter_map(|r| log.selected().topic(*r));
        Watched {
            log,
            name: log.path().display().to_string(),
            messages: topics.map(|i| log.topics()[i].count).sum(),
            passes: AtomicU32::new(0),
        }
    }
}

/// Samples, counted on their way.
struct Counted<S: ?Sized> {
    progress: Progress,
    done: u64,
    samples: Box<S>,
}

impl<S: Iterator + ?Sized> Iterator for Counted<S> {
    type Item = S::Item;

    fn next(&mut self) -> Option<S::Item> {
        self.done += 1;
        if self.done.is_multiple_of(STEP) {
            self.progress.at(self.done);
        }
        self.samples.next()
    }
}

impl Stream for Counted<dyn Stream + '_> {
    fn state(&self) -> ReaderState {
        self.samples.state()
    }
}

impl Watched<'_> {
    fn counted<S: ?Sized>(&self, samples: Box<S>) -> Box<Counted<S>> {
        let pass = self.passes.fetch_add(1, Ordering::Relaxed) + 1;
        let name = format!("{} (pass {pass})", self.name);
        Box::new(Counted {
            progress: Progress::new(&name, Some(self.messages)),
            done: 0,
            samples,
        })
    }
}

impl Source for Watched<'_> {
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError> {
        Ok(self.counted(Source::samples(self.log)?))
    }

    fn stream(
        &self,
        from: Option<&ReaderState>,
        hold: bool,
    ) -> Result<Box<dyn Stream + '_>, RunError> {
        Ok(self.counted(self.log.stream(from, hold)?))
    }

    fn reading(&self) -> String {
        self.log.reading()
    }

    fn origin(&self) -> Result<Option<Time>, RunError> {
        Source::origin(self.log)
    }

    fn lever_arm_b(&self) -> Result<Option<Vector3<f64>>, RunError> {
        Source::lever_arm_b(self.log)
    }

    fn standing_topic(&self) -> Option<String> {
        Source::standing_topic(self.log)
    }

    fn mounting(&self) -> Result<Option<Mounting>, RunError> {
        Source::mounting(self.log)
    }

    fn facts(&self) -> Result<SourceFacts, RunError> {
        Source::facts(self.log)
    }

    fn check(&self) -> Result<(), RunError> {
        Source::check(self.log)
    }
}
