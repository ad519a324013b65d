//! `--noise-adapt als` on real drives: what is kept from the filter is met no worse than without.

use crate::recording::{Recording, number};
use serde_json::Value;

fn does_no_harm(name: &str, length_s: f64, settings: &[&'static str]) {
    let Some(drive) = Recording::open(name, length_s, settings) else {
        return;
    };
    let half = |how: &str| -> (Value, f64, f64) {
        let (report, out) = drive.run(&["--withhold", "every:2", "--noise-adapt", how]);
        let withheld = &drive.compare(&out, "gnss.csv.gz", &[])["withheld"];
        let [horizontal, height] =
            ["horizontal_rms_m", "height_rms_m"].map(|key| number(&withheld[key]));
        (report, horizontal, height)
    };
    let (_, off, off_height) = half("off");
    let (report, als, als_height) = half("als");
    println!(
        "{name}: withheld fixes {off:.4} / {off_height:.4} m, adapted {als:.4} / {als_height:.4} m"
    );
    let numbers = report["noise_adaptation"].as_array().expect("a list");
    for n in numbers {
        println!("  {n}");
    }
    assert_eq!(numbers.len(), 4);
    // A twentieth: what the choice of fixes does to such a mean.
    assert!(als <= 1.05 * off && als_height <= 1.05 * off_height);
}

#[test]
fn rtkexp_drive() {
    does_no_harm(
        "rtkexp_drive_0708",
        548.0,
        &["gnss.lever_arm_b_m=[0.0, -0.05, 0.0]"],
    );
}

#[test]
fn hipnuc_drive() {
    does_no_harm("hipnuc_20220504", 773.0, &[]);
}
