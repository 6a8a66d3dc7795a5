//! Devices that render a case: the CPU, or a GPU.

use std::{cell::RefCell, sync::Arc};

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::{parameterizations::Parameterization, setup::Setup};
use omnilife_engine::{
    EngineError,
    camera::View,
    device::Gpu,
    gaussians::{ActivatedGaussians, parameterization::Viewpoint, temporal::TemporalFeatures},
    model::Model,
    parameters::ParameterTable,
    render::{cpu::Renderer, gpu::GpuRenderer, raster::RasterGradient, settings::RenderSettings},
    step::gpu::activation::{GpuActivation, GpuActivator},
};
use omnilife_training::error::ReconstructError;

/// Kinds of devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    /// The CPU.
    Cpu,
    /// The first GPU.
    Gpu,
}

impl DeviceKind {
    /// Both kinds.
    pub const ALL: [Self; 2] = [Self::Cpu, Self::Gpu];

    /// Returns its name in reports.
    pub fn id(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

/// An open device.
#[derive(Debug)]
pub struct Device {
    gpu: Option<GpuDevice>,
}

/// A GPU with its kernels compiled.
#[derive(Debug)]
struct GpuDevice {
    gpu: Arc<Gpu>,
    activator: GpuActivator,
    renderer: RefCell<GpuRenderer>,
}

impl GpuDevice {
    fn open() -> Result<Self, EngineError> {
        let gpu = Arc::new(Gpu::open()?);
        // Cases have settings of their own.
        let renderer = GpuRenderer::new(Arc::clone(&gpu), RenderSettings::new(0.0));
        Ok(Self {
            activator: GpuActivator::new(Arc::clone(&gpu))?,
            renderer: RefCell::new(renderer),
            gpu,
        })
    }
}

/// A rendered case with its gradients.
#[derive(Debug)]
pub struct RoundTrip {
    /// HWC.
    pub colour: Vec<f32>,
    /// Gradients of [`Device::weights`] times colour, by the raw parameters.
    pub table: ParameterTable,
    /// Number of drawn Gaussians.
    pub drawn: usize,
}

/// Activated Gaussians, rendered, with their gradients.
#[derive(Debug)]
pub struct ActivatedRoundTrip {
    /// HWC.
    pub colour: Vec<f32>,
    /// Plane after plane.
    pub features: Vec<f32>,
    /// Gradients of the weighted image by the activated parameters.
    pub gradient: ActivatedGaussians,
    /// Number of drawn Gaussians.
    pub drawn: usize,
}

/// Gaussians of a part, with the backward pass from them to its parameters.
struct Activation {
    gaussians: ActivatedGaussians,
    back: WayBack,
}

enum WayBack {
    Cpu(Box<Model>, Viewpoint),
    Gpu(Box<GpuActivation>),
}

impl Activation {
    /// Returns the part's table with gradients.
    fn backward(
        &mut self,
        mut gradient: ActivatedGaussians,
    ) -> Result<ParameterTable, ReconstructError> {
        let model = match &mut self.back {
            WayBack::Cpu(model, at) => {
                let none = TemporalFeatures::default();
                model.activate_backward(at, &none, &mut self.gaussians, &mut gradient);
                model
            }
            WayBack::Gpu(activation) => activation.activate_backward(&gradient)?,
        };
        Ok(model.parts[0].table.clone())
    }
}

impl Device {
    /// Opens a device.
    ///
    /// # Errors
    /// The reason for a missing device, in one line.
    pub fn open(kind: DeviceKind) -> Result<Self, String> {
        match kind {
            DeviceKind::Cpu => Ok(Self { gpu: None }),
            DeviceKind::Gpu => match GpuDevice::open() {
                Ok(gpu) => Ok(Self { gpu: Some(gpu) }),
                Err(error) => Err(error.to_string()),
            },
        }
    }

    /// Returns its kind.
    pub fn kind(&self) -> DeviceKind {
        if self.gpu.is_some() {
            DeviceKind::Gpu
        } else {
            DeviceKind::Cpu
        }
    }

    /// Returns its description in words.
    pub fn describe(&self) -> String {
        match &self.gpu {
            None => format!("{} processor", std::env::consts::ARCH),
            Some(device) => {
                let adapter = device.gpu.adapter();
                format!("{} ({}, {})", adapter.name, adapter.kind, adapter.driver)
            }
        }
    }

    /// Returns the weights of the loss for gradients: the same for every device, one per value of an image.
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

    /// Renders a case like [`Device::round_trip`], with other weights.
    ///
    /// # Errors
    /// When the device fails.
    pub fn round_trip_with(
        &self,
        setup: &Setup,
        parameterization: &Parameterization,
        table: ParameterTable,
        weights: &[f32],
    ) -> Result<RoundTrip, ReconstructError> {
        let part = (parameterization.part)(table, setup);
        let mut activation = self.activate(Model::new(vec![part]), &setup.viewpoint())?;
        let settings = setup.exact.settings;
        let gaussians = &activation.gaussians;
        let made = self.round_trip_activated(&setup.view, settings, gaussians, [weights, &[]])?;
        let table = activation.backward(made.gradient)?;
        Ok(RoundTrip {
            colour: made.colour,
            table,
            drawn: made.drawn,
        })
    }

    fn activate(&self, mut model: Model, at: &Viewpoint) -> Result<Activation, ReconstructError> {
        let (gaussians, back) = match &self.gpu {
            None => {
                let mut gaussians = ActivatedGaussians::default();
                model.activate(at, &TemporalFeatures::default(), &mut gaussians);
                (gaussians, WayBack::Cpu(Box::new(model), *at))
            }
            Some(device) => {
                let activation = device.activator.activation(model, at)?;
                (activation.activate()?, WayBack::Gpu(Box::new(activation)))
            }
        };
        Ok(Activation { gaussians, back })
    }

    /// Renders activated Gaussians and takes the gradient of the image back to them. The image is weighted by
    /// colour and by feature planes (empty weights leave those out).
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
            Some(device) => {
                let mut renderer = device.renderer.borrow_mut();
                renderer.settings = settings;
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
