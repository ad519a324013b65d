//! Belokurov 2018: Q and R of an attitude filter from its own innovations, on an ADIS16405 at rest, in motion and disturbed.

use super::figure::{Figure, Panel, Series};
use super::spread::spread;
use super::{Reproduced, Row};
use crate::failure::Failure;
use insnav_core::metrics::Estimate;
use insnav_core::sim::{
    AttitudeCase, AttitudeErrors, AttitudeRecord, AttitudeTrial, AttitudeVariant,
};
use insnav_log::RunError;

/// Length of a slice of a real record, s: that of the simulated ones.
pub(crate) const SLICE_S: f64 = 180.0;
/// What the drawing shows of the first run, s.
const DRAWN_S: [f64; 2] = [30.0, 94.0];

/// How much of it.
#[derive(Clone, Debug)]
pub(crate) struct AttitudeRequest {
    pub(crate) runs: usize,
    pub(crate) seed: u64,
    pub(crate) jobs: usize,
    /// Of a real unit at rest, in steps of 32 ms.
    pub(crate) real: Option<AttitudeRecord>,
}

/// The experiment, made.
#[derive(Debug)]
pub(crate) struct AttitudeExperiment {
    request: AttitudeRequest,
    parts: Vec<Part>,
}

/// One case; `None` is the real unit.
#[derive(Debug)]
struct Part {
    case: Option<AttitudeCase>,
    /// One sigma of a tilt that no filter goes below, rad.
    limit: Option<f64>,
    variants: Vec<AttitudeVariant>,
    /// By run, then by variant.
    errors: Vec<Vec<AttitudeErrors>>,
}

impl AttitudeExperiment {
    /// Make all cases.
    pub(crate) fn run(request: AttitudeRequest) -> Result<Self, Failure> {
        let first = request.seed.wrapping_mul(1 << 32);
        let seed = |run: usize| first.wrapping_add(run as u64);
        let variants = AttitudeVariant::ALL.to_vec();
        let mut parts = Vec::new();
        for case in AttitudeCase::ALL {
            let errors = spread(name(Some(case)), request.jobs, request.runs, |run| {
                all(&AttitudeRecord::simulate(case, seed(run)), &variants)
            })?;
            let record = AttitudeRecord::simulate(case, seed(0));
            parts.push(Part {
                case: Some(case),
                limit: AttitudeTrial::new(&record)
                    .limit()
                    .filter(|_| case.is_stationary()),
                variants: variants.clone(),
                errors,
            });
        }
        if let Some(real) = &request.real {
            let slices = real.slices(SLICE_S);
            let known = |v: &AttitudeVariant| {
                !matches!(v, AttitudeVariant::Oracle | AttitudeVariant::OracleFullR)
            };
            let variants: Vec<AttitudeVariant> = variants.into_iter().filter(known).collect();
            let errors = spread(name(None), request.jobs, slices.len(), |i| {
                all(&slices[i], &variants)
            })?;
            parts.push(Part {
                case: None,
                limit: None,
                variants,
                errors,
            });
        }
        Ok(AttitudeExperiment { request, parts })
    }

    /// The table.
    pub(crate) fn report(&self) -> Reproduced {
        Reproduced {
            paper: "belokurov2018",
            runs: self.request.runs,
            independent_runs: self.request.runs,
            seed: self.request.seed,
            assumptions: assumptions(),
            rows: self.parts.iter().flat_map(Part::rows).collect(),
        }
    }

    /// The paper's figures 2 and 3, of the first run at rest (of the real unit where there is one).
    pub(crate) fn figure(&self) -> Result<String, Failure> {
        let simulated;
        let real = self.request.real.as_ref();
        let record = match real.and_then(|real| real.slices(SLICE_S).into_iter().next()) {
            Some(slice) => slice,
            None => {
                simulated = self.request.seed.wrapping_mul(1 << 32);
                AttitudeRecord::simulate(AttitudeCase::Static, simulated)
            }
        };
        let trial = AttitudeTrial::new(&record);
        let shown = [
            (AttitudeVariant::PaperRecursion, "algorithm [19], as quoted"),
            (AttitudeVariant::AlsM40Nnls, "proposed, M = 40 (NNLS)"),
            (AttitudeVariant::AlsMonitor, "monitors with test of fit"),
        ];
        let mut panels = [("2: pitch", Vec::new()), ("3: roll", Vec::new())];
        for (variant, label) in shown {
            let points = trial.trace(variant).map_err(RunError::from)?;
            let drawn = points
                .iter()
                .filter(|p| (DRAWN_S[0]..DRAWN_S[1]).contains(&p.time_s));
            let about = |of: &dyn Fn(&insnav_core::sim::AttitudePoint) -> (f64, Option<f64>)| {
                let values: Vec<(f64, f64, Option<f64>)> = drawn
                    .clone()
                    .map(|p| (p.time_s, of(p).0, of(p).1))
                    .collect();
                // Of a real unit nobody knows the truth: about the mean.
                let mean = values.iter().map(|v| v.1).sum::<f64>() / values.len().max(1) as f64;
                values
                    .into_iter()
                    .map(|(t, angle, truth)| [t, (angle - truth.unwrap_or(mean)).to_degrees(), 0.0])
                    .collect::<Vec<_>>()
            };
            for ((_, series), points) in panels.iter_mut().zip([
                about(&|p| (p.pitch, p.truth.map(|t| t[1]))),
                about(&|p| (p.roll, p.truth.map(|t| t[0]))),
            ]) {
                series.push(Series {
                    name: label,
                    points,
                });
            }
        }
        Ok(Figure {
            title: "Pitch and roll of an ADIS16405 at rest (Belokurov 2018, figures 2 and 3)"
                .to_owned(),
            about: "About their true values, of a real unit about the mean; 2000 samples of 32 ms, as in the paper's figures.",
            panels: panels
                .into_iter()
                .map(|(title, series)| Panel {
                    title,
                    axis: "angle less its true value, °",
                    series,
                })
                .collect(),
        }
        .svg())
    }
}

fn all(
    record: &AttitudeRecord,
    variants: &[AttitudeVariant],
) -> Result<Vec<AttitudeErrors>, Failure> {
    let trial = AttitudeTrial::new(record);
    let run = |variant: &AttitudeVariant| Ok(trial.run(*variant).map_err(RunError::from)?);
    variants.iter().map(run).collect()
}

impl Part {
    fn rows(&self) -> Vec<Row> {
        let each = self.variants.iter().enumerate();
        each.flat_map(|(i, variant)| self.of(*variant, i)).collect()
    }

    fn of(&self, variant: AttitudeVariant, i: usize) -> Vec<Row> {
        let errors = || self.errors.iter().map(|run| &run[i]);
        let row = |quantity| Row {
            case: name(self.case),
            variant: variant.name(),
            quantity,
            published: self.published(variant, quantity),
            ours: None,
            standard_error: None,
            stated: None,
            limit: None,
            note: note(self.case, variant)
                .filter(|_| quantity.ends_with("std_deg"))
                .map(str::to_owned),
        };
        let degrees = |quantity, squares: Vec<f64>| {
            let found = Estimate::root_mean_square(&squares);
            Row {
                ours: Some(found.value.to_degrees()),
                standard_error: found.standard_error.map(f64::to_degrees),
                ..row(quantity)
            }
        };
        let std = |quantity, of: &dyn Fn(&AttitudeErrors) -> f64| {
            degrees(quantity, errors().map(|e| of(e).powi(2)).collect())
        };
        let rms = |quantity, angle: usize, limit: Option<f64>| {
            let squares: Option<Vec<f64>> = errors()
                .map(|e| e.rms.map(|rms| rms[angle].powi(2)))
                .collect();
            Row {
                limit: limit.map(f64::to_degrees),
                ..squares.map_or_else(|| row(quantity), |squares| degrees(quantity, squares))
            }
        };
        // Roll is a tilt over the cosine of pitch.
        let level = !matches!(
            self.case,
            Some(AttitudeCase::Motion6Dps | AttitudeCase::Motion40Dps)
        );
        let mut rows = vec![
            std("pitch_std_deg", &|e| e.pitch_std),
            std("roll_std_deg", &|e| e.roll_std),
            rms("pitch_rms_deg", 0, self.limit),
            rms("roll_rms_deg", 1, self.limit.filter(|_| level)),
        ];
        if self.case.is_some() {
            rows.push(rms("heading_rms_deg", 2, None));
            let lost = errors().map(|e| e.longest_lost_s).fold(0.0, f64::max);
            rows.push(Row {
                ours: Some(lost),
                ..row("longest_lost_s")
            });
        }
        if variant != AttitudeVariant::Raw {
            let mean = |quantity, of: &dyn Fn(&AttitudeErrors) -> f64| {
                let found = Estimate::mean(&errors().map(of).collect::<Vec<_>>());
                Row {
                    ours: Some(found.value),
                    standard_error: found.standard_error,
                    ..row(quantity)
                }
            };
            rows.push(mean("process_noise_ratio", &|e| e.noise_ratio[0]));
            rows.push(mean("measured_noise_ratio", &|e| e.noise_ratio[1]));
        }
        if let Some([accepted, blocks]) = errors()
            .map(|e| e.accepted)
            .reduce(|a, b| Some([a?[0] + b?[0], a?[1] + b?[1]]))
            .flatten()
        {
            rows.push(Row {
                ours: Some(100.0 * f64::from(accepted) / f64::from(blocks.max(1))),
                ..row("accepted_percent")
            });
        }
        rows
    }

    /// The paper's table, of a unit at rest.
    fn published(&self, variant: AttitudeVariant, quantity: &str) -> Option<f64> {
        if !matches!(self.case, None | Some(AttitudeCase::Static)) {
            return None;
        }
        match (variant, quantity) {
            (AttitudeVariant::PaperRecursion, "pitch_std_deg") => Some(0.11),
            (AttitudeVariant::PaperRecursion, "roll_std_deg") => Some(0.13),
            (AttitudeVariant::AlsM40AsPrinted, "pitch_std_deg") => Some(0.061),
            (AttitudeVariant::AlsM40AsPrinted, "roll_std_deg") => Some(0.034),
            _ => None,
        }
    }
}

fn name(case: Option<AttitudeCase>) -> &'static str {
    match case {
        None => "real_imu",
        Some(AttitudeCase::Static) => "static",
        Some(AttitudeCase::StaticQuantised) => "static_quantised",
        Some(AttitudeCase::Motion6Dps) => "motion_6dps",
        Some(AttitudeCase::Motion40Dps) => "motion_40dps",
        Some(AttitudeCase::Vibration) => "vibration",
        Some(AttitudeCase::Bursts0p3) => "bursts_0p3",
        Some(AttitudeCase::Bursts1p0) => "bursts_1p0",
        Some(AttitudeCase::MagneticStep) => "magnetic_step",
    }
}

fn note(case: Option<AttitudeCase>, variant: AttitudeVariant) -> Option<&'static str> {
    let at_rest = matches!(case, None | Some(AttitudeCase::Static));
    match variant {
        AttitudeVariant::PaperRecursion if at_rest => Some(
            "the paper tells neither its R nor its start; what it publishes is the scatter of the raw angle, which a filter has with an R \
             that is too small (see mohamed_schwarz_r_over_10). Here with the true R",
        ),
        AttitudeVariant::AlsM40AsPrinted if at_rest => Some(
            "corrected equations, without constraint, as in the paper; what comes out negative is replaced by a hundredth of the start \
             (the paper does not tell). Published for pitch and roll: 0.061 and 0.034 of one unit, one record of unknown length",
        ),
        AttitudeVariant::MohamedSchwarzFair if case.is_none() => Some(
            "the true R is not known of a real unit: the tilt's variance by differences of neighbouring samples",
        ),
        AttitudeVariant::AlsMonitorQX100
            if matches!(
                case,
                Some(AttitudeCase::Bursts0p3 | AttitudeCase::Bursts1p0)
            ) =>
        {
            Some(
                "held at a start that is wrong: no stretch of 12.8 s is without a push, so that nothing is accepted, and with this Q the \
                 gate follows the pushes",
            )
        }
        _ => None,
    }
}

fn assumptions() -> Vec<String> {
    [
        "ADIS16405 by its data sheet, samples of 32 ms: 2 °/√h, 0.2 m/s/√h (tilt 0.109°), 0.066 mG/√Hz, bias wander of 0.007 °/s in 100 s as a random walk, 0.5 °/s at power-on; no accelerometer bias; \
         static_quantised rounds to 0.05 °/s, 3.33 mg and 0.5 mG",
        "180 s a run, errors from 30 s on (vibration: 250 s, 100 s to 200 s with five times the accelerometer noise); adaptation begins at 20 s, from the data sheet; std is that of the error about its mean, \
         as in the paper's table; rms is against the truth",
        "bursts: horizontal pushes of 0.5 s to 2 s in any direction with 3 s to 9 s between, the first within 3 s of the begin; magnetic_step: a tenth of the field in any direction from 80 s to 110 s",
        "one filter for all rows: gyro quaternion corrected by that of accelerometer and magnetometer, six states, navigation-frame error; rows differ in Q, R and gate. limit: Riccati equation with the whole R (oracle_full_r); with a \
         diagonal R, as in the paper and all other rows, it is 0.0253°",
        "mohamed_schwarz_*: window of 40 of innovations (Q = L C Lᵀ) or residuals (R = C + H P Hᵀ); als_long: fixed-gain filters, all innovations so far; als_monitor: block by block with test of fit, hold, and a gate at four sigmas \
         that is armed by agreement; *_plain_gate: the gate that locks out",
        "longest_lost_s: longest time with a tilt off by more than 0.25°, of all runs, from the first sample on; *_noise_ratio: what the filter used of Q and R against the data sheet, mean over time",
        "real_imu: slices of 180 s of the record given by --imu, resampled to 32 ms, with a simulated magnetometer; no truth, so that std alone is told, and a slow wander of the accelerometers counts as the body's",
    ]
    .map(str::to_owned)
    .to_vec()
}
