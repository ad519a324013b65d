//! What is used in the next run, and what is accepted in the end.

use super::{InnovationSums, NoiseSolution, NoiseUnknown};
use crate::noise::{LARGEST_CHI2_PER_DOF, Verdict};
use std::format;
use std::string::String;
use std::vec::Vec;

const K: usize = NoiseUnknown::COUNT;
/// Runs at most.
const MOST_ROUNDS: usize = 5;
/// A variance has settled when it moves by less than this share, or by less than half its standard error.
const SETTLED: f64 = 0.15;
/// In one round a variance falls and grows by no more than these factors: an estimate of zero is no noise to run with.
const MOST_STEP: (f64, f64) = (0.04, 100.0);
/// Largest standard error of a variance that is accepted, over the variance: a tenth of the sigma.
const LARGEST_RELATIVE_ERROR: f64 = 0.2;
/// Twice as much is accepted where the prior is further away than so many standard errors: it is then known to be worse.
const EXCLUDED: f64 = 4.0;

/// Sigmas of a receiver are not made smaller than what it states, or what was set if that is less, by more than this factor: a
/// filter follows errors that stay, so that innovations do not show them. As for sigmas that are learnt on the way.
const TOLERATED: f64 = 1.5;

/// The noise of a run: sigmas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseValues {
    /// White noise of the gyros, rad/√s.
    pub gyro_white: f64,
    /// White noise of the accelerometers, m/s/√s.
    pub accel_white: f64,
    /// Factor on the sigmas of positions.
    pub position_scale: f64,
    /// Factor on the sigmas of velocities.
    pub velocity_scale: f64,
}

impl NoiseValues {
    /// In the order of [`NoiseUnknown::ALL`].
    pub fn as_array(&self) -> [f64; NoiseUnknown::COUNT] {
        [
            self.gyro_white,
            self.accel_white,
            self.position_scale,
            self.velocity_scale,
        ]
    }

    fn from_array([gyro_white, accel_white, position_scale, velocity_scale]: [f64; K]) -> Self {
        NoiseValues {
            gyro_white,
            accel_white,
            position_scale,
            velocity_scale,
        }
    }
}

/// What became of one number.
#[derive(Clone, Debug, PartialEq)]
pub struct AdaptedNumber {
    /// Which.
    pub unknown: NoiseUnknown,
    /// Before, as a sigma in the unit of [`NoiseValues`].
    pub prior: f64,
    /// What the innovations say; `None` when they were too few to say anything.
    pub estimate: Option<f64>,
    /// One sigma of the estimate.
    pub standard_error: Option<f64>,
    /// [`Verdict::Estimated`]: used from now on. [`Verdict::Held`], [`Verdict::OnBound`]: the prior stays.
    pub verdict: Verdict,
    /// Why it was held.
    pub reason: Option<String>,
}

/// All numbers, and the test of fit.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// One for each unknown that the innovations depend on.
    pub numbers: Vec<AdaptedNumber>,
    /// Misfit of the lag covariances at the estimate.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub dof: usize,
    /// Runs that were made for it.
    pub rounds: usize,
}

impl Outcome {
    /// The noise to use from now on.
    pub fn accepted(&self, prior: &NoiseValues) -> NoiseValues {
        let mut values = prior.as_array();
        for number in &self.numbers {
            if let (Verdict::Estimated, Some(estimate)) = (number.verdict, number.estimate) {
                values[number.unknown as usize] = estimate;
            }
        }
        NoiseValues::from_array(values)
    }

    /// Whether the noise of an unknown was accepted.
    pub fn is_accepted(&self, unknown: NoiseUnknown) -> bool {
        self.numbers
            .iter()
            .any(|n| n.unknown == unknown && n.verdict == Verdict::Estimated)
    }
}

/// What comes next.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Another run with this noise.
    Again(NoiseValues),
    /// That was all.
    Done(Outcome),
}

/// Leads from the prior to what is accepted, one run after the other.
#[derive(Clone, Debug)]
pub struct NoiseAdaptation {
    prior: NoiseValues,
    used: NoiseValues,
    round: usize,
}

impl NoiseAdaptation {
    /// Begin with a run that believes in the prior.
    pub fn new(prior: NoiseValues) -> Self {
        NoiseAdaptation {
            prior,
            used: prior,
            round: 0,
        }
    }

    /// The noise of the run that is to be made.
    pub fn values(&self) -> NoiseValues {
        self.used
    }

    /// Take what the run has shown.
    pub fn take(&mut self, sums: &InnovationSums) -> Step {
        self.round += 1;
        let solution = match sums.solve(&[None; K]) {
            Ok(solution) => solution,
            Err(refusal) => return Step::Done(self.nothing(sums, &format!("{refusal}"))),
        };
        let used = self.used.as_array();
        let mut next = used;
        let mut settled = true;
        for unknown in NoiseUnknown::ALL {
            let i = unknown as usize;
            if !sums.shows(unknown) {
                continue;
            }
            let (theta, error) = (solution.theta[i], solution.standard_errors[i]);
            // Of what is not known better than itself, a run needs something that is possible.
            let wanted = theta.max(0.5 * error).min(theta + error);
            let factor = wanted.clamp(MOST_STEP.0, MOST_STEP.1);
            settled &= (factor - 1.0).abs() < SETTLED.max(0.5 * error);
            next[i] *= factor.sqrt();
        }
        if settled || self.round >= MOST_ROUNDS {
            return Step::Done(self.judge(sums, &solution));
        }
        self.used = NoiseValues::from_array(next);
        Step::Again(self.used)
    }

    /// Accept or hold each number.
    fn judge(&self, sums: &InnovationSums, first: &NoiseSolution) -> Outcome {
        let (prior, used) = (self.prior.as_array(), self.used.as_array());
        let mut given = [None; K];
        let mut reasons: [Option<(Verdict, String)>; K] = [const { None }; K];
        let (mut solution, mut told) = (*first, *first);
        // What the data do not tell goes back to its prior, the worst first; the others may then be known better.
        loop {
            // Over what is accepted: above 1, the number is held.
            let relative = |i: usize| {
                let (theta, error) = (solution.theta[i], solution.standard_errors[i]);
                let away = (theta - (prior[i] / used[i]).powi(2)).abs();
                let most = if away > EXCLUDED * error {
                    2.0 * LARGEST_RELATIVE_ERROR
                } else {
                    LARGEST_RELATIVE_ERROR
                };
                error / theta / most
            };
            let worst = NoiseUnknown::ALL
                .into_iter()
                .map(|unknown| unknown as usize)
                .filter(|i| given[*i].is_none() && sums.shows(NoiseUnknown::ALL[*i]))
                .max_by(|a, b| relative(*a).total_cmp(&relative(*b)))
                .filter(|i| relative(*i) > 1.0 || relative(*i).is_nan());
            let Some(i) = worst else { break };
            reasons[i] = Some(if solution.theta[i] <= 0.0 {
                (
                    Verdict::OnBound,
                    "the estimate is zero: other noise hides this one".into(),
                )
            } else {
                (
                    Verdict::Held,
                    format!(
                        "known to {:.0} % only, {:.0} % are asked for",
                        50.0 * solution.standard_errors[i] / solution.theta[i],
                        50.0 * LARGEST_RELATIVE_ERROR
                    ),
                )
            });
            told.theta[i] = solution.theta[i];
            told.standard_errors[i] = solution.standard_errors[i];
            given[i] = Some((prior[i] / used[i]).powi(2));
            match sums.solve(&given) {
                Ok(next) => solution = next,
                // Nothing is left to be solved for.
                Err(_) => break,
            }
        }
        for i in (0..K).filter(|i| given[*i].is_none()) {
            told.theta[i] = solution.theta[i];
            told.standard_errors[i] = solution.standard_errors[i];
        }
        let fits = solution.chi2 <= LARGEST_CHI2_PER_DOF * solution.dof as f64;
        let numbers = NoiseUnknown::ALL
            .into_iter()
            .filter(|unknown| sums.shows(*unknown))
            .map(|unknown| {
                let i = unknown as usize;
                let sigma = told.theta[i].sqrt() * used[i];
                let (verdict, reason) = if fits {
                    match reasons[i].take() {
                        Some((verdict, reason)) => (verdict, Some(reason)),
                        None if is_less_than_stated(unknown, sigma, prior[i]) => {
                            let reason = "less than the receiver states: innovations do not show errors that stay";
                            (Verdict::Held, Some(reason.into()))
                        }
                        None => (Verdict::Estimated, None),
                    }
                } else {
                    let reason = format!(
                        "innovations are not those of white noise: chi2/dof {:.1} is above {LARGEST_CHI2_PER_DOF}",
                        solution.chi2 / solution.dof as f64
                    );
                    (Verdict::Held, Some(reason))
                };
                // d√θ = dθ / (2 √θ); of zero, the sigma of what it may be.
                let error = told.standard_errors[i];
                let standard_error = if told.theta[i] > 0.25 * error {
                    0.5 * error / told.theta[i].sqrt()
                } else {
                    error.sqrt()
                };
                AdaptedNumber {
                    unknown,
                    prior: prior[i],
                    estimate: Some(sigma),
                    standard_error: Some(standard_error * used[i]),
                    verdict,
                    reason,
                }
            })
            .collect();
        Outcome {
            numbers,
            chi2: solution.chi2,
            dof: solution.dof,
            rounds: self.round,
        }
    }

    fn nothing(&self, sums: &InnovationSums, why: &str) -> Outcome {
        let prior = self.prior.as_array();
        let numbers = NoiseUnknown::ALL
            .into_iter()
            .filter(|unknown| match unknown {
                NoiseUnknown::Velocity => sums.counts()[1] > 0,
                _ => true,
            })
            .map(|unknown| AdaptedNumber {
                unknown,
                prior: prior[unknown as usize],
                estimate: None,
                standard_error: None,
                verdict: Verdict::Held,
                reason: Some(why.into()),
            })
            .collect();
        Outcome {
            numbers,
            chi2: 0.0,
            dof: 0,
            rounds: self.round,
        }
    }
}

fn is_less_than_stated(unknown: NoiseUnknown, scale: f64, prior: f64) -> bool {
    match unknown {
        NoiseUnknown::Gyro | NoiseUnknown::Accel => false,
        NoiseUnknown::Position | NoiseUnknown::Velocity => scale * TOLERATED < prior.min(1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Pair, Product};
    use super::*;
    use crate::time::Time;

    const PRIOR: NoiseValues = NoiseValues {
        gyro_white: 1e-3,
        accel_white: 1e-2,
        position_scale: 1.0,
        velocity_scale: 1.0,
    };

    /// Squares of one component of which one unknown has the share `share` and nothing else is known: as many as `count`.
    fn squares(sums: &mut InnovationSums, unknown: usize, share: f64, square: f64, count: usize) {
        for i in 0..count {
            sums.begin(Time(i as i64 * 100_000_000), unknown == 3);
            let mut product = Product {
                measured: [[0.0; 3]; 3],
                shares: [[[0.0; 3]; 3]; K],
                known: [[0.0; 3]; 3],
            };
            product.measured[0][0] = square;
            product.shares[unknown][0][0] = share;
            product.known[0][0] = 1.0 - share;
            let pair = Pair {
                now: unknown == 3,
                then: unknown == 3,
                lag: 0,
                size: 1,
            };
            sums.add(&pair, &product);
        }
    }

    #[test]
    fn what_the_data_hardly_depend_on_keeps_its_prior() {
        let mut sums = InnovationSums::default();
        squares(&mut sums, 2, 1.0, 1.05, 1000);
        squares(&mut sums, 3, 0.01, 1.0, 1000);
        let Step::Done(outcome) = NoiseAdaptation::new(PRIOR).take(&sums) else {
            panic!("settled at once");
        };
        let verdicts: Vec<_> = outcome
            .numbers
            .iter()
            .map(|n| (n.unknown, n.verdict))
            .collect();
        assert_eq!(
            verdicts,
            [
                (NoiseUnknown::Position, Verdict::Estimated),
                (NoiseUnknown::Velocity, Verdict::Held)
            ]
        );
        let used = outcome.accepted(&PRIOR);
        assert!((used.position_scale.powi(2) - 1.05).abs() < 1e-12);
        assert_eq!(used.velocity_scale, PRIOR.velocity_scale);
        assert!(outcome.numbers[1].reason.is_some());
    }

    #[test]
    fn innovations_that_no_white_noise_has_hold_everything() {
        let mut sums = InnovationSums::default();
        squares(&mut sums, 2, 1.0, 1.0, 1000);
        // Products of neighbours that nothing predicts.
        for _ in 0..1000 {
            let pair = Pair {
                now: false,
                then: false,
                lag: 1,
                size: 1,
            };
            let mut measured = [[0.0; 3]; 3];
            measured[0][0] = 0.3;
            sums.add(
                &pair,
                &Product {
                    measured,
                    shares: [[[0.0; 3]; 3]; K],
                    known: [[0.0; 3]; 3],
                },
            );
        }
        let Step::Done(outcome) = NoiseAdaptation::new(PRIOR).take(&sums) else {
            panic!("settled at once");
        };
        assert_eq!(outcome.numbers[0].verdict, Verdict::Held);
        assert_eq!(outcome.accepted(&PRIOR), PRIOR);
    }

    #[test]
    fn a_variance_moves_by_no_more_than_is_possible_in_one_round() {
        let mut sums = InnovationSums::default();
        squares(&mut sums, 2, 1.0, 1e6, 1000);
        squares(&mut sums, 0, 1.0, 0.0, 1000);
        let Step::Again(next) = NoiseAdaptation::new(PRIOR).take(&sums) else {
            panic!("far from settled");
        };
        assert!((next.position_scale - 10.0).abs() < 1e-12);
        assert!(next.gyro_white > 0.0 && next.gyro_white < 0.25 * PRIOR.gyro_white);
    }

    /// What is left of a receiver's error when its filter has followed the rest.
    #[test]
    fn sigmas_are_not_made_smaller_than_stated() {
        let scale_of = |prior: f64| {
            let prior = NoiseValues {
                position_scale: prior,
                ..PRIOR
            };
            let mut adaptation = NoiseAdaptation::new(prior);
            loop {
                let mut sums = InnovationSums::default();
                let used = adaptation.values().position_scale;
                squares(&mut sums, 2, 1.0, (0.3 / used).powi(2), 1000);
                if let Step::Done(outcome) = adaptation.take(&sums) {
                    let found = outcome.numbers[0].estimate.expect("seen");
                    assert!((found - 0.3).abs() < 1e-12, "{found}");
                    return outcome.accepted(&prior).position_scale;
                }
            }
        };
        assert_eq!(scale_of(1.0), 1.0);
        assert_eq!(scale_of(3.0), 3.0);
        // Who has said that it is less is believed, in either direction.
        assert!((scale_of(0.1) - 0.3).abs() < 1e-12);
        assert!((scale_of(0.4) - 0.3).abs() < 1e-12);
    }

    #[test]
    fn without_any_innovation_everything_is_held() {
        let Step::Done(outcome) = NoiseAdaptation::new(PRIOR).take(&InnovationSums::default())
        else {
            panic!("there is nothing to go on with");
        };
        assert_eq!(outcome.numbers.len(), 3);
        assert!(outcome.numbers.iter().all(|n| n.estimate.is_none()));
        assert_eq!(outcome.accepted(&PRIOR), PRIOR);
    }
}
