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
    numbers, places,
    poses::{MovingMasksArgument, PoseArguments, TruthArguments},
    tracks::TrackArguments,
};

#[derive(Debug, Args)]
#[command(next_help_heading = "Sampling and shots")]
pub(crate) struct CurationArguments {
    /// Samples this many frames per second.
    #[arg(long, conflicts_with = "max_frames", value_parser = numbers::positive)]
    pub(crate) fps: Option<f64>,
    /// Samples at most this many frames per sequence, evenly in time.
    #[arg(long, default_value_t = 120, value_parser = numbers::count::<u32>)]
    pub(crate) max_frames: u32,
    /// Takes the frames nearest to the instants of the sampling (even), or the sharpest ones near them (sharp).
    #[arg(long, value_enum, value_name = "FRAMES", default_value_t = SelectionArgument::Even)]
    pub(crate) select: SelectionArgument,
    /// Width of the sampled frames in pixels [default: the video's, at most 1024].
    #[arg(long, value_parser = numbers::count::<u32>)]
    pub(crate) width: Option<u32>,
    /// Takes the videos as this projection, and skips its detection.
    #[arg(long, value_name = "KIND", value_parser = parse_accept)]
    pub(crate) accept: Option<VideoProjection>,
    /// Takes the videos as pinhole (perspective, whose frames make pinhole scenes), or converts frames of another
    /// sphere layout to equirectangular ones. Layouts: stereo-top-bottom, stereo-left-right (the left eye), half-erp,
    /// half-erp-left-right, half-erp-top-bottom (VR180; the back is an ignored region), eac, cubemap-3x2,
    /// cubemap-6x1, cubemap-1x6 (:rludfb is the order of faces), dual-fisheye. A :190 after dual-fisheye is its field
    /// of view in degrees, otherwise measured where lenses overlap [default: stereo, and eac and VR180 that the
    /// file states; others must be given].
    #[arg(long, value_name = "KIND", conflicts_with = "accept", value_parser = parse_projection)]
    pub(crate) projection: Option<ProjectionArgument>,
    /// Drops shots shorter than this, in seconds.
    #[arg(long, default_value_t = 1.0, value_name = "SECONDS",
        value_parser = numbers::not_negative)]
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

/// Projection that the user states for videos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum ProjectionArgument {
    Pinhole,
    Sphere(LayoutChoice),
}

impl ProjectionArgument {
    /// Returns the word of the command line.
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
        .ok_or_else(|| "must be erp or erp-squeezed".to_owned())
}

#[derive(Debug, Args)]
pub(crate) struct DetectorArguments {
    /// Finds boundaries by histogram, by transnetv2 (scripts/setup --models), or by indoor-outdoor, which
    /// finds changes between indoors and outdoors alone.
    #[arg(long, default_value = omnilife_curate::boundaries::DEFAULT_DETECTOR)]
    pub(crate) detector: String,
}

#[derive(Debug, Subcommand)]
pub(crate) enum CurateCommand {
    /// Prints size, frame rate, codec and metadata of a video, as its container and decoder state them (JSON).
    Probe {
        /// The video.
        video: PathBuf,
    },
    /// Prints the projection of a video with the evidence for it, as JSON.
    Projection {
        /// The video.
        video: PathBuf,
    },
    /// Prints the start and end of each shot, as JSON.
    Boundaries {
        /// The video.
        video: PathBuf,
        #[command(flatten)]
        detector: DetectorArguments,
        /// Also writes the detector's signals, one row per frame, as a Parquet table.
        #[arg(long, value_name = "FILE")]
        signals: Option<PathBuf>,
    },
    /// Merges, prints and exports the decisions of several authors on the boundaries of a curated video.
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
        /// The HTML page to write.
        #[arg(long, default_value = "audit.html")]
        out: PathBuf,
    },
    /// Makes a dataset of many videos: probes them, checks their projection, and samples frames of each shot. The
    /// same as `omnilife curate VIDEOS`.
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
    /// Attaches masks, distances and poses to a curated or imported scene, in place of those of the same kind.
    Attach(AttachArguments),
    /// Masks the dynamic regions of a sequence; `omnilife curate poses --masks` takes the result.
    Masks(MasksArguments),
    /// Masks the operator, a mount or a helmet, which stay in the camera's frame while the scene goes by;
    /// `omnilife curate poses --ignore-mask` takes the result.
    Operator {
        /// Folder with a sequence.json.
        sequence: PathBuf,
        /// Also looks for people who keep their place in the frame, by the network of `curate masks --method deeplab`.
        #[arg(long)]
        people: bool,
        /// Also looks for caps around the poles that stay: a tripod below a rotating camera, a flat gap between lenses.
        /// Off by default, because its limits were not measured on labels.
        #[arg(long)]
        caps: bool,
    },
    /// Measures the distances of a posed pinhole scene by stereo: distances per frame, and dense points, from
    /// which tracks and training start.
    Dense {
        /// Folder with a scene.json.
        #[arg(value_parser = places::scene_folder())]
        scene: PathBuf,
        /// A split.json: uses its input views alone, and writes the result into dense/ beside it.
        #[arg(long)]
        split: Option<PathBuf>,
        /// Searches wider frames at this width, pixels; less is faster and coarser.
        #[arg(long, value_name = "PIXELS", default_value_t = omnilife_tracks::dense::SEARCH_WIDTH,
            value_parser = numbers::count::<u32>)]
        width: u32,
        /// Folder of the result [default: dense/ beside the split, else in the scene].
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Tracks vehicles through a posed scene: tracks.json, and tracks.html and tracks.mp4 to look at.
    // In `run`, --detector is that of shot boundaries.
    #[command(
        mut_arg("vehicle_detector", |option| option.visible_alias("detector")),
        mut_arg("every_frame", |option| option.requires("video"))
    )]
    Tracks {
        /// Folder with a scene.json.
        #[arg(value_parser = places::scene_folder())]
        scene: PathBuf,
        /// A split.json: uses its input views alone, and writes the result beside it.
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
        /// Positions of a drone in the subtitles (.SRT) of its video. With them, or with positions of stills in
        /// EXIF, exports have places on the Earth; georeference.json has the similarity with its residuals.
        #[arg(long, value_name = "FILE.srt")]
        telemetry: Option<PathBuf>,
        /// Prints which distances and detections would be used, which left out, and the evidence; writes no tracks.
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
    /// Selects a subset with the shares of the whole dataset, and writes a comparison of both.
    Select(SelectArguments),
    /// Prints the parts that each sequence has and lacks, and the commands that make the missing ones.
    Status {
        /// Folder of a dataset, or of imported scenes.
        #[arg(value_parser = places::dataset_folder())]
        dataset: PathBuf,
        /// Prints it as JSON, with commands to be run in that folder.
        #[arg(long)]
        json: bool,
    },
    /// Writes a page on a dataset: contact sheets with masks, camera paths, coverage of the sphere, losses, statistics,
    /// and missing parts.
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
    /// Records the origin of each video: CSV with the columns file, url, uploader, licence, date, keywords
    /// (between semicolons) and kind (web, own-capture), or a JSON list of such rows. Later runs keep it.
    #[arg(long, value_name = "LIST")]
    pub(crate) sources: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) settings: CurationSettingsArguments,
    #[command(flatten)]
    pub(crate) limit: MemoryLimitArguments,
}

/// Limit of the process that curates a video.
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

/// Settings that all videos of a dataset share.
#[derive(Debug, Args)]
pub(crate) struct CurationSettingsArguments {
    #[command(flatten)]
    pub(crate) curation: CurationArguments,
    /// Criteria that every video must meet: omnilife360, none, or a .toml file of thresholds. Overlays reject a video by
    /// such a file alone; omnilife360 reports them.
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
