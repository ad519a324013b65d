//! Random sources: each an argument, each with its own stream.

use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use rand_pcg::Pcg64Mcg;

/// What a random source is for. Each has its own sequence, so that switching one error on or off leaves all others as
/// they were.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Stream {
    /// White noise of the gyros.
    GyroWhite = 1,
    /// White noise of the accelerometers.
    AccelWhite = 2,
    /// Drift of the gyro bias.
    GyroBias = 3,
    /// Drift of the accelerometer bias.
    AccelBias = 4,
    /// White error of GNSS positions.
    PositionWhite = 5,
    /// Coloured error of GNSS positions.
    PositionColour = 6,
    /// White error of GNSS velocities.
    VelocityWhite = 7,
    /// Outliers among the fixes.
    Outliers = 8,
    /// Course of a generated drive.
    Route = 9,
    /// Errors that a test adds by itself, such as the error of an initial state.
    Initial = 10,
    /// Coloured error of GNSS velocities.
    VelocityColour = 11,
    /// White noise of a magnetometer.
    FieldWhite = 12,
}

/// A sequence of random numbers that depends on a seed and a [`Stream`] only.
///
/// PCG-64-MCG behind a hash of both, normal numbers by the ziggurat: the same on every platform.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    generator: Pcg64Mcg,
}

impl Source {
    /// The source of a seed for one purpose.
    pub fn new(seed: u64, stream: Stream) -> Self {
        // Neighbouring seeds must not give neighbouring generator states: SplitMix64's output function spreads them.
        let high = spread(seed ^ spread(stream as u64));
        let low = spread(high ^ 0x9e37_79b9_7f4a_7c15);
        Source {
            generator: Pcg64Mcg::new((u128::from(high) << 64) | u128::from(low)),
        }
    }

    /// A number from the standard normal distribution.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.generator)
    }

    /// Three independent numbers from the standard normal distribution.
    pub fn normal3(&mut self) -> Vector3<f64> {
        // Written out, since the order of evaluation is part of the reproducible sequence.
        let x = self.normal();
        let y = self.normal();
        let z = self.normal();
        Vector3::new(x, y, z)
    }

    /// A number from the uniform distribution on [0, 1).
    pub fn uniform(&mut self) -> f64 {
        StandardUniform.sample(&mut self.generator)
    }

    /// A number from the uniform distribution between two bounds.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }
}

/// Output function of SplitMix64 (\[Steele14\]), increment included.
fn spread(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// A first-order Gauss–Markov process of three independent components: ẋ = −x/τ + noise, steady sigma σ.
///
/// Stepped exactly: x(t + dt) = φ x(t) + σ √(1 − φ²) n, φ = exp(−dt/τ), so that its statistics do not
/// depend on the steps.
#[derive(Clone, Debug, PartialEq)]
pub struct GaussMarkov {
    /// The value now.
    pub value: Vector3<f64>,
    sigma: Vector3<f64>,
    tau: f64,
    source: Source,
}

impl GaussMarkov {
    /// A process of steady sigma `sigma` and correlation time `tau` (s), whose first value has the sigma `initial_sigma`.
    pub fn new(
        sigma: Vector3<f64>,
        initial_sigma: Vector3<f64>,
        tau: f64,
        mut source: Source,
    ) -> Self {
        let value = source.normal3().component_mul(&initial_sigma);
        GaussMarkov {
            value,
            sigma,
            tau,
            source,
        }
    }

    /// Move on by `dt` seconds.
    pub fn step(&mut self, dt: f64) {
        // exp_m1 keeps the driving noise of short steps, where 1 − φ² would cancel.
        let decay = (-dt / self.tau).exp();
        let drive = (-(-2.0 * dt / self.tau).exp_m1()).sqrt();
        self.value = self.value * decay + self.source.normal3().component_mul(&self.sigma) * drive;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 200_000;

    #[test]
    fn sources_repeat_with_their_seed_and_differ_otherwise() {
        let draw = |seed, stream| {
            let mut s = Source::new(seed, stream);
            [s.normal(), s.normal(), s.uniform()]
        };
        assert_eq!(draw(7, Stream::GyroWhite), draw(7, Stream::GyroWhite));
        assert_ne!(draw(7, Stream::GyroWhite), draw(8, Stream::GyroWhite));
        assert_ne!(draw(7, Stream::GyroWhite), draw(7, Stream::AccelWhite));
    }

    /// Mean, variance, fourth moment and lagged products within four standard errors of their expectation (each a
    /// probability of 6e-5; the seed is fixed).
    #[test]
    fn normal_numbers_are_standard_and_white() {
        let mut source = Source::new(42, Stream::GyroWhite);
        let x: Vec<f64> = (0..N).map(|_| source.normal()).collect();
        let n = N as f64;
        let moment = |k: i32| x.iter().map(|v| v.powi(k)).sum::<f64>() / n;
        let bound = 4.0 / n.sqrt();
        assert!(moment(1).abs() < bound);
        assert!((moment(2) - 1.0).abs() < bound * 2f64.sqrt());
        assert!(moment(3).abs() < bound * 15f64.sqrt());
        assert!((moment(4) - 3.0).abs() < bound * 96f64.sqrt());
        for lag in [1, 2, 3, 10, 200] {
            let r = x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f64>() / n;
            assert!(r.abs() < bound, "lag {lag}: {r}");
        }
    }

    #[test]
    fn neighbouring_seeds_and_streams_are_uncorrelated() {
        let draw = |seed, stream| {
            let mut s = Source::new(seed, stream);
            (0..N).map(|_| s.normal()).collect::<Vec<_>>()
        };
        let a = draw(1, Stream::GyroWhite);
        for b in [
            draw(2, Stream::GyroWhite),
            draw(1, Stream::AccelWhite),
            draw(3, Stream::AccelWhite),
        ] {
            let r = a.iter().zip(&b).map(|(x, y)| x * y).sum::<f64>() / N as f64;
            assert!(r.abs() < 4.0 / (N as f64).sqrt(), "{r}");
        }
    }

    #[test]
    fn uniform_numbers_fill_the_unit_interval() {
        let mut source = Source::new(42, Stream::Route);
        let x: Vec<f64> = (0..N).map(|_| source.uniform()).collect();
        assert!(x.iter().all(|v| (0.0..1.0).contains(v)));
        let mean = x.iter().sum::<f64>() / N as f64;
        let square = x.iter().map(|v| v * v).sum::<f64>() / N as f64;
        // Variances of u and u²: 1/12 and 4/45.
        assert!((mean - 0.5).abs() < 4.0 * (1.0 / 12.0 / N as f64).sqrt());
        assert!((square - 1.0 / 3.0).abs() < 4.0 * (4.0 / 45.0 / N as f64).sqrt());
        for _ in 0..1000 {
            assert!((-3.0..5.0).contains(&source.between(-3.0, 5.0)));
        }
    }

    /// Variance and autocorrelation of one long path: E[x(t) x(t+k dt)] = σ² φᵏ. The standard error of such a mean over
    /// n correlated values is σ² √((1 + φ²)/(1 − φ²)/n) times at most √2 (Bartlett's formula).
    #[test]
    fn gauss_markov_has_its_variance_and_autocorrelation() {
        let (sigma, tau, dt) = (0.3, 5.0, 0.5);
        let s = Vector3::repeat(sigma);
        let mut process = GaussMarkov::new(s, s, tau, Source::new(11, Stream::GyroBias));
        let x: Vec<Vector3<f64>> = (0..N)
            .map(|_| {
                process.step(dt);
                process.value
            })
            .collect();
        let phi = (-dt / tau).exp();
        let error =
            4.0 * sigma * sigma * (2.0 * (1.0 + phi * phi) / (1.0 - phi * phi) / N as f64).sqrt();
        for lag in [0, 1, 5, 10, 30] {
            let mut r = Vector3::zeros();
            for (a, b) in x.iter().zip(&x[lag..]) {
                r += a.component_mul(b) / N as f64;
            }
            let expected = sigma * sigma * phi.powi(lag as i32);
            assert!(
                (r - Vector3::repeat(expected)).amax() < error,
                "lag {lag}: {r} {expected}"
            );
        }
        // Components are independent.
        let cross = x.iter().map(|v| v.x * v.y).sum::<f64>() / N as f64;
        assert!(cross.abs() < error);
    }

    #[test]
    fn gauss_markov_statistics_do_not_depend_on_the_step() {
        // Over 4 s from a known value: mean φ x₀, variance σ²(1 − φ²), in one step or in 40.
        let (sigma, tau, runs) = (2.0, 3.0, 20_000);
        for steps in [1, 40] {
            let mut sum = 0.0;
            let mut square = 0.0;
            for seed in 0..runs {
                let source = Source::new(seed, Stream::AccelBias);
                let mut process =
                    GaussMarkov::new(Vector3::repeat(sigma), Vector3::zeros(), tau, source);
                process.value = Vector3::repeat(5.0);
                for _ in 0..steps {
                    process.step(4.0 / f64::from(steps));
                }
                sum += process.value.x;
                square += process.value.x * process.value.x;
            }
            let n = runs as f64;
            let phi = (-4.0f64 / tau).exp();
            let variance = sigma * sigma * (1.0 - phi * phi);
            let mean = sum / n;
            assert!(
                (mean - 5.0 * phi).abs() < 4.0 * (variance / n).sqrt(),
                "{mean}"
            );
            let found = square / n - mean * mean;
            assert!(
                (found - variance).abs() < 4.0 * variance * (2.0 / n).sqrt(),
                "{found} {variance}"
            );
        }
    }
}
