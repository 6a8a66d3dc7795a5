//! `objects`: the objects of a trained object graph.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{store::Record, trajectory::ObjectPath};

/// `objects.json`, in a run's folder. The Gaussians of the objects, each in its own coordinates (forward,
/// left, up, in units of the largest side of its box), are in the file beside it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Objects {
    /// Unit vector of the world that points up.
    pub up: [f64; 3],
    /// The objects; the Gaussians of the one at place `n` have the number `n`.
    pub objects: Vec<GraphObject>,
}

impl Record for Objects {
    const SCHEMA: &'static str = "omnilife/objects/1";
}

/// An object that moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GraphObject {
    /// Its id in the tracks.
    pub id: u32,
    /// Length, width and height of its box, world units.
    pub dimensions: [f64; 3],
    /// Path over time, as given.
    pub path: ObjectPath,
    /// Corrections by training, at knots uniform in time: three values of the centre in world units,
    /// and one of the heading, radians. One at least.
    pub corrections: Vec<[f64; 4]>,
}
