//! `annotation`: content of a sequence, described by people and programs, and its measured motion.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::sequence::Evidence;
use crate::store::Record;

/// `annotation.json` in a sequence's folder.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Annotation {
    /// Id of the sequence.
    pub sequence: String,
    /// Version of the taxonomy that the tags are from.
    pub taxonomy: String,
    /// Scene category.
    pub scene: Option<Tag>,
    /// Semantic group of the scene category.
    pub group: Option<String>,
    /// `true` if the sequence goes from indoors to outdoors or back without a cut.
    pub traversal: bool,
    /// Action class.
    pub action: Option<Tag>,
    /// Captions, one per author.
    pub captions: Vec<Caption>,
    /// Motion of the camera.
    pub ego_motion: EgoMotion,
    /// Motion of the scene's content.
    pub dynamics: Option<Dynamics>,
}

impl Record for Annotation {
    const SCHEMA: &'static str = "omnilife/annotation/1";
}

/// A category with who chose it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Tag {
    /// Name in the taxonomy.
    pub name: String,
    /// Author of the choice.
    pub author: String,
}

/// A description with who wrote it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Caption {
    /// The text.
    pub text: String,
    /// Author: a person's name, or the command.
    pub author: String,
}

/// A caption that a model gave, with what it was asked by: kept so that nothing is asked for twice.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct CaptionAnswer {
    /// Address that was asked.
    pub endpoint: String,
    /// Name of the model there.
    pub model: String,
    /// Prompt given to the model.
    pub prompt: String,
    /// Number of images that it was shown.
    pub images: u64,
    /// Answer of the model.
    pub caption: String,
}

impl Record for CaptionAnswer {
    const SCHEMA: &'static str = "omnilife/caption-answer/1";
}

/// Motion of the camera: implied by the action, and measured. The two are kept apart.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct EgoMotion {
    /// Class of the action in the taxonomy.
    pub of_action: Option<String>,
    /// Class that the measurements say.
    pub measured: Option<Measured>,
}

impl EgoMotion {
    /// Returns the class for statistics: that of the action, which a person chose, else the measured one.
    pub fn class(&self) -> Option<&str> {
        let measured = self
            .measured
            .as_ref()
            .map(|measured| measured.class.as_str());
        self.of_action.as_deref().or(measured)
    }
}

/// Amount of motion beside that of the camera.
pub type Dynamics = Measured;

/// A measured class with what it rests on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Measured {
    /// The class.
    pub class: String,
    /// Evidence: `poses`, `frames`, `masks`.
    pub from: String,
    /// Every value with the limit it is compared with.
    pub evidence: Vec<Evidence>,
}

/// A taxonomy file: the names that tags may have.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Taxonomy {
    /// Version; goes up when a name changes.
    pub version: String,
    /// Semantic groups with their scene categories.
    pub scenes: Vec<NameGroup>,
    /// Ego-motion classes with their actions.
    pub actions: Vec<NameGroup>,
}

impl Record for Taxonomy {
    const SCHEMA: &'static str = "omnilife/taxonomy/1";
}

/// A named group of names.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct NameGroup {
    /// Name of the group.
    pub name: String,
    /// Names in it.
    pub members: Vec<String>,
}
