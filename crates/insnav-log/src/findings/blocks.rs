//! Inertial data in blocks of a tenth of a second: all that findings need of them, in a hundredth of the space.

use insnav_core::sample::Sample;
use insnav_core::time::Time;
use nalgebra::Vector3;

/// Length of a block, s: short against what a vehicle does, long against vibration.
const LENGTH: f64 = 0.1;

/// Means over a tenth of a second. Single precision keeps ten hours within 12 MB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Block {
    /// Middle of the block.
    pub(crate) time: Time,
    rate: [f32; 3],
    force: [f32; 3],
}

impl Block {
    /// Mean rate, body axes as declared, rad/s as declared.
    pub(crate) fn rate(&self) -> Vector3<f64> {
        Vector3::from(self.rate.map(f64::from))
    }

    /// Mean specific force, likewise, m/s².
    pub(crate) fn force(&self) -> Vector3<f64> {
        Vector3::from(self.force.map(f64::from))
    }
}

/// The blocks of a log, in order of time.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blocks {
    pub(crate) blocks: Vec<Block>,
    /// Mean interval of the samples, s.
    pub(crate) interval: f64,
}

/// Gathers blocks sample by sample.
#[derive(Clone, Debug, Default)]
pub(crate) struct BlockMeter {
    blocks: Vec<Block>,
    open: Option<Open>,
    last: Option<Time>,
    spans: f64,
    intervals: u64,
}

#[derive(Clone, Debug)]
struct Open {
    begin: Time,
    end: Time,
    count: f64,
    rate: Vector3<f64>,
    force: Vector3<f64>,
}

impl BlockMeter {
    pub(crate) fn push(&mut self, sample: &Sample) {
        let time = sample.time();
        let dt = self.last.map(|last| time.since(last));
        let (rate, force) = match (sample, dt) {
            (Sample::Imu(s), _) => (s.angular_rate_b, s.specific_force_b),
            (Sample::ImuIncrement(s), Some(dt)) if dt > 0.0 => (s.angle_b / dt, s.velocity_b / dt),
            (Sample::ImuIncrement(_), _) => {
                self.last = Some(time);
                return;
            }
            _ => return,
        };
        if dt.is_some_and(|dt| dt <= 0.0) || !(rate.sum() + force.sum()).is_finite() {
            return;
        }
        self.last = Some(time);
        // A gap is no interval of the unit.
        let gap = dt.is_some_and(|dt| dt > 2.0 * LENGTH);
        if let Some(dt) = dt.filter(|_| !gap) {
            self.spans += dt;
            self.intervals += 1;
        }
        let full = |o: &Open| gap || time.since(o.begin) >= LENGTH;
        if self.open.as_ref().is_some_and(full) {
            self.close();
        }
        let open = self.open.get_or_insert(Open {
            begin: time,
            end: time,
            count: 0.0,
            rate: Vector3::zeros(),
            force: Vector3::zeros(),
        });
        open.end = time;
        open.count += 1.0;
        open.rate += rate;
        open.force += force;
    }

    fn close(&mut self) {
        if let Some(o) = self.open.take() {
            let mean = |sum: Vector3<f64>| (sum / o.count).map(|x| x as f32).into();
            self.blocks.push(Block {
                time: o.begin.plus(0.5 * o.end.since(o.begin)),
                rate: mean(o.rate),
                force: mean(o.force),
            });
        }
    }

    pub(crate) fn finish(mut self) -> Blocks {
        self.close();
        Blocks {
            blocks: self.blocks,
            interval: self.spans / self.intervals.max(1) as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::sample::{ImuIncrement, ImuSample};

    #[test]
    fn rates_and_increments_of_the_same_motion_give_the_same_blocks() {
        let (mut rates, mut increments) = (BlockMeter::default(), BlockMeter::default());
        let (rate, force) = (Vector3::new(0.1, -0.2, 0.3), Vector3::new(1.0, 2.0, -9.8));
        for i in 0..1000 {
            let time = Time::from_seconds(1e9 + 0.01 * f64::from(i));
            rates.push(&Sample::Imu(ImuSample {
                time,
                angular_rate_b: rate,
                specific_force_b: force,
            }));
            increments.push(&Sample::ImuIncrement(ImuIncrement {
                time,
                angle_b: rate * 0.01,
                velocity_b: force * 0.01,
            }));
        }
        for blocks in [rates.finish(), increments.finish()] {
            assert!((99..=101).contains(&blocks.blocks.len()));
            assert!((blocks.interval - 0.01).abs() < 1e-9);
            for b in &blocks.blocks {
                // Stamps are whole nanoseconds, of 10 ms: 1e-7 relative; single precision: 6e-8.
                assert!((b.rate() - rate).norm() < 1e-6 && (b.force() - force).norm() < 1e-5);
            }
        }
    }
}
