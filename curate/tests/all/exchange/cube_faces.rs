//! Panoramas exported as cube faces: every pixel still shows what lies in its direction.

use glam::{DMat3, dvec2};
use omnilife_curate::exchange::CubeFaces;
use omnilife_schemas::{RgbImage, camera::Camera};

use super::*;

const SIDE: u32 = 24;
const SKY_POINTS: usize = 50;

/// A colour for every direction of the world.
fn colour(direction: DVec3) -> DVec3 {
    0.5 * (direction + 1.0)
}

/// The scene with panoramas in which every direction of the world has its colour, and its masks white to
/// the east of it.
fn coloured_scene() -> (TempDir, Scene) {
    let (folder, mut scene) = scene();
    let camera = ErpCamera::new(128, 64);
    for frame in &mut scene.frames {
        let rotation = DMat3::from_quat(frame.pose.and_then(|p| p.rotation()).unwrap_or_default());
        let directions = (0..128 * 64_u32).map(|pixel| {
            let centre = dvec2(f64::from(pixel % 128), f64::from(pixel / 128)) + 0.5;
            rotation * camera.unproject(centre)
        });
        let (pixels, mask): (Vec<[u8; 3]>, Vec<u8>) = directions
            .map(|direction| {
                let bytes = colour(direction)
                    .to_array()
                    .map(|v| (v * 255.0).round() as u8);
                (bytes, if direction.x > 0.0 { 255 } else { 0 })
            })
            .unzip();
        rgb::write_rgb8_png(
            &folder.path().join(&frame.image),
            128,
            64,
            pixels.as_flattened(),
        )
        .unwrap();
        if let Some(file) = &frame.mask {
            let mask = Mask::new(128, 64, mask);
            mask.write_png(&folder.path().join(file)).unwrap();
        }
    }
    scene.camera = camera.into();
    store::write_record(&folder.path().join("scene.json"), &scene).unwrap();
    (folder, scene)
}

fn export_faces(scene_folder: &Path, format: &str, out: &Path) -> Result<ExportScene, CurateError> {
    let request = ExportRequest {
        cube_faces: Some(CubeFaces {
            side: SIDE,
            sky_points: SKY_POINTS,
        }),
        ..ExportRequest::new(scene_folder, format, out)
    };
    export(&request, &Silent)
}

/// Every pixel of every face has the colour of its direction in the world, and the mask of it.
fn assert_pixels_show_their_directions(scene: &Scene, folder: &Path) {
    let Camera::Pinhole(camera) = scene.camera else {
        panic!("{:?}", scene.camera);
    };
    for frame in &scene.frames {
        let rotation = frame.pose.and_then(|pose| pose.rotation()).unwrap();
        let image = RgbImage::read(&folder.join(&frame.image)).unwrap();
        let mask = frame
            .mask
            .as_ref()
            .map(|mask| Mask::read(&folder.join(mask)).unwrap());
        for (pixel, found) in image.data.as_chunks::<3>().0.iter().enumerate() {
            let pixel_u32 = pixel as u32;
            let centre = dvec2(f64::from(pixel_u32 % SIDE), f64::from(pixel_u32 / SIDE)) + 0.5;
            let direction = rotation * camera.unproject(centre);
            let error = DVec3::from_array(found.map(f64::from)).distance(colour(direction));
            assert!(error < 0.03, "{} {pixel}: {error}", frame.image);
            if let Some(mask) = &mask
                && direction.x.abs() > 0.06
            {
                assert_eq!(
                    mask.data[pixel] > 127,
                    direction.x > 0.0,
                    "{} {pixel}",
                    frame.image
                );
            }
        }
    }
}

#[test]
fn faces_come_back_as_a_perspective_scene() {
    let (folder, original) = coloured_scene();
    for format in ["colmap", "colmap-binary", "nerfstudio"] {
        let out = tempfile::tempdir().unwrap();
        let exported = out.path().join("scene");
        export_faces(folder.path(), format, &exported).unwrap();
        assert!(
            !exported.join("faces").exists(),
            "{format} left its scratch folder"
        );
        let back = out.path().join("back");
        let scene = import(&ImportRequest::new(&exported, format, "faces", &back)).unwrap();
        assert_eq!(scene.frames.len(), 6 * 5, "{format}");
        assert_pixels_show_their_directions(&scene, &back);
        for frame in &scene.frames {
            let times = original.frames.iter().map(|frame| frame.time_seconds);
            assert!(times.into_iter().any(|time| time == frame.time_seconds));
        }
        let points = PointCloud::read_ply(&back.join("points.ply")).unwrap();
        assert_eq!(points.len(), 2 + SKY_POINTS, "{format}");
    }
}

#[test]
fn the_rig_is_that_of_the_poses() {
    let (folder, _) = coloured_scene();
    let out = tempfile::tempdir().unwrap();
    let exported = out.path().join("scene");
    let scene = export_faces(folder.path(), "colmap", &exported).unwrap();
    let rig = json(&exported.join("rig_config.json"));
    let cameras = rig[0]["cameras"].as_array().unwrap();
    assert_eq!(cameras.len(), 6);
    assert_eq!(cameras[0]["ref_sensor"], true);
    let reference = scene.frames[0].pose.rotation().unwrap();
    for (camera, frame) in cameras.iter().zip(&scene.frames) {
        assert!(
            frame
                .name
                .starts_with(camera["image_prefix"].as_str().unwrap())
        );
        let from_rig = match camera["cam_from_rig_rotation"].as_array() {
            Some(q) => {
                let q: Vec<f64> = q.iter().map(|v| v.as_f64().unwrap()).collect();
                DQuat::from_xyzw(q[1], q[2], q[3], q[0])
            }
            None => DQuat::IDENTITY,
        };
        let expected = reference * from_rig.inverse();
        assert!(frame.pose.rotation().unwrap().angle_between(expected) < 1e-9);
    }
}

#[test]
fn formats_without_rigs_and_odd_sizes_are_refused() {
    let (folder, _) = coloured_scene();
    let out = tempfile::tempdir().unwrap();
    let to = out.path().join("scene");
    let error = export_faces(folder.path(), "hm3d", &to).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("cube faces, which hm3d does not hold"),
        "{error}"
    );
    let request = ExportRequest {
        cube_faces: Some(CubeFaces {
            side: 0,
            sky_points: 0,
        }),
        ..ExportRequest::new(folder.path(), "colmap", &to)
    };
    let error = export(&request, &Silent).unwrap_err().to_string();
    assert!(error.contains("faces of 0 pixels"), "{error}");
    assert!(!to.exists());
}
