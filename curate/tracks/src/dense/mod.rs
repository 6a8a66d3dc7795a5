//! Dense points and distances of perspective frames by stereo, on the CPU and without weights.
//!
//! ```text
//! measure       for every frame:
//! neighbours    the frames it is compared with
//! sweep         the depth of its pixels against them
//! consistency   confirmation of each other's depths
//! fusion        one point for every small cube that frames agree on
//! ```

mod consistency;
mod fusion;
mod measure;
mod neighbours;
mod sweep;

use std::path::{Path, PathBuf};

use glam::DVec3;
use omnilife_schemas::{
    camera::{Camera, PinholeCamera},
    layout::{DENSE_FILE, POINTS_FILE, SCENE_FILE},
    npy,
    object_regions::Region,
    points::PointCloud,
    posed_view::{PosedView, frames_of},
    progress::Progress,
    records::{DenseFrame, DenseStereo, Scene},
    rgb::Mask,
    stage::StagePlan,
    staging::Staging,
    statistics, store,
};

use crate::error::TracksError;
use fusion::Cubes;
use measure::{LEAST_SEEN, MeasuredDepths, Stereo};

/// Default width at which depth is searched, pixels.
pub const SEARCH_WIDTH: u32 = 640;
/// Width at which a scene without points is searched for approximate depth, pixels.
const FIRST_WIDTH: u32 = 320;
/// Maximum number of points.
const MOST_POINTS: usize = 1_000_000;

/// Input and output of a measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct DenseRequest {
    /// Folder of the scene.
    pub scene_folder: PathBuf,
    /// A split whose input views alone are used; all frames if `None`.
    pub split: Option<PathBuf>,
    /// Frames that are wider are searched at this width, pixels.
    pub width: u32,
    /// Folder of the result.
    pub out: PathBuf,
}

/// A view should see a point in every so many of its pixels, to separate moving from static content.
const PIXELS_PER_POINT: usize = 16;

/// Returns why a scene's own points are too few to measure geometry with; `None` if they are enough.
///
/// # Errors
/// When they cannot be read.
pub fn few_points(scene: &Scene, folder: &Path) -> Result<Option<String>, TracksError> {
    let count = match &scene.points {
        Some(file) => PointCloud::read_ply(&folder.join(file))?.len(),
        None => 0,
    };
    let pixels: usize = scene.camera.size().iter().product();
    let is_few = count * PIXELS_PER_POINT < pixels;
    Ok(is_few.then(|| format!("the poses come with {count} points for images of {pixels} pixels")))
}

/// Measures the distances of a scene's frames; skipped, with a note, while nothing has changed.
///
/// # Errors
/// When the scene is missing, not a pinhole scene or not posed, no two frames overlap with parallax, or a file cannot
/// be read or written.
pub fn make_dense(
    request: &DenseRequest,
    progress: &dyn Progress,
) -> Result<DenseStereo, TracksError> {
    let scene_path = request.scene_folder.join(SCENE_FILE);
    let scene: Scene = store::read_record(&scene_path)?;
    let Camera::Pinhole(camera) = scene.camera else {
        return Err(TracksError::input(
            &scene_path,
            "its frames are panoramas; dense stereo is of perspective ones (methods sweep spheres \
             themselves where panoramas have no points)",
        ));
    };
    let frames = frames_of(&scene, request.split.as_deref())?;
    let plan = plan(request, &scene_path, &scene, &frames)?;
    let skipped = format!("{}: dense points unchanged, skipped", scene.id);
    plan.make((DENSE_FILE, &skipped), [DENSE_FILE], progress, |out| {
        store::remove(&out.path(DENSE_FILE))?;
        let (dense, staging) = measured(
            request,
            &scene_path,
            &scene,
            (camera, &frames[..]),
            progress,
        )?;
        out.replace(&staging.folder, &staging.files)?;
        Ok(dense)
    })
}

/// Measures the distances and stages their files.
fn measured(
    request: &DenseRequest,
    scene_path: &Path,
    scene: &Scene,
    (camera, frames): (PinholeCamera, &[u32]),
    progress: &dyn Progress,
) -> Result<(DenseStereo, Staging), TracksError> {
    let known = match &scene.points {
        Some(file) => PointCloud::read_ply(&request.scene_folder.join(file))?,
        None => PointCloud::default(),
    };
    let known: Vec<DVec3> = known.positions.into_iter().map(DVec3::from_array).collect();
    let mut warnings = Vec::new();
    let mut work = Stereo {
        folder: &request.scene_folder,
        scene,
        views: PosedView::of_scene(scene, frames),
        points: known,
    };
    let none = |reason: &str| TracksError::input(scene_path, reason);
    if work.points.len() < LEAST_SEEN {
        let width = request.width.min(FIRST_WIDTH);
        work.points = work
            .first_points(&work.sized(camera, width), progress)?
            .ok_or_else(|| none(NO_PARALLAX))?;
        let note =
            "the scene came with too few points; depths were searched from infinity on at first";
        warnings.push(note.to_owned());
    }
    let maps = work.measure(&work.sized(camera, request.width), progress)?;
    let maps = maps.ok_or_else(|| none(NO_PARALLAX))?;
    let mut staging = Staging::new(&request.out, "dense")?;
    let dense = stage(&work, &mut staging, &maps, warnings)?;
    for warning in &dense.warnings {
        progress.note(&format!("warning: {}: {warning}", scene.id));
    }
    Ok((dense, staging))
}

const NO_PARALLAX: &str = "no two of its frames see one place from two places: a camera that turns or hovers \
                           gives no depth";

/// Lists everything that the result depends on.
fn plan(
    request: &DenseRequest,
    scene_path: &Path,
    scene: &Scene,
    frames: &[u32],
) -> Result<StagePlan, TracksError> {
    let mut plan = StagePlan::new(&request.out, "dense")
        .with_file(scene_path)?
        .with_settings("frames", &frames)
        .with_settings("width", &request.width);
    let of_frames = frames
        .iter()
        .filter_map(|&frame| scene.frames.get(frame as usize))
        .flat_map(|entry| {
            let moving = Region::Moving.source(scene, entry);
            let moving = moving.map_or_else(Vec::new, |source| source.files());
            std::iter::once(entry.image.as_str())
                .chain(moving)
                .chain(entry.ignore_mask.as_deref())
        });
    for file in scene.points.as_deref().into_iter().chain(of_frames) {
        plan = plan.with_file(&request.scene_folder.join(file))?;
    }
    Ok(plan)
}

/// Writes distances, confidences and points.
fn stage(
    stereo: &Stereo<'_>,
    staging: &mut Staging,
    measured: &[MeasuredDepths],
    mut warnings: Vec<String>,
) -> Result<DenseStereo, TracksError> {
    let camera = measured.first().map_or_else(
        || stereo.scene.camera,
        |view| Camera::Pinhole(view.map.camera),
    );
    let [width, height] = camera.size();
    let mut frames = Vec::with_capacity(measured.len());
    for view in measured {
        let frame = view.map.view.frame;
        let (distances, confidence) = (format!("{frame:06}.npy"), format!("{frame:06}.png"));
        let values: Vec<f32> = (0..width * height)
            .map(|pixel| match view.confidence[pixel] > 0.0 {
                true => view.map.distance(pixel),
                false => 0.0,
            })
            .collect();
        npy::write_f32(&staging.begin(&distances)?, &[height, width], &values)?;
        let grey: Vec<u8> = view
            .confidence
            .iter()
            .map(|share| (255.0 * share).round() as u8)
            .collect();
        let known = grey.iter().filter(|&&value| value > 0).count();
        Mask {
            width,
            height,
            data: grey,
        }
        .write_png(&staging.begin(&confidence)?)?;
        let [farthest, nearest] = view.inverse_depths;
        frames.push(DenseFrame {
            frame,
            distances,
            confidence,
            compared_with: view
                .compared_with
                .iter()
                .map(|&other| stereo.views[other].frame)
                .collect(),
            searched: (
                if nearest > 0.0 { 1.0 / nearest } else { 0.0 },
                (farthest > 0.0).then(|| 1.0 / farthest),
            ),
            hypotheses: view.hypotheses as u32,
            known_share: known as f64 / (width * height) as f64,
        });
    }
    let fine = fused(measured);
    let fine_edge = fine.edge();
    let cubes = fine.joined(MOST_POINTS);
    if cubes.edge() > fine_edge {
        warnings.push(format!(
            "points of cubes of {fine_edge:.3} units were more than {MOST_POINTS}; they are of cubes of {:.3}",
            cubes.edge()
        ));
    }
    let cloud = cubes.cloud();
    cloud.write_ply(&staging.begin(POINTS_FILE)?)?;
    let alone = frames.iter().filter(|frame| frame.compared_with.is_empty());
    let alone = alone.count();
    if alone > 0 {
        warnings.push(format!(
            "{alone} of {} frames could be compared with no other one",
            frames.len()
        ));
    }
    Ok(DenseStereo {
        scene: stereo.scene.id.clone(),
        geometry_sha256: stereo.scene.geometry_sha256(),
        ignored_sha256: stereo.scene.ignored_sha256(stereo.folder)?,
        image_size: [width as u32, height as u32],
        frames,
        points: POINTS_FILE.to_owned(),
        point_count: cloud.len() as u64,
        spacing: cubes.edge(),
        warnings,
    })
}

/// Fuses the known pixels of all views into cubes of two pixels' width at the median distance.
fn fused(measured: &[MeasuredDepths]) -> Cubes {
    let pixels: Vec<f64> = measured
        .iter()
        .filter_map(|view| {
            let known: Vec<f64> = (0..view.confidence.len())
                .step_by(11)
                .filter(|&pixel| view.confidence[pixel] > 0.0)
                .map(|pixel| f64::from(view.map.depths[pixel]))
                .collect();
            Some(statistics::median(&known)? / view.map.camera.fx)
        })
        .collect();
    let mut cubes = Cubes::new(2.0 * statistics::median(&pixels).unwrap_or(1.0));
    for view in measured {
        let colours = view.colours.as_chunks::<3>().0;
        for (pixel, (&confidence, colour)) in view.confidence.iter().zip(colours).enumerate() {
            if confidence > 0.0 {
                let colour = colour.map(|value| f32::from(value) / 255.0);
                cubes.add(view.map.point(pixel), colour);
            }
        }
    }
    cubes
}
