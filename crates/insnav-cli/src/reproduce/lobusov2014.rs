//! Lobusov & Fomichev 2014: drifts and azimuth of a navigation-grade unit from stops, and what they leave of an hour.

use super::figure::{Figure, Panel, Series};
use super::spread::spread;
use super::{Reproduced, Row};
use crate::failure::Failure;
use insnav_core::metrics::Estimate;
use insnav_core::sim::{DriftCase, DriftErrors, DriftTrial, DriftVariant, SwayPoint};
use insnav_log::RunError;
use std::f64::consts::PI;

/// A drift of the paper, rad/s: errors are told in per cent of it.
const DRIFT: f64 = 1e-7;
const ARCMIN: f64 = PI / 180.0 / 60.0;
/// What the paper found of its drifts while rocking, per cent: right, forward, up.
const PUBLISHED: [f64; 3] = [6.5, 1.4, 0.5];

/// How much of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DriftRequest {
    /// Of the noisy case; the others are made once.
    pub(crate) runs: usize,
    pub(crate) seed: u64,
    pub(crate) jobs: usize,
}

/// The experiment, made.
#[derive(Debug)]
pub(crate) struct DriftExperiment {
    request: DriftRequest,
    parts: Vec<Part>,
}

/// One case with one set of drifts.
#[derive(Debug)]
struct Part {
    case: DriftCase,
    east: bool,
    /// Sigmas that no unbiased estimator goes below: horizontal drift, rad/s, and azimuth, rad.
    limits: [f64; 2],
    /// By run, then by variant.
    errors: Vec<Vec<DriftErrors>>,
}

impl DriftExperiment {
    /// Make all cases.
    pub(crate) fn run(request: DriftRequest) -> Result<Self, Failure> {
        let mut parts = Vec::new();
        for case in DriftCase::ALL {
            // Drifts by chance have no set.
            let sets: &[bool] = if case.is_random() {
                &[true]
            } else {
                &[false, true]
            };
            for east in sets {
                let trial = DriftTrial::new(case, *east);
                let runs = if case.is_random() { request.runs } else { 1 };
                let first = request.seed.wrapping_mul(1 << 32);
                let errors = spread(name(case, *east), request.jobs, runs, |run| {
                    Ok(trial
                        .run(first.wrapping_add(run as u64))
                        .map_err(RunError::from)?)
                })?;
                parts.push(Part {
                    case,
                    east: *east,
                    limits: trial.limits(),
                    errors,
                });
            }
        }
        Ok(DriftExperiment { request, parts })
    }

    /// The table.
    pub(crate) fn report(&self) -> Reproduced {
        Reproduced {
            paper: "lobusov2014",
            runs: self.request.runs,
            independent_runs: self.request.runs,
            seed: self.request.seed,
            assumptions: assumptions(),
            rows: self.parts.iter().flat_map(Part::rows).collect(),
        }
    }

    /// The paper's figures 1–4, with the drifts of a part along east, and our own rocking in place of its fifth, whose record is not
    /// given.
    pub(crate) fn figure() -> Result<String, Failure> {
        let points = DriftTrial::figures(true).map_err(RunError::from)?;
        let sway = DriftTrial::sway_figure(true);
        let swaying = |name, of: &dyn Fn(&SwayPoint) -> f64| Series {
            name,
            points: sway.iter().map(|p| [p.time_s, of(p), 0.0]).collect(),
        };
        let series = |name, of: &dyn Fn(&insnav_core::sim::DriftPoint) -> f64| Series {
            name,
            points: points.iter().map(|p| [p.time_s, of(p), 0.0]).collect(),
        };
        let panel = |title, axis, series| Panel {
            title,
            axis,
            series,
        };
        Ok(Figure {
            title: "Drifts of 1e-7 rad/s, found from 40 s to 200 s and taken out then (Lobusov & Fomichev 2014, figures 1–4)"
                .to_owned(),
            about: "Above: one position, still, without noise; at 200 s drifts are taken out and the velocity is set to zero. Below: our own rocking (0.04 rad, 7 s and 11 s, lever arm 1.2 m, 50 µg) in place of figure 5.",
            panels: vec![
                panel(
                    "1: drifts by the data so far",
                    "drift, nrad/s",
                    vec![
                        series("forward", &|p| p.level_drift[0] * 1e9),
                        series("right", &|p| p.level_drift[1] * 1e9),
                    ],
                ),
                panel(
                    "2, 3: change of attitude",
                    "rotation vector, µrad",
                    vec![
                        series("north", &|p| p.turned_n.x * 1e6),
                        series("east", &|p| p.turned_n.y * 1e6),
                        series("down (yaw)", &|p| p.turned_n.z * 1e6),
                    ],
                ),
                panel(
                    "4: Schuler oscillation",
                    "velocity, m/s",
                    vec![
                        series("north", &|p| p.velocity_n[0]),
                        series("east", &|p| p.velocity_n[1]),
                    ],
                ),
                panel(
                    "5a: a rocking stop, attitude",
                    "angle, °",
                    vec![
                        swaying("roll", &|p| p.level[0].to_degrees()),
                        swaying("pitch", &|p| p.level[1].to_degrees()),
                    ],
                ),
                panel(
                    "5b: velocity of the unit",
                    "velocity, m/s",
                    vec![
                        swaying("north", &|p| p.velocity_n[0]),
                        swaying("east", &|p| p.velocity_n[1]),
                    ],
                ),
                panel(
                    "5c: error of the drift by the data so far",
                    "log₁₀ of its largest component, nrad/s",
                    vec![
                        swaying("with taper", &|p| (p.drift_error[0] * 1e9).log10()),
                        swaying("without", &|p| (p.drift_error[1] * 1e9).log10()),
                    ],
                ),
            ],
        }
        .svg())
    }
}

impl Part {
    fn rows(&self) -> Vec<Row> {
        let all = self.case.variants().iter().enumerate();
        all.flat_map(|(i, variant)| {
            let of = |run: &Vec<DriftErrors>| run[i];
            let errors: Vec<DriftErrors> = self.errors.iter().map(of).collect();
            match self.case {
                case if case.is_random() => self.noisy(*variant, &errors),
                DriftCase::FreeRun => vec![
                    Row {
                        ours: errors[0].velocity_max,
                        ..self.row(*variant, "velocity_max_m_per_s")
                    },
                    Row {
                        ours: errors[0].yaw_max,
                        ..self.row(*variant, "yaw_change_max_rad")
                    },
                ],
                _ => self.exact(*variant, &errors[0]),
            }
        })
        .collect()
    }

    fn row(&self, variant: DriftVariant, quantity: &'static str) -> Row {
        Row {
            case: name(self.case, self.east),
            variant: variant_name(variant),
            quantity,
            published: None,
            ours: None,
            standard_error: None,
            stated: None,
            limit: None,
            note: note(self.case, self.east, variant).map(str::to_owned),
        }
    }

    /// Without noise: errors in per cent of a drift, in the paper's axes.
    fn exact(&self, variant: DriftVariant, errors: &DriftErrors) -> Vec<Row> {
        let percent = errors.drift * (100.0 / DRIFT);
        let paper = [percent.y, percent.x, -percent.z];
        let names = [
            "drift_error_right_percent",
            "drift_error_forward_percent",
            "drift_error_up_percent",
        ];
        let published = self.case == DriftCase::SwayNoiseFree && !self.east;
        let mut rows = vec![Row {
            ours: Some(percent.amax()),
            published: published.then_some(PUBLISHED[0]),
            ..self.row(variant, "drift_error_percent")
        }];
        for ((name, ours), theirs) in names.into_iter().zip(paper).zip(PUBLISHED) {
            rows.push(Row {
                ours: Some(ours),
                published: published.then_some(theirs),
                ..self.row(variant, name)
            });
        }
        rows.push(Row {
            ours: Some(errors.azimuth / ARCMIN),
            ..self.row(variant, "azimuth_error_arcmin")
        });
        rows
    }

    /// With noise: root mean squares over the runs beside what is stated, and the limit.
    fn noisy(&self, variant: DriftVariant, errors: &[DriftErrors]) -> Vec<Row> {
        let states = variant != DriftVariant::Paper;
        // The limit is that of two positions.
        let limited = self.case == DriftCase::RealisticNoise;
        let mut rows = Vec::new();
        let mut push = |quantity, of: &dyn Fn(&DriftErrors) -> [f64; 2], limit: Option<f64>| {
            let squares: Vec<f64> = errors.iter().map(|e| of(e)[0].powi(2)).collect();
            let stated: Vec<f64> = errors.iter().map(|e| of(e)[1].powi(2)).collect();
            let ours = Estimate::root_mean_square(&squares);
            rows.push(Row {
                ours: Some(ours.value),
                standard_error: ours.standard_error,
                stated: states.then(|| Estimate::root_mean_square(&stated).value),
                limit,
                ..self.row(variant, quantity)
            });
        };
        let horizontal = |v: &nalgebra::Vector3<f64>| v.xy().norm() / 2f64.sqrt() * 1e9;
        push(
            "drift_rms_nrad_per_s",
            &|e| [horizontal(&e.drift), horizontal(&e.drift_sigma)],
            limited.then_some(self.limits[0] * 1e9),
        );
        push(
            "drift_vertical_rms_nrad_per_s",
            &|e| [e.drift.z * 1e9, e.drift_sigma.z * 1e9],
            None,
        );
        push(
            "azimuth_rms_arcmin",
            &|e| [e.azimuth / ARCMIN, e.azimuth_sigma / ARCMIN],
            limited.then_some(self.limits[1] / ARCMIN),
        );
        rows
    }
}

/// Name of a case with its set of drifts.
fn name(case: DriftCase, east: bool) -> &'static str {
    match (case, east) {
        (DriftCase::StaticNoiseFree, false) => "static_noise_free_no_east",
        (DriftCase::StaticNoiseFree, true) => "static_noise_free_east",
        (DriftCase::SwayNoiseFree, false) => "sway_noise_free_no_east",
        (DriftCase::SwayNoiseFree, true) => "sway_noise_free_east",
        (DriftCase::Quantised, false) => "quantised_no_east",
        (DriftCase::Quantised, true) => "quantised_east",
        (DriftCase::AccelBias, false) => "accel_bias_no_east",
        (DriftCase::AccelBias, true) => "accel_bias_east",
        (DriftCase::RealisticNoise, _) => "realistic_noise",
        (DriftCase::Zupt2, false) => "zupt2_no_east",
        (DriftCase::Zupt2, true) => "zupt2_east",
        (DriftCase::FreeRun, false) => "free_run_no_east",
        (DriftCase::FreeRun, true) => "free_run_east",
        (DriftCase::FourPositions, false) => "four_positions_no_east",
        (DriftCase::FourPositions, true) => "four_positions_east",
        (DriftCase::FourPositionsNoise, _) => "four_positions_noise",
    }
}

fn variant_name(variant: DriftVariant) -> &'static str {
    match variant {
        DriftVariant::Paper => "paper",
        DriftVariant::Joint => "joint",
        DriftVariant::Kalman => "kalman",
        DriftVariant::None => "uncompensated",
    }
}

fn note(case: DriftCase, east: bool, variant: DriftVariant) -> Option<&'static str> {
    match (case, variant) {
        (DriftCase::SwayNoiseFree, DriftVariant::Paper) => Some(
            "our reading of the paper's equations, which tell neither loop nor rocking, with an accelerometer bias of 50 µg and a \
             lever arm that the paper may not have had: only the order is comparable",
        ),
        (DriftCase::SwayNoiseFree, _) => Some(
            "another record of rocking than the paper's, which is not given: two orders, not a ratio of digits",
        ),
        (DriftCase::StaticNoiseFree, _) if !east => Some(
            "these drifts have no part along east, so that the azimuth is right before any correction: the azimuth's half of \
             ZUPT-1 is tested by the other set",
        ),
        (DriftCase::RealisticNoise, DriftVariant::Paper) => Some(
            "the paper's per cents are those of a unit without noise: 1.4 % of 1e-7 rad/s in two stops of 160 s takes less than \
             1e-4 °/√h",
        ),
        _ => None,
    }
}

fn assumptions() -> Vec<String> {
    [
        "200 Hz increments, latitude 60°, azimuth 45°, drifts of 1e-7 rad/s, stops at 40–200 s and 220–380 s, turned by 180° in between (the paper tells its windows, not its turn)",
        "drifts of `_no_east` are the paper's (1, −1, 1)e-7 along right, forward, up, of `_east` (1, 1, 1)e-7 along forward, right, down; errors are told along right, forward, up",
        "`paper`: levelling loop with a triple pole of 0.1 rad/s, its integrator averaged over the second half of the stop; quadratic fits of velocity, slope of yaw, equations (6)–(8), for zupt2 (14)–(15)",
        "rocking: 0.04 rad in roll (7 s) and pitch (11 s), lever arm (0.5, 0.5, −1.0) m, 50 µg; quantised: 1″ and 1 mm/s; accel_bias: 500 µg on every axis",
        "four_positions: four stops of 80 s a quarter turn apart, 50 µg; four_positions_noise: with the noise of realistic_noise",
        "realistic_noise: 0.001 °/√h, 5 µg/√Hz; drifts and biases by chance with 1e-7 rad/s and 50 µg",
    ]
    .map(str::to_owned)
    .to_vec()
}
