//! Photometric alignment of an object's patch: its images in all views against one of them.
//!
//! Pixels of a reference view whose rays enter the object's box are points of the object, where the rays enter. The
//! path brings them to every other view; [`omnilife_training::alignment`] finds by which motion on the ground they
//! miss, from coarse images to fine ones.

use glam::{DMat3, DVec2, DVec3, dvec2};
use omnilife_engine::{
    camera::{CameraKernels, View},
    gaussians::tracked::TrackedObject,
    training_view::TrainingView,
};
use omnilife_schemas::{camera::CameraModel, oriented_box::OrientedBox, statistics::median};
use omnilife_training::{
    alignment::{Alignment, CHANNELS, PlanarMotion, Template, TemplatePoint},
    scene::TrainingScene,
};

use super::initial;

/// Margin of a box along the ground, as a share of its sides: its path may be off in the reference view too.
const MARGIN: f32 = 0.1;
/// Minimum number of a template's points.
const LEAST_POINTS: usize = 24;
/// About the maximum number of a template's points.
const MOST_POINTS: usize = 4_000;
/// Places of reference views among all views of an object, by time, as shares.
const REFERENCES: [f64; 3] = [0.5, 0.25, 0.75];
/// Minimum correlation of a patch with its reference.
const LEAST_CORRELATION: f64 = 0.6;
/// Maximum shift in lengths of the object: farther, a patch has met another one.
const LARGEST_SHIFT: f64 = 0.5;
/// Maximum turn, radians.
const LARGEST_TURN: f64 = 0.5;
/// Step of difference quotients, of the object's unit.
const STEP: f64 = 1e-3;

/// Object in one view, on its given path.
#[derive(Debug, Clone, Copy)]
struct Sighting {
    /// Number of the view among the input views.
    view: usize,
    seconds: f64,
    /// Rotation from the object's axes to the world's.
    rotation: DMat3,
    centre: DVec3,
}

/// Motion of an object on the ground, in its own axes, by which a view differs from its path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Miss {
    /// Time of the view.
    pub(super) seconds: f64,
    /// Rotation from the object's axes to the world's, on the path.
    pub(super) rotation: DMat3,
    /// The motion, normalized units and radians.
    pub(super) motion: PlanarMotion,
    /// Variance of the shift along an axis, normalized units squared.
    pub(super) shift_variance: f64,
    /// Variance of the turn, radians squared.
    pub(super) turn_variance: f64,
}

/// Alignment of an object's images with one of them.
pub(super) struct Patches<'a> {
    finest: (&'a TrainingScene, Template),
    sightings: Vec<Sighting>,
    /// Number of the reference among the sightings.
    reference: usize,
    /// By sighting; `None` where the image does not show the patch.
    found: Vec<Option<Alignment>>,
    /// Median of the motions: it is the object's own origin, which no image tells.
    origin: PlanarMotion,
}

impl<'a> Patches<'a> {
    /// Aligns an object's patch in the views of a scene, whose images are given from coarse to fine. `None` where no
    /// view shows enough of it.
    pub(super) fn new(levels: &'a [&'a TrainingScene], object: &TrackedObject) -> Option<Self> {
        let sightings = sightings(levels.last()?, object);
        let last = sightings.len().checked_sub(1)?;
        let mut numbers = REFERENCES
            .map(|share| (share * last as f64).round() as usize)
            .to_vec();
        numbers.sort_unstable();
        numbers.dedup();
        let chains = numbers
            .into_iter()
            .filter_map(|reference| Self::from_reference(levels, object, &sightings, reference));
        // The most views, and of these the nearest images.
        chains.min_by(|a, b| {
            let by_count = b.aligned().cmp(&a.aligned());
            by_count.then(a.mean_residual().total_cmp(&b.mean_residual()))
        })
    }

    fn from_reference(
        levels: &'a [&'a TrainingScene],
        object: &TrackedObject,
        sightings: &[Sighting],
        reference: usize,
    ) -> Option<Self> {
        let of_level = |&level: &&'a TrainingScene| {
            Some((level, template(level, object, &sightings[reference])?))
        };
        let mut templates: Vec<(&TrainingScene, Template)> =
            levels.iter().filter_map(of_level).collect();
        let seconds = sightings[reference].seconds;
        let away = |number: usize| (sightings[number].seconds - seconds).abs();
        let mut order: Vec<usize> = (0..sightings.len()).collect();
        order.sort_by(|&a, &b| away(a).total_cmp(&away(b)));
        let mut found: Vec<Option<Alignment>> = vec![None; sightings.len()];
        for number in order {
            let at = sightings[number].seconds;
            let known = (0..sightings.len()).filter(|&other| found[other].is_some());
            let nearest = known.min_by(|&a, &b| {
                let [a, b] = [a, b].map(|other| (sightings[other].seconds - at).abs());
                a.total_cmp(&b)
            });
            let nearest = nearest.and_then(|other| found[other]);
            let begins = [Some(PlanarMotion::IDENTITY), nearest.map(|one| one.motion)];
            let tried = begins.into_iter().flatten().filter_map(|begin| {
                let one = through(&templates, &sightings[number], begin)?;
                is_plausible(&one, object).then_some(one)
            });
            found[number] = tried.min_by(|a, b| a.residual.total_cmp(&b.residual));
        }
        let motions = || found.iter().flatten().map(|one| one.motion);
        let middle =
            |part: fn(PlanarMotion) -> f64| median(&motions().map(part).collect::<Vec<_>>());
        let origin = PlanarMotion {
            shift: dvec2(middle(|one| one.shift.x)?, middle(|one| one.shift.y)?),
            turn: middle(|one| one.turn)?,
        };
        Some(Self {
            finest: templates.pop()?,
            sightings: sightings.to_vec(),
            reference,
            found,
            origin,
        })
    }

    /// Returns the number of views that show the object.
    pub(super) fn views(&self) -> usize {
        self.sightings.len()
    }

    /// Returns the number of views whose patch is aligned, the reference among them.
    pub(super) fn aligned(&self) -> usize {
        self.found.iter().flatten().count()
    }

    fn mean_residual(&self) -> f64 {
        let sum: f64 = self.found.iter().flatten().map(|one| one.residual).sum();
        sum / self.aligned().max(1) as f64
    }

    /// Returns by how much the aligned views miss the path. The median over the views is rest.
    pub(super) fn misses(&self) -> Vec<Miss> {
        let back = self.origin.inverse();
        let pairs = self.sightings.iter().zip(&self.found);
        let miss = |(sighting, found): (&Sighting, &Option<Alignment>)| {
            let found = found.as_ref()?;
            let covariance = found.covariance;
            Some(Miss {
                seconds: sighting.seconds,
                rotation: sighting.rotation,
                motion: found.motion.after(&back),
                shift_variance: 0.5 * (covariance.x_axis.x + covariance.y_axis.y),
                turn_variance: covariance.z_axis.z,
            })
        };
        pairs.filter_map(miss).collect()
    }

    /// Returns the mean absolute difference of the aligned views from the reference, levels of 255: on the given path,
    /// and on another one, which has a centre (normalized units) and a heading in radians at a time. `None` where no
    /// view can be compared.
    pub(super) fn residuals(
        &self,
        headings: impl Fn(f64) -> f64,
        other: impl Fn(f64) -> Option<(DVec3, f64)>,
    ) -> Option<[f64; 2]> {
        let (level, template) = &self.finest;
        let (mut sums, mut count) = ([0.0; 2], 0);
        for (number, sighting) in self.sightings.iter().enumerate() {
            if number == self.reference || self.found[number].is_none() {
                continue;
            }
            let Some((centre, heading)) = other(sighting.seconds) else {
                continue;
            };
            let shift = sighting.rotation.transpose() * (centre - sighting.centre);
            let moved = PlanarMotion {
                shift: shift.truncate(),
                turn: heading - headings(sighting.seconds),
            };
            let motions = [PlanarMotion::IDENTITY, moved.after(&self.origin)];
            let pair = motions
                .map(|motion| template.residual(&motion, |point| sample(level, sighting, point)));
            if let [Some(before), Some(after)] = pair {
                sums = [sums[0] + before, sums[1] + after];
                count += 1;
            }
        }
        (count > 0).then(|| sums.map(|sum| sum / f64::from(count)))
    }
}

/// Returns the views that show an object, in order of time.
fn sightings(scene: &TrainingScene, object: &TrackedObject) -> Vec<Sighting> {
    let corrections = vec![0.0; object.path.correction_len()];
    let views = scene.input_views.iter().enumerate();
    let sighting = |(number, view): (usize, &TrainingView)| {
        let seconds = view.view.time_seconds;
        let pose = object.path.pose(seconds, &corrections)?;
        initial::pixel_range(scene, view, object, &pose)?;
        Some(Sighting {
            view: number,
            seconds,
            rotation: pose.rotation.as_dmat3(),
            centre: pose.centre.as_dvec3(),
        })
    };
    let mut all: Vec<Sighting> = views.filter_map(sighting).collect();
    all.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    all
}

/// Returns the alignment of a view through all levels; `None` where the finest one fails.
fn through(
    templates: &[(&TrainingScene, Template)],
    sighting: &Sighting,
    begin: PlanarMotion,
) -> Option<Alignment> {
    let mut motion = begin;
    let mut last = None;
    for (level, template) in templates {
        last = template.align(motion, |point| sample(level, sighting, point));
        if let Some(found) = &last {
            motion = found.motion;
        }
    }
    last
}

fn is_plausible(found: &Alignment, object: &TrackedObject) -> bool {
    let largest = LARGEST_SHIFT * f64::from(object.dimensions[0]);
    found.correlation >= LEAST_CORRELATION
        && found.motion.shift.length() <= largest
        && found.motion.turn.abs() <= LARGEST_TURN
}

/// Returns the values of a level's view at a place in the object's coordinates.
fn sample(level: &TrainingScene, sighting: &Sighting, point: DVec3) -> Option<[f64; CHANNELS]> {
    let view = &level.input_views[sighting.view];
    let pixel = level
        .camera
        .project(in_camera(&view.view, sighting, point))?;
    interpolated(view, level.camera.size(), pixel)
}

fn in_camera(view: &View, sighting: &Sighting, point: DVec3) -> DVec3 {
    let world = sighting.rotation * point + sighting.centre;
    view.rotation.as_dmat3() * (world - view.centre.as_dvec3())
}

/// Returns the values of an image between its pixels, levels of 255; `None` beyond its outer pixels' centres and
/// beside ignored pixels.
fn interpolated(
    view: &TrainingView,
    [width, height]: [usize; 2],
    pixel: DVec2,
) -> Option<[f64; CHANNELS]> {
    let from_first = pixel - 0.5;
    let corner = from_first.floor();
    let is_inside = corner.min_element() >= 0.0
        && corner.x + 1.0 < width as f64
        && corner.y + 1.0 < height as f64;
    if !is_inside {
        return None;
    }
    let share = from_first - corner;
    let first = corner.y as usize * width + corner.x as usize;
    let mut values = [0.0; CHANNELS];
    for (at, weight) in [
        (first, (1.0 - share.x) * (1.0 - share.y)),
        (first + 1, share.x * (1.0 - share.y)),
        (first + width, (1.0 - share.x) * share.y),
        (first + width + 1, share.x * share.y),
    ] {
        if !view.shows_scene(at) {
            return None;
        }
        for (channel, value) in values.iter_mut().enumerate() {
            *value += weight * f64::from(view.pixels[CHANNELS * at + channel]);
        }
    }
    Some(values)
}

/// Returns the patch of an object in a view of a level; `None` if it has too few pixels.
fn template(level: &TrainingScene, object: &TrackedObject, at: &Sighting) -> Option<Template> {
    let view = &level.input_views[at.view];
    let [length, width, height] = object.dimensions;
    let grown = TrackedObject {
        dimensions: [
            length * (1.0 + 2.0 * MARGIN),
            width * (1.0 + 2.0 * MARGIN),
            height,
        ],
        ..object.clone()
    };
    let corrections = vec![0.0; object.path.correction_len()];
    let pose = object.path.pose(at.seconds, &corrections)?;
    let [left, top, right, bottom] = initial::pixel_range(level, view, &grown, &pose)?;
    let solid = OrientedBox {
        centre: at.centre,
        axes: at.rotation,
        half: 0.5 * DVec3::from_array(grown.dimensions.map(f64::from)),
    };
    let area = ((right - left) * (bottom - top)) as f64;
    let step = ((area / MOST_POINTS as f64).sqrt().ceil() as usize).max(1);
    let (mut points, mut distances) = (Vec::new(), 0.0);
    for row in (top..bottom).step_by(step) {
        for column in (left..right).step_by(step) {
            let pixel = dvec2(column as f64 + 0.5, row as f64 + 0.5);
            let Some((position, distance)) = entry(level, &view.view, &solid, pixel) else {
                continue;
            };
            let Some(point) = template_point(level, object, at, position, pixel) else {
                continue;
            };
            points.push(point);
            distances += distance;
        }
    }
    let distance = distances / points.len().max(1) as f64;
    let resolution = distance * f64::from(level.camera.pixel_radians());
    (points.len() >= LEAST_POINTS).then(|| Template::new(points, resolution))
}

/// Returns the place in a box's coordinates where a pixel's ray enters it, and the distance from the camera.
fn entry(
    level: &TrainingScene,
    view: &View,
    solid: &OrientedBox,
    pixel: DVec2,
) -> Option<(DVec3, f64)> {
    let origin = view.centre.as_dvec3();
    let ray = view.rotation.as_dmat3().transpose() * level.camera.unproject(pixel);
    let [distance, _] = solid.crossing(origin, ray)?;
    let own = solid.axes.transpose() * (origin + ray * distance - solid.centre);
    (distance > 0.0).then_some((own, distance))
}

/// Returns a point of a template with its values and their derivatives by the object's motion; `None` at the
/// image's borders.
fn template_point(
    level: &TrainingScene,
    object: &TrackedObject,
    at: &Sighting,
    position: DVec3,
    pixel: DVec2,
) -> Option<TemplatePoint> {
    let view = &level.input_views[at.view];
    let value = |x: f64, y: f64| interpolated(view, level.camera.size(), pixel + dvec2(x, y));
    let values = value(0.0, 0.0)?;
    let across = [value(-1.0, 0.0)?, value(1.0, 0.0)?];
    let down = [value(0.0, -1.0)?, value(0.0, 1.0)?];
    let step = STEP * f64::from(object.unit());
    let pixel_at = |offset: DVec3| {
        level
            .camera
            .project(in_camera(&view.view, at, position + offset))
    };
    // Pixels per unit of a motion whose velocity at the point is given.
    let moves = |velocity: DVec3| -> Option<DVec2> {
        let length = velocity.length().max(f64::MIN_POSITIVE);
        let offset = velocity * (step / length);
        Some((pixel_at(offset)? - pixel_at(-offset)?) * (length / (2.0 * step)))
    };
    let turning = position.truncate().perp().extend(0.0);
    let [along, aside, turn] = [moves(DVec3::X)?, moves(DVec3::Y)?, moves(turning)?];
    let slopes = std::array::from_fn(|channel| {
        let gradient = 0.5
            * dvec2(
                across[1][channel] - across[0][channel],
                down[1][channel] - down[0][channel],
            );
        DVec3::new(gradient.dot(along), gradient.dot(aside), gradient.dot(turn))
    });
    Some(TemplatePoint {
        position,
        values,
        slopes,
    })
}
