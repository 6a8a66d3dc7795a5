//! First Gaussians: from a point cloud, and from the sky where no point is.

use std::f32::consts::{PI, TAU};

use glam::{Vec3, vec3};
use omnilife_schemas::points::PointCloud;
use rayon::prelude::*;
use rstar::RTree;

use crate::scene::TrainingScene;
use omnilife_engine::gaussians::static_gaussians::InitialGaussians;

/// Opacity of first Gaussians (3DGS `scene/gaussian_model.py`).
const POINT_OPACITY: f32 = 0.1;
/// Opacity of the sky shell: there is nothing behind it.
const SHELL_OPACITY: f32 = 0.8;
/// Neighbours whose mean squared distance gives a Gaussian's first scale (3DGS).
const NEIGHBOURS: usize = 3;
/// The shell's radius over the 95th percentile of the points' distance from the mean camera.
const SHELL_RADIUS_FACTOR: f32 = 1.5;
/// A shell without any points has this radius in camera radii.
const SHELL_RADIUS_WITHOUT_POINTS: f32 = 100.0;

/// At most `maximum` of the points, evenly spread: the points are walked along a curve through
/// space, and every so manieth is taken.
pub fn thinned(points: &PointCloud, maximum: usize) -> PointCloud {
    if points.len() <= maximum {
        return points.clone();
    }
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_cached_key(|&index| morton_code(points.positions[index]));
    let taken = (0..maximum).map(|step| order[step * points.len() / maximum]);
    let (positions, colours) = taken
        .map(|index| (points.positions[index], points.colours[index]))
        .unzip();
    PointCloud { positions, colours }
}

/// Position along the Z-order curve. The bits of a float's magnitude rise with it, so that the curve
/// resolves near points as finely, for their distance, as far ones.
fn morton_code(position: [f32; 3]) -> u128 {
    let ordered = position.map(|value| {
        let bits = value.to_bits();
        let sign = 1 << 31;
        if bits & sign == 0 { bits | sign } else { !bits }
    });
    (0..32).rev().fold(0, |code, bit| {
        ordered
            .iter()
            .fold(code, |code, value| code << 1 | u128::from(value >> bit & 1))
    })
}

/// Gaussians at points in normalized coordinates: colour of the point, isotropic scale from the
/// three nearest neighbours and within a factor `spread` of their median, opacity 0.1.
pub fn from_points(points: &PointCloud, spread: f32) -> InitialGaussians {
    let positions = &points.positions;
    let tree = RTree::bulk_load(positions.clone());
    let mut scales: Vec<f32> = positions
        .par_iter()
        .map(|&position| {
            // The first neighbour is the point itself.
            let (sum, count) = tree
                .nearest_neighbor_iter_with_distance_2(position)
                .skip(1)
                .take(NEIGHBOURS)
                .fold((0.0, 0), |(sum, count), (_, squared)| {
                    (sum + squared, count + 1)
                });
            if count == 0 {
                0.0
            } else {
                (sum / count as f32).sqrt()
            }
        })
        .collect();
    let mut sorted = scales.clone();
    sorted.sort_by(f32::total_cmp);
    // All points in one place have no scale of their own: a hundredth of a camera radius.
    let median = sorted
        .get(sorted.len() / 2)
        .copied()
        .filter(|&median| median > 0.0)
        .unwrap_or(0.01);
    for scale in &mut scales {
        if *scale == 0.0 {
            *scale = median;
        }
        *scale = scale.clamp(median / spread, median * spread);
    }
    InitialGaussians {
        positions: positions.clone(),
        scales,
        colours: points
            .colours
            .iter()
            .map(|colour| colour.map(|byte| f32::from(byte) / 255.0))
            .collect(),
        opacities: vec![POINT_OPACITY; positions.len()],
    }
}

/// A shell of Gaussians around the scene, in the directions in which it has no points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SkyShell {
    /// The Gaussians.
    pub gaussians: InitialGaussians,
    /// Directions that were looked at, evenly spread over the sphere.
    pub directions: usize,
}

impl SkyShell {
    /// Share of the sphere without points.
    pub fn open_share(&self) -> f32 {
        self.gaussians.positions.len() as f32 / self.directions.max(1) as f32
    }
}

/// Looks for open sky in `directions` directions from the mean camera, spread evenly over the
/// sphere: a direction is open when no point lies within twice the directions' spacing of it.
///
/// Structure from motion finds no points in the sky; without a shell, Gaussians near the camera are
/// stretched to fill it. Colours are the mean over the input views at that direction, which is
/// exact at infinity.
pub fn sky_shell(scene: &TrainingScene, directions: usize) -> SkyShell {
    let points: Vec<[f32; 3]> = scene
        .points
        .positions
        .iter()
        .filter_map(|&position| Vec3::from_array(position).try_normalize())
        .map(|direction| direction.to_array())
        .collect();
    let tree = RTree::bulk_load(points);
    // Mean distance between neighbours on the unit sphere.
    let spacing = (4.0 * PI / directions as f32).sqrt();
    let open: Vec<Vec3> = fibonacci_sphere(directions)
        .into_par_iter()
        .filter(|direction| {
            tree.locate_within_distance(direction.to_array(), (2.0 * spacing).powi(2))
                .next()
                .is_none()
        })
        .collect();
    let radius = shell_radius(scene);
    SkyShell {
        directions,
        gaussians: InitialGaussians {
            positions: open
                .iter()
                .map(|&direction| (direction * radius).to_array())
                .collect(),
            // Half the spacing: neighbours overlap at one standard deviation.
            scales: vec![0.5 * spacing * radius; open.len()],
            colours: open
                .par_iter()
                .map(|&direction| mean_colour(scene, direction))
                .collect(),
            opacities: vec![SHELL_OPACITY; open.len()],
        },
    }
}

fn shell_radius(scene: &TrainingScene) -> f32 {
    let mut distances: Vec<f32> = scene
        .points
        .positions
        .iter()
        .map(|&position| Vec3::from_array(position).length())
        .collect();
    distances.sort_by(f32::total_cmp);
    match distances.get(distances.len() * 95 / 100) {
        // Never so near that the cameras (within one unit) see its parallax.
        Some(&distance) => (SHELL_RADIUS_FACTOR * distance).max(10.0),
        None => SHELL_RADIUS_WITHOUT_POINTS,
    }
}

fn fibonacci_sphere(count: usize) -> Vec<Vec3> {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    (0..count)
        .map(|index| {
            let y = 1.0 - 2.0 * (index as f32 + 0.5) / count as f32;
            let rho = (1.0 - y * y).max(0.0).sqrt();
            let angle = (golden * index as f32) % TAU;
            vec3(rho * angle.cos(), y, rho * angle.sin())
        })
        .collect()
}

fn mean_colour(scene: &TrainingScene, direction_world: Vec3) -> [f32; 3] {
    let (width, height) = (scene.camera.width as usize, scene.camera.height as usize);
    let mut sum = [0.0; 3];
    for view in &scene.input_views {
        let projection = omnilife_engine::camera::erp::project(
            &scene.camera,
            view.view.rotation * direction_world,
            1.0,
        );
        let column = (projection.pixel.x as usize).min(width - 1);
        let row = (projection.pixel.y as usize).min(height - 1);
        for (channel, sum) in sum.iter_mut().enumerate() {
            *sum += f32::from(view.pixels[(row * width + column) * 3 + channel]) / 255.0;
        }
    }
    sum.map(|value| value / scene.input_views.len().max(1) as f32)
}

/// Both sets one after the other.
pub fn join(mut first: InitialGaussians, second: InitialGaussians) -> InitialGaussians {
    first.positions.extend(second.positions);
    first.scales.extend(second.scales);
    first.colours.extend(second.colours);
    first.opacities.extend(second.opacities);
    first
}

/// Those that are `chosen`, and the others.
pub fn partition(
    gaussians: &InitialGaussians,
    chosen: &[bool],
) -> (InitialGaussians, InitialGaussians) {
    let part = |wanted: bool| {
        let indices = (0..gaussians.len()).filter(|&index| chosen[index] == wanted);
        let mut part = InitialGaussians::default();
        for index in indices {
            part.positions.push(gaussians.positions[index]);
            part.scales.push(gaussians.scales[index]);
            part.colours.push(gaussians.colours[index]);
            part.opacities.push(gaussians.opacities[index]);
        }
        part
    };
    (part(true), part(false))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(positions: Vec<[f32; 3]>) -> PointCloud {
        PointCloud {
            colours: vec![[100; 3]; positions.len()],
            positions,
        }
    }

    #[test]
    fn thinning_keeps_points_of_every_region() {
        // Nine tenths of the points in one place, the others in four far corners.
        let mut positions: Vec<[f32; 3]> = (0..900)
            .map(|index| [1.0 + 1e-4 * index as f32, 1.0, 1.0])
            .collect();
        let corners = [
            [50.0, 50.0, 1.0],
            [-50.0, 50.0, 1.0],
            [50.0, -50.0, 1.0],
            [-50.0; 3],
        ];
        for index in 0..100 {
            let [x, y, z]: [f32; 3] = corners[index % 4];
            positions.push([x, y, z + 0.1 * index as f32]);
        }
        let thin = thinned(&cloud(positions.clone()), 100);
        assert_eq!((thin.len(), thin.colours.len()), (100, 100));
        for [x, y, _] in corners {
            let near = |position: &&[f32; 3]| (position[0] - x).hypot(position[1] - y) < 1.0;
            let share = thin.positions.iter().filter(near).count();
            assert!((2..=3).contains(&share), "{share} at {x} {y}");
        }
        assert_eq!(
            thinned(&cloud(positions.clone()), 2_000).positions,
            positions
        );
        assert!(thinned(&cloud(positions), 0).is_empty());
    }

    #[test]
    fn one_point_and_points_in_one_place_get_a_finite_scale() {
        for positions in [vec![[1.0, 2.0, 3.0]], vec![[1.0; 3]; 50], vec![[0.0; 3]; 5]] {
            let gaussians = from_points(&cloud(positions), 10.0);
            assert!(
                gaussians.scales.iter().all(|&scale| scale == 0.01),
                "{:?}",
                gaussians.scales
            );
        }
        assert_eq!(from_points(&PointCloud::default(), 10.0).len(), 0);
    }
}
