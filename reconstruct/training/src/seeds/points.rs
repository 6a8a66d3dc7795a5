//! First Gaussians from a point cloud.

use omnilife_schemas::{points::PointCloud, statistics};
use rayon::prelude::*;
use rstar::RTree;

use omnilife_engine::gaussians::static_gaussians::InitialGaussians;

/// Opacity of first Gaussians (3DGS `scene/gaussian_model.py`).
const POINT_OPACITY: f32 = 0.1;
/// Neighbours whose mean squared distance gives a Gaussian's first scale (3DGS).
const NEIGHBOURS: usize = 3;

/// Returns indices of at most `maximum` of the points, evenly spread: one of every so many along a curve through
/// space.
pub fn thinned_indices(points: &PointCloud<f32>, maximum: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    if points.len() <= maximum {
        return order;
    }
    order.sort_by_cached_key(|&index| morton_code(points.positions[index]));
    (0..maximum)
        .map(|step| order[step * points.len() / maximum])
        .collect()
}

/// Returns the points at these indices.
pub fn selected(points: &PointCloud<f32>, indices: &[usize]) -> PointCloud<f32> {
    let (positions, colours) = indices
        .iter()
        .map(|&index| (points.positions[index], points.colours[index]))
        .unzip();
    PointCloud { positions, colours }
}

/// Returns at most `maximum` of the points, evenly spread ([`thinned_indices`]).
pub fn thinned(points: &PointCloud<f32>, maximum: usize) -> PointCloud<f32> {
    selected(points, &thinned_indices(points, maximum))
}

/// Returns the position along the Z-order curve. The bits of a float's magnitude rise with it, so that the curve
/// resolves near points as finely, for their distance, as far ones.
pub(crate) fn morton_code(position: [f32; 3]) -> u128 {
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

/// Makes Gaussians at points in normalized coordinates: colour of the point, opacity 0.1, and an isotropic scale
/// from the three nearest neighbours within a factor `spread` of their median.
pub fn from_points(points: &PointCloud<f32>, spread: f32) -> InitialGaussians {
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
    // All points in one place have no scale of their own: a hundredth of a camera radius.
    let median = statistics::median(&scales)
        .filter(|&median| median > 0.0)
        .unwrap_or(0.01);
    for scale in &mut scales {
        if *scale == 0.0 {
            *scale = median;
        }
        *scale = scale.clamp(median / spread, median * spread);
    }
    let colour = |bytes: &[u8; 3]| bytes.map(|byte| f32::from(byte) / 255.0);
    InitialGaussians::isotropic(
        positions.clone(),
        &scales,
        points.colours.iter().map(colour).collect(),
        vec![POINT_OPACITY; positions.len()],
    )
}

/// Returns both sets one after the other.
pub fn join(mut first: InitialGaussians, second: InitialGaussians) -> InitialGaussians {
    first.append(second);
    first
}

/// Returns the Gaussians that are `chosen`, and the others.
pub fn partition(
    gaussians: &InitialGaussians,
    chosen: &[bool],
) -> (InitialGaussians, InitialGaussians) {
    let part = |wanted: bool| {
        let is_wanted = |&index: &usize| chosen[index] == wanted;
        let indices: Vec<usize> = (0..gaussians.len()).filter(is_wanted).collect();
        gaussians.selected(&indices)
    };
    (part(true), part(false))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(positions: Vec<[f32; 3]>) -> PointCloud<f32> {
        PointCloud::of_colour(positions, [100; 3])
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
    fn sizes_are_those_of_the_three_nearest() {
        let line = [0.0, 1.0, 2.0, 4.0].map(|x| [x, 0.0, 0.0]).to_vec();
        let gaussians = from_points(&cloud(line), 10.0);
        let squares: [[f32; 3]; 4] = [
            [1.0, 4.0, 16.0],
            [1.0, 1.0, 9.0],
            [1.0, 4.0, 4.0],
            [4.0, 9.0, 16.0],
        ];
        for (scale, squares) in gaussians.scales.iter().zip(squares) {
            let expected = (squares.iter().sum::<f32>() / 3.0).sqrt();
            assert!(scale.iter().all(|axis| (axis - expected).abs() < 1e-5));
        }
    }

    #[test]
    fn one_point_and_points_in_one_place_get_a_finite_scale() {
        for positions in [vec![[1.0, 2.0, 3.0]], vec![[1.0; 3]; 50], vec![[0.0; 3]; 5]] {
            let gaussians = from_points(&cloud(positions), 10.0);
            assert!(
                gaussians.scales.iter().all(|&scale| scale == [0.01; 3]),
                "{:?}",
                gaussians.scales
            );
        }
        assert_eq!(from_points(&PointCloud::default(), 10.0).len(), 0);
    }
}
