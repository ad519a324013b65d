//! Noise of simulated inertial records: at rest, on the move, with accelerations that nobody models.

mod simulated;

use insnav::imu::ImuNoise;
use insnav::noise::{IdentifyOptions, RecordNoise, identify_noise};
use simulated::{Bursts, Motion, Unit, record};

fn identified(
    unit: &Unit,
    motion: Motion,
    bursts: Option<Bursts>,
    seconds: f64,
    seed: u64,
) -> RecordNoise {
    let readings = record(unit, motion, bursts, seconds, seed);
    identify_noise(&readings, &IdentifyOptions::new(prior())).expect("a good record")
}

/// What is known beforehand: off by a factor of three in both densities.
fn prior() -> ImuNoise {
    ImuNoise::from_data_sheet(6.0, 0.6, 200.0, 10.0, 20_000.0, 20_000.0)
}

#[test]
fn look() {
    for motion in [Motion::Rest, Motion::Turning(6.0), Motion::Turning(40.0)] {
        for seed in 0..3 {
            let t = std::time::Instant::now();
            let n = identified(&Unit::adis(), motion, None, 180.0, seed);
            let g = n.tilt.gyro_white.clone();
            let used = n.windows.iter().filter(|w| w.accepted).count();
            println!(
                "{motion:?} {seed}: gyro {:.3} ± {:.3} z {:.2}; tilt {:.4} z {:.2} chi {:.2} {} {}/{} m {} J {} {:?}",
                g.value / Unit::adis().gyro_white,
                g.standard_error / Unit::adis().gyro_white,
                (g.value - Unit::adis().gyro_white) / g.standard_error,
                n.tilt.accel_white.value / Unit::adis().accel_white,
                (n.tilt.accel_white.value - Unit::adis().accel_white)
                    / n.tilt.accel_white.standard_error,
                n.tilt.chi2 / n.tilt.dof as f64,
                g.reason,
                used,
                n.windows.len(),
                n.averaged,
                n.lags,
                t.elapsed()
            );
            if used < n.windows.len() {
                for w in &n.windows {
                    println!("   {:?} {:?} {}", w.chi2_per_dof, w.gyro_white, w.reason);
                }
            }
            println!("   heading {:?} bias {:?}", n.heading, n.gyro_bias);
        }
    }
    for size in [0.3, 1.0] {
        for seed in 0..3 {
            let n = identified(
                &Unit::adis(),
                Motion::Rest,
                Some(Bursts {
                    size,
                    from_s: 60.0,
                    to_s: 120.0,
                }),
                180.0,
                seed,
            );
            println!(
                "bursts {size} {seed}: {:?}",
                n.tilt.gyro_white.value / Unit::adis().gyro_white
            );
            for w in &n.windows {
                println!(
                    "   {:.1}-{:.1} {:?} {:?} {}",
                    w.begin.seconds(),
                    w.end.seconds(),
                    w.chi2_per_dof,
                    w.gyro_white,
                    w.reason
                );
            }
        }
    }
}
