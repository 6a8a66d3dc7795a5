//! Seeds of masks with known pixels.

use glam::Mat3;
use omnilife_schemas::{
    Similarity,
    camera::{ErpCamera, PinholeCamera},
    points::PointCloud,
};

use crate::seeds::masks::*;
use omnilife_engine::camera::View;

fn settings(clock: Clock, velocity: SeedVelocity, maximum: usize) -> SeedSettings<'static> {
    SeedSettings {
        clock,
        lifespan_frames: 3.0,
        velocity,
        exposure: None,
        maximum,
        explained: &[],
    }
}

/// Returns one view of a mask with a component across the seam and one in the middle of the image.
fn scene() -> TrainingScene {
    let camera = ErpCamera::new(16, 8);
    let mut mask = vec![0; 128];
    for pixel in [4 * 16, 4 * 16 + 15, 3 * 16 + 15] {
        mask[pixel] = 255;
    }
    mask[4 * 16 + 8] = 200;
    mask[4 * 16 + 9] = 100;
    let view = TrainingView {
        frame: 0,
        view: View {
            camera: camera.into(),
            rotation: Mat3::IDENTITY,
            centre: Vec3::new(0.0, 0.0, 0.5),
            time_seconds: 2.0,
        },
        pixels: (0..128_u8).flat_map(|pixel| [pixel, 0, 255]).collect(),
        mask: Some(mask),
        ignored: None,
    };
    // Ten points in front of the component in the middle, the nearest at 3, and one beside everything.
    let positions: Vec<[f32; 3]> = (0..10)
        .map(|index| [0.2, 0.2, 3.5 + index as f32])
        .chain([[5.0, 0.0, 0.0]])
        .collect();
    TrainingScene {
        points: PointCloud::of_colour(positions, [0; 3]),
        ..TrainingScene::new(
            "mask",
            camera.into(),
            vec![view],
            Similarity::new([0.0; 3], 1.0),
        )
    }
}

#[test]
fn components_are_connected_around_the_seam() {
    let mask = scene().input_views[0].mask.clone().expect("given");
    // Without a seam the one across it is two.
    assert_eq!(connected_components(&mask, 16, false).1, 3);
    let (labels, components) = connected_components(&mask, 16, true);
    assert_eq!(components, 2);
    assert_eq!(labels[4 * 16], labels[3 * 16 + 15]);
    assert_eq!(labels.iter().flatten().count(), 4);
}

#[test]
fn seeds_lie_on_the_masked_pixels_at_the_distance_of_what_they_hide() {
    let scene = scene();
    let clock = Clock::new(1.0, 0.5, 10.0);
    let seeds = mask_seeds(&scene, &settings(clock, SeedVelocity::Tracked, 100));
    assert_eq!((seeds.masked_pixels, seeds.gaussians.len()), (4, 4));
    assert_eq!(seeds.times.peaks, [2.0; 4]);
    // The second nearest of ten in the middle component; the other takes its distance.
    let expected = Vec3::new(0.2, 0.2, 4.0).length();
    for position in &seeds.gaussians.positions {
        let distance = (Vec3::from_array(*position) - Vec3::Z * 0.5).length();
        assert!((distance - expected).abs() < 1e-4, "{distance} {expected}");
    }
    assert_eq!(seeds.without_points, 3);
    let middle = seeds
        .gaussians
        .positions
        .iter()
        .find(|position| position[2] > 0.6);
    let [x, y, _] = *middle.expect("in front");
    assert!((x - expected * (PI / 16.0).sin() * (PI / 16.0).cos()).abs() < 1e-3 && y > 0.0);
    assert_eq!(
        mask_seeds(&scene, &settings(clock, SeedVelocity::None, 2))
            .gaussians
            .len(),
        2
    );
    assert_eq!(
        mask_seeds(&scene, &settings(clock, SeedVelocity::None, 0))
            .gaussians
            .len(),
        0
    );
}

#[test]
fn pixels_that_objects_explain_have_no_seeds() {
    let scene = scene();
    let clock = Clock::new(1.0, 0.5, 10.0);
    let seeds = |explained: &[Vec<bool>]| {
        let settings = SeedSettings {
            explained,
            ..settings(clock, SeedVelocity::None, 100)
        };
        mask_seeds(&scene, &settings)
    };
    let mask = scene.input_views[0].mask.as_ref().expect("given");
    let first = mask.iter().position(|&value| value > 0).expect("marked");
    let mut one = vec![vec![false; mask.len()]];
    one[0][first] = true;
    assert_eq!(seeds(&one).gaussians.len() + 1, seeds(&[]).gaussians.len());
    let all = vec![vec![true; mask.len()]; scene.input_views.len()];
    assert_eq!(seeds(&all).gaussians.len(), 0);
    // Views without objects have no entries.
    let none = vec![Vec::new(); scene.input_views.len()];
    assert_eq!(seeds(&none), seeds(&[]));
}

#[test]
fn a_component_that_walks_has_its_velocity() {
    let mut scene = scene();
    scene.camera = ErpCamera::new(64, 32).into();
    let first = scene.input_views[0].clone();
    scene.input_views.clear();
    // One column to the right per frame, from the middle of the image; frames 0, 1, 2, 4.
    for (frame, column) in [(0, 32), (1, 33), (2, 34), (4, 36)] {
        let mut view = first.clone();
        view.frame = frame;
        view.view.time_seconds = f64::from(frame);
        view.pixels = vec![90; 64 * 32 * 3];
        let mut mask = vec![0; 64 * 32];
        for row in [15, 16] {
            mask[row * 64 + column] = 255;
        }
        view.mask = Some(mask);
        scene.input_views.push(view);
    }
    let clock = Clock::new(2.0, 1.0, 4.0);
    let seeds = mask_seeds(&scene, &settings(clock, SeedVelocity::Tracked, 100));
    assert_eq!(seeds.gaussians.len(), 8);
    // In the first and the last view too, which have only one neighbour.
    for (velocity, position) in seeds
        .times
        .velocities
        .iter()
        .zip(&seeds.gaussians.positions)
    {
        let offset = Vec3::from_array(*position) - Vec3::Z * 0.5;
        let speed = Vec3::from_array(*velocity).length() / offset.length();
        // A column is a sixty-fourth of a full rotation.
        assert!((speed - 2.0 * PI / 64.0).abs() < 0.01, "{speed}");
    }
    // A component in only one view is at rest.
    scene.input_views.truncate(1);
    let alone = mask_seeds(&scene, &settings(clock, SeedVelocity::Tracked, 100));
    assert_eq!(alone.times.velocities, [[0.0; 3]; 2]);
}

#[test]
fn seeds_have_the_colours_of_the_compensated_image() {
    let scene = scene();
    let clock = Clock::new(1.0, 0.5, 10.0);
    // Twice the light at the view's time as in the middle of all views: half of white has the level 0.7354.
    let pairs = |gain: f32| vec![[[0.2 * gain; 3], [0.2; 3]]; 60];
    let views = [(0.0, pairs(1.0)), (1.0, pairs(1.0)), (2.0, pairs(2.0))];
    let exposure = Exposure::estimate(&views);
    let bright = settings(clock, SeedVelocity::None, 9);
    let compensated = SeedSettings {
        exposure: exposure.as_ref(),
        ..bright
    };
    let colours = |settings| mask_seeds(&scene, &settings).gaussians.colours;
    let pairs = colours(bright).into_iter().zip(colours(compensated));
    for (bright, compensated) in pairs {
        assert!(bright[2] == 1.0 && (compensated[2] - 0.735_36).abs() < 1e-4);
    }
}

#[test]
fn empty_masks_have_no_seeds() {
    let mut scene = scene();
    let clock = Clock::new(0.0, 1.0, 0.0);
    for mask in [None, Some(vec![0; 128])] {
        scene.input_views[0].mask = mask;
        let seeds = mask_seeds(&scene, &settings(clock, SeedVelocity::Tracked, 9));
        assert_eq!(seeds, MaskSeeds::default());
    }
}

/// Checks that seeds lie along the pixels of a pinhole, and have the size of its pixels there.
#[test]
fn seeds_of_a_pinhole_lie_on_its_rays() {
    let mut scene = scene();
    let camera = PinholeCamera::new([16, 8], [10.0, 10.0], [8.0, 4.0]);
    scene.camera = camera.into();
    scene.input_views[0].view.camera = camera.into();
    let clock = Clock::new(1.0, 0.5, 10.0);
    let seeds = mask_seeds(&scene, &settings(clock, SeedVelocity::None, 9));
    // Those at both sides of the image are two components.
    assert_eq!(seeds.masked_pixels, 4);
    let centre = scene.input_views[0].view.centre.as_dvec3();
    let mut pixels: Vec<[u32; 2]> = seeds
        .gaussians
        .positions
        .iter()
        .map(|&position| {
            let point = Vec3::from_array(position).as_dvec3() - centre;
            let pixel = camera.project(point).map(|pixel| pixel.floor().as_uvec2());
            pixel.map_or([u32::MAX; 2], |pixel| pixel.to_array())
        })
        .collect();
    pixels.sort_unstable();
    assert_eq!(pixels, [[0, 4], [8, 4], [15, 3], [15, 4]]);
}
