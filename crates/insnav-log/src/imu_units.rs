//! Units of inertial messages, where a driver does not give m/s² and rad/s.

use insnav_core::imu::STANDARD_GRAVITY;
use insnav_core::sample::{ImuIncrement, ImuSample, Sample};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use std::fmt;
use std::str::FromStr;

/// What the numbers of an inertial message are.
///
/// Written as the unit of accelerations and that of rates, `g,deg/s`, or one of them. A number in front of a unit is a factor:
/// `0.001g` are mg, `-1m/s2` is gravity where specific force is due.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuUnits {
    /// One unit of the accelerations in m/s², or in m/s where they are increments.
    pub force: f64,
    /// One unit of the rates in rad/s, or in rad where they are increments.
    pub rate: f64,
    /// Whether the numbers are increments since the message before: m/s and rad, or degrees.
    pub increments: bool,
}

impl Default for ImuUnits {
    fn default() -> Self {
        ImuUnits {
            force: 1.0,
            rate: 1.0,
            increments: false,
        }
    }
}

impl ImuUnits {
    /// The sample of a message, its vectors turned into body axes.
    pub(crate) fn sample(
        &self,
        time: Time,
        to_body: &Matrix3<f64>,
        angular_velocity: &Vector3<f64>,
        linear_acceleration: &Vector3<f64>,
    ) -> Sample {
        let rate = to_body * (angular_velocity * self.rate);
        let force = to_body * (linear_acceleration * self.force);
        if self.increments {
            Sample::ImuIncrement(ImuIncrement {
                time,
                angle_b: rate,
                velocity_b: force,
            })
        } else {
            Sample::Imu(ImuSample {
                time,
                angular_rate_b: rate,
                specific_force_b: force,
            })
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Force,
    Rate,
    VelocityIncrement,
    AngleIncrement,
}

/// Names of units, what they measure, and their size in SI.
const UNITS: [(&str, Kind, f64); 9] = [
    ("m/s2", Kind::Force, 1.0),
    ("m/s^2", Kind::Force, 1.0),
    ("g", Kind::Force, STANDARD_GRAVITY),
    ("mg", Kind::Force, 1e-3 * STANDARD_GRAVITY),
    ("rad/s", Kind::Rate, 1.0),
    ("deg/s", Kind::Rate, std::f64::consts::PI / 180.0),
    ("m/s", Kind::VelocityIncrement, 1.0),
    ("rad", Kind::AngleIncrement, 1.0),
    ("deg", Kind::AngleIncrement, std::f64::consts::PI / 180.0),
];

/// A factor, if there is one, and a unit.
fn unit(text: &str) -> Result<(Kind, f64), String> {
    let text = text.trim();
    let found = UNITS.iter().find_map(|(name, kind, size)| {
        let factor = text.strip_suffix(name)?.trim();
        let factor = if factor.is_empty() {
            1.0
        } else {
            factor.parse().ok()?
        };
        Some((*kind, factor * size))
    });
    found
        .filter(|(_, size): &(Kind, f64)| size.is_finite() && *size != 0.0)
        .ok_or_else(|| {
            format!(
                "{text:?} is no unit of an IMU; known are m/s2, g, mg and m/s (increments) of accelerations, rad/s, deg/s, rad and \
                 deg (increments) of rates, each with a factor in front if need be: 0.001g"
            )
        })
}

impl FromStr for ImuUnits {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut units = ImuUnits::default();
        let (mut force, mut rate) = (None, None);
        for part in text.split(',') {
            let (kind, size) = unit(part)?;
            let place = match kind {
                Kind::Force | Kind::VelocityIncrement => &mut force,
                Kind::Rate | Kind::AngleIncrement => &mut rate,
            };
            if place.replace((kind, size)).is_some() {
                return Err(format!("{part:?}: this quantity has its unit already"));
            }
        }
        let is = |unit: Option<(Kind, f64)>, kind| unit.is_some_and(|u| u.0 == kind);
        units.increments = is(force, Kind::VelocityIncrement);
        if units.increments != is(rate, Kind::AngleIncrement) {
            return Err(
                "increments of one sensor and rates of the other do not go together: m/s,rad or m/s2,rad/s"
                    .into(),
            );
        }
        units.force = force.map_or(1.0, |u| u.1);
        units.rate = rate.map_or(1.0, |u| u.1);
        Ok(units)
    }
}

impl fmt::Display for ImuUnits {
    /// The text that reads back as these units.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let write = |f: &mut fmt::Formatter<'_>, size: f64, kinds: [Kind; 2]| {
            let mut best: Option<(&str, f64)> = None;
            for (name, kind, unit) in UNITS {
                let factor = size / unit;
                if kind == kinds[usize::from(self.increments)]
                    && best.is_none_or(|b| b.1 != 1.0 && factor == 1.0)
                {
                    best = Some((name, factor));
                }
            }
            match best {
                Some((name, 1.0)) => f.write_str(name),
                Some((name, factor)) => write!(f, "{factor}{name}"),
                None => Ok(()),
            }
        };
        write(f, self.force, [Kind::Force, Kind::VelocityIncrement])?;
        f.write_str(",")?;
        write(f, self.rate, [Kind::Rate, Kind::AngleIncrement])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_read_and_written_back() {
        for (text, force, rate, increments) in [
            ("g,deg/s", 9.80665, 1f64.to_radians(), false),
            ("deg/s", 1.0, 1f64.to_radians(), false),
            ("mg", 9.80665e-3, 1.0, false),
            ("rad/s,g", 9.80665, 1.0, false),
            ("-1m/s2", -1.0, 1.0, false),
            ("0.25g,2rad/s", 0.25 * 9.80665, 2.0, false),
            ("m/s,rad", 1.0, 1.0, true),
            ("m/s^2", 1.0, 1.0, false),
        ] {
            let units: ImuUnits = text.parse().unwrap();
            assert!(
                (units.force - force).abs() < 1e-12 && (units.rate - rate).abs() < 1e-15,
                "{text}: {units:?}"
            );
            assert_eq!(units.increments, increments, "{text}");
            let again: ImuUnits = units.to_string().parse().unwrap();
            assert!(
                (again.force - units.force).abs() < 1e-12 * force.abs(),
                "{units}"
            );
            assert_eq!(again.increments, increments);
        }
        assert_eq!(
            "g,deg/s".parse::<ImuUnits>().unwrap().to_string(),
            "g,deg/s"
        );
        for wrong in [
            "",
            "g,g",
            "furlong",
            "m/s",
            "rad",
            "m/s,rad/s",
            "0g",
            "nang",
            "g,",
            "infg",
        ] {
            assert!(wrong.parse::<ImuUnits>().is_err(), "{wrong}");
        }
    }
}
