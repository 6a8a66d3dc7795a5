//! Commands that make the parts of a sequence.

use omnilife_schemas::records::SequencePart;

use super::parts::Facts;

const CURATE: &str = "curate VIDEOS --out DATASET";
const IMPORT: &str = "curate import FOLDER --format colmap --out SEQUENCE";
const POSES: &str = "curate poses SEQUENCE";
const POSES_WITH_MASKS: &str = "curate poses SEQUENCE --masks SEQUENCE/dynamic-masks";
const POSES_WITH_POINTS: &str = "curate poses SEQUENCE --poses COLMAP";
const ATTACH_POSES: &str = "curate attach SEQUENCE --poses POSES";
const DENSE: &str = "curate dense SEQUENCE";
const MASKS: &str = "curate masks SEQUENCE --method residual";
const MASKS_FROM_FILES: &str = "curate masks SEQUENCE --from MASKS";
const ATTACH_MASKS: &str = "curate attach SEQUENCE --masks MASKS";
const POSES_WITH_IGNORED: &str = "curate poses SEQUENCE --ignore-mask MASK";
const ATTACH_IGNORED: &str = "curate attach SEQUENCE --ignore-mask MASK";
const POSES_WITH_DEPTH: &str = "curate poses SEQUENCE --depth-prior DEPTH --depth-prior-unit 0.001";
const ATTACH_DEPTH: &str = "curate attach SEQUENCE --depth-prior DEPTH --depth-prior-unit 0.001";
const ANNOTATE: &str = "curate annotate DATASET --tags TAGS";
const SPLIT: &str = "bench split SEQUENCE --protocol per-scene --out SEQUENCE/per-scene/split.json";

/// All commands, as they follow `omnilife`. DATASET and SEQUENCE are folders that are filled in; other words in
/// capitals stand for files to be given.
pub const COMMANDS: &[&str] = &[
    CURATE,
    IMPORT,
    POSES,
    POSES_WITH_MASKS,
    POSES_WITH_POINTS,
    ATTACH_POSES,
    DENSE,
    MASKS,
    MASKS_FROM_FILES,
    ATTACH_MASKS,
    POSES_WITH_IGNORED,
    ATTACH_IGNORED,
    POSES_WITH_DEPTH,
    ATTACH_DEPTH,
    ANNOTATE,
    SPLIT,
];

/// Returns the command of [`COMMANDS`] that makes a part.
pub(super) fn making(part: SequencePart, facts: &Facts) -> &'static str {
    match part {
        SequencePart::Frames if facts.has_sequence => CURATE,
        SequencePart::Frames => IMPORT,
        SequencePart::Poses => poses(facts),
        SequencePart::Points if !facts.has_poses => poses(facts),
        SequencePart::Points if facts.is_pinhole => DENSE,
        SequencePart::Points if facts.has_sequence => POSES_WITH_POINTS,
        SequencePart::Points => IMPORT,
        SequencePart::Masks if !facts.has_sequence => ATTACH_MASKS,
        SequencePart::Masks if facts.is_pinhole => MASKS_FROM_FILES,
        SequencePart::Masks => MASKS,
        SequencePart::IgnoreMasks if facts.has_scene => ATTACH_IGNORED,
        SequencePart::IgnoreMasks => POSES_WITH_IGNORED,
        SequencePart::Depth if facts.has_scene => ATTACH_DEPTH,
        SequencePart::Depth => POSES_WITH_DEPTH,
        SequencePart::Annotation => ANNOTATE,
        SequencePart::Splits => SPLIT,
    }
}

fn poses(facts: &Facts) -> &'static str {
    match (facts.has_sequence, facts.has_found_masks) {
        (true, true) => POSES_WITH_MASKS,
        (true, false) => POSES,
        (false, _) => ATTACH_POSES,
    }
}

/// Returns a whole command line. `dataset` is the folder as a shell of the reader finds it, `sequence` is relative
/// to it.
pub(super) fn line(command: &str, dataset: &str, sequence: &str) -> String {
    let dataset = match dataset.trim_end_matches('/') {
        "" => dataset,
        trimmed => trimmed,
    };
    let sequence = match (dataset, sequence) {
        (dataset, ".") => dataset.to_owned(),
        (".", sequence) => sequence.to_owned(),
        (dataset, sequence) => format!("{}/{sequence}", dataset.trim_end_matches('/')),
    };
    let words = command.split(' ').map(|word| {
        if word == "DATASET" {
            shell_word(dataset)
        } else if let Some(rest) = word.strip_prefix("SEQUENCE") {
            shell_word(&format!("{sequence}{rest}"))
        } else {
            word.to_owned()
        }
    });
    let words: Vec<String> = words.collect();
    format!("omnilife {}", words.join(" "))
}

fn shell_word(path: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "/._-+@%,:=".contains(letter);
    if path.chars().all(is_plain) && !path.starts_with('-') && !path.is_empty() {
        return path.to_owned();
    }
    let path = match path.starts_with('-') {
        true => format!("./{path}"),
        false => path.to_owned(),
    };
    format!("'{}'", path.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_filled_in_as_words_of_a_shell() {
        let sequence = "videos/a/seq-000";
        assert_eq!(
            line(MASKS, ".", sequence),
            "omnilife curate masks videos/a/seq-000 --method residual"
        );
        assert_eq!(
            line(ANNOTATE, "sets/one/", sequence),
            "omnilife curate annotate sets/one --tags TAGS"
        );
        assert_eq!(
            line(POSES_WITH_MASKS, "/", "a b/seq-000"),
            "omnilife curate poses '/a b/seq-000' --masks '/a b/seq-000/dynamic-masks'"
        );
        assert_eq!(line(DENSE, "it's", "."), "omnilife curate dense 'it'\\''s'");
        assert_eq!(line(DENSE, ".", "."), "omnilife curate dense .");
        assert_eq!(line(DENSE, "-x", "."), "omnilife curate dense './-x'");
    }

    #[test]
    fn every_choice_is_in_the_list() {
        let mut chosen = Vec::new();
        for bits in 0..32 {
            let facts = Facts {
                has_sequence: bits & 1 != 0,
                has_scene: bits & 2 != 0,
                has_poses: bits & 4 != 0,
                is_pinhole: bits & 8 != 0,
                has_found_masks: bits & 16 != 0,
            };
            chosen.extend(SequencePart::ALL.map(|part| making(part, &facts)));
        }
        chosen.sort_unstable();
        chosen.dedup();
        let mut listed = COMMANDS.to_vec();
        listed.sort_unstable();
        assert_eq!(chosen, listed);
    }
}
