//! One interpolator on one scene: the files of a training, made without one.

use std::{path::Path, time::Instant};

use omnilife_schemas::{
    RgbImage,
    camera::ErpCamera,
    lock::FolderLock,
    progress::Progress,
    provenance,
    records::{Backend, RunRecord, Scene, Split, ViewPredictions},
    store,
};
use serde::Serialize;

use omnilife_engine::EngineError;

use crate::methods::feed_forward::{
    ContextView, Group, GroupFrames, Interpolator, Station, groups,
};
use crate::{
    error::ReconstructError,
    jobs::reconstruct::{
        NOVEL_FOLDER, RUN_FILE, ReconstructRequest, plan_stage, prepare_predictions, view_file,
    },
    process,
    request::{BackendChoice, MethodRequest},
};

/// Times of every group, in the run's folder.
pub const GROUPS_FILE: &str = "groups.csv";

/// Checks that a request asks for nothing that an interpolator does not have.
///
/// # Errors
/// When it names components or a device.
pub fn check(
    interpolator: &Interpolator,
    settings: &MethodRequest,
    backend: BackendChoice,
) -> Result<(), ReconstructError> {
    if let Some(name) = settings.without.iter().chain(&settings.with).next() {
        return Err(ReconstructError::UnknownComponent {
            method: interpolator.id.to_owned(),
            name: name.clone(),
            known: "none".to_owned(),
        });
    }
    if backend != BackendChoice::Cpu {
        return Err(EngineError::Backend {
            reason: format!("{} runs on the processor alone", interpolator.id),
        }
        .into());
    }
    Ok(())
}

/// A row of [`GROUPS_FILE`].
#[derive(Debug, Serialize)]
struct GroupRow {
    first_frame: u32,
    last_frame: u32,
    novel_views: usize,
    gaussians: u64,
    analysis_seconds: f64,
    rendering_seconds: f64,
}

/// Predicts the novel views of a split, or returns the stored record when nothing has changed.
///
/// # Errors
/// When the scene cannot be loaded, the split gives fewer than two views, or a file cannot be
/// written.
pub fn interpolate(
    interpolator: &Interpolator,
    request: &ReconstructRequest,
    progress: &dyn Progress,
) -> Result<RunRecord, ReconstructError> {
    check(interpolator, &request.settings, request.backend)?;
    let (stage, inputs) = plan_stage(request)?;
    let record_path = request.out.join(RUN_FILE);
    if stage.is_done() {
        progress.note(&format!(
            "{} on {}: unchanged, skipped",
            interpolator.id,
            request.scene.display()
        ));
        return Ok(store::read_record(&record_path)?);
    }
    let _lock = FolderLock::take(&request.out, progress)?;
    let begun = Instant::now();
    let frames = Frames::open(&request.scene, &request.split)?;
    let views = frames.split.novel_views.iter();
    let views = views.map(|&frame| view_file(NOVEL_FOLDER, frame));
    let records = [RUN_FILE, GROUPS_FILE].map(str::to_owned);
    stage.claim(views.chain(records))?;
    store::remove(&record_path)?;
    let groups = groups(&frames.split).ok_or_else(|| {
        ReconstructError::scene(&request.split, "gives fewer than two views to predict from")
    })?;
    prepare_predictions(&stage, &request.out, NOVEL_FOLDER)?;
    progress.begin(interpolator.id, Some(frames.split.novel_views.len() as u64));
    let made = groups
        .iter()
        .map(|group| make_group(interpolator, &frames, group, &request.out, progress))
        .collect::<Result<Vec<_>, _>>();
    progress.end();
    let made = made?;
    let rows: Vec<&GroupRow> = made.iter().map(|group| &group.row).collect();
    store::write_csv_rows(&request.out.join(GROUPS_FILE), &rows)?;
    let analysis_seconds: f64 = rows.iter().map(|row| row.analysis_seconds).sum();
    let rendering_seconds: f64 = rows.iter().map(|row| row.rendering_seconds).sum();
    let record = RunRecord {
        method: interpolator.id.to_owned(),
        scene: frames.scene.id.clone(),
        protocol_hash: frames.split.protocol_hash.clone(),
        seed: request.settings.seed,
        backend: Backend::Cpu {
            threads: rayon::current_num_threads() as u32,
        },
        configuration: (interpolator.settings)(),
        plan: Vec::new(),
        evidence: None,
        hardware: Some(provenance::Hardware::here()),
        versions: provenance::versions(),
        inputs,
        iterations: 0,
        gaussians: rows.iter().map(|row| row.gaussians).max().unwrap_or(0),
        planning_seconds: 0.0,
        planning_cpu_seconds: None,
        training_seconds: analysis_seconds,
        training_cpu_seconds: None,
        evaluation_seconds: 0.0,
        rendering_seconds,
        seconds_per_group: (!rows.is_empty())
            .then(|| (analysis_seconds + rendering_seconds) / rows.len() as f64),
        peak_memory_bytes: process::peak_memory_bytes(),
        normalization: omnilife_schemas::Similarity {
            offset: [0.0; 3],
            scale: 1.0,
        },
        trace: None,
        predictions: ViewPredictions {
            input_views: None,
            novel_views: NOVEL_FOLDER.to_owned(),
        },
        warnings: made
            .iter()
            .flat_map(|group| group.remarks.clone())
            .collect(),
    };
    store::write_record(&record_path, &record)?;
    let mut outputs: Vec<String> = made.into_iter().flat_map(|group| group.files).collect();
    outputs.extend([RUN_FILE, GROUPS_FILE].map(str::to_owned));
    stage.finish(outputs, begun.elapsed().as_secs_f64())?;
    Ok(record)
}

/// A scene and its split, whose images are read when they are needed.
struct Frames<'a> {
    scene_file: &'a Path,
    split_file: &'a Path,
    scene: Scene,
    split: Split,
    camera: ErpCamera,
}

impl<'a> Frames<'a> {
    fn open(scene_file: &'a Path, split_file: &'a Path) -> Result<Self, ReconstructError> {
        let scene: Scene = store::read_record(scene_file)?;
        let split: Split = store::read_record(split_file)?;
        let camera = crate::scene::checked_camera(&scene, &split, split_file)?;
        Ok(Self {
            scene_file,
            split_file,
            scene,
            split,
            camera,
        })
    }

    fn station(&self, frame: u32) -> Result<Station, ReconstructError> {
        self.scene
            .frames
            .get(frame as usize)
            .and_then(|entry| Station::new(entry.pose.as_ref()?, entry.time_seconds))
            .ok_or_else(|| {
                ReconstructError::scene(
                    self.split_file,
                    format!("the scene has no usable pose for its frame {frame}"),
                )
            })
    }

    fn view(&self, frame: u32) -> Result<ContextView, ReconstructError> {
        let station = self.station(frame)?;
        let file = self
            .scene_file
            .with_file_name(&self.scene.frames[frame as usize].image);
        Ok(ContextView {
            frame,
            station,
            image: crate::scene::read_image(&file, &self.scene, self.camera)?,
        })
    }

    fn group(&self, frames: &GroupFrames) -> Result<Group, ReconstructError> {
        Ok(Group {
            camera: self.camera,
            context: [self.view(frames.context[0])?, self.view(frames.context[1])?],
            targets: frames
                .novel_views
                .iter()
                .map(|&frame| self.station(frame))
                .collect::<Result<_, _>>()?,
        })
    }
}

/// What became of a group.
struct MadeGroup {
    row: GroupRow,
    files: Vec<String>,
    remarks: Vec<String>,
}

fn make_group(
    interpolator: &Interpolator,
    frames: &Frames<'_>,
    group: &GroupFrames,
    out: &Path,
    progress: &dyn Progress,
) -> Result<MadeGroup, ReconstructError> {
    let interpolated = (interpolator.interpolate)(&frames.group(group)?)?;
    let mut files = Vec::new();
    for (frame, image) in group.novel_views.iter().zip(&interpolated.images) {
        let file = view_file(NOVEL_FOLDER, *frame);
        RgbImage::write_png(image, &out.join(&file))?;
        files.push(file);
        progress.advance(1);
    }
    Ok(MadeGroup {
        row: GroupRow {
            first_frame: group.context[0],
            last_frame: group.context[1],
            novel_views: group.novel_views.len(),
            gaussians: interpolated.gaussians,
            analysis_seconds: interpolated.analysis_seconds,
            rendering_seconds: interpolated.rendering_seconds,
        },
        files,
        remarks: interpolated.remarks,
    })
}
