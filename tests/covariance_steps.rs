//! Fast units: the covariance in steps of up to 12 ms against one step for every sample.

use insnav::attitude::exp;
use insnav::config::Config;
use insnav::earth::Geodetic;
use insnav::filter::{
    ACCEL_SCALE, ATTITUDE, BASE, Block, CAPACITY, COVARIANCE_STEP, Columns, Eskf, GYRO_BIAS,
    GYRO_SCALE, Gate, InitialSigma, LEVER_ARM, Layout, Linearized, Measurement, Nominal, POSITION,
    Process, Transition, VELOCITY, fill_base,
};
use insnav::imu::{ImuErrors, ImuGrade};
use insnav::mechanization::{Increment, IncrementBuilder, Interval, NavState};
use insnav::navigator::Navigator;
use insnav::sample::Sample;
use insnav::sim::{Scenario, Source, Stream};
use insnav::solution::{Epoch, Sink};
use insnav::time::Time;
use nalgebra::{Matrix3, SMatrix, Vector3};
use std::f64::consts::TAU;

type Square = SMatrix<f64, BASE, BASE>;

fn filter() -> Eskf {
    let noise = ImuGrade::Industrial.noise();
    let nav = NavState {
        time: Time(1_700_000_000_000_000_000),
        position: Geodetic::from_degrees(50.0, 14.0, 300.0),
        velocity_n: Vector3::new(12.0, 3.0, 0.2),
        q_nb: exp(&Vector3::new(0.02, -0.05, 1.0)),
    };
    let sigma = InitialSigma {
        position: Vector3::repeat(2.0),
        velocity: Vector3::repeat(0.2),
        attitude: Vector3::new(0.01, 0.01, 0.05),
        gyro_bias: Vector3::repeat(noise.gyro_bias_sigma),
        accel_bias: Vector3::repeat(noise.accel_bias_sigma),
    };
    let errors = ImuErrors {
        gyro_bias: Vector3::new(1e-3, -2e-3, 5e-4),
        accel_bias: Vector3::new(0.02, -0.05, 0.03),
        ..ImuErrors::default()
    };
    let mut filter = Eskf::new(nav, errors, &sigma, noise);
    for (block, size) in [(GYRO_SCALE, 2e-3), (ACCEL_SCALE, 2e-3), (LEVER_ARM, 0.2)] {
        filter
            .open(block, Process::constant(size))
            .expect("there is room");
    }
    filter
}

/// Town and a bad road on a unit that is mounted badly: turns of up to 60 °/s, 3 m/s² either way, an engine of 26.7 Hz and 2 m/s²,
/// coning of half a degree at 31 Hz.
fn reading(t: f64) -> (Vector3<f64>, Vector3<f64>) {
    let wave = |hertz: f64, phase: f64| (TAU * hertz * t + phase).sin();
    let coning = 0.5f64.to_radians() * TAU * 31.0;
    let rate_b = Vector3::new(
        0.1 * wave(0.7, 0.3) + coning * wave(31.0, 0.0),
        0.08 * wave(0.5, 1.0) + coning * wave(31.0, TAU / 4.0),
        1.05 * wave(0.11, 0.0) * wave(0.013, 0.5),
    );
    let force_n = Vector3::new(
        3.0 * wave(0.05, 0.0) + 2.0 * wave(26.7, 0.0),
        3.0 * wave(0.09, 2.0) + 1.5 * wave(26.7, 1.0),
        -9.81 + 0.8 * wave(1.3, 0.0) + 2.0 * wave(26.7, 2.0),
    );
    (rate_b, force_n)
}

/// What is measured from `t` on.
fn increment(at: &Nominal, t: f64, dt: f64) -> Increment {
    let (rate_b, force_n) = reading(t + 0.5 * dt);
    let errors = &at.imu_errors;
    Increment {
        time: at.nav.time.plus(dt),
        dt,
        rotation_b: (rate_b + errors.gyro_bias) * dt,
        velocity_b: (at.nav.q_nb.inverse() * force_n + errors.accel_bias) * dt,
    }
}

/// Three components of a block, measured to be what they are.
struct Confirmed(Block<3>, f64);

impl Measurement<3> for Confirmed {
    fn name(&self) -> &'static str {
        "confirmed"
    }
    fn linearize(&self, _: &Nominal, layout: &Layout) -> Linearized<3> {
        let mut h = Columns::default();
        h.put(layout, self.0, &Matrix3::identity());
        Linearized {
            residual: Vector3::zeros(),
            h,
            r: Matrix3::from_diagonal_element(self.1 * self.1),
        }
    }
}

fn sigmas(filter: &Eskf) -> Vec<f64> {
    let mut filter = filter.clone();
    filter.settle();
    let p = filter.covariance();
    let n = p.layout().len();
    let p = p.dense::<CAPACITY>();
    (0..n).map(|i| p[(i, i)].sqrt()).collect()
}

/// Two filters under way, of which one steps at every sample.
struct Pair {
    every: Eskf,
    steps: Eskf,
    /// Largest relative difference of any sigma at any whole second.
    worst: f64,
}

impl Pair {
    fn new(filter: Eskf) -> Self {
        Pair {
            every: filter.clone(),
            steps: filter,
            worst: 0.0,
        }
    }

    /// At whole seconds, before and after the fix that there is but in the third minute.
    fn second(&mut self, t: f64) {
        self.compare();
        if (120.0..180.0).contains(&t) {
            return;
        }
        for filter in [&mut self.every, &mut self.steps] {
            let now = filter.nominal().nav.time;
            for model in [Confirmed(POSITION, 1.0), Confirmed(VELOCITY, 0.05)] {
                filter
                    .update(&model, now, &mut Gate::closed())
                    .expect("positive definite");
            }
        }
        self.compare();
    }

    fn compare(&mut self) {
        for (a, b) in sigmas(&self.every).iter().zip(sigmas(&self.steps)) {
            self.worst = self.worst.max((b / a - 1.0).abs());
        }
    }
}

/// Four minutes of shaking.
fn shaken(rate_hz: f64, step: impl Fn(&mut Eskf, &Increment)) -> f64 {
    let mut pair = Pair::new(filter());
    let dt = 1.0 / rate_hz;
    for i in 0..(240.0 * rate_hz) as u32 {
        let t = f64::from(i) * dt;
        if i > 0 && i % rate_hz as u32 == 0 {
            pair.second(t);
        }
        let raw = increment(pair.every.nominal(), t, dt);
        pair.every.propagate(&raw);
        step(&mut pair.steps, &raw);
    }
    pair.worst
}

/// Four minutes of a simulated drive.
fn driven(rate_hz: f64, step: impl Fn(&mut Eskf, &Increment)) -> f64 {
    let mut scenario = Scenario::car_drive(300.0);
    // Without the minute of standing.
    scenario.drive.legs.remove(0);
    scenario.duration_s = 240.0;
    scenario.imu.rate_hz = rate_hz;
    let simulation = scenario.simulate(2).expect("a ready scenario");
    let mut start = filter();
    let truth = simulation.truth_at(simulation.trajectory.start()).nav;
    let layout = *start.covariance().layout();
    let goal = Nominal {
        nav: truth,
        ..*start.nominal()
    };
    let dx = start.nominal().local(&layout, &goal);
    start.retract(&dx);
    let mut pair = Pair::new(start);
    let mut builder = IncrementBuilder::default();
    let (mut count, begin) = (0, truth.time);
    for sample in &simulation.samples {
        let Sample::Imu(sample) = sample else {
            continue;
        };
        let Some(raw) = builder.push(sample) else {
            continue;
        };
        pair.every.propagate(&raw);
        step(&mut pair.steps, &raw);
        count += 1;
        if count % rate_hz as u32 == 0 {
            pair.second(sample.time.since(begin));
        }
    }
    assert!(count > (230.0 * rate_hz) as u32);
    pair.worst
}

/// Of 24 states. What differs is of first order in the length of a step, and so is what every sample's own steps are off by: a unit of
/// 100 Hz has as much of it. A thousandth of a sigma is what a filter is off by whose noise is known to a five-hundredth.
#[test]
fn sigmas_of_a_drive_are_those_of_a_step_for_every_sample() {
    for rate_hz in [200.0, 400.0, 1000.0] {
        let worst = driven(rate_hz, Eskf::propagate_in_steps);
        println!("{rate_hz} Hz: {worst:.1e}");
        assert!(worst < 1e-3, "{rate_hz}: {worst:e}");
        assert!(worst > 0.0, "{rate_hz}: nothing was put together");
    }
}

/// However it shakes, no more than twice that.
#[test]
fn shaking_hides_nothing_from_a_step() {
    for rate_hz in [200.0, 400.0, 1000.0] {
        let worst = shaken(rate_hz, Eskf::propagate_in_steps);
        println!("{rate_hz} Hz: {worst:.1e}");
        assert!(worst < 2e-3, "{rate_hz}: {worst:e}");
    }
}

/// The same bars show a filter that leaves out one sample in a hundred.
#[test]
fn the_comparison_sees_a_sample_in_a_hundred() {
    let count = std::cell::Cell::new(0);
    let leaky = |filter: &mut Eskf, raw: &Increment| {
        count.set(count.get() + 1);
        if count.get() % 100 > 0 {
            return filter.propagate_in_steps(raw);
        }
        // The estimate moves, the covariance stays.
        let mut moved = filter.clone();
        moved.propagate(raw);
        let layout = *filter.covariance().layout();
        let dx = filter.nominal().local(&layout, moved.nominal());
        filter.retract(&dx);
    };
    let worst = [driven(200.0, leaky), shaken(200.0, leaky)];
    println!("{worst:?}");
    assert!(worst[0] > 2e-3 && worst[1] > 4e-3, "{worst:?}");
}

/// Up to 160 Hz nothing is put together, and nothing changes to the last bit, where no measurement cuts an interval.
#[test]
fn slow_units_step_at_every_sample() {
    for rate_hz in [50.0, 100.0, 125.0, 160.0] {
        let (mut every, mut steps) = (filter(), filter());
        for i in 0..200 {
            let dt = 1.0 / rate_hz;
            let raw = increment(every.nominal(), f64::from(i) * dt, dt);
            every.propagate(&raw);
            steps.propagate_in_steps(&raw);
            assert!(steps.is_settled(), "{rate_hz}");
        }
        assert_eq!(every.covariance(), steps.covariance());
        assert_eq!(every.nominal(), steps.nominal());
    }
}

/// However the samples lie, no step but that of one sample is longer than it may be, and jitter of a fifth leaves pairs pairs.
#[test]
fn steps_are_as_long_as_they_may_be() {
    let mut source = Source::new(1, Stream::Initial);
    let mut steps = filter();
    let (mut since, mut alone, mut t) = (0.0, 0, 0.0);
    for _ in 0..2000 {
        let dt = source.between(0.004, 0.006);
        let raw = increment(steps.nominal(), t, dt);
        steps.propagate_in_steps(&raw);
        t += dt;
        since += dt;
        assert!(since <= COVARIANCE_STEP || steps.is_settled(), "{since}");
        if steps.is_settled() {
            alone += usize::from(since == dt);
            since = 0.0;
        }
    }
    assert!(alone < 10, "{alone}");
}

/// Asking for sigmas within a step tells those of a step that ends there, and leaves no trace; a filter that was saved there goes on
/// to the last bit.
#[test]
fn who_asks_or_saves_changes_nothing() {
    let (mut plain, mut asked) = (filter(), filter());
    let mut within = 0;
    for i in 0..400 {
        let raw = increment(plain.nominal(), f64::from(i) * 0.0025, 0.0025);
        plain.propagate_in_steps(&raw);
        asked.propagate_in_steps(&raw);
        within += usize::from(!asked.is_settled());
        let told = asked.base_covariance();
        let mut settled = asked.clone();
        settled.settle();
        assert_eq!(told, settled.base_covariance());
        assert_eq!(told, settled.covariance().dense::<BASE>());
        assert!(asked.optional_states().eq(settled.optional_states()));
        let bytes = postcard::to_stdvec(&asked).expect("plain data");
        asked = postcard::from_bytes(&bytes).expect("just written");
    }
    assert!(within > 250, "{within}");
    assert_eq!(plain.covariance(), asked.covariance());
    assert_eq!(plain.nominal(), asked.nominal());
}

/// What changes the filter finds the covariance where the estimate is.
#[test]
fn changes_come_after_the_motion() {
    type Change = fn(&mut Eskf);
    let changes: [(&str, Change); 6] = [
        ("widen", |f| f.widen(GYRO_BIAS, &Matrix3::identity())),
        ("open", |f| {
            f.open(LEVER_ARM, Process::constant(0.1)).expect("is open");
        }),
        ("close", |f| f.close(GYRO_SCALE)),
        ("hold", |f| f.hold_attitude().expect("there is room")),
        ("forget", |f| f.forget_velocity(0.1)),
        ("update", |f| {
            let now = f.nominal().nav.time;
            f.update(&Confirmed(ATTITUDE, 1e-3), now, &mut Gate::closed())
                .expect("positive definite");
        }),
    ];
    for (name, change) in changes {
        let mut steps = filter();
        let raw = increment(steps.nominal(), 0.0, 0.005);
        steps.propagate_in_steps(&raw);
        assert!(!steps.is_settled());
        let mut every = filter();
        every.propagate(&raw);
        change(&mut steps);
        change(&mut every);
        assert!(steps.is_settled(), "{name}");
        assert_eq!(steps.covariance(), every.covariance(), "{name}");
    }
}

/// Φ of a pair of intervals by central differences through the mechanization over both.
fn numerical(start: &Nominal, raw: &[Increment; 2]) -> Square {
    let layout = Layout::default();
    let end = |from: &Nominal| {
        let mut end = *from;
        for raw in raw {
            let increment = raw.corrected(&end.imu_errors);
            end.nav.advance(&increment);
        }
        end
    };
    let base = end(start);
    Square::from_columns(&core::array::from_fn::<_, BASE, _>(|j| {
        // Large where the states' own resolution is poor, small against the radius over which anything changes.
        let h = [3e3, 10.0, 1e-3, 1e-2, 0.1][j / 3];
        let moved = |by: f64| {
            let mut dx = [0.0; CAPACITY];
            dx[j] = by;
            let end = end(&start.retract(&layout, &dx));
            SMatrix::<f64, BASE, 1>::from_column_slice(&base.local(&layout, &end)[..BASE])
        };
        (moved(h) - moved(-h)) / (2.0 * h)
    }))
}

fn analytic(interval: &Interval) -> Square {
    let mut phi = Transition::default();
    // Constant biases, as the mechanization has them.
    let mut noise = ImuGrade::Industrial.noise();
    (noise.gyro_bias_tau, noise.accel_bias_tau) = (f64::INFINITY, f64::INFINITY);
    fill_base(&mut phi, &Layout::default(), interval, &noise);
    Square::from_columns(&core::array::from_fn::<_, BASE, _>(|j| {
        let mut unit = [0.0; CAPACITY];
        unit[j] = 1.0;
        SMatrix::<f64, BASE, 1>::from_column_slice(&phi.times(&unit)[..BASE])
    }))
}

/// The dynamics of the mean motion over two samples of 5 ms are as near to the derivative of the mechanization as those of one sample
/// of 10 ms are to theirs; those of the first of the two, for twice its length, are not.
#[test]
fn the_transition_of_a_pair_is_that_of_its_mean_motion() {
    // In units of a start's sigmas, per block that is acted on.
    let size = [2.0, 0.2, 0.02, 1e-3, 0.05];
    let off = |a: &Square, b: &Square| {
        let mut worst = [0.0f64; 3];
        for i in 0..9 {
            for j in 0..BASE {
                let d = (a[(i, j)] - b[(i, j)]).abs() * size[j / 3] / size[i / 3];
                worst[i / 3] = worst[i / 3].max(d);
            }
        }
        worst
    };
    let mut worst = [[0.0f64; 3]; 3];
    let mut start = *filter().nominal();
    for i in 0..200 {
        let t = f64::from(i) * 0.01;
        let first = increment(&start, t, 0.005);
        let mut nominal = start;
        let a = nominal.nav.advance(&first.corrected(&start.imu_errors));
        let second = increment(&nominal, t + 0.005, 0.005);
        let b = nominal.nav.advance(&second.corrected(&start.imu_errors));
        let exact = numerical(&start, &[first, second]);
        let whole = Increment {
            time: second.time,
            dt: 0.01,
            rotation_b: first.rotation_b + second.rotation_b,
            velocity_b: first.velocity_b + second.velocity_b,
        };
        let (head, tail) = whole.split_at(first.time);
        let alone = start
            .nav
            .clone()
            .advance(&whole.corrected(&start.imu_errors));
        let doubled = Interval { dt: 0.01, ..a };
        let differences = [
            off(&analytic(&a.and(&b)), &exact),
            off(&analytic(&alone), &numerical(&start, &[head, tail])),
            off(&analytic(&doubled), &exact),
        ];
        for (worst, now) in worst.iter_mut().zip(differences) {
            for (worst, now) in worst.iter_mut().zip(now) {
                *worst = worst.max(now);
            }
        }
        start = nominal;
    }
    let [pair, alone, doubled] = worst;
    for block in 0..3 {
        // A tenth for what the motion does between the two.
        assert!(pair[block] < 1.1 * alone[block] + 1e-9, "{worst:?}");
    }
    // Vibration of 2 m/s² moves the specific force from one sample to the next.
    assert!(doubled[1] > 3.0 * pair[1], "{worst:?}");
}

/// Everything that came out, of every so many epochs.
struct EveryNth(usize, usize, Vec<Epoch>);

impl Sink for EveryNth {
    fn wants_epoch(&mut self, _: Time) -> bool {
        self.1 += 1;
        self.1.is_multiple_of(self.0)
    }
    fn epoch(&mut self, epoch: &Epoch) {
        self.2.push(*epoch);
    }
}

/// At 200 Hz every other epoch lies within a step.
#[test]
fn epochs_do_not_depend_on_which_are_asked_for() {
    let mut scenario = Scenario::car_drive(120.0);
    scenario.duration_s = 120.0;
    assert_eq!(scenario.imu.rate_hz, 200.0);
    let simulation = scenario.simulate(5).expect("a ready scenario");
    let run = |nth: usize| {
        let noise = ImuGrade::Industrial.noise();
        let mut navigator = Navigator::new(&Config::default(), noise).expect("valid settings");
        let mut sink = EveryNth(nth, 0, Vec::new());
        let samples: &[Sample] = &simulation.samples;
        for sample in samples {
            navigator.step(sample, &mut sink).expect("good samples");
        }
        navigator.finish(&mut sink).expect("good samples");
        sink.2
    };
    let all = run(1);
    assert!(all.len() > 20_000);
    for nth in [2, 7] {
        let some = run(nth);
        let expected = all.iter().skip(nth - 1).step_by(nth);
        assert!(some.iter().eq(expected), "{nth}");
    }
}
