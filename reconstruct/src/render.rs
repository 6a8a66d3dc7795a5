//! The chain of kernels that renders a view and takes its gradient back.

use omnilife_schemas::RgbImage;

use crate::{
    camera::View,
    gaussians::InstantGaussians,
    kernels::{
        bin::{self, TileLists},
        project::{self, Culling, Splat, SplatGradient},
        raster::{self, Raster},
        sort::{self, cpu::SortScratch},
    },
};

/// Renders views on the processor, keeping what the backward pass needs and its memory.
#[derive(Debug)]
pub struct Renderer {
    culling: Culling,
    background: [f32; 3],
    splats: Vec<Splat>,
    order: Vec<u32>,
    scratch: SortScratch,
    lists: TileLists,
    raster: Raster,
    gradients: Vec<SplatGradient>,
}

impl Renderer {
    /// A renderer that leaves out what `culling` says and composites over `background`.
    pub fn new(culling: Culling, background: [f32; 3]) -> Self {
        Self {
            culling,
            background,
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
        project::cpu::forward(view, gaussians, &self.culling, &mut self.splats);
        sort::cpu::by_distance(&self.splats, &mut self.order, &mut self.scratch);
        bin::cpu::forward(&view.camera, &self.splats, &self.order, &mut self.lists);
        raster::cpu::forward(
            (view.camera.width as usize, view.camera.height as usize),
            &self.splats,
            &self.lists,
            self.background,
            &mut self.raster,
        );
        &self.raster
    }

    /// Gradients by the Gaussians of the view rendered last, from the gradient by its image
    /// (HWC). `out` is overwritten.
    pub fn backward(
        &mut self,
        view: &View,
        gaussians: &InstantGaussians,
        image_gradient: &[f32],
        out: &mut InstantGaussians,
    ) {
        raster::cpu::backward(
            &self.raster,
            &self.splats,
            &self.order,
            &self.lists,
            image_gradient,
            &mut self.gradients,
        );
        out.clear_to_zero(gaussians.len());
        project::cpu::backward(
            view,
            gaussians,
            &self.culling,
            &self.splats,
            &self.gradients,
            out,
        );
    }

    /// What was visible in the view rendered last, with the gradients of its last backward pass.
    pub fn visible(&self) -> impl Iterator<Item = (&Splat, &SplatGradient)> {
        self.splats.iter().zip(&self.gradients)
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
