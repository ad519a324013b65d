//! What alignment from stops refuses, each time with the numbers; and what it says instead where there is something to say.

mod standing_unit;

use insnav::alignment::{
    AlignmentMethod, AlignmentOptions, AlignmentResult, Record, Refusal, align,
};
use insnav::attitude::log;
use insnav::earth::Geodetic;
use insnav::error::Error;
use insnav::imu::ImuGrade;
use insnav::sample::ImuIncrement;
use insnav::sim::{BodyTurn, Rocking, RockingErrors, RockingTone, to_increments};
use nalgebra::Vector3;
use standing_unit::{BOTH, UG, aligned, noise, options, refused, window};

fn body(heading_deg: f64, turn_deg: [f64; 3]) -> Rocking {
    standing_unit::body(heading_deg, Vector3::from(turn_deg).map(f64::to_radians))
}

fn run(
    body: &Rocking,
    stops: &[(f64, f64)],
    options: &AlignmentOptions,
) -> Result<AlignmentResult, Error> {
    aligned(&body.increments(380.0, 50.0), stops, options)
}

#[test]
fn a_turn_about_east_leaves_azimuth_and_east_drift_alike() {
    let east = body(0.0, [0.0, 40.0, 0.0]);
    let multi = options(AlignmentMethod::MultiPosition);
    let refusal = refused(run(&east, &BOTH, &multi));
    let Refusal::SingularGeometry {
        azimuth,
        east: along_east,
        north,
        ratio,
        ..
    } = refusal
    else {
        panic!("{refusal:?}");
    };
    assert!(ratio < 1e-3, "{ratio}");
    assert!(azimuth.abs() > 0.6 && along_east.abs() > 0.6 && north.abs() < 0.01);
    // The automatic choice gives what there is, and says which is not observed.
    let found = run(&east, &BOTH, &options(AlignmentMethod::Auto)).expect("aligned");
    assert!(found.geometry_ratio < 1e-3);
    // Negative control: about north, the same turn tells them apart.
    let north = run(&body(0.0, [40.0, 0.0, 0.0]), &BOTH, &multi).expect("aligned");
    assert!(north.geometry_ratio > 0.2, "{}", north.geometry_ratio);
}

#[test]
fn the_papers_equations_refuse_what_they_cannot_solve() {
    let paper = options(AlignmentMethod::Paper);
    let rolled = run(&body(0.0, [30.0, 0.0, 0.0]), &BOTH, &paper);
    assert!(matches!(refused(rolled), Refusal::SingularGeometry { .. }));
    // Yaw 90° and roll 15°, without the vertical rate: the axis of the whole turn points east.
    let mut quadratic = paper;
    quadratic.paper_vertical = false;
    let mut twice = body(45.0, [0.0, 0.0, 90.0]);
    twice.turns.push(BodyTurn {
        begin_s: 220.0,
        duration_s: 10.0,
        rotation_b: Vector3::new(15f64.to_radians(), 0.0, 0.0),
    });
    let refusal = refused(run(&twice, &[(40.0, 200.0), (230.0, 380.0)], &quadratic));
    assert!(
        matches!(refusal, Refusal::NegativeDiscriminant { .. }),
        "{refusal:?}"
    );
    // With it the same stops are solved.
    run(&twice, &[(40.0, 200.0), (230.0, 380.0)], &paper).expect("solved");
}

#[test]
fn windows_that_are_no_stops_are_refused() {
    let multi = options(AlignmentMethod::Auto);
    let level = body(45.0, [0.0, 0.0, 180.0]);
    let short = refused(run(&level, &[(40.0, 60.0), (220.0, 380.0)], &multi));
    assert!(matches!(short, Refusal::StopTooShort { need_s, .. } if need_s == 40.0));
    let overlap = refused(run(&level, &[(40.0, 200.0), (190.0, 380.0)], &multi));
    assert!(matches!(overlap, Refusal::StopsOverlap { .. }));
    let outside = refused(run(&level, &[(40.0, 200.0), (220.0, 500.0)], &multi));
    assert!(matches!(outside, Refusal::OutsideData { .. }));
    assert_eq!(refused(run(&level, &[], &multi)), Refusal::NoStop);
    // The turn is inside the window.
    let moving = refused(run(&level, &[(40.0, 215.0), (220.0, 380.0)], &multi));
    assert!(
        matches!(moving, Refusal::NotStationary { .. }),
        "{moving:?}"
    );
    // Rocking of 25 s in a stop of 100 s: four periods of the eight that a taper needs.
    let mut slow = body(45.0, [0.0, 0.0, 180.0]);
    slow.lever_b = Vector3::new(0.0, 0.0, -1.0);
    slow.tones.push(RockingTone {
        axis: 1,
        amplitude: 0.02,
        period_s: 18.0,
        phase: 0.0,
    });
    let short = refused(run(&slow, &[(100.0, 200.0), (220.0, 320.0)], &multi));
    assert!(
        matches!(short, Refusal::StopTooShort { need_s, .. } if need_s > 120.0),
        "{short:?}"
    );
}

#[test]
fn a_creeping_base_is_refused() {
    // Yaw by fifteen seconds of arc within the second half of a stop: 300 nrad/s would pass for drift.
    let creeping = |axis: Vector3<f64>| {
        let mut body = body(45.0, [0.0, 0.0, 180.0]);
        body.turns.push(BodyTurn {
            begin_s: 300.0,
            duration_s: 80.0,
            rotation_b: axis * (15.0 / 3600f64).to_radians(),
        });
        run(&body, &BOTH, &options(AlignmentMethod::Auto))
    };
    let refusal = refused(creeping(Vector3::z()));
    assert!(
        matches!(refusal, Refusal::NotStationary { .. }),
        "{refusal:?}"
    );
    // A tilt is seen by gravity too, and does no harm.
    let tilted = creeping(Vector3::x()).expect("aligned");
    assert!(tilted.gyro_bias.amax() < 1e-9, "{}", tilted.gyro_bias);
}

#[test]
fn a_hole_is_not_stepped_over() {
    let samples: Vec<ImuIncrement> = body(45.0, [0.0, 0.0, 180.0])
        .increments(380.0, 50.0)
        .into_iter()
        .filter(|s| !(210.0..212.0).contains(&s.time.seconds()))
        .collect();
    let refusal = refused(aligned(&samples, &BOTH, &options(AlignmentMethod::Auto)));
    let Refusal::GapInData { at_s, length_s } = refusal else {
        panic!("{refusal:?}");
    };
    assert!((at_s - 210.0).abs() < 0.05 && (length_s - 2.0).abs() < 0.05);
    // Negative control: one stop on one side of it is whole.
    aligned(&samples, &BOTH[..1], &options(AlignmentMethod::Auto)).expect("aligned");
}

#[test]
fn positions_that_are_one_are_named() {
    let still = body(45.0, [0.0, 0.0, 0.0]);
    let multi = options(AlignmentMethod::MultiPosition);
    assert!(matches!(
        refused(run(&still, &BOTH, &multi)),
        Refusal::MissingRotation { .. }
    ));
    let mut coarse_scale = multi;
    coarse_scale.gyro_scale_sigma = 1e-3;
    let turned = body(45.0, [0.0, 0.0, 180.0]);
    assert!(matches!(
        refused(run(&turned, &BOTH, &coarse_scale)),
        Refusal::TurnScaleDominates { .. }
    ));
}

#[test]
fn what_a_unit_cannot_do_is_said_before() {
    let still = body(45.0, [0.0, 0.0, 0.0]);
    let mut mems = options(AlignmentMethod::Fine);
    mems.noise = ImuGrade::Industrial.noise();
    let refusal = refused(run(&still, &BOTH[..1], &mems));
    let Refusal::LowGrade {
        sigma_azimuth_deg, ..
    } = refusal
    else {
        panic!("{refusal:?}");
    };
    // 30 °/h against 7.5 °/h of horizontal Earth rate.
    assert!(
        (200.0..300.0).contains(&sigma_azimuth_deg),
        "{sigma_azimuth_deg}"
    );
    // The automatic choice levels, and names what the azimuth would be.
    mems.method = AlignmentMethod::Auto;
    let found = run(&still, &BOTH[..1], &mems).expect("levelled");
    assert_eq!(found.method, AlignmentMethod::Levelling);
    assert!(!found.observable[2] && found.observable[0] && found.observable[1]);
    assert!((found.azimuth_sigma.to_degrees() - sigma_azimuth_deg).abs() < 1e-9);
    assert_eq!(found.azimuth, None);

    let mut polar = options(AlignmentMethod::Fine);
    polar.position = Geodetic::from_degrees(89.5, 0.0, 0.0);
    assert!(matches!(
        refused(run(&still, &BOTH[..1], &polar)),
        Refusal::AzimuthUnobservable { .. }
    ));
    let mut wrong = options(AlignmentMethod::Auto);
    wrong.noise.gyro_white = 0.0;
    assert!(matches!(
        refused(run(&still, &BOTH[..1], &wrong)),
        Refusal::Option { .. }
    ));
}

/// One stop: coarse, gyrocompass and fine agree within their sigmas, and the fine one's covariance has the azimuth tied to the
/// east drift.
#[test]
fn one_position_gives_an_azimuth_with_its_drift() {
    let body = body(300.0, [0.0, 0.0, 0.0]);
    let mut errors = RockingErrors {
        white: [noise().gyro_white, noise().accel_white],
        ..RockingErrors::default()
    };
    errors.constant.gyro_bias = Vector3::new(5e-8, -5e-8, 5e-8);
    let samples = errors.apply(&body.increments(380.0, 50.0), 3);
    for method in [
        AlignmentMethod::Coarse,
        AlignmentMethod::TwoVector,
        AlignmentMethod::Gyrocompass,
        AlignmentMethod::Fine,
        AlignmentMethod::Joint,
    ] {
        let found = aligned(&samples, &[(0.0, 300.0)], &options(method)).expect("aligned");
        let error = log(&(body.attitude_at(300.0) * found.q_nb.inverse()));
        let sigma = found.sigma();
        println!(
            "{method:?}: {:.2}′ of {:.2}′",
            error.z.to_degrees() * 60.0,
            sigma[2].to_degrees() * 60.0
        );
        assert!(
            error.z.abs() < 4.0 * sigma[2],
            "{method:?} {error} {sigma:?}"
        );
        assert!(
            error.xy().amax() < 4.0 * sigma[0],
            "{method:?} {error} {sigma:?}"
        );
        // 1e-7 rad/s of east drift over 36.5 µrad/s: 9.4′, and what else there is.
        assert!((8.0..14.0).contains(&(sigma[2].to_degrees() * 60.0)));
        let east_b = found.q_nb.inverse() * Vector3::y();
        let cross = (found.covariance.fixed_view::<1, 3>(2, 3) * east_b)[0];
        let correlation = cross / (sigma[2] * noise().gyro_bias_sigma);
        assert!(correlation > 0.8, "{method:?} {correlation}");
    }
}

/// A vehicle that rocks a little, increments at 100 Hz, half an hour: north from any ten minutes.
#[test]
fn a_rocking_vehicle_finds_north_from_any_ten_minutes() {
    let mut body = body(77.0, [0.0, 0.0, 0.0]);
    body.position = Geodetic::from_degrees(55.0, 37.0, 150.0);
    body.lever_b = Vector3::new(0.4, -0.3, -1.0);
    let tone = |axis, amplitude, period_s, phase| RockingTone {
        axis,
        amplitude,
        period_s,
        phase,
    };
    body.tones = vec![
        tone(0, 2e-3, 1.7, 0.1),
        tone(1, 1.5e-3, 2.3, 1.2),
        tone(0, 8e-4, 6.1, 2.0),
        tone(1, 9e-4, 9.7, 0.4),
        tone(2, 2e-4, 3.1, 0.9),
    ];
    let mut unit = noise();
    // A ring laser of 0.0003 °/√h and 0.001 °/h: over ten minutes it knows the azimuth to 0.01°.
    unit.gyro_white = 3e-4f64.to_radians() / 60.0;
    unit.gyro_bias_sigma = 1e-3f64.to_radians() / 3600.0;
    let mut errors = RockingErrors {
        white: [unit.gyro_white, unit.accel_white],
        quantum: [0.1f64.to_radians() / 3600.0, 125.0 * UG],
        ..RockingErrors::default()
    };
    let mut source = insnav::sim::Source::new(4, insnav::sim::Stream::Initial);
    errors.constant.gyro_bias = source.normal3() * unit.gyro_bias_sigma;
    errors.constant.accel_bias = source.normal3() * unit.accel_bias_sigma;
    let samples = errors.apply(&body.increments(1800.0, 100.0), 4);
    let record = Record::new(to_increments(&samples));
    let mut auto = options(AlignmentMethod::Auto);
    auto.position = body.position;
    auto.noise = unit;
    let (mut worst, mut plain_worst, mut ratio) = (0f64, 0f64, 0f64);
    for begin in (0..=12).map(|i| f64::from(i) * 100.0) {
        let found = align(&record, &[window(begin, begin + 600.0)], &auto).expect("aligned");
        assert_eq!(found.method, AlignmentMethod::Joint, "{}", found.reason);
        let error = log(&(body.attitude_at(begin + 600.0) * found.q_nb.inverse())).z;
        worst = worst.max(error.to_degrees().abs());
        ratio = ratio.max(error.abs() / found.sigma()[2]);
        // A plain average of five minutes: gravity and mean rate as two vectors.
        let mut plain = auto;
        plain.method = AlignmentMethod::TwoVector;
        let plain = align(&record, &[window(begin, begin + 300.0)], &plain).expect("averaged");
        let error = log(&(body.attitude_at(begin + 300.0) * plain.q_nb.inverse())).z;
        plain_worst = plain_worst.max(error.to_degrees().abs());
    }
    println!(
        "azimuth within {worst:.4}°, {ratio:.2} sigmas; plain averages off by up to {plain_worst:.2}°"
    );
    assert!(worst <= 0.03, "{worst}");
    assert!(ratio <= 3.0, "{ratio}");
    assert!(plain_worst >= 0.5, "{plain_worst}");
}

/// Units that only level, and methods without a fit, must see that the body stands; and that it is gravity they feel.
#[test]
fn levelling_and_coarse_methods_see_motion_and_wrong_units() {
    let turned = body(45.0, [0.0, 0.0, 180.0]);
    let inside = [(100.0, 300.0)];
    for method in [
        AlignmentMethod::Levelling,
        AlignmentMethod::Coarse,
        AlignmentMethod::TwoVector,
        AlignmentMethod::Gyrocompass,
    ] {
        let refusal = refused(run(&turned, &inside, &options(method)));
        assert!(matches!(refusal, Refusal::Moving { .. }), "{refusal:?}");
    }
    let mut mems = options(AlignmentMethod::Auto);
    mems.noise = ImuGrade::Automotive.noise();
    let refusal = refused(run(&turned, &inside, &mems));
    assert!(matches!(refusal, Refusal::Moving { .. }), "{refusal:?}");
    // Negative control: the same unit beside the turn.
    run(&turned, &[(20.0, 190.0)], &mems).expect("levelled");

    let in_g: Vec<ImuIncrement> = turned
        .increments(380.0, 50.0)
        .into_iter()
        .map(|mut s| {
            s.velocity_b /= 9.81;
            s
        })
        .collect();
    for method in [AlignmentMethod::Auto, AlignmentMethod::Levelling] {
        let refusal = refused(aligned(&in_g, &BOTH[..1], &options(method)));
        assert!(matches!(refusal, Refusal::NotGravity { .. }), "{refusal:?}");
    }
}

/// A MEMS unit whose heading is told is levelled with it, and its gyro bias is free of the Earth's rate.
#[test]
fn a_told_heading_completes_a_levelled_unit() {
    let still = body(45.0, [0.0, 0.0, 0.0]);
    let mut mems = options(AlignmentMethod::Auto);
    mems.noise = ImuGrade::Automotive.noise();
    mems.heading = Some((45f64.to_radians(), 1f64.to_radians()));
    let found = run(&still, &[(40.0, 200.0)], &mems).expect("levelled");
    assert_eq!(found.method, AlignmentMethod::Levelling);
    assert!((found.euler().heading - 45f64.to_radians()).abs() < 1e-6);
    assert!((found.sigma()[2].to_degrees() - 1.0).abs() < 1e-9 && found.observable[2]);
    // Noise-free: what is left of the Earth's rate is nothing.
    assert!(found.gyro_bias.amax() < 1e-9, "{}", found.gyro_bias);
    assert!(found.sigma()[0] < 0.02, "{:?}", found.sigma());
}
