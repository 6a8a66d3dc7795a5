//! What the records of a dataset say about a scene: how long it is and how much moves.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{
    layout::{ANNOTATION_FILE, SEQUENCE_FILE},
    records::{Annotation, Dataset, Sequence, VideoStatus},
    store,
};

use crate::error::LeaderboardError;

/// Facts of a scene, as far as its records are there.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct SceneFacts {
    pub(super) duration_seconds: Option<f64>,
    /// Measured class of the camera's motion.
    pub(super) ego_motion: Option<String>,
    /// Category of the scene.
    pub(super) category: Option<String>,
}

/// Facts by scene. Sequences lie beside the `file` of the dataset; what has moved away has none.
pub(super) fn read(
    file: &Path,
    dataset: &Dataset,
) -> Result<BTreeMap<String, SceneFacts>, LeaderboardError> {
    let mut facts = BTreeMap::new();
    for video in &dataset.videos {
        let VideoStatus::Curated { sequences } = &video.status else {
            continue;
        };
        for sequence in sequences {
            let folder = file.with_file_name(sequence);
            let record = folder.join(SEQUENCE_FILE);
            if !record.is_file() {
                continue;
            }
            let record: Sequence = store::read_record(&record)?;
            let annotation = folder.join(ANNOTATION_FILE);
            let annotation: Option<Annotation> = annotation
                .is_file()
                .then(|| store::read_record(&annotation))
                .transpose()?;
            let ego_motion = annotation.as_ref().and_then(|annotation| {
                let measured = annotation.ego_motion.measured.as_ref();
                measured.map(|measured| measured.class.clone())
            });
            let category = annotation.and_then(|annotation| Some(annotation.scene?.name));
            facts.insert(
                record.id,
                SceneFacts {
                    duration_seconds: Some(record.range.duration_seconds()),
                    ego_motion,
                    category,
                },
            );
        }
    }
    Ok(facts)
}
