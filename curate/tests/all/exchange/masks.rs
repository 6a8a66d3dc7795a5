//! Masks of other tools for pixels outside the scene.

use super::{
    foreign::{Foreign, write_colmap_text},
    *,
};

/// Tools with one kind of masks, for pixels to ignore.
#[test]
fn masks_of_other_tools_may_mark_what_is_ignored() {
    let (folder, original) = scene();
    let export = exported("nerfstudio", folder.path());
    let from = export.path().join("scene");
    fs::remove_dir_all(from.join("ignore")).unwrap();
    let back = export.path().join("back");
    let imported = import(&ImportRequest {
        masks: MaskMeaning::Ignored,
        ..ImportRequest::new(&from, "nerfstudio", &original.id, &back)
    })
    .unwrap();
    for (frame, expected) in imported.frames.iter().zip(&original.frames) {
        assert_eq!(frame.mask, None);
        let read = |file: &String| Mask::read(&folder.path().join(file)).unwrap();
        let both = [&expected.mask, &expected.ignore_mask].map(|file| file.as_ref().map(read));
        let expected = match both {
            [Some(mask), Some(ignored)] => mask.united(&ignored),
            [Some(mask), None] | [None, Some(mask)] => mask,
            [None, None] => unreachable!("every frame has a mask"),
        };
        let found = Mask::read(&back.join(frame.ignore_mask.as_ref().unwrap())).unwrap();
        assert_eq!(found, expected);
    }
}

/// Ignored objects are not objects, and a frame without remaining pixels has no pose.
#[test]
fn objects_may_be_what_is_ignored() {
    let (folder, original) = scene();
    let export = exported("frames", folder.path());
    let from = export.path().join("scene");
    fs::remove_dir_all(from.join("ignore")).unwrap();
    fs::remove_file(from.join("scene.json")).unwrap();
    // Without the record the frame without a pose is left out, and its mask that of no frame.
    fs::remove_file(from.join("mask/000005.png")).unwrap();
    let all = Mask::new(32, 16, vec![255; 32 * 16]);
    all.write_png(&from.join("mask/000003.png")).unwrap();
    let back = export.path().join("back");
    let imported = import(&ImportRequest {
        masks: MaskMeaning::Ignored,
        ..ImportRequest::new(&from, "frames", &original.id, &back)
    })
    .unwrap();
    for (number, frame) in imported.frames.iter().enumerate() {
        assert!(frame.objects.is_empty() && frame.mask.is_none());
        assert_eq!(frame.ignore_mask.is_some(), number != 1);
        assert_eq!(frame.pose.is_some(), number != 3);
    }
}

/// Masks beside the frames of an export that were saved anew as labels mark the same, and that is told.
#[test]
fn labels_of_what_is_ignored_are_told() {
    let (folder, original) = scene();
    let export = exported("frames", folder.path());
    let from = export.path().join("scene");
    let files: Vec<_> = fs::read_dir(from.join("ignore"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    assert_eq!(files.len(), 2);
    for file in files {
        let mut mask = Mask::read(&file).unwrap();
        for value in &mut mask.data {
            *value = (*value).min(4);
        }
        mask.write_png(&file).unwrap();
    }
    let back = export.path().join("back");
    let imported = import(&ImportRequest::new(&from, "frames", &original.id, &back)).unwrap();
    for (frame, expected) in imported.frames.iter().zip(&original.frames) {
        let read = |root: &Path, file: &Option<String>| {
            let file = file.as_ref()?;
            Some(Mask::read(&root.join(file)).unwrap())
        };
        assert_eq!(
            read(&back, &frame.ignore_mask),
            read(folder.path(), &expected.ignore_mask)
        );
    }
    let problems = imported.validation.problems.iter();
    let told = problems.filter(|line| line.contains("labels"));
    assert_eq!(told.count(), 1, "{:?}", imported.validation.problems);
}

/// The data parser of nerfstudio asks for masks of all frames or of none; white ones hide nothing, and come back as
/// none.
#[test]
fn nerfstudio_gets_masks_of_all_frames_or_of_none() {
    let (folder, mut scene) = scene();
    let record = folder.path().join("scene.json");
    let exported_masks = || {
        let export = exported("nerfstudio", folder.path());
        let transforms = json(&export.path().join("scene/transforms.json"));
        let frames = transforms["frames"].as_array().unwrap().clone();
        let files: Vec<Option<Mask>> = frames
            .iter()
            .map(|frame| {
                let file = frame["mask_path"].as_str()?;
                Some(Mask::read(&export.path().join("scene").join(file)).unwrap())
            })
            .collect();
        (export, files)
    };
    for frame in &mut scene.frames {
        frame.ignore_mask = None;
    }
    store::write_record(&record, &scene).unwrap();
    let (export, files) = exported_masks();
    assert_eq!(files.len(), 5);
    let is_white = |mask: &Mask| mask.data.iter().all(|&value| value == 255);
    let white: Vec<bool> = files
        .iter()
        .map(|mask| is_white(mask.as_ref().unwrap()))
        .collect();
    assert_eq!(white, [false, true, false, false, false]);
    let back = export.path().join("back");
    let imported = import(&ImportRequest::new(
        &export.path().join("scene"),
        "nerfstudio",
        &scene.id,
        &back,
    ))
    .unwrap();
    for (frame, expected) in imported.frames.iter().zip(&scene.frames) {
        let read = |root: &Path, file: &Option<String>| {
            let file = file.as_ref()?;
            Some(Mask::read(&root.join(file)).unwrap())
        };
        assert_eq!(
            read(&back, &frame.mask),
            read(folder.path(), &expected.mask)
        );
    }
    for frame in &mut scene.frames {
        frame.mask = None;
    }
    store::write_record(&record, &scene).unwrap();
    let (export, files) = exported_masks();
    assert!(files.iter().all(Option::is_none));
    assert!(!export.path().join("scene/masks").exists());
}

fn is_of_unread_images(line: &str) -> bool {
    line.contains("that are not read") || line.contains("no frame has")
}

/// Masks and distances under names of other programs would be lost without a word. COLMAP's mask is `a.png.png`.
#[test]
fn images_that_no_frame_has_are_told() {
    let lines = |others: &[(&str, u8)]| -> Vec<String> {
        let images = [("images/a.png", 1), ("images/b.png", 2)];
        let foreign = Foreign::new([32, 16], &images);
        let camera = "1 EQUIRECTANGULAR 32 16 32 16\n";
        let rows = [(1, 1, "a.png", 1), (2, 1, "b.png", 2)];
        write_colmap_text(&foreign, "sparse/0", camera, &rows);
        for (name, grey) in others {
            foreign.paint(name, |_, _| [*grey; 3]);
        }
        foreign.write("notes/read.txt", "no image");
        let problems = foreign.import("colmap").unwrap().validation.problems;
        let lines = problems.into_iter();
        lines.filter(|line| is_of_unread_images(line)).collect()
    };
    assert_eq!(lines(&[]), [""; 0]);
    for (others, expected) in [
        (
            &[
                ("masks/a.png", 255),
                ("masks/b.png", 255),
                ("depth/far/a.png", 9),
                (".cache/a.png", 9),
            ][..],
            "2 (depth/ with 1, masks/ with 2)",
        ),
        (
            &[
                ("masks/a.png.png", 255),
                ("masks/c.png.png", 255),
                ("ignore/a.png", 0),
            ][..],
            "1 (masks/c.png.png)",
        ),
    ] {
        let found = lines(others);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].ends_with(expected), "{found:?}");
    }
    let (folder, original) = scene();
    for format in written_formats() {
        let export = exported(format.id, folder.path());
        let (from, back) = (export.path().join("scene"), export.path().join("back"));
        let request = ImportRequest::new(&from, format.id, &original.id, &back);
        let problems = import(&request).unwrap().validation.problems;
        let mut lines = problems.iter();
        assert!(!lines.any(|line| is_of_unread_images(line)), "{problems:?}");
    }
}

/// White marks dynamic regions in masks of some programs, and black in those of COLMAP.
#[test]
fn masks_that_mark_most_as_moving_are_told() {
    let lines = |greys: [u8; 3], masks: MaskMeaning| -> Vec<String> {
        let images = ["images/a.png", "images/b.png", "images/c.png"];
        let foreign = Foreign::new([32, 16], &images.map(|name| (name, 1)));
        let rows = [(1, 1, "a.png", 1), (2, 1, "b.png", 2), (3, 1, "c.png", 3)];
        write_colmap_text(
            &foreign,
            "sparse/0",
            "1 EQUIRECTANGULAR 32 16 32 16\n",
            &rows,
        );
        for (name, grey) in ["a", "b", "c"].into_iter().zip(greys) {
            // A corner keeps the mask from marking everything.
            let colour = |x: u32, _| if x < 3 { [255 - grey; 3] } else { [grey; 3] };
            foreign.paint(&format!("masks/{name}.png.png"), colour);
        }
        let out = foreign.path().join("out");
        let source = foreign.path().join("in");
        let request = ImportRequest {
            frames_per_second: Some(10.0),
            masks,
            ..ImportRequest::new(&source, "colmap", "foreign", &out)
        };
        let problems = import(&request).unwrap().validation.problems.into_iter();
        problems
            .filter(|line| line.contains("moving content mark"))
            .collect()
    };
    assert_eq!(lines([255; 3], MaskMeaning::Moving), [""; 0]);
    assert_eq!(lines([0, 255, 255], MaskMeaning::Moving), [""; 0]);
    let found = lines([0, 255, 0], MaskMeaning::Moving);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(
        found[0].starts_with("masks of moving content mark 91 %"),
        "{found:?}"
    );
    assert_eq!(lines([0; 3], MaskMeaning::Ignored), [""; 0]);
}
