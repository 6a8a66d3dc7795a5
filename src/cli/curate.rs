//! `omnilife curate`.

use std::path::PathBuf;

use clap::{ArgMatches, Args, FromArgMatches, Subcommand, ValueEnum};
use omnilife_curate::{CurateSettings, FrameSelection, LayoutChoice, slicing::SliceSettings};
use omnilife_schemas::{
    provenance::Hardware,
    records::{Sampling, VideoProjection},
};

use super::{
    attach::AttachArguments,
    dataset::{
        AnnotateArguments, ExportArguments, ImportArguments, MasksArguments, PublishArguments,
        SelectArguments, SliceArguments,
    },
    ledger::LedgerCommand,
    memory::gibibytes,
    places,
    poses::{MovingMasksArgument, PoseArguments, TruthArguments},
    tracks::TrackArguments,
};

#[derive(Debug, Args)]
#[command(next_help_heading = "Sampling and shots")]
pub(crate) struct CurationArguments {
    /// Samples this many frames per second.
    #[arg(long, conflicts_with = "max_frames")]
    pub(crate) fps: Option<f64>,
    /// Samples at most this many frames per sequence, evenly in time.
    #[arg(long, default_value_t = 120)]
    pub(crate) max_frames: u32,
    /// Takes the frames nearest to the instants of the sampling (even), or the sharpest ones near them (sharp).
    #[arg(long, value_enum, value_name = "FRAMES", default_value_t = SelectionArgument::Even)]
    pub(crate) select: SelectionArgument,
    /// Width of the sampled frames in pixels [default: the video's, at most 1024].
    #[arg(long)]
    pub(crate) width: Option<u32>,
    /// Takes the videos as this projection, and skips its detection.
    #[arg(long, value_name = "KIND", value_parser = parse_accept)]
    pub(crate) accept: Option<VideoProjection>,
    /// Takes the videos as pinhole (ordinary perspective ones, whose frames make pinhole scenes) or as spheres
    /// stored otherwise than equirectangular, whose frames are converted: stereo-top-bottom, stereo-left-right (the
    /// left eye), half-erp, half-erp-left-right, half-erp-top-bottom (VR180; what is behind is ignored), eac, cubemap-3x2, cubemap-6x1, cubemap-1x6 (:rludfb says which face lies where), dual-fisheye
    /// (:190 is the field of view in degrees; without it, it is found by what both lenses see) [default: stereo and stated eac and VR180 are seen, others never guessed].
    #[arg(long, value_name = "KIND", conflicts_with = "accept", value_parser = parse_projection)]
    pub(crate) projection: Option<ProjectionArgument>,
    /// Drops shots shorter than this, in seconds.
    #[arg(long, default_value_t = 1.0, value_name = "SECONDS")]
    pub(crate) min_shot: f64,
    #[command(flatten)]
    pub(crate) detector: DetectorArguments,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum SelectionArgument {
    Even,
    Sharp,
}

impl From<SelectionArgument> for FrameSelection {
    fn from(argument: SelectionArgument) -> Self {
        match argument {
            SelectionArgument::Even => Self::Even,
            SelectionArgument::Sharp => Self::Sharp,
        }
    }
}

/// What the user says that videos show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum ProjectionArgument {
    Pinhole,
    Sphere(LayoutChoice),
}

impl ProjectionArgument {
    /// As it is given.
    fn text(self) -> String {
        match self {
            Self::Pinhole => "pinhole".to_owned(),
            Self::Sphere(layout) => layout.to_string(),
        }
    }
}

fn parse_projection(text: &str) -> Result<ProjectionArgument, String> {
    if text == "pinhole" {
        return Ok(ProjectionArgument::Pinhole);
    }
    text.parse().map(ProjectionArgument::Sphere)
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
            select: self.select.into(),
            width: self.width,
            accept: match self.projection {
                Some(ProjectionArgument::Pinhole) => Some(VideoProjection::Rectilinear),
                _ => self.accept,
            },
            layout: match self.projection {
                Some(ProjectionArgument::Sphere(layout)) => Some(layout),
                _ => None,
            },
            minimum_shot_seconds: self.min_shot,
            detector: self.detector.detector.clone(),
            slices: None,
        }
    }
}

fn parse_accept(text: &str) -> Result<VideoProjection, String> {
    [VideoProjection::Erp, VideoProjection::ErpSqueezed]
        .into_iter()
        .find(|projection| projection.name() == text)
        .ok_or_else(|| "only erp and erp-squeezed can be accepted".to_owned())
}

#[derive(Debug, Args)]
pub(crate) struct DetectorArguments {
    /// How boundaries are found: histogram, transnetv2 (scripts/setup --models), or indoor-outdoor, which
    /// looks for nothing else.
    #[arg(long, default_value = omnilife_curate::boundaries::DEFAULT_DETECTOR)]
    pub(crate) detector: String,
}

#[derive(Debug, Subcommand)]
pub(crate) enum CurateCommand {
    /// Prints what the container and the decoder say about a video, as JSON.
    Probe {
        /// The video.
        video: PathBuf,
    },
    /// Prints whether a video is equirectangular, with evidence, as JSON.
    Projection {
        /// The video.
        video: PathBuf,
    },
    /// Prints where shots begin and end, as JSON.
    Boundaries {
        /// The video.
        video: PathBuf,
        #[command(flatten)]
        detector: DetectorArguments,
        /// Also writes the detector's signals, one row per frame, as a Parquet table.
        #[arg(long, value_name = "FILE")]
        signals: Option<PathBuf>,
    },
    /// Who said what about the boundaries of a curated video, and what follows.
    #[command(subcommand)]
    Ledger(LedgerCommand),
    /// Writes a page on which people play a small copy of a video, mark and label its segments, and
    /// decide on its boundaries; its file goes into the ledger.
    Audit {
        /// Folder of a curated video: DATASET/videos/NAME.
        #[arg(value_parser = places::video_folder())]
        folder: PathBuf,
        /// The video it was curated from.
        #[arg(long)]
        video: PathBuf,
        /// Taxonomy file with the scenes and actions to choose from [default: the built-in one].
        #[arg(long, value_name = "FILE")]
        taxonomy: Option<PathBuf>,
        /// The page.
        #[arg(long, default_value = "audit.html")]
        out: PathBuf,
    },
    /// Probe, projection, boundaries, slices and sampled frames of many videos: a dataset. The same as
    /// `omnilife curate VIDEOS`.
    Build(BuildArguments),
    /// Curates one video into its folder in a dataset, as a unit of a sweep does; `omnilife curate`
    /// makes a dataset of such folders.
    Video {
        /// The video.
        video: PathBuf,
        /// Its folder: DATASET/videos/NAME.
        #[arg(long)]
        folder: PathBuf,
        #[command(flatten)]
        settings: CurationSettingsArguments,
    },
    /// Curates the video that is described on standard input: the process that `omnilife curate` and
    /// `omnilife run` start for every video.
    #[command(hide = true)]
    Worker,
    /// Writes one segment of a video as mp4, frame-accurately and marked as 360-degree video.
    Slice(SliceArguments),
    /// Enters tags and captions of people or programs, and measures how sequences move.
    Annotate(AnnotateArguments),
    /// Poses a sequence: writes its scene.json and points.ply.
    Poses {
        /// Folder with a sequence.json.
        #[arg(value_parser = places::sequence_folder())]
        sequence: PathBuf,
        #[command(flatten)]
        poses: PoseArguments,
        /// Takes every road, prints a table of them, and keeps the poses that predict the other roads' matches best.
        #[arg(
            long,
            help_heading = "Camera poses",
            conflicts_with_all = ["poses", "road"]
        )]
        compare: bool,
        #[command(flatten)]
        masks: MovingMasksArgument,
        #[command(flatten)]
        truth: TruthArguments,
    },
    /// Attaches masks, distances and poses to a scene, curated or imported; what it has of the same kind is replaced.
    Attach(AttachArguments),
    /// Masks what moves in a sequence; `omnilife curate poses --masks` takes the result.
    Masks(MasksArguments),
    /// Looks for the operator, a mount or a helmet in a sequence: what stays in the camera's frame while the scene goes
    /// by. Its mask is for `omnilife curate poses --ignore-mask`.
    Operator {
        /// Folder with a sequence.json.
        sequence: PathBuf,
        /// Also looks for people who keep their place in the frame, by the network of `curate masks --method deeplab`.
        #[arg(long)]
        people: bool,
        /// Also looks for caps around the poles that stay: a tripod below a camera that turns, a flat gap between lenses.
        /// Off by default, because its limits are not measured on labels.
        #[arg(long)]
        caps: bool,
    },
    /// Measures the distances of a posed pinhole scene by stereo: dense points, which tracks and training
    /// then begin with, and distances per frame.
    Dense {
        /// Folder with a scene.json.
        #[arg(value_parser = places::scene_folder())]
        scene: PathBuf,
        /// A split.json: its input views alone are looked at, and the result goes into dense/ beside it.
        #[arg(long)]
        split: Option<PathBuf>,
        /// Frames that are wider are searched at this width, pixels.
        #[arg(long, value_name = "PIXELS", default_value_t = omnilife_tracks::dense::SEARCH_WIDTH)]
        width: u32,
        /// Folder of the result [default: dense/ beside the split, else in the scene].
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Tracks what moves through a posed scene: tracks.json, and tracks.html and tracks.mp4 to look at.
    // In `run`, --detector is that of shot boundaries.
    #[command(
        mut_arg("vehicle_detector", |option| option.visible_alias("detector")),
        mut_arg("every_frame", |option| option.requires("video"))
    )]
    Tracks {
        /// Folder with a scene.json.
        #[arg(value_parser = places::scene_folder())]
        scene: PathBuf,
        /// A split.json: its input views alone are looked at, and the result goes beside it.
        #[arg(long)]
        split: Option<PathBuf>,
        #[command(flatten)]
        tracking: TrackArguments,
        /// The scene's video, for --every-frame. Boxes of --detections then have the numbers of its frames.
        #[arg(long, value_name = "FILE", requires = "every_frame")]
        video: Option<PathBuf>,
        /// Also writes the tracks for traffic tools: mot (boxes), speeds (CSV with speed and heading), geojson,
        /// orthophoto (the ground without moving vehicles).
        #[arg(long, value_name = "FORMAT", value_delimiter = ',')]
        export: Vec<String>,
        /// Positions of a drone in the subtitles (.SRT) of its video; with them, or with positions of stills in
        /// EXIF, exports have places on the Earth, and georeference.json the similarity with its residuals.
        #[arg(long, value_name = "FILE.srt")]
        telemetry: Option<PathBuf>,
        /// Says what is used, what is left out and on what evidence, and writes no tracks; the frames are looked
        /// at for it.
        #[arg(long)]
        plan: bool,
        /// Folder of the result [default: that of the split, else of the scene].
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Writes a scene in another tool's format.
    Export(ExportArguments),
    /// Makes a scene of a folder in another tool's format.
    Import(ImportArguments),
    /// Writes statistics, figures, card and checksums of a dataset.
    Publish(PublishArguments),
    /// Selects a subset that is like the whole dataset, and says how it compares.
    Select(SelectArguments),
    /// Prints what each sequence has and lacks, and the commands that make it.
    Status {
        /// Folder of a dataset, or of imported scenes.
        #[arg(value_parser = places::dataset_folder())]
        dataset: PathBuf,
        /// Prints it as JSON, with commands to be run in that folder.
        #[arg(long)]
        json: bool,
    },
    /// Writes a page to look at: contact sheets with masks, camera paths, coverage of the sphere, losses, statistics,
    /// and what is missing.
    Overview {
        /// Folder of a dataset, or of imported scenes.
        #[arg(value_parser = places::dataset_folder())]
        dataset: PathBuf,
    },
    /// Checks a published dataset: checksums, records, durations, statistics.
    Verify {
        /// Folder of the dataset.
        dataset: PathBuf,
    },
}

#[derive(Debug, Args)]
pub(crate) struct BuildArguments {
    /// Videos, folders of videos, or folders of still panoramas.
    #[arg(required = true)]
    pub(crate) videos: Vec<PathBuf>,
    /// Folder of the dataset.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Where the videos came from: CSV with the columns file, url, uploader, licence, date, keywords (between
    /// semicolons) and kind (web, own-capture), or a JSON list of such rows; it is kept by later runs.
    #[arg(long, value_name = "LIST")]
    pub(crate) sources: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) settings: CurationSettingsArguments,
    #[command(flatten)]
    pub(crate) limit: MemoryLimitArguments,
}

/// What the process that curates a video may use.
#[derive(Debug, Args)]
#[command(next_help_heading = "Limits")]
pub(crate) struct MemoryLimitArguments {
    /// Memory that curating one video may take, GiB; a video that asks for more has failed, and the
    /// others go on (Linux) [default: three quarters of the machine's].
    #[arg(long, value_name = "GIB", value_parser = gibibytes)]
    pub(crate) memory: Option<u64>,
}

impl MemoryLimitArguments {
    /// In bytes; `None` where none is given and the machine does not tell how much it has.
    pub(crate) fn bytes(&self) -> Option<u64> {
        self.memory
            .or_else(|| Hardware::here().memory_bytes.map(|bytes| bytes / 4 * 3))
    }
}

/// What holds for every video of a dataset.
#[derive(Debug, Args)]
pub(crate) struct CurationSettingsArguments {
    #[command(flatten)]
    pub(crate) curation: CurationArguments,
    /// Criteria that every video must meet: omnilife360, none, or a .toml file of thresholds.
    #[arg(long, default_value = omnilife_curate::criteria::PROFILES[0].id)]
    pub(crate) criteria: String,
    /// Also writes every sequence as mp4.
    #[arg(long)]
    pub(crate) slices: bool,
    /// Copies the sound into the slices.
    #[arg(long, requires = "slices")]
    pub(crate) audio: bool,
}

impl CurationSettingsArguments {
    /// The settings of the curation.
    pub(crate) fn settings(&self) -> CurateSettings {
        CurateSettings {
            slices: self.slices.then_some(SliceSettings { audio: self.audio }),
            ..self.curation.settings(&self.criteria, true)
        }
    }

    /// The arguments of a command line that says the same.
    pub(crate) fn words(&self) -> Vec<String> {
        let CurationArguments {
            fps,
            max_frames,
            select,
            width,
            accept,
            projection,
            min_shot,
            detector,
        } = &self.curation;
        let sampling = match fps {
            Some(fps) => ("--fps", fps.to_string()),
            None => ("--max-frames", max_frames.to_string()),
        };
        let mut words = Vec::new();
        let options = [
            Some(sampling),
            (*select == SelectionArgument::Sharp).then(|| ("--select", "sharp".to_owned())),
            width.map(|width| ("--width", width.to_string())),
            accept.map(|projection| ("--accept", projection.name().to_owned())),
            projection.map(|projection| ("--projection", projection.text())),
            Some(("--min-shot", min_shot.to_string())),
            Some(("--detector", detector.detector.clone())),
            Some(("--criteria", self.criteria.clone())),
        ];
        for (option, value) in options.into_iter().flatten() {
            words.extend([option.to_owned(), value]);
        }
        let flags = [("--slices", self.slices), ("--audio", self.audio)];
        words.extend(
            flags
                .iter()
                .filter(|flag| flag.1)
                .map(|flag| flag.0.to_owned()),
        );
        words
    }
}

/// `omnilife curate`, with one of its commands or with what `build` takes.
#[derive(Debug)]
pub(crate) struct CurateArguments {
    /// The command that was given, or `build`.
    pub(crate) command: CurateCommand,
}

// Derived, an optional set of arguments that holds another set is never taken for given.
impl FromArgMatches for CurateArguments {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let command = if matches.subcommand_name().is_some() {
            CurateCommand::from_arg_matches(matches)?
        } else {
            CurateCommand::Build(BuildArguments::from_arg_matches(matches)?)
        };
        Ok(Self { command })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Args for CurateArguments {
    fn augment_args(command: clap::Command) -> clap::Command {
        CurateCommand::augment_subcommands(BuildArguments::augment_args(command))
            .args_conflicts_with_subcommands(true)
            .subcommand_negates_reqs(true)
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_monoscopic_erp_can_be_accepted() {
        assert_eq!(parse_accept("erp"), Ok(VideoProjection::Erp));
        assert!(parse_accept("eac").is_err());
    }
}
