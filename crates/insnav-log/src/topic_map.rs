//! A user's map of a message: which of its fields is which quantity, in which unit and axes.
//!
//! For messages of types that are not known here, in any encoding that carries names: JSON, or ROS with its definition.

use crate::content::{Axes, Content, Declared, Fix, NorthHeading, Rates, Stamp, Velocity};
use crate::topics::Role;
use crate::wire::{DecodeError, Fields};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;
use std::fmt;
use std::str::FromStr;

/// Which fields of a topic's messages are which quantities: `[[map]]` in a file of settings.
///
/// ```toml
/// [[map]]
/// topic = "/vehicle/state"
/// time_s = "stamp_us * 1e-6"                 # or a field {sec, nanosec}; absent: the log time
/// clock = "host"                             # own: the sensor's, as since its power-on
/// angular_rate_rad_per_s = ["gyro.x / 57.29577951308232", "gyro.y / 57.29577951308232", "gyro.z / 57.29577951308232"]
/// specific_force_m_per_s2 = ["acc.0 * 9.80665", "acc.1 * 9.80665", "acc.2 * 9.80665"]
/// imu_axes = "frd"                           # or flu, the default
/// latitude_deg = "gps.lat * 1e-7"
/// longitude_deg = "gps.lon * 1e-7"
/// height_m = "gps.alt_mm * 0.001"
/// position_sigma_m = ["gps.h_acc", "gps.h_acc", "gps.v_acc"]
/// velocity_m_per_s = ["gps.vn", "gps.ve", "gps.vd"]
/// velocity_sigma_m_per_s = ["gps.s_acc", "gps.s_acc", "gps.s_acc"]
/// gnss_axes = "ned"                          # or enu, the default: of velocity and of both sigmas
/// fix = "gps.fix_type"                       # no fix where it is below fix_from
/// fix_from = 3
/// heading_deg = "gps.heading"
/// heading_sigma_deg = "gps.heading_acc"
/// magnetic_field_t = ["mag.x * 1e-6", "mag.y * 1e-6", "mag.z * 1e-6"]  # axes as imu_axes
/// standing = "brake.parked"                  # true, or a number that is not 0: it stands
/// ```
///
/// Instead of `standing`, `speed_m_per_s` may say how fast the wheels turn: `"wheel_speed_kmh / 3.6"`.
///
/// A path leads through messages and lists (`gyro.x`, `acc.0`); a minus before it, and one `* number` or `/ number` behind it,
/// change sign and unit. A map may name the quantities of one sensor or of several.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TopicMap {
    /// The topic.
    pub topic: String,
    /// Instant, s, or a field of seconds and nanoseconds; absent: the log time.
    #[serde(default)]
    pub time_s: Option<Expression>,
    /// Whose clock that is.
    #[serde(default)]
    pub clock: MapClock,
    /// Angular rate, rad/s.
    #[serde(default)]
    pub angular_rate_rad_per_s: Option<[Expression; 3]>,
    /// Specific force, m/s².
    #[serde(default)]
    pub specific_force_m_per_s2: Option<[Expression; 3]>,
    /// Axes of both.
    #[serde(default)]
    pub imu_axes: MapImuAxes,
    /// Latitude, degrees.
    #[serde(default)]
    pub latitude_deg: Option<Expression>,
    /// Longitude, degrees.
    #[serde(default)]
    pub longitude_deg: Option<Expression>,
    /// Height, m.
    #[serde(default)]
    pub height_m: Option<Expression>,
    /// Standard deviations of the position, m, in the order of `gnss_axes`.
    #[serde(default)]
    pub position_sigma_m: Option<[Expression; 3]>,
    /// Velocity, m/s.
    #[serde(default)]
    pub velocity_m_per_s: Option<[Expression; 3]>,
    /// Its standard deviations, m/s.
    #[serde(default)]
    pub velocity_sigma_m_per_s: Option<[Expression; 3]>,
    /// Axes of the velocity and of the standard deviations.
    #[serde(default)]
    pub gnss_axes: MapGnssAxes,
    /// A number that tells whether there is a fix.
    #[serde(default)]
    pub fix: Option<Expression>,
    /// Least value of it with which there is; absent: 1.
    #[serde(default)]
    pub fix_from: Option<f64>,
    /// Heading, degrees clockwise from true north.
    #[serde(default)]
    pub heading_deg: Option<Expression>,
    /// Its standard deviation, degrees.
    #[serde(default)]
    pub heading_sigma_deg: Option<Expression>,
    /// Magnetic field, T, in the axes of `imu_axes`.
    #[serde(default)]
    pub magnetic_field_t: Option<[Expression; 3]>,
    /// Whether the body stands: true, or a number that is not 0.
    #[serde(default)]
    pub standing: Option<Expression>,
    /// How fast the wheels turn, m/s, whichever way.
    #[serde(default)]
    pub speed_m_per_s: Option<Expression>,
}

/// Whose clock a stamp is on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MapClock {
    /// That of the machine that recorded.
    #[default]
    Host,
    /// One of the sensor's own: it is put onto the recorder's by one constant.
    Own,
}

/// Axes of inertial quantities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MapImuAxes {
    /// Forward, left, up.
    #[default]
    Flu,
    /// Forward, right, down.
    Frd,
}

/// Axes of GNSS quantities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MapGnssAxes {
    /// East, north, up.
    #[default]
    Enu,
    /// North, east, down.
    Ned,
}

/// A field's path and a factor.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub struct Expression {
    path: String,
    factor: f64,
}

impl TryFrom<String> for Expression {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl FromStr for Expression {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{text:?} is no field: write its path, as gyro.x or -list.0, and behind it * number or / number"
            )
        };
        let (sign, rest) = match text.trim().strip_prefix('-') {
            Some(rest) => (-1.0, rest),
            None => (1.0, text.trim()),
        };
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
        let (path, factor) = if let Some((path, factor)) = rest.split_once('*') {
            (path, number(factor)?)
        } else if let Some((path, divisor)) = rest.split_once('/') {
            (path, 1.0 / number(divisor)?)
        } else {
            (rest, 1.0)
        };
        let path = path.trim();
        let is_path = !path.is_empty()
            && path.split('.').all(|name| {
                !name.is_empty() && !name.contains(|c: char| c.is_whitespace() || c == '-')
            });
        if is_path && factor.is_finite() && factor != 0.0 {
            Ok(Expression {
                path: path.into(),
                factor: sign * factor,
            })
        } else {
            Err(wrong())
        }
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.path)
    }
}

impl TopicMap {
    /// The parts that the topic can play by this map.
    pub fn roles(&self) -> Vec<Role> {
        [
            (Role::Imu, self.angular_rate_rad_per_s.is_some()),
            (Role::GnssPosition, self.latitude_deg.is_some()),
            (Role::GnssVelocity, self.velocity_m_per_s.is_some()),
            (Role::Heading, self.heading_deg.is_some()),
            (Role::Magnetometer, self.magnetic_field_t.is_some()),
            (
                Role::Standing,
                self.standing.is_some() || self.speed_m_per_s.is_some(),
            ),
        ]
        .into_iter()
        .filter_map(|(role, given)| given.then_some(role))
        .collect()
    }

    /// What is missing for a whole quantity; the key first that needs the others.
    pub(crate) fn incomplete(&self) -> Option<&'static str> {
        let both = |a: bool, b: bool, what| (a != b).then_some(what);
        both(
            self.angular_rate_rad_per_s.is_some(),
            self.specific_force_m_per_s2.is_some(),
            "angular_rate_rad_per_s and specific_force_m_per_s2 go together",
        )
        .or(both(
            self.latitude_deg.is_some(),
            self.longitude_deg.is_some() && self.height_m.is_some(),
            "latitude_deg, longitude_deg and height_m go together",
        ))
        .or(both(
            self.heading_deg.is_some(),
            self.heading_sigma_deg.is_some(),
            "heading_deg and heading_sigma_deg go together",
        ))
        .or((self.standing.is_some() && self.speed_m_per_s.is_some())
            .then_some("standing and speed_m_per_s say the same: give one of them"))
        .or(self
            .roles()
            .is_empty()
            .then_some("the map names no quantity"))
    }

    /// What a message says by this map.
    pub(crate) fn read<'a>(&self, fields: &Fields<'a>) -> Result<Content<'a>, DecodeError> {
        let stamp = match &self.time_s {
            None => Stamp::Host(Time(0)),
            Some(time) => match (time.time(fields)?, self.clock) {
                (time, MapClock::Host) => Stamp::Host(time),
                (time, MapClock::Own) => Stamp::Own(time),
            },
        };
        Ok(Content {
            rates: self.rates(fields)?,
            position: self.position(fields)?,
            velocity: self.velocity(fields)?,
            heading: self.heading(fields)?,
            standing: self.declared(fields)?,
            field: self.magnetic(fields)?,
            ..Content::empty(stamp, "")
        })
    }

    fn rates(&self, fields: &Fields<'_>) -> Result<Option<Rates>, DecodeError> {
        let (Some(rate), Some(force)) =
            (&self.angular_rate_rad_per_s, &self.specific_force_m_per_s2)
        else {
            return Ok(None);
        };
        Ok(Some(Rates {
            angular_rate: vector(rate, fields, "angular_rate_rad_per_s")?,
            specific_force: vector(force, fields, "specific_force_m_per_s2")?,
            axes: self.axes(),
        }))
    }

    fn axes(&self) -> Axes {
        match self.imu_axes {
            MapImuAxes::Flu => Axes::Flu,
            MapImuAxes::Frd => Axes::Frd,
        }
    }

    fn magnetic(&self, fields: &Fields<'_>) -> Result<Option<(Vector3<f64>, Axes)>, DecodeError> {
        let Some(field) = &self.magnetic_field_t else {
            return Ok(None);
        };
        let field = vector(field, fields, "magnetic_field_t")?;
        Ok(Some((field, self.axes())))
    }

    fn position(&self, fields: &Fields<'_>) -> Result<Option<Fix>, DecodeError> {
        let (Some(latitude), Some(longitude), Some(height)) =
            (&self.latitude_deg, &self.longitude_deg, &self.height_m)
        else {
            return Ok(None);
        };
        Ok(Some(Fix {
            no_fix: self.no_fix(fields)?,
            latitude_deg: latitude.number(fields, "latitude_deg", 0)?,
            longitude_deg: longitude.number(fields, "longitude_deg", 0)?,
            height_m: height.number(fields, "height_m", 0)?,
            ellipsoidal: false,
            covariance_enu: self.covariance(&self.position_sigma_m, fields, "position_sigma_m")?,
        }))
    }

    fn velocity(&self, fields: &Fields<'_>) -> Result<Option<Velocity>, DecodeError> {
        let Some(velocity) = &self.velocity_m_per_s else {
            return Ok(None);
        };
        let velocity = vector(velocity, fields, "velocity_m_per_s")?;
        let key = "velocity_sigma_m_per_s";
        Ok(Some(Velocity {
            no_fix: self.no_fix(fields)?,
            by_convention: false,
            // Component by component: a product would spread a NaN.
            enu: match self.gnss_axes {
                MapGnssAxes::Enu => velocity,
                MapGnssAxes::Ned => Vector3::new(velocity.y, velocity.x, -velocity.z),
            },
            covariance_enu: self.covariance(&self.velocity_sigma_m_per_s, fields, key)?,
        }))
    }

    fn heading(&self, fields: &Fields<'_>) -> Result<Option<NorthHeading>, DecodeError> {
        let (Some(heading), Some(sigma)) = (&self.heading_deg, &self.heading_sigma_deg) else {
            return Ok(None);
        };
        Ok(Some(NorthHeading {
            heading: heading.number(fields, "heading_deg", 0)?.to_radians(),
            sigma: sigma.number(fields, "heading_sigma_deg", 0)?.to_radians(),
        }))
    }

    fn declared(&self, fields: &Fields<'_>) -> Result<Option<Declared>, DecodeError> {
        if let Some(standing) = &self.standing {
            let stands = standing.number(fields, "standing", 0)?;
            return Ok(Some(Declared::Standing(stands != 0.0)));
        }
        let Some(speed) = &self.speed_m_per_s else {
            return Ok(None);
        };
        let speed = speed.number(fields, "speed_m_per_s", 0)?;
        Ok(Some(Declared::Speed(speed)))
    }

    fn no_fix(&self, fields: &Fields<'_>) -> Result<bool, DecodeError> {
        match &self.fix {
            None => Ok(false),
            Some(fix) => Ok(fix.number(fields, "fix", 0)? < self.fix_from.unwrap_or(1.0)),
        }
    }

    fn covariance(
        &self,
        sigmas: &Option<[Expression; 3]>,
        fields: &Fields<'_>,
        key: &'static str,
    ) -> Result<Option<Matrix3<f64>>, DecodeError> {
        let Some(sigmas) = sigmas else {
            return Ok(None);
        };
        let mut sigmas = vector(sigmas, fields, key)?;
        if self.gnss_axes == MapGnssAxes::Ned {
            sigmas.swap_rows(0, 1);
        }
        Ok(Some(Matrix3::from_diagonal(&sigmas.map(|s| s * s))))
    }

    /// The path that a key of the map names, and which of its fields.
    pub(crate) fn field(&self, key: &str, index: usize) -> Option<String> {
        let one = |e: &Option<Expression>| e.as_ref().map(ToString::to_string);
        let of = |e: &Option<[Expression; 3]>| Some(e.as_ref()?.get(index)?.to_string());
        match key {
            "time_s" => one(&self.time_s),
            "angular_rate_rad_per_s" => of(&self.angular_rate_rad_per_s),
            "specific_force_m_per_s2" => of(&self.specific_force_m_per_s2),
            "latitude_deg" => one(&self.latitude_deg),
            "longitude_deg" => one(&self.longitude_deg),
            "height_m" => one(&self.height_m),
            "position_sigma_m" => of(&self.position_sigma_m),
            "velocity_m_per_s" => of(&self.velocity_m_per_s),
            "velocity_sigma_m_per_s" => of(&self.velocity_sigma_m_per_s),
            "fix" => one(&self.fix),
            "heading_deg" => one(&self.heading_deg),
            "standing" => one(&self.standing),
            "speed_m_per_s" => one(&self.speed_m_per_s),
            _ => one(&self.heading_sigma_deg),
        }
    }
}

fn vector(
    expressions: &[Expression; 3],
    fields: &Fields<'_>,
    key: &'static str,
) -> Result<Vector3<f64>, DecodeError> {
    let [x, y, z] = expressions;
    Ok(Vector3::new(
        x.number(fields, key, 0)?,
        y.number(fields, key, 1)?,
        z.number(fields, key, 2)?,
    ))
}

impl Expression {
    fn not_mapped(&self, fields: &Fields<'_>, key: &'static str, index: usize) -> DecodeError {
        DecodeError::NotMapped {
            key,
            index,
            found: fields.kind_at(&self.path),
        }
    }

    fn number(
        &self,
        fields: &Fields<'_>,
        key: &'static str,
        index: usize,
    ) -> Result<f64, DecodeError> {
        fields
            .number_at(&self.path)
            .map(|number| number * self.factor)
            .ok_or(self.not_mapped(fields, key, index))
    }

    /// An instant: a number times the factor in seconds, or a field of its own kind.
    fn time(&self, fields: &Fields<'_>) -> Result<Time, DecodeError> {
        // Nanoseconds since 1970 do not fit a double: a whole number of them per unit is multiplied as such.
        let ns_per_unit = self.factor * 1e9;
        if let Some(integer) = fields.integer_at(&self.path)
            && (ns_per_unit - ns_per_unit.round()).abs() < 1e-6
            && let Some(ns) = integer.checked_mul(ns_per_unit.round() as i64)
        {
            return Ok(Time(ns));
        }
        if let Some(number) = fields.number_at(&self.path) {
            // Whole seconds apart, so that the product does not round a second time.
            let seconds = number * self.factor;
            let whole = seconds.floor();
            let ns = ((seconds - whole) * 1e9).round() as i64;
            if seconds.is_finite() {
                return Ok(Time(
                    (whole as i64)
                        .saturating_mul(1_000_000_000)
                        .saturating_add(ns),
                ));
            }
        }
        fields
            .time_at(&self.path)
            .ok_or(self.not_mapped(fields, "time_s", 0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{Document, read_json};

    #[test]
    fn expressions() {
        for (text, path, factor) in [
            ("gyro.x", "gyro.x", 1.0),
            (" -acc.2 * 9.5 ", "acc.2", -9.5),
            ("t/1000", "t", 1e-3),
            ("lat * 1e-7", "lat", 1e-7),
            ("x * -1", "x", -1.0),
        ] {
            let expected = Expression {
                path: path.into(),
                factor,
            };
            assert_eq!(text.parse(), Ok(expected), "{text}");
        }
        for wrong in [
            "",
            "a b",
            "a..b",
            "* 3",
            "a * b",
            "a * 0",
            "a / 0",
            "a * 2 * 3",
            "a - b",
        ] {
            assert!(wrong.parse::<Expression>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn instants_are_exact() {
        let mut document = Document::default();
        let text = br#"{"ns": 1600000000123456789, "us": 1600000000123456, "s": 1600000000.25, "t": {"sec": 5, "nanosec": 6}}"#;
        let fields = read_json(&mut document, text).unwrap();
        for (expression, ns) in [
            ("ns * 1e-9", 1_600_000_000_123_456_789),
            ("us / 1e6", 1_600_000_000_123_456_000),
            ("s", 1_600_000_000_250_000_000),
            ("t", 5_000_000_006),
        ] {
            let expression: Expression = expression.parse().unwrap();
            assert_eq!(expression.time(&fields), Ok(Time(ns)), "{expression}");
        }
    }
}
