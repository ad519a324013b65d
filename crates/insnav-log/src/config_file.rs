//! Settings from TOML: one schema for the command line and Python, unknown keys refused by name.

use crate::log::ReadOptions;
use crate::topic_map::TopicMap;
use crate::topics::Role;
use insnav_core::config::Config;
use serde::de::{self, Deserialize, DeserializeSeed, MapAccess, Visitor, value::SeqDeserializer};
use std::fmt;
use std::path::{Path, PathBuf};

/// Why settings could not be taken.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{}: cannot be read", path.display())]
    Read {
        /// The path as given.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is no TOML.
    #[error("{origin}: not TOML: {message}")]
    Syntax {
        /// File or flag.
        origin: String,
        /// What the parser said, with the line.
        message: String,
    },
    /// A key that does not exist.
    #[error("{origin}: unknown key `{key}`")]
    UnknownKey {
        /// File or flag.
        origin: String,
        /// The whole key, such as `gnss.lever_arm`.
        key: String,
        /// The known key nearest to it in spelling.
        nearest: Option<String>,
        /// All keys of that section.
        known: Vec<String>,
    },
    /// A value of the wrong kind.
    #[error("{origin}: `{key}`: {message}")]
    Value {
        /// File or flag.
        origin: String,
        /// The whole key.
        key: String,
        /// What is expected.
        message: String,
        /// Of names, the known one nearest to it in spelling.
        nearest: Option<String>,
    },
    /// A `--set` without `=`.
    #[error("`--set {text}`: no `=` in it")]
    NotAnAssignment {
        /// What was given.
        text: String,
    },
}

impl ConfigError {
    /// A short name for programs.
    pub fn code(&self) -> &'static str {
        match self {
            ConfigError::Read { .. } => "config_not_readable",
            ConfigError::Syntax { .. } => "config_syntax",
            ConfigError::UnknownKey { .. } => "unknown_config_key",
            ConfigError::Value { .. } => "bad_config_value",
            ConfigError::NotAnAssignment { .. } => "bad_option",
        }
    }

    /// What the user can do about it.
    pub fn remedy(&self) -> String {
        match self {
            ConfigError::Read { source, .. }
                if source.kind() == std::io::ErrorKind::IsADirectory =>
            {
                "that is a folder: give a file in it".into()
            }
            ConfigError::Read { .. } => "check the path and its permissions".into(),
            ConfigError::Syntax { .. } => {
                "the file is TOML: sections in [brackets], lines like key = 1.5".into()
            }
            ConfigError::UnknownKey {
                nearest: Some(nearest),
                ..
            } => format!("did you mean `{nearest}`?"),
            ConfigError::UnknownKey { known, .. } => format!("known here: {}", known.join(", ")),
            ConfigError::Value {
                nearest: Some(nearest),
                ..
            } => format!("did you mean `{nearest}`?"),
            ConfigError::Value { .. } => "give a value of that kind; the unit is in the key".into(),
            ConfigError::NotAnAssignment { .. } => {
                "write it as section.key=value, such as gnss.sigma_scale=2".into()
            }
        }
    }
}

/// Settings from a file (if any) and assignments `section.key=value` over it.
pub fn load_config(file: Option<&Path>, assignments: &[String]) -> Result<Config, ConfigError> {
    let text = match file {
        None => String::new(),
        Some(path) => std::fs::read_to_string(path).map_err(|source| ConfigError::Read {
            path: path.into(),
            source,
        })?,
    };
    let origin = file.map_or_else(|| "--set".to_owned(), |p| p.display().to_string());
    parse_config(&text, &origin, assignments)
}

/// Settings from TOML text and assignments over it. `origin` names the text in errors.
pub fn parse_config(
    text: &str,
    origin: &str,
    assignments: &[String],
) -> Result<Config, ConfigError> {
    let mut table = parse_table(text, origin)?;
    // These are for the reader of logs: see `LogSettings`.
    table.remove("map");
    take_standing_topic(&mut table, origin)?;
    // The file alone first, so that its errors carry its name.
    let config: Config = read(table.clone(), origin)?;
    if assignments.is_empty() {
        return Ok(config);
    }
    for text in assignments {
        assign(&mut table, text)?;
    }
    let origin = origin_of(assignments);
    take_standing_topic(&mut table, &origin)?;
    read(table, &origin)
}

/// What errors call the assignments.
fn origin_of(assignments: &[String]) -> String {
    format!("--set {}", assignments.join(" --set "))
}

/// What settings say to the reader of logs: text, which the navigator's own settings have none of.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogSettings {
    /// Maps of messages (`[[map]]`, see [`TopicMap`]).
    pub maps: Vec<TopicMap>,
    /// The topic that declares standing (`stationary.topic`).
    pub standing_topic: Option<String>,
}

impl LogSettings {
    /// From a file (if any) and assignments `section.key=value` over it.
    pub fn load(file: Option<&Path>, assignments: &[String]) -> Result<Self, ConfigError> {
        let text = match file {
            None => String::new(),
            Some(path) => std::fs::read_to_string(path).map_err(|source| ConfigError::Read {
                path: path.into(),
                source,
            })?,
        };
        let origin = file.map_or_else(|| "--set".to_owned(), |p| p.display().to_string());
        Self::parse(&text, &origin, assignments)
    }

    /// From TOML text and assignments over it. `origin` names the text in errors.
    pub fn parse(text: &str, origin: &str, assignments: &[String]) -> Result<Self, ConfigError> {
        let maps = parse_maps(text, origin)?;
        let mut table = parse_table(text, origin)?;
        let mut standing_topic = take_standing_topic(&mut table, origin)?;
        let mut over = toml::Table::new();
        for text in assignments {
            // Of the other assignments `parse_config` judges.
            if text.split('=').next().unwrap_or_default().trim() == STANDING_TOPIC {
                assign(&mut over, text)?;
            }
        }
        if !over.is_empty() {
            standing_topic = take_standing_topic(&mut over, &origin_of(assignments))?;
        }
        Ok(LogSettings {
            maps,
            standing_topic,
        })
    }

    /// Added to options of reading; a topic that they name already goes first.
    #[must_use]
    pub fn over(self, mut options: ReadOptions) -> ReadOptions {
        options.maps.extend(self.maps);
        let named = options.topics.iter().any(|(r, _)| *r == Role::Standing);
        if let Some(topic) = self.standing_topic.filter(|_| !named) {
            options.topics.push((Role::Standing, topic));
        }
        options
    }
}

/// The one key of a section of the navigator that is not its own.
const STANDING_TOPIC: &str = "stationary.topic";

/// Take the topic out of the section that the navigator reads.
fn take_standing_topic(
    table: &mut toml::Table,
    origin: &str,
) -> Result<Option<String>, ConfigError> {
    let section = table
        .get_mut("stationary")
        .and_then(toml::Value::as_table_mut);
    match section.and_then(|section| section.remove("topic")) {
        None => Ok(None),
        Some(toml::Value::String(topic)) => Ok(Some(topic)),
        Some(other) => Err(ConfigError::Value {
            origin: origin.into(),
            key: STANDING_TOPIC.into(),
            message: format!("{other} is no name of a topic, such as \"/vehicle/standing\""),
            nearest: None,
        }),
    }
}

fn parse_table(text: &str, origin: &str) -> Result<toml::Table, ConfigError> {
    text.parse()
        .map_err(|e: toml::de::Error| ConfigError::Syntax {
            origin: origin.into(),
            message: e.to_string(),
        })
}

/// The maps of messages in the TOML text of settings. `origin` names the text in errors.
pub fn parse_maps(text: &str, origin: &str) -> Result<Vec<TopicMap>, ConfigError> {
    let mut table = parse_table(text, origin)?;
    let wrong = |key: &str, message: &str| ConfigError::Value {
        origin: origin.into(),
        key: key.into(),
        message: message.into(),
        nearest: None,
    };
    let list = match table.remove("map") {
        None => return Ok(Vec::new()),
        Some(toml::Value::Array(list)) => list,
        Some(_) => return Err(wrong("map", "a list of tables is expected: [[map]]")),
    };
    let mut maps: Vec<TopicMap> = Vec::new();
    for (index, value) in list.into_iter().enumerate() {
        let key = format!("map[{index}]");
        let map = TopicMap::deserialize(Value(value))
            .map_err(|fault| fault.under(&key).into_error(origin))?;
        if let Some(reason) = map.incomplete() {
            return Err(wrong(&key, reason));
        }
        if maps.iter().any(|other| other.topic == map.topic) {
            let message = format!("there is a map of {} already", map.topic);
            return Err(wrong(&key, &message));
        }
        maps.push(map);
    }
    Ok(maps)
}

/// The settings as TOML text: what `parse_config` reads back.
pub fn config_text(config: &Config) -> String {
    toml::to_string(config).expect(
        "settings are numbers, lists and names in two levels of tables, all of which TOML has",
    )
}

/// As [`config_text`], with the topic that declares standing.
pub fn config_text_with(config: &Config, standing_topic: Option<&str>) -> String {
    let text = config_text(config);
    match standing_topic {
        None => text,
        Some(topic) => {
            let topic = toml::Value::String(topic.to_owned());
            text.replacen(
                "[stationary]\n",
                &format!("[stationary]\ntopic = {topic}\n"),
                1,
            )
        }
    }
}

/// Any table of settings from TOML text. `origin` names the text in errors.
pub(crate) fn read_table<T: serde::de::DeserializeOwned>(
    text: &str,
    origin: &str,
) -> Result<T, ConfigError> {
    read(parse_table(text, origin)?, origin)
}

fn read<T: serde::de::DeserializeOwned>(
    table: toml::Table,
    origin: &str,
) -> Result<T, ConfigError> {
    T::deserialize(Value(toml::Value::Table(table))).map_err(|fault| fault.into_error(origin))
}

fn assign(table: &mut toml::Table, text: &str) -> Result<(), ConfigError> {
    let (key, value) = text
        .split_once('=')
        .ok_or_else(|| ConfigError::NotAnAssignment {
            text: text.to_owned(),
        })?;
    // A bare word is a string: quoting it for TOML through a shell is a nuisance.
    let value = format!("x = {value}")
        .parse::<toml::Table>()
        .ok()
        .and_then(|mut t| t.remove("x"))
        .unwrap_or_else(|| toml::Value::String(value.trim().to_owned()));
    let mut path: Vec<&str> = key.trim().split('.').collect();
    let last = path.pop().unwrap_or_default();
    let mut at = table;
    for section in path {
        let inner = at
            .entry(section)
            .or_insert_with(|| toml::Value::Table(toml::Table::new()));
        at = inner.as_table_mut().ok_or_else(|| ConfigError::Value {
            origin: format!("--set {text}"),
            key: key.trim().to_owned(),
            message: format!("`{section}` is not a section"),
            nearest: None,
        })?;
    }
    at.insert(last.to_owned(), value);
    Ok(())
}

/// What serde finds wrong, kept in parts: its ready-made text would hide the list of known keys.
#[derive(Debug)]
struct Fault {
    path: Vec<String>,
    unknown: Option<&'static [&'static str]>,
    message: String,
    /// Of a name that is not known, the nearest that is.
    nearest: Option<String>,
}

impl Fault {
    fn under(mut self, key: &str) -> Self {
        self.path.insert(0, key.to_owned());
        self
    }

    fn into_error(self, origin: &str) -> ConfigError {
        let key = self.path.join(".");
        let origin = origin.to_owned();
        match self.unknown {
            None => ConfigError::Value {
                origin,
                key,
                message: self.message,
                nearest: self.nearest,
            },
            Some(names) => {
                let section = &self.path[..self.path.len() - 1];
                let whole = |name: &str| {
                    section
                        .iter()
                        .map(String::as_str)
                        .chain([name])
                        .collect::<Vec<_>>()
                        .join(".")
                };
                let name = &self.path[self.path.len() - 1];
                let own = (section == ["stationary"]).then_some(&"topic");
                let names: Vec<&str> = names.iter().chain(own).copied().collect();
                let nearest = nearest(name, &names).map(whole);
                ConfigError::UnknownKey {
                    origin,
                    key,
                    nearest,
                    known: names.iter().map(|n| whole(n)).collect(),
                }
            }
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for Fault {}

impl de::Error for Fault {
    fn custom<T: fmt::Display>(message: T) -> Self {
        Fault {
            path: Vec::new(),
            unknown: None,
            message: message.to_string(),
            nearest: None,
        }
    }

    fn unknown_field(field: &str, expected: &'static [&'static str]) -> Self {
        Fault {
            path: vec![field.to_owned()],
            unknown: Some(expected),
            message: String::new(),
            nearest: None,
        }
    }

    fn unknown_variant(name: &str, expected: &'static [&'static str]) -> Self {
        Fault {
            path: Vec::new(),
            unknown: None,
            message: format!("{name:?} is not one of {}", expected.join(", ")),
            nearest: nearest(name, expected).map(str::to_owned),
        }
    }
}

/// The known name that is nearest in spelling, unless it is so far that it would be a guess.
pub fn nearest<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    known
        .iter()
        .map(|known| (distance(name, known), *known))
        .min()
        .filter(|(d, known)| *d <= known.len().max(name.len()) / 2)
        .map(|(_, known)| known)
}

/// A TOML value that reports faults as [`Fault`].
struct Value(toml::Value);

impl<'de> de::IntoDeserializer<'de, Fault> for Value {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

impl<'de> de::Deserializer<'de> for Value {
    type Error = Fault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        match self.0 {
            toml::Value::String(s) => visitor.visit_string(s),
            toml::Value::Integer(i) => visitor.visit_i64(i),
            toml::Value::Float(x) => visitor.visit_f64(x),
            toml::Value::Boolean(b) => visitor.visit_bool(b),
            toml::Value::Datetime(d) => visitor.visit_string(d.to_string()),
            toml::Value::Array(list) => {
                visitor.visit_seq(SeqDeserializer::new(list.into_iter().map(Value)))
            }
            toml::Value::Table(table) => visitor.visit_map(Entries {
                rest: table.into_iter(),
                value: None,
            }),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_some(self)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        match self.0 {
            toml::Value::String(s) => de::Deserializer::deserialize_enum(
                de::IntoDeserializer::<Fault>::into_deserializer(s),
                name,
                variants,
                visitor,
            ),
            other => Err(de::Error::custom(format!(
                "{other} is not one of {}",
                variants.join(", ")
            ))),
        }
    }

    serde::forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct
        newtype_struct seq tuple tuple_struct map struct identifier ignored_any
    }
}

struct Entries {
    rest: toml::map::IntoIter<String, toml::Value>,
    value: Option<(String, toml::Value)>,
}

impl<'de> MapAccess<'de> for Entries {
    type Error = Fault;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, Fault> {
        let Some((key, value)) = self.rest.next() else {
            return Ok(None);
        };
        let read = seed.deserialize(de::IntoDeserializer::<Fault>::into_deserializer(
            key.clone(),
        ))?;
        self.value = Some((key, value));
        Ok(Some(read))
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, Fault> {
        let (key, value) = self
            .value
            .take()
            .ok_or_else(|| de::Error::custom("a value without its key"))?;
        seed.deserialize(Value(value))
            .map_err(|fault| fault.under(&key))
    }
}

/// Least number of insertions, deletions and replacements that turn one word into the other: the Levenshtein distance.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::imu::ImuGrade;

    fn parse(text: &str, assignments: &[&str]) -> Result<Config, ConfigError> {
        let assignments: Vec<String> = assignments.iter().map(|&a| a.to_owned()).collect();
        parse_config(text, "car.toml", &assignments)
    }

    #[test]
    fn file_then_assignments() {
        let c = parse(
            "[imu]\ngrade = \"tactical\"\n[gnss]\nlever_arm_b_m = [1, 0.5, -0.2]\ntime_offset_s = -0.2",
            &["gnss.time_offset_s=0.1", "imu.grade=consumer", "noise.accel_bias_mg = 3"],
        )
        .unwrap();
        assert_eq!(c.imu.grade, Some(ImuGrade::Consumer));
        assert_eq!(c.gnss.lever_arm_b_m, Some([1.0, 0.5, -0.2]));
        assert_eq!(c.gnss.time_offset_s, 0.1);
        assert_eq!(c.noise.accel_bias_mg, Some(3.0));
    }

    #[test]
    fn text_comes_back_as_the_same_settings() {
        let mut c = Config::default();
        c.imu.grade = Some(ImuGrade::Industrial);
        c.gnss.lever_arm_b_m = Some([0.1, -0.2, 0.3]);
        c.output.origin = Some([59.1, 18.2, 30.0]);
        assert_eq!(parse(&config_text(&c), &[]).unwrap(), c);
        assert_eq!(
            parse(&config_text(&Config::default()), &[]).unwrap(),
            Config::default()
        );
    }

    #[test]
    fn an_unknown_key_is_named_with_the_nearest() {
        let e = parse("[gnss]\nlever_arm_m = [0, 0, 0]", &[]).unwrap_err();
        assert_eq!(e.code(), "unknown_config_key");
        assert_eq!(e.to_string(), "car.toml: unknown key `gnss.lever_arm_m`");
        assert_eq!(e.remedy(), "did you mean `gnss.lever_arm_b_m`?");
        let e = parse("[gnns]\nsigma_scale = 1", &[]).unwrap_err();
        assert_eq!(e.remedy(), "did you mean `gnss`?");
        let e = parse("", &["imu.grad=tactical"]).unwrap_err();
        assert!(
            e.to_string().contains("--set imu.grad=tactical") && e.remedy().contains("imu.grade"),
            "{e}"
        );
    }

    #[test]
    fn maps_are_for_the_reader_and_faults_in_them_are_named() {
        let text = "[gnss]\nsigma_scale = 2\n[[map]]\ntopic = \"/x\"\nangular_rate_rad_per_s = [\"a\", \"b\", \"c\"]\n";
        assert_eq!(
            parse(text, &[]).unwrap().gnss.sigma_scale.fixed(),
            Some(2.0)
        );
        let maps = |more: &str| parse_maps(&format!("{text}{more}"), "car.toml");
        let force = "specific_force_m_per_s2 = [\"d\", \"e\", \"-f * 9.8\"]\n";
        assert_eq!(maps(force).unwrap()[0].topic, "/x");
        for (more, says) in [
            (
                "",
                "`map[0]`: angular_rate_rad_per_s and specific_force_m_per_s2 go together",
            ),
            ("latitude = \"x\"", "unknown key `map[0].latitude`"),
            (
                "height_m = \"a b\"",
                "`map[0].height_m`: \"a b\" is no field",
            ),
            ("imu_axes = \"up\"", "`map[0].imu_axes`"),
        ] {
            let error = maps(more).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
        let map = &text[text.find("[[map]]").unwrap()..];
        let twice = maps(&format!("{force}{map}{force}")).unwrap_err();
        assert!(twice.to_string().contains("map of /x already"), "{twice}");
        assert!(parse_maps("map = 3", "x").is_err());
        assert_eq!(parse_maps("", "x").unwrap(), []);
    }

    #[test]
    fn the_topic_of_standing_is_for_the_reader() {
        let text = "[stationary]\nmode = \"zupt\"\ntopic = \"/brake\"\nintervals_s = [[1, 2.5]]\n";
        let c = parse(text, &["stationary.topic=/wheels"]).unwrap();
        assert_eq!(c.stationary.intervals_s.as_slice(), [[1.0, 2.5]]);
        let topic = |set: &[&str]| {
            let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
            LogSettings::parse(text, "car.toml", &set).map(|s| s.standing_topic)
        };
        assert_eq!(topic(&[]).unwrap().as_deref(), Some("/brake"));
        let set = ["gnss.sigma_scale=2", "stationary.topic = /wheels"];
        assert_eq!(topic(&set).unwrap().as_deref(), Some("/wheels"));
        let e = topic(&["stationary.topic=3"]).unwrap_err();
        assert!(
            e.to_string()
                .contains("--set stationary.topic=3: `stationary.topic`: 3 is no name"),
            "{e}"
        );
        let e = parse("[stationary]\ntopics = 1", &[]).unwrap_err();
        assert_eq!(e.remedy(), "did you mean `stationary.topic`?");
        let again = config_text_with(&c, Some("/b\"c"));
        assert_eq!(parse(&again, &[]).unwrap(), c);
        let back = LogSettings::parse(&again, "x", &[]).unwrap();
        assert_eq!(back.standing_topic.as_deref(), Some("/b\"c"));
        // Without a name of its own in the options only.
        let named = ReadOptions {
            topics: vec![(Role::Standing, "none".into())],
            ..ReadOptions::default()
        };
        assert_eq!(back.clone().over(named.clone()).topics, named.topics);
        let topics = back.over(ReadOptions::default()).topics;
        assert_eq!(topics, [(Role::Standing, "/b\"c".into())]);
    }

    #[test]
    fn intervals_and_modes_are_refused_by_name() {
        for (text, says) in [
            ("mode = \"zup\"", "`stationary.mode`"),
            ("intervals_s = [40, 200]", "`stationary.intervals_s`"),
            ("intervals_s = [[40]]", "`stationary.intervals_s`"),
            ("intervals_s = \"40:200\"", "`stationary.intervals_s`"),
        ] {
            let e = parse(&format!("[stationary]\n{text}"), &[]).unwrap_err();
            assert!(e.to_string().contains(says), "{e}");
        }
        let e = parse("[stationary]\nmode = \"zup\"", &[]).unwrap_err();
        let all = "auto, off, zupt, zihr, heading_hold, attitude_hold, static, batch";
        assert!(e.to_string().ends_with(all), "{e}");
        assert_eq!(e.remedy(), "did you mean `zupt`?");
        let e = parse("", &["stationary.mode=heading-hold"]).unwrap_err();
        assert_eq!(e.remedy(), "did you mean `heading_hold`?");
        let e = parse("", &["stationary.mode=1"]).unwrap_err();
        assert!(e.to_string().ends_with(all), "{e}");
        let e = parse("[stationary]\nwindow = 2", &[]).unwrap_err();
        assert_eq!(e.remedy(), "did you mean `stationary.window_s`?");
    }

    #[test]
    fn a_far_key_gets_the_list_and_no_guess() {
        let e = parse("[imu]\nzzzzzzzz = 1", &[]).unwrap_err();
        assert!(
            e.remedy().starts_with("known here: imu.grade, "),
            "{}",
            e.remedy()
        );
    }

    #[test]
    fn a_wrong_value_names_its_key() {
        let e = parse("[gnss]\nsigma_scale = \"big\"", &[]).unwrap_err();
        assert_eq!(e.code(), "bad_config_value");
        assert!(
            e.to_string().starts_with("car.toml: `gnss.sigma_scale`: "),
            "{e}"
        );
        let e = parse("[imu]\ngrade = \"best\"", &[]).unwrap_err();
        assert!(
            e.to_string().contains("`imu.grade`") && e.to_string().contains("consumer"),
            "{e}"
        );
        let e = parse("[imu]\nmounting_rpy_deg = [1, 2]", &[]).unwrap_err();
        assert!(e.to_string().contains("imu.mounting_rpy_deg"), "{e}");
    }

    #[test]
    fn broken_text_tells_the_line() {
        let e = parse("[gnss]\nsigma_scale = = 3", &[]).unwrap_err();
        assert!(
            e.code() == "config_syntax" && e.to_string().contains("line 2"),
            "{e}"
        );
        assert_eq!(
            parse("", &["gnss.sigma_scale"]).unwrap_err().code(),
            "bad_option"
        );
        assert_eq!(
            parse("", &["imu.grade.x=1", "imu.grade.x.y=1"])
                .unwrap_err()
                .code(),
            "bad_config_value"
        );
    }

    #[test]
    fn edit_distances() {
        for (a, b, d) in [
            ("kitten", "sitting", 3),
            ("", "abc", 3),
            ("same", "same", 0),
            ("flaw", "lawn", 2),
        ] {
            assert_eq!(distance(a, b), d, "{a} {b}");
        }
    }
}
