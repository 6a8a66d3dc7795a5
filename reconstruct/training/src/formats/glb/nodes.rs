//! Nodes of a glTF document: the placement of their meshes.

use glam::{DMat3, DQuat, DVec3};
use serde_json::Value;

use super::document::{list, size};

/// Maximum relative difference between the scales of axes of a uniform scale.
const UNIFORM: f64 = 1e-4;

/// Map from a node to its parent: `x -> scale R x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NodePlace {
    pub(super) rotation: DQuat,
    pub(super) scale: f64,
    pub(super) translation: DVec3,
}

impl NodePlace {
    pub(super) const UNMOVED: Self = Self {
        rotation: DQuat::IDENTITY,
        scale: 1.0,
        translation: DVec3::ZERO,
    };

    /// Returns the placement of a node: its matrix, or its translation, rotation and scale.
    fn of(node: &Value) -> Result<Self, String> {
        let translation = DVec3::from_array(numbers(node, "translation")?.unwrap_or([0.0; 3]));
        let [x, y, z, w] = numbers(node, "rotation")?.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let axes = numbers(node, "scale")?.unwrap_or([1.0; 3]);
        let place = match numbers(node, "matrix")? {
            Some(matrix) => Self::of_matrix(matrix)?,
            None => Self {
                rotation: DQuat::from_xyzw(x, y, z, w).normalize(),
                scale: one_scale(axes)?,
                translation,
            },
        };
        if place.rotation.is_finite() && place.translation.is_finite() && place.scale.is_finite() {
            Ok(place)
        } else {
            Err("has a node whose place is not finite".to_owned())
        }
    }

    /// Splits a matrix, column by column.
    fn of_matrix(matrix: [f64; 16]) -> Result<Self, String> {
        let [a, b, c, _, d, e, f, _, g, h, i, _, x, y, z, _] = matrix;
        let axes = [[a, b, c], [d, e, f], [g, h, i]].map(DVec3::from_array);
        let scale = one_scale(axes.map(DVec3::length))?;
        let [first, second, third] = axes.map(|axis| axis / scale);
        if first.cross(second).distance(third) > 100.0 * UNIFORM {
            return Err("has a node that shears or mirrors, which is not read".to_owned());
        }
        Ok(Self {
            rotation: DQuat::from_mat3(&DMat3::from_cols(first, second, third)).normalize(),
            scale,
            translation: DVec3::new(x, y, z),
        })
    }

    /// Returns the placement of `inner` within this one.
    fn then(&self, inner: &Self) -> Self {
        Self {
            rotation: self.rotation * inner.rotation,
            scale: self.scale * inner.scale,
            translation: self.place(inner.translation),
        }
    }

    pub(super) fn place(&self, point: DVec3) -> DVec3 {
        self.rotation * point * self.scale + self.translation
    }
}

fn one_scale(axes: [f64; 3]) -> Result<f64, String> {
    let [scale, others @ ..] = axes;
    let is_one = others
        .iter()
        .all(|other| (other - scale).abs() <= UNIFORM * scale);
    if scale > 0.0 && is_one {
        Ok(scale)
    } else {
        Err(format!(
            "has a node with scales {axes:?}, and only one positive scale is read"
        ))
    }
}

/// Reads a list of so many numbers.
fn numbers<const N: usize>(node: &Value, name: &str) -> Result<Option<[f64; N]>, String> {
    let Some(value) = node.get(name) else {
        return Ok(None);
    };
    let numbers = list(node, name).iter().map(Value::as_f64);
    let numbers: Option<Vec<f64>> = numbers.collect();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    match numbers {
        Some(numbers) => Ok(Some(numbers)),
        None => Err(format!(
            "has a node of {name} {value}, which is not {N} numbers"
        )),
    }
}

/// Returns the meshes of the nodes, by their numbers, each with its placement in the scene.
pub(super) fn placed_meshes(document: &Value) -> Result<Vec<(usize, NodePlace)>, String> {
    let nodes = list(document, "nodes");
    let mut above = vec![None; nodes.len()];
    for (number, node) in nodes.iter().enumerate() {
        for child in list(node, "children") {
            let child = child.as_u64().and_then(|child| usize::try_from(child).ok());
            let child = child.and_then(|child| above.get_mut(child));
            *child.ok_or("has a node with a child that is not there")? = Some(number);
        }
    }
    let mut meshes = Vec::new();
    for (number, node) in nodes.iter().enumerate() {
        if node.get("mesh").is_none() {
            continue;
        }
        let mut place = NodePlace::of(node)?;
        let mut outer = above.get(number).copied().flatten();
        // A path longer than all nodes is a circle.
        for _ in nodes {
            let Some(number) = outer else { break };
            let node = nodes.get(number).unwrap_or(&Value::Null);
            place = NodePlace::of(node)?.then(&place);
            outer = above.get(number).copied().flatten();
        }
        if outer.is_some() {
            return Err("has nodes that are children of themselves".to_owned());
        }
        meshes.push((size(node, "mesh", 0)?, place));
    }
    Ok(meshes)
}
