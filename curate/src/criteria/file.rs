//! User-defined criteria, as a TOML file.
//!
//! ```toml
//! name = "our-lab"                    # in records, beside every outcome
//!
//! [thresholds]
//! native_erp = true
//! least_width_pixels = 2880
//! least_frames_per_second = 24.0
//! longer_than_seconds = 10.0
//! undamaged = true
//! largest_overlay_steradians = 0.05
//! largest_mosaic_share = 0.1
//! ```
//!
//! Criteria that are not named are not checked.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::Path;

use omnilife_schemas::toml_file;
use serde::Deserialize;

use super::{Criteria, PROFILES, Thresholds};
use crate::error::CurateError;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CriteriaFile {
    name: String,
    thresholds: Thresholds,
}

pub(super) fn read(path: &Path) -> Result<Criteria, CurateError> {
    let file: CriteriaFile = toml_file::read(path)?;
    let refuse = |reason: String| Err(CurateError::input(path, reason));
    if file.name.is_empty() || !file.name.chars().all(is_name_character) {
        return refuse(format!(
            "a name is of lower-case letters, digits and -, not {:?}",
            file.name
        ));
    }
    // A record states by its name which criteria a video was checked against.
    if PROFILES.iter().any(|profile| profile.id == file.name) {
        return refuse(format!("{} is the name of published criteria", file.name));
    }
    let Thresholds {
        least_frames_per_second,
        longer_than_seconds,
        largest_overlay_steradians,
        largest_mosaic_share,
        ..
    } = file.thresholds;
    let numbers = [
        ("least_frames_per_second", least_frames_per_second),
        ("longer_than_seconds", longer_than_seconds),
        ("largest_overlay_steradians", largest_overlay_steradians),
        ("largest_mosaic_share", largest_mosaic_share),
    ];
    for (key, number) in numbers {
        if number.is_some_and(|number| !(number.is_finite() && number >= 0.0)) {
            return refuse(format!("{key} is a number from 0 on"));
        }
    }
    Ok(Criteria {
        name: file.name,
        thresholds: file.thresholds,
    })
}

fn is_name_character(c: char) -> bool {
    c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-'
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn read_text(text: &str) -> Result<Criteria, String> {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("criteria.toml");
        fs::write(&path, text).expect("written");
        read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn a_file_asks_for_what_it_names() {
        let criteria =
            read_text("name = 'short'\n[thresholds]\nlonger_than_seconds = 3.5\n").expect("read");
        assert_eq!(criteria.name, "short");
        assert_eq!(
            criteria.thresholds,
            Thresholds {
                longer_than_seconds: Some(3.5),
                ..Thresholds::default()
            }
        );
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_a_reason() {
        for (text, reason) in [
            ("name = 'a'\n[thresholds]\nwidest = 3\n", "widest"),
            (
                "name = 'a'\n[thresholds]\nleast_width_pixels = -1\n",
                "line 3",
            ),
            (
                "name = 'a'\n[thresholds]\nlonger_than_seconds = nan\n",
                "from 0 on",
            ),
            ("name = 'omnilife360'\n[thresholds]\n", "published criteria"),
            ("name = 'A b'\n[thresholds]\n", "lower-case"),
            ("[thresholds]\nundamaged = true\n", "name"),
            ("name = ", "line 1"),
        ] {
            let error = read_text(text).expect_err(text);
            assert!(
                error.contains("criteria.toml") && error.contains(reason),
                "{error}"
            );
        }
    }
}
