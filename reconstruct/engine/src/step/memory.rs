//! Memory estimate of a step on the CPU.

use crate::{
    parameters::ArrayShape,
    render::project::{Cone, ConeGradient, Splat, SplatGradient},
};

/// Tile entries of a Gaussian of about a pixel.
const ENTRIES: u64 = 2;

/// Bytes per Gaussian in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepMemory {
    /// Bytes of a drawn Gaussian: parameters with moments, activated values, splat, places in the order of
    /// distances and in tile lists, and statistics for density control.
    pub drawn: u64,
    /// Additional bytes of a trained Gaussian: gradients of its parameters, of the activated values and of
    /// its entries.
    pub learning: u64,
}

impl StepMemory {
    /// Computes the bytes for Gaussians with these arrays, of which those named in `learns` are trained.
    pub fn of(arrays: &[ArrayShape], learns: &[&str]) -> Self {
        let bytes = |values: usize| (values * size_of::<f32>()) as u64;
        let values = bytes(arrays.iter().map(|array| array.width).sum());
        let learnt = arrays.iter().filter(|array| learns.contains(&array.name));
        let learnt = bytes(learnt.map(|array| array.width).sum());
        let splat = (size_of::<Splat>() + size_of::<Cone>()) as u64;
        let entry = (size_of::<SplatGradient>() + size_of::<ConeGradient>()) as u64;
        // Distance, order, rank and the sort's two pairs; start of its entries; two words per entry.
        let places = bytes(3 + 4 + 1) + ENTRIES * bytes(2);
        // Sum of gradients and number of views.
        let statistics = bytes(2);
        // Gradient of the centre's image; index of each entry among the trained ones.
        let of_backward = bytes(2) + ENTRIES * (entry + bytes(1));
        Self {
            drawn: 2 * values + 2 * learnt + splat + places + statistics,
            learning: learnt + 2 * values + of_backward,
        }
    }

    /// Returns the bytes of a step on `gaussians`, of which `learning` are trained at a time.
    pub fn bytes(&self, gaussians: u64, learning: u64) -> u64 {
        gaussians
            .saturating_mul(self.drawn)
            .saturating_add(learning.saturating_mul(self.learning))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussians::static_gaussians;

    #[test]
    fn what_learns_takes_more_and_less_where_few_learn_at_a_time() {
        let shapes = static_gaussians::shapes(0);
        let appearance = StepMemory::of(&shapes, &["opacity_logits", "sh_constant"]);
        let nothing = StepMemory::of(&shapes, &[]);
        // Two moments and a gradient of four values.
        assert_eq!(appearance.drawn - nothing.drawn, 32);
        assert_eq!(appearance.learning - nothing.learning, 16);
        let [whole, in_eighths] = [1_000_000, 125_000].map(|at| appearance.bytes(1_000_000, at));
        assert_eq!(whole - in_eighths, 875_000 * appearance.learning);
        assert!(in_eighths < 2 * whole / 3, "{in_eighths} of {whole}");
    }
}
