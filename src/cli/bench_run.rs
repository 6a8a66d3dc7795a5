//! `omnilife bench run`.

use std::{path::PathBuf, sync::LazyLock};

use clap::{Args, ValueEnum};
use omnilife_reconstruct::methods::METHODS;

use super::{numbers, reconstruct::BackendArgument};

/// Methods of a first benchmark: the default one, and all that need no training.
static DEFAULT_METHODS: LazyLock<String> = LazyLock::new(|| {
    let untrained = METHODS.iter().skip(1).filter(|method| !method.is_trained());
    let methods = METHODS.iter().take(1).chain(untrained);
    let ids: Vec<&str> = methods.map(|method| method.id).collect();
    ids.join(",")
});

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum AidsArgument {
    /// Those that methods have by default, the same in methods of one class.
    Default,
    /// None of them.
    Bare,
    /// All that a method can have, where the scene gives reason for them.
    All,
    /// A row with the default ones and a bare one of each method.
    Both,
}

#[derive(Debug, Args)]
pub(crate) struct BenchRunArguments {
    /// Scenes: scene.json files, or folders that are searched for them.
    #[arg(required = true)]
    pub(crate) scenes: Vec<PathBuf>,
    /// Folder for runs, scores and tables.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Methods by name (`reconstruct methods` lists them), and method.toml files of others.
    #[arg(
        long,
        value_name = "METHOD",
        value_delimiter = ',',
        default_value = DEFAULT_METHODS.as_str()
    )]
    pub(crate) methods: Vec<String>,
    /// Aids of the methods: components that help any method, such as larger steps in short schedules.
    #[arg(long, value_enum, default_value_t = AidsArgument::Default)]
    pub(crate) aids: AidsArgument,
    /// Protocols by name (`bench list` lists them). A scene that is too short for one of them is
    /// refused [default: per-scene, and sparse-interpolation where a scene is long enough].
    #[arg(long, value_name = "PROTOCOL", value_delimiter = ',')]
    pub(crate) protocols: Vec<String>,
    /// Trains each method once per seed; methods without training run once.
    #[arg(long, value_name = "SEED", value_delimiter = ',', default_value = "0",
        value_parser = numbers::whole::<u64>)]
    pub(crate) seeds: Vec<u64>,
    /// Optimizer steps of our methods that train. A first look has 1500 here and in `run`; the
    /// published protocol has the 30000 of `reconstruct train`.
    #[arg(long, default_value_t = 1500, value_parser = numbers::count::<u64>)]
    pub(crate) iterations: u64,
    /// Ends a training after this many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = numbers::positive)]
    pub(crate) budget: Option<f64>,
    /// Trains on the CPU or on a GPU.
    #[arg(long, value_enum, default_value_t = BackendArgument::Cpu)]
    pub(crate) backend: BackendArgument,
    /// Writes event files for TensorBoard here, a folder per training.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) tensorboard: Option<PathBuf>,
    /// Cores of one run. With fewer than the machine has, runs share it, and their times are no
    /// longer comparable [default: all, one run after another].
    #[arg(long, value_name = "N", value_parser = numbers::count::<u32>)]
    pub(crate) unit_cores: Option<u32>,
}
