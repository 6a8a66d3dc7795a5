//! Given poses: matching by time, COLMAP models, masks, points, validation.

mod colmap_models;
mod matrices;
mod pinhole;
mod times;
mod validation;

use std::{fs, path::Path};

use glam::{DMat3, DQuat, DVec3};
use omnilife_curate::{
    CurateSettings, GivenTruth, IgnoredRegion, PoseRequest, curate_video, pose_sequence,
    pose_sequence_with,
    poses::{
        ValidationLimits,
        colmap::{ColmapImage, ColmapModel, ColmapPoint},
        level::{Levelling, UP, level},
        validate::validate,
    },
};
use omnilife_schemas::{
    Classified, ErrorKind, Pose,
    camera::{Camera, CameraModel, ErpCamera, PinholeCamera},
    points::PointCloud,
    progress::Silent,
    records::{PosedFrame, Poses, Scale, Scene, SceneFrame, ValidationStatus, VideoProjection},
    rgb::Mask,
    store,
    testing::Notes,
};
use support::{Clip, erp_clip, erp_direction, world_colour};

use crate::support;

/// A curated sequence of 20 frames at 10 fps beneath `folder`.
fn sequence_of_twenty(folder: &Path) -> std::path::PathBuf {
    let video = erp_clip(folder, "walk.mp4", &[1], 20, 10);
    let settings = CurateSettings {
        enforce: false,
        ..CurateSettings::default()
    };
    curate_video(&video, &folder.join("walk"), &settings, &Silent).unwrap();
    folder.join("walk/seq-000")
}

fn pose_at(step: f64) -> Pose {
    Pose::from_matrix(
        DMat3::from_rotation_y(0.1 * step),
        DVec3::new(step, 0.0, 1.0),
    )
    .unwrap()
}

#[test]
fn given_poses_are_matched_by_time_and_bring_points_and_masks() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let given = temp.path().join("given");
    fs::create_dir(&given).unwrap();
    let cloud = PointCloud::of_colour(vec![[1.0, 2.0, 3.0]], [9, 8, 7]);
    cloud.write_ply(&given.join("cloud.ply")).unwrap();
    // A mask of half the size: its left half is white.
    let half: Vec<u8> = (0..128 * 64)
        .map(|i| if i % 128 < 64 { 255 } else { 0 })
        .collect();
    image::save_buffer(given.join("m.png"), &half, 128, 64, image::ColorType::L8).unwrap();
    // Every second frame, 40 ms late: within half of the 100 ms between frames.
    let frames = (0..20)
        .step_by(2)
        .map(|index| PosedFrame {
            time_seconds: f64::from(index) * 0.1 + 0.04,
            pose: pose_at(f64::from(index)),
            mask: (index == 4).then(|| "m.png".to_owned()),
        })
        .collect();
    let record = Poses {
        camera: None,
        scale: Scale::Metres,
        frames,
        points: Some("cloud.ply".to_owned()),
    };
    let file = given.join("poses.json");
    store::write_record(&file, &record).unwrap();

    let notes = Notes::default();
    let request = PoseRequest::Given(file.clone());
    let scene = pose_sequence(&sequence, &request, &notes).unwrap();
    let said = notes.take().join("|");
    assert!(said.contains("10 of 20 frames have no pose"), "{said}");
    assert_eq!(scene.frames.len(), 20);
    assert_eq!(scene.scale, Scale::Metres);
    assert_eq!(scene.validation.status, ValidationStatus::Unchecked);
    assert_eq!(scene.validation.registered_frames, 10);
    for (index, frame) in scene.frames.iter().enumerate() {
        let expected = (index % 2 == 0).then(|| pose_at(index as f64));
        assert_eq!(frame.pose, expected, "frame {index}");
        assert_eq!(frame.mask.is_some(), index == 4);
    }
    let mask = Mask::read(&sequence.join(scene.frames[4].mask.as_ref().unwrap())).unwrap();
    assert_eq!((mask.width, mask.height), (256, 128));
    assert!(
        mask.data
            .chunks(256)
            .all(|row| row[..128].iter().all(|&v| v == 255) && row[128..].iter().all(|&v| v == 0))
    );
    assert_eq!(
        PointCloud::read_ply(&sequence.join("points.ply")).unwrap(),
        cloud
    );

    assert_eq!(pose_sequence(&sequence, &request, &notes).unwrap(), scene);
    assert!(notes.take().join("|").contains("unchanged, skipped"));
    // Another mask is another input.
    let white = vec![255; 128 * 64];
    image::save_buffer(given.join("m.png"), &white, 128, 64, image::ColorType::L8).unwrap();
    pose_sequence(&sequence, &request, &notes).unwrap();
    assert!(!notes.take().join("|").contains("unchanged"));
}

/// Masks of `curate masks` are entered into a scene with given poses, too.
#[test]
fn given_poses_take_a_folder_of_masks() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let masks = temp.path().join("masks");
    fs::create_dir(&masks).unwrap();
    let save = |file: &Path, value: u8| {
        let data = vec![value; 256 * 128];
        image::save_buffer(file, &data, 256, 128, image::ColorType::L8).unwrap();
    };
    for index in 0..20 {
        save(&masks.join(format!("{index:06}.png")), 255);
    }
    // Its own mask of the first frame goes before.
    save(&temp.path().join("own.png"), 0);
    let frames = (0..20).map(|index| PosedFrame {
        time_seconds: f64::from(index) * 0.1,
        pose: pose_at(f64::from(index)),
        mask: (index == 0).then(|| "own.png".to_owned()),
    });
    let record = Poses::new(Scale::Metres, None, frames.collect());
    let file = temp.path().join("poses.json");
    store::write_record(&file, &record).unwrap();
    let request = PoseRequest::Given(file);
    let truth = GivenTruth {
        masks: Some(masks.clone()),
        ..GivenTruth::default()
    };
    let notes = Notes::default();
    let scene = pose_sequence_with(&sequence, &request, &truth, &notes).unwrap();
    for (index, frame) in scene.frames.iter().enumerate() {
        let mask = Mask::read(&sequence.join(frame.mask.as_ref().unwrap())).unwrap();
        let expected = if index == 0 { 0 } else { 255 };
        assert!(mask.data.iter().all(|&value| value == expected), "{index}");
    }
    // Another mask is another input, and a frame without one is an error.
    save(&masks.join("000007.png"), 0);
    pose_sequence_with(&sequence, &request, &truth, &notes).unwrap();
    assert!(!notes.take().join("|").contains("unchanged"));
    fs::remove_file(masks.join("000007.png")).unwrap();
    let error = pose_sequence_with(&sequence, &request, &truth, &notes).unwrap_err();
    assert!(error.to_string().contains("19 of 20 frames"), "{error}");
}

/// One image for what is fixed to the camera, or one per frame.
#[test]
fn what_is_no_part_of_the_scene_is_kept_for_every_frame() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let folder = temp.path().join("holder");
    fs::create_dir(&folder).unwrap();
    let save = |path: &Path, first_row: usize| {
        let levels = (0..64 * 32).map(|at| 255 * u8::from(at / 64 >= first_row));
        let levels: Vec<u8> = levels.collect();
        image::save_buffer(path, &levels, 64, 32, image::ColorType::L8).unwrap();
    };
    for frame in 0..20 {
        save(&folder.join(format!("{frame:06}.png")), 31 - frame);
    }
    let tripod = temp.path().join("tripod.png");
    save(&tripod, 28);
    let frames =
        (0..20).map(|index| PosedFrame::new(f64::from(index) * 0.1, pose_at(f64::from(index))));
    let record = Poses::new(Scale::Metres, None, frames.collect());
    let file = temp.path().join("poses.json");
    store::write_record(&file, &record).unwrap();
    let request = PoseRequest::Given(file);
    let pose = |ignored: &str| {
        let truth = GivenTruth {
            ignored: Some(ignored.parse().unwrap()),
            ..GivenTruth::default()
        };
        pose_sequence_with(&sequence, &request, &truth, &Silent)
    };
    let first_row = |frame: &SceneFrame| {
        let mask = Mask::read(&sequence.join(frame.ignore_mask.as_ref().unwrap())).unwrap();
        let first = mask.data.iter().position(|&value| value != 0).unwrap();
        (first / mask.width) * 32 / mask.height
    };
    let [tripod_text, folder_text] = [&tripod, &folder].map(|path| path.to_str().unwrap());
    let of_all = pose(tripod_text).unwrap();
    assert!(of_all.frames.iter().all(|frame| first_row(frame) == 28));
    let of_each = pose(folder_text).unwrap();
    for (number, frame) in of_each.frames.iter().enumerate() {
        assert_eq!(first_row(frame), 31 - number);
    }
    // Files of an earlier request are gone.
    assert!(!sequence.join("ignore/all.png").exists());
    let scene = store::read_record::<Scene>(&sequence.join("scene.json")).unwrap();
    assert_eq!(scene, of_each);

    // Rows of 32 that begin at 180 - 45 degrees or reach over it.
    let below = pose("nadir:45").unwrap();
    assert!(below.frames.iter().all(|frame| first_row(frame) == 24));
    let below = pose("nadir:45.1").unwrap();
    assert!(below.frames.iter().all(|frame| first_row(frame) == 23));
    for wrong in ["nadir:0", "nadir:180", "nadir:NaN", "nadir:wide"] {
        assert!(wrong.parse::<IgnoredRegion>().is_err(), "{wrong}");
    }

    // Labels mark as white does, and a mask of all but the tripod looks inverted: both are told.
    let told = |rows: std::ops::Range<usize>, value: u8| {
        let levels = (0..64 * 32).map(|at| value * u8::from(rows.contains(&(at / 64))));
        let levels: Vec<u8> = levels.collect();
        image::save_buffer(&tripod, &levels, 64, 32, image::ColorType::L8).unwrap();
        let scene = pose(tripod_text).unwrap();
        let first = first_row(&scene.frames[0]);
        let problems = scene.validation.problems.iter();
        let told = problems.filter(|line| line.contains("tripod.png") || line.contains("inverted"));
        (first, told.count())
    };
    assert_eq!(told(28..32, 255), (28, 0));
    assert_eq!(told(27..32, 7), (27, 1));
    assert_eq!(told(4..28, 255), (4, 1));

    // A mask that marks nothing is not used.
    save(&tripod, 32);
    assert!(
        pose(tripod_text)
            .unwrap()
            .frames
            .iter()
            .all(|frame| frame.ignore_mask.is_none())
    );
    let square = temp.path().join("square.png");
    image::save_buffer(&square, &[255; 32 * 32], 32, 32, image::ColorType::L8).unwrap();
    let error = pose(square.to_str().unwrap()).unwrap_err().to_string();
    assert!(
        error.contains("square.png: is 32x32 pixels, which is not the shape"),
        "{error}"
    );
    let error = pose("nadir:179.9").unwrap_err().to_string();
    assert!(error.contains("nadir:179.9 leaves nothing"), "{error}");

    save(&tripod, 0);
    let error = pose(tripod_text).unwrap_err().to_string();
    assert!(
        error.contains("tripod.png: leaves nothing of its frame"),
        "{error}"
    );
    pose(folder_text).unwrap();
    let own = sequence.join("ignore");
    let error = pose(own.to_str().unwrap()).unwrap_err().to_string();
    assert!(error.contains("keep it elsewhere"), "{error}");
}

#[test]
fn poses_that_fit_nothing_or_are_broken_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let file = temp.path().join("poses.json");
    let write = |frames: Vec<PosedFrame>, points: Option<&str>| {
        let record = Poses {
            camera: None,
            scale: Scale::Arbitrary,
            frames,
            points: points.map(str::to_owned),
        };
        store::write_record(&file, &record).unwrap();
    };
    let frame = PosedFrame::new;
    let refused = |reason: &str| {
        let request = PoseRequest::Given(file.clone());
        let error = pose_sequence(&sequence, &request, &Silent).unwrap_err();
        let message = error.to_string();
        assert_eq!(error.error_kind(), ErrorKind::User, "{message}");
        assert!(
            message.contains(reason) && !message.contains('\n'),
            "{message}"
        );
        assert!(!sequence.join("scene.json").exists());
    };
    refused("poses.json: cannot be read");
    write(vec![frame(77.0, pose_at(0.0))], None);
    refused("fits no frame of walk/seq-000");
    let mut broken = pose_at(0.0);
    broken.rotation_wxyz = [0.0; 4];
    write(vec![frame(0.0, broken)], None);
    refused("has no rotation");
    // Degrees, or a quaternion in another place of the row.
    broken.rotation_wxyz = [0.0, 90.0, 0.0, 0.0];
    write(vec![frame(0.0, broken)], None);
    refused("must be a unit quaternion");
    write(vec![frame(0.0, pose_at(0.0))], Some("nowhere.ply"));
    refused("nowhere.ply");
    fs::write(&file, "{}").unwrap();
    refused("schema");
}

/// The user's own masks may lie where the sequence's masks go; a mask that would come out changed
/// is refused before anything is touched, and a failed attempt leaves no scene of earlier poses.
#[test]
fn masks_of_the_user_survive_and_failed_poses_leave_no_scene() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let masks = sequence.join("masks");
    fs::create_dir(&masks).unwrap();
    let write_mask = |name: &str, width: u32| {
        let levels = vec![255; (width * width / 2) as usize];
        image::save_buffer(
            masks.join(name),
            &levels,
            width,
            width / 2,
            image::ColorType::L8,
        )
        .unwrap();
    };
    let file = sequence.join("poses.json");
    let write_poses = |mask: &str, centre: f64| {
        let frames = (0..20)
            .map(|index| PosedFrame {
                time_seconds: f64::from(index) * 0.1,
                pose: pose_at(centre),
                mask: (index == 0).then(|| format!("masks/{mask}")),
            })
            .collect();
        let record = Poses::new(Scale::Metres, None, frames);
        store::write_record(&file, &record).unwrap();
    };
    write_mask("000000.png", 256);
    let before = Mask::read(&masks.join("000000.png")).unwrap();
    write_poses("000000.png", 1.0);
    let request = PoseRequest::Given(file.clone());
    let notes = Notes::default();
    let scene = pose_sequence(&sequence, &request, &notes).unwrap();
    assert!(
        notes
            .take()
            .join("|")
            .contains("19 of 20 frames have no mask")
    );
    assert_eq!(scene.frames[0].mask.as_deref(), Some("masks/000000.png"));
    assert_eq!(Mask::read(&masks.join("000000.png")).unwrap(), before);
    assert!(sequence.join("scene.json").exists());

    write_mask("hand.png", 64);
    write_poses("hand.png", 2.0);
    let error = pose_sequence(&sequence, &request, &Silent).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    assert!(error.to_string().contains("keep it elsewhere"), "{error}");
    assert!(masks.join("hand.png").exists() && masks.join("000000.png").exists());
    assert!(!sequence.join("scene.json").exists());
}

/// A dataset that is moved with its poses stays done.
#[test]
fn moved_poses_are_not_made_again() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = sequence_of_twenty(temp.path());
    let given = temp.path().join("given.json");
    let record = Poses::new(
        Scale::Metres,
        None,
        vec![PosedFrame::new(0.0, pose_at(0.0))],
    );
    store::write_record(&given, &record).unwrap();
    let scene = pose_sequence(&sequence, &PoseRequest::Given(given.clone()), &Silent).unwrap();
    let folder = temp.path().join("moved");
    fs::create_dir(&folder).unwrap();
    fs::rename(temp.path().join("walk"), folder.join("walk")).unwrap();
    fs::rename(&given, folder.join("given.json")).unwrap();
    let notes = Notes::default();
    let request = PoseRequest::Given(folder.join("given.json"));
    let again = pose_sequence(&folder.join("walk/seq-000"), &request, &notes).unwrap();
    assert_eq!(again, scene);
    assert!(notes.take().join("|").contains("unchanged, skipped"));
}

/// The given camera must fit the frames; none is guessed.
#[test]
fn frames_of_a_pinhole_need_its_camera() {
    let temp = tempfile::tempdir().unwrap();
    let video = erp_clip(temp.path(), "fly.mp4", &[1], 20, 10);
    let settings = CurateSettings {
        enforce: false,
        accept: Some(VideoProjection::Rectilinear),
        ..CurateSettings::default()
    };
    curate_video(&video, &temp.path().join("fly"), &settings, &Silent).unwrap();
    let sequence = temp.path().join("fly/seq-000");
    let pinhole = PinholeCamera::with_horizontal_field_of_view(512, 256, 1.1);
    let file = temp.path().join("poses.json");
    let pose = |camera: Option<Camera>| {
        let frames =
            (0..20).map(|index| PosedFrame::new(f64::from(index) * 0.1, pose_at(f64::from(index))));
        let record = Poses::new(Scale::Metres, camera, frames.collect());
        store::write_record(&file, &record).unwrap();
        pose_sequence(&sequence, &PoseRequest::Given(file.clone()), &Silent)
    };
    // Of half the size: its lengths are halved.
    let scene = pose(Some(pinhole.into())).unwrap();
    assert_eq!(scene.camera, Camera::from(pinhole).resized(256, 128));
    let erp = ErpCamera::new(256, 128);
    for (camera, reason) in [
        (None, "has no pinhole camera"),
        (Some(erp.into()), "has no pinhole camera"),
        (
            Some(Camera::from(pinhole).resized(512, 300)),
            "another shape",
        ),
    ] {
        let error = pose(camera).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        assert!(error.to_string().contains(reason), "{error}");
    }
    let walk = sequence_of_twenty(temp.path());
    pose(Some(pinhole.into())).unwrap();
    let error = pose_sequence(&walk, &PoseRequest::Given(file), &Silent).unwrap_err();
    assert!(
        error.to_string().contains("--projection pinhole"),
        "{error}"
    );
}
