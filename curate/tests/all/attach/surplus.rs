//! Given files that are of no frame.

use super::*;

#[test]
fn files_of_no_frame_are_named() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    let given = GivenTruth {
        ignored: Some(IgnoredRegion::Masks(scenes.masks("tripods", 3))),
        ..scenes.everything()
    };
    let kinds = [
        ("moving", "masks left out"),
        ("tripods", "ignore masks left out"),
        ("true-depth", "distances left out"),
        ("people", "masks of human left out"),
        ("estimates", "distances of the prior left out"),
    ];
    for (folder, _) in kinds {
        let folder = scenes.folder.join(folder);
        let of_frame = store::paths_in(&folder).unwrap().remove(0);
        let extension = of_frame.extension().unwrap().to_str().unwrap();
        for name in ["000012", "7000"] {
            fs::copy(&of_frame, folder.join(name).with_extension(extension)).unwrap();
        }
        fs::write(folder.join("notes.txt"), "").unwrap();
    }
    let notes = Notes::default();
    let scene = attach(&scenes.imported, None, &given, &notes).unwrap();
    let notes = notes.take();
    for (folder, line) in kinds {
        let lines = scene.validation.problems.iter();
        let lines: Vec<_> = lines.filter(|text| text.starts_with(line)).collect();
        assert_eq!(lines.len(), 1, "{folder}");
        assert!(lines[0].contains(": 2 (000012."), "{}", lines[0]);
        assert!(
            notes.iter().any(|note| note.ends_with(lines[0])),
            "{folder}"
        );
    }
}

/// Masks of another program are named after their images with an ending, and macOS adds hidden files.
#[test]
fn a_folder_with_other_names_shows_one_of_them() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    let folder = scenes.masks("moving", 20);
    fs::write(folder.join("._000000.png"), "Mac OS X").unwrap();
    let given = GivenTruth {
        masks: Some(folder.clone()),
        ..GivenTruth::default()
    };
    attach(&scenes.imported, None, &given, &Silent).unwrap();
    fs::rename(folder.join("000003.png"), folder.join("000003_mask.png")).unwrap();
    let refused = attach(&scenes.imported, None, &given, &Silent).map(drop);
    let error = refused.unwrap_err();
    let message = error.to_string();
    for part in [
        "11 of 12 frames",
        "000003.png",
        "named like 000003_mask.png",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
}

#[test]
fn masks_that_mark_most_as_moving_are_told() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    let of_scene = || {
        let scene: Scene = store::read_record(&scenes.imported.join("scene.json")).unwrap();
        scene.validation.problems
    };
    let count =
        |lines: &[String], words: &str| lines.iter().filter(|line| line.contains(words)).count();
    for (name, columns, told) in [("few", 100, 0), ("most", 200, 1), ("again", 100, 0)] {
        let masks = scenes.masks(name, columns);
        let given = GivenTruth {
            masks: Some(masks.clone()),
            classes: [("human".to_owned(), masks)].into(),
            ..GivenTruth::default()
        };
        let notes = Notes::default();
        attach(&scenes.imported, None, &given, &notes).unwrap();
        // New masks take the line on earlier ones along.
        for lines in [notes.take(), of_scene()] {
            assert_eq!(
                count(&lines, "moving content mark"),
                told,
                "{name}: {lines:?}"
            );
            assert_eq!(
                count(&lines, "masks of human mark"),
                told,
                "{name}: {lines:?}"
            );
        }
    }
}

/// One map for all frames is that of a camera that stands; maps of another shape would be stretched.
#[test]
fn repeated_distances_are_told_and_other_shapes_refused() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    let attached = |size: [u32; 2], is_repeated: bool| {
        let given = scenes.depth();
        for frame in 0..FRAMES {
            let value = if is_repeated {
                1000
            } else {
                1000 + frame as u16
            };
            let image = image::ImageBuffer::from_pixel(size[0], size[1], image::Luma([value]));
            let file = given.folder.join(format!("{frame:06}.png"));
            image.save(file).unwrap();
        }
        let truth = GivenTruth {
            depth: Some(given),
            ..GivenTruth::default()
        };
        let notes = Notes::default();
        let ended = attach(&scenes.imported, None, &truth, &notes);
        ended.map(|_| {
            notes
                .take()
                .iter()
                .filter(|line| line.contains("repeat the one"))
                .count()
        })
    };
    assert_eq!(attached([256, 128], false).unwrap(), 0);
    assert_eq!(attached([256, 128], true).unwrap(), 1);
    assert_eq!(attached([128, 64], false).unwrap(), 0);
    let refusal = attached([256, 144], false).unwrap_err().to_string();
    assert!(refusal.contains("shape of the frames"), "{refusal}");
}
