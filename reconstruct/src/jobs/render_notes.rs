//! Notes on rendered views: times outside of a clip, and images of another shape.

use omnilife_engine::{camera::Camera, clock::TimeSpan};

use super::camera_path::PlacedFrame;

/// Difference of a pixel's sides that rounding of sizes makes.
const SQUARE_PIXELS: f64 = 0.02;

/// Returns a line on frames at times outside of the model's clip by more than half of a frame.
pub(super) fn outside_of_clip(clip: Option<TimeSpan>, frames: &[PlacedFrame]) -> Option<String> {
    let clip = clip?;
    let (begin, end) = (clip.begin_seconds, clip.end_seconds);
    let steps = clip.frames.map_or(1, |frames| frames.max(2) - 1);
    let margin = 0.5 * (end - begin) / steps as f64;
    let is_outside =
        |frame: &&PlacedFrame| !(begin - margin..=end + margin).contains(&frame.seconds);
    let outside = frames.iter().filter(is_outside).count();
    (outside > 0).then(|| {
        format!(
            "{outside} of {} frames are at times outside of the model's, {begin:.3} to {end:.3} s: what moves is missing \
             or out of place in them",
            frames.len()
        )
    })
}

/// Returns a line on images whose pixels are not as wide as high.
pub(super) fn stretched(camera: Camera, of_poses: Option<Camera>) -> Option<String> {
    let [width, height] = [camera.width(), camera.height()];
    match (camera, of_poses) {
        (Camera::Erp(_), _) if width != 2 * height => Some(format!(
            "{width}x{height} is not the shape of a panorama: it is twice as wide as high, and images are stretched"
        )),
        (Camera::Pinhole(camera), Some(Camera::Pinhole(given))) => {
            let ratio = camera.fx / camera.fy * given.fy / given.fx;
            ((ratio - 1.0).abs() > SQUARE_PIXELS).then(|| {
                format!(
                    "{width}x{height} is not the shape of the scene's images: pixels are {ratio:.2} times as high as there, \
                     and images are stretched"
                )
            })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};
    use omnilife_schemas::{
        Pose,
        camera::{ErpCamera, PinholeCamera},
    };

    use super::*;

    #[test]
    fn images_of_another_shape_are_told() {
        let erp = |width, height| Camera::Erp(ErpCamera { width, height });
        let pinhole = PinholeCamera::with_horizontal_field_of_view(640, 360, 1.0);
        // Lenses of half the width, as anamorphic film has.
        let anamorphic = PinholeCamera {
            fx: 0.5 * pinhole.fx,
            ..pinhole
        };
        for (camera, of_poses, is_told) in [
            (erp(1024, 512), None, false),
            (erp(800, 300), None, true),
            (erp(800, 300), Some(erp(1024, 512)), true),
            (pinhole.into(), Some(pinhole.into()), false),
            (
                Camera::from(pinhole).resized(321, 181),
                Some(pinhole.into()),
                false,
            ),
            (
                Camera::from(pinhole).resized(640, 640),
                Some(pinhole.into()),
                true,
            ),
            (anamorphic.into(), Some(anamorphic.into()), false),
            (pinhole.into(), Some(erp(1024, 512)), false),
        ] {
            let note = stretched(camera, of_poses);
            assert_eq!(note.is_some(), is_told, "{camera:?}: {note:?}");
        }
    }

    #[test]
    fn times_outside_of_the_clip_are_told() {
        let clip = TimeSpan {
            begin_seconds: 1.0,
            end_seconds: 3.0,
            frames: Some(21),
        };
        let told = |clip: Option<TimeSpan>, times: &[f64]| {
            let frame = |&seconds: &f64| PlacedFrame {
                number: 0,
                seconds,
                pose: Pose::new(DQuat::IDENTITY, DVec3::ZERO),
            };
            let frames: Vec<PlacedFrame> = times.iter().map(frame).collect();
            outside_of_clip(clip, &frames)
        };
        // Half a frame of 0.1 s is rounding; a still model has no times.
        assert_eq!(told(Some(clip), &[0.96, 1.0, 2.0, 3.04]), None);
        assert_eq!(told(None, &[101.0]), None);
        let line = told(Some(clip), &[0.9, 2.0, 103.0]);
        assert!(
            line.as_ref().is_some_and(|line| line.starts_with("2 of 3")),
            "{line:?}"
        );
    }
}
