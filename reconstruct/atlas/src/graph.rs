//! An atlas: its nodes, and corrections of the camera.

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
    /// Corrections of the camera's poses; `None` where the poses are given and exact.
    pub camera: Option<LearntOffsets>,
    /// Clock from seconds to the time of splines.
    pub clock: UnitClock,
    /// The frames of its training.
    pub footage: Footage,
}

/// The training frames of an atlas, without their images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Footage {
    /// Size and model of all frames.
    pub camera: Camera,
    /// In order of time.
    pub frames: Vec<FootageFrame>,
}

/// Time and pose of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FootageFrame {
    /// Its number in the scene.
    pub number: u32,
    /// In [0, 1].
    pub time: f64,
    /// Camera to world, normalized units, as given.
    pub pose: RigidPose,
}

impl Footage {
    /// Returns the camera's pose at the first frame.
    pub fn first_pose(&self) -> RigidPose {
        let still = RigidPose {
            centre: DVec3::ZERO,
            rotation: DMat3::IDENTITY,
        };
        self.frames.first().map_or(still, |frame| frame.pose)
    }
}

/// Names of all trained parameters, in the order of [`Graph::parameter_counts`].
pub const ARRAYS: [&str; 5] = ["colour", "opacity", "flow", "view", "trajectories"];

/// Visible part of an atlas.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Visibility {
    /// All nodes.
    All,
    /// One node alone, over black.
    Only(String),
    /// The opacity of one node alone, whatever is in front of it.
    Opacity(String),
    /// The share of each pixel that a node covers, with nearer nodes in front.
    Matte(String),
    /// All nodes but one.
    Without(String),
}

impl Graph {
    /// Returns the numbers of trained values, by the names of [`ARRAYS`].
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

    /// Returns the number of the node of this name.
    pub fn find(&self, id: &str) -> Option<usize> {
        self.nodes.iter().position(|node| node.id == id)
    }

    /// Returns a camera's pose at a time, with its correction.
    pub fn camera_pose(&self, given: &RigidPose, time: f64) -> RigidPose {
        match &self.camera {
            Some(offsets) => offsets.offsets().applied(given, time),
            None => *given,
        }
    }

    /// Returns a message that names the first array with a parameter that is not a finite number.
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
