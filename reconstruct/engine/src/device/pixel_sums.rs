//! Forms of the sums over pixels in the backward pass of rasterization.

use std::env;

use crate::device::error::GpuError;

/// Environment variable that chooses between `pixels`, the default, and `splats`, for measurements.
const VARIABLE: &str = "OMNILIFE_GPU_SUMS";

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
    /// Returns the form with a thread per pixel, on a device whose smallest subgroup has this size, if any.
    pub(crate) fn over_threads(subgroup_size: Option<u32>) -> Self {
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

/// Returns true if the environment chooses a thread per splat.
///
/// # Errors
/// [`GpuError::Sums`] if the variable has another value than `pixels` or `splats`.
pub(crate) fn splats_are_chosen() -> Result<bool, GpuError> {
    env::var_os(VARIABLE).map_or(Ok(false), |value| are_splats(&value.to_string_lossy()))
}

fn are_splats(value: &str) -> Result<bool, GpuError> {
    match value {
        "pixels" => Ok(false),
        "splats" => Ok(true),
        _ => Err(GpuError::Sums {
            variable: VARIABLE,
            value: value.to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_form_is_chosen_by_its_name_alone() {
        assert_eq!(are_splats("pixels"), Ok(false));
        assert_eq!(are_splats("splats"), Ok(true));
        for other in ["", "splat", "Splats"] {
            let error = are_splats(other).expect_err("no form");
            assert!(
                matches!(&error, GpuError::Sums { value, .. } if value == other),
                "{error}"
            );
        }
    }
}
