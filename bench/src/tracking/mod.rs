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
pub mod paths;
pub mod world;

use std::path::Path;

use omnilife_schemas::{
    records::{Detection, Scene, Tracks},
    store,
};
use serde::Serialize;

use crate::error::BenchError;
use boxes::{DetectionScores, TrackBox, TrackScores};
use paths::PathScores;
use world::{TruePoses, World, WorldAlignment};

/// Scores of tracks against true ones.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrackReport {
    /// Note if true boxes refer to another size of the image and were rescaled to that of the tracks.
    pub rescaled: Option<String>,
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

/// Scores tracks against the true ones of a file, in the frames of the tracks. Boxes without a track count only as
/// detections. Paths are compared in the world of the truth: that of the scene where its poses were given, else by
/// `true_poses`. Without these they are left out, with the reason.
///
/// # Errors
/// When a file cannot be read or has unusable tracks, or true boxes are in images of another aspect ratio.
pub fn compare_tracks(
    tracks_file: &Path,
    truth_file: &Path,
    scene: &Scene,
    true_poses: Option<&TruePoses<'_>>,
) -> Result<TrackReport, BenchError> {
    let found = read_tracks(tracks_file)?;
    let mut truth = read_tracks(truth_file)?;
    let rescaled = bring_to_size(&mut truth, found.image_size)
        .map_err(|reason| BenchError::mismatch(truth_file, reason))?;
    let here = |tracks: &Tracks| -> Vec<Detection> {
        let all = tracks.detections.iter();
        all.filter(|one| found.frames.contains(&one.frame))
            .cloned()
            .collect()
    };
    let (true_boxes, found_boxes) = (here(&truth), here(&found));
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
        detections: boxes::score_detections(&true_boxes, &detected),
        boxes: boxes::score_boxes(&of_tracks(&true_boxes), &of_tracks(&found_boxes)),
        paths: world.and_then(|world| paths::score_paths(&truth, &found, scene, &world)),
        paths_left_out,
        alignment,
    })
}

/// Reads tracks that can be scored.
fn read_tracks(file: &Path) -> Result<Tracks, BenchError> {
    let tracks: Tracks = store::read_record(file)?;
    match tracks.fault() {
        Some(fault) => Err(BenchError::mismatch(file, fault)),
        None => Ok(tracks),
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
        let mut twice = tracks([320, 180], [1.0, 1.0, 9.0, 9.0]);
        twice.detections[0].track = Some(3);
        store::write_record(&file, &twice)?;
        assert_eq!(read_tracks(&file)?, twice);
        twice.detections.push(twice.detections[0].clone());
        store::write_record(&file, &twice)?;
        let refusal = read_tracks(&file).err().map(|error| error.to_string());
        let expected = format!("{}: frame 0 has two boxes of track 3", file.display());
        assert_eq!(refusal, Some(expected));
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
