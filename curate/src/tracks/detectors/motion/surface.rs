//! The static surface in the view of a frame's pixels.

use glam::{DVec3, Vec3};

use super::transfer::Rays;
use crate::{
    ground_plane::Plane, posed_view::PosedView, tracks::detectors::depth_of_points::DistanceMap,
};

/// Radius within which the surface of a pixel is ambiguous beside edges, pixels.
const AROUND: usize = 4;
/// Largest ratio of the farthest to the nearest surface around a pixel without an edge.
const EDGE: f32 = 1.005;
/// Tolerance of the ground's place between the nearest and the farthest surface, as a factor beyond either.
const GROUND_REACH: f32 = 1.02;
/// Least slope of rays that meet the ground: the sine of the angle.
const LEAST_SLOPE: f32 = 1e-3;

/// Distances along the rays of a frame's pixels to the static surface, row by row; NaN if unknown. Beside edges the
/// surface of a pixel is ambiguous: it may be any nearby one.
pub(super) struct Surface {
    /// By the points.
    pub(super) at: Vec<f32>,
    /// The nearest and the farthest one around a pixel, only beside edges.
    pub(super) nearest: Vec<f32>,
    pub(super) farthest: Vec<f32>,
    /// The ground, beside edges if it lies between the two.
    pub(super) ground: Vec<f32>,
}

impl Surface {
    /// Computes that of a frame, by the distances of static content.
    pub(super) fn new(
        view: &PosedView,
        rays: &Rays,
        distances: &DistanceMap,
        ground: Plane,
    ) -> Self {
        let [least, most] = distances.around(AROUND);
        let unknown = || vec![f32::NAN; least.len()];
        let mut surface = Self {
            at: unknown(),
            nearest: unknown(),
            farthest: unknown(),
            ground: unknown(),
        };
        let up: DVec3 = view.to_world.transpose() * ground.normal;
        let (up, height): (Vec3, f32) = (up.as_vec3(), ground.height(view.centre) as f32);
        for (pixel, (&near, &far)) in least.iter().zip(&most).enumerate() {
            if !far.is_finite() {
                continue;
            }
            surface.at[pixel] = distances.values[pixel];
            if far <= EDGE * near {
                continue;
            }
            surface.nearest[pixel] = near;
            surface.farthest[pixel] = far;
            let slope = up.dot(rays.at(pixel));
            let on_ground = -height / slope;
            let between = near / GROUND_REACH..=far * GROUND_REACH;
            if slope.abs() > LEAST_SLOPE && between.contains(&on_ground) {
                surface.ground[pixel] = on_ground;
            }
        }
        surface
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, dvec2, dvec3};
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;

    #[test]
    fn beside_a_roof_the_surface_may_be_the_roof_or_the_ground() {
        let (width, height) = (64, 36);
        let view = PosedView {
            frame: 0,
            seconds: 0.0,
            camera: PinholeCamera::with_horizontal_field_of_view(64, 36, 0.1).into(),
            to_world: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z)
                * DMat3::from_rotation_x(0.1),
            centre: dvec3(0.0, 0.0, 40.0),
        };
        let ground = Plane {
            normal: DVec3::Z,
            offset: 0.0,
        };
        let meet = |pixel: usize, plane: Plane| {
            let centre = dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            plane
                .meet(view.centre, view.ray(centre))
                .unwrap_or(f64::NAN) as f32
        };
        // A roof in the left half, 10 m above the ground, and nothing in the last columns.
        let values = (0..width * height).map(|pixel| match pixel % width {
            0..32 => meet(pixel, ground.raised(10.0)),
            32..50 => meet(pixel, ground),
            _ => f32::INFINITY,
        });
        let distances = DistanceMap {
            width,
            height,
            values: values.collect(),
        };
        let surface = Surface::new(&view, &Rays::of(&view.camera), &distances, ground);
        let row = 18 * width;
        // On the roof and on the road alone there is no edge.
        for column in [20, 40] {
            assert_eq!(surface.at[row + column], distances.values[row + column]);
            assert!(surface.nearest[row + column].is_nan(), "{column}");
            assert!(surface.ground[row + column].is_nan(), "{column}");
        }
        // Beside the edge of the roof.
        for column in [29, 34] {
            let pixel = row + column;
            assert!(surface.nearest[pixel] < 31.0 && surface.farthest[pixel] > 39.0);
            assert!((surface.ground[pixel] - meet(pixel, ground)).abs() < 1e-3);
        }
        // A pixel without known neighbours is unknown.
        assert!(surface.at[row + 47].is_nan() && surface.at[row + 60].is_nan());
    }
}
