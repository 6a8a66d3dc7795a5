//! `omnilife curate`: commands for a curated dataset or scene.

use std::path::{Path, PathBuf};

use omnilife_curate::{
    MasksEntry,
    annotation::annotate_dataset,
    enter_masks,
    exchange::{self, ExportRequest, ImportRequest},
    masks::{
        operator::{self, OperatorSearch},
        write_masks,
    },
    overview, publish, slicing,
};
use omnilife_schemas::{
    ErrorKind,
    layout::{DYNAMIC_MASKS_FOLDER, OPERATOR_FOLDER},
    lock::FolderLock,
    plain_text::counted,
    progress::Progress,
    records::OperatorFinding,
    store,
};

use crate::{
    cli::{
        AnnotateArguments, ExportArguments, ImportArguments, MasksArguments, PublishArguments,
        SelectArguments, SliceArguments,
    },
    exit::{self, PartialFailure},
    termination,
};

pub(crate) fn slice(arguments: &SliceArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let settings = slicing::SliceSettings {
        audio: arguments.audio,
    };
    let (begin, end, out) = (arguments.begin, arguments.end, &arguments.out);
    let file = slicing::slice_segment(&arguments.video, begin, end, out, settings, progress)?;
    let duration = omnilife_video::probe(out)?.duration_seconds;
    let how = match file.method {
        omnilife_schemas::records::SliceMethod::Copied => "copied".to_owned(),
        omnilife_schemas::records::SliceMethod::Encoded { encoder } => encoder,
    };
    exit::print(&format!(
        "{}: {}, {duration:.3} s, {how}\n",
        out.display(),
        counted(file.frames as usize, "frame")
    ))
}

pub(crate) fn annotate(
    arguments: &AnnotateArguments,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    termination::take_programs_along()?;
    let _lock = FolderLock::take_existing(&arguments.dataset, progress)?;
    let count = annotate_dataset(&arguments.dataset, &arguments.settings()?, progress)?;
    exit::print(&format!(
        "{} annotated; `omnilife curate publish {}` brings statistics and checksums up to date\n",
        counted(count, "sequence"),
        arguments.dataset.display()
    ))
}

pub(crate) fn masks(arguments: &MasksArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    termination::take_programs_along()?;
    let record = write_masks(&arguments.sequence, &arguments.source()?, progress)?;
    if let Some(reliability) = &record.reliability {
        progress.note(&format!("{}: {reliability}", record.method));
    }
    let shares = record.frames.iter().map(|frame| frame.dynamic_share);
    let mean = shares.sum::<f64>() / record.frames.len().max(1) as f64;
    let folder = arguments.sequence.join(DYNAMIC_MASKS_FOLDER);
    let files = record.frames.iter().map(|frame| folder.join(&frame.file));
    let files: Vec<PathBuf> = files.collect();
    let next = match enter_masks(&arguments.sequence, &files, progress)? {
        MasksEntry::Entered => "entered into its scene".to_owned(),
        MasksEntry::Left(reason) => format!(
            "not entered into a scene, because {reason}; this does, and finds poses anew where they are not given:\n  \
             omnilife curate poses {} --masks {}",
            arguments.sequence.display(),
            folder.display()
        ),
    };
    exit::print(&format!(
        "{}: {} masks in {}, {:.2} % of the sphere moves; {next}\n",
        record.sequence,
        record.frames.len(),
        folder.display(),
        100.0 * mean
    ))
}

/// Looks for the operator and mounts and prints the finding, with the command that uses its mask.
pub(crate) fn operator(
    sequence: &Path,
    search: OperatorSearch,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let record = operator::write_operator(sequence, search, progress)?;
    progress.note(&format!("{}: {}", operator::ID, record.reliability));
    let mut text = format!("{}: {}\n", record.sequence, record.reason);
    let folder = sequence.join(OPERATOR_FOLDER);
    if let (Some(mask), Some(image)) = (&record.mask, &record.image) {
        let (mask, image) = (folder.join(mask), folder.join(image));
        let is_doubtful = record.finding == OperatorFinding::Doubtful;
        text += &format!(
            "{:.2} % of the sphere; {}: {}\n  omnilife curate poses {} --ignore-mask {}\n",
            100.0 * record.share,
            match is_doubtful {
                true => "look at the red region, and ignore it if it does not belong to the scene",
                false => "to look at",
            },
            image.display(),
            sequence.display(),
            mask.display()
        );
    }
    exit::print(&text)
}

pub(crate) fn export(arguments: &ExportArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let out = &arguments.out;
    let request = ExportRequest {
        scene_folder: &arguments.scene,
        format: &arguments.format,
        split: arguments.split.as_deref(),
        given_only: arguments.given_only,
        cube_faces: arguments.cube_faces(),
        pad_to: arguments.pad_to,
        out,
    };
    let exported = exchange::export(&request, progress)?;
    exit::print(&format!(
        "{}: {}, {}\n",
        out.display(),
        counted(exported.frames.len(), "frame"),
        counted(exported.points.len(), "point")
    ))
}

pub(crate) fn import(arguments: &ImportArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let id = match &arguments.id {
        Some(id) => id.clone(),
        None => exchange::scene_id(&arguments.format, &arguments.folder)?,
    };
    let scene = exchange::import(&ImportRequest {
        folder: &arguments.folder,
        format: &arguments.format,
        id: &id,
        frames_per_second: arguments.fps,
        masks: arguments.masks.into(),
        out: &arguments.out,
    })?;
    for problem in &scene.validation.problems {
        progress.note(&format!("{}: {problem}", scene.id));
    }
    exit::print(&format!(
        "{}: {} of {} frames posed\n",
        scene.id, scene.validation.registered_frames, scene.validation.total_frames
    ))
}

pub(crate) fn publish_dataset(
    arguments: &PublishArguments,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let statistics = publish::publish(&arguments.dataset, &arguments.settings(), progress)?;
    let unstated = publish::unstated(&arguments.dataset)?;
    if !unstated.is_empty() {
        let unstated = unstated.join(", ");
        progress.note(&format!(
            "the card lacks {unstated}; add them with --about FILE"
        ));
    }
    let working = publish::working_files(&arguments.dataset)?;
    if !working.is_empty() {
        progress.note(&format!(
            "the release is what SHA256SUMS lists; leave out of an upload: {}",
            working.join(", ")
        ));
    }
    exit::print(&format!(
        "{}: {}, {}, {:.1} s on average\n",
        arguments.dataset.display(),
        counted(statistics.rows.len(), "sequence"),
        publish::duration_in_words(statistics.seconds()),
        statistics.mean_seconds()
    ))
}

pub(crate) fn select(arguments: &SelectArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let (dataset, out) = (&arguments.dataset, &arguments.out);
    let selection = publish::select(dataset, &arguments.request(), out, progress)?;
    let mut text = format!(
        "{}: {} of {}\n",
        out.display(),
        selection.rows.len(),
        counted(selection.candidates, "sequence")
    );
    for (property, distance) in &selection.distances {
        text += &format!("{property}: shares differ by {:.1} %\n", 100.0 * distance);
    }
    exit::print(&text)
}

/// Prints what every sequence has and lacks: on a terminal the beginning, else all.
pub(crate) fn status(dataset: &Path, as_json: bool) -> anyhow::Result<()> {
    if as_json {
        let bytes = store::record_bytes(&overview::status(dataset, ".")?)?;
        return exit::print(&String::from_utf8(bytes)?);
    }
    let shown = dataset.display().to_string();
    let table = overview::table(&overview::status(dataset, &shown)?);
    exit::print(&exit::for_reader(&table.short, &table.whole))
}

/// Prints one line per fault.
pub(crate) fn verify(dataset: &Path, progress: &dyn Progress) -> anyhow::Result<()> {
    let faults = publish::verify(dataset, progress)?;
    if faults.is_empty() {
        return exit::print(&format!("{}: sound\n", dataset.display()));
    }
    exit::print(
        &faults
            .iter()
            .map(|fault| format!("{fault}\n"))
            .collect::<String>(),
    )?;
    Err(PartialFailure {
        message: match faults.len() {
            1 => format!("{}: 1 fault", dataset.display()),
            count => format!("{}: {count} faults", dataset.display()),
        },
        blame: ErrorKind::User,
    }
    .into())
}
