//! An atlas in files: its structure in JSON, its textures and parameters as 32-bit words.
//!
//! ```text
//! atlas.bin: f32, little-endian; node by node base colours, base opacities, fields (table, weights) in the
//!            order colour, opacity, flow, view, offsets of the trajectory, what was painted; then the
//!            camera's offsets
//! ```
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::Path;

use omnilife_engine::{
    fields::grid_field::{GridField, GridFieldShape},
    fields::hash_grid::HashGrid,
    parameters::SharedParameters,
    surfaces::texture::Texture,
};
use omnilife_schemas::store::{self, StoreError};
use serde::{Deserialize, Serialize};

use super::{
    clip::UnitClock,
    graph::{Footage, Graph},
    node::{FieldKind, Fields, LearntOffsets, Node, Overlay, Surface},
};

/// The structure's file in a run's folder.
pub const ATLAS_FILE: &str = "atlas.json";
/// The file of textures and parameters.
pub const ATLAS_VALUES_FILE: &str = "atlas.bin";
const SCHEMA: &str = "omnilife/neural-atlas/1";

#[derive(Debug, Serialize, Deserialize)]
struct SavedGraph {
    schema: String,
    clock: UnitClock,
    nodes: Vec<SavedNode>,
    camera: Option<SavedOffsets>,
    footage: Footage,
}

#[derive(Debug, Serialize, Deserialize)]
struct SavedNode {
    id: String,
    surface: Surface,
    colour_texels: [usize; 2],
    opacity_texels: Option<[usize; 2]>,
    colour: Option<GridFieldShape>,
    opacity: Option<GridFieldShape>,
    flow: Option<GridFieldShape>,
    view: Option<GridFieldShape>,
    offsets: Option<SavedOffsets>,
    times: [f64; 2],
    delay: f64,
    painted_texels: Option<[usize; 2]>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct SavedOffsets {
    unit: f64,
    with_rotation: bool,
    values: usize,
}

impl SavedOffsets {
    fn of(offsets: &LearntOffsets) -> Self {
        Self {
            unit: offsets.unit,
            with_rotation: offsets.with_rotation,
            values: offsets.parameters.array.values.len(),
        }
    }
}

/// Writes an atlas into a folder; returns the names of the files.
///
/// # Errors
/// When a file cannot be written.
pub fn write(folder: &Path, graph: &Graph) -> Result<Vec<String>, StoreError> {
    let mut words: Vec<f32> = Vec::new();
    let mut nodes = Vec::with_capacity(graph.nodes.len());
    for node in &graph.nodes {
        words.extend(node.colour.texels.as_flattened());
        if let Some(opacity) = &node.opacity {
            words.extend(opacity.texels.as_flattened());
        }
        for kind in FieldKind::ALL {
            if let Some(field) = node.fields.get(kind) {
                for array in field.arrays() {
                    words.extend(&array.values);
                }
            }
        }
        if let Some(offsets) = &node.offsets {
            words.extend(&offsets.parameters.array.values);
        }
        if let Some(overlay) = &node.overlay {
            words.extend(overlay.texture.texels.as_flattened());
        }
        let shape = |kind| node.fields.get(kind).map(|field| *field.shape());
        nodes.push(SavedNode {
            id: node.id.clone(),
            surface: node.surface.clone(),
            colour_texels: [node.colour.width, node.colour.height],
            opacity_texels: node.opacity.as_ref().map(|t| [t.width, t.height]),
            colour: shape(FieldKind::Colour),
            opacity: shape(FieldKind::Opacity),
            flow: shape(FieldKind::Flow),
            view: shape(FieldKind::View),
            offsets: node.offsets.as_ref().map(SavedOffsets::of),
            times: node.times,
            delay: node.delay,
            painted_texels: node.overlay.as_ref().map(|overlay| {
                let texture = &overlay.texture;
                [texture.width, texture.height]
            }),
        });
    }
    if let Some(offsets) = &graph.camera {
        words.extend(&offsets.parameters.array.values);
    }
    let saved = SavedGraph {
        schema: SCHEMA.to_owned(),
        clock: graph.clock,
        nodes,
        camera: graph.camera.as_ref().map(SavedOffsets::of),
        footage: graph.footage.clone(),
    };
    let values = folder.join(ATLAS_VALUES_FILE);
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    store::write_bytes(&values, &bytes)?;
    let structure = folder.join(ATLAS_FILE);
    let text = serde_json::to_vec_pretty(&saved)
        .map_err(|error| StoreError::write(&structure, std::io::Error::other(error)))?;
    store::write_bytes(&structure, &text)?;
    Ok(vec![ATLAS_FILE.to_owned(), ATLAS_VALUES_FILE.to_owned()])
}

/// Reads the atlas of a folder.
///
/// # Errors
/// When a file is missing, malformed, or not as long as the structure says.
pub fn read(folder: &Path) -> Result<Graph, StoreError> {
    let structure = folder.join(ATLAS_FILE);
    let text = std::fs::read(&structure).map_err(|source| StoreError::read(&structure, source))?;
    let saved: SavedGraph = serde_json::from_slice(&text)
        .map_err(|error| StoreError::malformed(&structure, error.to_string()))?;
    if saved.schema != SCHEMA {
        let reason = format!("is {}, expected {SCHEMA}", saved.schema);
        return Err(StoreError::malformed(&structure, reason));
    }
    let values = folder.join(ATLAS_VALUES_FILE);
    let bytes = std::fs::read(&values).map_err(|source| StoreError::read(&values, source))?;
    let malformed = |reason: &str| StoreError::malformed(&values, reason);
    let (quads, rest) = bytes.as_chunks::<4>();
    let floats: Vec<f32> = quads.iter().map(|quad| f32::from_le_bytes(*quad)).collect();
    if !rest.is_empty() || floats.iter().any(|value| !value.is_finite()) {
        return Err(malformed(
            "is truncated, or holds a number that is not finite",
        ));
    }
    let mut words = Words(&floats);
    let graph = words.graph(saved).ok_or_else(|| {
        malformed("is not as long as the structure beside it says, or the sizes make no sense")
    })?;
    if !words.0.is_empty() {
        return Err(malformed("is longer than the structure beside it says"));
    }
    Ok(graph)
}

/// Cells across the finest level of a grid at most: their numbers, counted up to the next, fit into 32 bits.
const MOST_CELLS: f64 = 1e9;

struct Words<'a>(&'a [f32]);

impl Words<'_> {
    fn take(&mut self, count: usize) -> Option<Vec<f32>> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken.to_vec())
    }

    fn texture<const C: usize>(&mut self, [width, height]: [usize; 2]) -> Option<Texture<C>> {
        let count = width.checked_mul(height).filter(|&count| count > 0)?;
        let values = self.take(count.checked_mul(C)?)?;
        Some(Texture {
            width,
            height,
            texels: values.as_chunks::<C>().0.to_vec(),
        })
    }

    fn field(&mut self, shape: GridFieldShape) -> Option<GridField> {
        let grid = shape.grid;
        let finest_cells = grid.base * grid.growth.powf(grid.levels as f64 - 1.0);
        let is_possible = (2..=4).contains(&grid.dimensions)
            && (1..=32).contains(&grid.levels)
            && grid.log2_entries <= 24
            && grid.base >= 1.0
            && grid.growth >= 1.0
            && finest_cells <= MOST_CELLS
            && (1..=64).contains(&shape.hidden_layers)
            && (1..=4096).contains(&shape.width)
            && (1..=4096).contains(&shape.outputs);
        if !is_possible {
            return None;
        }
        let table = self.take(HashGrid::new(grid).parameter_count())?;
        let weights = self.take(shape.network().weight_count())?;
        Some(GridField::with_parameters(shape, table, weights))
    }

    fn offsets(&mut self, saved: SavedOffsets) -> Option<LearntOffsets> {
        let is_possible = saved.values.is_multiple_of(6) && saved.values >= 18;
        is_possible.then_some(())?;
        Some(LearntOffsets {
            unit: saved.unit,
            with_rotation: saved.with_rotation,
            parameters: SharedParameters::new("trajectories", self.take(saved.values)?),
        })
    }

    fn node(&mut self, saved: SavedNode) -> Option<Node> {
        if let Surface::Plane { trajectory, .. } = &saved.surface {
            let knots = trajectory.positions.len();
            (knots > 0 && knots == trajectory.rotations.len()).then_some(())?;
        }
        let colour = self.texture(saved.colour_texels)?;
        let opacity = optional(saved.opacity_texels, |size| self.texture(size))?;
        let mut fields = Fields::default();
        let shapes = [saved.colour, saved.opacity, saved.flow, saved.view];
        for (kind, shape) in FieldKind::ALL.into_iter().zip(shapes) {
            *fields.slot_mut(kind) = optional(shape, |shape| self.field(shape))?;
        }
        Some(Node {
            id: saved.id,
            surface: saved.surface,
            colour,
            opacity,
            fields,
            offsets: optional(saved.offsets, |offsets| self.offsets(offsets))?,
            times: saved.times,
            delay: saved.delay,
            overlay: optional(saved.painted_texels, |size| {
                let texture = self.texture(size)?;
                Some(Overlay { texture })
            })?,
        })
    }

    fn graph(&mut self, saved: SavedGraph) -> Option<Graph> {
        let nodes = saved.nodes.into_iter().map(|node| self.node(node));
        Some(Graph {
            nodes: nodes.collect::<Option<_>>()?,
            camera: optional(saved.camera, |offsets| self.offsets(offsets))?,
            clock: saved.clock,
            footage: saved.footage,
        })
    }
}

/// Returns `None` for an unreadable value, and `Some(None)` for a missing one.
fn optional<T, U>(value: Option<T>, read: impl FnOnce(T) -> Option<U>) -> Option<Option<U>> {
    match value {
        Some(value) => read(value).map(Some),
        None => Some(None),
    }
}
