//! Tracks in formats of traffic tools: boxes return, speeds and headings are those of the paths, places those of the
//! map.

use std::collections::BTreeSet;

use omnilife_schemas::{
    ground_plane::Plane,
    records::{Capture, GeoPoint, Georeference, Track, Tracks},
    testing::Notes,
    trajectory::{BSpline, ObjectPath},
};
use omnilife_tracks::{
    detectors::DetectorInput,
    exports::{TRACK_FORMATS, TrackExportRequest, export_tracks},
    georeference::geodesy::utm_in,
};
use serde_json::Value;

use super::*;

/// UTM zone, easting, northing and height of the world's origin.
pub(super) const ZONE: u8 = 32;
pub(super) const EAST: f64 = 691_600.0;
pub(super) const NORTH: f64 = 5_334_700.0;
const HEIGHT: f64 = 510.0;

pub(super) fn export(
    folder: &Path,
    formats: &[&str],
    telemetry: Option<&Path>,
) -> Result<Option<Georeference>, String> {
    let request = TrackExportRequest {
        scene_folder: folder.join("scene"),
        folder: folder.join("tracks"),
        formats: TRACK_FORMATS
            .iter()
            .filter(|format| formats.contains(&format.id))
            .collect(),
        telemetry: telemetry.map(Path::to_owned),
    };
    let exported = export_tracks(&request, &Silent);
    exported
        .map(|(_, place)| place)
        .map_err(|error| error.to_string())
}

pub(super) fn read(folder: &Path, file: &str) -> String {
    fs::read_to_string(folder.join("tracks").join(file)).unwrap()
}

/// Writes tracks of one vehicle from a place to another over 15 s.
pub(super) fn write_track(folder: &Path, [from, to]: [DVec3; 2], metres_per_unit: f64) {
    let heading = (to.y - from.y).atan2(to.x - from.x);
    let track = Track {
        id: 7,
        class: "vehicle".to_owned(),
        dimensions: [4.5, 1.8, 1.5],
        path: ObjectPath {
            centre: BSpline {
                degree: 1,
                knots: BSpline::uniform_knots(1, 2, 0.0, 15.0),
                coefficients: vec![from.to_array(), to.to_array()],
            },
            heading_seconds: vec![0.0],
            headings: vec![heading],
        },
        detections: 16,
        displacement: from.distance(to),
    };
    let tracks = Tracks {
        scene: "flight".to_owned(),
        frames: (0..FRAMES as u32).collect(),
        image_size: [320, 180],
        up: [0.0, 0.0, 1.0],
        metres_per_unit,
        stages: Vec::new(),
        detections: Vec::new(),
        tracks: vec![track],
        warnings: Vec::new(),
    };
    fs::create_dir_all(folder.join("tracks")).unwrap();
    store::write_record(&folder.join("tracks/tracks.json"), &tracks).unwrap();
}

/// Returns the point of UTM coordinates, by Newton steps of the projection.
fn from_utm(place: DVec3) -> GeoPoint {
    let mut point = GeoPoint {
        latitude_degrees: 48.1,
        longitude_degrees: 11.5,
        altitude_metres: place.z,
    };
    for _ in 0..40 {
        let found = utm_in(&point, ZONE);
        let cos = point.latitude_degrees.to_radians().cos();
        point.latitude_degrees += (place.y - found.northing) / 111_200.0;
        point.longitude_degrees += (place.x - found.easting) / (111_320.0 * cos);
    }
    point
}

fn recorded(centre: DVec3) -> GeoPoint {
    from_utm(centre + dvec3(EAST, NORTH, HEIGHT))
}

/// Puts the cameras on a circle, 60 m in radius.
pub(super) fn write_circling_scene(folder: &Path) -> Scene {
    let mut scene = write_scene(&folder.join("scene"));
    for (number, frame) in scene.frames.iter_mut().enumerate() {
        let (sin, cos) = (0.4 * number as f64).sin_cos();
        let pose = frame.pose.as_mut().unwrap();
        pose.centre = [60.0 * cos, 60.0 * sin, 40.0];
    }
    store::write_record(&folder.join("scene/scene.json"), &scene).unwrap();
    scene
}

/// Writes the recorded positions of a scene's cameras as subtitles; those of frame 3 are a mistake if asked for.
pub(super) fn write_telemetry(
    folder: &Path,
    scene: &Scene,
    has_mistake: bool,
) -> std::path::PathBuf {
    let mut text = String::new();
    for (number, frame) in scene.frames.iter().enumerate() {
        let mut centre = frame.pose.unwrap().centre();
        if has_mistake && number == 3 {
            centre += dvec3(200.0, 0.0, 0.0);
        }
        let GeoPoint {
            latitude_degrees: latitude,
            longitude_degrees: longitude,
            altitude_metres: altitude,
        } = recorded(centre);
        text += &format!(
            "{}\n00:00:{number:02},000 --> 00:00:{number:02},500\n[latitude: {latitude:.12}] [longitude: \
             {longitude:.12}] [rel_alt: {:.3} abs_alt: {altitude:.3}]\n\n",
            number + 1,
            altitude - HEIGHT
        );
    }
    let file = folder.join("DJI_0001.SRT");
    fs::write(&file, text).unwrap();
    file
}

#[test]
fn formats_have_an_id_and_a_file_each() {
    let count = TRACK_FORMATS.len();
    let ids: BTreeSet<&str> = TRACK_FORMATS.iter().map(|format| format.id).collect();
    let files: BTreeSet<&str> = TRACK_FORMATS.iter().map(|format| format.file).collect();
    assert_eq!((ids.len(), files.len()), (count, count));
    assert!(TRACK_FORMATS.iter().all(|format| format.about.len() > 20));
}

#[test]
fn boxes_return_from_mot_text() {
    let temp = tempfile::tempdir().unwrap();
    let scene = write_scene(&temp.path().join("scene"));
    let tracks = make_tracks(&request(temp.path(), &boxes(&scene)), &Silent).unwrap();
    export(temp.path(), &["mot"], None).unwrap();
    let file = temp.path().join("tracks/tracks.mot.txt");
    let frames: Vec<u32> = (0..FRAMES as u32).collect();
    let input = DetectorInput {
        folder: &temp.path().join("scene"),
        scene: &scene,
        views: &PosedView::of_scene(&scene, &frames),
        points: &[],
        ground: Plane {
            normal: DVec3::Z,
            offset: 0.0,
        },
        metres_per_unit: 1.0,
        file: Some(&file),
        program: None,
        out: temp.path(),
    };
    let notes = Notes::default();
    let returned = (files::DETECTOR.detect)(&input, &notes).unwrap().boxes;
    assert_eq!(notes.take(), [""; 0]);
    let mut of_tracks: Vec<_> = (tracks.detections.iter())
        .filter_map(|one| Some((one.frame, one.track?, one.box_pixels, one.confidence)))
        .collect();
    of_tracks.sort_by_key(|&(frame, track, ..)| (frame, track));
    assert!(of_tracks.len() > 20, "{}", of_tracks.len());
    let of_tracks = of_tracks
        .iter()
        .map(|&(frame, _, sides, confidence)| (frame, sides, confidence));
    let returned = returned
        .iter()
        .map(|one| (one.frame, one.box_pixels, one.confidence));
    assert_eq!(returned.collect::<Vec<_>>(), of_tracks.collect::<Vec<_>>());
    // A file of a Windows program with percents and margins of a classifier.
    let text = "\u{feff}1,-1,10,10,20,20,87.5\r\n1,-1,40,10,20,20,-0.3\r\n1,-1,70,10,20,20,-1\r\n";
    fs::write(&file, text).unwrap();
    let boxes = (files::DETECTOR.detect)(&input, &notes).unwrap().boxes;
    assert!(boxes.iter().all(|one| (one.confidence - 1.0).abs() < 1e-12));
    let lines = notes.take();
    assert_eq!((boxes.len(), lines.len()), (3, 1));
    assert!(lines[0].contains("2 of 3 confidences"), "{}", lines[0]);
}

#[test]
fn speeds_and_headings_are_those_of_the_path() {
    let temp = tempfile::tempdir().unwrap();
    write_scene(&temp.path().join("scene"));
    // 2.5 units, of 2 m each, in a second, 53.13 degrees from x.
    write_track(temp.path(), [DVec3::ZERO, dvec3(22.5, 30.0, 0.0)], 2.0);
    export(temp.path(), &["speeds"], None).unwrap();
    let text = read(temp.path(), "tracks.csv");
    let mut lines = text.lines();
    assert_eq!(
        lines.next(),
        Some(
            "track,class,frame,time_seconds,x_metres,y_metres,z_metres,speed_metres_per_second,heading_degrees_from_x,evidence"
        )
    );
    let rows: Vec<&str> = lines.collect();
    assert_eq!(rows.len(), FRAMES);
    assert_eq!(
        rows[2],
        "7,vehicle,2,2,6.000,8.000,0.000,5.000,53.13,extrapolated"
    );
    let message = export(temp.path(), &["geojson"], None).unwrap_err();
    assert!(
        message.contains("--telemetry") && !message.contains('\n'),
        "{message}"
    );
}

#[test]
fn places_are_those_of_the_map_to_a_centimetre() {
    let temp = tempfile::tempdir().unwrap();
    let mut scene = write_circling_scene(temp.path());
    let ends = [dvec3(-30.0, 20.0, 0.75), dvec3(45.0, 20.0, 0.75)];
    write_track(temp.path(), ends, 1.0);
    let telemetry = write_telemetry(temp.path(), &scene, true);
    let check = |place: &Georeference, used: u32| {
        assert_eq!(place.residuals.used, used);
        assert!(
            place.residuals.largest_metres < 0.01,
            "{:?}",
            place.residuals
        );
        assert!((place.metres_per_unit - 1.0).abs() < 1e-3);
        let json: Value = serde_json::from_str(&read(temp.path(), "tracks.geojson")).unwrap();
        let feature = &json["features"][0];
        let line = feature["geometry"]["coordinates"].as_array().unwrap();
        assert_eq!(line.len(), FRAMES);
        for (number, position) in line.iter().enumerate() {
            let degrees = |at: usize| position[at].as_f64().unwrap();
            let point = GeoPoint {
                latitude_degrees: degrees(1),
                longitude_degrees: degrees(0),
                altitude_metres: 0.0,
            };
            let found = utm_in(&point, ZONE);
            let truth = ends[0].lerp(ends[1], number as f64 / 15.0);
            let error = (found.easting - EAST - truth.x).hypot(found.northing - NORTH - truth.y);
            assert!(error < 0.01, "{error} m");
        }
        let properties = &feature["properties"];
        let first = |name: &str| properties[name][0].as_f64().unwrap();
        assert!((first("speeds_metres_per_second") - 5.0).abs() < 0.01);
        // East on the map, whose north is 1.92 degrees east of the meridian's here.
        assert!((first("headings_degrees") - 91.92).abs() < 0.1);
    };
    let place = export(temp.path(), &["mot", "speeds", "geojson"], Some(&telemetry))
        .unwrap()
        .unwrap();
    assert_eq!(
        (place.source.as_str(), place.heights.as_str()),
        ("DJI_0001.SRT", "abs_alt")
    );
    let written: Georeference =
        store::read_record(&temp.path().join("tracks/georeference.json")).unwrap();
    assert_eq!(written, place);
    assert_eq!(
        (place.residuals.rejected, place.fixes[3].is_used),
        (1, false)
    );
    assert_eq!((place.utm.zone, place.utm.is_north), (ZONE, true));
    check(&place, FRAMES as u32 - 1);
    let row = read(temp.path(), "tracks.csv");
    assert!(row.lines().nth(1).unwrap().contains(",5.0"), "{row}");
    // Stills say the same in EXIF.
    for frame in &mut scene.frames {
        let point = recorded(frame.pose.unwrap().centre());
        frame.capture = Some(Capture {
            latitude_degrees: Some(point.latitude_degrees),
            longitude_degrees: Some(point.longitude_degrees),
            altitude_metres: Some(point.altitude_metres),
            ..Capture::default()
        });
    }
    store::write_record(&temp.path().join("scene/scene.json"), &scene).unwrap();
    let place = export(temp.path(), &["geojson"], None).unwrap().unwrap();
    assert_eq!(place.source, "exif");
    check(&place, FRAMES as u32);
}

#[test]
fn exports_stay_beside_later_ones_of_the_same_tracks_alone() {
    let temp = tempfile::tempdir().unwrap();
    write_scene(&temp.path().join("scene"));
    write_track(temp.path(), [DVec3::ZERO, DVec3::X], 1.0);
    let is_there = |file: &str| temp.path().join("tracks").join(file).exists();
    for format in ["mot", "speeds", "mot", "speeds"] {
        export(temp.path(), &[format], None).unwrap();
    }
    assert!(is_there("tracks.mot.txt") && is_there("tracks.csv"));
    write_track(temp.path(), [DVec3::ZERO, DVec3::Y], 1.0);
    export(temp.path(), &["mot"], None).unwrap();
    assert!(is_there("tracks.mot.txt") && !is_there("tracks.csv"));
    // Changed by hand it is the user's.
    let own = temp.path().join("tracks/tracks.mot.txt");
    fs::write(&own, "mine").unwrap();
    export(temp.path(), &["speeds"], None).unwrap();
    assert_eq!(read(temp.path(), "tracks.mot.txt"), "mine");
}

#[test]
fn a_flight_along_a_line_is_refused() {
    let temp = tempfile::tempdir().unwrap();
    let scene = write_scene(&temp.path().join("scene"));
    write_track(temp.path(), [DVec3::ZERO, DVec3::X], 1.0);
    let telemetry = write_telemetry(temp.path(), &scene, false);
    let message = export(temp.path(), &["geojson"], Some(&telemetry)).unwrap_err();
    assert!(
        message.contains("is a line") && !message.contains('\n'),
        "{message}"
    );
    assert!(!temp.path().join("tracks/tracks.geojson").exists());
}
