//! CPU milliseconds per stage of a training iteration, for one size.

use std::{error::Error, fs, path::Path, time::Instant};

use omnilife_engine::render::settings::{Footprint, RenderSettings};
use omnilife_reconstruct::process::{own_cpu_time, peak_memory_bytes};

use crate::{iteration::Iteration, number};

const NEAR: f32 = 0.01;
const WARM_UP: usize = 3;
const ITERATIONS: usize = 15;

/// Measures one size and prints lines for people, or one line of JSON.
pub(crate) fn run(words: &[&str]) -> Result<(), Box<dyn Error>> {
    let mut words = words.to_vec();
    let as_json = take(&mut words, "--json").is_some();
    let folder = match take(&mut words, "--export") {
        Some(at) if at < words.len() => Some(words.remove(at)),
        Some(_) => return Err("profile: --export needs a folder".into()),
        None => None,
    };
    let (count, width) = (
        number::<usize>(&words, 0, 50_000)?,
        number::<u32>(&words, 1, 512)?,
    );
    let mut settings = RenderSettings::new(NEAR);
    if words.get(2) == Some(&"ray") {
        settings.footprint = Footprint::Ray;
    }
    let mut iteration = Iteration::new(count, width, settings);
    if let Some(folder) = folder {
        export(&iteration, Path::new(folder))?;
    }
    let loss = iteration.run(|_, _| {});
    for _ in 1..WARM_UP {
        iteration.run(|_, _| {});
    }
    let mut stages: Vec<(&str, f64)> = Vec::new();
    let (mut wall, mut processor) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..ITERATIONS {
        let (begun, begun_processor) = (
            Instant::now(),
            own_cpu_time().unwrap_or_default().as_secs_f64(),
        );
        let mut stage = 0;
        iteration.run(|name, seconds| {
            match stages.get_mut(stage) {
                Some(best) => best.1 = best.1.min(seconds),
                None => stages.push((name, seconds)),
            }
            stage += 1;
        });
        wall = wall.min(begun.elapsed().as_secs_f64());
        processor =
            processor.min(own_cpu_time().unwrap_or_default().as_secs_f64() - begun_processor);
    }
    let peak_bytes = peak_memory_bytes().unwrap_or(0);
    if as_json {
        let stages: serde_json::Map<String, serde_json::Value> = stages
            .iter()
            .map(|(name, seconds)| ((*name).to_owned(), (*seconds).into()))
            .collect();
        let line = serde_json::json!({
            "name": "omnilife",
            "wall_seconds": wall,
            "processor_seconds": processor,
            "loss": loss,
            "peak_bytes": peak_bytes,
            "threads": rayon::current_num_threads(),
            "stages": stages,
        });
        println!("{line}");
        return Ok(());
    }
    for (name, seconds) in &stages {
        println!("{name:20} {:8.2} ms", seconds * 1e3);
    }
    println!("{:20} {:8.2} ms", "all", processor * 1e3);
    println!(
        "{:20} {:8.2} ms on {} threads",
        "wall clock",
        wall * 1e3,
        rayon::current_num_threads()
    );
    println!("{:20} {:8.2} MB", "peak memory", peak_bytes as f64 / 1e6);
    Ok(())
}

/// Removes a word and returns its index.
fn take(words: &mut Vec<&str>, word: &str) -> Option<usize> {
    let at = words.iter().position(|candidate| *candidate == word)?;
    words.remove(at);
    Some(at)
}

/// Writes raw parameters, target and camera as little-endian f32 files and `scene.json`.
fn export(iteration: &Iteration, folder: &Path) -> std::io::Result<()> {
    fs::create_dir_all(folder)?;
    let write = |name: &str, values: &[f32]| {
        let bytes: Vec<u8> = values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        fs::write(folder.join(format!("{name}.f32")), bytes)
    };
    let mut arrays = serde_json::Map::new();
    for array in &iteration.table.arrays {
        arrays.insert(array.name.to_owned(), array.width.into());
        write(array.name, &array.values)?;
    }
    write("target", &iteration.target)?;
    let view = &iteration.view;
    let scene = serde_json::json!({
        "width": view.camera.width(),
        "height": view.camera.height(),
        "near": NEAR,
        // Row by row.
        "rotation": view.rotation.transpose().to_cols_array(),
        "arrays": arrays,
    });
    fs::write(folder.join("scene.json"), scene.to_string())
}
