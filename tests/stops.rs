//! What the navigator makes of stops: declared ones, so that nothing depends on a detector here.

mod at_rest;

use at_rest::{AtRest, BEGIN, RATE, Record, declared, run, sigma, still};
use insnav::config::{Config, DetectorKind, StationaryMode};
use insnav::filter::InitialSigma;
use insnav::imu::{ImuErrors, ImuGrade};
use insnav::navigator::Navigator;
use insnav::sample::{GnssVelocity, Sample};
use insnav::sim::{Source, Stream};
use insnav::solution::{Epoch, Event, Motion, Sink};
use insnav::stationary::StopEnd;
use insnav::time::Time;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Every mode: the stop is labelled and recorded, the heading does not walk, the biases are learnt.
#[test]
fn every_mode_holds_what_it_says() {
    for mode in [
        StationaryMode::Zupt,
        StationaryMode::Zihr,
        StationaryMode::HeadingHold,
        StationaryMode::AttitudeHold,
        StationaryMode::Static,
    ] {
        let body = still(7);
        let config = declared(mode, &[[10.0, 100.0]]);
        let record = run(&config, body.nav(), &sigma(1.0), &body.samples(120.0, 1.0));
        let [stop] = record.stops[..] else {
            panic!("{mode:?}: {} stops", record.stops.len());
        };
        assert_eq!(
            (stop.begin, stop.ended_by),
            (BEGIN.plus(10.0), StopEnd::Withdrawn)
        );
        // From sample to sample, both ends included.
        let length = stop.end.since(stop.held_from);
        assert!((89.9..=90.02).contains(&length), "{mode:?}: {length}");
        let standing = record.epochs.iter().filter(|e| e.motion != Motion::Moving);
        assert_eq!(
            standing.count(),
            (length * RATE).round() as usize,
            "{mode:?}"
        );
        let holds = mode != StationaryMode::Zupt;
        let growth = stop.heading_growth.to_degrees();
        let bias = (stop.gyro_bias - body.errors.gyro_bias).z.abs() / stop.sigma_gyro_bias.z;
        assert!(bias < 4.0, "{mode:?}: {bias} sigmas");
        let learnt = stop.sigma_gyro_bias.z / sigma(1.0).gyro_bias.z;
        // 0.15 °/√h over 90 s is 0.95 °/h, of 30.
        assert_eq!(learnt < 0.1, holds, "{mode:?}: {learnt}");
        if mode == StationaryMode::Static {
            assert_eq!(growth, 0.0);
            let last = record.epochs.iter().rfind(|e| e.motion != Motion::Moving);
            assert_eq!(last.expect("it stood").nav.velocity_n, Vector3::zeros());
        }
        if holds {
            // Known to a degree before, and nothing was learnt of it.
            let (before, after) = (stop.sigma_heading_before, stop.sigma_heading_after);
            assert!(
                (after / before - 1.0).abs() < 0.02,
                "{mode:?} {before} {after}"
            );
        }
    }
}

/// A body at rest does not show its heading. With the measured force in the dynamics a filter believes that it does.
#[test]
fn standing_tells_no_heading() {
    let body = still(3);
    let samples = body.samples(120.0, 1.0);
    let sigma_at_end = |mode, intervals: &[[f64; 2]]| {
        let record = run(
            &declared(mode, intervals),
            body.nav(),
            &sigma(100.0),
            &samples,
        );
        record.epochs[record.epochs.len() - 1]
            .heading_sigma()
            .to_degrees()
    };
    let known = sigma_at_end(StationaryMode::Static, &[[0.0, 120.0]]);
    assert!(known > 95.0, "{known}°");
    // The control.
    let falsely = sigma_at_end(StationaryMode::Off, &[]);
    assert!(falsely < 80.0, "{falsely}°");
}

/// Somebody gets in: two degrees of roll within a second, in mid-stop. The attitude follows.
#[test]
fn a_tilt_in_mid_stop_is_followed_and_never_fought() {
    let still = still(5);
    let smooth = |x: f64| {
        let x = x.clamp(0.0, 1.0);
        x * x * (3.0 - 2.0 * x)
    };
    let body = AtRest {
        attitude_deg: move |t: f64| [1.0 + 2.0 * smooth(t - 60.3), -2.0, 130.0],
        errors: still.errors,
        noise: still.noise,
        gyro_step: 0.0,
        seed: 5,
    };
    let samples = body.samples(120.0, 1.0);
    for mode in [
        StationaryMode::Static,
        StationaryMode::Zupt,
        StationaryMode::Zihr,
        StationaryMode::HeadingHold,
        StationaryMode::AttitudeHold,
    ] {
        let config = declared(mode, &[[5.0, 115.0]]);
        let record = run(&config, body.nav(), &sigma(1.0), &samples);
        let [stop] = record.stops[..] else {
            panic!("{mode:?}: {} stops", record.stops.len());
        };
        // A held attitude cannot follow: its stop ends. All others go on.
        match mode {
            StationaryMode::AttitudeHold => {
                assert_eq!(stop.ended_by, StopEnd::Contradicted);
                let end = stop.end.since(BEGIN);
                assert!((60.3..61.3).contains(&end), "{end}");
            }
            _ => assert_eq!(stop.ended_by, StopEnd::Withdrawn, "{mode:?}"),
        }
        for epoch in record
            .epochs
            .iter()
            .filter(|e| e.nav.time.since(BEGIN) > 65.0)
        {
            let t = epoch.nav.time.since(BEGIN);
            let error = (epoch.nav.q_nb * body.q_nb(t).inverse()).scaled_axis();
            let p = epoch.attitude_covariance_n();
            for axis in 0..3 {
                let sigmas = error[axis].abs() / p[(axis, axis)].sqrt();
                assert!(sigmas < 4.5, "{mode:?} axis {axis} at {t}: {sigmas} sigmas");
            }
            // What was held before is not lost: the roll has 0.07° about Down in it, which a held heading does not take. (A
            // heading that is not held goes 0.2° with its bias of 30 °/h.)
            let down = error.z.to_degrees().abs();
            let free = matches!(mode, StationaryMode::Zupt | StationaryMode::AttitudeHold);
            assert!(free || down < 0.15, "{mode:?} at {t}: {down}°");
        }
    }
}

/// A gap in a stop ends it.
#[test]
fn a_gap_ends_a_stop() {
    let body = still(2);
    let mut samples = body.samples(60.0, 1.0);
    samples.retain(|s| !(30.0..31.0).contains(&s.time().since(BEGIN)));
    let config = declared(StationaryMode::Static, &[[5.0, 55.0]]);
    let record = run(&config, body.nav(), &sigma(1.0), &samples);
    assert_eq!(record.stops[0].ended_by, StopEnd::Gap);
    let end = record.stops[0].end.since(BEGIN);
    assert!((29.9..=30.0).contains(&end), "{end}");
}

/// P stays positive semidefinite in every mode and with every gain and bookkeeping, into a stop, through a tilt by which its
/// static means are taken back, through a gap, and out, with states for the receiver's correlated errors open beside it.
#[test]
fn the_covariance_stays_positive_in_every_mode() {
    use insnav::config::{Bookkeeping, ColourConfig, HeadingRateGain, HeadingRow, StandingForce};
    let still = still(6);
    let body = AtRest {
        attitude_deg: |t: f64| [1.0 + 2.0 * (t - 12.0).clamp(0.0, 1.0), -2.0, 130.0],
        errors: still.errors,
        noise: still.noise,
        gyro_step: 0.0,
        seed: 6,
    };
    let mut samples = body.samples(30.0, 1.0);
    samples.retain(|s| !(20.0..20.5).contains(&s.time().since(BEGIN)));
    let mut cases = Vec::new();
    for mode in [
        StationaryMode::Off,
        StationaryMode::Zupt,
        StationaryMode::Zihr,
        StationaryMode::HeadingHold,
        StationaryMode::AttitudeHold,
        StationaryMode::Static,
    ] {
        cases.push(declared(mode, &[[5.0, 26.0]]));
    }
    let zihr = declared(StationaryMode::Zihr, &[[5.0, 26.0]]);
    for gain in [HeadingRateGain::BiasOnly, HeadingRateGain::Naive] {
        let mut config = zihr;
        config.stationary.heading_rate = gain;
        cases.push(config);
    }
    let mut hold = declared(StationaryMode::HeadingHold, &[[5.0, 26.0]]);
    hold.stationary.bookkeeping = Bookkeeping::VarianceOnly;
    cases.push(hold);
    hold.stationary.force = StandingForce::Measured;
    hold.stationary.heading_row = HeadingRow::Euler;
    cases.push(hold);
    for mut config in cases {
        config.gnss.colour = Some(ColourConfig {
            sigma_m: 1.0,
            vertical_sigma_m: None,
            tau_s: 30.0,
        });
        let stops = &config.stationary;
        let name = (stops.mode, stops.heading_rate, stops.bookkeeping);
        let noise = ImuGrade::Industrial.noise();
        let mut navigator = Navigator::aligned(
            &config,
            noise,
            body.nav(),
            ImuErrors::default(),
            &sigma(1.0),
        )
        .expect("good settings");
        let (mut worst, mut control, mut open) = (1.0_f64, 1.0_f64, 0);
        for (i, sample) in samples.iter().enumerate() {
            navigator.step(sample, &mut ()).expect("good samples");
            // Not in step with the second of the means.
            if i % 7 != 0 {
                continue;
            }
            let covariance = navigator.filter().expect("a known start").covariance();
            open = open.max(covariance.layout().len());
            let p: SMatrix<f64, 21, 21> = covariance.dense();
            worst = worst.min(least_correlation(&p));
            // The control: the paper's literal words set the variance of the heading to zero and leave what goes with it.
            let mut literal = p;
            literal[(8, 8)] *= 1e-4;
            control = control.min(least_correlation(&literal));
        }
        println!("{name:?}: {open} states, least eigenvalue of the correlations {worst:.1e}");
        // Rounding of correlations: 21 states of 2e-16, over the ten thousand updates that are between.
        assert!(worst > -1e-12, "{name:?}: {worst:e}");
        assert!(control < -1e-3, "{name:?}: {control:e}");
    }
}

/// Least eigenvalue of the correlations; states of no variance, closed ones among them, have none with others.
fn least_correlation(p: &SMatrix<f64, 21, 21>) -> f64 {
    let correlations = SMatrix::<f64, 21, 21>::from_fn(|i, j| {
        let product = p[(i, i)] * p[(j, j)];
        assert!(p[(i, i)] >= 0.0 && (product > 0.0 || p[(i, j)].abs() < 1e-30));
        if product > 0.0 {
            p[(i, j)] / product.sqrt()
        } else {
            f64::from(u8::from(i == j))
        }
    });
    correlations.symmetric_eigenvalues().min()
}

/// A gap of more than five seconds in a stop, once while the run goes on and once among what is kept for a start that is still
/// pending: the run before it and the one after it each have their stop, and neither reaches over the gap.
#[test]
fn a_long_gap_makes_two_runs_and_two_stops_also_while_the_start_is_pending() {
    for heading_deg in [Some(130.0), None] {
        let body = still(8);
        let mut config = Config::default();
        config.alignment.heading_deg = heading_deg;
        let noise = ImuGrade::Industrial.noise();
        let mut navigator = Navigator::new(&config, noise).expect("good settings");
        #[derive(Default)]
        struct Told {
            record: Record,
            started: Vec<Time>,
            gaps: Vec<(Time, Time)>,
            pending_at_gap: bool,
        }
        impl Sink for Told {
            fn epoch(&mut self, epoch: &Epoch) {
                self.record.epoch(epoch);
            }
            fn event(&mut self, event: &Event) {
                self.record.event(event);
                match event {
                    Event::Started(alignment) => self.started.push(alignment.nav.time),
                    Event::ImuGap { from, to } => self.gaps.push((*from, *to)),
                    _ => {}
                }
            }
        }
        let mut told = Told::default();
        let mut source = Source::new(4, Stream::VelocityWhite);
        let hole = 30.0..38.0;
        for sample in &body.samples(60.0, 1.0) {
            let t = sample.time().since(BEGIN);
            if hole.contains(&t) {
                told.pending_at_gap = navigator.filter().is_none();
                continue;
            }
            if let Sample::GnssPosition(fix) = sample {
                let velocity = GnssVelocity {
                    time: fix.time,
                    velocity_n: source.normal3() * 0.05,
                    covariance_n: Some(Matrix3::identity() * 0.05_f64.powi(2)),
                };
                let velocity = Sample::GnssVelocity(velocity);
                navigator.step(&velocity, &mut told).expect("good samples");
            }
            navigator.step(sample, &mut told).expect("good samples");
        }
        navigator.finish(&mut told).expect("good samples");
        // Nothing tells a heading of a body that stands: without a given one the start waits longer than this log.
        assert_eq!(told.pending_at_gap, heading_deg.is_none());
        let [(from, to)] = told.gaps[..] else {
            panic!("{:?}", told.gaps);
        };
        assert!((from.since(BEGIN) - 29.99).abs() < 1e-6 && (to.since(BEGIN) - 38.0).abs() < 1e-6);
        assert_eq!(told.started, [BEGIN, to], "{heading_deg:?}");
        let [first, second] = told.record.stops[..] else {
            panic!("{heading_deg:?}: {} stops", told.record.stops.len());
        };
        assert_eq!(
            (first.ended_by, second.ended_by),
            (StopEnd::Gap, StopEnd::End)
        );
        assert!(first.begin >= BEGIN && first.end <= from, "{first:?}");
        // What stood before the gap is no part of the stop behind it.
        assert!(second.begin >= to && second.held_from >= to, "{second:?}");
        assert!(second.end.since(BEGIN) > 59.9, "{second:?}");
        let heading = body.q_nb(0.0).euler_angles().2;
        for stop in [first, second] {
            let sigma = stop.sigma_heading_before.to_degrees();
            match heading_deg {
                Some(_) => {
                    let off = (stop.heading_before - heading).to_degrees();
                    assert!(off.abs() < 4.0 * sigma, "{off} {sigma}");
                }
                None => assert!(sigma > 95.0, "{sigma}"),
            }
            // A constant pose: what the second run begins with is not carried over from the first.
            assert!(stop.heading_growth.abs() < 1e-12, "{}", stop.heading_growth);
        }
        let epochs = told.record.epochs.iter().map(|e| e.nav.time.since(BEGIN));
        assert!(epochs.clone().all(|t| !(29.995..37.995).contains(&t)));
        assert!(epochs.clone().any(|t| t < 1.0) && epochs.clone().any(|t| t > 59.9));
    }
}

/// A run that begins in a stop is held from the first second: what waits for the start is looked at before.
#[test]
fn a_run_that_begins_at_rest_is_held_from_its_first_second() {
    let body = still(4);
    let noise = ImuGrade::Industrial.noise();
    let mut navigator = Navigator::new(&Config::default(), noise).expect("good settings");
    let mut record = Record::default();
    let mut source = Source::new(4, Stream::VelocityWhite);
    for sample in &body.samples(60.0, 1.0) {
        if let Sample::GnssPosition(fix) = sample {
            let velocity = GnssVelocity {
                time: fix.time,
                velocity_n: source.normal3() * 0.05,
                covariance_n: Some(Matrix3::identity() * 0.05_f64.powi(2)),
            };
            navigator
                .step(&Sample::GnssVelocity(velocity), &mut record)
                .expect("good samples");
        }
        navigator.step(sample, &mut record).expect("good samples");
    }
    navigator.finish(&mut record).expect("good samples");
    let held = record.stops[0].held_from.since(BEGIN);
    assert!(held < 1.0, "{held} s");
    // Nothing is known of the heading, and nothing becomes known: 104° are a uniform distribution.
    let last = record.epochs[record.epochs.len() - 1];
    assert!(last.heading_sigma().to_degrees() > 95.0);
}

/// Somebody says that the body stands, and GNSS that it drives at ten metres a second: it is believed to drive, told so once,
/// and not asked again until what was declared is taken back.
#[test]
fn a_stop_that_gnss_contradicts_is_ended_and_not_taken_up_again() {
    use insnav::sim::{Leg, Scenario};
    let mut scenario = Scenario::standing(1.0, 70.0);
    let leg = |duration_s: f64, speed_m_per_s: f64| Leg {
        duration_s,
        speed_m_per_s,
        ..Leg::default()
    };
    scenario.drive.legs = vec![leg(20.0, 0.0), leg(10.0, 10.0), leg(30.0, 10.0)];
    scenario.duration_s = 60.0;
    let simulation = scenario.simulate(1).expect("a good scenario");
    let start = simulation.trajectory.start();
    // It stands until 20 s; what is declared goes on to 50 s.
    let config = declared(StationaryMode::Static, &[[5.0, 50.0]]);
    let truth = |t: f64| simulation.truth_at(start.plus(t));
    #[derive(Default)]
    struct Told(Record, usize);
    impl Sink for Told {
        fn epoch(&mut self, epoch: &Epoch) {
            self.0.epoch(epoch);
        }
        fn event(&mut self, event: &Event) {
            self.0.event(event);
            self.1 += usize::from(matches!(event, Event::StandstillContradicted { .. }));
        }
    }
    let mut told = Told::default();
    let noise = ImuGrade::Automotive.noise();
    let known = InitialSigma {
        gyro_bias: Vector3::repeat(noise.gyro_bias_sigma),
        accel_bias: Vector3::repeat(noise.accel_bias_sigma),
        ..sigma(1.0)
    };
    let mut navigator =
        Navigator::aligned(&config, noise, truth(0.0).nav, ImuErrors::default(), &known)
            .expect("good settings");
    for sample in &simulation.samples {
        navigator.step(sample, &mut told).expect("good samples");
    }
    navigator.finish(&mut told).expect("good samples");
    let Told(record, contradictions) = told;
    assert_eq!(contradictions, 1, "{:?}", record.stops);
    let [stop] = record.stops[..] else {
        panic!("{} stops", record.stops.len());
    };
    assert_eq!(stop.ended_by, StopEnd::Contradicted);
    let end = stop.end.since(start);
    assert!((20.0..25.0).contains(&end), "{end}");
    let last = record.epochs[record.epochs.len() - 1];
    let off = last.nav.velocity_n - truth(60.0).nav.velocity_n;
    assert!(off.norm() < 0.5, "{off}");
}

/// A true turn of 0.01 rad/s for five seconds in a stop that somebody declared: every mode follows it, none takes it for a
/// bias.
#[test]
fn a_true_turn_in_a_declared_stop_is_followed_in_every_mode() {
    let still = still(9);
    let body = AtRest {
        attitude_deg: |t: f64| {
            [
                1.0,
                -2.0,
                130.0 + 2.865 * ((t - 30.0) / 5.0).clamp(0.0, 1.0),
            ]
        },
        errors: still.errors,
        noise: still.noise,
        gyro_step: 0.0,
        seed: 9,
    };
    let samples = body.samples(60.0, 1.0);
    for mode in [
        StationaryMode::Zupt,
        StationaryMode::Zihr,
        StationaryMode::HeadingHold,
        StationaryMode::AttitudeHold,
        StationaryMode::Static,
    ] {
        let mut config = declared(mode, &[[5.0, 55.0]]);
        config.stationary.detector = DetectorKind::Composite;
        let record = run(&config, body.nav(), &sigma(1.0), &samples);
        let last = record.epochs[record.epochs.len() - 1];
        let error = (last.nav.q_nb * body.q_nb(60.0).inverse())
            .scaled_axis()
            .z
            .to_degrees();
        // A turn is believed after a window's mean and a second more show it: 3.5 s of 0.57 °/s at most.
        assert!(error.abs() < 2.0, "{mode:?}: {error}°");
    }
}

/// A body that turns by 2° in the last 0.8 s of a declared stop: the last mean of static mode is taken back as the stop is left.
/// That is growth and no correction, and in every mode the two and what came at entry make the heading after of the one before.
#[test]
fn the_account_of_the_heading_closes_and_a_turn_is_growth() {
    const TURN_DEG: f64 = 2.0;
    let still = still(12);
    let body = AtRest {
        attitude_deg: |t: f64| {
            let turned = TURN_DEG * ((t - 54.1) / 0.8).clamp(0.0, 1.0);
            [1.0, -2.0, 359.0 + turned]
        },
        errors: still.errors,
        noise: still.noise,
        gyro_step: 0.0,
        seed: 12,
    };
    let samples = body.samples(60.0, 1.0);
    let account = |mode: StationaryMode| {
        let record = run(
            &declared(mode, &[[5.0, 55.0]]),
            body.nav(),
            &sigma(1.0),
            &samples,
        );
        let [stop] = record.stops[..] else {
            panic!("{mode:?}: {:?}", record.stops);
        };
        let whole = stop.heading_at_entry + stop.heading_growth + stop.heading_corrections;
        let change = insnav::attitude::wrap_angle(stop.heading_after - stop.heading_before);
        // Rounding of 15 000 bookings.
        assert!((whole - change).abs() < 1e-10, "{mode:?}: {whole} {change}");
        (
            stop.heading_growth.to_degrees(),
            stop.heading_corrections.to_degrees(),
        )
    };
    let (growth, corrections) = account(StationaryMode::Static);
    // 0.15 °/√h of a second, and what is left of a bias in it: 0.01°.
    assert!((growth - TURN_DEG).abs() < 0.05, "{growth}");
    // The five seconds before the stop had a bias in them, which the stop has shown; 0.006° of noise.
    let drift = (body.q_nb(0.0) * body.errors.gyro_bias).z.to_degrees() * 5.0;
    assert!(drift.abs() > 0.05, "{drift}");
    assert!((corrections + drift).abs() < 0.02, "{corrections} {drift}");
    // A held heading that does not fit is not believed: the turn is followed there too.
    let (growth, _) = account(StationaryMode::HeadingHold);
    assert!((growth - TURN_DEG).abs() < 0.1, "{growth}");
    // What holds none has drift and turn from the gyros, and nobody to take them back.
    let whole = TURN_DEG + 10.0 * drift;
    for mode in [StationaryMode::Off, StationaryMode::Zupt] {
        let (growth, corrections) = account(mode);
        println!(
            "{mode:?}: growth {growth:.3}°, corrections {corrections:.3}°, drift and turn {whole:.3}°"
        );
        assert!((growth - whole).abs() < 0.1, "{mode:?}: {growth}");
    }
    for mode in [StationaryMode::AttitudeHold, StationaryMode::Zihr] {
        let (growth, corrections) = account(mode);
        println!("{mode:?}: growth {growth:.3}°, corrections {corrections:.3}°");
    }
}
