//! The convolutions of the crate `networks`, as LPIPS puts them together, on whole pictures.

use anyhow::Result;
use omnilife_networks::{Convolution, Features, Kernel, Weights};

use crate::{Network, STAGES, samples};

pub fn network() -> Result<Network> {
    let weights = Weights::load("lpips-vgg")?;
    let (mut inputs, mut layer) = (3, 0);
    let mut stages: Vec<Vec<Convolution>> = Vec::new();
    for channels in STAGES {
        let mut convolutions = Vec::new();
        for &outputs in channels {
            let kernel = Kernel {
                side: 3,
                stride: 1,
                padding: 1,
                inputs,
                outputs,
            };
            convolutions.push(Convolution::load(
                &weights,
                &format!("convolution.{layer}"),
                kernel,
            )?);
            (inputs, layer) = (outputs, layer + 1);
        }
        stages.push(convolutions);
    }
    let mut buffers = [0; 3].map(|_| Features::zeros(0, 0, 0, 0));
    Ok(Box::new(move |picture| {
        let [features, next, pooled] = &mut buffers;
        let pixels = picture.width * picture.height;
        pooled.reshape(1, picture.height, picture.width, 3);
        for (index, value) in pooled.data.iter_mut().enumerate() {
            *value = picture.values[index % 3 * pixels + index / 3];
        }
        let mut found = Vec::new();
        for (index, convolutions) in stages.iter().enumerate() {
            for (number, convolution) in convolutions.iter().enumerate() {
                let source = if number == 0 { &*pooled } else { &*features };
                convolution.apply_rectified_into(source, next);
                std::mem::swap(features, next);
            }
            let shape = [features.channels, features.height, features.width];
            found.extend(samples(shape, |channel, row, column| {
                features.data[(row * shape[2] + column) * shape[0] + channel]
            }));
            if index < 4 {
                pooled.reshape(1, shape[1] / 2, shape[2] / 2, shape[0]);
                features.max_pool_rows(0..shape[1], [2, 2], pooled, 0);
            }
        }
        Ok(found)
    }))
}
