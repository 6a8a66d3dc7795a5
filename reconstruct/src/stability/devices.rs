//! What renders a case: the CPU, or a GPU.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::error::ReconstructError;
use crate::stability::{parameterizations::Parameterization, setup::Setup};
use omnilife_engine::{
    camera::View,
    device::Gpu,
    gaussians::ActivatedGaussians,
    parameters::ParameterTable,
    render::{cpu::Renderer, gpu::GpuRenderer, raster::RasterGradient, settings::RenderSettings},
};

/// Kinds of devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// The CPU.
    Cpu,
    /// The first GPU.
    Gpu,
}

impl DeviceKind {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Cpu, Self::Gpu];

    /// Its name in reports.
    pub fn id(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

/// A device that is ready.
#[derive(Debug)]
pub struct Device {
    gpu: Option<Arc<Gpu>>,
}

/// A rendered case with its gradients.
#[derive(Debug)]
pub struct RoundTrip {
    /// HWC.
    pub colour: Vec<f32>,
    /// Gradients of [`Device::weights`] times colour, by the raw parameters.
    pub table: ParameterTable,
    /// Gaussians that were drawn.
    pub drawn: usize,
}

/// Activated Gaussians, rendered, with their gradients.
#[derive(Debug)]
pub struct ActivatedRoundTrip {
    /// HWC.
    pub colour: Vec<f32>,
    /// Plane after plane.
    pub features: Vec<f32>,
    /// Gradients of the weighted image by what the Gaussians are.
    pub gradient: ActivatedGaussians,
    /// Gaussians that were drawn.
    pub drawn: usize,
}

impl Device {
    /// Opens a device.
    ///
    /// # Errors
    /// Why there is none, in one line.
    pub fn open(kind: DeviceKind) -> Result<Self, String> {
        match kind {
            DeviceKind::Cpu => Ok(Self { gpu: None }),
            DeviceKind::Gpu => match Gpu::open() {
                Ok(gpu) => Ok(Self {
                    gpu: Some(Arc::new(gpu)),
                }),
                Err(error) => Err(error.to_string()),
            },
        }
    }

    /// Which kind it is.
    pub fn kind(&self) -> DeviceKind {
        if self.gpu.is_some() {
            DeviceKind::Gpu
        } else {
            DeviceKind::Cpu
        }
    }

    /// What it is, in words.
    pub fn describe(&self) -> String {
        match &self.gpu {
            None => format!("{} processor", std::env::consts::ARCH),
            Some(gpu) => {
                let adapter = gpu.adapter();
                format!("{} ({}, {})", adapter.name, adapter.kind, adapter.driver)
            }
        }
    }

    /// Weights of the loss that gradients are taken of: the same for every device, one per value of
    /// an image.
    pub fn weights(values: usize) -> Vec<f32> {
        let mut random = Pcg64Mcg::seed_from_u64(7);
        (0..values)
            .map(|_| random.random_range(-1.0..1.0))
            .collect()
    }

    /// Renders a case and takes the gradient of the weighted image back to the raw parameters.
    ///
    /// # Errors
    /// When the device fails.
    pub fn round_trip(
        &self,
        setup: &Setup,
        parameterization: &Parameterization,
        table: ParameterTable,
    ) -> Result<RoundTrip, ReconstructError> {
        let camera = setup.view.camera;
        let values = camera.width() as usize * camera.height() as usize * 3;
        self.round_trip_with(setup, parameterization, table, &Self::weights(values))
    }

    /// The same with other weights.
    ///
    /// # Errors
    /// When the device fails.
    pub fn round_trip_with(
        &self,
        setup: &Setup,
        parameterization: &Parameterization,
        mut table: ParameterTable,
        weights: &[f32],
    ) -> Result<RoundTrip, ReconstructError> {
        let mut instant = ActivatedGaussians::default();
        (parameterization.activate)(&table, setup, &mut instant);
        let settings = setup.exact.settings;
        let made = self.round_trip_activated(&setup.view, settings, &instant, [weights, &[]])?;
        (parameterization.activate_vjp)(&mut table, &instant, &made.gradient, setup);
        Ok(RoundTrip {
            colour: made.colour,
            table,
            drawn: made.drawn,
        })
    }

    /// Renders activated Gaussians and takes the gradient of the image, weighted by colour and by feature
    /// planes (empty where they do not count), back to them.
    ///
    /// # Errors
    /// When the device fails.
    pub fn round_trip_activated(
        &self,
        view: &View,
        settings: RenderSettings,
        gaussians: &ActivatedGaussians,
        [colour, features]: [&[f32]; 2],
    ) -> Result<ActivatedRoundTrip, ReconstructError> {
        let upstream = RasterGradient { colour, features };
        let mut gradient = ActivatedGaussians::default();
        let (colour, features, drawn) = match &self.gpu {
            None => {
                let mut renderer = Renderer::new(settings);
                let raster = renderer.forward(view, gaussians);
                let (colour, features) = (raster.colour.clone(), raster.features.clone());
                renderer.backward(view, gaussians, &upstream, &mut gradient);
                (colour, features, renderer.visible().count())
            }
            Some(gpu) => {
                let mut renderer = GpuRenderer::new(gpu.clone(), settings);
                let raster = renderer.forward(view, gaussians)?;
                renderer.backward(&upstream, &mut gradient)?;
                (raster.colour, raster.features, renderer.visible()?.len())
            }
        };
        Ok(ActivatedRoundTrip {
            colour,
            features,
            gradient,
            drawn,
        })
    }
}
