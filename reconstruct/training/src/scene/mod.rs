//! A scene in memory: normalized cameras, images and points of one split.

pub mod depth;
pub mod images;
mod mask_notes;
pub mod mask_pieces;
mod normalization;

use std::{collections::BTreeMap, path::Path};

use glam::{DVec3, Vec3};
use omnilife_schemas::{
    Similarity,
    camera::Camera,
    points::PointCloud,
    records::{Scale, Scene, Split, Tracks},
    rgb::Mask,
    scene_points::ScenePoints,
    split_rules,
    statistics::median,
    store,
};
use rayon::prelude::*;

use self::{
    depth::PriorFile,
    images::{load_objects, load_view},
    normalization::{any_point_away_from_cameras, normalization, normalized},
};
pub use self::{mask_notes::mask_notes, normalization::CameraExtent};
use crate::error::ReconstructError;
use omnilife_engine::camera::View;
use omnilife_engine::clock::Clock;
use omnilife_engine::training_view::InputViews;
use omnilife_engine::training_view::TrainingView;

/// A scene ready for training: cameras are recentred and scaled so that the farthest one that counts
/// ([`CameraExtent`]) is one unit from their mean.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingScene {
    /// Id of the scene.
    pub id: String,
    /// Size and model of all images.
    pub camera: Camera,
    /// Views to train on.
    pub input_views: Vec<TrainingView>,
    /// Views to predict. Their images are for the trace alone.
    pub novel_views: Vec<TrainingView>,
    /// World to normalized coordinates.
    pub normalization: Similarity,
    /// Unit of the world.
    pub scale: Scale,
    /// True if the cameras stand too close together to determine the scene's scale.
    pub is_normalized_by_points: bool,
    /// Points in normalized coordinates with their colours; may be empty.
    pub points: PointCloud<f32>,
    /// Number of added points, the last ones.
    pub added_points: usize,
    /// Warning for readers of the scores if the points were made with held-out views.
    pub seen_for_points: Option<String>,
    /// Depth priors of the input views, in their order; empty if no view has any.
    pub depth_priors: Vec<Option<PriorFile>>,
    /// Depth priors of the novel views. No method sees them: the trace measures holes there.
    pub novel_depth_priors: Vec<Option<PriorFile>>,
    /// Masks of single objects in the input views, by the object's name and the frame: covered share of each
    /// pixel, 255 for all of it.
    pub objects: BTreeMap<String, BTreeMap<u32, Vec<u8>>>,
    /// Moving objects, world, if `tracks.json` beside the split lists them.
    pub tracks: Option<Tracks>,
}

impl TrainingScene {
    /// Makes a scene of input views alone, of arbitrary scale.
    pub fn new(
        id: &str,
        camera: Camera,
        input_views: Vec<TrainingView>,
        normalization: Similarity,
    ) -> Self {
        Self {
            id: id.to_owned(),
            camera,
            input_views,
            novel_views: Vec::new(),
            normalization,
            scale: Scale::Arbitrary,
            is_normalized_by_points: false,
            points: PointCloud::default(),
            added_points: 0,
            seen_for_points: None,
            depth_priors: Vec::new(),
            novel_depth_priors: Vec::new(),
            objects: BTreeMap::new(),
            tracks: None,
        }
    }

    /// Loads `scene.json` and `split.json`; `extent` selects the cameras of the normalization. Larger images are
    /// resized to the protocol's width by area averaging.
    ///
    /// # Errors
    /// When a file is missing or malformed, a split's frame has no pose, image sizes differ from
    /// the scene's camera, or no input view is left.
    pub fn load(
        scene_path: &Path,
        split_path: &Path,
        extent: CameraExtent,
    ) -> Result<Self, ReconstructError> {
        let scene: Scene = store::read_record(scene_path)?;
        let split: Split = store::read_record(split_path)?;
        let folder = scene_path.parent().unwrap_or(Path::new("."));
        let camera = checked_camera(&scene, &split, split_path)?;
        let centres: Vec<DVec3> = split
            .input_views
            .iter()
            .filter_map(|&frame| Some(scene.frames.get(frame as usize)?.pose?.centre()))
            .collect();
        let cameras = extent.similarity(&centres).ok_or_else(|| {
            ReconstructError::scene(split_path, "has no input view with a usable pose")
        })?;
        let split_folder = split_path.parent().unwrap_or(Path::new("."));
        let known = ScenePoints::find(&scene, folder, split_folder)?;
        let world_points = match &known {
            Some(known) => PointCloud::read_ply(&known.file)?,
            None => PointCloud::default(),
        };
        let normalization = normalization(cameras, &world_points);
        let points = normalized(world_points, &normalization);
        if !points.is_empty() && !any_point_away_from_cameras(&points, &normalization, &centres) {
            return Err(ReconstructError::scene(
                scene_path,
                format!(
                    "all of its {} points are where the cameras are; none can be seen",
                    points.len()
                ),
            ));
        }
        let load = |frames: &[u32]| -> Result<Vec<TrainingView>, ReconstructError> {
            frames
                .par_iter()
                .map(|&frame| load_view(&scene, scene_path, folder, camera, &normalization, frame))
                .collect()
        };
        let input_views = load(&split.input_views)?;
        Ok(Self {
            id: scene.id.clone(),
            camera,
            objects: load_objects(&scene, folder, camera, &input_views)?,
            input_views,
            novel_views: load(&split.novel_views)?,
            is_normalized_by_points: normalization != cameras,
            normalization,
            scale: scene.scale,
            points,
            added_points: 0,
            seen_for_points: known.and_then(|known| known.held_out(&split.novel_views)),
            depth_priors: depth_priors(&scene, folder, &split.input_views),
            novel_depth_priors: depth_priors(&scene, folder, &split.novel_views),
            tracks: Tracks::beside_split(&scene.id, split_folder)?,
        })
    }

    /// Returns the mean marked share of the input views' masks, over the sphere or, for a pinhole, over the
    /// image. Rows of ERP images are weighted by the cosine of their latitude. `None` when no input view has a
    /// mask.
    pub fn mask_coverage(&self) -> Option<f64> {
        let [width, height] = self.camera.size();
        let weight = |row: usize| match self.camera {
            Camera::Erp(_) => {
                let latitude = (0.5 - (row as f64 + 0.5) / height as f64) * std::f64::consts::PI;
                latitude.cos()
            }
            Camera::Pinhole(_) => 1.0,
        };
        let (mut marked, mut all) = (0.0, 0.0);
        for mask in self
            .input_views
            .iter()
            .filter_map(|view| view.mask.as_ref())
        {
            for (row, pixels) in mask.chunks(width).enumerate() {
                let sum: u64 = pixels.iter().map(|&byte| u64::from(byte)).sum();
                marked += weight(row) * sum as f64 / 255.0;
                all += weight(row) * width as f64;
            }
        }
        (all > 0.0).then(|| marked / all)
    }

    /// Returns the share of the input views' pixels with a saturated channel, 0 to 1, outside of ignored regions.
    pub fn saturated_share(&self) -> f64 {
        let (mut saturated, mut all) = (0_u64, 0_u64);
        for view in &self.input_views {
            for (pixel, rgb) in view.pixels.as_chunks::<3>().0.iter().enumerate() {
                if view.shows_scene(pixel) {
                    saturated += u64::from(rgb.contains(&u8::MAX));
                    all += 1;
                }
            }
        }
        saturated as f64 / all.max(1) as f64
    }

    /// Keeps the scene's own points.
    pub(crate) fn leave_added_points_out(&mut self) {
        let given = self.points.len() - self.added_points;
        self.points.positions.truncate(given);
        self.points.colours.truncate(given);
        self.added_points = 0;
    }

    /// Returns the scene with images and masks averaged over whole squares of pixels: at the minimum width of at
    /// least `least_width`.
    pub fn reduced(&self, least_width: u32) -> Self {
        let (width, height) = (self.camera.width(), self.camera.height());
        let fits = |factor: &u32| width.is_multiple_of(*factor) && height.is_multiple_of(*factor);
        let factor = (1..=width / least_width.max(1))
            .rev()
            .find(fits)
            .unwrap_or(1);
        let camera = self.camera.resized(width / factor, height / factor);
        let (width, factor) = (width as usize, factor as usize);
        let reduce = |view: &TrainingView| TrainingView {
            frame: view.frame,
            view: View {
                camera,
                ..view.view
            },
            pixels: averaged::<3>(&view.pixels, width, factor),
            mask: view
                .mask
                .as_ref()
                .map(|mask| averaged::<1>(mask, width, factor)),
            ignored: view
                .ignored
                .as_ref()
                .map(|ignored| marked_in_any(ignored, width, factor)),
        };
        Self {
            id: self.id.clone(),
            camera,
            input_views: self.input_views.iter().map(reduce).collect(),
            novel_views: self.novel_views.iter().map(reduce).collect(),
            normalization: self.normalization,
            scale: self.scale,
            is_normalized_by_points: self.is_normalized_by_points,
            points: self.points.clone(),
            added_points: self.added_points,
            seen_for_points: self.seen_for_points.clone(),
            depth_priors: self.depth_priors.clone(),
            novel_depth_priors: self.novel_depth_priors.clone(),
            objects: self
                .objects
                .iter()
                .map(|(name, masks)| {
                    let masks = masks.iter();
                    let reduced =
                        masks.map(|(&frame, mask)| (frame, averaged::<1>(mask, width, factor)));
                    (name.clone(), reduced.collect())
                })
                .collect(),
            tracks: self.tracks.clone(),
        }
    }

    /// Returns the clock of a scene's views, input and novel ones.
    ///
    /// # Errors
    /// When the timestamps decrease with the frames' numbers. Cameras of a rig have the same ones.
    pub fn clock(&self) -> Result<Clock, ReconstructError> {
        let mut times: Vec<(u32, f64)> = self
            .input_views
            .iter()
            .chain(&self.novel_views)
            .map(|view| (view.frame, view.view.time_seconds))
            .collect();
        times.sort_by_key(|&(frame, _)| frame);
        // Cameras of a rig have the same time. NaN has no order.
        let is_earlier = |pair: &&[(u32, f64)]| {
            pair[1]
                .1
                .partial_cmp(&pair[0].1)
                .is_none_or(std::cmp::Ordering::is_lt)
        };
        if let Some(pair) = times.windows(2).find(is_earlier) {
            return Err(ReconstructError::Request {
                reason: format!(
                    "{}: frame {} is at {} s, frame {} before it at {} s: time must not decrease \
                     from frame to frame",
                    self.id, pair[1].0, pair[1].1, pair[0].0, pair[0].1
                ),
            });
        }
        let mut times: Vec<f64> = times.into_iter().map(|(_, time)| time).collect();
        times.dedup();
        Ok(Clock::from_times(&times))
    }

    /// Returns the frames from an input view to the next one. Half of the time between the first and the last
    /// lies in gaps of at least this length. 1 without gaps.
    pub fn input_gap_frames(&self, clock: &Clock) -> f32 {
        let frames = self
            .input_views
            .iter()
            .map(|view| clock.frame(view.view.time_seconds));
        gap_of_half_the_time(frames.collect()).unwrap_or(1.0) as f32
    }

    /// Returns a warning for readers of the scores if tracks were made with held-out views.
    pub fn held_out_tracks(&self) -> Option<String> {
        let tracks = self.tracks.as_ref()?;
        let held_out = self
            .novel_views
            .iter()
            .filter(|view| tracks.frames.contains(&view.frame));
        let held_out = held_out.count();
        (held_out > 0).then(|| {
            format!("the tracks were made with {held_out} of the views that are held out: novel views have seen them")
        })
    }

    /// Returns the training inputs of the input views.
    pub fn inputs(&self) -> InputViews<'_> {
        InputViews {
            camera: self.camera,
            views: &self.input_views,
        }
    }

    /// Returns the median distance between consecutive input views, in normalized units; 0 for a camera that does
    /// not move.
    pub fn median_camera_step(&self) -> f32 {
        let pairs = self.input_views.windows(2);
        let steps: Vec<f32> = pairs
            .map(|pair| pair[0].view.centre.distance(pair[1].view.centre))
            .collect();
        median(&steps).unwrap_or(0.0)
    }

    /// Returns the median distance of the points from the mean camera, in normalized units; 0 without points.
    pub fn median_point_distance(&self) -> f32 {
        let positions = self.points.positions.iter();
        let distances: Vec<f32> = positions
            .map(|&position| Vec3::from_array(position).length())
            .collect();
        median(&distances).unwrap_or(0.0)
    }
}

fn depth_priors(scene: &Scene, folder: &Path, frames: &[u32]) -> Vec<Option<PriorFile>> {
    let of_frame = |&frame: &u32| {
        let prior = scene.frames.get(frame as usize)?.depth_prior.clone()?;
        let path = folder.join(&prior.file);
        Some(PriorFile { path, prior })
    };
    let priors: Vec<Option<PriorFile>> = frames.iter().map(of_frame).collect();
    if priors.iter().all(Option::is_none) {
        return Vec::new();
    }
    priors
}

/// Returns means over squares of `factor` pixels of an image with `C` channels.
fn averaged<const C: usize>(pixels: &[u8], width: usize, factor: usize) -> Vec<u8> {
    let rows = pixels.len() / (width * C);
    let mut means = Vec::with_capacity(pixels.len() / (factor * factor));
    for row in 0..rows / factor {
        for column in 0..width / factor {
            for channel in 0..C {
                let sum: usize = (0..factor * factor)
                    .map(|at| {
                        let (y, x) = (row * factor + at / factor, column * factor + at % factor);
                        usize::from(pixels[(y * width + x) * C + channel])
                    })
                    .sum();
                means.push(((sum + factor * factor / 2) / (factor * factor)) as u8);
            }
        }
    }
    means
}

/// Marks each square of `factor` pixels of a mask with a marked pixel.
fn marked_in_any(marks: &[u8], width: usize, factor: usize) -> Vec<u8> {
    let mask = Mask::new(width, marks.len() / width, marks.to_vec());
    mask.resized_to_any(width / factor, mask.height / factor)
        .data
}

/// Returns the camera of a method's images, after a check that the split is the one of its protocol for this
/// scene.
///
/// # Errors
/// When the split is another one, or its protocol has no size for the scene's camera.
pub fn checked_camera(
    scene: &Scene,
    split: &Split,
    split_path: &Path,
) -> Result<Camera, ReconstructError> {
    // An edited split would provide views that are scored as held out.
    split_rules::check(split, scene)
        .map_err(|reason| ReconstructError::scene(split_path, reason))?;
    let [width, height] = split
        .protocol
        .scored_size(&scene.camera)
        .map_err(|reason| ReconstructError::scene(split_path, reason))?;
    Ok(scene.camera.resized(width, height))
}

/// Returns the longest gap between moments such that half of the time between the first and the last lies in gaps
/// of at least this length.
fn gap_of_half_the_time(mut moments: Vec<f64>) -> Option<f64> {
    moments.sort_by(f64::total_cmp);
    let mut gaps: Vec<f64> = moments.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(|a, b| b.total_cmp(a));
    let half = 0.5 * gaps.iter().sum::<f64>();
    let mut covered = 0.0;
    gaps.into_iter().find(|gap| {
        covered += gap;
        covered >= half
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gap_is_that_in_which_half_of_the_time_lies() {
        for (frames, expected) in [
            // Every fifth frame is left out; the first and the last of ten are inputs; one long hole alone.
            (&[0, 1, 2, 3, 5, 6, 7, 8, 10][..], Some(1.0)),
            (&[20, 0, 9, 10, 19], Some(9.0)),
            (&[0, 1, 2, 3, 4, 5, 6, 7, 8, 13], Some(1.0)),
            (&[3], None),
            (&[], None),
        ] {
            let moments = frames.iter().map(|&frame| f64::from(frame)).collect();
            assert_eq!(gap_of_half_the_time(moments), expected, "{frames:?}");
        }
    }
}
