//! Agreement of the JSON Schemas in `schemas/json/` with the types.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use omnilife_schemas::records::SCHEMAS;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("json")
}

/// Converts `omnilife/scene/1` to `scene.v1.schema.json`.
fn file_name(id: &str) -> String {
    let parts: Vec<_> = id.split('/').collect();
    assert_eq!((parts.len(), parts[0]), (3, "omnilife"), "{id}");
    assert!(parts[2].parse::<u32>().is_ok(), "{id}");
    format!("{}.v{}.schema.json", parts[1], parts[2])
}

/// Rewrites the files when the environment variable `UPDATE_SCHEMAS` is 1.
#[test]
fn files_match_the_types() -> io::Result<()> {
    let update = std::env::var("UPDATE_SCHEMAS").is_ok_and(|value| value == "1");
    for entry in SCHEMAS {
        let path = folder().join(file_name(entry.id));
        let text = serde_json::to_string_pretty(&(entry.generate)())? + "\n";
        if update {
            fs::write(&path, &text)?;
        }
        let stored = fs::read_to_string(&path)
            .map_err(|error| io::Error::other(format!("{}: {error}", path.display())))?;
        assert!(
            stored == text,
            "{} has drifted from its type; see `git diff` after UPDATE_SCHEMAS=1 cargo test -p \
             omnilife-schemas --test json_schemas, and raise the version if old files cannot be \
             read any more",
            path.display()
        );
    }
    Ok(())
}

#[test]
fn no_file_is_left_over() -> io::Result<()> {
    let expected: BTreeSet<_> = SCHEMAS.iter().map(|entry| file_name(entry.id)).collect();
    assert_eq!(expected.len(), SCHEMAS.len(), "ids are unique");
    let mut found = BTreeSet::new();
    for entry in fs::read_dir(folder())? {
        found.insert(entry?.file_name().to_string_lossy().into_owned());
    }
    assert_eq!(found, expected);
    Ok(())
}

#[test]
fn every_schema_asks_for_its_tag_and_explains_itself() {
    for entry in SCHEMAS {
        let schema = (entry.generate)();
        assert_eq!(
            schema.pointer("/properties/schema/const"),
            Some(&entry.id.into())
        );
        assert_eq!(
            schema.pointer("/required/0"),
            Some(&"schema".into()),
            "{}",
            entry.id
        );
        assert!(schema.get("description").is_some(), "{}", entry.id);
        let properties = schema.get("properties").and_then(|value| value.as_object());
        for (name, property) in properties.into_iter().flatten() {
            assert!(
                property.get("description").is_some(),
                "{} does not describe {name}",
                entry.id
            );
        }
    }
}
