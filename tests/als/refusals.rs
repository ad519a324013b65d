//! What cannot be identified is refused, with the name of what is in the way.

use crate::unit::{diagonal, matrix, record};
use insnav::noise::{
    Basis, Block, EstimateOptions, LinearModel, Refusal, SolveOptions, als_design, als_estimate,
    als_solve, lag_covariance, mdm_estimate,
};
use nalgebra::DMatrix;

fn channel() -> LinearModel {
    LinearModel::attitude_channel(0.1, 10.0)
}

fn gain() -> DMatrix<f64> {
    matrix(2, 1, &[0.3, -0.1])
}

fn estimate(y: &[f64]) -> Result<(), Refusal> {
    let options = EstimateOptions {
        lags: 16,
        ..Default::default()
    };
    als_estimate(
        &[y],
        &channel(),
        &Basis::diagonal(2, 1),
        &[1e-3, 1e-5, 1.0],
        &options,
    )
    .map(|_| ())
}

#[test]
fn loops_that_are_not_stable() {
    let refused = als_design(
        &channel(),
        &DMatrix::zeros(2, 1),
        &Basis::diagonal(2, 1),
        10,
    );
    let Err(Refusal::Unstable { spectral_radius }) = refused else {
        panic!("an integrator without gain is no stable loop")
    };
    assert!((spectral_radius - 1.0).abs() < 1e-3);
}

#[test]
fn structures_with_too_many_unknowns() {
    let basis = Basis::symmetric(2, 1);
    let design = als_design(&channel(), &gain(), &basis, 30).expect("stable");
    let y = record(&channel(), &[1e-3, 1e-5], &[1.0], 5000, 1);
    let nu = crate::unit::innovations(&channel(), &gain(), &y);
    let covariance = lag_covariance(&[&nu], 1, 30).expect("long");
    let refused = als_solve(&design, &covariance, &SolveOptions::default());
    let Err(Refusal::RankDeficient {
        rank,
        unknowns,
        undetermined,
    }) = refused
    else {
        panic!("n p = 2 elements of Q at most")
    };
    assert_eq!((rank, unknowns), (3, 4));
    assert!(
        undetermined.contains(&"Q[0,1]".to_string()),
        "{undetermined:?}"
    );
    let text = Refusal::RankDeficient {
        rank,
        unknowns,
        undetermined,
    }
    .to_string();
    assert!(text.contains("3 of 4") && text.contains("Q[0,1]"), "{text}");
    // With one of them known the others are found.
    let options = SolveOptions {
        known: vec![None, Some(0.0), None, None],
        ..Default::default()
    };
    assert!(als_solve(&design, &covariance, &options).is_ok());
}

#[test]
fn records_that_are_too_short() {
    let y = record(&channel(), &[1e-3, 1e-5], &[1.0], 25, 1);
    assert!(
        matches!(
            estimate(&y),
            Err(Refusal::TooShort {
                lag: 15,
                count: 10,
                ..
            })
        ),
        "{:?}",
        estimate(&y)
    );
    let y = record(&channel(), &[1e-3, 1e-5], &[1.0], 12, 1);
    assert!(matches!(estimate(&y), Err(Refusal::Shape { .. })));
    let short = mdm_estimate(
        &[&y],
        &channel(),
        &Basis::diagonal(2, 1),
        &Default::default(),
    );
    assert!(matches!(short, Err(Refusal::TooShort { .. })));
    // Long, but each product much like its neighbours: a slow process seen without noise to speak of.
    let slow = LinearModel {
        f: diagonal(&[0.999]),
        g: DMatrix::identity(1, 1),
        h: DMatrix::identity(1, 1),
    };
    let y = record(&slow, &[1.0], &[1e-6], 400, 1);
    let covariance = lag_covariance(&[&y], 1, 50).expect("long");
    let design =
        als_design(&slow, &DMatrix::zeros(1, 1), &Basis::diagonal(1, 1), 50).expect("stable");
    let refused = als_solve(&design, &covariance, &SolveOptions::default());
    assert!(
        matches!(refused, Err(Refusal::TooShort { independent, .. }) if independent < 10.0),
        "{refused:?}"
    );
}

#[test]
fn channels_without_noise_to_see() {
    let y = record(&channel(), &[1e-3, 1e-5], &[1.0], 2000, 1);
    assert_eq!(estimate(&y), Ok(()));
    assert_eq!(
        estimate(&[0.25; 2000]),
        Err(Refusal::Flat {
            channel: 0,
            distinct: 1
        })
    );
    let coarse: Vec<f64> = y.iter().map(|v| v.signum()).collect();
    assert_eq!(
        estimate(&coarse),
        Err(Refusal::Flat {
            channel: 0,
            distinct: 2
        })
    );
    let top = y.iter().copied().fold(f64::MIN, f64::max) * 0.6;
    let cut: Vec<f64> = y.iter().map(|v| v.min(top)).collect();
    assert!(matches!(
        estimate(&cut),
        Err(Refusal::Saturated { channel: 0, .. })
    ));
    let mut broken = y.clone();
    broken[77] = f64::NAN;
    assert_eq!(
        estimate(&broken),
        Err(Refusal::NotFinite {
            what: "measurement"
        })
    );
}

#[test]
fn sizes_that_do_not_fit() {
    let basis = Basis::diagonal(2, 1);
    let wrong = [
        als_design(&channel(), &matrix(1, 2, &[0.3, -0.1]), &basis, 10).err(),
        als_design(&channel(), &gain(), &Basis::diagonal(3, 1), 10).err(),
        als_design(&channel(), &gain(), &Basis::diagonal(2, 2), 10).err(),
        als_design(&channel(), &gain(), &Basis::new(2, 1), 10).err(),
        als_design(&channel(), &gain(), &basis, 0).err(),
        als_estimate(
            &[&[1.0; 100]],
            &channel(),
            &basis,
            &[1.0],
            &Default::default(),
        )
        .err(),
    ];
    for (i, refusal) in wrong.iter().enumerate() {
        assert!(
            matches!(refusal, Some(Refusal::Shape { .. })),
            "{i}: {refusal:?}"
        );
    }
    assert!(
        Basis::new(2, 1)
            .with_custom(Block::Process, &matrix(1, 1, &[1.0]), "q")
            .is_err()
    );
}

#[test]
fn starts_from_which_no_gain_follows() {
    let y = record(&channel(), &[1e-3, 1e-5], &[1.0], 2000, 1);
    let from = |start: [f64; 3]| {
        als_estimate(
            &[&y],
            &channel(),
            &Basis::diagonal(2, 1),
            &start,
            &Default::default(),
        )
    };
    for start in [[1e-3, 1e-5, 0.0], [0.0, 0.0, 1.0]] {
        let refused = from(start);
        assert!(
            matches!(
                refused,
                Err(Refusal::NoStationaryFilter { .. } | Refusal::Unstable { .. })
            ),
            "{start:?}: {refused:?}"
        );
    }
    // No variances at all.
    for start in [[1e-3, 1e-5, -1.0], [f64::NAN, 1e-5, 1.0]] {
        let refused = from(start);
        assert!(
            matches!(refused, Err(Refusal::Setting { what: "start", .. })),
            "{start:?}: {refused:?}"
        );
    }
}
