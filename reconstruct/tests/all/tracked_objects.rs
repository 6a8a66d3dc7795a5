//! Vehicles with paths in omni4dgs-plus: Gaussians of their own beside those with times.

use omnilife_engine::model::layers::{Layer, LayerRenderer};
use omnilife_reconstruct::{
    methods,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
};
use omnilife_schemas::{
    elapsed::Elapsed,
    records::{ComponentDecision, TrackStage, Tracks},
};

use crate::{object_graph, support::trained};

const COMPONENT: &str = "tracked-objects";

/// Returns the clip of the moving ball, taken as a vehicle whose path a stage made.
fn scene(stage: &str, method: &str) -> TrainingScene {
    let mut scene = object_graph::scene();
    let tracks = scene.tracks.as_mut().unwrap();
    tracks.tracks[0].class = "vehicle".to_owned();
    tracks.stages = vec![TrackStage {
        stage: stage.to_owned(),
        method: method.to_owned(),
        reason: "a test".to_owned(),
        took: Elapsed::default(),
    }];
    scene
}

fn decision(scene: &TrainingScene, with: &[&str]) -> ComponentDecision {
    let request = MethodRequest {
        with: with.iter().map(|&name| name.to_owned()).collect(),
        ..MethodRequest::new(100, 3)
    };
    let method = methods::find("omni4dgs-plus").unwrap();
    let prepared = method.prepare(scene, &request, BackendChoice::Cpu).unwrap();
    let mut plan = prepared.findings.plan.into_iter();
    plan.find(|line| line.component == COMPONENT).unwrap()
}

#[test]
fn exact_paths_of_vehicles_are_used_and_others_on_request() {
    for exact in [
        scene(Tracks::LABELS_STAGE, "kitti"),
        scene(Tracks::DETECTOR_STAGE, "exact"),
    ] {
        assert!(decision(&exact, &[]).used);
    }
    let found = scene(Tracks::DETECTOR_STAGE, "motion");
    assert!(!decision(&found, &[]).used);
    assert!(decision(&found, &[COMPONENT]).used);
    // People bend as they walk.
    let mut person = scene(Tracks::LABELS_STAGE, "kitti");
    person.tracks.as_mut().unwrap().tracks[0].class = "person".to_owned();
    let mut without = scene(Tracks::LABELS_STAGE, "kitti");
    without.tracks = None;
    for nothing in [person, without] {
        let line = decision(&nothing, &[COMPONENT]);
        assert!(
            !line.used && line.reason.contains("tracks of vehicles"),
            "{line:?}"
        );
    }
}

#[test]
fn a_vehicle_is_sharper_with_its_path_and_is_a_layer_of_its_own() {
    let mut scene = scene(Tracks::LABELS_STAGE, "kitti");
    // Far apart in time: between them a Gaussian with a lifespan is where none of them shows it.
    scene.input_views = scene.input_views.into_iter().step_by(4).collect();
    let train = |without: &[&str]| {
        let request = MethodRequest {
            without: without.iter().map(|&name| name.to_owned()).collect(),
            ..MethodRequest::new(250, 3)
        };
        trained::train(&scene, "omni4dgs-plus", &request)
    };
    let mut tracked = train(&[]);
    let mut plain = train(&[COMPONENT]);
    let in_masks = |outcome: &mut _| object_graph::dynamic_psnr(outcome, &scene);
    // A plain ball on a straight way is where Gaussians with velocities do best; docs/results/quality.md has a street.
    let gain = in_masks(&mut tracked) - in_masks(&mut plain);
    assert!(gain > 0.2, "{gain} dB");

    let model = tracked.learner.gaussians().unwrap().unwrap().clone();
    assert_eq!(model.objects(), Some(1));
    assert_eq!(plain.learner.gaussians().unwrap().unwrap().objects(), None);
    let settings = omnilife_engine::render::settings::RenderSettings::new(0.01);
    let mut layers = LayerRenderer::new(model, settings);
    let view = &scene.novel_views[0].view;
    let [all, still, object] =
        [Layer::All, Layer::Static, Layer::Object(5)].map(|layer| layers.image(view, layer));
    assert_ne!(all, still);
    assert!(object.data.iter().any(|&value| value > 0.5));
}
