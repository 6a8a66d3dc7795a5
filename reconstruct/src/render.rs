//! The chain of kernels that renders a view and takes its gradient back.

use omnilife_schemas::RgbImage;

pub use crate::kernels::{Footprint, RenderSettings};
use crate::{
    camera::View,
    gaussians::InstantGaussians,
    kernels::{
        bin::{self, TileLists},
        project::{self, Splat, SplatGradient},
        raster::{self, Raster, RasterGradient},
        sort::{self, cpu::SortScratch},
    },
};

/// Renders views on the processor, keeping what the backward pass needs and its memory.
#[derive(Debug)]
pub struct Renderer {
    /// What is drawn and how; may be changed from view to view.
    pub settings: RenderSettings,
    splats: Vec<Splat>,
    order: Vec<u32>,
    scratch: SortScratch,
    lists: TileLists,
    raster: Raster,
    gradients: Vec<SplatGradient>,
}

/// A Gaussian that was drawn in the view rendered last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visible {
    /// Its index.
    pub gaussian: usize,
    /// Gradient of the loss by the centre's image with the shape of the footprint fixed, per pixel
    /// along columns and rows.
    pub centre_gradient: [f32; 2],
}

impl Renderer {
    /// A renderer without memory yet.
    pub fn new(settings: RenderSettings) -> Self {
        Self {
            settings,
            splats: Vec::new(),
            order: Vec::new(),
            scratch: SortScratch::default(),
            lists: TileLists::default(),
            raster: Raster::default(),
            gradients: Vec::new(),
        }
    }

    /// Renders one view.
    pub fn forward(&mut self, view: &View, gaussians: &InstantGaussians) -> &Raster {
        assert_eq!(gaussians.feature_count, 0, "feature channels");
        project::cpu::forward(view, gaussians, &self.settings, &mut self.splats);
        sort::cpu::by_distance(&self.splats, &mut self.order, &mut self.scratch);
        bin::cpu::forward(&view.camera, &self.splats, &self.order, &mut self.lists);
        raster::cpu::forward(
            (view.camera.width() as usize, view.camera.height() as usize),
            &self.splats,
            &self.lists,
            self.settings.background,
            &mut self.raster,
        );
        &self.raster
    }

    /// Gradients by the Gaussians of the view rendered last, from the gradient by its raster.
    /// `out` is overwritten.
    pub fn backward(
        &mut self,
        view: &View,
        gaussians: &InstantGaussians,
        upstream: &RasterGradient<'_>,
        out: &mut InstantGaussians,
    ) {
        raster::cpu::backward(
            &self.raster,
            &self.splats,
            &self.order,
            &self.lists,
            upstream.colour,
            &mut self.gradients,
        );
        out.clear_to_zero(gaussians);
        project::cpu::backward(
            view,
            gaussians,
            &self.settings,
            &self.splats,
            &self.gradients,
            out,
        );
    }

    /// What was drawn in the view rendered last, with the gradients of its last backward pass.
    pub fn visible(&self) -> impl Iterator<Item = Visible> {
        self.splats
            .iter()
            .zip(&self.gradients)
            .map(|(splat, gradient)| Visible {
                gaussian: splat.gaussian as usize,
                centre_gradient: gradient.centre,
            })
    }

    /// Renders one view as an image clamped to `[0, 1]`.
    pub fn image(&mut self, view: &View, gaussians: &InstantGaussians) -> RgbImage {
        let raster = self.forward(view, gaussians);
        RgbImage {
            width: raster.width,
            height: raster.height,
            data: raster
                .colour
                .iter()
                .map(|value| value.clamp(0.0, 1.0))
                .collect(),
        }
    }
}
