//! Scenes of a given size for measurements.

use std::f64::consts::PI;

use glam::{DQuat, Mat3, Vec3, dvec3};
use omnilife_engine::{
    camera::View,
    clock::Clock,
    gaussians::{
        ActivatedGaussians,
        deformable::{Deformable, DeformationModel, settings::DeformationSettings},
        omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
        static_gaussians::{self, InitialGaussians},
        temporal::{InitialTimes, LifespanRange, TemporalFeatures, TimeModel, VelocityModel},
    },
    model::dynamic_settings::{DynamicLoss, DynamicSettings, MotionForm, MotionLoss, VelocityLoss},
    parameters::ParameterTable,
    render::{cpu::Renderer, settings::RenderSettings},
};
use omnilife_schemas::{RgbImage, camera::ErpCamera};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Returns Gaussians all around the camera, as after training: about as wide as the distance to their neighbours,
/// flattened and rotated at random, 1 to 10 units away.
pub(crate) fn scene(count: usize) -> ParameterTable {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut table = static_gaussians::table(&initial(count, &mut random), 0);
    vary(&mut table, &mut random);
    table
}

fn initial(count: usize, random: &mut Pcg64Mcg) -> InitialGaussians {
    let mut initial = InitialGaussians::default();
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
    initial
}

/// Makes round Gaussians long and flat, and rotates them.
fn vary(table: &mut ParameterTable, random: &mut Pcg64Mcg) {
    let mut normal = || -> f32 { StandardNormal.sample(random) };
    for value in &mut table.arrays[static_gaussians::LOG_SCALES].values {
        *value += 0.6 * normal();
    }
    for value in &mut table.arrays[static_gaussians::QUATERNIONS].values {
        *value = normal();
    }
}

/// Returns a rotated camera at the centre of a [`scene`].
pub(crate) fn view(width: u32) -> View {
    let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.2);
    View {
        camera: ErpCamera::new(width, width / 2).into(),
        rotation: Mat3::from_quat(rotation.as_quat()),
        centre: Vec3::ZERO,
        time_seconds: 0.0,
    }
}

/// Returns the image of a [`scene`] of half as many Gaussians, the target of a step.
pub(crate) fn target(count: usize, view: &View, settings: RenderSettings) -> RgbImage {
    let mut instant = ActivatedGaussians::default();
    static_gaussians::activate(&scene(count / 2), &mut instant);
    Renderer::new(settings).image(view, &instant)
}

/// Sixty frames a second apart.
const CLIP: Clock = Clock::new(0.0, 1.0, 60.0);

/// Returns the network of Deformable-GS, active from the first step on, in a [`CLIP`].
pub(crate) fn deformation() -> Deformable {
    let model = DeformationModel::published(3.0);
    let settings = DeformationSettings {
        clock: CLIP,
        model,
        warm_up_iterations: 0,
        time_noise: None,
    };
    Deformable::new(settings, model.network().initial_weights(1))
}

/// Returns time and losses of Omni4DGS in a [`CLIP`].
pub(crate) fn dynamics() -> DynamicSettings {
    DynamicSettings {
        clock: CLIP,
        time: TimeModel {
            cycle_frames: 10.0,
            lifespans: Some(LifespanRange {
                least_frames: 0.25,
                largest_frames: 1e6,
            }),
            velocity: VelocityModel::Decomposed(Decomposition {
                gamma: 0.5,
                form: VelocityForm::Literal,
                origin: DirectionOrigin::World,
            }),
            least_marginal: 0.0,
        },
        down: [0.0, 1.0, 0.0],
        dynamic_below_staticness: 1.0,
        dynamic_loss: Some(DynamicLoss {
            weight: 0.1,
            ssim_weight: 0.2,
            begin_iteration: 0,
        }),
        velocity_loss: Some(VelocityLoss {
            weight: 0.01,
            outside_masks: true,
        }),
        lifespan_weight: 0.0,
        features: TemporalFeatures {
            velocity_unit: Some(1.0),
            lifespan: None,
        },
        motion_loss: Some(MotionLoss {
            weight: 0.01,
            form: MotionForm::Seen,
        }),
        smoothing: None,
        density: None,
    }
}

/// Returns a [`scene`] whose Gaussians have times of their own: a tenth of them with lifespans of two frames, the
/// others with the whole clip.
pub(crate) fn moving_scene(count: usize, dynamics: &DynamicSettings) -> ParameterTable {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let initial = initial(count, &mut random);
    let mut times = InitialTimes::constant(count, 0.0, 60.0);
    for index in (0..count).step_by(10) {
        times.lifespans[index] = 2.0;
        times.velocities[index] = [0.02, 0.0, -0.02];
    }
    let mut table = dynamics.time.table(&initial, &times, 0);
    vary(&mut table, &mut random);
    table
}
