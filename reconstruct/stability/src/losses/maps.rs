//! Losses on maps of velocity, lifespan and opacity (Omni4DGS Eqs. 6 and 9, PVG). Uncovered pixels make them
//! divide by almost zero, and without counted pixels they are means over nothing.

use omnilife_engine::{
    EngineError,
    device::Gpu,
    losses::maps::{CountedPixels, lifespan_map, opacity_map, velocity_map},
    step::gpu::single_kernels::{self, RenderedMaps},
};

use super::compared;
use crate::{
    Limits,
    devices::{Device, panorama},
    special::{CaseResult, Runs, SpecialCase},
};

const PIXELS: usize = 60;
/// Added to the accumulated opacity before maps are divided by it (PVG).
const OPACITY_EPSILON: f64 = 1e-5;
const WEIGHT: f32 = 0.01;

/// Ten times the measured errors.
const LIMITS: Limits = Limits {
    forward: 2.5e-6,
    gradient: 8e-7,
};

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "maps-plain",
        title: "losses on maps of velocity, lifespan and opacity, for comparison",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &maps(0.5, 0.4, 1.0)),
    },
    SpecialCase {
        id: "maps-transparent",
        title: "losses on maps where a pixel is covered by a hundred-millionth at most",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &maps(1.0 - 1e-8, 1e-8, 1e-8)),
    },
    SpecialCase {
        id: "maps-opaque",
        title: "losses on maps where everything is covered, and moves by a millionth",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &maps(0.0, 0.0, 1e-6)),
    },
    SpecialCase {
        id: "maps-one-pixel",
        title: "losses on maps of which one pixel counts",
        runs: Runs::OnBoth,
        judge: |device| {
            let maps = Maps {
                counted: 1,
                ..maps(0.5, 0.4, 1.0)
            };
            judge(device, &maps)
        },
    },
    SpecialCase {
        id: "maps-no-pixel",
        title: "losses on maps of which no pixel counts",
        runs: Runs::OnBoth,
        judge: |device| {
            let maps = Maps {
                counted: 0,
                ..maps(0.5, 0.4, 1.0)
            };
            judge(device, &maps)
        },
    },
];

/// Composited maps, pixel after pixel.
struct Maps {
    transmittance: Vec<f32>,
    /// Three of velocities, one of lifespans, one of opacities.
    planes: [Vec<f32>; 5],
    /// Dynamic mask, 255 for all of a pixel.
    mask: Vec<u8>,
    /// Number of counted pixels.
    counted: usize,
}

/// Makes maps that are transparent by `base` and up to `spread` less, of values up to `size` either way.
fn maps(base: f64, spread: f64, size: f64) -> Maps {
    let wave = |seed: f64| -> Vec<f64> {
        (0..PIXELS)
            .map(|pixel| (1.7 * pixel as f64 + seed).sin())
            .collect()
    };
    let narrow =
        |values: Vec<f64>| -> Vec<f32> { values.into_iter().map(|value| value as f32).collect() };
    let transmittance: Vec<f64> = wave(0.1)
        .iter()
        .map(|v| base + spread * (0.5 + 0.5 * v))
        .collect();
    let plane = |number: usize| narrow(wave(number as f64).iter().map(|v| size * v).collect());
    Maps {
        transmittance: narrow(transmittance),
        planes: [0, 1, 2, 3, 4].map(plane),
        mask: wave(9.0)
            .iter()
            .map(|v| (255.0 * (0.5 + v).clamp(0.0, 1.0)).round() as u8)
            .collect(),
        counted: PIXELS,
    }
}

fn judge(device: &Device, maps: &Maps) -> CaseResult {
    let found = match device.gpu() {
        None => of_kernels(maps),
        Some(gpu) => match on_gpu(gpu, maps) {
            Ok(found) => found,
            Err(error) => return CaseResult::failed(error),
        },
    };
    compared(&found, &of_definition(maps), LIMITS)
}

/// Returns the marks of the pixels that do not count.
fn ignored(maps: &Maps) -> Vec<u8> {
    (0..PIXELS)
        .map(|pixel| u8::from(pixel >= maps.counted))
        .collect()
}

fn on_gpu(gpu: &Gpu, maps: &Maps) -> Result<(f64, Vec<f64>), EngineError> {
    let [x, y, z, lifespan, opacity] = &maps.planes;
    let rendered = RenderedMaps {
        transmittance: &maps.transmittance,
        temporal: [x, y, z, lifespan],
        opacity,
        mask: &maps.mask,
        ignored: &ignored(maps),
    };
    let view = panorama([PIXELS, 1]);
    let (value, gradient) = single_kernels::map_losses(gpu, &view, &rendered, WEIGHT)?;
    // The device's value is weighted.
    let gradient = gradient.into_iter().map(f64::from).collect();
    Ok((value / f64::from(WEIGHT), gradient))
}

fn of_kernels(maps: &Maps) -> (f64, Vec<f64>) {
    let ignored = ignored(maps);
    let counted = CountedPixels {
        ignored: Some(&ignored),
    };
    let mask: Vec<f32> = maps.mask.iter().map(|&byte| share(byte)).collect();
    let [x, y, z, lifespan, opacity] = &maps.planes;
    let velocities = [x.as_slice(), y, z].concat();
    let mut gradients = [vec![0.0; 3 * PIXELS], vec![0.0; PIXELS], vec![0.0; PIXELS]];
    let masked = (mask.as_slice(), counted);
    let [by_velocity, by_lifespan, by_opacity] = &mut gradients;
    let value = velocity_map(
        &velocities,
        &maps.transmittance,
        masked,
        WEIGHT,
        by_velocity,
    ) + lifespan_map(lifespan, &maps.transmittance, counted, WEIGHT, by_lifespan)
        + opacity_map(opacity, masked, WEIGHT, by_opacity);
    let gradient = gradients.concat().into_iter().map(f64::from).collect();
    (value, gradient)
}

/// Returns the masked share of a pixel.
fn share(byte: u8) -> f32 {
    f32::from(byte) / 255.0
}

/// Returns loss and gradients by the definitions in f64.
fn of_definition(maps: &Maps) -> (f64, Vec<f64>) {
    let weight = f64::from(WEIGHT) / maps.counted.max(1) as f64;
    let wide = |values: &[f32], pixel: usize| f64::from(values[pixel]);
    let sign = |value: f64| if value == 0.0 { 0.0 } else { value.signum() };
    let (mut value, mut gradient) = (0.0, vec![0.0; 5 * PIXELS]);
    for pixel in 0..maps.counted {
        let covered = 1.0 - wide(&maps.transmittance, pixel) + OPACITY_EPSILON;
        let masked = f64::from(share(maps.mask[pixel]));
        let outside = 1.0 - masked;
        for (number, plane) in maps.planes.iter().enumerate() {
            let found = wide(plane, pixel);
            let (term, slope) = match number {
                0..3 => {
                    let factor = outside / covered / 3.0;
                    (found.abs() * factor, sign(found) * factor)
                }
                3 => (-found / covered, -1.0 / covered),
                _ => {
                    let excess = found - masked;
                    (excess.abs(), sign(excess))
                }
            };
            value += term / maps.counted as f64;
            gradient[number * PIXELS + pixel] = weight * slope;
        }
    }
    (value, gradient)
}
