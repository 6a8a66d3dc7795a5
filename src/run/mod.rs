//! Main job, `omnilife run`: from raw videos to a scored table.
//!
//! The folder it fills:
//!
//! ```text
//! OUT/dataset.json                         every video with its outcome
//! OUT/outcomes.csv                         every sequence with its outcome
//! OUT/table.md, OUT/table.csv              the scores
//! OUT/leaderboard/site/index.html          the same to look at, with rendered views
//! OUT/index.html, OUT/status.json          the dataset to look at, and what its sequences lack
//! OUT/videos/<video>/boundaries.json, ...
//! OUT/videos/<video>/seq-000/sequence.json, frames/, scene.json, points.ply, and dynamic-masks/ where masks are made
//! OUT/videos/<video>/seq-000/<protocol>/split.json, and dense/, tracks.json where the method takes vehicles
//! OUT/videos/<video>/seq-000/<protocol>/<method>/run/     run.json, predictions/, gaussians.ply, progress.html
//! OUT/videos/<video>/seq-000/<protocol>/<method>/score/   result.json, comparisons/
//! ```

mod masks;
pub(crate) mod outcome;

use std::path::{Path, PathBuf};

use omnilife_bench::{ScoreRequest, score, split_scene};
use omnilife_curate::{
    CurateSettings, CuratedDataset, GivenTruth, IgnoredRegion, PoseRequest, curate_dataset_in,
    expand_inputs, left_out_of_folders, overview, pose_sequence_with,
};
use omnilife_leaderboard::{LeaderboardRequest, build_leaderboard_of};
use omnilife_reconstruct::{
    jobs::reconstruct::{self, ReconstructRequest},
    methods::{self, METHODS, Method, requirement::Requirement},
    request::{BackendChoice, MethodRequest},
};
use omnilife_schemas::{
    ErrorKind,
    layout::{DATASET_FILE, RUN_FILE, SCENE_FILE, SPLIT_FILE},
    progress::Progress,
    records::{Dataset, ResultRecord, VideoStatus},
    stage::{StageOutputs, StagePlan},
    store,
};
use omnilife_tracks::TrackOptions;

use crate::{
    cli::{RunArguments, TrackArguments},
    commands,
    exit::{self, BadRequest, PartialFailure},
    preparation,
    prerequisites::{self, Prerequisite},
    termination,
};
use masks::MaskStep;
use outcome::{Outcome, Outcomes};

/// Folder of tables in all layouts and of the site.
const BOARD_FOLDER: &str = "leaderboard";
/// Number of rendered views that the site shows per scene and method.
const SITE_VIEWS: usize = 4;
/// Name of the summary.
const OUTCOMES_FILE: &str = "outcomes.csv";
/// Files of the summary and of the table.
const SUMMARY_FILES: [&str; 3] = [
    OUTCOMES_FILE,
    omnilife_leaderboard::MARKDOWN_FILE,
    omnilife_leaderboard::CSV_FILE,
];

/// Runs the main job and prints the table to standard output.
///
/// # Errors
/// When nothing could be scored, or something failed beside the scored sequences.
pub(crate) fn main_job(arguments: &RunArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    termination::guard_training()?;
    let videos = expand_inputs(&arguments.videos)?;
    let left_out = left_out_of_folders(&arguments.videos, &videos)?;
    for line in &left_out.lines {
        progress.note(line);
    }
    let settings = arguments.method.request(arguments.iterations)?;
    let method = methods::find(&arguments.method.method)?;
    let (masks, masks_off) = MaskStep::of(&arguments.masks, method, &settings);
    let job = Job {
        poses: arguments.poses.request(masks.given()),
        truth: arguments.poses.truth(masks.given()),
        masks,
        operator: arguments.masks.operator,
        method: arguments.method.method.clone(),
        variant: arguments.method.variant(arguments.iterations)?,
        settings,
        backend: arguments.method.backend.into(),
        checkpoint_every: arguments.method.checkpoint_every,
        trace_views: arguments.method.trace_views,
        tensorboard: arguments.method.tensorboard.clone(),
        protocol: arguments.protocol.clone(),
        dense: arguments.dense,
        tracking: tracking(&arguments.tracking, method)?,
        every_frame: arguments.tracking.every_frame,
        progress,
    };
    // A faulty request must not be found out after an hour of work.
    reconstruct::check(&job.method, &job.settings, job.backend)?;
    omnilife_bench::protocols::protocol(&job.protocol)?;
    arguments.tracking.refuse_stills(&videos)?;
    if job.poses_are_given() && videos.len() > 1 {
        return Err(BadRequest(format!(
            "--poses belongs to one video, {} were given",
            videos.len()
        ))
        .into());
    }

    let settings = arguments.curation.settings(&arguments.criteria, false);
    let summary = StagePlan::new(&arguments.out, "summary");
    let sources = arguments.sources.as_deref();
    overview::refuse_foreign_page(&arguments.out)?;
    prerequisites::require(sources.map(Prerequisite::Origins))?;
    job.require(&videos, &settings, &arguments.out, &summary)?;
    let place = commands::curate::place(&arguments.limit)?;
    let curated =
        commands::curate::with_origins(sources, &videos, &arguments.out, progress, || {
            curate_dataset_in(
                &place,
                &videos,
                &left_out.files,
                &arguments.out,
                &settings,
                progress,
            )
        })?;
    job.refuse_shared_files(&curated.record)?;
    if let Some(line) = masks_off {
        progress.note(&line);
    }
    let (outcomes, printed) = summary.run(SUMMARY_FILES, progress, |made| {
        score_all(&job, &videos, &curated, &arguments.out, made)
    })?;
    let page = overview::write_page(&arguments.out, progress)?;
    progress.note(&format!("{}: open it in a browser", page.display()));
    // A closed pipe must not turn a failure into a success.
    outcomes.as_result()?;
    printed
}

/// Scores all sequences, writes the summary and prints the table; returns the outcome of printing beside those of the
/// sequences.
fn score_all(
    job: &Job<'_>,
    videos: &[PathBuf],
    curated: &CuratedDataset,
    out: &Path,
    made: &mut StageOutputs<'_>,
) -> anyhow::Result<(Outcomes, anyhow::Result<()>)> {
    let mut outcomes = Outcomes::default();
    let mut failed = Vec::new();
    let mut number = 0;
    let total = sequence_count(&curated.record);
    for (index, video) in curated.record.videos.iter().enumerate() {
        if let VideoStatus::Curated { sequences } = &video.status {
            for sequence in sequences {
                let folder = out.join(sequence);
                let id = sequence.strip_prefix("videos/").unwrap_or(sequence);
                number += 1;
                let label = match total {
                    1 => id.to_owned(),
                    total => format!("{number} of {total}: {id}"),
                };
                job.progress.begin(&label, None);
                let scored = job.score_sequence(&folder, id, videos.get(index));
                job.progress.end();
                outcomes.push(match scored {
                    Ok(()) => Outcome::scored(&video.file, id),
                    Err(error) if exit::is_interruption(&error) => return Err(error),
                    Err(error) => {
                        job.progress.note(&format!("{id}: {error}"));
                        failed.push(job.method_folder(&folder));
                        Outcome::failed(&video.file, id, &error, out)
                    }
                });
            }
        }
        for (_, error) in curated.errors.iter().filter(|(failed, _)| *failed == index) {
            outcomes.push(Outcome::failed_video(&video.file, error));
        }
    }
    outcomes.write_csv(&out.join(OUTCOMES_FILE))?;
    // Other methods' scores of these videos belong into the table. Leftovers of a video that was not curated this
    // time, or of a sequence that failed this time, do not.
    let sequences: Vec<PathBuf> = curated
        .record
        .videos
        .iter()
        .filter_map(|video| match &video.status {
            VideoStatus::Curated { sequences } => Some(sequences),
            _ => None,
        })
        .flatten()
        .map(|sequence| out.join(sequence))
        .collect();
    let is_current = |file: &Path| {
        sequences.iter().any(|folder| file.starts_with(folder))
            && !failed.iter().any(|folder| file.starts_with(folder))
    };
    let first = sequences
        .iter()
        .find(|folder| is_current(&job.method_folder(folder)));
    let next = first.map_or_else(String::new, |folder| job.next_commands(folder));
    let printed = report(out, &outcomes, is_current, &next);
    let is_there = |file: &&str| out.join(file).is_file();
    made.add_all(SUMMARY_FILES.into_iter().filter(is_there));
    Ok((outcomes, printed))
}

/// Builds and prints the table of the results that `is_current` accepts, and the summary.
fn report(
    out: &Path,
    outcomes: &Outcomes,
    is_current: impl Fn(&Path) -> bool,
    next: &str,
) -> anyhow::Result<()> {
    if outcomes.scored() == 0 {
        // Tables of an earlier run would look like those of this one.
        for file in [
            omnilife_leaderboard::MARKDOWN_FILE,
            omnilife_leaderboard::CSV_FILE,
        ] {
            store::remove(&out.join(file))?;
        }
        return exit::print(&outcomes.text());
    }
    let mut results = omnilife_leaderboard::collect(out)?;
    results.retain(|(file, _)| is_current(file));
    let tables = omnilife_leaderboard::build(&results, out)?;
    let board = build_leaderboard_of(
        &LeaderboardRequest {
            results: out.to_owned(),
            out: out.join(BOARD_FOLDER),
            dataset: Some(out.join(DATASET_FILE)),
            page: None,
            site: true,
            views: SITE_VIEWS,
            project: None,
            descriptions: commands::method_list::descriptions(),
        },
        is_current,
    )?;
    exit::print(&format!(
        "{}\n{}\nTable: {}\nSite, for a browser: {}\n{next}",
        exit::for_reader(&tables.short, &tables.markdown),
        outcomes.text(),
        tables.markdown_file.display(),
        board.site.unwrap_or_default().display()
    ))
}

/// Work on every sequence.
struct Job<'a> {
    poses: PoseRequest,
    truth: GivenTruth,
    masks: MaskStep,
    /// True if what the camera carries is looked for.
    operator: bool,
    method: String,
    /// Name of the method in tables.
    variant: String,
    settings: MethodRequest,
    backend: BackendChoice,
    checkpoint_every: u64,
    trace_views: Option<usize>,
    tensorboard: Option<PathBuf>,
    protocol: String,
    dense: bool,
    /// Detector, distances and association of vehicles.
    tracking: TrackOptions,
    /// True if vehicles are tracked through every frame of the video.
    every_frame: bool,
    progress: &'a dyn Progress,
}

impl Job<'_> {
    fn poses_are_given(&self) -> bool {
        matches!(self.poses, PoseRequest::Given(_))
    }

    /// Checks everything that a run needs. Where the output holds sequences of an earlier run, needs of stages that
    /// may be done already are left to the stages. Structure from motion is needed as soon as a video may become a
    /// sequence.
    fn require(
        &self,
        videos: &[PathBuf],
        settings: &CurateSettings,
        out: &Path,
        summary: &StagePlan,
    ) -> anyhow::Result<()> {
        let mut needed = vec![
            Prerequisite::PoseFiles(&self.poses, self.truth.pose_convention),
            Prerequisite::TruthFiles(&self.truth),
        ];
        if let Some(video) = videos.first() {
            needed.push(Prerequisite::Settings(settings, video));
        }
        needed.push(Prerequisite::Output(out, summary, &SUMMARY_FILES));
        if !prerequisites::has_sequences(out) {
            needed.push(Prerequisite::Backend(self.backend));
            if let Some(video) = videos.iter().find(|video| prerequisites::is_filled(video)) {
                needed.push(Prerequisite::BoundaryDetector(settings, video));
                if !self.poses_are_given() {
                    needed.push(Prerequisite::StructureFromMotion);
                }
            }
        }
        needed.push(Prerequisite::Room(out, settings));
        prerequisites::require(needed)
    }

    /// Refuses one folder of masks, or one file of boxes, for several sequences: both name frames, and every sequence
    /// counts its frames from 0.
    fn refuse_shared_files(&self, dataset: &Dataset) -> anyhow::Result<()> {
        let sequences = sequence_count(dataset);
        let of_frames = match &self.truth.ignored {
            // A single image belongs to the camera, in whatever direction it looks.
            Some(IgnoredRegion::Masks(path)) if path.is_dir() => Some("--ignore-mask"),
            _ => None,
        };
        let of_frames = self.masks.given().map(|_| "--masks").or(of_frames);
        let boxes = self.tracking.detections.as_ref().map(|_| "--detections");
        let of_frames = of_frames.or(boxes);
        match of_frames {
            Some(option) if sequences > 1 => Err(BadRequest(format!(
                "{option} belongs to one sequence, the videos gave {sequences}; pose them one by \
                 one with `omnilife curate poses`"
            ))
            .into()),
            _ => Ok(()),
        }
    }

    /// Returns the folder of the run and the scores of a sequence.
    fn method_folder(&self, sequence_folder: &Path) -> PathBuf {
        sequence_folder.join(&self.protocol).join(&self.variant)
    }

    /// Returns the commands to suggest for a scored sequence.
    fn next_commands(&self, folder: &Path) -> String {
        let run = self.method_folder(folder).join("run");
        let (run, folder) = (run.display(), folder.display());
        let is_trained = |id: &str| methods::find(id).is_ok_and(Method::is_trained);
        let own = is_trained(&self.method);
        let other = METHODS.iter().find(|method| method.is_trained() != own);
        let other = other.map_or("", |method| method.id);
        format!(
            "Next:\n  omnilife reconstruct render {run} --poses {folder} --out VIEWS --video views.mp4\n  \
             omnilife bench run {folder} --methods {},{other} --out BENCH\n",
            self.method
        )
    }

    /// Makes masks of the operator and of dynamic regions, and the poses of one sequence.
    fn pose(&self, folder: &Path, id: &str) -> anyhow::Result<()> {
        let (mut poses, mut truth) = (self.poses.clone(), self.truth.clone());
        if self.operator {
            let mask = masks::operator(folder, id, self.progress);
            truth.ignored = mask.map(IgnoredRegion::Masks);
        }
        let masks = self.masks.make(folder, id, self.progress);
        match &mut poses {
            PoseRequest::Given(_) => truth.masks = masks,
            PoseRequest::Sfm(settings) => settings.masks = masks,
        }
        pose_sequence_with(folder, &poses, &truth, self.progress)?;
        Ok(())
    }

    /// Makes poses, split, reconstruction and scores of one sequence of a video.
    fn score_sequence(
        &self,
        folder: &Path,
        id: &str,
        video: Option<&PathBuf>,
    ) -> anyhow::Result<()> {
        self.pose(folder, id)?;
        let protocol_folder = folder.join(&self.protocol);
        let (scene, split) = (folder.join(SCENE_FILE), protocol_folder.join(SPLIT_FILE));
        split_scene(&scene, &self.protocol, &split)?;
        if self.dense {
            preparation::dense_points(&scene, &split, true, self.progress)?;
        }
        let method = methods::find(&self.method)?;
        let tracking = TrackOptions {
            video: video.filter(|_| self.every_frame).cloned(),
            ..self.tracking.clone()
        };
        preparation::prepare(&[method], &scene, &split, &tracking, self.progress)?;
        let method_folder = self.method_folder(folder);
        let run = method_folder.join("run");
        reconstruct::reconstruct(
            &ReconstructRequest {
                scene: scene.clone(),
                split: split.clone(),
                method: self.method.clone(),
                settings: self.settings.clone(),
                backend: self.backend,
                checkpoint_every: self.checkpoint_every,
                trace_views: self.trace_views,
                tensorboard: (self.tensorboard.as_ref())
                    .map(|folder| folder.join(id).join(&self.protocol).join(&self.variant)),
                out: run.clone(),
            },
            self.progress,
        )?;
        let request = ScoreRequest::of_run(
            &scene,
            &split,
            &run.join(RUN_FILE),
            &method_folder.join("score"),
        )?;
        refuse_unscored(&score(&request, self.progress)?)
    }
}

/// Returns the options of tracking, with their files checked.
///
/// # Errors
/// When a name is unknown, a file is missing, or the method takes no tracks of vehicles.
fn tracking(arguments: &TrackArguments, method: &Method) -> anyhow::Result<TrackOptions> {
    if let Some(option) = arguments.first_choice()
        && !method.requires.contains(&Requirement::Tracks)
    {
        let takes = METHODS
            .iter()
            .filter(|one| one.requires.contains(&Requirement::Tracks));
        let takes: Vec<&str> = takes.map(|one| one.id).collect();
        return Err(BadRequest(format!(
            "{option} is for methods that take tracks of vehicles ({}), got --method {}",
            takes.join(", "),
            method.id
        ))
        .into());
    }
    let options = arguments
        .options()
        .map_err(|unknown| BadRequest(unknown.to_string()))?;
    options.check()?;
    if arguments.every_frame {
        options.check_every_frame()?;
    }
    Ok(options)
}

fn sequence_count(dataset: &Dataset) -> usize {
    let counts = dataset.videos.iter().map(|video| match &video.status {
        VideoStatus::Curated { sequences } => sequences.len(),
        _ => 0,
    });
    counts.sum()
}

/// Refuses a result without scores, whatever its views state.
fn refuse_unscored(result: &ResultRecord) -> anyhow::Result<()> {
    let summaries = result
        .input_views
        .values()
        .chain(result.novel_views.values());
    if summaries.map(|summary| summary.views).sum::<u32>() > 0 {
        return Ok(());
    }
    let reason = result.why_incomplete().map(|reason| format!(": {reason}"));
    Err(PartialFailure {
        message: format!(
            "none of its views could be scored{}",
            reason.unwrap_or_default()
        ),
        blame: ErrorKind::Internal,
    }
    .into())
}
