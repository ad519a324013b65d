//! A gate that does not lock its filter out.

/// Share of the newest innovation in the running mean that tells a step from scatter: ten samples.
const NEWEST: f64 = 0.1;

/// Share of `sigmas` that the running mean of a push is beyond after two samples, and that of scatter rarely is.
const COHERENT: f64 = 0.5;
/// Refusals by scatter that disarm, and how many of them one that fits takes back. A push has two of them.
const MOST_SCATTER: f64 = 10.0;
const TAKEN_BACK: f64 = 0.25;

/// What to do with a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passage {
    /// It fits, or there is nothing better to do: use it.
    Use,
    /// Leave it out: it does not fit, for less time than a disturbance may last.
    Leave,
    /// Doubt the attitude, then use it: innovations of one sign while the gate was not armed, a push or its end. What the biases
    /// have learnt before stays.
    DoubtAttitude,
    /// Doubt attitude and biases, then use it: what has not fitted for longer than any disturbance lasts is the truth.
    DoubtAll,
}

/// A gate on a pair of innovations that is armed by agreement and disarmed by disagreement that lasts.
///
/// A plain gate believes its filter. One that is wrong, because its first measurements were disturbed, refuses all good ones
/// from then on, and grows no wiser: its covariance does not know of the error. Here a filter earns its gate: it must have
/// converged, and everything must have fitted for `settle_s`. It loses the gate again after `patience_s` of refusals, the longest
/// that a disturbance lasts (a push of 1 m/s² for 3 s ends in 11 km/h), where one that was
/// accepted takes one refused back; and after ten of either sign, which are no push but noise that the filter does not know.
/// Without the gate nothing is refused; what is off by more than scatter is a step of the
/// attitude, so that a push teaches the biases nothing.
///
/// Time is counted in steps of the measurement: the state is six numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmedGate {
    /// Standard deviations within which an innovation fits.
    pub sigmas: f64,
    /// The longest that a disturbance lasts, s.
    pub patience_s: f64,
    /// How long everything must have fitted before the gate is armed, s. As long as a disturbance lasts, so that what was agreed
    /// with is none, where disturbances are short.
    pub settle_s: f64,
    armed: bool,
    fitting_s: f64,
    refused_s: f64,
    /// Refusals of either sign less acceptances, steps.
    scattered: f64,
    mean: [f64; 2],
}

impl ArmedGate {
    /// A gate at four standard deviations that is not armed yet.
    pub fn new(patience_s: f64, settle_s: f64) -> Self {
        ArmedGate {
            sigmas: 4.0,
            patience_s,
            settle_s,
            armed: false,
            fitting_s: 0.0,
            refused_s: 0.0,
            scattered: 0.0,
            mean: [0.0; 2],
        }
    }

    /// The plain gate, armed from the first measurement for ever: for comparison.
    pub fn plain() -> Self {
        ArmedGate {
            armed: true,
            ..ArmedGate::new(f64::INFINITY, 0.0)
        }
    }

    /// Whether innovations that do not fit are refused.
    pub fn is_armed(&self) -> bool {
        self.armed
    }

    /// Everything passes until the gate has been earned anew.
    pub fn disarm(&mut self) {
        *self = ArmedGate {
            sigmas: self.sigmas,
            ..ArmedGate::new(self.patience_s, self.settle_s)
        };
    }

    /// The verdict on a pair of innovations in standard deviations that stands for `step_s` (of a single one, the other is zero).
    /// `converged`: the filter knows its state well enough to tell a disturbance from its own error for as long as one lasts.
    pub fn judge(&mut self, normalised: [f64; 2], step_s: f64, converged: bool) -> Passage {
        if normalised.iter().any(|v| !v.is_finite()) {
            return Passage::Leave;
        }
        let sigmas = self.sigmas;
        let beyond = |pair: [f64; 2], share: f64| pair.iter().any(|v| v.abs() > share * sigmas);
        let fits = !beyond(normalised, 1.0);
        for (mean, newest) in self.mean.iter_mut().zip(normalised) {
            *mean += NEWEST * (newest - *mean);
        }
        if !self.armed {
            if beyond(self.mean, 1.0) {
                self.mean = [0.0; 2];
                self.fitting_s = 0.0;
                return Passage::DoubtAttitude;
            }
            self.fitting_s = if fits { self.fitting_s + step_s } else { 0.0 };
            self.armed = converged && self.fitting_s >= self.settle_s;
            return Passage::Use;
        }
        if fits {
            self.refused_s = (self.refused_s - step_s).max(0.0);
            self.scattered = (self.scattered - TAKEN_BACK).max(0.0);
            return Passage::Use;
        }
        if !beyond(self.mean, COHERENT) {
            self.scattered += 1.0;
            // The plain gate has no patience to lose.
            if self.scattered >= MOST_SCATTER && self.patience_s.is_finite() {
                self.disarm();
                return Passage::Use;
            }
        }
        self.refused_s += step_s;
        if self.refused_s < self.patience_s {
            return Passage::Leave;
        }
        self.disarm();
        Passage::DoubtAll
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Source, Stream};
    use std::vec::Vec;

    const STEP: f64 = 0.03125;

    fn judge(gate: &mut ArmedGate, sigmas: f64, seconds: f64) -> Passage {
        let mut last = Passage::Use;
        for _ in 0..(seconds / STEP) as usize {
            last = gate.judge([0.0, sigmas], STEP, true);
        }
        last
    }

    #[test]
    fn armed_by_agreement_alone() {
        let mut gate = ArmedGate::new(3.0, 3.0);
        judge(&mut gate, 1.0, 2.5);
        judge(&mut gate, 5.0, STEP);
        judge(&mut gate, 1.0, 2.5);
        assert!(!gate.is_armed());
        // However well it fits: not before the filter has converged.
        for _ in 0..1000 {
            gate.judge([0.0; 2], STEP, false);
        }
        assert!(!gate.is_armed());
        judge(&mut gate, -1.0, 3.0);
        assert!(gate.is_armed());
        assert_eq!(gate.judge([-5.0, 0.0], STEP, true), Passage::Leave);
        gate.disarm();
        assert_eq!(gate, ArmedGate::new(3.0, 3.0));
    }

    #[test]
    fn disarmed_by_disagreement_that_lasts() {
        let armed = || {
            let mut gate = ArmedGate::new(3.0, 3.0);
            judge(&mut gate, 0.0, 3.0);
            gate
        };
        let mut gate = armed();
        assert_eq!(judge(&mut gate, 9.0, 3.0 - STEP), Passage::Leave);
        assert_eq!(gate.judge([9.0, 0.0], STEP, true), Passage::DoubtAll);
        assert!(!gate.is_armed());
        // A disturbance now and then never does it.
        let mut gate = armed();
        for _ in 0..100 {
            assert_eq!(judge(&mut gate, 9.0, 2.0), Passage::Leave);
            judge(&mut gate, 0.0, 2.0);
        }
        // NaN is nothing to go by.
        assert_eq!(gate.judge([f64::NAN, 0.0], STEP, true), Passage::Leave);
    }

    #[test]
    fn without_the_gate_a_step_is_one_and_scatter_is_none() {
        let mut gate = ArmedGate::new(3.0, 3.0);
        let passages: Vec<_> = (0..4)
            .map(|_| gate.judge([16.0, 0.0], STEP, false))
            .collect();
        assert_eq!(
            passages,
            [
                Passage::Use,
                Passage::Use,
                Passage::DoubtAttitude,
                Passage::Use
            ]
        );
        let mut gate = ArmedGate::new(3.0, 3.0);
        for k in 0..1000 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            assert_eq!(gate.judge([8.0 * sign, 0.0], STEP, true), Passage::Use);
        }
        assert!(!gate.is_armed());
    }

    /// Noise of five times the size, of which two thirds do not fit: nobody accelerates so.
    #[test]
    fn disarmed_by_scatter_long_before_a_push_would_be_believed() {
        let mut source = Source::new(1, Stream::Initial);
        for _ in 0..100 {
            let mut gate = ArmedGate::new(3.0, 3.0);
            judge(&mut gate, 0.0, 3.0);
            let taken = (1..).find(|_| {
                let noise = [5.0 * source.normal(), 5.0 * source.normal()];
                let passage = gate.judge(noise, STEP, true);
                assert_ne!(passage, Passage::DoubtAll);
                !gate.is_armed()
            });
            // Three seconds.
            assert!(taken.expect("disarmed") <= 96, "{taken:?}");
        }
        // Gaussian noise as believed, one in sixteen thousand beyond, never does.
        let mut gate = ArmedGate::new(3.0, 3.0);
        judge(&mut gate, 0.0, 3.0);
        for _ in 0..100_000 {
            gate.judge([source.normal(), source.normal()], STEP, true);
            assert!(gate.is_armed());
        }
    }

    #[test]
    fn plain_gate_locks_out() {
        let mut gate = ArmedGate::plain();
        assert_eq!(judge(&mut gate, 5.0, 1e4), Passage::Leave);
    }
}
