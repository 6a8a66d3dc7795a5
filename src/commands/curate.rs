//! `omnilife curate`.

use std::path::{Path, PathBuf};

use omnilife_curate::{
    CurateError, CurateSettings, CuratedDataset, Place, Worker, analysis,
    audit::{self, PageRequest},
    boundaries, curate_dataset_in, curate_video, expand_inputs, left_out_of_folders,
    masks::operator::OperatorSearch,
    origins, overview, pose_sequence_with, projection,
    publish::{self, PublishSettings},
    worker,
};
use omnilife_schemas::{
    layout::{ATTEMPTS_FILE, DENSE_FOLDER, SCENE_FILE, SFM_FOLDER},
    names::{UnknownName, find},
    ownership::refuse_another_kind,
    plain_text::counted,
    progress::Progress,
    records::ValidationStatus,
    store,
};
use omnilife_tracks::{
    TrackOptions, TrackRequest,
    dense::{DenseRequest, make_dense},
    exports::{TRACK_FORMATS, TrackExportRequest, export_tracks},
    make_tracks, plan_tracks,
};
use serde::Serialize;

use super::{ledger, road_table::road_table};
use crate::{
    cli::{self, BuildArguments, CurateCommand, MemoryLimitArguments},
    commands::{attach, dataset},
    exit,
    prerequisites::{self, Prerequisite},
    run::outcome::{Outcome, Outcomes},
    termination,
};

/// First bytes of a Parquet file.
const PARQUET_MAGIC: &[u8] = b"PAR1";

pub(crate) fn execute(command: &CurateCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        CurateCommand::Probe { video } => print_json(&analysis::timed_probe(video)?),
        CurateCommand::Projection { video } => {
            let analysis = analyse(video, boundaries::DEFAULT_DETECTOR, progress)?;
            print_json(&projection::judge(
                &analysis.probe,
                analysis.samples.images(),
            ))
        }
        CurateCommand::Boundaries {
            video,
            detector,
            signals,
        } => {
            if let Some(path) = signals {
                refuse_another_kind(path, PARQUET_MAGIC)?;
            }
            let analysis = analyse(video, &detector.detector, progress)?;
            if let Some(path) = signals {
                analysis.signals.write_parquet(path)?;
            }
            let detector = boundaries::detector(&detector.detector, video)?;
            print_json(&(detector.decide)(&analysis.signals)?)
        }
        CurateCommand::Ledger(command) => ledger::execute(command, progress),
        CurateCommand::Audit {
            folder,
            video,
            taxonomy,
            out,
        } => {
            let request = PageRequest {
                folder,
                video,
                page: out,
                taxonomy: taxonomy.as_deref(),
                embedded_bytes: audit::EMBEDDED_BYTES,
            };
            let count = audit::write_page(&request, progress)?;
            let boundaries = match count {
                1 => "1 boundary".to_owned(),
                count => format!("{count} boundaries"),
            };
            exit::print(&format!("{}: {boundaries}\n", out.display()))
        }
        CurateCommand::Build(arguments) => build(arguments, progress),
        CurateCommand::Video {
            video,
            folder,
            settings,
        } => curate_one(video, folder, &settings.settings(), progress),
        CurateCommand::Worker => Ok(worker::serve()?),
        CurateCommand::Slice(arguments) => dataset::slice(arguments, progress),
        CurateCommand::Annotate(arguments) => dataset::annotate(arguments, progress),
        CurateCommand::Attach(arguments) => attach::execute(arguments, progress),
        CurateCommand::Masks(arguments) => dataset::masks(arguments, progress),
        CurateCommand::Operator {
            sequence,
            people,
            caps,
        } => {
            let search = OperatorSearch {
                people: *people,
                caps: *caps,
            };
            dataset::operator(sequence, search, progress)
        }
        CurateCommand::Export(arguments) => dataset::export(arguments, progress),
        CurateCommand::Import(arguments) => dataset::import(arguments, progress),
        CurateCommand::Select(arguments) => dataset::select(arguments, progress),
        CurateCommand::Publish(arguments) => dataset::publish_dataset(arguments, progress),
        CurateCommand::Status { dataset, json } => dataset::status(dataset, *json),
        CurateCommand::Overview { dataset } => {
            let page = overview::write_page(dataset, progress)?;
            exit::print(&format!("{}\n", page.display()))
        }
        CurateCommand::Verify { dataset } => dataset::verify(dataset, progress),
        CurateCommand::Tracks {
            scene,
            split,
            tracking,
            video,
            export,
            telemetry,
            plan,
            out,
        } => {
            termination::take_programs_along()?;
            let beside = split.as_deref().and_then(Path::parent).unwrap_or(scene);
            let unknown = |unknown: UnknownName| CurateError::Input {
                path: scene.join(SCENE_FILE),
                reason: unknown.to_string(),
            };
            let request = TrackRequest {
                scene_folder: scene.clone(),
                split: split.clone(),
                options: TrackOptions {
                    video: video.clone(),
                    ..tracking.options().map_err(unknown)?
                },
                out: out.clone().unwrap_or_else(|| beside.to_owned()),
            };
            // Names are checked before the tracking.
            let formats = export.iter().map(|name| {
                find("format of tracks", name, TRACK_FORMATS, |one| one.id).map_err(unknown)
            });
            let exports = TrackExportRequest {
                scene_folder: scene.clone(),
                folder: request.out.clone(),
                formats: formats.collect::<Result<_, _>>()?,
                telemetry: telemetry.clone(),
            };
            if *plan {
                return exit::print(&plan_tracks(&request, progress)?.text());
            }
            let tracks = make_tracks(&request, progress)?;
            let mut text = String::new();
            for stage in &tracks.stages {
                text += &format!("{}: {}: {}\n", stage.stage, stage.method, stage.reason);
            }
            if !exports.formats.is_empty() || exports.telemetry.is_some() {
                for file in export_tracks(&exports, progress)?.0 {
                    text += &format!("{}\n", file.display());
                }
            }
            exit::print(&format!(
                "{text}{}: vehicles that move: {}\n",
                tracks.scene,
                tracks.tracks.len()
            ))
        }
        CurateCommand::Dense {
            scene,
            split,
            width,
            out,
        } => {
            let beside = split.as_deref().and_then(Path::parent).unwrap_or(scene);
            let request = DenseRequest {
                scene_folder: scene.clone(),
                split: split.clone(),
                width: *width,
                out: out.clone().unwrap_or_else(|| beside.join(DENSE_FOLDER)),
            };
            let dense = make_dense(&request, progress)?;
            let known: f64 = dense.frames.iter().map(|frame| frame.known_share).sum();
            exit::print(&format!(
                "{}: {} points, distances of {:.0} % of the pixels of {}\n",
                dense.scene,
                dense.point_count,
                100.0 * known / dense.frames.len().max(1) as f64,
                counted(dense.frames.len(), "frame")
            ))
        }
        CurateCommand::Poses {
            sequence,
            poses,
            compare,
            masks,
            truth,
        } => {
            termination::take_programs_along()?;
            let masks = masks.masks.as_ref();
            let request = if *compare {
                poses.comparison(masks)
            } else {
                poses.request(masks)
            };
            let truth = truth.given(poses.truth(masks))?;
            let scene = pose_sequence_with(sequence, &request, &truth, progress)?;
            if *compare {
                let attempts = sequence.join(SFM_FOLDER).join(ATTEMPTS_FILE);
                exit::print(&road_table(&store::read_record(&attempts)?))?;
            }
            exit::print(&format!(
                "{}: {} of {} posed, {}\n",
                scene.id,
                scene.validation.registered_frames,
                counted(scene.validation.total_frames as usize, "frame"),
                validation_words(scene.validation.status)
            ))
        }
    }
}

/// Returns the outcome of a validation of poses in words.
fn validation_words(status: ValidationStatus) -> &'static str {
    match status {
        ValidationStatus::Valid => "valid",
        ValidationStatus::Unstable => "unstable",
        ValidationStatus::Unchecked => "not checked",
    }
}

/// Returns a place that curates every video in a process of its own: this program again.
///
/// # Errors
/// When the system does not report the path of this program.
pub(crate) fn place(limit: &MemoryLimitArguments) -> anyhow::Result<Place> {
    Ok(Place::ProcessEach(Worker {
        program: std::env::current_exe()?,
        arguments: ["curate", "worker"].map(str::to_owned).to_vec(),
        memory_bytes: limit.bytes(),
    }))
}

/// Curates, and enters the origins of the videos. Their list is read first, so that a fault in it is reported before
/// hours of work.
///
/// # Errors
/// When the list cannot be read, a video fails, or the record cannot be written.
pub(crate) fn with_origins(
    list: Option<&Path>,
    videos: &[PathBuf],
    out: &Path,
    progress: &dyn Progress,
    curate: impl FnOnce() -> Result<CuratedDataset, CurateError>,
) -> Result<CuratedDataset, CurateError> {
    let origins = list.map(|list| Ok::<_, CurateError>((list, origins::read(list)?)));
    let origins = origins.transpose()?;
    let mut curated = curate()?;
    if let Some((list, origins)) = origins {
        origins.enter(list, videos, &mut curated.record, out, progress)?;
    }
    Ok(curated)
}

/// Curates, publishes and draws the page. Rejected and failed videos are reported at the end.
fn build(arguments: &BuildArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    if let [video] = arguments.videos.as_slice()
        && let Some(tip) = cli::tip_for_video(video)
    {
        return Err(exit::BadRequest(tip).into());
    }
    publish::refuse_foreign(&arguments.out)?;
    overview::refuse_foreign_page(&arguments.out)?;
    let videos = expand_inputs(&arguments.videos)?;
    let left_out = left_out_of_folders(&arguments.videos, &videos)?;
    for line in &left_out.lines {
        progress.note(line);
    }
    let place = place(&arguments.limit)?;
    let settings = arguments.settings.settings();
    if let Some(video) = videos.first() {
        prerequisites::require([Prerequisite::Settings(&settings, video)])?;
        if !prerequisites::has_sequences(&arguments.out) {
            prerequisites::require([Prerequisite::BoundaryDetector(&settings, video)])?;
        }
    }
    let sources = arguments.sources.as_deref();
    let curated = with_origins(sources, &videos, &arguments.out, progress, || {
        curate_dataset_in(
            &place,
            &videos,
            &left_out.files,
            &arguments.out,
            &settings,
            progress,
        )
    })?;
    publish::publish(&arguments.out, &PublishSettings::default(), progress)?;
    let page = overview::write_page(&arguments.out, progress)?;
    progress.note(&format!("{}: open it in a browser", page.display()));
    let printed = exit::print(&summary(&curated, &videos));
    let mut outcomes = Outcomes::default();
    for video in &curated.record.videos {
        outcomes.push(Outcome::curated(&video.file));
    }
    for (index, error) in &curated.errors {
        let file = &curated.record.videos[*index].file;
        outcomes.list[*index] = Outcome::failed_video(file, error);
    }
    outcomes.as_result()?;
    printed
}

/// Curates one video. A video that the criteria reject is an outcome and not a failure: the dataset has the reason.
fn curate_one(
    video: &Path,
    folder: &Path,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    match curate_video(video, folder, settings, progress) {
        Ok(sequences) => exit::print(&format!(
            "{}: {}\n",
            folder.display(),
            counted(sequences.len(), "sequence")
        )),
        Err(error) if error.failed_checks().is_some() => exit::print(&format!("{error}\n")),
        Err(error) => Err(error.into()),
    }
}

fn analyse(
    video: &Path,
    detector: &str,
    progress: &dyn Progress,
) -> anyhow::Result<analysis::Analysis> {
    let detector = boundaries::detector(detector, video)?;
    Ok(analysis::analyse(video, detector, None, progress)?)
}

pub(super) fn print_json(value: &impl Serialize) -> anyhow::Result<()> {
    exit::print(&format!("{}\n", serde_json::to_string_pretty(value)?))
}

/// Returns one line per video, with its path and the remedy, which the record leaves out.
fn summary(curated: &CuratedDataset, videos: &[PathBuf]) -> String {
    use omnilife_schemas::records::VideoStatus;
    let line = |(index, path): (usize, &PathBuf)| {
        let path = path.display();
        let text = match &curated.record.videos[index].status {
            VideoStatus::Curated { sequences } => {
                format!("{path}: {}", counted(sequences.len(), "sequence"))
            }
            VideoStatus::Rejected { reason, .. } | VideoStatus::Failed { reason } => {
                let mut errors = curated.errors.iter();
                match errors.find(|(failed, _)| *failed == index) {
                    // Messages begin with the file.
                    Some((_, error)) => error.to_string(),
                    None => format!("{path}: {reason}"),
                }
            }
            VideoStatus::Duplicate { of } => format!("{path}: the same content as {of}"),
            VideoStatus::Pending => format!("{path}: not reached"),
        };
        // A name may have a line break.
        text.replace('\n', "\\n") + "\n"
    };
    videos.iter().enumerate().map(line).collect()
}
