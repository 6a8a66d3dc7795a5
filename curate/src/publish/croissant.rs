//! Croissant metadata of a dataset: JSON-LD that hubs and loaders of machine-learning data read
//! (<https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html>, with the responsible-AI fields of
//! <https://docs.mlcommons.org/croissant/docs/croissant-rai-spec.html>).
//!
//! Unknown facts are not guessed: their fields are left out.

use std::collections::BTreeSet;

use omnilife_schemas::store::sha256_bytes;
use serde_json::{Value, json};

use super::{Release, kinds::Column, statements::QUESTIONS, tables::Table};

/// Name of the file in a published dataset.
pub(super) const FILE: &str = "croissant.json";

/// Returns the metadata. Every table is a record set, in which files of images stand with their content.
pub(super) fn metadata(release: &Release<'_>) -> String {
    let activities = release.activities();
    let footage = release.footage();
    let keywords = [footage.keywords, &["3D reconstruction"]].concat();
    let mut dataset = json!({
        "@context": context(),
        "@type": "sc:Dataset",
        "conformsTo": [
            "http://mlcommons.org/croissant/1.1",
            "http://mlcommons.org/croissant/RAI/1.0",
        ],
        "name": release.about.name,
        "description": format!("Curated {}", footage.words),
        "keywords": keywords,
        "rai:dataCollection": release.collection(),
        "rai:dataCollectionMissingData": "classes without annotation are given as \"not annotated\"; frames \
                                          without a pose are not in the record set of poses",
        "prov:wasGeneratedBy": activities
            .map(|label| json!({"@type": "prov:Activity", "prov:label": label}))
            .collect::<Value>(),
        "distribution": release.tables.iter().flat_map(resources).collect::<Value>(),
        "recordSet": release.tables.iter().map(record_set).collect::<Value>(),
    });
    for question in QUESTIONS {
        if let (Some(property), Some(answer)) =
            (question.property, release.answers.get(question.key))
        {
            dataset[property] = match (question.key, answer) {
                ("creators", Value::Array(names)) => names.iter().map(person).collect(),
                ("sources", Value::Array(sources)) => sources.iter().map(source).collect(),
                _ => answer.clone(),
            };
        }
    }
    format!("{dataset:#}\n")
}

fn person(name: &Value) -> Value {
    json!({"@type": "sc:Person", "name": name})
}

fn source(source: &Value) -> Value {
    let mut entity = json!({"@type": "prov:Entity", "prov:label": source});
    if source.as_str().is_some_and(|text| text.contains("://")) {
        entity["@id"] = source.clone();
    }
    entity
}

/// Returns the file of a table, and the images that it names.
fn resources(table: &Table) -> Vec<Value> {
    let name = table.kind.name;
    let file = json!({
        "@type": "cr:FileObject",
        "@id": format!("{name}.csv"),
        "name": format!("{name}.csv"),
        "contentUrl": table.file,
        "encodingFormat": "text/csv",
        "sha256": sha256_bytes(table.csv.as_bytes()),
    });
    if table.images.is_empty() {
        return vec![file];
    }
    let formats = table.images.iter().map(|pattern| {
        let is_png = pattern.ends_with(".png");
        if is_png { "image/png" } else { "image/jpeg" }
    });
    let images = json!({
        "@type": "cr:FileSet",
        "@id": format!("{name}-files"),
        "name": format!("{name}-files"),
        "encodingFormat": formats.collect::<BTreeSet<_>>(),
        "includes": table.images,
    });
    vec![file, images]
}

fn record_set(table: &Table) -> Value {
    let kind = table.kind;
    let mut fields: Vec<Value> = (kind.columns.iter())
        .map(|column| field(table, column))
        .collect();
    if !kind.images.is_empty() {
        fields.push(json!({
            "@type": "cr:Field",
            "@id": format!("{}/image", kind.name),
            "name": "image",
            "description": "content of the file",
            "dataType": kind.images,
            "source": {
                "fileSet": {"@id": format!("{}-files", kind.name)},
                "extract": {"fileProperty": "content"},
            },
        }));
    }
    json!({
        "@type": "cr:RecordSet",
        "@id": kind.name,
        "name": kind.name,
        "description": kind.about,
        "field": fields,
    })
}

fn field(table: &Table, (name, types, about): &Column) -> Value {
    let kind = table.kind;
    let column = json!({
        "fileObject": {"@id": format!("{}.csv", kind.name)},
        "extract": {"column": name},
    });
    let mut field = json!({
        "@type": "cr:Field",
        "@id": format!("{}/{name}", kind.name),
        "name": name,
        "description": about,
        "dataType": types,
        "source": column,
    });
    if !kind.images.is_empty() && *name == "file" {
        // The images lead and the table follows: mlcroissant compares paths as text only behind a transform, and
        // transforms the left side of a join alone.
        field["source"] = json!({
            "fileSet": {"@id": format!("{}-files", kind.name)},
            "extract": {"fileProperty": "fullpath"},
            "transform": {"regex": "(.*)"},
        });
        field["references"] = column;
    }
    field
}

/// Names of Croissant's vocabulary that the context gives as they are.
const NAMES: &[&str] = &[
    "arrayShape",
    "citeAs",
    "column",
    "containedIn",
    "equivalentProperty",
    "extract",
    "field",
    "fileObject",
    "fileProperty",
    "fileSet",
    "format",
    "includes",
    "isArray",
    "isLiveDataset",
    "jsonPath",
    "key",
    "md5",
    "parentField",
    "path",
    "recordSet",
    "references",
    "regex",
    "repeated",
    "replace",
    "samplingRate",
    "separator",
    "source",
    "subField",
    "transform",
];

/// Returns the names that the specification requires in every file.
fn context() -> Value {
    let mut context = json!({
        "@language": "en",
        "@vocab": "https://schema.org/",
        "conformsTo": "dct:conformsTo",
        "cr": "http://mlcommons.org/croissant/",
        "data": {"@id": "cr:data", "@type": "@json"},
        "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
        "dct": "http://purl.org/dc/terms/",
        "description": {"@container": "@language"},
        "examples": {"@id": "cr:examples", "@type": "@json"},
        "name": {"@container": "@language"},
        "prov": "http://www.w3.org/ns/prov#",
        "rai": "http://mlcommons.org/croissant/RAI/",
        "sc": "https://schema.org/",
    });
    for name in NAMES {
        context[*name] = format!("cr:{name}").into();
    }
    context
}
