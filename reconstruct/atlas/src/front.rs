//! Static things without a mask that hide objects: poles, trees, walls.
//!
//! A plane that moves as its object's texture covers places where the mask has a hole. Where the hole stays at the same
//! place of the background while the object passes, a static thing is in front. It becomes a plane of its own before
//! the objects, with the background's colours, and the object keeps its whole outline behind it. The place on the
//! background is that of the thing only for a camera that hardly moves beside what it sees.

use glam::{DVec2, DVec3};
use omnilife_engine::{
    camera::Camera,
    surfaces::{
        plane::{Ray, hit},
        texture::{Texture, TextureEdge},
    },
    trajectories::rigid_spline::{RigidPose, RigidSpline},
};
use rayon::prelude::*;

use super::{
    clip::{Clip, ClipFrame, camera_direction, pixel_centre},
    graph::Graph,
    initialize::{grey_at, pixel_at, seen_at},
    node::{Fields, Node, Surface},
};

/// Component: static things without a mask before objects, and the name of their node.
pub const FRONT: &str = "front";

/// Texels of the background along a side of a cell.
const CELL: usize = 2;
/// Cells of a side, at most.
const MOST_CELLS: usize = 512;
/// Minimum number of frames with a hole at a cell.
const LEAST_HOLES: u32 = 3;
/// Minimum number of such frames for each frame that shows the object there.
const HOLES_OVER_SHOWN: u32 = 3;
/// Maximum standard deviation of grey values over the frames with a hole.
const MOST_VARIED: f64 = 0.08;
/// Minimum gain of overlap between objects and masks.
const LEAST_GAIN: f64 = 0.02;
/// Maximum displacement by the cameras' motion, pixels.
const MOST_PARALLAX: f64 = 2.0;
/// Distance of the plane, over that of the nearest object.
const BEFORE: f64 = 0.5;
/// Opacities beside the thing and on it.
const OPACITIES: [f32; 2] = [0.02, 0.9];

/// A static thing in front.
#[derive(Debug)]
pub struct Front {
    /// Its node, without fields.
    pub node: Node,
    /// Its mask in each frame.
    pub masks: Vec<Vec<u8>>,
    /// Evidence.
    pub reason: String,
}

/// Votes of the frames on a cell of the background.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Votes {
    /// Frames in which the object should be there and the mask has a hole.
    holes: u32,
    /// Frames in which the mask has it.
    shown: u32,
    /// Sums of the grey values of holes, and of their squares.
    sums: [f64; 2],
}

impl Votes {
    fn is_front(&self) -> bool {
        let count = f64::from(self.holes);
        let [sum, squares] = self.sums;
        self.holes >= LEAST_HOLES
            && self.holes >= HOLES_OVER_SHOWN * self.shown
            && (squares / count - (sum / count).powi(2)).max(0.0).sqrt() <= MOST_VARIED
    }
}

/// The background's rectangle with a grid of cells.
struct Cells {
    pose: RigidPose,
    size: DVec2,
    width: usize,
    height: usize,
}

impl Cells {
    fn point(&self, cell: usize) -> DVec3 {
        let at = DVec2::new((cell % self.width) as f64, (cell / self.width) as f64);
        let uv = (at + 0.5) / DVec2::new(self.width as f64, self.height as f64);
        self.pose.centre + self.pose.rotation * ((uv - 0.5) * self.size).extend(0.0)
    }

    fn cell(&self, ray: &Ray) -> Option<usize> {
        let uv = hit(ray, &self.pose, self.size)?.uv;
        let column = ((uv.x * self.width as f64) as usize).min(self.width - 1);
        let row = ((uv.y * self.height as f64) as usize).min(self.height - 1);
        Some(row * self.width + column)
    }

    /// Leaves out marks without a marked square of three cells around them or beside them: edges of masks are thin.
    fn opened(&self, marks: &[bool]) -> Vec<bool> {
        let all = |marks: &[bool], wanted: bool, cell: usize| {
            let (column, row) = (cell % self.width, cell / self.width);
            (row.saturating_sub(1)..=(row + 1).min(self.height - 1)).all(|row| {
                (column.saturating_sub(1)..=(column + 1).min(self.width - 1))
                    .all(|column| marks[row * self.width + column] == wanted)
            })
        };
        let cells = 0..marks.len();
        let eroded: Vec<bool> = cells.clone().map(|cell| all(marks, true, cell)).collect();
        cells.map(|cell| !all(&eroded, false, cell)).collect()
    }
}

/// Objects of a graph in one frame.
struct FrameObjects<'a> {
    clip: &'a Clip,
    frame: &'a ClipFrame,
    /// Poses of the objects' planes, `None` where they are not there.
    poses: Vec<Option<RigidPose>>,
    nodes: &'a [Node],
    /// Number of objects that cover at least half of each pixel.
    covering: Vec<u32>,
}

impl<'a> FrameObjects<'a> {
    fn new(clip: &'a Clip, frame: &'a ClipFrame, nodes: &'a [Node]) -> Self {
        let poses = nodes.iter().map(|node| {
            node.is_there(frame.time)
                .then(|| node.given_pose(frame.time))
        });
        let covering = (0..clip.pixel_count()).map(|pixel| {
            let objects = 0..nodes.len();
            let covering = objects.filter(|&object| frame.covered(object, pixel) >= 0.5);
            covering.count() as u32
        });
        Self {
            clip,
            frame,
            poses: poses.collect(),
            nodes,
            covering: covering.collect(),
        }
    }

    /// Returns true if a ray meets an opaque part of an object.
    fn is_opaque(&self, object: usize, ray: &Ray) -> bool {
        let node = &self.nodes[object];
        let (Surface::Plane { size, .. }, Some(pose), Some(opacity)) =
            (&node.surface, &self.poses[object], &node.opacity)
        else {
            return false;
        };
        hit(ray, pose, *size)
            .is_some_and(|hit| opacity.sample(hit.uv, TextureEdge::Border).value[0] > 0.5)
    }

    /// Returns true if the mask of another object covers a pixel, or it is not of the scene.
    fn is_hidden(&self, object: usize, pixel: usize) -> bool {
        let own = u32::from(self.frame.covered(object, pixel) >= 0.5);
        !self.frame.shows_scene(pixel) || self.covering[pixel] > own
    }

    /// Adds the frame's vote on a point of the background.
    fn vote(&self, point: DVec3, votes: &mut Votes) {
        let Some(at) = seen_at(self.clip, self.frame, point) else {
            return;
        };
        let pixel = pixel_at(self.clip, at);
        let ray = Ray {
            origin: self.frame.pose.centre,
            direction: (point - self.frame.pose.centre).normalize_or(DVec3::Z),
        };
        for object in 0..self.nodes.len() {
            if !self.is_opaque(object, &ray) || self.is_hidden(object, pixel) {
                continue;
            }
            if self.frame.covered(object, pixel) >= 0.5 {
                votes.shown += 1;
            } else {
                let grey = grey_at(self.clip, self.frame, at);
                votes.holes += 1;
                votes.sums[0] += grey;
                votes.sums[1] += grey * grey;
            }
        }
    }

    fn ray(&self, pixel: usize) -> Ray {
        let [width, _] = self.clip.size();
        let direction = camera_direction(&self.clip.camera, pixel_centre(pixel, width));
        Ray {
            origin: self.frame.pose.centre,
            direction: self.frame.pose.rotation * direction,
        }
    }

    /// Returns the mask of marked cells: pixels that no object's mask covers.
    fn mask(&self, cells: &Cells, marks: &[bool]) -> Vec<u8> {
        let marked = (0..self.clip.pixel_count()).map(|pixel| {
            let is_open = self.frame.shows_scene(pixel) && !self.frame.is_covered(pixel);
            let is_front = is_open && cells.cell(&self.ray(pixel)).is_some_and(|cell| marks[cell]);
            if is_front { 255 } else { 0 }
        });
        marked.collect()
    }

    /// Returns an object's overlap with its mask, without and with a thing in front; `None` where it has no mask.
    fn overlaps(&self, object: usize, front: &[u8]) -> Option<[f64; 2]> {
        let (mut both, mut either) = (0.0, [0.0; 2]);
        let mut has_mask = false;
        for (pixel, &front) in front.iter().enumerate() {
            if self.is_hidden(object, pixel) {
                continue;
            }
            let is_masked = self.frame.covered(object, pixel) >= 0.5;
            let is_opaque = self.is_opaque(object, &self.ray(pixel));
            has_mask |= is_masked;
            both += f64::from(u8::from(is_masked && is_opaque));
            either[0] += f64::from(u8::from(is_masked || is_opaque));
            either[1] += f64::from(u8::from(is_masked || is_opaque && front == 0));
        }
        has_mask.then(|| either.map(|either| both / f64::max(either, 1.0)))
    }
}

/// Looks for static things before the objects of a graph, whose masks are those of the clip in the same order.
///
/// # Errors
/// The reason where nothing stands in front, or it has no place.
pub fn find(clip: &Clip, graph: &Graph) -> Result<Front, String> {
    let (background, objects) = graph
        .nodes
        .split_last()
        .ok_or("the graph must have a background, got no node")?;
    if objects.is_empty() {
        return Err("the graph must have an object, got the background alone".to_owned());
    }
    if objects.iter().any(|node| node.id == FRONT) {
        return Err(format!("an object is named {FRONT}"));
    }
    let Surface::Plane { size, trajectory } = &background.surface else {
        return Err("looked for before planes alone, and the background is a sphere".to_owned());
    };
    let pose = trajectory.pose(0.0);
    let near = nearness(clip, objects, &pose)?;
    let cells = Cells {
        pose,
        size: *size,
        width: (background.colour.width / CELL).clamp(1, MOST_CELLS),
        height: (background.colour.height / CELL).clamp(1, MOST_CELLS),
    };
    let frames: Vec<FrameObjects<'_>> = clip
        .frames
        .par_iter()
        .map(|frame| FrameObjects::new(clip, frame, objects))
        .collect();
    let marks: Vec<bool> = (0..cells.width * cells.height)
        .into_par_iter()
        .map(|cell| {
            let mut votes = Votes::default();
            for frame in &frames {
                frame.vote(cells.point(cell), &mut votes);
            }
            votes.is_front()
        })
        .collect();
    let marks = cells.opened(&marks);
    if !marks.contains(&true) {
        return Err("masks have no holes that stay where they are".to_owned());
    }
    let masks: Vec<Vec<u8>> = frames
        .par_iter()
        .map(|frame| frame.mask(&cells, &marks))
        .collect();
    let overlaps: Vec<[f64; 2]> = frames
        .par_iter()
        .zip(&masks)
        .flat_map_iter(|(frame, mask)| {
            (0..objects.len()).filter_map(move |object| frame.overlaps(object, mask))
        })
        .collect();
    let mean = |which: usize| {
        let sum: f64 = overlaps.iter().map(|overlap| overlap[which]).sum();
        sum / overlaps.len().max(1) as f64
    };
    let [before, after] = [0, 1].map(mean);
    let evidence =
        format!("objects and masks overlap by {after:.3} behind it, by {before:.3} without it");
    if after < before + LEAST_GAIN {
        return Err(evidence);
    }
    Ok(Front {
        node: node(clip, background, &cells, &marks, near),
        masks,
        reason: format!("masks have holes that stay where they are: {evidence}"),
    })
}

/// Returns the distance of a plane before all objects, over that of the background.
///
/// # Errors
/// An object at or behind the cameras, or a motion that displaces the plane against what it shows.
fn nearness(clip: &Clip, objects: &[Node], background: &RigidPose) -> Result<f64, String> {
    let mean = mean_camera(clip);
    let normal = background.rotation.col(2);
    let far = normal.dot(background.centre - mean);
    let places = objects.iter().flat_map(|node| {
        let frames = clip.frames.iter();
        let frames = frames.filter(move |frame| node.is_there(frame.time));
        frames.map(move |frame| normal.dot(node.given_pose(frame.time).centre - mean) / far)
    });
    let near = BEFORE * places.fold(1.0, f64::min);
    if near <= 0.0 {
        return Err(
            "an object's plane is at or behind the cameras: no place before the objects".to_owned(),
        );
    }
    let focal = match clip.camera {
        Camera::Pinhole(camera) => camera.fx,
        Camera::Erp(camera) => f64::from(camera.width) / std::f64::consts::TAU,
    };
    let baseline = clip
        .frames
        .iter()
        .map(|frame| frame.pose.centre.distance(mean))
        .fold(0.0, f64::max);
    let parallax = focal * baseline * (1.0 / near - 1.0) / far;
    if parallax <= MOST_PARALLAX {
        Ok(near)
    } else {
        Err(format!(
            "the cameras move by {parallax:.1} pixels against the background: no place before the objects"
        ))
    }
}

fn mean_camera(clip: &Clip) -> DVec3 {
    let count = clip.frames.len().max(1) as f64;
    clip.frames.iter().map(|f| f.pose.centre).sum::<DVec3>() / count
}

/// Returns the node of marked cells, `near` of the way from the mean camera to the background.
fn node(clip: &Clip, background: &Node, cells: &Cells, marks: &[bool], near: f64) -> Node {
    let mean = mean_camera(clip);
    let [beside, on] = OPACITIES;
    Node {
        id: FRONT.to_owned(),
        surface: Surface::Plane {
            size: near * cells.size,
            trajectory: RigidSpline {
                positions: vec![mean + near * (cells.pose.centre - mean)],
                rotations: vec![glam::DQuat::from_mat3(&cells.pose.rotation)],
            },
        },
        colour: background.colour.clone(),
        opacity: Some(Texture {
            width: cells.width,
            height: cells.height,
            texels: marks
                .iter()
                .map(|&mark| [if mark { on } else { beside }])
                .collect(),
        }),
        fields: Fields::default(),
        offsets: None,
        times: [f64::MIN, f64::MAX],
        delay: 0.0,
        overlay: None,
    }
}

/// Puts a thing in front into a graph, behind the objects in the order of nodes, with its masks.
pub fn add(clip: &mut Clip, graph: &mut Graph, front: Front) {
    let last = graph.nodes.len().saturating_sub(1);
    graph.nodes.insert(last, front.node);
    clip.objects.push(FRONT.to_owned());
    for (frame, mask) in clip.frames.iter_mut().zip(front.masks) {
        frame.masks.push(mask.contains(&255).then_some(mask));
    }
}

#[cfg(test)]
mod tests;
