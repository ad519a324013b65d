//! Q and R of an attitude filter from its own innovations: the experiment of [Belokurov18] with its errors corrected, on a simulated
//! ADIS16405. All variants see the same samples. `INSNAV_LONG=1` makes 100 runs of each case.

mod simulated_drives;

use insnav::metrics::Estimate;
use insnav::sim::{AttitudeCase, AttitudeErrors, AttitudeRecord, AttitudeTrial, AttitudeVariant};
use simulated_drives::over_seeds;

fn runs() -> u64 {
    if std::env::var("INSNAV_LONG").is_ok_and(|v| v == "1") {
        100
    } else {
        20
    }
}

/// Errors of the variants, by run.
fn made<const N: usize>(
    case: AttitudeCase,
    variants: [AttitudeVariant; N],
) -> Vec<[AttitudeErrors; N]> {
    over_seeds(runs(), |seed| {
        let record = AttitudeRecord::simulate(case, seed);
        let trial = AttitudeTrial::new(&record);
        variants.map(|variant| trial.run(variant).expect("stable loops"))
    })
}

/// Root mean square of pitch (0) or roll (1) over all runs, degrees.
fn rms<const N: usize>(runs: &[[AttitudeErrors; N]], variant: usize, angle: usize) -> f64 {
    let squares: Vec<f64> = runs
        .iter()
        .map(|run| run[variant].rms.expect("simulated")[angle].powi(2))
        .collect();
    Estimate::root_mean_square(&squares).value.to_degrees()
}

/// Root mean square of a tilt over a run, rad.
fn tilt(errors: &AttitudeErrors) -> f64 {
    let [pitch, roll, _] = errors.rms.expect("simulated");
    (0.5 * (pitch * pitch + roll * roll)).sqrt()
}

fn accepted<const N: usize>(runs: &[[AttitudeErrors; N]], variant: usize) -> f64 {
    let counts = runs
        .iter()
        .map(|run| run[variant].accepted.expect("a monitor"));
    let [accepted, all] = counts.fold([0, 0], |sum, c| [sum[0] + c[0], sum[1] + c[1]]);
    f64::from(accepted) / f64::from(all)
}

const CALM: [AttitudeCase; 4] = [
    AttitudeCase::Static,
    AttitudeCase::StaticQuantised,
    AttitudeCase::Motion6Dps,
    AttitudeCase::Motion40Dps,
];

/// Against the truth, raw over filtered: four at least on pitch and on roll, at rest and turning, of 4.3 that are possible with a
/// diagonal R; the paper has 1.8 and 3.8 in standard deviations, at rest. Blocks of forty: 3.5. With the start wrong by a hundred
/// as near to the best as with the right one.
#[test]
fn errors_are_a_quarter_of_the_raw_angles_on_both_axes_and_in_motion() {
    use AttitudeVariant::{AlsLong, AlsM40Nnls, AlsMonitor, AlsMonitorQX100, Oracle, Raw};
    for case in CALM {
        let runs = made(
            case,
            [
                Raw,
                Oracle,
                AlsM40Nnls,
                AlsLong,
                AlsMonitor,
                AlsMonitorQX100,
            ],
        );
        for (angle, name) in ["pitch", "roll"].into_iter().enumerate() {
            let [raw, oracle, blocks, long, monitor, late] =
                [0, 1, 2, 3, 4, 5].map(|variant| rms(&runs, variant, angle));
            let std = |variant: usize| {
                let of = |e: &AttitudeErrors| [e.pitch_std, e.roll_std][angle];
                let squares: Vec<f64> = runs.iter().map(|run| of(&run[variant]).powi(2)).collect();
                Estimate::root_mean_square(&squares).value.to_degrees()
            };
            println!(
                "{case:?} {name}: raw {raw:.4}, monitor {monitor:.4} ({:.2}), long {long:.4}, M = 40 {blocks:.4} ({:.2}), start x100 {late:.4}, oracle {oracle:.4}; std {:.4} {:.4}",
                raw / monitor,
                raw / blocks,
                std(0),
                std(4)
            );
            assert!(raw / monitor >= 4.0 && raw / long >= 4.0, "{case:?} {name}");
            assert!(raw / blocks >= 3.5, "{case:?} {name}: {}", raw / blocks);
            assert!(monitor <= 1.03 * oracle, "{case:?} {name}");
            // From a Q a hundred times too large: the first block of 12.8 s mends it at 33 s, after three seconds that count.
            assert!(late <= 1.1 * oracle, "{case:?} {name}");
        }
        let share = accepted(&runs, 4);
        assert!(share >= 0.95, "{case:?}: {share}");
    }
}

/// A gain is claimed against the data sheet where it is wrong: five times the accelerometer noise for 100 s. Blocks are accepted, R
/// is told as it is (10.6 in the mean over the record), and a gate with the data sheet's R loses.
#[test]
fn vibration_is_measured_and_filtered() {
    use AttitudeVariant::{AlsLong, AlsMonitor, Datasheet, DatasheetGated, Oracle};
    let runs = made(
        AttitudeCase::Vibration,
        [Datasheet, DatasheetGated, AlsLong, AlsMonitor, Oracle],
    );
    for angle in 0..2 {
        let [sheet, gated, long, monitor, oracle] =
            [0, 1, 2, 3, 4].map(|variant| rms(&runs, variant, angle));
        println!(
            "data sheet {sheet:.4}, gated {gated:.4}, long {long:.4}, monitor {monitor:.4}, oracle {oracle:.4}"
        );
        assert!(long <= 0.95 * sheet && monitor <= 0.95 * sheet);
        assert!(monitor <= 0.95 * gated && oracle < monitor);
    }
    for variant in [2, 3] {
        let told: Vec<f64> = runs.iter().map(|run| run[variant].noise_ratio[1]).collect();
        let told = Estimate::mean(&told).value;
        println!("R over the data sheet's {told:.2}");
        assert!((5.0..=12.0).contains(&told), "{told}");
    }
    assert!(accepted(&runs, 3) >= 0.9, "{}", accepted(&runs, 3));
}

/// Pushes of 0.3 and 1 m/s², from before the filters have converged. Nothing is accepted, so that no seed is worse than the data
/// sheet behind the same gate, and no seed is lost for ten seconds. Controls: least squares that believe everything take pushes
/// for process noise, and the plain gate locks out.
#[test]
fn pushes_are_no_process_noise_and_lock_nobody_out() {
    use AttitudeVariant::{AlsLong, AlsMonitor, Datasheet, DatasheetGated, DatasheetPlainGate};
    for case in [AttitudeCase::Bursts0p3, AttitudeCase::Bursts1p0] {
        let runs = made(
            case,
            [
                Datasheet,
                DatasheetGated,
                DatasheetPlainGate,
                AlsLong,
                AlsMonitor,
            ],
        );
        let share = accepted(&runs, 4);
        let lost = |variant: usize| {
            let of = |run: &[AttitudeErrors; 5]| run[variant].longest_lost_s;
            runs.iter().map(of).fold(0.0, f64::max)
        };
        println!(
            "{case:?}: accepted {:.1} %, lost for {:.1} s (monitor), {:.1} s (data sheet, gated), {:.1} s (plain gate); rms {:.4} {:.4} {:.4}",
            100.0 * share,
            lost(4),
            lost(1),
            lost(2),
            rms(&runs, 4, 0),
            rms(&runs, 1, 0),
            rms(&runs, 0, 0)
        );
        assert!(share <= 0.05, "{case:?}: {share}");
        for (seed, run) in runs.iter().enumerate() {
            let (monitor, gated) = (tilt(&run[4]), tilt(&run[1]));
            assert!(
                monitor <= 1.05 * gated,
                "{case:?} {seed}: {monitor} {gated}"
            );
            // A push before the gate is armed is followed until it ends: two seconds.
            for variant in [1, 4] {
                let lost = run[variant].longest_lost_s;
                assert!(lost < 10.0, "{case:?} {seed}: {lost}");
            }
            assert!(run[3].noise_ratio[0] > 20.0, "{case:?} {seed}");
            assert!(tilt(&run[3]) > tilt(&run[0]), "{case:?} {seed}");
            // The gate is worth a factor of five and more.
            assert!(5.0 * monitor < tilt(&run[0]), "{case:?} {seed}");
        }
        if case == AttitudeCase::Bursts0p3 {
            let locked_out = runs.iter().filter(|run| run[2].longest_lost_s > 60.0);
            let share = locked_out.count() as f64 / runs.len() as f64;
            println!(
                "plain gate locked out in {:.0} % of the runs",
                100.0 * share
            );
            assert!(share > 0.02, "{share}");
        }
    }
}

/// A tenth of the Earth's field for 30 s: the heading is kept by length and dip of the field, and by its own gate; the tilt is that
/// of a filter without iron near.
#[test]
fn iron_does_not_reach_the_tilt() {
    use AttitudeVariant::{AlsMonitor, Datasheet};
    let disturbed = made(AttitudeCase::MagneticStep, [Datasheet, AlsMonitor]);
    let calm = made(AttitudeCase::Static, [Datasheet, AlsMonitor]);
    for (a, b) in disturbed.iter().zip(&calm) {
        // The same samples but for the field: to a few parts in a thousand the same tilt.
        let (a, b) = (tilt(&a[1]), tilt(&b[1]));
        assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
    }
    let (kept, without) = (rms(&disturbed, 1, 2), rms(&disturbed, 0, 2));
    println!("heading {kept:.3}° with gates, {without:.3}° without");
    // Without a field for 30 s: 0.033 °/√s and a bias to 0.006 °/s.
    assert!(kept < 0.25 && without > 2.0, "{kept} {without}");
}

/// The comparison that the paper does not make: Mohamed and Schwarz' Q with the true R is better than with a tenth of it, which has
/// the scatter of the raw angle (the 0.11° to 0.13° that were published for it), and Q and R from one window degenerate.
#[test]
fn what_was_published_for_the_known_algorithm_is_the_raw_angle() {
    use AttitudeVariant::{
        Datasheet, MohamedSchwarzFair, MohamedSchwarzQAndR, MohamedSchwarzROver10, Oracle,
        OracleFullR, PaperRecursion, QX100, Raw,
    };
    let runs = made(
        AttitudeCase::Static,
        [
            Raw,
            MohamedSchwarzROver10,
            MohamedSchwarzFair,
            PaperRecursion,
            MohamedSchwarzQAndR,
            QX100,
            Datasheet,
            Oracle,
            OracleFullR,
        ],
    );
    for angle in 0..2 {
        let [
            raw,
            tenth,
            fair,
            recursion,
            both,
            large,
            sheet,
            oracle,
            full,
        ] = [0, 1, 2, 3, 4, 5, 6, 7, 8].map(|variant| rms(&runs, variant, angle));
        println!(
            "raw {raw:.4}, R/10 {tenth:.4}, fair {fair:.4}, recursion {recursion:.4}, both {both:.4}, Q x100 {large:.4}, data sheet {sheet:.4}, oracle {oracle:.4}, whole R {full:.4}"
        );
        assert!(tenth > 0.9 * raw && fair < 0.75 * tenth);
        assert!(recursion > 2.0 * oracle && both > 1.3 * oracle);
        // The paper's ALS pitch of 0.061°.
        assert!((0.050..0.062).contains(&large), "{large}");
        assert!(
            (sheet / oracle - 1.0).abs() < 1e-9,
            "the data sheet is the truth here"
        );
        // What a diagonal R leaves unused: the dip.
        assert!(full < 0.95 * oracle);
    }
    let trial = AttitudeRecord::simulate(AttitudeCase::Static, 1);
    let limit = AttitudeTrial::new(&trial).limit().expect("a magnetometer");
    let found = Estimate::root_mean_square(
        &runs
            .iter()
            .map(|run| tilt(&run[8]).powi(2))
            .collect::<Vec<_>>(),
    );
    // Three standard errors of the mean over the runs.
    let error = 3.0 * found.standard_error.expect("several runs");
    assert!((found.value - limit).abs() < error, "{found:?} {limit}");
}
