//! An atlas: its nodes, and what is learnt of the camera.

use glam::{DMat3, DVec3};
use omnilife_engine::{camera::Camera, trajectories::rigid_spline::RigidPose};
use serde::{Deserialize, Serialize};

use super::{
    clip::UnitClock,
    node::{FieldKind, LearntOffsets, Node},
};

/// Nodes with the camera that sees them.
#[derive(Debug)]
pub struct Graph {
    /// Objects in the order of their names, the background last.
    pub nodes: Vec<Node>,
    /// What is learnt of the camera's poses; `None` where they are given and exact.
    pub camera: Option<LearntOffsets>,
    /// From seconds to the time of splines.
    pub clock: UnitClock,
    /// What it was learnt from.
    pub footage: Footage,
}

/// The frames that an atlas was learnt from, without their images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Footage {
    /// Size and model of all frames.
    pub camera: Camera,
    /// In order of time.
    pub frames: Vec<TakenFrame>,
}

/// When and from where a frame was taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TakenFrame {
    /// Its number in the scene.
    pub number: u32,
    /// In [0, 1].
    pub time: f64,
    /// Camera to world, normalized units, as given.
    pub pose: RigidPose,
}

impl Footage {
    /// The camera of the first frame.
    pub fn first_pose(&self) -> RigidPose {
        let still = RigidPose {
            centre: DVec3::ZERO,
            rotation: DMat3::IDENTITY,
        };
        self.frames.first().map_or(still, |frame| frame.pose)
    }
}

/// Names of everything that is trained, in the order of [`Graph::parameter_counts`].
pub const ARRAYS: [&str; 5] = ["colour", "opacity", "flow", "view", "trajectories"];

/// What is shown of an atlas.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shown {
    /// All nodes.
    All,
    /// One node alone, over black.
    Only(String),
    /// How much a node covers of each pixel, with what is before it in front.
    Matte(String),
    /// All nodes but one.
    Without(String),
}

impl Graph {
    /// Values that are learnt, by the names of [`ARRAYS`].
    pub fn parameter_counts(&self) -> [usize; 5] {
        let mut sums = [0; 5];
        for node in &self.nodes {
            for (sum, count) in sums.iter_mut().zip(node.parameter_counts()) {
                *sum += count;
            }
        }
        let camera = self.camera.as_ref();
        sums[4] += camera.map_or(0, |offsets| offsets.parameters.array.values.len());
        sums
    }

    /// Number of the node of this name.
    pub fn find(&self, id: &str) -> Option<usize> {
        self.nodes.iter().position(|node| node.id == id)
    }

    /// A camera's pose at a time, with what was learnt of it.
    pub fn camera_pose(&self, given: &RigidPose, time: f64) -> RigidPose {
        match &self.camera {
            Some(offsets) => offsets.offsets().applied(given, time),
            None => *given,
        }
    }

    /// Whether a parameter is not a finite number, and which.
    pub fn not_finite(&self) -> Option<String> {
        let is_bad = |values: &[f32]| values.iter().any(|value| !value.is_finite());
        for node in &self.nodes {
            for kind in FieldKind::ALL {
                let field = node.fields.get(kind);
                let arrays = field.iter().flat_map(|field| field.arrays());
                if arrays.into_iter().any(|array| is_bad(&array.values)) {
                    let name = ARRAYS[kind.number()];
                    return Some(format!("{name} of {} is not finite", node.id));
                }
            }
            if let Some(offsets) = &node.offsets
                && is_bad(&offsets.parameters.array.values)
            {
                return Some(format!("the trajectory of {} is not finite", node.id));
            }
        }
        let camera = self.camera.as_ref()?;
        is_bad(&camera.parameters.array.values)
            .then(|| "the camera's trajectory is not finite".to_owned())
    }
}
