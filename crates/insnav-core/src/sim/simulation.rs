//! One run of a scenario: samples in the order of arrival and the truth behind them.

use super::scenario::Scenario;
use super::trajectory::Trajectory;
use super::{gnss, imu};
use crate::error::Result;
use crate::imu::ImuErrors;
use crate::mechanization::NavState;
use crate::sample::Sample;
use crate::time::Time;
use nalgebra::Vector3;

/// What really was, at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Position of the IMU, velocity, attitude.
    pub nav: NavState,
    /// ω_ib resolved in b, rad/s.
    pub angular_rate_b: Vector3<f64>,
    /// Specific force resolved in b, m/s².
    pub specific_force_b: Vector3<f64>,
    /// Biases of the inertial unit: constant and drifting part together.
    pub imu_errors: ImuErrors,
}

/// A simulated run.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// Everything a navigator would get, in the order of arrival (at equal instants inertial samples first).
    pub samples: Vec<Sample>,
    /// The exact motion.
    pub trajectory: Trajectory,
    biases: Vec<ImuErrors>,
    imu_rate: f64,
}

impl Simulation {
    pub(super) fn run(scenario: &Scenario, seed: u64) -> Result<Self> {
        scenario.imu.check()?;
        scenario.gnss.check()?;
        let trajectory = Trajectory::new(&scenario.drive)?;
        let duration = scenario.duration_s.min(trajectory.duration());
        let (inertial, biases) = imu::simulate(&scenario.imu, &trajectory, duration, seed);
        let mut fixes = gnss::simulate(&scenario.gnss, &trajectory, duration, seed);
        // Stable: a position stays before the velocity that arrives with it.
        fixes.sort_by_key(|(arrival, _)| *arrival);
        let mut samples = Vec::with_capacity(inertial.len() + fixes.len());
        let mut fixes = fixes.into_iter().peekable();
        for sample in inertial {
            while let Some((_, fix)) = fixes.next_if(|(arrival, _)| *arrival < sample.time()) {
                samples.push(fix);
            }
            samples.push(sample);
        }
        samples.extend(fixes.map(|(_, fix)| fix));
        Ok(Simulation {
            samples,
            trajectory,
            biases,
            imu_rate: scenario.imu.rate_hz,
        })
    }

    /// The truth at a stamp of the IMU's clock. Biases are those of the nearest inertial sample.
    pub fn truth_at(&self, time: Time) -> Truth {
        let k = self.trajectory.at(time);
        let index = (time.since(self.trajectory.start()) * self.imu_rate)
            .round()
            .max(0.0) as usize;
        let imu_errors = self
            .biases
            .get(index)
            .or(self.biases.last())
            .copied()
            .unwrap_or_default();
        Truth {
            nav: k.nav,
            angular_rate_b: k.angular_rate_b,
            specific_force_b: k.specific_force_b,
            imu_errors,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::imu::ImuErrorModel;
    use super::*;
    use crate::imu::ImuNoise;

    #[test]
    fn samples_come_in_the_order_of_arrival() {
        let mut scenario = Scenario::car_drive(100.0);
        scenario.gnss.latency_s = 0.2333;
        scenario.gnss.time_offset_s = 0.05;
        let simulation = scenario.simulate(1).expect("valid");
        let mut newest = Time(i64::MIN);
        for sample in &simulation.samples {
            if sample.is_inertial() {
                assert!(sample.time() > newest);
                newest = sample.time();
            } else {
                let arrival = sample.time().plus(0.2333 - 0.05);
                // After the last inertial sample before its arrival, not later than the next.
                assert!(
                    arrival.since(newest) > -1e-9 && arrival.since(newest) < 0.3,
                    "{}",
                    arrival.since(newest)
                );
            }
        }
        let inertial = simulation
            .samples
            .iter()
            .filter(|s| s.is_inertial())
            .count();
        assert_eq!(inertial, 20_001);
        assert_eq!(simulation.samples.len() - inertial, 202);
    }

    #[test]
    fn biases_at_a_stamp_are_those_in_its_sample() {
        let scenario = Scenario::car_drive(30.0);
        let simulation = scenario.simulate(5).expect("valid");
        let mut quiet = scenario.clone();
        let noise = quiet.imu.errors.noise.as_mut().expect("automotive grade");
        (noise.gyro_white, noise.accel_white) = (0.0, 0.0);
        for sample in quiet.simulate(5).expect("valid").samples {
            let Sample::Imu(s) = sample else { continue };
            let truth = simulation.truth_at(s.time);
            assert!(
                (s.angular_rate_b - truth.angular_rate_b - truth.imu_errors.gyro_bias).norm()
                    < 1e-15
            );
            assert!(
                (s.specific_force_b - truth.specific_force_b - truth.imu_errors.accel_bias).norm()
                    < 1e-14
            );
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_run() {
        let run = |seed| Scenario::demo().simulate(seed).expect("valid").samples;
        assert_eq!(run(3), run(3));
        assert_ne!(run(3), run(4));
    }

    /// Numbers kept from one run: they change when a random source, the order of its draws or the drive changes, which must
    /// not happen unnoticed, as published results name a seed. Elementary functions may differ in their last digit between
    /// platforms, and an hour of additions between; 1e-9 is far below any noise here.
    #[test]
    fn a_seed_means_the_same_numbers_everywhere() {
        let mut scenario = Scenario::demo();
        // Its own noise, as the classes of units are settings and may change.
        let noise = ImuNoise::from_data_sheet(0.6, 0.2, 200.0, 10.0, 300.0, 300.0);
        scenario.imu.errors = ImuErrorModel::from_noise(noise);
        let simulation = scenario.simulate(2024).expect("valid");
        assert_eq!(simulation.samples.len(), 78_603);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{a} {b}");
        let last = |wanted: fn(&Sample) -> bool| {
            *simulation
                .samples
                .iter()
                .rev()
                .find(|s| wanted(s))
                .expect("there")
        };
        let Sample::Imu(imu) = last(Sample::is_inertial) else {
            panic!("rates")
        };
        near(imu.angular_rate_b.x, -0.035_147_281_307_83);
        near(imu.specific_force_b.z, -9.813_016_370_381_79);
        let Sample::GnssPosition(p) = last(|s| matches!(s, Sample::GnssPosition(_))) else {
            panic!("position")
        };
        near(p.position.latitude, 0.875_145_585_899_169_7);
        near(p.position.height, 255.456_136_113_628_33);
        let Sample::GnssVelocity(v) = last(|s| matches!(s, Sample::GnssVelocity(_))) else {
            panic!("velocity")
        };
        near(v.velocity_n.y, 3.572_030_856_120_504);
        let truth = simulation.truth_at(imu.time);
        near(truth.nav.velocity_n.x, 25.612_388_353_788_88);
        near(truth.imu_errors.gyro_bias.x, -0.001_625_488_216_923_5);
        near(truth.imu_errors.accel_bias.z, -0.006_285_547_068_825_25);
    }
}
