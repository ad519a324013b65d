//! The offset between the inertial unit's clock and that of GNSS positions.

use super::gnss_track::Path;
use super::preintegration::Steps;
use super::window::{Slope, Solution, Window};
use super::{ClockOffset, Search};
use crate::error::{Error, Result};
use crate::sample::Sample;
use nalgebra::Vector3;

/// Lengths of stretches that are tried, s. Short ones forgive the inertial unit, long ones the receiver.
const LENGTHS: [f64; 3] = [5.0, 10.0, 20.0];
/// Fewest fixes in a stretch: three components each against eleven unknowns that matter.
const FEWEST_FIXES: usize = 10;
/// Fewest stretches whose scatter gives a sigma.
const FEWEST_STRETCHES: usize = 8;
/// The liveliest stretches that are looked at, s in all: bounds the cost on logs of hours.
const MOST_SECONDS: f64 = 1200.0;
/// Spacing of the coarse search, s.
const GRID: f64 = 0.05;

/// Seconds to add to IMU stamps so that they meet the clock of GNSS positions.
///
/// The log is cut into stretches of some seconds. In each, with C, p, v unknown at its begin, positions must follow
/// p + v t + C S(t − offset) + ½ g t², S being the twice integrated specific force in the axes of the begin: a
/// least-squares problem in p, v, C and the biases that needs neither alignment nor filter nor any vehicle model.
/// Their summed misfit over the offset, each stretch having a noise level of its own, is searched on a grid and then by
/// Gauss–Newton. The sigma is that of the stretches' scatter (sandwich estimate, \[White82\]) and is widened by what other
/// minima the misfit has; attitude, biases and position noise have been refitted everywhere. Lengths of 5, 10 and 20 s
/// are tried and the one with the least sigma is told.
///
/// Positions alone take part: a receiver's velocity may have a lag of its own. `lever_arm_b` is the antenna from the
/// inertial unit, m. An antenna ahead of the unit seems to be early: left zero, 1.2 m ahead cost −0.018 s in simulated
/// town traffic with fixes of 0.5 m, −0.005 s with fixes of 0.01 m. Earth rate and Coriolis act within a stretch like
/// biases and are left to these. Where a receiver's coloured error rivals the motion, the sigma is a fifth too small.
///
/// # Errors
/// [`Error::NotObservable`] when there are too few stretches with both, or when the motion tells too little: the sigma
/// would exceed half of that of any value within the range.
pub fn estimate(
    samples: &[Sample],
    lever_arm_b: &Vector3<f64>,
    search: &Search,
) -> Result<ClockOffset> {
    let Some(zero) = samples.iter().find(|s| s.is_inertial()).map(Sample::time) else {
        return Err(not_observable("the log has no IMU"));
    };
    let steps = Steps::new(samples, zero);
    let path = Path::new(samples, zero);
    let mut best: Result<ClockOffset> = Err(not_observable(
        "too few stretches with both IMU and positions, without gaps",
    ));
    for length in LENGTHS {
        let windows = windows(&steps, &path, length, search.range + GRID, lever_arm_b);
        if windows.len() < FEWEST_STRETCHES {
            continue;
        }
        let found = offset_of(&windows, search);
        let better = match (&best, &found) {
            (Err(_), _) => true,
            (Ok(b), Ok(f)) => f.sigma < b.sigma,
            _ => false,
        };
        if better {
            best = found;
        }
    }
    best
}

fn not_observable(reason: &'static str) -> Error {
    Error::NotObservable {
        what: "the IMU's clock offset",
        reason,
    }
}

/// Stretches of a length, one after the other, the liveliest ones of a long log.
fn windows(
    steps: &Steps,
    path: &Path,
    length: f64,
    margin: f64,
    lever_arm_b: &Vector3<f64>,
) -> Vec<Window> {
    let last = steps.t.last().copied().unwrap_or(0.0) - margin;
    let mut stretches = Vec::new();
    // From fix to fix: a stamp far off must not cost the stretches in between.
    let mut i = path.t.partition_point(|&t| t < margin);
    while let Some(&begin) = path.t.get(i).filter(|t| **t + length <= last) {
        stretches.push((steps.liveliness(begin, begin + length), begin));
        i = path.t.partition_point(|&t| t < begin + length);
    }
    let most = (MOST_SECONDS / length) as usize;
    if stretches.len() > most {
        stretches.sort_by(|a, b| b.0.total_cmp(&a.0));
        stretches.truncate(most);
        stretches.sort_by(|a, b| a.1.total_cmp(&b.1));
    }
    stretches
        .iter()
        .filter_map(|(_, begin)| {
            Window::new(
                steps,
                path,
                (*begin, begin + length),
                margin,
                FEWEST_FIXES,
                lever_arm_b,
            )
        })
        .collect()
}

/// The offset that a set of stretches agrees on.
fn offset_of(windows: &[Window], search: &Search) -> Result<ClockOffset> {
    let half = (search.range / GRID).ceil().max(2.0) as i32;
    let grid: Vec<f64> = (-half..=half)
        .map(|k| search.range * f64::from(k) / f64::from(half))
        .collect();
    let profiles: Vec<Vec<Solution>> = windows.iter().map(|w| profile(w, &grid)).collect();
    let misfit = |k: usize| {
        let pairs = windows.iter().zip(&profiles);
        pairs.map(|(w, p)| w.misfit(&p[k])).sum::<f64>()
    };
    let total: Vec<f64> = (0..grid.len()).map(misfit).collect();
    let at = (0..grid.len())
        .min_by(|&a, &b| total[a].total_cmp(&total[b]))
        .unwrap_or(0);
    if at == 0 || at == grid.len() - 1 {
        return Err(not_observable("no best value within the searched range"));
    }

    let spacing = grid[1] - grid[0];
    let (low, high) = (grid[at] - spacing, grid[at] + spacing);
    let mut offset = grid[at];
    let mut solutions: Vec<Solution> = profiles.iter().map(|p| p[at]).collect();
    let mut slopes: Vec<Slope> = Vec::new();
    for _ in 0..6 {
        slopes.clear();
        for (window, solution) in windows.iter().zip(&mut solutions) {
            let fitted = window.fit(offset, Some(solution));
            let (slope, weight) = (window.slope(offset, &fitted), window.weight(&fitted));
            slopes.push(Slope {
                gradient: weight * slope.gradient,
                information: weight * slope.information,
            });
            *solution = fitted;
        }
        let step = -sum(&slopes, |s| s.gradient) / sum(&slopes, |s| s.information);
        if step.is_nan() || step.abs() < 1e-5 {
            break;
        }
        // The grid has bracketed the minimum; where stretches jump between fits of their own, Gauss–Newton may not see it.
        offset = (offset + step).clamp(low, high);
    }

    // Half the second difference of −2 log likelihood, against Gauss–Newton's: the smaller one is claimed.
    let bend = 0.5 * (total[at - 1] - 2.0 * total[at] + total[at + 1]) / (spacing * spacing);
    let information = sum(&slopes, |s| s.information).min(bend);
    let scatter = scatter(&slopes);
    let inflation = (scatter / information).max(1.0);
    let local = (inflation / information).sqrt();
    let sigma = local.max(spread(&grid, &total, offset, inflation));
    if sigma.is_nan() || sigma > 0.5 * search.uniform_sigma() {
        return Err(not_observable(
            "the motion is too gentle for the noise of positions and IMU",
        ));
    }
    Ok(ClockOffset {
        value: offset,
        sigma,
        stretches: windows.len(),
    })
}

fn sum(slopes: &[Slope], of: impl Fn(&Slope) -> f64) -> f64 {
    slopes.iter().map(of).sum()
}

/// Fits of one stretch over the grid, carried along from the middle outwards. Fresh starts everywhere, the better fit being
/// kept, were tried: the estimates on five real logs and 240 simulated ones stayed the same at three times the cost.
fn profile(window: &Window, grid: &[f64]) -> Vec<Solution> {
    let middle = grid.len() / 2;
    let mut out = vec![window.fit(grid[middle], None); grid.len()];
    for k in middle + 1..grid.len() {
        out[k] = window.fit(grid[k], Some(&out[k - 1]));
    }
    for k in (0..middle).rev() {
        out[k] = window.fit(grid[k], Some(&out[k + 1]));
    }
    out
}

/// Variance of the sum of the gradients, neighbours being allowed to correlate.
///
/// Each is taken as if its stretch had been left out of the estimate (\[MacKinnonWhite85\], HC3): a lively stretch pulls the
/// offset towards its own and would seem to fit better than it does.
fn scatter(slopes: &[Slope]) -> f64 {
    let information = sum(slopes, |s| s.information);
    let left_out: Vec<f64> = slopes
        .iter()
        .map(|s| s.gradient / (1.0 - s.information / information).max(0.1))
        .collect();
    let white: f64 = left_out.iter().map(|g| g * g).sum();
    let next: f64 = left_out.windows(2).map(|p| p[0] * p[1]).sum();
    white + next.max(0.0)
}

/// Standard deviation about `offset` of the likelihood taken as a distribution over the whole grid.
fn spread(grid: &[f64], misfit: &[f64], offset: f64, inflation: f64) -> f64 {
    let least = misfit.iter().copied().fold(f64::INFINITY, f64::min);
    let (mut norm, mut moment) = (0.0, 0.0);
    for (t, m) in grid.iter().zip(misfit) {
        let p = (-0.5 * (m - least) / inflation).exp();
        norm += p;
        moment += p * (t - offset).powi(2);
    }
    // A minimum narrower than the grid is told by its curvature, not by this sum.
    let outside = grid[1] - grid[0];
    let variance = moment / norm;
    if variance < outside * outside {
        0.0
    } else {
        variance.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::Scenario;
    use crate::time::Time;

    /// A log of a drive with fixes at 5 Hz, 0.3 m, on a clock that is 0.1 s behind the IMU's.
    fn drive() -> Vec<Sample> {
        let mut scenario = Scenario::car_drive(200.0);
        scenario.imu.rate_hz = 100.0;
        scenario.gnss.position_rate_hz = 5.0;
        scenario.gnss.position_sigma_m = [0.3, 0.3, 0.6];
        scenario.gnss.time_offset_s = -0.1;
        scenario.simulate(4).expect("valid scenario").samples
    }

    fn found(samples: &[Sample]) -> ClockOffset {
        estimate(samples, &Vector3::zeros(), &Search::default()).expect("observable")
    }

    #[test]
    fn spoiled_data_do_not_mislead() {
        let clean = found(&drive());
        let mut samples = drive();
        let duplicate = samples[7000];
        samples.insert(7001, duplicate);
        samples.drain(9000..9600);
        for (i, sample) in samples.iter_mut().enumerate() {
            match sample {
                Sample::GnssPosition(p) if i % 57 == 0 => {
                    p.position = p.position.offset(&Vector3::new(40.0, -30.0, 5.0));
                }
                Sample::GnssPosition(p) if i % 101 == 0 => p.position.latitude = f64::NAN,
                Sample::Imu(s) if i % 9001 == 0 => s.specific_force_b.x = f64::NAN,
                _ => {}
            }
        }
        // One fix from the receiver's first guess of the date.
        if let Some(Sample::GnssPosition(p)) = samples
            .iter_mut()
            .find(|s| matches!(s, Sample::GnssPosition(_)))
        {
            p.time = Time(p.time.0 + 1_000_000_000_000_000_000);
        }
        let spoiled = found(&samples);
        assert!(
            (spoiled.value + 0.1).abs() < 3.0 * spoiled.sigma,
            "{spoiled:?}"
        );
        assert!(spoiled.sigma < 4.0 * clean.sigma, "{clean:?} {spoiled:?}");
    }

    #[test]
    fn a_known_lever_arm_is_taken_out() {
        let arm = [2.5, -0.8, -1.5];
        let mut scenario = Scenario::car_drive(400.0);
        scenario.imu.rate_hz = 100.0;
        scenario.gnss.position_rate_hz = 5.0;
        scenario.gnss.position_sigma_m = [0.02; 3];
        scenario.gnss.lever_arm_b_m = arm;
        let samples = scenario.simulate(4).expect("valid scenario").samples;
        let with = estimate(&samples, &arm.into(), &Search::default()).expect("observable");
        let without = found(&samples);
        assert!(with.value.abs() < 3.0 * with.sigma, "{with:?}");
        // The negative control: swinging fixes that nothing explains spoil the fit.
        assert!(with.sigma < 0.8 * without.sigma, "{with:?} {without:?}");
    }

    #[test]
    fn an_offset_beyond_the_range_is_not_told_as_one_within() {
        let late: Vec<_> = drive()
            .iter()
            .map(|s| if s.is_inertial() { s.delayed(1.0) } else { *s })
            .collect();
        let found = estimate(&late, &Vector3::zeros(), &Search::default());
        assert!(
            matches!(found, Err(Error::NotObservable { .. })),
            "{found:?}"
        );
    }

    #[test]
    fn nothing_and_little_are_errors() {
        let samples = drive();
        let only_imu: Vec<_> = samples
            .iter()
            .copied()
            .filter(Sample::is_inertial)
            .collect();
        let only_gnss: Vec<_> = samples
            .iter()
            .copied()
            .filter(|s| !s.is_inertial())
            .collect();
        for few in [
            &samples[..0],
            &samples[..1],
            &samples[..500],
            &only_imu[..],
            &only_gnss[..],
        ] {
            let found = estimate(few, &Vector3::zeros(), &Search::default());
            assert!(
                matches!(found, Err(Error::NotObservable { .. })),
                "{found:?}"
            );
        }
    }
}
