//! The record of a SOG, `meta.json`.

use serde::{Deserialize, Serialize};

/// Version that is written and read.
pub(super) const VERSION: u32 = 2;

/// Bounds, codebooks and names of the images.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Record {
    pub(super) version: u32,
    #[serde(default)]
    pub(super) asset: Asset,
    pub(super) count: u64,
    /// True for Gaussians that were trained with anti-aliasing.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) antialias: bool,
    pub(super) means: Means,
    pub(super) scales: CodedValues,
    pub(super) quats: Rotations,
    pub(super) sh0: CodedValues,
    #[serde(rename = "shN", default, skip_serializing_if = "Option::is_none")]
    pub(super) harmonics: Option<Harmonics>,
}

/// The program that wrote a file.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Asset {
    #[serde(default)]
    pub(super) generator: String,
}

/// Positions: bounds of their logarithms, images of the lower and the upper bytes.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Means {
    pub(super) mins: [f64; 3],
    pub(super) maxs: [f64; 3],
    pub(super) files: [String; 2],
}

/// Values of a codebook.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct CodedValues {
    pub(super) codebook: Vec<f32>,
    pub(super) files: [String; 1],
}

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Rotations {
    pub(super) files: [String; 1],
}

/// Harmonics but the constant one: images of the palette and of its row for each Gaussian.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Harmonics {
    /// Rows of the palette.
    pub(super) count: u64,
    /// Their degree.
    pub(super) bands: usize,
    pub(super) codebook: Vec<f32>,
    pub(super) files: [String; 2],
}

#[derive(Deserialize)]
struct Tag {
    version: Option<u32>,
}

impl Record {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let malformed = |error: serde_json::Error| format!("has a malformed record: {error}");
        let tag: Tag = serde_json::from_slice(bytes).map_err(malformed)?;
        // The first version had no number.
        let version = tag.version.unwrap_or(1);
        if version != VERSION {
            return Err(format!(
                "is SOG of version {version}, and {VERSION} is read"
            ));
        }
        serde_json::from_slice(bytes).map_err(malformed)
    }
}
