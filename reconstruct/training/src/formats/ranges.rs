//! Ranges of values that formats of Gaussians hold: writers clamp values outside.

use std::ops::RangeInclusive;

use omnilife_engine::gaussians::ActivatedGaussians;
use omnilife_schemas::records::AssetChanges;

/// Ranges of a format.
#[derive(Debug, Clone)]
pub struct ValueRanges {
    /// Natural logarithms of sizes, in the units of the file.
    pub log_sizes: RangeInclusive<f32>,
    /// Constant terms of colours (spherical harmonics of degree 0).
    pub constants: RangeInclusive<f32>,
    /// Coefficients of higher degrees.
    pub harmonics: RangeInclusive<f32>,
}

impl ValueRanges {
    /// All floats.
    pub(super) const ALL: Self = Self {
        log_sizes: f32::MIN..=f32::MAX,
        constants: f32::MIN..=f32::MAX,
        harmonics: f32::MIN..=f32::MAX,
    };

    /// Counts Gaussians whose largest size, or whose colour, a writer clamps. Second and third axes are not
    /// counted: beside the largest, one that is as thin as the format allows is thin still.
    pub fn count(&self, gaussians: &ActivatedGaussians, changes: &mut AssetChanges) {
        let largest = |sizes: &[f32; 3]| sizes.iter().fold(0.0_f32, |most, &size| most.max(size));
        let is_outside = |sizes: &&[f32; 3]| !self.log_sizes.contains(&largest(sizes).ln());
        changes.clamped_sizes = gaussians.scales.iter().filter(is_outside).count() as u64;
        let rest = gaussians.sh_rest.len() / gaussians.len().max(1);
        let mut harmonics = gaussians.sh_rest.chunks_exact(rest.max(1));
        let has_other_colour = |constant: &&[f32; 3]| {
            let higher = harmonics.next().unwrap_or_default().as_flattened();
            !constant.iter().all(|value| self.constants.contains(value))
                || !higher.iter().all(|value| self.harmonics.contains(value))
        };
        let colours = gaussians.sh_constant.iter();
        changes.clamped_colours = colours.filter(has_other_colour).count() as u64;
    }
}
