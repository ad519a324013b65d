//! The tables by kind of sensor.

use super::Table;
use crate::error::LogError;
use insnav_core::earth::Geodetic;
use insnav_core::sample::{GnssPosition, GnssVelocity, ImuSample, MagneticField};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::path::Path;

/// One microtesla in tesla.
pub(crate) const MICROTESLA: f64 = 1e-6;

/// `imu.csv`: `t_s,gx,gy,gz,ax,ay,az[,mx,my,mz][,moving]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImuTable {
    /// Time, s.
    pub t_s: Vec<f64>,
    /// Angular rate, rad/s, axes of the file (forward-right-down unless it says otherwise).
    pub angular_rate: Vec<Vector3<f64>>,
    /// Specific force, m/s².
    pub specific_force: Vec<Vector3<f64>>,
    /// Magnetic field, µT; empty if the file has none.
    pub magnetic_field: Vec<Vector3<f64>>,
    /// Where a benchmark scores; empty if the file does not say.
    pub moving: Vec<bool>,
}

/// Read an `imu.csv`.
pub fn read_imu(path: &Path) -> Result<ImuTable, LogError> {
    let table = Table::read(path)?;
    let magnetic_field = if table.group(&[&["mx"], &["my"], &["mz"]])? {
        vectors(&table, ["mx", "my", "mz"])?
    } else {
        Vec::new()
    };
    Ok(ImuTable {
        t_s: table.times()?,
        angular_rate: vectors(&table, ["gx", "gy", "gz"])?,
        specific_force: vectors(&table, ["ax", "ay", "az"])?,
        magnetic_field,
        moving: flags(&table, "moving"),
    })
}

impl ImuTable {
    /// The samples, with `t_s` counted from `t0`.
    pub fn samples(&self, t0: Time) -> impl Iterator<Item = ImuSample> + '_ {
        (0..self.t_s.len()).map(move |i| ImuSample {
            time: t0.plus(self.t_s[i]),
            angular_rate_b: self.angular_rate[i],
            specific_force_b: self.specific_force[i],
        })
    }

    /// The magnetic fields in tesla, with `t_s` counted from `t0`; none where a cell is empty or NaN.
    pub fn magnetic_fields(&self, t0: Time) -> impl Iterator<Item = MagneticField> + '_ {
        self.t_s
            .iter()
            .zip(&self.magnetic_field)
            .filter(|(_, field)| field.iter().all(|x| x.is_finite()))
            .map(move |(t_s, field)| MagneticField {
                time: t0.plus(*t_s),
                field_b: field * MICROTESLA,
            })
    }
}

/// `gnss.csv`: `t_s,lat_deg,lon_deg,h_m[,vn,ve,vd][,sn,se,sd][,svn,sve,svd][,fix]`; NaN where not known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GnssTable {
    /// Time, s.
    pub t_s: Vec<f64>,
    /// Position of the antenna.
    pub position: Vec<Geodetic>,
    /// Velocity NED, m/s.
    pub velocity_n: Vec<Vector3<f64>>,
    /// Standard deviation of the position NED, m, as the receiver states it.
    pub position_sigma_n: Vec<Vector3<f64>>,
    /// Standard deviation of the velocity NED, m/s, as the receiver states it.
    pub velocity_sigma_n: Vec<Vector3<f64>>,
    /// The receiver's own code of the kind of fix.
    pub fix: Vec<f64>,
}

/// Read a `gnss.csv`.
pub fn read_gnss(path: &Path) -> Result<GnssTable, LogError> {
    let table = Table::read(path)?;
    Ok(GnssTable {
        t_s: table.times()?,
        position: positions(&table)?,
        velocity_n: vectors_or_nan(&table, ["vn", "ve", "vd"]),
        position_sigma_n: vectors_or_nan(&table, ["sn", "se", "sd"]),
        velocity_sigma_n: vectors_or_nan(&table, ["svn", "sve", "svd"]),
        fix: table.column_or_nan(&["fix"]),
    })
}

impl GnssTable {
    /// The position of a row, with `t_s` counted from `t0`; `None` if it has none.
    pub fn position_sample(&self, row: usize, t0: Time) -> Option<GnssPosition> {
        self.position[row].is_valid().then(|| GnssPosition {
            time: t0.plus(self.t_s[row]),
            position: self.position[row],
            covariance_n: diagonal(&self.position_sigma_n[row]),
        })
    }

    /// The velocity of a row, with `t_s` counted from `t0`; `None` if it has none. Its Down component may be NaN.
    pub fn velocity_sample(&self, row: usize, t0: Time) -> Option<GnssVelocity> {
        let velocity_n = self.velocity_n[row];
        let mut sigma = self.velocity_sigma_n[row];
        if velocity_n.z.is_nan() && sigma.z.is_nan() {
            sigma.z = sigma.x.max(sigma.y);
        }
        (velocity_n.x.is_finite() && velocity_n.y.is_finite()).then(|| GnssVelocity {
            time: t0.plus(self.t_s[row]),
            velocity_n,
            covariance_n: diagonal(&sigma),
        })
    }
}

/// `truth.csv`: `t_s,lat_deg,lon_deg,h_m[,vn,ve,vd][,roll_deg,pitch_deg,yaw_deg]` and standard deviations; NaN where not
/// known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TruthTable {
    /// Time, s.
    pub t_s: Vec<f64>,
    /// Position.
    pub position: Vec<Geodetic>,
    /// Velocity NED, m/s.
    pub velocity_n: Vec<Vector3<f64>>,
    /// Roll, pitch, heading, degrees.
    pub euler_deg: Vec<Vector3<f64>>,
    /// Standard deviation of the position NED, m.
    pub position_sigma_n: Vec<Vector3<f64>>,
    /// True if the file has velocities.
    pub has_velocity: bool,
    /// True if the file has angles.
    pub has_attitude: bool,
}

/// Read a `truth.csv`. A `gnss.csv` is one too, without angles.
pub fn read_truth(path: &Path) -> Result<TruthTable, LogError> {
    let table = Table::read(path)?;
    let heading: &[&str] = &["yaw_deg", "heading_deg"];
    let has_attitude = table.group(&[&["roll_deg"], &["pitch_deg"], heading])?;
    let [roll, pitch, heading] =
        [&["roll_deg"], &["pitch_deg"], heading].map(|names: &[&str]| table.column_or_nan(names));
    let euler_deg = (0..table.rows())
        .map(|i| Vector3::new(roll[i], pitch[i], heading[i]))
        .collect();
    Ok(TruthTable {
        t_s: table.times()?,
        position: positions(&table)?,
        velocity_n: vectors_or_nan(&table, ["vn", "ve", "vd"]),
        euler_deg,
        position_sigma_n: vectors_or_nan(&table, ["sn", "se", "sd"]),
        has_velocity: table.column(&["vn"]).is_some() && table.column(&["ve"]).is_some(),
        has_attitude,
    })
}

/// `truth_quat.csv`: `t_s,qw,qx,qy,qz[,moving]`, sensor to earth; NaN where there is no truth.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QuaternionTable {
    /// Time, s.
    pub t_s: Vec<f64>,
    /// Rotation from the sensor to the earth frame; `None` where the file has NaN.
    pub orientation: Vec<Option<UnitQuaternion<f64>>>,
    /// Where a benchmark scores; empty if the file does not say.
    pub moving: Vec<bool>,
}

/// Read a `truth_quat.csv`.
pub fn read_truth_quat(path: &Path) -> Result<QuaternionTable, LogError> {
    let table = Table::read(path)?;
    let w = table.require(&["qw"])?;
    let vector = vectors(&table, ["qx", "qy", "qz"])?;
    let orientation = (0..table.rows())
        .map(|i| {
            let q = Quaternion::from_parts(w[i], vector[i]);
            let norm = q.norm();
            (norm.is_finite() && norm > 0.5).then(|| UnitQuaternion::new_normalize(q))
        })
        .collect();
    Ok(QuaternionTable {
        t_s: table.times()?,
        orientation,
        moving: flags(&table, "moving"),
    })
}

/// A speed over ground along the body: `t_s` with `speed_mps`, `speed_m_per_s` or `v_fwd`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SpeedTable {
    /// Time, s.
    pub t_s: Vec<f64>,
    /// Speed, m/s.
    pub speed_m_per_s: Vec<f64>,
}

/// Read a speedometer or wheel table.
pub fn read_speed(path: &Path) -> Result<SpeedTable, LogError> {
    let table = Table::read(path)?;
    let speed = table
        .require(&["speed_m_per_s", "speed_mps", "v_fwd"])?
        .to_vec();
    Ok(SpeedTable {
        t_s: table.times()?,
        speed_m_per_s: speed,
    })
}

fn positions(table: &Table) -> Result<Vec<Geodetic>, LogError> {
    let latitude = table.require(&["lat_deg", "latitude_deg"])?;
    let longitude = table.require(&["lon_deg", "longitude_deg"])?;
    let height = table.require(&["h_m", "height_m"])?;
    Ok((0..table.rows())
        .map(|i| Geodetic::from_degrees(latitude[i], longitude[i], height[i]))
        .collect())
}

fn vectors(table: &Table, names: [&str; 3]) -> Result<Vec<Vector3<f64>>, LogError> {
    let [x, y, z] = [
        table.require(&[names[0]])?,
        table.require(&[names[1]])?,
        table.require(&[names[2]])?,
    ];
    Ok((0..table.rows())
        .map(|i| Vector3::new(x[i], y[i], z[i]))
        .collect())
}

fn vectors_or_nan(table: &Table, names: [&str; 3]) -> Vec<Vector3<f64>> {
    let [x, y, z] = names.map(|name| table.column_or_nan(&[name]));
    (0..table.rows())
        .map(|i| Vector3::new(x[i], y[i], z[i]))
        .collect()
}

fn flags(table: &Table, name: &str) -> Vec<bool> {
    table.column(&[name]).map_or_else(Vec::new, |column| {
        column.iter().map(|v| *v != 0.0).collect()
    })
}

/// A covariance from standard deviations; `None` unless all three are known and positive.
fn diagonal(sigma: &Vector3<f64>) -> Option<Matrix3<f64>> {
    sigma
        .iter()
        .all(|s| s.is_finite() && *s > 0.0)
        .then(|| Matrix3::from_diagonal(&sigma.component_mul(sigma)))
}
