//! A reference to judge by, recognised by its header.

use super::{ComparedSolution, is_mcap, is_tum};
use crate::LogError;
use crate::csv::Table;
use crate::gnss_file::{GnssFileOptions, GnssFormat, GnssTrack};
use crate::run::Warning;
use insnav_core::attitude::wrap_angle;
use insnav_core::earth::Geodetic;
use insnav_core::metrics::{AttitudeReference, ReferencePoint, to_enu_flu};
use insnav_core::time::Time;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::path::Path;

/// A reference and what it is of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ComparedReference {
    /// Its points, in order of time.
    pub points: Vec<ReferencePoint>,
    /// Whether they are of the GNSS antenna: a CSV with positions and no attitude is the receiver's.
    pub at_antenna: bool,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl ComparedReference {
    /// Read a common CSV (any subset of columns), an RTKLIB `.pos`, NMEA sentences, a TUM trajectory around the solution's map origin, or another solution.
    /// Seconds of a CSV count from the solution's origin.
    pub fn read(path: &Path, solution: &ComparedSolution) -> Result<Self, LogError> {
        if is_mcap(path)? || is_tum(path)? {
            let other = ComparedSolution::read(path, solution.map_origin)?;
            return Ok(ComparedReference::of(&other));
        }
        if GnssFormat::of(path)? != GnssFormat::Csv {
            let options = GnssFileOptions {
                near: solution.track.points().first().map(|p| p.time),
                ..GnssFileOptions::default()
            };
            return Ok(of_receiver(GnssTrack::read(path, &options)?));
        }
        from_csv(&Table::read(path)?, solution.origin)
    }

    /// Another solution as a reference.
    pub fn of(other: &ComparedSolution) -> Self {
        ComparedReference {
            points: of_solution(other),
            at_antenna: false,
            warnings: Vec::new(),
        }
    }

    /// The same reference stamped `seconds` later.
    #[must_use]
    pub fn delayed(mut self, seconds: f64) -> Self {
        for point in &mut self.points {
            point.time = point.time.plus(seconds);
        }
        self
    }
}

fn of_receiver(track: GnssTrack) -> ComparedReference {
    let mut points: Vec<ReferencePoint> = track
        .positions
        .iter()
        .map(|fix| ReferencePoint {
            time: fix.time,
            position: Some(fix.position),
            position_sigma_n: fix
                .covariance_n
                .map(|p| p.diagonal().map(f64::sqrt))
                .unwrap_or_default(),
            ..ReferencePoint::default()
        })
        .collect();
    points.sort_by_key(|p| p.time);
    for velocity in &track.velocities {
        // Velocities without a position of their own say too little to be worth a point.
        if let Ok(at) = points.binary_search_by_key(&velocity.time, |p| p.time) {
            points[at].velocity_n = Some(velocity.velocity_n);
            points[at].velocity_sigma_n = velocity
                .covariance_n
                .map(|p| p.diagonal().map(f64::sqrt))
                .unwrap_or_default();
        }
    }
    ComparedReference {
        points,
        at_antenna: true,
        warnings: track.warnings,
    }
}

fn of_solution(other: &ComparedSolution) -> Vec<ReferencePoint> {
    let sigma = |p: Option<nalgebra::Matrix3<f64>>| {
        p.map(|p| p.diagonal().map(f64::sqrt)).unwrap_or_default()
    };
    let point = |p: &insnav_core::metrics::SolutionPoint| ReferencePoint {
        time: p.time,
        position: p.position,
        position_sigma_n: sigma(p.position_covariance_n),
        velocity_n: p.velocity_n,
        velocity_sigma_n: sigma(p.velocity_covariance_n),
        attitude: match p
            .q_nb
            .map(|q| insnav_core::attitude::Euler::from_quaternion(&q))
        {
            // Of what turns and goes nowhere, as benchmarks of orientation have it.
            Some(_) if p.position.is_none() => p
                .q_nb
                .map_or(AttitudeReference::None, AttitudeReference::Quaternion),
            // As angles: quaternions would call for the keys of such a benchmark.
            Some(e) => AttitudeReference::Angles {
                roll: e.roll,
                pitch: e.pitch,
                heading: e.heading,
            },
            None => AttitudeReference::None,
        },
        moving: p.stationary.map(|s| !s),
    };
    other.track.points().iter().map(point).collect()
}

fn from_csv(table: &Table, origin: Time) -> Result<ComparedReference, LogError> {
    let t_s = table.require(&["t_s"])?;
    let column = |names: &[&str]| table.column(names);
    let vector = |names: [&str; 3]| {
        let columns = names.map(|n| column(&[n]));
        let any = columns[0].is_some() && columns[1].is_some();
        move |i: usize| any.then(|| Vector3::from(columns.map(|c| c.map_or(f64::NAN, |c| c[i]))))
    };
    let velocity = vector(["vn", "ve", "vd"]);
    let position_sigma = vector(["sn", "se", "sd"]);
    let velocity_sigma = vector(["svn", "sve", "svd"]);
    let place = (column(&["lat_deg"]), column(&["lon_deg"]), column(&["h_m"]));
    let angles = [
        column(&["roll_deg"]),
        column(&["pitch_deg"]),
        column(&["yaw_deg", "heading_deg"]),
    ];
    let quaternion = [
        column(&["qw"]),
        column(&["qx"]),
        column(&["qy"]),
        column(&["qz"]),
    ];
    let moving = column(&["moving"]);
    let has_angles = angles.iter().any(Option::is_some);
    let has_quaternion = quaternion.iter().all(Option::is_some);
    let has_place = place.0.is_some() && place.1.is_some();
    if !has_place && !has_angles && !has_quaternion && column(&["vn"]).is_none() {
        // Nothing to compare with: the error names what would do.
        table.require(&["lat_deg", "vn", "roll_deg", "yaw_deg", "qw"])?;
    }

    let known = |v: Option<Vector3<f64>>| {
        v.map(|v| v.map(|s| if s.is_finite() { s } else { 0.0 }))
            .unwrap_or_default()
    };
    let point = |i: usize| {
        let position = match place {
            (Some(lat), Some(lon), h) => {
                let at = Geodetic::from_degrees(lat[i], lon[i], h.map_or(f64::NAN, |h| h[i]));
                at.is_valid().then_some(at)
            }
            _ => None,
        };
        let attitude = if let [Some(w), Some(x), Some(y), Some(z)] = quaternion {
            benchmark_attitude(&Quaternion::new(w[i], x[i], y[i], z[i]))
        } else if has_angles {
            let [roll, pitch, heading] = angles.map(|c| c.map_or(f64::NAN, |c| c[i].to_radians()));
            AttitudeReference::Angles {
                roll,
                pitch,
                heading: wrap_angle(heading),
            }
        } else {
            AttitudeReference::None
        };
        ReferencePoint {
            time: origin.plus(t_s[i]),
            position,
            position_sigma_n: known(position_sigma(i)),
            velocity_n: velocity(i).filter(|v| v.x.is_finite() && v.y.is_finite()),
            velocity_sigma_n: known(velocity_sigma(i)),
            attitude,
            moving: moving.map(|m| m[i] != 0.0),
        }
    };
    let mut points: Vec<ReferencePoint> = (0..table.rows())
        .filter(|&i| t_s[i].is_finite())
        .map(point)
        .collect();
    points.sort_by_key(|p| p.time);
    Ok(ComparedReference {
        points,
        at_antenna: has_place && !has_angles && !has_quaternion,
        warnings: Vec::new(),
    })
}

/// The quaternions of the orientation sets turn the sensor (taken as forward-left-up) to ENU; the change of both axes is its
/// own inverse.
fn benchmark_attitude(q: &Quaternion<f64>) -> AttitudeReference {
    let norm = q.norm();
    if !(norm.is_finite() && norm > 0.5) {
        return AttitudeReference::None;
    }
    AttitudeReference::Quaternion(to_enu_flu(&UnitQuaternion::new_normalize(*q)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn file(folder: &Path, text: &str) -> PathBuf {
        let path = folder.join("reference.csv");
        std::fs::write(&path, text).unwrap();
        path
    }

    fn read(text: &str) -> Result<ComparedReference, LogError> {
        let folder = tempfile::tempdir().unwrap();
        let solution = ComparedSolution {
            origin: Time::from_seconds(100.0),
            ..ComparedSolution::default()
        };
        ComparedReference::read(&file(folder.path(), text), &solution)
    }

    #[test]
    fn a_receiver_is_at_the_antenna_and_a_truth_is_not() {
        let gnss = read("t_s,lat_deg,lon_deg,h_m,vn,ve,vd,sn,se,sd,fix\n1.5,59,18,30,1,2,nan,0.1,0.2,0.3,1\n0.5,nan,nan,nan,nan,nan,nan,nan,nan,nan,0\n")
            .unwrap();
        assert!(gnss.at_antenna);
        assert_eq!(gnss.points[0].position, None, "in order of time");
        let p = gnss.points[1];
        assert_eq!(p.time, Time::from_seconds(101.5));
        assert_eq!(p.position_sigma_n, Vector3::new(0.1, 0.2, 0.3));
        let v = p.velocity_n.unwrap();
        assert!(v.y == 2.0 && v.z.is_nan());
        let truth =
            read("t_s,lat_deg,lon_deg,h_m,roll_deg,pitch_deg,yaw_deg\n1,59,18,30,1,2,270\n")
                .unwrap();
        assert!(!truth.at_antenna);
        let angles = truth.points[0].angles().map(f64::to_degrees);
        assert!(
            (angles - Vector3::new(1.0, 2.0, -90.0)).norm() < 1e-9,
            "{angles}"
        );
    }

    #[test]
    fn a_heading_alone_is_a_reference() {
        let r = read("t_s,heading_deg\n1,90\n").unwrap();
        assert!(!r.at_antenna && r.points[0].position.is_none());
        assert!(r.points[0].angles().x.is_nan());
    }

    #[test]
    fn quaternions_of_the_benchmark() {
        // Sensor axes east, north, up: forward looks east.
        let r = read("t_s,qw,qx,qy,qz,moving\n1,1,0,0,0,1\n2,nan,nan,nan,nan,0\n").unwrap();
        let heading = insnav_core::attitude::Euler::from_quaternion(&r.points[0].q_nb().unwrap())
            .heading_deg();
        assert!((heading - 90.0).abs() < 1e-9, "{heading}");
        assert_eq!(
            (r.points[0].moving, r.points[1].moving),
            (Some(true), Some(false))
        );
        assert_eq!(r.points[1].attitude, AttitudeReference::None);
    }

    #[test]
    fn nothing_to_compare_with_is_an_error() {
        let e = read("t_s,temperature\n1,20\n").unwrap_err();
        assert_eq!(e.code(), "missing_column");
        assert!(
            read("time,lat_deg\n1,20\n")
                .unwrap_err()
                .to_string()
                .contains("t_s")
        );
    }
}
