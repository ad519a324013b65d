//! Flags that say how to read a log: the same for every verb that reads one.

use clap::{Args, ValueEnum};
use insnav_core::config::Config;
use insnav_log::{ImuAxes, ImuUnits, LogSettings, ReadOptions, Role, TimeSource, VelocityAxes};

/// Axes of IMU messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Axes {
    /// Forward, left, up (REP-103)
    Flu,
    /// Forward, right, down
    Frd,
}

/// Which stamp counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Clock {
    /// The stamp in the message
    Header,
    /// When the message was recorded
    Log,
    /// When the message was published
    Publish,
}

#[derive(Args, Clone, Debug)]
pub(super) struct LogFlags {
    /// Topic of a role: imu, gnss, gnss-velocity, tf, heading, standing, or none for none (repeatable; a role is found by itself
    /// when only one topic can serve, but for two that have to be named: heading, that of the body's forward axis, and standing,
    /// std_msgs Bool, which declares that the vehicle stands, or the speed of its wheels in m/s as Float32, Float64, Odometry
    /// or TwistStamped, which declares nothing and is evidence for the detector only; those without a header count at the log time)
    #[arg(long, value_name = "ROLE=/TOPIC", value_parser = topic)]
    topic: Vec<(Role, String)>,

    /// Axes of the IMU messages
    #[arg(long, value_enum, default_value = "flu", value_name = "AXES")]
    imu_axes: Axes,

    /// Units of the IMU messages, such as g,deg/s, or m/s,rad for increments; a number in front is a factor: 0.001g, -1m/s2
    #[arg(
        long,
        value_name = "UNITS",
        default_value = "m/s2,rad/s",
        allow_hyphen_values = true
    )]
    imu_units: ImuUnits,

    /// Where x, y and z of GNSS velocity messages point, such as enu or ned
    #[arg(long, value_name = "AXES", default_value = "enu")]
    gnss_velocity_axes: VelocityAxes,

    /// Mounting of the IMU in the vehicle, degrees, such as roll=90,yaw=-90 (the angles of a URDF, in the axes of --imu-axes)
    /// [default: that of the settings, else of /tf_static from base_link to the IMU's frame]
    #[arg(long, value_name = "ANGLES", value_parser = mounting, allow_hyphen_values = true)]
    imu_mounting_deg: Option<Angles>,

    /// What altitudes of fixes are above: ellipsoid, or msl=N for the sea level, with the height N of the geoid above the
    /// ellipsoid there in metres
    #[arg(long, value_name = "ellipsoid|msl=N", value_parser = altitude, default_value = "ellipsoid")]
    altitude: Geoid,

    /// Which stamp of a message counts
    #[arg(long, value_enum, default_value = "header", value_name = "CLOCK")]
    time: Clock,

    /// Keep what is readable of a truncated or damaged log, and tell what was lost
    #[arg(long)]
    recover: bool,
}

/// Height of the zero of altitudes above the ellipsoid, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Geoid(f64);

/// Roll, pitch and yaw, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Angles([f64; 3]);

impl LogFlags {
    /// How to read, given the settings: a mounting in a flag goes before one in the settings.
    pub(super) fn options(&self, config: &Config, settings: LogSettings) -> ReadOptions {
        let options = ReadOptions {
            topics: self.topic.clone(),
            imu_axes: match self.imu_axes {
                Axes::Flu => ImuAxes::Flu,
                Axes::Frd => ImuAxes::Frd,
            },
            imu_mounting_rpy_deg: self.imu_mounting_deg.map(|a| a.0),
            time_source: match self.time {
                Clock::Header => TimeSource::Header,
                Clock::Log => TimeSource::Log,
                Clock::Publish => TimeSource::Publish,
            },
            geoid_height_m: self.altitude.0,
            recover: self.recover,
            imu_units: self.imu_units,
            gnss_velocity_axes: self.gnss_velocity_axes,
            ..ReadOptions::default()
        };
        settings.over(options).with_settings_of(config)
    }
}

fn topic(text: &str) -> Result<(Role, String), String> {
    let keys = || Role::ALL.map(Role::key).join(", ");
    let (key, name) = text
        .split_once('=')
        .ok_or_else(|| format!("expected ROLE=/topic, with ROLE one of {}", keys()))?;
    let role =
        Role::from_key(key).ok_or_else(|| format!("{key:?} is no role; roles are {}", keys()))?;
    Ok((role, name.to_owned()))
}

fn altitude(text: &str) -> Result<Geoid, String> {
    if text == "ellipsoid" {
        return Ok(Geoid(0.0));
    }
    let height = text.strip_prefix("msl=").and_then(|n| n.parse().ok());
    // The geoid lies within 107 m of the ellipsoid everywhere.
    height.filter(|n: &f64| n.abs() <= 110.0).map(Geoid).ok_or_else(|| {
        "expected ellipsoid or msl=N; there is no geoid model here, so N, its height above the ellipsoid in metres, has to be \
         given; the trajectory's shape does not depend on it"
            .into()
    })
}

fn mounting(text: &str) -> Result<Angles, String> {
    let mut angles = [0.0; 3];
    for part in text.split(',') {
        let wrong =
            || format!("{part:?} is not roll=…, pitch=… or yaw=… in degrees, from -360 to 360");
        let (name, value) = part.split_once('=').ok_or_else(wrong)?;
        let at = ["roll", "pitch", "yaw"]
            .iter()
            .position(|n| *n == name.trim())
            .ok_or_else(wrong)?;
        angles[at] = value
            .trim()
            .parse()
            .ok()
            .filter(|a: &f64| a.abs() <= 360.0)
            .ok_or_else(wrong)?;
    }
    Ok(Angles(angles))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mountings() {
        assert_eq!(mounting("roll=90,yaw=-90"), Ok(Angles([90.0, 0.0, -90.0])));
        for wrong in ["", "roll", "heading=3", "roll=x", "roll=inf", "yaw=9999"] {
            assert!(mounting(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn altitudes() {
        assert_eq!(altitude("ellipsoid"), Ok(Geoid(0.0)));
        assert_eq!(altitude("msl=-32.5"), Ok(Geoid(-32.5)));
        for wrong in ["msl", "msl=x", "msl=nan", "msl=1000", "sea"] {
            assert!(altitude(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn topics() {
        assert_eq!(topic("imu=/imu/data"), Ok((Role::Imu, "/imu/data".into())));
        assert_eq!(topic("standing=none"), Ok((Role::Standing, "none".into())));
        assert!(topic("imux=/imu").unwrap_err().contains("gnss-velocity"));
        assert!(topic("/imu").is_err());
    }
}
