//! GNSS positions whose error wanders: with states of its own the filter knows how wrong its position is, with white noise of
//! the same size it does not ([BarShalom01] section 5.4, [Groves13] section 3.4.3).

mod simulated_drives;

use insnav::config::ColourConfig;
use insnav::filter::{Eskf, GNSS_COLOUR};
use insnav::sample::Sample;
use insnav::sim::{Scenario, Truth};
use nalgebra::{Matrix3, Vector3};
use simulated_drives::{
    covariance, drive, mean, motion_nees, nees, over_seeds, settings, unchanged,
};

const SEEDS: u64 = 50;
const DURATION_S: f64 = 600.0;
/// The wandering part: a third of what a single-frequency receiver shows, over a minute.
const COLOUR: ColourConfig = ColourConfig {
    sigma_m: 1.0,
    vertical_sigma_m: None,
    tau_s: 60.0,
};
const WHITE_M: f64 = 0.3;

fn scenario() -> Scenario {
    let mut scenario = simulated_drives::scenario(DURATION_S);
    scenario.gnss.position_sigma_m = [WHITE_M; 3];
    scenario.gnss.position_colour_sigma_m = [COLOUR.sigma_m; 3];
    scenario.gnss.position_colour_tau_s = COLOUR.tau_s;
    scenario
}

/// The simulated receiver states the whole error; the part that has states of its own is no noise.
fn state_the_white_part(sample: &mut Sample) {
    if let Sample::GnssPosition(fix) = sample {
        fix.covariance_n = Some(Matrix3::from_diagonal_element(WHITE_M * WHITE_M));
    }
}

#[test]
fn taken_as_white_the_filter_is_surer_than_it_may_be() {
    let scenario = scenario();
    // The whole variance is stated, and taken as white.
    let [position] = mean(over_seeds(SEEDS, |seed| {
        let mut rows = Vec::new();
        drive(
            &scenario,
            seed,
            &settings(),
            unchanged,
            |_, filter, truth| {
                rows.push([motion_nees(filter, truth)[0]]);
            },
        );
        mean(rows)
    }));
    println!("NEES/dof: position {position:.2}");
    assert!(position > 3.0, "{position}");
}

/// The position, and the colour itself: their sum is what fixes show, which part is which only time tells. The filter must know
/// how well it knows either.
#[test]
fn with_colour_states_the_filter_knows_how_wrong_it_is() {
    let scenario = scenario();
    let mut config = settings();
    config.gnss.colour = Some(COLOUR);
    let found = over_seeds(SEEDS, |seed| {
        let errors = errors_of_fixes(&scenario, seed);
        let (mut motion, mut colour) = (Vec::new(), Vec::new());
        let look = |since: f64, filter: &Eskf, truth: &Truth| {
            motion.push(motion_nees(filter, truth));
            if since > 60.0 && since < DURATION_S - 10.0 {
                // The simulation keeps the colour to itself: the mean over ten fixes leaves 0.1 m of white noise, against 1 m.
                let near = errors.iter().filter(|(t, _)| (t - since).abs() <= 5.0);
                let around =
                    near.clone().map(|(_, e)| e).sum::<Vector3<f64>>() / near.count() as f64;
                let error = around - filter.nominal().calibration.gnss_colour_n;
                colour.push([nees(&error, &covariance(filter, GNSS_COLOUR))]);
            }
        };
        drive(&scenario, seed, &config, state_the_white_part, look);
        (mean(motion), mean(colour))
    });
    let [position, velocity, attitude] = mean(found.iter().map(|f| f.0));
    let [colour] = mean(found.iter().map(|f| f.1));
    println!(
        "NEES/dof: position {position:.3}, velocity {velocity:.3}, attitude {attitude:.3}, colour {colour:.3}"
    );
    // Five correlation times in a drive's ten minutes leave 50 · 3 · 5 independent squares: 1 ± 0.05. Velocity and attitude have
    // many more.
    assert!((0.8..=1.25).contains(&position), "{position}");
    assert!((0.85..=1.18).contains(&velocity), "{velocity}");
    assert!((0.85..=1.18).contains(&attitude), "{attitude}");
    // As the position's, and the ten seconds' mean stands for the instant.
    assert!((0.75..=1.3).contains(&colour), "{colour}");
}

/// Seconds since the start and errors of all positions, white and coloured together.
fn errors_of_fixes(scenario: &Scenario, seed: u64) -> Vec<(f64, Vector3<f64>)> {
    let simulation = scenario.simulate(seed).expect("a ready scenario");
    let begin = simulation.trajectory.start();
    let error = |s: &Sample| {
        let Sample::GnssPosition(fix) = s else {
            return None;
        };
        let truth = simulation.truth_at(fix.time).nav.position;
        Some((fix.time.since(begin), truth.offset_to(&fix.position)))
    };
    simulation.samples.iter().filter_map(error).collect()
}
