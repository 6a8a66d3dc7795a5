//! The clip of the method: frames with cameras, images and the masks of objects.

use std::collections::BTreeMap;

use glam::{DMat3, DVec2};
use omnilife_engine::{
    camera::{Camera, View},
    surfaces::plane::Ray,
    training_view::TrainingView,
    trajectories::rigid_spline::RigidPose,
};
use omnilife_schemas::camera::CameraModel;

use super::{
    graph::{Footage, FootageFrame},
    linked_masks::linked,
};
use omnilife_training::{error::ReconstructError, scene::TrainingScene};

/// Training frames of a clip.
#[derive(Debug, Clone)]
pub struct Clip {
    /// Size and model of all images.
    pub camera: Camera,
    /// In order of time.
    pub frames: Vec<ClipFrame>,
    /// Names of the objects.
    pub objects: Vec<String>,
    /// Clock from seconds to the time of splines.
    pub clock: UnitClock,
    /// Warnings for readers of the scores.
    pub warnings: Vec<String>,
}

/// Clock from seconds to [0, 1].
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct UnitClock {
    /// The time that is 0.
    pub begin_seconds: f64,
    /// The duration that becomes 1, seconds; positive.
    pub length_seconds: f64,
}

impl UnitClock {
    /// Returns the clock that starts at the earliest of some times and ends at the latest.
    pub fn of(times: impl Iterator<Item = f64> + Clone) -> Self {
        let begin_seconds = times.clone().fold(f64::INFINITY, f64::min);
        let length = times.fold(f64::NEG_INFINITY, f64::max) - begin_seconds;
        Self {
            begin_seconds,
            length_seconds: if length > 0.0 { length } else { 1.0 },
        }
    }

    /// Returns the time of splines.
    pub fn time(&self, seconds: f64) -> f64 {
        (seconds - self.begin_seconds) / self.length_seconds
    }
}

/// One frame.
#[derive(Debug, Clone)]
pub struct ClipFrame {
    /// Its number in the scene.
    pub number: u32,
    /// When it was taken, in [0, 1].
    pub time: f64,
    /// Camera to world, normalized units.
    pub pose: RigidPose,
    /// 8-bit RGB, row by row.
    pub pixels: Vec<u8>,
    /// Visible coverage of each pixel by each object, 255 for all of it; `None` where the object is not in the
    /// frame.
    pub masks: Vec<Option<Vec<u8>>>,
    /// Marks (not zero) the pixels outside the scene; `None` where every pixel belongs to it.
    pub ignored: Option<Vec<u8>>,
}

impl ClipFrame {
    /// Returns the colour of a pixel, [0, 1].
    pub fn colour(&self, pixel: usize) -> [f64; 3] {
        let bytes = &self.pixels[3 * pixel..3 * pixel + 3];
        [bytes[0], bytes[1], bytes[2]].map(|byte| f64::from(byte) / 255.0)
    }

    /// Returns the share of a pixel that an object covers, [0, 1].
    pub fn covered(&self, object: usize, pixel: usize) -> f64 {
        let mask = self.masks[object].as_ref();
        mask.map_or(0.0, |mask| f64::from(mask[pixel]) / 255.0)
    }

    /// Returns true if a pixel belongs to the scene.
    pub fn shows_scene(&self, pixel: usize) -> bool {
        (self.ignored.as_ref()).is_none_or(|ignored| ignored[pixel] == 0)
    }

    /// Returns true if an object covers at least half of a pixel.
    pub fn is_covered(&self, pixel: usize) -> bool {
        (0..self.masks.len()).any(|object| self.covered(object, pixel) >= 0.5)
    }
}

impl Clip {
    /// Makes a clip of the input views of a scene; objects are connected pieces of their masks.
    ///
    /// # Errors
    /// When the timestamps do not increase with the frames' numbers.
    pub fn of(scene: &TrainingScene) -> Result<Self, ReconstructError> {
        scene.clock()?;
        let camera = scene.inputs().camera;
        let all = scene.input_views.iter().chain(&scene.novel_views);
        let clock = UnitClock::of(all.map(|view| view.view.time_seconds));
        let mut views: Vec<_> = scene.input_views.iter().collect();
        views.sort_by_key(|view| view.frame);
        let mut pairs = views.iter().zip(views.iter().skip(1));
        let is_same = |pair: &(&&TrainingView, &&TrainingView)| {
            pair.0.view.time_seconds >= pair.1.view.time_seconds
        };
        if let Some((one, other)) = pairs.find(is_same) {
            return Err(ReconstructError::Request {
                reason: format!(
                    "{}: an atlas is of one camera, and its frames {} and {} are both at {} s",
                    scene.id, one.frame, other.frame, one.view.time_seconds
                ),
            });
        }
        let size = [camera.width() as usize, camera.height() as usize];
        let (objects, masks) = objects_of(scene, &views, size);
        let frames = views.iter().enumerate().map(|(number, view)| ClipFrame {
            number: view.frame,
            time: clock.time(view.view.time_seconds),
            pose: pose_of(&view.view),
            pixels: view.pixels.clone(),
            masks: masks.iter().map(|object| object[number].clone()).collect(),
            ignored: view.ignored.clone(),
        });
        Ok(Self {
            camera,
            frames: frames.collect(),
            objects,
            clock,
            warnings: Vec::new(),
        })
    }

    /// Returns the frames without their images.
    pub fn footage(&self) -> Footage {
        let frames = self.frames.iter().map(|frame| FootageFrame {
            number: frame.number,
            time: frame.time,
            pose: frame.pose,
        });
        Footage {
            camera: self.camera,
            frames: frames.collect(),
        }
    }

    /// Returns the columns and rows of pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.camera.width() as usize, self.camera.height() as usize]
    }

    /// Returns the number of pixels of a frame.
    pub fn pixel_count(&self) -> usize {
        let [width, height] = self.size();
        width * height
    }
}

/// Masks of an object, one for each frame; `None` where the object is not visible.
type ObjectMasks = Vec<Option<Vec<u8>>>;

/// Returns the names of objects and the masks of each in some views: those that the scene names, or connected
/// pieces of its masks.
fn objects_of(
    scene: &TrainingScene,
    views: &[&TrainingView],
    size: [usize; 2],
) -> (Vec<String>, Vec<ObjectMasks>) {
    if !scene.objects.is_empty() {
        let in_views = |masks: &BTreeMap<u32, Vec<u8>>| {
            let views = views.iter();
            views.map(|view| masks.get(&view.frame).cloned()).collect()
        };
        let names = scene.objects.keys().cloned().collect();
        return (names, scene.objects.values().map(in_views).collect());
    }
    let masks: Vec<Option<&[u8]>> = views.iter().map(|view| view.mask.as_deref()).collect();
    let objects = linked(&masks, size, scene.inputs().camera.wraps());
    let names = (1..=objects.len()).map(|number| format!("{number:02}"));
    (names.collect(), objects)
}

/// Returns the pose of a view, camera to world.
pub fn pose_of(view: &View) -> RigidPose {
    RigidPose {
        centre: view.centre.as_dvec3(),
        rotation: DMat3::from_quat(
            glam::DQuat::from_mat3(&view.rotation.as_dmat3().transpose()).normalize(),
        ),
    }
}

/// Returns the unit direction of a position in the image, in the camera's frame.
pub fn camera_direction(camera: &Camera, place: DVec2) -> glam::DVec3 {
    match camera {
        Camera::Erp(camera) => camera.unproject(place),
        Camera::Pinhole(camera) => camera.unproject(place),
    }
    .normalize()
}

/// Returns the position in the image of a point of the camera's frame, pixels.
pub fn project(camera: &Camera, point: glam::DVec3) -> Option<DVec2> {
    match camera {
        Camera::Erp(camera) => camera.project(point),
        Camera::Pinhole(camera) => camera.project(point),
    }
}

/// Returns the position of a pixel's centre.
pub fn pixel_centre(pixel: usize, width: usize) -> DVec2 {
    DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5)
}

/// Returns the ray of a position in the image from a camera's pose.
pub fn ray_of(pose: &RigidPose, direction: glam::DVec3) -> Ray {
    Ray {
        origin: pose.centre,
        direction: pose.rotation * direction,
    }
}
