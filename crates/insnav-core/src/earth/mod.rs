//! The Earth as the navigator sees it: WGS-84 ellipsoid, positions on it, gravity and rates.

mod ellipsoid;
mod geodetic;
mod gravity;
mod rates;

pub use ellipsoid::{
    EARTH_RATE, ECCENTRICITY_SQUARED, FLATTENING, SEMI_MAJOR_AXIS, SEMI_MINOR_AXIS,
    meridian_radius, transverse_radius,
};
pub use geodetic::{Geodetic, LocalFrame, NO_LATITUDE_WITHIN};
pub use gravity::{gravity, gravity_gradient};
pub use rates::{LocalEarth, earth_rate_n, transport_rate_n};
