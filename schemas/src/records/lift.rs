//! `lift`: counts of the pixels that were lifted from views with distances to Gaussians.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `lift.json`, beside the record of a run that began with lifted pixels. For every view
/// `pixels = unknown + masked + thinned + flying + redundant + kept`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Lift {
    /// Id of the scene.
    pub scene: String,
    /// Source of its distances, in words: the origin of the files, or a sweep.
    pub distances: String,
    /// Median relative difference between views that see one surface, as the distances came; `None` where no two views
    /// can be compared.
    pub disagreement_before: Option<f64>,
    /// The same with the views' factors.
    pub disagreement: Option<f64>,
    /// Largest relative difference of the distances of two views of one surface.
    pub tolerance: f64,
    /// Share of the lifted samples, before the choice among views, that stand where two views or more see
    /// past them.
    pub ghost_share: f64,
    /// Standard deviations of a Gaussian along the surface, in radii of its sample.
    pub tangential_radii: f64,
    /// Standard deviation along the normal, in radii.
    pub normal_radii: f64,
    /// Opacity of all of them.
    pub opacity: f64,
    /// Median radius of a sample, world units.
    pub median_radius: f64,
    /// Smallest box around the centres, world: least and greatest corner.
    pub bounds: [[f64; 3]; 2],
    /// Samples of all views together.
    pub samples: u64,
    /// Gaussians that the run began with: samples, evenly thinned where there were too many, and the sky's.
    pub gaussians: u64,
    /// Gaussians of a shell where no view knows a distance.
    pub sky: u64,
    /// The views in the order of the split.
    pub views: Vec<LiftedView>,
}

impl Record for Lift {
    const SCHEMA: &'static str = "omnilife/lift/1";
}

/// The pixels of a view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LiftedView {
    /// Its frame, as the split numbers it.
    pub frame: u32,
    /// Factor that its distances were multiplied by.
    pub factor: f64,
    /// Pixels of its distances.
    pub pixels: u64,
    /// Without a known distance.
    pub unknown: u64,
    /// Hidden by a mask.
    pub masked: u64,
    /// Left out near the poles, where pixels crowd.
    pub thinned: u64,
    /// Hanging between the two sides of an edge of depth.
    pub flying: u64,
    /// Seen more finely by another view.
    pub redundant: u64,
    /// Samples that stayed.
    pub kept: u64,
    /// Lifted without a normal of their own: they face the camera.
    pub without_normal: u64,
}
