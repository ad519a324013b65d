//! The demonstration, end to end.

use crate::fixture::{Folder, insnav_json};

#[test]
fn it_runs_without_anything_and_its_errors_fit_its_sigmas() {
    let folder = Folder::new();
    let done = insnav_json(["demo", "--dir", &folder.text("demo")]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    for name in [
        "drive.mcap",
        "drive.insnav.mcap",
        "drive.truth.csv",
        "car.toml",
    ] {
        assert!(folder.path("demo").join(name).is_file(), "{name}");
    }
    let c = &json["comparison"];
    for quantity in ["position", "velocity", "attitude"] {
        let nees = c["all"]["nees"][quantity].as_f64().unwrap();
        // One run holds some tens of independent errors (three components, correlated over minutes): the 99.9 % band of a
        // mean of 20 unit chi-squares is 0.28 to 2.3.
        assert!(nees > 0.28 && nees < 2.3, "{quantity}: {nees}");
    }
    let rms = |class: &str| c[class]["horizontal_rms_m"].as_f64().unwrap();
    assert!(rms("withheld") > rms("standing"), "outages cost accuracy");
    assert!(c["all"]["count"].as_u64().unwrap() > 7000);
    assert!(json["run"]["stops"].as_array().unwrap().len() > 3);
}

#[test]
fn a_folder_that_cannot_be_made_is_said() {
    let folder = Folder::new();
    std::fs::write(folder.path("file"), "").unwrap();
    insnav_json(["demo", "--dir", &folder.text("file/demo")]).failed(1, "output_not_writable");
}
