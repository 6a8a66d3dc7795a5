//! `omnilife reconstruct`.

use std::path::Path;

use omnilife_reconstruct::{
    backends,
    jobs::{
        atlas, export, plan_cost,
        reconstruct::{self, ReconstructRequest},
        render::{self, RenderedViews},
    },
    methods::{self, METHODS},
    process, scene,
};
use omnilife_schemas::{
    camera::Camera,
    layout::RUN_FILE,
    plain_text::counted,
    progress::Progress,
    records::{Scene, Split, WordedViews},
    store,
};
use omnilife_tracks::TrackOptions;
use omnilife_video::Projection;

use super::{curate::print_json, edit, method_list, note_far_frames, video};
use crate::{
    cli::{AssetArguments, CameraArgument, ReconstructCommand, RenderArguments},
    exit, preparation, termination,
};

pub(crate) fn execute(command: &ReconstructCommand, progress: &dyn Progress) -> anyhow::Result<()> {
    match command {
        ReconstructCommand::Train {
            scene,
            split,
            out,
            method,
            iterations,
            memory,
        } => {
            if let Some(bytes) = memory {
                process::limit_memory(*bytes);
            }
            termination::guard_training()?;
            let record = reconstruct::reconstruct(
                &ReconstructRequest {
                    scene: scene.clone(),
                    split: split.clone(),
                    method: method.method.clone(),
                    settings: method.request(*iterations)?,
                    backend: method.backend.into(),
                    checkpoint_every: method.checkpoint_every,
                    trace_views: method.trace_views,
                    tensorboard: method.tensorboard.clone(),
                    out: out.clone(),
                },
                progress,
            )?;
            let took = if record.iterations == 0 {
                format!("computed in {:.1} s", record.training_seconds)
            } else {
                training_words(
                    record.training_seconds,
                    record.planning_seconds,
                    record.evaluation_seconds,
                )
            };
            exit::print(&format!(
                "{} on {}: {} iterations, {} primitives, {took}; {}\n",
                record.method,
                record.scene,
                record.iterations,
                record.primitives,
                out.join(RUN_FILE).display()
            ))
        }
        ReconstructCommand::Prepare {
            scene,
            split,
            methods: names,
            where_possible,
        } => {
            let methods = names.iter().map(|name| methods::find(name));
            let methods = methods.collect::<Result<Vec<_>, _>>()?;
            // Some methods require nothing, and would leave them unread.
            store::read_record::<Scene>(scene)?;
            store::read_record::<Split>(split)?;
            let tracking = TrackOptions::default();
            match preparation::prepare(&methods, scene, split, &tracking, progress) {
                Err(error) if *where_possible && !exit::is_interruption(&error) => {
                    progress.note(&format!("left as it is: {error}"));
                    Ok(())
                }
                prepared => prepared,
            }
        }
        ReconstructCommand::Plan {
            scene,
            split,
            method,
            iterations,
        } => {
            let request = method.request(*iterations)?;
            let backend = method.backend.into();
            progress.begin("planning", None);
            let plan = plan_cost::plan(scene, split, &method.method, &request, backend);
            progress.end();
            let plan = plan?;
            note_far_frames(scene, progress)?;
            for line in scene::mask_notes(scene, split)? {
                progress.note(&line);
            }
            exit::print(&plan.text())
        }
        ReconstructCommand::Render(arguments) => render(arguments, progress),
        ReconstructCommand::Export(arguments) => export(arguments, progress),
        ReconstructCommand::Atlas { run, out } => {
            let files = atlas::export(run, out, progress)?;
            exit::print(&format!(
                "{} in {}\n",
                counted(files.len(), "file"),
                out.display()
            ))
        }
        ReconstructCommand::Edit(arguments) => edit::execute(arguments, progress),
        ReconstructCommand::Methods { json: false } => {
            exit::print(&METHODS.iter().map(method_list::text).collect::<String>())
        }
        ReconstructCommand::Methods { json: true } => {
            let records = METHODS.iter().map(method_list::record);
            print_json(&records.collect::<Vec<_>>())
        }
        ReconstructCommand::Backends => exit::print(&backends::tables()),
    }
}

/// Returns the times of a training with its planning, and of the trace's renders, seconds. The rounded parts add up to
/// the rounded total.
fn training_words(training: f64, planning: f64, evaluation: f64) -> String {
    let tenths = |seconds: f64| (10.0 * seconds).round() / 10.0;
    let (training, evaluation) = (tenths(training), tenths(evaluation));
    let planning = tenths(planning).min(training);
    let mut text = format!(
        "trained in {training:.1} s (planning {planning:.1} s, steps {:.1} s)",
        training - planning
    );
    if evaluation > 0.0 {
        text += &format!(", measuring on the way took {evaluation:.1} s more");
    }
    text
}

fn export(arguments: &AssetArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    let exported = export::export(&arguments.request(), progress)?;
    for note in &exported.notes {
        progress.note(note);
    }
    let (asset, out) = (&exported.asset, &arguments.out);
    let mut text = String::new();
    for level in &asset.levels {
        text += &format!(
            "{}: {} Gaussians, {:.1} MB, {}\n",
            level.name,
            level.splats,
            level.bytes as f64 / 1e6,
            out.join(&level.file).display()
        );
    }
    if !asset.sequence.is_empty() {
        let bytes: u64 = (asset.sequence.iter())
            .map(|moment| moment.moving.bytes)
            .sum();
        text += &format!(
            "{} files of a sequence, {:.1} MB, {}\n",
            asset.sequence.len(),
            bytes as f64 / 1e6,
            out.display()
        );
    }
    if let Some(page) = &asset.page {
        text += &format!(
            "{:.1} MB, {}\n",
            page.bytes as f64 / 1e6,
            out.join(&page.file).display()
        );
    }
    exit::print(&text)
}

fn render(arguments: &RenderArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    if let Some(file) = &arguments.video {
        // Checked before the rendering, not after it.
        video::check(file)?;
        if matches!(arguments.camera, Some(CameraArgument::Cube)) {
            let reason = "a video shows one image per view, and a cube has six";
            return Err(exit::BadRequest(reason.to_owned()).into());
        }
    }
    let rendered = render::render_poses(&arguments.request()?, progress)?;
    let mut text = format!(
        "{} in {}\n",
        counted(rendered.views, "view"),
        arguments.out.display()
    );
    if rendered.unposed > 0 {
        text += &format!(
            "{} frames have no usable pose and are left out\n",
            rendered.unposed
        );
    }
    if let Some(scale) = rendered.map_scale {
        text += &format!("{scale}\n");
    }
    if let Some(cameras) = &rendered.cameras {
        text += &unseen_table(cameras);
    }
    if let Some(file) = &arguments.video {
        text += &film(&rendered, file)?;
    }
    exit::print(&text)
}

/// Encodes rendered views as a video; returns a line on it.
pub(super) fn film(rendered: &RenderedViews, file: &Path) -> anyhow::Result<String> {
    let projection = match rendered.camera {
        Camera::Erp(_) => Projection::Equirectangular,
        Camera::Pinhole(_) => Projection::Flat,
    };
    let (images, times) = (&rendered.files, &rendered.times_seconds);
    let timing = video::encode(images, times, projection, file)?;
    let mut text = format!("{} {timing}\n", file.display());
    let sides = [rendered.camera.width(), rendered.camera.height()];
    if sides.iter().any(|side| side % 2 == 1) {
        let [width, height] = sides.map(|side| side.next_multiple_of(2));
        let sphere = match projection {
            Projection::Equirectangular => ", and the sphere in them is narrower by as much",
            _ => "",
        };
        text += &format!(
            "video has even sides: its images are widened to {width}x{height} by repeating their last pixels{sphere}\n"
        );
    }
    Ok(text)
}

/// Returns the table of the shares that no input view saw, or the reason why it is missing.
fn unseen_table(cameras: &WordedViews) -> String {
    if let Some(reason) = &cameras.unmeasured {
        return format!("unseen shares are not measured: {reason}\n");
    }
    let mut text = format!(
        "unseen by {} input views\n   view   seconds  share\n",
        cameras.input_views
    );
    let row = |name: &str, seconds: &str, share: Option<f64>| {
        let share = share.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
        format!("{name:>7} {seconds:>9} {share:>7}\n")
    };
    for view in &cameras.views {
        let file = view.files.first().map_or("", String::as_str);
        let name = file.get(..6).unwrap_or(file);
        text += &row(
            name,
            &format!("{:.3}", view.time_seconds),
            view.unseen_share,
        );
    }
    text += &row("mean", "", cameras.mean_unseen_share());
    text
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{Pose, records::WordedView};

    use super::*;

    #[test]
    fn unseen_shares_are_a_table_or_a_reason() {
        let view = |seconds: f64, unseen_share| WordedView {
            files: vec!["000003.png".to_owned()],
            time_seconds: seconds,
            pose: Pose {
                rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
                centre: [0.0; 3],
            },
            unseen_share,
        };
        let mut cameras = WordedViews {
            cameras: "orbit 360".to_owned(),
            definition: String::new(),
            input_views: 9,
            unmeasured: None,
            views: vec![view(0.5, Some(0.125)), view(1.0, None)],
        };
        assert_eq!(
            unseen_table(&cameras),
            "unseen by 9 input views\n   view   seconds  share\n 000003     0.500  12.5 %\n \
             000003     1.000       -\n   mean            12.5 %\n"
        );
        cameras.unmeasured = Some("there are no points".to_owned());
        assert!(unseen_table(&cameras).contains("not measured: there are no points"));
    }

    #[test]
    fn parts_of_a_training_make_the_whole() {
        assert_eq!(
            training_words(77.64, 26.06, 9.96),
            "trained in 77.6 s (planning 26.1 s, steps 51.5 s), measuring on the way took 10.0 s more"
        );
        assert_eq!(
            training_words(0.26, 0.0, 0.01),
            "trained in 0.3 s (planning 0.0 s, steps 0.3 s)"
        );
        // A run that resumed from its checkpoint planned again.
        assert_eq!(
            training_words(1.0, 1.2, 0.0),
            "trained in 1.0 s (planning 1.0 s, steps 0.0 s)"
        );
    }
}
