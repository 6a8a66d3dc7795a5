//! A scene rendered from known Gaussians: opaque balls all around a camera that moves past them; every fifth view
//! is a novel one.

use glam::{DQuat, DVec3, dvec3};
use omnilife_engine::{
    camera::View,
    gaussians::{
        ActivatedGaussians,
        static_gaussians::{self, InitialGaussians, SH_REST},
    },
    parameters::ParameterTable,
    render::{cpu::Renderer, settings::RenderSettings},
    training_view::TrainingView,
};
use omnilife_reconstruct::{scene::TrainingScene, seeds};
use omnilife_schemas::{
    Pose, Similarity,
    camera::{Camera, ErpCamera},
    points::PointCloud,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// The spherical harmonics of degree 1 over the coordinates of a direction.
const SH_C1: f32 = 0.488_602_5;

pub(crate) const CAMERA: Camera = Camera::Erp(ErpCamera::new(96, 48));

/// Returns the scene: every ball has a colour of its own, the same from all directions.
pub(crate) fn scene() -> TrainingScene {
    let colour = |random: &mut Pcg64Mcg, _| [0; 3].map(|_| random.random_range(0.1..0.9));
    scene_with(CAMERA, colour, 0.25, 0.0)
}

/// Returns the scene with balls of this standard deviation and with colours by the direction of a ball. Colours
/// change by `gloss` times the `z` of the viewing direction.
pub(crate) fn scene_with(
    camera: Camera,
    mut colour: impl FnMut(&mut Pcg64Mcg, DVec3) -> [f32; 3],
    scale: f32,
    gloss: f32,
) -> TrainingScene {
    let mut random = Pcg64Mcg::seed_from_u64(21);
    let mut truth = InitialGaussians::default();
    let mut points = PointCloud::default();
    for direction in 0..900 {
        let y = 1.0 - (f64::from(direction) + 0.5) / 450.0;
        let angle = 2.399_963 * f64::from(direction);
        let rho = (1.0 - y * y).sqrt();
        let distance = random.random_range(4.0..6.0);
        let direction = DVec3::new(rho * angle.cos(), y, rho * angle.sin());
        let position = direction * distance;
        let colour = colour(&mut random, direction);
        truth.push_isotropic(position.as_vec3().to_array(), scale, colour, 0.95);
        let jitter = DVec3::from_array([0; 3].map(|_| random.random_range(-0.1..0.1)));
        points
            .positions
            .push((position + jitter).as_vec3().to_array());
        points.colours.push([128; 3]);
    }
    let mut instant = ActivatedGaussians::default();
    let mut table = static_gaussians::table(&truth, 1);
    for harmonics in table.arrays[SH_REST].values.as_chunks_mut::<9>().0 {
        // That of `z` is the second one of degree 1.
        harmonics[3..6].fill(gloss / SH_C1);
    }
    static_gaussians::activate(&table, &mut instant);
    let mut renderer = Renderer::new(RenderSettings::new(0.01));
    let normalization = Similarity::new([0.0; 3], 1.0);
    let (mut input_views, mut novel_views) = (Vec::new(), Vec::new());
    for frame in 0..15_u32 {
        let along = f64::from(frame) / 7.0 - 1.0;
        let turn = DQuat::from_rotation_y(0.3 * along);
        let pose = Pose::new(turn, dvec3(0.2 * along, 0.0, along));
        let view = View::new(camera, &pose, &normalization, f64::from(frame)).unwrap();
        let pixels = renderer.image(&view, &instant).to_rgb8();
        let views = if frame % 5 == 4 {
            &mut novel_views
        } else {
            &mut input_views
        };
        views.push(TrainingView {
            frame,
            view,
            pixels,
            mask: None,
            ignored: None,
        });
    }
    TrainingScene {
        novel_views,
        points,
        ..TrainingScene::new("balls", camera, input_views, normalization)
    }
}

/// Returns every fifth point of a scene as static Gaussians with harmonics up to a degree, of shapes with which
/// no gradient vanishes.
pub(crate) fn table(scene: &TrainingScene, sh_degree: usize) -> ParameterTable {
    let points = PointCloud {
        positions: scene.points.positions.iter().step_by(5).copied().collect(),
        colours: scene.points.colours.iter().step_by(5).copied().collect(),
    };
    let initial = seeds::points::from_points(&points, 3.0);
    let mut table = static_gaussians::table(&initial, sh_degree);
    vary_shapes(&mut table);
    table
}

/// Rotates each Gaussian and makes it longer along one axis.
pub(crate) fn vary_shapes(table: &mut ParameterTable) {
    for (array, offset) in [
        (static_gaussians::LOG_SCALES, 0.4_f32),
        (static_gaussians::QUATERNIONS, 0.5),
    ] {
        for (index, value) in table.arrays[array].values.iter_mut().enumerate() {
            *value += offset * (1.7 * index as f32).sin();
        }
    }
}
