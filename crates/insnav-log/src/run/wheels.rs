//! Whether the log bears out that its vehicle runs on wheels.

use super::RunError;
use super::execute::is_withheld;
use super::plan::Plan;
use super::report::Warning;
use super::source::Source;
use insnav_core::config::{Config, Nonholonomic};
use insnav_core::wheeled::{WheelReport, WheelWatch};

/// So much of a log is looked at where it is not clear before, s of samples: quarter of an hour has enough straight road.
const GLANCE_S: f64 = 900.0;

/// So many stretches of ten seconds make a contradiction of slopes more than chance.
const MANY_BLOCKS: usize = 15;

/// Navigate the begin of a log without the constraint, and look where the vehicle moves against its body.
///
/// A run that fails shows nothing; the real one will say why.
pub(super) fn watch(
    source: &(impl Source + ?Sized),
    plan: &Plan,
) -> Result<Option<WheelReport>, RunError> {
    let lag = plan.config.gnss.velocity_lag_s;
    let withholding = plan.withholding();
    let begin = plan.survey.imu_span.map(|(first, _)| first);
    // What is still to be decided, the navigator leaves out.
    let mut navigator = plan.navigator()?;
    let mut watch = WheelWatch::default();
    for sample in source.samples()? {
        let sample = sample?;
        if begin.is_some_and(|begin| sample.time().since(begin) > GLANCE_S) || watch.is_clear() {
            break;
        }
        if !is_withheld(&withholding, &sample, lag)
            && !plan.is_before_start(&sample)
            && navigator.step(&sample, &mut watch).is_err()
        {
            return Ok(None);
        }
    }
    Ok(navigator
        .finish(&mut watch)
        .ok()
        .and_then(|()| watch.report()))
}

/// What to make of it.
pub(super) fn decide(config: &mut Config, report: Option<&WheelReport>) -> Vec<Warning> {
    config.vehicle.nonholonomic = match report {
        Some(r) if r.lateral && r.vertical => Nonholonomic::On,
        Some(r) if r.lateral => Nonholonomic::Lateral,
        _ => Nonholonomic::Off,
    };
    report
        .filter(|r| heights_are_upside_down(r))
        .map(upside_down)
        .into_iter()
        .collect()
}

/// The slope that the fixes describe contradicts gravity, and turned round it contradicts it half as much (variances): what
/// only floats or is lifted contradicts it either way.
fn heights_are_upside_down(r: &WheelReport) -> bool {
    r.blocks >= MANY_BLOCKS
        && !r.vertical
        && 2.0 * r.dip_std_upside_down_deg.powi(2) < r.dip_std_deg.powi(2)
}

fn upside_down(r: &WheelReport) -> Warning {
    Warning {
        code: "height_sign",
        message: format!(
            "the vehicle climbs by its fixes where gravity shows its nose down: direction of motion and pitch differ by {:.1}° (std), with the heights turned round by {:.1}°",
            r.dip_std_deg, r.dip_std_upside_down_deg
        ),
        remedy: "the heights of this log seem to count downwards: convert it anew with the sign of its heights turned; until then the vertical velocity of the vehicle is left free".into(),
    }
}
