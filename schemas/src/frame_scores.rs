//! `frames.csv`: scores of every view, beside a result.
//!
//! ```text
//! view,frame,time_seconds,distance_to_given,psnr,ssim
//! input,0,0,0,31.25,0.91
//! novel,5,0.5,0.12,,
//! ```
//!
//! `view` is `input` or `novel`. `distance_to_given` is the distance from the camera to the nearest camera of an
//! input view in world units, which tables of older versions do not have. An empty field has no value. Results are
//! submitted by others, so the table is text of which every byte is checked here.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{collections::BTreeSet, path::Path};

use crate::store::{self, StoreError};

/// File name of the table in the folder of a result.
pub const FRAME_SCORES_FILE: &str = "frames.csv";

/// Columns before those of the metrics.
const LEADING: [&str; 3] = ["view", "frame", "time_seconds"];
/// Column behind those of the metrics.
const DISTANCE: &str = "distance_to_given";
/// Largest size of a table, bytes; a million views with ten scores take less.
const MOST_BYTES: u64 = 256 << 20;

/// Scores of every view.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameScores {
    /// Ids of the metrics.
    pub metrics: Vec<String>,
    /// One row per view.
    pub rows: Vec<FrameRow>,
}

/// Scores of one view.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameRow {
    /// Kind of view: `input` or `novel`.
    pub view: String,
    /// Number of the frame in its scene.
    pub frame: u32,
    /// Time of the frame, seconds.
    pub time_seconds: f64,
    /// Distance from the camera to the nearest camera of an input view, world units, where both are known.
    pub distance_to_given: Option<f64>,
    /// Score of every metric, in their order; `None` where the view could not be scored, or the metric is not defined
    /// or not available.
    pub scores: Vec<Option<f64>>,
}

impl FrameScores {
    /// Reads a table.
    ///
    /// # Errors
    /// When the file cannot be read or is not such a table.
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        let bytes = store::read_limited(path, MOST_BYTES)?;
        let malformed =
            |reason| StoreError::malformed(path, format!("must be a table of views: {reason}"));
        Self::from_bytes(&bytes).map_err(malformed)
    }

    /// Reads a table from the bytes of its file.
    ///
    /// # Errors
    /// The reason in one line.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        if bytes.last().is_some_and(|&last| last != b'\n') {
            return Err("its last line is cut off".to_owned());
        }
        let mut reader = csv::Reader::from_reader(bytes);
        let header = reader.headers().map_err(|error| error.to_string())?.clone();
        if header.iter().take(LEADING.len()).ne(LEADING) {
            return Err(format!("its first columns are not {}", LEADING.join(", ")));
        }
        let has_distance = header.get(LEADING.len()) == Some(DISTANCE);
        let before = LEADING.len().saturating_add(usize::from(has_distance));
        let metrics = header.iter().skip(before).map(str::to_owned);
        let mut table = Self {
            metrics: metrics.collect(),
            rows: Vec::new(),
        };
        let mut known = BTreeSet::new();
        for record in reader.records() {
            let record = record.map_err(|error| error.to_string())?;
            let line = record.position().map_or(0, csv::Position::line);
            let row = row(&record, has_distance)
                .ok_or_else(|| format!("line {line} holds something else than numbers"))?;
            // A view that stands there twice would weigh double in every mean.
            if !known.insert((row.view.clone(), row.frame)) {
                let (view, frame) = (&row.view, row.frame);
                return Err(format!("line {line} has {view} view {frame} once more"));
            }
            table.rows.push(row);
        }
        Ok(table)
    }

    /// Writes the table, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), StoreError> {
        store::write_with(path, |writer| {
            let mut table = csv::Writer::from_writer(writer);
            let metrics = self.metrics.iter().map(String::as_str);
            table.write_record(LEADING.into_iter().chain([DISTANCE]).chain(metrics))?;
            for row in &self.rows {
                let leading = [
                    row.view.clone(),
                    row.frame.to_string(),
                    row.time_seconds.to_string(),
                ];
                let text = |score: &Option<f64>| score.map_or_else(String::new, |s| s.to_string());
                let numbers = [&row.distance_to_given].into_iter().chain(&row.scores);
                table.write_record(leading.into_iter().chain(numbers.map(text)))?;
            }
            table.flush()
        })
    }

    /// Returns the known scores of one kind of view by one metric; `None` without a column of the metric.
    pub fn of<'a>(&'a self, view: &'a str, metric: &str) -> Option<impl Iterator<Item = f64> + 'a> {
        let column = self.metrics.iter().position(|id| id == metric)?;
        let rows = self.rows.iter().filter(move |row| row.view == view);
        Some(rows.filter_map(move |row| row.scores.get(column).copied().flatten()))
    }
}

fn row(record: &csv::StringRecord, has_distance: bool) -> Option<FrameRow> {
    let number = |field: &str| match field {
        "" => Some(None),
        field => field.parse().ok().filter(|n: &f64| !n.is_nan()).map(Some),
    };
    let mut numbers = record.iter().skip(LEADING.len());
    let distance_to_given = match has_distance {
        true => number(numbers.next()?)?,
        false => None,
    };
    Some(FrameRow {
        view: record.get(0)?.to_owned(),
        frame: record.get(1)?.parse().ok()?,
        time_seconds: record.get(2)?.parse().ok()?,
        distance_to_given,
        scores: numbers.map(number).collect::<Option<_>>()?,
    })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;

    #[test]
    fn scores_come_back_as_they_were() {
        let row = |view: &str, frame, scores: &[Option<f64>]| FrameRow {
            view: view.to_owned(),
            frame,
            time_seconds: 0.1 * f64::from(frame),
            distance_to_given: (frame > 0).then_some(0.25),
            scores: scores.to_vec(),
        };
        let table = FrameScores {
            metrics: ["psnr", "ssim"].map(str::to_owned).to_vec(),
            rows: vec![
                row("input", 0, &[Some(1.0 / 3.0), Some(f64::INFINITY)]),
                row("novel", 7, &[None, Some(f64::MIN_POSITIVE)]),
            ],
        };
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join(FRAME_SCORES_FILE);
        table.write(&path).unwrap();
        assert_eq!(FrameScores::read(&path).unwrap(), table);
        let ssim: Vec<f64> = table.of("novel", "ssim").unwrap().collect();
        assert_eq!(ssim, [f64::MIN_POSITIVE]);
        assert_eq!(table.of("novel", "psnr").unwrap().count(), 0);
        assert!(table.of("novel", "lpips-vgg").is_none());
    }

    #[test]
    fn tables_of_older_versions_have_no_distances() {
        let text = "view,frame,time_seconds,psnr\ninput,0,0,31\n";
        let table = FrameScores::from_bytes(text.as_bytes()).unwrap();
        assert_eq!(table.metrics, ["psnr"]);
        assert_eq!(table.rows[0].distance_to_given, None);
        assert_eq!(table.rows[0].scores, [Some(31.0)]);
    }

    #[test]
    fn what_is_no_such_table_is_refused_with_the_place() {
        for (text, reason) in [
            ("", "first columns"),
            ("frame,view,time_seconds\n", "first columns"),
            ("view,frame,time_seconds,psnr\ninput,0,0\n", "3 fields"),
            ("view,frame,time_seconds,psnr\ninput,-1,0,1\n", "line 2"),
            (
                "view,frame,time_seconds,psnr\ninput,0,0,1\ninput,1,0,x\n",
                "line 3",
            ),
            ("view,frame,time_seconds,psnr\ninput,0,0,NaN\n", "line 2"),
            (
                "view,frame,time_seconds,psnr\ninput,7,0,1\nnovel,7,0,1\nnovel,7,0,1\n",
                "line 4 has novel view 7 once more",
            ),
            ("PAR1\u{0}\u{15}\n", "first columns"),
            ("view,frame,time_seconds,psnr\ninput,0,0,3", "cut off"),
        ] {
            let error = FrameScores::from_bytes(text.as_bytes()).unwrap_err();
            assert!(error.contains(reason), "{text:?}: {error}");
        }
    }
}
