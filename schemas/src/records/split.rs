//! `split`: the frames of one scene under one protocol.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Scene, protocol::Protocol};
use crate::{camera::Camera, plain_text, store::Record};

/// `split.json`. Frame numbers count the scene's frames from 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Split {
    /// Id of the scene.
    pub scene: String,
    /// The protocol, whole.
    pub protocol: Protocol,
    /// Its hash.
    pub protocol_hash: String,
    /// Frames a method may use.
    pub input_views: Vec<u32>,
    /// Frames a method must predict.
    pub novel_views: Vec<u32>,
    /// Frames left out because they have no pose.
    pub unposed: Vec<u32>,
    /// The groups of a protocol that has groups, in order of time.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub groups: Vec<ViewGroup>,
    /// Groups left out because they are not complete.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub incomplete: Vec<IncompleteGroup>,
}

/// Frames that a method sees together, and the frames that it predicts from them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ViewGroup {
    /// Given.
    pub context: Vec<u32>,
    /// Predicted.
    pub novel_views: Vec<u32>,
}

/// A group that is left out.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct IncompleteGroup {
    /// Its frames.
    pub frames: Vec<u32>,
    /// Reason why it is left out.
    pub reason: String,
}

impl Split {
    /// Makes the split of a scene into these frames under a protocol without groups.
    pub fn new(
        scene: &str,
        protocol: Protocol,
        input_views: Vec<u32>,
        novel_views: Vec<u32>,
    ) -> Self {
        Self {
            scene: scene.to_owned(),
            protocol_hash: protocol.hash(),
            protocol,
            input_views,
            novel_views,
            unposed: Vec::new(),
            groups: Vec::new(),
            incomplete: Vec::new(),
        }
    }

    /// Returns lines on posed frames that are left out with their groups, and on novel views of a pinhole that look
    /// away from every input view, as those of a camera do that is never given.
    pub fn notes(&self, scene: &Scene) -> Vec<String> {
        let notes = [self.groups_note(scene), self.directions_note(scene)];
        notes.into_iter().flatten().collect()
    }

    fn groups_note(&self, scene: &Scene) -> Option<String> {
        let groups: Vec<String> = (self.incomplete.iter())
            .filter_map(|group| {
                let (first, last) = (group.frames.first()?, group.frames.last()?);
                Some(format!("{first} to {last} ({})", group.reason))
            })
            .collect();
        let frames = self.incomplete.iter().flat_map(|group| &group.frames);
        let posed = frames.filter(|&&frame| {
            let frame = scene.frames.get(frame as usize);
            frame.is_some_and(|frame| frame.pose.is_some())
        });
        (!groups.is_empty()).then(|| {
            format!(
                "incomplete groups of frames are left out, with {} posed frames: {}",
                posed.count(),
                plain_text::first_of(&groups)
            )
        })
    }

    fn directions_note(&self, scene: &Scene) -> Option<String> {
        let Camera::Pinhole(camera) = &scene.camera else {
            return None;
        };
        let tangents = [
            f64::from(camera.width) / camera.fx,
            f64::from(camera.height) / camera.fy,
        ];
        let limit = (0.5 * tangents[0].min(tangents[1])).atan();
        let direction = |&frame: &u32| {
            let pose = scene.frames.get(frame as usize)?.pose?;
            Some(pose.rotation()? * DVec3::Z)
        };
        let given: Vec<DVec3> = self.input_views.iter().filter_map(direction).collect();
        let is_far = |novel: &DVec3| !given.iter().any(|one| one.angle_between(*novel) <= limit);
        let novel: Vec<DVec3> = self.novel_views.iter().filter_map(direction).collect();
        let far = novel.iter().filter(|novel| is_far(novel)).count();
        (far > 0 && !given.is_empty()).then(|| {
            format!(
                "{far} of {} novel views look more than {:.0} degrees (half of the field of view) away from every \
                 input view; where a rig has as many cameras as the rule counts frames, one is never given",
                novel.len(),
                limit.to_degrees()
            )
        })
    }
}

impl Record for Split {
    const SCHEMA: &'static str = "omnilife/split/2";
}
