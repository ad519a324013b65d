//! What the benches of noise identification work on: the attitude of an ADIS16405, as six states, as one axis, and recorded.

use insnav::noise::{
    Basis, Block, ChannelDesign, EstimateOptions, FixedDesign, FixedUnknown, Identified,
    LinearModel, SolveOptions, als_estimate, bias_noise_per_step,
};
use insnav::sim::{Source, Stream};
use nalgebra::{DMatrix, Matrix2, RowVector2, SMatrix, Vector2};

/// Lags of a solve.
pub(crate) const LAGS: usize = 40;
/// Length of a step, s.
pub(crate) const STEP: f64 = 0.032;

/// Six states that all depend on one another: a body-frame attitude error at 40 °/s about a skew axis.
pub(crate) fn six_states() -> (LinearModel, DMatrix<f64>) {
    let mut model = LinearModel::attitude_axes(STEP, 100.0);
    let w = [0.4, -0.35, 0.45].map(|w| w * STEP);
    for (i, j, v) in [(0, 1, w[2]), (1, 2, w[0]), (2, 0, w[1])] {
        model.f[(i, j)] += v;
        model.f[(j, i)] -= v;
    }
    let noise = truth();
    let q = DMatrix::from_fn(6, 6, |i, j| if i == j { noise[i / 3] } else { 0.0 });
    let r = DMatrix::identity(3, 3) * noise[2];
    let gain = model.stationary_filter(&q, &r).expect("stable").gain;
    (model, gain)
}

/// Variances per step: angle, bias, measured angle.
pub(crate) fn truth() -> [f64; 3] {
    let arw = (2.0f64 / 60.0).to_radians();
    [
        arw * arw * STEP,
        bias_noise_per_step(0.007f64.to_radians(), 100.0, STEP),
        0.109f64.to_radians().powi(2),
    ]
}

/// Nine unknowns of six states and three channels, sizes known.
pub(crate) struct General {
    f: SMatrix<f64, 6, 6>,
    h: SMatrix<f64, 3, 6>,
    l: SMatrix<f64, 6, 3>,
    unknowns: [FixedUnknown<6, 3>; 9],
    pub(crate) measured: [SMatrix<f64, 3, 3>; LAGS],
}

impl General {
    pub(crate) fn new() -> Self {
        let (model, gain) = six_states();
        let basis = Basis::diagonal(6, 3);
        let unknowns = core::array::from_fn(|i| {
            let unknown = &basis.unknowns()[i];
            match unknown.block {
                Block::Process => {
                    FixedUnknown::Process(SMatrix::from_fn(|a, b| unknown.matrix[(a, b)]))
                }
                Block::Measurement => {
                    FixedUnknown::Measurement(SMatrix::from_fn(|a, b| unknown.matrix[(a, b)]))
                }
            }
        });
        let mut general = General {
            f: SMatrix::from_fn(|i, j| model.f[(i, j)]),
            h: SMatrix::from_fn(|i, j| model.h[(i, j)]),
            l: SMatrix::from_fn(|i, j| gain[(i, j)]),
            unknowns,
            measured: [SMatrix::zeros(); LAGS],
        };
        let theta: [f64; 9] = core::array::from_fn(|i| truth()[i / 3]);
        general.measured = general.design().covariances(&theta);
        general
    }

    fn design(&self) -> FixedDesign<6, 3, 9> {
        FixedDesign::new(&self.f, &self.h, &self.l, &self.unknowns).expect("stable")
    }

    /// Design and solution.
    pub(crate) fn solve(&self) -> [f64; 9] {
        self.design().solve(&self.measured).expect("identified")
    }
}

/// One axis: angle and bias.
pub(crate) struct Channel {
    f: Matrix2<f64>,
    h: RowVector2<f64>,
    l: Vector2<f64>,
    measured: [f64; LAGS],
}

impl Channel {
    pub(crate) fn new() -> Self {
        let mut channel = Channel {
            f: Matrix2::new(1.0, -STEP, 0.0, 0.9997),
            h: RowVector2::new(1.0, 0.0),
            l: Vector2::new(0.06, -0.01),
            measured: [0.0; LAGS],
        };
        channel.measured = channel.design().covariances(truth());
        channel
    }

    fn design(&self) -> ChannelDesign<LAGS> {
        ChannelDesign::new(&self.f, &self.h, &self.l).expect("stable")
    }

    /// Design and solution.
    pub(crate) fn solve(&self) -> [f64; 3] {
        self.design()
            .solve(&self.measured, [None; 3])
            .expect("identified")
    }
}

/// An angle as measured, sample by sample.
pub(crate) fn record(samples: usize, seed: u64) -> Vec<f64> {
    let [q, bias, r] = truth().map(f64::sqrt);
    let mut white = Source::new(seed, Stream::GyroWhite);
    let mut drift = Source::new(seed, Stream::GyroBias);
    let mut angle = Source::new(seed, Stream::AccelWhite);
    let (mut theta, mut b) = (0.0, 0.0);
    (0..samples)
        .map(|_| {
            theta += q * white.normal() - STEP * b;
            b = (-STEP / 100.0f64).exp() * b + bias * drift.normal();
            theta + r * angle.normal()
        })
        .collect()
}

/// Noise of such a record in three rounds with Bartlett's weight, from a process noise a hundred times too large; the bias known.
pub(crate) fn batch(record: &[f64]) -> Identified {
    let [q, bias, r] = truth();
    let options = EstimateOptions {
        solve: SolveOptions {
            known: vec![None, Some(bias), None],
            ..Default::default()
        },
        ..Default::default()
    };
    als_estimate(
        &[record],
        &LinearModel::attitude_channel(STEP, 100.0),
        &Basis::diagonal(2, 1),
        &[100.0 * q, bias, r],
        &options,
    )
    .expect("identified")
}
