//! Every Jacobian of the filter against numerical derivatives through `retract`: the error dynamics of one step, and the H of
//! every measurement.
//!
//! The dynamics are compared as rates, (Φ − I)/dt extrapolated to dt = 0, element by element, so that a Coriolis or a
//! gravity-gradient term is resolved as well as a specific force; and every single term of the error equations is shown to be
//! needed with its sign.

use insnav::attitude::{exp, skew};
use insnav::config::{GnssConfig, SigmaScale};
use insnav::earth::{Geodetic, LocalEarth};
use insnav::filter::{
    BASE, CAPACITY, Calibration, Columns, Eskf, InitialSigma, Layout, Measurement, Nominal, States,
    Transition, fill_base,
};
use insnav::imu::{ImuErrors, ImuGrade, ImuNoise};
use insnav::measurement::{
    GnssPositionAid, GnssPositionModel, GnssVelocityAid, GnssVelocityModel, HeadingModel,
    HorizontalVelocityModel,
};
use insnav::mechanization::{Increment, NavState};
use insnav::sample::{GnssPosition, GnssVelocity};
use insnav::sim::{Source, Stream};
use insnav::time::Time;
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

type Rows = SMatrix<f64, 9, BASE>;

const STATES: u64 = 200;

/// Steps of the central differences: large where the states' own resolution is poor (metres on a sphere of 6.4e6 m), small
/// against the radius over which anything changes.
const STEP: [f64; 5] = [3e3, 10.0, 1e-3, 1e-2, 0.1];
/// What rounding leaves of position (longitude: 4e-16 rad × R), velocity and attitude after one step.
const RESOLUTION: [f64; 3] = [3e-9, 3e-14, 4e-16];
const DT: f64 = 1e-3;

/// A state and what the sensors measure there.
struct Case {
    nominal: Nominal,
    rate_b: Vector3<f64>,
    force_b: Vector3<f64>,
    noise: ImuNoise,
}

fn random_nominal(source: &mut Source) -> Nominal {
    let position = Geodetic::from_degrees(
        source.between(-80.0, 80.0),
        source.between(-180.0, 180.0),
        source.between(-100.0, 10_000.0),
    );
    Nominal {
        held_q_nb: UnitQuaternion::identity(),
        nav: NavState {
            time: Time(1_700_000_000_000_000_000),
            position,
            velocity_n: source.normal3().normalize() * source.between(0.0, 100.0),
            q_nb: exp(&(source.normal3() * 2.0)),
        },
        rate_b: source.normal3() * 2.0,
        imu_errors: ImuErrors {
            gyro_bias: source.normal3() * 0.01,
            accel_bias: source.normal3() * 0.3,
            ..ImuErrors::default()
        },
        acceleration_n: source.normal3() * 2.0,
        calibration: Calibration::default(),
    }
}

impl Case {
    fn random(seed: u64) -> Self {
        let mut source = Source::new(seed, Stream::Initial);
        let nominal = random_nominal(&mut source);
        Case {
            rate_b: source.normal3() * 2.0,
            force_b: source.normal3() * 10.0,
            noise: ImuGrade::Consumer.noise(),
            nominal,
        }
    }

    fn increment(&self, dt: f64) -> Increment {
        Increment {
            time: self.nominal.nav.time.plus(dt),
            dt,
            rotation_b: (self.rate_b + self.nominal.imu_errors.gyro_bias) * dt,
            velocity_b: (self.force_b + self.nominal.imu_errors.accel_bias) * dt,
        }
    }

    /// Where the filter takes a state with what is measured here.
    fn step(&self, from: &Nominal, dt: f64) -> Nominal {
        let zero = Vector3::zeros();
        let sigma = InitialSigma {
            position: zero,
            velocity: zero,
            attitude: zero,
            gyro_bias: zero,
            accel_bias: zero,
        };
        let mut filter = Eskf::new(from.nav, from.imu_errors, &sigma, self.noise);
        filter.propagate(&self.increment(dt));
        *filter.nominal()
    }

    /// (Φ − I)/dt by central differences: the difference of two states, moved on alike.
    fn numerical(&self, dt: f64) -> SMatrix<f64, BASE, BASE> {
        let layout = Layout::default();
        let base = self.step(&self.nominal, dt);
        SMatrix::from_columns(&core::array::from_fn::<_, BASE, _>(|j| {
            let moved = |by: f64| {
                let mut dx = [0.0; CAPACITY];
                dx[j] = by;
                let end = self.step(&self.nominal.retract(&layout, &dx), dt);
                SMatrix::<f64, BASE, 1>::from_column_slice(&base.local(&layout, &end)[..BASE])
            };
            let h = STEP[j / 3];
            let mut column = (moved(h) - moved(-h)) / (2.0 * h);
            column[j] -= 1.0;
            column / dt
        }))
    }

    /// (Φ − I)/dt as the covariance is moved.
    fn analytic(&self, dt: f64) -> SMatrix<f64, BASE, BASE> {
        let errors = &self.nominal.imu_errors;
        let increment = self.increment(dt).corrected(errors);
        let interval = self.nominal.nav.clone().advance(&increment);
        let mut phi = Transition::default();
        fill_base(&mut phi, &Layout::default(), &interval, &self.noise);
        SMatrix::from_columns(&core::array::from_fn::<_, BASE, _>(|j| {
            let mut unit = [0.0; CAPACITY];
            unit[j] = 1.0;
            let mut column = SMatrix::<f64, BASE, 1>::from_column_slice(&phi.times(&unit)[..BASE]);
            column[j] -= 1.0;
            column / dt
        }))
    }

    /// The error equations, term by term, from the frame rates and gravity themselves.
    fn terms(&self) -> Vec<(&'static str, Rows)> {
        let (nav, v) = (&self.nominal.nav, self.nominal.nav.velocity_n);
        let earth = LocalEarth::at(&nav.position);
        let (rm, rn) = (1.0 / earth.meridian, 1.0 / earth.transverse);
        let tan = earth.sin_latitude / earth.cos_latitude;
        let c = nav.q_nb.to_rotation_matrix().into_inner();
        // Derivatives by position in metres, from functions of the Earth at two places.
        let by_position = |of: &dyn Fn(&LocalEarth) -> Vector3<f64>| {
            let h = 1e3;
            Matrix3::from_columns(&core::array::from_fn::<_, 3, _>(|j| {
                let at = |by: f64| {
                    let mut dp = Vector3::zeros();
                    dp[j] = by;
                    of(&LocalEarth::at(&nav.position.offset(&dp)))
                };
                (at(h) - at(-h)) / (2.0 * h)
            }))
        };
        let earth_rate = by_position(&|e| e.earth_rate_n());
        let transport = |sin_cos: bool, meridian: bool, transverse: bool| {
            by_position(&|e| {
                let mut seen = earth;
                if sin_cos {
                    (seen.sin_latitude, seen.cos_latitude) = (e.sin_latitude, e.cos_latitude);
                }
                if meridian {
                    seen.meridian = e.meridian;
                }
                if transverse {
                    seen.transverse = e.transverse;
                }
                seen.transport_rate_n(&v)
            })
        };
        let (by_tangent, by_meridian, by_transverse) = (
            transport(true, false, false),
            transport(false, true, false),
            transport(false, false, true),
        );
        let only = |m: &Matrix3<f64>, column: usize| {
            let mut out = Matrix3::zeros();
            out.set_column(column, &m.column(column));
            out
        };
        let mut transport_by_velocity = Matrix3::zeros();
        for j in 0..3 {
            let mut unit = Vector3::zeros();
            unit[j] = 1.0;
            transport_by_velocity.set_column(j, &earth.transport_rate_n(&unit));
        }
        let gravity = by_position(&|e| Vector3::new(0.0, 0.0, e.gravity()));
        let z = Matrix3::zeros();
        let put = |row: usize, column: usize, m: Matrix3<f64>| {
            let mut rows = Rows::zeros();
            rows.fixed_view_mut::<3, 3>(3 * row, 3 * column)
                .copy_from(&m);
            rows
        };
        let (p, vel, att, bg, ba) = (0, 1, 2, 3, 4);
        let both =
            |w: Matrix3<f64>, factor: f64| put(vel, p, skew(&v) * w * factor) - put(att, p, w);
        let mut up = z;
        up.set_column(2, &Vector3::new(v.x * rm, v.y * rn, 0.0));
        let mut meridians = z;
        (meridians[(1, 0)], meridians[(1, 1)]) = (v.y * tan * rn, -v.x * tan * rn);
        vec![
            ("dp' = dv", put(p, vel, Matrix3::identity())),
            ("dp' = v_h/R dp_D", put(p, p, up)),
            (
                "dp' = -v_D/R dp_h",
                put(
                    p,
                    p,
                    Matrix3::from_diagonal(&Vector3::new(-v.z * rm, -v.z * rn, 0.0)),
                ),
            ),
            ("dp' along converging meridians", put(p, p, meridians)),
            ("dv' = -f x phi", put(vel, att, -skew(&(c * self.force_b)))),
            ("dv' = -C db_a", put(vel, ba, -c)),
            (
                "dv' = -2 w_ie x dv",
                put(vel, vel, -skew(&(earth.earth_rate_n() * 2.0))),
            ),
            (
                "dv' = -w_en x dv",
                put(vel, vel, -skew(&earth.transport_rate_n(&v))),
            ),
            (
                "dv' = v x dw_en(dv)",
                put(vel, vel, skew(&v) * transport_by_velocity),
            ),
            ("dv' = dg(latitude)", put(vel, p, only(&gravity, 0))),
            ("dv' = dg(height)", put(vel, p, only(&gravity, 2))),
            ("dw_ie(dp) in dv' and phi'", both(earth_rate, 2.0)),
            (
                "dw_en(dp) by the tangent of latitude",
                both(by_tangent, 1.0),
            ),
            (
                "dw_en(dp) by height over the meridian radius",
                both(only(&by_meridian, 2), 1.0),
            ),
            (
                "dw_en(dp) by height over the transverse radius",
                both(only(&by_transverse, 2), 1.0),
            ),
            (
                "dw_en(dp) by the slope of the meridian radius",
                both(only(&by_meridian, 0), 1.0),
            ),
            (
                "dw_en(dp) by the slope of the transverse radius",
                both(only(&by_transverse, 0), 1.0),
            ),
            (
                "phi' = -w_ie x phi",
                put(att, att, -skew(&earth.earth_rate_n())),
            ),
            (
                "phi' = -w_en x phi",
                put(att, att, -skew(&earth.transport_rate_n(&v))),
            ),
            ("phi' = -dw_en(dv)", put(att, vel, -transport_by_velocity)),
            ("phi' = -C db_g", put(att, bg, -c)),
        ]
    }

    /// What a numerical derivative may be off by: the second order of the differences (1e-4 of every term), rounding, and the
    /// third order of the step, for which Ḟ and F̈ matter where the turning body axes stand in F.
    fn tolerance(&self, terms: &[(&str, Rows)]) -> Rows {
        let turning = 2.0 * self.rate_b.norm() + 1.0;
        let mut size = SMatrix::<f64, BASE, BASE>::zeros();
        for (_, term) in terms {
            let mut view = size.fixed_view_mut::<9, BASE>(0, 0);
            view += term.abs();
        }
        // Turning axes mix the elements of a block: what matters to the third order is the largest of them.
        let block = SMatrix::<f64, BASE, BASE>::from_fn(|i, j| {
            size.fixed_view::<3, 3>(i / 3 * 3, j / 3 * 3).max()
        });
        let mut body = block * (turning * turning);
        body.fixed_view_mut::<9, 6>(0, 0).fill(0.0);
        body.fixed_view_mut::<3, 3>(6, 6).fill(0.0);
        let third = block * block * block + block * block * turning + body;
        Rows::from_fn(|i, j| {
            // Two differences of two states each, the finer of twice the weight over half the step.
            let rounding = 5.0 * RESOLUTION[i / 3] / (STEP[j / 3] * DT);
            1e-4 * size[(i, j)] + rounding + third[(i, j)] * DT * DT
        })
    }
}

/// The limit at dt = 0 of what has an error proportional to dt.
fn extrapolated(rate: impl Fn(f64) -> SMatrix<f64, BASE, BASE>) -> Rows {
    (rate(0.5 * DT) * 2.0 - rate(DT))
        .fixed_rows::<9>(0)
        .into_owned()
}

/// The element that is off by the largest multiple of its tolerance.
fn worst(a: &Rows, b: &Rows, tolerance: &Rows) -> (f64, usize, usize) {
    let mut worst = (0.0, 0, 0);
    for i in 0..9 {
        for j in 0..BASE {
            let d = (a[(i, j)] - b[(i, j)]).abs() / tolerance[(i, j)];
            if d > worst.0 || d.is_nan() {
                worst = (d, i, j);
            }
        }
    }
    worst
}

#[test]
fn error_dynamics_equal_numerical_derivatives_and_every_term_is_needed() {
    let mut noticed: Vec<(&str, u64)> = Vec::new();
    let mut largest: f64 = 0.0;
    for seed in 0..STATES {
        let case = Case::random(seed);
        let terms = case.terms();
        let tolerance = case.tolerance(&terms);
        let numerical = extrapolated(|dt| case.numerical(dt));
        let analytic = extrapolated(|dt| case.analytic(dt));
        let sum: Rows = terms.iter().map(|(_, t)| t).sum();
        for (name, f) in [("filter", &analytic), ("sum of the terms", &sum)] {
            let (d, i, j) = worst(&numerical, f, &tolerance);
            largest = largest.max(d);
            assert!(
                d < 1.0,
                "{name}, seed {seed}: F[{i}, {j}] = {:e}, numerically {:e} ± {:e}",
                f[(i, j)],
                numerical[(i, j)],
                tolerance[(i, j)]
            );
        }
        noticed.resize(terms.len(), ("", 0));
        for (count, (name, term)) in noticed.iter_mut().zip(&terms) {
            let wrong = sum - term * 2.0;
            *count = (
                name,
                count.1 + u64::from(worst(&numerical, &wrong, &tolerance).0 > 1.0),
            );
        }
    }
    println!("largest deviation: {largest:.2} of its tolerance");
    for (name, count) in noticed {
        println!("{count:4} of {STATES} states notice the wrong sign of {name}");
        // A term may vanish by chance (a slow state, the equator): most often the slopes of the radii, half a percent of
        // the transport rate's change. All but these are noticed nearly everywhere.
        assert!(count >= STATES / 2, "{name}: {count}");
    }
}

/// Over a step of 10 ms the covariance is moved by Φ itself, not by its rate: first order in dt within each block.
#[test]
fn a_whole_step_is_right_to_second_order() {
    for seed in 0..STATES {
        let case = Case::random(seed);
        let error = |dt: f64| {
            let d = (case.numerical(dt) - case.analytic(dt)) * dt;
            d.fixed_view::<9, BASE>(0, 0).abs().max()
        };
        let (coarse, fine) = (error(0.01), error(0.005));
        // ½ dt² F² in SI units: the largest are specific force (some 30 m/s²) from tilt to position and, turned by the body at
        // some rad/s, to velocity.
        assert!(coarse < 0.5 * 1e-4 * 60.0, "seed {seed}: {coarse:e}");
        // A quarter over half the step; the third order takes some of it.
        assert!(coarse / fine > 3.5, "seed {seed}: {coarse:e} {fine:e}");
    }
}

#[test]
fn biases_decay_as_their_errors_do() {
    let case = Case::random(1);
    let dt = 0.5;
    let end = case.step(&case.nominal, dt);
    let decay = (-dt / case.noise.gyro_bias_tau).exp();
    let expected = case.nominal.imu_errors.gyro_bias * decay;
    // The series of the decay is cut at x³ of x = dt/τ = 1.7e-3... where it is not used any more: rounding is left.
    assert!((end.imu_errors.gyro_bias - expected).norm() < 1e-16);
    let rate = case.numerical(dt)[(9, 9)];
    assert!((rate * dt + 1.0 - decay).abs() < 1e-10);
}

#[test]
fn local_inverts_retract() {
    let layout = Layout::default();
    for seed in 0..STATES {
        let mut source = Source::new(seed, Stream::Initial);
        let nominal = random_nominal(&mut source);
        let mut dx = [0.0; CAPACITY];
        for (i, x) in dx.iter_mut().enumerate().take(BASE) {
            *x = source.normal() * [30.0, 10.0, 0.5, 0.1, 1.0][i / 3];
        }
        let back = nominal.local(&layout, &nominal.retract(&layout, &dx));
        for i in 0..CAPACITY {
            // What a latitude and longitude in radians resolve, times R; rounding for all others.
            let resolution = if i < 3 { 1e-8 } else { 1e-13 };
            assert!(
                (back[i] - dx[i]).abs() < resolution,
                "seed {seed}, state {i}"
            );
        }
        let moved = nominal.retract(&layout, &dx);
        let bias_moved = moved.imu_errors.gyro_bias - nominal.imu_errors.gyro_bias;
        assert!(
            (moved.rate_b + bias_moved - nominal.rate_b).norm() < 1e-15,
            "the gyro measured what it measured"
        );
    }
}

/// H of a model as a dense matrix, and its residual's derivative, both at random states: the largest difference.
fn check_h<const M: usize, T: Measurement<M>>(
    seed: u64,
    model: impl Fn(&Nominal, &mut Source) -> T,
    wrong: impl Fn(&mut SMatrix<f64, M, BASE>),
) -> f64 {
    let layout = Layout::default();
    let mut source = Source::new(seed, Stream::Initial);
    let mut nominal = random_nominal(&mut source);
    // Heading has no derivative at ±90° of pitch: stay 10° away, for all models alike.
    while insnav::attitude::Euler::from_quaternion(&nominal.nav.q_nb)
        .pitch
        .abs()
        > 1.4
    {
        nominal = random_nominal(&mut source);
    }
    let model = model(&nominal, &mut source);
    let mut h = dense(&model.linearize(&nominal, &layout).h);
    wrong(&mut h);
    let mut largest: f64 = 0.0;
    for j in 0..BASE {
        let step = [1.0, 1.0, 1e-4, 1e-3, 1e-2][j / 3];
        let residual = |by: f64| {
            let mut dx: States = [0.0; CAPACITY];
            dx[j] = by;
            model
                .linearize(&nominal.retract(&layout, &dx), &layout)
                .residual
        };
        // residual = measured − predicted: it falls as the prediction rises.
        let slope = (residual(-step) - residual(step)) / (2.0 * step);
        for m in 0..M {
            largest = largest.max((slope[m] - h[(m, j)]).abs());
        }
    }
    largest
}

fn dense<const M: usize>(h: &Columns<M>) -> SMatrix<f64, M, BASE> {
    let mut out = SMatrix::zeros();
    for (place, column) in h.iter() {
        for m in 0..M {
            out[(m, place)] += column[m];
        }
    }
    out
}

fn lever(source: &mut Source) -> Vector3<f64> {
    source.normal3().normalize() * 2.0
}

fn position_model(at: &Nominal, source: &mut Source) -> GnssPositionModel {
    GnssPositionModel {
        lever_arm_b: lever(source),
        position: at.nav.position.offset(&(source.normal3() * 5.0)),
        r: Matrix3::identity(),
        dependence: 1.0,
        position_alone: false,
    }
}

fn velocity_model(at: &Nominal, source: &mut Source) -> GnssVelocityModel {
    GnssVelocityModel {
        lever_arm_b: lever(source),
        velocity_n: at.nav.velocity_n + source.normal3(),
        r: Matrix3::identity(),
    }
}

fn heading_model(at: &Nominal, source: &mut Source) -> HeadingModel {
    HeadingModel {
        heading: insnav::attitude::Euler::from_quaternion(&at.nav.q_nb).heading
            + 0.1 * source.normal(),
        sigma: 0.01,
    }
}

/// Bounds: position resolution 3e-9 m over a step of 1e-4 rad is 3e-5, and a lever arm of 2 m changes by (1e-4)²/6 of itself;
/// radii of curvature at antenna and IMU differ by 1e-6.
#[test]
fn every_h_equals_the_numerical_derivative_of_its_residual() {
    for seed in 0..STATES {
        let d = check_h(seed, position_model, |_| {});
        assert!(d < 5e-5, "position, seed {seed}: {d:e}");
        // Everything here is of order 1 and smooth; 1e-10 is what 1e-14 m/s leaves over 1e-4 rad.
        let d = check_h(seed, velocity_model, |_| {});
        assert!(d < 3e-8, "velocity, seed {seed}: {d:e}");
        let d = check_h(
            seed,
            |n, s| HorizontalVelocityModel(velocity_model(n, s)),
            |_| {},
        );
        assert!(d < 3e-8, "horizontal velocity, seed {seed}: {d:e}");
        // tan θ reaches 5.8: third derivatives of some 200 × (1e-4)²/6.
        let d = check_h(seed, heading_model, |_| {});
        assert!(d < 2e-6, "heading, seed {seed}: {d:e}");
    }
}

/// Negative controls: each block of each H with its sign turned is far outside the bounds above.
#[test]
fn a_wrong_sign_in_any_h_is_noticed() {
    let mut smallest = [f64::INFINITY; 7];
    for seed in 0..STATES {
        let turned = |block: usize| {
            move |h: &mut SMatrix<f64, 3, BASE>| h.fixed_columns_mut::<3>(3 * block).neg_mut()
        };
        let found = [
            check_h(seed, position_model, turned(0)),
            check_h(seed, position_model, turned(2)),
            check_h(seed, velocity_model, turned(1)),
            check_h(seed, velocity_model, turned(2)),
            check_h(seed, velocity_model, turned(3)),
            check_h(seed, heading_model, |h| h.neg_mut()),
            // The smallest term of all: the Earth's rate across the lever arm.
            check_h(seed, velocity_model, |h| h[(0, 6)] += 1e-6),
        ];
        for (s, f) in smallest.iter_mut().zip(found) {
            *s = s.min(f);
        }
    }
    println!("least deviations: {smallest:?}");
    assert!(smallest[..6].iter().all(|s| *s > 1e-2), "{smallest:?}");
    assert!(smallest[6] > 5e-7, "{smallest:?}");
}

/// The velocity of an antenna, by moving the antenna: the position of the lever arm's end before and after a step.
#[test]
fn velocity_of_an_antenna_is_the_derivative_of_its_position() {
    for seed in 0..STATES {
        let case = Case::random(seed);
        let mut source = Source::new(seed, Stream::PositionWhite);
        let arm = lever(&mut source);
        let dt = 1e-3;
        let end = case.step(&case.nominal, dt);
        let antenna = |n: &Nominal| n.nav.position.offset(&(n.nav.q_nb * arm));
        let moved = antenna(&case.nominal).offset_to(&antenna(&end)) / dt;
        let mean = |n: &Nominal| {
            let model = GnssVelocityModel {
                velocity_n: Vector3::zeros(),
                lever_arm_b: arm,
                r: Matrix3::identity(),
            };
            let at = Nominal {
                rate_b: case.rate_b,
                ..*n
            };
            -model.linearize(&at, &Layout::default()).residual
        };
        let predicted = (mean(&case.nominal) + mean(&end)) * 0.5;
        // Trapezoid: ω³ l dt²/12 of some 1e-5; resolution of positions 3e-9 m / dt; NED axes of antenna and IMU differ by
        // 2 m / R × tan L × 100 m/s.
        let bound = 2e-4 + 6e-6;
        assert!(
            (moved - predicted).norm() < bound,
            "seed {seed}: {:e}",
            (moved - predicted).norm()
        );
    }
}

#[test]
fn stated_covariances_pass_through_scaled_and_floored() {
    let mut r = Matrix3::from_diagonal(&Vector3::new(4.0, 1e-6, 9.0));
    (r[(0, 2)], r[(2, 0)]) = (1.5, 1.5);
    let nominal = Case::random(0).nominal;
    let config = GnssConfig {
        sigma_floor_m: 0.5,
        sigma_scale: SigmaScale::Fixed(2.0),
        velocity_sigma_floor_m_per_s: 0.1,
        ..GnssConfig::default()
    };
    let fix = |covariance_n| GnssPosition {
        time: Time(0),
        position: nominal.nav.position,
        covariance_n,
    };
    let model = GnssPositionAid::new(&config).model(&fix(Some(r)), true);
    let used = model.linearize(&nominal, &Layout::default()).r;
    let mut expected = r * 4.0;
    expected[(1, 1)] = 0.25;
    assert_eq!(used, expected);
    let unstated = GnssPositionAid::new(&GnssConfig::default())
        .model(&fix(None), true)
        .r;
    assert_eq!(unstated, Matrix3::from_diagonal_element(9.0));

    let fix = |covariance_n| GnssVelocity {
        time: Time(0),
        velocity_n: Vector3::zeros(),
        covariance_n,
    };
    let model = GnssVelocityAid::new(&config).model(&fix(Some(r)));
    let mut expected = r;
    expected[(1, 1)] = 0.1 * 0.1;
    assert_eq!(model.linearize(&nominal, &Layout::default()).r, expected);
    let two = HorizontalVelocityModel(model)
        .linearize(&nominal, &Layout::default())
        .r;
    assert_eq!(two, expected.fixed_view::<2, 2>(0, 0).into_owned());
    let unstated = GnssVelocityAid::new(&GnssConfig::default())
        .model(&fix(None))
        .r;
    assert!((unstated - Matrix3::from_diagonal_element(0.01)).norm() < 1e-17);

    let heading = HeadingModel {
        heading: 0.0,
        sigma: 0.3,
    };
    assert_eq!(
        heading.linearize(&nominal, &Layout::default()).r[(0, 0)],
        0.3 * 0.3
    );
}

#[test]
fn headings_are_compared_the_short_way_round() {
    let mut nominal = Case::random(0).nominal;
    for (fix, at, expected) in [
        (0.1, 6.2, 0.1 + std::f64::consts::TAU - 6.2),
        (6.2, 0.1, 6.1 - std::f64::consts::TAU),
    ] {
        nominal.nav.q_nb = exp(&Vector3::new(0.0, 0.0, at));
        let model = HeadingModel {
            heading: fix,
            sigma: 1.0,
        };
        let residual = model.linearize(&nominal, &Layout::default()).residual[0];
        assert!((residual - expected).abs() < 1e-14, "{residual}");
    }
}
