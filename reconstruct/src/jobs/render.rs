//! Rendering of models along given poses: those of runs in layers, and Gaussians of other programs.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use glam::DVec3;
use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    camera::{
        ErpCamera, PinholeCamera,
        cube::{CUBE_FACES, face_camera, side_of_equal_resolution},
    },
    layout::CAMERAS_FILE,
    ownership::{NameState, OwnFile},
    plain_text,
    progress::Progress,
    records::{WordedView, WordedViews},
    stage::StagePlan,
    store,
};

use omnilife_engine::camera::{Camera, View};

use super::{
    camera_path::{CameraPath, PlacedFrame},
    camera_words::{CameraPlaces, CameraWords, SceneContext, of_poses},
    cube_faces,
    layer_image::{self, LayerImage},
    render_notes,
    unseen::{self, InputViews},
};
use crate::registry::{self, OpenedRun};
use omnilife_training::{
    error::ReconstructError,
    formats::axes::FileAxes,
    models::{MapScale, OpenModel, OpenRequest, OpenedModel, gaussians},
    process,
};

/// Request of a rendering.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderRequest {
    /// A run's folder, or a file of Gaussians in any of the
    /// [formats of exchange](omnilife_training::formats::exchange::SPLAT_FORMATS).
    pub model: PathBuf,
    /// Axes of a file in the world of the poses, of SPZ and glTF once they are turned to y down; `None` for the same
    /// axes.
    pub axes: Option<FileAxes>,
    /// A `poses.json` or `scene.json`.
    pub poses: PathBuf,
    /// The cameras; by default those of the poses.
    pub cameras: CameraWords,
    /// Width and height in pixels; by default those of the poses' frames, else of a run's panoramas, else 1024x512. Faces of a cube have as many pixels per
    /// degree as panoramas of that size.
    pub size: Option<[u32; 2]>,
    /// Camera of the images.
    pub camera: RenderCamera,
    /// The visible layer, by its name in models of that kind. Images of single objects have straight alpha.
    pub layer: String,
    /// Width of the perspective cube faces that panoramas are made of, pixels.
    pub cube_faces: Option<u32>,
    /// Folder of the images.
    pub out: PathBuf,
}

/// The camera of rendered images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RenderCamera {
    /// The camera of the poses; ERP for poses without a camera.
    OfPoses,
    /// ERP.
    Erp,
    /// A pinhole with a centred principal point and this horizontal field of view in degrees.
    Pinhole(f64),
    /// The six faces of a cube ([`CUBE_FACES`]), one image each.
    Cube,
}

/// Result of a rendering.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedViews {
    /// PNG files `<number of the frame, 6 digits>.png`, in order. Faces are `<number>-<name of the face>.png`.
    pub files: Vec<PathBuf>,
    /// Number of rendered frames.
    pub views: usize,
    /// The camera of the images.
    pub camera: Camera,
    /// Presentation timestamps in seconds, one per file.
    pub times_seconds: Vec<f64>,
    /// Number of frames without a usable pose; they are left out.
    pub unposed: usize,
    /// Meaning of the values of a map; `None` for layers that are images.
    pub map_scale: Option<MapScale>,
    /// Record of cameras by words; `None` for those of the poses.
    pub cameras: Option<WordedViews>,
}

/// Default size of ERP images, if the poses have no size.
const DEFAULT_SIZE: [u32; 2] = [1024, 512];
/// Minimum memory of rendering per pixel: accumulated colours, transmittance and depth in f32, their image, and
/// its bytes for writing.
const BYTES_PER_PIXEL: u64 = 5 * 4 + 3 * 4 + 3;
/// Maximum side of images, pixels.
const LARGEST_SIDE: u32 = 1 << 15;

/// Returns the size at which the frames of a `poses.json` or `scene.json` are rendered by default, pixels.
///
/// # Errors
/// When the file cannot be read as either.
pub fn frame_size(poses: &Path) -> Result<[u32; 2], ReconstructError> {
    let camera = CameraPath::read(poses)?.camera;
    Ok(camera.map_or(DEFAULT_SIZE, |camera| [camera.width(), camera.height()]))
}

/// Renders every posed frame, or every frame of cameras by words; of these it writes a record too ([`CAMERAS_FILE`]).
///
/// # Errors
/// When a file is missing or malformed, no frame has a pose, words do not suit the scene, an image of another origin
/// would be replaced, or one cannot be written.
pub fn render_poses(
    request: &RenderRequest,
    progress: &dyn Progress,
) -> Result<RenderedViews, ReconstructError> {
    let path = CameraPath::read(&request.poses)?;
    let posed = path.posed();
    let centres: Vec<DVec3> = posed.iter().map(|frame| frame.pose.centre()).collect();
    let mut of_cameras = Similarity::from_most_cameras(&centres)
        .ok_or_else(|| ReconstructError::scene(&request.poses, "has no usable pose"))?;
    if centres.iter().all(|centre| *centre == centres[0]) {
        // Cameras in one place do not determine the size of the scene: its own unit is as good as any.
        of_cameras.scale = 1.0;
    }
    let run = run_of(request)?;
    let trained = run.as_ref().and_then(|run| run.record.camera);
    let camera = camera(request, path.camera, trained)?;
    if let Some(note) = render_notes::stretched(camera, path.camera) {
        progress.note(&note);
    }
    let mut opened = open(request, run.as_ref(), of_cameras, camera, progress)?;
    let (frames, cameras) = if request.cameras.are_of_poses() {
        let (places, count) = (&request.cameras.places, path.frames.len());
        (of_poses(places, &request.poses, count, &posed)?, None)
    } else {
        let (frames, record) = worded(request, &path, &posed, camera, &*opened)?;
        (frames, Some(record))
    };
    if let Some(note) = render_notes::outside_of_clip(opened.clip(), &frames) {
        progress.note(&format!("{}: {note}", request.poses.display()));
    }
    let unposed = match request.cameras.places {
        CameraPlaces::OfPoses => path.frames.len() - posed.len(),
        // Their cameras are at all times.
        _ => 0,
    };
    let stage = StagePlan::new(&request.out, "render");
    let images = frames
        .iter()
        .flat_map(|frame| image_files(frame.number, request.camera));
    let record = cameras.iter().map(|_| CAMERAS_FILE.to_owned());
    let files = images.chain(record).collect::<BTreeSet<_>>();
    // Ground truth has the same names.
    stage.run(&files, progress, |out| {
        progress.begin("rendering", Some(frames.len() as u64));
        let mut rendered = RenderedViews {
            files: Vec::with_capacity(files.len()),
            views: frames.len(),
            camera,
            times_seconds: Vec::with_capacity(files.len()),
            unposed,
            map_scale: opened.map_scale(),
            cameras,
        };
        let render = |frame: &PlacedFrame| -> Result<(), ReconstructError> {
            let images = images_at(&mut *opened, request, camera, (&frame.pose, frame.seconds))?;
            let images = images.ok_or_else(|| {
                ReconstructError::scene(
                    &request.poses,
                    format!("frame {} has no usable pose", frame.number),
                )
            })?;
            let names = image_files(frame.number, request.camera);
            for (file, image) in names.iter().zip(images) {
                let file = request.out.join(file);
                image.write_png(&file)?;
                rendered.files.push(file);
                rendered.times_seconds.push(frame.seconds);
            }
            progress.advance(1);
            Ok(())
        };
        let outcome = frames.iter().try_for_each(render);
        progress.end();
        outcome?;
        if let Some(record) = &rendered.cameras {
            out.write_record(CAMERAS_FILE, record)?;
        }
        out.add_all(files.iter().filter(|file| *file != CAMERAS_FILE));
        // Images of earlier renderings stay, and stay this stage's own; a record of other cameras does not.
        let own = stage.own_files();
        let mut earlier = Vec::new();
        for OwnFile { file, .. } in own.files() {
            if out.has(&file) || own.standing(&file)? != NameState::Ours {
                continue;
            }
            if file == CAMERAS_FILE {
                store::remove(&request.out.join(file))?;
            } else {
                earlier.push(file.clone());
                out.add(file);
            }
        }
        if !earlier.is_empty() {
            progress.note(&format!(
                "{}: images of earlier renderings stay: {} ({}); a folder of its own holds these alone",
                request.out.display(),
                earlier.len(),
                plain_text::first_of(&earlier)
            ));
        }
        Ok(rendered)
    })
}

/// Returns the frames of cameras by words, with their record.
fn worded(
    request: &RenderRequest,
    path: &CameraPath,
    posed: &[PlacedFrame],
    camera: Camera,
    opened: &dyn OpenedModel,
) -> Result<(Vec<PlacedFrame>, WordedViews), ReconstructError> {
    let words = &request.cameras;
    let split = words.split.as_deref();
    let given = path.input_views(&request.poses, split)?;
    let points = path.points(&request.poses, split)?;
    let seconds: Vec<f64> = path.frames.iter().map(|&(time, _)| time).collect();
    let surroundings = SceneContext {
        file: &request.poses,
        seconds: &seconds,
        posed,
        points: &points,
        camera,
        posed_camera: path.camera,
    };
    let frames = surroundings.frames(words, opened)?;
    let given: BTreeSet<usize> = given.iter().map(|&frame| frame as usize).collect();
    let given = posed.iter().filter(|frame| given.contains(&frame.number));
    let given: Vec<Pose> = given.map(|frame| frame.pose).collect();
    let [width, height] = DEFAULT_SIZE;
    let sphere = Camera::Erp(ErpCamera { width, height });
    // Faces of a cube show the whole sphere.
    let shown = match request.camera {
        RenderCamera::Cube => sphere,
        _ => camera,
    };
    let poses: Vec<Pose> = frames.iter().map(|frame| frame.pose).collect();
    let views = InputViews::new(path.camera.unwrap_or(sphere), &given, &points);
    let shares = views.as_ref().map_or_else(
        || vec![None; poses.len()],
        |views| views.unseen_shares(shown, &poses),
    );
    let worded = frames.iter().zip(shares);
    let record = WordedViews {
        cameras: words.to_string(),
        definition: unseen::DEFINITION.to_owned(),
        input_views: given.len() as u32,
        unmeasured: views
            .is_none()
            .then(|| "the scene has no points, or no posed input views".to_owned()),
        views: worded
            .map(|(frame, unseen_share)| WordedView {
                files: image_files(frame.number, request.camera),
                time_seconds: frame.seconds,
                pose: frame.pose,
                unseen_share,
            })
            .collect(),
    };
    Ok((frames, record))
}

/// Returns the names of a frame's images.
fn image_files(number: usize, camera: RenderCamera) -> Vec<String> {
    match camera {
        RenderCamera::Cube => {
            let faces = CUBE_FACES.iter();
            faces
                .map(|face| format!("{number:06}-{}.png", face.name))
                .collect()
        }
        _ => vec![format!("{number:06}.png")],
    }
}

/// Renders the images of a frame; `None` where its pose cannot be used.
fn images_at(
    opened: &mut dyn OpenedModel,
    request: &RenderRequest,
    camera: Camera,
    place: (&Pose, f64),
) -> Result<Option<Vec<LayerImage>>, ReconstructError> {
    layer_image::draw(opened, |opened| colours_at(opened, request, camera, place))
}

/// Renders the colours of a frame's images.
fn colours_at(
    opened: &mut dyn OpenedModel,
    request: &RenderRequest,
    camera: Camera,
    (pose, time): (&Pose, f64),
) -> Result<Option<Vec<RgbImage>>, ReconstructError> {
    let normalization = opened.normalization();
    let place = (pose, &normalization, time);
    match (request.camera, request.cube_faces, camera) {
        (RenderCamera::Cube, ..) => cube_faces::faces(opened, camera.width(), place),
        (_, Some(side), Camera::Erp(camera)) => {
            let panorama = cube_faces::panorama(opened, camera, side, place)?;
            Ok(panorama.map(|image| vec![image]))
        }
        _ => match View::new(camera, pose, &normalization, time) {
            Some(view) => Ok(Some(vec![opened.image(&view)?])),
            None => Ok(None),
        },
    }
}

/// Reads the run to render; `None` for a file of Gaussians.
fn run_of(request: &RenderRequest) -> Result<Option<OpenedRun>, ReconstructError> {
    let is_run = request.model.is_dir();
    if is_run && request.axes.is_some() {
        return Err(ReconstructError::Request {
            reason: format!(
                "{}: a run lies in the world of its scene; axes are those of a file",
                request.model.display()
            ),
        });
    }
    is_run
        .then(|| registry::open_run(&request.model))
        .transpose()
}

/// Opens a model: a run of any kind, or a file of Gaussians.
fn open(
    request: &RenderRequest,
    run: Option<&OpenedRun>,
    of_cameras: Similarity,
    camera: Camera,
    progress: &dyn Progress,
) -> Result<Box<dyn OpenedModel>, ReconstructError> {
    let open = run.map_or(gaussians::open as OpenModel, |run| run.model.open);
    open(&OpenRequest {
        path: &request.model,
        run: run.map(|run| &run.record),
        layer: &request.layer,
        axes: request.axes,
        of_cameras,
        camera,
        progress,
    })
}

/// Returns the camera of the images: of the size of the poses' frames, or else of the panoramas that a run was trained
/// with.
fn camera(
    request: &RenderRequest,
    given: Option<Camera>,
    trained: Option<Camera>,
) -> Result<Camera, ReconstructError> {
    let trained = trained.filter(|camera| matches!(camera, Camera::Erp(_)));
    let of_poses = given.or(trained);
    let of_poses = of_poses.map_or(DEFAULT_SIZE, |camera| [camera.width(), camera.height()]);
    let by_default = match (request.camera, given) {
        (RenderCamera::Cube, Some(Camera::Pinhole(_))) => [of_poses[0]; 2],
        (RenderCamera::Cube, _) => [side_of_equal_resolution(of_poses[0]); 2],
        _ => of_poses,
    };
    let [width, height] = request.size.unwrap_or(by_default);
    if !(1..=LARGEST_SIDE).contains(&width) || !(1..=LARGEST_SIDE).contains(&height) {
        return Err(ReconstructError::Request {
            reason: format!(
                "images must be 1 to {LARGEST_SIDE} pixels wide and high, got {width}x{height}"
            ),
        });
    }
    process::require(
        u64::from(width) * u64::from(height) * BYTES_PER_PIXEL,
        &format!("rendering images of {width}x{height} pixels"),
    )?;
    let erp = Camera::Erp(ErpCamera { width, height });
    let found = match request.camera {
        RenderCamera::OfPoses => Ok(given.map_or(erp, |camera| camera.resized(width, height))),
        RenderCamera::Erp => Ok(erp),
        RenderCamera::Pinhole(degrees) if degrees > 0.0 && degrees < 180.0 => {
            let radians = degrees.to_radians();
            Ok(PinholeCamera::with_horizontal_field_of_view(width, height, radians).into())
        }
        RenderCamera::Cube if width == height => Ok(face_camera(width).into()),
        RenderCamera::Cube => Err(ReconstructError::Request {
            reason: format!("faces of a cube must be squares, got {width}x{height}"),
        }),
        RenderCamera::Pinhole(_) => Err(ReconstructError::Request {
            reason: "--fov-degrees must be between 0 and 180 degrees".to_owned(),
        }),
    }?;
    match request.cube_faces {
        Some(_) if !matches!(found, Camera::Erp(_)) => Err(ReconstructError::Request {
            reason: "only panoramas are put together from cube faces".to_owned(),
        }),
        Some(side) if !(8..=LARGEST_SIDE).contains(&side) => Err(ReconstructError::Request {
            reason: format!("cube faces must be 8 to {LARGEST_SIDE} pixels wide, got {side}"),
        }),
        _ => Ok(found),
    }
}
