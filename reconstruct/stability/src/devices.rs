//! Devices that render a case: the CPU, or a GPU.

use std::{cell::RefCell, sync::Arc};

use glam::{Mat3, Vec3};
use omnilife_schemas::camera::ErpCamera;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::{parameterizations::Parameterization, setup::Setup};
use omnilife_engine::{
    EngineError,
    camera::View,
    density,
    device::Gpu,
    gaussians::{
        ActivatedGaussians, dropout::Dropout, parameterization::Viewpoint,
        temporal::TemporalFeatures,
    },
    losses::{
        photometric::{Columns, cpu::Loss},
        scaffold::Scaffold,
    },
    model::{Model, Part},
    parameters::{ParameterTable, adam},
    render::{
        cpu::Renderer,
        gpu::GpuRenderer,
        project::by_camera::{self, PoseGradient},
        raster::RasterGradient,
        settings::RenderSettings,
    },
    step::{
        BackendChoice,
        gpu::{
            activation::{GpuActivation, GpuActivator},
            single_kernels,
        },
    },
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

    /// Returns the backend of trainings.
    pub fn backend(self) -> BackendChoice {
        match self {
            Self::Cpu => BackendChoice::Cpu,
            Self::Gpu => BackendChoice::Gpu,
        }
    }

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
    back: GradientPass,
}

enum GradientPass {
    Cpu(Box<Model>, Viewpoint),
    Gpu(Box<GpuActivation>),
}

impl Activation {
    /// Returns the part with gradients by its parameters.
    fn backward(&mut self, mut gradient: ActivatedGaussians) -> Result<Part, ReconstructError> {
        let model = match &mut self.back {
            GradientPass::Cpu(model, at) => {
                let none = TemporalFeatures::default();
                model.activate_backward(at, &none, &mut self.gaussians, &mut gradient);
                model
            }
            GradientPass::Gpu(activation) => activation.activate_backward(&gradient)?,
        };
        Ok(model.parts[0].clone())
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

    /// Returns the limit of an error here, by that on the CPU: ten times as much on a GPU, whose built-in functions
    /// may be off by several last bits.
    pub fn limit(&self, on_cpu: f64) -> f64 {
        match self.kind() {
            DeviceKind::Cpu => on_cpu,
            DeviceKind::Gpu => 10.0 * on_cpu,
        }
    }

    /// Returns the open GPU; `None` for the CPU.
    pub fn gpu(&self) -> Option<&Gpu> {
        self.gpu.as_ref().map(|device| &*device.gpu)
    }

    /// Returns the activator of the open GPU; `None` for the CPU.
    pub fn activator(&self) -> Option<&GpuActivator> {
        self.gpu.as_ref().map(|device| &device.activator)
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
        let part = activation.backward(made.gradient)?;
        Ok(RoundTrip {
            colour: made.colour,
            table: part.table,
            drawn: made.drawn,
        })
    }

    /// Activates a part and takes the gradient by its Gaussians, which `upstream` makes, back to its parameters.
    /// Returns the Gaussians, and the part with its gradients.
    ///
    /// # Errors
    /// When the device fails.
    pub fn activated_part(
        &self,
        part: Part,
        at: &Viewpoint,
        upstream: impl FnOnce(&ActivatedGaussians) -> ActivatedGaussians,
    ) -> Result<(ActivatedGaussians, Part), ReconstructError> {
        let mut activation = self.activate(Model::new(vec![part]), at)?;
        let gaussians = activation.gaussians.clone();
        let part = activation.backward(upstream(&gaussians))?;
        Ok((gaussians, part))
    }

    /// Returns the gradient of a weighted image of activated Gaussians by the pose of its view.
    ///
    /// # Errors
    /// When the device fails.
    pub fn pose_gradient(
        &self,
        view: &View,
        settings: RenderSettings,
        gaussians: &ActivatedGaussians,
        weights: &[f32],
    ) -> Result<PoseGradient, ReconstructError> {
        let weighted: [&[f32]; 2] = [weights, &[]];
        let made = self.round_trip_activated(view, settings, gaussians, weighted)?;
        let degree = settings.sh_degree;
        Ok(match &self.gpu {
            None => by_camera::gradient(view, gaussians, degree, &made.gradient),
            Some(device) => device.renderer.borrow().pose_gradient()?,
        })
    }

    /// Leaves out Gaussians at an iteration, which is also that of the schedule, and takes a gradient back, both in
    /// place. Returns the drawn opacities.
    ///
    /// # Errors
    /// When the device fails.
    pub fn drop_out(
        &self,
        dropout: Dropout,
        iteration: u64,
        [gaussians, gradient]: [&mut ActivatedGaussians; 2],
    ) -> Result<Vec<f32>, ReconstructError> {
        let Some(gpu) = self.gpu() else {
            let step = dropout.of_step(iteration, iteration);
            step.drop_out(gaussians);
            let drawn = gaussians.opacities.clone();
            step.drop_out_vjp(gaussians, gradient);
            return Ok(drawn);
        };
        let both = [gaussians, gradient];
        Ok(single_kernels::drop_out(gpu, dropout, iteration, both)?)
    }

    /// Returns a model after a reset of its opacities.
    ///
    /// # Errors
    /// When the device fails.
    pub fn reset_opacities(&self, mut model: Model) -> Result<Model, ReconstructError> {
        match self.activator() {
            None => {
                density::reset_opacities(&mut model);
                Ok(model)
            }
            Some(activator) => Ok(activator.reset_opacities(model)?),
        }
    }

    /// Returns the gradient of the loss on a scaffold, of weight 1, by some centres.
    ///
    /// # Errors
    /// When the device fails.
    pub fn scaffold_gradient(
        &self,
        scaffold: &Scaffold,
        centres: &[[f32; 3]],
    ) -> Result<Vec<f32>, ReconstructError> {
        let Some(gpu) = self.gpu() else {
            let mut gradient = vec![[0.0; 3]; centres.len()];
            scaffold.loss(centres, |_| 1.0, &mut gradient);
            return Ok(gradient.into_flattened());
        };
        Ok(single_kernels::scaffold_gradient(gpu, scaffold, centres)?)
    }

    /// Takes the first step of Adam on all arrays of a table; returns the number of gradients that were not finite.
    ///
    /// # Errors
    /// When the device fails.
    pub fn adam_step(&self, table: &mut ParameterTable) -> Result<u64, ReconstructError> {
        let decay = adam::SecondMomentDecay::PUBLISHED;
        match self.gpu() {
            None => {
                let arrays = table.arrays.iter_mut();
                let refused = arrays.map(|array| adam::cpu::step(array, 1, decay) as u64);
                Ok(refused.sum())
            }
            Some(gpu) => Ok(single_kernels::adam_step(gpu, table, 1, decay)?),
        }
    }

    /// Returns the photometric loss of a panorama (HWC, columns and rows of pixels) against another, and its gradient.
    /// The second may have at most 256 values in a channel.
    ///
    /// # Errors
    /// When the device fails.
    pub fn photometric_loss(
        &self,
        [width, height]: [usize; 2],
        [render, target]: [&[f32]; 2],
        lambda: f32,
    ) -> Result<(f64, Vec<f32>), ReconstructError> {
        match self.gpu() {
            None => {
                let mut loss = Loss::new(width, height, Columns::Wrap);
                let (value, gradient) = loss.forward_backward(render, target, lambda);
                Ok((value.total, gradient.to_vec()))
            }
            Some(gpu) => {
                let view = panorama([width, height]);
                let images = [render, target];
                let (value, gradient) =
                    single_kernels::photometric_loss(gpu, &view, images, lambda)?;
                Ok((value.total, gradient))
            }
        }
    }

    fn activate(&self, mut model: Model, at: &Viewpoint) -> Result<Activation, ReconstructError> {
        let (gaussians, back) = match &self.gpu {
            None => {
                let mut gaussians = ActivatedGaussians::default();
                model.activate(at, &TemporalFeatures::default(), &mut gaussians);
                (gaussians, GradientPass::Cpu(Box::new(model), *at))
            }
            Some(device) => {
                let activation = device.activator.activation(model, at)?;
                (
                    activation.activate()?,
                    GradientPass::Gpu(Box::new(activation)),
                )
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

/// Returns a view of a panorama of this size from the origin.
pub(crate) fn panorama([width, height]: [usize; 2]) -> View {
    let camera = ErpCamera {
        width: width as u32,
        height: height as u32,
    };
    View {
        camera: camera.into(),
        rotation: Mat3::IDENTITY,
        centre: Vec3::ZERO,
        time_seconds: 0.0,
    }
}
