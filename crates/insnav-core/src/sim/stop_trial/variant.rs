//! What is made of the stop: one set of settings each.

use crate::config::{
    Bookkeeping, ColourConfig, Config, DetectorKind, HeadingRateGain, HeadingRow, SigmaScale,
    StandingForce, StationaryMode,
};
use crate::sim::stop_trial::setting::{COLOUR_SHARE, COLOUR_TAU_S, HEIGHT_M, HORIZONTAL_M};

/// A way to use a stop, as settings of the navigator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum StopVariant {
    /// Nothing is made of it: the "basic system" of \[Kozadaev17\].
    Basic,
    /// Zero velocity.
    Zupt,
    /// Zero velocity, and zero rate about the vertical with a gain on the gyro bias alone; measured force in F.
    ZuptZihrBiasOnly,
    /// The same with the full gain, as if the rate's noise were not in the heading already; measured force in F.
    ZuptZihrNaive,
    /// The same with that correlation.
    ZuptZihrCorrelated,
    /// Zero velocity and a held heading, all covariances moved along.
    PaperExact,
    /// The same, its variance alone moved, as \[Kozadaev17\] words it.
    PaperVarianceOnly,
    /// Zero velocity and all three angles held.
    AttitudeClone,
    /// Constant pose; without random walk, as the body of the trial has none.
    Static,
    /// The same, with states for the time-correlated error of the positions; receiver unscaled (see
    /// [`StopVariant::receiver_is_scaled`]).
    StaticColouredGnss,
    /// Negative control: [`StopVariant::PaperExact`] with the measured force in F.
    PaperExactMeasuredForce,
    /// Negative control at steep pitch: [`StopVariant::PaperExact`] with the difference of Euler headings.
    PaperExactEulerRow,
    /// Negative control: [`StopVariant::Static`] on the receiver of [`StopVariant::StaticColouredGnss`].
    StaticWhiteGnss,
}

impl StopVariant {
    /// Those of the published comparison and of ours.
    pub const COMPARED: [StopVariant; 10] = [
        StopVariant::Basic,
        StopVariant::Zupt,
        StopVariant::ZuptZihrBiasOnly,
        StopVariant::ZuptZihrNaive,
        StopVariant::ZuptZihrCorrelated,
        StopVariant::PaperExact,
        StopVariant::PaperVarianceOnly,
        StopVariant::AttitudeClone,
        StopVariant::Static,
        StopVariant::StaticColouredGnss,
    ];

    /// Those that show that the comparison can fail.
    pub const CONTROLS: [StopVariant; 2] = [
        StopVariant::PaperExactMeasuredForce,
        StopVariant::StaticWhiteGnss,
    ];

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            StopVariant::Basic => "basic",
            StopVariant::Zupt => "zupt",
            StopVariant::ZuptZihrBiasOnly => "zupt_zihr_bias_only",
            StopVariant::ZuptZihrNaive => "zupt_zihr_naive",
            StopVariant::ZuptZihrCorrelated => "zupt_zihr_correlated",
            StopVariant::PaperExact => "paper_exact",
            StopVariant::PaperVarianceOnly => "paper_variance_only",
            StopVariant::AttitudeClone => "attitude_clone",
            StopVariant::Static => "static",
            StopVariant::StaticColouredGnss => "static_coloured_gnss",
            StopVariant::PaperExactMeasuredForce => "paper_exact_measured_force",
            StopVariant::PaperExactEulerRow => "paper_exact_euler_row",
            StopVariant::StaticWhiteGnss => "static_white_gnss",
        }
    }

    /// Whether the receiver's errors are scaled to what it showed over the run.
    ///
    /// Scaled errors are no Gauss–Markov process any more: where that process is what the filter is told of, it must be one.
    pub fn receiver_is_scaled(self) -> bool {
        !matches!(
            self,
            StopVariant::StaticColouredGnss | StopVariant::StaticWhiteGnss
        )
    }

    /// The settings. Fixes are taken as stated and independent: what the receiver of the trial is, and neither learnt nor
    /// weighed down.
    pub fn config(self) -> Config {
        let mut config = Config::default();
        config.gnss.sigma_scale = SigmaScale::Fixed(1.0);
        config.gnss.velocity_sigma_scale = SigmaScale::Fixed(1.0);
        config.gnss.sigma_floor_m = 0.0;
        config.gnss.velocity_sigma_floor_m_per_s = 0.0;
        config.gnss.correlation_time_s = 0.0;
        let stops = &mut config.stationary;
        stops.detector = DetectorKind::None;
        // The body of the trial rests on rock.
        stops.attitude_walk_deg_per_sqrt_hour = 0.0;
        stops.position_walk_m_per_sqrt_s = 0.0;
        let zihr = |gain, force| (StationaryMode::Zihr, gain, force);
        let correlated = HeadingRateGain::Correlated;
        (stops.mode, stops.heading_rate, stops.force) = match self {
            StopVariant::Basic => (StationaryMode::Off, correlated, StandingForce::Measured),
            StopVariant::Zupt => (StationaryMode::Zupt, correlated, StandingForce::Gravity),
            StopVariant::ZuptZihrBiasOnly => {
                zihr(HeadingRateGain::BiasOnly, StandingForce::Measured)
            }
            StopVariant::ZuptZihrNaive => zihr(HeadingRateGain::Naive, StandingForce::Measured),
            StopVariant::ZuptZihrCorrelated => zihr(correlated, StandingForce::Gravity),
            StopVariant::PaperExact
            | StopVariant::PaperVarianceOnly
            | StopVariant::PaperExactEulerRow => (
                StationaryMode::HeadingHold,
                correlated,
                StandingForce::Gravity,
            ),
            StopVariant::PaperExactMeasuredForce => (
                StationaryMode::HeadingHold,
                correlated,
                StandingForce::Measured,
            ),
            StopVariant::AttitudeClone => (
                StationaryMode::AttitudeHold,
                correlated,
                StandingForce::Gravity,
            ),
            StopVariant::Static
            | StopVariant::StaticColouredGnss
            | StopVariant::StaticWhiteGnss => {
                (StationaryMode::Static, correlated, StandingForce::Gravity)
            }
        };
        if self == StopVariant::PaperVarianceOnly {
            stops.bookkeeping = Bookkeeping::VarianceOnly;
        }
        if self == StopVariant::PaperExactEulerRow {
            stops.heading_row = HeadingRow::Euler;
        }
        if self == StopVariant::StaticColouredGnss {
            let share = COLOUR_SHARE.sqrt();
            config.gnss.colour = Some(ColourConfig {
                sigma_m: HORIZONTAL_M / 2f64.sqrt() * share,
                vertical_sigma_m: Some(HEIGHT_M * share),
                tau_s: COLOUR_TAU_S,
            });
            // Fixes state the whole error: the white part is what is left.
            config.gnss.sigma_scale = SigmaScale::Fixed((1.0 - COLOUR_SHARE).sqrt());
        }
        config
    }
}
