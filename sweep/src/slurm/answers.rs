//! Parsers of the output of Slurm's programs.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::collections::BTreeSet;

/// Returns `MaxArraySize` of `scontrol show config`: one more than the highest index of an array's tasks.
pub fn max_array_size(text: &str) -> Option<usize> {
    let mut lines = text.lines();
    let rest = lines.find_map(|line| line.trim().strip_prefix("MaxArraySize"))?;
    let size = rest.trim().strip_prefix('=')?.trim().parse().ok()?;
    (size > 0).then_some(size)
}

/// Returns tasks of `squeue --format=%F_%K`, as `<array>_<task>`.
pub fn queued_tasks(text: &str) -> BTreeSet<String> {
    text.lines().map(|line| line.trim().to_owned()).collect()
}

/// Returns the job of `sbatch --parsable`: `<id>` or `<id>;<cluster>`.
pub fn job_id(text: &str) -> Option<String> {
    let id = text.trim().split(';').next()?;
    (!id.is_empty()).then(|| id.to_owned())
}
