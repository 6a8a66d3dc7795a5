//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use omnilife_bench::PROTOCOLS;
use omnilife_curate::{CurateSettings, SfmSettings};
use omnilife_reconstruct::methods::{METHODS, MethodRequest};
use omnilife_schemas::records::{Sampling, Verdict};

use crate::exit::BadRequest;

/// Curate 360-degree video, reconstruct it and score it against the OmniLife360 protocol.
#[derive(Debug, Parser)]
#[command(name = "omnilife", version, max_term_width = 100)]
pub(crate) struct Cli {
    /// Prints errors and results only.
    #[arg(long, short, global = true)]
    pub(crate) quiet: bool,
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The main job: from raw 360-degree videos to a scored table.
    // The last of repeated options counts: scripts put their defaults first.
    #[command(args_override_self = true)]
    Run(RunArguments),
    /// Raw video to verified, cut and posed sequences.
    #[command(subcommand)]
    Curate(CurateCommand),
    /// A posed scene to Gaussians and rendered views.
    #[command(subcommand)]
    Reconstruct(ReconstructCommand),
    /// Splits and scores.
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Scores to tables.
    #[command(subcommand)]
    Leaderboard(LeaderboardCommand),
    /// What is installed, and what each missing thing would enable.
    Doctor,
}

#[derive(Debug, Args)]
pub(crate) struct RunArguments {
    /// Videos, or folders of videos.
    #[arg(required = true)]
    pub(crate) videos: Vec<PathBuf>,
    /// Folder for everything that is made.
    #[arg(long)]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) curation: CurationArguments,
    /// Criteria that are evaluated and reported; nothing is rejected by them.
    #[arg(long, default_value = "omnilife360")]
    pub(crate) criteria: String,
    #[command(flatten)]
    pub(crate) poses: PoseArguments,
    #[command(flatten)]
    pub(crate) method: MethodArguments,
    /// Optimizer steps; schedules scale with them. The published protocol is 30000.
    #[arg(long, default_value_t = 1500)]
    pub(crate) iterations: u64,
    /// The rules of splitting and scoring.
    #[arg(long, default_value = PROTOCOLS[0].id)]
    pub(crate) protocol: String,
}

#[derive(Debug, Args)]
pub(crate) struct CurationArguments {
    /// Samples this many frames per second.
    #[arg(long, conflicts_with = "max_frames")]
    pub(crate) fps: Option<f64>,
    /// Samples at most this many frames per sequence, evenly in time.
    #[arg(long, default_value_t = 120)]
    pub(crate) max_frames: u32,
    /// Width of the sampled frames in pixels [default: the video's, at most 1024].
    #[arg(long)]
    pub(crate) width: Option<u32>,
    /// Takes the videos as this kind of picture, whatever the evidence says.
    #[arg(long, value_name = "KIND", value_parser = parse_accept)]
    pub(crate) accept: Option<Verdict>,
    /// Drops shots shorter than this, in seconds.
    #[arg(long, default_value_t = 1.0, value_name = "SECONDS")]
    pub(crate) min_shot: f64,
}

impl CurationArguments {
    /// The settings of the curation, with a profile of criteria.
    pub(crate) fn settings(&self, profile: &str, enforce: bool) -> CurateSettings {
        CurateSettings {
            profile: profile.to_owned(),
            enforce,
            sampling: self.fps.map_or(
                Sampling::MaxFrames(self.max_frames),
                Sampling::FramesPerSecond,
            ),
            width: self.width,
            accept: self.accept,
            minimum_shot_seconds: self.min_shot,
            ..CurateSettings::default()
        }
    }
}

fn parse_accept(text: &str) -> Result<Verdict, String> {
    [Verdict::Erp, Verdict::ErpSqueezed]
        .into_iter()
        .find(|verdict| verdict.name() == text)
        .ok_or_else(|| "only erp and erp-squeezed can be accepted".to_owned())
}

#[derive(Debug, Args)]
pub(crate) struct PoseArguments {
    /// Camera poses: a poses.json or a folder with a COLMAP text model [default: structure from
    /// motion].
    #[arg(long)]
    pub(crate) poses: Option<PathBuf>,
    /// Folder of masks for structure from motion, one per frame; white is left out.
    #[arg(long, conflicts_with = "poses")]
    pub(crate) masks: Option<PathBuf>,
}

impl PoseArguments {
    /// Where poses come from.
    pub(crate) fn request(&self) -> omnilife_curate::PoseRequest {
        self.poses.clone().map_or_else(
            || {
                omnilife_curate::PoseRequest::Sfm(SfmSettings {
                    masks: self.masks.clone(),
                    ..SfmSettings::default()
                })
            },
            omnilife_curate::PoseRequest::Given,
        )
    }
}

#[derive(Debug, Args)]
pub(crate) struct MethodArguments {
    /// Reconstruction method.
    #[arg(long, default_value = METHODS[0].id)]
    pub(crate) method: String,
    /// Ends training after this many seconds, whatever the iterations; schedules shrink to fit.
    #[arg(long, value_name = "SECONDS")]
    pub(crate) budget: Option<f64>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Adds no Gaussians above this number [default: half the pixels of a view].
    #[arg(long)]
    pub(crate) max_gaussians: Option<u64>,
}

impl MethodArguments {
    /// What is asked of the method.
    ///
    /// # Errors
    /// When a number makes no sense.
    pub(crate) fn request(&self, iterations: u64) -> anyhow::Result<MethodRequest> {
        if iterations == 0 || self.max_gaussians == Some(0) {
            return Err(BadRequest("iterations and Gaussians are at least 1".to_owned()).into());
        }
        if self
            .budget
            .is_some_and(|budget| !(budget > 0.0 && budget.is_finite()))
        {
            return Err(BadRequest("a budget is a positive number of seconds".to_owned()).into());
        }
        Ok(MethodRequest {
            iterations,
            budget_seconds: self.budget,
            seed: self.seed,
            maximum_gaussians: self.max_gaussians,
        })
    }
}

#[derive(Debug, Subcommand)]
pub(crate) enum CurateCommand {
    /// Prints what the container and the decoder say about a video, as JSON.
    Probe {
        /// The video.
        video: PathBuf,
    },
    /// Prints whether a video is equirectangular, with evidence, as JSON.
    Verdict {
        /// The video.
        video: PathBuf,
    },
    /// Prints where shots begin and end, as JSON.
    Boundaries {
        /// The video.
        video: PathBuf,
    },
    /// Probe, verdict, boundaries, slices and sampled frames of many videos: a dataset.
    Build {
        /// Videos, or folders of videos.
        #[arg(required = true)]
        videos: Vec<PathBuf>,
        /// Folder of the dataset.
        #[arg(long)]
        out: PathBuf,
        #[command(flatten)]
        curation: CurationArguments,
        /// Criteria that every video must meet: omnilife360 or none.
        #[arg(long, default_value = "omnilife360")]
        criteria: String,
    },
    /// Poses a sequence: writes its scene.json and points.ply.
    Poses {
        /// Folder with a sequence.json.
        sequence: PathBuf,
        #[command(flatten)]
        poses: PoseArguments,
    },
}

#[derive(Debug, Subcommand)]
pub(crate) enum ReconstructCommand {
    /// Trains a method on a scene's input views and renders all views of the split.
    Train {
        /// The scene.json.
        scene: PathBuf,
        /// The split.json.
        #[arg(long)]
        split: PathBuf,
        /// Folder of the run.
        #[arg(long)]
        out: PathBuf,
        #[command(flatten)]
        method: MethodArguments,
        /// Optimizer steps; schedules scale with them.
        #[arg(long, default_value_t = 30_000)]
        iterations: u64,
    },
    /// Lists the methods.
    Methods,
}

#[derive(Debug, Subcommand)]
pub(crate) enum BenchCommand {
    /// Writes the split of a scene.
    Split {
        /// The scene.json.
        scene: PathBuf,
        /// The split.json to write.
        #[arg(long)]
        out: PathBuf,
        /// The rules.
        #[arg(long, default_value = PROTOCOLS[0].id)]
        protocol: String,
    },
    /// Scores predictions: a run, or folders of PNG files named by frame (000004.png).
    Score {
        /// The scene.json.
        #[arg(long)]
        scene: PathBuf,
        /// The split.json.
        #[arg(long)]
        split: PathBuf,
        /// Folder for the scores.
        #[arg(long)]
        out: PathBuf,
        /// The run.json of a run of ours.
        #[arg(long, conflicts_with_all = ["novel_views", "input_views"])]
        run: Option<PathBuf>,
        /// Folder of predicted novel views.
        #[arg(long, required_unless_present_any = ["run", "input_views"])]
        novel_views: Option<PathBuf>,
        /// Folder of predicted input views.
        #[arg(long)]
        input_views: Option<PathBuf>,
        /// Name of the method in the tables.
        #[arg(long, required_unless_present = "run")]
        method: Option<String>,
    },
    /// Lists the protocols and the metrics.
    List,
}

#[derive(Debug, Subcommand)]
pub(crate) enum LeaderboardCommand {
    /// Makes table.md and table.csv from all results in a folder.
    Build {
        /// Folder that is searched for result.json files.
        results: PathBuf,
        /// Folder of the tables.
        #[arg(long)]
        out: PathBuf,
    },
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_last_of_repeated_options_counts() {
        let words = "omnilife run a.mp4 --out o --iterations 1 --iterations 2";
        let cli = Cli::try_parse_from(words.split(' ')).map(|cli| cli.command);
        assert!(
            matches!(&cli, Ok(Command::Run(run)) if run.iterations == 2),
            "{cli:?}"
        );
    }

    #[test]
    fn only_monoscopic_erp_can_be_accepted() {
        assert_eq!(parse_accept("erp"), Ok(Verdict::Erp));
        assert!(parse_accept("eac").is_err());
    }
}
