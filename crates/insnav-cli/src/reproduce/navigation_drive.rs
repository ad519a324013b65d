//! The drive between the stops of Lobusov & Fomichev 2014: an hour of a navigation-grade unit without GNSS.

use super::spread::spread;
use super::{DriftRequest, Reproduced, Row};
use crate::failure::Failure;
use insnav_core::metrics::Estimate;
use insnav_core::sim::{ErrorAt, NavigationDrive, NavigationOutcome, StopUse};
use insnav_log::RunError;

/// The experiment, made.
#[derive(Debug)]
pub(crate) struct DriveExperiment {
    request: DriftRequest,
    parts: Vec<Part>,
}

/// One use of the stops, with or without rocking.
#[derive(Debug)]
struct Part {
    rocking: bool,
    uses: StopUse,
    outcomes: Vec<NavigationOutcome>,
}

impl DriveExperiment {
    /// Make all drives.
    pub(crate) fn run(request: DriftRequest) -> Result<Self, Failure> {
        let first = request.seed.wrapping_mul(1 << 32);
        let mut parts = Vec::new();
        for rocking in [false, true] {
            let drive = NavigationDrive {
                rocking,
                ..NavigationDrive::default()
            };
            for uses in StopUse::ALL {
                let outcomes = spread(case(rocking), request.jobs, request.runs, |run| {
                    Ok(drive
                        .run(uses, first.wrapping_add(run as u64))
                        .map_err(RunError::from)?)
                })?;
                parts.push(Part {
                    rocking,
                    uses,
                    outcomes,
                });
            }
        }
        Ok(DriveExperiment { request, parts })
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
}

impl Part {
    fn rows(&self) -> Vec<Row> {
        let leg = |i: usize| self.outcomes.iter().map(move |o| &o.legs[i]);
        let last = self.outcomes[0].legs.len() - 1;
        let position = |e: &ErrorAt| [e.horizontal_m, e.sigma_horizontal_m];
        let heading =
            |e: &ErrorAt| [e.heading, e.sigma_heading].map(|angle| angle.to_degrees() * 60.0);
        let all = self.outcomes.iter().flat_map(|o| &o.legs);
        let means: Vec<f64> = self
            .outcomes
            .iter()
            .map(|o| o.legs.iter().map(|e| e.horizontal_nees).sum::<f64>() / o.legs.len() as f64)
            .collect();
        let nees = Estimate::mean(&means);
        let furthest = all.map(|e| e.horizontal_m).fold(0.0, f64::max);
        vec![
            self.rms("horizontal_rms_first_leg_m", leg(0).map(position)),
            self.rms("horizontal_rms_last_leg_m", leg(last).map(position)),
            Row {
                ours: Some(furthest),
                ..self.row("horizontal_max_m")
            },
            self.rms("heading_rms_last_leg_arcmin", leg(last).map(heading)),
            Row {
                ours: Some(nees.value),
                standard_error: nees.standard_error,
                ..self.row("horizontal_nees_per_component")
            },
        ]
    }

    /// Root mean square of an error beside that of what is stated of it.
    fn rms(&self, quantity: &'static str, pairs: impl Iterator<Item = [f64; 2]>) -> Row {
        let (errors, stated): (Vec<f64>, Vec<f64>) = pairs
            .map(|[error, sigma]| (error.powi(2), sigma.powi(2)))
            .unzip();
        let ours = Estimate::root_mean_square(&errors);
        Row {
            ours: Some(ours.value),
            standard_error: ours.standard_error,
            stated: Some(Estimate::root_mean_square(&stated).value),
            ..self.row(quantity)
        }
    }

    fn row(&self, quantity: &'static str) -> Row {
        Row {
            case: case(self.rocking),
            variant: self.uses.name(),
            quantity,
            published: None,
            ours: None,
            standard_error: None,
            stated: None,
            limit: None,
            note: None,
        }
    }
}

fn case(rocking: bool) -> &'static str {
    if rocking {
        "drive_rocking"
    } else {
        "drive_quiet"
    }
}

fn assumptions() -> Vec<String> {
    [
        "latitude 60°, 100 Hz increments, 0.001 °/√h, 5 µg/√Hz, drifts and biases by chance with 0.02 °/h and 50 µg; no GNSS",
        "300 s of standing, a turn by 180°, 300 s of standing, then nine times a leg of 300 s (bends, hills, 10 to 36 m/s) and a stop of 100 s; stops are found by the run itself; errors are those at the end of a leg",
        "`none`: the first stop alone; `zero_velocity` and `static`: live updates; `batch`: every stop as one measurement when it is over, ZUPT-1 at the begin, ZUPT-2 and velocity reset later",
        "rocking: roll, pitch and yaw of 0.01° to 0.1° at 0.17 to 1.9 Hz, lever arm (0.5, 0.5, −1.0) m",
    ]
    .map(str::to_owned)
    .to_vec()
}
