//! Logs from tables and tables from logs.

use crate::recorder::{SECOND, T0, samples};
use crate::recordings::recording;
use insnav_core::earth::Geodetic;
use insnav_core::sample::{GnssPosition, GnssVelocity, ImuSample, Sample};
use insnav_core::time::Time;
use insnav_log::{ImuAxes, Log, LogWriter, LogWriterOptions, ReadOptions, Role, convert, csv};
use nalgebra::{Matrix3, Vector3};
use std::path::{Path, PathBuf};

#[test]
fn real_logs_give_the_samples_of_the_tables_they_were_made_from() {
    for (file, folder, imu_count, gnss_count) in [
        (
            "rtkexp_drive_ros2_zstd.mcap",
            "rtkexp_drive_0708",
            54858,
            2197,
        ),
        ("comma2k19_ros2_lz4.mcap", "comma2k19_example1", 6256, 579),
        ("comma2k19_ros2_none.mcap", "comma2k19_example1", 6256, 579),
    ] {
        let (Some(log), Some(folder)) = (
            recording("mcap_real").map(|f| f.join(file)),
            recording(folder),
        ) else {
            return;
        };
        let log = Log::open(&log, ReadOptions::default()).unwrap();
        let imu = csv::read_imu(&folder.join("imu.csv.gz")).unwrap();
        let gnss = csv::read_gnss(&folder.join("gnss.csv.gz")).unwrap();
        assert_eq!((imu.t_s.len(), gnss.t_s.len()), (imu_count, gnss_count));
        let t0 = log.t0().unwrap().unwrap();
        let (mut at_imu, mut at_position, mut at_velocity) = (0, 0, 0);
        let mut last = Time(i64::MIN);
        for sample in samples(&log) {
            assert!(sample.time() >= last);
            last = sample.time();
            match sample {
                Sample::Imu(s) => {
                    assert_eq!(s.angular_rate_b, imu.angular_rate[at_imu]);
                    assert_eq!(s.specific_force_b, imu.specific_force[at_imu]);
                    // Both were rounded: the table to 10 µs, the log's maker to a double's 0.2 µs.
                    assert!((s.time.since(t0) - imu.t_s[at_imu]).abs() < 1.1e-5);
                    at_imu += 1;
                }
                Sample::GnssPosition(s) => {
                    assert_eq!(s.position, gnss.position[at_position]);
                    assert!((s.time.since(t0) - gnss.t_s[at_position]).abs() < 1.1e-5);
                    let sigma = gnss.position_sigma_n[at_position];
                    match s.covariance_n {
                        None => assert!(sigma.x.is_nan()),
                        Some(p) => assert!((p.diagonal().map(f64::sqrt) - sigma).norm() < 1e-12),
                    }
                    at_position += 1;
                }
                Sample::GnssVelocity(s) => {
                    let expected = gnss.velocity_n[at_velocity];
                    assert_eq!(s.velocity_n.xy(), expected.xy());
                    // comma2k19 has no vertical velocity: its log says 0, which must come out as "not measured".
                    assert!(
                        s.velocity_n.z == expected.z
                            || (s.velocity_n.z.is_nan() && expected.z.is_nan()),
                        "{s:?}"
                    );
                    at_velocity += 1;
                }
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(
            (at_imu, at_position, at_velocity),
            (imu_count, gnss_count, gnss_count),
            "{file}"
        );
    }
}

#[test]
fn written_samples_are_read_back_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let v = Vector3::new;
    let covariance = Some(Matrix3::new(4.0, 0.5, 0.1, 0.5, 5.0, -0.2, 0.1, -0.2, 9.0));
    let written = [
        Sample::Imu(ImuSample {
            time: Time(T0),
            angular_rate_b: v(0.1, 0.2, 0.3),
            specific_force_b: v(1.0, 2.0, -9.8),
        }),
        Sample::GnssPosition(GnssPosition {
            time: Time(T0 + 1),
            position: Geodetic::from_degrees(59.0, 18.0, 30.0),
            covariance_n: covariance,
        }),
        Sample::GnssVelocity(GnssVelocity {
            time: Time(T0 + 1),
            velocity_n: v(1.0, 2.0, 3.0),
            covariance_n: covariance,
        }),
        Sample::GnssVelocity(GnssVelocity {
            time: Time(T0 + 2),
            velocity_n: v(1.0, 2.0, 3.0),
            covariance_n: None,
        }),
    ];
    let options = LogWriterOptions {
        t0: Some(Time(T0 - 5)),
        ..LogWriterOptions::default()
    };
    let mut writer = LogWriter::create(&path, options).unwrap();
    for sample in &written {
        writer.write(sample).unwrap();
    }
    let heading = insnav_core::sample::Heading {
        time: Time(T0),
        heading: 0.0,
        sigma: 1.0,
    };
    assert_eq!(
        writer.write(&Sample::Heading(heading)).unwrap_err().code(),
        "unwritable_sample"
    );
    writer.finish().unwrap();
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    assert_eq!(samples(&log), written);
    assert_eq!(log.t0().unwrap(), Some(Time(T0 - 5)));
    assert_eq!(
        log.frame_of(Role::GnssPosition).unwrap().as_deref(),
        Some("gps")
    );
}

fn convert(inputs: &convert::CsvInputs, output: &Path, axes: ImuAxes) -> convert::ConvertSummary {
    let options = convert::ConvertOptions {
        axes,
        ..Default::default()
    };
    convert::csv_to_mcap(inputs, output, &options).unwrap()
}

#[test]
fn tables_become_logs_and_tables_again() {
    for name in [
        "hipnuc_20220504",
        "kth_skog_car",
        "rtkexp_drive_0708",
        "comma2k19_example1",
    ] {
        let Some(source) = recording(name) else {
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let inputs = convert::CsvInputs::in_folder(&source).unwrap();
        let path = folder.path().join("a.mcap");
        let summary = convert(&inputs, &path, ImuAxes::Frd);
        let log = Log::open(&path, ReadOptions::default()).unwrap();
        assert_eq!(log.t0().unwrap(), Some(convert::DEFAULT_T0));
        convert::mcap_to_csv(&log, &folder.path().join("csv"), false).unwrap();
        let back = convert::CsvInputs::in_folder(&folder.path().join("csv")).unwrap();

        let (a, b) = (
            csv::read_imu(&inputs.imu).unwrap(),
            csv::read_imu(&back.imu).unwrap(),
        );
        assert_eq!(
            (a.t_s.len() as u64, &a.angular_rate, &a.specific_force),
            (summary.imu, &b.angular_rate, &b.specific_force)
        );
        assert!(
            a.t_s.iter().zip(&b.t_s).all(|(a, b)| (a - b).abs() < 1e-9),
            "{name}"
        );
        let [a, b] =
            [inputs.gnss.unwrap(), back.gnss.unwrap()].map(|path| csv::read_gnss(&path).unwrap());
        assert_eq!(a.t_s.len(), b.t_s.len());
        let same = |a: f64, b: f64, tolerance: f64| {
            (a - b).abs() <= tolerance || (a.is_nan() && b.is_nan())
        };
        for i in 0..a.t_s.len() {
            assert!((a.t_s[i] - b.t_s[i]).abs() < 1e-9);
            // Eleven decimals of a degree are a micrometre.
            assert!(a.position[i].offset_to(&b.position[i]).norm() < 2e-6);
            for k in 0..3 {
                assert!(
                    same(a.velocity_n[i][k], b.velocity_n[i][k], 0.0),
                    "{name} {i}"
                );
                assert!(
                    same(a.position_sigma_n[i][k], b.position_sigma_n[i][k], 1e-12),
                    "{name} {i}"
                );
            }
        }
    }
}

#[test]
fn flu_tables_are_the_same_log_as_their_frd_twins() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, rows: &str| -> PathBuf {
        let path = folder.path().join(name);
        std::fs::write(&path, format!("t_s,gx,gy,gz,ax,ay,az\n{rows}\n")).unwrap();
        path
    };
    let read = |imu: PathBuf, axes| {
        let path = imu.with_extension("mcap");
        convert(&convert::CsvInputs { imu, gnss: None }, &path, axes);
        samples(&Log::open(&path, ReadOptions::default()).unwrap())
    };
    let frd = read(write("frd.csv", "0.5,0.1,0.2,0.3,1,2,-9.8"), ImuAxes::Frd);
    assert_eq!(
        frd,
        read(write("flu.csv", "0.5,0.1,-0.2,-0.3,1,-2,9.8"), ImuAxes::Flu)
    );
    assert_eq!(frd[0].time(), Time(T0 + SECOND / 2));
}

#[test]
fn every_recording_has_readable_tables() {
    let Some(root) = recording("README.md") else {
        return;
    };
    let (mut read, mut with_truth) = (0, 0);
    let mut folders = vec![root.parent().unwrap().to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            let rows = match name.as_str() {
                _ if path.is_dir() => {
                    folders.push(path);
                    continue;
                }
                "imu.csv.gz" => csv::read_imu(&path).unwrap().t_s.len(),
                "gnss.csv.gz" => csv::read_gnss(&path).unwrap().t_s.len(),
                "truth.csv.gz" => csv::read_truth(&path).unwrap().t_s.len(),
                "truth_quat.csv.gz" => {
                    let table = csv::read_truth_quat(&path).unwrap();
                    with_truth += usize::from(table.orientation.iter().any(Option::is_some));
                    table.t_s.len()
                }
                "speedometer.csv" | "wheel_odom.csv" => csv::read_speed(&path).unwrap().t_s.len(),
                _ => continue,
            };
            assert!(rows > 100, "{}: {rows} rows", path.display());
            read += 1;
        }
    }
    assert!(read >= 34, "{read} tables");
    // Of the ten with a reference, repoimu_TStick_Test01_Static has NaN in every row.
    assert_eq!(with_truth, 9);
}
