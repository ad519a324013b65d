//! Which messages are understood, by whichever name a log has for them.

use crate::wire::Fields;
use std::fmt;

/// A message type that is understood.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MessageKind {
    /// `sensor_msgs/msg/Imu`
    Imu,
    /// `sensor_msgs/msg/NavSatFix`
    NavSatFix,
    /// `geometry_msgs/msg/TwistStamped`
    TwistStamped,
    /// `geometry_msgs/msg/TwistWithCovarianceStamped`
    TwistWithCovarianceStamped,
    /// `nav_msgs/msg/Odometry`
    Odometry,
    /// `tf2_msgs/msg/TFMessage`
    Transforms,
    /// `foxglove.LocationFix`
    LocationFix,
    /// `gps_msgs/msg/GPSFix`, in ROS 1 `gps_common/GPSFix`
    GpsFix,
    /// `ublox_msgs/msg/NavPVT`
    NavPvt,
    /// `ublox_msgs/msg/NavRELPOSNED9`
    NavRelPosNed,
    /// `px4_msgs/msg/SensorCombined`
    SensorCombined,
    /// `px4_msgs/msg/SensorGps`, before 2022 `VehicleGpsPosition`
    SensorGps,
    /// `sensor_msgs/msg/MagneticField`
    MagneticField,
    /// `px4_msgs/msg/VehicleMagnetometer`
    VehicleMagnetometer,
    /// `std_msgs/msg/Bool`
    Bool,
    /// `std_msgs/msg/Float32`
    Float32,
    /// `std_msgs/msg/Float64`
    Float64,
    /// Any other message that begins with a `std_msgs` header.
    Stamped,
    /// A message that the user's map explains.
    Mapped,
}

/// Every kind with the packages and names that it goes by, and fields that no other kind has all of, if there are such.
type Names = (
    MessageKind,
    &'static [&'static str],
    &'static [&'static str],
    &'static [&'static str],
);

const NAMES: &[Names] = &[
    (
        MessageKind::Imu,
        &["sensor_msgs"],
        &["Imu"],
        &["angular_velocity", "linear_acceleration"],
    ),
    (
        MessageKind::GpsFix,
        &["gps_msgs", "gps_common"],
        &["GPSFix"],
        &["latitude", "longitude", "track", "climb"],
    ),
    (
        MessageKind::LocationFix,
        &["foxglove", "foxglove_msgs"],
        &["LocationFix"],
        &["latitude", "longitude", "timestamp", "altitude"],
    ),
    (
        MessageKind::NavSatFix,
        &["sensor_msgs"],
        &["NavSatFix"],
        &["latitude", "longitude", "altitude", "header"],
    ),
    (
        MessageKind::NavPvt,
        &["ublox_msgs"],
        &["NavPVT", "NavPVT7"],
        &["lon", "lat", "hAcc", "velN", "sAcc"],
    ),
    (
        MessageKind::NavRelPosNed,
        &["ublox_msgs"],
        &["NavRELPOSNED", "NavRELPOSNED9"],
        &["relPosN", "relPosE", "flags"],
    ),
    (
        MessageKind::SensorCombined,
        &["px4_msgs"],
        &["SensorCombined"],
        &["gyro_rad", "accelerometer_m_s2"],
    ),
    (
        MessageKind::SensorGps,
        &["px4_msgs"],
        &["SensorGps", "VehicleGpsPosition"],
        &["fix_type", "vel_n_m_s", "eph"],
    ),
    (
        MessageKind::TwistWithCovarianceStamped,
        &["geometry_msgs"],
        &["TwistWithCovarianceStamped"],
        &["header", "twist.twist.linear"],
    ),
    (
        MessageKind::TwistStamped,
        &["geometry_msgs"],
        &["TwistStamped"],
        &["header", "twist.linear"],
    ),
    (
        MessageKind::Odometry,
        &["nav_msgs"],
        &["Odometry"],
        &["header", "pose.pose", "twist.twist", "child_frame_id"],
    ),
    (
        MessageKind::Transforms,
        &["tf2_msgs", "tf"],
        &["TFMessage", "tfMessage"],
        &["transforms"],
    ),
    (
        MessageKind::MagneticField,
        &["sensor_msgs"],
        &["MagneticField"],
        &["header", "magnetic_field"],
    ),
    (
        MessageKind::VehicleMagnetometer,
        &["px4_msgs"],
        &["VehicleMagnetometer"],
        &["timestamp", "magnetometer_ga"],
    ),
    // One field `data` says nothing of a kind.
    (MessageKind::Bool, &["std_msgs"], &["Bool"], &[]),
    (MessageKind::Float32, &["std_msgs"], &["Float32"], &[]),
    (MessageKind::Float64, &["std_msgs"], &["Float64"], &[]),
];

impl MessageKind {
    /// The kind of a schema's name, in any of the spellings in use: `sensor_msgs/msg/Imu`, `sensor_msgs/Imu`,
    /// `sensor_msgs::msg::dds_::Imu_`, `foxglove.LocationFix`.
    pub fn of_schema(name: &str) -> Option<Self> {
        let mut parts = name.split(['/', ':', '.']).filter(|part| !part.is_empty());
        let package = parts.next()?;
        let kind = parts.next_back()?.trim_end_matches('_');
        NAMES
            .iter()
            .find(|(_, packages, names, _)| packages.contains(&package) && names.contains(&kind))
            .map(|(kind, ..)| *kind)
    }

    /// The kind of a message by its fields: for encodings that carry names, under whatever type they were recorded.
    pub(crate) fn of_fields(fields: &Fields<'_>) -> Option<Self> {
        let has_all = |paths: &[&str]| {
            !paths.is_empty() && paths.iter().all(|path| fields.kind_at(path).is_some())
        };
        // An odometry has a twist too, and comes first.
        let odometry = NAMES
            .iter()
            .filter(|(kind, ..)| *kind == MessageKind::Odometry);
        odometry
            .chain(NAMES)
            .find(|(.., paths)| has_all(paths))
            .map(|(kind, ..)| *kind)
    }

    /// Whether its fields come in an order that all versions have kept, so that no definition is needed to read it.
    pub(crate) fn is_fixed(self) -> bool {
        matches!(
            self,
            MessageKind::Imu
                | MessageKind::NavSatFix
                | MessageKind::TwistStamped
                | MessageKind::TwistWithCovarianceStamped
                | MessageKind::Odometry
                | MessageKind::Transforms
                | MessageKind::MagneticField
                | MessageKind::Bool
                | MessageKind::Float32
                | MessageKind::Float64
                | MessageKind::Stamped
        )
    }

    /// Common messages go before those of one device: drivers that publish both make the one from the other.
    pub(crate) fn rank(self) -> u8 {
        match self {
            MessageKind::Mapped => 0,
            kind if kind.is_fixed() => 1,
            MessageKind::LocationFix => 2,
            _ => 3,
        }
    }
}

impl fmt::Display for MessageKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            MessageKind::Stamped => f.write_str("message with a header"),
            MessageKind::Mapped => f.write_str("message with a map"),
            MessageKind::LocationFix => f.write_str("foxglove.LocationFix"),
            kind => match NAMES.iter().find(|(other, ..)| other == kind) {
                Some((_, packages, names, _)) => write!(f, "{}/msg/{}", packages[0], names[0]),
                None => Ok(()),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{Document, read_json};

    #[test]
    fn every_spelling_of_a_type() {
        for name in [
            "sensor_msgs/msg/Imu",
            "sensor_msgs/Imu",
            "sensor_msgs::msg::dds_::Imu_",
            "sensor_msgs.msg.Imu",
        ] {
            assert_eq!(
                MessageKind::of_schema(name),
                Some(MessageKind::Imu),
                "{name}"
            );
        }
        assert_eq!(
            MessageKind::of_schema("gps_common/GPSFix"),
            Some(MessageKind::GpsFix)
        );
        assert_eq!(
            MessageKind::of_schema("foxglove.LocationFix"),
            Some(MessageKind::LocationFix)
        );
        for other in ["", "Imu", "other_msgs/msg/Imu", "sensor_msgs/msg/Image"] {
            assert_eq!(MessageKind::of_schema(other), None, "{other}");
        }
    }

    #[test]
    fn fields_tell_the_kind() {
        let mut document = Document::default();
        for (text, kind) in [
            (
                r#"{"header": {}, "angular_velocity": {}, "linear_acceleration": {}}"#,
                Some(MessageKind::Imu),
            ),
            (
                r#"{"timestamp": {}, "latitude": 1, "longitude": 2, "altitude": 3}"#,
                Some(MessageKind::LocationFix),
            ),
            (
                r#"{"header": {}, "latitude": 1, "longitude": 2, "altitude": 3}"#,
                Some(MessageKind::NavSatFix),
            ),
            (
                r#"{"header": {}, "latitude": 1, "longitude": 2, "altitude": 3, "track": 4, "climb": 5}"#,
                Some(MessageKind::GpsFix),
            ),
            (
                r#"{"header": {}, "twist": {"linear": {}}}"#,
                Some(MessageKind::TwistStamped),
            ),
            (
                r#"{"header": {}, "twist": {"twist": {"linear": {}}}}"#,
                Some(MessageKind::TwistWithCovarianceStamped),
            ),
            (
                r#"{"header": {}, "child_frame_id": "", "pose": {"pose": 1}, "twist": {"twist": {"linear": {}}}}"#,
                Some(MessageKind::Odometry),
            ),
            (r#"{"speed": 3}"#, None),
            (r#"{"data": true}"#, None),
        ] {
            let fields = read_json(&mut document, text.as_bytes()).unwrap();
            assert_eq!(MessageKind::of_fields(&fields), kind, "{text}");
        }
    }
}
