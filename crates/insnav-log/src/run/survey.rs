//! What a source holds, in one pass before the run: enough to choose settings and to say what looks wrong.

use super::{RunError, Source};
use crate::findings::{BlockMeter, Blocks};
use insnav_core::metrics::{Stop, StopFinder};
use insnav_core::noise_floor::{NoiseFloor, NoiseMeter};
use insnav_core::sample::{GnssPosition, GnssVelocity, Sample};
use insnav_core::time::Time;

/// A source at a glance.
#[derive(Clone, Debug, Default)]
pub struct Survey {
    /// Inertial samples.
    pub imu_samples: usize,
    /// Inertial samples with NaN or infinity in them.
    pub imu_not_finite: usize,
    /// First and last inertial stamp.
    pub imu_span: Option<(Time, Time)>,
    /// Position fixes, in order.
    pub positions: Vec<GnssPosition>,
    /// Velocity fixes, in order.
    pub velocities: Vec<GnssVelocity>,
    /// Declarations of standing, whichever way.
    pub standstills: usize,
    /// Speeds of wheels.
    pub speeds: usize,
    /// Magnetic fields, and the sum of their lengths, T.
    pub fields: usize,
    pub(crate) field_sum: f64,
    /// Magnetic fields of length zero, which say nothing.
    pub(crate) zero_fields: usize,
    /// Speeds of wheels that are NaN or infinite, which nobody gets to see.
    pub speeds_not_finite: u64,
    /// When the first of them was.
    pub first_speed_not_finite: Option<Time>,
    /// Stops, by GNSS speed below 0.1 m/s; none without GNSS velocity.
    pub stops: Vec<Stop>,
    /// Noise of the inertial unit while it is quietest; `None` on logs of a few seconds.
    pub noise_floor: Option<NoiseFloor>,
    /// Fixes that were recorded too long after their stamps to be put into their places.
    pub late: u64,
    /// Inertial data in tenths of a second.
    pub(crate) imu_blocks: Blocks,
}

impl Survey {
    /// Read a source once.
    pub fn of(source: &(impl Source + ?Sized)) -> Result<Self, RunError> {
        let mut survey = Survey::default();
        let mut blocks = BlockMeter::default();
        let mut meter = NoiseMeter::default();
        let mut samples = source.stream(None, false)?;
        for sample in &mut samples {
            let sample = sample?;
            meter.push(&sample);
            blocks.push(&sample);
            match sample {
                Sample::Imu(s) => {
                    survey.saw_imu(s.time);
                    let sum = s.specific_force_b.sum() + s.angular_rate_b.sum();
                    survey.imu_not_finite += usize::from(!sum.is_finite());
                }
                Sample::ImuIncrement(s) => {
                    survey.saw_imu(s.time);
                    let finite = s
                        .angle_b
                        .iter()
                        .chain(s.velocity_b.iter())
                        .all(|x| x.is_finite());
                    survey.imu_not_finite += usize::from(!finite);
                }
                Sample::GnssPosition(p) => survey.positions.push(p),
                Sample::GnssVelocity(v) => survey.velocities.push(v),
                Sample::Standstill(_) => survey.standstills += 1,
                Sample::Speed(_) => survey.speeds += 1,
                Sample::Heading(_) => {}
                Sample::Magnetic(field) => {
                    // A field of zero is no field: a sensor that is absent or broken.
                    let length = field.field_b.norm();
                    survey.fields += usize::from(length > 0.0);
                    survey.zero_fields += usize::from(length == 0.0);
                    survey.field_sum += length;
                }
            }
        }
        let state = samples.state();
        let counts = state.counts();
        survey.late = counts.dropped_late;
        survey.speeds_not_finite = counts.dropped_speed_not_finite;
        survey.first_speed_not_finite = counts.first_speed_not_finite;
        survey.noise_floor = meter.floor().ok();
        survey.positions.sort_by_key(|p| p.time);
        survey.velocities.sort_by_key(|v| v.time);
        let mut finder = StopFinder::default();
        for v in &survey.velocities {
            finder.push_speed(v.time, v.velocity_n.xy().norm());
        }
        survey.stops = finder.finish();
        survey.imu_blocks = blocks.finish();
        Ok(survey)
    }

    /// Forget what a receiver said. Whether there was anything.
    pub(super) fn forget_gnss(&mut self) -> bool {
        let had = !(self.positions.is_empty() && self.velocities.is_empty());
        self.positions.clear();
        self.velocities.clear();
        self.stops.clear();
        self.late = 0;
        had
    }

    fn saw_imu(&mut self, time: Time) {
        self.imu_samples += 1;
        let (first, last) = self.imu_span.get_or_insert((time, time));
        *first = (*first).min(time);
        *last = (*last).max(time);
    }

    /// Position fixes that state no covariance.
    pub fn positions_without_sigma(&self) -> usize {
        self.positions
            .iter()
            .filter(|p| p.covariance_n.is_none())
            .count()
    }

    /// Velocity fixes that state no covariance.
    pub fn velocities_without_sigma(&self) -> usize {
        self.velocities
            .iter()
            .filter(|v| v.covariance_n.is_none())
            .count()
    }

    /// Whether any position fix falls into the time of the inertial data, give or take a second.
    pub fn overlaps(&self) -> bool {
        self.imu_span.is_some_and(|(first, last)| {
            self.positions
                .iter()
                .any(|p| p.time >= first.plus(-1.0) && p.time <= last.plus(1.0))
        })
    }
}
