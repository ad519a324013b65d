//! The drive that \[Lobusov14\] means: a navigation-grade unit without a receiver, an hour with a stop every five minutes.

use insnav::sim::{ErrorAt, NavigationDrive, NavigationOutcome, StopUse};
use std::env;
use std::ops::Range;

/// Of one use of the stops over the seeds: rms errors when the first and the last leg end, m and minutes of arc, and mean NEES of
/// the horizontal position over all legs, per component.
#[derive(Debug)]
struct Row {
    first_m: f64,
    last_m: f64,
    heading_arcmin: f64,
    nees: f64,
}

fn row(outcomes: &[NavigationOutcome]) -> Row {
    let runs = outcomes.len() as f64;
    let rms = |of: &dyn Fn(&[ErrorAt]) -> f64| {
        let squares: f64 = outcomes.iter().map(|o| of(&o.legs).powi(2)).sum();
        (squares / runs).sqrt()
    };
    let legs = outcomes[0].legs.len() as f64;
    let all = outcomes.iter().flat_map(|o| &o.legs);
    Row {
        first_m: rms(&|legs| legs[0].horizontal_m),
        last_m: rms(&|legs| legs[legs.len() - 1].horizontal_m),
        heading_arcmin: rms(&|legs| legs[legs.len() - 1].heading.to_degrees() * 60.0),
        nees: all.map(|leg| leg.horizontal_nees).sum::<f64>() / (runs * legs),
    }
}

fn long() -> bool {
    env::var_os("INSNAV_LONG").is_some()
}

/// Where the mean NEES lies. The nine legs of a run share their errors: six runs have about as many independent pairs, and of a
/// thousand means of twelve squares one is below 0.18 and one above 2.74; of eighty, 0.56 and 1.56.
fn band() -> Range<f64> {
    if long() { 0.56..1.56 } else { 0.18..2.74 }
}

/// Rocking at 1.9 Hz takes the full rate.
fn drive(rocking: bool) -> NavigationDrive {
    NavigationDrive {
        rocking,
        rate_hz: if long() || rocking { 100.0 } else { 50.0 },
        ..NavigationDrive::default()
    }
}

fn runs(drive: &NavigationDrive, uses: StopUse) -> Vec<NavigationOutcome> {
    let seeds = if long() { 40 } else { 6 };
    let outcomes: Vec<NavigationOutcome> = (0..seeds)
        .map(|seed| drive.run(uses, seed).expect("a run"))
        .collect();
    assert!(outcomes.iter().all(|o| o.legs.len() == 9));
    outcomes
}

/// After an hour: kilometres without the stops, metres with them.
#[test]
fn an_hour_without_a_receiver() {
    let drive = drive(false);
    let mut rows = Vec::new();
    for uses in StopUse::ALL {
        let outcomes = runs(&drive, uses);
        let expected = if uses == StopUse::None { 1 } else { 11 };
        for outcome in &outcomes {
            assert_eq!(outcome.stops.len(), expected, "{uses:?}");
            assert_eq!(outcome.not_fused, 0);
        }
        let row = row(&outcomes);
        println!("{:14} {row:.2?}", uses.name());
        rows.push(row);
    }
    let [none, zero_velocity, _, batch] = rows.as_slice() else {
        panic!("four rows");
    };
    assert!(none.last_m > 1e3 && zero_velocity.last_m < 30.0);
    assert!(none.first_m > 50.0 && batch.first_m < 10.0);
    assert!(batch.last_m < 0.01 * none.last_m);
    assert!(batch.heading_arcmin < 0.25 * none.heading_arcmin);
    for row in [none, batch] {
        assert!(band().contains(&row.nees), "{row:?}");
    }
}

/// A base that rocks moves by millimetres a second and turns by minutes of arc, the same way in every run: zero velocities take that
/// for noise and promise too much, and a whole stop tells it from drift.
#[test]
fn on_a_rocking_base_a_whole_stop_keeps_its_word() {
    let drive = drive(true);
    let [live, batch] = [StopUse::ZeroVelocity, StopUse::Batch].map(|uses| {
        let outcomes = runs(&drive, uses);
        for outcome in &outcomes {
            assert_eq!(outcome.stops.len(), 11, "{uses:?}");
            assert_eq!(outcome.not_fused, 0);
        }
        let row = row(&outcomes);
        println!("{:14} {row:.2?}", uses.name());
        row
    });
    assert!(band().contains(&batch.nees), "{batch:?}");
    // Of the same errors and the same nine legs.
    assert!(live.nees > batch.nees, "{live:?} {batch:?}");
    assert!(batch.last_m < 30.0);
}
