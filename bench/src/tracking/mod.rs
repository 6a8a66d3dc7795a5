//! Scores of tracks beside true ones: detection, confusion of identities, errors on the ground.
//!
//! Per frame true and found objects are matched by their boxes in the image (CLEAR MOT, Bernardin and Stiefelhagen
//! 2008). Pairs matched before stay matched while their boxes overlap enough; then as many others as possible are
//! matched, the largest overlaps first. Identities over the clip (IDF1, Ristani et al. 2016) are matched one to one so
//! that as many boxes as possible agree.
//!
//! ```text
//! MOTA = 1 - (misses + false positives + switches) / true boxes
//! IDF1 = 2 IDTP / (true boxes + found boxes)
//! ```

pub mod boxes;
mod conventions;
pub mod paths;
mod selection;
pub mod world;

use std::{collections::BTreeSet, path::Path};

use omnilife_schemas::{
    records::{Detection, Scene, Tracks},
    store,
};
use serde::Serialize;

use crate::error::BenchError;
use boxes::{DetectionScores, TrackBox, TrackScores};
use conventions::Sizes;
use paths::PathScores;
use world::{TruePoses, World, WorldAlignment};

/// Scores of tracks against true ones.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrackReport {
    /// Note if true boxes refer to another size of the image and were rescaled to that of the tracks.
    pub rescaled: Option<String>,
    /// Lines on boxes that are not scored, and on a convention of boxes or frames in which they fit much better.
    pub notes: Vec<String>,
    /// Scores of all detections, in a track or not.
    pub detections: DetectionScores,
    /// Scores in the images.
    pub boxes: TrackScores,
    /// Scores in space; none if no path is near a true one.
    pub paths: Option<PathScores>,
    /// Reason for which paths were left out, in one line.
    pub paths_left_out: Option<String>,
    /// Similarity by which paths were brought to the world of the truth; absent where it is that of the scene.
    pub alignment: Option<WorldAlignment>,
}

/// Scores tracks against the true ones of a file, in the frames that both looked at; those of a class, or all whatever
/// their class. Boxes without a track count only as detections. Paths are compared in the world of the truth: that of the scene where its poses were given, else by
/// `true_poses`. Without these they are left out, with the reason.
///
/// # Errors
/// When a file cannot be read or has unusable tracks, tracks are of another scene or of frames that it lacks, true boxes
/// are in images of another aspect ratio, or truth and tracks have no frame or no box of the class.
pub fn compare_tracks(
    tracks_file: &Path,
    truth_file: &Path,
    scene: &Scene,
    true_poses: Option<&TruePoses<'_>>,
    class: Option<&str>,
) -> Result<TrackReport, BenchError> {
    let mut found = read_tracks(tracks_file, scene)?;
    let mut truth = read_tracks(truth_file, scene)?;
    refuse_other_frames(&found, scene)
        .map_err(|reason| BenchError::mismatch(tracks_file, reason))?;
    let rescaled = bring_to_size(&mut truth, found.image_size)
        .map_err(|reason| BenchError::mismatch(truth_file, reason))?;
    if let Some(class) = class {
        for (file, tracks) in [(truth_file, &mut truth), (tracks_file, &mut found)] {
            selection::keep_class(tracks, class)
                .map_err(|reason| BenchError::mismatch(file, reason))?;
        }
    }
    let mut notes = selection::keep_common(&mut truth, &mut found)
        .map_err(|reason| BenchError::mismatch(truth_file, reason))?;
    notes.extend(selection::classes_note(&truth, &found));
    let (true_boxes, found_boxes) = (&truth.detections, &found.detections);
    notes.extend(conventions::note(
        true_boxes,
        found_boxes,
        &Sizes {
            image: found.image_size.map(f64::from),
            scene: [scene.camera.width(), scene.camera.height()].map(f64::from),
        },
    ));
    let of_tracks = |boxes: &[Detection]| -> Vec<TrackBox> {
        let of_track = |one: &Detection| {
            Some(TrackBox {
                frame: one.frame,
                id: one.track?,
                box_pixels: one.box_pixels,
            })
        };
        boxes.iter().filter_map(of_track).collect()
    };
    // A box that fills a gap was not detected.
    let detected: Vec<Detection> = found_boxes
        .iter()
        .filter(|one| one.confidence > 0.0)
        .cloned()
        .collect();
    let (world, paths_left_out, alignment) = match true_poses {
        Some(given) => match World::by_cameras(scene, given, [&truth, &found]) {
            Ok((world, alignment)) => (Some(world), None, Some(alignment)),
            Err(reason) => (None, Some(format!("paths are left out: {reason}")), None),
        },
        None => match world::own_world(scene) {
            None => (Some(World::shared(&found)), None, None),
            reason => (None, reason, None),
        },
    };
    Ok(TrackReport {
        rescaled,
        notes,
        detections: boxes::score_detections(true_boxes, &detected),
        boxes: boxes::score_boxes(&of_tracks(true_boxes), &of_tracks(found_boxes)),
        paths: world.and_then(|world| paths::score_paths(&truth, &found, scene, &world)),
        paths_left_out,
        alignment,
    })
}

/// Reads tracks of a scene that can be scored.
fn read_tracks(file: &Path, scene: &Scene) -> Result<Tracks, BenchError> {
    let tracks: Tracks = store::read_record(file)?;
    let of_boxes = || {
        let is_reversed = |one: &&Detection| one.box_pixels[2..].iter().any(|&side| side < 0.0);
        let bad = tracks.detections.iter().find(is_reversed)?;
        Some(format!(
            "frame {} has a box of negative width or height: {:?}",
            bad.frame, bad.box_pixels
        ))
    };
    let of_scene = || {
        let (own, id) = (&tracks.scene, &scene.id);
        (own != id).then(|| format!("has the tracks of {own}, not of {id}"))
    };
    match tracks.fault().or_else(of_boxes).or_else(of_scene) {
        Some(fault) => Err(BenchError::mismatch(file, fault)),
        None => Ok(tracks),
    }
}

/// Refuses tracks without frames, whose scores would be of nothing, and those with frames that the scene lacks.
fn refuse_other_frames(tracks: &Tracks, scene: &Scene) -> Result<(), String> {
    if tracks.frames.is_empty() {
        return Err("must list in `frames` which frames were looked at, got none".to_owned());
    }
    let of_boxes = tracks.detections.iter().map(|one| one.frame);
    let frames: BTreeSet<u32> = tracks.frames.iter().copied().chain(of_boxes).collect();
    let count = scene.frames.len();
    match frames.last().filter(|&&last| last as usize >= count) {
        Some(last) => Err(format!(
            "has frame {last}, and the scene has {count}, counted from 0"
        )),
        None => Ok(()),
    }
}

/// Rescales boxes to another size of the same image, with a note; the reason if its aspect ratio differs.
fn bring_to_size(tracks: &mut Tracks, size: [u32; 2]) -> Result<Option<String>, String> {
    let own = tracks.image_size;
    if own == size {
        return Ok(None);
    }
    let [across, down] = [0, 1].map(|axis| f64::from(size[axis]) / f64::from(own[axis].max(1)));
    let sizes = format!(
        "{}x{} pixels, the tracks to images of {}x{}",
        own[0], own[1], size[0], size[1]
    );
    // A side that was rounded to whole pixels.
    let slack = 1.0 / f64::from(size[0].min(size[1]).max(1));
    if own.contains(&0) || (across / down - 1.0).abs() > slack {
        return Err(format!(
            "its boxes belong to images of {sizes}, which is another shape"
        ));
    }
    for detection in &mut tracks.detections {
        let [left, top, width, height] = detection.box_pixels;
        detection.box_pixels = [left * across, top * down, width * across, height * down];
    }
    tracks.image_size = size;
    Ok(Some(format!(
        "true boxes belong to images of {sizes}: rescaled"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the scene of [`tracks`], of three frames.
    fn scene() -> Scene {
        Scene {
            id: "flight".to_owned(),
            ..crate::poses::tests::scene(&[None; 3])
        }
    }

    fn tracks(image_size: [u32; 2], box_pixels: [f64; 4]) -> Tracks {
        Tracks {
            scene: "flight".to_owned(),
            frames: vec![0],
            image_size,
            up: [0.0, 0.0, 1.0],
            metres_per_unit: 1.0,
            stages: Vec::new(),
            detections: vec![Detection {
                frame: 0,
                box_pixels,
                confidence: 1.0,
                class: "vehicle".to_owned(),
                distance: None,
                position: None,
                track: None,
            }],
            tracks: Vec::new(),
            warnings: Vec::new(),
        }
    }

    #[test]
    fn tracks_that_cannot_be_used_are_refused_in_one_line() -> Result<(), Box<dyn std::error::Error>>
    {
        let folder = tempfile::tempdir()?;
        let file = folder.path().join("tracks.json");
        let flight = scene();
        let mut twice = tracks([320, 180], [1.0, 1.0, 9.0, 9.0]);
        twice.detections[0].track = Some(3);
        store::write_record(&file, &twice)?;
        assert_eq!(read_tracks(&file, &flight)?, twice);
        twice.detections.push(twice.detections[0].clone());
        store::write_record(&file, &twice)?;
        let refusal = |scene: &Scene| {
            read_tracks(&file, scene)
                .err()
                .map(|error| error.to_string())
        };
        let expected = |reason: &str| Some(format!("{}: {reason}", file.display()));
        assert_eq!(
            refusal(&flight),
            expected("frame 0 has two boxes of track 3")
        );
        let reversed = tracks([320, 180], [9.0, 9.0, -8.0, 8.0]);
        store::write_record(&file, &reversed)?;
        assert_eq!(
            refusal(&flight),
            expected("frame 0 has a box of negative width or height: [9.0, 9.0, -8.0, 8.0]")
        );
        store::write_record(&file, &tracks([320, 180], [1.0, 1.0, 9.0, 9.0]))?;
        let walk = crate::poses::tests::scene(&[]);
        assert_eq!(
            refusal(&walk),
            expected("has the tracks of flight, not of walk/seq-000")
        );
        Ok(())
    }

    /// Scores of no frame, or of the wrong ones, look like those of perfect tracks.
    #[test]
    fn frames_that_were_not_looked_at_are_told() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let [truth_file, file] = ["truth.json", "tracks.json"].map(|name| folder.path().join(name));
        let mut truth = tracks([320, 180], [1.0, 1.0, 9.0, 9.0]);
        truth.frames = vec![0, 1, 2];
        for frame in [1, 2] {
            let mut one = truth.detections[0].clone();
            one.frame = frame;
            truth.detections.push(one);
        }
        store::write_record(&truth_file, &truth)?;
        let compared = |frames: &[u32]| -> Result<TrackReport, BenchError> {
            let mut found = truth.clone();
            found.frames = frames.to_vec();
            store::write_record(&file, &found)?;
            compare_tracks(&file, &truth_file, &scene(), None, None)
        };
        assert_eq!(compared(&[0, 1, 2])?.notes, Vec::<String>::new());
        let notes = compared(&[0])?.notes;
        assert_eq!(notes.len(), 2, "{notes:?}");
        for note in notes {
            assert!(
                note.starts_with("2 ") && note.contains("1 frame in common"),
                "{note}"
            );
        }
        for (frames, expected) in [
            (Vec::new(), "must list in `frames`"),
            (vec![0, 1, 2, 3], "has frame 3, and the scene has 3"),
        ] {
            let refusal = compared(&frames).err().map(|error| error.to_string());
            assert!(
                refusal
                    .as_ref()
                    .is_some_and(|reason| reason.contains(expected)),
                "{refusal:?}"
            );
        }
        Ok(())
    }

    #[test]
    fn boxes_of_larger_images_are_rescaled_and_of_other_shapes_refused() {
        let found = tracks([320, 180], [10.0, 20.0, 30.0, 15.0]);
        let mut truth = tracks([640, 360], [20.0, 40.0, 60.0, 30.0]);
        let unscaled = boxes::score_detections(&truth.detections, &found.detections);
        assert_eq!(unscaled.recall, 0.0);
        let note = bring_to_size(&mut truth, found.image_size);
        assert!(note.is_ok_and(|note| note.is_some_and(|note| note.contains("640x360"))));
        assert_eq!(
            truth.detections[0].box_pixels,
            found.detections[0].box_pixels
        );
        let scores = boxes::score_detections(&truth.detections, &found.detections);
        assert_eq!((scores.recall, scores.precision), (1.0, 1.0));
        assert_eq!(bring_to_size(&mut truth, [320, 180]), Ok(None));
        for other in [[320, 240], [0, 0]] {
            let refused = bring_to_size(&mut tracks(other, [0.0; 4]), [320, 180]);
            assert!(refused.is_err_and(|reason| reason.contains("another shape")));
        }
    }
}
