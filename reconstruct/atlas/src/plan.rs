//! Choice of components by the evidence of a clip.
//!
//! The first nodes, without any field, are compared with the clip. Their residual beyond the images' noise
//! decides on the fields.

use glam::DVec3;
use omnilife_engine::surfaces::{
    compose::{Layer, compose},
    view_angle::view_angle,
};
use omnilife_schemas::records::ComponentDecision;

use super::{
    clip::Clip,
    graph::Graph,
    node::{Hit, Surface},
    pose_evidence::PoseAgreement,
    render::{Moment, Rays},
    shade::Detail,
};
use omnilife_training::{
    components::{Decision, DecisionLog},
    request::MethodRequest,
};

/// Component: textures move over their surface.
pub const FLOW: &str = "flow";
/// Component: colours and opacities depend on the direction from which a surface is seen.
pub const VIEW: &str = "view";
/// Component: opacity is trained beyond its base texture.
pub const OPACITY_FIELD: &str = "opacity-field";
/// Component: planes of objects rotate.
pub const OBJECT_ROTATION: &str = "object-rotation";
/// Component: the camera's poses are corrected.
pub const CAMERA_OFFSETS: &str = "camera-offsets";
/// Component: opacities are compared with the masks.
pub const MASK_LOSS: &str = "mask-loss";
/// Component: flow and view fields start coarse.
pub const COARSE_TO_FINE: &str = "coarse-to-fine";

/// Residuals below this multiple of the noise need no explanation.
const ABOVE_NOISE: f64 = 3.0;
/// Minimum span of the angles of view, radians (1 degree).
const LEAST_SPAN: f64 = std::f64::consts::PI / 180.0;
/// Base opacities that overlap the masks by this need no field.
const GOOD_OVERLAP: f64 = 0.98;
/// Overlap below which a frame is reported as a bad one.
const BAD_OVERLAP: f64 = 0.5;
/// Minimum change of shape that counts as a rotation, pixels.
const LEAST_DEVIATION: f64 = 0.5;
/// Approximate number of examined pixels of each frame.
const LOOKED_AT: usize = 4000;

/// Components of a node.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OfNode {
    /// A flow field.
    pub flow: bool,
    /// A view field.
    pub view: bool,
    /// An opacity field.
    pub opacity: bool,
    /// Trained rotations.
    pub rotation: bool,
}

/// Components for a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The components of each node.
    pub nodes: Vec<OfNode>,
    /// True if the camera's poses are corrected.
    pub camera_offsets: bool,
    /// True if opacities are compared with the masks.
    pub mask_loss: bool,
    /// True if flow and view fields start coarse.
    pub coarse_to_fine: bool,
    /// A line for each decision.
    pub decisions: Vec<ComponentDecision>,
}

/// Residuals of the first nodes.
#[derive(Debug, Clone, PartialEq, Default)]
struct NodeResiduals {
    /// Root mean square of the residual where a node is in front, [0, 1].
    residual: f64,
    /// Range of the angles of view to the node's middle, radians.
    span: f64,
    /// Overlap of base opacity and masks in each frame, intersection over union.
    overlaps: Vec<f64>,
    /// Deviation of the mask's outline from pure translation and scaling, pixels.
    deviation: f64,
}

impl Plan {
    /// Decides on a clip whose masks are those of the graph's objects, in the same order. `poses` is the agreement of
    /// the given poses with scene points, if these tell.
    pub fn of(
        clip: &Clip,
        graph: &mut Graph,
        poses: Option<&PoseAgreement>,
        request: &MethodRequest,
    ) -> Self {
        let noise = noise(clip);
        let measured = measure(clip, graph);
        let mut log = DecisionLog::new(request);
        let rms = |value: f64| format!("{:.2}/255", 255.0 * value);
        let mut nodes = Vec::with_capacity(graph.nodes.len());
        for (node, found) in graph.nodes.iter().zip(&measured) {
            let is_unexplained = found.residual > ABOVE_NOISE * noise;
            let residual = format!(
                "the base texture leaves {} rms, the images' noise is {}",
                rms(found.residual),
                rms(noise)
            );
            let is_object = node.opacity.is_some();
            let is_plane = matches!(node.surface, Surface::Plane { .. });
            let id = node.id.as_str();
            let flow = Decision::new(is_unexplained, residual.clone());
            let view = Decision::new(
                is_unexplained && found.span > LEAST_SPAN,
                format!(
                    "{residual}; seen over {:.1} degrees",
                    found.span.to_degrees()
                ),
            );
            let missing = (!is_plane).then_some("a plane: the sphere is seen from its middle");
            let mut of_node = OfNode {
                flow: log.decide_for(FLOW, id, flow),
                view: log.decide_for(VIEW, id, view.unless(missing)),
                ..OfNode::default()
            };
            if is_object {
                let (overlap, words) = found.overlap();
                let opacity = Decision::new(overlap < GOOD_OVERLAP, words);
                of_node.opacity = log.decide_for(OPACITY_FIELD, id, opacity);
                let rotation = Decision::new(
                    found.deviation > LEAST_DEVIATION,
                    format!("the mask's shape changes by {:.1} pixels", found.deviation),
                );
                of_node.rotation = log.decide_for(OBJECT_ROTATION, id, rotation);
            }
            nodes.push(of_node);
        }
        let background = measured.last().cloned().unwrap_or_default();
        let camera = camera_decision(&background, noise, poses);
        let camera = camera.unless((clip.frames.len() < 2).then_some("a second frame"));
        let objects = clip.objects.len();
        let masks = Decision::new(objects > 0, format!("{objects} objects with masks"));
        let masks = masks.unless((objects == 0).then_some("masks"));
        let has_motion_fields = nodes.iter().any(|node| node.flow || node.view);
        let coarse = Decision::new(
            has_motion_fields,
            if has_motion_fields {
                "a node has a flow or view field"
            } else {
                "no node has a flow or view field"
            },
        );
        Self {
            camera_offsets: log.decide(CAMERA_OFFSETS, camera),
            mask_loss: log.decide(MASK_LOSS, masks),
            coarse_to_fine: log.decide(COARSE_TO_FINE, coarse),
            nodes,
            decisions: log.into_decisions(),
        }
    }
}

impl NodeResiduals {
    /// Returns the mean overlap over frames, 1 without any, and the evidence in words.
    fn overlap(&self) -> (f64, String) {
        let count = self.overlaps.len();
        if count == 0 {
            return (1.0, "no frame shows it".to_owned());
        }
        let mean = self.overlaps.iter().sum::<f64>() / count as f64;
        let least = self.overlaps.iter().copied().fold(1.0, f64::min);
        let bad = self
            .overlaps
            .iter()
            .filter(|&&overlap| overlap < BAD_OVERLAP);
        let words = format!(
            "base opacity and masks overlap by {mean:.3} in the mean over {count} frames, {least:.3} at least, \
             below {BAD_OVERLAP} in {}",
            bad.count()
        );
        (mean, words)
    }
}

/// Decides on corrections of the camera. Scene points tell errors of poses from a background at a wrong place; only
/// without them the background's residual counts.
fn camera_decision(
    background: &NodeResiduals,
    noise: f64,
    poses: Option<&PoseAgreement>,
) -> Decision {
    match poses {
        Some(found) if found.agrees() => Decision::new(false, found.words()),
        Some(found) => Decision::new(true, found.words()),
        None => Decision::new(
            background.residual > ABOVE_NOISE * noise,
            format!(
                "under the given poses the background leaves {:.2}/255 rms, the noise is {:.2}/255; scene points do \
                 not tell",
                255.0 * background.residual,
                255.0 * noise
            ),
        ),
    }
}

/// Standard deviation of the error of rounding a value in [0, 1] to 8 bits: the minimum of the noise.
const ROUNDING: f64 = 0.288_675 / 255.0;

/// Returns the standard deviation of the images' noise, [0, 1]. It comes from the mean absolute response to the
/// difference of two Laplacians (Immerkaer 1996); fine texture counts as noise, too.
fn noise(clip: &Clip) -> f64 {
    let [width, height] = clip.size();
    if width < 3 || height < 3 {
        return ROUNDING;
    }
    let frames = clip.frames.iter().step_by((clip.frames.len() / 4).max(1));
    let mut of_frames: Vec<f64> = frames
        .map(|frame| {
            let grey = |pixel: usize| frame.colour(pixel).iter().sum::<f64>() / 3.0;
            let mut responses: Vec<f64> = Vec::new();
            for row in 1..height - 1 {
                for column in 1..width - 1 {
                    let mut window = (row - 1..=row + 1)
                        .flat_map(|row| (column - 1..=column + 1).map(move |c| row * width + c));
                    if !window.all(|pixel| frame.shows_scene(pixel)) {
                        continue;
                    }
                    let at = |dx: usize, dy: usize| grey((row + dy - 1) * width + column + dx - 1);
                    let corners = at(0, 0) + at(2, 0) + at(0, 2) + at(2, 2);
                    let sides = at(1, 0) + at(0, 1) + at(2, 1) + at(1, 2);
                    responses.push((corners - 2.0 * sides + 4.0 * at(1, 1)).abs());
                }
            }
            // The median is that of the smooth half of the image.
            responses.sort_by(f64::total_cmp);
            responses.get(responses.len() / 2).copied().unwrap_or(0.0) / (0.6745 * 6.0)
        })
        .collect();
    of_frames.sort_by(f64::total_cmp);
    let measured = of_frames.get(of_frames.len() / 2).copied();
    measured.unwrap_or(0.0).max(ROUNDING)
}

/// Compares the base textures with the clip.
fn measure(clip: &Clip, graph: &mut Graph) -> Vec<NodeResiduals> {
    let step = (clip.pixel_count() / LOOKED_AT).max(1);
    let base = Detail {
        kinds: [false; 4],
        active_share: 1.0,
    };
    let nodes = graph.nodes.len();
    let mut squares = vec![(0.0, 0.0); nodes];
    let mut overlaps: Vec<Vec<f64>> = vec![Vec::new(); nodes];
    let mut spans = vec![
        [
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::INFINITY,
            f64::NEG_INFINITY
        ];
        nodes
    ];
    for frame in &clip.frames {
        // An odd step, so that rows are met at different columns.
        let pixels = (0..clip.pixel_count()).step_by(step | 1);
        let pixels: Vec<usize> = pixels.filter(|&pixel| frame.shows_scene(pixel)).collect();
        let moment = Moment {
            time: frame.time,
            given: frame.pose,
        };
        let rays = Rays::of_pixels(&clip.camera, moment, pixels.iter().copied());
        let seen = graph.see(&rays, &base, false, &|_| true);
        let mut in_frame = vec![[0_u32; 2]; clip.objects.len()];
        for (ray, &pixel) in pixels.iter().enumerate() {
            let (layers, _) = seen.layers(ray);
            let error = compose(&layers) - DVec3::from_array(frame.colour(pixel));
            let front = layers.iter().find(|layer| layer.opacity > 0.5);
            if let Some(front) = front {
                let sum = &mut squares[front.surface];
                sum.0 += error.length_squared() / 3.0;
                sum.1 += 1.0;
            }
            for (object, counts) in in_frame.iter_mut().enumerate() {
                let is_masked = frame.covered(object, pixel) >= 0.5;
                let is_hidden = !is_masked && frame.is_covered(pixel);
                let is_opaque = share_of(&layers, object) > 0.5;
                if !is_hidden {
                    counts[0] += u32::from(is_masked && is_opaque);
                    counts[1] += u32::from(is_masked || is_opaque);
                }
            }
        }
        for (object, [both, either]) in in_frame.into_iter().enumerate() {
            let has_mask = frame.masks[object]
                .as_ref()
                .is_some_and(|mask| mask.iter().any(|&byte| byte >= 128));
            if has_mask && either > 0 {
                overlaps[object].push(f64::from(both) / f64::from(either));
            }
        }
        for (samples, span) in seen.samples.iter().zip(&mut spans) {
            for sample in samples {
                if let Hit::Plane(hit) = &sample.hit
                    && (hit.uv - 0.5).abs().max_element() < 0.1
                {
                    let angle = view_angle(hit.direction);
                    *span = [
                        span[0].min(angle.x),
                        span[1].max(angle.x),
                        span[2].min(angle.y),
                        span[3].max(angle.y),
                    ];
                }
            }
        }
    }
    (0..nodes)
        .map(|node| NodeResiduals {
            residual: (squares[node].0 / f64::max(squares[node].1, 1.0)).sqrt(),
            span: {
                let [a, b, c, d] = spans[node];
                (b - a).max(d - c).max(0.0)
            },
            overlaps: std::mem::take(&mut overlaps[node]),
            deviation: if node < clip.objects.len() {
                deviation(clip, node)
            } else {
                0.0
            },
        })
        .collect()
}

/// Returns the share of a ray that a surface covers, with nearer ones in front.
fn share_of(layers: &[Layer], surface: usize) -> f64 {
    let mut left = 1.0;
    for layer in layers {
        if layer.surface == surface {
            return left * layer.opacity;
        }
        left *= 1.0 - layer.opacity;
    }
    0.0
}

/// Returns the change of a mask's width against its height, pixels; translation and scaling keep their ratio.
fn deviation(clip: &Clip, object: usize) -> f64 {
    let [width, height] = clip.size();
    let boxes: Vec<[f64; 2]> = clip
        .frames
        .iter()
        .filter_map(|frame| {
            let mask = frame.masks[object].as_ref()?;
            let covered = (0..mask.len()).filter(|&pixel| mask[pixel] >= 128);
            let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
            let mut is_cut = false;
            for pixel in covered {
                let beside = [
                    pixel.saturating_sub(1),
                    (pixel + 1).min(mask.len() - 1),
                    pixel.saturating_sub(width),
                    (pixel + width).min(mask.len() - 1),
                ];
                is_cut |= beside.iter().any(|&near| !frame.shows_scene(near));
                for (axis, at) in [pixel % width, pixel / width].into_iter().enumerate() {
                    low[axis] = low[axis].min(at);
                    high[axis] = high[axis].max(at);
                }
            }
            let touches = is_cut
                || low[0] == 0
                || low[1] == 0
                || high[0] + 1 == width
                || high[1] + 1 == height;
            (low[0] != usize::MAX && !touches)
                .then(|| [0, 1].map(|axis| (high[axis] - low[axis] + 1) as f64))
        })
        .collect();
    let mut ratios: Vec<f64> = boxes.iter().map(|[w, h]| w / h).collect();
    ratios.sort_by(f64::total_cmp);
    let Some(&middle) = ratios.get(ratios.len() / 2) else {
        return 0.0;
    };
    let mut changes: Vec<f64> = boxes.iter().map(|[w, h]| (w - middle * h).abs()).collect();
    changes.sort_by(f64::total_cmp);
    // Nine frames of ten: one bad mask is not a rotation.
    changes[(changes.len() - 1) * 9 / 10]
}
