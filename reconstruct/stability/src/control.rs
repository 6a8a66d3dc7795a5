//! Cases of density control, first sizes of points, first velocities, gains, and steps of poses.

use glam::{DVec3, Mat3, Quat, Vec3};
use omnilife_engine::{
    density::{DensifySettings, DensityContext, SizeUnit, Threshold, densify},
    gaussians::static_gaussians::{InitialGaussians, LOG_SCALES, OPACITY_LOGITS, POSITIONS, table},
    model::{Model, exposure::Exposure, pose_corrections::PoseCorrections},
    render::project::by_camera::PoseGradient,
    training_view::TrainingView,
};
use omnilife_schemas::points::PointCloud;
use omnilife_training::{
    baseline,
    seeds::{
        masks::{SeedSettings, SeedVelocity, mask_seeds},
        points,
    },
};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use crate::{
    clips,
    devices::Device,
    largest_or_nan,
    special::{CaseResult, HostOnly, Runs, SpecialCase},
};

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "density-split",
        title: "4000 splits of a flat, rotated Gaussian: sizes and places of its children",
        runs: Runs::OnCpu(HostOnly::WithinSteps),
        judge: |_| split(),
    },
    SpecialCase {
        id: "density-reset",
        title: "opacities from a millionth to almost one after their reset",
        runs: Runs::OnBoth,
        judge: reset,
    },
    SpecialCase {
        id: "points-sizes",
        title: "first sizes of points a millionth and a million units apart",
        runs: Runs::OnCpu(HostOnly::Preparation),
        judge: |_| sizes_of_points(),
    },
    SpecialCase {
        id: "seeds-velocity",
        title: "first velocities of seeds on a disc that passes, in images of 48 columns",
        runs: Runs::OnCpu(HostOnly::Preparation),
        judge: |_| velocities_of_seeds(),
    },
    SpecialCase {
        id: "exposure-gains",
        title: "gains of a half to four, where every fifth place shows something else",
        runs: Runs::OnCpu(HostOnly::Preparation),
        judge: |_| gains(),
    },
    SpecialCase {
        id: "pose-steps",
        title: "steps of poses down a valley, among views that are right",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| pose_steps(),
    },
];

const SPLITS: usize = 4_000;
/// Factor by which children are smaller (3DGS).
const SHRINK: f64 = 1.6;

/// Compares the second moments of the children's places with the covariance of their parent, and their sizes with
/// its own.
fn split() -> CaseResult {
    let scale = [0.8_f32, 0.3, 0.05];
    let rotation = Quat::from_scaled_axis(Vec3::new(0.4, -0.9, 0.3));
    let mut initial = InitialGaussians::default();
    for _ in 0..SPLITS {
        initial.push_isotropic([5.0, -1.0, 2.0], 1.0, [0.5; 3], 0.5);
    }
    initial.scales.fill(scale);
    initial
        .rotations
        .fill([rotation.w, rotation.x, rotation.y, rotation.z]);
    let mut model = Model::of_static(table(&initial, 0));
    let statistics = &mut model.parts[0].statistics;
    statistics.sums.fill(4.0);
    statistics.views.fill(1);
    let settings = DensifySettings {
        gradient_threshold: Threshold::constant(1.0),
        size_unit: SizeUnit::Length(1.0),
        clone_size: 0.01,
        prune_size: 100.0,
        ..baseline::published_settings(30_000).densify
    };
    let context = DensityContext {
        views: &[],
        last_view: 0,
        temporal: None,
    };
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let done = densify(&mut model, &settings, 600, &context, &mut random);
    let table = &model.parts[0].table;
    if (done.split, table.len()) != (SPLITS, 2 * SPLITS) {
        return CaseResult::failed(format!("{} children of {} splits", table.len(), done.split));
    }
    let back = Mat3::from_quat(rotation).transpose();
    let (mut squares, mut sizes) = ([0.0; 3], 0.0_f64);
    for child in 0..table.len() {
        let place = Vec3::from_slice(table.row(POSITIONS, child)) - Vec3::new(5.0, -1.0, 2.0);
        let own = (back * place).to_array();
        for axis in 0..3 {
            let share = f64::from(own[axis]) / f64::from(scale[axis]);
            squares[axis] += share * share / table.len() as f64;
            let size = f64::from(table.row(LOG_SCALES, child)[axis]).exp();
            let expected = f64::from(scale[axis]) / SHRINK;
            sizes = largest_or_nan(sizes, (size / expected - 1.0).abs());
        }
    }
    let spread = squares.map(|square: f64| (square - 1.0).abs());
    let spread = spread.into_iter().fold(0.0, largest_or_nan);
    CaseResult::of_errors(
        "sizes as the value, second moments of places (by chance 2 %) as the gradient",
        Some([sizes, 2.5e-7]),
        Some([spread, 0.015]),
    )
}

/// Compares opacities after a reset with the smaller of their own and a hundredth.
fn reset(device: &Device) -> CaseResult {
    let opacities = [1e-6_f32, 1e-3, 0.0099, 0.0101, 0.5, 0.999_99];
    let mut initial = InitialGaussians::default();
    for opacity in opacities {
        initial.push_isotropic([1.0, 0.0, 0.0], 0.1, [0.5; 3], opacity);
    }
    let model = match device.reset_opacities(Model::of_static(table(&initial, 0))) {
        Ok(model) => model,
        Err(error) => return CaseResult::failed(error),
    };
    let logits = &model.parts[0].table.arrays[OPACITY_LOGITS].values;
    let errors = logits.iter().zip(opacities).map(|(&logit, before)| {
        let found = 1.0 / (1.0 + (-f64::from(logit)).exp());
        let expected = f64::from(before).min(0.01);
        (found / expected - 1.0).abs()
    });
    let error = errors.fold(0.0, largest_or_nan);
    CaseResult::of_errors(
        "a hundredth at most, lower ones stay",
        Some([error, 2e-6]),
        None,
    )
}

/// Compares sizes with the root mean square of the distances of the three nearest neighbours.
fn sizes_of_points() -> CaseResult {
    let mut worst = 0.0_f64;
    for unit in [1e-6_f32, 1.0, 1e6] {
        let positions: Vec<[f32; 3]> = (0..60)
            .map(|index| {
                let phase = index as f32;
                [phase.sin(), (1.3 * phase).cos(), (0.7 * phase).sin()].map(|value| unit * value)
            })
            .collect();
        let cloud = PointCloud {
            colours: vec![[100; 3]; positions.len()],
            positions: positions.clone(),
        };
        let gaussians = points::from_points(&cloud, 1e3);
        let wide: Vec<DVec3> = positions
            .iter()
            .map(|&place| Vec3::from_array(place).as_dvec3())
            .collect();
        for (place, scale) in wide.iter().zip(&gaussians.scales) {
            let mut squares: Vec<f64> = wide
                .iter()
                .map(|other| other.distance_squared(*place))
                .collect();
            squares.sort_by(f64::total_cmp);
            let expected = (squares[1..4].iter().sum::<f64>() / 3.0).sqrt();
            worst = largest_or_nan(worst, (f64::from(scale[0]) / expected - 1.0).abs());
        }
    }
    CaseResult::of_errors("from the three nearest points", Some([worst, 1e-6]), None)
}

/// Compares velocities of seeds with that of the disc at their distance, across the line of sight.
fn velocities_of_seeds() -> CaseResult {
    let scene = clips::scene_of(clips::FRAMES);
    let Some((scene, clock)) = scene.and_then(|scene| {
        let clock = scene.clock().ok()?;
        Some((scene, clock))
    }) else {
        return CaseResult::failed("the scene has no clock".to_owned());
    };
    let seeds = mask_seeds(
        &scene,
        &SeedSettings {
            clock,
            lifespan_frames: 2.0,
            velocity: SeedVelocity::Tracked,
            exposure: None,
            maximum: 1_000,
            explained: &[],
        },
    );
    let (mut worst, mut compared) = (0.0, 0);
    // Views with one before and one after.
    for views in scene.input_views.windows(3) {
        let [before, now, after] = views else {
            continue;
        };
        let peak = clock.frame(now.view.time_seconds);
        let times = &seeds.times;
        for (index, &own) in times.peaks.iter().enumerate() {
            if (f64::from(own) - peak).abs() > 0.1 {
                continue;
            }
            let place = Vec3::from_array(seeds.gaussians.positions[index]);
            let distance = f64::from(place.distance(now.view.centre));
            let at = |view: &TrainingView| {
                let towards = clips::towards_disc(view.frame, clips::FRAMES);
                view.view.centre.as_dvec3() + distance * towards
            };
            let whole = (at(after) - at(before)) / 2.0;
            let towards = clips::towards_disc(now.frame, clips::FRAMES);
            let across = whole - towards * towards.dot(whole);
            let found = Vec3::from_array(times.velocities[index]).as_dvec3();
            worst = largest_or_nan(worst, (found - across).length() / across.length());
            compared += 1;
        }
    }
    if compared == 0 {
        return CaseResult::failed("no seed lies on the disc".to_owned());
    }
    CaseResult::of_errors(
        "by the middles of masks, whose pixels are half as wide as the disc's way",
        Some([worst, 0.45]),
        None,
    )
}

/// Compares estimated gains with known ones; every fifth place shows something else.
fn gains() -> CaseResult {
    let known = [0.5_f32, 0.7, 1.0, 2.0, 4.0];
    let view = |(number, gain): (usize, f32)| {
        let pair = |place: usize| {
            let rendered = 0.06 + 0.0001 * place as f32;
            let shown = if place.is_multiple_of(5) {
                0.9
            } else {
                gain * rendered
            };
            [[shown; 3], [rendered; 3]]
        };
        (number as f64, (0..1000).map(pair).collect::<Vec<_>>())
    };
    let views: Vec<_> = known.into_iter().enumerate().map(view).collect();
    let Some(exposure) = Exposure::estimate(&views) else {
        return CaseResult::failed("no gain was found".to_owned());
    };
    let mut worst = 0.0_f64;
    for (number, gain) in known.into_iter().enumerate() {
        for found in exposure.gain(number as f64) {
            worst = largest_or_nan(worst, f64::from((found / gain - 1.0).abs()));
        }
    }
    CaseResult::of_errors("the medians of ratios", Some([worst, 1e-7]), None)
}

/// Lets one of four views go down a valley: it ends where the bottom is, against the others.
fn pose_steps() -> CaseResult {
    let mut poses = PoseCorrections::new(vec![0.0, 1.0, 2.0, 3.0]);
    // The means of all corrections are 0.
    let wanted = DVec3::new(0.02, -0.05, 0.03);
    let bottom = |view: usize| if view == 2 { wanted } else { -wanted / 3.0 };
    for step in 0..600 {
        let rate = 3e-3 * 0.99_f32.powi(step);
        for view in 0..4 {
            let own = poses.of_view(view);
            let gradient = PoseGradient {
                rotation: own.rotation.as_dvec3() - bottom(view),
                centre: own.centre.as_dvec3() - bottom(view),
            };
            poses.step(view, &gradient, [rate; 2]);
        }
    }
    let errors = (0..4).map(|view| {
        let own = poses.of_view(view);
        let off = |found: Vec3| (found.as_dvec3() - bottom(view)).length() / wanted.length();
        off(own.rotation).max(off(own.centre))
    });
    let error = errors.fold(0.0, largest_or_nan);
    CaseResult::of_errors(
        "each view ends at the bottom of its own valley",
        Some([error, 6e-6]),
        None,
    )
}
