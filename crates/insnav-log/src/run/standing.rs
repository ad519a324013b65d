//! What the settings say of stops, against what the log holds: noise at rest, declared intervals, the detector's window.

use super::RunError;
use super::report::Warning;
use super::survey::Survey;
use super::withhold::Withholding;
use insnav_core::config::{Config, DetectorKind, StationaryMode, VehicleKind};
use insnav_core::imu::{ImuGrade, ImuNoise};
use insnav_core::metrics::StopFinder;
use insnav_core::noise_floor::NoiseFloor;
use insnav_core::time::Time;
use nalgebra::Vector3;

/// The quietest tenth of a log is a body at rest where the body rests for as long, and for so long at least, s: fewer
/// stretches are not judged.
const QUIET_SHARE: f64 = 0.1;
const QUIET_LEAST: f64 = 10.0;
/// An interval may begin or end so far outside the log, s: first stamps are never quite round.
const OUTSIDE: f64 = 1.0;

/// Seconds for which the body is known to stand: by GNSS speed where that is not withheld, or as declared.
pub(super) fn known_standing(survey: &Survey, withholding: &Withholding, config: &Config) -> f64 {
    let mut finder = StopFinder::default();
    for v in &survey.velocities {
        if !withholding.takes(v.time) {
            finder.push_speed(v.time, v.velocity_n.xy().norm());
        }
    }
    let seen: f64 = finder.finish().iter().map(|s| s.end.since(s.begin)).sum();
    let declared = config.stationary.intervals_s.as_slice();
    seen.max(declared.iter().map(|[begin, end]| end - begin).sum())
}

/// Where the settings leave the noise at rest open: what the quietest tenth of the log shows. A log that never stands has
/// vibration there, which is no noise of the unit: then that of its class, if it is less. No unit is quieter than the best
/// class: what seems so is a simulation, or coarse values that stand still.
pub(super) fn state_noise_at_rest(
    config: &mut Config,
    class: &ImuNoise,
    floor: &NoiseFloor,
    span: f64,
    standing: f64,
) {
    let rests = standing >= QUIET_LEAST.max(QUIET_SHARE * span);
    let best = ImuGrade::Navigation.noise();
    let choose = |seen: &Vector3<f64>, class: f64, best: f64| {
        // Root of the mean square: the detectors add up all axes.
        let seen = (seen.norm() / 3.0_f64.sqrt()).max(best);
        if rests { seen } else { seen.min(class) }
    };
    let gyro = choose(&floor.gyro_white, class.gyro_white, best.gyro_white);
    let accel = choose(&floor.accel_white, class.accel_white, best.accel_white);
    let stationary = &mut config.stationary;
    stationary
        .gyro_arw_deg_per_sqrt_hour
        .get_or_insert(gyro.to_degrees() * 60.0);
    stationary
        .accel_vrw_m_per_s_per_sqrt_hour
        .get_or_insert(accel * 60.0);
}

/// Refuse a window that the log does not fill once.
pub(super) fn check_window(config: &Config, span: f64) -> Result<(), RunError> {
    let stationary = config.stationary;
    match stationary.window_s {
        Some(window) if window > span && stationary.detector != DetectorKind::None => {
            Err(RunError::WindowTooLong { window, span })
        }
        _ => Ok(()),
    }
}

/// A mode that does not do for what carries the unit or for what the run uses: one that takes the heading of a stop for constant
/// on a foot, which turns within a stance; one that looks at a stop as a whole where fixes come in between.
pub(super) fn check_mode(config: &Config) -> Option<Warning> {
    if config.stationary.mode == StationaryMode::Batch && config.gnss.used {
        return Some(Warning {
            code: "batch_with_gnss",
            message: "stationary.mode batch goes back to the begin of a stop when it is over, which would lose the fixes of the stop: those in which fixes came are led through by zero velocities".into(),
            remedy: "leave the mode out, or run without GNSS (`--imu-only`)".into(),
        });
    }
    let name = match config.stationary.mode {
        StationaryMode::Static => "static",
        StationaryMode::Zihr => "zihr",
        StationaryMode::HeadingHold => "heading_hold",
        StationaryMode::AttitudeHold => "attitude_hold",
        _ => return None,
    };
    (config.vehicle.kind == VehicleKind::Foot).then(|| Warning {
        code: "mode_on_foot",
        message: format!("stationary.mode {name} on a foot: a foot turns within a stance, and its heading is not held there"),
        remedy: "leave the mode out, or set zupt (`--stationary zupt`)".into(),
    })
}

/// Declared intervals that the inertial data do not cover: `span` is theirs, on the solution's clock. When more parts of the
/// drive follow, what is later may lie in them.
pub(super) fn outside(
    config: &Config,
    origin: Time,
    span: (Time, Time),
    more_follows: bool,
) -> Option<Warning> {
    let (begin, end) = (span.0.since(origin), span.1.since(origin));
    let known = end;
    let end = if more_follows { f64::INFINITY } else { end };
    let listed = |of: &dyn Fn(f64, f64) -> bool| {
        let all = config.stationary.intervals_s.as_slice().iter();
        let those = all.filter(|[a, b]| of(*a, *b));
        those
            .map(|[a, b]| format!("{a}:{b}"))
            .collect::<Vec<String>>()
            .join(", ")
    };
    let apart = |a: f64, b: f64| b <= begin || a >= end;
    let wholly = listed(&apart);
    let partly = listed(&|a, b| !apart(a, b) && (a < begin - OUTSIDE || b > end + OUTSIDE));
    let mut told = Vec::new();
    if !wholly.is_empty() {
        told.push(format!(
            "{wholly} s lies outside the inertial data, and is not used"
        ));
    }
    if !partly.is_empty() {
        told.push(format!(
            "{partly} s lies partly outside the inertial data, and the part inside is used"
        ));
    }
    (!told.is_empty()).then(|| Warning {
        code: "stop_outside",
        message: format!(
            "declared standing: {}; the data last from {begin:.1} to {known:.1} s",
            told.join("; ")
        ),
        remedy: match since_the_zero(config, origin, (begin, end)) {
            Some(list) => format!(
                "intervals count in seconds from the log's zero, which is {:.3} s in Unix time: give {list}",
                origin.seconds()
            ),
            None => "intervals count in seconds from the log's zero, which `insnav info` prints; check them (`--stop`, \
                     stationary.intervals_s)"
                .into(),
        },
    })
}

/// Intervals that lie in the data when they are taken as Unix times, as they are to be given.
fn since_the_zero(config: &Config, origin: Time, (begin, end): (f64, f64)) -> Option<String> {
    let shifted = config
        .stationary
        .intervals_s
        .as_slice()
        .iter()
        .map(|i| i.map(|t| t - origin.seconds()))
        .filter(|[a, b]| *b > begin && *a < end)
        .map(|[a, b]| format!("{a:.3}:{b:.3}"));
    let list = shifted.collect::<Vec<String>>().join(",");
    (origin.seconds() != 0.0 && !list.is_empty()).then_some(list)
}

/// Speeds of wheels that say nothing.
pub(super) fn speeds_not_finite(
    survey: &Survey,
    topic: Option<&str>,
    origin: Time,
) -> Option<Warning> {
    let first = survey.first_speed_not_finite?.since(origin);
    let bad = survey.speeds_not_finite;
    let all = bad + survey.speeds as u64;
    let topic = topic.unwrap_or("the topic of standing");
    Some(Warning {
        code: "speed_not_finite",
        message: format!(
            "{topic}: {bad} of {all} speeds are NaN or infinite and were not used, the first at {first:.3} s"
        ),
        remedy:
            "check the driver of the wheels, or leave the topic out with `--topic standing=none`"
                .into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::config::Intervals;

    fn floor(gyro: f64, accel: f64) -> NoiseFloor {
        NoiseFloor {
            rate: 100.0,
            gyro_white: Vector3::repeat(gyro),
            accel_white: Vector3::repeat(accel),
            gyro_shaken: 10.0 * gyro,
            accel_shaken: 10.0 * accel,
            gyro_mean: Vector3::zeros(),
            force: 9.81,
            gyro_step: Vector3::zeros(),
            accel_step: Vector3::zeros(),
            stretches: 100,
        }
    }

    fn at_rest(floor: &NoiseFloor, standing: f64) -> [f64; 2] {
        let mut config = Config::default();
        let class = ImuGrade::Industrial.noise();
        state_noise_at_rest(&mut config, &class, floor, 600.0, standing);
        let s = config.stationary;
        [
            s.gyro_arw_deg_per_sqrt_hour.unwrap(),
            s.accel_vrw_m_per_s_per_sqrt_hour.unwrap(),
        ]
    }

    #[test]
    fn a_floor_is_noise_where_the_body_rests_and_vibration_where_it_does_not() {
        let class = ImuGrade::Industrial.noise();
        let near =
            |a: [f64; 2], b: [f64; 2]| a.iter().zip(b).all(|(a, b)| (a / b - 1.0).abs() < 1e-9);
        let better = floor(0.5 * class.gyro_white, 0.5 * class.accel_white);
        let worse = floor(3.0 * class.gyro_white, 3.0 * class.accel_white);
        // °/√h and m/s/√h of the class.
        let of_class = [0.15, 0.1];
        let times = |k: f64| of_class.map(|x| k * x);
        assert!(near(at_rest(&better, 0.0), times(0.5)));
        assert!(near(at_rest(&better, 100.0), times(0.5)));
        assert!(
            near(at_rest(&worse, 100.0), times(3.0)),
            "an engine that idles"
        );
        assert!(near(at_rest(&worse, 59.0), times(1.0)), "a road");
        // Of a simulation without noise: °/√h and m/s/√h of the best class.
        let best = [0.002, 0.01];
        for without in [0.0, 1e-17] {
            assert!(near(at_rest(&floor(without, without), 100.0), best));
        }
    }

    #[test]
    fn what_is_set_stays() {
        let mut config = Config::default();
        config.stationary.gyro_arw_deg_per_sqrt_hour = Some(7.0);
        let class = ImuGrade::Industrial.noise();
        state_noise_at_rest(&mut config, &class, &floor(1e-5, 1e-4), 600.0, 600.0);
        assert_eq!(config.stationary.gyro_arw_deg_per_sqrt_hour, Some(7.0));
        assert!(config.stationary.accel_vrw_m_per_s_per_sqrt_hour.is_some());
    }

    #[test]
    fn intervals_beyond_the_log_are_told_with_its_span() {
        let mut config = Config::default();
        let judge = |config: &mut Config, list: &[[f64; 2]]| {
            config.stationary.intervals_s = Intervals::new(list).unwrap();
            let at = Time::from_seconds;
            outside(config, at(100.0), (at(100.01), at(400.0)), false).map(|w| w.message)
        };
        assert_eq!(judge(&mut config, &[[0.0, 300.5]]), None);
        let told = judge(&mut config, &[[10.0, 20.0], [250.0, 310.0]]).unwrap();
        assert!(
            told.contains("250:310 s lies partly outside")
                && told.contains("0.0 to 300.0")
                && !told.contains("10:20"),
            "{told}"
        );
        let told = judge(&mut config, &[[10.0, 20.0], [400.0, 500.0]]).unwrap();
        assert!(
            told.contains("400:500 s lies outside") && !told.contains("partly"),
            "{told}"
        );
    }

    #[test]
    fn unix_times_come_back_as_seconds_from_the_zero() {
        let mut config = Config::default();
        let zero = Time::from_seconds(1.6e9);
        config.stationary.intervals_s = Intervals::new(&[[1.6e9 + 40.0, 1.6e9 + 200.5]]).unwrap();
        let told = outside(&config, zero, (zero, zero.plus(300.0)), false).expect("a warning");
        assert!(
            told.remedy.contains("1600000000.000") && told.remedy.ends_with("give 40.000:200.500"),
            "{told:?}"
        );
        config.stationary.intervals_s = Intervals::new(&[[400.0, 500.0]]).unwrap();
        let span = (zero, zero.plus(300.0));
        let told = outside(&config, zero, span, false).expect("a warning");
        assert!(told.remedy.contains("insnav info"), "{told:?}");
        assert_eq!(outside(&config, zero, span, true), None, "another part");
    }

    #[test]
    fn speeds_that_say_nothing_are_counted_with_topic_and_time() {
        let mut survey = Survey::default();
        let zero = Time::from_seconds(100.0);
        assert_eq!(speeds_not_finite(&survey, Some("/wheels"), zero), None);
        survey.speeds = 7;
        survey.speeds_not_finite = 3;
        survey.first_speed_not_finite = Some(zero.plus(12.5));
        let told = speeds_not_finite(&survey, Some("/wheels"), zero).expect("a warning");
        assert!(
            told.message.starts_with("/wheels: 3 of 10") && told.message.ends_with("12.500 s"),
            "{told:?}"
        );
    }

    #[test]
    fn a_heading_held_on_a_foot_is_warned_of() {
        let mut config = Config::default();
        config.stationary.mode = StationaryMode::HeadingHold;
        assert_eq!(check_mode(&config), None, "on wheels");
        config.vehicle.kind = VehicleKind::Foot;
        let told = check_mode(&config).expect("a warning");
        assert!(told.message.contains("heading_hold"), "{told:?}");
        for right in [
            StationaryMode::Auto,
            StationaryMode::Zupt,
            StationaryMode::Off,
        ] {
            config.stationary.mode = right;
            assert_eq!(check_mode(&config), None);
        }
    }

    #[test]
    fn a_window_longer_than_the_log_is_refused() {
        let mut config = Config::default();
        assert!(check_window(&config, 1.0).is_ok(), "left open");
        config.stationary.window_s = Some(30.0);
        assert!(check_window(&config, 30.0).is_ok());
        let error = check_window(&config, 29.9).unwrap_err();
        assert!(error.to_string().contains("30 s") && error.to_string().contains("29.9 s"));
        config.stationary.detector = DetectorKind::None;
        assert!(
            check_window(&config, 29.9).is_ok(),
            "nobody looks through it"
        );
    }
}
