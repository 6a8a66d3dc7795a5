//! Parts of a drive in the record of a scene: names, times and boxes of frames, distances of the LiDAR, and
//! `tracks.json`.

use std::{collections::BTreeMap, io, path::Path};

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use omnilife_schemas::{
    Pose,
    camera::Camera,
    elapsed::Elapsed,
    layout::DEPTH_PRIOR_FOLDER,
    records::{DepthPrior, Detection, DistanceConvention, Scene, TrackStage, Tracks},
    store::{self, StoreError},
};

use super::{Drive, objects, rig::OwnCamera};

/// Step of a distance in a file, metres.
const STEP_METRES: f64 = 1.0 / 256.0;
/// Distance from which on none is kept: 16 bits of steps, metres.
pub(super) const FARTHEST_METRES: f64 = 256.0;
/// Source of the distances in the record.
const LIDAR: &str = "LiDAR";

/// Parts of a frame that no other foreign frame has.
#[derive(Debug, Clone)]
pub(crate) struct DriveView {
    /// Name of its image in the scene.
    pub(crate) name: String,
    /// Seconds since the beginning of the sequence.
    pub(crate) seconds: f64,
    /// Width and height of its image, pixels.
    pub(crate) size: [usize; 2],
    /// Camera of its image, from which it is resampled to that of the scene; `None` if they are the same.
    pub(crate) own_camera: Option<OwnCamera>,
    /// Boxes of moving objects, by the ids of their tracks: left, top, width and height, pixels of the scene's camera.
    pub(crate) boxes: BTreeMap<String, [f64; 4]>,
    /// Steps of distance along the rays, by the pixel's number.
    pub(super) ranges: BTreeMap<u32, u16>,
}

impl DriveView {
    /// Takes distances along the rays, metres, by the pixel's number; returns how many are too large.
    pub(super) fn enter(&mut self, distances: BTreeMap<u32, f32>) -> usize {
        let all = distances.len();
        let near = distances
            .into_iter()
            .filter(|&(_, distance)| f64::from(distance) < FARTHEST_METRES);
        // The least step but 0, which stands for the unknown.
        let steps = near.map(|(pixel, distance)| {
            let steps = (f64::from(distance) / STEP_METRES).round();
            (pixel, steps.clamp(1.0, f64::from(u16::MAX)) as u16)
        });
        self.ranges = steps.collect();
        all.saturating_sub(self.ranges.len())
    }

    /// Writes the distances of the LiDAR, as a 16-bit grey PNG, into the folder of a scene with this camera. `name` is
    /// that of the frame's image there.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(crate) fn write_ranges(
        &self,
        camera: &Camera,
        name: &str,
        out: &Path,
    ) -> Result<Option<DepthPrior>, StoreError> {
        if self.ranges.is_empty() {
            return Ok(None);
        }
        let [columns, rows] = camera.size();
        let mut steps = vec![0_u16; columns.saturating_mul(rows)];
        for (&pixel, &range) in &self.ranges {
            if let Some(step) = steps.get_mut(pixel as usize) {
                *step = range;
            }
        }
        let bytes: Vec<u8> = steps.iter().flat_map(|step| step.to_ne_bytes()).collect();
        store::create_folder(&out.join(DEPTH_PRIOR_FOLDER))?;
        let file = format!("{DEPTH_PRIOR_FOLDER}/{}.png", super::stem(name));
        let (width, height) = (camera.width(), camera.height());
        store::write_with(&out.join(&file), |writer| {
            PngEncoder::new(writer)
                .write_image(&bytes, width, height, ExtendedColorType::L16)
                .map_err(io::Error::other)
        })?;
        Ok(Some(DepthPrior {
            file,
            unit: STEP_METRES,
            width,
            height,
            convention: DistanceConvention::Ray,
            source: LIDAR.to_owned(),
        }))
    }
}

impl Drive {
    /// Returns the parts of a frame by its image.
    pub(crate) fn view(&self, image: &Path) -> Option<&DriveView> {
        self.views.get(image)
    }

    /// Returns the record of the moving objects in a scene of the drive; `None` where none is labelled.
    pub(crate) fn tracks(&self, scene: &Scene) -> Option<Tracks> {
        if self.tracks.is_empty() {
            return None;
        }
        let frames = (0_u32..).zip(&scene.frames);
        let detections = frames.clone().flat_map(|(number, frame)| {
            self.tracks.iter().filter_map(move |track| {
                let box_pixels = *frame.boxes.get(&track.id.to_string())?;
                let centre = objects::box_at(track, frame.time_seconds)?.centre;
                Some(Detection {
                    frame: number,
                    box_pixels,
                    confidence: 1.0,
                    class: track.class.clone(),
                    distance: frame.pose.map(|pose| pose.centre().distance(centre)),
                    position: Some(centre.to_array()),
                    track: Some(track.id),
                })
            })
        });
        let posed = frames
            .clone()
            .filter(|(_, frame)| frame.pose.as_ref().is_some_and(Pose::is_valid));
        Some(Tracks {
            scene: scene.id.clone(),
            frames: posed.map(|(number, _)| number).collect(),
            image_size: [scene.camera.width(), scene.camera.height()],
            up: objects::UP.to_array(),
            metres_per_unit: 1.0,
            stages: vec![TrackStage {
                stage: Tracks::LABELS_STAGE.to_owned(),
                method: self.format.to_owned(),
                reason: format!("{} labelled objects move", self.tracks.len()),
                took: Elapsed::default(),
            }],
            detections: detections.collect(),
            tracks: self.tracks.clone(),
            warnings: self.notes.clone(),
        })
    }
}
