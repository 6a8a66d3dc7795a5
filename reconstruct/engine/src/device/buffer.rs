//! Typed buffers in the device's memory.

use std::{marker::PhantomData, ops::Range};

use bytemuck::Pod;

use crate::device::{device::Gpu, error::GpuError};

/// `len` values of `T` in a storage buffer. New values are zero; a clone is the same buffer.
#[derive(Debug, Clone)]
pub(crate) struct DeviceBuffer<T> {
    pub(crate) raw: wgpu::Buffer,
    label: &'static str,
    len: usize,
    values: PhantomData<T>,
}

impl<T: Pod> DeviceBuffer<T> {
    /// Zeros.
    pub(crate) fn zeros(gpu: &Gpu, label: &'static str, len: usize) -> Result<Self, GpuError> {
        // An empty buffer cannot be bound.
        let bytes = (len.max(1) * size_of::<T>()).next_multiple_of(4) as u64;
        Ok(Self {
            raw: create(gpu, label, bytes, wgpu::BufferUsages::STORAGE)?,
            label,
            len,
            values: PhantomData,
        })
    }

    /// A copy of `values`.
    pub(crate) fn of(gpu: &Gpu, label: &'static str, values: &[T]) -> Result<Self, GpuError> {
        let buffer = Self::zeros(gpu, label, values.len())?;
        buffer.write(gpu, 0, values);
        Ok(buffer)
    }

    /// Number of values.
    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Replaces the values from number `first` on, before everything that is submitted later.
    pub(crate) fn write(&self, gpu: &Gpu, first: usize, values: &[T]) {
        assert!(first + values.len() <= self.len, "{} is full", self.label);
        let offset = (first * size_of::<T>()) as u64;
        gpu.queue
            .write_buffer(&self.raw, offset, bytemuck::cast_slice(values));
    }

    /// Waits for the device and copies all values back.
    pub(crate) fn read(&self, gpu: &Gpu) -> Result<Vec<T>, GpuError> {
        self.read_range(gpu, 0..self.len)
    }

    /// Waits for the device and copies some values back; they begin at a multiple of four bytes.
    pub(crate) fn read_range(&self, gpu: &Gpu, range: Range<usize>) -> Result<Vec<T>, GpuError> {
        let len = range.len();
        if len == 0 {
            return Ok(Vec::new());
        }
        let first = (range.start * size_of::<T>()) as u64;
        let bytes = ((len * size_of::<T>()) as u64).next_multiple_of(4);
        gpu.count_read(bytes);
        let copy = create_with(
            gpu,
            self.label,
            bytes,
            wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        )?;
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&self.raw, first, &copy, 0, bytes);
        gpu.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        copy.slice(..)
            .map_async(wgpu::MapMode::Read, move |mapped| {
                // Nobody listens any more only where reading was given up.
                let _ = sender.send(mapped);
            });
        gpu.wait()?;
        match receiver.try_recv() {
            Ok(Ok(())) => {}
            _ => return Err(gpu.failed(&format!("{} cannot be read back", self.label))),
        }
        let view = copy
            .slice(..)
            .get_mapped_range()
            .map_err(|error| gpu.failed(&error.to_string()))?;
        let mut values = vec![T::zeroed(); len];
        bytemuck::cast_slice_mut(&mut values).copy_from_slice(&view[..len * size_of::<T>()]);
        Ok(values)
    }
}

/// A uniform: one value of `T` that the host replaces between submissions.
#[derive(Debug)]
pub(crate) struct Uniform<T> {
    pub(crate) raw: wgpu::Buffer,
    value: PhantomData<T>,
}

impl<T: Pod> Uniform<T> {
    pub(crate) fn of(gpu: &Gpu, label: &'static str, value: &T) -> Result<Self, GpuError> {
        let bytes = size_of::<T>() as u64;
        let raw = create(gpu, label, bytes, wgpu::BufferUsages::UNIFORM)?;
        let uniform = Self {
            raw,
            value: PhantomData,
        };
        uniform.write(gpu, value);
        Ok(uniform)
    }

    /// Replaces the value, before everything that is submitted later.
    pub(crate) fn write(&self, gpu: &Gpu, value: &T) {
        gpu.queue
            .write_buffer(&self.raw, 0, bytemuck::bytes_of(value));
    }
}

fn create(
    gpu: &Gpu,
    label: &'static str,
    bytes: u64,
    usage: wgpu::BufferUsages,
) -> Result<wgpu::Buffer, GpuError> {
    let copies = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
    create_with(gpu, label, bytes, usage | copies)
}

fn create_with(
    gpu: &Gpu,
    label: &'static str,
    size: u64,
    usage: wgpu::BufferUsages,
) -> Result<wgpu::Buffer, GpuError> {
    if size > gpu.largest_buffer() {
        return Err(GpuError::TooSmall {
            adapter: gpu.adapter().name.clone(),
            what: format!("the buffer {label} (bytes)"),
            needed: size,
            offered: gpu.largest_buffer(),
        });
    }
    let descriptor = wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: false,
    };
    gpu.guarded(|| gpu.device.create_buffer(&descriptor))
        .map_err(|error| match error {
            wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory {
                adapter: gpu.adapter().name.clone(),
                what: label.to_owned(),
                bytes: size,
            },
            other => gpu.failed(&other.to_string()),
        })
}
