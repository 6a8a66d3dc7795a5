//! Evidence of a plan: changes at scene points, motion, brightness of the views.

use glam::{DVec2, DVec3, Vec3};
use omnilife_engine::training_view::TrainingView;
use omnilife_reconstruct::{
    evidence::pilot::PilotFit,
    request::{MethodRequest, PlanChoice},
    scene::TrainingScene,
};
use omnilife_schemas::camera::CameraModel;
use rand_pcg::Pcg64Mcg;

use crate::support::{
    gains::brighten,
    novel_views::novel_psnr,
    trained::{request, settings, train},
};

use crate::support::{balls, moving_ball};

#[test]
fn points_that_do_not_change_have_no_time_where_it_is_known_that_light_does_not() {
    let scene = moving_ball::scene();
    let only =
        |names: &[&str]| PlanChoice::Only(names.iter().map(|&name| name.to_owned()).collect());
    let separate = only(&[
        "temporal-opacity",
        "temporal-motion",
        "dynamic-mask",
        "mask-seeds",
        "static-table",
    ]);
    let sizes = [PlanChoice::Full, PlanChoice::Auto, separate].map(|plan| {
        let request = MethodRequest { plan, ..request(6) };
        let mut outcome = train(&scene, "omni4dgs-plus", &request);
        let model = outcome.learner.gaussians().unwrap().unwrap();
        (model.parts[0].table.len(), model.parts[1].table.len())
    });
    let [full, auto, separate] = sizes;
    // Balls have no flat surfaces: light may change everywhere, as far as the plan can tell.
    assert!(full.0 == 0 && full.1 > 900 && auto == full, "{sizes:?}");
    // A moving object hides points, but changes none of them.
    assert!(
        separate.0 > 800 && separate.0 + separate.1 == full.1,
        "{sizes:?}"
    );
}

#[test]
fn points_in_a_shadow_that_no_mask_shows_change() {
    let mut scene = moving_ball::scene();
    // Behind the cameras, in every third view.
    let is_shaded = |point: Vec3| point.z < -1.0 && point.x.abs() < 0.5 * -point.z;
    let width = scene.camera.width() as usize;
    for (number, view) in scene.input_views.iter_mut().enumerate() {
        if number % 3 != 0 {
            continue;
        }
        for (pixel, rgb) in view.pixels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let at = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let direction = scene.camera.unproject(at).as_vec3();
            if is_shaded(view.view.rotation.transpose() * direction * 4.0) {
                *rgb = rgb.map(|value| value / 3);
            }
        }
    }
    let found = PilotFit::of(&scene, 7).unwrap().points().0;
    let changing = |shaded: bool| {
        let points = scene.points.positions.iter().zip(&found.changes);
        let of_kind: Vec<bool> = points
            .filter(|(point, _)| is_shaded(Vec3::from_array(**point)) == shaded)
            .map(|(_, changes)| *changes)
            .collect();
        of_kind.iter().filter(|&&changes| changes).count() as f64 / of_kind.len() as f64
    };
    let shares = [changing(true), changing(false)];
    // Most balls are hidden by others.
    assert!(shares[0] > 0.25 && shares[1] < 0.02, "{shares:?} {}", found);
}

/// Checks that an exposure that falls over views with masks does not mark scene points as changing.
#[test]
fn gains_of_the_camera_are_no_change_of_points() {
    let mut scene = moving_ball::scene();
    let changing = |scene: &TrainingScene| {
        let found = PilotFit::of(scene, 7).unwrap().points().0;
        found.changes.iter().filter(|&&changes| changes).count()
    };
    let fixed = changing(&scene);
    for view in &mut scene.input_views {
        brighten(view, 1.0 - 0.65 * f64::from(view.frame) / 14.0);
    }
    let falling = changing(&scene);
    assert!(falling <= fixed + 10, "{falling} {fixed}");
}

#[test]
fn gains_of_the_camera_are_found_and_compensated() {
    let mut scene = moving_ball::scene();
    let gain = |frame: u32| 1.0 - 0.45 * (f64::from(frame) / 14.0);
    for view in scene.input_views.iter_mut().chain(&mut scene.novel_views) {
        let gain = gain(view.frame);
        brighten(view, gain);
    }
    let trained = |without: &[&str]| {
        let without = without.iter().map(|&name| name.to_owned()).collect();
        train(
            &scene,
            "omni4dgs-plus",
            &MethodRequest {
                without,
                ..request(150)
            },
        )
    };
    let (mut compensated, mut plain) = (trained(&[]), trained(&["exposure-compensation"]));
    let exposure = settings(&compensated).exposure.unwrap();
    // Relative to the middle view, at novel views too; the last one is after all input views.
    for view in &scene.novel_views {
        let expected = (gain(view.frame.min(13)) / gain(6)) as f32;
        let found = exposure.gain(view.view.time_seconds)[1];
        assert!(
            (found / expected - 1.0).abs() < 0.04,
            "{}: {found} {expected}",
            view.frame
        );
    }
    assert!(settings(&plain).exposure.is_none());
    let [with, without] = [&mut compensated, &mut plain].map(|outcome| novel_psnr(outcome, &scene));
    assert!(with > without + 1.0, "{with} {without}");

    let still = moving_ball::scene();
    let decisions = train(&still, "omni4dgs-plus", &request(6)).findings.plan;
    let decision = decisions
        .iter()
        .find(|part| part.component == "exposure-compensation");
    assert!(decision.is_some_and(|part| !part.used && part.reason.contains("limit 4.3 %")));
}

/// Checks that a gain that flickers from view to view does not affect the views between the first examined ones.
#[test]
fn flicker_is_found_in_every_one_of_many_views() {
    let mut scene = moving_ball::scene();
    let once = scene.input_views.clone();
    scene.novel_views.clear();
    // 48 views: the clip four times over, brighter and darker in an order that differs from any regular sample.
    let gain = |number: usize| if number % 5 < 2 { 0.6 } else { 1.0 };
    scene.input_views = (0..4 * once.len())
        .map(|number| {
            let mut view = once[number % once.len()].clone();
            view.frame = number as u32;
            view.view.time_seconds = number as f64;
            brighten(&mut view, gain(number));
            view
        })
        .collect();
    let outcome = train(&scene, "omni4dgs-plus", &request(6));
    let exposure = settings(&outcome).exposure.unwrap();
    for number in 0..scene.input_views.len() {
        let found = exposure.gain(number as f64)[1] / exposure.gain(2.0)[1];
        let expected = gain(number) as f32;
        assert!(
            (found / expected - 1.0).abs() < 0.08,
            "{number}: {found} {expected}"
        );
    }
}

#[test]
fn without_masks_residuals_tell_whether_something_moves() {
    let still = balls::scene();
    let mut moving = moving_ball::scene();
    for view in &mut moving.input_views {
        view.mask = None;
    }
    for (scene, moves) in [(&still, false), (&moving, true)] {
        let outcome = train(scene, "omni4dgs", &request(2));
        let decision = outcome
            .findings
            .plan
            .iter()
            .find(|part| part.component == "temporal-motion");
        assert_eq!(decision.unwrap().used, moves, "{:?}", decision.unwrap());
        assert_eq!(settings(&outcome).dynamics.is_some(), moves);
    }
}

#[test]
fn empty_masks_do_not_hide_what_moves() {
    let mut scene = moving_ball::scene();
    for mask in scene
        .input_views
        .iter_mut()
        .filter_map(|view| view.mask.as_mut())
    {
        mask.fill(0);
    }
    let outcome = train(&scene, "omni4dgs", &request(2));
    let used = |component: &str| {
        let mut plan = outcome.findings.plan.iter();
        plan.any(|part| part.component == component && part.used)
    };
    assert!(used("temporal-motion") && !used("mask-seeds") && !used("static-table"));
    let evidence = outcome.findings.evidence.unwrap();
    assert!(evidence.moves() && evidence.masks.coverage == Some(0.0));
}

#[test]
fn saturated_pixels_are_counted_where_the_scene_is_shown() {
    let mut scene = balls::scene();
    for view in &mut scene.input_views {
        view.pixels.fill(100);
        let pixels = view.pixels.len() / 3;
        // One channel is enough; a quarter of the image, half of it an ignored region.
        for pixel in 0..pixels / 4 {
            view.pixels[3 * pixel + pixel % 3] = 255;
        }
        let mut ignored = vec![0; pixels];
        ignored[..pixels / 8].fill(255);
        view.ignored = Some(ignored);
    }
    assert!((scene.saturated_share() - 1.0 / 7.0).abs() < 1e-3);
}

/// Checks noise of a segmenter: a pixel in one of the views, or in two.
#[test]
fn specks_in_a_mask_or_two_do_not_make_a_still_scene_move() {
    specks_show_no_motion(&[4]);
    specks_show_no_motion(&[4, 7]);
}

fn specks_show_no_motion(speckled: &[usize]) {
    let mut scene = balls::scene();
    let pixels = scene.input_views[0].pixels.len() / 3;
    for (number, view) in scene.input_views.iter_mut().enumerate() {
        let mut mask = vec![0; pixels];
        if speckled.contains(&number) {
            mask[pixels / 2] = 255;
        }
        view.mask = Some(mask);
    }
    for method in ["omni4dgs", "omni4dgs-plus"] {
        let outcome = train(&scene, method, &request(2));
        let evidence = outcome.findings.evidence.as_ref().unwrap();
        assert!(evidence.masks.coverage > Some(0.0) && evidence.masks.showing_views < 2);
        assert!(
            evidence.pilot.is_some() && !evidence.moves(),
            "{evidence:?}"
        );
        let is_used = |names: &[&str]| {
            let mut plan = outcome.findings.plan.iter();
            plan.any(|part| part.used && names.contains(&&*part.component))
        };
        assert!(!is_used(&["temporal-motion", "dynamic-mask", "mask-seeds"]));
        let mut warnings = outcome.training.warnings.iter();
        assert!(warnings.any(|line| line.contains("masks")));
    }
}

#[test]
fn every_method_has_the_same_evidence() {
    let scene = moving_ball::scene();
    let evidence = |method: &str, with: &[&str]| {
        let with = with.iter().map(|&name| name.to_owned()).collect();
        train(&scene, method, &MethodRequest { with, ..request(1) })
            .findings
            .evidence
    };
    let of_plus = evidence("omni4dgs-plus", &[]).unwrap();
    assert!(of_plus.pilot.is_some());
    let of_omni4dgs = evidence("omni4dgs", &["mask-seeds", "static-table"]);
    assert_eq!(of_omni4dgs.as_ref(), Some(&of_plus));
    let of_odgs = evidence("odgs", &["exposure-compensation"]);
    assert_eq!(of_odgs.as_ref(), Some(&of_plus));
    let recorded = serde_json::to_value(&of_plus).unwrap();
    let changing = &recorded["pilot"]["changing"];
    assert_eq!(changing["changes"], serde_json::Value::Null);
    assert!(changing["unknown"].is_u64() && recorded["masks"]["coverage"].is_f64());

    // Unneeded evidence is not gathered.
    for method in ["odgs", "deformable"] {
        assert!(evidence(method, &[]).unwrap().pilot.is_none(), "{method}");
    }
    let bare = MethodRequest {
        without: vec!["aids".to_owned()],
        ..request(1)
    };
    let of_bare = train(&scene, "periodic", &bare).findings.evidence;
    assert!(of_bare.unwrap().pilot.is_none());
    assert_eq!(evidence("odgs-published", &[]), None);
}

#[test]
fn planning_counts_as_training() {
    let scene = moving_ball::scene();
    let outcome = train(&scene, "omni4dgs-plus", &request(2));
    let (planning, state) = (outcome.planning, &outcome.training.state);
    assert!(planning.wall_seconds > 0.0 && planning.wall() < state.training);
    let seconds = |row: usize| state.trace[row].wall_seconds;
    assert!((seconds(0) - planning.wall_seconds).abs() < 1e-6);
    assert!(seconds(1) > planning.wall_seconds);
    assert!(state.training_cpu >= planning.cpu());
}

#[test]
fn the_work_of_a_step_is_counted() {
    let scene = moving_ball::scene();
    let [width, height] = scene.camera.size();
    let pixels = (width * height) as f64;
    let work = |method: &str, plan: PlanChoice| {
        let request = MethodRequest { plan, ..request(2) };
        let outcome = train(&scene, method, &request);
        let values: usize = outcome
            .learner
            .arrays()
            .iter()
            .map(|array| array.values)
            .sum();
        let work = outcome.learner.work().unwrap();
        assert_eq!(work.values, values as u64, "{method}");
        work
    };
    let fixed = work("odgs", PlanChoice::Auto);
    assert_eq!((fixed.pixels, fixed.parts.len()), (pixels, 0));
    // Every view has a mask: moving Gaussians are drawn once more.
    let moving = work("omni4dgs-plus", PlanChoice::Full);
    assert!(
        pixels < moving.pixels && moving.pixels <= 2.0 * pixels,
        "{moving:?}"
    );
    let share = |name: &str| {
        let mut parts = moving.parts.iter().filter(|(part, _)| *part == name);
        parts.next().map(|(_, share)| *share)
    };
    assert_eq!(share("another moment drawn"), Some(0.5));
    assert!(share("poses moved") > Some(0.4));
    assert!(moving.values > fixed.values);
}

#[test]
fn gloss_is_drawn_on_request_and_told_with_its_limit() {
    let smooth = |_: &mut Pcg64Mcg, direction: DVec3| (0.2 * direction + 0.5).as_vec3().to_array();
    // Use of harmonics, its reason, and the quality of the novel views.
    let trained = |gloss: f32, with: &[&str]| {
        let scene = balls::scene_with(balls::CAMERA, smooth, 0.5, gloss);
        let request = MethodRequest {
            with: with.iter().map(|&name| name.to_owned()).collect(),
            ..request(150)
        };
        let mut outcome = train(&scene, "omni4dgs-plus", &request);
        let decision = outcome
            .findings
            .plan
            .iter()
            .find(|part| part.component == "view-dependent-colour")
            .unwrap()
            .clone();
        let model = outcome.learner.gaussians().unwrap().unwrap();
        let table = &model.parts[0].table;
        assert_eq!(table.position("sh_rest").is_some(), decision.used);
        let psnr = novel_psnr(&mut outcome, &scene);
        (decision.used, decision.reason, psnr)
    };
    let (used, _, with) = trained(0.6, &["view-dependent-colour"]);
    assert!(used);
    // Below the limit, which clips of rendered places have set.
    let (used, reason, without) = trained(0.6, &[]);
    assert!(!used && reason.contains("flat surfaces"), "{reason}");
    assert!(with > without + 0.3, "{with} {without}");
    let (used, reason, _) = trained(0.0, &[]);
    assert!(!used && reason.contains("limit 0.024"), "{reason}");
}

/// Checks that missing evidence does not select a component: such scenes are planned, trained, and report it.
#[test]
fn scenes_that_show_little_are_planned_without_a_fault() {
    let change = |change: fn(&mut TrainingScene)| {
        let mut scene = moving_ball::scene();
        change(&mut scene);
        scene
    };
    fn each_view(scene: &mut TrainingScene, change: impl Fn(&mut TrainingView)) {
        let views = scene.input_views.iter_mut().chain(&mut scene.novel_views);
        views.for_each(change);
    }
    let scenes = [
        (
            "black",
            change(|scene| each_view(scene, |view| view.pixels.fill(0))),
        ),
        (
            "dark",
            change(|scene| {
                each_view(scene, |view| {
                    view.pixels.iter_mut().for_each(|value| *value /= 64);
                });
            }),
        ),
        (
            "of one colour",
            change(|scene| each_view(scene, |view| view.pixels.fill(128))),
        ),
        ("of one view", change(|scene| scene.input_views.truncate(1))),
        (
            "of cameras on a line",
            change(|scene| {
                let mut number = 0.0;
                let all = scene.input_views.iter_mut().chain(&mut scene.novel_views);
                all.for_each(|view| {
                    view.view.centre = Vec3::X * (number * 0.01);
                    number += 1.0;
                });
            }),
        ),
        (
            "of cameras in one place",
            change(|scene| each_view(scene, |view| view.view.centre = Vec3::ZERO)),
        ),
        (
            "without points",
            change(|scene| {
                scene.points.positions.clear();
                scene.points.colours.clear();
            }),
        ),
    ];
    for (name, scene) in scenes {
        let outcome = train(&scene, "omni4dgs-plus", &request(6));
        assert!(
            outcome
                .training
                .state
                .trace
                .iter()
                .all(|row| row.train_loss.is_none_or(f64::is_finite)),
            "{name}"
        );
        for part in &outcome.findings.plan {
            assert!(
                !part.reason.is_empty()
                    && !part.reason.contains("NaN")
                    && !part.reason.contains("inf "),
                "{name}: {part:?}"
            );
            // Missing evidence does not select costly components.
            let costs = [
                "exposure-compensation",
                "pose-refinement",
                "view-dependent-colour",
            ];
            let says_nothing = ["black", "of one colour", "of one view"].contains(&name);
            assert!(
                !(says_nothing && part.used && costs.contains(&part.component.as_str())),
                "{name}: {part:?}"
            );
        }
    }
}
