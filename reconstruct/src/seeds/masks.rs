//! First dynamic Gaussians: on what moves, where masks show it.
//!
//! Structure from motion has no points on moving objects, and at first no Gaussian is dynamic: the
//! losses of dynamic Gaussians alone would have nothing to render and no gradient (the cold start of
//! Omni4DGS). So Gaussians are put onto the masked pixels of the input views, at the views' times.
//!
//! A pixel has no depth. An object hides everything behind it: it is no farther than the nearest
//! scene point in its silhouette, which for what stands on the ground is the ground at its foot. Each
//! connected piece of a mask gets one distance, the 10th percentile of the points in it.
//!
//! Where asked for, seeds begin with a velocity: that of their piece from the view before to the view
//! after, across the line of sight. Pieces are the same where each is the other's nearest, within a few
//! degrees, and of about the same size; along the line of sight nothing is known.

use std::f32::consts::PI;

use glam::Vec3;
use omnilife_schemas::camera::{CameraModel, ErpCamera};
use rayon::prelude::*;

use crate::scene::TrainingScene;
use omnilife_engine::{
    camera::erp,
    clock::Clock,
    gaussians::{static_gaussians::InitialGaussians, temporal::InitialTimes},
    training_view::TrainingView,
};

/// Opacity of a seed: it is known to be there.
const SEED_OPACITY: f32 = 0.5;
/// The share of a piece's points that may be nearer than it.
const NEAR_SHARE: f32 = 0.1;
/// A pixel belongs to a mask when half of it is covered.
const COVERED: u8 = 128;
/// Two pieces of neighbouring views may be the same up to this angle, radians.
const LARGEST_STEP: f32 = 0.2;
/// And up to this ratio of their areas.
const LARGEST_GROWTH: f32 = 1.6;
/// Pieces with fewer points than this take the distance of the view's median piece.
const LEAST_POINTS: usize = 3;

/// Dynamic Gaussians at the beginning.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MaskSeeds {
    /// The Gaussians.
    pub gaussians: InitialGaussians,
    /// When they are.
    pub times: InitialTimes,
    /// Masked pixels of all input views, from which they were taken evenly.
    pub masked_pixels: usize,
    /// Seeds whose distance is not from points of their own piece.
    pub without_points: usize,
}

/// A connected piece of a view's mask.
#[derive(Debug, Clone)]
struct Piece {
    pixels: Vec<usize>,
    /// Unit direction to its middle, world.
    direction: Vec3,
    /// Solid angle, steradians.
    area: f32,
    distance: f32,
    has_points: bool,
}

/// A masked pixel of a piece of a view.
#[derive(Debug, Clone, Copy)]
struct MaskedPixel {
    view: usize,
    piece: usize,
    pixel: usize,
}

/// Whether seeds begin with the velocity of their piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeedVelocity {
    /// They begin at rest.
    None,
    /// With that of their piece across the line of sight.
    Tracked,
}

/// At most `maximum` seeds, evenly from all masked pixels, that live `lifespan` frames.
pub fn mask_seeds(
    scene: &TrainingScene,
    clock: &Clock,
    lifespan: f32,
    velocity: SeedVelocity,
    maximum: usize,
) -> MaskSeeds {
    let pieces: Vec<Vec<Piece>> = scene
        .input_views
        .par_iter()
        .map(|view| pieces(scene, view))
        .collect();
    let all: Vec<MaskedPixel> = pieces
        .iter()
        .enumerate()
        .flat_map(|(view, pieces)| {
            pieces
                .iter()
                .enumerate()
                .map(move |(n, piece)| (view, n, piece))
        })
        .flat_map(|(view, number, piece)| {
            piece.pixels.iter().map(move |&pixel| MaskedPixel {
                view,
                piece: number,
                pixel,
            })
        })
        .collect();
    let count = all.len().min(maximum);
    let mut seeds = MaskSeeds {
        masked_pixels: all.len(),
        ..MaskSeeds::default()
    };
    if count == 0 {
        return seeds;
    }
    // A pixel is shown by the seeds of all views within a lifespan: so many fewer are enough.
    let pixels_per_seed = all.len() as f32 / count as f32 / lifespan.max(1.0);
    let spread = pixels_per_seed.max(1.0).sqrt();
    let velocities: Vec<Vec<Vec3>> = match velocity {
        SeedVelocity::None => pieces
            .iter()
            .map(|all| vec![Vec3::ZERO; all.len()])
            .collect(),
        SeedVelocity::Tracked => tracked_velocities(scene, clock, &pieces),
    };
    for step in 0..count {
        let at = all[step * all.len() / count];
        let view = &scene.input_views[at.view];
        let piece = &pieces[at.view][at.piece];
        let direction = direction(&scene.camera, view, at.pixel);
        let pitch = PI / scene.camera.height as f32 * piece.distance;
        let position = view.view.centre + direction * piece.distance;
        let rgb = &view.pixels[3 * at.pixel..3 * at.pixel + 3];
        let gaussians = &mut seeds.gaussians;
        gaussians.positions.push(position.to_array());
        gaussians.scales.push(0.5 * pitch * spread);
        gaussians
            .colours
            .push([0, 1, 2].map(|channel| f32::from(rgb[channel]) / 255.0));
        gaussians.opacities.push(SEED_OPACITY);
        let peak = clock.frame(view.view.time_seconds) as f32;
        seeds.times.peaks.push(peak);
        seeds.times.lifespans.push(lifespan);
        let velocity = velocities[at.view][at.piece];
        seeds.times.velocities.push(velocity.to_array());
        seeds.without_points += usize::from(!piece.has_points);
    }
    seeds
}

/// The velocity of every piece of every view, units per frame; zero where it is not found before and
/// after.
fn tracked_velocities(
    scene: &TrainingScene,
    clock: &Clock,
    pieces: &[Vec<Piece>],
) -> Vec<Vec<Vec3>> {
    let mut order: Vec<usize> = (0..pieces.len()).collect();
    order.sort_by_key(|&view| scene.input_views[view].frame);
    let mut velocities: Vec<Vec<Vec3>> = pieces
        .iter()
        .map(|pieces| vec![Vec3::ZERO; pieces.len()])
        .collect();
    for triple in order.windows(3) {
        let [before, now, after] = [triple[0], triple[1], triple[2]];
        let views = [before, after].map(|view| &scene.input_views[view].view);
        let [begin, end] = views.map(|view| clock.frame(view.time_seconds));
        for (number, piece) in pieces[now].iter().enumerate() {
            let found = [before, after].map(|view| same_piece(number, &pieces[now], &pieces[view]));
            if let [Some(first), Some(last)] = found {
                let [from, to] = [(views[0], first), (views[1], last)]
                    .map(|(view, other)| view.centre + other.direction * piece.distance);
                let velocity = (to - from) / (end - begin) as f32;
                let radial = piece.direction * piece.direction.dot(velocity);
                velocities[now][number] = velocity - radial;
            }
        }
    }
    velocities
}

/// The piece among `others` that is piece `number` of `all`.
fn same_piece<'p>(number: usize, all: &[Piece], others: &'p [Piece]) -> Option<&'p Piece> {
    let nearest = |to: &Piece, among: &[Piece]| {
        let angle = |other: &Piece| to.direction.dot(other.direction);
        (0..among.len()).max_by(|&a, &b| angle(&among[a]).total_cmp(&angle(&among[b])))
    };
    let piece = &all[number];
    let found = nearest(piece, others)?;
    let other = &others[found];
    let growth = (other.area / piece.area).max(piece.area / other.area);
    let is_same = nearest(other, all) == Some(number)
        && piece.direction.dot(other.direction) > LARGEST_STEP.cos()
        && growth < LARGEST_GROWTH;
    is_same.then_some(other)
}

/// World direction of a pixel's centre.
fn direction(camera: &ErpCamera, view: &TrainingView, pixel: usize) -> Vec3 {
    let width = camera.width as usize;
    let centre = glam::dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
    let ray = camera.unproject(centre).as_vec3();
    view.view.rotation.transpose() * ray
}

/// The pieces of one view's mask.
fn pieces(scene: &TrainingScene, view: &TrainingView) -> Vec<Piece> {
    let Some(mask) = &view.mask else {
        return Vec::new();
    };
    let (width, height) = (scene.camera.width as usize, scene.camera.height as usize);
    let (labels, count) = connected_pieces(mask, width);
    let mut points: Vec<Vec<f32>> = vec![Vec::new(); count];
    for &position in &scene.points.positions {
        let point = view.view.rotation * (Vec3::from_array(position) - view.view.centre);
        let distance = point.length();
        if distance > 0.0 {
            let pixel = erp::project(&scene.camera, point, distance).pixel;
            let column = (pixel.x as usize).min(width - 1);
            let row = (pixel.y as usize).min(height - 1);
            if let Some(piece) = labels[row * width + column] {
                points[piece].push(distance);
            }
        }
    }
    let distances: Vec<Option<f32>> = points.into_iter().map(near_distance).collect();
    let mut known: Vec<f32> = distances.iter().flatten().copied().collect();
    known.sort_by(f32::total_cmp);
    let otherwise = known
        .get(known.len() / 2)
        .copied()
        .unwrap_or_else(|| scene.median_point_distance().max(1.0));
    let mut pieces: Vec<Piece> = distances
        .into_iter()
        .map(|distance| Piece {
            pixels: Vec::new(),
            direction: Vec3::ZERO,
            area: 0.0,
            distance: distance.unwrap_or(otherwise),
            has_points: distance.is_some(),
        })
        .collect();
    let pitch = PI / height as f32;
    for (pixel, label) in labels.into_iter().enumerate() {
        let Some(label) = label else { continue };
        let piece = &mut pieces[label];
        let latitude = PI * (0.5 - ((pixel / width) as f32 + 0.5) / height as f32);
        let area = pitch * pitch * latitude.cos();
        piece.pixels.push(pixel);
        piece.area += area;
        piece.direction += direction(&scene.camera, view, pixel) * area;
    }
    for piece in &mut pieces {
        piece.direction = piece.direction.normalize_or_zero();
    }
    pieces
}

/// The distance of a piece from those of the points in it.
fn near_distance(mut distances: Vec<f32>) -> Option<f32> {
    distances.sort_by(f32::total_cmp);
    let nearest = (NEAR_SHARE * distances.len() as f32) as usize;
    (distances.len() >= LEAST_POINTS).then(|| distances[nearest])
}

/// Numbers the connected pieces of a mask (4 neighbours, around the seam); returns the number of each
/// pixel's piece and how many there are.
fn connected_pieces(mask: &[u8], width: usize) -> (Vec<Option<usize>>, usize) {
    let mut labels = vec![None; mask.len()];
    let mut pieces = 0;
    let mut open = Vec::new();
    for first in 0..mask.len() {
        if mask[first] < COVERED || labels[first].is_some() {
            continue;
        }
        labels[first] = Some(pieces);
        open.push(first);
        while let Some(pixel) = open.pop() {
            let (row, column) = (pixel / width, pixel % width);
            let sideways = [width - 1, 1].map(|step| row * width + (column + step) % width);
            let above = pixel.checked_sub(width);
            let below = (pixel + width < mask.len()).then_some(pixel + width);
            for neighbour in sideways.into_iter().chain(above).chain(below) {
                if mask[neighbour] >= COVERED && labels[neighbour].is_none() {
                    labels[neighbour] = Some(pieces);
                    open.push(neighbour);
                }
            }
        }
        pieces += 1;
    }
    (labels, pieces)
}

#[cfg(test)]
mod tests {
    use glam::Mat3;
    use omnilife_schemas::{Similarity, points::PointCloud};

    use super::*;
    use omnilife_engine::camera::View;

    /// One view of a mask with a piece across the seam and one in the middle of the image.
    fn scene() -> TrainingScene {
        let camera = ErpCamera {
            width: 16,
            height: 8,
        };
        let mut mask = vec![0; 128];
        for pixel in [4 * 16, 4 * 16 + 15, 3 * 16 + 15] {
            mask[pixel] = 255;
        }
        mask[4 * 16 + 8] = 200;
        mask[4 * 16 + 9] = 100;
        let view = TrainingView {
            frame: 0,
            view: View {
                camera: camera.into(),
                rotation: Mat3::IDENTITY,
                centre: Vec3::new(0.0, 0.0, 0.5),
                time_seconds: 2.0,
            },
            pixels: (0..128_u8).flat_map(|pixel| [pixel, 0, 255]).collect(),
            mask: Some(mask),
        };
        // Ten points before the piece in the middle, the nearest at 3, and one beside everything.
        let positions: Vec<[f32; 3]> = (0..10)
            .map(|index| [0.2, 0.2, 3.5 + index as f32])
            .chain([[5.0, 0.0, 0.0]])
            .collect();
        TrainingScene {
            id: "mask".to_owned(),
            camera,
            input_views: vec![view],
            novel_views: Vec::new(),
            normalization: Similarity {
                offset: [0.0; 3],
                scale: 1.0,
            },
            scale: omnilife_schemas::records::Scale::Arbitrary,
            is_normalized_by_points: false,
            points: PointCloud {
                colours: vec![[0; 3]; positions.len()],
                positions,
            },
        }
    }

    #[test]
    fn pieces_are_connected_around_the_seam() {
        let mask = scene().input_views[0].mask.clone().expect("given");
        let (labels, pieces) = connected_pieces(&mask, 16);
        assert_eq!(pieces, 2);
        assert_eq!(labels[4 * 16], labels[3 * 16 + 15]);
        assert_eq!(labels.iter().flatten().count(), 4);
    }

    #[test]
    fn seeds_lie_on_the_masked_pixels_at_the_distance_of_what_they_hide() {
        let scene = scene();
        let clock = Clock {
            origin_seconds: 1.0,
            frame_seconds: 0.5,
            duration_frames: 10.0,
        };
        let seeds = mask_seeds(&scene, &clock, 3.0, SeedVelocity::Tracked, 100);
        assert_eq!((seeds.masked_pixels, seeds.gaussians.len()), (4, 4));
        assert_eq!(seeds.times.peaks, [2.0; 4]);
        // The second nearest of ten in the middle piece; the other takes its distance.
        let expected = Vec3::new(0.2, 0.2, 4.0).length();
        for position in &seeds.gaussians.positions {
            let distance = (Vec3::from_array(*position) - Vec3::Z * 0.5).length();
            assert!((distance - expected).abs() < 1e-4, "{distance} {expected}");
        }
        assert_eq!(seeds.without_points, 3);
        let middle = seeds
            .gaussians
            .positions
            .iter()
            .find(|position| position[2] > 0.6);
        let [x, y, _] = *middle.expect("in front");
        assert!((x - expected * (PI / 16.0).sin() * (PI / 16.0).cos()).abs() < 1e-3 && y > 0.0);
        assert_eq!(
            mask_seeds(&scene, &clock, 3.0, SeedVelocity::None, 2)
                .gaussians
                .len(),
            2
        );
        assert_eq!(
            mask_seeds(&scene, &clock, 3.0, SeedVelocity::None, 0)
                .gaussians
                .len(),
            0
        );
    }

    #[test]
    fn a_piece_that_walks_has_its_velocity() {
        let mut scene = scene();
        scene.camera = ErpCamera {
            width: 64,
            height: 32,
        };
        let first = scene.input_views[0].clone();
        scene.input_views.clear();
        // One column to the right per frame, from the middle of the image; frames 0, 1, 2, 4.
        for (frame, column) in [(0, 32), (1, 33), (2, 34), (4, 36)] {
            let mut view = first.clone();
            view.frame = frame;
            view.view.time_seconds = f64::from(frame);
            view.pixels = vec![90; 64 * 32 * 3];
            let mut mask = vec![0; 64 * 32];
            for row in [15, 16] {
                mask[row * 64 + column] = 255;
            }
            view.mask = Some(mask);
            scene.input_views.push(view);
        }
        let clock = Clock {
            origin_seconds: 2.0,
            frame_seconds: 1.0,
            duration_frames: 4.0,
        };
        let seeds = mask_seeds(&scene, &clock, 3.0, SeedVelocity::Tracked, 100);
        assert_eq!(seeds.gaussians.len(), 8);
        for (velocity, position) in seeds
            .times
            .velocities
            .iter()
            .zip(&seeds.gaussians.positions)
        {
            let offset = Vec3::from_array(*position) - Vec3::Z * 0.5;
            let speed = Vec3::from_array(*velocity).length() / offset.length();
            // A column is a sixty-fourth of a turn.
            assert!(
                speed == 0.0 || (speed - 2.0 * PI / 64.0).abs() < 0.01,
                "{speed}"
            );
        }
        // The first and the last view have no view before or after.
        let at_rest = seeds
            .times
            .velocities
            .iter()
            .filter(|v| **v == [0.0; 3])
            .count();
        assert_eq!(at_rest, 4);
    }

    #[test]
    fn empty_masks_have_no_seeds() {
        let mut scene = scene();
        let clock = Clock {
            origin_seconds: 0.0,
            frame_seconds: 1.0,
            duration_frames: 0.0,
        };
        for mask in [None, Some(vec![0; 128])] {
            scene.input_views[0].mask = mask;
            let seeds = mask_seeds(&scene, &clock, 3.0, SeedVelocity::Tracked, 9);
            assert_eq!(seeds, MaskSeeds::default());
        }
    }
}
