//! Why an alignment from stops is not given: each with the numbers that show it, and the remedy.

use std::string::{String, ToString};

/// What stands against an alignment. Times count from the zero of [`crate::time::Time`].
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// No inertial data in the window.
    #[error("there are no inertial data in the window: give a window inside the record")]
    NoData,
    /// A window outside the data.
    #[error(
        "the stop {begin_s:.3}..{end_s:.3} s is not inside the data ({data_begin_s:.3}..{data_end_s:.3} s): give a window inside"
    )]
    OutsideData {
        /// Begin of the window.
        begin_s: f64,
        /// End of the window.
        end_s: f64,
        /// Begin of the data.
        data_begin_s: f64,
        /// End of the data.
        data_end_s: f64,
    },
    /// No stop at all.
    #[error("no stop is given: name at least one window of standing")]
    NoStop,
    /// Windows that overlap.
    #[error(
        "the stop that begins at {begin_s:.3} s overlaps the one before, which ends at {previous_end_s:.3} s: give stops that do not overlap"
    )]
    StopsOverlap {
        /// Begin of the later window.
        begin_s: f64,
        /// End of the earlier one.
        previous_end_s: f64,
    },
    /// What the accelerometers feel is not gravity.
    #[error(
        "in the stop at {begin_s:.3} s the accelerometers feel {force_m_per_s2:.3} m/s², gravity is {gravity_m_per_s2:.3}: check the units of the inertial data, and that the body stands"
    )]
    NotGravity {
        /// Begin of the window.
        begin_s: f64,
        /// Size of the mean specific force.
        force_m_per_s2: f64,
        /// Gravity there.
        gravity_m_per_s2: f64,
    },
    /// A stop shorter than the method can use.
    #[error("the stop at {begin_s:.3} s lasts {have_s:.1} s, {need_s:.1} s are needed: {reason}")]
    StopTooShort {
        /// Begin of the window.
        begin_s: f64,
        /// Its length.
        have_s: f64,
        /// The least length.
        need_s: f64,
        /// Why.
        reason: &'static str,
    },
    /// The two halves of a stop tell different rates.
    #[error(
        "the body does not stand in the stop at {begin_s:.3} s: rates of its two halves differ by {disagreement_sigma:.1} sigmas (4 allowed), velocity scatters by {velocity_rms_m_per_s:.2e} m/s: shorten the window to what is still, or state more gyro noise"
    )]
    NotStationary {
        /// Begin of the window.
        begin_s: f64,
        /// Scatter of the computed velocity about its fit.
        velocity_rms_m_per_s: f64,
        /// Largest difference of a component, in its sigmas.
        disagreement_sigma: f64,
    },
    /// The two halves of a stop have different mean rates or forces.
    #[error(
        "the body does not stand in the stop at {begin_s:.3} s: mean rates or forces of its two halves differ by {difference_sigma:.1} sigmas (6 allowed): shorten the window to what is still"
    )]
    Moving {
        /// Begin of the window.
        begin_s: f64,
        /// Largest difference of a component, in its sigmas.
        difference_sigma: f64,
    },
    /// Positions that leave one direction of the unknowns unseen.
    #[error(
        "the stops do not tell drift and azimuth apart: the combination azimuth {azimuth:+.2}, drift north {north:+.2} east {east:+.2} down {down:+.2} is seen {ratio:.1e} as well as a well-placed one (0.05 needed): {advice}"
    )]
    SingularGeometry {
        /// Part of the azimuth in the unseen direction (unit vector; drifts over Ω cos L).
        azimuth: f64,
        /// Part of a drift along north.
        north: f64,
        /// Part of a drift along east.
        east: f64,
        /// Part of a drift along down.
        down: f64,
        /// Least singular value of the scaled Jacobian.
        ratio: f64,
        /// What to do.
        advice: &'static str,
    },
    /// The paper's quadratic equation has no real root, or two that merge.
    #[error(
        "the quadratic equation of the paper has no two distinct roots (discriminant {discriminant:.1e}, 0.0025 needed): turn the unit about an axis with a north component, or use the vertical rate"
    )]
    NegativeDiscriminant {
        /// The discriminant over its leading coefficient.
        discriminant: f64,
    },
    /// The Earth rate found is not that of the latitude.
    #[error(
        "the Earth rate found is not that of latitude {latitude_deg:.4}°: its {part} part is off by {off_deg_per_hour:+.3} °/h ({sigmas:.1} sigmas, 4 allowed): check the latitude (north is positive), or state a larger gyro bias"
    )]
    LatitudeInconsistent {
        /// As told, degrees.
        latitude_deg: f64,
        /// "horizontal" or "vertical".
        part: &'static str,
        /// That part found less that of the latitude.
        off_deg_per_hour: f64,
        /// That in its sigmas, once and a half the bias that is expected of the unit allowed for.
        sigmas: f64,
    },
    /// The joint fit does not come to rest.
    #[error(
        "the fit of the stops does not settle: after {passes} passes its step is still {step_sigmas:.1e} sigmas (0.05 allowed), as drifts too large for so long a free run leave it: take stops of 300 s or less close to the turn, and check units, axes and latitude"
    )]
    NotConverged {
        /// Passes made.
        passes: usize,
        /// Largest component of the last step over its sigma; infinite where a pass had no solution.
        step_sigmas: f64,
    },
    /// A Kalman filter is asked for on a base that rocks.
    #[error(
        "the base rocks: the Kalman filter's normalised innovations squared are {nis:.1} on average ({allowed:.1} allowed), and its sigmas would not hold: use the method joint or auto, or state more noise if the base is quiet"
    )]
    BaseRocks {
        /// Normalised innovations squared over their number.
        nis: f64,
        /// The largest allowed.
        allowed: f64,
    },
    /// A heading that is told, and one that the stops tell.
    #[error(
        "the heading told is {told_deg:.3}°, the stops tell {found_deg:.3}° ({sigmas:.1} sigmas apart, 5 allowed): correct the heading, or state a larger sigma for it"
    )]
    HeadingContradicted {
        /// As told.
        told_deg: f64,
        /// As found without it.
        found_deg: f64,
        /// How far apart in their common sigma.
        sigmas: f64,
    },
    /// Too near a pole.
    #[error(
        "at latitude {latitude_deg:.3}° the Earth's rate has no horizontal part to find north by: 89° is the limit"
    )]
    AzimuthUnobservable {
        /// The latitude.
        latitude_deg: f64,
    },
    /// At a pole no direction is north.
    #[error(
        "at latitude {latitude_deg:.4}° every direction is south or north, and a heading means nothing: give the latitude where the body stands, 89.99° at most"
    )]
    AtPole {
        /// The latitude.
        latitude_deg: f64,
    },
    /// The unit cannot find north in these stops: by its noise beforehand, or by what a fit has left.
    #[error(
        "with this unit in these stops the azimuth has a sigma of {sigma_azimuth_deg:.2}° ({limit_deg:.2}° allowed): stand longer, turn between stops, use a better unit, or ask for levelling"
    )]
    LowGrade {
        /// Sigma predicted from noise, bias and lengths, or of the fit.
        sigma_azimuth_deg: f64,
        /// The largest allowed.
        limit_deg: f64,
    },
    /// A hole in the data.
    #[error(
        "{length_s:.2} s of inertial data are missing at {at_s:.3} s: attitude is not carried over holes; use stops on one side of it"
    )]
    GapInData {
        /// Where.
        at_s: f64,
        /// How long.
        length_s: f64,
    },
    /// Two positions are asked for, and there is only one.
    #[error(
        "the body was turned by {turn_deg:.2}° between its stops at most: two-position methods need a turn (180° about the vertical is best, 5° the least)"
    )]
    MissingRotation {
        /// The largest turn against the first stop.
        turn_deg: f64,
    },
    /// The gyros' scale error in the turn is worse than all noise.
    #[error(
        "the turn of {turn_deg:.0}° with a scale error of {scale_ppm:.0} ppm leaves {error_nrad_per_s:.1} nrad/s, more than the first stop's own {noise_nrad_per_s:.1} nrad/s: calibrate the scale or turn less"
    )]
    TurnScaleDominates {
        /// The turn.
        turn_deg: f64,
        /// Standard deviation of the scale factor.
        scale_ppm: f64,
        /// What it leaves on the rate.
        error_nrad_per_s: f64,
        /// Rate noise of a stop.
        noise_nrad_per_s: f64,
    },
    /// A setting that makes no sense.
    #[error("{key} = {value}: must be {expected}")]
    Option {
        /// Which one.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
}

impl Refusal {
    /// What stands against it, and what to do about it, apart.
    pub fn parts(&self) -> (String, String) {
        let text = self.to_string();
        let (what, remedy) = text.rsplit_once(": ").unwrap_or((&text, ""));
        (what.to_string(), remedy.to_string())
    }

    /// When it is: the begin of the stop or hole that it is about, s from the zero of [`crate::time::Time`].
    pub fn time_s(&self) -> Option<f64> {
        match *self {
            Refusal::OutsideData { begin_s, .. }
            | Refusal::StopsOverlap { begin_s, .. }
            | Refusal::NotGravity { begin_s, .. }
            | Refusal::StopTooShort { begin_s, .. }
            | Refusal::NotStationary { begin_s, .. }
            | Refusal::Moving { begin_s, .. } => Some(begin_s),
            Refusal::GapInData { at_s, .. } => Some(at_s),
            _ => None,
        }
    }

    /// A short name for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Refusal::NoData => "no_data",
            Refusal::OutsideData { .. } => "outside_data",
            Refusal::NoStop => "no_stop",
            Refusal::StopsOverlap { .. } => "stops_overlap",
            Refusal::NotGravity { .. } => "not_gravity",
            Refusal::StopTooShort { .. } => "stop_too_short",
            Refusal::NotStationary { .. } | Refusal::Moving { .. } => "not_stationary",
            Refusal::SingularGeometry { .. } => "singular_geometry",
            Refusal::NegativeDiscriminant { .. } => "negative_discriminant",
            Refusal::LatitudeInconsistent { .. } => "latitude_inconsistent",
            Refusal::NotConverged { .. } => "not_converged",
            Refusal::BaseRocks { .. } => "base_rocks",
            Refusal::AtPole { .. } => "at_pole",
            Refusal::HeadingContradicted { .. } => "heading_contradicted",
            Refusal::AzimuthUnobservable { .. } => "azimuth_unobservable",
            Refusal::LowGrade { .. } => "low_grade",
            Refusal::GapInData { .. } => "gap_in_data",
            Refusal::MissingRotation { .. } => "missing_rotation",
            Refusal::TurnScaleDominates { .. } => "turn_scale_dominates",
            Refusal::Option { .. } => "option",
        }
    }
}
