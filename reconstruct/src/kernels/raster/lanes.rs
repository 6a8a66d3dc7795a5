//! Arithmetic on a few neighbouring pixels at once, written so that it vectorizes.

use crate::kernels::{ALPHA_MAX, ALPHA_MIN, TILE, TRANSMITTANCE_MIN, project::Splat};

/// Pixels per vector step.
pub(super) const LANES: usize = 8;
/// Vector steps per row of a tile.
pub(super) const BLOCKS: usize = TILE / LANES;

pub(super) type Lanes = [f32; LANES];
/// One value per pixel of a tile: rows of blocks of lanes.
pub(super) type Plane = [[Lanes; BLOCKS]; TILE];

/// `exp(x)` for `x <= 0`, relative error below 1e-6 down to -6 and 1e-5 down to -80, where it stays;
/// branch-free so that it vectorizes.
#[inline(always)]
pub(super) fn exp_negative(x: f32) -> f32 {
    let x = x.max(-80.0);
    let scaled = x * std::f32::consts::LOG2_E;
    // Rounds to the nearest integer by pushing the fraction out of the mantissa.
    const ROUNDER: f32 = 12_582_912.0; // 1.5 * 2^23
    let shifted = scaled + ROUNDER;
    let f = scaled - (shifted - ROUNDER);
    // 2^f on [-1/2, 1/2], Taylor coefficients of exp(f ln 2) up to the sixth power.
    let mut p = 1.540_353e-4;
    p = p * f + 1.333_355_8e-3;
    p = p * f + 9.618_129e-3;
    p = p * f + 5.550_411e-2;
    p = p * f + 2.402_265e-1;
    p = p * f + 6.931_472e-1;
    p = p * f + 1.0;
    // The integer stands in the low bits of the shifted sum.
    let exponent = shifted
        .to_bits()
        .wrapping_sub(ROUNDER.to_bits())
        .wrapping_add(127)
        << 23;
    p * f32::from_bits(exponent)
}

/// `alpha` and the falloff `exp(-q/2)` of one splat on one block at row offset `y`.
#[inline(always)]
pub(super) fn block_alpha(splat: &Splat, offsets: &Lanes, y: f32, alive: &Lanes) -> (Lanes, Lanes) {
    let [a, b, c] = splat.conic;
    let (half_a, by, half_cyy) = (-0.5 * a, -b * y, -0.5 * c * y * y);
    let mut alpha = [0.0; LANES];
    let mut falloff = [0.0; LANES];
    for lane in 0..LANES {
        let x = offsets[lane];
        // Rounding can push the exponent of a needle above zero.
        let power = (half_a * x * x + by * x + half_cyy).min(0.0);
        falloff[lane] = exp_negative(power);
        let opacity = (splat.opacity * falloff[lane]).min(ALPHA_MAX) * alive[lane];
        alpha[lane] = if opacity >= ALPHA_MIN { opacity } else { 0.0 };
    }
    (alpha, falloff)
}

/// One step of compositing on one block: blends `alpha` unless a pixel has to stop before it.
/// Returns the weights `T alpha`; `alpha` is zeroed where the pixel stopped.
#[inline(always)]
pub(super) fn block_blend(
    alpha: &mut Lanes,
    transmittance: &mut Lanes,
    alive: &mut Lanes,
) -> Lanes {
    let mut weights = [0.0; LANES];
    for lane in 0..LANES {
        let next = transmittance[lane] * (1.0 - alpha[lane]);
        let go_on = if next < TRANSMITTANCE_MIN { 0.0 } else { 1.0 };
        alpha[lane] *= go_on;
        alive[lane] *= go_on;
        weights[lane] = transmittance[lane] * alpha[lane];
        transmittance[lane] *= 1.0 - alpha[lane];
    }
    weights
}

/// Whether every lane is +0.
#[inline(always)]
pub(super) fn all_zero(lanes: &Lanes) -> bool {
    lanes.iter().fold(0, |bits, lane| bits | lane.to_bits()) == 0
}

#[inline(always)]
pub(super) fn sum(lanes: &Lanes) -> f32 {
    let half: [f32; 4] = std::array::from_fn(|lane| lanes[lane] + lanes[lane + 4]);
    (half[0] + half[2]) + (half[1] + half[3])
}

#[inline(always)]
pub(super) fn sum_blocks(blocks: &[Lanes; BLOCKS]) -> f32 {
    blocks.iter().map(sum).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fast_exponential_is_the_exponential() {
        for step in 0..8000 {
            let x = -(step as f32) * 0.01;
            let exact = f64::from(x).exp();
            let error = (f64::from(exp_negative(x)) - exact).abs() / exact;
            assert!(error < 1e-5, "exp({x}) is off by {error}");
        }
        for step in 0..600 {
            let x = -(step as f32) * 0.01;
            let exact = f64::from(x).exp();
            let error = (f64::from(exp_negative(x)) - exact).abs() / exact;
            assert!(error < 1e-6, "exp({x}) is off by {error}");
        }
        assert!(exp_negative(f32::NEG_INFINITY) < 1e-30);
        assert_eq!(exp_negative(0.0), 1.0);
    }
}
