//! Silhouettes of an object in each frame, and the position of the whole where a part is visible.
//!
//! The middle of the visible part is not the middle of a hidden object. So the silhouette of a frame that shows
//! the whole is laid over the visible part. It belongs where it covers most of the mask and little else, apart
//! from occluders and the outside of the image.

use glam::{DMat3, DVec2, DVec3};
use omnilife_engine::{camera::Camera, trajectories::rigid_spline::RigidPose};
use rayon::prelude::*;

use super::{pixel_at, seen_at};
use crate::clip::{Clip, camera_direction, pixel_centre};

/// Number of samples of a silhouette that is laid over another.
const SAMPLES: usize = 2_000;
/// First steps of its search, as a share of the root of its area; they are halved to a fraction of a pixel.
const FIRST_STEP: f64 = 0.25;
const LAST_STEP_PIXELS: f64 = 0.2;
/// Maximum number of steps of one length.
const STEPS: usize = 24;
/// Cost, in intersection over union, of a squared change of the logarithm of depth or of a squared turn.
const CHANGE_COST: f64 = 0.2;
/// Minimum visible share of a silhouette that gives the position of the whole.
const LEAST_SHARE: f64 = 0.2;

/// Mask of an object in one frame.
#[derive(Debug, Clone)]
pub struct Silhouette {
    pub(super) frame: usize,
    /// Area on its plane at a distance of 1. In a panorama, whose planes face the camera: steradians. In a
    /// perspective image, to which planes are parallel: the image's own area over that of a focal length squared.
    pub(super) area: f64,
    /// Unit direction to its middle, camera.
    pub(super) direction: DVec3,
    /// True if it touches the image's border, another object or an ignored region: it may be a part of the
    /// object.
    pub(super) is_partial: bool,
    pub(super) pixels: Vec<usize>,
}

impl Silhouette {
    /// Returns a silhouette without pixels, for tests.
    #[cfg(test)]
    pub(super) fn at_frame(frame: usize) -> Self {
        Self {
            frame,
            area: 0.0,
            direction: DVec3::Z,
            is_partial: false,
            pixels: Vec::new(),
        }
    }

    /// Returns the intersection over union of the pixels, which are in ascending order.
    pub(super) fn overlap(&self, other: &Self) -> f64 {
        let both = self
            .pixels
            .iter()
            .filter(|pixel| other.pixels.binary_search(pixel).is_ok());
        let both = both.count();
        let either = self.pixels.len() + other.pixels.len() - both;
        both as f64 / either.max(1) as f64
    }
}

/// Returns the silhouettes of an object, in the frames whose masks show it.
pub fn of_object(clip: &Clip, object: usize) -> Vec<Silhouette> {
    let frames = (0..clip.frames.len()).into_par_iter();
    frames
        .filter_map(|number| silhouette(clip, object, number))
        .collect()
}

/// Returns the silhouette of an object in a frame; `None` where its mask is empty.
fn silhouette(clip: &Clip, object: usize, number: usize) -> Option<Silhouette> {
    let frame = &clip.frames[number];
    let mask = frame.masks[object].as_ref()?;
    let [width, height] = clip.size();
    let wraps = matches!(clip.camera, Camera::Erp(_));
    let pixels: Vec<usize> = (0..mask.len())
        .filter(|&pixel| mask[pixel] >= 128)
        .collect();
    let (mut sum, mut area) = (DVec3::ZERO, 0.0);
    let mut is_partial = false;
    for &pixel in &pixels {
        let direction = camera_direction(&clip.camera, pixel_centre(pixel, width));
        let (place, own) = match clip.camera {
            Camera::Erp(camera) => (direction, camera.pixel_solid_angle((pixel / width) as u32)),
            Camera::Pinhole(camera) => (direction / direction.z, 1.0 / (camera.fx * camera.fy)),
        };
        sum += own * place;
        area += own;
        let (column, row) = (pixel % width, pixel / width);
        is_partial |= row == 0 || row + 1 == height;
        is_partial |= !wraps && (column == 0 || column + 1 == width);
        // Within two pixels: masks need not touch where edges mix.
        let beside = [
            pixel.saturating_sub(2),
            (pixel + 2).min(mask.len() - 1),
            pixel.saturating_sub(2 * width),
            (pixel + 2 * width).min(mask.len() - 1),
        ];
        is_partial |= beside.iter().any(|&near| !frame.shows_scene(near));
        is_partial |= (0..frame.masks.len())
            .filter(|&other| other != object)
            .any(|other| beside.iter().any(|&near| frame.covered(other, near) >= 0.5));
    }
    (area > 0.0).then(|| Silhouette {
        frame: number,
        area,
        direction: sum.normalize_or(DVec3::Z),
        is_partial,
        pixels,
    })
}

/// Returns the axes of a plane in the camera's frame: the camera's own for a perspective image, axes that face
/// the camera for a panorama.
pub(super) fn plane_axes(camera: &Camera, direction: DVec3) -> DMat3 {
    match camera {
        Camera::Pinhole(_) => DMat3::IDENTITY,
        Camera::Erp(_) => {
            let x = DVec3::Y.cross(direction).normalize_or(DVec3::X);
            DMat3::from_cols(x, direction.cross(x), direction)
        }
    }
}

/// Returns the intersections of a silhouette's directions with a plane at `depth` along its normal, in its
/// coordinates.
pub(super) fn on_plane(clip: &Clip, seen: &Silhouette, axes: &DMat3, depth: f64) -> Vec<DVec2> {
    let [width, _] = clip.size();
    let centre = axes.transpose() * seen.direction;
    let centre = depth * centre.truncate() / centre.z;
    let places = seen.pixels.iter().map(|&pixel| {
        let direction = camera_direction(&clip.camera, pixel_centre(pixel, width));
        let local = axes.transpose() * direction;
        depth * local.truncate() / local.z - centre
    });
    places.collect()
}

/// Returns the pose of a plane around the middle of a silhouette, `depth` away along its normal.
pub(super) fn middle(clip: &Clip, seen: &Silhouette, depth: f64) -> RigidPose {
    let axes = plane_axes(&clip.camera, seen.direction);
    let local = axes.transpose() * seen.direction;
    let at = SilhouettePose {
        turn: 0.0,
        shift: local.truncate() / local.z,
    };
    at.pose(clip, seen, depth)
}

/// Turn and position of an object on the tangent plane of a silhouette.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SilhouettePose {
    /// Rotation about the plane's normal, radians.
    pub(super) turn: f64,
    /// Position of its middle, one unit from the camera.
    pub(super) shift: DVec2,
}

impl SilhouettePose {
    /// Returns the pose of its plane, `depth` away along the normal.
    pub(super) fn pose(&self, clip: &Clip, seen: &Silhouette, depth: f64) -> RigidPose {
        let frame = &clip.frames[seen.frame];
        let axes = plane_axes(&clip.camera, seen.direction);
        RigidPose {
            centre: frame.pose.centre
                + frame.pose.rotation * axes * (depth * self.shift.extend(1.0)),
            rotation: frame.pose.rotation * axes * DMat3::from_rotation_z(self.turn),
        }
    }
}

/// Returns the largest silhouette of an object, among complete ones where there are any.
pub(super) fn reference(seen: &[Silhouette]) -> Option<&Silhouette> {
    let largest = |a: &&Silhouette, b: &&Silhouette| a.area.total_cmp(&b.area);
    let whole = seen.iter().filter(|seen| !seen.is_partial);
    whole
        .max_by(largest)
        .or_else(|| seen.iter().max_by(largest))
}

/// A complete silhouette in the plane of its object.
pub(super) struct Shape {
    /// Positions around its middle, units of the scene.
    places: Vec<DVec2>,
    /// The area of each position, at a distance of 1 as [`Silhouette::area`].
    area_at_one: f64,
}

impl Shape {
    /// Returns the shape of a silhouette whose plane is `depth` away along its normal.
    pub(super) fn of(clip: &Clip, seen: &Silhouette, depth: f64) -> Self {
        let axes = plane_axes(&clip.camera, seen.direction);
        let share = SAMPLES as f64 / seen.pixels.len() as f64;
        let places: Vec<DVec2> = on_plane(clip, seen, &axes, depth)
            .into_iter()
            .zip(&seen.pixels)
            .filter(|&(_, &pixel)| is_drawn(pixel, share))
            .map(|(place, _)| place)
            .collect();
        let area_at_one = seen.area * depth * depth / places.len().max(1) as f64;
        Self {
            places,
            area_at_one,
        }
    }

    /// Returns the pose of its plane, `depth` away and turned, in a frame that shows a part of it; `None` where too
    /// little is visible.
    pub(super) fn placed(
        &self,
        clip: &Clip,
        object: usize,
        seen: &Silhouette,
        depth: f64,
        turn: f64,
    ) -> Option<RigidPose> {
        let of_part = middle(clip, seen, depth);
        let turned = of_part.rotation * DMat3::from_rotation_z(turn);
        let pose = |shift: DVec2| RigidPose {
            centre: of_part.centre + of_part.rotation * shift.extend(0.0),
            rotation: turned,
        };
        let whole = self.area_at_one * self.places.len() as f64 / (depth * depth);
        if seen.area < LEAST_SHARE * whole {
            return None;
        }
        let mut best = (
            DVec2::ZERO,
            self.fit(clip, object, seen, depth, &pose(DVec2::ZERO))
                .overlap,
        );
        let pixel = depth * (seen.area / seen.pixels.len() as f64).sqrt();
        let mut step = FIRST_STEP * depth * whole.sqrt();
        while step > LAST_STEP_PIXELS * pixel {
            for _ in 0..STEPS {
                let around = NEIGHBOURS.map(|to| {
                    let shift = best.0 + step * DVec2::from_array(to);
                    let fit = self.fit(clip, object, seen, depth, &pose(shift));
                    (shift, fit.overlap)
                });
                let better =
                    around.into_iter().fold(
                        best,
                        |best, other| {
                            if other.1 > best.1 { other } else { best }
                        },
                    );
                if better.0 == best.0 {
                    break;
                }
                best = better;
            }
            step *= 0.5;
        }
        Some(pose(best.0))
    }

    /// Returns the depth, over that of the shape, and the place that lay the shape over a complete mask, from a first
    /// guess of depth and turn. Changes of both against the guess cost a little: a round mask has no turn.
    pub(super) fn laid_over(
        &self,
        clip: &Clip,
        object: usize,
        seen: &Silhouette,
        [depth, turn]: [f64; 2],
    ) -> Option<(f64, SilhouettePose)> {
        let axes = plane_axes(&clip.camera, seen.direction);
        let local = axes.transpose() * seen.direction;
        let middle = local.truncate() / local.z;
        let size = seen.area.sqrt();
        // Shift over the mask's size, logarithm of depth, turn.
        let place = |at: [f64; 4]| {
            let similar = SilhouettePose {
                turn: turn + at[3],
                shift: middle + size * DVec2::new(at[0], at[1]),
            };
            (depth * at[2].exp(), similar)
        };
        let value = |at: [f64; 4]| {
            let (depth, similar) = place(at);
            let pose = similar.pose(clip, seen, depth);
            let cost = CHANGE_COST * (at[2] * at[2] + at[3] * at[3]);
            self.fit(clip, object, seen, depth, &pose).overlap - cost
        };
        let mut best = ([0.0; 4], value([0.0; 4]));
        let pixel = 1.0 / (seen.pixels.len() as f64).sqrt();
        let mut step = FIRST_STEP;
        while step > LAST_STEP_PIXELS * pixel {
            for _ in 0..STEPS {
                let moves = (0..4).flat_map(|axis| [(axis, step), (axis, -step)]);
                let better = moves
                    .map(|(axis, by)| {
                        let mut at = best.0;
                        at[axis] += by;
                        (at, value(at))
                    })
                    .fold(
                        best,
                        |best, other| if other.1 > best.1 { other } else { best },
                    );
                if better.0 == best.0 {
                    break;
                }
                best = better;
            }
            step *= 0.5;
        }
        (best.1 > 0.0).then(|| place(best.0))
    }

    /// Returns the shares of the shape at a pose that the objects' masks cover in a frame.
    pub(super) fn covered_shares(&self, clip: &Clip, frame: usize, pose: &RigidPose) -> Vec<f64> {
        let frame = &clip.frames[frame];
        let mut counts = vec![0.0; frame.masks.len()];
        let seen = self.places.iter().filter_map(|place| {
            let at = seen_at(clip, frame, pose.centre + pose.rotation * place.extend(0.0))?;
            Some(pixel_at(clip, at))
        });
        for pixel in seen {
            for (object, count) in counts.iter_mut().enumerate() {
                *count += f64::from(u8::from(frame.covered(object, pixel) >= 0.5));
            }
        }
        counts
            .iter()
            .map(|count| count / self.places.len().max(1) as f64)
            .collect()
    }

    /// Compares the shape at a pose with a mask, where both can be visible.
    pub(super) fn fit(
        &self,
        clip: &Clip,
        object: usize,
        seen: &Silhouette,
        depth: f64,
        pose: &RigidPose,
    ) -> Fit {
        let frame = &clip.frames[seen.frame];
        let (mut both, mut shown) = (0_usize, 0_usize);
        for place in &self.places {
            let point: DVec3 = pose.centre + pose.rotation * place.extend(0.0);
            let Some(at) = seen_at(clip, frame, point) else {
                continue;
            };
            let pixel = pixel_at(clip, at);
            let mut others = (0..frame.masks.len()).filter(|&other| other != object);
            let is_hidden =
                !frame.shows_scene(pixel) || others.any(|other| frame.covered(other, pixel) >= 0.5);
            if !is_hidden {
                shown += 1;
                both += usize::from(frame.covered(object, pixel) >= 0.5);
            }
        }
        let of = |count: usize| count as f64 * self.area_at_one / (depth * depth);
        let either = seen.area + of(shown) - of(both);
        Fit {
            overlap: of(both) / either.max(f64::MIN_POSITIVE),
            reached: (of(both) / seen.area.max(f64::MIN_POSITIVE)).min(1.0),
        }
    }
}

/// Agreement of a shape with a mask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// Intersection over union.
    pub(super) overlap: f64,
    /// Share of the mask under the shape. A thing without a mask that hides a part of an object lowers the overlap
    /// alone.
    pub(super) reached: f64,
}

/// Returns true if a pixel belongs to a sample of a share of all. A hash decides: regular steps would make stripes.
fn is_drawn(pixel: usize, share: f64) -> bool {
    // Knuth's multiplicative hash, 2^32 over the golden ratio.
    let hash = (pixel as u32).wrapping_mul(2_654_435_761);
    f64::from(hash) < share * f64::from(u32::MAX)
}

/// Directions of the search.
const NEIGHBOURS: [[f64; 2]; 8] = [
    [1.0, 0.0],
    [-1.0, 0.0],
    [0.0, 1.0],
    [0.0, -1.0],
    [1.0, 1.0],
    [-1.0, -1.0],
    [1.0, -1.0],
    [-1.0, 1.0],
];

#[cfg(test)]
mod tests {
    use omnilife_schemas::camera::PinholeCamera;

    use super::{
        super::{in_frames, order},
        *,
    };
    use crate::clip::{ClipFrame, UnitClock};

    const WIDTH: usize = 120;
    const HEIGHT: usize = 80;

    /// Returns a disc of 14 pixels around a place, hidden to the right of `hidden_from`, and that side's mask.
    fn frame(number: u32, middle: [f64; 2], hidden_from: usize) -> ClipFrame {
        let is_hidden = |pixel: usize| pixel % WIDTH >= hidden_from;
        let is_in =
            |pixel: usize| (pixel_centre(pixel, WIDTH) - DVec2::from_array(middle)).length() < 14.0;
        let mask = |is_in: &dyn Fn(usize) -> bool| -> Vec<u8> {
            (0..WIDTH * HEIGHT)
                .map(|pixel| if is_in(pixel) { 255 } else { 0 })
                .collect()
        };
        ClipFrame {
            number,
            time: f64::from(number),
            pose: RigidPose {
                centre: DVec3::ZERO,
                rotation: DMat3::IDENTITY,
            },
            pixels: vec![128; 3 * WIDTH * HEIGHT],
            masks: vec![
                Some(mask(&|pixel| is_in(pixel) && !is_hidden(pixel))),
                Some(mask(&is_hidden)),
            ],
            ignored: None,
        }
    }

    #[test]
    fn the_whole_is_where_a_part_of_it_is_seen() {
        let places = [[40.0, 40.0], [88.0, 37.0], [5.0, 44.0], [71.5, 2.0]];
        let frames = places.iter().zip(0..).map(|(&place, number)| {
            // Behind the other object, and over the image's left and upper border.
            frame(number, place, if number == 1 { 90 } else { WIDTH })
        });
        let camera = PinholeCamera {
            width: WIDTH as u32,
            height: HEIGHT as u32,
            fx: 100.0,
            fy: 100.0,
            cx: 60.0,
            cy: 40.0,
        };
        let clip = Clip {
            camera: camera.into(),
            frames: frames.collect(),
            objects: vec!["disc".to_owned(), "wall".to_owned()],
            clock: UnitClock {
                begin_seconds: 0.0,
                length_seconds: 1.0,
            },
            warnings: Vec::new(),
        };
        let depth = 2.0;
        let seen = of_object(&clip, 0);
        let partial: Vec<bool> = seen.iter().map(|seen| seen.is_partial).collect();
        assert_eq!(partial, [false, true, true, true]);
        let shape = Shape::of(&clip, &seen[0], depth);
        for (seen, place) in seen.iter().zip(places).skip(1) {
            let found = shape
                .placed(&clip, 0, seen, depth, 0.0)
                .map(|pose| pose.centre);
            let found = found.map(|at| 100.0 * at.truncate() / at.z + DVec2::new(60.0, 40.0));
            let apart = found.map_or(f64::NAN, |at| (at - DVec2::from_array(place)).length());
            assert!(apart < 0.7, "{place:?}: {found:?}");
        }
        // The wall hides the disc: the disc is the farther one, whichever is the first.
        let both = [of_object(&clip, 0), of_object(&clip, 1)];
        let in_frames = [0, 1].map(|object| in_frames::of(&clip, object, &both[object]));
        let evidence =
            |known: [Option<f64>; 2]| order::depths(&clip, &both, &in_frames, &known, 4.0);
        let depths = evidence([None, None]);
        assert!(depths[0] > 1.05 * depths[1], "{depths:?}");
        let known = evidence([Some(1.0), None]);
        assert_eq!(known, [1.0, 2.0]);
        // A sliver gives no position.
        let sliver = Silhouette {
            area: 0.1 * seen[0].area,
            ..seen[1].clone()
        };
        assert!(shape.placed(&clip, 0, &sliver, depth, 0.0).is_none());
    }
}
