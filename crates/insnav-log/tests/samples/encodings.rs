//! One recording in every encoding.

use crate::recorder::{Recorder, T0, samples, times};
use crate::recordings::recording;
use insnav_core::sample::Sample;
use insnav_core::solution::{Epoch, Sink};
use insnav_log::cdr::Endian;
use insnav_log::ros2::*;
use insnav_log::{Log, LogError, Plan, ReadOptions, RunOptions, SolutionSink};
use std::collections::BTreeMap;
use std::path::Path;

#[test]
fn big_endian_messages_read_the_same() {
    let make = |endian| {
        let mut recorder = Recorder {
            endian,
            ..Recorder::new()
        };
        recorder.imu("/imu", T0, T0);
        recorder.fix(T0, |_| ());
        samples(&recorder.open(ReadOptions::default()).unwrap())
    };
    assert_eq!(make(Endian::Big), make(Endian::Little));
}

#[test]
fn definitions_in_idl_serve_as_well() {
    let mut recorder = Recorder::new();
    let idl = b"================\nIDL: sensor_msgs/msg/Imu\nmodule sensor_msgs { module msg { struct Imu {}; }; };";
    let schema = recorder
        .writer
        .add_schema("sensor_msgs/msg/Imu", "ros2idl", idl)
        .unwrap();
    let id = recorder
        .writer
        .add_channel(schema, "/imu", "cdr", &BTreeMap::new())
        .unwrap();
    recorder.channels.insert("/imu".into(), id);
    recorder.imu("/imu", T0 + 5, T0);
    let log = recorder.open(ReadOptions::default()).unwrap();
    assert_eq!(times(&log), [T0]);
    let offset = log.statistics().unwrap()[0].header_minus_log_s.unwrap();
    assert_eq!((offset.mean, offset.min, offset.max), (-5e-9, -5e-9, -5e-9));
}

/// Every number of a solution, to the bit.
#[derive(Default)]
struct Bits(Vec<u64>);

impl Sink for Bits {
    fn epoch(&mut self, epoch: &Epoch) {
        let nav = &epoch.nav;
        let position = [
            nav.position.latitude,
            nav.position.longitude,
            nav.position.height,
        ];
        let all = position
            .iter()
            .chain(nav.velocity_n.iter())
            .chain(nav.q_nb.coords.iter())
            .chain(epoch.covariance.iter());
        self.0.push(nav.time.0 as u64);
        self.0.extend(all.map(|x| x.to_bits()));
    }
}

impl SolutionSink for Bits {}

fn solution(log: &Log) -> Vec<u64> {
    let options = RunOptions {
        ignore_clocks: true,
        ..RunOptions::default()
    };
    let plan = Plan::make(log, &Default::default(), &options).unwrap();
    let mut bits = Bits::default();
    plan.execute(log, &mut bits).unwrap();
    bits.0
}

/// As Debug writes them: the shortest text that comes back to the same double, so that equal texts are equal bits.
fn text(samples: &[Sample]) -> Vec<String> {
    samples.iter().map(|sample| format!("{sample:?}")).collect()
}

/// Messages of ROS 1: packed, a sequence number before each stamp, strings without NUL.
struct Packed(Vec<u8>);

impl Packed {
    fn header(number: u32, header: &Header<'_>) -> Self {
        let mut packed = Packed(number.to_le_bytes().to_vec());
        let (seconds, nanos) = (
            header.stamp.0 / 1_000_000_000,
            header.stamp.0 % 1_000_000_000,
        );
        packed.0.extend((seconds as u32).to_le_bytes());
        packed.0.extend((nanos as u32).to_le_bytes());
        packed
            .0
            .extend((header.frame_id.len() as u32).to_le_bytes());
        packed.0.extend(header.frame_id.as_bytes());
        packed
    }

    fn numbers(mut self, numbers: &[f64]) -> Self {
        self.0.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        self
    }
}

/// The messages of a CDR log in the encoding of ROS 1, in chunks compressed with zstd.
fn as_ros1(log: &Log) -> Vec<u8> {
    let mut writer = mcap::WriteOptions::new()
        .profile("ros1")
        .compression(Some(mcap::Compression::Zstd))
        .create(std::io::Cursor::new(Vec::new()))
        .unwrap();
    for topic in log.topics() {
        let name = topic.schema.replace("/msg/", "/");
        let schema = writer
            .add_schema(&name, "ros1msg", b"Header header\n")
            .unwrap();
        let channel = writer
            .add_channel(schema, &topic.name, "ros1", &BTreeMap::new())
            .unwrap();
        let mut number = 0;
        log.each_message(topic, |message| -> Result<(), LogError> {
            number += 1;
            let packed = match topic.schema.as_str() {
                "sensor_msgs/msg/Imu" => {
                    let m = Imu::decode(message.data).unwrap();
                    Packed::header(number, &m.header)
                        .numbers(&m.orientation)
                        .numbers(&m.orientation_covariance)
                        .numbers(m.angular_velocity.as_slice())
                        .numbers(&m.angular_velocity_covariance)
                        .numbers(m.linear_acceleration.as_slice())
                        .numbers(&m.linear_acceleration_covariance)
                }
                "sensor_msgs/msg/NavSatFix" => {
                    let m = NavSatFix::decode(message.data).unwrap();
                    let mut packed = Packed::header(number, &m.header);
                    packed.0.extend(m.status.to_le_bytes());
                    packed.0.extend(m.service.to_le_bytes());
                    let mut packed = packed
                        .numbers(&[m.latitude_deg, m.longitude_deg, m.altitude_m])
                        .numbers(&m.position_covariance);
                    packed.0.push(m.position_covariance_type as u8);
                    packed
                }
                _ => {
                    let m = TwistWithCovarianceStamped::decode(message.data).unwrap();
                    Packed::header(number, &m.header)
                        .numbers(m.twist.linear.as_slice())
                        .numbers(m.twist.angular.as_slice())
                        .numbers(&m.covariance)
                }
            };
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence: number,
                log_time: message.log_time.0 as u64,
                publish_time: message.publish_time.0 as u64,
            };
            writer.write_to_known_channel(&header, &packed.0).unwrap();
            Ok(())
        })
        .unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn one_recording_in_five_encodings_is_one_solution_to_the_last_bit() {
    let Some(folder) = recording("mcap_real") else {
        return;
    };
    let open = |name: &str| Log::open(&folder.join(name), ReadOptions::default()).unwrap();
    let lz4 = open("comma2k19_ros2_lz4.mcap");
    let ros1_zstd = Log::from_bytes(Path::new("x"), as_ros1(&lz4), ReadOptions::default()).unwrap();
    let expected = (text(&samples(&lz4)), solution(&lz4));
    assert!(
        expected.1.len() > 6000 * 236,
        "{} numbers",
        expected.1.len()
    );
    for (name, log) in [
        ("none", open("comma2k19_ros2_none.mcap")),
        ("json", open("comma2k19_json_zstd.mcap")),
        ("ros1", ros1_zstd),
    ] {
        assert!(text(&samples(&log)) == expected.0, "{name}: samples");
        assert!(solution(&log) == expected.1, "{name}: solution");
    }
    // zstd with CDR: the maker wrote another recording so. Messages of one instant are in another order in the copy, which
    // has one topic after the other.
    let zstd = open("rtkexp_drive_ros2_zstd.mcap");
    let ros1 = Log::from_bytes(Path::new("x"), as_ros1(&zstd), ReadOptions::default()).unwrap();
    let sorted = |log: &Log| {
        let mut text = text(&samples(log));
        text.sort_unstable();
        text
    };
    assert!(sorted(&zstd) == sorted(&ros1), "rtkexp");
}
