//! Cases of objects that move along paths: poses, boxes, and times without the object.

use glam::{DVec3, Vec3};
use omnilife_engine::{
    gaussians::{
        ActivatedGaussians,
        parameterization::Viewpoint,
        static_gaussians::InitialGaussians,
        tracked::{self, TrackedGaussians, TrackedObject},
    },
    model::Part,
    trajectories::rigid_path::RigidPath,
};
use omnilife_schemas::{
    Similarity,
    trajectory::{BSpline, ObjectPath},
};

use omnilife_training::error::ReconstructError;

use crate::{
    devices::Device,
    special::{CaseResult, Runs, SpecialCase},
};

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "object-heading",
        title: "an object whose heading passes pi, and is given turns away",
        runs: Runs::OnBoth,
        judge: |device| headings(device).unwrap_or_else(CaseResult::failed),
    },
    SpecialCase {
        id: "object-box",
        title: "objects with boxes of 1e-6 and 1e6 of the scene",
        runs: Runs::OnBoth,
        judge: |device| boxes(device).unwrap_or_else(CaseResult::failed),
    },
    SpecialCase {
        id: "object-absent",
        title: "objects before and after their paths, and one whose path has no length in time",
        runs: Runs::OnBoth,
        judge: |device| absent(device).unwrap_or_else(CaseResult::failed),
    },
    SpecialCase {
        id: "object-crowd",
        title: "500 objects in one place",
        runs: Runs::OnBoth,
        judge: |device| crowd(device).unwrap_or_else(CaseResult::failed),
    },
    SpecialCase {
        id: "object-far",
        title: "a path 5e6 m from the origin, as UTM coordinates are",
        runs: Runs::OnBoth,
        judge: |device| far(device).unwrap_or_else(CaseResult::failed),
    },
];

const AS_IS: Similarity = Similarity {
    offset: [0.0; 3],
    scale: 1.0,
};

/// Returns a path from `begin` along x in `seconds`, with its headings at both ends.
fn path(begin: DVec3, seconds: f64, headings: [f64; 2]) -> ObjectPath {
    ObjectPath {
        centre: BSpline {
            degree: 1,
            knots: vec![0.0, 0.0, seconds, seconds],
            coefficients: vec![begin.to_array(), (begin + DVec3::X).to_array()],
        },
        heading_seconds: vec![0.0, seconds.max(1e-3)],
        headings: headings.to_vec(),
    }
}

fn object(id: u32, size: f32, path: &ObjectPath, normalization: &Similarity) -> TrackedObject {
    TrackedObject {
        id,
        dimensions: [size, 0.4 * size, 0.3 * size],
        path: RigidPath::new(path, DVec3::Z, 0.5 * size, 2, normalization),
    }
}

/// Returns the activated Gaussians of some objects, three each, at a time, and all gradients of a loss of them.
fn activated(
    device: &Device,
    objects: Vec<TrackedObject>,
    seconds: f64,
) -> Result<(ActivatedGaussians, Vec<f32>), ReconstructError> {
    let mut initial = InitialGaussians::default();
    let mut numbers = Vec::new();
    for number in 0..objects.len() {
        for place in [-0.4, 0.1, 0.5] {
            initial.push_isotropic([place, 0.1, -0.1], 0.05, [0.5; 3], 0.5);
            numbers.push(number);
        }
    }
    let table = tracked::table(&initial, &numbers);
    let at = Viewpoint {
        seconds,
        shift_frames: 0.0,
        centre: Vec3::ZERO,
        down: Vec3::Y,
        scheduled: Some(1),
    };
    let part = Part::new(TrackedGaussians::new(objects, true), table);
    let (seen, part) = device.activated_part(part, &at, |activated| {
        let mut gradient = ActivatedGaussians::default();
        gradient.clear_to_zero(activated);
        gradient.positions.fill([1.0, -0.5, 0.25]);
        gradient.scales.fill([0.5; 3]);
        gradient.rotations.fill([0.1, 0.2, -0.3, 0.4]);
        gradient
    })?;
    let gradients = part.table.arrays.iter().flat_map(|array| &array.gradients);
    let shared = part.parameterization.shared();
    let of_poses = shared.iter().flat_map(|poses| &poses.array.gradients);
    Ok((seen, gradients.chain(of_poses).copied().collect()))
}

fn is_finite(gaussians: &ActivatedGaussians, gradients: &[f32]) -> bool {
    let values = gaussians
        .positions
        .as_flattened()
        .iter()
        .chain(gaussians.scales.as_flattened())
        .chain(gaussians.rotations.as_flattened())
        .chain(&gaussians.opacities);
    values.chain(gradients).all(|value| value.is_finite())
}

/// Returns the largest distance between the centres of two sets of Gaussians.
fn apart(one: &ActivatedGaussians, other: &ActivatedGaussians) -> f32 {
    let pairs = one.positions.iter().zip(&other.positions);
    pairs
        .map(|(a, b)| Vec3::from_array(*a).distance(Vec3::from_array(*b)))
        .fold(0.0, f32::max)
}

fn judged(action: &str, fault: Option<String>) -> CaseResult {
    CaseResult {
        action: action.to_owned(),
        fault,
        measured: None,
    }
}

/// Judges distances of Gaussians from where they should be.
fn judged_by(action: &str, error: f64, is_finite: bool, limit: f64) -> CaseResult {
    if is_finite {
        CaseResult::of_errors(action, Some([error, limit]), None)
    } else {
        CaseResult::failed("a gradient is not finite")
    }
}

fn headings(device: &Device) -> Result<CaseResult, ReconstructError> {
    use std::f64::consts::{PI, TAU};
    let at = |headings: [f64; 2], seconds: f64| {
        let path = path(DVec3::ZERO, 2.0, headings);
        activated(device, vec![object(1, 1.0, &path, &AS_IS)], seconds)
    };
    // Halfway between pi - 0.1 and -pi + 0.1 is pi, and not 0.
    let (through, gradients) = at([PI - 0.1, 0.1 - PI], 1.0)?;
    let (straight, _) = at([PI, PI], 1.0)?;
    let (turned, _) = at([PI + 1e6 * TAU; 2], 1.0)?;
    let error = apart(&through, &straight).max(apart(&turned, &straight));
    Ok(judged_by(
        "headings go the short way round, also a million turns on",
        f64::from(error),
        is_finite(&through, &gradients),
        device.limit(3e-7),
    ))
}

fn boxes(device: &Device) -> Result<CaseResult, ReconstructError> {
    let path = path(DVec3::ZERO, 2.0, [0.3, 0.3]);
    let of = |size: f32| activated(device, vec![object(1, size, &path, &AS_IS)], 0.0);
    let (reference, _) = of(1.0)?;
    let (mut worst, mut all_finite) = (0.0_f32, true);
    for size in [1e-6_f32, 1e6] {
        let (found, gradients) = of(size)?;
        let pairs = found.positions.iter().zip(&reference.positions);
        let off = pairs.map(|(a, b)| (Vec3::from_array(*a) / size).distance(Vec3::from_array(*b)));
        worst = off.fold(worst, f32::max);
        all_finite &= is_finite(&found, &gradients);
    }
    Ok(judged_by(
        "the same object, larger or smaller; finite gradients",
        f64::from(worst),
        all_finite,
        device.limit(3e-7),
    ))
}

fn absent(device: &Device) -> Result<CaseResult, ReconstructError> {
    let long = path(DVec3::ZERO, 2.0, [0.0, 0.0]);
    let short = path(DVec3::ZERO, 0.0, [0.0, 0.0]);
    let mut faults = Vec::new();
    for (path, seconds, is_there) in [
        (&long, -1e-9, false),
        (&long, 0.0, true),
        (&long, 2.0, true),
        (&long, 1e9, false),
        (&short, 0.0, true),
        (&short, 1e-9, false),
    ] {
        let (found, gradients) = activated(device, vec![object(1, 1.0, path, &AS_IS)], seconds)?;
        let is_drawn = found.opacities.iter().any(|&opacity| opacity > 0.0);
        let is_still = gradients.iter().all(|&gradient| gradient == 0.0);
        if is_drawn != is_there || !is_finite(&found, &gradients) || (!is_there && !is_still) {
            faults.push(format!("at {seconds:e} s"));
        }
    }
    Ok(judged(
        "not drawn, and nothing is learnt of it",
        (!faults.is_empty()).then(|| faults.join("; ")),
    ))
}

fn crowd(device: &Device) -> Result<CaseResult, ReconstructError> {
    let path = path(DVec3::ZERO, 2.0, [0.0, 1.0]);
    let objects = (0..500)
        .map(|id| object(id, 1.0, &path, &AS_IS))
        .collect::<Vec<_>>();
    let one = activated(device, vec![objects[0].clone()], 1.0)?.0;
    let (all, gradients) = activated(device, objects, 1.0)?;
    let own = all.positions.iter().zip(one.positions.iter().cycle());
    let off = own.map(|(a, b)| Vec3::from_array(*a).distance(Vec3::from_array(*b)));
    Ok(judged_by(
        "each as if it were alone",
        f64::from(off.fold(0.0, f32::max)),
        is_finite(&all, &gradients),
        device.limit(1e-7),
    ))
}

fn far(device: &Device) -> Result<CaseResult, ReconstructError> {
    let offset = DVec3::new(691_000.0, 5_335_000.0, 520.0);
    let normalization = Similarity {
        offset: offset.to_array(),
        scale: 0.05,
    };
    let at = |begin: DVec3, normalization: &Similarity| {
        let path = path(begin, 2.0, [0.2, 0.4]);
        activated(device, vec![object(1, 0.2, &path, normalization)], 1.3)
    };
    let near = Similarity {
        offset: [0.0; 3],
        ..normalization
    };
    let (found, gradients) = at(offset, &normalization)?;
    Ok(judged_by(
        "paths are brought near in f64",
        f64::from(apart(&found, &at(DVec3::ZERO, &near)?.0)),
        is_finite(&found, &gradients),
        device.limit(3e-7),
    ))
}
