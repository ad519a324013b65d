//! How good the discrete Φ and Q of the filter are: sigmas after one second of 10 ms steps against Van Loan's exact ones.

use insnav::earth::{Geodetic, LocalEarth};
use insnav::filter::{
    ACCEL_BIAS, ATTITUDE, BASE, Columns, Covariance, GYRO_BIAS, GaussMarkov, POSITION, Transition,
    VELOCITY, fill_base,
};
use insnav::imu::{ImuGrade, ImuNoise};
use insnav::mechanization::Interval;
use insnav::sim::{Source, Stream};
use nalgebra::{DMatrix, Matrix3, SMatrix, Vector3};

type Square = SMatrix<f64, BASE, BASE>;

/// A vehicle's second: level to 20°, up to 40 m/s, up to 4 m/s² beside gravity.
fn interval(seed: u64, dt: f64) -> Interval {
    let mut source = Source::new(seed, Stream::Initial);
    let mut tilt = source.normal3() * 0.15;
    tilt.z = source.between(-3.0, 3.0);
    let position = Geodetic::from_degrees(source.between(-70.0, 70.0), 10.0, 300.0);
    Interval {
        dt,
        specific_force_n: source.normal3() * 2.0 - Vector3::z() * 9.8,
        axes_n: insnav::attitude::exp(&tilt)
            .to_rotation_matrix()
            .into_inner(),
        velocity_n: source.normal3() * 15.0,
        earth: LocalEarth::at(&position),
    }
}

/// F of the error dynamics: the shears of a step so short that nothing but the first order is left, over its length.
fn continuous(seed: u64, noise: &ImuNoise) -> Square {
    let dt = 1e-9;
    let mut phi = Transition::default();
    fill_base(
        &mut phi,
        Covariance::default().layout(),
        &interval(seed, dt),
        noise,
    );
    let mut f = Square::zeros();
    let shears: [(usize, &Columns<3>); 3] =
        [(0, &phi.position), (3, &phi.velocity), (6, &phi.attitude)];
    for (row, shear) in shears {
        for (place, column) in shear.iter() {
            for a in 0..3 {
                f[(row + a, place)] += column[a] / dt;
            }
        }
    }
    for a in 0..3 {
        f[(9 + a, 9 + a)] = -1.0 / noise.gyro_bias_tau;
        f[(12 + a, 12 + a)] = -1.0 / noise.accel_bias_tau;
    }
    f
}

/// Spectral densities of the white noise that drives the states.
fn density(noise: &ImuNoise) -> Square {
    let mut q = Square::zeros();
    for a in 0..3 {
        q[(3 + a, 3 + a)] = noise.accel_white.powi(2);
        q[(6 + a, 6 + a)] = noise.gyro_white.powi(2);
        q[(9 + a, 9 + a)] = 2.0 * noise.gyro_bias_sigma.powi(2) / noise.gyro_bias_tau;
        q[(12 + a, 12 + a)] = 2.0 * noise.accel_bias_sigma.powi(2) / noise.accel_bias_tau;
    }
    q
}

/// Φ and Q over `t` seconds, exact: exp([−F  Q; 0  Fᵀ] t) = [·  Φ⁻¹Q_d; 0  Φᵀ] ([VanLoan78]).
fn van_loan(f: &Square, q: &Square, t: f64) -> (Square, Square) {
    // States in units of their own size: the exponential then adds numbers of one size.
    let scale = Square::from_diagonal(&SMatrix::from_fn(|i, _| [1.0, 1.0, 0.1, 0.1, 1.0][i / 3]));
    let inverse = scale.try_inverse().expect("positive");
    let (f, q) = (inverse * f * scale, inverse * q * inverse);
    let mut m = DMatrix::zeros(2 * BASE, 2 * BASE);
    m.view_mut((0, 0), (BASE, BASE)).copy_from(&(-f * t));
    m.view_mut((0, BASE), (BASE, BASE)).copy_from(&(q * t));
    m.view_mut((BASE, BASE), (BASE, BASE))
        .copy_from(&(f.transpose() * t));
    let e = m.exp();
    let phi: Square = e.fixed_view::<BASE, BASE>(BASE, BASE).transpose();
    let noise: Square = phi * e.fixed_view::<BASE, BASE>(0, BASE);
    (scale * phi * inverse, scale * noise * scale)
}

fn prior(p: &mut Covariance, sigmas: [f64; 5]) {
    let square = |s: f64| Matrix3::from_diagonal_element(s * s);
    p.set_prior(POSITION, &square(sigmas[0]));
    p.set_prior(VELOCITY, &square(sigmas[1]));
    p.set_prior(ATTITUDE, &square(sigmas[2]));
    p.set_prior(GYRO_BIAS, &square(sigmas[3]));
    p.set_prior(ACCEL_BIAS, &square(sigmas[4]));
}

/// Largest relative error of a sigma in each block after one second of 100 steps.
fn errors(
    seed: u64,
    noise: &ImuNoise,
    sigmas: [f64; 5],
    alter: impl Fn(&mut Transition),
) -> [f64; 5] {
    let mut kernel = Covariance::default();
    prior(&mut kernel, sigmas);
    let before: Square = kernel.dense();
    let mut phi = Transition::default();
    fill_base(&mut phi, kernel.layout(), &interval(seed, 0.01), noise);
    alter(&mut phi);
    for _ in 0..100 {
        kernel.propagate(&phi);
    }
    let (exact_phi, exact_q) = van_loan(&continuous(seed, noise), &density(noise), 1.0);
    let exact = exact_phi * before * exact_phi.transpose() + exact_q;
    let found: Square = kernel.dense();
    let mut out = [0.0f64; 5];
    for i in 0..BASE {
        let e = (found[(i, i)] / exact[(i, i)]).sqrt() - 1.0;
        out[i / 3] = out[i / 3].max(e.abs());
    }
    out
}

fn largest(
    sigmas: impl Fn(&ImuNoise) -> [f64; 5],
    alter: impl Fn(&mut Transition) + Copy,
) -> [f64; 5] {
    let mut all = [0.0f64; 5];
    for grade in ImuGrade::ALL {
        let noise = grade.noise();
        for seed in 0..20 {
            let e = errors(seed, &noise, sigmas(&noise), alter);
            for (a, e) in all.iter_mut().zip(e) {
                *a = a.max(e);
            }
        }
    }
    all
}

const CERTAIN: fn(&ImuNoise) -> [f64; 5] = |_| [0.0; 5];
/// A start with GNSS: metres, tenths of m/s, a degree, biases as after power-on.
const A_START: fn(&ImuNoise) -> [f64; 5] =
    |n| [2.0, 0.1, 0.02, n.gyro_bias_sigma, n.accel_bias_sigma];

#[test]
fn sigmas_after_a_second_are_those_of_van_loan() {
    let from_zero = largest(CERTAIN, |_| {});
    let from_start = largest(A_START, |_| {});
    println!(
        "largest relative error of a sigma (position, velocity, attitude, gyro bias, accelerometer bias)"
    );
    println!("from P = 0: {from_zero:?}\nfrom a start: {from_start:?}");
    // Of N steps, each moves the position by the velocity before it: its sigma from white accelerations is short of
    // √(t³/3) by 3/(4N), 0.75 % here, and a little more where attitude feeds it. Velocity and attitude are a power of dt
    // better each, and where something is uncertain already, the noise of one second is a small part of it.
    let bounds = [0.01, 1e-3, 1e-4];
    assert!(
        from_zero.iter().zip(bounds).all(|(e, bound)| *e < bound),
        "{from_zero:?}"
    );
    assert!(from_start.iter().all(|e| *e < 2e-4), "{from_start:?}");
    // The biases are stepped exactly.
    assert!(
        from_zero[3] < 1e-12 && from_zero[4] < 1e-12,
        "{from_zero:?}"
    );
}

/// Negative controls: half the gyro noise, and bias noise without its factor 2, are far outside.
#[test]
fn wrong_noise_is_noticed() {
    let halved = largest(CERTAIN, |phi| {
        phi.noise[6..9].iter_mut().for_each(|q| *q *= 0.25)
    });
    assert!(halved[2] > 0.4, "{halved:?}");
    let no_factor = largest(CERTAIN, |phi| {
        phi.noise[9..15].iter_mut().for_each(|q| *q *= 0.5)
    });
    assert!(no_factor[3] > 0.25 && no_factor[4] > 0.25, "{no_factor:?}");
}

/// The series that replaces the exponentials of short steps, on both sides of where it begins and for a constant.
#[test]
fn a_gauss_markov_step_is_exact_for_any_length() {
    let (sigma, tau) = (0.3, 100.0);
    for x in [
        1e-12, 1e-6, 1e-4, 4.99e-4, 5.01e-4, 9.99e-4, 1.001e-3, 0.1, 3.0, 50.0,
    ] {
        let step = GaussMarkov::over(x * tau, sigma, tau);
        let (decay, variance) = ((-x).exp(), -sigma * sigma * (-2.0 * x).exp_m1());
        // Cut behind x³/6, the series is short of x⁴/24: 4e-14 of 1 at most, and of the variance x³/24 of itself; where the
        // exponential takes over, 1 − e^−x has lost what 1e-16 is of x.
        assert!((step.decay - decay).abs() < 1e-13, "x = {x}");
        assert!(
            (step.variance / variance - 1.0).abs() < 2e-10,
            "x = {x}: {} {variance}",
            step.variance
        );
    }
    let constant = GaussMarkov::over(0.01, sigma, f64::INFINITY);
    assert_eq!((constant.decay, constant.variance), (1.0, 0.0));
    // Two halves are a whole.
    let (whole, half) = (
        GaussMarkov::over(1.0, sigma, tau),
        GaussMarkov::over(0.5, sigma, tau),
    );
    assert!((half.decay * half.decay - whole.decay).abs() < 1e-15);
    let twice = half.variance * (1.0 + half.decay * half.decay);
    assert!((twice / whole.variance - 1.0).abs() < 1e-12);
}
