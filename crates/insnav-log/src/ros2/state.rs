//! `insnav_msgs/msg/State`: one epoch of the solution as plain numbers, made to be plotted and read back.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};

/// Declares the struct, its wire order and its message definition from one list of fields, so that they cannot drift apart.
macro_rules! state_message {
    ($($(#[$doc:meta])* $field:ident,)*) => {
        /// One epoch of the solution: the point at the IMU, NED, body forward-right-down, units in the names.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct State<'a> {
            /// Stamp, and the map frame.
            pub header: Header<'a>,
            $($(#[$doc])* pub $field: f64,)*
            /// 0 moving, 1 stationary.
            pub motion: u8,
        }

        impl<'a> Decode<'a> for State<'a> {
            fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
                Ok(State { header: Header::of(from)?, $($field: from.f64(stringify!($field))?,)* motion: from.u8("motion")? })
            }
        }

        impl Encode for State<'_> {
            const SCHEMA: &'static str = "insnav_msgs/msg/State";

            fn write(&self, to: &mut CdrWriter) {
                self.header.write(to);
                $(to.f64(self.$field);)*
                to.u8(self.motion);
            }
        }

        /// Definition of the message in the ROS 2 interface language, without dependencies.
        pub(super) const DEFINITION: &str = concat!(
            "std_msgs/Header header\n",
            $("float64 ", stringify!($field), "\n",)*
            "uint8 MOVING=0\nuint8 STATIONARY=1\nuint8 motion\n",
        );
    };
}

state_message! {
    /// Latitude, degrees.
    latitude_deg,
    /// Longitude, degrees.
    longitude_deg,
    /// Height above the ellipsoid, m.
    height_m,
    /// Velocity north, m/s.
    velocity_north_m_per_s,
    /// Velocity east, m/s.
    velocity_east_m_per_s,
    /// Velocity down, m/s.
    velocity_down_m_per_s,
    /// Quaternion body to NED, real part.
    q_nb_w,
    /// Quaternion body to NED, x.
    q_nb_x,
    /// Quaternion body to NED, y.
    q_nb_y,
    /// Quaternion body to NED, z.
    q_nb_z,
    /// Roll, degrees.
    roll_deg,
    /// Pitch, degrees.
    pitch_deg,
    /// Heading clockwise from true north, degrees, 0 to 360.
    heading_deg,
    /// Turn rate about forward, degrees per second.
    rate_x_deg_per_s,
    /// Turn rate about right, degrees per second.
    rate_y_deg_per_s,
    /// Turn rate about down, degrees per second.
    rate_z_deg_per_s,
    /// Gyro bias about forward, degrees per hour.
    gyro_bias_x_deg_per_hour,
    /// Gyro bias about right, degrees per hour.
    gyro_bias_y_deg_per_hour,
    /// Gyro bias about down, degrees per hour.
    gyro_bias_z_deg_per_hour,
    /// Accelerometer bias forward, thousandths of standard gravity.
    accel_bias_x_mg,
    /// Accelerometer bias right, thousandths of standard gravity.
    accel_bias_y_mg,
    /// Accelerometer bias down, thousandths of standard gravity.
    accel_bias_z_mg,
    /// Standard deviation of the position north, m.
    sigma_north_m,
    /// Standard deviation of the position east, m.
    sigma_east_m,
    /// Standard deviation of the position down, m.
    sigma_down_m,
    /// Standard deviation of the velocity north, m/s.
    sigma_velocity_north_m_per_s,
    /// Standard deviation of the velocity east, m/s.
    sigma_velocity_east_m_per_s,
    /// Standard deviation of the velocity down, m/s.
    sigma_velocity_down_m_per_s,
    /// Standard deviation of the attitude as a small rotation about north, degrees.
    sigma_rotation_north_deg,
    /// Standard deviation of the attitude as a small rotation about east, degrees.
    sigma_rotation_east_deg,
    /// Standard deviation of the attitude as a small rotation about down (of the heading), degrees.
    sigma_heading_deg,
    /// Standard deviation of the gyro bias about forward, degrees per hour.
    sigma_gyro_bias_x_deg_per_hour,
    /// Standard deviation of the gyro bias about right, degrees per hour.
    sigma_gyro_bias_y_deg_per_hour,
    /// Standard deviation of the gyro bias about down, degrees per hour.
    sigma_gyro_bias_z_deg_per_hour,
    /// Standard deviation of the accelerometer bias forward, thousandths of standard gravity.
    sigma_accel_bias_x_mg,
    /// Standard deviation of the accelerometer bias right, thousandths of standard gravity.
    sigma_accel_bias_y_mg,
    /// Standard deviation of the accelerometer bias down, thousandths of standard gravity.
    sigma_accel_bias_z_mg,
    /// Covariance of the position, north with north, m².
    position_covariance_nn_m2,
    /// Covariance of the position, north with east, m².
    position_covariance_ne_m2,
    /// Covariance of the position, north with down, m².
    position_covariance_nd_m2,
    /// Covariance of the position, east with east, m².
    position_covariance_ee_m2,
    /// Covariance of the position, east with down, m².
    position_covariance_ed_m2,
    /// Covariance of the position, down with down, m².
    position_covariance_dd_m2,
    /// Covariance of the velocity, north with north, m²/s².
    velocity_covariance_nn_m2_per_s2,
    /// Covariance of the velocity, north with east, m²/s².
    velocity_covariance_ne_m2_per_s2,
    /// Covariance of the velocity, north with down, m²/s².
    velocity_covariance_nd_m2_per_s2,
    /// Covariance of the velocity, east with east, m²/s².
    velocity_covariance_ee_m2_per_s2,
    /// Covariance of the velocity, east with down, m²/s².
    velocity_covariance_ed_m2_per_s2,
    /// Covariance of the velocity, down with down, m²/s².
    velocity_covariance_dd_m2_per_s2,
    /// Covariance of the attitude as a small rotation, north with north, rad².
    attitude_covariance_nn_rad2,
    /// Covariance of the attitude as a small rotation, north with east, rad².
    attitude_covariance_ne_rad2,
    /// Covariance of the attitude as a small rotation, north with down, rad².
    attitude_covariance_nd_rad2,
    /// Covariance of the attitude as a small rotation, east with east, rad².
    attitude_covariance_ee_rad2,
    /// Covariance of the attitude as a small rotation, east with down, rad².
    attitude_covariance_ed_rad2,
    /// Covariance of the attitude as a small rotation, down with down, rad².
    attitude_covariance_dd_rad2,
    /// How long the body has been standing, s; 0 when it moves.
    standing_s,
}
