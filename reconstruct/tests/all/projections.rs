//! Gaussians of other programs in every projection: faces of cubes are what pinhole cameras see, and axes of files turn
//! the scene.

use std::{
    fs,
    path::{Path, PathBuf},
};

use glam::{DQuat, DVec3, Vec3};
use omnilife_engine::gaussians::ActivatedGaussians;
use omnilife_reconstruct::{
    formats::{
        axes::FileAxes,
        exchange::{SPLAT_FORMATS, by_name},
    },
    jobs::{
        camera_words::{CameraPlaces, CameraWords, LookAt},
        render::{RenderCamera, RenderRequest, RenderedViews, render_poses},
    },
};
use omnilife_schemas::{
    Pose, RgbImage,
    camera::cube::CUBE_FACES,
    progress::Silent,
    records::{PosedFrame, Poses, Scale, WordedViews},
    store,
};

/// Returns round Gaussians around the origin, of a size and colour each.
fn balls() -> ActivatedGaussians {
    let mut gaussians = ActivatedGaussians::default();
    gaussians.reshape(60, 0, 0);
    for number in 0..60 {
        let wave = |pace: f32| (pace * number as f32 + 0.3).sin();
        let direction = Vec3::new(wave(0.7), wave(1.3), wave(2.1)).normalize();
        gaussians.positions[number] = (3.0 * direction).to_array();
        gaussians.scales[number] = [0.3 + 0.1 * wave(0.9); 3];
        gaussians.rotations[number] = [1.0, 0.0, 0.0, 0.0];
        gaussians.opacities[number] = 0.8;
        gaussians.sh_constant[number] = [wave(0.11), wave(0.23), wave(0.37)];
    }
    gaussians
}

/// Writes a file of a format.
fn written(folder: &Path, name: &str, format: &str, gaussians: &ActivatedGaussians) -> PathBuf {
    let format = by_name(format).unwrap();
    let path = folder.join(format!("{name}{}", format.ending));
    fs::write(&path, (format.write)(gaussians).unwrap()).unwrap();
    path
}

/// Writes a pose for each rotation, at the origin.
fn poses(folder: &Path, rotations: &[DQuat]) -> PathBuf {
    let frame = |(number, rotation): (usize, &DQuat)| {
        PosedFrame::new(number as f64, Pose::new(*rotation, DVec3::ZERO))
    };
    let record = Poses::new(
        Scale::Arbitrary,
        None,
        rotations.iter().enumerate().map(frame).collect(),
    );
    let path = folder.join("poses.json");
    store::write_record(&path, &record).unwrap();
    path
}

fn request(model: &Path, poses: &Path, camera: RenderCamera, out: PathBuf) -> RenderRequest {
    RenderRequest {
        model: model.to_owned(),
        axes: None,
        poses: poses.to_owned(),
        cameras: CameraWords::default(),
        size: Some(match camera {
            RenderCamera::Erp => [64, 32],
            _ => [32, 32],
        }),
        camera,
        layer: "all".to_owned(),
        cube_faces: None,
        out,
    }
}

fn rendered(request: &RenderRequest) -> RenderedViews {
    render_poses(request, &Silent).unwrap()
}

/// Largest mean difference of images, of 255.
fn difference(a: &[PathBuf], b: &[PathBuf]) -> f32 {
    assert_eq!(a.len(), b.len());
    let differences = a.iter().zip(b).map(|files| {
        let [a, b] = [files.0, files.1].map(|file| RgbImage::read(file).unwrap().data);
        let sum: f32 = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum();
        255.0 * sum / a.len() as f32
    });
    differences.fold(0.0, f32::max)
}

#[test]
fn faces_of_a_cube_are_what_turned_pinhole_cameras_see() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let model = written(root, "balls", "sog", &balls());
    let turn = DQuat::from_rotation_y(0.4) * DQuat::from_rotation_x(0.2);
    let path = poses(root, &[turn]);
    let cube = rendered(&request(
        &model,
        &path,
        RenderCamera::Cube,
        root.join("cube"),
    ));
    assert_eq!((cube.views, cube.files.len()), (1, 6));
    let names: Vec<_> = cube
        .files
        .iter()
        .map(|file| file.file_name().unwrap())
        .collect();
    let expected = CUBE_FACES.map(|face| format!("000000-{}.png", face.name));
    assert_eq!(names, expected.each_ref().map(String::as_str));
    let turns = CUBE_FACES.map(|face| turn * DQuat::from_mat3(&face.to_camera));
    let path = poses(root, &turns);
    let pinhole = request(
        &model,
        &path,
        RenderCamera::Pinhole(90.0),
        root.join("pinhole"),
    );
    let pinhole = rendered(&pinhole);
    assert_eq!((pinhole.views, pinhole.files.len()), (6, 6));
    let apart = difference(&cube.files, &pinhole.files);
    assert!(apart < 0.01, "{apart}");
    // Something is seen.
    assert!(difference(&cube.files[..1], &cube.files[2..3]) > 2.0);
}

#[test]
fn axes_of_a_file_turn_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let path = poses(root, &[DQuat::from_rotation_x(0.3)]);
    let axes = FileAxes::parse("x,-z,y").unwrap();
    let mut turned = balls();
    for place in &mut turned.positions {
        let [x, y, z] = *place;
        *place = [x, z, -y];
    }
    let [file, expected] = [("file", &balls()), ("turned", &turned)]
        .map(|(name, gaussians)| written(root, name, "ply", gaussians));
    let out = |name: &str| root.join(format!("views-{name}"));
    let render = |model: &Path, axes: Option<FileAxes>, name: &str| {
        let request = RenderRequest {
            axes,
            ..request(model, &path, RenderCamera::Erp, out(name))
        };
        rendered(&request).files
    };
    let expected = render(&expected, None, "expected");
    let apart = difference(&render(&file, Some(axes), "axes"), &expected);
    assert!(apart < 0.5, "{apart}");
    assert!(difference(&render(&file, None, "as-it-stands"), &expected) > 2.0);
}

#[test]
fn every_format_is_drawn_as_its_source() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let path = poses(root, &[DQuat::IDENTITY]);
    let views = |format: &str| {
        let model = written(root, "a", format, &balls());
        let out = root.join(format!("views-{format}"));
        rendered(&request(&model, &path, RenderCamera::Erp, out)).files
    };
    let source = views("ply");
    for format in SPLAT_FORMATS {
        let apart = difference(&source, &views(format.name));
        assert!(apart < 2.0, "{}: {apart}", format.name);
    }
}

#[test]
fn what_cannot_be_drawn_is_refused_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let path = poses(root, &[DQuat::IDENTITY]);
    let model = written(root, "balls", "sog", &balls());
    let out = root.join("views");
    let cut = root.join("cut.sog");
    fs::write(&cut, &fs::read(&model).unwrap()[..500]).unwrap();
    let cube = |model: &Path, size: [u32; 2]| RenderRequest {
        size: Some(size),
        ..request(model, &path, RenderCamera::Cube, out.clone())
    };
    let of_a_run = RenderRequest {
        axes: FileAxes::parse("x,y,z").ok(),
        ..cube(root, [8, 8])
    };
    for (request, reason) in [
        (
            cube(&model, [32, 16]),
            "faces of a cube must be squares, got 32x16",
        ),
        (cube(&cut, [8, 8]), "is not a ZIP archive, or is cut off"),
        (of_a_run, "axes are those of a file"),
    ] {
        let message = render_poses(&request, &Silent).unwrap_err().to_string();
        assert!(message.contains(reason), "{message}");
        assert!(!message.contains('\n') && !out.exists(), "{message}");
    }
}

/// Views by words of a file of Gaussians: the object in the middle stays there, and the record says what was unseen.
#[test]
fn cameras_by_words_show_their_target_and_leave_a_record() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let mut ball = ActivatedGaussians::default();
    ball.reshape(1, 0, 0);
    ball.positions[0] = [0.0, 0.0, 4.0];
    ball.scales[0] = [0.3; 3];
    ball.rotations[0] = [1.0, 0.0, 0.0, 0.0];
    ball.opacities[0] = 0.99;
    ball.sh_constant[0] = [1.5; 3];
    let model = written(root, "ball", "ply", &ball);
    let path = poses(root, &[DQuat::IDENTITY; 5]);
    let out = root.join("words");
    let words = |places: CameraPlaces| RenderRequest {
        cameras: CameraWords {
            places,
            target: Some(LookAt::Point([0.0, 0.0, 4.0])),
            ..CameraWords::default()
        },
        ..request(&model, &path, RenderCamera::Pinhole(60.0), out.clone())
    };
    for places in [CameraPlaces::Orbit(360.0), CameraPlaces::FromAbove] {
        let views = rendered(&words(places.clone()));
        assert_eq!((views.views, views.files.len()), (5, 5));
        for file in &views.files {
            let image = RgbImage::read(file).unwrap();
            let value = |x: usize, y: usize| image.data[3 * (y * 32 + x)];
            assert!(value(16, 16) > 0.5 && value(2, 2) < 0.1, "{places:?}");
        }
        let record: WordedViews = store::read_record(&out.join("cameras.json")).unwrap();
        assert_eq!(views.cameras.as_ref(), Some(&record));
        assert_eq!((record.input_views, record.views.len()), (5, 5));
        // There are no points to measure by.
        assert!(record.unmeasured.is_some() && record.mean_unseen_share().is_none());
    }
    // Views of the poses replace the images, and the record of other cameras goes.
    let plain = request(&model, &path, RenderCamera::Pinhole(60.0), out.clone());
    assert_eq!(rendered(&plain).cameras, None);
    assert!(!out.join("cameras.json").exists());
}
