//! `omnilife reconstruct edit`: an edited run, its views, or a preview of one frame.

use std::path::Path;

use omnilife_reconstruct::{
    jobs::{
        camera_words::{CameraPlaces, CameraWords},
        edit::{self, EditRequest},
        render::{self, RenderCamera, RenderRequest, RenderedViews},
    },
    models::EditPurpose,
};
use omnilife_schemas::{plain_text::counted, progress::Progress, staging::Staging, store};

use super::{reconstruct::film, video};
use crate::{cli::EditArguments, exit};

/// Folder of the views of an edited run.
const VIEWS_FOLDER: &str = "views";
/// Name of the folder of an edited run that is only previewed.
const PREVIEW_FOLDER: &str = "edited";

pub(super) fn execute(arguments: &EditArguments, progress: &dyn Progress) -> anyhow::Result<()> {
    if let Some(file) = &arguments.video {
        // Checked before the edit, not after it.
        video::check(file)?;
    }
    let text = match (&arguments.poses, arguments.preview) {
        (Some(poses), Some(frame)) => preview(arguments, poses, frame, progress)?,
        (Some(poses), None) => {
            let mut text = edited(arguments, &arguments.out, EditPurpose::Run, progress)?;
            let views = arguments.out.join(VIEWS_FOLDER);
            let model = &arguments.out;
            let rendered = rendered(arguments, model, poses, None, &views, progress)?;
            text += &format!(
                "{} in {}\n",
                counted(rendered.views, "view"),
                views.display()
            );
            if let Some(file) = &arguments.video {
                text += &film(&rendered, file)?;
            }
            text
        }
        (None, _) => edited(arguments, &arguments.out, EditPurpose::Run, progress)?,
    };
    exit::print(&text)
}

/// Edits the run into a folder; returns the changes, a line each.
fn edited(
    arguments: &EditArguments,
    out: &Path,
    purpose: EditPurpose,
    progress: &dyn Progress,
) -> anyhow::Result<String> {
    let request = EditRequest {
        run: arguments.run.clone(),
        script: arguments.script.clone(),
        out: out.to_owned(),
        purpose,
    };
    let done = edit::edit(&request, progress)?;
    Ok(done.iter().map(|line| format!("{line}\n")).collect())
}

/// Renders one frame of the edited run at half its size; the run itself is removed.
fn preview(
    arguments: &EditArguments,
    poses: &Path,
    frame: usize,
    progress: &dyn Progress,
) -> anyhow::Result<String> {
    store::create_folder(&arguments.out)?;
    let staging = Staging::new(&arguments.out, PREVIEW_FOLDER)?;
    let text = edited(arguments, &staging.folder, EditPurpose::Preview, progress)?;
    let out = &arguments.out;
    let rendered = rendered(
        arguments,
        &staging.folder,
        poses,
        Some(frame),
        out,
        progress,
    )?;
    let files = rendered.files.iter();
    let files: String = files.map(|file| format!("{}\n", file.display())).collect();
    Ok(text + &files)
}

/// Renders a model along poses, or one frame of them at half its size.
fn rendered(
    arguments: &EditArguments,
    model: &Path,
    poses: &Path,
    frame: Option<usize>,
    out: &Path,
    progress: &dyn Progress,
) -> anyhow::Result<RenderedViews> {
    let half = |side: u32| (side / 2).max(1);
    let size = frame.map(|_| render::frame_size(poses)).transpose()?;
    let request = RenderRequest {
        model: model.to_owned(),
        axes: None,
        poses: poses.to_owned(),
        cameras: CameraWords {
            places: frame.map_or(CameraPlaces::OfPoses, CameraPlaces::Frame),
            ..CameraWords::default()
        },
        size: size.map(|size| size.map(half)),
        camera: RenderCamera::OfPoses,
        layer: arguments.layer.clone().unwrap_or_else(|| "all".to_owned()),
        cube_faces: None,
        out: out.to_owned(),
    };
    Ok(render::render_poses(&request, progress)?)
}
