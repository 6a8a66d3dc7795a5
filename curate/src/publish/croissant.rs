//! Croissant metadata of a dataset: JSON-LD that hubs and loaders of machine-learning data read
//! (<https://docs.mlcommons.org/croissant/docs/croissant-spec.html>, with the responsible-AI fields of
//! <https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html>).
//!
//! Unknown facts are not guessed: a required field is then filled with a note.

use omnilife_schemas::{layout::STATISTICS_FOLDER, records::About, store::sha256_bytes};
use serde_json::{Value, json};

use super::statistics::Statistics;

/// Name of the file in a published dataset.
pub(super) const FILE: &str = "croissant.json";

/// Columns of `sequences.csv` with their types in the vocabulary of schema.org, and their content.
const COLUMNS: &[(&str, &str, &str)] = &[
    ("sequence", "sc:Text", "id of the sequence"),
    ("folder", "sc:Text", "its folder in the dataset"),
    ("source", "sc:Text", "file name of the source video"),
    (
        "begin_seconds",
        "sc:Float",
        "where it begins in the source, seconds",
    ),
    (
        "end_seconds",
        "sc:Float",
        "where it ends in the source, seconds",
    ),
    ("duration_seconds", "sc:Float", "how long it is, seconds"),
    (
        "source_width",
        "sc:Integer",
        "width of the source in pixels",
    ),
    (
        "source_height",
        "sc:Integer",
        "height of the source in pixels",
    ),
    ("frames", "sc:Integer", "sampled frames"),
    ("group", "sc:Text", "semantic group of the scene"),
    ("scene", "sc:Text", "scene category"),
    ("action", "sc:Text", "action class of the camera's wearer"),
    ("ego_motion", "sc:Text", "ego-motion class"),
    ("dynamics", "sc:Text", "level of dynamic content"),
    ("posed_frames", "sc:Integer", "frames with a camera pose"),
    (
        "poses",
        "sc:Text",
        "outcome of the pose validation, empty without poses",
    ),
];

/// Returns the metadata; `sequences_csv` is the table that its record set reads.
pub(super) fn metadata(about: &About, statistics: &Statistics, sequences_csv: &str) -> String {
    let unstated = "not stated by the makers of the dataset";
    let description = about
        .description
        .as_deref()
        .unwrap_or("360-degree video, curated");
    let fields: Vec<Value> = COLUMNS
        .iter()
        .map(|(name, data_type, description)| {
            json!({
                "@type": "cr:Field",
                "@id": format!("sequences/{name}"),
                "name": name,
                "description": description,
                "dataType": data_type,
                "source": {
                    "fileObject": {"@id": "sequences.csv"},
                    "extract": {"column": name},
                },
            })
        })
        .collect();
    let dataset = json!({
        "@context": context(),
        "@type": "sc:Dataset",
        "conformsTo": [
            "http://mlcommons.org/croissant/1.0",
            "http://mlcommons.org/croissant/RAI/1.0",
        ],
        "name": about.name,
        "description": description,
        "license": about.licence.as_deref().unwrap_or(unstated),
        "version": "1.0.0",
        "keywords": ["360-degree video", "equirectangular", "3D reconstruction"],
        "rai:dataCollection": format!(
            "{} sequences from {} of {} videos, cut at shot boundaries and sampled by omnilife; \
             attrition.csv and funnel.csv say what was left out and why",
            statistics.rows.len(),
            statistics.curated_videos,
            statistics.videos
        ),
        "rai:dataLimitations": "classes that nobody annotated are given as \"not annotated\"; poses are \
                                marked by the outcome of their validation",
        "rai:dataBiases": unstated,
        "rai:personalSensitiveInformation": unstated,
        "rai:dataUseCases": "benchmarks of 3D reconstruction from 360-degree video",
        "distribution": [{
            "@type": "cr:FileObject",
            "@id": "sequences.csv",
            "name": "sequences.csv",
            "description": "one row per sequence",
            "contentUrl": format!("{STATISTICS_FOLDER}/sequences.csv"),
            "encodingFormat": "text/csv",
            "sha256": sha256_bytes(sequences_csv.as_bytes()),
        }],
        "recordSet": [{
            "@type": "cr:RecordSet",
            "@id": "sequences",
            "name": "sequences",
            "description": "the sequences of the dataset; their frames lie in the folder of each",
            "field": fields,
        }],
    });
    format!("{dataset:#}\n")
}

/// Returns the names that the specification requires in every file.
fn context() -> Value {
    json!({
        "@language": "en",
        "@vocab": "https://schema.org/",
        "citeAs": "cr:citeAs",
        "column": "cr:column",
        "conformsTo": "dct:conformsTo",
        "cr": "http://mlcommons.org/croissant/",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "data": {"@id": "cr:data", "@type": "@json"},
        "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
        "dct": "http://purl.org/dc/terms/",
        "equivalentProperty": "cr:equivalentProperty",
        "examples": {"@id": "cr:examples", "@type": "@json"},
        "extract": "cr:extract",
        "field": "cr:field",
        "fileProperty": "cr:fileProperty",
        "fileObject": "cr:fileObject",
        "fileSet": "cr:fileSet",
        "format": "cr:format",
        "includes": "cr:includes",
        "isLiveDataset": "cr:isLiveDataset",
        "jsonPath": "cr:jsonPath",
        "key": "cr:key",
        "md5": "cr:md5",
        "parentField": "cr:parentField",
        "path": "cr:path",
        "recordSet": "cr:recordSet",
        "references": "cr:references",
        "regex": "cr:regex",
        "repeated": "cr:repeated",
        "replace": "cr:replace",
        "samplingRate": "cr:samplingRate",
        "sc": "https://schema.org/",
        "separator": "cr:separator",
        "source": "cr:source",
        "subField": "cr:subField",
        "transform": "cr:transform",
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::publish::statistics::{SequenceRow, table};

    #[test]
    fn every_column_of_the_table_is_a_field() {
        let row = SequenceRow {
            sequence: "a/seq-000".to_owned(),
            folder: "videos/a/seq-000".to_owned(),
            source: "a.mp4".to_owned(),
            begin_seconds: 0.0,
            end_seconds: 1.0,
            duration_seconds: 1.0,
            source_width: 2,
            source_height: 1,
            frames: 1,
            group: "outdoor".to_owned(),
            scene: "street".to_owned(),
            action: "walking".to_owned(),
            ego_motion: "slow".to_owned(),
            dynamics: "low".to_owned(),
            posed_frames: 1,
            poses: "valid".to_owned(),
        };
        let table = table([&row]).expect("a table");
        let head: Vec<&str> = table
            .lines()
            .next()
            .unwrap_or_default()
            .split(',')
            .collect();
        let fields: Vec<&str> = COLUMNS.iter().map(|(name, ..)| *name).collect();
        assert_eq!(head, fields);
    }
}
