//! rten: a graph from ONNX, with its weights packed beforehand.

use std::sync::Arc;

use anyhow::{Context, Result};
use rten::{ModelOptions, NodeId, RunOptions, ThreadPool};
use rten_tensor::{Layout, Tensor, prelude::*};

use crate::{Network, samples};

pub fn network(model: &str, threads: usize) -> Result<Network> {
    let model = ModelOptions::with_all_ops()
        .prepack_weights(true)
        .load_file(model)?;
    let outputs: Vec<NodeId> = model.output_ids().to_vec();
    let input = *model.input_ids().first().context("no input")?;
    let pool = Arc::new(ThreadPool::with_num_threads(threads));
    Ok(Box::new(move |picture| {
        let shape = [1, 3, picture.height, picture.width];
        let image = Tensor::from_data(shape.as_slice(), picture.values.clone());
        let options = RunOptions::default().with_thread_pool(Some(pool.clone()));
        let maps = model.run(vec![(input, image.view().into())], &outputs, Some(options))?;
        let mut found = Vec::new();
        for map in &maps {
            let values = map.as_tensor_view::<f32>().context("a map is not f32")?;
            let shape = [values.size(1), values.size(2), values.size(3)];
            found.extend(samples(shape, |channel, row, column| {
                values[[0, channel, row, column]]
            }));
        }
        Ok(found)
    }))
}
