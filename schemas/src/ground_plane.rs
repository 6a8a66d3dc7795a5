//! Planes through points, and their intersections with rays.

use glam::DVec3;

use crate::{statistics, trajectory::GroundAxes};

/// Number of draws of a plane through three points.
const DRAWS: usize = 200;

/// Plane of the points `p` with `normal . p = offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Unit normal, which points up.
    pub normal: DVec3,
    /// Distance of the world's origin along it.
    pub offset: f64,
}

impl Plane {
    /// Returns the height of a point above it.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }

    /// Moves it along its normal.
    #[must_use]
    pub fn raised(self, by: f64) -> Self {
        Self {
            offset: self.offset + by,
            ..self
        }
    }

    /// Returns the distance at which a ray meets it; `None` if the ray is parallel or leads away.
    pub fn meet(&self, centre: DVec3, ray: DVec3) -> Option<f64> {
        let slope = self.normal.dot(ray);
        let distance = -self.height(centre) / slope;
        (slope.abs() > 1e-3 && distance.is_finite() && distance > 0.0).then_some(distance)
    }

    /// Fits a plane through three points.
    fn through([a, b, c]: [DVec3; 3]) -> Option<Self> {
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some(Self {
            normal,
            offset: normal.dot(a),
        })
    }

    /// Fits a plane through some points by least squares about their mean.
    fn least_squares(points: &[DVec3], up: DVec3) -> Option<Self> {
        let middle = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
        let axes = GroundAxes::new(up).to_world;
        // Height over the two coordinates along the plane.
        let (mut xx, mut xy, mut yy, mut xz, mut yz) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for point in points {
            let own = axes.transpose() * (*point - middle);
            xx += own.x * own.x;
            xy += own.x * own.y;
            yy += own.y * own.y;
            xz += own.x * own.z;
            yz += own.y * own.z;
        }
        let determinant = xx * yy - xy * xy;
        if determinant <= 1e-9 * (xx + yy).powi(2) {
            return None;
        }
        let slope_x = (xz * yy - yz * xy) / determinant;
        let slope_y = (yz * xx - xz * xy) / determinant;
        let normal = (axes * DVec3::new(-slope_x, -slope_y, 1.0)).normalize();
        Some(Self {
            normal,
            offset: normal.dot(middle),
        })
    }

    /// Returns the plane with most points within `reach`, and their number. It is at most 30 degrees from `up`, if
    /// that is known.
    pub fn of_most(points: &[DVec3], reach: f64, up: Option<DVec3>) -> Option<(Self, usize)> {
        if points.len() < 3 {
            return None;
        }
        let mut state = 0x9e37_79b9_u64;
        let mut draw = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            points[(state >> 33) as usize % points.len()]
        };
        let mut best: Option<(Self, usize)> = None;
        for _ in 0..DRAWS {
            let Some(mut plane) = Self::through([draw(), draw(), draw()]) else {
                continue;
            };
            if let Some(up) = up {
                if plane.normal.dot(up) < 0.0 {
                    plane = Self {
                        normal: -plane.normal,
                        offset: -plane.offset,
                    };
                }
                if plane.normal.dot(up) < 0.866 {
                    continue;
                }
            }
            let inside = points
                .iter()
                .filter(|&&point| plane.height(point).abs() <= reach)
                .count();
            if best.is_none_or(|(_, most)| inside > most) {
                best = Some((plane, inside));
            }
        }
        let (plane, _) = best?;
        let inside: Vec<DVec3> = points
            .iter()
            .copied()
            .filter(|&point| plane.height(point).abs() <= reach)
            .collect();
        let refined = Self::least_squares(&inside, plane.normal).unwrap_or(plane);
        Some((refined, inside.len()))
    }

    /// Returns the ground of a scene: the plane of most of its points, its normal towards the centres of the cameras,
    /// and the share of points on it.
    pub fn dominant(points: &[DVec3], centres: &[DVec3]) -> Option<(Self, f64)> {
        let middle = centres.iter().sum::<DVec3>() / centres.len().max(1) as f64;
        let distances: Vec<f64> = points.iter().map(|point| point.distance(middle)).collect();
        let reach = 0.02 * statistics::median(&distances)?;
        // Evenly spaced, so that draws cover all points.
        let some: Vec<DVec3> = points
            .iter()
            .copied()
            .step_by((points.len() / 5000).max(1))
            .collect();
        let (plane, inside) = Self::of_most(&some, reach, None)?;
        let upward = if plane.height(middle) < 0.0 {
            Self {
                normal: -plane.normal,
                offset: -plane.offset,
            }
        } else {
            plane
        };
        Some((upward, inside as f64 / some.len() as f64))
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec3;

    use super::*;

    /// Returns a tilted road under houses whose roofs are a third of all points.
    fn points() -> Vec<DVec3> {
        (0..3000)
            .map(|n| {
                let (x, y) = (f64::from(n % 60) - 30.0, f64::from(n / 60) - 25.0);
                let roof = if n % 3 == 0 {
                    6.0 + f64::from(n % 7)
                } else {
                    0.0
                };
                dvec3(x, y, 0.05 * x + roof)
            })
            .collect()
    }

    #[test]
    fn the_ground_is_the_plane_of_most_points_and_points_up() {
        let (plane, share) = Plane::dominant(&points(), &[dvec3(0.0, 0.0, 40.0)]).expect("a plane");
        let expected = dvec3(-0.05, 0.0, 1.0).normalize();
        assert!(plane.normal.angle_between(expected) < 0.005, "{plane:?}");
        assert!(plane.height(DVec3::ZERO).abs() < 0.05);
        assert!((share - 2.0 / 3.0).abs() < 0.05, "{share}");
    }

    #[test]
    fn rays_meet_raised_planes_where_geometry_says() {
        let plane = Plane {
            normal: DVec3::Z,
            offset: 1.0,
        }
        .raised(0.75);
        let distance = plane.meet(dvec3(0.0, 0.0, 51.75), dvec3(0.6, 0.0, -0.8));
        assert!(distance.is_some_and(|distance| (distance - 62.5).abs() < 1e-9));
        assert_eq!(plane.meet(dvec3(0.0, 0.0, 50.0), DVec3::X), None);
        assert_eq!(plane.meet(dvec3(0.0, 0.0, 50.0), DVec3::Z), None);
    }

    #[test]
    fn no_plane_goes_through_points_in_a_line() {
        let line: Vec<DVec3> = (0..50).map(|n| DVec3::X * f64::from(n)).collect();
        assert_eq!(Plane::of_most(&line, 0.1, Some(DVec3::Z)), None);
        assert_eq!(Plane::of_most(&line[..2], 0.1, None), None);
    }
}
