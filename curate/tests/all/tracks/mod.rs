//! Tracks of a synthetic flight: boxes of another program become paths on the ground, and faults of these are reported
//! in one line.

mod estimates;
mod every_frame;
mod exports;
mod hovering;
mod moved;
mod orthophotos;
#[cfg(unix)]
mod programs;

use std::{fmt::Write as _, fs, path::Path};

use glam::{DMat3, DQuat, DVec3, dvec3};
use omnilife_schemas::{
    Classified, ErrorKind, Pose,
    camera::PinholeCamera,
    npy,
    points::PointCloud,
    posed_view::PosedView,
    progress::Silent,
    records::{DepthPrior, DistanceConvention, PoseSource, Scale, Scene, SceneFrame},
    rgb, store,
    trajectory::GroundAxes,
};
use omnilife_tracks::{
    OVERLAY_FILE, PAGE_FILE, TrackOptions, TrackRequest, boxes::projected_box, detectors::files,
    distance::DistanceMethod, make_tracks, plan_tracks,
};

const FRAMES: usize = 16;

/// Returns place and heading of a car: past the drone, or standing.
fn car(number: usize, seconds: f64) -> (DVec3, f64) {
    match number {
        0 => (dvec3(-18.0 + 2.5 * seconds, 2.0, 0.75), 0.0),
        1 => (
            dvec3(4.0, 14.0 - 2.0 * seconds, 0.75),
            -std::f64::consts::FRAC_PI_2,
        ),
        _ => (dvec3(-5.0, -6.0, 0.75), 0.0),
    }
}

/// A scene over a flat road, in metres.
fn write_scene(folder: &Path) -> Scene {
    fs::create_dir_all(folder.join("frames")).unwrap();
    let looks_down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
    let frames = (0..FRAMES).map(|number| {
        let image = format!("frames/{number:06}.png");
        rgb::write_rgb8_png(&folder.join(&image), 320, 180, &vec![90; 320 * 180 * 3]).unwrap();
        let q = DQuat::from_mat3(&(looks_down * DMat3::from_rotation_x(0.1)));
        SceneFrame::new(
            image,
            number as f64,
            Some(Pose::new(q, dvec3(0.3 * number as f64 - 2.0, -4.0, 40.0))),
        )
    });
    let scene = Scene {
        scale: Scale::Metres,
        points: Some("points.ply".to_owned()),
        ..Scene::given(
            "flight",
            PinholeCamera::with_horizontal_field_of_view(320, 180, 1.1),
            frames.collect(),
        )
    };
    write_points(folder, 60, 1.0);
    store::write_record(&folder.join("scene.json"), &scene).unwrap();
    scene
}

/// Points of the road, so many on a side, so many metres apart.
fn write_points(folder: &Path, side: usize, spacing: f64) {
    let coordinate = |n: usize| spacing * (n as f64 - 0.5 * side as f64);
    let positions: Vec<[f64; 3]> = (0..side * side)
        .map(|n| [coordinate(n % side), coordinate(n / side), 0.0])
        .collect();
    let points = PointCloud::of_colour(positions, [90; 3]);
    points.write_ply(&folder.join("points.ply")).unwrap();
}

/// The cars' boxes as MOT text.
fn boxes(scene: &Scene) -> String {
    let frames: Vec<u32> = (0..scene.frames.len() as u32).collect();
    let axes = GroundAxes::new(DVec3::Z);
    let mut text = String::new();
    for view in PosedView::of_scene(scene, &frames) {
        for number in 0..3 {
            let (centre, heading) = car(number, view.seconds);
            let sides = projected_box(&view, centre, axes.rotation(heading), [4.5, 1.8, 1.5]);
            let Some([left, top, width, height]) = sides else {
                continue;
            };
            let is_whole = left > 0.0 && top > 0.0 && left + width < 320.0 && top + height < 180.0;
            // Every seventh is missed.
            if is_whole && (view.frame as usize * 3 + number) % 7 != 3 {
                writeln!(
                    text,
                    "{},-1,{left},{top},{width},{height},0.9",
                    view.frame + 1
                )
                .unwrap();
            }
        }
    }
    text
}

fn request(folder: &Path, boxes: &str) -> TrackRequest {
    let file = folder.join("boxes.txt");
    fs::write(&file, boxes).unwrap();
    TrackRequest {
        scene_folder: folder.join("scene"),
        split: None,
        options: TrackOptions {
            detector: &files::DETECTOR,
            detections: Some(file),
            ..TrackOptions::default()
        },
        out: folder.join("tracks"),
    }
}

#[test]
fn boxes_become_paths_and_what_stands_is_static() {
    let temp = tempfile::tempdir().unwrap();
    let scene = write_scene(&temp.path().join("scene"));
    let request = request(temp.path(), &boxes(&scene));
    let tracks = make_tracks(&request, &Silent).unwrap();
    assert_eq!(tracks.tracks.len(), 2, "{:?}", tracks.warnings);
    assert_eq!(tracks.warnings.len(), 1);
    assert!(
        tracks.warnings[0].contains("static"),
        "{}",
        tracks.warnings[0]
    );
    for track in &tracks.tracks {
        let number = (0..2)
            .min_by(|&a, &b| {
                let [a, b] = [a, b].map(|n| track.path.at(7.0).unwrap().0.distance(car(n, 7.0).0));
                a.total_cmp(&b)
            })
            .unwrap();
        let [begin, end] = track.path.centre.range();
        for step in 0..=20 {
            let seconds = (begin + (end - begin) * f64::from(step) / 20.0).min(end);
            let ((place, heading), (truth, true_heading)) =
                (track.path.at(seconds).unwrap(), car(number, seconds));
            let error = (place - truth).truncate().length();
            assert!(error < 0.5, "{error} m at {seconds} s");
            assert!((heading - true_heading).abs().to_degrees() < 5.0);
        }
        assert!(
            (track.dimensions[0] - 4.5).abs() < 0.6,
            "{:?}",
            track.dimensions
        );
    }
    let video = temp.path().join("tracks").join(OVERLAY_FILE);
    assert!(fs::metadata(video).unwrap().len() > 10_000);
    let page = fs::read_to_string(temp.path().join("tracks").join(PAGE_FILE)).unwrap();
    assert!(page.contains("polyline") && page.contains("data:image/jpeg"));
    assert_eq!(make_tracks(&request, &Silent).unwrap(), tracks);
}

/// Frames of a variable rate: what counts are their times, not their numbers.
#[test]
fn paths_are_those_of_frames_at_uneven_times() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("scene");
    let mut scene = write_scene(&folder);
    for (number, frame) in scene.frames.iter_mut().enumerate() {
        // Steps of 0.4, 1.6 and 1 s.
        frame.time_seconds += [0.0, -0.6, 0.0][number % 3];
    }
    store::write_record(&folder.join("scene.json"), &scene).unwrap();
    let tracks = make_tracks(&request(temp.path(), &boxes(&scene)), &Silent).unwrap();
    assert_eq!(tracks.tracks.len(), 2, "{:?}", tracks.warnings);
    for track in &tracks.tracks {
        for seconds in [5.5, 7.0, 8.4, 9.0] {
            let place = track.path.at(seconds).unwrap().0;
            let errors = (0..2).map(|number| (place - car(number, seconds).0).truncate().length());
            let error = errors.fold(f64::INFINITY, f64::min);
            assert!(error < 0.5, "{error} m at {seconds} s");
        }
    }
}

#[test]
fn what_is_wrong_with_boxes_is_said_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("scene");
    write_scene(&folder);
    let refusal = |boxes: &str| {
        let error = make_tracks(&request(temp.path(), boxes), &Silent).unwrap_err();
        assert_eq!(error.error_kind(), ErrorKind::User);
        let message = error.to_string();
        assert!(
            message.contains("boxes.txt") && !message.contains('\n'),
            "{message}"
        );
        message
    };
    for (text, reason) in [
        ("17,-1,1,1,9,9,1\n", "line 1: is of frame 17"),
        ("0,-1,1,1,9,9,1\n", "is of frame 0"),
        ("1,-1,1,NaN,9,9,1\n", "not finite"),
        ("1,-1,900,1,9,9,1\n", "outside of its image of 320x180"),
        ("1,-1,1,1,-9,9,1\n", "a box of -9x9"),
        (
            "1,4,1,1,9,9,1\n1,4,30,1,9,9,1\n",
            "line 2: frame 1 has two boxes of id 4",
        ),
        ("1,4,1,1\n", "expected frame,id"),
        ("a,4,1,1,9,9\n", "must be a number, got \"a\""),
    ] {
        let message = refusal(text);
        assert!(message.contains(reason), "{message}");
    }
    assert!(!temp.path().join("tracks/tracks.json").exists());
    // None, and five hundred: both are an answer.
    let none = make_tracks(&request(temp.path(), ""), &Silent).unwrap();
    assert!(none.tracks.is_empty() && none.detections.is_empty());
    let crowd: String = (0..500)
        .map(|n| format!("1,-1,{},{},5,5,1\n", (n % 60) * 5, n / 60 * 9))
        .collect();
    assert!(
        make_tracks(&request(temp.path(), &crowd), &Silent)
            .unwrap()
            .tracks
            .is_empty()
    );
}

/// A world of unknown scale is measured by the vehicles in it, which are 4.5 m long here.
#[test]
fn a_world_of_unknown_scale_takes_that_of_its_vehicles() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("scene");
    let scene = write_scene(&folder);
    let given = boxes(&scene);
    let arbitrary = Scene {
        scale: Scale::Arbitrary,
        ..scene
    };
    store::write_record(&folder.join("scene.json"), &arbitrary).unwrap();
    let tracks = make_tracks(&request(temp.path(), &given), &Silent).unwrap();
    assert!(
        (tracks.metres_per_unit - 1.0).abs() < 0.12,
        "{}",
        tracks.metres_per_unit
    );
    let stage = &tracks.stages[0];
    assert_eq!(
        (stage.stage.as_str(), stage.method.as_str()),
        ("scale", "vehicle-length")
    );
    assert!(stage.reason.contains("above it"), "{}", stage.reason);
    // Without vehicles the scale is unknown.
    let error = make_tracks(&request(temp.path(), ""), &Silent).unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    let message = error.to_string();
    assert!(
        message.contains("0 whole vehicles are too few") && message.contains("--altitude"),
        "{message}"
    );
}

/// A camera that only turns: no points, and the road is a plane across the view.
#[test]
fn a_hovering_camera_has_tracks_on_a_plane() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("scene");
    let mut scene = write_scene(&folder);
    for frame in &mut scene.frames {
        let turn = DMat3::from_rotation_z(0.01 * frame.time_seconds);
        let looks_down = turn * DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        frame.pose = Some(Pose::new(
            DQuat::from_mat3(&looks_down),
            dvec3(0.0, -2.0, 40.0),
        ));
    }
    let given = boxes(&scene);
    // As registration leaves it: no points, no scale, all in one place.
    for frame in &mut scene.frames {
        let rotation = frame.pose.unwrap().rotation().unwrap();
        frame.pose = Some(Pose::new(rotation, DVec3::ZERO));
    }
    scene.points = None;
    scene.scale = Scale::Arbitrary;
    scene.pose_source = PoseSource::Registered {
        reason: "turns".to_owned(),
        succeeded: true,
    };
    store::write_record(&folder.join("scene.json"), &scene).unwrap();
    let tracks = make_tracks(&request(temp.path(), &given), &Silent).unwrap();
    assert!(
        tracks.warnings[0].contains("hovers"),
        "{:?}",
        tracks.warnings
    );
    assert_eq!(tracks.tracks.len(), 2, "{:?}", tracks.warnings);
    // The plane is at a distance of 1 where the road is 39.25 m away in truth.
    assert!(
        (tracks.metres_per_unit / 39.25 - 1.0).abs() < 0.15,
        "{}",
        tracks.metres_per_unit
    );
    let speeds: Vec<f64> = tracks
        .tracks
        .iter()
        .map(|track| track.path.centre.velocity(7.0).length() * tracks.metres_per_unit)
        .collect();
    for speed in [2.5, 2.0] {
        let nearest = speeds.iter().map(|own| (own / speed - 1.0).abs());
        assert!(nearest.fold(f64::INFINITY, f64::min) < 0.15, "{speeds:?}");
    }
}

#[test]
fn coco_boxes_are_read_and_checked() {
    let temp = tempfile::tempdir().unwrap();
    write_scene(&temp.path().join("scene"));
    let make = |text: &str| {
        let mut request = request(temp.path(), "");
        let file = temp.path().join("boxes.json");
        fs::write(&file, text).unwrap();
        request.options.detections = Some(file);
        make_tracks(&request, &Silent)
    };
    let image =
        r#""images": [{"id": 3, "file_name": "x/000002.jpg", "width": 320, "height": 180}]"#;
    let sound = format!(
        r#"{{{image}, "annotations": [{{"image_id": 3, "bbox": [10, 20, 30, 12], "category_id": 1, "score": 0.8}}],
            "categories": [{{"id": 1, "name": "van"}}]}}"#
    );
    let tracks = make(&sound).unwrap();
    assert_eq!(
        (
            tracks.detections[0].frame,
            tracks.detections[0].class.as_str()
        ),
        (2, "van")
    );
    for (text, reason) in [
        (sound.replace("000002", "000099"), "is not a frame"),
        (sound.replace("320", "640"), "640x180"),
        (
            sound.replace("\"image_id\": 3", "\"image_id\": 4"),
            "not listed",
        ),
        ("{}".to_owned(), "a COCO JSON"),
    ] {
        let message = make(&text).unwrap_err().to_string();
        assert!(
            message.contains(reason) && !message.contains('\n'),
            "{message}"
        );
    }
}

#[test]
fn a_plan_says_what_tracks_would_and_writes_nothing() {
    let temp = tempfile::tempdir().unwrap();
    let scene = write_scene(&temp.path().join("scene"));
    let request = request(temp.path(), &boxes(&scene));
    let plan = plan_tracks(&request, &Silent).unwrap();
    assert!(!temp.path().join("tracks").exists());
    let tracks = make_tracks(&request, &Silent).unwrap();
    assert_eq!(
        (plan.moving, &plan.remarks),
        (tracks.tracks.len(), &tracks.warnings)
    );
    let decision = |name: &str| {
        let mut all = plan.decisions.iter();
        all.find(|one| one.component == name)
            .map(|one| (one.used, one.reason.clone()))
    };
    let said = |name: &str| decision(name).unwrap().1;
    assert_eq!(
        decision("dense-points"),
        Some((false, "points.ply".to_owned()))
    );
    assert_eq!(
        decision("metric-scale"),
        Some((false, "the scene is in metres".to_owned()))
    );
    assert!(said("detector: files").contains(&tracks.stages[0].reason));
    assert!(said("monocular-depth").starts_with("no depth prior; "));
    assert!(decision("trajectory-spline").is_some_and(|(used, _)| used));
    assert!(decision("appearance").is_some_and(|(used, _)| !used));
    assert_eq!(
        decision("object-graph"),
        Some((true, "2 vehicles move".to_owned()))
    );
}
