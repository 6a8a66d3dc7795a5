//! Faults of the sequences of a dataset: frames, their times, and annotations.

use std::path::Path;

use omnilife_schemas::{
    image_file::ImageFile,
    layout::{ANNOTATION_FILE, SEQUENCE_FILE},
    plain_text::counted,
    records::{Annotation, Sequence},
    store::{self, StoreError},
};
use rayon::prelude::*;

use super::statistics::{Statistics, optional};
use crate::{annotation::taxonomy, error::CurateError};

/// Returns one line per fault of the sequence in the folder `name` of a dataset, by its record.
pub(super) fn faults_of(folder: &Path, name: &str, sequence: &Sequence) -> Vec<String> {
    let at = folder.join(name);
    let of_record = sequence.faults().into_iter();
    let mut faults: Vec<String> = of_record.map(|fault| format!("{name}: {fault}")).collect();
    let size = [sequence.frames.width, sequence.frames.height].map(|side| side as usize);
    for frame in &sequence.frames.entries {
        let file = at.join(&frame.file);
        if !file.is_file() {
            faults.push(format!("{name}/{}: is missing", frame.file));
            continue;
        }
        let opened = ImageFile::open(&file).and_then(|image| image.expect_size(size));
        faults.extend(opened.err().map(|error| error.to_string()));
    }
    match optional::<Annotation>(&at.join(ANNOTATION_FILE)) {
        Ok(Some(annotation)) => {
            let of_annotation = taxonomy::load(None).map_or_else(
                |error| vec![error.to_string()],
                |built_in| taxonomy::faults(&annotation, &built_in),
            );
            let file = format!("{name}/{ANNOTATION_FILE}");
            faults.extend(of_annotation.iter().map(|fault| format!("{file}: {fault}")));
        }
        Ok(None) => {}
        Err(error) => faults.push(error.to_string()),
    }
    faults
}

/// Refuses a dataset with a fault in one of its sequences: it must not be published.
///
/// # Errors
/// The first fault, with their number.
pub(super) fn refuse(folder: &Path, statistics: &Statistics) -> Result<(), CurateError> {
    let of_rows: Vec<Result<Vec<String>, StoreError>> = (statistics.rows.par_iter())
        .map(|row| {
            let file = folder.join(&row.folder).join(SEQUENCE_FILE);
            Ok(faults_of(folder, &row.folder, &store::read_record(&file)?))
        })
        .collect();
    let faults = of_rows.into_iter().collect::<Result<Vec<_>, _>>()?.concat();
    match faults.first() {
        None => Ok(()),
        Some(first) => {
            let count = counted(faults.len(), "fault");
            let reason = format!("must have sound sequences, got {count}; the first: {first}");
            Err(CurateError::input(folder, reason))
        }
    }
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{records::FrameEntry, rgb::write_rgb8_png};

    use super::*;

    #[test]
    fn frames_that_are_empty_of_another_size_or_missing_are_faults() -> Result<(), StoreError> {
        let folder = tempfile::tempdir().map_err(|error| StoreError::read(Path::new(""), error))?;
        let at = folder.path().join("clip");
        store::create_folder(&at)?;
        write_rgb8_png(&at.join("0.png"), 64, 32, &[7; 3 * 64 * 32])?;
        write_rgb8_png(&at.join("1.png"), 32, 16, &[7; 3 * 32 * 16])?;
        store::write_bytes(&at.join("2.png"), b"")?;
        let faults = |count: usize| {
            let entries = (0..count).map(|number| FrameEntry {
                file: format!("{number}.png"),
                time_seconds: number as f64,
                capture: None,
            });
            let mut sequence = Sequence::of_panoramas("clip", [64, 32], entries.collect());
            sequence.range.end_seconds = 10.0;
            faults_of(folder.path(), "clip", &sequence)
        };
        assert!(faults(1).is_empty());
        let found = faults(4);
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(found[0].contains("32x16 pixels, expected 64x32"));
        assert!(found[2].ends_with("3.png: is missing"));
        Ok(())
    }
}
