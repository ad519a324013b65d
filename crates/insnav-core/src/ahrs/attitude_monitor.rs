//! Filters with fixed gains that watch an attitude for its noise.

use super::{AttitudeInnovation, innovation_n};
use crate::attitude::exp;
use crate::error::{Error, Result};
use crate::noise::{BlockVerdict, ChannelMonitor, ChannelNoise};
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix2, UnitQuaternion, Vector2, Vector3};

/// Process noise of the filters against that of the prior. With the start wrong by a hundred either way one of them is still
/// within a factor of three.
const FACTORS: [f64; FILTERS] = [1e-2, 1e-1, 1.0, 1e1, 1e2];
const FILTERS: usize = 5;

/// Noise of the three angles about the axes of n.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeChannelNoise {
    /// Of the tilt about north and about east.
    pub tilt: [ChannelNoise; 2],
    /// Of the heading.
    pub heading: ChannelNoise,
}

/// Settings of an [`AttitudeMonitor`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeMonitorSettings {
    /// Time between samples, s.
    pub step_s: f64,
    /// Believed until a block is accepted.
    pub prior: AttitudeChannelNoise,
    /// Driving noise of a gyro's bias, (rad/s)² per step; known, since no stretch of minutes shows it.
    pub bias_noise: f64,
    /// One sigma of a gyro's bias at the begin, rad/s.
    pub initial_bias: f64,
    /// Samples until the gains are fixed.
    pub settle: u32,
    /// Samples that are judged together.
    pub block: u32,
}

/// Five attitude filters with fixed gains, from which nothing is kept, and what their innovations in navigation axes show.
///
/// Not the filter whose attitude is used: that one has a gate and changes its gain, either of which spoils lag covariances.
/// Gyro noise and tilt noise are stationary in navigation axes also while the body turns. Each filter begins with the gains of a
/// Kalman filter and keeps those it has after `settle` samples. Allocates nothing.
///
/// Without a field nothing corrects the gyro about the vertical, whose bias enters the tilt of a body that is tilted to and fro: of
/// 0.5 °/s and 20° it makes q twice as large.
#[derive(Clone, Debug, PartialEq)]
pub struct AttitudeMonitor<const J: usize> {
    settings: AttitudeMonitorSettings,
    filters: Option<[Watcher; FILTERS]>,
    seen: u32,
    channels: Option<[ChannelMonitor<J, FILTERS>; 3]>,
    trusting: bool,
    in_block: u32,
    /// Headings in this block that were not there.
    missing: u32,
}

/// One filter: attitude, bias, and of each axis the covariance while it settles and the gain of (angle, bias).
#[derive(Clone, Debug, PartialEq)]
struct Watcher {
    q_nb: UnitQuaternion<f64>,
    bias_b: Vector3<f64>,
    covariances: [Matrix2<f64>; 3],
    gains: [Vector2<f64>; 3],
}

impl<const J: usize> AttitudeMonitor<J> {
    /// A monitor that begins with the next sample that has both force and field, or force alone (`field_b` never given).
    pub fn new(settings: AttitudeMonitorSettings) -> Self {
        AttitudeMonitor {
            settings,
            filters: None,
            seen: 0,
            channels: None,
            trusting: false,
            in_block: 0,
            missing: 0,
        }
    }

    /// One that believes every block, see [`ChannelMonitor::trusting`].
    pub fn trusting(mut self) -> Self {
        self.trusting = true;
        self
    }

    /// The noise that is believed now.
    pub fn noise(&self) -> AttitudeChannelNoise {
        match &self.channels {
            None => self.settings.prior,
            Some([north, east, down]) => AttitudeChannelNoise {
                tilt: [north.noise(), east.noise()],
                heading: down.noise(),
            },
        }
    }

    /// Blocks of the tilt that were accepted, and all.
    pub fn tilt_counts(&self) -> [u32; 2] {
        self.channels
            .as_ref()
            .map_or([0, 0], |channels| channels[0].counts())
    }

    /// Move on by one step: mean rate over it (rad/s), then specific force and magnetic field at its end, all in body axes.
    ///
    /// Returns what a block came to (north, east, down) at its end.
    ///
    /// # Errors
    /// [`Error::NotObservable`] when a loop is not stable, which settings that are positive do not lead to.
    pub fn step(
        &mut self,
        rate_b: &Vector3<f64>,
        specific_force_b: &Vector3<f64>,
        field_b: Option<&Vector3<f64>>,
    ) -> Result<Option<[Option<BlockVerdict>; 3]>> {
        let Some(filters) = &mut self.filters else {
            let seen = innovation_n(&UnitQuaternion::identity(), Some(specific_force_b), field_b);
            let Some(level) = seen.levelling() else {
                return Ok(None);
            };
            let q_nb = seen.heading_turn().unwrap_or_default() * level;
            self.filters = Some(core::array::from_fn(|_| Watcher::new(q_nb, &self.settings)));
            return Ok(None);
        };
        let settling = self.seen < self.settings.settle;
        let mut innovations = [[f64::NAN; FILTERS]; 3];
        for (i, filter) in filters.iter_mut().enumerate() {
            filter.propagate(rate_b, self.settings.step_s);
            let seen = innovation_n(&filter.q_nb, Some(specific_force_b), field_b);
            if settling {
                filter.settle(&self.settings, FACTORS[i], field_b.is_some());
            }
            filter.correct(&seen);
            for (axis, angle) in angles(&seen).into_iter().enumerate() {
                innovations[axis][i] = angle.unwrap_or(f64::NAN);
            }
        }
        if settling {
            self.seen += 1;
            return Ok(None);
        }
        if self.channels.is_none() {
            self.channels = Some(self.channels()?);
        }
        let Some(channels) = &mut self.channels else {
            return Ok(None);
        };
        for (channel, nu) in channels.iter_mut().zip(&innovations) {
            channel.push(nu);
        }
        self.missing += u32::from(field_b.is_none());
        self.in_block += 1;
        if self.in_block < self.settings.block {
            return Ok(None);
        }
        // A field that was withheld for a part of the block was disturbed in all of it.
        let field_was_there = self.missing == 0;
        (self.in_block, self.missing) = (0, 0);
        // One accelerometer: what disturbs it in one direction now does so in the other next.
        let tilt_fits = channels[0].block_fits() && channels[1].block_fits();
        let [north, east, down] = channels;
        Ok(Some([
            north.end_block(tilt_fits),
            east.end_block(tilt_fits),
            down.end_block(field_was_there),
        ]))
    }

    fn channels(&self) -> Result<[ChannelMonitor<J, FILTERS>; 3]> {
        let f = Matrix2::new(1.0, -self.settings.step_s, 0.0, 1.0);
        let not_begun = Error::NotObservable {
            what: "noise of an attitude",
            reason: "no sample has been seen",
        };
        let filters = self.filters.as_ref().ok_or(not_begun)?;
        let prior = self.settings.prior;
        let channel = |axis: usize, prior: ChannelNoise| -> Result<ChannelMonitor<J, FILTERS>> {
            let gains = core::array::from_fn(|i| filters[i].gains[axis]);
            let monitor = ChannelMonitor::new(&f, &gains, self.settings.bias_noise, prior)?;
            Ok(if self.trusting {
                monitor.trusting()
            } else {
                monitor
            })
        };
        Ok([
            channel(0, prior.tilt[0])?,
            channel(1, prior.tilt[1])?,
            channel(2, prior.heading)?,
        ])
    }
}

fn angles(seen: &AttitudeInnovation) -> [Option<f64>; 3] {
    [
        seen.tilt.map(|t| t[0]),
        seen.tilt.map(|t| t[1]),
        seen.heading,
    ]
}

impl AttitudeMonitorSettings {
    fn prior(&self, axis: usize) -> ChannelNoise {
        match axis {
            2 => self.prior.heading,
            _ => self.prior.tilt[axis],
        }
    }
}

impl Watcher {
    fn new(q_nb: UnitQuaternion<f64>, settings: &AttitudeMonitorSettings) -> Self {
        Watcher {
            q_nb,
            bias_b: Vector3::zeros(),
            covariances: core::array::from_fn(|axis| {
                Matrix2::from_diagonal(&Vector2::new(
                    settings.prior(axis).measured,
                    settings.initial_bias.powi(2),
                ))
            }),
            // Of an axis without measurements only that its loop is stable.
            gains: [Vector2::new(0.5, -0.5); 3],
        }
    }

    fn propagate(&mut self, rate_b: &Vector3<f64>, step_s: f64) {
        self.q_nb *= exp(&((rate_b - self.bias_b) * step_s));
        self.q_nb.renormalize_fast();
    }

    /// The next gain of a Kalman filter of one axis; the last of them stays.
    fn settle(&mut self, settings: &AttitudeMonitorSettings, factor: f64, with_field: bool) {
        let f = Matrix2::new(1.0, -settings.step_s, 0.0, 1.0);
        for axis in 0..3 {
            let noise = settings.prior(axis);
            let added = Vector2::new(noise.process * factor, settings.bias_noise);
            let p = f * self.covariances[axis] * f.transpose() + Matrix2::from_diagonal(&added);
            self.covariances[axis] = p;
            if axis == 2 && !with_field {
                continue;
            }
            let gain: Vector2<f64> = p.column(0) / (p.m11 + noise.measured);
            self.covariances[axis] = p - gain * p.row(0);
            self.gains[axis] = gain;
        }
    }

    fn correct(&mut self, seen: &AttitudeInnovation) {
        let nu = angles(seen).map(|angle| angle.unwrap_or(0.0));
        let by = |state: usize| {
            Vector3::new(
                self.gains[0][state] * nu[0],
                self.gains[1][state] * nu[1],
                self.gains[2][state] * nu[2],
            )
        };
        let (turn_n, bias_n) = (by(0), by(1));
        // Gains of the bias are along n, as the channels have it.
        self.bias_b += self.q_nb.inverse() * bias_n;
        self.q_nb = exp(&turn_n) * self.q_nb;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{AttitudeCase, AttitudeRecord};
    use std::vec::Vec;

    fn monitor(record: &AttitudeRecord, factor: f64) -> AttitudeMonitor<40> {
        let mut prior = record.truth;
        for tilt in &mut prior.tilt {
            tilt.process *= factor;
        }
        AttitudeMonitor::new(AttitudeMonitorSettings {
            step_s: record.step_s,
            prior,
            bias_noise: record.bias_noise,
            initial_bias: record.initial_bias,
            settle: 625,
            block: 400,
        })
    }

    /// Without a magnetometer the tilt's noise is found from a start wrong by a hundred, and the heading's is the prior.
    #[test]
    fn tilt_needs_no_field() {
        for (seed, factor) in [(1, 100.0), (2, 0.01)] {
            let record = AttitudeRecord::simulate(AttitudeCase::Static, seed);
            let mut monitor = monitor(&record, factor);
            for s in &record.samples {
                monitor
                    .step(&s.rate_b, &s.specific_force_b, None)
                    .expect("stable loops");
            }
            let found = monitor.noise();
            for (found, truth) in found.tilt.iter().zip(record.truth.tilt) {
                // 4800 samples: 18 % and 2.1 % (Cramér–Rao), three of them.
                let q = found.process / truth.process;
                let r = found.measured / truth.measured;
                assert!((0.46..1.54).contains(&q), "{factor}: {q}");
                assert!((r - 1.0).abs() < 0.063, "{factor}: {r}");
            }
            assert_eq!(found.heading, record.truth.heading);
            assert_eq!(monitor.tilt_counts(), [12, 12]);
        }
    }

    /// A block in which the field was withheld for a moment says nothing of the heading, and all of the tilt.
    #[test]
    fn a_withheld_field_holds_the_heading_alone() {
        let record = AttitudeRecord::simulate(AttitudeCase::Static, 3);
        let mut monitor = monitor(&record, 1.0);
        let mut verdicts = Vec::new();
        for (k, s) in record.samples.iter().enumerate() {
            let field = s.field_b.as_ref().filter(|_| k != 1300);
            if let Some(blocks) = monitor
                .step(&s.rate_b, &s.specific_force_b, field)
                .expect("stable loops")
            {
                verdicts.push(blocks.map(|block| block.is_some_and(|b| b.accepted)));
            }
        }
        // 626 samples before the first block: number 1300 is in the second.
        for (i, [north, east, down]) in verdicts.into_iter().enumerate() {
            assert!(
                north && east && down == (i != 1),
                "{i} {north} {east} {down}"
            );
        }
    }
}
