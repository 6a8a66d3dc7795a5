//! Drives: calibrated sequences of several cameras with LiDAR and labelled 3D boxes. They are read and not written.
//!
//! All cameras of the rig are in one scene and have one camera there: images of others are resampled. The world is
//! upright (z up), in metres. Of the labels, moving objects are taken: records and boxes in the images, and paths in
//! `tracks.json`. Distances of the LiDAR are sparse estimates along the rays. A folder stands for one sequence and all
//! its colour cameras; `FOLDER/SEQUENCE` and `FOLDER/SEQUENCE/CAMERA+CAMERA`, which need not exist, name others.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

mod choice;
pub mod kitti;
mod lidar;
pub mod nuscenes;
mod objects;
mod record;
mod rig;
mod rigid;
mod table;
pub mod waymo;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use glam::DMat3;
use omnilife_schemas::{
    Pose,
    camera::PinholeCamera,
    oriented_box::OrientedBox,
    records::{Scale, SceneObject, Track},
};

pub(super) use rig::{OwnCamera, resampled};

use self::{
    lidar::{StaticPoints, SweepView},
    objects::{LabelledObject, MovingObjects},
    record::DriveView,
    rigid::Rigid,
};
use super::{ForeignFrame, ForeignScene, file_name, left_out, stem};
use crate::{error::CurateError, poses::frame_camera::FrameCamera};

/// Parts of a drive that no other foreign scene has.
#[derive(Debug, Clone)]
pub(crate) struct Drive {
    /// Name of the layout.
    format: &'static str,
    /// Its frames by their images.
    views: BTreeMap<PathBuf, DriveView>,
    /// Paths of moving objects; empty without labels.
    tracks: Vec<Track>,
    /// Lines on labels that were left out.
    notes: Vec<String>,
}

/// A drive as its layout states it.
struct Layout<'a> {
    format: &'static str,
    root: &'a Path,
    cameras: Vec<RigCamera>,
    images: Vec<RigImage>,
    sweeps: Vec<Sweep>,
    objects: Vec<LabelledObject>,
    /// Seconds by which images may lie outside of their labels' times.
    label_reach_seconds: f64,
    missing_images: Vec<String>,
    notes: Vec<String>,
}

struct RigCamera {
    name: String,
    camera: OwnCamera,
}

struct RigImage {
    file: PathBuf,
    camera: usize,
    pose: Pose,
    seconds: f64,
    /// Images and sweeps of a moment have the same number.
    moment: u64,
}

struct Sweep {
    file: PathBuf,
    to_world: Rigid,
    seconds: f64,
    moment: u64,
    /// Floats of every point.
    values: usize,
}

impl Layout<'_> {
    /// Makes a scene of the drive.
    ///
    /// # Errors
    /// When it has no camera, an image or a sweep cannot be read, or the path of an object overflows.
    fn scene(self) -> Result<ForeignScene, CurateError> {
        let cameras: Vec<PinholeCamera> = (self.cameras.iter())
            .map(|one| one.camera.straight)
            .collect();
        let common = (rig::common_camera(&cameras))
            .ok_or_else(|| CurateError::input(self.root, "must have a camera, got none"))?;
        let mut moving = MovingObjects::of(&self.objects, self.label_reach_seconds);
        let seconds: Vec<f64> = self.images.iter().map(|image| image.seconds).collect();
        moving.note_gaps(&seconds, self.label_reach_seconds);
        for track in &moving.tracks {
            if let Some(fault) = track.path.fault() {
                let reason = format!("must have sound labels, and track {} {fault}", track.id);
                return Err(CurateError::input(self.root, reason));
            }
        }
        let mut views = BTreeMap::new();
        for image in &self.images {
            let view = self.view(image, common, &moving.tracks)?;
            views.insert(image.file.clone(), view);
        }
        let mut points = StaticPoints::default();
        let mut far = 0_usize;
        for sweep in &self.sweeps {
            for (file, seen) in self.swept(sweep, common, &moving.tracks, &mut points)? {
                if let Some(view) = views.get_mut(&file) {
                    far = far.saturating_add(view.enter(seen.distances));
                }
            }
        }
        let mut notes = self.notes;
        let has_sweeps = !self.sweeps.is_empty();
        notes.extend(has_sweeps.then(|| "reflectance of the LiDAR is left out".to_owned()));
        notes.extend(points.note());
        notes.extend((far > 0).then(|| {
            format!(
                "distances of {} m and more, left out of the images: {far}",
                record::FARTHEST_METRES
            )
        }));
        notes.extend(resampling_notes(&self.cameras, &common));
        notes.extend(missing_notes(&self.cameras, &self.images));
        notes.push(
            "points, their colours and boxes are those of all frames, also of frames that a split keeps for scoring"
                .to_owned(),
        );
        notes.extend(moving.notes.iter().cloned());
        let frames = self.images.iter().map(|image| ForeignFrame {
            image: image.file.clone(),
            mask: None,
            objects: BTreeMap::new(),
            pose: Some(image.pose),
            distance: None,
            moment: None,
        });
        let objects = moving.classes.iter();
        Ok(ForeignScene {
            scale: Scale::Metres,
            points: points.cloud,
            missing_images: self.missing_images,
            objects: objects
                .map(|&(id, class)| (id.to_string(), SceneObject { class }))
                .collect(),
            drive: Some(Drive {
                format: self.format,
                views,
                tracks: moving.tracks,
                notes: moving.notes,
            }),
            notes,
            ..ForeignScene::new(
                FrameCamera::Straight(common.into()),
                frames.collect(),
                self.root,
            )
        })
    }

    fn camera_of(&self, image: &RigImage) -> Result<&RigCamera, CurateError> {
        let camera = self.cameras.get(image.camera);
        camera.ok_or_else(|| CurateError::input(&image.file, "must be of a camera of the rig"))
    }

    /// Returns the parts of a frame that its labels give.
    fn view(
        &self,
        image: &RigImage,
        common: PinholeCamera,
        tracks: &[Track],
    ) -> Result<DriveView, CurateError> {
        let RigCamera { name, camera } = self.camera_of(image)?;
        let (to_world, centre) = axes_of(image)?;
        let boxes = tracks.iter().filter_map(|track| {
            let of_track = objects::box_at(track, image.seconds)?;
            // What the image shows, not what the wider camera of the scene would.
            let of_image =
                objects::projected(&of_track.in_camera(to_world, centre), &camera.straight)?;
            let shown = rig::moved_box(of_image, &camera.straight, &common)?;
            Some((track.id.to_string(), shown))
        });
        let own = file_name(&image.file.to_string_lossy());
        let is_kept = *camera == OwnCamera::from(common);
        let extension = if is_kept {
            own.rsplit('.').next()
        } else {
            None
        };
        Ok(DriveView {
            name: format!("{name}_{}.{}", stem(&own), extension.unwrap_or("png")),
            seconds: image.seconds,
            size: camera.size(),
            own_camera: (!is_kept).then_some(*camera),
            boxes: boxes.collect(),
            ranges: BTreeMap::new(),
        })
    }

    /// Adds the points of a sweep to those of the scene; returns the images of its moment with their distances.
    fn swept(
        &self,
        sweep: &Sweep,
        common: PinholeCamera,
        tracks: &[Track],
        points: &mut StaticPoints,
    ) -> Result<Vec<(PathBuf, SweepView)>, CurateError> {
        let (mut files, mut seen) = (Vec::new(), Vec::new());
        for image in self.images.iter().filter(|one| one.moment == sweep.moment) {
            let own = self.camera_of(image)?.camera;
            seen.push(SweepView::open(
                &image.file,
                (own, common),
                axes_of(image)?,
                boxes_at(tracks, image.seconds),
            )?);
            files.push(image.file.clone());
        }
        let of_sensor = lidar::read(&sweep.file, sweep.values)?.into_iter();
        let boxes = boxes_at(tracks, sweep.seconds);
        points.add(
            of_sensor.map(|point| sweep.to_world.apply(point)),
            &boxes,
            &mut seen,
        );
        Ok(files.into_iter().zip(seen).collect())
    }
}

/// Returns the box of each track at a time; `None` outside of its path.
fn boxes_at(tracks: &[Track], seconds: f64) -> Vec<Option<OrientedBox>> {
    let boxes = tracks.iter().map(|track| objects::box_at(track, seconds));
    boxes.collect()
}

/// Returns the rotation of an image's camera to the world, and its centre.
fn axes_of(image: &RigImage) -> Result<(DMat3, glam::DVec3), CurateError> {
    let rotation = image.pose.rotation().ok_or_else(|| {
        CurateError::input(
            &image.file,
            "must have a pose of finite numbers, got others",
        )
    })?;
    Ok((DMat3::from_quat(rotation), image.pose.centre()))
}

/// Returns a line on every camera whose images are resampled.
fn resampling_notes(cameras: &[RigCamera], common: &PinholeCamera) -> Vec<String> {
    let resampled = (cameras.iter()).filter(|one| one.camera.straight != *common);
    resampled
        .map(|RigCamera { name, camera }| {
            let camera = camera.straight;
            format!(
                "{name} is resampled to the camera of the scene, {:.1} instead of {:.1} pixels of focal length: {:.0} % \
                 of its resolution; a sequence of this camera alone keeps all",
                common.fx,
                camera.fx,
                100.0 * common.fx / camera.fx
            )
        })
        .collect()
}

/// Returns a line on every camera without an image at a moment that has one of another camera.
fn missing_notes(cameras: &[RigCamera], images: &[RigImage]) -> Vec<String> {
    let moments: BTreeSet<u64> = images.iter().map(|image| image.moment).collect();
    let lines = cameras.iter().enumerate().filter_map(|(number, camera)| {
        let own = images.iter().filter(|image| image.camera == number);
        let own: BTreeSet<u64> = own.map(|image| image.moment).collect();
        let missing: Vec<String> = moments.difference(&own).map(u64::to_string).collect();
        left_out::line(
            &missing,
            &format!("moments without an image of {}", camera.name),
        )
    });
    lines.collect()
}

/// Returns a line on layout parts that are there and not read.
fn parts_left_out(root: &Path, parts: &[(&str, &str)]) -> Vec<String> {
    let there = parts.iter().filter(|(name, _)| root.join(name).exists());
    let names: Vec<String> = there
        .map(|(name, what)| format!("{name}: {what}"))
        .collect();
    left_out::line(&names, "parts that are not read")
        .into_iter()
        .collect()
}
