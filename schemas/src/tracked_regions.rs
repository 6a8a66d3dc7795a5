//! Dynamic regions of a scene without masks: the projections of the boxes of its tracks.

use std::path::Path;

use glam::{DMat3, DVec3};

use crate::{
    camera::Camera,
    mask::Mask,
    oriented_box::OrientedBox,
    records::{Scene, SceneFrame, Track, Tracks},
    store::{self, StoreError},
    trajectory::GroundAxes,
};

/// The boxes of the tracks beside a split. They are found, not true: a box is larger than its vehicle and as
/// far off as its path is, and nothing hides it.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedRegions {
    axes: GroundAxes,
    tracks: Vec<Track>,
    /// SHA-256 of the boxes and their paths: what scores by region can be compared by.
    pub sha256: String,
}

impl TrackedRegions {
    /// Those of a scene for a split in `split_folder`; `None` where the scene has masks of its own, or nothing
    /// was tracked.
    ///
    /// # Errors
    /// When the tracks cannot be read, are unsound or those of another scene.
    pub fn find(scene: &Scene, split_folder: &Path) -> Result<Option<Self>, StoreError> {
        if scene.frames.iter().any(|frame| frame.mask.is_some()) {
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

    /// The mask of what moves in a frame, as a camera of some size has it; `None` where the frame has no pose.
    pub fn mask(&self, camera: &Camera, frame: &SceneFrame) -> Option<Mask> {
        let pose = frame.pose.filter(crate::Pose::is_valid)?;
        let to_world = DMat3::from_quat(pose.rotation()?);
        let [width, height] = camera.size();
        let mut mask = Mask {
            width,
            height,
            data: vec![0; width * height],
        };
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
