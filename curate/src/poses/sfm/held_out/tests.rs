#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::{DQuat, DVec2};
use omnilife_schemas::camera::{Camera, ErpCamera};

use super::*;

fn points() -> Vec<DVec3> {
    (0..60)
        .map(|n| {
            let angle = f64::from(n) * 0.7;
            let height = f64::from(n % 5) - 2.0;
            DVec3::new(6.0 * angle.cos(), height, 6.0 * angle.sin() + 1.0)
        })
        .collect()
}

/// Returns poses of frames that rotate, and move by `step` from one to the next.
fn images(step: f64) -> Vec<ColmapImage> {
    (0..6)
        .map(|frame| ColmapImage {
            name: format!("{frame:06}.png"),
            rotation: DQuat::from_rotation_y(0.1 * f64::from(frame)),
            centre: DVec3::new(step * f64::from(frame), 0.0, 0.0),
            observations: vec![(DVec2::ZERO, 0)],
        })
        .collect()
}

fn model(images: Vec<ColmapImage>) -> ColmapModel {
    let camera = ErpCamera {
        width: 1024,
        height: 512,
    };
    ColmapModel {
        camera: Camera::from(camera).into(),
        images: (1..).zip(images).collect(),
        points: BTreeMap::new(),
    }
}

/// Returns the exact tracks of the points.
fn tracks(images: &[ColmapImage]) -> HeldOutTracks {
    let of_point = |point: &DVec3| {
        let see = |image: &ColmapImage| {
            let ray = image.rotation.inverse() * (*point - image.centre);
            (image.name.clone(), ray.normalize())
        };
        images.iter().map(see).collect()
    };
    HeldOutTracks {
        tracks: points().iter().map(of_point).collect(),
    }
}

#[test]
fn exact_poses_have_full_credit_and_others_lose_it_by_angle() {
    let exact = images(0.5);
    let tracks = tracks(&exact);
    let full = tracks.score(&model(exact.clone())).unwrap();
    assert_eq!(full.observations, 360);
    assert!(full.score > 1.0 - 1e-6, "{full:?}");
    assert!(full.median_degrees.unwrap() < 1e-6, "{full:?}");
    // A frame that is turned by two degrees about its up: its own features are all without credit.
    let mut turned = exact.clone();
    turned[5].rotation *= DQuat::from_rotation_y(2f64.to_radians());
    let worse = tracks.score(&model(turned)).unwrap();
    assert!(worse.score < 5.0 / 6.0 + 1e-9, "{worse:?}");
    // Without a pose its features count all the same.
    let missing = tracks.score(&model(exact[..5].to_vec())).unwrap();
    assert_eq!(missing.observations, 360);
    assert!((missing.score - 5.0 / 6.0).abs() < 1e-6, "{missing:?}");
    // A frame turned by a quarter of a degree predicts itself that far off, at half the credit.
    let track = [
        ("a".to_owned(), DVec3::Z),
        ("b".to_owned(), DVec3::new(-1.0, 0.0, 4.0).normalize()),
        ("c".to_owned(), DVec3::new(-2.0, 0.0, 4.0).normalize()),
    ];
    let named = |name: &str, x: f64, degrees: f64| ColmapImage {
        name: name.to_owned(),
        rotation: DQuat::from_rotation_y(degrees.to_radians()),
        centre: DVec3::new(x, 0.0, 0.0),
        observations: Vec::new(),
    };
    let [a, b, c] = [
        named("a", 0.0, 0.25),
        named("b", 1.0, 0.0),
        named("c", 2.0, 0.0),
    ];
    let by_name = [("a", &a), ("b", &b), ("c", &c)].into_iter().collect();
    let error = error_degrees(&track, 0, &by_name).unwrap();
    assert!((error - 0.25).abs() < 1e-6, "{error}");
    assert!(HeldOutTracks::default().score(&model(exact)).is_none());
}

/// Rotations alone explain the features of a camera that stands, at any distance from the origin.
#[test]
fn poses_in_one_place_have_no_credit() {
    for offset in [0.0, 700.0] {
        let mut standing = images(0.0);
        for image in &mut standing {
            image.centre.x += offset;
        }
        let score = tracks(&standing).score(&model(standing)).unwrap();
        assert_eq!((score.observations, score.median_degrees), (360, None));
        assert!(score.score.abs() < 1e-12, "{score:?}");
    }
}

#[test]
fn distances_weight_rays_in_a_triangulation() {
    // Two rays that meet near the centre, and a far origin whose ray is wrong by a small angle.
    let point = DVec3::new(0.0, 0.0, 2.0);
    let near = [DVec3::new(1.0, 0.0, 0.0), DVec3::new(-1.0, 0.0, 0.0)];
    let far = DVec3::new(0.0, 0.0, 200.0);
    let mut rays: Vec<(DVec3, DVec3)> = near
        .iter()
        .map(|origin| (*origin, (point - *origin).normalize()))
        .collect();
    rays.push((far, (point + DVec3::X - far).normalize()));
    let found = direction_from(DVec3::ZERO, &rays);
    let error = angle_degrees(found, point);
    assert!(error < 0.01, "{error}");
    // Parallel rays meet nowhere: the point is in their direction.
    let parallel = [(DVec3::X, DVec3::Z), (DVec3::Y, DVec3::Z)];
    assert!(angle_degrees(direction_from(DVec3::ZERO, &parallel), DVec3::Z) < 1e-9);
}

#[test]
fn a_camera_that_only_rotates_has_no_parallax() {
    let still = tracks(&images(0.0)).parallax_degrees().unwrap();
    assert!(still < 1e-6, "{still}");
    let moving = tracks(&images(0.5)).parallax_degrees().unwrap();
    assert!(moving > 8.0, "{moving}");
    let mut few = tracks(&images(0.0));
    few.tracks.truncate(LEAST_SHARED - 1);
    assert_eq!(few.parallax_degrees(), None);
}

#[test]
fn lines_are_features_with_rays() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("held_out.txt");
    assert_eq!(
        HeldOutTracks::read(&path).unwrap(),
        HeldOutTracks::default()
    );
    store::write_bytes(&path, b"a.png 0 0 2 b.png 1 0 0\n").unwrap();
    let read = HeldOutTracks::read(&path).unwrap();
    assert_eq!(read.tracks[0][0], ("a.png".to_owned(), DVec3::Z));
    for broken in [
        "a.png 0 0\n",
        "a.png 0 0 0\n",
        "a.png 0 0 nan\n",
        "a.png 0 0 one\n",
    ] {
        store::write_bytes(&path, broken.as_bytes()).unwrap();
        assert!(HeldOutTracks::read(&path).is_err(), "{broken}");
    }
}
