//! Planar ground of a hovering camera.
//!
//! Rotations tell no distances: a plane anywhere explains the images. So the ground is assumed to be level, at a
//! distance of 1 straight below the camera. The stated angle of the camera below the horizon tilts it against the
//! images; where only a size on the ground is stated, the mean camera looks straight down. Points of the ground have the median colours of the
//! clip, in which moving objects vanish. Ground near the horizon has no points.

use glam::{DMat3, DQuat, DVec3, dvec2};
use omnilife_schemas::{
    Pose, RgbImage, camera::Camera, points::PointCloud, posed_view::PosedView, statistics::median,
};
use rayon::prelude::*;

use super::level::UP;
use crate::error::CurateError;

/// Points along a row of an image.
const POINTS_PER_ROW: f64 = 320.0;
/// Maximum number of frames whose views are covered, and whose colours count.
const MOST_FRAMES: usize = 24;
/// Least cosine between rays and the vertical: 75 degrees.
const LEAST_COSINE: f64 = 0.26;
/// Accepted angles of the camera below the horizon, degrees.
pub(super) const PITCHES: [f64; 2] = [20.0, 90.0];

/// Poses over level ground, and points on it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PlanarGround {
    /// Rotations in a world whose up is [`UP`]; the camera stands in its origin.
    pub(super) poses: Vec<Option<Pose>>,
    /// Points at a height of -1.
    pub(super) points: PointCloud,
}

/// Returns the ground below a camera in one place. `pitch` is the mean angle of the camera below the horizon, degrees;
/// `read` returns the image of a frame, at the camera's size. `None` if no view shows ground.
///
/// # Errors
/// When an image cannot be read.
pub(super) fn below(
    camera: Camera,
    poses: &[Option<Pose>],
    pitch: f64,
    read: impl Fn(usize) -> Result<RgbImage, CurateError> + Sync,
) -> Result<Option<PlanarGround>, CurateError> {
    let Some(poses) = levelled(poses, pitch) else {
        return Ok(None);
    };
    let views = chosen_views(camera, &poses);
    let places = places(&views);
    if places.is_empty() {
        return Ok(None);
    }
    let seen: Vec<Vec<Option<[u8; 3]>>> = views
        .par_iter()
        .map(|view| Ok(colours(view, &places, &read(view.frame as usize)?)))
        .collect::<Result<_, CurateError>>()?;
    let colours = (0..places.len()).map(|place| median_colour(&seen, place));
    Ok(Some(PlanarGround {
        points: PointCloud {
            colours: colours.collect(),
            positions: places.iter().map(DVec3::to_array).collect(),
        },
        poses,
    }))
}

/// Returns poses in the world's origin, turned so that the mean camera looks down by `pitch` degrees.
fn levelled(poses: &[Option<Pose>], pitch: f64) -> Option<Vec<Option<Pose>>> {
    let (sine, cosine) = pitch.to_radians().sin_cos();
    let own_up = DVec3::new(0.0, -cosine, -sine);
    let rotations: Vec<Option<DQuat>> = (poses.iter())
        .map(|pose| pose.as_ref().and_then(Pose::rotation))
        .collect();
    let up: DVec3 = rotations.iter().flatten().map(|turn| *turn * own_up).sum();
    let level = DQuat::from_rotation_arc(up.try_normalize()?, UP);
    let levelled = rotations.iter().map(|rotation| {
        rotation.map(|rotation| Pose::new((level * rotation).normalize(), DVec3::ZERO))
    });
    Some(levelled.collect())
}

/// Returns evenly spaced views.
fn chosen_views(camera: Camera, poses: &[Option<Pose>]) -> Vec<PosedView> {
    let views = poses.iter().enumerate().filter_map(|(number, pose)| {
        let pose = pose.as_ref()?;
        Some(PosedView {
            frame: number as u32,
            seconds: 0.0,
            camera,
            to_world: DMat3::from_quat(pose.rotation()?),
            centre: pose.centre(),
        })
    });
    let step = poses.len().div_ceil(MOST_FRAMES).max(1);
    views.step_by(step).collect()
}

/// Returns points of the ground, each from the first view that shows it.
fn places(views: &[PosedView]) -> Vec<DVec3> {
    let mut places = Vec::new();
    for (number, view) in views.iter().enumerate() {
        let size = view.camera.size().map(|side| side as f64);
        let spacing = (size[0] / POINTS_PER_ROW).max(1.0);
        let [columns, rows] = size.map(|side| (side / spacing) as usize);
        for row in 0..rows {
            for column in 0..columns {
                let ray = view.ray(spacing * (dvec2(column as f64, row as f64) + 0.5));
                let cosine = ray.dot(-UP);
                if cosine < LEAST_COSINE {
                    continue;
                }
                let place = view.centre + ray / cosine;
                let mut earlier = views.iter().take(number);
                if !earlier.any(|other| other.pixel(place).is_some()) {
                    places.push(place);
                }
            }
        }
    }
    places
}

/// Returns the colours of places in a view's image; `None` outside of it.
fn colours(view: &PosedView, places: &[DVec3], image: &RgbImage) -> Vec<Option<[u8; 3]>> {
    let colour = |&place: &DVec3| {
        let pixel = view.pixel(place)?;
        let first = 3 * (pixel.y as usize * image.width + pixel.x as usize);
        let rgb = image.data.get(first..)?.first_chunk::<3>()?;
        Some(rgb.map(|value| (255.0 * value.clamp(0.0, 1.0)).round() as u8))
    };
    places.iter().map(colour).collect()
}

/// Returns the median of a place's colours over the views that show it, each channel by itself.
fn median_colour(seen: &[Vec<Option<[u8; 3]>>], place: usize) -> [u8; 3] {
    let colours: Vec<[u8; 3]> = seen.iter().filter_map(|view| view[place]).collect();
    [0, 1, 2].map(|channel| {
        let values: Vec<f32> = (colours.iter())
            .map(|colour| f32::from(colour[channel]))
            .collect();
        median(&values).unwrap_or(0.0) as u8
    })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use omnilife_schemas::camera::PinholeCamera;

    use super::*;

    const SIZE: [usize; 2] = [64, 36];

    fn camera() -> Camera {
        PinholeCamera::with_horizontal_field_of_view(64, 36, 1.0).into()
    }

    /// Returns poses of a camera that turns, in the world of its first frame.
    fn turning(count: usize) -> Vec<Option<Pose>> {
        let turn = |number: usize| DMat3::from_rotation_z(0.03 * number as f64);
        (0..count)
            .map(|number| Pose::from_matrix(turn(number), DVec3::ZERO))
            .collect()
    }

    /// Returns a green image in which something red has moved on by so many columns.
    fn image(number: usize) -> RgbImage {
        let pixels = (0..SIZE[0] * SIZE[1]).flat_map(|pixel| {
            let (column, row) = (pixel % SIZE[0], pixel / SIZE[0]);
            let is_red =
                (14..22).contains(&row) && (10 * number..10 * number + 8).contains(&column);
            if is_red {
                [1.0, 0.0, 0.0]
            } else {
                [0.0, 0.6, 0.0]
            }
        });
        RgbImage::new(SIZE[0], SIZE[1], pixels.collect())
    }

    fn ground(pitch: f64) -> Option<PlanarGround> {
        below(camera(), &turning(5), pitch, |number| Ok(image(number))).unwrap()
    }

    #[test]
    fn the_ground_is_level_below_the_camera_and_without_what_moves() {
        let ground = ground(90.0).unwrap();
        let height = |point: &[f64; 3]| UP.dot(DVec3::from_array(*point));
        assert!((ground.points.positions.iter()).all(|point| (height(point) + 1.0).abs() < 1e-9));
        assert!((ground.points.colours.iter()).all(|&colour| colour == [0, 153, 0]));
        // The first view whole, and of the others what it does not show.
        let count = ground.points.len();
        assert!(
            count > SIZE[0] * SIZE[1] && count < 2 * SIZE[0] * SIZE[1],
            "{count}"
        );
        let rotations: Vec<DQuat> = (ground.poses.iter().flatten())
            .map(|pose| pose.rotation().unwrap())
            .collect();
        assert!((rotations[2] * DVec3::Z).dot(UP) < -0.999_999);
        // What lies between frames is as it was.
        let between = rotations[0].inverse() * rotations[3];
        let turned = between.angle_between(DQuat::from_rotation_z(0.09));
        assert!(turned < 1e-9, "{turned}");
    }

    #[test]
    fn a_stated_pitch_tilts_the_ground_and_far_ground_is_left_out() {
        let oblique = ground(45.0).unwrap();
        let axis = oblique.poses[0].unwrap().rotation().unwrap() * DVec3::Z;
        assert!(
            (axis.dot(UP).asin().to_degrees() + 45.0).abs() < 0.3,
            "{axis}"
        );
        let farthest = (oblique.points.positions.iter()).map(|&[x, _, z]| x.hypot(z));
        let farthest = farthest.fold(0.0, f64::max);
        assert!(
            farthest > 1.2 && farthest < 1.0 / LEAST_COSINE,
            "{farthest}"
        );
        assert_eq!(ground(-30.0), None);
        let nowhere = below(camera(), &[None, None], 90.0, |number| Ok(image(number)));
        assert_eq!(nowhere.unwrap(), None);
    }
}
