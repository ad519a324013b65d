//! What the inertial data alone say: the chosen test over the long window, and a short one that sees a start.

use super::composite;
use super::low_pass::LowPass;
use super::quantile::{ONE_IN_1E3, ONE_IN_1E4, ONE_IN_1E6};
use super::quantised::{GyroSteps, Rounding};
use super::rest_noise::RestNoise;
use super::rocking_level::RockingLevel;
use super::tone::ToneWindow;
use super::window::{Moments, PARTS, Window};
use super::{Belief, are, glrt, mag, mv};
use crate::config::DetectorKind;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// The window that sees a start, s: shorter, and 5 Hz leave nothing to average; longer, and it sees it later.
const SHORT: f64 = 0.2;
/// A window shorter than this needs no shorter one beside it, s.
const LEAST_LONG: f64 = 0.5;
/// Intervals whose mean gives the sampling rate that the low-pass is designed for.
const FIRST_INTERVALS: u32 = 20;
/// Of the running mean of intervals.
const RATE_MEMORY: f64 = 1.0 / 256.0;
/// The slow mean of the rate remembers so much, s.
const SLOW: f64 = 6.0;
/// Beyond so much of its threshold a mean rate is a turn and no rocking, a ratio of squares: 0.28 °/s on a good unit, as much as a
/// slow swing of 0.2 °/s on each axis leaves in a window.
const TURNS: f64 = 50.0;
/// A sampling rate that differs by more calls for another low-pass.
const RATE_CHANGE: f64 = 0.1;

/// Statistics over their thresholds; NaN where a detector has none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ratios {
    pub(super) specific_force: f64,
    pub(super) angular_rate: f64,
    pub(super) mean_rate: f64,
    /// The same of the window alone with no room for rocking, where that has one.
    pub(super) turn: f64,
    /// LPMV and LPGV themselves, for learning; NaN for other detectors.
    pub(super) variances: [f64; 2],
    /// Length of the window, s.
    pub(super) span: f64,
}

impl Ratios {
    pub(super) fn largest(&self) -> f64 {
        [self.specific_force, self.angular_rate, self.mean_rate]
            .into_iter()
            .fold(0.0, f64::max)
    }

    /// Whether it turns beyond what rocking makes of a window's mean rate.
    pub(super) fn turns(&self) -> bool {
        self.turn > TURNS
    }
}

/// What became of a sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Moved {
    pub(super) long: bool,
    pub(super) short: bool,
    /// All windows are empty again.
    pub(super) anew: bool,
}

/// Mean rate over a longer time than the window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct SlowMean {
    mean: Vector3<f64>,
    /// Time that it is over, s, at most [`SLOW`]: beyond, the oldest fades, which leaves no more noise than a mean over this.
    span: f64,
}

impl SlowMean {
    fn push(&mut self, part: &Moments) {
        self.span = (self.span + part.span).min(SLOW);
        self.mean += (part.mean_rate() - self.mean) * (part.span / self.span).min(1.0);
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct InertialTests {
    kind: DetectorKind,
    scale: f64,
    noise: RestNoise,
    length: f64,
    dt: f64,
    intervals: u32,
    low_pass: Option<LowPass>,
    long: Window,
    tone: ToneWindow,
    short: Option<Window>,
    steps: GyroSteps,
    slow: SlowMean,
    /// What stands may rock as wheeled vehicles do; then how much it has rocked of late.
    on_wheels: bool,
    rocked: RockingLevel,
    /// How far LPMV and LPGV of the present stop are above those of the noise, at least 1.
    level: [f64; 2],
}

impl InertialTests {
    pub(super) fn new(kind: DetectorKind, length: f64, scale: f64, noise: RestNoise) -> Self {
        InertialTests {
            kind,
            scale,
            noise,
            length,
            dt: 0.0,
            intervals: 0,
            low_pass: None,
            long: Window::new(length),
            tone: ToneWindow::default(),
            short: (length >= LEAST_LONG).then(|| Window::new(SHORT)),
            steps: GyroSteps::new(noise.gyro_bias),
            slow: SlowMean::default(),
            on_wheels: false,
            rocked: RockingLevel::default(),
            level: [1.0; 2],
        }
    }

    /// It is a vehicle on wheels of which nobody measures the speed: what it shows at rest decides, not what the unit's noise is.
    pub(super) fn be_on_wheels(&mut self) {
        self.on_wheels = self.kind == DetectorKind::Composite;
    }

    pub(super) fn clear(&mut self) {
        self.forget_mean();
        self.long.clear();
        self.tone.clear();
        if let Some(short) = &mut self.short {
            short.clear();
        }
        if let Some(low_pass) = &mut self.low_pass {
            low_pass.reset();
        }
    }

    /// The body moves: what came before says nothing about a bias.
    pub(super) fn forget_mean(&mut self) {
        self.slow = SlowMean::default();
    }

    pub(super) fn rounding(&self) -> Rounding {
        self.steps.rounding()
    }

    /// Where nothing is tested, the gyros' steps are still looked for.
    pub(super) fn watch(&mut self, dt: f64, rate: &Vector3<f64>) {
        self.steps.push(dt, rate);
    }

    /// Take a sample that comes `dt` after the one before it.
    pub(super) fn push(&mut self, dt: f64, force: &Vector3<f64>, rate: &Vector3<f64>) -> Moved {
        self.steps.push(dt, rate);
        let mut moved = Moved::default();
        if self.intervals < FIRST_INTERVALS {
            self.intervals += 1;
            self.dt += (dt - self.dt) / f64::from(self.intervals);
            return moved;
        }
        self.dt += (dt - self.dt) * RATE_MEMORY;
        let (mut force, mut rate) = (*force, *rate);
        if self.kind == DetectorKind::Composite {
            let fits = |l: &LowPass| (l.rate() * self.dt - 1.0).abs() < RATE_CHANGE;
            let low_pass = match &mut self.low_pass {
                Some(low_pass) if fits(low_pass) => low_pass,
                other => {
                    moved.anew = other.is_some();
                    self.long.clear();
                    self.tone.clear();
                    if let Some(short) = &mut self.short {
                        short.clear();
                    }
                    self.slow = SlowMean::default();
                    other.insert(LowPass::new(1.0 / self.dt))
                }
            };
            let x = Vector6::new(force.x, force.y, force.z, rate.x, rate.y, rate.z);
            let y = low_pass.push(&x);
            if !low_pass.has_settled() {
                return moved;
            }
            force = y.fixed_rows::<3>(0).into_owned();
            rate = y.fixed_rows::<3>(3).into_owned();
        }
        let one = Moments::of(dt, &force, &rate);
        moved.long = self.long.push(&one);
        if self.kind == DetectorKind::Composite {
            self.tone.push(&force, &rate);
            if moved.long {
                self.tone.close(self.long.parts());
            }
        }
        if moved.long
            && let Some(part) = self.long.newest()
        {
            self.slow.push(part);
        }
        moved.short = self.short.as_mut().is_some_and(|short| short.push(&one));
        moved
    }

    /// The fixed threshold of LPMV and LPGV; infinite before the low-pass is known.
    pub(super) fn fixed(&self) -> f64 {
        self.low_pass.as_ref().map_or(f64::INFINITY, |low_pass| {
            composite::variance_threshold(self.length, low_pass, ONE_IN_1E4) * self.scale
        })
    }

    /// Thresholds of LPMV and LPGV, at least those of a body that rocks with the people in it.
    pub(super) fn rocking(&self, thresholds: [f64; 2]) -> [f64; 2] {
        let rocks = self.low_pass.as_ref().map_or([0.0; 2], |low_pass| {
            composite::rocking(&self.noise, low_pass)
        });
        [thresholds[0].max(rocks[0]), thresholds[1].max(rocks[1])]
    }

    /// Thresholds of LPMV and LPGV of a vehicle on wheels that rocks at its stop, at least: once it has stood for a while, what it has
    /// shown.
    pub(super) fn rocking_on_wheels(&self, thresholds: [f64; 2]) -> [f64; 2] {
        let [force, rate] = self.leave();
        [thresholds[0].max(force), thresholds[1].max(rate)]
    }

    /// Whether it shakes no more than such a vehicle at its stop, and does not turn.
    pub(super) fn may_rock(&self, ratios: &Ratios) -> bool {
        let [force, rate] = self.leave();
        self.on_wheels
            && ratios.variances[0] < force
            && ratios.variances[1] < rate
            && !ratios.turns()
    }

    /// LPMV and LPGV that a wheeled vehicle may show; zero where that does not count.
    fn leave(&self) -> [f64; 2] {
        let Some(low_pass) = self.low_pass.as_ref().filter(|_| self.on_wheels) else {
            return [0.0; 2];
        };
        let most =
            composite::standing_on_wheels(&self.noise, low_pass).map(|leave| leave * self.scale);
        match self.rocked.bound() {
            Some(bound) => [most[0].min(bound[0]), most[1].min(bound[1])],
            None => most,
        }
    }

    /// A window of a body that stands, or may.
    pub(super) fn rock(&mut self, ratios: &Ratios) {
        if self.on_wheels {
            self.rocked.observe(ratios.span / PARTS, ratios.variances);
        }
    }

    /// What was seen of it was motion.
    pub(super) fn forget_rocking(&mut self) {
        self.rocked.clear();
    }

    /// Whether a body that is taken to stand has of late shaken more than its unit's noise explains.
    pub(super) fn rocks(&self) -> bool {
        let fixed = self.fixed();
        self.on_wheels && self.rocked.most().iter().any(|v| *v >= fixed)
    }

    /// The test over the long window, once it is full. `thresholds` are those of LPMV and LPGV; the window's mean rate has
    /// `rocking` times the room, the slow one has not: what rocks comes back, what turns does not.
    pub(super) fn long(
        &self,
        belief: &Belief,
        thresholds: [f64; 2],
        rocking: f64,
    ) -> Option<Ratios> {
        let m = self.long.moments()?;
        let mut ratios = Ratios {
            specific_force: f64::NAN,
            angular_rate: f64::NAN,
            mean_rate: f64::NAN,
            turn: f64::NAN,
            variances: [f64::NAN; 2],
            span: m.span,
        };
        if self.kind == DetectorKind::Composite {
            let low_pass = self.low_pass.as_ref()?;
            ratios.variances = composite::variances(&m, None, &self.noise, low_pass);
            ratios.specific_force = ratios.variances[0] / thresholds[0];
            ratios.angular_rate = ratios.variances[1] / thresholds[1];
            let rounding = self.rounding().sigma;
            // What swings within an angle leaves in a mean what falls with its length.
            let rocks = if self.on_wheels {
                let fixed = self.fixed();
                composite::rate_of_rocking(ratios.variances[1], fixed, &self.noise, low_pass)
            } else {
                0.0
            };
            let of = |mean: &Vector3<f64>, span: f64, rocks: f64| {
                let statistic = composite::mean_rate(
                    mean,
                    span,
                    &belief.rate_b,
                    &belief.rate_covariance_b,
                    &rounding,
                    rocks,
                    &self.noise,
                );
                statistic / (composite::mean_rate_threshold() * self.scale)
            };
            let mean = m.mean_rate();
            ratios.mean_rate = of(&mean, m.span, rocks) / rocking;
            if self.slow.span > m.span {
                let rocks = rocks * (m.span / self.slow.span).powi(2);
                let slow = of(&self.slow.mean, self.slow.span, rocks);
                ratios.mean_rate = ratios.mean_rate.max(slow);
            }
            if self.on_wheels {
                ratios.turn = of(&mean, m.span, 0.0);
            }
        } else {
            let [force, rate] = self.single(&m, belief, ONE_IN_1E3);
            (ratios.specific_force, ratios.angular_rate) = (force, rate);
        }
        Some(ratios)
    }

    /// LPMV and LPGV of the long window without the tone that explains most of it; infinite where there is no such thing.
    pub(super) fn without_tone(&self) -> [f64; 2] {
        let left = self
            .low_pass
            .as_ref()
            .and_then(|low_pass| self.tone.variances(self.dt, &self.noise, low_pass));
        left.unwrap_or([f64::INFINITY; 2])
    }

    /// Whether the last fifth of a second fits the stop that the long window shows, on a vehicle that rocks or one that does not:
    /// ratio to the threshold. 0 before there is anything to compare.
    pub(super) fn short(&self, belief: &Belief, rocking: bool) -> f64 {
        let Some((short, long)) = self
            .short
            .as_ref()
            .and_then(|short| Some((short.moments()?, self.long.moments()?)))
        else {
            return 0.0;
        };
        if self.kind != DetectorKind::Composite {
            return self
                .single(&short, belief, ONE_IN_1E6)
                .into_iter()
                .fold(0.0, f64::max);
        }
        let Some(low_pass) = &self.low_pass else {
            return 0.0;
        };
        let about = (&long.mean_force(), &long.mean_rate());
        let energy = composite::variances(&short, Some(about), &self.noise, low_pass);
        let threshold = composite::energy_threshold(short.span, low_pass, ONE_IN_1E6) * self.scale;
        let [force, rate] = match rocking {
            true => self.leave().map(|leave| leave / 3.0),
            false => [0.0; 2],
        };
        let levels = [self.level[0].max(force), self.level[1].max(rate)];
        (energy[0] / levels[0]).max(energy[1] / levels[1]) / threshold
    }

    /// Remember how lively the stop is: at once when it begins, then falling within half a second (what is left of braking
    /// leaves the window), rising within five, so that a start does not hide itself.
    pub(super) fn learn_level(&mut self, variances: [f64; 2], begins: bool) {
        let Some(low_pass) = &self.low_pass else {
            return;
        };
        let expected = composite::expected_variance(self.length, low_pass);
        for (level, variance) in self.level.iter_mut().zip(variances) {
            let seen = (variance / expected).max(1.0);
            let share = match (begins, seen < *level) {
                (true, _) => 1.0,
                (false, true) => 0.2,
                (false, false) => 0.02,
            };
            *level += (seen - *level) * share;
        }
    }

    /// How lively it is, factors on LPMV and LPGV of the noise, at least 1.
    pub(super) fn level(&self) -> [f64; 2] {
        self.level
    }

    /// Ratios of one of the four of [Skog10], of force and of rate; NaN where it has none.
    fn single(&self, m: &Moments, belief: &Belief, z: f64) -> [f64; 2] {
        let (noise, scale) = (&self.noise, self.scale);
        let expected = &belief.rate_b;
        let variance = belief.rate_covariance_b.trace();
        match self.kind {
            DetectorKind::Mv => [
                mv::statistic(m, noise) / (mv::threshold(m, z) * scale),
                f64::NAN,
            ],
            DetectorKind::Mag => [
                mag::statistic(m, noise) / (mag::threshold(m, noise, z) * scale),
                f64::NAN,
            ],
            DetectorKind::Are => [
                f64::NAN,
                are::statistic(m, expected, noise)
                    / (are::threshold(m, variance, noise, z) * scale),
            ],
            DetectorKind::Glrt
            | DetectorKind::Auto
            | DetectorKind::Composite
            | DetectorKind::None => {
                let ratio = glrt::statistic(m, expected, noise)
                    / (glrt::threshold(m, variance, noise, z) * scale);
                [ratio; 2]
            }
        }
    }
}
