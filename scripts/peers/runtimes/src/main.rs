//! LPIPS's VGG, five stages of convolutions, through several runtimes: what they give, and how long
//! they take.
//!
//! `compare-runtimes MODEL.onnx INPUT.f32 WIDTH HEIGHT SAMPLES` loads everything and prints a line
//! with the names of the runtimes; then it answers each line of its input, one of these names, with a
//! line of JSON: wall seconds and processor seconds of one run. Samples of the five feature maps are
//! written to `SAMPLES/<runtime>.f32`. The number of threads is that of rayon, `RAYON_NUM_THREADS`.
//!
//! `scripts/peers/runtimes_report.py` starts it and makes the files.

#[cfg(feature = "candle")]
mod candle;
mod ours;
#[cfg(feature = "rten")]
mod rten;

use std::{
    env, fs,
    io::{BufRead, Write},
    path::PathBuf,
    time::Instant,
};

use anyhow::{Context, Result, bail, ensure};

/// One picture, channel by channel.
pub struct Picture {
    pub values: Vec<f32>,
    pub width: usize,
    pub height: usize,
}

/// Channels of the convolutions of each stage; pictures are halved between stages.
pub const STAGES: [&[usize]; 5] = [
    &[64, 64],
    &[128, 128],
    &[256, 256, 256],
    &[512, 512, 512],
    &[512, 512, 512],
];

/// A runtime with the network in it: gives the samples of all maps.
pub type Network = Box<dyn FnMut(&Picture) -> Result<Vec<f32>>>;

/// How many values of a map are compared, spread over it.
const SAMPLES: usize = 4096;

/// The samples of a map whose value is `at(channel, row, column)`.
pub fn samples(
    [channels, height, width]: [usize; 3],
    at: impl Fn(usize, usize, usize) -> f32,
) -> impl Iterator<Item = f32> {
    (0..SAMPLES).map(move |i| at(i * 7 % channels, i * 13 % height, i * 29 % width))
}

/// Seconds that all threads of this process have computed (Linux, in hundredths).
fn processor_seconds() -> Result<f64> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    let (_, fields) = stat.rsplit_once(')').context("/proc/self/stat")?;
    let fields: Vec<&str> = fields.split_whitespace().collect();
    Ok((fields[11].parse::<f64>()? + fields[12].parse::<f64>()?) / 100.0)
}

fn main() -> Result<()> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [model, input, width, height, folder] = arguments.as_slice() else {
        bail!("usage: compare-runtimes MODEL.onnx INPUT.f32 WIDTH HEIGHT SAMPLES");
    };
    let bytes = fs::read(input)?;
    let picture = Picture {
        values: bytes
            .as_chunks::<4>()
            .0
            .iter()
            .map(|&bytes| f32::from_le_bytes(bytes))
            .collect(),
        width: width.parse()?,
        height: height.parse()?,
    };
    ensure!(
        picture.values.len() == 3 * picture.width * picture.height,
        "{input} is not {width}x{height}"
    );
    let threads = rayon::current_num_threads();
    let mut networks: Vec<(&str, Network)> = vec![
        ("omnilife", ours::network()?),
        #[cfg(feature = "candle")]
        ("candle", candle::network()?),
        #[cfg(feature = "rten")]
        ("rten", rten::network(model, threads)?),
    ];
    let folder = PathBuf::from(folder);
    let mut answers = std::io::stdout();
    let names: Vec<&str> = networks.iter().map(|(name, _)| *name).collect();
    writeln!(answers, "{}", names.join(" "))?;
    answers.flush()?;
    for line in std::io::stdin().lock().lines() {
        let name = line?;
        let Some((_, network)) = networks.iter_mut().find(|(known, _)| *known == name) else {
            bail!("there is no runtime {name}");
        };
        let (begun, before) = (Instant::now(), processor_seconds()?);
        let found = network(&picture).with_context(|| name.clone())?;
        let wall = begun.elapsed().as_secs_f64();
        let processor = processor_seconds()? - before;
        let bytes: Vec<u8> = found.iter().flat_map(|value| value.to_le_bytes()).collect();
        fs::write(folder.join(format!("{name}.f32")), bytes)?;
        writeln!(
            answers,
            r#"{{"wall": {wall:.4}, "processor": {processor:.2}}}"#
        )?;
        answers.flush()?;
    }
    Ok(())
}
