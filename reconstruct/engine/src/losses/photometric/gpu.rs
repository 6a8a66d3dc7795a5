//! The loss on a GPU.

use crate::device::{
    DeviceBuffer, Gpu, GpuError, Program, Shader, Uniform, WORKGROUP, kernels, wgsl_struct,
};
use crate::{
    losses::photometric::{Columns, LossValue},
    training_view::TrainingView,
};
use omnilife_schemas::camera::Camera;

wgsl_struct! {
    /// Size of the image and weights.
    pub(crate) struct LossSettings {
        width: u32,
        height: u32,
        /// Weight of `1 - SSIM`.
        lambda: f32,
        /// Number of values of the pixels that count.
        counted: f32,
        /// Weights of the window's taps, from the centre outwards.
        taps: [[f32; 4]; 2],
        /// 1 if only the masked part of the image counts.
        masked: u32,
        /// Weight of the whole loss.
        weight: f32,
        /// 1 if the first column follows the last.
        wraps: u32,
        /// 1 if gains are removed: a saturated value is then only a lower bound.
        bounds_saturated: u32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "loss.wgsl",
        constants: String::new(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("loss.wgsl"),
        ],
    }
}

/// Pixels whose marks share a word.
const MARKS: usize = u32::BITS as usize;

/// Levels of the bytes of each channel.
pub(crate) type Levels = [[f32; 256]; 3];

/// Returns the words of a packed image of `pixels` pixels.
pub(crate) fn packed_len(pixels: usize) -> usize {
    pixels + pixels.div_ceil(MARKS) + size_of::<Levels>() / size_of::<u32>()
}

/// Packs an image for the losses: 8 bits per channel, red in the lowest byte, the mask (0 if missing) in the
/// highest. A bit per pixel follows, set if it is ignored, and then the level of every byte.
fn pack_pixels(
    rgb: &[u8],
    mask: Option<&[u8]>,
    ignored: Option<&[u8]>,
    levels: &Levels,
) -> Vec<u32> {
    let masks = mask.unwrap_or_default().iter().copied();
    let pixels = rgb.as_chunks::<3>().0;
    let mut packed: Vec<u32> = pixels
        .iter()
        .zip(masks.chain(std::iter::repeat(0)))
        .map(|(&[red, green, blue], mask)| u32::from_le_bytes([red, green, blue, mask]))
        .collect();
    packed.resize(packed_len(pixels.len()), 0);
    let marked = ignored.unwrap_or_default().iter().enumerate();
    for (pixel, _) in marked.filter(|&(_, &mark)| mark != 0) {
        packed[pixels.len() + pixel / MARKS] |= 1 << (pixel % MARKS);
    }
    let first = pixels.len() + pixels.len().div_ceil(MARKS);
    for (word, level) in packed[first..].iter_mut().zip(levels.as_flattened()) {
        *word = level.to_bits();
    }
    packed
}

/// Returns the levels of bytes without a gain to remove.
pub(crate) fn plain_levels() -> Levels {
    [std::array::from_fn(|byte| byte as f32 / 255.0); 3]
}

/// Uploads the image of a view, with the levels of its bytes; returns it with the number of its pixels that count.
pub(crate) fn target_image(
    gpu: &Gpu,
    view: &TrainingView,
    levels: &Levels,
) -> Result<(DeviceBuffer<u32>, usize), GpuError> {
    let (mask, ignored) = (view.mask.as_deref(), view.ignored.as_deref());
    let packed = pack_pixels(&view.pixels, mask, ignored, levels);
    let image = DeviceBuffer::of(gpu, "image of a view", &packed)?;
    Ok((image, view.counted_pixels()))
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LossWeights {
    /// Weight of `1 - SSIM` against L1.
    pub(crate) ssim: f32,
    /// Weight of the whole loss.
    pub(crate) total: f32,
    /// True if only the masked part of the image counts; elsewhere the target is black.
    pub(crate) masked: bool,
}

kernels! {
    /// Kernels of the loss.
    struct LossKernels() = shader() => [
        blur_rows,
        structural_similarity,
        blur_derivative_rows,
        image_gradient,
        loss_value,
    ];
}

/// The loss of images of one size. Its buffers are reused over iterations.
#[derive(Debug)]
pub(crate) struct Loss {
    kernels: LossKernels,
    settings: Uniform<LossSettings>,
    /// Settings of images whose gain stays, where every pixel counts.
    plain: LossSettings,
    pixels: usize,
    rows: DeviceBuffer<f32>,
    derivatives: DeviceBuffer<f32>,
    partials: DeviceBuffer<[f32; 4]>,
    /// Gradient by the render, in its layout.
    pub(crate) gradient: DeviceBuffer<f32>,
    /// See [`loss_value`].
    pub(crate) value: DeviceBuffer<[f32; 4]>,
}

impl Loss {
    /// Creates the loss of a camera's images that are followed by `planes` planes. The gradient has room for
    /// the planes, and the loss does not write them.
    pub(crate) fn new(
        gpu: &Gpu,
        camera: &Camera,
        planes: usize,
        weights: LossWeights,
    ) -> Result<Self, GpuError> {
        let [width, height] = camera.size();
        let pixels = width * height;
        let window = super::cpu::gaussian_window();
        let middle = &window[window.len() / 2..];
        let plain = LossSettings {
            width: camera.width(),
            height: camera.height(),
            lambda: weights.ssim,
            counted: (3 * pixels) as f32,
            taps: std::array::from_fn(|four| {
                std::array::from_fn(|tap| middle.get(four * 4 + tap).copied().unwrap_or(0.0))
            }),
            masked: u32::from(weights.masked),
            weight: weights.total,
            wraps: u32::from(Columns::of(camera) == Columns::Wrap),
            bounds_saturated: 0,
        };
        Ok(Self {
            kernels: LossKernels::new(gpu)?,
            settings: Uniform::of(gpu, "loss settings", &plain)?,
            plain,
            pixels,
            rows: DeviceBuffer::zeros(gpu, "blurred rows", pixels * 5 * 3)?,
            derivatives: DeviceBuffer::zeros(gpu, "derivatives of SSIM", pixels * 3 * 3)?,
            partials: DeviceBuffer::zeros(gpu, "sums", pixels.div_ceil(WORKGROUP as usize))?,
            gradient: DeviceBuffer::zeros(gpu, "gradient by the image", pixels * (3 + planes))?,
            value: DeviceBuffer::zeros(gpu, "loss", 1)?,
        })
    }

    /// Sets true where a gain is removed from images, and the number of pixels that count, for everything that is
    /// submitted later.
    pub(crate) fn set_view(&self, gpu: &Gpu, removes_gain: bool, counted_pixels: usize) {
        let settings = LossSettings {
            bounds_saturated: u32::from(removes_gain),
            counted: (3 * counted_pixels) as f32,
            ..self.plain
        };
        self.settings.write(gpu, &settings);
    }

    /// Records value and gradient of the loss of `render` (HWC) against `target` ([`pack_pixels`]).
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        render: &DeviceBuffer<f32>,
        target: &DeviceBuffer<u32>,
    ) {
        let (kernels, settings) = (&self.kernels, &self.settings.raw);
        let (rows, derivatives) = (&self.rows.raw, &self.derivatives.raw);
        let images = [settings, &render.raw, &target.raw, rows];
        program.run(gpu, &kernels.blur_rows, self.pixels, &images);
        let [a, b, c, d] = images;
        let buffers = [a, b, c, d, derivatives, &self.partials.raw];
        program.run(gpu, &kernels.structural_similarity, self.pixels, &buffers);
        let buffers = [settings, derivatives, rows];
        program.run(gpu, &kernels.blur_derivative_rows, self.pixels, &buffers);
        let buffers = [a, b, c, d, &self.gradient.raw];
        program.run(gpu, &kernels.image_gradient, self.pixels, &buffers);
        let buffers = [settings, &self.partials.raw, &self.value.raw];
        program.run_workgroups(gpu, &kernels.loss_value, 1, &buffers);
    }
}

/// Converts the output of the kernel `loss_value`: mean |x - y|, mean (x - y)^2, mean SSIM, and the weighted
/// loss.
pub(crate) fn loss_value(value: [f32; 4]) -> LossValue {
    let [l1, mse, ssim, total] = value.map(f64::from);
    LossValue {
        total,
        l1,
        ssim,
        mse,
    }
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{
        camera::{ErpCamera, PinholeCamera},
        srgb,
    };
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::{
        device::test_device,
        losses::photometric::{PixelMarks, cpu},
    };

    #[test]
    fn value_and_gradient_are_those_of_the_cpu() {
        let Some(gpu) = test_device() else { return };
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let sizes = [
            (64_u32, 32_u32, 0.2),
            (37, 19, 0.7),
            (4, 3, 1.0),
            (37, 19, 0.2),
        ];
        let cases = sizes.into_iter().enumerate();
        for (number, (width, height, lambda), wraps) in
            cases.flat_map(|(number, size)| [true, false].map(|wraps| (number, size, wraps)))
        {
            let camera = if wraps {
                Camera::Erp(ErpCamera { width, height })
            } else {
                let radians = 1.0;
                PinholeCamera::with_horizontal_field_of_view(width, height, radians).into()
            };
            let len = (width * height * 3) as usize;
            let render: Vec<f32> = (0..len).map(|_| random.random_range(-0.2..1.2)).collect();
            let mut target: Vec<u8> = (0..len).map(|_| random.random()).collect();
            let gain = (!wraps).then_some([0.8, 1.0, 1.6]);
            for value in target.iter_mut().step_by(5) {
                *value = 255;
            }
            let weights = LossWeights {
                ssim: lambda,
                total: 1.0,
                masked: false,
            };
            let loss = Loss::new(&gpu, &camera, 0, weights).expect("fits");
            let render_buffer = DeviceBuffer::of(&gpu, "render", &render).expect("fits");
            // The last cases ignore a region across the seam.
            let ignored = (number >= 2).then(|| -> Vec<u8> {
                let columns = (0..width * height).map(|at| at % width);
                columns
                    .map(|column| u8::from(column < 2 || column > width / 2))
                    .collect()
            });
            let ignored = ignored.as_deref();
            let counted =
                ignored.map_or(len / 3, |marks| marks.iter().filter(|m| **m == 0).count());
            loss.set_view(&gpu, gain.is_some(), counted);
            let levels = gain.map_or_else(plain_levels, |gain: [f32; 3]| {
                gain.map(|gain| {
                    std::array::from_fn(|byte| srgb::brightened(byte as f32 / 255.0, 1.0 / gain))
                })
            });
            let packed = pack_pixels(&target, None, ignored, &levels);
            assert_eq!(packed.len(), packed_len(len / 3));
            let target_buffer = DeviceBuffer::of(&gpu, "target", &packed).expect("fits");
            let mut program = Program::default();
            loss.record(&gpu, &mut program, &render_buffer, &target_buffer);
            program.submit(&gpu);
            let value = loss_value(loss.value.read(&gpu).expect("reads")[0]);
            let gradient = loss.gradient.read(&gpu).expect("reads");

            let saturated: Vec<bool> = target.iter().map(|&byte| byte == 255).collect();
            let marks = PixelMarks {
                ignored,
                saturated: if gain.is_some() { &saturated[..] } else { &[] },
            };
            let target: Vec<f32> = target
                .iter()
                .enumerate()
                .map(|(at, &byte)| levels[at % 3][usize::from(byte)])
                .collect();
            let [width, height] = camera.size();
            let mut on_cpu = cpu::Loss::new(width, height, Columns::of(&camera));
            let (expected, expected_gradient) =
                on_cpu.forward_backward_marked(marks, &render, &target, lambda);
            for (value, expected) in [
                (value.total, expected.total),
                (value.l1, expected.l1),
                (value.ssim, expected.ssim),
                (value.mse, expected.mse),
            ] {
                assert!(
                    (value - expected).abs() < 1e-5,
                    "{value} against {expected}"
                );
            }
            let largest = expected_gradient
                .iter()
                .fold(0.0_f32, |m, g| m.max(g.abs()));
            for (value, expected) in gradient.iter().zip(expected_gradient) {
                assert!(
                    (value - expected).abs() < 1e-4 * largest,
                    "{value} against {expected}"
                );
            }
        }
    }

    #[test]
    fn an_image_without_a_pixel_that_counts_has_no_loss() {
        let Some(gpu) = test_device() else { return };
        let (width, height, pixels) = (16, 8, 16 * 8);
        let weights = LossWeights {
            ssim: 0.2,
            total: 1.0,
            masked: false,
        };
        let camera = ErpCamera { width, height }.into();
        let loss = Loss::new(&gpu, &camera, 0, weights).expect("fits");
        loss.set_view(&gpu, false, 0);
        let render = DeviceBuffer::of(&gpu, "render", &vec![0.25; 3 * pixels]).expect("fits");
        let packed = pack_pixels(
            &vec![200; 3 * pixels],
            None,
            Some(&vec![1; pixels]),
            &plain_levels(),
        );
        let target = DeviceBuffer::of(&gpu, "target", &packed).expect("fits");
        let mut program = Program::default();
        loss.record(&gpu, &mut program, &render, &target);
        program.submit(&gpu);
        assert_eq!(loss.value.read(&gpu).expect("reads"), [[0.0; 4]]);
        let gradient = loss.gradient.read(&gpu).expect("reads");
        assert!(gradient.iter().all(|&value| value == 0.0));
    }
}
