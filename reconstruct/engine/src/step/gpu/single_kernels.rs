//! Kernels of a step that run alone on values of the host: for the stability catalogue, which judges them by f64.

use std::sync::Arc;

use crate::{
    EngineError,
    camera::View,
    device::{DeviceBuffer, Gpu, Program, Rows},
    gaussians::{
        ActivatedGaussians,
        activated_buffers::ActivatedBuffers,
        dropout::{Dropout, gpu::DropoutKernels},
        static_gaussians::{self, InitialGaussians},
    },
    losses::{
        maps::gpu::{MapLoss, MapLosses, Maps},
        photometric::{
            LossValue,
            gpu::{Levels, Loss, LossWeights, loss_value, plain_levels, target_image},
        },
        scaffold::{
            Scaffold,
            gpu::{DeviceScaffold, DeviceScaffoldLoss, ScaffoldCentres},
        },
    },
    parameters::{
        ParameterTable,
        adam::{
            SecondMomentDecay,
            gpu::{Adam, TableStep},
        },
        device_table::TableBuffers,
    },
    render::buffers::DeviceStatus,
    training_view::TrainingView,
};

/// Takes step number `number` (from 1) of Adam on all arrays, each with its own learning rate. Gradients that are not
/// finite count as zero; returns their number.
///
/// # Errors
/// If the device fails.
pub fn adam_step(
    gpu: &Gpu,
    table: &mut ParameterTable,
    number: u64,
    decay: SecondMomentDecay,
) -> Result<u64, EngineError> {
    let rows = table.len();
    let on_device = TableBuffers::new(gpu, &table.arrays, [rows, rows])?;
    for (number, array) in table.arrays.iter().enumerate() {
        let first = on_device.begin(number) as usize;
        on_device.gradients.write(gpu, first, &array.gradients);
    }
    let arrays = table.arrays.iter().enumerate();
    let numbers = arrays.map(|(number, array)| (!array.is_frozen()).then_some(number));
    let next = TableStep::new(gpu, numbers.collect())?;
    let rates: Vec<f32> = table
        .arrays
        .iter()
        .map(|array| array.learning_rate)
        .collect();
    next.set(gpu, (&on_device, rows), (number, decay), &rates);
    let status = DeviceBuffer::of(gpu, "status", &[DeviceStatus::default()])?;
    let mut program = Program::default();
    let of_table = (&next, &on_device, &Rows::new(rows));
    Adam::new(gpu)?.record(gpu, &mut program, of_table, &status.raw);
    program.submit(gpu);
    on_device.read(gpu, &mut table.arrays)?;
    let status = status.read(gpu)?[0];
    Ok(status
        .refused
        .iter()
        .map(|&refused| u64::from(refused))
        .sum())
}

/// Returns the photometric loss of a render (HWC) against an image of the same size, which may have at most 256 values
/// in each channel, and the gradient by the render.
///
/// # Errors
/// If the image has more values, or the device fails.
pub fn photometric_loss(
    gpu: &Gpu,
    view: &View,
    [render, target]: [&[f32]; 2],
    lambda: f32,
) -> Result<(LossValue, Vec<f32>), EngineError> {
    let (pixels, levels) = bytes_of(target)?;
    let view = training_view(view, pixels);
    let (target, counted) = target_image(gpu, &view, &levels)?;
    let weights = LossWeights {
        ssim: lambda,
        total: 1.0,
        masked: false,
    };
    let loss = Loss::new(gpu, &view.view.camera, 0, weights)?;
    loss.set_view(gpu, false, counted);
    let render = DeviceBuffer::of(gpu, "render", render)?;
    let mut program = Program::default();
    loss.record(gpu, &mut program, &render, &target);
    program.submit(gpu);
    let value = loss_value(loss.value.read(gpu)?[0]);
    Ok((value, loss.gradient.read(gpu)?))
}

fn training_view(view: &View, pixels: Vec<u8>) -> TrainingView {
    TrainingView {
        frame: 0,
        view: *view,
        pixels,
        mask: None,
        ignored: None,
    }
}

/// Returns an image as bytes, with the level of every byte of each channel.
fn bytes_of(image: &[f32]) -> Result<(Vec<u8>, Levels), EngineError> {
    let mut levels: [Vec<f32>; 3] = Default::default();
    let mut bytes = Vec::with_capacity(image.len());
    for (at, &value) in image.iter().enumerate() {
        let known = &mut levels[at % 3];
        let place = known
            .iter()
            .position(|level| level.to_bits() == value.to_bits());
        let place = place.unwrap_or_else(|| {
            known.push(value);
            known.len() - 1
        });
        bytes.push(u8::try_from(place).map_err(|_| EngineError::Backend {
            reason: "an image on a device may have at most 256 values in a channel".to_owned(),
        })?);
    }
    let mut all = plain_levels();
    for (all, levels) in all.iter_mut().zip(&levels) {
        all[..levels.len()].copy_from_slice(levels);
    }
    Ok((bytes, all))
}

/// Maps of a render, pixel after pixel.
#[derive(Debug, Clone, Copy)]
pub struct RenderedMaps<'a> {
    /// Transmittance of all Gaussians.
    pub transmittance: &'a [f32],
    /// Three planes of velocities, then one of lifespans.
    pub temporal: [&'a [f32]; 4],
    /// Opacity of the dynamic Gaussians.
    pub opacity: &'a [f32],
    /// Dynamic mask, 255 for all of a pixel.
    pub mask: &'a [u8],
    /// Non-zero for pixels that do not count.
    pub ignored: &'a [u8],
}

/// Returns the sum of the losses on the maps of velocity (outside of the mask), lifespan and opacity, all of one
/// weight, and its gradient by the planes in their order.
///
/// # Errors
/// If the device fails.
pub fn map_losses(
    gpu: &Gpu,
    view: &View,
    rendered: &RenderedMaps<'_>,
    weight: f32,
) -> Result<(f64, Vec<f32>), EngineError> {
    let pixels = rendered.transmittance.len();
    let view = TrainingView {
        mask: Some(rendered.mask.to_vec()),
        ignored: Some(rendered.ignored.to_vec()),
        ..training_view(view, vec![0; 3 * pixels])
    };
    let (target, counted) = target_image(gpu, &view, &plain_levels())?;
    let maps = Maps::new(gpu, pixels)?;
    let losses = MapLosses {
        counted: counted as f32,
        velocity_planes: 3,
        masked: 1,
        velocity_weight: weight,
        lifespan_weight: weight,
        opacity_weight: weight,
        ..MapLosses::default()
    };
    maps.set(gpu, losses);
    let (mut sum, mut gradient) = (0.0, Vec::new());
    let planes: [&[&[f32]]; 2] = [&rendered.temporal, &[rendered.opacity]];
    for (loss, planes) in [MapLoss::Temporal, MapLoss::Opacity]
        .into_iter()
        .zip(planes)
    {
        let black = vec![0.0; 3 * pixels];
        let image = [&black[..], rendered.transmittance].concat();
        let image = [&image[..], &planes.concat()[..]].concat();
        let upstream = DeviceBuffer::zeros(gpu, "gradient by the maps", image.len())?;
        let image = DeviceBuffer::of(gpu, "maps", &image)?;
        let mut program = Program::default();
        let images = [&image, &upstream];
        let partials = maps.record(gpu, &mut program, loss, images, &target)?;
        program.submit(gpu);
        sum += partials.read(gpu)?.into_iter().map(f64::from).sum::<f64>();
        gradient.extend_from_slice(&upstream.read(gpu)?[4 * pixels..]);
    }
    Ok((sum, gradient))
}

/// Leaves out Gaussians at an iteration, which is also that of the schedule, and takes a gradient back, both in place
/// as [`StepDropout::drop_out_vjp`](crate::gaussians::dropout::StepDropout::drop_out_vjp) does. Returns the drawn
/// opacities.
///
/// # Errors
/// If the device fails.
pub fn drop_out(
    gpu: &Gpu,
    dropout: Dropout,
    iteration: u64,
    [gaussians, gradient]: [&mut ActivatedGaussians; 2],
) -> Result<Vec<f32>, EngineError> {
    let len = gaussians.len();
    let buffers = ActivatedBuffers::new(gpu, len, gaussians.sh_degree, gaussians.feature_count)?;
    let rows = Rows::new(len);
    let programs = DropoutKernels::new(gpu)?.record(gpu, dropout, (&buffers, &rows))?;
    buffers.write(gpu, gaussians);
    buffers.write_gradient(gpu, gradient);
    programs.set(gpu, iteration, iteration);
    programs.forward.submit(gpu);
    buffers.read(gpu, gaussians)?;
    let drawn = gaussians.opacities.clone();
    programs.backward.submit(gpu);
    buffers.read(gpu, gaussians)?;
    buffers.read_gradient(gpu, gradient)?;
    Ok(drawn)
}

/// Returns the gradient of the loss on a scaffold, of weight 1, by some centres.
///
/// # Errors
/// If the device fails.
pub fn scaffold_gradient(
    gpu: &Gpu,
    scaffold: &Scaffold,
    centres: &[[f32; 3]],
) -> Result<Vec<f32>, EngineError> {
    let len = centres.len();
    let initial = InitialGaussians::isotropic(
        centres.to_vec(),
        &vec![1.0; len],
        vec![[0.5; 3]; len],
        vec![0.5; len],
    );
    let mut table = static_gaussians::table(&initial, 0);
    let on_device = TableBuffers::new(gpu, &table.arrays, [len, len])?;
    let field = Arc::new(DeviceScaffold::new(gpu, scaffold)?);
    let loss = DeviceScaffoldLoss::new(gpu, field, &on_device, &vec![1.0; len])?;
    loss.set(gpu, len, ScaffoldCentres::All);
    let mut program = Program::default();
    loss.record(gpu, &mut program, &on_device, &Rows::new(len));
    program.submit(gpu);
    on_device.read_gradients(gpu, &mut table.arrays)?;
    Ok(std::mem::take(
        &mut table.arrays[static_gaussians::POSITIONS].gradients,
    ))
}
