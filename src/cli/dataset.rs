//! `omnilife curate`: the commands that work on a curated dataset or scene.

use std::{env::VarError, path::PathBuf, time::Duration};

use clap::{Args, ValueEnum, builder::NonEmptyStringValueParser};
use omnilife_curate::{
    CurateError, FrameCommand, MaskProgram,
    annotation::{
        AnnotateSettings, CaptionCommand, CaptionEndpoint,
        endpoint::{Endpoint, Key, RetryPolicy},
    },
    exchange::{self, CubeFaces, MaskMeaning},
    masks::{self, MaskSource},
    publish::{self, PublishSettings, SelectRequest},
};

use super::{numbers, places, reconstruct::size};
use crate::exit::BadRequest;

/// Environment variable with the key of the endpoint that captions.
const KEY_VARIABLE: &str = "OMNILIFE_CAPTION_KEY";

/// `curate slice`.
#[derive(Debug, Args)]
pub(crate) struct SliceArguments {
    /// The video.
    pub(crate) video: PathBuf,
    /// Start of the slice, in seconds of the video's timestamps [default: at its first frame].
    #[arg(long, value_name = "SECONDS", value_parser = numbers::finite)]
    pub(crate) begin: Option<f64>,
    /// End of the slice, in seconds of the same clock [default: after its last frame].
    #[arg(long, value_name = "SECONDS", value_parser = numbers::finite)]
    pub(crate) end: Option<f64>,
    /// The mp4 to write.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Copies the sound along.
    #[arg(long)]
    pub(crate) audio: bool,
}

/// `curate annotate`.
#[derive(Debug, Args)]
pub(crate) struct AnnotateArguments {
    /// Folder of the dataset.
    pub(crate) dataset: PathBuf,
    /// Tables of tags and captions: CSV with the columns sequence, author, scene, action,
    /// traversal, caption, or a JSON list of such rows.
    #[arg(long, value_name = "FILE")]
    pub(crate) tags: Vec<PathBuf>,
    /// A program that captions: reads JSON with frames, writes JSON with a caption.
    #[arg(long, value_name = "PROGRAM")]
    pub(crate) caption_command: Option<String>,
    /// An argument for that program; may be repeated.
    #[arg(
        long,
        value_name = "ARGUMENT",
        requires = "caption_command",
        allow_hyphen_values = true
    )]
    pub(crate) caption_argument: Vec<String>,
    /// A model that captions: the address, up to /v1, of an endpoint that speaks the chat-completions
    /// protocol. It is shown perspective views. A key comes from the environment variable
    /// `OMNILIFE_CAPTION_KEY` alone.
    #[arg(
        long,
        value_name = "URL",
        requires = "caption_model",
        conflicts_with = "caption_command"
    )]
    pub(crate) caption_endpoint: Option<Endpoint>,
    /// Name of the model behind the endpoint.
    #[arg(long, value_name = "NAME", requires = "caption_endpoint", value_parser = NonEmptyStringValueParser::new())]
    pub(crate) caption_model: Option<String>,
    /// Gives up on the caption of a sequence after this many seconds.
    #[arg(long, default_value_t = 120, value_name = "SECONDS",
        value_parser = numbers::count::<u64>)]
    pub(crate) caption_timeout: u64,
    /// Taxonomy file [default: the built-in one].
    #[arg(long, value_name = "FILE")]
    pub(crate) taxonomy: Option<PathBuf>,
}

impl AnnotateArguments {
    /// Returns the sources of annotations.
    ///
    /// # Errors
    /// When the environment holds an invalid key.
    pub(crate) fn settings(&self) -> anyhow::Result<AnnotateSettings> {
        let timeout = Duration::from_secs(self.caption_timeout);
        Ok(AnnotateSettings {
            endpoint: self.endpoint(timeout)?,
            taxonomy: self.taxonomy.clone(),
            tags: self.tags.clone(),
            command: self.caption_command.clone().map(|program| CaptionCommand {
                program,
                arguments: self.caption_argument.clone(),
                timeout,
            }),
        })
    }

    fn endpoint(&self, timeout: Duration) -> anyhow::Result<Option<CaptionEndpoint>> {
        let (Some(endpoint), Some(model)) = (&self.caption_endpoint, &self.caption_model) else {
            return Ok(None);
        };
        let key = match std::env::var(KEY_VARIABLE) {
            Ok(text) => {
                let refused = |reason: String| BadRequest(format!("{KEY_VARIABLE} {reason}"));
                Some(Key::new(&text).map_err(refused)?)
            }
            Err(VarError::NotPresent) => None,
            Err(VarError::NotUnicode(_)) => {
                return Err(BadRequest(format!("{KEY_VARIABLE} holds no text")).into());
            }
        };
        Ok(Some(CaptionEndpoint {
            endpoint: endpoint.clone(),
            model: model.clone(),
            key,
            patience: RetryPolicy {
                timeout,
                ..RetryPolicy::default()
            },
        }))
    }
}

/// `curate export`.
#[derive(Debug, Args)]
pub(crate) struct ExportArguments {
    /// The scene.json, or its folder.
    #[arg(value_parser = places::scene_folder())]
    pub(crate) scene: PathBuf,
    /// Format to write.
    #[arg(long, value_parser = parse_written_format)]
    pub(crate) format: String,
    /// Marks the novel views of this split.json as test frames, where the format can.
    #[arg(long, value_name = "FILE", value_parser = places::split_file())]
    pub(crate) split: Option<PathBuf>,
    /// Leaves the novel views of the split out, for trainers that would train on all images.
    #[arg(long, requires = "split")]
    pub(crate) given_only: bool,
    /// Writes the six faces of a cube in place of every panorama, this many pixels wide, for trainers that
    /// know perspective cameras alone (colmap, colmap-binary, nerfstudio). A third of the panorama's
    /// width keeps its resolution.
    #[arg(long, value_name = "PIXELS", value_parser = numbers::count::<u32>)]
    cube_faces: Option<u32>,
    /// Adds this many points on a far sphere to the points, in the colours seen there.
    #[arg(long, value_name = "N", requires = "cube_faces", default_value_t = 0,
        value_parser = numbers::whole::<usize>)]
    sky_points: usize,
    /// Resizes images to fit into frames of this size, never enlarging them, in the middle of black padding, which
    /// the masks leave out [default: as the split says]. Panoramas with padding need a format
    /// that says where they lie (nerfstudio), others would take the frame for the whole sphere.
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size, conflicts_with = "cube_faces")]
    pub(crate) pad_to: Option<[u32; 2]>,
    /// Folder to fill.
    #[arg(long)]
    pub(crate) out: PathBuf,
}

impl ExportArguments {
    pub(crate) fn cube_faces(&self) -> Option<CubeFaces> {
        let sky_points = self.sky_points;
        self.cube_faces.map(|side| CubeFaces { side, sky_points })
    }
}

/// `curate import`.
#[derive(Debug, Args)]
pub(crate) struct ImportArguments {
    /// Folder in another tool's format, or a COLMAP model in it (sparse/1); of a drive also FOLDER/SEQUENCE and
    /// FOLDER/SEQUENCE/CAMERA+CAMERA.
    pub(crate) folder: PathBuf,
    /// Format of the folder.
    #[arg(long, value_parser = parse_format)]
    pub(crate) format: String,
    /// Name of the scene [default: that of the record in an export of ours, else the folder's].
    #[arg(long)]
    pub(crate) id: Option<String>,
    /// Frames per second, where the folder has no times.csv; numbers in the names of images count frames
    /// [default for layouts of data sets: their own].
    #[arg(long, value_parser = numbers::positive)]
    pub(crate) fps: Option<f64>,
    /// Meaning of the masks: dynamic regions, or ignored regions (the operator, a tripod), from which
    /// nothing is learned and which no score counts. Masks in ignore/ always mark the latter.
    #[arg(long, value_enum, default_value_t = MasksMark::Moving)]
    pub(crate) masks: MasksMark,
    /// Folder to fill with scene.json, frames, masks and points; of a drive with depth-prior and tracks.json too.
    #[arg(long)]
    pub(crate) out: PathBuf,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum MasksMark {
    Moving,
    Ignored,
}

impl From<MasksMark> for MaskMeaning {
    fn from(mark: MasksMark) -> Self {
        match mark {
            MasksMark::Moving => Self::Moving,
            MasksMark::Ignored => Self::Ignored,
        }
    }
}

fn parse_format(text: &str) -> Result<String, String> {
    one_of(text, exchange::FORMATS.iter())
}

fn parse_written_format(text: &str) -> Result<String, String> {
    one_of(text, exchange::written_formats())
}

fn one_of<'a>(
    text: &str,
    known: impl Iterator<Item = &'a exchange::Format>,
) -> Result<String, String> {
    let known: Vec<&str> = known.map(|format| format.id).collect();
    if known.contains(&text) {
        Ok(text.to_owned())
    } else {
        Err(format!("known are {}", known.join(", ")))
    }
}

/// `curate masks`.
#[derive(Debug, Args)]
pub(crate) struct MasksArguments {
    /// Folder with a sequence.json.
    #[arg(value_parser = places::sequence_folder())]
    pub(crate) sequence: PathBuf,
    /// Takes the masks from this folder: images named as the frames, white where something moves.
    #[arg(long, value_name = "FOLDER", conflicts_with = "method")]
    pub(crate) from: Option<PathBuf>,
    /// Takes the masks from a program, which masks the frames in {frames} and leaves an image for each, named like it, in
    /// {out}, where it finds those of a run of the same command that failed. Words are separated by blanks; no shell takes
    /// them apart.
    #[arg(long, value_name = "COMMAND", conflicts_with_all = ["method", "from"])]
    pub(crate) command: Option<FrameCommand>,
    /// Stops the program, and all that it started, after this many seconds.
    #[arg(
        long,
        default_value_t = 3600,
        value_name = "SECONDS",
        value_parser = numbers::count::<u64>
    )]
    pub(crate) command_timeout: u64,
    /// Finds dynamic regions by residual (motion that the camera's own does not explain), deeplab (people, animals
    /// and vehicles by class; scripts/setup --models), or combined (those of deeplab that move) [default: the first
    /// that reaches its bar on labelled footage; while none does, one has to be named].
    #[arg(long)]
    pub(crate) method: Option<String>,
}

impl MasksArguments {
    /// Returns the source of masks.
    ///
    /// # Errors
    /// When it is not named, and no method reaches its bar.
    pub(crate) fn source(&self) -> Result<MaskSource, CurateError> {
        Ok(match (&self.from, &self.command, &self.method) {
            (Some(folder), ..) => MaskSource::Files(folder.clone()),
            (None, Some(command), _) => MaskSource::Program(MaskProgram {
                command: command.clone(),
                time_limit: Some(Duration::from_secs(self.command_timeout)),
            }),
            (None, None, Some(method)) => MaskSource::Method(method.clone()),
            (None, None, None) => {
                let method = masks::require_default_method(&self.sequence)?;
                MaskSource::Method(method.id.to_owned())
            }
        })
    }
}

/// `curate publish`.
#[derive(Debug, Args)]
pub(crate) struct PublishArguments {
    /// Folder of the dataset.
    pub(crate) dataset: PathBuf,
    /// Name of the dataset [default: that of the last publication, else the folder's].
    #[arg(long)]
    pub(crate) name: Option<String>,
    /// Licence of the dataset: an SPDX identifier such as CC-BY-4.0, LicenseRef-NAME, or the address of its text.
    #[arg(long, value_parser = publish::licence)]
    pub(crate) licence: Option<String>,
    /// Description of the dataset in its card, in a sentence or two.
    #[arg(long)]
    pub(crate) description: Option<String>,
    /// TOML file of the makers' statements; options given here go before its name, licence and description.
    #[arg(long, value_name = "FILE")]
    pub(crate) about: Option<PathBuf>,
    /// Refuses to publish while a question of the card has no answer.
    #[arg(long)]
    pub(crate) strict: bool,
    /// Also writes the frames into tar archives of about this many megabytes each, as the library webdataset reads
    /// them; without it, removes the archives of the last publication.
    #[arg(long, value_name = "MEGABYTES", value_parser = megabytes)]
    pub(crate) shards: Option<u64>,
}

/// `curate select`.
#[derive(Debug, Args)]
pub(crate) struct SelectArguments {
    /// Folder of the dataset.
    pub(crate) dataset: PathBuf,
    /// Number of sequences to select.
    #[arg(long, value_name = "N", value_parser = numbers::count::<usize>)]
    count: usize,
    /// Properties whose classes keep their shares, separated by commas.
    #[arg(long, value_name = "PROPERTIES", value_delimiter = ',', default_value = "scene,ego-motion,dynamics",
          value_parser = parse_property)]
    stratify: Vec<String>,
    /// Seed that decides between sequences that fit equally well.
    #[arg(long, default_value_t = 0, value_parser = numbers::whole::<u64>)]
    seed: u64,
    /// Selects among sequences with valid poses alone.
    #[arg(long)]
    posed: bool,
    /// Folder for sequences.csv and comparison.csv.
    #[arg(long)]
    pub(crate) out: PathBuf,
}

impl SelectArguments {
    pub(crate) fn request(&self) -> SelectRequest {
        SelectRequest {
            count: self.count,
            stratify: self.stratify.clone(),
            seed: self.seed,
            posed_only: self.posed,
        }
    }
}

fn parse_property(text: &str) -> Result<String, String> {
    let known: Vec<&str> = publish::properties().collect();
    if known.contains(&text) {
        return Ok(text.to_owned());
    }
    Err(format!("must be one of {}, got {text}", known.join(", ")))
}

/// Returns the bytes of a number of megabytes.
fn megabytes(text: &str) -> Result<u64, String> {
    text.parse()
        .ok()
        .filter(|megabytes: &f64| *megabytes > 0.0 && *megabytes < 1e9)
        .map(|megabytes| (megabytes * 1e6) as u64)
        .ok_or_else(|| "must be a positive number of megabytes".to_owned())
}

impl PublishArguments {
    /// Returns the statements about the dataset.
    pub(crate) fn settings(&self) -> PublishSettings {
        PublishSettings {
            name: self.name.clone(),
            licence: self.licence.clone(),
            description: self.description.clone(),
            about: self.about.clone(),
            is_strict: self.strict,
            shard_bytes: self.shards,
        }
    }
}
