//! The shell of PanoGS behind samples of pixels, in a room whose upper part counts as open sky.

use glam::{Vec3, dvec2};
use omnilife_engine::gaussians::static_gaussians::POSITIONS;
use omnilife_reconstruct::request::MethodRequest;
use omnilife_schemas::camera::CameraModel;

use crate::depth::{
    panogs::{CAMERA, UNIT, is_used, prepared, scene},
    room,
};

/// Height of the roofs above which the room counts as open sky, metres.
const ROOFS: f64 = 2.4;

#[test]
fn the_shell_of_the_sky_reaches_the_roofs_in_every_view() {
    let folder = tempfile::tempdir().unwrap();
    let ray = |pixel: usize| {
        let at = dvec2((pixel % 128) as f64 + 0.5, (pixel / 128) as f64 + 0.5);
        CAMERA.unproject(at)
    };
    let open = |view: usize, pixel: usize, metres: f32| {
        let (to_world, centre) = room::camera_pose(view);
        let place = centre + to_world * ray(pixel) * f64::from(metres);
        if place.z > ROOFS { 0.0 } else { metres }
    };
    let scene = scene(folder.path(), 4, open);
    let mut prepared = prepared(&scene, &MethodRequest::new(10, 0));
    assert!(is_used(&prepared, "sky-shell"));
    let model = prepared.learner.gaussians().unwrap().unwrap();
    let tables = model.parts.iter().map(|part| &part.table.arrays[POSITIONS]);
    let places: Vec<Vec3> = tables
        .flat_map(|array| array.values.as_chunks::<3>().0)
        .map(|&place| Vec3::from_array(place))
        .collect();
    // Neighbours of the shell, and pixels, are as far apart.
    let spacing = std::f32::consts::PI / 64.0;
    let mut pixels = 0;
    for (number, view) in scene.input_views.iter().enumerate() {
        let exact = room::view_of(number, CAMERA.into(), &scene.normalization);
        let directions: Vec<Vec3> = places
            .iter()
            .map(|&place| (place - view.view.centre).normalize())
            .collect();
        // Not at the poles, where pixels crowd.
        for pixel in (128 * 8..128 * 56).step_by(5) {
            let metres = exact.distances.values[pixel] / UNIT as f32;
            if open(number, pixel, metres) > 0.0 {
                continue;
            }
            pixels += 1;
            let above = view.view.rotation.transpose() * ray(pixel).as_vec3();
            let nearest = directions.iter().map(|direction| direction.dot(above));
            let angle = nearest.fold(-1.0, f32::max).min(1.0).acos();
            assert!(
                angle < spacing,
                "{angle} from pixel {pixel} of view {number}"
            );
        }
    }
    assert!(pixels > 500, "{pixels}");
}
