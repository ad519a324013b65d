//! How Q and R follow the innovations.

use super::variant::AttitudeVariant;
use super::windows::Blocks;
use crate::ahrs::{
    AttitudeChannelNoise, AttitudeMonitor, AttitudeMonitorSettings, InvariantFilter, InvariantNoise,
};
use crate::error::Result;
use crate::noise::{ForgettingProcessNoise, MohamedSchwarz};
use crate::sim::{AttitudeRecord, AttitudeSample};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};
use std::boxed::Box;

/// Samples before anything adapts: until then the gyros' biases are not known, 20 s.
pub(super) const SETTLE: u32 = 625;
/// Window and block of the published methods.
pub(super) const WINDOW: usize = 40;
/// Lags and samples of a block of the monitors, 12.8 s.
pub(super) const LAGS: usize = 40;
const BLOCK: u32 = 400;

/// One way to set Q and R.
#[derive(Clone, Debug)]
pub(super) struct Adaptation {
    pub(super) noise: InvariantNoise,
    /// Of the angles, where it is made of them.
    pub(super) channels: AttitudeChannelNoise,
    method: Method,
    bias_noise: f64,
    seen: u32,
}

#[derive(Clone, Debug)]
enum Method {
    Fixed,
    /// Noise as it is; with the covariance of heading and tilt about north, rad², of an accelerometer at rest.
    Known(AttitudeChannelNoise, f64),
    Recursion(Box<ForgettingProcessNoise<6>>),
    /// Of Q from innovations, of R from residuals.
    Window {
        innovations: Option<Box<MohamedSchwarz<3, WINDOW>>>,
        residuals: Option<Box<MohamedSchwarz<3, WINDOW>>>,
    },
    Blocks(Box<Blocks>),
    Monitor(Box<AttitudeMonitor<LAGS>>),
}

impl Adaptation {
    pub(super) fn new(variant: AttitudeVariant, record: &AttitudeRecord) -> Self {
        use AttitudeVariant::*;
        let mut start = record.datasheet;
        for channel in start.tilt.iter_mut().chain([&mut start.heading]) {
            channel.process *= variant.start_factor();
        }
        let noise = of_channels(&start, record.bias_noise);
        let truth = of_channels(&record.truth, record.bias_noise);
        let monitor = || {
            AttitudeMonitor::new(AttitudeMonitorSettings {
                step_s: record.step_s,
                prior: start,
                bias_noise: record.bias_noise,
                initial_bias: record.initial_bias,
                settle: SETTLE,
                block: BLOCK,
            })
        };
        let window = || Some(Box::new(MohamedSchwarz::new()));
        let (noise, method) = match variant {
            Raw | Datasheet | DatasheetGated | DatasheetPlainGate | QX100 => (noise, Method::Fixed),
            Oracle => (truth, Method::Known(record.truth, 0.0)),
            OracleFullR => (truth, Method::Known(record.truth, record.heading_with_tilt)),
            MohamedSchwarzFair | MohamedSchwarzROver10 => {
                let share = if variant == MohamedSchwarzROver10 {
                    0.1
                } else {
                    1.0
                };
                let noise = InvariantNoise {
                    process: noise.process,
                    measured: truth.measured * share,
                };
                let (innovations, residuals) = (window(), None);
                (
                    noise,
                    Method::Window {
                        innovations,
                        residuals,
                    },
                )
            }
            MohamedSchwarzR => {
                let noise = InvariantNoise {
                    process: truth.process,
                    measured: noise.measured,
                };
                let (innovations, residuals) = (None, window());
                (
                    noise,
                    Method::Window {
                        innovations,
                        residuals,
                    },
                )
            }
            MohamedSchwarzQAndR => {
                let (innovations, residuals) = (window(), window());
                (
                    noise,
                    Method::Window {
                        innovations,
                        residuals,
                    },
                )
            }
            PaperRecursion => {
                let noise = InvariantNoise {
                    process: noise.process,
                    measured: truth.measured,
                };
                let recursion = ForgettingProcessNoise::new(noise.process);
                (noise, Method::Recursion(Box::new(recursion)))
            }
            AlsM40AsPrinted => (noise, Method::Blocks(Box::new(Blocks::as_printed(record)))),
            AlsM40Nnls => (noise, Method::Blocks(Box::new(Blocks::nonnegative(record)))),
            AlsLong => (noise, Method::Monitor(Box::new(monitor().trusting()))),
            AlsMonitor | AlsMonitorQX100 => (noise, Method::Monitor(Box::new(monitor()))),
        };
        Adaptation {
            noise,
            channels: start,
            method,
            bias_noise: record.bias_noise,
            seen: 0,
        }
    }

    /// Before a sample is used.
    pub(super) fn before(&mut self, sample: &AttitudeSample) -> Result<()> {
        match &mut self.method {
            Method::Known(truth, across) => {
                let factor = sample.vibration.powi(2);
                self.channels = *truth;
                for tilt in &mut self.channels.tilt {
                    tilt.measured *= factor;
                }
                // Nearly all of its noise comes with the tilt.
                self.channels.heading.measured *= factor;
                self.noise = of_channels(&self.channels, self.bias_noise);
                self.noise.measured[(0, 2)] = 0.25 * *across * factor;
                self.noise.measured[(2, 0)] = 0.25 * *across * factor;
                return Ok(());
            }
            Method::Monitor(monitor) => {
                monitor.step(
                    &sample.rate_b,
                    &sample.specific_force_b,
                    sample.field_b.as_ref(),
                )?;
                self.channels = monitor.noise();
            }
            _ => return Ok(()),
        }
        self.noise = of_channels(&self.channels, self.bias_noise);
        Ok(())
    }

    /// After a sample was used: what the filter made of an innovation of half angles. `used`: of tilt and heading.
    pub(super) fn after(
        &mut self,
        filter: &InvariantFilter,
        innovation: &Vector3<f64>,
        used: [bool; 3],
    ) {
        self.seen += 1;
        if self.seen <= SETTLE {
            return;
        }
        let nu = Vector3::from_fn(|i, _| if used[i] { innovation[i] } else { 0.0 });
        match &mut self.method {
            Method::Recursion(recursion) => {
                recursion.push(&filter.gain, &nu);
                self.noise.process = recursion.process;
            }
            Method::Window {
                innovations,
                residuals,
            } => {
                let h = SMatrix::<f64, 3, 6>::identity();
                if let Some(window) = innovations {
                    window.push(&nu);
                    if let Some(process) = window.process_noise(&filter.gain) {
                        self.noise.process = process;
                    }
                }
                if let Some(window) = residuals {
                    window.push(&(nu - filter.gain.fixed_rows::<3>(0) * nu));
                    if let Some(r) = window.measurement_noise_of_residuals(&h, &filter.covariance) {
                        self.noise.measured = r;
                    }
                }
            }
            Method::Blocks(blocks) => {
                if let Some((channels, bias)) = blocks.push(filter, &(nu * 2.0)) {
                    self.channels = channels;
                    self.noise = of_channels(&channels, 0.0);
                    for (i, bias) in bias.into_iter().enumerate() {
                        self.noise.process[(i + 3, i + 3)] = bias;
                    }
                }
            }
            _ => {}
        }
    }

    /// Blocks of the tilt accepted, and all, of a monitor.
    pub(super) fn tilt_counts(&self) -> Option<[u32; 2]> {
        match &self.method {
            Method::Monitor(monitor) => Some(monitor.tilt_counts()),
            _ => None,
        }
    }

    /// Q and R of the tilt that are used now, as angles: rad² per step, rad².
    pub(super) fn tilt(&self) -> [f64; 2] {
        let half = |m: f64| 4.0 * m;
        let mean = |m: &Matrix3<f64>| 0.5 * (m.m11 + m.m22);
        let q: Matrix6<f64> = self.noise.process;
        [
            half(0.5 * (q[(0, 0)] + q[(1, 1)])),
            half(mean(&self.noise.measured)),
        ]
    }
}

fn of_channels(channels: &AttitudeChannelNoise, bias_noise: f64) -> InvariantNoise {
    let [north, east] = channels.tilt;
    let down = channels.heading;
    InvariantNoise::of_angles(
        &Vector3::new(north.process, east.process, down.process),
        bias_noise,
        &Vector3::new(north.measured, east.measured, down.measured),
    )
}
