//! Layouts of data sets, written in the shape of their loaders: a world point is seen at the pixel that the
//! loader's own formula gives.

mod ob3d;
mod omniblender;
mod ricoh360;
mod splits;
mod tartanair;

use glam::DMat3;

use super::{foreign::Foreign, *};

const SIZE: [u32; 2] = [32, 16];

/// World points on all sides of the cameras of these tests.
const WORLD: [DVec3; 5] = [
    dvec3(4.0, 0.5, -1.0),
    dvec3(-3.0, 2.5, 0.7),
    dvec3(0.3, -5.0, 2.0),
    dvec3(-1.0, -2.0, -6.0),
    dvec3(0.2, 0.4, 7.0),
];

/// A rotation and a place of its own for every number.
fn placed(number: u8) -> (DMat3, DVec3) {
    let n = f64::from(number);
    let turn = DQuat::from_euler(glam::EulerRot::ZYX, 0.8 * n - 1.1, 0.2 + 0.13 * n, -0.3 * n);
    let place = dvec3(0.2 - 0.1 * n, 0.05 * n * n - 0.4, 0.3 * n - 0.6);
    (DMat3::from_quat(turn), place)
}

fn rows(matrix: DMat3) -> [[f64; 3]; 3] {
    matrix.transpose().to_cols_array_2d()
}

/// Imports the folder without a frame rate.
fn import_as_is(foreign: &Foreign, format: &str) -> Result<Scene, CurateError> {
    store::remove(&foreign.path().join("out")).unwrap();
    import(&ImportRequest::new(
        &foreign.path().join("in"),
        format,
        "foreign",
        &foreign.path().join("out"),
    ))
}

/// A frame of a scene stands at `centre`, and sees all world points where `theirs` does, to 1e-6.
fn assert_sees(scene: &Scene, frame: usize, centre: DVec3, theirs: impl Fn(DVec3) -> [f64; 2]) {
    let pose = scene.frames[frame].pose.unwrap();
    assert!(pose.centre().distance(centre) < 1e-6, "frame {frame}");
    for world in WORLD {
        let local = pose.rotation().unwrap().inverse() * (world - pose.centre());
        let (found, [u, v]) = (CAMERA.project(local).unwrap(), theirs(world));
        let across = CAMERA.wrapped_column_distance(u, found.x);
        assert!(
            across.abs() < 1e-6 && (v - found.y).abs() < 1e-6,
            "frame {frame}: {world} is at {found}, expected {u}, {v}"
        );
    }
}

/// Seconds of the frames.
fn times(scene: &Scene) -> Vec<f64> {
    scene
        .frames
        .iter()
        .map(|frame| frame.time_seconds)
        .collect()
}

/// Input and novel views of the published split.
fn split_of(scene: &Scene) -> (Vec<u32>, Vec<u32>) {
    let split = scene.published_split.clone().unwrap();
    (split.input_views, split.novel_views)
}
