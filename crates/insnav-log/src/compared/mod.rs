//! The two files of a comparison, read into what [`insnav_core::metrics`] takes, and judged.

mod judge;
mod reference;
mod solution;

pub use judge::{JudgeRequest, Judged, judge};
pub use reference::ComparedReference;
pub use solution::ComparedSolution;

use std::path::Path;

/// Whether the file is a TUM trajectory: eight numbers in the first line that is no comment, no header.
fn is_tum(path: &Path) -> Result<bool, crate::LogError> {
    let mut lines = crate::csv::open_text(path)?;
    let mut line = String::new();
    while crate::csv::read_line(&mut *lines, &mut line, path)? {
        let text = line.trim();
        if text.is_empty() || text.starts_with('#') {
            continue;
        }
        let cells: Vec<&str> = text.split_whitespace().collect();
        return Ok(cells.len() == 8 && cells.iter().all(|c| c.parse::<f64>().is_ok()));
    }
    Ok(false)
}

/// Whether the file is an MCAP, by its first bytes.
fn is_mcap(path: &Path) -> Result<bool, crate::LogError> {
    use std::io::Read;
    let mut start = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| crate::LogError::opening(path, e))?;
    file.take(5)
        .read_to_end(&mut start)
        .map_err(|e| crate::LogError::opening(path, e))?;
    Ok(start == b"\x89MCAP")
}
