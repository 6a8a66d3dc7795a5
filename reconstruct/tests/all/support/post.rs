//! A painted panel that crosses behind a post without a mask, before a painted wall, in closed form.
//!
//! The camera sways by a quarter of a pixel. Masks are what is visible of the panel: the post cuts a hole into them
//! that stays where it is.

use std::collections::BTreeMap;

use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};
use omnilife_engine::{camera::View, training_view::TrainingView};
use omnilife_reconstruct::scene::TrainingScene;
use omnilife_schemas::{
    Pose, Similarity,
    camera::{Camera, CameraModel, PinholeCamera},
    points::PointCloud,
};

/// Columns and rows of the images.
const SIZE: [u32; 2] = [96, 48];
/// Focal length, pixels.
const FOCAL: f64 = 64.0;
/// Number of views, one a second.
const VIEWS: u32 = 13;
/// Distances of post, panel and wall.
const DEPTHS: [f64; 3] = [1.0, 2.0, 4.0];
/// Half of the post's width at its distance: five pixels.
const HALF_POST: f64 = 5.0 * DEPTHS[0] / FOCAL;
/// Half of the panel's sides at its distance: 15 and 12 pixels.
const HALF_PANEL: DVec2 = dvec2(15.0 * DEPTHS[1] / FOCAL, 12.0 * DEPTHS[1] / FOCAL);
/// Way of the panel from view to view at its distance: five pixels.
const STEP: f64 = 5.0 * DEPTHS[1] / FOCAL;
/// Greatest way of the camera from its mean.
const SWAY: f64 = 0.004;

/// Returns the scene; its one object is the panel.
pub(crate) fn scene() -> TrainingScene {
    let middle = [0.5 * f64::from(SIZE[0]), 0.5 * f64::from(SIZE[1])];
    let camera: Camera = PinholeCamera::new(SIZE, [FOCAL; 2], middle).into();
    let normalization = Similarity::new([0.0; 3], 1.0);
    let mut masks = BTreeMap::new();
    let views = (0..VIEWS).map(|frame| {
        // From -1 to 1.
        let share = 2.0 * f64::from(frame) / f64::from(VIEWS - 1) - 1.0;
        let centre = dvec3(SWAY * share, 0.0, 0.0);
        let panel = dvec2(0.5 * f64::from(VIEWS - 1) * STEP * share, 0.0);
        let (mut pixels, mut mask) = (Vec::new(), Vec::new());
        for pixel in 0..SIZE[0] * SIZE[1] {
            let at = dvec2(f64::from(pixel % SIZE[0]), f64::from(pixel / SIZE[0])) + 0.5;
            let ray = camera.unproject(at);
            let (levels, is_panel) = seen(centre, ray / ray.z, panel);
            pixels.extend(levels.map(|level| level.round() as u8));
            mask.push(if is_panel { 255 } else { 0 });
        }
        masks.insert(frame, mask);
        let pose = Pose::new(DQuat::IDENTITY, centre);
        TrainingView {
            frame,
            view: View::new(camera, &pose, &normalization, f64::from(frame)).unwrap(),
            pixels,
            mask: None,
            ignored: None,
        }
    });
    let mut scene = TrainingScene::new("post", camera, views.collect(), normalization);
    scene.points = wall_points();
    scene.objects.insert("panel".to_owned(), masks);
    scene
}

/// Returns the levels of a ray whose `z` is 1, and true if it meets the panel, whose middle is at a place.
fn seen(centre: DVec3, ray: DVec3, panel: DVec2) -> ([f64; 3], bool) {
    let [on_post, on_panel, on_wall] = DEPTHS.map(|depth| (centre + depth * ray).truncate());
    let own = on_panel - panel;
    if on_post.x.abs() < HALF_POST {
        ([50.0, 40.0, 30.0], false)
    } else if own.abs().cmplt(HALF_PANEL).all() {
        (paint(own), true)
    } else {
        (wall(on_wall), false)
    }
}

fn paint(at: DVec2) -> [f64; 3] {
    [
        140.0 + 70.0 * (8.0 * at.x + 2.0 * at.y).sin(),
        130.0 + 70.0 * (3.0 * at.x + 9.0 * at.y + 1.0).sin(),
        150.0 + 70.0 * (7.0 * at.x - 7.0 * at.y).cos(),
    ]
}

fn wall(at: DVec2) -> [f64; 3] {
    let level = 100.0 + 15.0 * (2.0 * at.x).sin() + 15.0 * (2.5 * at.y).sin();
    [level, level + 8.0, level - 6.0]
}

/// Returns points of the wall over nearly all of the images.
fn wall_points() -> PointCloud<f32> {
    let places = (0..12 * 8).map(|number| {
        let at = dvec2(f64::from(number % 12), f64::from(number / 12));
        dvec2(0.45, 0.35) * (at - dvec2(5.5, 3.5))
    });
    let mut points = PointCloud::default();
    for at in places {
        let position = at.extend(DEPTHS[2]).as_vec3();
        points.positions.push(position.to_array());
        points
            .colours
            .push(wall(at).map(|level| level.round() as u8));
    }
    points
}
