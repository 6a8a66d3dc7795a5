//! One training iteration on the CPU, stage by stage.

use omnilife_engine::{
    camera::View,
    gaussians::{ActivatedGaussians, static_gaussians},
    losses::photometric::{Columns, cpu::Loss},
    parameters::{ParameterTable, adam},
    render::{cpu::Renderer, raster::RasterGradient, settings::RenderSettings},
};
use omnilife_reconstruct::process::own_cpu_time;

use crate::scene::{scene, target, view};

/// State of one training iteration.
pub(crate) struct Iteration {
    pub(crate) view: View,
    pub(crate) table: ParameterTable,
    pub(crate) instant: ActivatedGaussians,
    pub(crate) gradient: ActivatedGaussians,
    /// Renderer, forward and backward.
    pub(crate) renderer: Renderer,
    pub(crate) loss: Loss,
    /// Target image, RGB after RGB.
    pub(crate) target: Vec<f32>,
    /// Iterations so far.
    pub(crate) step: u64,
}

impl Iteration {
    /// Makes an iteration on a [`scene`] of `count` Gaussians in an ERP image of `width` columns; its
    /// [`target`] is another scene.
    pub(crate) fn new(count: usize, width: u32, settings: RenderSettings) -> Self {
        let view = view(width);
        let table = scene(count);
        let mut instant = ActivatedGaussians::default();
        static_gaussians::activate(&table, &mut instant);
        Self {
            view,
            table,
            instant,
            gradient: ActivatedGaussians::default(),
            renderer: Renderer::new(settings),
            loss: Loss::new(width as usize, width as usize / 2, Columns::Wrap),
            target: target(count, &view, settings).data,
            step: 0,
        }
    }

    /// Runs forward, loss, backward and Adam, as training orders them, and returns the loss. `done` is
    /// called with the name of each stage and its CPU time in seconds.
    pub(crate) fn run(&mut self, mut done: impl FnMut(&'static str, f64)) -> f64 {
        let cpu_seconds = || own_cpu_time().unwrap_or_default().as_secs_f64();
        let mut begun = cpu_seconds();
        let mut lap = |name: &'static str| {
            let now = cpu_seconds();
            done(name, now - begun);
            begun = now;
        };
        static_gaussians::activate(&self.table, &mut self.instant);
        lap("activate");
        let raster = self
            .renderer
            .forward_timed(&self.view, &self.instant, &mut lap);
        let (value, colour) = self
            .loss
            .forward_backward(&raster.colour, &self.target, 0.2);
        lap("loss");
        let upstream = RasterGradient::new(colour, &[]);
        self.renderer.backward_timed(
            0..self.instant.len(),
            &self.view,
            &self.instant,
            &upstream,
            &mut self.gradient,
            &mut lap,
        );
        static_gaussians::activate_vjp(&mut self.table, &self.instant, &self.gradient);
        lap("activate backward");
        self.step += 1;
        for array in &mut self.table.arrays {
            adam::cpu::step(array, self.step, adam::SecondMomentDecay::PUBLISHED);
        }
        lap("adam");
        value.total
    }
}
