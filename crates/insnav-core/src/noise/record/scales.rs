//! Windows judged with more and more samples averaged, and what speaks against each.

use super::IdentifyOptions;
use super::regress::{ANGLE, BIAS, Channel, Fitted};
use super::turned::Turned;
use super::window::Window;
use crate::noise::{LARGEST_CHI2_PER_DOF, Refusal};
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

/// When so many of the windows are used and fit together, no other scale is tried; one that is must bring the error down to this.
const ENOUGH_USED: f64 = 0.8;
const WORTH_IT: f64 = 0.8;
/// The coarsest scale leaves a window so many steps.
const FEWEST_STEPS: usize = 100;
/// Innovations with more excess kurtosis than this, plus so many of its standard errors, come in bursts.
const MOST_KURTOSIS: f64 = 1.0;
const KURTOSIS_SIGMAS: f64 = 4.0;
/// Share of windows with unmodelled acceleration that fits by chance.
const BY_CHANCE: f64 = 0.05;
/// A window shows more gyro noise than the quietest ones by more than this many sigmas: motion.
const CONSISTENT: f64 = 3.0;

/// What depends on how many samples are averaged.
pub(super) struct Scale {
    pub(super) averaged: usize,
    pub(super) block: f64,
    pub(super) channel: Channel,
    /// Start values, per block.
    pub(super) begin: [f64; 3],
}

impl Scale {
    pub(super) fn new(
        averaged: usize,
        step: f64,
        shortest: usize,
        wander: f64,
        [q, r]: &[f64; 2],
        options: &IdentifyOptions,
    ) -> Self {
        let block = averaged as f64 * step;
        let lags = options.lags.min(shortest / averaged / 4).max(4);
        Scale {
            averaged,
            block,
            channel: Channel::new(block, lags, options.rounds.max(1)),
            begin: [
                q * averaged as f64,
                wander * wander * block,
                r / averaged as f64,
            ],
        }
    }
}

/// Windows as they were judged at one scale.
pub(super) struct Scaled {
    pub(super) scale: Scale,
    pub(super) windows: Vec<Window>,
    pub(super) reasons: Vec<Option<String>>,
    pub(super) pooled: Option<Result<Fitted, Refusal>>,
}

impl Scaled {
    pub(super) fn used(&self) -> impl Iterator<Item = &Window> {
        let pairs = self.windows.iter().zip(&self.reasons);
        pairs.filter(|(_, r)| r.is_none()).map(|(w, _)| w)
    }

    /// Standard error of the gyros' variance over itself, with what the windows together show beyond it.
    fn relative_error(&self) -> f64 {
        match &self.pooled {
            Some(Ok(fitted)) => {
                let (q, error) = (
                    fitted.estimate.theta[ANGLE],
                    fitted.estimate.standard_errors[ANGLE],
                );
                self.widening(fitted)[ANGLE] * error / q.max(0.1 * error)
            }
            _ => f64::INFINITY,
        }
    }

    /// Of the covariances that windows together leave, by degree of freedom.
    fn left(&self) -> f64 {
        match &self.pooled {
            Some(Ok(f)) => f.estimate.chi2 / f.estimate.dof as f64,
            _ => f64::INFINITY,
        }
    }

    fn fits(&self) -> bool {
        self.left() <= LARGEST_CHI2_PER_DOF
    }

    fn share(&self) -> f64 {
        self.used().count() as f64 / self.windows.len().max(1) as f64
    }

    /// Nothing to be gained by another scale.
    pub(super) fn is_good(&self) -> bool {
        self.fits() && self.share() > ENOUGH_USED
    }

    /// What fits is better than what does not; then the surer one, or, of what does not, what is nearer to it.
    pub(super) fn is_better_than(&self, other: &Self) -> bool {
        match (self.fits(), other.fits()) {
            (true, false) => 2.0 * self.share() > other.share(),
            (false, true) => false,
            (true, true) => self.relative_error() < WORTH_IT * other.relative_error(),
            (false, false) => self.left() * other.share() < WORTH_IT * other.left() * self.share(),
        }
    }

    /// By how much the stated errors of the three unknowns are too small: for what the windows together leave beyond chance, and for
    /// what they scatter among each other beyond it.
    pub(super) fn widening(&self, pooled: &Fitted) -> [f64; 3] {
        let estimate = &pooled.estimate;
        let left = estimate.chi2 / estimate.dof as f64;
        let count = self.used().count() as f64;
        let beyond = |ratio: f64, of: f64| {
            let chance = 1.0 + 3.0 * (2.0 / of).sqrt();
            if ratio > chance { ratio } else { 1.0 }
        };
        let left = beyond(left, estimate.dof as f64);
        core::array::from_fn(|i| {
            // Of windows of one length, errors by the noise that all have: that of a window alone is small where its noise is.
            let error = estimate.standard_errors[i] * count.sqrt();
            let squares: f64 = self
                .used()
                .filter_map(|w| w.fitted.as_ref())
                .map(|f| ((f.estimate.theta[i] - estimate.theta[i]) / error).powi(2))
                .sum();
            let scatter = squares / (count - 1.0).max(1.0);
            left.max(beyond(scatter, count)).sqrt()
        })
    }
}

/// Judge all windows, with more and more samples averaged as long as that makes the result surer: what colours the noise of
/// neighbouring samples (a low-pass, coarse steps, an engine) is gone in averages.
pub(super) fn best_scale(
    first: usize,
    shortest: usize,
    windows: &[Window],
    scale: impl Fn(usize) -> Scale,
    data: impl Fn(&Window, usize) -> Option<Turned>,
) -> Scaled {
    let judged_at = |averaged: usize| {
        let scale = scale(averaged);
        let mut windows = windows.to_vec();
        for window in &mut windows {
            if window.reason.is_none() {
                window.data = data(window, averaged);
                judge(window, &scale.channel, scale.begin);
            }
        }
        let mut reasons: Vec<Option<String>> = windows.iter().map(|w| w.reason.clone()).collect();
        keep_the_quietest(&windows, &mut reasons);
        leave_chance_out(&mut reasons);
        let mut scaled = Scaled {
            scale,
            windows,
            reasons,
            pooled: None,
        };
        let data: Vec<&Turned> = scaled.used().filter_map(|w| w.data.as_ref()).collect();
        let Scale { channel, begin, .. } = &scaled.scale;
        scaled.pooled =
            (!data.is_empty()).then(|| channel.estimate(&data, *begin, Some(begin[BIAS])));
        scaled
    };
    let mut best = judged_at(first);
    let mut averaged = 2 * first;
    while !best.is_good() && shortest / averaged >= FEWEST_STEPS {
        let next = judged_at(averaged);
        if next.is_better_than(&best) {
            best = next;
        }
        averaged *= 2;
    }
    best
}

/// Fit one window and say what speaks against it.
fn judge(window: &mut Window, channel: &Channel, begin: [f64; 3]) {
    let Some(data) = &window.data else {
        window.reason = Some("too few measurements".to_string());
        return;
    };
    match channel.estimate(&[data], begin, Some(begin[BIAS])) {
        Err(refusal) => window.reason = Some(refusal.to_string()),
        Ok(fitted) => {
            let estimate = &fitted.estimate;
            let (kurtosis, error) = fitted.kurtosis;
            if !estimate.fits() {
                window.reason = Some(format!(
                    "the model does not fit (χ²/dof {:.1}): acceleration, or noise that is not white",
                    estimate.chi2 / estimate.dof as f64
                ));
            } else if kurtosis > MOST_KURTOSIS + KURTOSIS_SIGMAS * error {
                window.reason = Some(format!(
                    "the innovations come in bursts (excess kurtosis {kurtosis:.1}): knocks or short accelerations"
                ));
            }
            window.fitted = Some(fitted);
        }
    }
}

/// Of windows that accelerate one in twenty may fit all the same: as few as that are none.
fn leave_chance_out(reasons: &mut [Option<String>]) {
    let expected = BY_CHANCE * reasons.len() as f64;
    let used = reasons.iter().filter(|r| r.is_none()).count() as f64;
    if used <= expected + 2.0 * expected.sqrt() {
        for reason in reasons.iter_mut().filter(|r| r.is_none()) {
            *reason = Some("fits, but so few windows do that it may be by chance".to_string());
        }
    }
}

/// Leave out what shows more gyro noise than the quietest windows: slow acceleration, or errors of the gyros' scale, that pass for it.
fn keep_the_quietest(windows: &[Window], reasons: &mut [Option<String>]) {
    let q = |f: &Fitted| (f.estimate.theta[ANGLE], f.estimate.standard_errors[ANGLE]);
    let usable = |i: &usize| reasons[*i].is_none();
    let all: Vec<(usize, f64, f64)> = (0..windows.len())
        .filter(usable)
        .filter_map(|i| windows[i].fitted.as_ref().map(|f| (i, q(f).0, q(f).1)))
        .collect();
    let Some(&(_, least, error)) = all
        .iter()
        .min_by(|a, b| (a.1 + 2.0 * a.2).total_cmp(&(b.1 + 2.0 * b.2)))
    else {
        return;
    };
    // The standard error of a window follows its own q: that of the quietest ones, were they all alike, is that of their mean.
    let alike: Vec<f64> = all
        .iter()
        .filter(|(_, q, e)| q - least <= CONSISTENT * error.hypot(*e))
        .map(|(_, q, _)| *q)
        .collect();
    let mean = alike.iter().sum::<f64>() / alike.len() as f64;
    for (i, q, e) in all {
        if q - least > CONSISTENT * error.hypot(e) && q > 2.0 * mean {
            reasons[i] = Some(format!(
                "shows {:.2} times the gyro noise of the quietest windows: slow acceleration or motion that passes for it",
                (q / mean.max(1e-30)).sqrt()
            ));
        }
    }
}
