//! The network and its encoding as plain f64 loops: the reference for [`passes`](super::passes) and for the
//! parameterizations with a network.

use super::network::NetworkShape;

/// Computes [`encode`](super::encoding::encode) in f64.
pub fn encoded(values: &[f64], octaves: usize) -> Vec<f64> {
    let mut out = values.to_vec();
    for octave in 0..octaves {
        let angles = values.iter().map(|value| value * f64::from(1 << octave));
        out.extend(angles.clone().map(f64::sin));
        out.extend(angles.map(f64::cos));
    }
    out
}

/// Returns the outputs for one row of inputs. `weights` are those of the shape, `shared` the inputs common to
/// all rows.
pub fn outputs(shape: NetworkShape, weights: &[f64], shared: &[f64], row: &[f64]) -> Vec<f64> {
    let mut hidden: Vec<f64> = Vec::new();
    for (index, layer) in shape.layers().iter().enumerate() {
        let mut out = weights[layer.biases()].to_vec();
        out.resize(layer.outputs, 0.0);
        for (inputs, range) in [
            (hidden.as_slice(), layer.hidden_weights()),
            (row, layer.row_weights()),
            (shared, layer.shared_weights()),
        ] {
            let rows = weights[range].chunks_exact(layer.outputs);
            for (input, weights) in inputs.iter().zip(rows) {
                for (sum, weight) in out.iter_mut().zip(weights) {
                    *sum += input * weight;
                }
            }
        }
        if index < shape.depth {
            out.iter_mut().for_each(|value| *value = value.max(0.0));
        }
        hidden = out;
    }
    hidden
}
