//! Scale factors, lever arm and clock offset as states: errors as large as the filter says, and a filter without them is found
//! out.

mod simulated_drives;

use insnav::config::Config;
use insnav::filter::{ACCEL_SCALE, CLOCK_OFFSET, Eskf, GYRO_SCALE, LEVER_ARM};
use insnav::sim::Scenario;
use nalgebra::{Vector1, Vector3};
use simulated_drives::{
    covariance, drawn, drive, mean, motion_nees, nees, over_seeds, scenario, settings, unchanged,
};

/// Ten minutes: long enough for every state to be seen.
const DURATION_S: f64 = 600.0;
/// Drives of a claim and of its negative control.
const SEEDS: u64 = 30;
const CONTROL_SEEDS: u64 = 10;

/// NEES over dof of position, velocity and attitude over all seconds of drives of which each has a scenario of its own, and
/// what `end` makes of each drive's last look.
fn runs<T: Send>(
    seeds: u64,
    config: &Config,
    of: impl Fn(u64) -> Scenario + Sync,
    end: impl Fn(&Eskf, &Scenario) -> T + Sync,
) -> ([f64; 3], Vec<T>) {
    let (nees, ends): (Vec<_>, Vec<_>) = over_seeds(seeds, |seed| {
        let scenario = of(seed);
        let mut rows = Vec::new();
        let mut last = None;
        drive(&scenario, seed, config, unchanged, |_, filter, truth| {
            rows.push(motion_nees(filter, truth));
            last = Some(end(filter, &scenario));
        });
        (mean(rows), last.expect("a drive of more than a second"))
    })
    .into_iter()
    .unzip();
    (mean(nees), ends)
}

/// Without the states: outside the band of the claim, in the block that the error hurts.
fn assert_noticed(config: &Config, of: impl Fn(u64) -> Scenario + Sync, block: usize) {
    let (off, _) = runs(CONTROL_SEEDS, config, of, |_, _| ());
    println!("off: {off:.3?}");
    assert!(off[block] > 1.18, "{off:?}");
}

/// The band of tests/consistency.rs.
fn assert_consistent(nees: &[f64; 3]) {
    for (value, name) in nees.iter().zip(["position", "velocity", "attitude"]) {
        assert!((0.85..=1.18).contains(value), "{name}: {value}");
    }
}

/// Squares of normalised errors at the end of drives, `dof` each: their mean is 1 ± √(2 / (dof · drives)). Four of those.
fn assert_normal(name: &str, ends: &[f64], dof: usize) {
    let n = ends.len();
    let mean = ends.iter().sum::<f64>() / n as f64;
    let band = 4.0 * (2.0 / (dof * n) as f64).sqrt();
    println!("{name}: NEES/dof at the end {mean:.3}, band 1 ± {band:.2}");
    assert!((mean - 1.0).abs() < band, "{name}: {mean}");
}

const SCALE_PPM: f64 = 5000.0;

fn with_scale_factors(seed: u64) -> Scenario {
    let mut scenario = scenario(DURATION_S);
    scenario.imu.errors.gyro_scale_ppm = drawn(seed, SCALE_PPM).into();
    scenario.imu.errors.accel_scale_ppm = drawn(seed ^ 0x100, SCALE_PPM).into();
    scenario
}

#[test]
fn scale_factors_are_estimated_as_well_as_the_filter_says() {
    let mut config = settings();
    config.imu.gyro_scale_sigma_ppm = Some(SCALE_PPM);
    config.imu.accel_scale_sigma_ppm = Some(SCALE_PPM);
    let (on, ends) = runs(SEEDS, &config, with_scale_factors, |filter, scenario| {
        let ppm = |values: [f64; 3]| Vector3::from(values) * 1e-6;
        let gyro = ppm(scenario.imu.errors.gyro_scale_ppm);
        let accel = ppm(scenario.imu.errors.accel_scale_ppm);
        let found = &filter.nominal().imu_errors;
        let p_gyro = covariance(filter, GYRO_SCALE);
        let p_accel = covariance(filter, ACCEL_SCALE);
        (
            nees(&(gyro - found.gyro_scale), &p_gyro),
            nees(&(accel - found.accel_scale), &p_accel),
            p_gyro[(2, 2)].sqrt() * 1e6,
            p_accel[(2, 2)].sqrt() * 1e6,
        )
    });
    println!("on: {on:.3?}");
    assert_consistent(&on);
    let of = |pick: fn(&(f64, f64, f64, f64)) -> f64| ends.iter().map(pick).collect::<Vec<_>>();
    assert_normal("gyro scale", &of(|e| e.0), 3);
    assert_normal("accelerometer scale", &of(|e| e.1), 3);
    let (gyro_z, accel_z) = (of(|e| e.2)[0], of(|e| e.3)[0]);
    println!("sigmas at the end, down axis: gyro {gyro_z:.0} ppm, accelerometer {accel_z:.0} ppm");
    // Turns by right angles are measured against the course, gravity against the fixes' heights.
    assert!(gyro_z < 0.5 * SCALE_PPM && accel_z < 0.5 * SCALE_PPM);
}

#[test]
fn without_their_states_scale_factors_are_noticed() {
    assert_noticed(&settings(), with_scale_factors, 2);
}

const LEVER_ARM_M: f64 = 1.0;

fn with_lever_arm(seed: u64) -> Scenario {
    let mut scenario = scenario(DURATION_S);
    scenario.gnss.lever_arm_b_m = drawn(seed, LEVER_ARM_M).into();
    scenario
}

#[test]
fn an_unknown_lever_arm_is_found() {
    let mut config = settings();
    config.gnss.lever_arm_sigma_m = Some(LEVER_ARM_M);
    let (on, ends) = runs(SEEDS, &config, with_lever_arm, |filter, scenario| {
        let p = covariance(filter, LEVER_ARM);
        let arm = Vector3::from(scenario.gnss.lever_arm_b_m);
        let error = arm - filter.nominal().calibration.lever_arm_b;
        let sigma = p.diagonal().map(f64::sqrt);
        (nees(&error, &p), error.component_div(&sigma).amax(), sigma)
    });
    println!("on: {on:.3?}");
    assert_consistent(&on);
    let squares: Vec<f64> = ends.iter().map(|e| e.0).collect();
    assert_normal("lever arm", &squares, 3);
    let sigma = ends[0].2;
    println!("sigmas at the end: {sigma:.3?} m");
    // Turns show what is ahead and abeam; what is above, the speed with which it sways.
    assert!(sigma.amax() < 0.3 * LEVER_ARM_M, "{sigma}");
    let beyond = ends.iter().filter(|e| e.1 > 3.0).count();
    // The largest of three is beyond three sigmas in 0.8 % of drives: more than two of thirty have a probability of 0.2 %.
    assert!(beyond <= 2, "{beyond} of {SEEDS} beyond three sigmas");
}

#[test]
fn without_its_state_a_lever_arm_is_noticed() {
    assert_noticed(&settings(), with_lever_arm, 0);
}

const OFFSET_S: f64 = 0.05;

fn with_clock_offset(_: u64) -> Scenario {
    let mut scenario = scenario(DURATION_S);
    scenario.gnss.time_offset_s = OFFSET_S;
    scenario
}

#[test]
fn a_clock_offset_is_found() {
    let mut config = settings();
    config.gnss.time_offset_sigma_s = Some(OFFSET_S);
    let (on, ends) = runs(SEEDS, &config, with_clock_offset, |filter, _| {
        let p = covariance(filter, CLOCK_OFFSET);
        let error = OFFSET_S - filter.nominal().calibration.clock_offset;
        (nees(&Vector1::new(error), &p), p[(0, 0)].sqrt())
    });
    println!("on: {on:.3?}");
    assert_consistent(&on);
    let squares: Vec<f64> = ends.iter().map(|e| e.0).collect();
    assert_normal("clock offset", &squares, 1);
    println!("sigma at the end: {:.2} ms", ends[0].1 * 1e3);
    // A fix of 0.5 m at 10 m/s tells 50 ms; six hundred of them and the velocities, well below 3 ms.
    assert!(ends[0].1 < 3e-3, "{}", ends[0].1);
    let beyond = squares.iter().filter(|s| **s > 9.0).count();
    // 0.27 % of drives: one of thirty has a probability of 8 %, two of 0.3 %.
    assert!(beyond <= 1, "{beyond} of {SEEDS} beyond three sigmas");
}

#[test]
fn without_its_state_a_clock_offset_is_noticed() {
    assert_noticed(&settings(), with_clock_offset, 0);
}
