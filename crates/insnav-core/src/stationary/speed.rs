//! Speed as GNSS or wheels tell it, and the filter's own where nobody does.

use super::{Belief, LOOK_AHEAD};
use crate::sample::{GnssVelocity, Speed};
use crate::time::Time;
use heapless::Deque;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Velocities are averaged over this, s: the mean of vectors, since that of speeds would never fall below the noise.
const MEAN_OVER: f64 = 2.0;
/// For so long a voice speaks, s: twice the interval of the slowest usual receiver.
const SPEAKS_FOR: f64 = 2.0;
/// Velocities that fit into the mean: two seconds at 20 Hz; of faster ones the mean is over less.
const KEPT: usize = 44;

/// A receiver's vertical velocity is about twice as noisy as its horizontal one.
const VERTICAL_WEIGHT: f64 = 0.5;

/// Chi-square quantile of three degrees of freedom, one in a thousand.
const CONTRADICTS: f64 = 16.3;
/// What a standing filter's velocity may be wrong by on top of its sigma, m/s.
const VELOCITY_FLOOR: f64 = 0.1;
/// Where nobody speaks, the filter must exclude motion above this multiple of the speed limit (1 m/s: a walk), with
/// three sigmas. Slower and as smooth as standing on an unaided filter cannot be told from a stop; a tunnel can:
/// its sigma passes this limit within half a minute, and until then its velocity contradicts.
const EXCLUDES: f64 = 4.0;
/// What it excluded so long ago counts still, s, if nothing has moved the inertial unit since: the look ahead, the window and
/// what is waited beyond it, with a second for what shakes a body that has just come to rest. A sigma that grows since the
/// receiver fell silent at the stop is then no objection. Longer, and a train on a smooth track might be fast since.
const EXCLUDED_FOR: f64 = 4.0;

/// What speaks about the speed at an instant, each over its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Said {
    /// The largest of GNSS and wheels, where one speaks at all.
    pub moving: Option<f64>,
    /// Largest of everything that is asked before a stop is believed.
    pub before_entry: f64,
    /// When GNSS or wheels were last faster than the limit, in a single velocity: a stop begins after it.
    pub(super) fast_until: Option<Time>,
    /// Whether GNSS or wheels confirm that the body stands, without the filter.
    pub confirmed: bool,
    /// Whether GNSS or wheels measure the speed at all.
    pub measured: bool,
}

impl Said {
    /// Where the speed is not asked for.
    pub(super) const NOT_ASKED: Said = Said {
        moving: None,
        before_entry: 0.0,
        fast_until: None,
        confirmed: false,
        measured: false,
    };
}

/// Hears GNSS velocities and wheels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct SpeedWitness {
    velocities: Deque<(Time, Vector3<f64>), KEPT>,
    /// No receiver will ever speak: what the filter cannot exclude is no reason to doubt, since it drifts from stop to stop.
    alone: bool,
    wheels: Option<(Time, f64)>,
    fast_until: Option<Time>,
    /// When the filter last excluded a walk by itself.
    excluded: Option<Time>,
}

impl SpeedWitness {
    /// There is no receiver in this run.
    pub(super) fn never_by_gnss(&mut self) {
        self.alone = true;
    }

    /// `limit`: the speed (m/s) above which nobody stands.
    pub(super) fn observe_gnss(&mut self, fix: &GnssVelocity, limit: f64) {
        let mut velocity_n = fix.velocity_n;
        if !velocity_n.z.is_finite() {
            velocity_n.z = 0.0;
        }
        if velocity_n.xy().norm() > limit {
            self.fast_until = Some(fix.time);
        }
        while let Some((time, _)) = self.velocities.front()
            && (self.velocities.is_full() || fix.time.since(*time) > MEAN_OVER)
        {
            self.velocities.pop_front();
        }
        let _ = self.velocities.push_back((fix.time, velocity_n));
    }

    pub(super) fn observe_wheels(&mut self, speed: &Speed, limit: f64) {
        if speed.speed.abs() > limit {
            self.fast_until = Some(speed.time);
        }
        self.wheels = Some((speed.time, speed.speed.abs()));
    }

    /// Speed of the wheels, while it is not too old.
    pub(super) fn wheels(&self, now: Time) -> Option<f64> {
        let (time, speed) = self.wheels?;
        (now.since(time) <= SPEAKS_FOR).then_some(speed)
    }

    /// Mean speed by GNSS, and whether the receiver says anything new: one that repeats itself to the last digit (clamped to
    /// zero, or frozen) does not.
    fn gnss(&self, now: Time) -> Option<(f64, bool)> {
        let (last, newest) = self.velocities.back()?;
        if now.since(*last) > SPEAKS_FOR {
            return None;
        }
        let sum: Vector3<f64> = self.velocities.iter().map(|(_, v)| v).sum();
        let mean = sum / self.velocities.len() as f64;
        let alive = self.velocities.iter().any(|(_, v)| v != newest);
        let speed = mean.xy().norm().max(VERTICAL_WEIGHT * mean.z.abs());
        Some((speed, alive))
    }

    /// All that is said now; `limit` is the speed (m/s) above which nobody stands. The inertial unit has shown no motion since
    /// `quiet_since`; the belief is that of [`LOOK_AHEAD`] before now.
    pub(super) fn said(
        &mut self,
        now: Time,
        limit: f64,
        belief: &Belief,
        quiet_since: Option<Time>,
    ) -> Said {
        let (gnss, wheels) = (self.gnss(now), self.wheels(now));
        let moving = [gnss.map(|g| g.0), wheels]
            .into_iter()
            .flatten()
            .map(|speed| speed / limit)
            .reduce(f64::max);
        let alive = gnss.is_some_and(|g| g.1);
        let contradiction = || contradiction(belief) / CONTRADICTS;
        let bound = upper_bound(belief) / (EXCLUDES * limit);
        if bound < 1.0 {
            self.excluded = Some(now.plus(-LOOK_AHEAD));
        }
        let was_slow = self.excluded.is_some_and(|at| {
            now.since(at) <= EXCLUDED_FOR && quiet_since.is_some_and(|since| at >= since)
        });
        let own = match (alive, wheels) {
            // A receiver that measures is believed before the filter.
            (true, _) => 0.0,
            (false, None) if self.alone || was_slow => contradiction(),
            // Wheels stand on a ferry and on ice.
            (false, Some(_)) => contradiction(),
            (false, None) => contradiction().max(bound),
        };
        Said {
            moving,
            before_entry: moving.unwrap_or(0.0).max(own),
            fast_until: self.fast_until,
            measured: alive || wheels.is_some(),
            confirmed: (alive || wheels.is_some()) && moving.is_some_and(|m| m < 0.5),
        }
    }
}

/// Whether the filter's own velocity contradicts a stop, v̂ᵀ (P + 0.1² I)⁻¹ v̂ against [`CONTRADICTS`].
pub(super) fn contradicted(belief: &Belief) -> Option<f64> {
    let nis = contradiction(belief);
    (nis > CONTRADICTS).then_some(nis)
}

/// v̂ᵀ (P + 0.1² I)⁻¹ v̂; 0 where the covariance is none and says nothing.
fn contradiction(belief: &Belief) -> f64 {
    let v = &belief.velocity_n;
    let floor = Matrix3::from_diagonal_element(VELOCITY_FLOOR * VELOCITY_FLOOR);
    (belief.velocity_covariance_n + floor)
        .cholesky()
        .map_or(0.0, |c| v.dot(&c.solve(v)))
}

/// Three-sigma bound of the filter's horizontal speed, m/s; infinite where it knows nothing.
fn upper_bound(belief: &Belief) -> f64 {
    let p = &belief.velocity_covariance_n;
    let bound = belief.velocity_n.xy().norm() + 3.0 * (p[(0, 0)] + p[(1, 1)]).sqrt();
    if bound.is_finite() {
        bound
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn belief(speed: f64, sigma: f64) -> Belief {
        Belief {
            rate_b: Vector3::zeros(),
            rate_covariance_b: Matrix3::zeros(),
            velocity_n: Vector3::new(speed, 0.0, 0.0),
            velocity_covariance_n: Matrix3::from_diagonal_element(sigma * sigma),
        }
    }

    fn hear(witness: &mut SpeedWitness, t: f64, north: f64) {
        let fix = GnssVelocity {
            time: Time::from_seconds(t),
            velocity_n: Vector3::new(north, 0.0, f64::NAN),
            covariance_n: None,
        };
        witness.observe_gnss(&fix, 0.25);
    }

    #[test]
    fn the_mean_of_vectors_tells_noise_from_motion() {
        let mut standing = SpeedWitness::default();
        for i in 0..40 {
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            hear(&mut standing, 0.1 * f64::from(i), 0.4 * sign);
        }
        let now = Time::from_seconds(4.0);
        let said = standing.said(now, 0.25, &belief(9.0, 0.1), None);
        assert!(said.before_entry < 0.2 && said.confirmed, "{said:?}");
        for i in 40..80 {
            hear(&mut standing, 0.1 * f64::from(i), 0.4);
        }
        let now = Time::from_seconds(8.0);
        let said = standing.said(now, 0.25, &belief(0.0, 0.1), None);
        assert!((said.moving.unwrap() - 1.6).abs() < 1e-9, "{said:?}");
        // Two seconds later nobody speaks.
        let later = Time::from_seconds(10.5);
        let said = standing.said(later, 0.25, &belief(0.0, 0.1), None);
        assert_eq!(said.moving, None);
    }

    #[test]
    fn a_frozen_receiver_leaves_the_word_to_the_filter() {
        let mut frozen = SpeedWitness::default();
        for i in 0..30 {
            hear(&mut frozen, 0.1 * f64::from(i), 0.0);
        }
        let now = Time::from_seconds(3.0);
        let mut said = |speed, sigma| frozen.said(now, 0.25, &belief(speed, sigma), None);
        assert!(said(0.1, 0.1).before_entry < 1.0);
        assert!(!said(0.1, 0.1).confirmed);
        assert!(said(5.0, 0.2).before_entry > 1.0);
        assert!(said(0.1, 3.0).before_entry > 1.0);
    }

    /// A body at 1 m/s is let through by an honest filter once in a thousand, whatever its sigma: the bound fails only when
    /// the estimate is off by three sigmas.
    #[test]
    fn the_filter_alone_must_exclude_a_walk() {
        let mut nobody = SpeedWitness::default();
        let mut ratio = |speed, sigma| {
            nobody
                .said(Time(0), 0.25, &belief(speed, sigma), None)
                .before_entry
        };
        for i in 1..100 {
            let sigma = 0.02 * f64::from(i);
            // Two axes in the bound: 3 √2 σ.
            assert!(
                ratio(1.0 - 3.0 * 2f64.sqrt() * sigma, sigma) >= 1.0 - 1e-12,
                "{sigma}"
            );
        }
        assert!(ratio(0.05, 0.15) < 1.0, "a stop in a short outage");
        assert!(ratio(0.5, 0.01) > 1.0, "known to creep");
        // 25 m/s in a tunnel, from the first second to the last: sigma from 0.05 to 30 m/s, estimates up to 5 sigmas low.
        for i in 0..=600 {
            let sigma = 0.05 * f64::from(i).max(1.0);
            assert!(ratio((25.0 - 5.0 * sigma).max(0.0), sigma) > 1.0, "{sigma}");
        }
    }

    #[test]
    fn wheels_at_rest_need_a_filter_that_does_not_contradict() {
        let mut wheels = SpeedWitness::default();
        let stand = Speed {
            time: Time(0),
            speed: 0.0,
        };
        wheels.observe_wheels(&stand, 0.25);
        let mut ratio = |speed, sigma| {
            wheels
                .said(Time(0), 0.25, &belief(speed, sigma), None)
                .before_entry
        };
        assert!(ratio(0.5, 3.0) < 1.0, "the filter knows little");
        assert!(ratio(8.0, 0.5) > 1.0, "on a ferry");
    }

    /// The receiver falls silent as the car comes to rest, and the filter's sigma grows before the window is over.
    #[test]
    fn what_was_slow_when_it_grew_quiet_is_slow_while_it_stays_quiet() {
        let at = Time::from_seconds;
        let ratio = |excluded_at: f64, now: f64, quiet_since: Option<f64>, speed: f64| {
            let mut nobody = SpeedWitness::default();
            nobody.said(at(excluded_at), 0.25, &belief(0.05, 0.1), None);
            nobody
                .said(at(now), 0.25, &belief(speed, 0.4), quiet_since.map(at))
                .before_entry
        };
        assert!(ratio(10.0, 12.5, Some(9.0), 0.1) < 1.0);
        assert!(ratio(10.0, 12.5, None, 0.1) > 1.0, "it was never quiet");
        assert!(ratio(10.0, 12.5, Some(9.7), 0.1) > 1.0, "moved since");
        assert!(ratio(10.0, 14.0, Some(9.0), 0.1) > 1.0, "too long ago");
        assert!(ratio(10.0, 12.5, Some(9.0), 4.0) > 1.0, "known to move");
    }
}
