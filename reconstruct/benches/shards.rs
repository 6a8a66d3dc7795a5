//! Time and memory of training in shards, and the gain of training on near views alone.
//!
//! ```text
//! cargo bench --bench shards -- SCENE SPLIT ITERATIONS SHARDS GAUSSIANS [COMPONENT ...]
//! ```
//!
//! Trains `panogs` on every sample of every view, with the named components beside those of the plan;
//! neighbour-views takes part only by name. Prints one line of JSON: CPU seconds of planning and of a step, the
//! peak of the process, the mean PSNR of the novel views.

use std::path::Path;

use omnilife_engine::training_view::TrainingView;
use omnilife_reconstruct::{
    methods,
    options::Options,
    process::{own_cpu_time, peak_memory_bytes},
    request::{BackendChoice, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    train::{Session, train},
};
use omnilife_schemas::progress::Silent;

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let [scene, split, iterations, shards, gaussians, components @ ..] = words.as_slice() else {
        // As `cargo bench` runs every bench, without arguments.
        println!("shards: give SCENE SPLIT ITERATIONS SHARDS GAUSSIANS [COMPONENT ...]");
        return;
    };
    let scene = TrainingScene::load(Path::new(scene), Path::new(split), CameraExtent::Most)
        .expect("a scene");
    let owned = |names: &[&str]| {
        names
            .iter()
            .map(|&name| name.to_owned())
            .collect::<Vec<_>>()
    };
    let mut without = owned(&[
        "redundant-samples",
        "pole-thinning",
        "neighbour-views",
        "centre-refinement",
    ]);
    without.retain(|name| !components.contains(name));
    let method = methods::find("panogs").expect("a method");
    let options = [
        format!("shards={shards}"),
        format!("max-gaussians={gaussians}"),
    ];
    let request = MethodRequest {
        without,
        with: components.to_vec(),
        options: Options::parse(method.id, method.options, &options).expect("options"),
        ..MethodRequest::new(iterations.parse().expect("a number of iterations"), 0)
    };
    let begun = own_cpu_time().unwrap_or_default();
    let prepared = method.prepare(&scene, &request, BackendChoice::Cpu);
    let mut prepared = prepared.expect("a scene with distances");
    let planned = own_cpu_time().unwrap_or_default();
    let session = Session::without_files(&Silent);
    train(&scene, &mut *prepared.learner, prepared.length, &session).expect("a training");
    let steps = (own_cpu_time().unwrap_or_default() - planned).as_secs_f64();
    let peak = peak_memory_bytes();
    let psnr = |view: &TrainingView| {
        let image = prepared.learner.image(&view.view).expect("an image");
        let squares = image.data.iter().zip(&view.pixels).map(|(&value, &byte)| {
            let seen = (value * 255.0).round() / 255.0;
            f64::from(seen - f32::from(byte) / 255.0).powi(2)
        });
        -10.0 * (squares.sum::<f64>() / image.data.len() as f64).log10()
    };
    let novel: Vec<f64> = scene.novel_views.iter().step_by(5).map(psnr).collect();
    let reason = |id: &str| {
        let mut plan = prepared.findings.plan.iter();
        plan.find(|decision| decision.component == id)
            .map(|decision| decision.reason.clone())
    };
    let line = serde_json::json!({
        "gaussians": prepared.learner.size().primitives,
        "shards": prepared.configuration["shards"]["gaussians"].as_array().map_or(1, Vec::len),
        "planning_cpu_seconds": (planned - begun).as_secs_f64(),
        "step_cpu_seconds": steps / prepared.length.iterations as f64,
        "peak_bytes": peak,
        "novel_psnr": novel.iter().sum::<f64>() / novel.len() as f64,
        "plan": [reason("shards"), reason("neighbour-views")],
    });
    println!("{line}");
}
