//! What a user should know of a magnetometer in the log.

use super::report::{AlignmentReport, Warning};
use super::survey::Survey;
use insnav_core::alignment::{EARTH_FIELD, HeadingSource};
use insnav_core::config::AlignmentConfig;

/// That its heading counts from magnetic north, or that it could have given one but for its unit.
pub(super) fn compass(
    start: Option<&AlignmentReport>,
    survey: &Survey,
    settings: &AlignmentConfig,
) -> Option<Warning> {
    match start?.heading_source {
        HeadingSource::Magnetic if settings.declination_deg.is_none() => Some(Warning {
            code: "declination_unknown",
            message: "the heading at the start is that of a magnetometer, from magnetic north: the declination is not known and taken as 0°".into(),
            remedy: "look the declination of the place up and give it with `--set alignment.declination_deg=…`, positive to the east; give the heading itself with `--heading-deg`, or leave the magnetometer out with `--topic magnetometer=none`".into(),
        }),
        HeadingSource::Unknown | HeadingSource::Relative if survey.fields > 0 => {
            let mean = survey.field_sum / survey.fields as f64;
            let earth = EARTH_FIELD.map(|t| t * 1e6);
            (!(EARTH_FIELD[0]..=EARTH_FIELD[1]).contains(&mean)).then(|| Warning {
                code: "magnetic_units",
                message: format!(
                    "the magnetic field is {mean:.3e} T long in the mean, not between {:.0} and {:.0} µT as the Earth's: it gives no heading{}",
                    earth[0],
                    earth[1],
                    unit(mean)
                ),
                remedy: "let the driver give tesla, as sensor_msgs/MagneticField says, or put a factor into a map: `[[map]]` with magnetic_field_t = [\"magnetic_field.x * 1e-4\", …] for gauss, 1e-6 for µT".into(),
            })
        }
        _ => None,
    }
}

/// Which unit makes an Earth's field of it.
fn unit(mean: f64) -> &'static str {
    let fits = |factor: f64| (EARTH_FIELD[0]..=EARTH_FIELD[1]).contains(&(mean * factor));
    if fits(1e-4) {
        "; it would be one in gauss"
    } else if fits(1e-6) {
        "; it would be one in microtesla"
    } else {
        ""
    }
}
