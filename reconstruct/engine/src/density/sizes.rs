//! What Gaussians' sizes are compared with.
//!
//! The limits of 3DGS are shares of one length, the extent of the cameras. Cameras of a video stand close
//! together in a scene many times as large, or go a long way past things that are near: there sizes are compared
//! with the distance from the nearest camera, which is what says how large a Gaussian is in an image.

use glam::Vec3;
use omnilife_schemas::statistics;

use super::{
    row,
    settings::{DensifySettings, SizeUnit},
};
use crate::{
    gaussians::static_gaussians::{LOG_SCALES, POSITIONS},
    parameters::ParameterTable,
    training_view::TrainingView,
};

/// The least distance is that of neighbouring cameras, within these bounds (the cameras' radius is 1).
const LEAST_DISTANCE: [f32; 2] = [0.01, 1.0];

/// A unit of length, for each Gaussian its own.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Sizes {
    /// The distance from the nearest of the centres, `least` at least.
    Distance { centres: Vec<Vec3>, least: f32 },
    /// One length.
    Length(f32),
}

impl Sizes {
    pub(super) fn new(settings: &DensifySettings, views: &[TrainingView]) -> Self {
        match settings.size_unit {
            SizeUnit::Length(length) => Self::Length(length),
            SizeUnit::Distance => {
                let centres: Vec<Vec3> = views.iter().map(|view| view.view.centre).collect();
                let least = median_step(&centres).clamp(LEAST_DISTANCE[0], LEAST_DISTANCE[1]);
                Self::Distance { centres, least }
            }
        }
    }

    /// Whether the largest axis of a Gaussian is so many units at most; false for one that is not a number.
    pub(super) fn is_at_most(&self, table: &ParameterTable, index: usize, limit: f32) -> bool {
        let [a, b, c] = row::<3>(table, LOG_SCALES, index);
        let largest = a.max(b).max(c).exp();
        match self {
            Self::Length(length) => largest / length <= limit,
            // Most are small enough wherever they are: their distances are not asked for.
            Self::Distance { centres, least } => {
                largest <= limit * least || {
                    let position = Vec3::from_array(row(table, POSITIONS, index));
                    largest <= limit * nearest(centres, position)
                }
            }
        }
    }
}

fn nearest(centres: &[Vec3], position: Vec3) -> f32 {
    let squared = centres
        .iter()
        .map(|centre| centre.distance_squared(position));
    // NaN positions stay NaN.
    squared.fold(f32::NAN, f32::min).sqrt()
}

/// The median distance of neighbouring centres; 0 of fewer than two.
fn median_step(centres: &[Vec3]) -> f32 {
    let steps: Vec<f32> = centres
        .windows(2)
        .map(|pair| pair[0].distance(pair[1]))
        .collect();
    statistics::median(&steps).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::{super::tests::settings, *};
    use crate::{
        gaussians::static_gaussians::{self, InitialGaussians},
        training_view::TrainingView,
    };

    /// Cameras along a line, ten units long.
    fn along_a_line() -> Vec<TrainingView> {
        let [view, _] = super::super::tests::views();
        let at = |step: u8| {
            let mut view = view.clone();
            view.view.centre = Vec3::new(f32::from(step) - 5.0, 0.0, 0.0);
            view
        };
        (0..=10).map(at).collect()
    }

    #[test]
    fn a_long_path_compares_with_the_nearest_camera() {
        let sizes = Sizes::new(&settings(), &along_a_line());
        // As far from the mean camera, and three units and half a unit beside the path.
        let places = vec![[0.0, 0.0, 5.0], [4.0, 0.0, 3.0], [5.0, 0.5, 0.0]];
        let colours = vec![[0.5; 3]; 3];
        let table = |size: f32| {
            let sizes = [size; 3];
            let initial =
                InitialGaussians::isotropic(places.clone(), &sizes, colours.clone(), vec![0.5; 3]);
            static_gaussians::table(&initial, 0)
        };
        let small = |size: f32| {
            let table = table(size);
            [0, 1, 2].map(|index| sizes.is_at_most(&table, index, 0.1))
        };
        assert_eq!(small(0.4), [true, false, false]);
        assert_eq!(small(0.2), [true, true, false]);
        // Between two cameras, which are one unit apart, distances count as that.
        assert_eq!(small(0.09), [true; 3]);
    }

    #[test]
    fn what_is_no_number_is_never_small() {
        let sizes = Sizes::new(&settings(), &along_a_line());
        let initial =
            InitialGaussians::isotropic(vec![[0.0; 3]], &[f32::NAN], vec![[0.5; 3]], vec![0.5]);
        assert!(!sizes.is_at_most(&static_gaussians::table(&initial, 0), 0, 1.0));
        let initial =
            InitialGaussians::isotropic(vec![[f32::NAN; 3]], &[3.0], vec![[0.5; 3]], vec![0.5]);
        assert!(!sizes.is_at_most(&static_gaussians::table(&initial, 0), 0, 1.0));
    }

    #[test]
    fn cameras_that_stand_still_have_a_least_distance() {
        let [view, _] = super::super::tests::views();
        let Sizes::Distance { least, .. } = Sizes::new(&settings(), &[view.clone(), view]) else {
            panic!("a length");
        };
        assert_eq!(least, LEAST_DISTANCE[0]);
    }
}
