//! Poses by words against their definitions.

use glam::dvec3;
use omnilife_engine::camera::View;
use omnilife_schemas::{
    RgbImage, Similarity,
    camera::{CameraModel, ErpCamera, PinholeCamera},
};

use super::*;

/// A model of one object that moves along x, without images.
struct Empty;

impl OpenedModel for Empty {
    fn normalization(&self) -> Similarity {
        Similarity::new([0.0; 3], 1.0)
    }

    fn image(&mut self, _view: &View) -> Result<RgbImage, ReconstructError> {
        Ok(RgbImage::black(1, 1))
    }

    fn object_centres(&self, _id: &str, seconds: &[f64]) -> Result<Vec<DVec3>, ReconstructError> {
        Ok(seconds.iter().map(|&time| dvec3(time, 0.0, 3.0)).collect())
    }
}

fn pinhole() -> Camera {
    PinholeCamera::with_horizontal_field_of_view(64, 48, 1.2).into()
}

/// Eight cameras on an arc around (0, 0, 4) in a world with y down, turned towards it.
fn arc() -> Vec<PlacedFrame> {
    let frame = |number: usize| {
        let angle = 0.1 * number as f64 - 0.3;
        let centre = dvec3(5.0 * angle.sin(), -0.5, 4.0 - 5.0 * angle.cos());
        PlacedFrame {
            number,
            seconds: 0.5 * number as f64,
            pose: looking_at(centre, dvec3(0.0, 0.0, 4.0), DVec3::NEG_Y).expect("apart"),
        }
    };
    (0..8).map(frame).collect()
}

fn frames(
    words: &CameraWords,
    points: &[DVec3],
    camera: Camera,
) -> Result<Vec<PlacedFrame>, ReconstructError> {
    frames_of(words, points, [camera; 2])
}

/// Returns the frames for a rendered camera and the camera of the poses.
fn frames_of(
    words: &CameraWords,
    points: &[DVec3],
    [camera, posed_camera]: [Camera; 2],
) -> Result<Vec<PlacedFrame>, ReconstructError> {
    let posed = arc();
    let seconds: Vec<f64> = posed.iter().map(|frame| frame.seconds).collect();
    let surroundings = SceneContext {
        file: Path::new("scene.json"),
        seconds: &seconds,
        posed: &posed,
        points,
        camera,
        posed_camera: Some(posed_camera),
    };
    surroundings.frames(words, &Empty)
}

/// Returns the angle between a camera's axis and the direction to a target, radians.
fn aside(frame: &PlacedFrame, target: DVec3) -> f64 {
    let rotation = frame.pose.rotation().expect("a rotation");
    (rotation * DVec3::Z).angle_between(target - frame.pose.centre())
}

fn by(places: CameraPlaces, target: Option<LookAt>) -> CameraWords {
    CameraWords {
        places,
        target,
        up: Some([0.0, -1.0, 0.0]),
        ..CameraWords::default()
    }
}

#[test]
fn an_orbit_goes_around_its_target_and_looks_at_it() {
    let target = dvec3(0.0, 0.0, 4.0);
    for target_by in [None, Some(LookAt::Point(target.to_array()))] {
        let words = by(CameraPlaces::Orbit(360.0), target_by);
        // Without points the middle is where the cameras' axes meet.
        let turn = frames(&words, &[], pinhole()).expect("an orbit");
        assert_eq!(turn.len(), 8);
        for (number, frame) in turn.iter().enumerate() {
            assert!(aside(frame, target) < 1e-6, "{}", aside(frame, target));
            let offset = frame.pose.centre() - target;
            assert!((offset.x.hypot(offset.z) - 5.0).abs() < 0.02);
            assert!((offset.y + 0.5).abs() < 0.02);
            assert_eq!(frame.seconds, 0.5 * number as f64);
            let down = frame.pose.rotation().expect("a rotation") * DVec3::Y;
            assert!(down.y > 0.9);
        }
        assert!((turn[0].pose.centre() - arc()[0].pose.centre()).length() < 0.05);
        let opposite = turn[4].pose.centre() - target;
        let first = turn[0].pose.centre() - target;
        assert!((opposite.x + first.x).abs() + (opposite.z + first.z).abs() < 1e-9);
    }
    // An arc ends at its degrees, after a whole turn too.
    for degrees in [90.0, 450.0] {
        let words = by(CameraPlaces::Orbit(degrees), None);
        let arc = frames(&words, &[], pinhole()).expect("an arc");
        let [first, last] = [arc[0], arc[7]].map(|frame| {
            let offset = frame.pose.centre() - target;
            dvec3(offset.x, 0.0, offset.z)
        });
        assert!((first.angle_between(last).to_degrees() - 90.0).abs() < 1e-6);
    }
}

#[test]
fn cameras_follow_an_object() {
    let target = Some(LookAt::Object("1".to_owned()));
    for places in [
        CameraPlaces::OfPoses,
        CameraPlaces::Stationary(2),
        CameraPlaces::Orbit(360.0),
        CameraPlaces::FromAbove,
    ] {
        for frame in frames(&by(places, target.clone()), &[], pinhole()).expect("frames") {
            assert!(aside(&frame, dvec3(frame.seconds, 0.0, 3.0)) < 1e-6);
        }
    }
}

#[test]
fn from_above_the_upper_edge_is_forward_and_all_is_in_the_image() {
    let points: Vec<DVec3> = (0..100)
        .map(|n| dvec3(f64::from(n % 10) - 4.5, 1.0, f64::from(n / 10) - 0.5))
        .collect();
    for camera in [pinhole(), ErpCamera::new(64, 32).into()] {
        let above = frames(&by(CameraPlaces::FromAbove, None), &points, camera).expect("frames");
        for frame in &above {
            let rotation = frame.pose.rotation().expect("a rotation");
            let up_in_image = rotation * DVec3::NEG_Y;
            assert!(up_in_image.dot(DVec3::Z) > 0.99, "{up_in_image}");
            assert!((rotation * DVec3::Z).distance(DVec3::Y) < 1e-9);
        }
    }
    let camera = pinhole();
    let above = frames(&by(CameraPlaces::FromAbove, None), &points, camera).expect("frames");
    let to_camera = above[0].pose.rotation().expect("a rotation").inverse();
    let inside = points.iter().filter(|&&point| {
        let pixel = camera.project(to_camera * (point - above[0].pose.centre()));
        pixel.is_some_and(|pixel| (0.0..64.0).contains(&pixel.x) && (0.0..48.0).contains(&pixel.y))
    });
    assert_eq!(inside.count(), 100);
}

#[test]
fn a_stationary_camera_is_that_of_its_frame_and_time_goes_on() {
    let words = by(CameraPlaces::Stationary(3), None);
    let stationary = frames(&words, &[], pinhole()).expect("frames");
    for (frame, posed) in stationary.iter().zip(arc()) {
        assert_eq!(frame.pose, arc()[3].pose);
        assert_eq!(frame.seconds, posed.seconds);
    }
    let alone = frames(&by(CameraPlaces::Frame(3), None), &[], pinhole()).expect("a frame");
    assert_eq!(alone, [arc()[3]]);
    let refused = frames(&by(CameraPlaces::Frame(8), None), &[], pinhole());
    assert!(refused.is_err_and(|error| error.to_string().contains("has no frame 8")));
    let words = by(CameraPlaces::Stationary(8), None);
    let message = frames(&words, &[], pinhole())
        .expect_err("refused")
        .to_string();
    assert_eq!(message, "scene.json: has no frame 8: there are 0 to 7");
}

#[test]
fn panoramas_without_points_have_no_middle() {
    let panorama = ErpCamera::new(64, 32).into();
    let words = by(CameraPlaces::Orbit(360.0), None);
    for rendered in [panorama, pinhole()] {
        let message = frames_of(&words, &[], [rendered, panorama]);
        let message = message.expect_err("refused").to_string();
        assert!(message.contains("--look-at"), "{message}");
    }
    assert!(frames_of(&words, &[], [panorama, pinhole()]).is_ok());
}
