//! Order of Gaussians in memory: neighbours in the image are neighbours in the table, so that the rows that a
//! tile reads and the gradients that it sums lie together.
//!
//! Images do not depend on the order, except for Gaussians at exactly the same distance.

use std::f32::consts::PI;

use glam::Vec3;

use crate::training_view::TrainingView;
use crate::{gaussians::static_gaussians::POSITIONS, model::Model, parameters::ParameterTable};

/// Sorts the Gaussians of all parts along a Z-order curve over the sphere around the mean of the input views'
/// centres. Statistics are not moved: call this only where they are reset.
pub fn along_sphere(model: &mut Model, views: &[TrainingView]) {
    let centre = centre(views);
    for part in &mut model.parts {
        sort(&mut part.table, centre);
    }
}

/// Returns the centre of the sphere: the mean of the views' centres.
pub(super) fn centre(views: &[TrainingView]) -> Vec3 {
    let sum: Vec3 = views.iter().map(|view| view.view.centre).sum();
    sum / views.len().max(1) as f32
}

fn sort(table: &mut ParameterTable, centre: Vec3) {
    let positions = table.arrays[POSITIONS].values.as_chunks::<3>().0;
    let keys: Vec<u32> = positions
        .iter()
        .map(|&position| z_order(Vec3::from_array(position) - centre))
        .collect();
    let mut order: Vec<usize> = (0..keys.len()).collect();
    // Stable sort: the same order on every machine.
    order.sort_by_key(|&index| keys[index]);
    table.permute(&order);
}

/// Returns the position of a direction, of any length, on a Z-order curve over longitude and latitude.
fn z_order(direction: Vec3) -> u32 {
    let across = direction.x.atan2(direction.z) / (2.0 * PI) + 0.5;
    let down = direction.y.atan2(direction.x.hypot(direction.z)) / PI + 0.5;
    let [across, down] = [across, down].map(|share| spread((share * 65535.0) as u16));
    across | down << 1
}

/// Spreads the bits of a number to the even positions.
fn spread(bits: u16) -> u32 {
    let mut spread = u32::from(bits);
    for (shift, mask) in [
        (8, 0x00ff_00ff),
        (4, 0x0f0f_0f0f),
        (2, 0x3333_3333),
        (1, 0x5555_5555),
    ] {
        spread = (spread | spread << shift) & mask;
    }
    spread
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        density::tests::views,
        gaussians::static_gaussians::{self, InitialGaussians, LOG_SCALES},
    };

    #[test]
    fn bits_are_spread() {
        assert_eq!(spread(0b1011), 0b100_0101);
        assert_eq!(spread(u16::MAX), 0x5555_5555);
    }

    #[test]
    fn neighbours_on_the_sphere_come_together_and_rows_stay_whole() {
        let directions = [[1.0, 0.1, 1.0], [-1.0, 0.1, -1.0]];
        let positions: Vec<[f32; 3]> = (0..6)
            .map(|index| directions[index % 2].map(|value: f32| value * (1.0 + index as f32)))
            .collect();
        let mut model = Model::of_static(static_gaussians::table(
            &InitialGaussians {
                scales: (1..=6).map(|scale| [scale as f32; 3]).collect(),
                rotations: vec![static_gaussians::NO_ROTATION; 6],
                colours: vec![[0.5; 3]; 6],
                opacities: vec![0.5; 6],
                positions: positions.clone(),
            },
            0,
        ));
        let table = &mut model.parts[0].table;
        let first_moments = table.arrays[LOG_SCALES].values.clone();
        table.arrays[LOG_SCALES].first_moments = first_moments;
        along_sphere(&mut model, &views());
        let table = &model.parts[0].table;
        let order: Vec<usize> = (0..6)
            .map(|row| table.row(LOG_SCALES, row)[0].exp().round() as usize - 1)
            .collect();
        assert_eq!(order, [1, 3, 5, 0, 2, 4]);
        for (row, &index) in order.iter().enumerate() {
            assert_eq!(table.row(POSITIONS, row), positions[index]);
        }
        let scales = &table.arrays[LOG_SCALES];
        assert_eq!(scales.values, scales.first_moments);
    }

    #[test]
    fn poles_and_what_is_no_direction_have_a_place() {
        // The nadir comes after every direction of the upper half, the zenith before any of the lower.
        assert!(z_order(Vec3::NEG_Y) < z_order(Vec3::new(1.0, 0.1, 1.0)));
        assert!(z_order(Vec3::Y) > z_order(Vec3::new(-1.0, -0.1, -1.0)));
        assert_eq!(z_order(Vec3::ZERO), z_order(Vec3::Z));
        // A NaN casts to 0: the first cell of all.
        assert_eq!(z_order(Vec3::NAN), 0);
    }
}
