//! Scenarios of the simulator from TOML: unknown keys refused by name, as in the settings.

use crate::config_file::{ConfigError, read_table};
use insnav_core::config::NoiseConfig;
use insnav_core::error::Error as CoreError;
use insnav_core::imu::{ImuGrade, STANDARD_GRAVITY};
use insnav_core::sim::{
    Body, Drive, GnssModel, ImuErrorModel, ImuModel, ImuOutput, Leg, Scenario, Simulation,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A scenario with every key explained: a start for one's own.
pub const SCENARIO_EXAMPLE: &str = include_str!("scenario_example.toml");

/// Inertial samples that one simulation may have: it is held in memory, at some 200 bytes each.
const MOST_SAMPLES: f64 = 2e7;
/// 2024-01-01T00:00:00Z: stamps of the size that real logs have.
const START_UNIX_S: f64 = 1_704_067_200.0;

/// A scenario as a file states it.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioFile {
    /// What is simulated.
    pub scenario: Scenario,
    /// Seed of the random numbers, if it is stated.
    pub seed: Option<u64>,
    /// Class of the inertial unit.
    pub grade: ImuGrade,
    /// The errors of the unit in the units of the file.
    imu: ImuText,
    origin: String,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileText {
    seed: Option<u64>,
    duration_s: Option<f64>,
    #[serde(default)]
    route: Vec<LegText>,
    ready_route: Option<ReadyRoute>,
    start: StartText,
    body: Option<Body>,
    #[serde(default)]
    imu: ImuText,
    #[serde(default)]
    gnss: GnssModel,
}

#[derive(Clone, Copy, Serialize, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum ReadyRoute {
    Car,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StartText {
    #[serde(default = "start_unix_s")]
    time_unix_s: f64,
    latitude_deg: f64,
    longitude_deg: f64,
    height_m: f64,
    heading_deg: f64,
    #[serde(default)]
    speed_m_per_s: f64,
}

fn start_unix_s() -> f64 {
    START_UNIX_S
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LegText {
    duration_s: f64,
    speed_m_per_s: Option<f64>,
    #[serde(default)]
    turn_deg: f64,
    slope_deg: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ImuText {
    grade: ImuGrade,
    rate_hz: f64,
    output: ImuOutput,
    noise: NoiseConfig,
    errors: ErrorsText,
}

impl Default for ImuText {
    fn default() -> Self {
        ImuText {
            grade: ImuGrade::Consumer,
            rate_hz: 100.0,
            output: ImuOutput::Rates,
            noise: NoiseConfig::default(),
            errors: ErrorsText::default(),
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ErrorsText {
    gyro_bias_deg_per_hour: [f64; 3],
    accel_bias_mg: [f64; 3],
    gyro_scale_ppm: [f64; 3],
    accel_scale_ppm: [f64; 3],
    gyro_step_deg_per_s: f64,
    accel_step_m_per_s2: f64,
}

impl ScenarioFile {
    /// From a file; `grade` goes before what it states.
    pub fn load(path: &Path, grade: Option<ImuGrade>) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read {
            path: path.into(),
            source,
        })?;
        Self::parse(&text, &path.display().to_string(), grade)
    }

    /// From TOML text; `origin` names it in errors.
    pub fn parse(text: &str, origin: &str, grade: Option<ImuGrade>) -> Result<Self, ConfigError> {
        let file: FileText = read_table(text, origin)?;
        let grade = grade.unwrap_or(file.imu.grade);
        let wrong = |key: &str, message: String| ConfigError::Value {
            origin: origin.to_owned(),
            key: key.to_owned(),
            message,
            nearest: None,
        };
        let mut body = file.body.unwrap_or_default();
        let (legs, duration_s) = match (file.ready_route, file.route.is_empty()) {
            (Some(_), false) => {
                return Err(wrong(
                    "ready_route",
                    "there is a `route` too: state one of them".into(),
                ));
            }
            (None, true) => {
                return Err(wrong(
                    "route",
                    "there is none: state legs, or a `ready_route`".into(),
                ));
            }
            (Some(ReadyRoute::Car), true) => {
                let duration = file
                    .duration_s
                    .filter(|d| *d > 0.0 && *d <= 1e6)
                    .ok_or_else(|| {
                        wrong(
                            "duration_s",
                            "a ready route needs it, positive and at most 1000000".into(),
                        )
                    })?;
                let ready = Scenario::car_drive(duration);
                if body == Body::default() {
                    body = ready.drive.body;
                }
                (ready.drive.legs, duration)
            }
            (None, false) => {
                let legs = legs(&file.route, file.start.speed_m_per_s);
                let whole = legs.iter().map(|l| l.duration_s).sum();
                (legs, file.duration_s.unwrap_or(whole))
            }
        };
        if !(duration_s > 0.0 && duration_s.is_finite()) {
            return Err(wrong("duration_s", "must be positive".into()));
        }
        if duration_s * file.imu.rate_hz > MOST_SAMPLES {
            return Err(wrong(
                "duration_s",
                format!(
                    "{duration_s} s at {} Hz are more than {MOST_SAMPLES:.0} samples, which are held in memory",
                    file.imu.rate_hz
                ),
            ));
        }
        let start = &file.start;
        let scenario = Scenario {
            duration_s,
            drive: Drive {
                start_s: start.time_unix_s,
                latitude_deg: start.latitude_deg,
                longitude_deg: start.longitude_deg,
                height_m: start.height_m,
                heading_deg: start.heading_deg,
                speed_m_per_s: start.speed_m_per_s,
                legs,
                body,
            },
            imu: file.imu.model(grade),
            gnss: file.gnss,
        };
        Ok(ScenarioFile {
            scenario,
            seed: file.seed,
            grade,
            imu: ImuText { grade, ..file.imu },
            origin: origin.to_owned(),
        })
    }

    /// A ready scenario, whose unit has no errors but those of its class.
    pub fn ready(scenario: Scenario, grade: ImuGrade) -> Self {
        let imu = ImuText {
            grade,
            rate_hz: scenario.imu.rate_hz,
            output: scenario.imu.output,
            ..ImuText::default()
        };
        ScenarioFile {
            scenario: Scenario {
                imu: imu.model(grade),
                ..scenario
            },
            seed: None,
            grade,
            imu,
            origin: "scenario".to_owned(),
        }
    }

    /// The file that states it, every key with its number: reading it gives the same scenario to the last bit, as long as its unit is
    /// the one that was read.
    pub fn text(&self) -> Result<String, ConfigError> {
        let drive = &self.scenario.drive;
        let leg = |leg: &Leg| LegText {
            duration_s: leg.duration_s,
            speed_m_per_s: Some(leg.speed_m_per_s),
            turn_deg: leg.turn_deg,
            slope_deg: Some(leg.slope_deg),
        };
        let file = FileText {
            seed: self.seed,
            duration_s: Some(self.scenario.duration_s),
            route: drive.legs.iter().map(leg).collect(),
            ready_route: None,
            start: StartText {
                time_unix_s: drive.start_s,
                latitude_deg: drive.latitude_deg,
                longitude_deg: drive.longitude_deg,
                height_m: drive.height_m,
                heading_deg: drive.heading_deg,
                speed_m_per_s: drive.speed_m_per_s,
            },
            body: Some(drive.body.clone()),
            imu: self.imu.clone(),
            gnss: self.scenario.gnss.clone(),
        };
        toml::to_string(&file).map_err(|e| ConfigError::Value {
            origin: self.origin.clone(),
            key: "seed".into(),
            message: e.to_string(),
            nearest: None,
        })
    }

    /// Simulate it. A number outside its range is an error with its key in the file.
    pub fn simulate(&self, seed: u64) -> Result<Simulation, ConfigError> {
        self.scenario.simulate(seed).map_err(|error| {
            let CoreError::Config {
                key,
                value,
                expected,
            } = error
            else {
                return ConfigError::Value {
                    origin: self.origin.clone(),
                    key: "route".into(),
                    message: error.to_string(),
                    nearest: None,
                };
            };
            ConfigError::Value {
                origin: self.origin.clone(),
                key: key_in_file(key),
                message: format!("{value} is not allowed, it must be {expected}"),
                nearest: None,
            }
        })
    }
}

/// Keys of the simulator by those of the file.
fn key_in_file(key: &str) -> String {
    let moved = [
        ("drive.start_s", "start.time_unix_s"),
        ("drive.legs.", "route."),
        ("drive.legs", "route"),
        ("drive.body.", "body."),
        ("drive.", "start."),
        ("imu.errors.accel_bias_m_per_s2", "imu.errors.accel_bias_mg"),
        ("imu.errors.gyro_quantum", "imu.errors.gyro_step_deg_per_s"),
        ("imu.errors.accel_quantum", "imu.errors.accel_step_m_per_s2"),
        (
            "imu.errors.noise.gyro_white",
            "imu.noise.gyro_arw_deg_per_sqrt_hour",
        ),
        (
            "imu.errors.noise.accel_white",
            "imu.noise.accel_vrw_m_per_s_per_sqrt_hour",
        ),
        (
            "imu.errors.noise.gyro_bias_sigma",
            "imu.noise.gyro_bias_deg_per_hour",
        ),
        (
            "imu.errors.noise.accel_bias_sigma",
            "imu.noise.accel_bias_mg",
        ),
        (
            "imu.errors.noise.gyro_bias_tau",
            "imu.noise.gyro_bias_tau_s",
        ),
        (
            "imu.errors.noise.accel_bias_tau",
            "imu.noise.accel_bias_tau_s",
        ),
    ];
    let renamed = moved.iter().find_map(|(from, to)| {
        let rest = key.strip_prefix(from)?;
        Some(format!("{to}{rest}"))
    });
    renamed.unwrap_or_else(|| key.to_owned())
}

/// What a leg does not state stays as the leg before left it.
fn legs(route: &[LegText], start_speed: f64) -> Vec<Leg> {
    let (mut speed_m_per_s, mut slope_deg) = (start_speed, 0.0);
    route
        .iter()
        .map(|leg| {
            speed_m_per_s = leg.speed_m_per_s.unwrap_or(speed_m_per_s);
            slope_deg = leg.slope_deg.unwrap_or(slope_deg);
            Leg {
                duration_s: leg.duration_s,
                speed_m_per_s,
                turn_deg: leg.turn_deg,
                slope_deg,
            }
        })
        .collect()
}

impl ImuText {
    fn model(&self, grade: ImuGrade) -> ImuModel {
        let e = &self.errors;
        // Steps of increments are those of the mean rate over one interval.
        let interval = match self.output {
            ImuOutput::Rates => 1.0,
            ImuOutput::Increments => 1.0 / self.rate_hz,
        };
        ImuModel {
            rate_hz: self.rate_hz,
            output: self.output,
            errors: ImuErrorModel {
                noise: Some(self.noise.over(grade)),
                gyro_bias_deg_per_hour: e.gyro_bias_deg_per_hour,
                accel_bias_m_per_s2: e.accel_bias_mg.map(|mg| mg * 1e-3 * STANDARD_GRAVITY),
                gyro_scale_ppm: e.gyro_scale_ppm,
                accel_scale_ppm: e.accel_scale_ppm,
                gyro_quantum: e.gyro_step_deg_per_s.to_radians() * interval,
                accel_quantum: e.accel_step_m_per_s2 * interval,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<ScenarioFile, ConfigError> {
        ScenarioFile::parse(text, "drive.toml", None)
    }

    const START: &str =
        "[start]\nlatitude_deg = 50\nlongitude_deg = 14\nheight_m = 200\nheading_deg = 0\n";

    /// With every `#key = …` of the example uncommented one by one it is still a scenario: no key in it is misspelt.
    #[test]
    fn every_key_of_the_example_is_one() {
        parse(SCENARIO_EXAMPLE).expect("a scenario");
        let commented = |line: &str| {
            let rest = line.strip_prefix('#')?;
            rest.starts_with(|c: char| c.is_ascii_lowercase())
                .then(|| rest.to_owned())
        };
        let lines: Vec<&str> = SCENARIO_EXAMPLE.lines().collect();
        let mut tried = 0;
        for (i, line) in lines.iter().enumerate() {
            let Some(uncommented) = commented(line) else {
                continue;
            };
            let mut text: Vec<String> = lines.iter().map(|l| (*l).to_owned()).collect();
            text[i] = uncommented;
            match parse(&text.join("\n")) {
                Ok(_) => {}
                // The one that excludes another key.
                Err(error) => assert!(error.to_string().contains("ready_route"), "{error}"),
            }
            tried += 1;
        }
        assert!(tried > 14, "{tried}");
    }

    #[test]
    fn a_scenario_written_is_read_as_the_same() {
        let again = |file: &ScenarioFile| {
            let text = file.text().expect("plain data");
            let read = parse(&text).expect(&text);
            assert_eq!(read.scenario, file.scenario);
            assert_eq!((read.seed, read.grade), (file.seed, file.grade));
            assert_eq!(read.text().unwrap(), text);
        };
        let ready = [
            (Scenario::standing(5.0, 33.3), ImuGrade::Automotive),
            (Scenario::car_drive(700.0), ImuGrade::Automotive),
            (Scenario::demo(), ImuGrade::Consumer),
        ];
        for (scenario, grade) in ready {
            let file = ScenarioFile::ready(scenario.clone(), grade);
            assert_eq!(file.scenario, scenario, "nothing is lost");
            again(&file);
        }
        again(&parse(SCENARIO_EXAMPLE).unwrap());
        let odd = format!(
            "seed = 7\nready_route = \"car\"\nduration_s = 33.3\n{START}[imu]\ngrade = \"tactical\"\noutput = \"increments\"\n\
             [imu.noise]\ngyro_bias_deg_per_hour = 0.1\n[imu.errors]\naccel_bias_mg = [0.1, 0.2, 0.3]\n"
        );
        again(&parse(&odd).unwrap());
    }

    /// A unit that counts whole steps of 0.01 °/s and 0.01 m/s² in the mean of an interval, whichever way it tells them.
    #[test]
    fn steps_of_increments_are_those_of_the_mean_rate() {
        let model = |output: &str| {
            let text = format!(
                "route = [{{ duration_s = 5 }}]\n{START}[imu]\nrate_hz = 200\noutput = \"{output}\"\n[imu.errors]\n\
                 gyro_step_deg_per_s = 0.01\naccel_step_m_per_s2 = 0.01\n"
            );
            parse(&text).unwrap().scenario.imu
        };
        let (rates, increments) = (model("rates"), model("increments"));
        assert_eq!(increments.output, ImuOutput::Increments);
        assert!((rates.errors.gyro_quantum / increments.errors.gyro_quantum - 200.0).abs() < 1e-9);
        assert!((increments.errors.accel_quantum - 0.01 / 200.0).abs() < 1e-18);
    }

    #[test]
    fn what_a_leg_does_not_state_stays() {
        let text = format!(
            "route = [{{ duration_s = 5, speed_m_per_s = 10, slope_deg = 1 }}, {{ duration_s = 6, turn_deg = 9 }}]\n{START}"
        );
        let scenario = parse(&text).unwrap().scenario;
        let last = scenario.drive.legs[1];
        assert_eq!(
            (last.speed_m_per_s, last.slope_deg, last.turn_deg),
            (10.0, 1.0, 9.0)
        );
        assert_eq!(scenario.duration_s, 11.0);
    }

    #[test]
    fn mistakes_are_named_with_their_key() {
        let route = "route = [{ duration_s = 5 }]\n";
        let error = |text: String| parse(&text).unwrap_err();
        let e = error(format!("{route}{START}[gnss]\nposition_sigma = [1, 1, 1]"));
        assert_eq!(
            e.to_string(),
            "drive.toml: unknown key `gnss.position_sigma`"
        );
        assert!(
            e.remedy().contains("gnss.position_sigma_m"),
            "{}",
            e.remedy()
        );
        let e = error(format!("route = [{{ duration = 5 }}]\n{START}"));
        assert!(e.remedy().contains("route.duration_s"), "{}", e.remedy());
        let e = error(START.to_owned());
        assert!(e.to_string().contains("`route`"), "{e}");
        let e = error(format!("ready_route = \"car\"\n{START}"));
        assert!(e.to_string().contains("duration_s"), "{e}");
        let e = error(route.to_owned());
        assert!(e.to_string().contains("start"), "{e}");
        let e = error(format!("duration_s = 1e6\n{route}{START}"));
        assert!(e.to_string().contains("held in memory"), "{e}");
    }

    #[test]
    fn ranges_are_named_with_the_key_of_the_file() {
        let out = |text: &str| {
            let file = parse(&format!("{text}{START}")).unwrap();
            file.simulate(1).unwrap_err().to_string()
        };
        assert!(
            out("route = [{ duration_s = -5 }, { duration_s = 10 }]\n")
                .contains("`route.duration_s`: -5")
        );
        let file = parse(&format!(
            "route = [{{ duration_s = 5 }}]\n{START}[imu.noise]\ngyro_bias_tau_s = -1\n"
        ))
        .unwrap();
        let message = file.simulate(1).unwrap_err().to_string();
        assert!(message.contains("`imu.noise.gyro_bias_tau_s`"), "{message}");
    }
}
