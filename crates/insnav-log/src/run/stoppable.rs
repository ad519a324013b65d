//! A source that stops giving samples when somebody asks it to: how a long run is ended from another thread.

use super::{RunError, Source, Stream};
use crate::samples::ReaderState;
use crate::{Mounting, SourceFacts};
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use nalgebra::Vector3;
use std::sync::atomic::{AtomicBool, Ordering};

/// Any source, until `stop` is set: then the next sample is [`RunError::Interrupted`], which ends whatever reads it.
///
/// A sink that is dropped unfinished leaves nothing behind, so that a run that ends so leaves nothing half-written.
pub struct Stoppable<'a, S: ?Sized> {
    source: &'a S,
    stop: &'a AtomicBool,
}

impl<'a, S: Source + ?Sized> Stoppable<'a, S> {
    /// Read `source` until `stop` is set.
    pub fn new(source: &'a S, stop: &'a AtomicBool) -> Self {
        Stoppable { source, stop }
    }

    /// Whether to go on.
    ///
    /// # Errors
    /// [`RunError::Interrupted`] after somebody has asked.
    pub fn proceed(&self) -> Result<(), RunError> {
        if self.stop.load(Ordering::Relaxed) {
            Err(RunError::Interrupted)
        } else {
            Ok(())
        }
    }
}

/// Samples until the flag is set.
struct Until<'a, I> {
    samples: I,
    stop: &'a AtomicBool,
}

impl<I: Iterator<Item = Result<Sample, RunError>>> Iterator for Until<'_, I> {
    type Item = I::Item;

    fn next(&mut self) -> Option<I::Item> {
        if self.stop.load(Ordering::Relaxed) {
            return Some(Err(RunError::Interrupted));
        }
        self.samples.next()
    }
}

impl Stream for Until<'_, Box<dyn Stream + '_>> {
    fn state(&self) -> ReaderState {
        self.samples.state()
    }
}

impl<S: Source + ?Sized> Source for Stoppable<'_, S> {
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError> {
        self.proceed()?;
        Ok(Box::new(Until {
            samples: self.source.samples()?,
            stop: self.stop,
        }))
    }

    fn stream(
        &self,
        from: Option<&ReaderState>,
        hold: bool,
    ) -> Result<Box<dyn Stream + '_>, RunError> {
        self.proceed()?;
        Ok(Box::new(Until {
            samples: self.source.stream(from, hold)?,
            stop: self.stop,
        }))
    }

    fn reading(&self) -> String {
        self.source.reading()
    }

    fn origin(&self) -> Result<Option<Time>, RunError> {
        self.source.origin()
    }

    fn lever_arm_b(&self) -> Result<Option<Vector3<f64>>, RunError> {
        self.source.lever_arm_b()
    }

    fn standing_topic(&self) -> Option<String> {
        self.source.standing_topic()
    }

    fn mounting(&self) -> Result<Option<Mounting>, RunError> {
        self.source.mounting()
    }

    fn facts(&self) -> Result<SourceFacts, RunError> {
        self.source.facts()
    }

    fn check(&self) -> Result<(), RunError> {
        self.source.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::sample::Speed;

    fn samples() -> Vec<Sample> {
        (0..10)
            .map(|i| {
                Sample::Speed(Speed {
                    time: Time(i),
                    speed: 1.0,
                })
            })
            .collect()
    }

    #[test]
    fn gives_the_same_samples_until_asked_to_stop() {
        let (source, stop) = (samples(), AtomicBool::new(false));
        let stoppable = Stoppable::new(&source, &stop);
        assert_eq!(stoppable.samples().unwrap().count(), 10);
        let mut stream = stoppable.stream(None, false).unwrap();
        for expected in &source[..4] {
            assert_eq!(stream.next().unwrap().unwrap().time(), expected.time());
        }
        stop.store(true, Ordering::Relaxed);
        assert!(matches!(stream.next(), Some(Err(RunError::Interrupted))));
        assert!(matches!(stoppable.samples(), Err(RunError::Interrupted)));
        assert!(matches!(
            stoppable.stream(None, false),
            Err(RunError::Interrupted)
        ));
    }
}
