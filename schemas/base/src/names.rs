//! Search by name in a slice of methods, protocols, adapters and the like.

/// Error for an unknown name; the message lists all names, and the one that may be meant.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no {kind} {name:?}; known: {known}{}", suggestion(meant.as_deref()))]
pub struct UnknownName {
    /// Kind of the entry that was looked for: `method`, `protocol`.
    pub kind: String,
    /// Name that was searched for.
    pub name: String,
    /// All names, comma-separated; `none` without any.
    pub known: String,
    /// Known name that differs by a typing mistake.
    pub meant: Option<String>,
}

impl UnknownName {
    /// Makes the error for a `name` that is not among `known`.
    pub fn new<'a>(kind: &str, name: &str, known: impl IntoIterator<Item = &'a str>) -> Self {
        let known: Vec<&str> = known.into_iter().collect();
        let distance = |other: &&str| strsim::osa_distance(name, other);
        let nearest = known.iter().copied().min_by_key(distance);
        let meant = nearest.filter(|nearest| distance(nearest) <= most_slips(name));
        Self {
            kind: kind.to_owned(),
            name: name.to_owned(),
            meant: meant.map(str::to_owned),
            known: if known.is_empty() {
                "none".to_owned()
            } else {
                known.join(", ")
            },
        }
    }
}

/// Returns the number of edits (insertion, deletion, substitution, swap of neighbours) up to which a name counts as
/// misspelt: one, and one more for every three letters.
fn most_slips(name: &str) -> usize {
    (name.chars().count() / 3).max(1)
}

fn suggestion(meant: Option<&str>) -> String {
    meant.map_or_else(String::new, |meant| format!("; did you mean {meant:?}?"))
}

/// Returns true for a name that is one in a table: of one line, and without spaces around it, which no table shows.
pub fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.trim() == name && !name.chars().any(char::is_control)
}

/// Returns the entry of this name.
///
/// # Errors
/// [`UnknownName`] where the name is unknown.
pub fn find<'a, T>(
    kind: &str,
    name: &str,
    entries: &'a [T],
    id: impl Fn(&T) -> &str,
) -> Result<&'a T, UnknownName> {
    let mut all = entries.iter();
    all.find(|entry| id(entry) == name)
        .ok_or_else(|| UnknownName::new(kind, name, entries.iter().map(id)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_names_are_those_that_a_table_shows_as_they_are() {
        for name in ["odgs", "my method", "méthode-2"] {
            assert!(is_plain(name), "{name:?}");
        }
        for name in ["", " ", "odgs ", "\u{a0}odgs", "od\ngs", "od\tgs"] {
            assert!(!is_plain(name), "{name:?}");
        }
    }

    #[test]
    fn an_unknown_name_lists_the_known_ones_and_the_nearest() {
        let known = ["per-scene", "sparse-interpolation", "input-view"];
        let message = |name: &str| {
            let found = find("protocol", name, &known, |id| id);
            found
                .map(|&id| id.to_owned())
                .unwrap_or_else(|error| error.to_string())
        };
        let all = "known: per-scene, sparse-interpolation, input-view";
        assert_eq!(message("input-view"), "input-view");
        assert_eq!(
            message("per-sence"),
            format!("there is no protocol \"per-sence\"; {all}; did you mean \"per-scene\"?")
        );
        assert_eq!(
            message("nerf"),
            format!("there is no protocol \"nerf\"; {all}")
        );
        let nothing = UnknownName::new("component of nearest-input", "sky", []);
        assert_eq!(
            nothing.to_string(),
            "there is no component of nearest-input \"sky\"; known: none"
        );
    }
}
