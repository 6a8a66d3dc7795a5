//! The sequence and the cameras that a path below a dataset names.

use std::path::{Path, PathBuf};

use omnilife_schemas::plain_text;

use crate::error::CurateError;

/// A part of a dataset.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Choice {
    /// Folder of the dataset.
    pub(super) root: PathBuf,
    /// Name of the sequence; `None` for its only one.
    sequence: Option<String>,
    /// Names of the cameras; `None` for all.
    cameras: Option<Vec<String>>,
}

impl Choice {
    /// Reads a path: `ROOT`, `ROOT/SEQUENCE` or `ROOT/SEQUENCE/CAMERA+CAMERA`; `is_root` tells the root.
    ///
    /// # Errors
    /// When no root is there.
    pub(super) fn read(
        path: &Path,
        is_root: impl Fn(&Path) -> bool,
        must_hold: &str,
    ) -> Result<Self, CurateError> {
        let found = path.ancestors().take(3).find(|&folder| is_root(folder));
        let root = found.ok_or_else(|| {
            let reason =
                format!("must hold {must_hold}, or name a sequence below a folder that does");
            CurateError::input(path, reason)
        })?;
        let below = path.strip_prefix(root).unwrap_or(Path::new(""));
        let mut names = below.iter().map(|name| name.to_string_lossy().into_owned());
        Ok(Self {
            root: root.to_owned(),
            sequence: names.next(),
            cameras: names
                .next()
                .map(|names| names.split('+').map(str::to_owned).collect()),
        })
    }

    /// Returns the sequence among the known ones.
    ///
    /// # Errors
    /// For an unknown one, and if none is named where there are several.
    pub(super) fn sequence(&self, known: &[String]) -> Result<String, CurateError> {
        let listed = plain_text::first_of(known);
        let reason = match (&self.sequence, known) {
            (Some(name), _) if known.contains(name) => return Ok(name.clone()),
            (None, [only]) => return Ok(only.clone()),
            (Some(name), _) => format!("sequences must be of {listed}; got {name}"),
            (None, []) => "must hold a sequence, got none".to_owned(),
            (None, _) => format!(
                "must hold one sequence, got {} ({listed}): name one, as FOLDER/SEQUENCE",
                known.len()
            ),
        };
        Err(CurateError::input(&self.root, reason))
    }

    /// Returns the named cameras, of the known ones, or else `usual`.
    ///
    /// # Errors
    /// For an unknown camera, and one that is named twice.
    pub(super) fn cameras(
        &self,
        known: &[String],
        usual: Vec<String>,
    ) -> Result<Vec<String>, CurateError> {
        let Some(cameras) = &self.cameras else {
            return Ok(usual);
        };
        for (index, name) in cameras.iter().enumerate() {
            if !known.contains(name) {
                let reason = format!("cameras must be of {}; got {name}", known.join(", "));
                return Err(CurateError::input(&self.root, reason));
            }
            if cameras.iter().take(index).any(|before| before == name) {
                let reason = format!("must name a camera once, got {name} twice");
                return Err(CurateError::input(&self.root, reason));
            }
        }
        Ok(cameras.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choice(path: &str) -> Option<Choice> {
        let root = |folder: &Path| folder == Path::new("data/training");
        Choice::read(Path::new(path), root, "x").ok()
    }

    #[test]
    fn a_path_names_a_sequence_and_cameras() {
        let known = ["0001", "0002"].map(str::to_owned);
        let cameras = ["a", "b"].map(str::to_owned);
        let usual = || vec!["b".to_owned()];
        let all = choice("data/training");
        assert!(all.is_some_and(|all| {
            all.sequence(&known).is_err()
                && all.sequence(&known[1..]).is_ok_and(|name| name == "0002")
                && all
                    .cameras(&cameras, usual())
                    .is_ok_and(|names| names == ["b"])
        }));
        let two = choice("data/training/0001/a+b");
        assert!(two.is_some_and(|two| {
            two.sequence(&known).is_ok_and(|name| name == "0001")
                && two
                    .cameras(&cameras, usual())
                    .is_ok_and(|names| names == ["a", "b"])
        }));
        for bad in ["data/training/0001/a+a", "data/training/0001/c"] {
            let named = choice(bad);
            assert!(named.is_some_and(|one| one.cameras(&cameras, usual()).is_err()));
        }
        assert!(choice("data/training/0003").is_some_and(|one| one.sequence(&known).is_err()));
        assert_eq!(choice("data/testing"), None);
        assert_eq!(choice("data/training/0001/a/rgb"), None);
    }
}
