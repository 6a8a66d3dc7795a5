//! Opening of an adapter, and capture of its errors.
//!
//! wgpu reports errors apart from the calls that cause them, and by default panics. Here they are caught: the
//! first one is kept and every later wait for the device returns it.

use std::sync::{
    Arc, Mutex, MutexGuard, PoisonError,
    atomic::{AtomicBool, AtomicU64, Ordering},
};

use omnilife_schemas::records::Backend;

use crate::device::adapters::AdapterSummary;
use crate::device::choices::{KernelChoices, PixelSums};
use crate::device::error::GpuError;

/// Threads of every workgroup: one per pixel of a tile.
pub(crate) const WORKGROUP: u32 = 256;
/// Most workgroup memory that the kernels use, bytes; every WebGPU adapter has it.
const WORKGROUP_MEMORY: u32 = 16 * 1024;
/// Most storage buffers that a kernel binds; every WebGPU adapter allows them.
const STORAGE_BUFFERS: u32 = 8;

/// Optional features: subgroups for sums over pixels, timestamps for measurements.
const OPTIONAL_FEATURES: wgpu::Features =
    wgpu::Features::SUBGROUP.union(wgpu::Features::TIMESTAMP_QUERY);

/// An open GPU.
#[derive(Debug)]
pub struct Gpu {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    summary: AdapterSummary,
    limits: wgpu::Limits,
    choices: KernelChoices,
    pixel_sums: PixelSums,
    faults: Arc<Mutex<Faults>>,
    bytes_read: AtomicU64,
    made: AtomicU64,
    /// Number of allocations, failed ones included.
    allocations: AtomicU64,
    /// Size above which allocation fails, bytes; `u64::MAX` except in tests.
    largest_made: AtomicU64,
    /// Number of allocations after which further ones fail; `u64::MAX` except in tests.
    most_made: AtomicU64,
    /// Largest buffer that a test pretends the adapter to allow, bytes; `u64::MAX` elsewhere.
    pretended: AtomicU64,
    demand: Mutex<BufferDemand>,
    only_plans: AtomicBool,
    staging: Mutex<Option<wgpu::Buffer>>,
}

/// Sizes of the buffers of a device since it was opened, in use or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BufferDemand {
    /// Bytes of all.
    pub bytes: u64,
    /// Bytes of the largest.
    pub largest_bytes: u64,
    /// Name of the largest.
    pub largest: &'static str,
}

/// Errors of a device since it was opened.
#[derive(Debug, Default)]
struct Faults {
    lost: Option<String>,
    first: Option<String>,
}

fn lock(faults: &Mutex<Faults>) -> MutexGuard<'_, Faults> {
    // Two strings are valid even if a panic elsewhere poisoned the lock.
    faults.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Gpu {
    /// Opens the first adapter, hardware before software, with all optional features that it offers. The
    /// environment chooses the kernels: `OMNILIFE_GPU_SUMS` sums a splat's gradient by a thread per pixel
    /// (`pixels`, the default) or per splat (`splats`); `OMNILIFE_GPU_ADAM` has `separate` kernels up to Adam
    /// (the default) or a `fused` one.
    ///
    /// # Errors
    /// If no adapter is found, it is too small, its driver gives no device, or a variable has another value.
    pub fn open() -> Result<Self, GpuError> {
        Self::open_with(OPTIONAL_FEATURES, KernelChoices::of_environment()?)
    }

    /// Opens the adapter as if it had no subgroups, to test the kernels' twins without them.
    ///
    /// # Errors
    /// See [`Gpu::open`].
    pub fn open_without_subgroups() -> Result<Self, GpuError> {
        let optional = OPTIONAL_FEATURES - wgpu::Features::SUBGROUP;
        Self::open_with(optional, KernelChoices::default())
    }

    /// Opens the adapter with these kernels, whatever the environment chooses, to compare them.
    ///
    /// # Errors
    /// See [`Gpu::open`].
    pub fn open_with_choices(choices: KernelChoices) -> Result<Self, GpuError> {
        Self::open_with(OPTIONAL_FEATURES, choices)
    }

    fn open_with(optional: wgpu::Features, choices: KernelChoices) -> Result<Self, GpuError> {
        let adapter = crate::device::adapters::wgpu_adapters()
            .into_iter()
            .next()
            .ok_or(GpuError::NoAdapter)?;
        let summary = AdapterSummary::of(&adapter);
        let limits = required_limits(&summary.name, &adapter.limits())?;
        let request = wgpu::DeviceDescriptor {
            label: Some("omnilife"),
            required_limits: limits.clone(),
            required_features: adapter.features() & optional,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&request)).map_err(|error| {
                GpuError::Open {
                    adapter: summary.name.clone(),
                    reason: on_one_line(&error.to_string()),
                }
            })?;
        let has_subgroups = device.features().contains(wgpu::Features::SUBGROUP);
        let subgroup_size = has_subgroups.then(|| adapter.get_info().subgroup_min_size.max(1));
        let faults = Arc::new(Mutex::new(Faults::default()));
        let of_errors = Arc::clone(&faults);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            lock(&of_errors)
                .first
                .get_or_insert_with(|| on_one_line(&error.to_string()));
        }));
        let of_loss = Arc::clone(&faults);
        device.set_device_lost_callback(move |reason, message| {
            lock(&of_loss)
                .lost
                .get_or_insert_with(|| format!("{reason:?} {message}").trim().to_owned());
        });
        Ok(Self {
            device,
            queue,
            summary,
            limits,
            choices,
            pixel_sums: PixelSums::new(choices, subgroup_size),
            faults,
            bytes_read: AtomicU64::new(0),
            made: AtomicU64::new(0),
            allocations: AtomicU64::new(0),
            largest_made: AtomicU64::new(u64::MAX),
            most_made: AtomicU64::new(u64::MAX),
            pretended: AtomicU64::new(u64::MAX),
            demand: Mutex::default(),
            only_plans: AtomicBool::new(false),
            staging: Mutex::new(None),
        })
    }

    /// Returns the adapter behind the device.
    pub fn adapter(&self) -> &AdapterSummary {
        &self.summary
    }

    /// Returns the threads of the smallest subgroup, in which kernels add up over pixels. `None` if they add
    /// up in workgroup memory, or with a thread per splat.
    pub fn subgroup_size(&self) -> Option<u32> {
        self.pixel_sums.subgroup_size()
    }

    /// Returns the form in which kernels add up over pixels.
    pub fn pixel_sums(&self) -> PixelSums {
        self.pixel_sums
    }

    /// Returns the kernels that stand for others.
    pub fn choices(&self) -> KernelChoices {
        self.choices
    }

    /// Returns the limits within which the kernels work, by name, for the run record.
    fn limits(&self) -> [(&'static str, u64); 4] {
        let limits = &self.limits;
        [
            (
                "max_storage_buffer_binding_size",
                limits.max_storage_buffer_binding_size,
            ),
            ("max_buffer_size", limits.max_buffer_size),
            (
                "max_compute_workgroup_storage_size",
                u64::from(limits.max_compute_workgroup_storage_size),
            ),
            (
                "max_compute_invocations_per_workgroup",
                u64::from(limits.max_compute_invocations_per_workgroup),
            ),
        ]
    }

    /// Returns the entry of this device in a run's record.
    pub fn record(&self) -> Backend {
        Backend::Gpu {
            adapter: self.summary.name.clone(),
            interface: self.summary.backend.clone(),
            device: self.summary.kind.to_string(),
            driver: self.summary.driver.clone(),
            limits: self
                .limits()
                .map(|(name, limit)| (name.to_owned(), limit))
                .into(),
            subgroup_size: self.subgroup_size(),
            sums_per_splat: self.choices.sums_per_splat,
            fused_adam: self.choices.fused_adam,
        }
    }

    /// Returns the largest storage buffer that a kernel can bind, bytes.
    pub fn largest_buffer(&self) -> u64 {
        self.limits
            .max_storage_buffer_binding_size
            .min(self.limits.max_buffer_size)
            .min(self.pretended.load(Ordering::Relaxed))
    }

    /// Returns the bytes that the host has read back so far.
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    pub(crate) fn count_read(&self, bytes: u64) {
        self.bytes_read.fetch_add(bytes, Ordering::Relaxed);
    }

    /// Returns the number of buffers and bind groups created so far.
    pub fn buffers_and_bind_groups_made(&self) -> u64 {
        self.made.load(Ordering::Relaxed)
    }

    pub(crate) fn count_made(&self) {
        self.made.fetch_add(1, Ordering::Relaxed);
    }

    fn demand(&self) -> MutexGuard<'_, BufferDemand> {
        // Three values are valid even if a panic elsewhere poisoned the lock.
        self.demand.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the sizes of its buffers so far, except those for reading back.
    pub fn buffer_demand(&self) -> BufferDemand {
        *self.demand()
    }

    pub(crate) fn count_demand(&self, label: &'static str, bytes: u64) {
        let mut demand = self.demand();
        demand.bytes += bytes;
        if bytes > demand.largest_bytes {
            demand.largest_bytes = bytes;
            demand.largest = label;
        }
    }

    /// Makes every later buffer only as large as binding it takes, so that programs can be recorded and their
    /// bytes counted. They must not run.
    pub fn only_plan(&self) {
        self.only_plans.store(true, Ordering::Relaxed);
    }

    /// Returns true after [`Gpu::only_plan`].
    pub(crate) fn only_plans(&self) -> bool {
        self.only_plans.load(Ordering::Relaxed)
    }

    /// Returns the last readback buffer, if any, locked while it is in use.
    pub(crate) fn staging(&self) -> MutexGuard<'_, Option<wgpu::Buffer>> {
        // A panic elsewhere leaves `None` or a valid buffer.
        self.staging.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Destroys the device; every later use of it is an error. For tests of a lost device.
    pub fn destroy(&self) {
        self.device.destroy();
    }

    /// Makes every later allocation of more than `bytes` fail. For tests of exhausted memory.
    pub fn exhaust_above(&self, bytes: u64) {
        self.largest_made.store(bytes, Ordering::Relaxed);
    }

    /// Makes every allocation after the next `allocations` ones fail. For tests of exhausted memory.
    pub fn exhaust_after(&self, allocations: u64) {
        let most = self.allocations().saturating_add(allocations);
        self.most_made.store(most, Ordering::Relaxed);
    }

    /// Makes the adapter's largest buffer at most this large. For tests of small adapters.
    pub fn pretend_largest_buffer(&self, bytes: u64) {
        self.pretended.store(bytes, Ordering::Relaxed);
    }

    /// Returns the number of allocations so far, failed ones included.
    pub fn allocations(&self) -> u64 {
        self.allocations.load(Ordering::Relaxed)
    }

    /// Counts an allocation; returns true if [`Gpu::exhaust_above`] or [`Gpu::exhaust_after`] forbids it.
    pub(crate) fn forbids(&self, bytes: u64) -> bool {
        let number = self.allocations.fetch_add(1, Ordering::Relaxed);
        bytes > self.largest_made.load(Ordering::Relaxed)
            || number >= self.most_made.load(Ordering::Relaxed)
    }

    /// Waits until the device has finished all submitted work.
    ///
    /// # Errors
    /// If the device is lost, or any submitted work has failed.
    pub(crate) fn wait(&self) -> Result<(), GpuError> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check()?;
        polled
            .map(|_| ())
            .map_err(|error| self.failed(&error.to_string()))
    }

    /// Returns the first error, if any occurred.
    pub(crate) fn check(&self) -> Result<(), GpuError> {
        let faults = lock(&self.faults);
        let adapter = || self.summary.name.clone();
        if let Some(reason) = &faults.lost {
            return Err(GpuError::Lost {
                adapter: adapter(),
                reason: reason.clone(),
            });
        }
        faults.first.as_ref().map_or(Ok(()), |reason| {
            Err(GpuError::Failed {
                adapter: adapter(),
                reason: reason.clone(),
            })
        })
    }

    pub(crate) fn failed(&self, reason: &str) -> GpuError {
        GpuError::Failed {
            adapter: self.summary.name.clone(),
            reason: on_one_line(reason),
        }
    }

    /// Runs calls that may run out of memory or fail wgpu's validation, and returns its error.
    pub(crate) fn guarded<T>(&self, calls: impl FnOnce() -> T) -> Result<T, wgpu::Error> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let made = calls();
        let errors = [validation, memory].map(|scope| pollster::block_on(scope.pop()));
        errors.into_iter().flatten().next().map_or(Ok(made), Err)
    }
}

/// Returns the limits of every WebGPU adapter, with buffers as large as this adapter allows.
fn required_limits(adapter: &str, offered: &wgpu::Limits) -> Result<wgpu::Limits, GpuError> {
    let needs = [
        (
            "a kernel's storage buffers",
            STORAGE_BUFFERS,
            offered.max_storage_buffers_per_shader_stage,
        ),
        (
            "a workgroup's memory",
            WORKGROUP_MEMORY,
            offered.max_compute_workgroup_storage_size,
        ),
        (
            "a workgroup",
            WORKGROUP,
            offered
                .max_compute_invocations_per_workgroup
                .min(offered.max_compute_workgroup_size_x),
        ),
    ];
    for (what, needed, offered) in needs {
        if offered < needed {
            return Err(GpuError::TooSmall {
                adapter: adapter.to_owned(),
                what: what.to_owned(),
                needed: u64::from(needed),
                offered: u64::from(offered),
            });
        }
    }
    Ok(wgpu::Limits {
        max_storage_buffers_per_shader_stage: STORAGE_BUFFERS,
        max_compute_workgroup_storage_size: WORKGROUP_MEMORY,
        max_compute_invocations_per_workgroup: WORKGROUP,
        max_compute_workgroup_size_x: WORKGROUP,
        max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
        max_buffer_size: offered.max_buffer_size,
        ..wgpu::Limits::downlevel_defaults()
    })
}

/// Returns the beginning of a message on one line: wgpu's go from the general to the cause, line by line.
fn on_one_line(message: &str) -> String {
    const LONGEST: usize = 400;
    let lines: Vec<&str> = message
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty())
        .collect();
    lines.join(" ").chars().take(LONGEST).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_adapter_is_refused_with_the_figure() {
        let small = wgpu::Limits {
            max_storage_buffers_per_shader_stage: 4,
            ..wgpu::Limits::default()
        };
        let message = required_limits("tiny", &small)
            .map(|_| ())
            .expect_err("too small")
            .to_string();
        assert!(
            message.contains("tiny") && message.contains("needs 8, it offers 4"),
            "{message}"
        );
    }

    #[test]
    fn default_limits_are_enough() {
        let limits = required_limits("plain", &wgpu::Limits::default()).expect("large enough");
        assert_eq!(limits.max_storage_buffers_per_shader_stage, 8);
    }
}
