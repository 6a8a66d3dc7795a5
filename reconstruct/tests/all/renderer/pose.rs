//! The gradient by a camera's pose against finite differences of the f64 reference.

use glam::{DMat3, DQuat, DVec3, dvec3};
use omnilife_engine::{
    camera::Camera,
    gaussians::ActivatedGaussians,
    render::{cpu::Renderer, project::by_camera, raster::RasterGradient, settings::Footprint},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::renderer::{
    erp, pinhole, settings,
    support::{
        reference::{self, Gaussian, RefView, instant},
        scenes::{Richness, scene, turned},
    },
};

/// Returns the view after a world rotation about its centre and a shift.
fn moved(view: &RefView, rotation: DVec3, shift: DVec3) -> RefView {
    RefView {
        rotation: view.rotation * DMat3::from_quat(DQuat::from_scaled_axis(-rotation)),
        centre: view.centre + shift,
        ..*view
    }
}

fn check(view: &RefView, gaussians: &[Gaussian], random: &mut Pcg64Mcg) {
    let pixels = view.camera.width() as usize * view.camera.height() as usize;
    let features = gaussians[0].features.len();
    let mut weights =
        |count: usize| -> Vec<f32> { (0..count).map(|_| random.random_range(-1.0..1.0)).collect() };
    let (by_colour, by_features) = (weights(pixels * 3), weights(pixels * features));
    let dot = |values: &[f64], weights: &[f32]| -> f64 {
        let pairs = values.iter().zip(weights);
        pairs.map(|(a, &b)| a * f64::from(b)).sum()
    };
    let (_, decisions) = reference::render(view, gaussians, None);
    let loss = |rotation: DVec3, shift: DVec3| {
        let view = moved(view, rotation, shift);
        let (image, _) = reference::render(&view, gaussians, Some(&decisions));
        dot(&image.colour, &by_colour) + dot(&image.features, &by_features)
    };
    let difference = |of: &dyn Fn(DVec3) -> f64| {
        let step = 1e-6;
        let along = DVec3::AXES.map(|axis| (of(axis * step) - of(-axis * step)) / (2.0 * step));
        DVec3::from_array(along)
    };
    let expected = [
        difference(&|rotation| loss(rotation, DVec3::ZERO)),
        difference(&|shift| loss(DVec3::ZERO, shift)),
    ];

    let (drawn, instant) = (view.view(), instant(gaussians));
    let mut renderer = Renderer::new(view.settings);
    renderer.forward(&drawn, &instant);
    let upstream = RasterGradient::new(&by_colour, &by_features);
    let mut gradient = ActivatedGaussians::default();
    renderer.backward(&drawn, &instant, &upstream, &mut gradient);
    let degree = view.settings.sh_degree;
    let found = by_camera::gradient(&drawn, &instant, degree, &gradient);
    for (what, found, expected) in [
        ("rotation", found.rotation, expected[0]),
        ("centre", found.centre, expected[1]),
    ] {
        assert!(expected.length() > 1e-2, "{what} does nothing");
        assert!(
            (found - expected).length() < 1e-3 * expected.length(),
            "{what}: {found} against {expected}, {:?} {:?} degree {degree}",
            view.camera,
            view.settings.footprint
        );
    }
}

#[test]
fn gradients_by_the_pose_are_those_of_the_reference() {
    let mut random = Pcg64Mcg::seed_from_u64(31);
    let cases: [(Camera, Footprint, usize, usize); 6] = [
        (erp(40), Footprint::Projected, 0, 0),
        (erp(48), Footprint::Projected, 1, 1),
        (erp(40), Footprint::Projected, 3, 0),
        (erp(40), Footprint::Ray, 2, 2),
        (pinhole(36, 24), Footprint::Projected, 2, 1),
        (pinhole(36, 24), Footprint::Ray, 0, 0),
    ];
    for (camera, footprint, sh_degree, features) in cases {
        for rotation in [DQuat::IDENTITY, turned()] {
            let richness = Richness::new(sh_degree, features);
            // Its first ones lie on the seam, at the poles and around the camera.
            let gaussians = scene(&mut random, 24, richness);
            let mut settings = settings(footprint);
            settings.sh_degree = sh_degree;
            let view = RefView::new(camera, rotation, dvec3(0.3, -0.2, 0.4), settings);
            check(&view, &gaussians, &mut random);
        }
    }
}

#[test]
fn gaussians_whose_gradient_is_not_finite_have_no_say_and_threads_do_not_matter() {
    let mut random = Pcg64Mcg::seed_from_u64(32);
    let richness = Richness::new(1, 0);
    let gaussians = instant(&scene(&mut random, 5000, richness));
    let mut gradient = gaussians.clone();
    let view = RefView::new(
        erp(64),
        turned(),
        dvec3(0.1, 0.2, 0.3),
        settings(Footprint::Projected),
    )
    .view();
    let run = |gradient: &ActivatedGaussians, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build()
            .unwrap()
            .install(|| by_camera::gradient(&view, &gaussians, 1, gradient))
    };
    let whole = run(&gradient, 1);
    assert_eq!(whole, run(&gradient, 3));
    gradient.positions[7] = [f32::NAN, 0.0, 0.0];
    gradient.rotations[3000] = [0.0, f32::INFINITY, 0.0, 0.0];
    let rest = run(&gradient, 2);
    assert!(rest.rotation.is_finite() && rest.centre.is_finite() && rest != whole);
    gradient.positions[7] = [0.0; 3];
    gradient.rotations[7] = [0.0; 4];
    gradient.sh_constant[7] = [0.0; 3];
    gradient.rotations[3000] = [0.0; 4];
    gradient.positions[3000] = [0.0; 3];
    gradient.sh_constant[3000] = [0.0; 3];
    assert_eq!(rest, run(&gradient, 2));
}
