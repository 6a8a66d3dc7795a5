//! The lists that ODGS reads beside OpenMVG's data: stems of images for training and for testing, one a line
//! (`readOpenMVGInfo` in `scene_perspective/dataset_readers.py` of `esw0116/ODGS`).

use std::{collections::BTreeSet, path::Path};

use super::super::{ForeignSplit, file_name, left_out, stem};
use crate::error::CurateError;

/// Names of the lists, for training and for testing.
pub(super) const FILES: [&str; 2] = ["train.txt", "test.txt"];

/// Reads the split of a folder whose views have these image files. `None` without lists, as in OpenMVG's own folders,
/// and without test views, as in our exports without a split. Names of no view are left out, as in ODGS, with a line in
/// `notes`.
///
/// # Errors
/// When only one of the lists exists, or one cannot be read.
pub(super) fn published_split<'a>(
    folder: &Path,
    images: impl Iterator<Item = &'a str>,
    notes: &mut Vec<String>,
) -> Result<Option<ForeignSplit>, CurateError> {
    let [input, novel] = &FILES.map(|name| folder.join(name));
    if !input.is_file() && !novel.is_file() {
        return Ok(None);
    }
    let lists = ForeignSplit::from_lists("layout of ODGS", [input, novel], notes)?;
    let Some(mut split) = lists else {
        return Ok(None);
    };
    let known: BTreeSet<String> = images
        .map(file_name)
        .flat_map(|name| [stem(&name).to_owned(), name])
        .collect();
    let mut unknown = Vec::new();
    for names in [&mut split.input, &mut split.novel] {
        let (found, others): (Vec<String>, Vec<String>) =
            names.drain(..).partition(|name| known.contains(name));
        *names = found;
        unknown.extend(others);
    }
    let [input, novel] = FILES;
    let what = format!("names in {input} and {novel} that no view has");
    notes.extend(left_out::line(&unknown, &what));
    Ok((!split.novel.is_empty()).then_some(split))
}
