//! A number found from independent runs, and how well it is known.

use serde::Serialize;

/// A value and its standard error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its standard deviation over repetitions of the whole experiment; `None` from a single run.
    pub standard_error: Option<f64>,
}

impl Estimate {
    /// Mean of one number a run.
    pub fn mean(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let scatter = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Estimate {
            value: mean,
            standard_error: (values.len() > 1).then(|| (scatter / n).sqrt()),
        }
    }

    /// Root of the mean of one mean square a run. Its standard error is that of the mean square carried through the root,
    /// which for a single Gaussian error a run is the familiar value/√(2n).
    pub fn root_mean_square(squares: &[f64]) -> Self {
        let square = Estimate::mean(squares);
        let value = square.value.max(0.0).sqrt();
        let standard_error = |error: f64| {
            if value > 0.0 {
                error / (2.0 * value)
            } else {
                0.0
            }
        };
        Estimate {
            value,
            standard_error: square.standard_error.map(standard_error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{Source, Stream};

    #[test]
    fn of_a_few_numbers_by_hand() {
        let e = Estimate::mean(&[1.0, 2.0, 6.0]);
        assert_eq!(e.value, 3.0);
        // Variance 7, over three.
        assert!((e.standard_error.unwrap() - (7.0f64 / 3.0).sqrt()).abs() < 1e-15);
        assert_eq!(Estimate::mean(&[4.0]).standard_error, None);
        let none = Estimate::root_mean_square(&[0.0, 0.0]);
        assert_eq!((none.value, none.standard_error), (0.0, Some(0.0)));
    }

    /// 400 experiments of 100 Gaussian errors: the stated standard error is what they scatter by, and σ/√200.
    #[test]
    fn the_standard_error_is_the_scatter_of_repetitions() {
        let mut source = Source::new(3, Stream::Initial);
        let found: Vec<Estimate> = (0..400)
            .map(|_| {
                let squares: Vec<f64> = (0..100).map(|_| (0.5 * source.normal()).powi(2)).collect();
                Estimate::root_mean_square(&squares)
            })
            .collect();
        let values: Vec<f64> = found.iter().map(|e| e.value).collect();
        let scatter = Estimate::mean(&values).standard_error.unwrap() * 20.0;
        let stated = found.iter().filter_map(|e| e.standard_error).sum::<f64>() / 400.0;
        let expected = 0.5 / 200f64.sqrt();
        // A standard deviation from 400 values is good to 3.5 %.
        assert!((scatter / expected - 1.0).abs() < 0.12, "{scatter}");
        assert!((stated / expected - 1.0).abs() < 0.05, "{stated}");
    }
}
