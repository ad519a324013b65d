//! Messages: other programs' readings of real ones, there and back in both byte orders, and any bytes at all.

mod recordings;

use insnav_core::time::Time;
use insnav_log::cdr::{CdrWriter, Endian};
use insnav_log::ros2::*;
use insnav_log::{Log, LogError, ReadOptions};
use nalgebra::Vector3;
use proptest::prelude::*;
use recordings::recording;

/// Read by the Python packages mcap 1.6.0 and mcap-ros2-support 0.6.0 (the same files, `iter_decoded_messages`): file, topic,
/// index in order of log time, header stamp in ns, and for `Imu` rate and force, for `NavSatFix` latitude, longitude,
/// altitude and the covariance's diagonal, for `TwistWithCovarianceStamped` the linear velocity and its variances.
#[rustfmt::skip]
const READ_BY_PYTHON: &[(&str, &str, usize, i64, [f64; 6])] = &[
    ("rtkexp_drive_ros2_zstd.mcap", "/gps/fix", 0, 1752003258499000064, [40.0966268, -105.1474483, 1601.474, 9.801000000000002e-05, 9.801000000000002e-05, 0.0001]),
    ("rtkexp_drive_ros2_zstd.mcap", "/gps/fix", 1098, 1752003532999000064, [40.1015711, -105.1488592, 1577.31, 9.801000000000002e-05, 9.801000000000002e-05, 0.0001]),
    ("rtkexp_drive_ros2_zstd.mcap", "/gps/fix", 2196, 1752003807499000064, [40.0966402, -105.147472, 1601.468, 9.801000000000002e-05, 9.801000000000002e-05, 0.0001]),
    ("rtkexp_drive_ros2_zstd.mcap", "/gps/vel", 0, 1752003258499000064, [-0.002, 0.01, 0.009, 0.0034456900000000004, 0.0034456900000000004, 0.0034456900000000004]),
    ("rtkexp_drive_ros2_zstd.mcap", "/gps/vel", 1098, 1752003532999000064, [8.695, 0.239, 0.342, 0.0015132099999999999, 0.0015132099999999999, 0.0015132099999999999]),
    ("rtkexp_drive_ros2_zstd.mcap", "/gps/vel", 2196, 1752003807499000064, [-0.002, 0.002, 0.002, 0.00273529, 0.00273529, 0.00273529]),
    ("rtkexp_drive_ros2_zstd.mcap", "/imu/data", 0, 1752003261854000128, [0.0062657, -0.0165108, 0.0029322, -1.13757, -0.30401, 9.65955]),
    ("rtkexp_drive_ros2_zstd.mcap", "/imu/data", 27429, 1752003536225000192, [0.0073304, 0.0930784, -0.0086568, -0.32362, -0.15691, 9.39477]),
    ("rtkexp_drive_ros2_zstd.mcap", "/imu/data", 54857, 1752003810584999936, [-0.0050615, 0.0129154, 0.0038572, -0.98067, -0.21575, 9.95375]),
    ("comma2k19_ros2_lz4.mcap", "/imu/data", 0, 1600046408580034304, [-0.0183258, -0.0058136, -0.0037231, 1.07437, 0.12921, 9.54497]),
    ("comma2k19_ros2_lz4.mcap", "/imu/data", 3128, 1600046438580654080, [-0.0048828, -0.008255, -0.0012817, -0.73221, 0.00479, 9.77467]),
    ("comma2k19_ros2_lz4.mcap", "/imu/data", 6255, 1600046468571924224, [-0.0, -0.0119019, -0.0073853, -2.31865, -0.12921, 9.94696]),
    ("comma2k19_ros2_lz4.mcap", "/gps/fix", 0, 1600046408654974208, [37.7209977, -122.4723053, 33.37, 0.0, 0.0, 0.0]),
    ("comma2k19_ros2_lz4.mcap", "/gps/fix", 289, 1600046438842064128, [37.7257317, -122.4720522, 27.588, 0.0, 0.0, 0.0]),
    ("comma2k19_ros2_lz4.mcap", "/gps/fix", 578, 1600046468382484224, [37.7300808, -122.4718158, 40.094, 0.0, 0.0, 0.0]),
    ("comma2k19_ros2_lz4.mcap", "/gps/vel", 0, 1600046408654974208, [0.2915, 7.8176, 0.0, 0.0, 0.0, 0.0]),
    ("comma2k19_ros2_lz4.mcap", "/gps/vel", 289, 1600046438842064128, [0.3107, 16.5051, 0.0, 0.0, 0.0, 0.0]),
    ("comma2k19_ros2_lz4.mcap", "/gps/vel", 578, 1600046468382484224, [0.5746, 12.1995, 0.0, 0.0, 0.0, 0.0]),
];

fn numbers(schema: &str, data: &[u8]) -> (Time, [f64; 6]) {
    match schema {
        "sensor_msgs/msg/Imu" => {
            let m = Imu::decode(data).unwrap();
            let (w, f) = (m.angular_velocity, m.linear_acceleration);
            (m.header.stamp, [w.x, w.y, w.z, f.x, f.y, f.z])
        }
        "sensor_msgs/msg/NavSatFix" => {
            let m = NavSatFix::decode(data).unwrap();
            let p = m.position_covariance;
            (
                m.header.stamp,
                [
                    m.latitude_deg,
                    m.longitude_deg,
                    m.altitude_m,
                    p[0],
                    p[4],
                    p[8],
                ],
            )
        }
        _ => {
            let m = TwistWithCovarianceStamped::decode(data).unwrap();
            let (v, p) = (m.twist.linear, m.covariance);
            (m.header.stamp, [v.x, v.y, v.z, p[0], p[7], p[14]])
        }
    }
}

#[test]
fn real_messages_read_as_in_python() {
    let Some(folder) = recording("mcap_real") else {
        return;
    };
    for file in [
        "rtkexp_drive_ros2_zstd.mcap",
        "comma2k19_ros2_lz4.mcap",
        "comma2k19_ros2_none.mcap",
    ] {
        let log = Log::open(&folder.join(file), ReadOptions::default()).unwrap();
        let source = file.replace("_none", "_lz4");
        let mut checked = 0;
        for topic in log.topics() {
            let mut index = 0;
            log.each_message(topic, |message| -> Result<(), LogError> {
                let expected = READ_BY_PYTHON
                    .iter()
                    .find(|(f, t, i, ..)| *f == source && *t == topic.name && *i == index);
                if let Some((.., stamp, values)) = expected {
                    assert_eq!(
                        numbers(&topic.schema, message.data),
                        (Time(*stamp), *values),
                        "{file} {} {index}",
                        topic.name
                    );
                    checked += 1;
                }
                index += 1;
                Ok(())
            })
            .unwrap();
        }
        assert_eq!(checked, 9, "{file}");
    }
}

#[test]
fn real_messages_are_written_back_byte_for_byte() {
    let Some(path) = recording("mcap_real/rtkexp_drive_ros2_zstd.mcap") else {
        return;
    };
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    let mut writer = CdrWriter::new(Endian::Little);
    for topic in log.topics() {
        log.each_message(topic, |message| -> Result<(), LogError> {
            writer.clear();
            match topic.schema.as_str() {
                "sensor_msgs/msg/Imu" => Imu::decode(message.data).unwrap().write(&mut writer),
                "sensor_msgs/msg/NavSatFix" => {
                    NavSatFix::decode(message.data).unwrap().write(&mut writer)
                }
                _ => TwistWithCovarianceStamped::decode(message.data)
                    .unwrap()
                    .write(&mut writer),
            }
            // The Python writer pads the end; the fields are what counts.
            assert!(message.data.starts_with(writer.bytes()), "{}", topic.name);
            assert!(message.data.len() - writer.bytes().len() < 8);
            Ok(())
        })
        .unwrap();
    }
}

fn written<M: Encode>(message: &M, endian: Endian) -> Vec<u8> {
    let mut writer = CdrWriter::new(endian);
    message.write(&mut writer);
    writer.bytes().to_vec()
}

/// Encodes, decodes and compares, in both byte orders; every strict prefix must be refused, but for as many as there were
/// shorter versions of the message.
macro_rules! there_and_back {
    ($message:expr, $type:ident) => {
        there_and_back!($message, $type, 0);
    };
    ($message:expr, $type:ident, $versions:expr) => {
        for endian in [Endian::Little, Endian::Big] {
            let bytes = written(&$message, endian);
            prop_assert_eq!(&$type::decode(&bytes).unwrap(), &$message);
            let read: Vec<usize> = (0..bytes.len())
                .filter(|&length| $type::decode(&bytes[..length]).is_ok())
                .collect();
            prop_assert!(read.len() == $versions, "{:?} of {}", read, bytes.len());
        }
    };
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        -1e6..1e6f64,
        Just(0.0),
        Just(f64::INFINITY),
        Just(f64::MIN_POSITIVE)
    ]
}

fn vector() -> impl Strategy<Value = Vector3<f64>> {
    proptest::array::uniform3(number()).prop_map(Vector3::from)
}

fn array36() -> impl Strategy<Value = [f64; 36]> {
    proptest::collection::vec(number(), 36).prop_map(|v| v.try_into().unwrap())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn there_and_back_in_both_byte_orders(
        seconds in any::<i32>(), nanos in 0u32..1_000_000_000, frame in "[a-z_é]{0,9}", child in "[a-z]{0,5}",
        a in vector(), b in vector(), q in proptest::array::uniform4(number()), small in proptest::array::uniform9(number()),
        big in array36(), status in -1i8..3, service in any::<u16>(), kind in 0usize..4, dof in 1u8..4, verdict in 0u8..3,
    ) {
        let stamp = Time(i64::from(seconds) * 1_000_000_000 + i64::from(nanos));
        let header = Header { stamp, frame_id: &frame };
        there_and_back!(Imu {
            header, orientation: q, orientation_covariance: small, angular_velocity: a, angular_velocity_covariance: small,
            linear_acceleration: b, linear_acceleration_covariance: small,
        }, Imu);
        there_and_back!(NavSatFix {
            header, status, service, latitude_deg: a.x, longitude_deg: a.y, altitude_m: a.z, position_covariance: small,
            position_covariance_type: [
                CovarianceType::Unknown, CovarianceType::Approximated, CovarianceType::DiagonalKnown, CovarianceType::Known,
            ][kind],
        }, NavSatFix);
        let twist = Twist { linear: a, angular: b };
        there_and_back!(TwistStamped { header, twist }, TwistStamped);
        there_and_back!(TwistWithCovarianceStamped { header, twist, covariance: big }, TwistWithCovarianceStamped);
        let pose = Pose { position: a, orientation: q };
        there_and_back!(PoseStamped { header, pose }, PoseStamped);
        there_and_back!(Odometry {
            header, child_frame_id: &child, pose, pose_covariance: big, twist, twist_covariance: big,
        }, Odometry);
        there_and_back!(UpdateMessage {
            header, measurement: &child, dof, residual: a.into(), sigma: b.into(), nis: a.x, verdict,
        }, UpdateMessage);
        there_and_back!(State { header, latitude_deg: a.x, attitude_covariance_dd_rad2: a.y, standing_s: b.z, motion: 1, ..State::default() }, State, 1);

        let transforms = [TransformStamped { header, child_frame_id: &child, translation: a, rotation: q }; 2];
        for endian in [Endian::Little, Endian::Big] {
            let bytes = written(&TfMessage { transforms: &transforms }, endian);
            let back = Transforms::decode(&bytes).unwrap().0;
            prop_assert_eq!(back.as_slice(), transforms.as_slice());
            for length in 0..bytes.len() {
                prop_assert!(Transforms::decode(&bytes[..length]).is_err());
            }
        }
    }
}

proptest! {
    #[test]
    fn no_bytes_make_a_decoder_panic(mut bytes in proptest::collection::vec(any::<u8>(), 0..900), big in any::<bool>()) {
        if bytes.len() >= 4 {
            bytes[..4].copy_from_slice(&[0, u8::from(!big), 0, 0]);
        }
        // Short strings, or hardly any case would get past the header.
        for at in [12, 16] {
            if bytes.len() > at + 4 {
                bytes[at..at + 4].copy_from_slice(&[0, 0, 0, 0]);
            }
        }
        let _ = Imu::decode(&bytes);
        let _ = NavSatFix::decode(&bytes);
        let _ = TwistStamped::decode(&bytes);
        let _ = TwistWithCovarianceStamped::decode(&bytes);
        let _ = PoseStamped::decode(&bytes);
        let _ = Odometry::decode(&bytes);
        let _ = UpdateMessage::decode(&bytes);
        let _ = State::decode(&bytes);
        let _ = Transforms::decode(&bytes);
    }
}
