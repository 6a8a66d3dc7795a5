//! Arithmetic on 8 neighbouring pixels at once.

use fearless_simd::{Simd, f32x8, prelude::*};

use crate::render::settings::{ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN};

/// Pixels per vector step.
pub(super) const LANES: usize = 8;

/// `0, 1, 2 ...`
const STEPS: [f32; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

#[inline(always)]
pub(super) fn steps<S: Simd>(simd: S) -> f32x8<S> {
    STEPS.simd_into(simd)
}

#[inline(always)]
pub(super) fn load<S: Simd>(simd: S, values: &[f32], at: usize) -> f32x8<S> {
    f32x8::from_slice(simd, &values[at..at + LANES])
}

#[inline(always)]
pub(super) fn store<S: Simd>(vector: f32x8<S>, values: &mut [f32], at: usize) {
    vector.store_slice(&mut values[at..at + LANES]);
}

/// Returns the sums over the lanes of 8 vectors, with every addition on 8 of them at once.
#[inline(always)]
pub(super) fn transposed_sums<S: Simd>(vectors: [f32x8<S>; 8]) -> [f32; 8] {
    let [a, b, c, d, e, f, g, h] = vectors;
    let fold = |x: f32x8<S>, y: f32x8<S>| x.zip_low(y) + x.zip_high(y);
    let (ab, cd, ef, gh) = (fold(a, b), fold(c, d), fold(e, f), fold(g, h));
    let [a, e, c, g, b, f, d, h]: [f32; 8] = fold(fold(ab, cd), fold(ef, gh)).into();
    [a, b, c, d, e, f, g, h]
}

/// Returns `2^t` for `t` in [-100, 0], relative error below 3e-7.
#[inline(always)]
pub(super) fn exp2<S: Simd>(simd: S, t: f32x8<S>) -> f32x8<S> {
    // Rounds to the nearest integer by pushing the fraction out of the mantissa.
    const ROUNDER: f32 = 12_582_912.0; // 1.5 * 2^23
    let shifted = t + ROUNDER;
    let f = t - (shifted - ROUNDER);
    // Minimax polynomial of degree 5 for 2^f on [-1/2, 1/2], relative error 7.5e-8.
    let coefficient = |value: f32| f32x8::splat(simd, value);
    let p = coefficient(1.327_646_9e-3)
        .mul_add(f, coefficient(9.675_543e-3))
        .mul_add(f, coefficient(5.550_713_3e-2))
        .mul_add(f, coefficient(2.402_212e-1))
        .mul_add(f, coefficient(0.693_146_95))
        .mul_add(f, coefficient(1.0));
    // The integer is in the low bits of the shifted sum: add it to the exponent.
    f32x8::from_bits(p.to_bits() + (shifted.to_bits() << 23))
}

/// Opacity of a splat in 8 pixels.
#[derive(Clone, Copy)]
pub(super) struct Alpha<S: Simd> {
    /// `o exp(-q/2)`.
    pub(super) unclamped: f32x8<S>,
    /// Clamped at 0.99, and 0 below 1/255.
    pub(super) value: f32x8<S>,
}

/// Returns opacities from their binary logarithms, which are at most 0.
#[inline(always)]
pub(super) fn alpha<S: Simd>(simd: S, log2: f32x8<S>) -> Alpha<S> {
    // Far outside the footprint the logarithm is unbounded.
    let unclamped = exp2(simd, log2.max(-16.0));
    let is_seen = unclamped.simd_ge(ALPHA_MIN);
    Alpha {
        unclamped,
        value: is_seen.select(unclamped.min(ALPHA_MAX), f32x8::splat(simd, 0.0)),
    }
}

/// One step of compositing.
#[derive(Clone, Copy)]
pub(super) struct Blend<S: Simd> {
    /// `T alpha`, 0 once the pixel has stopped.
    pub(super) weights: f32x8<S>,
    /// Transmittance behind the splat; negative once the pixel has stopped.
    pub(super) transmittance: f32x8<S>,
}

/// Blends `alpha`, unless a pixel must stop before it. A pixel that has stopped keeps its transmittance with
/// a negative sign.
#[inline(always)]
pub(super) fn blend<S: Simd>(simd: S, alpha: f32x8<S>, transmittance: f32x8<S>) -> Blend<S> {
    let weights = transmittance * alpha;
    let next = transmittance - weights;
    let goes_on = next.simd_ge(TRANSMITTANCE_MIN);
    Blend {
        weights: goes_on.select(weights, f32x8::splat(simd, 0.0)),
        transmittance: goes_on.select(next, -transmittance.abs()),
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;

    #[test]
    fn transposed_sums_are_the_sums() {
        let vectors: [[f32; LANES]; 8] = std::array::from_fn(|v| {
            std::array::from_fn(|lane| (v * v * 10 + lane * v + lane) as f32)
        });
        let sums = dispatch!(Level::new(), simd => {
            transposed_sums(vectors.map(|vector| f32x8::simd_from(simd, vector)))
        });
        assert_eq!(sums, vectors.map(|vector| vector.iter().sum::<f32>()));
    }

    #[test]
    fn fast_exponential_is_the_exponential() {
        for step in 0..4000 {
            let t = -(step as f32) * 0.025;
            let exact = f64::from(t).exp2();
            let fast =
                dispatch!(Level::new(), simd => exp2(simd, f32x8::splat(simd, t)).to_array()[3]);
            let error = (f64::from(fast) - exact).abs() / exact;
            assert!(error < 3e-7, "2^{t} is off by {error}");
        }
    }
}
