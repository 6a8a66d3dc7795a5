//! Tables of tags and captions that people write: CSV with a head, or a JSON list.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{collections::BTreeSet, path::Path};

use omnilife_schemas::store::{self, StoreError};
use serde::{Deserialize, Deserializer};

use crate::error::CurateError;

/// One row: the statements of one author on a sequence. Empty cells state nothing.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TagRow {
    /// Id of the sequence, `<video>/<seq-NNN>`.
    pub sequence: String,
    /// Author.
    pub author: String,
    /// Scene category.
    #[serde(default, deserialize_with = "filled")]
    pub scene: Option<String>,
    /// Action class.
    #[serde(default, deserialize_with = "filled")]
    pub action: Option<String>,
    /// True for a seamless traversal between indoors and outdoors.
    #[serde(default)]
    pub traversal: Option<bool>,
    /// A description.
    #[serde(default, deserialize_with = "filled")]
    pub caption: Option<String>,
}

/// Deserializes an empty cell as `None`.
fn filled<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    let text = Option::<String>::deserialize(deserializer)?;
    Ok(text.filter(|text| !text.trim().is_empty()))
}

/// Reads a table; its extension gives the format.
///
/// # Errors
/// When it is missing or malformed.
pub fn read(path: &Path) -> Result<Vec<TagRow>, CurateError> {
    let bytes = std::fs::read(path).map_err(|error| StoreError::read(path, error))?;
    from_bytes(path, &bytes)
}

/// Reads the bytes of a table; `path` names it.
///
/// # Errors
/// When they are malformed.
pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Vec<TagRow>, CurateError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let text = std::str::from_utf8(bytes).map_err(|_| malformed("is not UTF-8".to_owned()))?;
    let text = text.trim_start_matches('\u{feff}');
    let is_json = path
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let rows: Vec<TagRow> = if is_json {
        serde_json::from_str(text).map_err(|error| malformed(store::json_fault(text, &error)))?
    } else {
        let mut table = csv::Reader::from_reader(text.as_bytes());
        let unreadable = |error: csv::Error| malformed(error.to_string());
        let head = table.headers().map_err(unreadable)?.clone();
        let rows: Vec<TagRow> = table
            .deserialize()
            .collect::<Result<_, _>>()
            .map_err(unreadable)?;
        // Without rows nothing else has checked the header.
        let lacks = |name: &&&str| !head.iter().any(|column| column == **name);
        if let Some(missing) = ["sequence", "author"].iter().find(lacks) {
            return Err(malformed(format!("has no column {missing}")).into());
        }
        rows
    };
    Ok(rows)
}

/// Returns a line on every property of which the rows of a sequence have several values, the last of which is kept.
/// Captions of several authors stand side by side.
pub fn contradictions(rows: &[&TagRow]) -> Vec<String> {
    let property = |name: &str, of: &dyn Fn(&TagRow) -> Option<String>| {
        let values: Vec<(String, &str)> = (rows.iter())
            .filter_map(|row| Some((of(row)?, row.author.as_str())))
            .collect();
        let (kept, _) = values.last()?;
        let differs = values.iter().any(|(value, _)| value != kept);
        let said: Vec<String> = (values.iter())
            .map(|(value, author)| format!("{value} by {author}"))
            .collect();
        differs.then(|| format!("{name} is {}; the last is kept", said.join(", ")))
    };
    let captions = |author: &str| {
        property("caption", &|row| {
            row.caption.clone().filter(|_| row.author == author)
        })
    };
    let authors: BTreeSet<&str> = rows.iter().map(|row| row.author.as_str()).collect();
    let tags = [
        property("scene", &|row| row.scene.clone()),
        property("action", &|row| row.action.clone()),
        property("traversal", &|row| Some(row.traversal?.to_string())),
    ];
    (tags.into_iter().flatten())
        .chain(authors.into_iter().filter_map(captions))
        .collect()
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;

    #[test]
    fn a_table_without_its_columns_is_refused_even_without_rows() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("tags.csv");
        for text in ["", "garbage", "sequence,scene\n"] {
            std::fs::write(&file, text).unwrap();
            let message = read(&file).unwrap_err().to_string();
            assert!(message.contains("has no column"), "{text:?}: {message}");
        }
        std::fs::write(&file, "sequence,author\n").unwrap();
        assert!(read(&file).unwrap().is_empty());
    }

    #[test]
    fn contradictions_are_listed_by_property() {
        let row = |author: &str, scene: Option<&str>, caption: Option<&str>| TagRow {
            sequence: "a/seq-000".to_owned(),
            author: author.to_owned(),
            scene: scene.map(str::to_owned),
            action: None,
            traversal: Some(true),
            caption: caption.map(str::to_owned),
        };
        let ann = row("Ann", Some("reef"), Some("Fish."));
        let same = row("Bob", Some("reef"), Some("A diver."));
        assert_eq!(contradictions(&[&ann, &same]), [""; 0]);
        let other = row("Bob", Some("beach"), None);
        let found = contradictions(&[&ann, &same, &other]);
        assert_eq!(
            found,
            ["scene is reef by Ann, reef by Bob, beach by Bob; the last is kept"]
        );
        let again = row("Ann", None, Some("Corals."));
        assert_eq!(contradictions(&[&ann, &again, &same]).len(), 1);
    }

    #[test]
    fn files_of_windows_programs_are_read() {
        let row = r#"{"sequence": "a/seq-000", "author": "Ann", "caption": "A street."}"#;
        let list = format!("\u{feff}[\r\n{row}\r\n]\r\n");
        let table = "\u{feff}sequence,author,caption\r\na/seq-000,Ann,A street.\r\n";
        let rows = from_bytes(Path::new("TAGS.JSON"), list.as_bytes()).unwrap();
        assert_eq!(rows.len(), 1);
        assert_eq!(
            rows,
            from_bytes(Path::new("TAGS.CSV"), table.as_bytes()).unwrap()
        );
    }
}
