//! `omnilife bench ablate`: what each component of a method contributes.
//!
//! It trains and scores, so it is here: `bench` knows no method.

use std::{path::Path, time::Instant};

use omnilife_bench::{ScoreRequest, score, split_scene};
use omnilife_reconstruct::{
    jobs::reconstruct::{self, ReconstructRequest},
    methods::{self, Method},
};
use omnilife_schemas::{
    layout::SPLIT_FILE, lock::FolderLock, progress::Progress, records::ResultRecord,
    stage::StagePlan, store,
};

use crate::{
    cli::MethodArguments,
    exit::{self, BadRequest},
};

/// The components that the ablation of Omni4DGS leaves out, one at a time (its Table 6).
const ABLATED: &[&str] = &[
    "temporal-opacity",
    "temporal-motion",
    "velocity-decomposition",
    "dynamic-mask",
    "motion-regularization",
];
/// The table, in the folder of the runs.
const TABLE_FILE: &str = "ablation.md";

/// Runs every row, or takes it from the folder where nothing has changed; prints the table.
///
/// # Errors
/// When the method has no such component, or a run fails.
pub(crate) fn execute(
    scene: &Path,
    out: &Path,
    protocol: &str,
    (arguments, iterations): (&MethodArguments, u64),
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let method = methods::find(&arguments.method)?;
    let rows = rows(method);
    if rows.len() == 1 {
        return Err(BadRequest(format!(
            "{} has none of the components {}",
            method.id,
            ABLATED.join(", ")
        ))
        .into());
    }
    let _lock = FolderLock::take(out, progress)?;
    let begun = Instant::now();
    let summary = StagePlan::new(out, "ablation");
    summary.claim([TABLE_FILE])?;
    let split = out.join(SPLIT_FILE);
    split_scene(scene, protocol, &split)?;
    let mut table = String::new();
    for without in rows {
        // The names by which the leaderboard lays out ablations.
        let name = without.map_or_else(
            || method.id.to_owned(),
            |component| format!("{}-without-{component}", method.id),
        );
        progress.note(&name);
        let mut settings = arguments.request(iterations)?;
        settings.without.extend(without.map(str::to_owned));
        let folder = out.join(&name);
        let run = folder.join("run");
        reconstruct::reconstruct(
            &ReconstructRequest {
                scene: scene.to_owned(),
                split: split.clone(),
                method: method.id.to_owned(),
                settings,
                backend: arguments.backend.into(),
                checkpoint_every: arguments.checkpoint_every,
                trace_views: arguments.trace_views,
                out: run.clone(),
            },
            progress,
        )?;
        let record = run.join(reconstruct::RUN_FILE);
        let mut request = ScoreRequest::of_run(scene, &split, &record, &folder.join("score"))?;
        request.method.clone_from(&name);
        let result = score(&request, progress)?;
        if table.is_empty() {
            table = header(method, &result);
        }
        table += &row(&name, &result);
    }
    let path = out.join(TABLE_FILE);
    store::write_bytes(&path, table.as_bytes())?;
    summary.finish([TABLE_FILE], begun.elapsed().as_secs_f64())?;
    exit::print(&format!("{table}\n{}\n", path.display()))
}

/// Everything, then everything but one.
fn rows(method: &Method) -> Vec<Option<&'static str>> {
    let has = |name: &&&str| method.components.contains(*name);
    let ablated = ABLATED.iter().filter(has).map(|&name| Some(name));
    std::iter::once(None).chain(ablated).collect()
}

fn header(method: &Method, result: &ResultRecord) -> String {
    let (mut names, mut line) = (String::new(), String::new());
    for (view, scores) in [
        ("input", &result.input_views),
        ("novel", &result.novel_views),
    ] {
        for metric in scores.keys() {
            names += &format!(" {view} {metric} |");
            line += "---:|";
        }
    }
    format!(
        "{} on {}, protocol {}\n\n| Components |{names} Primitives | Training, s |\n|---|{line}---:|---:|\n",
        method.title, result.scene, result.protocol
    )
}

fn row(name: &str, result: &ResultRecord) -> String {
    let scores: String = result
        .input_views
        .values()
        .chain(result.novel_views.values())
        .map(|summary| format!(" {:.4} |", summary.mean))
        .collect();
    format!(
        "| {name} |{scores} {} | {:.1} |\n",
        result.primitives.unwrap_or_default(),
        result.training_seconds.unwrap_or_default()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_methods_with_temporal_components_are_ablated() {
        let count = |id: &str| methods::find(id).map(|method| rows(method).len()).ok();
        assert_eq!(count("odgs"), Some(1));
        assert_eq!(count("periodic"), Some(3));
        assert_eq!(count("omni4dgs"), Some(6));
    }
}
