//! Small least-squares problems.

use std::f64::consts::PI;

/// A complex number: two horizontal components.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pair {
    pub(super) re: f64,
    pub(super) im: f64,
}

/// Similarity that takes one series of pairs into another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Turn {
    /// Angle from the first to the second, rad.
    pub(super) angle: f64,
    /// Its standard deviation, rad.
    pub(super) sigma: f64,
    /// Size of the second by that of the first.
    pub(super) scale: f64,
    /// 1 when a turn explains everything, 0 when nothing.
    pub(super) coherence: f64,
}

/// The turn that takes `x` into `y`, or, `mirrored`, that of the mirror image of `x`.
pub(super) fn turn(pairs: &[(Pair, Pair)], mirrored: bool) -> Option<Turn> {
    let n = pairs.len() as f64;
    let (mut xx, mut yy, mut re, mut im) = (0.0, 0.0, 0.0, 0.0);
    for (x, y) in pairs {
        let x_im = if mirrored { -x.im } else { x.im };
        xx += x.re * x.re + x.im * x.im;
        yy += y.re * y.re + y.im * y.im;
        re += x.re * y.re + x_im * y.im;
        im += x.re * y.im - x_im * y.re;
    }
    if !(xx > 0.0 && yy > 0.0 && n > 3.0) {
        return None;
    }
    let coherence = re.hypot(im) / (xx * yy).sqrt();
    // The variance of a cross-spectrum's phase, ([Bendat10], eq. 9.52).
    let sigma = ((1.0 - coherence * coherence).max(0.0) / (2.0 * n)).sqrt() / coherence.max(1e-9);
    Some(Turn {
        angle: im.atan2(re),
        sigma: sigma.min(PI),
        scale: re.hypot(im) / xx,
        coherence,
    })
}

/// Slope of a weighted straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slope {
    pub(super) value: f64,
    pub(super) sigma: f64,
    /// Share of the variance that the line explains.
    pub(super) explained: f64,
}

/// `y = a + b x` by (x, y, weight).
pub(super) fn slope(points: &[(f64, f64, f64)]) -> Option<Slope> {
    if points.len() < 5 {
        return None;
    }
    let total: f64 = points.iter().map(|p| p.2).sum();
    let mean =
        |of: fn(&(f64, f64, f64)) -> f64| points.iter().map(|p| p.2 * of(p)).sum::<f64>() / total;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y, w) in points {
        xx += w * (x - mx).powi(2);
        xy += w * (x - mx) * (y - my);
        yy += w * (y - my).powi(2);
    }
    if !(xx > 0.0 && yy > 0.0) {
        return None;
    }
    let value = xy / xx;
    let residual = (yy - value * xy).max(0.0) / (points.len() - 2) as f64;
    Some(Slope {
        value,
        sigma: (residual / xx).sqrt(),
        explained: xy * xy / (xx * yy),
    })
}

/// Quantile of the values, which are reordered; 0 when there are none.
pub(super) fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = (share * (values.len() - 1) as f64).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_and_mirrors_are_told_apart() {
        let made: Vec<(Pair, Pair)> = (0..50)
            .map(|i| {
                let (re, im) = ((f64::from(i) * 0.7).sin(), (f64::from(i) * 1.3).cos());
                let (c, s) = (0.4_f64.cos() * 2.0, 0.4_f64.sin() * 2.0);
                let y = Pair {
                    re: c * re - s * im,
                    im: s * re + c * im,
                };
                (Pair { re, im }, y)
            })
            .collect();
        let t = turn(&made, false).unwrap();
        assert!((t.angle - 0.4).abs() < 1e-12 && (t.scale - 2.0).abs() < 1e-12);
        assert!(t.coherence > 1.0 - 1e-12 && t.sigma < 1e-6);
        assert!(turn(&made, true).unwrap().coherence < 0.5);
        let mirrored: Vec<_> = made
            .iter()
            .map(|(x, y)| {
                (
                    Pair {
                        re: x.re,
                        im: -x.im,
                    },
                    *y,
                )
            })
            .collect();
        let t = turn(&mirrored, true).unwrap();
        assert!((t.angle - 0.4).abs() < 1e-12 && t.coherence > 1.0 - 1e-12);
    }

    #[test]
    fn a_line_with_an_outlier_of_no_weight() {
        let mut points: Vec<(f64, f64, f64)> = (0..20)
            .map(|i| (f64::from(i), 3.0 - 0.5 * f64::from(i), 1.0))
            .collect();
        points.push((5.0, 1000.0, 0.0));
        let s = slope(&points).unwrap();
        assert!((s.value + 0.5).abs() < 1e-12 && s.explained > 1.0 - 1e-12);
    }
}
