//! Stated sigmas of positions against what the positions themselves show.
//!
//! Errors that stay are seen by no scatter, so stated sigmas may well be larger than it: only far too small ones are certain,
//! and far too large ones where the receiver's own velocity shows that its positions hardly wander over a minute.

use super::fit::quantile;
use super::{Facts, Finding, Severity};
use insnav_core::sample::GnssPosition;

/// Scatter beyond this many stated sigmas is no chance: of hundreds of fixes, and the quietest quarter of them.
const TOO_SMALL: f64 = 3.0;
/// Stated sigmas beyond this many times the wander over a minute.
const TOO_LARGE: f64 = 6.0;
/// Fewest differences that tell.
const FEWEST: usize = 100;
/// The lower quartile of |x| for a normal x of unit variance.
const QUARTILE: f64 = 0.318_639;
/// The median of |x| likewise.
const MEDIAN: f64 = 0.674_490;
/// Spans over which positions may wander against the integral of velocity, s.
const SPAN: f64 = 60.0;
/// Fewest of them.
const FEWEST_SPANS: usize = 3;

pub(super) fn find(facts: &Facts<'_>) -> Option<Finding> {
    let stated = stated(facts)?;
    let learns = facts.config.gnss.sigma_scale.fixed().is_none();
    if let Some(scatter) = scatter(facts).filter(|s| *s > TOO_SMALL * stated) {
        let scale = facts.config.gnss.sigma_scale.fixed().unwrap_or(1.0) * scatter / stated;
        return Some(
            Finding::new(
                "position_sigma_too_small",
                Severity::Warning,
                format!(
                    "positions scatter by {scatter:.2} m from fix to fix even where they are quietest, and state {stated:.3} m (middle, \
                     horizontal, as the run takes it)"
                ),
                if learns {
                    "a run has to learn the factor first: until then it trusts them far too much"
                } else {
                    "the filter would trust them far too much: its sigmas would be too small, and good fixes rejected"
                },
            )
            .flag(format!("--set gnss.sigma_scale={}", two_digits(scale))),
        );
    }
    let wander = wander(facts).filter(|w| stated > TOO_LARGE * w)?;
    // Half of what is stated may be an error that stays longer than a minute.
    let scale = facts.config.gnss.sigma_scale.fixed().unwrap_or(1.0) * 2.0 * wander / stated;
    Some(
        Finding::new(
            "position_sigma_too_large",
            Severity::Note,
            format!(
                "positions wander by {wander:.2} m a minute against the receiver's own velocity, and state {stated:.2} m (middle, \
                 horizontal, as the run takes it); an error that stays for longer would not show"
            ),
            if learns {
                "a run learns what residuals show, and keeps the rest in its sigmas; with a factor they are smaller on your word"
            } else {
                "the solution would be drawn to the positions too little, and its sigmas be too large"
            },
        )
        .flag(format!("--set gnss.sigma_scale={}", two_digits(scale))),
    )
}

fn two_digits(x: f64) -> f64 {
    format!("{x:.1e}").parse().unwrap_or(x)
}

/// Middle one of the horizontal sigmas that a run believes, per axis, m.
fn stated(facts: &Facts<'_>) -> Option<f64> {
    let gnss = &facts.config.gnss;
    let mut sigmas: Vec<f64> = facts
        .survey
        .positions
        .iter()
        .filter_map(|p| p.covariance_n)
        .map(|c| (0.5 * (c[(0, 0)] + c[(1, 1)])).max(0.0).sqrt())
        .map(|s| (s * gnss.sigma_scale.fixed().unwrap_or(1.0)).max(gnss.sigma_floor_m))
        .collect();
    (sigmas.len() >= FEWEST).then(|| quantile(&mut sigmas, 0.5))
}

/// White noise of the positions, per horizontal axis, m: of third differences, or of steps less the velocity, whichever is less.
fn scatter(facts: &Facts<'_>) -> Option<f64> {
    let fixes = &facts.survey.positions;
    let mut steps: Vec<f64> = fixes
        .windows(2)
        .map(|w| w[1].time.since(w[0].time))
        .collect();
    let interval = quantile(&mut steps, 0.5);
    let regular = |w: &[GnssPosition]| {
        w.windows(2)
            .all(|p| (p[1].time.since(p[0].time) / interval - 1.0).abs() < 0.5)
    };
    let mut third = Vec::new();
    for w in fixes.windows(4).filter(|w| regular(w)) {
        let step = |i: usize| w[i].position.offset_to(&w[i + 1].position);
        let d = step(2) - step(1) * 2.0 + step(0);
        third.extend([d.x.abs(), d.y.abs()]);
    }
    // The third difference of white noise has 20 times its variance.
    let white = |mut values: Vec<f64>, variances: f64| {
        (values.len() >= 2 * FEWEST)
            .then(|| quantile(&mut values, 0.25) / QUARTILE / variances.sqrt())
    };
    let by_position = white(third, 20.0);
    let velocities = &facts.survey.velocities;
    let mut against = Vec::new();
    for w in fixes.windows(2).filter(|w| regular(w)) {
        let at = |fix: &GnssPosition| {
            let time = fix.time.plus(facts.config.gnss.velocity_lag_s);
            let i = velocities.partition_point(|v| v.time < time.plus(-0.3 * interval));
            velocities
                .get(i)
                .filter(|v| v.time.since(time) < 0.3 * interval)
        };
        if let (Some(a), Some(b)) = (at(&w[0]), at(&w[1])) {
            let way = (a.velocity_n + b.velocity_n) * (0.5 * w[1].time.since(w[0].time));
            let d = w[0].position.offset_to(&w[1].position) - way;
            against.extend([d.x.abs(), d.y.abs()]);
        }
    }
    let by_velocity = white(against, 2.0);
    match (by_position, by_velocity) {
        (Some(a), Some(b)) => Some(a.min(b)),
        (a, b) => a.or(b),
    }
}

/// How far positions wander from the integral of velocity over a minute: the middle one of the spans' sigmas, m.
fn wander(facts: &Facts<'_>) -> Option<f64> {
    let (fixes, velocities) = (&facts.survey.positions, &facts.survey.velocities);
    let lag = facts.config.gnss.velocity_lag_s;
    let mut spans = Vec::new();
    let mut begin = 0;
    while let Some(first) = fixes.get(begin) {
        let end = fixes.partition_point(|f| f.time.since(first.time) <= SPAN);
        let span = &fixes[begin..end];
        begin = end.max(begin + 1);
        let from = velocities.partition_point(|v| v.time.since(first.time) < lag);
        let to = velocities.partition_point(|v| v.time.since(first.time) < lag + SPAN);
        let used = &velocities[from..to];
        let whole = span
            .last()
            .is_some_and(|l| l.time.since(first.time) > 0.9 * SPAN)
            && used.windows(2).all(|w| w[1].time.since(w[0].time) < 3.0)
            && span.windows(2).all(|w| w[1].time.since(w[0].time) < 3.0)
            && used.len() > 20
            && span.len() > 20;
        if !whole {
            continue;
        }
        let mut way = nalgebra::Vector2::zeros();
        let mut at = 0;
        let mut errors = Vec::with_capacity(span.len());
        for fix in span {
            while at + 1 < used.len() && used[at + 1].time.plus(-lag) <= fix.time {
                let dt = used[at + 1].time.since(used[at].time);
                way += (used[at].velocity_n.xy() + used[at + 1].velocity_n.xy()) * (0.5 * dt);
                at += 1;
            }
            let rest = fix.time.since(used[at].time.plus(-lag));
            let now = way + used[at].velocity_n.xy() * rest;
            errors.push(first.position.offset_to(&fix.position).xy() - now);
        }
        // Middle ones, so that an outlier does not count.
        let middle = |of: &dyn Fn(&nalgebra::Vector2<f64>) -> f64| {
            quantile(&mut errors.iter().map(of).collect::<Vec<f64>>(), 0.5)
        };
        let (x, y) = (middle(&|e| e.x), middle(&|e| e.y));
        let mut off: Vec<f64> = errors
            .iter()
            .flat_map(|e| [(e.x - x).abs(), (e.y - y).abs()])
            .collect();
        spans.push(quantile(&mut off, 0.5) / MEDIAN);
    }
    (spans.len() >= FEWEST_SPANS).then(|| quantile(&mut spans, 0.5))
}
