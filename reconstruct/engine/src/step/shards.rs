//! Training step in shards: one part of the Gaussians after another is trained (PanoGS, Section 3.5).
//!
//! A view is drawn once, with all Gaussians. Then each shard, a part of the model, takes its backward pass
//! and its optimizer step. Memory for gradients of Gaussians and tile entries is needed for one shard at a
//! time. The gradients have the same bits as those of a backward pass over all Gaussians.
//!
//! This is the step on the CPU. [`super::gpu`] takes one backward pass over all Gaussians.

use serde::{Deserialize, Serialize};

use super::{StepStatistics, cpu::CpuStepper, settings::TrainSettings};
use crate::{
    EngineError,
    gaussians::{ActivatedGaussians, parameterization::Viewpoint, temporal::TemporalFeatures},
    losses::photometric::PixelMarks,
    parameters::GradientMemory,
    render::settings::RendererChoice,
    schedule::StepSchedule,
};

/// Shards of Gaussians that are trained one after another.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shards {
    /// Number of Gaussians per shard; shards are the parts of the model in their order.
    pub gaussians: Vec<u64>,
    /// Per shard, the indices of the input views that train it; `None` trains all shards with all views.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub views: Option<Vec<Vec<u32>>>,
}

impl Shards {
    /// Returns true if an input view trains a shard.
    pub fn learns_from(&self, shard: usize, view: usize) -> bool {
        let views = self.views.as_ref().and_then(|views| views.get(shard));
        views.is_none_or(|views| views.contains(&(view as u32)))
    }

    /// Returns the share of all Gaussians in the largest shard.
    pub fn largest_share(&self) -> f64 {
        let largest = self.gaussians.iter().max().copied().unwrap_or(0);
        largest as f64 / self.gaussians.iter().sum::<u64>().max(1) as f64
    }

    /// Refuses settings that a step in shards does not support: motion, dropout, refined poses, a camera's response,
    /// the published renderer.
    ///
    /// # Errors
    /// Names the unsupported setting.
    pub(super) fn check(settings: &TrainSettings) -> Result<(), EngineError> {
        let missing = [
            (settings.dynamics.is_some(), "motion"),
            (settings.dropout.is_some(), "dropout"),
            (settings.pose_refinement.is_some(), "refined poses"),
            (settings.response.is_some(), "a camera's response"),
            (
                settings.renderer != RendererChoice::Exact,
                "the renderer with the published quirks",
            ),
        ];
        match missing.iter().find(|(is_asked, _)| *is_asked) {
            Some((_, what)) => Err(EngineError::Backend {
                reason: format!("training in shards does not go with {what}"),
            }),
            None => Ok(()),
        }
    }
}

/// Memory passed from one shard to the next.
#[derive(Debug, Default)]
pub(super) struct ShardMemory {
    activated: ActivatedGaussians,
    gradients: GradientMemory,
}

impl CpuStepper<'_> {
    /// Takes one step on input view `number`.
    pub(super) fn step_in_shards(
        &mut self,
        shards: &Shards,
        number: usize,
        schedule: &StepSchedule,
    ) -> Result<(), EngineError> {
        let view = &self.inputs.views[number];
        let (drawn, none) = (&view.view, TemporalFeatures::default());
        let at = Viewpoint::of_step(drawn, schedule.shift_frames, schedule.scheduled);
        self.model.activate(&at, &none, &mut self.activated);
        self.write_target(number);
        let marks = PixelMarks {
            ignored: view.ignored.as_deref(),
            saturated: &self.saturated,
        };
        let raster = self
            .renderer
            .forward(drawn, &self.activated, schedule.sh_degree);
        let (value, by_image) = self.loss.forward_backward_marked(
            marks,
            &raster.colour,
            &self.target,
            self.ssim_weight,
        );
        super::cpu::require_finite(value.total, view.frame, schedule)?;
        let ShardMemory {
            activated,
            gradients,
        } = &mut self.shard_memory;
        let mut first = 0;
        for (shard, part) in self.model.parts.iter_mut().enumerate() {
            let own = first..first + part.table.len();
            first = own.end;
            if !shards.learns_from(shard, number) {
                continue;
            }
            self.renderer.backward_of(
                own.clone(),
                drawn,
                &self.activated,
                by_image,
                &mut self.gradient,
            )?;
            activated.copy_entries(&self.activated, own);
            part.table.lend_gradients(gradients);
            part.parameterization.activate_backward(
                &mut part.table,
                &at,
                &none,
                0,
                activated,
                &mut self.gradient,
            );
            part.steps += 1;
            let steps = part.steps;
            super::cpu::update(part, steps, &self.arrays, schedule, &mut self.statistics);
            part.table.take_gradients(gradients);
        }
        self.statistics.add(&StepStatistics {
            steps: 1,
            loss: value.total,
            squared_error: value.mse,
            refused: Vec::new(),
        });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3};
    use omnilife_schemas::camera::ErpCamera;

    use super::*;
    use crate::{
        camera::View,
        device::test_device,
        gaussians::static_gaussians::{
            self, InitialGaussians, OPACITY_LOGITS, POSITIONS, QUATERNIONS, SH_CONSTANT,
            StaticGaussians,
        },
        model::{Model, Part},
        parameters::adam::SecondMomentDecay,
        step::{BackendChoice, settings::tests::settings, stepper},
        training_view::{InputViews, TrainingView},
    };

    const CAMERA: ErpCamera = ErpCamera::new(64, 32);

    fn views() -> Vec<TrainingView> {
        let view = |number: u32| TrainingView {
            frame: number,
            view: View {
                camera: CAMERA.into(),
                rotation: Mat3::IDENTITY,
                centre: Vec3::new(0.1 * number as f32, 0.0, 0.0),
                time_seconds: 0.0,
            },
            pixels: (0..64 * 32 * 3)
                .map(|value| (value * (7 + number) % 251) as u8)
                .collect(),
            mask: None,
            ignored: None,
        };
        vec![view(0), view(1)]
    }

    /// Returns Gaussians in all directions that occlude each other.
    fn gaussians() -> InitialGaussians {
        let place = |index: usize| {
            let (angle, height) = (0.61 * index as f32, (index % 7) as f32 / 3.0 - 1.0);
            let distance = 1.0 + (index % 5) as f32 / 4.0;
            [distance * angle.cos(), height, distance * angle.sin()]
        };
        InitialGaussians::isotropic(
            (0..90).map(place).collect(),
            &[0.15; 90],
            vec![[0.3, 0.5, 0.7]; 90],
            vec![0.6; 90],
        )
    }

    /// Returns a model of parts with these numbers of Gaussians and frozen sizes and rotations.
    fn model(lengths: &[usize]) -> Model {
        let (all, mut first) = (gaussians(), 0);
        let part = |&len: &usize| {
            let own: Vec<usize> = (first..first + len).collect();
            first += len;
            let mut table = static_gaussians::table(&all.selected(&own), 0);
            for array in [static_gaussians::LOG_SCALES, QUATERNIONS] {
                table.freeze(array);
            }
            Part::new(StaticGaussians, table)
        };
        Model::new(lengths.iter().map(part).collect())
    }

    /// Returns the parts after steps on some views, on the CPU.
    fn trained(lengths: &[usize], near: Option<Vec<Vec<u32>>>, order: &[usize]) -> Vec<Part> {
        trained_on(BackendChoice::Cpu, lengths, near, order)
    }

    fn trained_on(
        backend: BackendChoice,
        lengths: &[usize],
        near: Option<Vec<Vec<u32>>>,
        order: &[usize],
    ) -> Vec<Part> {
        let mut settings = settings(None);
        settings.shards = (lengths.len() > 1).then(|| Shards {
            gaussians: lengths.iter().map(|&len| len as u64).collect(),
            views: near,
        });
        let views = views();
        let inputs = InputViews {
            camera: CAMERA.into(),
            views: &views,
        };
        let model = model(lengths);
        let rates = model.trained_arrays().iter().map(|_| 0.01).collect();
        let mut stepper = stepper(inputs, model, &settings, backend).expect("static Gaussians");
        let mut schedule = StepSchedule {
            learning_rates: rates,
            second_moments: SecondMomentDecay::PUBLISHED,
            ..StepSchedule::default()
        };
        for &view in order {
            schedule.iteration += 1;
            stepper.step(view, &schedule).expect("a finite loss");
        }
        let statistics = stepper.take_statistics().expect("finite losses");
        assert_eq!(statistics.steps, order.len() as u64);
        stepper.model().expect("a model").parts.clone()
    }

    #[test]
    fn shards_learn_what_all_learn_at_once_to_the_last_bit() {
        let whole = &trained(&[90], None, &[0, 1, 1, 0])[0].table;
        let shards = trained(&[31, 1, 58], None, &[0, 1, 1, 0]);
        for array in [POSITIONS, OPACITY_LOGITS, SH_CONSTANT, QUATERNIONS] {
            let of_shards: Vec<f32> = shards
                .iter()
                .flat_map(|part| part.table.arrays[array].values.clone())
                .collect();
            assert!(of_shards == whole.arrays[array].values, "array {array}");
        }
        for Part { table, steps, .. } in &shards {
            assert_eq!(*steps, 4);
            assert!(table.arrays[QUATERNIONS].first_moments.is_empty());
            assert!(table.arrays.iter().all(|array| array.gradients.is_empty()));
        }
        assert!(whole.arrays[POSITIONS].values != gaussians().positions.concat());
    }

    #[test]
    fn a_shard_learns_from_its_views_alone() {
        let near = Some(vec![vec![0], vec![0, 1]]);
        let before = trained(&[40, 50], near.clone(), &[0]);
        let after = trained(&[40, 50], near, &[0, 1]);
        let steps = |parts: &[Part]| parts.iter().map(|part| part.steps).collect::<Vec<_>>();
        assert_eq!((steps(&before), steps(&after)), (vec![1, 1], vec![1, 2]));
        let values = |part: &Part| part.table.arrays[SH_CONSTANT].values.clone();
        assert!(values(&before[0]) == values(&after[0]));
        assert!(values(&before[1]) != values(&after[1]));
    }

    #[test]
    fn shards_learn_on_a_gpu_what_they_learn_on_the_cpu() {
        if test_device().is_none() {
            return;
        }
        let (lengths, order) = ([31, 1, 58], [0, 1, 1, 0, 1]);
        let near = Some(vec![vec![0], vec![0, 1], vec![1]]);
        let [of_cpu, of_gpu] = [BackendChoice::Cpu, BackendChoice::Gpu]
            .map(|backend| trained_on(backend, &lengths, near.clone(), &order));
        for (cpu, gpu) in of_cpu.iter().zip(&of_gpu) {
            assert_eq!(gpu.steps, cpu.steps);
            for (cpu, gpu) in cpu.table.arrays.iter().zip(&gpu.table.arrays) {
                assert_eq!(gpu.first_moments.len(), cpu.first_moments.len());
                let pairs = cpu.values.iter().zip(&gpu.values);
                let apart: f32 = pairs.map(|(cpu, gpu)| (cpu - gpu).abs()).sum();
                // A step is 0.01. Where a gradient is nearly 0, Adam's first steps differ.
                let mean = apart / cpu.values.len() as f32;
                assert!(mean < 5e-4, "{}: {mean}", cpu.name);
            }
        }
        // Without a view of its own, a shard keeps its bits.
        let idle = trained_on(BackendChoice::Gpu, &lengths, near, &[1]);
        let begin = model(&lengths);
        let values = |part: &Part| part.table.arrays[SH_CONSTANT].values.clone();
        assert_eq!((idle[0].steps, idle[2].steps), (0, 1));
        assert!(values(&idle[0]) == values(&begin.parts[0]));
        assert!(values(&idle[2]) != values(&begin.parts[2]));
    }

    #[test]
    fn what_shards_do_not_have_is_refused() {
        let mut settings = settings(None);
        assert_eq!(
            Shards::check(&settings).map_err(|error| error.to_string()),
            Ok(())
        );
        settings.renderer = RendererChoice::OdgsPublished;
        let refused = Shards::check(&settings).map_err(|error| error.to_string());
        let message = refused.expect_err("no shards there");
        assert!(message.contains("does not go with the renderer"));
    }
}
