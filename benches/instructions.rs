//! One part of the filter, called a thousand times: what benches/instructions.sh counts the instructions of.

// Not every bench needs all of it.
mod hand;
#[allow(dead_code)]
mod noise;
mod setup;

use insnav::filter::{Columns, Covariance, Eskf, Gate, Transition, Verdict, fill_base};
use insnav::mechanization::Interval;
use insnav::noise::LagAccumulator;
use insnav::sample::{ImuSample, MagneticField};
use nalgebra::{Matrix3, Vector1, Vector3};
use std::hint::black_box;

const CALLS: usize = 1000;
/// Samples of the record that is estimated as a whole, once.
const RECORD: usize = 20_000;

// What is counted is collected between entry and return of these: they must exist as functions.
#[inline(never)]
fn counted_propagate(p: &mut Covariance, phi: &Transition) {
    p.propagate(phi);
}

#[inline(never)]
fn counted_update(p: &mut Covariance, h: &Columns<3>, r: &Matrix3<f64>, residual: &Vector3<f64>) {
    let innovation = p.innovation(h, r, residual).expect("positive definite");
    black_box(p.correct(&innovation, h, r));
}

#[inline(never)]
fn counted_dynamics(phi: &mut Transition, p: &Covariance, interval: &Interval) {
    fill_base(phi, p.layout(), interval, &setup::noise());
}

#[inline(never)]
fn counted_step(filter: &mut Eskf) {
    filter.propagate(&setup::increment(filter.nominal().nav.time));
}

#[inline(never)]
fn counted_fix(filter: &mut Eskf, fix: &insnav::measurement::GnssPositionModel, gate: &mut Gate) {
    let update = filter
        .update(fix, filter.nominal().nav.time, gate)
        .expect("positive definite");
    assert_ne!(update.verdict, Verdict::Rejected);
}

#[inline(never)]
fn counted_als_general(model: &noise::General) {
    black_box(model.solve());
}

#[inline(never)]
fn counted_als_channel(model: &noise::Channel) {
    black_box(model.solve());
}

#[inline(never)]
fn counted_als_stream(lags: &mut LagAccumulator<1, 13>, nu: &Vector1<f64>) {
    lags.push(nu);
}

#[inline(never)]
fn counted_als_batch(record: &[f64]) {
    black_box(noise::batch(record));
}

#[inline(never)]
fn counted_ahrs_record(record: &(Vec<ImuSample>, Vec<MagneticField>)) {
    black_box(hand::filtered(&record.0, &record.1));
}

/// The parts of noise identification and orientation; whether it is one of them.
fn identify(part: &str) -> bool {
    match part {
        "als_general" => {
            let model = noise::General::new();
            (0..CALLS).for_each(|_| counted_als_general(black_box(&model)));
        }
        "als_channel" => {
            let model = noise::Channel::new();
            (0..CALLS).for_each(|_| counted_als_channel(black_box(&model)));
        }
        "als_stream" => {
            let record = noise::record(CALLS, 1);
            let mut lags = LagAccumulator::new();
            record
                .iter()
                .for_each(|v| counted_als_stream(&mut lags, black_box(&Vector1::new(*v))));
            black_box(&lags);
        }
        "als_batch" => counted_als_batch(black_box(&noise::record(RECORD, 0))),
        // As many samples as other parts have calls.
        "ahrs_record" => {
            let mut record = hand::record(5.0);
            record.0.truncate(CALLS);
            record.1.truncate(CALLS);
            counted_ahrs_record(black_box(&record));
        }
        _ => return false,
    }
    true
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let part = arguments.next().unwrap_or_default();
    let states = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(15);
    if identify(&part) {
        return;
    }
    let mut p = setup::covariance(states);
    let mut phi = setup::transition(p.layout());
    match part.as_str() {
        "propagate" => (0..CALLS).for_each(|_| counted_propagate(&mut p, black_box(&phi))),
        "update" => {
            let h = setup::velocity_rows(p.layout());
            let r = Matrix3::from_diagonal_element(1e-4);
            (0..CALLS).for_each(|_| {
                counted_update(&mut p.clone(), &h, &r, black_box(&Vector3::repeat(1e-3)))
            });
        }
        "dynamics" => {
            let interval = setup::interval();
            (0..CALLS).for_each(|_| counted_dynamics(&mut phi, &p, black_box(&interval)));
        }
        "step" => {
            let mut filter = setup::filter_of(states);
            (0..CALLS).for_each(|_| counted_step(&mut filter));
        }
        "fix" => {
            let filter = setup::filter();
            let (fix, mut gate) = (setup::fix(&filter), Gate::default());
            (0..CALLS).for_each(|_| counted_fix(&mut filter.clone(), &fix, &mut gate));
        }
        // Without a part, as `cargo bench` calls it, there is nothing to measure here.
        _ => println!("instructions: run benches/instructions.sh"),
    }
}
