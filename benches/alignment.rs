//! Alignment from stops: 400 s at 200 Hz, from increments to the result.

use criterion::{Criterion, criterion_group, criterion_main};
use insnav::alignment::{AlignmentMethod, AlignmentOptions, Record, StopWindow, Taper, align};
use insnav::attitude::Euler;
use insnav::earth::Geodetic;
use insnav::imu::{ImuErrors, ImuGrade};
use insnav::mechanization::Increment;
use insnav::sim::{BodyTurn, Rocking, RockingErrors, to_increments};
use insnav::time::Time;
use nalgebra::Vector3;
use std::f64::consts::PI;
use std::hint::black_box;

fn place() -> Geodetic {
    Geodetic::from_degrees(60.0, 30.0, 0.0)
}

/// Stops of 170 s with a half turn between them.
fn increments() -> Vec<Increment> {
    let body = Rocking {
        turns: vec![BodyTurn {
            begin_s: 190.0,
            duration_s: 20.0,
            rotation_b: Vector3::z() * PI,
        }],
        ..Rocking::standing(place(), Euler::from_degrees(1.0, -2.0, 45.0))
    };
    let noise = ImuGrade::Navigation.noise();
    let errors = RockingErrors {
        constant: ImuErrors {
            gyro_bias: Vector3::repeat(1e-7),
            ..ImuErrors::default()
        },
        white: [noise.gyro_white, noise.accel_white],
        quantum: [0.0; 2],
    };
    to_increments(&errors.apply(&body.increments(400.0, 200.0), 1))
}

fn alignment(criterion: &mut Criterion) {
    let increments = increments();
    let window = |begin: f64, end: f64| StopWindow {
        begin: Time::from_seconds(begin),
        end: Time::from_seconds(end),
    };
    let both = [window(20.0, 190.0), window(210.0, 400.0)];
    let options = |method| AlignmentOptions {
        method,
        taper: Some(Taper::HannSquared),
        ..AlignmentOptions::new(place(), ImuGrade::Navigation.noise())
    };
    let mut group = criterion.benchmark_group("alignment");
    group.sample_size(20);
    group.bench_function("record", |b| {
        b.iter(|| Record::new(black_box(&increments).iter().copied()));
    });
    for (name, method, stops) in [
        // Three passes, and the quiet test by the Kalman filter beside them.
        ("joint", AlignmentMethod::Joint, &both[..]),
        ("kalman", AlignmentMethod::Kalman, &both[..]),
        ("coarse", AlignmentMethod::Coarse, &both[1..]),
    ] {
        let options = options(method);
        group.bench_function(name, |b| {
            b.iter(|| {
                let record = Record::new(black_box(&increments).iter().copied());
                align(&record, stops, &options).expect("aligned")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, alignment);
criterion_main!(benches);
