//! Annotation of sequences: content and motion.
//!
//! Tags and captions come from people, who label segments in the video's ledger or write tables ([`tags`]), from any
//! program ([`command`]) or from a model behind an endpoint ([`endpoint`]). Names are those of the [`taxonomy`].
//! Ego-motion and the level of dynamic content are measured ([`measure`]). All of it goes into the sequence's
//! `annotation.json`, each statement with its author; the geometry is never changed.

pub mod command;
pub mod endpoint;
pub mod measure;
pub mod tags;
pub mod taxonomy;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::{ANNOTATION_FILE, DATASET_FILE, LEDGER_FILE, SEQUENCE_FILE},
    progress::Progress,
    records::{
        Annotation, Author, Caption, Dataset, LedgerEntry, Sequence, Tag, Taxonomy, VideoStatus,
    },
    store,
};

pub use command::CaptionCommand;
pub use endpoint::CaptionEndpoint;
pub use tags::TagRow;

use crate::{
    error::CurateError,
    ledger::{Ledger, labels},
};

/// Sources of annotations.
#[derive(Debug, Clone, Default)]
pub struct AnnotateSettings {
    /// Taxonomy file; the built-in one if `None`.
    pub taxonomy: Option<PathBuf>,
    /// Tables of tags and captions by people, CSV or JSON.
    pub tags: Vec<PathBuf>,
    /// Captioning program.
    pub command: Option<CaptionCommand>,
    /// Captioning model.
    pub endpoint: Option<CaptionEndpoint>,
}

/// Annotates all sequences of the dataset in `folder`; returns how many there are.
///
/// Statements of earlier runs stay unless replaced. Labels of the ledgers are entered first, then rows of tables, then
/// the program's answers; the last one counts. Measurements are repeated, with poses and masks if there are some by
/// now.
///
/// # Errors
/// [`CurateError::Input`] for tags outside the taxonomy or for an unknown sequence, and for a captioning command or
/// endpoint that cannot be reached, fails, takes too long or gives a malformed answer.
/// [`CurateError::Store`] when a file cannot be read or written.
pub fn annotate_dataset(
    folder: &Path,
    settings: &AnnotateSettings,
    progress: &dyn Progress,
) -> Result<usize, CurateError> {
    let taxonomy = taxonomy::load(settings.taxonomy.as_deref())?;
    let dataset: Dataset = store::read_record(&folder.join(DATASET_FILE))?;
    let sequences: Vec<PathBuf> = dataset
        .videos
        .iter()
        .filter_map(|video| match &video.status {
            VideoStatus::Curated { sequences } => Some(sequences),
            _ => None,
        })
        .flatten()
        .map(|sequence| folder.join(sequence))
        .collect();
    let mut records = Vec::new();
    for sequence in &sequences {
        records.push(store::read_record::<Sequence>(
            &sequence.join(SEQUENCE_FILE),
        )?);
    }
    let mut rows = Vec::new();
    for table in &settings.tags {
        let read = tags::read(table)?;
        if let Some(row) = read
            .iter()
            .find(|row| records.iter().all(|record| record.id != row.sequence))
        {
            return Err(CurateError::input(
                table,
                format!("{} is not a sequence of this dataset", row.sequence),
            ));
        }
        rows.extend(read.into_iter().map(|row| (table, row)));
    }
    for (at, sequence) in sequences.iter().zip(&records) {
        let path = at.join(ANNOTATION_FILE);
        let mut annotation = if path.is_file() {
            store::read_record(&path)?
        } else {
            Annotation::default()
        };
        annotation.sequence.clone_from(&sequence.id);
        annotation.taxonomy.clone_from(&taxonomy.version);
        let ledger = at.with_file_name(LEDGER_FILE);
        for row in labels_of(&ledger, sequence)? {
            apply(&mut annotation, &row, &taxonomy, &ledger)?;
        }
        let of_tables = rows.iter().filter(|(_, row)| row.sequence == sequence.id);
        let of_tables: Vec<_> = of_tables.collect();
        for (table, row) in &of_tables {
            apply(&mut annotation, row, &taxonomy, table)?;
        }
        let of_tables: Vec<&TagRow> = of_tables.iter().map(|(_, row)| row).collect();
        for line in tags::contradictions(&of_tables) {
            progress.note(&format!("{}: {line}", sequence.id));
        }
        if let Some(command) = &settings.command {
            let row = command.run(at, sequence, &taxonomy, progress)?;
            apply(
                &mut annotation,
                &row,
                &taxonomy,
                Path::new(&command.program),
            )?;
        }
        if let Some(endpoint) = &settings.endpoint {
            let row = endpoint.run(folder, at, sequence, progress)?;
            apply(&mut annotation, &row, &taxonomy, at)?;
        }
        let motion = measure::measure(at, sequence, progress)?;
        annotation.ego_motion.measured = Some(motion.ego_motion);
        annotation.dynamics = Some(motion.dynamics);
        report_disagreement(&annotation, progress);
        store::write_record(&path, &annotation)?;
    }
    Ok(sequences.len())
}

/// Returns the ledger's labels of a sequence, in increasing order of precedence.
fn labels_of(ledger: &Path, sequence: &Sequence) -> Result<Vec<TagRow>, CurateError> {
    if !ledger.is_file() {
        return Ok(Vec::new());
    }
    let ledger_of_video = Ledger::read(ledger)?;
    if ledger_of_video.source().sha256 != sequence.source.sha256 {
        return Err(CurateError::input(ledger, "is the ledger of another video"));
    }
    let entries: &[LedgerEntry] = ledger_of_video.entries();
    let labels = labels::of_segment(entries, sequence.range).into_iter();
    Ok(labels
        .map(|(author, label)| {
            let (Author::Detector(name) | Author::Annotator(name) | Author::Expert(name)) = author;
            TagRow {
                sequence: sequence.id.clone(),
                author: name.clone(),
                scene: label.scene.clone(),
                action: label.action.clone(),
                traversal: label.traversal,
                caption: None,
            }
        })
        .collect())
}

/// Enters the statements of one author; `source` is named in errors.
fn apply(
    annotation: &mut Annotation,
    row: &TagRow,
    taxonomy: &Taxonomy,
    source: &Path,
) -> Result<(), CurateError> {
    let unknown = |kind: &str, name: &str| {
        CurateError::input(
            source,
            format!(
                "{}: {name} is not among the {kind}s of taxonomy {}",
                row.sequence, taxonomy.version
            ),
        )
    };
    let tag = |name: &String| Tag {
        name: name.clone(),
        author: row.author.clone(),
    };
    if let Some(scene) = &row.scene {
        let group = taxonomy::group_of(&taxonomy.scenes, scene);
        annotation.group = Some(group.ok_or_else(|| unknown("scene", scene))?.to_owned());
        annotation.scene = Some(tag(scene));
    }
    if let Some(action) = &row.action {
        let class = taxonomy::group_of(&taxonomy.actions, action);
        annotation.ego_motion.of_action =
            Some(class.ok_or_else(|| unknown("action", action))?.to_owned());
        annotation.action = Some(tag(action));
    }
    if let Some(traversal) = row.traversal {
        annotation.traversal = traversal;
    }
    if let Some(text) = &row.caption {
        annotation
            .captions
            .retain(|caption| caption.author != row.author);
        annotation.captions.push(Caption {
            text: text.clone(),
            author: row.author.clone(),
        });
    }
    Ok(())
}

fn report_disagreement(annotation: &Annotation, progress: &dyn Progress) {
    let motion = &annotation.ego_motion;
    if let (Some(of_action), Some(measured)) = (&motion.of_action, &motion.measured)
        && measured.class != measure::UNKNOWN
        && *of_action != measured.class
    {
        progress.note(&format!(
            "{}: its action is {of_action}, its motion measures {}; both are recorded",
            annotation.sequence, measured.class
        ));
    }
}
