//! Exports for COLMAP open in COLMAP, whose cameras see the points at the same pixels as ours. Skipped, with the
//! reason, if structure from motion is not installed.

use std::process::Command;

use glam::DVec2;
use omnilife_curate::{exchange::CubeFaces, poses::sfm};

use super::*;

/// For every image of a model its name and where its camera sees every point; without a point where it
/// does not.
const SEEN: &str = "
import json, sys
import pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
seen = {}
for image in model.images.values():
    camera, pose = model.cameras[image.camera_id], image.cam_from_world
    pose = pose() if callable(pose) else pose
    points = sorted(model.points3D)
    pixels = [camera.img_from_cam(pose * model.points3D[point].xyz) for point in points]
    seen[image.name] = [None if pixel is None else list(pixel) for pixel in pixels]
print(json.dumps(seen))
";

/// The names and relative rotations of a rig.
const RIG: &str = "
import json, sys
import pycolmap
rigs = pycolmap.read_rig_config(sys.argv[1])
cameras = [camera for rig in rigs for camera in rig.cameras]
print(json.dumps([camera.image_prefix for camera in cameras]))
";

fn asked(python: &Path, script: &str, of: &Path) -> Value {
    let output = Command::new(python).args(["-c", script]).arg(of).output();
    let output = output.unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{}: {errors}", of.display());
    serde_json::from_slice(&output.stdout).unwrap()
}

fn python() -> Option<std::path::PathBuf> {
    match sfm::installation() {
        Ok(installation) => Some(installation.python),
        Err(reason) => {
            omnilife_schemas::testing::skip(reason);
            None
        }
    }
}

#[test]
fn pycolmap_sees_the_points_where_the_scene_does() {
    let Some(python) = python() else { return };
    let (folder, scene) = scene();
    let points = PointCloud::read_ply(&folder.path().join("points.ply")).unwrap();
    for format in ["colmap", "colmap-binary"] {
        let out = exported(format, folder.path());
        let seen = asked(&python, SEEN, &out.path().join("scene/sparse/0"));
        assert_eq!(seen.as_object().unwrap().len(), 5, "{format}");
        for frame in &scene.frames[..5] {
            let name = Path::new(&frame.image).file_name().unwrap();
            let pixels: Vec<[f64; 2]> =
                serde_json::from_value(seen[name.to_str().unwrap()].clone()).unwrap();
            let pose = frame.pose.unwrap();
            assert_eq!(pixels.len(), points.positions.len());
            for (pixel, position) in pixels.iter().zip(&points.positions) {
                let offset = DVec3::from_array(*position) - pose.centre();
                let expected = CAMERA
                    .project(pose.rotation().unwrap().inverse() * offset)
                    .unwrap();
                let error = (DVec2::from_array(*pixel) - expected).length();
                assert!(error < 1e-3, "{format}, {name:?}: {pixel:?} {expected}");
            }
        }
    }
}

#[test]
fn pycolmap_takes_cube_faces_as_a_rig() {
    let Some(python) = python() else { return };
    let (folder, _) = scene();
    let out = tempfile::tempdir().unwrap();
    let target = out.path().join("faces");
    let request = ExportRequest {
        cube_faces: Some(CubeFaces {
            side: 8,
            sky_points: 0,
        }),
        ..ExportRequest::new(folder.path(), "colmap-binary", &target)
    };
    export(&request, &Silent).unwrap();
    let seen = asked(&python, SEEN, &target.join("sparse/0"));
    let images = seen.as_object().unwrap();
    assert_eq!(images.len(), 5 * 6);
    // Every point lies on one face of every frame, but for its edges.
    for point in 0..2 {
        let inside = |pixel: &Value| {
            let pixel: Option<[f64; 2]> = serde_json::from_value(pixel.clone()).unwrap();
            pixel.is_some_and(|[u, v]| (0.0..8.0).contains(&u) && (0.0..8.0).contains(&v))
        };
        let on_faces = images.values().filter(|pixels| inside(&pixels[point]));
        assert_eq!(on_faces.count(), 5, "point {point}");
    }
    let prefixes = asked(&python, RIG, &target.join("rig_config.json"));
    assert_eq!(prefixes.as_array().unwrap().len(), 6);
}
