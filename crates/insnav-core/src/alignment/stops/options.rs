//! What is asked of an alignment, and what is known beforehand.

use super::standing::Taper;
use super::{AlignmentMethod, Refusal};
use crate::earth::Geodetic;
use crate::error::Result;
use crate::imu::ImuNoise;
use crate::time::Time;

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
    /// Heading of the body's x axis at the first stop's begin and its sigma, rad, if it is known. The gyros carry it to the last stop
    /// for methods that use only that.
    pub heading: Option<(f64, f64)>,
    /// The azimuth is called unobservable when its sigma would be larger, rad: a method that is asked for is then refused, before
    /// or after its fit, the automatic choice levels, or says so in the result.
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

    pub(super) fn check(&self) -> Result<()> {
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
