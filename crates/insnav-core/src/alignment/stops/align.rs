//! Which method, what stands against it, and its result.

use super::coarse;
use super::free_run::{FreeRun, Start};
use super::geometry::{Geometry, geometry};
use super::gyrocompass::levelling_loop;
use super::joint::{GLOBAL, Joint};
use super::kalman::{self, Filtered};
use super::level;
use super::paper;
use super::place::Place;
use super::problem::Problem;
use super::rates::{Rates, disagreement, rates};
use super::record::{Record, Span};
use super::standing::{Standing, Taper};
use super::sway::PERIODS;
use super::{AlignmentMethod, AlignmentResult, Refusal, StopReport};
use crate::attitude::{Euler, exp, wrap_angle};
use crate::earth::{EARTH_RATE, Geodetic};
use crate::error::Result;
use crate::imu::ImuNoise;
use crate::time::Time;
use core::f64::consts::PI;
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

/// The shortest stop from which a rate is taken, s.
const SHORTEST: f64 = 40.0;
/// The shortest stop for levelling, s.
const SHORTEST_LEVEL: f64 = 1.0;
/// Nearer to the pole there is no north to find, rad.
const HIGHEST_LATITUDE: f64 = 1.553_343;
/// A smaller turn between stops is none, rad (1°).
const LEAST_TURN: f64 = 0.017_5;
/// Least singular value of the geometry for methods that need the positions to tell drift and azimuth apart.
const LEAST_RATIO: f64 = 0.05;
/// Halves of a stop that differ by more sigmas are no standing.
const LARGEST_DISAGREEMENT: f64 = 4.0;
/// Rocking that is too slow for a taper is told from a drift when the stop holds three of its periods: eight over three.
const LEAST_CYCLES: f64 = 2.7;
/// A body whose attitude scatters by more is turned, not rocking, rad rms.
const LARGEST_ROCKING: f64 = 0.1;
/// Means of the halves of a stop that is only levelled: their sigmas are those of a class, and units differ within it.
const LARGEST_DIFFERENCE: f64 = 6.0;
/// The Kalman filter's normalised innovations on a quiet base: their mean over thousands stays below.
const QUIET_NIS: f64 = 1.3;
/// A heading that is told may differ from the stops' by so many sigmas.
const LARGEST_CONTRADICTION: f64 = 5.0;
/// The horizontal Earth rate may be off by so many sigmas.
const LARGEST_NORM: f64 = 4.0;

/// A stretch of standing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StopWindow {
    /// Begin.
    pub begin: Time,
    /// End.
    pub end: Time,
}

/// How to align, and with what knowledge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlignmentOptions {
    /// Which way.
    pub method: AlignmentMethod,
    /// Where the body stands: latitude and height matter.
    pub position: Geodetic,
    /// Noise of the unit; the bias sigmas are what is known of the biases beforehand.
    pub noise: ImuNoise,
    /// Standard deviation of the gyros' scale factors; acts in turns between stops.
    pub gyro_scale_sigma: f64,
    /// Heading of the body's x axis at the first stop's begin and its sigma, rad, if it is known.
    pub heading: Option<(f64, f64)>,
    /// The azimuth is called unobservable when its sigma would be larger, rad.
    pub largest_azimuth_sigma: f64,
    /// Weights of the joint regression; `None`: by what the stops show.
    pub taper: Option<Taper>,
    /// Whether the paper's method uses its vertical equation (5); without it, the quadratic (9).
    pub paper_vertical: bool,
}

impl AlignmentOptions {
    /// Automatic choice, 10 ppm of gyro scale, azimuth to 5° or better.
    pub fn new(position: Geodetic, noise: ImuNoise) -> Self {
        AlignmentOptions {
            method: AlignmentMethod::Auto,
            position,
            noise,
            gyro_scale_sigma: 1e-5,
            heading: None,
            largest_azimuth_sigma: 5f64.to_radians(),
            taper: None,
            paper_vertical: true,
        }
    }

    fn check(&self) -> Result<()> {
        let range = |key, value: f64, good: bool, expected| {
            if good {
                Ok(())
            } else {
                Err(crate::error::Error::from(Refusal::Option {
                    key,
                    value,
                    expected,
                }))
            }
        };
        let latitude = self.position.latitude.to_degrees();
        range(
            "latitude",
            latitude,
            latitude.abs() <= 90.0,
            "from -90 to 90 degrees",
        )?;
        let positive = |x: f64| x > 0.0 && x.is_finite();
        range(
            "gyro white noise",
            self.noise.gyro_white,
            positive(self.noise.gyro_white),
            "positive: no unit is without noise",
        )?;
        range(
            "accelerometer white noise",
            self.noise.accel_white,
            positive(self.noise.accel_white),
            "positive: no unit is without noise",
        )?;
        range(
            "gyro scale sigma",
            self.gyro_scale_sigma,
            (0.0..0.5).contains(&self.gyro_scale_sigma),
            "0 or more, below 0.5",
        )?;
        if let Some((heading, sigma)) = self.heading {
            range("heading", heading, heading.is_finite(), "finite")?;
            range(
                "heading sigma",
                sigma,
                sigma >= 0.0 && sigma.is_finite(),
                "0 or more",
            )?;
        }
        Ok(())
    }
}

/// Attitude and sensor errors from one or more stops.
///
/// # Errors
/// `Alignment` with a [`Refusal`]: windows outside the data or too short, motion inside them, holes, positions that do not tell
/// the unknowns apart, a unit that cannot do what is asked.
pub fn align(
    record: &Record,
    stops: &[StopWindow],
    options: &AlignmentOptions,
) -> Result<AlignmentResult> {
    options.check()?;
    let spans = spans(record, stops)?;
    let place = Place::new(&options.position);
    let task = Task {
        record,
        place,
        spans,
        options,
    };
    task.require_gravity()?;
    if options.method == AlignmentMethod::Levelling {
        return task.levelling("asked for".to_string(), None);
    }
    let polar = options.position.latitude.abs() > HIGHEST_LATITUDE;
    let predicted = task.predicted_azimuth_sigma();
    let limit = options.largest_azimuth_sigma;
    let auto = options.method == AlignmentMethod::Auto;
    let finds_north = !polar && predicted <= limit;
    if auto && !finds_north {
        let reason = if polar {
            "so near a pole there is no north to find".to_string()
        } else {
            format!(
                "the azimuth of this unit in these stops would have a sigma of {}, {:.1}° are allowed",
                in_a_circle(predicted),
                limit.to_degrees()
            )
        };
        return task.levelling(reason, Some(predicted));
    }
    let keeps = matches!(
        options.method,
        AlignmentMethod::Zupt2 | AlignmentMethod::Paper
    );
    if polar {
        return Err(Refusal::AzimuthUnobservable {
            latitude_deg: options.position.latitude.to_degrees(),
        }
        .into());
    }
    if predicted > limit && !(keeps && options.heading.is_some()) {
        return Err(Refusal::LowGrade {
            sigma_azimuth_deg: predicted.to_degrees(),
            limit_deg: limit.to_degrees(),
        }
        .into());
    }
    task.require_long()?;
    record.require_whole(task.whole())?;
    // A heading that is known better than the stops will tell it is kept; another is one more piece of knowledge.
    let better = options.heading.is_some_and(|(_, sigma)| sigma < predicted);
    let method = if auto && better {
        AlignmentMethod::Zupt2
    } else {
        options.method
    };
    match method {
        AlignmentMethod::Coarse | AlignmentMethod::TwoVector | AlignmentMethod::Gyrocompass => {
            task.single(method)
        }
        AlignmentMethod::Paper => task.paper(),
        _ => task.fitted(method),
    }
}

fn spans(record: &Record, stops: &[StopWindow]) -> Result<Vec<Span>> {
    if stops.is_empty() {
        return Err(Refusal::NoStop.into());
    }
    for pair in stops.windows(2) {
        if pair[1].begin < pair[0].end {
            return Err(Refusal::StopsOverlap {
                begin_s: pair[1].begin.seconds(),
                previous_end_s: pair[0].end.seconds(),
            }
            .into());
        }
    }
    stops.iter().map(|s| record.span(s.begin, s.end)).collect()
}

/// An angle's sigma in words: more than half a circle is no sigma.
fn in_a_circle(sigma: f64) -> String {
    if sigma < core::f64::consts::PI {
        format!("{:.1}°", sigma.to_degrees())
    } else {
        "more than 180°".to_string()
    }
}

/// Standard deviation (rad/s) of a level rate by one stop of `length` s, tilt and velocity free: the Cramér–Rao limit
/// σ² = (N²/T)/(1 − tanh u/u), u = T/2λ, λ = N_v/(g N).
pub fn rate_limit(noise: &ImuNoise, gravity: f64, length: f64) -> f64 {
    let lambda = noise.accel_white / (gravity * noise.gyro_white);
    let u = 0.5 * length / lambda;
    // 1 − tanh u/u → u²/3 for small u.
    let share = if u < 1e-3 {
        u * u / 3.0
    } else {
        1.0 - u.tanh() / u
    };
    noise.gyro_white / (length * share).sqrt()
}

struct Task<'a> {
    record: &'a Record,
    place: Place,
    spans: Vec<Span>,
    options: &'a AlignmentOptions,
}

impl Task<'_> {
    fn whole(&self) -> Span {
        Span {
            begin: self.spans[0].begin,
            end: self.spans[self.spans.len() - 1].end,
        }
    }

    fn length(&self, span: Span) -> f64 {
        self.record.seconds(span.begin, span.end)
    }

    fn begin_s(&self, span: Span) -> f64 {
        self.record.times[span.begin].seconds()
    }

    fn require_long(&self) -> Result<()> {
        for span in &self.spans {
            let have_s = self.length(*span);
            // Windows are cut to whole nodes: a tenth of a second may be missing at each end.
            if have_s < SHORTEST - 0.25 {
                return Err(Refusal::StopTooShort {
                    begin_s: self.begin_s(*span),
                    have_s,
                    need_s: SHORTEST,
                    reason: "the Earth's rate is seen by the bend of the velocity, which grows with the square of time",
                }
                .into());
            }
        }
        Ok(())
    }

    /// Turn of the body from the first stop to each other one, by the gyros, less what their biases may have made of it, rad.
    fn turns(&self) -> Vec<f64> {
        let first = self.spans[0].end;
        self.spans[1..]
            .iter()
            .map(|span| {
                let turn = self.record.nodes[first..span.begin]
                    .iter()
                    .fold(UnitQuaternion::identity(), |q, node| q * node.rotation);
                let drifted = 3.0 * self.options.noise.gyro_bias_sigma + EARTH_RATE;
                (turn.angle() - drifted * self.record.seconds(first, span.begin)).max(0.0)
            })
            .collect()
    }

    /// Sigma that the azimuth will have, from noise, biases, lengths and turns alone, rad.
    fn predicted_azimuth_sigma(&self) -> f64 {
        let noise = &self.options.noise;
        let (g, horizontal) = (self.place.gravity, self.place.horizontal_rate());
        let rate = |span: &Span| rate_limit(noise, g, self.length(*span));
        let best = self.spans.iter().map(rate).fold(f64::INFINITY, f64::min);
        let tilt = self.place.tan_latitude * noise.accel_bias_sigma / g;
        let single = (best / horizontal)
            .hypot(noise.gyro_bias_sigma / horizontal)
            .hypot(tilt);
        self.turns()
            .iter()
            .zip(&self.spans[1..])
            .map(|(turn, span)| {
                let both = rate(&self.spans[0]).hypot(rate(span)) / 2.0;
                both / ((0.5 * turn).sin().abs().max(1e-9) * horizontal)
            })
            .fold(single, f64::min)
    }

    /// The accelerometers must feel gravity: wrong units are found nowhere else.
    fn require_gravity(&self) -> Result<()> {
        let allowed = (0.05 * self.place.gravity).max(5.0 * self.options.noise.accel_bias_sigma);
        for span in &self.spans {
            let nodes = &self.record.nodes[span.begin..span.end];
            let felt: f64 = nodes.iter().map(|node| node.gain.norm()).sum();
            let force = felt / self.length(*span);
            if (force - self.place.gravity).abs() > allowed {
                return Err(Refusal::NotGravity {
                    begin_s: self.begin_s(*span),
                    force_m_per_s2: force,
                    gravity_m_per_s2: self.place.gravity,
                }
                .into());
            }
        }
        Ok(())
    }

    /// For methods without a fit through the stop: its halves have the same means.
    fn require_still(&self, span: Span) -> Result<()> {
        let difference_sigma = level::halves(self.record, span, &self.options.noise);
        if difference_sigma > LARGEST_DIFFERENCE {
            return Err(Refusal::Moving {
                begin_s: self.begin_s(span),
                difference_sigma,
            }
            .into());
        }
        Ok(())
    }

    fn levelling(&self, reason: String, predicted: Option<f64>) -> Result<AlignmentResult> {
        let span = self.spans[self.spans.len() - 1];
        let have_s = self.length(span);
        if have_s < SHORTEST_LEVEL {
            return Err(Refusal::StopTooShort {
                begin_s: self.begin_s(span),
                have_s,
                need_s: SHORTEST_LEVEL,
                reason: "vibration does not average out of gravity in less",
            }
            .into());
        }
        self.record.require_whole(span)?;
        self.require_still(span)?;
        let heading = self.options.heading;
        let levelled = level::level(self.record, span, &self.place, &self.options.noise, heading);
        let predicted = predicted.unwrap_or_else(|| self.predicted_azimuth_sigma());
        let mut result = self.result(
            AlignmentMethod::Levelling,
            reason,
            levelled.q_nb,
            levelled.gyro_bias,
            Vector3::zeros(),
            levelled.covariance,
        );
        match heading {
            Some((told, _)) => {
                result.azimuth = Some(told.rem_euclid(core::f64::consts::TAU));
            }
            None => {
                result.azimuth_sigma = predicted;
                result.observable[2] = false;
            }
        }
        Ok(result)
    }

    /// Coarse start at the first stop's begin, turned to a heading that is kept.
    fn start(&self, keeps_heading: bool) -> Start {
        let mut start = coarse::inertial_frame(self.record, self.spans[0], &self.place);
        if let Some((heading, _)) = self.options.heading.filter(|_| keeps_heading) {
            let turn = wrap_angle(heading - Euler::from_quaternion(&start.q_nb).heading);
            start.q_nb = exp(&Vector3::new(0.0, 0.0, turn)) * start.q_nb;
        }
        start
    }

    /// Methods that look at one stop (the last), leave the biases alone and say so in the covariance.
    fn single(&self, method: AlignmentMethod) -> Result<AlignmentResult> {
        let span = self.spans[self.spans.len() - 1];
        self.require_still(span)?;
        let q_nb = match method {
            AlignmentMethod::TwoVector => {
                let start = coarse::two_vector(self.record, span);
                self.carried(span, &start)
            }
            AlignmentMethod::Coarse => {
                let start = coarse::inertial_frame(self.record, span, &self.place);
                self.carried(span, &start)
            }
            _ => {
                let start = coarse::inertial_frame(self.record, span, &self.place);
                let heading = Euler::from_quaternion(&start.q_nb).heading;
                let q_level = exp(&Vector3::new(0.0, 0.0, -heading)) * start.q_nb;
                let found = levelling_loop(self.record, span.begin, span, &self.place, q_level);
                exp(&Vector3::new(0.0, 0.0, found.azimuth())) * found.q_level
            }
        };
        // The loop settles in the first half.
        let share = if method == AlignmentMethod::Gyrocompass {
            0.5
        } else {
            1.0
        };
        let noise = &self.options.noise;
        // A mean of rates with tilt free, as the velocity shows it: the quadratic fit's variance, which is what the loop's
        // integrator and the q-method attain or miss by a few per cent.
        let length = share * self.length(span);
        let rate_variance = 10.0 / 7.0 * noise.gyro_white.powi(2) / length
            + 120.0 / 7.0 * (noise.accel_white / self.place.gravity).powi(2) / length.powi(3);
        let covariance = level::covariance(&q_nb, &self.place, noise, length, Some(rate_variance));
        Ok(self.result(
            method,
            "asked for".to_string(),
            q_nb,
            Vector3::zeros(),
            Vector3::zeros(),
            covariance,
        ))
    }

    /// The attitude at the end of a stop from that at its begin.
    fn carried(&self, span: Span, start: &Start) -> UnitQuaternion<f64> {
        let run = FreeRun::new(self.record, span, &self.place, start);
        run.q_nb[run.q_nb.len() - 1]
    }

    fn require_turned(&self) -> Result<()> {
        let largest = self.turns().into_iter().fold(0.0, f64::max);
        if largest < LEAST_TURN {
            return Err(Refusal::MissingRotation {
                turn_deg: largest.to_degrees(),
            }
            .into());
        }
        let error = largest * self.options.gyro_scale_sigma * self.place.horizontal_rate();
        let noise = rate_limit(
            &self.options.noise,
            self.place.gravity,
            self.length(self.spans[0]),
        );
        if error > noise {
            return Err(Refusal::TurnScaleDominates {
                turn_deg: largest.to_degrees(),
                scale_ppm: self.options.gyro_scale_sigma * 1e6,
                error_nrad_per_s: error * 1e9,
                noise_nrad_per_s: noise * 1e9,
            }
            .into());
        }
        Ok(())
    }

    /// The paper's own equations.
    fn paper(&self) -> Result<AlignmentResult> {
        let keeps = self.options.heading.is_some();
        let start = self.start(keeps);
        let (drift, azimuth, q_nb) = match self.spans.as_slice() {
            [span] => {
                if self.options.heading.is_none() {
                    return Err(Refusal::MissingRotation { turn_deg: 0.0 }.into());
                }
                let drift = paper::zupt2(self.record, *span, &self.place, &start);
                let azimuth = Euler::from_quaternion(&start.q_nb).heading;
                (drift, azimuth, self.carried(*span, &start))
            }
            [first, .., last] => {
                self.require_turned()?;
                let vertical = self.options.paper_vertical;
                let spans = [*first, *last];
                let found = paper::zupt1(self.record, spans, &self.place, &start, vertical)?;
                (found.drift, found.azimuth, found.q_nb)
            }
            [] => return Err(Refusal::NoStop.into()),
        };
        // The paper gives no covariance: that of the joint regression of the same stops is what its noise would leave at best.
        let problem = self.problem(start, keeps);
        let fit = Joint::fit(&problem, Taper::None, false).ok_or(Refusal::NoData)?;
        let mut result = self.result(
            AlignmentMethod::Paper,
            "asked for; its covariance is that of the joint regression".to_string(),
            q_nb,
            drift,
            Vector3::zeros(),
            fit.covariance,
        );
        self.report(
            &mut result,
            &fit,
            Taper::None,
            &self.halves(&fit, Taper::None),
        );
        result.azimuth = Some(azimuth.rem_euclid(core::f64::consts::TAU));
        Ok(result)
    }

    fn problem(&self, start: Start, keeps_heading: bool) -> Problem<'_> {
        let noise = &self.options.noise;
        // Positions that do not tell drift and azimuth apart leave that to what is known beforehand; others are fitted without.
        let apart = keeps_heading || self.shape(&start).ratio >= LEAST_RATIO;
        Problem {
            knowledge: (!apart).then_some([noise.gyro_bias_sigma, noise.accel_bias_sigma]),
            record: self.record,
            place: self.place,
            spans: self.spans.clone(),
            noise: &self.options.noise,
            gyro_scale_sigma: self.options.gyro_scale_sigma,
            heading: self.options.heading,
            keeps_heading,
            start,
        }
    }

    /// Geometry of the stops by the attitudes at their begins, which the gyros carry.
    fn shape(&self, start: &Start) -> Geometry {
        let mut q = start.q_nb;
        let mut next = self.spans[0].begin;
        let mut axes = Vec::with_capacity(self.spans.len());
        for span in &self.spans {
            for node in &self.record.nodes[next..span.begin] {
                q *= node.rotation;
            }
            next = span.begin;
            axes.push(q.to_rotation_matrix().into_inner());
        }
        geometry(&axes)
    }

    /// Kalman filter or joint regression.
    fn fitted(&self, asked: AlignmentMethod) -> Result<AlignmentResult> {
        match asked {
            AlignmentMethod::MultiPosition => self.require_turned()?,
            AlignmentMethod::Zupt2 if self.options.heading.is_none() => {
                return Err(Refusal::Option {
                    key: "heading",
                    value: f64::NAN,
                    expected: "given: ZUPT-2 needs the azimuth",
                }
                .into());
            }
            _ => {}
        }
        let keeps = asked == AlignmentMethod::Zupt2;
        if keeps {
            self.require_heading()?;
        }
        let problem = self.problem(self.start(keeps), keeps);
        let plain = Joint::fit(&problem, Taper::None, false).ok_or(Refusal::NoData)?;
        let shape = geometry_of(&plain);
        if asked == AlignmentMethod::MultiPosition && shape.ratio < LEAST_RATIO {
            return Err(paper::singular(&shape));
        }
        let filtered = kalman::filter(&problem, &plain.start);
        let nis = filtered.nis / filtered.dof as f64;
        let halves = self.halves(&plain, Taper::None);
        let quiet = nis < QUIET_NIS && halves.iter().all(|d| *d < LARGEST_DISAGREEMENT);
        let regress = match asked {
            // ZUPT-2 goes into a filter that has its own prior: a regression adds none.
            AlignmentMethod::Joint | AlignmentMethod::Zupt2 => true,
            AlignmentMethod::Kalman | AlignmentMethod::Fine => false,
            _ => !quiet,
        };
        let mut result = if regress {
            let taper = self.options.taper.unwrap_or(if quiet {
                Taper::None
            } else {
                Taper::HannSquared
            });
            let fit = if quiet && taper == Taper::None {
                plain
            } else {
                Joint::fit(&problem, taper, !quiet).ok_or(Refusal::NoData)?
            };
            self.by_joint(asked, &fit, taper, quiet, nis)?
        } else {
            self.by_filter(asked, &plain, &filtered, &halves)?
        };
        result.nis_ratio = Some(nis);
        self.require_latitude(&mut result)?;
        Ok(result)
    }

    /// A heading that is kept must be one that the stops can have.
    fn require_heading(&self) -> Result<()> {
        let Some((told, sigma)) = self.options.heading else {
            return Ok(());
        };
        let problem = Problem {
            heading: None,
            ..self.problem(self.start(false), false)
        };
        // Tapered, with what rocking does: the check is for degrees, not for the last minute of arc.
        let fit = Joint::fit(&problem, Taper::HannSquared, true).ok_or(Refusal::NoData)?;
        let found = Euler::from_quaternion(&fit.run.q_nb[0]).heading;
        let own = fit.covariance[(2, 2)].sqrt().hypot(sigma);
        let sigmas = wrap_angle(told - found).abs() / own;
        if sigmas > LARGEST_CONTRADICTION {
            return Err(Refusal::HeadingContradicted {
                told_deg: told.to_degrees(),
                found_deg: found.to_degrees().rem_euclid(360.0),
                sigmas,
            }
            .into());
        }
        Ok(())
    }

    fn halves(&self, fit: &Joint, taper: Taper) -> Vec<f64> {
        let noise = &self.options.noise;
        fit.stops
            .iter()
            .map(|s| disagreement(s, &fit.run, &self.place, noise, taper, None).amax())
            .collect()
    }

    fn by_filter(
        &self,
        asked: AlignmentMethod,
        fit: &Joint,
        filtered: &Filtered,
        halves: &[f64],
    ) -> Result<AlignmentResult> {
        for (standing, worst) in fit.stops.iter().zip(halves) {
            if *worst > LARGEST_DISAGREEMENT {
                return Err(self.not_stationary(fit, standing, *worst));
            }
        }
        let method = match asked {
            AlignmentMethod::Fine | AlignmentMethod::Zupt2 => asked,
            _ => AlignmentMethod::Kalman,
        };
        let mut result = self.result(
            method,
            self.why(asked, "the base is quiet"),
            filtered.q_nb,
            filtered.gyro_bias,
            filtered.accel_bias,
            filtered.covariance,
        );
        self.report(&mut result, fit, Taper::None, halves);
        Ok(result)
    }

    fn by_joint(
        &self,
        asked: AlignmentMethod,
        fit: &Joint,
        taper: Taper,
        quiet: bool,
        nis: f64,
    ) -> Result<AlignmentResult> {
        let noise = &self.options.noise;
        let mut halves = Vec::with_capacity(fit.stops.len());
        for (i, standing) in fit.stops.iter().enumerate() {
            let left = fit.sway.get(i).map(|_| fit.residuals[i].as_slice());
            let apart = disagreement(standing, &fit.run, &self.place, noise, taper, left).amax();
            halves.push(apart);
            if apart > LARGEST_DISAGREEMENT {
                let slow = fit
                    .sway
                    .get(i)
                    .map(|s| s.period_s * PERIODS as f64)
                    .filter(|need_s| (1.0..LEAST_CYCLES).contains(&(need_s / standing.length())));
                return Err(match slow {
                    Some(need_s) if rocking_rms(standing).amax() < LARGEST_ROCKING => {
                        Refusal::StopTooShort {
                            begin_s: self.begin_s(standing.span),
                            have_s: standing.length(),
                            need_s,
                            reason: "it rocks slowly, and a taper needs eight periods of that",
                        }
                        .into()
                    }
                    _ => self.not_stationary(fit, standing, apart),
                });
            }
        }
        let method = match asked {
            AlignmentMethod::Zupt2 => asked,
            _ => AlignmentMethod::Joint,
        };
        let end = fit.run.q_nb[fit.run.q_nb.len() - 1];
        let because = if quiet {
            "the base is quiet"
        } else if nis >= QUIET_NIS {
            "the base rocks"
        } else {
            "the halves of a stop differ without a taper"
        };
        let mut result = self.result(
            method,
            self.why(asked, because),
            end,
            fit.start.gyro_bias,
            fit.start.accel_bias,
            fit.covariance,
        );
        self.report(&mut result, fit, taper, &halves);
        Ok(result)
    }

    fn why(&self, asked: AlignmentMethod, because: &str) -> String {
        match asked {
            AlignmentMethod::Auto | AlignmentMethod::MultiPosition => because.to_string(),
            AlignmentMethod::Zupt2 if self.options.method == AlignmentMethod::Auto => {
                format!("a heading is given; {because}")
            }
            _ => format!("asked for; {because}"),
        }
    }

    fn not_stationary(&self, fit: &Joint, standing: &Standing, worst: f64) -> crate::error::Error {
        let i = fit
            .stops
            .iter()
            .position(|s| s.span == standing.span)
            .unwrap_or(0);
        Refusal::NotStationary {
            begin_s: self.begin_s(standing.span),
            velocity_rms_m_per_s: velocity_rms(&fit.residuals[i]),
            disagreement_sigma: worst,
        }
        .into()
    }

    /// With two or more positions, whether the horizontal Earth rate is that of the latitude: the paper's unit norm.
    fn require_latitude(&self, result: &mut AlignmentResult) -> Result<()> {
        if result.stops.len() < 2 || self.options.heading.is_some() {
            return Ok(());
        }
        let (first, last) = (&result.stops[0], &result.stops[result.stops.len() - 1]);
        let axes = [first, last].map(|s| s.q_nb.to_rotation_matrix().into_inner());
        let Ok((drift, _)) = paper::linear(
            [&first.rate_n, &last.rate_n],
            [&axes[0], &axes[1]],
            &self.place,
        ) else {
            return Ok(());
        };
        let horizontal = self.place.horizontal_rate();
        let left = first.rate_n - axes[0] * drift;
        let residual = left.x.hypot(left.y) / horizontal - 1.0;
        let turn = (axes[1] - axes[0]).fixed_view::<2, 2>(0, 0).norm() / 8f64.sqrt();
        // Two rates, what the gyros wander between them, and what their scale error makes of the turn.
        let apart = last.begin.since(first.begin);
        let noise = &self.options.noise;
        let wander = 2.0 * noise.gyro_bias_sigma.powi(2) / noise.gyro_bias_tau * apart;
        let scale = self.options.gyro_scale_sigma * PI * horizontal;
        let variance = first.sigma_rate.x.powi(2) + last.sigma_rate.x.powi(2);
        let sigma = (variance + wander + scale * scale).sqrt() / (2.0 * turn * horizontal);
        result.norm_residual = Some([residual, sigma]);
        let sigmas = residual.abs() / sigma;
        if sigmas > LARGEST_NORM && turn > 0.1 {
            return Err(Refusal::LatitudeInconsistent {
                norm_residual: residual,
                sigmas,
            }
            .into());
        }
        Ok(())
    }

    fn report(&self, result: &mut AlignmentResult, fit: &Joint, taper: Taper, halves: &[f64]) {
        let noise = &self.options.noise;
        result.stops = fit
            .stops
            .iter()
            .enumerate()
            .map(|(i, standing)| {
                let all = (0, standing.t.len() - 1);
                let Rates { rate_n, sigma } =
                    rates(standing, &fit.run, &self.place, noise, taper, all);
                let through = standing.axes_n * fit.start.gyro_bias;
                StopReport {
                    begin: self.record.times[standing.span.begin],
                    end: self.record.times[standing.span.end],
                    rate_n: self.place.earth_n + through + rate_n,
                    residual_rate_n: rate_n,
                    sigma_rate: sigma,
                    q_nb: standing.q_nb,
                    rocking_rms: rocking_rms(standing),
                    velocity_rms: velocity_rms(&fit.residuals[i]),
                    taper,
                    half_disagreement: halves[i],
                    rocking_period_s: fit
                        .sway
                        .get(i)
                        .map(|s| s.period_s)
                        .filter(|period| period * PERIODS as f64 <= standing.length()),
                }
            })
            .collect();
        let shape = geometry_of(fit);
        result.weakest = shape.weakest;
        result.geometry_ratio = shape.ratio;
        let q = fit.run.q_nb[0];
        result.azimuth = Some(
            Euler::from_quaternion(&q)
                .heading
                .rem_euclid(core::f64::consts::TAU),
        );
    }

    fn result(
        &self,
        method: AlignmentMethod,
        reason: String,
        q_nb: UnitQuaternion<f64>,
        gyro_bias: Vector3<f64>,
        accel_bias: Vector3<f64>,
        covariance: SMatrix<f64, GLOBAL, GLOBAL>,
    ) -> AlignmentResult {
        let axes: Vec<Matrix3<f64>> = std::vec![q_nb.to_rotation_matrix().into_inner()];
        let shape = geometry(&axes);
        let mut result = AlignmentResult {
            method,
            reason,
            at: self.record.times[self.whole().end],
            q_nb,
            azimuth: None,
            gyro_bias,
            accel_bias,
            covariance: (covariance + covariance.transpose()) * 0.5,
            observable: [true; 9],
            azimuth_sigma: covariance[(2, 2)].sqrt(),
            weakest: shape.weakest,
            geometry_ratio: shape.ratio,
            norm_residual: None,
            nis_ratio: None,
            stops: Vec::new(),
        };
        self.judge(&mut result);
        result
    }

    fn judge(&self, result: &mut AlignmentResult) {
        let noise = &self.options.noise;
        let sigma = result.sigma();
        for i in 0..3 {
            result.observable[i] = sigma[i] <= self.options.largest_azimuth_sigma;
            result.observable[3 + i] = sigma[3 + i] < 0.9 * noise.gyro_bias_sigma;
            result.observable[6 + i] = sigma[6 + i] < 0.9 * noise.accel_bias_sigma;
        }
        result.azimuth_sigma = sigma[2];
    }
}

fn geometry_of(fit: &Joint) -> Geometry {
    let axes: Vec<Matrix3<f64>> = fit
        .stops
        .iter()
        .map(|s| s.q_nb.to_rotation_matrix().into_inner())
        .collect();
    geometry(&axes)
}

fn rocking_rms(standing: &Standing) -> Vector3<f64> {
    let count = standing.rocking.len() as f64;
    let squares: Vector3<f64> = standing.rocking.iter().map(|r| r.component_mul(r)).sum();
    (squares / count).map(f64::sqrt)
}

fn velocity_rms(residuals: &[Vector3<f64>]) -> f64 {
    let squares: f64 = residuals.iter().map(|r| r.xy().norm_squared()).sum();
    (squares / residuals.len() as f64).sqrt()
}
