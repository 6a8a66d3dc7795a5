//! Distances of detections: on the ground, or by estimates of a network.

use std::path::Path;

use glam::DVec3;
use omnilife_schemas::{
    distances::{DistanceImage, EDGE_RATIO},
    ground_plane::Plane,
    posed_view::PosedView,
    records::{Detection, Scene},
    statistics::median,
};

use super::{
    Tracking,
    alignment::{self, Alignment, LEAST_INLIERS, Pair},
    detectors::{DetectorInput, depth_of_points::DistanceMap},
    middle,
    rings::{LEAST_RING_POINTS, PointsInView},
};
use crate::error::TracksError;

/// A way of finding distances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DistanceMethod {
    /// The ground where it lies under the boxes, estimates where it does not and there are some.
    Auto,
    /// Places where rays meet the plane of the points around a box, half a vehicle up; needs no estimates.
    Ground,
    /// Distances that a network estimated (`curate poses --depth-prior`), brought to the scene by scale and shift
    /// of their inverse; by the scale alone where the scene is flat.
    Monocular,
    /// The same of networks whose distances are right but for a scale: no shift.
    MonocularScale,
}

/// All of them.
pub const DISTANCES: [DistanceMethod; 4] = [
    DistanceMethod::Auto,
    DistanceMethod::Ground,
    DistanceMethod::Monocular,
    DistanceMethod::MonocularScale,
];

impl DistanceMethod {
    /// Name on the command line.
    pub fn id(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Ground => "ground",
            Self::Monocular => "monocular",
            Self::MonocularScale => "monocular-scale",
        }
    }

    pub(super) fn needs_estimates(self) -> bool {
        matches!(self, Self::Monocular | Self::MonocularScale)
    }
}

/// A plane in a ring holds points that are this near to it, metres.
const RING_REACH: f64 = 0.1;
/// Height of a detection's middle above the ground: half of a car's height, metres.
const HALF_HEIGHT: f64 = 0.75;
/// Relative standard deviation of a distance to the ground, and of one estimated by a network.
const SIGMA_GROUND: f64 = 0.005;
const SIGMA_MONOCULAR: f64 = 0.02;
/// Share of detections with ground under them from which on no estimates are used.
const ENOUGH_GROUND: f64 = 0.95;
/// Maximum number of points of a frame for aligning estimates.
const MOST_PAIRS: usize = 4000;
/// A point is hidden if a surface is nearer than this share of its distance.
const HIDDEN: f64 = 0.97;
/// Steps down along a ray are never longer than those at this slope.
const LEAST_SLOPE: f64 = 0.5;

/// Method and quality of the distances of detections.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DistanceQuality {
    /// Not [`DistanceMethod::Auto`].
    pub(super) method: DistanceMethod,
    /// On what evidence.
    pub(super) reason: String,
    /// Relative standard deviation of a distance.
    pub(super) sigma: f64,
    pub(super) warnings: Vec<String>,
}

/// Sources of distances to the ground.
#[derive(Default)]
struct GroundUse {
    rings: usize,
    dominant: usize,
    none: usize,
}

impl GroundUse {
    fn said(&self) -> String {
        format!(
            "{} on the plane of the points in a ring around them, {} on the ground of the whole scene \
             (fewer than {LEAST_RING_POINTS} points in the ring), {} above the horizon",
            self.rings, self.dominant, self.none
        )
    }

    fn share(&self) -> f64 {
        let all = self.rings + self.dominant + self.none;
        if all == 0 {
            1.0
        } else {
            self.rings as f64 / all as f64
        }
    }
}

/// Returns true if any used frame has a depth prior.
pub(super) fn has_estimates(scene: &Scene, views: &[PosedView]) -> bool {
    let prior = |view: &PosedView| scene.frames.get(view.frame as usize)?.depth_prior.as_ref();
    views.iter().any(|view| prior(view).is_some())
}

/// Refuses a method that needs estimates without any.
///
/// # Errors
/// Without estimates.
pub(super) fn check_estimates(
    scene_path: &Path,
    scene: &Scene,
    views: &[PosedView],
    asked: DistanceMethod,
) -> Result<(), TracksError> {
    if !asked.needs_estimates() || has_estimates(scene, views) {
        return Ok(());
    }
    let reason = format!(
        "has no estimated distances for --distance {}: give them with `omnilife curate poses --depth-prior \
         FOLDER --depth-prior-unit UNITS`",
        asked.id()
    );
    Err(TracksError::input(scene_path, reason))
}

impl Tracking<'_> {
    /// Gives detections their distances and places.
    ///
    /// # Errors
    /// When estimates are damaged, or fit the points of no frame.
    pub(super) fn lift(
        &self,
        detections: &mut [Detection],
        input: &DetectorInput<'_>,
        asked: DistanceMethod,
    ) -> Result<DistanceQuality, TracksError> {
        let ground = self.lift_to_ground(detections);
        let has_estimates = has_estimates(self.scene, self.views);
        let enough = ground.share() >= ENOUGH_GROUND;
        let on_ground = format!("{:.0} % of the boxes", 100.0 * ground.share());
        let why = match asked {
            DistanceMethod::Monocular | DistanceMethod::MonocularScale => "asked for".to_owned(),
            DistanceMethod::Auto if has_estimates && !enough => {
                format!("ground lies under {on_ground} alone")
            }
            DistanceMethod::Auto | DistanceMethod::Ground => {
                let left_out = if !has_estimates || asked == DistanceMethod::Ground {
                    String::new()
                } else {
                    format!("; estimates are left out: ground lies under {on_ground}")
                };
                return Ok(DistanceQuality {
                    method: DistanceMethod::Ground,
                    reason: ground.said() + &left_out,
                    sigma: SIGMA_GROUND,
                    warnings: Vec::new(),
                });
            }
        };
        let scale_alone = asked == DistanceMethod::MonocularScale;
        let mut lifted = self.lift_by_estimates(detections, input, scale_alone)?;
        lifted.reason = format!("{why}: {}", lifted.reason);
        Ok(lifted)
    }

    fn lift_to_ground(&self, detections: &mut [Detection]) -> GroundUse {
        let mut counts = GroundUse::default();
        let (unit, dominant) = (1.0 / self.metres_per_unit, self.plane);
        for view in self.views {
            let mut of_view = detections
                .iter_mut()
                .filter(|detection| detection.frame == view.frame)
                .peekable();
            if of_view.peek().is_none() {
                continue;
            }
            let points = PointsInView::new(view, self.points);
            for detection in of_view {
                let ring = points.ring(detection.box_pixels);
                let local = (ring.len() >= LEAST_RING_POINTS)
                    .then(|| Plane::of_most(&ring, RING_REACH * unit, Some(dominant.normal)))
                    .flatten()
                    .filter(|(_, inside)| *inside >= LEAST_RING_POINTS / 2);
                let plane = local.map_or(dominant, |(plane, _)| plane);
                let ray = view.ray(middle(detection.box_pixels));
                let Some(distance) = plane.raised(HALF_HEIGHT * unit).meet(view.centre, ray) else {
                    counts.none += 1;
                    continue;
                };
                match local {
                    Some(_) => counts.rings += 1,
                    None => counts.dominant += 1,
                }
                put(detection, view, ray, distance);
            }
        }
        counts
    }

    /// Uses estimates, aligned frame by frame to the visible points.
    fn lift_by_estimates(
        &self,
        detections: &mut [Detection],
        input: &DetectorInput<'_>,
        scale_alone: bool,
    ) -> Result<DistanceQuality, TracksError> {
        let (mut views, mut images, mut pairs, mut first) = (vec![], vec![], vec![], None);
        for view in self.views {
            let Some(prior) = &self.scene.frames[view.frame as usize].depth_prior else {
                continue;
            };
            let path = input.folder.join(&prior.file);
            let image = DistanceImage::read(&path, prior.unit, view.camera.wraps())?;
            let size = [prior.width as usize, prior.height as usize];
            if [image.width, image.height] != size {
                let reason = format!(
                    "is {}x{}, the scene says {}x{}",
                    image.width, image.height, size[0], size[1]
                );
                return Err(TracksError::input(&path, reason));
            }
            let camera = view.camera.resized(prior.width, prior.height);
            let image = image.along_rays(prior.convention, &camera);
            pairs.push(self.pairs(view, &image, detections));
            first.get_or_insert(path);
            views.push(*view);
            images.push(image);
        }
        let found: Vec<Option<Alignment>> = pairs
            .iter()
            .map(|pairs| alignment::align(pairs, scale_alone))
            .collect();
        let (alignments, borrowed) = alignment::smoothed(&found, &pairs);
        if alignments.is_empty() {
            let most = pairs.iter().map(Vec::len).max().unwrap_or(0);
            return Err(TracksError::input(
                &first.unwrap_or_default(),
                format!(
                    "agrees with fewer than {LEAST_INLIERS} points of the scene in every frame, whatever its scale \
                     and shift ({most} points at most were compared)"
                ),
            ));
        }
        let mut lost = 0;
        for detection in &mut *detections {
            detection.distance = None;
            detection.position = None;
            let at = views.iter().position(|view| view.frame == detection.frame);
            let distance = at.and_then(|at| {
                let estimate = estimate(&views[at], &images[at], detection.box_pixels)?;
                alignments[at].distance(estimate)
            });
            let (Some(at), Some(distance)) = (at, distance) else {
                lost += 1;
                continue;
            };
            let view = &views[at];
            let ray = view.ray(middle(detection.box_pixels));
            // The visible point is on the roof; the middle is half of the height below.
            let slope = self.plane.normal.dot(ray).abs().max(LEAST_SLOPE);
            put(
                detection,
                view,
                ray,
                distance + HALF_HEIGHT / self.metres_per_unit / slope,
            );
        }
        let warnings = borrowed.iter().map(|&at| {
            format!(
                "the estimated distances of frame {} agree with fewer than {LEAST_INLIERS} points; those of the \
                 nearest frame's scale are taken",
                views[at].frame
            )
        });
        Ok(DistanceQuality {
            method: if scale_alone {
                DistanceMethod::MonocularScale
            } else {
                DistanceMethod::Monocular
            },
            reason: said(&alignments, &pairs, scale_alone, lost),
            sigma: SIGMA_MONOCULAR,
            warnings: warnings.collect(),
        })
    }

    /// Returns points with known and estimated distances, away from edges and content that may move.
    fn pairs(
        &self,
        view: &PosedView,
        image: &DistanceImage,
        detections: &[Detection],
    ) -> Vec<Pair> {
        let nearest = DistanceMap::new(view, self.points);
        let boxes: Vec<[f64; 4]> = detections
            .iter()
            .filter(|detection| detection.frame == view.frame)
            .map(|detection| detection.box_pixels)
            .collect();
        let [width, height] = view.camera.size().map(|side| side as f64);
        let mut pairs: Vec<Pair> = self
            .points
            .iter()
            .filter_map(|&point| {
                let pixel = view.pixel(point)?;
                let distance = point.distance(view.centre);
                let at = pixel.y as usize * nearest.width + pixel.x as usize;
                let is_hidden = f64::from(nearest.values[at]) < HIDDEN * distance;
                let is_inside = boxes.iter().any(|&[left, top, columns, rows]| {
                    (left..left + columns).contains(&pixel.x)
                        && (top..top + rows).contains(&pixel.y)
                });
                if is_hidden || is_inside {
                    return None;
                }
                let column = (pixel.x / width * image.width as f64) as usize;
                let row = (pixel.y / height * image.height as f64) as usize;
                let estimate = even_value(image, column, row)?;
                Some(Pair { estimate, distance })
            })
            .collect();
        let step = pairs.len().div_ceil(MOST_PAIRS).max(1);
        pairs = pairs.into_iter().step_by(step).collect();
        pairs
    }
}

/// Returns a pixel's estimate if those around it belong to the same surface.
fn even_value(image: &DistanceImage, column: usize, row: usize) -> Option<f64> {
    let (mut least, mut most) = (f32::INFINITY, 0.0_f32);
    for row in row.saturating_sub(1)..=(row + 1).min(image.height - 1) {
        for column in column.saturating_sub(1)..=(column + 1).min(image.width - 1) {
            let value = image.values[row * image.width + column];
            least = least.min(value);
            most = most.max(value);
        }
    }
    let value = image.values[row * image.width + column];
    (least > 0.0 && most < EDGE_RATIO * least).then_some(f64::from(value))
}

/// Returns the median of the estimates in the inner half of a box.
fn estimate(
    view: &PosedView,
    image: &DistanceImage,
    [left, top, width, height]: [f64; 4],
) -> Option<f64> {
    let size = view.camera.size();
    let range = |from: f64, length: f64, own: usize, all: usize| {
        let to_image = own as f64 / all as f64;
        let begin = ((from + 0.25 * length) * to_image).max(0.0) as usize;
        let end = ((from + 0.75 * length) * to_image).max(0.0) as usize;
        begin.min(own - 1)..(end + 1).min(own)
    };
    let columns = range(left, width, image.width, size[0]);
    let rows = range(top, height, image.height, size[1]);
    let known: Vec<f64> = rows
        .flat_map(|row| image.values[row * image.width..][columns.clone()].iter())
        .filter(|&&value| value > 0.0)
        .map(|&value| f64::from(value))
        .collect();
    median(&known)
}

/// Describes the alignment of estimates, in words.
fn said(alignments: &[Alignment], pairs: &[Vec<Pair>], scale_alone: bool, lost: usize) -> String {
    let all: usize = pairs.iter().map(Vec::len).sum();
    let inliers: usize = alignments.iter().map(|one| one.inliers).sum();
    let flat = alignments.iter().filter(|one| one.is_flat).count();
    let how = if scale_alone {
        "by scale alone".to_owned()
    } else if flat == 0 {
        "by scale and shift".to_owned()
    } else {
        format!(
            "by scale alone in {flat} of them, where the scene is flat, by scale and shift in the others"
        )
    };
    let without = if lost == 0 {
        String::new()
    } else {
        format!("; {lost} boxes have none")
    };
    format!(
        "estimates of {} frames aligned {how}: {:.0} % of {all} points agree{without}",
        alignments.len(),
        100.0 * inliers as f64 / all.max(1) as f64
    )
}

fn put(detection: &mut Detection, view: &PosedView, ray: DVec3, distance: f64) {
    detection.distance = Some(distance);
    detection.position = Some((view.centre + ray * distance).to_array());
}
