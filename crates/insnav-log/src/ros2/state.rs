//! `insnav_msgs/msg/State`: one epoch of the solution as plain numbers, made to be plotted and read back.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};
use insnav_core::time::Time;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

fn stamp_of<S: Serializer>(header: &Header<'_>, to: S) -> Result<S::Ok, S::Error> {
    header.stamp.serialize(to)
}

fn stamped<'a, 'de, D: Deserializer<'de>>(from: D) -> Result<Header<'a>, D::Error> {
    Ok(Header {
        stamp: Time::deserialize(from)?,
        frame_id: "",
    })
}

/// Declares the struct, its wire order and its message definition from one list of fields, so that they cannot drift apart.
macro_rules! state_message {
    ($($(#[$doc:meta])* $field:ident,)*) => {
        /// One epoch of the solution: the point at the IMU, NED, body forward-right-down, units in the names.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
        pub struct State<'a> {
            /// Stamp, and the map frame, which a saved state goes without.
            #[serde(serialize_with = "stamp_of", deserialize_with = "stamped")]
            pub header: Header<'a>,
            $($(#[$doc])* pub $field: f64,)*
            /// 0 moving, 1 stationary.
            pub motion: u8,
            /// Who says that the body stands: 0 nobody, 1 the detector, 2 somebody by a message, 3 an interval of the settings.
            pub stop_witness: u8,
            /// The detector's statistic of the specific force over its threshold: below 1, as the next three, it speaks for a
            /// stop. NaN where there is nothing to judge, and in files of versions that had none.
            pub stop_specific_force_ratio: f64,
            /// Of the angular rate's variation, likewise.
            pub stop_angular_rate_ratio: f64,
            /// Of the mean angular rate against the gyro bias, likewise.
            pub stop_mean_rate_ratio: f64,
            /// Of the speed by GNSS, wheels, or the filter itself, likewise.
            pub stop_speed_ratio: f64,
        }

        impl<'a> Decode<'a> for State<'a> {
            fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
                let state = State { header: Header::of(from)?, $($field: from.f64(stringify!($field))?,)* motion: from.u8("motion")?,
                    stop_witness: 0,
                    stop_specific_force_ratio: f64::NAN,
                    stop_angular_rate_ratio: f64::NAN,
                    stop_mean_rate_ratio: f64::NAN,
                    stop_speed_ratio: f64::NAN,
                };
                // Files of before there was a detector end here.
                let Ok(stop_witness) = from.u8("stop_witness") else {
                    return Ok(state);
                };
                Ok(State {
                    stop_witness,
                    stop_specific_force_ratio: from.f64("stop_specific_force_ratio")?,
                    stop_angular_rate_ratio: from.f64("stop_angular_rate_ratio")?,
                    stop_mean_rate_ratio: from.f64("stop_mean_rate_ratio")?,
                    stop_speed_ratio: from.f64("stop_speed_ratio")?,
                    ..state
                })
            }
        }

        impl Encode for State<'_> {
            const SCHEMA: &'static str = "insnav_msgs/msg/State";

            fn write(&self, to: &mut CdrWriter) {
                self.header.write(to);
                $(to.f64(self.$field);)*
                to.u8(self.motion);
                to.u8(self.stop_witness);
                to.f64(self.stop_specific_force_ratio);
                to.f64(self.stop_angular_rate_ratio);
                to.f64(self.stop_mean_rate_ratio);
                to.f64(self.stop_speed_ratio);
            }
        }

        /// Definition of the message in the ROS 2 interface language, without dependencies.
        pub(super) const DEFINITION: &str = concat!(
            "std_msgs/Header header\n",
            $("float64 ", stringify!($field), "\n",)*
            "uint8 MOVING=0\nuint8 STATIONARY=1\nuint8 motion\n",
            "uint8 NOBODY=0\nuint8 DETECTOR=1\nuint8 DECLARED=2\nuint8 INTERVAL=3\nuint8 stop_witness\n",
            "float64 stop_specific_force_ratio\nfloat64 stop_angular_rate_ratio\nfloat64 stop_mean_rate_ratio\n",
            "float64 stop_speed_ratio\n",
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::Endian;

    #[test]
    fn a_state_without_a_detector_is_read_as_one_that_does_not_know() {
        let state = State {
            roll_deg: 1.5,
            motion: 1,
            stop_witness: 2,
            stop_specific_force_ratio: 0.25,
            stop_angular_rate_ratio: 0.5,
            stop_mean_rate_ratio: 0.75,
            stop_speed_ratio: 0.125,
            ..State::default()
        };
        let mut to = CdrWriter::new(Endian::Little);
        state.write(&mut to);
        assert_eq!(State::decode(to.bytes()).unwrap(), state);
        // What was written before: all up to `motion`. The witness and the padding before four doubles follow it.
        let end = to.bytes().len() - 4 * 8;
        let before = (0..end)
            .rev()
            .find(|&n| to.bytes()[..n].last() == Some(&1))
            .unwrap();
        let old = State::decode(&to.bytes()[..before]).unwrap();
        assert_eq!((old.roll_deg, old.motion, old.stop_witness), (1.5, 1, 0));
        assert!(old.stop_specific_force_ratio.is_nan() && old.stop_speed_ratio.is_nan());
        assert!(
            State::decode(&to.bytes()[..before - 1]).is_err(),
            "cut in what always was"
        );
    }
}
