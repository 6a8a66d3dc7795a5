//! glTF in its binary container, with Gaussians in `KHR_gaussian_splatting` (release candidate).
//!
//! The text is the release candidate of 2026 with linear sizes: pull request 2567 of `KhronosGroup/glTF`, in
//! which `README.md` is blob a6b7e656ce. Drafts before it, such as that of commit f966a3fb, had logarithms.
//!
//! A primitive of points has the attributes `POSITION` and, behind `KHR_gaussian_splatting:`, `ROTATION` (x, y,
//! z, w), `SCALE` (standard deviations), `OPACITY` and `SH_DEGREE_l_COEF_n`. Harmonics have the order and the
//! signs of 3DGS. Axes are x left, y up, z forward. All values are written as floats; integers are read too.
//! Nodes may move, rotate and scale their meshes.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

mod document;
mod nodes;

use std::path::Path;

use glam::{DQuat, DVec3};
use omnilife_engine::{
    gaussians::{ActivatedGaussians, MAX_SH_DEGREE, SH_C0, sh_rest_count},
    parameters::ParameterTable,
};
use omnilife_schemas::{records::InvalidGaussians, store::StoreError};
use serde_json::{Map, Value, json};

use self::{
    document::{Column, list},
    nodes::{NodePlace, placed_meshes},
};
use super::{
    axes::{HalfTurn, HarmonicTurn},
    exchange::FileRows,
    validity::FileGaussian,
};
use crate::error::ReconstructError;

const EXTENSION: &str = "KHR_gaussian_splatting";
const MAGIC: [u8; 4] = *b"glTF";
const VERSION: u32 = 2;
const JSON_CHUNK: [u8; 4] = *b"JSON";
const BINARY_CHUNK: [u8; 4] = *b"BIN\0";
/// Types of components.
const BYTE: u64 = 5120;
const UNSIGNED_BYTE: u64 = 5121;
const SHORT: u64 = 5122;
const UNSIGNED_SHORT: u64 = 5123;
const FLOAT: u64 = 5126;
const POINTS: u64 = 0;
const ARRAY_BUFFER: u32 = 34_962;
/// Types of values by the number of their components.
const VALUES: [(usize, &str); 3] = [(1, "SCALAR"), (3, "VEC3"), (4, "VEC4")];

/// Returns the name of an attribute of the extension.
fn named(attribute: &str) -> String {
    format!("{EXTENSION}:{attribute}")
}

/// Returns the name of a coefficient but the constant one, counted over all degrees.
fn harmonic_name(number: usize) -> String {
    let degree = (1..=MAX_SH_DEGREE)
        .find(|degree| number < sh_rest_count(*degree))
        .unwrap_or(MAX_SH_DEGREE);
    let first = sh_rest_count(degree.saturating_sub(1));
    let within = number.saturating_sub(first);
    named(&format!("SH_DEGREE_{degree}_COEF_{within}"))
}

/// A document under construction.
#[derive(Default)]
struct Document {
    attributes: Map<String, Value>,
    accessors: Vec<Value>,
    views: Vec<Value>,
    binary: Vec<u8>,
}

impl Document {
    /// Adds an attribute of floats.
    fn add<const N: usize>(&mut self, name: String, rows: impl Iterator<Item = [f32; N]>) {
        let begin = self.binary.len();
        for row in rows {
            self.binary
                .extend(row.iter().flat_map(|value| value.to_le_bytes()));
        }
        self.add_accessor(name, begin, N, FLOAT);
    }

    /// Adds the appended bytes of the binary part as an attribute.
    fn add_accessor(&mut self, name: String, begin: usize, width: usize, component: u64) {
        let length = self.binary.len().saturating_sub(begin);
        let size = if component == FLOAT { 4 } else { 1 };
        let row = width.saturating_mul(size);
        let count = length.checked_div(row).unwrap_or(0);
        let kind = VALUES.iter().find(|(values, _)| *values == width);
        let kind = kind.map_or("SCALAR", |(_, kind)| *kind);
        let is_normalized = component != FLOAT;
        let view = self.views.len();
        self.views.push(json!({
            "buffer": 0,
            "byteOffset": begin,
            "byteLength": length,
            "target": ARRAY_BUFFER,
        }));
        let number = self.accessors.len();
        self.accessors.push(json!({
            "bufferView": view,
            "componentType": component,
            "normalized": is_normalized,
            "count": count,
            "type": kind,
        }));
        self.attributes.insert(name, json!(number));
    }

    /// Returns the document in its container.
    fn finish(self, bounds: [[f32; 3]; 2]) -> Result<Vec<u8>, String> {
        let Self {
            attributes,
            mut accessors,
            views,
            binary,
        } = self;
        // Bounds of the positions, which come first.
        if let Some(Value::Object(positions)) = accessors.first_mut() {
            let [least, largest] = bounds;
            positions.insert("min".to_owned(), json!(least));
            positions.insert("max".to_owned(), json!(largest));
        }
        let length = binary.len();
        let text = json!({
            "asset": { "version": "2.0", "generator": "omnilife" },
            "extensionsUsed": [EXTENSION],
            "scene": 0,
            "scenes": [{ "nodes": [0] }],
            "nodes": [{ "mesh": 0 }],
            "meshes": [{ "primitives": [{
                "mode": POINTS,
                "attributes": attributes,
                "extensions": { "KHR_gaussian_splatting": {
                    "kernel": "ellipse",
                    "colorSpace": "srgb_rec709_display",
                    "projection": "perspective",
                    "sortingMethod": "cameraDistance",
                } },
            }] }],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{ "byteLength": length }],
        });
        let mut text = text.to_string().into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let whole = [12, 8, text.len(), 8, length];
        let whole = whole.into_iter().fold(0_usize, usize::saturating_add);
        let word = |length: usize| {
            let word = u32::try_from(length).map(u32::to_le_bytes);
            word.map_err(|_| format!("would have {length} bytes, and a GLB has 4 GiB at most"))
        };
        Ok([
            &MAGIC[..],
            &VERSION.to_le_bytes(),
            &word(whole)?,
            &word(text.len())?,
            &JSON_CHUNK,
            &text,
            &word(length)?,
            &BINARY_CHUNK,
            &binary,
        ]
        .concat())
    }
}

/// Writes Gaussians.
pub(super) fn write(gaussians: &ActivatedGaussians) -> Result<Vec<u8>, String> {
    let turn = HalfTurn::ABOUT_Z;
    let mut document = Document::default();
    let places = gaussians.positions.iter().map(|place| turn.place(*place));
    let fold = |from: f32, choose: fn(f32, f32) -> f32| {
        places.clone().fold([from; 3], |bound, place| {
            let ([a, b, c], [x, y, z]) = (bound, place);
            [choose(a, x), choose(b, y), choose(c, z)]
        })
    };
    let bounds = [
        fold(f32::INFINITY, f32::min),
        fold(f32::NEG_INFINITY, f32::max),
    ];
    document.add("POSITION".to_owned(), places);
    let rotations = gaussians.rotations.iter().map(|rotation| {
        let [w, x, y, z] = turn.rotation(*rotation);
        [x, y, z, w]
    });
    document.add(named("ROTATION"), rotations);
    document.add(named("SCALE"), gaussians.scales.iter().copied());
    document.add(
        named("OPACITY"),
        gaussians.opacities.iter().map(|opacity| [*opacity]),
    );
    document.add(
        named("SH_DEGREE_0_COEF_0"),
        gaussians.sh_constant.iter().copied(),
    );
    let rest = sh_rest_count(gaussians.sh_degree);
    for (number, sign) in turn.harmonics().into_iter().enumerate().take(rest) {
        let coefficients = gaussians.sh_rest.iter().skip(number).step_by(rest);
        let coefficients = coefficients.map(|rgb| rgb.map(|value| sign * value));
        document.add(harmonic_name(number), coefficients);
    }
    // Colours for programs without the extension.
    let begin = document.binary.len();
    for (constant, opacity) in gaussians.sh_constant.iter().zip(&gaussians.opacities) {
        let byte = |value: f32| (255.0 * value).round().clamp(0.0, 255.0) as u8;
        let [red, green, blue] = constant.map(|value| byte(0.5 + SH_C0 * value));
        document.binary.extend([red, green, blue, byte(*opacity)]);
    }
    document.add_accessor("COLOR_0".to_owned(), begin, 4, UNSIGNED_BYTE);
    document.finish(bounds)
}

/// Returns the text and the binary part of a file.
fn parts(bytes: &[u8]) -> Result<(&[u8], &[u8]), String> {
    let cut_off = || "is cut off in its header".to_owned();
    let mut rest = bytes;
    let mut word = || {
        let (word, others) = rest.split_first_chunk::<4>()?;
        rest = others;
        Some(*word)
    };
    let (Some(magic), Some(version), Some(length)) = (word(), word(), word()) else {
        return Err(cut_off());
    };
    if magic != MAGIC {
        return Err("is not a GLB: it does not begin with glTF".to_owned());
    }
    let version = u32::from_le_bytes(version);
    if version != VERSION {
        return Err(format!(
            "is a GLB of version {version}, and {VERSION} is read"
        ));
    }
    let length = u32::from_le_bytes(length) as usize;
    if length > bytes.len() {
        return Err(format!(
            "is cut off: {} of {length} bytes are there",
            bytes.len()
        ));
    }
    let mut chunk = |kind: [u8; 4]| -> Result<&[u8], String> {
        let (length, others) = rest.split_first_chunk::<4>().ok_or_else(cut_off)?;
        let (found, others) = others.split_first_chunk::<4>().ok_or_else(cut_off)?;
        if *found != kind {
            let kind = String::from_utf8_lossy(&kind).into_owned();
            return Err(format!(
                "has no {} part where it belongs",
                kind.trim_end_matches('\0')
            ));
        }
        let length = u32::from_le_bytes(*length) as usize;
        let (content, others) = others
            .split_at_checked(length)
            .ok_or("is cut off in its parts")?;
        rest = others;
        Ok(content)
    };
    let text = chunk(JSON_CHUNK)?;
    Ok((text, chunk(BINARY_CHUNK)?))
}

/// Attributes of a primitive.
struct Primitive<'a> {
    places: Column<'a>,
    rotations: Column<'a>,
    sizes: Column<'a>,
    opacities: Column<'a>,
    constant: Column<'a>,
    /// Harmonics of whole degrees.
    harmonics: Vec<Column<'a>>,
    node: NodePlace,
}

impl<'a> Primitive<'a> {
    fn find(
        document: &Value,
        binary: &'a [u8],
        primitive: &Value,
        node: NodePlace,
    ) -> Result<Self, String> {
        let extension = extension(primitive).unwrap_or(&Value::Null);
        if let Some(name) = (extension.get("extensions").and_then(Value::as_object))
            .and_then(|extensions| extensions.keys().next())
        {
            return Err(format!("has Gaussians with {name}, which is not read"));
        }
        for (property, known) in [("kernel", "ellipse"), ("colorSpace", "srgb_rec709_display")] {
            let value = extension.get(property).unwrap_or(&Value::Null);
            if value.as_str() != Some(known) {
                return Err(format!(
                    "has Gaussians of {property} {value}, and {known} is read"
                ));
            }
        }
        let mode = primitive.get("mode").and_then(Value::as_u64);
        if mode != Some(POINTS) {
            return Err("must have Gaussians as points".to_owned());
        }
        let attributes = primitive.get("attributes").unwrap_or(&Value::Null);
        let column = |name: String, width: usize| {
            let accessor = attributes.get(&name);
            let accessor = accessor.ok_or_else(|| format!("has Gaussians without {name}"))?;
            Column::find(document, binary, accessor, width)
        };
        let degree = (0..=MAX_SH_DEGREE).rfind(|degree| {
            let last = sh_rest_count(*degree).checked_sub(1);
            last.is_none_or(|last| attributes.get(harmonic_name(last)).is_some())
        });
        let rest = 0..sh_rest_count(degree.unwrap_or(0));
        let found = Self {
            places: column("POSITION".to_owned(), 3)?,
            rotations: column(named("ROTATION"), 4)?,
            sizes: column(named("SCALE"), 3)?,
            opacities: column(named("OPACITY"), 1)?,
            constant: column(named("SH_DEGREE_0_COEF_0"), 3)?,
            harmonics: rest
                .map(|number| column(harmonic_name(number), 3))
                .collect::<Result<_, _>>()?,
            node,
        };
        let Self {
            places,
            rotations,
            sizes,
            opacities,
            constant,
            harmonics,
            ..
        } = &found;
        let columns = [places, rotations, sizes, opacities, constant];
        let is_even =
            (columns.into_iter().chain(harmonics)).all(|column| column.count == places.count);
        if !is_even {
            return Err("has attributes of Gaussians of different lengths".to_owned());
        }
        Ok(found)
    }

    /// Adds its Gaussians to a table with so many coefficients.
    fn gather(&self, rest: usize, gathered: &mut FileRows<'_>) -> Result<(), String> {
        let turn = HalfTurn::ABOUT_Z;
        let signs = turn.harmonics();
        let node = &self.node;
        let is_turned = node.rotation != DQuat::IDENTITY;
        let node_turn = is_turned.then(|| HarmonicTurn::new(node.rotation));
        let log_scale = node.scale.ln();
        let mut harmonics = Vec::new();
        for index in 0..self.places.count {
            let [x, y, z, w] = self.rotations.row(index);
            let sizes: [f32; 3] = self.sizes.row(index);
            let [opacity] = self.opacities.row(index);
            if sizes.iter().any(|size| *size < 0.0) {
                return Err(format!(
                    "has a negative size at Gaussian {index}: drafts of {EXTENSION} before the sizes were linear had \
                     logarithms, which are not read"
                ));
            }
            if !(0.0..=1.0).contains(&opacity) {
                return Err(format!(
                    "has opacity {opacity} at Gaussian {index}, outside of [0, 1]"
                ));
            }
            let opacity = f64::from(opacity);
            let [x, y, z, w] = [x, y, z, w].map(f64::from);
            let mut rotation = DQuat::from_xyzw(x, y, z, w);
            if is_turned {
                rotation = node.rotation * rotation;
            }
            let DQuat { x, y, z, w } = rotation;
            let place: [f32; 3] = self.places.row(index);
            let place = node.place(DVec3::from_array(place.map(f64::from)));
            let gaussian = FileGaussian {
                position: turn.place(place.as_vec3().to_array()).map(f64::from),
                log_scales: sizes.map(|size| f64::from(size).ln() + log_scale),
                opacity_logit: (opacity / (1.0 - opacity)).ln(),
                quaternion: turn
                    .rotation([w, x, y, z].map(|part| part as f32))
                    .map(f64::from),
            };
            harmonics.clear();
            harmonics.extend(self.harmonics.iter().map(|column| column.row::<3>(index)));
            if let Some(node_turn) = &node_turn {
                node_turn.apply(&mut harmonics);
            }
            for (rgb, sign) in harmonics.iter_mut().zip(signs) {
                *rgb = rgb.map(|value| sign * value);
            }
            // Missing coefficients of a primitive of a lower degree are 0.
            harmonics.resize(rest, [0.0; 3]);
            gathered.push(&gaussian, self.constant.row(index), &harmonics)?;
        }
        Ok(())
    }
}

fn extension(primitive: &Value) -> Option<&Value> {
    primitive.get("extensions")?.get(EXTENSION)
}

/// Returns the primitives with Gaussians in the nodes of a document; all of a document without nodes.
fn primitives<'a>(document: &Value, binary: &'a [u8]) -> Result<Vec<Primitive<'a>>, String> {
    let meshes = list(document, "meshes");
    let placed = if list(document, "nodes").is_empty() {
        let all = 0..meshes.len();
        all.map(|mesh| (mesh, NodePlace::UNMOVED)).collect()
    } else {
        placed_meshes(document)?
    };
    let mut found = Vec::new();
    for (mesh, node) in placed {
        let mesh = meshes
            .get(mesh)
            .ok_or("has a node of a mesh that is not there")?;
        for primitive in list(mesh, "primitives") {
            if extension(primitive).is_some() {
                found.push(Primitive::find(document, binary, primitive, node)?);
            }
        }
    }
    Ok(found)
}

/// Reads Gaussians in units of the file; `path` names it.
pub(super) fn read(
    path: &Path,
    bytes: &[u8],
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let (text, binary) = parts(bytes).map_err(malformed)?;
    let document: Value = serde_json::from_slice(text)
        .map_err(|error| malformed(format!("its JSON part: {error}")))?;
    let primitives = primitives(&document, binary).map_err(malformed)?;
    let counts = primitives.iter().map(|primitive| primitive.places.count);
    let len = counts.fold(0, usize::saturating_add);
    let rest = primitives.iter().map(|primitive| primitive.harmonics.len());
    let rest = rest.max().unwrap_or(0);
    let degree = (0..=MAX_SH_DEGREE).find(|degree| sh_rest_count(*degree) >= rest);
    let mut gathered = FileRows::new(path, len, degree.unwrap_or(MAX_SH_DEGREE), invalid)?;
    for primitive in &primitives {
        primitive.gather(rest, &mut gathered).map_err(malformed)?;
    }
    Ok(gathered.into_table())
}

#[cfg(test)]
mod tests;
