//! Time and memory of the fusion of panoramas with distances into a signed distance field.
//!
//! ```text
//! cargo bench --bench fusion -- SCENE SPLIT VOXEL [ROUNDS]
//! ```
//!
//! `VOXEL` is in units of the scene (metres, where its scale is). Prints one line of JSON, for
//! `scripts/compare fusion`: the best of the rounds.

use std::{fs, path::Path, time::Instant};

use glam::Vec3;
use omnilife_engine::losses::scaffold::{Scaffold, fuse::FusedView};
use omnilife_reconstruct::{
    process::cpu_time,
    scene::TrainingScene,
    seeds::depth::{lift::incidence, source_view::SourceView},
};

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let [scene, split, voxel, rest @ ..] = words.as_slice() else {
        // As `cargo bench` runs every bench, without arguments.
        println!("fusion: give SCENE SPLIT VOXEL [ROUNDS]");
        return;
    };
    let voxel: f64 = voxel.parse().expect("a voxel's side");
    let rounds = rest
        .first()
        .map_or(3, |word| word.parse().expect("a number of rounds"));
    let scene = TrainingScene::load(Path::new(scene), Path::new(split)).expect("a scene");
    let views: Vec<SourceView> = (0..scene.input_views.len())
        .map(|number| {
            let distances = scene
                .distances(number)
                .expect("readable distances")
                .expect("distances of every view");
            SourceView::on_one_grid(&scene.input_views[number], distances)
        })
        .collect();
    let voxel = (voxel * scene.normalization.scale) as f32;
    let (mut seconds, mut processor_seconds) = (f64::INFINITY, f64::INFINITY);
    let mut made = None;
    for _ in 0..rounds {
        let (begun, begun_processor) = (Instant::now(), cpu_time().unwrap_or_default());
        let incidences: Vec<Vec<f32>> = views
            .iter()
            .map(|view| incidence(&view.as_given()))
            .collect();
        let fused: Vec<FusedView<'_>> = views
            .iter()
            .zip(&incidences)
            .map(|(source, incidence)| FusedView {
                view: &source.view.view,
                distances: &source.distances,
                incidence,
            })
            .collect();
        let field = Scaffold::fuse(&fused, voxel, Vec3::ZERO);
        let used = cpu_time().unwrap_or_default() - begun_processor;
        seconds = seconds.min(begun.elapsed().as_secs_f64());
        processor_seconds = processor_seconds.min(used.as_secs_f64());
        made = Some(field.bytes());
    }
    let line = serde_json::json!({
        "name": "omnilife",
        "views": views.len(),
        "size": [views[0].distances.width, views[0].distances.height],
        "wall_seconds": seconds,
        "cpu_seconds": processor_seconds,
        "field_bytes": made,
        "peak_bytes": peak_bytes(),
    });
    println!("{line}");
}

/// Largest resident size of this process; 0 where the system does not say.
fn peak_bytes() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kilobytes = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix("kB"))
        .and_then(|number| number.trim().parse::<u64>().ok());
    kilobytes.unwrap_or(0) * 1024
}
