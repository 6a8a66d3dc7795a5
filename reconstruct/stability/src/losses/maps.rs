//! Losses on maps of velocity, lifespan and opacity (Omni4DGS Eqs. 6 and 9, PVG). Uncovered pixels make them
//! divide by almost zero, and without counted pixels they are means over nothing.

use omnilife_engine::losses::maps::{Counted, lifespan_map, opacity_map, velocity_map};

use super::compared;
use crate::{
    Limits,
    special::{Judgement, SpecialCase},
};

const PIXELS: usize = 60;
/// Added to the accumulated opacity before maps are divided by it (PVG).
const OPACITY_EPSILON: f64 = 1e-5;
const WEIGHT: f32 = 0.01;

/// Ten times the measured errors.
const LIMITS: Limits = Limits {
    forward: 1e-5,
    gradient: 1e-5,
};

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "maps-plain",
        title: "losses on maps of velocity, lifespan and opacity, for comparison",
        judge: || judge(&maps(0.5, 0.4, 1.0)),
    },
    SpecialCase {
        id: "maps-transparent",
        title: "losses on maps where a pixel is covered by a hundred-millionth at most",
        judge: || judge(&maps(1.0 - 1e-8, 1e-8, 1e-8)),
    },
    SpecialCase {
        id: "maps-opaque",
        title: "losses on maps where everything is covered, and moves by a millionth",
        judge: || judge(&maps(0.0, 0.0, 1e-6)),
    },
    SpecialCase {
        id: "maps-one-pixel",
        title: "losses on maps of which one pixel counts",
        judge: || {
            judge(&Maps {
                counted: 1,
                ..maps(0.5, 0.4, 1.0)
            })
        },
    },
    SpecialCase {
        id: "maps-no-pixel",
        title: "losses on maps of which no pixel counts",
        judge: || {
            judge(&Maps {
                counted: 0,
                ..maps(0.5, 0.4, 1.0)
            })
        },
    },
];

/// Composited maps, pixel after pixel.
struct Maps {
    transmittance: Vec<f32>,
    /// Three of velocities, one of lifespans, one of opacities.
    planes: [Vec<f32>; 5],
    mask: Vec<f32>,
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
        mask: narrow(
            wave(9.0)
                .iter()
                .map(|v| (0.5 + v).clamp(0.0, 1.0))
                .collect(),
        ),
        counted: PIXELS,
    }
}

fn judge(maps: &Maps) -> Judgement {
    compared(&of_kernels(maps), &of_definition(maps), LIMITS)
}

fn of_kernels(maps: &Maps) -> (f64, Vec<f64>) {
    let ignored: Vec<u8> = (0..PIXELS)
        .map(|pixel| u8::from(pixel >= maps.counted))
        .collect();
    let counted = Counted {
        ignored: Some(&ignored),
    };
    let [x, y, z, lifespan, opacity] = &maps.planes;
    let velocities = [x.as_slice(), y, z].concat();
    let mut gradients = [vec![0.0; 3 * PIXELS], vec![0.0; PIXELS], vec![0.0; PIXELS]];
    let masked = (maps.mask.as_slice(), counted);
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

/// Returns loss and gradients by the definitions in f64.
fn of_definition(maps: &Maps) -> (f64, Vec<f64>) {
    let weight = f64::from(WEIGHT) / maps.counted.max(1) as f64;
    let wide = |values: &[f32], pixel: usize| f64::from(values[pixel]);
    let sign = |value: f64| if value == 0.0 { 0.0 } else { value.signum() };
    let (mut value, mut gradient) = (0.0, vec![0.0; 5 * PIXELS]);
    for pixel in 0..maps.counted {
        let covered = 1.0 - wide(&maps.transmittance, pixel) + OPACITY_EPSILON;
        let outside = 1.0 - wide(&maps.mask, pixel);
        for (number, plane) in maps.planes.iter().enumerate() {
            let found = wide(plane, pixel);
            let (term, slope) = match number {
                0..3 => {
                    let factor = outside / covered / 3.0;
                    (found.abs() * factor, sign(found) * factor)
                }
                3 => (-found / covered, -1.0 / covered),
                _ => {
                    let excess = found - wide(&maps.mask, pixel);
                    (excess.abs(), sign(excess))
                }
            };
            value += term / maps.counted as f64;
            gradient[number * PIXELS + pixel] = weight * slope;
        }
    }
    (value, gradient)
}
