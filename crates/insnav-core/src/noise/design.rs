//! What each unknown adds to the lag covariances: the design matrix of autocovariance least squares.

use super::model::{powers_until_gone, shape, symmetric};
use super::{Basis, Block, LinearModel, Refusal};
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::string::String;
use std::vec::Vec;

/// Singular values of the scaled columns below this share of the largest count as zero: a hundred thousand roundings.
const RANK_TOLERANCE: f64 = 1e-10;
/// Unknowns with a component above this in a direction that nothing determines are named.
const NAMED_COMPONENT: f64 = 1e-6;

/// Lag covariances C₀ … C_J₋₁ of the innovations, as a linear function of the unknowns.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "Stored")]
pub struct Design {
    #[serde(with = "super::stored")]
    columns: DMatrix<f64>,
    basis: Basis,
    #[serde(with = "super::stored")]
    h: DMatrix<f64>,
    #[serde(with = "super::stored")]
    closed: DMatrix<f64>,
    /// F̄ P Hᵀ − F L R for each unknown: the state's share in the next innovation, from which all lags follow.
    #[serde(with = "super::stored::list")]
    shares: Vec<DMatrix<f64>>,
    lags: usize,
}

/// A [`Design`] as it is read, before its parts are held against each other.
#[derive(Deserialize)]
struct Stored {
    #[serde(with = "super::stored")]
    columns: DMatrix<f64>,
    basis: Basis,
    #[serde(with = "super::stored")]
    h: DMatrix<f64>,
    #[serde(with = "super::stored")]
    closed: DMatrix<f64>,
    #[serde(with = "super::stored::list")]
    shares: Vec<DMatrix<f64>>,
    lags: usize,
}

impl TryFrom<Stored> for Design {
    type Error = &'static str;

    fn try_from(stored: Stored) -> Result<Self, Self::Error> {
        let Stored {
            columns,
            basis,
            h,
            closed,
            shares,
            lags,
        } = stored;
        let (p, n) = h.shape();
        let rows = p.checked_mul(p).and_then(|each| each.checked_mul(lags));
        let fits = columns.nrows() > 0
            && !basis.is_empty()
            && rows == Some(columns.nrows())
            && columns.ncols() == basis.len()
            && basis.size(Block::Measurement) == p
            && basis.unknowns().iter().all(|unknown| {
                let size = basis.size(unknown.block);
                unknown.matrix.shape() == (size, size)
            })
            && closed.shape() == (n, n)
            && shares.len() == basis.len()
            && shares.iter().all(|share| share.shape() == (n, p));
        if !fits {
            return Err("a design with matrices of sizes that do not belong together");
        }
        Ok(Design {
            columns,
            basis,
            h,
            closed,
            shares,
            lags,
        })
    }
}

/// How well the unknowns can be told apart, of columns scaled to the same length.
#[derive(Clone, Debug, PartialEq)]
pub struct RankReport {
    /// Number of combinations that are determined.
    pub rank: usize,
    /// Number of unknowns.
    pub unknowns: usize,
    /// Largest by smallest singular value; infinite where the rank is short.
    pub condition: f64,
    /// The combination that is determined worst: unknowns and their shares, the largest first.
    pub weakest: Vec<(String, f64)>,
    /// Unknowns that have a part in what is not determined.
    pub undetermined: Vec<String>,
}

/// The design of autocovariance least squares for a fixed gain L (`gain`, n × p, which corrects the predicted state).
///
/// Column i holds C₀ … C_J₋₁ of the unknown i alone, element (a, b) of lag j at j p² + b p + a (\[Odelson06\], per unknown
/// in place of one Kronecker product for all):
///
/// ```text
/// F̄ = F − F L H      P = F̄ P F̄ᵀ + G Q Gᵀ + (F L) R (F L)ᵀ
/// C₀ = H P Hᵀ + R     Cⱼ = H F̄ʲ P Hᵀ − H F̄ʲ⁻¹ F L R
/// ```
///
/// The Lyapunov equations are solved by doubling; all unknowns share the powers F̄, F̄², F̄⁴ …. The stationary P is right
/// after the transient of a constant gain, and for nothing else. Sizes are those at run time, which needs `std`;
/// [`FixedDesign`](super::FixedDesign) and [`ChannelDesign`](super::ChannelDesign) are the same for sizes known beforehand.
///
/// # Errors
/// [`Refusal::Unstable`] when F̄ is not stable, [`Refusal::Shape`], [`Refusal::NotFinite`].
pub fn als_design(
    model: &LinearModel,
    gain: &DMatrix<f64>,
    basis: &Basis,
    lags: usize,
) -> Result<Design, Refusal> {
    model.check()?;
    let (n, p) = (model.states(), model.channels());
    shape("gain", gain, n, p)?;
    for (what, size, expected) in [
        (
            "process noise of the basis",
            basis.size(Block::Process),
            model.g.ncols(),
        ),
        (
            "measurement noise of the basis",
            basis.size(Block::Measurement),
            p,
        ),
        ("number of unknowns", basis.len().min(1), 1),
        ("number of lags", lags.min(1), 1),
    ] {
        if size != expected {
            return Err(Refusal::Shape {
                what,
                found: std::format!("{size}"),
                expected: std::format!("{expected}"),
            });
        }
    }
    let fl = &model.f * gain;
    let closed = model.closed_loop(gain);
    let powers = powers_until_gone(&closed)?;
    let mut columns = DMatrix::zeros(lags * p * p, basis.len());
    let mut shares = Vec::with_capacity(basis.len());
    for (mut column, unknown) in columns.column_iter_mut().zip(basis.unknowns()) {
        let (enters, r) = match unknown.block {
            Block::Process => (&model.g, None),
            Block::Measurement => (&fl, Some(&unknown.matrix)),
        };
        let mut covariance = enters * &unknown.matrix * enters.transpose();
        for power in &powers {
            covariance += symmetric(power * &covariance * power.transpose());
        }
        let across = &covariance * model.h.transpose();
        let mut at_once = &model.h * &across;
        let mut share = &closed * across;
        if let Some(r) = r {
            at_once += r;
            share -= &fl * r;
        }
        column
            .rows_mut(0, p * p)
            .copy_from_slice(at_once.as_slice());
        shares.push(share);
    }
    let mut observed = model.h.clone();
    for lag in 1..lags {
        for (mut column, share) in columns.column_iter_mut().zip(&shares) {
            column
                .rows_mut(lag * p * p, p * p)
                .copy_from_slice((&observed * share).as_slice());
        }
        observed *= &closed;
    }
    Ok(Design {
        columns,
        basis: basis.clone(),
        h: model.h.clone(),
        closed,
        shares,
        lags,
    })
}

impl Design {
    /// The matrix A: one row for each element of each lag, one column for each unknown.
    pub fn columns(&self) -> &DMatrix<f64> {
        &self.columns
    }

    /// The unknowns.
    pub fn basis(&self) -> &Basis {
        &self.basis
    }

    /// Number of lags, J.
    pub fn lags(&self) -> usize {
        self.lags
    }

    /// Number of components of the innovation, p.
    pub fn channels(&self) -> usize {
        self.h.nrows()
    }

    /// Cⱼ of the model at θ, from lag 0 until they are gone, at least `least` and at most `most` lags, p × p each by columns.
    pub(super) fn covariances(&self, theta: &[f64], least: usize, most: usize) -> Vec<f64> {
        let p = self.channels();
        let mut values: Vec<f64> = (0..p * p)
            .map(|row| {
                self.columns
                    .row(row)
                    .iter()
                    .zip(theta)
                    .map(|(a, t)| a * t)
                    .sum()
            })
            .collect();
        let scale = (0..p).map(|a| values[a * p + a].abs()).fold(0.0, f64::max);
        let mut state = self
            .shares
            .iter()
            .zip(theta)
            .fold(DMatrix::zeros(self.closed.nrows(), p), |sum, (share, t)| {
                sum + share * *t
            });
        let mut next = state.clone();
        let mut quiet = 0;
        for lag in 1..most {
            let start = values.len();
            values.resize(start + p * p, 0.0);
            for b in 0..p {
                for a in 0..p {
                    values[start + b * p + a] = (0..self.h.ncols())
                        .map(|i| self.h[(a, i)] * state[(i, b)])
                        .sum();
                }
            }
            // Oscillations pass through zero: a row of small values, not one. What is left out adds its square to sums of
            // squares: 2e-4 of them if it went on for twenty thousand lags.
            let size = values[start..].iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            quiet = if size < 1e-4 * scale { quiet + 1 } else { 0 };
            if lag + 1 >= least && quiet > 16 {
                break;
            }
            next.gemm(1.0, &self.closed, &state, 0.0);
            core::mem::swap(&mut state, &mut next);
        }
        values
    }

    /// Rank, condition and weakest direction of the columns of some unknowns (`wanted`, indices).
    pub fn rank_report(&self, wanted: &[usize]) -> RankReport {
        rank_report(&self.columns, &self.basis, wanted)
    }
}

pub(super) fn rank_report(columns: &DMatrix<f64>, basis: &Basis, wanted: &[usize]) -> RankReport {
    let k = wanted.len();
    let mut scaled = columns.select_columns(wanted);
    for mut column in scaled.column_iter_mut() {
        let length = column.norm();
        if length > 0.0 {
            column /= length;
        }
    }
    // Of the triangular factor, whose singular values are those of the whole.
    let factor = if scaled.nrows() > k {
        scaled.qr().r()
    } else {
        scaled
    };
    let svd = factor.svd(false, true);
    let values = &svd.singular_values;
    let largest = values.max();
    let rank = values
        .iter()
        .filter(|v| **v > RANK_TOLERANCE * largest)
        .count();
    let name = |i: usize| basis.unknowns()[wanted[i]].name.clone();
    let mut weakest = Vec::new();
    let mut undetermined = Vec::new();
    if let Some(directions) = &svd.v_t {
        let last = directions.row(values.imin());
        let mut order: Vec<usize> = (0..k).collect();
        order.sort_by(|a, b| last[*b].abs().total_cmp(&last[*a].abs()));
        weakest = order
            .iter()
            .filter(|i| last[**i].abs() > 0.1)
            .map(|i| (name(*i), last[*i]))
            .collect();
        // Fewer rows than unknowns: directions beyond the rows have no singular value at all.
        let held = |i: usize| -> f64 {
            values
                .iter()
                .zip(directions.row_iter())
                .filter(|(v, _)| **v > RANK_TOLERANCE * largest)
                .map(|(_, d)| d[i] * d[i])
                .sum()
        };
        undetermined = (0..k)
            .filter(|i| rank < k && 1.0 - held(*i) > NAMED_COMPONENT)
            .map(name)
            .collect();
    }
    RankReport {
        rank,
        unknowns: k,
        condition: if rank < k {
            f64::INFINITY
        } else {
            largest / values.min()
        },
        weakest,
        undetermined,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    #[test]
    fn designs_whose_parts_do_not_belong_together_are_not_read() {
        let model = LinearModel {
            f: DMatrix::from_row_slice(2, 2, &[1.0, -0.1, 0.0, 0.95]),
            g: DMatrix::identity(2, 2),
            h: DMatrix::from_row_slice(1, 2, &[1.0, 0.0]),
        };
        let gain = DMatrix::from_row_slice(2, 1, &[0.3, -0.1]);
        let basis = Basis::diagonal(2, 1);
        let design = als_design(&model, &gain, &basis, 5).expect("stable");
        let stored = serde_json::to_value(&design).expect("numbers");
        let read = |value: &Value| serde_json::from_value::<Design>(value.clone());
        let back = read(&stored).expect("the same");
        assert_eq!(back.columns, design.columns);
        let matrix = |rows: usize, columns: usize| json!({"rows": rows, "columns": columns, "values": std::vec![0.1; rows * columns]});
        for (place, other) in [
            ("/lags", json!(4)),
            ("/lags", json!(0)),
            ("/columns", matrix(5, 2)),
            ("/columns", matrix(0, 3)),
            ("/h", matrix(2, 2)),
            ("/h", matrix(1, 3)),
            ("/closed", matrix(2, 3)),
            ("/shares/1", matrix(1, 2)),
            ("/shares", json!([])),
            ("/basis/measurement", json!(2)),
            ("/basis/process", json!(1)),
            ("/basis/unknowns", json!([])),
            ("/basis/unknowns/0/matrix", matrix(1, 1)),
        ] {
            let mut wrong = stored.clone();
            *wrong.pointer_mut(place).expect(place) = other;
            let error = read(&wrong).expect_err(place).to_string();
            assert!(error.contains("do not belong together"), "{place}: {error}");
        }
    }
}
