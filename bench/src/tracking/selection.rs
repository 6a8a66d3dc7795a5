//! Boxes that are scored: those of one class or of all, in frames that truth and tracks both looked at.

use std::collections::{BTreeMap, BTreeSet};

use omnilife_schemas::{
    plain_text::counted,
    records::{Detection, Tracks},
};

/// Keeps boxes and tracks of a class.
///
/// # Errors
/// When it has none; lists the classes that there are.
pub(super) fn keep_class(tracks: &mut Tracks, class: &str) -> Result<(), String> {
    let classes = classes(&tracks.detections);
    if !classes.contains_key(class) {
        let listed = listed(&classes);
        return Err(format!("must have boxes of class {class}, got {listed}"));
    }
    tracks.detections.retain(|one| one.class == class);
    tracks.tracks.retain(|one| one.class == class);
    Ok(())
}

/// Keeps the boxes of truth and tracks in frames of both. Returns a line on those of others, and one on boxes of
/// several classes, which are matched all the same.
///
/// # Errors
/// When they have no frame in common.
pub(super) fn keep_common(truth: &mut Tracks, found: &mut Tracks) -> Result<Vec<String>, String> {
    let [labelled, looked_at] = [&*truth, &*found]
        .map(|tracks| -> BTreeSet<u32> { tracks.frames.iter().copied().collect() });
    let common: Vec<u32> = labelled.intersection(&looked_at).copied().collect();
    if common.is_empty() {
        return Err("lists in `frames` none of the frames that the tracks looked at".to_owned());
    }
    let mut notes = Vec::new();
    for (tracks, side) in [(truth, "true boxes"), (found, "boxes of the tracks")] {
        let all = tracks.detections.len();
        tracks.detections.retain(|one| common.contains(&one.frame));
        tracks.frames.clone_from(&common);
        let left_out = all.saturating_sub(tracks.detections.len());
        if left_out > 0 {
            notes.push(format!(
                "{left_out} {side} are not scored: `frames` of truth and tracks have {} in common",
                counted(common.len(), "frame")
            ));
        }
    }
    Ok(notes)
}

/// Returns a line on boxes of several classes, or of another one than the truth's.
pub(super) fn classes_note(truth: &Tracks, found: &Tracks) -> Option<String> {
    let [truth, found] = [truth, found].map(|tracks| classes(&tracks.detections));
    let all: BTreeSet<&&str> = truth.keys().chain(found.keys()).collect();
    (all.len() > 1 && !found.is_empty()).then(|| {
        format!(
            "boxes are matched whatever their class: truth {}, tracks {}; --class scores one",
            listed(&truth),
            listed(&found)
        )
    })
}

fn classes(boxes: &[Detection]) -> BTreeMap<&str, usize> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for one in boxes {
        let count = counts.entry(&one.class).or_default();
        *count = count.saturating_add(1);
    }
    counts
}

fn listed(classes: &BTreeMap<&str, usize>) -> String {
    let classes: Vec<String> = (classes.iter())
        .map(|(class, count)| format!("{count} {class}"))
        .collect();
    match classes.is_empty() {
        true => "none".to_owned(),
        false => classes.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One box of a class in every frame that is named; `frames` are those that were looked at.
    fn tracks(frames: &[u32], boxes: &[(u32, &str)]) -> Tracks {
        Tracks {
            scene: "flight".to_owned(),
            frames: frames.to_vec(),
            image_size: [320, 180],
            up: [0.0, 0.0, 1.0],
            metres_per_unit: 1.0,
            stages: Vec::new(),
            detections: boxes
                .iter()
                .map(|&(frame, class)| Detection {
                    frame,
                    box_pixels: [1.0, 1.0, 9.0, 9.0],
                    confidence: 1.0,
                    class: class.to_owned(),
                    distance: None,
                    position: None,
                    track: None,
                })
                .collect(),
            tracks: Vec::new(),
            warnings: Vec::new(),
        }
    }

    #[test]
    fn frames_of_one_side_are_left_out_with_a_line() {
        let every = [0, 1, 2, 3].map(|frame| (frame, "vehicle"));
        let mut truth = tracks(&[0, 2], &[(0, "vehicle"), (2, "vehicle")]);
        let mut found = tracks(&[0, 1, 2, 3], &every);
        let notes = keep_common(&mut truth, &mut found).unwrap_or_default();
        assert_eq!(notes.len(), 1, "{notes:?}");
        assert!(notes[0].starts_with("2 boxes of the tracks"), "{notes:?}");
        assert_eq!((truth.detections.len(), found.detections.len()), (2, 2));
        let (mut truth, mut found) = (tracks(&[0, 1], &every), tracks(&[1, 2, 3], &every));
        let notes = keep_common(&mut truth, &mut found).unwrap_or_default();
        assert_eq!(notes.len(), 2, "{notes:?}");
        assert_eq!((truth.detections.len(), found.frames), (1, vec![1]));
        for (labelled, looked_at) in [(&[][..], &[0][..]), (&[1][..], &[0][..])] {
            let (mut truth, mut found) = (tracks(labelled, &[]), tracks(looked_at, &[]));
            assert!(keep_common(&mut truth, &mut found).is_err());
        }
    }

    #[test]
    fn classes_that_differ_are_reported_and_one_can_be_scored() {
        let vehicles = tracks(&[0], &[(0, "vehicle")]);
        let people = tracks(&[0], &[(0, "human")]);
        let mut both = tracks(&[0], &[(0, "vehicle"), (0, "human")]);
        assert_eq!(classes_note(&vehicles, &vehicles), None);
        for (truth, found) in [(&both, &vehicles), (&vehicles, &people), (&both, &both)] {
            assert!(classes_note(truth, found).is_some());
        }
        assert_eq!(keep_class(&mut both, "vehicle"), Ok(()));
        assert_eq!(both, vehicles);
        let refusal = keep_class(&mut both, "human").err();
        assert!(refusal.is_some_and(|reason| reason.contains("1 vehicle")));
    }
}
