//! Density control of a model on a GPU. The device decides and moves whole rows; the host reads three numbers
//! per part. Tables, buffers and programs are kept while their capacity suffices.

use std::sync::Arc;

use rand_pcg::Pcg64Mcg;

use super::{
    GpuStepper, Newest,
    device_model::{DeviceModel, DevicePart, PartTables},
};
use crate::{
    EngineError,
    density::{
        self, Densification, Densified,
        gpu::{DensityKernels, DensityWork, WorkInputs},
    },
    device::{Gpu, GpuError},
    gaussians::parameterization::Viewpoint,
    model::Model,
    parameters::{ParameterTable, device_table::TableBuffers, rows::RowMover},
};

impl GpuStepper<'_> {
    pub(super) fn densify_on_device(
        &mut self,
        asked: &Densification<'_>,
        random: &mut Pcg64Mcg,
    ) -> Result<Densified, EngineError> {
        self.settle()?;
        self.upload()?;
        let gpu = Arc::clone(&self.gpu);
        let mut on_device = self.take_model()?;
        self.make_density_work(&mut on_device)?;
        let done = decide(&gpu, asked, &mut self.model, &mut on_device, random)?;
        if on_device.has_room(&self.model) {
            for part in &on_device.parts {
                if let Some(work) = &part.density {
                    work.follow(&gpu, &part.moves);
                }
            }
            on_device.place(&gpu, &self.model);
            self.on_device = Some(on_device);
        } else {
            // Free the renderer's buffers before allocating further tables: both may not fit.
            let parts = on_device.parts;
            let maximum = self.settings.densify.maximum_gaussians;
            let maximum = usize::try_from(maximum).unwrap_or(usize::MAX);
            let maximum = maximum.min(self.room_for_gaussians());
            let kernels = (&self.kernels.density, &self.kernels.row_mover);
            let tables = follow_larger(&gpu, kernels, (&self.model, maximum), parts)?;
            self.put(tables)?;
            let mut on_device = self.take_model()?;
            self.make_density_work(&mut on_device)?;
            self.on_device = Some(on_device);
        }
        self.newest = Newest::Device;
        Ok(done)
    }

    /// Creates the buffers and programs of each part's density control.
    pub(super) fn make_density_work(&self, on_device: &mut DeviceModel) -> Result<(), GpuError> {
        let kernels = &self.kernels.density;
        for (on_device, part) in on_device.parts.iter_mut().zip(&self.model.parts) {
            on_device.make_density_work(&self.gpu, kernels, &part.table)?;
        }
        Ok(())
    }
}

impl DevicePart {
    /// Creates the buffers and programs of its density control.
    fn make_density_work(
        &mut self,
        gpu: &Gpu,
        kernels: &DensityKernels,
        host: &ParameterTable,
    ) -> Result<(), GpuError> {
        if self.density.is_none() {
            let inputs = WorkInputs {
                host,
                table: &self.table,
                moves: &self.moves,
                gradient_sums: &self.statistics.gradient_sums,
                view_counts: &self.statistics.view_counts,
                time_gradients: &self.statistics.time_gradients,
                time: self.parameterization.time(),
            };
            let work = DensityWork::new(gpu, kernels, &inputs)?;
            self.density = Some(Box::new(work));
        }
        Ok(())
    }
}

/// Decides for all parts, and resizes the host's model to the resulting number of rows, whose values are then
/// arbitrary.
fn decide(
    gpu: &Gpu,
    asked: &Densification<'_>,
    model: &mut Model,
    on_device: &mut DeviceModel,
    random: &mut Pcg64Mcg,
) -> Result<Densified, GpuError> {
    let maximum = usize::try_from(asked.settings.maximum_gaussians).unwrap_or(usize::MAX);
    let context = &asked.context;
    // The position of a child hardly depends on the view.
    let look = Viewpoint::of_image(&context.views[context.last_view].view);
    let mut done = Densified::default();
    for number in density::parts_in_order(model) {
        let room = maximum.saturating_sub(model.len());
        let (part, on_device) = (&mut model.parts[number], &mut on_device.parts[number]);
        if let Some(time) = on_device.parameterization.time() {
            time.set(gpu, &look);
        }
        if let Some(work) = &mut on_device.density {
            let (of_part, left) = density::gpu::decide(gpu, work, (asked, part, room), random)?;
            done.add(of_part);
            part.table.resize(left);
            part.forget_statistics();
        }
    }
    Ok(done)
}

/// Applies the decision to larger tables.
fn follow_larger(
    gpu: &Gpu,
    (kernels, mover): (&DensityKernels, &RowMover),
    (model, maximum): (&Model, usize),
    parts: Vec<DevicePart>,
) -> Result<Vec<PartTables>, GpuError> {
    let mut moved = Vec::with_capacity(parts.len());
    for (part, old) in model.parts.iter().zip(parts) {
        let capacity = larger_capacity(old.table.capacity, part.table.len(), maximum);
        let table = TableBuffers::zeros(gpu, old.table.widths.clone(), capacity)?;
        let moves = mover.between(gpu, &old.table, &table)?;
        if let Some(work) = &old.density {
            work.follow_into(gpu, kernels, (&table, &moves))?;
        }
        moved.push(PartTables {
            table,
            shared: old.into_shared(),
        });
    }
    Ok(moved)
}

/// Returns the last capacity if it suffices; otherwise twice it up to the maximum, and at least `needed`.
fn larger_capacity(last: usize, needed: usize, maximum: usize) -> usize {
    if needed <= last {
        last
    } else {
        needed.max((2 * last).min(maximum))
    }
}
