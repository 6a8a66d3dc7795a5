//! A room in closed form, with distances, normals and signed distances: a box with three balls in it, which
//! occlude each other and the walls. World z up, metres.

use glam::{DMat3, DQuat, DVec3, dvec2, dvec3};
use omnilife_engine::camera::{Camera, View};
use omnilife_schemas::{
    Pose, Similarity,
    camera::{CameraModel, ErpCamera},
    distances::DistanceImage,
};

const LOW: DVec3 = dvec3(-5.5, -7.5, 0.0);
const HIGH: DVec3 = dvec3(5.5, 7.5, 3.6);
/// Centres and radii.
const BALLS: [(DVec3, f64); 3] = [
    (dvec3(1.8, 2.6, 0.9), 0.9),
    (dvec3(-2.6, 0.8, 0.5), 0.5),
    (dvec3(0.6, -3.5, 2.3), 0.3),
];

/// Intersection of a ray with the room.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hit {
    pub(crate) distance: f64,
    /// Unit, towards the camera.
    pub(crate) normal: DVec3,
    /// In [0, 1].
    pub(crate) colour: DVec3,
}

/// Returns the distance from the nearest surface, positive in the free space of the room.
pub(crate) fn signed_distance(place: DVec3) -> f64 {
    let walls = (place - LOW).min(HIGH - place).min_element();
    let ball = |&(centre, radius): &(DVec3, f64)| place.distance(centre) - radius;
    BALLS.iter().map(ball).fold(walls, f64::min)
}

/// Returns the first surface along a unit ray from a position in free space.
pub(crate) fn trace(from: DVec3, ray: DVec3) -> Hit {
    let (mut distance, mut normal) = (f64::INFINITY, DVec3::ZERO);
    for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
        let (along, at) = (ray.dot(axis), from.dot(axis));
        let wall = if along > 0.0 { HIGH } else { LOW }.dot(axis);
        let to_wall = (wall - at) / along;
        if along != 0.0 && to_wall < distance {
            (distance, normal) = (to_wall, -axis * along.signum());
        }
    }
    for (centre, radius) in BALLS {
        let offset = from - centre;
        let along = ray.dot(offset);
        let root = along * along - (offset.length_squared() - radius * radius);
        let to_ball = -along - root.max(0.0).sqrt();
        if root > 0.0 && to_ball > 0.0 && to_ball < distance {
            distance = to_ball;
            normal = (offset + ray * to_ball) / radius;
        }
    }
    Hit {
        distance,
        normal,
        colour: colour(from + ray * distance, normal),
    }
}

/// Returns squares of half a metre over slow waves.
fn colour(place: DVec3, normal: DVec3) -> DVec3 {
    let square = (place * 2.0 + 1e-6).floor().element_sum().rem_euclid(2.0);
    let waves = dvec3(
        place.dot(dvec3(1.3, 0.7, 0.2)),
        place.dot(dvec3(0.4, 1.7, 0.9)),
        place.dot(dvec3(0.8, 0.3, 2.1)),
    );
    let waves = DVec3::splat(0.5) + 0.35 * dvec3(waves.x.sin(), waves.y.sin(), waves.z.sin());
    let shade = (0.55 + 0.45 * square) * (0.6 + 0.4 * normal.z.abs());
    (waves * shade).clamp(DVec3::ZERO, DVec3::ONE)
}

/// Returns the camera-to-world rotation and centre of camera number `number`: the cameras move through the room
/// and rotate.
pub(crate) fn camera_pose(number: usize) -> (DMat3, DVec3) {
    let step = number as f64;
    let centre = dvec3(
        -1.6 + 3.0 * (1.1 * step).sin(),
        -4.5 + 1.1 * step,
        1.5 + 0.2 * step.cos(),
    );
    let (sin, cos) = (0.5 * step).sin_cos();
    // Columns: right, down, forward.
    let to_world = DMat3::from_cols(dvec3(cos, sin, 0.0), DVec3::NEG_Z, dvec3(-sin, cos, 0.0));
    (to_world, centre)
}

/// A view of the room with its exact values.
pub(crate) struct RoomView {
    pub(crate) view: View,
    pub(crate) to_world: DMat3,
    pub(crate) centre: DVec3,
    pub(crate) pixels: Vec<u8>,
    pub(crate) distances: DistanceImage,
    /// World, towards the camera.
    pub(crate) normals: Vec<DVec3>,
}

/// Returns the view of a camera in metres.
pub(crate) fn view(number: usize, width: usize) -> RoomView {
    let camera = ErpCamera::new(width as u32, width as u32 / 2);
    view_of(number, camera.into(), &Similarity::new([0.0; 3], 1.0))
}

/// Returns the view of a camera of any kind in normalized units.
pub(crate) fn view_of(number: usize, camera: Camera, normalization: &Similarity) -> RoomView {
    let (to_world, centre) = camera_pose(number);
    let (width, height) = (camera.width() as usize, camera.height() as usize);
    let ray = |at: usize| {
        let pixel = dvec2((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
        let ray = match &camera {
            Camera::Erp(camera) => camera.unproject(pixel),
            Camera::Pinhole(camera) => camera.unproject(pixel),
        };
        to_world * ray.normalize()
    };
    let hits: Vec<Hit> = (0..width * height)
        .map(|at| trace(centre, ray(at)))
        .collect();
    let pose = Pose::new(DQuat::from_mat3(&to_world), centre);
    let distance = |hit: &Hit| (hit.distance * normalization.scale) as f32;
    RoomView {
        view: View::new(camera, &pose, normalization, 0.1 * number as f64).unwrap(),
        to_world,
        centre,
        pixels: hits
            .iter()
            .flat_map(|hit| (hit.colour * 255.0).round().to_array())
            .map(|value| value as u8)
            .collect(),
        distances: DistanceImage {
            width,
            height,
            wraps: matches!(camera, Camera::Erp(_)),
            values: hits.iter().map(distance).collect(),
        },
        normals: hits.iter().map(|hit| hit.normal).collect(),
    }
}
