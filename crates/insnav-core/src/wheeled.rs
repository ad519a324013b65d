//! Does a solution move as a wheeled vehicle moves: where its wheels point?

use crate::solution::{Epoch, Sink};
use crate::time::Time;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Between two looks, s.
const INTERVAL: f64 = 0.2;
/// Angles of motion are averaged over so long, s: noise and bumps go, what drifts stays.
const BLOCK: f64 = 10.0;
/// Looks that make a block: a third of it.
const ENOUGH: u32 = 17;
/// Blocks that make a verdict.
const BLOCKS: usize = 4;
/// Below this speed the direction of motion is too vague, m/s.
const SPEED: f64 = 3.0;
/// In tighter turns it depends on the place of the IMU in the vehicle, rad/s.
const TURN: f64 = 0.1;
/// A heading that is known no better shows nothing, rad.
const HEADING_SIGMA: f64 = 0.26;
/// Blocks after which what is clear is not looked at any longer: five minutes of road, by which a standard deviation is known to an
/// eighth.
const CLEAR_AFTER: usize = 30;
/// Vehicles on wheels stay within this, rad: slip on cambered roads is below a degree, pitching by the springs below two.
const WHEELED: f64 = 0.035;

/// Watches a solution that does not know of wheels.
#[derive(Clone, Debug, Default)]
pub struct WheelWatch {
    next: Option<Time>,
    block: Option<(Time, Block)>,
    blocks: Vec<Angles>,
    clear: bool,
}

/// Angles of motion, rad.
#[derive(Clone, Copy, Debug)]
struct Angles {
    /// Direction of motion right of the body's forward axis.
    side: f64,
    /// Direction of motion below the body's forward axis.
    dip: f64,
    /// Direction of motion above the horizon.
    slope: f64,
    /// Variance of `side` by the filter's own account.
    side_variance: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Block {
    /// Mean velocity, body axes, over speed.
    direction_b: Vector3<f64>,
    climb: f64,
    side_variance: f64,
    looks: u32,
}

/// How far a solution moves where its body points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WheelReport {
    /// Stretches of ten seconds that were looked at.
    pub blocks: usize,
    /// Standard deviation of the direction of motion against the body, sideways, degrees.
    pub side_std_deg: f64,
    /// Likewise up and down.
    pub dip_std_deg: f64,
    /// Standard deviation of the slope that was driven, degrees.
    pub slope_std_deg: f64,
    /// What `dip_std_deg` would be with the heights of the fixes turned upside down.
    pub dip_std_upside_down_deg: f64,
    /// Moves where it points, sideways.
    pub lateral: bool,
    /// Moves where it points, up and down.
    pub vertical: bool,
}

impl WheelWatch {
    /// What was seen; `None` if there was too little motion with a known heading.
    pub fn report(mut self) -> Option<WheelReport> {
        self.close_block();
        if self.blocks.len() < BLOCKS {
            return None;
        }
        let of = |f: fn(&Angles) -> f64| self.blocks.iter().map(f).collect::<Vec<_>>();
        let (side, dip, slope) = (of(|a| a.side), of(|a| a.dip), of(|a| a.slope));
        let upside_down: Vec<f64> = dip.iter().zip(&slope).map(|(d, s)| d + 2.0 * s).collect();
        let (side_std, dip_std, slope_std) = (std(&side), std(&dip), std(&slope));
        let own = of(|a| a.side_variance);
        let own_side = (own.iter().sum::<f64>() / own.len() as f64).sqrt();
        Some(WheelReport {
            blocks: self.blocks.len(),
            side_std_deg: side_std.to_degrees(),
            dip_std_deg: dip_std.to_degrees(),
            slope_std_deg: slope_std.to_degrees(),
            dip_std_upside_down_deg: std(&upside_down).to_degrees(),
            lateral: side_std < WHEELED.max(2.0 * own_side),
            vertical: dip_std < WHEELED,
        })
    }

    /// Whether more of the log would change nothing: for minutes, both directions have stayed within half of what a vehicle on wheels
    /// may show. What does not, or is near it, is to be looked at for as long as there is time.
    pub fn is_clear(&self) -> bool {
        self.clear
    }

    fn close_block(&mut self) {
        let Some((_, block)) = self.block.take() else {
            return;
        };
        if block.looks < ENOUGH {
            return;
        }
        let n = f64::from(block.looks);
        let d = block.direction_b / n;
        self.blocks.push(Angles {
            side: d.y.atan2(d.x),
            dip: d.z.atan2(d.x),
            slope: (block.climb / n).asin(),
            side_variance: block.side_variance / n,
        });
        let within = |of: fn(&Angles) -> f64| {
            let angles: Vec<f64> = self.blocks.iter().map(of).collect();
            std(&angles) < 0.5 * WHEELED
        };
        self.clear = self.blocks.len() >= CLEAR_AFTER && within(|a| a.side) && within(|a| a.dip);
    }
}

impl Sink for WheelWatch {
    fn wants_epoch(&mut self, time: Time) -> bool {
        let due = self.next.is_none_or(|next| time >= next);
        if due {
            self.next = Some(time.plus(INTERVAL));
        }
        due
    }

    fn epoch(&mut self, epoch: &Epoch) {
        let v = epoch.nav.velocity_n;
        let speed = v.norm();
        if speed < SPEED || epoch.rate_b.z.abs() > TURN || epoch.heading_sigma() > HEADING_SIGMA {
            return;
        }
        let time = epoch.nav.time;
        if self
            .block
            .is_none_or(|(begin, _)| time.since(begin) >= BLOCK)
        {
            self.close_block();
            self.block = Some((time, Block::default()));
        }
        if let Some((_, block)) = &mut self.block {
            let direction_b = epoch.nav.q_nb.inverse() * (v / speed);
            // Backing up is the same motion the other way.
            block.direction_b += direction_b * direction_b.x.signum();
            block.climb -= v.z / speed * direction_b.x.signum();
            let p = &epoch.covariance;
            let across = (p[(3, 3)] + p[(4, 4)]) / (2.0 * speed * speed);
            block.side_variance += p[(8, 8)] + across;
            block.looks += 1;
        }
    }
}

fn std(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    (x.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / (n - 1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Euler;
    use crate::earth::Geodetic;
    use crate::imu::ImuErrors;
    use crate::mechanization::NavState;
    use crate::solution::Motion;
    use crate::stationary::Evidence;
    use nalgebra::SMatrix;

    /// At 10 m/s with heading, pitch, side, dip in degrees.
    fn seen(t: f64, [heading, pitch, side, dip]: [f64; 4]) -> Epoch {
        let q_nb = Euler::from_degrees(0.0, pitch, heading).to_quaternion();
        let (side, dip) = (side.to_radians(), dip.to_radians());
        let direction_b = Vector3::new(side.cos() * dip.cos(), side.sin() * dip.cos(), dip.sin());
        Epoch {
            nav: NavState {
                time: Time::from_seconds(t),
                position: Geodetic::from_degrees(50.0, 14.0, 200.0),
                velocity_n: q_nb * direction_b * 10.0,
                q_nb,
            },
            rate_b: Vector3::zeros(),
            imu_errors: ImuErrors::default(),
            motion: Motion::Moving,
            evidence: Evidence::default(),
            covariance: SMatrix::identity() * 1e-6,
        }
    }

    /// Ten minutes; `motion` gives at a time heading, pitch, side, dip in degrees.
    fn watch(motion: impl Fn(f64) -> [f64; 4]) -> Option<WheelReport> {
        let mut watch = WheelWatch::default();
        for i in 0..6000 {
            let t = 0.1 * f64::from(i);
            let epoch = seen(t, motion(t));
            if watch.wants_epoch(epoch.nav.time) {
                watch.epoch(&epoch);
            }
        }
        watch.report()
    }

    fn hills(t: f64) -> f64 {
        4.0 * (t / 60.0).sin()
    }

    #[test]
    fn a_car_with_a_crooked_unit_follows_its_wheels() {
        // Mounting: constant angles, however large.
        let report = watch(|t| [t, hills(t) - 7.0, 5.0, -7.0]).unwrap();
        assert!(report.lateral && report.vertical, "{report:?}");
        assert!(report.slope_std_deg > 2.0, "{report:?}");
        assert!(report.side_std_deg < 1e-6 && report.dip_std_deg < 1e-3);
    }

    #[test]
    fn a_boat_in_a_current_does_not() {
        let report = watch(|t| [t, 0.0, 8.0 * (t / 40.0).sin(), 0.0]).unwrap();
        assert!(!report.lateral && report.vertical, "{report:?}");
    }

    #[test]
    fn heights_upside_down_are_told_from_a_lift() {
        // Nose up by the hills, fixes down by as much: the motion dips by twice that.
        let turned = watch(|t| [t, hills(t), 0.0, 2.0 * hills(t)]).unwrap();
        assert!(turned.lateral && !turned.vertical, "{turned:?}");
        assert!(turned.dip_std_upside_down_deg < 0.01 * turned.dip_std_deg);
        // Climbing without pitching, as a balloon does: turned round it is no better.
        let lift = watch(|t| [t, 0.0, 0.0, hills(t)]).unwrap();
        assert!(!lift.vertical);
        assert!(
            lift.dip_std_upside_down_deg > 0.9 * lift.dip_std_deg,
            "{lift:?}"
        );
    }

    #[test]
    fn only_what_moves_where_it_points_is_clear_before_the_time_is_over() {
        let after = |minutes: i32, side_deg: f64, dip_deg: f64| {
            let mut watch = WheelWatch::default();
            for i in 0..600 * minutes {
                let t = 0.1 * f64::from(i);
                let swing = (t / 40.0).sin();
                let epoch = seen(t, [t, 0.0, side_deg * swing, dip_deg * swing]);
                if watch.wants_epoch(epoch.nav.time) {
                    watch.epoch(&epoch);
                }
            }
            (watch.is_clear(), watch.report().unwrap())
        };
        // A sine's standard deviation is 0.7 of its amplitude.
        let (clear, report) = after(6, 0.5, 0.5);
        assert!(clear && report.lateral && report.vertical, "{report:?}");
        assert!(!after(4, 0.5, 0.5).0, "too early");
        for (side_deg, dip_deg) in [(2.0, 0.5), (0.5, 2.0)] {
            let (clear, report) = after(15, side_deg, dip_deg);
            assert!(!clear && report.lateral && report.vertical, "{report:?}");
        }
        assert!(!after(15, 8.0, 0.0).0 && !after(15, 0.0, 8.0).0);
    }

    #[test]
    fn a_short_drive_shows_nothing() {
        let mut short = WheelWatch::default();
        assert!(short.wants_epoch(Time(0)) && !short.wants_epoch(Time(1)));
        assert_eq!(short.report(), None);
    }
}
