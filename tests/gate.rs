//! What the filter does about measurements that lie: never locked out, never dragged away.
//!
//! Simulated drives with exact truth, several seeds each, and beside each rule the same drive without it.

use insnav::config::{Config, SigmaScale};
use insnav::filter::{Update, Verdict};
use insnav::imu::ImuGrade;
use insnav::navigator::Navigator;
use insnav::sample::{GnssPosition, Sample};
use insnav::sim::{GnssModel, ImuErrorModel, Scenario, Simulation, Span};
use insnav::solution::{Epoch, Event, Sink};
use nalgebra::{Matrix3, Vector3};

const SEEDS: u64 = 4;
const LENGTH_S: f64 = 240.0;

/// One second's worth of what came out.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// Since the begin, s.
    t: f64,
    /// Horizontal error, m.
    error: f64,
    /// Error over its standard deviation in its own direction.
    sigmas: f64,
    /// Standard deviation of the horizontal position, m.
    sigma: f64,
}

struct Record<'a> {
    simulation: &'a Simulation,
    points: Vec<Point>,
    updates: Vec<Update>,
    resets: Vec<f64>,
    next: f64,
}

impl Sink for Record<'_> {
    fn epoch(&mut self, epoch: &Epoch) {
        let t = epoch.nav.time.since(self.simulation.trajectory.start());
        if t < self.next {
            return;
        }
        self.next += 0.1;
        let truth = self.simulation.truth_at(epoch.nav.time).nav.position;
        let error = epoch.nav.position.offset_to(&truth).xy();
        let p = epoch.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        let inverse = p.try_inverse().expect("a covariance");
        self.points.push(Point {
            t,
            error: error.norm(),
            sigmas: (error.transpose() * inverse * error)[(0, 0)].sqrt(),
            sigma: p.trace().sqrt(),
        });
    }
    fn update(&mut self, update: &Update) {
        self.updates.push(*update);
    }
    fn event(&mut self, event: &Event) {
        if let Event::PositionReset { time, .. } = event {
            self.resets
                .push(time.since(self.simulation.trajectory.start()));
        }
    }
}

impl Record<'_> {
    fn within(&self, begin: f64, end: f64) -> impl Iterator<Item = &Point> {
        self.points
            .iter()
            .filter(move |p| (begin..end).contains(&p.t))
    }

    fn worst(&self, begin: f64, end: f64) -> f64 {
        self.within(begin, end).fold(0.0, |a, p| a.max(p.error))
    }

    fn worst_sigmas(&self, begin: f64, end: f64) -> f64 {
        self.within(begin, end).fold(0.0, |a, p| a.max(p.sigmas))
    }

    fn rms(&self, begin: f64, end: f64) -> f64 {
        let (sum, n) = self
            .within(begin, end)
            .fold((0.0, 0.0), |(s, n), p| (s + p.error * p.error, n + 1.0));
        f64::sqrt(sum / n)
    }

    /// Mean squared error in units of its covariance, per component.
    fn nees(&self, begin: f64, end: f64) -> f64 {
        let (sum, n) = self.within(begin, end).fold((0.0, 0.0), |(s, n), p| {
            (s + p.sigmas * p.sigmas / 2.0, n + 1.0)
        });
        sum / n
    }

    fn count(&self, verdict: Verdict) -> usize {
        let positions = self
            .updates
            .iter()
            .filter(|u| u.measurement == "gnss_position");
        positions.filter(|u| u.verdict == verdict).count()
    }

    fn nis(&self, after: f64) -> f64 {
        let begin = self.simulation.trajectory.start();
        let of = |u: &&Update| {
            u.measurement == "gnss_position"
                && u.verdict == Verdict::Accepted
                && u.time.since(begin) > after
        };
        let all: Vec<f64> = self
            .updates
            .iter()
            .filter(of)
            .map(|u| u.nis / u.dof as f64)
            .collect();
        all.iter().sum::<f64>() / all.len() as f64
    }
}

/// A car drive after ten seconds of standing, automotive unit, position and velocity once a second.
fn scenario(sigma_m: f64, change: impl Fn(&mut GnssModel)) -> Scenario {
    let mut scenario = Scenario::car_drive(LENGTH_S + 60.0);
    scenario.drive.legs[0].duration_s = 10.0;
    scenario.duration_s = LENGTH_S;
    scenario.imu.rate_hz = 50.0;
    scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Automotive.noise());
    scenario.gnss.position_sigma_m = [sigma_m, sigma_m, 2.0 * sigma_m];
    change(&mut scenario.gnss);
    scenario
}

fn simulate(sigma_m: f64, seed: u64, change: impl Fn(&mut GnssModel)) -> Simulation {
    scenario(sigma_m, change)
        .simulate(seed)
        .expect("a scenario in range")
}

/// Every position as `change` makes it; `None` drops it. The first argument counts positions, the second is the time.
fn changed(
    simulation: &mut Simulation,
    mut change: impl FnMut(usize, f64, &GnssPosition) -> Option<GnssPosition>,
) {
    let begin = simulation.trajectory.start();
    let mut k = 0;
    simulation.samples.retain_mut(|sample| {
        let Sample::GnssPosition(fix) = sample else {
            return true;
        };
        k += 1;
        match change(k - 1, fix.time.since(begin), fix) {
            Some(new) => {
                *fix = new;
                true
            }
            None => false,
        }
    });
}

fn moved(fix: &GnssPosition, north: f64, east: f64) -> Option<GnssPosition> {
    Some(GnssPosition {
        position: fix.position.offset(&Vector3::new(north, east, 0.0)),
        ..*fix
    })
}

fn run<'a>(simulation: &'a Simulation, config: &Config) -> Record<'a> {
    let mut record = Record {
        simulation,
        points: Vec::new(),
        updates: Vec::new(),
        resets: Vec::new(),
        next: 0.0,
    };
    let noise = ImuGrade::Automotive.noise();
    let mut navigator = Navigator::new(config, noise).expect("valid settings");
    for sample in &simulation.samples {
        navigator.step(sample, &mut record).expect("good samples");
    }
    navigator.finish(&mut record).expect("good samples");
    record
}

fn fixed() -> Config {
    let mut config = Config::default();
    config.gnss.sigma_scale = SigmaScale::Fixed(1.0);
    config.gnss.velocity_sigma_scale = SigmaScale::Fixed(1.0);
    config
}

/// Where the gate is as it was meant to be, learning and votes change nothing at all.
#[test]
fn an_honest_receiver_is_taken_at_its_word() {
    for seed in 0..SEEDS {
        let simulation = simulate(1.5, seed, |_| ());
        let (auto, plain) = (
            run(&simulation, &Config::default()),
            run(&simulation, &fixed()),
        );
        assert_eq!(auto.updates, plain.updates, "seed {seed}");
        assert_eq!(auto.resets, [0.0; 0]);
        // 240 fixes at a gate of 1e-4.
        assert!(auto.count(Verdict::Rejected) <= 2);
    }
}

/// Thirty seconds without any GNSS; what comes back is off by what the filter has drifted.
#[test]
fn an_outage_ends_with_the_first_fixes() {
    for seed in 0..SEEDS {
        let out = Span {
            begin_s: 120.0,
            end_s: 150.0,
        };
        let simulation = simulate(1.5, seed, |g| g.outages = vec![out]);
        // A unit ten times worse than the filter believes: its drift is far outside of its sigmas.
        let mut worse = scenario(1.5, |g| g.outages = vec![out]);
        worse.imu.errors = ImuErrorModel::from_noise(ImuGrade::Consumer.noise());
        let worse = worse.simulate(seed).expect("a scenario in range");
        let honest = run(&simulation, &Config::default());
        assert!(honest.worst_sigmas(120.0, 150.0) < 4.5, "seed {seed}");
        assert_eq!(honest.resets, [0.0; 0]);
        let dishonest = run(&worse, &Config::default());
        // Fixes of 1.5 m by axis: 3.5 sigmas of two of them are 7.4 m.
        for (record, by) in [(&honest, 153.0), (&dishonest, 165.0)] {
            let after = record.worst(by, LENGTH_S);
            assert!(after < 7.4, "seed {seed}: {after} m");
        }
    }
}

/// One fix in twenty 80 m off, and the very first one: as if they were not there.
#[test]
fn isolated_outliers_leave_no_trace() {
    for seed in 0..SEEDS {
        let clean = simulate(1.5, seed, |_| ());
        let mut bad = simulate(1.5, seed, |_| ());
        changed(&mut bad, |k, _, fix| {
            let angle = k as f64;
            let size = if k % 20 == 0 { 80.0 } else { 0.0 };
            moved(fix, size * angle.cos(), size * angle.sin())
        });
        let mut gone = clean.clone();
        changed(&mut gone, |k, _, fix| (k % 20 != 0).then_some(*fix));
        let config = Config::default();
        let (bad, gone) = (run(&bad, &config), run(&gone, &config));
        assert!(bad.count(Verdict::Rejected) >= 11);
        assert_eq!(bad.resets, [0.0; 0]);
        for (a, b) in bad
            .points
            .iter()
            .zip(&gone.points)
            .filter(|(a, _)| a.t > 5.0)
        {
            // The first fix is replaced, not dropped: what that leaves fades with the others.
            assert!((a.error - b.error).abs() < 1.5, "seed {seed}: {a:?} {b:?}");
        }
        let (a, b) = (bad.rms(20.0, LENGTH_S), gone.rms(20.0, LENGTH_S));
        assert!((a - b).abs() < 0.02, "seed {seed}: {a} {b}");
    }
}

/// Three to five in a row, all to the same side: refused, and the sigma says that something is wrong meanwhile.
#[test]
fn bursts_of_outliers_do_not_drag() {
    for seed in 0..SEEDS {
        let mut bad = simulate(1.5, seed, |_| ());
        let in_burst = |t: f64| {
            [(40.0, 3.0), (80.0, 4.0), (120.0, 5.0), (160.0, 5.0)]
                .iter()
                .any(|(begin, length)| (*begin..begin + length).contains(&t))
        };
        changed(&mut bad, |_, t, fix| {
            moved(fix, if in_burst(t + 0.5) { 80.0 } else { 0.0 }, 0.0)
        });
        let record = run(&bad, &Config::default());
        assert_eq!(record.count(Verdict::Rejected), 17, "seed {seed}");
        let worst = record.worst(20.0, LENGTH_S);
        assert!(worst < 6.0, "seed {seed}: {worst} m");
        let doubtful = record.within(122.0, 123.5).map(|p| p.sigma);
        assert!(doubtful.fold(f64::INFINITY, f64::min) > 40.0);
        let sure = record.within(130.0, 155.0).map(|p| p.sigma);
        assert!(sure.fold(0.0, f64::max) < 4.0);
    }
}

/// A step of 15 m that stays: another datum, or a reflection for as long as it lasts. Gone over to after ten fixes and no
/// later than twelve seconds, with a sigma that covers it from the third on, and never back and forth.
#[test]
fn a_lasting_step_is_followed_once() {
    for seed in 0..SEEDS {
        let (up, down) = (100.0, 170.0);
        let step = |t: f64| {
            if (up - 0.5..down - 0.5).contains(&t) {
                15.0
            } else {
                0.0
            }
        };
        let mut stepped = simulate(1.0, seed, |_| ());
        changed(&mut stepped, |_, t, fix| moved(fix, -step(t), 0.0));
        let record = run(&stepped, &Config::default());
        assert_eq!(record.resets.len(), 2, "seed {seed}: {:?}", record.resets);
        assert!((record.resets[0] - up).abs() < 12.0 && (record.resets[1] - down).abs() < 12.0);
        // Against the truth that the fixes tell: off by the step until gone over, covered by the sigma.
        for p in record.within(up + 2.5, record.resets[0]) {
            assert!(p.sigma > 10.0, "seed {seed}: {p:?}");
        }
        for p in record.within(record.resets[0] + 3.0, down) {
            // The truth of the simulation is 15 m away; 4.5 m are 3.5 sigmas of about 0.9 m by axis.
            assert!((p.error - 15.0).abs() < 4.5, "seed {seed}: {p:?}");
        }
        let back = record.worst(record.resets[1] + 3.0, LENGTH_S);
        assert!(back < 4.5, "seed {seed}: {back} m");
        // Going over touched the position alone: velocity keeps its residuals.
        let begin = stepped.trajectory.start();
        let refused = record.updates.iter().filter(|u| {
            u.measurement == "gnss_velocity"
                && u.verdict != Verdict::Accepted
                && u.time.since(begin) > up
        });
        assert_eq!(refused.count(), 0, "seed {seed}");
    }
}

/// The same position over and over, with a small sigma, while the car drives on and its velocity is right.
#[test]
fn a_frozen_position_does_not_drag() {
    // Between these the car of the scenario drives faster than 3 m/s.
    for seed in 0..SEEDS {
        let mut frozen = simulate(0.3, seed, |_| ());
        let clear = moving_stretch(&frozen, 20.0);
        let (begin, end) = (clear, clear + 20.0);
        let mut held = None;
        changed(&mut frozen, |_, t, fix| {
            if !(begin..end).contains(&t) {
                return Some(*fix);
            }
            let position = *held.get_or_insert(fix.position);
            Some(GnssPosition {
                position,
                covariance_n: Some(Matrix3::identity() * 0.01),
                ..*fix
            })
        });
        let record = run(&frozen, &Config::default());
        let count = record.count(Verdict::Frozen);
        assert!((18..=20).contains(&count), "seed {seed}: {count}");
        // Twenty seconds on velocities of 0.05 m/s: well below a metre.
        let worst = record.worst(begin, end + 5.0);
        assert!(worst < 2.0, "seed {seed}: {worst} m");
        assert_eq!(record.resets, [0.0; 0]);
        // Negative control: the last digit changes, so that it is not seen to be frozen; the votes then go over to it.
        let mut k = 0.0;
        let mut jittering = frozen.clone();
        changed(&mut jittering, |_, t, fix| {
            k += 1.0;
            moved(
                fix,
                if (begin..end).contains(&t) {
                    1e-3 * k
                } else {
                    0.0
                },
                0.0,
            )
        });
        let record = run(&jittering, &Config::default());
        assert!(record.worst(begin, end + 5.0) > 20.0, "seed {seed}");
    }
}

/// Begin of the first stretch of `length` seconds faster than 3 m/s.
fn moving_stretch(simulation: &Simulation, length: f64) -> f64 {
    let speed = |t: f64| {
        let time = simulation.trajectory.start().plus(t);
        simulation.truth_at(time).nav.velocity_n.norm()
    };
    let fits = |begin: &f64| (0..=20).all(|i| speed(begin + length * f64::from(i) / 20.0) > 3.0);
    (60..200)
        .map(f64::from)
        .find(fits)
        .expect("a car drives for twenty seconds now and then")
}

/// A receiver that holds its position while the car stands is a good one.
#[test]
fn a_position_held_at_a_stop_is_used() {
    let mut standing = Scenario::standing(120.0, 30.0);
    standing.imu.rate_hz = 50.0;
    for with_velocity in [true, false] {
        standing.gnss.velocity_rate_hz = if with_velocity { 1.0 } else { 0.0 };
        let mut simulation = standing.simulate(3).expect("a scenario in range");
        let mut held = None;
        changed(&mut simulation, |_, _, fix| {
            let position = *held.get_or_insert(fix.position);
            Some(GnssPosition { position, ..*fix })
        });
        let mut config = Config::default();
        config.alignment.heading_deg = Some(30.0);
        let record = run(&simulation, &config);
        assert_eq!(record.count(Verdict::Frozen), 0);
        assert!(record.count(Verdict::Accepted) > 118);
    }
}

/// Errors of 3 m stated as 1 cm: learnt upward, within a minute, to NIS 1 and a sigma that is true.
#[test]
fn understated_sigmas_are_learnt() {
    for seed in 0..SEEDS {
        let mut lying = simulate(3.0, seed, |_| ());
        let small = Matrix3::identity() * 1e-4;
        changed(&mut lying, |_, _, fix| {
            Some(GnssPosition {
                covariance_n: Some(small),
                ..*fix
            })
        });
        let record = run(&lying, &Config::default());
        let honest = run(&simulate(3.0, seed, |_| ()), &fixed()).rms(90.0, LENGTH_S);
        let rms = record.rms(90.0, LENGTH_S);
        assert!(
            rms < 1.3 * honest,
            "seed {seed}: {rms} m, {honest} m if told"
        );
        let nees = record.nees(90.0, LENGTH_S);
        assert!(nees < 3.0, "seed {seed}: NEES {nees}");
        let nis = record.nis(90.0);
        assert!((0.7..1.4).contains(&nis), "seed {seed}: NIS {nis}");
        // Negative control: as stated, the sigma of the solution is a fiction.
        let believed = run(&lying, &fixed());
        let nees = believed.nees(90.0, LENGTH_S);
        assert!(nees > 10.0, "seed {seed}: NEES {nees} as stated");
    }
}

/// Scatter of 1 to 5 cm stated as 3 m: learnt downward, so that the position follows the fixes.
#[test]
fn overstated_sigmas_are_learnt() {
    for seed in 0..SEEDS {
        for sigma in [0.01, 0.05] {
            let mut shy = simulate(sigma, seed, |g| {
                (g.position_rate_hz, g.velocity_rate_hz) = (5.0, 5.0);
            });
            changed(&mut shy, |_, _, fix| {
                Some(GnssPosition {
                    covariance_n: Some(Matrix3::identity() * 9.0),
                    ..*fix
                })
            });
            let learnt = run(&shy, &Config::default());
            let believed = run(&shy, &fixed());
            let (a, b) = (learnt.rms(90.0, LENGTH_S), believed.rms(90.0, LENGTH_S));
            assert!(
                a < 0.1 && b > 3.0 * a,
                "seed {seed}, {sigma} m: {a} m, {b} m"
            );
            // What was stated stays in the solution's sigma: residuals cannot tell an offset of metres from none.
            assert!(learnt.worst_sigmas(90.0, LENGTH_S) < 1.0);
            assert_eq!(learnt.resets, [0.0; 0]);
        }
    }
}

/// An offset of metres that stays, as stated, under a scatter of centimetres: the filter follows, and its sigma must not forget
/// what no residual shows.
#[test]
fn what_residuals_do_not_show_stays_in_the_sigma() {
    for seed in 0..SEEDS {
        let mut offset = simulate(0.03, seed, |g| {
            (g.position_rate_hz, g.velocity_rate_hz) = (5.0, 5.0);
        });
        changed(&mut offset, |_, _, fix| {
            Some(GnssPosition {
                covariance_n: Some(Matrix3::identity() * 9.0),
                ..moved(fix, 2.5, -3.5)?
            })
        });
        let nees = run(&offset, &Config::default()).nees(60.0, LENGTH_S);
        // (2.5² + 3.5²) / 9 / 2.
        assert!((nees - 1.03).abs() < 0.15, "seed {seed}: {nees}");
        // Negative control: a factor given by hand claims that the scatter is all there is.
        let mut told = fixed();
        told.gnss.sigma_scale = SigmaScale::Fixed(0.01);
        let nees = run(&offset, &told).nees(60.0, LENGTH_S);
        assert!(nees > 1000.0, "seed {seed}: {nees}");
    }
}

/// Errors that wander within minutes, of the stated size: with white noise in the filter its sigma is too small (states for
/// the colour mend that), and learning must not make it worse.
#[test]
fn wandering_errors_are_not_made_worse() {
    let (mut learnt, mut stated) = (0.0, 0.0);
    for seed in 0..SEEDS {
        for rate in [1.0, 5.0] {
            let simulation = simulate(0.03, seed, |g| {
                (g.position_rate_hz, g.velocity_rate_hz) = (rate, rate);
                g.position_colour_sigma_m = [2.5, 2.5, 4.0];
                g.position_colour_tau_s = 100.0;
            });
            learnt += run(&simulation, &Config::default()).nees(60.0, LENGTH_S);
            stated += run(&simulation, &fixed()).nees(60.0, LENGTH_S);
        }
    }
    println!("sum of NEES of eight drives: {learnt:.1} learnt, {stated:.1} as stated");
    assert!(learnt < 1.05 * stated, "{learnt} {stated}");
}

/// Rows once a second that are a second late and claim to be exact, between good ones.
#[test]
fn late_rows_that_claim_to_be_exact_are_refused() {
    for seed in 0..SEEDS {
        let clean = simulate(0.02, seed, |g| {
            (g.position_rate_hz, g.velocity_rate_hz) = (4.0, 4.0);
        });
        let mut late = clean.clone();
        let mut past: Vec<GnssPosition> = Vec::new();
        changed(&mut late, |k, _, fix| {
            past.push(*fix);
            if k % 4 != 0 || k < 4 {
                return Some(*fix);
            }
            Some(GnssPosition {
                position: past[k - 4].position,
                covariance_n: Some(Matrix3::zeros()),
                ..*fix
            })
        });
        let config = Config::default();
        let (bad, good) = (run(&late, &config), run(&clean, &config));
        let (a, b) = (bad.rms(20.0, LENGTH_S), good.rms(20.0, LENGTH_S));
        assert!(a < 1.3 * b + 0.01, "seed {seed}: {a} m, {b} m without");
        assert_eq!(bad.resets, [0.0; 0]);
    }
}

/// Outliers of the simulator itself, at random, in both kinds.
#[test]
fn random_outliers_do_not_widen_what_is_learnt() {
    for seed in 0..SEEDS {
        let simulation = simulate(1.5, seed, |g| {
            g.outlier_probability = 0.1;
            g.outlier_size_m = 80.0;
        });
        let record = run(&simulation, &Config::default());
        let rms = record.rms(30.0, LENGTH_S);
        assert!(rms < 2.0, "seed {seed}: {rms} m");
        let nis = record.nis(60.0);
        assert!((0.6..1.4).contains(&nis), "seed {seed}: {nis}");
    }
}
