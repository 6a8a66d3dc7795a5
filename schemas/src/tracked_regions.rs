//! Dynamic regions of a scene without masks: the projections of the boxes of its tracks.

use std::path::Path;

use glam::{DMat3, DVec3};

use crate::{
    camera::Camera,
    mask::Mask,
    object_regions::Region,
    oriented_box::OrientedBox,
    records::{Scene, SceneFrame, Track, Tracks},
    store::{self, StoreError},
    trajectory::GroundAxes,
};

/// Boxes of the tracks beside a split. They are estimates: a box is larger than its vehicle and as far off as its
/// path is, and occlusion is ignored.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedRegions {
    axes: GroundAxes,
    tracks: Vec<Track>,
    /// SHA-256 of the boxes and their paths; scores by region are comparable where it is equal.
    pub sha256: String,
}

impl TrackedRegions {
    /// Returns the boxes of a scene for a split in `split_folder`; `None` where the scene has masks or objects of its
    /// own, or nothing was tracked.
    ///
    /// # Errors
    /// When the tracks cannot be read, are unsound or those of another scene.
    pub fn find(scene: &Scene, split_folder: &Path) -> Result<Option<Self>, StoreError> {
        let mut frames = scene.frames.iter();
        if frames.any(|frame| Region::Moving.source(scene, frame).is_some()) {
            return Ok(None);
        }
        let Some(tracks) = Tracks::beside_split(&scene.id, split_folder)? else {
            return Ok(None);
        };
        let content = serde_json::json!([tracks.up, tracks.tracks]).to_string();
        Ok(Some(Self {
            axes: GroundAxes::new(DVec3::from_array(tracks.up)),
            tracks: tracks.tracks,
            sha256: store::sha256_bytes(content.as_bytes()),
        }))
    }

    /// Returns the dynamic mask of a frame at the size of a camera; `None` where the frame has no pose.
    pub fn mask(&self, camera: &Camera, frame: &SceneFrame) -> Option<Mask> {
        let pose = frame.pose.filter(crate::Pose::is_valid)?;
        let to_world = DMat3::from_quat(pose.rotation()?);
        let [width, height] = camera.size();
        let mut mask = Mask::new(width, height, vec![0; width * height]);
        for track in &self.tracks {
            let Some((centre, heading)) = track.path.at(frame.time_seconds) else {
                continue;
            };
            let of_track = OrientedBox {
                centre,
                axes: self.axes.rotation(heading),
                half: 0.5 * DVec3::from_array(track.dimensions),
            };
            of_track
                .in_camera(to_world, pose.centre())
                .mark(camera, &mut mask);
        }
        Some(mask)
    }
}
