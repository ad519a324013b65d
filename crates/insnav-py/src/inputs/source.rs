//! Samples in memory, as a source that runs can read as often as they want.

use crate::failure::Failure;
use insnav_core::config::Config;
use insnav_core::sample::{ImuIncrement, ImuSample, Sample};
use insnav_core::time::Time;
use insnav_log::{ImuAxes, RunError, Source, imu_to_body, why_no_place};
use nalgebra::{Matrix3, Vector3};

/// Samples from arrays, to be read as often as a run wants. They are copies: other threads may change the arrays meanwhile.
pub(crate) struct Arrays {
    /// Inertial ones, as columns: an hour of samples is half as large as these.
    pub(super) inertial: Inertial,
    /// All others, in the order of time.
    pub(super) others: Vec<Sample>,
    /// At one instant inertial ones come first, else last.
    pub(super) inertial_first: bool,
    pub(super) origin: Time,
    pub(super) dated: bool,
    pub(super) lever_arm_b: Option<Vector3<f64>>,
}

/// Inertial samples as columns, in the order of time.
#[derive(Default)]
pub(super) struct Inertial {
    pub(super) times: Vec<Time>,
    /// Rates (rad/s), or angles (rad).
    pub(super) turns: Vec<Vector3<f64>>,
    /// Specific forces (m/s²), or velocities (m/s).
    pub(super) forces: Vec<Vector3<f64>>,
    /// What was gained since the row before, in place of rates.
    pub(super) increments: bool,
}

impl Inertial {
    fn sample(&self, row: usize) -> Option<Sample> {
        let (&time, &turn, &force) = (
            self.times.get(row)?,
            self.turns.get(row)?,
            self.forces.get(row)?,
        );
        Some(if self.increments {
            Sample::ImuIncrement(ImuIncrement {
                time,
                angle_b: turn,
                velocity_b: force,
            })
        } else {
            Sample::Imu(ImuSample {
                time,
                angular_rate_b: turn,
                specific_force_b: force,
            })
        })
    }
}

impl Arrays {
    /// Turned by the mounting that the settings name.
    pub(super) fn mounted(mut self, config: &Config) -> Self {
        let to_body = imu_to_body(ImuAxes::Frd, Some(config.imu.mounting_rpy_deg));
        if to_body != Matrix3::identity() {
            let Inertial { turns, forces, .. } = &mut self.inertial;
            self.lever_arm_b = self.lever_arm_b.map(|v| to_body * v);
            turns.iter_mut().for_each(|v| *v = to_body * *v);
            forces.iter_mut().for_each(|v| *v = to_body * *v);
            for other in &mut self.others {
                if let Sample::Magnetic(field) = other {
                    field.field_b = to_body * field.field_b;
                }
            }
        }
        self
    }

    /// The instant from which seconds count.
    pub(crate) fn zero(&self) -> Time {
        self.origin
    }

    /// Whether its stamps are dates, and nobody says from when seconds count.
    pub(crate) fn is_dated(&self) -> bool {
        self.dated
    }

    /// Antenna from the IMU, forward-right-down, m, where it is told.
    pub(crate) fn lever_arm(&self) -> Option<Vector3<f64>> {
        self.lever_arm_b
    }

    /// All samples in the order of time.
    pub(crate) fn iter(&self) -> impl Iterator<Item = Sample> + '_ {
        let (mut row, mut other) = (0, 0);
        std::iter::from_fn(move || {
            let inertial = self.inertial.times.get(row);
            let aiding = self.others.get(other);
            let inertial_next = match (inertial, aiding) {
                (Some(i), Some(a)) if self.inertial_first => *i <= a.time(),
                (Some(i), Some(a)) => *i < a.time(),
                (i, _) => i.is_some(),
            };
            if inertial_next {
                row += 1;
                self.inertial.sample(row - 1)
            } else {
                other += 1;
                aiding.copied()
            }
        })
    }

    /// Refuses positions of which none is a place on Earth, with the first of them: a unit or an order, not an outlier.
    pub(crate) fn has_places(&self) -> Result<(), Failure> {
        let fixes = self.others.iter().filter_map(|s| match s {
            Sample::GnssPosition(fix) => Some(fix.position),
            _ => None,
        });
        let mut first = None;
        for (row, p) in fixes.enumerate() {
            if p.is_valid() {
                return Ok(());
            }
            if p.latitude.is_finite() && p.longitude.is_finite() && p.height.is_finite() {
                first.get_or_insert((row, p.latitude.to_degrees(), p.longitude.to_degrees()));
            }
        }
        let Some((row, latitude, longitude)) = first else {
            return Ok(());
        };
        let name = "gnss_position: latitude_deg_longitude_deg_height_m";
        let received = format!("latitude {latitude:.7}, longitude {longitude:.7}");
        Err(Failure::new(
            "no_place",
            format!("{name}[{row}]: {received} is no place on Earth, nor is that of any other row"),
            why_no_place(latitude, longitude),
        )
        .about(name, received, "a place on Earth"))
    }

    /// All samples in the order of time, in one piece.
    pub(crate) fn all(&self) -> Vec<Sample> {
        self.iter().collect()
    }
}

impl Source for Arrays {
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError> {
        Ok(Box::new(self.iter().map(Ok)))
    }

    /// Seconds out are seconds in.
    fn origin(&self) -> Result<Option<Time>, RunError> {
        Ok(Some(self.origin))
    }

    fn lever_arm_b(&self) -> Result<Option<Vector3<f64>>, RunError> {
        Ok(self.lever_arm_b)
    }
}

/// One sample, turned from the unit's axes to the body's.
pub(crate) fn turn(sample: &mut Sample, to_body: &Matrix3<f64>) {
    match sample {
        Sample::Imu(s) => {
            s.angular_rate_b = to_body * s.angular_rate_b;
            s.specific_force_b = to_body * s.specific_force_b;
        }
        Sample::ImuIncrement(s) => {
            s.angle_b = to_body * s.angle_b;
            s.velocity_b = to_body * s.velocity_b;
        }
        Sample::Magnetic(s) => s.field_b = to_body * s.field_b,
        _ => {}
    }
}
