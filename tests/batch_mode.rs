//! Batch mode where a stop is no ordinary one: what is not fused is said, and nothing is lost.

use insnav::config::{Config, DetectorKind, Intervals, StationaryMode};
use insnav::imu::ImuNoise;
use insnav::navigator::Navigator;
use insnav::sample::{Heading, Sample};
use insnav::sim::{ImuOutput, NavigationDrive, Scenario, Simulation};
use insnav::solution::{Epoch, Event, NotFused, Sink};
use insnav::stationary::StopRecord;

#[derive(Default)]
struct Seen {
    stops: Vec<StopRecord>,
    not_fused: Vec<NotFused>,
    first: Option<Epoch>,
    last: Option<Epoch>,
}

impl Sink for Seen {
    fn epoch(&mut self, epoch: &Epoch) {
        self.first.get_or_insert(*epoch);
        self.last = Some(*epoch);
    }
    fn event(&mut self, event: &Event) {
        match event {
            Event::StopEnded(stop) => self.stops.push(*stop),
            Event::StopNotFused { reason, .. } => self.not_fused.push(*reason),
            _ => {}
        }
    }
}

fn noise() -> ImuNoise {
    NavigationDrive::errors(None).noise.expect("its noise")
}

/// A navigation-grade unit that stands for so long.
fn standing(duration_s: f64) -> Simulation {
    let mut scenario = Scenario::standing(duration_s, 70.0);
    scenario.imu.rate_hz = 20.0;
    scenario.imu.output = ImuOutput::Increments;
    scenario.imu.errors = NavigationDrive::errors(None);
    scenario.simulate(3).expect("a ready scenario")
}

fn config(simulation: &Simulation) -> Config {
    let mut config = Config::default();
    config.gnss.used = false;
    config.stationary.mode = StationaryMode::Batch;
    let place = simulation
        .truth_at(simulation.trajectory.start())
        .nav
        .position;
    config.alignment.latitude_deg = Some(place.latitude_deg());
    config
}

fn run(simulation: &Simulation, config: &Config, more: &[Sample]) -> Seen {
    let mut samples: Vec<Sample> = simulation
        .samples
        .iter()
        .copied()
        .filter(Sample::is_inertial)
        .chain(more.iter().copied())
        .collect();
    samples.sort_by_key(Sample::time);
    let mut navigator = Navigator::new(config, noise()).expect("settings in range");
    let mut seen = Seen::default();
    for sample in &samples {
        navigator.step(sample, &mut seen).expect("good samples");
    }
    navigator.finish(&mut seen).expect("good samples");
    seen
}

#[test]
fn a_long_stop_is_fused_in_pieces() {
    // Half an hour, and what is left is too short for a piece of its own.
    let simulation = standing(1820.0);
    let seen = run(&simulation, &config(&simulation), &[]);
    assert_eq!(seen.not_fused, []);
    let [stop] = seen.stops.as_slice() else {
        panic!("one stop: {:?}", seen.stops);
    };
    assert_eq!(stop.mode, StationaryMode::Batch);
    // The drift along east is not told from the heading, whatever the time: 0.02 °/h over Ω cos L.
    let truth = simulation.truth_at(simulation.trajectory.start()).nav;
    let horizontal = 15.041 * truth.position.latitude.cos();
    let limit = (0.02 / horizontal).to_degrees();
    let sigma = stop.sigma_heading_after.to_degrees();
    assert!((0.97..1.3).contains(&(sigma / limit)), "{sigma} {limit}");
    let [first, last] = [seen.first, seen.last].map(|e| e.expect("epochs").nav.position);
    let off = first.offset_to(&last).xy().norm();
    assert!(off < 1.0, "{off}");
}

#[test]
fn what_a_stop_cannot_tell_is_not_fused_and_that_is_said() {
    let simulation = standing(200.0);
    let usual = config(&simulation);
    let reasons = |config: &Config, more: &[Sample]| {
        let seen = run(&simulation, config, more);
        assert_eq!(seen.stops.len(), 1);
        let fused = seen.stops[0].mode == StationaryMode::Batch;
        assert_eq!(fused, seen.not_fused.is_empty());
        assert!(fused || seen.stops[0].mode == StationaryMode::Zupt);
        seen.not_fused
    };
    assert_eq!(reasons(&usual, &[]), []);

    let mut scaled = usual;
    scaled.imu.accel_scale_sigma_ppm = Some(300.0);
    assert_eq!(reasons(&scaled, &[]), [NotFused::Scale]);

    // Nobody tells the latitude: headings count from the start.
    let mut relative = usual;
    relative.alignment.latitude_deg = None;
    assert_eq!(reasons(&relative, &[]), [NotFused::RelativeHeading]);

    let mut elsewhere = usual;
    elsewhere.alignment.latitude_deg = usual.alignment.latitude_deg.map(|latitude| latitude - 8.0);
    let told = reasons(&elsewhere, &[]);
    assert!(
        matches!(told[..], [NotFused::Inconsistent { sigmas }] if sigmas > 20.0),
        "{told:?}"
    );

    let start = simulation.trajectory.start();
    let heading = simulation.truth_at(start).nav.q_nb.euler_angles().2;
    let antenna = Sample::Heading(Heading {
        time: start.plus(100.0),
        heading,
        sigma: 0.01,
    });
    assert_eq!(reasons(&usual, &[antenna]), [NotFused::Disturbed]);

    let mut declared = usual;
    declared.stationary.detector = DetectorKind::None;
    declared.stationary.intervals_s = Intervals::new(&[[60.0, 90.0]]).expect("an interval");
    let told = reasons(&declared, &[]);
    assert!(
        matches!(told[..], [NotFused::Refused(refusal)] if refusal.code() == "stop_too_short"),
        "{told:?}"
    );
}

/// A navigator that is put aside in the middle of a stop and taken up again goes on as one.
#[test]
fn a_stop_that_is_put_aside_is_fused_whole() {
    let simulation = standing(200.0);
    let config = config(&simulation);
    let whole = run(&simulation, &config, &[]).last.expect("epochs");
    let mut navigator = Navigator::new(&config, noise()).expect("settings in range");
    let mut seen = Seen::default();
    for (i, sample) in simulation
        .samples
        .iter()
        .filter(|s| s.is_inertial())
        .enumerate()
    {
        if i == 2400 {
            let bytes = postcard::to_stdvec(&navigator).expect("written");
            navigator = postcard::from_bytes(&bytes).expect("read");
        }
        navigator.step(sample, &mut seen).expect("good samples");
    }
    navigator.finish(&mut seen).expect("good samples");
    let parts = seen.last.expect("epochs");
    let apart = (parts.nav.q_nb.inverse() * whole.nav.q_nb).angle();
    assert!(apart < 1e-9, "{apart}");
    assert_eq!(seen.stops[0].mode, StationaryMode::Batch);
}
