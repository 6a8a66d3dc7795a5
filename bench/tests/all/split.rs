//! Splits: the rule, its refusals, the same bytes everywhere.

use std::fs;

use glam::{DQuat, DVec3};
use omnilife_bench::{BenchError, protocols, split, split_scene};
use omnilife_schemas::{
    Classified, ErrorKind, Pose,
    camera::{Camera, PinholeCamera},
    records::{PublishedSplit, Scene, Split, SplitRule},
    split_rules, store,
};
use proptest::prelude::*;
use scenes::scene;

use crate::scenes;

fn per_scene() -> omnilife_schemas::records::Protocol {
    protocols::protocol("per-scene").unwrap()
}

#[test]
fn every_fifth_frame_is_a_novel_view() {
    let split = split(&scene(12, &[]), &per_scene()).unwrap();
    assert_eq!(split.novel_views, [4, 9]);
    assert_eq!(split.input_views, [0, 1, 2, 3, 5, 6, 7, 8, 10, 11]);
    assert_eq!(split.protocol_hash, per_scene().hash());
    assert!(split.unposed.is_empty());
}

#[test]
fn unposed_frames_are_not_counted() {
    let split = split(&scene(12, &[0, 4, 7]), &per_scene()).unwrap();
    // Posed: 1 2 3 5 [6] 8 9 10 11.
    assert_eq!(split.novel_views, [6]);
    assert_eq!(split.unposed, [0, 4, 7]);
}

fn refusal(result: Result<Split, BenchError>) -> String {
    let error = result.unwrap_err();
    assert_eq!(error.error_kind(), ErrorKind::User);
    error.to_string()
}

#[test]
fn too_few_poses_are_refused() {
    assert_eq!(
        refusal(split(&scene(6, &[1, 3]), &per_scene())),
        "scene stripes/seq-000: protocol per-scene/2 cannot be followed: 4 of 6 frames have a \
         pose, at least 5 are needed"
    );
    refusal(split(&scene(0, &[]), &per_scene()));
    assert!(split(&scene(6, &[1]), &per_scene()).is_ok());
}

#[test]
fn unusable_scenes_are_refused() {
    let mut broken = scene(10, &[]);
    broken.frames[3].pose.as_mut().unwrap().rotation_wxyz = [0.0; 4];
    let message = refusal(split(&broken, &per_scene()));
    assert_eq!(
        message,
        "scene stripes/seq-000: frame 3 has an unusable pose"
    );

    let mut backwards = scene(10, &[]);
    backwards.frames[6].time_seconds = 0.05;
    let message = refusal(split(&backwards, &per_scene()));
    assert_eq!(
        message,
        "scene stripes/seq-000: frame 6 is earlier than frame 5"
    );

    let mut timeless = scene(10, &[]);
    timeless.frames[2].time_seconds = f64::NAN;
    refusal(split(&timeless, &per_scene()));
}

#[test]
fn impossible_rules_are_refused() {
    for (period, offset) in [(0, 0), (1, 0), (5, 5)] {
        let mut protocol = per_scene();
        protocol.split = SplitRule::EveryNth { period, offset };
        refusal(split(&scene(10, &[]), &protocol));
    }
}

fn sparse() -> omnilife_schemas::records::Protocol {
    protocols::protocol("sparse-interpolation").unwrap()
}

#[test]
fn groups_of_ten_give_their_ends_and_predict_the_rest() {
    let scene = scene(34, &[15]);
    let split = split(&scene, &sparse()).unwrap();
    assert_eq!(split.groups.len(), 2);
    assert_eq!(split.groups[0].context, [0, 9]);
    assert_eq!(split.groups[1].context, [20, 29]);
    assert_eq!(
        split.groups[1].novel_views,
        [21, 22, 23, 24, 25, 26, 27, 28]
    );
    assert_eq!(split.input_views, [0, 9, 20, 29]);
    let all: Vec<u32> = split
        .groups
        .iter()
        .flat_map(|group| group.novel_views.clone())
        .collect();
    assert_eq!(split.novel_views, all);
    let incomplete: Vec<_> = split
        .incomplete
        .iter()
        .map(|group| (group.frames[0], group.frames.len(), group.reason.as_str()))
        .collect();
    assert_eq!(
        incomplete,
        [(10, 10, "no pose for 15"), (30, 4, "4 of 10 frames")]
    );
    // Of these 14 frames 13 have a pose.
    let notes = split.notes(&scene);
    assert_eq!(notes.len(), 1);
    assert!(notes[0].contains("13 posed frames: 10 to 19"), "{notes:?}");
}

/// Cameras look 72 degrees apart: of five every fifth frame is one of them, of six it is not.
#[test]
fn a_camera_of_a_rig_that_is_never_given_is_reported() {
    let notes = |cameras: u32, turn_degrees: f64| {
        let mut rig = scene(60, &[]);
        rig.camera = Camera::Pinhole(PinholeCamera {
            width: 64,
            height: 32,
            fx: 32.0,
            fy: 32.0,
            cx: 32.0,
            cy: 16.0,
        });
        for (number, frame) in (0_u32..).zip(&mut rig.frames) {
            let turn = 72.0 * f64::from(number % cameras) + turn_degrees * f64::from(number);
            frame.pose = Some(Pose::new(
                DQuat::from_rotation_y(turn.to_radians()),
                DVec3::ZERO,
            ));
        }
        split(&rig, &per_scene()).unwrap().notes(&rig)
    };
    let found = notes(5, 0.0);
    assert_eq!(found.len(), 1);
    assert!(
        found[0].starts_with("12 of 12 novel views look more than 27 degrees"),
        "{found:?}"
    );
    assert!(notes(6, 0.0).is_empty());
    assert!(notes(1, 3.0).is_empty());
    // The car turns by 240 degrees, and other cameras look there then.
    assert!(notes(5, 4.0).len() < 2);
}

#[test]
fn a_scene_without_a_complete_group_is_refused() {
    let message = refusal(split(&scene(9, &[]), &sparse()));
    assert_eq!(
        message,
        "scene stripes/seq-000: protocol sparse-interpolation/1 cannot be followed: none of its 9 \
         frames belong to a complete group of 10"
    );
    let mut protocol = sparse();
    protocol.split = SplitRule::Groups { length: 2 };
    refusal(split(&scene(20, &[]), &protocol));
}

#[test]
fn ten_panoramas_are_given_evenly_and_all_others_predicted() {
    let protocol = protocols::protocol("sparse-panoramas").unwrap();
    let ten: Vec<u32> = (0..10).map(|number| 6 * number).collect();
    assert_eq!(split(&scene(60, &[]), &protocol).unwrap().input_views, ten);
    // Frame 0 has no pose: the first posed one is 1.
    let found = split(&scene(26, &[0]), &protocol).unwrap();
    assert_eq!(found.input_views, [1, 3, 6, 8, 11, 13, 16, 18, 21, 23]);
    assert_eq!(found.novel_views.len(), 15);
    let message = split(&scene(10, &[]), &protocol).unwrap_err().to_string();
    assert!(
        message.contains("10 of 10 frames have a pose; 10 are given"),
        "{message}"
    );
}

#[test]
fn every_posed_frame_is_given_where_fidelity_is_scored() {
    let protocol = protocols::protocol("input-view").unwrap();
    let split = split(&scene(6, &[2]), &protocol).unwrap();
    assert_eq!(split.input_views, [0, 1, 3, 4, 5]);
    assert!(split.novel_views.is_empty());
    refusal(omnilife_bench::split(&scene(2, &[0, 1]), &protocol));
}

fn published() -> omnilife_schemas::records::Protocol {
    protocols::protocol("published").unwrap()
}

/// A scene of eight frames with these lists.
fn with_lists(unposed: &[usize], input: &[u32], novel: &[u32]) -> Scene {
    let mut scene = scene(8, unposed);
    scene.published_split = Some(PublishedSplit {
        source: "somebody, train.txt and test.txt".to_owned(),
        input_views: input.to_vec(),
        novel_views: novel.to_vec(),
    });
    scene
}

#[test]
fn the_published_split_is_the_lists_of_the_scene() {
    let scene = with_lists(&[2, 5], &[1, 2, 3, 7], &[0, 5, 6]);
    let split = split(&scene, &published()).unwrap();
    assert_eq!(split.input_views, [1, 3, 7]);
    assert_eq!(split.novel_views, [0, 6]);
    assert_eq!(split.unposed, [2, 5]);
    assert!(split_rules::check(&split, &scene).is_ok());
    let other = with_lists(&[2, 5], &[1, 2, 3, 7], &[0, 4, 6]);
    assert!(split_rules::check(&split, &other).is_err());
    // Other protocols know nothing of it.
    let by_rule = omnilife_bench::split(&scene, &per_scene()).unwrap();
    assert_eq!(by_rule.novel_views, [6]);
}

#[test]
fn scenes_without_a_usable_published_split_are_refused() {
    let message = refusal(split(&scene(8, &[]), &published()));
    assert!(message.contains("no split was published"), "{message}");
    for (input, novel, what) in [
        (&[0, 8][..], &[1][..], "view 8 must be a frame"),
        (&[0, 1], &[1, 2], "frame 1 is"),
        (&[1, 0], &[2], "do not rise"),
        (&[0, 1], &[3, 3], "do not rise"),
        (&[], &[3], "input views"),
        (&[0], &[4], "novel views"),
    ] {
        let message = refusal(split(&with_lists(&[4], input, novel), &published()));
        assert!(message.contains(what), "{message}");
        assert!(message.contains("protocol published/1"), "{message}");
    }
}

#[test]
fn the_given_panoramas_can_be_named() {
    let mut protocol = protocols::protocol("sparse-panoramas").unwrap();
    let evenly = protocol.hash();
    let five = scene(5, &[3]);
    protocol.split = SplitRule::Given { frames: vec![0, 4] };
    let named = split(&five, &protocol).unwrap();
    assert_eq!(named.input_views, [0, 4]);
    assert_eq!(named.novel_views, [1, 2]);
    assert_eq!(named.unposed, [3]);
    assert_ne!(named.protocol_hash, evenly);
    assert!(split_rules::check(&named, &five).is_ok());
    for (frames, what) in [
        (vec![], "ascending"),
        (vec![2, 1], "ascending"),
        (vec![0, 3], "view 3"),
        (vec![0, 5], "view 5"),
        (vec![0, 1, 2, 4], "none is left"),
    ] {
        protocol.split = SplitRule::Given { frames };
        let message = refusal(split(&five, &protocol));
        assert!(message.contains(what), "{message}");
    }
}

#[test]
fn the_file_depends_on_scene_and_protocol_alone() {
    let folder = tempfile::tempdir().unwrap();
    let scene_file = folder.path().join("scene.json");
    store::write_record(&scene_file, &scene(10, &[2])).unwrap();
    let first = folder.path().join("a/split.json");
    let second = folder.path().join("b/deeper/split.json");
    let split = split_scene(&scene_file, "per-scene", &first).unwrap();
    split_scene(&scene_file, "per-scene", &second).unwrap();
    let bytes = fs::read(&first).unwrap();
    assert_eq!(bytes, fs::read(&second).unwrap());
    assert_eq!(store::read_record::<Split>(&first).unwrap(), split);
    insta::assert_snapshot!(String::from_utf8(bytes).unwrap());
    let scene_file = folder.path().join("longer.json");
    store::write_record(&scene_file, &scene(22, &[])).unwrap();
    split_scene(&scene_file, "sparse-interpolation", &first).unwrap();
    insta::assert_snapshot!(fs::read_to_string(&first).unwrap());
}

#[test]
fn unknown_protocols_and_scenes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene_file = folder.path().join("scene.json");
    let out = folder.path().join("split.json");
    refusal(split_scene(&scene_file, "per-scene", &out));
    store::write_record(&scene_file, &scene(10, &[])).unwrap();
    refusal(split_scene(&scene_file, "per-sequence", &out));
    assert!(!out.exists());
}

proptest! {
    #[test]
    fn groups_hold_every_frame_once(posed in prop::collection::vec(any::<bool>(), 0..120), length in 3_u32..12) {
        let unposed: Vec<usize> = (0..posed.len()).filter(|&frame| !posed[frame]).collect();
        let mut protocol = sparse();
        protocol.split = SplitRule::Groups { length };
        if let Ok(split) = split(&scene(posed.len(), &unposed), &protocol) {
            prop_assert_eq!(split.novel_views.len(), split.groups.len() * (length as usize - 2));
            prop_assert!(split.novel_views.iter().all(|&frame| posed[frame as usize]));
            let left_out = split.incomplete.iter().flat_map(|group| group.frames.clone());
            let mut all = [split.input_views, split.novel_views].concat();
            all.extend(left_out);
            all.sort_unstable();
            prop_assert!(all.into_iter().eq(0..posed.len() as u32));
        }
    }

    #[test]
    fn posed_frames_are_shared_out(posed in prop::collection::vec(any::<bool>(), 5..200)) {
        let unposed: Vec<usize> = (0..posed.len()).filter(|&frame| !posed[frame]).collect();
        let scene = scene(posed.len(), &unposed);
        let count = posed.len() - unposed.len();
        match split(&scene, &per_scene()) {
            Err(_) => prop_assert!(count < 5),
            Ok(split) => {
                prop_assert_eq!(split.novel_views.len(), count / 5);
                let mut all = [split.input_views, split.novel_views, split.unposed].concat();
                all.sort_unstable();
                prop_assert!(all.into_iter().eq(0..posed.len() as u32));
            }
        }
    }
}
