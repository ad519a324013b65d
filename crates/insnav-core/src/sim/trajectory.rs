//! Where a body goes: smooth motion over the ellipsoid with its exact angular rate and specific force.

use super::carried::Carried;
use super::drive::{Body, Drive, Wave};
use super::quadrature::{gauss_legendre, legendre};
use crate::attitude::Euler;
use crate::earth::{Geodetic, LocalEarth};
use crate::error::Result;
use crate::mechanization::NavState;
use crate::time::Time;
use nalgebra::Vector3;
use std::vec::Vec;

/// Exact motion at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kinematics {
    /// Position, velocity, attitude.
    pub nav: NavState,
    /// ω_ib resolved in b, rad/s.
    pub angular_rate_b: Vector3<f64>,
    /// Specific force resolved in b, m/s².
    pub specific_force_b: Vector3<f64>,
}

/// A quantity and its first two derivatives in time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Jet {
    value: f64,
    rate: f64,
    rate2: f64,
}

/// A change by `by` from `from`, with four continuous derivatives at its ends.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Step {
    from: f64,
    by: f64,
}

impl Step {
    /// At a share `x` of the duration: x⁵(126 − 420x + 540x² − 315x³ + 70x⁴), whose slope is 630 x⁴(1 − x)⁴.
    fn at(&self, x: f64, duration: f64) -> Jet {
        let y = x * (1.0 - x);
        let y3 = y * y * y;
        let s = x.powi(5) * (126.0 + x * (-420.0 + x * (540.0 + x * (-315.0 + x * 70.0))));
        Jet {
            value: self.from + self.by * s,
            rate: self.by * 630.0 * y3 * y / duration,
            rate2: self.by * 2520.0 * y3 * (1.0 - 2.0 * x) / (duration * duration),
        }
    }
}

/// Number of nodes of a panel's position polynomial.
const NODES: usize = 10;
/// Longest panel, s, and panels per radian of turn: ten nodes then carry the position to rounding.
const PANEL: f64 = 0.5;
const PANELS_PER_RADIAN: f64 = 6.0;
/// Fewest panels of a piece, whose speed is a polynomial of ninth degree.
const FEWEST_PANELS: f64 = 4.0;

#[derive(Clone, Debug, PartialEq)]
struct Piece {
    begin: f64,
    duration: f64,
    speed: Step,
    course: Step,
    slope: Step,
}

/// A stretch of time over which the position is a polynomial: offset at the begin, Legendre coefficients of its rate.
#[derive(Clone, Debug, PartialEq)]
struct Panel {
    begin: f64,
    length: f64,
    piece: usize,
    offset: Vector3<f64>,
    rate: [Vector3<f64>; NODES],
}

/// Smooth motion over WGS-84, known at every instant.
///
/// Speed, course and slope are piecewise polynomials with four continuous derivatives; velocity, attitude, ω_ib and f are
/// closed forms of them, with Earth rate, transport rate, Coriolis and normal gravity. Latitude, longitude and height
/// are the solution of L̇ = v_N/(M + h), λ̇ = v_E/((N + h) cos L), ḣ = −v_D by Gauss collocation with ten nodes a
/// panel of half a second, which leaves rounding only. Where the body rocks about another point than the unit, that point
/// follows the path, and all that is told is that of the unit. Before the start and after the end, the first and the last instant hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    start: Time,
    origin: Geodetic,
    pieces: Vec<Piece>,
    panels: Vec<Panel>,
    body: Body,
}

/// Speed, course and slope at an instant.
struct Path {
    speed: Jet,
    course: Jet,
    slope: Jet,
}

impl Path {
    fn velocity_n(&self) -> Vector3<f64> {
        self.direction() * self.speed.value
    }

    fn direction(&self) -> Vector3<f64> {
        let (s, c) = self.slope.value.sin_cos();
        let (so, co) = self.course.value.sin_cos();
        Vector3::new(c * co, c * so, -s)
    }

    /// Derivative of the velocity's components, m/s².
    fn velocity_rate_n(&self) -> Vector3<f64> {
        let (s, c) = self.slope.value.sin_cos();
        let (so, co) = self.course.value.sin_cos();
        let turning = Vector3::new(-c * so, c * co, 0.0) * self.course.rate;
        let tilting = Vector3::new(-s * co, -s * so, -c) * self.slope.rate;
        self.direction() * self.speed.rate + (turning + tilting) * self.speed.value
    }
}

impl Body {
    /// Roll and pitch against the path, with their rates.
    fn angles(&self, path: &Path, t: f64) -> (f64, f64, f64, f64) {
        let Path {
            speed,
            course,
            slope,
        } = path;
        let (s, c) = slope.value.sin_cos();
        // Lateral acceleration v cos θ ψ̇ and its rate.
        let lateral = speed.value * c * course.rate;
        let lateral_rate = speed.rate * c * course.rate
            - speed.value * s * slope.rate * course.rate
            + speed.value * c * course.rate2;
        let lean = -self.lean_deg_per_m_per_s2.to_radians();
        let squat = self.squat_deg_per_m_per_s2.to_radians();

        let v2 = speed.value * speed.value;
        let k2 = self.sway_speed_m_per_s * self.sway_speed_m_per_s;
        let (envelope, envelope_rate) = if v2 > 0.0 {
            (
                v2 / (v2 + k2),
                2.0 * speed.value * speed.rate * k2 / ((v2 + k2) * (v2 + k2)),
            )
        } else {
            (0.0, 0.0)
        };
        let sway = |waves: &[Wave]| {
            waves.iter().fold((0.0, 0.0), |(value, rate), w| {
                let omega = core::f64::consts::TAU * w.frequency_hz;
                let (s, c) = (omega * t + w.phase_deg.to_radians()).sin_cos();
                let a = w.amplitude_deg.to_radians();
                (
                    value + a * envelope * s,
                    rate + a * (envelope_rate * s + envelope * omega * c),
                )
            })
        };
        let (roll, roll_rate) = sway(&self.roll);
        let (pitch, pitch_rate) = sway(&self.pitch);
        let [roll_tilt, pitch_tilt] = self.tilt_deg.map(f64::to_radians);
        (
            roll_tilt + lean * lateral + roll,
            lean * lateral_rate + roll_rate,
            pitch_tilt + slope.value + squat * speed.rate + pitch,
            slope.rate + squat * speed.rate2 + pitch_rate,
        )
    }

    /// ω_nb without rocking, from the Euler rates, 3-2-1 sequence (\[Groves13\] section 2.3.1).
    fn rate_nb_b(&self, path: &Path, t: f64) -> Vector3<f64> {
        let (roll, roll_rate, pitch, pitch_rate) = self.angles(path, t);
        let (sr, cr) = roll.sin_cos();
        let (sp, cp) = pitch.sin_cos();
        Vector3::new(
            roll_rate - path.course.rate * sp,
            pitch_rate * cr + path.course.rate * cp * sr,
            -pitch_rate * sr + path.course.rate * cp * cr,
        )
    }
}

impl Trajectory {
    /// Build the motion of a drive.
    ///
    /// # Errors
    /// [`crate::error::Error::Config`] if a number of the drive is not finite, a duration not positive, the start beyond 85° of latitude,
    /// or the slope beyond 80°; also when there is no leg.
    pub fn new(drive: &Drive) -> Result<Self> {
        drive.check()?;
        let mut pieces = Vec::with_capacity(drive.legs.len());
        let mut begin = 0.0;
        let mut speed = drive.speed_m_per_s;
        let mut course = drive.heading_deg.to_radians();
        let mut slope = 0.0;
        for leg in &drive.legs {
            let turn = leg.turn_deg.to_radians();
            let slope_end = leg.slope_deg.to_radians();
            pieces.push(Piece {
                begin,
                duration: leg.duration_s,
                speed: Step {
                    from: speed,
                    by: leg.speed_m_per_s - speed,
                },
                course: Step {
                    from: course,
                    by: turn,
                },
                slope: Step {
                    from: slope,
                    by: slope_end - slope,
                },
            });
            begin += leg.duration_s;
            (speed, course, slope) = (leg.speed_m_per_s, course + turn, slope_end);
        }
        let mut trajectory = Trajectory {
            start: Time::from_seconds(drive.start_s),
            origin: Geodetic::from_degrees(drive.latitude_deg, drive.longitude_deg, drive.height_m),
            pieces,
            panels: Vec::new(),
            body: drive.body.clone(),
        };
        trajectory.solve_position();
        Ok(trajectory)
    }

    /// Stamp of the start.
    pub fn start(&self) -> Time {
        self.start
    }

    /// Length in time, s.
    pub fn duration(&self) -> f64 {
        self.pieces.last().map_or(0.0, |p| p.begin + p.duration)
    }

    /// The motion at a stamp.
    pub fn at(&self, time: Time) -> Kinematics {
        let mut kinematics = self.after(time.since(self.start));
        kinematics.nav.time = time;
        kinematics
    }

    /// The motion a number of seconds after the start.
    pub fn after(&self, seconds: f64) -> Kinematics {
        let followed = self.followed(seconds);
        let Some(carried) = Carried::of(&self.body.rocking) else {
            return followed;
        };
        let t = seconds.clamp(0.0, self.duration());
        let path = self.path(self.piece_at(t), t);
        let rate_nb_b = |at: f64| {
            let within = at.clamp(0.0, self.duration());
            let path = self.path(self.piece_at(within), within);
            self.body.rate_nb_b(&path, at)
        };
        carried.unit(&followed, &path.velocity_rate_n(), rate_nb_b, t)
    }

    /// The motion of the point that follows the path, of a body that does not rock.
    fn followed(&self, seconds: f64) -> Kinematics {
        let t = seconds.clamp(0.0, self.duration());
        let panel = &self.panels[self.panels.partition_point(|p| p.begin <= t).max(1) - 1];
        let path = self.path(panel.piece, t);
        let offset = panel.offset_at(2.0 * (t - panel.begin) / panel.length - 1.0);
        let position = Geodetic {
            latitude: self.origin.latitude + offset.x,
            longitude: self.origin.longitude + offset.y,
            height: self.origin.height + offset.z,
        };
        let velocity_n = path.velocity_n();
        let (roll, _, pitch, _) = self.body.angles(&path, t);
        let q_nb = Euler {
            roll,
            pitch,
            heading: path.course.value,
        }
        .to_quaternion();

        let earth = LocalEarth::at(&position);
        let earth_rate = earth.earth_rate_n();
        let transport_rate = earth.transport_rate_n(&velocity_n);
        let rate_nb_b = self.body.rate_nb_b(&path, t);
        let coriolis = (earth_rate * 2.0 + transport_rate).cross(&velocity_n);
        let gravity_n = Vector3::new(0.0, 0.0, earth.gravity());
        let to_b = q_nb.inverse();
        Kinematics {
            nav: NavState {
                time: self.start.plus(seconds),
                position,
                velocity_n,
                q_nb,
            },
            angular_rate_b: rate_nb_b + to_b * (earth_rate + transport_rate),
            specific_force_b: to_b * (path.velocity_rate_n() + coriolis - gravity_n),
        }
    }

    fn piece_at(&self, t: f64) -> usize {
        self.pieces.partition_point(|p| p.begin <= t).max(1) - 1
    }

    fn path(&self, piece: usize, t: f64) -> Path {
        let p = &self.pieces[piece];
        let x = ((t - p.begin) / p.duration).clamp(0.0, 1.0);
        Path {
            speed: p.speed.at(x, p.duration),
            course: p.course.at(x, p.duration),
            slope: p.slope.at(x, p.duration),
        }
    }

    fn solve_position(&mut self) {
        let rule = gauss_legendre::<NODES>();
        let mut panels = Vec::new();
        // Summed as an offset, since metres added to the Earth's radius would round at every panel.
        let mut offset = Vector3::zeros();
        for (piece, p) in self.pieces.iter().enumerate() {
            let stands = p.speed.from == 0.0 && p.speed.by == 0.0;
            let turn = p.course.by.abs().max(p.slope.by.abs());
            let moving = (p.duration / PANEL)
                .max(turn * PANELS_PER_RADIAN)
                .max(FEWEST_PANELS);
            let count = if stands { 1.0 } else { moving.ceil() };
            let length = p.duration / count;
            for i in 0..count as usize {
                let begin = p.begin + length * i as f64;
                let mut panel = Panel {
                    begin,
                    length,
                    piece,
                    offset,
                    rate: [Vector3::zeros(); NODES],
                };
                let velocity = rule.map(|(x, _)| {
                    self.path(piece, begin + 0.5 * length * (x + 1.0))
                        .velocity_n()
                });
                // Picard's iteration: latitude and height act on the rates through the Earth's radius only, so that each
                // round gains the ratio of the panel's way to that radius, five digits and more.
                for _ in 0..4 {
                    let rates: [Vector3<f64>; NODES] = core::array::from_fn(|k| {
                        let at = panel.offset_at(rule[k].0);
                        let earth = LocalEarth::at(&Geodetic {
                            latitude: self.origin.latitude + at.x,
                            longitude: 0.0,
                            height: self.origin.height + at.z,
                        });
                        let v = velocity[k];
                        Vector3::new(
                            v.x / earth.meridian,
                            v.y / (earth.transverse * earth.cos_latitude),
                            -v.z,
                        )
                    });
                    panel.rate = core::array::from_fn(|j| {
                        let mut sum = Vector3::zeros();
                        for ((x, w), rate) in rule.iter().zip(&rates) {
                            sum += rate * (w * legendre::<NODES>(*x)[j]);
                        }
                        sum * (j as f64 + 0.5)
                    });
                }
                offset = panel.offset_at(1.0);
                panels.push(panel);
            }
        }
        self.panels = panels;
    }
}

impl Panel {
    /// Offset at `x` in [−1, 1]: ∫P_j = (P_{j+1} − P_{j−1})/(2j + 1), and ∫P_0 = x + 1.
    fn offset_at(&self, x: f64) -> Vector3<f64> {
        let p = legendre::<{ NODES + 1 }>(x);
        let mut sum = self.rate[0] * (x + 1.0);
        for j in 1..NODES {
            sum += self.rate[j] * ((p[j + 1] - p[j - 1]) / (2.0 * j as f64 + 1.0));
        }
        self.offset + sum * (0.5 * self.length)
    }
}

#[cfg(test)]
mod tests {
    use super::super::drive::{BodyRocking, Leg};
    use super::super::scenario::Scenario;
    use super::*;
    use crate::attitude::{exp, log};
    use crate::earth::{EARTH_RATE, gravity};
    use nalgebra::{Rotation3, UnitQuaternion};

    /// Everything at once: town, fast road, high latitude, steep, fast.
    fn trajectories() -> Vec<Trajectory> {
        let car = Scenario::car_drive(900.0).drive;
        let mut north = car.clone();
        (north.latitude_deg, north.longitude_deg, north.height_m) = (-79.0, 179.99, 3000.0);
        let mut jet = car.clone();
        jet.speed_m_per_s = 200.0;
        jet.legs = vec![
            Leg {
                duration_s: 30.0,
                speed_m_per_s: 250.0,
                turn_deg: 90.0,
                slope_deg: 40.0,
            },
            Leg {
                duration_s: 40.0,
                speed_m_per_s: 150.0,
                turn_deg: -270.0,
                slope_deg: -20.0,
            },
        ];
        let mut rocking = car.clone();
        let wave = |amplitude_deg, frequency_hz, phase_deg| Wave {
            amplitude_deg,
            frequency_hz,
            phase_deg,
        };
        // Without the sway of 2.5 Hz: a metre away it would leave 1e-5 m/s in the stencils below.
        rocking.body.roll.clear();
        rocking.body.pitch.clear();
        rocking.body.rocking = BodyRocking {
            roll: vec![wave(0.1, 0.5, 20.0), wave(0.03, 0.9, 0.0)],
            pitch: vec![wave(0.08, 0.7, 70.0)],
            yaw: vec![wave(0.05, 0.4, 200.0)],
            lever_b_m: [0.6, -0.5, -1.0],
        };
        [car, north, jet, rocking]
            .iter()
            .map(|d| Trajectory::new(d).expect("valid"))
            .collect()
    }

    /// Derivative from four neighbours; remainder h⁴/30 times the fifth derivative.
    fn derivative(h: f64, f: impl Fn(f64) -> Vector3<f64>) -> Vector3<f64> {
        ((f(h) - f(-h)) * 8.0 - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
    }

    fn instants(trajectory: &Trajectory) -> impl Iterator<Item = f64> {
        let end = trajectory.duration();
        (1..400).map(move |i| end * (f64::from(i) + 0.37) / 401.0)
    }

    /// Axes of the navigation frame in ECEF as a rotation.
    fn q_en(at: &Geodetic) -> UnitQuaternion<f64> {
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(at.ned_to_ecef()))
    }

    #[test]
    fn velocity_is_the_derivative_of_position() {
        for trajectory in trajectories() {
            for t in instants(&trajectory) {
                let k = trajectory.after(t);
                let v_e = derivative(0.02, |dt| trajectory.after(t + dt).nav.position.to_ecef());
                let v_n = k.nav.position.ned_to_ecef().tr_mul(&v_e);
                // 1e-9 m of rounding in ECEF, seen over 0.02 s.
                assert!(
                    (v_n - k.nav.velocity_n).norm() < 5e-7,
                    "{t}: {v_n} {}",
                    k.nav.velocity_n
                );
            }
        }
    }

    #[test]
    fn specific_force_is_the_derivative_of_velocity_less_gravity() {
        for trajectory in trajectories() {
            for t in instants(&trajectory) {
                let k = trajectory.after(t);
                let v_e = |dt: f64| {
                    let nav = trajectory.after(t + dt).nav;
                    nav.position.ned_to_ecef() * nav.velocity_n
                };
                // In rotating ECEF axes: f = dv/dt + 2 ω_ie × v − g ([Groves13] section 5.3), no transport rate in it.
                let c_en = k.nav.position.ned_to_ecef();
                let earth_rate_e = Vector3::new(0.0, 0.0, EARTH_RATE);
                let g_e = c_en * Vector3::new(0.0, 0.0, gravity(&k.nav.position));
                let f_e = derivative(5e-3, v_e) + earth_rate_e.cross(&v_e(0.0)) * 2.0 - g_e;
                let f_b = k.nav.q_nb.inverse() * c_en.tr_mul(&f_e);
                // Rounding of 1e-12 m/s over 5 ms, and the remainder of the stencil, 1e-9.
                assert!(
                    (f_b - k.specific_force_b).norm() < 2e-8,
                    "{t}: {f_b} {}",
                    k.specific_force_b
                );
            }
        }
    }

    #[test]
    fn angular_rate_is_the_derivative_of_attitude_in_inertial_axes() {
        for trajectory in trajectories() {
            for t in instants(&trajectory) {
                let q_ib = |dt: f64| {
                    let nav = trajectory.after(t + dt).nav;
                    exp(&Vector3::new(0.0, 0.0, EARTH_RATE * dt)) * q_en(&nav.position) * nav.q_nb
                };
                let now = q_ib(0.0);
                let rate = derivative(2e-3, |dt| log(&(now.inverse() * q_ib(dt))));
                // Sway of 2.5 Hz leaves 1e-9 rad/s in the stencil; omitting the transport rate would be 1e-6 and more.
                let found = trajectory.after(t).angular_rate_b;
                assert!((rate - found).norm() < 1e-8, "{t}: {rate} {found}");
            }
        }
    }

    /// Position from panels against the same equations integrated by Runge–Kutta's fourth-order rule at 10 ms.
    #[test]
    fn position_is_the_integral_of_velocity() {
        for trajectory in trajectories() {
            let mut at = trajectory.after(0.0).nav.position;
            let h = 0.01;
            let rate = |t: f64, at: &Geodetic| {
                let v = trajectory.after(t).nav.velocity_n;
                let earth = LocalEarth::at(at);
                Vector3::new(
                    v.x / earth.meridian,
                    v.y / (earth.transverse * earth.cos_latitude),
                    -v.z,
                )
            };
            let add = |at: &Geodetic, d: Vector3<f64>| Geodetic {
                latitude: at.latitude + d.x,
                longitude: at.longitude + d.y,
                height: at.height + d.z,
            };
            let steps = (trajectory.duration() / h) as usize;
            for i in 0..steps {
                let t = i as f64 * h;
                let a = rate(t, &at);
                let b = rate(t + 0.5 * h, &add(&at, a * (0.5 * h)));
                let c = rate(t + 0.5 * h, &add(&at, b * (0.5 * h)));
                let d = rate(t + h, &add(&at, c * h));
                at = add(&at, (a + (b + c) * 2.0 + d) * (h / 6.0));
            }
            let end = trajectory.after(steps as f64 * h).nav.position;
            // Rounding of 9e4 additions to a longitude of π: 4e-16 rad × √9e4 × 6.4e6 m.
            assert!(end.offset_to(&at).norm() < 3e-6, "{}", end.offset_to(&at));
        }
    }

    #[test]
    fn motion_is_continuous_from_leg_to_leg() {
        for trajectory in trajectories() {
            for p in &trajectory.panels[1..] {
                let (before, after) = (
                    trajectory.after(p.begin - 1e-9),
                    trajectory.after(p.begin + 1e-9),
                );
                let moved = before.nav.position.offset_to(&after.nav.position)
                    - before.nav.velocity_n * 2e-9;
                assert!(moved.norm() < 1e-8, "{moved}");
                assert!((before.specific_force_b - after.specific_force_b).norm() < 1e-6);
                assert!((before.angular_rate_b - after.angular_rate_b).norm() < 1e-7);
            }
        }
    }

    #[test]
    fn standing_body_feels_gravity_and_the_turning_earth() {
        let trajectory = Trajectory::new(&Scenario::standing(10.0, 90.0).drive).expect("valid");
        let k = trajectory.after(4.0);
        let l = k.nav.position.latitude;
        // Heading east: forward east, right south.
        let rate = Vector3::new(0.0, -EARTH_RATE * l.cos(), -EARTH_RATE * l.sin());
        assert!(
            (k.angular_rate_b - rate).norm() < 1e-19,
            "{}",
            k.angular_rate_b
        );
        assert!(
            (k.specific_force_b + Vector3::new(0.0, 0.0, gravity(&k.nav.position))).norm() < 1e-14
        );
    }
}
