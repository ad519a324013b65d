//! Alignment from stops with what goes wrong in practice: drifts that leave the linear region, a latitude of the other hemisphere,
//! methods that do not suit the base.

mod standing_unit;

use insnav::alignment::{AlignmentMethod, Refusal};
use insnav::attitude::{Euler, log};
use insnav::earth::Geodetic;
use insnav::imu::ImuNoise;
use insnav::sim::{BodyTurn, Rocking, RockingErrors};
use nalgebra::Vector3;
use standing_unit::{BOTH, UG, aligned, body, drawn, noise, options, place, refused, tone};
use std::f64::consts::PI;

fn tactical(bias_deg_per_hour: f64, white_deg_per_sqrt_hour: f64) -> ImuNoise {
    ImuNoise {
        gyro_white: white_deg_per_sqrt_hour.to_radians() / 60.0,
        accel_white: 50.0 * UG,
        gyro_bias_sigma: bias_deg_per_hour.to_radians() / 3600.0,
        accel_bias_sigma: 1000.0 * UG,
        ..noise()
    }
}

/// Stops of 1400 s with half a turn in between.
fn long(heading_deg: f64) -> (Rocking, [(f64, f64); 2]) {
    let body = Rocking {
        turns: vec![BodyTurn {
            begin_s: 1400.0,
            duration_s: 20.0,
            rotation_b: Vector3::z() * PI,
        }],
        ..Rocking::standing(place(), Euler::from_degrees(1.0, -2.0, heading_deg))
    };
    (body, [(0.0, 1400.0), (1420.0, 2820.0)])
}

/// Drifts of 3 °/h and 20 °/h turn the first heading anywhere, and would tilt a free run by up to 15°.
#[test]
fn tactical_units_find_north_from_long_stops() {
    let mut squares = [0.0; 4];
    let mut count = 0.0;
    for bias in [3.0, 20.0] {
        let unit = tactical(bias, 0.05);
        for seed in 0..4 {
            let (body, stops) = long(70.0 * seed as f64);
            let errors = drawn(&unit, seed);
            let samples = errors.apply(&body.increments(2820.0, 20.0), seed);
            for method in [AlignmentMethod::Joint, AlignmentMethod::Auto] {
                let mut options = options(method);
                options.noise = unit;
                let found = aligned(&samples, &stops, &options).expect("aligned");
                let error = log(&(body.attitude_at(2820.0) * found.q_nb.inverse())).z;
                let sigma = found.sigma();
                assert!(sigma[2].to_degrees() < 0.7, "{sigma:?}");
                squares[0] += (error / sigma[2]).powi(2);
                let drift = found.gyro_bias - errors.constant.gyro_bias;
                for k in 0..3 {
                    squares[1 + k] += (drift[k] / sigma[3 + k]).powi(2);
                }
                count += 1.0;
            }
        }
    }
    let means = squares.map(|s| s / count);
    println!("azimuth and drifts, squares over variances: {means:.2?}");
    // Four noises in all, seen by two methods and with two sizes of drift: 3σ of the mean of four squares is 1 + 2.1.
    assert!(means.iter().all(|m| *m < 3.1), "{means:?}");
}

/// Gyros in degrees per second in place of radians: turn and Earth rate are fifty-seven times too large, and no fit says otherwise.
#[test]
fn gyros_in_degrees_are_refused() {
    let body = body(45.0, Vector3::z() * PI);
    let mut samples = drawn(&noise(), 1).apply(&body.increments(380.0, 50.0), 1);
    for sample in &mut samples {
        sample.angle_b *= 180.0 / PI;
    }
    for stops in [1, 2] {
        for method in [AlignmentMethod::Auto, AlignmentMethod::Joint] {
            let refusal = refused(aligned(&samples, &BOTH[..stops], &options(method)));
            assert!(
                matches!(
                    refusal,
                    Refusal::NotConverged { .. }
                        | Refusal::LatitudeInconsistent { .. }
                        | Refusal::NotStationary { .. }
                ),
                "{refusal:?}"
            );
        }
    }
}

/// 60° south in place of 60° north: the vertical rate is off by 26 °/h, whatever is asked.
#[test]
fn the_other_hemisphere_is_refused() {
    let half_turn = body(45.0, Vector3::z() * PI);
    let mut rocking = half_turn.clone();
    rocking.tones = vec![tone(0, 0.01, 7.0, 0.3), tone(1, 0.01, 11.0, 1.0)];
    rocking.lever_b = Vector3::new(0.5, 0.5, -1.0);
    let heading = Some((45f64.to_radians(), 1e-3));
    let mut cases = vec![];
    for body in [&half_turn, &rocking] {
        cases.extend([
            (body, AlignmentMethod::Auto, None, 2),
            (body, AlignmentMethod::Joint, None, 2),
            (body, AlignmentMethod::Joint, None, 1),
            (body, AlignmentMethod::Auto, None, 1),
            (body, AlignmentMethod::Zupt2, heading, 1),
            (body, AlignmentMethod::Zupt2, heading, 2),
        ]);
    }
    cases.push((&half_turn, AlignmentMethod::Levelling, None, 1));
    cases.push((&half_turn, AlignmentMethod::Fine, None, 2));
    cases.push((&half_turn, AlignmentMethod::Kalman, heading, 2));
    for (body, method, heading, stops) in cases {
        let errors = drawn(&noise(), 5);
        let samples = errors.apply(&body.increments(380.0, 50.0), 5);
        let with = |latitude_deg: f64| {
            let mut options = options(method);
            options.heading = heading;
            options.position = Geodetic::from_degrees(latitude_deg, 30.0, 0.0);
            aligned(&samples, &BOTH[..stops], &options)
        };
        println!("{method:?}, {stops} stops");
        let refusal = refused(with(-60.0));
        let Refusal::LatitudeInconsistent {
            part,
            off_deg_per_hour,
            ..
        } = refusal
        else {
            panic!("{method:?} {stops}: {refusal:?}");
        };
        assert_eq!(part, "vertical");
        assert!(
            (off_deg_per_hour.abs() - 26.05).abs() < 0.3,
            "{off_deg_per_hour}"
        );
        // Negative control: with the right one there is an answer.
        with(60.0).expect("aligned");
    }
}

/// The horizontal rate is weighed over all stops: one in the middle counts, and so does a base that rocks.
#[test]
fn a_wrong_latitude_shows_in_the_middle_stops_too() {
    let quarter = |begin_s: f64, angle: f64| BodyTurn {
        begin_s,
        duration_s: 20.0,
        rotation_b: Vector3::z() * angle,
    };
    // The first and the last position are one: they alone would tell nothing of the horizontal rate.
    let mut body = body(45.0, Vector3::zeros());
    body.turns = vec![quarter(200.0, PI), quarter(380.0, -PI)];
    let stops = [(40.0, 200.0), (220.0, 380.0), (400.0, 560.0)];
    for tones in [
        vec![],
        vec![tone(0, 0.01, 7.0, 0.3), tone(1, 0.01, 5.0, 1.0)],
    ] {
        body.tones = tones;
        let samples = drawn(&noise(), 6).apply(&body.increments(560.0, 50.0), 6);
        let with = |latitude_deg: f64| {
            let mut options = options(AlignmentMethod::Auto);
            options.position = Geodetic::from_degrees(latitude_deg, 30.0, 0.0);
            aligned(&samples, &stops, &options)
        };
        let right = with(60.0).expect("aligned");
        let [norm, sigma] = right.norm_residual.expect("three stops");
        assert!(norm.abs() < 3.0 * sigma && sigma < 1e-3, "{norm} {sigma}");
        let refusal = refused(with(59.5));
        assert!(
            matches!(
                refusal,
                Refusal::LatitudeInconsistent {
                    part: "horizontal",
                    ..
                }
            ),
            "{refusal:?}"
        );
    }
}

#[test]
fn at_a_pole_no_heading_is_taken() {
    let still = Rocking::standing(
        Geodetic::from_degrees(90.0, 0.0, 0.0),
        Euler::from_degrees(0.0, 0.0, 45.0),
    );
    let samples = still.increments(200.0, 50.0);
    for method in [
        AlignmentMethod::Auto,
        AlignmentMethod::Levelling,
        AlignmentMethod::Zupt2,
    ] {
        let mut options = options(method);
        options.position = still.position;
        options.heading = Some((0.8, 0.01));
        let refusal = refused(aligned(&samples, &[(0.0, 200.0)], &options));
        assert!(matches!(refusal, Refusal::AtPole { .. }), "{refusal:?}");
        // Negative control: levelled without one, to the horizontal.
        if method != AlignmentMethod::Zupt2 {
            options.heading = None;
            let found = aligned(&samples, &[(0.0, 200.0)], &options).expect("levelled");
            assert_eq!(found.method, AlignmentMethod::Levelling);
            assert!(found.sigma()[0].is_finite());
        }
    }
}

/// Rocking that the halves of a stop do not show, and that no white noise makes: 1 mm at 1.3 s.
#[test]
fn a_kalman_filter_on_a_rocking_base_is_refused_with_the_remedy() {
    let mut body = body(45.0, Vector3::z() * PI);
    body.lever_b = Vector3::new(0.0, 0.0, -1.0);
    body.tones = vec![tone(0, 1e-3, 1.3, 0.3)];
    let samples = RockingErrors::default().apply(&body.increments(380.0, 50.0), 1);
    for (method, stops) in [
        (AlignmentMethod::Kalman, 2),
        (AlignmentMethod::Fine, 1),
        (AlignmentMethod::Fine, 2),
    ] {
        let refusal = refused(aligned(&samples, &BOTH[..stops], &options(method)));
        let Refusal::BaseRocks { nis, .. } = refusal else {
            panic!("{refusal:?}");
        };
        assert!(nis > 10.0, "{nis}");
        assert!(refusal.parts().1.contains("joint"), "{refusal}");
    }
    // Negative control: the method that is named.
    aligned(&samples, &BOTH, &options(AlignmentMethod::Joint)).expect("aligned");
}

/// `fine` is the Kalman filter of the last stop, as its neighbours are; a heading that is told is carried there.
#[test]
fn fine_uses_the_last_stop_alone() {
    let body = body(45.0, Vector3::z() * PI);
    let samples = drawn(&noise(), 3).apply(&body.increments(380.0, 50.0), 3);
    let mut fine = options(AlignmentMethod::Fine);
    let both = aligned(&samples, &BOTH, &fine).expect("aligned");
    let last = aligned(&samples, &BOTH[1..], &fine).expect("aligned");
    assert_eq!(both, last);
    let all = aligned(&samples, &BOTH, &options(AlignmentMethod::Kalman)).expect("aligned");
    assert!(all.sigma()[2] < 0.5 * both.sigma()[2]);

    for method in [AlignmentMethod::Fine, AlignmentMethod::Levelling] {
        fine.method = method;
        fine.heading = Some((45f64.to_radians(), 1e-3));
        let told = aligned(&samples, &BOTH, &fine).expect("aligned");
        let error = log(&(body.attitude_at(380.0) * told.q_nb.inverse())).z;
        assert!(error.abs() < 3.0 * told.sigma()[2], "{method:?} {error}");
        assert!(told.sigma()[2] < 1.1e-3, "{:?}", told.sigma());
    }
}

#[test]
fn a_heading_is_not_ignored() {
    let body = body(45.0, Vector3::z() * PI);
    let samples = drawn(&noise(), 3).apply(&body.increments(380.0, 50.0), 3);
    for method in [
        AlignmentMethod::Gyrocompass,
        AlignmentMethod::Coarse,
        AlignmentMethod::TwoVector,
    ] {
        let mut options = options(method);
        options.heading = Some((45f64.to_radians(), 1e-3));
        let refusal = refused(aligned(&samples, &BOTH, &options));
        assert!(
            matches!(refusal, Refusal::Option { key: "heading", .. }),
            "{refusal:?}"
        );
    }
    // The joint regression of one position weighs it like the filter: 1e-7 rad/s of drift leave 9.6′, and 2′ are told.
    let mut sigmas = Vec::new();
    for method in [AlignmentMethod::Joint, AlignmentMethod::Fine] {
        let mut options = options(method);
        options.heading = Some((45f64.to_radians(), 2.0 * standing_unit::ARCMIN));
        let found = aligned(&samples, &BOTH[..1], &options).expect("aligned");
        let error = log(&(body.attitude_at(200.0) * found.q_nb.inverse())).z;
        assert!(error.abs() < 3.0 * found.sigma()[2], "{method:?} {error}");
        sigmas.push(found.sigma()[2] / standing_unit::ARCMIN);
    }
    println!("{sigmas:.3?}");
    assert!(sigmas.iter().all(|s| (1.8..2.02).contains(s)), "{sigmas:?}");
}

/// The limit holds after the fit as before it: what a method that is asked for gives, has a heading.
#[test]
fn a_fit_that_ends_above_the_limit_is_refused() {
    let body = body(45.0, Vector3::z() * PI);
    let samples = drawn(&noise(), 3).apply(&body.increments(380.0, 50.0), 3);
    let mut joint = options(AlignmentMethod::Joint);
    let found = aligned(&samples, &BOTH, &joint).expect("aligned");
    // Between what is expected at best and what the regression attains.
    joint.largest_azimuth_sigma = found.sigma()[2] * 0.99;
    let refusal = refused(aligned(&samples, &BOTH, &joint));
    let Refusal::LowGrade {
        sigma_azimuth_deg, ..
    } = refusal
    else {
        panic!("{refusal:?}");
    };
    assert!((sigma_azimuth_deg - found.sigma()[2].to_degrees()).abs() < 1e-9);
}

/// Drifts tilt what the gyros carry to the end of a stop: every method without a fit has that in its covariance.
#[test]
fn drifts_act_on_coarse_methods_as_their_covariance_says() {
    let body = Rocking::standing(place(), Euler::from_degrees(5.0, -3.0, 70.0));
    let exact = body.increments(300.0, 50.0);
    let size = 5e-7;
    for method in [
        AlignmentMethod::Coarse,
        AlignmentMethod::TwoVector,
        AlignmentMethod::Gyrocompass,
    ] {
        let mut options = options(method);
        options.noise.gyro_bias_sigma = size;
        let with = |bias: Vector3<f64>| {
            let mut errors = RockingErrors::default();
            errors.constant.gyro_bias = bias;
            aligned(&errors.apply(&exact, 1), &[(0.0, 300.0)], &options).expect("aligned")
        };
        let none = with(Vector3::zeros());
        let effect = none.covariance.fixed_view::<3, 3>(0, 3) / (size * size);
        for axis in 0..3 {
            let mut bias = Vector3::zeros();
            bias[axis] = size;
            let moved = log(&(none.q_nb * with(bias).q_nb.inverse()));
            let said = effect * bias;
            println!("{method:?} {axis}: {moved:?} {said:?}");
            // Tilts of up to 1.5e-4 rad, to a twentieth of that; headings of up to 0.014 rad to a fiftieth, as the Earth turns the
            // stop's axes by 0.02 rad meanwhile.
            assert!((moved - said).xy().amax() < 8e-6, "{method:?} {axis}");
            assert!((moved - said).z.abs() < 3e-4, "{method:?} {axis}");
        }
    }
}

/// The scale error of a gyro is one constant: turns the same way add up, there and back cancels, and the sigma says so.
#[test]
fn a_scale_error_is_the_same_in_every_turn() {
    let quarter = PI / 2.0;
    for (turns, about) in [([quarter, quarter], 2.0), ([quarter, -quarter], 1.0)] {
        let mut body = body(45.0, Vector3::zeros());
        body.turns = [200.0, 380.0]
            .into_iter()
            .zip(turns)
            .map(|(begin_s, angle)| BodyTurn {
                begin_s,
                duration_s: 20.0,
                rotation_b: Vector3::z() * angle,
            })
            .collect();
        let stops = [(40.0, 200.0), (220.0, 380.0), (400.0, 560.0)];
        let exact = body.increments(560.0, 50.0);
        let scale = 1e-4;
        for method in [AlignmentMethod::Joint, AlignmentMethod::Kalman] {
            let with = |sigma: f64, scale: f64| {
                let mut options = options(method);
                options.gyro_scale_sigma = sigma;
                let mut errors = RockingErrors::default();
                errors.constant.gyro_scale = Vector3::z() * scale;
                aligned(&errors.apply(&exact, 1), &stops, &options).expect("aligned")
            };
            // What the scale error does, against what the same fit says that it may do.
            let (none, done) = (with(scale, 0.0), with(scale, scale));
            let moved = log(&(done.q_nb * none.q_nb.inverse())).z.abs();
            let own = with(0.0, 0.0).covariance[(2, 2)];
            let said = (none.covariance[(2, 2)] - own).sqrt();
            println!("{method:?} {about}: {moved:.2e} {said:.2e}");
            if method == AlignmentMethod::Joint {
                // The regression does not weigh by it: the same to its linearisation.
                assert!((moved / said - 1.0).abs() < 0.05, "{moved} {said}");
            } else {
                assert!((0.8..1.25).contains(&(moved / said)), "{moved} {said}");
            }
        }
    }
}

/// A bias that wanders goes back to zero: after many of its correlation times it is as large as at the begin, not larger.
#[test]
fn a_wandering_bias_stays_as_large_as_it_is() {
    let body = body(45.0, Vector3::zeros());
    let samples = body.increments(200.0, 50.0);
    for method in [AlignmentMethod::Joint, AlignmentMethod::Kalman] {
        let mut options = options(method);
        options.noise.gyro_bias_tau = 10.0;
        let found = aligned(&samples, &[(0.0, 200.0)], &options).expect("aligned");
        let ratio = found.sigma()[5] / options.noise.gyro_bias_sigma;
        println!("{method:?}: {ratio:.2}");
        // The bias at the end, less a mean over the stop that says little of it: √(1 + 2τ/T) at most. A random walk of the
        // same density would have come to √(2T/τ) = 6 times.
        assert!((0.5..1.2).contains(&ratio), "{method:?} {ratio}");
    }
}
