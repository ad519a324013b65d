//! What comes out of a navigator: epochs, updates and events, given to a sink.

use crate::alignment::Alignment;
use crate::attitude::Euler;
use crate::filter::Update;
use crate::imu::ImuErrors;
use crate::mechanization::NavState;
use crate::sample::Unfit;
use crate::stationary::{Evidence, StopRecord};
use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, SMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// Whether the body moves or stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Motion {
    /// Under way, or not known to stand.
    Moving,
    /// Standing since an instant.
    Stationary {
        /// Begin of the stop.
        since: Time,
    },
}

/// The solution at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Epoch {
    /// Position (of the IMU), velocity, attitude and time.
    pub nav: NavState,
    /// Turn rate of the body against n, ω_nb resolved in b, rad/s.
    pub rate_b: Vector3<f64>,
    /// Sensor errors as estimated.
    pub imu_errors: ImuErrors,
    /// Whether the body moves or stands.
    pub motion: Motion,
    /// What the detector of stops saw half a second later.
    pub evidence: Evidence,
    /// Covariance of the base states in the order position (m, NED), velocity (m/s, NED), attitude (rad, NED),
    /// gyro bias (rad/s, body), accelerometer bias (m/s², body).
    pub covariance: SMatrix<f64, 15, 15>,
}

impl Epoch {
    /// Covariance of the position, NED, m².
    pub fn position_covariance_n(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Covariance of the velocity, NED, m²/s².
    pub fn velocity_covariance_n(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(3, 3).into_owned()
    }

    /// Covariance of the attitude as a small rotation in NED, rad².
    pub fn attitude_covariance_n(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(6, 6).into_owned()
    }

    /// Roll, pitch, heading.
    pub fn euler(&self) -> Euler {
        Euler::from_quaternion(&self.nav.q_nb)
    }

    /// Standard deviation of the heading as a rotation about Down, rad.
    pub fn heading_sigma(&self) -> f64 {
        self.covariance[(8, 8)].max(0.0).sqrt()
    }
}

/// Something worth telling that is neither an epoch nor an update.
// The one large variant comes once a run, and without an allocator there is no pointer to put it behind.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// The run began.
    Started(Alignment),
    /// The inertial data have a hole that was bridged with widened uncertainty.
    ImuGap {
        /// Last sample before.
        from: Time,
        /// First sample after.
        to: Time,
    },
    /// An aiding sample came when the filter was already past it, and was not used.
    TooLate {
        /// Its stamp.
        time: Time,
        /// Where the filter was.
        filter: Time,
    },
    /// An aiding sample is stamped after the last inertial one, and was not used.
    AfterEnd {
        /// Its stamp.
        time: Time,
    },
    /// An inertial sample with a stamp that was already there, and was not used.
    DuplicateImu {
        /// The stamp.
        time: Time,
    },
    /// Refused positions agreed with each other for so long that the filter went over to them.
    PositionReset {
        /// Instant of the fix that decided.
        time: Time,
        /// How far the filter moved at most, NED, m.
        offset_n: Vector3<f64>,
    },
    /// The body came to a stop.
    StopBegan {
        /// Since when the detector has agreed.
        begin: Time,
        /// From which instant the filter makes use of it.
        held_from: Time,
        /// What spoke for it.
        evidence: Evidence,
    },
    /// A stop was not looked at as a whole, as batch mode asks; zero velocities have led the filter through it.
    #[cfg(feature = "std")]
    StopNotFused {
        /// Begin of the stop.
        begin: Time,
        /// Why not.
        reason: NotFused,
    },
    /// A stop ended.
    StopEnded(StopRecord),
    /// Standing was declared, but it is contradicted: by the filter's own velocity when it was to begin, or later by GNSS or
    /// by what the inertial unit measured. Not used, or used no longer.
    StandstillContradicted {
        /// When.
        time: Time,
        /// v̂ᵀ (P_vv + 0.1² I)⁻¹ v̂, or the NIS of what contradicts.
        nis: f64,
    },
    /// Standing was declared for less time than anybody can stop and start in: not used.
    StandstillFlaps {
        /// When it ended.
        time: Time,
    },
    /// A sample with NaN or infinity in it was not used.
    NotFinite {
        /// Its stamp.
        time: Time,
        /// Which kind.
        what: &'static str,
    },
    /// A sample with a finite value that cannot be was not used: a latitude beyond ±90°, a covariance that is none, a sigma of
    /// zero.
    Impossible {
        /// Its stamp.
        time: Time,
        /// Which quantity.
        what: &'static str,
        /// What is wrong with it.
        why: &'static str,
    },
}

impl Event {
    /// A sample was not used for what it is.
    pub(crate) fn unfit(time: Time, unfit: Unfit) -> Self {
        match unfit {
            Unfit::NotFinite { what } => Event::NotFinite { time, what },
            Unfit::Impossible { what, why } => Event::Impossible { time, what, why },
        }
    }
}

/// Why a stop was not looked at as a whole.
#[cfg(feature = "std")]
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NotFused {
    /// Going back to its begin would lose a measurement.
    #[error("something else than standing was measured in it")]
    Disturbed,
    /// The fit knows biases only.
    #[error(
        "scale factors of the inertial unit are estimated or known, and a fit of a stop has none"
    )]
    Scale,
    /// The direction of the Earth's rate is not known.
    #[error("headings count from the start, and a fit of a stop needs north")]
    RelativeHeading,
    /// It ended as no stop.
    #[error("what was measured says that the vehicle moved")]
    Contradicted,
    /// What the stop says is far from what was known.
    #[error(
        "attitude or biases by the stop differ by {sigmas:.0} sigmas from what was known: check latitude, heading and bias noise"
    )]
    Inconsistent {
        /// The largest of the nine differences, in sigmas of what was known.
        sigmas: f64,
    },
    /// What was known has a covariance without an inverse.
    #[error("attitude and biases were known without an error that could be corrected")]
    Singular,
    /// The data do not bear it.
    #[error(transparent)]
    Refused(#[from] crate::alignment::Refusal),
}

/// Takes what a navigator produces. Every method has an empty default: implement what is wanted.
pub trait Sink {
    /// Whether an epoch at this instant is wanted; asked at every inertial sample, so a sink decimates here at no cost.
    fn wants_epoch(&mut self, _time: Time) -> bool {
        true
    }
    /// The solution at an inertial sample.
    fn epoch(&mut self, _epoch: &Epoch) {}
    /// A measurement was looked at.
    fn update(&mut self, _update: &Update) {}
    /// Something happened.
    fn event(&mut self, _event: &Event) {}
    /// Whether nobody wants the rest any more: asked while a navigator catches up with what it kept for a start, which can be hours in
    /// one step. What it kept is then dropped, and a run that goes on regardless has a gap there.
    fn is_over(&mut self) -> bool {
        false
    }
}

/// A sink that drops everything.
impl Sink for () {
    fn wants_epoch(&mut self, _time: Time) -> bool {
        false
    }
}
