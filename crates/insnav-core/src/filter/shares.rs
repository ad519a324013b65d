//! What each noise adds to the covariance of the filter's error, along its own transitions and gains, and what follows for any
//! two innovations.
//!
//! P = P_known + Σ θᵢ Pᵢ with θ = 1 for what the filter believes: an identity as long as everything that is done to P is done to
//! the parts as well. Of a measurement with gain K, (I − KH) Pᵢ (I − KH)ᵀ + K Rᵢ Kᵀ holds for any gain, a Schmidt update's or one
//! that weighs down what comes too often among them.

use super::columns::{Columns, States};
use super::covariance::Covariance;
use super::layout::{ATTITUDE, Block, CAPACITY};
use super::transition::Transition;
use crate::noise::{InnovationSums, NoiseUnknown, Pair, Product};
use crate::time::Time;
use nalgebra::{Matrix3, SMatrix, SVector};
use std::boxed::Box;
use std::collections::VecDeque;
use std::vec::Vec;

const K: usize = NoiseUnknown::COUNT;
/// The parts: one for each unknown, and what is known.
const PARTS: usize = K + 1;
const KNOWN: usize = K;
/// Products reach back over so many innovations …
const MOST_LAGS: usize = 64;
/// … and so long, s: the errors of position and velocity that a receiver leaves do not last longer.
const LONGEST: f64 = 20.0;
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
    /// From the errors after the last innovation to those now.
    closed: [[f64; CAPACITY]; CAPACITY],
    /// Newest first.
    past: VecDeque<Past>,
    begun: Time,
    stood: Option<Time>,
    /// P was changed in a way that the parts did not follow.
    lost: bool,
    sums: InnovationSums,
}

/// An innovation of before.
#[derive(Clone, Debug)]
struct Past {
    time: Time,
    velocity: bool,
    size: usize,
    /// L⁻¹ ν, where S = L Lᵀ.
    white: [f64; 3],
    /// E[e νᵀ] L⁻ᵀ after the correction, state by state for each part.
    cross: Vec<[[f64; 3]; PARTS]>,
    /// From the errors after the innovation before this one to those after this one, row by row.
    closed: Vec<f64>,
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

fn identity() -> [[f64; CAPACITY]; CAPACITY] {
    core::array::from_fn(|i| core::array::from_fn(|j| f64::from(u8::from(i == j))))
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
            closed: identity(),
            past: VecDeque::with_capacity(MOST_LAGS),
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
        noises[KNOWN] = phi.noise;
        let sources = [
            (NoiseUnknown::Accel, Transition::VELOCITY_ROW),
            (NoiseUnknown::Gyro, Transition::ATTITUDE_ROW),
        ];
        for (unknown, row) in sources {
            for i in row..row + 3 {
                noises[unknown as usize][i] = core::mem::take(&mut noises[KNOWN][i]);
            }
        }
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
        self.past.clear();
    }

    fn advance(&mut self, phi: &Transition, noises: &[States; PARTS]) {
        for (part, noise) in self.parts.iter_mut().zip(noises) {
            part.propagate_with(phi, noise);
        }
        if self.past.is_empty() {
            return;
        }
        let n = self.parts[KNOWN].layout().len();
        let shears = [
            (Transition::POSITION_ROW, &phi.position),
            (Transition::VELOCITY_ROW, &phi.velocity),
            (Transition::ATTITUDE_ROW, &phi.attitude),
        ];
        for (row, shear) in shears {
            let mut sum = [self.closed[row], self.closed[row + 1], self.closed[row + 2]];
            for (j, g) in shear.iter() {
                let from = &self.closed[j];
                for (sum, g) in sum.iter_mut().zip(g) {
                    for (x, from) in sum[..n].iter_mut().zip(from) {
                        *x += g * from;
                    }
                }
            }
            self.closed[row..row + 3].copy_from_slice(&sum);
        }
        for (row, decay) in self
            .closed
            .iter_mut()
            .zip(&phi.decay)
            .take(n)
            .skip(Transition::SLOW)
        {
            for x in &mut row[..n] {
                *x *= decay;
            }
        }
    }

    /// An independent uncertainty more.
    pub(super) fn widen<const N: usize>(&mut self, block: Block<N>, extra: &SMatrix<f64, N, N>) {
        self.parts[KNOWN].add(block, extra);
        self.past.clear();
    }

    /// A block that is forgotten, and known anew.
    pub(super) fn forget<const N: usize>(&mut self, block: Block<N>, prior: &SMatrix<f64, N, N>) {
        let none = SMatrix::zeros();
        for (i, part) in self.parts.iter_mut().enumerate() {
            part.set_prior(block, if i == KNOWN { prior } else { &none });
        }
        self.past.clear();
    }

    /// A measurement that was refused: what follows is not the innovation of a filter that takes everything.
    pub(super) fn refused(&mut self, name: &str) {
        if role(name).is_some() {
            self.past.clear();
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
        let inverse = lower_inverse(&correction.s).filter(|_| counts);
        let own = match (role, inverse) {
            (Some(role), Some(inverse)) => {
                let velocity = role == NoiseUnknown::Velocity;
                Some((
                    velocity,
                    inverse,
                    self.compare(correction, velocity, &inverse, &at_once, n),
                ))
            }
            (Some(_), None) => {
                self.past.clear();
                None
            }
            (None, _) => None,
        };
        self.correct_parts(correction, &across, &at_once, n);
        let gain = &correction.gain;
        // (I − KH) on what leads here.
        if own.is_some() || !self.past.is_empty() {
            let mut seen = [[0.0; CAPACITY]; M];
            for (j, g) in correction.h.iter() {
                for (seen, g) in seen.iter_mut().zip(g) {
                    for (x, from) in seen[..n].iter_mut().zip(&self.closed[j]) {
                        *x += g * from;
                    }
                }
            }
            for (row, gain) in self.closed.iter_mut().zip(gain).take(n) {
                for (gain, seen) in gain.iter().zip(&seen) {
                    for (x, seen) in row[..n].iter_mut().zip(seen) {
                        *x -= gain * seen;
                    }
                }
            }
        }
        let Some((velocity, inverse, white)) = own else {
            return;
        };
        // E[e νᵀ] = P Hᵀ − K (H P Hᵀ + R) after the correction.
        let mut entry = if self.past.len() >= MOST_LAGS {
            self.past.pop_back()
        } else {
            None
        }
        .unwrap_or_else(|| Past {
            time: now,
            velocity,
            size: M,
            white,
            cross: Vec::new(),
            closed: Vec::new(),
        });
        entry.time = now;
        entry.velocity = velocity;
        entry.size = M;
        entry.white = white;
        entry.cross.clear();
        entry.cross.resize(n, [[0.0; 3]; PARTS]);
        for (i, cross) in entry.cross.iter_mut().enumerate() {
            for p in 0..PARTS {
                let left: [f64; M] = core::array::from_fn(|b| {
                    let taken: f64 = (0..M).map(|a| gain[i][a] * at_once[p][(a, b)]).sum();
                    across[p][i][b] - taken
                });
                for b in 0..M {
                    cross[p][b] = (0..=b).map(|c| left[c] * inverse[b][c]).sum();
                }
            }
        }
        entry.closed.clear();
        for row in &self.closed[..n] {
            entry.closed.extend_from_slice(&row[..n]);
        }
        self.past.push_front(entry);
        self.closed = identity();
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

    /// Compare this innovation with itself and with those before it.
    fn compare<const M: usize>(
        &mut self,
        correction: &Correction<'_, M>,
        velocity: bool,
        inverse: &[[f64; 3]; 3],
        at_once: &[SMatrix<f64, M, M>; PARTS],
        n: usize,
    ) -> [f64; 3] {
        let mut white = [0.0; 3];
        for a in 0..M {
            white[a] = (0..=a)
                .map(|c| inverse[a][c] * correction.residual[c])
                .sum();
        }
        let outer = |a: &[f64; 3], b: &[f64; 3]| a.map(|a| b.map(|b| a * b));
        self.sums.begin(correction.time, velocity);
        let normalised = |s: &SMatrix<f64, M, M>| {
            let mut out = [[0.0; 3]; 3];
            for a in 0..M {
                for b in 0..M {
                    for c in 0..=a {
                        for d in 0..=b {
                            out[a][b] += inverse[a][c] * s[(c, d)] * inverse[b][d];
                        }
                    }
                }
            }
            out
        };
        let product = Product {
            measured: outer(&white, &white),
            shares: core::array::from_fn(|p| normalised(&at_once[p])),
            known: normalised(&at_once[KNOWN]),
        };
        let pair = |then, lag, size| Pair {
            now: velocity,
            then,
            lag,
            size,
        };
        self.sums.add(&pair(velocity, 0, M), &product);
        // L⁻¹ H, carried back from one innovation to the one before.
        let mut observe = [[0.0; CAPACITY]; 3];
        for (j, g) in correction.h.iter() {
            for a in 0..M {
                let x: f64 = (0..=a).map(|c| inverse[a][c] * g[c]).sum();
                for (o, from) in observe[a][..n].iter_mut().zip(&self.closed[j]) {
                    *o += x * from;
                }
            }
        }
        for (lag, past) in self.past.iter().enumerate() {
            if correction.time.since(past.time) > LONGEST {
                break;
            }
            let mut predicted = [[[0.0; 3]; 3]; PARTS];
            for (i, cross) in past.cross.iter().enumerate() {
                for (out, cross) in predicted.iter_mut().zip(cross) {
                    for (out, observe) in out.iter_mut().zip(&observe) {
                        for (out, cross) in out.iter_mut().zip(cross) {
                            *out += observe[i] * cross;
                        }
                    }
                }
            }
            let product = Product {
                measured: outer(&white, &past.white),
                shares: core::array::from_fn(|p| predicted[p]),
                known: predicted[KNOWN],
            };
            self.sums
                .add(&pair(past.velocity, lag + 1, M.min(past.size)), &product);
            let mut before = [[0.0; CAPACITY]; 3];
            for (i, row) in past.closed.chunks_exact(n).enumerate() {
                for (before, observe) in before.iter_mut().zip(&observe) {
                    for (x, from) in before[..n].iter_mut().zip(row) {
                        *x += observe[i] * from;
                    }
                }
            }
            observe = before;
        }
        white
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

/// L⁻¹ with S = L Lᵀ.
fn lower_inverse<const M: usize>(s: &SMatrix<f64, M, M>) -> Option<[[f64; 3]; 3]> {
    let mut lower = [[0.0; 3]; 3];
    let mut inverse = [[0.0; 3]; 3];
    for a in 0..M {
        for b in 0..=a {
            let x = s[(a, b)] - (0..b).map(|c| lower[a][c] * lower[b][c]).sum::<f64>();
            if a == b {
                if !(x > 0.0) {
                    return None;
                }
                lower[a][a] = x.sqrt();
            } else {
                lower[a][b] = x / lower[b][b];
            }
        }
    }
    for b in 0..M {
        inverse[b][b] = 1.0 / lower[b][b];
        for a in b + 1..M {
            let x: f64 = (b..a).map(|c| lower[a][c] * inverse[c][b]).sum();
            inverse[a][b] = -x / lower[a][a];
        }
    }
    Some(inverse)
}
