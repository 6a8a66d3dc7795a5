//! Quantized arrays: integers between the bounds of each column.

use serde::{Deserialize, Serialize};

/// Names of arrays.
pub(super) mod columns {
    pub(in super::super) const POSITION: &str = "position";
    pub(in super::super) const SIZE: &str = "size";
    pub(in super::super) const ROTATION: &str = "rotation";
    pub(in super::super) const OPACITY: &str = "opacity";
    pub(in super::super) const COLOUR: &str = "colour";
    pub(in super::super) const HARMONICS: &str = "harmonics";
    pub(in super::super) const VELOCITY: &str = "velocity";
    pub(in super::super) const PEAK: &str = "peak";
    pub(in super::super) const DURATION: &str = "duration";
    pub(in super::super) const OBJECT: &str = "object";

    /// Arrays of every part, with their widths.
    pub(in super::super) const OF_ALL: &[(&str, usize)] = &[
        (POSITION, 3),
        (SIZE, 3),
        (ROTATION, 4),
        (OPACITY, 1),
        (COLOUR, 3),
    ];
    /// Arrays of motions, with their widths.
    pub(in super::super) const OF_TIME: &[(&str, usize)] =
        &[(VELOCITY, 3), (PEAK, 1), (DURATION, 1), (OBJECT, 1)];
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct ArrayHeader {
    pub(super) name: String,
    pub(super) width: usize,
    #[serde(rename = "type")]
    pub(super) kind: Kind,
    #[serde(default, skip_serializing_if = "Map::is_linear")]
    pub(super) map: Map,
    /// Value of the integer 0, one per column; empty for floats.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) low: Vec<f64>,
    /// Value of the largest integer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(super) high: Vec<f64>,
}

/// Storage of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Kind {
    U8,
    U16,
    U24,
    F32,
}

/// Map from a stored value to its meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Map {
    #[default]
    Linear,
    Exp,
}

impl Map {
    fn is_linear(&self) -> bool {
        *self == Self::Linear
    }
}

impl Kind {
    fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U24 => 3,
            Self::F32 => 4,
        }
    }

    /// Returns the largest integer.
    fn most(self) -> f64 {
        match self {
            Self::U8 => 255.0,
            Self::U16 => 65_535.0,
            Self::U24 => 16_777_215.0,
            Self::F32 => 1.0,
        }
    }
}

impl ArrayHeader {
    pub(super) fn check(&self) -> Result<(), String> {
        let bounds = || self.low.iter().zip(&self.high);
        let is_complete = [self.low.len(), self.high.len()] == [self.width; 2]
            && bounds().all(|(low, high)| low <= high && (high - low).is_finite());
        if self.width == 0 || (self.kind != Kind::F32 && !is_complete) {
            return Err(format!(
                "has an array {:?} of width {} without finite bounds for each column",
                self.name, self.width
            ));
        }
        Ok(())
    }

    pub(super) fn bytes(&self, rows: usize) -> u64 {
        let row = (self.width as u64).saturating_mul(self.kind.bytes() as u64);
        row.saturating_mul(rows as u64)
    }

    /// Quantizes rows of `width` finite values, and appends their bytes. Bounds are those of each column.
    pub(super) fn encode(
        name: &str,
        width: usize,
        (kind, map): (Kind, Map),
        values: &[f32],
        bytes: &mut Vec<u8>,
    ) -> Result<Self, String> {
        let stored = |value: f32| match map {
            Map::Linear => f64::from(value),
            Map::Exp => f64::from(value).ln(),
        };
        let mut bounds = vec![(f64::INFINITY, f64::NEG_INFINITY); width];
        for row in values.chunks_exact(width.max(1)) {
            for ((low, high), value) in bounds.iter_mut().zip(row) {
                let value = stored(*value);
                if !value.is_finite() {
                    return Err(format!("has a {name} that is not a finite number"));
                }
                (*low, *high) = (low.min(value), high.max(value));
            }
        }
        if values.is_empty() {
            bounds.fill((0.0, 0.0));
        }
        let columns = bounds.iter().cycle();
        for (value, (low, high)) in values.iter().zip(columns) {
            let share = if high > low {
                (stored(*value) - low) / (high - low)
            } else {
                0.0
            };
            let [a, b, c, _] = ((share * kind.most()).round() as u32).to_le_bytes();
            match kind {
                Kind::U8 => bytes.push(a),
                Kind::U16 => bytes.extend([a, b]),
                Kind::U24 => bytes.extend([a, b, c]),
                Kind::F32 => bytes.extend(value.to_le_bytes()),
            }
        }
        let is_float = kind == Kind::F32;
        let bounds = || bounds.iter().filter(move |_| !is_float);
        Ok(Self {
            name: name.to_owned(),
            width,
            kind,
            map: if is_float { Map::Linear } else { map },
            low: bounds().map(|(low, _)| *low).collect(),
            high: bounds().map(|(_, high)| *high).collect(),
        })
    }

    /// Returns the values of an array's bytes; they may be not finite.
    pub(super) fn decode(&self, bytes: &[u8]) -> Vec<f32> {
        let most = self.kind.most();
        let bounds = self.low.iter().zip(&self.high).cycle();
        let between = |integers: &mut dyn Iterator<Item = u32>| -> Vec<f64> {
            let both = integers.zip(bounds.clone());
            both.map(|(q, (low, high))| low + (high - low) * f64::from(q) / most)
                .collect()
        };
        let values = match self.kind {
            Kind::U8 => between(&mut bytes.iter().map(|&byte| u32::from(byte))),
            Kind::U16 => between(
                &mut (bytes.as_chunks().0.iter()).map(|&pair| u32::from(u16::from_le_bytes(pair))),
            ),
            Kind::U24 => between(
                &mut (bytes.as_chunks().0.iter())
                    .map(|&[a, b, c]| u32::from_le_bytes([a, b, c, 0])),
            ),
            Kind::F32 => (bytes.as_chunks().0.iter())
                .map(|&four| f64::from(f32::from_le_bytes(four)))
                .collect(),
        };
        let meant = |value: f64| match self.map {
            Map::Linear => value as f32,
            Map::Exp => value.exp() as f32,
        };
        values.into_iter().map(meant).collect()
    }
}
