//! Header of Gaussians in time, as `docs/reference/gaussians-in-time.md` specifies it.

use omnilife_engine::gaussians::{MAX_SH_DEGREE, sh_rest_count};
use serde::{Deserialize, Serialize};

use super::{
    arrays::{ArrayHeader, columns},
    tracks::ObjectTrack,
};

pub(super) const FORMAT: &str = "gaussians-in-time";
pub(super) const VERSION: u32 = 1;
/// Length of a unit quaternion that was rounded to few digits.
const LENGTHS: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// Everything but the arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Header {
    pub(super) format: String,
    pub(super) version: u32,
    #[serde(default)]
    pub(super) generator: String,
    #[serde(default)]
    pub(super) units: Units,
    pub(super) frame: Frame,
    pub(super) time: Time,
    pub(super) degree: usize,
    pub(super) parts: Vec<PartHeader>,
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Units {
    #[serde(default)]
    pub(super) length: String,
    #[serde(default)]
    pub(super) time: String,
}

/// Place of the file in the world: `y = scale R (x - origin)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Frame {
    pub(super) up: [f64; 3],
    pub(super) origin: [f64; 3],
    pub(super) scale: f64,
    pub(super) rotation: [f64; 4],
}

/// Time of the file in its source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Time {
    pub(super) begin: f64,
    pub(super) seconds: f64,
    #[serde(default)]
    pub(super) frames: Option<usize>,
}

/// Gaussians with one motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct PartHeader {
    pub(super) count: usize,
    pub(super) motion: Motion,
    pub(super) arrays: Vec<ArrayHeader>,
}

/// A motion; names of its kinds are those of the specification.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub(super) enum Motion {
    /// At rest.
    Static,
    /// A line, with an opacity that depends on time.
    Linear,
    /// A vibration, with an opacity that depends on time.
    Periodic {
        /// Its length, seconds.
        cycle: f64,
        /// Share of the peak opacity at or below which a Gaussian is invisible.
        #[serde(default)]
        least: f32,
    },
    /// With rigid objects.
    Rigid {
        /// The objects.
        objects: Vec<ObjectTrack>,
    },
}

impl Header {
    /// Reads and checks a header. An error is one line.
    pub(super) fn parse(json: &[u8]) -> Result<Self, String> {
        /// Keys that decide whether the others are understood.
        #[derive(Deserialize)]
        struct Tag {
            format: String,
            version: u32,
        }
        let not_json = |error: serde_json::Error| format!("has a malformed header: {error}");
        let tag: Tag = serde_json::from_slice(json).map_err(not_json)?;
        if tag.format != FORMAT || !(1..=VERSION).contains(&tag.version) {
            return Err(format!(
                "is {:?} of version {}, and {FORMAT} of version {VERSION} is read",
                tag.format, tag.version
            ));
        }
        let header: Self = serde_json::from_slice(json).map_err(not_json)?;
        header.check()?;
        Ok(header)
    }

    fn check(&self) -> Result<(), String> {
        let Frame {
            up,
            origin,
            scale,
            rotation,
        } = self.frame;
        let length = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>().sqrt();
        let is_placed = scale.is_finite() && scale > 0.0 && origin.iter().all(|x| x.is_finite());
        if !is_placed || !LENGTHS.contains(&length(&rotation)) || !LENGTHS.contains(&length(&up)) {
            return Err("has a frame without a scale, an origin, unit rotation or up".to_owned());
        }
        let Time { begin, seconds, .. } = self.time;
        if !begin.is_finite() || !seconds.is_finite() || seconds < 0.0 {
            return Err(format!("has a time of {seconds} seconds from {begin}"));
        }
        if self.degree > MAX_SH_DEGREE {
            return Err(format!(
                "has harmonics of degree {}, and {MAX_SH_DEGREE} is the highest",
                self.degree
            ));
        }
        if self.parts.iter().all(|part| part.count == 0) {
            return Err("holds no Gaussians".to_owned());
        }
        let rest = sh_rest_count(self.degree).saturating_mul(3);
        (self.parts.iter().enumerate()).try_for_each(|(number, part)| {
            part.check(rest)
                .map_err(|reason| format!("part {number} {reason}"))
        })
    }

    pub(super) fn count(&self) -> u64 {
        let counts = self.parts.iter().map(|part| part.count as u64);
        counts.fold(0, u64::saturating_add)
    }

    pub(super) fn array_bytes(&self) -> u64 {
        let parts = self.parts.iter();
        let bytes = parts.flat_map(|part| part.arrays.iter().map(|array| array.bytes(part.count)));
        bytes.fold(0, u64::saturating_add)
    }
}

impl PartHeader {
    /// Checks a part of a file whose harmonics have `rest` values per Gaussian but the constant ones.
    fn check(&self, rest: usize) -> Result<(), String> {
        self.motion.check()?;
        for &(name, width) in columns::OF_ALL {
            if self.array(name).is_none_or(|array| array.width != width) {
                return Err(format!("has no array {name} of width {width}"));
            }
        }
        for (number, array) in self.arrays.iter().enumerate() {
            let mut before = self.arrays.iter().take(number);
            if before.any(|other| other.name == array.name) {
                return Err(format!("has two arrays {:?}", array.name));
            }
            array.check()?;
            let further = [(columns::HARMONICS, rest)];
            let mut known = columns::OF_TIME.iter().chain(&further);
            let expected = known.find(|(name, _)| *name == array.name);
            if let Some((_, width)) = expected.filter(|(_, width)| *width != array.width) {
                return Err(format!(
                    "has an array {} of width {}, expected {width}",
                    array.name, array.width
                ));
            }
            if !self.motion.has(&array.name) {
                return Err(format!(
                    "has an array {}, which is not of its motion",
                    array.name
                ));
            }
        }
        match &self.motion {
            Motion::Rigid { .. } if self.array(columns::OBJECT).is_none() => {
                Err("has objects and no array object".to_owned())
            }
            _ => Ok(()),
        }
    }

    fn array(&self, name: &str) -> Option<&ArrayHeader> {
        self.arrays.iter().find(|array| array.name == name)
    }
}

impl Motion {
    fn check(&self) -> Result<(), String> {
        match self {
            Self::Periodic { cycle, least } => {
                if cycle.is_finite() && *cycle > 0.0 && (0.0..1.0).contains(least) {
                    return Ok(());
                }
                Err(format!(
                    "has a cycle of {cycle} s and a least share of {least}"
                ))
            }
            Self::Rigid { objects } if objects.is_empty() => Err("has no objects".to_owned()),
            Self::Rigid { objects } => objects.iter().try_for_each(ObjectTrack::check),
            Self::Static | Self::Linear => Ok(()),
        }
    }

    /// Returns false for arrays of other motions; unknown arrays are skipped.
    fn has(&self, name: &str) -> bool {
        let is_of_time = [columns::VELOCITY, columns::PEAK, columns::DURATION].contains(&name);
        match self {
            Self::Static => !is_of_time && name != columns::OBJECT,
            Self::Linear | Self::Periodic { .. } => name != columns::OBJECT,
            Self::Rigid { .. } => !is_of_time && name != columns::HARMONICS,
        }
    }
}
