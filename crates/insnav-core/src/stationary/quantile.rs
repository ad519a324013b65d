//! Quantiles of sums of squares, from which thresholds follow.

#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;

/// Normal quantile of a probability of 1e-3 to be above.
pub const ONE_IN_1E3: f64 = 3.090;
/// Of 1e-4.
pub const ONE_IN_1E4: f64 = 3.719;
/// Of 1e-6.
pub const ONE_IN_1E6: f64 = 4.753;

/// Quantile of a sum of squares with this mean and variance, taken as a scaled chi-square of the degrees of freedom that
/// these two imply (\[Satterthwaite46\]; the quantile by \[Wilson31\], which is within 1.5 % from ten degrees of freedom on
/// and within 4 % at three).
/// `z` is the normal quantile of the same probability.
pub fn of_squares(mean: f64, variance: f64, z: f64) -> f64 {
    let ninth = variance / (9.0 * mean * mean);
    let root = 1.0 - ninth + z * ninth.sqrt();
    mean * root * root * root
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tabulated quantiles of chi-square, [Abramowitz64] table 26.8: degrees of freedom, probability 1e-3 and 1e-4.
    #[test]
    fn chi_square_quantiles_are_those_of_the_table() {
        for (dof, three, four) in [
            (3.0, 16.266, 21.108),
            (10.0, 29.588, 35.564),
            (30.0, 59.703, 67.633),
            (100.0, 149.449, 161.319),
        ] {
            for (z, tabulated) in [(ONE_IN_1E3, three), (ONE_IN_1E4, four)] {
                let found = of_squares(dof, 2.0 * dof, z);
                let off = (found / tabulated - 1.0).abs();
                assert!(off < if dof < 5.0 { 0.04 } else { 0.015 }, "{dof}: {found}");
            }
        }
    }

    #[test]
    fn a_scaled_sum_has_a_scaled_quantile() {
        let scaled = of_squares(7.0 * 30.0, 49.0 * 60.0, ONE_IN_1E3);
        let plain = of_squares(30.0, 60.0, ONE_IN_1E3);
        assert!((scaled / plain - 7.0).abs() < 1e-12);
    }
}
