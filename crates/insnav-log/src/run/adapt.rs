//! `noise.adapt = "als"`: the noise that the log's own innovations show.

use super::RunError;
use super::execute::is_withheld;
use super::plan::Plan;
use super::report::{AdaptedReport, Warning};
use super::source::Source;
use insnav_core::config::{NoiseAdapt, Nonholonomic, SigmaScale};
use insnav_core::noise::{
    AdaptationOutcome, AdaptationStep, AdaptedNumber, InnovationSums, NoiseAdaptation,
    NoiseUnknown, NoiseValues, Verdict,
};

/// Run over a source as often as it takes, and put what is accepted into the settings of the plan.
///
/// The settings that come out are those of a run that does not adapt: with them the same run is made again.
pub(super) fn adapt(source: &(impl Source + ?Sized), plan: &mut Plan) -> Result<(), RunError> {
    if plan.config.noise.adapt == NoiseAdapt::Off {
        return Ok(());
    }
    plan.config.noise.adapt = NoiseAdapt::Off;
    if !plan.config.gnss.used {
        plan.warnings.push(Warning {
            code: "noise_not_adapted",
            message: "noise is adapted by what GNSS positions and velocities show, which this run does not use".into(),
            remedy: "leave `noise.adapt` out, or take the noise from `insnav noise`".into(),
        });
        return Ok(());
    }
    let given = plan.config;
    let noise = plan.noise();
    let prior = NoiseValues {
        gyro_white: noise.gyro_white,
        accel_white: noise.accel_white,
        // What is learnt on the way begins at what the receiver states.
        position_scale: given.gnss.sigma_scale.fixed().unwrap_or(1.0),
        velocity_scale: given.gnss.velocity_sigma_scale.fixed().unwrap_or(1.0),
    };
    // Its errors (sway, slip) last, which would pass for noise of the gyros.
    plan.config.vehicle.nonholonomic = Nonholonomic::Off;
    let mut adaptation = NoiseAdaptation::new(prior);
    let outcome = loop {
        use_values(plan, &adaptation.values());
        let sums = watch(source, plan)?;
        if let AdaptationStep::Done(outcome) = adaptation.take(&sums) {
            break outcome;
        }
    };
    plan.config = given;
    take_accepted(plan, &outcome);
    plan.adaptation = outcome
        .numbers
        .iter()
        .map(|number| report(number, &outcome))
        .collect();
    Ok(())
}

fn use_values(plan: &mut Plan, values: &NoiseValues) {
    let (noise, gnss) = (&mut plan.config.noise, &mut plan.config.gnss);
    noise.gyro_arw_deg_per_sqrt_hour = Some(per_sqrt_hour(values.gyro_white.to_degrees()));
    noise.accel_vrw_m_per_s_per_sqrt_hour = Some(per_sqrt_hour(values.accel_white));
    gnss.sigma_scale = SigmaScale::Fixed(values.position_scale);
    gnss.velocity_sigma_scale = SigmaScale::Fixed(values.velocity_scale);
}

fn take_accepted(plan: &mut Plan, outcome: &AdaptationOutcome) {
    let (noise, gnss) = (&mut plan.config.noise, &mut plan.config.gnss);
    for number in &outcome.numbers {
        let (Verdict::Estimated, Some(value)) = (number.verdict, number.estimate) else {
            continue;
        };
        match number.unknown {
            NoiseUnknown::Gyro => {
                noise.gyro_arw_deg_per_sqrt_hour = Some(per_sqrt_hour(value.to_degrees()));
            }
            NoiseUnknown::Accel => {
                noise.accel_vrw_m_per_s_per_sqrt_hour = Some(per_sqrt_hour(value));
            }
            NoiseUnknown::Position => gnss.sigma_scale = SigmaScale::Fixed(value),
            NoiseUnknown::Velocity => gnss.velocity_sigma_scale = SigmaScale::Fixed(value),
        }
    }
}

/// One run over the source, of which only the innovations are kept.
fn watch(source: &(impl Source + ?Sized), plan: &Plan) -> Result<InnovationSums, RunError> {
    let lag = plan.config.gnss.velocity_lag_s;
    let withholding = plan.withholding();
    let mut navigator = plan.navigator()?;
    navigator.watch_noise();
    for sample in source.samples()? {
        let sample = sample?;
        if !is_withheld(&withholding, &sample, lag) && !plan.is_before_start(&sample) {
            // What cannot be used, the run itself will tell of.
            let _ = navigator.step(&sample, &mut ());
        }
    }
    let _ = navigator.finish(&mut ());
    Ok(navigator.take_noise().unwrap_or_default())
}

fn per_sqrt_hour(density: f64) -> f64 {
    density * 60.0
}

fn report(number: &AdaptedNumber, outcome: &AdaptationOutcome) -> AdaptedReport {
    let (name, factor) = match number.unknown {
        NoiseUnknown::Gyro => (
            "gyro_arw_deg_per_sqrt_hour",
            per_sqrt_hour(1.0_f64.to_degrees()),
        ),
        NoiseUnknown::Accel => ("accel_vrw_m_per_s_per_sqrt_hour", per_sqrt_hour(1.0)),
        NoiseUnknown::Position => ("gnss_sigma_scale", 1.0),
        NoiseUnknown::Velocity => ("gnss_velocity_sigma_scale", 1.0),
    };
    AdaptedReport {
        name,
        prior: number.prior * factor,
        estimate: number.estimate.map(|x| x * factor),
        standard_error: number.standard_error.map(|x| x * factor),
        chi2: outcome.chi2,
        dof: outcome.dof,
        verdict: match number.verdict {
            Verdict::Estimated => "accepted",
            Verdict::OnBound => "on_bound",
            Verdict::Held | Verdict::Known => "held",
        },
        reason: number.reason.clone(),
    }
}
