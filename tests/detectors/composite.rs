//! The composite with what tells the speed: engines, roads, creeping, turning.

use crate::unit::{
    Output, RATES, Shaking, Unit, detector, idle, imu, knows_nothing, road, stands, turn, windows,
};
use insnav::sample::{GnssVelocity, Sample};
use insnav::sim::{Source, Stream};
use insnav::solution::Motion;
use insnav::stationary::Belief;
use insnav::time::Time;
use nalgebra::Vector3;

/// Runs a fresh composite and says when it first stood and whether it did at the end.
///
/// `speed`: what GNSS says with its errors, once a second; none: nobody speaks.
fn first_stop(
    mut unit: Unit,
    seed: u64,
    speed: Option<f64>,
    belief: &Belief,
    seconds: f64,
) -> Option<f64> {
    let mut detector = detector();
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
/// and 0.5 s more.
fn share(rate: f64, shaking: Shaking, speed: Option<f64>, belief: &Belief) -> f64 {
    share_of(rate, shaking, Output::Instants, speed, belief, SOON)
}

/// What is left for GNSS is 0.9 s, one objection; s beyond the twenty samples.
const SOON: f64 = 4.1;
/// Time for seven more.
const LATER: f64 = 10.0;

fn share_of(
    rate: f64,
    shaking: Shaking,
    output: Output,
    speed: Option<f64>,
    belief: &Belief,
    within: f64,
) -> f64 {
    let seconds = 20.0 / rate + within;
    let stands = |seed: &u64| {
        let unit = Unit::new(*seed, rate, shaking).giving(output);
        first_stop(unit, *seed, speed, belief, seconds).is_some()
    };
    (0..windows()).filter(stands).count() as f64 / windows() as f64
}

/// One miss in a thousand is the bar: the binomial's upper four sigmas at the windows that were drawn.
fn one_in_a_thousand() -> f64 {
    let n = windows() as f64;
    1e-3 + 4.0 * (1e-3 / n).sqrt()
}

/// At 30 Hz 26.7 Hz come down to a tone of 3.3 Hz, inside the pass band: of full size where samples are instants, an eighth of it
/// where they are means, a fifth behind a low-pass at four tenths of the rate. A tone of an eighth is let through; the others are
/// printed and not held.
#[test]
fn composite_finds_stops_also_with_an_engine_that_idles() {
    println!("share of stops found, by what a sample is: within {SOON} s, within {LATER} s");
    for (name, shaking) in [
        ("quiet", Shaking::default()),
        ("idle 0.5 m/s2 + 0.5 deg/s", idle(0.5, 0.5)),
        ("idle 1 m/s2 + 1 deg/s", idle(1.0, 1.0)),
        ("idle 2 m/s2 + 2 deg/s", idle(2.0, 2.0)),
    ] {
        for rate in RATES {
            let outputs = [Output::Instants, Output::Means, Output::LowPassed];
            // Without an engine there is nothing to average.
            let count = if shaking.is_drawn() { 3 } else { 1 };
            for output in &outputs[..count] {
                let found =
                    |within| share_of(rate, shaking, *output, Some(0.0), &knows_nothing(), within);
                let in_band = rate == 30.0 && shaking.is_drawn();
                let (soon, later) = (found(SOON), in_band.then(|| found(LATER)));
                println!("{name:<28}{rate:>4} Hz  {output:<10?} {soon:.4}  {later:.4?}");
                let held = match (in_band, output) {
                    (false, _) => Some(soon),
                    (true, Output::Means) => Some(soon),
                    (true, Output::Instants | Output::LowPassed) => None,
                };
                if let Some(found) = held {
                    assert!(1.0 - found <= one_in_a_thousand(), "{rate} {name}: {found}");
                }
            }
        }
    }
}

#[test]
fn composite_takes_neither_creeping_nor_turning_nor_roads_for_a_stop() {
    let smooth = road(0.02);
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
        for rms in [0.05, 0.1, 0.3] {
            let shaking = road(rms);
            let stops = share(rate, shaking, Some(10.0), &knows_nothing());
            assert!(stops <= one_in_a_thousand(), "{rate} {rms}: {stops}");
            println!(
                "{rate} Hz, road {rms} m/s2: {stops:.4}; without the speed {:.4}",
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
