//! Rest at the begin of the data, judged by the inertial unit alone: what a run without GNSS starts from.

use super::track::Inertial;
use crate::imu::ImuNoise;
use crate::time::Time;
use nalgebra::Vector3;
use std::vec::Vec;

/// Rates and forces are averaged over pieces of this length, s: idling engines and white noise average out, a person who is
/// about to set off does not.
const PIECE: f64 = 0.25;
/// The first pieces, which have nothing to be compared with but each other: a second.
const FIRST: usize = 4;
/// More rest than this tells nothing more, s: vibration has averaged out, and gyro drift comes in. Long enough to see the end of
/// a slow turn that begins with the data and lasts for half a minute.
const ENOUGH: f64 = 45.0;
/// A second is rest where its pieces scatter by no more than this: rate, rad/s (0.15 °/s), and force, m/s². A foot on the
/// ground shows 0.1 °/s and 0.005 m/s², parked cars mostly 0.12 °/s and 0.03 m/s². Of 900 seconds of real drives above 3 m/s
/// none is below 0.033 m/s².
const QUIET_RATE: f64 = 2.6e-3;
const QUIET_FORCE: f64 = 0.02;
/// What is livelier needs so many pieces (4 s) and may scatter by this (0.2 °/s, 0.1 m/s²), which an engine that idles does in 94
/// of 100 cases, a car on a smooth motorway never, one at 15 m/s on a smooth road once in 250.
const MANY: usize = 16;
const STILL_RATE: f64 = 3.5e-3;
const STILL_FORCE: f64 = 0.1;
/// A larger mean rate is no bias of any unit, rad/s.
const STILL_MEAN_RATE: f64 = 0.05;
/// A piece that differs from the mean by more than so many of the scatters is motion.
const DIFFERS: f64 = 5.0;
/// The scatter of the first second has nine degrees of freedom, and Student's distribution wide tails: this over the degrees of
/// freedom is added to one, which keeps the chance near one in a million.
const FEW: f64 = 10.0;
/// Scatters are taken for no less than this, rad/s (0.05 °/s) and m/s²: coarse steps hide the noise, and slower motion in a
/// quarter of a second is no motion.
const LEAST_RATE: f64 = 8.7e-4;
const LEAST_FORCE: f64 = 0.02;
/// A mean rate that changes by more than so many of its sigmas is a turn, before or after. Tried at every piece and on three
/// axes: by chance in less than one start in a thousand.
const CHANGED: f64 = 4.5;
/// A change so many pieces (2 s) or less before motion is the begin of that motion.
const TAIL: usize = 8;

/// What a body at rest shows of its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rest {
    /// Mean angular rate: bias and Earth rate, rad/s.
    pub(super) rate_b: Vector3<f64>,
    /// Standard deviation of that mean, by its own scatter.
    pub(super) rate_sigma: f64,
    /// By how much the mean rate changed meanwhile, rad/s; zero where it was steady. Which of it was rest and which a slow
    /// turn the gyros do not tell.
    pub(super) rate_doubt: Vector3<f64>,
    /// The end of what was looked at, where it was not steady.
    pub(super) doubtful_until: Option<Time>,
    /// Mean specific force, m/s².
    pub(super) force_b: Vector3<f64>,
    /// Standard deviation of that mean, likewise.
    pub(super) force_sigma: f64,
    /// Length, s.
    pub(super) span: f64,
    /// Whether more data would add nothing: motion was seen, or there is enough.
    pub(super) over: bool,
}

/// Means of pieces and their scatter.
struct Pieces {
    means: Vec<Vector3<f64>>,
    least: f64,
}

impl Pieces {
    fn new(least: f64) -> Self {
        Pieces {
            means: Vec::new(),
            least,
        }
    }

    fn mean(&self) -> Vector3<f64> {
        mean(&self.means)
    }

    /// Standard deviation of a piece, all axes together.
    fn scatter(&self) -> f64 {
        let mean = self.mean();
        let squares: f64 = self.means.iter().map(|m| (m - mean).norm_squared()).sum();
        let freedom = 3 * (self.means.len() - 1).max(1);
        (squares / freedom as f64).sqrt()
    }

    fn fits(&self, next: &Vector3<f64>) -> bool {
        let count = self.means.len() as f64;
        let few = 1.0 + FEW / (3.0 * (count - 1.0).max(1.0));
        let widening = few * (1.0 + 1.0 / count).sqrt();
        (next - self.mean()).amax() <= DIFFERS * widening * self.scatter().max(self.least)
    }

    fn sigma(&self) -> f64 {
        self.scatter() / (self.means.len() as f64).sqrt()
    }

    /// After how many pieces the mean changes, by a two-sample t statistic at its maximum: against the scatter about either
    /// mean, and against what a bias of this class wanders meanwhile.
    fn change(&self, noise: &ImuNoise) -> Option<usize> {
        let n = self.means.len();
        if n < 2 * FIRST {
            return None;
        }
        let count = n as f64;
        let all = self.mean();
        let total: f64 = self.means.iter().map(|m| (m - all).norm_squared()).sum();
        // Half the length lies between the middles of the two parts, wherever the cut is.
        let wander = noise.gyro_bias_sigma.powi(2) * count * PIECE / noise.gyro_bias_tau;
        let mut before: Vector3<f64> = self.means[..FIRST - 1].iter().sum();
        let mut found = (CHANGED, None);
        for k in FIRST..=n - FIRST {
            before += self.means[k - 1];
            let (first, last) = (k as f64, (n - k) as f64);
            let difference = (all * count - before) / last - before / first;
            let between = first * last / count * difference.norm_squared();
            let scatter = ((total - between).max(0.0) / (3.0 * (count - 2.0))).sqrt();
            let own = scatter.max(self.least).powi(2) * (1.0 / first + 1.0 / last);
            let z = difference.amax() / (own + wander).sqrt();
            if z > found.0 {
                found = (z, Some(k));
            }
        }
        found.1
    }

    /// By how much two seconds of it differ from the mean of the first `k` pieces, at most, on each axis.
    fn range(&self, k: usize) -> Vector3<f64> {
        let first = mean(&self.means[..k]);
        self.means
            .chunks_exact(TAIL)
            .fold(Vector3::zeros(), |range, chunk| {
                range.sup(&(mean(chunk) - first).abs())
            })
    }
}

fn mean(of: &[Vector3<f64>]) -> Vector3<f64> {
    of.iter().sum::<Vector3<f64>>() / of.len().max(1) as f64
}

/// Whether what was seen so far is rest; `None` as long as more has to be seen.
fn is_rest(rate: &Pieces, force: &Pieces) -> Option<bool> {
    let n = rate.means.len();
    let below = |most_rate, most_force| {
        rate.scatter() <= most_rate
            && force.scatter() <= most_force
            && rate.mean().norm() <= STILL_MEAN_RATE
    };
    if n >= FIRST && below(QUIET_RATE, QUIET_FORCE) {
        Some(true)
    } else if n >= MANY {
        Some(below(STILL_RATE, STILL_FORCE))
    } else {
        None
    }
}

/// Means of a piece, and its end.
struct Piece {
    rate_b: Vector3<f64>,
    force_b: Vector3<f64>,
    end: Time,
}

/// All complete pieces, up to [`ENOUGH`].
fn pieces(imu: &[Inertial]) -> Vec<Piece> {
    let mut all = Vec::new();
    let mut rest = imu;
    while let (Some(begin), Some(first)) = (imu.first(), rest.first())
        && first.time.since(begin.time) < ENOUGH
    {
        let inside = |s: &&Inertial| s.time.since(first.time) < PIECE;
        let count = rest.iter().take_while(inside).count();
        let (piece, after) = rest.split_at(count);
        let Some(next) = after.first() else {
            // The newest piece is not complete.
            break;
        };
        let mean = |of: fn(&Inertial) -> Vector3<f64>| {
            piece.iter().map(of).sum::<Vector3<f64>>() / count as f64
        };
        all.push(Piece {
            rate_b: mean(|s| s.rate_b),
            force_b: mean(|s| s.force_b),
            end: next.time,
        });
        rest = after;
    }
    all
}

/// Whether the body is as quiet as before in what follows a piece that did not fit, if with another mean rate: then it was no motion
/// that began there, but perhaps a slow turn that ended.
fn goes_on(following: &[Piece], rate: &Pieces, force: &Pieces) -> bool {
    let (mut rates, mut forces) = (Pieces::new(LEAST_RATE), Pieces::new(LEAST_FORCE));
    for piece in following {
        rates.means.push(piece.rate_b);
        forces.means.push(piece.force_b);
    }
    rates.scatter() <= QUIET_RATE.max(1.5 * rate.scatter())
        && forces.scatter() <= QUIET_FORCE.max(1.5 * force.scatter())
        && force.fits(&forces.mean())
}

/// The rest that the data begin with, of a unit of this class; `None` if they begin with motion or are too short to tell.
pub(super) fn rest_at_begin(imu: &[Inertial], noise: &ImuNoise) -> Option<Rest> {
    let begin = imu.first()?.time;
    let all = pieces(imu);
    let (mut rate, mut force) = (Pieces::new(LEAST_RATE), Pieces::new(LEAST_FORCE));
    let (mut rests, mut moves) = (false, false);
    let mut end = begin;
    while let [next, ..] = &all[rate.means.len()..] {
        let mut take = 1;
        if rests && !(rate.fits(&next.rate_b) && force.fits(&next.force_b)) {
            let from = rate.means.len();
            let Some(following) = all.get(from..from + TAIL) else {
                break;
            };
            if !goes_on(following, &rate, &force) {
                moves = true;
                break;
            }
            take = TAIL;
        }
        for piece in &all[rate.means.len()..][..take] {
            rate.means.push(piece.rate_b);
            force.means.push(piece.force_b);
            end = piece.end;
        }
        if !rests {
            match is_rest(&rate, &force) {
                Some(true) => rests = true,
                Some(false) => return None,
                None => {}
            }
        }
    }
    if !rests {
        return None;
    }
    if moves {
        // It begins before it is seen; two seconds of rest are kept, whatever is in them.
        let keep = rate.means.len() - TAIL.min(rate.means.len().saturating_sub(TAIL) / 2);
        rate.means.truncate(keep);
        force.means.truncate(keep);
        end = all[keep - 1].end;
    }
    let over = moves || all.last()?.end.since(begin) >= ENOUGH;
    let (mut rate_doubt, mut doubtful_until) = (Vector3::zeros(), None);
    while let Some(k) = rate.change(noise) {
        let last = rate.means.len() - k;
        if !(moves && last <= TAIL) {
            rate_doubt = rate.range(k);
            doubtful_until = Some(end);
        }
        rate.means.truncate(k);
        force.means.truncate(k);
        if doubtful_until.is_some() {
            break;
        }
    }
    Some(Rest {
        rate_b: rate.mean(),
        rate_sigma: rate.sigma(),
        rate_doubt,
        doubtful_until,
        force_b: force.mean(),
        force_sigma: force.sigma(),
        span: end.since(begin).min(PIECE * rate.means.len() as f64),
        over,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu::ImuGrade;
    use crate::sim::{Source, Stream};
    use nalgebra::UnitQuaternion;

    const BIAS: Vector3<f64> = Vector3::new(0.004, -0.003, 0.002);
    const GRAVITY: Vector3<f64> = Vector3::new(0.3, -0.2, -9.8);
    const RATE_WHITE: f64 = 6e-3;

    fn found(imu: &[Inertial]) -> Option<Rest> {
        rest_at_begin(imu, &ImuGrade::Consumer.noise())
    }

    /// At 100 Hz for so many seconds; `motion` is added to the rate from `moves_at` on.
    fn data(seconds: f64, moves_at: f64, motion: f64, seed: u64) -> Vec<Inertial> {
        let mut noise = Source::new(seed, Stream::GyroWhite);
        (0..(seconds * 100.0) as i64)
            .map(|i| {
                let t = 0.01 * i as f64;
                let turn = if t < moves_at { 0.0 } else { motion };
                // Gravity turns the other way in the axes of a body that turns.
                let tilt = UnitQuaternion::from_scaled_axis(Vector3::y() * -turn * (t - moves_at));
                Inertial {
                    time: Time::from_seconds(1e9 + t),
                    rate_b: BIAS + noise.normal3() * RATE_WHITE + Vector3::y() * turn,
                    force_b: tilt * GRAVITY + noise.normal3() * 0.05,
                }
            })
            .collect()
    }

    #[test]
    fn the_mean_at_rest_is_told_with_its_own_scatter() {
        // Normalised squares over 300 starts, 3 axes: mean 1, a little above for a scatter of few pieces.
        let (mut squares, mut cut_short, runs) = (0.0, 0, 300);
        for seed in 0..runs {
            let rest = found(&data(4.0, 99.0, 0.0, seed)).expect("at rest");
            cut_short += i32::from(rest.span < 3.4);
            squares += (rest.rate_b - BIAS).norm_squared() / rest.rate_sigma.powi(2);
        }
        let mean = squares / f64::from(3 * runs as u32);
        assert!((0.9..1.2).contains(&mean), "{mean}");
        // One mean that changes by chance, or one piece that differs.
        assert!(cut_short <= 1, "{cut_short} of {runs}");
    }

    #[test]
    fn rest_ends_where_motion_begins() {
        // One degree a second is a tenth of a step's.
        let rest = found(&data(6.0, 2.0, 0.0175, 5)).expect("at rest");
        assert!(rest.over && (1.9..=2.1).contains(&rest.span), "{rest:?}");
        let waiting = found(&data(2.0, 99.0, 0.0, 5)).expect("at rest");
        assert!(!waiting.over, "more may come");
        let long = found(&data(50.0, 99.0, 0.0, 5)).expect("at rest");
        assert!(long.over && long.span <= ENOUGH + PIECE, "{long:?}");
    }

    #[test]
    fn motion_at_the_begin_and_too_little_data_are_no_rest() {
        assert_eq!(found(&data(0.9, 99.0, 0.0, 1)), None);
        assert_eq!(found(&data(5.0, 0.5, 0.2, 1)), None);
        assert_eq!(found(&data(5.0, 0.0, 0.2, 1)), None);
    }

    /// Turns about Down at this rate between two instants; force as at rest, as of a body that turns on the spot.
    fn slow_turn(rate: f64, from: f64, to: f64, seed: u64) -> Vec<Inertial> {
        let mut imu = data(60.0, 99.0, 0.0, seed);
        let begin = imu[0].time;
        for s in &mut imu {
            let t = s.time.since(begin);
            if (from..to).contains(&t) {
                s.rate_b.z += rate;
            }
        }
        imu
    }

    /// 3° in 15 s, and 0.1 °/s for half a minute: no single piece shows them, the means do.
    #[test]
    fn a_slow_turn_at_the_begin_is_doubted() {
        for (rate_deg, from, to) in [
            (0.2, 0.0, 15.0),
            (0.2, 10.0, 25.0),
            (0.2, 20.0, 35.0),
            (0.1, 0.0, 30.0),
            (0.1, 10.0, 60.0),
        ] {
            let (runs, mut worst) = (30, 0.0_f64);
            for seed in 0..runs {
                let turn = f64::to_radians(rate_deg);
                let rest =
                    found(&slow_turn(turn, from, to, seed)).expect("at rest, or so it seems");
                assert!(
                    rest.doubtful_until.is_some(),
                    "{rate_deg} from {from}, seed {seed}: {rest:?}"
                );
                let off = (rest.rate_b - BIAS).z.abs();
                worst = worst.max(off / rest.rate_doubt.z.hypot(rest.rate_sigma));
                // The control: what the mean of all of it would be off by, in its sigmas.
                let taken = (to.min(ENOUGH) - from) / ENOUGH * turn;
                let plain = 0.1 * ImuGrade::Consumer.noise().gyro_bias_sigma;
                assert!(taken > 3.0 * plain, "{taken} of {plain}");
            }
            assert!(worst < 1.5, "{rate_deg} from {from}: {worst} sigmas");
        }
    }

    #[test]
    fn true_rest_is_not_doubted() {
        let runs = 300;
        let doubted = (0..runs)
            .filter(|seed| {
                let rest = found(&data(46.0, 99.0, 0.0, *seed)).expect("at rest");
                rest.doubtful_until.is_some() || rest.span < ENOUGH - 1.0
            })
            .count();
        assert!(doubted <= 1, "{doubted} of {runs}");
    }

    /// A car on a smooth motorway: it feels the road below 5 Hz, if little. What the test adds on one axis is the scatter of three.
    #[test]
    fn a_second_of_smooth_road_is_no_rest() {
        let swaying = |sway: f64, seed: u64| {
            let mut imu = data(6.0, 99.0, 0.0, seed);
            let begin = imu[0].time;
            for s in &mut imu {
                let t = s.time.since(begin);
                s.force_b.y += sway * (9.0 * t + seed as f64).sin();
            }
            imu
        };
        for seed in 0..20 {
            assert_eq!(found(&swaying(0.4, seed)), None, "seed {seed}");
            // An engine that shakes a parked car by a quarter of that.
            assert!(found(&swaying(0.1, seed)).is_some(), "seed {seed}");
        }
    }
}
