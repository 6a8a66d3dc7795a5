//! Fusion: one point for every small cube of space on which views agree.

use std::collections::HashMap;

use glam::{DVec3, I64Vec3};
use omnilife_schemas::points::PointCloud;

#[derive(Debug)]
pub(super) struct Cubes {
    edge: f64,
    cubes: HashMap<I64Vec3, Sum>,
}

#[derive(Debug, Default)]
struct Sum {
    position: DVec3,
    colour: DVec3,
    count: f64,
}

impl Cubes {
    /// Creates an empty set of cubes of this edge in world units.
    pub(super) fn new(edge: f64) -> Self {
        Self {
            edge,
            cubes: HashMap::new(),
        }
    }

    pub(super) fn edge(&self) -> f64 {
        self.edge
    }

    /// Adds a point with its colour, channels in [0, 1].
    pub(super) fn add(&mut self, point: DVec3, colour: [f32; 3]) {
        let key = (point / self.edge).floor().as_i64vec3();
        let sum = self.cubes.entry(key).or_default();
        sum.position += point;
        sum.colour += glam::Vec3::from_array(colour).as_dvec3();
        sum.count += 1.0;
    }

    /// Merges cubes until there are at most `most`: two along every axis become one. Those around the origin stay
    /// eight.
    pub(super) fn joined(mut self, most: usize) -> Self {
        while self.cubes.len() > most.max(8) {
            let mut wider = Self::new(2.0 * self.edge);
            // In order of place: sums are then the same every time.
            for key in self.keys() {
                let sum = &self.cubes[&key];
                let all = wider.cubes.entry(key.map(|one| one >> 1)).or_default();
                all.position += sum.position;
                all.colour += sum.colour;
                all.count += sum.count;
            }
            self = wider;
        }
        self
    }

    /// Returns the mean of every cube, in order of place.
    pub(super) fn cloud(&self) -> PointCloud {
        let mut cloud = PointCloud::default();
        for key in self.keys() {
            let sum = &self.cubes[&key];
            let colour = (255.0 * sum.colour / sum.count).round();
            let mean = sum.position / sum.count;
            cloud.positions.push(mean.to_array());
            cloud
                .colours
                .push(colour.to_array().map(|value| value as u8));
        }
        cloud
    }

    /// Returns the occupied cubes, in order.
    fn keys(&self) -> Vec<I64Vec3> {
        let mut keys: Vec<I64Vec3> = self.cubes.keys().copied().collect();
        keys.sort_unstable_by_key(I64Vec3::to_array);
        keys
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec3;

    use super::*;

    #[test]
    fn a_cube_has_the_mean_of_its_points() {
        let mut cubes = Cubes::new(1.0);
        cubes.add(dvec3(0.2, 0.2, 0.2), [1.0, 0.0, 0.0]);
        cubes.add(dvec3(0.4, 0.6, 0.2), [0.0, 0.0, 1.0]);
        cubes.add(dvec3(-0.5, 0.0, 0.0), [0.2; 3]);
        let cloud = cubes.cloud();
        let expected = [dvec3(-0.5, 0.0, 0.0), dvec3(0.3, 0.4, 0.2)];
        assert_eq!(cloud.len(), expected.len());
        for (found, expected) in cloud.positions.iter().zip(expected) {
            let error = DVec3::from_array(*found).distance(expected);
            assert!(error < 1e-12, "{found:?} {expected}");
        }
        assert_eq!(cloud.colours, [[51; 3], [128, 0, 128]]);
    }

    #[test]
    fn far_from_the_origin_cubes_are_as_small_as_near_it() {
        let places = [dvec3(0.011, -0.017, 0.004), dvec3(0.016, -0.012, 0.009)];
        for offset in [DVec3::ZERO, dvec3(4_200_000.0, 170_000.0, -4_780_000.0)] {
            let mut cubes = Cubes::new(0.001);
            for place in places {
                cubes.add(offset + place, [0.5; 3]);
            }
            let cloud = cubes.cloud();
            assert_eq!(cloud.len(), 2, "{offset}");
            for (found, place) in cloud.positions.iter().zip(places) {
                let error = DVec3::from_array(*found).distance(offset + place);
                assert!(error < 1e-8, "{offset}: {found:?}");
            }
        }
    }

    #[test]
    fn cubes_are_joined_until_they_are_few_enough() {
        let mut cubes = Cubes::new(0.5);
        for n in 0..4000 {
            let axis = |step: i32| f64::from(n / step % 16 - 8) + 0.2;
            cubes.add(dvec3(axis(1), axis(16), axis(256)), [0.5; 3]);
        }
        let joined = cubes.joined(100);
        assert_eq!((joined.edge(), joined.cubes.len()), (4.0, 64));
        // Those around the origin never become one.
        let last = joined.joined(1);
        assert_eq!(last.cubes.len(), 8);
        let mean: DVec3 = last.cubes.values().map(|sum| sum.position / 4000.0).sum();
        assert!(mean.length() < 1.0, "{mean}");
    }
}
