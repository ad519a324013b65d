//! Settings of a run, in the units of data sheets; every key carries its unit.
//!
//! One schema for Rust, the command line (TOML) and Python. Absent means "choose": what was chosen is reported.

mod stationary;

pub(crate) use stationary::ZERO_VELOCITY;
pub use stationary::{
    Bookkeeping, DetectorKind, HeadingRateGain, HeadingRow, Intervals, MOST_INTERVALS,
    StandingForce, StationaryConfig, StationaryMode,
};

use crate::earth::Geodetic;
use crate::error::{Error, Result};
use crate::imu::{ImuGrade, ImuNoise, STANDARD_GRAVITY};
use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// All settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// The inertial unit.
    pub imu: ImuConfig,
    /// The GNSS receiver.
    pub gnss: GnssConfig,
    /// What carries them.
    pub vehicle: VehicleConfig,
    /// Noise of the inertial unit, where it is known better than by its grade.
    pub noise: NoiseConfig,
    /// Start.
    pub alignment: AlignmentConfig,
    /// Stops.
    pub stationary: StationaryConfig,
    /// Output.
    pub output: OutputConfig,
}

impl Config {
    /// Check every number.
    ///
    /// # Errors
    /// `Config` names the first key outside its range.
    pub fn validate(&self) -> Result<()> {
        let Config {
            imu,
            gnss,
            vehicle,
            noise,
            alignment,
            stationary,
            output,
        } = self;
        let positive =
            |key, value: Option<f64>| check(key, value, |x| x > 0.0, "finite and above 0");
        let not_negative = |key, value| {
            check(
                key,
                Some(value),
                |x: f64| x >= 0.0,
                "finite and not negative",
            )
        };
        let finite = |key, values: [f64; 3]| {
            values
                .iter()
                .try_for_each(|&x| check(key, Some(x), |_| true, "finite"))
        };
        let within = |key, value: f64| {
            check(
                key,
                Some(value),
                |x: f64| x.abs() <= 5.0,
                "between -5 and 5",
            )
        };
        finite("imu.mounting_rpy_deg", imu.mounting_rpy_deg)?;
        finite("gnss.lever_arm_b_m", gnss.lever_arm_b_m.unwrap_or_default())?;
        not_negative("gnss.sigma_floor_m", gnss.sigma_floor_m)?;
        not_negative(
            "gnss.velocity_sigma_floor_m_per_s",
            gnss.velocity_sigma_floor_m_per_s,
        )?;
        positive("gnss.sigma_scale", gnss.sigma_scale.fixed())?;
        positive(
            "gnss.velocity_sigma_scale",
            gnss.velocity_sigma_scale.fixed(),
        )?;
        not_negative("gnss.correlation_time_s", gnss.correlation_time_s)?;
        positive("imu.gyro_scale_sigma_ppm", imu.gyro_scale_sigma_ppm)?;
        positive("imu.accel_scale_sigma_ppm", imu.accel_scale_sigma_ppm)?;
        positive("gnss.colour.sigma_m", gnss.colour.map(|c| c.sigma_m))?;
        positive(
            "gnss.colour.vertical_sigma_m",
            gnss.colour.and_then(|c| c.vertical_sigma_m),
        )?;
        positive("gnss.colour.tau_s", gnss.colour.map(|c| c.tau_s))?;
        positive("gnss.lever_arm_sigma_m", gnss.lever_arm_sigma_m)?;
        positive("gnss.time_offset_sigma_s", gnss.time_offset_sigma_s)?;
        within("gnss.time_offset_s", gnss.time_offset_s)?;
        within("gnss.velocity_lag_s", gnss.velocity_lag_s)?;
        positive(
            "vehicle.nonholonomic_sigma_m_per_s",
            Some(vehicle.nonholonomic_sigma_m_per_s),
        )?;
        finite("vehicle.axle_b_m", vehicle.axle_b_m.unwrap_or_default())?;
        positive("vehicle.axle_sigma_m", Some(vehicle.axle_sigma_m))?;
        positive(
            "vehicle.mounting_sigma_deg",
            Some(vehicle.mounting_sigma_deg),
        )?;
        positive(
            "noise.gyro_arw_deg_per_sqrt_hour",
            noise.gyro_arw_deg_per_sqrt_hour,
        )?;
        positive(
            "noise.accel_vrw_m_per_s_per_sqrt_hour",
            noise.accel_vrw_m_per_s_per_sqrt_hour,
        )?;
        positive("noise.gyro_bias_deg_per_hour", noise.gyro_bias_deg_per_hour)?;
        positive("noise.accel_bias_mg", noise.accel_bias_mg)?;
        positive("noise.gyro_bias_tau_s", noise.gyro_bias_tau_s)?;
        positive("noise.accel_bias_tau_s", noise.accel_bias_tau_s)?;
        positive(
            "noise.magnetometer_microtesla",
            noise.magnetometer_microtesla,
        )?;
        check(
            "alignment.heading_deg",
            alignment.heading_deg,
            |x| x.abs() <= 360.0,
            "between -360 and 360",
        )?;
        positive("alignment.heading_sigma_deg", alignment.heading_sigma_deg)?;
        positive("alignment.magnetic_sigma_deg", alignment.magnetic_sigma_deg)?;
        check(
            "alignment.declination_deg",
            alignment.declination_deg,
            |x| x.abs() <= 180.0,
            "between -180 and 180",
        )?;
        // North is what a solution is made of, and at the poles there is none.
        check(
            "alignment.latitude_deg",
            alignment.latitude_deg,
            |x| x.abs() <= 89.0,
            "between -89 and 89",
        )?;
        let latitude_told_else = |rule: bool, expected| {
            check(
                "alignment.latitude_deg",
                alignment.latitude_deg,
                |_| !rule,
                expected,
            )
        };
        latitude_told_else(
            gnss.used,
            "left out where GNSS is used (gnss.use = false, or --imu-only)",
        )?;
        latitude_told_else(
            output.origin.is_some(),
            "left out where output.origin says it",
        )?;
        stationary.validate()?;
        not_negative("output.rate_hz", output.rate_hz)?;
        finite("output.lever_arm_b_m", output.lever_arm_b_m)?;
        let [latitude, longitude, height] = output.origin.unwrap_or_default();
        check(
            "output.origin",
            Some(latitude),
            |x| x.abs() <= 89.0,
            "a latitude between -89 and 89 first",
        )?;
        check(
            "output.origin",
            Some(longitude),
            |x| x.abs() <= 360.0,
            "a longitude between -360 and 360 in the middle",
        )?;
        check("output.origin", Some(height), |_| true, "finite")
    }
}

/// Latitude of a run without GNSS of which nobody tells the place, degrees: gravity is within 0.3 % of that anywhere.
const MIDDLE_LATITUDE_DEG: f64 = 45.0;

impl Config {
    /// Where a run without GNSS begins, and whether that was told; `None` for a run with GNSS.
    pub fn place_without_gnss(&self) -> Option<(Geodetic, bool)> {
        if self.gnss.used {
            return None;
        }
        Some(match (self.output.origin, self.alignment.latitude_deg) {
            (Some([latitude, longitude, height]), _) => {
                (Geodetic::from_degrees(latitude, longitude, height), true)
            }
            (None, Some(latitude)) => (Geodetic::from_degrees(latitude, 0.0, 0.0), true),
            (None, None) => (Geodetic::from_degrees(MIDDLE_LATITUDE_DEG, 0.0, 0.0), false),
        })
    }
}

/// `Err` when a value is given and is not finite or fails its rule.
fn check(
    key: &'static str,
    value: Option<f64>,
    rule: impl Fn(f64) -> bool,
    expected: &'static str,
) -> Result<()> {
    match value {
        Some(value) if !(value.is_finite() && rule(value)) => Err(Error::Config {
            key,
            value,
            expected,
        }),
        _ => Ok(()),
    }
}

/// `[imu]`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuConfig {
    /// Class of the unit; absent: picked from the log's own noise.
    pub grade: Option<ImuGrade>,
    /// Roll, pitch, yaw of the unit's axes against the vehicle's (forward-right-down), degrees, 3-2-1.
    pub mounting_rpy_deg: [f64; 3],
    /// Estimate constant scale factor errors of the gyros that are of this size, ppm; absent: none.
    pub gyro_scale_sigma_ppm: Option<f64>,
    /// Likewise of the accelerometers.
    pub accel_scale_sigma_ppm: Option<f64>,
}

/// `[gnss]`
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GnssConfig {
    /// Whether positions and velocities are used. Without them a run begins at rest, at `output.origin` or at a latitude, and
    /// positions count from there.
    #[serde(rename = "use")]
    pub used: bool,
    /// Antenna from the IMU, forward-right-down, m; absent: taken from the log's transforms, else zero.
    pub lever_arm_b_m: Option<[f64; 3]>,
    /// Least standard deviation of a position component that is believed, m.
    pub sigma_floor_m: f64,
    /// Least standard deviation of a velocity component that is believed, m/s.
    pub velocity_sigma_floor_m_per_s: f64,
    /// Factor on stated position sigmas, or `auto`: learnt from the residuals.
    pub sigma_scale: SigmaScale,
    /// Factor on stated velocity sigmas, or `auto`: learnt, never below 1.
    pub velocity_sigma_scale: SigmaScale,
    /// Correlation time of position errors, s: fixes that come faster than twice this are weighed down until their mean is
    /// believed no more than errors of that correlation allow. No receiver's fixes are independent within a second (its own
    /// filter sees to that); errors of multipath and atmosphere are correlated for far longer.
    pub correlation_time_s: f64,
    /// Seconds added to IMU stamps to meet the clock of GNSS positions.
    pub time_offset_s: f64,
    /// How much later than its position's a receiver's velocity is stamped, s.
    pub velocity_lag_s: f64,
    /// Estimate the time-correlated part of the position error; absent: all of it is taken as white, weighed down as
    /// `correlation_time_s` says.
    pub colour: Option<ColourConfig>,
    /// Estimate the lever arm, known to this along each axis, m; absent: it is taken as given.
    pub lever_arm_sigma_m: Option<f64>,
    /// Estimate the clock offset, known to this, s; absent: it is taken as given.
    pub time_offset_sigma_s: Option<f64>,
}

/// A first-order Gauss–Markov error of GNSS positions (multipath, atmosphere).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColourConfig {
    /// Standard deviation in north and in east, m.
    pub sigma_m: f64,
    /// Standard deviation of the height, m; absent: the same.
    #[serde(default)]
    pub vertical_sigma_m: Option<f64>,
    /// Correlation time, s.
    pub tau_s: f64,
}

impl Default for GnssConfig {
    fn default() -> Self {
        GnssConfig {
            used: true,
            lever_arm_b_m: None,
            // A carrier-phase fix is good to a centimetre and its antenna sways against the IMU by about as much.
            sigma_floor_m: 0.01,
            velocity_sigma_floor_m_per_s: 0.02,
            sigma_scale: SigmaScale::Auto,
            velocity_sigma_scale: SigmaScale::Auto,
            correlation_time_s: 0.5,
            time_offset_s: 0.0,
            velocity_lag_s: 0.0,
            colour: None,
            lever_arm_sigma_m: None,
            time_offset_sigma_s: None,
        }
    }
}

/// A factor on the sigmas that a receiver states: a number, or `"auto"`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum SigmaScale {
    /// Learnt from the residuals.
    #[default]
    Auto,
    /// As given.
    Fixed(f64),
}

impl SigmaScale {
    /// The number, if one is given.
    pub fn fixed(self) -> Option<f64> {
        match self {
            SigmaScale::Auto => None,
            SigmaScale::Fixed(k) => Some(k),
        }
    }
}

impl Serialize for SigmaScale {
    fn serialize<S: Serializer>(&self, serializer: S) -> core::result::Result<S::Ok, S::Error> {
        if !serializer.is_human_readable() {
            return self.fixed().serialize(serializer);
        }
        match self {
            SigmaScale::Auto => serializer.serialize_str("auto"),
            SigmaScale::Fixed(k) => serializer.serialize_f64(*k),
        }
    }
}

impl<'de> Deserialize<'de> for SigmaScale {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> core::result::Result<Self, D::Error> {
        if deserializer.is_human_readable() {
            deserializer.deserialize_any(NumberOrAuto)
        } else {
            let fixed = Option::<f64>::deserialize(deserializer)?;
            Ok(fixed.map_or(SigmaScale::Auto, SigmaScale::Fixed))
        }
    }
}

struct NumberOrAuto;

impl Visitor<'_> for NumberOrAuto {
    type Value = SigmaScale;

    fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str("a number or \"auto\"")
    }

    fn visit_f64<E: de::Error>(self, k: f64) -> core::result::Result<SigmaScale, E> {
        Ok(SigmaScale::Fixed(k))
    }

    fn visit_i64<E: de::Error>(self, k: i64) -> core::result::Result<SigmaScale, E> {
        Ok(SigmaScale::Fixed(k as f64))
    }

    fn visit_u64<E: de::Error>(self, k: u64) -> core::result::Result<SigmaScale, E> {
        Ok(SigmaScale::Fixed(k as f64))
    }

    fn visit_str<E: de::Error>(self, text: &str) -> core::result::Result<SigmaScale, E> {
        match text {
            "auto" => Ok(SigmaScale::Auto),
            other => Err(E::invalid_value(de::Unexpected::Str(other), &self)),
        }
    }
}

/// What carries the unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VehicleKind {
    /// Moves where its nose points, so that course gives heading.
    #[default]
    Car,
    /// May move in any direction: course says nothing about heading.
    Any,
    /// On a foot: stands for a fraction of a second with every step.
    Foot,
}

/// What is made of the wheels of a vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Nonholonomic {
    /// For a car, what its own log bears out; `Off` where nobody has looked, as in a navigator without a plan.
    #[default]
    Auto,
    /// Nothing.
    Off,
    /// Velocity across is zero.
    Lateral,
    /// Velocity across and upwards is zero.
    On,
}

impl Nonholonomic {
    /// Whether the constraint is used at all.
    pub fn is_used(self) -> bool {
        matches!(self, Nonholonomic::Lateral | Nonholonomic::On)
    }
}

/// `[vehicle]`
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VehicleConfig {
    /// Kind.
    pub kind: VehicleKind,
    /// Use that a wheeled vehicle moves neither across nor upwards of itself, and find the IMU's pitch and yaw against it.
    pub nonholonomic: Nonholonomic,
    /// What is left of the velocity across and upwards on a straight road, m/s.
    pub nonholonomic_sigma_m_per_s: f64,
    /// Middle of the axle that is not steered from the IMU, forward-right-down, m; absent: how far forward it is is estimated.
    pub axle_b_m: Option<[f64; 3]>,
    /// How far from the IMU, forward or back, an axle may be of which nothing is said, m.
    pub axle_sigma_m: f64,
    /// How far pitch and yaw of the IMU against the vehicle may be from those of the settings, degrees.
    pub mounting_sigma_deg: f64,
}

impl Default for VehicleConfig {
    fn default() -> Self {
        VehicleConfig {
            kind: VehicleKind::Car,
            nonholonomic: Nonholonomic::Auto,
            nonholonomic_sigma_m_per_s: 0.2,
            axle_b_m: None,
            axle_sigma_m: 1.5,
            mounting_sigma_deg: 10.0,
        }
    }
}

/// Whether noise is adapted to what the innovations of the run itself show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NoiseAdapt {
    /// As set, or chosen.
    #[default]
    Off,
    /// By autocovariance least squares, before the run that is written; what the log does not tell stays as it was.
    Als,
}

/// `[noise]`: overrides of the grade, each alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseConfig {
    /// Gyro white noise, °/√h.
    pub gyro_arw_deg_per_sqrt_hour: Option<f64>,
    /// Accelerometer white noise, m/s/√h.
    pub accel_vrw_m_per_s_per_sqrt_hour: Option<f64>,
    /// Gyro bias, steady-state sigma of its Gauss–Markov process, °/h.
    pub gyro_bias_deg_per_hour: Option<f64>,
    /// Accelerometer bias, likewise, mg.
    pub accel_bias_mg: Option<f64>,
    /// Correlation time of the gyro bias, s.
    pub gyro_bias_tau_s: Option<f64>,
    /// Correlation time of the accelerometer bias, s.
    pub accel_bias_tau_s: Option<f64>,
    /// White noise of one sample of the magnetometer, on each axis, µT: for attitude filters, no run uses it.
    pub magnetometer_microtesla: Option<f64>,
    /// Estimate the white noise of the unit and the sigmas of GNSS from the log's own innovations; for the plan of a run, which sets
    /// the numbers. A navigator by itself takes them as they are.
    pub adapt: NoiseAdapt,
}

impl NoiseConfig {
    /// These numbers, and where there is none that of `other`.
    pub fn or(&self, other: &NoiseConfig) -> NoiseConfig {
        NoiseConfig {
            gyro_arw_deg_per_sqrt_hour: self
                .gyro_arw_deg_per_sqrt_hour
                .or(other.gyro_arw_deg_per_sqrt_hour),
            accel_vrw_m_per_s_per_sqrt_hour: self
                .accel_vrw_m_per_s_per_sqrt_hour
                .or(other.accel_vrw_m_per_s_per_sqrt_hour),
            gyro_bias_deg_per_hour: self.gyro_bias_deg_per_hour.or(other.gyro_bias_deg_per_hour),
            accel_bias_mg: self.accel_bias_mg.or(other.accel_bias_mg),
            gyro_bias_tau_s: self.gyro_bias_tau_s.or(other.gyro_bias_tau_s),
            accel_bias_tau_s: self.accel_bias_tau_s.or(other.accel_bias_tau_s),
            magnetometer_microtesla: self
                .magnetometer_microtesla
                .or(other.magnetometer_microtesla),
            adapt: self.adapt,
        }
    }

    /// The noise of a grade with these overrides.
    pub fn over(&self, grade: ImuGrade) -> ImuNoise {
        let class = grade.noise();
        let per_hour = |d: f64| d.to_radians() / 3600.0;
        let gyro_bias = self.gyro_bias_deg_per_hour.map(per_hour);
        let accel_bias = self.accel_bias_mg.map(|b| b * 1e-3 * STANDARD_GRAVITY);
        ImuNoise {
            gyro_white: self
                .gyro_arw_deg_per_sqrt_hour
                .map_or(class.gyro_white, |x| x.to_radians() / 60.0),
            accel_white: self
                .accel_vrw_m_per_s_per_sqrt_hour
                .map_or(class.accel_white, |x| x / 60.0),
            gyro_bias_sigma: gyro_bias.unwrap_or(class.gyro_bias_sigma),
            accel_bias_sigma: accel_bias.unwrap_or(class.accel_bias_sigma),
            gyro_bias_tau: self.gyro_bias_tau_s.unwrap_or(class.gyro_bias_tau),
            accel_bias_tau: self.accel_bias_tau_s.unwrap_or(class.accel_bias_tau),
        }
    }
}

/// `[alignment]`
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AlignmentConfig {
    /// Heading at the first sample, degrees clockwise from true north; absent: from the GNSS course. Without GNSS it is then
    /// zero by definition: the map's north is where the nose pointed.
    pub heading_deg: Option<f64>,
    /// Its standard deviation, degrees; absent: 5.
    pub heading_sigma_deg: Option<f64>,
    /// Latitude of a run without GNSS, degrees; absent: that of `output.origin`, else 45.
    pub latitude_deg: Option<f64>,
    /// Magnetic north from true north, degrees, positive to the east; absent: 0, with a warning where a magnetometer gives the
    /// heading.
    pub declination_deg: Option<f64>,
    /// Standard deviation of a magnetometer's heading, degrees; absent: 15, as of one that nobody has calibrated in its vehicle.
    pub magnetic_sigma_deg: Option<f64>,
}

/// `[output]`
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputConfig {
    /// Epochs per second; 0: at every inertial sample.
    pub rate_hz: f64,
    /// Point of the solution from the IMU, forward-right-down, m.
    pub lever_arm_b_m: [f64; 3],
    /// Origin of the map (latitude, longitude in degrees, height in metres); absent: the first fix.
    pub origin: Option<[f64; 3]>,
}

impl Default for OutputConfig {
    fn default() -> Self {
        OutputConfig {
            rate_hz: 50.0,
            lever_arm_b_m: [0.0; 3],
            origin: None,
        }
    }
}
