//! Edits of a trained object graph: vehicles are taken out, moved, copied or sent later.

use std::path::Path;

use glam::DVec3;
use omnilife_engine::{gaussians::tracked::OBJECT_NUMBERS, parameters::ParameterTable};
use omnilife_schemas::{
    records::{GraphObject, InvalidGaussians, Objects, Poses, RunRecord},
    store::{self, StoreError},
    trajectory::GroundAxes,
};

use crate::{
    error::ReconstructError,
    formats::{GAUSSIANS_FILE, OBJECT_GAUSSIANS_FILE, OBJECTS_FILE, objects, validity},
    jobs::run_views,
};

/// A change of one object.
#[derive(Debug, Clone, PartialEq)]
pub enum ObjectEdit {
    /// Takes it out.
    Remove(u32),
    /// Moves it along the ground, world units towards heading 0 and pi/2, and turns its path about its
    /// middle, radians.
    Move(u32, [f64; 3]),
    /// Puts another one beside it, displaced along the ground.
    Copy(u32, [f64; 2]),
    /// Sends it later, seconds.
    Delay(u32, f64),
}

impl ObjectEdit {
    fn id(&self) -> u32 {
        match self {
            Self::Remove(id) | Self::Move(id, _) | Self::Copy(id, _) | Self::Delay(id, _) => *id,
        }
    }

    /// As it stands in the record.
    fn words(&self) -> String {
        match self {
            Self::Remove(id) => format!("remove {id}"),
            Self::Move(id, [x, y, turn]) => format!("move {id} by {x}, {y}, turned by {turn}"),
            Self::Copy(id, [x, y]) => format!("copy {id} to {x}, {y} from it"),
            Self::Delay(id, seconds) => format!("delay {id} by {seconds} s"),
        }
    }
}

/// An edit that was checked and not yet written.
pub(super) struct CheckedEdit<'a> {
    /// Files of the model that it writes.
    pub(super) files: Vec<&'static str>,
    /// Lines that a reader of the edited run should know.
    pub(super) warnings: Vec<String>,
    /// Writes the model into a folder.
    pub(super) write: WriteModel<'a>,
}

/// Writes an edited model into a folder; returns its files and the changes, line by line.
pub(super) type WriteModel<'a> =
    Box<dyn FnOnce(&Path) -> Result<(Vec<String>, Vec<String>), ReconstructError> + 'a>;

/// Applies edits to the objects of a run and checks the outcome; nothing is written.
///
/// # Errors
/// When the run has no objects, an edit is of an object that is not there or by a value that is not a number, or it
/// sends an object to when no view of the run is.
pub(super) fn check<'a>(
    run_folder: &'a Path,
    run: &RunRecord,
    edits: &'a [ObjectEdit],
) -> Result<CheckedEdit<'a>, ReconstructError> {
    let objects_path = run_folder.join(OBJECTS_FILE);
    if !objects_path.is_file() {
        let reason = "has no objects that could be edited: it is no run of an object graph";
        return Err(ReconstructError::scene(run_folder, reason));
    }
    let mut invalid = InvalidGaussians::default();
    let (mut record, mut table) = objects::read_parts(run_folder, &mut invalid)?;
    for edit in edits {
        apply(edit, &mut record, &mut table)
            .and_then(|()| stays_in_clip(edit, &record, run.clip_seconds))
            .map_err(|reason| ReconstructError::scene(&objects_path, reason))?;
    }
    let mut warnings = validity::notes(run_folder, &invalid);
    warnings.extend(out_of_view(&record, run.views.as_ref()));
    let files = vec![GAUSSIANS_FILE, OBJECTS_FILE, OBJECT_GAUSSIANS_FILE];
    let written = files.iter().map(|&file| file.to_owned()).collect();
    let write: WriteModel<'a> = Box::new(move |out| {
        copy(&run_folder.join(GAUSSIANS_FILE), &out.join(GAUSSIANS_FILE))?;
        objects::write_table(out, &table)?;
        store::write_record(&out.join(OBJECTS_FILE), &record)?;
        Ok((written, edits.iter().map(ObjectEdit::words).collect()))
    });
    Ok(CheckedEdit {
        files,
        warnings,
        write,
    })
}

fn copy(from: &Path, to: &Path) -> Result<(), StoreError> {
    let bytes = std::fs::read(from).map_err(|error| StoreError::read(from, error))?;
    store::write_bytes(to, &bytes)
}

fn apply(
    edit: &ObjectEdit,
    record: &mut Objects,
    table: &mut ParameterTable,
) -> Result<(), String> {
    let at = record
        .objects
        .iter()
        .position(|object| object.id == edit.id())
        .ok_or_else(|| {
            let known: Vec<String> = record
                .objects
                .iter()
                .map(|object| object.id.to_string())
                .collect();
            format!(
                "has no object {}; known are {}",
                edit.id(),
                known.join(", ")
            )
        })?;
    let up = DVec3::from_array(record.up);
    let axes = GroundAxes::new(up).to_world;
    let on_ground = |x: f64, y: f64| axes.x_axis * x + axes.y_axis * y;
    let numbers = table.position(OBJECT_NUMBERS).unwrap_or_default();
    match *edit {
        ObjectEdit::Remove(_) => {
            let keep: Vec<bool> = table.arrays[numbers]
                .values
                .iter()
                .map(|&number| number as usize != at)
                .collect();
            table.retain(&keep);
            for number in &mut table.arrays[numbers].values {
                if *number as usize > at {
                    *number -= 1.0;
                }
            }
            record.objects.remove(at);
        }
        ObjectEdit::Move(_, [x, y, turn]) => {
            let object = &mut record.objects[at];
            object.path = object.path.clone().moved(on_ground(x, y), turn, up);
        }
        ObjectEdit::Copy(_, [x, y]) => {
            let id = record
                .objects
                .iter()
                .map(|object| object.id)
                .max()
                .unwrap_or(0)
                + 1;
            let original = &record.objects[at];
            let path = original.path.clone().moved(on_ground(x, y), 0.0, up);
            let copied = GraphObject {
                id,
                path,
                ..original.clone()
            };
            let rows: Vec<usize> = (0..table.len())
                .filter(|&row| table.row(numbers, row)[0] as usize == at)
                .collect();
            let first = table.len();
            table.append_copies(&rows);
            table.arrays[numbers].values[first..].fill(record.objects.len() as f32);
            record.objects.push(copied);
        }
        ObjectEdit::Delay(_, seconds) => {
            let object = &mut record.objects[at];
            object.path = object.path.clone().delayed(seconds);
        }
    }
    match record.objects.iter().find_map(|object| object.path.fault()) {
        Some(fault) => Err(format!("{}: its path {fault}", edit.words())),
        None => Ok(()),
    }
}

/// Refuses to send an object to when there is no view of the run; runs of older versions do not say when their
/// views are.
fn stays_in_clip(
    edit: &ObjectEdit,
    record: &Objects,
    clip_seconds: Option<[f64; 2]>,
) -> Result<(), String> {
    let (ObjectEdit::Delay(id, _), Some([first, last])) = (edit, clip_seconds) else {
        return Ok(());
    };
    let edited = record.objects.iter().find(|object| object.id == *id);
    match edited.map(|object| object.path.centre.range()) {
        Some([begin, end]) if end < first || begin > last => Err(format!(
            "{}: object {id} is never in view then: it is there from {begin} to {end} s, the views are from {first} \
             to {last} s",
            edit.words()
        )),
        _ => Ok(()),
    }
}

/// What is to be told of objects that no view of the run shows as they are now: other cameras may. Runs of older
/// versions do not say where their views are.
fn out_of_view(record: &Objects, views: Option<&Poses>) -> Vec<String> {
    let Some(views) = views else {
        return Vec::new();
    };
    record
        .objects
        .iter()
        .filter(|object| !run_views::is_in_view(object, record.up, views))
        .map(|object| {
            format!(
                "object {} is out of every one of the run's {} views now",
                object.id,
                views.frames.len()
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DQuat};
    use omnilife_schemas::{
        Pose,
        camera::PinholeCamera,
        records::{PosedFrame, Scale},
        trajectory::{BSpline, ObjectPath},
    };

    use super::*;

    fn record() -> Objects {
        let centre = BSpline {
            degree: 1,
            knots: BSpline::uniform_knots(1, 2, 2.0, 6.0),
            coefficients: vec![[0.0; 3], [4.0, 0.0, 0.0]],
        };
        Objects {
            up: [0.0, 0.0, 1.0],
            objects: vec![GraphObject {
                id: 3,
                dimensions: [4.5, 1.8, 1.5],
                path: ObjectPath {
                    centre,
                    heading_seconds: vec![2.0],
                    headings: vec![0.0],
                },
                corrections: vec![[0.0; 4]],
            }],
        }
    }

    #[test]
    fn an_edit_of_an_unknown_object_is_refused() {
        for edit in [
            ObjectEdit::Remove(4),
            ObjectEdit::Move(4, [1.0, 0.0, 0.0]),
            ObjectEdit::Copy(4, [1.0, 0.0]),
            ObjectEdit::Delay(4, 1.0),
        ] {
            let (mut changed, mut table) = (record(), ParameterTable::default());
            let refusal = apply(&edit, &mut changed, &mut table);
            assert_eq!(refusal, Err("has no object 4; known are 3".to_owned()));
            assert_eq!(changed, record());
        }
    }

    #[test]
    fn an_object_that_is_sent_out_of_the_clip_is_never_in_view() {
        let delayed = |seconds: f64, clip: Option<[f64; 2]>| {
            let (mut record, mut table) = (record(), ParameterTable::default());
            let edit = ObjectEdit::Delay(3, seconds);
            apply(&edit, &mut record, &mut table).and_then(|()| stays_in_clip(&edit, &record, clip))
        };
        let clip = Some([0.0, 10.0]);
        for seconds in [0.0, 7.9, -5.9] {
            assert_eq!(delayed(seconds, clip), Ok(()));
        }
        for seconds in [8.1, -6.1, 1e9] {
            let refusal = delayed(seconds, clip);
            assert!(
                refusal.is_err_and(|reason| reason.contains("object 3 is never in view")),
                "{seconds}"
            );
        }
        assert_eq!(delayed(1e9, None), Ok(()));
    }

    #[test]
    fn an_object_that_is_moved_out_of_every_view_is_told() {
        let looks_down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let pose = Pose::new(DQuat::from_mat3(&looks_down), DVec3::Z * 40.0);
        let views = Poses {
            scale: Scale::Metres,
            camera: Some(PinholeCamera::with_horizontal_field_of_view(64, 36, 1.1).into()),
            frames: vec![PosedFrame {
                time_seconds: 3.0,
                pose,
                mask: None,
            }],
            points: None,
        };
        let told = |east: f64, views: Option<&Poses>| {
            let (mut record, mut table) = (record(), ParameterTable::default());
            apply(
                &ObjectEdit::Move(3, [east, 0.0, 0.0]),
                &mut record,
                &mut table,
            )
            .expect("moved");
            out_of_view(&record, views)
        };
        assert!(told(5.0, Some(&views)).is_empty());
        let warning = told(5000.0, Some(&views)).join("; ");
        assert_eq!(
            warning,
            "object 3 is out of every one of the run's 1 views now"
        );
        assert!(told(5000.0, None).is_empty());
    }
}
