//! The design against its definition with Kronecker products, and what it says exact covariances mean.

use crate::unit::{diagonal, innovations, matrix, record, seeds, system_a};
use insnav::noise::{
    Basis, Block, Constraint, LagCovariance, LinearModel, Shape, SolveOptions, Weight, als_design,
    als_solve, lag_covariance,
};
use nalgebra::DMatrix;

/// A gain of `model` for a guess of its noise.
fn gain(model: &LinearModel, q: f64, r: f64) -> DMatrix<f64> {
    let q = DMatrix::identity(model.g.ncols(), model.g.ncols()) * q;
    let r = DMatrix::identity(model.h.nrows(), model.h.nrows()) * r;
    model.stationary_filter(&q, &r).expect("stable").gain
}

fn vec_of(m: &DMatrix<f64>) -> DMatrix<f64> {
    DMatrix::from_column_slice(m.len(), 1, m.as_slice())
}

/// C₀ … for all elements of Q and R at once, with every Kronecker product written out.
fn kronecker_design(model: &LinearModel, gain: &DMatrix<f64>, lags: usize) -> DMatrix<f64> {
    let (n, p) = (model.f.nrows(), model.h.nrows());
    let fl = &model.f * gain;
    let closed = model.closed_loop(gain);
    let lyapunov = (DMatrix::identity(n * n, n * n) - closed.kronecker(&closed))
        .try_inverse()
        .expect("stable");
    let of_q = &lyapunov * model.g.kronecker(&model.g);
    let of_r = &lyapunov * fl.kronecker(&fl);
    let mut rows = Vec::new();
    let mut power = DMatrix::identity(n, n);
    let mut before = DMatrix::zeros(n, n);
    for lag in 0..lags {
        let observe = model.h.kronecker(&(&model.h * &power));
        let direct = if lag == 0 {
            DMatrix::identity(p * p, p * p)
        } else {
            -DMatrix::identity(p, p).kronecker(&(&model.h * &before * &fl))
        };
        let q = &observe * &of_q;
        let r = &observe * &of_r + direct;
        rows.push(DMatrix::from_fn(p * p, q.ncols() + r.ncols(), |i, j| {
            if j < q.ncols() {
                q[(i, j)]
            } else {
                r[(i, j - q.ncols())]
            }
        }));
        before = power.clone();
        power = &power * &closed;
    }
    DMatrix::from_fn(lags * p * p, rows[0].ncols(), |i, j| {
        rows[i / (p * p)][(i % (p * p), j)]
    })
}

#[test]
fn equals_the_kronecker_construction() {
    let unequal = LinearModel {
        f: matrix(2, 2, &[0.9, 0.3, -0.2, 0.8]),
        g: matrix(2, 1, &[0.3, 1.0]),
        h: matrix(2, 2, &[1.0, 0.4, -0.1, 2.0]),
    };
    for (model, q, r) in [
        (system_a(), 3.0, 1.0),
        (unequal, 1.0, 0.3),
        (LinearModel::attitude_axes(0.032, 10.0), 1e-3, 1.0),
    ] {
        let gain = gain(&model, q, r);
        let basis = Basis::symmetric(model.g.ncols(), model.h.nrows());
        let design = als_design(&model, &gain, &basis, 12).expect("stable");
        let full = kronecker_design(&model, &gain, 12);
        let g = model.g.ncols();
        for (i, unknown) in basis.unknowns().iter().enumerate() {
            let element = vec_of(&unknown.matrix);
            let column = match unknown.block {
                Block::Process => full.columns(0, g * g) * element,
                Block::Measurement => full.columns(g * g, full.ncols() - g * g) * element,
            };
            let error = (design.columns().column(i) - &column).amax() / column.amax();
            // The inverse of I − F̄ ⊗ F̄ is the less exact of the two.
            assert!(error < 1e-12, "{}: {error:e}", unknown.name);
        }
    }
}

/// A1: the covariances of a long simulation.
#[test]
fn simulated_innovations_have_the_covariances_of_the_design() {
    let model = system_a();
    let gain = gain(&model, 5.0, 0.02);
    let design = als_design(&model, &gain, &Basis::diagonal(1, 1), 5).expect("stable");
    for seed in 0..seeds(1, 5) {
        let y = record(&model, &[0.5], &[0.1], 400_000, seed);
        let nu = innovations(&model, &gain, &y);
        let measured = lag_covariance(&[&nu[100..]], 1, 5).expect("long");
        let expected = design.columns() * DMatrix::from_column_slice(2, 1, &[0.5, 0.1]);
        for lag in 0..5 {
            let error = (measured.at(lag, 0, 0) - expected[lag]) / expected[0];
            assert!(error.abs() < 0.01, "seed {seed} lag {lag}: {error}");
        }
    }
}

fn exact(values: Vec<f64>, p: usize) -> LagCovariance {
    let counts = (0..values.len() / (p * p))
        .map(|j| (100_000 - j) as f64)
        .collect();
    LagCovariance::new(p, values, counts).expect("sizes fit")
}

/// A2. The condition of the scaled normal matrix is below 1e4, that of rounding 1e-16.
#[test]
fn exact_covariances_give_the_noise_back() {
    let model = LinearModel::attitude_axes(0.032, 1.0);
    let gain = gain(&model, 1e-2, 1.0);
    let q = [1e-3, 2e-3, 3e-3, 4e-2, 5e-2, 6e-2];
    let mut cases = vec![
        (
            Basis::diagonal(6, 3),
            [&q[..], &[0.3, 0.2, 0.1]].concat(),
            Constraint::NonNegative,
        ),
        (
            Basis::diagonal(6, 3),
            [&q[..], &[0.3, 0.2, 0.1]].concat(),
            Constraint::Semidefinite,
        ),
    ];
    let full_r = Basis::new(6, 3)
        .with(Block::Process, Shape::Diagonal)
        .and_then(|b| b.with(Block::Measurement, Shape::Symmetric))
        .expect("shapes");
    let r = [0.3, 0.05, -0.02, 0.2, 0.01, 0.1];
    cases.push((full_r, [&q[..], &r].concat(), Constraint::Semidefinite));
    let groups = |list: &[&[usize]]| Shape::Isotropic(list.iter().map(|g| g.to_vec()).collect());
    let isotropic = Basis::new(6, 3)
        .with(Block::Process, groups(&[&[0, 1, 2], &[3, 4, 5]]))
        .and_then(|b| b.with(Block::Measurement, groups(&[&[0, 1], &[2]])))
        .expect("groups");
    cases.push((
        isotropic,
        vec![2e-3, 5e-2, 0.3, 0.1],
        Constraint::NonNegative,
    ));
    for (basis, theta, constraint) in cases {
        let design = als_design(&model, &gain, &basis, 40).expect("stable");
        let values = design.columns() * DMatrix::from_column_slice(theta.len(), 1, &theta);
        let covariance = exact(values.as_slice().to_vec(), 3);
        for weight in [Weight::Identity, Weight::Bartlett] {
            let options = SolveOptions {
                weight,
                constraint,
                reweights: 1,
                ..Default::default()
            };
            let found = als_solve(&design, &covariance, &options).expect("identified");
            for ((name, a), b) in found.names.iter().zip(&found.theta).zip(&theta) {
                assert!(
                    (a - b).abs() < 1e-9 * b.abs(),
                    "{weight:?} {constraint:?} {name}: {a} {b}"
                );
            }
            assert!(found.chi2 < 1e-9 && found.fits());
        }
        // Known parts move to the right.
        let known = theta
            .iter()
            .enumerate()
            .map(|(i, t)| (i % 2 == 1).then_some(*t))
            .collect();
        let options = SolveOptions {
            weight: Weight::Identity,
            constraint,
            known,
            ..Default::default()
        };
        let found = als_solve(&design, &covariance, &options).expect("identified");
        for (a, b) in found.theta.iter().zip(&theta) {
            assert!((a - b).abs() < 1e-9 * b.abs(), "{a} {b}");
        }
    }
}

/// A13: what the lags of six states with three measurements tell.
#[test]
fn rank_of_the_attitude_model() {
    let model = LinearModel::attitude_axes(0.032, 10.0);
    let gain = gain(&model, 1e-3, 1.0);
    let mixed = Basis::new(6, 3)
        .with(Block::Process, Shape::Diagonal)
        .and_then(|b| b.with(Block::Measurement, Shape::Symmetric))
        .expect("shapes");
    for (basis, rank, unknowns) in [
        (Basis::symmetric(6, 3), 21, 27),
        (Basis::diagonal(6, 3), 9, 9),
        (mixed, 12, 12),
    ] {
        let design = als_design(&model, &gain, &basis, 40).expect("stable");
        let all: Vec<usize> = (0..basis.len()).collect();
        let report = design.rank_report(&all);
        assert_eq!((report.rank, report.unknowns), (rank, unknowns));
        if rank < unknowns {
            // Of the 21 elements of Q only combinations show ([Mehra70]: n p of them), R by itself.
            assert_eq!(report.undetermined.len(), 21);
            assert!(report.undetermined.iter().all(|name| name.starts_with('Q')));
        } else {
            assert!(
                report.undetermined.is_empty() && report.condition < 1e4,
                "{report:?}"
            );
        }
    }
}

/// A covariance that would have a negative eigenvalue is brought back to the nearest possible one, and says so.
#[test]
fn a_covariance_is_kept_semidefinite() {
    let model = LinearModel {
        f: diagonal(&[0.5, 0.7]),
        g: DMatrix::identity(2, 2),
        h: DMatrix::identity(2, 2),
    };
    let gain = gain(&model, 1.0, 1.0);
    let basis = Basis::symmetric(2, 2);
    let design = als_design(&model, &gain, &basis, 8).expect("stable");
    // An impossible correlation of 1.3.
    let theta = [1.0, 1.3, 1.0, 1.0, 0.0, 1.0];
    let values = design.columns() * DMatrix::from_column_slice(6, 1, &theta);
    let covariance = exact(values.as_slice().to_vec(), 2);
    let solve = |constraint| {
        let options = SolveOptions {
            weight: Weight::Identity,
            constraint,
            ..Default::default()
        };
        als_solve(&design, &covariance, &options).expect("identified")
    };
    let free = solve(Constraint::None);
    assert!((free.theta[1] - 1.3).abs() < 1e-9);
    let kept = solve(Constraint::Semidefinite);
    let smallest = kept.q.clone().symmetric_eigenvalues().min();
    assert!((-1e-12..1e-4).contains(&smallest), "{smallest}");
    assert_eq!(kept.verdicts[1], insnav::noise::Verdict::OnBound);
    assert_eq!(kept.verdicts[3], insnav::noise::Verdict::Estimated);
    assert!(kept.theta[1] > 1.0 && kept.chi2 > free.chi2);
}
