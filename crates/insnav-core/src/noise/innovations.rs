//! A record filtered with a constant gain.

use super::model::shape;
use super::{LinearModel, Refusal};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use std::vec::Vec;

/// Where the response to the initial state has come down to this, the rest of the record tells nothing of it.
const RESPONSE_GONE: f64 = 1e-9;
/// Samples between two looks at it.
const BLOCK: usize = 64;

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
    match (model.states(), model.channels()) {
        (1, 1) => fixed::<1, 1>(model, gain, y),
        (2, 1) => fixed::<2, 1>(model, gain, y),
        (3, 1) => fixed::<3, 1>(model, gain, y),
        (6, 3) => fixed::<6, 3>(model, gain, y),
        _ => any(model, gain, y),
    }
}

/// The initial state by its normal equations; `None` where the record tells nothing of it.
fn initial(normal: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    let least = 1e-13 * normal.amax();
    normal.svd(true, true).solve(right, least).ok()
}

fn fixed<const N: usize, const P: usize>(
    model: &LinearModel,
    gain: &DMatrix<f64>,
    y: &[f64],
) -> Vec<f64> {
    let f = SMatrix::<f64, N, N>::from_fn(|i, j| model.f[(i, j)]);
    let h = SMatrix::<f64, P, N>::from_fn(|i, j| model.h[(i, j)]);
    let fl = f * SMatrix::<f64, N, P>::from_fn(|i, j| gain[(i, j)]);
    let closed = f - fl * h;
    let mut response = h;
    let mut normal = SMatrix::<f64, N, N>::zeros();
    let mut right = SVector::<f64, N>::zeros();
    let mut x = SVector::<f64, N>::zeros();
    let mut out = Vec::with_capacity(y.len());
    let whole = y.len() - y.len() % P;
    let mut blocks = y[..whole].chunks(BLOCK * P);
    // The response is looked at once a block: until it has gone, it is fitted.
    while response.amax() >= RESPONSE_GONE
        && let Some(block) = blocks.next()
    {
        for value in block
            .chunks_exact(P)
            .map(SVector::<f64, P>::from_column_slice)
        {
            let nu = value - h * x;
            normal += response.transpose() * response;
            right += response.transpose() * nu;
            out.extend_from_slice(nu.as_slice());
            // One product with the state: the shortest chain from sample to sample.
            x = closed * x + fl * value;
            response *= closed;
        }
    }
    for value in blocks
        .flat_map(|block| block.chunks_exact(P))
        .map(SVector::<f64, P>::from_column_slice)
    {
        out.extend_from_slice((value - h * x).as_slice());
        x = closed * x + fl * value;
    }
    let normal = DMatrix::from_fn(N, N, |i, j| normal[(i, j)]);
    let Some(start) = initial(normal, &DVector::from_fn(N, |i, _| right[i])) else {
        return out;
    };
    let mut state = SVector::<f64, N>::from_fn(|i, _| start[i]);
    let gone = RESPONSE_GONE * state.amax();
    for block in out.chunks_mut(BLOCK * P) {
        if state.amax() <= gone {
            break;
        }
        for nu in block.chunks_exact_mut(P) {
            let shift = h * state;
            nu.iter_mut().zip(shift.iter()).for_each(|(v, s)| *v -= s);
            state = closed * state;
        }
    }
    out
}

fn any(model: &LinearModel, gain: &DMatrix<f64>, y: &[f64]) -> Vec<f64> {
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
    let Some(mut state) = initial(normal, &right) else {
        return out;
    };
    let gone = RESPONSE_GONE * state.amax();
    for sample in out.chunks_exact_mut(p) {
        if state.amax() <= gone {
            break;
        }
        nu.gemv(1.0, &model.h, &state, 0.0);
        sample.iter_mut().zip(nu.iter()).for_each(|(v, s)| *v -= s);
        next.gemv(1.0, &closed, &state, 0.0);
        std::mem::swap(&mut state, &mut next);
    }
    out
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
        // The fit of the one goes on for some samples of next to no response.
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-9));
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
