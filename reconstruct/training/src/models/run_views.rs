//! Views of a run's split, by the run's record.

use glam::{DVec2, DVec3, dvec3};
use omnilife_schemas::{
    camera::{Camera, CameraModel},
    records::{GraphObject, PosedFrame, Poses, Scene, Split},
    trajectory::GroundAxes,
};

/// Returns the mean direction up of the input views' cameras, in the world; `None` where they have no common one.
pub fn up(scene: &Scene, split: &Split) -> Option<[f64; 3]> {
    let frames = split.input_views.iter();
    let poses = frames.filter_map(|&frame| scene.frames.get(frame as usize)?.pose);
    let up: DVec3 = poses
        .filter_map(|pose| Some(pose.rotation()? * DVec3::NEG_Y))
        .sum();
    up.try_normalize().map(|up| up.to_array())
}

/// Returns the times of the first and the last view of a split, seconds; `None` for a split without views.
pub fn clip_seconds(scene: &Scene, split: &Split) -> Option<[f64; 2]> {
    let views = split.input_views.iter().chain(&split.novel_views);
    let times = views.filter_map(|&frame| Some(scene.frames.get(frame as usize)?.time_seconds));
    times.fold(None, |clip, time| {
        let [first, last] = clip.unwrap_or([time; 2]);
        Some([first.min(time), last.max(time)])
    })
}

/// Returns the cameras of all views of a split, in the world and in order of time.
pub fn poses(scene: &Scene, split: &Split) -> Poses {
    let views = split.input_views.iter().chain(&split.novel_views);
    let mut frames: Vec<PosedFrame> = views
        .filter_map(|&frame| {
            let entry = scene.frames.get(frame as usize)?;
            Some(PosedFrame::new(entry.time_seconds, entry.pose?))
        })
        .collect();
    frames.sort_by(|one, other| one.time_seconds.total_cmp(&other.time_seconds));
    Poses::new(scene.scale, Some(scene.camera), frames)
}

/// Returns true if any view shows a part of the box of an object during the object's existence. Occlusion is
/// ignored.
pub fn is_in_view(object: &GraphObject, up: [f64; 3], views: &Poses) -> bool {
    let axes = GroundAxes::new(DVec3::from_array(up));
    let is_shown = |frame: &PosedFrame| {
        let (centre, heading) = object.path.at(frame.time_seconds)?;
        let to_world = frame.pose.rotation()?;
        let Some(camera) = views.camera else {
            // A whole sphere shows everything.
            return Some(());
        };
        let rotation = axes.rotation(heading);
        let corners = (0..8).filter_map(|corner| {
            let half = |axis: usize| {
                let side = if corner >> axis & 1 == 1 { 0.5 } else { -0.5 };
                side * object.dimensions[axis]
            };
            let world = centre + rotation * dvec3(half(0), half(1), half(2));
            camera.project(to_world.inverse() * (world - frame.pose.centre()))
        });
        meets_image(&camera, corners).then_some(())
    };
    views.frames.iter().any(|frame| is_shown(frame).is_some())
}

/// Returns true if the hull of some pixels, along columns and rows, meets the image.
fn meets_image(camera: &Camera, pixels: impl Iterator<Item = DVec2>) -> bool {
    let Camera::Pinhole(_) = camera else {
        return true;
    };
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for pixel in pixels {
        low = low.min(pixel);
        high = high.max(pixel);
    }
    let [width, height] = camera.size().map(|side| side as f64);
    low.x < width && low.y < height && high.x > 0.0 && high.y > 0.0
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};
    use omnilife_schemas::{
        Pose,
        camera::{ErpCamera, PinholeCamera},
        records::Scale,
        trajectory::{BSpline, ObjectPath},
    };

    use super::*;

    /// Returns views at seconds 0 to 4, straight down from 40 m: 64 x 36 m of the ground.
    fn views(camera: Camera) -> Poses {
        let looks_down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let pose = Pose::new(DQuat::from_mat3(&looks_down), dvec3(0.0, 0.0, 40.0));
        let frame = |time: i32| PosedFrame::new(f64::from(time), pose);
        Poses::new(Scale::Metres, Some(camera), (0..5).map(frame).collect())
    }

    /// Returns an object that moves from a place along x at 2 m/s, from second 2 to 6.
    fn object(x: f64, y: f64) -> GraphObject {
        GraphObject {
            id: 3,
            dimensions: [4.5, 1.8, 1.5],
            path: ObjectPath {
                centre: BSpline {
                    degree: 1,
                    knots: BSpline::uniform_knots(1, 2, 2.0, 6.0),
                    coefficients: vec![[x, y, 0.75], [x + 8.0, y, 0.75]],
                },
                heading_seconds: vec![2.0],
                headings: vec![0.0],
            },
            corrections: vec![[0.0; 4]],
        }
    }

    #[test]
    fn objects_beside_every_image_are_not_in_view() {
        let camera = PinholeCamera::new([640, 360], [400.0, 400.0], [320.0, 180.0]);
        let views = views(camera.into());
        let is_in_view = |x: f64, y: f64| is_in_view(&object(x, y), [0.0, 0.0, 1.0], &views);
        assert!(is_in_view(0.0, 0.0));
        // The last view is at 4 s, when it has moved 4 m. The border is 32 m from the middle, half of the car
        // 2.25 m (and its roof is nearer to the camera).
        assert!(is_in_view(-37.0, 0.0));
        assert!(!is_in_view(-40.0, 0.0));
        assert!(is_in_view(33.0, 0.0));
        assert!(!is_in_view(36.0, 0.0));
        assert!(!is_in_view(0.0, 500.0));
    }

    #[test]
    fn what_is_there_at_no_time_of_a_view_is_not_in_view_of_a_sphere_either() {
        let erp = ErpCamera::new(64, 32);
        let views = views(erp.into());
        let seen_later = |seconds: f64| {
            let object = object(500.0, 0.0);
            let path = object.path.clone().delayed(seconds);
            is_in_view(&GraphObject { path, ..object }, [0.0, 0.0, 1.0], &views)
        };
        assert!(seen_later(0.0));
        assert!(!seen_later(3.0));
    }
}
