//! Solutions for maps, spreadsheets and trajectory tools: KML, GeoJSON, CSV, TUM.
//!
//! All are written from the finished MCAP in blocks, so that a solution of any length needs the same memory.

use crate::calendar::rfc3339;
use crate::csv::{SOLUTION_HEADER, not_writable, write_epochs, write_text_or};
use crate::error::LogError;
use crate::log::Log;
use crate::solution::SolutionTable;
use crate::tum::Trajectory;
use insnav_core::time::Time;
use std::io::{self, Write};
use std::path::Path;

/// What a solution can be written as besides MCAP.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ExportFormat {
    /// Every epoch with its standard deviations, in the form of a `truth.csv`.
    Csv,
    /// Every pose in the map, for trajectory tools.
    Tum,
    /// The track on the ground, for Google Earth and the like: five points a second.
    Kml,
    /// The track with ellipsoidal heights (\[RFC7946\]): five points a second.
    Geojson,
}

impl ExportFormat {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Csv, Self::Tum, Self::Kml, Self::Geojson];

    /// Its name, which is the ending of its files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Tum => "tum",
            Self::Kml => "kml",
            Self::Geojson => "geojson",
        }
    }

    /// By its name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.name() == name)
    }
}

/// Write a solution, an MCAP of [`crate::McapSink`], in another format. Returns the number of its epochs.
pub fn export(
    log: &Log,
    output: &Path,
    format: ExportFormat,
    force: bool,
) -> Result<usize, LogError> {
    let mut epochs = 0;
    write_text_or(output, force, |out| {
        let mut writer = Writer::new(log, format);
        let wrote = |result: io::Result<()>| result.map_err(|e| not_writable(output, e));
        wrote(writer.begin(out))?;
        SolutionTable::each_block(log, |block| {
            epochs += block.len();
            wrote(writer.block(out, block))
        })?;
        if epochs == 0 {
            return Err(LogError::NotASolution {
                path: log.path().into(),
                reason: "no epochs".into(),
            });
        }
        wrote(writer.end(out))
    })?;
    Ok(epochs)
}

/// Points on a map are at least this far apart, ns: browsers and globes choke on every epoch of a drive.
const MAP_INTERVAL_NS: i64 = 200_000_000;
/// Longest line of a KML, points: longer ones are cut off by some viewers.
const LONGEST_LINE: usize = 10_000;

struct Writer<'a> {
    log: &'a Log,
    format: ExportFormat,
    /// Zero of the CSV's seconds, origin of the TUM's map.
    t0: Option<Time>,
    origin: Option<insnav_core::earth::Geodetic>,
    last_time: Option<Time>,
    /// The last point of the line, and how many points the line has.
    last: Option<[f64; 3]>,
    in_line: usize,
    /// A point of the solution that is too close to the last one of the line, kept in case that it is the end.
    held: Option<[f64; 3]>,
}

impl<'a> Writer<'a> {
    fn new(log: &'a Log, format: ExportFormat) -> Self {
        Writer {
            log,
            format,
            t0: None,
            origin: None,
            last_time: None,
            last: None,
            in_line: 0,
            held: None,
        }
    }

    fn name(&self) -> String {
        let stem = self.log.path().file_stem().unwrap_or_default();
        stem.to_string_lossy().into_owned()
    }

    /// First and last instant; every message is logged at its stamp.
    fn span(&self) -> [String; 2] {
        let (begin, end) = self.log.time_range().unwrap_or_default();
        [rfc3339(begin), rfc3339(end)]
    }

    fn begin(&self, out: &mut dyn Write) -> io::Result<()> {
        let [begin, end] = self.span();
        match self.format {
            ExportFormat::Csv => writeln!(out, "{SOLUTION_HEADER}"),
            ExportFormat::Tum => Ok(()),
            ExportFormat::Kml => {
                let name = xml_text(&self.name());
                // Heights in KML are above sea level, ours above the ellipsoid: on the ground is where the track belongs.
                writeln!(
                    out,
                    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
                     <kml xmlns=\"http://www.opengis.net/kml/2.2\">\n<Document>\n<name>{name}</name>\n\
                     <Style id=\"track\"><LineStyle><color>ff2060ff</color><width>3</width></LineStyle></Style>\n\
                     <Placemark>\n<name>{name}</name>\n\
                     <TimeSpan><begin>{begin}</begin><end>{end}</end></TimeSpan>\n\
                     <styleUrl>#track</styleUrl>\n<MultiGeometry>"
                )
            }
            ExportFormat::Geojson => writeln!(
                out,
                "{{\"type\":\"FeatureCollection\",\"features\":[{{\"type\":\"Feature\",\
                 \"properties\":{{\"name\":{},\"begin\":\"{begin}\",\"end\":\"{end}\"}},\
                 \"geometry\":{{\"type\":\"MultiLineString\",\"coordinates\":[",
                json_text(&self.name())
            ),
        }
    }

    fn block(&mut self, out: &mut dyn Write, block: &SolutionTable) -> io::Result<()> {
        match self.format {
            ExportFormat::Csv => {
                let t0 = *self.t0.get_or_insert(block.t0().unwrap_or_default());
                write_epochs(out, block, t0)
            }
            ExportFormat::Tum => {
                let Some(origin) = self.origin.or(block.origin()) else {
                    return Ok(());
                };
                self.origin = Some(origin);
                Trajectory::from_solution(block, origin).write_poses(out)
            }
            ExportFormat::Kml | ExportFormat::Geojson => {
                for (time, at) in block.time.iter().zip(&block.position) {
                    let point = [at.longitude_deg(), at.latitude_deg(), at.height];
                    if !point.iter().all(|x| x.is_finite()) {
                        continue;
                    }
                    let near = |last: Time| time.0 - last.0 < MAP_INTERVAL_NS;
                    if self.last_time.is_some_and(near) {
                        self.held = Some(point);
                        continue;
                    }
                    self.last_time = Some(*time);
                    self.held = None;
                    self.point(out, point)?;
                }
                Ok(())
            }
        }
    }

    /// Add a point to the track; lines end at the antimeridian, where \[RFC7946\] 3.1.9 wants them cut.
    fn point(&mut self, out: &mut dyn Write, point: [f64; 3]) -> io::Result<()> {
        if let Some(last) = self.last {
            if (point[0] - last[0]).abs() > 180.0 {
                let side = 180f64.copysign(last[0]);
                let turned = point[0] + 2.0 * side;
                let part = (side - last[0]) / (turned - last[0]);
                let crossing = |i: usize| last[i] + part * (point[i] - last[i]);
                let (latitude, height) = (crossing(1), crossing(2));
                self.add(out, [side, latitude, height])?;
                self.close(out)?;
                self.add(out, [-side, latitude, height])?;
            } else if self.format == ExportFormat::Kml && self.in_line == LONGEST_LINE {
                self.close(out)?;
                self.add(out, last)?;
            }
        }
        self.add(out, point)
    }

    fn add(&mut self, out: &mut dyn Write, point: [f64; 3]) -> io::Result<()> {
        let [longitude, latitude, height] = point;
        match (self.format, self.in_line) {
            (ExportFormat::Kml, 0) => writeln!(
                out,
                "<LineString><tessellate>1</tessellate><altitudeMode>clampToGround</altitudeMode><coordinates>"
            )?,
            (_, 0) if self.last.is_some() => write!(out, ",\n[")?,
            (_, 0) => write!(out, "[")?,
            (ExportFormat::Geojson, _) => writeln!(out, ",")?,
            _ => {}
        }
        // Nine decimals of a degree are a tenth of a millimetre.
        if self.format == ExportFormat::Kml {
            writeln!(out, "{longitude:.9},{latitude:.9},{height:.3}")?;
        } else {
            write!(out, "[{longitude:.9},{latitude:.9},{height:.3}]")?;
        }
        self.in_line += 1;
        self.last = Some(point);
        Ok(())
    }

    fn close(&mut self, out: &mut dyn Write) -> io::Result<()> {
        if self.in_line == 0 {
            return Ok(());
        }
        // A line has two points, also where the solution has one.
        if let (1, Some(only)) = (self.in_line, self.last) {
            self.add(out, only)?;
        }
        self.in_line = 0;
        if self.format == ExportFormat::Kml {
            writeln!(out, "</coordinates></LineString>")
        } else {
            write!(out, "]")
        }
    }

    fn end(&mut self, out: &mut dyn Write) -> io::Result<()> {
        if let Some(end) = self.held.take() {
            self.point(out, end)?;
        }
        match self.format {
            ExportFormat::Csv | ExportFormat::Tum => Ok(()),
            ExportFormat::Kml => {
                self.close(out)?;
                writeln!(out, "</MultiGeometry>\n</Placemark>\n</Document>\n</kml>")
            }
            ExportFormat::Geojson => {
                self.close(out)?;
                writeln!(out, "\n]}}}}]}}")
            }
        }
    }
}

/// Text between tags.
fn xml_text(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            // XML has no way to write them.
            c if c.is_control() => safe.push('\u{fffd}'),
            c => safe.push(c),
        }
    }
    safe
}

/// A string in quotes.
fn json_text(text: &str) -> String {
    let mut safe = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => safe.extend(['\\', c]),
            c if c.is_control() => safe.push_str(&format!("\\u{:04x}", c as u32)),
            c => safe.push(c),
        }
    }
    safe.push('"');
    safe
}
