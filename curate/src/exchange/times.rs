//! `times.csv`: the time of each exported frame, which no foreign format holds.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::store::{self, StoreError};
use serde::{Deserialize, Serialize};

use super::ExportFrame;

/// Name of the table in an exported folder.
pub(super) const TIMES_FILE: &str = "times.csv";

#[derive(Serialize, Deserialize)]
struct Row {
    image: String,
    time_seconds: f64,
}

/// Writes the table of an export.
pub(super) fn write(frames: &[ExportFrame], folder: &Path) -> Result<(), StoreError> {
    let rows = frames.iter().map(|frame| Row {
        image: frame.name.clone(),
        time_seconds: frame.time_seconds,
    });
    store::write_csv_rows(&folder.join(TIMES_FILE), rows)
}

/// Times of images by their name.
pub(super) struct TimeTable {
    path: PathBuf,
    rows: Vec<(String, f64)>,
}

/// Times of frames from a table.
pub(super) struct TableTimes {
    /// Seconds, one for each frame.
    pub(super) seconds: Vec<f64>,
    /// A note if the table names other images.
    pub(super) note: Option<String>,
}

impl TimeTable {
    /// Returns the table of a folder, if it has one.
    ///
    /// # Errors
    /// When the table is malformed.
    pub(super) fn read(folder: &Path) -> Result<Option<Self>, StoreError> {
        let path = folder.join(TIMES_FILE);
        if !path.is_file() {
            return Ok(None);
        }
        let malformed = |reason: String| StoreError::malformed(&path, reason);
        let mut names = BTreeSet::new();
        let mut rows = Vec::new();
        let text = store::read_text(&path)?;
        for row in csv::Reader::from_reader(text.as_bytes()).deserialize() {
            let row: Row = row.map_err(|error: csv::Error| malformed(error.to_string()))?;
            if !row.time_seconds.is_finite() || !names.insert(row.image.clone()) {
                let reason = format!("{} is there twice or has no finite time", row.image);
                return Err(malformed(reason));
            }
            rows.push((row.image, row.time_seconds));
        }
        Ok(Some(Self { path, rows }))
    }

    /// Returns the time of an image by its name in the table.
    pub(super) fn seconds_of(&self, image: &str) -> Option<f64> {
        let mut rows = self.rows.iter();
        rows.find(|(name, _)| name == image).map(|(_, time)| *time)
    }

    /// Returns the times of frames, each by one of its two names: that of its file, and that with the folder before it.
    /// `others` are images that exist as well and may have a row. A table with unknown names and a row for every frame
    /// is taken in its order: formats that number their frames have renamed them.
    ///
    /// # Errors
    /// For a frame without a row, and a row without an image.
    pub(super) fn of(
        &self,
        frames: &[[String; 2]],
        others: &[[String; 2]],
    ) -> Result<TableTimes, StoreError> {
        let by_name: BTreeMap<&str, f64> = self
            .rows
            .iter()
            .map(|(name, time)| (name.as_str(), *time))
            .collect();
        let found: Vec<Option<f64>> = frames
            .iter()
            .map(|names| {
                names
                    .iter()
                    .find_map(|name| by_name.get(name.as_str()))
                    .copied()
            })
            .collect();
        if found.iter().all(Option::is_none) && self.rows.len() == frames.len() {
            return Ok(TableTimes {
                seconds: self.rows.iter().map(|(_, time)| *time).collect(),
                note: Some(format!(
                    "{TIMES_FILE} has other names than the images, and is taken row by row"
                )),
            });
        }
        let known: BTreeSet<&String> = frames.iter().chain(others).flatten().collect();
        let malformed = |reason: String| StoreError::malformed(&self.path, reason);
        if let Some((extra, _)) = self.rows.iter().find(|(name, _)| !known.contains(name)) {
            return Err(malformed(format!(
                "has a time for {extra}, which is not an image"
            )));
        }
        let seconds = frames.iter().zip(found).map(|([name, _], time)| {
            time.ok_or_else(|| malformed(format!("has no time for {name}")))
        });
        Ok(TableTimes {
            seconds: seconds.collect::<Result<_, _>>()?,
            note: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<[String; 2]> {
        let both = |name: &&str| [(*name).to_owned(), format!("rgb/{name}")];
        names.iter().map(both).collect()
    }

    #[test]
    fn a_table_fits_as_a_whole_or_not_at_all() {
        let table = TimeTable {
            path: PathBuf::from("times.csv"),
            rows: vec![("7.png".to_owned(), 2.5), ("rgb/8.png".to_owned(), 0.5)],
        };
        let of = |frames: &[&str], others: &[&str]| {
            let times = table.of(&names(frames), &names(others));
            times
                .map(|times| times.seconds)
                .map_err(|error| error.to_string())
        };
        assert_eq!(of(&["8.png", "7.png"], &[]), Ok(vec![0.5, 2.5]));
        // Images that a format has renumbered.
        assert_eq!(of(&["000.png", "001.png"], &[]), Ok(vec![2.5, 0.5]));
        // An image without a pose may have a row.
        assert_eq!(of(&["8.png"], &["7.png"]), Ok(vec![0.5]));
        for (frames, named) in [
            (&["7.png"][..], "8.png"),
            (&["7.png", "9.png"][..], "8.png"),
            (&["7.png", "8.png", "9.png"][..], "9.png"),
        ] {
            assert!(
                of(frames, &[]).is_err_and(|line| line.contains(named)),
                "{frames:?}"
            );
        }
    }
}
