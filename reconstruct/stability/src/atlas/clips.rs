//! Clips with little evidence for atlases: no motion, odd masks, extreme units.

use glam::{DMat3, DVec3};
use omnilife_engine::{schedule::Position, trajectories::rigid_spline::RigidPose};
use omnilife_schemas::camera::{Camera, ErpCamera, PinholeCamera};

use super::{check, judge};
use crate::{devices::DeviceKind, largest_or_nan, special::CaseResult};
use omnilife_atlas::{
    AtlasStart, METHOD, begin,
    clip::{Clip, ClipFrame, UnitClock},
    graph::Graph,
    node::FieldKind,
};
use omnilife_training::{learner::Learner, options::Options, request::MethodRequest};

const SIDE: usize = 24;

/// Clips that are trained on both backends: the case, its action, and its function.
type ClipCase = (
    &'static str,
    &'static str,
    fn(DeviceKind) -> Result<(), String>,
);

const CLIPS: &[ClipCase] = &[
    (
        "atlas-identical-frames",
        "fields are left out; the camera stays",
        identical_frames,
    ),
    (
        "atlas-odd-masks",
        "a node, or a reason in the plan; parameters stay finite",
        odd_masks,
    ),
    (
        "atlas-wide-mask",
        "no plane on a pole; one plane across the seam",
        wide_masks,
    ),
    (
        "atlas-64-objects",
        "a node for each; parameters stay finite",
        many_objects,
    ),
    (
        "atlas-never-hit",
        "its parameters stay as they are",
        never_hit,
    ),
    ("atlas-flash", "parameters stay finite", flash),
    (
        "atlas-carried-along",
        "no plane, and a plane",
        carried_along,
    ),
    (
        "atlas-turned-around",
        "a plane, and a sphere as background",
        turned_around,
    ),
    (
        "atlas-odd-points",
        "distances within those of camera and background",
        odd_points,
    ),
];

pub(super) fn clip_on(id: &str, kind: DeviceKind) -> CaseResult {
    CLIPS.iter().find(|(case, ..)| *case == id).map_or_else(
        || CaseResult::failed(format!("no clip is {id}")),
        |(_, action, find)| judge(action, || find(kind)),
    )
}

/// Makes frames of one pattern, with the masks of one object.
fn clip(camera: Camera, unit: f64, origin: DVec3, masks: &[Option<Vec<u8>>]) -> Clip {
    let masks: Vec<_> = masks.iter().map(|mask| vec![mask.clone()]).collect();
    clip_of_objects(camera, unit, origin, &masks)
}

/// Makes frames of one pattern, with masks of several objects in each.
fn clip_of_objects(
    camera: Camera,
    unit: f64,
    origin: DVec3,
    masks: &[Vec<Option<Vec<u8>>>],
) -> Clip {
    let [width, height] = [camera.width() as usize, camera.height() as usize];
    let count = masks.len().max(2);
    let pixels: Vec<u8> = (0..3 * width * height)
        .map(|at| (128.0 + 90.0 * (at as f64 * 0.21).sin()) as u8)
        .collect();
    let frame = |number: usize| ClipFrame {
        number: number as u32,
        time: number as f64 / (count - 1) as f64,
        pose: RigidPose {
            centre: origin + unit * 0.1 * number as f64 * DVec3::X,
            rotation: DMat3::IDENTITY,
        },
        pixels: pixels.clone(),
        ignored: None,
        masks: masks.get(number).cloned().unwrap_or_default(),
    };
    let objects = masks.first().map_or(0, Vec::len);
    Clip {
        camera,
        frames: (0..count).map(frame).collect(),
        objects: match objects {
            1 => vec!["it".to_owned()],
            _ => (0..objects).map(|object| format!("{object:02}")).collect(),
        },
        clock: UnitClock {
            begin_seconds: 0.0,
            length_seconds: 1.0,
        },
        warnings: Vec::new(),
    }
}

fn small_pinhole() -> Camera {
    PinholeCamera::with_horizontal_field_of_view(SIDE as u32, SIDE as u32, 1.0).into()
}

/// Rays of a step on a GPU, which may be a program on a CPU.
const RAYS_ON_GPU: &str = "rays=256";

/// Begins eight steps on a clip.
fn begin_on(kind: DeviceKind, clip: Clip, points: &[DVec3]) -> Result<AtlasStart, String> {
    let mut request = MethodRequest::new(8, 0);
    if kind == DeviceKind::Gpu {
        let rays = [RAYS_ON_GPU.to_owned()];
        let options = Options::parse(METHOD.id, METHOD.options, &rays);
        request.options = options.map_err(|error| error.to_string())?;
    }
    let mut begun = begin(clip, points, &request).map_err(|error| error.to_string())?;
    if kind == DeviceKind::Gpu {
        let moved = begun.learner.move_to_gpu();
        moved.map_err(|error| error.to_string())?;
    }
    Ok(begun)
}

/// Returns the atlas of a run.
fn graph_of(begun: &mut AtlasStart) -> Result<&mut Graph, String> {
    begun.learner.graph().map_err(|error| error.to_string())
}

/// Trains a clip for a few steps of all phases.
fn learn(kind: DeviceKind, clip: Clip) -> Result<AtlasStart, String> {
    learn_with_points(kind, clip, &[])
}

fn learn_with_points(kind: DeviceKind, clip: Clip, points: &[DVec3]) -> Result<AtlasStart, String> {
    let mut begun = begin_on(kind, clip, points)?;
    for step in 1..=8 {
        let at = Position::new(8, None, step, 0.0);
        let taken = begun.learner.step(0, &at);
        taken.map_err(|error| error.to_string())?;
    }
    let bad = graph_of(&mut begun)?.not_finite();
    match bad {
        Some(what) => Err(what),
        None => Ok(begun),
    }
}

fn identical_frames(kind: DeviceKind) -> Result<(), String> {
    let mut still = clip(small_pinhole(), 0.0, DVec3::ZERO, &[]);
    for frame in &mut still.frames {
        frame.pixels.fill(128);
    }
    let begun = learn(kind, still)?;
    let used = begun.plan.iter().find(|line| {
        line.used
            && ["flow", "view", "camera-offsets"]
                .iter()
                .any(|c| line.component.starts_with(c))
    });
    check(used.is_none(), || format!("{used:?}"))
}

fn mask(is_inside: impl Fn(usize, usize) -> bool) -> Option<Vec<u8>> {
    let at = |pixel: usize| is_inside(pixel % SIDE, pixel / SIDE);
    Some(
        (0..SIDE * SIDE)
            .map(|pixel| 255 * u8::from(at(pixel)))
            .collect(),
    )
}

fn odd_masks(kind: DeviceKind) -> Result<(), String> {
    let block = |x: usize, y: usize| (8..16).contains(&x) && (8..16).contains(&y);
    for masks in [
        vec![None, mask(block), None],
        vec![mask(|x, y| x == 12 && y == 12), None, None],
        vec![mask(|x, y| x % 12 < 5 && (8..16).contains(&y)); 3],
        vec![mask(|_, y| (8..16).contains(&y)); 3],
        vec![mask(|x, y| x == 0 || y == 0 || x + 1 == SIDE || y + 1 == SIDE); 3],
        vec![mask(|_, _| true), mask(block), mask(block)],
    ] {
        learn(kind, clip(small_pinhole(), 1.0, DVec3::ZERO, &masks))?;
    }
    let empty = learn(kind, clip(small_pinhole(), 1.0, DVec3::ZERO, &[None, None]))?;
    let line = empty.plan.iter().find(|line| line.component == "object:it");
    check(line.is_some_and(|line| !line.used), || format!("{line:?}"))?;
    let all = vec![mask(|_, _| true); 3];
    let refused = learn(kind, clip(small_pinhole(), 1.0, DVec3::ZERO, &all)).err();
    check(
        refused.is_some_and(|reason| reason.contains("must leave the background visible")),
        || "masks of everything leave a background".to_owned(),
    )
}

fn wide_masks(kind: DeviceKind) -> Result<(), String> {
    let (width, height) = (2 * SIDE, SIDE);
    let camera = Camera::Erp(ErpCamera {
        width: width as u32,
        height: height as u32,
    });
    let mask = |is_inside: &dyn Fn(usize, usize) -> bool| {
        let at = |pixel: usize| is_inside(pixel % width, pixel / width);
        Some(
            (0..width * height)
                .map(|pixel| 255 * u8::from(at(pixel)))
                .collect(),
        )
    };
    let around = vec![mask(&|_, y| y > 18); 3];
    let across = vec![mask(&|x, y| (x + 3) % width < 6 && (8..14).contains(&y)); 3];
    for (masks, expected) in [(around, false), (across, true)] {
        let begun = learn(kind, clip(camera, 1.0, DVec3::ZERO, &masks))?;
        let line = begun.plan.iter().find(|line| line.component == "object:it");
        check(line.is_some_and(|line| line.used == expected), || {
            format!("{line:?}")
        })?;
    }
    Ok(())
}

/// Judges a pattern of 8 by 8 objects, of which one is behind the camera from the second frame on.
fn many_objects(kind: DeviceKind) -> Result<(), String> {
    let cell = |object: usize| {
        let (left, top) = (3 * (object % 8), 3 * (object / 8));
        mask(|x, y| (left..left + 2).contains(&x) && (top..top + 2).contains(&y))
    };
    let all: Vec<_> = (0..64).map(cell).collect();
    let clip = clip_of_objects(small_pinhole(), 1.0, DVec3::ZERO, &vec![all; 3]);
    let begun = learn(kind, clip)?;
    let nodes = begun.plan.iter().filter(|line| line.used);
    let nodes = nodes
        .filter(|line| line.component.starts_with("object:"))
        .count();
    check(nodes == 64, || format!("{nodes} nodes of 64"))
}

/// Checks that poses and fields of nodes without hits stay as they are.
fn never_hit(kind: DeviceKind) -> Result<(), String> {
    let corner = vec![mask(|x, y| x < 2 && y < 2); 3];
    let clip = clip(small_pinhole(), 1.0, DVec3::ZERO, &corner);
    let mut begun = begin_on(kind, clip, &[])?;
    // Out of sight for the whole clip.
    let node = &mut graph_of(&mut begun)?.nodes[0];
    node.times = [7.0, 8.0];
    let values = |begun: &mut AtlasStart| -> Result<Vec<f32>, String> {
        let node = &graph_of(begun)?.nodes[0];
        let fields = FieldKind::ALL
            .iter()
            .filter_map(|&kind| node.fields.get(kind));
        let mut values: Vec<f32> = fields
            .flat_map(|field| field.arrays().map(|array| array.values.clone()))
            .flatten()
            .collect();
        let offsets = node.offsets.iter();
        values.extend(offsets.flat_map(|offsets| offsets.parameters.array.values.clone()));
        Ok(values)
    };
    let before = values(&mut begun)?;
    for step in 1..=8 {
        let taken = begun.learner.step(0, &Position::new(8, None, step, 0.0));
        taken.map_err(|error| error.to_string())?;
    }
    let after = values(&mut begun)?;
    check(before == after, || "it was changed".to_owned())
}

/// Judges a clip with one white frame, and another frame with twice the exposure.
fn flash(kind: DeviceKind) -> Result<(), String> {
    let mut flashed = clip(small_pinhole(), 1.0, DVec3::ZERO, &vec![None; 6]);
    flashed.frames[2].pixels.fill(255);
    for value in &mut flashed.frames[4].pixels {
        *value = value.saturating_mul(2);
    }
    learn(kind, flashed).map(|_| ())
}

/// Judges the bonnet of a rotating car, and the same mask before a still camera.
fn carried_along(kind: DeviceKind) -> Result<(), String> {
    let bonnet = vec![mask(|x, y| (6..18).contains(&x) && y > 19); 5];
    for (turns, is_used) in [(true, false), (false, true)] {
        let mut clip = clip(small_pinhole(), 0.1, DVec3::ZERO, &bonnet);
        for frame in &mut clip.frames {
            let angle = if turns { 2.0 * frame.time } else { 0.0 };
            frame.pose.rotation = DMat3::from_rotation_y(angle);
        }
        let begun = learn(kind, clip)?;
        let line = begun.plan.iter().find(|line| line.component == "object:it");
        check(line.is_some_and(|line| line.used == is_used), || {
            format!("{line:?}")
        })?;
    }
    Ok(())
}

/// Judges a camera that rotates beyond the extent of a plane.
fn turned_around(kind: DeviceKind) -> Result<(), String> {
    for (angle, surface) in [(0.5, "a plane"), (3.0, "a sphere")] {
        let mut turned = clip(small_pinhole(), 0.1, DVec3::ZERO, &vec![None; 5]);
        for frame in &mut turned.frames {
            frame.pose.rotation = DMat3::from_rotation_y(angle * frame.time);
        }
        let begun = learn(kind, turned)?;
        let line = begun
            .plan
            .iter()
            .find(|line| line.component == "background");
        check(
            line.is_some_and(|line| line.reason.starts_with(surface)),
            || format!("{angle}: {line:?}"),
        )?;
    }
    Ok(())
}

/// Judges points at the camera, all at one distance, and behind the background.
fn odd_points(kind: DeviceKind) -> Result<(), String> {
    let block = vec![mask(|x, y| (8..16).contains(&x) && (8..16).contains(&y)); 3];
    for distance in [0.0, 1e-9, 1.0, 1e9] {
        let points = vec![distance * DVec3::Z; 50];
        let begun = learn_with_points(
            kind,
            clip(small_pinhole(), 0.1, DVec3::ZERO, &block),
            &points,
        )?;
        let line = begun.plan.iter().find(|line| line.component == "object:it");
        check(line.is_some_and(|line| line.used), || {
            format!("{distance}: {line:?}")
        })?;
    }
    Ok(())
}

/// Judges units: clips are normalized when they are loaded, so that the method's input is the same up to
/// rounding.
pub(super) fn units(kind: DeviceKind) -> Result<f64, String> {
    let image = |unit: f64, origin: DVec3| -> Result<Vec<f32>, String> {
        let clip = clip(small_pinhole(), unit, origin, &[]);
        let centres: Vec<DVec3> = clip.frames.iter().map(|frame| frame.pose.centre).collect();
        let similarity = omnilife_schemas::Similarity::from_cameras(&centres).ok_or("cameras")?;
        let mut clip = clip;
        for frame in &mut clip.frames {
            frame.pose.centre = similarity.normalize(frame.pose.centre);
        }
        let camera = clip.camera;
        let centre = clip.frames[0].pose.centre.as_vec3();
        let mut begun = learn(kind, clip)?;
        let view = omnilife_engine::camera::View {
            camera,
            rotation: glam::Mat3::IDENTITY,
            centre,
            time_seconds: 0.0,
        };
        Ok(begun
            .learner
            .image(&view)
            .map_err(|error| error.to_string())?
            .data)
    };
    let expected = image(1.0, DVec3::ZERO)?;
    let mut worst = 0.0;
    for (unit, origin) in [
        (1e-6, DVec3::ZERO),
        (1e6, DVec3::ZERO),
        (1.0, DVec3::splat(1e6)),
    ] {
        let found = image(unit, origin)?;
        let pairs = found.iter().zip(&expected);
        let errors = pairs.map(|(a, b)| f64::from((a - b).abs()));
        worst = errors.fold(worst, largest_or_nan);
    }
    Ok(worst)
}
