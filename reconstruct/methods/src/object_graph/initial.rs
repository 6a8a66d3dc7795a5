//! First Gaussians of objects: at the entry points of pixels' rays into their boxes.

use glam::{DVec3, Vec3, dvec2};
use omnilife_engine::{
    camera::CameraKernels,
    gaussians::{static_gaussians::InitialGaussians, tracked::TrackedObject},
    training_view::TrainingView,
    trajectories::rigid_path::{RigidPath, RigidPose},
};
use omnilife_schemas::{
    camera::CameraModel,
    records::{Track, Tracks},
};

use omnilife_training::scene::TrainingScene;

/// Maximum number of views for an object's Gaussians.
const VIEWS: usize = 8;
/// Maximum number of an object's first Gaussians.
const MOST: usize = 2_000;
/// Below this many, Gaussians are spread evenly in the box instead (4DGF).
const LEAST: usize = 32;
/// Inverse of the objects' maximum share of all Gaussians: the rest is for what does not move.
const PART_OF_LIMIT: u64 = 2;
/// An object's bound is at least this, so that what regular steps over its pixels leave is rarely below [`LEAST`].
const LEAST_BOUND: usize = 4 * LEAST;
/// First opacity.
const OPACITY: f32 = 0.5;
/// Seconds from one knot of pose corrections to the next.
const KNOT_SECONDS: f64 = 2.0;

/// Objects with their first Gaussians.
#[derive(Debug, Default)]
pub(crate) struct FirstObjects {
    pub(crate) objects: Vec<TrackedObject>,
    pub(crate) gaussians: InitialGaussians,
    /// The object of each Gaussian.
    pub(crate) numbers: Vec<usize>,
    pub(crate) warnings: Vec<String>,
}

/// Returns the objects of a scene's tracks. Where their Gaussians would be more than half of the limit on all, each
/// object gets fewer and larger ones, for about that half together, with a warning.
///
/// An object has at most `per_pixel` Gaussians for each pixel of the view that shows it largest.
pub(crate) fn objects(
    scene: &TrainingScene,
    tracks: &Tracks,
    limit: u64,
    per_pixel: f64,
) -> FirstObjects {
    let first = bounded(scene, tracks, MOST, per_pixel);
    let (wanted, most) = (first.gaussians.len(), (limit / PART_OF_LIMIT) as usize);
    if wanted <= most {
        return first;
    }
    let bound = most / tracks.tracks.len().max(1);
    let mut fewer = bounded(scene, tracks, bound.clamp(LEAST_BOUND, MOST), per_pixel);
    fewer.warnings.push(format!(
        "objects start with {} Gaussians instead of {wanted}: 1/{PART_OF_LIMIT} of the limit of {limit} is for them",
        fewer.gaussians.len()
    ));
    fewer
}

/// Returns the objects of a scene's tracks with about `most` Gaussians each, or fewer.
fn bounded(scene: &TrainingScene, tracks: &Tracks, most: usize, per_pixel: f64) -> FirstObjects {
    let mut first = FirstObjects::default();
    for track in &tracks.tracks {
        let object = tracked_object(scene, track, DVec3::from_array(tracks.up));
        let (mut gaussians, views) = seen(scene, &object, most, per_pixel);
        if views == 0 {
            first.warnings.push(format!(
                "object {} is in no input view and is left out",
                object.id
            ));
            continue;
        }
        if gaussians.len() < LEAST {
            first.warnings.push(format!(
                "object {} is seen in {} sampled pixels: its Gaussians are spread evenly in its box",
                object.id,
                gaussians.len()
            ));
            gaussians = evenly(&object);
        }
        let number = first.objects.len();
        first
            .numbers
            .extend(std::iter::repeat_n(number, gaussians.len()));
        first.gaussians.append(gaussians);
        first.objects.push(object);
    }
    first
}

/// Returns the object of a track on its given path.
pub(super) fn tracked_object(scene: &TrainingScene, track: &Track, up: DVec3) -> TrackedObject {
    let dimensions = track
        .dimensions
        .map(|side| (side * scene.normalization.scale) as f32);
    let [begin, end] = track.path.centre.range();
    let knots = ((end - begin) / KNOT_SECONDS).ceil() as usize + 1;
    // At most as many as the detections can distinguish.
    let knots = knots.min((track.detections as usize / 2).max(1));
    TrackedObject {
        id: track.id,
        dimensions,
        path: RigidPath::new(
            &track.path,
            up,
            0.5 * dimensions[0],
            knots,
            &scene.normalization,
        ),
    }
}

/// Returns about `most` Gaussians, or fewer, where pixels see an object's box, in its coordinates, and the number of
/// views that see it.
fn seen(
    scene: &TrainingScene,
    object: &TrackedObject,
    most: usize,
    per_pixel: f64,
) -> (InitialGaussians, usize) {
    let corrections = vec![0.0; object.path.correction_len()];
    let mut sightings: Vec<(&TrainingView, RigidPose, [usize; 4])> = scene
        .input_views
        .iter()
        .filter_map(|view| {
            let pose = object.path.pose(view.view.time_seconds, &corrections)?;
            Some((view, pose, pixel_range(scene, view, object, &pose)?))
        })
        .collect();
    let area = |[left, top, right, bottom]: &[usize; 4]| (right - left) * (bottom - top);
    sightings.sort_by_key(|(view, _, range)| (std::cmp::Reverse(area(range)), view.frame));
    sightings.truncate(VIEWS);
    let largest = sightings.first().map_or(0, |(_, _, range)| area(range));
    let most = most.min((per_pixel * largest as f64) as usize);
    let mut all = InitialGaussians::default();
    let width = scene.camera.width() as usize;
    for (view, pose, range) in &sightings {
        let [left, top, right, bottom] = *range;
        let of_view = (most / sightings.len().max(1)).max(1);
        let step = ((area(range) as f64 / of_view as f64).sqrt().ceil() as usize).max(1);
        for row in (top..bottom).step_by(step) {
            for column in (left..right).step_by(step) {
                let Some((position, distance)) = entry(scene, view, object, pose, [column, row])
                else {
                    continue;
                };
                if !view.shows_scene(row * width + column) {
                    continue;
                }
                let pixel = 3 * (row * width + column);
                let footprint = scene.camera.pixel_radians() * distance * step as f32;
                let colour =
                    [0, 1, 2].map(|channel| f32::from(view.pixels[pixel + channel]) / 255.0);
                let scale = 0.6 * footprint / object.unit();
                all.push_isotropic(position.to_array(), scale, colour, OPACITY);
            }
        }
    }
    (all, sightings.len())
}

/// Returns which pixels of each input view show the box of an object; a view that shows none has no entries.
pub(crate) fn covered(scene: &TrainingScene, objects: &[TrackedObject]) -> Vec<Vec<bool>> {
    let [width, height] = scene.camera.size();
    let of_view = |view: &TrainingView| {
        let mut pixels = Vec::new();
        for object in objects {
            let corrections = vec![0.0; object.path.correction_len()];
            let pose = object.path.pose(view.view.time_seconds, &corrections);
            let Some((pose, range)) =
                pose.and_then(|pose| Some((pose, pixel_range(scene, view, object, &pose)?)))
            else {
                continue;
            };
            pixels.resize(width * height, false);
            let [left, top, right, bottom] = range;
            for row in top..bottom {
                for column in left..right {
                    pixels[row * width + column] |=
                        entry(scene, view, object, &pose, [column, row]).is_some();
                }
            }
        }
        pixels
    };
    scene.input_views.iter().map(of_view).collect()
}

/// Returns columns and rows (from, to) of the pixels that an object's box may cover; `None` where it is not
/// visible.
pub(super) fn pixel_range(
    scene: &TrainingScene,
    view: &TrainingView,
    object: &TrackedObject,
    pose: &RigidPose,
) -> Option<[usize; 4]> {
    let [width, height] = scene.camera.size();
    let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
    let mut corners = 0;
    for corner in 0..8 {
        let side = |axis: usize| if corner >> axis & 1 == 1 { 0.5 } else { -0.5 };
        let own = Vec3::from_array([0, 1, 2].map(|axis| side(axis) * object.dimensions[axis]));
        let point = view.view.rotation * (pose.rotation * own + pose.centre - view.view.centre);
        if let Some(pixel) = scene.camera.pixel_of(point, point.length()) {
            corners += 1;
            for axis in 0..2 {
                low[axis] = low[axis].min(pixel[axis]);
                high[axis] = high[axis].max(pixel[axis] + 1);
            }
        }
    }
    // At least half of it in the image, and not across the seam of a panorama.
    let is_seen = corners >= 4 && high[0] - low[0] <= width / 2 && high[1] <= height;
    is_seen.then(|| [low[0], low[1], high[0], high[1]])
}

/// Returns the entry point of a pixel's ray into an object's box, in its coordinates, and its distance from the
/// camera.
fn entry(
    scene: &TrainingScene,
    view: &TrainingView,
    object: &TrackedObject,
    pose: &RigidPose,
    [column, row]: [usize; 2],
) -> Option<(Vec3, f32)> {
    let centre = dvec2(column as f64 + 0.5, row as f64 + 0.5);
    let ray = view.view.rotation.transpose() * scene.camera.unproject(centre).as_vec3();
    let to_own = pose.rotation.transpose();
    let unit = object.unit();
    let origin = to_own * (view.view.centre - pose.centre) / unit;
    let direction = to_own * ray / unit;
    let half = object.half_box();
    let (mut from, mut to) = (0.0_f32, f32::INFINITY);
    for axis in 0..3 {
        let [a, b] = [-half[axis], half[axis]].map(|side| (side - origin[axis]) / direction[axis]);
        from = from.max(a.min(b));
        to = to.min(a.max(b));
    }
    (from < to && from > 0.0).then(|| (origin + direction * from, from))
}

/// Returns Gaussians on a grid in an object's box.
fn evenly(object: &TrackedObject) -> InitialGaussians {
    const SIDE: usize = 4;
    let half = object.half_box();
    let mut all = InitialGaussians::default();
    for index in 0..SIDE * SIDE * SIDE {
        let place = [index % SIDE, index / SIDE % SIDE, index / SIDE / SIDE];
        let position = [0, 1, 2]
            .map(|axis| half[axis] * (2.0 * (place[axis] as f32 + 0.5) / SIDE as f32 - 1.0));
        let scale = 0.5 * half[1].min(half[2]) / SIDE as f32;
        all.push_isotropic(position, scale, [0.5; 3], OPACITY);
    }
    all
}
