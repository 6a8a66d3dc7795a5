//! `omnilife sweep`.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use omnilife_bench::PROTOCOLS;

use super::{curate::CurationSettingsArguments, memory::gibibytes, numbers};

#[derive(Debug, Subcommand)]
pub(crate) enum SweepCommand {
    /// Writes the list of all units of work, which does not change any more.
    #[command(subcommand)]
    Plan(PlanCommand),
    /// Runs missing units on this machine until none is left, and writes SWEEP/units.csv.
    Run(SweepRunArguments),
    /// Prints the counts of units by state, the reasons of failures, and the cost of units.
    Status {
        /// Folder of the sweep.
        sweep: PathBuf,
        /// Prints every unit.
        #[arg(long)]
        units: bool,
        /// Prints the table of all units (CSV) and nothing else.
        #[arg(long, conflicts_with = "units")]
        csv: bool,
        /// Prints counts, costs of the groups and all units as JSON.
        #[arg(long, conflicts_with_all = ["units", "csv"])]
        json: bool,
    },
    /// Marks failed units as missing, so that the next run repeats them.
    Retry {
        /// Folder of the sweep.
        sweep: PathBuf,
        /// Ids of failed units [default: all].
        units: Vec<String>,
    },
    /// Merges the outputs of units: tables, a dataset. Failures are rows.
    Reduce {
        /// Folder of the sweep.
        sweep: PathBuf,
    },
    /// Submits missing units to a cluster.
    Submit(SubmitArguments),
}

#[derive(Debug, Subcommand)]
pub(crate) enum PlanCommand {
    /// One unit per video: `omnilife curate`; reduced to a dataset.
    Curate {
        /// Videos, folders of videos, or folders of still panoramas.
        #[arg(required = true)]
        videos: Vec<PathBuf>,
        /// Folder of the dataset.
        #[arg(long)]
        dataset: PathBuf,
        #[command(flatten)]
        plan: PlanArguments,
        #[command(flatten)]
        settings: CurationSettingsArguments,
    },
    /// One unit per method, scene, seed and protocol: split, training, scores; reduced to tables.
    Bench(BenchPlanArguments),
    /// One unit per line of a file: a command of the shell.
    Commands {
        /// File with a command per line; empty lines and lines that start with # are skipped.
        file: PathBuf,
        #[command(flatten)]
        plan: PlanArguments,
        /// A command of the shell that merges the outputs of the units.
        #[arg(long, value_name = "COMMAND")]
        reduce: Option<String>,
    },
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Units")]
pub(crate) struct PlanArguments {
    /// Folder of the sweep.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Cores that a unit reserves, and threads that it uses.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = numbers::count::<u32>)]
    pub(crate) unit_cores: u32,
    /// Memory that a unit reserves, GiB, until units of its group were measured.
    #[arg(long, default_value = "2", value_name = "GIB", value_parser = gibibytes)]
    pub(crate) unit_memory: u64,
    /// GPUs that a unit reserves.
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = numbers::whole::<u32>)]
    pub(crate) unit_gpus: u32,
    /// Stops a unit after this many seconds, and counts it as failed.
    #[arg(long, value_name = "SECONDS", value_parser = numbers::positive)]
    pub(crate) unit_limit: Option<f64>,
}

#[derive(Debug, Args)]
pub(crate) struct BenchPlanArguments {
    /// Scenes: scene.json files, or folders that are searched for them.
    #[arg(required = true)]
    pub(crate) scenes: Vec<PathBuf>,
    /// Methods: names that `reconstruct methods` lists, or method.toml files.
    #[arg(long, required = true, value_delimiter = ',', value_name = "METHOD")]
    pub(crate) methods: Vec<String>,
    /// Seeds; all scenes with the first seed come before any with the second. Methods without training run
    /// once.
    #[arg(long, default_value = "0", value_delimiter = ',', value_name = "SEED",
        value_parser = numbers::whole::<u64>)]
    pub(crate) seeds: Vec<u64>,
    /// Protocols: the rules by which frames are split and scored.
    #[arg(long, default_value = PROTOCOLS[0].id, value_delimiter = ',', value_name = "PROTOCOL")]
    pub(crate) protocols: Vec<String>,
    /// Folder of the results.
    #[arg(long)]
    pub(crate) results: PathBuf,
    #[command(flatten)]
    pub(crate) plan: PlanArguments,
    /// Options of `reconstruct train` for all methods that are trained, after `--`.
    #[arg(last = true, value_name = "TRAIN OPTIONS")]
    pub(crate) train: Vec<String>,
}

#[derive(Debug, Args)]
pub(crate) struct SweepRunArguments {
    /// Folder of the sweep.
    pub(crate) sweep: PathBuf,
    /// Cores that all units together may use [default: all].
    #[arg(long, value_name = "N", value_parser = numbers::count::<u32>)]
    pub(crate) cores: Option<u32>,
    /// Memory that all units together may use, GiB [default: nine tenths of what is free].
    #[arg(long, value_name = "GIB", value_parser = gibibytes)]
    pub(crate) memory: Option<u64>,
    /// GPUs that units share; each unit gets its own by `CUDA_VISIBLE_DEVICES`.
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = numbers::whole::<u32>)]
    pub(crate) gpus: u32,
    /// Does not wait for units that tasks of Slurm work on.
    #[arg(long)]
    pub(crate) no_wait: bool,
    /// Gives units this many seconds to write their checkpoints when the runner is terminated.
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS",
        value_parser = numbers::not_negative)]
    pub(crate) grace: f64,
    /// Runs one unit: the one at --line of this list, as a task of a job array does.
    #[arg(long, requires = "line", value_name = "FILE")]
    pub(crate) list: Option<PathBuf>,
    /// Line of the list, counted from 0.
    #[arg(long, requires = "list", value_name = "N", value_parser = numbers::whole::<usize>)]
    pub(crate) line: Option<usize>,
    /// Puts the Slurm job back into the queue when SIGUSR1 announces the end of its time.
    #[arg(long, requires = "list")]
    pub(crate) requeue: bool,
}

#[derive(Debug, Args)]
pub(crate) struct SubmitArguments {
    /// Folder of the sweep; every node must see it under the same path.
    pub(crate) sweep: PathBuf,
    /// Submits to Slurm, as job arrays.
    #[arg(long, required = true)]
    pub(crate) slurm: bool,
    /// Runs at most this many tasks at a time.
    #[arg(long, value_name = "N", value_parser = numbers::count::<u32>)]
    pub(crate) throttle: Option<u32>,
    /// Requests this many minutes for a unit, until units of its group were measured.
    #[arg(long, default_value_t = 720, value_name = "MINUTES",
        value_parser = numbers::whole::<u64>)]
    pub(crate) minutes: u64,
    /// Signals a job this many seconds before its time limit, so that it writes a checkpoint.
    #[arg(long, default_value_t = 120, value_name = "SECONDS",
        value_parser = numbers::whole::<u64>)]
    pub(crate) signal_before: u64,
    /// An option of every sbatch, such as --sbatch=--partition=gpu; may be repeated.
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    pub(crate) sbatch: Vec<String>,
    /// Leaves out the job that reduces the results.
    #[arg(long)]
    pub(crate) no_reduce: bool,
    /// Prints the jobs, and submits none.
    #[arg(long)]
    pub(crate) dry_run: bool,
}
