//! Where the recordings are: outside the repository, and perhaps not there.

use std::path::{Path, PathBuf};

/// A file or folder of the test recordings; `None`, with a visible line, when they are absent.
pub(crate) fn recording(name: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("INSNAV_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let path = folder.join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: {} is not there (set INSNAV_DATA)", path.display());
    None
}
