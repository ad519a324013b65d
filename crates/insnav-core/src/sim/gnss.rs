//! What a GNSS receiver says: fixes of an antenna with white and coloured errors, outages, outliers and late stamps.

use super::noise::{GaussMarkov, Source, Stream};
use super::range::{finite, not_negative, positive, require};
use super::trajectory::{Kinematics, Trajectory};
use crate::earth::LocalEarth;
use crate::error::Result;
use crate::sample::{GnssPosition, GnssVelocity, Sample};
use crate::time::Time;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// A stretch of time, s after the start, its end not included.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Span {
    /// First instant.
    pub begin_s: f64,
    /// First instant after.
    pub end_s: f64,
}

impl Span {
    /// Whether an instant lies inside.
    pub fn contains(&self, seconds: f64) -> bool {
        (self.begin_s..self.end_s).contains(&seconds)
    }
}

/// A receiver and its antenna. Vectors are north, east, down.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GnssModel {
    /// Position fixes per second; 0: none.
    pub position_rate_hz: f64,
    /// Velocity fixes per second; 0: none.
    pub velocity_rate_hz: f64,
    /// Antenna from the IMU, forward-right-down, m.
    pub lever_arm_b_m: [f64; 3],
    /// White error of a position, m.
    pub position_sigma_m: [f64; 3],
    /// Steady sigma of the coloured (Gauss–Markov) error of positions, m.
    pub position_colour_sigma_m: [f64; 3],
    /// Its correlation time, s.
    pub position_colour_tau_s: f64,
    /// White error of a velocity, m/s.
    pub velocity_sigma_m_per_s: [f64; 3],
    /// Steady sigma of the coloured (Gauss–Markov) error of velocities, m/s.
    pub velocity_colour_sigma_m_per_s: [f64; 3],
    /// Its correlation time, s.
    pub velocity_colour_tau_s: f64,
    /// Whether the errors of a run are scaled until their root mean square is that of the sigmas, white and coloured together:
    /// horizontal positions, heights and velocities each by one factor. Coloured errors of a short run differ from their
    /// sigma by much; where a receiver is known by what it showed over such a run, this is how to have it.
    pub scaled_to_sigma: bool,
    /// Whether fixes state a covariance (white and coloured together); outliers state the same as good fixes.
    pub states_covariance: bool,
    /// When there are no fixes.
    pub outages: Vec<Span>,
    /// Share of fixes that are outliers, 0 to 1.
    pub outlier_probability: f64,
    /// Size of an outlier in position, m, in a random horizontal direction; of velocities a tenth of it in m/s.
    pub outlier_size_m: f64,
    /// Added to the stamps of all fixes: how far the GNSS clock is ahead of the IMU's, s.
    pub time_offset_s: f64,
    /// A velocity is valid this long before its stamp, s, on top of the offset.
    pub velocity_lag_s: f64,
    /// Fixes arrive this long after the instant at which the position is valid, s.
    pub latency_s: f64,
}

impl Default for GnssModel {
    /// A single-frequency receiver at 1 Hz under open sky, antenna in the IMU, no coloured error.
    fn default() -> Self {
        GnssModel {
            position_rate_hz: 1.0,
            velocity_rate_hz: 1.0,
            lever_arm_b_m: [0.0; 3],
            position_sigma_m: [1.5, 1.5, 3.0],
            position_colour_sigma_m: [0.0; 3],
            position_colour_tau_s: 300.0,
            velocity_sigma_m_per_s: [0.05, 0.05, 0.1],
            velocity_colour_sigma_m_per_s: [0.0; 3],
            velocity_colour_tau_s: 10.0,
            scaled_to_sigma: false,
            states_covariance: true,
            outages: Vec::new(),
            outlier_probability: 0.0,
            outlier_size_m: 50.0,
            time_offset_s: 0.0,
            velocity_lag_s: 0.0,
            latency_s: 0.0,
        }
    }
}

impl GnssModel {
    pub(super) fn check(&self) -> Result<()> {
        let within =
            |v: f64, low, high, key, expected| require((low..=high).contains(&v), key, v, expected);
        let rate = |v, key| within(v, 0.0, 1000.0, key, "between 0 and 1000");
        rate(self.position_rate_hz, "gnss.position_rate_hz")?;
        rate(self.velocity_rate_hz, "gnss.velocity_rate_hz")?;
        not_negative(&self.position_sigma_m, "gnss.position_sigma_m")?;
        not_negative(
            &self.position_colour_sigma_m,
            "gnss.position_colour_sigma_m",
        )?;
        not_negative(&self.velocity_sigma_m_per_s, "gnss.velocity_sigma_m_per_s")?;
        positive(self.position_colour_tau_s, "gnss.position_colour_tau_s")?;
        not_negative(
            &self.velocity_colour_sigma_m_per_s,
            "gnss.velocity_colour_sigma_m_per_s",
        )?;
        positive(self.velocity_colour_tau_s, "gnss.velocity_colour_tau_s")?;
        let share = self.outlier_probability;
        within(
            share,
            0.0,
            1.0,
            "gnss.outlier_probability",
            "between 0 and 1",
        )?;
        finite(&[self.outlier_size_m], "gnss.outlier_size_m")?;
        for outage in &self.outages {
            finite(&[outage.begin_s, outage.end_s], "gnss.outages")?;
            require(
                outage.begin_s < outage.end_s,
                "gnss.outages",
                outage.end_s,
                "later than the outage's begin_s, as an end_s",
            )?;
        }
        let thousand = |v, key| within(v, -1e3, 1e3, key, "within ±1000");
        thousand(self.time_offset_s, "gnss.time_offset_s")?;
        thousand(self.velocity_lag_s, "gnss.velocity_lag_s")?;
        thousand(self.latency_s, "gnss.latency_s")?;
        self.lever_arm_b_m
            .iter()
            .try_for_each(|v| thousand(*v, "gnss.lever_arm_b_m"))
    }

    fn is_out(&self, seconds: f64) -> bool {
        self.outages.iter().any(|o| o.contains(seconds))
    }
}

/// Antenna velocity over ground, NED at the IMU: v + C (ω_ib × l) − ω_ie × C l (\[Groves13\] section 14.3.1).
fn antenna_velocity_n(k: &Kinematics, lever_arm_b: &Vector3<f64>) -> Vector3<f64> {
    let earth_rate_n = LocalEarth::at(&k.nav.position).earth_rate_n();
    k.nav.velocity_n + k.nav.q_nb * k.angular_rate_b.cross(lever_arm_b)
        - earth_rate_n.cross(&(k.nav.q_nb * lever_arm_b))
}

/// Fixes with the instants of their arrival.
pub(super) fn simulate(
    model: &GnssModel,
    trajectory: &Trajectory,
    duration: f64,
    seed: u64,
) -> Vec<(Time, Sample)> {
    let lever_arm_b = Vector3::from(model.lever_arm_b_m);
    let mut fixes = Vec::new();
    let mut outliers = Source::new(seed, Stream::Outliers);
    // Drawn for every fix, so that the sequence of all others does not depend on which are outliers.
    let mut outlier = |size: f64| {
        let hit = outliers.uniform() < model.outlier_probability;
        let (s, c) = outliers.between(0.0, core::f64::consts::TAU).sin_cos();
        if hit {
            Vector3::new(c, s, 0.0) * size
        } else {
            Vector3::zeros()
        }
    };
    let instants = |rate: f64| {
        let count = if rate > 0.0 {
            (duration * rate + 1e-6).floor() as usize + 1
        } else {
            0
        };
        (0..count).map(move |i| i as f64 / rate)
    };
    let covariance = |a: Vector3<f64>, b: Vector3<f64>| {
        model
            .states_covariance
            .then(|| Matrix3::from_diagonal(&(a.component_mul(&a) + b.component_mul(&b))))
    };
    let stamps = |t: f64| {
        let valid = trajectory.start().plus(t);
        (valid.plus(model.latency_s), valid.plus(model.time_offset_s))
    };

    let positions = Errors {
        sigma: Vector3::from(model.position_sigma_m),
        colour_sigma: Vector3::from(model.position_colour_sigma_m),
        colour_tau: model.position_colour_tau_s,
        interval: 1.0 / model.position_rate_hz,
        scaled: model.scaled_to_sigma.then_some(POSITION_GROUPS),
    };
    let errors = positions.draw(
        instants(model.position_rate_hz).count(),
        Source::new(seed, Stream::PositionWhite),
        Source::new(seed, Stream::PositionColour),
    );
    for (t, error) in instants(model.position_rate_hz).zip(errors) {
        let error = error + outlier(model.outlier_size_m);
        if model.is_out(t) {
            continue;
        }
        let k = trajectory.after(t);
        let antenna = k.nav.position.offset(&(k.nav.q_nb * lever_arm_b));
        let (arrival, time) = stamps(t);
        let position = antenna.offset(&error);
        fixes.push((
            arrival,
            Sample::GnssPosition(GnssPosition {
                time,
                position,
                covariance_n: covariance(positions.sigma, positions.colour_sigma),
            }),
        ));
    }

    let velocities = Errors {
        sigma: Vector3::from(model.velocity_sigma_m_per_s),
        colour_sigma: Vector3::from(model.velocity_colour_sigma_m_per_s),
        colour_tau: model.velocity_colour_tau_s,
        interval: 1.0 / model.velocity_rate_hz,
        scaled: model.scaled_to_sigma.then_some(VELOCITY_GROUPS),
    };
    let errors = velocities.draw(
        instants(model.velocity_rate_hz).count(),
        Source::new(seed, Stream::VelocityWhite),
        Source::new(seed, Stream::VelocityColour),
    );
    for (t, error) in instants(model.velocity_rate_hz).zip(errors) {
        let error = error + outlier(0.1 * model.outlier_size_m);
        if model.is_out(t) {
            continue;
        }
        let k = trajectory.after(t - model.velocity_lag_s);
        let (arrival, time) = stamps(t);
        fixes.push((
            arrival,
            Sample::GnssVelocity(GnssVelocity {
                time,
                velocity_n: antenna_velocity_n(&k, &lever_arm_b) + error,
                covariance_n: covariance(velocities.sigma, velocities.colour_sigma),
            }),
        ));
    }
    fixes
}

/// Components that are scaled by one factor: horizontal position and height, velocity.
const POSITION_GROUPS: &[&[usize]] = &[&[0, 1], &[2]];
const VELOCITY_GROUPS: &[&[usize]] = &[&[0, 1, 2]];

/// Errors of one kind of fix but for outliers.
struct Errors<'a> {
    sigma: Vector3<f64>,
    colour_sigma: Vector3<f64>,
    colour_tau: f64,
    /// Between fixes, s.
    interval: f64,
    /// The components that are scaled to their sigmas together.
    scaled: Option<&'a [&'a [usize]]>,
}

impl Errors<'_> {
    fn draw(&self, count: usize, mut white: Source, colour: Source) -> Vec<Vector3<f64>> {
        let steady = self.colour_sigma;
        let mut colour = GaussMarkov::new(steady, steady, self.colour_tau, colour);
        let mut errors = Vec::with_capacity(count);
        for i in 0..count {
            if i > 0 {
                colour.step(self.interval);
            }
            errors.push(white.normal3().component_mul(&self.sigma) + colour.value);
        }
        for group in self.scaled.into_iter().flatten() {
            let squares = |v: &Vector3<f64>| group.iter().map(|&i| v[i] * v[i]).sum::<f64>();
            let shown = errors.iter().map(squares).sum::<f64>() / count as f64;
            let wanted = squares(&self.sigma) + squares(&self.colour_sigma);
            if shown > 0.0 {
                let factor = (wanted / shown).sqrt();
                for error in &mut errors {
                    group.iter().for_each(|&i| error[i] *= factor);
                }
            }
        }
        errors
    }
}

#[cfg(test)]
mod tests {
    use super::super::scenario::Scenario;
    use super::*;
    use crate::error::Error;

    fn drive() -> Trajectory {
        Trajectory::new(&Scenario::car_drive(300.0).drive).expect("valid")
    }

    /// No error, no lever arm, both fixes at 10 Hz.
    fn ideal() -> GnssModel {
        GnssModel {
            position_rate_hz: 10.0,
            velocity_rate_hz: 10.0,
            position_sigma_m: [0.0; 3],
            velocity_sigma_m_per_s: [0.0; 3],
            ..GnssModel::default()
        }
    }

    fn positions(fixes: &[(Time, Sample)]) -> Vec<GnssPosition> {
        let position = |s: &(Time, Sample)| {
            if let Sample::GnssPosition(p) = s.1 {
                Some(p)
            } else {
                None
            }
        };
        fixes.iter().filter_map(position).collect()
    }

    fn velocities(fixes: &[(Time, Sample)]) -> Vec<GnssVelocity> {
        let velocity = |s: &(Time, Sample)| {
            if let Sample::GnssVelocity(v) = s.1 {
                Some(v)
            } else {
                None
            }
        };
        fixes.iter().filter_map(velocity).collect()
    }

    #[test]
    fn antenna_velocity_is_the_derivative_of_antenna_position() {
        let trajectory = drive();
        let model = GnssModel {
            lever_arm_b_m: [1.0, -0.5, -1.5],
            ..ideal()
        };
        let velocities = velocities(&simulate(&model, &trajectory, 300.0, 0));
        let arm = Vector3::from(model.lever_arm_b_m);
        let antenna_e = |t: f64| {
            let nav = trajectory.after(t).nav;
            nav.position.to_ecef() + nav.position.ned_to_ecef() * (nav.q_nb * arm)
        };
        for fix in velocities.iter().skip(5).step_by(7) {
            let t = fix.time.since(trajectory.start());
            let h = 5e-3;
            let v_e = ((antenna_e(t + h) - antenna_e(t - h)) * 8.0
                - (antenna_e(t + 2.0 * h) - antenna_e(t - 2.0 * h)))
                / (12.0 * h);
            let v_n = trajectory.after(t).nav.position.ned_to_ecef().tr_mul(&v_e);
            // 1e-9 m of rounding in ECEF over 5 ms.
            assert!(
                (v_n - fix.velocity_n).norm() < 1e-6,
                "{}",
                v_n - fix.velocity_n
            );
        }
    }

    #[test]
    fn stamps_lag_and_latency_are_where_they_belong() {
        let trajectory = drive();
        let model = GnssModel {
            time_offset_s: 0.2,
            velocity_lag_s: 0.13,
            latency_s: 0.4,
            ..ideal()
        };
        let fixes = simulate(&model, &trajectory, 300.0, 0);
        let p = positions(&fixes)[900];
        assert_eq!(p.time, trajectory.start().plus(90.2));
        assert!(
            p.position
                .offset_to(&trajectory.after(90.0).nav.position)
                .norm()
                < 1e-8
        );
        let v = velocities(&fixes)[900];
        assert_eq!(v.time, p.time);
        assert_eq!(v.velocity_n, trajectory.after(90.0 - 0.13).nav.velocity_n);
        assert!(
            fixes
                .iter()
                .all(|(arrival, s)| arrival.since(s.time()) == 0.2),
            "0.4 of latency less 0.2 of stamp"
        );
    }

    /// Scaled, the root mean square over the run is that of the sigmas whatever the seed; unscaled it is not, by far.
    #[test]
    fn scaled_errors_have_the_size_of_their_sigmas_in_every_run() {
        let trajectory = drive();
        let mut model = GnssModel {
            position_sigma_m: [1.0, 1.0, 2.0],
            position_colour_sigma_m: [2.0, 2.0, 1.0],
            position_colour_tau_s: 100.0,
            velocity_sigma_m_per_s: [0.1; 3],
            velocity_colour_sigma_m_per_s: [0.2; 3],
            scaled_to_sigma: true,
            ..ideal()
        };
        let shown = |model: &GnssModel, seed| {
            let fixes = simulate(model, &trajectory, 300.0, seed);
            let mut sums = [0.0; 3];
            for fix in positions(&fixes) {
                let at = trajectory.at(fix.time).nav.position;
                let e = at.offset_to(&fix.position);
                sums[0] += e.x * e.x + e.y * e.y;
                sums[1] += e.z * e.z;
            }
            for fix in velocities(&fixes) {
                sums[2] += (fix.velocity_n - trajectory.at(fix.time).nav.velocity_n).norm_squared();
            }
            sums.map(|s| (s / 3001.0).sqrt())
        };
        let wanted = [10f64.sqrt(), 5f64.sqrt(), 0.15f64.sqrt()];
        for seed in 0..5 {
            for (found, wanted) in shown(&model, seed).iter().zip(wanted) {
                // Places on the ellipsoid are kept to a nanometre.
                assert!((found - wanted).abs() < 1e-6, "{found} {wanted}");
            }
        }
        model.scaled_to_sigma = false;
        let far = (0..5).map(|seed| (shown(&model, seed)[0] / wanted[0] - 1.0).abs());
        assert!(far.fold(0.0, f64::max) > 0.1);
    }

    #[test]
    fn outages_are_silent_and_change_nothing_else() {
        let trajectory = drive();
        let whole = GnssModel {
            position_sigma_m: [1.0; 3],
            position_colour_sigma_m: [2.0; 3],
            ..ideal()
        };
        let cut = GnssModel {
            outages: vec![Span {
                begin_s: 100.0,
                end_s: 130.0,
            }],
            ..whole.clone()
        };
        let (a, b) = (
            simulate(&whole, &trajectory, 300.0, 4),
            simulate(&cut, &trajectory, 300.0, 4),
        );
        assert_eq!(a.len() - b.len(), 600);
        let kept: Vec<_> = a
            .into_iter()
            .filter(|(t, _)| !(100.0..130.0).contains(&t.since(trajectory.start())))
            .collect();
        assert_eq!(kept, b);
    }

    /// White part and coloured part by their variance and their correlation over one second; four standard errors, of
    /// correlated values by Bartlett's formula.
    #[test]
    fn errors_have_their_sigmas_and_colour() {
        let trajectory = Trajectory::new(&Scenario::standing(20_000.0, 0.0).drive).expect("valid");
        let truth = trajectory.after(0.0).nav.position;
        let model = GnssModel {
            position_rate_hz: 1.0,
            velocity_rate_hz: 1.0,
            position_sigma_m: [0.5, 0.5, 1.0],
            position_colour_sigma_m: [1.0, 2.0, 3.0],
            position_colour_tau_s: 10.0,
            velocity_sigma_m_per_s: [0.1, 0.2, 0.3],
            ..GnssModel::default()
        };
        let fixes = simulate(&model, &trajectory, 20_000.0, 6);
        let errors: Vec<_> = positions(&fixes)
            .iter()
            .map(|p| truth.offset_to(&p.position))
            .collect();
        let n = errors.len() as f64;
        let phi = (-0.1f64).exp();
        for axis in 0..3 {
            let (w, c) = (
                model.position_sigma_m[axis].powi(2),
                model.position_colour_sigma_m[axis].powi(2),
            );
            let moment = |lag: usize| {
                errors
                    .iter()
                    .zip(&errors[lag..])
                    .map(|(a, b)| a[axis] * b[axis])
                    .sum::<f64>()
                    / n
            };
            let error = 4.0 * (w + c) * (2.0 * (1.0 + phi * phi) / (1.0 - phi * phi) / n).sqrt();
            assert!((moment(0) - w - c).abs() < error, "{axis}: {}", moment(0));
            assert!((moment(1) - c * phi).abs() < error, "{axis}: {}", moment(1));
            assert!(
                (moment(20) - c * phi.powi(20)).abs() < error,
                "{axis}: {}",
                moment(20)
            );
            assert_eq!(
                positions(&fixes)[0].covariance_n.expect("stated")[(axis, axis)],
                w + c
            );
        }
        let fixes = velocities(&fixes);
        for axis in 0..3 {
            let sigma = model.velocity_sigma_m_per_s[axis];
            let square = fixes
                .iter()
                .map(|v| v.velocity_n[axis].powi(2))
                .sum::<f64>()
                / n;
            assert!((square - sigma * sigma).abs() < 4.0 * sigma * sigma * (2.0 / n).sqrt());
        }
    }

    #[test]
    fn outliers_come_as_often_and_as_large_as_asked() {
        let trajectory = Trajectory::new(&Scenario::standing(10_000.0, 0.0).drive).expect("valid");
        let truth = trajectory.after(0.0).nav.position;
        let model = GnssModel {
            outlier_probability: 0.02,
            outlier_size_m: 30.0,
            velocity_rate_hz: 0.0,
            ..ideal()
        };
        let fixes = positions(&simulate(&model, &trajectory, 10_000.0, 6));
        let sizes: Vec<f64> = fixes
            .iter()
            .map(|p| truth.offset_to(&p.position).norm())
            .collect();
        let (n, hits) = (
            sizes.len() as f64,
            sizes.iter().filter(|s| **s > 1e-6).count() as f64,
        );
        assert!(
            (hits - 0.02 * n).abs() < 4.0 * (0.02 * 0.98 * n).sqrt(),
            "{hits} of {n}"
        );
        assert!(sizes.iter().all(|s| *s < 1e-6 || (s - 30.0).abs() < 1e-6));
    }

    #[test]
    fn bad_numbers_are_refused_by_name() {
        let refused = |gnss: GnssModel| match (Scenario {
            gnss,
            ..Scenario::standing(1.0, 0.0)
        })
        .simulate(0)
        {
            Err(Error::Config { key, .. }) => key,
            other => panic!("{:?}", other.map(|s| s.samples.len())),
        };
        assert_eq!(
            refused(GnssModel {
                position_rate_hz: -1.0,
                ..ideal()
            }),
            "gnss.position_rate_hz"
        );
        assert_eq!(
            refused(GnssModel {
                latency_s: f64::NAN,
                ..ideal()
            }),
            "gnss.latency_s"
        );
        assert_eq!(
            refused(GnssModel {
                position_colour_tau_s: 0.0,
                ..ideal()
            }),
            "gnss.position_colour_tau_s"
        );
        let outage = |begin_s, end_s| GnssModel {
            outages: vec![Span { begin_s, end_s }],
            ..ideal()
        };
        assert_eq!(refused(outage(30.0, 20.0)), "gnss.outages");
        assert_eq!(refused(outage(30.0, f64::NAN)), "gnss.outages");
        assert!(outage(20.0, 30.0).check().is_ok());
    }
}
