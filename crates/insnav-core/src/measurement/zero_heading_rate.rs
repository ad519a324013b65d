//! The body stands: it does not turn about the vertical (zero integrated heading rate).

use crate::config::{HeadingRateGain, StationaryConfig};
use crate::earth::earth_rate_n;
use crate::error::Result;
use crate::filter::{
    ATTITUDE, Block, Columns, Eskf, GYRO_BIAS, Gate, Layout, Linearized, Measurement, Nominal,
    Update,
};
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix1, Matrix1x3, Matrix3, Vector1};
use serde::{Deserialize, Serialize};

/// Zero turn rate about Down: r = −(C ω − ω_ie)_D, rad/s, with the rate of the interval that the filter has just moved over.
///
/// The noise of that rate has gone into the attitude as well. With it accounted for (`Correlated`) the update undoes
/// what the noise did to the heading, and is as good as a held heading; taken as independent (`Naive`) it holds the heading
/// but believes that it has let it walk.
///
/// What the residual has to do with the level is taken at the rate of a body at rest, ω_ie. The measured one has its noise n in it,
/// which is in the residual as (Ĉ n)_D whatever the level is: with (φ × Ĉ n)_D in H besides, the level would be told from
/// noise, a hundred times a second (.57° as .50° after a minute, with a NEES of 1.6).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroHeadingRateModel {
    /// Standard deviation of the rate over the interval, rad/s.
    pub sigma: f64,
    /// Length of the interval, s.
    pub dt: f64,
    /// What the gain knows and moves.
    pub gain: HeadingRateGain,
}

impl Measurement<1> for ZeroHeadingRateModel {
    fn name(&self) -> &'static str {
        "zero_heading_rate"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<1> {
        let axes_n = at.nav.q_nb.to_rotation_matrix().into_inner();
        let rate_n = axes_n * at.rate_b;
        let mut h = Columns::default();
        let down: Matrix1x3<f64> = axes_n.fixed_rows::<1>(2).into_owned();
        at.put_rate(&mut h, layout, &down);
        // (φ × ω)_D with the rate that a body at rest feels, ω = ω_ie.
        let earth = earth_rate_n(at.nav.position.latitude);
        h.put(layout, ATTITUDE, &Matrix1x3::new(earth.y, -earth.x, 0.0));
        Linearized {
            residual: Vector1::new(earth.z - rate_n.z),
            h,
            r: Matrix1::new(self.sigma * self.sigma),
        }
    }

    fn noise_in_states(&self, layout: &Layout) -> Option<Columns<1>> {
        if self.gain != HeadingRateGain::Correlated {
            return None;
        }
        // Both are −C n: once as it is, once over dt.
        let mut cross = Columns::default();
        cross.put_axis(layout, ATTITUDE, 2, [self.sigma * self.sigma * self.dt]);
        Some(cross)
    }

    fn only(&self) -> Option<Block<3>> {
        (self.gain == HeadingRateGain::BiasOnly).then_some(GYRO_BIAS)
    }
}

/// Rates of a body at rest are beyond this once in 10⁹ (chi-square of three degrees of freedom): what is left out at rest must not
/// be seen in the heading. Slower turns tell a tilt next to nothing of itself: a rate of √45 σ shows it to 0.15 rad a sample.
const MOVES: f64 = 45.0;

/// When and how the zero rate is used: at every inertial sample of a stop in which the body does not turn about any axis. One
/// that tilts has a rate about Down as well, by as much as it is tilted already, which would be taken for an error of tilt.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ZeroHeadingRateAid {
    gain: HeadingRateGain,
}

impl ZeroHeadingRateAid {
    /// From the settings.
    pub fn new(config: &StationaryConfig) -> Self {
        ZeroHeadingRateAid {
            gain: config.heading_rate,
        }
    }

    /// Tell the filter that the body did not turn over the last `dt` seconds.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe(&self, dt: f64, filter: &mut Eskf) -> Result<Update> {
        let time = filter.nominal().nav.time;
        let model = ZeroHeadingRateModel {
            sigma: filter.noise().gyro_white / dt.sqrt(),
            dt,
            gain: self.gain,
        };
        // The noise of a rate that is far out has gone into the heading too: to undo it, it must count in full.
        let mut gate = match self.gain {
            _ if moves(filter, model.sigma) => Gate::closed(),
            HeadingRateGain::Correlated => Gate::open(),
            HeadingRateGain::Naive | HeadingRateGain::BiasOnly => Gate::lenient(),
        };
        filter.update(&model, time, &mut gate)
    }
}

/// Whether the rate of the last interval is that of a body which turns, whatever the axis.
fn moves(filter: &Eskf, sigma: f64) -> bool {
    let nav = &filter.nominal().nav;
    let earth = earth_rate_n(nav.position.latitude);
    let rate = filter.nominal().rate_b - nav.q_nb.inverse_transform_vector(&earth);
    let known = filter.covariance().block(GYRO_BIAS, GYRO_BIAS);
    let covariance = known.unwrap_or_else(Matrix3::zeros) + Matrix3::identity() * (sigma * sigma);
    covariance
        .cholesky()
        .is_some_and(|c| rate.dot(&c.solve(&rate)) > MOVES)
}
