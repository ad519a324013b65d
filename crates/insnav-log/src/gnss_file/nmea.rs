//! NMEA 0183 sentences of any talker: GGA or GNS for the position, RMC or VTG for the velocity, GST for the standard
//! deviations, RMC or ZDA for the date ([NMEA-0183]).

use super::{GnssFileOptions, GnssTrack};
use crate::calendar::{at, day_of, parse_ns, split};
use crate::csv::open_text;
use crate::error::LogError;
use insnav_core::earth::Geodetic;
use insnav_core::sample::{GnssPosition, GnssVelocity};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::io::BufRead;
use std::path::Path;

const HALF_DAY_NS: i64 = 43_200_000_000_000;
/// One knot, m/s.
const KNOT: f64 = 1852.0 / 3600.0;

/// Sentences with the same time of day.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Epoch {
    ns_of_day: i64,
    /// Day since 1970, where a sentence of the epoch tells it.
    day: Option<i64>,
    place: Option<Place>,
    /// Speed, m/s, and course, rad; the course is missing while standing.
    velocity: Option<(f64, Option<f64>)>,
    /// Deviations of latitude, longitude and altitude, m.
    sigma: Option<[f64; 3]>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    latitude_deg: f64,
    longitude_deg: f64,
    /// Above sea level.
    altitude: Option<f64>,
    /// Of the geoid above the ellipsoid.
    separation: Option<f64>,
    quality: &'static str,
}

/// Sentences that were not used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Dropped {
    bad_checksum: u64,
    malformed: u64,
    no_fix: u64,
    estimated: u64,
    no_altitude: u64,
}

#[derive(Default)]
struct Reader {
    epochs: Vec<Epoch>,
    sentences: u64,
    unchecked: u64,
    dropped: Dropped,
}

pub(super) fn read(path: &Path, options: &GnssFileOptions) -> Result<GnssTrack, LogError> {
    let mut lines = open_text(path)?;
    let mut line = Vec::new();
    let mut reader = Reader::default();
    loop {
        line.clear();
        // Recorders mix sentences with binary messages, so lines are bytes.
        let length = lines
            .read_until(b'\n', &mut line)
            .map_err(|e| LogError::opening(path, e))?;
        if length == 0 {
            break;
        }
        if let Some(start) = line.iter().rposition(|b| *b == b'$') {
            reader.sentence(&line[start + 1..]);
        }
    }
    if !reader.epochs.iter().any(|e| e.place.is_some()) {
        return Err(LogError::NoFixes {
            path: path.into(),
            reason: format!(
                "{} sentences, of which {} have wrong checksums and {} no fix; positions come from GGA or GNS",
                reader.sentences, reader.dropped.bad_checksum, reader.dropped.no_fix
            ),
        });
    }
    date(&mut reader.epochs, options).ok_or_else(|| LogError::NoDate { path: path.into() })?;
    Ok(reader.track(path, options))
}

impl Reader {
    /// A sentence behind its `$`, with whatever ends the line.
    fn sentence(&mut self, bytes: &[u8]) {
        let text = bytes.trim_ascii_end();
        let Some(body) = self.checked(text) else {
            return;
        };
        let fields: Vec<&str> = body.split(',').collect();
        // Two letters of the talker, three of the sentence; proprietary ones begin with P.
        let Some(kind) = fields[0].get(2..).filter(|_| !fields[0].starts_with('P')) else {
            return;
        };
        let understood = match kind {
            "GGA" => self.gga(&fields),
            "GNS" => self.gns(&fields),
            "RMC" => self.rmc(&fields),
            "VTG" => self.vtg(&fields),
            "GST" => self.gst(&fields),
            "ZDA" => self.zda(&fields),
            _ => return,
        };
        self.sentences += 1;
        self.dropped.malformed += u64::from(understood.is_none());
    }

    /// The text before the checksum, if that is right; a sentence without one is taken.
    fn checked<'a>(&mut self, text: &'a [u8]) -> Option<&'a str> {
        let body = match text.iter().position(|b| *b == b'*') {
            Some(star) => {
                let stated = core::str::from_utf8(text.get(star + 1..star + 3)?)
                    .ok()
                    .and_then(|hex| u8::from_str_radix(hex, 16).ok());
                let computed = text[..star].iter().fold(0, |sum, b| sum ^ b);
                if stated != Some(computed) {
                    self.sentences += 1;
                    self.dropped.bad_checksum += 1;
                    return None;
                }
                &text[..star]
            }
            None => {
                self.unchecked += 1;
                text
            }
        };
        core::str::from_utf8(body).ok()
    }

    /// The epoch with this time of day: the last one, or a new one.
    fn epoch(&mut self, time: &str) -> Option<&mut Epoch> {
        let hours: i64 = time.get(..2)?.parse().ok()?;
        let minutes: i64 = time.get(2..4)?.parse().ok()?;
        let ns = parse_ns(time.get(4..)?)?;
        // A leap second is the sixtieth.
        if hours > 23 || minutes > 59 || ns >= 61_000_000_000 {
            return None;
        }
        let ns_of_day = (60 * hours + minutes) * 60_000_000_000 + ns;
        if self.epochs.last().is_none_or(|e| e.ns_of_day != ns_of_day) {
            self.epochs.push(Epoch {
                ns_of_day,
                ..Epoch::default()
            });
        }
        self.epochs.last_mut()
    }

    fn gga(&mut self, f: &[&str]) -> Option<()> {
        let quality = match *f.get(6)? {
            "0" | "" => {
                self.dropped.no_fix += 1;
                return Some(());
            }
            "1" => "single",
            "2" => "dgps",
            "3" => "pps",
            "4" => "fixed",
            "5" => "float",
            "6" => {
                self.dropped.estimated += 1;
                return Some(());
            }
            "7" => "manual",
            "8" => "simulated",
            "9" => "dgps",
            _ => return None,
        };
        self.place(f, quality, (9, 11))
    }

    fn gns(&mut self, f: &[&str]) -> Option<()> {
        // One letter for each system: the best of them is that of the solution.
        let modes = *f.get(6)?;
        let best = [
            ('R', "fixed"),
            ('F', "float"),
            ('P', "pps"),
            ('D', "dgps"),
            ('A', "single"),
            ('M', "manual"),
            ('S', "simulated"),
        ];
        match best.iter().find(|(letter, _)| modes.contains(*letter)) {
            Some((_, quality)) => self.place(f, quality, (9, 10)),
            None if modes.contains('E') => {
                self.dropped.estimated += 1;
                Some(())
            }
            None => {
                self.dropped.no_fix += 1;
                Some(())
            }
        }
    }

    fn place(
        &mut self,
        f: &[&str],
        quality: &'static str,
        (altitude, separation): (usize, usize),
    ) -> Option<()> {
        let angle = |at: usize, degrees: usize, plus: &str, minus: &str| {
            let (size, letter) = (*f.get(at)?, *f.get(at + 1)?);
            let whole: f64 = size.get(..degrees)?.parse().ok()?;
            let minutes = number(size.get(degrees..)?).filter(|m| (0.0..60.0).contains(m))?;
            match letter {
                _ if letter == plus => Some(whole + minutes / 60.0),
                _ if letter == minus => Some(-whole - minutes / 60.0),
                _ => None,
            }
        };
        let place = Place {
            latitude_deg: angle(2, 2, "N", "S")?,
            longitude_deg: angle(4, 3, "E", "W")?,
            altitude: number(f.get(altitude)?),
            separation: f.get(separation).and_then(|s| number(s)),
            quality,
        };
        let epoch = self.epoch(f.get(1)?)?;
        // A second talker repeats what the first said, or has less.
        epoch.place.get_or_insert(place);
        Some(())
    }

    fn rmc(&mut self, f: &[&str]) -> Option<()> {
        let day = parse_day(f.get(9)?);
        let valid = *f.get(2)? == "A" && !f.get(12).is_some_and(|mode| matches!(*mode, "N" | "E"));
        let (speed, course) = (number(f.get(7)?), course(f.get(8)?));
        let epoch = self.epoch(f.get(1)?)?;
        epoch.day = epoch.day.or(day);
        if valid {
            epoch.velocity = speed.map(|knots| (knots * KNOT, course));
        }
        Some(())
    }

    fn vtg(&mut self, f: &[&str]) -> Option<()> {
        // Without a time of its own it belongs to the sentences before it.
        let valid = !f.get(9).is_some_and(|mode| matches!(*mode, "N" | "E"));
        if !(valid && *f.get(2)? == "T") {
            return Some(());
        }
        let speed = number(f.get(7)?)
            .map(|km_per_h| km_per_h / 3.6)
            .or_else(|| number(f.get(5)?).map(|knots| knots * KNOT));
        let course = course(f.get(1)?);
        if let (Some(epoch), Some(speed)) = (self.epochs.last_mut(), speed) {
            epoch.velocity.get_or_insert((speed, course));
        }
        Some(())
    }

    fn gst(&mut self, f: &[&str]) -> Option<()> {
        let sigma = (|| Some([number(f.get(6)?)?, number(f.get(7)?)?, number(f.get(8)?)?]))();
        let epoch = self.epoch(f.get(1)?)?;
        epoch.sigma = epoch.sigma.or(sigma);
        Some(())
    }

    fn zda(&mut self, f: &[&str]) -> Option<()> {
        let whole = |at: usize| f.get(at)?.parse::<u32>().ok();
        let day = day_of(i64::from(whole(4)?), whole(3)?, whole(2)?)?;
        let epoch = self.epoch(f.get(1)?)?;
        epoch.day = epoch.day.or(Some(day));
        Some(())
    }

    fn track(&self, path: &Path, options: &GnssFileOptions) -> GnssTrack {
        let mut track = GnssTrack::default();
        let mut dropped = self.dropped;
        let mut at_sea_level = false;
        let mut quality = BTreeMap::new();
        for epoch in &self.epochs {
            let Some(time) = epoch.day.and_then(|day| at(day, epoch.ns_of_day)) else {
                continue;
            };
            if let Some(place) = epoch.place {
                let Some(altitude) = place.altitude else {
                    dropped.no_altitude += 1;
                    continue;
                };
                at_sea_level |= place.separation.is_none();
                let separation = place.separation.unwrap_or(options.geoid_height_m);
                let position = Geodetic::from_degrees(
                    place.latitude_deg,
                    place.longitude_deg,
                    altitude + separation,
                );
                if !position.is_valid() {
                    dropped.malformed += 1;
                    continue;
                }
                *quality.entry(place.quality).or_default() += 1;
                let known = epoch.sigma.filter(|s| s.iter().all(|s| *s > 0.0));
                track.positions.push(GnssPosition {
                    time,
                    position,
                    covariance_n: known
                        .map(|s| Matrix3::from_diagonal(&Vector3::from(s.map(|s| s * s)))),
                });
            }
            let velocity_n = match epoch.velocity {
                Some((speed, Some(course))) => {
                    Vector3::new(speed * course.cos(), speed * course.sin(), f64::NAN)
                }
                // Standing has no course.
                Some((0.0, None)) => Vector3::new(0.0, 0.0, f64::NAN),
                _ => continue,
            };
            track.velocities.push(GnssVelocity {
                time,
                velocity_n,
                covariance_n: None,
            });
        }
        track.quality = quality;
        if at_sea_level && options.geoid_height_m == 0.0 {
            track.warn_sea_level(path);
        }
        self.tell(&mut track, &dropped, path);
        track
    }

    fn tell(&self, track: &mut GnssTrack, dropped: &Dropped, path: &Path) {
        let mut tell = |code, count: u64, what: &str, remedy: &str| {
            if count > 0 {
                let message = format!(
                    "{}: {count} of {} sentences {what} and were dropped",
                    path.display(),
                    self.sentences
                );
                track.warn(code, message, remedy);
            }
        };
        tell(
            "nmea_checksum",
            dropped.bad_checksum,
            "have wrong checksums",
            "check the serial line: its speed, its length and the recorder's buffer",
        );
        tell(
            "nmea_malformed",
            dropped.malformed,
            "do not have the fields of their kind",
            "check the receiver's protocol version",
        );
        tell(
            "no_fix",
            dropped.no_fix,
            "say that the receiver has no fix",
            "nothing, if the sky was obstructed there",
        );
        tell(
            "estimated_fix",
            dropped.estimated,
            "are dead reckoning of the receiver",
            "switch the receiver's own dead reckoning off",
        );
        tell(
            "no_altitude",
            dropped.no_altitude,
            "have no altitude",
            "let the receiver send GGA",
        );
    }
}

/// Give every epoch its day: midnight passes where the time of day falls back by more than half a day.
fn date(epochs: &mut [Epoch], options: &GnssFileOptions) -> Option<()> {
    let step = |from: &Epoch, to: &Epoch| match to.ns_of_day - from.ns_of_day {
        d if d < -HALF_DAY_NS => 1,
        d if d > HALF_DAY_NS => -1,
        _ => 0,
    };
    let dated = match epochs.iter().position(|e| e.day.is_some()) {
        Some(dated) => dated,
        None => {
            let (day, ns) = split(options.near?);
            let first = epochs.first_mut()?;
            first.day = Some(match first.ns_of_day - ns {
                d if d < -HALF_DAY_NS => day + 1,
                d if d > HALF_DAY_NS => day - 1,
                _ => day,
            });
            0
        }
    };
    for i in (0..dated).rev() {
        epochs[i].day = epochs[i + 1]
            .day
            .map(|d| d - step(&epochs[i], &epochs[i + 1]));
    }
    for i in dated + 1..epochs.len() {
        if epochs[i].day.is_none() {
            epochs[i].day = epochs[i - 1]
                .day
                .map(|d| d + step(&epochs[i - 1], &epochs[i]));
        }
    }
    Some(())
}

/// A date as `ddmmyy`; years from 80 on are of the last century.
fn parse_day(text: &str) -> Option<i64> {
    let part = |from: usize| text.get(from..from + 2)?.parse::<u32>().ok();
    let year = i64::from(part(4)?);
    let century = if year >= 80 { 1900 } else { 2000 };
    day_of(century + year, part(2)?, part(0)?)
}

fn course(text: &str) -> Option<f64> {
    number(text).map(f64::to_radians)
}

/// A number; empty fields are missing ones.
fn number(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calendar::rfc3339;
    use insnav_core::time::Time;

    fn read_with(text: &[u8], options: &GnssFileOptions) -> Result<GnssTrack, LogError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("receiver.nmea");
        std::fs::write(&path, text).unwrap();
        GnssTrack::read(&path, options)
    }

    fn read_text(text: &str) -> Result<GnssTrack, LogError> {
        read_with(text.as_bytes(), &GnssFileOptions::default())
    }

    /// With its checksum.
    fn sentence(body: &str) -> String {
        let sum = body.bytes().fold(0u8, |sum, b| sum ^ b);
        format!("${body}*{sum:02X}\r\n")
    }

    #[test]
    fn the_textbook_sentences() {
        // The examples with which every description of NMEA 0183 explains these sentences, checksums included.
        let track = read_text(
            "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n\
             $GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n",
        )
        .unwrap();
        let p = &track.positions[0];
        assert_eq!(rfc3339(p.time), "1994-03-23T12:35:19.000Z");
        assert!((p.position.latitude_deg() - (48.0 + 7.038 / 60.0)).abs() < 1e-12);
        assert!((p.position.longitude_deg() - (11.0 + 31.0 / 60.0)).abs() < 1e-12);
        // Above sea level plus the geoid: above the ellipsoid.
        assert!((p.position.height - 592.3).abs() < 1e-9);
        let v = track.velocities[0].velocity_n;
        assert!((v.xy().norm() - 22.4 * 1852.0 / 3600.0).abs() < 1e-12 && v.z.is_nan());
        assert!((v.y.atan2(v.x).to_degrees() - 84.4).abs() < 1e-9);
        assert!(track.warnings.is_empty(), "{:?}", track.warnings);
    }

    #[test]
    fn talkers_deviations_and_the_second_source_of_velocity() {
        let text = [
            "GNZDA,000001.50,02,01,2024,00,00",
            "GNGNS,000001.50,3345.6,S,15112.0,W,RRNN,14,0.6,20.0,-5.5,,",
            "GLGST,000001.50,1.2,,,,0.5,0.25,1.5",
            "GNVTG,180.0,T,,M,10.0,N,36.0,K,A",
            "PUBX,00,garbage",
            "GAGSV,1,1,00",
        ]
        .map(sentence)
        .concat();
        let track = read_text(&text).unwrap();
        let p = &track.positions[0];
        assert_eq!(rfc3339(p.time), "2024-01-02T00:00:01.500Z");
        assert!((p.position.latitude_deg() + 33.76).abs() < 1e-12);
        assert!((p.position.longitude_deg() + 151.2).abs() < 1e-12);
        assert_eq!(p.position.height, 14.5);
        assert_eq!(
            p.covariance_n.unwrap().diagonal(),
            Vector3::new(0.25, 0.0625, 2.25)
        );
        // km/h are the finer unit.
        assert!((track.velocities[0].velocity_n.x + 10.0).abs() < 1e-12);
        assert_eq!(track.quality["fixed"], 1);
    }

    #[test]
    fn midnight_passes_with_and_without_a_date() {
        let gga = |time: &str| {
            sentence(&format!(
                "GNGGA,{time},4807.0,N,01131.0,E,4,08,0.9,545.4,M,46.9,M,,"
            ))
        };
        let rmc = sentence("GNRMC,235959.00,A,4807.0,N,01131.0,E,1.0,84.4,311223,,,A");
        let times = |text: &str| -> Vec<String> {
            let near = Some(Time(1_704_067_195_000_000_000));
            let options = GnssFileOptions {
                near,
                ..GnssFileOptions::default()
            };
            let track = read_with(text.as_bytes(), &options).unwrap();
            track.positions.iter().map(|p| rfc3339(p.time)).collect()
        };
        let expected = [
            "2023-12-31T23:59:58.000Z",
            "2023-12-31T23:59:59.000Z",
            "2024-01-01T00:00:00.000Z",
            "2024-01-01T00:00:01.000Z",
        ];
        let [a, b, c, d] = ["235958.00", "235959.00", "000000.00", "000001.00"].map(gga);
        // The date in the middle, and no date but an instant nearby.
        assert_eq!(times(&[&*a, &b, &rmc, &c, &d].concat()), expected);
        assert_eq!(times(&[&*a, &b, &c, &d].concat()), expected);
        let error = read_text(&[a, b].concat()).unwrap_err();
        assert_eq!(error.code(), "no_date", "{error}");
    }

    #[test]
    fn wrong_checksums_missing_fields_and_no_fix_are_told() {
        let good = "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n";
        let rmc = "$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n";
        let mut text = format!("{good}{rmc}");
        text.push_str(&good.replace("4807", "4808"));
        text.push_str(&sentence("GPGGA,123520,,,,,0,00,,,M,,M,,"));
        text.push_str(&sentence(
            "GPGGA,123521,4807.038,N,01131.000,E,6,08,0.9,545.4,M,46.9,M,,",
        ));
        text.push_str(&sentence(
            "GPGGA,123522,4807.038,N,01131.000,E,1,08,0.9,,M,46.9,M,,",
        ));
        text.push_str(&sentence(
            "GPGGA,123523,4897.038,N,01131.000,E,1,08,0.9,1,M,46.9,M,,",
        ));
        text.push_str(&sentence("GPRMC,123524,V,,,,,,,230394,,"));
        text.push_str(&sentence("GPGGA"));
        let track = read_text(&text).unwrap();
        assert_eq!((track.positions.len(), track.velocities.len()), (1, 1));
        let codes: Vec<_> = track.warnings.iter().map(|w| w.code).collect();
        assert_eq!(
            codes,
            [
                "nmea_checksum",
                "nmea_malformed",
                "no_fix",
                "estimated_fix",
                "no_altitude"
            ]
        );
        assert!(
            track.warnings[1].message.contains("2 of 9"),
            "{}",
            track.warnings[1].message
        );

        // Binary messages between, and a sentence that begins in the middle of a line.
        let mut mixed = vec![0xb5, 0x62, 0x01, 0x07, 0xff, 0x00];
        mixed.extend(b"$GP");
        mixed.extend(good.as_bytes());
        mixed.extend(rmc.as_bytes());
        assert_eq!(
            read_with(&mixed, &GnssFileOptions::default())
                .unwrap()
                .positions
                .len(),
            1
        );

        let error = read_text(rmc).unwrap_err();
        assert_eq!(error.code(), "no_fixes", "{error}");
    }

    #[test]
    fn without_a_separation_the_height_is_as_told() {
        let text = [
            sentence("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,,M,,"),
            sentence("GPRMC,123519,A,4807.038,N,01131.000,E,0.0,,230394,003.1,W"),
        ]
        .concat();
        let track = read_text(&text).unwrap();
        assert_eq!(track.positions[0].position.height, 545.4);
        assert_eq!(track.warnings[0].code, "height_above_sea_level");
        assert_eq!(track.velocities[0].velocity_n.xy(), Vector3::zeros().xy());
        let options = GnssFileOptions {
            geoid_height_m: 46.9,
            ..GnssFileOptions::default()
        };
        let track = read_with(text.as_bytes(), &options).unwrap();
        assert!((track.positions[0].position.height - 592.3).abs() < 1e-9);
        assert!(track.warnings.is_empty());
    }
}
