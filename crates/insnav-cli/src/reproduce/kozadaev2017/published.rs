//! What the paper says, and why ours is not always the same.

use super::Case;
use insnav_core::config::VehicleKind;
use insnav_core::sim::{StopSetting, StopVariant};

/// A column of the paper's table.
#[derive(Clone, Copy)]
pub(super) struct Published {
    pub(super) horizontal: f64,
    pub(super) height: f64,
    pub(super) velocity: f64,
    pub(super) roll_pitch: f64,
    pub(super) heading: f64,
}

impl Published {
    /// Table of section 4: "modelled data" and "data of real subsystems".
    pub(super) fn of(case: Case, variant: StopVariant) -> Option<Self> {
        let column = |[horizontal, height, velocity, roll_pitch, heading]: [f64; 5]| Published {
            horizontal,
            height,
            velocity,
            roll_pitch,
            heading,
        };
        let numbers = match (case, variant) {
            (Case::Stop, StopVariant::Basic) => [1.65, 2.37, 0.07, 0.19, 7.2],
            (Case::Stop, StopVariant::ZuptZihrBiasOnly) => [1.3, 1.71, 0.01, 0.11, 1.23],
            (Case::Stop, StopVariant::PaperExact | StopVariant::PaperVarianceOnly) => {
                [1.3, 1.71, 0.01, 0.11, 0.51]
            }
            (Case::RealImu, StopVariant::Basic) => [1.79, 2.56, 0.08, 0.23, 8.31],
            (Case::RealImu, StopVariant::ZuptZihrBiasOnly) => [1.42, 1.93, 0.012, 0.13, 1.37],
            (Case::RealImu, StopVariant::PaperExact | StopVariant::PaperVarianceOnly) => {
                [1.42, 1.93, 0.012, 0.13, 0.51]
            }
            _ => return None,
        };
        Some(column(numbers))
    }
}

/// Why a number is not the published one, or not what one would expect.
pub(super) fn note(case: Case, variant: StopVariant, quantity: &str) -> Option<String> {
    use StopVariant as V;
    let simulated = case != Case::RealImu;
    let text = match (variant, quantity) {
        (V::Basic, "heading_end_rms_deg") if case == Case::Stop => {
            let setting = StopSetting::paper();
            let free = |at_zero| setting.free_heading_sigma(at_zero).to_degrees();
            return Some(format!(
                "7.2° cannot come out: integrating the stated sensors freely gives {:.1}° when the Gauss–Markov bias starts at zero \
                 and {:.1}° when it is stationary, which the paper does not say; noise of the measured force in the error dynamics \
                 then turns the heading further. It tells of that start, not of a method",
                free(true),
                free(false)
            ));
        }
        (V::Basic, "heading_end_nees") if simulated => {
            "far above 1: noise of the measured force makes the heading falsely observable"
        }
        (
            V::Basic | V::ZuptZihrBiasOnly | V::PaperExact | V::PaperVarianceOnly,
            "heading_end_rms_deg",
        ) if case == Case::RealImu => {
            "another unit than the paper's: its published column is for orientation only"
        }
        (V::ZuptZihrBiasOnly | V::ZuptZihrNaive, "heading_end_rms_deg") => {
            "measured force in the error dynamics, as the paper's basic system has it"
        }
        (V::ZuptZihrNaive, "heading_end_sigma_deg") if simulated => {
            "over-pessimistic: the same noise is in the rate that is measured and in the heading, which this gain ignores"
        }
        (V::PaperExact, "heading_end_rms_deg") if case == Case::Stop => {
            "the initial error of 0.5°, held: no method can do better here"
        }
        (V::PaperVarianceOnly, "heading_end_rms_deg") if case == Case::Stop => {
            "a first stop has no covariances to lose; drives between stops show the difference (--multi-stop)"
        }
        (V::ZuptZihrBiasOnly | V::PaperExact | V::PaperVarianceOnly, "velocity_rms_m_per_s")
            if case == Case::Stop =>
        {
            let config = variant.config().stationary.for_vehicle(VehicleKind::Car);
            let density = config.zero_velocity_m_per_s_per_sqrt_hz?;
            return Some(format!(
                "follows from the noise given to the zero velocity alone, which the paper does not state ({} m/s/√Hz here)",
                density
            ));
        }
        (V::PaperExactMeasuredForce, "heading_growth_rms_deg") => {
            "negative control: the measured force in the error dynamics turns a held heading"
        }
        (V::StaticWhiteGnss, "position_nees") => {
            "negative control: time-correlated errors taken as white make the position far too sure"
        }
        (_, "position_nees") if variant != V::StaticColouredGnss => {
            "positions taken as white: too sure of them, by the receiver's time-correlated part"
        }
        (_, "heading_end_rms_deg") if case == Case::MultiStop => {
            "ends of the stops after the first, pooled"
        }
        _ => return None,
    };
    Some(text.to_owned())
}
