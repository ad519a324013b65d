//! Clock offsets on real recordings, against what is known of them.

use insnav::clock_offset::{ClockOffset, Search, imu_offset, imu_offset_by_filter, velocity_lag};
use insnav::config::Config;
use insnav::earth::Geodetic;
use insnav::error::Error;
use insnav::imu::ImuGrade;
use insnav::sample::{GnssPosition, GnssVelocity, ImuSample, Sample};
use insnav::sim::{Leg, Scenario};
use insnav::time::Time;
use nalgebra::Vector3;
use std::io::Read;
use std::path::PathBuf;

/// Samples of a recording in the common CSV, in the order of their stamps; `None`, said visibly, where it is absent.
fn recording(name: &str) -> Option<Vec<Sample>> {
    let root = std::env::var_os("INSNAV_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data")),
        PathBuf::from,
    );
    let folder = root.join(name);
    if !folder.exists() {
        println!("SKIPPED: {} is absent", folder.display());
        return None;
    }
    let rows = |file: &str| {
        let mut text = String::new();
        let compressed = std::fs::File::open(folder.join(file)).expect("the recording is complete");
        flate2::read::GzDecoder::new(compressed)
            .read_to_string(&mut text)
            .expect("gzip text");
        text.lines()
            .skip(1)
            .map(|line| {
                line.split(',')
                    .map(|x| x.parse().expect("a number"))
                    .collect()
            })
            .collect::<Vec<Vec<f64>>>()
    };
    let mut samples = Vec::new();
    for r in rows("imu.csv.gz") {
        samples.push(Sample::Imu(ImuSample {
            time: Time::from_seconds(1e3 + r[0]),
            angular_rate_b: Vector3::new(r[1], r[2], r[3]),
            specific_force_b: Vector3::new(r[4], r[5], r[6]),
        }));
    }
    for r in rows("gnss.csv.gz") {
        let time = Time::from_seconds(1e3 + r[0]);
        let position = Geodetic::from_degrees(r[1], r[2], r[3]);
        samples.push(Sample::GnssPosition(GnssPosition {
            time,
            position,
            covariance_n: None,
        }));
        if r[4].is_finite() {
            let velocity_n = Vector3::new(r[4], r[5], r[6]);
            samples.push(Sample::GnssVelocity(GnssVelocity {
                time,
                velocity_n,
                covariance_n: None,
            }));
        }
    }
    samples.sort_by_key(Sample::time);
    Some(samples)
}

/// The receiver's own velocity output is 0.128 s late (found with another program, and known to be so for this receiver).
#[test]
fn velocity_lag_of_the_rtk_drive() {
    let Some(samples) = recording("rtkexp_drive_0708") else {
        return;
    };
    let found = velocity_lag(&samples, &Search::default()).expect("observable");
    println!("rtkexp_drive_0708: velocity lag {found:?}");
    assert!((found.value - 0.128).abs() < 0.02, "{found:?}");
    assert!(found.sigma < 0.005, "{found:?}");
}

/// Both halves of a recording must tell the same lag, within their sigmas: nothing outside the recording is needed for that.
#[test]
fn velocity_lag_agrees_between_halves() {
    for name in ["rtkexp_drive_0708", "hipnuc_20220504", "comma2k19_example1"] {
        let Some(samples) = recording(name) else {
            continue;
        };
        let whole = velocity_lag(&samples, &Search::default()).expect("observable");
        let (a, b) = samples.split_at(samples.len() / 2);
        let [a, b] = [a, b].map(|half| velocity_lag(half, &Search::default()).expect("observable"));
        println!("{name}: velocity lag {whole:?}, first half {a:?}, second half {b:?}");
        let sigma = a.sigma.hypot(b.sigma);
        assert!(
            (a.value - b.value).abs() < 4.0 * sigma,
            "{name}: {a:?} {b:?}"
        );
    }
}

#[test]
fn a_position_only_receiver_has_no_velocity_lag() {
    let Some(samples) = recording("kth_skog_car") else {
        return;
    };
    assert!(velocity_lag(&samples, &Search::default()).is_err());
}

fn report(name: &str, samples: &[Sample]) -> insnav::error::Result<ClockOffset> {
    let begin = std::time::Instant::now();
    let found = imu_offset(samples, &Vector3::zeros(), &Search::default());
    println!("{name}: IMU offset {found:?} in {:.0?}", begin.elapsed());
    found
}

/// What is known of it: −0.21 ± 0.03 s, by the fit of this log's inertial data to its positions in another program.
#[test]
fn imu_offset_of_the_rtk_drive() {
    let Some(samples) = recording("rtkexp_drive_0708") else {
        return;
    };
    let found = report("rtkexp_drive_0708", &samples).expect("observable");
    assert!((found.value + 0.21).abs() < 0.03, "{found:?}");
    assert!(found.sigma < 0.02, "{found:?}");
}

/// Stamps moved by a known amount must move the estimate by that amount.
#[test]
fn imu_offset_follows_moved_stamps() {
    for name in ["rtkexp_drive_0708", "hipnuc_20220504", "kth_skog_car"] {
        let Some(samples) = recording(name) else {
            continue;
        };
        let first = report(name, &samples).expect("observable");
        // Towards zero, so that it stays within the range.
        let shift = 0.25_f64.copysign(first.value);
        let mut moved: Vec<_> = samples
            .iter()
            .map(|s| {
                if s.is_inertial() {
                    s.delayed(shift)
                } else {
                    *s
                }
            })
            .collect();
        moved.sort_by_key(Sample::time);
        let second = report(name, &moved).expect("observable");
        // The same noise, but other stretches: half a sigma is what cutting the log elsewhere may do.
        let error = second.value - (first.value - shift);
        assert!(
            error.abs() < 0.5 * first.sigma.hypot(second.sigma),
            "{name}: {first:?} {second:?}"
        );
    }
}

/// A minute at steady speed, and a slow robot under fixes of a metre: positions alone tell nothing, and it is said so.
#[test]
fn gentle_motion_is_declared_unobservable() {
    for name in ["comma2k19_example1", "husky_rl_test1"] {
        let Some(samples) = recording(name) else {
            continue;
        };
        assert!(matches!(
            report(name, &samples),
            Err(Error::NotObservable { .. })
        ));
    }
}

fn town_drive(offset: f64) -> Scenario {
    let mut scenario = Scenario::car_drive(300.0);
    scenario.imu.rate_hz = 100.0;
    scenario.gnss.position_rate_hz = 5.0;
    scenario.gnss.velocity_rate_hz = 5.0;
    scenario.gnss.position_sigma_m = [0.3, 0.3, 0.6];
    scenario.gnss.time_offset_s = offset;
    scenario
}

#[test]
fn imu_offset_of_simulated_drives_is_found_with_an_honest_sigma() {
    let mut sum = 0.0;
    let offsets = [-0.35, -0.21, -0.1, 0.0, 0.05, 0.12, 0.2, 0.4];
    for (seed, offset) in (0..).zip(offsets) {
        let samples = town_drive(offset)
            .simulate(seed)
            .expect("valid scenario")
            .samples;
        let found =
            imu_offset(&samples, &Vector3::zeros(), &Search::default()).expect("observable");
        println!("simulated {offset}: {found:?}");
        assert!(found.sigma < 0.05, "{found:?}");
        sum += ((found.value - offset) / found.sigma).powi(2);
    }
    // Chi-square of 8: 0.1 % is above 26.1. A sigma far too large (mean square below 0.1 of it, 0.1 % as well) fails too.
    assert!((0.86..26.1).contains(&sum), "{sum}");
}

#[test]
fn the_velocity_lag_leaves_the_imu_offset_alone_and_the_reverse() {
    let mut scenario = town_drive(-0.21);
    scenario.gnss.velocity_lag_s = 0.128;
    let samples = scenario.simulate(1).expect("valid scenario").samples;
    let offset = imu_offset(&samples, &Vector3::zeros(), &Search::default()).expect("observable");
    let lag = velocity_lag(&samples, &Search::default()).expect("observable");
    println!("simulated: offset {offset:?}, lag {lag:?}");
    assert!(
        (offset.value + 0.21).abs() < 3.3 * offset.sigma,
        "{offset:?}"
    );
    assert!((lag.value - 0.128).abs() < 3.3 * lag.sigma, "{lag:?}");
}

#[test]
fn a_standing_car_tells_no_offset() {
    let mut scenario = Scenario::standing(200.0, 30.0);
    scenario.gnss.position_rate_hz = 5.0;
    let samples = scenario.simulate(3).expect("valid scenario").samples;
    let found = imu_offset(&samples, &Vector3::zeros(), &Search::default());
    assert!(
        matches!(found, Err(Error::NotObservable { .. })),
        "{found:?}"
    );
}

/// With attitude and biases carried through the whole minute, and velocities, the same drive does tell: the reference pose,
/// stamped as the IMU is, meets the GNSS positions best at 0.08 ± 0.02 s (their constant error of 0.3 m at 17 m/s).
#[test]
fn the_filter_finds_the_offset_of_a_short_drive() {
    let Some(samples) = recording("comma2k19_example1") else {
        return;
    };
    let search = Search::default();
    let mut config = Config::default();
    config.gnss.velocity_lag_s = velocity_lag(&samples, &search).expect("observable").value;
    let noise = ImuGrade::Consumer.noise();
    let found = imu_offset_by_filter(&samples, &config, &noise, &search).expect("observable");
    println!("comma2k19_example1 by the filter: {found:?}");
    assert!(
        (found.value - 0.08).abs() < 3.0 * found.sigma.hypot(0.02),
        "{found:?}"
    );
    assert!(found.sigma < 0.02, "{found:?}");
}

/// The drive with fixes of a plain receiver: 1.5 m, 0.05 m/s, once a second.
fn plain_drive(offset: f64) -> Scenario {
    let mut scenario = Scenario::car_drive(300.0);
    scenario.imu.rate_hz = 100.0;
    scenario.gnss.time_offset_s = offset;
    scenario
}

/// After one soft start, bends of at most 15° and changes of speed of 1 m/s.
fn gentle_drive(offset: f64) -> Scenario {
    let mut scenario = plain_drive(offset);
    let leg = |duration_s, speed_m_per_s, turn_deg| Leg {
        duration_s,
        speed_m_per_s,
        turn_deg,
        slope_deg: 0.0,
    };
    scenario.drive.legs = vec![leg(20.0, 0.0, 0.0), leg(20.0, 15.0, 0.0)];
    for (k, turn) in [12.0, -9.0, 7.0, -15.0]
        .into_iter()
        .cycle()
        .take(20)
        .enumerate()
    {
        scenario
            .drive
            .legs
            .push(leg(13.0, 15.0 + 0.5 * (k % 3) as f64, turn));
    }
    scenario
}

fn by_filter(samples: &[Sample], velocity_lag: f64) -> insnav::error::Result<ClockOffset> {
    let mut config = Config::default();
    config.gnss.velocity_lag_s = velocity_lag;
    imu_offset_by_filter(
        samples,
        &config,
        &ImuGrade::Automotive.noise(),
        &Search { range: 1.5 },
    )
}

/// A drive whose clocks differ by so many seconds.
type Drive = fn(f64) -> Scenario;

/// Errors over sigmas of ten simulated drives of five minutes of each kind: sums of their squares, against chi-square of 10 (0.1 % is
/// above 29.6 and 0.1 % below 1.48), and the mean of all thirty, against 3.3 of its standard errors. A filter that is told zero
/// velocities has a mean of −1.4 sigmas on the gentle drives.
#[test]
fn the_filter_finds_simulated_offsets_with_an_honest_sigma() {
    let offsets = [-1.0, -0.3, -0.2, -0.1, 0.0, 0.05, 0.1, 0.2, 0.3, 1.0];
    let kinds: [(&str, Drive, f64); 3] = [
        ("town", town_drive, 0.01),
        ("plain", plain_drive, 0.01),
        ("gentle", gentle_drive, 0.04),
    ];
    let mut total = 0.0;
    for (name, drive, least) in kinds {
        let mut squares = 0.0;
        for (seed, offset) in (40..).zip(offsets) {
            let samples = drive(offset).simulate(seed).unwrap().samples;
            let found = by_filter(&samples, 0.0).expect("observable");
            println!("{name} {offset}: by the filter {found:?}");
            assert!(found.sigma < least, "{name} {offset}: {found:?}");
            let z = (found.value - offset) / found.sigma;
            squares += z * z;
            total += z;
        }
        assert!((1.48..29.6).contains(&squares), "{name}: {squares}");
    }
    assert!(total.abs() < 3.3 * 30f64.sqrt(), "{}", total / 30.0);
}

/// The control of the above: fixes of 1.5 m do not tell 0.2 s without the velocities.
#[test]
fn poor_positions_alone_tell_no_offset() {
    for seed in 40..44 {
        let samples = plain_drive(0.2).simulate(seed).unwrap().samples;
        let found = imu_offset(&samples, &Vector3::zeros(), &Search::default());
        assert!(
            !found.as_ref().is_ok_and(|f| f.sigma < 0.08),
            "{seed}: {found:?}"
        );
    }
}

/// Velocities tell the sum of both offsets.
#[test]
fn a_lag_that_is_not_told_goes_into_the_offset() {
    let mut scenario = plain_drive(-0.2);
    scenario.gnss.velocity_lag_s = 0.1;
    let samples = scenario.simulate(5).expect("valid scenario").samples;
    let told = by_filter(&samples, 0.1).expect("observable");
    let not_told = by_filter(&samples, 0.0).expect("observable");
    assert!((told.value + 0.2).abs() < 3.3 * told.sigma, "{told:?}");
    assert!((not_told.value + 0.1).abs() < 0.02, "{told:?} {not_told:?}");
}

/// What lies outside the range, what stands and what is too noisy is not told as something else.
#[test]
fn the_filter_says_what_it_cannot_tell() {
    let beyond = plain_drive(4.0);
    let mut standing = Scenario::standing(200.0, 30.0);
    standing.imu.rate_hz = 100.0;
    let mut noisy = gentle_drive(0.2);
    noisy.gnss.position_sigma_m = [30.0; 3];
    noisy.gnss.velocity_rate_hz = 0.0;
    for scenario in [beyond, standing, noisy] {
        let samples = scenario.simulate(6).expect("valid scenario").samples;
        let found = by_filter(&samples, 0.0);
        assert!(
            matches!(found, Err(Error::NotObservable { .. })),
            "{found:?}"
        );
    }
}
