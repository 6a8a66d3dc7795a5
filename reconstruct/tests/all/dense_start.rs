//! Gaussians that start as oriented samples of distances: their images before the first step, with points, without
//! points and with files of distances, and density control that waits.

use std::path::Path;

use glam::Vec3;
use omnilife_engine::{
    schedule::Position, step::settings::TrainSettings, training_view::TrainingView,
};
use omnilife_reconstruct::{
    components::dense_start,
    methods::{self, Prepared},
    request::{BackendChoice, MethodRequest},
    scene::{TrainingScene, depth::PriorFile},
};
use omnilife_schemas::{
    npy,
    records::{ComponentDecision, DepthPrior, DistanceConvention},
};

use crate::{
    support::painted_room::seen,
    swept_points::{CAMERA, camera_pose, measured, walk},
};

const ITERATIONS: u64 = 40;

/// Returns the start of `odgs` on a scene, with or without a dense start.
fn prepared(scene: &TrainingScene, with: bool) -> Prepared<'_> {
    let with = with.then(|| dense_start::ID.to_owned());
    let request = MethodRequest {
        with: with.into_iter().collect(),
        ..MethodRequest::new(ITERATIONS, 3)
    };
    let odgs = methods::find("odgs").unwrap();
    odgs.prepare(scene, &request, BackendChoice::Cpu).unwrap()
}

fn decision<'a>(prepared: &'a Prepared<'_>) -> &'a ComponentDecision {
    let mut plan = prepared.findings.plan.iter();
    plan.find(|part| part.component == dense_start::ID).unwrap()
}

/// Returns the mean PSNR of novel views before the first step, dB.
fn start_psnr(prepared: &mut Prepared<'_>, scene: &TrainingScene) -> f64 {
    let scores = scene.novel_views.iter().map(|view| {
        let image = prepared.learner.image(&view.view).unwrap();
        let target = view.pixels.iter().map(|&byte| f64::from(byte) / 255.0);
        let pairs = image.data.iter().zip(target);
        let squares: f64 = pairs.map(|(&a, b)| (f64::from(a) - b).powi(2)).sum();
        -10.0 * (squares / image.data.len() as f64).log10()
    });
    scores.sum::<f64>() / scene.novel_views.len() as f64
}

fn with_points() -> TrainingScene {
    TrainingScene {
        points: measured(),
        ..walk()
    }
}

/// Returns the path with files of exact distances for every other input view.
fn with_files(folder: &Path) -> TrainingScene {
    let mut scene = walk();
    let file = |(number, view): (usize, &TrainingView)| {
        if number % 2 == 1 {
            return None;
        }
        let (_, distances) = seen(CAMERA, &camera_pose(view.frame));
        let metres: Vec<f32> = distances.iter().map(|&distance| distance as f32).collect();
        let path = folder.join(format!("{number}.npy"));
        let shape = [CAMERA.height as usize, CAMERA.width as usize];
        npy::write_f32(&path, &shape, &metres).unwrap();
        Some(PriorFile {
            path,
            prior: DepthPrior {
                file: format!("{number}.npy"),
                unit: 1.0,
                width: CAMERA.width,
                height: CAMERA.height,
                convention: DistanceConvention::Ray,
                source: "closed form".to_owned(),
            },
        })
    };
    scene.depth_priors = scene.input_views.iter().enumerate().map(file).collect();
    scene
}

#[test]
fn it_starts_nearer_to_the_images_than_points_do() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = [with_points(), walk(), with_files(folder.path())];
    let from_points = start_psnr(&mut prepared(&scenes[0], false), &scenes[0]);
    for (scene, origin) in scenes.iter().zip(["sweep", "sweep", "files (closed form)"]) {
        let mut dense = prepared(scene, true);
        let decision = decision(&dense).clone();
        assert!(decision.used, "{decision:?}");
        assert!(decision.reason.contains(origin), "{decision:?}");
        let told = dense.findings.warnings.iter();
        let told = told.filter(|line| line.starts_with("dense-start: "));
        assert_eq!(told.count(), 1);
        let found = start_psnr(&mut dense, scene);
        assert!(
            found > from_points + 3.0,
            "{found:.2} dB, {from_points:.2} from points: {decision:?}"
        );
    }
}

#[test]
fn density_control_waits_for_half_of_the_schedule() {
    let scene = with_points();
    let Prepared {
        mut learner,
        configuration,
        ..
    } = prepared(&scene, true);
    let settings: TrainSettings = serde_json::from_value(configuration).unwrap();
    let densify = &settings.densify;
    let half = ITERATIONS / 2;
    assert_eq!(
        [densify.begin_iteration, densify.end_iteration],
        [half, 3 * ITERATIONS / 4]
    );
    let first = learner.size().primitives;
    assert!(first <= densify.maximum_gaussians && first > 2_000);
    for iteration in 1..half {
        let at = Position::new(ITERATIONS, None, iteration, 0.0);
        let view = iteration as usize % scene.input_views.len();
        learner.step(view, &at).unwrap();
        learner.maintain(&at).unwrap();
        assert_eq!(learner.size().primitives, first);
    }
}

#[test]
fn points_stay_where_nothing_is_known() {
    let mut scene = with_points();
    // In the middle of the room, where every view sees past it.
    scene.points.positions.push([0.1, 0.0, 0.9]);
    scene.points.colours.push([0; 3]);
    let mut dense = prepared(&scene, true);
    let model = dense.learner.gaussians().unwrap().unwrap();
    let positions = model.parts[0].table.arrays[0].values.as_chunks::<3>().0;
    let is_at = |place: [f32; 3]| {
        let mut all = positions.iter();
        all.any(|&position| Vec3::from_array(position).distance(Vec3::from_array(place)) < 1e-4)
    };
    assert!(is_at([0.1, 0.0, 0.9]));
    // Most of the measured points are where samples are.
    let measured = measured().positions;
    let kept = measured.iter().filter(|&&position| is_at(position)).count();
    assert!(kept * 2 < measured.len(), "{kept} of {}", measured.len());
}

#[test]
fn without_parallax_gaussians_start_at_points_and_a_line_says_so() {
    let mut scene = with_points();
    for view in &mut scene.input_views {
        view.view.centre = Vec3::ZERO;
    }
    let dense = prepared(&scene, true);
    let found = decision(&dense);
    assert!(!found.used, "{found:?}");
    let mut warnings = dense.findings.warnings.iter();
    assert!(warnings.any(|line| line.starts_with("dense-start was asked for and is not used")));
    let plain = prepared(&scene, false);
    assert_eq!(dense.learner.size(), plain.learner.size());
}
