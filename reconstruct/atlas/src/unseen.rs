//! Parts of the background that no training frame shows: a clean plate has the model's guess there.
//!
//! Rays of up to 24 training frames mark cells of the background, 64 along the longer side of its texture, where nothing
//! in front hides more than half. Cells between neighbouring rays that are marked count too. The mask is by the parts
//! of the model before they are removed, so that it is as good as their outlines.

use std::path::Path;

use omnilife_schemas::rgb::Mask;
use omnilife_training::error::ReconstructError;

use super::{
    graph::{FootageFrame, Graph},
    initialize::background::BACKGROUND,
    node::Surface,
    render::Rays,
    saved,
    shade::Detail,
};

/// Mask of an edited run beside its atlas: texels of the background, white where none of the looked-at frames shows it.
pub(super) const FILE: &str = "background-unseen.png";

/// Cells along the longer side of the texture, and rays along that of a frame.
const CELLS: usize = 64;
const RAYS: u32 = 128;
/// Maximum number of frames; of more, an even selection is used.
const MOST_FRAMES: usize = 24;
/// Least transmittance of what is in front.
const VISIBLE: f64 = 0.5;

/// Unseen part of a node.
#[derive(Debug)]
pub(super) struct UnseenPart {
    /// At the size of the node's texture.
    pub(super) mask: Mask,
    /// Share of the surface, 0 to 1.
    pub(super) share: f64,
}

/// Returns the unseen part of the background of a run's atlas, with that of an earlier edit; `None` without a
/// background or frames.
///
/// # Errors
/// When the atlas or an earlier mask cannot be read.
pub(super) fn of_run(folder: &Path) -> Result<Option<UnseenPart>, ReconstructError> {
    let mut graph = saved::read(folder)?;
    let Some(number) = graph.find(BACKGROUND) else {
        return Ok(None);
    };
    if graph.footage.frames.is_empty() {
        return Ok(None);
    }
    let mut mask = of_node(&mut graph, number);
    let earlier = folder.join(FILE);
    if earlier.is_file() {
        mask = mask.united(&Mask::read(&earlier)?);
    }
    let share = share(&mask, &graph.nodes[number].surface);
    Ok(Some(UnseenPart { mask, share }))
}

/// Marks the texels of a node that no frame shows.
fn of_node(graph: &mut Graph, number: usize) -> Mask {
    let texture = &graph.nodes[number].colour;
    let (width, height) = (texture.width, texture.height);
    let longer = width.max(height).max(1);
    let grid = [width, height].map(|side| (side * CELLS).div_ceil(longer).max(1));
    let mut is_seen = vec![false; grid[0] * grid[1]];
    let step = graph.footage.frames.len().div_ceil(MOST_FRAMES).max(1);
    let frames: Vec<FootageFrame> = graph.footage.frames.iter().copied().step_by(step).collect();
    for frame in &frames {
        let (cells, across) = visible_cells(graph, number, frame, grid);
        mark(&cells, across, grid, &mut is_seen);
    }
    let texel = |at: usize| {
        let column = at % width * grid[0] / width;
        let row = at / width * grid[1] / height;
        255 * u8::from(!is_seen[row * grid[0] + column])
    };
    Mask {
        width,
        height,
        data: (0..width * height).map(texel).collect(),
    }
}

/// Returns column and row of the cell that each ray of a frame sees, row by row, and the rays of a row.
fn visible_cells(
    graph: &mut Graph,
    number: usize,
    frame: &FootageFrame,
    grid: [usize; 2],
) -> (Vec<Option<[usize; 2]>>, usize) {
    let camera = graph.footage.camera;
    let longer = camera.width().max(camera.height()).max(1);
    let rays = |side: u32| (side * RAYS).div_ceil(longer).max(1);
    let camera = camera.resized(rays(camera.width()), rays(camera.height()));
    let [across, down] = [camera.width() as usize, camera.height() as usize];
    let rays = Rays::of_pixels(&camera, frame.moment(), 0..across * down);
    let seen = graph.see(&rays, &Detail::FULL, false, &|_| true);
    let mut cells = vec![None; across * down];
    let shades = &seen.shaded[number].shades;
    for (sample, shade) in seen.samples[number].iter().zip(shades) {
        let (layers, _) = seen.layers(sample.ray);
        let in_front = layers.iter().take_while(|layer| layer.surface != number);
        let transmittance: f64 = in_front.map(|layer| 1.0 - layer.opacity).product();
        if transmittance >= VISIBLE {
            let place = match graph.nodes[number].surface {
                Surface::Plane { .. } => [shade.query.x, shade.query.y],
                Surface::Sphere { .. } => {
                    use std::f64::consts::{PI, TAU};
                    let query = shade.query.normalize();
                    [
                        query.x.atan2(query.z) / TAU + 0.5,
                        0.5 + query.y.clamp(-1.0, 1.0).asin() / PI,
                    ]
                }
            };
            // Flow may lead a little beyond the border.
            let cell = |axis: usize| {
                let at = (place[axis] * grid[axis] as f64).max(0.0) as usize;
                at.min(grid[axis] - 1)
            };
            cells[sample.ray] = Some([cell(0), cell(1)]);
        }
    }
    (cells, across)
}

/// Marks the cells of rays, and those between four neighbouring rays.
fn mark(cells: &[Option<[usize; 2]>], across: usize, grid: [usize; 2], is_seen: &mut [bool]) {
    for &[column, row] in cells.iter().flatten() {
        is_seen[row * grid[0] + column] = true;
    }
    for (upper, lower) in cells
        .chunks_exact(across)
        .zip(cells.chunks_exact(across).skip(1))
    {
        for (above, below) in upper.windows(2).zip(lower.windows(2)) {
            let four = [above[0], above[1], below[0], below[1]];
            let known: Vec<[usize; 2]> = four.into_iter().flatten().collect();
            let ends = |axis: usize| {
                let places = known.iter().map(|cell| cell[axis]);
                (places.clone().min(), places.max())
            };
            let ((Some(left), Some(right)), (Some(top), Some(bottom))) = (ends(0), ends(1)) else {
                continue;
            };
            // Rays around the seam of a sphere lie at both of its ends.
            if known.len() == 4 && right - left <= grid[0] / 2 {
                for row in top..=bottom {
                    is_seen[row * grid[0] + left..=row * grid[0] + right].fill(true);
                }
            }
        }
    }
}

/// Returns the share of a surface that a mask of its texels marks.
fn share(mask: &Mask, surface: &Surface) -> f64 {
    let weight = |row: usize| match surface {
        Surface::Plane { .. } => 1.0,
        Surface::Sphere { .. } => {
            (std::f64::consts::PI * (row as f64 + 0.5) / mask.height as f64).sin()
        }
    };
    let (mut marked, mut all) = (0.0, 0.0);
    for (row, texels) in mask.data.chunks_exact(mask.width).enumerate() {
        all += weight(row) * texels.len() as f64;
        marked += weight(row) * texels.iter().filter(|&&texel| texel != 0).count() as f64;
    }
    marked / f64::max(all, f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat, DVec2, DVec3};
    use omnilife_engine::{
        surfaces::texture::Texture,
        trajectories::rigid_spline::{RigidPose, RigidSpline},
    };
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;
    use crate::{
        clip::UnitClock,
        graph::Footage,
        node::{Fields, Node},
    };

    const SIDE: usize = 128;

    /// An opaque square across z.
    fn square(id: &str, z: f64, side: f64) -> Node {
        Node {
            id: id.to_owned(),
            surface: Surface::Plane {
                size: DVec2::splat(side),
                trajectory: RigidSpline {
                    positions: vec![DVec3::new(0.0, 0.0, z)],
                    rotations: vec![DQuat::IDENTITY],
                },
            },
            colour: Texture::constant(SIDE, SIDE, [0.2; 3]),
            opacity: None,
            fields: Fields::default(),
            offsets: None,
            times: [f64::MIN, f64::MAX],
            delay: 0.0,
            overlay: None,
        }
    }

    /// A square of 8 at a distance of 4, which fills the image of a camera in the middle, and one of 1 halfway, seen
    /// from places along x.
    fn scene(places: &[f64]) -> Graph {
        let frame = |(number, &x): (usize, &f64)| FootageFrame {
            number: number as u32,
            time: 0.5,
            pose: RigidPose {
                centre: DVec3::new(x, 0.0, 0.0),
                rotation: DMat3::IDENTITY,
            },
        };
        Graph {
            nodes: vec![square(BACKGROUND, 4.0, 8.0), square("post", 2.0, 1.0)],
            camera: None,
            clock: UnitClock {
                begin_seconds: 0.0,
                length_seconds: 1.0,
            },
            footage: Footage {
                camera: PinholeCamera::with_horizontal_field_of_view(
                    96,
                    96,
                    std::f64::consts::FRAC_PI_2,
                )
                .into(),
                frames: places.iter().enumerate().map(frame).collect(),
            },
        }
    }

    fn unseen(places: &[f64]) -> (Mask, f64) {
        let mut graph = scene(places);
        let mask = of_node(&mut graph, 0);
        let share = share(&mask, &graph.nodes[0].surface);
        (mask, share)
    }

    #[test]
    fn what_an_object_hides_in_all_frames_is_unseen() {
        // Its shadow is 2 wide and high, of 8.
        let (mask, share) = unseen(&[0.0]);
        assert!((share - 1.0 / 16.0).abs() < 0.004, "{share}");
        let at = |column: usize, row: usize| mask.data[row * SIDE + column];
        assert_eq!(
            [at(64, 64), at(50, 78), at(44, 64), at(10, 100)],
            [255, 255, 0, 0]
        );
        // Two places along x: each shows what is hidden from the other.
        let (_, share) = unseen(&[0.0, 2.0]);
        assert!(share < 0.004, "{share}");
    }

    #[test]
    fn what_lies_outside_of_all_frames_is_unseen() {
        // From x = 6 the image begins at x = 2, and the shadow ends at x = -5.
        let (mask, share) = unseen(&[6.0]);
        assert!((share - 0.75).abs() < 0.01, "{share}");
        assert_eq!(
            [mask.data[64 * SIDE + 90], mask.data[64 * SIDE + 110]],
            [255, 0]
        );
    }

    #[test]
    fn cells_between_four_rays_are_seen_but_not_across_a_seam() {
        let seen = |right: usize, corner: Option<[usize; 2]>| {
            let rays = [Some([0, 0]), Some([right, 0]), Some([0, 2]), corner];
            let mut is_seen = vec![false; 32];
            mark(&rays, 2, [8, 4], &mut is_seen);
            is_seen.iter().filter(|&&seen| seen).count()
        };
        assert_eq!(seen(3, Some([3, 2])), 12);
        assert_eq!(seen(3, None), 3);
        assert_eq!(seen(7, Some([7, 2])), 4);
    }

    #[test]
    fn rows_of_a_sphere_count_by_their_area() {
        let sphere = Surface::Sphere {
            centre: DVec3::ZERO,
            radius: 1.0,
        };
        let mask = Mask {
            width: 4,
            height: 60,
            data: (0..240).map(|at| 255 * u8::from(at < 60)).collect(),
        };
        // The upper quarter of the rows is 45 degrees around the pole.
        let cap = 0.5 * (1.0 - std::f64::consts::FRAC_PI_4.cos());
        assert!((share(&mask, &sphere) - cap).abs() < 1e-3);
        let plane = &square("a", 1.0, 1.0).surface;
        assert!((share(&mask, plane) - 0.25).abs() < 1e-12);
    }
}
