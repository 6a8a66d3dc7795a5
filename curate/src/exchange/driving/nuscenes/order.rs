//! Order of the samples of a scene.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::store::StoreError;

use super::tables::{Sample, SceneRow, read};
use crate::error::CurateError;

/// Returns the samples of a scene by their tokens: their numbers in order, and their times.
///
/// # Errors
/// When a sample is missing or twice in the order, or times do not rise.
pub(super) fn samples_of(
    tables: &Path,
    scene: &SceneRow,
) -> Result<BTreeMap<String, (u64, i64)>, CurateError> {
    let rows: Vec<Sample> = read(tables, "sample", |row: &Sample| {
        row.scene_token == scene.token
    })?;
    ordered(&rows, &scene.first_sample_token).map_err(|reason| {
        StoreError::malformed(
            &tables.join("sample.json"),
            format!("{}: {reason}", scene.name),
        )
        .into()
    })
}

/// Follows the order of samples from the first on.
fn ordered(rows: &[Sample], first: &str) -> Result<BTreeMap<String, (u64, i64)>, String> {
    let by_token: BTreeMap<&str, &Sample> =
        rows.iter().map(|row| (row.token.as_str(), row)).collect();
    let mut found: BTreeMap<String, (u64, i64)> = BTreeMap::new();
    let (mut next, mut last) = (first, None::<i64>);
    for number in 0_u64.. {
        if next.is_empty() && number > 0 {
            break;
        }
        let row = by_token
            .get(next)
            .ok_or_else(|| format!("must hold the sample {next:?}, got none"))?;
        if let Some(last) = last.filter(|last| *last >= row.timestamp) {
            return Err(format!(
                "times of samples must rise, got {} after {last} at sample {number}",
                row.timestamp
            ));
        }
        found.insert(row.token.clone(), (number, row.timestamp));
        (next, last) = (row.next.as_str(), Some(row.timestamp));
    }
    match rows.len().checked_sub(found.len()) {
        Some(0) => Ok(found),
        _ => Err(format!(
            "must hold samples in one order, got {} of {} in it",
            found.len(),
            rows.len()
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(token: &str, timestamp: i64, next: &str) -> Sample {
        Sample {
            token: token.to_owned(),
            timestamp,
            next: next.to_owned(),
            scene_token: "s".to_owned(),
        }
    }

    #[test]
    fn samples_follow_their_order_and_times_rise() {
        let rows = [
            sample("b", 20, "c"),
            sample("a", 10, "b"),
            sample("c", 30, ""),
        ];
        let found = ordered(&rows, "a");
        let expected = [("a", (0, 10)), ("b", (1, 20)), ("c", (2, 30))];
        let expected = expected.map(|(token, sample)| (token.to_owned(), sample));
        assert_eq!(found, Ok(BTreeMap::from(expected)));
        let circle = [sample("a", 10, "b"), sample("b", 20, "a")];
        let unsorted = [sample("a", 10, "b"), sample("b", 10, "")];
        let apart = [sample("a", 10, ""), sample("b", 20, "")];
        let missing = [sample("a", 10, "b")];
        for (rows, told) in [
            (&circle[..], "got 10 after 20"),
            (&unsorted[..], "got 10 after 10"),
            (&apart[..], "got 1 of 2"),
            (&missing[..], "\"b\""),
        ] {
            let found = ordered(rows, "a");
            assert!(
                found.as_ref().is_err_and(|line| line.contains(told)),
                "{found:?}"
            );
        }
        assert!(ordered(&rows, "").is_err());
    }
}
