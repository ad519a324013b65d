//! Writing the common CSV.

use super::{GnssTable, ImuTable};
use crate::error::LogError;
use crate::output_file::OutputFile;
use crate::solution::SolutionTable;
use flate2::Compression;
use flate2::write::GzEncoder;
use insnav_core::attitude::Euler;
use insnav_core::mechanization::NavState;
use insnav_core::time::Time;
use std::io::{self, Write};
use std::path::Path;

/// Write an `imu.csv` (gzip if the name ends in `.gz`). Numbers are written so that reading them gives the same value.
pub fn write_imu(path: &Path, table: &ImuTable, force: bool) -> Result<(), LogError> {
    write(path, force, |out| {
        let with_field = table.magnetic_field.len() == table.t_s.len() && !table.t_s.is_empty();
        writeln!(
            out,
            "t_s,gx,gy,gz,ax,ay,az{}",
            if with_field { ",mx,my,mz" } else { "" }
        )?;
        for (i, t) in table.t_s.iter().enumerate() {
            let (g, a) = (table.angular_rate[i], table.specific_force[i]);
            write!(
                out,
                "{t:.9},{},{},{},{},{},{}",
                g.x, g.y, g.z, a.x, a.y, a.z
            )?;
            if with_field {
                let m = table.magnetic_field[i];
                write!(out, ",{},{},{}", Cell(m.x), Cell(m.y), Cell(m.z))?;
            }
            writeln!(out)?;
        }
        Ok(())
    })
}

/// Write a `gnss.csv` (gzip if the name ends in `.gz`); what is not known is `nan`.
pub fn write_gnss(path: &Path, table: &GnssTable, force: bool) -> Result<(), LogError> {
    write(path, force, |out| {
        // Of a log there is no such code: a column of nothing would only look like one.
        let coded = table.fix.iter().any(|code| !code.is_nan());
        writeln!(
            out,
            "t_s,lat_deg,lon_deg,h_m,vn,ve,vd,sn,se,sd,svn,sve,svd{}",
            if coded { ",fix" } else { "" }
        )?;
        for (i, t) in table.t_s.iter().enumerate() {
            let at = table.position[i];
            write!(
                out,
                "{t:.9},{:.11},{:.11},{}",
                at.latitude_deg(),
                at.longitude_deg(),
                Cell(at.height)
            )?;
            for v in [
                table.velocity_n[i],
                table.position_sigma_n[i],
                table.velocity_sigma_n[i],
            ] {
                write!(out, ",{},{},{}", Cell(v.x), Cell(v.y), Cell(v.z))?;
            }
            if coded {
                write!(out, ",{}", Cell(table.fix[i]))?;
            }
            writeln!(out)?;
        }
        Ok(())
    })
}

/// Write a solution in the form of a `truth.csv`, with its standard deviations; `t_s` counts from `t0`.
pub fn write_solution(
    path: &Path,
    solution: &SolutionTable,
    t0: Time,
    force: bool,
) -> Result<(), LogError> {
    write(path, force, |out| {
        writeln!(out, "{SOLUTION_HEADER}")?;
        write_epochs(out, solution, t0)
    })
}

/// Write what really was in the form of a `truth.csv` (gzip if the name ends in `.gz`): seconds, position, velocity, attitude.
pub fn write_truth(
    path: &Path,
    rows: impl Iterator<Item = (f64, NavState)>,
    force: bool,
) -> Result<(), LogError> {
    write(path, force, |out| {
        writeln!(
            out,
            "t_s,lat_deg,lon_deg,h_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg"
        )?;
        for (t, nav) in rows {
            let (p, v) = (nav.position, nav.velocity_n);
            let e = Euler::from_quaternion(&nav.q_nb);
            writeln!(
                out,
                "{t:.9},{:.11},{:.11},{:.5},{:.6},{:.6},{:.6},{:.7},{:.7},{:.7}",
                p.latitude_deg(),
                p.longitude_deg(),
                p.height,
                v.x,
                v.y,
                v.z,
                e.roll.to_degrees(),
                e.pitch.to_degrees(),
                e.heading_deg()
            )?;
        }
        Ok(())
    })
}

pub(crate) const SOLUTION_HEADER: &str = "t_s,lat_deg,lon_deg,h_m,vn,ve,vd,roll_deg,pitch_deg,yaw_deg,sn,se,sd,svn,sve,svd,\
     sigma_rotation_north_deg,sigma_rotation_east_deg,sigma_heading_deg,standing_s,stop_specific_force_ratio,\
     stop_angular_rate_ratio,stop_mean_rate_ratio,stop_speed_ratio";

pub(crate) fn write_epochs(
    out: &mut dyn Write,
    solution: &SolutionTable,
    t0: Time,
) -> io::Result<()> {
    for i in 0..solution.len() {
        let at = solution.position[i];
        let v = solution.velocity_n[i];
        let e = Euler::from_quaternion(&solution.q_nb[i]);
        let t = solution.time[i].since(t0);
        write!(
            out,
            "{t:.9},{:.11},{:.11},{:.4}",
            at.latitude_deg(),
            at.longitude_deg(),
            at.height
        )?;
        write!(out, ",{:.5},{:.5},{:.5}", v.x, v.y, v.z)?;
        write!(
            out,
            ",{:.6},{:.6},{:.6}",
            e.roll.to_degrees(),
            e.pitch.to_degrees(),
            e.heading_deg()
        )?;
        let attitude = solution.attitude_sigma_n[i].map(f64::to_degrees);
        for v in [
            solution.position_sigma_n[i],
            solution.velocity_sigma_n[i],
            attitude,
        ] {
            write!(out, ",{},{},{}", Cell(v.x), Cell(v.y), Cell(v.z))?;
        }
        let seen = &solution.stop_evidence[i];
        write!(out, ",{}", Cell(solution.standing_s[i]))?;
        for ratio in [
            seen.specific_force,
            seen.angular_rate,
            seen.mean_rate,
            seen.speed,
        ] {
            write!(out, ",{}", Cell(ratio))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// A number as shortest text that reads back the same; NaN in lower case, as other programs write it.
pub(crate) struct Cell(pub(crate) f64);

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.is_nan() {
            f.write_str("nan")
        } else {
            write!(f, "{}", self.0)
        }
    }
}

pub(crate) fn write(
    path: &Path,
    force: bool,
    rows: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), LogError> {
    write_or(path, force, |out| {
        rows(out).map_err(|source| not_writable(path, source))
    })
}

/// As [`write()`], for rows that may fail in other ways than by writing.
pub(crate) fn write_or(
    path: &Path,
    force: bool,
    rows: impl FnOnce(&mut dyn Write) -> Result<(), LogError>,
) -> Result<(), LogError> {
    let mut file = OutputFile::create(path, force)?;
    if path.extension().is_some_and(|extension| extension == "gz") {
        let mut zip = GzEncoder::new(&mut file, Compression::default());
        rows(&mut zip)?;
        zip.finish().map_err(|source| not_writable(path, source))?;
    } else {
        rows(&mut file)?;
    }
    file.commit().map(drop)
}

pub(crate) fn not_writable(path: &Path, source: io::Error) -> LogError {
    LogError::OutputNotWritable {
        path: path.into(),
        source,
    }
}
