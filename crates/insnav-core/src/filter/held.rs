//! A held heading or attitude: the error of the moment at which it was taken gets states of its own.
//!
//! While standing, the attitude error is split in two: Ψ, what it was when the stop began, which is constant, and φ, what has
//! come to it since, which a comparison with the held attitude shows. The total φ + Ψ obeys the same model as before, so that
//! the way in and the way out are exact linear maps, with all cross-covariances (\[Kozadaev17\] eq. 9 to 12, who keeps the variance
//! alone). P is singular by design meanwhile: nothing here inverts it.

use super::columns::{Columns, States, part};
use super::covariance::Covariance;
use super::eskf::Eskf;
use super::layout::{ATTITUDE, BASE, Block, HELD_ATTITUDE, HELD_HEADING, Layout};
use crate::config::Bookkeeping;
use crate::error::Result;
use nalgebra::{Matrix1, Matrix3, SMatrix};

const DOWN: usize = 2;

/// By how much a correction turns the estimate about Down, rad.
pub(super) fn turn_of(layout: &Layout, dx: &States) -> f64 {
    let attitude = part(layout, dx, ATTITUDE).unwrap_or_default().z;
    let heading = part(layout, dx, HELD_HEADING).map_or(0.0, |x| x[0]);
    attitude + heading + part(layout, dx, HELD_ATTITUDE).unwrap_or_default().z
}

/// What acts through the attitude error acts through its held part as well.
pub(super) fn mirror_held<const M: usize>(columns: &mut Columns<M>, layout: &Layout) {
    columns.mirror(layout, ATTITUDE, DOWN, HELD_HEADING);
    columns.mirror(layout, ATTITUDE, 0, HELD_ATTITUDE);
}

impl Eskf {
    /// Hold the heading that there is now: its error, the rotation about Down, becomes a constant of its own.
    ///
    /// # Errors
    /// `Capacity` when there is no room for it.
    pub fn hold_heading(&mut self, bookkeeping: Bookkeeping) -> Result<()> {
        self.settle();
        let variance = self.down_variance();
        self.hold(DOWN, HELD_HEADING)?;
        if bookkeeping == Bookkeeping::VarianceOnly {
            self.covariance
                .set_prior(HELD_HEADING, &Matrix1::new(variance));
        }
        Ok(())
    }

    /// Hold it no longer: both parts are one error again.
    pub fn release_heading(&mut self, bookkeeping: Bookkeeping) {
        self.settle();
        match bookkeeping {
            Bookkeeping::Exact => self.covariance.merge(HELD_HEADING, ATTITUDE, DOWN),
            Bookkeeping::VarianceOnly => {
                let held = self.covariance.block(HELD_HEADING, HELD_HEADING);
                self.covariance.close(HELD_HEADING);
                let mut gain = Matrix3::zeros();
                gain[(DOWN, DOWN)] = held.map_or(0.0, |v| v.x);
                self.covariance.add(ATTITUDE, &gain);
            }
        }
    }

    /// Hold the whole attitude that there is now.
    ///
    /// # Errors
    /// `Capacity` when there is no room for it.
    pub fn hold_attitude(&mut self) -> Result<()> {
        self.hold(0, HELD_ATTITUDE)
    }

    /// Hold it no longer.
    pub fn release_attitude(&mut self) {
        self.settle();
        self.covariance.merge(HELD_ATTITUDE, ATTITUDE, 0);
    }

    fn hold<const K: usize>(&mut self, axis: usize, block: Block<K>) -> Result<()> {
        self.settle();
        self.covariance.split(ATTITUDE, axis, block)?;
        self.processes.set(block, super::Process::constant(0.0));
        self.nominal.held_q_nb = self.nominal.nav.q_nb;
        Ok(())
    }

    /// Variance of the rotation about Down, rad².
    fn down_variance(&self) -> f64 {
        let attitude = self.covariance.block(ATTITUDE, ATTITUDE);
        attitude.map_or(0.0, |p| p[(DOWN, DOWN)])
    }

    /// Covariance of the base states with the whole attitude error, what is held included.
    pub fn base_covariance(&self) -> SMatrix<f64, BASE, BASE> {
        let layout = self.covariance.layout();
        if !layout.has(HELD_HEADING) && !layout.has(HELD_ATTITUDE) {
            return self.with_covariance(Covariance::dense);
        }
        let mut whole = self.with_covariance(Covariance::clone);
        whole.merge(HELD_HEADING, ATTITUDE, DOWN);
        whole.merge(HELD_ATTITUDE, ATTITUDE, 0);
        whole.dense()
    }

    /// Covariance of the whole attitude as a small rotation in NED, rad².
    pub fn attitude_covariance_n(&self) -> Matrix3<f64> {
        self.base_covariance().fixed_view::<3, 3>(6, 6).into_owned()
    }
}
