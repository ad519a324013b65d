//! Settings outside their range, as errors that name the key.

use crate::error::{Error, Result};

pub(super) fn require(
    ok: bool,
    key: &'static str,
    value: f64,
    expected: &'static str,
) -> Result<()> {
    if ok {
        Ok(())
    } else {
        Err(Error::Config {
            key,
            value,
            expected,
        })
    }
}

pub(super) fn finite(values: &[f64], key: &'static str) -> Result<()> {
    let bad = values.iter().find(|v| !v.is_finite());
    bad.map_or(Ok(()), |v| require(false, key, *v, "finite"))
}

/// For standard deviations and steps of a scale.
pub(super) fn not_negative(values: &[f64], key: &'static str) -> Result<()> {
    let bad = values.iter().find(|v| !(0.0..f64::INFINITY).contains(*v));
    bad.map_or(Ok(()), |v| {
        require(false, key, *v, "finite and not negative")
    })
}

/// For correlation times, of which infinity is one.
pub(super) fn positive(value: f64, key: &'static str) -> Result<()> {
    require(value > 0.0, key, value, "positive")
}
