//! Placeholders in the texts of a `method.toml`.
//!
//! In commands: `{scene}` (the `scene.json`), `{scene_folder}` (its folder), `{split}` (the `split.json`), `{work}` (an
//! empty folder for the method, also its working directory), `{seed}`, `{folder}` (the manifest's folder), `{omnilife}`
//! (this program) and `{face_side}` (pixels of a cube's face that keeps the resolution of the scene's panoramas). In
//! patterns of predictions also `{frame}` (number in the scene), `{index}` (index among
//! the split's views of that kind, from 0), `{group}` (number of the first group with the view, from 0; 0 in splits
//! without groups), `{target}` (index among the novel views of that group, from 0) and `{stem}` (name of the scene's
//! image without its extension). `{frame:06}` pads with zeros to 6 digits. All paths are absolute.
//!
//! For a method that leaves the six faces of a cube in place of a panorama, `{face}` is the number of a face in the order
//! front, right, back, left, up, down, from 0, and `{face_name}` its name. `{face_index}` counts faces over all views
//! of the kind: six times `{index}` plus `{face}`.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    camera::cube::{CUBE_FACES, side_of_equal_resolution},
    placeholders::{self, replace},
    records::Scene,
    store::StoreError,
};

use super::{ExternalRequest, WORK_FOLDER};

/// The paths and values behind the placeholders of one run.
pub(super) struct Places {
    pub(super) scene: PathBuf,
    pub(super) split: PathBuf,
    pub(super) work: PathBuf,
    pub(super) folder: PathBuf,
    seed: u64,
    face_side: u32,
}

/// Values of a view's placeholders.
pub(super) struct ViewName<'a> {
    pub(super) frame: u32,
    pub(super) index: usize,
    pub(super) group: usize,
    pub(super) target: usize,
    pub(super) stem: &'a str,
    /// Number of the face, 0 where views are whole.
    pub(super) face: usize,
}

const IN_COMMANDS: [&str; 8] = [
    "scene",
    "scene_folder",
    "split",
    "work",
    "seed",
    "folder",
    "omnilife",
    "face_side",
];
/// Placeholders that tell views apart, each with true if it is a number.
const OF_VIEWS: [(&str, bool); 8] = [
    ("frame", true),
    ("index", true),
    ("group", true),
    ("target", true),
    ("stem", false),
    ("face", true),
    ("face_name", false),
    ("face_index", true),
];
/// Placeholders of the faces of a cube.
const OF_FACES: [&str; 3] = ["face", "face_name", "face_index"];

impl Places {
    pub(super) fn new(request: &ExternalRequest, scene: &Scene) -> Result<Self, StoreError> {
        let absolute = |path: &Path| {
            std::path::absolute(path).map_err(|source| StoreError::read(path, source))
        };
        let manifest = absolute(&request.manifest)?;
        Ok(Self {
            scene: absolute(&request.scene)?,
            split: absolute(&request.split)?,
            work: absolute(&request.out.join(WORK_FOLDER))?,
            folder: manifest.parent().unwrap_or(Path::new("/")).to_owned(),
            seed: request.seed,
            face_side: side_of_equal_resolution(scene.camera.width()),
        })
    }

    /// Returns folders that a method reads from.
    pub(super) fn readable_folders(&self) -> Vec<&Path> {
        let mut folders: Vec<&Path> = [self.scene.parent(), self.split.parent()]
            .into_iter()
            .flatten()
            .chain([self.folder.as_path()])
            .collect();
        folders.sort();
        folders.dedup();
        folders
    }

    /// Returns a word of a command with its placeholders filled in.
    pub(super) fn fill(&self, word: &str) -> String {
        replace(word, |name, _| self.value(name))
    }

    /// Returns the file of a view.
    pub(super) fn fill_pattern(&self, pattern: &str, view: &ViewName<'_>) -> PathBuf {
        PathBuf::from(replace(pattern, |name, digits| match name {
            "frame" => Some(format!("{:0digits$}", view.frame)),
            "index" => Some(format!("{:0digits$}", view.index)),
            "group" => Some(format!("{:0digits$}", view.group)),
            "target" => Some(format!("{:0digits$}", view.target)),
            "stem" => Some(view.stem.to_owned()),
            "face" => Some(format!("{:0digits$}", view.face)),
            "face_name" => CUBE_FACES.get(view.face).map(|face| face.name.to_owned()),
            "face_index" => {
                let before = view.index.saturating_mul(CUBE_FACES.len());
                Some(format!("{:0digits$}", before.saturating_add(view.face)))
            }
            _ => self.value(name),
        }))
    }

    fn value(&self, name: &str) -> Option<String> {
        Some(match name {
            "scene" => self.scene.display().to_string(),
            "scene_folder" => {
                let folder = self.scene.parent().unwrap_or(Path::new("/"));
                folder.display().to_string()
            }
            "split" => self.split.display().to_string(),
            "work" => self.work.display().to_string(),
            "folder" => self.folder.display().to_string(),
            "seed" => self.seed.to_string(),
            "face_side" => self.face_side.to_string(),
            // If the system does not report it, the program is found by its name.
            "omnilife" => std::env::current_exe()
                .map_or_else(|_| "omnilife".to_owned(), |path| path.display().to_string()),
            _ => return None,
        })
    }
}

/// Refuses unknown placeholders in a command.
pub(super) fn check_command(word: &str) -> Result<(), String> {
    placeholders::check(word, &known(&[]))
}

/// Refuses unknown placeholders in a pattern, and patterns that name one file for all views or are relative to an
/// unknown folder.
pub(super) fn check_pattern(pattern: &str) -> Result<(), String> {
    placeholders::check(pattern, &known(&OF_VIEWS))?;
    let names = placeholders::names(pattern)?;
    let has = |wanted: &str| names.iter().any(|(name, _)| name == wanted);
    let tells_apart = ["frame", "index", "stem", "face_index"]
        .into_iter()
        .any(has)
        || (has("group") && has("target"));
    if !tells_apart {
        return Err(format!(
            "{pattern:?} is the same file for every view: it needs {{frame}}, {{index}} or {{stem}}"
        ));
    }
    if !pattern.starts_with('{') && !Path::new(pattern).is_absolute() {
        return Err(format!("{pattern:?} should begin with {{work}}"));
    }
    Ok(())
}

/// Returns true if a pattern names the faces of a cube in place of whole views.
pub(super) fn has_faces(pattern: &str) -> bool {
    let names = placeholders::names(pattern).unwrap_or_default();
    let mut names = names.iter().map(|(name, _)| name.as_str());
    names.any(|name| OF_FACES.contains(&name))
}

/// Returns the placeholders of a text, each with true if it is a number.
fn known(of_views: &[(&'static str, bool)]) -> Vec<(&'static str, bool)> {
    let plain = IN_COMMANDS.iter().map(|&name| (name, false));
    plain.chain(of_views.iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_filled_and_padded() {
        let places = Places {
            scene: "/data/{frame}/scene.json".into(),
            split: "/data/split.json".into(),
            work: "/out/w".into(),
            folder: "/method".into(),
            seed: 7,
            face_side: 41,
        };
        let view = ViewName {
            frame: 42,
            index: 3,
            group: 2,
            target: 5,
            stem: "img_0042",
            face: 4,
        };
        let fill = |pattern| places.fill_pattern(pattern, &view).display().to_string();
        assert_eq!(fill("{work}/{frame:06}.png"), "/out/w/000042.png");
        assert_eq!(fill("{work}/{index}-{stem}.png"), "/out/w/3-img_0042.png");
        assert_eq!(fill("{work}/{group:03}/{frame}"), "/out/w/002/42");
        assert_eq!(fill("{work}/{group}/{target:03}"), "/out/w/2/005");
        assert_eq!(fill("{work}/{index}_{face}_{face_name}"), "/out/w/3_4_up");
        assert_eq!(fill("{work}/{face_index:05}"), "/out/w/00022");
        assert_eq!(places.fill("--side={face_side}"), "--side=41");
        assert_eq!(places.fill("{scene_folder}/x"), "/data/{frame}/x");
        assert_eq!(places.fill("--seed={seed}"), "--seed=7");
        // Braces in a path are not placeholders.
        assert_eq!(places.fill("{scene}"), "/data/{frame}/scene.json");
    }

    #[test]
    fn mistakes_are_named() {
        for (pattern, expected) in [
            ("{work}/view.png", "the same file for every view"),
            ("{work}/{group}.png", "the same file for every view"),
            ("{work}/{target}.png", "the same file for every view"),
            ("{work}/{face}.png", "the same file for every view"),
            ("views/{frame}.png", "should begin with {work}"),
            ("{work}/{fram}.png", "{fram} is not known"),
            ("{work}/{frame:6x}.png", "padding is written"),
            ("{work}/{stem:04}.png", "only numbers can be padded"),
            ("{work}/{frame", "not closed"),
        ] {
            let message = check_pattern(pattern).err().unwrap_or_default();
            assert!(message.contains(expected), "{pattern}: {message}");
        }
        assert!(check_pattern("{work}/{group}/{target}.png").is_ok());
        assert!(has_faces("{work}/{face_index}.png") && !has_faces("{work}/{frame}.png"));
        assert!(check_command("{frame}").is_err());
        assert!(check_command("{work}/{seed}").is_ok());
    }
}
