//! `omnilife bench`.

use std::{collections::BTreeSet, path::PathBuf};

use omnilife_bench::{
    ADAPTERS, BenchError, DEFAULT_MEMORY_BYTES, Diagnosis, ExternalRequest, FailureRequest,
    Finding, METRICS, MetricChoice, PROTOCOLS, Predictions, ScoreRequest, Statement, curves,
    curves_table, diagnose,
    external::EXTERNAL_RUN_FILE,
    notes_on_split, protocols, record_failure, run_external, score, split_scene_under,
    tracking::{compare_tracks, world::TruePoses},
    unusable_views,
    video_consistency::video_consistency,
    write_adapter,
};
use omnilife_schemas::{
    ErrorKind,
    lock::FolderLock,
    plain_text::counted,
    progress::Progress,
    records::{DIAGNOSIS_PREFIX, ExternalRun, Padding, Protocol, SplitRule},
    store,
};
use serde_json::{Value, json};

use super::{
    ablate,
    bench_poses::{self, PosePlaces},
    bench_run, bench_scores, bench_stability,
    curate::print_json,
    note_far_frames,
};
use crate::{
    cli::BenchCommand,
    exit::{self, BadRequest, PartialFailure},
    termination,
};

pub(crate) fn execute(command: &BenchCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        BenchCommand::Split {
            scene,
            out,
            protocol,
            pad_to,
            given,
        } => {
            let mut protocol = protocols::protocol(protocol)?;
            give(&mut protocol, given)?;
            if let Some([width, height]) = *pad_to {
                protocol.padding = Padding::Frame { width, height };
            }
            let split = split_scene_under(scene, &protocol, out)?;
            note_far_frames(scene, progress)?;
            for line in notes_on_split(scene, &split)? {
                progress.note(&format!("{}: {line}", split.scene));
            }
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
            accept_failures,
        } => {
            termination::take_programs_along()?;
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
            exit::print(&external_summary(&run))?;
            (run.warnings.iter()).for_each(|warning| progress.note(warning));
            let label = format!("{} on {}", run.method, run.scene);
            let failure = match run.failure {
                Some(failure) => Some(format!("the run failed: {failure}")),
                None if *accept_failures => None,
                None => {
                    let record = out.join(EXTERNAL_RUN_FILE);
                    unusable(&unusable_views(scene, split, &record, progress)?, progress)
                }
            };
            match failure {
                None => Ok(()),
                Some(failure) => Err(PartialFailure {
                    message: format!("{label}: {failure}"),
                    blame: ErrorKind::User,
                }
                .into()),
            }
        }
        BenchCommand::Tracks {
            tracks,
            truth,
            scene,
            true_poses,
            poses_convention,
            class,
        } => {
            let scene = store::read_record(scene)?;
            let convention = poses_convention.map(Into::into);
            let given = (true_poses.as_deref())
                .map(|path| bench_poses::read_poses(path, convention, &scene))
                .transpose()?;
            let given = given
                .as_ref()
                .map(|(name, poses)| TruePoses { name, poses });
            let report = compare_tracks(tracks, truth, &scene, given.as_ref(), class.as_deref())?;
            let notes = [&report.rescaled, &report.paths_left_out];
            let notes = notes.into_iter().flatten().chain(&report.notes);
            notes.for_each(|note| progress.note(note));
            exit::print(&format!("{}\n", serde_json::to_string_pretty(&report)?))
        }
        BenchCommand::Poses {
            trajectory,
            scene,
            truth,
            poses_convention,
            align,
            out,
        } => bench_poses::execute(
            &PosePlaces {
                trajectory,
                scene,
                truth: truth.as_deref(),
                out: out.as_deref(),
            },
            poses_convention.map(Into::into),
            (*align).into(),
        ),
        BenchCommand::Failed {
            method,
            scene,
            split,
            seed,
            reason,
            run,
            out,
        } => {
            let request = FailureRequest {
                method: method.clone(),
                scene: scene.clone(),
                split: split.clone(),
                seed: *seed,
                reason: reason.clone(),
                run: run.clone(),
                out: out.clone(),
            };
            let record = record_failure(&request, progress)?;
            exit::print(&format!("{}\n", record.display()))
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
            metrics,
            without_lpips,
            accept_failures,
            statement,
        } => {
            let (statement, named) = statement.read(method.as_deref())?;
            let method = method.clone().or(named);
            let mut request = match (run, &method) {
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
                    statement: Statement::default(),
                    out: out.clone(),
                    memory_bytes: DEFAULT_MEMORY_BYTES,
                    metrics: MetricChoice::All,
                },
                (None, None) => {
                    let reason =
                        "predictions need a --method name, or the --about card that has it";
                    return Err(BadRequest(reason.to_owned()).into());
                }
            };
            request.statement = statement;
            request.memory_bytes = (memory * 1e9).max(0.0) as u64;
            request.metrics = match (without_lpips, metrics.as_slice()) {
                (true, _) => MetricChoice::WithoutNetworks,
                (false, []) => MetricChoice::All,
                (false, ids) => MetricChoice::only(ids).map_err(BenchError::from)?,
            };
            let result = score(&request, progress)?;
            bench_scores::report(&result, *accept_failures)
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
        BenchCommand::Video { views, reference } => {
            let video = video_consistency(views)?;
            let of_reference = reference.as_deref().map(|folder| {
                let found = video_consistency(folder)?;
                video.check_reference(folder, &found).map(|()| found)
            });
            let of_reference = of_reference.transpose()?;
            print_json(&json!({
                "video": video,
                "reference": of_reference,
            }))
        }
        BenchCommand::Run(arguments) => bench_run::execute(arguments, progress),
        BenchCommand::Diagnose {
            scene,
            split,
            novel_views,
            input_views,
        } => {
            let diagnosis = diagnose(&ScoreRequest {
                scene: scene.clone(),
                split: split.clone(),
                predictions: Predictions::Folders {
                    input_views: input_views.clone(),
                    novel_views: novel_views.clone(),
                },
                method: String::new(),
                statement: Statement::default(),
                out: PathBuf::new(),
                memory_bytes: DEFAULT_MEMORY_BYTES,
                metrics: MetricChoice::All,
            })?;
            exit::print(&diagnosis_text(&diagnosis))
        }
        BenchCommand::Adapter { method, out } => {
            let _lock = FolderLock::take(out, progress)?;
            let adapter = write_adapter(method, out)?;
            exit::print(&format!(
                "{}: {}\n{}\n",
                adapter.id,
                adapter.about,
                out.join("method.toml").display()
            ))
        }
        BenchCommand::Stability { out, backend } => {
            bench_stability::execute(out.as_deref(), *backend, progress)
        }
        BenchCommand::Curve {
            runs,
            clock,
            region,
            out,
        } => exit::print(&curves_table(&curves(
            runs,
            (*clock).into(),
            (*region).into(),
            out,
            progress,
        )?)),
        BenchCommand::Ablate {
            scene,
            out,
            protocol,
            method,
            iterations,
            paper,
        } => {
            let method = (&**method, *iterations);
            ablate::execute(scene, out, protocol, method, *paper, progress)
        }
        BenchCommand::List { json: false } => exit::print(&list()),
        BenchCommand::List { json: true } => print_json(&list_record()),
    }
}

/// Sets the named frames as input views of a protocol, where any are named.
fn give(protocol: &mut Protocol, given: &[u32]) -> anyhow::Result<()> {
    if given.is_empty() {
        return Ok(());
    }
    if !matches!(protocol.split, SplitRule::EvenlyGiven { .. }) {
        return Err(BadRequest(format!(
            "--given names frames in place of those that a protocol spreads evenly, and {} spreads none",
            protocol.id
        ))
        .into());
    }
    let frames: BTreeSet<u32> = given.iter().copied().collect();
    protocol.split = SplitRule::Given {
        frames: frames.into_iter().collect(),
    };
    Ok(())
}

/// Prints the number of checked views, and every finding, mistakes first.
fn diagnosis_text(diagnosis: &Diagnosis) -> String {
    let mut text = format!("checked {}", counted(diagnosis.views, "view"));
    if let Some(psnr) = diagnosis.psnr_db {
        text += &format!(", {psnr:.3} dB as they are");
    }
    text += "\n";
    for finding in &diagnosis.findings {
        let mark = if finding.kind.is_mistake() {
            DIAGNOSIS_PREFIX
        } else {
            "note: "
        };
        text += &format!("{mark}{finding}\n");
    }
    if diagnosis.mistakes().next().is_none() {
        text += "no mistake of convention was found\n";
    }
    text
}

/// Notes views that cannot be scored, and returns a line on them; `None` without any.
fn unusable(views: &[Finding], progress: &dyn Progress) -> Option<String> {
    let view_of = |one: &Finding| {
        let kind = one.view.as_deref().unwrap_or("run");
        format!("{kind} view: {}", one.reason)
    };
    views.iter().for_each(|one| progress.note(&view_of(one)));
    let count = counted(views.len(), "view");
    (!views.is_empty()).then(|| format!("{count} cannot be scored"))
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
    text
}

fn list() -> String {
    let mut text = "Protocols\n".to_owned();
    for protocol in PROTOCOLS {
        text += &format!("  {}: {}\n", protocol.id, protocol.description);
    }
    text += "Adapters\n";
    for adapter in ADAPTERS {
        text += &format!(
            "  {}: {}, {}. Run against the authors' code: {}\n",
            adapter.id,
            adapter.about,
            adapter.protocol,
            adapter.tried.describe()
        );
    }
    text += "Metrics\n";
    for metric in METRICS {
        text += &format!("  {}: {} ({})\n", metric.id, metric.title, metric.source);
    }
    text
}

/// Returns what [`list`] lists, for programs.
fn list_record() -> Value {
    let protocols = PROTOCOLS.iter().map(|protocol| {
        json!({
            "id": protocol.id,
            "description": protocol.description,
        })
    });
    let adapters = ADAPTERS.iter().map(|adapter| {
        json!({
            "id": adapter.id,
            "description": adapter.about,
        })
    });
    let metrics = METRICS.iter().map(|metric| {
        json!({
            "id": metric.id,
            "title": metric.title,
            "unit": metric.unit,
            "direction": metric.direction,
            "source": metric.source,
        })
    });
    json!({
        "protocols": protocols.collect::<Vec<_>>(),
        "adapters": adapters.collect::<Vec<_>>(),
        "metrics": metrics.collect::<Vec<_>>(),
    })
}
