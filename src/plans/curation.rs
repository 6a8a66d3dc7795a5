//! Units of a curation, one per video, into one dataset.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_curate::{dataset::folder_names, expand_inputs};
use omnilife_schemas::{layout::VIDEOS_FOLDER, records::SweepUnit};
use omnilife_sweep::plan;

use super::{absolute, argument, needs, own_command, words};
use crate::cli::{CurationSettingsArguments, PlanArguments};

/// Returns units that curate one video each, and the command that makes a dataset of them.
///
/// # Errors
/// When a path does not exist or the settings are invalid.
pub(crate) fn units(
    videos: &[PathBuf],
    dataset: &Path,
    settings: &CurationSettingsArguments,
    arguments: &PlanArguments,
) -> anyhow::Result<(Vec<SweepUnit>, Vec<String>)> {
    let dataset = absolute(dataset)?;
    let videos: Vec<PathBuf> = expand_inputs(videos)?
        .iter()
        .map(|video| absolute(video))
        .collect::<Result<_, _>>()?;
    if let Some(video) = videos.first() {
        settings.settings().check(video)?;
    }
    let needs = needs(arguments)?;
    let options = settings.words();
    let mut units = Vec::new();
    for (video, name) in videos.iter().zip(folder_names(&videos)) {
        let folder = dataset.join(VIDEOS_FOLDER).join(&name);
        let (video, folder) = (argument(video)?, argument(&folder)?);
        let mut command = words(&["curate", "video", &video, "--folder", &folder]);
        command.extend(options.iter().cloned());
        units.push(SweepUnit {
            id: plan::file_name(&name),
            group: "curate".to_owned(),
            labels: BTreeMap::from([("video".to_owned(), video.clone())]),
            commands: vec![own_command(command)?],
            on_failure: Vec::new(),
            inputs: vec![video],
            // A video that the criteria reject by its header alone leaves nothing.
            outputs: Vec::new(),
            needs,
        });
    }
    let mut reduce = words(&["curate", "build", "--out", &argument(&dataset)?]);
    reduce.extend(options);
    for video in &videos {
        reduce.push(argument(video)?);
    }
    Ok((units, own_command(reduce)?))
}
