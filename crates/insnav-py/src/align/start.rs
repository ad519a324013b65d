//! What a run begins with, and its sources one at a time.

use super::found::{make, quaternion, turns, vector};
use super::record::stated_noise;
use crate::arrays::{Argument, rows, scalars};
use crate::failure::{Failure, fail};
use crate::inputs::{self, inertial_and_magnetic};
use crate::interrupt::interruptible;
use crate::settings;
use insnav_core::alignment::{self, HeadingSource, MovingBaseOptions, Startup};
use insnav_core::attitude::Euler;
use insnav_core::config::Config;
use insnav_core::earth::Geodetic;
use insnav_core::imu::{ImuGrade, ImuNoise};
use insnav_log::{RunError, Source};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};

/// Roll and pitch from the direction of gravity, of bodies whose accelerometers feel nothing else.
///
/// Parameters
/// ----------
/// specific_force_b : (n, 3) or (3,)
///     Specific force, body axes (forward-right-down), in any unit; (0, 0, -g) at rest and level.
///
/// Returns
/// -------
/// roll_deg, pitch_deg : (n,), or float of one vector
///     Right side down and nose up positive. [Groves13] eq. 5.101.
///
/// Raises
/// ------
/// InsnavError
///     ``wrong_shape``; ``not_finite`` for a vector of length zero or with NaN.
///
/// Examples
/// --------
/// >>> from insnav import align
/// >>> roll_deg, pitch_deg = align.level([0.0, 0.0, -9.81])
/// >>> bool(abs(roll_deg) < 1e-12), bool(abs(pitch_deg) < 1e-12)
/// (True, True)
#[pyfunction]
pub(crate) fn level<'py>(
    specific_force_b: &Bound<'py, PyAny>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let py = specific_force_b.py();
    let fail = fail(py);
    let (forces, alone) = Argument::new("specific_force_b", specific_force_b)
        .vectors_alone_or_not()
        .map_err(fail)?;
    let direction = |f: &Vector3<f64>| f.norm() > 0.0 && f.norm().is_finite();
    if let Some(row) = forces.iter().position(|f| !direction(f)) {
        return Err(fail(
            Failure::new(
                "not_finite",
                format!("specific_force_b[{row}]: has no direction"),
                "vectors that are finite and not zero",
            )
            .about(
                "specific_force_b",
                "zero or not finite",
                "vectors with a direction",
            ),
        ));
    }
    let angles: Vec<[f64; 2]> = interruptible(py, move |_| {
        let of = |f: &Vector3<f64>| {
            let euler = Euler::from_quaternion(&alignment::level_from_force(f));
            [euler.roll.to_degrees(), euler.pitch.to_degrees()]
        };
        forces.iter().map(of).collect()
    })?;
    if alone {
        let [roll, pitch] = angles[0];
        return Ok((roll.into_bound_py_any(py)?, pitch.into_bound_py_any(py)?));
    }
    Ok((
        scalars(py, angles.iter().map(|a| a[0]))?,
        scalars(py, angles.iter().map(|a| a[1]))?,
    ))
}

/// What a run of these data begins with: attitude, position and velocity at the first inertial sample.
///
/// The heading comes from whoever knows most: given, two antennas, the course of a car, GNSS velocities of a moving base, a
/// magnetometer, nobody; without GNSS the gyros, where they feel the Earth turn. Samples are shown one by one, as the navigator sees
/// them, until a start is found.
///
/// Parameters
/// ----------
/// arrays : Arrays
///     What :func:`insnav.run` takes.
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`. Where ``imu.grade`` is not said, the unit is taken for a consumer's.
///
/// Returns
/// -------
/// StartAlignment
///     State, standard deviations and where the heading came from.
///
/// Raises
/// ------
/// InsnavError
///     No inertial sample, no position, no rest at the begin of a run without GNSS.
#[pyfunction]
#[pyo3(signature = (arrays, config=None))]
pub(crate) fn run_start<'py>(
    arrays: &Bound<'py, PyMapping>,
    config: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = arrays.py();
    let fail = fail(py);
    let config = settings::config(config)?;
    let source = inputs::arrays(arrays, &config)?;
    if config.gnss.used {
        source.has_places().map_err(fail)?;
    }
    let noise = or_consumer(&config);
    let zero = source.zero();
    let found = interruptible(py, move |stop| {
        let mut startup = Startup::new(&config, noise);
        for sample in source.samples()? {
            stop.check()?;
            startup.push(sample?);
            if let Some(found) = startup.try_align() {
                return Ok(found);
            }
        }
        startup.align_with_what_there_is().map_err(RunError::from)
    })?
    .map_err(|e| fail(e.into()))?;
    let fields = PyDict::new(py);
    let (nav, sigma, euler) = (&found.nav, &found.sigma, found.euler());
    let known = !matches!(found.heading_source, HeadingSource::Unknown);
    fields.set_item("time_s", nav.time.since(zero))?;
    fields.set_item(
        "latitude_deg_longitude_deg_height_m",
        scalars(
            py,
            [
                nav.position.latitude_deg(),
                nav.position.longitude_deg(),
                nav.position.height,
            ],
        )?,
    )?;
    fields.set_item("velocity_n_m_per_s", vector(py, &nav.velocity_n)?)?;
    fields.set_item("quaternion_nb_wxyz", quaternion(py, &nav.q_nb)?)?;
    fields.set_item("roll_deg", euler.roll.to_degrees())?;
    fields.set_item("pitch_deg", euler.pitch.to_degrees())?;
    fields.set_item("heading_deg", known.then(|| euler.heading_deg()))?;
    let errors = &found.imu_errors;
    fields.set_item("gyro_bias_rad_per_s", vector(py, &errors.gyro_bias)?)?;
    fields.set_item("accel_bias_m_per_s2", vector(py, &errors.accel_bias)?)?;
    fields.set_item("sigma_position_n_m", vector(py, &sigma.position)?)?;
    fields.set_item("sigma_velocity_n_m_per_s", vector(py, &sigma.velocity)?)?;
    let attitude = sigma.attitude.map(f64::to_degrees);
    fields.set_item("sigma_attitude_n_deg", vector(py, &attitude)?)?;
    fields.set_item("sigma_gyro_bias_rad_per_s", vector(py, &sigma.gyro_bias)?)?;
    fields.set_item("sigma_accel_bias_m_per_s2", vector(py, &sigma.accel_bias)?)?;
    fields.set_item("heading_source", source_name(found.heading_source))?;
    fields.set_item("heading_at_s", found.heading_at.since(zero))?;
    fields.set_item("standing_s", found.standing_s)?;
    fields.set_item("reversing", found.reversing)?;
    make(py, "StartAlignment", &fields)
}

/// Attitude at the first sample by gravity and a magnetic field, over the first ten seconds.
///
/// Parameters
/// ----------
/// t : (n,)
///     Seconds, or ``datetime64``.
/// gyro : (n, 3)
///     Angular rate, body axes (forward-right-down), rad/s.
/// accel : (n, 3)
///     Specific force, body axes, m/s².
/// mag : (n, 3) or (t, field)
///     Magnetic field, body axes, T, rows of NaN where there is none; or a tuple of stamps and fields.
/// declination_deg : float, default 0
///     Magnetic north from true north, positive to the east.
/// sigma_deg : float, default 15
///     Standard deviation of the compass: of one that nobody has calibrated in its vehicle.
/// gyro_bias_rad_per_s : (3,), optional
///     Taken out of the rates that carry the field to the first sample.
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`; what it says of the unit is what the tilt is worth.
///
/// Returns
/// -------
/// HeadingAlignment or None
///     None with fewer than three fields, and where they are not the Earth's in tesla (15 to 90 µT).
///
/// Raises
/// ------
/// InsnavError
///     Arrays that cannot be used; names the argument.
#[pyfunction]
#[pyo3(signature = (t, gyro, accel, mag, *, declination_deg=0.0, sigma_deg=15.0, gyro_bias_rad_per_s=None, config=None))]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn magnetic_start<'py>(
    t: &Bound<'py, PyAny>,
    gyro: &Bound<'py, PyAny>,
    accel: &Bound<'py, PyAny>,
    mag: &Bound<'py, PyAny>,
    declination_deg: f64,
    sigma_deg: f64,
    gyro_bias_rad_per_s: Option<&Bound<'py, PyAny>>,
    config: Option<&Bound<'py, PyAny>>,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    let py = t.py();
    let fail = fail(py);
    let config = settings::config(config)?;
    let source = inertial_and_magnetic(t, gyro, accel, Some(mag), &config).map_err(fail)?;
    let bias = bias(gyro_bias_rad_per_s).map_err(fail)?;
    let noise = or_consumer(&config);
    let (declination, sigma) = (declination_deg.to_radians(), sigma_deg.to_radians());
    let found = interruptible(py, move |_| {
        alignment::magnetic_start(&source.all(), &noise, &bias, declination, sigma)
    })?;
    let Some(found) = found else {
        return Ok(None);
    };
    // Of a small tilt the covariance of the rotation is that of tilt and heading.
    let variances = Vector3::new(
        found.tilt_sigma.powi(2),
        found.tilt_sigma.powi(2),
        found.heading_sigma.powi(2),
    );
    heading_alignment(
        py,
        &found.q_nb,
        &Matrix3::from_diagonal(&variances),
        found.heading_sigma,
        (bias, Vector3::repeat(noise.gyro_bias_sigma)),
    )
    .map(Some)
}

/// Attitude at the first sample from GNSS velocities, whichever way the vehicle looks.
///
/// Specific force turned by the gyros is held against what velocities, gravity and the turning Earth give: a guess by the q-method, and a
/// filter about it that knows biases, whose covariance is that of the result.
///
/// Parameters
/// ----------
/// arrays : Arrays
///     With ``imu`` (or ``imu_increment``) and ``gnss_velocity``.
/// latitude_deg : float
///     Where it is, to a hundredth of a degree.
/// config : mapping or path
///     Settings as of :func:`insnav.run`; ``imu.grade`` and ``noise`` say what the unit is worth, ``gnss.lever_arm_b_m`` where the antenna is.
/// height_m : float, default 0
///     Height above the ellipsoid, to a kilometre.
/// gyro_bias_rad_per_s, sigma_gyro_bias_rad_per_s : (3,), float, optional
///     What is known of the gyro bias beforehand.
///
/// Returns
/// -------
/// HeadingAlignment or None
///     None where the velocities do not tell the heading to three degrees, tell several, or contradict the inertial data.
///
/// Raises
/// ------
/// InsnavError
///     Arrays or settings that cannot be used.
///
/// Notes
/// -----
/// Velocity integration formula of [WuPan13], q-method of [Shuster81].
#[pyfunction]
#[pyo3(signature = (
    arrays, *, latitude_deg, config, height_m=0.0, gyro_bias_rad_per_s=None, sigma_gyro_bias_rad_per_s=None
))]
pub(crate) fn moving_base_start<'py>(
    arrays: &Bound<'py, PyMapping>,
    latitude_deg: f64,
    config: &Bound<'py, PyAny>,
    height_m: f64,
    gyro_bias_rad_per_s: Option<&Bound<'py, PyAny>>,
    sigma_gyro_bias_rad_per_s: Option<f64>,
) -> PyResult<Option<Bound<'py, PyAny>>> {
    let py = arrays.py();
    let fail = fail(py);
    let noise = stated_noise(config)?;
    let config = settings::config(Some(config))?;
    let source = inputs::arrays(arrays, &config)?;
    let place = Geodetic::from_degrees(latitude_deg, 0.0, height_m);
    if !place.is_valid() {
        return Err(fail(
            Failure::new(
                "bad_option",
                format!("latitude_deg = {latitude_deg}, height_m = {height_m}"),
                "a latitude from -90 to 90 degrees, a finite height",
            )
            .about(
                "latitude_deg",
                format!("{latitude_deg}"),
                "-90 to 90 degrees",
            ),
        ));
    }
    let options = MovingBaseOptions {
        gyro_bias: bias(gyro_bias_rad_per_s).map_err(fail)?,
        gyro_bias_sigma: sigma_gyro_bias_rad_per_s,
        lever_arm_b: Vector3::from(config.gnss.lever_arm_b_m.unwrap_or_default()),
        velocity_floor: config.gnss.velocity_sigma_floor_m_per_s,
    };
    let found = interruptible(py, move |_| {
        alignment::moving_base_start(&source.all(), &place, &noise, &options)
    })?;
    let Some(found) = found else {
        return Ok(None);
    };
    heading_alignment(
        py,
        &found.q_nb,
        &found.covariance_n,
        found.heading_sigma,
        (found.gyro_bias, found.gyro_bias_sigma),
    )
    .map(Some)
}

fn heading_alignment<'py>(
    py: Python<'py>,
    q_nb: &UnitQuaternion<f64>,
    covariance_n: &Matrix3<f64>,
    heading_sigma: f64,
    (gyro_bias, gyro_bias_sigma): (Vector3<f64>, Vector3<f64>),
) -> PyResult<Bound<'py, PyAny>> {
    let euler = Euler::from_quaternion(q_nb);
    let fields = PyDict::new(py);
    fields.set_item("quaternion_nb_wxyz", quaternion(py, q_nb)?)?;
    fields.set_item("roll_deg", euler.roll.to_degrees())?;
    fields.set_item("pitch_deg", euler.pitch.to_degrees())?;
    fields.set_item("heading_deg", turns(euler.heading))?;
    fields.set_item("sigma_heading_deg", heading_sigma.to_degrees())?;
    let by_rows = [0, 1, 2].map(|i| [0, 1, 2].map(|j| covariance_n[(i, j)]));
    fields.set_item("attitude_covariance_n_rad2", rows(py, by_rows.into_iter())?)?;
    fields.set_item("gyro_bias_rad_per_s", vector(py, &gyro_bias)?)?;
    fields.set_item("sigma_gyro_bias_rad_per_s", vector(py, &gyro_bias_sigma)?)?;
    make(py, "HeadingAlignment", &fields)
}

fn bias(given: Option<&Bound<'_, PyAny>>) -> Result<Vector3<f64>, Failure> {
    given.map_or(Ok(Vector3::zeros()), |given| {
        Argument::new("gyro_bias_rad_per_s", given).vector()
    })
}

/// What the settings say of the unit, and else a consumer's.
fn or_consumer(config: &Config) -> ImuNoise {
    config
        .noise
        .over(config.imu.grade.unwrap_or(ImuGrade::Consumer))
}

/// As in the JSON of `run`.
fn source_name(source: HeadingSource) -> &'static str {
    match source {
        HeadingSource::CourseVelocity => "course_velocity",
        HeadingSource::CoursePosition => "course_position",
        HeadingSource::Given => "given",
        HeadingSource::Gyrocompass => "gyrocompass",
        HeadingSource::Antenna => "antenna",
        HeadingSource::MovingBase => "moving_base",
        HeadingSource::Magnetic => "magnetic",
        HeadingSource::Unknown => "unknown",
        HeadingSource::Relative => "relative",
    }
}
