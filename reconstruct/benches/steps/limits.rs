//! Rasterization beside the limits of the CPU: Gaussian-pixel evaluations per second
//! and operations per second on one thread, beside the machine's own limits measured in the same
//! run.
//!
//! An evaluation is a Gaussian's opacity, at least 1/255, in a pixel that has not stopped, with all operations
//! that follow from it. Lanes outside of a footprint are work but not evaluations: they lower the rate.
//! Operations per evaluation are counted in the formulas of `render/raster/mod.rs` as written (a fused
//! multiply-add is two), not in the compiler's output.

use std::{error::Error, hint::black_box, time::Instant};

use fearless_simd::{Level, Simd, dispatch, f32x8, prelude::*};
use omnilife_engine::{
    camera::rays::Rays,
    gaussians::static_gaussians,
    render::{
        bin::{TileLists, cpu::Binner},
        project::{self, Shape, Splats},
        settings::{ALPHA_MAX, ALPHA_MIN, RenderSettings, TILE, TRANSMITTANCE_MIN},
        sort::{self, cpu::SortScratch},
    },
};

use crate::{iteration::Iteration, number};

/// Forward: square of the offset and its row (4), `2^t` (13), weight and transmittance (2), three
/// colours (6).
const FORWARD_OPERATIONS: f64 = 25.0;
/// Backward: opacity and transmittance as forward (19); `g . c` (5), colours' gradient (6), the part behind (2),
/// by opacity (4 and a division), by its logarithm (2), moments of the shape (11).
const BACKWARD_OPERATIONS: f64 = 50.0;
/// Rounds, of which the fastest counts.
const ROUNDS: usize = 15;

/// Measures one size on one thread and prints rates and shares.
pub(crate) fn run(words: &[&str]) -> Result<(), Box<dyn Error>> {
    let (count, width) = (
        number::<usize>(words, 0, 50_000)?,
        number::<u32>(words, 1, 512)?,
    );
    assert_eq!(
        rayon::current_num_threads(),
        1,
        "limits are of one thread: RAYON_NUM_THREADS=1"
    );
    let settings = RenderSettings::new(0.01);
    let mut iteration = Iteration::new(count, width, settings);
    let evaluations = evaluations(&iteration, &settings) as f64;
    // Memory traffic of a Gaussian's evaluations in a tile, beside the planes, which stay in the first cache: its
    // splat, and its gradient.
    let (mut peak, mut bandwidth) = (0.0_f64, 0.0_f64);
    let mut best = [f64::INFINITY; 2];
    for _ in 0..ROUNDS {
        peak = peak.max(multiply_adds_per_second());
        bandwidth = bandwidth.max(bytes_per_second());
        iteration.run(|name, seconds| match name {
            "raster" => best[0] = best[0].min(seconds),
            "raster backward" => best[1] = best[1].min(seconds),
            _ => {}
        });
    }
    println!("{count} Gaussians, {width}x{}, one thread", width / 2);
    println!(
        "machine: {:.1} Gflop/s in 8 lanes of f32, {:.1} GB/s copied",
        peak * 1e-9,
        bandwidth * 1e-9
    );
    println!("evaluations: {:.2} million", evaluations * 1e-6);
    let stages = ["raster", "raster backward"];
    let operations = [FORWARD_OPERATIONS, BACKWARD_OPERATIONS];
    for ((stage, seconds), operations) in stages.iter().zip(best).zip(operations) {
        let rate = evaluations / seconds;
        println!(
            "{stage:16} {:7.2} ms  {:6.1} million evaluations/s  {:5.2} Gflop/s  {:4.1} % of the limit",
            seconds * 1e3,
            rate * 1e-6,
            rate * operations * 1e-9,
            100.0 * rate * operations / peak
        );
    }
    Ok(())
}

/// Counts the evaluations of one forward pass, by plain loops over the tiles' lists.
fn evaluations(iteration: &Iteration, settings: &RenderSettings) -> u64 {
    let rays = Rays::new(iteration.view.camera);
    let mut instant = iteration.instant.clone();
    static_gaussians::activate(&iteration.table, &mut instant);
    let (mut splats, mut distances) = (Splats::default(), Vec::new());
    project::cpu::forward(
        &iteration.view,
        &instant,
        settings,
        &mut splats,
        &mut distances,
    );
    let (mut order, mut ranks, mut scratch) = (Vec::new(), Vec::new(), SortScratch::default());
    sort::cpu::by_distance(&distances, &mut order, &mut ranks, &mut scratch);
    let mut lists = TileLists::default();
    Binner::new(&rays).forward(&splats, &order, &mut lists);
    let (width, height) = (rays.camera.width() as usize, rays.camera.height() as usize);
    let columns = width.div_ceil(TILE);
    (0..width * height)
        .map(|pixel| {
            let (column, row) = (pixel % width, pixel / width);
            let mut transmittance = 1.0_f32;
            let mut count = 0;
            for place in lists.tile(row / TILE * columns + column / TILE) {
                let alpha = alpha(&splats, lists.splat(place), &rays, column, row);
                if alpha < ALPHA_MIN {
                    continue;
                }
                let next = transmittance * (1.0 - alpha.min(ALPHA_MAX));
                if next < TRANSMITTANCE_MIN {
                    break;
                }
                count += 1;
                transmittance = next;
            }
            count
        })
        .sum()
}

fn alpha(splats: &Splats, index: usize, rays: &Rays, column: usize, row: usize) -> f32 {
    let splat = &splats.all[index];
    let q = match &splat.shape {
        Shape::Ellipse(ellipse) => {
            let width = rays.camera.width() as f32;
            let x = column as f32 + 0.5 - splat.centre[0];
            let x = x - width * (x / width).round();
            let y = row as f32 + 0.5 - splat.centre[1];
            let across = x - ellipse.slope * y;
            across * across * ellipse.inverse_variance + y * y * ellipse.inverse_row_variance
        }
        Shape::Cone => {
            let cone = &splats.cones[index];
            let ray = rays.ray(column, row);
            let n = cone.across.iter().map(|f| f.dot(ray).powi(2)).sum::<f32>();
            let along = cone.along.dot(ray).max(0.0);
            n / (along * along + cone.depth_variance * n)
        }
    };
    (splat.log2_opacity - 0.5 * std::f32::consts::LOG2_E * q).exp2()
}

/// Returns operations per second of independent fused multiply-adds on 8 lanes, in registers.
fn multiply_adds_per_second() -> f64 {
    const STEPS: usize = 2_000_000;
    let begun = Instant::now();
    let sum = dispatch!(Level::new(), simd => multiply_adds(simd, STEPS));
    let seconds = begun.elapsed().as_secs_f64();
    black_box(sum);
    (STEPS * CHAINS * 8 * 2) as f64 / seconds
}

/// Chains of multiply-adds: more than the latency of one times the units of a core.
const CHAINS: usize = 12;

#[inline(always)]
fn multiply_adds<S: Simd>(simd: S, steps: usize) -> f32 {
    let factor = f32x8::splat(simd, black_box(0.999_9));
    let mut chains = [f32x8::splat(simd, black_box(1e-4)); CHAINS];
    for _ in 0..steps {
        for chain in &mut chains {
            *chain = factor.mul_add(*chain, factor);
        }
    }
    chains.iter().map(|chain| chain.reduce_sum()).sum()
}

/// Returns bytes per second of a copy beyond all caches, read and written.
fn bytes_per_second() -> f64 {
    const BYTES: usize = 1 << 27;
    let source = vec![1_u8; BYTES];
    // Not zeros: the system would hand out the pages during the copy.
    let mut target = vec![2_u8; BYTES];
    let begun = Instant::now();
    target.copy_from_slice(black_box(&source));
    let seconds = begun.elapsed().as_secs_f64();
    black_box(&target);
    2.0 * BYTES as f64 / seconds
}
