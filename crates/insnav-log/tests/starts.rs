//! Starts of real drives: velocities alone, whichever way the vehicle looks, against the course that a car's heading is.

#[path = "recordings/mod.rs"]
mod recordings;

use insnav_core::alignment::HeadingSource;
use insnav_core::config::{Config, VehicleKind};
use insnav_log::{Log, Plan, ReadOptions, RunOptions, RunReport, convert};
use recordings::recording;

fn run(log: &Log, kind: VehicleKind) -> RunReport {
    let mut config = Config::default();
    config.vehicle.kind = kind;
    let plan = Plan::make(log, &config, &RunOptions::default()).unwrap();
    plan.execute(log, &mut ()).unwrap()
}

/// Both starts tell the same heading within three of their sigmas. That of the moving base is widened fivefold as a prior, and
/// is taken back here; what the unit is turned by in the vehicle is within the course's.
#[test]
fn velocities_and_course_tell_real_cars_the_same_heading() {
    let mut told = 0;
    for name in [
        "hipnuc_20220504",
        "kth_skog_car",
        "rtkexp_drive_0708",
        "comma2k19_example1",
    ] {
        let Some(source) = recording(name) else {
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let inputs = convert::CsvInputs::in_folder(&source).unwrap();
        convert::csv_to_mcap(&inputs, &path, &Default::default()).unwrap();
        let log = Log::open(&path, ReadOptions::default()).unwrap();
        let car = run(&log, VehicleKind::Car).alignment.unwrap();
        let any = run(&log, VehicleKind::Any).alignment.unwrap();
        println!(
            "{name}: {:?} {:.2} ± {:.2}° at {:.1} s; {:?} {:.2} ± {:.2}° (as a prior {:.2}°) at {:.1} s",
            car.heading_source,
            car.heading_deg,
            car.sigma_heading_deg,
            car.heading_at_s,
            any.heading_source,
            any.heading_deg,
            any.sigma_heading_deg / 5.0,
            any.sigma_heading_deg,
            any.heading_at_s
        );
        if any.heading_source != HeadingSource::MovingBase {
            continue;
        }
        told += 1;
        let apart = (any.heading_deg - car.heading_deg + 180.0).rem_euclid(360.0) - 180.0;
        let sigma = car.sigma_heading_deg.hypot(any.sigma_heading_deg / 5.0);
        assert!(
            apart.abs() < 3.0 * sigma,
            "{name}: {apart}° apart, sigma {sigma}°"
        );
    }
    assert!(told >= 2, "{told}");
}
