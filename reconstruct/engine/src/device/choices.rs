//! Choices between kernels that compute the same, so that a card can tell which is faster.

use std::env;

use crate::device::error::GpuError;

/// Environment variable that chooses the threads of sums over pixels, and its values; the first is the default.
const SUMS: (&str, [&str; 2]) = ("OMNILIFE_GPU_SUMS", ["pixels", "splats"]);
/// Environment variable that chooses the kernels of Adam, and its values; the first is the default.
const ADAM: (&str, [&str; 2]) = ("OMNILIFE_GPU_ADAM", ["separate", "fused"]);

/// Kernels that stand for others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KernelChoices {
    /// True if gradients of splats are summed over pixels by a thread per splat.
    pub sums_per_splat: bool,
    /// True if one kernel computes everything from the gradients by splats to Adam's step. Only models of static
    /// Gaussians can be trained then.
    pub fused_adam: bool,
}

impl KernelChoices {
    /// Returns the choices of the environment.
    ///
    /// # Errors
    /// [`GpuError::Choice`] if a variable has an unknown value.
    pub(crate) fn of_environment() -> Result<Self, GpuError> {
        let chosen = |of: (&'static str, [&'static str; 2])| {
            let value = env::var_os(of.0);
            value.map_or(Ok(false), |value| is_second(of, &value.to_string_lossy()))
        };
        Ok(Self {
            sums_per_splat: chosen(SUMS)?,
            fused_adam: chosen(ADAM)?,
        })
    }
}

/// Returns true if a variable has the second of its values.
fn is_second(
    (variable, values): (&'static str, [&'static str; 2]),
    value: &str,
) -> Result<bool, GpuError> {
    let known = values.iter().position(|&known| known == value);
    known.map(|number| number == 1).ok_or_else(|| {
        let [first, second] = values;
        GpuError::Choice {
            variable,
            values: format!("{first} or {second}"),
            value: value.to_owned(),
        }
    })
}

/// Form in which a device sums a splat's gradient over the pixels of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelSums {
    /// A thread per pixel, and sums over the threads of subgroups; with the size of the smallest subgroup.
    Subgroups(u32),
    /// A thread per pixel, and sums over the threads of a workgroup in its memory.
    Workgroups,
    /// A thread per splat, without sums over threads (Taming-3DGS, Faster-GS).
    Splats,
}

impl PixelSums {
    /// Returns the form on a device whose smallest subgroup has this size, if any.
    pub(crate) fn new(choices: KernelChoices, subgroup_size: Option<u32>) -> Self {
        if choices.sums_per_splat {
            return Self::Splats;
        }
        subgroup_size.map_or(Self::Workgroups, Self::Subgroups)
    }

    /// Returns the threads of the smallest subgroup, if sums are taken over subgroups.
    pub(crate) fn subgroup_size(self) -> Option<u32> {
        match self {
            Self::Subgroups(size) => Some(size),
            Self::Workgroups | Self::Splats => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_are_chosen_by_their_names_alone() {
        assert_eq!(is_second(SUMS, "pixels"), Ok(false));
        assert_eq!(is_second(SUMS, "splats"), Ok(true));
        assert_eq!(is_second(ADAM, "fused"), Ok(true));
        for other in ["", "splat", "Splats", "fused"] {
            let error = is_second(SUMS, other).expect_err("unknown");
            assert!(
                matches!(&error, GpuError::Choice { value, .. } if value == other),
                "{error}"
            );
        }
    }

    #[test]
    fn sums_per_splat_need_no_subgroups() {
        let per_splat = KernelChoices {
            sums_per_splat: true,
            ..KernelChoices::default()
        };
        for size in [None, Some(8)] {
            assert_eq!(PixelSums::new(per_splat, size), PixelSums::Splats);
            let over_threads = PixelSums::new(KernelChoices::default(), size);
            assert_eq!(over_threads.subgroup_size(), size);
        }
    }
}
