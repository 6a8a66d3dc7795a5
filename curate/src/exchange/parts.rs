//! Parts of a scene that only some formats hold, and lines on those omitted from an export.

use std::collections::BTreeSet;

use omnilife_schemas::{
    Pose, plain_text,
    records::{Scale, Scene, SceneFrame},
};

use super::Format;

/// A part of a scene that only some formats hold. All hold images, poses, the camera, masks and, in `times.csv`, times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// World points.
    Points,
    /// File names of the images.
    Names,
    /// Masks, boxes and classes of single objects.
    Objects,
    /// Masks of classes of objects.
    Classes,
    /// True distances.
    Distances,
    /// Depth priors.
    EstimatedDistances,
    /// The statement that a unit of the world is a metre.
    Scale,
    /// Frames without a known pose.
    UnposedFrames,
    /// The split that the scene is published with.
    PublishedSplit,
    /// Metadata in the files of stills.
    Captures,
}

impl Part {
    /// All parts.
    pub const ALL: &'static [Self] = &[
        Self::Points,
        Self::Names,
        Self::Objects,
        Self::Classes,
        Self::Distances,
        Self::EstimatedDistances,
        Self::Scale,
        Self::UnposedFrames,
        Self::PublishedSplit,
        Self::Captures,
    ];

    /// Returns true if redrawn images can have it: the others refer to the original frames, or stand in the record of
    /// the scene alone.
    pub(super) fn is_of_any_images(self) -> bool {
        matches!(self, Self::Points | Self::Names | Self::Scale)
    }

    /// Describes the content of the part in a scene, which is omitted; `None` if it is empty.
    fn left_out(self, scene: &Scene) -> Option<String> {
        let frames_with = |has: &dyn Fn(&SceneFrame) -> bool, what: &str| {
            let count = scene.frames.iter().filter(|&frame| has(frame)).count();
            (count > 0).then(|| format!("{what} of {count} frames are left out"))
        };
        match self {
            Self::Points => {
                (scene.points.as_ref()).map(|_| "no points: all are left out".to_owned())
            }
            Self::Names => {
                let mut numbered = scene.frames.iter().enumerate();
                numbered
                    .any(|(number, frame)| super::file_name(&frame.image) != numbered_name(number))
                    .then(|| "no names of images: they are numbered from 0 on".to_owned())
            }
            Self::Objects => {
                let objects = scene.object_names().into_iter();
                names("masks of objects", objects)
            }
            Self::Classes => {
                let classes = scene.frames.iter().flat_map(|frame| frame.classes.keys());
                names("masks of classes", classes.map(String::as_str))
            }
            Self::Distances => frames_with(&|frame| frame.depth.is_some(), "no distances: those"),
            Self::EstimatedDistances => frames_with(
                &|frame| frame.depth_prior.is_some(),
                "no estimated distances: those",
            ),
            Self::Scale => (scene.scale == Scale::Metres)
                .then(|| "no unit of the world: metres are left out".to_owned()),
            Self::UnposedFrames => {
                let unposed =
                    |frame: &&SceneFrame| !frame.pose.as_ref().is_some_and(Pose::is_valid);
                let count = scene.frames.iter().filter(unposed).count();
                (count > 0).then(|| {
                    let all = scene.frames.len();
                    format!("no frames without a pose: {count} of {all} are left out")
                })
            }
            Self::PublishedSplit => (scene.published_split.as_ref())
                .map(|split| format!("no published split: that of {} is left out", split.source)),
            Self::Captures => frames_with(
                &|frame| frame.capture.is_some(),
                "no times and places of stills: those",
            ),
        }
    }
}

/// Returns the name of an image in formats that number them.
pub(super) fn numbered_name(number: usize) -> String {
    format!("{number:05}.png")
}

/// Counts and names things that a format cannot hold.
fn names<'a>(what: &str, all: impl Iterator<Item = &'a str>) -> Option<String> {
    let distinct: BTreeSet<&str> = all.collect();
    let names: Vec<String> = distinct.into_iter().map(str::to_owned).collect();
    let first = plain_text::first_of(&names);
    (!names.is_empty()).then(|| format!("no {what}: {} are left out ({first})", names.len()))
}

/// Returns lines on the parts of a scene that an export in a format omits, one for each non-empty part.
pub(super) fn left_out(format: &Format, holds: &[Part], scene: &Scene) -> Vec<String> {
    let others = Part::ALL.iter().filter(|part| !holds.contains(part));
    others
        .filter_map(|part| part.left_out(scene))
        .map(|what| format!("{}: {} holds {what}", scene.id, format.id))
        .collect()
}
