//! Capacity of an adapter in Gaussians.

use super::GpuStepper;
use crate::{device::GpuError, render::buffers::RenderShape};

impl GpuStepper<'_> {
    /// Returns the number of Gaussians for which the adapter's largest buffer suffices, with the initial
    /// capacity of tile entries.
    pub(super) fn room_for_gaussians(&self) -> usize {
        let tables = self.model.parts.iter().map(|part| {
            let arrays = part.table.arrays.iter();
            size_of::<f32>() * arrays.map(|array| array.width).sum::<usize>()
        });
        let largest = tables.max().unwrap_or(0);
        // Independent of the entries that this model's views have needed so far.
        let entries = RenderShape::first_entries(1);
        let shape = RenderShape {
            entries,
            ..self.shape(1)
        };
        let bytes = largest.max(shape.largest_buffer());
        usize::try_from(self.gpu.largest_buffer()).unwrap_or(usize::MAX) / bytes
    }

    /// Returns an error if the initial model exceeds the capacity.
    pub(super) fn check_room(&self) -> Result<(), GpuError> {
        let (needed, offered) = (self.model.len() as u64, self.room_for_gaussians() as u64);
        if needed <= offered {
            return Ok(());
        }
        Err(GpuError::TooSmall {
            adapter: self.gpu.adapter().name.clone(),
            what: "a model (Gaussians)".to_owned(),
            needed,
            offered,
        })
    }
}
