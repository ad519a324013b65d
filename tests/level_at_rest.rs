//! A run that begins at rest is levelled by accelerometers whose bias it then estimates: tilt and bias are one error. However long a
//! body stands, it learns nothing more of its level, whatever tells the filter that it stands, and whatever it knows of its
//! heading. Once it turns, the bias shows, and the level with it.
//!
//! Over many simulated starts the normalised squared error of the level (two degrees of freedom) has to have the distribution of
//! chi-square ([BarShalom01] section 5.4). `INSNAV_LONG=1` takes eight times the starts.

use insnav::alignment::{Alignment, HeadingSource};
use insnav::attitude::{Euler, log_level, wrap_angle};
use insnav::config::{Config, StationaryMode, VehicleKind};
use insnav::imu::{ImuGrade, ImuNoise, STANDARD_GRAVITY};
use insnav::navigator::Navigator;
use insnav::sample::Sample;
use insnav::sim::{ImuErrorModel, Leg, Scenario, Simulation, Source, Stream};
use insnav::solution::{Epoch, Event, Sink};
use insnav::time::Time;
use nalgebra::{Matrix2, Matrix5, SVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// Of the body, degrees: nothing is level by chance.
const TILT_DEG: [f64; 2] = [4.0, -3.0];

fn seeds() -> u64 {
    if std::env::var_os("INSNAV_LONG").is_some() {
        320
    } else {
        STARTS_OF_BARS
    }
}

fn noise() -> ImuNoise {
    ImuGrade::Automotive.noise()
}

/// What of the tilt is bias, degrees.
fn common_part() -> f64 {
    (noise().accel_bias_sigma / STANDARD_GRAVITY).to_degrees()
}

#[derive(Default)]
struct Record {
    at: Vec<Time>,
    start: Option<Alignment>,
    epochs: Vec<Epoch>,
    /// Least sigma of a level component, degrees.
    least: Option<f64>,
}

impl Sink for Record {
    fn epoch(&mut self, epoch: &Epoch) {
        let p = epoch.covariance;
        let sigma = p[(6, 6)].min(p[(7, 7)]).sqrt().to_degrees();
        let least = self.least.get_or_insert(sigma);
        *least = least.min(sigma);
        if self
            .at
            .get(self.epochs.len())
            .is_some_and(|at| epoch.nav.time >= *at)
        {
            self.epochs.push(*epoch);
        }
    }

    fn event(&mut self, event: &Event) {
        if let Event::Started(alignment) = event {
            self.start = Some(*alignment);
        }
    }
}

fn navigate(mut navigator: Navigator, samples: &[Sample], at: Vec<Time>) -> Record {
    let mut record = Record {
        at,
        ..Record::default()
    };
    for sample in samples {
        navigator.step(sample, &mut record).expect("good samples");
    }
    navigator.finish(&mut record).expect("good samples");
    record
}

/// Error of the level and of the accelerometer bias, with their covariance.
fn off(epoch: &Epoch, simulation: &Simulation) -> (SVector<f64, 5>, Matrix5<f64>) {
    let truth = simulation.truth_at(epoch.nav.time);
    let phi = log_level(&(truth.nav.q_nb * epoch.nav.q_nb.inverse()));
    let bias = truth.imu_errors.accel_bias - epoch.imu_errors.accel_bias;
    let rows = [6, 7, 12, 13, 14];
    (
        SVector::<f64, 5>::new(phi.x, phi.y, bias.x, bias.y, bias.z),
        Matrix5::from_fn(|i, j| epoch.covariance[(rows[i], rows[j])]),
    )
}

fn level_nees((error, p): &(SVector<f64, 5>, Matrix5<f64>)) -> f64 {
    let p: Matrix2<f64> = p.fixed_view::<2, 2>(0, 0).into_owned();
    let e = error.fixed_rows::<2>(0);
    (e.transpose() * p.try_inverse().expect("a covariance") * e)[(0, 0)]
}

fn whole_nees((error, p): &(SVector<f64, 5>, Matrix5<f64>)) -> f64 {
    let scale = p.map_diagonal(|v| v.sqrt().recip());
    let scaled = Matrix5::from_fn(|i, j| p[(i, j)] * scale[i] * scale[j]);
    let e = error.component_mul(&scale);
    e.dot(&scaled.cholesky().expect("a covariance").solve(&e))
}

/// Means of squares over all starts, per degree of freedom.
#[derive(Debug)]
struct Shown {
    /// Of the level at the instants asked for.
    level: Vec<f64>,
    /// Of level and accelerometer bias together.
    whole: Vec<f64>,
    /// Mean sigma of the level there, degrees.
    sigma: Vec<f64>,
    /// The least of all sigmas, degrees.
    least: f64,
    /// Largest error of the heading, degrees.
    heading: f64,
    sources: Vec<HeadingSource>,
    /// Starts that took a drive forward for one backward: none of the level's business.
    reversed: u64,
}

/// Where a vehicle stands, which way it looks, and for how long.
fn standing(seconds: f64, heading_deg: f64) -> Scenario {
    let mut scenario = Scenario::standing(seconds, heading_deg);
    scenario.drive.body.tilt_deg = TILT_DEG;
    scenario.imu.rate_hz = 100.0;
    scenario
}

fn over_starts(
    config: &Config,
    at: &[f64],
    scenario: impl Fn(f64) -> Scenario,
    navigator: impl Fn(&Simulation, &Config, f64, u64) -> Navigator,
) -> Shown {
    let count = seeds();
    let mut shown = Shown {
        level: vec![0.0; at.len()],
        whole: vec![0.0; at.len()],
        sigma: vec![0.0; at.len()],
        least: f64::INFINITY,
        heading: 0.0,
        sources: Vec::new(),
        reversed: 0,
    };
    let mut used = 0.0;
    for seed in 0..count {
        let heading = 100.0 * Source::new(seed, Stream::Route).normal();
        let heading = wrap_angle(heading).to_degrees();
        let simulation = scenario(heading).simulate(seed).expect("in range");
        let begin = simulation.trajectory.start();
        let times = at.iter().map(|s| begin.plus(*s)).collect();
        let navigator = navigator(&simulation, config, heading, seed);
        let record = navigate(navigator, &simulation.samples, times);
        if record.start.is_some_and(|start| start.reversing) {
            shown.reversed += 1;
            continue;
        }
        used += 1.0;
        assert_eq!(record.epochs.len(), at.len(), "seed {seed}");
        shown.sources.extend(record.start.map(|s| s.heading_source));
        shown.least = shown.least.min(record.least.expect("epochs"));
        for (k, epoch) in record.epochs.iter().enumerate() {
            let error = off(epoch, &simulation);
            shown.level[k] += level_nees(&error) / 2.0;
            shown.whole[k] += whole_nees(&error) / 5.0;
            shown.sigma[k] += (0.5 * (error.1[(0, 0)] + error.1[(1, 1)]))
                .sqrt()
                .to_degrees();
            let truth = simulation.truth_at(epoch.nav.time);
            let phi = log_level(&(truth.nav.q_nb * epoch.nav.q_nb.inverse()));
            shown.heading = shown.heading.max(phi.z.abs().to_degrees());
        }
    }
    assert!(20 * shown.reversed <= count, "{}", shown.reversed);
    for sums in [&mut shown.level, &mut shown.whole, &mut shown.sigma] {
        for sum in sums {
            *sum /= used;
        }
    }
    shown
}

/// A heading that is given, wrong by what it states.
const GIVEN_SIGMA_DEG: f64 = 2.0;

fn given(mut config: Config, heading: f64, seed: u64) -> Config {
    let wrong = GIVEN_SIGMA_DEG * Source::new(seed, Stream::Initial).normal();
    config.alignment.heading_deg = Some((heading + wrong).rem_euclid(360.0));
    config.alignment.heading_sigma_deg = Some(GIVEN_SIGMA_DEG);
    config
}

fn own_start(config: &Config) -> Navigator {
    Navigator::new(config, noise()).expect("in range")
}

/// Starts over which the bars are set. More of them show what is approximated on purpose: the noise of the mean force that is used again
/// (a tenth too sure), rates that may have moved on (too cautious).
const STARTS_OF_BARS: u64 = 40;

/// Mean squares per degree of freedom that chance leaves in 999 of 1000 cases.
fn band(dof: u64) -> (f64, f64) {
    let dof = (dof * STARTS_OF_BARS) as f64;
    let chi = ChiSquared::new(dof).expect("a positive number");
    (
        chi.inverse_cdf(5e-4) / dof,
        chi.inverse_cdf(1.0 - 5e-4) / dof,
    )
}

fn assert_in_band(what: &str, shown: &Shown) {
    let ((low, high), whole) = (band(2), band(5));
    println!(
        "{what}: NEES level {:.2?}, with bias {:.2?} (bands {low:.2}..{high:.2}, {:.2}..{:.2}); sigma {:.3?}°, least {:.3}°; heading off by up to {:.0}°",
        shown.level, shown.whole, whole.0, whole.1, shown.sigma, shown.least, shown.heading
    );
    for nees in &shown.level {
        assert!((low..high).contains(nees), "{what}: {:?}", shown.level);
    }
    for nees in &shown.whole {
        assert!(
            (whole.0..whole.1).contains(nees),
            "{what}: {:?}",
            shown.whole
        );
    }
}

fn modes() -> Vec<(&'static str, Config)> {
    let config = Config::default();
    let mode = |mode| {
        let mut config = Config::default();
        config.stationary.mode = mode;
        config
    };
    let mut foot = Config::default();
    foot.vehicle.kind = VehicleKind::Foot;
    vec![
        ("static", config),
        ("zero velocities", mode(StationaryMode::Zupt)),
        ("heading hold", mode(StationaryMode::HeadingHold)),
        ("attitude hold", mode(StationaryMode::AttitudeHold)),
        ("zero heading rate", mode(StationaryMode::Zihr)),
        ("off", mode(StationaryMode::Off)),
        ("foot", foot),
    ]
}

/// A minute of standing in every mode, begun as `told` (of the settings, the true heading in degrees and the seed).
fn assert_standing_does_not_level(
    source: HeadingSource,
    told: impl Fn(Config, f64, u64) -> Config,
) {
    for (what, config) in modes() {
        let what = format!("{what}, heading {source:?}");
        let shown = over_starts(
            &config,
            &[5.0, 59.0],
            |heading| standing(60.0, heading),
            |_, config, heading, seed| own_start(&told(*config, heading, seed)),
        );
        assert_in_band(&what, &shown);
        assert!(shown.sources.iter().all(|s| *s == source), "{what}");
        let least = shown.least;
        assert!(least > 0.98 * common_part(), "{what}: {least}");
    }
}

#[test]
fn standing_does_not_level_with_a_heading_that_is_given() {
    assert_standing_does_not_level(HeadingSource::Given, given);
}

#[test]
fn standing_does_not_level_with_a_heading_that_nobody_knows() {
    assert_standing_does_not_level(HeadingSource::Unknown, |config, _, _| config);
}

#[test]
fn standing_does_not_level_without_gnss() {
    assert_standing_does_not_level(HeadingSource::Relative, |mut config, _, _| {
        config.gnss.used = false;
        config.output.origin = Some([50.1, 14.4, 250.0]);
        config
    });
}

/// Better gyros find no north either where rest has told their biases: heading and biases of such a start are wrong by what cancels.
#[test]
fn standing_tells_nothing_of_a_heading_that_nobody_knows() {
    let industrial = ImuGrade::Industrial.noise();
    for (what, config) in modes() {
        // Who is told of no stop, or of strides, finds a false north in the noise of the forces (ARCHITECTURE.md).
        if config.stationary.mode == StationaryMode::Off || config.vehicle.kind == VehicleKind::Foot
        {
            continue;
        }
        let (mut least, mut worst) = (f64::INFINITY, 0.0_f64);
        for seed in 0..8 {
            let heading = wrap_angle(100.0 * Source::new(seed, Stream::Route).normal());
            let mut scenario = standing(180.0, heading.to_degrees());
            scenario.imu.errors = ImuErrorModel::from_noise(industrial);
            let simulation = scenario.simulate(seed).expect("in range");
            let navigator = Navigator::new(&config, industrial).expect("in range");
            let end = simulation.trajectory.start().plus(179.0);
            let record = navigate(navigator, &simulation.samples, vec![end]);
            let epoch = record.epochs[0];
            let truth = simulation.truth_at(epoch.nav.time).nav.q_nb;
            let off = wrap_angle(epoch.euler().heading - Euler::from_quaternion(&truth).heading);
            least = least.min(epoch.heading_sigma().to_degrees());
            worst = worst.max(off.abs() / epoch.heading_sigma());
        }
        println!(
            "{what}: sigma of the heading at least {least:.1}°, error at most {worst:.1} sigmas"
        );
        // 104° are a uniform distribution.
        assert!(least > 95.0, "{what}: {least}°");
        assert!(worst < 3.0, "{what}: {worst}");
    }
}

/// The control: the same start, its tilt and bias taken for independent.
#[test]
fn independent_tilt_and_bias_are_too_sure() {
    let config = Config::default();
    let shown = over_starts(
        &config,
        &[59.0],
        |heading| standing(60.0, heading),
        |simulation, config, heading, seed| {
            let config = given(*config, heading, seed);
            let record = navigate(own_start(&config), &simulation.samples, Vec::new());
            let start = record.start.expect("started");
            Navigator::aligned(&config, noise(), start.nav, start.imu_errors, &start.sigma)
                .expect("in range")
        },
    );
    println!("{shown:?}");
    assert!(shown.level[0] > band(2).1, "{:?}", shown.level);
    assert!(shown.sigma[0] < 0.75 * common_part(), "{:?}", shown.sigma);
}

fn leg(duration_s: f64, speed_m_per_s: f64, turn_deg: f64) -> Leg {
    Leg {
        duration_s,
        speed_m_per_s,
        turn_deg,
        slope_deg: 0.0,
    }
}

/// After a minute of standing a car drives off and turns: its bias shows, in axes that turn.
fn off_it_goes(mut scenario: Scenario) -> Scenario {
    let legs = &mut scenario.drive.legs;
    legs.push(leg(8.0, 10.0, 0.0));
    for turn in [90.0, 90.0, -90.0, 120.0, -60.0, -90.0] {
        legs.push(leg(6.0, 8.0, turn));
        legs.push(leg(8.0, 12.0, 0.0));
    }
    scenario.duration_s = legs.iter().map(|l| l.duration_s).sum();
    scenario
}

#[test]
fn a_drive_after_standing_levels() {
    let config = Config::default();
    for known in [true, false] {
        let shown = over_starts(
            &config,
            &[58.0, 70.0, 90.0, 150.0],
            |heading| off_it_goes(standing(60.0, heading)),
            |_, config, heading, seed| {
                own_start(&if known {
                    given(*config, heading, seed)
                } else {
                    *config
                })
            },
        );
        assert_in_band(
            if known {
                "drive, heading given"
            } else {
                "drive, heading by course"
            },
            &shown,
        );
        // It was worth driving.
        assert!(shown.sigma[3] < 0.5 * shown.sigma[0], "{:?}", shown.sigma);
    }
}

#[test]
fn a_start_in_motion_is_as_good_as_it_says() {
    let moving = |heading: f64| {
        let mut scenario = standing(0.0, heading);
        scenario.drive.speed_m_per_s = 12.0;
        scenario.drive.legs = vec![leg(20.0, 12.0, 0.0)];
        off_it_goes(scenario)
    };
    for known in [true, false] {
        let shown = over_starts(
            &Config::default(),
            &[2.0, 15.0, 40.0, 100.0],
            moving,
            |_, config, heading, seed| {
                own_start(&if known {
                    given(*config, heading, seed)
                } else {
                    *config
                })
            },
        );
        assert_in_band(
            if known {
                "moving start, heading given"
            } else {
                "moving start, by course"
            },
            &shown,
        );
    }
}
