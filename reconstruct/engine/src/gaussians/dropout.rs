//! Dropout of Gaussians (`DropGaussian`, Park et al., CVPR 2025): every training step leaves out a random
//! share of them and makes the others more opaque to compensate.
//!
//! In a region that few views see, Gaussians in front of each other can fit just these views and no other. If
//! any of them may be missing in the next step, each has to be right by itself. The share grows with the
//! iterations: `r_t = r t / T`. Images are drawn with all Gaussians.
//!
//! `dropout.wgsl` is the same for a GPU.

pub mod gpu;

use serde::{Deserialize, Serialize};

use super::ActivatedGaussians;

/// Dropout of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Dropout {
    /// Share of the Gaussians that the last step drops, in [0, 1).
    pub last_share: f32,
    /// Iterations of the schedule over which the share grows from 0.
    pub iterations: u64,
    /// Seed: runs of one seed drop the same Gaussians.
    pub seed: u32,
}

/// Dropout of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepDropout {
    share: f32,
    /// Hash of the seed and the iteration.
    step: u32,
}

impl Dropout {
    /// Returns the dropout of the step number `iteration` at the iteration `scheduled` of the schedule.
    pub fn of_step(&self, iteration: u64, scheduled: u64) -> StepDropout {
        let [low, high] = [iteration as u32, (iteration >> 32) as u32];
        let done = scheduled as f64 / self.iterations.max(1) as f64;
        StepDropout {
            share: self.last_share * done.min(1.0) as f32,
            step: pcg(low ^ pcg(high ^ pcg(self.seed))),
        }
    }
}

impl StepDropout {
    /// Returns the factor of the opacity of an entry: 0, or one over the share that is kept.
    pub fn weight(&self, entry: u32) -> f32 {
        // 24 bits, the precision of an f32 in [0, 1).
        let random = (pcg(entry ^ self.step) >> 8) as f32 / (1 << 24) as f32;
        if random < self.share {
            0.0
        } else {
            1.0 / (1.0 - self.share)
        }
    }

    /// Drops Gaussians. Opacities may exceed 1 afterwards; the rasterizer limits the alpha that it draws.
    pub fn drop_out(&self, gaussians: &mut ActivatedGaussians) {
        for (entry, opacity) in gaussians.opacities.iter_mut().enumerate() {
            *opacity *= self.weight(entry as u32);
        }
    }

    /// Turns gradients by the scaled Gaussians into those by the original ones, which it restores. Dropped
    /// Gaussians keep opacity 0 and get no gradient by it.
    pub fn drop_out_vjp(
        &self,
        gaussians: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    ) {
        let opacities = gaussians.opacities.iter_mut();
        for (entry, (opacity, by)) in opacities.zip(&mut gradient.opacities).enumerate() {
            let weight = self.weight(entry as u32);
            *by *= weight;
            if weight > 0.0 {
                *opacity /= weight;
            }
        }
    }
}

/// Computes the hash function PCG-RXS-M-XS of 32 bits (Jarzynski and Olano, JCGT 2020).
fn pcg(input: u32) -> u32 {
    let state = input.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

#[cfg(test)]
mod tests {
    use super::*;

    const DROPOUT: Dropout = Dropout {
        last_share: 0.4,
        iterations: 1_000,
        seed: 3,
    };

    #[test]
    fn the_share_is_left_out_another_one_in_every_step() {
        let weights = |iteration: u64| -> Vec<f32> {
            let step = DROPOUT.of_step(iteration, 500);
            (0..20_000).map(|entry| step.weight(entry)).collect()
        };
        let [first, second] = [1, 2].map(weights);
        for weights in [&first, &second] {
            let dropped = weights.iter().filter(|&&weight| weight == 0.0).count();
            // 20 %, within five standard deviations.
            assert!(dropped.abs_diff(4_000) < 283, "{dropped}");
            assert!(weights.iter().all(|&w| w == 0.0 || (w - 1.25).abs() < 1e-6));
        }
        let both = first.iter().zip(&second);
        let both = both.filter(|&(&one, &other)| one == 0.0 && other == 0.0);
        let both = both.count();
        assert!(both.abs_diff(800) < 140, "{both} of 800 in both");
        assert_eq!(first, weights(1));
        let other_seed = Dropout { seed: 4, ..DROPOUT };
        assert_ne!(DROPOUT.of_step(1, 500), other_seed.of_step(1, 500));
        assert_eq!(DROPOUT.of_step(1, 0).share, 0.0);
        assert_eq!(DROPOUT.of_step(1, 5_000).share, 0.4);
    }

    #[test]
    fn the_gradient_is_that_by_what_there_was() {
        let mut gaussians = ActivatedGaussians::default();
        gaussians.reshape(50, 0, 0);
        let before: Vec<f32> = (0..50).map(|entry| 0.01 + 0.019 * entry as f32).collect();
        gaussians.opacities.clone_from(&before);
        let step = DROPOUT.of_step(7, 500);
        step.drop_out(&mut gaussians);
        // Loss `sum_i (i + 1) o_i` of the scaled opacities.
        let mut gradient = ActivatedGaussians::default();
        gradient.reshape(50, 0, 0);
        gradient.opacities = (0..50).map(|entry| entry as f32 + 1.0).collect();
        step.drop_out_vjp(&mut gaussians, &mut gradient);
        for (entry, &opacity) in before.iter().enumerate() {
            let weight = step.weight(entry as u32);
            assert_eq!(gradient.opacities[entry], weight * (entry as f32 + 1.0));
            let expected = if weight > 0.0 { opacity } else { 0.0 };
            assert!((gaussians.opacities[entry] - expected).abs() < 1e-6);
        }
    }
}
