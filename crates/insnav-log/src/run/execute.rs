//! The one loop.

use super::RunError;
use super::compass::compass;
use super::doubts::doubts;
use super::plan::Plan;
use super::report::{
    Calibrated, Estimate, NoiseReport, RunReport, ScaleReport, StopReport, Warning,
};
use super::saved::SavedRun;
use super::source::{SolutionSink, Source};
use super::tally::{Tally, Totals};
use super::withhold::{Withhold, Withholding};
use crate::config_text;
use insnav_core::alignment::HeadingSource;
use insnav_core::config::{Config, SigmaScale, StationaryMode, VehicleKind};
use insnav_core::error::Error as CoreError;
use insnav_core::navigator::{Navigator, longest_bridged};
use insnav_core::sample::Sample;
use std::path::PathBuf;
use std::time::Instant;

/// Above this standard deviation of the heading at the end (degrees) the user is told that it is not known.
const VAGUE_HEADING_DEG: f64 = 20.0;
/// Gyros whose biases are of this size hide the Earth's rate, °/h.
const HIDES_THE_EARTH_DEG_PER_HOUR: f64 = 100.0;

impl Plan {
    /// Run the navigator over the source, into the sink.
    pub fn execute<S: SolutionSink>(
        &self,
        source: &(impl Source + ?Sized),
        sink: &mut S,
    ) -> Result<RunReport, RunError> {
        let (report, _) = self.execute_part(source, sink, None, false)?;
        Ok(report)
    }

    /// Run over one part of a drive: from where another part stopped, if `from` is given (with the plan that
    /// [`Plan::resume`] made of it); with `save`, stop in the middle of everything and return what the next part needs.
    ///
    /// Then the last seconds of the source are not in the sink yet: they come with the next part.
    pub fn execute_part<S: SolutionSink>(
        &self,
        source: &(impl Source + ?Sized),
        sink: &mut S,
        from: Option<&SavedRun>,
        save: bool,
    ) -> Result<(RunReport, Option<SavedRun>), RunError> {
        let begin = Instant::now();
        let withholding = self.withholding();
        let mut navigator = match from {
            Some(saved) => saved.navigator.clone(),
            None => self.navigator()?,
        };
        if let Some(state) = from.and_then(|saved| saved.sink.as_ref()) {
            sink.resume(state);
        }
        let before = from.map_or_else(Totals::default, |saved| saved.totals.clone());
        let mut tally = {
            let on_foot = self.config.vehicle.kind == VehicleKind::Foot;
            Tally::new(sink, self.origin, on_foot, before)
        };
        let mut samples = source.stream(from.map(|saved| &saved.reader), save)?;
        for sample in &mut samples {
            let sample = sample?;
            tally.totals.imu_samples += usize::from(sample.is_inertial());
            if is_withheld(&withholding, &sample, self.config.gnss.velocity_lag_s) {
                if let Sample::GnssPosition(fix) = &sample {
                    tally.totals.withheld += 1;
                    tally.sink().withheld(fix);
                }
                continue;
            }
            if self.is_before_start(&sample) {
                continue;
            }
            self.hear_speed(&sample, &mut tally.totals);
            if let Err(error) = navigator.step(&sample, &mut tally) {
                tally.totals.unusable.push(&error);
            }
            if let Some(error) = tally.sink().failure() {
                return Err(error);
            }
        }
        let mut saved = None;
        let scales;
        if save {
            scales = self.scales(&navigator);
            saved = Some(SavedRun {
                given: self.given.clone(),
                config: config_text(&self.config),
                reading: source.reading(),
                withhold: self.withhold.to_string(),
                epochs: if matches!(self.withhold, Withhold::Every(_)) {
                    self.epochs()
                } else {
                    Vec::new()
                },
                origin: self.origin,
                grade: self.grade,
                grade_picked: self.grade_picked,
                clocks: self.clocks,
                wheels: self.wheels,
                mounting: self.mounting.clone(),
                reader: samples.state(),
                path: PathBuf::new(),
                navigator: navigator.clone(),
                totals: tally.totals.clone(),
                sink: tally.sink().state(),
            });
        } else {
            match navigator.finish(&mut tally) {
                // Nothing came out at all.
                Err(error @ CoreError::NotStarted { .. }) => return Err(error.into()),
                Err(error) => tally.totals.unusable.push(&error),
                Ok(()) => {}
            }
            scales = self.scales(&navigator);
        }
        if let Some(error) = tally.sink().failure() {
            return Err(error);
        }
        let mut warnings = self.warnings.clone();
        warnings.extend(tally.totals.unusable.warning());
        warnings.extend(findings(&tally, self.imu_only.is_some(), &self.config));
        warnings.extend(compass(
            tally.totals.alignment.as_ref(),
            &self.survey,
            &self.config.alignment,
        ));
        warnings.extend(heading_matters(&tally, self.noise().gyro_bias_sigma));
        warnings.extend(doubts(&tally.aiding(), &tally.totals.resets, &scales));
        let mut last = tally.last();
        if let (Some(last), Some(way), Some(_)) = (&mut last, tally.since_start(), &self.imu_only) {
            last.closure_horizontal_m = Some(way.xy().norm());
            last.closure_height_m = Some(-way.z);
        }
        let report = RunReport {
            imu_samples: tally.totals.imu_samples,
            duration_s: tally.duration_s(),
            elapsed_s: begin.elapsed().as_secs_f64() + self.planning_s,
            distance_m: tally.totals.distance_m,
            time_offset_s: self
                .clocks
                .offset_used
                .unwrap_or(given(self.config.gnss.time_offset_s)),
            gnss_velocity_lag_s: self
                .clocks
                .lag_used
                .unwrap_or(given(self.config.gnss.velocity_lag_s)),
            time_offset_found_s: self.clocks.offset_found,
            gnss_velocity_lag_found_s: self.clocks.lag_found,
            imu_grade: self.grade,
            imu_grade_picked: self.grade_picked,
            gyro_arw_deg_per_sqrt_hour: self.noise().gyro_white.to_degrees() * 60.0,
            accel_vrw_m_per_s_per_sqrt_hour: self.noise().accel_white * 60.0,
            rest_gyro_arw_deg_per_sqrt_hour: self.config.stationary.gyro_arw_deg_per_sqrt_hour,
            rest_accel_vrw_m_per_s_per_sqrt_hour: self
                .config
                .stationary
                .accel_vrw_m_per_s_per_sqrt_hour,
            imu_noise: self.survey.noise_floor.as_ref().map(NoiseReport::from),
            noise_adaptation: self.adaptation.clone(),
            lever_arm_b_m: self.config.gnss.lever_arm_b_m.unwrap_or_default(),
            imu_mounting: self.mounting.clone(),
            imu_only: self.imu_only.clone(),
            alignment: tally.totals.alignment,
            stops: tally.stops(),
            stances: tally.stances(),
            aiding: tally.aiding(),
            gnss_sigma_scale: scales[0],
            gnss_velocity_sigma_scale: scales[1],
            position_resets: tally.totals.resets.clone(),
            unusable: tally.totals.unusable.count,
            withheld: tally.totals.withheld,
            withhold: (self.withhold != Withhold::Nothing).then(|| self.withhold.to_string()),
            last,
            wheels: self.wheels,
            calibration: navigator
                .filter()
                .map(|f| f.optional_states().map(Calibrated::of).collect())
                .unwrap_or_default(),
            warnings,
            config: self.config_text(),
        };
        Ok((report, saved))
    }

    /// Note what receiver and wheels say of the speed. On a foot every stance is a stop of its own.
    fn hear_speed(&self, sample: &Sample, totals: &mut Totals) {
        let (gnss, limit) = (&self.config.gnss, self.config.stationary.speed_m_per_s);
        if self.config.vehicle.kind == VehicleKind::Foot {
            return;
        }
        match sample {
            Sample::GnssVelocity(v) if gnss.used => {
                let time = v.time.plus(-gnss.velocity_lag_s);
                totals.slow.hear(time, v.velocity_n.xy().norm(), limit);
            }
            Sample::Speed(s) => totals.slow.hear(s.time, s.speed.abs(), limit),
            _ => {}
        }
    }

    /// Factors on stated sigmas of position and velocity as the navigator uses them now.
    fn scales(&self, navigator: &Navigator) -> [ScaleReport; 2] {
        let report = |[horizontal, vertical]: [f64; 2], setting: SigmaScale| ScaleReport {
            horizontal,
            vertical,
            learnt: setting == SigmaScale::Auto,
        };
        let gnss = &self.config.gnss;
        [
            report(navigator.gnss_sigma_scale(), gnss.sigma_scale),
            report(
                navigator.gnss_velocity_sigma_scale(),
                gnss.velocity_sigma_scale,
            ),
        ]
    }
}

fn given(value: f64) -> Estimate {
    Estimate { value, sigma: None }
}

/// Whether a sample is a fix that the navigator must not see.
pub(super) fn is_withheld(withholding: &Withholding, sample: &Sample, velocity_lag: f64) -> bool {
    let time = sample.time();
    match sample {
        Sample::GnssPosition(_) => withholding.takes(time),
        Sample::GnssVelocity(_) => withholding.takes_velocity(time, velocity_lag),
        _ => false,
    }
}

/// Without a heading nobody knows about which axis the Earth turns; gyros that drift by less would show it.
fn heading_matters<S: SolutionSink>(tally: &Tally<'_, S>, gyro_bias: f64) -> Option<Warning> {
    let relative = |source| source == HeadingSource::Relative;
    tally
        .totals
        .alignment
        .filter(|a| relative(a.heading_source))?;
    let per_hour = gyro_bias.to_degrees() * 3600.0;
    (per_hour < HIDES_THE_EARTH_DEG_PER_HOUR).then(|| Warning {
        code: "heading_unknown",
        message: format!(
            "the gyros drift by {per_hour:.2} °/h, and without a heading the Earth's 15 °/h are about an unknown axis: sigmas are too small"
        ),
        remedy: "give the heading at the start with `--heading-deg`; gyros of 0.5 °/h and better find it themselves when the latitude is told (`--latitude-deg`) and the log begins with half a minute of rest".into(),
    })
}

/// Gyros whose mean at rest is not their bias: message and remedy.
fn coarse_gyros(stops: &[StopReport]) -> Option<(String, &'static str)> {
    let step = |s: &StopReport| s.gyro_step_deg_per_s.into_iter().fold(0.0, f64::max);
    let coarsest = stops.iter().map(step).fold(0.0, f64::max);
    if coarsest > 0.0 {
        return Some((
            format!(
                "the gyros' values come in steps of {coarsest:.3}°/s, coarser than their noise: the mean at rest is not their bias, whose sigma was widened"
            ),
            "let the driver publish the gyros at their full resolution",
        ));
    }
    let repeats = |axis: usize| stops.iter().any(|s| s.gyro_repeats[axis]);
    let those: Vec<&str> = (0..3)
        .filter(|k| repeats(*k))
        .map(|k| ["x", "y", "z"][k])
        .collect();
    (!those.is_empty()).then(|| {
        (
            format!(
                "gyro values repeat without any noise in stops ({}): their mean is not believed to be a bias",
                those.join(", ")
            ),
            "check that the driver measures these axes, at full resolution, and does not repeat old values",
        )
    })
}

/// What the run itself brought to light.
fn findings<S: SolutionSink>(
    tally: &Tally<'_, S>,
    without_gnss: bool,
    config: &Config,
) -> Vec<Warning> {
    let mode = config.stationary.mode;
    let bridged = longest_bridged(config.vehicle.kind);
    let mut found = Vec::new();
    let mut warn = |code, message: String, remedy: &str| {
        found.push(Warning {
            code,
            message,
            remedy: remedy.into(),
        })
    };
    let e = tally.totals.events;
    if e.imu_gaps > 0 {
        warn(
            "imu_gaps",
            format!(
                "{} in the inertial data, the longest {:.2} s, bridged with widened uncertainty{}",
                if e.imu_gaps == 1 {
                    "1 gap".into()
                } else {
                    format!("{} gaps", e.imu_gaps)
                },
                e.longest_gap_s,
                if without_gnss || e.longest_gap_s <= bridged {
                    String::new()
                } else {
                    format!(
                        "; where one was longer than {bridged} s the navigation started anew after it"
                    )
                }
            ),
            "record with a larger queue for the IMU topic",
        );
    }
    if e.too_late > 0 {
        warn(
            "late_aiding",
            format!(
                "{} {} came too late to be used",
                e.too_late,
                if without_gnss { "samples" } else { "fixes" }
            ),
            if without_gnss {
                "check the clocks of the topics that give them with `insnav info`"
            } else {
                "check the receiver's latency and clock with `insnav info`"
            },
        );
    }
    if e.duplicates > 0 {
        warn(
            "duplicate_imu",
            format!(
                "{} inertial samples repeat the stamp before them and were not used",
                e.duplicates
            ),
            "record the topic once only, and check the driver's stamps",
        );
    }
    if e.not_finite > 0 {
        warn(
            "not_finite",
            format!(
                "{} with NaN or infinity in {} not used, the first at {:.3} s: {}",
                samples(e.not_finite),
                if e.not_finite == 1 {
                    "it was"
                } else {
                    "them were"
                },
                e.first_not_finite_s,
                tally.totals.first_not_finite
            ),
            "check the driver",
        );
    }
    if e.impossible > 0 {
        warn(
            "impossible_values",
            format!(
                "{} with a value that cannot be {} not used, the first at {:.3} s: {}",
                samples(e.impossible),
                if e.impossible == 1 { "was" } else { "were" },
                e.first_impossible_s,
                tally.totals.first_impossible
            ),
            "check the driver that gives them",
        );
    }
    if e.not_fused > 0 {
        warn(
            "stop_not_fused",
            format!(
                "{} not looked at as a whole, as `stationary.mode` asks, but led through by zero velocities; the first, at {:.1} s: {}",
                match e.not_fused {
                    1 => "1 stop was".to_owned(),
                    n => format!("{n} stops were"),
                },
                e.first_not_fused_s,
                tally.totals.first_not_fused
            ),
            "the sigmas are those of zero velocities there: stand for longer where it matters",
        );
    }
    if e.flaps > 0 {
        warn(
            "stop_topic_flaps",
            format!(
                "standing was declared and taken back at once, {}, the first time at {:.1} s: not used",
                times(e.flaps),
                e.first_flap_s
            ),
            "look at the topic that declares it, or leave it out with `--topic standing=none`",
        );
    }
    if e.contradicted > 0 {
        warn(
            "stop_contradicted",
            format!(
                "standing was declared {} while the vehicle moves by the solution itself, the first time at {:.1} s: not used",
                times(e.contradicted),
                e.first_contradicted_s
            ),
            "check `--stop` and stationary.intervals_s, which count from the log's zero (t0), and the topic that declares standing",
        );
    }
    if let Some((message, remedy)) = coarse_gyros(&tally.stops()) {
        warn("gyro_quantised", message, remedy);
    }
    if let Some(until) = tally
        .totals
        .alignment
        .and_then(|a| a.rates_doubtful_until_s)
    {
        warn(
            "rest_doubtful",
            format!(
                "the mean rate of the gyros changed while the vehicle seemed to rest at the start, before {until:.0} s: which of it was a slow turn they do not tell, so that the sigma of their biases is as large as the change"
            ),
            "let the recording begin with rest in which nothing turns",
        );
    }
    let as_static = tally
        .stops()
        .iter()
        .filter(|s| s.mode == StationaryMode::Static)
        .count();
    if as_static > 0 && !matches!(mode, StationaryMode::Static | StationaryMode::Auto) {
        warn(
            "held_as_static",
            format!(
                "{as_static} of {} stops held as by `static`: the heading was not known then, and other modes would grow falsely sure of it",
                tally.stops().len()
            ),
            "give the heading with `--heading-deg`, or let the log begin with a stretch of driving",
        );
    }
    if let Some(a) = tally
        .totals
        .alignment
        .filter(|a| a.heading_source == HeadingSource::Unknown)
    {
        warn(
            "heading_unknown",
            format!(
                "no heading was found at the start (sigma {:.0}°)",
                a.sigma_heading_deg
            ),
            "give it with `--heading-deg`, or record a stretch of driving",
        );
    } else if let Some(last) = tally
        .last()
        .filter(|l| l.sigma_heading_deg > VAGUE_HEADING_DEG && !without_gnss)
    {
        warn(
            "heading_vague",
            format!(
                "the heading at the end is known to {:.0}° only",
                last.sigma_heading_deg
            ),
            "speed and turns make heading observable; give it at the start with `--heading-deg`",
        );
    }
    found
}

/// How often.
fn samples(n: usize) -> String {
    match n {
        1 => "1 sample".into(),
        n => format!("{n} samples"),
    }
}

pub(super) fn times(n: usize) -> String {
    match n {
        1 => "once".into(),
        n => format!("{n} times"),
    }
}
