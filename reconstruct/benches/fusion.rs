//! Time and memory of the fusion of panoramas with distances into a signed distance field.
//!
//! ```text
//! cargo bench --bench fusion -- SCENE SPLIT VOXEL [ROUNDS [SURFACE]]
//! ```
//!
//! `VOXEL` is in units of the scene (metres, where its scale is). `SURFACE` has points of another program's
//! surface of the same views: little-endian f32, three a point, world coordinates. Prints one line of JSON for
//! `scripts/compare fusion`: the best of the rounds, and the points' distances from this program's surface.

use std::{fs, path::Path, time::Instant};

use glam::{DVec3, Vec3};
use omnilife_engine::losses::scaffold::{Scaffold, fuse::FusedView};
use omnilife_reconstruct::{
    process::{own_cpu_time, peak_memory_bytes},
    scene::{CameraExtent, TrainingScene},
    seeds::depth::{lift::incidence, source_view::SourceView},
};
use omnilife_schemas::Similarity;

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| word != "--bench")
        .collect();
    let [scene, split, voxel, rest @ ..] = words.as_slice() else {
        // As `cargo bench` runs every bench, without arguments.
        println!("fusion: give SCENE SPLIT VOXEL [ROUNDS [SURFACE]]");
        return;
    };
    let voxel: f64 = voxel.parse().expect("a voxel's side");
    let rounds = rest
        .first()
        .map_or(3, |word| word.parse().expect("a number of rounds"));
    let scene = TrainingScene::load(Path::new(scene), Path::new(split), CameraExtent::Most)
        .expect("a scene");
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
        let (begun, begun_processor) = (Instant::now(), own_cpu_time().unwrap_or_default());
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
        let used = own_cpu_time().unwrap_or_default() - begun_processor;
        seconds = seconds.min(begun.elapsed().as_secs_f64());
        processor_seconds = processor_seconds.min(used.as_secs_f64());
        made = Some(field);
    }
    let field = made.expect("a round");
    let surface = rest.get(1).map(|path| {
        let bytes = fs::read(path).expect("a readable surface");
        let places = points_of(&bytes, &scene.normalization);
        distances_in_voxels(&field, &places, voxel)
    });
    let line = serde_json::json!({
        "name": "omnilife",
        "views": views.len(),
        "size": [views[0].distances.width, views[0].distances.height],
        "wall_seconds": seconds,
        "cpu_seconds": processor_seconds,
        "field_bytes": field.bytes(),
        "surface": surface,
        "peak_bytes": peak_memory_bytes().unwrap_or(0),
    });
    println!("{line}");
}

/// Returns the points of a file in normalized units.
fn points_of(bytes: &[u8], normalization: &Similarity) -> Vec<Vec3> {
    let values: Vec<f64> = bytes
        .as_chunks::<4>()
        .0
        .iter()
        .map(|value| f64::from(f32::from_le_bytes(*value)))
        .collect();
    let places = values.as_chunks::<3>().0.iter();
    places
        .map(|place| normalization.normalize(DVec3::from_array(*place)).as_vec3())
        .collect()
}

/// Returns distances of places from the surface of a field, in voxels, and the number of places that the field
/// covers.
fn distances_in_voxels(field: &Scaffold, places: &[Vec3], voxel: f32) -> serde_json::Value {
    let known = places.iter().filter_map(|&place| field.value(place));
    let mut distances: Vec<f32> = known.map(|known| known.distance.abs() / voxel).collect();
    distances.sort_unstable_by(f32::total_cmp);
    let quantile = |share: f64| {
        let last = distances.len().saturating_sub(1);
        distances.get((share * last as f64) as usize)
    };
    serde_json::json!({
        "points": places.len(),
        "known": distances.len(),
        "median_voxels": quantile(0.5),
        "p99_voxels": quantile(0.99),
    })
}
