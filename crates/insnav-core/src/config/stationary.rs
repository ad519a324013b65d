//! `[stationary]`: how stops are found, and what is made of them.

use super::{VehicleKind, check};
use crate::error::{Error, Result};
use crate::imu::ImuNoise;
use core::fmt;
use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Noise of the zero velocity of a vehicle, m/s/√Hz: 0.02 m/s at 100 Hz.
pub(crate) const ZERO_VELOCITY: f64 = 0.002;
/// Of a foot: it rolls on at about 0.02 m/s for some 0.1 s at a time, the same way in every step (\[Nilsson12b\]), and errors
/// of σ correlated over τ weigh like white noise of σ √(2τ).
const ZERO_VELOCITY_ON_FOOT: f64 = 0.01;

/// What a filter makes of a stop.
///
/// Two things are left to none of them but [`Off`](Self::Off). While the heading is known to no better than 0.5 rad, stops are held as by `static`: in the
/// others the Earth's rate, seen in the tilt, would pass for a sight of the heading, which a linear filter turns into false
/// certainty. And while nothing says whether the gyros' mean at the start was rest or a slow turn, they are held as by `zupt`,
/// which takes no mean rate for a bias about the vertical. A [`StopRecord`](crate::stationary::StopRecord) says how it was held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StationaryMode {
    /// For what carries the unit: `static`, or `zupt` on a foot, which rocks and rolls in every stance.
    #[default]
    Auto,
    /// Nothing: stops are found and told, the filter goes on as under way.
    Off,
    /// Zero velocity at every inertial sample.
    Zupt,
    /// Zero velocity, and zero rate about the vertical.
    Zihr,
    /// Zero velocity and a held heading (\[Kozadaev17\]).
    HeadingHold,
    /// Zero velocity and a held attitude, all three angles.
    AttitudeHold,
    /// Constant position and attitude; the inertial unit's means are measurements of its errors.
    Static,
    /// All inertial data of a stop at once, when it is over (\[Lobusov14\]: ZUPT-1 and ZUPT-2): for units that feel the Earth's rate
    /// in a minute, on vehicles that rock, without GNSS. Needs `std`; without it as `zupt`. A stop under 40 s, and one
    /// in which something else was measured, is led through by zero velocities alone; so are all where scale factors are known or
    /// estimated, and where headings count from the start. Half an hour is looked at at a time.
    Batch,
}

/// What tells a stop from motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DetectorKind {
    /// For what carries the unit: `composite`, or `glrt` on a foot.
    #[default]
    Auto,
    /// Low-passed variances, mean rate against the bias, and speed from GNSS or wheels.
    Composite,
    /// Variance of the specific force (\[Skog10\]).
    Mv,
    /// Magnitude of the specific force (\[Skog10\]).
    Mag,
    /// Energy of the angular rate (\[Skog10\]).
    Are,
    /// Generalised likelihood ratio, "SHOE" (\[Skog10\]).
    Glrt,
    /// None: what is declared alone counts.
    None,
}

/// The heading row of `heading_hold`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadingRow {
    /// Down component of the rotation since the stop began: exact at any pitch.
    #[default]
    Down,
    /// Difference of Euler headings (\[Kozadaev17\] eq. 13 to 15): singular at pitch ±90°.
    Euler,
}

/// What becomes of the heading's covariances when it is held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Bookkeeping {
    /// All moved along: nothing is lost.
    #[default]
    Exact,
    /// The variance alone (\[Kozadaev17\] to the letter): what was known together with other errors is forgotten.
    VarianceOnly,
}

/// Gain of the zero rate about the vertical.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadingRateGain {
    /// With the correlation between the rate's noise in the measurement and in the attitude: as good as a held heading.
    #[default]
    Correlated,
    /// As if the two were independent: over-pessimistic.
    Naive,
    /// On the gyro bias alone.
    BiasOnly,
}

/// The specific force in the error dynamics while standing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StandingForce {
    /// What a body at rest feels, −g.
    #[default]
    Gravity,
    /// What is measured: its noise makes the heading falsely observable.
    Measured,
}

/// The most intervals that can be declared.
pub const MOST_INTERVALS: usize = 32;

/// Intervals in which the user knows that the body stands: seconds from the zero of the log, in order, without overlap.
#[derive(Clone, Copy, PartialEq)]
pub struct Intervals {
    list: [[f64; 2]; MOST_INTERVALS],
    len: usize,
}

impl Default for Intervals {
    fn default() -> Self {
        Intervals {
            list: [[0.0; 2]; MOST_INTERVALS],
            len: 0,
        }
    }
}

impl fmt::Debug for Intervals {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.as_slice().fmt(f)
    }
}

impl Intervals {
    /// Of begins and ends; `None` when there are more than [`MOST_INTERVALS`].
    pub fn new(intervals: &[[f64; 2]]) -> Option<Self> {
        let mut out = Intervals::default();
        out.list
            .get_mut(..intervals.len())?
            .copy_from_slice(intervals);
        out.len = intervals.len();
        Some(out)
    }

    /// Begins and ends, s.
    pub fn as_slice(&self) -> &[[f64; 2]] {
        &self.list[..self.len.min(MOST_INTERVALS)]
    }

    fn validate(&self) -> Result<()> {
        let mut before = f64::NEG_INFINITY;
        for &[begin, end] in self.as_slice() {
            let refuse = |value, expected| Error::Config {
                key: "stationary.intervals_s",
                value,
                expected,
            };
            if !begin.is_finite() || !end.is_finite() {
                return Err(refuse(begin + end, "finite"));
            }
            if end <= begin {
                return Err(refuse(end, "after the begin of its interval"));
            }
            if begin < before {
                return Err(refuse(begin, "after the end of the interval before it"));
            }
            before = end;
        }
        Ok(())
    }
}

impl Serialize for Intervals {
    fn serialize<S: Serializer>(&self, serializer: S) -> core::result::Result<S::Ok, S::Error> {
        self.as_slice().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Intervals {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> core::result::Result<Self, D::Error> {
        deserializer.deserialize_seq(ListOfIntervals)
    }
}

/// Begin and end, and nothing after them: an array would let a third number pass.
struct Pair([f64; 2]);

impl<'de> Deserialize<'de> for Pair {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> core::result::Result<Self, D::Error> {
        if deserializer.is_human_readable() {
            deserializer.deserialize_seq(BeginAndEnd)
        } else {
            Ok(Pair(Deserialize::deserialize(deserializer)?))
        }
    }
}

struct BeginAndEnd;

impl<'de> Visitor<'de> for BeginAndEnd {
    type Value = Pair;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("pairs of seconds, as in [[40, 200], [310, 420]]")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> core::result::Result<Pair, A::Error> {
        let mut next = |at| {
            seq.next_element::<f64>()?
                .ok_or_else(|| de::Error::invalid_length(at, &self))
        };
        let pair = [next(0)?, next(1)?];
        match seq.next_element::<f64>()? {
            None => Ok(Pair(pair)),
            Some(_) => Err(de::Error::invalid_length(3, &self)),
        }
    }
}

struct ListOfIntervals;

impl<'de> Visitor<'de> for ListOfIntervals {
    type Value = Intervals;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "at most {MOST_INTERVALS} pairs of seconds, as in [[40, 200], [310, 420]]"
        )
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> core::result::Result<Intervals, A::Error> {
        let mut out = Intervals::default();
        while let Some(Pair(interval)) = seq.next_element::<Pair>()? {
            let Some(free) = out.list.get_mut(out.len) else {
                return Err(de::Error::invalid_length(out.len + 1, &self));
            };
            *free = interval;
            out.len += 1;
        }
        Ok(out)
    }
}

/// `[stationary]`
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StationaryConfig {
    /// What the filter makes of a stop.
    pub mode: StationaryMode,
    /// What finds stops.
    pub detector: DetectorKind,
    /// Stops that are known, seconds from the zero of the log; others are looked for all the same, unless `detector` is `none`.
    pub intervals_s: Intervals,
    /// Length of the detector's window, s; absent: 2 for the composite, 0.1 on a foot, 1 else.
    pub window_s: Option<f64>,
    /// For so long beyond a window must the detector agree before a stop is believed, s; absent: 0.5 for the composite, else 0.
    pub entry_s: Option<f64>,
    /// Factor on the thresholds, which follow from the noise.
    pub threshold_scale: f64,
    /// Raise thresholds to what stops that speed confirms have shown (engines that idle).
    pub adaptive: bool,
    /// Who is heard from GNSS or wheels to be faster does not stand, m/s.
    pub speed_m_per_s: f64,
    /// White noise of the gyros at rest, from which thresholds follow, °/√h; absent: that of `[noise]`.
    pub gyro_arw_deg_per_sqrt_hour: Option<f64>,
    /// White noise of the accelerometers at rest, likewise, m/s/√h.
    pub accel_vrw_m_per_s_per_sqrt_hour: Option<f64>,
    /// Noise of the zero velocity, m/s/√Hz: at an interval of dt its standard deviation is this over √dt; absent: 0.002 (0.02 m/s
    /// at 100 Hz), and 0.01 on a foot.
    pub zero_velocity_m_per_s_per_sqrt_hz: Option<f64>,
    /// Noise of the held heading or attitude, degrees/√Hz, likewise.
    pub held_heading_deg_per_sqrt_hz: f64,
    /// Row of `heading_hold`.
    pub heading_row: HeadingRow,
    /// Covariances of `heading_hold`.
    pub bookkeeping: Bookkeeping,
    /// Gain of `zihr`.
    pub heading_rate: HeadingRateGain,
    /// Specific force in the error dynamics while standing.
    pub force: StandingForce,
    /// How a body at rest turns in `static` all the same (thermal settling, a passenger), °/√h.
    pub attitude_walk_deg_per_sqrt_hour: f64,
    /// And moves, m/√s.
    pub position_walk_m_per_sqrt_s: f64,
    /// Standard deviation of the velocity in `static` and when it ends, m/s.
    pub velocity_sigma_m_per_s: f64,
}

impl Default for StationaryConfig {
    fn default() -> Self {
        StationaryConfig {
            mode: StationaryMode::default(),
            detector: DetectorKind::default(),
            intervals_s: Intervals::default(),
            window_s: None,
            entry_s: None,
            threshold_scale: 1.5,
            adaptive: true,
            speed_m_per_s: 0.25,
            gyro_arw_deg_per_sqrt_hour: None,
            accel_vrw_m_per_s_per_sqrt_hour: None,
            zero_velocity_m_per_s_per_sqrt_hz: None,
            // 0.1° at 100 Hz.
            held_heading_deg_per_sqrt_hz: 0.01,
            heading_row: HeadingRow::default(),
            bookkeeping: Bookkeeping::default(),
            heading_rate: HeadingRateGain::default(),
            force: StandingForce::default(),
            attitude_walk_deg_per_sqrt_hour: 0.005,
            position_walk_m_per_sqrt_s: 1e-3,
            velocity_sigma_m_per_s: 0.02,
        }
    }
}

impl StationaryConfig {
    /// With everything decided that depends on what carries the unit: no `auto` is left, window and entry are set.
    #[must_use]
    pub fn for_vehicle(mut self, kind: VehicleKind) -> Self {
        let on_foot = kind == VehicleKind::Foot;
        if self.mode == StationaryMode::Auto {
            self.mode = if on_foot {
                StationaryMode::Zupt
            } else {
                StationaryMode::Static
            };
        }
        if self.detector == DetectorKind::Auto {
            self.detector = if on_foot {
                DetectorKind::Glrt
            } else {
                DetectorKind::Composite
            };
        }
        let composite = self.detector == DetectorKind::Composite;
        self.window_s.get_or_insert(match (composite, on_foot) {
            (true, _) => 2.0,
            (false, true) => 0.1,
            (false, false) => 1.0,
        });
        self.entry_s
            .get_or_insert(if composite { 0.5 } else { 0.0 });
        self.zero_velocity_m_per_s_per_sqrt_hz
            .get_or_insert(if on_foot {
                ZERO_VELOCITY_ON_FOOT
            } else {
                ZERO_VELOCITY
            });
        self
    }

    /// The noise of a unit at rest, where that under way is `noise`.
    pub fn noise_at_rest(&self, noise: &ImuNoise) -> ImuNoise {
        let gyro = self.gyro_arw_deg_per_sqrt_hour;
        let accel = self.accel_vrw_m_per_s_per_sqrt_hour;
        ImuNoise {
            gyro_white: gyro.map_or(noise.gyro_white, |x| x.to_radians() / 60.0),
            accel_white: accel.map_or(noise.accel_white, |x| x / 60.0),
            ..*noise
        }
    }

    pub(super) fn validate(&self) -> Result<()> {
        self.intervals_s.validate()?;
        let positive = |key, value| check(key, value, |x| x > 0.0, "finite and above 0");
        let not_negative = |key, value| {
            check(
                key,
                Some(value),
                |x: f64| x >= 0.0,
                "finite and not negative",
            )
        };
        positive("stationary.window_s", self.window_s)?;
        positive(
            "stationary.zero_velocity_m_per_s_per_sqrt_hz",
            self.zero_velocity_m_per_s_per_sqrt_hz,
        )?;
        not_negative("stationary.entry_s", self.entry_s.unwrap_or_default())?;
        for (key, value) in [
            ("stationary.threshold_scale", self.threshold_scale),
            ("stationary.speed_m_per_s", self.speed_m_per_s),
            (
                "stationary.held_heading_deg_per_sqrt_hz",
                self.held_heading_deg_per_sqrt_hz,
            ),
            (
                "stationary.velocity_sigma_m_per_s",
                self.velocity_sigma_m_per_s,
            ),
        ] {
            positive(key, Some(value))?;
        }
        positive(
            "stationary.gyro_arw_deg_per_sqrt_hour",
            self.gyro_arw_deg_per_sqrt_hour,
        )?;
        positive(
            "stationary.accel_vrw_m_per_s_per_sqrt_hour",
            self.accel_vrw_m_per_s_per_sqrt_hour,
        )?;
        not_negative(
            "stationary.attitude_walk_deg_per_sqrt_hour",
            self.attitude_walk_deg_per_sqrt_hour,
        )?;
        not_negative(
            "stationary.position_walk_m_per_sqrt_s",
            self.position_walk_m_per_sqrt_s,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_open_follows_from_the_vehicle_and_what_is_set_stays() {
        let open = StationaryConfig::default();
        let car = open.for_vehicle(VehicleKind::Car);
        assert_eq!(
            (car.mode, car.detector, car.window_s, car.entry_s),
            (
                StationaryMode::Static,
                DetectorKind::Composite,
                Some(2.0),
                Some(0.5)
            )
        );
        let foot = open.for_vehicle(VehicleKind::Foot);
        assert_eq!(
            (foot.mode, foot.detector, foot.entry_s),
            (StationaryMode::Zupt, DetectorKind::Glrt, Some(0.0))
        );
        let set = StationaryConfig {
            mode: StationaryMode::Off,
            detector: DetectorKind::Mv,
            window_s: Some(0.3),
            entry_s: Some(0.2),
            zero_velocity_m_per_s_per_sqrt_hz: Some(0.03),
            ..open
        };
        assert_eq!(set.for_vehicle(VehicleKind::Foot), set);
    }

    #[test]
    fn intervals_that_overlap_or_run_backward_are_refused_with_their_number() {
        let judge = |list: &[[f64; 2]]| Intervals::new(list).unwrap().validate();
        assert!(judge(&[[40.0, 200.0], [200.0, 380.0]]).is_ok());
        for (bad, named) in [
            (&[[200.0, 40.0]][..], "40"),
            (&[[0.0, 10.0], [9.5, 20.0]], "9.5"),
            (&[[f64::NAN, 1.0]], "NaN"),
        ] {
            let error = judge(bad).unwrap_err().to_string();
            assert!(
                error.contains("intervals_s") && error.contains(named),
                "{error}"
            );
        }
        assert!(Intervals::new(&[[0.0, 1.0]; MOST_INTERVALS + 1]).is_none());
    }
}
