//! Interpolators: depth of the spherical sweep against known depth, views against ground truth.

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, dvec3};
use omnilife_reconstruct::methods::{
    self, METHODS, MethodKind,
    feed_forward::{groups, sweep::depths},
    group::{CameraPose, ContextView, Group, GroupOutput},
};
use omnilife_reconstruct::stereo::{SweepSettings, SweptDepth};
use omnilife_schemas::{
    RgbImage,
    camera::ErpCamera,
    records::{Protocol, ScoredViews, Split, SplitRule},
};
use painted_room::seen;

use crate::support::painted_room;

fn camera_pose(along: f64) -> CameraPose {
    let turn = DQuat::from_euler(glam::EulerRot::YXZ, 0.6 + 0.15 * along, 0.1 * along, -0.05);
    CameraPose {
        to_world: DMat3::from_quat(turn),
        centre: dvec3(0.25 * along - 0.1, 0.05 * along, 0.2 * along),
        time_seconds: along,
    }
}

/// Returns a group in the room, the distances seen from its first view, and the novel views.
fn room_group(width: u32) -> (Group, Vec<f64>, Vec<RgbImage>) {
    let camera = ErpCamera::new(width, width / 2);
    let camera_poses = [0.0, 1.0].map(camera_pose);
    let targets: Vec<CameraPose> = [0.25, 0.5, 0.75].map(camera_pose).to_vec();
    let (first, distances) = seen(camera, &camera_poses[0]);
    let second = seen(camera, &camera_poses[1]).0;
    let views = targets
        .iter()
        .map(|target| seen(camera, target).0)
        .collect();
    let mut images = [first, second].into_iter();
    let group = Group {
        camera,
        context: [0, 1].map(|index| ContextView {
            frame: 9 * index as u32,
            camera_pose: camera_poses[index],
            image: images.next().unwrap(),
        }),
        targets,
    };
    (group, distances, views)
}

/// Errors of swept depth against known distances.
struct DepthScore {
    /// Mean of `|found - known| / known`.
    relative: f64,
    /// Share within a factor of 1.25.
    within: f64,
    /// Share of counted pixels.
    share: f64,
}

/// Scores the pixels that `counts` accepts (pixel of the depth map, known distance), weighted by their solid
/// angle. Distances beyond `farthest` count as `farthest`.
fn depth_score(
    depth: &SweptDepth,
    baseline: f64,
    known: &[f64],
    farthest: f64,
    counts: impl Fn(usize, f64) -> bool,
) -> DepthScore {
    let (mut relative, mut within, mut total, mut all) = (0.0, 0.0, 0.0, 0.0);
    for (pixel, &known) in known.iter().enumerate() {
        let latitude = ((pixel / depth.width) as f64 + 0.5) / depth.height as f64;
        let weight = (latitude * std::f64::consts::PI).sin();
        all += weight;
        if !counts(pixel, known) {
            continue;
        }
        let inverse = f64::from(depth.inverse_distances[pixel]);
        let found = (baseline / inverse).min(farthest);
        let ratio = (found / known).max(known / found);
        relative += weight * (found - known).abs() / known;
        within += weight * f64::from(u8::from(ratio < 1.25));
        total += weight;
    }
    DepthScore {
        relative: relative / total,
        within: within / total,
        share: total / all,
    }
}

#[test]
fn the_sweep_finds_the_depth_of_a_room() {
    let (group, distances, _) = room_group(192);
    let settings = SweepSettings::DEFAULT;
    let (rig, [first, _]) = depths(&group, &settings).unwrap();
    let score = depth_score(&first, rig.baseline, &distances, 10.0, |pixel, _| {
        first.confidences[pixel] > 0.0
    });
    println!(
        "room: AbsRel {:.4}, within 1.25 {:.4}, over {:.3} of the sphere",
        score.relative, score.within, score.share
    );
    assert!(score.share > 0.8, "{}", score.share);
    assert!(score.relative < 0.05, "{}", score.relative);
    assert!(score.within > 0.97, "{}", score.within);
}

fn psnr(image: &RgbImage, truth: &RgbImage) -> f64 {
    let error: f64 = image
        .data
        .iter()
        .zip(&truth.data)
        .map(|(a, b)| f64::from(a - b).powi(2))
        .sum();
    -10.0 * (error / image.data.len() as f64).log10()
}

/// Checks that each interpolator is better than the next simpler one.
#[test]
fn knowing_more_gives_better_views() {
    let (group, _, truth) = room_group(192);
    let score = |id: &str| {
        let made = interpolated(id, &group);
        assert_eq!(made.images.len(), truth.len());
        let scores = made.images.iter().zip(&truth).map(|(a, b)| psnr(a, b));
        scores.sum::<f64>() / truth.len() as f64
    };
    let scores = [
        "sphere-sweep",
        "infinity-homography",
        "cross-fade",
        "nearest-input",
    ]
    .map(score);
    println!("{scores:.2?} dB");
    let [sweep, infinity, fade, nearest] = scores;
    assert!(sweep > infinity + 3.0, "{sweep} against {infinity}");
    assert!(infinity > fade, "{infinity} against {fade}");
    assert!(fade > nearest, "{fade} against {nearest}");
}

fn interpolated(method: &str, group: &Group) -> GroupOutput {
    let MethodKind::FeedForward { interpolate, .. } = methods::find(method).unwrap().kind else {
        panic!("{method} is trained");
    };
    interpolate(group).unwrap()
}

#[test]
fn views_are_the_same_every_time_and_for_every_number_of_threads() {
    let (group, _, _) = room_group(64);
    for method in METHODS {
        let MethodKind::FeedForward { interpolate, .. } = method.kind else {
            continue;
        };
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
            let pool = pool.build().unwrap();
            pool.install(|| interpolate(&group).unwrap().images)
        };
        assert!(run(1) == run(3), "{}", method.id);
    }
}

#[test]
fn a_camera_that_only_turns_has_no_depth_and_says_so() {
    let (mut group, _, _) = room_group(64);
    group.context[1].camera_pose.centre = group.context[0].camera_pose.centre;
    assert!(depths(&group, &SweepSettings::DEFAULT).is_none());
    let made = interpolated("sphere-sweep", &group);
    assert_eq!(made.images.len(), 3);
    assert!(made.warnings[0].contains("taken from one place"));
    let infinity = interpolated("infinity-homography", &group);
    assert_eq!(made.images, infinity.images);
}

fn split(input_views: &[u32], novel_views: &[u32]) -> Split {
    let protocol = Protocol::new("test", SplitRule::AllGiven, ScoredViews::Novel);
    Split::new("room", protocol, input_views.to_vec(), novel_views.to_vec())
}

#[test]
fn novel_views_are_predicted_from_the_input_views_around_them() {
    let found = groups(&split(&[1, 2, 3, 5, 6, 8], &[0, 4, 7, 9, 10])).unwrap();
    let found: Vec<([u32; 2], Vec<u32>)> = found
        .into_iter()
        .map(|group| (group.context, group.novel_views))
        .collect();
    assert_eq!(
        found,
        [
            ([1, 2], vec![0]),
            ([3, 5], vec![4]),
            ([6, 8], vec![7, 9, 10]),
        ]
    );
    assert!(groups(&split(&[3], &[4])).is_none());
}

/// Returns the folder of a scene rendered for this project beside the checkout, with depth. Without it: `None`,
/// and a line with the reason.
fn rendered(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../shared/data")
        .join(name);
    if folder.join("poses.json").is_file() {
        return Some(folder);
    }
    omnilife_schemas::testing::skip(format_args!("{} is not here", folder.display()));
    None
}

fn rendered_camera_pose(poses: &serde_json::Value, frame: usize) -> CameraPose {
    let entry = &poses["frames"][frame];
    let number = |row: usize, column: usize| entry["c2w"][row][column].as_f64().unwrap();
    let column = |column| dvec3(number(0, column), number(1, column), number(2, column));
    CameraPose {
        to_world: DMat3::from_cols(column(0), column(1), column(2)),
        centre: column(3),
        time_seconds: entry["time"].as_f64().unwrap(),
    }
}

#[test]
fn the_sweep_finds_the_depth_of_rendered_scenes() {
    for (name, largest_relative) in [("street", 0.1), ("hall", 0.05)] {
        let Some(folder) = rendered(name) else {
            continue;
        };
        let text = std::fs::read_to_string(folder.join("poses.json")).unwrap();
        let poses: serde_json::Value = serde_json::from_str(&text).unwrap();
        let frames = [20_usize, 29];
        let group = Group {
            camera: ErpCamera::new(1024, 512),
            context: frames.map(|frame| ContextView {
                frame: frame as u32,
                camera_pose: rendered_camera_pose(&poses, frame),
                image: RgbImage::read(&folder.join(format!("rgb/{frame:04}.jpg"))).unwrap(),
            }),
            targets: Vec::new(),
        };
        let (rig, [first, _]) = depths(&group, &SweepSettings::DEFAULT).unwrap();
        let file = |kind: &str| folder.join(format!("{kind}/{:04}.png", frames[0]));
        let known = image::open(file("depth")).unwrap().into_luma16();
        let moving = image::open(file("mask")).unwrap().into_luma8();
        // Every second pixel of every second row: the depth map has half the size.
        let at = |pixel: usize| {
            let (x, y) = (pixel % first.width, pixel / first.width);
            (2 * x as u32, 2 * y as u32)
        };
        let distances: Vec<f64> = (0..first.width * first.height)
            .map(|pixel| {
                let (x, y) = at(pixel);
                f64::from(known.get_pixel(x, y).0[0]) / 400.0
            })
            .collect();
        let far = 30.0 * rig.baseline;
        let score = |least_confidence: f32| {
            depth_score(&first, rig.baseline, &distances, far, |pixel, known| {
                let (x, y) = at(pixel);
                moving.get_pixel(x, y).0[0] == 0
                    && known > 0.0
                    && known < far
                    && first.confidences[pixel] > least_confidence
            })
        };
        for least in [-1.0, 0.0, 0.5] {
            let score = score(least);
            println!(
                "{name}, confidence above {least}: AbsRel {:.4}, within 1.25 {:.4}, over {:.3} of \
                 the sphere; baseline {:.3} m",
                score.relative, score.within, score.share, rig.baseline
            );
        }
        let good = score(0.0);
        assert!(
            good.relative < largest_relative,
            "{name}: {}",
            good.relative
        );
        assert!(good.share > 0.4, "{name}: {}", good.share);
    }
}
