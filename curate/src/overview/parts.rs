//! State of the parts of one sequence, by its records and files.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    camera::Camera,
    layout::{
        ANNOTATION_FILE, DENSE_FILE, DENSE_FOLDER, DYNAMIC_MASKS_FILE, DYNAMIC_MASKS_FOLDER,
        SCENE_FILE, SEQUENCE_FILE, SPLIT_FILE, VIDEOS_FOLDER,
    },
    records::{
        Annotation, Masks, PartState, PartStatus, Scene, SceneFrame, Sequence, SequencePart,
        SequenceStatus,
    },
    store,
};

use super::commands;
use crate::{
    error::CurateError,
    publish::{optional, status_name},
};

/// Number of tags of a complete annotation: scene, action, caption, ego-motion, dynamics.
const TAGS: u64 = 5;

/// Records of one sequence or imported scene.
pub(super) struct Records {
    /// Folder relative to the dataset; `.` for the dataset's own.
    pub(super) folder: String,
    pub(super) path: PathBuf,
    pub(super) sequence: Option<Sequence>,
    pub(super) scene: Option<Scene>,
    pub(super) annotation: Option<Annotation>,
    /// Masks that `curate masks` found.
    pub(super) found_masks: Option<Masks>,
    splits: Vec<String>,
    has_dense_points: bool,
    is_in_dataset: bool,
}

/// Facts by which the command for a part is chosen.
pub(super) struct Facts {
    pub(super) has_sequence: bool,
    pub(super) has_scene: bool,
    pub(super) has_poses: bool,
    pub(super) is_pinhole: bool,
    pub(super) has_found_masks: bool,
}

/// Frame with its image and its masks, relative to the sequence's folder.
pub(super) struct FrameFiles<'a> {
    pub(super) image: &'a str,
    pub(super) time_seconds: f64,
    pub(super) moving: Option<String>,
    pub(super) ignored: Option<&'a str>,
}

impl Records {
    /// Reads the records in a folder of a dataset, or of imported scenes.
    ///
    /// # Errors
    /// When a record is malformed or cannot be read.
    pub(super) fn read(
        dataset: &Path,
        folder: String,
        is_in_dataset: bool,
    ) -> Result<Self, CurateError> {
        let path = match folder.as_str() {
            "." => dataset.to_owned(),
            folder => dataset.join(folder),
        };
        let found_masks = path.join(DYNAMIC_MASKS_FOLDER).join(DYNAMIC_MASKS_FILE);
        let mut splits = Vec::new();
        let mut has_dense_points = path.join(DENSE_FOLDER).join(DENSE_FILE).is_file();
        let names = match path.is_dir() {
            true => store::names_in(&path)?,
            false => Vec::new(),
        };
        for name in names {
            let inner = path.join(&name);
            has_dense_points |= inner.join(DENSE_FOLDER).join(DENSE_FILE).is_file();
            if inner.join(SPLIT_FILE).is_file() {
                splits.push(name);
            }
        }
        let scene: Option<Scene> = optional(&path.join(SCENE_FILE))?;
        if let Some(scene) = &scene
            && scene.published_split.is_some()
        {
            splits.push("published".to_owned());
        }
        Ok(Self {
            sequence: optional(&path.join(SEQUENCE_FILE))?,
            scene,
            annotation: optional(&path.join(ANNOTATION_FILE))?,
            found_masks: optional(&found_masks)?,
            folder,
            path,
            splits,
            has_dense_points,
            is_in_dataset,
        })
    }

    /// Returns the id; the folder where no record states one.
    pub(super) fn id(&self) -> String {
        let of_sequence = self.sequence.as_ref().map(|sequence| &sequence.id);
        let of_scene = self.scene.as_ref().map(|scene| &scene.id);
        let id = of_sequence.or(of_scene).cloned();
        id.unwrap_or_else(|| {
            let videos = format!("{VIDEOS_FOLDER}/");
            let folder = &self.folder;
            folder.strip_prefix(&videos).unwrap_or(folder).to_owned()
        })
    }

    /// Returns true where the frames are perspective images.
    pub(super) fn is_pinhole(&self) -> bool {
        match &self.scene {
            Some(scene) => matches!(scene.camera, Camera::Pinhole(_)),
            None => (self.sequence.as_ref()).is_some_and(Sequence::is_pinhole),
        }
    }

    /// Returns the length in seconds.
    pub(super) fn duration_seconds(&self) -> f64 {
        if let Some(sequence) = &self.sequence {
            return sequence.range.duration_seconds();
        }
        let frames = self.scene.iter().flat_map(|scene| &scene.frames);
        let times = || frames.clone().map(|frame| frame.time_seconds);
        match (times().next(), times().next_back()) {
            (Some(first), Some(last)) => last - first,
            _ => 0.0,
        }
    }

    /// Returns the frames in order of time: those of the scene, to which its masks belong, else of the sequence.
    pub(super) fn frames(&self) -> Vec<FrameFiles<'_>> {
        if let Some(scene) = &self.scene {
            let frames = scene.frames.iter().map(|frame| FrameFiles {
                image: &frame.image,
                time_seconds: frame.time_seconds,
                moving: frame.mask.clone(),
                ignored: frame.ignore_mask.as_deref(),
            });
            return frames.collect();
        }
        let entries = self.sequence.iter();
        let entries = entries.flat_map(|sequence| &sequence.frames.entries);
        let found = self.found_masks.as_ref();
        let frames = entries.enumerate().map(|(index, entry)| FrameFiles {
            image: &entry.file,
            time_seconds: entry.time_seconds,
            moving: found
                .and_then(|masks| masks.frames.get(index))
                .map(|mask| format!("{DYNAMIC_MASKS_FOLDER}/{}", mask.file)),
            ignored: None,
        });
        frames.collect()
    }

    /// Returns the state of all parts; commands name the dataset as `shown`.
    pub(super) fn status(&self, shown: &str) -> SequenceStatus {
        let parts = SequencePart::ALL.into_iter();
        let parts = parts.filter_map(|part| self.part(part, shown));
        SequenceStatus {
            id: self.id(),
            folder: self.folder.clone(),
            duration_seconds: self.duration_seconds(),
            parts: parts.collect(),
        }
    }

    fn facts(&self) -> Facts {
        let mut frames = self.scene.iter().flat_map(|scene| &scene.frames);
        Facts {
            has_sequence: self.sequence.is_some() || self.is_in_dataset,
            has_scene: self.scene.is_some(),
            has_poses: frames.any(|frame| frame.pose.is_some()),
            is_pinhole: self.is_pinhole(),
            has_found_masks: self.found_masks.is_some(),
        }
    }

    /// Returns the state of a part; `None` where no sequence of this kind can have it.
    fn part(&self, part: SequencePart, shown: &str) -> Option<PartStatus> {
        let found = match part {
            SequencePart::Frames => self.images(),
            SequencePart::Poses => self.poses(),
            SequencePart::Points => {
                let has_points = (self.scene.as_ref()).is_some_and(|scene| scene.points.is_some());
                PartFinding::of(u64::from(has_points || self.has_dense_points), 1)
            }
            SequencePart::Masks => self.masks(),
            SequencePart::IgnoreMasks => self.of_frames(|frame| frame.ignore_mask.is_some()),
            SequencePart::Depth => self.depth(),
            // Tags belong to the sequences of a dataset.
            SequencePart::Annotation if !self.is_in_dataset => return None,
            SequencePart::Annotation => self.tags(),
            SequencePart::Splits => {
                let count = self.splits.len() as u64;
                PartFinding {
                    note: self.splits.join(", "),
                    ..PartFinding::of(count, count.max(1))
                }
            }
        };
        let is_final = found.state == PartState::Present || found.is_final;
        let command = (!is_final).then(|| commands::making(part, &self.facts()));
        Some(PartStatus {
            part,
            state: found.state,
            count: found.count,
            of: found.of,
            note: found.note,
            command: command.map(|command| commands::line(command, shown, &self.folder)),
        })
    }

    fn images(&self) -> PartFinding {
        let frames = self.frames();
        let there = frames
            .iter()
            .filter(|frame| self.path.join(frame.image).is_file());
        PartFinding::of(there.count() as u64, frames.len().max(1) as u64)
    }

    fn poses(&self) -> PartFinding {
        let found = self.of_frames(|frame| frame.pose.is_some());
        let Some(scene) = self.scene.as_ref().filter(|_| found.count > 0) else {
            return found;
        };
        let status = status_name(scene.validation.status);
        let words = [&[status.to_owned()][..], &scene.validation.problems].concat();
        PartFinding {
            note: words.join("; "),
            // The other frames were not registered, and would not be again.
            is_final: true,
            ..found
        }
    }

    fn masks(&self) -> PartFinding {
        let in_scene = self.of_frames(|frame| frame.mask.is_some());
        let Some(masks) = &self.found_masks else {
            return in_scene;
        };
        let count = masks.frames.len() as u64;
        if self.scene.is_none() {
            return PartFinding {
                note: masks.method.clone(),
                ..PartFinding::of(count, in_scene.of.max(count))
            };
        }
        if in_scene.count == 0 {
            return PartFinding {
                state: PartState::Incomplete,
                note: format!("{}, not in the scene", masks.method),
                ..in_scene
            };
        }
        in_scene
    }

    fn depth(&self) -> PartFinding {
        let is_true = self.of_frames(|frame| frame.depth.is_some());
        let is_any = self.of_frames(|frame| frame.depth.is_some() || frame.depth_prior.is_some());
        let note = match (is_true.count, is_any.count) {
            (_, 0) => "",
            (0, _) => "estimated",
            _ => "true",
        };
        PartFinding {
            note: note.to_owned(),
            ..is_any
        }
    }

    fn tags(&self) -> PartFinding {
        let count = self.annotation.as_ref().map_or(0, |annotation| {
            [
                annotation.scene.is_some(),
                annotation.action.is_some(),
                !annotation.captions.is_empty(),
                annotation.ego_motion.class().is_some(),
                annotation.dynamics.is_some(),
            ]
            .map(u64::from)
            .iter()
            .sum()
        });
        PartFinding::of(count, TAGS)
    }

    /// Counts the frames of the scene: 0 of all frames without a scene.
    fn of_frames(&self, has: impl Fn(&SceneFrame) -> bool) -> PartFinding {
        let frames = self.scene.iter().flat_map(|scene| &scene.frames);
        let count = frames.filter(|frame| has(frame)).count() as u64;
        PartFinding::of(count, self.frames().len().max(1) as u64)
    }
}

/// State of a part without its command.
struct PartFinding {
    state: PartState,
    count: u64,
    of: u64,
    note: String,
    /// True where no command would add anything.
    is_final: bool,
}

impl PartFinding {
    fn of(count: u64, of: u64) -> Self {
        let state = match count {
            0 => PartState::Missing,
            count if count < of => PartState::Incomplete,
            _ => PartState::Present,
        };
        Self {
            state,
            count,
            of,
            note: String::new(),
            is_final: false,
        }
    }
}
