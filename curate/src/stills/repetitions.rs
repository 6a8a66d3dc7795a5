//! Stills that stand twice in their folder.

use std::{collections::BTreeMap, ffi::OsStr, fs};

use omnilife_schemas::{
    plain_text,
    store::{self, StoreError},
};

use super::Still;

/// Returns a line on stills that are the same file, byte for byte, as another one.
///
/// # Errors
/// When a file cannot be read.
pub(super) fn same_files(stills: &[Still]) -> Result<Option<String>, StoreError> {
    let mut by_size: BTreeMap<u64, Vec<&Still>> = BTreeMap::new();
    for still in stills {
        let read = |error| StoreError::read(&still.path, error);
        let bytes = fs::metadata(&still.path).map_err(read)?.len();
        by_size.entry(bytes).or_default().push(still);
    }
    let mut names = Vec::new();
    for alike in by_size.values().filter(|alike| alike.len() > 1) {
        let mut first: BTreeMap<String, &Still> = BTreeMap::new();
        for still in alike {
            let sha256 = store::sha256_file(&still.path)?;
            if let Some(earlier) = first.get(&sha256) {
                names.push(format!("{} is {}", still.name(), earlier.name()));
            }
            first.entry(sha256).or_insert(still);
        }
    }
    Ok((!names.is_empty()).then(|| {
        format!(
            "{} images are copies of others, and frames all the same: {}",
            names.len(),
            plain_text::first_of(&names)
        )
    }))
}

/// Returns a line on stills with the name of another one but for its ending.
pub(super) fn same_names(stills: &[Still]) -> Option<String> {
    let mut by_stem: BTreeMap<Option<&OsStr>, Vec<String>> = BTreeMap::new();
    for still in stills {
        let stem = still.path.file_stem();
        by_stem.entry(stem).or_default().push(still.name());
    }
    let alike = by_stem.into_values().filter(|names| names.len() > 1);
    let alike: Vec<String> = alike.map(|names| names.join(" and ")).collect();
    (!alike.is_empty()).then(|| {
        format!(
            "images of one name have several endings, and each is a frame: {}",
            plain_text::first_of(&alike)
        )
    })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use omnilife_schemas::rgb::write_rgb8_png;

    use super::super::Stills;
    use crate::error::CurateError;

    /// Writes panoramas of one colour each by name, and returns the notes on times and on all else.
    fn notes(panoramas: &[(&str, u8)]) -> Result<(String, Vec<String>), CurateError> {
        let folder = tempfile::tempdir()
            .map_err(|error| CurateError::internal(Path::new("a temporary folder"), error))?;
        for &(name, grey) in panoramas {
            write_rgb8_png(&folder.path().join(name), 32, 16, &[grey; 3 * 32 * 16])?;
        }
        let stills = Stills::read(folder.path())?;
        Ok((stills.times_note, stills.notes))
    }

    #[test]
    fn copies_same_names_and_gaps_are_reported() -> Result<(), CurateError> {
        let (times, others) = notes(&[("f1.png", 1), ("f2.png", 2), ("f3.png", 3)])?;
        assert!(!times.contains("gaps"), "{times}");
        assert_eq!(others, [""; 0]);
        let (times, others) = notes(&[("f1.png", 1), ("f2.png", 2), ("f5.png", 1)])?;
        assert!(times.ends_with("gaps: after f2.png"), "{times}");
        assert_eq!(others.len(), 1, "{others:?}");
        assert!(others[0].ends_with("f5.png is f1.png"), "{others:?}");
        let (_, others) = notes(&[("f1.png", 1), ("f1.jpg", 2)])?;
        assert_eq!(others.len(), 1, "{others:?}");
        assert!(others[0].ends_with("f1.jpg and f1.png"), "{others:?}");
        Ok(())
    }
}
