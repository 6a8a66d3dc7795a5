//! Neural Atlas Graphs: a clip as textured planes on rigid trajectories before a background.
//!
//! Source: J. P. Schneider et al., "Neural Atlas Graphs for Dynamic Scene Decomposition and Editing",
//! `NeurIPS` 2025 (arXiv 2509.16336), its supplement, and its code <https://github.com/jp-schneider/nag>.
//!
//! * [`clip`]: input of the method; [`linked_masks`]: objects from one mask per frame.
//! * [`node`], [`graph`]: nodes, and the atlas that they make. [`initialize`]: first nodes.
//!   [`knots`]: number of knots of trajectories.
//!   [`front`]: static things without a mask before objects.
//! * [`shade`], [`render`], [`step`]: appearance along rays, images, and one step of the optimizer.
//! * [`plan`]: components by the evidence of a clip. [`pose_evidence`]: agreement of poses and points.
//! * [`settings`]: sizes, rates, phases. [`published`]: deviations of the published code, on request.
//! * [`learner`]: batches and checkpoints; `device`: steps with fields on a GPU. [`saved`]: an atlas in files.
//!   [`outputs`]: layers and images of the atlas. [`edit`]: edits by a script.
#![cfg_attr(not(test), warn(clippy::disallowed_methods))]

pub mod clip;
mod device;
pub mod edit;
pub mod front;
pub mod graph;
pub mod initialize;
mod insert;
pub mod knots;
pub mod learner;
pub mod linked_masks;
pub mod node;
pub mod outputs;
mod paint;
pub mod plan;
pub mod pose_evidence;
pub mod published;
pub mod render;
mod robust;
pub mod saved;
pub mod settings;
pub mod shade;
pub mod step;
mod unseen;

use std::collections::BTreeMap;

use glam::DVec3;
use omnilife_engine::fields::grid_field::GridField;
use omnilife_schemas::{distances::DistanceImage, records::ComponentDecision};

use self::{
    clip::Clip,
    graph::Graph,
    initialize::{
        boxes::TrackedBoxes,
        first_nodes::{Evidence, FirstNodes, first_nodes, reference_frames},
    },
    knots::KNOTS,
    learner::AtlasLearner,
    node::{FieldKind, LearntOffsets, Node, Surface},
    plan::Plan,
    pose_evidence::agreement,
    published::PublishedParts,
    settings::{FieldSize, Settings},
};
use omnilife_training::{
    components::{Decision, DecisionLog, MotionEvidenceUse},
    error::ReconstructError,
    method::{Findings, Method, MethodKind, ON_CPU_AND_GPU, Prepared},
    options::{MethodOption, OptionValues},
    process,
    random::{Purpose, seed_of},
    request::{BackendChoice, DefaultPlan, MethodRequest},
    scene::{CameraExtent, TrainingScene},
    train::LoopSettings,
};

const SIZES: OptionValues = OptionValues::Word(&["large", "medium", "small", "tiny"]);
/// Sizes of colour and opacity fields.
pub const BASE_FIELDS: MethodOption = MethodOption {
    id: "base-fields",
    doc: "size of the fields of colour and opacity, at most; large is what was published",
    values: SIZES,
    default: "medium",
    constant: None,
    cpu_only: &[],
};
/// Sizes of flow and view fields.
pub const MOTION_FIELDS: MethodOption = MethodOption {
    id: "motion-fields",
    doc: "size of the fields of flow and view, at most; large is what was published",
    values: SIZES,
    default: "small",
    constant: None,
    cpu_only: &[],
};
/// Rays of a step.
pub const RAYS: MethodOption = MethodOption {
    id: "rays",
    doc: "rays that a step of the optimizer takes, from all views",
    values: OptionValues::Whole {
        least: 16,
        most: 1 << 22,
    },
    default: "16384",
    constant: None,
    cpu_only: &[],
};

/// Option of the loss on masks.
pub const MASK_LOSS: MethodOption = MethodOption {
    id: "mask-loss",
    doc: "loss on masks: published weighs 0.005, under which an object's plane takes reflections and shadows \
          that move with it, and counts pixels that another object covers; strong weighs ten times that, and \
          leaves them out",
    values: OptionValues::Word(&["strong", "published"]),
    default: "strong",
    constant: None,
    cpu_only: &[],
};
/// Option of the gradients by planes.
pub const GRADIENTS: MethodOption = MethodOption {
    id: "gradients",
    doc: "gradients by poses of planes: true, or rescaled as published, by one over an object's hits and, \
          while poses are learnt alone, over the transmittance before it (at most 1000; the published code \
          has no bound)",
    values: OptionValues::Word(&["true", "published"]),
    default: "true",
    constant: None,
    cpu_only: &["published"],
};
/// Option of the step sizes.
pub const SCHEDULE: MethodOption = MethodOption {
    id: "schedule",
    doc: "step sizes: decay has one for each kind of parameter, which falls by ten; published has 0.001 for \
          all, halved on plateaus of the loss",
    values: OptionValues::Word(&["decay", "published"]),
    default: "decay",
    constant: None,
    cpu_only: &[],
};

/// Neural Atlas Graphs.
pub const METHOD: Method = Method {
    id: "nag",
    title: "Neural Atlas Graphs",
    source: "J. P. Schneider et al., Neural Atlas Graphs for Dynamic Scene Decomposition and Editing, \
             NeurIPS 2025",
    description: "Every masked object is a textured plane on a learnt rigid trajectory, the rest a \
                  background plane, or a sphere in panoramas; colour, opacity, flow and dependence on \
                  the view are hash-grid fields over the surfaces. Departures: rays are drawn at \
                  pixels' centres and at independent times; fields start at exactly 0; whether a \
                  plane is hit is tested in its own coordinates; the mask loss leaves out pixels that \
                  another object covers and weighs ten times as much; gradients are not rescaled; \
                  step sizes fall by ten without looking at the loss (mask-loss, gradients and schedule \
                  switch these three back); a sphere as background and its flow are this project's; \
                  first planes come from boxes, distances, points, tracked textures or outlines of \
                  masks, and turn in the image's plane alone, with a margin of 1.3 (background 1.06, published \
                  1.8); the background's plane goes through scene points, or is four times as far as the \
                  cameras' path is long; knots are half of the frames, on request all where the camera shakes; \
                  nodes are there in the frames of their masks and one more each way; on request \
                  (front) static things without a mask that hide objects are a plane before them. One \
                  model learns from all input views at once; without masks there is the background \
                  alone. On a GPU, the host intersects rays with \
                  surfaces and moves trajectories.",
    components: &[
        plan::FLOW,
        plan::VIEW,
        plan::OPACITY_FIELD,
        plan::OBJECT_ROTATION,
        plan::CAMERA_OFFSETS,
        plan::MASK_LOSS,
        plan::COARSE_TO_FINE,
    ],
    optional_components: &[front::FRONT],
    // Supplement, Table 10.
    ablation: &[
        plan::COARSE_TO_FINE,
        plan::FLOW,
        plan::VIEW,
        plan::MASK_LOSS,
    ],
    default_plan: DefaultPlan::Auto,
    backends: ON_CPU_AND_GPU,
    requires: &[],
    options: &[
        BASE_FIELDS,
        MOTION_FIELDS,
        RAYS,
        MASK_LOSS,
        GRADIENTS,
        SCHEDULE,
        KNOTS,
    ],
    kind: MethodKind::Trained {
        extent: CameraExtent::Most,
        motion: MotionEvidenceUse::None,
        model: &outputs::ATLAS,
        prepare,
    },
};

/// Returns the clip without objects that have no node: the masks' numbers are those of the nodes.
fn with_nodes_alone(clip: Clip, with_node: &[usize]) -> Clip {
    let mut clip = clip;
    clip.objects = with_node.iter().map(|&o| clip.objects[o].clone()).collect();
    for frame in &mut clip.frames {
        frame.masks = with_node.iter().map(|&o| frame.masks[o].clone()).collect();
    }
    clip
}

/// Gives nodes the fields and offsets of a plan.
pub fn add_fields(
    clip: &Clip,
    nodes: &mut FirstNodes,
    knots: usize,
    plan: &Plan,
    settings: &Settings,
) {
    let flow_points = ((clip.frames.len() as f64 * 0.1).round() as usize).max(1);
    let distance = nodes.distance;
    for (number, node) in nodes.graph.nodes.iter_mut().enumerate() {
        add_fields_of(node, number, &plan.nodes[number], settings, flow_points);
        if node.opacity.is_some() && clip.frames.len() > 1 {
            let at = node.given_pose(node.times[0].max(0.0)).centre;
            let unit = at.distance(clip.frames[0].pose.centre).max(1e-3 * distance);
            node.offsets = Some(LearntOffsets::zero(
                knots,
                unit,
                plan.nodes[number].rotation,
            ));
        }
    }
    if plan.camera_offsets {
        nodes.graph.camera = Some(LearntOffsets::zero(knots, distance, true));
    }
}

fn add_fields_of(
    node: &mut Node,
    number: usize,
    plan: &plan::OfNode,
    settings: &Settings,
    flow_points: usize,
) {
    let dimensions = node.dimensions();
    let (width, height) = (node.colour.width as f64, node.colour.height as f64);
    // A sphere's grid is a cube of which it fills the surface: its diameter has W/pi texels.
    let longer = match node.surface {
        Surface::Plane { .. } => width.max(height),
        Surface::Sphere { .. } => width / std::f64::consts::PI,
    };
    let is_object = node.opacity.is_some();
    let wanted = [
        (FieldKind::Colour, true, dimensions, 3, settings.base_fields),
        (
            FieldKind::Opacity,
            is_object && plan.opacity,
            dimensions,
            1,
            settings.base_fields,
        ),
        (
            FieldKind::Flow,
            plan.flow,
            dimensions,
            dimensions * (flow_points + 2),
            settings.motion_fields,
        ),
        (
            FieldKind::View,
            plan.view && dimensions == 2,
            4,
            if is_object { 4 } else { 3 },
            settings.motion_fields,
        ),
    ];
    for (kind, is_wanted, inputs, outputs, size) in wanted {
        if !is_wanted {
            continue;
        }
        // Angles need no more cells than the surface: its texels bound the levels alone.
        let all = if kind == FieldKind::View {
            f64::MAX
        } else {
            width * height
        };
        let shape: omnilife_engine::fields::grid_field::GridFieldShape =
            FieldSize::shape(size, inputs, outputs, longer, all);
        let of_all = seed_of(settings.seed, Purpose::Fields);
        let seed = of_all ^ ((number as u64) << 8 | kind.number() as u64);
        *node.fields.slot_mut(kind) = Some(GridField::new(shape, seed));
    }
}

fn settings_of(request: &MethodRequest) -> Settings {
    let mut settings = Settings::new(request.seed);
    let size = |option: &MethodOption| request.options.word(option).and_then(FieldSize::named);
    settings.base_fields = size(&BASE_FIELDS).unwrap_or(settings.base_fields);
    settings.motion_fields = size(&MOTION_FIELDS).unwrap_or(settings.motion_fields);
    let is_published = |option: &MethodOption| request.options.word(option) == Some("published");
    settings.published = PublishedParts {
        mask_loss: is_published(&MASK_LOSS),
        gradients: is_published(&GRADIENTS),
        schedule: is_published(&SCHEDULE),
    };
    if settings.published.mask_loss {
        settings.mask_weight = published::MASK_WEIGHT;
    }
    if let Some(rays) = request.options.whole(&RAYS) {
        settings.rays = rays as usize;
    }
    settings
}

fn prepare<'a>(
    scene: &'a TrainingScene,
    request: &MethodRequest,
    backend: BackendChoice,
) -> Result<Prepared<'a>, ReconstructError> {
    let clip = Clip::of(scene)?;
    let points: Vec<DVec3> = scene
        .points
        .positions
        .iter()
        .map(|&at| DVec3::from_array(at.map(f64::from)))
        .collect();
    let warnings = clip.warnings.clone();
    let evidence = Evidence {
        points: &points,
        distances: distances_of(scene, &clip)?,
        boxes: scene.tracks.as_ref().map(|tracks| TrackedBoxes {
            tracks,
            to_normalized: scene.normalization,
        }),
    };
    let mut begun = begin_with(clip, &evidence, request)?;
    if backend == BackendChoice::Gpu {
        begun.learner.move_to_gpu()?;
    }
    let configuration =
        serde_json::to_value(&begun.settings).map_err(|error| ReconstructError::Request {
            reason: format!("settings that cannot be recorded: {error}"),
        })?;
    Ok(Prepared {
        length: LoopSettings {
            iterations: request.iterations,
            budget_seconds: request.budget_seconds,
            seed: request.seed,
            trace_every: request.trace_every,
        },
        learner: Box::new(begun.learner),
        configuration,
        findings: Findings {
            plan: begun.plan,
            warnings,
            ..Findings::default()
        },
    })
}

/// Reads the distances of the frames in which objects are compared with them.
fn distances_of(
    scene: &TrainingScene,
    clip: &Clip,
) -> Result<BTreeMap<u32, DistanceImage>, ReconstructError> {
    let wanted = reference_frames(clip);
    let mut found = BTreeMap::new();
    for (number, view) in scene.input_views.iter().enumerate() {
        if wanted.contains(&view.frame)
            && let Some(image) = scene.distances(number)?
        {
            found.insert(view.frame, image);
        }
    }
    Ok(found)
}

/// Start of training on a clip.
#[derive(Debug)]
pub struct AtlasStart {
    /// The atlas before its first step.
    pub learner: AtlasLearner,
    /// Every setting as resolved.
    pub settings: Settings,
    /// Nodes and components, used and left out, with reasons.
    pub plan: Vec<ComponentDecision>,
}

/// Begins with scene points, normalized, as only evidence beside the clip: see [`begin_with`].
///
/// # Errors
/// The errors of [`begin_with`].
pub fn begin(
    clip: Clip,
    points: &[DVec3],
    request: &MethodRequest,
) -> Result<AtlasStart, ReconstructError> {
    let evidence = Evidence {
        points,
        ..Evidence::default()
    };
    begin_with(clip, &evidence, request)
}

/// Places the nodes of a clip, decides on components, and makes the fields.
///
/// # Errors
/// When masks leave no background, or the atlas does not fit into memory.
pub fn begin_with(
    clip: Clip,
    evidence: &Evidence<'_>,
    request: &MethodRequest,
) -> Result<AtlasStart, ReconstructError> {
    let refuse = |reason: String| ReconstructError::Request { reason };
    let (knots, of_knots) = knots::of(&clip, request.options.word(&KNOTS));
    let mut nodes = first_nodes(&clip, evidence, knots).map_err(refuse)?;
    let poses = agreement(&clip, evidence.points);
    let mut clip = with_nodes_alone(clip, &nodes.with_node);
    nodes
        .decisions
        .extend(add_front(&mut clip, &mut nodes.graph, request));
    let mut settings = settings_of(request);
    let plan = Plan::of(&clip, &mut nodes.graph, poses.as_ref(), request);
    if !plan.mask_loss {
        settings.mask_weight = 0.0;
    }
    settings.coarse_to_fine = plan.coarse_to_fine;
    add_fields(&clip, &mut nodes, knots, &plan, &settings);
    let values: usize = nodes.graph.parameter_counts().iter().sum();
    process::require(
        training_bytes(values, settings.rays),
        &format!("training an atlas of {values} parameters"),
    )?;
    let mut decisions = nodes.decisions;
    decisions.push(of_knots);
    decisions.extend(plan.decisions);
    Ok(AtlasStart {
        learner: AtlasLearner::new(clip, nodes.graph, settings.clone()),
        settings,
        plan: decisions,
    })
}

/// Adds a static thing before the objects on request, where there is one; returns a line for the record.
fn add_front(
    clip: &mut Clip,
    graph: &mut Graph,
    request: &MethodRequest,
) -> Vec<ComponentDecision> {
    let mut log = DecisionLog::new(request);
    if !request.names(front::FRONT) {
        let decision = Decision::on_request("its gain was measured on synthetic clips alone");
        log.decide(front::FRONT, decision);
        return log.into_decisions();
    }
    match front::find(clip, graph) {
        Ok(found) => {
            let decision = Decision::new(true, found.reason.clone());
            if log.decide(front::FRONT, decision) {
                front::add(clip, graph, found);
            }
        }
        Err(reason) => {
            log.decide(front::FRONT, Decision::new(false, reason).settled());
        }
    }
    log.into_decisions()
}

/// Returns the bytes that training takes: values, gradients and two moments of every parameter, and the stored
/// activations of a step's rays. Those are of four fields of four hidden layers, for one and a half hits of each
/// ray.
fn training_bytes(values: usize, rays: usize) -> u64 {
    16 * values as u64 + rays as u64 * 9_000
}

#[cfg(test)]
mod tests;
