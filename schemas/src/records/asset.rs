//! `asset`: published scene of Gaussians with levels of detail for web viewers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `asset.json`. All files are relative to its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Asset {
    /// The exported model.
    pub source: AssetSource,
    /// Gaussians of the source that a viewer can draw.
    pub splats: u64,
    /// The levels, the smallest first; each is part of the next.
    pub levels: Vec<AssetLevel>,
    /// Moments of a dynamic scene beside that of the levels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moments: Option<AssetMoments>,
    /// Files of a moving scene that is exported as a sequence, in order: all Gaussians at a moment.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sequence: Vec<AssetMoment>,
    /// Levels and moments that were asked for and are not there, with the reason.
    pub left_out: Vec<String>,
    /// Transform from world coordinates to those of the files.
    pub placement: AssetPlacement,
    /// Changes made for viewers.
    pub changes: AssetChanges,
    /// Gaussians of the source that are not valid.
    #[serde(default)]
    pub invalid: InvalidGaussians,
    /// The page, where there is one.
    pub page: Option<AssetPage>,
    /// Wall-clock time of the export, seconds.
    pub wall_seconds: f64,
}

impl Asset {
    /// Returns the names of all its files of Gaussians.
    pub fn splat_files(&self) -> impl Iterator<Item = &str> {
        let levels = self.levels.iter().map(|level| &*level.file);
        let of_moments = self.moments.iter().flat_map(|moments| {
            let moving = moments.moments.iter().map(|moment| &*moment.moving.file);
            [&*moments.still.file].into_iter().chain(moving)
        });
        let of_sequence = self.sequence.iter().map(|moment| &*moment.moving.file);
        levels.chain(of_moments).chain(of_sequence)
    }
}

impl Record for Asset {
    const SCHEMA: &'static str = "omnilife/asset/1";
}

/// Source of an export.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AssetSource {
    /// SHA-256 of the run's record, or of the file of Gaussians.
    pub sha256: String,
    /// The method, where a run was exported.
    pub method: Option<String>,
    /// The scene, where a run was exported.
    pub scene: Option<String>,
    /// The moment that the levels show of a scene that moves, seconds.
    pub time_seconds: Option<f64>,
}

/// A level of detail.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AssetLevel {
    /// Its name, such as `1M` or `full`.
    pub name: String,
    /// A file of Gaussians.
    pub file: String,
    /// Gaussians in it.
    pub splats: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Ratio of the sizes of its Gaussians to the source's, which makes up for their smaller number.
    pub growth: f64,
}

/// A dynamic scene: at every moment its static Gaussians and those of the moment, which together stand in the place
/// of the levels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AssetMoments {
    /// The Gaussians that are the same at all moments.
    pub still: AssetSplats,
    /// The moments, in order.
    pub moments: Vec<AssetMoment>,
}

/// One moment of a scene that moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AssetMoment {
    /// Presentation time in the source, seconds.
    pub time_seconds: f64,
    /// The Gaussians that move, as they are then; in a sequence those at rest too.
    pub moving: AssetSplats,
}

/// A file of Gaussians.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AssetSplats {
    /// A `.splat`, which may be empty, or a file of a sequence.
    pub file: String,
    /// Gaussians in it.
    pub splats: u64,
    /// Bytes of the file.
    pub bytes: u64,
    /// SHA-256 of the file.
    pub sha256: String,
}

/// `y = scale R (x - offset)`: from a place of the world to one of the files, whose y points down.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AssetPlacement {
    /// World point that is the origin of the files.
    pub offset: [f64; 3],
    /// Units of the files per unit of the world.
    pub scale: f64,
    /// World to files, a unit quaternion (w, x, y, z).
    pub rotation_wxyz: [f64; 4],
}

/// Changes made for viewers, in Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct AssetChanges {
    /// Left out because their opacity rounds to 0.
    pub transparent: u64,
    /// Thickened to a tenth of their longest axis: half-float covariances of thinner ones have negative
    /// eigenvalues, and viewers leave them out.
    pub thickened: u64,
    /// Pulled in, with their sizes, to three times the scene's radius: viewers sort by depth in 16 bits
    /// over all of it.
    pub pulled_in: u64,
    /// Degree of the spherical harmonics that were left out; 0 where there were none.
    pub dropped_sh_degree: u32,
    /// Largest size is not one that the format holds, and was brought to the nearest.
    #[serde(default)]
    pub clamped_sizes: u64,
    /// Colour, or its change with direction, is not one that the format holds, and was brought to the nearest.
    #[serde(default)]
    pub clamped_colours: u64,
}

impl AssetChanges {
    /// Takes the larger of each count: those of one Gaussian at several moments.
    pub fn merge(&mut self, other: &Self) {
        self.transparent = self.transparent.max(other.transparent);
        self.thickened = self.thickened.max(other.thickened);
        self.pulled_in = self.pulled_in.max(other.pulled_in);
        self.dropped_sh_degree = self.dropped_sh_degree.max(other.dropped_sh_degree);
        self.clamped_sizes = self.clamped_sizes.max(other.clamped_sizes);
        self.clamped_colours = self.clamped_colours.max(other.clamped_colours);
    }

    /// Returns a line for every change that images may show.
    pub fn notes(&self) -> Vec<String> {
        let counted = [
            (
                self.thickened,
                "are thickened to a tenth of their longest axis: viewers leave out thinner ones",
            ),
            (
                self.pulled_in,
                "are pulled in to three times the scene's radius: viewers sort by depth in 16 bits",
            ),
            (
                self.clamped_sizes,
                "are larger or smaller than the format holds, and get the nearest size: another format keeps them (ply)",
            ),
            (
                self.clamped_colours,
                "have colours that the format does not hold, and get the nearest: another format keeps them (ply)",
            ),
        ];
        let mut lines: Vec<String> = (counted.iter())
            .filter(|(count, _)| *count > 0)
            .map(|(count, change)| format!("{count} Gaussians {change}"))
            .collect();
        if self.dropped_sh_degree > 0 {
            lines.push(format!(
                "colours by direction (spherical harmonics of degree {}) are left out: .splat files have one colour per \
                 Gaussian",
                self.dropped_sh_degree
            ));
        }
        lines
    }
}

/// Gaussians of a source that are not valid, counted by what became of them, and statements of the source on all of
/// them that images do not follow.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct InvalidGaussians {
    /// Left out because quaternion, log scales and opacity are 0: the padding of files.
    pub padding: u64,
    /// Left out because their opacity is 0 itself, a logit of minus infinity.
    pub transparent: u64,
    /// Left out because they are farther out, or larger, than f32 can be reckoned with.
    pub out_of_reach: u64,
    /// Drawn without a rotation because their quaternion is 0.
    pub unrotated: u64,
    /// Drawn as thin as f32 allows because an axis has size 0.
    pub flat: u64,
    /// Log scales of a file are all 0 or more and its opacities all in [0, 1], as if `exp` and the sigmoid had
    /// been applied; they were read as if not.
    pub looks_activated: bool,
    /// Made larger and fainter by the 3D filter of Mip-Splatting, which their file has as a property of its own.
    #[serde(default)]
    pub smoothed: u64,
    /// The file states that they were trained with anti-aliasing, which makes those below a pixel fainter. They are
    /// drawn without it.
    #[serde(default)]
    pub is_antialiased: bool,
    /// Properties of a PLY beside those of 3DGS, which were not read: motions, features and other things.
    #[serde(default)]
    pub unread_properties: Vec<String>,
}

/// The page that shows the levels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct AssetPage {
    /// A HTML file.
    pub file: String,
    /// Name of the level inside it; `None` where it holds moments, or none and others open by file or server.
    pub level: Option<String>,
    /// `true` if it holds all moments of a dynamic scene instead of a level.
    #[serde(default)]
    pub holds_moments: bool,
    /// Bytes of the file.
    pub bytes: u64,
}
