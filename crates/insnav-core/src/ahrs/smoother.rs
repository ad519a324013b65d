//! The same filter from both ends of a record: Rauch, Tung and Striebel's backward pass over its corrections.

use super::filter::{Ahrs, AhrsEpoch, Corrected};
use super::settings::AhrsSettings;
use super::state::{ATTITUDE, Covariance, Errors, SIZE, State};
use crate::attitude::{exp, log};
use crate::error::Result;
use crate::sample::{ImuSample, MagneticField};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::vec::Vec;

/// Relative height that keeps a predicted covariance positive where a state is known exactly.
const FLOOR: f64 = 1e-12;

/// Collects a record and smooths it: \[Groves13\] section 3.4.3 (Rauch–Tung–Striebel), errors taken on the rotation itself.
///
/// Keeps about 70 kB per second of record.
#[derive(Debug)]
pub struct Smoother {
    ahrs: Ahrs,
    /// Interval and rate of each sample that has an epoch.
    turns: Vec<(f64, Vector3<f64>)>,
    epochs: Vec<AhrsEpoch>,
    /// Corrections, and the number of epochs up to and with each.
    corrections: Vec<(usize, Corrected)>,
    /// Epochs that are the first of a stretch.
    starts: Vec<usize>,
    last: Option<ImuSample>,
}

/// Estimates at a correction with everything known.
struct Smoothed {
    state: State,
    attitude_covariance: Matrix3<f64>,
}

/// Orientation at every sample of a record from the whole of it.
///
/// # Errors
/// As [`Ahrs::new`], [`Ahrs::step`] and [`Ahrs::field`].
pub fn smooth(
    samples: &[ImuSample],
    fields: &[MagneticField],
    settings: AhrsSettings,
) -> Result<Vec<AhrsEpoch>> {
    let mut smoother = Smoother::new(settings)?;
    let mut fields = fields.iter().peekable();
    for sample in samples {
        while let Some(field) = fields.next_if(|f| f.time <= sample.time) {
            smoother.field(field)?;
        }
        smoother.step(sample)?;
    }
    Ok(smoother.finish())
}

impl Smoother {
    /// As [`Ahrs::new`].
    ///
    /// # Errors
    /// Those of [`Ahrs::new`].
    pub fn new(settings: AhrsSettings) -> Result<Self> {
        Ok(Smoother {
            ahrs: Ahrs::new(settings)?,
            turns: Vec::new(),
            epochs: Vec::new(),
            corrections: Vec::new(),
            starts: Vec::new(),
            last: None,
        })
    }

    /// As [`Ahrs::field`].
    ///
    /// # Errors
    /// Those of [`Ahrs::field`].
    pub fn field(&mut self, field: &MagneticField) -> Result<()> {
        self.ahrs.field(field)
    }

    /// As [`Ahrs::step`]; returns what the filter knows without the future.
    ///
    /// # Errors
    /// Those of [`Ahrs::step`].
    pub fn step(&mut self, sample: &ImuSample) -> Result<Option<AhrsEpoch>> {
        let epoch = self.ahrs.step(sample)?;
        let interval = self.last.map_or(0.0, |l| sample.time.since(l.time));
        self.last = Some(*sample);
        if let Some(epoch) = epoch {
            if core::mem::take(&mut self.ahrs.began) {
                self.starts.push(self.epochs.len());
            }
            self.turns.push((interval, sample.angular_rate_b));
            self.epochs.push(epoch);
            if let Some(corrected) = self.ahrs.corrected.take() {
                self.corrections.push((self.epochs.len(), corrected));
            }
        }
        Ok(epoch)
    }

    /// The filter at the end of the record.
    pub fn filter(&self) -> &Ahrs {
        &self.ahrs
    }

    /// All epochs, each from the whole record.
    pub fn finish(mut self) -> Vec<AhrsEpoch> {
        let smoothed = self.backward();
        let mut begin = 0;
        for k in 0..smoothed.len() {
            let (end, joined) = (
                self.corrections[k].0,
                self.corrections[k].1.propagation.is_some(),
            );
            let before = (k > 0 && joined).then(|| &smoothed[k - 1]);
            if before.is_none() {
                // What is left of the stretch before has nothing after it: it stays as the filter had it.
                let first = self.starts.partition_point(|s| *s < end);
                begin = self.starts[..first].last().map_or(begin, |s| begin.max(*s));
            }
            self.epochs_between(begin..end, before, &smoothed[k]);
            begin = end;
        }
        self.epochs
    }

    fn backward(&self) -> Vec<Smoothed> {
        let mut smoothed: Vec<Smoothed> = Vec::with_capacity(self.corrections.len());
        let mut next: Option<(Covariance, State)> = None;
        for k in (0..self.corrections.len()).rev() {
            let here = &self.corrections[k].1;
            let after = self.corrections.get(k + 1).map(|(_, c)| c);
            let joined = after.and_then(|a| Some((a.propagation.as_ref()?, a)));
            let (covariance, state) = match (joined, next.take()) {
                (Some((propagation, after)), Some((p_next, state_next))) => {
                    let mut predicted = here.covariance;
                    propagation.apply(&mut predicted);
                    let mut crossed = here.covariance;
                    propagation.rows(&mut crossed);
                    let mut raised = predicted;
                    for i in 0..SIZE {
                        raised[(i, i)] += FLOOR * raised[(i, i)] + f64::MIN_POSITIVE;
                    }
                    match raised.cholesky() {
                        Some(root) => {
                            // G = P Φᵀ P₋⁻¹; `crossed` is Φ P.
                            let gain = root.solve(&crossed).transpose();
                            let errors: Errors = gain * state_next.less(&after.predicted);
                            let mut p =
                                here.covariance + gain * (p_next - predicted) * gain.transpose();
                            p = (p + p.transpose()) * 0.5;
                            (p, here.corrected.corrected(&errors))
                        }
                        None => (here.covariance, here.corrected),
                    }
                }
                _ => (here.covariance, here.corrected),
            };
            next = Some((covariance, state));
            smoothed.push(Smoothed {
                state,
                attitude_covariance: covariance
                    .fixed_view::<3, 3>(ATTITUDE, ATTITUDE)
                    .into_owned(),
            });
        }
        smoothed.reverse();
        smoothed
    }

    /// From correction to correction by the gyros, what is left at the end spread over the samples between.
    fn epochs_between(
        &mut self,
        range: core::ops::Range<usize>,
        before: Option<&Smoothed>,
        at_end: &Smoothed,
    ) {
        let bias = at_end.state.gyro_bias;
        let turns: Vec<UnitQuaternion<f64>> = self.turns[range.clone()]
            .iter()
            .map(|(interval, rate)| exp(&((rate - bias) * *interval)))
            .collect();
        let whole = turns
            .iter()
            .fold(UnitQuaternion::identity(), |q, turn| q * turn);
        // The first block after a start has only its end.
        let begin = before.map_or(at_end.state.attitude * whole.conjugate(), |s| {
            s.state.attitude
        });
        let left = log(&(at_end.state.attitude * (begin * whole).conjugate()));
        let count = turns.len() as f64;
        let mut q = begin;
        for (i, turn) in turns.iter().enumerate() {
            q *= turn;
            let share = (i + 1) as f64 / count;
            let epoch = &mut self.epochs[range.start + i];
            epoch.attitude = exp(&(left * share)) * q;
            epoch.covariance = match before {
                Some(s) => {
                    s.attitude_covariance * (1.0 - share) + at_end.attitude_covariance * share
                }
                None => at_end.attitude_covariance,
            };
            epoch.gyro_bias = bias;
        }
    }
}
