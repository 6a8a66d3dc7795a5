//! Orthophotos of a synthetic flight: a painted ground returns in its place, without the cars that drive over it.

use image::Rgba;
use serde_json::Value;

use super::{
    exports::{
        EAST, NORTH, ZONE, export, read, write_circling_scene, write_telemetry, write_track,
    },
    *,
};

const MOVING: [u8; 3] = [220, 30, 30];
const STANDING: [u8; 3] = [40, 40, 220];

/// Squares of 4 m in two colours.
fn ground(place: DVec3) -> [u8; 3] {
    let number = (place.x / 4.0).floor() + (place.y / 4.0).floor();
    if number.rem_euclid(2.0) == 0.0 {
        [60, 120, 60]
    } else {
        [170, 170, 160]
    }
}

/// Returns the colour of the ground with the cars of the flight on it.
fn with_cars(place: DVec3, seconds: f64) -> [u8; 3] {
    let is_on = |number: usize| {
        let (centre, heading) = car(number, seconds);
        let own = DMat3::from_rotation_z(-heading) * (place - centre);
        own.x.abs() < 2.25 && own.y.abs() < 0.9
    };
    match (0..3).find(|&number| is_on(number)) {
        Some(2) => STANDING,
        Some(_) => MOVING,
        None => ground(place),
    }
}

/// Writes the frames of a scene over a painted ground.
fn paint(folder: &Path, scene: &Scene, colour: impl Fn(DVec3, f64) -> [u8; 3]) {
    let frames: Vec<u32> = (0..FRAMES as u32).collect();
    for view in PosedView::of_scene(scene, &frames) {
        let pixels = (0..320 * 180).flat_map(|pixel| {
            let at = glam::dvec2(f64::from(pixel % 320) + 0.5, f64::from(pixel / 320) + 0.5);
            let ray = view.ray(at);
            colour(view.centre - view.centre.z / ray.z * ray, view.seconds)
        });
        let file = folder.join(&scene.frames[view.frame as usize].image);
        rgb::write_rgb8_png(&file, 320, 180, &pixels.collect::<Vec<u8>>()).unwrap();
    }
}

/// Returns the six terms of the world file.
fn world_file(folder: &Path) -> [f64; 6] {
    let text = read(folder, "orthophoto.pgw");
    let terms: Vec<f64> = text.lines().map(|line| line.parse().unwrap()).collect();
    terms.try_into().unwrap()
}

fn image_of(folder: &Path) -> image::RgbaImage {
    let file = folder.join("tracks/orthophoto.png");
    image::open(file).unwrap().into_rgba8()
}

#[test]
fn the_ground_returns_without_the_cars_that_move() {
    let temp = tempfile::tempdir().unwrap();
    let scene = write_scene(&temp.path().join("scene"));
    paint(&temp.path().join("scene"), &scene, with_cars);
    let tracks = make_tracks(&request(temp.path(), &boxes(&scene)), &Silent).unwrap();
    assert_eq!(tracks.tracks.len(), 2, "{:?}", tracks.warnings);
    export(temp.path(), &["orthophoto"], None).unwrap();
    let [by_column, d, b, by_row, x, y] = world_file(temp.path());
    assert!(d.abs() < 1e-3 && b.abs() < 1e-3 && by_column > 0.0 && by_row < 0.0);
    let image = image_of(temp.path());
    let mut standing = 0;
    for row in [-10.0, -6.0, -2.0, 2.0] {
        // Along x = 4.5 and along y = 2 cars have driven.
        for column in [-14.0, -10.0, -6.0, -2.0, 2.0, 4.5, 10.0, 14.0] {
            let place = dvec3(column, row, 0.0);
            let pixel = [(column - x) / by_column, (row - y) / by_row];
            let [across, down] = pixel.map(|at| at.round() as u32);
            let &Rgba([red, green, blue, alpha]) = image.get_pixel(across, down);
            let expected = with_cars(place, 0.0);
            let expected = if expected == MOVING {
                ground(place)
            } else {
                expected
            };
            standing += u32::from(expected == STANDING);
            let found = [red, green, blue];
            let differs = found.iter().zip(expected).any(|(a, b)| a.abs_diff(b) > 12);
            assert!(
                alpha == 255 && !differs,
                "{place}: {found:?}, not {expected:?}"
            );
        }
    }
    assert_eq!(standing, 1);
    let about: Value = serde_json::from_str(&read(temp.path(), "orthophoto.json")).unwrap();
    assert!(about["epsg"].is_null());
    let unseen = image.pixels().filter(|pixel| pixel[3] == 0).count() as f64;
    let share = unseen / f64::from(image.width() * image.height());
    assert!((about["unseen_share"].as_f64().unwrap() - share).abs() < 1e-9);
}

#[test]
fn a_place_lies_where_the_map_has_it() {
    let temp = tempfile::tempdir().unwrap();
    let scene = write_circling_scene(temp.path());
    write_track(temp.path(), [DVec3::ZERO, DVec3::X], 1.0);
    let mark = dvec3(55.0, 5.0, 0.0);
    paint(&temp.path().join("scene"), &scene, |place, _| {
        let off = (place - mark).abs();
        if off.x < 1.5 && off.y < 1.5 {
            MOVING
        } else {
            [120; 3]
        }
    });
    let telemetry = write_telemetry(temp.path(), &scene, false);
    export(temp.path(), &["orthophoto"], Some(&telemetry)).unwrap();
    let about: Value = serde_json::from_str(&read(temp.path(), "orthophoto.json")).unwrap();
    assert_eq!(about["epsg"].as_u64(), Some(32_600 + u64::from(ZONE)));
    let [a, d, b, e, c, f] = world_file(temp.path());
    let image = image_of(temp.path());
    let marked: Vec<[f64; 2]> = image
        .enumerate_pixels()
        .filter(|(_, _, pixel)| pixel[0] > 190 && pixel[1] < 60)
        .map(|(column, row, _)| [f64::from(column), f64::from(row)])
        .collect();
    assert!(marked.len() > 50, "{}", marked.len());
    let mean = |axis: usize| marked.iter().map(|at| at[axis]).sum::<f64>() / marked.len() as f64;
    let (column, row) = (mean(0), mean(1));
    let east = a * column + b * row + c - EAST;
    let north = d * column + e * row + f - NORTH;
    let error = (east - mark.x).hypot(north - mark.y);
    assert!(error < 0.15, "{east} {north}");
    // The grid of the map is turned against the meridian.
    assert!(d != 0.0 && (a.hypot(d) / e.hypot(b) - 1.0).abs() < 1e-3);
}

#[test]
fn cameras_that_do_not_see_the_ground_are_refused() {
    let temp = tempfile::tempdir().unwrap();
    let mut scene = write_scene(&temp.path().join("scene"));
    for frame in &mut scene.frames {
        // Straight up.
        let centre = frame.pose.unwrap().centre();
        frame.pose = Some(Pose::new(DQuat::IDENTITY, centre));
    }
    store::write_record(&temp.path().join("scene/scene.json"), &scene).unwrap();
    write_track(temp.path(), [DVec3::ZERO, DVec3::X], 1.0);
    let message = export(temp.path(), &["orthophoto"], None).unwrap_err();
    assert!(
        !message.contains('\n') && message.contains("75 degrees"),
        "{message}"
    );
}
