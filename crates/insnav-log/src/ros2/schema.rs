//! Message definitions in the ROS 2 interface language (`ros2msg`), complete with what they depend on.

use super::{state, update};

/// Name, definition without dependencies, and the names of what it uses.
type Definition = (&'static str, &'static str, &'static [&'static str]);

const DEFINITIONS: &[Definition] = &[
    (
        "builtin_interfaces/msg/Time",
        "int32 sec\nuint32 nanosec\n",
        &[],
    ),
    (
        "std_msgs/msg/Header",
        "builtin_interfaces/Time stamp\nstring frame_id\n",
        &["builtin_interfaces/msg/Time"],
    ),
    ("std_msgs/msg/Bool", "bool data\n", &[]),
    ("std_msgs/msg/Float32", "float32 data\n", &[]),
    ("std_msgs/msg/Float64", "float64 data\n", &[]),
    (
        "geometry_msgs/msg/Vector3",
        "float64 x\nfloat64 y\nfloat64 z\n",
        &[],
    ),
    (
        "sensor_msgs/msg/MagneticField",
        "std_msgs/Header header\ngeometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance\n",
        &["std_msgs/msg/Header", "geometry_msgs/msg/Vector3"],
    ),
    (
        "geometry_msgs/msg/Point",
        "float64 x\nfloat64 y\nfloat64 z\n",
        &[],
    ),
    (
        "geometry_msgs/msg/Quaternion",
        "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
        &[],
    ),
    (
        "geometry_msgs/msg/Twist",
        "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
        &["geometry_msgs/msg/Vector3"],
    ),
    (
        "geometry_msgs/msg/TwistWithCovariance",
        "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
        &["geometry_msgs/msg/Twist"],
    ),
    (
        "geometry_msgs/msg/TwistStamped",
        "std_msgs/Header header\ngeometry_msgs/Twist twist\n",
        &["std_msgs/msg/Header", "geometry_msgs/msg/Twist"],
    ),
    (
        "geometry_msgs/msg/TwistWithCovarianceStamped",
        "std_msgs/Header header\ngeometry_msgs/TwistWithCovariance twist\n",
        &[
            "std_msgs/msg/Header",
            "geometry_msgs/msg/TwistWithCovariance",
        ],
    ),
    (
        "geometry_msgs/msg/Pose",
        "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
        &["geometry_msgs/msg/Point", "geometry_msgs/msg/Quaternion"],
    ),
    (
        "geometry_msgs/msg/PoseWithCovariance",
        "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
        &["geometry_msgs/msg/Pose"],
    ),
    (
        "geometry_msgs/msg/PoseStamped",
        "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
        &["std_msgs/msg/Header", "geometry_msgs/msg/Pose"],
    ),
    (
        "geometry_msgs/msg/Transform",
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
        &["geometry_msgs/msg/Vector3", "geometry_msgs/msg/Quaternion"],
    ),
    (
        "geometry_msgs/msg/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
        &["std_msgs/msg/Header", "geometry_msgs/msg/Transform"],
    ),
    (
        "tf2_msgs/msg/TFMessage",
        "geometry_msgs/TransformStamped[] transforms\n",
        &["geometry_msgs/msg/TransformStamped"],
    ),
    (
        "nav_msgs/msg/Odometry",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n\
         geometry_msgs/TwistWithCovariance twist\n",
        &[
            "std_msgs/msg/Header",
            "geometry_msgs/msg/PoseWithCovariance",
            "geometry_msgs/msg/TwistWithCovariance",
        ],
    ),
    (
        "sensor_msgs/msg/Imu",
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
         geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
         geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
        &[
            "std_msgs/msg/Header",
            "geometry_msgs/msg/Quaternion",
            "geometry_msgs/msg/Vector3",
        ],
    ),
    (
        "sensor_msgs/msg/NavSatStatus",
        "int8 STATUS_NO_FIX=-1\nint8 STATUS_FIX=0\nint8 STATUS_SBAS_FIX=1\nint8 STATUS_GBAS_FIX=2\nint8 status\n\
         uint16 SERVICE_GPS=1\nuint16 SERVICE_GLONASS=2\nuint16 SERVICE_COMPASS=4\nuint16 SERVICE_GALILEO=8\n\
         uint16 service\n",
        &[],
    ),
    (
        "sensor_msgs/msg/NavSatFix",
        "std_msgs/Header header\nsensor_msgs/NavSatStatus status\nfloat64 latitude\nfloat64 longitude\n\
         float64 altitude\nfloat64[9] position_covariance\nuint8 COVARIANCE_TYPE_UNKNOWN=0\n\
         uint8 COVARIANCE_TYPE_APPROXIMATED=1\nuint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2\nuint8 COVARIANCE_TYPE_KNOWN=3\n\
         uint8 position_covariance_type\n",
        &["std_msgs/msg/Header", "sensor_msgs/msg/NavSatStatus"],
    ),
    (
        "diagnostic_msgs/msg/KeyValue",
        "string key\nstring value\n",
        &[],
    ),
    (
        "diagnostic_msgs/msg/DiagnosticStatus",
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring message\n\
         string hardware_id\ndiagnostic_msgs/KeyValue[] values\n",
        &["diagnostic_msgs/msg/KeyValue"],
    ),
    (
        "diagnostic_msgs/msg/DiagnosticArray",
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
        &[
            "std_msgs/msg/Header",
            "diagnostic_msgs/msg/DiagnosticStatus",
        ],
    ),
    (
        "insnav_msgs/msg/State",
        state::DEFINITION,
        &["std_msgs/msg/Header"],
    ),
    (
        "insnav_msgs/msg/Update",
        update::DEFINITION,
        &["std_msgs/msg/Header"],
    ),
];

/// The whole definition of a message type that is written here, as the MCAP registry wants it under `ros2msg`: the type
/// itself, then everything that it uses, each once, behind a line of 80 equals signs. `None` for any other type.
pub fn schema_text(name: &str) -> Option<String> {
    let mut order = vec![find(name)?];
    let mut next = 0;
    while let Some((_, _, uses)) = order.get(next) {
        for used in uses.iter().filter_map(|used| find(used)) {
            if !order.iter().any(|(known, ..)| *known == used.0) {
                order.push(used);
            }
        }
        next += 1;
    }
    let mut text = String::from(order[0].1);
    for (name, definition, _) in &order[1..] {
        text.push_str(&"=".repeat(80));
        text.push_str("\nMSG: ");
        text.push_str(&name.replace("/msg/", "/"));
        text.push('\n');
        text.push_str(definition);
    }
    Some(text)
}

fn find(name: &str) -> Option<Definition> {
    DEFINITIONS
        .iter()
        .find(|(known, ..)| *known == name)
        .copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_definition_names_all_that_it_uses() {
        for (name, definition, uses) in DEFINITIONS {
            let mut named: Vec<String> = definition
                .lines()
                .filter_map(|line| {
                    line.split_once('/')
                        .map(|(package, rest)| (package, rest.split([' ', '[']).next()))
                })
                .filter_map(|(package, kind)| Some(format!("{package}/msg/{}", kind?)))
                .collect();
            named.dedup();
            let mut listed: Vec<&str> = uses.to_vec();
            named.sort();
            named.dedup();
            listed.sort_unstable();
            assert_eq!(named, listed, "{name}");
        }
    }

    #[test]
    fn a_text_holds_each_dependency_once() {
        let text = schema_text("nav_msgs/msg/Odometry").unwrap();
        for used in [
            "std_msgs/Header",
            "builtin_interfaces/Time",
            "geometry_msgs/Vector3",
            "geometry_msgs/Point",
        ] {
            assert_eq!(text.matches(&format!("MSG: {used}\n")).count(), 1, "{used}");
        }
        assert_eq!(schema_text("std_msgs/msg/String"), None);
    }
}
