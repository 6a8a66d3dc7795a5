//! Hash grids against golden values, finite differences and sums in f64.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{HashGrid, HashGridShape, UpperEdge, levels::FEATURES};
use crate::golden_tests::{golden, numbers, wave};

fn published(dimensions: usize, levels: usize, log2_entries: u32) -> HashGrid {
    HashGrid::new(HashGridShape {
        upper_edge: UpperEdge::Aliased,
        ..HashGridShape::new(dimensions, levels, log2_entries)
    })
}

#[test]
fn levels_are_those_published() {
    for grid in golden()["grids"].as_array().expect("grids") {
        let whole = |name: &str| grid[name].as_u64().expect("whole") as usize;
        let found = published(
            whole("dimensions"),
            whole("levels"),
            whole("log2_entries") as u32,
        );
        assert_eq!(found.parameter_count(), whole("parameters"));
        let resolutions: Vec<f64> = found.levels.iter().map(|l| l.resolution.into()).collect();
        assert_eq!(resolutions, numbers(&grid["resolutions"]));
        let hashed = found.levels.iter().position(|level| level.is_hashed);
        assert_eq!(hashed, Some(whole("first_hashed")));
    }
}

#[test]
fn corners_are_those_published() {
    let grid = published(2, 16, 17);
    for case in golden()["corners"].as_array().expect("cases") {
        let number = case["level"].as_u64().expect("level") as usize;
        let level = &grid.levels[number];
        // A table that is 1 at one entry and 0 elsewhere reads that entry's weight.
        for corner in case["corners"].as_array().expect("corners") {
            let [entry, weight] = numbers(corner)[..] else {
                panic!("a corner is two numbers");
            };
            let mut table = vec![0.0; grid.parameter_count()];
            table[FEATURES * (level.first_entry + entry as usize)] = 1.0;
            let mut out = vec![0.0; grid.features()];
            grid.encode(&[0.3, 0.7], &table, usize::MAX, &mut out);
            let found = f64::from(out[FEATURES * number]);
            assert!((found - weight).abs() < 4e-4, "{number}: {found} {weight}");
        }
    }
}

#[test]
fn features_and_gradients_by_position_are_golden() {
    for case in golden()["encodings"].as_array().expect("cases") {
        let position: Vec<f32> = numbers(&case["position"])
            .iter()
            .map(|&x| x as f32)
            .collect();
        let grid = published(position.len(), 4, 8);
        let table = wave(grid.parameter_count(), 0.2, 0.1);
        let mut features = vec![0.0; grid.features()];
        grid.encode(&position, &table, usize::MAX, &mut features);
        for (found, expected) in features.iter().zip(numbers(&case["features"])) {
            assert!((f64::from(*found) - expected).abs() < 1e-6);
        }
        let mut gradient = vec![0.0; position.len()];
        let upstream = wave(16, 0.9, 1.0);
        grid.backward_position(&position, &table, usize::MAX, &upstream, &mut gradient);
        for (found, expected) in gradient.iter().zip(numbers(&case["gradient"])) {
            let error = (f64::from(*found) - expected).abs();
            assert!(error < 1e-4 * (1.0 + expected.abs()), "{found} {expected}");
        }
    }
}

/// Features are linear in the table, so that finite differences of any step are exact.
#[test]
fn gradients_by_the_table_are_differences() {
    for dimensions in 2..=4 {
        let grid = HashGrid::new(HashGridShape::new(dimensions, 3, 6));
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut draw = |count: usize| -> Vec<f32> {
            (0..count).map(|_| random.random_range(0.0..1.0)).collect()
        };
        let (positions, active) = (draw(5 * dimensions), 10);
        let upstream = draw(5 * grid.features());
        let mut gradients = vec![f32::NAN; grid.parameter_count()];
        grid.backward_table(&positions, active, &upstream, &mut gradients);
        let value = |table: &[f32]| -> f64 {
            let rows = positions.chunks_exact(dimensions);
            rows.zip(upstream.chunks_exact(grid.features()))
                .map(|(position, upstream)| {
                    let mut out = vec![0.0; grid.features()];
                    grid.encode(position, table, active, &mut out);
                    let terms = out.iter().zip(upstream);
                    terms.map(|(a, b)| f64::from(a * b)).sum::<f64>()
                })
                .sum()
        };
        for (index, found) in gradients.iter().enumerate() {
            let mut table = vec![0.0; grid.parameter_count()];
            table[index] = 1.0;
            assert!((f64::from(*found) - value(&table)).abs() < 1e-5, "{index}");
        }
    }
}

#[test]
fn a_million_rows_in_one_cell_sum_as_in_f64() {
    let grid = HashGrid::new(HashGridShape::new(2, 1, 6));
    const ROWS: usize = 1_000_000;
    let positions = [0.3_f32, 0.6].repeat(ROWS);
    let upstream: Vec<f32> = (0..ROWS * FEATURES)
        .map(|at| 1e-3 + (at % 7) as f32 * 1e-4)
        .collect();
    let mut gradients = vec![0.0; grid.parameter_count()];
    grid.backward_table(&positions, usize::MAX, &upstream, &mut gradients);
    let found: f64 = gradients.iter().map(|&g| f64::from(g)).sum();
    let expected: f64 = upstream.iter().map(|&value| f64::from(value)).sum();
    assert!((found / expected - 1.0).abs() < 1e-5, "{found} {expected}");
}

#[test]
fn positions_outside_are_clamped_and_those_that_are_no_numbers_left_out() {
    let grid = HashGrid::new(HashGridShape::new(2, 4, 6));
    let table = wave(grid.parameter_count(), 0.2, 1.0);
    let features = |position: [f32; 2]| {
        let mut out = vec![f32::NAN; grid.features()];
        grid.encode(&position, &table, usize::MAX, &mut out);
        out
    };
    assert_eq!(features([-0.5, 3.0]), features([0.0, 1.0]));
    assert_eq!(features([-0.0, 1.0]), features([0.0, 1.0]));
    let upstream = vec![1.0; grid.features()];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert!(features([bad, 0.5]).iter().all(|&value| value == 0.0));
        let mut gradients = vec![1.0; grid.parameter_count()];
        grid.backward_table(&[bad, 0.5], usize::MAX, &upstream, &mut gradients);
        assert!(gradients.iter().all(|&value| value == 0.0));
        let mut gradient = [1.0; 2];
        grid.backward_position(&[bad, 0.5], &table, usize::MAX, &upstream, &mut gradient);
        assert_eq!(gradient, [0.0; 2]);
    }
    let mut gradient = [1.0; 2];
    grid.backward_position(&[-0.5, 0.5], &table, usize::MAX, &upstream, &mut gradient);
    assert!(gradient[0] == 0.0 && gradient[1] != 0.0);
}

/// With [`UpperEdge::Own`], a grid of dense levels is continuous across cell borders up to the upper edge;
/// the published one reads the next row's beginning there.
#[test]
fn an_upper_edge_of_its_own_reads_no_other_row() {
    for (edge, is_own) in [(UpperEdge::Own, true), (UpperEdge::Aliased, false)] {
        let grid = HashGrid::new(HashGridShape {
            upper_edge: edge,
            ..HashGridShape::new(2, 1, 10)
        });
        // 1 in the first column: any of it that the last column reads is aliased.
        let mut table = vec![0.0; grid.parameter_count()];
        let stride = if is_own { 5 } else { 4 };
        for row in 0..stride {
            table[FEATURES * row * stride] = 1.0;
        }
        let mut out = vec![0.0; grid.features()];
        grid.encode(&[1.0, 0.4], &table, usize::MAX, &mut out);
        assert_eq!(out[0] == 0.0, is_own, "{edge:?}: {}", out[0]);
    }
}
