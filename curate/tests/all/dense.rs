//! Dense stereo of a synthetic flight over a road and a roof: distances against true ones, missing depth, and refusals.

use std::{fs, path::Path};

use glam::{DMat3, DQuat, DVec3, dvec2, dvec3};
use omnilife_schemas::{
    Classified, ErrorKind, Pose,
    camera::{Camera, CameraModel, ErpCamera, PinholeCamera},
    npy,
    points::PointCloud,
    progress::Silent,
    records::{DenseStereo, Protocol, Scale, Scene, SceneFrame, ScoredViews, Split, SplitRule},
    rgb::{self, Mask},
    scene_points::ScenePoints,
    store,
};
use omnilife_tracks::dense::{DenseRequest, make_dense};

const SIZE: [u32; 2] = [160, 120];
const HEIGHT: f64 = 30.0;
/// Height of the roof, and half its sides.
const ROOF: [f64; 3] = [4.0, 5.0, 4.0];

fn camera() -> PinholeCamera {
    PinholeCamera::with_horizontal_field_of_view(SIZE[0], SIZE[1], 1.0)
}

/// Returns the intersection of a ray with the roof or the road.
fn met(centre: DVec3, ray: DVec3) -> DVec3 {
    let [top, half_x, half_y] = ROOF;
    let at_height = |height: f64| centre + ray * ((height - centre.z) / ray.z);
    let roof = at_height(top);
    if roof.x.abs() <= half_x && roof.y.abs() <= half_y {
        return roof;
    }
    at_height(0.0)
}

/// A texture that is the same from everywhere: smooth noise of two sizes, 0 to 1.
fn texture(point: DVec3) -> f64 {
    let value = |x: f64, y: f64| {
        let mixed = (x as i64).wrapping_mul(0x9e37_79b9) ^ (y as i64).wrapping_mul(0x85eb_ca6b);
        let mixed = (mixed ^ (mixed >> 13)).wrapping_mul(0xc2b2_ae35_u32.into());
        ((mixed ^ (mixed >> 16)) & 0xffff) as f64 / 65_535.0
    };
    let smooth = |size: f64| {
        let (x, y) = (
            point.x / size + 100.0,
            (point.y + 3.0 * point.z) / size + 100.0,
        );
        let (fx, fy) = (x.fract(), y.fract());
        let row = |y: f64| value(x.floor(), y) * (1.0 - fx) + value(x.floor() + 1.0, y) * fx;
        row(y.floor()) * (1.0 - fy) + row(y.floor() + 1.0) * fy
    };
    0.5 * smooth(0.7) + 0.5 * smooth(2.1)
}

struct Flight {
    step: f64,
    with_points: bool,
    masked: bool,
}

const FLIGHT: Flight = Flight {
    step: 1.6,
    with_points: true,
    masked: false,
};

fn pose(number: usize, step: f64) -> (DMat3, DVec3) {
    let looks_down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
    let tilt = DMat3::from_rotation_x(0.05 * (number as f64).sin()) * DMat3::from_rotation_z(0.1);
    (
        looks_down * tilt,
        dvec3(step * (number as f64 - 3.0), 0.2, HEIGHT),
    )
}

impl Flight {
    fn write(&self, folder: &Path) -> Scene {
        fs::create_dir_all(folder.join("frames")).unwrap();
        let frames = (0..7).map(|number| {
            let (to_world, centre) = pose(number, self.step);
            let image = format!("frames/{number:06}.png");
            let mut bytes = Vec::new();
            for row in 0..SIZE[1] {
                for column in 0..SIZE[0] {
                    let pixel = dvec2(f64::from(column) + 0.5, f64::from(row) + 0.5);
                    let grey = texture(met(centre, to_world * camera().unproject(pixel)));
                    bytes.extend([(255.0 * grey) as u8, (200.0 * grey) as u8, 90]);
                }
            }
            rgb::write_rgb8_png(
                &folder.join(&image),
                SIZE[0] as usize,
                SIZE[1] as usize,
                &bytes,
            )
            .unwrap();
            let mask = self.masked.then(|| format!("{number:06}-mask.png"));
            if let Some(mask) = &mask {
                let covered = (0..SIZE[0] * SIZE[1]).map(|at| u8::from(at % SIZE[0] < 40) * 255);
                Mask::new(SIZE[0] as usize, SIZE[1] as usize, covered.collect())
                    .write_png(&folder.join(mask))
                    .unwrap();
            }
            SceneFrame {
                mask,
                ..SceneFrame::new(
                    image,
                    number as f64,
                    Some(Pose::new(DQuat::from_mat3(&to_world), centre)),
                )
            }
        });
        let scene = Scene {
            scale: Scale::Metres,
            points: self.with_points.then(|| "points.ply".to_owned()),
            ..Scene::given("flight", camera(), frames.collect())
        };
        if self.with_points {
            let positions: Vec<[f64; 3]> = (0..400)
                .map(|n| [f64::from(n % 20) - 10.0, f64::from(n / 20) - 10.0, 0.0])
                .collect();
            PointCloud::of_colour(positions, [90; 3])
                .write_ply(&folder.join("points.ply"))
                .unwrap();
        }
        store::write_record(&folder.join("scene.json"), &scene).unwrap();
        scene
    }
}

fn request(folder: &Path) -> DenseRequest {
    DenseRequest {
        scene_folder: folder.to_owned(),
        split: None,
        width: 640,
        out: folder.join("dense"),
    }
}

fn grey(file: &Path) -> Vec<u8> {
    image::open(file).unwrap().into_luma8().into_raw()
}

/// Shares of all pixels whose distance is known, and of the known ones that are off by more than 1 and 5 %.
fn judged(folder: &Path, dense: &DenseStereo, step: f64) -> [f64; 3] {
    let [mut all, mut known, mut off, mut wrong] = [0.0; 4];
    for frame in &dense.frames {
        let (to_world, centre) = pose(frame.frame as usize, step);
        let distances = npy::read(&folder.join("dense").join(&frame.distances)).unwrap();
        assert_eq!(distances.shape, [SIZE[1] as usize, SIZE[0] as usize]);
        let confidence = grey(&folder.join("dense").join(&frame.confidence));
        for (at, &distance) in distances.values.iter().enumerate() {
            all += 1.0;
            assert_eq!(distance > 0.0, confidence[at] > 0);
            if distance > 0.0 {
                let pixel = dvec2((at % 160) as f64 + 0.5, (at / 160) as f64 + 0.5);
                let truth = met(centre, to_world * camera().unproject(pixel)).distance(centre);
                let error = (distance / truth - 1.0).abs();
                known += 1.0;
                off += f64::from(u8::from(error > 0.01));
                wrong += f64::from(u8::from(error > 0.05));
            }
        }
    }
    [known / all, off / known, wrong / known]
}

#[test]
fn distances_are_those_of_the_road_and_the_roof() {
    let temp = tempfile::tempdir().unwrap();
    FLIGHT.write(temp.path());
    let dense = make_dense(&request(temp.path()), &Silent).unwrap();
    assert_eq!((dense.frames.len(), dense.image_size), (7, SIZE));
    let [known, off, wrong] = judged(temp.path(), &dense, FLIGHT.step);
    println!("known {known:.3}, off by 1 % {off:.3}, by 5 % {wrong:.4}");
    assert!(known > 0.8 && off < 0.1 && wrong < 0.01);
    for frame in &dense.frames {
        assert!(!frame.compared_with.is_empty() && frame.compared_with.len() <= 4);
        assert!(
            frame.searched.0 < 26.0 && frame.searched.1.unwrap() > 31.0,
            "{frame:?}"
        );
    }
    let cloud = PointCloud::read_ply(&temp.path().join("dense/points.ply")).unwrap();
    assert_eq!(cloud.len() as u64, dense.point_count);
    let on_surface = |point: &&[f64; 3]| {
        let [top, half_x, half_y] = ROOF;
        let is_roof = (point[2] - top).abs() < 0.5
            && point[0].abs() < half_x + 0.4
            && point[1].abs() < half_y + 0.4;
        is_roof || point[2].abs() < 0.5
    };
    let share = cloud.positions.iter().filter(on_surface).count() as f64 / cloud.len() as f64;
    assert!(
        cloud.len() > 2000 && share > 0.97,
        "{} {share}",
        cloud.len()
    );

    // Again: nothing is done.
    let before = fs::metadata(temp.path().join("dense/points.ply"))
        .unwrap()
        .modified()
        .unwrap();
    assert_eq!(make_dense(&request(temp.path()), &Silent).unwrap(), dense);
    let after = fs::metadata(temp.path().join("dense/points.ply"))
        .unwrap()
        .modified()
        .unwrap();
    assert_eq!(before, after);
}

/// In the coordinates of UTM, turned about the vertical.
#[test]
fn a_flight_far_from_the_origin_has_the_distances_of_one_near_it() {
    let temp = tempfile::tempdir().unwrap();
    let mut scene = FLIGHT.write(temp.path());
    let (turn, offset) = (DQuat::from_rotation_z(0.7), dvec3(5e5, 5e6, 0.0));
    for pose in scene
        .frames
        .iter_mut()
        .filter_map(|frame| frame.pose.as_mut())
    {
        let rotation = turn * pose.rotation().unwrap();
        *pose = Pose::new(rotation, turn * pose.centre() + offset);
    }
    store::write_record(&temp.path().join("scene.json"), &scene).unwrap();
    let file = temp.path().join("points.ply");
    let mut points = PointCloud::read_ply(&file).unwrap();
    for position in &mut points.positions {
        *position = (turn * DVec3::from_array(*position) + offset).to_array();
    }
    points.write_ply(&file).unwrap();
    let dense = make_dense(&request(temp.path()), &Silent).unwrap();
    let [known, off, wrong] = judged(temp.path(), &dense, FLIGHT.step);
    assert!(known > 0.8 && off < 0.1 && wrong < 0.01);
    // Points of pixels next to each other are apart, as they are on the road: floats would put them on a grid
    // of half metres.
    let cloud = PointCloud::read_ply(&temp.path().join("dense/points.ply")).unwrap();
    let on_road = |place: &&[f64; 3]| place[2].abs() < 0.5;
    let road = cloud.positions.iter().filter(on_road).count();
    assert!(road > 1000, "{road}");
    let on_grid = |place: &&[f64; 3]| (2.0 * place[1]).fract() == 0.0;
    assert!(cloud.positions.iter().filter(on_grid).count() * 100 < cloud.len());
}

#[test]
fn a_scene_without_points_is_searched_from_infinity() {
    let temp = tempfile::tempdir().unwrap();
    Flight {
        with_points: false,
        ..FLIGHT
    }
    .write(temp.path());
    let dense = make_dense(&request(temp.path()), &Silent).unwrap();
    let [known, off, wrong] = judged(temp.path(), &dense, FLIGHT.step);
    println!("known {known:.3}, off by 1 % {off:.3}, by 5 % {wrong:.4}");
    assert!(known > 0.8 && off < 0.1 && wrong < 0.01);
    assert!(
        dense.warnings[0].contains("too few points"),
        "{:?}",
        dense.warnings
    );
}

#[test]
fn nothing_is_known_under_masks() {
    let temp = tempfile::tempdir().unwrap();
    Flight {
        masked: true,
        ..FLIGHT
    }
    .write(temp.path());
    let dense = make_dense(&request(temp.path()), &Silent).unwrap();
    for frame in &dense.frames {
        let confidence = grey(&temp.path().join("dense").join(&frame.confidence));
        let covered = confidence.chunks(160).flat_map(|row| &row[..40]);
        assert!(covered.into_iter().all(|&value| value == 0));
        assert!(frame.known_share > 0.5, "{frame:?}");
    }
}

/// Only input views are used; points from held-out views are reported.
#[test]
fn input_views_alone_are_looked_at() {
    let temp = tempfile::tempdir().unwrap();
    let scene = FLIGHT.write(temp.path());
    let protocol = Protocol::new("test", SplitRule::AllGiven, ScoredViews::Novel);
    let split = Split::new("flight", protocol, vec![0, 2, 4, 6], vec![1, 3, 5]);
    let file = temp.path().join("alternate/split.json");
    fs::create_dir(temp.path().join("alternate")).unwrap();
    store::write_record(&file, &split).unwrap();
    let find = |folder: &str| {
        ScenePoints::find(&scene, temp.path(), &temp.path().join(folder))
            .unwrap()
            .unwrap()
    };
    assert_eq!(find("alternate").name, "points.ply");
    let request = DenseRequest {
        split: Some(file),
        out: temp.path().join("alternate/dense"),
        ..request(temp.path())
    };
    let dense = make_dense(&request, &Silent).unwrap();
    let looked_at: Vec<u32> = dense.frames.iter().map(|frame| frame.frame).collect();
    assert_eq!(looked_at, [0, 2, 4, 6]);
    let points = find("alternate");
    assert_eq!(
        (points.name.as_str(), points.held_out(&split.novel_views)),
        ("dense/points.ply", None)
    );
    let told = points.held_out(&[3, 4]).unwrap();
    assert!(told.contains("1 of the views that are held out"), "{told}");
    // Posed once more in another world: refused.
    let mut moved = scene.clone();
    moved.frames[5].pose = Some(Pose::new(DQuat::IDENTITY, DVec3::X));
    let message = ScenePoints::find(&moved, temp.path(), &temp.path().join("alternate"))
        .unwrap_err()
        .to_string();
    assert!(message.contains("other poses"), "{message}");
    // Of another scene: refused.
    let other = Scene {
        id: "other".to_owned(),
        ..scene.clone()
    };
    let message = ScenePoints::find(&other, temp.path(), &temp.path().join("alternate"))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("points of flight, not of other"),
        "{message}"
    );
}

#[test]
fn what_has_no_depth_is_refused_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    for (name, flight) in [
        (
            "hover",
            Flight {
                step: 0.0,
                ..FLIGHT
            },
        ),
        (
            "hover without points",
            Flight {
                step: 0.0,
                with_points: false,
                ..FLIGHT
            },
        ),
    ] {
        let folder = temp.path().join(name);
        flight.write(&folder);
        let error = make_dense(&request(&folder), &Silent).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        let message = error.to_string();
        assert!(
            message.contains("turns or hovers") && !message.contains('\n'),
            "{message}"
        );
        assert!(!folder.join("dense/dense.json").exists());
    }
    let folder = temp.path().join("panorama");
    let mut scene = FLIGHT.write(&folder);
    scene.camera = Camera::Erp(ErpCamera::new(160, 120));
    store::write_record(&folder.join("scene.json"), &scene).unwrap();
    let message = make_dense(&request(&folder), &Silent)
        .unwrap_err()
        .to_string();
    assert!(message.contains("are panoramas"), "{message}");
    // A frame of another size than the camera says.
    let folder = temp.path().join("resized");
    FLIGHT.write(&folder);
    rgb::write_rgb8_png(
        &folder.join("frames/000003.png"),
        80,
        60,
        &vec![9; 80 * 60 * 3],
    )
    .unwrap();
    let message = make_dense(&request(&folder), &Silent)
        .unwrap_err()
        .to_string();
    assert!(message.contains("000003.png: is 80x60 pixels"), "{message}");
}
