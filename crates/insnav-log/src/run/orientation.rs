//! The orientation of a log: its noise, the attitude filter, and what to tell of both.

use super::Withhold;
use super::error::RunError;
use super::noise::{NoiseRequest, identify_log_noise};
use super::noise_readings::noise_readings;
use super::oddities::{findings_of, refuse_fatal};
use super::report::Warning;
use super::source::Source;
use super::survey::Survey;
use crate::config_file::parse_config;
use crate::sink::OrientationEpoch;
use crate::{LogError, METADATA_T0};
use insnav_core::ahrs::{Ahrs, AhrsEpoch, AhrsSettings, Smoother, gyro_range};
use insnav_core::attitude::Euler;
use insnav_core::config::{Config, NoiseConfig};
use insnav_core::error::Error as CoreError;
use insnav_core::imu::{ImuGrade, ImuNoise, STANDARD_GRAVITY};
use insnav_core::noise_floor::NoiseFloor;
use insnav_core::sample::{ImuSample, MagneticField, Sample};
use insnav_core::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::Serialize;
use std::collections::{BTreeMap, VecDeque};
use std::time::Instant;

/// A carrier faster than this keeps its velocity for longer than a hand does, m/s,
const FAST: f64 = 2.0;
/// for so long, s.
const FAST_TAU: f64 = 2.0;
/// Share of the field that calibration does not leave in a magnetometer.
const LARGE_OFFSET: f64 = 0.1;
/// Changes of the field per second that no surroundings make.
const MANY_CHANGES: f64 = 0.1;
/// A magnetometer that states no noise has this share of the field's length; no attitude filter gains by believing in less.
const LEAST_FIELD_NOISE: f64 = 1e-3;

/// Where the noise of the sensors is taken from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OrientationNoise {
    /// The log itself, as [`identify_log_noise`] finds it; what it does not tell, from settings and class.
    #[default]
    Identified,
    /// Settings and class of the unit.
    Stated,
}

/// Where the gyros' range ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum GyroRange {
    /// Where the record shows it.
    #[default]
    AsSeen,
    /// Nowhere.
    Unlimited,
    /// At this rate, rad/s.
    Of(f64),
}

/// What is asked.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OrientationRequest {
    /// Where the noise is taken from.
    pub noise: OrientationNoise,
    /// Where the gyros' range ends.
    pub gyro_range: GyroRange,
    /// Use the whole log for every instant, in place of what was before it.
    pub smooth: bool,
    /// How fast the carrier goes about, standard deviation in m/s; `None`: as a hand does.
    pub carrier_speed: Option<f64>,
}

/// The noise that was used.
#[derive(Clone, Debug, Serialize)]
pub struct OrientationNoiseReport {
    /// `log` where it was identified, `settings` where not.
    pub source: &'static str,
    /// Class of the unit, which has what nobody else tells.
    pub grade: &'static str,
    /// White noise of the gyros.
    pub gyro_arw_deg_per_sqrt_hour: f64,
    /// White noise of the accelerometers.
    pub accel_vrw_m_per_s_per_sqrt_hour: f64,
    /// Gyro bias, one sigma.
    pub gyro_bias_deg_per_hour: f64,
    /// Its correlation time.
    pub gyro_bias_tau_s: f64,
    /// White noise of one sample of the magnetometer, where it is known.
    pub magnetometer_microtesla: Option<f64>,
    /// The `[noise]` block that gives the same again.
    pub config: String,
}

/// What headings count from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadingReference {
    /// Magnetic north.
    MagneticNorth,
    /// True north: the declination is given.
    TrueNorth,
    /// Where the body looked when it began: there is no magnetometer.
    Start,
}

/// The orientation at the end.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FinalOrientation {
    /// Roll.
    pub roll_deg: f64,
    /// Pitch.
    pub pitch_deg: f64,
    /// Heading, 0 to 360.
    pub heading_deg: f64,
    /// Standard deviation of the greater tilt.
    pub sigma_tilt_deg: f64,
    /// Standard deviation of the heading.
    pub sigma_heading_deg: f64,
}

/// An orientation of a log, with what went into it.
#[derive(Clone, Debug, Serialize)]
pub struct OrientationReport {
    /// Inertial samples.
    pub imu_samples: usize,
    /// Those that are not finite or not in the order of time: left out.
    pub dropped: usize,
    /// Magnetic fields.
    pub magnetic_fields: usize,
    /// From the first sample to the last.
    pub duration_s: f64,
    /// What the work took.
    pub elapsed_s: f64,
    /// Whether every instant knows the whole log.
    pub smoothed: bool,
    /// What headings count from.
    pub heading_reference: HeadingReference,
    /// Noise of the sensors.
    pub noise: OrientationNoiseReport,
    /// Orientations that were found.
    pub epochs: usize,
    /// Time at rest, by which gyro biases are learnt.
    pub rest_s: f64,
    /// End of the gyros' range, if they reach it.
    pub gyro_range_deg_per_s: Option<f64>,
    /// Time with a gyro at the end of its range.
    pub saturated_s: f64,
    /// Gyro bias at the end, body axes.
    pub gyro_bias_deg_per_s: [f64; 3],
    /// Delay of the magnetometer behind the gyros, and its standard deviation.
    pub magnetometer_delay_s: Option<[f64; 2]>,
    /// Field that turns with the body (hard iron) at the end, as a share of the field.
    pub magnetometer_offset_share: Option<f64>,
    /// How often the field became another one.
    pub field_changes: u32,
    /// The orientation at the end.
    #[serde(rename = "final")]
    pub last: Option<FinalOrientation>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

/// How an orientation is going to be found: noise and settings of the filter.
#[derive(Clone, Debug)]
pub struct OrientationPlan {
    /// Settings of the filter.
    pub settings: AhrsSettings,
    /// Noise of the sensors.
    pub noise: OrientationNoiseReport,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    request: OrientationRequest,
    declination: Option<f64>,
    fields: usize,
    origin: Time,
    planning_s: f64,
}

/// Settings of the orientation filter for a unit of this noise, as far as no record has a part in them: what `carrier_speed` is to
/// [`OrientationRequest`].
pub fn ahrs_settings(config: &Config, noise: ImuNoise, carrier_speed: Option<f64>) -> AhrsSettings {
    let mut settings = AhrsSettings {
        noise,
        ..AhrsSettings::default()
    };
    // Units that give orientations are calibrated, unless somebody says what they are.
    if config.noise.accel_bias_mg.is_some() || config.imu.grade.is_some() {
        settings.accel_bias_sigma = noise.accel_bias_sigma;
    }
    if let Some(speed) = carrier_speed {
        settings.velocity_sigma = speed;
        settings.velocity_tau = if speed > FAST {
            FAST_TAU
        } else {
            settings.velocity_tau
        };
    }
    settings
}

impl OrientationPlan {
    /// Look at a source and choose what is left open.
    ///
    /// # Errors
    /// Those of reading, [`RunError::NoImu`].
    pub fn make(
        source: &(impl Source + ?Sized),
        config: &Config,
        request: OrientationRequest,
    ) -> Result<Self, RunError> {
        let begin = Instant::now();
        config.validate().map_err(RunError::from)?;
        let survey = Survey::of(source)?;
        let (first, last) = survey.imu_span.ok_or(RunError::NoImu)?;
        let origin = source.origin()?.unwrap_or(first);
        // Rates in degrees, forces in g, gravity upside down: an orientation from such data is nonsense.
        let facts = source.facts()?;
        let found = findings_of(&facts, &survey, config, origin, &Withhold::default());
        refuse_fatal(&found)?;
        let mut warnings = Vec::new();
        let grade = config.imu.grade.unwrap_or_else(|| {
            let floor = survey.noise_floor.as_ref();
            floor.map_or(ImuGrade::Consumer, NoiseFloor::grade)
        });
        let mut stated = config.noise;
        let mut from = "settings";
        let mut block = None;
        if request.noise == OrientationNoise::Identified {
            match identify_log_noise(source, config, &NoiseRequest::default()) {
                Ok(found) => {
                    let own = parse_config(&found.config, "the log's own noise", &[])?.noise;
                    // Who states a number knows better.
                    stated = stated.or(&own);
                    from = "log";
                    block = Some(found.config);
                }
                Err(RunError::Noise(refusal)) => warnings.push(Warning {
                    code: "noise_not_identified",
                    message: format!(
                        "the log does not tell its noise: {refusal}; that of the class {} is taken",
                        grade.name()
                    ),
                    remedy: "give the numbers of the data sheet: `--noise FILE` with a [noise] block, or `--noise datasheet --set imu.grade=…`".into(),
                }),
                Err(other) => return Err(other),
            }
        }
        let noise = stated.over(grade);
        let mut settings = ahrs_settings(config, noise, request.carrier_speed);
        let length = survey.field_sum / survey.fields.max(1) as f64;
        let rate = survey.fields as f64 / last.since(first).max(f64::MIN_POSITIVE);
        if let Some(microtesla) = stated.magnetometer_microtesla
            && length > 0.0
        {
            // The settings are white noise: samples that come faster than the filter takes for independent share it.
            let independent = (settings.field.rate_hz / rate).min(1.0).sqrt();
            let sigma = microtesla * 1e-6 / length * independent;
            settings.field.sigma = sigma.max(LEAST_FIELD_NOISE);
        }
        if survey.zero_fields > 0 {
            warnings.push(Warning {
                code: "magnetometer_zero",
                message: format!(
                    "{} magnetic fields are zero, which says nothing: they are left out",
                    survey.zero_fields
                ),
                remedy: "check the magnetometer and its driver, or leave it out: `--topic magnetometer=none`".into(),
            });
        }
        let samples = inertial(source)?;
        settings.gyro_range = match request.gyro_range {
            GyroRange::AsSeen => gyro_range(&samples),
            GyroRange::Unlimited => None,
            GyroRange::Of(range) => Some(range),
        };
        if let (GyroRange::AsSeen, Some(range)) = (request.gyro_range, settings.gyro_range) {
            let degrees = range.to_degrees();
            warnings.push(Warning {
                code: "gyro_saturates",
                message: format!(
                    "a gyro stays at {degrees:.0} °/s again and again, which is taken for the end of its range: how the body turned \
                     then is not known, and the covariance says so"
                ),
                remedy: "choose a larger range of the gyros; if the body did turn so steadily: `--gyro-range none`".into(),
            });
        }
        Ok(OrientationPlan {
            settings,
            noise: noise_report(from, grade, &noise, &stated, block),
            warnings,
            request,
            declination: config.alignment.declination_deg.map(f64::to_radians),
            fields: survey.fields,
            origin,
            planning_s: begin.elapsed().as_secs_f64(),
        })
    }

    /// What headings count from.
    pub fn heading_reference(&self) -> HeadingReference {
        match (self.fields, self.declination) {
            (0, _) => HeadingReference::Start,
            (_, Some(_)) => HeadingReference::TrueNorth,
            (_, None) => HeadingReference::MagneticNorth,
        }
    }

    /// What goes into the metadata of the output.
    pub fn metadata(&self) -> BTreeMap<String, String> {
        let heading = match self.heading_reference() {
            HeadingReference::MagneticNorth => "magnetic north",
            HeadingReference::TrueNorth => "true north",
            HeadingReference::Start => "start",
        };
        BTreeMap::from([
            (METADATA_T0.to_owned(), self.origin.0.to_string()),
            ("heading_reference".to_owned(), heading.to_owned()),
            ("smoothed".to_owned(), self.request.smooth.to_string()),
            ("noise".to_owned(), self.noise.config.clone()),
        ])
    }

    /// Find the orientation at every sample, and give it to `each`.
    ///
    /// # Errors
    /// Those of reading and of `each`.
    pub fn execute(
        &self,
        source: &(impl Source + ?Sized),
        mut each: impl FnMut(&OrientationEpoch) -> Result<(), LogError>,
    ) -> Result<OrientationReport, RunError> {
        let begin = Instant::now();
        let mut tally = Tally::new(self);
        let magnetometer;
        if self.request.smooth {
            let mut smoother = Smoother::new(self.settings)?;
            let mut measured = VecDeque::new();
            drive(source, &mut tally, &mut smoother, |_, sample, epoch| {
                if epoch.is_some() {
                    measured.push_back(*sample);
                }
                Ok(())
            })?;
            magnetometer = Magnetometer::of(smoother.filter());
            for (epoch, sample) in smoother.finish().iter().zip(measured) {
                each(&tally.take(epoch, &sample))?;
            }
        } else {
            let mut filter = Ahrs::new(self.settings)?;
            drive(
                source,
                &mut tally,
                &mut filter,
                |tally, sample, epoch| match epoch {
                    Some(epoch) => each(&tally.take(&epoch, sample)),
                    None => Ok(()),
                },
            )?;
            magnetometer = Magnetometer::of(&filter);
        }
        let elapsed_s = begin.elapsed().as_secs_f64() + self.planning_s;
        Ok(tally.report(self, magnetometer, elapsed_s))
    }
}

/// The two forms of the filter.
trait Filter {
    fn field(&mut self, field: &MagneticField) -> Result<(), CoreError>;
    fn step(&mut self, sample: &ImuSample) -> Result<Option<AhrsEpoch>, CoreError>;
}

impl Filter for Ahrs {
    fn field(&mut self, field: &MagneticField) -> Result<(), CoreError> {
        Ahrs::field(self, field)
    }

    fn step(&mut self, sample: &ImuSample) -> Result<Option<AhrsEpoch>, CoreError> {
        Ahrs::step(self, sample)
    }
}

impl Filter for Smoother {
    fn field(&mut self, field: &MagneticField) -> Result<(), CoreError> {
        Smoother::field(self, field)
    }

    fn step(&mut self, sample: &ImuSample) -> Result<Option<AhrsEpoch>, CoreError> {
        Smoother::step(self, sample)
    }
}

/// Give all samples to the filter; what it refuses is counted.
fn drive(
    source: &(impl Source + ?Sized),
    tally: &mut Tally,
    filter: &mut impl Filter,
    mut each: impl FnMut(&mut Tally, &ImuSample, Option<AhrsEpoch>) -> Result<(), LogError>,
) -> Result<(), RunError> {
    let mut last: Option<Time> = None;
    for sample in source.samples()? {
        let sample = match sample? {
            Sample::Magnetic(field) => {
                tally.fields += usize::from(filter.field(&field).is_ok());
                continue;
            }
            Sample::Imu(sample) => sample,
            Sample::ImuIncrement(increment) => {
                // The interval of the first one is not known.
                let Some(last) = last.replace(increment.time) else {
                    continue;
                };
                let rate = 1.0 / increment.time.since(last);
                ImuSample {
                    time: increment.time,
                    angular_rate_b: increment.angle_b * rate,
                    specific_force_b: increment.velocity_b * rate,
                }
            }
            _ => continue,
        };
        match filter.step(&sample) {
            Ok(epoch) => {
                tally.samples += 1;
                tally.span = Some(tally.span.map_or((sample.time, sample.time), |(begin, _)| {
                    (begin, sample.time)
                }));
                each(tally, &sample, epoch)?;
            }
            Err(CoreError::NotFinite { .. } | CoreError::ImuBackward { .. }) => tally.dropped += 1,
            Err(other) => return Err(other.into()),
        }
        last = last.max(Some(sample.time));
    }
    Ok(())
}

/// What the filter found of the magnetometer.
#[derive(Clone, Copy)]
struct Magnetometer {
    delay_s: [f64; 2],
    offset_share: f64,
    changes: u32,
}

impl Magnetometer {
    fn of(filter: &Ahrs) -> Option<Self> {
        let (delay, sigma) = filter.magnetometer_delay()?;
        Some(Magnetometer {
            delay_s: [delay, sigma],
            offset_share: filter.magnetometer_offset_share()?,
            changes: filter.field_changes(),
        })
    }

    /// A magnetometer whose field does not turn as the body does: headings by it are worth less than they state.
    fn doubt(&self, duration: f64) -> Option<Warning> {
        let often = f64::from(self.changes) > (MANY_CHANGES * duration).max(10.0);
        let large = self.offset_share > LARGE_OFFSET;
        (often || large).then(|| Warning {
            code: "magnetometer_doubtful",
            message: format!(
                "the field that turns with the body is {:.0} % of the field, and the field became another one {} times: \
                 headings may be off by more than they state",
                1e2 * self.offset_share,
                self.changes
            ),
            remedy: "calibrate the magnetometer (hard iron), check that its axes are those of the gyros, or leave it out: \
                     `--topic magnetometer=none`"
                .into(),
        })
    }
}

/// What is counted on the way.
struct Tally {
    to_north: Option<(UnitQuaternion<f64>, Matrix3<f64>)>,
    samples: usize,
    dropped: usize,
    fields: usize,
    span: Option<(Time, Time)>,
    epochs: usize,
    last: Option<AhrsEpoch>,
    rest_s: f64,
    saturated_s: f64,
}

impl Tally {
    fn new(plan: &OrientationPlan) -> Self {
        let to_north = plan.declination.filter(|_| plan.fields > 0).map(|angle| {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            (turn, turn.to_rotation_matrix().into_inner())
        });
        Tally {
            to_north,
            samples: 0,
            dropped: 0,
            fields: 0,
            span: None,
            epochs: 0,
            last: None,
            rest_s: 0.0,
            saturated_s: 0.0,
        }
    }

    /// An orientation of the filter against the north that is asked for.
    fn take(&mut self, epoch: &AhrsEpoch, sample: &ImuSample) -> OrientationEpoch {
        let mut epoch = *epoch;
        if let Some((turn, matrix)) = self.to_north.filter(|_| epoch.magnetic) {
            epoch.attitude = turn * epoch.attitude;
            epoch.covariance = matrix * epoch.covariance * matrix.transpose();
        }
        if let Some(last) = self.last {
            let step = epoch.time.since(last.time);
            self.rest_s += if epoch.rests { step } else { 0.0 };
            self.saturated_s += if epoch.saturated { step } else { 0.0 };
        }
        self.last = Some(epoch);
        self.epochs += 1;
        OrientationEpoch {
            time: epoch.time,
            q_nb: epoch.attitude,
            covariance_n: epoch.covariance,
            angular_rate_b: sample.angular_rate_b,
            specific_force_b: sample.specific_force_b,
        }
    }

    fn report(
        self,
        plan: &OrientationPlan,
        magnetometer: Option<Magnetometer>,
        elapsed_s: f64,
    ) -> OrientationReport {
        let mut warnings = plan.warnings.clone();
        if self.dropped > 0 {
            warnings.push(Warning {
                code: "samples_left_out",
                message: format!(
                    "{} inertial samples are not finite or not in the order of time, and left out",
                    self.dropped
                ),
                remedy: "check the driver that gives them, and with `insnav info` the clocks"
                    .into(),
            });
        }
        if self.epochs == 0 {
            warnings.push(Warning {
                code: "no_orientation",
                message: format!(
                    "{} samples are too few, or have too many gaps, to level from",
                    self.samples
                ),
                remedy: "give a longer log; `insnav info` tells its gaps".into(),
            });
        }
        let duration = self.span.map_or(0.0, |(begin, end)| end.since(begin));
        warnings.extend(magnetometer.and_then(|m| m.doubt(duration)));
        OrientationReport {
            imu_samples: self.samples,
            dropped: self.dropped,
            magnetic_fields: self.fields,
            duration_s: duration,
            elapsed_s,
            smoothed: plan.request.smooth,
            heading_reference: plan.heading_reference(),
            noise: plan.noise.clone(),
            epochs: self.epochs,
            rest_s: self.rest_s,
            gyro_range_deg_per_s: plan.settings.gyro_range.map(f64::to_degrees),
            saturated_s: self.saturated_s,
            gyro_bias_deg_per_s: self
                .last
                .map_or([0.0; 3], |e| e.gyro_bias.map(f64::to_degrees).into()),
            magnetometer_delay_s: magnetometer.map(|m| m.delay_s),
            magnetometer_offset_share: magnetometer.map(|m| m.offset_share),
            field_changes: magnetometer.map_or(0, |m| m.changes),
            last: self.last.map(|epoch| {
                let angles = Euler::from_quaternion(&epoch.attitude);
                let sigma = epoch.covariance.diagonal().map(|v| v.sqrt().to_degrees());
                FinalOrientation {
                    roll_deg: angles.roll.to_degrees(),
                    pitch_deg: angles.pitch.to_degrees(),
                    heading_deg: angles.heading_deg(),
                    sigma_tilt_deg: sigma.x.max(sigma.y),
                    sigma_heading_deg: sigma.z,
                }
            }),
            warnings,
        }
    }
}

/// The rates of a source.
fn inertial(source: &(impl Source + ?Sized)) -> Result<Vec<ImuSample>, RunError> {
    let readings = noise_readings(source, Time(0), None)?.readings;
    Ok(readings
        .iter()
        .map(|r| ImuSample {
            time: r.time,
            angular_rate_b: r.angular_rate_b,
            specific_force_b: r.specific_force_b,
        })
        .collect())
}

fn noise_report(
    source: &'static str,
    grade: ImuGrade,
    noise: &ImuNoise,
    stated: &NoiseConfig,
    block: Option<String>,
) -> OrientationNoiseReport {
    let arw = noise.gyro_white.to_degrees() * 60.0;
    let vrw = noise.accel_white * 60.0;
    let bias = noise.gyro_bias_sigma.to_degrees() * 3600.0;
    let magnetometer = stated.magnetometer_microtesla;
    let config = block.unwrap_or_else(|| {
        let mut text = format!(
            "[noise]\ngyro_arw_deg_per_sqrt_hour = {arw:?}\naccel_vrw_m_per_s_per_sqrt_hour = {vrw:?}\n\
             gyro_bias_deg_per_hour = {bias:?}\naccel_bias_mg = {:?}\ngyro_bias_tau_s = {:?}\naccel_bias_tau_s = {:?}\n",
            noise.accel_bias_sigma / STANDARD_GRAVITY * 1e3,
            noise.gyro_bias_tau,
            noise.accel_bias_tau
        );
        if let Some(microtesla) = magnetometer {
            text.push_str(&format!("magnetometer_microtesla = {microtesla:?}\n"));
        }
        text
    });
    OrientationNoiseReport {
        source,
        grade: grade.name(),
        gyro_arw_deg_per_sqrt_hour: arw,
        accel_vrw_m_per_s_per_sqrt_hour: vrw,
        gyro_bias_deg_per_hour: bias,
        gyro_bias_tau_s: noise.gyro_bias_tau,
        magnetometer_microtesla: magnetometer,
        config,
    }
}
