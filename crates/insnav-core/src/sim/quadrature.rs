//! Gauss–Legendre quadrature and Legendre series on [−1, 1].

use core::f64::consts::PI;

/// Nodes and weights of the `N`-point Gauss–Legendre rule on [−1, 1]: exact for polynomials of degree 2N − 1.
///
/// Newton's method on P_N from the asymptotic zeros (\[Abramowitz64\] 25.4.29 and 22.16.6).
pub(super) fn gauss_legendre<const N: usize>() -> [(f64, f64); N] {
    core::array::from_fn(|i| {
        let mut x = -(PI * (i as f64 + 0.75) / (N as f64 + 0.5)).cos();
        let mut slope = 1.0;
        // Quadratic convergence from three correct digits.
        for _ in 0..6 {
            let p = legendre::<32>(x);
            slope = N as f64 * (x * p[N] - p[N - 1]) / (x * x - 1.0);
            x -= p[N] / slope;
        }
        (x, 2.0 / ((1.0 - x * x) * slope * slope))
    })
}

/// P_0(x) … P_{K−1}(x) by the three-term recurrence.
pub(super) fn legendre<const K: usize>(x: f64) -> [f64; K] {
    let mut p = [1.0; K];
    p[1] = x;
    for j in 1..K - 1 {
        let n = j as f64;
        p[j + 1] = ((2.0 * n + 1.0) * x * p[j] - n * p[j - 1]) / (n + 1.0);
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rule_integrates_polynomials_exactly() {
        let rule = gauss_legendre::<10>();
        for degree in 0..20 {
            let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(degree)).sum();
            let exact = if degree % 2 == 0 {
                2.0 / f64::from(degree + 1)
            } else {
                0.0
            };
            // Rounding of ten weights of size 0.3.
            assert!((sum - exact).abs() < 2e-15, "degree {degree}: {sum}");
        }
        // Negative control: degree 2N is beyond the rule.
        let sum: f64 = rule.iter().map(|(x, w)| w * x.powi(20)).sum();
        assert!((sum - 2.0 / 21.0).abs() > 1e-7);
    }

    #[test]
    fn recurrence_gives_the_closed_forms() {
        let p = legendre::<5>(0.3);
        assert!((p[2] - 0.5 * (3.0 * 0.09 - 1.0)).abs() < 1e-16);
        assert!((p[4] - (35.0 * 0.3f64.powi(4) - 30.0 * 0.09 + 3.0) / 8.0).abs() < 1e-16);
    }
}
