//! Typed buffers in the device's memory.

use std::{marker::PhantomData, ops::Range};

use bytemuck::Pod;

use crate::device::{
    device::{BufferDemand, Gpu},
    error::GpuError,
};

/// Largest buffer of a plan, bytes: larger than any uniform or element.
const LARGEST_PLANNED: u64 = 1 << 16;
/// Largest readback buffer that is kept for reuse, bytes.
const LONGEST_KEPT: u64 = 256 << 20;

/// `len` values of `T` in a storage buffer. New values are zero; a clone shares the buffer.
#[derive(Debug, Clone)]
pub struct DeviceBuffer<T> {
    /// The buffer, for binding it to a kernel.
    pub raw: wgpu::Buffer,
    label: &'static str,
    len: usize,
    values: PhantomData<T>,
}

impl<T: Pod> DeviceBuffer<T> {
    /// Allocates `len` zeros.
    ///
    /// # Errors
    /// If the device has no room for them.
    pub fn zeros(gpu: &Gpu, label: &'static str, len: usize) -> Result<Self, GpuError> {
        Self::zeros_for(gpu, label, len, wgpu::BufferUsages::STORAGE)
    }

    /// Allocates `len` zeros that may also hold the workgroup counts of an indirect dispatch.
    pub(crate) fn indirect(gpu: &Gpu, label: &'static str, len: usize) -> Result<Self, GpuError> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::INDIRECT;
        Self::zeros_for(gpu, label, len, usage)
    }

    fn zeros_for(
        gpu: &Gpu,
        label: &'static str,
        len: usize,
        usage: wgpu::BufferUsages,
    ) -> Result<Self, GpuError> {
        // An empty buffer cannot be bound.
        let bytes = (len.max(1) * size_of::<T>()).next_multiple_of(4) as u64;
        Ok(Self {
            raw: create(gpu, label, bytes, usage)?,
            label,
            len,
            values: PhantomData,
        })
    }

    /// Uploads a copy of `values`.
    pub(crate) fn of(gpu: &Gpu, label: &'static str, values: &[T]) -> Result<Self, GpuError> {
        let buffer = Self::zeros(gpu, label, values.len())?;
        buffer.write(gpu, 0, values);
        Ok(buffer)
    }

    pub(crate) fn len(&self) -> usize {
        self.len
    }

    /// Replaces the values from index `first` on, before everything that is submitted later.
    ///
    /// # Panics
    /// If they are more than the buffer holds.
    pub fn write(&self, gpu: &Gpu, first: usize, values: &[T]) {
        assert!(first + values.len() <= self.len, "{} is full", self.label);
        if gpu.only_plans() {
            return;
        }
        let offset = (first * size_of::<T>()) as u64;
        gpu.queue
            .write_buffer(&self.raw, offset, bytemuck::cast_slice(values));
    }

    /// Waits for the device and copies all values back.
    pub(crate) fn read(&self, gpu: &Gpu) -> Result<Vec<T>, GpuError> {
        self.read_range(gpu, 0..self.len)
    }

    /// Waits for the device and copies some values back; their range must begin at a multiple of four bytes.
    pub(crate) fn read_range(&self, gpu: &Gpu, range: Range<usize>) -> Result<Vec<T>, GpuError> {
        let mut read = Self::read_ranges(gpu, &[(self, range)])?;
        Ok(read.pop().unwrap_or_default())
    }

    /// Waits once and copies ranges of several buffers back; each must begin at a multiple of four bytes.
    pub(crate) fn read_ranges(
        gpu: &Gpu,
        ranges: &[(&Self, Range<usize>)],
    ) -> Result<Vec<Vec<T>>, GpuError> {
        let bytes_of = |len: usize| ((len * size_of::<T>()) as u64).next_multiple_of(4);
        let pieces: Vec<Piece<'_>> = ranges
            .iter()
            .filter(|(_, range)| !range.is_empty())
            .map(|(buffer, range)| Piece {
                buffer: &buffer.raw,
                first: (range.start * size_of::<T>()) as u64,
                bytes: bytes_of(range.len()),
            })
            .collect();
        let mut all = Vec::with_capacity(ranges.len());
        gpu.read_pieces(&pieces, |mut view| {
            for (_, range) in ranges {
                let mut values = vec![T::zeroed(); range.len()];
                let bytes = range.len() * size_of::<T>();
                bytemuck::cast_slice_mut(&mut values).copy_from_slice(&view[..bytes]);
                view = &view[bytes_of(range.len()) as usize..];
                all.push(values);
            }
        })?;
        Ok(all)
    }
}

/// Part of a buffer to read back, in bytes.
struct Piece<'a> {
    buffer: &'a wgpu::Buffer,
    first: u64,
    bytes: u64,
}

impl Gpu {
    /// Allocates, and frees again, as many bytes as other buffers have, in buffers as large as their largest.
    ///
    /// # Errors
    /// If the adapter allows no such buffer, or its memory does not suffice.
    pub fn try_to_hold(&self, buffers: &BufferDemand) -> Result<(), GpuError> {
        let mut held = Vec::new();
        let mut left = buffers.bytes;
        while left > 0 {
            let bytes = left.min(buffers.largest_bytes.max(4));
            left -= bytes;
            let bytes = bytes.next_multiple_of(4);
            let usage = wgpu::BufferUsages::STORAGE;
            held.push(create_with(self, buffers.largest, bytes, usage)?);
        }
        drop(held);
        Ok(())
    }

    /// Waits for the device and passes the pieces to `read` one after another.
    fn read_pieces(&self, pieces: &[Piece<'_>], read: impl FnOnce(&[u8])) -> Result<(), GpuError> {
        let bytes: u64 = pieces.iter().map(|piece| piece.bytes).sum();
        if bytes == 0 {
            read(&[]);
            return Ok(());
        }
        self.count_read(bytes);
        let mut kept = self.staging();
        let staging = match kept.take() {
            Some(staging) if staging.size() >= bytes => staging,
            last => {
                // The buffer grows by doubling. The old one is freed first, because both may not fit.
                let doubled = last.map_or(0, |last| 2 * last.size());
                let size = bytes.max(doubled.min(LONGEST_KEPT));
                let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
                create_with(self, "read back", size, usage)?
            }
        };
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut place = 0;
        for piece in pieces {
            encoder.copy_buffer_to_buffer(piece.buffer, piece.first, &staging, place, piece.bytes);
            place += piece.bytes;
        }
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        let slice = staging.slice(..bytes);
        slice.map_async(wgpu::MapMode::Read, move |mapped| {
            // Sending fails only if the reader has given up.
            let _ = sender.send(mapped);
        });
        self.wait()?;
        match receiver.try_recv() {
            Ok(Ok(())) => {}
            _ => return Err(self.failed("values cannot be read back")),
        }
        let view = slice
            .get_mapped_range()
            .map_err(|error| self.failed(&error.to_string()))?;
        read(&view);
        drop(view);
        staging.unmap();
        if staging.size() <= LONGEST_KEPT {
            *kept = Some(staging);
        }
        Ok(())
    }
}

/// Uniform: one value of `T`, in the layout of its WGSL structure, that the host replaces between submissions.
#[derive(Debug)]
pub struct Uniform<T> {
    /// The buffer, for binding it to a kernel.
    pub raw: wgpu::Buffer,
    value: PhantomData<T>,
}

impl<T: Pod> Uniform<T> {
    /// Uploads a value.
    ///
    /// # Errors
    /// If the device has no room for it.
    pub fn of(gpu: &Gpu, label: &'static str, value: &T) -> Result<Self, GpuError> {
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
    pub fn write(&self, gpu: &Gpu, value: &T) {
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
    gpu.count_demand(label, bytes);
    let bytes = if gpu.only_plans() {
        bytes.min(LARGEST_PLANNED)
    } else {
        bytes
    };
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
    let out_of_memory = || GpuError::OutOfMemory {
        adapter: gpu.adapter().name.clone(),
        what: label.to_owned(),
        bytes: size,
    };
    if gpu.forbids(size) {
        return Err(out_of_memory());
    }
    gpu.count_made();
    gpu.guarded(|| gpu.device.create_buffer(&descriptor))
        .map_err(|error| match error {
            wgpu::Error::OutOfMemory { .. } => out_of_memory(),
            other => gpu.failed(&other.to_string()),
        })
}
