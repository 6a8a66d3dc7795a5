//! The response of a camera: learnt with the Gaussians, recorded, resumed, and left alone where there is none.

use omnilife_engine::step::camera_response::ResponseSettings;
use omnilife_reconstruct::{
    components::{camera_response, exposure_compensation},
    methods::{self, MethodOutcome},
    options::Options,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
};

use crate::support::{
    balls,
    gains::brighten,
    novel_views::novel_psnr,
    trained::{request, settings, train, whole_and_resumed},
};

/// Returns the gain of a frame's light.
fn gain(frame: u32) -> f64 {
    1.0 - 0.45 * f64::from(frame) / 14.0
}

/// Returns a clip whose gain falls.
fn dimming() -> TrainingScene {
    let mut scene = balls::scene();
    for view in scene.input_views.iter_mut().chain(&mut scene.novel_views) {
        brighten(view, gain(view.frame));
    }
    scene
}

fn with(components: &[&str], iterations: u64) -> MethodRequest {
    MethodRequest {
        with: components.iter().map(|&name| name.to_owned()).collect(),
        options: Options::at_most(3_000),
        ..request(iterations)
    }
}

fn recorded(outcome: &MethodOutcome<'_>) -> ResponseSettings {
    settings(outcome).response.unwrap()
}

#[test]
fn gains_of_a_clip_are_learnt_and_given_to_its_novel_views() {
    let scene = dimming();
    let mut without = train(&scene, "odgs", &with(&[], 600));
    let mut outcome = train(&scene, "odgs", &with(&[camera_response::ID], 600));
    let psnr = [&mut without, &mut outcome].map(|outcome| novel_psnr(outcome, &scene));
    assert!(psnr[1] > psnr[0] + 0.5, "{psnr:?}");

    let learnt = recorded(&outcome).learnt.unwrap();
    let views = scene.input_views.iter();
    let logs: Vec<f64> = views.map(|view| gain(view.frame).ln()).collect();
    let mean = logs.iter().sum::<f64>() / logs.len() as f64;
    for (view, log) in scene.input_views.iter().zip(&logs) {
        let expected = (log - mean).exp();
        for found in learnt.gains.gain(view.view.time_seconds) {
            let error = (f64::from(found) / expected - 1.0).abs();
            assert!(error < 0.03, "{}: {found} {expected}", view.frame);
        }
    }
    // The record has the numbers of the model.
    let model = outcome.learner.gaussians().unwrap().unwrap();
    assert_eq!(model.response.as_ref().unwrap().learnt(), Some(learnt));
}

#[test]
fn a_clip_of_one_exposure_keeps_its_gains() {
    let scene = balls::scene();
    let outcome = train(&scene, "odgs", &with(&[camera_response::ID], 600));
    let learnt = recorded(&outcome).learnt.unwrap();
    assert!(learnt.gains.drift() < 0.005, "{}", learnt.gains.drift());
    assert_eq!(learnt.vignette, None);
}

#[test]
fn gains_of_an_estimate_are_where_a_response_begins() {
    let scene = dimming();
    let both = [exposure_compensation::ID, camera_response::ID];
    let method = methods::find("odgs").unwrap();
    let begin = |components: &[&str]| {
        let prepared = method.prepare(&scene, &with(components, 100), BackendChoice::Cpu);
        let mut prepared = prepared.unwrap();
        let model = prepared.learner.gaussians().unwrap().unwrap();
        let response = model.response.as_ref().unwrap();
        response.learnt().unwrap().gains
    };
    let (estimated, new) = (begin(&both), begin(&both[1..]));
    assert!(new.drift() == 0.0);
    // The light of the first frame is 1.8 times that of the last one.
    let [first, last] = [0.0, 13.0].map(|seconds| estimated.gain(seconds)[1]);
    assert!((1.4..2.2).contains(&(first / last)), "{first} {last}");
}

#[test]
fn a_run_that_learns_a_response_goes_on_to_the_bit() {
    let scene = dimming();
    let request = MethodRequest {
        trace_every: Some(10),
        ..with(&[camera_response::ID], 40)
    };
    let [whole, resumed] = whole_and_resumed(&scene, "odgs", &request, |outcome| {
        let model = outcome.learner.gaussians().unwrap().unwrap().clone();
        (model, outcome.configuration.clone())
    });
    let response = whole.0.response.as_ref().unwrap();
    // From iteration 4 of 40.
    assert_eq!(response.shared.steps, 37);
    assert_eq!(response.steps.iter().sum::<u64>(), 37);
    assert!(whole == resumed);
}
