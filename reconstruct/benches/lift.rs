//! Time of the lift of panoramas with distances: normals, radii and samples of every pixel.
//!
//! ```text
//! cargo bench --bench lift -- SCENE SPLIT OUT
//! ```
//!
//! `OUT` gets every sample: position, normal, radius and the position of its camera, ten little-endian f32,
//! normalized units. Prints one line of JSON, for `scripts/compare lift`.

use std::{path::Path, time::Instant};

use omnilife_reconstruct::{
    process::own_cpu_time,
    scene::{CameraExtent, TrainingScene},
    seeds::depth::{
        lift::{LiftSettings, lift},
        source_view::SourceView,
    },
};

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let [scene, split, out] = words.as_slice() else {
        // As `cargo bench` runs every bench, without arguments.
        println!("lift: give SCENE SPLIT OUT");
        return;
    };
    let scene = TrainingScene::load(Path::new(scene), Path::new(split), CameraExtent::Most)
        .expect("a scene");
    let settings = LiftSettings {
        thins_poles: false,
        ..LiftSettings::OF_ALL_VIEWS
    };
    let (mut bytes, mut samples) = (Vec::new(), 0);
    let (mut wall_seconds, mut cpu_seconds) = (0.0, 0.0);
    for number in 0..scene.input_views.len() {
        let distances = scene
            .distances(number)
            .expect("readable distances")
            .expect("distances of every view");
        let source = SourceView::on_one_grid(&scene.input_views[number], distances);
        let (begun, begun_cpu) = (Instant::now(), own_cpu_time().unwrap_or_default());
        let lifted = lift(&source.as_given(), number as u64, &settings);
        cpu_seconds += (own_cpu_time().unwrap_or_default() - begun_cpu).as_secs_f64();
        wall_seconds += begun.elapsed().as_secs_f64();
        samples += lifted.len();
        let camera = source.view.view.centre;
        for index in 0..lifted.len() {
            let place = lifted.gaussians.positions[index];
            let normal = lifted.normals[index].to_array();
            let row = [
                &place[..],
                &normal,
                &[lifted.radii[index]],
                &camera.to_array(),
            ]
            .concat();
            bytes.extend(row.into_iter().flat_map(f32::to_le_bytes));
        }
    }
    std::fs::write(out, bytes).expect("a writable file");
    let line = serde_json::json!({
        "views": scene.input_views.len(),
        "samples": samples,
        "wall_seconds": wall_seconds,
        "cpu_seconds": cpu_seconds,
    });
    println!("{line}");
}
