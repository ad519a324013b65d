//! Autocovariance least squares: noise from lag covariances.

use super::bartlett::{self, Row, independent_rows};
use super::cone::{Cone, nonnegative, semidefinite};
use super::design::rank_report;
use super::{Basis, Block, Design, Estimate, LagCovariance, Refusal, Verdict};
use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};
use std::format;
use std::vec::Vec;

/// Longest model covariance that a weight is made of, in lags.
const MOST_MODEL_LAGS: usize = 20_000;
/// Unknowns count in a weight with no less than this share of what the data would allow them alone: of a variance of zero
/// the weight would believe that nothing can look like it.
const LEAST_SHARE_IN_WEIGHT: f64 = 1e-4;
/// An eigenvalue below this share of the largest is on the bound; the barrier method stops at 1e-13 of the objective.
const ON_BOUND: f64 = 1e-5;

/// How lag covariances are weighted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Weight {
    /// All elements alike, as \[Odelson06\] does. Wasteful with a gain that is far off.
    Identity,
    /// By the inverse of their covariance at the estimate (Bartlett's formula, Gaussian noise), which is efficient.
    #[default]
    Bartlett,
}

/// What is demanded of the unknowns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Constraint {
    /// Nothing: negative variances may come out.
    None,
    /// No factor is negative: for variances.
    #[default]
    NonNegative,
    /// Q and R are positive semidefinite: for bases with covariances between components.
    Semidefinite,
}

/// Settings of [`als_solve`].
#[derive(Clone, Debug, PartialEq)]
pub struct SolveOptions {
    /// How lag covariances are weighted.
    pub weight: Weight,
    /// What is demanded of the unknowns.
    pub constraint: Constraint,
    /// A value for each unknown that is known, in the order of the basis; empty when none is.
    pub known: Vec<Option<f64>>,
    /// How often the Bartlett weight is taken anew at the estimate.
    pub reweights: usize,
    /// The least number of independent products at each lag.
    pub least_independent: f64,
    /// Penalty on trace(Q), in units of the weighted sum of squares by unit of Q: prefers a process noise of low rank
    /// (\[Rajamani09\]). Biases what it penalises; 0 for none.
    pub trace_penalty: f64,
}

impl Default for SolveOptions {
    fn default() -> Self {
        SolveOptions {
            weight: Weight::default(),
            constraint: Constraint::default(),
            known: Vec::new(),
            reweights: 2,
            least_independent: 10.0,
            trace_penalty: 0.0,
        }
    }
}

/// Estimate the unknowns of a design from measured lag covariances.
///
/// Least squares of A θ against Ĉ, columns scaled to unit length, weighted and constrained as asked, known parts moved to
/// the right. Standard errors and χ² are for Gaussian noise, by Bartlett's formula at the estimate, whichever weight is used
/// for the estimate itself.
///
/// # Errors
/// [`Refusal::Shape`], [`Refusal::TooShort`], [`Refusal::RankDeficient`] with the names of the unknowns that the lags cannot
/// tell, [`Refusal::NotPositiveDefinite`] and [`Refusal::NotConverged`] for data beyond any model.
pub fn als_solve(
    design: &Design,
    covariance: &LagCovariance,
    options: &SolveOptions,
) -> Result<Estimate, Refusal> {
    Equations {
        basis: design.basis(),
        columns: design.columns(),
        offset: None,
        covariance,
        model: Some(design),
    }
    .solve(options)
}

/// What is to be solved: Ĉ = A θ + offset.
pub(super) struct Equations<'a> {
    pub(super) basis: &'a Basis,
    pub(super) columns: &'a DMatrix<f64>,
    /// What is there without any unknown.
    pub(super) offset: Option<DVector<f64>>,
    pub(super) covariance: &'a LagCovariance,
    /// Covariances beyond the lags of the columns, where there is a stationary model.
    pub(super) model: Option<&'a Design>,
}

impl Equations<'_> {
    pub(super) fn solve(&self, options: &SolveOptions) -> Result<Estimate, Refusal> {
        let task = Task::new(self, options)?;
        let rank = rank_report(self.columns, self.basis, &task.free);
        if rank.rank < task.free.len() {
            return Err(Refusal::RankDeficient {
                rank: rank.rank,
                unknowns: task.free.len(),
                undetermined: rank.undetermined,
            });
        }
        let mut solution = task.solve(&task.identity())?;
        let mut rounds = 0;
        let weighed = match options.weight {
            Weight::Identity => task.bartlett(&task.for_weight(&solution)?)?,
            Weight::Bartlett => loop {
                let weighed = task.bartlett(&task.for_weight(&solution)?)?;
                solution = task.solve(&weighed.system)?;
                rounds += 1;
                if rounds >= options.reweights.max(1) {
                    break weighed;
                }
            },
        };
        let scaled = match options.weight {
            Weight::Bartlett => invert(&weighed.system.normal)?,
            Weight::Identity => {
                let system = task.identity();
                let inverse = invert(&system.normal)?;
                let mut sided = task.columns.clone();
                for (mut row, weight) in sided.row_iter_mut().zip(&task.multiplicity) {
                    row *= *weight;
                }
                // N⁻¹ (AᵀD W D A) N⁻¹, W = L Lᵀ.
                let turned = weighed.factor.l_dirty().lower_triangle().transpose() * sided;
                &inverse * (turned.transpose() * turned) * &inverse
            }
        };
        let residual = &task.right - &task.columns * &solution;
        let chi2 = weighed
            .factor
            .l_dirty()
            .solve_lower_triangular(&residual)
            .map_or(f64::NAN, |v| v.norm_squared());
        Ok(task.estimate(&solution, &scaled, chi2, rounds, rank))
    }
}

/// ½ θᵀNθ − rᵀθ of scaled unknowns.
struct System {
    normal: DMatrix<f64>,
    right: DVector<f64>,
}

struct Weighed {
    system: System,
    factor: Cholesky<f64, nalgebra::Dyn>,
}

struct Task<'a> {
    equations: &'a Equations<'a>,
    options: &'a SolveOptions,
    rows: Vec<Row>,
    /// How often an element stands in the whole matrices: covariances of lag 0 between channels, twice.
    multiplicity: Vec<f64>,
    free: Vec<usize>,
    /// θ of what is known, else 0.
    known: Vec<f64>,
    /// Length of each free column.
    lengths: Vec<f64>,
    columns: DMatrix<f64>,
    right: DVector<f64>,
}

impl<'a> Task<'a> {
    fn new(equations: &'a Equations<'a>, options: &'a SolveOptions) -> Result<Self, Refusal> {
        let Equations {
            basis, covariance, ..
        } = equations;
        let (p, k) = (basis.size(Block::Measurement), basis.len());
        let lags = equations.columns.nrows() / (p * p);
        let given = (covariance.channels(), covariance.lags());
        if given != (p, lags) {
            return Err(Refusal::Shape {
                what: "lag covariances",
                found: format!("{} lags of {} channels", given.1, given.0),
                expected: format!("{lags} lags of {p} channels"),
            });
        }
        if !options.known.is_empty() && options.known.len() != k {
            return Err(Refusal::Shape {
                what: "list of known values",
                found: format!("{}", options.known.len()),
                expected: format!("{k}, one for each unknown, or none"),
            });
        }
        for channel in 0..p {
            let count = covariance.counts()[lags - 1];
            let independent = count / covariance.correlation_time(channel);
            if independent < options.least_independent {
                return Err(Refusal::TooShort {
                    lag: lags - 1,
                    count: count as usize,
                    independent,
                    least: options.least_independent,
                });
            }
        }
        let value = |i: usize| options.known.get(i).copied().flatten();
        let free: Vec<usize> = (0..k).filter(|i| value(*i).is_none()).collect();
        if free.is_empty() {
            return Err(Refusal::Shape {
                what: "number of unknowns without a known value",
                found: "0".into(),
                expected: "at least one".into(),
            });
        }
        let known: Vec<f64> = (0..k).map(|i| value(i).unwrap_or(0.0)).collect();
        if known.iter().any(|v| !v.is_finite()) {
            return Err(Refusal::NotFinite {
                what: "known value",
            });
        }
        let rows = independent_rows(lags, p);
        let index: Vec<usize> = rows.iter().map(|(j, a, b)| (j * p + b) * p + a).collect();
        let all = equations.columns.select_rows(&index);
        let measured = index.iter().map(|&i| {
            covariance.values()[i] - equations.offset.as_ref().map_or(0.0, |offset| offset[i])
        });
        let right = DVector::from_iterator(index.len(), measured)
            - &all * DVector::from_column_slice(&known);
        let mut columns = all.select_columns(&free);
        let lengths: Vec<f64> = columns
            .column_iter_mut()
            .map(|mut column| {
                let length = column.norm();
                let length = if length > 0.0 { length } else { 1.0 };
                column /= length;
                length
            })
            .collect();
        Ok(Task {
            equations,
            options,
            multiplicity: rows
                .iter()
                .map(|(lag, a, b)| if *lag == 0 && a != b { 2.0 } else { 1.0 })
                .collect(),
            rows,
            free,
            known,
            lengths,
            columns,
            right,
        })
    }

    fn identity(&self) -> System {
        let mut weighted = self.columns.clone();
        for (mut row, weight) in weighted.row_iter_mut().zip(&self.multiplicity) {
            row *= *weight;
        }
        System {
            normal: weighted.transpose() * &self.columns,
            right: weighted.transpose() * &self.right,
        }
    }

    /// Weighted at θ.
    fn bartlett(&self, theta: &[f64]) -> Result<Weighed, Refusal> {
        let covariance = self.equations.covariance;
        let most = (covariance.counts()[0] as usize).min(MOST_MODEL_LAGS);
        let model = match self.equations.model {
            Some(design) => design.covariances(theta, design.lags(), most),
            None => {
                let factors = DVector::from_column_slice(theta);
                let mut values = self.equations.columns * factors;
                if let Some(offset) = &self.equations.offset {
                    values += offset;
                }
                values.as_slice().to_vec()
            }
        };
        let p = covariance.channels();
        let mut w = bartlett::covariance(&model, p, &self.rows, covariance.counts());
        // What is cut off of the model's covariances may leave the smallest eigenvalues below zero by as much.
        for i in 0..w.nrows() {
            w[(i, i)] *= 1.0 + 1e-9;
        }
        let factor = Cholesky::new(w).ok_or(Refusal::NotPositiveDefinite {
            what: "covariance of the lag covariances at the estimate",
            remedy: "take fewer lags or the identity weight",
        })?;
        let lower = factor.l_dirty();
        let (Some(columns), Some(right)) = (
            lower.solve_lower_triangular(&self.columns),
            lower.solve_lower_triangular(&self.right),
        ) else {
            return Err(Refusal::NotPositiveDefinite {
                what: "covariance of the lag covariances at the estimate",
                remedy: "take fewer lags or the identity weight",
            });
        };
        Ok(Weighed {
            system: System {
                normal: columns.transpose() * &columns,
                right: columns.transpose() * right,
            },
            factor,
        })
    }

    fn solve(&self, system: &System) -> Result<DVector<f64>, Refusal> {
        let mut right = system.right.clone();
        if self.options.trace_penalty != 0.0 {
            for (value, (unknown, length)) in right.iter_mut().zip(self.unknowns()) {
                if unknown.block == Block::Process {
                    *value -= self.options.trace_penalty * unknown.matrix.trace() / length;
                }
            }
        }
        match self.options.constraint {
            Constraint::None => Cholesky::new(system.normal.clone())
                .map(|factor| factor.solve(&right))
                .ok_or(Refusal::NotPositiveDefinite {
                    what: "normal matrix",
                    remedy: "some unknowns cannot be told apart; ask for fewer",
                }),
            Constraint::NonNegative => nonnegative(&system.normal, &right),
            Constraint::Semidefinite => semidefinite(&system.normal, &right, self.cones()),
        }
    }

    fn unknowns(&self) -> impl Iterator<Item = (&super::Unknown, f64)> {
        self.free
            .iter()
            .map(|i| &self.equations.basis.unknowns()[*i])
            .zip(self.lengths.iter().copied())
    }

    fn cones(&self) -> Vec<Cone> {
        [Block::Process, Block::Measurement]
            .into_iter()
            .filter(|block| self.unknowns().any(|(u, _)| u.block == *block))
            .map(|block| Cone {
                known: self.equations.basis.covariance(block, &self.known),
                matrices: self
                    .unknowns()
                    .map(|(unknown, length)| {
                        if unknown.block == block {
                            &unknown.matrix / length
                        } else {
                            let size = self.equations.basis.size(block);
                            DMatrix::zeros(size, size)
                        }
                    })
                    .collect(),
            })
            .collect()
    }

    /// All of θ, unscaled.
    fn theta(&self, solution: &DVector<f64>) -> Vec<f64> {
        let mut theta = self.known.clone();
        for ((i, value), length) in self.free.iter().zip(solution.iter()).zip(&self.lengths) {
            theta[*i] = value / length;
        }
        theta
    }

    /// θ with which a model has positive covariances, near the solution.
    fn for_weight(&self, solution: &DVector<f64>) -> Result<Vec<f64>, Refusal> {
        let p = self.equations.covariance.channels();
        let basis = self.equations.basis;
        let mut theta = self.theta(solution);
        let variance =
            |values: &dyn Fn(usize) -> f64| -> f64 { (0..p).map(|a| values(a * p + a)).sum() };
        let measured = variance(&|row| self.equations.covariance.values()[row]);
        for &i in &self.free {
            // Only what is positive by itself can be raised by itself; of others negative values are as they should be.
            if indefinite(&basis.unknowns()[i]) {
                continue;
            }
            let alone = measured / variance(&|row| self.equations.columns[(row, i)]);
            if alone.is_finite() {
                theta[i] = theta[i].max(LEAST_SHARE_IN_WEIGHT * alone);
            }
        }
        if theta.iter().any(|v| !v.is_finite()) {
            return Err(Refusal::NotFinite { what: "estimate" });
        }
        // Correlations beyond one have no model: less of them until there is one.
        for block in [Block::Process, Block::Measurement] {
            for _ in 0..60 {
                let values = SymmetricEigen::new(basis.covariance(block, &theta)).eigenvalues;
                if values.iter().all(|v| *v >= -1e-12 * values.amax()) {
                    break;
                }
                for (value, unknown) in theta.iter_mut().zip(basis.unknowns()) {
                    if unknown.block == block && indefinite(unknown) {
                        *value *= 0.9;
                    }
                }
            }
        }
        Ok(theta)
    }

    fn estimate(
        &self,
        solution: &DVector<f64>,
        scaled: &DMatrix<f64>,
        chi2: f64,
        reweights: usize,
        rank: super::RankReport,
    ) -> Estimate {
        let basis = self.equations.basis;
        let theta = self.theta(solution);
        let k = theta.len();
        let mut covariance = DMatrix::zeros(k, k);
        for (a, &i) in self.free.iter().enumerate() {
            for (b, &j) in self.free.iter().enumerate() {
                covariance[(i, j)] = scaled[(a, b)] / (self.lengths[a] * self.lengths[b]);
            }
        }
        let mut verdicts = vec![Verdict::Known; k];
        for &i in &self.free {
            verdicts[i] = Verdict::Estimated;
        }
        match self.options.constraint {
            Constraint::None => {}
            Constraint::NonNegative => {
                for (&i, value) in self.free.iter().zip(solution.iter()) {
                    if *value <= 0.0 {
                        verdicts[i] = Verdict::OnBound;
                    }
                }
            }
            Constraint::Semidefinite => {
                for block in [Block::Process, Block::Measurement] {
                    let eigen = SymmetricEigen::new(basis.covariance(block, &theta));
                    let largest = eigen.eigenvalues.amax();
                    for (value, direction) in eigen
                        .eigenvalues
                        .iter()
                        .zip(eigen.eigenvectors.column_iter())
                    {
                        if *value > ON_BOUND * largest {
                            continue;
                        }
                        for &i in &self.free {
                            let unknown = &basis.unknowns()[i];
                            if unknown.block == block
                                && (&unknown.matrix * direction).dot(&direction).abs() > 1e-3
                            {
                                verdicts[i] = Verdict::OnBound;
                            }
                        }
                    }
                }
            }
        }
        Estimate {
            names: basis.unknowns().iter().map(|u| u.name.clone()).collect(),
            standard_errors: (0..k).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect(),
            q: basis.covariance(Block::Process, &theta),
            r: basis.covariance(Block::Measurement, &theta),
            theta,
            covariance,
            verdicts,
            chi2,
            dof: self.rows.len() - self.free.len(),
            rank: rank.rank,
            condition: rank.condition,
            weakest: rank.weakest,
            reweights,
        }
    }
}

fn indefinite(unknown: &super::Unknown) -> bool {
    let values = SymmetricEigen::new(unknown.matrix.clone()).eigenvalues;
    values.min() < 0.0
}

fn invert(normal: &DMatrix<f64>) -> Result<DMatrix<f64>, Refusal> {
    Ok(Cholesky::new(normal.clone())
        .ok_or(Refusal::NotPositiveDefinite {
            what: "normal matrix",
            remedy: "some unknowns cannot be told apart; ask for fewer",
        })?
        .inverse())
}
