//! Stops of good units, found by the inertial unit alone: a drive with eleven stops, still at them and rocking.
//!
//! A unit's own noise says how quiet a body at rest may be at best. A good unit is quieter than any vehicle: what stands rocks in
//! the wind by a hundred times its noise.

mod simulated_drives;

use insnav::attitude::log;
use insnav::config::{Config, VehicleKind};
use insnav::imu::{ImuGrade, ImuNoise};
use insnav::navigator::Navigator;
use insnav::sim::{ImuErrorModel, NavigationDrive, Simulation};
use insnav::solution::{Epoch, Event, Motion, Sink};
use simulated_drives::over_seeds;

/// What a run says of stops: those that are over, and how fast it truly was in what was taken for one.
struct Found<'a> {
    truth: &'a Simulation,
    /// Begin and end, s after the start.
    stops: Vec<[f64; 2]>,
    fastest: f64,
}

impl Sink for Found<'_> {
    fn epoch(&mut self, epoch: &Epoch) {
        if let Motion::Stationary { .. } = epoch.motion {
            let truth = self.truth.truth_at(epoch.nav.time).nav;
            self.fastest = self.fastest.max(truth.velocity_n.norm());
        }
    }

    fn event(&mut self, event: &Event) {
        if let Event::StopEnded(stop) = event {
            let zero = self.truth.trajectory.start();
            self.stops
                .push([stop.begin, stop.end].map(|t| t.since(zero)));
        }
    }
}

fn drive(noise: ImuNoise, rocking: bool, legs: u32) -> NavigationDrive {
    NavigationDrive {
        legs,
        rocking,
        errors: ImuErrorModel::from_noise(noise),
        ..NavigationDrive::default()
    }
}

fn found<'a>(simulation: &'a Simulation, noise: ImuNoise, kind: VehicleKind) -> Found<'a> {
    let mut config = Config::default();
    config.vehicle.kind = kind;
    config.gnss.used = false;
    config.alignment.latitude_deg = Some(60.0);
    config.alignment.heading_deg = Some(45.0);
    config.alignment.heading_sigma_deg = Some(0.1);
    let mut navigator = Navigator::new(&config, noise).expect("valid");
    let mut sink = Found {
        truth: simulation,
        stops: Vec::new(),
        fastest: 0.0,
    };
    for sample in &simulation.samples {
        navigator.step(sample, &mut sink).expect("good samples");
    }
    navigator.finish(&mut sink).expect("a start at rest");
    sink
}

/// Every stop is one, and begins and ends within five seconds of the truth; the ends of the slow turn in place, which moves the body by a
/// thousandth of the turn in its first four seconds, within what turns it by less than a degree.
#[test]
fn every_stop_is_found_as_one() {
    let noise = [ImuGrade::Tactical, ImuGrade::Navigation].map(ImuGrade::noise);
    let cases = [(0, false), (0, true), (1, false), (1, true)];
    let failures = over_seeds(4, |i| {
        let (unit, rocking) = cases[i as usize];
        let noise = noise[unit];
        let drive = drive(noise, rocking, 9);
        let simulation = drive.scenario().simulate(1).expect("valid");
        let found = found(&simulation, noise, VehicleKind::Car);
        let rounded: Vec<[f64; 2]> = found.stops.iter().map(|s| s.map(f64::round)).collect();
        println!(
            "{cases:?}[{i}]: {rounded:?}, fastest {:.3} m/s",
            found.fastest
        );
        let mut wrong = Vec::new();
        if found.fastest >= 0.3 {
            wrong.push(format!("{} m/s", found.fastest));
        }
        let attitude = |t: f64| simulation.trajectory.after(t).nav.q_nb;
        let turned = |a: f64, b: f64| log(&(attitude(a).inverse() * attitude(b))).z.to_degrees();
        for stop in drive.stops() {
            let inside = |s: &&[f64; 2]| s[0] < stop.end_s && s[1] > stop.begin_s;
            let pieces: Vec<&[f64; 2]> = found.stops.iter().filter(inside).collect();
            let near = |edge: f64, at: f64| (edge - at).abs() < 5.0;
            let fits = match pieces[..] {
                [[begin, end]] => {
                    let turn = turned(*begin, stop.begin_s).abs() + turned(stop.end_s, *end).abs();
                    near(stop.begin_s, *begin) && near(stop.end_s, *end)
                        || (300.0..=360.0).contains(&stop.begin_s.min(stop.end_s)) && turn < 1.0
                        || stop.begin_s == 0.0 && near(0.0, *begin) && turn < 1.0
                }
                _ => false,
            };
            if !fits {
                wrong.push(format!("{stop:?}: {pieces:?}"));
            }
        }
        wrong
    });
    for (case, wrong) in cases.iter().zip(failures) {
        assert!(wrong.is_empty(), "{case:?}: {wrong:?}");
    }
}

/// What is known of wheels is not known of what floats or flies: there a good unit's noise decides, and nothing that rocks rests.
#[test]
fn what_may_float_has_no_leave_to_rock() {
    let noise = ImuGrade::Navigation.noise();
    let simulation = drive(noise, true, 1).scenario().simulate(1).expect("valid");
    assert!(found(&simulation, noise, VehicleKind::Any).stops.is_empty());
    assert!(!found(&simulation, noise, VehicleKind::Car).stops.is_empty());
}
