//! `omnilife bench`.

use std::path::PathBuf;

use clap::{Subcommand, ValueEnum};
use omnilife_bench::{
    DEFAULT_MEMORY_BYTES, PROTOCOLS,
    curve::{Clock, Region},
};
use omnilife_schemas::records::PoseAlignment;

use super::{
    bench_run::BenchRunArguments,
    numbers, places,
    poses::PosesConventionArgument,
    reconstruct::{BackendArgument, MethodArguments, size},
    statement::StatementArguments,
};

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum ClockArgument {
    Wall,
    Cpu,
}

impl From<ClockArgument> for Clock {
    fn from(argument: ClockArgument) -> Self {
        match argument {
            ClockArgument::Wall => Self::Wall,
            ClockArgument::Cpu => Self::Cpu,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum RegionArgument {
    Whole,
    Static,
    Dynamic,
}

impl From<RegionArgument> for Region {
    fn from(argument: RegionArgument) -> Self {
        match argument {
            RegionArgument::Whole => Self::Whole,
            RegionArgument::Static => Self::Static,
            RegionArgument::Dynamic => Self::Dynamic,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum AlignmentArgument {
    Similarity,
    Rigid,
}

impl From<AlignmentArgument> for PoseAlignment {
    fn from(argument: AlignmentArgument) -> Self {
        match argument {
            AlignmentArgument::Similarity => Self::Similarity,
            AlignmentArgument::Rigid => Self::Rigid,
        }
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum BenchCommand {
    /// Writes the split of a scene.
    Split {
        /// The scene.json, or its folder.
        #[arg(value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json to write.
        #[arg(long)]
        out: PathBuf,
        /// Protocol: the rules by which frames are split into input and novel views.
        #[arg(long, default_value = PROTOCOLS[0].id)]
        protocol: String,
        /// Gives methods frames of this size: images are resized to fit, never enlarged, and stand in the middle of
        /// black padding. `curate export --split` writes these frames; predictions are scored at the size of the
        /// image in them, with or without the padding, which no score counts.
        #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
        pad_to: Option<[u32; 2]>,
        /// Gives these frames, by their numbers in the scene, in place of those that the protocol spreads evenly
        /// (sparse-panoramas); all others with a pose are predicted.
        #[arg(long, value_name = "FRAMES", value_delimiter = ',',
            value_parser = numbers::whole::<u32>)]
        given: Vec<u32>,
    },
    /// Runs an external method by the commands of its method.toml, and gathers its views for scoring.
    External {
        /// The method.toml.
        method: PathBuf,
        /// The scene.json, or its folder.
        #[arg(long, value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json.
        #[arg(long, value_parser = places::split_file())]
        split: PathBuf,
        /// Folder of the run.
        #[arg(long)]
        out: PathBuf,
        /// Seed that the commands of the method get.
        #[arg(long, default_value_t = 0, value_parser = numbers::whole::<u64>)]
        seed: u64,
        /// Ends well where views cannot be scored; their scores have them as failures either way.
        #[arg(long)]
        accept_failures: bool,
    },
    /// Records that a method failed on a scene; scored, the record is a row of failures.
    Failed {
        /// Name of the method in the tables.
        method: String,
        /// The scene.json, or its folder.
        #[arg(long, value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json.
        #[arg(long, value_parser = places::split_file())]
        split: PathBuf,
        /// Seed of the run that failed.
        #[arg(long, default_value_t = 0, value_parser = numbers::whole::<u64>)]
        seed: u64,
        /// Reason of the failure, in one line of the tables.
        #[arg(long, allow_hyphen_values = true)]
        reason: String,
        /// Folder of the run. Keeps the reason, times and memory of a failure that an external method recorded
        /// there.
        #[arg(long, value_name = "FOLDER")]
        run: Option<PathBuf>,
        /// Folder of the record.
        #[arg(long)]
        out: PathBuf,
    },
    /// Scores tracks of vehicles against true ones: MOTA, IDF1, switches, errors on the ground.
    Tracks {
        /// The tracks.json.
        tracks: PathBuf,
        /// The true tracks, of the same form.
        #[arg(long)]
        truth: PathBuf,
        /// The scene.json, or its folder.
        #[arg(long, value_parser = places::scene_file())]
        scene: PathBuf,
        /// True poses of the scene's frames, in a form of `bench poses`. Paths of a scene posed from its images
        /// alone are brought to their world by the cameras; without true poses such paths are left out.
        #[arg(long, value_name = "FILE")]
        true_poses: Option<PathBuf>,
        /// Direction of the matrices of a .npy file, with camera axes x right, y down, z forward.
        #[arg(long, value_enum, value_name = "CONVENTION", requires = "true_poses")]
        poses_convention: Option<PosesConventionArgument>,
        /// Scores boxes and paths of this class alone, such as vehicle or human. Without it all are matched,
        /// whatever their class.
        #[arg(long)]
        class: Option<String>,
    },
    /// Scores camera poses against those of a scene or against true ones: ATE, RPE, AUC, drift.
    Poses {
        /// The poses: a COLMAP model or its images.txt, a transforms.json, a TUM trajectory (.txt), a poses.json,
        /// a scene.json, or a .npy with a matrix for every frame.
        trajectory: PathBuf,
        /// The scene.json, or its folder. Its poses are the reference.
        #[arg(long, value_parser = places::scene_file())]
        scene: PathBuf,
        /// True poses of the scene's frames, in one of the same forms, as the reference instead.
        #[arg(long)]
        truth: Option<PathBuf>,
        /// Direction of the matrices of a .npy file, with camera axes x right, y down, z forward.
        #[arg(long, value_enum, value_name = "CONVENTION")]
        poses_convention: Option<PosesConventionArgument>,
        /// Motions that bring the trajectory to the reference before its errors are measured.
        #[arg(long, value_enum, default_value_t = AlignmentArgument::Similarity)]
        align: AlignmentArgument,
        /// Writes the scores as a record, too.
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Scores predictions: a run, or folders of files named by frame: 8-bit images
    /// (000004.png), or arrays of values in [0, 1] (000004.npy).
    Score {
        /// The scene.json, or its folder.
        #[arg(long, value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json.
        #[arg(long, value_parser = places::split_file())]
        split: PathBuf,
        /// Folder for the scores.
        #[arg(long)]
        out: PathBuf,
        /// The folder of a run, or the run.json (ours) or external-run.json (an external method's) in it.
        #[arg(long, value_parser = places::run_file(), conflicts_with_all = ["novel_views", "input_views"])]
        run: Option<PathBuf>,
        /// Folder of predicted novel views.
        #[arg(long, required_unless_present_any = ["run", "input_views"])]
        novel_views: Option<PathBuf>,
        /// Folder of predicted input views.
        #[arg(long)]
        input_views: Option<PathBuf>,
        /// Name of the method in the tables.
        #[arg(long, required_unless_present_any = ["run", "about"])]
        method: Option<String>,
        /// Scores as many views at once as fit into this memory, gigabytes.
        #[arg(long, value_name = "GB", default_value_t = DEFAULT_MEMORY_BYTES as f64 / 1e9,
            value_parser = numbers::positive)]
        memory: f64,
        /// Computes these metrics alone, for a quick look: the others are unavailable in the result.
        #[arg(long, value_name = "METRIC", value_delimiter = ',')]
        metrics: Vec<String>,
        /// Computes no metric that needs a network, for a quick look: LPIPS takes most of the time.
        #[arg(long, conflicts_with = "metrics")]
        without_lpips: bool,
        /// Ends well where views could not be scored; the result has them as failures either way.
        #[arg(long)]
        accept_failures: bool,
        #[command(flatten)]
        statement: Box<StatementArguments>,
    },
    /// Checks predictions before they are scored: lists views that are missing, too many, of another size
    /// or depth, black, repeated, the ground truth itself, or of another convention.
    Validate {
        /// Folder of predicted novel views.
        #[arg(required_unless_present_any = ["run", "input_views"])]
        novel_views: Option<PathBuf>,
        /// The scene.json, or its folder.
        #[arg(long, value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json.
        #[arg(long, value_parser = places::split_file())]
        split: PathBuf,
        /// The folder of a run, or the run.json (ours) or external-run.json (an external method's) in it.
        #[arg(long, value_parser = places::run_file(), conflicts_with_all = ["novel_views", "input_views"])]
        run: Option<PathBuf>,
        /// Folder of predicted input views.
        #[arg(long)]
        input_views: Option<PathBuf>,
    },
    /// Compares the scores of two methods, scene by scene and view by view.
    Compare {
        /// Folder with results of the one.
        a: PathBuf,
        /// Folder with results of the other.
        b: PathBuf,
    },
    /// Scores a video without a truth, such as an edited one: T-LPIPS over neighbouring frames, as JSON.
    Video {
        /// Folder of PNG images, frames in natural order of their names: 2 before 10.
        views: PathBuf,
        /// Also scores another video of the same frames, for comparison: a moving camera changes images too.
        #[arg(long, value_name = "VIEWS")]
        reference: Option<PathBuf>,
    },
    /// Runs methods on scenes under protocols, scores them and makes the tables, with intervals.
    Run(BenchRunArguments),
    /// Looks for mistakes of convention: axes, pixel centres, channels, encodings, order of frames.
    ///
    /// `bench validate` and `bench score` look for them too. No score is of a changed view.
    Diagnose {
        /// The scene.json, or its folder.
        #[arg(long, value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json.
        #[arg(long, value_parser = places::split_file())]
        split: PathBuf,
        /// Folder of predicted novel views.
        #[arg(long, required_unless_present = "input_views")]
        novel_views: Option<PathBuf>,
        /// Folder of predicted input views.
        #[arg(long)]
        input_views: Option<PathBuf>,
    },
    /// Writes the method.toml of a published method, to be put into a checkout of its code.
    Adapter {
        /// The method; `bench list` lists them.
        method: String,
        /// The folder of the checkout.
        #[arg(long)]
        out: PathBuf,
    },
    /// Runs stiff and extreme cases and judges images and gradients by an f64 reference.
    ///
    /// Exit code 1 where a case is not as good as it has to be.
    Stability {
        /// Folder for stability.json, stability.csv, stability.md and the plots.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Tests this backend alone [default: the CPU, and the GPU where there is one].
        #[arg(long, value_enum)]
        backend: Option<BackendArgument>,
    },
    /// Error against run time: time to quality, quality after a time, area, Pareto front.
    Curve {
        /// Folders of scores, or the result.json there.
        #[arg(required = true, value_name = "SCORES")]
        runs: Vec<PathBuf>,
        /// Measures wall-clock time, or CPU time, which compares runs on a machine that has other work too.
        #[arg(long, value_enum, default_value_t = ClockArgument::Wall)]
        clock: ClockArgument,
        /// Counts the quality of whole views, or of the static or dynamic region of the scene's masks alone.
        #[arg(long, value_enum, default_value_t = RegionArgument::Whole)]
        region: RegionArgument,
        /// Folder for curves.csv, points.csv and the plots.
        #[arg(long)]
        out: PathBuf,
    },
    /// Trains a method with all components that it uses on a scene and without one after the other, and
    /// scores each: the rows of an ablation.
    Ablate {
        /// The scene.json, or its folder.
        #[arg(value_parser = places::scene_file())]
        scene: PathBuf,
        /// Folder of the runs, their scores and the table.
        #[arg(long)]
        out: PathBuf,
        /// Protocol: the rules by which frames are split and scored.
        #[arg(long, default_value = PROTOCOLS[0].id)]
        protocol: String,
        #[command(flatten)]
        method: Box<MethodArguments>,
        /// Optimizer steps of every run, as many as the published protocol has; schedules scale with
        /// them. `run` and `bench run` have 1500.
        #[arg(long, default_value_t = 30_000, value_parser = numbers::count::<u64>)]
        iterations: u64,
        /// Uses the components of the ablation in the method's publication, and leaves them out one at a time.
        #[arg(long)]
        paper: bool,
    },
    /// Lists the protocols, the metrics and the adapters.
    List {
        /// Prints the list as JSON.
        #[arg(long)]
        json: bool,
    },
}
