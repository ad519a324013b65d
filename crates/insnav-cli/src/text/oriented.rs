//! An orientation as text.

use super::{entry, plural, short, span};
use crate::command::Oriented;
use insnav_log::HeadingReference;

/// What `insnav ahrs` tells of one log.
pub(crate) fn oriented(o: &Oriented) -> String {
    let r = &o.report;
    let mut text = format!(
        "{} → {}\n",
        o.input.display(),
        [&o.output]
            .into_iter()
            .chain(&o.also)
            .map(|p| p.display().to_string())
            .collect::<Vec<_>>()
            .join(", ")
    );
    let fields = match r.magnetic_fields {
        0 => "no magnetometer".to_owned(),
        n => plural(n, "magnetic field"),
    };
    text.push_str(&entry(
        "data",
        &format!(
            "{} in {}, {fields}; {} s of work",
            plural(r.imu_samples, "sample"),
            span(r.duration_s),
            short(r.elapsed_s)
        ),
    ));
    let n = &r.noise;
    let magnetometer = n
        .magnetometer_microtesla
        .map_or(String::new(), |m| format!(", magnetometer {} µT", short(m)));
    text.push_str(&entry(
        "noise",
        &format!(
            "gyro {} °/√h, accelerometer {} m/s/√h{magnetometer}; {}",
            short(n.gyro_arw_deg_per_sqrt_hour),
            short(n.accel_vrw_m_per_s_per_sqrt_hour),
            match n.source {
                "log" => format!("as the log shows it, else of the class {}", n.grade),
                _ => format!("of the settings, else of the class {}", n.grade),
            }
        ),
    ));
    text.push_str(&entry(
        "heading",
        match r.heading_reference {
            HeadingReference::MagneticNorth => {
                "from magnetic north: add the declination of the place (`--set alignment.declination_deg=…`) for true north"
            }
            HeadingReference::TrueNorth => "from true north, by the declination that is given",
            HeadingReference::Start => {
                "from where the body looked at the begin: gyro and accelerometer alone (6 axes), it drifts"
            }
        },
    ));
    if let Some([delay, sigma]) = r.magnetometer_delay_s {
        text.push_str(&entry(
            "field",
            &format!(
                "{} ± {} ms behind the gyros",
                short(delay * 1e3),
                short(sigma * 1e3)
            ),
        ));
    }
    let mut rest = format!("{} at rest", span(r.rest_s));
    if r.saturated_s > 0.0 {
        rest.push_str(&format!(
            ", {} with a gyro at the end of its range",
            span(r.saturated_s)
        ));
    }
    text.push_str(&entry("motion", &rest));
    if let Some(last) = &r.last {
        text.push_str(&entry(
            "end",
            &format!(
                "roll {}°, pitch {}° (± {}°), heading {}° (± {}°); gyro bias {} °/s{}",
                short(last.roll_deg),
                short(last.pitch_deg),
                short(last.sigma_tilt_deg),
                short(last.heading_deg),
                short(last.sigma_heading_deg),
                r.gyro_bias_deg_per_s.map(short).join(", "),
                if r.smoothed {
                    "; every instant knows the whole log"
                } else {
                    ""
                }
            ),
        ));
    }
    text
}
