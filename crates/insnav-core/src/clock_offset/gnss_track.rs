//! What a receiver said, as curves: positions as metres along the way, velocity as a cubic with its integral.

use super::median;
use crate::earth::gravity;
use crate::sample::Sample;
use crate::time::Time;
use nalgebra::Vector3;

/// Positions as metres along the way, and their stamps.
///
/// Summed from fix to fix in the NED axes of each, as velocities are: over hours this is no map, over seconds it is exact.
pub(super) struct Path {
    pub(super) t: Vec<f64>,
    pub(super) p: Vec<Vector3<f64>>,
    /// Time from fix to fix, s (median).
    pub(super) interval: f64,
    /// Gravity at the first fix, m/s²; it changes by 1e-4 m/s² over 100 km.
    pub(super) gravity: f64,
}

impl Path {
    pub(super) fn new(samples: &[Sample], zero: Time) -> Self {
        // A receiver that states sigmas does not vouch for the fixes without.
        let with_sigma =
            |s: &&Sample| matches!(s, Sample::GnssPosition(p) if p.covariance_n.is_some());
        let positions = |s: &&Sample| matches!(s, Sample::GnssPosition(_));
        let states = 2 * samples.iter().filter(with_sigma).count()
            > samples.iter().filter(positions).count();
        let mut fixes: Vec<_> = samples
            .iter()
            .filter_map(|s| match s {
                Sample::GnssPosition(p)
                    if p.position.is_valid() && (p.covariance_n.is_some() || !states) =>
                {
                    Some((p.time.since(zero), p.position))
                }
                _ => None,
            })
            .collect();
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0));
        fixes.dedup_by(|a, b| a.0 == b.0);
        let mut p = Vector3::zeros();
        let mut path = Path {
            t: Vec::new(),
            p: Vec::new(),
            interval: median_interval(fixes.iter().map(|f| f.0)),
            gravity: fixes.first().map_or(0.0, |f| gravity(&f.1)),
        };
        for (i, (t, at)) in fixes.iter().enumerate() {
            if i > 0 {
                p += fixes[i - 1].1.offset_to(at);
            }
            path.t.push(*t);
            path.p.push(p);
        }
        path
    }
}

/// Median of the differences between successive stamps, s.
pub(super) fn median_interval(stamps: impl Iterator<Item = f64> + Clone) -> f64 {
    let mut d: Vec<f64> = stamps
        .clone()
        .skip(1)
        .zip(stamps)
        .map(|(b, a)| b - a)
        .collect();
    median(&mut d)
}

/// Horizontal velocity as a cubic between fixes, with its integral.
pub(super) struct Track {
    pub(super) t: Vec<f64>,
    v: Vec<[f64; 2]>,
    slope: Vec<[f64; 2]>,
    integral: Vec<[f64; 2]>,
    /// Holes before each fix, counted from the first.
    holes: Vec<u32>,
    /// Time from fix to fix, s (median).
    pub(super) interval: f64,
}

impl Track {
    pub(super) fn new(samples: &[Sample], zero: Time) -> Self {
        let mut fixes: Vec<(f64, [f64; 2])> = samples
            .iter()
            .filter_map(|s| match s {
                Sample::GnssVelocity(v) => {
                    Some((v.time.since(zero), [v.velocity_n.x, v.velocity_n.y]))
                }
                _ => None,
            })
            .filter(|(_, v)| v[0].is_finite() && v[1].is_finite())
            .collect();
        fixes.sort_by(|a, b| a.0.total_cmp(&b.0));
        fixes.dedup_by(|a, b| a.0 == b.0);
        let interval = median_interval(fixes.iter().map(|f| f.0));
        let mut track = Track {
            t: Vec::new(),
            v: Vec::new(),
            slope: Vec::new(),
            integral: Vec::new(),
            holes: Vec::new(),
            interval,
        };
        let (mut holes, mut clamped) = (0, false);
        for (t, v) in fixes {
            if v == [0.0, 0.0] {
                clamped = true;
                continue;
            }
            if clamped || track.t.last().is_some_and(|last| t - last > 3.0 * interval) {
                holes += 1;
            }
            clamped = false;
            track.t.push(t);
            track.v.push(v);
            track.holes.push(holes);
        }
        track.integrate();
        track
    }

    fn integrate(&mut self) {
        let n = self.t.len();
        for i in 0..n {
            // Central differences, one-sided at holes and ends.
            let before = if i > 0 && self.holes[i - 1] == self.holes[i] {
                i - 1
            } else {
                i
            };
            let after = if i + 1 < n && self.holes[i + 1] == self.holes[i] {
                i + 1
            } else {
                i
            };
            let dt = self.t[after] - self.t[before];
            let rate = |k: usize| {
                if dt > 0.0 {
                    (self.v[after][k] - self.v[before][k]) / dt
                } else {
                    0.0
                }
            };
            self.slope.push([rate(0), rate(1)]);
        }
        let mut sum = [0.0; 2];
        for i in 0..n {
            if i > 0 {
                let h = self.t[i] - self.t[i - 1];
                for (k, s) in sum.iter_mut().enumerate() {
                    *s += 0.5 * h * (self.v[i - 1][k] + self.v[i][k])
                        + h * h / 12.0 * (self.slope[i - 1][k] - self.slope[i][k]);
                }
            }
            self.integral.push(sum);
        }
    }

    /// Velocity and its integral at t, which lies between two fixes.
    pub(super) fn at(&self, t: f64) -> ([f64; 2], [f64; 2]) {
        let i = self
            .t
            .partition_point(|&x| x <= t)
            .clamp(1, self.t.len() - 1)
            - 1;
        let h = self.t[i + 1] - self.t[i];
        let u = (t - self.t[i]) / h;
        let (u2, u3) = (u * u, u * u * u);
        let u4 = u2 * u2;
        let (mut v, mut integral) = ([0.0; 2], [0.0; 2]);
        for k in 0..2 {
            let (v0, v1) = (self.v[i][k], self.v[i + 1][k]);
            let (m0, m1) = (self.slope[i][k] * h, self.slope[i + 1][k] * h);
            // The cubic Hermite basis, and its integral.
            v[k] = v0 * (2.0 * u3 - 3.0 * u2 + 1.0)
                + m0 * (u3 - 2.0 * u2 + u)
                + v1 * (3.0 * u2 - 2.0 * u3)
                + m1 * (u3 - u2);
            integral[k] = self.integral[i][k]
                + h * (v0 * (0.5 * u4 - u3 + u)
                    + m0 * (0.25 * u4 - 2.0 / 3.0 * u3 + 0.5 * u2)
                    + v1 * (u3 - 0.5 * u4)
                    + m1 * (0.25 * u4 - u3 / 3.0));
        }
        (v, integral)
    }

    /// True when the velocity is known from `from` to `to` without a hole.
    pub(super) fn covers(&self, from: f64, to: f64) -> bool {
        let (first, last) = (
            self.t.partition_point(|&x| x <= from),
            self.t.partition_point(|&x| x < to),
        );
        first > 0 && last < self.t.len() && self.holes[first - 1] == self.holes[last]
    }
}
