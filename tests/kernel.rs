//! The covariance kernel against the textbook: `Φ P Φᵀ + Q` and `P − P Hᵀ S⁻¹ H P` as dense products, over random layouts,
//! dynamics and measurements, with blocks opened and closed in any order.

use insnav::filter::{
    ACCEL_BIAS, ACCEL_SCALE, ATTITUDE, BASE, BLOCKS, Block, CAPACITY, CLOCK_OFFSET, Columns,
    Covariance, GNSS_COLOUR, GYRO_BIAS, GYRO_SCALE, HELD_HEADING, LEVER_ARM, Layout, MOUNTING,
    ODOMETER_SCALE, POSITION, Transition, VELOCITY,
};
use insnav::sim::{Source, Stream};
use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, SVector, Vector3};
use proptest::prelude::*;

/// A size of error for each block, so that a relative tolerance means the same for metres and radians.
const SCALE: [f64; BLOCKS.len()] = [
    10.0, 1.0, 0.02, 1e-4, 0.03, 0.02, 3.0, 1e-3, 1e-3, 0.1, 0.02, 0.01, 0.01, 0.5, 0.02,
];

/// Call something generic over the size of a block for the optional block of a number.
macro_rules! with_optional {
    ($which:expr, $block:ident => $body:expr) => {
        match $which % 8 {
            0 => {
                let $block = HELD_HEADING;
                $body
            }
            1 => {
                let $block = GNSS_COLOUR;
                $body
            }
            2 => {
                let $block = GYRO_SCALE;
                $body
            }
            3 => {
                let $block = ACCEL_SCALE;
                $body
            }
            4 => {
                let $block = LEVER_ARM;
                $body
            }
            5 => {
                let $block = MOUNTING;
                $body
            }
            6 => {
                let $block = ODOMETER_SCALE;
                $body
            }
            _ => {
                let $block = CLOCK_OFFSET;
                $body
            }
        }
    };
}

/// The same covariance as a dense matrix with the name of the block each state belongs to.
struct Dense {
    p: DMatrix<f64>,
    names: Vec<&'static str>,
}

impl Dense {
    fn of(kernel: &Covariance) -> Self {
        let n = kernel.layout().len();
        let names = kernel
            .layout()
            .names()
            .flat_map(|(block, range)| range.map(move |_| block.name))
            .collect();
        let p = DMatrix::from_iterator(
            n,
            n,
            kernel
                .dense::<CAPACITY>()
                .view((0, 0), (n, n))
                .iter()
                .copied(),
        );
        Dense { p, names }
    }

    fn scale(&self, i: usize) -> f64 {
        let block = BLOCKS.iter().position(|b| b.name == self.names[i]);
        SCALE[block.expect("names come from the list")]
    }

    fn open(&mut self, name: &'static str, prior: &DMatrix<f64>) {
        let (n, more) = (self.p.nrows(), prior.nrows());
        self.p = std::mem::take(&mut self.p).resize(n + more, n + more, 0.0);
        self.p.view_mut((n, n), (more, more)).copy_from(prior);
        self.names.extend(std::iter::repeat_n(name, more));
    }

    fn close(&mut self, name: &str) {
        let gone: Vec<usize> = (0..self.names.len())
            .filter(|&i| self.names[i] == name)
            .collect();
        self.p = std::mem::take(&mut self.p)
            .remove_rows_at(&gone)
            .remove_columns_at(&gone);
        self.names.retain(|&n| n != name);
    }

    /// A P Aᵀ, where A adds state `from` to state `to`, and takes `from` to zero if so wanted.
    fn move_state(&mut self, from: usize, to: usize) {
        let mut a = DMatrix::identity(self.p.nrows(), self.p.nrows());
        a[(to, from)] = 1.0;
        a[(from, from)] = 0.0;
        self.p = &a * &self.p * a.transpose();
    }
}

/// How far two covariances are apart, in units of σᵢσⱼ of the given sigmas squared.
fn distance(kernel: &Covariance, dense: &DMatrix<f64>, variance: &DVector<f64>) -> f64 {
    let n = dense.nrows();
    let p = kernel.dense::<CAPACITY>();
    let mut worst: f64 = 0.0;
    for i in 0..n {
        for j in 0..n {
            let scale = (variance[i] * variance[j]).sqrt();
            let d = (p[(i, j)] - dense[(i, j)]).abs();
            // A state of zero variance must be exactly zero in both.
            worst = worst.max(if d == 0.0 { 0.0 } else { d / scale });
        }
    }
    worst
}

/// Symmetric to the last bit, and zero outside the open states.
fn is_tidy(kernel: &Covariance) -> bool {
    let (n, p) = (kernel.layout().len(), kernel.dense::<CAPACITY>());
    (0..CAPACITY).all(|i| {
        (0..CAPACITY).all(|j| {
            p[(i, j)].to_bits() == p[(j, i)].to_bits() && ((i < n && j < n) || p[(i, j)] == 0.0)
        })
    })
}

fn normal<const R: usize, const C: usize>(source: &mut Source) -> SMatrix<f64, R, C> {
    SMatrix::from_fn(|_, _| source.normal())
}

/// A random covariance of full rank whose sigmas are about `scale`.
fn spd<const N: usize>(source: &mut Source, scale: f64) -> SMatrix<f64, N, N> {
    let a: SMatrix<f64, N, N> = normal(source);
    (a * a.transpose() + SMatrix::identity() * 0.1) * (scale * scale)
}

/// `M` rows that look at every open block, in units of `row` over the size of the block's errors.
fn rows<const M: usize>(layout: &Layout, source: &mut Source, row: f64) -> Columns<M> {
    let mut columns = Columns::default();
    macro_rules! put {
        ($($block:ident: $size:literal),*) => {$(
            let scale = row / SCALE[BLOCKS.iter().position(|b| b.name == name_of($block)).expect("listed")];
            columns.put(layout, $block, &(normal::<M, $size>(source) * scale));
        )*};
    }
    put!(POSITION: 3, VELOCITY: 3, ATTITUDE: 3, GYRO_BIAS: 3, ACCEL_BIAS: 3, HELD_HEADING: 1, GNSS_COLOUR: 3, GYRO_SCALE: 3,
        ACCEL_SCALE: 3, LEVER_ARM: 3, MOUNTING: 2, ODOMETER_SCALE: 1, CLOCK_OFFSET: 1);
    columns
}

/// The name of a block, through a covariance in which it is open.
fn name_of<const N: usize>(block: Block<N>) -> &'static str {
    let mut kernel = Covariance::default();
    kernel
        .open(block, &SMatrix::zeros())
        .expect("there is room for one");
    let range = kernel.layout().range(block).expect("just opened");
    kernel
        .layout()
        .names()
        .find(|(_, r)| *r == range)
        .map(|(info, _)| info.name)
        .expect("an open block has a name")
}

/// Dynamics that mix every open block into position, velocity and attitude by shares of about `size`, decay the slow states
/// and add noise to all.
fn dynamics(dense: &Dense, layout: &Layout, size: f64, source: &mut Source) -> Transition {
    let mut phi = Transition {
        position: rows(layout, source, size * SCALE[0]),
        velocity: rows(layout, source, size * SCALE[1]),
        attitude: rows(layout, source, size * SCALE[2]),
        ..Transition::default()
    };
    for i in 0..layout.len() {
        if i >= 9 {
            phi.decay[i] = source.between(1.0 - size, 1.0);
        }
        phi.noise[i] = (size * dense.scale(i) * source.normal()).powi(2);
    }
    phi
}

/// Φ as a matrix, column by column from what a transition does to a vector.
fn matrix(phi: &Transition, n: usize) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(n, n);
    for j in 0..n {
        let mut unit = [0.0; CAPACITY];
        unit[j] = 1.0;
        out.set_column(j, &DVector::from_column_slice(&phi.times(&unit)[..n]));
    }
    out
}

fn dense_rows<const M: usize>(h: &Columns<M>, n: usize) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(M, n);
    for (place, column) in h.iter() {
        for m in 0..M {
            out[(m, place)] += column[m];
        }
    }
    out
}

/// What a GNSS velocity looks at, with every optional block it may one day look at.
fn lever_arm_rows(layout: &Layout, source: &mut Source) -> Columns<3> {
    let c = insnav::attitude::exp(&source.normal3())
        .to_rotation_matrix()
        .into_inner();
    let lever = source.normal3() * 2.0;
    let mut h = Columns::default();
    h.put(layout, VELOCITY, &Matrix3::identity());
    h.put(layout, ATTITUDE, &-insnav::attitude::skew(&(c * lever)));
    h.put(layout, GYRO_BIAS, &(c * insnav::attitude::skew(&lever)));
    h.put(
        layout,
        LEVER_ARM,
        &(c * insnav::attitude::skew(&source.normal3())),
    );
    h.put(layout, GNSS_COLOUR, &Matrix3::identity());
    h.put_axis(layout, CLOCK_OFFSET, 0, source.normal3().into());
    h
}

/// The base blocks with random priors, correlated by one step of random dynamics.
fn start(source: &mut Source) -> Covariance {
    let mut kernel = Covariance::default();
    kernel.set_prior(POSITION, &spd(source, SCALE[0]));
    kernel.set_prior(VELOCITY, &spd(source, SCALE[1]));
    kernel.set_prior(ATTITUDE, &spd(source, SCALE[2]));
    kernel.set_prior(GYRO_BIAS, &spd(source, SCALE[3]));
    kernel.set_prior(ACCEL_BIAS, &spd(source, SCALE[4]));
    kernel.propagate(&dynamics(&Dense::of(&kernel), kernel.layout(), 0.1, source));
    kernel
}

fn update<const M: usize>(
    kernel: &mut Covariance,
    h: &Columns<M>,
    source: &mut Source,
) -> Result<(), TestCaseError> {
    let before = Dense::of(kernel);
    let n = before.p.nrows();
    let dense_h = dense_rows(h, n);
    let hph = &dense_h * &before.p * dense_h.transpose();
    // From far better to far worse than the prediction, correlated.
    let size = (hph.trace() / M as f64).sqrt() * 10f64.powf(source.between(-3.0, 1.0));
    let r: SMatrix<f64, M, M> = spd(source, size);
    let residual: SVector<f64, M> = normal(source) * size;

    let innovation = kernel
        .innovation(h, &r, &residual)
        .expect("R is positive definite");
    let s = hph + DMatrix::from_iterator(M, M, r.iter().copied());
    let inverse = s.clone().try_inverse().expect("positive definite");
    let gain = &before.p * dense_h.transpose() * &inverse;
    let z = DVector::from_column_slice(residual.as_slice());
    let nis = (z.transpose() * &inverse * &z)[(0, 0)];
    // Sums of n terms of up to |h| σ each, which may cancel: what rounding leaves in S is 1e-16 of their squares, and what
    // that does to S⁻¹ is larger by their ratio to the smallest eigenvalue.
    let sigma = before.p.diagonal().map(f64::sqrt);
    let terms = dense_h.abs() * &sigma;
    let loss = 1e-14 * (1.0 + terms.norm_squared() / s.symmetric_eigenvalues().min());
    for a in 0..M {
        for b in 0..M {
            let d = (innovation.s[(a, b)] - s[(a, b)]).abs();
            prop_assert!(d < 1e-14 * (terms[a] * terms[b] + s[(a, a)].max(s[(b, b)])));
        }
    }
    prop_assert!(
        (innovation.nis - nis).abs() <= loss * nis,
        "NIS {} {nis}",
        innovation.nis
    );

    let dx = kernel.correct(&innovation, h, &r);
    let expected = &gain * z;
    for i in 0..CAPACITY {
        let want = if i < n { expected[i] } else { 0.0 };
        let scale = if i < n { sigma[i] } else { 0.0 };
        prop_assert!(
            (dx[i] - want).abs() <= loss.max(1e-13) * scale * nis.sqrt(),
            "dx[{i}] {} {want}",
            dx[i]
        );
    }
    // Both forms subtract from P: what is lost is relative to the sigmas before, as long as S itself is well known.
    let dense = &before.p - &gain * &dense_h * &before.p;
    let d = distance(kernel, &dense, &before.p.diagonal());
    prop_assert!(d < loss.max(1e-13), "update of {M} rows, n = {n}: {d:e}");
    Ok(())
}

/// One operation on kernel and dense matrix alike; the number chooses which.
fn operate(kernel: &mut Covariance, what: u8, source: &mut Source) -> Result<(), TestCaseError> {
    let mut dense = Dense::of(kernel);
    let n = dense.p.nrows();
    let layout = *kernel.layout();
    match what {
        0..8 => with_optional!(what, block => {
            let prior = spd(source, SCALE[BLOCKS.iter().position(|b| b.name == name_of(block)).expect("listed")]);
            let fresh = !layout.has(block);
            kernel.open(block, &prior).expect("the capacity holds all blocks");
            if fresh {
                let prior = DMatrix::from_iterator(prior.nrows(), prior.nrows(), prior.iter().copied());
                dense.open(name_of(block), &prior);
                prop_assert_eq!(distance(kernel, &dense.p, &dense.p.diagonal()), 0.0, "open");
            } else {
                prop_assert_eq!(kernel.layout(), &layout);
                prop_assert_eq!(kernel.block(block, block), Some(prior));
                prop_assert!(kernel.block(block, POSITION).expect("open").norm() == 0.0);
            }
        }),
        8..16 => with_optional!(what, block => {
            kernel.close(block);
            prop_assert!(!kernel.layout().has(block));
            dense.close(name_of(block));
            prop_assert_eq!(distance(kernel, &dense.p, &dense.p.diagonal()), 0.0, "close");
        }),
        16..20 => {
            let phi = dynamics(&dense, &layout, 0.1, source);
            kernel.propagate(&phi);
            let m = matrix(&phi, n);
            let noise = DMatrix::from_diagonal(&DVector::from_column_slice(&phi.noise[..n]));
            let product = &m * &dense.p * m.transpose() + noise;
            let d = distance(kernel, &product, &product.diagonal());
            prop_assert!(d < 1e-13, "propagate, n = {}: {:e}", n, d);
        }
        20 => update(kernel, &rows::<1>(&layout, source, 1.0), source)?,
        21 => update(kernel, &rows::<2>(&layout, source, 1.0), source)?,
        22 => update(kernel, &rows::<3>(&layout, source, 1.0), source)?,
        23 => update(kernel, &lever_arm_rows(&layout, source), source)?,
        24 => {
            let fresh = !layout.has(HELD_HEADING);
            let before = kernel.clone();
            kernel
                .split(ATTITUDE, 2, HELD_HEADING)
                .expect("the capacity holds all blocks");
            if fresh {
                dense.open("held_heading", &DMatrix::zeros(1, 1));
            }
            let held = kernel
                .layout()
                .range(HELD_HEADING)
                .expect("just opened")
                .start;
            dense.move_state(8, held);
            // Additions of two numbers on both sides, so equal to the last bit.
            prop_assert_eq!(
                distance(kernel, &dense.p, &dense.p.diagonal()),
                0.0,
                "split"
            );
            if fresh {
                let mut back = kernel.clone();
                back.merge(HELD_HEADING, ATTITUDE, 2);
                prop_assert_eq!(&back, &before, "S T = I");
            }
        }
        _ => {
            kernel.merge(HELD_HEADING, ATTITUDE, 2);
            if let Some(held) = layout.range(HELD_HEADING) {
                dense.move_state(held.start, 8);
                let size = dense.p.diagonal().map(|x| x.max(f64::MIN_POSITIVE));
                dense.close("held_heading");
                let size = size.remove_row(held.start);
                let d = distance(kernel, &dense.p, &size);
                prop_assert!(d < 1e-15, "merge: {d:e}");
            }
        }
    }
    let after = Dense::of(kernel);
    prop_assert_eq!(after.names, dense.names);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn every_operation_equals_its_dense_form(
        seed in any::<u64>(),
        operations in prop::collection::vec(0u8..26, 1..40),
    ) {
        let mut source = Source::new(seed, Stream::Initial);
        let mut kernel = start(&mut source);
        for what in operations {
            operate(&mut kernel, what, &mut source)?;
            prop_assert!(is_tidy(&kernel), "operation {what}");
        }
    }
}

/// Everything open at once, 200 steps without going back to the dense matrix in between.
#[test]
fn two_hundred_steps_stay_with_the_naive_product() {
    let mut source = Source::new(3, Stream::Initial);
    for open in [0, 1, 3, 5, 8] {
        let mut kernel = start(&mut source);
        for which in 0..open {
            with_optional!(which, block => kernel.open(block, &spd(&mut source, 0.1)).expect("room"));
        }
        let mut dense = Dense::of(&kernel);
        let n = dense.p.nrows();
        for _ in 0..200 {
            let phi = dynamics(&dense, kernel.layout(), 0.01, &mut source);
            kernel.propagate(&phi);
            let m = matrix(&phi, n);
            let noise = DMatrix::from_diagonal(&DVector::from_column_slice(&phi.noise[..n]));
            dense.p = &m * &dense.p * m.transpose() + noise;
        }
        let d = distance(&kernel, &dense.p, &dense.p.diagonal());
        println!("n = {n}: {d:.1e} after 200 steps");
        assert!(d < 1e-13, "n = {n}: {d:e}");
        assert!(is_tidy(&kernel));
    }
}

/// Negative control: noise added before the last shear, and I + F dt in place of the product of shears, are both noticed.
#[test]
fn the_comparison_notices_noise_in_the_wrong_place_and_another_phi() {
    let mut source = Source::new(5, Stream::Initial);
    let mut kernel = start(&mut source);
    let dense = Dense::of(&kernel);
    let phi = dynamics(&dense, kernel.layout(), 0.1, &mut source);
    kernel.propagate(&phi);
    let noise = DMatrix::from_diagonal(&DVector::from_column_slice(&phi.noise[..BASE]));
    let m = matrix(&phi, BASE);
    let early = &m * (&dense.p + &noise) * m.transpose();
    assert!(distance(&kernel, &early, &early.diagonal()) > 1e-6);
    let mut sum = DMatrix::from_diagonal(&DVector::from_column_slice(&phi.decay[..BASE]));
    for (row, e) in [(0, &phi.position), (3, &phi.velocity), (6, &phi.attitude)] {
        let mut view = sum.view_mut((row, 0), (3, BASE));
        view += dense_rows(e, BASE);
    }
    let other = &sum * &dense.p * sum.transpose() + noise;
    assert!(distance(&kernel, &other, &other.diagonal()) > 1e-6);
}

#[test]
fn splitting_moves_the_cross_covariances_and_merging_brings_them_back() {
    let mut source = Source::new(9, Stream::Initial);
    let mut kernel = start(&mut source);
    let before = kernel.clone();
    let heading = |k: &Covariance| {
        k.block(GYRO_BIAS, ATTITUDE)
            .expect("base")
            .column(2)
            .into_owned()
    };
    let correlated = heading(&before);
    assert!(correlated.norm() > 0.0);
    kernel.split(ATTITUDE, 2, HELD_HEADING).expect("room");
    assert_eq!(heading(&kernel), Vector3::zeros());
    assert_eq!(kernel.block(GYRO_BIAS, HELD_HEADING), Some(correlated));
    assert_eq!(
        kernel.block(HELD_HEADING, HELD_HEADING).map(|v| v[(0, 0)]),
        before.block(ATTITUDE, ATTITUDE).map(|p| p[(2, 2)])
    );
    kernel.merge(HELD_HEADING, ATTITUDE, 2);
    assert_eq!(kernel, before);
}

/// Sigma of a position after its first fix of 1 cm, sigma before as given and attitude known; with what P − WᵀW gives beside
/// it.
fn after_first_fix(sigma: f64) -> (f64, f64) {
    let mut kernel = Covariance::default();
    kernel.set_prior(POSITION, &Matrix3::from_diagonal_element(sigma * sigma));
    let mut h = Columns::<3>::default();
    h.put(kernel.layout(), POSITION, &Matrix3::identity());
    h.put(
        kernel.layout(),
        ATTITUDE,
        &-insnav::attitude::skew(&Vector3::new(0.5, -0.3, 1.0)),
    );
    let r = Matrix3::from_diagonal_element(1e-4);
    let before = Dense::of(&kernel).p;
    let dense_h = dense_rows(&h, BASE);
    let s = &dense_h * &before * dense_h.transpose() + DMatrix::from_diagonal_element(3, 3, 1e-4);
    let w = s
        .cholesky()
        .expect("positive definite")
        .l()
        .solve_lower_triangular(&(&dense_h * &before))
        .expect("regular");
    let plain = (&before - w.transpose() * w)[(0, 0)].sqrt();
    let innovation = kernel
        .innovation(&h, &r, &Vector3::zeros())
        .expect("positive definite");
    kernel.correct(&innovation, &h, &r);
    assert!(is_tidy(&kernel));
    (kernel.dense::<BASE>()[(0, 0)].sqrt(), plain)
}

/// The variance that is left is R against a prior larger by the square of the ratio: a sigma of √(R) to 1e-16 × ratio² / 2,
/// which Joseph's form holds to the ratio at which it takes over (1e10: 5e-7, measured 2e-7).
#[test]
fn the_first_fix_is_used_in_full_however_little_was_known() {
    let mut worst_plain: f64 = 0.0;
    for sigma in [1e3, 3e3, 1e4, 1e5, 3e5, 1e6] {
        let (ours, plain) = after_first_fix(sigma);
        println!("sigma before {sigma:.0e} m: {ours:.12} m after, plain form {plain:.12} m");
        assert!((ours / 0.01 - 1.0).abs() < 1e-6, "{sigma:e}: {ours}");
        let off = (plain / 0.01 - 1.0).abs();
        worst_plain = worst_plain.max(if off.is_nan() { f64::INFINITY } else { off });
    }
    assert!(
        worst_plain > 0.1,
        "negative control: P − WᵀW alone loses the fix ({worst_plain:e})"
    );
}

#[test]
fn an_innovation_that_is_not_positive_definite_is_refused() {
    let mut kernel = Covariance::default();
    kernel.set_prior(POSITION, &Matrix3::identity());
    let mut h = Columns::<3>::default();
    h.put(kernel.layout(), POSITION, &Matrix3::identity());
    let zero = Vector3::zeros();
    let refused = |r: Matrix3<f64>| kernel.innovation(&h, &r, &zero).err();
    assert_eq!(
        refused(Matrix3::from_diagonal(&Vector3::new(1.0, -1.5, 1.0))),
        Some(-0.5)
    );
    assert!(
        refused(Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, f64::NAN))).is_some_and(f64::is_nan)
    );
    assert_eq!(
        refused(Matrix3::from_diagonal_element(f64::INFINITY)),
        Some(f64::INFINITY)
    );
    // Each variance is positive, but the correlation is beyond 1.
    let mut beyond = Matrix3::identity();
    (beyond[(0, 1)], beyond[(1, 0)]) = (3.0, 3.0);
    assert!(refused(beyond).is_some_and(|pivot| pivot < 0.0));
    let mut nan = Matrix3::identity();
    (nan[(0, 2)], nan[(2, 0)]) = (f64::NAN, f64::NAN);
    assert!(refused(nan).is_some());
    assert!(refused(Matrix3::identity()).is_none());
}
