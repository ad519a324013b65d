//! What a navigator promises whatever the order, timing and health of its samples.

use insnav::config::Config;
use insnav::earth::Geodetic;
use insnav::error::Error;
use insnav::filter::{InitialSigma, Update, Verdict};
use insnav::imu::{ImuErrors, ImuGrade};
use insnav::mechanization::NavState;
use insnav::navigator::Navigator;
use insnav::sample::{GnssPosition, Heading, ImuSample, Sample};
use insnav::sim::{GnssModel, ImuErrorModel, ImuOutput, Scenario, Simulation};
use insnav::solution::{Epoch, Event, Sink};
use insnav::time::Time;
use nalgebra::{Matrix3, Vector3};

/// Everything that came out.
#[derive(Clone, Debug, Default, PartialEq)]
struct Record {
    epochs: Vec<Epoch>,
    updates: Vec<Update>,
    events: Vec<Event>,
}

impl Sink for Record {
    fn epoch(&mut self, epoch: &Epoch) {
        self.epochs.push(*epoch);
    }
    fn update(&mut self, update: &Update) {
        self.updates.push(*update);
    }
    fn event(&mut self, event: &Event) {
        self.events.push(*event);
    }
}

/// A drive that begins at speed, with a consumer-grade unit and position and velocity at 5 Hz.
fn drive(duration_s: f64, imu_rate_hz: f64, output: ImuOutput) -> Simulation {
    let mut scenario = Scenario::car_drive(duration_s + 60.0);
    // Without the minute of standing.
    scenario.drive.legs.remove(0);
    scenario.duration_s = duration_s;
    scenario.imu.rate_hz = imu_rate_hz;
    scenario.imu.output = output;
    scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Consumer.noise());
    scenario.gnss = GnssModel {
        position_rate_hz: 5.0,
        velocity_rate_hz: 5.0,
        lever_arm_b_m: LEVER_ARM,
        ..GnssModel::default()
    };
    scenario.simulate(4).expect("a ready scenario")
}

const LEVER_ARM: [f64; 3] = [0.8, -0.4, -1.2];

fn config() -> Config {
    let mut config = Config::default();
    config.gnss.lever_arm_b_m = Some(LEVER_ARM);
    config
}

fn sigma() -> InitialSigma {
    InitialSigma {
        position: Vector3::repeat(2.0),
        velocity: Vector3::repeat(0.2),
        attitude: Vector3::new(0.01, 0.01, 0.05),
        gyro_bias: Vector3::repeat(ImuGrade::Consumer.noise().gyro_bias_sigma),
        accel_bias: Vector3::repeat(ImuGrade::Consumer.noise().accel_bias_sigma),
    }
}

fn started_at(nav: NavState) -> Navigator {
    let noise = ImuGrade::Consumer.noise();
    Navigator::aligned(&config(), noise, nav, ImuErrors::default(), &sigma())
        .expect("valid settings")
}

fn start(simulation: &Simulation) -> Navigator {
    started_at(simulation.truth_at(simulation.trajectory.start()).nav)
}

fn feed<'a>(
    navigator: &mut Navigator,
    samples: impl IntoIterator<Item = &'a Sample>,
    record: &mut Record,
) {
    for sample in samples {
        navigator.step(sample, record).expect("good samples");
    }
}

fn run<'a>(mut navigator: Navigator, samples: impl IntoIterator<Item = &'a Sample>) -> Record {
    let mut record = Record::default();
    feed(&mut navigator, samples, &mut record);
    navigator.finish(&mut record).expect("good samples");
    record
}

fn restored(navigator: &Navigator) -> Navigator {
    let bytes = postcard::to_stdvec(navigator).expect("plain data");
    postcard::from_bytes(&bytes).expect("just written")
}

#[test]
fn a_saved_and_restored_run_is_bit_identical() {
    for output in [ImuOutput::Rates, ImuOutput::Increments] {
        let simulation = drive(20.0, 100.0, output);
        let whole = run(start(&simulation), &simulation.samples);
        assert_eq!(whole.epochs.len(), 2001);
        assert_eq!(whole.updates.len(), 2 * 101);
        for cut in [0, 1, 17, 700, 1234, simulation.samples.len()] {
            let mut record = Record::default();
            let mut first = start(&simulation);
            feed(&mut first, &simulation.samples[..cut], &mut record);
            let mut second = restored(&first);
            feed(&mut second, &simulation.samples[cut..], &mut record);
            second.finish(&mut record).expect("good samples");
            assert!(record == whole, "cut at {cut}");
        }
    }
}

/// The same while the navigator still looks for a start, with velocities whose Down component is NaN.
#[test]
fn a_run_saved_before_its_start_is_bit_identical() {
    let mut simulation = drive(40.0, 50.0, ImuOutput::Rates);
    for sample in &mut simulation.samples {
        if let Sample::GnssVelocity(v) = sample {
            v.velocity_n.z = f64::NAN;
        }
    }
    let fresh = || Navigator::new(&config(), ImuGrade::Consumer.noise()).expect("valid settings");
    let whole = run(fresh(), &simulation.samples);
    assert!(matches!(whole.events[0], Event::Started(_)));
    assert!(
        whole.updates.iter().any(|u| u.dof == 2),
        "horizontal velocities were used"
    );
    for cut in [1, 40, 200, 1500] {
        let mut record = Record::default();
        let mut first = fresh();
        feed(&mut first, &simulation.samples[..cut], &mut record);
        let mut second = restored(&first);
        assert_eq!(second.filter().is_some(), first.filter().is_some());
        feed(&mut second, &simulation.samples[cut..], &mut record);
        second.finish(&mut record).expect("good samples");
        assert!(record == whole, "cut at {cut}");
    }
}

#[test]
fn late_aiding_within_the_horizon_changes_nothing() {
    let simulation = drive(20.0, 100.0, ImuOutput::Rates);
    let in_order = run(start(&simulation), &simulation.samples);
    // Positions 0.31 s late, velocities 0.45 s: each behind the inertial samples of that time, and behind one another.
    let mut late: Vec<(Time, Sample)> = simulation
        .samples
        .iter()
        .map(|s| {
            let latency = match s {
                Sample::GnssPosition(_) => 0.45,
                Sample::GnssVelocity(_) => 0.31,
                _ => 0.0,
            };
            (s.time().plus(latency), *s)
        })
        .collect();
    late.sort_by_key(|(arrival, _)| *arrival);
    assert!(late.iter().map(|(_, s)| s).ne(&simulation.samples));
    let record = run(start(&simulation), late.iter().map(|(_, s)| s));
    assert!(record == in_order);
}

#[test]
fn what_comes_after_the_horizon_is_told_and_not_used() {
    let simulation = drive(10.0, 100.0, ImuOutput::Rates);
    let (late, others): (Vec<Sample>, Vec<Sample>) = simulation.samples.iter().partition(|s| {
        matches!(s, Sample::GnssPosition(_)) && s.time() == simulation.trajectory.start().plus(3.0)
    });
    let without = run(start(&simulation), &others);
    let mut record = Record::default();
    let mut navigator = start(&simulation);
    for sample in &others {
        navigator.step(sample, &mut record).expect("good samples");
        if sample.is_inertial() && sample.time() == simulation.trajectory.start().plus(5.0) {
            navigator
                .step(&late[0], &mut record)
                .expect("late is no error");
        }
    }
    navigator.finish(&mut record).expect("good samples");
    assert_eq!(late.len(), 1);
    // The tail is one second behind the head.
    let expected = Event::TooLate {
        time: late[0].time(),
        filter: simulation.trajectory.start().plus(4.0),
    };
    assert_eq!(record.events, [expected]);
    assert_eq!(record.epochs, without.epochs);
    assert_eq!(record.updates, without.updates);
}

/// An exact fix of a body that moves at constant speed: its residual is what the state is off by at that instant.
fn exact_fix(simulation: &Simulation, time: Time) -> Sample {
    let nav = simulation.trajectory.at(time).nav;
    Sample::GnssPosition(GnssPosition {
        time,
        position: nav.position.offset(&(nav.q_nb * Vector3::from(LEVER_ARM))),
        covariance_n: Some(Matrix3::identity()),
    })
}

#[test]
fn aiding_is_used_at_its_instant() {
    // Error-free increments at 10 Hz, so that 50 ms of mistaken time are half a metre and more.
    let mut scenario = Scenario::car_drive(120.0);
    scenario.drive.legs.remove(0);
    scenario.duration_s = 30.0;
    scenario.drive.speed_m_per_s = 12.0;
    scenario.drive.body = Default::default();
    scenario.imu.rate_hz = 10.0;
    scenario.imu.output = ImuOutput::Increments;
    scenario.imu.errors = ImuErrorModel::default();
    scenario.gnss.position_rate_hz = 0.0;
    scenario.gnss.velocity_rate_hz = 0.0;
    let simulation = scenario.simulate(0).expect("a ready scenario");
    let begin = simulation.trajectory.start();
    let mut samples = simulation.samples.clone();
    // At the start, at a stamp, between stamps, a nanosecond beside a stamp.
    let instants = [0.0, 3.0, 3.05, 7.123, 9.999_999_999, 15.1].map(|t| begin.plus(t));
    for time in instants {
        samples.push(exact_fix(&simulation, time));
    }
    samples.sort_by_key(|s| (s.time(), !s.is_inertial()));
    let record = run(start(&simulation), &samples);
    assert!(record.updates.iter().map(|u| u.time).eq(instants));
    for update in &record.updates {
        let off = update.residual.iter().fold(0.0f64, |a, r| a.max(r.abs()));
        // Linear within an interval of 100 ms: what a force that changes by 1 m/s² leaves is ⅛ of 1 m/s² × (0.1 s)².
        assert!(off < 2e-3, "{update:?}");
    }
    // The epoch at the instant of a fix is the one after its update.
    let epoch = record
        .epochs
        .iter()
        .find(|e| e.nav.time == begin.plus(3.0))
        .expect("a stamp");
    let before = record
        .epochs
        .iter()
        .rfind(|e| e.nav.time < begin.plus(3.0))
        .expect("a stamp");
    assert!(epoch.covariance[(0, 0)] < 0.9 * before.covariance[(0, 0)]);
    assert_eq!(record.epochs.len(), simulation.samples.len());
}

#[test]
fn aiding_before_the_start_is_told_and_not_used() {
    let simulation = drive(5.0, 100.0, ImuOutput::Rates);
    let whole = run(start(&simulation), &simulation.samples);
    let early = exact_fix(&simulation, simulation.trajectory.start().plus(-0.02));
    let record = run(
        start(&simulation),
        std::iter::once(&early).chain(&simulation.samples),
    );
    assert_eq!(
        record.events,
        [Event::TooLate {
            time: early.time(),
            filter: simulation.trajectory.start()
        }]
    );
    assert_eq!(record.epochs, whole.epochs);
}

/// A start between two samples takes the rest of that interval and nothing of what lies before.
#[test]
fn a_start_between_samples_begins_there() {
    let mut scenario = Scenario::car_drive(120.0);
    scenario.drive.legs.remove(0);
    scenario.duration_s = 20.0;
    scenario.imu.rate_hz = 50.0;
    scenario.imu.output = ImuOutput::Increments;
    scenario.imu.errors = ImuErrorModel::default();
    scenario.gnss.position_rate_hz = 0.0;
    scenario.gnss.velocity_rate_hz = 0.0;
    let simulation = scenario.simulate(0).expect("a ready scenario");
    for after in [6.0, 6.013] {
        let at = simulation.trajectory.start().plus(after);
        let record = run(started_at(simulation.truth_at(at).nav), &simulation.samples);
        let first = record.epochs.first().expect("epochs follow");
        assert!(first.nav.time >= at && first.nav.time.since(at) < 0.02);
        let last = record.epochs.last().expect("epochs follow");
        let truth = simulation.truth_at(last.nav.time).nav;
        // A cut assumes constant rates within its interval: the swaying body's 0.5 rad/s² leave ⅛ × 0.5 × (0.02 s)² of tilt,
        // 25 mm after 14 s. The 13 ms before the start would be 150 mm at once.
        let off = last.nav.position.offset_to(&truth.position).norm();
        assert!(off < 0.05, "{off} m from a start {after} s into the drive");
    }
}

#[test]
fn duplicates_and_nan_are_told_and_change_nothing() {
    let simulation = drive(10.0, 100.0, ImuOutput::Rates);
    let clean = run(start(&simulation), &simulation.samples);
    let mut samples = Vec::new();
    let mut expected = Vec::new();
    for (i, sample) in simulation.samples.iter().enumerate() {
        samples.push(*sample);
        let mut bad = *sample;
        match &mut bad {
            Sample::Imu(s) if i % 50 == 7 => s.angular_rate_b.y = f64::NAN,
            Sample::Imu(s) if i % 50 == 9 => s.specific_force_b.x = f64::INFINITY,
            // The same stamp again, with other values.
            Sample::Imu(s) if i % 50 == 11 => s.specific_force_b.x += 1.0,
            Sample::GnssPosition(s) if i % 2 == 0 => s.position.latitude = f64::NAN,
            Sample::GnssVelocity(s) if i % 2 == 0 => s.velocity_n.x = f64::NAN,
            _ => continue,
        }
        samples.push(bad);
        expected.push(match (&bad, i % 50) {
            (Sample::Imu(s), 11) => Event::DuplicateImu { time: s.time },
            (Sample::Imu(s), 7) => Event::NotFinite {
                time: s.time,
                what: "angular rate",
            },
            (Sample::Imu(s), _) => Event::NotFinite {
                time: s.time,
                what: "specific force",
            },
            (Sample::GnssPosition(s), _) => Event::NotFinite {
                time: s.time,
                what: "GNSS position",
            },
            (other, _) => Event::NotFinite {
                time: other.time(),
                what: "GNSS velocity",
            },
        });
    }
    assert!(expected.len() > 80);
    let record = run(start(&simulation), &samples);
    assert_eq!(record.events, expected);
    assert_eq!(record.epochs, clean.epochs);
    assert_eq!(record.updates, clean.updates);
}

#[test]
fn a_backward_stamp_is_an_error_that_names_both_times_and_does_no_harm() {
    let simulation = drive(10.0, 100.0, ImuOutput::Rates);
    let clean = run(start(&simulation), &simulation.samples);
    let mut navigator = start(&simulation);
    let mut record = Record::default();
    let begin = simulation.trajectory.start();
    for sample in &simulation.samples {
        navigator.step(sample, &mut record).expect("good samples");
        if sample.is_inertial() && sample.time() == begin.plus(6.0) {
            let old = sample.delayed(-3.0);
            let error = navigator
                .step(&old, &mut record)
                .expect_err("older than the horizon");
            assert_eq!(
                error,
                Error::ImuBackward {
                    previous: begin.plus(5.0),
                    time: begin.plus(3.0)
                }
            );
            let text = error.to_string();
            assert!(
                text.contains(&begin.plus(5.0).to_string())
                    && text.contains(&begin.plus(3.0).to_string()),
                "{text}"
            );
        }
    }
    navigator.finish(&mut record).expect("good samples");
    assert!(record == clean);
}

/// Inertial samples that change places within the horizon are put in order.
#[test]
fn swapped_inertial_samples_fall_into_place() {
    let simulation = drive(10.0, 100.0, ImuOutput::Rates);
    let clean = run(start(&simulation), &simulation.samples);
    let mut samples = simulation.samples.clone();
    for i in (30..samples.len() - 10).step_by(37) {
        samples.swap(i, i + 3);
    }
    assert!(run(start(&simulation), &samples) == clean);
}

/// More samples than the ring holds: they are used early, none is lost, and none is used twice.
#[test]
fn a_full_ring_loses_nothing() {
    let simulation = drive(4.0, 4000.0, ImuOutput::Rates);
    let record = run(start(&simulation), &simulation.samples);
    assert_eq!(record.epochs.len(), 16_001);
    assert!(record.epochs.is_sorted_by(|a, b| a.nav.time < b.nav.time));
    assert_eq!(record.updates.len(), 2 * 21);
    // A sample that is late within the delay but not within what the full ring still holds.
    let mut samples = simulation.samples.clone();
    let at = samples
        .iter()
        .position(|s| s.is_inertial() && s.time() == simulation.trajectory.start().plus(1.0))
        .expect("a stamp");
    let moved = samples.remove(at);
    samples.insert(at + 1600, moved);
    let mut navigator = start(&simulation);
    let mut record = Record::default();
    let errors: Vec<Error> = samples
        .iter()
        .filter_map(|s| navigator.step(s, &mut record).err())
        .collect();
    assert!(
        matches!(errors[..], [Error::ImuBackward { time, .. }] if time == moved.time()),
        "{errors:?}"
    );
    navigator.finish(&mut record).expect("good samples");
    assert_eq!(record.epochs.len(), 16_000);
}

/// Two seconds without inertial samples while the car drives: told, bridged, and honestly uncertain.
fn check_gap(output: ImuOutput) {
    let simulation = drive(30.0, 100.0, output);
    let begin = simulation.trajectory.start();
    let (from, to) = (begin.plus(12.0), begin.plus(14.0));
    let outside = |s: &&Sample| s.time() <= from || s.time() >= to;
    let no_aid = |s: &&Sample| s.is_inertial() || s.time() <= from;
    let kept = run(start(&simulation), simulation.samples.iter().filter(no_aid));
    let gap = run(
        start(&simulation),
        simulation.samples.iter().filter(outside).filter(no_aid),
    );
    assert_eq!(gap.events, [Event::ImuGap { from, to }]);
    let at = |r: &Record| {
        r.epochs
            .iter()
            .find(|e| e.nav.time == to)
            .cloned()
            .expect("a stamp")
    };
    let (with, without) = (at(&gap), at(&kept));
    for i in 0..9 {
        // On top of what is unknown without a gap, at least what the bridge states: 0.1 rad/s and 1 m/s² over two seconds
        // (to a thousandth: the body has turned otherwise in the gap).
        let least: f64 = [2.0, 2.0, 0.2][i / 3];
        let (with, without) = (with.covariance[(i, i)], without.covariance[(i, i)]);
        assert!(
            with >= 0.999 * (without + least.powi(2)),
            "state {i}: {with}, {without}"
        );
        // Not much more, but for what a tilt of 0.2 rad does to the others.
        let most: f64 = [5.0, 4.0, 0.2][i / 3];
        assert!(
            with < without + most.powi(2) * 1.05,
            "state {i}: {with}, {without}"
        );
    }
    let truth = simulation.truth_at(to).nav;
    let off = with.nav.position.offset_to(&truth.position);
    for i in 0..3 {
        assert!(off[i].abs() < 3.0 * with.covariance[(i, i)].sqrt(), "{off}");
    }
    // With fixes again, the way back is short.
    let back = run(
        start(&simulation),
        simulation.samples.iter().filter(outside),
    );
    let last = back.epochs.last().expect("epochs");
    let off = last
        .nav
        .position
        .offset_to(&simulation.truth_at(last.nav.time).nav.position);
    assert!(off.norm() < 4.0 * (0..3).map(|i| last.covariance[(i, i)]).sum::<f64>().sqrt());
}

#[test]
fn a_gap_widens_the_uncertainty() {
    check_gap(ImuOutput::Rates);
    // What a unit lost cannot be summed: without care, two seconds of gravity would be missing from its increments.
    check_gap(ImuOutput::Increments);
}

/// A unit that counts on over a gap in its messages lost nothing: its increment is used as it is.
#[test]
fn increments_summed_over_a_gap_are_used_in_full() {
    let simulation = drive(5.0, 100.0, ImuOutput::Increments);
    let begin = simulation.trajectory.start();
    let (from, to) = (begin.plus(1.0), begin.plus(1.3));
    let mut samples = Vec::new();
    let mut sum = (Vector3::zeros(), Vector3::zeros());
    for sample in simulation.samples.iter().filter(|s| s.is_inertial()) {
        let Sample::ImuIncrement(mut s) = *sample else {
            panic!("increments only")
        };
        if s.time > from && s.time <= to {
            sum.0 += s.angle_b;
            sum.1 += s.velocity_b;
            if s.time < to {
                continue;
            }
            (s.angle_b, s.velocity_b) = sum;
        }
        samples.push(Sample::ImuIncrement(s));
    }
    let record = run(start(&simulation), &samples);
    assert_eq!(record.events, [Event::ImuGap { from, to }]);
    let at = |t: Time| {
        record
            .epochs
            .iter()
            .find(|e| e.nav.time == t)
            .expect("a stamp")
    };
    let gained = at(to).nav.velocity_n - at(from).nav.velocity_n;
    let true_gain =
        simulation.truth_at(to).nav.velocity_n - simulation.truth_at(from).nav.velocity_n;
    // Tilt of some 10 mrad at the start and a bias of 10 mg, over 0.3 s; half of the gravity would be 1.5 m/s.
    assert!((gained - true_gain).norm() < 0.15, "{gained} {true_gain}");
}

/// GNSS stamps ahead of the inertial clock and velocities behind their positions: taken out by the settings.
#[test]
fn clock_differences_are_taken_out() {
    let mut scenario = Scenario::car_drive(160.0);
    scenario.drive.legs.remove(0);
    scenario.duration_s = 60.0;
    scenario.imu.rate_hz = 100.0;
    scenario.gnss = GnssModel {
        lever_arm_b_m: LEVER_ARM,
        position_sigma_m: [0.1; 3],
        ..GnssModel::default()
    };
    let honest = scenario.simulate(2).expect("a ready scenario");
    (scenario.gnss.time_offset_s, scenario.gnss.velocity_lag_s) = (-0.21, 0.128);
    let simulation = scenario.simulate(2).expect("a ready scenario");
    let nis = |config: Config| {
        let nav = simulation.truth_at(simulation.trajectory.start()).nav;
        let nav = NavState {
            time: nav.time.plus(config.gnss.time_offset_s),
            ..nav
        };
        let noise = ImuGrade::Automotive.noise();
        let navigator = Navigator::aligned(&config, noise, nav, ImuErrors::default(), &sigma())
            .expect("valid settings");
        let record = run(navigator, &simulation.samples);
        let last = *record.epochs.last().expect("epochs");
        let mean = |name: &str| {
            let of: Vec<f64> = record
                .updates
                .iter()
                .filter(|u| u.measurement == name)
                .map(|u| u.nis / 3.0)
                .collect();
            of.iter().sum::<f64>() / of.len() as f64
        };
        (mean("gnss_position"), mean("gnss_velocity"), last)
    };
    let mut told = config();
    (told.gnss.time_offset_s, told.gnss.velocity_lag_s) = (-0.21, 0.128);
    let (position, velocity, last) = nis(told);
    // 59 fixes of three components: a mean of 1 ± 0.11, at four sigmas.
    assert!(position < 1.45 && velocity < 1.45, "{position} {velocity}");
    let truth = honest.truth_at(last.nav.time.plus(0.21)).nav;
    assert!(last.nav.position.offset_to(&truth.position).norm() < 0.3);
    // Negative controls: each left out is metres at 12 m/s.
    let mut no_offset = told;
    no_offset.gnss.time_offset_s = 0.0;
    let mut no_lag = told;
    no_lag.gnss.velocity_lag_s = 0.0;
    let mut turned = told;
    turned.gnss.time_offset_s = 0.21;
    for (wrong, at_fault) in [(no_offset, 0), (turned, 0), (no_lag, 1)] {
        let (position, velocity, _) = nis(wrong);
        assert!(
            [position, velocity][at_fault] > 3.0,
            "{position} {velocity}"
        );
    }
}

/// A measurement that cannot be used is an error, one that cannot be is told, and neither the interval nor what waits behind it is
/// lost.
#[test]
fn a_bad_measurement_costs_itself_only() {
    let simulation = drive(10.0, 100.0, ImuOutput::Rates);
    let clean = run(start(&simulation), &simulation.samples);
    let begin = simulation.trajectory.start();
    let with = |bad: [GnssPosition; 2]| {
        let mut samples = simulation.samples.clone();
        samples.extend(bad.map(Sample::GnssPosition));
        samples.sort_by_key(|s| s.time());
        let mut navigator = start(&simulation);
        let mut record = Record::default();
        let mut errors: Vec<Error> = samples
            .iter()
            .filter_map(|s| navigator.step(s, &mut record).err())
            .collect();
        errors.extend(navigator.finish(&mut record).err());
        assert_eq!(record.epochs, clean.epochs);
        assert_eq!(record.updates, clean.updates);
        (errors, record.events)
    };
    // One on the way, one that waits in the horizon until the end.
    let times = [5.0, 9.9].map(|after| begin.plus(after));
    let mut covariance = Matrix3::identity() * 4.0;
    let position = Geodetic {
        // Finite, but the way there is not.
        longitude: 1e305,
        ..Geodetic::default()
    };
    let (errors, events) = with(times.map(|time| GnssPosition {
        time,
        position,
        covariance_n: Some(covariance),
    }));
    let what = "gnss_position";
    assert_eq!(errors, times.map(|time| Error::NotFinite { what, time }));
    assert_eq!(events, clean.events);
    // A correlation beyond 1.
    (covariance[(0, 1)], covariance[(1, 0)]) = (1e6, 1e6);
    let (errors, events) = with(times.map(|time| GnssPosition {
        time,
        position: Geodetic::default(),
        covariance_n: Some(covariance),
    }));
    assert_eq!(errors, []);
    let told: Vec<(Time, &str)> = events
        .iter()
        .filter_map(|e| match e {
            Event::Impossible { time, what, .. } => Some((*time, *what)),
            _ => None,
        })
        .collect();
    assert_eq!(told, times.map(|time| (time, "GNSS position covariance")));
}

/// Rejected until patience ends, then taken with a covariance that just passes.
#[test]
fn a_measurement_that_never_fits_is_let_in_widened() {
    let simulation = drive(6.0, 100.0, ImuOutput::Rates);
    let inertial: Vec<Sample> = simulation
        .samples
        .iter()
        .copied()
        .filter(Sample::is_inertial)
        .collect();
    let begin = simulation.trajectory.start();
    let heading =
        insnav::attitude::Euler::from_quaternion(&simulation.truth_at(begin).nav.q_nb).heading;
    let mut samples = inertial.clone();
    for i in 1..=20 {
        samples.push(Sample::Heading(Heading {
            time: begin.plus(0.01 * f64::from(i)),
            heading: heading + 1.0,
            sigma: 0.01,
        }));
    }
    samples.sort_by_key(|s| s.time());
    let record = run(start(&simulation), &samples);
    let verdicts: Vec<Verdict> = record.updates.iter().map(|u| u.verdict).collect();
    assert!(
        verdicts[..10].iter().all(|v| *v == Verdict::Rejected),
        "{verdicts:?}"
    );
    assert_eq!(verdicts[10], Verdict::Inflated);
    let first = &record.updates[10];
    let (before, after) = (
        first.residual[0].abs(),
        record.updates[11].residual[0].abs(),
    );
    // The gain of an S enlarged until the NIS is the gate's limit; sway and gyros add some millirad within 10 ms.
    let gain = (1.0 - 0.01f64.powi(2) / first.sigma[0].powi(2)) * 15.1367 / first.nis;
    assert!(before > 0.9 && gain > 0.03, "{before} {gain}");
    assert!(
        (before - after - gain * before).abs() < 3e-3,
        "{before} {after} {gain}"
    );
}

/// Long gaps end a run and begin another: told, and with a heading that its own sigma covers. Bridging them as one interval, the
/// heading was wrong by 17 of its sigmas after a minute.
#[test]
fn after_a_long_gap_the_run_starts_anew() {
    let mut scenario = Scenario::car_drive(300.0);
    scenario.imu.rate_hz = 50.0;
    let simulation = scenario.simulate(5).expect("a scenario in range");
    let begin = simulation.trajectory.start();
    for length in [10.0, 60.0, 120.0] {
        let (from, to) = (begin.plus(120.0), begin.plus(120.0 + length));
        let outside = |s: &&Sample| !s.is_inertial() || s.time() <= from || s.time() >= to;
        let record = run(
            start(&simulation),
            simulation.samples.iter().filter(outside),
        );
        assert!(
            record.events.contains(&Event::ImuGap { from, to }),
            "{length} s"
        );
        let restarts = record
            .events
            .iter()
            .filter(|e| matches!(e, Event::Started(_)));
        assert_eq!(restarts.count(), 1, "{length} s");
        assert!(
            record.epochs.iter().any(|e| e.nav.time == to),
            "the run begins at the first sample"
        );
        for epoch in record.epochs.iter().filter(|e| e.nav.time > to.plus(20.0)) {
            let truth = simulation.truth_at(epoch.nav.time).nav;
            let error = insnav::attitude::log(&(truth.q_nb * epoch.nav.q_nb.inverse())).z;
            assert!(
                error.abs() < 4.0 * epoch.heading_sigma(),
                "{length} s: {error}"
            );
        }
    }
}

/// One stamp a day ahead, as from a clock that was set: everything before and behind it is still navigated.
#[test]
fn one_stamp_of_the_future_costs_no_other() {
    let simulation = drive(60.0, 50.0, ImuOutput::Rates);
    let mut samples = simulation.samples.clone();
    let at = samples.len() / 2;
    if let Sample::Imu(s) = samples[at] {
        samples.insert(
            at,
            Sample::Imu(ImuSample {
                time: s.time.plus(86_400.0),
                ..s
            }),
        );
    } else {
        samples.insert(at, samples[at].delayed(86_400.0));
    }
    let record = run(start(&simulation), samples.iter());
    let end = simulation.trajectory.start().plus(60.0);
    for epoch in record.epochs.iter().filter(|e| e.nav.time <= end) {
        assert!(epoch.covariance.iter().all(|x| x.is_finite()));
    }
    assert!(
        record.epochs.iter().all(|e| e.nav.time <= end),
        "no epoch in the future"
    );
}

/// Fixes behind the last inertial sample cannot be used: each is told.
#[test]
fn aiding_after_the_end_is_told() {
    let simulation = drive(20.0, 50.0, ImuOutput::Rates);
    let end = simulation.trajectory.start().plus(18.0);
    let kept = simulation
        .samples
        .iter()
        .filter(|s| !s.is_inertial() || s.time() <= end);
    let record = run(start(&simulation), kept);
    let told = record
        .events
        .iter()
        .filter(|e| matches!(e, Event::AfterEnd { .. }))
        .count();
    let behind = simulation
        .samples
        .iter()
        .filter(|s| !s.is_inertial() && s.time() > end)
        .count();
    assert!(behind > 0);
    assert_eq!(told, behind);
}

/// A vehicle that stands to the end: the run begins in `finish`, which catches up with all of it.
#[test]
fn a_measurement_that_fails_costs_nothing_else_of_a_run_that_begins_at_its_end() {
    let mut scenario = Scenario::standing(20.0, 40.0);
    scenario.imu.rate_hz = 50.0;
    let samples = scenario.simulate(1).expect("a ready scenario").samples;
    let (whole, outcome) = late_run(&samples);
    outcome.expect("good samples");
    assert_eq!(
        whole.epochs.len(),
        samples.iter().filter(|s| s.is_inertial()).count()
    );
    let fixes: Vec<usize> = (0..samples.len())
        .filter(|&i| matches!(samples[i], Sample::GnssPosition(_)))
        .collect();
    assert!(fixes.len() > 10);
    for at in [fixes[1], fixes[fixes.len() / 2], fixes[fixes.len() - 1]] {
        let mut bad = samples.clone();
        let without: Vec<Sample> = [&samples[..at], &samples[at + 1..]].concat();
        let (without, outcome) = late_run(&without);
        outcome.expect("good samples");
        // Finite, but the way there is not.
        if let Sample::GnssPosition(fix) = &mut bad[at] {
            fix.position.longitude = 1e305;
        }
        let (record, outcome) = late_run(&bad);
        let time = samples[at].time();
        let what = "gnss_position";
        assert_eq!(outcome, Err(Error::NotFinite { what, time }));
        // The attitude of the start is found from the same inertial samples; only that fix is missing.
        assert!(
            record
                .epochs
                .iter()
                .map(|e| e.nav.time)
                .eq(whole.epochs.iter().map(|e| e.nav.time))
        );
        assert_eq!(record.updates.len(), without.updates.len());
    }
}

/// All of it in `finish`: what came out, and whether anything could not be used.
fn late_run(samples: &[Sample]) -> (Record, Result<(), Error>) {
    let noise = ImuGrade::Consumer.noise();
    let mut navigator = Navigator::new(&Config::default(), noise).expect("valid settings");
    let mut record = Record::default();
    feed(&mut navigator, samples, &mut record);
    assert_eq!(record, Record::default(), "it waits for a heading");
    let outcome = navigator.finish(&mut record);
    (record, outcome)
}
