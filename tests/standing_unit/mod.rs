//! A unit that stands, rocks and is turned, simulated with [`Rocking`], and what an alignment makes of it.

// Each test that takes this in uses a part of it.
#![allow(dead_code)]

use insnav::alignment::{
    AlignmentMethod, AlignmentOptions, AlignmentResult, Record, Refusal, StopWindow, align,
};
use insnav::attitude::Euler;
use insnav::earth::Geodetic;
use insnav::error::Error;
use insnav::imu::{ImuErrors, ImuNoise};
use insnav::sample::ImuIncrement;
use insnav::sim::{BodyTurn, Rocking, RockingErrors, RockingTone, Source, Stream, to_increments};
use insnav::time::Time;
use nalgebra::Vector3;
use std::f64::consts::PI;

/// One micro-g, m/s².
pub(crate) const UG: f64 = 9.806_65e-6;
pub(crate) const ARCMIN: f64 = PI / 180.0 / 60.0;

/// A unit of 0.001 °/√h and 5 µg/√Hz; biases of 1e-7 rad/s (0.02 °/h) and 50 µg that do not wander.
pub(crate) fn noise() -> ImuNoise {
    ImuNoise {
        gyro_white: 0.001f64.to_radians() / 60.0,
        accel_white: 5.0 * UG,
        gyro_bias_sigma: 1e-7,
        accel_bias_sigma: 50.0 * UG,
        gyro_bias_tau: f64::INFINITY,
        accel_bias_tau: f64::INFINITY,
    }
}

pub(crate) fn place() -> Geodetic {
    Geodetic::from_degrees(60.0, 30.0, 0.0)
}

/// A level body that is turned by `turn` (rotation vector, rad) from 200 s to 220 s.
pub(crate) fn body(heading_deg: f64, turn: Vector3<f64>) -> Rocking {
    Rocking {
        turns: vec![BodyTurn {
            begin_s: 200.0,
            duration_s: 20.0,
            rotation_b: turn,
        }],
        ..Rocking::standing(place(), Euler::from_degrees(0.0, 0.0, heading_deg))
    }
}

pub(crate) fn tone(axis: usize, amplitude: f64, period_s: f64, phase: f64) -> RockingTone {
    RockingTone {
        axis,
        amplitude,
        period_s,
        phase,
    }
}

/// White noise as the unit has it, and biases drawn as it has them.
pub(crate) fn drawn(unit: &ImuNoise, seed: u64) -> RockingErrors {
    let mut source = Source::new(seed, Stream::Initial);
    RockingErrors {
        constant: ImuErrors {
            gyro_bias: source.normal3() * unit.gyro_bias_sigma,
            accel_bias: source.normal3() * unit.accel_bias_sigma,
            ..ImuErrors::default()
        },
        white: [unit.gyro_white, unit.accel_white],
        quantum: [0.0; 2],
    }
}

pub(crate) fn window(begin: f64, end: f64) -> StopWindow {
    StopWindow {
        begin: Time::from_seconds(begin),
        end: Time::from_seconds(end),
    }
}

/// The stops of [`body`].
pub(crate) const BOTH: [(f64, f64); 2] = [(40.0, 200.0), (220.0, 380.0)];

pub(crate) fn options(method: AlignmentMethod) -> AlignmentOptions {
    AlignmentOptions {
        method,
        ..AlignmentOptions::new(place(), noise())
    }
}

pub(crate) fn record(samples: &[ImuIncrement]) -> Record {
    Record::new(to_increments(samples))
}

pub(crate) fn aligned(
    samples: &[ImuIncrement],
    stops: &[(f64, f64)],
    options: &AlignmentOptions,
) -> Result<AlignmentResult, Error> {
    let stops: Vec<StopWindow> = stops.iter().map(|s| window(s.0, s.1)).collect();
    align(&record(samples), &stops, options)
}

/// The refusal, which names a remedy.
pub(crate) fn refused(result: Result<AlignmentResult, Error>) -> Refusal {
    match result {
        Err(Error::Alignment(refusal)) => {
            let text = refusal.to_string();
            println!("{text}");
            assert!(text.contains(": "), "a remedy: {text}");
            refusal
        }
        other => panic!("no refusal: {other:?}"),
    }
}
