//! Where a step's time goes on the device.

use std::{collections::BTreeMap, time::Instant};

use crate::device::{buffer::DeviceBuffer, device::Gpu, error::GpuError};

/// Passes that one step may have at most.
const PASSES: u32 = 512;

/// What a stage of a program costs.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StageCost {
    /// Kernels that are started.
    pub dispatches: u64,
    /// Bytes of all buffers that these kernels are given, each as often as it is given to one: what a stage
    /// moves at most, unless it reads a value several times.
    pub bytes: u64,
    /// Time on the device, where the adapter has a clock for it.
    pub seconds: Option<f64>,
}

/// A stage with its cost, in the order in which stages begin.
pub type Stages = Vec<(&'static str, StageCost)>;

/// Notes when passes begin and end.
#[derive(Debug)]
pub(crate) struct StageTimer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    ticks: DeviceBuffer<u64>,
    /// The stage of each pass.
    passes: Vec<&'static str>,
}

impl StageTimer {
    /// `None` where the adapter has no clock.
    ///
    /// # Errors
    /// When its memory does not suffice.
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

    /// What a pass of a stage has to write; nothing where there are too many.
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

    /// Closes what was encoded.
    pub(crate) fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        let count = 2 * self.passes.len() as u32;
        encoder.resolve_query_set(&self.queries, 0..count, &self.resolved, 0);
        let bytes = u64::from(count) * 8;
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.ticks.raw, 0, bytes);
    }

    /// Seconds of each stage of what was submitted since the last call; waits for it.
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
    /// Bytes that the device copies in a second from one buffer to another, read and written.
    ///
    /// # Errors
    /// When the device fails or its memory does not suffice.
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
