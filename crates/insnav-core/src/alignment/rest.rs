//! Rest at the begin of the data, judged by the inertial unit alone: what a run without GNSS starts from.

use super::track::Inertial;
use nalgebra::Vector3;
use std::vec::Vec;

/// Rates and forces are averaged over pieces of this length, s: idling engines and white noise average out, a person who is
/// about to set off does not.
const PIECE: f64 = 0.25;
/// The first pieces, which have nothing to be compared with but each other: a second.
const FIRST: usize = 4;
/// More rest than this tells nothing more, s: vibration has averaged out, and gyro drift comes in.
const ENOUGH: f64 = 30.0;
/// What the pieces of a body at rest scatter by at most: rate, rad/s (0.5 °/s; a parked car that sways by 0.1° at 0.4 Hz
/// scatters by 0.18), and force, m/s².
const STILL_RATE: f64 = 8.7e-3;
const STILL_FORCE: f64 = 0.15;
/// A larger mean rate is no bias of any unit, rad/s.
const STILL_MEAN_RATE: f64 = 0.05;
/// A piece that differs from the mean by more than so many of the scatters is motion. The scatter of the first second has nine
/// degrees of freedom: rest ends too early after a second in one start of a hundred, which costs accuracy and no more.
const DIFFERS: f64 = 5.0;
/// Scatters are taken for no less than this, rad/s (0.05 °/s) and m/s²: coarse steps hide the noise, and slower motion in a
/// quarter of a second is no motion.
const LEAST_RATE: f64 = 8.7e-4;
const LEAST_FORCE: f64 = 0.02;

/// What a body at rest shows of its unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rest {
    /// Mean angular rate: bias and Earth rate, rad/s.
    pub(super) rate_b: Vector3<f64>,
    /// Standard deviation of that mean, by its own scatter.
    pub(super) rate_sigma: f64,
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
    fn mean(&self) -> Vector3<f64> {
        self.means.iter().sum::<Vector3<f64>>() / self.means.len() as f64
    }

    /// Standard deviation of a piece, all axes together.
    fn scatter(&self) -> f64 {
        let mean = self.mean();
        let squares: f64 = self.means.iter().map(|m| (m - mean).norm_squared()).sum();
        let freedom = 3 * (self.means.len() - 1).max(1);
        (squares / freedom as f64).sqrt()
    }

    fn fits(&self, next: &Vector3<f64>) -> bool {
        let widening = (1.0 + 1.0 / self.means.len() as f64).sqrt();
        (next - self.mean()).amax() <= DIFFERS * widening * self.scatter().max(self.least)
    }

    fn sigma(&self) -> f64 {
        self.scatter() / (self.means.len() as f64).sqrt()
    }
}

/// The rest that the data begin with; `None` if they begin with motion or are shorter than a second.
pub(super) fn rest_at_begin(imu: &[Inertial]) -> Option<Rest> {
    let begin = imu.first()?.time;
    let mut rate = Pieces {
        means: Vec::new(),
        least: LEAST_RATE,
    };
    let mut force = Pieces {
        means: Vec::new(),
        least: LEAST_FORCE,
    };
    let (mut rest, mut over) = (imu, false);
    let mut end = begin;
    while let Some(first) = rest.first() {
        if first.time.since(begin) >= ENOUGH {
            over = true;
            break;
        }
        let count = rest
            .iter()
            .take_while(|s| s.time.since(first.time) < PIECE)
            .count();
        let (piece, after) = rest.split_at(count);
        let Some(next) = after.first() else {
            // The newest piece is not complete.
            break;
        };
        let mean = |of: fn(&Inertial) -> Vector3<f64>| {
            piece.iter().map(of).sum::<Vector3<f64>>() / count as f64
        };
        let (w, f) = (mean(|s| s.rate_b), mean(|s| s.force_b));
        if rate.means.len() >= FIRST && !(rate.fits(&w) && force.fits(&f)) {
            over = true;
            break;
        }
        rate.means.push(w);
        force.means.push(f);
        end = next.time;
        rest = after;
        if rate.means.len() == FIRST {
            let still = rate.scatter() <= STILL_RATE
                && force.scatter() <= STILL_FORCE
                && rate.mean().norm() <= STILL_MEAN_RATE;
            if !still {
                return None;
            }
        }
    }
    (rate.means.len() >= FIRST).then(|| Rest {
        rate_b: rate.mean(),
        rate_sigma: rate.sigma(),
        force_b: force.mean(),
        force_sigma: force.sigma(),
        span: end.since(begin),
        over,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Source, Stream};
    use crate::time::Time;

    const BIAS: Vector3<f64> = Vector3::new(0.004, -0.003, 0.002);
    const GRAVITY: Vector3<f64> = Vector3::new(0.3, -0.2, -9.8);
    const RATE_WHITE: f64 = 6e-3;

    /// At 100 Hz for so many seconds; `motion` is added to the rate from `moves_at` on.
    fn data(seconds: f64, moves_at: f64, motion: f64, seed: u64) -> Vec<Inertial> {
        let mut noise = Source::new(seed, Stream::GyroWhite);
        (0..(seconds * 100.0) as i64)
            .map(|i| {
                let t = 0.01 * i as f64;
                let turn = if t < moves_at { 0.0 } else { motion };
                Inertial {
                    time: Time::from_seconds(1e9 + t),
                    rate_b: BIAS + noise.normal3() * RATE_WHITE + Vector3::y() * turn,
                    force_b: GRAVITY + noise.normal3() * 0.05,
                }
            })
            .collect()
    }

    #[test]
    fn the_mean_at_rest_is_told_with_its_own_scatter() {
        // Normalised squares over 300 starts, 3 axes: mean 1, a little above for a scatter of few pieces.
        let (mut squares, mut cut_short, runs) = (0.0, 0, 300);
        for seed in 0..runs {
            let rest = rest_at_begin(&data(4.0, 99.0, 0.0, seed)).expect("at rest");
            cut_short += i32::from(rest.span < 3.4);
            squares += (rest.rate_b - BIAS).norm_squared() / rest.rate_sigma.powi(2);
        }
        let mean = squares / f64::from(3 * runs as u32);
        assert!((0.9..1.2).contains(&mean), "{mean}");
        // Six components, and a chance of 7e-4 that falls with every piece: one start in a hundred; thrice that is chance.
        assert!(cut_short <= 9, "{cut_short} of {runs}");
    }

    #[test]
    fn rest_ends_where_motion_begins() {
        // One degree a second is a tenth of a step's.
        let rest = rest_at_begin(&data(6.0, 2.0, 0.0175, 5)).expect("at rest");
        assert!(rest.over && (1.9..=2.1).contains(&rest.span), "{rest:?}");
        let waiting = rest_at_begin(&data(2.0, 99.0, 0.0, 5)).expect("at rest");
        assert!(!waiting.over, "more may come");
        let long = rest_at_begin(&data(40.0, 99.0, 0.0, 5)).expect("at rest");
        assert!(long.over && long.span <= ENOUGH + PIECE, "{long:?}");
    }

    #[test]
    fn motion_at_the_begin_and_too_little_data_are_no_rest() {
        assert_eq!(rest_at_begin(&data(0.9, 99.0, 0.0, 1)), None);
        assert_eq!(rest_at_begin(&data(5.0, 0.5, 0.2, 1)), None);
        assert_eq!(rest_at_begin(&data(5.0, 0.0, 0.2, 1)), None);
    }
}
