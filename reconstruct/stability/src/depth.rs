//! Cases of distances: their lift, the agreement of views, and their fused surface.

use glam::{Mat3, Vec3, vec3};
use omnilife_engine::{
    camera::View,
    losses::scaffold::{Scaffold, fuse::FusedView},
};
use omnilife_schemas::{camera::ErpCamera, distances::DistanceImage};

use super::special::{CaseResult, HostOnly, Runs, SpecialCase};
use omnilife_training::seeds::depth::{
    DistanceView, LiftSettings, SurfaceSamples, fit_scales, incidence, lift, lift::z_onto,
};

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "lifted-distances",
        title: "distances that are unknown, tiny, huge, alone, all equal or jump from pixel to pixel",
        runs: Runs::OnCpu(HostOnly::Preparation),
        judge: |_| lifted_distances(),
    },
    SpecialCase {
        id: "lifted-scene-size",
        title: "one room lifted at sizes of 1e-6 and 1e6, and far from the origin",
        runs: Runs::OnCpu(HostOnly::Preparation),
        judge: |_| lifted_scene_size(),
    },
    SpecialCase {
        id: "flat-gaussian-rotation",
        title: "normals along and against every axis",
        runs: Runs::OnCpu(HostOnly::Preparation),
        judge: |_| rotations(),
    },
    SpecialCase {
        id: "depth-scales",
        title: "one view, views that share nothing, a view ten times as large",
        runs: Runs::OnCpu(HostOnly::Preparation),
        judge: |_| depth_scales(),
    },
    SpecialCase {
        id: "scaffold-field",
        title: "the fused surface beyond its truncation, at a block's border, at a camera, at places that \
                no number of a voxel reaches",
        runs: Runs::OnCpu(HostOnly::Preparation),
        judge: |_| scaffold_field(),
    },
];

const SIZE: [usize; 2] = [64, 32];

fn view(centre: Vec3) -> View {
    View {
        camera: ErpCamera {
            width: SIZE[0] as u32,
            height: SIZE[1] as u32,
        }
        .into(),
        rotation: Mat3::IDENTITY,
        centre,
        time_seconds: 0.0,
    }
}

fn image(value: impl Fn(usize, usize) -> f32) -> DistanceImage {
    let [width, height] = SIZE;
    DistanceImage {
        width,
        height,
        wraps: true,
        values: (0..width * height)
            .map(|at| value(at % width, at / width))
            .collect(),
    }
}

/// Returns distances of the walls of a cube of half a side `half` from its middle.
fn cube(half: f32) -> DistanceImage {
    image(|column, row| {
        let longitude = ((column as f32 + 0.5) / 64.0 - 0.5) * std::f32::consts::TAU;
        let latitude = (0.5 - (row as f32 + 0.5) / 32.0) * std::f32::consts::PI;
        let ray = vec3(
            latitude.cos() * longitude.sin(),
            -latitude.sin(),
            latitude.cos() * longitude.cos(),
        );
        half / ray.abs().max_element()
    })
}

fn lifted(view: &View, distances: &DistanceImage) -> SurfaceSamples {
    let pixels = vec![128; 3 * SIZE[0] * SIZE[1]];
    let given = DistanceView {
        view,
        pixels: &pixels,
        mask: None,
        ignored: None,
        distances,
        confidences: None,
    };
    lift(&given, 0, &LiftSettings::OF_BEST_VIEWS)
}

/// Returns a judgement that passes without a fault.
fn judged(action: impl Into<String>, fault: Option<String>) -> CaseResult {
    CaseResult {
        action: action.into(),
        fault,
        measured: None,
    }
}

/// Returns the fault of samples, if they have one.
fn fault_of(lifted: &SurfaceSamples) -> Option<String> {
    let gaussians = &lifted.gaussians;
    let is_size = |scale: &f32| *scale > 0.0 && scale.is_finite();
    if !gaussians.scales.as_flattened().iter().all(is_size) {
        return Some("a size is not positive".to_owned());
    }
    let places = gaussians.positions.as_flattened().iter();
    if !places
        .chain(gaussians.rotations.as_flattened())
        .all(|value| value.is_finite())
    {
        return Some("a place or a rotation is not finite".to_owned());
    }
    let is_unit = |q: &[f32; 4]| (q.iter().map(|q| q * q).sum::<f32>() - 1.0).abs() < 1e-5;
    (!gaussians.rotations.iter().all(is_unit))
        .then(|| "a rotation is not a unit quaternion".to_owned())
}

fn lifted_distances() -> CaseResult {
    let view = view(Vec3::ZERO);
    let cases = [
        ("unknown", image(|_, _| 0.0)),
        ("1e-30", image(|_, _| 1e-30)),
        ("65535", image(|_, _| 65_535.0)),
        ("1e30", image(|_, _| 1e30)),
        (
            "one column",
            image(|column, _| if column == 30 { 2.0 } else { 0.0 }),
        ),
        ("all equal", image(|_, _| 3.0)),
        (
            "jumps",
            image(|column, row| if (column + row) % 2 == 0 { 1.0 } else { 1e6 }),
        ),
    ];
    let faults = cases.iter().filter_map(|(name, distances)| {
        Some(format!("{name}: {}", fault_of(&lifted(&view, distances))?))
    });
    let unknown = lifted(&view, &cases[0].1).len();
    let fault = faults.collect::<Vec<_>>().join("; ");
    let fault = match (fault.is_empty(), unknown) {
        (true, 0) => None,
        (true, count) => Some(format!("{count} samples of nothing")),
        (false, _) => Some(fault),
    };
    judged("finite samples, or none", fault)
}

fn lifted_scene_size() -> CaseResult {
    let reference = lifted(&view(Vec3::ZERO), &cube(1.0));
    let (mut radii, mut turns) = (0.0_f32, 0.0_f32);
    for size in [1e-6, 1e6] {
        let found = lifted(&view(Vec3::ZERO), &cube(size));
        let pairs = found.radii.iter().zip(&reference.radii);
        let off = pairs.map(|(a, b)| (a / size / b - 1.0).abs());
        radii = off.fold(radii, f32::max);
        let normals = found.normals.iter().zip(&reference.normals);
        turns = normals.map(|(a, b)| a.distance(*b)).fold(turns, f32::max);
        if found.len() != reference.len() {
            return CaseResult::failed(format!("{} samples at {size:e}", found.len()));
        }
    }
    if let Some(fault) = fault_of(&lifted(&view(Vec3::splat(1e6)), &cube(1.0))) {
        return CaseResult::failed(format!("far away: {fault}"));
    }
    CaseResult::of_errors(
        "the same samples, larger or smaller: radii as the value, normals as the gradient",
        Some([f64::from(radii), 3.5e-6]),
        Some([f64::from(turns), 1e-5]),
    )
}

fn rotations() -> CaseResult {
    let mut worst = 0.0_f32;
    for normal in [
        Vec3::X,
        Vec3::NEG_X,
        Vec3::Y,
        Vec3::NEG_Y,
        Vec3::Z,
        Vec3::NEG_Z,
        vec3(1e-4, -1e-4, -1.0).normalize(),
        vec3(1e-2, 1e-2, -1.0).normalize(),
    ] {
        let [w, x, y, z] = z_onto(normal);
        let turned = glam::Quat::from_xyzw(x, y, z, w) * Vec3::Z;
        worst = worst.max(turned.distance(normal));
    }
    CaseResult::of_errors(
        "the third axis on the normal",
        Some([f64::from(worst), 1.4e-3]),
        None,
    )
}

fn depth_scales() -> CaseResult {
    let (near, far) = (view(Vec3::ZERO), view(Vec3::splat(1e4)));
    let (distances, large) = (cube(1.0), cube(10.0));
    let pixels = vec![128; 3 * SIZE[0] * SIZE[1]];
    let given = |view, distances| DistanceView {
        view,
        pixels: &pixels,
        mask: None,
        ignored: None,
        distances,
        confidences: None,
    };
    let beside = view(vec3(0.2, 0.0, 0.0));
    let fits = [
        ("one view", fit_scales(&[given(&near, &distances)]), 1),
        (
            "nothing shared",
            fit_scales(&[given(&near, &distances), given(&far, &distances)]),
            2,
        ),
        (
            "ten times as large",
            fit_scales(&[given(&near, &distances), given(&beside, &large)]),
            2,
        ),
    ];
    let faults = fits.iter().filter_map(|(name, fit, groups)| {
        let is_finite = fit.log_scales.iter().all(|scale| scale.is_finite());
        (!is_finite || fit.groups.len() != *groups)
            .then(|| format!("{name}: {:?} in {:?}", fit.log_scales, fit.groups))
    });
    let faults: Vec<String> = faults.collect();
    let fault = (!faults.is_empty()).then(|| faults.join("; "));
    judged("groups of their own", fault)
}

fn scaffold_field() -> CaseResult {
    let (view, distances) = (view(Vec3::ZERO), cube(1.0));
    let pixels = vec![128; 3 * SIZE[0] * SIZE[1]];
    let given = DistanceView {
        view: &view,
        pixels: &pixels,
        mask: None,
        ignored: None,
        distances: &distances,
        confidences: None,
    };
    let incidence = incidence(&given);
    let fused = FusedView {
        view: &view,
        distances: &distances,
        incidence: &incidence,
    };
    let field = Scaffold::fuse(&[fused], 0.1, Vec3::ZERO);
    let mut faults = Vec::new();
    // The camera's own place, far outside, and where i32 has no voxel.
    for nowhere in [
        Vec3::ZERO,
        Vec3::splat(50.0),
        Vec3::splat(1e20),
        Vec3::splat(f32::NAN),
    ] {
        if field.value(nowhere).is_some() {
            faults.push(format!("a value at {nowhere}"));
        }
    }
    // Through the surface, across the border of blocks at 0.8.
    let (mut known, mut off, mut tilt) = (0, 0.0_f32, 0.0_f32);
    for step in 0..60 {
        let place = vec3(0.013, 0.027, 0.75 + 0.005 * step as f32);
        let Some(value) = field.value(place) else {
            continue;
        };
        known += 1;
        off = off.max((value.distance - (1.0 - place.z)).abs());
        tilt = tilt.max(value.gradient.distance(Vec3::NEG_Z));
    }
    if known < 30 {
        faults.push(format!(
            "{known} of 60 places near the surface have a value"
        ));
    }
    if !faults.is_empty() {
        return CaseResult::failed(faults.join("; "));
    }
    CaseResult::of_errors(
        "distances and their gradient; no value where no surface is near",
        Some([f64::from(off), 0.015]),
        Some([f64::from(tilt), 0.05]),
    )
}
