//! What a run will do, decided before it begins: everything that the settings leave open is chosen from the data here.

use super::RunError;
use super::adapt::adapt;
use super::clocks::{Clocks, find_clocks};
use super::known_start::KnownStart;
use super::oddities::{findings_of, lever_arm_unknown, refuse_fatal};
use super::report::{AdaptedReport, ImuOnlyReport, Warning};
use super::saved::SavedRun;
use super::source::Source;
use super::standing::{
    check_mode, check_window, known_standing, outside, speeds_not_finite, state_noise_at_rest,
};
use super::survey::Survey;
use super::wheels::{decide, watch};
use super::withhold::{Withhold, Withholding};
use super::without_gnss;
use crate::findings;
use crate::log::METADATA_T0;
use crate::{Finding, Mounting, SinkOptions, config_text, config_text_with};
use insnav_core::config::{Config, NoiseConfig, Nonholonomic, VehicleKind};
use insnav_core::earth::Geodetic;
use insnav_core::imu::{ImuGrade, ImuNoise};
use insnav_core::metrics::Stop;
use insnav_core::navigator::Navigator;
use insnav_core::noise_floor::NoiseFloor;
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use insnav_core::wheeled::WheelReport;
use std::time::Instant;

/// Choices of a run that are not settings of the navigator.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunOptions {
    /// Find both clock offsets in the data and use them.
    pub time_offset_auto: bool,
    /// Look for clock offsets as thoroughly as if they were to be used.
    pub thorough_clocks: bool,
    /// Do not look for clock offsets at all; else they are looked for and, when large, warned of.
    pub ignore_clocks: bool,
    /// Fixes to keep from the navigator.
    pub withhold: Withhold,
    /// Begin at a known state instead of looking for one in the data. A later part of a drive has begun already.
    pub start: Option<KnownStart>,
    /// Another part of the drive follows: what is declared beyond the end of this one is meant for that.
    pub more_follows: bool,
}

/// A run about to begin.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Settings, complete.
    pub config: Config,
    /// Zero of all seconds.
    pub origin: Time,
    /// Class of the inertial unit.
    pub grade: ImuGrade,
    /// Whether it was picked from the data.
    pub grade_picked: bool,
    /// The topic that declares standing, where one is named.
    pub standing_topic: Option<String>,
    /// How the IMU is mounted, where the log's transforms were taken for it.
    pub mounting: Option<Mounting>,
    /// What is known of the clocks.
    pub clocks: Clocks,
    /// How well the vehicle moves where its wheels point, where that was looked at.
    pub wheels: Option<WheelReport>,
    /// What the data hold.
    pub survey: Survey,
    /// Whether the lever arm is known; else zero is taken.
    pub lever_arm_known: bool,
    /// What is wrong with the data.
    pub findings: Vec<Finding>,
    /// What the user should know, the findings among it.
    pub warnings: Vec<Warning>,
    pub(super) withhold: Withhold,
    /// Stamps of the fixes of parts before this one, where withholding counts them.
    pub(super) epochs_before: Vec<Time>,
    /// The settings as they were given.
    pub(super) given: String,
    start: Option<(Time, KnownStart)>,
    /// Of a run without GNSS, what it begins with.
    pub imu_only: Option<ImuOnlyReport>,
    /// What became of each noise that was to be adapted.
    pub adaptation: Vec<AdaptedReport>,
    pub(super) planning_s: f64,
}

impl Plan {
    /// Look at a source and choose.
    pub fn make(
        source: &(impl Source + ?Sized),
        config: &Config,
        options: &RunOptions,
    ) -> Result<Self, RunError> {
        let begin = Instant::now();
        source.check()?;
        let (given, mut config) = (config_text(config), *config);
        config.validate()?;
        if !config.gnss.used {
            without_gnss::refuse_what_needs_it(options)?;
            if options.start.is_none() {
                without_gnss::look_for_rest(source, &config)?;
            }
        }
        let mut survey = Survey::of(source)?;
        let gnss_in_arrays = !config.gnss.used && survey.forget_gnss();
        check(&survey, config.gnss.used)?;
        let (first, end) = survey.imu_span.ok_or(RunError::NoImu)?;
        let span = end.since(first);
        check_window(&config, span)?;
        let origin = source.origin()?.unwrap_or(first);
        let facts = source.facts()?;
        let findings = findings_of(&facts, &survey, &config, origin, &options.withhold);
        refuse_fatal(&findings)?;
        let imu_only = ImuOnlyReport::of(&config, gnss_in_arrays, facts.gnss_left_out);
        let mut warnings: Vec<Warning> = facts.recovered.into_iter().collect();
        warnings.extend(findings::warnings(&findings));
        warnings.extend(late_fixes(&survey));
        warnings.extend(check_mode(&config));
        let standing_topic = source.standing_topic();
        let told = speeds_not_finite(&survey, standing_topic.as_deref(), origin);
        warnings.extend(told);

        let grade_picked = config.imu.grade.is_none();
        // A log of a few seconds tells nothing: the worst class is then the honest one.
        let grade = config.imu.grade.unwrap_or_else(|| {
            let floor = survey.noise_floor.as_ref();
            floor.map_or(ImuGrade::Consumer, NoiseFloor::grade)
        });
        config.imu.grade = Some(grade);
        if let Some(floor) = &survey.noise_floor {
            let epochs = survey.positions.iter().map(|p| p.time).collect();
            let withholding = Withholding::new(options.withhold.clone(), origin, epochs);
            let standing = known_standing(&survey, &withholding, &config);
            let class = config.noise.over(grade);
            // Before the noise under way takes the place of what the class says.
            state_noise_at_rest(&mut config, &class, floor, span, standing);
            state_white_noise(&mut config.noise, &grade.noise(), floor);
        }
        let mut lever_arm_known = true;
        if config.gnss.lever_arm_b_m.is_none() {
            let known = source.lever_arm_b()?;
            lever_arm_known = known.is_some();
            if known.is_none() && config.gnss.used {
                warnings.push(lever_arm_unknown());
            }
            config.gnss.lever_arm_b_m = Some(known.unwrap_or_default().into());
        }

        let mounting = source.mounting()?;
        if let Some(Mounting { rpy_deg, .. }) = &mounting {
            // The settings are forward-right-down, where the same rotation has pitch and yaw reversed.
            let [roll, pitch, yaw] = *rpy_deg;
            config.imu.mounting_rpy_deg = [roll, -pitch, -yaw];
        }

        let mut plan = Plan {
            config,
            origin,
            grade,
            grade_picked,
            standing_topic,
            mounting,
            clocks: Clocks::default(),
            wheels: None,
            survey,
            lever_arm_known,
            findings,
            warnings,
            withhold: options.withhold.clone(),
            epochs_before: Vec::new(),
            given,
            start: None,
            imu_only,
            adaptation: Vec::new(),
            planning_s: 0.0,
        };
        let withholding = plan.withholding();
        let positions = &plan.survey.positions;
        if plan.config.gnss.used && positions.iter().all(|p| withholding.takes(p.time)) {
            let positions = positions.len();
            return Err(RunError::AllWithheld { positions });
        }
        if !options.ignore_clocks && plan.config.gnss.used {
            let clocks = find_clocks(
                source,
                &plan,
                (options.time_offset_auto, options.thorough_clocks),
            )?;
            plan.take_clocks(clocks, options.time_offset_auto);
        }
        if let Some(start) = options.start {
            plan.start = Some((plan.start_time(&start)?, start));
        }
        let vehicle = plan.config.vehicle;
        if vehicle.nonholonomic == Nonholonomic::Auto && vehicle.kind == VehicleKind::Car {
            if plan.config.gnss.used {
                plan.wheels = watch(source, &plan)?;
            }
            let told = decide(&mut plan.config, plan.wheels.as_ref());
            plan.warnings.extend(told);
        }
        adapt(source, &mut plan)?;
        let offset = plan.config.gnss.time_offset_s;
        let span = (first.plus(offset), end.plus(offset));
        let told = outside(&plan.config, origin, span, options.more_follows);
        plan.warnings.extend(told);
        let told = plan.withhold.outside(origin, span, options.more_follows);
        plan.warnings.extend(told);
        plan.planning_s = begin.elapsed().as_secs_f64();
        Ok(plan)
    }

    /// As [`Plan::make`], with everything that was chosen in the part before.
    pub(super) fn go_on(
        source: &(impl Source + ?Sized),
        saved: &SavedRun,
        options: &RunOptions,
    ) -> Result<Self, RunError> {
        let begin = Instant::now();
        let config = saved.complete_config()?;
        let mut survey = Survey::of(source)?;
        let gnss_in_arrays = !config.gnss.used && survey.forget_gnss();
        let (_, end) = survey.imu_span.ok_or(RunError::NoImu)?;
        let facts = source.facts()?;
        // What the motion shows was judged with the first part.
        let findings = findings::of_topics(&facts, saved.origin);
        let imu_only = ImuOnlyReport::of(&config, gnss_in_arrays, facts.gnss_left_out);
        let mut warnings: Vec<Warning> = facts.recovered.into_iter().collect();
        warnings.extend(findings::warnings(&findings));
        warnings.extend(late_fixes(&survey));
        let standing_topic = source.standing_topic();
        let told = speeds_not_finite(&survey, standing_topic.as_deref(), saved.origin);
        warnings.extend(told);
        // What lies before this part was for the parts before it.
        let span = (saved.origin, end.plus(config.gnss.time_offset_s));
        let told = outside(&config, saved.origin, span, options.more_follows);
        warnings.extend(told);
        let told = options
            .withhold
            .outside(saved.origin, span, options.more_follows);
        warnings.extend(told);
        Ok(Plan {
            config,
            origin: saved.origin,
            grade: saved.grade,
            grade_picked: saved.grade_picked,
            standing_topic,
            mounting: saved.mounting.clone(),
            clocks: saved.clocks,
            wheels: saved.wheels,
            survey,
            lever_arm_known: true,
            findings,
            warnings,
            withhold: options.withhold.clone(),
            epochs_before: saved.epochs.clone(),
            given: saved.given.clone(),
            start: None,
            imu_only,
            adaptation: Vec::new(),
            planning_s: begin.elapsed().as_secs_f64(),
        })
    }

    /// The noise of the inertial unit.
    pub fn noise(&self) -> ImuNoise {
        self.config.noise.over(self.grade)
    }

    /// A navigator that has seen nothing yet.
    ///
    /// # Errors
    /// `Config` for a setting outside its range.
    pub(super) fn navigator(&self) -> Result<Navigator, RunError> {
        let noise = self.noise();
        let mut navigator = match &self.start {
            Some((time, start)) => start.navigator(&self.config, noise, *time)?,
            None => Navigator::new(&self.config, noise)?,
        };
        navigator.set_origin(self.origin);
        Ok(navigator)
    }

    /// The settings as they are used, TOML: what [`crate::parse_config`] and [`crate::LogSettings`] read back.
    pub fn config_text(&self) -> String {
        config_text_with(&self.config, self.standing_topic.as_deref())
    }

    /// Whether a fix lies before a known start, which has it inside already.
    pub(super) fn is_before_start(&self, sample: &Sample) -> bool {
        let begin = self.start.map(|(time, _)| time);
        !sample.is_inertial() && begin.is_some_and(|begin| sample.time() < begin)
    }

    /// The instant of a known start, on the navigator's clock.
    fn start_time(&self, start: &KnownStart) -> Result<Time, RunError> {
        let offset = self.config.gnss.time_offset_s;
        let (first, last) = self.survey.imu_span.ok_or(RunError::NoImu)?;
        let (first, last) = (first.plus(offset), last.plus(offset));
        let time = start.time_s.map_or(first, |s| self.origin.plus(s));
        if time < first || time > last {
            return Err(RunError::StartOutside {
                time: time.since(self.origin),
                imu_begin: first.since(self.origin),
                imu_end: last.since(self.origin),
            });
        }
        Ok(time)
    }

    /// Stops, by GNSS speed below 0.1 m/s, at the instants at which the velocities were valid.
    pub fn stops(&self) -> Vec<Stop> {
        let lag = self.config.gnss.velocity_lag_s;
        let moved = |s: &Stop| Stop {
            begin: s.begin.plus(-lag),
            end: s.end.plus(-lag),
        };
        self.survey.stops.iter().map(moved).collect()
    }

    /// How to write the solution: rate and point as the settings say, the map around the first fix unless they name another
    /// origin; the settings, the origin of time and what was withheld go into the metadata.
    pub fn sink_options(&self) -> SinkOptions {
        let output = &self.config.output;
        let origin = match output.origin {
            Some([latitude, longitude, height]) => {
                Some(Geodetic::from_degrees(latitude, longitude, height))
            }
            None => match (self.config.place_without_gnss(), &self.start) {
                (None, _) => self.survey.positions.first().map(|p| p.position),
                (Some(_), Some((_, start))) => Some(start.position),
                (Some((place, _)), None) => Some(place),
            },
        };
        let mut metadata = std::collections::BTreeMap::from([
            (METADATA_T0.to_owned(), self.origin.0.to_string()),
            ("config".to_owned(), self.config_text()),
        ]);
        if self.withhold != Withhold::Nothing {
            metadata.insert("withhold".into(), self.withhold.to_string());
        }
        SinkOptions {
            rate_hz: output.rate_hz,
            lever_arm_b_m: output.lever_arm_b_m,
            origin,
            metadata,
            ..SinkOptions::default()
        }
    }

    /// About how many epochs a sink with [`Plan::sink_options`] will get: for room set aside beforehand.
    pub fn epochs_expected(&self) -> usize {
        let rate = self.config.output.rate_hz;
        let seconds = self.survey.imu_span.map_or(0.0, |(a, b)| b.since(a));
        match rate > 0.0 {
            // A wrong clock must not ask for more than there can be.
            true => ((seconds * rate) as usize + 2).min(self.survey.imu_samples),
            false => self.survey.imu_samples,
        }
    }

    pub(super) fn withholding(&self) -> Withholding {
        Withholding::new(self.withhold.clone(), self.origin, self.epochs())
    }

    /// Stamps of all fixes of the drive so far.
    pub(super) fn epochs(&self) -> Vec<Time> {
        let own = self.survey.positions.iter().map(|p| p.time);
        self.epochs_before.iter().copied().chain(own).collect()
    }

    fn take_clocks(&mut self, mut clocks: Clocks, auto: bool) {
        if auto {
            clocks.use_what_was_found(&mut self.config);
            let has_velocity = !self.survey.velocities.is_empty();
            self.warnings.extend(clocks.warnings(has_velocity));
        } else {
            let found = findings::of_clocks(
                clocks.offset_found,
                clocks.lag_found,
                &self.config,
                &self.findings,
            );
            self.warnings.extend(findings::warnings(&found));
            self.findings.extend(found);
        }
        self.clocks = clocks;
    }
}

/// Where the settings leave white noise open: that of the class or what the log shows under way, whichever is more.
fn state_white_noise(settings: &mut NoiseConfig, class: &ImuNoise, floor: &NoiseFloor) {
    let gyro = class.gyro_white.max(floor.gyro_shaken);
    let accel = class.accel_white.max(floor.accel_shaken);
    settings
        .gyro_arw_deg_per_sqrt_hour
        .get_or_insert(gyro.to_degrees() * 60.0);
    settings
        .accel_vrw_m_per_s_per_sqrt_hour
        .get_or_insert(accel * 60.0);
}

/// Fixes that are lost since they were recorded so late.
fn late_fixes(survey: &Survey) -> Option<Warning> {
    (survey.late > 0).then(|| Warning {
        code: "late_aiding",
        message: format!(
            "{} fixes were recorded more than a second after their stamps, when the samples of their time were used already",
            survey.late
        ),
        remedy: "check the receiver's latency and clock with `insnav info`; if its stamps are wrong, `--time log` takes the recorder's".into(),
    })
}

/// What makes a run impossible.
fn check(survey: &Survey, gnss: bool) -> Result<(), RunError> {
    let (first, last) = survey.imu_span.ok_or(RunError::NoImu)?;
    if 2 * survey.imu_not_finite > survey.imu_samples {
        return Err(RunError::ImuNotFinite {
            not_finite: survey.imu_not_finite,
            samples: survey.imu_samples,
        });
    }
    if !gnss {
        return Ok(());
    }
    let (Some(a), Some(b)) = (survey.positions.first(), survey.positions.last()) else {
        return Err(RunError::NoGnss {
            dropped_hint: if survey.late > 0 {
                "all of them were recorded later after their stamps than a reader waits"
            } else {
                "no fix with a valid position"
            },
        });
    };
    if !survey.overlaps() {
        return Err(RunError::NoOverlap {
            imu_begin: first.seconds(),
            imu_end: last.seconds(),
            gnss_begin: a.time.seconds(),
            gnss_end: b.time.seconds(),
        });
    }
    Ok(())
}
