//! A solution written and read back: every number, in both frames, with its covariance.

use insnav_core::attitude::exp;
use insnav_core::earth::{Geodetic, LocalFrame};
use insnav_core::filter::{Update, Verdict};
use insnav_core::imu::ImuErrors;
use insnav_core::mechanization::NavState;
use insnav_core::sample::GnssPosition;
use insnav_core::solution::{Epoch, Motion, Sink};
use insnav_core::time::Time;
use insnav_log::ros2::{Decode, NavSatFix, Odometry};
use insnav_log::tum::Trajectory;
use insnav_log::{
    Compression, Log, LogError, McapSink, ReadOptions, SinkOptions, SolutionTable, convert,
};
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};
use std::path::Path;

const ORIGIN: [f64; 3] = [59.35, 18.07, 30.0];

fn origin() -> Geodetic {
    Geodetic::from_degrees(ORIGIN[0], ORIGIN[1], ORIGIN[2])
}

/// An epoch with nothing zero, symmetric or round about it.
fn epoch(k: i64) -> Epoch {
    let s = k as f64;
    let mixing =
        SMatrix::<f64, 15, 15>::from_fn(|i, j| ((i * 31 + j * 17 + 7) % 23) as f64 / 23.0 - 0.4);
    let scale = SMatrix::<f64, 15, 1>::from_fn(|i, _| {
        [0.5, 0.1, 0.01, 1e-4, 0.02][i / 3] * (1.0 + 0.1 * i as f64)
    });
    let covariance = SMatrix::from_diagonal(&scale)
        * (mixing * mixing.transpose())
        * SMatrix::from_diagonal(&scale);
    // Products differ in the last digit from one side of the diagonal to the other; the file keeps one side.
    let covariance = SMatrix::from_fn(|i, j| covariance[(i.min(j), i.max(j))]);
    Epoch {
        nav: NavState {
            time: Time(1_600_000_000_000_000_000 + k * 10_000_000),
            position: origin().offset(&Vector3::new(300.0 + s, -200.0 + 2.0 * s, -4.0 - 0.1 * s)),
            velocity_n: Vector3::new(3.0 + 0.01 * s, -5.0, 0.4),
            q_nb: UnitQuaternion::from_euler_angles(0.1, -0.2, 2.0 + 0.01 * s),
        },
        rate_b: Vector3::new(0.02, -0.01, 0.3),
        imu_errors: ImuErrors {
            gyro_bias: Vector3::new(1e-4, -2e-4, 3e-4),
            accel_bias: Vector3::new(0.01, 0.02, -0.03),
            ..ImuErrors::default()
        },
        motion: if k % 2 == 0 {
            Motion::Moving
        } else {
            Motion::Stationary {
                since: Time(1_600_000_000_000_000_000),
            }
        },
        evidence: Default::default(),
        covariance,
    }
}

fn update(k: i64) -> Update {
    Update {
        time: Time(1_600_000_000_000_000_000 + k * 10_000_000),
        measurement: "gnss_position",
        dof: 3,
        residual: [0.1, -0.2, 0.3],
        sigma: [0.5, 0.6, 0.7],
        nis: 2.5,
        verdict: [Verdict::Accepted, Verdict::Inflated, Verdict::Rejected][k as usize % 3],
    }
}

fn every_sample() -> SinkOptions {
    SinkOptions {
        rate_hz: 0.0,
        origin: Some(origin()),
        ..SinkOptions::default()
    }
}

fn write(
    path: &Path,
    options: SinkOptions,
    count: i64,
) -> Result<insnav_log::SinkSummary, LogError> {
    let mut sink = McapSink::create(path, options)?;
    for k in 0..count {
        let epoch = epoch(k);
        sink.update(&update(k));
        if sink.wants_epoch(epoch.nav.time) {
            sink.epoch(&epoch);
        }
    }
    sink.finish()
}

/// Relative to what a number may lose on its way through degrees and back: a few ulps.
fn assert_close(a: &Vector3<f64>, b: &Vector3<f64>, what: &str) {
    assert!(
        (a - b).norm() <= 1e-14 * b.norm().max(1e-300) * 4.0,
        "{what}: {a} {b}"
    );
}

#[test]
fn what_is_written_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.insnav.mcap");
    let mut options = every_sample();
    options
        .metadata
        .insert("t0_ns".into(), "1600000000000000000".into());
    options
        .metadata
        .insert("lever_arm_b_m".into(), "[0.5, -0.25, -1]".into());
    let mut sink = McapSink::create(&path, options).unwrap();
    let covariance = Matrix3::new(4.0, 0.5, 0.1, 0.5, 5.0, -0.2, 0.1, -0.2, 9.0);
    let fix = GnssPosition {
        time: epoch(1).nav.time,
        position: origin(),
        covariance_n: Some(covariance),
    };
    sink.withheld(&fix);
    for k in 0..5 {
        sink.update(&update(k));
        sink.epoch(&epoch(k));
    }
    assert!(
        !path.exists(),
        "the file must not appear before it is whole"
    );
    let summary = sink.finish().unwrap();
    assert_eq!(
        (
            summary.epochs,
            summary.updates,
            summary.withheld,
            summary.origin
        ),
        (5, 5, 1, Some(origin()))
    );
    assert_eq!(summary.bytes, std::fs::metadata(&path).unwrap().len());

    let table = SolutionTable::read(&path).unwrap();
    assert_eq!(
        (table.len(), table.updates.len(), table.t0()),
        (5, 5, Some(Time(1_600_000_000_000_000_000)))
    );
    assert_eq!(table.lever_arm_b(), Some(Vector3::new(0.5, -0.25, -1.0)));
    assert!(table.origin().unwrap().offset_to(&origin()).norm() < 1e-8);
    for k in 0..5 {
        let (i, epoch) = (k as usize, epoch(k));
        assert_eq!(table.time[i], epoch.nav.time);
        // Degrees hold 1.6e-9 m at the Earth's radius.
        assert!(table.position[i].offset_to(&epoch.nav.position).norm() < 1e-8);
        assert_eq!(table.velocity_n[i], epoch.nav.velocity_n);
        assert!(table.q_nb[i].angle_to(&epoch.nav.q_nb) < 1e-7);
        assert_close(&table.rate_b[i], &epoch.rate_b, "rate");
        assert_close(
            &table.gyro_bias[i],
            &epoch.imu_errors.gyro_bias,
            "gyro bias",
        );
        assert_close(
            &table.accel_bias[i],
            &epoch.imu_errors.accel_bias,
            "accelerometer bias",
        );
        assert_eq!(
            table.position_covariance_n[i],
            epoch.position_covariance_n()
        );
        assert_eq!(
            table.velocity_covariance_n[i],
            epoch.velocity_covariance_n()
        );
        assert_eq!(
            table.attitude_covariance_n[i],
            epoch.attitude_covariance_n()
        );
        let sigma = |at: usize| {
            epoch
                .covariance
                .fixed_view::<3, 3>(at, at)
                .diagonal()
                .map(f64::sqrt)
        };
        assert_close(&table.position_sigma_n[i], &sigma(0), "position sigma");
        assert_close(&table.velocity_sigma_n[i], &sigma(3), "velocity sigma");
        assert_close(&table.attitude_sigma_n[i], &sigma(6), "attitude sigma");
        assert_close(&table.gyro_bias_sigma[i], &sigma(9), "gyro bias sigma");
        assert_close(
            &table.accel_bias_sigma[i],
            &sigma(12),
            "accelerometer bias sigma",
        );
        assert_eq!(table.stationary[i], epoch.motion != Motion::Moving);
        let (read, written) = (&table.updates[i], update(k));
        assert_eq!(
            (read.time, read.measurement.as_str(), read.dof),
            (written.time, written.measurement, written.dof)
        );
        assert_eq!(
            (read.residual, read.sigma, read.nis, read.verdict),
            (
                written.residual,
                written.sigma,
                written.nis,
                written.verdict
            )
        );
    }
    let [withheld] = table.withheld.as_slice() else {
        panic!("{:?}", table.withheld)
    };
    assert_eq!(
        (withheld.time, withheld.covariance_n),
        (fix.time, fix.covariance_n)
    );
}

/// The oracle of the ROS frames: move the truth by a small error, express both in ROS frames by finite rotations, and compare
/// the spread of the differences with the covariance that was written.
#[test]
fn odometry_covariances_are_those_of_the_errors_in_its_own_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, every_sample(), 1).unwrap();
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    let topic = log
        .topics()
        .iter()
        .find(|t| t.name == "/insnav/odometry")
        .unwrap();
    let mut read = None;
    log.each_message(topic, |message| -> Result<(), LogError> {
        let odometry = Odometry::decode(message.data).unwrap();
        assert_eq!(
            (odometry.header.frame_id, odometry.child_frame_id),
            ("map", "base_link")
        );
        read = Some((
            odometry.pose,
            odometry.pose_covariance,
            odometry.twist,
            odometry.twist_covariance,
        ));
        Ok(())
    })
    .unwrap();
    let (pose, pose_covariance, twist, twist_covariance) = read.unwrap();

    let epoch = epoch(0);
    let map = LocalFrame::new(origin());
    let enu = |v: Vector3<f64>| Vector3::new(v.y, v.x, -v.z);
    let flu = |v: Vector3<f64>| Vector3::new(v.x, -v.y, -v.z);
    // Position, attitude as images of the body's axes, velocity and rate, by their definitions.
    let express = |nav: &NavState, rate_b: Vector3<f64>| {
        let position = enu(map.to_ned(&nav.position));
        let axis = |v: Vector3<f64>| enu(map.rotation_from(&nav.position) * (nav.q_nb * flu(v)));
        let axes =
            Matrix3::from_columns(&[axis(Vector3::x()), axis(Vector3::y()), axis(Vector3::z())]);
        (
            position,
            axes,
            flu(nav.q_nb.inverse() * nav.velocity_n),
            flu(rate_b),
        )
    };
    let (position, axes, linear, angular) = express(&epoch.nav, epoch.rate_b);
    assert!((pose.position - position).norm() < 1e-9);
    let [x, y, z, w] = pose.orientation;
    let q = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
    assert!((q.to_rotation_matrix().into_inner() - axes).norm() < 1e-12);
    assert!((twist.linear - linear).norm() < 1e-12 && (twist.angular - angular).norm() < 1e-12);

    // Jacobian of (position, rotation about map axes, linear, angular) by the 15 errors, numerically through ⊞.
    let mut jacobian = SMatrix::<f64, 12, 15>::zeros();
    for i in 0..15 {
        // Positions are differences of 6e6 m, good to 1e-9 m: a metre as step leaves 1e-9 of the derivative.
        let step = if i < 3 { 1.0 } else { 1e-4 };
        let error = |sign: f64| {
            let mut dx = SMatrix::<f64, 15, 1>::zeros();
            dx[i] = sign * step;
            let part = |at: usize| Vector3::new(dx[at], dx[at + 1], dx[at + 2]);
            let mut nav = epoch.nav;
            nav.position = nav.position.offset(&part(0));
            nav.velocity_n += part(3);
            nav.q_nb = exp(&part(6)) * nav.q_nb;
            // true rate = measured − (bias + dx), so the estimated rate moves the other way.
            express(&nav, epoch.rate_b - part(9))
        };
        let (plus, minus) = (error(1.0), error(-1.0));
        let turn = (plus.1 * minus.1.transpose() - minus.1 * plus.1.transpose()) * 0.5;
        let columns = [
            plus.0 - minus.0,
            Vector3::new(turn[(2, 1)], turn[(0, 2)], turn[(1, 0)]),
            plus.2 - minus.2,
            plus.3 - minus.3,
        ];
        for (block, column) in columns.iter().enumerate() {
            jacobian
                .fixed_view_mut::<3, 1>(3 * block, i)
                .copy_from(&(column / (2.0 * step)));
        }
    }
    let expected = jacobian * epoch.covariance * jacobian.transpose();
    for (at, written) in [(0, pose_covariance), (6, twist_covariance)] {
        for i in 0..6 {
            for j in 0..6 {
                // The two halves of the twist are correlated in truth; the message's blocks leave that out.
                if at == 6 && (i < 3) != (j < 3) {
                    assert_eq!(written[6 * i + j], 0.0);
                    continue;
                }
                let e = expected[(at + i, at + j)];
                let scale = (expected[(at + i, at + i)] * expected[(at + j, at + j)]).sqrt();
                // Left out of the message: the level turns by 1/R with position, at 59° by up to 3e-7 rad per metre, so
                // half a metre makes 1.5e-5 of an attitude sigma of 0.01 rad.
                assert!(
                    (written[6 * i + j] - e).abs() < 3e-5 * scale,
                    "{at} {i} {j}: {} {e}",
                    written[6 * i + j]
                );
            }
        }
    }
}

#[test]
fn another_point_of_the_body_has_its_own_position_velocity_and_sigma() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let lever = Vector3::new(1.5, -0.5, -1.0);
    write(
        &path,
        SinkOptions {
            lever_arm_b_m: lever.into(),
            ..every_sample()
        },
        1,
    )
    .unwrap();
    let table = SolutionTable::read(&path).unwrap();
    let epoch = epoch(0);
    let move_by = |e: &Epoch, phi: Vector3<f64>| {
        let q = exp(&phi) * e.nav.q_nb;
        (
            e.nav.position.offset(&(q * lever)),
            e.nav.velocity_n + q * e.rate_b.cross(&lever),
        )
    };
    let (position, velocity) = move_by(&epoch, Vector3::zeros());
    assert!(position.offset_to(&table.position[0]).norm() < 1e-8);
    assert!((velocity - table.velocity_n[0]).norm() < 1e-12);
    // The position's covariance by numerical derivatives over position and attitude.
    let mut jacobian = SMatrix::<f64, 3, 15>::zeros();
    jacobian
        .fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&Matrix3::identity());
    for i in 0..3 {
        let mut phi = Vector3::zeros();
        phi[i] = 1e-5;
        let derivative = move_by(&epoch, -phi).0.offset_to(&move_by(&epoch, phi).0) / 2e-5;
        jacobian
            .fixed_view_mut::<3, 1>(0, 6 + i)
            .copy_from(&derivative);
    }
    let expected = jacobian * epoch.covariance * jacobian.transpose();
    assert!((table.position_covariance_n[0] - expected).norm() < 1e-6 * expected.norm());
    assert!(
        (expected - epoch.position_covariance_n()).norm() > 1e-4 * expected.norm(),
        "the arm must matter"
    );
}

#[test]
fn the_fix_topic_has_its_covariance_in_east_north_up() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, every_sample(), 1).unwrap();
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    let topic = log
        .topics()
        .iter()
        .find(|t| t.name == "/insnav/fix")
        .unwrap();
    let p = epoch(0).position_covariance_n();
    log.each_message(topic, |message| -> Result<(), LogError> {
        let c = NavSatFix::decode(message.data).unwrap().position_covariance;
        assert_eq!([c[0], c[4], c[8]], [p[(1, 1)], p[(0, 0)], p[(2, 2)]]);
        assert_eq!([c[1], c[2], c[5]], [p[(0, 1)], -p[(1, 2)], -p[(0, 2)]]);
        Ok(())
    })
    .unwrap();
}

#[test]
fn the_rate_is_kept_on_an_even_grid() {
    let folder = tempfile::tempdir().unwrap();
    for (rate_hz, step_ns, expected) in [
        (0.0, 10_000_000, 300),
        (50.0, 10_000_000, 150),
        (50.0, 9_990_000, 150),
        (30.0, 10_000_000, 90),
    ] {
        let path = folder.path().join(format!("{rate_hz}_{step_ns}.mcap"));
        let mut sink = McapSink::create(
            &path,
            SinkOptions {
                rate_hz,
                ..SinkOptions::default()
            },
        )
        .unwrap();
        for k in 0..300 {
            let mut epoch = epoch(k);
            epoch.nav.time = Time(k * step_ns);
            if sink.wants_epoch(epoch.nav.time) {
                sink.epoch(&epoch);
            }
        }
        let epochs = sink.finish().unwrap().epochs as i64;
        assert!(
            (epochs - expected).abs() <= 1,
            "{rate_hz} Hz from steps of {step_ns} ns: {epochs}"
        );
    }
}

#[test]
fn diagnostics_come_once_a_second() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, every_sample(), 450).unwrap();
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    let count = |name: &str| log.topics().iter().find(|t| t.name == name).unwrap().count;
    assert_eq!(
        (
            count("/diagnostics"),
            count("/insnav/state"),
            count("/insnav/updates")
        ),
        (5, 450, 450)
    );
    assert!(log.is_indexed());
}

#[test]
fn a_dropped_sink_leaves_nothing_and_an_existing_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut sink = McapSink::create(&path, SinkOptions::default()).unwrap();
    sink.epoch(&epoch(0));
    drop(sink);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    std::fs::write(&path, b"precious").unwrap();
    let error = McapSink::create(&path, SinkOptions::default())
        .err()
        .unwrap();
    assert_eq!(error.code(), "output_exists");
    assert!(error.remedy().contains("--force"));
    assert_eq!(std::fs::read(&path).unwrap(), b"precious");
    write(
        &path,
        SinkOptions {
            force: true,
            ..SinkOptions::default()
        },
        3,
    )
    .unwrap();
    assert!(SolutionTable::read(&path).is_ok());
    let error = McapSink::create(&folder.path().join("no/a.mcap"), SinkOptions::default())
        .err()
        .unwrap();
    assert_eq!(error.code(), "output_not_writable");
}

#[cfg(unix)]
#[test]
fn a_full_disk_is_reported_by_finish() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    // The temporary file is opened through this link, and the device is always full.
    let temporary = folder
        .path()
        .join(format!(".a.mcap.{}.partial", std::process::id()));
    if !Path::new("/dev/full").exists() {
        eprintln!("SKIPPED: no /dev/full");
        return;
    }
    symlink("/dev/full", &temporary).unwrap();
    let written =
        McapSink::create(&folder.path().join("a.mcap"), every_sample()).and_then(|mut sink| {
            for k in 0..5000 {
                sink.epoch(&epoch(k));
            }
            sink.finish()
        });
    assert_eq!(written.unwrap_err().code(), "output_not_writable");
    assert!(!folder.path().join("a.mcap").exists());
}

#[test]
fn tum_and_csv_say_the_same_as_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut options = SinkOptions {
        compression: Compression::Lz4,
        ..every_sample()
    };
    options
        .metadata
        .insert("t0_ns".into(), "1600000000000000000".into());
    write(&path, options, 20).unwrap();
    let solution = SolutionTable::read(&path).unwrap();

    let tum = folder.path().join("a.tum");
    assert_eq!(convert::solution_to_tum(&path, &tum, false).unwrap(), 20);
    let back = SolutionTable::from_trajectory(&Trajectory::read(&tum).unwrap(), origin());
    let csv = folder.path().join("a.csv.gz");
    convert::solution_to_csv(&path, &csv, false).unwrap();
    let table = SolutionTable::read_counting_from(&csv, Time(1_600_000_000_000_000_000)).unwrap();
    for i in 0..20 {
        assert_eq!(
            (back.time[i], table.time[i]),
            (solution.time[i], solution.time[i])
        );
        // Micrometres are written to TUM, tenths of millimetres of height to CSV.
        assert!(back.position[i].offset_to(&solution.position[i]).norm() < 2e-6);
        assert!(table.position[i].offset_to(&solution.position[i]).norm() < 1e-4);
        assert!(back.q_nb[i].angle_to(&solution.q_nb[i]) < 1e-7);
        assert!(table.q_nb[i].angle_to(&solution.q_nb[i]) < 1e-7);
        assert!((table.velocity_n[i] - solution.velocity_n[i]).norm() < 1e-5);
        assert_close(
            &table.position_sigma_n[i],
            &solution.position_sigma_n[i],
            "sigma",
        );
    }
    let error = convert::solution_to_tum(&csv, &folder.path().join("b.tum"), false);
    assert!(error.is_ok(), "a CSV with angles is a trajectory too");
}

#[test]
fn a_recording_is_no_solution() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    insnav_log::LogWriter::create(&path, Default::default())
        .unwrap()
        .finish()
        .unwrap();
    assert_eq!(
        SolutionTable::read(&path).unwrap_err().code(),
        "not_a_solution"
    );
    std::fs::write(&path, b"").unwrap();
    assert_eq!(
        SolutionTable::read(&path).unwrap_err().code(),
        "not_an_mcap"
    );
}
