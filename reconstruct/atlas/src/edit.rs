//! Edits of an atlas by a script.

use std::path::Path;

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_engine::{
    fields::grid_field::GridField, parameters::SharedParameters, surfaces::texture::Texture,
};
use omnilife_schemas::{image_file::ImageFile, records::RunRecord, trajectory::GroundAxes};

use super::{
    graph::Graph,
    initialize::background::BACKGROUND,
    insert,
    node::{FieldKind, Fields, LearntOffsets, Node, Overlay, Surface},
    outputs, paint,
    render::Rays,
    saved,
    shade::Detail,
    unseen,
};
use omnilife_training::{
    error::ReconstructError,
    models::{
        EditPurpose, EditedModel, PlannedFiles,
        script::{self, Axes, Edit, Script, Unit},
    },
};

/// Applies a script to a run's atlas. Once a part is removed, a mask marks what no frame shows of the background, and a
/// warning has its share; previews are without both.
///
/// # Errors
/// When an edit names a missing part or does not suit its part, or when an image has no painted pixels.
pub(super) fn edit<'a>(
    folder: &'a Path,
    run: &RunRecord,
    script: &Script,
    purpose: EditPurpose,
) -> Result<EditedModel<'a>, ReconstructError> {
    let mut graph = saved::read(folder)?;
    let mut removes = false;
    let changes = script.apply(|edit| {
        removes |= matches!(edit, Edit::Remove { .. });
        apply(&mut graph, edit, script.folder(), run)
    })?;
    let has_earlier = folder.join(unseen::FILE).is_file();
    let is_plate = (removes || has_earlier) && purpose == EditPurpose::Run;
    let unseen = match is_plate && graph.find(BACKGROUND).is_some() {
        true => unseen::of_run(folder)?,
        false => None,
    };
    let mut warnings = Vec::new();
    if let Some(unseen) = &unseen {
        warnings.push(format!(
            "{:.2} % of the background is in none of the looked-at frames: {} marks it",
            100.0 * unseen.share,
            unseen::FILE
        ));
        if !has_earlier && !run.edits.is_empty() {
            warnings.push(format!(
                "{} is by the parts as they were edited before",
                unseen::FILE
            ));
        }
    }
    let mask = unseen.map(|unseen| unseen.mask);
    let mask_file = mask.iter().map(|_| unseen::FILE.to_owned());
    Ok(EditedModel {
        planned: PlannedFiles {
            files: outputs::ATLAS
                .files
                .iter()
                .map(|&file| file.to_owned())
                .chain(mask_file)
                .collect(),
            write: Box::new(move |out| {
                saved::write(out, &graph)?;
                if let Some(mask) = &mask {
                    mask.write_png(&out.join(unseen::FILE))?;
                }
                Ok(())
            }),
        },
        changes,
        warnings,
    })
}

/// Applies one edit; returns what it did.
fn apply(graph: &mut Graph, edit: &Edit, folder: &Path, run: &RunRecord) -> Result<String, String> {
    let id = edit.object();
    let number = outputs::find(graph, id)?;
    match edit {
        Edit::Remove { .. } => {
            graph.nodes.remove(number);
            Ok(format!("{id} is removed"))
        }
        Edit::Duplicate { new, .. } => {
            let new = new.as_deref().unwrap_or_default();
            check_name(graph, new)?;
            let copy = copied(&graph.nodes[number], new);
            graph.nodes.insert(number + 1, copy);
            Ok(format!("{new} is a copy of {id}"))
        }
        Edit::Insert {
            new,
            image,
            run: other,
            from,
            ..
        } => {
            check_name(graph, new)?;
            let place = &graph.nodes[number];
            let node = match (image, other, from) {
                (Some(image), ..) => insert::image(place, new, &folder.join(image))?,
                (None, Some(other), Some(from)) => {
                    insert::of_run(place, new, &folder.join(other), from)?
                }
                _ => return Err("must have either image, or run and from".to_owned()),
            };
            // Of two at one distance the earlier is in front.
            graph.nodes.insert(number, node);
            Ok(format!("{new} is inserted in the place of {id}, before it"))
        }
        Edit::Retime {
            seconds, frames, ..
        } => {
            let clip = run.clip_seconds.map(|[first, last]| last - first);
            let clip = clip.filter(|length| *length > 0.0);
            let clip = clip.ok_or("the run's record has no times: train it again")?;
            let seconds = script::delay(*seconds, *frames)?.seconds(run.views.as_ref())?;
            let (share, words) = (seconds / clip, format!("{seconds:.3} s"));
            let node = &mut graph.nodes[number];
            node.delay += share;
            let [begin, end] = node.times.map(|time| time + node.delay);
            if begin > 1.0 || end < 0.0 {
                return Err(format!(
                    "{id} is never in the clip when it is shown {words} later"
                ));
            }
            Ok(format!("{id} is shown {words} later"))
        }
        Edit::Shift { by, unit, axes, .. } => {
            let camera = graph.footage.first_pose();
            let turned = axes_of(*axes, camera.rotation, run)? * DVec3::from_array(*by);
            let node = &mut graph.nodes[number];
            let length = match unit.unwrap_or(Unit::Distance) {
                Unit::World => run.normalization.scale,
                Unit::Distance => distance_of(node, camera.centre),
            };
            for position in &mut trajectory_of(node)?.positions {
                *position += length * turned;
            }
            Ok(format!("{id} is shifted"))
        }
        Edit::Rotate { turn, axes, .. } => {
            let camera = graph.footage.first_pose();
            let turn = DVec3::from_array(turn.map(f64::to_radians));
            let turn = DQuat::from_scaled_axis(axes_of(*axes, camera.rotation, run)? * turn);
            for rotation in &mut trajectory_of(&mut graph.nodes[number])?.rotations {
                *rotation = (turn * *rotation).normalize();
            }
            Ok(format!("{id} is turned"))
        }
        Edit::Texture { image, frame, .. } => {
            let painted = read_rgba(&folder.join(image))?;
            let (texture, done) = match frame {
                None => {
                    let is_sphere = matches!(graph.nodes[number].surface, Surface::Sphere { .. });
                    if is_sphere && painted.width != 2 * painted.height {
                        return Err(format!(
                            "{id} is a sphere: an image over it must be twice as wide as high, got {}x{}",
                            painted.width, painted.height
                        ));
                    }
                    (painted, format!("{id} is painted over its atlas"))
                }
                Some(frame) => {
                    let (texture, returned) = from_frame(graph, number, *frame, &painted)?;
                    let share = 100.0 * returned;
                    let done = format!(
                        "{id} is painted in frame {frame}; {share:.1} % of the painted pixels \
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

fn check_name(graph: &Graph, new: &str) -> Result<(), String> {
    let is_name = !new.is_empty() && !new.contains(['/', '\\', ':']);
    if is_name && graph.find(new).is_none() {
        return Ok(());
    }
    Err(format!(
        "new must be a free name without /, \\ and :, got {new:?}"
    ))
}

/// Returns a node's distance from the camera of its training. Earlier shifts do not change it, so that a shift
/// and its reverse cancel.
fn distance_of(node: &Node, camera: DVec3) -> f64 {
    match &node.offsets {
        Some(offsets) => offsets.unit,
        None => {
            let at = node.given_pose(node.times[0].clamp(0.0, 1.0));
            at.centre.distance(camera)
        }
    }
}

/// Returns the axes of a displacement as columns in the world.
fn axes_of(axes: Option<Axes>, camera: DMat3, run: &RunRecord) -> Result<DMat3, String> {
    match axes.unwrap_or(Axes::Camera) {
        Axes::World => Ok(DMat3::IDENTITY),
        Axes::Camera => Ok(camera),
        Axes::Ground => {
            let up = run
                .up
                .ok_or("the run's record has no direction up: ground axes are unknown")?;
            Ok(GroundAxes::new(DVec3::from_array(up)).to_world)
        }
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

/// Returns a copy of a node under another name.
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
        offsets: copied_offsets(node),
        times: node.times,
        delay: node.delay,
        overlay: node.overlay.clone(),
    }
}

/// Returns a copy of a node's corrections of its trajectory.
pub(super) fn copied_offsets(node: &Node) -> Option<LearntOffsets> {
    node.offsets.as_ref().map(|offsets| LearntOffsets {
        unit: offsets.unit,
        with_rotation: offsets.with_rotation,
        parameters: SharedParameters::new("trajectories", offsets.parameters.array.values.clone()),
    })
}

/// Reads an RGBA image with colours weighted by opacity.
pub(super) fn read_rgba(path: &Path) -> Result<Texture<4>, String> {
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

/// Returns the paint of a frame over the node's atlas, and the share of the painted pixels that come back within
/// half a pixel.
///
/// The ray of every painted pixel is followed to the node and moved by the flow of the frame's moment. On a sphere
/// every texel then looks up its pixel ([`paint`]). On a plane the paint is spread linearly over the four texels
/// around. Texels without paint between painted ones take the mean of their neighbours.
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
    let rays = Rays::of_pixels(&camera, taken.moment(), pixels.iter().copied());
    let seen = graph.see(&rays, &Detail::FULL, false, &|number| number == node);
    let samples = &seen.samples[node];
    if samples.is_empty() {
        return Err(format!(
            "nothing that is painted in frame {frame} lies on {}",
            graph.nodes[node].id
        ));
    }
    if let Some(texture) = paint::on_sphere(graph, node, &taken, painted) {
        let shades = samples.iter().zip(&seen.shaded[node].shades);
        let queries = shades.map(|(sample, shade)| {
            let [.., cover] = painted.texels[pixels[sample.ray]];
            (cover, shade.query)
        });
        let returned = paint::returned_share(&texture, &queries.collect::<Vec<_>>());
        return Ok((texture, returned));
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
    // A pixel comes back if the atlas holds paint within half a pixel of it; rays of neighbouring pixels give
    // that distance on the atlas.
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

/// Returns the median distance on the atlas between neighbouring pixels of a row.
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

/// Returns weighted sums as values; a texel without paint between two painted ones takes their mean.
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
