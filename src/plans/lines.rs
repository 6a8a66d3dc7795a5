//! Units of a file, one per line.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{records::SweepUnit, store};
use omnilife_sweep::plan;

use super::{needs, words};
use crate::cli::PlanArguments;

/// Returns units that run the lines of a file with `sh`.
///
/// # Errors
/// When the file cannot be read.
pub(crate) fn units(file: &Path, arguments: &PlanArguments) -> anyhow::Result<Vec<SweepUnit>> {
    let text = store::read_text(file)?;
    let needs = needs(arguments)?;
    let lines = text.lines().enumerate();
    Ok(lines
        .filter(|(_, line)| !line.trim().is_empty() && !line.trim_start().starts_with('#'))
        .map(|(number, line)| SweepUnit {
            id: plan::file_name(&format!("line-{:05}", number + 1)),
            group: "line".to_owned(),
            labels: BTreeMap::new(),
            commands: vec![shell(line)],
            on_failure: Vec::new(),
            inputs: Vec::new(),
            outputs: Vec::new(),
            needs,
        })
        .collect())
}

pub(crate) fn shell(line: &str) -> Vec<String> {
    words(&["sh", "-c", line])
}
