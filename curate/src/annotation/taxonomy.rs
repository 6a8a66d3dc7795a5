//! The taxonomy: scene categories and actions, and their groups.

use std::{collections::BTreeSet, path::Path};

use omnilife_schemas::{
    records::{NameGroup, Taxonomy},
    store::{self, StoreError},
};

/// The taxonomy that comes with the program: 3 semantic groups with 64 scene categories and 4
/// ego-motion classes with 31 actions, the numbers of the paper. The paper names the groups, the
/// classes and a few of the categories; the others were chosen to fill its counts.
const BUILT_IN: &str = include_str!("../../data/taxonomy.json");

/// Loads the taxonomy in `file`, or the built-in one.
///
/// # Errors
/// When the file is missing, malformed, or has a name twice.
pub fn load(file: Option<&Path>) -> Result<Taxonomy, StoreError> {
    let (path, taxonomy): (&Path, Taxonomy) = match file {
        Some(path) => (path, store::read_record(path)?),
        None => {
            let path = Path::new("built-in taxonomy");
            let taxonomy = serde_json::from_str(BUILT_IN)
                .map_err(|error| StoreError::malformed(path, error.to_string()))?;
            (path, taxonomy)
        }
    };
    for (kind, groups) in [("scene", &taxonomy.scenes), ("action", &taxonomy.actions)] {
        if let Some(name) = repeated(groups) {
            return Err(StoreError::malformed(
                path,
                format!("has the {kind} name {name} twice"),
            ));
        }
    }
    Ok(taxonomy)
}

/// Returns the first name that occurs twice, as a group or as a member of any group.
fn repeated(groups: &[NameGroup]) -> Option<&str> {
    let mut group_names = BTreeSet::new();
    let mut members = BTreeSet::new();
    groups
        .iter()
        .find_map(|group| (!group_names.insert(&group.name)).then_some(&group.name))
        .or_else(|| {
            groups
                .iter()
                .flat_map(|group| &group.members)
                .find(|&member| !members.insert(member))
        })
        .map(String::as_str)
}

/// Returns the name of the group that a name belongs to.
pub(super) fn group_of<'a>(groups: &'a [NameGroup], name: &str) -> Option<&'a str> {
    groups
        .iter()
        .find(|group| group.members.iter().any(|member| member == name))
        .map(|group| group.name.as_str())
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

    use super::*;

    #[test]
    fn the_built_in_taxonomy_has_the_counts_of_the_paper() {
        let taxonomy = load(None).unwrap();
        let members = |groups: &[NameGroup]| groups.iter().map(|g| g.members.len()).sum::<usize>();
        assert_eq!((taxonomy.scenes.len(), members(&taxonomy.scenes)), (3, 64));
        assert_eq!(
            (taxonomy.actions.len(), members(&taxonomy.actions)),
            (4, 31)
        );
        assert_eq!(
            group_of(&taxonomy.scenes, "night-market"),
            Some("urban-outdoor")
        );
        assert_eq!(
            group_of(&taxonomy.actions, "walking"),
            Some("walking-and-daily")
        );
        assert_eq!(group_of(&taxonomy.actions, "night-market"), None);
    }

    #[test]
    fn a_name_may_occur_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("taxonomy.json");
        for (edit, name) in [
            ("\"beach\", \"beach\"", "beach"),
            ("\"night-market\"", "night-market"),
        ] {
            let text = BUILT_IN.replacen("\"beach\"", edit, 1);
            std::fs::write(&path, text).unwrap();
            let error = load(Some(&path)).unwrap_err().to_string();
            assert!(
                error.ends_with(&format!("has the scene name {name} twice")),
                "{error}"
            );
        }
        let text = BUILT_IN.replacen("\"static\"", "\"extreme\"", 1);
        std::fs::write(&path, text).unwrap();
        let error = load(Some(&path)).unwrap_err().to_string();
        assert!(
            error.ends_with("has the action name extreme twice"),
            "{error}"
        );
    }
}
