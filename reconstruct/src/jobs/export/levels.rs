//! Levels of detail: number, choice and size of Gaussians.

use std::borrow::Cow;

use omnilife_engine::gaussians::{ActivatedGaussians, subset};
use omnilife_schemas::points::PointCloud;

use omnilife_training::{
    formats::splat::SplatRow,
    seeds::points::{selected, thinned_indices},
};

/// Maximum growth of the Gaussians of a level.
const LARGEST_GROWTH: f64 = 4.0;

/// A requested level.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Level {
    /// Its name in the request, such as `1M` or `full`.
    pub name: String,
    /// Gaussians at most; `None` for all.
    pub most: Option<u64>,
}

impl Level {
    /// Reads `full`, a number, or one with `k` or `M`.
    ///
    /// # Errors
    /// When the text has another form, or is 0.
    pub fn parse(text: &str) -> Result<Self, String> {
        let refuse =
            || format!("a level must be full, or a number such as 1M or 500k, got {text:?}");
        let name = text.trim().to_owned();
        if name == "full" {
            return Ok(Self { name, most: None });
        }
        let (digits, factor) = match name.strip_suffix(['M', 'm']) {
            Some(digits) => (digits, 1_000_000),
            None => match name.strip_suffix(['k', 'K']) {
                Some(digits) => (digits, 1_000),
                None => (name.as_str(), 1),
            },
        };
        let number: u64 = digits.parse().map_err(|_| refuse())?;
        let most = number.checked_mul(factor).filter(|&most| most > 0);
        Ok(Self {
            most: Some(most.ok_or_else(refuse)?),
            name,
        })
    }

    /// Returns the name of its file in a format with this ending of names.
    pub fn file(&self, ending: &str) -> String {
        format!("{}{ending}", self.name.to_ascii_lowercase())
    }
}

/// The Gaussians of a level, and their growth for being fewer.
#[derive(Debug)]
pub(super) struct LevelRows<'a> {
    pub(super) rows: Cow<'a, [SplatRow]>,
    pub(super) growth: f64,
}

/// Gaussians of a level among all of them.
#[derive(Debug)]
pub(super) struct Selection {
    /// `None` for all of them.
    indices: Option<Vec<usize>>,
    /// Factor of their sizes, for being fewer.
    pub(super) growth: f64,
}

impl Selection {
    /// Returns the level's rows.
    fn rows(self, all: &[SplatRow]) -> LevelRows<'_> {
        let growth = self.growth;
        let grown = |&index: &usize| SplatRow {
            scale: all[index].scale.map(|scale| scale * growth as f32),
            ..all[index]
        };
        LevelRows {
            rows: match self.indices {
                Some(indices) => indices.iter().map(grown).collect(),
                None => Cow::Borrowed(all),
            },
            growth,
        }
    }

    /// Returns the level's Gaussians with all that belongs to them.
    pub(super) fn gaussians<'a>(&self, all: &'a ActivatedGaussians) -> Cow<'a, ActivatedGaussians> {
        let Some(indices) = &self.indices else {
            return Cow::Borrowed(all);
        };
        let mut level = ActivatedGaussians::default();
        subset::gather(all, indices, &mut level);
        for scale in level.scales.as_flattened_mut() {
            *scale *= self.growth as f32;
        }
        Cow::Owned(level)
    }
}

/// Returns the rows of levels with these numbers of Gaussians, as [`selections`] chooses them.
pub(super) fn nested<'a>(rows: &'a [SplatRow], counts: &[u64]) -> Vec<LevelRows<'a>> {
    let positions = rows.iter().map(|row| row.position).collect();
    let chosen = selections(positions, counts).into_iter();
    chosen.map(|selection| selection.rows(rows)).collect()
}

/// Returns levels with these numbers of Gaussians, which fall from one to the next. They are evenly spread along a
/// curve through space, each level among those of the one before it. Sizes grow by the root of the thinning:
/// coverage stays.
pub(super) fn selections(positions: Vec<[f32; 3]>, counts: &[u64]) -> Vec<Selection> {
    let all = positions.len();
    let everything = || Selection {
        indices: None,
        growth: 1.0,
    };
    let thinned = counts.iter().filter(|&&count| count < all as u64);
    let mut levels: Vec<Selection> = (thinned.clone().count()..counts.len())
        .map(|_| everything())
        .collect();
    if levels.len() == counts.len() {
        return levels;
    }
    let mut indices: Vec<usize> = (0..all).collect();
    let mut points = PointCloud::of_colour(positions, [0; 3]);
    levels.extend(thinned.map(|&count| {
        let kept = thinned_indices(&points, count as usize);
        points = selected(&points, &kept);
        indices = kept.iter().map(|&at| indices[at]).collect();
        Selection {
            growth: (all as f64 / indices.len().max(1) as f64)
                .sqrt()
                .min(LARGEST_GROWTH),
            indices: Some(indices.clone()),
        }
    }));
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_read() {
        let most = |text: &str| Level::parse(text).map(|level| level.most);
        assert_eq!(most("full"), Ok(None));
        assert_eq!(most("1M"), Ok(Some(1_000_000)));
        assert_eq!(most("500k"), Ok(Some(500_000)));
        assert_eq!(most("12"), Ok(Some(12)));
        for bad in ["", "0", "-1", "1.5M", "M", "all", "99999999999999M", "../x"] {
            let message = most(bad).expect_err("refused");
            assert!(message.contains("a level must be full"), "{message}");
        }
    }

    #[test]
    fn smaller_levels_are_part_of_larger_ones_and_cover_as_much() {
        let row = |index: usize| SplatRow {
            position: [index as f32 % 37.0, (index / 37) as f32, 1.0],
            scale: [0.5; 3],
            rgba: [1; 4],
            rotation: [1.0, 0.0, 0.0, 0.0],
        };
        let rows: Vec<SplatRow> = (0..1_000).map(row).collect();
        let levels = nested(&rows, &[1_000, 250, 10]);
        let places = |level: usize| -> Vec<[u32; 2]> {
            let rows = levels[level].rows.iter();
            rows.map(|row| [row.position[0] as u32, row.position[1] as u32])
                .collect()
        };
        assert_eq!(
            [0, 1, 2].map(|level| levels[level].rows.len()),
            [1_000, 250, 10]
        );
        assert!(places(2).iter().all(|place| places(1).contains(place)));
        assert_eq!(*levels[0].rows, *rows);
        assert_eq!((levels[1].growth, levels[1].rows[0].scale), (2.0, [1.0; 3]));
        assert_eq!(levels[2].growth, 4.0, "the most");
    }
}
