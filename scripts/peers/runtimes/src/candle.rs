//! candle: tensors and their convolutions, put together here.

use anyhow::Result;
use candle_core::{Device, Tensor};
use omnilife_networks::Weights;

use crate::{Network, STAGES, samples};

pub fn network() -> Result<Network> {
    let weights = Weights::load("lpips-vgg")?;
    let device = Device::Cpu;
    let (mut inputs, mut layer) = (3, 0);
    let mut stages: Vec<Vec<(Tensor, Tensor)>> = Vec::new();
    for channels in STAGES {
        let mut convolutions = Vec::new();
        for &outputs in channels {
            let shape = [3, 3, inputs, outputs];
            let kernel = weights.tensor(&format!("convolution.{layer}.kernel"), &shape)?;
            let bias = weights.tensor(&format!("convolution.{layer}.bias"), &[outputs])?;
            let kernel = Tensor::from_vec(kernel, shape.as_slice(), &device)?;
            convolutions.push((
                kernel.permute((3, 2, 0, 1))?.contiguous()?,
                Tensor::from_vec(bias, (1, outputs, 1, 1), &device)?,
            ));
            (inputs, layer) = (outputs, layer + 1);
        }
        stages.push(convolutions);
    }
    Ok(Box::new(move |picture| {
        let shape = (1, 3, picture.height, picture.width);
        let mut features = Tensor::from_slice(&picture.values, shape, &device)?;
        let mut found = Vec::new();
        for (index, convolutions) in stages.iter().enumerate() {
            for (kernel, bias) in convolutions {
                features = features.conv2d(kernel, 1, 1, 1, 1)?;
                features = features.broadcast_add(bias)?.relu()?;
            }
            let (_, channels, height, width) = features.dims4()?;
            let values = features.flatten_all()?;
            let (storage, layout) = values.storage_and_layout();
            let candle_core::Storage::Cpu(storage) = &*storage else {
                anyhow::bail!("the features are not on the processor");
            };
            let values = &storage.as_slice::<f32>()?[layout.start_offset()..];
            found.extend(samples(
                [channels, height, width],
                |channel, row, column| values[(channel * height + row) * width + column],
            ));
            if index < 4 {
                features = features.max_pool2d(2)?;
            }
        }
        Ok(found)
    }))
}
