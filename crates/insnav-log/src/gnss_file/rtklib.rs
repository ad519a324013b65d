//! RTKLIB's solution files (`.pos`), [RTKLIB] manual, appendix B.
//!
//! The last comment before the data names the columns: which time system, latitude/longitude/height or ECEF, standard
//! deviations, and velocities if there are any. Deviations of products are written as the root of their size with their sign.

use super::{GnssFileOptions, GnssTrack};
use crate::calendar::{at, day_of, gps_time, parse_ns, utc_from_gps_time};
use crate::csv::{open_text, read_line};
use crate::error::LogError;
use insnav_core::earth::Geodetic;
use insnav_core::sample::{GnssPosition, GnssVelocity};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Clock {
    #[default]
    Gps,
    Utc,
    /// Nine hours ahead of UTC.
    Japan,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Place {
    #[default]
    Degrees,
    /// Degrees, minutes, seconds in columns of their own.
    Sexagesimal,
    Ecef,
}

/// Where a row's numbers are; indices count from behind the two columns of the time.
#[derive(Clone, Debug, Default, PartialEq)]
struct Columns {
    clock: Clock,
    place: Place,
    /// Solution status.
    quality: Option<usize>,
    /// Diagonal and products of the position's covariance.
    position: [Option<usize>; 6],
    velocity: [Option<usize>; 3],
    velocity_covariance: [Option<usize>; 6],
}

impl Columns {
    /// By a header line without its `%`; `None` when it is another comment.
    fn parse(line: &str) -> Result<Option<Self>, &'static str> {
        let mut names = cells(line);
        let clock = match names.next() {
            Some("GPST") => Clock::Gps,
            Some("UTC") => Clock::Utc,
            Some("JST") => Clock::Japan,
            _ => return Ok(None),
        };
        let mut known: Vec<(&str, usize)> = Vec::new();
        let mut next = 0;
        for name in names {
            let plain = name.split_once('(').map_or(name, |(plain, _)| plain);
            known.push((plain, next));
            next += if name.contains("d'") { 3 } else { 1 };
        }
        let find = |name: &str| known.iter().find(|(n, _)| *n == name).map(|(_, at)| *at);
        let first = known.first().map_or("", |(name, _)| *name);
        let place = match first {
            "latitude" | "lat" if find("longitude").or(find("lon")) == Some(3) => {
                Place::Sexagesimal
            }
            "latitude" | "lat" => Place::Degrees,
            "x-ecef" => Place::Ecef,
            "e-baseline" => {
                return Err(
                    "baselines in east, north and up say nothing of where the base is; write latitude/longitude/height or ECEF",
                );
            }
            _ => return Err("the header names neither latitude nor x-ecef"),
        };
        let all = |names: [&str; 6]| names.map(find);
        let (position, velocity, velocity_covariance) = if place == Place::Ecef {
            (
                all(["sdx", "sdy", "sdz", "sdxy", "sdyz", "sdzx"]),
                ["vx", "vy", "vz"],
                all(["sdvx", "sdvy", "sdvz", "sdvxy", "sdvyz", "sdvzx"]),
            )
        } else {
            (
                all(["sdn", "sde", "sdu", "sdne", "sdeu", "sdun"]),
                ["vn", "ve", "vu"],
                all(["sdvn", "sdve", "sdvu", "sdvne", "sdveu", "sdvun"]),
            )
        };
        Ok(Some(Columns {
            clock,
            place,
            quality: find("Q"),
            position,
            velocity: velocity.map(find),
            velocity_covariance,
        }))
    }

    /// Of a file without a header: what RTKLIB writes unless told otherwise, ECEF if the first number is no latitude.
    fn guess(row: &[&str]) -> Self {
        let first: f64 = row.first().and_then(|c| c.parse().ok()).unwrap_or(0.0);
        let header = if first.abs() > 90.0 {
            "GPST x-ecef y-ecef z-ecef Q ns sdx sdy sdz sdxy sdyz sdzx age ratio vx vy vz sdvx sdvy sdvz sdvxy sdvyz sdvzx"
        } else {
            "GPST latitude longitude height Q ns sdn sde sdu sdne sdeu sdun age ratio vn ve vu sdvn sdve sdvu sdvne sdveu sdvun"
        };
        Columns::parse(header).ok().flatten().unwrap_or_default()
    }
}

fn cells(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| c.is_whitespace() || c == ',' || c == ';')
        .filter(|cell| !cell.is_empty())
}

/// Names of RTKLIB's solution status.
const QUALITY: [&str; 8] = [
    "none",
    "fixed",
    "float",
    "sbas",
    "dgps",
    "single",
    "ppp",
    "dead_reckoning",
];

pub(super) fn read(path: &Path, options: &GnssFileOptions) -> Result<GnssTrack, LogError> {
    let mut lines = open_text(path)?;
    let mut line = String::new();
    let mut number = 0;
    let mut columns: Option<Columns> = None;
    let mut above_geoid = false;
    let mut no_solution = 0;
    let mut track = GnssTrack::default();
    while read_line(&mut *lines, &mut line, path)? {
        number += 1;
        let text = line.trim();
        let bad = |column: &str, reason: &str| LogError::Cell {
            path: path.into(),
            line: number,
            column: column.into(),
            reason: reason.into(),
        };
        if let Some(comment) = text.strip_prefix('%') {
            above_geoid |= comment.contains("WGS84/geodetic");
            if let Some(named) = Columns::parse(comment).map_err(|why| bad("header", why))? {
                columns = Some(named);
            }
            continue;
        }
        if text.is_empty() {
            continue;
        }
        let mut all = cells(text);
        let (Some(first), Some(second)) = (all.next(), all.next()) else {
            return Err(bad("time", "the line ends before the time"));
        };
        let row: Vec<&str> = all.collect();
        let columns = columns.get_or_insert_with(|| Columns::guess(&row));
        let time = parse_time(first, second, columns.clock)
            .ok_or_else(|| bad("time", "neither a date and time nor a GPS week and seconds"))?;
        let row = Row {
            cells: &row,
            columns,
        };
        let quality = row.quality();
        if quality == 0 {
            no_solution += 1;
            continue;
        }
        *track
            .quality
            .entry(QUALITY.get(quality).copied().unwrap_or("other"))
            .or_default() += 1;
        let mut place = row
            .place()
            .ok_or_else(|| bad("position", "no position that is on the Earth"))?;
        if above_geoid {
            place.height += options.geoid_height_m;
        }
        track.positions.push(GnssPosition {
            time,
            position: place,
            covariance_n: row.covariance(&columns.position, &place),
        });
        track.velocities.extend(row.velocity(time, &place));
    }
    if above_geoid && options.geoid_height_m == 0.0 {
        track.warn_sea_level(path);
    }
    if no_solution > 0 {
        track.warn(
            "no_fix",
            format!(
                "{}: {no_solution} epochs without a solution (Q=0) were dropped",
                path.display()
            ),
            "nothing, if the sky was obstructed there",
        );
    }
    Ok(track)
}

fn parse_time(first: &str, second: &str, clock: Clock) -> Option<Time> {
    let shown = if first.contains('/') {
        let mut date = first.split('/').map(|n| n.parse::<u32>().ok());
        let (year, month, day) = (date.next()??, date.next()??, date.next()??);
        let mut clock = second.split(':');
        let (hours, minutes) = (clock.next()?.parse::<i64>().ok()?, clock.next()?);
        let minutes = minutes.parse::<i64>().ok()?;
        let ns = parse_ns(clock.next()?)?;
        let sane =
            (0..=24).contains(&hours) && (0..60).contains(&minutes) && clock.next().is_none();
        let of_day = (hours * 60 + minutes) * 60_000_000_000 + ns;
        at(day_of(i64::from(year), month, day)?, of_day).filter(|_| sane)?
    } else {
        gps_time(first.parse().ok()?, parse_ns(second)?)?
    };
    Some(match clock {
        Clock::Gps => utc_from_gps_time(shown),
        Clock::Utc => shown,
        Clock::Japan => Time(shown.0 - 9 * 3_600_000_000_000),
    })
}

struct Row<'a> {
    cells: &'a [&'a str],
    columns: &'a Columns,
}

impl Row<'_> {
    fn number(&self, at: usize) -> Option<f64> {
        let value: f64 = self.cells.get(at)?.parse().ok()?;
        value.is_finite().then_some(value)
    }

    fn numbers<const N: usize>(&self, at: &[Option<usize>; N]) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for (value, at) in values.iter_mut().zip(at) {
            *value = self.number((*at)?)?;
        }
        Some(values)
    }

    /// 0 when there is no solution; 5, single, when the file does not say.
    fn quality(&self) -> usize {
        self.columns
            .quality
            .map_or(Some(5.0), |at| self.number(at))
            .map_or(0, |q| q as usize)
    }

    fn place(&self) -> Option<Geodetic> {
        let at = |i: usize| self.number(i);
        let place = match self.columns.place {
            Place::Degrees => Geodetic::from_degrees(at(0)?, at(1)?, at(2)?),
            Place::Sexagesimal => {
                Geodetic::from_degrees(self.sexagesimal(0)?, self.sexagesimal(3)?, at(6)?)
            }
            Place::Ecef => {
                let r_e = Vector3::new(at(0)?, at(1)?, at(2)?);
                // Less than the half of the Earth's radius is a row of zeros, not a place.
                Some(Geodetic::from_ecef(&r_e)).filter(|_| r_e.norm() > 3e6)?
            }
        };
        place.is_valid().then_some(place)
    }

    /// Degrees from three columns; the sign is on the first, also where that is zero.
    fn sexagesimal(&self, first: usize) -> Option<f64> {
        let degrees = self.number(first)?;
        let size =
            degrees.abs() + self.number(first + 1)? / 60.0 + self.number(first + 2)? / 3600.0;
        let south_or_west = self.cells.get(first)?.starts_with('-');
        Some(if south_or_west { -size } else { size })
    }

    /// A covariance in NED from the columns of its deviations; `None` when they are missing or zero.
    fn covariance(&self, at: &[Option<usize>; 6], place: &Geodetic) -> Option<Matrix3<f64>> {
        let diagonal = self.numbers(&[at[0], at[1], at[2]])?;
        // The products may be left out.
        let products = self.numbers(&[at[3], at[4], at[5]]).unwrap_or_default();
        let signed_square = |s: f64| s * s.abs();
        let [xx, yy, zz] = diagonal.map(|s| s * s);
        let [xy, yz, zx] = products.map(signed_square);
        let p = Matrix3::new(xx, xy, zx, xy, yy, yz, zx, yz, zz);
        let (p_n, diagonal_n) = if self.columns.place == Place::Ecef {
            let c = place.ned_to_ecef();
            let turned = |p: Matrix3<f64>| c.transpose() * p * c;
            (turned(p), turned(Matrix3::from_diagonal(&p.diagonal())))
        } else {
            // North, east, up.
            let down = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
            (down * p * down, Matrix3::from_diagonal(&p.diagonal()))
        };
        if p.diagonal().iter().any(|variance| *variance <= 0.0) {
            return None;
        }
        // Four decimals of small deviations may round to products that no covariance has.
        Some(if p_n.cholesky().is_some() {
            p_n
        } else {
            diagonal_n
        })
    }

    fn velocity(&self, time: Time, place: &Geodetic) -> Option<GnssVelocity> {
        let v = Vector3::from(self.numbers(&self.columns.velocity)?);
        let covariance_n = self.covariance(&self.columns.velocity_covariance, place);
        // All zero without a deviation: the velocity was not estimated.
        if v == Vector3::zeros() && covariance_n.is_none() {
            return None;
        }
        let velocity_n = if self.columns.place == Place::Ecef {
            place.ned_to_ecef().transpose() * v
        } else {
            Vector3::new(v.x, v.y, -v.z)
        };
        Some(GnssVelocity {
            time,
            velocity_n,
            covariance_n,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calendar::rfc3339;

    fn read_text(text: &str) -> Result<GnssTrack, LogError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rover.pos");
        std::fs::write(&path, text).unwrap();
        GnssTrack::read(&path, &GnssFileOptions::default())
    }

    const LLH: &str = "\
% program   : RTKPOST ver.2.4.2
% obs start : 2009/04/01 00:00:00.0 GPST (week1525 259200.0s)
% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)
%  GPST                  latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)  sdeu(m)  sdun(m) age(s)  ratio    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu    sdvne    sdveu    sdvun
2009/04/01 00:00:00.000   35.161351167  139.613837806    70.3592   1   8   0.0030   0.0025   0.0060  -0.0015   0.0011  -0.0020   0.00   84.2    1.00000    2.00000    0.50000   0.01000  0.02000  0.03000  0.00000  0.00000  0.00000
2009/04/01 00:00:00.200   35.161351168  139.613837807    70.3600   2   8   0.0030   0.0025   0.0060   0.0000   0.0000   0.0000   0.00    0.0    0.00000    0.00000    0.00000   0.00000  0.00000  0.00000  0.00000  0.00000  0.00000
2009/04/01 00:00:00.400    0.000000000    0.000000000     0.0000   0   0   0.0000   0.0000   0.0000   0.0000   0.0000   0.0000   0.00    0.0
";

    #[test]
    fn latitude_longitude_height_with_velocities() {
        let track = read_text(LLH).unwrap();
        assert_eq!((track.positions.len(), track.velocities.len()), (2, 1));
        let p = &track.positions[0];
        assert_eq!(rfc3339(p.time), "2009-03-31T23:59:45.000Z");
        assert_eq!(track.positions[1].time.0 - p.time.0, 200_000_000);
        assert!((p.position.latitude_deg() - 35.161_351_167).abs() < 1e-12);
        assert_eq!(p.position.height, 70.3592);
        // Signs: sdne is the root of a negative product; down is minus up.
        let c = p.covariance_n.unwrap();
        let expected = Matrix3::new(
            9e-6, -2.25e-6, 4e-6, -2.25e-6, 6.25e-6, -1.21e-6, 4e-6, -1.21e-6, 36e-6,
        );
        assert!((c - expected).norm() < 1e-12, "{c}");
        let v = &track.velocities[0];
        assert_eq!(v.velocity_n, Vector3::new(1.0, 2.0, -0.5));
        assert!((v.covariance_n.unwrap()[(1, 1)] - 4e-4).abs() < 1e-12);
        assert_eq!(
            track
                .quality
                .iter()
                .map(|(k, v)| (*k, *v))
                .collect::<Vec<_>>(),
            [("fixed", 1), ("float", 1)]
        );
        assert_eq!(track.warnings[0].code, "no_fix");
    }

    #[test]
    fn weeks_utc_and_other_separators_are_the_same_instants() {
        let header = |clock: &str| {
            format!(
                "%  {clock}  latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m)\n"
            )
        };
        let reference = read_text(&format!(
            "{}2009/04/01 00:00:00.000 35 139 70 1 8 1 1 1\n",
            header("GPST")
        ))
        .unwrap();
        for text in [
            format!("{}1525 259200.000 35 139 70 1 8 1 1 1\n", header("GPST")),
            format!(
                "{}2009/03/31 23:59:45.000 35 139 70 1 8 1 1 1\n",
                header("UTC")
            ),
            format!(
                "{}2009/04/01 08:59:45.000 35 139 70 1 8 1 1 1\n",
                header("JST")
            ),
            format!(
                "{}2009/04/01 00:00:00.000,35,139,70,1,8,1,1,1\n",
                header("GPST").replace(") ", "),")
            ),
            "1525 259200.000 35 139 70 1 8 1 1 1\n".to_owned(),
        ] {
            let track = read_text(&text).unwrap();
            assert_eq!(track.positions, reference.positions, "{text}");
        }
    }

    #[test]
    fn degrees_minutes_seconds_keep_the_sign_of_minus_zero() {
        let text = "%  GPST latitude(d'\") longitude(d'\") height(m) Q ns\n\
                    2009/04/01 00:00:00.000 -0 30 18.00000 -139 36 49.81612 70.3 1 8\n";
        let p = read_text(text).unwrap().positions[0].position;
        assert!((p.latitude_deg() + 0.505).abs() < 1e-12);
        assert!((p.longitude_deg() + 139.613_837_811).abs() < 1e-9);
    }

    #[test]
    fn ecef_turns_into_the_same_place_and_covariance() {
        let place = Geodetic::from_degrees(-33.5, 151.2, 42.0);
        let r = place.to_ecef();
        let c = place.ned_to_ecef();
        // Known in NED, written in ECEF, read back in NED.
        let p_n = Matrix3::new(0.04, 0.01, 0.0, 0.01, 0.09, -0.02, 0.0, -0.02, 0.25);
        let p_e = c * p_n * c.transpose();
        let root = |v: f64| v.signum() * v.abs().sqrt();
        let v_e = c * Vector3::new(3.0, -1.0, 0.5);
        let text = format!(
            "%  GPST x-ecef(m) y-ecef(m) z-ecef(m) Q ns sdx(m) sdy(m) sdz(m) sdxy(m) sdyz(m) sdzx(m) age(s) ratio vx(m/s) vy(m/s) vz(m/s)\n\
             2232 100.5 {} {} {} 6 12 {} {} {} {} {} {} 0 0 {} {} {}\n",
            r.x,
            r.y,
            r.z,
            root(p_e[(0, 0)]),
            root(p_e[(1, 1)]),
            root(p_e[(2, 2)]),
            root(p_e[(0, 1)]),
            root(p_e[(1, 2)]),
            root(p_e[(2, 0)]),
            v_e.x,
            v_e.y,
            v_e.z
        );
        let track = read_text(&text).unwrap();
        let got = &track.positions[0];
        assert!(got.position.offset_to(&place).norm() < 1e-6);
        assert!((got.covariance_n.unwrap() - p_n).norm() < 1e-12);
        let v = &track.velocities[0];
        assert!((v.velocity_n - Vector3::new(3.0, -1.0, 0.5)).norm() < 1e-9);
        assert_eq!(v.covariance_n, None);
    }

    #[test]
    fn what_cannot_be_read_is_said_with_its_line() {
        let baseline = "%  GPST e-baseline(m) n-baseline(m) u-baseline(m) Q ns\n";
        assert!(read_text(baseline).unwrap_err().to_string().contains(":1:"));
        let geodetic = LLH.replace("ellipsoidal", "geodetic");
        assert!(
            read_text(&geodetic)
                .unwrap()
                .warnings
                .iter()
                .any(|w| w.code == "height_above_sea_level")
        );
        let header = "%  GPST latitude(deg) longitude(deg) height(m) Q ns\n";
        for row in [
            "2009/13/01 00:00:00 35 139 70 1 8",
            "2009/04/01 00:00:00 95 139 70 1 8",
            "2009/04/01",
            "2009/04/01 00:00 35 139 70 1 8",
        ] {
            let error = read_text(&format!("{header}{row}\n")).unwrap_err();
            assert_eq!(error.code(), "bad_cell");
            assert!(error.to_string().contains(":2:"), "{error}");
        }
    }
}
