//! The innovations before this one, and what leads from each to the next.

use super::{CROSS, Correction, KNOWN, PARTS};
use crate::filter::columns::Columns;
use crate::filter::layout::CAPACITY;
use crate::filter::transition::Transition;
use crate::noise::{InnovationSums, Pair, Product};
use crate::time::Time;
use nalgebra::SMatrix;
use std::collections::VecDeque;
use std::vec::Vec;

/// Products reach back over so many innovations …
const MOST_LAGS: usize = 64;
/// … and so long, s: the errors of position and velocity that a receiver leaves do not last longer.
const LONGEST: f64 = 20.0;

/// Closed loops and innovations, newest first.
#[derive(Clone, Debug)]
pub(super) struct Past {
    /// From the errors after the last innovation to those now.
    closed: [[f64; CAPACITY]; CAPACITY],
    list: VecDeque<Innovation>,
}

#[derive(Clone, Debug)]
struct Innovation {
    time: Time,
    velocity: bool,
    size: usize,
    /// L⁻¹ ν, where S = L Lᵀ.
    white: [f64; 3],
    /// State by state: how the errors after the innovation before this one go over into those after this one, and E[e νᵀ] L⁻ᵀ
    /// after the correction for each part, side by side, since both are multiplied by the same.
    rows: Vec<f64>,
}

/// An innovation that counts, in units of its own sigmas.
pub(super) struct Normalised {
    velocity: bool,
    white: [f64; 3],
    /// L⁻¹.
    inverse: [[f64; 3]; 3],
}

fn identity() -> [[f64; CAPACITY]; CAPACITY] {
    core::array::from_fn(|i| core::array::from_fn(|j| f64::from(u8::from(i == j))))
}

impl Past {
    pub(super) fn new() -> Self {
        Past {
            closed: identity(),
            list: VecDeque::with_capacity(MOST_LAGS),
        }
    }

    /// What comes next has nothing to do with what was.
    pub(super) fn end(&mut self) {
        if !self.list.is_empty() {
            self.list.clear();
            self.closed = identity();
        }
    }

    /// An interval, with `n` states.
    pub(super) fn advance(&mut self, phi: &Transition, n: usize) {
        if self.list.is_empty() {
            return;
        }
        let shears = [
            (Transition::POSITION_ROW, &phi.position),
            (Transition::VELOCITY_ROW, &phi.velocity),
            (Transition::ATTITUDE_ROW, &phi.attitude),
        ];
        let closed = &mut self.closed;
        for (row, shear) in shears {
            let mut sum = [closed[row], closed[row + 1], closed[row + 2]];
            for (j, g) in shear.iter() {
                for (sum, g) in sum.iter_mut().zip(g) {
                    add(&mut sum[..n], *g, &closed[j]);
                }
            }
            closed[row..row + 3].copy_from_slice(&sum);
        }
        let decays = closed.iter_mut().zip(&phi.decay);
        for (row, decay) in decays.take(n).skip(Transition::SLOW) {
            for x in &mut row[..n] {
                *x *= decay;
            }
        }
    }

    /// The level errors turn with the estimate. (While an attitude is held nothing is compared.)
    pub(super) fn turn_level(&mut self, angle: f64) {
        if self.list.is_empty() {
            return;
        }
        let (s, c) = angle.sin_cos();
        let [north, east] = [0, 1].map(|axis| self.closed[Transition::ATTITUDE_ROW + axis]);
        for j in 0..CAPACITY {
            self.closed[Transition::ATTITUDE_ROW][j] = c * north[j] - s * east[j];
            self.closed[Transition::ATTITUDE_ROW + 1][j] = s * north[j] + c * east[j];
        }
    }

    /// A correction: (I − K H) on what leads here.
    pub(super) fn correct<const M: usize>(
        &mut self,
        h: &Columns<M>,
        gain: &[[f64; M]; CAPACITY],
        n: usize,
    ) {
        if self.list.is_empty() {
            return;
        }
        let mut seen = [[0.0; CAPACITY]; M];
        for (j, g) in h.iter() {
            for (seen, g) in seen.iter_mut().zip(g) {
                add(&mut seen[..n], *g, &self.closed[j]);
            }
        }
        for (row, gain) in self.closed.iter_mut().zip(gain).take(n) {
            for (gain, seen) in gain.iter().zip(&seen) {
                add(&mut row[..n], -gain, seen);
            }
        }
    }

    /// Compare an innovation with itself and with those before it; `at_once` is what each part adds to its covariance. `None`
    /// when S is none.
    pub(super) fn compare<const M: usize>(
        &self,
        correction: &Correction<'_, M>,
        velocity: bool,
        at_once: &[SMatrix<f64, M, M>; PARTS],
        n: usize,
        sums: &mut InnovationSums,
    ) -> Option<Normalised> {
        let inverse = lower_inverse(&correction.s)?;
        let mut white = [0.0; 3];
        for a in 0..M {
            white[a] = (0..=a)
                .map(|c| inverse[a][c] * correction.residual[c])
                .sum();
        }
        let outer = |a: &[f64; 3], b: &[f64; 3]| a.map(|a| b.map(|b| a * b));
        let own = |p: usize| {
            let mut out = [[0.0; 3]; 3];
            for a in 0..M {
                for b in 0..M {
                    for c in 0..=a {
                        for d in 0..=b {
                            out[a][b] += inverse[a][c] * at_once[p][(c, d)] * inverse[b][d];
                        }
                    }
                }
            }
            out
        };
        sums.begin(correction.time, velocity);
        let product = Product {
            measured: outer(&white, &white),
            shares: core::array::from_fn(own),
            known: own(KNOWN),
        };
        let pair = |then, lag, size| Pair {
            now: velocity,
            then,
            lag,
            size,
        };
        sums.add(&pair(velocity, 0, M), &product);
        // L⁻¹ H, carried back from one innovation to the one before.
        let mut observe = [[0.0; CAPACITY]; 3];
        for (j, g) in correction.h.iter() {
            for a in 0..M {
                let x = (0..=a).map(|c| inverse[a][c] * g[c]).sum();
                add(&mut observe[a][..n], x, &self.closed[j]);
            }
        }
        for (lag, past) in self.list.iter().enumerate() {
            if correction.time.since(past.time) > LONGEST {
                break;
            }
            let mut both = [[0.0; CAPACITY + CROSS]; 3];
            for (i, row) in past.rows.chunks_exact(n + CROSS).enumerate() {
                for (both, observe) in both.iter_mut().zip(&observe) {
                    add(both, observe[i], row);
                }
            }
            let predicted = |p: usize| -> [[f64; 3]; 3] {
                let at = n + 3 * p;
                core::array::from_fn(|a| [both[a][at], both[a][at + 1], both[a][at + 2]])
            };
            let product = Product {
                measured: outer(&white, &past.white),
                shares: core::array::from_fn(predicted),
                known: predicted(KNOWN),
            };
            sums.add(&pair(past.velocity, lag + 1, M.min(past.size)), &product);
            for (observe, both) in observe.iter_mut().zip(&both) {
                observe[..n].copy_from_slice(&both[..n]);
            }
        }
        Some(Normalised {
            velocity,
            white,
            inverse,
        })
    }

    /// Keep an innovation after [`Past::correct`]; `across` is P Hᵀ of each part before it.
    pub(super) fn keep<const M: usize>(
        &mut self,
        innovation: &Normalised,
        correction: &Correction<'_, M>,
        across: &[[[f64; M]; CAPACITY]; PARTS],
        at_once: &[SMatrix<f64, M, M>; PARTS],
        n: usize,
    ) {
        let oldest = match self.list.len() {
            MOST_LAGS.. => self.list.pop_back(),
            _ => None,
        };
        let mut rows = oldest.map(|oldest| oldest.rows).unwrap_or_default();
        rows.clear();
        for (i, (closed, gain)) in self.closed.iter().zip(&correction.gain).enumerate().take(n) {
            rows.extend_from_slice(&closed[..n]);
            for (across, at_once) in across.iter().zip(at_once) {
                // E[e νᵀ] = P Hᵀ − K (H P Hᵀ + R) after the correction.
                let left: [f64; M] = core::array::from_fn(|b| {
                    across[i][b] - (0..M).map(|a| gain[a] * at_once[(a, b)]).sum::<f64>()
                });
                for b in 0..3 {
                    let known = &innovation.inverse[b];
                    rows.push(left.iter().zip(known).map(|(x, l)| x * l).sum());
                }
            }
        }
        self.list.push_front(Innovation {
            time: correction.time,
            velocity: innovation.velocity,
            size: M,
            white: innovation.white,
            rows,
        });
        self.closed = identity();
    }
}

/// to += factor · from, as far as the shorter goes.
#[inline]
fn add(to: &mut [f64], factor: f64, from: &[f64]) {
    for (x, from) in to.iter_mut().zip(from) {
        *x += factor * from;
    }
}

/// L⁻¹ with S = L Lᵀ; rows beyond the size of S are zero.
fn lower_inverse<const M: usize>(s: &SMatrix<f64, M, M>) -> Option<[[f64; 3]; 3]> {
    let mut lower = [[0.0; 3]; 3];
    let mut inverse = [[0.0; 3]; 3];
    for a in 0..M {
        for b in 0..=a {
            let x = s[(a, b)] - (0..b).map(|c| lower[a][c] * lower[b][c]).sum::<f64>();
            if a == b {
                // NaN is no variance either.
                if x.is_nan() || x <= 0.0 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Matrix3};

    #[test]
    fn the_inverse_of_the_root_whitens() {
        let s = Matrix3::new(4.0, 1.0, -0.5, 1.0, 9.0, 2.0, -0.5, 2.0, 0.9);
        let inverse = lower_inverse(&s).expect("positive definite");
        let inverse = Matrix3::from_fn(|i, j| inverse[i][j]);
        let one = inverse * s * inverse.transpose();
        assert!((one - Matrix3::identity()).amax() < 1e-14, "{one}");
        let flat = Matrix2::new(1.0, 1.0, 1.0, 1.0);
        assert!(lower_inverse(&flat).is_none());
        assert!(lower_inverse(&Matrix2::from_element(f64::NAN)).is_none());
        let two = lower_inverse(&Matrix2::new(4.0, 0.0, 0.0, 9.0)).expect("diagonal");
        assert_eq!(two, [[0.5, 0.0, 0.0], [0.0, 1.0 / 3.0, 0.0], [0.0; 3]]);
    }
}
