//! Selection of a moment's Gaussians, for rendering them alone.

use crate::gaussians::{ActivatedGaussians, sh_rest_count};

/// Copies the entries of `all` into `out`, each with a single feature of 1, which renders the opacity map.
pub fn gather(all: &ActivatedGaussians, entries: &[usize], out: &mut ActivatedGaussians) {
    let rest = sh_rest_count(all.sh_degree);
    out.reshape(entries.len(), all.sh_degree, 1);
    out.features.fill(1.0);
    for (to, &from) in entries.iter().enumerate() {
        out.positions[to] = all.positions[from];
        out.scales[to] = all.scales[from];
        out.rotations[to] = all.rotations[from];
        out.opacities[to] = all.opacities[from];
        out.sh_constant[to] = all.sh_constant[from];
        out.sh_rest[to * rest..(to + 1) * rest]
            .copy_from_slice(&all.sh_rest[from * rest..(from + 1) * rest]);
    }
}

/// Computes the VJP of [`gather`]: adds the gradient by the copies to that by their originals. The feature is
/// a constant.
pub fn gather_vjp(part: &ActivatedGaussians, entries: &[usize], out: &mut ActivatedGaussians) {
    fn add<const N: usize>(sum: &mut [f32; N], values: &[f32; N]) {
        for (sum, value) in sum.iter_mut().zip(values) {
            *sum += value;
        }
    }
    let rest = sh_rest_count(part.sh_degree);
    for (from, &to) in entries.iter().enumerate() {
        add(&mut out.positions[to], &part.positions[from]);
        add(&mut out.scales[to], &part.scales[from]);
        add(&mut out.rotations[to], &part.rotations[from]);
        out.opacities[to] += part.opacities[from];
        add(&mut out.sh_constant[to], &part.sh_constant[from]);
        for k in 0..rest {
            add(
                &mut out.sh_rest[to * rest + k],
                &part.sh_rest[from * rest + k],
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gaussians whose values all differ.
    fn numbered(len: usize, from: f32) -> ActivatedGaussians {
        let mut gaussians = ActivatedGaussians::default();
        gaussians.reshape(len, 1, 0);
        let mut next = from;
        let mut fill = |values: &mut [f32]| {
            for value in values {
                *value = next;
                next += 1.0;
            }
        };
        fill(gaussians.positions.as_flattened_mut());
        fill(gaussians.scales.as_flattened_mut());
        fill(gaussians.rotations.as_flattened_mut());
        fill(&mut gaussians.opacities);
        fill(gaussians.sh_constant.as_flattened_mut());
        fill(gaussians.sh_rest.as_flattened_mut());
        gaussians
    }

    fn dot(a: &ActivatedGaussians, b: &ActivatedGaussians) -> f32 {
        let sum = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        sum(a.positions.as_flattened(), b.positions.as_flattened())
            + sum(a.scales.as_flattened(), b.scales.as_flattened())
            + sum(a.rotations.as_flattened(), b.rotations.as_flattened())
            + sum(&a.opacities, &b.opacities)
            + sum(a.sh_constant.as_flattened(), b.sh_constant.as_flattened())
            + sum(a.sh_rest.as_flattened(), b.sh_rest.as_flattened())
    }

    #[test]
    fn the_vjp_is_the_transpose_of_the_copy() {
        let all = numbered(5, 1.0);
        let entries = [3, 0, 4];
        let mut part = ActivatedGaussians::default();
        gather(&all, &entries, &mut part);
        assert_eq!(part.positions[0], all.positions[3]);
        assert_eq!((part.features.len(), part.features[2]), (3, 1.0));
        let by_part = numbered(3, -20.0);
        let mut by_all = ActivatedGaussians::default();
        by_all.clear_to_zero(&all);
        gather_vjp(&by_part, &entries, &mut by_all);
        assert_eq!(dot(&part, &by_part), dot(&all, &by_all));
    }
}
