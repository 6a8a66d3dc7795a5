//! Posed frames of a scene, for measuring geometry.

use std::path::Path;

use glam::{DMat3, DVec2, DVec3};

use crate::{
    camera::{Camera, CameraModel},
    pose::Pose,
    records::{Scene, Split},
    store::{self, StoreError},
};

/// Returns the frames of a scene that may be used: the input views of a split, all if `None`.
///
/// # Errors
/// When the split cannot be read or belongs to another scene.
pub fn frames_of(scene: &Scene, split: Option<&Path>) -> Result<Vec<u32>, StoreError> {
    let Some(file) = split else {
        return Ok((0..scene.frames.len() as u32).collect());
    };
    let split: Split = store::read_record(file)?;
    if split.scene != scene.id {
        let reason = format!("is the split of {}, not of {}", split.scene, scene.id);
        return Err(StoreError::malformed(file, reason));
    }
    Ok(split.input_views)
}

/// Posed frame of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosedView {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// Presentation timestamp in seconds.
    pub seconds: f64,
    /// Size and model of its image.
    pub camera: Camera,
    /// Rotation from the camera to the world.
    pub to_world: DMat3,
    /// Centre of the camera.
    pub centre: DVec3,
}

impl PosedView {
    /// Returns the posed frames among some of a scene, in order of time.
    pub fn of_scene(scene: &Scene, frames: &[u32]) -> Vec<Self> {
        let mut views: Vec<Self> = frames
            .iter()
            .filter_map(|&frame| {
                let entry = scene.frames.get(frame as usize)?;
                let pose = entry.pose.filter(Pose::is_valid)?;
                Some(Self {
                    frame,
                    seconds: entry.time_seconds,
                    camera: scene.camera,
                    to_world: DMat3::from_quat(pose.rotation()?),
                    centre: pose.centre(),
                })
            })
            .collect();
        views.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        views
    }

    /// Returns a point of the world in the camera's frame.
    pub fn in_camera(&self, world: DVec3) -> DVec3 {
        self.to_world.transpose() * (world - self.centre)
    }

    /// Returns the pixel of a point of the world; `None` if it is not visible, for example outside of the image.
    pub fn pixel(&self, world: DVec3) -> Option<DVec2> {
        let pixel = self.camera.project(self.in_camera(world))?;
        let [width, height] = self.camera.size().map(|side| side as f64);
        let is_inside = (0.0..width).contains(&pixel.x) && (0.0..height).contains(&pixel.y);
        is_inside.then_some(pixel)
    }

    /// Returns the unit direction of a pixel in the world.
    pub fn ray(&self, pixel: DVec2) -> DVec3 {
        self.to_world * self.camera.unproject(pixel)
    }

    /// Returns the change of a pixel's ray along columns and along rows, radians per pixel, world.
    pub fn ray_steps(&self, pixel: DVec2) -> [DVec3; 2] {
        [DVec2::X, DVec2::Y].map(|axis| self.ray(pixel + 0.5 * axis) - self.ray(pixel - 0.5 * axis))
    }
}
