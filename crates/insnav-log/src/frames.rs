//! Turns an epoch (NED, forward-right-down) into what ROS expects (ENU map, forward-left-up), covariances included.

use insnav_core::attitude::skew;
use insnav_core::earth::LocalFrame;
use insnav_core::solution::Epoch;
use nalgebra::{Matrix3, Matrix6, SMatrix, UnitQuaternion, Vector3};

/// Forward-left-up and forward-right-down differ by half a turn about forward. Its own inverse.
pub(crate) const FLU_FRD: Matrix3<f64> =
    Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);
/// East-north-up and north-east-down differ by half a turn about their diagonal. Its own inverse.
pub(crate) const ENU_NED: Matrix3<f64> = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);

/// Pose in an east-north-up map and velocity in the body's forward-left-up axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MapState {
    /// East, north, up from the map's origin, m.
    pub(crate) position: Vector3<f64>,
    /// Body (forward-left-up) to map.
    pub(crate) orientation: UnitQuaternion<f64>,
    /// Covariance of position and of the rotation about the map's axes ([REP-103]: "rotation about fixed axes").
    pub(crate) pose_covariance: Matrix6<f64>,
    /// m/s, body.
    pub(crate) linear: Vector3<f64>,
    /// rad/s, body.
    pub(crate) angular: Vector3<f64>,
    /// Covariance of linear and angular velocity, body.
    pub(crate) twist_covariance: Matrix6<f64>,
}

impl MapState {
    /// The epoch in the map around the origin of `map`.
    pub(crate) fn new(epoch: &Epoch, map: &LocalFrame) -> Self {
        let nav = &epoch.nav;
        // From the axes of NED here to the axes of ENU at the origin.
        let to_map = ENU_NED * map.rotation_from(&nav.position);
        let c_nb = nav.q_nb.to_rotation_matrix().into_inner();
        let to_body = FLU_FRD * c_nb.transpose();
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(to_map * c_nb * FLU_FRD);

        let p = &epoch.covariance;
        let pose = two_blocks(p, 0, 6);
        let mut turn = Matrix6::zeros();
        turn.fixed_view_mut::<3, 3>(0, 0).copy_from(&to_map);
        turn.fixed_view_mut::<3, 3>(3, 3).copy_from(&to_map);

        // v_b = Cᵀ v, so dv_b = Cᵀ (dv + v × phi); the rate's error is that of the gyro bias, the white noise apart.
        let velocity_and_attitude = two_blocks(p, 3, 6);
        let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&to_body);
        jacobian
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(to_body * skew(&nav.velocity_n)));
        let linear_covariance = jacobian * velocity_and_attitude * jacobian.transpose();
        let gyro_bias: Matrix3<f64> = p.fixed_view::<3, 3>(9, 9).into_owned();
        let mut twist_covariance = Matrix6::zeros();
        twist_covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&linear_covariance);
        twist_covariance
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(FLU_FRD * gyro_bias * FLU_FRD));

        MapState {
            position: ENU_NED * map.to_ned(&nav.position),
            orientation: UnitQuaternion::from_rotation_matrix(&rotation),
            pose_covariance: turn * pose * turn.transpose(),
            linear: to_body * nav.velocity_n,
            angular: FLU_FRD * epoch.rate_b,
            twist_covariance,
        }
    }
}

/// The covariance of two groups of three states, at `a` and at `b`.
fn two_blocks(p: &SMatrix<f64, 15, 15>, a: usize, b: usize) -> Matrix6<f64> {
    Matrix6::from_fn(|i, j| {
        let at = |k: usize| if k < 3 { a + k } else { b + k - 3 };
        p[(at(i), at(j))]
    })
}

/// The epoch of the point `lever_b` (forward-right-down from the IMU, m) on the same rigid body.
///
/// p' = p + C l, v' = v + C (w × l); their Jacobians are those of the GNSS measurements with a lever arm. The Earth's rate
/// against the body (73 µrad/s) is left out of w: below 0.1 mm/s per metre.
pub(crate) fn moved_to(epoch: &Epoch, lever_b: &Vector3<f64>) -> Epoch {
    let c_nb = epoch.nav.q_nb.to_rotation_matrix().into_inner();
    let lever_n = c_nb * lever_b;
    let swing_n = c_nb * epoch.rate_b.cross(lever_b);
    let mut jacobian = SMatrix::<f64, 15, 15>::identity();
    jacobian
        .fixed_view_mut::<3, 3>(0, 6)
        .copy_from(&-skew(&lever_n));
    jacobian
        .fixed_view_mut::<3, 3>(3, 6)
        .copy_from(&-skew(&swing_n));
    jacobian
        .fixed_view_mut::<3, 3>(3, 9)
        .copy_from(&(c_nb * skew(lever_b)));
    let mut moved = *epoch;
    moved.nav.position = epoch.nav.position.offset(&lever_n);
    moved.nav.velocity_n += swing_n;
    moved.covariance = jacobian * epoch.covariance * jacobian.transpose();
    moved
}
