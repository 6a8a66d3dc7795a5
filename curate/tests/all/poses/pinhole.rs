//! Perspective frames: their lens, the ground in their view, and the scale that follows.

use omnilife_curate::{GroundScale, poses::level::Levelling};
use omnilife_schemas::RgbImage;

use super::*;

/// A sequence of 20 perspective frames of 256x128 beneath `folder`.
fn flight(folder: &Path) -> std::path::PathBuf {
    let video = erp_clip(folder, "fly.mp4", &[1], 20, 10);
    let settings = CurateSettings {
        enforce: false,
        accept: Some(VideoProjection::Rectilinear),
        ..CurateSettings::default()
    };
    curate_video(&video, &folder.join("fly"), &settings, &Silent).unwrap();
    folder.join("fly/seq-000")
}

/// A model of a flight along x at height 5 above the ground y = 2, looking down.
fn write_flight(folder: &Path, camera: &str) {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("cameras.txt"), camera).unwrap();
    let images: String = (0..20)
        .map(|number| {
            // World to camera: z of the camera is y of the world.
            let rotation = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
            let centre = DVec3::new(0.3 * f64::from(number), -3.0, 1.0);
            let shift = -(rotation * centre);
            let [x, y, z, w] = rotation.to_array();
            format!(
                "{} {w} {x} {y} {z} {} {} {} 1 {number:06}.png\n\n",
                number + 1,
                shift.x,
                shift.y,
                shift.z
            )
        })
        .collect();
    fs::write(folder.join("images.txt"), images).unwrap();
    let points: String = (0..200)
        .map(|n| {
            let height = if n % 4 == 0 {
                0.1 * f64::from(n % 12)
            } else {
                0.0
            };
            let (x, z) = (0.5 * f64::from(n % 20) - 2.0, 0.4 * f64::from(n / 20) - 1.0);
            format!("{n} {x} {} {z} 90 90 90 0.1\n", 2.0 - height)
        })
        .collect();
    fs::write(folder.join("points3D.txt"), points).unwrap();
}

#[test]
fn a_lens_is_taken_out_of_frames_and_masks() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = flight(temp.path());
    let model = temp.path().join("model");
    // Of twice the size.
    write_flight(&model, "1 RADIAL 512 256 400 256 128 -0.2 0.02\n");
    let masks = temp.path().join("masks");
    fs::create_dir(&masks).unwrap();
    for number in 0..20 {
        Mask {
            width: 256,
            height: 128,
            data: (0..256 * 128)
                .map(|at| u8::from(at % 256 < 128) * 255)
                .collect(),
        }
        .write_png(&masks.join(format!("{number:06}.png")))
        .unwrap();
    }
    let truth = GivenTruth {
        masks: Some(masks),
        ..GivenTruth::default()
    };
    let request = PoseRequest::Given(model.clone());
    let scene = pose_sequence_with(&sequence, &request, &truth, &Silent).unwrap();
    let Camera::Pinhole(camera) = scene.camera else {
        panic!("{:?}", scene.camera);
    };
    // A barrel shows more: the straight camera has a shorter focal length.
    assert_eq!((camera.width, camera.height), (256, 128));
    assert!(camera.fx < 199.0 && camera.fx > 150.0, "{camera:?}");
    let before = RgbImage::read(&sequence.join("frames/000004.png")).unwrap();
    let frame = &scene.frames[4];
    assert_eq!(frame.image, "frames-straight/000004.png");
    let after = RgbImage::read(&sequence.join(&frame.image)).unwrap();
    assert_eq!((after.width, after.height), (256, 128));
    // At the principal point nothing moves.
    let middle = 3 * (64 * 256 + 128);
    for channel in 0..3 {
        assert!((before.data[middle + channel] - after.data[middle + channel]).abs() < 0.05);
    }
    assert_ne!(before, after);
    let mask = Mask::read(&sequence.join(frame.mask.as_ref().unwrap())).unwrap();
    let marked = mask.data.iter().filter(|&&value| value > 0).count();
    assert!(
        (marked as f64 / (256.0 * 128.0) - 0.5).abs() < 0.01,
        "{marked}"
    );

    // Without the lens they go again; what is not a file of ours stays.
    fs::write(sequence.join("frames-straight/mine.txt"), "mine").unwrap();
    write_flight(&model, "1 SIMPLE_PINHOLE 512 256 400 256 128\n");
    let scene = pose_sequence(&sequence, &request, &Silent).unwrap();
    assert_eq!(scene.frames[4].image, "frames/000004.png");
    assert!(sequence.join("frames/000004.png").is_file());
    let left = store::names_in(&sequence.join("frames-straight")).unwrap();
    assert_eq!(left, ["mine.txt"]);

    // Distances would not fit frames that are changed.
    write_flight(&model, "1 SIMPLE_RADIAL 512 256 400 256 128 -0.2\n");
    let classes = GivenTruth {
        classes: [("human".to_owned(), temp.path().join("masks"))].into(),
        ..GivenTruth::default()
    };
    let error = pose_sequence_with(&sequence, &request, &classes, &Silent).unwrap_err();
    assert!(
        error.to_string().contains("the lens is taken out"),
        "{error}"
    );
}

/// A lens that moves no pixel by a quarter of one is ignored.
#[test]
fn a_lens_that_does_nothing_changes_nothing() {
    let temp = tempfile::tempdir().unwrap();
    let model = temp.path().join("model");
    write_flight(&model, "1 SIMPLE_RADIAL 512 256 400 256 128 0.0005\n");
    let read = ColmapModel::read(&model).unwrap();
    assert_eq!(read.camera.lens(), None);
    let straight = PinholeCamera::new([512, 256], [400.0, 400.0], [256.0, 128.0]);
    assert_eq!(read.camera.camera(), straight.into());
    for camera in [
        "1 RADIAL 512 256 400 256 128 -300 0\n",
        "1 OPENCV 512 256 400 nan 256 128 0 0 0 0\n",
    ] {
        write_flight(&model, camera);
        let message = ColmapModel::read(&model).unwrap_err().to_string();
        assert!(
            message.contains("no straight image")
                || message.contains("no camera parameters")
                || message.contains("all finite"),
            "{message}"
        );
    }
}

#[test]
fn flights_are_levelled_by_the_ground() {
    let temp = tempfile::tempdir().unwrap();
    write_flight(temp.path(), "1 PINHOLE 256 128 200 200 128 64\n");
    let mut model = ColmapModel::read(temp.path()).unwrap();
    model.rotate_world(DQuat::from_rotation_z(0.7) * DQuat::from_rotation_x(0.4));
    let Levelling::ByGround { share } = level(&mut model) else {
        panic!("no ground");
    };
    assert!((0.7..=1.0).contains(&share), "{share}");
    for image in model.images.values() {
        assert!((image.rotation * DVec3::Z).dot(UP) < -0.999);
    }
}

#[test]
fn what_is_known_of_a_flight_brings_it_to_metres() {
    let temp = tempfile::tempdir().unwrap();
    let sequence = flight(temp.path());
    let model = temp.path().join("model");
    write_flight(&model, "1 PINHOLE 256 128 200 200 128 64\n");
    let request = PoseRequest::Given(model);
    let of = |scale: Option<GroundScale>| {
        let truth = GivenTruth {
            scale,
            ..GivenTruth::default()
        };
        pose_sequence_with(&sequence, &request, &truth, &Silent)
    };
    let arbitrary = of(None).unwrap();
    assert_eq!(arbitrary.scale, Scale::Arbitrary);
    // 5 units above the ground: 40 m are 8 times as much; so are 0.2 m a pixel at a focal length of 200.
    for scale in [GroundScale::Altitude(40.0), GroundScale::PixelOnGround(0.2)] {
        let scene = of(Some(scale)).unwrap();
        assert_eq!(scene.scale, Scale::Metres);
        let steps: Vec<f64> = scene
            .frames
            .array_windows()
            .map(|[a, b]| a.pose.unwrap().centre().distance(b.pose.unwrap().centre()))
            .collect();
        assert!(
            steps.iter().all(|step| (step - 2.4).abs() < 0.01),
            "{steps:?}"
        );
        let points = PointCloud::read_ply(&sequence.join("points.ply")).unwrap();
        let lowest = points
            .positions
            .iter()
            .map(|point| point[1])
            .fold(f64::MIN, f64::max);
        assert!((lowest - 16.0).abs() < 0.05, "{lowest}");
    }
    for (scale, reason) in [
        (GroundScale::Altitude(0.0), "say nothing of its scale"),
        (
            GroundScale::PixelOnGround(f64::NAN),
            "say nothing of its scale",
        ),
    ] {
        let error = of(Some(scale)).unwrap_err();
        assert!(error.to_string().contains(reason), "{error}");
    }
}

#[test]
fn a_pitch_is_an_angle_below_the_horizon() {
    let check = |pitch: f64| {
        let truth = GivenTruth {
            camera_pitch: Some(pitch),
            ..GivenTruth::default()
        };
        truth.check().map_err(|error| error.to_string())
    };
    assert!(check(20.0).is_ok() && check(90.0).is_ok());
    for pitch in [-30.0, 0.0, 91.0, f64::NAN] {
        let message = check(pitch).unwrap_err();
        assert!(
            message.contains("--camera-pitch") && message.contains("20 to 90"),
            "{message}"
        );
    }
}
