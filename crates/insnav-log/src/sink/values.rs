//! What goes into the messages: an epoch in the units of its names, a position with its covariance.

use crate::frames::ENU_NED;
use crate::ros2::{CovarianceType, Header, NavSatFix, State};
use insnav_core::earth::Geodetic;
use insnav_core::imu::STANDARD_GRAVITY;
use insnav_core::solution::{Epoch, Motion};
use insnav_core::stationary::Witness;
use nalgebra::{Matrix3, Vector3};

/// A position and its NED covariance as a message.
pub(crate) fn fix_message<'a>(at: &Geodetic, covariance_n: Option<&Matrix3<f64>>) -> NavSatFix<'a> {
    let enu = covariance_n.map(|p| ENU_NED * p * ENU_NED);
    NavSatFix {
        header: Header::default(),
        status: 0,
        service: 0,
        latitude_deg: at.latitude_deg(),
        longitude_deg: at.longitude_deg(),
        altitude_m: at.height,
        position_covariance: enu.map_or([0.0; 9], |p| std::array::from_fn(|k| p[(k / 3, k % 3)])),
        position_covariance_type: if enu.is_some() {
            CovarianceType::Known
        } else {
            CovarianceType::Unknown
        },
    }
}

/// An epoch in the units that the fields name.
pub(super) fn state_message<'a>(epoch: &Epoch, header: Header<'a>) -> State<'a> {
    const DEG_PER_HOUR: f64 = 180.0 / std::f64::consts::PI * 3600.0;
    const MG: f64 = 1e3 / STANDARD_GRAVITY;
    let nav = &epoch.nav;
    let euler = epoch.euler();
    let p = &epoch.covariance;
    let sigma = |i: usize| p[(i, i)].max(0.0).sqrt();
    let rate: Vector3<f64> = epoch.rate_b.map(f64::to_degrees);
    let gyro = epoch.imu_errors.gyro_bias * DEG_PER_HOUR;
    let accel = epoch.imu_errors.accel_bias * MG;
    State {
        header,
        latitude_deg: nav.position.latitude_deg(),
        longitude_deg: nav.position.longitude_deg(),
        height_m: nav.position.height,
        velocity_north_m_per_s: nav.velocity_n.x,
        velocity_east_m_per_s: nav.velocity_n.y,
        velocity_down_m_per_s: nav.velocity_n.z,
        q_nb_w: nav.q_nb.w,
        q_nb_x: nav.q_nb.i,
        q_nb_y: nav.q_nb.j,
        q_nb_z: nav.q_nb.k,
        roll_deg: euler.roll.to_degrees(),
        pitch_deg: euler.pitch.to_degrees(),
        heading_deg: euler.heading_deg(),
        rate_x_deg_per_s: rate.x,
        rate_y_deg_per_s: rate.y,
        rate_z_deg_per_s: rate.z,
        gyro_bias_x_deg_per_hour: gyro.x,
        gyro_bias_y_deg_per_hour: gyro.y,
        gyro_bias_z_deg_per_hour: gyro.z,
        accel_bias_x_mg: accel.x,
        accel_bias_y_mg: accel.y,
        accel_bias_z_mg: accel.z,
        sigma_north_m: sigma(0),
        sigma_east_m: sigma(1),
        sigma_down_m: sigma(2),
        sigma_velocity_north_m_per_s: sigma(3),
        sigma_velocity_east_m_per_s: sigma(4),
        sigma_velocity_down_m_per_s: sigma(5),
        sigma_rotation_north_deg: sigma(6).to_degrees(),
        sigma_rotation_east_deg: sigma(7).to_degrees(),
        sigma_heading_deg: sigma(8).to_degrees(),
        sigma_gyro_bias_x_deg_per_hour: sigma(9) * DEG_PER_HOUR,
        sigma_gyro_bias_y_deg_per_hour: sigma(10) * DEG_PER_HOUR,
        sigma_gyro_bias_z_deg_per_hour: sigma(11) * DEG_PER_HOUR,
        sigma_accel_bias_x_mg: sigma(12) * MG,
        sigma_accel_bias_y_mg: sigma(13) * MG,
        sigma_accel_bias_z_mg: sigma(14) * MG,
        position_covariance_nn_m2: p[(0, 0)],
        position_covariance_ne_m2: p[(0, 1)],
        position_covariance_nd_m2: p[(0, 2)],
        position_covariance_ee_m2: p[(1, 1)],
        position_covariance_ed_m2: p[(1, 2)],
        position_covariance_dd_m2: p[(2, 2)],
        velocity_covariance_nn_m2_per_s2: p[(3, 3)],
        velocity_covariance_ne_m2_per_s2: p[(3, 4)],
        velocity_covariance_nd_m2_per_s2: p[(3, 5)],
        velocity_covariance_ee_m2_per_s2: p[(4, 4)],
        velocity_covariance_ed_m2_per_s2: p[(4, 5)],
        velocity_covariance_dd_m2_per_s2: p[(5, 5)],
        attitude_covariance_nn_rad2: p[(6, 6)],
        attitude_covariance_ne_rad2: p[(6, 7)],
        attitude_covariance_nd_rad2: p[(6, 8)],
        attitude_covariance_ee_rad2: p[(7, 7)],
        attitude_covariance_ed_rad2: p[(7, 8)],
        attitude_covariance_dd_rad2: p[(8, 8)],
        standing_s: match epoch.motion {
            Motion::Moving => 0.0,
            Motion::Stationary { since } => nav.time.since(since),
        },
        motion: u8::from(epoch.motion != Motion::Moving),
        stop_witness: match epoch.evidence.witness {
            Witness::Nobody => 0,
            Witness::Detector => 1,
            Witness::Declared => 2,
            Witness::Interval => 3,
        },
        stop_specific_force_ratio: epoch.evidence.specific_force,
        stop_angular_rate_ratio: epoch.evidence.angular_rate,
        stop_mean_rate_ratio: epoch.evidence.mean_rate,
        stop_speed_ratio: epoch.evidence.speed,
    }
}
