//! Over simulated records that are as the filter supposes: are the errors what the covariance says?

use super::carried::{Estimates, Record, Unit, error, estimate, nees, record};
use insnav::ahrs::AhrsSettings;

fn runs() -> u64 {
    if std::env::var("INSNAV_LONG").is_ok_and(|v| v == "1") {
        200
    } else {
        24
    }
}

/// Mean square of normalised errors per degree of freedom while moving, of one record: causal, smoothed.
fn ratios(record: &Record, estimates: &Estimates) -> [f64; 2] {
    [&estimates.causal, &estimates.smoothed].map(|epochs| {
        let moving: Vec<f64> = epochs
            .iter()
            .filter(|(k, _)| record.moving[*k])
            .map(|e| nees(record, e) / 3.0)
            .collect();
        moving.iter().sum::<f64>() / moving.len() as f64
    })
}

fn mean_ratios(settings: AhrsSettings, with_fields: bool) -> ([f64; 2], [f64; 2]) {
    let all: Vec<[f64; 2]> = (0..runs())
        .map(|seed| {
            let record = record(&Unit::new(seed));
            ratios(&record, &estimate(&record, settings, with_fields))
        })
        .collect();
    let n = all.len() as f64;
    let mean = [0, 1].map(|i| all.iter().map(|r| r[i]).sum::<f64>() / n);
    let error = [0, 1]
        .map(|i| (all.iter().map(|r| (r[i] - mean[i]).powi(2)).sum::<f64>() / n).sqrt() / n.sqrt());
    (mean, error)
}

/// What the simulated unit does not have: noise by turning, by acceleration and of stamps, wander of the magnetometer.
fn as_simulated() -> AhrsSettings {
    let mut settings = AhrsSettings {
        rate_noise: 0.0,
        force_noise: 0.0,
        ..AhrsSettings::default()
    };
    settings.gyro_bias_at_start = 0.5_f64.to_radians();
    settings.velocity_sigma = 0.7;
    settings.field.stamp_sigma = 0.0;
    settings.field.offset_wander = 0.0;
    settings
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    let (mean, error) = mean_ratios(as_simulated(), true);
    println!(
        "NEES/3 causal {:.2} ± {:.2}, smoothed {:.2} ± {:.2}",
        mean[0], error[0], mean[1], error[1]
    );
    // The velocity is tones, not the process that the filter supposes, and one offset's error stays for a whole record.
    for (mean, error) in mean.iter().zip(error) {
        assert!(
            *mean > 0.4 - 2.0 * error && *mean < 1.25 + 2.0 * error,
            "{mean} ± {error}"
        );
    }
    // A filter that takes the magnetometer for calibrated and on time is sure of what is wrong.
    let mut trusting = as_simulated();
    trusting.field.offset_sigma = 0.0;
    trusting.field.delay_sigma = 0.0;
    let (without, _) = mean_ratios(trusting, true);
    println!(
        "taken as calibrated and on time: {:.2}, {:.2}",
        without[0], without[1]
    );
    assert!(without[0] > 2.0 * mean[0] && without[1] > 2.0 * mean[1]);
}

#[test]
fn the_smoother_halves_the_error_and_ends_where_the_filter_does() {
    let mut squares = [0.0; 2];
    for seed in 0..runs() / 2 {
        let record = record(&Unit::new(seed));
        let estimates = estimate(&record, AhrsSettings::default(), true);
        for (square, epochs) in squares
            .iter_mut()
            .zip([&estimates.causal, &estimates.smoothed])
        {
            *square += epochs
                .iter()
                .filter(|(k, _)| record.moving[*k])
                .map(|e| error(&record, e).norm_squared())
                .sum::<f64>();
        }
        let (causal, smoothed) = (
            estimates.causal.last().unwrap(),
            estimates.smoothed.last().unwrap(),
        );
        // Between corrections the last epochs have no smoothing to come.
        assert!(causal.1.attitude.angle_to(&smoothed.1.attitude) < 1e-3);
    }
    let ratio = (squares[1] / squares[0]).sqrt();
    println!("smoothed / causal {ratio:.2}");
    assert!(ratio < 0.75, "{ratio}");
}

/// Delay and offset of the magnetometer are found within what is stated and the disturbances allow.
#[test]
fn delay_and_offset_of_the_magnetometer_are_found() {
    let (mut delays, mut offsets, mut left) = (Vec::new(), Vec::new(), 0.0);
    for seed in 0..runs() {
        let record = record(&Unit::new(1000 + seed));
        let estimates = estimate(&record, as_simulated(), true);
        let (delay, sigma) = estimates.delay.expect("a magnetometer");
        assert!(sigma < 0.002, "{sigma}");
        delays.push((delay - record.delay) / sigma);
        left += (estimates.offset.expect("a magnetometer") - record.offset).norm_squared();
        offsets.push(record.offset.norm_squared());
    }
    let rms = (delays.iter().map(|z| z * z).sum::<f64>() / delays.len() as f64).sqrt();
    let share = (left / offsets.iter().sum::<f64>()).sqrt();
    println!("delay: {rms:.2} of its sigma; offset: {share:.2} of it left");
    assert!(rms > 0.5 && rms < 1.5, "{rms}");
    assert!(share < 0.6, "{share}");
}

/// Without a magnetometer tilt is as good, and the heading's sigma grows with its error.
#[test]
fn six_axes() {
    let (mut heading, mut tilt) = (0.0, [0.0; 2]);
    for seed in 0..runs() {
        let record = record(&Unit::new(seed));
        let six = estimate(&record, as_simulated(), false);
        assert!(six.causal.iter().all(|(_, e)| !e.magnetic));
        let (first, last) = (six.causal[0], *six.causal.last().unwrap());
        // Heading is counted from the first epoch.
        let gained = error(&record, &last).z - error(&record, &first).z;
        let gained = insnav::attitude::wrap_angle(gained);
        heading += gained * gained / (last.1.covariance[(2, 2)] + first.1.covariance[(2, 2)]);
        let nine = estimate(&record, as_simulated(), true);
        for (sum, epochs) in tilt.iter_mut().zip([&six.causal, &nine.causal]) {
            *sum += epochs
                .iter()
                .filter(|(k, _)| record.moving[*k])
                .map(|(k, e)| {
                    let down =
                        |q: nalgebra::UnitQuaternion<f64>| q.conjugate() * nalgebra::Vector3::z();
                    (down(record.truth[*k]) - down(e.attitude)).norm_squared()
                })
                .sum::<f64>();
        }
    }
    let ratio = heading / runs() as f64;
    println!(
        "heading drift: NEES {ratio:.2}; tilt six against nine axes {:.2}",
        (tilt[0] / tilt[1]).sqrt()
    );
    assert!(ratio > 0.3 && ratio < 1.9, "{ratio}");
    assert!(tilt[0] < 1.7 * tilt[1]);
}
