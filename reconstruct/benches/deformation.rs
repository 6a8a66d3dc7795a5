//! CPU time that the network of deformable Gaussians adds to a training iteration, beside the
//! iteration itself at 512x256.
//!
//! `cargo bench --bench deformation`

use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use omnilife_engine::{
    gaussians::{
        ActivatedGaussians,
        deformable::{DEFORMATION_WEIGHTS, Deformation, DeformationModel},
    },
    parameters::{SharedParameters, adam},
    render::settings::RenderSettings,
};
use omnilife_reconstruct::{process::own_cpu_time, step_cost::cpu::Iteration};

const WIDTH: u32 = 512;
const COUNTS: [usize; 2] = [10_000, 30_000];
/// Length unit of the network: the farthest Gaussians of the scene.
const UNIT: f32 = 10.0;

/// One evaluation, its gradients and the optimizer's step on the weights.
struct Network {
    model: DeformationModel,
    weights: SharedParameters,
    deformation: Deformation,
    instant: ActivatedGaussians,
}

impl Network {
    fn new() -> Self {
        let model = DeformationModel::published(UNIT);
        Self {
            model,
            weights: SharedParameters::new(DEFORMATION_WEIGHTS, model.network().initial_weights(0)),
            deformation: Deformation::default(),
            instant: ActivatedGaussians::default(),
        }
    }

    /// With the gradients that the renderer left in `iteration`.
    fn run(&mut self, iteration: &mut Iteration, time: f32) {
        let weights = &mut self.weights;
        self.deformation.activate(
            &self.model,
            &weights.array.values,
            &iteration.table,
            time,
            &mut self.instant,
        );
        let mut gradient = iteration.gradient.clone();
        self.deformation.activate_vjp(
            &self.model,
            &mut weights.array,
            &mut iteration.table,
            time,
            (&mut self.instant, &mut gradient),
        );
        weights.steps += 1;
        weights.array.learning_rate = 1e-6;
        adam::cpu::step(
            &mut weights.array,
            weights.steps,
            adam::SecondMomentDecay::PUBLISHED,
        );
    }
}

fn deformation(criterion: &mut Criterion) {
    for count in COUNTS {
        let mut group = criterion.benchmark_group(format!("{count} Gaussians"));
        group.sample_size(10);
        let mut iteration = Iteration::new(count, WIDTH, RenderSettings::new(0.01));
        let mut network = Network::new();
        let mut timed = |name: &str, run: &mut dyn FnMut()| {
            group.bench_function(name, |bencher| {
                bencher.iter_custom(|repetitions| {
                    let begun = own_cpu_time().unwrap_or_default().as_secs_f64();
                    for _ in 0..repetitions {
                        run();
                    }
                    Duration::from_secs_f64(
                        own_cpu_time().unwrap_or_default().as_secs_f64() - begun,
                    )
                });
            });
        };
        timed("static iteration", &mut || {
            iteration.run(|_, _| ());
        });
        timed("network", &mut || network.run(&mut iteration, 0.4));
        group.finish();
    }
}

criterion_group!(benches, deformation);
criterion_main!(benches);
