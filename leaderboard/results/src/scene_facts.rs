//! Facts of scenes, from the records of a dataset: duration and dynamic content.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{
    layout::{ANNOTATION_FILE, SEQUENCE_FILE},
    records::{Annotation, Dataset, Sequence, VideoStatus},
    store,
};

use crate::error::ResultsError;

/// Facts of a scene, if its records exist.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SceneFacts {
    /// Length in seconds.
    pub duration_seconds: Option<f64>,
    /// Measured class of the camera's motion.
    pub ego_motion: Option<String>,
    /// Measured class of motion beside the camera's.
    pub dynamics: Option<String>,
    /// Category of the scene.
    pub category: Option<String>,
    /// Semantic group of the category.
    pub group: Option<String>,
    /// Action class.
    pub action: Option<String>,
}

/// Reads the facts of all scenes, by id. Sequences lie beside the `file` of the dataset; moved ones have no facts.
///
/// # Errors
/// [`ResultsError::Store`] when a record cannot be read.
pub fn read(file: &Path, dataset: &Dataset) -> Result<BTreeMap<String, SceneFacts>, ResultsError> {
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
            let duration_seconds = Some(record.range.duration_seconds());
            facts.insert(record.id, of_annotation(annotation, duration_seconds));
        }
    }
    Ok(facts)
}

fn of_annotation(annotation: Option<Annotation>, duration_seconds: Option<f64>) -> SceneFacts {
    let Some(annotation) = annotation else {
        return SceneFacts {
            duration_seconds,
            ..SceneFacts::default()
        };
    };
    SceneFacts {
        duration_seconds,
        ego_motion: annotation.ego_motion.measured.map(|found| found.class),
        dynamics: annotation.dynamics.map(|found| found.class),
        category: annotation.scene.map(|tag| tag.name),
        group: annotation.group,
        action: annotation.action.map(|tag| tag.name),
    }
}
