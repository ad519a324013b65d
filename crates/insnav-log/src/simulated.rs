//! A simulation as a recorder would have it, and its truth as a table has it.

use crate::{LogError, LogWriter, LogWriterOptions};
use insnav_core::sim::{GnssModel, Scenario, Simulation, Truth};
use insnav_core::time::Time;
use nalgebra::Vector3;
use std::path::Path;

/// Write the log: each message at the instant of its arrival. `each` is told how many samples are written, and may end it.
///
/// # Errors
/// The file cannot be written, or what `each` says; nothing half-written is left behind.
pub fn write_simulated<E: From<LogError>>(
    path: &Path,
    simulation: &Simulation,
    gnss: &GnssModel,
    force: bool,
    mut each: impl FnMut(usize) -> Result<(), E>,
) -> Result<(), E> {
    let options = LogWriterOptions {
        force,
        t0: Some(simulation.trajectory.start()),
        lever_arm_b: Some(Vector3::from(gnss.lever_arm_b_m)),
        ..LogWriterOptions::default()
    };
    let mut writer = LogWriter::create(path, options)?;
    let late = gnss.latency_s - gnss.time_offset_s;
    for (i, sample) in simulation.samples.iter().enumerate() {
        let recorded: Time = if sample.is_inertial() {
            sample.time()
        } else {
            sample.time().plus(late)
        };
        writer.write_recorded(sample, recorded)?;
        each(i)?;
    }
    writer.finish()?;
    Ok(())
}

/// What really was, so often a second: seconds from the start on the clock of GNSS positions, as solutions are.
pub fn simulated_truth<'a>(
    simulation: &'a Simulation,
    scenario: &'a Scenario,
    rate_hz: f64,
) -> impl ExactSizeIterator<Item = (f64, Truth)> + 'a {
    let start = simulation.trajectory.start();
    let last = (scenario.duration_s.min(simulation.trajectory.duration()) * rate_hz) as u32;
    (0..last.saturating_add(1)).map(move |i| {
        let t = f64::from(i) / rate_hz;
        let truth = simulation.truth_at(start.plus(t));
        (t + scenario.gnss.time_offset_s, truth)
    })
}
