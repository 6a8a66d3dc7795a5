//! The order of frames in image files, and their times by the numbers in their names.
//!
//! Names are in natural order: a run of digits counts as the number that it is, so `2.png` comes before
//! `10.png`. The number of a frame is the last run of digits in its name.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

pub(crate) use omnilife_schemas::natural_order::{natural_paths, number};
use omnilife_schemas::store::{self, StoreError};

/// Returns the name of a file without its folder, up to the last run of digits.
fn before_number(file: &Path) -> String {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let is_digit = |letter: char| letter.is_ascii_digit();
    let upto_digits = stem.trim_end_matches(|letter| !is_digit(letter));
    upto_digits.trim_end_matches(is_digit).to_owned()
}

/// Returns true where the names of files differ before their numbers, so that the numbers alone do not count them.
fn differ_before_numbers<'a>(files: impl IntoIterator<Item = &'a Path>) -> bool {
    let begins: BTreeSet<String> = files.into_iter().map(before_number).collect();
    begins.len() > 1
}

/// Returns the visible images of a folder, PNG or JPEG, in natural order.
pub(crate) fn images_in(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut files = store::paths_in(folder)?;
    files.retain(|file| !store::is_hidden(file) && has_extension(file, &["png", "jpg", "jpeg"]));
    files.sort_by(|a, b| natural_paths(a, b));
    Ok(files)
}

/// Returns true where a file has one of these extensions, in upper or lower case.
pub(crate) fn has_extension(file: &Path, known: &[&str]) -> bool {
    let extension = file.extension().unwrap_or_default().to_ascii_lowercase();
    known.iter().any(|known| extension == *known)
}

/// Returns true if files in natural order are numbered 0, 1, ... or 1, 2, ...
pub(crate) fn are_counted(files: &[PathBuf]) -> bool {
    let numbers: Option<Vec<u64>> = files.iter().map(|file| number(file)).collect();
    let is_one_count = !differ_before_numbers(files.iter().map(PathBuf::as_path));
    numbers.filter(|_| is_one_count).is_some_and(|numbers| {
        let first = numbers.first().copied().unwrap_or(0);
        first <= 1 && numbers.iter().copied().eq((first..).take(numbers.len()))
    })
}

/// Times by a frame rate.
pub(crate) struct NumberedTimes {
    /// Seconds, one for each file.
    pub(crate) seconds: Vec<f64>,
    /// A note if names alone do not determine the times.
    pub(crate) note: Option<String>,
}

/// Returns the times of files in natural order at so many frames per second. The lowest number, of these files and of
/// `others` beside them, is shown at 0; gaps in the numbers stay gaps. The order of names counts if one has no number,
/// two of a folder share one, or names differ before it (`clip1_5`, `clip2_1`).
pub(crate) fn times_at(
    frames_per_second: f64,
    files: &[&Path],
    others: &[PathBuf],
) -> NumberedTimes {
    let numbers: Option<Vec<u64>> = files.iter().map(|file| number(file)).collect();
    let numbers = numbers.filter(|numbers| {
        let folders = files.iter().map(|file| file.parent());
        let distinct: BTreeSet<_> = folders.zip(numbers).collect();
        distinct.len() == files.len() && !differ_before_numbers(files.iter().copied())
    });
    let Some(numbers) = numbers else {
        return NumberedTimes {
            seconds: (0..files.len())
                .map(|index| index as f64 / frames_per_second)
                .collect(),
            note: Some(
                "names of images have no numbers, not one each, or differ before them: times follow the order of the \
                 names"
                    .to_owned(),
            ),
        };
    };
    let beside = others.iter().filter_map(|file| number(file));
    let first = numbers
        .iter()
        .copied()
        .chain(beside.clone())
        .min()
        .unwrap_or(0);
    let offsets = |number: u64| number.saturating_sub(first);
    let step = numbers
        .iter()
        .copied()
        .chain(beside)
        .map(offsets)
        .fold(0, greatest_common_divisor);
    NumberedTimes {
        seconds: numbers
            .iter()
            .map(|&number| offsets(number) as f64 / frames_per_second)
            .collect(),
        note: (step > 1).then(|| {
            format!(
                "images are numbered in steps of {step}, which count as frames: {step} are {:.3} s",
                step as f64 / frames_per_second
            )
        }),
    }
}

fn greatest_common_divisor(a: u64, b: u64) -> u64 {
    match a.checked_rem(b) {
        Some(rest) => greatest_common_divisor(b, rest),
        None => a,
    }
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::natural_order::natural;

    use super::*;

    #[test]
    fn numbers_behind_other_numbers_count_nothing() {
        for names in [
            [
                "2024-05-01 10.00.58",
                "2024-05-01 10.00.59",
                "2024-05-01 10.01.00",
            ],
            ["clip1_f5", "clip1_f6", "clip2_f1"],
            ["t0.1", "t0.25", "t1.3"],
        ] {
            let names = names.map(|name| format!("{name}.png"));
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            assert_eq!(
                seconds(&names, &[]),
                (vec![0.0, 0.25, 0.5], true),
                "{names:?}"
            );
            let files: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
            assert!(!are_counted(&files));
        }
        let (times, _) = seconds(&["a_0001_rgb.png", "a_0003_rgb.png"], &[]);
        assert_eq!(times, [0.0, 0.5]);
    }

    fn seconds(names: &[&str], others: &[&str]) -> (Vec<f64>, bool) {
        let files: Vec<&Path> = names.iter().map(Path::new).collect();
        let others: Vec<PathBuf> = others.iter().map(PathBuf::from).collect();
        let times = times_at(4.0, &files, &others);
        (times.seconds, times.note.is_some())
    }

    #[test]
    fn digits_count_as_numbers() {
        let mut names = [
            "b2.png", "a10.png", "a9.png", "a09.png", "a.png", "7/3.png", "7/20.png",
        ];
        names.sort_by(|a, b| natural(a, b));
        let expected = [
            "7/3.png", "7/20.png", "a09.png", "a9.png", "a10.png", "a.png", "b2.png",
        ];
        assert_eq!(names, expected);
    }

    #[test]
    fn gaps_stay_gaps_and_counting_begins_at_zero() {
        let four = ["f3.png", "f4.png", "f9.png", "f10.png"];
        assert_eq!(seconds(&four, &[]), (vec![0.0, 0.25, 1.5, 1.75], false));
        // An image beside them that has no pose is earlier.
        assert_eq!(seconds(&four, &["f1.png"]).0, [0.5, 0.75, 2.0, 2.25]);
        // The faces of a rig share the number of their frame.
        let faces = ["l/000.png", "l/001.png", "r/000.png", "r/001.png"];
        assert_eq!(seconds(&faces, &[]), (vec![0.0, 0.25, 0.0, 0.25], false));
        // Every tenth frame of a clip.
        assert_eq!(seconds(&["0.png", "10.png"], &[]), (vec![0.0, 2.5], true));
    }

    #[test]
    fn without_numbers_of_their_own_names_are_counted() {
        for names in [
            ["a.png", "b.png"],
            ["1_x2.png", "2_x2.png"],
            ["a.png", "b7.png"],
        ] {
            assert_eq!(seconds(&names, &[]), (vec![0.0, 0.25], true), "{names:?}");
        }
        let huge = ["99999999999999999999998.png", "99999999999999999999999.png"];
        assert_eq!(seconds(&huge, &[]).0, [0.0, 0.25]);
    }

    #[test]
    fn rows_without_names_need_files_that_are_counted() {
        let counted = |names: &[&str]| {
            let files: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
            are_counted(&files)
        };
        assert!(counted(&["0.png", "1.png", "2.png"]));
        assert!(counted(&["p08/001.jpg", "p08/002.jpg"]));
        assert!(!counted(&["0.png", "2.png"]));
        assert!(!counted(&["2.png", "3.png"]));
        assert!(!counted(&["0.png", "x.png"]));
    }
}
