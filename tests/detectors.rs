//! Detectors of stops against published probabilities, and what they make of engines, roads, creeping and turning.
//!
//! Models, all added to the unit of the published table (σ_a = 0.08 m/s² and σ_g = 0.5 °/s at 100 Hz, that is 0.008 m/s/√s
//! and 0.05 °/√s, turned into samples of any rate):
//! - idle a + g: sines of 26.7 Hz of these amplitudes on all axes of force and rate, random phases;
//! - road of r: Gaussian noise below 10 Hz (first order) of rms r along Down and half of it along the other two;
//! - creep at v: a GNSS velocity of v north with white errors of 0.1 m/s per axis at 1 Hz, on a road of 0.02 m/s² rms.
//!
//! `INSNAV_LONG=1` takes 20 000 windows a case instead of 2000.

use core::f64::consts::TAU;
use insnav::config::StationaryConfig;
use insnav::imu::{ImuNoise, STANDARD_GRAVITY};
use insnav::sample::{GnssVelocity, ImuSample, Sample, Speed, Standstill};
use insnav::sim::{Source, Stream};
use insnav::solution::Motion;
use insnav::stationary::quantile::ONE_IN_1E3;
use insnav::stationary::{
    Belief, LOOK_AHEAD, Moments, Notice, RestNoise, StopDetector, Witness, are, glrt, mag, mv,
};
use insnav::time::Time;
use nalgebra::{Matrix3, Vector3};

const ACCEL_WHITE: f64 = 0.008;
const GYRO_WHITE: f64 = 0.05 / 180.0 * core::f64::consts::PI;
const IDLE_HZ: f64 = 26.7;
const RATES: [f64; 3] = [30.0, 100.0, 200.0];

fn windows() -> u64 {
    if std::env::var_os("INSNAV_LONG").is_some() {
        20_000
    } else {
        2000
    }
}

/// What moves the unit beside its noise.
#[derive(Clone, Copy, Debug, Default)]
struct Shaking {
    /// Amplitudes, m/s² and rad/s.
    idle: (f64, f64),
    /// Down, rms, m/s².
    road: f64,
    turn: f64,
    accel: f64,
    accel_bias: f64,
    gyro_bias: f64,
}

/// Samples of one run.
struct Unit {
    source: Source,
    rate: f64,
    shaking: Shaking,
    phases: [f64; 6],
    road: Vector3<f64>,
    index: u32,
}

impl Unit {
    fn new(seed: u64, rate: f64, shaking: Shaking) -> Self {
        let mut source = Source::new(seed, Stream::AccelWhite);
        let phases = core::array::from_fn(|_| source.between(0.0, TAU));
        Unit {
            source,
            rate,
            shaking,
            phases,
            road: Vector3::zeros(),
            index: 0,
        }
    }

    /// Time, specific force, rate.
    fn next(&mut self) -> (f64, Vector3<f64>, Vector3<f64>) {
        let s = &self.shaking;
        let t = f64::from(self.index) / self.rate;
        self.index += 1;
        let root = self.rate.sqrt();
        let sine = |k: usize| (TAU * IDLE_HZ * t + self.phases[k]).sin();
        let decay = (-TAU * 10.0 / self.rate).exp();
        let drive = (1.0 - decay * decay).sqrt();
        let along = Vector3::new(0.5, 0.5, 1.0) * s.road;
        let drawn = self.source.normal3();
        let start = if self.index == 1 { 1.0 } else { drive };
        self.road = self.road * decay + drawn.component_mul(&along) * start;
        let force = Vector3::new(s.accel, 0.0, -STANDARD_GRAVITY) - Vector3::z() * s.accel_bias
            + self.source.normal3() * (ACCEL_WHITE * root)
            + Vector3::from_fn(|k, _| s.idle.0 * sine(k))
            + self.road;
        let rate = self.source.normal3() * (GYRO_WHITE * root)
            + Vector3::from_fn(|k, _| s.idle.1 * sine(k + 3))
            + Vector3::repeat(s.gyro_bias)
            + Vector3::z() * s.turn;
        (t, force, rate)
    }
}

fn idle(force: f64, deg_per_s: f64) -> Shaking {
    Shaking {
        idle: (force, deg_per_s.to_radians()),
        ..Shaking::default()
    }
}

fn turn(deg_per_s: f64) -> Shaking {
    Shaking {
        turn: deg_per_s.to_radians(),
        ..Shaking::default()
    }
}

/// What the table's unit leaves of its biases: 0.08 m/s² along gravity (across it adds its square over 2 g, which no threshold
/// knows of) and, per axis, 0.0412 °/s.
const ACCEL_BIAS: f64 = 0.08;
const GYRO_BIAS: f64 = 0.0412 / 180.0 * core::f64::consts::PI;

fn imu_noise() -> ImuNoise {
    ImuNoise {
        gyro_white: GYRO_WHITE,
        accel_white: ACCEL_WHITE,
        gyro_bias_sigma: 7e-4,
        accel_bias_sigma: ACCEL_BIAS,
        gyro_bias_tau: 1e4,
        accel_bias_tau: 1e4,
    }
}

fn rest_noise() -> RestNoise {
    let mut noise = RestNoise::new(&StationaryConfig::default(), false, &imu_noise());
    // Without what gravity differs by from place to place: the study's does not.
    noise.accel_bias = ACCEL_BIAS;
    noise
}

fn window_of(seed: u64, rate: f64, seconds: f64, shaking: Shaking) -> Moments {
    let with_biases = Shaking {
        accel_bias: ACCEL_BIAS,
        gyro_bias: GYRO_BIAS,
        ..shaking
    };
    let mut unit = Unit::new(seed, rate, with_biases);
    let mut m = Moments::default();
    for _ in 0..(rate * seconds).round() as u32 {
        let (_, force, rate_b) = unit.next();
        m.push(1.0 / rate, &force, &rate_b);
    }
    m
}

/// T over the threshold for MV, MAG, ARE, GLRT.
fn ratios(m: &Moments) -> [f64; 4] {
    let noise = rest_noise();
    let (expected, variance) = (Vector3::zeros(), 3.0 * GYRO_BIAS * GYRO_BIAS);
    [
        mv::statistic(m, &noise) / mv::threshold(m, ONE_IN_1E3),
        mag::statistic(m, &noise) / mag::threshold(m, &noise, ONE_IN_1E3),
        are::statistic(m, &expected, &noise) / are::threshold(m, variance, &noise, ONE_IN_1E3),
        glrt::statistic(m, &expected, &noise) / glrt::threshold(m, variance, &noise, ONE_IN_1E3),
    ]
}

/// Thresholds of the study for N = 10, 50, 100, 200 samples at 100 Hz: MV, MAG, ARE, GLRT. Two digits, found by simulation.
#[test]
fn thresholds_are_the_published_ones() {
    let published = [
        (10.0, [5.5, 5.3, 6.0, 11.5]),
        (50.0, [4.1, 3.4, 4.2, 9.0]),
        (100.0, [3.8, 2.9, 3.9, 8.4]),
        (200.0, [3.6, 2.7, 3.6, 8.0]),
    ];
    let noise = rest_noise();
    let variance = 3.0 * GYRO_BIAS * GYRO_BIAS;
    for (count, expected) in published {
        let m = Moments {
            count,
            span: count / 100.0,
            ..Moments::default()
        };
        let found = [
            mv::threshold(&m, ONE_IN_1E3),
            mag::threshold(&m, &noise, ONE_IN_1E3),
            are::threshold(&m, variance, &noise, ONE_IN_1E3),
            glrt::threshold(&m, variance, &noise, ONE_IN_1E3),
        ];
        println!("N = {count}: {found:.2?} published {expected:?}");
        for (found, expected) in found.into_iter().zip(expected) {
            // Half a digit, and what biases drawn anew for each of their runs do to a quantile.
            assert!(
                (found / expected - 1.0).abs() < 0.06,
                "{count}: {found} {expected}"
            );
        }
    }
}

/// At rest one window in a thousand is above, whatever the sampling rate.
#[test]
fn at_rest_one_window_in_a_thousand_is_above() {
    for rate in RATES {
        let mut above = [0.0; 4];
        for seed in 0..windows() {
            for (above, ratio) in
                above
                    .iter_mut()
                    .zip(ratios(&window_of(seed, rate, 2.0, Shaking::default())))
            {
                *above += f64::from(u8::from(ratio > 1.0));
            }
        }
        let expected = 1e-3 * windows() as f64;
        println!(
            "{rate} Hz, MV MAG ARE GLRT above: {above:?} of {}, {expected} expected",
            windows()
        );
        for above in above {
            // Poisson, four sigmas, and a tenth for the chi-squares that stand in for the true distributions.
            assert!(
                (above - expected).abs() < 4.0 * expected.sqrt() + 0.1 * expected,
                "{above}"
            );
        }
    }
}

/// The study's table at N = 100 and 100 Hz. Its thresholds have two digits: the probability must lie between those for a
/// threshold 3 % lower and 3 % higher, give or take four standard errors and half a digit.
#[test]
fn published_probabilities_come_out() {
    let accel = Shaking {
        accel: 0.3,
        ..Shaking::default()
    };
    let table = [
        (
            "idle 0.2 m/s2 + 0.2 deg/s",
            idle(0.2, 0.2),
            [0.0, 0.0, 0.98, 0.0],
        ),
        (
            "idle 0.5 m/s2 + 0.5 deg/s",
            idle(0.5, 0.5),
            [0.0, 0.0, 0.03, 0.0],
        ),
        ("turn 1 deg/s", turn(1.0), [1.0, 1.0, 0.0, 0.0]),
        ("turn 0.3 deg/s", turn(0.3), [1.0, 1.0, 0.96, 0.99]),
        ("accel 0.3 m/s2", accel, [1.0, 0.995, 1.0, 1.0]),
    ];
    for (name, shaking, published) in table {
        let mut below = [[0.0; 3]; 4];
        for seed in 0..windows() {
            for (below, ratio) in below
                .iter_mut()
                .zip(ratios(&window_of(seed, 100.0, 1.0, shaking)))
            {
                for (below, limit) in below.iter_mut().zip([0.97, 1.0, 1.03]) {
                    *below += f64::from(u8::from(ratio < limit)) / windows() as f64;
                }
            }
        }
        println!(
            "{name}: {:.3?} published {published:?}",
            below.map(|b| b[1])
        );
        for ([low, middle, high], published) in below.into_iter().zip(published) {
            let error = 4.0 * (middle * (1.0 - middle) / windows() as f64).sqrt() + 0.006;
            assert!(
                low - error <= published && published <= high + error,
                "{name}: {low} {high} {published}"
            );
        }
    }
}

fn knows_nothing() -> Belief {
    Belief {
        rate_b: Vector3::zeros(),
        // 0.007 °/s: a gyro bias as the filter knows it after a minute of standing.
        rate_covariance_b: Matrix3::from_diagonal_element(0.007f64.to_radians().powi(2)),
        velocity_n: Vector3::zeros(),
        velocity_covariance_n: Matrix3::from_diagonal_element(100.0),
    }
}

fn stands() -> Belief {
    Belief {
        velocity_covariance_n: Matrix3::from_diagonal_element(0.01 * 0.01),
        ..knows_nothing()
    }
}

fn detector() -> StopDetector {
    StopDetector::new(&StationaryConfig::default(), &imu_noise())
}

fn imu(t: f64, force: Vector3<f64>, rate: Vector3<f64>) -> Sample {
    Sample::Imu(ImuSample {
        time: Time::from_seconds(t),
        angular_rate_b: rate,
        specific_force_b: force,
    })
}

/// Runs a fresh composite and says when it first stood and whether it did at the end.
///
/// `speed`: what GNSS says with its errors, once a second; none: nobody speaks.
fn first_stop(
    seed: u64,
    rate: f64,
    shaking: Shaking,
    speed: Option<f64>,
    belief: &Belief,
    seconds: f64,
) -> Option<f64> {
    let mut detector = detector();
    let mut unit = Unit::new(seed, rate, shaking);
    let mut gnss = Source::new(seed, Stream::VelocityWhite);
    let mut next_fix = gnss.between(-1.0, 0.0);
    loop {
        let (t, force, rate_b) = unit.next();
        if t > seconds {
            return None;
        }
        while speed.is_some() && next_fix <= t {
            let error = gnss.normal3() * 0.1;
            let fix = GnssVelocity {
                time: Time::from_seconds(next_fix),
                velocity_n: Vector3::x() * speed.unwrap_or_default() + error,
                covariance_n: None,
            };
            detector.observe(&Sample::GnssVelocity(fix), belief);
            next_fix += 1.0;
        }
        detector.observe(&imu(t, force, rate_b), belief);
        // What the filter would be told, half a second behind.
        if detector.motion() != Motion::Moving {
            return Some(t);
        }
    }
}

/// Share of runs with a stop. One verdict needs 20 samples for the rate, 0.6 s until the low-pass has settled, a window of 2 s
/// and 0.5 s more; the rest is for GNSS to object once.
fn share(rate: f64, shaking: Shaking, speed: Option<f64>, belief: &Belief) -> f64 {
    let seconds = 20.0 / rate + 4.1;
    let stops = (0..windows())
        .filter(|seed| first_stop(*seed, rate, shaking, speed, belief, seconds).is_some())
        .count();
    stops as f64 / windows() as f64
}

/// One miss in a thousand is the bar: the binomial's upper four sigmas at the windows that were drawn.
fn one_in_a_thousand() -> f64 {
    let n = windows() as f64;
    1e-3 + 4.0 * (1e-3 / n).sqrt()
}

#[test]
fn composite_finds_stops_also_with_an_engine_that_idles() {
    for rate in RATES {
        for (name, shaking) in [
            ("quiet", Shaking::default()),
            ("idle 0.5 + 0.5", idle(0.5, 0.5)),
            ("idle 2 + 2", idle(2.0, 2.0)),
        ] {
            let found = share(rate, shaking, Some(0.0), &knows_nothing());
            println!("{rate} Hz, {name}: found {found:.4}");
            // 26.7 Hz sampled at 30 Hz is 3.3 Hz: inside the pass band, nobody can tell it from motion. See below.
            if rate > 2.0 * IDLE_HZ || shaking.idle.0 == 0.0 {
                assert!(1.0 - found <= one_in_a_thousand(), "{rate} {name}: {found}");
            }
        }
    }
}

/// Vibration above half the sampling rate comes down into the pass band. Where GNSS or wheels have confirmed a stop for long
/// enough, its level is learnt, and later stops are found; the first is not.
#[test]
fn an_engine_that_aliases_is_learnt_from_confirmed_stops() {
    let shaking = idle(0.3, 0.3);
    let (mut first, mut later) = (0, 0);
    let runs = 50;
    for seed in 0..runs {
        let mut detector = detector();
        let mut unit = Unit::new(seed, 30.0, shaking);
        let mut gnss = Source::new(seed, Stream::VelocityWhite);
        // GNSS of 0.03 m/s: stands until 40 s, drives until 60 s, stands.
        let (mut fixes, mut stood) = (0, [false; 2]);
        loop {
            let (t, force, rate_b) = unit.next();
            if t > 70.0 {
                break;
            }
            let driving = (40.0..60.0).contains(&t);
            while f64::from(fixes) <= t {
                let fix = GnssVelocity {
                    time: Time::from_seconds(f64::from(fixes)),
                    velocity_n: Vector3::x() * if driving { 10.0 } else { 0.0 }
                        + gnss.normal3() * 0.03,
                    covariance_n: None,
                };
                detector.observe(&Sample::GnssVelocity(fix), &knows_nothing());
                fixes += 1;
            }
            detector.observe(&imu(t, force, rate_b), &knows_nothing());
            let stands = detector.motion() != Motion::Moving;
            assert!(
                !(stands && (42.0..60.0).contains(&t)),
                "standing under way at {t}"
            );
            stood[0] |= stands && t < 10.0;
            stood[1] |= stands && t > 60.0;
        }
        first += u64::from(stood[0]);
        later += u64::from(stood[1]);
    }
    println!(
        "30 Hz, idle 0.3 m/s2 + 0.3 deg/s: found at once in {first}, after learning in {later} of {runs}"
    );
    assert!(later >= runs - 1);
}

#[test]
fn composite_takes_neither_creeping_nor_turning_nor_roads_for_a_stop() {
    let smooth = Shaking {
        road: 0.02,
        ..Shaking::default()
    };
    for rate in RATES {
        for speed in [0.5, 1.0] {
            let stops = share(rate, smooth, Some(speed), &knows_nothing());
            println!("{rate} Hz, creep at {speed} m/s: {stops:.4}");
            assert!(stops <= one_in_a_thousand(), "{rate} {speed}: {stops}");
        }
        println!(
            "{rate} Hz, creep at 0.3 m/s: {:.4}",
            share(rate, smooth, Some(0.3), &knows_nothing())
        );
        let stops = share(rate, turn(0.3), Some(0.0), &knows_nothing());
        println!("{rate} Hz, turn at 0.3 deg/s: {stops:.4}");
        assert!(stops <= one_in_a_thousand(), "{rate}: {stops}");
        for road in [0.05, 0.1, 0.3] {
            let shaking = Shaking {
                road,
                ..Shaking::default()
            };
            let stops = share(rate, shaking, Some(10.0), &knows_nothing());
            assert!(stops <= one_in_a_thousand(), "{rate} {road}: {stops}");
            println!(
                "{rate} Hz, road {road} m/s2: {stops:.4}; without the speed {:.4}",
                share(rate, shaking, None, &stands())
            );
        }
    }
    // Without GNSS the inertial tests alone would take a smooth road for a stop: it is the speed that decides.
    let alone = share(100.0, smooth, None, &stands());
    assert!(alone > 0.9, "{alone}");
    // And a filter that does not know its speed is no witness.
    assert_eq!(share(100.0, smooth, None, &knows_nothing()), 0.0);
}

/// A drive by what it does, second by second, through one detector; tells what the filter would be told.
struct Drive {
    detector: StopDetector,
    belief: Belief,
    source: Source,
    t: f64,
    told: Vec<(f64, Motion)>,
}

impl Drive {
    fn new() -> Self {
        Drive {
            detector: detector(),
            belief: stands(),
            source: Source::new(7, Stream::AccelWhite),
            t: 0.0,
            told: Vec::new(),
        }
    }

    fn go(&mut self, seconds: f64, force: Vector3<f64>, rate: Vector3<f64>) -> &mut Self {
        let end = self.t + seconds;
        while self.t < end - 1e-9 {
            self.t += 0.01;
            let force = force - Vector3::z() * STANDARD_GRAVITY + self.source.normal3() * 0.08;
            let rate = rate + self.source.normal3() * (0.5f64).to_radians();
            self.detector
                .observe(&imu(self.t, force, rate), &self.belief);
            let at = self.t - LOOK_AHEAD;
            self.told
                .push((at, self.detector.advance(Time::from_seconds(at))));
        }
        self
    }

    fn rest(&mut self, seconds: f64) -> &mut Self {
        self.go(seconds, Vector3::zeros(), Vector3::zeros())
    }

    fn says(&mut self, sample: Sample) -> &mut Self {
        self.detector.observe(&sample, &self.belief);
        self
    }

    /// Spans of standing as the filter is told them.
    fn stops(&self) -> Vec<(f64, f64)> {
        let mut stops: Vec<(f64, f64)> = Vec::new();
        let mut open = false;
        for (at, motion) in &self.told {
            let stands = *motion != Motion::Moving;
            match (stands, open) {
                (true, false) => stops.push((*at, *at)),
                (true, true) => stops.last_mut().expect("one is open").1 = *at,
                _ => {}
            }
            open = stands;
        }
        stops
    }
}

#[test]
fn a_start_is_seen_before_the_filter_comes_to_it() {
    // Gentle to brisk; a curb that tilts, a turn on the spot.
    for (force, rate) in [
        (Vector3::x() * 0.7, Vector3::zeros()),
        (Vector3::x() * 2.0, Vector3::zeros()),
        (Vector3::zeros(), Vector3::z() * 0.1),
    ] {
        let mut drive = Drive::new();
        drive.rest(20.0).go(1.0, force, rate);
        // By then the filter knows; a constant acceleration is no motion to an inertial unit alone.
        drive.belief.velocity_n = Vector3::new(2.0, 0.0, 0.0);
        drive.go(4.0, force, rate);
        let stops = drive.stops();
        assert_eq!(stops.len(), 1, "{stops:?}");
        println!("{force:?} {rate:?}: {stops:?}");
        assert!(stops[0].1 < 20.0, "the filter saw motion: {stops:?}");
        assert!(stops[0].1 > 19.0, "{stops:?}");
        let since = drive
            .told
            .iter()
            .find(|t| t.1 != Motion::Moving)
            .expect("a stop")
            .1;
        assert!(matches!(since, Motion::Stationary { since } if since < Time::from_seconds(1.5)));
    }
}

/// 3° in 15 s: too little for any variance, plain against the bias.
#[test]
fn a_slow_true_turn_ends_a_stop() {
    let mut drive = Drive::new();
    drive
        .rest(20.0)
        .go(15.0, Vector3::zeros(), Vector3::z() * 0.2f64.to_radians())
        .rest(10.0);
    let stops = drive.stops();
    println!("turn from 20 to 35 s: {stops:?}");
    let turning: f64 = stops
        .iter()
        .map(|(a, b)| (b.min(35.0) - a.max(20.0)).max(0.0))
        .sum();
    // It takes up to a window for the mean to show it.
    assert!(turning < 2.0, "{stops:?}");
    assert!(stops.last().is_some_and(|s| s.1 > 44.0), "{stops:?}");
}

/// A person gets in: 2°.
#[test]
fn a_tilt_in_mid_stop_ends_it_and_another_follows() {
    let mut drive = Drive::new();
    drive
        .rest(20.0)
        .go(20.0, Vector3::x() * 0.342, Vector3::zeros());
    let stops = drive.stops();
    println!("tilt at 20 s: {stops:?}");
    assert_eq!(stops.len(), 2, "{stops:?}");
    assert!(stops[0].1 < 20.05 && stops[1].0 < 24.0, "{stops:?}");
}

#[test]
fn a_hole_in_the_inertial_data_ends_a_stop() {
    let mut drive = Drive::new();
    drive.rest(20.0);
    drive.t += 0.3;
    drive.rest(10.0);
    let stops = drive.stops();
    assert_eq!(stops.len(), 2, "{stops:?}");
    assert!(stops[0].1 <= 20.0 && stops[1].0 > 21.0, "{stops:?}");
    // 0.1 s are none.
    let mut drive = Drive::new();
    drive.rest(20.0);
    drive.t += 0.1;
    drive.rest(10.0);
    assert_eq!(drive.stops().len(), 1);
}

#[test]
fn gnss_and_wheels_end_a_stop_and_an_outage_does_not() {
    let fix = |t: f64, north: f64| {
        Sample::GnssVelocity(GnssVelocity {
            time: Time::from_seconds(t),
            velocity_n: Vector3::new(north, 0.01 * t.sin(), 0.0),
            covariance_n: None,
        })
    };
    let wheels = |t: f64, speed: f64| {
        Sample::Speed(Speed {
            time: Time::from_seconds(t),
            speed,
        })
    };
    for by_wheels in [false, true] {
        let mut drive = Drive::new();
        let say = |t: f64, v: f64| if by_wheels { wheels(t, v) } else { fix(t, v) };
        for i in 0..10 {
            drive.says(say(f64::from(i), 0.0)).rest(1.0);
        }
        // The filter knows nothing any more, and nobody speaks.
        drive.belief = knows_nothing();
        drive.rest(20.0);
        assert_eq!(drive.stops().len(), 1, "{:?}", drive.stops());
        assert!(drive.stops()[0].1 > 29.0);
        // Smooth motion that no inertial unit sees.
        for i in 30..40 {
            drive.says(say(f64::from(i), 0.6)).rest(1.0);
        }
        let stops = drive.stops();
        println!("moves from 30 s: {stops:?}");
        assert_eq!(stops.len(), 1);
        assert!(stops[0].1 < 30.1, "{stops:?}");
    }
}

fn configured(config: StationaryConfig) -> Drive {
    let mut drive = Drive::new();
    drive.detector = StopDetector::new(&config, &imu_noise());
    drive.detector.set_origin(Time(0));
    drive
}

fn declared_only(intervals: &[[f64; 2]]) -> Drive {
    configured(StationaryConfig {
        detector: insnav::config::DetectorKind::None,
        intervals_s: insnav::config::Intervals::new(intervals).expect("few"),
        ..StationaryConfig::default()
    })
}

fn topic(t: f64, standing: bool) -> Sample {
    Sample::Standstill(Standstill {
        time: Time::from_seconds(t),
        standing,
    })
}

#[test]
fn declared_intervals_hold_to_the_sample() {
    let mut drive = declared_only(&[[2.0, 5.0], [5.5, 7.25]]);
    drive.rest(10.0);
    let stops = drive.stops();
    // At the end itself it moves.
    let expected = [(2.0, 4.99), (5.5, 7.24)];
    assert_eq!(stops.len(), 2, "{stops:?}");
    for (found, expected) in stops.iter().zip(expected) {
        assert!(
            (found.0 - expected.0).abs() < 1e-6 && (found.1 - expected.1).abs() < 1e-6,
            "{stops:?}"
        );
    }
    assert_eq!(drive.detector.take_notice(), None);
}

#[test]
fn a_topic_holds_to_its_ends_and_flaps_are_told() {
    let mut drive = declared_only(&[]);
    drive
        .rest(3.0)
        .says(topic(3.0, true))
        .rest(2.0)
        .says(topic(5.0, false))
        .rest(0.2);
    drive
        .says(topic(5.2, true))
        .rest(0.3)
        .says(topic(5.5, false))
        .rest(3.0);
    let stops = drive.stops();
    assert_eq!(stops.len(), 1, "{stops:?}");
    assert!(
        (stops[0].0 - 3.0).abs() < 1e-6 && (stops[0].1 - 4.99).abs() < 1e-6,
        "{stops:?}"
    );
    let time = Time::from_seconds(5.5);
    assert_eq!(drive.detector.take_notice(), Some(Notice::Flaps { time }));
    assert_eq!(drive.detector.take_notice(), None);
}

#[test]
fn a_declaration_that_the_filter_contradicts_is_told_and_not_used() {
    let moving = Belief {
        velocity_n: Vector3::new(8.0, 0.0, 0.0),
        ..stands()
    };
    let mut drive = declared_only(&[[2.0, 5.0]]);
    drive.belief = moving;
    drive.rest(8.0).says(topic(8.0, true)).rest(3.0);
    assert!(drive.stops().is_empty(), "{:?}", drive.stops());
    for begin in [2.0, 8.0] {
        let notice = drive.detector.take_notice();
        assert!(
            matches!(notice, Some(Notice::Contradicted { time, nis }) if time == Time::from_seconds(begin) && nis > 16.3),
            "{notice:?}"
        );
    }
    // The control: a filter that does not know its speed has nothing to say against it.
    let mut drive = declared_only(&[[2.0, 5.0]]);
    drive.belief = knows_nothing();
    drive.rest(8.0);
    assert_eq!(drive.stops().len(), 1);
}

/// A hole also separates two parts of a declared stop; and a topic that says "moving" forbids the detector nothing.
#[test]
fn declarations_and_the_detector_go_together() {
    let mut drive = declared_only(&[[2.0, 12.0]]);
    drive.rest(6.0);
    drive.t += 0.5;
    drive.rest(8.0);
    assert_eq!(drive.stops().len(), 2, "{:?}", drive.stops());
    let mut drive = configured(StationaryConfig::default());
    drive.says(topic(0.0, false)).rest(10.0);
    assert_eq!(drive.stops().len(), 1);
    assert_eq!(drive.detector.evidence().witness, Witness::Detector);
    // Wheels that turn overrule a topic.
    let mut drive = declared_only(&[]);
    drive.says(topic(0.0, true));
    for i in 0..50 {
        let time = Time::from_seconds(0.1 * f64::from(i));
        drive
            .says(Sample::Speed(Speed { time, speed: 1.0 }))
            .rest(0.1);
    }
    assert!(drive.stops().is_empty());
}

/// Stances of 0.3 s between swings: each is told where it is, although the look ahead is longer than a stance.
#[test]
fn stances_of_a_foot_are_told_where_they_are() {
    let config = StationaryConfig::default().for_vehicle(insnav::config::VehicleKind::Foot);
    let mut drive = configured(config);
    for _ in 0..20 {
        drive.rest(0.3);
        for k in 0..30 {
            let phase = TAU * f64::from(k) / 30.0;
            drive.go(
                0.01,
                Vector3::new(15.0 * phase.sin(), 0.0, 8.0 * phase.cos()),
                Vector3::y() * 5.0 * phase.cos(),
            );
        }
    }
    drive.rest(1.0);
    let stops = drive.stops();
    println!("{stops:.2?}");
    // All but the first, in which the sampling rate is still unknown.
    assert!(stops.len() >= 20, "{}", stops.len());
    for (begin, end) in &stops {
        let step = ((begin + 0.01) / 0.6).floor() * 0.6;
        // Rest ends 0.3 s into each cycle of 0.6 s; a swing's first sample is still slow.
        assert!(end - step < 0.33 || *begin > 11.9, "{begin} {end}");
        assert!(end - begin > 0.15 || *begin > 11.9, "{begin} {end}");
    }
}

/// Saved in mid-stop, read back, the same to the last bit.
#[test]
fn a_saved_detector_goes_on_bit_for_bit() {
    let mut drive = Drive::new();
    drive.rest(1.7);
    let bytes = |detector: &StopDetector| postcard::to_stdvec(detector).expect("plain data");
    let saved = bytes(&drive.detector);
    println!("{} bytes", saved.len());
    let again: StopDetector = postcard::from_bytes(&saved).expect("what was written");
    assert_eq!(bytes(&again), saved);
    let mut other = Drive {
        detector: again,
        told: Vec::new(),
        source: drive.source.clone(),
        ..Drive::new()
    };
    other.t = drive.t;
    drive.told.clear();
    drive.rest(10.0);
    other.rest(10.0);
    // The bytes, since a NaN equals nothing.
    assert_eq!(bytes(&drive.detector), bytes(&other.detector));
    assert_eq!(drive.told, other.told);
}
