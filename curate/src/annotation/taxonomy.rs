//! The taxonomy: scene categories and actions, and their groups.

use std::{collections::BTreeSet, path::Path};

use omnilife_schemas::{
    records::{Annotation, NameGroup, Taxonomy},
    store::{self, StoreError},
};

use super::measure::{DYNAMICS_LEVELS, UNKNOWN};

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

/// Returns one line per fault of an annotation: names and groups are checked where it is of this taxonomy, measured
/// classes always.
pub(crate) fn faults(annotation: &Annotation, taxonomy: &Taxonomy) -> Vec<String> {
    let mut faults = Vec::new();
    let motion = &annotation.ego_motion;
    let tags = [
        (
            "scene",
            &taxonomy.scenes,
            &annotation.scene,
            &annotation.group,
        ),
        (
            "action",
            &taxonomy.actions,
            &annotation.action,
            &motion.of_action,
        ),
    ];
    for (kind, groups, tag, group) in tags {
        let name = tag.as_ref().map(|tag| tag.name.as_str());
        let expected = name.map(|name| (name, group_of(groups, name)));
        let version = &taxonomy.version;
        match expected {
            _ if annotation.taxonomy != *version => {}
            Some((name, None)) => {
                faults.push(format!(
                    "{name} is not among the {kind}s of taxonomy {version}"
                ));
            }
            Some((name, Some(expected))) if group.as_deref() != Some(expected) => {
                let found = group.as_deref().unwrap_or("no group");
                faults.push(format!(
                    "{kind} {name} is of {expected}, and not of {found}"
                ));
            }
            None if group.is_some() => faults.push(format!("has a group of no {kind}")),
            Some(_) | None => {}
        }
    }
    let ego_motions = taxonomy.actions.iter().map(|group| group.name.as_str());
    let measured = [
        (
            "ego-motion",
            &motion.measured,
            ego_motions.collect::<Vec<_>>(),
        ),
        ("dynamics", &annotation.dynamics, DYNAMICS_LEVELS.to_vec()),
    ];
    for (kind, measured, classes) in measured {
        let class = measured.as_ref().map(|measured| measured.class.as_str());
        let is_known = |class: &&str| *class == UNKNOWN || classes.contains(class);
        if let Some(class) = class.filter(|class| !is_known(class)) {
            let classes = classes.join(", ");
            faults.push(format!(
                "{kind} must be one of {classes}, {UNKNOWN}, got {class}"
            ));
        }
    }
    faults
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

    use omnilife_schemas::records::{Measured, Tag};

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
    fn names_groups_and_classes_of_annotations_are_checked() {
        let taxonomy = load(None).unwrap();
        let tag = |name: &str| {
            Some(Tag {
                name: name.to_owned(),
                author: "ann".to_owned(),
            })
        };
        let measured = |class: &str| {
            Some(Measured {
                class: class.to_owned(),
                from: "frames".to_owned(),
                evidence: Vec::new(),
            })
        };
        let mut sound = Annotation {
            taxonomy: taxonomy.version.clone(),
            scene: tag("night-market"),
            group: Some("urban-outdoor".to_owned()),
            action: tag("walking"),
            dynamics: measured("low"),
            ..Annotation::default()
        };
        sound.ego_motion.of_action = Some("walking-and-daily".to_owned());
        sound.ego_motion.measured = measured("unknown");
        assert_eq!(faults(&sound, &taxonomy), [""; 0]);
        let changes: [fn(&mut Annotation); 6] = [
            |one| one.group = Some("indoor-venues".to_owned()),
            |one| one.group = None,
            |one| one.scene = None,
            |one| one.action = one.scene.clone(),
            |one| {
                if let Some(measured) = &mut one.dynamics {
                    "fast".clone_into(&mut measured.class);
                }
            },
            |one| one.ego_motion.measured = one.dynamics.clone(),
        ];
        for (number, change) in changes.iter().enumerate() {
            let mut changed = sound.clone();
            change(&mut changed);
            let found = faults(&changed, &taxonomy);
            assert_eq!(found.len(), 1, "{number}: {found:?}");
        }
        sound.taxonomy = "of a lab".to_owned();
        sound.group = None;
        assert_eq!(faults(&sound, &taxonomy), [""; 0]);
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
