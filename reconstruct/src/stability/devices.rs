//! What renders a case: the CPU, or a GPU.

use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::error::ReconstructError;
use crate::stability::{parameterizations::Parameterization, setup::Setup};
use omnilife_engine::{
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
        let settings: RenderSettings = setup.exact.settings;
        let upstream = RasterGradient {
            colour: weights,
            features: &[],
        };
        let mut instant = ActivatedGaussians::default();
        (parameterization.activate)(&table, setup, &mut instant);
        let mut gradient = ActivatedGaussians::default();
        let (colour, drawn) = match &self.gpu {
            None => {
                let mut renderer = Renderer::new(settings);
                let colour = renderer.forward(&setup.view, &instant).colour.clone();
                renderer.backward(&setup.view, &instant, &upstream, &mut gradient);
                (colour, renderer.visible().count())
            }
            Some(gpu) => {
                let mut renderer = GpuRenderer::new(gpu.clone(), settings);
                let raster = renderer.forward(&setup.view, &instant)?;
                renderer.backward(&upstream, &mut gradient)?;
                (raster.colour, renderer.visible()?.len())
            }
        };
        (parameterization.activate_vjp)(&mut table, &instant, &gradient, setup);
        Ok(RoundTrip {
            colour,
            table,
            drawn,
        })
    }
}
