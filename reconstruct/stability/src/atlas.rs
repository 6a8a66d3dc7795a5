//! Cases of atlases: rays on planes, layers, splines, hash grids, and clips with little evidence.

mod clips;

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_engine::{
    fields::hash_grid::{HashGrid, HashGridShape},
    surfaces::{
        compose::{Layer, compose, compose_vjp, sort},
        plane::{Ray, hit, hit_vjp},
        sphere::{self, Sphere},
        view_angle::{view_angle, view_angle_vjp},
    },
    trajectories::{catmull_rom::Knots, rigid_spline::RigidPose, rotation_spline::rotation},
};

use self::clips::{clip_on, units};
use crate::{
    largest_or_nan,
    special::{CaseResult, HostOnly, Runs, SpecialCase},
};
use omnilife_atlas::shade::let_inwards;

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "plane-parallel",
        title: "planes that a ray runs along: cosines of 0, 1e-7, 1e-5 and 1e-3",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| {
            judge(
                "missed below 1e-6, else finite with a finite gradient",
                parallel,
            )
        },
    },
    SpecialCase {
        id: "plane-behind",
        title: "planes behind the camera and through it",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| judge("missed", behind),
    },
    SpecialCase {
        id: "plane-tilted",
        title: "a plane tilted by 80 degrees, hit within the box of its corners and beyond its edge",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| {
            judge(
                "missed: inside is tested in the plane's own coordinates",
                tilted,
            )
        },
    },
    SpecialCase {
        id: "plane-border",
        title: "hits on a plane's border and 1e-12 of its side beyond it",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| judge("hit on the border, missed beyond", border),
    },
    SpecialCase {
        id: "opaque-layers",
        title: "64 opaque layers, and opacities of 0, 1 - 1e-7 and exactly 1",
        runs: Runs::OnCpu(HostOnly::WithinSteps),
        judge: |_| {
            judge_error(
                "gradients by opacities, which have no division",
                1e-15,
                opaque,
            )
        },
    },
    SpecialCase {
        id: "equal-distances",
        title: "coplanar and intersecting planes",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| {
            judge(
                "order by the number of the surface, ray by ray",
                equal_distances,
            )
        },
    },
    SpecialCase {
        id: "sphere-grazing",
        title: "a camera close under the sphere of the background",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| judge_error("the distance keeps its digits", 8e-7, grazing),
    },
    SpecialCase {
        id: "view-angles",
        title: "planes seen at 0, 90 and 180 degrees",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| judge_error("the angles, and finite gradients", 1e-16, angles),
    },
    SpecialCase {
        id: "short-splines",
        title: "splines of 1, 2 and 3 knots, at their ends and beyond",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| judge_error("a constant velocity is kept", 5e-15, short_splines),
    },
    SpecialCase {
        id: "antipodal-rotations",
        title: "quaternions of either sign, no turn and half a turn between knots",
        runs: Runs::OnCpu(HostOnly::HostWork),
        judge: |_| {
            judge_error(
                "the sign means nothing; half a turn is finite",
                2e-15,
                antipodal,
            )
        },
    },
    SpecialCase {
        id: "hash-coordinates",
        title: "hash coordinates of 0, 1, outside, NaN and infinite",
        runs: Runs::OnCpu(HostOnly::WithinSteps),
        judge: |_| {
            judge(
                "clamped; what is no number gets nothing and gives nothing",
                coordinates,
            )
        },
    },
    SpecialCase {
        id: "hash-one-cell",
        title: "a million samples in one cell of a hash grid",
        runs: Runs::OnCpu(HostOnly::WithinSteps),
        judge: |_| judge_error("the gradient is the sum in f64", 1.9e-7, one_cell),
    },
    SpecialCase {
        id: "atlas-identical-frames",
        title: "an atlas of identical frames without parallax or noise",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-identical-frames", device.kind()),
    },
    SpecialCase {
        id: "atlas-odd-masks",
        title: "masks of one frame, of one pixel, of two pieces, at opposite borders and of everything",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-odd-masks", device.kind()),
    },
    SpecialCase {
        id: "atlas-wide-mask",
        title: "a panorama's mask on a pole, and one across the seam",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-wide-mask", device.kind()),
    },
    SpecialCase {
        id: "atlas-units",
        title: "a clip in units of 1e-6 and 1e6, and 1e6 from the origin",
        runs: Runs::OnBoth,
        judge: |device| {
            let limit = device.limit(1e-6);
            judge_error("the same images", limit, || units(device.kind()))
        },
    },
    SpecialCase {
        id: "atlas-64-objects",
        title: "64 objects of four pixels side by side",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-64-objects", device.kind()),
    },
    SpecialCase {
        id: "atlas-never-hit",
        title: "an object that no ray hits",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-never-hit", device.kind()),
    },
    SpecialCase {
        id: "atlas-flash",
        title: "a frame that is white, and one of twice the exposure",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-flash", device.kind()),
    },
    SpecialCase {
        id: "atlas-carried-along",
        title: "a mask that stands still in the image of a camera that turns, and of one that does not",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-carried-along", device.kind()),
    },
    SpecialCase {
        id: "atlas-turned-around",
        title: "a camera that turns by 30 and by 170 degrees",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-turned-around", device.kind()),
    },
    SpecialCase {
        id: "atlas-odd-points",
        title: "scene points at the camera, at one distance, and behind the background",
        runs: Runs::OnBoth,
        judge: |device| clip_on("atlas-odd-points", device.kind()),
    },
    SpecialCase {
        id: "clamped-colours",
        title: "colours at 0 and 1 and far beyond them",
        runs: Runs::OnCpu(HostOnly::WithinSteps),
        judge: |_| judge("gradients that point inwards pass, others are 0", clamped),
    },
];

/// Judges a case: it passes if its function finds no fault.
fn judge(action: &str, find: impl FnOnce() -> Result<(), String>) -> CaseResult {
    CaseResult {
        action: action.to_owned(),
        fault: find().err(),
        measured: None,
    }
}

/// Judges a case by the error that its function finds.
fn judge_error(action: &str, limit: f64, find: impl FnOnce() -> Result<f64, String>) -> CaseResult {
    match find() {
        Ok(error) => CaseResult::of_errors(action, Some([error, limit]), None),
        Err(reason) => CaseResult::failed(reason),
    }
}

fn check(holds: bool, what: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(what()) }
}

const FORWARD: Ray = Ray {
    origin: DVec3::ZERO,
    direction: DVec3::Z,
};

fn facing(centre: DVec3, turn: f64) -> RigidPose {
    RigidPose {
        centre,
        rotation: DMat3::from_rotation_y(turn),
    }
}

fn parallel() -> Result<(), String> {
    for cosine in [0.0, 1e-7, 1e-5, 1e-3] {
        let turn = std::f64::consts::FRAC_PI_2 - cosine;
        let pose = facing(DVec3::new(0.0, 0.0, 2.0), turn);
        let found = hit(&FORWARD, &pose, DVec2::ONE);
        if cosine < 1e-6 {
            check(found.is_none(), || format!("hit at a cosine of {cosine}"))?;
            continue;
        }
        let found = found.ok_or_else(|| format!("missed at a cosine of {cosine}"))?;
        let gradient = hit_vjp(&FORWARD, &pose, DVec2::ONE, &found, DVec2::ONE, DVec3::ONE);
        let by_centre = gradient.pose().centre;
        let is_bounded = by_centre.is_finite()
            && by_centre.length() < 10.0 / cosine
            && gradient.ray.direction.is_finite();
        check(is_bounded, || {
            format!("the gradient is not bounded at {cosine}")
        })?;
    }
    Ok(())
}

fn behind() -> Result<(), String> {
    for depth in [-2.0, -1e-7, 0.0] {
        let found = hit(&FORWARD, &facing(depth * DVec3::Z, 0.0), DVec2::ONE);
        check(found.is_none(), || format!("hit at {depth}"))?;
    }
    let found = hit(&FORWARD, &facing(1e-7 * DVec3::Z, 0.0), DVec2::ONE);
    check(found.is_some(), || "missed at 1e-7".to_owned())
}

fn tilted() -> Result<(), String> {
    let pose = facing(DVec3::new(0.3, 0.0, 2.0), 80_f64.to_radians());
    check(hit(&FORWARD, &pose, DVec2::ONE).is_none(), || {
        "hit".to_owned()
    })
}

fn border() -> Result<(), String> {
    let at = |x: f64| hit(&FORWARD, &facing(DVec3::new(x, 0.0, 2.0), 0.0), DVec2::ONE).is_some();
    check(at(0.5) && at(-0.5), || "missed on the border".to_owned())?;
    let beyond = 0.5 + 1e-12;
    check(!at(beyond) && !at(-beyond), || {
        "hit beyond the border".to_owned()
    })
}

fn layer(surface: usize, distance: f64, opacity: f64) -> Layer {
    Layer {
        distance,
        surface,
        colour: DVec3::new(0.1, 0.5, 0.9) * (1.0 - 0.01 * surface as f64),
        opacity,
    }
}

fn opaque() -> Result<f64, String> {
    let mut worst = 0.0;
    let upstream = DVec3::new(0.3, -0.5, 0.8);
    for opacities in [
        vec![1.0; 64],
        vec![0.0, 1.0 - 1e-7, 1.0, 0.5],
        vec![0.0; 16],
        vec![0.3, 1.0, 0.2, 1.0],
    ] {
        let layers: Vec<Layer> = opacities
            .iter()
            .enumerate()
            .map(|(at, &opacity)| layer(at, 1.0 + at as f64, opacity))
            .collect();
        let mut gradients = Vec::new();
        compose_vjp(&layers, upstream, &mut gradients);
        for (at, gradient) in gradients.iter().enumerate() {
            // The colour is linear in each opacity: any difference is the derivative.
            let with = |opacity: f64| {
                let mut layers = layers.clone();
                layers[at].opacity = opacity;
                upstream.dot(compose(&layers))
            };
            let expected = with(1.0) - with(0.0);
            worst = largest_or_nan(worst, (gradient.opacity - expected).abs());
        }
    }
    Ok(worst)
}

fn clamped() -> Result<(), String> {
    for (value, passes_up, passes_down) in [
        (-1e6, true, false),
        (-1e-7, true, false),
        (0.0, true, true),
        (1.0, true, true),
        (1.0 + 1e-7, false, true),
        (1e6, false, true),
    ] {
        // A step goes against the gradient.
        let up = let_inwards(DVec3::splat(value), -DVec3::ONE) == -DVec3::ONE;
        let down = let_inwards(DVec3::splat(value), DVec3::ONE) == DVec3::ONE;
        check([up, down] == [passes_up, passes_down], || {
            format!("{value}: up {up}, down {down}")
        })?;
    }
    Ok(())
}

fn equal_distances() -> Result<(), String> {
    let mut layers = vec![layer(2, 1.0, 0.5), layer(0, 1.0, 0.5), layer(1, 0.5, 0.5)];
    sort(&mut layers);
    let order: Vec<usize> = layers.iter().map(|layer| layer.surface).collect();
    check(order == [1, 0, 2], || format!("{order:?}"))?;
    // Two planes through each other: the nearer one changes from left to right.
    let [a, b] = [0.5, -0.5].map(|turn| facing(2.0 * DVec3::Z, turn));
    let is_nearer = |x: f64| {
        let ray = Ray {
            direction: DVec3::new(x, 0.0, 1.0).normalize(),
            ..FORWARD
        };
        let at = |pose| hit(&ray, pose, DVec2::splat(3.0)).map(|hit| hit.distance);
        at(&a) < at(&b)
    };
    check(is_nearer(0.2) != is_nearer(-0.2), || {
        "one order for all rays".to_owned()
    })
}

fn grazing() -> Result<f64, String> {
    let mut worst = 0.0;
    let sphere = Sphere {
        centre: DVec3::ZERO,
        radius: 3.0,
    };
    for gap in [1e-3, 1e-6, 1e-9] {
        let ray = Ray {
            origin: (3.0 - gap) * DVec3::X,
            direction: DVec3::X,
        };
        let found = sphere::hit(&ray, &sphere).ok_or("missed")?;
        worst = largest_or_nan(worst, (found.distance / gap - 1.0).abs());
    }
    Ok(worst)
}

fn angles() -> Result<f64, String> {
    let mut worst = 0.0;
    let tiny = 1e-9;
    for direction in [
        DVec3::Z,
        -DVec3::Z,
        DVec3::X,
        DVec3::new(tiny, tiny, 1.0),
        DVec3::new(tiny, -tiny, -1.0),
        DVec3::new(1e-6, 1e-6, -1.0).normalize(),
    ] {
        let angle = view_angle(direction);
        let gradient = view_angle_vjp(direction, DVec2::new(0.6, -0.8));
        let is_sound = angle.length() <= std::f64::consts::PI + 1e-12 && gradient.is_finite();
        check(is_sound, || format!("{direction}: {angle}, {gradient}"))?;
    }
    for expected in [1e-3_f64, 0.7, std::f64::consts::FRAC_PI_2, 3.1] {
        let found = view_angle(DVec3::new(expected.sin(), 0.0, expected.cos())).length();
        worst = largest_or_nan(worst, (found - expected).abs());
    }
    Ok(worst)
}

fn short_splines() -> Result<f64, String> {
    let mut worst = 0.0;
    let velocity = DVec3::new(1.0, -2.0, 3.0);
    for count in [2, 3] {
        let knots = Knots::unit(count);
        let line: Vec<DVec3> = (0..count).map(|knot| knots.time(knot) * velocity).collect();
        for time in [-0.1, 0.0, 0.3, 1.0, 1.1] {
            let off = knots.position(&line, time) - time * velocity;
            worst = largest_or_nan(worst, off.length());
        }
    }
    let one = Knots::unit(1).position(&[velocity], 7.0);
    check(one == velocity, || "one knot must be a constant".to_owned())?;
    // Knots that coincide.
    let same = Knots::unit(4).position(&[velocity; 4], 0.4);
    Ok(largest_or_nan(worst, (same - velocity).length()))
}

fn antipodal() -> Result<f64, String> {
    let mut worst = 0.0;
    let turn = DQuat::from_rotation_y(0.4);
    let knots = Knots::unit(3);
    let plain = [DQuat::IDENTITY, turn, turn * turn];
    let signed = [DQuat::IDENTITY, -turn, turn * turn];
    let half = [
        DQuat::IDENTITY,
        DQuat::from_xyzw(1.0, 0.0, 0.0, 0.0),
        DQuat::IDENTITY,
    ];
    for step in 0..=10 {
        let time = f64::from(step) / 10.0;
        let dot = rotation(&knots, &plain, time).dot(rotation(&knots, &signed, time));
        worst = largest_or_nan(worst, (dot.abs() - 1.0).abs());
        let found = rotation(&knots, &half, time);
        let is_sound = found.is_finite() && (found.length() - 1.0).abs() < 1e-9;
        check(is_sound, || format!("half a turn at {time}: {found}"))?;
    }
    Ok(worst)
}

fn coordinates() -> Result<(), String> {
    let grid = HashGrid::new(HashGridShape::new(2, 8, 13));
    let table: Vec<f32> = (0..grid.parameter_count())
        .map(|at| (at as f32 * 0.37).sin())
        .collect();
    let features = |position: [f32; 2]| {
        let mut out = vec![f32::NAN; grid.features()];
        grid.encode(&position, &table, usize::MAX, &mut out);
        out
    };
    let is_clamped = features([-0.0, 1.0]) == features([-7.0, 1e30]);
    check(is_clamped, || "outside is not the border".to_owned())?;
    let upstream = vec![1.0; grid.features()];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut gradients = vec![1.0; grid.parameter_count()];
        grid.backward_table(&[bad, 0.5], usize::MAX, &upstream, &mut gradients);
        let is_nothing = features([bad, 0.5])
            .iter()
            .chain(&gradients)
            .all(|&v| v == 0.0);
        check(is_nothing, || format!("{bad} reaches the table"))?;
    }
    Ok(())
}

fn one_cell() -> Result<f64, String> {
    let grid = HashGrid::new(HashGridShape::new(2, 1, 8));
    const ROWS: usize = 1_000_000;
    let upstream: Vec<f32> = (0..4 * ROWS)
        .map(|at| 1e-3 + (at % 7) as f32 * 1e-4)
        .collect();
    let mut gradients = vec![0.0; grid.parameter_count()];
    grid.backward_table(
        &[0.3, 0.6].repeat(ROWS),
        usize::MAX,
        &upstream,
        &mut gradients,
    );
    let found: f64 = gradients.iter().map(|&value| f64::from(value)).sum();
    let expected: f64 = upstream.iter().map(|&value| f64::from(value)).sum();
    Ok((found / expected - 1.0).abs())
}
