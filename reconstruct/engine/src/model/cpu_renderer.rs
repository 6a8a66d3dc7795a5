//! Common interface of the CPU renderers.

use std::ops::Range;

use omnilife_schemas::RgbImage;

use crate::render::settings::RendererChoice;
use crate::{
    EngineError,
    camera::View,
    gaussians::ActivatedGaussians,
    render::{
        Visible,
        cpu::Renderer,
        published::PublishedRenderer,
        raster::{Raster, RasterGradient},
        settings::RenderSettings,
    },
};

/// Renderer chosen by the run.
#[derive(Debug)]
pub(crate) enum CpuRenderer {
    Exact(Box<Renderer>),
    Published(Box<PublishedRenderer>),
}

impl CpuRenderer {
    pub(crate) fn new(choice: RendererChoice, settings: RenderSettings) -> Self {
        match choice {
            RendererChoice::Exact => Self::Exact(Box::new(Renderer::new(settings))),
            RendererChoice::OdgsPublished => {
                Self::Published(Box::new(PublishedRenderer::new(settings)))
            }
        }
    }

    pub(crate) fn forward(
        &mut self,
        view: &View,
        instant: &ActivatedGaussians,
        sh_degree: usize,
    ) -> &Raster {
        match self {
            Self::Exact(renderer) => {
                renderer.settings.sh_degree = sh_degree;
                renderer.forward(view, instant)
            }
            Self::Published(renderer) => renderer.forward(view, instant),
        }
    }

    pub(crate) fn backward(
        &mut self,
        view: &View,
        instant: &ActivatedGaussians,
        image_gradient: &[f32],
        feature_gradient: &[f32],
        out: &mut ActivatedGaussians,
    ) {
        match self {
            Self::Exact(renderer) => {
                let upstream = RasterGradient::new(image_gradient, feature_gradient);
                renderer.backward(view, instant, &upstream, out);
            }
            Self::Published(renderer) => renderer.backward(view, instant, image_gradient, out),
        }
    }

    /// Computes gradients by some consecutive Gaussians from that by the image (HWC).
    ///
    /// # Errors
    /// If the renderer is the published one, which does not implement it.
    pub(crate) fn backward_of(
        &mut self,
        learning: Range<usize>,
        view: &View,
        instant: &ActivatedGaussians,
        image_gradient: &[f32],
        out: &mut ActivatedGaussians,
    ) -> Result<(), EngineError> {
        match self {
            Self::Exact(renderer) => {
                let upstream = RasterGradient::new(image_gradient, &[]);
                renderer.backward_of(learning, view, instant, &upstream, out);
                Ok(())
            }
            Self::Published(_) => Err(EngineError::Backend {
                reason: "the renderer with the published quirks knows no shards".to_owned(),
            }),
        }
    }

    /// Calls `each` for the Gaussians that are visible in the view rendered last.
    pub(crate) fn for_each_visible(&self, each: impl FnMut(Visible)) {
        match self {
            Self::Exact(renderer) => renderer.visible().for_each(each),
            Self::Published(renderer) => renderer.visible().for_each(each),
        }
    }

    pub(crate) fn image(
        &mut self,
        view: &View,
        instant: &ActivatedGaussians,
        sh_degree: usize,
    ) -> RgbImage {
        match self {
            Self::Exact(renderer) => {
                renderer.settings.sh_degree = sh_degree;
                renderer.image(view, instant)
            }
            Self::Published(renderer) => renderer.image(view, instant),
        }
    }
}
