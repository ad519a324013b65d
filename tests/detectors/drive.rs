//! A drive for a detector, second by second.

use crate::unit::{detector, imu, imu_noise, stands};
use insnav::config::StationaryConfig;
use insnav::imu::STANDARD_GRAVITY;
use insnav::sample::Sample;
use insnav::sim::{Source, Stream};
use insnav::solution::Motion;
use insnav::stationary::{Belief, LOOK_AHEAD, StopDetector};
use insnav::time::Time;
use nalgebra::Vector3;

/// A drive by what it does, second by second, through one detector; tells what the filter would be told.
pub(crate) struct Drive {
    pub(crate) detector: StopDetector,
    pub(crate) belief: Belief,
    pub(crate) source: Source,
    pub(crate) t: f64,
    pub(crate) told: Vec<(f64, Motion)>,
}

impl Drive {
    pub(crate) fn new() -> Self {
        Drive {
            detector: detector(),
            belief: stands(),
            source: Source::new(7, Stream::AccelWhite),
            t: 0.0,
            told: Vec::new(),
        }
    }

    pub(crate) fn go(
        &mut self,
        seconds: f64,
        force: Vector3<f64>,
        rate: Vector3<f64>,
    ) -> &mut Self {
        let end = self.t + seconds;
        while self.t < end - 1e-9 {
            self.t += 0.01;
            let force = force - Vector3::z() * STANDARD_GRAVITY + self.source.normal3() * 0.08;
            let rate = rate + self.source.normal3() * (0.5f64).to_radians();
            self.detector
                .observe(&imu(self.t, force, rate), &self.belief);
            let at = self.t - LOOK_AHEAD;
            self.told
                .push((at, self.detector.advance(Time::from_seconds(at))));
        }
        self
    }

    pub(crate) fn rest(&mut self, seconds: f64) -> &mut Self {
        self.go(seconds, Vector3::zeros(), Vector3::zeros())
    }

    pub(crate) fn says(&mut self, sample: Sample) -> &mut Self {
        self.detector.observe(&sample, &self.belief);
        self
    }

    /// Spans of standing as the filter is told them.
    pub(crate) fn stops(&self) -> Vec<(f64, f64)> {
        let mut stops: Vec<(f64, f64)> = Vec::new();
        let mut open = false;
        for (at, motion) in &self.told {
            let stands = *motion != Motion::Moving;
            match (stands, open) {
                (true, false) => stops.push((*at, *at)),
                (true, true) => stops.last_mut().expect("one is open").1 = *at,
                _ => {}
            }
            open = stands;
        }
        stops
    }
}

pub(crate) fn configured(config: StationaryConfig) -> Drive {
    let mut drive = Drive::new();
    drive.detector = StopDetector::new(&config, &imu_noise());
    drive.detector.set_origin(Time(0));
    drive
}
