//! Roads from panoramas to poses, and the configurations of COLMAP on each.

use std::path::Path;

use omnilife_schemas::{layout::SEQUENCE_FILE, records::Sequence};
use serde::{Deserialize, Serialize};

use super::SfmSettings;
use crate::error::CurateError;

/// Road from panoramas to poses. The names but the first are those of the script.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Road {
    /// All roads in the order of [`FALLBACK_CONFIGURATIONS`], until poses are valid.
    #[default]
    Auto,
    /// Features of the panorama itself, mapped with a spherical camera. Perspective frames have this road alone.
    Spherical,
    /// Features of a cube's overlapping faces, put back on the sphere and mapped with a spherical camera.
    Mixed,
    /// Overlapping perspective faces, mapped as a rig of cameras with known rotations.
    Faces,
}

impl Road {
    /// Returns the name in records and arguments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Spherical => "spherical",
            Self::Mixed => "mixed",
            Self::Faces => "faces",
        }
    }
}

/// A configuration of COLMAP.
#[derive(Debug, Clone, Copy)]
pub struct Configuration {
    /// Unique id, recorded with the attempt.
    pub id: &'static str,
    /// Its effect and its use.
    pub summary: &'static str,
    pub(super) road: Road,
    pub(super) mapper: &'static str,
    pub(super) features: u32,
    pub(super) overlap: u32,
}

/// Configurations in the order in which they are tried. A comparison runs the first one of every road.
pub static FALLBACK_CONFIGURATIONS: &[Configuration] = &[
    Configuration {
        id: "global",
        summary: "Global mapping: all rotations, then all positions, at once.",
        road: Road::Spherical,
        mapper: "global",
        features: 8192,
        overlap: 10,
    },
    Configuration {
        id: "mixed",
        summary: "Global mapping of panoramas with features that were found on the faces of a cube.",
        road: Road::Mixed,
        mapper: "global",
        features: 8192,
        overlap: 10,
    },
    Configuration {
        id: "incremental",
        summary: "Incremental mapping that may start on forward motion, with more features.",
        road: Road::Spherical,
        mapper: "incremental",
        features: 12288,
        overlap: 15,
    },
    Configuration {
        id: "faces",
        summary: "Global mapping of twelve perspective faces as a rig.",
        road: Road::Faces,
        mapper: "global",
        features: 8192,
        overlap: 10,
    },
];

/// Returns the configurations that the settings ask for, in their order.
///
/// # Errors
/// When the frames are not panoramas and a road of panoramas, or a comparison of roads, is asked for.
pub(super) fn configurations(
    folder: &Path,
    sequence: &Sequence,
    settings: &SfmSettings,
) -> Result<Vec<&'static Configuration>, CurateError> {
    if sequence.is_pinhole() {
        if settings.compare || settings.road != Road::Auto {
            return Err(CurateError::input(
                &folder.join(SEQUENCE_FILE),
                "its frames must be panoramas for --road and --compare, got perspective frames",
            ));
        }
        return Ok(of_road(Road::Spherical).collect());
    }
    if settings.compare {
        let roads = [Road::Spherical, Road::Mixed, Road::Faces];
        return Ok(roads
            .into_iter()
            .filter_map(|road| of_road(road).next())
            .collect());
    }
    Ok(match settings.road {
        Road::Auto => FALLBACK_CONFIGURATIONS.iter().collect(),
        road => of_road(road).collect(),
    })
}

fn of_road(road: Road) -> impl Iterator<Item = &'static Configuration> {
    FALLBACK_CONFIGURATIONS
        .iter()
        .filter(move |configuration| configuration.road == road)
}
