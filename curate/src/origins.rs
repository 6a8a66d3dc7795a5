//! Origins of videos: a list kept beside them, CSV with a head or JSON.
//!
//! The columns are `file`, `url`, `uploader`, `licence`, `date`, `keywords` (between semicolons) and `kind` (`web` or
//! `own-capture`); all but `file` may be left out. A row applies to the video with this path as given, name in
//! `dataset.json` or file name.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::DATASET_FILE,
    progress::Progress,
    records::{Dataset, Origin, OriginKind},
    store::{self, StoreError},
};
use serde::Deserialize;

use crate::error::CurateError;

/// A longer list is refused before it is read.
const MOST_BYTES: u64 = 256 << 20;

/// Content of a list, by the files as it names them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Origins {
    rows: BTreeMap<String, Origin>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    file: String,
    #[serde(default)]
    url: Option<String>,
    #[serde(default)]
    uploader: Option<String>,
    #[serde(default, alias = "license")]
    licence: Option<String>,
    #[serde(default)]
    date: Option<String>,
    #[serde(default)]
    keywords: Option<Keywords>,
    #[serde(default)]
    kind: Option<String>,
}

/// A list, or words between semicolons.
#[derive(Deserialize)]
#[serde(untagged)]
enum Keywords {
    List(Vec<String>),
    Text(String),
}

/// Reads a list; a name that ends in `.json` means JSON.
///
/// # Errors
/// When it is missing or malformed, names a file twice, or has an invalid date or kind.
pub fn read(path: &Path) -> Result<Origins, CurateError> {
    from_bytes(path, &store::read_limited(path, MOST_BYTES)?)
}

/// Reads the bytes of a list; `path` names it.
///
/// # Errors
/// Those of [`read`].
pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Origins, CurateError> {
    let malformed = |reason: String| CurateError::from(StoreError::malformed(path, reason));
    let text = std::str::from_utf8(bytes).map_err(|_| malformed("is not UTF-8".to_owned()))?;
    let text = text.trim_start_matches('\u{feff}');
    let is_json = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let rows: Vec<Row> = if is_json {
        serde_json::from_str(text).map_err(|error| malformed(store::json_fault(text, &error)))?
    } else {
        let mut table = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_reader(text.as_bytes());
        let unreadable = |error: csv::Error| malformed(error.to_string());
        let head = table.headers().map_err(unreadable)?.clone();
        if !head.iter().any(|column| column == "file") {
            let found: Vec<&str> = head.iter().collect();
            return Err(malformed(format!(
                "has no column file, its columns are {:?}",
                found.join(",")
            )));
        }
        let rows: Result<Vec<Row>, csv::Error> = table.deserialize().collect();
        rows.map_err(unreadable)?
    };
    let mut origins = Origins::default();
    for row in rows {
        let file = row.file.trim().to_owned();
        let origin = row.origin().map_err(malformed)?;
        if origins.rows.insert(file.clone(), origin).is_some() {
            return Err(malformed(format!("names {file:?} twice")));
        }
    }
    Ok(origins)
}

impl Row {
    fn origin(self) -> Result<Origin, String> {
        if self.file.trim().is_empty() {
            return Err("has a row without a file".to_owned());
        }
        let filled = |text: Option<String>| {
            let text = text.map(|text| text.trim().to_owned());
            text.filter(|text| !text.is_empty())
        };
        let keywords: Vec<String> = match self.keywords {
            None => Vec::new(),
            Some(Keywords::List(list)) => list,
            Some(Keywords::Text(text)) => text.split(';').map(str::to_owned).collect(),
        };
        let date = filled(self.date);
        if let Some(date) = date.as_deref().filter(|date| !is_date(date)) {
            return Err(format!(
                "{}: the date must be like 2026, 2026-05 or 2026-05-31, got {date:?}",
                self.file
            ));
        }
        let kind = match filled(self.kind).as_deref() {
            None => None,
            Some("web") => Some(OriginKind::Web),
            Some("own-capture") => Some(OriginKind::OwnCapture),
            Some(other) => {
                return Err(format!(
                    "{}: {other:?} is neither web nor own-capture",
                    self.file
                ));
            }
        };
        Ok(Origin {
            url: filled(self.url),
            uploader: filled(self.uploader),
            licence: filled(self.licence),
            date,
            keywords: keywords
                .into_iter()
                .filter_map(|word| filled(Some(word)))
                .collect(),
            kind,
        })
    }
}

/// Returns true if a text is a year, a month or a day of ISO 8601.
fn is_date(text: &str) -> bool {
    let parts: Vec<&str> = text.split('-').collect();
    let number = |part: &str, digits: usize, most: u32| {
        let is_number = part.len() == digits && part.bytes().all(|byte| byte.is_ascii_digit());
        is_number
            && part
                .parse()
                .is_ok_and(|value: u32| (1..=most).contains(&value))
    };
    match parts.as_slice() {
        [year] => number(year, 4, 9999),
        [year, month] => number(year, 4, 9999) && number(month, 2, 12),
        [year, month, day] => number(year, 4, 9999) && number(month, 2, 12) && number(day, 2, 31),
        _ => false,
    }
}

impl Origins {
    /// Enters a list into the record of a dataset of `videos`, and writes it. Rows without a video, and videos without
    /// a row, are reported in one line each; `list` names the list there.
    ///
    /// # Errors
    /// When the record cannot be written.
    pub fn enter(
        &self,
        list: &Path,
        videos: &[PathBuf],
        record: &mut Dataset,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<(), CurateError> {
        let mut unused: BTreeMap<&str, &Origin> = self
            .rows
            .iter()
            .map(|(file, origin)| (file.as_str(), origin))
            .collect();
        for (video, path) in record.videos.iter_mut().zip(videos) {
            let shown = path.display().to_string();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let keys = [shown.as_str(), video.file.as_str(), &*name];
            let row = keys
                .into_iter()
                .find_map(|key| self.rows.get_key_value(key));
            match row {
                Some((key, origin)) => {
                    unused.remove(key.as_str());
                    video.origin = Some(origin.clone());
                }
                None => progress.note(&format!("{shown}: {} says nothing of it", list.display())),
            }
        }
        for file in unused.keys() {
            progress.note(&format!(
                "{}: {file} is not one of the videos",
                list.display()
            ));
        }
        Ok(store::write_record(&out.join(DATASET_FILE), record)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_as(name: &str, text: &str) -> Result<Origins, String> {
        from_bytes(Path::new(name), text.as_bytes()).map_err(|error| error.to_string())
    }

    #[test]
    fn tables_and_lists_say_the_same() {
        let table = "\u{feff}file,url,uploader,licence,date,keywords,kind\n\
                     a.mp4,https://e.org/v?x=1,\"Ann, B.\",CC-BY-4.0,2026-05-31,night; market ;,web\n\
                     b.mp4,,,,2025,,own-capture\n";
        let list = r#"[{"file": "a.mp4", "url": "https://e.org/v?x=1", "uploader": "Ann, B.",
            "license": "CC-BY-4.0", "date": "2026-05-31", "keywords": ["night", "market"], "kind": "web"},
            {"file": "b.mp4", "date": "2025", "kind": "own-capture"}]"#;
        let read = read_as("a.csv", table).expect("a table");
        assert_eq!(Ok(&read), read_as("a.json", list).as_ref());
        let first = &read.rows["a.mp4"];
        assert_eq!(first.keywords, ["night", "market"]);
        assert_eq!(first.kind, Some(OriginKind::Web));
        assert_eq!(read.rows["b.mp4"].url, None);
    }

    #[test]
    fn what_is_no_list_is_refused_in_one_line() {
        for (text, said) in [
            ("", "no column file"),
            ("name\nx\n", "no column file"),
            // Spreadsheets of some countries.
            ("file;url\na.mp4;x\n", "file;url"),
            ("file,colour\nx,red\n", "unknown field"),
            ("file\n \n", "without a file"),
            ("file\na.mp4\na.mp4\n", "twice"),
            ("file,date\na.mp4,yesterday\n", "the date must be like"),
            ("file,date\na.mp4,2026-13\n", "the date must be like"),
            ("file,kind\na.mp4,stolen\n", "neither web"),
        ] {
            let message = read_as("list.csv", text).expect_err(text);
            assert!(
                message.contains(said) && message.contains("list.csv"),
                "{text:?}: {message}"
            );
            assert_eq!(message.lines().count(), 1, "{message}");
        }
        assert!(read_as("list.json", "{}").is_err());
    }
}
