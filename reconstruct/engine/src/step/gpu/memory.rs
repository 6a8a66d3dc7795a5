//! Memory of training on a GPU, counted without allocating it.

use std::sync::Arc;

use super::{
    GpuStepper,
    device_model::{PartTables, copies_with_room},
};
use crate::{
    EngineError,
    device::{BufferDemand, Gpu, GpuError, adapters::AdapterSummary},
    model::{Model, Part},
    step::settings::TrainSettings,
    training_view::InputViews,
};

/// Memory of training on the first GPU, at the maximum size of the model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DevicePlan {
    /// The adapter.
    pub adapter: AdapterSummary,
    /// Maximum number of Gaussians; `None` for other models.
    pub gaussians: Option<usize>,
    /// All buffers, with the first room for tile entries: views that need more enlarge it.
    pub buffers: BufferDemand,
    /// Largest buffer that the adapter allows, bytes.
    pub largest_allowed: u64,
    /// Reason for which the adapter does not hold them; `None` if it does.
    pub refusal: Option<GpuError>,
}

impl DevicePlan {
    /// Counts the buffers of training and tries to allocate as many bytes.
    ///
    /// # Errors
    /// If there is no GPU, it fails, or it cannot train the model under these settings.
    pub fn of(
        inputs: InputViews<'_>,
        model: Model,
        settings: &TrainSettings,
    ) -> Result<Self, EngineError> {
        let maximum = usize::try_from(settings.densify.maximum_gaussians).unwrap_or(usize::MAX);
        let gaussians = maximum.max(model.len());
        let buffers = demand(&Arc::new(Gpu::open()?), inputs, model, settings, gaussians)?;
        Self::of_buffers(buffers, Some(gaussians))
    }

    /// Tries to allocate as many bytes as the buffers of a model have.
    ///
    /// # Errors
    /// If there is no GPU, or it fails.
    pub fn of_buffers(
        buffers: BufferDemand,
        gaussians: Option<usize>,
    ) -> Result<Self, EngineError> {
        let gpu = Gpu::open()?;
        Ok(Self {
            adapter: gpu.adapter().clone(),
            gaussians,
            buffers,
            largest_allowed: gpu.largest_buffer(),
            refusal: gpu.try_to_hold(&buffers).err(),
        })
    }
}

/// Returns the sizes of the buffers of training with room for `gaussians` Gaussians. The device is of no further
/// use.
///
/// # Errors
/// If the device fails, or it cannot train the model under these settings.
pub fn demand(
    gpu: &Arc<Gpu>,
    inputs: InputViews<'_>,
    model: Model,
    settings: &TrainSettings,
    gaussians: usize,
) -> Result<BufferDemand, EngineError> {
    gpu.only_plan();
    let mut stepper = GpuStepper::of_any_size(Arc::clone(gpu), inputs, model, settings)?;
    let tables = tables(gpu, &stepper.model, gaussians)?;
    stepper.put(tables)?;
    if settings.densify.begin_iteration < settings.iterations {
        let mut on_device = stepper.take_model()?;
        stepper.make_density_work(&mut on_device)?;
    }
    gpu.check()?;
    Ok(gpu.buffer_demand())
}

/// Returns tables with room for `gaussians` Gaussians in all; those beyond the model's are of the kind with the
/// most parameters.
fn tables(gpu: &Gpu, model: &Model, gaussians: usize) -> Result<Vec<PartTables>, GpuError> {
    let width = |part: &Part| -> usize { part.table.arrays.iter().map(|array| array.width).sum() };
    let widest = (0..model.parts.len()).max_by_key(|&number| width(&model.parts[number]));
    let spare = gaussians.saturating_sub(model.len());
    let room = |number: usize| if Some(number) == widest { spare } else { 0 };
    copies_with_room(gpu, model, room)
}
