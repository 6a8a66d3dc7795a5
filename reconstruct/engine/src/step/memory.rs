//! What a step on the CPU takes of memory, before it is taken.

use crate::{
    parameters::ArrayShape,
    render::project::{Cone, ConeGradient, Splat, SplatGradient},
};

/// Entries in tile lists of a Gaussian of about a pixel.
const ENTRIES: u64 = 2;

/// Bytes of a Gaussian in a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepMemory {
    /// Of one that is drawn: its parameters with their moments, what they are activated to, its splat, its places
    /// in the order of distances and in tile lists, and what density control knows of it.
    pub drawn: u64,
    /// Of one that learns, beside that: gradients of its parameters, of what they are activated to and of its
    /// entries.
    pub learning: u64,
}

impl StepMemory {
    /// For Gaussians with these arrays, of which those named in `learns` learn.
    pub fn of(arrays: &[ArrayShape], learns: &[&str]) -> Self {
        let bytes = |values: usize| (values * size_of::<f32>()) as u64;
        let values = bytes(arrays.iter().map(|array| array.width).sum());
        let learnt = arrays.iter().filter(|array| learns.contains(&array.name));
        let learnt = bytes(learnt.map(|array| array.width).sum());
        let splat = (size_of::<Splat>() + size_of::<Cone>()) as u64;
        let entry = (size_of::<SplatGradient>() + size_of::<ConeGradient>()) as u64;
        // Distance, order, rank and the sort's two pairs; the beginning of its entries; two words for each.
        let places = bytes(3 + 4 + 1) + ENTRIES * bytes(2);
        // Sum of gradients and number of views.
        let statistics = bytes(2);
        // Gradient of the centre's image; the place of each entry among those that learn.
        let of_backward = bytes(2) + ENTRIES * (entry + bytes(1));
        Self {
            drawn: 2 * values + 2 * learnt + splat + places + statistics,
            learning: learnt + 2 * values + of_backward,
        }
    }

    /// Bytes of a step on `gaussians`, of which `learning` learn at a time.
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
