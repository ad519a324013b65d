//! The heading of a slow robot against its wheels and gyro.

use crate::recording::{Recording, at_most, csv_of, insnav, table, text};

/// A slow robot: its heading is barely observable, and a confident wrong one would be the failure.
///
/// The reference is wheel speed and gyro alone: the path they describe, turned until it fits the positions.
#[test]
fn husky_heading_is_within_its_sigmas() {
    let Some(drive) = Recording::open("husky_rl_test1", 395.0, &[]) else {
        return;
    };
    let wheels = table(&drive.folder.join("wheel_odom.csv"));
    let fixes = csv_of(&drive, "gnss.csv.gz");
    let turns = turns_of(&csv_of(&drive, "imu.csv.gz"));
    let heading_at_start = fit_heading(&wheels, &turns, &fixes);

    let (_, out) = drive.run(&["--rate", "1"]);
    let csv = drive.work.path().join("solution.csv");
    insnav(&["convert", text(&out), "-o", text(&csv)]);
    let (mut worst, mut least_sigma): (f64, f64) = (0.0, f64::INFINITY);
    let solution = table(&csv);
    assert!(solution.len() > 300);
    for row in &solution {
        let (t, heading, sigma) = (row[0], row[9], row[18]);
        let reference = heading_at_start + at(&turns, t).to_degrees();
        let error = (heading - reference + 180.0).rem_euclid(360.0) - 180.0;
        worst = worst.max(error.abs() / sigma);
        least_sigma = least_sigma.min(sigma);
    }
    // A heading declared unknown (104°) would pass any bar on its own sigma.
    at_most("husky, least heading sigma deg", least_sigma, 30.0);
    at_most("husky, heading error over its sigma, largest", worst, 3.0);
}

/// (time, turn since the begin) by the Down gyro, rad.
fn turns_of(imu: &[Vec<f64>]) -> Vec<(f64, f64)> {
    let mut turn = 0.0;
    let mut out = vec![(imu[0][0], 0.0)];
    for pair in imu.windows(2) {
        turn += pair[1][3] * (pair[1][0] - pair[0][0]);
        out.push((pair[1][0], turn));
    }
    out
}

fn at(series: &[(f64, f64)], t: f64) -> f64 {
    let i = series
        .partition_point(|p| p.0 < t)
        .clamp(1, series.len() - 1);
    let (a, b) = (series[i - 1], series[i]);
    a.1 + (b.1 - a.1) * ((t - a.0) / (b.0 - a.0)).clamp(0.0, 1.0)
}

/// Heading at the begin, degrees: chords of 20 s of the path by wheels and gyro against the same chords of the positions.
fn fit_heading(wheels: &[Vec<f64>], turns: &[(f64, f64)], fixes: &[Vec<f64>]) -> f64 {
    let (mut north, mut east) = (vec![(wheels[0][0], 0.0)], vec![(wheels[0][0], 0.0)]);
    for pair in wheels.windows(2) {
        let step = pair[1][1] * (pair[1][0] - pair[0][0]);
        let turn = at(turns, pair[1][0]);
        north.push((pair[1][0], north[north.len() - 1].1 + step * turn.cos()));
        east.push((pair[1][0], east[east.len() - 1].1 + step * turn.sin()));
    }
    const METRES_PER_DEGREE: f64 = 111_000.0;
    let shrink = fixes[0][1].to_radians().cos();
    let (mut real, mut imaginary) = (0.0, 0.0);
    for a in fixes {
        let Some(b) = fixes.iter().find(|b| b[0] >= a[0] + 20.0) else {
            break;
        };
        let (n, e) = (
            (b[1] - a[1]) * METRES_PER_DEGREE,
            (b[2] - a[2]) * METRES_PER_DEGREE * shrink,
        );
        let (x, y) = (
            at(&north, b[0]) - at(&north, a[0]),
            at(&east, b[0]) - at(&east, a[0]),
        );
        // (n + i e) times the conjugate of (x + i y): its argument is the turn between the two.
        real += n * x + e * y;
        imaginary += e * x - n * y;
    }
    imaginary.atan2(real).to_degrees()
}
