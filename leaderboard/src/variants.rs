//! Variants of a method by their names: `odgs-without-motion` and `odgs-set-gamma=1` are variants of `odgs`.

use std::collections::BTreeMap;

const WITHOUT: &str = "-without-";
/// Marks behind a method's name in that of a variant, with their words in tables.
const MARKS: [(&str, &str); 4] = [
    (WITHOUT, "w/o "),
    ("-with-", "with "),
    ("-plan-", "plan "),
    ("-set-", ""),
];

pub(crate) fn method_of(name: &str) -> &str {
    &name[..next_mark(name)]
}

/// Returns the whole method of a variant: the shortest name before a mark that is among `methods`. Without it, the
/// variant is a method of its own. Methods of other programs are variants by `-without-` alone: they are free to have a
/// name such as `theirs-with-depth`.
pub(crate) fn whole_of<'a, T>(
    methods: &BTreeMap<&'a str, T>,
    method: &str,
    is_ours: bool,
) -> Option<&'a str> {
    let marks = MARKS.iter().map(|(mark, _)| *mark);
    let mut ends: Vec<usize> = marks
        .filter(|mark| is_ours || *mark == WITHOUT)
        .flat_map(|mark| method.match_indices(mark).map(|(end, _)| end))
        .collect();
    ends.sort_unstable();
    let whole = ends
        .into_iter()
        .find_map(|end| methods.get_key_value(&method[..end]));
    whole.map(|(name, _)| *name)
}

/// Describes a variant by what stands behind the name of its whole: `w/o dynamic mask, gamma=1`.
pub(crate) fn label(whole: &str, variant: &str) -> String {
    let mut rest = variant.strip_prefix(whole).unwrap_or(variant);
    let mut parts = Vec::new();
    while let Some((behind, words)) = MARKS
        .iter()
        .find_map(|(mark, words)| Some((rest.strip_prefix(mark)?, words)))
    {
        let (word, following) = behind.split_at(next_mark(behind));
        // The value of a constant may be negative.
        let word = if word.contains('=') {
            word.to_owned()
        } else {
            word.replace('-', " ")
        };
        parts.push(format!("{words}{word}"));
        rest = following;
    }
    parts.join(", ")
}

/// Returns the position of the next mark of a text, or its length.
fn next_mark(text: &str) -> usize {
    let ends = MARKS.iter().filter_map(|(mark, _)| text.find(mark));
    ends.min().unwrap_or(text.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_variant_is_told_by_the_words_of_its_components() {
        for (variant, expected) in [
            ("odgs-without-dynamic-mask", "w/o dynamic mask"),
            (
                "odgs-plan-auto-with-sky-shell-without-aids",
                "plan auto, with sky shell, w/o aids",
            ),
            ("odgs-set-sky-depth=-1", "sky-depth=-1"),
        ] {
            assert_eq!(label("odgs", variant), expected);
            assert_eq!(method_of(variant), "odgs");
        }
        assert_eq!(method_of("odgs-published"), "odgs-published");
    }
}
