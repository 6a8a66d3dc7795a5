//! Exports in our own format hold all of a scene; others list their omissions.

use std::collections::BTreeSet;

use omnilife_curate::exchange::scene_id;
use omnilife_schemas::{
    records::{
        Capture, DepthImage, DepthPrior, DistanceConvention, ObjectClass, Protocol, PublishedSplit,
        SceneObject, ScoredViews, Split, SplitRule,
    },
    testing::Notes,
};
use proptest::prelude::*;

use super::*;

/// Forms of the names of images by their number.
pub(super) const NAMES: [fn(u32) -> String; 4] = [
    |n| format!("{n:06}.png"),
    |n| format!("{n}.png"),
    |n| format!("Über uns ({n}).png"),
    |n| format!("cut.{n}_v2.png"),
];
const OBJECTS: [(&str, &str); 2] = [("walker é", "human"), ("car 2", "vehicle")];

/// A frame with its number and what it has: bits of a number.
pub(super) type DrawnFrame = (u32, u16);

/// Writes a scene of these frames; the first one has a pose.
pub(super) fn write_scene(root: &Path, drawn: &[DrawnFrame], name: fn(u32) -> String) -> Scene {
    let numbered = (0_u32..).zip(drawn);
    let frames: Vec<SceneFrame> = numbered
        .map(|(at, &(number, bits))| frame(root, at, &name(number), bits))
        .collect();
    let posed = frames.iter().filter(|frame| frame.pose.is_some()).count() as u32;
    let points = PointCloud {
        positions: vec![[0.1, -2.5, 3.0e-3], [1.0e3, 4.0, -7.25]],
        colours: vec![[1, 2, 3], [250, 128, 0]],
    };
    points.write_ply(&root.join("points.ply")).unwrap();
    let scene = Scene {
        id: "walk/seq-007".to_owned(),
        camera: CAMERA.into(),
        scale: Scale::Metres,
        points: Some("points.ply".to_owned()),
        pose_source: PoseSource::Sfm {
            tool: "COLMAP 4.2".to_owned(),
            configuration: "sphere".to_owned(),
            wall_seconds: 12,
        },
        validation: PoseValidation {
            status: ValidationStatus::Unstable,
            registered_frames: posed,
            total_frames: frames.len() as u32,
            measures: [("median_error_pixels".to_owned(), 0.1 + 0.2)].into(),
            problems: vec!["few points".to_owned()],
        },
        published_split: (frames.len() > 1).then(|| PublishedSplit {
            source: "by hand".to_owned(),
            input_views: vec![0],
            novel_views: vec![frames.len() as u32 - 1],
        }),
        objects: (OBJECTS
            .iter()
            .zip([ObjectClass::Person, ObjectClass::Vehicle]))
        .map(|((name, _), class)| ((*name).to_owned(), SceneObject { class }))
        .collect(),
        frames,
    };
    store::write_record(&root.join("scene.json"), &scene).unwrap();
    scene
}

fn frame(root: &Path, at: u32, name: &str, bits: u16) -> SceneFrame {
    let has = |bit: u16| (bits >> bit) & 1 == 1;
    let stem = name.strip_suffix(".png").unwrap();
    let image = format!("frames/{name}");
    let path = |file: &str| {
        let path = root.join(file);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        path
    };
    let pixels: Vec<u8> = (0..32 * 16 * 3)
        .map(|p| (p * (at + 3) % 251) as u8)
        .collect();
    rgb::write_rgb8_png(&path(&image), 32, 16, &pixels).unwrap();
    let mask = |folder: &str, step: u32| {
        let file = format!("{folder}/{stem}.png");
        let data = (0..32 * 16).map(|p| 255 * u8::from(p % (at + step) == 0));
        Mask::new(32, 16, data.collect())
            .write_png(&path(&file))
            .unwrap();
        file
    };
    let distances = |folder: &str, value: f32| {
        let file = format!("{folder}/{stem}.npy");
        npy::write_f32(&path(&file), &[16, 32], &vec![value; 16 * 32]).unwrap();
        file
    };
    let t = f64::from(at);
    let turn = DQuat::from_euler(glam::EulerRot::YXZ, 0.9 * t, 0.2 * t - 0.4, 0.1 * t);
    SceneFrame {
        image,
        time_seconds: 3.0 + 0.1 * t,
        capture: has(8).then(|| capture(t)),
        pose: (at == 0 || has(0)).then(|| Pose::new(turn, dvec3(0.3 * t, -0.7, 1.0 / (1.0 + t)))),
        mask: has(1).then(|| mask("masks", 2)),
        ignore_mask: has(2).then(|| mask("ignore", 3)),
        classes: (OBJECTS.iter().filter(|_| has(3)))
            .map(|(_, class)| ((*class).to_owned(), mask(&format!("classes/{class}"), 4)))
            .collect(),
        objects: (OBJECTS.iter().zip([4, 5]))
            .filter(|(_, bit)| has(*bit))
            .map(|((object, _), bit)| {
                let file = mask(&format!("masks/{object}"), 5 + u32::from(bit));
                ((*object).to_owned(), file)
            })
            .collect(),
        boxes: (OBJECTS.iter().zip([4, 5]))
            .filter(|(_, bit)| has(*bit))
            .map(|((object, _), _)| ((*object).to_owned(), [0.5 * t, 1.0 / 3.0, 2.0, 3.0]))
            .collect(),
        depth: has(6).then(|| DepthImage {
            file: distances("depth", 2.5),
            unit: 0.1,
        }),
        depth_prior: has(7).then(|| DepthPrior {
            file: distances("depth-prior", 7.0),
            unit: 0.3,
            width: 32,
            height: 16,
            convention: DistanceConvention::Z,
            source: "a network".to_owned(),
        }),
    }
}

/// Facts of a still, as a camera states them.
fn capture(number: f64) -> Capture {
    Capture {
        time: Some("2024-05-06T07:08:09.25+02:00".to_owned()),
        latitude_degrees: Some(48.1 + 1e-5 * number),
        direction_degrees: Some(0.1 + 0.2),
        ..Capture::default()
    }
}

pub(super) fn import_frames(folder: &Path, out: &Path) -> Result<Scene, CurateError> {
    import(&ImportRequest::new(
        folder,
        "frames",
        &scene_id("frames", folder)?,
        out,
    ))
}

/// Contents of all files that a scene names, as pixels or bytes.
fn contents(root: &Path, scene: &Scene) -> Vec<Vec<u8>> {
    let files = scene.frames.iter().flat_map(SceneFrame::files);
    let files = files.chain(&scene.points).map(|file| root.join(file));
    files
        .map(|file| match image::open(&file) {
            Ok(image) => image.to_rgb8().into_raw(),
            Err(_) => fs::read(&file).unwrap(),
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    /// A scene, its record apart from the lines of the import, and every file come back.
    #[test]
    fn a_scene_comes_back_whole(
        drawn in proptest::collection::btree_map(0_u32..400, 0_u16..512, 1..6),
        naming in 0..NAMES.len(),
    ) {
        let drawn: Vec<DrawnFrame> = drawn.into_iter().collect();
        let folder = tempfile::tempdir().unwrap();
        let original = write_scene(folder.path(), &drawn, NAMES[naming]);
        let export = exported("frames", folder.path());
        let back = export.path().join("back");
        let mut imported = import_frames(&export.path().join("scene"), &back).unwrap();
        prop_assert_eq!(contents(&back, &imported), contents(folder.path(), &original));
        let problems = std::mem::take(&mut imported.validation.problems);
        prop_assert!(problems.contains(&original.validation.problems[0]));
        let mut expected = original;
        expected.validation.problems = Vec::new();
        prop_assert_eq!(imported, expected);
    }
}

/// Bits of a frame that has everything.
const EVERYTHING: u16 = 0x1ff;

/// An export is a scene that everything reads, and a second one holds the same files.
#[test]
fn an_export_of_an_export_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path(), &[(3, EVERYTHING), (9, EVERYTHING)], NAMES[2]);
    let first = exported("frames", folder.path());
    let second = exported("frames", &first.path().join("scene"));
    let record = |place: &TempDir| {
        let path = place.path().join("scene/scene.json");
        store::read_record::<Scene>(&path).unwrap()
    };
    let (one, other) = (record(&first), record(&second));
    assert_eq!(one, other);
    let all = |place: &TempDir, scene: &Scene| contents(&place.path().join("scene"), scene);
    assert_eq!(all(&first, &one), all(&second, &other));
}

/// Frames for testing are left out of an export that has the others alone, and their files with them.
#[test]
fn frames_for_testing_stay_behind() {
    let folder = tempfile::tempdir().unwrap();
    let frames = [(0, EVERYTHING), (1, EVERYTHING), (2, EVERYTHING)];
    let original = write_scene(folder.path(), &frames, NAMES[0]);
    let protocol = Protocol::new("test", SplitRule::AllGiven, ScoredViews::Novel);
    let split = folder.path().join("split.json");
    let record = Split::new(&original.id, protocol, vec![0, 2], vec![1]);
    store::write_record(&split, &record).unwrap();
    let out = folder.path().join("out");
    let request = ExportRequest {
        split: Some(&split),
        given_only: true,
        ..ExportRequest::new(folder.path(), "frames", &out)
    };
    export(&request, &Silent).unwrap();
    let back = import_frames(&out, &folder.path().join("back")).unwrap();
    let times: Vec<f64> = back.frames.iter().map(|frame| frame.time_seconds).collect();
    let expected = [0, 2].map(|at: usize| original.frames[at].time_seconds);
    assert_eq!(times, expected);
    assert_eq!(back.published_split, None);
    assert!(!out.join("mask/000001.png").exists());
}

/// Nothing that speaks of frames beside the record is left out in silence.
#[test]
fn files_that_disagree_with_the_record_are_refused() {
    /// A change beside the record.
    type Change = fn(&Path);
    let changes: [(&str, Change); 6] = [
        ("mask/stray.png", |root| {
            fs::copy(root.join("mask/0.png"), root.join("mask/stray.png")).unwrap();
        }),
        ("poses.json", |root| {
            let text = fs::read_to_string(root.join("poses.json")).unwrap();
            fs::write(root.join("poses.json"), text.replace("metres", "arbitrary")).unwrap();
        }),
        ("times.csv", |root| {
            fs::write(
                root.join("times.csv"),
                "image,time_seconds\n0.png,7\n1.png,8\n",
            )
            .unwrap();
        }),
        ("classes/human/1.png", |root| {
            fs::remove_file(root.join("classes/human/1.png")).unwrap();
        }),
        ("up/car 2", |root| {
            let text = fs::read_to_string(root.join("scene.json")).unwrap();
            let text = text.replace("\"car 2\":", "\"up/car 2\":");
            fs::write(root.join("scene.json"), text).unwrap();
        }),
        ("frame 9", |root| {
            let text = fs::read_to_string(root.join("scene.json")).unwrap();
            let mut record: Value = serde_json::from_str(&text).unwrap();
            record["published_split"]["input_views"] = serde_json::json!([9]);
            fs::write(root.join("scene.json"), record.to_string()).unwrap();
        }),
    ];
    for (named, change) in changes {
        let folder = tempfile::tempdir().unwrap();
        write_scene(folder.path(), &[(0, EVERYTHING), (1, EVERYTHING)], NAMES[1]);
        let export = exported("frames", folder.path());
        let from = export.path().join("scene");
        change(&from);
        let line = import_frames(&from, &export.path().join("back")).unwrap_err();
        let line = line.to_string();
        assert!(
            line.contains(named) && !line.contains('\n'),
            "{named}: {line}"
        );
    }
}

/// A name of an object that cannot be a folder goes nowhere.
#[test]
fn names_of_objects_lead_out_of_no_folder() {
    for name in ["..", "a/b", "../x", "", "a\\b"] {
        let folder = tempfile::tempdir().unwrap();
        let mut scene = write_scene(folder.path(), &[(0, 0)], NAMES[0]);
        let image = scene.frames[0].image.clone();
        scene.frames[0].objects = [(name.to_owned(), image)].into();
        store::write_record(&folder.path().join("scene.json"), &scene).unwrap();
        let out = folder.path().join("out");
        let error = export_all("frames", folder.path(), &out).unwrap_err();
        assert!(
            matches!(error, CurateError::Input { .. }),
            "{name:?}: {error}"
        );
        assert!(!out.exists());
    }
}

/// Poses without a record of ours have the scale that they say.
#[test]
fn the_scale_of_poses_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let original = write_scene(folder.path(), &[(0, 1), (1, 1)], NAMES[0]);
    let export = exported("frames", folder.path());
    let from = export.path().join("scene");
    fs::remove_file(from.join("scene.json")).unwrap();
    let scene = import_frames(&from, &export.path().join("back")).unwrap();
    assert_eq!(scene.scale, Scale::Metres);
    assert_eq!(scene.id, "scene");
    assert_eq!(scene.frames.len(), original.frames.len());
    for (frame, expected) in scene.frames.iter().zip(&original.frames) {
        assert_eq!(frame.pose, expected.pose);
    }
}

/// Images that are resized are no longer those of the record: poses, masks and the scale are there, and the rest is
/// told.
#[test]
fn resized_frames_have_no_record() {
    let folder = tempfile::tempdir().unwrap();
    let without_ignored = EVERYTHING & !(1 << 2);
    let drawn = [(0, without_ignored), (1, without_ignored)];
    let original = write_scene(folder.path(), &drawn, NAMES[0]);
    let out = folder.path().join("small");
    let notes = Notes::default();
    let request = ExportRequest {
        pad_to: Some([16, 8]),
        ..ExportRequest::new(folder.path(), "frames", &out)
    };
    export(&request, &notes).unwrap();
    let lines = notes.take();
    let told = |part: &str| lines.iter().any(|line| line.contains(part));
    for part in ["objects", "classes", "no distances", "estimated distances"] {
        assert!(told(part), "{part}: {lines:?}");
    }
    assert!(
        !told("unit of the world") && !told("no points"),
        "{lines:?}"
    );
    let scene = import_frames(&out, &folder.path().join("back")).unwrap();
    assert_eq!(scene.scale, Scale::Metres);
    assert_eq!((scene.camera.width(), scene.camera.height()), (16, 8));
    for (frame, expected) in scene.frames.iter().zip(&original.frames) {
        assert_eq!(frame.pose, expected.pose);
        assert!(frame.mask.is_some());
        assert_eq!(frame.depth, None);
    }
}

/// Every part that a format does not hold is a line, where the scene has something of it.
#[test]
fn exports_say_what_they_leave_out() {
    let parts = [
        "points",
        "names",
        "masks of objects",
        "masks of classes",
        "distances",
        "estimated distances",
        "unit",
        "frames without a pose",
        "published split",
        "times and places of stills",
    ];
    let folder = tempfile::tempdir().unwrap();
    let frames = [(5, EVERYTHING), (6, 0), (7, EVERYTHING)];
    write_scene(folder.path(), &frames, NAMES[0]);
    for format in written_formats() {
        let notes = Notes::default();
        let exports = tempfile::tempdir().unwrap();
        let out = exports.path().join(format.id);
        let request = ExportRequest::new(folder.path(), format.id, &out);
        export(&request, &notes).unwrap();
        let lines = notes.take();
        let said: BTreeSet<&str> = parts
            .into_iter()
            .filter(|part| {
                let words = format!("{} holds no {part}", format.id);
                lines.iter().any(|line| line.contains(&words))
            })
            .collect();
        let expected: BTreeSet<&str> = match format.id {
            "frames" => [].into(),
            "hm3d" => parts.into(),
            _ => parts.into_iter().skip(2).collect(),
        };
        assert_eq!(said, expected, "{}: {lines:?}", format.id);
    }
    let notes = Notes::default();
    let out = folder.path().join("again");
    let request = ExportRequest::new(folder.path(), "colmap", &out);
    export(&request, &notes).unwrap();
    let lines = notes.take();
    let objects = lines
        .iter()
        .filter(|line| line.contains(" 2 ") && line.contains("car 2, walker é"));
    assert_eq!(objects.count(), 1, "{lines:?}");
}

/// COLMAP's readers of text end a name at a space: a text model that has one would name other images.
#[test]
fn text_models_of_colmap_hold_no_spaces_in_names() {
    let folder = tempfile::tempdir().unwrap();
    let original = write_scene(folder.path(), &[(0, 1), (3, 1)], NAMES[2]);
    let out = folder.path().join("text");
    let line = export_all("colmap", folder.path(), &out)
        .unwrap_err()
        .to_string();
    assert!(
        line.contains("Über uns (0).png") && line.contains("colmap-binary"),
        "{line}"
    );
    let export = exported("colmap-binary", folder.path());
    let back = import(&ImportRequest::new(
        &export.path().join("scene"),
        "colmap",
        "x",
        &export.path().join("back"),
    ));
    let images = |scene: &Scene| -> Vec<String> {
        scene
            .frames
            .iter()
            .map(|frame| frame.image.clone())
            .collect()
    };
    assert_eq!(images(&back.unwrap()), images(&original));
}
