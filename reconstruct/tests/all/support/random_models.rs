//! Views of noise, and models with random parameters, moments and statistics, for tests of densification.

use std::collections::BTreeMap;

use glam::{DVec3, Mat3, Vec3};
use omnilife_engine::{
    camera::View,
    clock::Clock,
    density::{DensifySettings, SizeUnit, Threshold},
    gaussians::{
        deformable::{Deformable, DeformationModel, settings::DeformationSettings},
        omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
        static_gaussians::{
            self, InitialGaussians, LOG_SCALES, OPACITY_LOGITS, POSITIONS, StaticGaussians,
        },
        temporal::{InitialTimes, LifespanRange, TemporalFeatures, TimeModel, VelocityModel},
        tracked::{self, TrackedGaussians, TrackedObject},
    },
    model::{
        Model, Part,
        dynamic_settings::{DynamicSettings, TemporalDensity},
    },
    render::settings::{RenderSettings, RendererChoice},
    step::settings::TrainSettings,
    training_view::{InputViews, TrainingView},
    trajectories::rigid_path::RigidPath,
};
use omnilife_schemas::{
    Similarity,
    camera::{Camera, ErpCamera},
    trajectory::{BSpline, ObjectPath},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Iteration of the schedule from which a split shortens lifespans and has three children.
pub(crate) const SHORTEN_FROM: u64 = 100;

/// Views of noise along a path.
pub(crate) struct Scene {
    pub(crate) clock: Clock,
    pub(crate) camera: Camera,
    pub(crate) input_views: Vec<TrainingView>,
}

impl Scene {
    pub(crate) fn new() -> Self {
        let camera = Camera::Erp(ErpCamera::new(32, 16));
        let random = &mut Pcg64Mcg::seed_from_u64(9);
        let view = |number: u16| {
            let at = f32::from(number);
            TrainingView {
                frame: u32::from(number),
                view: View {
                    camera,
                    rotation: Mat3::from_rotation_y(0.3 * at) * Mat3::from_rotation_x(0.1 * at),
                    centre: Vec3::new(0.4 * at - 1.0, 0.1 * at, 0.2),
                    time_seconds: f64::from(number),
                },
                pixels: (0..32 * 16 * 3).map(|_| random.random()).collect(),
                mask: None,
                ignored: None,
            }
        };
        Self {
            clock: Clock::new(3.0, 1.0, 7.0),
            camera,
            input_views: (0..7).map(view).collect(),
        }
    }

    pub(crate) fn inputs(&self) -> InputViews<'_> {
        InputViews {
            camera: self.camera,
            views: &self.input_views,
        }
    }
}

pub(crate) fn dynamics(clock: Clock) -> DynamicSettings {
    DynamicSettings {
        clock,
        time: TimeModel {
            cycle_frames: 10.0,
            lifespans: Some(LifespanRange {
                least_frames: 0.25,
                largest_frames: 1e6,
            }),
            velocity: VelocityModel::Decomposed(Decomposition {
                gamma: 0.5,
                form: VelocityForm::Literal,
                origin: DirectionOrigin::Camera,
            }),
            least_marginal: 0.0,
        },
        down: [0.0, 1.0, 0.0],
        dynamic_below_staticness: 1.0,
        dynamic_loss: None,
        velocity_loss: None,
        lifespan_weight: 0.0,
        features: TemporalFeatures::default(),
        motion_loss: None,
        smoothing: None,
        density: Some(TemporalDensity {
            gradient_threshold: 1.0,
            clone_lifespan_frames: 3.0,
            shorten_from_iteration: SHORTEN_FROM,
        }),
    }
}

pub(crate) fn train_settings(scene: &Scene) -> TrainSettings {
    TrainSettings {
        iterations: 100,
        budget_seconds: None,
        seed: 0,
        ssim_weight: 0.2,
        renderer: RendererChoice::Exact,
        rendering: RenderSettings::new(0.01),
        sh_interval_iterations: 1,
        learning_rates: BTreeMap::new(),
        short_schedule: None,
        densify: density(),
        dynamics: Some(dynamics(scene.clock)),
        deformation: None,
        objects: false,
        exposure: None,
        dropout: None,
        response: None,
        pose_refinement: None,
        shards: None,
        trace_every: None,
    }
}

pub(crate) fn density() -> DensifySettings {
    DensifySettings {
        begin_iteration: 1,
        end_iteration: 100,
        interval_iterations: 1,
        opacity_reset_iterations: 0,
        opacity_recovery_iterations: 0,
        gradient_threshold: Threshold::constant(1.0),
        size_unit: SizeUnit::Distance,
        clone_size: 0.05,
        prune_size: 0.6,
        prune_size_begin_iteration: 50,
        prune_opacity: 0.02,
        maximum_gaussians: 100_000,
    }
}

fn initial(len: usize, random: &mut Pcg64Mcg) -> InitialGaussians {
    let mut three = |low: f32, high: f32| -> Vec<[f32; 3]> {
        let row = |_| [0; 3].map(|_| random.random_range(low..high));
        (0..len).map(row).collect()
    };
    let (positions, logarithms) = (three(-6.0, 6.0), three(-4.0, 0.5));
    let (colours, others) = (three(0.0, 1.0), three(-1.0, 1.0));
    InitialGaussians {
        scales: logarithms.iter().map(|row| row.map(f32::exp)).collect(),
        rotations: positions
            .iter()
            .zip(&others)
            .map(|(&[a, _, _], &[b, c, d])| [a, b, c, d])
            .collect(),
        opacities: colours.iter().map(|row| 0.004 + 0.99 * row[0]).collect(),
        positions,
        colours,
    }
}

/// Returns a model of two parts with random parameters, moments and statistics.
pub(crate) fn random_model(scene: &Scene, lens: [usize; 2], seed: u64) -> Model {
    let random = &mut Pcg64Mcg::seed_from_u64(seed);
    let dynamics = dynamics(scene.clock);
    let fixed = static_gaussians::table(&initial(lens[0], random), 1);
    let times = InitialTimes {
        peaks: (0..lens[1])
            .map(|_| random.random_range(-9.0..9.0))
            .collect(),
        lifespans: (0..lens[1])
            .map(|_| random.random_range(-1.0..4.0_f32).exp())
            .collect(),
        velocities: vec![[0.02, -0.01, 0.03]; lens[1]],
    };
    let moving = dynamics.time.table(&initial(lens[1], random), &times, 1);
    let mut model = Model::new(vec![
        Part::new(StaticGaussians, fixed),
        Part::new(dynamics.parameterization(), moving),
    ]);
    make_random(&mut model, random);
    model
}

/// Returns random Gaussians deformed by a network with random weights.
pub(crate) fn random_deformed(scene: &Scene, len: usize, seed: u64) -> Model {
    let random = &mut Pcg64Mcg::seed_from_u64(seed);
    let model = DeformationModel {
        depth: 2,
        width: 20,
        skip_after: 0,
        ..DeformationModel::published(3.0)
    };
    let settings = DeformationSettings {
        clock: scene.clock,
        model,
        warm_up_iterations: 0,
        time_noise: None,
    };
    let weights = (0..model.network().weight_count())
        .map(|_| random.random_range(-0.1..0.1))
        .collect();
    let table = static_gaussians::table(&initial(len, random), 1);
    let mut model = Model::new(vec![Part::new(Deformable::new(settings, weights), table)]);
    make_random(&mut model, random);
    model
}

/// Returns random static Gaussians, and random ones of two objects that cross the views' path and turn.
pub(crate) fn random_objects(lens: [usize; 2], seed: u64) -> Model {
    let random = &mut Pcg64Mcg::seed_from_u64(seed);
    let normalization = Similarity::new([0.0; 3], 1.0);
    let object = |id: u32| {
        let side = 2.0 * f64::from(id) - 3.0;
        let path = ObjectPath {
            centre: BSpline {
                degree: 1,
                knots: vec![0.0, 0.0, 7.0, 7.0],
                coefficients: vec![[-2.0, 3.0 * side, 1.0], [2.0, 2.0 * side, 2.0]],
            },
            heading_seconds: vec![0.0, 7.0],
            headings: vec![3.0 * side, 3.5 * side],
        };
        let dimensions = [2.0, 1.5, 1.0 + 0.2 * id as f32];
        TrackedObject {
            id,
            dimensions,
            path: RigidPath::new(&path, DVec3::NEG_Y, 1.0, 4, &normalization),
        }
    };
    let mut own = initial(lens[1], random);
    for value in own.positions.iter_mut().flatten() {
        // Within the boxes and a little beyond.
        *value /= 11.0;
    }
    let numbers: Vec<usize> = (0..lens[1]).map(|index| index % 2).collect();
    let fixed = static_gaussians::table(&initial(lens[0], random), 1);
    let objects = TrackedGaussians::new(vec![object(1), object(2)], true);
    let mut model = Model::new(vec![
        Part::new(StaticGaussians, fixed),
        Part::new(objects, tracked::table(&own, &numbers)),
    ]);
    make_random(&mut model, random);
    model
}

/// Randomizes moments and statistics.
fn make_random(model: &mut Model, random: &mut Pcg64Mcg) {
    for part in &mut model.parts {
        let statistics = &mut part.statistics;
        for views in &mut statistics.views {
            *views = random.random_range(0..4);
        }
        for sum in statistics
            .sums
            .iter_mut()
            .chain(&mut statistics.time_gradients)
        {
            *sum = random.random_range(0.0..3.0);
        }
        for array in &mut part.table.arrays {
            for moment in array
                .first_moments
                .iter_mut()
                .chain(&mut array.second_moments)
            {
                *moment = random.random_range(0.1..1.0);
            }
        }
    }
}

/// Replaces some values by NaN or infinity.
pub(crate) fn spoil(model: &mut Model) {
    for part in &mut model.parts {
        part.statistics.sums[3] = f32::NAN;
        part.statistics.sums[5] = f32::INFINITY;
        let arrays = &mut part.table.arrays;
        arrays[OPACITY_LOGITS].values[7] = f32::NAN;
        arrays[POSITIONS].values[3 * 11 + 1] = f32::NAN;
        arrays[LOG_SCALES].values[3 * 13..3 * 14].fill(f32::NAN);
        arrays[LOG_SCALES].values[3 * 15] = f32::NAN;
    }
}
