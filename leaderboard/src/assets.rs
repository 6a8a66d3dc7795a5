//! Assets of `reconstruct export`, with the scores of their levels.
//!
//! An asset lies in the folder of its `asset.json`. The scores of a level are the `result.json` of `scores/<LEVEL>/`
//! beside it: `reconstruct render ASSET/LEVEL.splat` and `bench score --novel-views` create them. Levels are not
//! methods: these results are in no other table.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::{LEVEL_SCORES_FOLDER, RESULT_FILE},
    records::{Asset, AssetLevel, ResultRecord},
    store::{self, StoreError},
};

pub(crate) struct FoundAsset {
    pub(crate) record: Asset,
    /// Scores of the levels, in their order, if they exist.
    pub(crate) scores: Vec<Option<ResultRecord>>,
}

impl FoundAsset {
    /// Reads an asset and the scores of its levels.
    ///
    /// # Errors
    /// When a record cannot be read.
    pub(crate) fn read(file: &Path) -> Result<Self, StoreError> {
        let record: Asset = store::read_record(file)?;
        let scores = record.levels.iter().map(|level| {
            let path = scores_file(file, level);
            path.is_file()
                .then(|| store::read_record(&path))
                .transpose()
        });
        Ok(Self {
            scores: scores.collect::<Result<_, _>>()?,
            record,
        })
    }
}

/// Returns true if a result belongs to a level of one of these assets.
pub(crate) fn is_of_level(result: &Path, assets: &[PathBuf]) -> bool {
    let folders = assets.iter().filter_map(|asset| asset.parent());
    folders
        .map(|folder| folder.join(LEVEL_SCORES_FOLDER))
        .any(|folder| result.starts_with(folder))
}

fn scores_file(asset: &Path, level: &AssetLevel) -> PathBuf {
    let folder = asset.with_file_name(LEVEL_SCORES_FOLDER);
    let name = Path::new(&level.file).file_stem().unwrap_or_default();
    folder.join(name).join(RESULT_FILE)
}
