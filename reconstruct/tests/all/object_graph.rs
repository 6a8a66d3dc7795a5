//! The object graph: each moving track is an object of its own, and can be removed.

use omnilife_engine::model::{
    Model,
    layers::{Layer, LayerRenderer},
};
use omnilife_reconstruct::{
    methods::{self, MethodOutcome, Prepared},
    options::Options,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
    train::Session,
};
use omnilife_schemas::{
    progress::Silent,
    records::{Track, Tracks},
    trajectory::{BSpline, ObjectPath},
};

use crate::support::{flight, moving_ball, novel_views::novel_psnr, trained::arrays_with_growth};

/// Returns the clip of the moving ball with its true track.
pub(crate) fn scene() -> TrainingScene {
    let mut scene = moving_ball::scene();
    let times: Vec<f64> = (0..15).map(f64::from).collect();
    let centres = times.iter().map(|time| [0.1 * (time - 7.0), 0.2, 3.0]);
    let path = ObjectPath {
        centre: BSpline {
            degree: 1,
            knots: [&[0.0][..], &times, &[14.0]].concat(),
            coefficients: centres.collect(),
        },
        heading_seconds: vec![0.0],
        headings: vec![0.0],
    };
    scene.tracks = Some(Tracks {
        scene: scene.id.clone(),
        frames: scene.input_views.iter().map(|view| view.frame).collect(),
        image_size: scene.camera.size().map(|side| side as u32),
        up: [0.0, -1.0, 0.0],
        metres_per_unit: 1.0,
        stages: Vec::new(),
        detections: Vec::new(),
        tracks: vec![Track {
            id: 5,
            class: "ball".to_owned(),
            dimensions: [1.4; 3],
            path,
            detections: 12,
            displacement: 1.4,
        }],
        warnings: Vec::new(),
    });
    scene
}

#[test]
fn steps_of_objects_grow_in_short_schedules_and_paths_go_as_far_in_any() {
    let scene = scene();
    let method = methods::find("object-graph").unwrap();
    let prepared = |iterations: u64| {
        let request = MethodRequest::new(iterations, 3);
        let prepared = method.prepare(&scene, &request, BackendChoice::Cpu);
        prepared.unwrap()
    };
    let short = prepared(250);
    let arrays = arrays_with_growth(&short);
    assert!(arrays.contains(&"object_positions") && arrays.contains(&"object_poses"));
    let rates = &short.configuration["learning_rates"];
    assert_eq!(rates["object_poses"]["growth"], "unchanged");
    assert_ne!(rates["object_positions"]["growth"], "unchanged");
    let used = method.supported().used_aids(&short.findings.plan);
    assert!(used["short-schedule"]);
    let way = |prepared: &Prepared<'_>, iterations: f64| {
        let rate = &prepared.configuration["learning_rates"]["object_poses"];
        let [begin, end] = ["begin", "end"].map(|name| rate[name].as_f64().unwrap());
        // Mean of a rate that falls log-linearly.
        iterations * (begin - end) / (begin / end).ln()
    };
    // Twice a tenth of the ball's diameter.
    for (prepared, iterations) in [(&short, 250.0), (&prepared(25_000), 25_000.0)] {
        let way = way(prepared, iterations);
        assert!((way - 0.28).abs() < 1e-4, "{way} in {iterations} steps");
    }
}

fn train<'a>(scene: &'a TrainingScene, method: &str) -> MethodOutcome<'a> {
    let session = Session::without_files(&Silent);
    let request = MethodRequest::new(250, 3);
    methods::find(method)
        .unwrap()
        .train(scene, &request, &session)
        .unwrap()
}

/// Returns the mean PSNR of the masked pixels of the novel views, dB.
pub(crate) fn dynamic_psnr(outcome: &mut MethodOutcome<'_>, scene: &TrainingScene) -> f64 {
    let scores = scene.novel_views.iter().map(|view| {
        let image = outcome.learner.image(&view.view).unwrap();
        let mask = view.mask.as_ref().unwrap();
        let (mut sum, mut count) = (0.0, 0);
        for (pixel, _) in mask.iter().enumerate().filter(|(_, mask)| **mask > 0) {
            for channel in 0..3 {
                let truth = f32::from(view.pixels[3 * pixel + channel]) / 255.0;
                sum += f64::from(image.data[3 * pixel + channel] - truth).powi(2);
                count += 1;
            }
        }
        -10.0 * (sum / f64::from(count)).log10()
    });
    scores.sum::<f64>() / scene.novel_views.len() as f64
}

#[test]
fn what_moves_is_better_than_a_static_scene_has_it_and_can_be_taken_out() {
    let scene = scene();
    let mut graph = train(&scene, "object-graph");
    let mut still = train(&scene, "odgs");
    let [of_graph, of_static] = [&mut graph, &mut still].map(|one| dynamic_psnr(one, &scene));
    assert!(
        of_graph > of_static + 4.0,
        "{of_graph} against {of_static} dB"
    );
    let used = |name: &str| {
        graph
            .findings
            .plan
            .iter()
            .any(|one| one.component == name && one.used)
    };
    assert!(used("object-graph") && !used("object-poses"));
    // Removed: the static render to the bit.
    let model = graph.learner.gaussians().unwrap().unwrap().clone();
    assert_eq!(model.parts.len(), 2);
    let settings = omnilife_engine::render::settings::RenderSettings::new(0.01);
    let mut without = model.clone();
    without.parts.truncate(1);
    let view = &scene.novel_views[0].view;
    let mut layers = LayerRenderer::new(model, settings);
    let mut without = LayerRenderer::new(without, settings);
    assert!(without.is_static() && !layers.is_static());
    // Paths are no velocities of Gaussians: a map of these would show objects at rest.
    assert!(layers.refusal(Layer::Velocity).is_some());
    assert_eq!(layers.refusal(Layer::Dynamic), None);
    let taken_out = without.image(view, Layer::All);
    assert_eq!(layers.image(view, Layer::Static), taken_out);
    assert_ne!(layers.image(view, Layer::All), taken_out);
    assert_eq!(
        layers.image(view, Layer::Dynamic),
        layers.image(view, Layer::Object(5))
    );
    let object = layers.image(view, Layer::Object(5));
    let opacity = layers.opacity(view, Layer::Object(5));
    let mut shown = opacity.data.iter().zip(&object.data);
    assert!(shown.all(
        |(opacity, colour)| (0.0..=1.0).contains(opacity) && (*opacity > 0.0 || *colour == 0.0)
    ));
    assert!(opacity.data.iter().any(|&opacity| opacity > 0.25) && opacity.data.contains(&0.0));
    assert!(layers.refusal(Layer::Object(5)).is_none());
    assert!(layers.refusal(Layer::Object(6)).is_some());
}

/// Returns the PSNR of the static part in the novel views of another scene, dB.
fn static_psnr(model: &Model, truth: &TrainingScene) -> f64 {
    let settings = omnilife_engine::render::settings::RenderSettings::new(0.01);
    let mut layers = LayerRenderer::new(model.clone(), settings);
    let mut target = Vec::new();
    let (mut squares, mut count) = (0.0, 0);
    for view in &truth.novel_views {
        view.write_image(&mut target);
        let image = layers.image(&view.view, Layer::Static);
        for (value, wanted) in image.data.iter().zip(&target) {
            squares += f64::from(value - wanted).powi(2);
            count += 1;
        }
    }
    -10.0 * (squares / f64::from(count)).log10()
}

#[test]
fn a_hovering_camera_has_objects_over_its_planar_ground() {
    let scene = flight::hovering(flight::true_path(), true);
    let empty = flight::hovering(flight::true_path(), false);
    let mut graph = train(&scene, "object-graph");
    let psnr = novel_psnr(&mut graph, &scene);
    assert!(psnr > 40.0, "{psnr} dB");
    let model = graph.learner.gaussians().unwrap().unwrap();
    assert_eq!(model.parts.len(), 2);
    // Without the vehicle its ground is there, in images that never showed it so.
    let removed = static_psnr(model, &empty);
    assert!(removed > 40.0, "{removed} dB");
    assert!(static_psnr(model, &scene) < removed - 10.0);
}

#[test]
fn without_anything_that_moves_the_method_is_the_static_one() {
    let mut scene = scene();
    if let Some(tracks) = &mut scene.tracks {
        tracks.tracks.clear();
    }
    let method = methods::find("object-graph").unwrap();
    let request = MethodRequest::new(20, 1);
    let session = Session::without_files(&Silent);
    let mut graph = method.train(&scene, &request, &session).unwrap();
    let mut still = methods::find("odgs")
        .unwrap()
        .train(&scene, &request, &session)
        .unwrap();
    let [one, other] = [&mut graph, &mut still].map(|outcome| {
        let model = outcome.learner.gaussians().unwrap().unwrap();
        model
            .parts
            .iter()
            .map(|part| part.table.clone())
            .collect::<Vec<_>>()
    });
    assert_eq!(one, other);
    let mut untracked = scene.clone();
    untracked.tracks = None;
    let refused = method
        .prepare(&untracked, &request, BackendChoice::Cpu)
        .map(drop);
    assert!(refused.unwrap_err().to_string().contains("curate tracks"));
}

#[test]
fn objects_leave_half_of_a_limit_to_what_does_not_move() {
    let scene = scene();
    let method = methods::find("object-graph").unwrap();
    let counts_under = |limit: u64| {
        let request = MethodRequest {
            options: Options::at_most(limit),
            ..MethodRequest::new(100, 3)
        };
        let prepared = method.prepare(&scene, &request, BackendChoice::Cpu);
        let mut prepared = prepared.unwrap();
        let model = prepared.learner.gaussians().unwrap().unwrap();
        let counts = [0, 1].map(|part| model.parts[part].table.len());
        (counts, prepared.findings.warnings.len())
    };
    let ([_, free], without) = counts_under(8_000);
    assert!(free > 600, "{free} Gaussians");
    let ([still, moving], with) = counts_under(1_000);
    assert!((32..=500).contains(&moving), "{moving} Gaussians");
    // With its points the scene fills the rest.
    assert_eq!(still + moving, 1_000);
    assert_eq!(with, without + 1);
}

#[test]
fn gaussians_stay_with_their_object() {
    let mut scene = scene();
    if let Some(tracks) = &mut scene.tracks {
        // Another one, that goes the same way in front of it.
        let mut other = tracks.tracks[0].clone();
        other.id = 6;
        for place in &mut other.path.centre.coefficients {
            place[1] -= 0.8;
        }
        tracks.tracks.push(other);
    }
    let request = MethodRequest::new(40, 3);
    let session = Session::without_files(&Silent);
    let method = methods::find("object-graph").unwrap();
    let counts = |model: &Model| {
        let part = &model.parts[1];
        let ids = part.parameterization.tracked().unwrap().ids(&part.table);
        [5, 6].map(|id| ids.iter().filter(|&&one| one == id).count())
    };
    let mut trained = method.train(&scene, &request, &session).unwrap();
    let [first, second] = counts(trained.learner.gaussians().unwrap().unwrap());
    assert!(first > 30 && second > 30, "{first} and {second} Gaussians");
}
