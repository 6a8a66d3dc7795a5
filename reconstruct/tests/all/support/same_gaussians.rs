//! Comparison of the Gaussians of two models.

use std::collections::HashMap;

use omnilife_engine::{gaussians::static_gaussians::OPACITY_LOGITS, model::Part};

/// A row of all arrays, values before moments, as bits.
type Row = Vec<u32>;

/// Groups rows of a part by the bits that densification does not change and that no two Gaussians share;
/// copies are kept apart.
fn families(part: &Part) -> HashMap<(Row, bool), Vec<Vec<f32>>> {
    let colour = part.table.position("sh_constant").unwrap();
    let mut families: HashMap<_, Vec<Vec<f32>>> = HashMap::new();
    for row in 0..part.table.len() {
        let id: Row = (part.table.row(colour, row).iter())
            .map(|value| value.to_bits())
            .collect();
        let moments = &part.table.arrays[OPACITY_LOGITS].first_moments;
        let is_copy = moments[row] == 0.0;
        let values = part.table.arrays.iter().flat_map(|array| {
            let at = row * array.width..(row + 1) * array.width;
            let moments = [&array.first_moments, &array.second_moments];
            // Frozen arrays have none.
            let moments =
                moments.map(|moments| moments.get(at.clone()).unwrap_or_default().to_vec());
            let moments = moments.into_iter().flatten();
            array.values[at].iter().copied().chain(moments)
        });
        families
            .entry((id, is_copy))
            .or_default()
            .push(values.collect());
    }
    for rows in families.values_mut() {
        rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    }
    families
}

/// Asserts that both have the same bits, except for the positions and times of children, which are sums of
/// exponentials.
pub(crate) fn assert_same_gaussians(what: &str, found: &Part, expected: &Part) {
    assert_eq!(found.table.len(), expected.table.len(), "{what}");
    assert_eq!(found.statistics, expected.statistics, "{what}");
    let (found_rows, expected_rows) = (families(found), families(expected));
    assert_eq!(found_rows.len(), expected_rows.len(), "{what}");
    for (family, expected) in &expected_rows {
        let found = found_rows.get(family).unwrap_or_else(|| {
            panic!("{what}: {family:?} is missing");
        });
        assert_eq!(found.len(), expected.len(), "{what}: {family:?}");
        for (found, expected) in found.iter().zip(expected) {
            for (at, (found, expected)) in found.iter().zip(expected).enumerate() {
                let near = family.1 && (found - expected).abs() <= 3e-5 * expected.abs().max(1.0);
                assert!(
                    found.to_bits() == expected.to_bits() || near,
                    "{what}: value {at} of {family:?}: {found} {expected}"
                );
            }
        }
    }
    assert_same_order(what, found, expected);
}

/// Asserts the same order on the sphere. Angles differ in their last bits, so that a few Gaussians may be in
/// the next cell.
fn assert_same_order(what: &str, found: &Part, expected: &Part) {
    let colours = |part: &Part| -> Vec<Row> {
        let colour = part.table.position("sh_constant").unwrap();
        let bits = |row| {
            part.table
                .row(colour, row)
                .iter()
                .map(|value| value.to_bits())
        };
        (0..part.table.len())
            .map(|row| bits(row).collect())
            .collect()
    };
    let (found, expected) = (colours(found), colours(expected));
    let apart = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
    assert!(
        apart <= found.len() / 50,
        "{what}: {apart} of {} are elsewhere",
        found.len()
    );
}
