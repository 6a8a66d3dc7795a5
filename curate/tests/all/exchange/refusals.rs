//! Refusals: scenes that no format holds, names that collide or lead elsewhere.

use super::*;

#[test]
fn what_cannot_be_exchanged_is_refused() {
    let (folder, _) = scene();
    let out = tempfile::tempdir().unwrap();
    let message = |format: &str, out: &Path| {
        export_all(format, folder.path(), out)
            .unwrap_err()
            .to_string()
    };
    assert!(
        message("blender", &out.path().join("x"))
            .contains("known: openmvg, colmap, colmap-binary, nerfstudio, hm3d, frames")
    );
    fs::write(out.path().join("mine.txt"), "x").unwrap();
    assert!(message("colmap", out.path()).contains("is not empty"));
    assert!(out.path().join("mine.txt").is_file());

    let export = exported("colmap", folder.path());
    let from = export.path().join("scene");
    fs::remove_file(from.join("times.csv")).unwrap();
    let request = |out| ImportRequest::new(&from, "colmap", "x", out);
    let back = export.path().join("back");
    let error = import(&request(&back)).unwrap_err().to_string();
    assert!(error.contains("give --fps"), "{error}");
    let by_rate = ImportRequest {
        frames_per_second: Some(10.0),
        ..request(&back)
    };
    // The refused import has left nothing that would stand in the way.
    let times: Vec<f64> = import(&by_rate)
        .unwrap()
        .frames
        .iter()
        .map(|f| f.time_seconds)
        .collect();
    assert_eq!(times, [0.0, 0.1, 0.2, 0.3, 0.4]);
    fs::write(from.join("images/000002.png"), "no image").unwrap();
    let error = import(&ImportRequest {
        out: &export.path().join("other"),
        ..by_rate
    })
    .unwrap_err()
    .to_string();
    assert!(error.contains("000002.png: not a usable image"), "{error}");
    let file = from.join("images/000001.png");
    let other = export.path().join("other");
    let error = import(&ImportRequest::new(&file, "colmap", "x", &other)).unwrap_err();
    assert!(error.to_string().contains("must be a folder"), "{error}");
    // A finished folder is moved to its name.
    for out in [".", "..", "/"] {
        let error = import(&ImportRequest::new(&from, "colmap", "x", Path::new(out))).unwrap_err();
        assert!(error.to_string().contains("name of a folder"), "{error}");
    }
}

/// Frames stay apart, and no file from outside of the scene's folder is handed on.
#[test]
fn exports_merge_no_frames_and_leave_their_folder_alone() {
    let (folder, scene) = scene();
    let out = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("more")).unwrap();
    fs::copy(
        folder.path().join("frames/000000.png"),
        folder.path().join("more/000001.png"),
    )
    .unwrap();
    for (image, reason) in [
        ("frames/000003.png", "frames 0 and 3 have one file name"),
        ("more/000001.png", "frames 0 and 1 have one file name"),
        ("/etc/hostname", "must name a file in its folder"),
        ("../000000.png", "must name a file in its folder"),
        ("", "must name a file in its folder"),
    ] {
        let mut edited = scene.clone();
        edited.frames[0].image = image.to_owned();
        store::write_record(&folder.path().join("scene.json"), &edited).unwrap();
        for format in ["openmvg", "colmap", "nerfstudio", "hm3d"] {
            let to = out.path().join("x");
            let error = export_all(format, folder.path(), &to).unwrap_err();
            assert!(error.to_string().contains(reason), "{format}: {error}");
            assert!(!to.exists());
        }
    }
}

#[test]
fn imports_read_nothing_outside_of_their_folder() {
    let (folder, _) = scene();
    for (format, file, inside, outside) in [
        (
            "nerfstudio",
            "transforms.json",
            "images/000001.png",
            "../outside.png",
        ),
        (
            "nerfstudio",
            "transforms.json",
            "points.ply",
            "../outside.ply",
        ),
        (
            "openmvg",
            "data_views.json",
            "000001.png",
            "../../outside.png",
        ),
        (
            "colmap",
            "sparse/0/images.txt",
            "000001.png",
            "../../outside.png",
        ),
    ] {
        let place = exported(format, folder.path());
        let from = place.path().join("scene");
        fs::copy(
            folder.path().join("frames/000001.png"),
            place.path().join("outside.png"),
        )
        .unwrap();
        fs::copy(
            folder.path().join("points.ply"),
            place.path().join("outside.ply"),
        )
        .unwrap();
        let text = fs::read_to_string(from.join(file)).unwrap();
        assert!(text.contains(inside), "{text}");
        fs::write(from.join(file), text.replace(inside, outside)).unwrap();
        let request = ImportRequest {
            folder: &from,
            format,
            id: "x",
            frames_per_second: None,
            masks: MaskMeaning::Moving,
            out: &place.path().join("back"),
        };
        let error = import(&request).unwrap_err().to_string();
        assert!(
            error.contains("leads out of the folder"),
            "{format}: {error}"
        );
    }
}

/// A refusal names the folder that was to be filled, and not the one that stood for it.
#[test]
fn refusals_name_no_temporary_folder() {
    let (folder, mut scene) = scene();
    scene.camera = PinholeCamera::new([32, 16], [20.0, 21.0], [16.0, 8.0]).into();
    store::write_record(&folder.path().join("scene.json"), &scene).unwrap();
    for format in ["hm3d", "openmvg"] {
        let out = folder.path().join("to").join(format);
        let error = export_all(format, folder.path(), &out).unwrap_err();
        let names_it = matches!(&error, CurateError::Input { path, .. } if *path == out);
        assert!(names_it, "{format}: {error}");
    }
}
