//! Unit of Gaussians' sizes.
//!
//! The limits of 3DGS are shares of one length, the extent of the cameras. Cameras of a video may stand close
//! together in a scene many times as large, or travel far past near objects. There, sizes are relative to the
//! distance from the nearest camera, which determines the size of a Gaussian in an image.

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

/// Bounds of the least distance, which is that of neighbouring cameras (the cameras' radius is 1).
const LEAST_DISTANCE: [f32; 2] = [0.01, 1.0];

/// Unit of length, per Gaussian.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Sizes {
    /// Distance from the nearest of the centres, at least `least`.
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

    /// Returns true if the largest axis of a Gaussian is at most `limit` units; false for NaN.
    pub(super) fn is_at_most(&self, table: &ParameterTable, index: usize, limit: f32) -> bool {
        let [a, b, c] = row::<3>(table, LOG_SCALES, index);
        let largest = a.max(b).max(c).exp();
        match self {
            Self::Length(length) => largest / length <= limit,
            // Most Gaussians are within the limit at any distance: their distance need not be computed.
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

/// Returns the median distance of neighbouring centres; 0 for fewer than two.
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
        // Five, three and half a unit off the path.
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
        // Between two cameras one unit apart, any distance counts as one unit.
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
