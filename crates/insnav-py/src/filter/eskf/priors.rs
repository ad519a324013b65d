//! What is told from outside: optional blocks, covariances, calibration.

use super::super::blocks::{range, with_block};
use super::super::measured::{is_covariance, positive};
use super::{Any, Eskf, Given};
use crate::arrays::Argument;
use crate::failure::{Failure, fail, refused};
use crate::geometry::nav_state::one_vector;
use insnav_core::filter::{BLOCKS, Calibration, Process};
use insnav_core::time::Time;
use nalgebra::{SMatrix, Vector2, Vector3};
use pyo3::prelude::*;

#[pymethods]
impl Eskf {
    /// Estimate an optional block from now on, as independent Gauss–Markov processes; one that is open gets the prior anew.
    ///
    /// Parameters
    /// ----------
    /// block : str
    ///     Its name, one of ``insnav.filter.BLOCKS``.
    /// sigma : float or (k,)
    ///     Standard deviation of each state, at the start and for ever after.
    /// tau_s : float, optional
    ///     Correlation time, s; without it a constant.
    #[pyo3(signature = (block, *, sigma, tau_s=None))]
    fn open(
        &mut self,
        py: Python<'_>,
        block: &str,
        sigma: &Any<'_>,
        tau_s: Option<f64>,
    ) -> PyResult<()> {
        let size = optional(block).map_err(fail(py))?;
        let make = || {
            let numbers = Argument::new("sigma", sigma).numbers()?;
            let values = match (numbers.shape(), numbers.values()) {
                ([], &[s]) => Vector3::repeat(s),
                ([k], values) if *k == size => {
                    Vector3::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0))
                }
                (other, _) => {
                    let received = format!("shape {}", crate::arrays::shape_text(other));
                    let expected = format!("a number or ({size},)");
                    return Err(Failure::argument(
                        "wrong_shape",
                        "sigma",
                        received,
                        expected,
                        "",
                    ));
                }
            };
            values
                .iter()
                .take(size)
                .try_for_each(|s| positive("sigma", *s).map(drop))?;
            Ok(Process {
                sigma: values,
                tau: tau_s.map_or(Ok(f64::INFINITY), |t| positive("tau_s", t))?,
            })
        };
        let process = make().map_err(fail(py))?;
        let filter = &mut self.0;
        let opened = with_block!(block, handle => filter.open(handle, process));
        opened.unwrap_or(Ok(())).map_err(refused(py, Time(0)))
    }

    /// Estimate an optional block no longer; what was found of it stays in use.
    ///
    /// Parameters
    /// ----------
    /// block : str
    ///     Its name.
    fn close(&mut self, py: Python<'_>, block: &str) -> PyResult<()> {
        optional(block).map_err(fail(py))?;
        let filter = &mut self.0;
        let _ = with_block!(block, handle => filter.close(handle));
        Ok(())
    }

    /// Add an independent uncertainty to one open block.
    ///
    /// Parameters
    /// ----------
    /// block : str
    ///     Its name.
    /// extra : (k, k)
    ///     Covariance to add: symmetric, without negative variances.
    fn widen(&mut self, py: Python<'_>, block: &str, extra: &Any<'_>) -> PyResult<()> {
        let n = range(&self.0, "block", block).map_err(fail(py))?.len();
        let extra = Argument::new("extra", extra)
            .matrix(Some(n), Some(n))
            .and_then(|extra| is_covariance("extra", &extra).map(|()| extra))
            .map_err(fail(py))?;
        let filter = &mut self.0;
        let _ = with_block!(block, handle => {
            filter.widen(handle, &SMatrix::from_fn(|i, j| extra[(i, j)]));
        });
        Ok(())
    }

    /// Set the covariance of one open block and drop its correlations with all others.
    ///
    /// Parameters
    /// ----------
    /// block : str
    ///     Its name.
    /// prior : (k, k)
    ///     The covariance: symmetric, without negative variances.
    fn set_prior(&mut self, py: Python<'_>, block: &str, prior: &Any<'_>) -> PyResult<()> {
        let n = range(&self.0, "block", block).map_err(fail(py))?.len();
        let prior = Argument::new("prior", prior)
            .matrix(Some(n), Some(n))
            .and_then(|prior| is_covariance("prior", &prior).map(|()| prior))
            .map_err(fail(py))?;
        let covariance = self.0.covariance_mut();
        let _ = with_block!(block, handle => {
            covariance.set_prior(handle, &SMatrix::from_fn(|i, j| prior[(i, j)]));
        });
        Ok(())
    }

    /// Give attitude, gyro bias and accelerometer bias one joint covariance, as an alignment has it.
    ///
    /// Parameters
    /// ----------
    /// joint : (9, 9)
    ///     Small rotation in n (rad), gyro bias (rad/s, b), accelerometer bias (m/s², b), in this order.
    fn set_joint_prior(&mut self, py: Python<'_>, joint: &Any<'_>) -> PyResult<()> {
        let joint = Argument::new("joint", joint)
            .matrix(Some(9), Some(9))
            .and_then(|joint| is_covariance("joint", &joint).map(|()| joint))
            .map_err(fail(py))?;
        self.0
            .set_joint_prior(&SMatrix::from_fn(|i, j| joint[(i, j)]));
        Ok(())
    }

    /// Set the covariance of all open states.
    ///
    /// Parameters
    /// ----------
    /// covariance : (n, n)
    ///     Taken as symmetric; that it is positive semidefinite is yours to see to.
    fn set_covariance(&mut self, py: Python<'_>, covariance: &Any<'_>) -> PyResult<()> {
        let n = self.0.covariance().layout().len();
        let given = Argument::new("covariance", covariance)
            .matrix(Some(n), Some(n))
            .map_err(fail(py))?;
        self.0.covariance_mut().set_dense(|i, j| given[(i, j)]);
        Ok(())
    }

    /// What is known beforehand of lever arm, mounting and the like; what is not named stays as it is.
    ///
    /// Parameters
    /// ----------
    /// lever_arm_b : (3,), optional
    ///     To add to the lever arm of measurements, b, m.
    /// mounting : (2,), optional
    ///     Pitch and yaw of the IMU's axes against the vehicle's, rad.
    /// gnss_colour_n : (3,), optional
    ///     Time-correlated error of GNSS positions, n, m.
    /// axle_forward : float, optional
    ///     To add to the forward place of the axle, b, m.
    /// odometer_scale : float, optional
    ///     Scale factor error of the odometer.
    /// clock_offset : float, optional
    ///     A fix stamped t shows the body where the filter had it at t minus this, s.
    #[pyo3(signature = (*, lever_arm_b=None, mounting=None, gnss_colour_n=None, axle_forward=None, odometer_scale=None, clock_offset=None))]
    #[allow(clippy::too_many_arguments)]
    fn set_calibration(
        &mut self,
        py: Python<'_>,
        lever_arm_b: Given<'_, '_>,
        mounting: Option<[f64; 2]>,
        gnss_colour_n: Given<'_, '_>,
        axle_forward: Option<f64>,
        odometer_scale: Option<f64>,
        clock_offset: Option<f64>,
    ) -> PyResult<()> {
        let now = self.0.nominal().calibration;
        let number = |name: &str, given: Option<f64>, now: f64| match given {
            Some(x) if !x.is_finite() => {
                let expected = "a finite number";
                Err(Failure::argument(
                    "bad_value",
                    name,
                    x.to_string(),
                    expected,
                    "",
                ))
            }
            given => Ok(given.unwrap_or(now)),
        };
        let three = |name: &str, given: Given<'_, '_>, now: Vector3<f64>| {
            given.map_or(Ok(now), |v| one_vector(name, v))
        };
        let make = || {
            let [pitch, yaw] = mounting.unwrap_or(now.mounting.into());
            Ok(Calibration {
                gnss_colour_n: three("gnss_colour_n", gnss_colour_n, now.gnss_colour_n)?,
                lever_arm_b: three("lever_arm_b", lever_arm_b, now.lever_arm_b)?,
                mounting: Vector2::new(
                    number("mounting", Some(pitch), 0.0)?,
                    number("mounting", Some(yaw), 0.0)?,
                ),
                axle_forward: number("axle_forward", axle_forward, now.axle_forward)?,
                odometer_scale: number("odometer_scale", odometer_scale, now.odometer_scale)?,
                clock_offset: number("clock_offset", clock_offset, now.clock_offset)?,
            })
        };
        self.0.set_calibration(make().map_err(fail(py))?);
        Ok(())
    }

    /// Forget what the velocity has to do with anything else.
    ///
    /// Parameters
    /// ----------
    /// sigma : float
    ///     How well it is known from here on, m/s.
    fn forget_velocity(&mut self, py: Python<'_>, sigma: f64) -> PyResult<()> {
        let sigma = positive("sigma", sigma).map_err(fail(py))?;
        self.0.forget_velocity(sigma);
        Ok(())
    }
}

/// Size of a block that opens and closes.
fn optional(name: &str) -> Result<usize, Failure> {
    let may = |name: &str| !name.starts_with("held");
    let found = BLOCKS[5..]
        .iter()
        .find(|info| info.name == name && may(name));
    found.map(|info| info.size).ok_or_else(|| {
        let known: Vec<&str> = BLOCKS[5..].iter().map(|b| b.name).filter(|n| may(n)).collect();
        Failure::argument(
            "bad_option",
            "block",
            format!("{name:?}"),
            format!("one of the optional blocks {}", known.join(", ")),
            "base blocks are always open; for what is held there are hold_heading and hold_attitude",
        )
    })
}
