//! First nodes of a clip, with a line on the evidence of each.

use std::collections::BTreeMap;

use glam::DVec3;
use omnilife_schemas::{distances::DistanceImage, records::ComponentDecision};
use rayon::prelude::*;

use super::{
    background::{self, BACKGROUND, PlacedBackground},
    boxes::{BoxPath, TrackedBoxes, matched},
    in_frames::{self, InFrames},
    objects::{self, PlacementInputs, PlacementOutcome, background_behind},
    order,
    silhouettes::{self, Silhouette, plane_axes, reference},
};
use crate::{clip::Clip, graph::Graph};

/// Evidence beside the images and masks of a clip.
#[derive(Debug, Default)]
pub struct Evidence<'a> {
    /// Scene points, normalized.
    pub points: &'a [DVec3],
    /// Distances along the rays of frames, normalized, by the frame's number in the scene: given or estimated.
    pub distances: BTreeMap<u32, DistanceImage>,
    /// Boxes of moving objects.
    pub boxes: Option<TrackedBoxes<'a>>,
}

/// First nodes of a clip, with the outcome for each object.
#[derive(Debug)]
pub struct FirstNodes {
    /// Objects in the order of their names, the background last; no fields yet.
    pub graph: Graph,
    /// Numbers of the clip's objects that have a node.
    pub with_node: Vec<usize>,
    /// Distance of the background, normalized units.
    pub distance: f64,
    /// A line for each object and for the background.
    pub decisions: Vec<ComponentDecision>,
}

/// Returns the numbers in the scene of the frames in which objects are compared with distances.
pub fn reference_frames(clip: &Clip) -> Vec<u32> {
    let mut numbers: Vec<u32> = (0..clip.objects.len())
        .filter_map(|object| {
            let seen = silhouettes::of_object(clip, object);
            Some(clip.frames[reference(&seen)?.frame].number)
        })
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Returns the distance of each object in its reference frame along its plane's normal, with its source: from
/// distances in its mask, or else from scene points.
fn known_depths(
    clip: &Clip,
    seen: &[Vec<Silhouette>],
    evidence: &Evidence<'_>,
    backgrounds: &[f64],
) -> Vec<Option<(f64, String)>> {
    let of_object = |(object, seen): (usize, &Vec<Silhouette>)| {
        let background = backgrounds[object];
        let by_distances = objects::depth_of_distances(clip, seen, evidence, background)
            .map(|(depth, count)| (depth, format!("from {count} distances in its mask")));
        by_distances.or_else(|| {
            let found = objects::depth_of_points(clip, object, seen, evidence.points, background);
            found.map(|(depth, count)| (depth, format!("from {count} points in its mask")))
        })
    };
    seen.iter().enumerate().map(of_object).collect()
}

/// Replaces the distances of objects with boxes by those of their boxes.
fn with_boxes(
    clip: &Clip,
    seen: &[Vec<Silhouette>],
    boxes: &[Option<BoxPath>],
    known: &mut [Option<(f64, String)>],
) {
    for ((seen, path), known) in seen.iter().zip(boxes).zip(known) {
        let depth = reference(seen)
            .zip(path.as_ref())
            .and_then(|(reference, path)| {
                let frame = &clip.frames[reference.frame].pose;
                let centre = path.boxes[reference.frame]?.centre;
                let normal = plane_axes(&clip.camera, reference.direction).col(2);
                let depth = normal.dot(frame.rotation.transpose() * (centre - frame.centre));
                (depth > 0.0).then_some(depth)
            });
        if let Some(depth) = depth {
            *known = Some((depth, "that of its box".to_owned()));
        }
    }
}

/// Places the nodes of a clip, with trajectories of so many knots.
///
/// # Errors
/// When masks leave no background.
pub fn first_nodes(
    clip: &Clip,
    evidence: &Evidence<'_>,
    knots: usize,
) -> Result<FirstNodes, String> {
    let placed = background::place(clip, evidence.points);
    let seen: Vec<Vec<Silhouette>> = (0..clip.objects.len())
        .map(|object| silhouettes::of_object(clip, object))
        .collect();
    let boxes = match &evidence.boxes {
        Some(boxes) => matched(clip, &seen, boxes),
        None => vec![None; seen.len()],
    };
    // A box whose track does not reach the reference frame says nothing about the plane there.
    let boxes: Vec<Option<BoxPath>> = boxes
        .into_iter()
        .zip(&seen)
        .map(|(path, seen)| path.filter(|path| reaches(path, seen)))
        .collect();
    let (boxes, refused) = before_background(clip, &seen, boxes, &placed);
    let in_frames: Vec<InFrames> = seen
        .par_iter()
        .enumerate()
        .map(|(object, seen)| in_frames::of(clip, object, seen))
        .collect();
    let backgrounds: Vec<f64> = seen
        .iter()
        .map(|seen| background_behind(clip, seen, &placed))
        .collect();
    let mut known = known_depths(clip, &seen, evidence, &backgrounds);
    with_boxes(clip, &seen, &boxes, &mut known);
    let depths: Vec<Option<f64>> = known
        .iter()
        .map(|found| found.as_ref().map(|(depth, _)| *depth))
        .collect();
    let nearest = backgrounds.iter().copied().fold(placed.distance, f64::min);
    let setting = PlacementInputs {
        depths: &order::depths(clip, &seen, &in_frames, &depths, nearest),
        seen: &seen,
        in_frames: &in_frames,
        boxes: &boxes,
        known: &known,
        backgrounds: &backgrounds,
        knots,
    };
    let mut nodes = Vec::new();
    let mut with_node = Vec::new();
    let mut decisions = Vec::new();
    for (object, name) in clip.objects.iter().enumerate() {
        let (used, reason) = match objects::node(clip, object, &setting) {
            PlacementOutcome::Node(node, source) => {
                nodes.push(*node);
                with_node.push(object);
                let is_missed = evidence.boxes.is_some() && boxes[object].is_none();
                let missed = match &refused[object] {
                    Some(reason) => format!("{reason}; "),
                    None if is_missed => "no track's box is where its masks are; ".to_owned(),
                    None => String::new(),
                };
                (true, format!("it has a mask; {missed}{source}"))
            }
            PlacementOutcome::LeftOut(reason) => (false, reason),
        };
        decisions.push(ComponentDecision {
            component: format!("object:{name}"),
            used,
            reason,
        });
    }
    nodes.push(background::node(clip, &placed)?);
    decisions.push(ComponentDecision {
        component: BACKGROUND.to_owned(),
        used: true,
        reason: placed.reason.clone(),
    });
    Ok(FirstNodes {
        graph: Graph {
            nodes,
            camera: None,
            clock: clip.clock,
            footage: clip.footage(),
        },
        with_node,
        distance: placed.distance,
        decisions,
    })
}

/// Returns true if a track has a box in the reference frame of its object.
fn reaches(path: &BoxPath, seen: &[Silhouette]) -> bool {
    reference(seen).is_some_and(|reference| path.boxes[reference.frame].is_some())
}

/// Leaves out the boxes that [`behind_background`] speaks against, and returns its reasons.
fn before_background(
    clip: &Clip,
    seen: &[Vec<Silhouette>],
    boxes: Vec<Option<BoxPath>>,
    placed: &PlacedBackground,
) -> (Vec<Option<BoxPath>>, Vec<Option<String>>) {
    let judged = boxes.into_iter().zip(seen).map(|(path, seen)| {
        let refused = path
            .as_ref()
            .and_then(|path| behind_background(clip, path, seen, placed));
        (path.filter(|_| refused.is_none()), refused)
    });
    judged.unzip()
}

/// Returns the reason against a box: on the ray through its middle, in the reference frame of its object, it is not
/// before the background. A vehicle on the ground is hardly before it, so that no share of the distance is asked for.
fn behind_background(
    clip: &Clip,
    path: &BoxPath,
    seen: &[Silhouette],
    placed: &PlacedBackground,
) -> Option<String> {
    let reference = reference(seen)?;
    let camera = clip.frames[reference.frame].pose.centre;
    let to_box = path.boxes[reference.frame]?.centre - camera;
    let depth = to_box.length();
    let background = placed.along(camera, to_box.try_normalize()?)?;
    (depth >= background).then(|| {
        let id = path.track;
        format!("track {id}'s box is behind the background ({depth:.2} of {background:.2})")
    })
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use omnilife_engine::trajectories::rigid_spline::RigidPose;
    use omnilife_schemas::{camera::PinholeCamera, oriented_box::OrientedBox};

    use super::*;
    use crate::{
        clip::{ClipFrame, UnitClock},
        node::Surface,
    };

    /// Returns a camera with an object in the middle of its image.
    fn clip() -> Clip {
        let frame = ClipFrame {
            number: 0,
            time: 0.0,
            pose: RigidPose {
                centre: DVec3::X,
                rotation: DMat3::IDENTITY,
            },
            pixels: vec![0; 3 * 16],
            masks: vec![Some(
                (0..16).map(|at| if at == 5 { 255 } else { 0 }).collect(),
            )],
            ignored: None,
        };
        Clip {
            camera: PinholeCamera {
                width: 4,
                height: 4,
                fx: 4.0,
                fy: 4.0,
                cx: 2.0,
                cy: 2.0,
            }
            .into(),
            frames: vec![frame],
            objects: vec!["car".to_owned()],
            clock: UnitClock {
                begin_seconds: 0.0,
                length_seconds: 1.0,
            },
            warnings: Vec::new(),
        }
    }

    #[test]
    fn a_box_behind_the_background_is_left_out() {
        let clip = clip();
        let placed = PlacedBackground {
            surface: Surface::Sphere {
                centre: DVec3::X,
                radius: 4.0,
            },
            texels: [8, 4],
            distance: 4.0,
            reason: String::new(),
        };
        let seen = [silhouettes::of_object(&clip, 0)];
        let judged = |depth: f64| {
            let at = OrientedBox {
                centre: DVec3::new(1.0, 0.0, depth),
                axes: DMat3::IDENTITY,
                half: DVec3::ONE,
            };
            let path = BoxPath {
                track: 7,
                boxes: vec![Some(at)],
                reason: String::new(),
            };
            before_background(&clip, &seen, vec![Some(path)], &placed)
        };
        let (kept, refused) = judged(3.9);
        assert!(kept[0].is_some() && refused[0].is_none(), "{refused:?}");
        for depth in [4.0, 5.5] {
            let (kept, refused) = judged(depth);
            let reason = refused[0].as_deref().unwrap_or_default();
            assert!(kept[0].is_none(), "{depth}");
            assert!(
                reason.contains("track 7") && reason.contains("4.00"),
                "{reason}"
            );
        }
    }
}
