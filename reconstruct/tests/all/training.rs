//! Training as a whole, on views rendered from known Gaussians.

use balls::scene;
use novel_views::novel_psnr;
use omnilife_reconstruct::{
    methods::{self, MethodOutcome},
    options::Options,
    request::MethodRequest,
    scene::TrainingScene,
    train::Session,
};
use omnilife_schemas::{points::PointCloud, progress::Silent, records::ComponentDecision};

use crate::support::{balls, novel_views};

fn sky<'o>(outcome: &'o MethodOutcome<'_>) -> &'o ComponentDecision {
    let mut plan = outcome.findings.plan.iter();
    plan.find(|part| part.component == "sky-shell").unwrap()
}

fn train_as<'a>(scene: &'a TrainingScene, request: &MethodRequest) -> MethodOutcome<'a> {
    methods::find("odgs")
        .unwrap()
        .train(scene, request, &Session::without_files(&Silent))
        .unwrap()
}

fn train(scene: &TrainingScene, iterations: u64) -> MethodOutcome<'_> {
    let request = MethodRequest {
        trace_every: Some(10),
        ..MethodRequest::new(iterations, 7)
    };
    train_as(scene, &request)
}

#[test]
fn grey_points_become_the_scene() {
    let scene = scene();
    let mut outcome = train(&scene, 300);
    let before = novel_psnr(&mut train(&scene, 1), &scene);
    let after = novel_psnr(&mut outcome, &scene);
    let trace = &outcome.training.state.trace;
    let last = trace.last().unwrap();
    let losses: Vec<f64> = trace.iter().filter_map(|point| point.train_loss).collect();
    assert!(
        after > 24.0 && after > before + 4.0,
        "novel views: {before} then {after} dB"
    );
    assert!(losses[losses.len() - 1] < 0.5 * losses[0]);
    assert!(
        trace
            .windows(2)
            .all(|pair| pair[0].wall_seconds <= pair[1].wall_seconds)
    );
    assert_eq!(last.iteration, 300);
    assert_eq!(outcome.training.state.refused, [0; 5]);
    // Points in every direction: there is no sky.
    assert!(!sky(&outcome).used, "{:?}", sky(&outcome));
}

#[test]
fn training_does_not_depend_on_the_number_of_threads() {
    let scene = scene();
    let tables = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let mut outcome = train(&scene, 40);
            let model = outcome.learner.gaussians().unwrap().unwrap();
            model.parts[0].table.clone()
        })
    });
    assert_eq!(tables[0].len(), tables[1].len());
    for (one, three) in tables[0].arrays.iter().zip(&tables[1].arrays) {
        assert!(one.values == three.values, "{} differ", one.name);
    }
}

#[test]
fn a_scene_without_points_gets_a_shell_of_sky() {
    let mut scene = scene();
    scene.points = PointCloud::default();
    let mut outcome = train(&scene, 60);
    assert!(sky(&outcome).used, "{:?}", sky(&outcome));
    let psnr = novel_psnr(&mut outcome, &scene);
    assert!(psnr > 14.0, "novel views at {psnr} dB");
}

#[test]
fn a_limit_on_the_gaussians_thins_the_points() {
    let scene = scene();
    let request = MethodRequest {
        options: Options::at_most(300),
        ..MethodRequest::new(120, 7)
    };
    let outcome = train_as(&scene, &request);
    let thinned = outcome
        .findings
        .plan
        .iter()
        .find(|part| part.component == "all-points");
    let reason = &thinned.unwrap().reason;
    assert!(reason.starts_with("300 of 900 points"), "{reason}");
    assert!(outcome.learner.size().primitives <= 300);
}

#[test]
fn more_gaussians_than_memory_holds_are_refused_with_the_figure() {
    let request = MethodRequest {
        options: Options::at_most(10_u64.pow(11)),
        ..MethodRequest::new(10, 7)
    };
    let scene = scene();
    let refused =
        methods::find("odgs")
            .unwrap()
            .train(&scene, &request, &Session::without_files(&Silent));
    let message = refused.map(drop).unwrap_err().to_string();
    assert!(
        message.contains("100000000000 Gaussians") && message.contains("GiB"),
        "{message}"
    );
}

#[test]
fn few_and_odd_points_train_without_a_panic() {
    let clouds: [Vec<[f32; 3]>; 3] = [
        vec![[3.0, 1.0, 2.0]],
        vec![[3.0, 1.0, 2.0]; 40],
        vec![[0.0; 3]; 40],
    ];
    for positions in clouds {
        let mut scene = scene();
        scene.points = PointCloud::of_colour(positions, [90; 3]);
        let outcome = train(&scene, 30);
        let last = outcome.training.state.trace.last().unwrap().clone();
        assert!(
            last.train_loss.is_some_and(f64::is_finite) && last.primitives > 1_000,
            "{last:?}"
        );
    }
}

#[test]
fn what_a_gaussian_looks_like_may_depend_on_the_direction() {
    let scene = scene();
    let request = MethodRequest {
        options: Options::of_sh_degree(2),
        ..MethodRequest::new(90, 7)
    };
    let mut outcome = train_as(&scene, &request);
    let model = outcome.learner.gaussians().unwrap().unwrap();
    let table = &model.parts[0].table;
    let rest = table.arrays.last().unwrap();
    assert_eq!((rest.name, rest.width), ("sh_rest", 24));
    assert!(rest.values.iter().any(|&value| value.abs() > 1e-4));
    let constant = train(&scene, 30);
    assert_eq!(constant.training.state.trace[0].refused.len(), 5);
}

#[test]
fn a_budget_ends_training() {
    let request = MethodRequest {
        budget_seconds: Some(0.5),
        ..MethodRequest::new(1_000_000, 7)
    };
    let scene = scene();
    let outcome = train_as(&scene, &request);
    assert!(outcome.training.stopped_by_budget);
    assert!(outcome.training.state.iteration < 1_000_000);
    assert_eq!(
        outcome.training.state.trace.last().unwrap().iteration,
        outcome.training.state.iteration
    );
}

/// Returns the scene with the operator at the same pixels of every view.
fn held(is_ignored: bool) -> TrainingScene {
    let mut scene = scene();
    let [width, height] = scene.camera.size();
    let is_holder = |pixel: usize| {
        let (column, row) = (pixel % width, pixel / width);
        row > height * 3 / 4 || (row > height / 3 && column < width / 8)
    };
    let marks: Vec<u8> = (0..width * height)
        .map(|at| u8::from(is_holder(at)))
        .collect();
    for view in &mut scene.input_views {
        let pixels = view.pixels.as_chunks_mut::<3>().0.iter_mut().zip(&marks);
        for (number, (pixel, _)) in pixels.enumerate().filter(|(_, (_, mark))| **mark != 0) {
            *pixel = [250, (number % 90) as u8, 20];
        }
        view.ignored = is_ignored.then(|| marks.clone());
    }
    for view in &mut scene.novel_views {
        view.ignored = Some(marks.clone());
    }
    scene
}

#[test]
fn nothing_is_learned_from_who_holds_the_camera() {
    let mut clean = held(false);
    clean.input_views = scene().input_views;
    let [clean, ignored, learned] =
        [clean, held(true), held(false)].map(|scene| novel_psnr(&mut train(&scene, 300), &scene));
    assert!(
        ignored > clean - 1.0 && ignored > learned + 2.0,
        "without a holder {clean}, ignored {ignored}, learned from {learned} dB"
    );
}
