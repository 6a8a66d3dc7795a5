//! The folder of a run that holds its novel views at the rows of the trace.

use std::path::Path;

use omnilife_schemas::{
    ownership::path_inside,
    store::{self, StoreError},
};

use omnilife_training::train::{trace::TracePoint, trace_views::TraceViews};

/// Its name in the run's folder.
pub(super) const TRACE_FOLDER: &str = "trace";

/// Removes half-written files of killed processes along a trace; another run may have other rows.
pub(super) fn remove_abandoned(out: &Path) -> Result<(), StoreError> {
    let folder = path_inside(out, TRACE_FOLDER)?;
    if !folder.is_dir() {
        return Ok(());
    }
    let folders = store::paths_in(&folder)?;
    folders
        .iter()
        .filter(|folder| folder.is_dir())
        .try_for_each(|folder| store::remove_abandoned(folder))
}

/// Returns true if a file of a run, relative to its folder, is in this folder.
pub(super) fn holds(file: &str) -> bool {
    let rest = file.strip_prefix(TRACE_FOLDER);
    rest.is_some_and(|rest| rest.starts_with('/'))
}

/// Returns the views at the rows of a trace, relative to the run's folder.
pub(super) fn files<'a>(
    trace: &'a [TracePoint],
    frames: &'a [u32],
) -> impl Iterator<Item = String> + 'a {
    let rows = trace.split_last().map_or(&[][..], |(_, before)| before);
    rows.iter().flat_map(move |row| {
        let file = |&frame| format!("{TRACE_FOLDER}/{}", TraceViews::file(row.iteration, frame));
        frames.iter().map(file)
    })
}
