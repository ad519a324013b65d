//! Kozadaev & Makarenko 2017, table of section 4: what a filter makes of a stop of 300 s.

mod limits;
mod published;

use super::figure::{Figure, Panel, Series};
use super::spread::spread;
use super::{Reproduced, Row};
use crate::failure::Failure;
use insnav_core::metrics::Estimate;
use insnav_core::sim::{
    MeanSquares, StaticRecord, StopEndErrors, StopErrors, StopFlags, StopSetting, StopVariant,
};
use insnav_log::RunError;
use limits::Limits;
use published::{Published, note};

/// What is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Case {
    /// Simulated sensors, one stop.
    Stop,
    /// Simulated sensors, three drives of a minute between four stops.
    MultiStop,
    /// A real unit at rest, a simulated receiver.
    RealImu,
}

impl Case {
    fn name(self) -> &'static str {
        match self {
            Case::Stop => "stop_300s",
            Case::MultiStop => "multi_stop",
            Case::RealImu => "real_imu",
        }
    }

    /// What it spans, in words.
    fn span(self) -> String {
        let setting = match self {
            Case::MultiStop => StopSetting::multi_stop(),
            Case::Stop | Case::RealImu => StopSetting::paper(),
        };
        match setting.stops().len() {
            1 => format!("a stop of {:.0} s", setting.stop_s),
            n => format!(
                "{n} stops of {:.0} s with drives between them",
                setting.stop_s
            ),
        }
    }
}

/// How much of it.
#[derive(Debug)]
pub(crate) struct Request {
    pub(crate) runs: usize,
    pub(crate) seed: u64,
    pub(crate) jobs: usize,
    pub(crate) multi_stop: bool,
    /// In place of the simulated unit.
    pub(crate) record: Option<StaticRecord>,
}

/// The experiment, made.
#[derive(Debug)]
pub(crate) struct Experiment {
    case: Case,
    request: Request,
    /// By run, then by variant.
    errors: Vec<Vec<StopErrors>>,
}

/// Variants in the order of the rows.
fn variants() -> impl Iterator<Item = StopVariant> {
    StopVariant::COMPARED
        .into_iter()
        .chain(StopVariant::CONTROLS)
}

/// Between the seeds of neighbouring experiments: more than anybody runs.
const RUNS_PER_SEED: u64 = 1 << 32;

impl Experiment {
    /// Make all runs.
    pub(crate) fn run(request: Request) -> Result<Self, Failure> {
        let (case, setting) = match (&request.record, request.multi_stop) {
            (Some(_), _) => (Case::RealImu, StopSetting::paper()),
            (None, true) => (Case::MultiStop, StopSetting::multi_stop()),
            (None, false) => (Case::Stop, StopSetting::paper()),
        };
        let first = request.seed.wrapping_mul(RUNS_PER_SEED);
        let errors = spread(case.name(), request.jobs, request.runs, |run| {
            let seed = first.wrapping_add(run as u64);
            let trial = match &request.record {
                Some(record) => record.trial(&setting, run, request.runs, seed),
                None => setting.trial(seed),
            }
            .map_err(RunError::from)?;
            variants()
                .map(|variant| {
                    let errors = trial.run(variant, StopFlags::Exact);
                    Ok(errors.map_err(RunError::from)?)
                })
                .collect()
        })?;
        Ok(Experiment {
            case,
            request,
            errors,
        })
    }

    /// The table.
    pub(crate) fn report(&self) -> Reproduced {
        let limits = Limits::of(self);
        let rows = variants()
            .enumerate()
            .flat_map(|(i, variant)| self.rows(i, variant, &limits.of_variant(variant)))
            .collect();
        Reproduced {
            paper: "kozadaev2017",
            runs: self.request.runs,
            independent_runs: self.independent_runs(),
            seed: self.request.seed,
            assumptions: self.assumptions(),
            rows,
        }
    }

    /// Runs that share no inertial sample; slices of a record that overlap show the same errors of the unit again.
    fn independent_runs(&self) -> usize {
        let room = self.request.record.as_ref().map_or(usize::MAX, |record| {
            record.independent_trials(&StopSetting::paper())
        });
        self.request.runs.min(room)
    }

    /// A standard error over the runs as one over those that are independent. For what comes from the receiver, which is drawn
    /// anew for each run, it is too large.
    fn honest(&self, ours: &Estimate) -> Option<f64> {
        let independent = self.independent_runs();
        let wider = (self.request.runs as f64 / independent as f64).sqrt();
        let error = ours.standard_error.and_then(|error| finite(error * wider));
        error.filter(|_| independent > 1)
    }

    fn of(&self, variant: usize) -> impl Iterator<Item = &StopErrors> {
        self.errors.iter().map(move |run| &run[variant])
    }

    fn rows(&self, index: usize, variant: StopVariant, limits: &Limits) -> Vec<Row> {
        let rms = |of: &dyn Fn(&StopErrors) -> f64| {
            Estimate::root_mean_square(&self.of(index).map(of).collect::<Vec<f64>>())
        };
        let mean = |of: &dyn Fn(&StopErrors) -> f64| {
            Estimate::mean(&self.of(index).map(of).collect::<Vec<f64>>())
        };
        let published = Published::of(self.case, variant);
        let row = |quantity, ours: Estimate, published, stated: Option<f64>, limit| Row {
            case: self.case.name(),
            variant: variant.name(),
            quantity,
            published,
            ours: finite(ours.value),
            standard_error: self.honest(&ours),
            stated: stated.and_then(finite),
            limit,
            note: note(self.case, variant, quantity),
        };
        // An error over the stops, beside what the filter states of it.
        let over_stops =
            |quantity, of: fn(&MeanSquares) -> f64, unit: f64, published, limit: Option<f64>| {
                let ours = rms(&|e| of(&e.standing) * unit * unit);
                let stated = rms(&|e| of(&e.standing_stated) * unit * unit).value;
                row(quantity, ours, published, Some(stated), limit)
            };
        let deg = 1f64.to_degrees();
        let counted = |e: &StopErrors| -> Vec<StopEndErrors> { self.counted_ends(e).to_vec() };
        // A mean over the ends of stops that count.
        let ends = |e: &StopErrors, of: &dyn Fn(&StopEndErrors) -> f64| {
            let ends = counted(e);
            ends.iter().map(of).sum::<f64>() / ends.len() as f64
        };
        let heading = rms(&|e| ends(e, &|s| (s.heading_error * deg).powi(2)));
        let sigma = rms(&|e| ends(e, &|s| (s.heading_sigma * deg).powi(2)));
        let mut rows = vec![
            over_stops(
                "horizontal_rms_m",
                |m| m.horizontal,
                1.0,
                published.map(|p| p.horizontal),
                limits.horizontal,
            ),
            over_stops(
                "height_rms_m",
                |m| m.height,
                1.0,
                published.map(|p| p.height),
                limits.height,
            ),
            over_stops(
                "velocity_rms_m_per_s",
                |m| m.velocity,
                1.0,
                published.map(|p| p.velocity),
                Some(0.0),
            ),
            over_stops(
                "roll_pitch_rms_deg",
                |m| m.roll_pitch,
                deg,
                published.map(|p| p.roll_pitch),
                limits.roll_pitch,
            ),
            row(
                "heading_end_rms_deg",
                heading,
                published.map(|p| p.heading),
                Some(sigma.value),
                limits.heading,
            ),
            row("heading_end_sigma_deg", sigma, None, None, None),
            row(
                "heading_end_nees",
                mean(&|e| ends(e, &|s| (s.heading_error / s.heading_sigma).powi(2))),
                None,
                None,
                None,
            ),
            row(
                "heading_growth_rms_deg",
                rms(&|e| ends(e, &|s| (s.heading_growth * deg).powi(2))),
                None,
                None,
                (self.case != Case::MultiStop).then_some(0.0),
            ),
            row(
                "attitude_nees",
                mean(&|e| ends(e, &|s| s.attitude_nees)),
                None,
                None,
                None,
            ),
            row(
                "position_nees",
                mean(&|e| ends(e, &|s| s.position_nees)),
                None,
                None,
                None,
            ),
        ];
        if self.case != Case::RealImu {
            let stated = rms(&|e| ends(e, &|s| s.gyro_bias_z_variance * deg * deg)).value;
            rows.push(row(
                "gyro_bias_z_rms_deg_per_s",
                rms(&|e| e.gyro_bias_z * deg * deg),
                None,
                Some(stated),
                None,
            ));
            rows.push(row(
                "gyro_bias_nees",
                mean(&|e| ends(e, &|s| s.gyro_bias_nees)),
                None,
                None,
                None,
            ));
        }
        rows
    }

    /// The ends of stops that count: with drives, those that a drive came before.
    fn counted_ends<'a>(&self, errors: &'a StopErrors) -> &'a [StopEndErrors] {
        match self.case {
            Case::MultiStop => &errors.ends[1..],
            Case::Stop | Case::RealImu => &errors.ends,
        }
    }

    fn assumptions(&self) -> Vec<String> {
        let mut list = vec![
            "receiver: 40 % of the variance of positions is a Gauss–Markov error of 50 s, the rest white; each run's errors are \
             scaled to the published 3.1 m and 4.2 m. The paper gives no correlation; with these the published horizontal \
             errors come out, so that those are no confirmation"
                .to_owned(),
            "static_coloured_gnss and static_white_gnss have the same errors unscaled, since scaled ones are no Gauss–Markov \
             process"
                .to_owned(),
            "receiver: 9 % of the variance of velocities (30 % of their size) is a Gauss–Markov error of 10 s, the rest white"
                .to_owned(),
        ];
        if self.case == Case::Stop {
            list.push(
                "limits are the standard deviations of static_coloured_gnss, which for one stop of the simulated unit are the \
                 least of any linear estimate; those of the position hold for the unscaled receiver alone"
                    .to_owned(),
            );
        }
        if let Some(record) = &self.request.record {
            let noise = record.noise();
            let sigma = record.sigma();
            list.push(format!(
                "unit: the record's own mean is its truth; its noise floor is {:.4} °/√s and {:.5} m/s/√s, its biases wander by \
                 {:.5} °/s and {:.5} m/s² about their means; receiver and start are simulated",
                noise.gyro_white.to_degrees(),
                noise.accel_white,
                sigma.gyro_bias.x.to_degrees(),
                sigma.accel_bias.x,
            ));
            list.push(format!(
                "{} runs are slices of a record of {:.0} s, of which {} share no sample: standard errors are those of so few runs, \
                 and too large for what the receiver alone decides",
                self.request.runs,
                record.duration(),
                self.independent_runs()
            ));
        } else {
            list.push(
                "biases begin as stationary Gauss–Markov processes, with residuals of random sign; initial errors are those of \
                 the paper's section 3"
                    .to_owned(),
            );
        }
        list
    }

    /// The paper's figure: heading errors of one of the experiments, the first.
    pub(crate) fn figure(&self) -> String {
        let series = |variants: &[StopVariant]| -> Vec<Series> {
            let of = |variant: &StopVariant| {
                let index = self::variants().position(|v| v == *variant)?;
                let points = self.errors.first()?[index].heading.iter();
                Some(Series {
                    name: variant.name(),
                    points: points
                        .map(|p| [p.t, p.error.to_degrees(), p.sigma.to_degrees()])
                        .collect(),
                })
            };
            variants.iter().filter_map(of).collect()
        };
        Figure {
            title: format!(
                "Heading error over {} ({}, seed {}, run 1 of {})",
                self.case.span(),
                self.case.name(),
                self.request.seed,
                self.request.runs
            ),
            about: "Lines: estimate less truth. Bands: one stated standard deviation about the line.",
            panels: vec![
                Panel {
                    title: "nothing holds the heading",
                    axis: "heading error, °",
                    series: series(&[StopVariant::Basic, StopVariant::Zupt]),
                },
                Panel {
                    title: "the heading is held",
                    axis: "heading error, °",
                    series: series(&[
                        StopVariant::ZuptZihrBiasOnly,
                        StopVariant::ZuptZihrNaive,
                        StopVariant::PaperExact,
                        StopVariant::Static,
                    ]),
                },
            ],
        }
        .svg()
    }
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_says_what_it_spans() {
        assert_eq!(Case::Stop.span(), "a stop of 300 s");
        assert_eq!(Case::RealImu.span(), "a stop of 300 s");
        assert_eq!(
            Case::MultiStop.span(),
            "4 stops of 300 s with drives between them"
        );
    }
}
