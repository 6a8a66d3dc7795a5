//! `omnilife reconstruct`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};
use omnilife_reconstruct::{
    formats::{axes::FileAxes, exchange::SPLAT_FORMATS},
    jobs::{
        export::{ExportRequest, levels::Level},
        render::{RenderCamera, RenderRequest},
    },
    methods::{self, METHODS, variant::Variant},
    options::Options,
    request::{BackendChoice, MethodRequest, PlanChoice},
};

use super::{
    camera_words::CameraWordArguments, edit::EditArguments, memory::gibibytes, numbers, places,
};
use crate::exit::BadRequest;

#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Method")]
pub(crate) struct MethodArguments {
    /// Reconstruction method.
    #[arg(long, default_value = METHODS[0].id)]
    pub(crate) method: String,
    /// Ends training after this many seconds, whatever the iterations; schedules shrink to fit.
    #[arg(long, value_name = "SECONDS", value_parser = numbers::positive)]
    pub(crate) budget: Option<f64>,
    /// Seed of initialization and sampling; the same seed repeats a run.
    #[arg(long, default_value_t = 0, value_parser = numbers::whole::<u64>)]
    pub(crate) seed: u64,
    /// An option of the method; `reconstruct methods` lists them. May be repeated.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    pub(crate) options: Vec<String>,
    /// Adds components that the plan leaves out or that the method lacks; `reconstruct methods` lists them. `aids`
    /// adds all aids that the scene gives reason for.
    #[arg(long, value_name = "COMPONENT", value_delimiter = ',')]
    pub(crate) with: Vec<String>,
    /// Leaves out components of the method; `reconstruct methods` lists them. `aids` leaves out all aids;
    /// without the aid `short-schedule`, step sizes are the published ones.
    #[arg(long, value_name = "COMPONENT", value_delimiter = ',')]
    pub(crate) without: Vec<String>,
    /// Components of the method: auto takes those that the scene gives reason for, full takes all as
    /// published. A list names them [default: full for the published methods deformable, periodic and
    /// omni4dgs, auto for the others].
    #[arg(long, value_name = "auto|full|COMPONENT,...", value_parser = plan)]
    pub(crate) plan: Option<PlanChoice>,
    /// Computes on the CPU, or on a GPU.
    #[arg(long, value_enum, default_value_t = BackendArgument::Cpu)]
    pub(crate) backend: BackendArgument,
    /// Adds a row to the trace every this many iterations, with novel views rendered for the curve of
    /// error against run time [default: at equal ratios of the CPU time]. The default rows come before
    /// the first step, after 1, 1.4, 2, 2.8, 4 ... seconds of planning and training, and after the last
    /// step.
    #[arg(long, value_name = "ITERATIONS", value_parser = numbers::count::<u64>)]
    pub(crate) trace: Option<u64>,
    /// At each row of the trace renders this many novel views, evenly spread; 0 for none, and no
    /// curve [default: all].
    #[arg(long, value_name = "N", value_parser = numbers::whole::<usize>)]
    pub(crate) trace_views: Option<usize>,
    /// Writes an event file for TensorBoard here: at each row of the trace its numbers, and an input and a
    /// novel view. `run`, `bench run`, `bench ablate` and `sweep plan bench` make a folder per training in it.
    #[arg(long, value_name = "FOLDER")]
    pub(crate) tensorboard: Option<PathBuf>,
    /// Writes a checkpoint every this many iterations, from which an interrupted run resumes; 0 for none.
    #[arg(long, value_name = "ITERATIONS", default_value_t = 1_000,
        value_parser = numbers::whole::<u64>)]
    pub(crate) checkpoint_every: u64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum BackendArgument {
    Cpu,
    Gpu,
}

impl BackendArgument {
    /// The word on a command line.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

impl From<BackendArgument> for BackendChoice {
    fn from(argument: BackendArgument) -> Self {
        match argument {
            BackendArgument::Cpu => Self::Cpu,
            BackendArgument::Gpu => Self::Gpu,
        }
    }
}

impl MethodArguments {
    /// Returns the request for the method.
    ///
    /// # Errors
    /// When the method does not exist, or does not understand an option.
    pub(crate) fn request(&self, iterations: u64) -> anyhow::Result<MethodRequest> {
        let method = methods::find(&self.method)?;
        Ok(MethodRequest {
            budget_seconds: self.budget,
            options: Options::parse(method.id, method.options, &self.options)?,
            with: self.with.clone(),
            without: self.without.clone(),
            plan: self
                .plan
                .clone()
                .unwrap_or_else(|| method.default_plan.into()),
            trace_every: self.trace,
            ..MethodRequest::new(iterations, self.seed)
        })
    }
}

impl MethodArguments {
    /// The method's name in tables, with the components that are asked for.
    ///
    /// # Errors
    /// As [`Self::request`].
    pub(crate) fn variant(&self, iterations: u64) -> anyhow::Result<String> {
        let method = methods::find(&self.method)?;
        Ok(Variant::of(method, &self.request(iterations)?).to_string())
    }

    /// The arguments of a command line that says the same, but for `--tensorboard`: units have folders of their own.
    pub(crate) fn words(&self) -> Vec<String> {
        // All fields, so that none is forgotten.
        let Self {
            method,
            budget,
            seed,
            options,
            with,
            without,
            plan,
            backend,
            trace,
            trace_views,
            tensorboard: _,
            checkpoint_every,
        } = self;
        let list = |names: &[String]| (!names.is_empty()).then(|| names.join(","));
        let plan = plan.as_ref().map(plan_word);
        let given = [
            ("--method", Some(method.clone())),
            ("--budget", budget.map(|seconds| seconds.to_string())),
            ("--seed", Some(seed.to_string())),
            ("--with", list(with)),
            ("--without", list(without)),
            ("--plan", plan),
            ("--backend", Some(backend.name().to_owned())),
            ("--trace", trace.map(|every| every.to_string())),
            ("--trace-views", trace_views.map(|count| count.to_string())),
            ("--checkpoint-every", Some(checkpoint_every.to_string())),
        ];
        let set = options.iter().map(|option| ("--set", Some(option.clone())));
        given
            .into_iter()
            .chain(set)
            .filter_map(|(option, value)| Some([option.to_owned(), value?]))
            .flatten()
            .collect()
    }
}

#[derive(Debug, Args)]
pub(crate) struct RenderArguments {
    /// A run's folder, or a file of Gaussians in a format of export.
    #[arg(value_name = "RUN")]
    pub(crate) model: PathBuf,
    /// A poses.json or scene.json, whose poses are used as they stand; a run that refined poses leaves
    /// them in refined-poses.json. A folder stands for the scene.json in it.
    #[arg(long, value_parser = places::poses())]
    pub(crate) poses: PathBuf,
    #[command(flatten)]
    pub(crate) cameras: CameraWordArguments,
    /// Folder of the images.
    #[arg(long)]
    pub(crate) out: PathBuf,
    /// Axes of the poses' world that x, y and z of a file point along [default: x,y,z]. For a file with y
    /// down in a world with z up they are x,-z,y. SPZ and glTF are turned to y down before.
    #[arg(long, value_name = "X,Y,Z", value_parser = FileAxes::parse, allow_hyphen_values = true)]
    pub(crate) axes: Option<FileAxes>,
    /// Size of the images in pixels. Views with finer pixels than those that a run was trained with are drawn as smooth
    /// as these [default: the size of the poses' frames, else that of the run's panoramas, else 1024x512; of faces, as
    /// sharp].
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Projection of the images: the whole sphere, a perspective, or the six faces of a cube, named by
    /// their directions [default: that of the poses, or the sphere].
    #[arg(long, visible_alias = "projection", value_enum)]
    pub(crate) camera: Option<CameraArgument>,
    /// Renders with a pinhole camera of this horizontal field of view [default with --camera pinhole: 90].
    #[arg(long, value_name = "DEGREES", value_parser = numbers::positive)]
    pub(crate) fov_degrees: Option<f64>,
    /// Renders panoramas from perspective faces of a cube, this many pixels wide, as the perspective trainers
    /// of other projects do.
    #[arg(long, value_name = "PIXELS", value_parser = numbers::count::<u32>)]
    pub(crate) cube_faces: Option<u32>,
    /// Renders this layer. Of Gaussians: all, static, dynamic, velocity, depth or object:ID; of an atlas: all,
    /// background, object:ID, matte:ID or without:ID. Images of object:ID have an alpha channel, with which their
    /// colours are not multiplied.
    #[arg(long, default_value = "all")]
    pub(crate) layer: String,
    /// Shows the object with this id alone.
    #[arg(long, value_name = "ID", conflicts_with = "layer", value_parser = numbers::whole::<u32>)]
    pub(crate) object: Option<u32>,
    /// Makes a video of the images too; players show views of the whole sphere as 360-degree video.
    #[arg(long, value_name = "FILE.mp4")]
    pub(crate) video: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum CameraArgument {
    Erp,
    Pinhole,
    Cube,
}

/// Horizontal field of view of a pinhole camera where none is given.
const FIELD_OF_VIEW_DEGREES: f64 = 90.0;

impl RenderArguments {
    /// Returns the request for the renderer.
    ///
    /// # Errors
    /// When cameras by words exclude each other, or a field of view is given for another camera than a pinhole.
    pub(crate) fn request(&self) -> anyhow::Result<RenderRequest> {
        Ok(RenderRequest {
            model: self.model.clone(),
            axes: self.axes,
            poses: self.poses.clone(),
            cameras: self.cameras.words()?,
            size: self.size,
            camera: match (self.camera, self.fov_degrees) {
                (None, None) => RenderCamera::OfPoses,
                (Some(CameraArgument::Erp), None) => RenderCamera::Erp,
                (Some(CameraArgument::Cube), None) => RenderCamera::Cube,
                (None | Some(CameraArgument::Pinhole), degrees) => {
                    RenderCamera::Pinhole(degrees.unwrap_or(FIELD_OF_VIEW_DEGREES))
                }
                (Some(CameraArgument::Erp | CameraArgument::Cube), Some(_)) => {
                    let reason = "--fov-degrees is that of --camera pinhole; panoramas and faces of a cube have theirs";
                    return Err(BadRequest(reason.to_owned()).into());
                }
            },
            layer: match self.object {
                Some(id) => format!("object:{id}"),
                None => self.layer.clone(),
            },
            cube_faces: self.cube_faces,
            out: self.out.clone(),
        })
    }
}

#[derive(Debug, Args)]
pub(crate) struct AssetArguments {
    /// A run's folder, or a file of Gaussians in a format of export.
    pub(crate) gaussians: PathBuf,
    /// Levels of detail: numbers of Gaussians at most, or all of them.
    #[arg(long, value_name = "1M,500k,full", value_delimiter = ',', default_value = "full", value_parser = Level::parse)]
    pub(crate) lod: Vec<Level>,
    /// Format of the levels; all but splat keep harmonics. gtime keeps the motion of a dynamic scene in one
    /// file, and spz-sequence has files of moments that are evenly spread over the clip, as many as it has frames at
    /// its usual interval, or --moments.
    #[arg(long, default_value = SPLAT_FORMATS[0].name)]
    pub(crate) format: String,
    /// Makes a page too, one HTML file that opens from disk; that of splat needs the viewer of scripts/setup
    /// --viewer.
    #[arg(long)]
    pub(crate) page: bool,
    /// Up in the world as three numbers [default: that of the run's cameras, or 0,0,1].
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(crate) up: Option<[f64; 3]>,
    /// The moment that levels show of a scene that moves [default: the middle of its clip].
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, value_parser = numbers::finite)]
    pub(crate) time: Option<f64>,
    /// Number of moments that a dynamic scene is exported at beside its levels, for the page's slider; 1
    /// for none [default: one per frame of its clip, 60 at most].
    #[arg(long, value_name = "N", value_parser = numbers::between::<u32, 1, 1_000>)]
    pub(crate) moments: Option<u32>,
    /// Folder of the asset.
    #[arg(long)]
    pub(crate) out: PathBuf,
}

impl AssetArguments {
    /// Returns the request for the export.
    pub(crate) fn request(&self) -> ExportRequest {
        ExportRequest {
            gaussians: self.gaussians.clone(),
            format: self.format.clone(),
            levels: self.lod.clone(),
            with_page: self.page,
            up: self.up,
            time_seconds: self.time,
            moments: self.moments.map(|moments| moments as usize),
            out: self.out.clone(),
        }
    }
}

pub(super) fn direction(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|word| word.trim().parse().ok())
        .collect();
    let numbers = numbers.and_then(|numbers| <[f64; 3]>::try_from(numbers).ok());
    numbers.ok_or_else(|| "expected three numbers such as 0,0,1".to_owned())
}

/// Returns the word that [`plan`] reads.
pub(crate) fn plan_word(plan: &PlanChoice) -> String {
    match plan {
        PlanChoice::Auto => "auto".to_owned(),
        PlanChoice::Full => "full".to_owned(),
        PlanChoice::Only(names) => names.join(","),
    }
}

fn plan(text: &str) -> Result<PlanChoice, String> {
    match text {
        "" => Err("expected auto, full or names of components".to_owned()),
        "auto" => Ok(PlanChoice::Auto),
        "full" => Ok(PlanChoice::Full),
        names => Ok(PlanChoice::Only(
            names
                .split(',')
                .map(|name| name.trim().to_owned())
                .collect(),
        )),
    }
}

pub(super) fn size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text
        .split_once('x')
        .and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    parsed.ok_or_else(|| "expected a size such as 1024x512".to_owned())
}

#[derive(Debug, Subcommand)]
pub(crate) enum ReconstructCommand {
    /// Trains a method on a scene's input views and renders all views of the split.
    Train {
        /// The scene.json, or its folder.
        #[arg(value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json.
        #[arg(long, value_parser = places::split_file())]
        split: PathBuf,
        /// Folder of the run.
        #[arg(long)]
        out: PathBuf,
        #[command(flatten)]
        method: MethodArguments,
        /// Optimizer steps, as many as the published protocol has; schedules scale with them. `run` and
        /// `bench run` have 1500.
        #[arg(long, default_value_t = 30_000, value_parser = numbers::count::<u64>)]
        iterations: u64,
        /// Memory that training may take, GiB: a model that needs more is refused before it is trained
        /// [default: the free memory of the machine].
        #[arg(long, value_name = "GIB", value_parser = gibibytes)]
        memory: Option<u64>,
    },
    /// Makes the inputs that methods require beside a scene and its split: dense points, tracks of vehicles.
    ///
    /// `run`, `bench run`, `bench ablate` and sweeps do so by themselves. The result goes beside the split.
    Prepare {
        /// The scene.json, or its folder.
        #[arg(value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json.
        #[arg(long, value_parser = places::split_file())]
        split: PathBuf,
        /// Methods whose requirements are made; `reconstruct methods` lists them.
        #[arg(long, value_name = "METHOD", value_delimiter = ',', required = true)]
        methods: Vec<String>,
        /// Ends well where a scene cannot meet a requirement, and prints why.
        #[arg(long)]
        where_possible: bool,
    },
    /// Prints the components that a method has on a scene, the evidence for each, and the time saved.
    ///
    /// With `--backend gpu` also the bytes on the device at the maximum number of Gaussians, the largest buffer,
    /// and whether the adapter holds them.
    Plan {
        /// The scene.json, or its folder.
        #[arg(value_parser = places::scene_file())]
        scene: PathBuf,
        /// The split.json.
        #[arg(long, value_parser = places::split_file())]
        split: PathBuf,
        #[command(flatten)]
        method: MethodArguments,
        /// Optimizer steps that the run would have, as in `reconstruct train`.
        #[arg(long, default_value_t = 30_000, value_parser = numbers::count::<u64>)]
        iterations: u64,
    },
    /// Renders a run, or Gaussians, along given poses to PNG files, and to a video.
    Render(RenderArguments),
    /// Writes Gaussians as levels of detail for viewers, with a record and a page.
    Export(AssetArguments),
    /// Writes the atlas of a run of nag: an RGBA image of each object and of the background.
    Atlas {
        /// The run's folder.
        run: PathBuf,
        /// Folder of the images.
        #[arg(long)]
        out: PathBuf,
    },
    /// Edits the parts of a run's model by a script, into a run of its own that lists the changes.
    ///
    /// A script has `[[edit]]` tables, each with `kind` and `object`. Kinds: `remove`; `shift` with `by = [x, y, z]`;
    /// `rotate` with `turn = [x, y, z]` in degrees; `duplicate` with `new`; `retime` with `seconds` or `frames`;
    /// `texture` with `image` and `frame`. `axes` are "ground" (vehicles have them where nothing is said), "camera"
    /// (nodes of an atlas have them) or "world"; `unit` is "world" (vehicles) or "distance" (nodes).
    Edit(EditArguments),
    /// Lists the methods, their components, and their options with unit, range, default and source.
    Methods {
        /// Prints the list as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Prints the backends that have each method, component, parameterization and kernel.
    Backends,
}
