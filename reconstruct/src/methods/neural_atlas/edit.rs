//! Edits of an atlas, from a script:
//!
//! ```toml
//! [[edit]]
//! kind = "texture"            # what is painted replaces the node's colour, its view dependence included
//! node = "swan"
//! image = "painted.png"       # RGBA, beside the script
//! frame = 12                  # painted in this frame; without it, over the node's atlas
//!
//! [[edit]]
//! kind = "shift"              # also: remove, rotate (turn = [x, y, z] degrees), duplicate (new = "name"),
//! node = "swan"               # retime (frames = 5: that much later)
//! by = [0.2, 0.0, -0.1]       # x right, y down, z forward
//! unit = "distance"           # of the node from the camera; or "world"
//! axes = "camera"             # of the clip's first frame; or "world"
//! ```

use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_engine::{
    fields::grid_field::GridField, parameters::SharedParameters, surfaces::texture::Texture,
};
use omnilife_schemas::{
    image_file::ImageFile,
    records::RunRecord,
    store::{self, StoreError},
};
use serde::Deserialize;

use super::{
    clip::{camera_direction, pixel_centre},
    graph::Graph,
    node::{FieldKind, Fields, LearntOffsets, Node, Overlay, Surface},
    outputs,
    render::{Moment, Rays},
    saved,
    shade::Detail,
};
use crate::{error::ReconstructError, methods::run_formats::EditRequest};

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Script {
    edit: Vec<toml::Spanned<Edit>>,
}

#[derive(Debug, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
enum Edit {
    Texture {
        node: String,
        image: PathBuf,
        frame: Option<u32>,
    },
    Remove {
        node: String,
    },
    Shift {
        node: String,
        by: [f64; 3],
        #[serde(default)]
        unit: Unit,
        #[serde(default)]
        axes: Axes,
    },
    Rotate {
        node: String,
        turn: [f64; 3],
        #[serde(default)]
        axes: Axes,
    },
    Duplicate {
        node: String,
        new: String,
    },
    Retime {
        node: String,
        frames: i64,
    },
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Unit {
    /// The node's distance from the camera.
    #[default]
    Distance,
    /// Units of the scene's world.
    World,
}

#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Axes {
    /// Those of the camera in the clip's first frame.
    #[default]
    Camera,
    /// Those of the world.
    World,
}

/// Applies a script to a run's atlas and writes the edited one.
///
/// # Errors
/// When the script is malformed, names what is not there (with its line), or an image has no pixels.
pub fn edit(request: &EditRequest<'_>) -> Result<(Vec<String>, Vec<String>), ReconstructError> {
    let mut graph = saved::read(request.run)?;
    let record: RunRecord = store::read_record(&request.run.join("run.json"))?;
    let scale = record.normalization.scale;
    let text = std::fs::read_to_string(request.script)
        .map_err(|source| StoreError::read(request.script, source))?;
    let script: Script = toml::from_str(&text).map_err(|error| {
        let line = error.span().map_or(1, |span| line_of(&text, span.start));
        refuse(request.script, line, error.message())
    })?;
    let folder = request.script.parent().unwrap_or(Path::new("."));
    let mut done = Vec::with_capacity(script.edit.len());
    for edit in script.edit {
        let line = line_of(&text, edit.span().start);
        let what = apply(&mut graph, edit.into_inner(), folder, scale)
            .map_err(|reason| refuse(request.script, line, &reason))?;
        done.push(what);
    }
    Ok((saved::write(request.out, &graph)?, done))
}

fn line_of(text: &str, byte: usize) -> usize {
    1 + text
        .bytes()
        .take(byte)
        .filter(|&byte| byte == b'\n')
        .count()
}

fn refuse(script: &Path, line: usize, reason: &str) -> ReconstructError {
    let reason = reason.lines().next().unwrap_or_default();
    ReconstructError::Request {
        reason: format!("{}: line {line}: {reason}", script.display()),
    }
}

fn found(graph: &Graph, id: &str) -> Result<usize, String> {
    outputs::find(graph, id)
}

/// Does one edit; returns what was done.
fn apply(graph: &mut Graph, edit: Edit, folder: &Path, scale: f64) -> Result<String, String> {
    match edit {
        Edit::Remove { node } => {
            let number = found(graph, &node)?;
            graph.nodes.remove(number);
            Ok(format!("{node} is removed"))
        }
        Edit::Duplicate { node, new } => {
            let number = found(graph, &node)?;
            let is_name = !new.is_empty() && !new.contains(['/', '\\', ':']);
            if !is_name || graph.find(&new).is_some() {
                return Err(format!("{new:?} is no new name of an object"));
            }
            let copy = copied(&graph.nodes[number], &new);
            graph.nodes.insert(number + 1, copy);
            Ok(format!("{new} is a copy of {node}"))
        }
        Edit::Retime { node, frames } => {
            let number = found(graph, &node)?;
            let steps = graph.footage.frames.len().saturating_sub(1).max(1);
            graph.nodes[number].delay += frames as f64 / steps as f64;
            Ok(format!("{node} is shown {frames} frames later"))
        }
        Edit::Shift {
            node,
            by,
            unit,
            axes,
        } => {
            let number = found(graph, &node)?;
            let camera = graph.footage.first_pose();
            let by = DVec3::from_array(by);
            if !by.is_finite() {
                return Err("a shift is three finite numbers".to_owned());
            }
            let turned = turned_by(axes, camera.rotation) * by;
            let node = &mut graph.nodes[number];
            let length = match unit {
                Unit::World => scale,
                Unit::Distance => distance_of(node, camera.centre),
            };
            let trajectory = trajectory_of(node)?;
            for position in &mut trajectory.positions {
                *position += length * turned;
            }
            Ok(format!("{} is shifted", node.id))
        }
        Edit::Rotate { node, turn, axes } => {
            let number = found(graph, &node)?;
            let camera = graph.footage.first_pose();
            let turn = DVec3::from_array(turn.map(f64::to_radians));
            if !turn.is_finite() {
                return Err("a turn is three finite numbers of degrees".to_owned());
            }
            let turn = DQuat::from_scaled_axis(turned_by(axes, camera.rotation) * turn);
            let node = &mut graph.nodes[number];
            for rotation in &mut trajectory_of(node)?.rotations {
                *rotation = (turn * *rotation).normalize();
            }
            Ok(format!("{} is turned", node.id))
        }
        Edit::Texture { node, image, frame } => {
            let number = found(graph, &node)?;
            let painted = read_rgba(&folder.join(image))?;
            let (texture, done) = match frame {
                None => (painted, format!("{node} is painted over its atlas")),
                Some(frame) => {
                    let (texture, returned) = from_frame(graph, number, frame, &painted)?;
                    let share = 100.0 * returned;
                    let done = format!(
                        "{node} is painted in frame {frame}; {share:.1} % of the painted pixels \
                         return within half a pixel"
                    );
                    (texture, done)
                }
            };
            graph.nodes[number].overlay = Some(Overlay { texture });
            Ok(done)
        }
    }
}

/// A node's distance from the camera where it was learnt: earlier shifts do not change it, so that there
/// and back again is where it was.
fn distance_of(node: &Node, camera: DVec3) -> f64 {
    match &node.offsets {
        Some(offsets) => offsets.unit,
        None => {
            let at = node.given_pose(node.times[0].clamp(0.0, 1.0));
            at.centre.distance(camera)
        }
    }
}

fn turned_by(axes: Axes, camera: DMat3) -> DMat3 {
    match axes {
        Axes::World => DMat3::IDENTITY,
        Axes::Camera => camera,
    }
}

fn trajectory_of(
    node: &mut Node,
) -> Result<&mut omnilife_engine::trajectories::rigid_spline::RigidSpline, String> {
    match &mut node.surface {
        Surface::Plane { trajectory, .. } => Ok(trajectory),
        Surface::Sphere { .. } => Err(format!("{} is a sphere: it stays where it is", node.id)),
    }
}

/// A node like another one, under a name of its own.
fn copied(node: &Node, id: &str) -> Node {
    let mut fields = Fields::default();
    for kind in FieldKind::ALL {
        *fields.slot_mut(kind) = node.fields.get(kind).map(|field| {
            let [table, weights] = field.arrays().map(|array| array.values.clone());
            GridField::with_parameters(*field.shape(), table, weights)
        });
    }
    Node {
        id: id.to_owned(),
        surface: node.surface.clone(),
        colour: node.colour.clone(),
        opacity: node.opacity.clone(),
        fields,
        offsets: node.offsets.as_ref().map(|offsets| LearntOffsets {
            unit: offsets.unit,
            with_rotation: offsets.with_rotation,
            parameters: SharedParameters::new(
                "trajectories",
                offsets.parameters.array.values.clone(),
            ),
        }),
        times: node.times,
        delay: node.delay,
        overlay: node.overlay.clone(),
    }
}

/// An RGBA image, colours weighted by opacity.
fn read_rgba(path: &Path) -> Result<Texture<4>, String> {
    let decoded = ImageFile::open(path).and_then(ImageFile::decode);
    let rgba = decoded.map_err(|error| error.to_string())?.to_rgba8();
    let texels: Vec<[f32; 4]> = rgba
        .pixels()
        .map(|pixel| {
            let [red, green, blue, cover] = pixel.0.map(|byte| f32::from(byte) / 255.0);
            [red * cover, green * cover, blue * cover, cover]
        })
        .collect();
    if texels.iter().all(|texel| texel[3] == 0.0) {
        return Err(format!("{}: no pixel of it is painted", path.display()));
    }
    Ok(Texture {
        width: rgba.width() as usize,
        height: rgba.height() as usize,
        texels,
    })
}

/// What was painted in a frame, over the node's atlas, and the share of the painted pixels that come back
/// within half a pixel.
///
/// The ray of every painted pixel is followed to the node and moved by the flow of the frame's moment; what
/// was painted there is spread linearly over the four texels around. Texels between that got nothing take
/// the mean of their neighbours.
fn from_frame(
    graph: &mut Graph,
    node: usize,
    frame: u32,
    painted: &Texture<4>,
) -> Result<(Texture<4>, f64), String> {
    let camera = graph.footage.camera;
    let [width, height] = [camera.width() as usize, camera.height() as usize];
    if [painted.width, painted.height] != [width, height] {
        return Err(format!(
            "the image is {}x{}, the frames are {width}x{height}",
            painted.width, painted.height
        ));
    }
    let taken = graph
        .footage
        .frames
        .iter()
        .find(|taken| taken.number == frame);
    let taken = *taken.ok_or_else(|| format!("there is no frame {frame} among the input views"))?;
    let pixels: Vec<usize> = (0..width * height)
        .filter(|&pixel| painted.texels[pixel][3] > 0.0)
        .collect();
    let rays = Rays {
        moments: vec![Moment {
            time: taken.time,
            given: taken.pose,
        }],
        moment_of: vec![0; pixels.len()],
        directions: pixels
            .iter()
            .map(|&pixel| camera_direction(&camera, pixel_centre(pixel, width)))
            .collect(),
    };
    let seen = graph.see(&rays, &Detail::FULL, false, &|number| number == node);
    let samples = &seen.samples[node];
    if samples.is_empty() {
        return Err(format!(
            "nothing that is painted in frame {frame} lies on {}",
            graph.nodes[node].id
        ));
    }
    let (across, down) = (
        graph.nodes[node].colour.width,
        graph.nodes[node].colour.height,
    );
    let size = DVec2::new((across - 1) as f64, (down - 1) as f64);
    let mut sums = vec![[0.0_f32; 5]; across * down];
    for (sample, shade) in samples.iter().zip(&seen.shaded[node].shades) {
        let texel = painted.texels[pixels[sample.ray]];
        let at = shade.query.truncate() * size;
        let floor = at.floor();
        let part = (at - floor).as_vec2();
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (column, row) = (floor.x as i64 + dx, floor.y as i64 + dy);
            if !(0..across as i64).contains(&column) || !(0..down as i64).contains(&row) {
                continue;
            }
            let weight = (if dx == 1 { part.x } else { 1.0 - part.x })
                * (if dy == 1 { part.y } else { 1.0 - part.y });
            let sum = &mut sums[row as usize * across + column as usize];
            for (sum, value) in sum.iter_mut().zip(texel) {
                *sum += weight * value;
            }
            sum[4] += weight;
        }
    }
    let texels = without_holes(&sums, across, down);
    let texture = Texture {
        width: across,
        height: down,
        texels,
    };
    // A pixel comes back where the atlas holds something painted within half of it; rays of neighbouring
    // pixels say how far that is on the atlas.
    let half = 0.5
        * spacing(
            samples
                .iter()
                .zip(&seen.shaded[node].shades)
                .map(|(sample, shade)| (pixels[sample.ray], shade.query.truncate() * size)),
        );
    let back = seen.shaded[node].shades.iter().filter(|shade| {
        let at = shade.query.truncate() * size;
        let nearest = at.round();
        let is_inside = nearest.cmpge(DVec2::ZERO).all() && nearest.cmple(size).all();
        is_inside && (at - nearest).length() <= half.max(0.5) && {
            let texel = nearest.y as usize * across + nearest.x as usize;
            texture.texels[texel][3] > 0.0
        }
    });
    let returned = back.count() as f64 / samples.len() as f64;
    Ok((texture, returned))
}

/// Median distance on the atlas between pixels beside each other in a row.
fn spacing(places: impl Iterator<Item = (usize, DVec2)>) -> f64 {
    let places: Vec<(usize, DVec2)> = places.collect();
    let mut steps: Vec<f64> = places
        .windows(2)
        .filter(|pair| pair[1].0 == pair[0].0 + 1)
        .map(|pair| pair[0].1.distance(pair[1].1))
        .collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(1.0)
}

/// Weighted sums as values; a texel that got nothing between two that did takes their mean.
fn without_holes(sums: &[[f32; 5]], across: usize, down: usize) -> Vec<[f32; 4]> {
    let value = |at: usize| {
        let [a, b, c, d, weight] = sums[at];
        (weight > 0.0).then(|| [a, b, c, d].map(|value| value / weight))
    };
    (0..across * down)
        .map(|at| {
            let (column, row) = (at % across, at / across);
            value(at).unwrap_or_else(|| {
                let beside = [
                    (column > 0).then(|| at - 1),
                    (column + 1 < across).then(|| at + 1),
                    (row > 0).then(|| at - across),
                    (row + 1 < down).then(|| at + across),
                ];
                let known: Vec<[f32; 4]> = beside.into_iter().flatten().filter_map(value).collect();
                let count = known.len();
                let mean = |channel: usize| {
                    known.iter().map(|texel| texel[channel]).sum::<f32>() / count.max(1) as f32
                };
                if count < 2 {
                    [0.0; 4]
                } else {
                    [0, 1, 2, 3].map(mean)
                }
            })
        })
        .collect()
}
