//! A wheeled vehicle moves where its wheels point: across and upwards its velocity is zero.

use crate::attitude::{exp, skew};
use crate::config::{Nonholonomic, VehicleConfig};
use crate::earth::earth_rate_n;
use crate::error::Result;
use crate::filter::{
    ATTITUDE, AXLE, Columns, Eskf, Gate, Layout, Linearized, MOUNTING, Measurement, Nominal,
    Update, VELOCITY,
};
use crate::time::Time;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, SMatrix, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// Zero velocity across and downwards of the vehicle, at a point of it: r = −(R (Cᵀ v + (ω_ib − Cᵀ ω_ie) × l))_yz, m/s, where
/// R turns the IMU's axes into the vehicle's (\[Dissanayake01\], with mounting and axle estimated).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonholonomicModel {
    /// The point (the middle of the axle that is not steered) from the IMU, body axes, m.
    pub axle_b: Vector3<f64>,
    /// Covariance, m²/s².
    pub r: Matrix2<f64>,
}

/// Rotation from the IMU's axes to the vehicle's: `Rz(yaw) Ry(pitch)`.
fn to_vehicle(mounting: &Vector2<f64>) -> (Matrix3<f64>, Vector3<f64>) {
    let yaw = exp(&(Vector3::z() * mounting.y));
    let pitch = exp(&(Vector3::y() * mounting.x));
    let turned = yaw * Vector3::y();
    ((yaw * pitch).to_rotation_matrix().into_inner(), turned)
}

impl Measurement<2> for NonholonomicModel {
    fn name(&self) -> &'static str {
        "nonholonomic"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<2> {
        let (r_vb, pitch_axis) = to_vehicle(&at.calibration.mounting);
        let to_b = at.nav.q_nb.inverse().to_rotation_matrix().into_inner();
        let w_ie = earth_rate_n(at.nav.position.latitude);
        let rate_b = at.rate_b - to_b * w_ie;
        let axle_b = self.axle_b + Vector3::x() * at.calibration.axle_forward;
        let u = r_vb * (to_b * at.nav.velocity_n + rate_b.cross(&axle_b));

        // Rows of the second and third axis of the vehicle.
        let yz = |m: Matrix3<f64>| -> Matrix2x3<f64> { m.fixed_rows::<2>(1).into_owned() };
        let swing = skew(&axle_b);
        let by_attitude = to_b * skew(&at.nav.velocity_n) + swing * to_b * skew(&w_ie);
        let by_pitch = pitch_axis.cross(&u);
        let by_yaw = Vector3::z().cross(&u);
        let mut h = Columns::default();
        h.put(layout, VELOCITY, &yz(r_vb * to_b));
        h.put(layout, ATTITUDE, &yz(r_vb * by_attitude));
        at.put_rate(&mut h, layout, &yz(r_vb * -swing));
        h.put(
            layout,
            MOUNTING,
            &SMatrix::<f64, 2, 2>::new(by_pitch.y, by_yaw.y, by_pitch.z, by_yaw.z),
        );
        let by_axle = r_vb * rate_b.cross(&Vector3::x());
        h.put(layout, AXLE, &by_axle.yz());
        Linearized {
            residual: -u.yz(),
            h,
            r: self.r,
        }
    }
}

/// The velocity across alone, where the one upwards is not borne out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LateralModel(pub NonholonomicModel);

impl Measurement<1> for LateralModel {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<1> {
        let full = self.0.linearize(at, layout);
        Linearized {
            residual: full.residual.fixed_rows::<1>(0).into_owned(),
            h: full.h.leading(),
            r: full.r.fixed_view::<1, 1>(0, 0).into_owned(),
        }
    }
}

/// Between two uses, s: the errors (slip, suspension, road) last about as long, so that more would say nothing new.
const INTERVAL: f64 = 0.1;
/// How far the point about which a vehicle turns wanders about its axle, m.
const AXLE_SIGMA: f64 = 0.1;
/// Slip angle of tyres by lateral acceleration, rad per m/s²: an axle that carries 750 kg on tyres of 150 kN/rad.
const SLIP: f64 = 0.005;
/// Who is slower may be carried, pushed or turned on the spot, m/s.
const LEAST_SPEED: f64 = 0.5;
/// With a heading that is known no better, which way is across is too vague for a linear filter, rad.
const HEADING_SIGMA: f64 = 0.2;

/// When and how the constraint is used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NonholonomicAid {
    axle_b: Vector3<f64>,
    sigma: f64,
    lateral_only: bool,
    last: Option<Time>,
    gate: Gate,
}

impl NonholonomicAid {
    /// From the settings.
    pub fn new(config: &VehicleConfig) -> Self {
        NonholonomicAid {
            axle_b: Vector3::from(config.axle_b_m.unwrap_or_default()),
            sigma: config.nonholonomic_sigma_m_per_s,
            lateral_only: config.nonholonomic == Nonholonomic::Lateral,
            last: None,
            gate: Gate::strict(),
        }
    }

    /// The model at an estimate: less certain where tyres slip and where the point matters.
    pub fn model(&self, at: &Nominal) -> NonholonomicModel {
        let speed = at.nav.velocity_n.norm();
        // Slip angle times speed, where the lateral acceleration is speed times rate of turn.
        let lateral = (SLIP * speed * speed + AXLE_SIGMA) * at.rate_b.z.abs();
        let vertical = AXLE_SIGMA * at.rate_b.y.abs();
        let square = |x: f64| x * x;
        let white = square(self.sigma);
        NonholonomicModel {
            axle_b: self.axle_b,
            r: Matrix2::from_diagonal(&Vector2::new(
                white + square(lateral),
                white + square(vertical),
            )),
        }
    }

    /// Offer the constraint to the filter, if it is time.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe(&mut self, filter: &mut Eskf) -> Option<Result<Update>> {
        let now = filter.nominal().nav.time;
        // It can wait for the end of a step of the covariance, which it would else cut.
        if self.last.is_some_and(|last| now.since(last) < INTERVAL) || !filter.is_settled() {
            return None;
        }
        self.last = Some(now);
        if filter.nominal().nav.velocity_n.norm() < LEAST_SPEED {
            return None;
        }
        let heading = filter.covariance().block(ATTITUDE, ATTITUDE)?[(2, 2)];
        if heading > HEADING_SIGMA * HEADING_SIGMA {
            return None;
        }
        let model = self.model(filter.nominal());
        Some(if self.lateral_only {
            filter.update(&LateralModel(model), now, &mut self.gate)
        } else {
            filter.update(&model, now, &mut self.gate)
        })
    }
}
