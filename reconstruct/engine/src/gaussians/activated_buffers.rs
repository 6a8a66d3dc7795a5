//! Activated Gaussians and their gradients in GPU memory.

use crate::device::{DeviceBuffer, Gpu, GpuError, wgsl_struct};

use super::ActivatedGaussians;

wgsl_struct! {
    /// Activated Gaussian, or the gradient by one; `Gaussian` in WGSL.
    pub struct DeviceGaussian {
        position: [f32; 3],
        opacity: f32,
        scale: [f32; 3],
        pad: f32,
        rotation: [f32; 4],
    }
}

/// Outputs of a parameterization, and their gradients from the renderer, with room for all Gaussians of a model.
#[derive(Debug)]
pub struct ActivatedBuffers {
    pub(crate) len: usize,
    /// Degree of the stored harmonics.
    pub(crate) sh_degree: usize,
    /// Feature channels.
    pub(crate) feature_count: usize,
    /// One entry per Gaussian.
    pub gaussians: DeviceBuffer<DeviceGaussian>,
    /// Harmonic coefficients: three values for each of `(degree + 1)^2` coefficients of each Gaussian, the
    /// constant one first.
    pub harmonics: DeviceBuffer<f32>,
    /// Feature channels, Gaussian by Gaussian.
    pub features: DeviceBuffer<f32>,
    /// Gradients of the loss by `gaussians`.
    pub gaussian_gradients: DeviceBuffer<DeviceGaussian>,
    /// Gradients of the loss by `harmonics`.
    pub harmonic_gradients: DeviceBuffer<f32>,
    /// Gradients of the loss by `features`.
    pub feature_gradients: DeviceBuffer<f32>,
}

impl ActivatedBuffers {
    /// Allocates buffers for `len` Gaussians.
    pub(crate) fn new(
        gpu: &Gpu,
        len: usize,
        sh_degree: usize,
        feature_count: usize,
    ) -> Result<Self, GpuError> {
        let harmonics = len * (sh_degree + 1) * (sh_degree + 1) * 3;
        let features = len * feature_count;
        Ok(Self {
            len,
            sh_degree,
            feature_count,
            gaussians: DeviceBuffer::zeros(gpu, "Gaussians", len)?,
            harmonics: DeviceBuffer::zeros(gpu, "harmonics", harmonics)?,
            features: DeviceBuffer::zeros(gpu, "features", features)?,
            gaussian_gradients: DeviceBuffer::zeros(gpu, "gradients by Gaussians", len)?,
            harmonic_gradients: DeviceBuffer::zeros(gpu, "gradients by harmonics", harmonics)?,
            feature_gradients: DeviceBuffer::zeros(gpu, "gradients by features", features)?,
        })
    }

    /// Returns the coefficients per Gaussian, including the constant one.
    pub(crate) fn harmonics_per_gaussian(&self) -> usize {
        (self.sh_degree + 1) * (self.sh_degree + 1)
    }

    /// Sets the Gaussians for everything that is submitted later.
    pub(crate) fn write(&self, gpu: &Gpu, instant: &ActivatedGaussians) {
        self.gaussians.write(gpu, 0, &packed(instant));
        self.harmonics
            .write(gpu, 0, &self.joined_harmonics(instant));
        self.features.write(gpu, 0, &instant.features);
    }

    /// Sets the gradient by the Gaussians for everything that is submitted later.
    pub(crate) fn write_gradient(&self, gpu: &Gpu, gradient: &ActivatedGaussians) {
        self.gaussian_gradients.write(gpu, 0, &packed(gradient));
        let harmonics = self.joined_harmonics(gradient);
        self.harmonic_gradients.write(gpu, 0, &harmonics);
        self.feature_gradients.write(gpu, 0, &gradient.features);
    }

    /// Joins the constant coefficient and the rest of each Gaussian in the device's layout.
    fn joined_harmonics(&self, instant: &ActivatedGaussians) -> Vec<f32> {
        let rest = self.harmonics_per_gaussian() - 1;
        let constants = instant.sh_constant.iter().enumerate();
        constants
            .flat_map(|(index, constant)| {
                let rest = &instant.sh_rest[index * rest..(index + 1) * rest];
                std::iter::once(constant).chain(rest).flatten().copied()
            })
            .collect()
    }

    /// Reads the Gaussians back into `out`.
    pub(crate) fn read(&self, gpu: &Gpu, out: &mut ActivatedGaussians) -> Result<(), GpuError> {
        let columns = (&self.gaussians, &self.harmonics, &self.features);
        self.read_columns(gpu, columns, out)
    }

    /// Reads the gradient by the Gaussians back into `out`.
    pub(crate) fn read_gradient(
        &self,
        gpu: &Gpu,
        out: &mut ActivatedGaussians,
    ) -> Result<(), GpuError> {
        let columns = (
            &self.gaussian_gradients,
            &self.harmonic_gradients,
            &self.feature_gradients,
        );
        self.read_columns(gpu, columns, out)
    }

    fn read_columns(
        &self,
        gpu: &Gpu,
        (gaussians, harmonics, features): (
            &DeviceBuffer<DeviceGaussian>,
            &DeviceBuffer<f32>,
            &DeviceBuffer<f32>,
        ),
        out: &mut ActivatedGaussians,
    ) -> Result<(), GpuError> {
        out.reshape(self.len, self.sh_degree, self.feature_count);
        let gaussians = gaussians.read(gpu)?;
        let harmonics = harmonics.read(gpu)?;
        out.features = features.read(gpu)?;
        let rest = self.harmonics_per_gaussian() - 1;
        let per_gaussian = harmonics
            .as_chunks::<3>()
            .0
            .chunks(self.harmonics_per_gaussian());
        for (index, (gaussian, harmonics)) in gaussians.iter().zip(per_gaussian).enumerate() {
            out.positions[index] = gaussian.position;
            out.opacities[index] = gaussian.opacity;
            out.scales[index] = gaussian.scale;
            out.rotations[index] = gaussian.rotation;
            out.sh_constant[index] = harmonics[0];
            out.sh_rest[index * rest..(index + 1) * rest].copy_from_slice(&harmonics[1..]);
        }
        Ok(())
    }
}

/// Packs Gaussians, or their gradients, in the device's layout; harmonics and features are stored separately.
fn packed(instant: &ActivatedGaussians) -> Vec<DeviceGaussian> {
    (0..instant.len())
        .map(|index| DeviceGaussian {
            position: instant.positions[index],
            opacity: instant.opacities[index],
            scale: instant.scales[index],
            pad: 0.0,
            rotation: instant.rotations[index],
        })
        .collect()
}
