//! Images of a model that is trained on a GPU.

use std::sync::Arc;

use omnilife_schemas::RgbImage;

use super::{GpuStepper, device_model::uses_shared};
use crate::{
    EngineError,
    camera::View,
    device::GpuError,
    gaussians::{ActivatedGaussians, parameterization::Viewpoint, temporal::TemporalFeatures},
    render::{
        buffers::{DeviceStatus, HALTED_RUNNING},
        gpu::GpuRenderer,
        settings::RenderSettings,
    },
};

impl GpuStepper<'_> {
    /// Renders a view of the scene at a degree of spherical harmonics.
    pub(super) fn rendered_image(
        &mut self,
        view: &View,
        sh_degree: usize,
    ) -> Result<RgbImage, EngineError> {
        self.settle()?;
        self.upload()?;
        let settings = RenderSettings {
            sh_degree,
            ..self.settings.rendering
        };
        let view = &self.model.corrected(view);
        let at = Viewpoint::of_image(view);
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        let image = if self.inputs.size() == [width, height] {
            self.render(view, &at, &settings)?
        } else {
            self.download()?;
            let mut activated = ActivatedGaussians::default();
            self.model
                .activate(&at, &TemporalFeatures::default(), &mut activated);
            let mut renderer = GpuRenderer::new(Arc::clone(&self.gpu), settings);
            renderer.forward(view, &activated)?.colour
        };
        Ok(RgbImage {
            width,
            height,
            data: image[..width * height * 3]
                .iter()
                .map(|value| value.clamp(0.0, 1.0))
                .collect(),
        })
    }

    /// Renders with the buffers of the training steps, which fit the size of the input views.
    fn render(
        &mut self,
        view: &View,
        at: &Viewpoint,
        settings: &RenderSettings,
    ) -> Result<Vec<f32>, GpuError> {
        loop {
            let model = self.take_model()?;
            let gpu = &*self.gpu;
            model.set_view(gpu, view, at, settings);
            let activation = model.activation(uses_shared(&self.model, at));
            activation.forward.submit(gpu);
            model.chain.forward.submit(gpu);
            let status = model.chain.buffers.status.read(gpu)?[0];
            let fresh = [DeviceStatus::default()];
            model.chain.buffers.status.write(gpu, 0, &fresh);
            if status.halted == HALTED_RUNNING {
                let image = model.chain.buffers.image.read(gpu)?;
                self.on_device = Some(model);
                return Ok(image);
            }
            let model = self.make_room(model, status.entries)?;
            self.on_device = Some(model);
        }
    }
}
