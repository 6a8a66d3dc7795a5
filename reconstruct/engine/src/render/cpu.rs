//! CPU renderer: the chain of kernels that renders a view, and its backward pass.

use std::ops::Range;

use omnilife_schemas::RgbImage;

use crate::render::Visible;
pub use crate::render::settings::{Footprint, RenderSettings};
use crate::{
    camera::{Camera, View, rays::Rays},
    gaussians::ActivatedGaussians,
    render::{
        bin::{TileLists, cpu::Binner, learning::LearningEntries},
        project::{self, Splats, cpu::TiledGaussians},
        raster::{self, EntryGradients, Raster, RasterGradient},
        sort::{self, cpu::SortScratch},
    },
};

/// Renders views on the CPU; keeps the state for the backward pass, and its memory.
#[derive(Debug)]
pub struct Renderer {
    /// Render settings; may be changed from view to view.
    pub settings: RenderSettings,
    /// Tables of the camera drawn last.
    tables: Option<(Rays, Binner)>,
    splats: Splats,
    distances: Vec<f32>,
    order: Vec<u32>,
    ranks: Vec<u32>,
    scratch: SortScratch,
    lists: TileLists,
    learning: LearningEntries,
    raster: Raster,
    entries: EntryGradients,
    centres: Vec<[f32; 2]>,
}

/// Returns the tables of a camera, the given ones if they are.
fn tables_of(camera: Camera, tables: Option<(Rays, Binner)>) -> (Rays, Binner) {
    tables
        .filter(|(rays, _)| rays.camera == camera)
        .unwrap_or_else(|| {
            let rays = Rays::new(camera);
            let binner = Binner::new(&rays);
            (rays, binner)
        })
}

impl Renderer {
    /// Creates a renderer; memory is allocated by the first view.
    pub fn new(settings: RenderSettings) -> Self {
        Self {
            settings,
            tables: None,
            splats: Splats::default(),
            distances: Vec::new(),
            order: Vec::new(),
            ranks: Vec::new(),
            scratch: SortScratch::default(),
            lists: TileLists::default(),
            learning: LearningEntries::default(),
            raster: Raster::default(),
            entries: EntryGradients::default(),
            centres: Vec::new(),
        }
    }

    /// Renders one view.
    pub fn forward(&mut self, view: &View, gaussians: &ActivatedGaussians) -> &Raster {
        self.forward_timed(view, gaussians, |_| {})
    }

    /// Does the same as [`Renderer::forward`] and calls `done` with the name of each stage at its end.
    pub fn forward_timed(
        &mut self,
        view: &View,
        gaussians: &ActivatedGaussians,
        mut done: impl FnMut(&'static str),
    ) -> &Raster {
        let (rays, binner) = tables_of(view.camera, self.tables.take());
        project::cpu::forward(
            view,
            gaussians,
            &self.settings,
            &mut self.splats,
            &mut self.distances,
        );
        done("project");
        sort::cpu::by_distance(
            &self.distances,
            &mut self.order,
            &mut self.ranks,
            &mut self.scratch,
        );
        done("sort");
        binner.forward(&self.splats, &self.order, &mut self.lists);
        done("bin");
        let input = raster::cpu::Input {
            splats: &self.splats,
            gaussians,
            lists: &self.lists,
            rays: &rays,
            background: self.settings.background,
        };
        raster::cpu::forward(input, &mut self.raster);
        done("raster");
        self.tables = Some((rays, binner));
        &self.raster
    }

    /// Computes gradients by the Gaussians of the view rendered last, from the gradient by its raster. `out`
    /// is overwritten. The view is rendered first if none was rendered before.
    pub fn backward(
        &mut self,
        view: &View,
        gaussians: &ActivatedGaussians,
        upstream: &RasterGradient<'_>,
        out: &mut ActivatedGaussians,
    ) {
        self.backward_of(0..gaussians.len(), view, gaussians, upstream, out);
    }

    /// Computes gradients by a range of Gaussians of the view rendered last: the same bits as
    /// [`Renderer::backward`], with memory and time in proportion to the range. `out` is overwritten and
    /// begins with the first of them.
    pub fn backward_of(
        &mut self,
        learning: Range<usize>,
        view: &View,
        gaussians: &ActivatedGaussians,
        upstream: &RasterGradient<'_>,
        out: &mut ActivatedGaussians,
    ) {
        self.backward_timed(learning, view, gaussians, upstream, out, |_| {});
    }

    /// Does the same as [`Renderer::backward_of`] and calls `done` with the name of each stage at its end.
    pub fn backward_timed(
        &mut self,
        learning: Range<usize>,
        view: &View,
        gaussians: &ActivatedGaussians,
        upstream: &RasterGradient<'_>,
        out: &mut ActivatedGaussians,
        mut done: impl FnMut(&'static str),
    ) {
        if self.tables.is_none() {
            self.forward(view, gaussians);
        }
        let (rays, binner) = tables_of(view.camera, self.tables.take());
        let input = raster::cpu::Input {
            splats: &self.splats,
            gaussians,
            lists: &self.lists,
            rays: &rays,
            background: self.settings.background,
        };
        self.learning
            .find(&self.lists, learning, 0..gaussians.len());
        raster::cpu::backward(
            input,
            &self.learning,
            &self.raster,
            upstream,
            &mut self.entries,
        );
        done("raster backward");
        let drawn = TiledGaussians {
            splats: &self.splats,
            ranks: &self.ranks,
            lists: &self.lists,
            learning: &self.learning,
        };
        project::cpu::backward(
            view,
            gaussians,
            &self.settings,
            drawn,
            &self.entries,
            &mut self.centres,
            out,
        );
        done("project backward");
        self.tables = Some((rays, binner));
    }

    /// Returns the visible Gaussians of the last backward pass, with their gradients.
    pub fn visible(&self) -> impl Iterator<Item = Visible> {
        let learning = self.learning.gaussians();
        (learning.start..)
            .zip(self.ranks[learning].iter().zip(&self.centres))
            .filter(|(_, (rank, _))| **rank != u32::MAX)
            .map(|(gaussian, (_, &centre_gradient))| Visible {
                gaussian,
                centre_gradient,
            })
    }

    /// Renders one view as an image clamped to `[0, 1]`.
    pub fn image(&mut self, view: &View, gaussians: &ActivatedGaussians) -> RgbImage {
        self.forward(view, gaussians).image()
    }
}
