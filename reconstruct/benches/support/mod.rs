//! What the benches share: scenes of a given size and one training iteration.

use std::f64::consts::PI;

use glam::{DQuat, Mat3, Vec3, dvec3};
use omnilife_engine::{
    camera::View,
    gaussians::{ActivatedGaussians, static_gaussians},
    losses::photometric::cpu::Loss,
    parameters::{ParameterTable, adam},
    render::{cpu::Renderer, raster::RasterGradient, settings::RenderSettings},
};
use omnilife_schemas::camera::ErpCamera;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Gaussians all around the camera as training leaves them: as wide as the distance to their
/// neighbours, more or less, flattened and turned at random, 1 to 10 units away.
pub(crate) fn scene(count: usize) -> ParameterTable {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut initial = static_gaussians::InitialGaussians::default();
    let spacing = (4.0 * PI / count as f64).sqrt();
    for index in 0..count {
        let y = 1.0 - (index as f64 + 0.5) / count as f64 * 2.0;
        let (sin, cos) = (2.399_963_229_728_653 * index as f64).sin_cos();
        let rho = (1.0 - y * y).sqrt();
        let distance = 10.0_f64.powf(random.random_range(0.0..1.0));
        let position = dvec3(rho * cos, y, rho * sin) * distance;
        initial.push_isotropic(
            position.as_vec3().to_array(),
            (spacing * distance) as f32,
            [0; 3].map(|_| random.random_range(0.0..1.0)),
            random.random_range(0.05..0.95),
        );
    }
    let mut table = static_gaussians::table(&initial, 0);
    let mut normal = || -> f32 { StandardNormal.sample(&mut random) };
    for value in &mut table.arrays[static_gaussians::LOG_SCALES].values {
        *value += 0.6 * normal();
    }
    for value in &mut table.arrays[static_gaussians::QUATERNIONS].values {
        *value = normal();
    }
    table
}

/// A camera at the centre of a [`scene`], turned.
pub(crate) fn view(width: u32) -> View {
    let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.2);
    View {
        camera: ErpCamera {
            width,
            height: width / 2,
        }
        .into(),
        rotation: Mat3::from_quat(rotation.as_quat()),
        centre: Vec3::ZERO,
        time_seconds: 0.0,
    }
}

/// Everything that one training iteration touches.
pub(crate) struct Iteration {
    pub(crate) view: View,
    pub(crate) table: ParameterTable,
    pub(crate) instant: ActivatedGaussians,
    pub(crate) gradient: ActivatedGaussians,
    pub(crate) renderer: Renderer,
    pub(crate) loss: Loss,
    pub(crate) target: Vec<f32>,
    pub(crate) step: u64,
}

impl Iteration {
    /// An iteration on a [`scene`] whose target is another scene.
    pub(crate) fn new(count: usize, width: u32, settings: RenderSettings) -> Self {
        let view = view(width);
        let mut renderer = Renderer::new(settings);
        let mut instant = ActivatedGaussians::default();
        static_gaussians::activate(&scene(count / 2), &mut instant);
        let target = renderer.image(&view, &instant).data;
        let table = scene(count);
        static_gaussians::activate(&table, &mut instant);
        Self {
            view,
            table,
            instant,
            gradient: ActivatedGaussians::default(),
            renderer,
            loss: Loss::new(width as usize, width as usize / 2),
            target,
            step: 0,
        }
    }

    /// Forward, loss, backward and Adam, as training orders them. `done` is called with the name of
    /// each stage and the CPU time that it took, in seconds. Returns the loss.
    pub(crate) fn run(&mut self, mut done: impl FnMut(&'static str, f64)) -> f64 {
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
        let upstream = RasterGradient {
            colour,
            features: &[],
        };
        self.renderer.backward_timed(
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

/// CPU time of this process so far, in seconds: what other programs take does not count.
pub(crate) fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
