//! Training in a run's folder: the model, its views and its trace.

use std::path::Path;

use omnilife_schemas::{
    elapsed::Stopwatch,
    layout::RUN_FILE,
    progress::Progress,
    records::{RunRecord, Split, TraceViews as KeptViews},
    stage::StagePlan,
    store::{self, StoreError},
};

use super::{
    reconstruct::{
        CHECKPOINT_FILE, INPUT_FOLDER, LIFT_FILE, NOVEL_FOLDER, PAGE_FILE, ReconstructRequest,
        TRACE_FILE, prepare_predictions, view_file,
    },
    trace_folder::{self, TRACE_FOLDER},
};
use crate::registry;
use omnilife_engine::training_view::TrainingView;
use omnilife_training::{
    components,
    error::ReconstructError,
    learner::Learner,
    method::{Method, MethodOutcome},
    scene::TrainingScene,
    train::{
        Session, TrainingFiles, trace,
        trace_views::TraceViews,
        watch::{
            self, WatchFiles,
            page::{Page, PageState},
        },
    },
};

/// Trains a method, leaves its model, views and trace in the run's folder, and completes the run's record; returns the
/// files relative to that folder.
///
/// # Errors
/// When the scene cannot be loaded, training fails, or a file cannot be written.
pub(super) fn train(
    method: &Method,
    request: &ReconstructRequest,
    split: &Split,
    stage: &StagePlan,
    progress: &dyn Progress,
    record: &mut RunRecord,
) -> Result<Vec<String>, ReconstructError> {
    let trace_path = request.out.join(TRACE_FILE);
    let mut scene = TrainingScene::load(&request.scene, &request.split, method.camera_extent())?;
    let begun = Stopwatch::of_own_process();
    progress.begin("completing points", None);
    let points = components::complete_points(&mut scene, method.supported(), &request.settings);
    progress.end();
    let planning = begun.elapsed();
    let kept = TraceViews::new(
        request.out.join(TRACE_FOLDER),
        &split.novel_views,
        request.trace_views,
    );
    let page = Page {
        file: request.out.join(PAGE_FILE),
        title: format!("{} on {}", method.id, scene.id),
    };
    let session = Session {
        progress,
        files: Some(TrainingFiles {
            trace: trace_path.clone(),
            trace_views: Some(kept.clone()),
            watch: WatchFiles {
                page: Some(page.clone()),
                tensorboard: request.tensorboard.clone(),
            },
            checkpoint: request.out.join(CHECKPOINT_FILE),
            checkpoint_every: request.checkpoint_every,
            inputs_sha256: stage.inputs_sha256(),
        }),
        backend: request.backend,
        planning,
    };
    let mut outcome = method.train(&scene, &request.settings, &session)?;
    let begun = Stopwatch::of_own_process();
    let mut outputs = render_predictions(&scene, &mut outcome, stage, &request.out, progress)?;
    let rendering = begun.elapsed();
    record.warnings = warnings(&scene, split, &outcome);
    let lift_path = request.out.join(LIFT_FILE);
    match &outcome.findings.lift {
        Some(lift) => {
            store::write_record(&lift_path, lift)?;
            outputs.push(LIFT_FILE.to_owned());
        }
        None => store::remove(&lift_path)?,
    }
    let (state, learner) = (&outcome.training.state, &mut outcome.learner);
    outputs.extend(export_model(&mut **learner, stage, &request.out)?);
    trace::write_csv(&trace_path, &state.trace)?;
    let shown = watch::middle(&split.novel_views);
    let shown = shown.map(|&frame| view_file(NOVEL_FOLDER, frame));
    page.write(&state.trace, PageState::Ended, shown.as_deref())?;
    outputs.extend([TRACE_FILE, PAGE_FILE].map(str::to_owned));
    outputs.extend(trace_folder::files(&state.trace, &kept.frames));
    // Views of an earlier run's rows.
    stage
        .own_files()
        .remove(|file| trace_folder::holds(file) && !outputs.iter().any(|new| new == file))?;
    let evidence = outcome.findings.evidence.as_ref().map(serde_json::to_value);
    record.evidence = evidence.transpose().map_err(|error| {
        StoreError::write(&request.out.join(RUN_FILE), std::io::Error::other(error))
    })?;
    record.backend = learner.backend();
    record.primitives = learner.size().primitives;
    record.configuration = outcome.configuration;
    record.plan = points.into_iter().chain(outcome.findings.plan).collect();
    record.aids = Some(method.supported().used_aids(&record.plan));
    record.planning_seconds = outcome.planning.wall_seconds;
    record.planning_cpu_seconds = outcome.planning.cpu_seconds;
    record.iterations = state.iteration;
    record.training_seconds = state.training.as_secs_f64();
    record.training_cpu_seconds = state.training_cpu.map(|time| time.as_secs_f64());
    record.evaluation_seconds = state.evaluation.as_secs_f64();
    record.rendering_seconds = rendering.wall_seconds;
    record.rendering_cpu_seconds = rendering.cpu_seconds;
    record.normalization = scene.normalization;
    record.trace = Some(TRACE_FILE.to_owned());
    record.trace_views = Some(KeptViews {
        folder: TRACE_FOLDER.to_owned(),
        frames: kept.frames,
    });
    record.surfaces = state.trace.last().and_then(|row| row.surfaces);
    record.predictions.input_views = Some(INPUT_FOLDER.to_owned());
    Ok(outputs)
}

/// Writes the model's files and removes those of an earlier model, by whatever method; returns their names.
fn export_model(
    learner: &mut dyn Learner,
    stage: &StagePlan,
    out: &Path,
) -> Result<Vec<String>, ReconstructError> {
    let written = learner.export(out)?;
    let models = registry::model_files();
    stage
        .own_files()
        .remove(|file| models.contains(file) && !written.iter().any(|new| new == file))?;
    Ok(written)
}

/// Renders all views of the split; returns the files relative to the run's folder.
fn render_predictions(
    scene: &TrainingScene,
    outcome: &mut MethodOutcome<'_>,
    stage: &StagePlan,
    out: &Path,
    progress: &dyn Progress,
) -> Result<Vec<String>, ReconstructError> {
    let learner = &mut outcome.learner;
    let total = scene.input_views.len() + scene.novel_views.len();
    progress.begin("rendering", Some(total as u64));
    let mut files = Vec::with_capacity(total);
    let mut render = |views: &[TrainingView], name: &str| -> Result<(), ReconstructError> {
        prepare_predictions(stage, out, name)?;
        for view in views {
            let file = view_file(name, view.frame);
            let image = learner.image(&view.view)?;
            image.write_png(&out.join(&file))?;
            files.push(file);
            progress.advance(1);
        }
        Ok(())
    };
    let outcome = render(&scene.input_views, INPUT_FOLDER)
        .and_then(|()| render(&scene.novel_views, NOVEL_FOLDER));
    progress.end();
    outcome.map(|()| files)
}

fn warnings(scene: &TrainingScene, split: &Split, outcome: &MethodOutcome<'_>) -> Vec<String> {
    let training = &outcome.training;
    let mut warnings = training.warnings.clone();
    warnings.extend(scene.seen_for_points.clone());
    if split.groups.len() > 1 {
        warnings.push(format!(
            "one model was trained on the given views of all {} groups at once",
            split.groups.len()
        ));
    }
    let masked = scene
        .input_views
        .iter()
        .filter(|view| view.mask.is_some())
        .count();
    if masked > 0 && masked < scene.input_views.len() && outcome.learner.size().with_times > 0 {
        warnings.push(format!(
            "{} of {} input views have no mask; nothing is known of what moves in them",
            scene.input_views.len() - masked,
            scene.input_views.len()
        ));
    }
    let has_samples = outcome.findings.lift.is_some();
    if scene.points.is_empty() && !has_samples && outcome.learner.begins_with_points() {
        warnings
            .push("the scene has no points; training began from the sky shell alone".to_owned());
    }
    warnings.extend(outcome.learner.warnings());
    if scene.is_normalized_by_points {
        warnings.push(
            "the cameras hardly move in a scene of this size; it is normalized by its points"
                .to_owned(),
        );
    }
    let refused: u64 = training.state.refused.iter().sum();
    if refused > 0 {
        warnings.push(format!(
            "{refused} gradient values were not finite and were not applied; the trace counts them \
             by array"
        ));
    }
    if training.stopped_by_budget {
        warnings.push(format!(
            "the time budget ended training after {} of {} iterations",
            training.state.iteration, outcome.iterations
        ));
    }
    warnings
}
