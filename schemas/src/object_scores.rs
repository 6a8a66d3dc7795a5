//! `objects.csv`: scores of every object in every view, beside a result.
//!
//! ```text
//! view,frame,object,psnr-object,ssim-object
//! input,0,car-1,31.25,0.91
//! input,0,walker,28.5,
//! ```
//!
//! A row is of an object that a scored view shows. An empty field has no value.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{collections::BTreeSet, path::Path};

use crate::store::{self, StoreError};

/// File name of the table in the folder of a result.
pub const OBJECT_SCORES_FILE: &str = "objects.csv";

/// Columns before those of the metrics.
const LEADING: [&str; 3] = ["view", "frame", "object"];
/// Largest size of a table, bytes.
const MOST_BYTES: u64 = 256 << 20;

/// Scores of every object in every view.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ObjectScores {
    /// Ids of the metrics.
    pub metrics: Vec<String>,
    /// One row per object and view.
    pub rows: Vec<ObjectRow>,
}

/// Scores of an object in a view.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectRow {
    /// Kind of view: `input` or `novel`.
    pub view: String,
    /// Number of the frame in its scene.
    pub frame: u32,
    /// Name of the object.
    pub object: String,
    /// Score of every metric, in their order; `None` where the metric is not defined.
    pub scores: Vec<Option<f64>>,
}

impl ObjectScores {
    /// Reads a table.
    ///
    /// # Errors
    /// When the file cannot be read or is not such a table.
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        let bytes = store::read_limited(path, MOST_BYTES)?;
        let malformed =
            |reason| StoreError::malformed(path, format!("must be a table of objects: {reason}"));
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
        let metrics = header.iter().skip(LEADING.len()).map(str::to_owned);
        let mut table = Self {
            metrics: metrics.collect(),
            rows: Vec::new(),
        };
        let mut known = BTreeSet::new();
        for record in reader.records() {
            let record = record.map_err(|error| error.to_string())?;
            let line = record.position().map_or(0, csv::Position::line);
            let row = row(&record)
                .ok_or_else(|| format!("line {line} holds something else than numbers"))?;
            // An object that stands there twice would weigh double in its means.
            if !known.insert((row.view.clone(), row.frame, row.object.clone())) {
                let (view, frame, object) = (&row.view, row.frame, &row.object);
                return Err(format!(
                    "line {line} has {object} in {view} view {frame} once more"
                ));
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
            table.write_record(LEADING.into_iter().chain(metrics))?;
            for row in &self.rows {
                let leading = [row.view.clone(), row.frame.to_string(), row.object.clone()];
                let text = |score: &Option<f64>| score.map_or_else(String::new, |s| s.to_string());
                table.write_record(leading.into_iter().chain(row.scores.iter().map(text)))?;
            }
            table.flush()
        })
    }

    /// Returns the known scores of an object in one kind of view by one metric; `None` without a column of the metric.
    pub fn of<'a>(
        &'a self,
        view: &'a str,
        object: &'a str,
        metric: &str,
    ) -> Option<impl Iterator<Item = f64> + 'a> {
        let column = self.metrics.iter().position(|id| id == metric)?;
        let rows = self.rows.iter();
        let rows = rows.filter(move |row| row.view == view && row.object == object);
        Some(rows.filter_map(move |row| row.scores.get(column).copied().flatten()))
    }
}

fn row(record: &csv::StringRecord) -> Option<ObjectRow> {
    let number = |field: &str| match field {
        "" => Some(None),
        field => field.parse().ok().filter(|n: &f64| !n.is_nan()).map(Some),
    };
    Some(ObjectRow {
        view: record.get(0)?.to_owned(),
        frame: record.get(1)?.parse().ok()?,
        object: record.get(2)?.to_owned(),
        scores: record
            .iter()
            .skip(LEADING.len())
            .map(number)
            .collect::<Option<_>>()?,
    })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;

    #[test]
    fn scores_come_back_as_they_were() {
        let row = |frame, object: &str, scores: &[Option<f64>]| ObjectRow {
            view: "input".to_owned(),
            frame,
            object: object.to_owned(),
            scores: scores.to_vec(),
        };
        let table = ObjectScores {
            metrics: ["psnr-object", "ssim-object"].map(str::to_owned).to_vec(),
            rows: vec![
                row(0, "car, red", &[Some(1.0 / 3.0), None]),
                row(4, "car, red", &[Some(2.5), Some(0.5)]),
                row(4, "walker é", &[None, None]),
            ],
        };
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join(OBJECT_SCORES_FILE);
        table.write(&path).unwrap();
        assert_eq!(ObjectScores::read(&path).unwrap(), table);
        let scores = |object, metric| -> Option<Vec<f64>> {
            table.of("input", object, metric).map(Iterator::collect)
        };
        assert_eq!(
            scores("car, red", "psnr-object"),
            Some(vec![1.0 / 3.0, 2.5])
        );
        assert_eq!(scores("walker é", "ssim-object"), Some(Vec::new()));
        assert_eq!(scores("car, red", "psnr"), None);
    }

    #[test]
    fn what_is_no_such_table_is_refused_with_the_place() {
        for (text, reason) in [
            ("view,frame,time_seconds\n", "first columns"),
            ("view,frame,object,psnr\ninput,0,a,NaN\n", "line 2"),
            ("view,frame,object,psnr\ninput,-1,a,1\n", "line 2"),
            (
                "view,frame,object,psnr\ninput,0,a,1\ninput,0,b,1\ninput,0,a,1\n",
                "line 4 has a in input view 0 once more",
            ),
            ("view,frame,object,psnr\ninput,0,a,3", "cut off"),
        ] {
            let error = ObjectScores::from_bytes(text.as_bytes()).unwrap_err();
            assert!(error.contains(reason), "{text:?}: {error}");
        }
    }
}
