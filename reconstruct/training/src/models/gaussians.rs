//! Gaussians of a run, or of a file of any program, opened for rendering.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use omnilife_schemas::{
    RgbImage, Similarity,
    layout::{ASSET_FILE, RUN_FILE},
    records::{Asset, InvalidGaussians, Objects, Poses, RunRecord},
    store::{self, StoreError},
};
use serde::Deserialize;

use omnilife_engine::{
    camera::{Camera, View},
    clock::TimeSpan,
    gaussians::{
        ActivatedGaussians,
        static_gaussians::{self, StaticGaussians},
    },
    model::{
        Model, Part,
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
    formats::{
        self, GAUSSIAN_FILES, OBJECTS_FILE, axes::FileAxes, exchange, in_time, splat::Placement,
    },
    models::{Export, MapScale, ModelFormat, OpenRequest, OpenedModel},
};

/// Model format of Gaussians, static or dynamic.
pub const GAUSSIANS: ModelFormat = ModelFormat {
    files: GAUSSIAN_FILES,
    open,
    edit: None,
    exports: &[Export::Splats],
};

/// Opens Gaussians of a run or a file to render one of their layers.
///
/// # Errors
/// When a file is missing or malformed, or the layer does not exist.
pub fn open(request: &OpenRequest<'_>) -> Result<Box<dyn OpenedModel>, ReconstructError> {
    Ok(Box::new(OpenedGaussians::open(request)?))
}

/// Layers of Gaussians, by name.
const LAYERS: [(&str, Layer); 5] = [
    ("all", Layer::All),
    ("static", Layer::Static),
    ("dynamic", Layer::Dynamic),
    ("velocity", Layer::Velocity),
    ("depth", Layer::Depth),
];

/// Gaussians with their visible layer.
struct OpenedGaussians {
    source: Source,
    layer: Layer,
    layers: LayerRenderer,
    published: Option<(PublishedRenderer, ActivatedGaussians)>,
}

impl OpenedGaussians {
    fn open(request: &OpenRequest<'_>) -> Result<Self, ReconstructError> {
        let (layer, path) = (request.layer, request.path);
        let refuse = |reason: String| Err(ReconstructError::Request { reason });
        let named = LAYERS.iter().find(|(name, _)| *name == layer);
        let object = layer.strip_prefix("object:").and_then(|id| id.parse().ok());
        let Some(layer) = named.map(|&(_, layer)| layer).or(object.map(Layer::Object)) else {
            return refuse(format!(
                "the layer of Gaussians must be all, static, dynamic, velocity, depth or object:ID, got {layer:?}"
            ));
        };
        let mut source = Source::open(path, request.run, request.of_cameras)?;
        source.axes = request.axes;
        let is_published = source.renderer == RendererChoice::OdgsPublished;
        if is_published && (matches!(request.camera, Camera::Pinhole(_)) || layer != Layer::All) {
            return refuse("the published renderer of ODGS draws whole ERP views only".to_owned());
        }
        let mut invalid = InvalidGaussians::default();
        let model = source.model(&mut invalid)?;
        for note in formats::notes_on(path, &invalid) {
            request.progress.note(&note);
        }
        let layers = LayerRenderer::new(model, source.settings);
        let trained = request.run.and_then(|run| run.camera);
        let layers = match trained {
            Some(camera) => layers.trained_with(&camera),
            None => layers,
        };
        if let Some(reason) = layers.refusal(layer) {
            return refuse(reason.to_owned());
        }
        if matches!(layer, Layer::Dynamic | Layer::Velocity) && layers.is_static() {
            request.progress.note(&format!(
                "{}: all of its Gaussians are static, so the layer {} shows nothing",
                path.display(),
                request.layer
            ));
        }
        let published = is_published.then(|| {
            let mut gaussians = ActivatedGaussians::default();
            for part in &layers.model().parts {
                static_gaussians::activate(&part.table, &mut gaussians);
            }
            (PublishedRenderer::new(source.settings), gaussians)
        });
        Ok(Self {
            source,
            layer,
            layers,
            published,
        })
    }
}

impl OpenedModel for OpenedGaussians {
    fn normalization(&self) -> Similarity {
        self.source.normalization
    }

    fn image(&mut self, view: &View) -> Result<RgbImage, ReconstructError> {
        Ok(match &mut self.published {
            Some((renderer, gaussians)) => renderer.image(view, gaussians),
            None => self.layers.image(view, self.layer),
        })
    }

    fn has_opacity(&self) -> bool {
        matches!(self.layer, Layer::Object(_))
    }

    fn opacity(&mut self, view: &View) -> Result<RgbImage, ReconstructError> {
        Ok(self.layers.opacity(view, self.layer))
    }

    fn clip(&self) -> Option<TimeSpan> {
        self.layers.model().time_span()
    }

    fn map_scale(&self) -> Option<MapScale> {
        match self.layer {
            Layer::Velocity => {
                let speed = self.source.world_speed(self.layers.largest_speed());
                Some(MapScale::LargestSpeed(speed))
            }
            Layer::Depth => {
                let middle = f64::from(self.layers.middle_distance());
                let scale = self.source.normalization.scale;
                Some(MapScale::MiddleDistance(middle / scale))
            }
            Layer::All | Layer::Static | Layer::Dynamic | Layer::Object(_) => None,
        }
    }

    fn object_centres(&self, id: &str, seconds: &[f64]) -> Result<Vec<DVec3>, ReconstructError> {
        let objects = self.source.objects()?;
        let objects = objects.map_or_else(Vec::new, |objects| objects.objects);
        let found = objects.iter().find(|object| object.id.to_string() == id);
        let Some(object) = found else {
            let ids: Vec<String> = objects.iter().map(|one| one.id.to_string()).collect();
            let reason = if ids.is_empty() {
                format!("the model must have objects to show {id:?}, and it has none")
            } else {
                format!("the object must be one of {}, got {id:?}", ids.join(", "))
            };
            return Err(ReconstructError::Request { reason });
        };
        let centre = &object.path.centre;
        Ok(seconds.iter().map(|&time| centre.position(time)).collect())
    }

    fn up(&self) -> Result<Option<DVec3>, ReconstructError> {
        let objects = self.source.objects()?;
        Ok(objects.and_then(|objects| DVec3::from_array(objects.up).try_normalize()))
    }
}

/// Returns the clip of a run, as far as its record has it.
fn clip_of(run: &RunRecord) -> Option<TimeSpan> {
    let [begin_seconds, end_seconds] = run.clip_seconds?;
    let step = run.views.as_ref().and_then(Poses::seconds_per_frame);
    Some(TimeSpan {
        begin_seconds,
        end_seconds,
        frames: step.map(|step| ((end_seconds - begin_seconds) / step).round() as usize + 1),
    })
}

/// Gaussians with the settings of their renderer.
pub struct Source {
    /// A run's folder, or a file of Gaussians.
    path: PathBuf,
    /// Axes of a file without a record of its place.
    axes: Option<FileAxes>,
    /// Map from world to normalized coordinates.
    pub normalization: Similarity,
    renderer: RendererChoice,
    settings: RenderSettings,
    /// Settings of a run's training; `None` for a file.
    trained: Option<TrainSettings>,
    /// Clip of a run.
    clip: Option<TimeSpan>,
}

impl Source {
    /// Opens a run's Gaussians under the run's settings. A file has neither normalization nor settings: it is
    /// normalized by the cameras, and the minimum visible distance is a thousandth of their radius.
    fn open(
        path: &Path,
        run: Option<&RunRecord>,
        of_cameras: Similarity,
    ) -> Result<Self, ReconstructError> {
        let Some(record) = run else {
            return Ok(Self {
                path: path.to_owned(),
                axes: None,
                normalization: of_cameras,
                renderer: RendererChoice::Exact,
                settings: RenderSettings::new(1e-3),
                trained: None,
                clip: None,
            });
        };
        let record_path = path.join(RUN_FILE);
        let settings = TrainSettings::deserialize(&record.configuration).map_err(|error| {
            StoreError::malformed(&record_path, format!("its configuration: {error}"))
        })?;
        check(&settings).map_err(|reason| {
            StoreError::malformed(&record_path, format!("its configuration: {reason}"))
        })?;
        Ok(Self {
            path: path.to_owned(),
            axes: None,
            normalization: record.normalization,
            renderer: settings.renderer,
            settings: settings.rendering,
            trained: Some(settings),
            clip: clip_of(record),
        })
    }

    /// Opens Gaussians for export. A file keeps its own coordinates, around a place within it where 32-bit floats
    /// would lose them around the world's origin.
    ///
    /// # Errors
    /// When the settings of the run or a file of the model are malformed.
    pub fn open_in_place(path: &Path, run: Option<&RunRecord>) -> Result<Self, ReconstructError> {
        let offset = if run.is_some() {
            DVec3::ZERO
        } else if in_time::is_named(path) {
            in_time::origin(path)?
        } else {
            match placement(path)? {
                Some(placement) => placement.offset,
                None => exchange::origin(path)?,
            }
        };
        let in_place = Similarity::new(offset.to_array(), 1.0);
        Self::open(path, run, in_place)
    }

    /// Reads the Gaussians; invalid values are counted in `invalid`.
    ///
    /// # Errors
    /// When a file is missing or malformed.
    pub fn model(&self, invalid: &mut InvalidGaussians) -> Result<Model, ReconstructError> {
        match &self.trained {
            Some(settings) => {
                let model =
                    formats::read_model(&self.path, settings, &self.normalization, invalid)?;
                Ok(Model {
                    clip: self.clip,
                    ..model
                })
            }
            None if in_time::is_named(&self.path) && self.axes.is_some() => {
                Err(ReconstructError::Request {
                    reason: format!(
                        "{}: its header says where its axes point; leave them out",
                        self.path.display()
                    ),
                })
            }
            // Its header has the place in the world.
            None if in_time::is_named(&self.path) => {
                in_time::read(&self.path, &self.normalization, invalid)
            }
            None => {
                let placement = self.placement()?;
                let table = exchange::read(&self.path, &placement, &self.normalization, invalid)?;
                if table.is_empty() {
                    let reason = "must hold Gaussians, got none";
                    return Err(StoreError::malformed(&self.path, reason).into());
                }
                Ok(Model::new(vec![Part::new(StaticGaussians, table)]))
            }
        }
    }

    /// Returns the objects of a run, with sound paths; `None` for models without.
    fn objects(&self) -> Result<Option<Objects>, ReconstructError> {
        let file = self.path.join(OBJECTS_FILE);
        if self.trained.is_none() || !file.is_file() {
            return Ok(None);
        }
        let objects: Objects = store::read_record(&file)?;
        let mut all = objects.objects.iter();
        match all.find_map(|object| object.path.fault()) {
            Some(fault) => Err(StoreError::malformed(&file, format!("a path {fault}")).into()),
            None => Ok(Some(objects)),
        }
    }

    /// Returns how a file's coordinates came from the world's.
    fn placement(&self) -> Result<Placement, ReconstructError> {
        match (placement(&self.path)?, self.axes) {
            (Some(_), Some(_)) => Err(ReconstructError::Request {
                reason: format!(
                    "{}: the {ASSET_FILE} beside it says where its axes point; leave them out",
                    self.path.display()
                ),
            }),
            (Some(recorded), None) => Ok(recorded),
            (None, Some(axes)) => Ok(Placement {
                rotation: axes.to_world().inverse(),
                ..Placement::WORLD
            }),
            (None, None) => Ok(Placement::WORLD),
        }
    }

    /// Returns world units per second of normalized ones per frame.
    fn world_speed(&self, speed: f32) -> f64 {
        let dynamics = self.trained.as_ref().and_then(|run| run.dynamics.as_ref());
        let seconds = dynamics.map_or(1.0, |dynamics| dynamics.clock.frame_seconds);
        f64::from(speed) / self.normalization.scale / seconds
    }
}

/// Returns how the coordinates of an exported file came from the world's: as the record beside it says.
fn placement(path: &Path) -> Result<Option<Placement>, StoreError> {
    let record = path.parent().unwrap_or(Path::new(".")).join(ASSET_FILE);
    if !record.exists() {
        return Ok(None);
    }
    let asset: Asset = store::read_record(&record)?;
    let name = path.file_name().and_then(|name| name.to_str());
    if asset.splat_files().all(|file| Some(file) != name) {
        return Ok(None);
    }
    let [w, x, y, z] = asset.placement.rotation_wxyz;
    Ok(Some(Placement {
        offset: DVec3::from_array(asset.placement.offset),
        scale: asset.placement.scale,
        rotation: DQuat::from_xyzw(x, y, z, w),
    }))
}

/// Refuses sizes and bounds outside of every run's range.
fn check(settings: &TrainSettings) -> Result<(), String> {
    if let Some(deformation) = &settings.deformation {
        deformation.model.check()?;
    }
    if let Some(dynamics) = &settings.dynamics {
        dynamics.time.check()?;
    }
    Ok(())
}
