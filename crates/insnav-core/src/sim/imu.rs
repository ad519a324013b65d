//! What an inertial unit says: exact increments or rates of a trajectory, then its errors.

use super::noise::{GaussMarkov, Source, Stream};
use super::quadrature::gauss_legendre;
use super::range::{finite, not_negative, positive, require};
use super::trajectory::Trajectory;
use crate::error::Result;
use crate::imu::{ImuErrors, ImuNoise};
use crate::sample::{ImuIncrement, ImuSample, Sample};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// What a unit puts out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImuOutput {
    /// Angular rate and specific force at the stamp.
    #[default]
    Rates,
    /// Their integrals over the interval that ends at the stamp.
    Increments,
}

/// An inertial unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuModel {
    /// Samples per second.
    pub rate_hz: f64,
    /// Rates or increments.
    #[serde(default)]
    pub output: ImuOutput,
    /// What is wrong with it.
    #[serde(default)]
    pub errors: ImuErrorModel,
}

/// Errors of an inertial unit: measured = (1 + scale) true + constant bias + drifting bias + white noise, then quantised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuErrorModel {
    /// White noise and drifting biases, SI, stationary from the first sample on. `None`: neither.
    pub noise: Option<ImuNoise>,
    /// Constant gyro bias, degrees per hour, body axes.
    pub gyro_bias_deg_per_hour: [f64; 3],
    /// Constant accelerometer bias, m/s², body axes.
    pub accel_bias_m_per_s2: [f64; 3],
    /// Scale factor errors of the gyros, parts per million.
    pub gyro_scale_ppm: [f64; 3],
    /// Scale factor errors of the accelerometers, parts per million.
    pub accel_scale_ppm: [f64; 3],
    /// Least step of an angular output: rad/s of rates, rad of increments; 0: continuous.
    pub gyro_quantum: f64,
    /// Least step of a force output: m/s² of rates, m/s of increments; 0: continuous.
    pub accel_quantum: f64,
}

impl ImuErrorModel {
    /// White noise and drifting biases only.
    pub fn from_noise(noise: ImuNoise) -> Self {
        ImuErrorModel {
            noise: Some(noise),
            ..Self::default()
        }
    }

    fn constant(&self) -> ImuErrors {
        ImuErrors {
            gyro_bias: Vector3::from(self.gyro_bias_deg_per_hour).map(|v| v.to_radians() / 3600.0),
            accel_bias: Vector3::from(self.accel_bias_m_per_s2),
            gyro_scale: Vector3::from(self.gyro_scale_ppm) * 1e-6,
            accel_scale: Vector3::from(self.accel_scale_ppm) * 1e-6,
        }
    }
}

/// Nodes per panel and longest panel (s) of the integrals: of tenth order, so that a 20 Hz motion leaves less than rounding.
const NODES: usize = 5;
const PANEL: f64 = 0.01;

impl ImuModel {
    pub(super) fn check(&self) -> Result<()> {
        let rate = self.rate_hz;
        let sane = rate > 0.0 && rate <= 1e5;
        require(sane, "imu.rate_hz", rate, "positive and at most 100000")?;
        let e = &self.errors;
        finite(
            &e.gyro_bias_deg_per_hour,
            "imu.errors.gyro_bias_deg_per_hour",
        )?;
        finite(&e.accel_bias_m_per_s2, "imu.errors.accel_bias_m_per_s2")?;
        finite(&e.gyro_scale_ppm, "imu.errors.gyro_scale_ppm")?;
        finite(&e.accel_scale_ppm, "imu.errors.accel_scale_ppm")?;
        not_negative(&[e.gyro_quantum], "imu.errors.gyro_quantum")?;
        not_negative(&[e.accel_quantum], "imu.errors.accel_quantum")?;
        if let Some(n) = &e.noise {
            not_negative(&[n.gyro_white], "imu.errors.noise.gyro_white")?;
            not_negative(&[n.accel_white], "imu.errors.noise.accel_white")?;
            not_negative(&[n.gyro_bias_sigma], "imu.errors.noise.gyro_bias_sigma")?;
            not_negative(&[n.accel_bias_sigma], "imu.errors.noise.accel_bias_sigma")?;
            positive(n.gyro_bias_tau, "imu.errors.noise.gyro_bias_tau")?;
            positive(n.accel_bias_tau, "imu.errors.noise.accel_bias_tau")?;
        }
        Ok(())
    }
}

/// ∫ω_ib dt and ∫f dt over the `span` that ends at `to` (s after the start), both resolved in the body axes as they turn:
/// rad, m/s.
fn quadrature<const N: usize>(
    trajectory: &Trajectory,
    to: f64,
    span: f64,
    rule: &[(f64, f64); N],
    longest: f64,
) -> (Vector3<f64>, Vector3<f64>) {
    // A rounded-up 0.01 / 0.01 must not make two panels.
    let panels = (span / longest - 1e-6).ceil().max(1.0);
    // From the span itself: the difference of two instants an hour on is known to 1e-10 of a sample interval only.
    let half = 0.5 * span / panels;
    let (mut angle, mut velocity) = (Vector3::zeros(), Vector3::zeros());
    for i in 0..panels as usize {
        let middle = to - half * (2.0 * i as f64 + 1.0);
        for (x, w) in rule {
            let k = trajectory.after(middle + half * x);
            angle += k.angular_rate_b * *w;
            velocity += k.specific_force_b * *w;
        }
    }
    (angle * half, velocity * half)
}

/// The samples of a unit on a trajectory and its biases at every one of them.
///
/// The first stamp is the start. With increments, its interval lies before the start, where the first instant holds.
pub(super) fn simulate(
    model: &ImuModel,
    trajectory: &Trajectory,
    duration: f64,
    seed: u64,
) -> (Vec<Sample>, Vec<ImuErrors>) {
    let mut unit = Unit::new(model, seed);
    let rule = gauss_legendre::<NODES>();
    let count = (duration * model.rate_hz + 1e-6).floor() as usize;
    let mut samples = Vec::with_capacity(count + 1);
    let mut biases = Vec::with_capacity(count + 1);
    let dt = 1.0 / model.rate_hz;
    let mut previous = trajectory.start().plus(-dt);
    for i in 0..=count {
        let time = trajectory.start().plus(i as f64 / model.rate_hz);
        // Stamps are whole nanoseconds: the integrals run between stamps, not between multiples of 1/rate.
        let to = time.since(trajectory.start());
        let span = time.since(previous);
        if i > 0 {
            unit.drift(span);
        }
        samples.push(match model.output {
            ImuOutput::Rates => {
                let k = trajectory.after(to);
                let (w, f) = unit.corrupt(
                    &k.angular_rate_b,
                    &k.specific_force_b,
                    1.0,
                    (1.0 / dt).sqrt(),
                );
                Sample::Imu(ImuSample {
                    time,
                    angular_rate_b: w,
                    specific_force_b: f,
                })
            }
            ImuOutput::Increments => {
                let (angle, velocity) = quadrature(trajectory, to, span, &rule, PANEL);
                let (a, v) = unit.corrupt(&angle, &velocity, span, span.sqrt());
                Sample::ImuIncrement(ImuIncrement {
                    time,
                    angle_b: a,
                    velocity_b: v,
                })
            }
        });
        biases.push(unit.biases());
        previous = time;
    }
    (samples, biases)
}

/// A unit with its random sources.
struct Unit {
    constant: ImuErrors,
    gyro_gain: Vector3<f64>,
    accel_gain: Vector3<f64>,
    noise: Option<Noise>,
    quantum: (f64, f64),
    /// What quantisation of increments has held back: a counting output loses nothing.
    residue: Option<(Vector3<f64>, Vector3<f64>)>,
}

struct Noise {
    gyro_white: (f64, Source),
    accel_white: (f64, Source),
    gyro_bias: GaussMarkov,
    accel_bias: GaussMarkov,
}

impl Unit {
    fn new(model: &ImuModel, seed: u64) -> Self {
        let e = &model.errors;
        let gain = |ppm: [f64; 3]| Vector3::from(ppm).map(|v| 1.0 + v * 1e-6);
        let process = |sigma: f64, tau: f64, stream| {
            GaussMarkov::new(
                Vector3::repeat(sigma),
                Vector3::repeat(sigma),
                tau,
                Source::new(seed, stream),
            )
        };
        Unit {
            constant: e.constant(),
            gyro_gain: gain(e.gyro_scale_ppm),
            accel_gain: gain(e.accel_scale_ppm),
            noise: e.noise.map(|n| Noise {
                gyro_white: (n.gyro_white, Source::new(seed, Stream::GyroWhite)),
                accel_white: (n.accel_white, Source::new(seed, Stream::AccelWhite)),
                gyro_bias: process(n.gyro_bias_sigma, n.gyro_bias_tau, Stream::GyroBias),
                accel_bias: process(n.accel_bias_sigma, n.accel_bias_tau, Stream::AccelBias),
            }),
            quantum: (e.gyro_quantum, e.accel_quantum),
            residue: (model.output == ImuOutput::Increments)
                .then(|| (Vector3::zeros(), Vector3::zeros())),
        }
    }

    fn drift(&mut self, dt: f64) {
        if let Some(n) = &mut self.noise {
            n.gyro_bias.step(dt);
            n.accel_bias.step(dt);
        }
    }

    fn biases(&self) -> ImuErrors {
        let mut errors = self.constant;
        if let Some(n) = &self.noise {
            errors.gyro_bias += n.gyro_bias.value;
            errors.accel_bias += n.accel_bias.value;
        }
        errors
    }

    /// Errors of one sample: biases count `span` times, white noise `white` times its density.
    fn corrupt(
        &mut self,
        angular: &Vector3<f64>,
        force: &Vector3<f64>,
        span: f64,
        white: f64,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let biases = self.biases();
        let mut angular = angular.component_mul(&self.gyro_gain) + biases.gyro_bias * span;
        let mut force = force.component_mul(&self.accel_gain) + biases.accel_bias * span;
        if let Some(n) = &mut self.noise {
            angular += n.gyro_white.1.normal3() * (n.gyro_white.0 * white);
            force += n.accel_white.1.normal3() * (n.accel_white.0 * white);
        }
        let mut none = (Vector3::zeros(), Vector3::zeros());
        let counts = self.residue.is_some();
        let residue = self.residue.as_mut().unwrap_or(&mut none);
        quantise(&mut angular, self.quantum.0, counts, &mut residue.0);
        quantise(&mut force, self.quantum.1, counts, &mut residue.1);
        (angular, force)
    }
}

fn quantise(value: &mut Vector3<f64>, quantum: f64, counts: bool, residue: &mut Vector3<f64>) {
    if quantum > 0.0 {
        let wanted = *value + *residue;
        *value = wanted.map(|v| (v / quantum).round() * quantum);
        if counts {
            *residue = wanted - *value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenario::Scenario;
    use super::*;
    use crate::error::Error;

    fn scenario(duration: f64, output: ImuOutput, errors: ImuErrorModel) -> Scenario {
        let mut scenario = Scenario::standing(duration, 30.0);
        scenario.imu = ImuModel {
            rate_hz: 100.0,
            output,
            errors,
        };
        scenario
    }

    /// (angular, force, biases) of every sample.
    fn run(scenario: &Scenario, seed: u64) -> Vec<(Vector3<f64>, Vector3<f64>, ImuErrors)> {
        let trajectory = Trajectory::new(&scenario.drive).expect("valid");
        let (samples, biases) = simulate(&scenario.imu, &trajectory, scenario.duration_s, seed);
        let numbers = samples.iter().map(|s| match s {
            Sample::Imu(s) => (s.angular_rate_b, s.specific_force_b),
            Sample::ImuIncrement(s) => (s.angle_b, s.velocity_b),
            other => panic!("{other:?}"),
        });
        numbers.zip(biases).map(|((a, f), b)| (a, f, b)).collect()
    }

    fn only(change: impl FnOnce(&mut ImuNoise)) -> ImuErrorModel {
        let mut noise = ImuNoise::from_data_sheet(0.0, 0.0, 0.0, 0.0, 100.0, 100.0);
        change(&mut noise);
        ImuErrorModel::from_noise(noise)
    }

    /// Against Simpson's rule with 400 parts, whose own remainder is rounding for a 2.5 Hz motion.
    #[test]
    fn increments_are_the_integrals_of_the_rates() {
        let trajectory = Trajectory::new(&Scenario::car_drive(300.0).drive).expect("valid");
        let rule = gauss_legendre::<NODES>();
        let mut midpoint_rule = 0.0f64;
        for i in 0..60 {
            for span in [0.005, 0.02, 0.1] {
                let to = 61.0 + 3.9 * f64::from(i);
                let n = 400;
                let (mut angle, mut velocity) = (Vector3::zeros(), Vector3::zeros());
                for j in 0..=n {
                    let k = trajectory.after(to - span * f64::from(n - j) / f64::from(n));
                    let w = if j == 0 || j == n {
                        1.0
                    } else {
                        2.0 + 2.0 * f64::from(j % 2)
                    };
                    angle += k.angular_rate_b * (w * span / (3.0 * f64::from(n)));
                    velocity += k.specific_force_b * (w * span / (3.0 * f64::from(n)));
                }
                let (a, v) = quadrature(&trajectory, to, span, &rule, PANEL);
                // Instants are known to 5e-14 s here, at jerks of some m/s³ and rad/s² each; and rounding of the sums.
                assert!((a - angle).norm() < 1e-15 + 1e-13 * span, "{}", a - angle);
                assert!(
                    (v - velocity).norm() < 1e-14 + 3e-13 * span,
                    "{}",
                    v - velocity
                );
                let (a, v) = quadrature(&trajectory, to, span, &gauss_legendre::<1>(), span);
                midpoint_rule = midpoint_rule.max((a - angle).norm() + (v - velocity).norm());
            }
        }
        // Negative control: the value in the middle times the length.
        assert!(midpoint_rule > 1e-4, "{midpoint_rule}");
    }

    /// Fewer nodes on the same panels: from two to three the error falls to rounding's neighbourhood, four and five agree.
    #[test]
    fn quadrature_converges_with_its_nodes() {
        let trajectory = Trajectory::new(&Scenario::car_drive(300.0).drive).expect("valid");
        fn integral<const N: usize>(trajectory: &Trajectory, to: f64) -> Vector3<f64> {
            quadrature(trajectory, to, 0.1, &gauss_legendre::<N>(), 0.1).1
        }
        let mut errors = [0.0f64; 4];
        for i in 0..100 {
            let to = 61.0 + 2.3 * f64::from(i);
            let exact = quadrature(&trajectory, to, 0.1, &gauss_legendre::<8>(), PANEL).1;
            let found = [
                integral::<1>(&trajectory, to),
                integral::<2>(&trajectory, to),
                integral::<3>(&trajectory, to),
                integral::<4>(&trajectory, to),
            ];
            for (error, v) in errors.iter_mut().zip(found) {
                *error = error.max((v - exact).norm());
            }
        }
        // Each node is two orders of a motion of 2.5 Hz over 0.1 s: (2π · 2.5 · 0.1)² over growing factorials.
        assert!(errors.windows(2).all(|e| e[0] > 50.0 * e[1]), "{errors:?}");
        assert!(errors[3] < 1e-9, "{errors:?}");
    }

    #[test]
    fn an_ideal_unit_says_the_truth() {
        let mut scenario = Scenario::car_drive(120.0);
        scenario.imu = ImuModel {
            rate_hz: 50.0,
            output: ImuOutput::Rates,
            errors: ImuErrorModel::default(),
        };
        let trajectory = Trajectory::new(&scenario.drive).expect("valid");
        for (i, (w, f, biases)) in run(&scenario, 3).into_iter().enumerate() {
            let k = trajectory.at(trajectory.start().plus(i as f64 / 50.0));
            assert_eq!((w, f), (k.angular_rate_b, k.specific_force_b));
            assert_eq!(biases, ImuErrors::default());
        }
    }

    /// Variance density² × rate of rates, density² × interval of increments; within four standard errors.
    #[test]
    fn white_noise_has_its_density() {
        let (gyro, accel) = (2e-3, 5e-2);
        for (output, factor) in [(ImuOutput::Rates, 100.0), (ImuOutput::Increments, 0.01)] {
            let errors = only(|n| (n.gyro_white, n.accel_white) = (gyro, accel));
            let noisy = run(&scenario(500.0, output, errors), 5);
            let clean = run(&scenario(500.0, output, ImuErrorModel::default()), 5);
            let mut square = (Vector3::zeros(), Vector3::zeros());
            let mut lagged = Vector3::zeros();
            let mut before = Vector3::zeros();
            let n = noisy.len() as f64;
            for (a, b) in noisy.iter().zip(&clean) {
                let (w, f) = (a.0 - b.0, a.1 - b.1);
                square.0 += w.component_mul(&w) / n;
                square.1 += f.component_mul(&f) / n;
                lagged += w.component_mul(&before) / n;
                before = w;
            }
            for (found, density) in [(square.0, gyro), (square.1, accel)] {
                let expected = density * density * factor;
                assert!(
                    found.add_scalar(-expected).amax() < 4.0 * expected * (2.0 / n).sqrt(),
                    "{found} {expected}"
                );
            }
            assert!(lagged.amax() < 4.0 * gyro * gyro * factor / n.sqrt());
        }
    }

    /// The bias of many units: its sigma from the first sample on, and after many correlation times.
    #[test]
    fn biases_are_stationary_from_the_start() {
        let errors = only(|n| {
            (n.gyro_bias_sigma, n.gyro_bias_tau) = (1e-4, 2.0);
            (n.accel_bias_sigma, n.accel_bias_tau) = (0.2, 1.0);
        });
        let scenario = scenario(10.0, ImuOutput::Rates, errors);
        let runs = 600;
        let mut ends = [ImuErrors::default(); 2];
        for seed in 0..runs {
            let samples = run(&scenario, seed);
            for (sum, b) in ends
                .iter_mut()
                .zip([samples[0].2, samples[samples.len() - 1].2])
            {
                sum.gyro_bias += b.gyro_bias.component_mul(&b.gyro_bias) / runs as f64;
                sum.accel_bias += b.accel_bias.component_mul(&b.accel_bias) / runs as f64;
            }
        }
        let bound = 4.0 * (2.0 / runs as f64).sqrt();
        for square in ends {
            assert!(
                (square.gyro_bias / 1e-8).add_scalar(-1.0).amax() < bound,
                "{square:?}"
            );
            assert!(
                (square.accel_bias / 0.04).add_scalar(-1.0).amax() < bound,
                "{square:?}"
            );
        }
    }

    #[test]
    fn what_is_measured_is_truth_plus_the_stated_bias() {
        let mut errors = only(|n| n.gyro_bias_sigma = 1e-3);
        errors.gyro_bias_deg_per_hour = [10.0, -20.0, 30.0];
        errors.accel_bias_m_per_s2 = [0.1, 0.2, -0.3];
        for (output, span) in [(ImuOutput::Rates, 1.0), (ImuOutput::Increments, 0.01)] {
            let biased = run(&scenario(2.0, output, errors), 1);
            let clean = run(&scenario(2.0, output, ImuErrorModel::default()), 1);
            for (a, b) in biased.iter().zip(&clean) {
                assert!((a.0 - b.0 - a.2.gyro_bias * span).norm() < 1e-17);
                // Rounding of 9.8 m/s²; the first interval's length comes from stamps, as all others do.
                assert!((a.1 - b.1 - a.2.accel_bias * span).norm() < 4e-15);
            }
            let constant = Vector3::new(10.0f64, -20.0, 30.0).map(f64::to_radians) / 3600.0;
            assert!(
                (biased[0].2.gyro_bias - constant).norm() > 1e-5,
                "the drawn part is there"
            );
        }
    }

    #[test]
    fn scale_factors_stretch_what_is_measured() {
        let errors = ImuErrorModel {
            gyro_scale_ppm: [100.0, 200.0, -300.0],
            accel_scale_ppm: [0.0, 0.0, 1000.0],
            ..ImuErrorModel::default()
        };
        let stretched = run(&scenario(1.0, ImuOutput::Rates, errors), 1)[50];
        let clean = run(
            &scenario(1.0, ImuOutput::Rates, ImuErrorModel::default()),
            1,
        )[50];
        let gain = Vector3::new(1.0001, 1.0002, 0.9997);
        assert!((stretched.0 - clean.0.component_mul(&gain)).norm() < 1e-19);
        assert!((stretched.1.z - clean.1.z * 1.001).abs() < 1e-14);
    }

    #[test]
    fn quantised_rates_are_rounded_and_quantised_increments_lose_nothing() {
        let (qw, qf) = (1e-5, 1e-3);
        let errors = ImuErrorModel {
            gyro_quantum: qw,
            accel_quantum: qf,
            ..ImuErrorModel::default()
        };
        for output in [ImuOutput::Rates, ImuOutput::Increments] {
            let coarse = run(&scenario(20.0, output, errors), 1);
            let clean = run(&scenario(20.0, output, ImuErrorModel::default()), 1);
            let (mut angle, mut force) = (Vector3::zeros(), Vector3::zeros());
            for (a, b) in coarse.iter().zip(&clean) {
                assert!(a.0.iter().all(|v| (v / qw - (v / qw).round()).abs() < 1e-9));
                angle += a.0 - b.0;
                force += a.1 - b.1;
                if output == ImuOutput::Increments {
                    assert!(
                        angle.amax() < 0.51 * qw && force.amax() < 0.51 * qf,
                        "{angle} {force}"
                    );
                }
            }
            // Negative control: the Earth's rate is below the quantum; rounded rates never see it, and their sum runs away.
            if output == ImuOutput::Rates {
                assert!(angle.amax() > 10.0 * qw, "{angle}");
            }
        }
    }

    #[test]
    fn one_error_does_not_change_the_others() {
        let white = only(|n| n.gyro_white = 1e-3);
        let both = only(|n| (n.gyro_white, n.accel_white, n.gyro_bias_sigma) = (1e-3, 1e-2, 1e-3));
        let a = run(&scenario(1.0, ImuOutput::Rates, white), 9);
        let b = run(&scenario(1.0, ImuOutput::Rates, both), 9);
        for (a, b) in a.iter().zip(&b) {
            assert!((a.0 - (b.0 - b.2.gyro_bias)).norm() < 1e-17);
        }
    }

    #[test]
    fn bad_numbers_are_refused_by_name() {
        let mut bad = scenario(1.0, ImuOutput::Rates, ImuErrorModel::default());
        bad.imu.rate_hz = 0.0;
        assert!(matches!(
            bad.simulate(0),
            Err(Error::Config {
                key: "imu.rate_hz",
                ..
            })
        ));
        let mut bad = scenario(1.0, ImuOutput::Rates, only(|n| n.gyro_bias_tau = 0.0));
        assert!(matches!(
            bad.simulate(0),
            Err(Error::Config {
                key: "imu.errors.noise.gyro_bias_tau",
                ..
            })
        ));
        bad.imu.errors = ImuErrorModel {
            accel_quantum: f64::NAN,
            ..ImuErrorModel::default()
        };
        assert!(matches!(
            bad.simulate(0),
            Err(Error::Config {
                key: "imu.errors.accel_quantum",
                ..
            })
        ));
    }
}
