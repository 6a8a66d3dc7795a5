//! Files attached to scenes: the same in imported and curated ones, replaced, and refused without a trace.

#[cfg(unix)]
mod programs;
mod surplus;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use omnilife_curate::{
    AttachRequest, CurateError, CurateSettings, GivenDepth, GivenPrior, GivenTruth, IgnoredRegion,
    PoseRequest, curate_video,
    exchange::{ExportRequest, ImportRequest, export, import},
    pose_sequence, pose_sequence_with,
};
use omnilife_schemas::{
    Classified, ErrorKind, Pose, npy,
    progress::{Progress, Silent},
    records::{
        DistanceConvention, DistanceGrid, PoseConvention, PoseSource, PosedFrame, Poses, Scale,
        Scene, SceneFrame, ValidationStatus,
    },
    rgb::Mask,
    store,
    testing::Notes,
};
use support::erp_clip;

use crate::support;

const FRAMES: usize = 12;

/// A posed sequence, its poses, and the same scene as it comes back from another tool's format.
struct Scenes {
    folder: PathBuf,
    sequence: PathBuf,
    request: PoseRequest,
    imported: PathBuf,
}

impl Scenes {
    fn new(folder: &Path, format: &str) -> Self {
        let video = erp_clip(folder, "walk.mp4", &[1], FRAMES, 10);
        let settings = CurateSettings {
            enforce: false,
            ..CurateSettings::default()
        };
        curate_video(&video, &folder.join("walk"), &settings, &Silent).unwrap();
        let poses = Poses::new(
            Scale::Metres,
            None,
            (0..FRAMES)
                .map(|frame| {
                    PosedFrame::new(
                        0.1 * frame as f64,
                        Pose {
                            rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
                            centre: [frame as f64, 0.0, 0.0],
                        },
                    )
                })
                .collect(),
        );
        let file = folder.join("poses.json");
        store::write_record(&file, &poses).unwrap();
        let (sequence, request) = (folder.join("walk/seq-000"), PoseRequest::Given(file));
        pose_sequence(&sequence, &request, &Silent).unwrap();
        let (exported, imported) = (folder.join("exported"), folder.join("imported"));
        let out = ExportRequest::new(&sequence, format, &exported);
        export(&out, &Silent).unwrap();
        import(&ImportRequest::new(&exported, format, "walk", &imported)).unwrap();
        Self {
            folder: folder.to_owned(),
            sequence,
            request,
            imported,
        }
    }

    /// A folder of masks, one per frame, whose first columns are white: more of them with every frame.
    fn masks(&self, name: &str, columns: usize) -> PathBuf {
        let folder = self.folder.join(name);
        fs::create_dir_all(&folder).unwrap();
        for frame in 0..FRAMES {
            let is_white = |at: usize| at % 256 < columns + frame;
            let mask = Mask {
                width: 256,
                height: 128,
                data: (0..256 * 128)
                    .map(|at| 255 * u8::from(is_white(at)))
                    .collect(),
            };
            mask.write_png(&folder.join(format!("{frame:06}.png")))
                .unwrap();
        }
        folder
    }

    fn depth(&self) -> GivenDepth {
        let folder = self.folder.join("true-depth");
        fs::create_dir_all(&folder).unwrap();
        for frame in 0..FRAMES {
            let value = image::Luma([1000 + frame as u16]);
            let image = image::ImageBuffer::from_pixel(256, 128, value);
            image.save(folder.join(format!("{frame:06}.png"))).unwrap();
        }
        GivenDepth {
            folder,
            unit: 0.001,
        }
    }

    fn prior(&self, shape: [usize; 2], value: f32) -> GivenPrior {
        let folder = self.folder.join("estimates");
        fs::create_dir_all(&folder).unwrap();
        for frame in 0..FRAMES {
            let values = vec![value; shape[0] * shape[1]];
            npy::write_f32(&folder.join(format!("{frame:06}.npy")), &shape, &values).unwrap();
        }
        GivenPrior {
            folder,
            unit: 0.5,
            grid: DistanceGrid::HalfPixel,
            convention: DistanceConvention::Ray,
            source: "PanoVGGT".to_owned(),
        }
    }

    fn everything(&self) -> GivenTruth {
        GivenTruth {
            masks: Some(self.masks("moving", 20)),
            ignored: Some(IgnoredRegion::Masks(
                self.masks("tripod", 3).join("000000.png"),
            )),
            depth: Some(self.depth()),
            classes: [("human".to_owned(), self.masks("people", 50))].into(),
            prior: Some(self.prior([16, 32], 4.0)),
            ..GivenTruth::default()
        }
    }
}

/// Attaches existing files.
fn attach(
    folder: &Path,
    poses: Option<&Path>,
    given: &GivenTruth,
    progress: &dyn Progress,
) -> Result<Scene, CurateError> {
    let request = AttachRequest {
        poses: poses.map(Path::to_owned),
        given: given.clone(),
        ..AttachRequest::default()
    };
    omnilife_curate::attach(folder, &request, progress)
}

/// Every file below a folder with its content.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for path in store::paths_in(folder).unwrap() {
        if path.is_dir() {
            files.extend(content(&path));
        } else {
            files.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    files
}

/// The files that frames refer to, with their content, beside the images.
fn attached(folder: &Path, scene: &Scene) -> BTreeMap<String, Vec<u8>> {
    let files = scene.frames.iter().flat_map(|frame| {
        let depth = frame.depth.iter().map(|depth| depth.file.clone());
        let prior = frame.depth_prior.iter().map(|prior| prior.file.clone());
        let masks = frame.mask.iter().chain(&frame.ignore_mask);
        let masks = masks.chain(frame.classes.values()).cloned();
        masks.chain(depth).chain(prior)
    });
    files
        .map(|file| (file.clone(), fs::read(folder.join(file)).unwrap()))
        .collect()
}

/// The entries of a frame, but for its pose, which formats keep to rounding.
fn entries(frame: &SceneFrame) -> SceneFrame {
    SceneFrame {
        pose: None,
        ..frame.clone()
    }
}

#[test]
fn an_imported_scene_gets_what_a_curated_one_does() {
    for format in ["colmap", "nerfstudio"] {
        let temp = tempfile::tempdir().unwrap();
        let scenes = Scenes::new(temp.path(), format);
        let given = scenes.everything();
        let before: Scene = store::read_record(&scenes.imported.join("scene.json")).unwrap();
        let scene = attach(&scenes.imported, None, &given, &Silent).unwrap();
        let read: Scene = store::read_record(&scenes.imported.join("scene.json")).unwrap();
        assert_eq!(read, scene);
        let (sequence, request) = (&scenes.sequence, &scenes.request);
        let curated = pose_sequence_with(sequence, request, &given, &Silent).unwrap();
        for (frame, expected) in scene.frames.iter().zip(&curated.frames) {
            assert_eq!(entries(frame), entries(expected), "{format}");
            assert_eq!(frame.classes.len(), 1);
            assert!(frame.mask.is_some() && frame.ignore_mask.is_some());
            assert!(frame.depth.is_some() && frame.depth_prior.is_some());
        }
        assert_eq!(
            attached(&scenes.imported, &scene),
            attached(sequence, &curated)
        );
        let poses = |scene: &Scene| -> Vec<_> { scene.frames.iter().map(|f| f.pose).collect() };
        assert_eq!(poses(&scene), poses(&before));
        assert_eq!(scene.pose_source, before.pose_source);
        assert_eq!(scene.validation, before.validation);
    }
}

#[test]
fn a_curated_scene_keeps_its_record_of_poses() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    let given = scenes.everything();
    let scene = attach(&scenes.sequence, None, &given, &Silent).unwrap();
    let notes = Notes::default();
    let again = pose_sequence(&scenes.sequence, &scenes.request, &notes).unwrap();
    assert_eq!(again, scene);
    assert!(notes.take().join("|").contains("unchanged"));
    // With the poses themselves it is the same scene.
    let files = attached(&scenes.sequence, &scene);
    let posed = pose_sequence_with(&scenes.sequence, &scenes.request, &given, &Silent).unwrap();
    assert_eq!(posed, scene);
    assert_eq!(attached(&scenes.sequence, &posed), files);
}

#[test]
fn what_is_attached_again_replaces_what_was_there() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    for folder in [&scenes.imported, &scenes.sequence] {
        let mut first = scenes.everything();
        first.ignored = Some(IgnoredRegion::Masks(scenes.masks("tripods", 3)));
        attach(folder, None, &first, &Silent).unwrap();
        assert!(folder.join("ignore/000005.png").is_file());
        let second = GivenTruth {
            masks: Some(scenes.masks("other", 100)),
            ignored: Some(IgnoredRegion::Nadir { degrees: 45.0 }),
            classes: [("vehicle".to_owned(), scenes.masks("cars", 70))].into(),
            ..GivenTruth::default()
        };
        let notes = Notes::default();
        let scene = attach(folder, None, &second, &notes).unwrap();
        let replaced = notes.take();
        let replaced = replaced.iter().filter(|line| line.contains("replaced"));
        assert_eq!(replaced.count(), 2);
        for (number, frame) in scene.frames.iter().enumerate() {
            let mask = Mask::read(&folder.join(frame.mask.as_ref().unwrap())).unwrap();
            let white = mask.data.iter().filter(|&&value| value != 0).count();
            assert_eq!(white, 128 * (100 + number));
            assert_eq!(frame.ignore_mask.as_deref(), Some("ignore/all.png"));
            assert_eq!(frame.classes.len(), 2);
            assert!(frame.depth.is_some() && frame.depth_prior.is_some());
        }
        // Masks of before are gone, and the record does not miss them.
        assert!(!folder.join("ignore/000005.png").exists());
        let third = GivenTruth {
            depth: Some(scenes.depth()),
            ..GivenTruth::default()
        };
        let same = attach(folder, None, &third, &Silent).unwrap();
        assert_eq!(same, scene);
    }
    let notes = Notes::default();
    pose_sequence(&scenes.sequence, &scenes.request, &notes).unwrap();
    assert!(notes.take().join("|").contains("unchanged"));
}

/// An import brings masks of its own, under the names that attached ones get.
#[test]
fn masks_that_were_imported_are_replaced() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "frames");
    let given = |masks: PathBuf| GivenTruth {
        masks: Some(masks),
        ..GivenTruth::default()
    };
    let (first, second) = (scenes.masks("first", 20), scenes.masks("second", 90));
    attach(&scenes.sequence, None, &given(first), &Silent).unwrap();
    let (exported, imported) = (temp.path().join("masked"), temp.path().join("again"));
    let out = ExportRequest::new(&scenes.sequence, "frames", &exported);
    export(&out, &Silent).unwrap();
    let scene = import(&ImportRequest::new(&exported, "frames", "walk", &imported)).unwrap();
    assert!(scene.frames.iter().all(|frame| frame.mask.is_some()));
    let scene = attach(&imported, None, &given(second), &Silent).unwrap();
    let mask = Mask::read(&imported.join(scene.frames[0].mask.as_ref().unwrap())).unwrap();
    assert_eq!(
        mask.data.iter().filter(|&&value| value != 0).count(),
        128 * 90
    );
}

#[test]
fn what_cannot_be_attached_is_refused_and_changes_nothing() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "colmap");
    let refuse = |folder: &Path, poses: Option<&Path>, given: &GivenTruth, reason: &str| {
        let before = content(folder);
        let error = attach(folder, poses, given, &Silent).map(drop).unwrap_err();
        let message = error.to_string();
        assert_eq!(error.error_kind(), ErrorKind::User, "{message}");
        assert!(
            message.contains(reason) && !message.contains('\n'),
            "{message}"
        );
        assert!(content(folder) == before, "{message}");
    };
    // A scene without a record, and one with.
    for folder in [&scenes.imported, &scenes.sequence] {
        let refused = |given: &GivenTruth, reason: &str| refuse(folder, None, given, reason);
        refused(&GivenTruth::default(), "scene.json");
        let masks = scenes.masks("holes", 9);
        fs::remove_file(masks.join("000004.png")).unwrap();
        let mut given = scenes.everything();
        given.masks = Some(masks);
        refused(&given, "11 of 12 frames");
        let square = temp.path().join("square.png");
        image::save_buffer(&square, &[255; 32 * 32], 32, 32, image::ColorType::L8).unwrap();
        given = scenes.everything();
        given.ignored = Some(IgnoredRegion::Masks(square));
        refused(&given, "square.png");
        given = scenes.everything();
        given.prior = Some(scenes.prior([16, 20], 4.0));
        refused(&given, "000000.npy");
        given.prior = Some(scenes.prior([16, 32], f32::NAN));
        refused(&given, "000000.npy");
        given.prior = Some(scenes.prior([16, 32], 0.0));
        refused(&given, "no distance in it is known");
        given = scenes.everything();
        let depth = scenes.depth().folder;
        for frame in 0..FRAMES {
            let nowhere = image::ImageBuffer::from_pixel(256, 128, image::Luma([0_u16]));
            nowhere.save(depth.join(format!("{frame:06}.png"))).unwrap();
        }
        refused(&given, "all are 0");
        given = scenes.everything();
        fs::write(scenes.depth().folder.join("000003.png"), "no image").unwrap();
        refused(&given, "000003.png");
        given = scenes.everything();
        given.depth = given.depth.map(|depth| GivenDepth { unit: 0.0, ..depth });
        refused(&given, "unit");
        given = scenes.everything();
        given
            .classes
            .insert("Of Two".to_owned(), scenes.masks("two", 1));
        refused(&given, "names of classes");
        let PoseRequest::Given(poses) = &scenes.request else {
            panic!("{:?}", scenes.request);
        };
        refuse(folder, Some(poses), &scenes.everything(), "scene.json");
    }
    // A user's file there is foreign.
    let own = scenes.imported.join("classes/human/000002.png");
    fs::create_dir_all(own.parent().unwrap()).unwrap();
    fs::write(&own, "mine").unwrap();
    refuse(&scenes.imported, None, &scenes.everything(), "in the way");
}

/// Takes the poses of the imported scene away.
fn take_poses(scenes: &Scenes) {
    let path = scenes.imported.join("scene.json");
    let mut scene: Scene = store::read_record(&path).unwrap();
    for frame in &mut scene.frames {
        frame.pose = None;
    }
    scene.validation.registered_frames = 0;
    scene.validation.problems = vec![
        "12 of 12 frames have no pose".to_owned(),
        "images are pale".to_owned(),
    ];
    store::write_record(&path, &scene).unwrap();
}

#[test]
fn poses_are_attached_to_a_scene_that_has_none() {
    let temp = tempfile::tempdir().unwrap();
    let scenes = Scenes::new(temp.path(), "nerfstudio");
    take_poses(&scenes);
    let file = temp.path().join("all_poses.npy");
    let given = |convention: Option<PoseConvention>| GivenTruth {
        pose_convention: convention,
        ..GivenTruth::default()
    };
    let to_world = given(Some(PoseConvention::CameraToWorld));
    let row = |frame: usize| {
        let place = [frame as f32, 0.5, -1.0];
        [
            1.0, 0.0, 0.0, place[0], 0.0, 1.0, 0.0, place[1], 0.0, 0.0, 1.0, place[2],
        ]
    };
    let write = |changed: Option<(usize, f32)>, frames: usize| {
        let mut values: Vec<f32> = (0..frames).flat_map(row).collect();
        if let Some((entry, value)) = changed {
            values[entry] = value;
        }
        npy::write_f32(&file, &[frames, 3, 4], &values).unwrap();
    };
    let refused = |truth: &GivenTruth, reason: &str| {
        let before = content(&scenes.imported);
        let error = attach(&scenes.imported, Some(&file), truth, &Silent);
        let message = error.map(drop).unwrap_err().to_string();
        assert!(
            message.contains(reason) && !message.contains('\n'),
            "{message}"
        );
        assert!(content(&scenes.imported) == before, "{message}");
    };
    refused(&to_world, "all_poses.npy");
    write(None, 5);
    refused(&to_world, "5 matrices for 12 frames");
    write(Some((12 + 1, 0.2)), FRAMES);
    refused(&to_world, "matrix 1");
    write(Some((24, f32::NAN)), FRAMES);
    refused(&to_world, "matrix 2");
    write(None, FRAMES);
    refused(&given(None), "--poses-convention");

    let scene = attach(&scenes.imported, Some(&file), &to_world, &Silent).unwrap();
    for (number, frame) in scene.frames.iter().enumerate() {
        let centre = frame.pose.unwrap().centre;
        assert_eq!(centre, [number as f64, 0.5, -1.0]);
    }
    assert_eq!(scene.validation.registered_frames, 12);
    assert_eq!(scene.validation.status, ValidationStatus::Unchecked);
    assert_eq!(scene.validation.problems, ["images are pale"]);
    assert_eq!(
        scene.pose_source,
        PoseSource::Matrices {
            file: "all_poses.npy".to_owned(),
            convention: PoseConvention::CameraToWorld,
        }
    );
    refused(&to_world, "has poses of 12 of 12 frames");

    // A poses.json is matched by time.
    take_poses(&scenes);
    let PoseRequest::Given(poses) = &scenes.request else {
        panic!("{:?}", scenes.request);
    };
    let scene = attach(&scenes.imported, Some(poses), &given(None), &Silent).unwrap();
    assert_eq!(scene.scale, Scale::Metres);
    for (number, frame) in scene.frames.iter().enumerate() {
        assert_eq!(frame.pose.unwrap().centre, [number as f64, 0.0, 0.0]);
    }
}
