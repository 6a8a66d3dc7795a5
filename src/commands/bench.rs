//! `omnilife bench`.

use omnilife_bench::{
    DEFAULT_MEMORY_BYTES, ExternalRequest, METRICS, PROTOCOLS, Predictions, ScoreRequest,
    run_external, score, split_scene,
};
use omnilife_schemas::{
    progress::Progress,
    records::{ExternalRun, ResultRecord},
};

use super::bench_scores;
use crate::{
    cli::BenchCommand,
    exit::{self, BadRequest},
};

pub(crate) fn execute(command: &BenchCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        BenchCommand::Split {
            scene,
            out,
            protocol,
        } => {
            let split = split_scene(scene, protocol, out)?;
            exit::print(&format!(
                "{}: {} input views, {} novel views, {} without a pose; protocol {:.12}\n",
                split.scene,
                split.input_views.len(),
                split.novel_views.len(),
                split.unposed.len(),
                split.protocol_hash
            ))
        }
        BenchCommand::External {
            method,
            scene,
            split,
            out,
            seed,
        } => {
            let run = run_external(
                &ExternalRequest {
                    manifest: method.clone(),
                    scene: scene.clone(),
                    split: split.clone(),
                    seed: *seed,
                    out: out.clone(),
                },
                progress,
            )?;
            exit::print(&external_summary(&run))
        }
        BenchCommand::Score {
            scene,
            split,
            out,
            run,
            novel_views,
            input_views,
            method,
            memory,
        } => {
            let mut request = match (run, method) {
                (Some(run), None) => ScoreRequest::of_run(scene, split, run, out)?,
                (run, Some(method)) => ScoreRequest {
                    scene: scene.clone(),
                    split: split.clone(),
                    predictions: run.clone().map_or_else(
                        || Predictions::Folders {
                            input_views: input_views.clone(),
                            novel_views: novel_views.clone(),
                        },
                        Predictions::Run,
                    ),
                    method: method.clone(),
                    out: out.clone(),
                    memory_bytes: DEFAULT_MEMORY_BYTES,
                },
                (None, None) => {
                    return Err(BadRequest("predictions need a --method name".to_owned()).into());
                }
            };
            request.memory_bytes = (memory * 1e9).max(0.0) as u64;
            let result = score(&request, progress)?;
            exit::print(&summary(&result))
        }
        BenchCommand::Validate {
            novel_views,
            scene,
            split,
            run,
            input_views,
        } => {
            let predictions = match run {
                Some(run) => Predictions::Run(run.clone()),
                None => Predictions::Folders {
                    input_views: input_views.clone(),
                    novel_views: novel_views.clone(),
                },
            };
            bench_scores::validate(scene, split, &predictions, progress)
        }
        BenchCommand::Compare { a, b } => bench_scores::compare(a, b),
        BenchCommand::List => exit::print(&list()),
    }
}

fn external_summary(run: &ExternalRun) -> String {
    let mut text = format!("{} on {}, seed {}\n", run.method, run.scene, run.seed);
    for phase in &run.phases {
        text += &format!(
            "{}: {} after {:.1} s\n",
            phase.name.name(),
            phase.ending,
            phase.wall_seconds
        );
    }
    if let Some(failure) = &run.failure {
        text += &format!("failed: {failure}\n");
    }
    text
}

fn summary(result: &ResultRecord) -> String {
    let mut text = format!(
        "{} on {}, protocol {} ({:.12})\n",
        result.method, result.scene, result.protocol, result.protocol_hash
    );
    for (view, scores) in [
        ("input", &result.input_views),
        ("novel", &result.novel_views),
    ] {
        for (metric, summary) in scores {
            text += &format!(
                "{view} {metric} {:.4} over {} views",
                summary.mean, summary.views
            );
            if summary.undefined_views > 0 {
                text += &format!(", undefined for {}", summary.undefined_views);
            }
            text.push('\n');
        }
    }
    for unavailable in &result.unavailable {
        text += &format!(
            "{} {} unavailable: {}\n",
            unavailable.view, unavailable.metric, unavailable.reason
        );
    }
    for failure in &result.failures {
        text += &format!(
            "failed: {} view {}: {}\n",
            failure.view, failure.frame, failure.reason
        );
    }
    text
}

fn list() -> String {
    let mut text = "Protocols\n".to_owned();
    for protocol in PROTOCOLS {
        text += &format!("  {}: {}\n", protocol.id, protocol.description);
    }
    text += "Metrics\n";
    for metric in METRICS {
        text += &format!("  {}: {} ({})\n", metric.id, metric.title, metric.source);
    }
    text
}
