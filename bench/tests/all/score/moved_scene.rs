//! A scene in the coordinates of UTM: its splits and scores are those that it has near the origin.

use std::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec3, dvec3};
use omnilife_bench::PROTOCOLS;
use omnilife_schemas::{Pose, frame_scores::FrameRow, records::PublishedSplit};

use super::*;

/// Turn about the vertical, radians, and offset of a world.
const NEAR: (f64, DVec3) = (0.0, DVec3::ZERO);
const FAR: (f64, DVec3) = (FRAC_PI_2, dvec3(5e5, 0.0, 5e6));
/// The vertical of the tracks in these tests.
const UP: DVec3 = DVec3::NEG_Y;

/// Twenty frames, one of which has no pose.
fn moved_scene((turn, offset): (f64, DVec3)) -> Scene {
    let turn = DQuat::from_axis_angle(UP, turn);
    let mut scene = scene(20, &[13]);
    for pose in scene
        .frames
        .iter_mut()
        .filter_map(|frame| frame.pose.as_mut())
    {
        let rotation = turn * pose.rotation().unwrap();
        *pose = Pose::new(rotation, turn * pose.centre() + offset);
    }
    scene
}

#[test]
fn every_protocol_splits_it_alike() {
    let published = |mut scene: Scene| {
        scene.published_split = Some(PublishedSplit {
            source: "lists".to_owned(),
            input_views: vec![0, 2, 5],
            novel_views: vec![1, 3],
        });
        scene
    };
    let [near, far] = [NEAR, FAR].map(|world| published(moved_scene(world)));
    for entry in PROTOCOLS {
        let [near, far] =
            [&near, &far].map(|scene| omnilife_bench::split(scene, &(entry.protocol)()).unwrap());
        assert_eq!(near, far, "{}", entry.id);
    }
}

/// Scores of the views, and whether their scene has regions by tracks.
fn scored(world: (f64, DVec3)) -> (Vec<FrameRow>, bool) {
    let bench = Bench::of(&moved_scene(world));
    with_metrics(&bench, &["psnr", "psnr-dynamic", "psnr-static"]);
    let (turn_radians, offset) = world;
    let turn = DQuat::from_axis_angle(UP, turn_radians);
    let mut tracks = regions::tracks(4.0);
    let path = &mut tracks.tracks[0].path;
    for coefficient in &mut path.centre.coefficients {
        // Past the cameras, so that the box does not stay where it is seen.
        let place = DVec3::from_array(*coefficient) * dvec3(0.7, 1.0, 1.0);
        *coefficient = (turn * place + offset).to_array();
    }
    path.headings[0] += turn_radians;
    store::write_record(&bench.at("tracks.json"), &tracks).unwrap();
    for (kind, frames) in [
        ("input", &bench.split.input_views),
        ("novel", &bench.split.novel_views),
    ] {
        for &frame in frames {
            // Wrong by another amount in every pixel: scores tell regions apart that differ by one.
            let mut wrong = image(frame as usize, 0);
            for (index, value) in wrong.data.iter_mut().enumerate() {
                *value += (index * index % 97) as f32 / 1000.0;
            }
            let file = bench.at(kind).join(format!("{frame:06}.png"));
            wrong.write_png(&file).unwrap();
        }
    }
    let result = bench.score().unwrap();
    let rows = FrameScores::read(&bench.at("out/frames.csv")).unwrap().rows;
    (rows, result.regions.is_some())
}

#[test]
fn scores_by_the_boxes_of_tracks_are_alike() {
    let [(near, has_regions), (far, _)] = [NEAR, FAR].map(scored);
    assert!(has_regions);
    assert_eq!(near.len(), 19);
    let dynamic = near.iter().filter(|row| row.scores[1].is_some());
    assert!(dynamic.count() > 5);
    for (near, far) in near.iter().zip(&far) {
        assert_eq!(near.scores, far.scores, "frame {}", near.frame);
    }
}
