//! How many Gaussians an adapter has room for.

use super::GpuStepper;
use crate::{device::GpuError, render::buffers::RenderShape};

impl GpuStepper<'_> {
    /// Gaussians for which the largest buffer of the adapter suffices, where a view has no more entries in
    /// tiles than most have.
    pub(super) fn room_for_gaussians(&self) -> usize {
        let tables = self.model.parts.iter().map(|part| {
            let arrays = part.table.arrays.iter();
            size_of::<f32>() * arrays.map(|array| array.width).sum::<usize>()
        });
        let largest = tables.max().unwrap_or(0);
        // Whatever the views of this model have turned out to need.
        let entries = RenderShape::first_entries(1);
        let shape = RenderShape {
            entries,
            ..self.shape(1)
        };
        let bytes = largest.max(shape.largest_buffer());
        usize::try_from(self.gpu.largest_buffer()).unwrap_or(usize::MAX) / bytes
    }

    /// Refuses a model that has more from the beginning.
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
