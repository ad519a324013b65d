//! One variant on one record.

use super::adaptation::Adaptation;
use super::variant::AttitudeVariant;
use crate::ahrs::{
    ArmedGate, AttitudeInnovation, ErrorAxes, FieldGate, InvariantFilter, Passage, innovation_n,
};
use crate::attitude::{Euler, log, wrap_angle};
use crate::error::Result;
use crate::sim::{AttitudeRecord, AttitudeSample};
use nalgebra::{UnitQuaternion, Vector3};
use std::vec::Vec;

/// Errors count from here, s: by then the biases are known as well as they will be.
const FROM_S: f64 = 30.0;
/// A tilt that is off by more than ten sigmas of a filter that has converged is lost, rad.
const LOST: f64 = 0.25 / 57.295_779_513_082_32;
/// Longest push that the gate believes, s.
const PUSH_S: f64 = 3.0;
/// Longest iron, and the agreement that arms the gate of the heading, s.
const IRON_S: f64 = 60.0;
const HEADING_SETTLES_S: f64 = 3.0;

/// What a variant came to, of all samples from 30 s on. Angles in rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AttitudeErrors {
    /// Standard deviation of pitch about its mean (of its error, where there is a truth), with N − 1.
    pub pitch_std: f64,
    /// Of roll.
    pub roll_std: f64,
    /// Root mean square of the errors of pitch, roll and heading; `None` without a truth.
    pub rms: Option<[f64; 3]>,
    /// Root mean square of the tilt about one axis, from the first sample on.
    pub tilt_rms_from_start: Option<f64>,
    /// Longest time in a row in which the tilt was off by more than 0.25°, s, from the first sample on.
    pub longest_lost_s: f64,
    /// Blocks of the tilt that were accepted, and all, of variants that test them.
    pub accepted: Option<[u32; 2]>,
    /// Q and R of the tilt, as used, against the data sheet: mean over time.
    pub noise_ratio: [f64; 2],
    /// Share of samples whose tilt was not used.
    pub refused: f64,
}

/// Roll and pitch at one instant, rad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudePoint {
    /// Since the begin, s.
    pub time_s: f64,
    /// By the variant.
    pub roll: f64,
    /// By the variant.
    pub pitch: f64,
    /// Roll and pitch in truth.
    pub truth: Option<[f64; 2]>,
}

/// The variants on one record.
#[derive(Clone, Copy, Debug)]
pub struct AttitudeTrial<'a> {
    record: &'a AttitudeRecord,
}

/// A filter on its way through a record.
struct Run {
    filter: InvariantFilter,
    adaptation: Adaptation,
    variant: AttitudeVariant,
    tilt_gate: ArmedGate,
    heading_gate: ArmedGate,
    field_gate: FieldGate,
    step_s: f64,
}

impl<'a> AttitudeTrial<'a> {
    /// Of one record.
    pub fn new(record: &'a AttitudeRecord) -> Self {
        AttitudeTrial { record }
    }

    /// One sigma of a tilt, root of the mean over north and east, after three minutes of the best filter there is for noise as it is
    /// at rest, with what tilt and heading have in common; rad. `None` without a magnetometer or a sample.
    pub fn limit(&self) -> Option<f64> {
        let mut last = None;
        self.follow(AttitudeVariant::OracleFullR, |sample, _, run| {
            last = sample.field_b.and(run.map(|run| run.filter.tilt_sigma()));
        })
        .ok()?;
        last
    }

    /// Errors of a variant.
    ///
    /// # Errors
    /// Those of the designs, for gains that no stationary filter has.
    pub fn run(&self, variant: AttitudeVariant) -> Result<AttitudeErrors> {
        let mut sums = Sums::new(self.record);
        self.follow(variant, |sample, q_nb, run| sums.push(sample, q_nb, run))?;
        Ok(sums.errors())
    }

    /// Roll and pitch of a variant at every sample.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn trace(&self, variant: AttitudeVariant) -> Result<Vec<AttitudePoint>> {
        let mut points = Vec::new();
        self.follow(variant, |sample, q_nb, _| {
            let angles = Euler::from_quaternion(q_nb);
            points.push(AttitudePoint {
                time_s: (points.len() + 1) as f64 * self.record.step_s,
                roll: angles.roll,
                pitch: angles.pitch,
                truth: sample.truth_q_nb.map(|q| {
                    let truth = Euler::from_quaternion(&q);
                    [truth.roll, truth.pitch]
                }),
            });
        })?;
        Ok(points)
    }

    fn follow(
        &self,
        variant: AttitudeVariant,
        mut each: impl FnMut(&AttitudeSample, &UnitQuaternion<f64>, Option<&Run>),
    ) -> Result<()> {
        let mut run: Option<Run> = None;
        for sample in &self.record.samples {
            if variant == AttitudeVariant::Raw {
                if let Some(q) = raw(sample) {
                    each(sample, &q, None);
                }
                continue;
            }
            match &mut run {
                Some(run) => run.step(sample)?,
                None => run = raw(sample).map(|q| Run::new(self.record, variant, q)),
            }
            if let Some(run) = &run {
                each(sample, &run.filter.q_nb, Some(run));
            }
        }
        Ok(())
    }
}

/// Attitude by force and field; without a field at heading zero.
fn raw(sample: &AttitudeSample) -> Option<UnitQuaternion<f64>> {
    let seen = innovation_n(
        &UnitQuaternion::identity(),
        Some(&sample.specific_force_b),
        sample.field_b.as_ref(),
    );
    Some(seen.heading_turn().unwrap_or_default() * seen.levelling()?)
}

impl Run {
    fn new(record: &AttitudeRecord, variant: AttitudeVariant, q_nb: UnitQuaternion<f64>) -> Self {
        let start = record.datasheet;
        let mut filter = InvariantFilter::new(
            ErrorAxes::Navigation,
            q_nb,
            start.tilt[0].measured,
            record.initial_bias.powi(2),
        );
        filter.doubt(0.0, start.heading.measured, 0.0);
        let gate = |patience: f64, settle: f64| match variant {
            AttitudeVariant::DatasheetPlainGate => ArmedGate::plain(),
            _ => ArmedGate::new(patience, settle),
        };
        Run {
            filter,
            adaptation: Adaptation::new(variant, record),
            variant,
            tilt_gate: gate(PUSH_S, PUSH_S),
            heading_gate: gate(IRON_S, HEADING_SETTLES_S),
            field_gate: FieldGate::default(),
            step_s: record.step_s,
        }
    }

    fn step(&mut self, sample: &AttitudeSample) -> Result<()> {
        let gated = self.variant.gated();
        let judges_field = gated && self.variant != AttitudeVariant::DatasheetPlainGate;
        // Length and dip are no innovations: what they refuse may be kept from the monitors too.
        let field = sample
            .field_b
            .filter(|field| !judges_field || self.field_fits(field));
        self.adaptation.before(&AttitudeSample {
            field_b: field,
            ..*sample
        })?;
        let noise = self.adaptation.noise;
        self.filter
            .propagate(&sample.rate_b, self.step_s, &noise.process);
        let knows = self.variant.knows();
        let force = Some(&sample.specific_force_b).filter(|_| !(knows && sample.disturbed[0]));
        let field = field.filter(|_| !(knows && sample.disturbed[1]));
        let mut seen = innovation_n(&self.filter.q_nb, force, field.as_ref());
        if gated && !self.tilt_passes(&seen) {
            // The heading goes on, levelled by the filter itself.
            seen = innovation_n(&self.filter.q_nb, None, field.as_ref());
        }
        let mut used = [seen.tilt.is_some(), seen.heading.is_some()];
        if gated {
            used[1] = self.heading_passes(&seen);
        }
        let nu = half_angles(&seen);
        let axes = [used[0], used[0], used[1]];
        self.filter.update(&nu, axes, &noise.measured);
        self.adaptation.after(&self.filter, &nu, axes);
        Ok(())
    }

    fn field_fits(&mut self, field_b: &Vector3<f64>) -> bool {
        let known = self.tilt_gate.is_armed();
        self.field_gate.fits(field_b, &self.filter.q_nb, known)
    }

    fn tilt_passes(&mut self, seen: &AttitudeInnovation) -> bool {
        if seen.tilt.is_none() {
            return false;
        }
        let (nu, sigma) = self.normalised(seen);
        let noise = 2.0 * sigma.x.hypot(sigma.y) / 2f64.sqrt();
        // An unknown bias must not open the gate while a push lasts.
        let converged = self.filter.tilt_rate_sigma() * self.tilt_gate.patience_s < noise;
        let normalised = [nu.x / sigma.x, nu.y / sigma.y];
        let passage = self.tilt_gate.judge(normalised, self.step_s, converged);
        let off = 4.0 * nu.xy().norm_squared();
        match passage {
            Passage::Use => {}
            Passage::Leave => return false,
            // A wrong tilt turns the heading that the field shows.
            Passage::DoubtAttitude => {
                self.filter.doubt(off, off, 0.0);
                self.heading_gate.disarm();
            }
            Passage::DoubtAll => {
                self.heading_gate.disarm();
                // A bias that has made it so since the gate began to refuse.
                let bias = off / self.tilt_gate.patience_s.powi(2);
                self.filter.doubt(off, off, bias);
            }
        }
        true
    }

    /// The heading never holds up the tilt.
    fn heading_passes(&mut self, seen: &AttitudeInnovation) -> bool {
        if seen.heading.is_none() {
            return false;
        }
        let (nu, sigma) = self.normalised(seen);
        let passage = self
            .heading_gate
            .judge([nu.z / sigma.z, 0.0], self.step_s, true);
        match passage {
            Passage::Use => {}
            Passage::Leave => return false,
            Passage::DoubtAttitude | Passage::DoubtAll => {
                self.filter.doubt(0.0, 4.0 * nu.z * nu.z, 0.0);
            }
        }
        true
    }

    /// Half angles of an innovation, and what they should scatter by.
    fn normalised(&self, seen: &AttitudeInnovation) -> (Vector3<f64>, Vector3<f64>) {
        let s = self
            .filter
            .innovation_covariance(&self.adaptation.noise.measured);
        (half_angles(seen), s.diagonal().map(f64::sqrt))
    }
}

/// What is not seen is zero.
fn half_angles(seen: &AttitudeInnovation) -> Vector3<f64> {
    let [north, east] = seen.tilt.unwrap_or_default();
    Vector3::new(north, east, seen.heading.unwrap_or_default()) * 0.5
}

/// Sums over a run.
struct Sums {
    step_s: f64,
    datasheet: [f64; 2],
    seen: usize,
    /// Count, and of pitch, roll and heading error: sums and sums of squares.
    count: f64,
    sums: [f64; 3],
    squares: [f64; 3],
    with_truth: bool,
    origin: Option<[f64; 3]>,
    tilt: f64,
    lost: usize,
    longest_lost: usize,
    noise: [f64; 2],
    refused: f64,
    accepted: Option<[u32; 2]>,
}

impl Sums {
    fn new(record: &AttitudeRecord) -> Self {
        let tilt = record.datasheet.tilt[0];
        Sums {
            step_s: record.step_s,
            datasheet: [tilt.process, tilt.measured],
            seen: 0,
            count: 0.0,
            sums: [0.0; 3],
            squares: [0.0; 3],
            with_truth: false,
            origin: None,
            tilt: 0.0,
            lost: 0,
            longest_lost: 0,
            noise: [0.0; 2],
            refused: 0.0,
            accepted: None,
        }
    }

    fn push(&mut self, sample: &AttitudeSample, q_nb: &UnitQuaternion<f64>, run: Option<&Run>) {
        self.seen += 1;
        let of = |q: &UnitQuaternion<f64>| {
            let angles = Euler::from_quaternion(q);
            [angles.pitch, angles.roll, angles.heading]
        };
        let mut angles = of(q_nb);
        if let Some(truth) = &sample.truth_q_nb {
            self.with_truth = true;
            for (angle, truth) in angles.iter_mut().zip(of(truth)) {
                *angle = wrap_angle(*angle - truth);
            }
            // Without heading: what is left of the vertical.
            let up = log(&(truth * q_nb.inverse())).xy().norm_squared();
            self.tilt += 0.5 * up;
            self.lost = if up > LOST * LOST { self.lost + 1 } else { 0 };
            self.longest_lost = self.longest_lost.max(self.lost);
        }
        if let Some(run) = run {
            let used = run.adaptation.tilt();
            for (sum, (used, told)) in self.noise.iter_mut().zip(used.iter().zip(self.datasheet)) {
                *sum += used / told;
            }
            self.refused += f64::from(u8::from(run.filter.gain[(0, 0)] == 0.0));
            self.accepted = run.adaptation.tilt_counts();
        }
        if (self.seen as f64) * self.step_s < FROM_S {
            return;
        }
        // About the first value: no digits are lost to a mean that is large.
        let origin = if self.with_truth {
            [0.0; 3]
        } else {
            *self.origin.get_or_insert(angles)
        };
        self.count += 1.0;
        for i in 0..3 {
            let angle = wrap_angle(angles[i] - origin[i]);
            self.sums[i] += angle;
            self.squares[i] += angle * angle;
        }
    }

    fn errors(&self) -> AttitudeErrors {
        let (n, all) = (self.count.max(2.0), (self.seen as f64).max(1.0));
        let deviation =
            |i: usize| ((self.squares[i] - self.sums[i].powi(2) / n).max(0.0) / (n - 1.0)).sqrt();
        let truth = |value: f64| self.with_truth.then_some(value);
        AttitudeErrors {
            pitch_std: deviation(0),
            roll_std: deviation(1),
            rms: self
                .with_truth
                .then(|| self.squares.map(|sum| (sum / n).sqrt())),
            tilt_rms_from_start: truth((self.tilt / all).sqrt()),
            longest_lost_s: self.longest_lost as f64 * self.step_s,
            accepted: self.accepted,
            noise_ratio: self.noise.map(|sum| sum / all),
            refused: self.refused / all,
        }
    }
}
