//! A record filtered with a constant gain.

use super::model::shape;
use super::{LinearModel, Refusal};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use std::vec::Vec;

/// Where the response to the initial state has come down to this, the rest of the record tells nothing of it.
const RESPONSE_GONE: f64 = 1e-9;

/// Measurements that a filter with this gain, begun at zero, had these innovations of.
///
/// With them a record of innovations can be filtered again with another gain. They differ from what was measured by the
/// response of the model to its initial state and to known inputs, which no innovation depends on.
///
/// # Errors
/// [`Refusal::Shape`], [`Refusal::NotFinite`].
pub fn measurements_of_innovations(
    model: &LinearModel,
    gain: &DMatrix<f64>,
    innovations: &[f64],
) -> Result<Vec<f64>, Refusal> {
    model.check()?;
    let (n, p) = (model.states(), model.channels());
    shape("gain", gain, n, p)?;
    let mut x = DMatrix::zeros(n, 1);
    let mut y = Vec::with_capacity(innovations.len());
    for nu in innovations.chunks_exact(p) {
        let nu = DMatrix::from_column_slice(p, 1, nu);
        y.extend((&model.h * &x + &nu).iter());
        x = &model.f * (x + gain * nu);
    }
    Ok(y)
}

/// Innovations of a filter with constant gain, begun at the state that makes them smallest.
///
/// Beginning anywhere else leaves a transient as long as the slowest mode of the loop. Innovations are linear in the initial
/// state: what is fitted takes n of the record's degrees of freedom.
pub(super) fn innovations(model: &LinearModel, gain: &DMatrix<f64>, y: &[f64]) -> Vec<f64> {
    // The usual sizes in registers.
    let (mut nu, normal, right) = match (model.states(), model.channels()) {
        (1, 1) => fixed::<1, 1>(model, gain, y),
        (2, 1) => fixed::<2, 1>(model, gain, y),
        (3, 1) => fixed::<3, 1>(model, gain, y),
        (6, 3) => fixed::<6, 3>(model, gain, y),
        _ => any(model, gain, y),
    };
    let least = 1e-13 * normal.amax();
    let Ok(start) = normal.svd(true, true).solve(&right, least) else {
        return nu;
    };
    let closed = model.closed_loop(gain);
    let mut state = start.clone();
    for nu in nu.chunks_exact_mut(model.channels()) {
        let shift = &model.h * &state;
        nu.iter_mut().zip(shift.iter()).for_each(|(v, s)| *v -= s);
        state = &closed * state;
        if state.amax() <= RESPONSE_GONE * start.amax() {
            break;
        }
    }
    nu
}

/// Innovations from the state zero, and the normal equations of the initial state: matrix and right-hand side.
type FromZero = (Vec<f64>, DMatrix<f64>, DVector<f64>);

fn fixed<const N: usize, const P: usize>(
    model: &LinearModel,
    gain: &DMatrix<f64>,
    y: &[f64],
) -> FromZero {
    let f = SMatrix::<f64, N, N>::from_fn(|i, j| model.f[(i, j)]);
    let h = SMatrix::<f64, P, N>::from_fn(|i, j| model.h[(i, j)]);
    let fl = f * SMatrix::<f64, N, P>::from_fn(|i, j| gain[(i, j)]);
    let closed = f - fl * h;
    let mut response = h;
    let mut normal = SMatrix::<f64, N, N>::zeros();
    let mut right = SVector::<f64, N>::zeros();
    let mut x = SVector::<f64, N>::zeros();
    let mut out = Vec::with_capacity(y.len());
    let mut samples = y.chunks_exact(P).map(SVector::<f64, P>::from_column_slice);
    for value in samples.by_ref() {
        let nu = value - h * x;
        normal += response.transpose() * response;
        right += response.transpose() * nu;
        out.extend_from_slice(nu.as_slice());
        // One product with the state: the shortest chain from sample to sample.
        x = closed * x + fl * value;
        response *= closed;
        if response.amax() < RESPONSE_GONE {
            break;
        }
    }
    for value in samples {
        out.extend_from_slice((value - h * x).as_slice());
        x = closed * x + fl * value;
    }
    (
        out,
        DMatrix::from_fn(N, N, |i, j| normal[(i, j)]),
        DVector::from_fn(N, |i, _| right[i]),
    )
}

fn any(model: &LinearModel, gain: &DMatrix<f64>, y: &[f64]) -> FromZero {
    let (n, p) = (model.states(), model.channels());
    let fl = &model.f * gain;
    let closed = model.closed_loop(gain);
    let mut response = model.h.clone();
    let mut normal = DMatrix::zeros(n, n);
    let mut right = DVector::zeros(n);
    let (mut x, mut next) = (DVector::zeros(n), DVector::zeros(n));
    let mut value = DVector::zeros(p);
    let mut nu = DVector::zeros(p);
    let mut fitting = true;
    let mut out = Vec::with_capacity(y.len());
    for sample in y.chunks_exact(p) {
        value.copy_from_slice(sample);
        nu.copy_from(&value);
        nu.gemv(-1.0, &model.h, &x, 1.0);
        out.extend_from_slice(nu.as_slice());
        if fitting {
            normal += response.transpose() * &response;
            right.gemv_tr(1.0, &response, &nu, 1.0);
            response *= &closed;
            fitting = response.amax() > RESPONSE_GONE;
        }
        next.gemv(1.0, &closed, &x, 0.0);
        next.gemv(1.0, &fl, &value, 1.0);
        std::mem::swap(&mut x, &mut next);
    }
    (out, normal, right)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channel() -> (LinearModel, DMatrix<f64>) {
        let model = LinearModel {
            f: DMatrix::from_row_slice(2, 2, &[1.0, -0.1, 0.0, 0.99]),
            g: DMatrix::identity(2, 2),
            h: DMatrix::from_row_slice(1, 2, &[1.0, 0.0]),
        };
        (model, DMatrix::from_row_slice(2, 1, &[0.3, -0.05]))
    }

    #[test]
    fn response_to_the_initial_state_leaves_nothing() {
        let (model, gain) = channel();
        let mut x = DMatrix::from_row_slice(2, 1, &[5.0, -2.0]);
        let y: Vec<f64> = (0..300)
            .map(|_| {
                let value = (&model.h * &x)[0];
                x = &model.f * &x;
                value
            })
            .collect();
        // Of values up to 50, by a fit whose smallest direction is a hundredth of the largest.
        assert!(
            innovations(&model, &gain, &y)
                .iter()
                .all(|v| v.abs() < 1e-9)
        );
    }

    #[test]
    fn sizes_at_run_time_give_the_same() {
        let (model, gain) = channel();
        let y: Vec<f64> = (0..300).map(|k| (f64::from(k * k) * 0.7).sin()).collect();
        let (a, b) = (fixed::<2, 1>(&model, &gain, &y), any(&model, &gain, &y));
        assert!(a.0.iter().zip(&b.0).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn innovations_can_be_turned_back() {
        let (model, gain) = channel();
        let y: Vec<f64> = (0..300).map(|k| (f64::from(k * k) * 0.7).sin()).collect();
        let nu = innovations(&model, &gain, &y);
        let again = measurements_of_innovations(&model, &gain, &nu).expect("fits");
        let other = DMatrix::from_row_slice(2, 1, &[0.1, -0.01]);
        let (a, b) = (
            innovations(&model, &other, &y),
            innovations(&model, &other, &again),
        );
        // What differs is the response to the initial state, which each fit takes out.
        assert!(
            a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6),
            "{a:?} {b:?}"
        );
    }
}
