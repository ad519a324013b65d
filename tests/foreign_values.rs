//! Geodesy, gravity, rates, attitude and mechanization against values that other programs computed.
//!
//! The values, with the names and versions of their programs, are in `foreign/values.json`, written by
//! `foreign/make_values.py`. They share no code with this project.

use insnav::attitude::{Euler, exp, left_jacobian, log};
use insnav::earth::{
    FLATTENING, Geodetic, LocalEarth, LocalFrame, SEMI_MAJOR_AXIS, gravity, meridian_radius,
    transverse_radius,
};
use insnav::mechanization::{IncrementBuilder, NavState};
use insnav::sample::ImuSample;
use insnav::time::Time;
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;

fn values() -> Value {
    serde_json::from_str(include_str!("foreign/values.json")).expect("the file is JSON")
}

fn rows(table: &str) -> Vec<Value> {
    let rows = values()[table].as_array().expect("a table of rows").clone();
    assert!(rows.len() >= 10, "{table} holds values");
    rows
}

fn number(row: &Value, key: &str) -> f64 {
    row[key]
        .as_f64()
        .unwrap_or_else(|| panic!("{key} is a number in {row}"))
}

fn numbers(row: &Value, key: &str) -> Vec<f64> {
    let list = row[key]
        .as_array()
        .unwrap_or_else(|| panic!("{key} is a list in {row}"));
    list.iter().map(|v| v.as_f64().expect("numbers")).collect()
}

fn vector(row: &Value, key: &str) -> Vector3<f64> {
    Vector3::from_column_slice(&numbers(row, key))
}

fn matrix(row: &Value, key: &str) -> Matrix3<f64> {
    Matrix3::from_row_slice(&numbers(row, key))
}

/// PROJ. A metre of the Earth's radius is known to 1e-9 m, at 10 000 km of height to 2e-9 m.
#[test]
fn geodetic_and_ecef_positions_agree_with_proj() {
    for row in rows("ecef") {
        let at = Geodetic::from_degrees(
            number(&row, "lat"),
            number(&row, "lon"),
            number(&row, "height"),
        );
        let ecef = vector(&row, "ecef");
        assert!(
            (at.to_ecef() - ecef).norm() < 5e-9,
            "{row}: {}",
            at.to_ecef() - ecef
        );
        let back = Geodetic::from_ecef(&ecef);
        let radius = SEMI_MAJOR_AXIS + at.height;
        assert!((back.latitude - at.latitude).abs() * radius < 1e-8, "{row}");
        assert!((back.height - at.height).abs() < 1e-8, "{row}");
        // The longitude is as good as the distance from the axis lets it be; at the poles any will do.
        let turn = (back.longitude - at.longitude).sin() * radius * at.latitude.cos();
        assert!(turn.abs() < 1e-8, "{row}");
    }
}

/// pymap3d. Differences of ECEF positions, so to some 1e-9 m.
#[test]
fn local_coordinates_agree_with_pymap3d() {
    for row in rows("ned") {
        let [origin, at] = ["origin", "at"].map(|key| {
            let v = vector(&row, key);
            Geodetic::from_degrees(v.x, v.y, v.z)
        });
        let ned = LocalFrame::new(origin).to_ned(&at);
        assert!((ned - vector(&row, "ned")).norm() < 1e-8, "{row}: {ned}");
    }
}

/// pymap3d on the ellipsoid, pyins 1000 m above. pyins writes e² with 14 digits, which is 1e-8 m of a radius.
#[test]
fn radii_of_curvature_agree_with_pymap3d_and_pyins() {
    for row in rows("radii") {
        let at = Geodetic::from_degrees(number(&row, "lat"), 0.0, 1000.0);
        assert!(
            (meridian_radius(at.latitude) - number(&row, "meridian")).abs() < 1e-8,
            "{row}"
        );
        assert!(
            (transverse_radius(at.latitude) - number(&row, "transverse")).abs() < 1e-8,
            "{row}"
        );
        let [meridian, transverse] = numbers(&row, "pyins_at_1000_m")[..] else {
            panic!("two radii in {row}")
        };
        let earth = LocalEarth::at(&at);
        assert!((earth.meridian - meridian).abs() < 1e-7, "{row}");
        assert!((earth.transverse - transverse).abs() < 1e-7, "{row}");
    }
}

/// pyins on the ellipsoid: the same Somigliana formula. boule at height: the closed form of the normal field, against which
/// the second-order continuation in height is short of the third order.
#[test]
fn normal_gravity_agrees_with_boule_and_pyins() {
    let mut worst = [0.0f64; 2];
    for row in rows("gravity") {
        let h = number(&row, "height");
        let at = Geodetic::from_degrees(number(&row, "lat"), 0.0, h);
        let difference = (gravity(&at) - number(&row, "closed_form")).abs();
        worst[usize::from(h > 5000.0)] = worst[usize::from(h > 5000.0)].max(difference);
        if h == 0.0 {
            // The printed constants have ten digits of gravity.
            assert!((gravity(&at) - number(&row, "pyins")).abs() < 1e-9, "{row}");
            assert!(difference < 1e-9, "{row}");
        }
        // The first terms left out, x = h/a: 4 x³, and of the coefficients (3 f² + 3 m²) x and 2 f x².
        let x = h / SEMI_MAJOR_AXIS;
        let left_out = 4.0 * x * x * x + 7.0e-5 * x + 2.0 * FLATTENING * x * x;
        assert!(difference < 1e-9 + 9.8 * left_out, "{row}: {difference:e}");
    }
    println!(
        "gravity against the closed form: {:.1e} m/s² to 5 km, {:.1e} to 20 km",
        worst[0], worst[1]
    );
}

/// pyins' curvature matrix and Earth rate.
#[test]
fn transport_rate_and_earth_rate_agree_with_pyins() {
    for row in rows("rates") {
        let earth = LocalEarth::at(&Geodetic::from_degrees(
            number(&row, "lat"),
            0.0,
            number(&row, "height"),
        ));
        let transport = earth.transport_rate_n(&vector(&row, "velocity_n"));
        assert!(
            (transport - vector(&row, "transport_rate_n")).norm()
                < 1e-14 * transport.norm() + 1e-18,
            "{row}"
        );
        // Rounding of a latitude in degrees.
        assert!(
            (earth.earth_rate_n() - vector(&row, "earth_rate_n")).norm() < 1e-19,
            "{row}"
        );
    }
}

/// scipy's Rotation (and pyins' matrix, which the script compares with it).
#[test]
fn euler_angles_agree_with_scipy() {
    for row in rows("attitude") {
        let rph = vector(&row, "rph");
        let q_nb = Euler::from_degrees(rph.x, rph.y, rph.z).to_quaternion();
        let found = q_nb.to_rotation_matrix().into_inner();
        assert!(
            (found - matrix(&row, "matrix_nb")).amax() < 2e-15,
            "{row}: {found}"
        );
        let back = Euler::from_quaternion(&q_nb);
        // Roll and heading lose digits as 1/cos(pitch).
        let tolerance = 1e-14 / back.pitch.cos();
        let off = |a: f64, b_deg: f64| (a - b_deg.to_radians()).sin().abs();
        assert!(
            off(back.roll, rph.x) < tolerance && off(back.heading, rph.z) < tolerance,
            "{row}: {back:?}"
        );
        assert!(
            off(back.pitch, rph.y) < tolerance.min(1e-7),
            "{row}: {back:?}"
        );
    }
}

/// scipy's Rotation for the exponential and the logarithm; its general matrix exponential for ∫₀¹ Exp(s r) ds.
#[test]
fn rotation_vectors_agree_with_scipy() {
    for row in rows("rotation_vectors") {
        let r = vector(&row, "rotation_vector");
        let q = exp(&r);
        assert!(
            (q.to_rotation_matrix().into_inner() - matrix(&row, "matrix")).amax() < 3e-15,
            "{row}"
        );
        // Where sine and cosine of large angles have lost some units in the last place.
        assert!(
            (log(&q) - vector(&row, "shortest")).norm() < 5e-15,
            "{row}: {}",
            log(&q)
        );
        // The matrix exponential squares repeatedly: some 1e-15 at nine radians.
        assert!(
            (left_jacobian(&r) - matrix(&row, "left_jacobian")).amax() < 1e-14,
            "{row}"
        );
    }
}

/// pyins' strapdown integrator over half a minute of strong motion, 30 000 steps of 1 ms.
#[test]
fn mechanization_agrees_with_pyins() {
    let row = &values()["mechanization"];
    let [start, end] = ["start", "end"].map(|key| {
        let v = numbers(row, key);
        NavState {
            time: Time(0),
            position: Geodetic::from_degrees(v[0], v[1], v[2]),
            velocity_n: Vector3::new(v[3], v[4], v[5]),
            q_nb: Euler::from_degrees(v[6], v[7], v[8]).to_quaternion(),
        }
    });
    let mut nav = start;
    let mut builder = IncrementBuilder::default();
    for i in 0..=30_000 {
        let t = f64::from(i) * 1e-3;
        // The same lines stand in make_values.py.
        let rate = [
            0.2 * (1.1 * t).sin(),
            0.15 * (0.7 * t + 1.0).sin(),
            0.3 * (0.31 * t + 0.2).sin(),
        ];
        let force = [
            1.5 * (0.9 * t).sin(),
            (0.5 * t + 0.4).sin(),
            -9.8 + 0.5 * (1.3 * t).sin(),
        ];
        let sample = ImuSample {
            time: Time(i64::from(i) * 1_000_000),
            angular_rate_b: Vector3::from(rate),
            specific_force_b: Vector3::from(force),
        };
        if let Some(increment) = builder.push(&sample) {
            nav.advance(&increment);
        }
    }
    let way = start.position.offset_to(&end.position).xy().norm();
    assert!(way > 2000.0, "it moved: {way}");
    let position = nav.position.offset_to(&end.position);
    let velocity = nav.velocity_n - end.velocity_n;
    let attitude = log(&(nav.q_nb * end.q_nb.inverse()));
    println!(
        "against pyins: {:.1e} m, {:.1e} m/s, {:.1e} rad",
        position.norm(),
        velocity.norm(),
        attitude.norm()
    );
    // pyins takes gravity's decrease with height as 2 h/a, without the flattening's 0.0087 h/a: at no more than 115 m of height
    // 1.5e-6 m/s², down. Its velocity increment is rotated to second order: |ω|² dt²/6 of 9.8 m/s², 2e-7 m/s² at 0.35 rad/s.
    let (gravity, rotation, t) = (1.5e-6, 2e-7, 30.0);
    assert!(position.xy().norm() < 0.5 * rotation * t * t, "{position}");
    assert!(
        position.z.abs() < 0.5 * (gravity + rotation) * t * t,
        "{position}"
    );
    assert!(
        velocity.xy().norm() < rotation * t && velocity.z.abs() < (gravity + rotation) * t,
        "{velocity}"
    );
    // Both rotate exactly; the frame's rate is taken at the begin of a step there, in its middle here: ω̇ dt t/2.
    assert!(attitude.norm() < 1e-9, "{attitude}");
}
