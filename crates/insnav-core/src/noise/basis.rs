//! What is unknown: Q and R as sums of known matrices with unknown factors.

use super::Refusal;
use nalgebra::DMatrix;
use serde::{Deserialize, Serialize};
use std::format;
use std::string::String;
use std::vec::Vec;

/// Which covariance an unknown belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Block {
    /// Q, of the process noise w.
    Process,
    /// R, of the measurement noise v.
    Measurement,
}

/// The form of a covariance.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Its diagonal elements, each on its own.
    Diagonal,
    /// All elements of a symmetric matrix.
    Symmetric,
    /// One variance for each group of components, which share it; components of no group have none.
    Isotropic(Vec<Vec<usize>>),
}

/// One factor θᵢ and its matrix Bᵢ.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unknown {
    /// Of which covariance.
    pub block: Block,
    /// Bᵢ, symmetric.
    #[serde(with = "super::stored")]
    pub matrix: DMatrix<f64>,
    /// What errors and reports call it, like `Q[0,0]`.
    pub name: String,
}

/// All unknowns: Q = Σ θᵢ Bᵢ over those of [`Block::Process`], R likewise.
///
/// Known parts are unknowns with a value in [`SolveOptions::known`](super::SolveOptions): they move to the right-hand side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Basis {
    process: usize,
    measurement: usize,
    unknowns: Vec<Unknown>,
}

impl Basis {
    /// No unknowns yet, of a process noise of `process` components and a measurement noise of `measurement`.
    pub fn new(process: usize, measurement: usize) -> Self {
        Basis {
            process,
            measurement,
            unknowns: Vec::new(),
        }
    }

    /// Diagonal Q and R.
    pub fn diagonal(process: usize, measurement: usize) -> Self {
        let mut basis = Basis::new(process, measurement);
        basis.add_diagonal(Block::Process);
        basis.add_diagonal(Block::Measurement);
        basis
    }

    /// Full symmetric Q and R. Of most models this asks for more than the lags can tell (\[Mehra70\]: n·p elements of Q).
    pub fn symmetric(process: usize, measurement: usize) -> Self {
        let mut basis = Basis::new(process, measurement);
        basis.add_symmetric(Block::Process);
        basis.add_symmetric(Block::Measurement);
        basis
    }

    /// Add unknowns of a form.
    ///
    /// # Errors
    /// [`Refusal::Setting`] for a group with a component that does not exist or is in two groups.
    pub fn with(mut self, block: Block, shape: Shape) -> Result<Self, Refusal> {
        match shape {
            Shape::Diagonal => self.add_diagonal(block),
            Shape::Symmetric => self.add_symmetric(block),
            Shape::Isotropic(groups) => {
                let size = self.size(block);
                let mut seen = vec![false; size];
                for group in groups {
                    let mut matrix = DMatrix::zeros(size, size);
                    for &component in &group {
                        if component >= size || seen[component] {
                            return Err(Refusal::Setting {
                                what: "component of an isotropic group",
                                value: component as f64,
                                expected: "a component of the noise, in one group only",
                            });
                        }
                        seen[component] = true;
                        matrix[(component, component)] = 1.0;
                    }
                    let names: Vec<String> = group.iter().map(|c| format!("{c}")).collect();
                    self.unknowns.push(Unknown {
                        block,
                        matrix,
                        name: format!("{}[{}]", letter(block), names.join("=")),
                    });
                }
            }
        }
        Ok(self)
    }

    /// Add one unknown with a matrix of its own; only its symmetric part counts.
    ///
    /// # Errors
    /// [`Refusal::Shape`] for a matrix of another size, [`Refusal::NotFinite`] for one that is not finite.
    pub fn with_custom(
        mut self,
        block: Block,
        matrix: &DMatrix<f64>,
        name: &str,
    ) -> Result<Self, Refusal> {
        let size = self.size(block);
        if matrix.shape() != (size, size) {
            return Err(Refusal::Shape {
                what: "matrix of an unknown",
                found: format!("{} x {}", matrix.nrows(), matrix.ncols()),
                expected: format!("{size} x {size}"),
            });
        }
        if matrix.iter().any(|v| !v.is_finite()) {
            return Err(Refusal::NotFinite {
                what: "matrix of an unknown",
            });
        }
        self.unknowns.push(Unknown {
            block,
            matrix: (matrix + matrix.transpose()) * 0.5,
            name: String::from(name),
        });
        Ok(self)
    }

    /// The unknowns, in the order of θ.
    pub fn unknowns(&self) -> &[Unknown] {
        &self.unknowns
    }

    /// Number of unknowns.
    pub fn len(&self) -> usize {
        self.unknowns.len()
    }

    /// Whether nothing is unknown.
    pub fn is_empty(&self) -> bool {
        self.unknowns.is_empty()
    }

    /// Size of a covariance.
    pub fn size(&self, block: Block) -> usize {
        match block {
            Block::Process => self.process,
            Block::Measurement => self.measurement,
        }
    }

    /// Q or R at θ.
    pub fn covariance(&self, block: Block, theta: &[f64]) -> DMatrix<f64> {
        let size = self.size(block);
        self.unknowns
            .iter()
            .zip(theta)
            .filter(|(unknown, _)| unknown.block == block)
            .fold(DMatrix::zeros(size, size), |sum, (unknown, factor)| {
                sum + &unknown.matrix * *factor
            })
    }

    fn add_diagonal(&mut self, block: Block) {
        for i in 0..self.size(block) {
            self.add_element(block, i, i);
        }
    }

    fn add_symmetric(&mut self, block: Block) {
        for b in 0..self.size(block) {
            for a in b..self.size(block) {
                self.add_element(block, a, b);
            }
        }
    }

    fn add_element(&mut self, block: Block, a: usize, b: usize) {
        let size = self.size(block);
        let mut matrix = DMatrix::zeros(size, size);
        matrix[(a, b)] = 1.0;
        matrix[(b, a)] = 1.0;
        self.unknowns.push(Unknown {
            block,
            matrix,
            name: format!("{}[{b},{a}]", letter(block)),
        });
    }
}

fn letter(block: Block) -> char {
    match block {
        Block::Process => 'Q',
        Block::Measurement => 'R',
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_give_the_covariances_they_name() {
        let symmetric = Basis::symmetric(2, 1);
        let q = symmetric.covariance(Block::Process, &[1.0, 2.0, 3.0, 4.0]);
        assert_eq!(q, DMatrix::from_row_slice(2, 2, &[1.0, 2.0, 2.0, 3.0]));
        assert_eq!(
            symmetric.covariance(Block::Measurement, &[1.0, 2.0, 3.0, 4.0])[0],
            4.0
        );
        assert_eq!(symmetric.unknowns()[1].name, "Q[0,1]");
        let groups = Shape::Isotropic(vec![vec![0, 2], vec![1]]);
        let isotropic = Basis::new(3, 1)
            .with(Block::Process, groups)
            .expect("disjoint groups");
        let q = isotropic.covariance(Block::Process, &[5.0, 7.0]);
        assert_eq!(q.diagonal().as_slice(), [5.0, 7.0, 5.0]);
        assert_eq!(isotropic.unknowns()[0].name, "Q[0=2]");
        assert!(
            Basis::new(2, 1)
                .with(Block::Process, Shape::Isotropic(vec![vec![0, 0]]))
                .is_err()
        );
    }
}
