//! Which optional states a run has, and what it has found of them.

use crate::config::Config;
use crate::error::Result;
use crate::filter::{
    ACCEL_SCALE, AXLE, Block, CLOCK_OFFSET, Calibration, Eskf, GNSS_COLOUR, GYRO_SCALE, LEVER_ARM,
    MOUNTING, Process,
};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The optional states that the settings ask for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct OptionalStates {
    gyro_scale: Option<Process>,
    accel_scale: Option<Process>,
    gnss_colour: Option<Process>,
    lever_arm: Option<Process>,
    mounting: Option<Process>,
    axle: Option<Process>,
    clock_offset: Option<Process>,
    /// What a start after a long gap begins with.
    found: Calibration,
    gyro_scale_found: Vector3<f64>,
    accel_scale_found: Vector3<f64>,
}

impl OptionalStates {
    pub(super) fn of(config: &Config) -> Self {
        let ppm = |sigma: Option<f64>| sigma.map(|s| Process::constant(s * 1e-6));
        let vehicle = &config.vehicle;
        let wheels = vehicle.nonholonomic.is_used();
        OptionalStates {
            gyro_scale: ppm(config.imu.gyro_scale_sigma_ppm),
            accel_scale: ppm(config.imu.accel_scale_sigma_ppm),
            gnss_colour: config.gnss.colour.map(|c| Process {
                sigma: Vector3::new(
                    c.sigma_m,
                    c.sigma_m,
                    c.vertical_sigma_m.unwrap_or(c.sigma_m),
                ),
                tau: c.tau_s,
            }),
            lever_arm: config.gnss.lever_arm_sigma_m.map(Process::constant),
            mounting: wheels.then(|| Process::constant(vehicle.mounting_sigma_deg.to_radians())),
            axle: (wheels && vehicle.axle_b_m.is_none())
                .then(|| Process::constant(vehicle.axle_sigma_m)),
            clock_offset: config.gnss.time_offset_sigma_s.map(Process::constant),
            found: Calibration::default(),
            gyro_scale_found: Vector3::zeros(),
            accel_scale_found: Vector3::zeros(),
        }
    }

    /// Open them in a filter that begins.
    pub(super) fn open(&self, filter: &mut Eskf) -> Result<()> {
        filter.set_calibration(self.found);
        filter.set_scale(self.gyro_scale_found, self.accel_scale_found);
        fn open<const N: usize>(
            filter: &mut Eskf,
            block: Block<N>,
            process: Option<Process>,
        ) -> Result<()> {
            process.map_or(Ok(()), |process| filter.open(block, process))
        }
        open(filter, GYRO_SCALE, self.gyro_scale)?;
        open(filter, ACCEL_SCALE, self.accel_scale)?;
        open(filter, GNSS_COLOUR, self.gnss_colour)?;
        open(filter, LEVER_ARM, self.lever_arm)?;
        open(filter, MOUNTING, self.mounting)?;
        open(filter, AXLE, self.axle)?;
        open(filter, CLOCK_OFFSET, self.clock_offset)
    }

    /// Remember what a filter that ends has found. The momentary error of GNSS is none of it.
    #[cfg(feature = "std")]
    pub(super) fn keep(&mut self, filter: &Eskf) {
        self.found = Calibration {
            gnss_colour_n: Vector3::zeros(),
            ..filter.nominal().calibration
        };
        let errors = &filter.nominal().imu_errors;
        (self.gyro_scale_found, self.accel_scale_found) = (errors.gyro_scale, errors.accel_scale);
    }
}
