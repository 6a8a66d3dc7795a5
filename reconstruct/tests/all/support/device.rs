//! A GPU for tests, and its tolerances against the CPU.

use std::sync::Arc;

use omnilife_engine::device::{Gpu, GpuError, KernelChoices, PixelSums};
use omnilife_schemas::RgbImage;

/// Returns a device; without any adapter `None`, and a line with the reason.
pub(crate) fn device() -> Option<Arc<Gpu>> {
    match Gpu::open() {
        Ok(gpu) => {
            println!("on {} ({})", gpu.adapter().name, gpu.adapter().kind);
            Some(Arc::new(gpu))
        }
        Err(GpuError::NoAdapter) => {
            omnilife_schemas::testing::skip(GpuError::NoAdapter);
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Returns a device with subgroups, the same without, and the same with a thread per splat, so that all forms of
/// the sums over pixels are judged. On a smaller machine: fewer, and a line with the reason.
pub(crate) fn devices() -> Vec<Arc<Gpu>> {
    let Some(gpu) = device() else {
        return Vec::new();
    };
    let per_splat = KernelChoices {
        sums_per_splat: true,
        ..KernelChoices::default()
    };
    let others = [
        Gpu::open_without_subgroups(),
        Gpu::open_with_choices(per_splat),
    ];
    let others = others.map(|opened| match opened {
        Ok(other) => Arc::new(other),
        Err(error) => panic!("{error}"),
    });
    let forms = others.each_ref().map(|other| other.pixel_sums());
    assert_eq!(forms, [PixelSums::Workgroups, PixelSums::Splats]);
    match gpu.subgroup_size() {
        Some(size) => {
            println!(
                "with subgroups of {size} threads at least, without, and with a thread per splat"
            );
            [gpu].into_iter().chain(others).collect()
        }
        None => {
            println!("with a thread per splat and without; the adapter lacks subgroups");
            others.into()
        }
    }
}

/// Asserts that every value is within 5e-3 of its own size or of the array's typical size.
pub(crate) fn assert_gradients_agree(name: &str, of_gpu: &[f32], of_cpu: &[f32]) {
    assert_eq!(of_gpu.len(), of_cpu.len(), "{name}");
    let mean_square = of_cpu.iter().map(|g| g * g).sum::<f32>() / of_cpu.len().max(1) as f32;
    let typical = mean_square.sqrt();
    assert!(of_cpu.is_empty() || typical > 0.0, "{name} does nothing");
    for (index, (gpu, cpu)) in of_gpu.iter().zip(of_cpu).enumerate() {
        assert!(
            (gpu - cpu).abs() < 5e-3 * cpu.abs().max(typical),
            "{name}[{index}]: {gpu} on the device, {cpu} on the CPU (typical {typical})"
        );
    }
}

/// Asserts that images agree. Where a gradient is nearly 0, Adam's first steps differ between the two.
pub(crate) fn assert_images_agree(of_gpu: &RgbImage, of_cpu: &RgbImage) {
    let pairs = of_gpu.data.iter().zip(&of_cpu.data);
    let error: f32 = pairs.map(|(a, b)| (a - b).abs()).sum();
    assert!(error < 1e-3 * of_gpu.data.len() as f32, "{error}");
}
