//! Inaccurate poses: detected, refined, and left alone where they are exact.

use glam::{Vec3, vec3};
use omnilife_engine::{
    camera::{View, pose::PoseCorrection},
    model::{Model, pose_corrections::CAMERA_CENTRES},
    training_view::TrainingView,
};
use omnilife_reconstruct::{
    evidence::pilot::PilotFit,
    methods::MethodOutcome,
    options::Options,
    request::{MethodRequest, PlanChoice},
    scene::TrainingScene,
};

use crate::support::{
    novel_views::novel_psnr,
    trained::{request, settings, train, whole_and_resumed},
};

use crate::support::{balls, moving_ball};

/// Returns the error of a frame's pose: mostly a drift of two degrees.
fn error(frame: u32) -> PoseCorrection {
    let along = 0.45 * frame as f32;
    let jitter = 0.004 * vec3((frame % 3) as f32 - 1.0, (frame % 2) as f32 - 0.5, 0.0);
    PoseCorrection {
        rotation: 0.03 * vec3(along.sin(), along.cos(), -(0.8 * along).sin()) + jitter,
        centre: 0.05 * vec3(along.cos(), 0.0, along.sin()),
    }
}

fn disturbed(mut scene: TrainingScene) -> TrainingScene {
    for view in scene.input_views.iter_mut().chain(&mut scene.novel_views) {
        view.view = error(view.frame).apply(&view.view);
    }
    scene
}

/// Returns the root mean square error of the directions to points at a distance of 5 in these views, beyond the
/// part that all views share: radians.
fn remaining(views: &[TrainingView], exact: &[TrainingView], model: &Model) -> f32 {
    let errors: Vec<[Vec3; 2]> = views
        .iter()
        .zip(exact)
        .map(|(view, exact)| {
            let found = model.corrected(&view.view);
            let turn = found.rotation.transpose() * exact.view.rotation;
            let turn = glam::Quat::from_mat3(&turn).to_scaled_axis();
            [turn, (found.centre - exact.view.centre) / 5.0]
        })
        .collect();
    let count = errors.len() as f32;
    let squares = [0, 1].map(|kind| {
        let mean = errors.iter().map(|error| error[kind]).sum::<Vec3>() / count;
        let squares = errors
            .iter()
            .map(|error| (error[kind] - mean).length_squared());
        squares.sum::<f32>() / count
    });
    squares.iter().sum::<f32>().sqrt()
}

/// Returns the decision on refining poses, with its reason.
fn decision(outcome: &MethodOutcome<'_>) -> (bool, String) {
    let decision = outcome
        .findings
        .plan
        .iter()
        .find(|part| part.component == "pose-refinement");
    let decision = decision.unwrap();
    (decision.used, decision.reason.clone())
}

fn refined<'a>(scene: &'a TrainingScene, iterations: u64, without: &[&str]) -> MethodOutcome<'a> {
    let request = MethodRequest {
        without: without.iter().map(|&name| name.to_owned()).collect(),
        options: Options::at_most(3_000),
        ..request(iterations)
    };
    train(scene, "omni4dgs-plus", &request)
}

/// Asserts that most of the error is corrected, in novel views too, and that the scene keeps its place.
fn assert_refined(outcome: &mut MethodOutcome<'_>, scene: &TrainingScene, exact: &TrainingScene) {
    assert!(decision(outcome).0, "{}", decision(outcome).1);
    let model = outcome.learner.gaussians().unwrap().unwrap();
    let none = Model {
        poses: None,
        ..model.clone()
    };
    for (views, exact, most) in [
        (&scene.input_views, &exact.input_views, 0.3),
        (&scene.novel_views, &exact.novel_views, 0.5),
    ] {
        let [left, before] = [model, &none].map(|model| remaining(views, exact, model));
        assert!(left < most * before, "{left} of {before}");
    }
    let poses = model.poses.as_ref().unwrap();
    for array in &poses.table.arrays {
        let rows = array.values.as_chunks::<3>().0;
        let sum: Vec3 = rows.iter().map(|&row| Vec3::from_array(row)).sum();
        assert!(sum.length() < 1e-4, "{}", array.name);
    }
}

#[test]
fn poses_that_are_off_are_refined() {
    let exact = moving_ball::scene();
    let scene = disturbed(exact.clone());
    let mut with = refined(&scene, 300, &[]);
    let mut without = refined(&scene, 300, &["pose-refinement"]);
    assert!(settings(&without).pose_refinement.is_none());
    let psnr = [&mut with, &mut without].map(|outcome| novel_psnr(outcome, &scene));
    assert!(psnr[0] > psnr[1] + 1.5, "{psnr:?}");
    assert_refined(&mut with, &scene, &exact);

    // An input view is rendered with its own correction, any other camera with that of its moment.
    let model = with.learner.gaussians().unwrap().unwrap();
    let poses = model.poses.as_ref().unwrap();
    let view = &scene.input_views[3].view;
    assert_eq!(model.corrected(view), poses.of_view(3).apply(view));
    let elsewhere = View {
        centre: Vec3::ONE,
        ..*view
    };
    let corrected = model.corrected(&elsewhere);
    assert_eq!(corrected.centre, Vec3::ONE + poses.of_view(3).centre);
}

#[test]
fn poses_are_refined_where_nothing_moves_too() {
    let exact = balls::scene();
    let scene = disturbed(exact.clone());
    let mut outcome = refined(&scene, 150, &[]);
    assert!(
        settings(&outcome).dynamics.is_none(),
        "{:?}",
        outcome.findings.plan
    );
    assert_refined(&mut outcome, &scene, &exact);
}

#[test]
fn what_is_seen_beside_its_place_tells_how_poses_are_off() {
    // A jitter: an error along the camera's path cannot be distinguished from a bent scene.
    let error = |frame: u32| {
        let [one, two, three] = [2.4, 3.1, 4.3].map(|pace| (pace * frame as f32).sin());
        0.02 * vec3(one, two, three)
    };
    let mut scene = moving_ball::scene();
    for view in &mut scene.input_views {
        let wrong = PoseCorrection {
            rotation: error(view.frame),
            centre: Vec3::ZERO,
        };
        view.view = wrong.apply(&view.view);
    }
    let mut fit = PilotFit::of(&scene, 7).unwrap();
    let before = fit.motion();
    // Every view is examined here. Small corrections reverse the errors.
    let found = fit.poses();
    let views = scene.input_views.iter().zip(&found.corrections);
    let pairs: Vec<[Vec3; 2]> = views
        .filter_map(|(view, found)| Some([-error(view.frame), (*found)?.rotation]))
        .collect();
    assert!(pairs.len() == scene.input_views.len());
    let mean =
        [0, 1].map(|side| pairs.iter().map(|pair| pair[side]).sum::<Vec3>() / pairs.len() as f32);
    let (mut together, mut alone) = (0.0, 0.0);
    for [expected, found] in pairs {
        together += (expected - mean[0]).dot(found - mean[1]);
        alone += (expected - mean[0]).length_squared();
    }
    // Slopes are those of the render, whose edges are blurred and too flat. So corrections come out a quarter too
    // large (with the mean of its slopes and the image's, a seventh).
    let share = together / alone;
    assert!((0.5..1.3).contains(&share), "{share}");
    fit.correct_poses(&found);
    let after = fit.motion();
    assert!(after.noise < 0.9 * before.noise, "{before:?} {after:?}");
}

#[test]
fn exact_poses_are_left_alone() {
    let scene = moving_ball::scene();
    let mut outcome = train(&scene, "omni4dgs-plus", &request(6));
    let (is_used, reason) = decision(&outcome);
    assert!(!is_used && reason.contains("limit 0.12)"), "{reason}");
    assert!(
        outcome
            .learner
            .gaussians()
            .unwrap()
            .unwrap()
            .poses
            .is_none()
    );
    assert!(
        !settings(&outcome)
            .learning_rates
            .contains_key(CAMERA_CENTRES)
    );

    // Under the plan full they are refined, with little effect.
    let full = MethodRequest {
        plan: PlanChoice::Full,
        ..request(30)
    };
    let mut outcome = train(&scene, "omni4dgs-plus", &full);
    assert!(decision(&outcome).0);
    let model = outcome.learner.gaussians().unwrap().unwrap();
    let left = remaining(&scene.input_views, &scene.input_views, model);
    assert!(left > 0.0 && left < 0.01, "{left}");
}

#[test]
fn a_run_that_refines_poses_goes_on_to_the_bit() {
    let scenes = [moving_ball::scene(), balls::scene()].map(disturbed);
    for scene in &scenes {
        let request = MethodRequest {
            trace_every: Some(10),
            ..request(40)
        };
        let [whole, resumed] = whole_and_resumed(scene, "omni4dgs-plus", &request, |outcome| {
            let scores = outcome.training.state.trace.iter();
            let scores: Vec<f64> = scores.filter_map(|point| point.train_psnr_db).collect();
            (
                outcome.learner.gaussians().unwrap().unwrap().clone(),
                scores,
            )
        });
        let steps: u64 = whole.0.poses.as_ref().unwrap().steps.iter().sum();
        // From iteration 2 of 40.
        assert_eq!(steps, 39);
        assert!(whole == resumed);
    }
}
