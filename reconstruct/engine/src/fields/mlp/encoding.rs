//! Positional encoding, without which a network of this size would smooth away detail.
//!
//! ```text
//! PE(x) = (x, sin x, cos x, sin 2x, cos 2x, ..., sin 2^(L-1) x, cos 2^(L-1) x)
//! ```
//!
//! Components of `x` are grouped: all sines of an octave, then all cosines (Deformable-3D-Gaussians
//! `utils/time_utils.py`).

/// Returns the number of values that encode a vector of `dimensions` with `octaves`.
pub const fn width(dimensions: usize, octaves: usize) -> usize {
    dimensions * (1 + 2 * octaves)
}

/// Encodes `values` into `out`, whose length must be [`width`] of their dimensions and `octaves`.
pub fn encode(values: &[f32], octaves: usize, out: &mut [f32]) {
    debug_assert_eq!(out.len(), width(values.len(), octaves));
    let dimensions = values.len();
    out[..dimensions].copy_from_slice(values);
    let mut frequency = 1.0;
    for octave in out[dimensions..].chunks_exact_mut(2 * dimensions) {
        let (sines, cosines) = octave.split_at_mut(dimensions);
        for ((value, sine), cosine) in values.iter().zip(sines).zip(cosines) {
            (*sine, *cosine) = (value * frequency).sin_cos();
        }
        frequency *= 2.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_of_every_octave_follow_the_values() {
        let mut out = vec![0.0; width(2, 3)];
        encode(&[0.3, -1.2], 3, &mut out);
        assert_eq!(out[..2], [0.3, -1.2]);
        for octave in 0..3 {
            for (axis, value) in [0.3_f64, -1.2].into_iter().enumerate() {
                let angle = value * f64::from(1 << octave);
                let at = 2 + 4 * octave + axis;
                assert!((f64::from(out[at]) - angle.sin()).abs() < 1e-6);
                assert!((f64::from(out[at + 2]) - angle.cos()).abs() < 1e-6);
            }
        }
    }
}
