//! A room with exactly known colours and distances.

use glam::{DVec3, dvec3};
use omnilife_reconstruct::methods::group::CameraPose;
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
};

/// Returns exact colour and distance along a ray, in a room with painted walls and three pillars.
pub(crate) fn room(origin: DVec3, direction: DVec3) -> (DVec3, f64) {
    let half = dvec3(3.0, 1.6, 4.0);
    let mut distance = (0..3)
        .filter(|&axis| direction[axis] != 0.0)
        .map(|axis| (half[axis] * direction[axis].signum() - origin[axis]) / direction[axis])
        .fold(f64::INFINITY, f64::min);
    let mut phase = 0.0;
    for (index, (x, z, radius)) in [(1.2, 1.8, 0.4), (-1.6, -0.6, 0.5), (0.4, -2.4, 0.35)]
        .into_iter()
        .enumerate()
    {
        let (ox, oz) = (origin.x - x, origin.z - z);
        let a = direction.x.powi(2) + direction.z.powi(2);
        let b = ox * direction.x + oz * direction.z;
        let root = b * b - a * (ox * ox + oz * oz - radius * radius);
        let hit = (-b - root.max(0.0).sqrt()) / a;
        if root > 0.0 && hit > 0.0 && hit < distance {
            distance = hit;
            phase = 1.0 + index as f64;
        }
    }
    let p = origin + distance * direction;
    let wave = |f: DVec3| {
        0.5 + 0.2 * (p.dot(f) + phase).sin() + 0.15 * (2.3 * p.dot(dvec3(f.z, f.x, f.y))).cos()
    };
    let colour = dvec3(
        wave(dvec3(5.0, 3.0, 4.0)),
        wave(dvec3(-4.0, 5.0, 2.0)),
        wave(dvec3(3.0, -2.0, 6.0)),
    );
    (colour, distance)
}

/// Returns a camera's view of the room: its image, and the distance of every pixel.
pub(crate) fn seen(camera: ErpCamera, camera_pose: &CameraPose) -> (RgbImage, Vec<f64>) {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut image = RgbImage::black(width, height);
    let mut distances = vec![0.0; width * height];
    for row in 0..height {
        for column in 0..width {
            let pixel = row * width + column;
            // Four rays per pixel, as a camera averages.
            let mut colour = DVec3::ZERO;
            for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                let place = glam::dvec2(column as f64 + dx, row as f64 + dy);
                colour += room(
                    camera_pose.centre,
                    camera_pose.to_world * camera.unproject(place),
                )
                .0 / 4.0;
            }
            image.data[pixel * 3..pixel * 3 + 3].copy_from_slice(&colour.as_vec3().to_array());
            let middle = glam::dvec2(column as f64 + 0.5, row as f64 + 0.5);
            distances[pixel] = room(
                camera_pose.centre,
                camera_pose.to_world * camera.unproject(middle),
            )
            .1;
        }
    }
    (image, distances)
}
