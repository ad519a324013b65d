//! A channel watched by filters with fixed gains: what Q and R its innovations show, if they show any.

use super::{ChannelDesign, LagAccumulator};
use crate::error::Result;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix2, RowVector2, Vector1, Vector2};

/// χ² by degree of freedom above which a block does not show white noise; the same limit as for whole records.
const LARGEST_CHI2_PER_DOF: f64 = 3.0;
/// Standard deviations that the fourth moment of Gaussian innovations, 3 ± √(24/N), may be above three.
const LARGEST_EXCESS: f64 = 6.0;
/// Two blocks show the same noise if their innovation variances differ by less than so many standard errors.
const SAME: f64 = 4.0;
/// q is taken once its standard error is below this share of it ...
const LEAST_KNOWN: f64 = 0.5;
/// ... or once the value held is so many standard errors away.
const CONTRADICTED: f64 = 3.0;

/// White noise of an attitude channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelNoise {
    /// Of the angle, per step, rad².
    pub process: f64,
    /// Of the measured angle, rad².
    pub measured: f64,
}

/// What a block of innovations came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockVerdict {
    /// Its lag covariances look like those of white noise.
    pub accepted: bool,
    /// χ² by degree of freedom, of the filter that fits worst.
    pub chi2_per_dof: f64,
    /// Fourth moment of the innovations of the last filter, 3 of Gaussian ones.
    pub kurtosis: f64,
    /// It showed another noise than the blocks before: they were forgotten.
    pub changed: bool,
    /// Number of the filter whose innovations were whitest.
    pub whitest: usize,
}

/// Innovations of one attitude channel (states angle and gyro bias, see [`ChannelDesign`]) from `B` filters with fixed gains that
/// nothing is ever kept from, and the noise that they show.
///
/// Block by block: the lag covariances of every filter are fitted. A block that fits in all of them is added to those before, or
/// replaces them where the noise has changed; what is believed is q and r of all of them, by the filter whose innovations are
/// whitest: the one nearest to the true gain (\[Mehra70\]). A block that does not fit (motion, coloured noise) is dropped and the last
/// accepted noise held: as process noise, which it looks like, it would make a filter follow what disturbs it. Lag covariances
/// alone are no judge of pushes: a few steps up and down have those of a random walk, and in the filter of the largest gain leave
/// spikes, which are white; but they are peaked, and a block of innovations more peaked than Gaussian ones is believed only where
/// the process noise that it shows is the one found before (vibration that begins). The innovations must be ungated: censored
/// ones pass for white and Gaussian, too. Gains are in ascending order.
///
/// All lags weigh alike, as they do of white innovations. The bias noise is taken as known.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelMonitor<const J: usize, const B: usize> {
    designs: [ChannelDesign<J>; B],
    block: [LagAccumulator<1, J>; B],
    kept: [LagAccumulator<1, J>; B],
    /// Of the last filter in this block: count, sums of squares and of fourth powers.
    moments: [f64; 3],
    bias_noise: f64,
    noise: ChannelNoise,
    /// The process noise has been found, and is not the prior any more.
    found: bool,
    /// Forget accepted blocks where a new one shows another noise.
    follow_changes: bool,
    /// Add blocks that do not fit too.
    trust_all: bool,
    blocks: u32,
    accepted: u32,
}

/// What speaks for a block and against it.
struct Test {
    chi2_per_dof: f64,
    kurtosis: f64,
    peaked: bool,
    /// The process noise that it shows is the one that was found before.
    process_agrees: bool,
    whitest: usize,
}

impl Test {
    fn fits(&self) -> bool {
        // Peaked is also what begins or ends to vibrate; that is white, and process noise it does not look like.
        self.chi2_per_dof < LARGEST_CHI2_PER_DOF && (!self.peaked || self.process_agrees)
    }
}

/// What the lag covariances of one filter come to.
struct Fit {
    noise: ChannelNoise,
    process_sigma: f64,
    chi2_per_dof: f64,
}

impl<const J: usize, const B: usize> ChannelMonitor<J, B> {
    /// Filters with the transition `f` and the gains `gains`, which correct the predicted state. `prior` is believed until a block
    /// is accepted; `bias_noise` is the known noise of the bias, (rad/s)² per step.
    ///
    /// # Errors
    /// [`crate::error::Error::NotObservable`] when a loop is not stable.
    pub fn new(
        f: &Matrix2<f64>,
        gains: &[Vector2<f64>; B],
        bias_noise: f64,
        prior: ChannelNoise,
    ) -> Result<Self> {
        const { assert!(B > 0 && J >= 4, "no filter, or fewer lags than unknowns") };
        let h = RowVector2::new(1.0, 0.0);
        let first = ChannelDesign::new(f, &h, &gains[0])?;
        let mut designs = core::array::from_fn(|_| first.clone());
        for (design, gain) in designs.iter_mut().zip(gains).skip(1) {
            *design = ChannelDesign::new(f, &h, gain)?;
        }
        Ok(ChannelMonitor {
            designs,
            block: core::array::from_fn(|_| LagAccumulator::new()),
            kept: core::array::from_fn(|_| LagAccumulator::new()),
            moments: [0.0; 3],
            bias_noise,
            noise: prior,
            found: false,
            follow_changes: true,
            trust_all: false,
            blocks: 0,
            accepted: 0,
        })
    }

    /// One that believes every block and forgets none: what is lost without the test of fit.
    pub fn trusting(mut self) -> Self {
        self.trust_all = true;
        self.follow_changes = false;
        self
    }

    /// Take the innovations of all filters at one instant, rad. One that is not finite ends the run of its filter.
    pub fn push(&mut self, innovations: &[f64; B]) {
        for (lags, nu) in self.block.iter_mut().zip(innovations) {
            lags.push(&Vector1::new(*nu));
        }
        let square = innovations[B - 1] * innovations[B - 1];
        if square.is_finite() {
            let moments = [1.0, square, square * square];
            (0..3).for_each(|i| self.moments[i] += moments[i]);
        }
    }

    /// The noise that is believed now.
    pub fn noise(&self) -> ChannelNoise {
        self.noise
    }

    /// Blocks that were accepted, and all.
    pub fn counts(&self) -> [u32; 2] {
        [self.accepted, self.blocks]
    }

    /// χ² by degree of freedom, fourth moment and whitest filter of the block; `None` with too few products in it.
    fn test(&self) -> Option<Test> {
        // Two samples for each lag at least.
        if self.block[0].count(J - 1) < 2.0 * J as f64 {
            return None;
        }
        let whitest = whitest(&self.block);
        let mut worst = 0.0f64;
        let mut process_agrees = true;
        for filter in 0..B {
            let fit = self.fit(filter, &self.block[filter])?;
            // NaN is the worst there is.
            worst = if fit.chi2_per_dof <= worst {
                worst
            } else {
                fit.chi2_per_dof
            };
            if filter == whitest {
                let apart = (fit.noise.process - self.noise.process).abs();
                process_agrees = self.found && apart <= CONTRADICTED * fit.process_sigma;
            }
        }
        let [count, squares, fourths] = self.moments;
        let kurtosis = fourths * count / (squares * squares);
        Some(Test {
            chi2_per_dof: worst,
            kurtosis,
            peaked: kurtosis > 3.0 + LARGEST_EXCESS * (24.0 / count).sqrt(),
            process_agrees,
            whitest,
        })
    }

    /// End a block: test it, and believe it or hold what was believed. Channels that a disturbance reaches together are to be
    /// judged together: `others_fit` is what [`block_fits`](Self::block_fits) said of the others. `None` of a block too short to tell.
    pub fn end_block(&mut self, others_fit: bool) -> Option<BlockVerdict> {
        let verdict = self.test().map(|test| {
            let accepted = test.fits() && others_fit;
            self.blocks += 1;
            self.accepted += u32::from(accepted);
            let believed = accepted || self.trust_all;
            let changed = believed && self.follow_changes && self.differs(test.whitest);
            if believed {
                self.keep(changed);
            }
            BlockVerdict {
                accepted,
                chi2_per_dof: test.chi2_per_dof,
                kurtosis: test.kurtosis,
                changed,
                whitest: test.whitest,
            }
        });
        self.block = core::array::from_fn(|_| LagAccumulator::new());
        self.moments = [0.0; 3];
        verdict
    }

    /// Whether the block by itself would be accepted; `true` where it is too short to tell.
    pub fn block_fits(&self) -> bool {
        self.test().is_none_or(|test| test.fits())
    }

    /// Whether the innovations of the block have another variance than those of the blocks before.
    fn differs(&self, whitest: usize) -> bool {
        let (new, old) = (&self.block[whitest], &self.kept[whitest]);
        if old.count(0) < 1.0 {
            return false;
        }
        let scatter = (2.0 / new.count(0) + 2.0 / old.count(0)).sqrt();
        let ratio = new.covariance(0)[0] / old.covariance(0)[0];
        // NaN is another noise.
        let same = ratio.ln().abs() <= SAME * scatter;
        !same
    }

    /// Add the block, and believe what all of them show.
    fn keep(&mut self, forget: bool) {
        for (kept, block) in self.kept.iter_mut().zip(&self.block) {
            if forget {
                *kept = block.clone();
            } else {
                kept.merge(block);
            }
        }
        let whitest = whitest(&self.kept);
        let Some(fit) = self.fit(whitest, &self.kept[whitest]) else {
            return;
        };
        if !(self.trust_all || fit.chi2_per_dof < LARGEST_CHI2_PER_DOF) {
            return;
        }
        self.noise.measured = fit.noise.measured;
        let known = fit.process_sigma <= LEAST_KNOWN * fit.noise.process;
        let contradicted =
            (fit.noise.process - self.noise.process).abs() > CONTRADICTED * fit.process_sigma;
        if known || contradicted {
            // A variance of zero would be believed for ever.
            self.found = true;
            self.noise.process = fit.noise.process.max(LEAST_KNOWN * fit.process_sigma);
        }
    }

    fn fit(&self, filter: usize, lags: &LagAccumulator<1, J>) -> Option<Fit> {
        let design = &self.designs[filter];
        let covariances = core::array::from_fn(|j| lags.covariance(j)[0]);
        let theta = design
            .solve(&covariances, [None, Some(self.bias_noise), None])
            .ok()?;
        let model = design.covariances(theta);
        // Bartlett's formula; of the correlations between lags, which leave the mean of χ² as it is, nothing is made.
        let at = |lag: usize| model.get(lag).copied().unwrap_or(0.0);
        let product = |shift: usize| -> f64 {
            let later: f64 = (0..J).map(|t| at(t) * at(t + shift)).sum();
            let earlier: f64 = (1..J).map(|t| at(t) * at(shift.abs_diff(t))).sum();
            later + earlier
        };
        let at_once = product(0);
        let variances: [f64; J] =
            core::array::from_fn(|j| (at_once + product(2 * j)) / lags.count(j));
        let variance = |j: usize| variances[j];
        let chi2: f64 = (0..J)
            .map(|j| (covariances[j] - model[j]).powi(2) / variance(j))
            .sum();
        let columns = design.columns();
        let sum = |a: usize, b: usize| -> f64 {
            (0..J)
                .map(|j| columns[a][j] * columns[b][j] / variance(j))
                .sum()
        };
        let (qq, qr, rr) = (sum(0, 0), sum(0, 2), sum(2, 2));
        Some(Fit {
            noise: ChannelNoise {
                process: theta[0],
                measured: theta[2],
            },
            process_sigma: (rr / (qq * rr - qr * qr)).sqrt(),
            chi2_per_dof: chi2 / (J - 2) as f64,
        })
    }
}

/// The filter whose innovations are least correlated.
fn whitest<const J: usize, const B: usize>(lags: &[LagAccumulator<1, J>; B]) -> usize {
    let colour = |lags: &LagAccumulator<1, J>| -> f64 {
        (1..J)
            .map(|j| lags.covariance(j)[0].powi(2) * lags.count(j))
            .sum::<f64>()
            / lags.covariance(0)[0].powi(2).max(f64::MIN_POSITIVE)
    };
    (0..B)
        .min_by(|a, b| colour(&lags[*a]).total_cmp(&colour(&lags[*b])))
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Source, Stream};

    const STEP: f64 = 0.032;
    const TRUE: ChannelNoise = ChannelNoise {
        process: 0.04,
        measured: 4.0,
    };
    const BIAS_NOISE: f64 = 1e-3;

    /// Stationary gain of q = `factor` times the true one, by iteration.
    fn gain(factor: f64) -> Vector2<f64> {
        let f = Matrix2::new(1.0, -STEP, 0.0, 1.0);
        let mut p = Matrix2::identity();
        let mut gain = Vector2::zeros();
        for _ in 0..20_000 {
            gain = p.column(0) / (p.m11 + TRUE.measured);
            let updated = p - gain * p.row(0);
            p = f * updated * f.transpose()
                + Matrix2::new(TRUE.process * factor, 0.0, 0.0, BIAS_NOISE);
        }
        gain
    }

    struct Channel {
        gains: [Vector2<f64>; 3],
        states: [Vector2<f64>; 3],
        truth: Vector2<f64>,
        source: Source,
        monitor: ChannelMonitor<20, 3>,
    }

    impl Channel {
        fn new(seed: u64, prior: ChannelNoise) -> Self {
            let f = Matrix2::new(1.0, -STEP, 0.0, 1.0);
            let gains = [0.01, 1.0, 100.0].map(gain);
            Channel {
                gains,
                states: [Vector2::zeros(); 3],
                truth: Vector2::zeros(),
                source: Source::new(seed, Stream::Initial),
                monitor: ChannelMonitor::new(&f, &gains, BIAS_NOISE, prior).expect("stable"),
            }
        }

        /// `scale` of the measurement's noise, `offset` of what is measured.
        fn run(&mut self, samples: usize, scale: f64, offset: impl Fn(usize) -> f64) {
            let f = Matrix2::new(1.0, -STEP, 0.0, 1.0);
            for k in 0..samples {
                let [w, b, v] = [(); 3].map(|()| self.source.normal());
                self.truth =
                    f * self.truth + Vector2::new(w * TRUE.process.sqrt(), b * BIAS_NOISE.sqrt());
                let y = self.truth.x + v * scale * TRUE.measured.sqrt() + offset(k);
                let mut innovations = [0.0; 3];
                let states = self.states.iter_mut().zip(&self.gains);
                for (nu, (state, gain)) in innovations.iter_mut().zip(states) {
                    *state = f * *state;
                    *nu = y - state.x;
                    *state += gain * *nu;
                }
                self.monitor.push(&innovations);
            }
        }

        fn blocks(&mut self, count: usize, scale: f64) -> BlockVerdict {
            let mut last = None;
            for _ in 0..count {
                self.run(400, scale, |_| 0.0);
                last = self.monitor.end_block(true);
            }
            last.expect("a whole block")
        }
    }

    #[test]
    fn noise_is_found_from_a_prior_that_is_wrong_by_a_hundred() {
        for factors in [[100.0, 1.0], [0.01, 1.0], [1.0, 100.0], [1.0, 0.01]] {
            let prior = ChannelNoise {
                process: TRUE.process * factors[0],
                measured: TRUE.measured * factors[1],
            };
            let mut channel = Channel::new(3, prior);
            let last = channel.blocks(40, 1.0);
            assert!(last.accepted && last.whitest == 1, "{last:?}");
            let found = channel.monitor.noise();
            // 16 000 samples: standard deviations of 11 % and 1.2 %, three of them.
            assert!(
                (found.process / TRUE.process - 1.0).abs() < 0.33,
                "{found:?}"
            );
            assert!(
                (found.measured / TRUE.measured - 1.0).abs() < 0.036,
                "{found:?}"
            );
            let [accepted, all] = channel.monitor.counts();
            assert!(all == 40 && accepted >= 39, "{accepted}");
        }
    }

    #[test]
    fn coloured_blocks_are_dropped_and_the_noise_held() {
        let mut channel = Channel::new(4, TRUE);
        channel.blocks(10, 1.0);
        let before = channel.monitor.noise();
        // A push of fifteen sigmas for two seconds.
        channel.run(
            400,
            1.0,
            |k| if (100..160).contains(&k) { 30.0 } else { 0.0 },
        );
        let mut trusting = channel.monitor.clone().trusting();
        let verdict = channel.monitor.end_block(true).expect("a whole block");
        assert!(!verdict.accepted && verdict.kurtosis > 10.0, "{verdict:?}");
        assert_eq!(channel.monitor.noise(), before);
        // Negative control: believed, the push is process noise.
        trusting.end_block(true);
        assert!(trusting.noise().process > 5.0 * before.process);
        // Nor is a block taken where another channel's did not fit.
        channel.run(400, 1.0, |_| 0.0);
        assert!(channel.monitor.block_fits());
        assert!(!channel.monitor.end_block(false).expect("a block").accepted);
        assert_eq!(channel.monitor.noise(), before);
    }

    #[test]
    fn a_change_of_the_noise_is_followed_within_three_blocks() {
        let mut channel = Channel::new(5, TRUE);
        channel.blocks(20, 1.0);
        for scale in [5.0, 1.0] {
            channel.run(150, 1.0, |_| 0.0);
            channel.blocks(3, scale);
            let ratio = channel.monitor.noise().measured / (TRUE.measured * scale * scale);
            // Of 800 samples: 5 %, four of them.
            assert!((ratio - 1.0).abs() < 0.25, "{scale} {ratio}");
        }
    }

    #[test]
    fn a_block_too_short_says_nothing() {
        let mut channel = Channel::new(6, TRUE);
        channel.run(30, 1.0, |_| 0.0);
        assert!(channel.monitor.block_fits());
        assert_eq!(channel.monitor.end_block(true), None);
        assert_eq!(channel.monitor.counts(), [0, 0]);
        channel.monitor.push(&[f64::NAN; 3]);
        assert_eq!(channel.monitor.end_block(true), None);
        assert_eq!(channel.monitor.noise(), TRUE);
    }
}
