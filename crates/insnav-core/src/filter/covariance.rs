//! The covariance of the open states and every operation on it.
//!
//! Number of states at run time inside a fixed capacity; Φ applied as three successive row shears (position, velocity,
//! attitude) instead of two matrix products; updates as rank-M corrections. Exactly symmetric throughout.

// The loops run over the indices of one formula, several arrays at once.
#![allow(clippy::needless_range_loop)]

use super::columns::{Columns, States};
use super::layout::{BASE, Block, CAPACITY, Layout};
use super::transition::Transition;
use crate::error::Result;
use core::ops::Range;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Columns that are worked on together: four double-precision numbers fill two registers of plain x86-64 and one of AVX.
const LANE: usize = 4;
const LANES: usize = CAPACITY / LANE;

/// Above this ratio of predicted to measured variance, P − WᵀW loses the digits of the result: the update then takes
/// Joseph's form. The relative error of a variance is about 1e-16 times the ratio.
const JOSEPH_RATIO: f64 = 1e10;

/// Covariance matrix over the open states of a [`Layout`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Covariance {
    layout: Layout,
    /// Row, lane, column within the lane; what lies beyond the open states is zero.
    p: [[[f64; LANE]; LANES]; CAPACITY],
}

/// What a measurement says of the states before it is used: its size against its own covariance, and the gain.
#[derive(Clone, Debug)]
pub struct Innovation<const M: usize> {
    /// Covariance of the residual, S = H P Hᵀ + R.
    pub s: SMatrix<f64, M, M>,
    /// Normalised innovation squared, rᵀ S⁻¹ r.
    pub nis: f64,
    /// L⁻¹ H P, where S = L Lᵀ.
    w: [[[f64; LANE]; LANES]; M],
    /// L⁻¹ r.
    y: [f64; M],
}

impl Default for Covariance {
    fn default() -> Self {
        Covariance {
            layout: Layout::default(),
            p: [[[0.0; LANE]; LANES]; CAPACITY],
        }
    }
}

impl Covariance {
    /// Which states are open.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The covariance between two blocks; `None` when one of them is not open.
    pub fn block<const R: usize, const C: usize>(
        &self,
        rows: Block<R>,
        columns: Block<C>,
    ) -> Option<SMatrix<f64, R, C>> {
        let (r, c) = (self.layout.offset(rows)?, self.layout.offset(columns)?);
        Some(SMatrix::from_fn(|i, j| self.get(r + i, c + j)))
    }

    /// Set the covariance within one open block and drop its correlations with all others; no effect on a closed block.
    pub fn set_prior<const N: usize>(&mut self, block: Block<N>, prior: &SMatrix<f64, N, N>) {
        let Some(at) = self.layout.offset(block) else {
            return;
        };
        for i in at..at + N {
            self.clear_row(i);
        }
        for i in 0..N {
            for j in 0..N {
                self.set(at + i, at + j, 0.5 * (prior[(i, j)] + prior[(j, i)]));
            }
        }
    }

    /// Set the covariance between two different open blocks; no effect when one of them is closed.
    ///
    /// The caller answers for the whole staying positive semidefinite.
    pub fn set_cross<const R: usize, const C: usize>(
        &mut self,
        rows: Block<R>,
        columns: Block<C>,
        cross: &SMatrix<f64, R, C>,
    ) {
        let (Some(r), Some(c)) = (self.layout.offset(rows), self.layout.offset(columns)) else {
            return;
        };
        for i in 0..R {
            for j in 0..C {
                self.set(r + i, c + j, cross[(i, j)]);
                self.set(c + j, r + i, cross[(i, j)]);
            }
        }
    }

    /// Set the covariance of all open states, by row and column, taken as symmetric.
    ///
    /// The caller answers for it being positive semidefinite.
    pub fn set_dense(&mut self, p: impl Fn(usize, usize) -> f64) {
        let n = self.layout.len();
        for i in 0..n {
            for j in 0..n {
                self.set(i, j, 0.5 * (p(i, j) + p(j, i)));
            }
        }
    }

    /// Add an independent uncertainty to one open block.
    pub fn add<const N: usize>(&mut self, block: Block<N>, extra: &SMatrix<f64, N, N>) {
        let Some(at) = self.layout.offset(block) else {
            return;
        };
        for i in 0..N {
            for j in 0..N {
                let x = self.get(at + i, at + j) + 0.5 * (extra[(i, j)] + extra[(j, i)]);
                self.set(at + i, at + j, x);
            }
        }
    }

    /// Turn the first two states of an open block by an angle, rad: P ← T P Tᵀ.
    pub(super) fn turn(&mut self, block: Block<3>, angle: f64) {
        let Some(a) = self.layout.offset(block) else {
            return;
        };
        let (b, (s, c)) = (a + 1, angle.sin_cos());
        let (aa, ab, bb) = (self.get(a, a), self.get(a, b), self.get(b, b));
        for j in (0..self.layout.len()).filter(|j| *j != a && *j != b) {
            let (x, y) = (self.get(a, j), self.get(b, j));
            for (i, turned) in [(a, c * x - s * y), (b, s * x + c * y)] {
                self.set(i, j, turned);
                self.set(j, i, turned);
            }
        }
        let across = c * s * (aa - bb) + (c * c - s * s) * ab;
        self.set(a, a, c * c * aa - 2.0 * c * s * ab + s * s * bb);
        self.set(b, b, s * s * aa + 2.0 * c * s * ab + c * c * bb);
        self.set(a, b, across);
        self.set(b, a, across);
    }

    /// Make all of it zero, of the same states.
    #[cfg(feature = "std")]
    pub(super) fn clear(&mut self) {
        self.p = Covariance::default().p;
    }

    /// Variance of one open state.
    pub(super) fn variance(&self, i: usize) -> f64 {
        self.get(i, i)
    }

    /// The leading `N` states as a dense matrix.
    pub fn dense<const N: usize>(&self) -> SMatrix<f64, N, N> {
        const { assert!(N <= CAPACITY) };
        SMatrix::from_fn(|i, j| self.get(i, j))
    }

    /// P ← Φ P Φᵀ + Q with Φ = D A V X: position, velocity and attitude shears, then the decay of the slow states.
    pub fn propagate(&mut self, phi: &Transition) {
        self.propagate_with(phi, &phi.noise);
    }

    /// As [`Covariance::propagate`], with another diagonal of Q.
    #[inline]
    pub(super) fn propagate_with(&mut self, phi: &Transition, noise: &States) {
        self.shear::<{ Transition::POSITION_ROW }>(&phi.position);
        self.shear::<{ Transition::VELOCITY_ROW }>(&phi.velocity);
        self.shear::<{ Transition::ATTITUDE_ROW }>(&phi.attitude);
        let n = self.layout.len().min(CAPACITY);
        let lanes = n.div_ceil(LANE);
        let (decay, _) = phi.decay.as_chunks::<LANE>();
        for i in 0..n {
            // Columns before the slow states keep their values in fast rows: only the slow lanes are touched there.
            let first = if i < Transition::SLOW {
                Transition::SLOW / LANE
            } else {
                0
            };
            let (row, factor) = (&mut self.p[i], phi.decay[i]);
            for k in first..lanes {
                for l in 0..LANE {
                    row[k][l] *= factor * decay[k][l];
                }
            }
        }
        // Noise last: added before a shear it would be sheared too.
        for (i, (row, noise)) in self.p.iter_mut().zip(noise).enumerate().take(n) {
            row.as_flattened_mut()[i] += noise;
        }
    }

    /// P ← (I + E) P (I + E)ᵀ, where E fills the three rows from `ROW`.
    #[inline]
    fn shear<const ROW: usize>(&mut self, e: &Columns<3>) {
        const { assert!(ROW + 3 <= BASE) };
        let lanes = self.layout.len().div_ceil(LANE).min(LANES);
        // Two lanes at once where there are two: a column's values are then loaded half as often.
        for pair in 0..lanes / 2 {
            self.add_rows::<ROW, 2>(pair, e);
        }
        if lanes % 2 == 1 {
            self.add_rows::<ROW, 1>(lanes - 1, e);
        }
        // The 3×3 block on the diagonal is multiplied from the right as well.
        let mut right = [[0.0; 3]; 3];
        for (j, g) in e.iter() {
            for a in 0..3 {
                for b in 0..=a {
                    right[a][b] += self.get(ROW + a, j) * g[b];
                }
            }
        }
        for a in 0..3 {
            for b in 0..=a {
                let x = self.get(ROW + a, ROW + b) + right[a][b];
                self.set(ROW + a, ROW + b, x);
                self.set(ROW + b, ROW + a, x);
            }
        }
        // Mirrored lane by lane; the padding of the last one is zero on both sides.
        for k in 0..lanes {
            for l in 0..LANE {
                for a in 0..3 {
                    let x = self.p[ROW + a][k][l];
                    self.set(k * LANE + l, ROW + a, x);
                }
            }
        }
    }

    /// P ← (I + E) P in the `at`-th group of `WIDE` lanes, where E fills the three rows from `ROW`.
    #[inline]
    fn add_rows<const ROW: usize, const WIDE: usize>(&mut self, at: usize, e: &Columns<3>) {
        const { assert!(LANES.is_multiple_of(WIDE)) };
        let group = |row: &[[f64; LANE]; LANES]| row.as_chunks::<WIDE>().0[at % (LANES / WIDE)];
        let mut sum = [0, 1, 2].map(|a| group(&self.p[ROW + a]));
        for (j, g) in e.iter() {
            let p = group(&self.p[j & (CAPACITY - 1)]);
            for a in 0..3 {
                for k in 0..WIDE {
                    for l in 0..LANE {
                        sum[a][k][l] += g[a] * p[k][l];
                    }
                }
            }
        }
        for a in 0..3 {
            self.p[ROW + a].as_chunks_mut::<WIDE>().0[at % (LANES / WIDE)] = sum[a];
        }
    }

    /// Compare a residual with its prediction; `Err(pivot)` when S = H P Hᵀ + R is not positive definite.
    pub fn innovation<const M: usize>(
        &self,
        h: &Columns<M>,
        r: &SMatrix<f64, M, M>,
        residual: &SVector<f64, M>,
    ) -> core::result::Result<Innovation<M>, f64> {
        let (hp, hph) = self.project(h);
        Innovation::new(hp, hph + r, residual, self.layout.len())
    }

    /// As [`Covariance::innovation`], for a noise that is in the states already: `cross` is E\[x vᵀ\], by its non-zero columns
    /// (\[Simon06\] section 7.1).
    ///
    /// Only [`Covariance::correct`] may follow, with a noise that is not small against the prediction.
    pub(super) fn innovation_correlated<const M: usize>(
        &self,
        h: &Columns<M>,
        r: &SMatrix<f64, M, M>,
        cross: &Columns<M>,
        residual: &SVector<f64, M>,
    ) -> core::result::Result<Innovation<M>, f64> {
        let (mut hp, mut s) = self.project(h);
        for (j, c) in cross.iter() {
            for a in 0..M {
                hp[a][j / LANE % LANES][j % LANE] += c[a];
            }
            for (_, g) in h.iter().filter(|(i, _)| *i == j) {
                s += SMatrix::<f64, M, M>::from_fn(|a, b| g[a] * c[b] + c[a] * g[b]);
            }
        }
        Innovation::new(hp, s + r, residual, self.layout.len())
    }

    /// H P and H P Hᵀ.
    fn project<const M: usize>(
        &self,
        h: &Columns<M>,
    ) -> ([[[f64; LANE]; LANES]; M], SMatrix<f64, M, M>) {
        let lanes = self.layout.len().div_ceil(LANE).min(LANES);
        let mut hp = [[[0.0; LANE]; LANES]; M];
        for k in 0..lanes {
            let mut sum = [[0.0; LANE]; M];
            for (j, g) in h.iter() {
                let p = &self.p[j & (CAPACITY - 1)][k];
                for a in 0..M {
                    for l in 0..LANE {
                        sum[a][l] += g[a] * p[l];
                    }
                }
            }
            for a in 0..M {
                hp[a][k] = sum[a];
            }
        }
        let mut hph = SMatrix::<f64, M, M>::zeros();
        for (j, g) in h.iter() {
            for a in 0..M {
                for b in 0..=a {
                    hph[(a, b)] += hp[a][j / LANE % LANES][j % LANE] * g[b];
                }
            }
        }
        for a in 0..M {
            for b in 0..a {
                hph[(b, a)] = hph[(a, b)];
            }
        }
        (hp, hph)
    }

    /// Use a measurement: P shrinks, and the correction of the states comes back.
    ///
    /// `h`, `r` must be those that made the innovation.
    pub fn correct<const M: usize>(
        &mut self,
        innovation: &Innovation<M>,
        h: &Columns<M>,
        r: &SMatrix<f64, M, M>,
    ) -> States {
        let n = self.layout.len();
        let mut dx = [0.0; CAPACITY];
        for (w, y) in innovation.w.iter().zip(innovation.y) {
            for (dx, w) in dx.iter_mut().zip(w.as_flattened()).take(n) {
                *dx += w * y;
            }
        }
        let ill = (0..M).any(|a| innovation.s[(a, a)] > (1.0 + JOSEPH_RATIO) * r[(a, a)]);
        if ill {
            self.correct_joseph(innovation, h, r, 0..n);
        } else {
            let lanes = n.div_ceil(LANE).min(LANES);
            for (i, row) in self.p.iter_mut().enumerate().take(n) {
                let wi: [f64; M] =
                    core::array::from_fn(|m| innovation.w[m][i / LANE % LANES][i % LANE]);
                for k in 0..lanes {
                    for (wi, w) in wi.iter().zip(&innovation.w) {
                        for l in 0..LANE {
                            row[k][l] -= wi * w[k][l];
                        }
                    }
                }
            }
        }
        dx
    }

    /// As [`Covariance::correct`], with a gain on one block alone: all other states stay as they are and as uncertain as they
    /// are (a Schmidt update, \[Schmidt66\]), and their covariances with the block are those that this gain leaves.
    pub fn correct_only<const M: usize, const N: usize>(
        &mut self,
        innovation: &Innovation<M>,
        h: &Columns<M>,
        r: &SMatrix<f64, M, M>,
        block: Block<N>,
    ) -> States {
        let mut dx = [0.0; CAPACITY];
        let Some(rows) = self.layout.range(block) else {
            return dx;
        };
        for (w, y) in innovation.w.iter().zip(innovation.y) {
            for i in rows.clone() {
                dx[i] += w.as_flattened()[i] * y;
            }
        }
        self.correct_joseph(innovation, h, r, rows);
        dx
    }

    /// K by rows: those of the block that alone is corrected, or all.
    #[cfg(feature = "std")]
    pub(super) fn gain<const M: usize, const N: usize>(
        &self,
        innovation: &Innovation<M>,
        only: Option<Block<N>>,
    ) -> [[f64; M]; CAPACITY] {
        let rows = match only {
            Some(block) => self.layout.range(block).unwrap_or(0..0),
            None => 0..self.layout.len(),
        };
        gain_rows(innovation, rows)
    }

    /// P ← (I − K H) P (I − K H)ᵀ + K R Kᵀ: slower, positive whatever the ratio of P to R and whichever rows K has.
    #[cold]
    fn correct_joseph<const M: usize>(
        &mut self,
        innovation: &Innovation<M>,
        h: &Columns<M>,
        r: &SMatrix<f64, M, M>,
        rows: Range<usize>,
    ) {
        let n = self.layout.len();
        let gain = gain_rows(innovation, rows);
        // A = (I − K H) P first by rows, then by columns of the result.
        let mut a = self.p;
        for i in 0..n {
            for (j, g) in h.iter() {
                let kh: f64 = (0..M).map(|m| gain[i][m] * g[m]).sum();
                for k in 0..LANES {
                    for l in 0..LANE {
                        a[i][k][l] -= kh * self.p[j][k][l];
                    }
                }
            }
        }
        let mut right = [[0.0; M]; CAPACITY];
        for (i, right) in right.iter_mut().enumerate().take(n) {
            for (j, g) in h.iter() {
                for m in 0..M {
                    right[m] += a[i][j / LANE][j % LANE] * g[m];
                }
            }
        }
        for i in 0..n {
            for j in 0..=i {
                let mut x = a[i][j / LANE][j % LANE];
                for m in 0..M {
                    let rk: f64 = (0..M).map(|b| r[(m, b)] * gain[j][b]).sum();
                    x += gain[i][m] * rk - right[i][m] * gain[j][m];
                }
                self.set(i, j, x);
                self.set(j, i, x);
            }
        }
    }

    /// Open an optional block with an independent prior; an open one gets the prior anew.
    ///
    /// # Errors
    /// `Capacity` when there is no room.
    pub fn open<const N: usize>(
        &mut self,
        block: Block<N>,
        prior: &SMatrix<f64, N, N>,
    ) -> Result<()> {
        self.layout.open(block)?;
        self.set_prior(block, prior);
        Ok(())
    }

    /// Drop an optional block (marginalise it); the states behind it move up. No effect on base blocks or a closed block.
    pub fn close<const N: usize>(&mut self, block: Block<N>) {
        let n = self.layout.len();
        let Some(gone) = self.layout.close(block) else {
            return;
        };
        for i in gone..n - N {
            self.p[i] = self.p[i + N];
        }
        for i in 0..n {
            for j in gone..n - N {
                let x = self.get(i, j + N);
                self.set(i, j, x);
            }
        }
        for i in n - N..n {
            self.clear_row(i);
        }
    }

    /// Move the states of `from` that begin at `axis` into a block of their own with all their covariances, leaving zero
    /// behind: P ← T P Tᵀ. A block that is open already gains what is moved.
    ///
    /// The total, the two together, is unchanged; [`Covariance::merge`] is the exact way back (\[Kozadaev17\] eq. 9–12 with the
    /// cross-covariances kept).
    ///
    /// # Errors
    /// `Capacity` when there is no room.
    pub fn split<const N: usize, const K: usize>(
        &mut self,
        from: Block<N>,
        axis: usize,
        into: Block<K>,
    ) -> Result<()> {
        debug_assert!(axis + K <= N);
        let Some(source) = self.layout.offset(from).map(|at| at + axis) else {
            return Ok(());
        };
        let target = self.layout.open(into)?;
        for k in 0..K {
            self.add_state(source + k, target + k);
            self.clear_row(source + k);
        }
        Ok(())
    }

    /// Add the states of a block to others and drop it: P ← S P Sᵀ, the inverse of [`Covariance::split`].
    pub fn merge<const N: usize, const K: usize>(
        &mut self,
        from: Block<K>,
        into: Block<N>,
        axis: usize,
    ) {
        debug_assert!(axis + K <= N);
        let (Some(source), Some(target)) = (
            self.layout.offset(from),
            self.layout.offset(into).map(|at| at + axis),
        ) else {
            return;
        };
        for k in 0..K {
            self.add_state(source + k, target + k);
        }
        self.close(from);
    }

    /// Add one state to another: row, then column.
    fn add_state(&mut self, source: usize, target: usize) {
        let n = self.layout.len();
        for j in 0..n {
            let x = self.get(target, j) + self.get(source, j);
            self.set(target, j, x);
        }
        for j in (0..n).filter(|j| *j != target) {
            let x = self.get(target, j);
            self.set(j, target, x);
        }
        let variance = self.get(target, target) + self.get(target, source);
        self.set(target, target, variance);
    }

    #[inline]
    pub(super) fn get(&self, i: usize, j: usize) -> f64 {
        debug_assert!(i < CAPACITY && j < CAPACITY);
        self.p[i & (CAPACITY - 1)][j / LANE % LANES][j % LANE]
    }

    #[inline]
    pub(super) fn set(&mut self, i: usize, j: usize, x: f64) {
        debug_assert!(i < CAPACITY && j < CAPACITY);
        self.p[i & (CAPACITY - 1)][j / LANE % LANES][j % LANE] = x;
    }

    fn clear_row(&mut self, i: usize) {
        self.p[i] = [[0.0; LANE]; LANES];
        for j in 0..CAPACITY {
            self.set(j, i, 0.0);
        }
    }
}

/// K = (L⁻ᵀ W)ᵀ, column by column of W.
fn gain_rows<const M: usize>(
    innovation: &Innovation<M>,
    rows: Range<usize>,
) -> [[f64; M]; CAPACITY] {
    let mut gain = [[0.0; M]; CAPACITY];
    let cholesky = innovation.s.cholesky();
    for (i, gain) in gain.iter_mut().enumerate().take(rows.end).skip(rows.start) {
        let mut w = SVector::<f64, M>::from_fn(|a, _| innovation.w[a][i / LANE][i % LANE]);
        if let Some(c) = &cholesky {
            c.l().tr_solve_lower_triangular_mut(&mut w);
        }
        for a in 0..M {
            gain[a] = w[a];
        }
    }
    gain
}

impl<const M: usize> Innovation<M> {
    fn new(
        hp: [[[f64; LANE]; LANES]; M],
        s: SMatrix<f64, M, M>,
        residual: &SVector<f64, M>,
        n: usize,
    ) -> core::result::Result<Self, f64> {
        let lanes = n.div_ceil(LANE).min(LANES);
        let (mut w, mut y) = (hp, [0.0; M]);
        let mut lower = [[0.0; M]; M];
        // Cholesky of S and forward substitution in one pass, row by row.
        for a in 0..M {
            for b in 0..a {
                let mut x = s[(a, b)];
                for c in 0..b {
                    x -= lower[a][c] * lower[b][c];
                }
                lower[a][b] = x / lower[b][b];
            }
            let mut pivot = s[(a, a)];
            for c in 0..a {
                pivot -= lower[a][c] * lower[a][c];
            }
            // Written so that NaN fails too.
            if !(pivot > 0.0 && pivot.is_finite()) {
                return Err(pivot);
            }
            lower[a][a] = pivot.sqrt();
            let scale = 1.0 / lower[a][a];
            y[a] = residual[a];
            for b in 0..a {
                y[a] -= lower[a][b] * y[b];
            }
            y[a] *= scale;
            let (done, rest) = w.split_at_mut(a);
            for k in 0..lanes {
                let mut x = rest[0][k];
                for (factor, done) in lower[a].iter().zip(&*done) {
                    for l in 0..LANE {
                        x[l] -= factor * done[k][l];
                    }
                }
                rest[0][k] = x.map(|x| x * scale);
            }
        }
        let nis = y.iter().map(|y| y * y).sum();
        Ok(Innovation { s, nis, w, y })
    }
}
