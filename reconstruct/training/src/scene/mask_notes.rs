//! Origin and oddities of the masks that training relies on.

use std::path::Path;

use omnilife_schemas::{
    layout::{DYNAMIC_MASKS_FILE, DYNAMIC_MASKS_FOLDER},
    mask_file::MarkedGreys,
    mask_survey::MaskSurvey,
    records::{Masks, Scene, SceneFrame, Split},
    rgb::Mask,
    store,
};

use crate::error::ReconstructError;

/// Returns notes on the masks of a split's frames: their detector and its measured reliability, assumptions about their
/// encoding, and masks that look inverted.
///
/// # Errors
/// When the scene, the split or a mask cannot be read.
pub fn mask_notes(scene_path: &Path, split_path: &Path) -> Result<Vec<String>, ReconstructError> {
    let scene: Scene = store::read_record(scene_path)?;
    let split: Split = store::read_record(split_path)?;
    let folder = scene_path.parent().unwrap_or(Path::new("."));
    let mut survey = MaskSurvey::default();
    let frames = split.input_views.iter().chain(&split.novel_views);
    let frames = frames.filter_map(|&frame| scene.frames.get(frame as usize));
    let frames: Vec<&SceneFrame> = frames.collect();
    for entry in &frames {
        for file in entry.objects.values() {
            survey.add(&folder.join(file), &scene.camera, MarkedGreys::AboveHalf)?;
        }
        if let Some(file) = &entry.mask {
            survey.add_moving(&folder.join(file), &scene.camera)?;
        }
        if let Some(file) = &entry.ignore_mask {
            survey.add_ignored(&folder.join(file), &scene.camera)?;
        }
    }
    let detector = detector_note(folder, &scene, &frames)?;
    Ok(detector.into_iter().chain(survey.notes()).collect())
}

/// Returns a line on the detector of the masks and its measured reliability, if the masks of frames are those that
/// `curate masks` left in the folder of their scene.
fn detector_note(
    folder: &Path,
    scene: &Scene,
    frames: &[&SceneFrame],
) -> Result<Option<String>, ReconstructError> {
    let made = folder.join(DYNAMIC_MASKS_FOLDER);
    let record = made.join(DYNAMIC_MASKS_FILE);
    if !record.is_file() || frames.iter().all(|frame| frame.mask.is_none()) {
        return Ok(None);
    }
    let record: Masks = store::read_record(&record)?;
    let Some(reliability) = record.reliability else {
        return Ok(None);
    };
    if record.frames.len() != scene.frames.len() {
        return Ok(None);
    }
    for (frame, entry) in scene.frames.iter().zip(&record.frames) {
        if let Some(own) = &frame.mask {
            let own = Mask::read(&folder.join(own))?;
            let made = Mask::read(&made.join(&entry.file))?;
            if made.resized_to_nearest(own.width, own.height) != own {
                return Ok(None);
            }
        }
    }
    Ok(Some(format!(
        "dynamic masks are by {}; {reliability}",
        record.method
    )))
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]
mod tests {
    use omnilife_schemas::{
        Pose,
        camera::ErpCamera,
        records::{MaskEntry, Protocol, ScoredViews, SplitRule},
        split_rules,
    };

    use super::*;

    const WIDTH: usize = 16;
    const HEIGHT: usize = 8;

    fn frame(number: u32) -> SceneFrame {
        SceneFrame {
            mask: Some("moving.png".to_owned()),
            ignore_mask: Some("holder.png".to_owned()),
            ..SceneFrame::new(
                format!("frames/{number}.png"),
                f64::from(number),
                Some(Pose {
                    rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
                    centre: [f64::from(number), 0.0, 0.0],
                }),
            )
        }
    }

    /// Returns four frames that share a dynamic mask and a mask of the operator.
    fn scene() -> Scene {
        Scene::given(
            "held/seq-000",
            ErpCamera::new(WIDTH as u32, HEIGHT as u32),
            (0..4).map(frame).collect(),
        )
    }

    fn protocol() -> Protocol {
        Protocol::new(
            "second",
            SplitRule::EveryNth {
                period: 2,
                offset: 1,
            },
            ScoredViews::Novel,
        )
    }

    /// Marks the lowest rows with a value.
    fn lowest(rows: usize, value: u8) -> Mask {
        let is_marked = |pixel: usize| pixel / WIDTH >= HEIGHT - rows;
        Mask {
            width: WIDTH,
            height: HEIGHT,
            data: (0..WIDTH * HEIGHT)
                .map(|pixel| value * u8::from(is_marked(pixel)))
                .collect(),
        }
    }

    #[test]
    fn labels_and_inverted_masks_are_a_line_each() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let scene = scene();
        let split = split_rules::split(&scene, &protocol()).unwrap();
        store::write_record(&at("scene.json"), &scene).unwrap();
        store::write_record(&at("split.json"), &split).unwrap();
        let notes = |moving: &Mask, holder: &Mask| {
            moving.write_png(&at("moving.png")).unwrap();
            holder.write_png(&at("holder.png")).unwrap();
            mask_notes(&at("scene.json"), &at("split.json")).unwrap()
        };
        let white = |rows: usize| lowest(rows, 255);
        assert_eq!(notes(&white(1), &white(2)), [""; 0]);
        let labels = notes(&lowest(1, 5), &white(2));
        assert!(
            matches!(&labels[..], [line] if line.contains("moving.png")),
            "{labels:?}"
        );
        let inverted = notes(&white(1), &white(2).inverted());
        assert!(
            matches!(&inverted[..], [line] if line.contains("4 frames")),
            "{inverted:?}"
        );
        // Half of the visible scene may move; hardly all of it in every frame.
        assert_eq!(notes(&white(4), &white(2)), [""; 0]);
        let exchanged = notes(&white(1).inverted(), &white(2));
        assert!(
            matches!(&exchanged[..], [line] if line.contains("moving content mark")),
            "{exchanged:?}"
        );
        // Masks of a detector are told with what it was measured to be worth.
        let made = at(DYNAMIC_MASKS_FOLDER);
        std::fs::create_dir(&made).unwrap();
        let entries = (0..scene.frames.len()).map(|number| {
            let file = format!("{number:06}.png");
            white(1).write_png(&made.join(&file)).unwrap();
            MaskEntry {
                file,
                dynamic_share: 0.1,
                classes: [].into(),
            }
        });
        let record = Masks {
            sequence: scene.id.clone(),
            method: "residual".to_owned(),
            settings: String::new(),
            reliability: Some("IoU 0.040".to_owned()),
            frames: entries.collect(),
        };
        store::write_record(&made.join(DYNAMIC_MASKS_FILE), &record).unwrap();
        let told = notes(&white(1), &white(2));
        assert!(
            matches!(&told[..], [line] if line.contains("residual; IoU 0.040")),
            "{told:?}"
        );
        assert_eq!(notes(&white(2), &white(2)), [""; 0]);
        std::fs::write(at("holder.png"), "no image").unwrap();
        assert!(mask_notes(&at("scene.json"), &at("split.json")).is_err());
    }
}
