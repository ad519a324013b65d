//! Which topic plays which part.

use crate::error::LogError;
use crate::message::MessageKind;
use insnav_core::time::Time;
use std::fmt;
use std::path::Path;

/// The part that a topic plays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Angular rate and specific force.
    Imu,
    /// GNSS position.
    GnssPosition,
    /// GNSS velocity.
    GnssVelocity,
    /// Speed over wheels.
    WheelOdometry,
    /// Static transforms between frames: lever arm and mounting.
    Tf,
    /// What declares that the vehicle stands: a Bool, or a speed of its wheels. Taken only when it is named.
    Standing,
    /// Heading of the body's forward axis, from two antennas. Taken only when it is named: where the antennas are, the
    /// message does not say.
    Heading,
    /// Magnetic field, for the heading of a start. Where there are several and none is named, none is taken.
    Magnetometer,
}

impl Role {
    /// All of them.
    pub const ALL: [Role; 8] = [
        Role::Imu,
        Role::GnssPosition,
        Role::GnssVelocity,
        Role::WheelOdometry,
        Role::Tf,
        Role::Standing,
        Role::Heading,
        Role::Magnetometer,
    ];

    /// Name in `--topic NAME=/topic`.
    pub fn key(self) -> &'static str {
        match self {
            Role::Imu => "imu",
            Role::GnssPosition => "gnss",
            Role::GnssVelocity => "gnss-velocity",
            Role::WheelOdometry => "odometry",
            Role::Tf => "tf",
            Role::Standing => "standing",
            Role::Heading => "heading",
            Role::Magnetometer => "magnetometer",
        }
    }

    /// The role of a name in `--topic NAME=/topic`.
    pub fn from_key(key: &str) -> Option<Self> {
        Role::ALL.into_iter().find(|role| role.key() == key)
    }

    /// Messages that can serve.
    pub fn kinds(self) -> &'static [MessageKind] {
        match self {
            Role::Imu => &[MessageKind::Imu, MessageKind::SensorCombined],
            Role::GnssPosition => &[
                MessageKind::NavSatFix,
                MessageKind::LocationFix,
                MessageKind::GpsFix,
                MessageKind::NavPvt,
                MessageKind::SensorGps,
            ],
            Role::GnssVelocity => &[
                MessageKind::TwistWithCovarianceStamped,
                MessageKind::TwistStamped,
                MessageKind::GpsFix,
                MessageKind::NavPvt,
                MessageKind::SensorGps,
            ],
            Role::WheelOdometry => &[MessageKind::Odometry],
            Role::Tf => &[MessageKind::Transforms],
            Role::Standing => &[
                MessageKind::Bool,
                MessageKind::Float32,
                MessageKind::Float64,
                MessageKind::Odometry,
                MessageKind::TwistStamped,
            ],
            Role::Heading => &[MessageKind::NavRelPosNed],
            Role::Magnetometer => &[MessageKind::MagneticField, MessageKind::VehicleMagnetometer],
        }
    }

    /// Whether a topic may be taken for this role without having been named.
    ///
    /// Our own output is no input, a command is no measurement, and `/tf` in motion is no lever arm.
    pub(crate) fn accepts_unnamed(self, topic: &str) -> bool {
        !topic.starts_with("/insnav/")
            && match self {
                Role::GnssVelocity => !topic.contains("cmd"),
                Role::Tf => topic.ends_with("tf_static"),
                Role::Standing | Role::Heading => false,
                _ => true,
            }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Role::Imu => "IMU",
            Role::GnssPosition => "GNSS position",
            Role::GnssVelocity => "GNSS velocity",
            Role::WheelOdometry => "wheel odometry",
            Role::Tf => "static transform",
            Role::Standing => "declaration of standing",
            Role::Heading => "heading",
            Role::Magnetometer => "magnetic field",
        })
    }
}

/// One topic of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct TopicInfo {
    /// Name.
    pub name: String,
    /// Message type, such as `sensor_msgs/msg/Imu`; empty when the log has none.
    pub schema: String,
    /// How the type is described, such as `ros2msg`.
    pub schema_encoding: String,
    /// How messages are encoded, such as `cdr`.
    pub encoding: String,
    /// What its messages are, if they are understood.
    pub kind: Option<MessageKind>,
    /// Why they cannot be read although they are understood, if so.
    pub problem: Option<String>,
    /// The parts it can play by the user's map.
    pub mapped: Vec<Role>,
    /// Number of messages.
    pub count: u64,
    /// Messages per second of log time over the whole log; `None` with fewer than two messages.
    pub rate_hz: Option<f64>,
    /// Identifiers of the channels that carry this topic.
    pub(crate) channels: Vec<u16>,
}

impl TopicInfo {
    /// Whether its messages can be decoded for a role.
    pub fn serves(&self, role: Role) -> bool {
        self.problem.is_none()
            && self.kind.is_some_and(|kind| match kind {
                MessageKind::Mapped => self.mapped.contains(&role),
                kind => role.kinds().contains(&kind),
            })
    }
}

impl fmt::Display for TopicInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} ({} in {}, {} messages",
            self.name, self.schema, self.encoding, self.count
        )?;
        if let Some(rate) = self.rate_hz {
            write!(f, ", {rate:.1} Hz")?;
        }
        if let Some(problem) = &self.problem {
            write!(f, "; {problem}")?;
        }
        f.write_str(")")
    }
}

/// Stands for a topic where none is wanted.
pub(crate) const NO_TOPIC: &str = "none";

/// What was found for one role.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Choice {
    /// No topic can serve, or the user wants none.
    #[default]
    None,
    /// This one (index into the topics of the log).
    Topic(usize),
    /// Several can, and the user has to choose.
    Ambiguous(Vec<usize>),
}

/// Which topic plays which part in this log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    choices: [Choice; Role::ALL.len()],
}

impl Selection {
    /// What was found for a role.
    pub fn choice(&self, role: Role) -> &Choice {
        &self.choices[role as usize]
    }

    /// The topic (index into the topics of the log) of a role, when there is exactly one.
    pub fn topic(&self, role: Role) -> Option<usize> {
        match self.choice(role) {
            Choice::Topic(index) => Some(*index),
            _ => None,
        }
    }

    /// Find a topic for every role: the one the user named (`none` for none), else the only one that can serve.
    pub(crate) fn find(
        topics: &[TopicInfo],
        named: &[(Role, String)],
        path: &Path,
    ) -> Result<Self, LogError> {
        let mut selection = Selection::default();
        for role in Role::ALL {
            selection.choices[role as usize] = match named.iter().rev().find(|(r, _)| *r == role) {
                Some((_, name)) if name == NO_TOPIC => Choice::None,
                Some((_, name)) => Choice::Topic(find_named(topics, role, name, path)?),
                None => choose(topics, role),
            };
        }
        Ok(selection)
    }
}

fn find_named(
    topics: &[TopicInfo],
    role: Role,
    name: &str,
    path: &Path,
) -> Result<usize, LogError> {
    let Some(index) = topics.iter().position(|topic| topic.name == name) else {
        return Err(LogError::UnknownTopic {
            path: path.into(),
            role,
            topic: name.into(),
            topics: topics.iter().map(TopicInfo::to_string).collect(),
        });
    };
    let topic = &topics[index];
    if !topic.serves(role) {
        return Err(LogError::WrongType {
            path: path.into(),
            role,
            topic: name.into(),
            schema: topic.schema.clone(),
            encoding: topic.encoding.clone(),
            problem: topic.problem.as_deref().map(Into::into),
        });
    }
    Ok(index)
}

fn choose(topics: &[TopicInfo], role: Role) -> Choice {
    let mut candidates: Vec<usize> = (0..topics.len())
        .filter(|&i| {
            let mapped = topics[i].kind == Some(MessageKind::Mapped);
            topics[i].serves(role)
                && (mapped || role.accepts_unnamed(&topics[i].name))
                && topics[i].count > 0
        })
        .collect();
    // A driver's own message is taken only where there is none of the common ones, which it is often published beside.
    let rank = |i: &usize| topics[*i].kind.map_or(u8::MAX, MessageKind::rank);
    let best = candidates.iter().map(rank).min();
    candidates.retain(|i| Some(rank(i)) == best);
    match candidates.len() {
        0 => Choice::None,
        1 => Choice::Topic(candidates.remove(0)),
        _ => Choice::Ambiguous(candidates),
    }
}

/// Mean rate from a count and the span of log times.
pub(crate) fn mean_rate(count: u64, first: Time, last: Time) -> Option<f64> {
    let span = last.since(first);
    (count > 1 && span > 0.0).then(|| (count - 1) as f64 / span)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topic(name: &str, schema: &str) -> TopicInfo {
        TopicInfo {
            name: name.into(),
            schema: schema.into(),
            schema_encoding: "ros2msg".into(),
            encoding: "cdr".into(),
            kind: MessageKind::of_schema(schema),
            problem: None,
            mapped: Vec::new(),
            count: 10,
            rate_hz: None,
            channels: vec![1],
        }
    }

    fn find(topics: &[TopicInfo], named: &[(Role, &str)]) -> Result<Selection, LogError> {
        let named: Vec<_> = named
            .iter()
            .map(|(role, name)| (*role, (*name).to_owned()))
            .collect();
        Selection::find(topics, &named, Path::new("x.mcap"))
    }

    #[test]
    fn the_only_candidate_is_taken_and_two_are_not() {
        let topics = [
            topic("/imu/a", "sensor_msgs/msg/Imu"),
            topic("/imu/b", "sensor_msgs/msg/Imu"),
            topic("/fix", "sensor_msgs/msg/NavSatFix"),
        ];
        let selection = find(&topics, &[]).unwrap();
        assert_eq!(*selection.choice(Role::Imu), Choice::Ambiguous(vec![0, 1]));
        assert_eq!(selection.topic(Role::GnssPosition), Some(2));
        assert_eq!(*selection.choice(Role::GnssVelocity), Choice::None);
        assert_eq!(
            find(&topics, &[(Role::Imu, "/imu/b")])
                .unwrap()
                .topic(Role::Imu),
            Some(1)
        );
        assert_eq!(
            find(&topics, &[(Role::GnssPosition, "none")])
                .unwrap()
                .topic(Role::GnssPosition),
            None
        );
    }

    #[test]
    fn commands_and_own_output_are_no_input() {
        let topics = [
            topic("/cmd_vel", "geometry_msgs/msg/TwistStamped"),
            topic("/gps/vel", "geometry_msgs/msg/TwistStamped"),
            topic("/insnav/fix", "sensor_msgs/msg/NavSatFix"),
            topic("/tf", "tf2_msgs/msg/TFMessage"),
        ];
        let selection = find(&topics, &[]).unwrap();
        assert_eq!(selection.topic(Role::GnssVelocity), Some(1));
        assert_eq!(selection.topic(Role::GnssPosition), None);
        assert_eq!(selection.topic(Role::Tf), None);
    }

    #[test]
    fn standing_is_declared_by_what_is_named_alone() {
        let topics = [
            topic("/brake", "std_msgs/msg/Bool"),
            topic("/wheels", "nav_msgs/msg/Odometry"),
            topic("/fix", "sensor_msgs/msg/NavSatFix"),
        ];
        let selection = find(&topics, &[]).unwrap();
        assert_eq!(selection.topic(Role::Standing), None);
        for (name, index) in [("/brake", 0), ("/wheels", 1)] {
            let selection = find(&topics, &[(Role::Standing, name)]).unwrap();
            assert_eq!(selection.topic(Role::Standing), Some(index));
        }
        let error = find(&topics, &[(Role::Standing, "/fix")]).unwrap_err();
        assert_eq!(error.code(), "wrong_type");
        for accepted in [
            "std_msgs/msg/Bool",
            "Float32",
            "Float64",
            "Odometry",
            "TwistStamped",
        ] {
            assert!(error.remedy().contains(accepted), "{}", error.remedy());
        }
    }

    #[test]
    fn a_common_message_goes_before_a_device_s_own() {
        let topics = [
            topic("/ublox/fix", "sensor_msgs/msg/NavSatFix"),
            topic("/ublox/navpvt", "ublox_msgs/msg/NavPVT"),
            topic("/ublox/navrelposned", "ublox_msgs/msg/NavRELPOSNED9"),
        ];
        let selection = find(&topics, &[]).unwrap();
        assert_eq!(selection.topic(Role::GnssPosition), Some(0));
        assert_eq!(selection.topic(Role::GnssVelocity), Some(1));
        // Where the antennas are is not in the message: only who names it vouches for it.
        assert_eq!(selection.topic(Role::Heading), None);
        let named = [
            (Role::GnssPosition, "/ublox/navpvt"),
            (Role::Heading, "/ublox/navrelposned"),
        ];
        let selection = find(&topics, &named).unwrap();
        assert_eq!(selection.topic(Role::GnssPosition), Some(1));
        assert_eq!(selection.topic(Role::Heading), Some(2));
    }

    #[test]
    fn a_wrong_name_lists_what_is_there_and_a_wrong_type_says_what_is_needed() {
        let topics = [
            topic("/imu", "sensor_msgs/msg/Imu"),
            topic("/fix", "sensor_msgs/msg/NavSatFix"),
        ];
        let error = find(&topics, &[(Role::Imu, "/imu2")]).unwrap_err();
        assert_eq!(error.code(), "unknown_topic");
        assert!(
            error
                .to_string()
                .contains("/imu (sensor_msgs/msg/Imu in cdr, 10 messages)"),
            "{error}"
        );
        let error = find(&topics, &[(Role::Imu, "/fix")]).unwrap_err();
        assert_eq!(error.code(), "wrong_type");
        assert!(error.remedy().contains("sensor_msgs/msg/Imu"));
    }

    #[test]
    fn every_key_names_its_role() {
        for role in Role::ALL {
            assert_eq!(Role::from_key(role.key()), Some(role));
        }
    }
}
