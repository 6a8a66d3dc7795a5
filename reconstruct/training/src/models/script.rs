//! Edit scripts: one language for the parts of every kind of model, the nodes of an atlas and the vehicles of an
//! object graph.
//!
//! ```toml
//! [[edit]]
//! kind = "shift"
//! object = "swan"             # name of a node, or id of a vehicle
//! by = [0.2, 0.0, -0.1]
//! unit = "distance"           # of the node from the camera; or "world"
//! axes = "camera"             # x right, y down, z forward in the clip's first frame; or "world", or "ground": x and
//!                             # y along headings 0 and 90 degrees, z up
//!
//! [[edit]]
//! kind = "rotate"             # about its own middle; the path of a vehicle stays
//! object = "swan"
//! turn = [0.0, 0.0, 90.0]     # degrees about the three axes
//!
//! [[edit]]
//! kind = "duplicate"
//! object = "swan"
//! new = "second swan"         # vehicles get the next free id where no other is given
//!
//! [[edit]]
//! kind = "retime"             # later by seconds, or by frames of the clip
//! object = "swan"
//! seconds = 1.5
//!
//! [[edit]]
//! kind = "texture"            # replaces the node's colour, its view dependence included
//! object = "swan"
//! image = "painted.png"       # RGBA, beside the script
//! frame = 12                  # painted in this frame; without it, over the node's atlas
//!
//! [[edit]]
//! kind = "insert"             # in the place of a node, before it
//! object = "swan"
//! new = "logo"
//! image = "logo.png"          # RGBA, beside the script; or run = "../other" and from = "duck"
//!
//! [[edit]]
//! kind = "remove"
//! object = "swan"
//! ```

use std::{
    ops::Range,
    path::{Path, PathBuf},
};

use omnilife_schemas::{records::Poses, store::StoreError};
use serde::Deserialize;

use crate::error::ReconstructError;

/// Edits in their order, with the lines of the file that state them.
#[derive(Debug, Clone)]
pub struct Script {
    path: PathBuf,
    text: String,
    edits: Vec<(Range<usize>, Edit)>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    edit: Vec<toml::Spanned<Edit>>,
}

/// Change of one part of a model.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Edit {
    /// Replaces the colour of a surface by a painted image.
    Texture {
        /// Part of the model.
        #[serde(alias = "node")]
        object: String,
        /// RGBA image, relative to the script.
        image: PathBuf,
        /// Frame that the image was painted in; `None`: painted over the atlas.
        frame: Option<u32>,
    },
    /// Removes a part.
    Remove {
        /// Part of the model.
        #[serde(alias = "node")]
        object: String,
    },
    /// Moves a part.
    Shift {
        /// Part of the model.
        #[serde(alias = "node")]
        object: String,
        /// Displacement along the axes.
        by: [f64; 3],
        /// Unit of the displacement; `None`: the model's own.
        unit: Option<Unit>,
        /// Axes of the displacement; `None`: the model's own.
        axes: Option<Axes>,
    },
    /// Rotates a part about its own middle.
    Rotate {
        /// Part of the model.
        #[serde(alias = "node")]
        object: String,
        /// Rotation vector, degrees about the axes.
        turn: [f64; 3],
        /// Axes of the rotation; `None`: the model's own.
        axes: Option<Axes>,
    },
    /// Puts a copy beside a part, in the same place.
    Duplicate {
        /// Part of the model.
        #[serde(alias = "node")]
        object: String,
        /// Name of the copy; `None`: the next free id, if parts have numbers.
        new: Option<String>,
    },
    /// Puts an image, or an object of another run, in the place of a part.
    Insert {
        /// Part whose place it takes; the part stays.
        #[serde(alias = "node")]
        object: String,
        /// Name of the new part.
        new: String,
        /// RGBA image, relative to the script.
        image: Option<PathBuf>,
        /// Folder of another run, relative to the script.
        run: Option<PathBuf>,
        /// Part of that run.
        from: Option<String>,
    },
    /// Shows a part later.
    Retime {
        /// Part of the model.
        #[serde(alias = "node")]
        object: String,
        /// Delay in seconds.
        seconds: Option<f64>,
        /// Delay in frames of the clip.
        frames: Option<f64>,
    },
}

/// Unit of a displacement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Distance of the part from the camera of the clip's first frame.
    Distance,
    /// Units of the scene's world.
    World,
}

/// Axes of a displacement or rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Axes {
    /// Right, down and forward of the camera in the clip's first frame.
    Camera,
    /// Axes of the scene's world.
    World,
    /// Headings 0 and 90 degrees along the ground, and up.
    Ground,
}

/// Delay of a retimed part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Delay {
    /// In seconds.
    Seconds(f64),
    /// In frames of the clip.
    Frames(f64),
}

impl Delay {
    /// Returns the delay in seconds, in a run of these views.
    ///
    /// # Errors
    /// When it is in frames and the views give no time between two.
    pub fn seconds(self, views: Option<&Poses>) -> Result<f64, String> {
        match self {
            Self::Seconds(seconds) => Ok(seconds),
            Self::Frames(frames) => views
                .and_then(Poses::seconds_per_frame)
                .map(|step| frames * step)
                .ok_or_else(|| "the run's record has no views: give seconds".to_owned()),
        }
    }
}

impl Script {
    /// Reads a script and checks the rules for every kind of model: known words, finite numbers.
    ///
    /// # Errors
    /// When the file cannot be read or is malformed; the error names its line.
    pub fn read(path: &Path) -> Result<Self, ReconstructError> {
        let text =
            std::fs::read_to_string(path).map_err(|source| StoreError::read(path, source))?;
        let refuse = |span: Option<Range<usize>>, reason: &str| {
            refusal(path, &text, span.map_or(0, |span| span.start), reason)
        };
        let table: Table =
            toml::from_str(&text).map_err(|error| refuse(error.span(), error.message()))?;
        if table.edit.is_empty() {
            return Err(refuse(None, "must have at least one [[edit]] table"));
        }
        let mut edits = Vec::with_capacity(table.edit.len());
        for edit in table.edit {
            let span = edit.span();
            let edit = edit.into_inner();
            edit.check()
                .map_err(|reason| refuse(Some(span.clone()), &reason))?;
            edits.push((span, edit));
        }
        Ok(Self {
            path: path.to_owned(),
            text,
            edits,
        })
    }

    /// Returns the folder that images are relative to.
    pub fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new("."))
    }

    /// Applies each edit in its order; returns one line per edit.
    ///
    /// # Errors
    /// The first that `apply` returns, preceded by the name of the file and the line of the edit.
    pub fn apply(
        &self,
        mut apply: impl FnMut(&Edit) -> Result<String, String>,
    ) -> Result<Vec<String>, ReconstructError> {
        let refuse =
            |span: &Range<usize>, reason: &str| refusal(&self.path, &self.text, span.start, reason);
        self.edits
            .iter()
            .map(|(span, edit)| apply(edit).map_err(|reason| refuse(span, &reason)))
            .collect()
    }
}

impl Edit {
    /// Returns the part that the edit changes.
    pub fn object(&self) -> &str {
        match self {
            Self::Texture { object, .. }
            | Self::Remove { object }
            | Self::Shift { object, .. }
            | Self::Rotate { object, .. }
            | Self::Duplicate { object, .. }
            | Self::Insert { object, .. }
            | Self::Retime { object, .. } => object,
        }
    }

    fn check(&self) -> Result<(), String> {
        let three = match self {
            Self::Shift { by, .. } => *by,
            Self::Rotate { turn, .. } => *turn,
            Self::Retime {
                seconds, frames, ..
            } => {
                return delay(*seconds, *frames).map(|_| ());
            }
            Self::Insert {
                image, run, from, ..
            } => {
                let parts = (image.is_some(), run.is_some(), from.is_some());
                return match parts {
                    (true, false, false) | (false, true, true) => Ok(()),
                    _ => Err("must have either image, or run and from".to_owned()),
                };
            }
            Self::Texture { .. } | Self::Remove { .. } | Self::Duplicate { .. } => return Ok(()),
        };
        if three.iter().all(|number| number.is_finite()) {
            return Ok(());
        }
        Err(format!("must have three finite numbers, got {three:?}"))
    }
}

/// Returns the delay of a retimed part.
///
/// # Errors
/// When not exactly one of the two is given, or it is not finite.
pub fn delay(seconds: Option<f64>, frames: Option<f64>) -> Result<Delay, String> {
    let delay = match (seconds, frames) {
        (Some(seconds), None) => Delay::Seconds(seconds),
        (None, Some(frames)) => Delay::Frames(frames),
        _ => return Err("must have either seconds or frames".to_owned()),
    };
    let (Delay::Seconds(number) | Delay::Frames(number)) = delay;
    if number.is_finite() {
        return Ok(delay);
    }
    Err(format!("must be later by a finite number, got {number}"))
}

fn refusal(script: &Path, text: &str, byte: usize, reason: &str) -> ReconstructError {
    let before = text.bytes().take(byte);
    let line = 1 + before.filter(|&byte| byte == b'\n').count();
    let reason = reason.lines().next().unwrap_or_default();
    ReconstructError::Request {
        reason: format!("{}: line {line}: {reason}", script.display()),
    }
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{
        Pose,
        records::{PosedFrame, Scale},
    };

    use super::*;

    fn read(text: &str) -> Result<Script, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("edit.toml");
        std::fs::write(&path, text).expect("a script");
        Script::read(&path).map_err(|error| error.to_string())
    }

    /// A step over a frame without a pose is longer.
    #[test]
    fn a_frame_is_the_shortest_step_of_all_views() {
        let frame = |time_seconds: f64| PosedFrame {
            time_seconds,
            pose: Pose::new(glam::DQuat::IDENTITY, glam::DVec3::ZERO),
            mask: None,
        };
        let views = |times: &[f64]| {
            let frames = times.iter().map(|&time| frame(time)).collect();
            Poses::new(Scale::Arbitrary, None, frames)
        };
        let some = views(&[0.0, 0.2, 0.6, 0.8]);
        let frames = Delay::Frames(3.0);
        let seconds = frames.seconds(Some(&some)).expect("a step");
        assert!((seconds - 0.6).abs() < 1e-12, "{seconds}");
        for none in [None, Some(&views(&[0.5])), Some(&views(&[0.5, 0.5]))] {
            assert!(frames.seconds(none).is_err());
            assert_eq!(Delay::Seconds(0.3).seconds(none), Ok(0.3));
        }
    }

    #[test]
    fn edits_are_read_in_their_order() {
        let text = "[[edit]]\nkind = \"remove\"\nobject = \"3\"\n\n[[edit]]\nkind = \"shift\"\nnode = \"swan\"\n\
                    by = [1, 2.5, 0]\naxes = \"ground\"\n";
        let script = read(text).expect("a script");
        let seen = script.apply(|edit| Ok(format!("{edit:?}")));
        let seen = seen.expect("applied");
        assert_eq!(seen.len(), 2);
        assert!(
            seen[0].starts_with("Remove") && seen[1].contains("Ground"),
            "{seen:?}"
        );
        let refused = script.apply(|edit| match edit.object() {
            "3" => Ok(String::new()),
            _ => Err("not there".to_owned()),
        });
        let message = refused.expect_err("refused").to_string();
        assert!(
            message.contains("edit.toml: line 5: not there"),
            "{message}"
        );
    }

    #[test]
    fn what_no_model_can_do_is_refused_with_its_line() {
        let edit = |rest: &str| format!("# a comment\n[[edit]]\nobject = \"3\"\n{rest}\n");
        for rest in [
            "kind = \"paint\"",
            "kind = \"shift\"\nby = [1, nan, 0]",
            "kind = \"shift\"\nby = [1, 2]",
            "kind = \"rotate\"\nturn = [0, 0, inf]",
            "kind = \"retime\"",
            "kind = \"retime\"\nseconds = 1\nframes = 2",
            "kind = \"retime\"\nseconds = nan",
            "kind = \"remove\"\ncolour = 1",
            "kind = \"insert\"\nnew = \"logo\"",
            "kind = \"insert\"\nnew = \"logo\"\nimage = \"a.png\"\nrun = \"b\"",
            "kind = \"insert\"\nnew = \"logo\"\nrun = \"b\"",
        ] {
            let message = read(&edit(rest)).expect_err(rest);
            assert!(message.contains("edit.toml: line "), "{message}");
        }
        assert!(read("").is_err() && read("edit = []").is_err());
    }
}
