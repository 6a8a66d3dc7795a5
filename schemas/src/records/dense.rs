//! `dense`: distances of the pixels of a scene's frames by stereo, and the points they give.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `dense.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DenseStereo {
    /// Id of the scene.
    pub scene: String,
    /// Camera and poses that they were measured with ([`super::Scene::geometry_sha256`]): points are in
    /// the world of those alone.
    pub geometry_sha256: String,
    /// Masks of ignored regions ([`super::Scene::ignored_sha256`]): points of it must not be
    /// taken for the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ignored_sha256: Option<String>,
    /// Width and height of the distances' images, pixels: those of the frames or, in proportion, fewer.
    pub image_size: [u32; 2],
    /// The frames that were looked at, in order.
    pub frames: Vec<DenseFrame>,
    /// File of the points, beside this one.
    pub points: String,
    /// Number of points.
    pub point_count: u64,
    /// Edge of the cubes that hold one point each, world units.
    pub spacing: f64,
    /// Warnings, in words.
    pub warnings: Vec<String>,
}

impl Record for DenseStereo {
    const SCHEMA: &'static str = "omnilife/dense/1";
}

/// The distances of a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DenseFrame {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// File of the distances along the rays, beside this one: `.npy` of f32 (rows, columns), world units;
    /// 0 where they are not known.
    pub distances: String,
    /// File of the confidence, beside this one: 8-bit grey PNG, the share of the frames asked, eight at
    /// most, whose own distances confirm this one, of 255; 0 where it is not known.
    pub confidence: String,
    /// Numbers of the frames that it was compared with.
    pub compared_with: Vec<u32>,
    /// Least and largest depth that was searched, world units along the viewing direction; no largest where
    /// the search began at infinity.
    pub searched: (f64, Option<f64>),
    /// Depths that were tried.
    pub hypotheses: u32,
    /// Share of the pixels whose distance is known.
    pub known_share: f64,
}
