//! GNSS position of an antenna on a lever arm.

use super::antenna::Antenna;
use super::doubt::{Doubt, Vote};
use super::frozen::{Frozen, Moving, Repetition};
use super::learnt_noise::{Evidence, LearntNoise};
use super::{UNSTATED_POSITION_SIGMA, believable};
use crate::config::{GnssConfig, SigmaScale};
use crate::earth::Geodetic;
use crate::error::Result;
use crate::filter::{
    Block, CLOCK_OFFSET, Columns, Eskf, GNSS_COLOUR, Gate, Layout, Linearized, Measurement,
    Nominal, POSITION, Update, VELOCITY, Verdict,
};
use crate::sample::GnssPosition;
use crate::stationary::Heard;
use crate::time::Time;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// One fix: r = p_gnss − (p + C l − u δ + c), metres NED, with the antenna's velocity u, a clock offset δ and a
/// time-correlated error c, both zero unless estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssPositionModel {
    /// Position of the antenna.
    pub position: Geodetic,
    /// Antenna from the IMU, body axes, m.
    pub lever_arm_b: Vector3<f64>,
    /// Covariance, NED, m².
    pub r: Matrix3<f64>,
    /// Factor (1 or more) on the covariance when the fix is used, for errors that it shares with the fixes just before.
    pub dependence: f64,
    /// Whether the fix corrects the position alone.
    pub position_alone: bool,
}

impl Measurement<3> for GnssPositionModel {
    fn name(&self) -> &'static str {
        "gnss_position"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<3> {
        let antenna = Antenna::at(at, &self.lever_arm_b);
        let delay = at.calibration.clock_offset;
        let mut predicted_n = antenna.lever_n + at.calibration.gnss_colour_n;
        let mut h = Columns::default();
        h.put(layout, POSITION, &Matrix3::identity());
        antenna.put_lever(&mut h, layout);
        h.put(layout, GNSS_COLOUR, &Matrix3::identity());
        if layout.has(CLOCK_OFFSET) || delay != 0.0 {
            let motion = antenna.motion();
            h.put(layout, CLOCK_OFFSET, &-motion.velocity_n);
            motion.put_velocity(&mut h, layout, -delay);
            predicted_n -= motion.velocity_n * delay;
        }
        Linearized {
            residual: at
                .nav
                .position
                .offset(&predicted_n)
                .offset_to(&self.position),
            h,
            r: self.r,
        }
    }

    fn dependence(&self) -> f64 {
        self.dependence
    }

    fn only(&self) -> Option<Block<3>> {
        self.position_alone.then_some(POSITION)
    }
}

/// Refused positions that agree with each other and exceed the gate by less than this factor (twice the sigmas) are used
/// with a widened covariance; beyond it the filter is widened.
const SLIGHT: f64 = 4.0;

/// When learnt sigmas grow by more than this factor at once, the position that the filter has is no better than a single fix:
/// it comes from fixes that were believed too much.
const GREW: f64 = 2.0;

/// A fix without sigma, from a receiver that states sigmas, is not used for so long after one with a sigma, s: it is most often
/// late, predicted or repeated, and the filter knows better.
const VOUCHED_FOR: f64 = 5.0;

/// When and how positions are used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GnssPositionAid {
    lever_arm_b: Vector3<f64>,
    sigma_floor: f64,
    sigma_scale: f64,
    learnt: Option<LearntNoise>,
    correlation_time: f64,
    /// Instant of the last fix that was used.
    last: Option<Time>,
    /// What the receiver said of its last fix, m².
    stated: Option<Matrix3<f64>>,
    /// Fixes that stated a sigma, and those that did not.
    with_sigma: u32,
    without_sigma: u32,
    /// Whether the receiver gave a velocity lately.
    velocity_heard: bool,
    gate: Gate,
    doubt: Doubt,
    frozen: Frozen,
}

impl GnssPositionAid {
    /// From the settings.
    pub fn new(config: &GnssConfig) -> Self {
        GnssPositionAid {
            lever_arm_b: Vector3::from(config.lever_arm_b_m.unwrap_or_default()),
            sigma_floor: config.sigma_floor_m,
            sigma_scale: config.sigma_scale.fixed().unwrap_or(1.0),
            learnt: match (config.sigma_scale, config.colour) {
                (SigmaScale::Fixed(_), _) => None,
                (SigmaScale::Auto, None) => Some(LearntNoise::default()),
                // With the colour in states of its own, what is stated is the white part.
                (SigmaScale::Auto, Some(_)) => Some(LearntNoise::upward()),
            },
            // States of its own take the correlated part; what is left is white.
            correlation_time: match config.colour {
                Some(_) => 0.0,
                None => config.correlation_time_s,
            },
            last: None,
            stated: None,
            with_sigma: 0,
            without_sigma: 0,
            velocity_heard: false,
            gate: Gate::strict(),
            doubt: Doubt::default(),
            frozen: Frozen::default(),
        }
    }

    /// The model of one fix: its covariance believable, and weighed down if the fix used before it came shortly ago.
    ///
    /// White errors that are to average out no faster than errors of correlation time τ need 2τ/Δt times the variance.
    ///
    /// `velocity_heard`: the receiver's velocity carries velocity and attitude.
    pub fn model(&self, fix: &GnssPosition, velocity_heard: bool) -> GnssPositionModel {
        let stated = stated(fix);
        let may_fall = velocity_heard && !self.is_doubtful(fix);
        let interval = self.last.map_or(f64::INFINITY, |last| fix.time.since(last));
        GnssPositionModel {
            position: fix.position,
            lever_arm_b: self.lever_arm_b,
            r: match &self.learnt {
                Some(learnt) => learnt.apply(&stated, self.sigma_floor, may_fall),
                None => believable(&stated, self.sigma_scale, self.sigma_floor),
            },
            // The same fix once more says nothing new: its weight is a thousandth.
            dependence: (2.0 * self.correlation_time / interval.max(1e-3)).max(1.0),
            position_alone: may_fall && self.learnt.is_some_and(|l| l.is_less_than_stated()),
        }
    }

    /// Factors on stated sigmas as used now, horizontal and vertical.
    pub fn scale(&self) -> [f64; 2] {
        self.learnt
            .map_or([self.sigma_scale; 2], |learnt| learnt.scale())
    }

    /// What the solution's position may be off by beyond the filter's own covariance, m²: errors that residuals do not show,
    /// since the filter follows them, and what refused fixes say while it is not decided who is wrong.
    pub fn beyond_filter(&self, layout: &Layout) -> Matrix3<f64> {
        let unseen = match (&self.learnt, &self.stated) {
            // With states of their own, slow errors are in the filter.
            (Some(learnt), Some(stated)) if self.velocity_heard && !layout.has(GNSS_COLOUR) => {
                learnt.unseen(stated)
            }
            _ => Matrix3::zeros(),
        };
        unseen + self.doubt.covariance()
    }

    /// Offer a fix to the filter. `heard` is the receiver's own velocity, if it gave one lately.
    ///
    /// Refused fixes vote: when enough of them agree with each other, the filter is widened until they fit; when they scatter,
    /// their noise is raised. A position that is repeated while the body moves has no vote.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe(
        &mut self,
        fix: &GnssPosition,
        heard: Option<Heard>,
        filter: &mut Eskf,
    ) -> Result<Update> {
        // A position that corrects the position alone leaves all three components of the velocity to the receiver's own.
        let velocity_heard = heard.is_some_and(|heard| heard.vertical);
        let count = match fix.covariance_n {
            Some(_) => &mut self.with_sigma,
            None => &mut self.without_sigma,
        };
        *count = count.saturating_add(1);
        let model = self.model(fix, velocity_heard);
        self.velocity_heard = velocity_heard;
        let repetition = self
            .frozen
            .judge(fix, &moving(filter, heard.map(|heard| heard.speed)));
        if repetition == Repetition::Frozen {
            let update = filter.update(&model, fix.time, &mut Gate::closed())?;
            return Ok(Update {
                verdict: Verdict::Frozen,
                ..update
            });
        }
        let vouched = self
            .last
            .is_some_and(|last| fix.time.since(last) < VOUCHED_FOR);
        if vouched && self.is_doubtful(fix) {
            let update = filter.update(&model, fix.time, &mut Gate::closed())?;
            return Ok(update);
        }
        let mut update = filter.update(&model, fix.time, &mut self.gate)?;
        let residual = Vector3::from(update.residual);
        let predicted = Vector3::from(update.sigma).map(|s| s * s) - model.r.diagonal();
        if update.verdict == Verdict::Rejected && self.is_as_stated(fix, &residual, &predicted) {
            filter.update(&model, fix.time, &mut Gate::lenient())?;
            update.verdict = Verdict::Inflated;
        }
        if update.verdict.is_used() {
            self.doubt.accepted();
            let doubtful = self.is_doubtful(fix);
            if let Some(learnt) = &mut self.learnt
                && repetition == Repetition::New
                && !doubtful
            {
                let evidence = Evidence {
                    residual,
                    predicted,
                    stated: stated(fix).diagonal(),
                };
                let before = learnt.scale();
                learnt.learn(fix.time, &evidence, self.sigma_floor, velocity_heard);
                if learnt.scale()[0] > GREW * before[0] {
                    let r = self.model(fix, velocity_heard).r;
                    filter.widen(POSITION, &r);
                }
            }
        } else if let Some(vote) = self.doubt.refused(fix.time, &residual) {
            let verdict = self.decide(vote, &update, fix, filter);
            update.verdict = filter
                .update(
                    &self.model(fix, velocity_heard),
                    fix.time,
                    &mut Gate::lenient(),
                )
                .map(|_| verdict)?;
        }
        if update.verdict.is_used() {
            // A doubtful one takes no weight from the next.
            if !self.is_doubtful(fix) {
                self.last = Some(fix.time);
                self.stated = Some(stated(fix));
            }
        }
        Ok(update)
    }

    /// Forget what belonged to a filter that is no more; what was learnt of the receiver stays.
    #[cfg(feature = "std")]
    pub(crate) fn start_afresh(&mut self) {
        self.last = None;
        self.doubt = Doubt::default();
        self.frozen = Frozen::default();
    }

    /// Whether a receiver that mostly states sigmas states none for this fix: what the others teach does not hold for it.
    fn is_doubtful(&self, fix: &GnssPosition) -> bool {
        self.with_sigma > self.without_sigma && fix.covariance_n.is_none()
    }

    /// Whether a residual is within what the receiver itself states, where less has been learnt: its slow error has moved.
    fn is_as_stated(
        &self,
        fix: &GnssPosition,
        residual: &Vector3<f64>,
        predicted: &Vector3<f64>,
    ) -> bool {
        if !self.learnt.is_some_and(|l| l.is_less_than_stated()) || self.is_doubtful(fix) {
            return false;
        }
        let stated = stated(fix).diagonal();
        let nis: f64 = (0..3)
            .map(|i| residual[i] * residual[i] / (predicted[i] + stated[i]).max(f64::MIN_POSITIVE))
            .sum();
        nis <= self.gate.limit[2]
    }

    fn decide(
        &mut self,
        vote: Vote,
        update: &Update,
        fix: &GnssPosition,
        filter: &mut Eskf,
    ) -> Verdict {
        self.doubt.settle();
        let residual = Vector3::from(update.residual);
        match vote {
            // Little beyond the gate all of the filter's errors may be somewhat larger than it thinks, in proportion.
            Vote::FilterIsOff { .. } if update.nis < SLIGHT * self.gate.limit[2] => {
                Verdict::Inflated
            }
            // Far beyond it is not known which of the others are at fault: position, and velocity where it shows.
            Vote::FilterIsOff { drift } => {
                let square = |v: &Vector3<f64>| Matrix3::from_diagonal(&v.component_mul(v));
                filter.widen(POSITION, &square(&residual));
                filter.widen(VELOCITY, &square(&drift));
                Verdict::Reset
            }
            Vote::TheyScatter { scatter } => {
                if let Some(learnt) = &mut self.learnt {
                    let floor = self.sigma_floor * self.sigma_floor;
                    let stated = stated(fix).diagonal().map(|r| r.max(floor));
                    learnt.raise(&scatter, &stated);
                    // As confident as before, the filter would hardly listen to fixes of so much more noise.
                    let scatter = Matrix3::from_diagonal(&scatter);
                    filter.widen(POSITION, &scatter);
                }
                Verdict::Inflated
            }
        }
    }
}

fn stated(fix: &GnssPosition) -> Matrix3<f64> {
    fix.covariance_n.unwrap_or(Matrix3::from_diagonal_element(
        UNSTATED_POSITION_SIGMA * UNSTATED_POSITION_SIGMA,
    ))
}

fn moving(filter: &Eskf, gnss_speed: Option<f64>) -> Moving {
    Moving {
        velocity_n: filter.nominal().nav.velocity_n,
        covariance_n: filter
            .covariance()
            .block(VELOCITY, VELOCITY)
            .unwrap_or_else(Matrix3::zeros),
        gnss_speed,
    }
}
