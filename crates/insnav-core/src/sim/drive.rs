//! A drive as plain data: where it starts, its legs, and how the body is turned against the path.

use super::range::{finite, require};
use crate::error::Result;
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// One stretch of a drive: over its duration, speed and slope change smoothly to new values and the course by an angle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Leg {
    /// Length in time, s.
    pub duration_s: f64,
    /// Speed along the path at the end, m/s.
    pub speed_m_per_s: f64,
    /// Change of course, clockwise, degrees.
    #[serde(default)]
    pub turn_deg: f64,
    /// Slope of the path at the end, up positive, degrees.
    #[serde(default)]
    pub slope_deg: f64,
}

/// One sine of a swaying body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wave {
    /// Amplitude at high speed, degrees.
    pub amplitude_deg: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Phase at the start, degrees.
    #[serde(default)]
    pub phase_deg: f64,
}

/// How the body is turned against its path: leaning in turns, squatting, swaying on its springs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Body {
    /// Roll and pitch that are always there: how the unit is mounted, degrees.
    pub tilt_deg: [f64; 2],
    /// Roll to the outside of a turn, degrees per m/s² of lateral acceleration.
    pub lean_deg_per_m_per_s2: f64,
    /// Nose up under acceleration, degrees per m/s².
    pub squat_deg_per_m_per_s2: f64,
    /// Sway in roll.
    pub roll: Vec<Wave>,
    /// Sway in pitch.
    pub pitch: Vec<Wave>,
    /// Speed at which the sway has half its amplitude, m/s; it vanishes at standstill.
    pub sway_speed_m_per_s: f64,
    /// What never comes to rest: wind, an idling engine, people.
    pub rocking: BodyRocking,
}

/// Rocking at the stops and under way alike, about a point that need not be where the unit is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BodyRocking {
    /// About the forward axis. All three add up to one rotation vector from the attitude that the body has otherwise.
    pub roll: Vec<Wave>,
    /// About the right axis.
    pub pitch: Vec<Wave>,
    /// About the down axis.
    pub yaw: Vec<Wave>,
    /// From the point that follows the path, about which the body rocks and turns, to the inertial unit, body axes, m.
    pub lever_b_m: [f64; 3],
}

/// A whole drive: start and legs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Drive {
    /// Stamp of the start, s on the log's clock.
    pub start_s: f64,
    /// Latitude of the start, degrees.
    pub latitude_deg: f64,
    /// Longitude of the start, degrees.
    pub longitude_deg: f64,
    /// Ellipsoidal height of the start, m.
    pub height_m: f64,
    /// Course at the start, degrees clockwise from north.
    pub heading_deg: f64,
    /// Speed at the start, m/s.
    #[serde(default)]
    pub speed_m_per_s: f64,
    /// What happens, one after the other.
    pub legs: Vec<Leg>,
    /// How the body is turned against the path.
    #[serde(default)]
    pub body: Body,
}

impl Drive {
    /// The first number outside its range, as an error.
    pub(super) fn check(&self) -> Result<()> {
        let count = self.legs.len();
        require(count > 0, "drive.legs", 0.0, "at least one leg")?;
        finite(&[self.start_s], "drive.start_s")?;
        let (lat, lon, height) = (self.latitude_deg, self.longitude_deg, self.height_m);
        require(lat.abs() <= 85.0, "drive.latitude_deg", lat, "within ±85")?;
        require(
            lon.abs() <= 360.0,
            "drive.longitude_deg",
            lon,
            "within ±360",
        )?;
        require(
            height.abs() <= 1e5,
            "drive.height_m",
            height,
            "within ±100000",
        )?;
        finite(&[self.heading_deg], "drive.heading_deg")?;
        let speed = |v: f64, key| require(v.abs() <= 1000.0, key, v, "within ±1000");
        speed(self.speed_m_per_s, "drive.speed_m_per_s")?;
        for leg in &self.legs {
            let (time, turn, slope) = (leg.duration_s, leg.turn_deg, leg.slope_deg);
            let sane = time > 0.0 && time <= 1e6;
            require(
                sane,
                "drive.legs.duration_s",
                time,
                "positive and at most 1000000",
            )?;
            speed(leg.speed_m_per_s, "drive.legs.speed_m_per_s")?;
            require(
                turn.abs() <= 1e5,
                "drive.legs.turn_deg",
                turn,
                "within ±100000",
            )?;
            require(
                slope.abs() <= 80.0,
                "drive.legs.slope_deg",
                slope,
                "within ±80",
            )?;
        }
        let body = &self.body;
        finite(&body.tilt_deg, "drive.body.tilt_deg")?;
        finite(
            &[body.lean_deg_per_m_per_s2],
            "drive.body.lean_deg_per_m_per_s2",
        )?;
        finite(
            &[body.squat_deg_per_m_per_s2],
            "drive.body.squat_deg_per_m_per_s2",
        )?;
        finite(&[body.sway_speed_m_per_s], "drive.body.sway_speed_m_per_s")?;
        let lever = &body.rocking.lever_b_m;
        finite(lever, "drive.body.rocking.lever_b_m")?;
        let longest = lever.iter().fold(0.0, |a: f64, l| a.max(l.abs()));
        // The step from one point's level to the other's is of first order in lever over Earth radius.
        require(
            longest <= 100.0,
            "drive.body.rocking.lever_b_m",
            longest,
            "within ±100",
        )?;
        for (waves, key) in [
            (&body.roll, "drive.body.roll"),
            (&body.pitch, "drive.body.pitch"),
            (&body.rocking.roll, "drive.body.rocking.roll"),
            (&body.rocking.pitch, "drive.body.rocking.pitch"),
            (&body.rocking.yaw, "drive.body.rocking.yaw"),
        ] {
            for w in waves {
                finite(&[w.amplitude_deg, w.frequency_hz, w.phase_deg], key)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenario::Scenario;
    use super::*;
    use crate::error::Error;

    #[test]
    fn bad_numbers_are_refused_by_name() {
        let good = Scenario::standing(10.0, 0.0).drive;
        let refused = |change: fn(&mut Drive)| {
            let mut drive = good.clone();
            change(&mut drive);
            match drive.check() {
                Err(Error::Config { key, .. }) => key,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(refused(|d| d.latitude_deg = f64::NAN), "drive.latitude_deg");
        assert_eq!(
            refused(|d| d.legs[0].duration_s = 0.0),
            "drive.legs.duration_s"
        );
        assert_eq!(
            refused(|d| d.legs[0].slope_deg = 90.0),
            "drive.legs.slope_deg"
        );
        assert_eq!(refused(|d| d.legs.clear()), "drive.legs");
    }
}
