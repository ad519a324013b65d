//! Solutions as KML, GeoJSON, CSV and TUM, judged by parsers of others and by what the formats prescribe.

use insnav_core::earth::Geodetic;
use insnav_core::imu::ImuErrors;
use insnav_core::mechanization::NavState;
use insnav_core::solution::{Epoch, Motion, Sink};
use insnav_core::stationary::{Evidence, Witness};
use insnav_core::time::Time;
use insnav_log::tum::Trajectory;
use insnav_log::{ExportFormat, Log, McapSink, ReadOptions, SinkOptions, SolutionTable, export};
use nalgebra::{SMatrix, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};

const T0: i64 = 1_600_000_000_000_000_000;

/// A solution of `count` epochs at 50 Hz, `step_deg` of longitude apart, in a file whose name needs care in every format.
fn solution(folder: &Path, count: i64, longitude_deg: f64, step_deg: f64) -> (PathBuf, Log) {
    let path = folder.join("a \"b\" & <c>.mcap");
    let options = SinkOptions {
        rate_hz: 0.0,
        origin: Some(Geodetic::from_degrees(-16.5, longitude_deg, 30.0)),
        ..SinkOptions::default()
    };
    let mut sink = McapSink::create(&path, options).unwrap();
    for k in 0..count {
        let mut longitude = longitude_deg + step_deg * k as f64;
        if longitude > 180.0 {
            longitude -= 360.0;
        }
        sink.epoch(&Epoch {
            nav: NavState {
                time: Time(T0 + k * 20_000_000),
                position: Geodetic::from_degrees(-16.5, longitude, 30.0 + 0.001 * k as f64),
                velocity_n: Vector3::new(0.5, 20.0, 0.0),
                q_nb: UnitQuaternion::from_euler_angles(0.0, 0.0, 1.5),
            },
            rate_b: Vector3::zeros(),
            imu_errors: ImuErrors::default(),
            motion: Motion::Moving,
            evidence: Default::default(),
            covariance: SMatrix::identity(),
        });
    }
    sink.finish().unwrap();
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    (path, log)
}

fn exported(log: &Log, folder: &Path, format: ExportFormat) -> String {
    let path = folder.join("out").with_extension(format.name());
    export(log, &path, format, true).unwrap();
    std::fs::read_to_string(path).unwrap()
}

/// The lines of a KML as lists of [longitude, latitude, altitude]; everything else is checked on the way.
fn kml_lines(text: &str) -> Vec<Vec<[f64; 3]>> {
    const NS: &str = "http://www.opengis.net/kml/2.2";
    let document = roxmltree::Document::parse(text).unwrap();
    let root = document.root_element();
    assert!(root.has_tag_name((NS, "kml")));
    let find = |name: &str| {
        root.descendants()
            .filter(|n| n.has_tag_name((NS, name)))
            .collect::<Vec<_>>()
    };
    assert_eq!(find("Placemark").len(), 1);
    assert_eq!(find("name")[0].text(), Some("a \"b\" & <c>"));
    // The order that the schema prescribes for a placemark.
    let children: Vec<&str> = find("Placemark")[0]
        .children()
        .filter(|n| n.is_element())
        .map(|n| n.tag_name().name())
        .collect();
    assert_eq!(children, ["name", "TimeSpan", "styleUrl", "MultiGeometry"]);
    assert_eq!(find("begin")[0].text(), Some("2020-09-13T12:26:40.000Z"));
    assert!(
        find("altitudeMode")
            .iter()
            .all(|n| n.text() == Some("clampToGround"))
    );
    find("coordinates")
        .iter()
        .map(|n| {
            let tuples = n.text().unwrap().split_whitespace();
            tuples
                .map(|tuple| {
                    let numbers: Vec<f64> = tuple.split(',').map(|x| x.parse().unwrap()).collect();
                    numbers.try_into().unwrap()
                })
                .collect()
        })
        .collect()
}

/// The lines of a GeoJSON, with the rules of RFC 7946 that apply.
fn geojson_lines(text: &str) -> Vec<Vec<[f64; 3]>> {
    let json: serde_json::Value = serde_json::from_str(text).unwrap();
    assert_eq!(json["type"], "FeatureCollection");
    let features = json["features"].as_array().unwrap();
    assert_eq!(features.len(), 1);
    assert_eq!(features[0]["type"], "Feature");
    assert_eq!(features[0]["properties"]["name"], "a \"b\" & <c>");
    assert_eq!(
        features[0]["properties"]["begin"],
        "2020-09-13T12:26:40.000Z"
    );
    // Section 4: no coordinate reference system but WGS 84, and none is named.
    assert!(json.get("crs").is_none());
    assert_eq!(features[0]["geometry"]["type"], "MultiLineString");
    let lines: Vec<Vec<[f64; 3]>> =
        serde_json::from_value(features[0]["geometry"]["coordinates"].clone()).unwrap();
    for line in &lines {
        // Section 3.1.4: a line has two or more positions; 3.1.9: none crosses the antimeridian.
        assert!(line.len() >= 2);
        assert!(line.windows(2).all(|w| (w[1][0] - w[0][0]).abs() < 180.0));
        assert!(
            line.iter()
                .all(|p| p[0].abs() <= 180.0 && p[1].abs() <= 90.0)
        );
    }
    lines
}

#[test]
fn maps_have_the_track_with_longitude_first() {
    let folder = tempfile::tempdir().unwrap();
    let (_, log) = solution(folder.path(), 101, 18.25, 1e-5);
    for lines in [
        kml_lines(&exported(&log, folder.path(), ExportFormat::Kml)),
        geojson_lines(&exported(&log, folder.path(), ExportFormat::Geojson)),
    ] {
        assert_eq!(lines.len(), 1);
        // Two seconds at five points a second, both ends included.
        assert_eq!(lines[0].len(), 11);
        assert_eq!(lines[0][0], [18.25, -16.5, 30.0]);
        assert_eq!(lines[0][10], [18.251, -16.5, 30.1]);
    }
    // The end is kept where it is no fifth of a second.
    let (_, log) = {
        let other = folder.path().join("other");
        std::fs::create_dir(&other).unwrap();
        solution(&other, 98, 18.25, 1e-5)
    };
    let lines = geojson_lines(&exported(&log, folder.path(), ExportFormat::Geojson));
    assert_eq!(lines[0].last(), Some(&[18.250_97, -16.5, 30.097]));
}

#[test]
fn lines_are_cut_at_the_antimeridian() {
    let folder = tempfile::tempdir().unwrap();
    // Eastward over Fiji; the tenth point of five a second is beyond.
    let (_, log) = solution(folder.path(), 201, 179.999, 1e-5);
    for lines in [
        kml_lines(&exported(&log, folder.path(), ExportFormat::Kml)),
        geojson_lines(&exported(&log, folder.path(), ExportFormat::Geojson)),
    ] {
        assert_eq!(lines.len(), 2);
        let (west, east) = (&lines[0], &lines[1]);
        assert_eq!(west.last().unwrap()[0], 180.0);
        assert_eq!(east[0][0], -180.0);
        assert_eq!(west.last().unwrap()[1..], east[0][1..]);
        assert!(west.iter().all(|p| p[0] > 0.0) && east.iter().all(|p| p[0] < 0.0));
        assert!((east.last().unwrap()[0] + 179.999).abs() < 1e-9);
    }
}

#[test]
fn a_solution_of_one_epoch_is_a_line_of_two_points() {
    let folder = tempfile::tempdir().unwrap();
    let (_, log) = solution(folder.path(), 1, 18.25, 0.0);
    for lines in [
        kml_lines(&exported(&log, folder.path(), ExportFormat::Kml)),
        geojson_lines(&exported(&log, folder.path(), ExportFormat::Geojson)),
    ] {
        assert_eq!(lines, [vec![[18.25, -16.5, 30.0]; 2]]);
    }
}

#[test]
fn long_tracks_are_several_lines_that_meet() {
    let folder = tempfile::tempdir().unwrap();
    // More than one block, and more points than a line of a KML may have: an epoch every 20 ms, so 10 for every point.
    let (_, log) = solution(folder.path(), 105_000, 18.25, 1e-6);
    let lines = kml_lines(&exported(&log, folder.path(), ExportFormat::Kml));
    assert_eq!(lines.len(), 2);
    assert_eq!(lines[0].last(), lines[1].first());
    let points: usize = lines.iter().map(Vec::len).sum();
    // One for the joint, one for the end.
    assert_eq!(points, 10_500 + 2);
    let lines = geojson_lines(&exported(&log, folder.path(), ExportFormat::Geojson));
    assert_eq!((lines.len(), lines[0].len()), (1, 10_501));
}

#[test]
fn csv_and_tum_in_blocks_are_those_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (path, log) = solution(folder.path(), 9000, 18.25, 1e-6);
    let table = SolutionTable::read(&path).unwrap();
    let csv = exported(&log, folder.path(), ExportFormat::Csv);
    let whole = folder.path().join("whole.csv");
    insnav_log::csv::write_solution(&whole, &table, table.t0().unwrap(), false).unwrap();
    assert!(csv == std::fs::read_to_string(whole).unwrap());
    let tum = exported(&log, folder.path(), ExportFormat::Tum);
    let whole = folder.path().join("whole.tum");
    Trajectory::from_solution(&table, table.origin().unwrap())
        .write(&whole, false)
        .unwrap();
    assert!(tum == std::fs::read_to_string(whole).unwrap());
    assert_eq!(tum.lines().count(), 9000);
}

#[test]
fn an_empty_solution_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("empty.mcap");
    McapSink::create(&path, SinkOptions::default())
        .unwrap()
        .finish()
        .unwrap();
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    for format in ExportFormat::ALL {
        let out = folder.path().join("out").with_extension(format.name());
        let error = export(&log, &out, format, false).unwrap_err();
        assert_eq!(error.code(), "not_a_solution");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

#[test]
fn standing_and_what_speaks_for_it_come_back_from_mcap_and_csv() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stop.mcap");
    let options = SinkOptions {
        rate_hz: 0.0,
        ..SinkOptions::default()
    };
    let mut sink = McapSink::create(&path, options).unwrap();
    let evidence = Evidence {
        witness: Witness::Detector,
        specific_force: 0.5,
        angular_rate: 0.25,
        mean_rate: f64::NAN,
        speed: 0.125,
    };
    for (k, motion) in [Motion::Moving, Motion::Stationary { since: Time(T0) }]
        .into_iter()
        .enumerate()
    {
        sink.epoch(&Epoch {
            nav: NavState {
                time: Time(T0 + 2_500_000_000 * k as i64),
                position: Geodetic::from_degrees(59.0, 18.0, 30.0),
                velocity_n: Vector3::zeros(),
                q_nb: UnitQuaternion::identity(),
            },
            rate_b: Vector3::zeros(),
            imu_errors: ImuErrors::default(),
            motion,
            evidence,
            covariance: SMatrix::identity(),
        });
    }
    sink.finish().unwrap();
    let same = |a: f64, b: f64| a == b || (a.is_nan() && b.is_nan());
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    let csv = folder.path().join("stop.csv");
    export(&log, &csv, ExportFormat::Csv, true).unwrap();
    for (file, has_evidence) in [(&path, true), (&csv, false)] {
        let table = SolutionTable::read(file).unwrap();
        assert!(table.has_standing);
        assert_eq!(table.stationary, [false, true]);
        assert_eq!(table.standing_s, [0.0, 2.5]);
        let got = table.stop_evidence[1];
        if has_evidence {
            assert_eq!(got.witness, Witness::Detector);
            let pairs = [
                (got.specific_force, 0.5),
                (got.angular_rate, 0.25),
                (got.mean_rate, f64::NAN),
                (got.speed, 0.125),
            ];
            assert!(pairs.iter().all(|(a, b)| same(*a, *b)), "{got:?}");
        }
    }
    let text = std::fs::read_to_string(&csv).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let last: Vec<&str> = lines.next_back().unwrap().split(',').collect();
    for (name, value) in [
        ("standing_s", "2.5"),
        ("stop_specific_force_ratio", "0.5"),
        ("stop_angular_rate_ratio", "0.25"),
        ("stop_mean_rate_ratio", "nan"),
        ("stop_speed_ratio", "0.125"),
    ] {
        let column = header.iter().position(|h| *h == name).unwrap();
        assert_eq!(last[column], value, "{name}");
    }
}
