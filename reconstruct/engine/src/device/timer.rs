//! Time of each stage of a step on the device.

use std::{collections::BTreeMap, time::Instant};

use crate::device::{buffer::DeviceBuffer, device::Gpu, error::GpuError};

/// Maximum number of timed passes in a step.
const PASSES: u32 = 512;

/// Cost of a stage of a program.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StageCost {
    /// Number of kernels started.
    pub dispatches: u64,
    /// Bytes of all buffers bound by these kernels, counted once per binding: an upper bound of the stage's
    /// traffic, unless it reads a value several times.
    pub bytes: u64,
    /// Time on the device; `None` without timestamps.
    pub seconds: Option<f64>,
}

/// Stages with their costs, in the order in which they begin.
pub type Stages = Vec<(&'static str, StageCost)>;

/// Records when passes begin and end.
#[derive(Debug)]
pub(crate) struct StageTimer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    ticks: DeviceBuffer<u64>,
    /// Stage of each pass.
    passes: Vec<&'static str>,
}

impl StageTimer {
    /// Creates a timer; `None` if the adapter has no timestamps.
    ///
    /// # Errors
    /// If memory does not suffice.
    pub(crate) fn new(gpu: &Gpu) -> Result<Option<Self>, GpuError> {
        if !gpu
            .device
            .features()
            .contains(wgpu::Features::TIMESTAMP_QUERY)
        {
            return Ok(None);
        }
        let queries = gpu.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: Some("times of passes"),
            ty: wgpu::QueryType::Timestamp,
            count: 2 * PASSES,
        });
        let resolved = gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("times of passes"),
            size: u64::from(2 * PASSES) * 8,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        Ok(Some(Self {
            queries,
            resolved,
            ticks: DeviceBuffer::zeros(gpu, "times of passes", 2 * PASSES as usize)?,
            passes: Vec::new(),
        }))
    }

    /// Returns the timestamp writes of a pass of `stage`; `None` after [`PASSES`] passes.
    pub(crate) fn pass(
        &mut self,
        stage: &'static str,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let number = self.passes.len() as u32;
        if number == PASSES {
            return None;
        }
        self.passes.push(stage);
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * number),
            end_of_pass_write_index: Some(2 * number + 1),
        })
    }

    /// Resolves the encoded timestamps.
    pub(crate) fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        let count = 2 * self.passes.len() as u32;
        encoder.resolve_query_set(&self.queries, 0..count, &self.resolved, 0);
        let bytes = u64::from(count) * 8;
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.ticks.raw, 0, bytes);
    }

    /// Waits for the device and returns the seconds of each stage submitted since the last call.
    pub(crate) fn take(&mut self, gpu: &Gpu) -> Result<BTreeMap<&'static str, f64>, GpuError> {
        let ticks = self.ticks.read(gpu)?;
        let second = f64::from(gpu.queue.get_timestamp_period()) * 1e-9;
        let mut seconds = BTreeMap::new();
        for (stage, pass) in self.passes.drain(..).zip(ticks.as_chunks::<2>().0) {
            *seconds.entry(stage).or_insert(0.0) += pass[1].saturating_sub(pass[0]) as f64 * second;
        }
        Ok(seconds)
    }
}

impl Gpu {
    /// Measures the bytes per second that the device copies from one buffer to another, read and written.
    ///
    /// # Errors
    /// If the device fails or memory does not suffice.
    pub fn copied_per_second(&self) -> Result<f64, GpuError> {
        const COPIES: u32 = 8;
        let bytes = self.largest_buffer().min(256 << 20);
        let values = bytes as usize / size_of::<u32>();
        let from = DeviceBuffer::<u32>::zeros(self, "copied from", values)?;
        let to = DeviceBuffer::<u32>::zeros(self, "copied to", values)?;
        let copy = || -> Result<f64, GpuError> {
            let begun = Instant::now();
            let mut encoder = self.device.create_command_encoder(&Default::default());
            for _ in 0..COPIES {
                encoder.copy_buffer_to_buffer(&from.raw, 0, &to.raw, 0, to.raw.size());
            }
            self.queue.submit([encoder.finish()]);
            self.wait()?;
            Ok(begun.elapsed().as_secs_f64())
        };
        copy()?;
        let seconds = copy()?.max(f64::MIN_POSITIVE);
        Ok(2.0 * f64::from(COPIES) * to.raw.size() as f64 / seconds)
    }
}
