//! Kernels of a parameterization on a GPU: [`DeviceTwin`] compiles them and opens parts of a model, whose
//! [`DeviceParameterization`] records them into the programs of a training step.
//!
//! A twin may build on another: it opens, for example, the part of
//! [`StaticGaussians`](super::static_gaussians::StaticGaussians) and changes what that part has activated. All
//! else is done by the step: it draws the Gaussians, trains the table and the shared parameters, and controls
//! density.
//!
//! # The kernels
//!
//! A module of WGSL consists of [`COMMON_WGSL`](crate::device::COMMON_WGSL), [`GAUSSIANS_WGSL`] and a file of
//! its own, which a [`Shader`](crate::device::Shader) lists in this order. With these bindings, one thread
//! handles one Gaussian of a part:
//!
//! ```wgsl
//! @group(0) @binding(0) var<storage, read_write> gaussians: array<Gaussian>;
//!
//! @compute @workgroup_size(256)
//! fn activate(
//!     @builtin(workgroup_id) group: vec3<u32>,
//!     @builtin(num_workgroups) groups: vec3<u32>,
//!     @builtin(local_invocation_index) thread: u32,
//! ) {
//!     let index = workgroup_number(group, groups) * WORKGROUP + thread;
//!     // Return if `index` is not below the number of Gaussians of the part.
//! }
//! ```
//!
//! Bindings are read-only or `read_write` storage buffers and uniforms:
//!
//! | buffer | element | index |
//! |---|---|---|
//! | `table.values`, `table.gradients` | `f32` | `begin(array) + index * width + value` |
//! | `shared.values`, `shared.gradients` | `f32` | number of the value |
//! | `activated.gaussians` | `Gaussian` | `entries.first + index` |
//! | `activated.harmonics` | `f32` | `((entries.first + index) * (degree + 1)^2 + coefficient) * 3 + channel` |
//! | `activated.features` | `f32` | `(entries.first + index) * features.count() + channel` |
//!
//! The `gradients` of the activated Gaussians have the layout of their values. [`GAUSSIANS_WGSL`] gives the
//! units and ranges of `Gaussian`.

use std::{
    any::{Any, TypeId},
    collections::HashMap,
    fmt,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use super::{
    activated_buffers::ActivatedBuffers, parameterization::Viewpoint, temporal::TemporalFeatures,
};
pub use super::{static_gaussians::gpu::DeviceRows, temporal::gpu::DeviceTime};
use crate::{
    device::{Buffer, Gpu, GpuError, Program},
    parameters::{ParameterTable, device_table::TableBuffers},
};

/// WGSL structure `Gaussian`, an activated Gaussian or the gradient by one.
pub const GAUSSIANS_WGSL: &str = include_str!("gaussians.wgsl");

/// Kernels of a model's parameterizations on one GPU. Each type of kernels is compiled once; all parts share it.
#[derive(Debug, Default)]
pub struct CompiledKernels(Mutex<KernelsByType>);

type KernelsByType = HashMap<TypeId, Arc<dyn Any + Send + Sync>>;

impl CompiledKernels {
    fn known(&self) -> MutexGuard<'_, KernelsByType> {
        // Entries are complete, even if a panic elsewhere poisoned the lock.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the kernels of type `K`; the first call compiles them.
    ///
    /// # Errors
    /// That of `compile`.
    pub fn get<K: Any + Send + Sync>(
        &self,
        gpu: &Gpu,
        compile: impl FnOnce(&Gpu) -> Result<K, GpuError>,
    ) -> Result<Arc<K>, GpuError> {
        let known = self.known().get(&TypeId::of::<K>()).cloned();
        if let Some(kernels) = known.and_then(|known| known.downcast::<K>().ok()) {
            return Ok(kernels);
        }
        // The lock is not held here: kernels may be composed of others.
        let kernels = Arc::new(compile(gpu)?);
        let kept: Arc<K> = Arc::clone(&kernels);
        self.known().insert(TypeId::of::<K>(), kept);
        Ok(kernels)
    }
}

/// Range of a table's Gaussians within all activated ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceEntries {
    /// Index of the first.
    pub first: usize,
    /// Number of Gaussians.
    pub len: usize,
}

/// Part of a model in GPU memory, before its parameterization is opened.
#[derive(Debug, Clone, Copy)]
pub struct NewDevicePart<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// Kernels compiled so far.
    pub kernels: &'a CompiledKernels,
    /// Names and widths of the table's arrays, in the order of `table`; the values may be out of date.
    pub host: &'a ParameterTable,
    /// The table.
    pub table: &'a TableBuffers,
    /// The table's rows in their current number.
    pub rows: &'a DeviceRows,
    /// The Gaussians' place among all activated ones.
    pub entries: DeviceEntries,
    /// Feature channels of the activated Gaussians.
    pub features: &'a TemporalFeatures,
    /// Index of the model's first Gaussian with its own time among all activated ones.
    pub first_alone: usize,
}

/// Buffers that the kernels of a part bind.
#[derive(Debug, Clone, Copy)]
pub struct PartBuffers<'a> {
    /// The table.
    pub table: &'a TableBuffers,
    /// The table's rows in their current number.
    pub rows: &'a DeviceRows,
    /// The shared parameters, a table of one array and one row. `None` without any, and in programs for the
    /// viewpoints at which they are not used ([`DeviceTwin::uses_shared`]).
    pub shared: Option<&'a TableBuffers>,
    /// All activated Gaussians, and the gradients by them.
    pub activated: &'a ActivatedBuffers,
}

/// GPU twin of a parameterization. On a GPU, at most one part of a model has shared parameters.
pub trait DeviceTwin: fmt::Debug {
    /// Compiles its kernels into `kernels`, where [`DeviceTwin::open`] finds them.
    ///
    /// # Errors
    /// If the device fails.
    fn compile(&self, gpu: &Gpu, kernels: &CompiledKernels) -> Result<(), GpuError>;

    /// Opens a part. This happens again whenever the part gets a larger table.
    ///
    /// # Errors
    /// If the device fails or runs out of memory.
    fn open(&self, part: &NewDevicePart<'_>) -> Result<Box<dyn DeviceParameterization>, GpuError>;

    /// Returns true if the shared parameters, if any, are used and trained at a viewpoint.
    fn uses_shared(&self, _at: &Viewpoint) -> bool {
        true
    }
}

/// Parameterization of one part in GPU memory.
///
/// Programs are recorded once and run for any number of Gaussians up to the capacity of the table. What changes
/// between runs is in uniforms, which [`place`](Self::place) and [`set_moment`](Self::set_moment) write.
pub trait DeviceParameterization: fmt::Debug + Send {
    /// Records the activation into the part's entries of `activated.gaussians` and `activated.harmonics`. A
    /// part with [`DeviceParameterization::time`] also writes `activated.features`; for other parts the step
    /// does.
    ///
    /// # Errors
    /// If the device runs out of memory.
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError>;

    /// Records the VJP, which runs after the activation and overwrites `table.gradients` and
    /// `shared.gradients`. It may overwrite the part's activated Gaussians and the gradients by them.
    ///
    /// # Errors
    /// If the device runs out of memory.
    fn activate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError>;

    /// Changes the entries of its Gaussians, and the index of the model's first Gaussian with its own time.
    /// Before the next run, [`set_moment`](Self::set_moment) is called.
    fn place(&mut self, _gpu: &Gpu, _entries: DeviceEntries, _first_alone: usize) {}

    /// Sets the viewpoint for everything that is submitted later.
    fn set_moment(&self, _gpu: &Gpu, _at: &Viewpoint) {}

    /// Records the clamping of values that a step moved out of their bounds. A kernel must change nothing
    /// unless `halted` is 0 in `status`, a buffer with the structure of
    /// [`STATUS_WGSL`](crate::device::STATUS_WGSL).
    fn keep_within_bounds(
        &self,
        _gpu: &Gpu,
        _program: &mut Program,
        _table: (&TableBuffers, &DeviceRows),
        _status: &Buffer,
    ) {
    }

    /// Records the same for the shared parameters, after a step that trained them.
    fn keep_shared_within_bounds(
        &self,
        _gpu: &Gpu,
        _program: &mut Program,
        _shared: &TableBuffers,
        _status: &Buffer,
    ) {
    }

    /// Returns its temporal parameters, for density control in time, the losses on velocities and lifespans,
    /// and the dynamic Gaussians alone. `Some` exactly if the parameterization has a
    /// [temporal model](super::parameterization::Parameterization::temporal).
    fn time(&self) -> Option<&DeviceTime> {
        None
    }
}
