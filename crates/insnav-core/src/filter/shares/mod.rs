//! What each noise adds to the covariance of the filter's error, along its own transitions and gains, and what follows for any
//! two innovations.
//!
//! P = P_known + Σ θᵢ Pᵢ with θ = 1 for what the filter believes: an identity as long as everything that is done to P is done to
//! the parts as well. Of a measurement with gain K, (I − KH) Pᵢ (I − KH)ᵀ + K Rᵢ Kᵀ holds for any gain, a Schmidt update's or one
//! that weighs down what comes too often among them. There the parts take the noise of one measurement alone, so that their sum is
//! the covariance that the errors have, and less than the filter's P, which is widened on purpose.

mod past;

use super::columns::{Columns, States};
use super::covariance::Covariance;
use super::layout::{ATTITUDE, Block, CAPACITY, HELD_ATTITUDE};
use super::transition::Transition;
use crate::noise::{InnovationSums, NoiseUnknown};
use crate::time::Time;
use nalgebra::{Matrix3, SMatrix, SVector};
use past::Past;
use std::boxed::Box;

const K: usize = NoiseUnknown::COUNT;
/// The parts: one for each unknown, and what is known.
const PARTS: usize = K + 1;
const KNOWN: usize = K;
/// So many numbers has what each part has to do with an innovation, for each state.
const CROSS: usize = 3 * PARTS;
/// Innovations count from so long after the begin of a run on, s: that alignment errors are independent of the fixes that made
/// them is not true.
const SETTLE: f64 = 30.0;
/// And so long after a stop, s: how a body sets off, its detector sees late.
const AFTER_STOP: f64 = 10.0;
/// A heading that is known no better is no matter for linear errors, rad.
const VAGUE_HEADING: f64 = 0.1;

/// Follows a filter, and sums up what its innovations say of the noise.
#[derive(Clone, Debug)]
pub struct Shares {
    parts: [Covariance; PARTS],
    past: Past,
    begun: Time,
    stood: Option<Time>,
    /// P was changed in a way that the parts did not follow.
    lost: bool,
    sums: InnovationSums,
}

/// A measurement that is about to correct the filter.
pub(super) struct Correction<'a, const M: usize> {
    pub(super) name: &'static str,
    pub(super) time: Time,
    pub(super) residual: SVector<f64, M>,
    pub(super) h: &'a Columns<M>,
    /// Of this measurement alone.
    pub(super) r: SMatrix<f64, M, M>,
    /// H P Hᵀ + R.
    pub(super) s: SMatrix<f64, M, M>,
    pub(super) gain: [[f64; M]; CAPACITY],
    /// Whether it passed the gate as it stands.
    pub(super) accepted: bool,
}

impl Shares {
    /// Follow a filter from here on.
    pub(super) fn of(covariance: &Covariance, now: Time, sums: InnovationSums) -> Box<Self> {
        let mut none = covariance.clone();
        none.clear();
        let mut parts: [Covariance; PARTS] = core::array::from_fn(|_| none.clone());
        parts[KNOWN] = covariance.clone();
        Box::new(Shares {
            parts,
            past: Past::new(),
            begun: now,
            stood: None,
            lost: false,
            sums,
        })
    }

    /// What was summed up.
    pub fn into_sums(self) -> InnovationSums {
        self.sums
    }

    /// What one noise adds to the covariance of the error; `None`: all that is known.
    pub fn part(&self, unknown: Option<NoiseUnknown>) -> &Covariance {
        &self.parts[unknown.map_or(KNOWN, |unknown| unknown as usize)]
    }

    /// P has been changed in a way of its own.
    pub(super) fn lose(&mut self) {
        self.lost = true;
    }

    /// Take the covariance as it is for what is known, if the parts have not followed it.
    fn find(&mut self, covariance: &Covariance, now: Time) {
        if self.lost || covariance.layout() != self.parts[KNOWN].layout() {
            let sums = core::mem::take(&mut self.sums);
            *self = *Shares::of(covariance, now, sums);
        }
    }

    /// An interval: white noise of gyros and accelerometers is that on attitude and velocity. Called before P moves.
    pub(super) fn propagate(&mut self, phi: &Transition, covariance: &Covariance, now: Time) {
        self.find(covariance, now);
        let mut noises = [[0.0; CAPACITY]; PARTS];
        let mut known = phi.noise;
        let sources = [
            (NoiseUnknown::Accel, Transition::VELOCITY_ROW),
            (NoiseUnknown::Gyro, Transition::ATTITUDE_ROW),
        ];
        for (unknown, row) in sources {
            let axes = row..row + 3;
            noises[unknown as usize][axes.clone()].copy_from_slice(&known[axes.clone()]);
            known[axes].fill(0.0);
        }
        noises[KNOWN] = known;
        self.advance(phi, &noises);
    }

    /// An interval of a body that stands: all noise in it is known.
    pub(super) fn stay(&mut self, phi: &Transition, covariance: &Covariance, now: Time) {
        self.find(covariance, now);
        let mut noises = [[0.0; CAPACITY]; PARTS];
        noises[KNOWN] = phi.noise;
        self.advance(phi, &noises);
        self.stand(now);
    }

    /// The body stands.
    pub(super) fn stand(&mut self, now: Time) {
        self.stood = Some(now);
        self.past.end();
    }

    fn advance(&mut self, phi: &Transition, noises: &[States; PARTS]) {
        for (part, noise) in self.parts.iter_mut().zip(noises) {
            part.propagate_with(phi, noise);
        }
        self.past.advance(phi, self.parts[KNOWN].layout().len());
    }

    /// An independent uncertainty more.
    pub(super) fn widen<const N: usize>(&mut self, block: Block<N>, extra: &SMatrix<f64, N, N>) {
        self.parts[KNOWN].add(block, extra);
        self.past.end();
    }

    /// A block that is forgotten, and known anew.
    pub(super) fn forget<const N: usize>(&mut self, block: Block<N>, prior: &SMatrix<f64, N, N>) {
        let none = SMatrix::zeros();
        for (i, part) in self.parts.iter_mut().enumerate() {
            part.set_prior(block, if i == KNOWN { prior } else { &none });
        }
        self.past.end();
    }

    /// The level errors turn with the estimate.
    pub(super) fn turn_level(&mut self, angle: f64) {
        for part in &mut self.parts {
            part.turn(ATTITUDE, angle);
            part.turn(HELD_ATTITUDE, angle);
        }
        self.past.turn_level(angle);
    }

    /// A measurement that was refused: what follows is not the innovation of a filter that takes everything.
    pub(super) fn refused(&mut self, name: &str) {
        if role(name).is_some() {
            self.past.end();
        }
    }

    /// A measurement corrects the filter; `covariance` is that before it.
    pub(super) fn correct<const M: usize>(
        &mut self,
        correction: &Correction<'_, M>,
        covariance: &Covariance,
    ) {
        let now = correction.time;
        self.find(covariance, now);
        let role = role(correction.name);
        let n = covariance.layout().len();
        let mut noises = [SMatrix::<f64, M, M>::zeros(); PARTS];
        noises[role.map_or(KNOWN, |r| r as usize)] = correction.r;
        // P Hᵀ of each part, before.
        let mut across = [[[0.0; M]; CAPACITY]; PARTS];
        let mut at_once = noises;
        for (p, part) in self.parts.iter().enumerate() {
            for (i, row) in across[p].iter_mut().enumerate().take(n) {
                for (j, g) in correction.h.iter() {
                    let x = part.get(i, j);
                    for (sum, g) in row.iter_mut().zip(g) {
                        *sum += x * g;
                    }
                }
            }
            for (j, g) in correction.h.iter() {
                for a in 0..M {
                    for b in 0..M {
                        at_once[p][(a, b)] += g[a] * across[p][j][b];
                    }
                }
            }
        }
        let heading = covariance
            .block(ATTITUDE, ATTITUDE)
            .map_or(f64::INFINITY, |p: Matrix3<f64>| p[(2, 2)]);
        let counts = correction.accepted
            && now.since(self.begun) >= SETTLE
            && self.stood.is_none_or(|t| now.since(t) >= AFTER_STOP)
            && heading < VAGUE_HEADING * VAGUE_HEADING;
        let own = match role.filter(|_| counts) {
            Some(role) => {
                let velocity = role == NoiseUnknown::Velocity;
                let sums = &mut self.sums;
                self.past.compare(correction, velocity, &at_once, n, sums)
            }
            None => None,
        };
        if role.is_some() && own.is_none() {
            self.past.end();
        }
        self.correct_parts(correction, &across, &at_once, n);
        self.past.correct(correction.h, &correction.gain, n);
        if let Some(own) = own {
            self.past.keep(&own, correction, &across, &at_once, n);
        }
    }

    fn correct_parts<const M: usize>(
        &mut self,
        correction: &Correction<'_, M>,
        across: &[[[f64; M]; CAPACITY]; PARTS],
        at_once: &[SMatrix<f64, M, M>; PARTS],
        n: usize,
    ) {
        let gain = &correction.gain;
        for (p, part) in self.parts.iter_mut().enumerate() {
            // K S, so that P − K (PHᵀ)ᵀ − PHᵀ Kᵀ + K S Kᵀ is one sum of products.
            let weighed: [[f64; M]; CAPACITY] = core::array::from_fn(|i| {
                core::array::from_fn(|b| {
                    (0..M).map(|a| gain[i][a] * at_once[p][(a, b)]).sum::<f64>() - across[p][i][b]
                })
            });
            for i in 0..n {
                for j in 0..=i {
                    let mut x = part.get(i, j);
                    for a in 0..M {
                        x += weighed[i][a] * gain[j][a] - gain[i][a] * across[p][j][a];
                    }
                    part.set(i, j, x);
                    part.set(j, i, x);
                }
            }
        }
    }
}

/// Which unknown the noise of a measurement is.
fn role(name: &str) -> Option<NoiseUnknown> {
    match name {
        "gnss_position" => Some(NoiseUnknown::Position),
        "gnss_velocity" => Some(NoiseUnknown::Velocity),
        _ => None,
    }
}
