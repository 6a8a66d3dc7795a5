//! Components in methods that do not have them by default.

use std::collections::BTreeSet;

use glam::{Vec3, vec3};
use omnilife_engine::{camera::pose::PoseCorrection, gaussians::static_gaussians::OPACITY_LOGITS};
use omnilife_reconstruct::{
    components::{camera_response, denser_points, pose_refinement, view_dependent_colour},
    evidence::once::PilotOnce,
    methods::{self, METHODS},
    options::Options,
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::TrainingScene,
};

use crate::support::trained::{arrays_with_growth, request, settings, train};

use crate::support::novel_views::novel_psnr;
use crate::support::{balls, gains::brighten, moving_ball};

const EXPOSURE: &str = "exposure-compensation";
const POSES: &str = "pose-refinement";
const SHORT: &str = "short-schedule";

/// Returns the test scene with a gain that falls over the clip and poses that drift.
pub(crate) fn spoilt(mut scene: TrainingScene) -> TrainingScene {
    for view in scene.input_views.iter_mut().chain(&mut scene.novel_views) {
        brighten(view, 1.0 - 0.45 * f64::from(view.frame) / 14.0);
        let along = 0.45 * view.frame as f32;
        let wrong = PoseCorrection {
            rotation: 0.03 * vec3(along.sin(), along.cos(), -(0.8 * along).sin()),
            centre: Vec3::ZERO,
        };
        view.view = wrong.apply(&view.view);
    }
    scene
}

fn asked_for(with: &[&str], iterations: u64) -> MethodRequest {
    MethodRequest {
        with: with.iter().map(|&name| name.to_owned()).collect(),
        options: Options::at_most(3_000),
        ..request(iterations)
    }
}

#[test]
fn odgs_takes_exposure_and_poses_one_by_one_and_together() {
    let _once = PilotOnce::begin();
    let scene = spoilt(balls::scene());
    let scores: Vec<f64> = [&[][..], &[EXPOSURE], &[POSES], &[EXPOSURE, POSES]]
        .into_iter()
        .map(|with| {
            let mut outcome = train(&scene, "odgs", &asked_for(with, 200));
            let settings = settings(&outcome);
            for (component, has) in [
                (EXPOSURE, settings.exposure.is_some()),
                (POSES, settings.pose_refinement.is_some()),
            ] {
                let decision = outcome
                    .findings
                    .plan
                    .iter()
                    .find(|part| part.component == component);
                assert_eq!(decision.is_some(), with.contains(&component));
                assert_eq!(has, decision.is_some_and(|decision| decision.used));
            }
            let poses = &outcome.learner.gaussians().unwrap().unwrap().poses;
            assert_eq!(poses.is_some(), with.contains(&POSES));
            novel_psnr(&mut outcome, &scene)
        })
        .collect();
    let [none, exposure, poses, both] = scores[..] else {
        unreachable!("four runs");
    };
    assert!(exposure > none + 0.5 && poses > none + 0.5, "{scores:?}");
    assert!(both > exposure + 0.5 && both > poses + 0.5, "{scores:?}");
}

#[test]
fn methods_with_one_seed_see_the_same_views_in_the_same_order() {
    let _once = PilotOnce::begin();
    let scene = moving_ball::scene();
    let views = scene.input_views.len() as u64;
    // In the middle of the third epoch: `periodic` has drawn shifts in time by then, and children's positions.
    let state = |method: &str| {
        let request = MethodRequest {
            options: Options::at_most(1_500),
            ..request(2 * views + views / 2)
        };
        let state = train(&scene, method, &request).training.state;
        (state.queue, state.view_order)
    };
    let of_odgs = state("odgs");
    assert!(!of_odgs.0.is_empty());
    for method in ["periodic", "omni4dgs", "omni4dgs-plus"] {
        assert_eq!(state(method), of_odgs, "{method}");
    }
}

#[test]
fn scene_points_begin_with_one_opacity_whatever_the_method() {
    let _once = PilotOnce::begin();
    let scene = balls::scene();
    for method in [
        "odgs",
        "periodic",
        "deformable",
        "omni4dgs",
        "omni4dgs-plus",
    ] {
        let method = methods::find(method).unwrap();
        let mut prepared = method
            .prepare(&scene, &request(1), BackendChoice::Cpu)
            .unwrap();
        let model = prepared.learner.gaussians().unwrap().unwrap();
        let opacities = model.parts.iter().flat_map(|part| {
            let logits = &part.table.arrays[OPACITY_LOGITS].values;
            logits.iter().map(|logit| 1.0 / (1.0 + (-logit).exp()))
        });
        let (at_points, _): (Vec<f32>, Vec<f32>) =
            opacities.partition(|opacity| (opacity - 0.1).abs() < 1e-6);
        assert_eq!(at_points.len(), scene.points.len(), "{}", method.id);
    }
}

#[test]
fn larger_steps_get_further_in_a_short_schedule_and_are_left_out_of_a_published_one() {
    let _once = PilotOnce::begin();
    let scene = balls::scene();
    let score = |without: &[&str]| {
        let request = MethodRequest {
            without: without.iter().map(|&name| name.to_owned()).collect(),
            ..asked_for(&[], 150)
        };
        let mut outcome = train(&scene, "odgs", &request);
        let has = settings(&outcome).short_schedule.is_some();
        assert_eq!(has, without.is_empty());
        novel_psnr(&mut outcome, &scene)
    };
    let (with, without, bare) = (score(&[]), score(&[SHORT]), score(&["aids"]));
    assert!(with > without + 0.5, "{without} {with}");
    assert_eq!(bare.to_bits(), without.to_bits());

    let moving = moving_ball::scene();
    let ours = methods::find("omni4dgs-plus").unwrap();
    for (iterations, budget_seconds, used) in [
        (3_000, None, true),
        (30_000, None, false),
        (30_000, Some(60.0), true),
    ] {
        let request = MethodRequest {
            budget_seconds,
            ..asked_for(&[], iterations)
        };
        let prepared = ours.prepare(&moving, &request, BackendChoice::Cpu).unwrap();
        let decision = prepared
            .findings
            .plan
            .iter()
            .find(|part| part.component == SHORT);
        let decision = decision.unwrap();
        assert_eq!(decision.used, used, "{decision:?}");
    }
}

#[test]
fn aids_are_left_out_together_and_one_comes_back_by_name() {
    let _once = PilotOnce::begin();
    let scene = moving_ball::scene();
    let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    for method in METHODS {
        let aids: Vec<&str> = method.supported().aids().collect();
        // The two need distances and tracks; `depth` and `object_graph.rs` have them.
        if aids.is_empty() || ["panogs", "object-graph"].contains(&method.id) {
            continue;
        }
        let used = |with: &[&str], without: &[&str]| {
            let request = MethodRequest {
                with: owned(with),
                without: owned(without),
                plan: method.default_plan.into(),
                ..asked_for(&[], 300)
            };
            let prepared = method.prepare(&scene, &request, BackendChoice::Cpu);
            let used = method
                .supported()
                .used_aids(&prepared.unwrap().findings.plan);
            assert_eq!(used.len(), aids.len());
            let used = used.into_iter().filter(|(_, used)| *used);
            used.map(|(aid, _)| aid).collect::<Vec<_>>()
        };
        assert!(used(&[], &["aids"]).is_empty(), "{}", method.id);
        assert_eq!(used(&[SHORT], &["aids"]), [SHORT], "{}", method.id);
        assert!(used(&[], &[]).contains(&SHORT.to_owned()), "{}", method.id);
        // By the evidence: these poses are exact.
        assert!(
            !used(&["aids"], &[]).contains(&POSES.to_owned()),
            "{}",
            method.id
        );
    }
}

/// Checks that the settings of every method state, beside the rate of each trained array, what becomes of it in a short
/// schedule: an array with a rate alone does not compile, and one without a rate is refused at the start.
#[test]
fn every_trained_array_states_its_growth_in_short_schedules() {
    let _once = PilotOnce::begin();
    let scene = moving_ball::scene();
    let mut seen = BTreeSet::new();
    for method in METHODS {
        let has_short_schedule = method.supported().aids().any(|aid| aid == SHORT);
        // `depth` and `object_graph.rs` have theirs.
        if !has_short_schedule || ["panogs", "object-graph"].contains(&method.id) {
            continue;
        }
        let request = MethodRequest {
            plan: PlanChoice::Full,
            ..asked_for(
                &[POSES, "view-dependent-colour", "velocity-decomposition"],
                300,
            )
        };
        let prepared = method.prepare(&scene, &request, BackendChoice::Cpu);
        seen.extend(arrays_with_growth(&prepared.unwrap()));
    }
    for array in [
        "positions",
        "sh_rest",
        "velocities",
        "radial_velocities",
        "peak_times",
        "deformation_weights",
        "camera_rotations",
    ] {
        assert!(seen.contains(array), "{array}: {seen:?}");
    }
}

#[test]
fn steps_leave_gaussians_out_where_few_views_see_most_points() {
    let ours = methods::find("omni4dgs-plus").unwrap();
    let decision = |views: usize| {
        let mut scene = moving_ball::scene();
        let once = scene.input_views.clone();
        // The clip, over and over again.
        let view = |number: usize| {
            let mut view = once[number % once.len()].clone();
            view.frame = number as u32;
            view.view.time_seconds = number as f64;
            view
        };
        scene.input_views = (0..views).map(view).collect();
        scene.novel_views.clear();
        let prepared = ours.prepare(&scene, &asked_for(&[], 100), BackendChoice::Cpu);
        let plan = prepared.unwrap().findings.plan;
        let decision = plan.into_iter().find(|part| part.component == "dropout");
        decision.unwrap()
    };
    let few = decision(6);
    assert!(
        few.used && few.reason.contains("of 6 input views"),
        "{few:?}"
    );
    let many = decision(60);
    assert!(
        !many.used && many.reason.contains("of 60 input views"),
        "{many:?}"
    );
}

#[test]
fn every_optional_component_of_every_method_trains() {
    let _once = PilotOnce::begin();
    let scene = spoilt(moving_ball::scene());
    for method in METHODS {
        let with = method.optional_components;
        // An object graph needs tracks, which `object_graph.rs` has. An atlas needs a thing before an object, which
        // `neural_atlas.rs` has, and has no Gaussians.
        if with.is_empty() || ["object-graph", "nag"].contains(&method.id) {
            continue;
        }
        let request = MethodRequest {
            options: Options::at_most(600),
            ..asked_for(with, 12)
        };
        let mut outcome = train(&scene, method.id, &request);
        // Points come before a method: `swept_points.rs`.
        for component in with.iter().filter(|name| **name != denser_points::ID) {
            let mut plan = outcome.findings.plan.iter();
            let decision = plan.find(|part| part.component == *component).unwrap();
            assert!(
                decision.used && decision.reason.starts_with("asked for"),
                "{}: {decision:?}",
                method.id
            );
        }
        let state = &outcome.training.state;
        assert!(
            state.refused.iter().all(|&refused| refused == 0),
            "{}",
            method.id
        );
        let model = outcome.learner.gaussians().unwrap().unwrap();
        let has_harmonics = model.parts[0].table.position("sh_rest").is_some();
        for (component, is_there) in [
            (pose_refinement::ID, model.poses.is_some()),
            (camera_response::ID, model.response.is_some()),
            (view_dependent_colour::ID, has_harmonics),
        ] {
            // What is the method's own, the plan decides.
            if with.contains(&component) || !method.components.contains(&component) {
                assert_eq!(
                    with.contains(&component),
                    is_there,
                    "{}: {component}",
                    method.id
                );
            }
        }
    }
}

#[test]
fn what_is_asked_for_and_cannot_be_is_a_remark() {
    let mut scene = moving_ball::scene();
    for view in &mut scene.input_views {
        view.mask = None;
    }
    let outcome = train(&scene, "periodic", &asked_for(&["mask-seeds"], 2));
    let warnings = &outcome.training.warnings;
    assert!(
        warnings.iter().any(|line| line
            == "mask-seeds was asked for and is not used: cannot be without masks that show something"),
        "{warnings:?}"
    );
}
