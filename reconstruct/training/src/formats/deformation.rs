//! The network of deformable Gaussians as a safetensors file, under the names and in the layout of
//! Deformable-3D-Gaussians in `PyTorch`: `linear.<i>.weight`, `gaussian_warp.weight`, ..., each with a row per
//! output. Inputs are the encoded position, the encoded time and the layer before.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{fs, path::Path};

use omnilife_schemas::store::{self, StoreError};
use safetensors::{Dtype, SafeTensors, tensor::TensorView};

use omnilife_engine::fields::mlp::network::Layer;
use omnilife_engine::gaussians::deformable::{DEFORMATION_WEIGHTS, DeformationModel};
use omnilife_engine::parameters::SharedParameters;

/// The output layer's parts and their columns.
const HEADS: [(&str, std::ops::Range<usize>); 3] = [
    ("gaussian_warp", 0..3),
    ("gaussian_rotation", 3..7),
    ("gaussian_scaling", 7..10),
];

/// A linear layer of the file: its name, its layer in the model, and the range of its outputs.
struct Part {
    name: String,
    layer: Layer,
    outputs: std::ops::Range<usize>,
}

impl Part {
    #[expect(
        clippy::indexing_slicing,
        reason = "the depth was checked, and networks have their heads behind it"
    )]
    fn all(model: &DeformationModel) -> Vec<Self> {
        let layers = model.network().layers();
        let (Some(heads), trunk) = (layers.last(), &layers[..model.depth]) else {
            return Vec::new();
        };
        let trunk = trunk.iter().enumerate().map(|(index, &layer)| Self {
            name: format!("linear.{index}"),
            outputs: 0..layer.outputs,
            layer,
        });
        let heads = HEADS.map(|(name, outputs)| Self {
            name: name.to_owned(),
            layer: *heads,
            outputs,
        });
        trunk.chain(heads).collect()
    }

    /// Indices of the file's weights in the model, in the file's order: output by output.
    #[expect(
        clippy::arithmetic_side_effects,
        reason = "places in weights that are there"
    )]
    fn weights(&self) -> Vec<usize> {
        let layer = &self.layer;
        let inputs: Vec<usize> = [
            layer.row_weights(),
            layer.shared_weights(),
            layer.hidden_weights(),
        ]
        .into_iter()
        .flat_map(|range| range.step_by(layer.outputs))
        .collect();
        let outputs = self.outputs.clone();
        outputs
            .flat_map(|output| inputs.iter().map(move |begin| begin + output))
            .collect()
    }

    #[expect(
        clippy::arithmetic_side_effects,
        reason = "places in weights that are there"
    )]
    fn biases(&self) -> Vec<usize> {
        let begin = self.layer.biases().start;
        self.outputs.clone().map(|output| begin + output).collect()
    }

    /// Returns names, shapes and indices of both tensors.
    fn tensors(&self) -> [(String, Vec<usize>, Vec<usize>); 2] {
        let rows = self.outputs.len();
        [
            (
                format!("{}.weight", self.name),
                vec![rows, self.layer.inputs()],
                self.weights(),
            ),
            (format!("{}.bias", self.name), vec![rows], self.biases()),
        ]
    }
}

/// Writes the weights atomically.
///
/// # Errors
/// When the file cannot be written.
#[expect(clippy::indexing_slicing, reason = "places of the same network")]
pub fn write(
    path: &Path,
    model: &DeformationModel,
    weights: &SharedParameters,
) -> Result<(), StoreError> {
    let failed =
        |error: safetensors::SafeTensorError| StoreError::write(path, std::io::Error::other(error));
    let parts = Part::all(model);
    let tensors: Vec<(String, Vec<usize>, Vec<u8>)> = parts
        .iter()
        .flat_map(Part::tensors)
        .map(|(name, shape, places)| {
            let values = places.iter().map(|&place| weights.array.values[place]);
            (name, shape, values.flat_map(f32::to_le_bytes).collect())
        })
        .collect();
    let views = tensors
        .iter()
        .map(|(name, shape, bytes)| {
            Ok((
                name.clone(),
                TensorView::new(Dtype::F32, shape.clone(), bytes)?,
            ))
        })
        .collect::<Result<Vec<_>, _>>()
        .map_err(failed)?;
    let bytes = safetensors::serialize(views, None).map_err(failed)?;
    store::write_bytes(path, &bytes)
}

/// Reads the weights of a model.
///
/// # Errors
/// When the file is missing, belongs to another network or holds a value that is not finite.
#[expect(clippy::indexing_slicing, reason = "places of the same network")]
pub fn read(path: &Path, model: &DeformationModel) -> Result<SharedParameters, StoreError> {
    let bytes = fs::read(path).map_err(|source| StoreError::read(path, source))?;
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let file = SafeTensors::deserialize(&bytes).map_err(|error| malformed(error.to_string()))?;
    let mut values = vec![0.0; model.network().weight_count()];
    for (name, shape, places) in Part::all(model).iter().flat_map(Part::tensors) {
        let tensor = file
            .tensor(&name)
            .map_err(|error| malformed(format!("{name}: {error}")))?;
        if tensor.dtype() != Dtype::F32 || tensor.shape() != shape {
            return Err(malformed(format!(
                "{name} is {:?} {:?}, expected F32 {shape:?}",
                tensor.dtype(),
                tensor.shape()
            )));
        }
        for (place, bytes) in places.into_iter().zip(tensor.data().as_chunks::<4>().0) {
            let value = f32::from_le_bytes(*bytes);
            if !value.is_finite() {
                return Err(malformed(format!("{name} has a value that is not finite")));
            }
            values[place] = value;
        }
    }
    Ok(SharedParameters::new(DEFORMATION_WEIGHTS, values))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL: DeformationModel = DeformationModel {
        position_octaves: 1,
        time_octaves: 2,
        depth: 3,
        width: 4,
        skip_after: 1,
        length_unit: 2.0,
    };

    #[test]
    fn what_is_written_is_read_back_and_has_pytorchs_layout()
    -> Result<(), Box<dyn std::error::Error>> {
        let count = MODEL.network().weight_count();
        let values: Vec<f32> = (0..count).map(|index| index as f32).collect();
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("deformation.safetensors");
        write(
            &path,
            &MODEL,
            &SharedParameters::new(DEFORMATION_WEIGHTS, values.clone()),
        )?;
        assert_eq!(read(&path, &MODEL)?.array.values, values);

        let bytes = fs::read(&path)?;
        let file = SafeTensors::deserialize(&bytes)?;
        let tensor = file.tensor("linear.2.weight")?;
        // Position 9, time 5, hidden 4.
        assert_eq!(tensor.shape(), [4, 18]);
        let layer = MODEL.network().layers()[2];
        let at = |row: usize, column: usize| {
            let begin = 4 * (18 * row + column);
            f32::from_le_bytes([0, 1, 2, 3].map(|byte| tensor.data()[begin + byte]))
        };
        let row_weights = layer.row_weights().start;
        assert_eq!(
            [at(0, 0), at(1, 0), at(0, 1)],
            [0, 1, 4].map(|n| values[row_weights + n])
        );
        assert_eq!(at(3, 14), values[layer.hidden_weights().start + 3]);
        assert_eq!(file.tensor("gaussian_rotation.bias")?.shape(), [4]);

        let other = DeformationModel { width: 5, ..MODEL };
        let message = read(&path, &other)
            .map(drop)
            .expect_err("another")
            .to_string();
        assert!(message.contains("linear.0.weight"), "{message}");
        Ok(())
    }
}
