//! Rendering Gaussians, ours or anyone's, along given poses; a model of ours in layers.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    time::Instant,
};

use glam::DVec3;
use omnilife_schemas::{
    Pose, Similarity,
    camera::{ErpCamera, PinholeCamera},
    lock::FolderLock,
    ownership::{OwnFile, Standing},
    progress::Progress,
    records::{Asset, Poses, RunRecord, Scene},
    stage::StagePlan,
    store::{self, StoreError},
};
use serde::Deserialize;

use omnilife_engine::{
    camera::{Camera, View},
    gaussians::{ActivatedGaussians, static_gaussians},
    model::{
        Model,
        layers::{Layer, LayerRenderer},
    },
    render::{
        published::PublishedRenderer,
        settings::{RenderSettings, RendererChoice},
    },
    step::settings::TrainSettings,
};

use crate::{
    error::ReconstructError,
    formats::{self, splat::Placement},
    jobs::{export::ASSET_FILE, reconstruct::RUN_FILE},
    process,
};

/// What to render, from where, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderRequest {
    /// A run's folder, or a PLY of Gaussians.
    pub gaussians: PathBuf,
    /// A `poses.json` or `scene.json`.
    pub poses: PathBuf,
    /// Width and height in pixels; the scene's, or 1024x512, where none is given.
    pub size: Option<[u32; 2]>,
    /// With which camera.
    pub camera: RenderCamera,
    /// What of them is shown.
    pub layer: Layer,
    /// Folder of the images.
    pub out: PathBuf,
}

/// The camera of rendered images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RenderCamera {
    /// That of the poses; ERP where they have none.
    OfPoses,
    /// ERP.
    Erp,
    /// A pinhole with a centred principal point and this horizontal field of view in degrees.
    Pinhole(f64),
}

/// What was rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedViews {
    /// PNG files `<number of the frame, 6 digits>.png`, in order.
    pub files: Vec<PathBuf>,
    /// The camera of the images.
    pub camera: Camera,
    /// Presentation timestamps in seconds, one per file.
    pub times_seconds: Vec<f64>,
    /// Frames without a usable pose; they are left out.
    pub unposed: usize,
    /// What a velocity map shows at most, world units per second; `None` for other layers.
    pub largest_speed: Option<f64>,
}

/// Size of ERP images where neither the request nor the poses say one.
const DEFAULT_SIZE: [u32; 2] = [1024, 512];
/// Memory that rendering takes per pixel, at least: colours, transmittance and depth in f32 as they
/// are accumulated, the image of them, and its bytes as they are written.
const BYTES_PER_PIXEL: u64 = 5 * 4 + 3 * 4 + 3;
/// Sides of images are at most this, pixels.
const LARGEST_SIDE: u32 = 1 << 15;

/// Renders every posed frame.
///
/// # Errors
/// When a file is missing or malformed, nothing is posed, an image that was not rendered here would
/// be replaced, or one cannot be written.
pub fn render_poses(
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<RenderedViews, ReconstructError> {
    let path = read_path(&request.poses)?;
    let posed: Vec<(usize, f64, Pose)> = path
        .frames
        .iter()
        .enumerate()
        .filter_map(|(number, &(time, pose))| Some((number, time, pose?)))
        .filter(|(_, _, pose)| pose.is_valid())
        .collect();
    let centres: Vec<DVec3> = posed.iter().map(|(_, _, pose)| pose.centre()).collect();
    let of_cameras = Similarity::from_cameras(&centres)
        .ok_or_else(|| ReconstructError::scene(&request.poses, "has no usable pose"))?;
    let camera = camera(request, path.camera)?;
    let source = Source::open(&request.gaussians, of_cameras)?;
    if source.renderer == RendererChoice::OdgsPublished
        && (matches!(camera, Camera::Pinhole(_)) || request.layer != Layer::All)
    {
        return Err(ReconstructError::Request {
            reason: "the published renderer of ODGS draws whole ERP views only".to_owned(),
        });
    }
    let mut published = None;
    let mut layers = LayerRenderer::new(source.model()?, source.settings);
    if let Some(reason) = layers.refusal(request.layer) {
        return Err(ReconstructError::Request {
            reason: reason.to_owned(),
        });
    }
    if source.renderer == RendererChoice::OdgsPublished {
        let mut gaussians = ActivatedGaussians::default();
        for part in &layers.model().parts {
            static_gaussians::activate(&part.table, &mut gaussians);
        }
        published = Some((PublishedRenderer::new(source.settings), gaussians));
    }
    let _lock = FolderLock::take(&request.out, progress)?;
    let begun = Instant::now();
    let stage = StagePlan::new(&request.out, "render");
    let mut images = posed
        .iter()
        .map(|(number, ..)| image_file(*number))
        .collect::<BTreeSet<_>>();
    // Ground truth has the same names.
    stage.claim(&images)?;
    progress.begin("rendering", Some(posed.len() as u64));
    let mut rendered = RenderedViews {
        files: Vec::with_capacity(posed.len()),
        camera,
        times_seconds: Vec::with_capacity(posed.len()),
        unposed: path.frames.len() - posed.len(),
        largest_speed: (request.layer == Layer::Velocity)
            .then(|| source.world_speed(layers.largest_speed())),
    };
    let mut render = |number: usize, time: f64, pose: &Pose| -> Result<(), ReconstructError> {
        let view = View::new(camera, pose, &source.normalization, time).ok_or_else(|| {
            ReconstructError::scene(&request.poses, format!("frame {number} has no usable pose"))
        })?;
        let file = request.out.join(image_file(number));
        let image = match &mut published {
            Some((renderer, gaussians)) => renderer.image(&view, gaussians),
            None => layers.image(&view, request.layer),
        };
        image.write_png(&file)?;
        rendered.files.push(file);
        rendered.times_seconds.push(time);
        progress.advance(1);
        Ok(())
    };
    let outcome = posed
        .iter()
        .try_for_each(|(number, time, pose)| render(*number, *time, pose));
    progress.end();
    outcome?;
    // Images of earlier renderings stay, and stay ours.
    let own = stage.own_files();
    for OwnFile { file, .. } in own.files() {
        if own.standing(&file)? == Standing::Ours {
            images.insert(file);
        }
    }
    stage.finish(&images, begun.elapsed().as_secs_f64())?;
    Ok(rendered)
}

fn image_file(number: usize) -> String {
    format!("{number:06}.png")
}

/// Gaussians with what a renderer has to know about them.
pub(crate) struct Source {
    /// A run's folder, or a PLY.
    path: PathBuf,
    pub(crate) normalization: Similarity,
    renderer: RendererChoice,
    settings: RenderSettings,
    /// What a run's Gaussians were trained under; a PLY has none of it.
    trained: Option<TrainSettings>,
}

impl Source {
    /// A run's Gaussians under the run's settings. A PLY alone says neither: it is normalized by the
    /// cameras, and what is nearer than a thousandth of their radius is not drawn.
    pub(crate) fn open(path: &Path, of_cameras: Similarity) -> Result<Self, ReconstructError> {
        if !path.is_dir() {
            return Ok(Self {
                path: path.to_owned(),
                normalization: of_cameras,
                renderer: RendererChoice::Exact,
                settings: RenderSettings::new(1e-3),
                trained: None,
            });
        }
        let record_path = path.join(RUN_FILE);
        let record: RunRecord = store::read_record(&record_path)?;
        let settings: TrainSettings =
            serde_json::from_value(record.configuration).map_err(|error| {
                StoreError::malformed(&record_path, format!("its configuration: {error}"))
            })?;
        check(&settings).map_err(|reason| {
            StoreError::malformed(&record_path, format!("its configuration: {reason}"))
        })?;
        Ok(Self {
            path: path.to_owned(),
            normalization: record.normalization,
            renderer: settings.renderer,
            settings: settings.rendering,
            trained: Some(settings),
        })
    }

    pub(crate) fn model(&self) -> Result<Model, ReconstructError> {
        match &self.trained {
            Some(settings) => formats::read_model(&self.path, settings, &self.normalization),
            None => {
                let is_splat = self.path.extension().is_some_and(|kind| kind == "splat");
                let part = if is_splat {
                    let placement = placement(&self.path)?;
                    formats::read_splat(&self.path, &placement, &self.normalization)?
                } else {
                    formats::read_static(&self.path, &self.normalization)?
                };
                Ok(Model::new(vec![part]))
            }
        }
    }

    /// World units per second of normalized ones per frame.
    fn world_speed(&self, speed: f32) -> f64 {
        let dynamics = self.trained.as_ref().and_then(|run| run.dynamics.as_ref());
        let seconds = dynamics.map_or(1.0, |dynamics| dynamics.clock.frame_seconds);
        f64::from(speed) / self.normalization.scale / seconds
    }
}

/// How the coordinates of a `.splat` came from the world's: as the record beside it says, or not at all.
fn placement(path: &Path) -> Result<Placement, StoreError> {
    let record = path.parent().unwrap_or(Path::new(".")).join(ASSET_FILE);
    if !record.exists() {
        return Ok(Placement::WORLD);
    }
    let asset: Asset = store::read_record(&record)?;
    let name = path.file_name().and_then(|name| name.to_str());
    if asset
        .levels
        .iter()
        .all(|level| Some(level.file.as_str()) != name)
    {
        return Ok(Placement::WORLD);
    }
    let [w, x, y, z] = asset.placement.rotation_wxyz;
    Ok(Placement {
        offset: DVec3::from_array(asset.placement.offset),
        scale: asset.placement.scale,
        rotation: glam::DQuat::from_xyzw(x, y, z, w),
    })
}

/// Refuses sizes and bounds that no run has.
fn check(settings: &TrainSettings) -> Result<(), String> {
    if let Some(deformation) = &settings.deformation {
        deformation.model.check()?;
    }
    if let Some(dynamics) = &settings.dynamics {
        dynamics.time.check()?;
    }
    Ok(())
}

/// Frames with their times and poses, and the camera where the file has one.
struct CameraPath {
    camera: Option<Camera>,
    frames: Vec<(f64, Option<Pose>)>,
}

#[derive(Deserialize)]
struct Tag {
    schema: Option<String>,
}

fn read_path(path: &Path) -> Result<CameraPath, StoreError> {
    let text = std::fs::read_to_string(path).map_err(|source| StoreError::read(path, source))?;
    let tag = serde_json::from_str::<Tag>(&text).ok();
    let schema = tag.and_then(|tag| tag.schema);
    if schema.is_some_and(|schema| store::is_read_as::<Scene>(&schema)) {
        let scene: Scene = store::read_record(path)?;
        let frames = scene.frames.iter();
        return Ok(CameraPath {
            camera: Some(scene.camera),
            frames: frames
                .map(|frame| (frame.time_seconds, frame.pose))
                .collect(),
        });
    }
    let poses: Poses = store::read_record(path)?;
    let frames = poses.frames.iter();
    Ok(CameraPath {
        camera: poses.camera,
        frames: frames
            .map(|frame| (frame.time_seconds, Some(frame.pose)))
            .collect(),
    })
}

fn camera(request: &RenderRequest, given: Option<Camera>) -> Result<Camera, ReconstructError> {
    let of_poses = given.map(|camera| [camera.width(), camera.height()]);
    let [width, height] = request.size.or(of_poses).unwrap_or(DEFAULT_SIZE);
    if !(1..=LARGEST_SIDE).contains(&width) || !(1..=LARGEST_SIDE).contains(&height) {
        return Err(ReconstructError::Request {
            reason: format!("images are 1 to {LARGEST_SIDE} pixels wide and high"),
        });
    }
    process::require(
        u64::from(width) * u64::from(height) * BYTES_PER_PIXEL,
        &format!("rendering images of {width}x{height} pixels"),
    )?;
    let erp = Camera::Erp(ErpCamera { width, height });
    match request.camera {
        RenderCamera::OfPoses => Ok(given.map_or(erp, |camera| camera.resized(width, height))),
        RenderCamera::Erp => Ok(erp),
        RenderCamera::Pinhole(degrees) if degrees > 0.0 && degrees < 180.0 => {
            let radians = degrees.to_radians();
            Ok(PinholeCamera::with_horizontal_field_of_view(width, height, radians).into())
        }
        RenderCamera::Pinhole(_) => Err(ReconstructError::Request {
            reason: "a pinhole camera's field of view is between 0 and 180 degrees".to_owned(),
        }),
    }
}
