//! Objects in exports to formats with one kind of masks, and in folders of others.

use omnilife_schemas::records::ObjectClass;

use super::{
    whole_scenes::{NAMES, import_frames, write_scene},
    *,
};

/// Objects of a scene without masks of what moves: formats with one kind of mask get their union.
#[test]
fn what_moves_is_exported_as_the_union_of_the_objects() {
    let folder = tempfile::tempdir().unwrap();
    let objects = (1 << 4) | (1 << 5);
    let original = write_scene(folder.path(), &[(0, 1 | objects), (1, 1)], NAMES[0]);
    let export = exported("nerfstudio", folder.path());
    let transforms = json(&export.path().join("scene/transforms.json"));
    let file = transforms["frames"][0]["mask_path"].as_str().unwrap();
    let used = Mask::read(&export.path().join("scene").join(file)).unwrap();
    let mut moving = used.inverted().data;
    for file in original.frames[0].objects.values() {
        let mask = Mask::read(&folder.path().join(file)).unwrap();
        assert!(mask.marks_anything());
        for (moves, object) in moving.iter_mut().zip(mask.data) {
            assert!(object == 0 || *moves != 0);
            // Objects overlap: their pixels are counted once.
            if object != 0 {
                *moves = 1;
            }
        }
    }
    assert!(moving.iter().all(|&moves| moves <= 1) && moving.contains(&0));
}

/// A folder of masks of others may say what its objects are.
#[test]
fn classes_of_objects_are_read_beside_their_masks() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(
        folder.path(),
        &[(0, 1 | (1 << 4) | (1 << 5)), (1, 1)],
        NAMES[0],
    );
    let export = exported("frames", folder.path());
    let from = export.path().join("scene");
    fs::remove_file(from.join("scene.json")).unwrap();
    let with_classes = |text: &str, place: &str| {
        fs::write(from.join("classes.json"), text).unwrap();
        import_frames(&from, &export.path().join(place))
    };
    let scene = with_classes("{\"car 2\": \"vehicle\"}", "back").unwrap();
    assert_eq!(scene.class_of("car 2"), ObjectClass::Vehicle);
    assert_eq!(scene.class_of("walker é"), ObjectClass::Other);
    assert_eq!(scene.object_names().len(), 2);
    assert!(scene.frames.iter().all(|frame| frame.mask.is_none()));
    for (text, named) in [
        ("{\"dog\": \"other\"}", "dog"),
        ("{\"car 2\": \"boat\"}", "boat"),
    ] {
        let error = with_classes(text, "refused").unwrap_err().to_string();
        assert!(error.contains(named), "{error}");
    }
}
