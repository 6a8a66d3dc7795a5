//! tract: a graph from ONNX, optimized and planned.

use anyhow::Result;
use tract_linalg::multithread::{Executor, multithread_tract_scope};
use tract_onnx::prelude::*;

use crate::{Network, samples};

pub fn network(model: &str, threads: usize) -> Result<Network> {
    let plan = tract_onnx::onnx()
        .model_for_path(model)?
        .into_optimized()?
        .into_runnable()?;
    let executor = if threads == 1 {
        Executor::SingleThread
    } else {
        Executor::multithread(threads)
    };
    Ok(Box::new(move |picture| {
        let shape = [1, 3, picture.height, picture.width];
        let input = Tensor::from_shape(&shape, &picture.values)?;
        let maps = multithread_tract_scope(executor.clone(), || plan.run(tvec!(input.into())))?;
        let mut found = Vec::new();
        for map in &maps {
            let values = map.to_plain_array_view::<f32>()?;
            let shape = [values.shape()[1], values.shape()[2], values.shape()[3]];
            found.extend(samples(shape, |channel, row, column| {
                values[[0, channel, row, column]]
            }));
        }
        Ok(found)
    }))
}
