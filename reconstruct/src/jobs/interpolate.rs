//! A feed-forward method on one scene: the novel views of every group from its two input views.

use omnilife_schemas::{
    RgbImage,
    camera::{Camera, ErpCamera},
    progress::Progress,
    records::{RunRecord, Scene, Split},
    stage::StagePlan,
    store,
};
use serde::Serialize;

use crate::jobs::reconstruct::{NOVEL_FOLDER, ReconstructRequest, prepare_predictions, view_file};
use omnilife_methods::feed_forward::{GroupFrames, groups};
use omnilife_training::{
    error::ReconstructError,
    method::{
        InterpolateGroup,
        group::{CameraPose, ContextView, Group},
    },
    scene::{checked_camera, images::read_image},
};

/// Times of every group, in the run's folder.
pub const GROUPS_FILE: &str = "groups.csv";

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

/// A scene and its split, with images that are read on demand.
pub(crate) struct Frames<'a> {
    request: &'a ReconstructRequest,
    scene: &'a Scene,
    split: &'a Split,
    camera: ErpCamera,
}

impl<'a> Frames<'a> {
    /// Loads a scene and its split.
    ///
    /// # Errors
    /// When the split asks for images of another size than the scene's, or the camera is not equirectangular.
    pub(crate) fn new(
        request: &'a ReconstructRequest,
        scene: &'a Scene,
        split: &'a Split,
    ) -> Result<Self, ReconstructError> {
        let camera = match checked_camera(scene, split, &request.split)? {
            Camera::Erp(camera) => camera,
            Camera::Pinhole(_) => {
                let reason = format!(
                    "its camera is a pinhole; {} looks things up in ERP images",
                    request.method
                );
                return Err(ReconstructError::scene(&request.scene, reason));
            }
        };
        Ok(Self {
            request,
            scene,
            split,
            camera,
        })
    }

    /// Predicts the novel views of all groups into the run's folder and completes the run's record; returns the
    /// files relative to that folder.
    ///
    /// # Errors
    /// When the split gives fewer than two views, an image cannot be read or a file cannot be written.
    pub(crate) fn make_views(
        &self,
        method: &str,
        interpolate: InterpolateGroup,
        stage: &StagePlan,
        progress: &dyn Progress,
        record: &mut RunRecord,
    ) -> Result<Vec<String>, ReconstructError> {
        let out = &self.request.out;
        let groups = groups(self.split).ok_or_else(|| {
            let reason = "gives fewer than two views to predict from";
            ReconstructError::scene(&self.request.split, reason)
        })?;
        prepare_predictions(stage, out, NOVEL_FOLDER)?;
        progress.begin(method, Some(self.split.novel_views.len() as u64));
        let made = groups
            .iter()
            .map(|group| self.make_group(interpolate, group, progress))
            .collect::<Result<Vec<_>, _>>();
        progress.end();
        let made = made?;
        let rows: Vec<&GroupRow> = made.iter().map(|group| &group.row).collect();
        store::write_csv_rows(&out.join(GROUPS_FILE), &rows)?;
        let analysis_seconds: f64 = rows.iter().map(|row| row.analysis_seconds).sum();
        let rendering_seconds: f64 = rows.iter().map(|row| row.rendering_seconds).sum();
        record.primitives = rows.iter().map(|row| row.gaussians).max().unwrap_or(0);
        record.training_seconds = analysis_seconds;
        record.rendering_seconds = rendering_seconds;
        record.seconds_per_group =
            (!rows.is_empty()).then(|| (analysis_seconds + rendering_seconds) / rows.len() as f64);
        record.warnings = made
            .iter()
            .flat_map(|group| group.warnings.clone())
            .collect();
        let files = made.into_iter().flat_map(|group| group.files);
        Ok(files.chain([GROUPS_FILE.to_owned()]).collect())
    }

    fn make_group(
        &self,
        interpolate: InterpolateGroup,
        group: &GroupFrames,
        progress: &dyn Progress,
    ) -> Result<GroupResult, ReconstructError> {
        let interpolated = interpolate(&self.group(group)?)?;
        let mut files = Vec::new();
        for (frame, image) in group.novel_views.iter().zip(&interpolated.images) {
            let file = view_file(NOVEL_FOLDER, *frame);
            RgbImage::write_png(image, &self.request.out.join(&file))?;
            files.push(file);
            progress.advance(1);
        }
        Ok(GroupResult {
            row: GroupRow {
                first_frame: group.context[0],
                last_frame: group.context[1],
                novel_views: group.novel_views.len(),
                gaussians: interpolated.gaussians,
                analysis_seconds: interpolated.analysis_seconds,
                rendering_seconds: interpolated.rendering_seconds,
            },
            files,
            warnings: interpolated.warnings,
        })
    }

    fn camera_pose(&self, frame: u32) -> Result<CameraPose, ReconstructError> {
        self.scene
            .frames
            .get(frame as usize)
            .and_then(|entry| CameraPose::new(entry.pose.as_ref()?, entry.time_seconds))
            .ok_or_else(|| {
                ReconstructError::scene(
                    &self.request.split,
                    format!("the scene has no usable pose for its frame {frame}"),
                )
            })
    }

    fn view(&self, frame: u32) -> Result<ContextView, ReconstructError> {
        let camera_pose = self.camera_pose(frame)?;
        let file = self
            .request
            .scene
            .with_file_name(&self.scene.frames[frame as usize].image);
        Ok(ContextView {
            frame,
            camera_pose,
            image: read_image(&file, self.scene, self.camera.into())?,
        })
    }

    fn group(&self, frames: &GroupFrames) -> Result<Group, ReconstructError> {
        Ok(Group {
            camera: self.camera,
            context: [self.view(frames.context[0])?, self.view(frames.context[1])?],
            targets: frames
                .novel_views
                .iter()
                .map(|&frame| self.camera_pose(frame))
                .collect::<Result<_, _>>()?,
        })
    }
}

struct GroupResult {
    row: GroupRow,
    files: Vec<String>,
    warnings: Vec<String>,
}
